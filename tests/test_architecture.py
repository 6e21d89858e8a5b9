"""Architecture of the package: layers of imports, sizes, light start-up, public names that resolve."""

import ast
import os
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from importlinter.application.use_cases import lint_imports

import compact

ROOT = Path(__file__).parents[1]
ENGINES = ("column", "compaction", "fem", "spectral")
HEAVY = ("numpy", "scipy", "numba", "matplotlib", "xarray", "pandas", "pydantic", "meshio", "skfem", "pyvista")


def test_imports_keep_the_layers_of_pyproject(monkeypatch):
    from importlinter import configuration

    monkeypatch.chdir(ROOT)
    configuration.configure()
    assert lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None)


@pytest.mark.parametrize("module", ["compact", "compact.cli"])
def test_start_up_imports_no_heavy_package(module):
    script = f"import sys, {module}; print(*sorted(set({HEAVY}) & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == []


IMPORT_ALL = """
import importlib, pkgutil
import compact

before = {name: getattr(compact, name) for name in compact.__all__}
for module in pkgutil.walk_packages(compact.__path__, "compact."):
    importlib.import_module(module.name)
print(*(name for name in compact.__all__ if getattr(compact, name) is not before[name]))
"""


def test_every_module_imports_and_leaves_public_names_as_they_were():
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == []
    assert len(compact.__all__) > 40


PACKAGE = ROOT / "compact"
SMALL = {"__init__.py", "__main__.py", "contact.py", "drive.py"}  # doors


def test_folders_and_modules_have_a_readable_size():
    assert len([path for path in PACKAGE.iterdir() if path.name != "__pycache__"]) <= 28
    folders = {path.parent for path in PACKAGE.rglob("*.py")} - {PACKAGE / "engines"}  # which holds four folders
    assert {folder.name for folder in folders if not 3 <= len(list(folder.glob("*.py"))) <= 16} == set()
    lines = {
        path: len(path.read_text("utf-8").splitlines()) for path in PACKAGE.rglob("*.py") if path.name not in SMALL
    }
    assert {path.name for path, count in lines.items() if not 60 <= count <= 600} == set()


BUDGET = {  # lines of code of each part; beyond its line a feature pays by a deletion
    "engines": 6408, "analysis": 4925, "report": 2138, "machine": 2982, "scene": 1661, "motion": 1069, "material": 1077,
    "sweep": 556, "cams": 524, "validation": 470, "api": 426, "numerics": 561, "cli": 512, "verification": 254,
    "interfaces": 241, "modules": 1316,
}  # fmt: skip


def code_lines(path):
    """Lines of code of a module: without docstrings, comments and blanks."""
    source, owners = path.read_text("utf-8"), (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings, texts = set(), set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, owners) and ast.get_docstring(node, clean=False) is not None:
            docstrings |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
        elif isinstance(node, ast.JoinedStr | ast.Constant) and node.end_lineno > node.lineno:
            texts |= set(range(node.lineno, node.end_lineno + 1))
    filled = {number for number, line in enumerate(source.splitlines(), 1) if line.strip()[:1] not in ("", "#")}
    return len((filled | texts) - docstrings)


def test_a_part_keeps_to_its_budget():
    folders = [folder for folder in PACKAGE.iterdir() if folder.name != "data" and any(folder.glob("*.py"))]
    found = {folder.name: sum(map(code_lines, folder.rglob("*.py"))) for folder in folders}
    found["modules"] = sum(map(code_lines, PACKAGE.glob("*.py")))
    assert found.keys() == BUDGET.keys()
    assert {name: count for name, count in found.items() if count > BUDGET[name]} == {}


def test_a_public_name_is_defined_in_at_most_three_modules():
    homes = defaultdict(list)
    for path in PACKAGE.rglob("*.py"):
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(path.stem)
    assert {name for name, modules in homes.items() if len(modules) > 3} == {"roll"}


FLAGS = (  # of engines, that callers once read
    "layered", "compacting", "forming", "continuation", "density_target", "rate_factor_only", "cheap", "multipass",
    "tolerance_keyword", "optional_estimate", "fields_module", "derivative_module", "takes",
)  # fmt: skip


def test_nobody_asks_what_a_drive_or_an_engine_is():
    asked = re.compile(rf"(?:engine|ENGINES\[[^]]*\]|used)\.(?:{'|'.join(FLAGS)})\b")
    asked = re.compile(rf"{asked.pattern}|drive\.kind (?:[!=]=|in)\s")
    files = [*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.j2")]
    assert {f"{path.name}: {found[0]}" for path in files for found in asked.finditer(path.read_text("utf-8"))} == set()


COMPACTING = ("column", "compaction")  # engines whose law of the mix has a Heckel slope


@pytest.mark.parametrize(("key", "engines"), [("machine.roller_radius", ENGINES), ("mix.heckel_slope", COMPACTING)])
def test_a_parameter_travels_through_at_most_eight_modules(key, engines):
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8").partition(f"\n`{key}` on its way")[2]
    walk = re.findall(r"^\| `(.*?)` \| `(.*?)` \|", page.partition("\n`")[0], re.MULTILINE)
    assert 5 <= len(walk) <= 8
    ways = [(re.sub("<.*engine>/", engine, name), word) for name, word in walk for engine in engines]
    places = [(PACKAGE / name, word) for name, word in ways]
    sources = {
        path: "".join(each.read_text("utf-8") for each in [path, *path.glob("*.py")] if each.is_file())
        for path, _ in places
    }
    assert [(path.name, word) for path, word in places if not re.search(rf"\b{word}\b", sources[path])] == []
