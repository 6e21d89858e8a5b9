"""Hydraulic drive: valve flow, balances, errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, SIZE, dry, published_law
from machine_cases import HYDRAULIC as DRIVE

from compact.drive import simulate
from compact.machine.hydraulic_drive import solve_valve_flow


def flow(area, drop):
    """Flow [m3/s] through a valve: turbulent, or laminar below the transition drop of 1 kPa."""
    return 0.62 * area * np.sqrt(2 / 870) * drop / np.sqrt(np.hypot(drop, 1e3))


@pytest.mark.parametrize("drop", [1e-3, 1.0, 1e3, 1e7])
def test_drop_and_area_invert_the_flow(drop):
    assert DRIVE.drop(flow(3e-6, drop), 3e-6) == pytest.approx(drop, rel=1e-12)
    assert DRIVE.area(flow(3e-6, drop), drop) == pytest.approx(3e-6, rel=1e-14)
    if drop > 1e6:
        assert DRIVE.area(0.62 * 3e-6 * math.sqrt(2 * drop / 870), drop) == pytest.approx(3e-6, rel=1e-7)


@pytest.mark.parametrize("force", [3000.0, 0.0, -2500.0])
def test_valve_flow_balances_the_force(force):
    stroke = solve_valve_flow(DRIVE, np.array([0.2]), np.array([force]))
    assert 1e-3 * (stroke.inlet_pressure - stroke.outlet_pressure) == pytest.approx(force, abs=1e-9)
    assert flow(stroke.inlet_area, 8e6 - stroke.inlet_pressure) == pytest.approx(stroke.flow, rel=1e-12)
    assert flow(stroke.outlet_area, stroke.outlet_pressure) == pytest.approx(stroke.flow, rel=1e-12)
    assert stroke.inlet_pressure >= 0
    assert stroke.outlet_area <= DRIVE.valve_area


# balances


@pytest.mark.parametrize("name", ["parabolic", "harmonic", "reversal-3", "septic"])
def test_energy_balance_of_pump_cart_and_valves(name):
    run = simulate(CART, DRIVE, published_law(name), dry)
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-9)
    assert run.energy_residual < 1e-12
    assert run.pump_work == pytest.approx(8e6 * 5e-4 * 6.0, rel=1e-12)
    assert run.throttle_heat > 0 < run.relief_heat


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
