"""Contacts of a scene: published cases, targets, speeds, reuse of neighbouring contacts, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from compact.analysis import contact_cases
from compact.analysis.study import Study
from compact.engines.column.engine import simulate_oedometer
from compact.engines.spectral import engine as spectral
from compact.material.laws import Viscoelastic
from compact.report import writer as report
from compact.rolling_contact import Layer, Ply, Roller
from compact.scene.loader import load_scene

# contact.md g: R .11 m, h .22 m bonded, E(t) = 10 + 10 exp(-t/tau) MPa, nu .3, depth 3 mm, frictionless, parabola
CASE_G = {
    "mix.overrides.effective_modulus": 10e6,
    "mix.overrides.poisson": 0.3,
    "mix.overrides.instant_over_relaxed": 2.0,
    "mix.overrides.relaxation_time": 0.1,
    "machine.roller_condition": "frictionless",
    "machine.gap_geometry": "parabola",
    "contact.indentation": 0.003,
}


SHALLOW = {"accuracy.engine": "fem", "contact.indentation": 0.003}


def study(**changes):
    return Study(load_scene("small", **changes))


def test_plies_of_a_scene_are_passed_to_the_engine():
    plies = [{"thickness": 0.2, "relative_modulus": 1.0}, {"thickness": 0.02, "relative_modulus": 20.0}]
    case = study(**CASE_G, **{"layer.plies": plies, "accuracy.engine": "spectral"})
    rolled = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.3)
    mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
    layer = Layer(0.22, plies=(Ply(thickness=0.2, stiffness=1.0), Ply(thickness=0.02, stiffness=20.0)))
    direct = spectral.roll(layer, Roller(0.11, indentation=0.003), mix, 0.3)
    assert (rolled.load, rolled.resistance) == pytest.approx((direct.load, direct.resistance), rel=1e-4)
    with pytest.raises(
        ValueError, match=r"the engine formula takes no `indentation` 0.003, as the depth of a contact on a half-plane"
    ):
        contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.3, "formula")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("rolling", "torque", "speed"),
    [("driven", 20.0, 0.1), ("driven", 20.0, -0.1), ("free", -20.0, 0.1)],
    ids=["motor", "motor on the return stroke", "bearings"],
)
def test_torque_of_the_scene_acts_on_the_whole_roller(rolling, torque, speed):
    free = study(**SHALLOW)
    turned = study(**SHALLOW, **{"machine.roller_condition": rolling, "machine.roller_torque": torque})
    rolled = contact_cases.roll_scene(turned.scene, turned.stages.contacts.mix, speed)
    pull = np.sign(speed) * torque / 1.164 / 0.11  # T/(L R)
    assert np.trapezoid(rolled.shear_traction, rolled.x) == pytest.approx(-pull, rel=2e-3)
    unloaded = contact_cases.roll_scene(free.scene, free.stages.contacts.mix, speed)
    assert rolled.resistance - unloaded.resistance == pytest.approx(-pull, rel=0.03)  # first order in the slope


def test_table_of_contacts_has_the_resistance_of_engine_and_formula(tmp_path):
    wanted = {"contact.speeds": [0.03, 0.3], "output.items": ["tables"]}
    case = study(**CASE_G, **wanted, **{"accuracy.engine": "spectral"})
    summary = report.write_study(case, tmp_path / "out")
    table = np.genfromtxt(tmp_path / "out" / "contact.csv", delimiter=",", names=True)
    assert table["load_Nm"] == pytest.approx([15386.4, 20455.8], rel=1e-5)
    assert table["resistance_Nm"] == pytest.approx([289.42, 392.89], rel=1e-4)
    assert table["formula_coefficient"] == pytest.approx(
        [case.stages.contacts.engineering.resistance_coefficient] * 2, rel=1e-11
    )
    assert summary["evaluation_counts"]["rolled"] == 2


@pytest.mark.parametrize(
    ("given", "height"), [({}, 0.22), ({"layer.lift_thickness": 0.06}, 0.06)], ids=["whole", "lift"]
)
def test_columns_give_the_height_and_density_of_the_product(given, height):
    case = study(**{"accuracy.engine": "column"}, **given)
    rolled = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.2)
    assert rolled.exit_height == pytest.approx(height, rel=1e-9 if not given else 1e-6)
    assert rolled.exit_density_ratio == pytest.approx(case.scene.mix.density_ratio, abs=1e-9 if not given else 1e-6)


def test_compaction_material_has_mohr_coulomb_strength_and_the_heckel_slope():
    case = study(**{"mix.overrides.friction_angle": 30.0, "mix.overrides.cohesion": 10e3})
    material = contact_cases.compaction_material(case.scene, case.stages.contacts.mix)
    assert material.critical_slope == pytest.approx(np.sqrt(3) / 2)
    assert material.tensile_strength == pytest.approx(10e3 * np.sqrt(3))
    stiff = replace(material, unloading_modulus=4e9, fed_density_ratio=0.9)  # negligible elastic strain
    pressure = np.array([130e3, 220e3])
    loosening = -np.log(1 - simulate_oedometer(stiff, pressure).density_ratio)
    assert np.diff(loosening) / np.diff(pressure) == pytest.approx(case.stages.contacts.mix.heckel_slope, rel=1e-3)


@pytest.mark.parametrize("name", ["column", "spectral", pytest.param("fem", marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", [1.5, 5.0])
def test_every_contact_of_a_scene_has_an_error_estimate(name, ratio):
    case = study(**{"accuracy.engine": name, "layer.lift_thickness": 0.06, "mix.overrides.instant_over_relaxed": ratio})
    load, resistance = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.033).error
    assert 0 < load <= case.scene.accuracy.tolerance
    assert 0 < resistance <= case.scene.accuracy.tolerance
