"""Motor of a uniform shaft: torque, energy, gear, choice from a catalogue; load spectrum of bearings."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import friction
from published import CART_OF_C

from compact.analysis.machine_models import standard_motors
from compact.drive import Crank, Rigid, simulate
from compact.machine.component_sizing import (
    Bearing,
    CatalogueMotor,
    LoadCycle,
    SizingRule,
    bearing_life,
    check_motor,
    choose_motor,
    count_cycles,
    shaft_requirement,
)
from compact.machine.crankshaft import simulate_crankshaft
from compact.machine.shaft import CartsOnShaft
from compact.motion import law

STROKE, DURATION, MASS, FORCE = 0.4, 1.0, 1000.0, 3486.0
SPEED = math.pi / DURATION  # of the shaft
FREE = replace(CART_OF_C, mass=MASS, guide_friction=0.0)
MASSLESS = replace(FREE, mass=0.0)
MOTORS = (
    CatalogueMotor("small", 5.0, 15.0, 150.0, 0.001, 300.0),
    CatalogueMotor("middle", 12.0, 40.0, 150.0, 0.004, 500.0),
    CatalogueMotor("large", 40.0, 120.0, 150.0, 0.02, 900.0),
)


def carts(cart=FREE, force=0.0, name="harmonic", angles=(0.0,), dwell=0.0):
    return CartsOnShaft(cart, law(name, STROKE, DURATION).cycle(dwell, dwell), friction(force), angles)


def requirement(**keys):
    return shaft_requirement(carts(**keys))


# torque


def test_harmonic_law_without_resistance_has_the_torque_of_its_closed_form():
    """T = m (s/2)2 w2/2 sin 2 phi: rms T/sqrt 2, no mean, driving half of the time."""
    found, size = requirement(), MASS * (STROKE / 2) ** 2 * SPEED**2 / 2
    assert found.speed == pytest.approx(SPEED)
    assert (found.peak_driving, found.peak_braking) == pytest.approx((size, size), rel=1e-12)
    assert found.rms_torque == pytest.approx(size / math.sqrt(2), rel=1e-12)
    assert found.mean_torque == pytest.approx(0.0, abs=1e-10 * size)
    assert (found.driving_share, found.braking_share) == pytest.approx((0.5, 0.5), abs=0.01)
    assert found.excess_energy == pytest.approx(size, rel=1e-3)
    assert found.largest_inertia == pytest.approx(MASS * (STROKE / 2) ** 2, rel=1e-12)


def test_harmonic_law_against_friction_has_the_torque_of_its_closed_form():
    """T = W s/2 |sin phi|: mean W s/pi, rms W s/2/sqrt 2."""
    found = requirement(cart=MASSLESS, force=FORCE)
    assert found.mean_torque == pytest.approx(FORCE * STROKE / math.pi, rel=1e-12)
    assert found.rms_torque == pytest.approx(FORCE * STROKE / 2 / math.sqrt(2), rel=1e-12)
    assert found.peak_torque == pytest.approx(FORCE * STROKE / 2, rel=1e-12)
    assert found.peak_braking == 0.0
    assert found.driving_share == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", ["parabolic", "cubic", "reversal-4-free-acceleration", "combined-2"])
def test_work_of_a_revolution_is_the_energy_of_the_cycle(name):
    found = shaft_requirement(carts(CART_OF_C, FORCE, name))
    run = simulate(CART_OF_C, Rigid(), law(name, STROKE, DURATION), friction(FORCE))
    assert 2 * math.pi * found.mean_torque == pytest.approx(run.energy, rel=1e-9)
    assert found.peak_torque * found.speed == pytest.approx(run.peak_power, rel=1e-9)
    assert found.rms_torque * found.speed == pytest.approx(run.rms_power, rel=1e-9)


def test_crank_has_the_torque_of_the_crankshaft():
    crank, cycle = Crank(STROKE / 2, 0.8), law("crank", STROKE, DURATION, rod_length=0.8).cycle()
    found = shaft_requirement(CartsOnShaft(CART_OF_C, cycle, friction(FORCE), (0.0, math.pi / 2), crank))
    turn = simulate_crankshaft(CART_OF_C, crank, SPEED, friction(FORCE), (0.0, math.pi / 2))
    assert found.peak_torque == pytest.approx(turn.peak_torque, rel=1e-6)
    assert found.mean_torque == pytest.approx(turn.mean(turn.torque), rel=1e-6)


def test_gear_divides_the_driving_and_keeps_less_of_the_braking_torque():
    found, ratio, efficiency = requirement(), 20.0, 0.8
    rms, peak = found.at_motor(ratio, efficiency)
    driving, braking = 1 / (ratio * efficiency), efficiency / ratio
    assert rms == pytest.approx(found.rms_torque * math.sqrt((driving**2 + braking**2) / 2), rel=1e-6)
    assert peak == pytest.approx(found.peak_driving * driving)
    two = requirement(angles=(0.0, math.pi / 2))  # sin 2 phi + sin(2 phi + pi) = 0
    assert two.peak_torque < 1e-9 * found.peak_torque


def test_motor_at_its_rated_speed_holds_by_its_rated_power():
    """Driving only: rated torque and speed decide by their product alone."""
    found, rule = requirement(cart=MASSLESS, force=FORCE), SizingRule(margin=1.25, efficiency=0.9)
    power = rule.required_power(found)
    for speed in (50.0, 150.0, 300.0):
        enough = CatalogueMotor("a", 1.0001 * power / speed, 10 * power / speed, speed, 0.0)
        assert check_motor(enough, found, rule).holds
        short = replace(enough, rated_torque=0.9999 * power / speed)
        (reason,) = check_motor(short, found, rule).failures
        assert "of rated torque" in reason


def test_speed_fluctuation_is_the_excess_energy_over_that_of_the_rotor():
    motor, found = MOTORS[1], requirement(force=FORCE)
    fit = check_motor(motor, found, SizingRule())
    inertia = (motor.speed / SPEED) ** 2 * motor.inertia
    assert fit.fluctuation == pytest.approx(found.excess_energy / (inertia * SPEED**2))
    assert fit.inertia_ratio == pytest.approx(found.largest_inertia / inertia)
    assert math.isinf(check_motor(replace(motor, inertia=0.0), found, SizingRule()).inertia_ratio)


# catalogue


def test_smallest_motor_that_holds_is_chosen_and_the_next_smaller_has_a_reason():
    found = requirement(cart=MASSLESS, force=FORCE)  # 493 N m rms at 3.14 rad/s: 10.3 N m at 150 rad/s
    choice = choose_motor(MOTORS[::-1], found, SizingRule(margin=1.1))
    assert choice.by == "price"
    assert [each.motor.name for each in choice.fits] == ["small", "middle", "large"]
    assert (choice.chosen.motor.name, choice.next_smaller.motor.name) == ("middle", "small")
    assert choice.next_smaller.failures == (
        "has 5 of the 11.36 N m of rated torque required", "has 15 of the 16.06 N m of peak torque required"
    )  # fmt: skip


# motors by standard


def test_standard_motors_are_those_of_the_standard():
    motors = standard_motors()
    by_poles = {poles: [each for each in motors if f"{poles} poles" in each.name] for poles in (2, 4, 6, 8)}
    assert [len(each) for each in by_poles.values()] == [26, 27, 20, 19]
    assert len({each.name for each in motors}) == len(motors)
    for poles, each in by_poles.items():
        powers = [motor.rated_power for motor in each]
        assert powers == sorted(powers)
        assert all(0.9 <= motor.speed / (4 * math.pi * 50 / poles) < 1 for motor in each)
        assert all(motor.peak_torque == 1.6 * motor.rated_torque for motor in each)
    assert (min(each.rated_power for each in motors), max(each.rated_power for each in motors)) == pytest.approx(
        (60, 132e3)
    )
    known = {each.name: each.inertia for each in motors}  # common motors: 0.0065, 0.03, 0.16 and 2.9 kg m2
    for name, inertia in (("2.2 kW, 4 poles, frame 100L", 0.0075), ("22 kW, 4 poles, frame 180L", 0.16)):
        assert 1 / 1.6 < known[name] / inertia < 1.6


# ---- Rainflow counting against the examples of ASTM E1049-85, and bearing lives by hand


HISTORY = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]  # of figure 7
BALL, ROLLER = Bearing(20e3, "ball", 1), Bearing(20e3, "roller", 1)


def test_repeating_history_has_the_closed_cycles_of_the_standard():
    """Figure 7, the same history repeated: one cycle each of 9, 7, 4 and 3."""
    found = count_cycles(HISTORY)
    assert [(each.range, each.count) for each in found] == [(9.0, 1.0), (7.0, 1.0), (4.0, 1.0), (3.0, 1.0)]
    assert found[0] == LoadCycle(9.0, 0.5, 1.0)


@given(st.lists(st.integers(-9, 9), min_size=2, max_size=30))
def test_cycles_hold_the_whole_variation_of_the_history(history):
    """Twice the sum of all ranges is the variation over one repetition, all cycles are whole."""
    load = np.array(history, float)
    found = count_cycles(load)
    assert 2 * sum(each.range * each.count for each in found) == pytest.approx(np.abs(np.diff([*load, load[0]])).sum())
    assert all(each.count == int(each.count) for each in found)
    assert (found[0].range if found else 0.0) == np.ptp(load)


def test_constant_load_has_no_cycles_and_bearings_without_load_or_travel_last():
    assert count_cycles(np.zeros(3)) == count_cycles(7.0 + 1e-12 * np.array([0.0, 1.0, 0.0, 1.0])) == []
    life = bearing_life(Bearing(20e3, "ball", count=2), np.full(3, -6e3), np.zeros(3), radius=0.1, period=2.0)
    assert (life.equivalent_load, life.million_revolutions, life.hours, life.valid) == (3e3, math.inf, math.inf, True)
    assert math.isinf(bearing_life(BALL, np.zeros(2), np.ones(2), 0.1, 1.0).hours)
    assert not bearing_life(BALL, np.full(1, 11e3), np.ones(1), 0.1, 1.0).valid


@pytest.mark.parametrize("noise", [0.0, 1e-9, -1e-9])
def test_cycles_that_differ_by_rounding_are_one_and_equal_ranges_are_in_order_of_the_mean(noise):
    """Of the run, whose tolerance is 1e-8: 15e-8 is on the edge between two rounded ranges."""
    twins = [0.0, 9.0, 1.0, 3.0 + 15e-8 + noise, 1.0, 3.0 + 15e-8, 1.0, 9.0, 5.0, 7.0 + 15e-8 - noise, 5.0, 9.0]
    found = [(round(each.range, 6), round(each.mean, 6), each.count) for each in count_cycles(twins)]
    assert found == [(9.0, 4.5, 1.0), (8.0, 5.0, 1.0), (4.0, 7.0, 1.0), (2.0, 6.0, 1.0), (2.0, 2.0, 2.0)]


def test_life_by_hand():
    """(20/2)^3 = 1000 and (20/2)^(10/3) = 2154 million revolutions; 0.8 m in 2 s on a wheel of 0.1 m."""
    load, travelled = np.full(4, 2000.0), np.full(4, 0.2)
    ball, roller = (bearing_life(each, load, travelled, 0.1, 2.0) for each in (BALL, ROLLER))
    assert ball.equivalent_load == pytest.approx(2000.0)
    assert ball.million_revolutions == pytest.approx(1000.0)
    assert roller.million_revolutions == pytest.approx(2154.43, abs=0.01)
    assert ball.hours == pytest.approx(1e9 * 2 * math.pi * 0.1 / 0.4 / 3600)
    assert ball.valid


def test_equivalent_load_is_the_mean_of_the_damage():
    """Half the travel at 1, half at 3 kN, p = 3: (28/2)^(1/3) kN; loads at rest do not count."""
    found = bearing_life(BALL, np.array([1e3, -3e3, 9e3]), np.array([0.4, 0.4, 0.0]), 0.1, 2.0)
    assert found.equivalent_load == pytest.approx(1e3 * 14 ** (1 / 3))
