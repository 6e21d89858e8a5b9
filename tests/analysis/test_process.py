"""Forming process of a scene: printed forces for comparison, balances, remarks, and the files of the command."""

import json
from pathlib import Path

import numpy as np
import pytest

from compact.analysis.process import ProcessStudy
from compact.cli import program as cli
from compact.engines.process.forming import Closure
from compact.report.text import sentences
from compact.scene.loader import load_scene
from compact.verification.formulas import MOVING_FORCE, ROLLER_REACTION

SCENES = Path(__file__).parents[2] / "compact" / "data" / "scenes"
SCENE = SCENES / "process.toml"
SHORT = {"machine.roller_length": 0.3, "process.layers": 2}  # 19 strokes
OFFERED = {"process.product_density_ratio": None, "process.extrusion_pressure": 1e5}
AT_REST = {
    "process.mould_speed": 0.0,
    "process.strokes": 3,
    "process.product_density_ratio": None,
    "process.gap": 0.002,
}


@pytest.fixture(scope="module")
def study():
    return ProcessStudy(load_scene("process", **SHORT))


def test_columns_are_below_the_printed_forces(study):
    """The load and the force of the published machine, of which columns are a lower estimate."""
    assert study.load == study.row.load < ROLLER_REACTION == 9740.0
    assert sum(part.force for part in study.parts[:-1] if part.force is not None) < MOVING_FORCE == 3562.0


def test_parts_of_the_force_are_separate(study):
    confined, shear, sleeves, _, extruded, guides, _ = study.parts
    assert extruded.force == extruded.low == 0 < extruded.high  # a known density; at most all of the fill evades
    origins = ["computed", "computed", "assumed", "assumed", "estimated", "computed", "remainder"]
    assert [each.origin for each in study.parts] == origins
    assert confined.force == pytest.approx(2 * study.row.resistance)
    assert shear.force is None
    assert study.standing_drag > sleeves.force > 0  # with the plate
    assert guides.force == pytest.approx(0.008 * abs(2 * study.row.load - 10e3), rel=0.2)
    # the strips of neighbouring rollers overlap, and the overlap is pressed twice
    assert confined.work == pytest.approx(
        study.row.resistance * 0.4 / (0.4 - 0.012) / (study.problem.machine.advance * study.row.product_height),
        rel=1e-9,
    )
    bare = {"process.plate_length": None, "process.plate_pressure": None, "process.measured_force": None}
    without = ProcessStudy(load_scene("process", **SHORT, **bare, sleeve=None))
    assert without.parts[3].force is None
    assert without.parts[-1].cause == guides.cause
    assert without.standing_drag == 0
    assert without.parts[2].force is None
    assert without.parts[0] == confined


def test_every_force_has_a_spread_and_a_test_and_the_remainder_its_name(study):
    """Plate 0.2 m long under 20 kPa, 0.776 m wide: some 1.1 kN; of the printed 3562 N little is left."""
    plate, rest = study.parts[3], study.parts[-1]
    assert plate.force == pytest.approx(study.mix.steel_friction * 20e3 * 0.2 * 0.776)
    known = [each for each in study.parts[:-1] if each.force is not None]
    assert all(each.low <= each.force <= each.high and each.test for each in known)
    assert sum(each.force for each in known) + rest.force == pytest.approx(MOVING_FORCE)
    assert rest.cause == "not explained"
    assert rest.low < 0 < rest.high  # sleeves and plate are assumptions
    pulled = ProcessStudy(load_scene("process", **SHORT, **{"sleeve.measured_drag": 700.0})).parts[2]
    assert pulled[:2] == ("mix sheared in the feed sleeves", "measured")
    assert pulled.low == pulled.force == pulled.high == 700


def test_pressure_of_extrusion_is_that_of_the_wedge_by_default():
    study = ProcessStudy(load_scene("process", **SHORT, **{"process.product_density_ratio": None}))
    value, low, high = study.extrusion_pressures
    assert low < 0.5 * value < value < 203e3 < high  # the required pressure that is published lies within
    assert study.closure == Closure("extrusion_pressure", value)
    assert study.row.numbers["peak_pressure"] == pytest.approx(value, rel=1e-6)
    assert any(remark.startswith("mix evades along the axis at 9") for remark in sentences("process_remarks", study))
    assert study.parts[4].force > 0
    given = ProcessStudy(load_scene("process", **SHORT, **OFFERED))
    assert given.extrusion_pressures == (1e5, 1e5, 1e5)


def test_command_writes_results_of_a_mould_at_rest(tmp_path, capsys):
    changes = SHORT | {key: value for key, value in AT_REST.items() if value is not None}
    text = SCENE.read_text("utf-8").replace("product_density_ratio = 0.98          # -; published\nnip", "nip")
    scene = tmp_path / "still.toml"
    scene.write_text(text)
    options = [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]
    assert cli._exit_code(["process", str(scene), "--out", str(tmp_path / "out"), *options]) == 0
    digest = capsys.readouterr().out
    assert "the resistance is the confined floor and not for sizing" in digest
    assert "mix, height of its grains" in digest
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"process.json", "strokes.csv", "section.png", "fields.pvd", "fields", "scene.hash"}
    summary = json.loads((tmp_path / "out" / "process.json").read_text())
    assert summary["per_roller"]["confined_floor"] == {"value": 0.0, "unit": "N"}
    assert abs(summary["per_roller"]["mass_residual"]["value"]) < 1e-9
    rows = np.loadtxt(tmp_path / "out" / "strokes.csv", delimiter=",", skiprows=1)
    assert rows.shape == (3, 10)
    assert len(list((tmp_path / "out" / "fields").glob("strokes=*.vtu"))) == 3


def test_masses_close(study):
    masses = study.mix_balance
    assert masses["product"] == pytest.approx(masses["fill"] + masses["fed"], rel=1e-9)
