"""Cylinders and throttles: closed forms, the inverse undone forwards, balances, limits, refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published import CART_OF_C

from compact.drive import Rigid, simulate
from compact.machine.cart import EndSprings
from compact.machine.hydraulic_drive import Hydraulic, passage, throttled
from compact.motion.profile import law
from compact.numerics.piecewise import PiecewisePolynomial

CART = replace(CART_OF_C, guide_friction=0.0)
SIZE = 3486.0
PRESS = Hydraulic(
    piston_area=1e-3, supply_pressure=8e6, pump_flow=5e-4, valve_area=2e-5, discharge_coefficient=0.62,
    oil_density=870.0, transition_drop=1e3, bulk_modulus=1.4e9, dead_volume=1e-4,
)  # fmt: skip


def dry(velocity, acceleration):
    return SIZE * np.sign(velocity)


def published(name, duration=3.0):
    return law(name, stroke=0.4, duration=duration)


def even(area, time=2.0):
    """A throttle of one area."""
    return PiecewisePolynomial(np.array([0.0, time]), np.array([[area]]))


# closed form


@pytest.mark.parametrize("inlet", [1e-6, 3e-6])
@pytest.mark.parametrize("outlet", [2e-6, 4e-6])
def test_even_throttles_make_an_even_speed(inlet, outlet):
    """v^2 (k_in + k_out) = p_s - F/A, k = rho/2 (A/(Cd a))^2, far above the laminar drop."""
    resistances = [870 / 2 * (1e-3 / (0.62 * area)) ** 2 for area in (inlet, outlet)]
    speed = math.sqrt((8e6 - SIZE / 1e-3) / sum(resistances))
    moved = passage(CART, PRESS, 0.4, (even(inlet, 0.2 / speed), even(outlet, 0.2 / speed)), dry)
    assert moved.velocity[-1] == pytest.approx(speed, rel=1e-5)
    assert moved.outlet_pressure[-1] == pytest.approx(resistances[1] * speed**2, rel=1e-4)


def test_added_mass_moves_with_the_cart():
    """W = F + 400 kg v' is a cart that is 400 kg heavier."""
    areas = even(1e-6, 0.3), even(2e-5, 0.3)
    lagging = passage(CART, PRESS, 0.4, areas, lambda v, a: dry(v, a) + 400.0 * a)
    heavier = passage(replace(CART, mass=CART.mass + 400.0), PRESS, 0.4, areas, dry)
    assert lagging.position[-1] == pytest.approx(heavier.position[-1], rel=1e-6)
    assert lagging.velocity[-1] == pytest.approx(heavier.velocity[-1], rel=1e-4)
    assert lagging.residual < 1e-6


@pytest.mark.slow
def test_pump_of_little_flow_sets_the_mean_speed():
    """x = (Q t - V p/K)/A, give or take what the cart swings on its oil, v/w, w^2 = A^2 K/(V m)."""
    press = replace(PRESS, pump_flow=5e-5)
    moved = passage(CART, press, 0.4, (even(2e-5, 0.5), even(2e-5, 0.5)), dry)
    swing = 0.05 / math.sqrt(1e-6 * 1.4e9 / 1.3e-4 / CART.mass)
    assert moved.position[-1] == pytest.approx(0.05 * 0.5 - 1e-4 * SIZE / 1e-6 / 1.4e9, abs=1.1 * swing)
    assert moved.energies["relief"] < 0.05 * moved.energies["pump"]  # it opens as the pressure swings


def test_closed_outlet_is_a_spring_of_oil():
    """A moving cart against a shut cylinder swings with w^2 = A^2 K/(V m)."""
    press = replace(PRESS, dead_volume=1.0, piston_area=0.1, supply_pressure=1e-3)
    shut = passage(CART, press, 0.4, (even(1e-12, 0.03), even(1e-12, 0.03)), lambda v, a: 0 * v, (2e3, 0.0))
    swing = math.sqrt(2 * 0.1**2 * 1.4e9 / (1.02 * CART.mass))
    fastest = 2e3 * 0.1 / (CART.mass * swing)  # both cylinders share the pressure that was in one
    assert np.abs(shut.velocity).max() == pytest.approx(fastest, rel=0.01)


@pytest.mark.parametrize("drop", [1e-3, 1.0, 1e3, 1e7])
def test_drop_and_area_undo_the_flow(drop):
    flow = PRESS.flow(3e-6, drop)
    assert PRESS.drop(flow, 3e-6) == pytest.approx(drop, rel=1e-12)
    assert PRESS.area(flow, drop) == pytest.approx(3e-6, rel=1e-14)
    if drop > 1e6:
        assert flow == pytest.approx(0.62 * 3e-6 * math.sqrt(2 * drop / 870), rel=1e-7)


@pytest.mark.parametrize("force", [3000.0, 0.0, -2500.0])
def test_throttles_carry_the_force(force):
    made = throttled(PRESS, np.array([0.2]), np.array([force]))
    assert 1e-3 * (made.inlet_pressure - made.outlet_pressure) == pytest.approx(force, abs=1e-9)
    assert PRESS.flow(made.inlet_area, 8e6 - made.inlet_pressure) == pytest.approx(made.flow, rel=1e-12)
    assert PRESS.flow(made.outlet_area, made.outlet_pressure) == pytest.approx(made.flow, rel=1e-12)
    assert made.inlet_pressure >= 0
    assert made.outlet_area <= PRESS.valve_area


# the inverse undone


@pytest.mark.parametrize("name", ["cubic", "quintic", "reversal-4"])
def test_throttles_of_a_law_make_the_law(name):
    run = simulate(CART, PRESS, published(name), dry)
    made = run.forward()
    position = published(name).position(made.time)
    assert np.abs(made.position - position).max() < 1e-3 * 0.4
    assert made.residual < 1e-6
    assert made.energies["resistance_work"] == pytest.approx(SIZE * made.position[-1], rel=1e-5)


def test_miss_falls_with_the_yielding_of_the_oil():
    moduli, misses = np.array([1e9, 4e9, 16e9]), []
    for modulus in moduli:
        run = simulate(CART, replace(PRESS, bulk_modulus=modulus), published("cubic"), dry)
        made = run.forward()
        misses.append(np.abs(made.position - published("cubic").position(made.time)).max())
    order = np.polyfit(np.log(moduli), np.log(misses), 1)[0]
    assert order == pytest.approx(-1, abs=0.05), f"the miss falls as K^{order:.2f}"


# balances


@pytest.mark.parametrize("name", ["parabolic", "harmonic", "reversal-3", "septic"])
def test_pump_gives_what_cart_and_valves_take(name):
    run = simulate(CART, PRESS, published(name), dry)
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-9)
    assert run.energy_residual < 1e-12
    assert run.pump_work == pytest.approx(8e6 * 5e-4 * 6.0, rel=1e-12)
    assert run.throttle_heat > 0 < run.relief_heat


def test_force_is_that_of_the_rigid_drive():
    made, rigid = (simulate(CART_OF_C, means, published("cubic"), dry) for means in (PRESS, Rigid()))
    assert (made.peak_force, made.peak_power, made.rms_power) == (rigid.peak_force, rigid.peak_power, rigid.rms_power)


@pytest.mark.slow
def test_end_springs_take_the_pressure_of_the_start():
    springs = replace(CART, end_springs=EndSprings(4e3, 300.0, 0.08, stroke=0.4))
    bare, sprung = (simulate(cart, PRESS, published("harmonic", 1.4), dry) for cart in (CART, springs))
    assert sprung.peak_pressure < bare.peak_pressure
    made = sprung.forward()
    assert made.residual < 1e-6
    assert np.abs(made.position - published("harmonic", 1.4).position(made.time)).max() < 2e-3 * 0.4


# hard cases


def test_cart_stands_until_the_pressure_gets_over_its_friction():
    """p_in rises as K Q/V, Q under the whole supply: t = F V/(A K Q) to first order in p/p_s."""
    press = replace(PRESS, supply_pressure=8e8, pump_flow=1.0)
    moved = passage(CART, press, 0.4, (even(1e-8, 0.4), even(2e-5, 0.4)), dry)
    waits = SIZE / 1e-3 * 1e-4 / (1.4e9 * press.flow(1e-8, 8e8))
    assert np.abs(moved.velocity[moved.time < 0.99 * waits]).max() < 1e-12
    standing = moved.time[np.abs(moved.velocity) < 1e-12]
    assert standing.max() == pytest.approx(waits, rel=0.01)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.floats(0, 6e3), st.floats(0.5, 5), st.sampled_from(["cubic", "quintic"]))
def test_any_cart_keeps_the_balance_of_its_work(size, duration, name):
    run = simulate(CART, PRESS, published(name, duration), lambda v, a: size * np.sign(v))
    assert run.energy_residual < 1e-12
    if not run.lack:
        assert run.forward().residual < 1e-6


# refusals


@pytest.mark.parametrize(
    ("changes", "name", "lack"),
    [
        ({"supply_pressure": 3e6}, "cubic", "supply pressure"),
        ({"pump_flow": 1e-4}, "cubic", "pump flow"),
        ({"valve_area": 3.5e-6}, "cubic", "valve area"),
        ({}, "constant-velocity", "force: the velocity jumps"),
    ],
)
def test_drive_with_too_little_says_what(changes, name, lack):
    run = simulate(CART, replace(PRESS, **changes), published(name), dry)
    assert run.lack == lack
    with pytest.raises(RuntimeError, match=f"no throttles make '{name}': the drive has too little {lack}; give more"):
        run.areas()


@pytest.mark.parametrize("field", ["piston_area", "bulk_modulus", "transition_drop"])
def test_impossible_hydraulics_are_refused(field):
    with pytest.raises(ValueError, match=f"`{field}` must be positive"):
        replace(PRESS, **{field: 0.0})


def test_lag_that_outweighs_the_cart_is_told():
    with pytest.raises(RuntimeError, match="no acceleration balances"):
        passage(CART, PRESS, 0.4, (even(1e-6), even(2e-5)), lambda v, a: dry(v, a) - 2e3 * a + 1e6 * a**3)


def test_oil_that_rings_without_end_is_told(monkeypatch):
    monkeypatch.setattr("compact.machine.hydraulic_drive.MOST_EVALUATIONS", 100)
    with pytest.raises(RuntimeError, match="in 100 evaluations and no further: the oil rings too fast for its time"):
        passage(CART, PRESS, 0.4, (even(1e-6), even(2e-5)), dry)
