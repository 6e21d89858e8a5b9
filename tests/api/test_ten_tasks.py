"""Ten tasks of the tutorial: each block runs, has at most five statements, and passes the type checker."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples" / "ten_tasks.py"
TASKS = ("load", "roll", "plot", "fields", "rank", "law", "resistance", "material", "sweep", "process")
LONG = ("fields", "process")  # some seconds
MOST_STATEMENTS = 5


def blocks() -> dict[str, str]:
    """Code of each task by its name."""
    head, *parts = re.split(r"(?m)^# \[(\w+)\] ", EXAMPLES.read_text("utf-8"))
    return {"head": head} | {name: f"# {code}" for name, code in zip(parts[::2], parts[1::2], strict=True)}


def run(names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies").symlink_to(ROOT / "studies")
    found: dict[str, object] = {"__name__": "ten_tasks"}
    for name, code in blocks().items():
        if name in ("head", *names):
            exec(compile(code, f"ten_tasks.py [{name}]", "exec"), found)
    return found


def test_the_ten_tasks_have_at_most_five_statements():
    found = blocks()
    assert tuple(found)[1:] == TASKS
    counts = {name: len(ast.parse(code).body) for name, code in found.items() if name != "head"}
    assert max(counts.values()) <= MOST_STATEMENTS


def test_short_tasks_run(tmp_path, monkeypatch, capsys):
    found = run([name for name in TASKS if name not in LONG], tmp_path, monkeypatch)
    assert found["frame"].shape[0] == 5
    assert (tmp_path / "loads.png").exists()
    assert dict(found["dataset"].sizes) == {"moisture": 3, "fed_density_ratio": 4}
    assert "reversal-3" in capsys.readouterr().out


@pytest.mark.slow
def test_long_tasks_run(tmp_path, monkeypatch):
    found = run(["load", *LONG], tmp_path, monkeypatch)
    assert found["grid"].n_cells > 100
    assert len(found["strokes"]) == 75


@pytest.mark.slow
def test_the_ten_tasks_pass_the_type_checker(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", "--cache-dir", str(tmp_path), str(EXAMPLES)],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout == ""
