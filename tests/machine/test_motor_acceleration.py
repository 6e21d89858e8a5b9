"""Acceleration phase of a motor: closed forms, periodic regime at its end, energy balance, errors."""

from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, KLOSS, dry, free, published_law
from published import CART_OF_C

from compact.machine.crankshaft import CRANK_ANGLES
from compact.machine.motor_drive import Motor, simulate_acceleration_phase, simulate_motor
from compact.machine.shaft import LinearTorqueCurve


def accelerate(*arguments):
    """Run in the periodic regime, and the acceleration phase."""
    periodic = simulate_motor(*arguments)
    return periodic, simulate_acceleration_phase(periodic)


def test_linear_motor_accelerates_a_bare_shaft_exponentially():
    """w = w_n (1 - exp(-t/tau)), phi = w_n (t - tau (1 - exp(-t/tau))), tau = J w_n/T_s on the shaft."""
    motor = Motor(LinearTorqueCurve(stall_torque=8.0, no_load_speed=20.0), 2.0, 0.5, 3.0)
    _, run = accelerate(replace(CART, mass=0.0), motor, published_law("cubic"), free)
    tau = 5.0 * 10.0 / 16.0
    speed_ratio = 1 - np.exp(-run.time / tau)
    assert run.speed == pytest.approx(10.0 * speed_ratio, abs=1e-6)
    assert run.angle == pytest.approx(10.0 * (run.time - tau * speed_ratio), rel=1e-6, abs=1e-8)
    assert run.energy_residual < 1e-7
    assert run.time[-1] == pytest.approx(tau * np.log(1e3), abs=2 * np.pi / 10)


@pytest.mark.parametrize("angles", [(0.0,), CRANK_ANGLES[2]], ids=len)
def test_acceleration_phase_ends_in_the_periodic_regime(angles):
    motor = Motor(KLOSS, 150.0, 1e-3, 1e5, angles)
    periodic, run = accelerate(CART_OF_C, motor, published_law("quintic"), dry)
    assert run.speed[0] == 0
    assert run.energy_residual < 1e-6
    assert run.revolutions >= 2
    assert run.speed[-1] == pytest.approx(periodic.speed[0], rel=1e-3)
    last = run.angle >= 2 * np.pi * (run.revolutions - 1)
    at = np.interp(np.mod(run.angle[last], 2 * np.pi), periodic.angle, periodic.speed)
    assert run.speed[last] == pytest.approx(at, rel=0.05)
