"""Engine "process": resistance of all strokes to the drives, its map, durations, return stroke, and kept results."""

import re

import numpy as np
import pytest
from lift_sequences import sequence

from compact.analysis import process
from compact.analysis.process import ProcessStudy
from compact.analysis.sizing.machine_sizing import machine_sizing
from compact.analysis.stages.drives import build_stages
from compact.analysis.stages.uncertainty import mix_spread
from compact.analysis.study import Study
from compact.engines.process.lifts import simulate_lifts
from compact.report import text
from compact.scene.loader import load_scene

SMALL = {
    "accuracy.engine": "process", "process.detail": "columns", "process.layers": 1, "machine.roller_length": 0.2,
    "process.product_density_ratio": 0.9, "mix.density_ratio": 0.9, "layer.fed_density_ratio": 0.8,
    "process.largest_grain": None,
    "motion.laws": ["cubic", "cycloidal", "modified-trapezoid"], "output.items": [],
}  # fmt: skip


def scene(**changes):
    return load_scene("process", **SMALL | changes)


@pytest.fixture(scope="module")
def study():
    return Study(scene())


def test_resistance_is_that_of_rollers_and_sleeves(study):
    found = study.stages.contacts.process
    assert found.standing_drag > 0
    at_mean = study.stages.resistance.map(study.scene.mean_speed)
    assert at_mean == pytest.approx(2 * found.resistance + found.standing_drag, rel=1e-6)
    assert study.stages.contacts.roller_load == pytest.approx(found.load, rel=1e-12)
    # the guide wheels are those of the cart, once
    total = study.stages.resistance.steady.drive_force[0]
    assert total == pytest.approx(at_mean + found.guide_friction, rel=1e-6)
    known = [part.force for part in found.parts if part.force is not None and part.origin != "remainder"]
    assert total == pytest.approx(sum(known), rel=1e-6)
    without = Study(scene(sleeve=None))
    plate = found.parts[3].force
    assert without.stages.resistance.map(study.scene.mean_speed) == pytest.approx(
        2 * found.resistance + plate, rel=1e-6
    )


def test_map_holds_at_speeds_without_a_contact(study):
    found, sampled = study.stages.contacts.process, study.stages.resistance.map
    for share in (0.05, 0.2, 0.7, 1.9):
        speed = share * study.scene.mean_speed
        expected = 2 * found.row_at(speed).estimate("resistance").value + found.standing_drag
        assert sampled(speed) == pytest.approx(expected, rel=1e-3)
        assert sampled(speed) == pytest.approx(expected, rel=max(sampled.error, 1e-6))


def test_floor_grows_with_the_duration(study):
    stage, longer = study.stages.resistance, 1.25 * study.scene.motion.duration
    other = stage.over(longer)
    assert stage.over(study.scene.motion.duration) is stage
    assert stage.over(longer) is other
    drag, speed = study.stages.contacts.process.standing_drag, other.scene.mean_speed
    floor = 2 * other.contacts.process.row.numbers["confined_floor"] + drag
    assert other.map(speed) == pytest.approx(floor, rel=2e-3)
    assert (other.map(speed) - drag) / (stage.map(speed) - drag) == pytest.approx(1.25, rel=0.02)
    assert study.stages.drive.over(longer).resistance is other


def test_feed_before_forward_strokes_alone_loads_them(study):
    forward_study = Study(scene(**{"process.feeds": "forward"}))
    forward, speed = forward_study.stages.contacts, forward_study.scene.mean_speed
    load, resistance = forward.return_ratios
    assert resistance == pytest.approx(0, abs=0.01)
    assert 0.05 < load < 0.5  # the elastic recovery alone
    record = forward.reference[0]
    length, row = forward.scene.machine.roller_length, forward.process.row
    mean = record.resistance * length * (1 + resistance) / 2
    assert mean == pytest.approx(row.resistance, rel=0.15)  # few strokes: their parity matters
    back, drag = -forward_study.stages.resistance.map(-speed), forward.process.standing_drag
    assert back == pytest.approx(2 * length * record.resistance * resistance + drag, rel=1e-3)
    assert forward_study.work_balance.pass_work == pytest.approx(
        (back + forward_study.stages.resistance.map(speed)) / 2 * 0.4 / forward.process.product_volume, rel=1e-9
    )
    assert study.stages.contacts.return_ratios == (1.0, 1.0)


def lifts(problem, friction, rate_factor, density_ratio, *, thickness, increments, air):
    return sequence(
        thickness, increments, load=lambda k: 2e3 * np.exp(8 * (k - 0.75)), work=lambda k: 1e5 * np.exp(10 * (k - 0.75))
    )


def beside(monkeypatch, detail, **changes):
    """Study of one pass by columns, with the forming process beside it."""
    monkeypatch.setattr(process, "simulate_lifts", lifts)
    own = {"accuracy.engine": "column", "layer.lift_thickness": 0.06, "process.detail": detail}
    return Study(scene(**own | changes))


def test_the_process_stands_beside_a_pass_and_the_larger_one_sizes(monkeypatch):
    """In two dimensions where asked for; with its own shares after a turn, and its own places of the laws."""
    found = beside(monkeypatch, "deep")
    own, other = found.models[0], found.comparison["process"]
    assert other.valid
    assert set(other.places[found.scene.motion.duration]) == set(own.places[found.scene.motion.duration])
    rows = {each.quantity: each for each in found.governing}
    assert rows["load on a roller"].values == {"column": own.roller_load, "process": other.roller_load}
    assert all(each.values[each.engine] == max(each.values.values()) for each in rows.values())
    assert rows["resistance of a cart"].engine == "process"
    (sentence,) = text.sentences("process", found)
    assert "by process" in sentence
    assert any(
        "behind a make-up of 3 mm they are 0.01 to 0.03 and 0.14 to 0.24" in each
        for each in text.sentences("turn", found)
    )
    share = other.turning[0](0.11)
    drag = ProcessStudy(found.scene.with_engine("process")).standing_drag
    forming = other.mean_resistance[found.scene.motion.duration] - drag
    assert share(1.0) == pytest.approx(1)
    assert share(0.0) == pytest.approx((drag + 0.02 * forming) / (drag + forming), rel=1e-3)


BEARINGS = {
    "machine.guide_bearing": {"dynamic_rating": 20e3, "kind": "ball", "count": 2},
    "machine.roller_bearing": {"dynamic_rating": 40e3, "kind": "roller", "count": 2},
}  # fmt: skip


def test_motor_and_bearings_are_those_of_the_engine_that_requires_more(monkeypatch):
    """As by each engine alone, with its own cart and resistance."""
    found = beside(monkeypatch, "deep", **BEARINGS)
    law = found.machine_sizing.first_law
    alone = {"column": machine_sizing(found.stages, law)}
    alone["process"] = machine_sizing(build_stages(found.scene.with_engine("process")), law)
    powers = {engine: each.laws[law].required_power for engine, each in alone.items()}
    assert powers["process"] > 1.2 * powers["column"]
    assert found.machine_sizing.first.required_power == pytest.approx(powers["process"], rel=1e-6)
    assert found.machine_sizing.first.engine == "process"
    for wheel, *both in zip(found.machine_sizing.wheels, *(each.wheels for each in alone.values()), strict=True):
        sizes = {each.engine: max(abs(each.least), abs(each.largest)) for each in both}
        assert wheel.engine == max(sizes, key=sizes.get)
    for name, life in found.machine_sizing.lives.items():
        assert life.hours == pytest.approx(min(each.lives[name].hours for each in alone.values()), rel=1e-6)
    rows = {each.quantity: each for each in found.governing}
    assert rows[f"rated power of a motor with {law}"].values == pytest.approx(powers, rel=1e-6)
    assert {"load on a bearing of a roller", "load on a bearing of a front guide wheel"} <= rows.keys()
    (motor,), (lives,) = (text.sentences(name, found) for name in ("motor", "bearings"))
    assert re.match(rf"motor with {law} \(the larger of [\d.]+ k?W by column and [\d.]+ k?W by process\):", motor)
    assert re.search(r"roller [\d.× ⁰-⁹]+ h \(the larger of [\d.]+ k?N by column and [\d.]+ k?N by process\)", lives)
    assert not machine_sizing(found.stages, law).compared


def test_spread_over_the_mix_is_that_of_feed_work_and_sleeves(study):
    found = study.stages.contacts.process
    own = study.stages.resistance.map(study.scene.mean_speed)
    assert found.resistance_with(study.scene) == pytest.approx(own, rel=1e-3)
    slope = found.mix.heckel_slope
    stiffer = study.scene.replaced(**{"mix.overrides.heckel_slope": slope / 2})
    direct = ProcessStudy(stiffer)
    rollers = found.resistance_with(stiffer) - found.standing_drag
    assert rollers == pytest.approx(2 * direct.resistance, rel=0.01)
    assert rollers / (2 * found.resistance) == pytest.approx(2, rel=0.1)
    spread = mix_spread(study.scene, found)
    assert "fed_density_ratio" in spread.ranges
    assert spread.ranges["fed_density_ratio"] == pytest.approx((0.735, 0.765))
    assert spread.low < 1 < spread.high
    assert spread.fit > 0.98


@pytest.mark.slow
def test_forces_of_lifts_are_in_proportion_to_the_rate_factor():
    thin = load_scene("process", **{"product.height": 0.06, "machine.roller_length": 0.4})
    found = ProcessStudy(thin)
    factors = found.row.history.rate_factor, found.rate_factor_at(thin.mean_speed / 16)
    fast, slow = (
        simulate_lifts(found.problem, found.mix.steel_friction, factor, 0.82, thickness=0.0025, increments=6)
        for factor in factors
    )
    assert factors[1] / factors[0] == pytest.approx(0.951, abs=2e-3)
    for name in ("load", "resistance"):
        ratio = slow.values(name) / fast.values(name)
        assert ratio == pytest.approx(np.full(len(ratio), factors[1] / factors[0]), rel=0.012)
