"""Quantity held constant over speed, formulas for one contact, guide friction and return stroke."""

from dataclasses import replace

import numpy as np
import pytest

from compact.analysis import contact_cases
from compact.analysis.study import Study
from compact.engines.interface import Case
from compact.report import text
from compact.report import writer as report
from compact.report.tables import format_column
from compact.scene.loader import load_scene

PLAIN = {"machine.roller_condition": "frictionless", "machine.gap_geometry": "circle", "accuracy.engine": "spectral"}
LIFT = {"accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "mix.overrides.heckel_slope": 1.65e-5}


def study(**changes):
    return Study(load_scene("small", **changes))


def values(study, name):
    return np.array([getattr(contact, name) for contact in study.stages.contacts.records])


# quantity held constant over speed


def test_height_is_held_at_every_speed_by_default():
    case = study(**PLAIN)
    depths, pressures = values(case, "indentation"), values(case, "peak_pressure")
    mean = [contact.speed for contact in case.stages.contacts.records].index(case.scene.mean_speed)
    assert case.stages.contacts.held.name == "height"
    assert depths == pytest.approx(case.stages.contacts.held.value, rel=1e-9)
    assert pressures[mean] == pytest.approx(case.stages.contacts.mix.required_pressure, rel=1e-6)
    assert np.all(np.diff(pressures) > 0)  # a stiffer layer at higher speed presses harder at the same height


@pytest.mark.parametrize(
    ("held", "name"), [("load", "load"), ("peak_pressure", "peak_pressure"), ("height", "indentation")]
)
def test_quantity_named_in_the_scene_is_held(held, name):
    case = study(**PLAIN, **{"contact.held": held})
    kept = values(case, name)
    assert kept == pytest.approx(kept[0], rel=1e-6)
    others = {"load", "peak_pressure", "indentation"} - {name}
    assert all(np.ptp(values(case, other)) > 0.02 * values(case, other)[0] for other in others)


@pytest.mark.parametrize(
    ("given", "name"), [({"contact.load": 9740.0}, "load"), ({"contact.peak_pressure": 1.5e5}, "peak_pressure")]
)
def test_prescribed_load_or_pressure_is_held_unless_the_scene_prescribes_height(given, name):
    case, at_height = study(**PLAIN, **given), study(**PLAIN, **given, **{"contact.held": "height"})
    (target,) = given.values()
    target /= case.scene.machine.roller_length if name == "load" else 1.0
    assert values(case, name) == pytest.approx(target, rel=1e-6)
    assert (case.stages.contacts.held.name, at_height.stages.contacts.held.name) == (name, "height")
    assert np.ptp(values(at_height, "indentation")) < 1e-9
    at_mean = [c for c in at_height.stages.contacts.records if c.speed == at_height.scene.mean_speed]
    assert getattr(at_mean[0], name) == pytest.approx(target, rel=1e-6)


def test_columns_hold_the_height_that_gives_the_density_at_the_mean_speed():
    case = study(**{"accuracy.engine": "column"})
    assert np.ptp(values(case, "indentation")) == 0
    densities = dict(zip(values(case, "speed"), values(case, "exit_density_ratio"), strict=True))
    assert densities[case.scene.mean_speed] == pytest.approx(0.98, abs=1e-9)
    assert values(case, "load")[-1] > 1.02 * values(case, "load")[0]  # rate effect at constant height


@pytest.mark.parametrize(
    "engine", ["column", "spectral", *(pytest.param(name, marks=pytest.mark.slow) for name in ("fem", "compaction"))]
)
def test_stated_height_is_that_of_every_contact_map_and_added_mass(engine, tmp_path):
    """Contacts, resistance map and added mass are those of rollers that prescribe the stated height themselves."""
    changes = {
        "column": {}, "spectral": PLAIN, "fem": {"accuracy.tolerance": 0.05},
        "compaction": LIFT | {"accuracy.tolerance": 0.02},
    }[engine]  # fmt: skip
    case = study(**changes | {"accuracy.engine": engine, "motion.laws": ["cubic"], "output.items": []})
    summary = report.write_study(case, tmp_path / "out")
    depth = summary["held"]["indentation"]["value"]
    assert f"{format_column([depth], 'm', 3)[0]} deep" in text.say("held", case)
    depths = np.array([contact["indentation"]["value"] for contact in summary["contacts"]])
    assert depths == pytest.approx(depth, rel=1e-9)

    speed, name = 0.63 * case.stages.resistance.largest_speed, case.stages.contacts.engine.name
    layer, roller, material = contact_cases.contact_inputs(
        case.scene, case.stages.contacts.mix, name, case.scene.mean_speed
    )
    roller = replace(roller, indentation=depth, load=None, peak_pressure=None)
    tolerance = case.scene.accuracy.tolerance
    own = Case(layer=layer, roller=roller, material=material, speed=speed, tolerance=tolerance)
    rolled = case.stages.contacts.engine.contact(own)
    length = case.scene.machine.rollers * case.scene.machine.roller_length
    tolerance = 2 * case.scene.accuracy.tolerance
    assert case.stages.resistance.resistance(speed) == pytest.approx(length * rolled.resistance, rel=tolerance)
    expected = case.stages.contacts.engine.expand(
        replace(own, speed=float(case.stages.resistance.resistance.speeds[-1]), tolerance=None)
    )
    if expected is not None:
        assert case.stages.resistance.resistance.added_masses[-1] == pytest.approx(
            length * expected.added_mass, rel=tolerance
        )
    if name == "compaction":
        assert len(case.stages.resistance.map.contacts) == 2


# one contact by formula


@pytest.mark.parametrize("prescribed", [{}, {"contact.load": 9740.0}, {"contact.peak_pressure": 1.5e5}])
def test_contact_by_formula_equals_the_engineering_summary(prescribed):
    case = study(**prescribed)
    (rolled,) = case.stages.contacts.passes_at(case.scene.mean_speed)
    length, formulas = case.scene.machine.roller_length, case.stages.contacts.engineering
    assert rolled.load * length == pytest.approx(formulas.roller_force, rel=1e-12)
    assert rolled.resistance * length == pytest.approx(formulas.roller_resistance, rel=1e-12)
    assert rolled.contact_length == pytest.approx(formulas.contact_length, rel=1e-12)
    if "contact.load" in prescribed:
        assert formulas.roller_force == pytest.approx(9740, rel=1e-12)
    if "contact.peak_pressure" in prescribed:
        assert rolled.peak_pressure == formulas.pressure == 1.5e5


# guide friction and return stroke


def test_drive_uses_the_guide_friction_of_the_scene_and_not_eq_1_9():
    case = study()
    net_force = 2 * case.stages.contacts.roller_load - case.scene.machine.weight
    assert float(case.stages.resistance.steady.guide_friction[0]) == pytest.approx(0.008 * net_force, rel=1e-9)
    run = case.stages.drive.runs["cubic"]
    assert float(case.stages.resistance.steady.drive_force[0]) == pytest.approx(run.steady_force, rel=1e-12)
    rollers = 2 * case.stages.contacts.engineering.roller_resistance
    assert case.stages.contacts.engineering.cart_resistance - rollers == pytest.approx(
        case.stages.contacts.engineering.guide_coefficient * net_force
    )
    assert "guide_friction 0.008" in text.say("guides", case)


def test_return_stroke_over_compacted_mix_halves_the_work_of_compaction():
    columns = {"accuracy.engine": "column", "mix.overrides.rate_sensitivity": 0.0, "drive.turn": "step"}
    fresh, compacted = study(**columns), study(**columns, **{"layer.return_stroke": "compacted"})
    load, _ = fresh.stages.contacts.second_pass
    stroke, friction, weight = 0.4, 0.008, fresh.scene.machine.weight
    there = abs(2 * fresh.stages.contacts.roller_load - weight)
    back = abs(2 * load * fresh.stages.contacts.roller_load - weight)
    mix = (
        float(fresh.stages.resistance.resistance(0.1, 0.0)) * stroke
    )  # without rate effect the resistance is independent of speed
    assert fresh.stages.drive.runs["cubic"].energy == pytest.approx(2 * mix + 2 * friction * there * stroke, rel=1e-6)
    energy = compacted.stages.drive.runs["cubic"].energy
    assert energy == pytest.approx(mix + friction * (there + back) * stroke, rel=1e-3)  # guide reactions of one sign
