"""Service of the command: exit codes as documented, JSON, log, profile, interrupts, schemas that editors read."""

import json
import logging
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import fastjsonschema
import pytest
from interrupts import heed_interrupts, interrupted, of_unix

from compact.cli import INTERRUPTED, options
from compact.cli import program as cli
from compact.files import write_json
from compact.scene.json_schemas import scene_schema, summary_schema
from compact.scene.loader import SceneError, parse_scene, starter_scene

ROOT = Path(__file__).parents[1]
SMALL = ROOT / "studies" / "scenes" / "small.toml"
ERRORS_PAGE = (ROOT / "docs" / "reference" / "errors.md").read_text("utf-8")
KNOWN_BY_CODE = {
    options.SUCCESS: "success",
    options.NO_RESULT: "no result",
    options.INVALID_INPUT: "invalid input",
    INTERRUPTED: "interrupted",
}


@pytest.fixture
def call(monkeypatch, capsys):
    """Call of the command in this process: exit code, standard output, standard error."""

    def called(*arguments):
        monkeypatch.setattr("sys.argv", ["compact", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, *capsys.readouterr()

    return called


# exit codes


def test_documented_exit_codes_are_those_of_the_program():
    table = dict(re.findall(r"^\| (\d+) \| ([a-z ]+) \|", ERRORS_PAGE, re.MULTILINE))
    assert {int(code): meaning for code, meaning in table.items()} == KNOWN_BY_CODE


def test_interrupt_states_what_is_kept(capsys, monkeypatch, tmp_path):
    def interrupted_writer(study, directory, *_):
        write_json(directory / "contacts.json", {})
        raise KeyboardInterrupt

    monkeypatch.setattr("compact.report.writer.write_study", interrupted_writer)
    assert cli._exit_code(["run", str(SMALL), "--out", str(tmp_path / "out")]) == INTERRUPTED
    message = capsys.readouterr().err
    assert message.startswith("compact: interrupted; every file already written is whole; ")
    assert message.endswith(f"complete files are in {tmp_path / 'out'}; the same command computes the others\n")


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


DROPPED = """
import sys
import time
from compact import cli
from compact.cli import program

class Callback:
    def __del__(self):
        raise KeyboardInterrupt

def work():
    Callback()
    time.sleep(600)

program.main = work
cli.main()
"""


@of_unix
def test_interrupt_that_python_drops_is_repeated():
    """Python ignores what is raised in a callback, such as that of an import lock."""
    ended = subprocess.run(
        [sys.executable, "-c", DROPPED], capture_output=True, text=True, timeout=120, preexec_fn=heed_interrupts
    )
    assert ended.returncode == INTERRUPTED
    assert ended.stderr == "compact: interrupted; every file already written is whole\n"


# JSON


def test_json_of_a_contact_is_all_that_is_printed(call, tmp_path):
    code, output, _ = call("roll", SMALL, "--engine", "formula", "--out", tmp_path, "--json")
    found = json.loads(output)
    assert code == 0
    assert found["results"] == str(tmp_path)
    assert found["contact"] == json.loads((tmp_path / "contact.json").read_text())


@pytest.mark.parametrize(
    ("engine", "items"), [("formula", "[]"), pytest.param("column", "['report', 'cams']", marks=pytest.mark.slow)]
)
def test_summary_satisfies_its_schema(call, tmp_path, engine, items):
    items = f"output.items={items}"
    code, output, _ = call("run", SMALL, "--out", tmp_path, "--set", items, "--engine", engine, "--json")
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
    for path in (ROOT / "studies" / "scenes").glob("*.toml"):
        scene = tomllib.loads(path.read_text("utf-8"))
        if "machine" in scene:
            validate(scene)
    validate(tomllib.loads(starter_scene()))


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        ("mass = 1000.0", "mas = 1000.0"),
        ("mass = 1000.0", "mass = -1.0"),
        ("mass = 1000.0", 'mass = "heavy"'),
        ('base = "bonded"', 'base = "glued"'),
        ('laws = ["all"]', 'laws = ["cubc"]'),
    ],
)
def test_schema_and_scene_refuse_the_same(given, wrong):
    text = starter_scene().replace(given, wrong, 1)
    with pytest.raises(fastjsonschema.JsonSchemaValueException):
        fastjsonschema.compile(scene_schema())(tomllib.loads(text))
    with pytest.raises(SceneError):
        parse_scene(text)


def test_new_scene_names_the_schema_that_lies_next_to_it(call, tmp_path):
    assert call("new", tmp_path)[0] == 0
    first, _ = (tmp_path / "scene.toml").read_text().split("\n", 1)
    assert first == "#:schema ./scene.schema.json"
    assert json.loads((tmp_path / "scene.schema.json").read_text()) == json.loads(call("schema")[1])


# log and profile


def test_log_has_stages_and_files(call, tmp_path):
    code, output, log = call("roll", SMALL, "--engine", "formula", "--out", tmp_path, "--verbose")
    assert code == 0
    assert "resistance/load" in output
    assert re.search(r"^ +\d+\.\d\d s  stages: contact by formula$", log, re.MULTILINE)
    assert re.search(r"s  files: .*contact\.json written$", log, re.MULTILINE)
    assert not logging.getLogger("compact").handlers


def test_profile_has_every_stage_and_adds_up(call, tmp_path):
    _, _, table = call("roll", SMALL, "--engine", "formula", "--out", tmp_path, "--profile")
    rows = re.findall(r"^(\w[\w ]*?) {2,}(\d*) +([\d.]+) +([\d.]+) +(\d+)%$", table, re.MULTILINE)
    times = {name: float(wall) for name, _, wall, *_ in rows}
    assert times.keys() == {"start", "contact by formula", "tables and figures", "total"}
    assert times.pop("total") == pytest.approx(sum(times.values()), abs=0.03)
