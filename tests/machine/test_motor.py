"""Motor drive and its acceleration: closed forms, an independent solution, limits, balances, errors."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import CART, KLOSS, SIZE, dry, free, friction, published_law
from published import CART_OF_C
from sampling import examples
from scipy.integrate import solve_ivp

from compact.drive import Crank, Rigid, simulate
from compact.machine.crankshaft import CRANK_ANGLES, simulate_crankshaft
from compact.machine.motor_drive import Motor, simulate_acceleration_phase, simulate_motor
from compact.machine.shaft import Kloss, LinearTorqueCurve

KINDS = ("cubic", "septic", "complex", "reversal-4", "crank", "parabolic", "modified-trapezoid")  # one of each kind


@dataclass(frozen=True)
class ConstantTorque:
    """Motor with a constant torque."""

    size: float
    no_load_speed: float = 100.0

    def torque(self, speed):
        return self.size + 0.0 * speed


# closed form


@pytest.mark.parametrize("name", ["cubic", "harmonic", "reversal-4"])
def test_energy_under_a_constant_torque_in_closed_form(name):
    """(J + m x'^2) phi'^2/2 = initial energy + T phi - F (path of the cart)."""
    motor, start = Motor(ConstantTorque(90.0), 2.0, 0.5, 7.0), 5.0
    run = simulate_motor(CART, motor, published_law(name), friction(300.0), start_speed=start)
    position, slope = run.load.travel(run.angle)[:2]
    path = np.where(run.angle < np.pi, position, 0.8 - position)
    inertia = motor.inertia + CART.mass * slope**2
    exact = (motor.inertia * start**2 / 2 + 180.0 * run.angle - 300.0 * path) / inertia
    assert run.speed**2 / 2 == pytest.approx(exact, rel=1e-8)


def test_linear_motor_accelerates_a_bare_shaft_exponentially():
    """w = w_n - (w_n - w_0) exp(-t/tau), tau = J w_n/T_s on the shaft."""
    motor = Motor(LinearTorqueCurve(stall_torque=8.0, no_load_speed=20.0), 2.0, 0.0, 3.0)
    run = simulate_motor(replace(CART, mass=0.0), motor, published_law("cubic"), free, start_speed=2.0)
    tau, most = 3.0 * 10.0 / 16.0, 10.0
    assert run.speed == pytest.approx(most - (most - 2.0) * np.exp(-run.time / tau), rel=1e-8)
    turned = most * run.period - (most - 2.0) * tau * (1 - math.exp(-run.period / tau))
    assert turned == pytest.approx(2 * np.pi, rel=1e-8)


def test_kloss_curve_has_its_peak_at_the_breakdown_slip():
    speed = 157.0 * (1 - np.linspace(-1, 1, 2001))
    assert KLOSS.torque(speed).max() == pytest.approx(40.0, rel=1e-5)
    assert KLOSS.torque(157.0 * 0.85) == pytest.approx(40.0, rel=1e-14)
    assert KLOSS.torque(157.0) == 0
    assert KLOSS.torque(0.0) == pytest.approx(2 * 40 / (1 / 0.15 + 0.15), rel=1e-14)
    assert KLOSS.torque(170.0) < 0


# independent solution


@pytest.mark.slow
def test_speed_agrees_with_a_general_solver():
    motor, motion = Motor(Kloss(60.0, 0.4, 157.0), 130.0, 1e-4, 30.0), published_law("quintic").cycle()
    run = simulate_motor(CART, motor, motion, friction(SIZE))
    rate = motion.period / (2 * np.pi)

    def rates(time, state):
        angle, speed = state
        slope, curvature = (float(motion.derivative(angle * rate, k)) * rate**k for k in (1, 2))
        taken = (CART.mass * curvature * speed**2 + SIZE * np.sign(slope)) * slope
        return [speed, (float(motor.torque(speed)) - taken) / (motor.inertia + CART.mass * slope**2)]

    state, time = [0.0, run.speed[0]], 0.0
    for angle in (0.5 * np.pi, np.pi, 1.7 * np.pi, 2 * np.pi):  # friction changes its sign at pi
        k = np.abs(run.angle - angle).argmin()
        got = solve_ivp(rates, (time, run.time[k]), state, "DOP853", rtol=1e-10, atol=1e-12, max_step=0.05)
        time, state = run.time[k], got.y[:, -1]
        assert state == pytest.approx([run.angle[k], run.speed[k]], rel=1e-7)


# hard cases


@pytest.mark.parametrize("name", KINDS)
def test_heavy_flywheel_agrees_with_the_rigid_drive(name):
    run = simulate_motor(CART_OF_C, Motor(KLOSS, 150.0, 0.0, 1e9), published_law(name), friction(SIZE))
    rigid = simulate(CART_OF_C, Rigid(), published_law(name, run.period / 2), friction(SIZE))
    assert run.fluctuation < 1e-6
    assert run.peak_force == pytest.approx(rigid.peak_force, rel=1e-6)
    assert run.peak_power == pytest.approx(rigid.peak_power, rel=1e-6)
    assert run.rms_power == pytest.approx(rigid.rms_power, rel=1e-6)
    assert run.nonuniformity == pytest.approx(rigid.nonuniformity, rel=1e-4, abs=1e-6)
    assert run.peak_jerk == pytest.approx(rigid.peak_jerk, rel=1e-3)
    assert run.drawn_energy == pytest.approx(run.energy, rel=1e-6)
    at_law_speed = simulate(CART_OF_C, Rigid(), published_law(name), friction(SIZE))
    assert run.dynamic_amplification == pytest.approx(rigid.peak_force / at_law_speed.peak_force, rel=1e-6)


def test_crank_with_a_heavy_flywheel_agrees_with_the_crankshaft():
    crank = Crank(0.2, 0.8)
    run = simulate_motor(
        CART_OF_C, Motor(KLOSS, 150.0, 0.0, 1e9, CRANK_ANGLES[3], crank), published_law("crank"), friction(SIZE)
    )
    rigid = simulate_crankshaft(CART_OF_C, crank, 2 * np.pi / run.period, friction(SIZE), CRANK_ANGLES[3])
    assert np.abs(run.shaft_torque).max() == pytest.approx(rigid.peak_torque, rel=1e-3)
    mean = np.sum(run.weights * run.shaft_torque * run.speed) / run.period
    assert mean == pytest.approx(rigid.mean(rigid.power), rel=1e-6)


def test_added_mass_adds_to_the_mass_of_the_cart():
    motor = Motor(KLOSS, 150.0, 0.0, 5.0)
    heavy = simulate_motor(replace(CART, mass=1400.0), motor, published_law("cubic"), friction(SIZE))
    resisting = simulate_motor(CART, motor, published_law("cubic"), lambda v, a: SIZE * np.sign(v) + 400 * a)
    assert resisting.peak_force == pytest.approx(heavy.peak_force, rel=1e-9)
    assert resisting.period == pytest.approx(heavy.period, rel=1e-12)


# properties


@examples(5, slow=25)
@given(st.sampled_from(["cubic", "quintic", "harmonic"]), st.floats(0, 4), st.floats(0, 5e3), st.floats(0.1, 0.6))
def test_energy_balance_of_any_motor(name, power, size, slip):
    motor = Motor(Kloss(60.0, slip, 157.0), 150.0, 0.0, 10**power)
    run = simulate_motor(CART, motor, published_law(name), friction(size))
    assert run.energy == pytest.approx(0.8 * size, rel=1e-6, abs=1e-3)
    assert run.energy_residual < 1e-6 or size < 1
    assert run.period == pytest.approx(run.time[-1], rel=1e-9)


# errors


@pytest.mark.parametrize("name", ["cubic", "parabolic", "crank"])
@pytest.mark.parametrize("curve", [KLOSS, LinearTorqueCurve(60.0, 157.0)], ids=["kloss", "linear"])
def test_extrema_of_the_shaft_between_nodes_are_found(name, curve):
    """Comparison with a hundred times as many samples of the same solution."""
    run = simulate_motor(CART, Motor(curve, 50.0, 0.05, 10.0, angles=(0.3,)), published_law(name), friction(SIZE))
    angle = np.concatenate([np.linspace(a, b, 1701) for a, b in itertools.pairwise(run.revolution.breaks)])
    energy, acceleration, _ = run.revolution.evaluate(angle)
    speed, motor = np.sqrt(2 * energy), run.drive
    fluctuation = (speed.max() - speed.min()) * run.period / (2 * np.pi)
    nodes = (run.speed.max() - run.speed.min()) * run.period / (2 * np.pi)
    assert run.fluctuation == pytest.approx(fluctuation, rel=1e-6)
    assert run.fluctuation >= fluctuation * (1 - 1e-12)
    assert nodes <= run.fluctuation
    assert run.peak_motor_torque == pytest.approx(np.abs(motor.torque(speed)).max() / 50.0, rel=1e-6)
    assert run.peak_motor_torque * (1 + 1e-12) >= np.abs(motor.torque(speed)).max() / 50.0
    assert run.peak_motor_power == pytest.approx(np.abs(motor.power(speed, acceleration)).max(), rel=1e-6)
    assert (run.least_speed, run.largest_speed) == pytest.approx((speed.min(), speed.max()), rel=1e-7)


def test_fluctuation_without_load_in_closed_form():
    """(J + m x'^2) phi'^2 is constant without resistance: phi' varies between 1 and sqrt(J/(J + m x'^2))."""
    run = simulate_motor(
        CART, Motor(ConstantTorque(0.0), 1.0, 0.0, 4.0), published_law("quintic"), free, start_speed=5.0
    )
    fastest = 15 / 8 * 0.4 / np.pi  # largest x' over the angle; half a revolution is one stroke
    assert run.largest_speed == pytest.approx(5.0, rel=1e-12)
    assert run.least_speed == pytest.approx(5.0 * math.sqrt(4 / (4 + CART.mass * fastest**2)), rel=1e-9)


# ---- Acceleration phase of a motor: closed forms, periodic regime at its end, energy balance, errors


def accelerate(*arguments):
    """Run in the periodic regime, and the acceleration phase."""
    periodic = simulate_motor(*arguments)
    return periodic, simulate_acceleration_phase(periodic)


def test_linear_motor_accelerates_from_rest_exponentially():
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
    revolutions = round(run.angle[-1] / (2 * np.pi))
    assert revolutions >= 2
    assert run.speed[-1] == pytest.approx(periodic.speed[0], rel=1e-3)
    last = run.angle >= 2 * np.pi * (revolutions - 1)
    at = np.interp(np.mod(run.angle[last], 2 * np.pi), periodic.angle, periodic.speed)
    assert run.speed[last] == pytest.approx(at, rel=0.05)


@pytest.mark.parametrize("name", ["cubic", "parabolic"])
def test_steep_motor_on_a_bare_shaft_is_resolved(name):
    run = simulate_motor(CART_OF_C, Motor(KLOSS, 150.0, 0.0, 1.0), published_law(name), friction(SIZE))
    assert run.energy_residual < 1e-8
    assert run.energy == pytest.approx(0.8 * (SIZE + 0.008 * 9480), rel=1e-6)
