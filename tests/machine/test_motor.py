"""A shaft that a motor turns: closed forms, an independent solution, limits, balances, refusals."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published import CART_OF_C
from scipy.integrate import solve_ivp

from compact.drive import Crank, Rigid, simulate
from compact.machine.crankshaft import USUAL_ANGLES, turn
from compact.machine.motor_characteristics import Kloss, LinearTorqueCurve
from compact.machine.motor_drive import Motor, simulate_motor
from compact.motion.profile import law

CART = replace(CART_OF_C, guide_friction=0.0)
KINDS = ("cubic", "septic", "complex", "reversal-4", "crank", "parabolic", "modified-trapezoid")  # one of each kind
KLOSS = Kloss(breakdown_torque=40.0, breakdown_slip=0.15, synchronous_speed=157.0)
SIZE = 3486.0


def published(name, duration=3.0):
    return law(name, stroke=0.4, duration=duration, rod_length=0.8)


def dry(size):
    return lambda velocity, acceleration: size * np.sign(velocity)


def free(velocity, acceleration):
    return np.zeros_like(velocity)


@dataclass(frozen=True)
class Even:
    """A motor of one torque, whatever its speed."""

    size: float
    no_load_speed: float = 100.0

    def torque(self, speed):
        return self.size + 0.0 * speed


# closed form


@pytest.mark.parametrize("name", ["cubic", "harmonic", "reversal-4"])
def test_even_torque_lifts_the_energy_by_its_work(name):
    """(J + m x'^2) phi'^2/2 = start + T phi - F (path of the cart)."""
    motor, start = Motor(Even(90.0), 2.0, 0.5, 7.0), 5.0
    run = simulate_motor(CART, motor, published(name), dry(300.0), start_speed=start)
    position, slope = run.load.travel(run.angle)[:2]
    path = np.where(run.angle < np.pi, position, 0.8 - position)
    moved = motor.inertia + CART.mass * slope**2
    exact = (motor.inertia * start**2 / 2 + 180.0 * run.angle - 300.0 * path) / moved
    assert run.speed**2 / 2 == pytest.approx(exact, rel=1e-8)


def test_straight_motor_runs_a_bare_shaft_up():
    """w = w_n - (w_n - w_0) exp(-t/tau), tau = J w_n/T_s on the shaft."""
    motor = Motor(LinearTorqueCurve(stall_torque=8.0, no_load_speed=20.0), 2.0, 0.0, 3.0)
    run = simulate_motor(replace(CART, mass=0.0), motor, published("cubic"), free, start_speed=2.0)
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


@pytest.mark.parametrize("angles", [(0.0,), USUAL_ANGLES[2], USUAL_ANGLES[4]], ids=len)
@pytest.mark.parametrize("name", ["cubic", "harmonic", "reversal-4-free-both"])
def test_motor_gives_what_friction_takes(name, angles):
    run = simulate_motor(CART, Motor(KLOSS, 150.0, 1e-3, 20.0, angles), published(name), dry(SIZE))
    work = np.sum(run.weights * run.motor_torque * run.speed)
    assert work == pytest.approx(len(angles) * 0.8 * SIZE, rel=1e-8)
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-8)
    assert run.energy_residual < 1e-8
    assert run.speed[-1] == pytest.approx(run.speed[0], rel=1e-10)


# independent solution


def test_general_solver_in_time_agrees():
    motor, motion = Motor(Kloss(60.0, 0.4, 157.0), 130.0, 1e-4, 30.0), published("quintic").cycle()
    run = simulate_motor(CART, motor, motion, dry(SIZE))
    rate = motion.period / (2 * np.pi)

    def rates(time, state):
        angle, speed = state
        slope, curvature = (float(motion.derivative(angle * rate, k)) * rate**k for k in (1, 2))
        taken = (CART.mass * curvature * speed**2 + SIZE * np.sign(slope)) * slope
        return [speed, (float(motor.torque(speed)) - taken) / (motor.inertia + CART.mass * slope**2)]

    state, time = [0.0, run.speed[0]], 0.0
    for angle in (0.5 * np.pi, np.pi, 1.7 * np.pi, 2 * np.pi):  # the friction changes its sign at pi
        k = np.abs(run.angle - angle).argmin()
        got = solve_ivp(rates, (time, run.time[k]), state, "DOP853", rtol=1e-10, atol=1e-12, max_step=0.01)
        time, state = run.time[k], got.y[:, -1]
        assert state == pytest.approx([run.angle[k], run.speed[k]], rel=1e-7)


# hard cases


@pytest.mark.parametrize("name", KINDS)
def test_heavy_flywheel_turns_evenly(name):
    run = simulate_motor(CART_OF_C, Motor(KLOSS, 150.0, 0.0, 1e9), published(name), dry(SIZE))
    even = simulate(CART_OF_C, Rigid(), published(name, run.period / 2), dry(SIZE))
    assert run.fluctuation < 1e-6
    assert run.peak_force == pytest.approx(even.peak_force, rel=1e-6)
    assert run.peak_power == pytest.approx(even.peak_power, rel=1e-6)
    assert run.rms_power == pytest.approx(even.rms_power, rel=1e-6)
    assert run.nonuniformity == pytest.approx(even.nonuniformity, rel=1e-4, abs=1e-6)
    assert run.peak_jerk == pytest.approx(even.peak_jerk, rel=1e-3)
    assert run.drawn_energy == pytest.approx(run.energy, rel=1e-6)
    law_itself = simulate(CART_OF_C, Rigid(), published(name), dry(SIZE))
    assert run.ringing == pytest.approx(even.peak_force / law_itself.peak_force, rel=1e-6)


def test_crank_at_even_speed_is_the_turn_of_the_shaft():
    crank = Crank(0.2, 0.8)
    run = simulate_motor(
        CART_OF_C, Motor(KLOSS, 150.0, 0.0, 1e9, USUAL_ANGLES[3], crank), published("crank"), dry(SIZE)
    )
    even = turn(CART_OF_C, crank, 2 * np.pi / run.period, dry(SIZE), USUAL_ANGLES[3])
    assert np.abs(run.shaft_torque).max() == pytest.approx(even.peak_torque, rel=1e-3)
    mean = np.sum(run.weights * run.shaft_torque * run.speed) / run.period
    assert mean == pytest.approx(even.mean(even.power), rel=1e-6)


def test_four_cranks_without_inertia_peak_by_the_known_ratio():
    """pi/(2 sqrt 2), whatever the rod (errata C-4)."""
    cart = replace(CART, mass=0.0)
    motor = Motor(KLOSS, 150.0, 0.0, 1e9, USUAL_ANGLES[4], Crank(0.2, 0.8))
    run = simulate_motor(cart, motor, published("crank"), dry(2 * SIZE / 4))
    mean = np.sum(run.weights * run.shaft_torque) / run.period
    assert run.shaft_torque.max() / mean == pytest.approx(np.pi / (2 * math.sqrt(2)), rel=1e-3)


def test_resistance_to_acceleration_is_a_mass():
    motor = Motor(KLOSS, 150.0, 0.0, 5.0)
    heavy = simulate_motor(replace(CART, mass=1400.0), motor, published("cubic"), dry(SIZE))
    resisting = simulate_motor(CART, motor, published("cubic"), lambda v, a: SIZE * np.sign(v) + 400 * a)
    assert resisting.peak_force == pytest.approx(heavy.peak_force, rel=1e-9)
    assert resisting.period == pytest.approx(heavy.period, rel=1e-12)


@pytest.mark.parametrize("name", ["cubic", "parabolic"])
def test_steep_motor_on_a_bare_shaft_is_resolved(name):
    run = simulate_motor(CART_OF_C, Motor(KLOSS, 150.0, 0.0, 1.0), published(name), dry(SIZE))
    assert run.energy_residual < 1e-8
    assert run.energy == pytest.approx(0.8 * (SIZE + 0.008 * 9480), rel=1e-6)


def test_flywheel_and_more_carts_steady_the_shaft():
    soft = Kloss(40.0, 0.6, 157.0)
    runs = {
        (inertia, carts): simulate_motor(
            CART, Motor(soft, 100.0 * carts, 0.0, inertia, USUAL_ANGLES[carts]), published("cubic"), dry(SIZE)
        )
        for inertia in (10.0, 3e5)
        for carts in (1, 2)
    }
    fluctuation = {key: run.fluctuation for key, run in runs.items()}
    assert fluctuation[3e5, 1] < fluctuation[10.0, 1] / 2
    assert fluctuation[10.0, 2] < fluctuation[10.0, 1]


def test_peaks_lie_between_the_samples():
    run = simulate(CART_OF_C, Motor(KLOSS, 150.0, 0.0, 5.0), published("quintic"), dry(SIZE))
    assert np.abs(run.drive_force).max() <= run.peak_force * (1 + 1e-9)
    assert run.peak_force == pytest.approx(np.abs(run.drive_force).max(), rel=1e-2)
    assert math.isfinite(run.peak_jerk)


# properties


@settings(max_examples=25)
@given(st.sampled_from(["cubic", "quintic", "harmonic"]), st.floats(0, 4), st.floats(0, 5e3), st.floats(0.1, 0.6))
def test_any_motor_balances_its_work(name, power, size, slip):
    motor = Motor(Kloss(60.0, slip, 157.0), 150.0, 0.0, 10**power)
    run = simulate_motor(CART, motor, published(name), dry(size))
    assert run.energy == pytest.approx(0.8 * size, rel=1e-6, abs=1e-3)
    assert run.energy_residual < 1e-6 or size < 1
    assert run.period == pytest.approx(run.time[-1], rel=1e-9)


# cost


@pytest.mark.parametrize("name", KINDS)
def test_turn_costs_few_steps(name):
    run = simulate_motor(CART_OF_C, Motor(KLOSS, 150.0, 0.0, 20.0), published(name), dry(SIZE))
    assert run.turn.iterations <= 60
    assert len(run.turn.angle) <= 80


# refusals


def test_weak_motor_stalls():
    with pytest.raises(RuntimeError, match=r"the motor stalls: the carts take .* N m on the mean at .* it gives"):
        simulate_motor(CART, Motor(Kloss(4.0, 0.15, 157.0), 100.0, 0.0, 10.0), published("cubic"), dry(SIZE))


def test_motor_too_weak_for_the_peak_is_told():
    """Strong enough on the mean, yet the cart stops it in the middle of its way."""
    with pytest.raises(
        RuntimeError, match=r"no balance of the shaft in .* the motor is too weak, or give more inertia"
    ):
        simulate_motor(replace(CART, mass=0.0), Motor(KLOSS, 13.0, 0.0, 0.01), published("septic"), dry(SIZE))


@pytest.mark.parametrize("name", ["constant-velocity", "gear-sector"])
def test_law_that_jumps_is_refused(name):
    with pytest.raises(ValueError, match=f"the velocity of '{name}' jumps, which no motor can follow"):
        simulate_motor(CART, Motor(KLOSS, 150.0, 0.0, 1.0), published(name), dry(SIZE))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Kloss(0.0, 0.1, 157.0), "`breakdown_torque` must be positive"),
        (lambda: LinearTorqueCurve(1.0, math.nan), "`no_load_speed` must be positive"),
        (lambda: Motor(KLOSS, 0.0, 0.0, 1.0), "`gear_ratio` must be positive"),
        (lambda: Motor(KLOSS, 1.0, -1.0, 1.0), "`motor_inertia` must be zero or positive"),
        (lambda: Motor(KLOSS, 1.0, 1.0, 1.0, ()), "`angles` must hold one angle per cart, got none"),
    ],
)
def test_impossible_motors_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_torque_that_is_noise_is_refused_within_bounds():
    """Elements are halved until they resolve the torque: of noise there would be no end."""
    rng = np.random.default_rng(2)

    class Noisy(Even):
        def torque(self, speed):
            return self.size * (1 + 1e-3 * rng.standard_normal(np.shape(speed)))

    with pytest.raises(RuntimeError, match=r"no balance of the shaft|not resolved by \d{1,5} elements; is the torque"):
        simulate_motor(CART, Motor(Noisy(90.0), 2.0, 0.5, 7.0), published("cubic"), dry(300.0), start_speed=5.0)


@pytest.mark.parametrize("name", ["cubic", "parabolic", "crank"])
@pytest.mark.parametrize("curve", [KLOSS, LinearTorqueCurve(60.0, 157.0)], ids=["kloss", "straight"])
def test_extremes_of_the_shaft_are_found_between_the_nodes(name, curve):
    """Against a hundred times as many samples of the same solution."""
    run = simulate_motor(CART, Motor(curve, 50.0, 0.05, 10.0, angles=(0.3,)), published(name), dry(SIZE))
    angle = np.concatenate([np.linspace(a, b, 1701) for a, b in itertools.pairwise(run.turn.breaks)])
    energy, acceleration, _ = run.turn.at(angle)
    speed, motor = np.sqrt(2 * energy), run.load.motor
    fluctuation = (speed.max() - speed.min()) * run.period / (2 * np.pi)
    nodes = (run.speed.max() - run.speed.min()) * run.period / (2 * np.pi)
    assert run.fluctuation == pytest.approx(fluctuation, rel=1e-6)
    assert run.fluctuation >= fluctuation * (1 - 1e-12)
    assert nodes <= run.fluctuation
    assert run.peak_motor_torque == pytest.approx(np.abs(motor.torque(speed)).max() / 50.0, rel=1e-6)
    assert run.peak_motor_torque * (1 + 1e-12) >= np.abs(motor.torque(speed)).max() / 50.0
    assert run.peak_motor_power == pytest.approx(np.abs(motor.power(speed, acceleration)).max(), rel=1e-6)
    assert (run.least_speed, run.largest_speed) == pytest.approx((speed.min(), speed.max()), rel=1e-7)


def test_fluctuation_of_an_even_torque_without_load_is_that_of_the_energy():
    """(J + m x'^2) phi'^2 is kept by a cart without resistance: phi' swings between 1 and sqrt(J/(J + m x'^2))."""
    run = simulate_motor(CART, Motor(Even(0.0), 1.0, 0.0, 4.0), published("quintic"), free, start_speed=5.0)
    fastest = 15 / 8 * 0.4 / np.pi  # x' by the angle, in the middle of the way: half a turn is a pass
    assert run.largest_speed == pytest.approx(5.0, rel=1e-12)
    assert run.least_speed == pytest.approx(5.0 * math.sqrt(4 / (4 + CART.mass * fastest**2)), rel=1e-9)
