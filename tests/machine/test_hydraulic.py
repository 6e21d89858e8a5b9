"""Hydraulic drive: closed forms, inverse and forward problem, balances, limits, errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, SIZE, dry, published_law
from machine_cases import HYDRAULIC as DRIVE
from sampling import sampled

from compact.drive import simulate
from compact.machine.hydraulic_drive import simulate_stroke, solve_valve_flow
from compact.numerics.piecewise import PiecewisePolynomial


def constant(area, time=2.0):
    """Constant valve area [m2]."""
    return PiecewisePolynomial(np.array([0.0, time]), np.array([[area]]))


# closed form


@pytest.mark.parametrize(
    ("inlet", "outlet"), sampled([(1e-6, 2e-6), (1e-6, 4e-6), (3e-6, 2e-6), (3e-6, 4e-6)], [(3e-6, 2e-6)])
)
def test_constant_valve_areas_yield_a_constant_speed(inlet, outlet):
    """v^2 (k_in + k_out) = p_s - F/A, k = rho/2 (A/(Cd a))^2, far above the laminar drop."""
    resistances = [870 / 2 * (1e-3 / (0.62 * area)) ** 2 for area in (inlet, outlet)]
    speed = math.sqrt((8e6 - SIZE / 1e-3) / sum(resistances))
    stroke = simulate_stroke(CART, DRIVE, 0.4, (constant(inlet, 0.2 / speed), constant(outlet, 0.2 / speed)), dry)
    assert stroke.velocity[-1] == pytest.approx(speed, rel=1e-5)
    assert stroke.outlet_pressure[-1] == pytest.approx(resistances[1] * speed**2, rel=1e-4)


@pytest.mark.slow
def test_added_mass_adds_to_the_mass_of_the_cart():
    """W = F + 400 kg v' adds 400 kg to the cart."""
    areas = constant(1e-6, 0.3), constant(2e-5, 0.3)
    lagging = simulate_stroke(CART, DRIVE, 0.4, areas, lambda v, a: dry(v, a) + 400.0 * a)
    heavier = simulate_stroke(replace(CART, mass=CART.mass + 400.0), DRIVE, 0.4, areas, dry)
    assert lagging.position[-1] == pytest.approx(heavier.position[-1], rel=1e-6)
    assert lagging.velocity[-1] == pytest.approx(heavier.velocity[-1], rel=1e-4)
    assert lagging.energy_residual < 1e-6


@pytest.mark.slow
def test_small_pump_flow_limits_the_mean_speed():
    """x = (Q t - V p/K)/A within the oscillation v/w of the cart on its oil, w^2 = A^2 K/(V m)."""
    drive = replace(DRIVE, pump_flow=5e-5)
    stroke = simulate_stroke(CART, drive, 0.4, (constant(2e-5, 0.5), constant(2e-5, 0.5)), dry)
    frequency = 0.05 / math.sqrt(1e-6 * 1.4e9 / 1.3e-4 / CART.mass)
    assert stroke.position[-1] == pytest.approx(0.05 * 0.5 - 1e-4 * SIZE / 1e-6 / 1.4e9, abs=1.1 * frequency)
    assert stroke.energies["relief"] < 0.05 * stroke.energies["pump"]  # it opens at pressure peaks


def test_closed_cylinders_are_an_oil_spring():
    """A cart between closed cylinders oscillates with w^2 = 2 A^2 K/(V m)."""
    drive = replace(DRIVE, dead_volume=1.0, piston_area=0.1, supply_pressure=1e-3)
    shut = simulate_stroke(
        CART, drive, 0.4, (constant(1e-12, 0.03), constant(1e-12, 0.03)), lambda v, a: 0 * v, (2e3, 0.0)
    )
    frequency = math.sqrt(2 * 0.1**2 * 1.4e9 / (1.02 * CART.mass))
    fastest = 2e3 * 0.1 / (CART.mass * frequency)  # the initial pressure of one cylinder distributes over both
    assert np.abs(shut.velocity).max() == pytest.approx(fastest, rel=0.01)


@pytest.mark.parametrize("drop", [1e-3, 1.0, 1e3, 1e7])
def test_drop_and_area_invert_the_flow(drop):
    flow = DRIVE.flow(3e-6, drop)
    assert DRIVE.drop(flow, 3e-6) == pytest.approx(drop, rel=1e-12)
    assert DRIVE.area(flow, drop) == pytest.approx(3e-6, rel=1e-14)
    if drop > 1e6:
        assert flow == pytest.approx(0.62 * 3e-6 * math.sqrt(2 * drop / 870), rel=1e-7)


@pytest.mark.parametrize("force", [3000.0, 0.0, -2500.0])
def test_valve_flow_balances_the_force(force):
    stroke = solve_valve_flow(DRIVE, np.array([0.2]), np.array([force]))
    assert 1e-3 * (stroke.inlet_pressure - stroke.outlet_pressure) == pytest.approx(force, abs=1e-9)
    assert DRIVE.flow(stroke.inlet_area, 8e6 - stroke.inlet_pressure) == pytest.approx(stroke.flow, rel=1e-12)
    assert DRIVE.flow(stroke.outlet_area, stroke.outlet_pressure) == pytest.approx(stroke.flow, rel=1e-12)
    assert stroke.inlet_pressure >= 0
    assert stroke.outlet_area <= DRIVE.valve_area


# inverse and forward problem


@pytest.mark.parametrize("name", sampled(["cubic", "quintic", "reversal-4"], ["cubic"]))
def test_forward_problem_reproduces_the_law(name):
    run = simulate(CART, DRIVE, published_law(name), dry)
    stroke = run.simulate_stroke()
    position = published_law(name).position(stroke.time)
    assert np.abs(stroke.position - position).max() < 1e-3 * 0.4
    assert stroke.energy_residual < 1e-6
    assert stroke.energies["resistance_work"] == pytest.approx(SIZE * stroke.position[-1], rel=1e-5)


@pytest.mark.slow
def test_error_is_proportional_to_the_compressibility_of_the_oil():
    moduli, errors = np.array([1e9, 4e9]), []
    for modulus in moduli:
        run = simulate(CART, replace(DRIVE, bulk_modulus=modulus), published_law("cubic"), dry)
        stroke = run.simulate_stroke()
        errors.append(np.abs(stroke.position - published_law("cubic").position(stroke.time)).max())
    order = np.polyfit(np.log(moduli), np.log(errors), 1)[0]
    assert order == pytest.approx(-1, abs=0.05), f"the error falls as K^{order:.2f}"


# balances


@pytest.mark.parametrize("name", ["parabolic", "harmonic", "reversal-3", "septic"])
def test_energy_balance_of_pump_cart_and_valves(name):
    run = simulate(CART, DRIVE, published_law(name), dry)
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-9)
    assert run.energy_residual < 1e-12
    assert run.pump_work == pytest.approx(8e6 * 5e-4 * 6.0, rel=1e-12)
    assert run.throttle_heat > 0 < run.relief_heat


# hard cases


def test_cart_is_at_rest_until_breakaway():
    """p_in rises as K Q/V at full supply pressure: t = F V/(A K Q) to first order in p/p_s."""
    drive = replace(DRIVE, supply_pressure=8e8, pump_flow=1.0)
    stroke = simulate_stroke(CART, drive, 0.4, (constant(1e-8, 0.4), constant(2e-5, 0.4)), dry)
    wait = SIZE / 1e-3 * 1e-4 / (1.4e9 * drive.flow(1e-8, 8e8))
    assert np.abs(stroke.velocity[stroke.time < 0.99 * wait]).max() < 1e-12
    standing = stroke.time[np.abs(stroke.velocity) < 1e-12]
    assert standing.max() == pytest.approx(wait, rel=0.01)


@pytest.mark.parametrize("name", sampled(["quintic", "septic", "cycloidal", "combined-4"], ["quintic"]))
def test_valve_areas_without_resistance(name):
    """Force and flow vanish at both ends: the outlet valve is open at the start and closed at the stop."""
    run = simulate(CART, DRIVE, published_law(name, 2.0), lambda v, a: 0 * v)
    inlet, outlet = run.valve_areas()
    assert inlet(np.array([0.0, 2.0])) == pytest.approx(0, abs=1e-12)
    assert outlet(np.array([0.0, 2.0])) == pytest.approx([2e-5, 0], abs=1e-11)
    stroke = run.simulate_stroke()
    assert np.abs(stroke.position - published_law(name, 2.0).position(stroke.time)).max() < 1e-3 * 0.4
    assert stroke.energy_residual < 1e-6


# errors


@pytest.mark.parametrize(
    ("changes", "name", "lack"),
    [
        ({"supply_pressure": 3e6}, "cubic", "supply pressure"),
        ({"pump_flow": 1e-4}, "cubic", "pump flow"),
        ({"valve_area": 3.5e-6}, "cubic", "valve area"),
        ({}, "constant-velocity", "force: the velocity jumps"),
    ],
)
def test_insufficient_drive_names_the_quantity(changes, name, lack):
    run = simulate(CART, replace(DRIVE, **changes), published_law(name), dry)
    assert run.lack == lack
    with pytest.raises(RuntimeError, match=f"the drive cannot follow '{name}': insufficient {lack}; use"):
        run.valve_areas()
