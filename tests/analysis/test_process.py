"""Forming process of a scene: printed forces for comparison, balances, remarks, and the files of the command."""

import json
from pathlib import Path

import numpy as np
import pytest
from lift_sequences import sequence

from compact.analysis import process
from compact.analysis.process import ProcessStudy
from compact.cli import program as cli
from compact.scene.loader import load_scene
from compact.verification.formulas import MOVING_FORCE, ROLLER_REACTION

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
SCENE = SCENES / "process.toml"
SHORT = {"machine.roller_length": 0.3, "process.layers": 2}  # 19 strokes
AT_REST = {
    "process.mould_speed": 0.0,
    "process.strokes": 3,
    "process.product_density_ratio": None,
    "process.gap": 0.002,
}


@pytest.fixture(scope="module")
def study():
    return ProcessStudy(load_scene(SCENE, **SHORT))


def test_columns_are_below_the_printed_forces(study):
    """The load and the force of the published machine, of which columns are a lower estimate."""
    assert study.load == study.row.load < ROLLER_REACTION == 9740.0
    assert sum(part.force for part in study.parts if part.force is not None) < MOVING_FORCE == 3562.0


def test_parts_of_the_force_are_separate(study):
    confined, shear, sleeves, guides = study.parts
    assert confined.force == pytest.approx(2 * study.row.resistance)
    assert shear.force is None
    assert sleeves.force == study.sleeve_drag > 0
    assert guides.force == pytest.approx(0.008 * abs(2 * study.row.load - 10e3), rel=0.2)
    # the strips of neighbouring rollers overlap, and the overlap is pressed twice
    assert confined.work == pytest.approx(
        study.row.resistance * 0.4 / (0.4 - 0.012) / (study.problem.machine.advance * study.row.product_height),
        rel=1e-9,
    )
    without = ProcessStudy(load_scene(SCENE, **SHORT, sleeve=None))
    assert without.sleeve_drag is None
    assert without.parts[2].force is None
    assert without.parts[0] == confined


def test_masses_close(study):
    masses = study.mix_balance
    assert masses["product"] == pytest.approx(masses["fill"] + masses["fed"], rel=1e-9)


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


@pytest.mark.slow
def test_lumped_lifts_enter_forces_files_and_words(monkeypatch, tmp_path, capsys):
    calls = []

    def lifts(problem, friction, rate_factor, density_ratio, *, thickness, increments, air, report):
        calls.append((thickness, increments))
        report("lift 1")
        load, work = (lambda k: 2e3 * np.exp(8 * (k - 0.75))), (lambda k: 1e5 * np.exp(10 * (k - 0.75)))
        return sequence(thickness, increments, load=load, work=work, stopped="not steady")

    monkeypatch.setattr(process, "simulate_lifts", lifts)
    found = ProcessStudy(load_scene(SCENE, **SHORT), "deep")
    shear = found.parts[1]
    assert shear.force == pytest.approx(2 * (found.resistance - found.row.resistance))
    with_air = ProcessStudy(load_scene(SCENE, **SHORT, **{"mix.pore_air": "one-way"}), "quick")
    assert with_air.parts[2][:2] == ("pore air (two dimensions)", 2 * with_air.row.estimate("air_resistance").value)
    assert with_air.load == with_air.row.estimate("load").value + with_air.row.estimate("air_load").value
    del calls[5:]
    assert [increments for _, increments in calls] == [6, 6, 6, 9, 12]
    assert [thickness / found.problem.machine.max_bite for thickness, _ in calls] == pytest.approx(
        [0.75, 0.9, 0.6, 0.75, 0.75]
    )
    assert found.load == found.row.estimate("load").value
    assert any(remark.startswith("the top 10 mm of the product exceed") for remark in found.remarks)
    assert any(remark.endswith("extrapolated beyond the densest lift") for remark in found.remarks)
    assert found.remarks[-1] == "a sequence of lifts ends early: not steady"
    options = [part for key, value in SHORT.items() for part in ("--set", f"{key}={value}")]
    assert cli._exit_code(["process", str(SCENE), "--quick", "--out", str(tmp_path / "out"), *options]) == 0
    assert "one roller, two dimensions" in capsys.readouterr().out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"lifts.csv", "lifts.png"} <= names
    summary = json.loads((tmp_path / "out" / "process.json").read_text())["two_dimensions"]
    assert summary["load"]["error"] == pytest.approx(0.01, rel=1e-3)
    assert summary["air_load"]["value"] > 0
    assert not summary["air_is_counted"]
    assert summary["sequences"][0]["lifts"] == 11
