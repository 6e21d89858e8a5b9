"""Documentation: links between pages, reference of the public names, pages and results of the studies."""

import csv
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import compact
from compact.material.mix import PARAMETER_NAMES
from compact.scene.loader import SceneError, parse_scene
from compact.scene.new_scene import starter_scene

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


def gallery():
    """Return the module that runs the studies."""
    return loaded("gallery", "gallery/run.py")


def loaded(name, path=None):
    """Return a module of the documentation."""
    specification = importlib.util.spec_from_file_location(name, DOCS / (path or f"{name}.py"))
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def anchors(page):
    """Return the anchors of the headings of a page, as GitHub forms them."""
    headings = re.findall(r"(?m)^#+ (.*)$", re.sub(r"(?ms)^```.*?^```$", "", page.read_text("utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_between_pages_lead_to_a_file_and_a_heading():
    broken = []
    for page in PAGES:
        for link in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"(?ms)^```.*?^```$", "", page.read_text("utf-8"))):
            path, _, anchor = link.partition("#")
            target = page.parent / path if path else page
            if re.match(r"[a-z]+:", link):
                continue
            if not target.exists() or (anchor and anchor not in anchors(target)):
                broken.append(f"{page.relative_to(ROOT)}: {link}")
    assert broken == []


@pytest.mark.parametrize("page", ["README.md", "docs/tutorial/own_scene.md"])
def test_the_refusal_that_a_page_shows_is_that_of_the_starter(page):
    with pytest.raises(SceneError) as refused:
        parse_scene(starter_scene().replace("roller_radius = 0.11 ", "roller_radius = -0.11"), "mine/scene.toml")
    assert f"compact: {refused.value}\n" in (ROOT / page).read_text("utf-8")


def test_the_readme_counts_the_parameters_of_the_prior():
    assert f"{len(PARAMETER_NAMES)} parameters with spread and origin" in (ROOT / "README.md").read_text("utf-8")


def verified():
    """Return the rows of the verified numbers."""
    return list(csv.DictReader((DOCS / "verification.csv").read_text("utf-8").splitlines()))


def test_every_mark_of_a_table_has_its_table():
    tables = loaded("tables")
    marks = {page.name: tables.MARK.findall(page.read_text("utf-8")) for page in PAGES}
    named = [name for names in marks.values() for name in names]
    assert all(tables.table(name).count("\n| ") > 1 for name in named)
    assert {f"validation/{name}" for name in tables.CASES} <= set(named)
    sections = {row["section"] for row in verified()}
    assert {f"verification/{section}" for section in sections} <= set(named)


def test_every_verified_number_has_its_test():
    for row in verified():
        assert all((ROOT / path).is_file() for path in row["tests"].split()), row["number"]
        assert row["tolerance"]


def test_every_name_of_the_package_is_in_the_reference():
    listed = set(re.findall(r"(?m)^   ~compact\.[\w.]*?(\w+)$", (DOCS / "reference" / "api.md").read_text("utf-8")))
    assert listed == set(compact.__all__)


def test_every_study_has_a_page_with_its_result():
    runs, index = gallery().RUNS, (DOCS / "gallery" / "index.md").read_text("utf-8")
    assert set(runs) == {path.stem for path in (ROOT / "studies").glob("*.py")}
    for name, run in runs.items():
        page = (DOCS / "gallery" / f"{name}.md").read_text("utf-8")
        result = f"results/{name}{'.png' if run.figure else '.txt'}"
        assert (DOCS / "gallery" / result).is_file()
        assert result in page
        assert f"({name}.md)" in index
        command = re.search(rf"python studies/{name}\.py(.*)", page).group(1)
        assert [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', command)] == list(run.arguments)


def test_a_study_that_fails_is_named(tmp_path, monkeypatch, capsys):
    module = gallery()
    monkeypatch.setitem(module.RUNS, "absent", module.Run(""))
    assert module.main(["absent", "--out", str(tmp_path)]) == 1
    assert re.search(r"absent .* exit code 2: .*No such file", capsys.readouterr().out)


def test_an_unknown_study_is_refused(capsys):
    with pytest.raises(SystemExit):
        gallery().main(["rank_all"])
    assert "no study rank_all; choose from compaction_baseline, " in capsys.readouterr().err


@pytest.mark.slow
def test_studies_in_a_few_lines_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies").symlink_to(ROOT / "studies")
    code = (DOCS / "examples" / "short_studies.py").read_text("utf-8")
    exec(compile(code, "short_studies.py", "exec"), {"__name__": "short_studies"})
    printed = capsys.readouterr().out
    assert re.search(r"column +reversal-3 +\d+ W", printed)
    assert re.findall(r"(?m)^ +\d\.\d s +([a-z]+)", printed) == ["cubic", "cubic", "reversal", "reversal"]
    shown = {name for name in gallery().RUNS if f"# [{name}]" in code}
    pages = {name: (DOCS / "gallery" / f"{name}.md").read_text("utf-8") for name in shown}
    assert len(shown) == 5
    assert all(f":start-at: '# [{name}]'" in page for name, page in pages.items())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "scene"), [("README.md", "loveikin-2015-engines"), ("docs/tutorial/first_run.md", "mine/scene.toml")]
)
def test_the_answer_that_a_page_shows_is_printed(tmp_path, page, scene):
    """Every line that the page shows is printed as it is; … stands for further lines."""
    shown = re.search(r"```text\n(.*?)```", (ROOT / page).read_text("utf-8"), re.S)[1].splitlines()
    command = [sys.executable, "-m", "compact"]
    subprocess.run([*command, "new", "mine"], cwd=tmp_path, check=True, capture_output=True)
    done = subprocess.run([*command, "run", scene], cwd=tmp_path, check=True, capture_output=True, text=True)
    printed = done.stdout.splitlines()
    assert [line for line in shown if line.strip() != "…" and line not in printed] == []
