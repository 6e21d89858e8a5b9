"""Drive of another package by an entry point: a tiny installed distribution."""

import json
import sys

import pytest
from entry_points import install

import compact
from compact.machine.drives import DRIVES
from compact.scene.loader import scene_schema

SMALL = "compact/data/scenes/small.toml"
PACKAGE = '''
"""Cart pulled by a rope: its pulleys take a tenth of the force, whatever the speed."""

from dataclasses import dataclass

from compact import Drive
from compact.machine.rigid_drive import Rigid, Run, solved


@dataclass(frozen=True)
class WinchRun(Run):
    @property
    def rope_force(self):
        return self.peak_force / 0.9


class Rope(Rigid):
    def run(self, cart, cycle, resistance, working):
        return solved(WinchRun(cart, cycle, resistance, working, self))


class Winch(Drive):
    name, table = "winch", ("winch", "law=name rope_force_N work_J=energy")
    keys = {"drive.stiffness": "that of its rope in N/m"}
    refused = {"drive.end_springs": "slackens its rope"}

    def make(self, scene, cycle):
        return Rope()

    def variants(self, scene):
        yield "rope / 2", {"drive.stiffness": scene.drive.stiffness / 2}


WINCH = Winch()
'''
GIVEN = {
    "drive.kind": "winch", "drive.stiffness": 1e5, "output.items": ["tables", "report"],
    "motion.laws": ["cubic", "crank"],
}  # fmt: skip
SPRINGS = {"drive.end_springs": {"stiffness": 1e3, "preload": 10.0, "length": 0.05}}


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install a distribution with one drive, and one faulty entry point, in a folder of the path."""
    install(tmp_path, "winch_drive", PACKAGE, "compact.drives", winch="WINCH", broken="Rope")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("winch_drive", None)


@pytest.mark.slow
def test_drive_of_another_package_is_run_compared_and_reported(installed, monkeypatch, tmp_path):
    monkeypatch.setattr("compact.analysis.stages.uncertainty.SAMPLES", 64)
    assert scene_schema()["definitions"]["Drive"]["properties"]["kind"]["enum"] == [*DRIVES]
    scene = compact.load_scene(SMALL, **GIVEN, **{"accuracy.engine": "formula", "compare": {"column": {}}})
    study, rigid = scene.run(tmp_path / "out"), scene.replaced(**{"drive.kind": "rigid", "drive.stiffness": None})
    assert [place.value for place in scene.rank()] == [place.value for place in rigid.rank()]
    rows = (tmp_path / "out" / "winch.csv").read_text().splitlines()
    assert rows[0] == "law,rope_force_N,work_J"
    forces = {law: float(force) for law, force, _ in (row.split(",") for row in rows[1:])}
    assert forces == pytest.approx({name: run.peak_force / 0.9 for name, run in study.stages.drive.runs.items()})
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert set(summary["comparison"]["column"]["rankings"]) == {"winch"}
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "winch drive" in page
    assert "rope / 2" in page


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"drive.stiffness": None},
            'drive.stiffness: is missing, and drive.kind is "winch"; give that of its rope in N/m',
        ),
        ({"drive.damping": 1.0}, 'drive.damping: is for drive.kind = "elastic", got it with "winch"'),
        (SPRINGS, 'drive.end_springs: is not for drive.kind = "winch", which slackens its rope; take it out'),
    ],
)
def test_keys_of_a_drive_of_another_package_are_refused(installed, changes, words):
    with pytest.raises(compact.SceneError, match=words):
        compact.load_scene(SMALL, **GIVEN | changes)


def test_faulty_or_absent_entry_point_is_named(installed):
    with pytest.raises(ValueError, match=r"the entry point broken of the group compact.drives must be of class Drive"):
        DRIVES["broken"]
    with pytest.raises(compact.SceneError, match=r"drive.kind: must be 'rigid', .* got 'winsh'"):
        compact.load_scene(SMALL, **{"drive.kind": "winsh"})
