"""Acceleration phase of a motor: closed forms, periodic regime at its end, energy balance, errors."""

from dataclasses import replace

import numpy as np
import pytest
from published import CART_OF_C

from compact.machine.crankshaft import CRANK_ANGLES
from compact.machine.motor_drive import Motor, simulate_acceleration_phase
from compact.machine.shaft import Kloss, LinearTorqueCurve
from compact.motion.profile import law

CART = replace(CART_OF_C, guide_friction=0.0)
KLOSS = Kloss(breakdown_torque=40.0, breakdown_slip=0.15, synchronous_speed=157.0)
SIZE = 3486.0


def dry(velocity, acceleration):
    return SIZE * np.sign(velocity)


def free(velocity, acceleration):
    return np.zeros_like(velocity)


def published(name):
    return law(name, stroke=0.4, duration=3.0, rod_length=0.8)


def test_linear_motor_accelerates_a_bare_shaft_exponentially():
    """w = w_n (1 - exp(-t/tau)), phi = w_n (t - tau (1 - exp(-t/tau))), tau = J w_n/T_s on the shaft."""
    motor = Motor(LinearTorqueCurve(stall_torque=8.0, no_load_speed=20.0), 2.0, 0.5, 3.0)
    run = simulate_acceleration_phase(replace(CART, mass=0.0), motor, published("cubic"), free)
    tau = 5.0 * 10.0 / 16.0
    speed_ratio = 1 - np.exp(-run.time / tau)
    assert run.speed == pytest.approx(10.0 * speed_ratio, abs=1e-6)
    assert run.angle == pytest.approx(10.0 * (run.time - tau * speed_ratio), rel=1e-6, abs=1e-8)
    assert run.energy_residual < 1e-7
    assert run.time[-1] == pytest.approx(tau * np.log(1e3), abs=2 * np.pi / 10)


@pytest.mark.parametrize("angles", [(0.0,), CRANK_ANGLES[2]], ids=len)
def test_acceleration_phase_ends_in_the_periodic_regime(angles):
    motor = Motor(KLOSS, 150.0, 1e-3, 1e5, angles)
    run = simulate_acceleration_phase(CART_OF_C, motor, published("quintic"), dry)
    assert run.speed[0] == 0
    assert run.energy_residual < 1e-6
    assert run.revolutions >= 2
    assert run.speed[-1] == pytest.approx(run.periodic.speed[0], rel=1e-3)
    last = run.angle >= 2 * np.pi * (run.revolutions - 1)
    at = np.interp(np.mod(run.angle[last], 2 * np.pi), run.periodic.angle, run.periodic.speed)
    assert run.speed[last] == pytest.approx(at, rel=0.05)


def test_duration_grows_with_the_flywheel():
    times = [
        simulate_acceleration_phase(CART_OF_C, Motor(KLOSS, 150.0, 0.0, size), published("cubic"), dry).time[-1]
        for size in (1e3, 1e5)
    ]
    assert times[1] > 5 * times[0] > 0
