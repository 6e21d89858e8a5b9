"""Pore air of a scene: its curve, load, resistance, map, summary, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from compact.analysis.pore_air import AirCurve, CoupledSample
from compact.analysis.stages.ensemble import Change
from compact.analysis.study import Study
from compact.report import text
from compact.report.tables import format_percent
from compact.report.writer import study_summary
from compact.scene.loader import load_scene
from compact.sweep.run import headline

LIFT = {
    "accuracy.engine": "column", "layer.lift_thickness": 0.06, "layer.fed_density_ratio": 0.936, "output.items": (),
    "mix.overrides.heckel_slope": 1.487e-5,
}  # fmt: skip
RATIOS = np.geomspace(1e9, 1e17, 25)


def lift(**changes):
    return load_scene("loveikin-2015", **LIFT | changes)


@pytest.fixture(scope="module")
def drained():
    return Study(lift())


@pytest.fixture(scope="module")
def one_way():
    return Study(lift(**{"mix.pore_air": "one-way"}))


@pytest.fixture
def curve():
    """Load that grows to the undrained 1000 N/m, over 500 N/m of skeleton."""
    loads = 1000 * RATIOS / (RATIOS + 1e13)
    return AirCurve(500.0, 50.0, tuple(RATIOS), tuple(loads), tuple(loads / 10), tuple(loads))


def test_curve_interpolates_over_the_ratio_and_is_proportional_below(curve):
    for ratio in (3e9, 1e12, 2.5e13, 4e16):
        assert curve.at(ratio * 1e-13, 1e-13).load == pytest.approx(1000 * ratio / (ratio + 1e13), rel=3e-3)
    assert curve.at(1e-6, 1e-13).load == pytest.approx(curve.at(1e-5, 1e-13).load / 10)
    assert curve.at(-0.2, 1e-13).load == curve.at(0.2, 1e-13).load
    assert curve.at(1e9, 1e-13).load == pytest.approx(1000, rel=1e-3)


def test_deaeration_speed_is_proportional_to_the_permeability(curve):
    speed = 1e-13 * 1e13 / 19  # 50 of 1000 N/m
    assert curve.deaeration_speed(1e-13) == pytest.approx(speed, rel=3e-3)
    assert curve.deaeration_speed(1e-12) == pytest.approx(10 * speed, rel=3e-3)
    assert curve.deaeration_speed(1e-13, share=3.0) is None


def test_coupled_contacts_correct_the_curve(curve):
    corrected = replace(curve, coupled=(CoupledSample(1e12, 2.0, 4.0), CoupledSample(1e14, 3.0, 8.0)))
    alone, coupled = curve.at(1.0, 1e-13), corrected.at(1.0, 1e-13)  # half-way between both samples
    assert coupled.load == pytest.approx(2.5 * alone.load)
    assert coupled.resistance == pytest.approx(6.0 * alone.resistance)
    assert corrected.at(1e-4, 1e-13).load == pytest.approx(2.0 * curve.at(1e-4, 1e-13).load)


def test_drained_mix_has_no_air_in_its_forces_but_a_deaeration_speed(drained):
    assert {each.air_load for each in drained.stages.contacts.records} == {None}
    value, low, high = drained.pore_air.deaeration_speeds
    assert low == pytest.approx(value / 10)
    assert high == pytest.approx(value * 10)
    content = study_summary(drained, [])["pore_air"]
    assert content["model"] == "drained"
    assert content["deaeration_speed"] == {"value": value, "unit": "m/s", "low": low, "high": high}
    said = text.say("air", drained)
    assert "it adds a tenth of the load at" in said
    # the band ends where no air escapes
    names = "load", "resistance", "undrained_load", "undrained_resistance"
    shares = {name: content[f"{name}_share"]["value"] for name in names}
    assert shares["undrained_load"] > shares["load"] > 0
    assert shares["undrained_resistance"] > shares["resistance"] > 0
    assert f"undrained {format_percent(shares['undrained_load'])}" in said


def test_air_increases_load_and_resistance_with_the_speed(drained, one_way):
    for without, with_air in zip(drained.stages.contacts.records, one_way.stages.contacts.records, strict=True):
        assert with_air.load == pytest.approx(without.load + with_air.air_load)
        assert with_air.resistance == pytest.approx(without.resistance + with_air.air_resistance)
        assert with_air.coefficient == pytest.approx(with_air.resistance / with_air.load)
    assert np.all(np.diff([each.load for each in one_way.stages.contacts.records]) > 0)


def test_map_has_the_resistance_of_the_contacts(one_way):
    forces = one_way.stages.resistance.map(np.array([each.speed for each in one_way.stages.contacts.records]))
    machine = one_way.scene.machine
    expected = [machine.rollers * machine.roller_length * each.resistance for each in one_way.stages.contacts.records]
    np.testing.assert_allclose(forces, expected, rtol=2e-3)
    assert one_way.stages.contacts.roller_load == pytest.approx(
        machine.roller_length * one_way.stages.contacts.records[4].load, rel=1e-9
    )


def test_point_of_a_sweep_contains_the_air(drained, one_way):
    without = headline(False, lift(), Change("own"))
    found = headline(False, lift(**{"mix.pore_air": "one-way", "mix.overrides.air_permeability": 1e-13}), Change("air"))
    machine = one_way.scene.machine
    at_mean = one_way.stages.contacts.records[4]
    assert found["load"] == pytest.approx(machine.roller_length * at_mean.load, rel=2e-3)
    assert without["load"] == pytest.approx(machine.roller_length * drained.stages.contacts.records[4].load, rel=1e-6)


def test_mix_that_is_occluded_as_fed_is_refused_with_the_bound():
    scene = lift(**{"mix.pore_air": "one-way", "mix.overrides.occlusion_saturation": 0.75})
    with pytest.raises(ValueError, match="must exceed the saturation of the fed mix"):
        Study(scene).stages.contacts.records  # noqa: B018
    dry = Study(lift(**{"mix.overrides.occlusion_saturation": 0.75}))
    assert dry.pore_air is None
    assert "occluded" in text.say("air", dry)


@pytest.mark.slow
def test_finite_elements_have_the_field_of_the_air_and_the_coupled_forces():
    changes = {
        "accuracy.engine": "compaction", "mix.overrides.air_permeability": 1e-12, "contact.speeds": (0.1,),
        "contact.indentation": 0.003, "motion.duration": 4.0, "mix.pore_air": "coupled",
    }  # fmt: skip
    study = Study(lift(**changes))
    (record,), (_, first) = study.stages.contacts.records, study.stages.contacts.first_passes[0]
    alone = replace(study.stages.contacts.air_curve, coupled=()).at(0.1, 1e-12)
    assert 0.002 < alone.load / first.load < 0.1
    assert record.air_resistance > 1.5 * alone.resistance
    assert record.load == pytest.approx(first.load + record.air_load)
    contacts = study.stages.contacts
    mesh = contacts.field_mesh(contacts.first_passes[0][1])
    (pressure,) = mesh.cell_data["air_pressure"]
    assert len(pressure) == len(mesh.cells[0].data)
    assert alone.excess_behind < 1.2 * pressure.max() < 101325
    assert "air_pressure" not in study.stages.contacts.engine.fields(first).cell_data
    assert len(study_summary(study, [])["pore_air"]["coupled"]) == 1
