"""Laboratory tests of a mix: closed forms, balances between the tests, files and command."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from compact.analysis.contact_cases import compaction_material, scene_mix
from compact.analysis.material_tests import LaboratoryProgramme
from compact.cli import program as cli
from compact.engines.column.engine import simulate_oedometer
from compact.scene.loader import load_scene

SCENE = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "loveikin-2015.toml"
PRESSURE = 203e3
LAWS = ("ellipse", "drucker-prager-cap")


@pytest.fixture(scope="module", params=LAWS)
def programme(request):
    scene = load_scene("loveikin-2015", **{"mix.law": request.param})
    return LaboratoryProgramme(compaction_material(scene, scene_mix(scene)), 0.98, PRESSURE)


def test_oedometer_ends_at_its_pressure_and_at_zero(programme):
    test = programme.test("oedometer")
    assert test.axial_stress.max() == pytest.approx(PRESSURE, rel=1e-6)
    assert abs(test.axial_stress[-1]) < 0.02 * PRESSURE
    assert test.volume_strain == pytest.approx(test.axial_strain)
    assert programme.heckel_slope() == pytest.approx(programme.material.heckel_slope, rel=5e-3)


def test_oedometer_is_that_of_the_columns(programme):
    test = programme.test("oedometer")
    end = int(test.axial_stress.argmax())
    column = simulate_oedometer(programme.material, [test.axial_stress[end]])
    assert test.density_ratio[end] == pytest.approx(column.density_ratio[0], rel=2e-6)
    assert test.lateral_stress[end] == pytest.approx(column.lateral_stress[0], rel=2e-3)


def test_strength_of_the_shear_line_is_that_of_mohr_coulomb():
    """Unconfined strength 2 c cos(phi)/(1 - sin(phi)), pure shear at constant pressure c cos(phi) + p sin(phi)."""
    scene = load_scene("loveikin-2015", **{"mix.law": "drucker-prager-cap"})
    lab = LaboratoryProgramme(compaction_material(scene, scene_mix(scene)), 0.98, PRESSURE)
    angle, c = np.radians(35), 10e3
    for specimen in ("loose", "compacted"):
        strength = lab.test("unconfined", specimen).strength
        assert strength == pytest.approx(2 * c * np.cos(angle) / (1 - np.sin(angle)), rel=1e-6)
    shear = lab.test("pure shear", "compacted")
    in_plane = (shear.axial_stress[-1] + shear.lateral_stress[-1]) / 2
    assert shear.strength / 2 == pytest.approx(c * np.cos(angle) + in_plane * np.sin(angle), rel=1e-6)
    assert lab.earth_pressure_coefficient == pytest.approx(1 - np.sin(angle), abs=0.005)
    lateral = 0.125 * PRESSURE
    biaxial = lab.test("biaxial", "compacted")
    slope = (1 + np.sin(angle)) / (1 - np.sin(angle))
    expected = lateral * (slope - 1) + 2 * c * np.sqrt(slope)
    assert biaxial.strength == pytest.approx(expected, rel=1e-6)


def test_strength_of_the_flat_side_depends_on_the_density():
    """Plane strain at constant volume: s_1 - s_3 = 2 M a/sqrt(3), half of it cohesive."""
    scene = load_scene("loveikin-2015")
    material = compaction_material(scene, scene_mix(scene))
    lab = LaboratoryProgramme(material, 0.98, PRESSURE)
    for specimen, ratio in (("loose", material.fed_density_ratio), ("compacted", 0.98)):
        a = (float(material.yield_pressure(ratio)) + material.tensile_strength) / 2
        expected = 2 * material.critical_slope * a / np.sqrt(3)
        assert lab.test("unconfined", specimen).strength == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_command_writes_table_results_and_figure(law, tmp_path, monkeypatch, capsys):
    out = tmp_path / "lab"
    monkeypatch.setattr("sys.argv", ["compact", "material", str(SCENE), "--set", f"mix.law={law}", "--out", str(out)])
    with pytest.raises(SystemExit) as exit_code:
        cli.main()
    assert exit_code.value.code == 0
    assert f"law {law}; oedometer up to 203 kPa" in capsys.readouterr().out
    with (out / "material.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["test"] for row in rows} == {"oedometer", "isotropic", "biaxial", "pure shear", "unconfined"}
    summary = json.loads((out / "material.json").read_text())
    assert summary["law"] == law
    assert set(summary["specimens"]) == {"loose", "compacted"}
    assert (out / "material.png").stat().st_size > 20_000
