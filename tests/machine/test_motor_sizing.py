"""Motor of a uniform shaft: closed forms of the torque, energy, gear, and the choice from a catalogue."""

import math
from dataclasses import replace

import pytest
from machine_cases import friction
from published import CART_OF_C

from compact.analysis.machine_models import standard_motors
from compact.drive import Crank, Rigid, simulate
from compact.machine.component_sizing import CatalogueMotor, SizingRule, check_motor, choose_motor, shaft_requirement
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
