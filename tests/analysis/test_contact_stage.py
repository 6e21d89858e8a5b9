"""Contacts of a scene: published cases, targets, speeds, reuse of neighbouring contacts, refusals."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from compact.analysis import contact_cases
from compact.analysis.study import Study
from compact.engines.column.engine import simulate_oedometer
from compact.engines.spectral import engine as spectral
from compact.material.laws import Viscoelastic
from compact.report import writer as report
from compact.rolling_contact import Contact, Layer, Ply, Roller
from compact.scene.loader import load_scene

SMALL = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "small.toml"
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
PARABOLA = {"machine.roller_condition": "frictionless", "machine.gap_geometry": "parabola"}


def study(**changes):
    return Study(load_scene(SMALL, **changes))


def test_a_scaled_fit_states_its_origin():
    mix = contact_cases.scene_mix(load_scene(SMALL, **{"mix.moisture": 0.09}))
    found = mix.parameter("effective_modulus")
    assert found.value == pytest.approx(1364535.2 * mix.relaxed_modulus / 0.75e6, rel=1e-12)
    assert (found.flag, found.origin) == (
        "calibrated", "fitted at another moisture or density ratio, scaled by the prior",
    )  # fmt: skip
    assert contact_cases.scene_mix(load_scene(SMALL)).parameter("effective_modulus").flag == "given"


@pytest.mark.parametrize("engine", ["column", "compaction"])
@pytest.mark.parametrize("law", ["ellipse", "drucker-prager-cap"])
def test_every_law_of_compaction_has_the_saturation_limit_of_the_scene(law, engine):
    scene = load_scene(SMALL, **{"mix.law": law, "accuracy.engine": engine})
    limits = []
    for changed in (scene, scene.replaced(**{"mix.overrides.saturation_limit": 0.995})):
        _, _, material = contact_cases.contact_inputs(changed, contact_cases.scene_mix(changed), engine, 0.1)
        limits.append(material.saturation_limit)
    assert limits == [0.998, 0.995]


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


def test_default_target_is_the_pressure_required_by_the_mix():
    case = study(**{"machine.roller_condition": "frictionless", "machine.gap_geometry": "parabola"})
    rolled = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.1, "spectral")
    assert rolled.peak_pressure == pytest.approx(case.stages.contacts.mix.required_pressure, rel=1e-6)


@pytest.mark.slow
def test_engine_satisfies_the_tolerance_of_the_scene():
    coarse, fine = (study(**CASE_G, **{"accuracy.engine": "fem", "accuracy.tolerance": t}) for t in (1e-2, 1e-3))
    rough, close = (contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.3) for case in (coarse, fine))
    assert close.forces.shape[1] > rough.forces.shape[1]  # more nodes on the surface
    assert abs(close.resistance / 392.888 - 1) < 1e-3  # contact.md g, digits of the spectral engine
    assert abs(rough.resistance / 392.888 - 1) < 1e-2


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


def test_speeds_are_those_of_the_scene_or_span_the_motion():
    assert contact_cases.contact_speeds(study(**{"contact.speeds": [0.1, 0.2]}).scene) == (0.1, 0.2)
    found = np.array(contact_cases.contact_speeds(study().scene))
    assert len(found) >= 5
    assert (found[0], found[-1]) == pytest.approx((0.4 / 3 / 16, 0.4 / 3 * 2))
    assert study().scene.mean_speed in found


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


@pytest.mark.slow
def test_fields_are_written_as_a_series_over_the_speeds(tmp_path):
    import meshio

    speeds = (0.03, 0.3)
    wanted = {"contact.speeds": speeds, "output.items": ["fields", "figures"], "motion.laws": ["cubic"]}
    case = study(**CASE_G, **wanted, **{"accuracy.engine": "fem"})
    summary = report.write_study(case, tmp_path / "out")
    added = len(summary["drive_resistance"]["speeds"]) - 1  # no law is as fast as the other speed
    assert summary["evaluation_counts"] == {
        "contact": 1, "rolled": 2, "fields": 2, "laws": 1, "runs": 2, "rankings": 1, "figures": 8, "comparison": 1,
        "resistance": added, "added mass": added + 1,
    }  # fmt: skip
    members = ElementTree.parse(tmp_path / "out" / "fields.pvd").getroot().iter("DataSet")
    series = {float(member.get("timestep")): member.get("file") for member in members}
    assert tuple(series) == speeds
    assert {*series.values(), "fields.pvd", "fields.png"} <= set(summary["files"])
    for speed, rolled in case.stages.contacts.first_passes:
        layer = meshio.read(tmp_path / "out" / series[speed])
        assert set(layer.point_data) | set(layer.cell_data) == {"displacement", "stress", "pressure", "dissipation"}
        corners = layer.points[layer.cells[0].data[:, :4]]
        area = np.ptp(corners[:, :, 0], axis=1) * np.ptp(corners[:, :, 1], axis=1)
        assert area @ layer.cell_data["dissipation"][0] / speed == pytest.approx(rolled.resistance, rel=1e-2)


@pytest.mark.parametrize(("sensitivity", "count"), [(0.0, 1), (0.02, 3)])
def test_compaction_continues_from_the_previous_speed_under_a_rate_effect(monkeypatch, sensitivity, count):
    starts = []

    def rolled(layer, roller, material, speed, start=None):
        starts.append(start)
        line = np.zeros(3)
        values = {"load": 1e4, "resistance": 2e3, "leading": 0.03, "trailing": -0.01, "indentation": 0.003}
        values |= {"layer": layer, "roller": roller, "material": material, "speed": speed}
        return Contact(**values, x=line, pressure=line, shear_traction=line)

    monkeypatch.setattr("compact.engines.compaction.engine.roll", rolled)
    given = {"contact.indentation": 0.003, "contact.speeds": [0.05, 0.1, 0.2]}
    given |= {"accuracy.engine": "compaction", "mix.overrides.rate_sensitivity": sensitivity}
    passed = study(**given).stages.contacts.passes
    assert [rolled.speed for _, (rolled,) in passed] == [0.05, 0.1, 0.2]
    assert starts == [None, *(rolled for _, (rolled,) in passed)][:count]
    back = contact_cases.roll_scene(
        study(**given).scene, study(**given).stages.contacts.mix, -0.1, "compaction", initial_guess=passed[0][1][0]
    )
    assert (back.speed, starts[-1]) == (-0.1, None)  # the opposite direction is no initial guess
    other = study(**given, **{"mix.overrides.heckel_slope": 14e-6})
    contact_cases.roll_scene(other.scene, other.stages.contacts.mix, 0.1, "compaction", initial_guess=passed[0][1][0])
    assert starts[-1] is passed[0][1][0]  # another mix: initial guess, not the result


def test_initial_guess_supplies_the_layer_where_elastic_recovery_depends_on_speed(monkeypatch):
    """The fed height follows from the product height by elastic recovery; a layer of another height stays its own."""
    calls = []

    def rolled(layer, roller, material, speed, start=None, exit_density_ratio=None):
        calls.append((layer, start, exit_density_ratio))
        values = {"load": 1e4, "resistance": 2e3, "leading": 0.03, "trailing": -0.01, "indentation": 0.003}
        line = np.zeros(3)
        return Contact(**values, layer=layer, speed=speed, x=line, pressure=line, shear_traction=line)

    monkeypatch.setattr("compact.engines.compaction.engine.roll", rolled)
    given = {"mix.overrides.rate_sensitivity": 0.02}
    case = study(**given)
    last = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.2, "compaction")
    assert contact_cases.contact_inputs(case.scene, case.stages.contacts.mix, "compaction", 0.05)[0] != last.layer
    contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.05, "compaction", initial_guess=last)
    assert calls[-1] == (last.layer, last, case.scene.mix.density_ratio)
    higher = study(**given, **{"product.height": 0.2201})
    contact_cases.roll_scene(higher.scene, higher.stages.contacts.mix, 0.05, "compaction", initial_guess=last)
    layer = contact_cases.contact_inputs(higher.scene, higher.stages.contacts.mix, "compaction", 0.05)[0]
    assert calls[-1] == (layer, last, case.scene.mix.density_ratio)  # which the engine stretches


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"accuracy.engine": "formula", "contact.peak_pressure": 1e-300}, "the roller does not touch the layer: load"),
        (
            {**PARABOLA, "accuracy.engine": "spectral", "contact.peak_pressure": 1e-300},
            "the roller does not touch the layer: `peak_pressure` 1e-300",
        ),
        (
            {**SHALLOW, "machine.roller_condition": "driven", "machine.roller_torque": 1e3},
            r"the roller skids: the torque is 10\.\d times the",
        ),
        (
            {**SHALLOW, **PARABOLA, "contact.indentation": None, "contact.load": 1e8},
            "reaches the base of a layer 0.22 m high",
        ),
    ],
    ids=["no contact by formula", "no contact by spectral", "skidding", "below the base"],
)
def test_failed_contact_states_scene_engine_and_speed(changes, words):
    case = study(**changes, unusual=[f"contact.{target}" for target in ("indentation", "load", "peak_pressure")])
    with pytest.raises(RuntimeError, match=rf"^Small: .*, {case.scene.accuracy.engine} at 0\.1 m/s: .*{words}"):
        contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.1)


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


def test_prescribed_load_acts_on_a_layer_of_the_nominal_height():
    case = study(**{"accuracy.engine": "column", "contact": {"load": 9740.0}})
    rolled = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.2)
    assert rolled.load * case.scene.machine.roller_length == pytest.approx(9740, rel=1e-9)
    layer, *_ = contact_cases.contact_inputs(case.scene, case.stages.contacts.mix, "column", 0.2)
    assert layer.height == pytest.approx(0.22 * 0.98 / 0.94)


@pytest.mark.parametrize("name", ["column", "spectral", pytest.param("fem", marks=pytest.mark.slow)])
@pytest.mark.parametrize("ratio", [1.5, 5.0])
def test_every_contact_of_a_scene_has_an_error_estimate(name, ratio):
    case = study(**{"accuracy.engine": name, "layer.lift_thickness": 0.06, "mix.overrides.instant_over_relaxed": ratio})
    load, resistance = contact_cases.roll_scene(case.scene, case.stages.contacts.mix, 0.033).error
    assert 0 < load <= case.scene.accuracy.tolerance
    assert 0 < resistance <= case.scene.accuracy.tolerance
