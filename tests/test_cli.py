"""The command from outside: exit codes, no traceback, nothing half-written; JSON, log, profile, interrupts, schemas."""

import json
import logging
import math
import pickle
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import NamedTuple

import fastjsonschema
import numpy as np
import pytest
from interrupts import heed_interrupts, interrupted, of_unix
from scipy.optimize import brentq

from compact.analysis.failures import is_refusal, run_marked
from compact.analysis.sizing.durations import read_durations
from compact.cli import INTERRUPTED, options
from compact.cli import program as cli
from compact.files import default_directory
from compact.scene.loader import SceneError, scene_schema, summary_schema
from compact.scene.new_scene import starter_scene

ROOT = Path(__file__).parent.parent
SMALL = ROOT / "compact" / "data" / "scenes" / "small.toml"
ERRORS_PAGE = (ROOT / "docs" / "reference" / "errors.md").read_text("utf-8")
KNOWN_BY_CODE = {
    options.SUCCESS: "success", options.NO_RESULT: "no result", options.INVALID_INPUT: "invalid input",
    INTERRUPTED: "interrupted",
}  # fmt: skip


class Told(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def compact(monkeypatch, capsys):
    """The command, called in this process: a warning fails it, and what it lets pass fails the test."""

    def called(*arguments, cwd="."):
        monkeypatch.chdir(cwd)
        monkeypatch.setattr("sys.argv", ["compact", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return Told(ended.value.code, *capsys.readouterr())

    return called


WITHOUT_UNIX = """
import os, sys, warnings

warnings.filterwarnings("ignore", "only soft file lock")  # of filelock, which has another one on Windows
sys.modules |= dict.fromkeys(("fcntl", "resource", "termios", "pwd", "grp"))
if hasattr(os, "sched_getaffinity"):
    del os.sched_getaffinity
from compact.cli import main

main()
"""


def test_study_runs_without_modules_of_unix(tmp_path):
    few = ("--set", "output.items=['tables']", "--set", "motion.laws=['cubic']", "--quiet")
    call = [sys.executable, "-c", WITHOUT_UNIX, "run", str(SMALL), *few, "--out", str(tmp_path / "out")]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "out" / "summary.json").exists()


@pytest.mark.slow
def test_new_scene_runs_as_it_is(compact, tmp_path):
    assert compact("new", tmp_path / "mine").returncode == 0
    done = compact("run", "scene.toml", cwd=tmp_path / "mine")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "mine" / "out" / "mine" / "summary.json").exists()
    assert (tmp_path / "mine" / "out" / "mine" / "report.html").exists()
    assert "compaction: auto: the cheapest that may size this scene" in done.stdout


def test_cam_command_writes_what_the_workshop_needs(compact, tmp_path):
    done = compact("cam", SMALL, "--law", "combined-3", "--follower", "flat", "--out", tmp_path, "--cutter", "0.02")
    assert done.returncode == 0, done.stderr
    assert "least breadth                 0.605" in done.stdout  # 1.514 strokes of 0.4 m, D-cams
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "combined-3-flat.csv", "combined-3-flat.dxf", "combined-3-flat.svg",
    ]  # fmt: skip
    header = (tmp_path / "combined-3-flat.csv").read_text().splitlines()[0]
    assert header.startswith("cam_angle_deg,follower_mm,x_mm,y_mm")


@pytest.mark.slow
def test_roll_by_finite_elements_writes_the_fields_of_a_free_roller(compact, tmp_path):
    picture = tmp_path / "layer.png"
    done = compact("roll", SMALL, "--engine", "fem", "--picture", picture, "--out", tmp_path / "contact")
    assert done.returncode == 0, done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in (tmp_path / "contact").iterdir()} == {
        "contact.json", "fields", "fields.png", "fields.pvd", "pressure.csv", "pressure.png", "scene.hash",
    }  # fmt: skip
    assert [path.name for path in (tmp_path / "contact" / "fields").iterdir()] == ["speed=0.13333333333333333.vtu"]


def test_a_file_in_place_of_the_results_is_named(compact):
    told = compact("run", SMALL, "--out", SMALL)
    assert (told.returncode, "small.toml" in told.stderr, "Traceback" in told.stderr) == (1, True, False)


IMPORT_INTERRUPTED = """
import signal, sys

class Interrupting:
    def find_spec(self, name, *_):
        if name == {module!r}:
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                if not {cleared}:
                    raise

sys.meta_path.insert(0, Interrupting())
sys.argv = ["compact", "--help"]
from compact.cli import main
main()
"""


@of_unix
@pytest.mark.parametrize("cleared", [False, True], ids=["raised", "cleared, as some compiled modules do"])
@pytest.mark.parametrize("module", ["cyclopts"])
def test_interrupt_of_the_import_is_a_sentence(module, cleared):
    call = [sys.executable, "-c", IMPORT_INTERRUPTED.format(module=module, cleared=cleared)]
    told = subprocess.run(call, capture_output=True, text=True, check=False, preexec_fn=heed_interrupts)
    assert (told.returncode, told.stdout) == (130, "")
    assert told.stderr == "compact: interrupted; every file already written is whole\n"


@pytest.mark.parametrize(("work", "task", "ours"), [(read_durations, "duration=1:2", True), (float, "a", False)])
def test_a_refusal_from_a_worker_process_is_told_from_an_error_of_a_library(work, task, ours):
    with pytest.raises(ValueError, match=r".") as found:
        run_marked(work, task)
    assert is_refusal(pickle.loads(pickle.dumps(found.value))) is ours


# where results go, and errors of arithmetic


@pytest.mark.parametrize(
    ("path", "suffix", "directory"),
    [
        ("mine/scene.toml", "", "out/mine"),
        ("mine/scene.toml", "sweep", "out/mine-sweep"),
        ("mine/other.toml", "", "out/other"),
        ("mine/other.toml", "calibration.json", "out/other-calibration.json"),
        ("/scene.toml", "", "out/scene"),
    ],
)
def test_default_directory_has_the_name_of_the_scene_or_of_its_folder(path, suffix, directory):
    assert default_directory(path, suffix) == Path(directory)


def raising(error):
    raise error


UNITS = "check their units"
ERRORS = [  # what reading a scene ends with, exit code, words
    (lambda: raising(KeyboardInterrupt), 130, "interrupted; every file already written is whole"),
    (lambda: raising(MemoryError), 1, "not enough memory in options; lower"),
    (lambda: raising(RuntimeError("no steady state")), 1, "no steady state"),
    (lambda: raising(SceneError(["give the radius in m"])), 2, "give the radius in m"),
    (lambda: raising(TypeError("boom")), 1, "internal error, please report it: TypeError: boom"),
    (lambda: float("a"), 1, "internal error, please report it: "),
    (lambda: np.zeros(2) + np.zeros(3), 1, "internal error, please report it: "),  # numpy in C
    (lambda: brentq(lambda x: x - 0.3, 0, 1, maxiter=1), 1, "internal error, please report it: "),
    (lambda: np.sqrt(np.array([-1.0])), 1, f"an operation has no result….*{UNITS}"),
    (lambda: 1 / 0, 1, f"a number is divided by zero….*{UNITS}"),
    (lambda: math.exp(1e4), 1, f"the computation failed in options….*{UNITS}"),
    (lambda: np.linalg.inv(np.zeros((2, 2))), 1, f"an equation has no finite solution….*{UNITS}"),
]


@pytest.mark.parametrize(("compute", "code", "words"), ERRORS)
def test_an_error_is_a_sentence_with_its_exit_code(capsys, monkeypatch, compute, code, words):
    monkeypatch.setattr("compact.scene.loader.load_scene", lambda *_, **__: compute())
    assert cli._exit_code(["run", str(SMALL)]) == code
    output, told = capsys.readouterr()
    assert output == ""
    assert told.startswith("compact: ")
    assert re.search(".*".join(map(re.escape, words.split("….*"))), told)
    assert not re.search("encountered|Traceback|Singular", told)


# exit codes


def test_documented_exit_codes_are_those_of_the_program():
    table = dict(re.findall(r"^\| (\d+) \| ([a-z ]+) \|", ERRORS_PAGE, re.MULTILINE))
    assert {int(code): meaning for code, meaning in table.items()} == KNOWN_BY_CODE


ROLL = """
import sys
from compact.cli import main

sys.argv = ["compact", "roll", {scene!r}, "--engine", "fem", "--out", {out!r}, "--set", "accuracy.tolerance=1e-5"]
print("begun", flush=True)
main()
"""


@of_unix
@pytest.mark.slow
def test_interrupt_of_finite_elements_ends_within_a_second(tmp_path):
    code, seconds, message = interrupted(ROLL.format(scene=str(SMALL), out=str(tmp_path / "out")))
    assert code == INTERRUPTED
    assert seconds < 1
    assert message == "compact: interrupted; every file already written is whole\n"


# JSON


def test_json_of_a_contact_is_all_that_is_printed(compact, tmp_path):
    code, output, _ = compact("roll", SMALL, "--engine", "formula", "--out", tmp_path, "--json")
    found = json.loads(output)
    assert (code, found["results"]) == (0, str(tmp_path))
    assert found["contact"] == json.loads((tmp_path / "contact.json").read_text())
    written = {"contact.json", "pressure.csv", "pressure.png", "scene.hash"}
    assert {path.name for path in tmp_path.iterdir()} == written


@pytest.mark.parametrize(
    ("engine", "items"), [("formula", "[]"), pytest.param("column", "['report', 'cams']", marks=pytest.mark.slow)]
)
def test_summary_satisfies_its_schema(compact, tmp_path, engine, items):
    items = f"output.items={items}"
    code, output, _ = compact("run", SMALL, "--out", tmp_path, "--set", items, "--engine", engine, "--json")
    summary = json.loads(output)["summary"]
    assert code == 0
    fastjsonschema.compile(summary_schema())(summary)
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    described = summary_schema()["properties"].keys()
    assert summary.keys() <= described, "describe new keys in compact/data/summary.schema.json"
    for key in ("value", "law"):  # a schema that accepts anything would hold too
        spoiled = json.loads(json.dumps(summary).replace(f'"{key}":', '"other":'))
        with pytest.raises(fastjsonschema.JsonSchemaValueException):
            fastjsonschema.compile(summary_schema())(spoiled)


# schema of scenes


def test_scenes_satisfy_the_schema():
    validate = fastjsonschema.compile(scene_schema())
    texts = [path.read_text("utf-8") for path in SMALL.parent.glob("*.toml")]
    scenes = [scene for scene in map(tomllib.loads, [*texts, starter_scene()]) if "machine" in scene]
    assert len(scenes) > 5
    assert [validate(scene) for scene in scenes] == scenes
    with pytest.raises(fastjsonschema.JsonSchemaValueException):
        validate(scenes[0] | {"machine": {"mass": "heavy"}})


def test_new_scene_names_the_schema_that_lies_next_to_it(compact, tmp_path):
    assert compact("new", tmp_path).returncode == 0
    first, _ = (tmp_path / "scene.toml").read_text().split("\n", 1)
    assert first == "#:schema ./scene.schema.json"
    assert json.loads((tmp_path / "scene.schema.json").read_text()) == json.loads(compact("schema").stdout)


# log and profile


def test_log_has_stages_and_files(compact, tmp_path):
    code, output, log = compact("roll", SMALL, "--engine", "formula", "--out", tmp_path, "--verbose")
    assert code == 0
    assert "resistance/load" in output
    assert re.search(r"^ +\d+ ms  compact\.stages: contact by formula$", log, re.MULTILINE)
    assert re.search(r"ms  compact\.files: .*contact\.json written$", log, re.MULTILINE)
    assert not logging.getLogger("compact").handlers
