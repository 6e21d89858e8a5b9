"""A cart behind a spring: closed forms, order, an independent solution, stick and slip, what it costs."""

import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from interrupts import interrupted
from published import CART_OF_C
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from compact.drive import simulate
from compact.dynamics import event_driven, oscillator
from compact.dynamics.collocation import POINTS
from compact.dynamics.event_driven import integrate, peaks, room
from compact.dynamics.force_elements import CartState, Resistance, Spring
from compact.dynamics.oscillator import Signal, effort, first_fall, largest_product
from compact.dynamics.trajectory import MOST_SAMPLES, SAMPLES, TURN, Course
from compact.machine.cart import EndSprings
from compact.machine.elastic_cycle import PeriodicProblem
from compact.machine.elastic_drive import ElasticDrive, damping_ratio, simulate_elastic
from compact.motion.profile import LAWS, Cycle, law
from compact.numerics.piecewise import PiecewisePolynomial, fit_piecewise
from compact.resistance import ResistanceMap

CART = replace(CART_OF_C, guide_friction=0.0)
MASS = CART.mass
IMPULSIVE = ("constant-velocity", "gear-sector")
GENTLE = [name for name in LAWS if name not in IMPULSIVE]
RATIOS = (0.0, 0.05, 0.7, 1.0, 3.0)
STIFF = (1e4, 1e6, 1e9)


def published(name):
    return law(name, stroke=0.4, duration=3.0, rod_length=0.8)


def spring(stiffness, ratio, backlash=0.0):
    return ElasticDrive(stiffness, 2 * ratio * math.sqrt(stiffness * MASS), backlash)


def free(velocity, acceleration):
    return np.zeros_like(velocity)


def dry(size):
    return lambda velocity, acceleration: size * np.sign(velocity)


def falling(velocity, acceleration):
    """Dry friction that falls with the speed and rises again (Stribeck), smooth on each side of 0."""
    speed = np.abs(velocity)
    return np.sign(velocity) * (2000 + 1500 * np.exp(-speed / 0.05) + 4000 * speed**2)


RELAXED = CartState(0.0, 0.0, 1)


def moved(drive, position, time, size=0.0, state=RELAXED):
    """`Course` of the cart over a time, the far end at a polynomial position of time, against dry friction."""
    scaled = np.array([[c * time**j for j, c in enumerate(position)] + [0.0] * (11 - len(position))])
    side = PiecewisePolynomial(np.array([0.0, 100.0]), np.array([[size] + [0.0] * 8]))
    back = PiecewisePolynomial(side.breaks, -side.coefficients)
    arcs = room(1000, 10)
    numbers = Spring(MASS, float(drive.stiffness), float(drive.damping), float(drive.backlash))
    far_end = PiecewisePolynomial(np.array([0.0, time]), scaled)
    resistance = Resistance(side, back, np.empty(0))
    ended, n, _, end, _ = integrate(numbers, far_end, resistance, state, 1e-9, arcs)
    assert ended == 0
    kept = type(arcs)(*(column[:n].copy() for column in arcs))
    return Course(numbers, kept, resistance, state, end)


def roots(drive):
    decay, square = drive.damping / (2 * MASS), drive.stiffness / MASS
    swing = np.emath.sqrt(decay**2 - square + 0j)
    return -decay + swing, -decay - swing


def swung(drive, t, stretch, rate):
    """Free oscillation from a stretch and its rate, in closed form."""
    one, two = roots(drive)
    if abs(one - two) < 1e-6 * abs(one):
        one = (one + two) / 2
        return np.real(np.exp(one * t) * (stretch + (rate - one * stretch) * t))
    a = (rate - two * stretch) / (one - two)
    return np.real(a * np.exp(one * t) + (stretch - a) * np.exp(two * t))


# closed form


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("stiffness", STIFF)
def test_step_of_acceleration(stiffness, ratio):
    """e = m a/k (1 - free oscillation from 1)."""
    drive, a = spring(stiffness, ratio), 0.3
    course = moved(drive, (0, 0, a / 2), 1.0)
    t = np.linspace(0, 1, 501)
    exact = MASS * a / stiffness * (1 - swung(drive, t, 1.0, 0.0))
    stretch, _ = course.stretch(*course.at(t))
    assert stretch == pytest.approx(exact, abs=1e-8 * MASS * a / stiffness)
    force = course.force(*course.at(t))
    damped = drive.damping * np.gradient(exact, t, edge_order=2) if ratio == 0 else force - stiffness * stretch
    assert force == pytest.approx(stiffness * exact + damped, abs=1e-7 * MASS * a)


@pytest.mark.parametrize("ratio", [0.05, 0.7, 1.0, 3.0])
@pytest.mark.parametrize("stiffness", STIFF)
def test_harmonic_law_in_the_periodic_regime(stiffness, ratio):
    """e = Re(A exp(i w t)), A = m s w^2/2/(k - m w^2 + i c w), for y = s/2 (1 - cos w t)."""
    drive, w = spring(stiffness, ratio), np.pi / 3.0
    run = simulate_elastic(CART, drive, published("harmonic"), free)
    amplitude = MASS * 0.2 * w**2 / (stiffness - MASS * w**2 + 1j * drive.damping * w)
    force = np.real((stiffness + 1j * drive.damping * w) * amplitude * np.exp(1j * w * run.time))
    assert np.abs(run.drive_force - force).max() < 1e-8 * MASS * 0.2 * w**2
    assert run.peak_force == pytest.approx(abs((stiffness + 1j * drive.damping * w) * amplitude), rel=1e-8)
    assert run.work.rounds <= 1  # a linear map: Newton's method is exact


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("stiffness", STIFF)
def test_harmonic_law_from_rest(stiffness, ratio):
    drive, w = spring(stiffness, ratio), np.pi / 3.0
    run = simulate_elastic(CART, drive, published("harmonic"), free, regime="rest")
    amplitude = MASS * 0.2 * w**2 / (stiffness - MASS * w**2 + 1j * drive.damping * w)
    exact = np.real(amplitude * np.exp(1j * w * run.time))
    exact = exact + swung(drive, run.time, -amplitude.real, -np.real(1j * w * amplitude))
    stretch, _ = run.course.stretch(*run.course.at(run.time))
    assert np.abs(stretch - exact).max() < 1e-8 * MASS * 0.2 * w**2 / stiffness
    assert np.abs(run.state.position + exact - run.cycle.derivative(run.time, 0)).max() < 1e-12 * 0.4


@pytest.mark.parametrize("stiffness", STIFF)
def test_undamped_step_of_acceleration_overshoots_by_two(stiffness):
    course = moved(ElasticDrive(stiffness, 0.0), (0, 0, 0.15), 5.0)
    numbers = Spring(MASS, stiffness, 0.0, 0.0)
    assert peaks(numbers, course.arcs)[0] == pytest.approx(2 * MASS * 0.3, rel=1e-9)


@pytest.mark.parametrize("stiffness", [1e5, 1e6, 1e7, 1e8, 1e9])
def test_jump_of_jerk_rings_with_the_root_of_the_stiffness(stiffness):
    """y = J t^3/6: the force swings about m J t by m J sqrt(m/k)."""
    jerk, time = 0.9, 1.0
    course = moved(ElasticDrive(stiffness, 0.0), (0, 0, 0, jerk / 6), time)
    i, u, _ = course.places()
    t = course.arcs.start[i] + course.arcs.span[i] * u
    w = math.sqrt(stiffness / MASS)
    error = course.force(i, u) - MASS * jerk * t
    assert error == pytest.approx(-MASS * jerk / w * np.sin(w * t), abs=1e-8 * MASS * jerk)
    assert np.abs(error).max() == pytest.approx(MASS * jerk / w, rel=5e-3)


@pytest.mark.parametrize("stiffness", STIFF)
@pytest.mark.parametrize("ratio", [0.0, 0.05])
def test_friction_holds_the_cart_until_the_spring_pulls_enough(stiffness, ratio):
    """Far end at V t: k V t + c V = F."""
    drive, pace, size = spring(stiffness, ratio), 0.01, 3486.0
    time = 1.5 * size / stiffness / pace
    course = moved(drive, (0, pace), time, size)
    assert course.arcs.slip[:2].tolist() == [0, 1]
    assert course.arcs.length[0] == pytest.approx((size / pace - drive.damping) / stiffness, rel=1e-9)


@pytest.mark.parametrize("stiffness", STIFF)
def test_cart_that_runs_against_the_spring_stops_in_time(stiffness):
    """v = v0 cos w t - F w/k sin w t, so tan(w t) = v0 k/(F w); it stays if the spring pulls less than the friction."""
    w, size, speed = math.sqrt(stiffness / MASS), 3486.0, 0.01
    course = moved(ElasticDrive(stiffness, 0.0), (0.0,), 10 / w, size, CartState(0.0, speed, 1))
    assert course.arcs.length[0] == pytest.approx(math.atan2(speed * stiffness, size * w) / w, rel=1e-9)


@pytest.mark.parametrize("stiffness", STIFF)
def test_turn_knocks_however_stiff_the_spring(stiffness):
    """Braked with a, the cart stops at e = (F - m a)/k, and is set off backwards by a far end that has gathered speed:
    the peak is F + m a + sqrt(4 F m a - (m a)^2)."""
    size, inertia, w = 3486.0, MASS * 0.2, math.sqrt(stiffness / MASS)
    start = CartState((size - inertia) / stiffness, 0.0, 1)
    time = math.sqrt(2 * (2 * size - inertia) / stiffness / 0.2) + 7 / w
    course = moved(ElasticDrive(stiffness, 0.0), (0, 0, -0.1), time, size, start)
    peak = peaks(Spring(MASS, stiffness, 0.0, 0.0), course.arcs)[0]
    assert peak == pytest.approx(size + inertia + math.sqrt(4 * size * inertia - inertia**2), rel=1e-9)


@pytest.mark.parametrize("stiffness", STIFF)
@pytest.mark.parametrize("start", [2.5, 7.3, 12.9])
def test_coulomb_oscillator_stands_after_whole_half_swings(stiffness, start):
    """From a stretch of `start` F/k each half swing takes 2 F/k, until no more than F/k is left."""
    size, half = 3486.0, math.pi / math.sqrt(stiffness / MASS)
    swings = math.ceil((start - 1) / 2)
    course = moved(ElasticDrive(stiffness, 0.0), (0.0,), 10 * half, size, CartState(start * size / stiffness, 0.0, 1))
    assert course.arcs.slip.tolist() == [(-1) ** i for i in range(swings)] + [0]
    assert course.arcs.length[:-1] == pytest.approx(np.full(swings, half), rel=1e-9)
    assert course.end.stretch * stiffness / size == pytest.approx((-1) ** swings * (start - 2 * swings), abs=1e-9)
    assert course.end.velocity == 0


@pytest.mark.parametrize("stiffness", STIFF)
def test_backlash_throws_the_cart_to_and_fro(stiffness):
    """Far end at V t, cart free: b/2V to the flank, half a swing on it, thrown with 2 V, b/V to the other flank."""
    pace, backlash, half = 0.1, 1e-3, math.pi / math.sqrt(stiffness / MASS)
    course = moved(ElasticDrive(stiffness, 0.0, backlash), (0, pace), 0.05 + 3 * half, state=CartState(0.0, 0.0, 0))
    changes = np.flatnonzero(np.diff(course.arcs.side)) + 1
    assert course.arcs.side[changes[:4]].tolist() == [1, 0, -1, 0]
    exact = np.cumsum([backlash / pace / 2, half, backlash / pace, half])
    assert course.arcs.start[changes[:4]] == pytest.approx(exact, rel=1e-8)
    _, velocity, *_ = course.motion(*course.at(course.arcs.start[changes[1:2]]))
    assert velocity == pytest.approx([2 * pace], rel=1e-9)


@pytest.mark.parametrize("ratio", [0.05, 0.7])
@pytest.mark.parametrize("stiffness", STIFF)
def test_added_mass_moves_with_the_cart(stiffness, ratio):
    """As the harmonic law of a cart of m + M."""
    drive, w, mass = replace(spring(stiffness, ratio), first_order=True), np.pi / 3.0, MASS + 400.0
    run = simulate_elastic(CART, drive, published("harmonic"), lambda velocity, acceleration: 400.0 * acceleration)
    amplitude = mass * 0.2 * w**2 / (stiffness - mass * w**2 + 1j * drive.damping * w)
    assert run.peak_force == pytest.approx(abs((stiffness + 1j * drive.damping * w) * amplitude), rel=1e-8)
    assert run.state.resistance == pytest.approx(400.0 * run.state.acceleration, abs=1e-6)
    assert run.energy_residual < 1e-6


def power(exponent, size=3486.0):
    """A map of a mix that resists with a power of the speed."""
    speeds = np.geomspace(0.2 / 30, 0.6, 9)
    return ResistanceMap(speeds, size * (speeds / 0.2) ** exponent, 1e-3)


@pytest.mark.parametrize("exponent", [0.02, 0.1])
def test_cart_that_a_power_of_the_speed_brakes_stops_in_time(exponent):
    """m v' = -C v^n: after m v^(1-n)/(C (1-n)), m v^(2-n)/(C (2-n)) on."""
    drive, speed, met = ElasticDrive(1e-6, 0.0), 0.005, power(exponent)  # below all samples
    size = 3486.0 / 0.2**exponent
    time = MASS * speed ** (1 - exponent) / size / (1 - exponent)
    problem = PeriodicProblem(CART, drive, published("cubic").cycle(), met, 1e-8)
    still = PiecewisePolynomial(np.array([0.0, 2 * time]), np.zeros((1, 11)))
    arcs, end = problem.course(still, CartState(0.0, speed, 1))
    assert end.velocity == 0
    assert arcs.start[-1] == pytest.approx(time, abs=1e-6)
    assert -end.stretch == pytest.approx(MASS * speed ** (2 - exponent) / size / (2 - exponent), rel=1e-5)
    assert arcs.slip.tolist() == [1] * (len(arcs.start) - 1) + [0]


@pytest.mark.parametrize("name", ["complex", "quintic", "parabolic"])
def test_work_is_accounted_for_while_a_lag_is_held(name):
    speeds = np.geomspace(0.2 / 30, 0.6, 12)
    lags = -800.0 / (1 + (speeds / 0.06) ** 2)
    met = ResistanceMap(speeds, 6e4 * speeds / (1 + (speeds / 0.06) ** 2), 1e-3, None, lags, relaxation_time=0.1)
    run = simulate_elastic(CART_OF_C, replace(spring(1e6, 0.05), first_order=True), published(name), met)
    assert run.energy_residual < 1e-6
    assert run.work.arcs < 3000


@pytest.mark.parametrize("name", GENTLE)
def test_small_power_of_the_speed_holds_without_chattering(name):
    run = simulate_elastic(CART_OF_C, spring(1e6, 0.05), published(name), power(0.02))
    turns = np.count_nonzero(np.diff(np.abs(run.course.arcs.slip)) == -1)
    assert run.standing > 0.1
    assert turns <= 12  # stops of a cycle: two turns, and knocks that swing
    assert run.work.arcs < 1500
    assert run.energy_residual < 1e-6


def test_ever_smaller_powers_end_as_dry_friction():
    drive, motion = spring(1e6, 0.05), published("cubic")
    exact = simulate_elastic(CART, drive, motion, dry(3486.0)).peak_force
    errors = [abs(simulate_elastic(CART, drive, motion, power(n)).peak_force / exact - 1) for n in (1e-2, 1e-3, 1e-4)]
    assert errors[2] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.3)


@pytest.mark.parametrize("exponent", [0.02, 0.3, 0.96])
def test_creep_is_as_good_as_standing(exponent, monkeypatch):
    drive, motion = spring(1e6, 0.05), published("cubic")
    one = simulate_elastic(CART, drive, motion, power(exponent)).peak_force
    monkeypatch.setattr("compact.machine.elastic_cycle.CREEPING", 1e-5)  # ten times as much
    assert simulate_elastic(CART, drive, motion, power(exponent)).peak_force == pytest.approx(one, rel=1e-5)


# order


def test_error_falls_with_the_order_of_the_collocation():
    drive, motion = spring(1e5, 0.3), published("harmonic")
    cubic = lambda velocity, acceleration: 3000 * velocity + 8e5 * velocity**3  # noqa: E731
    exact = simulate_elastic(CART, drive, motion, cubic, regime="rest", tolerance=1e-12).course
    arcs, errors = [], []
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9):
        run = simulate_elastic(CART, drive, motion, cubic, regime="rest", tolerance=tolerance)
        arcs.append(run.work.arcs)
        times = np.linspace(0.1, 5.9, 30)
        force, true = (course.force(*course.at(times)) for course in (run.course, exact))
        errors.append(np.abs(force - true).max() / np.abs(true).max())
    assert np.all(np.array(errors) < [2e-3, 2e-5, 2e-7, 2e-9])
    rate = np.polyfit(np.log(arcs), np.log(errors), 1)[0]
    assert rate < -(POINTS - 1), f"arcs {arcs}, errors {errors}"


# independent solution


class Plain:
    """The same cart by a general solver in position and velocity, its events found by sampling and halving."""

    def __init__(self, drive, cycle, resistance):
        self.drive, self.cycle, self.x, self.v = drive, cycle, 0.0, 0.0
        self.most = float(resistance(np.array([1e-12]), np.zeros(1))[0])
        self.total = lambda speed: float(resistance(np.array([max(speed, 1e-12)]), np.zeros(1))[0])

    def pull(self, t, x, v):
        y, pace = (self.cycle.derivative(t, order) for order in (0, 1))
        return self.drive.stiffness * (y - x) + self.drive.damping * (pace - v)

    def follow(self, start, stop):
        """From one join of the law to the next."""
        time, last = start, stop - 1e-12
        while time < last:
            first = time + 1e-12
            if self.v == 0 and abs(self.pull(first, self.x, 0.0)) <= self.most * (1 + 1e-9):
                time = self.released(first, last)
                continue
            sign = np.sign(self.v) or np.sign(self.pull(first, self.x, 0.0))
            time = self.slid(time, last, sign)

    def released(self, time, last):
        """When the spring first overcomes the friction."""
        fine = np.linspace(time, last, 4001)
        held = lambda t: np.abs(self.pull(t, self.x, 0.0)) <= self.most * (1 + 1e-9)  # noqa: E731
        over = np.flatnonzero(~held(fine))
        if not over.size:
            return last
        low, high = fine[max(over[0] - 1, 0)], fine[over[0]]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if held(middle) else (low, middle)
        return high

    def slid(self, time, last, sign):
        """When the speed first gets zero."""

        def rates(t, z):
            return [z[1], (self.pull(t, *z) - sign * self.total(sign * z[1])) / MASS]

        def rest(t, z):
            return sign * z[1] + (1.0 if t <= time + 1e-7 else 0.0)

        rest.terminal, rest.direction = True, -1
        got = solve_ivp(rates, (time, last), [self.x, self.v], "DOP853", events=rest, rtol=1e-10, atol=1e-13)
        self.x, self.v = got.y[0, -1], 0.0 if got.status == 1 else got.y[1, -1]
        return got.t[-1]


@pytest.mark.parametrize("name", ["quintic", "parabolic"])
def test_general_solver_agrees_with_stick_and_slip(name):
    ends = (1.3, 2.2, 3.6, 4.7, 5.5)
    drive, cycle = spring(2e5, 0.1), published(name).cycle()
    course = simulate_elastic(CART, drive, cycle, falling, regime="rest").course
    plain = Plain(drive, cycle, falling)
    joins = {leg.start + leg.duration * z for leg in cycle.legs() for z in leg.breakpoints()}
    for start, stop in itertools.pairwise(sorted({time for time in joins if time < ends[-1]} | set(ends))):
        plain.follow(start, stop)
        if stop in ends:
            position, velocity, *_ = course.motion(*course.at(np.array([stop])))
            assert position == pytest.approx([plain.x], abs=1e-8)
            assert velocity == pytest.approx([plain.v], abs=1e-7)


def test_general_solver_agrees_with_a_map_and_its_added_mass():
    """A relaxing mix: F falls again, M is a lag that is held where |a| tau/|v| is not small."""
    speeds = np.geomspace(0.2 / 30, 0.6, 12)
    forces, lags = 6e4 * speeds / (1 + (speeds / 0.06) ** 2), -600.0 / (1 + (speeds / 0.06) ** 2)
    met = ResistanceMap(speeds, forces, 1e-3, None, lags, relaxation_time=0.1)
    drive, cycle = replace(spring(2e5, 0.1), first_order=True), published("harmonic").cycle()
    run = simulate_elastic(CART, drive, cycle, met, regime="rest")

    def acceleration(pull, v):
        return brentq(lambda a: MASS * a + float(met(v, a)) - pull, -1e2, 1e2, xtol=1e-13)

    def rates(t, z):
        pull = drive.stiffness * (float(cycle.derivative(t, 0)) - z[0])
        return [z[1], acceleration(pull + drive.damping * (float(cycle.derivative(t, 1)) - z[1]), z[1])]

    got = solve_ivp(rates, (0, 2.0), [0.0, 0.0], "DOP853", rtol=1e-8, atol=1e-11, t_eval=[0.5, 1.2, 2.0])
    position, velocity, *_ = run.course.motion(*run.course.at(got.t))
    assert position == pytest.approx(got.y[0], abs=1e-7)
    assert velocity == pytest.approx(got.y[1], abs=2e-6)


# hard cases


@pytest.mark.parametrize("name", GENTLE)
def test_stiff_spring_follows_the_law(name):
    run = simulate_elastic(CART, spring(1e9, 0.05), published(name), free)
    assert np.abs(run.state.position - run.cycle.derivative(run.time, 0)).max() < 1e-5 * 0.4


@pytest.mark.parametrize("name", GENTLE)
def test_stiff_spring_under_load_gives_way_by_its_own_stretch_only(name):
    run = simulate_elastic(CART_OF_C, spring(1e9, 0.7), published(name), dry(3486.0))
    lag = run.cycle.derivative(run.time, 0) - run.state.position
    assert np.abs(lag).max() <= run.peak_force / 1e9 * (1 + 1e-6)


def test_septic_law_does_not_ring_a_stiff_spring():
    run = simulate_elastic(CART, spring(1e9, 0.7), published("septic"), free)
    inertia = MASS * run.cycle.derivative(run.time, 2)
    assert np.abs(run.drive_force - inertia).max() < 1e-3 * np.abs(inertia).max()
    assert run.ringing == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "stiffness"), [*((name, 1e6) for name in LAWS), ("cubic", 1e5), ("parabolic", 1e9), ("gear-sector", 1e9)]
)
def test_work_of_the_drive_is_accounted_for(name, stiffness):
    run = simulate_elastic(CART_OF_C, spring(stiffness, 0.05), published(name), falling)
    assert run.energy_residual < 1e-6
    assert run.shocks  # friction that stops a cart lets its acceleration jump


@pytest.mark.parametrize("name", ["quintic", "parabolic", "reversal-4", "constant-velocity"])
@pytest.mark.parametrize("backlash", [1e-4, 2e-3])
@pytest.mark.parametrize("regime", ["rest", "periodic"])
def test_work_is_accounted_for_with_backlash(name, backlash, regime):
    run = simulate_elastic(
        CART, spring(1e6, 0.1, backlash), published(name).cycle(0.5, 0.2), dry(1500.0), regime=regime
    )
    assert run.energy_residual < 1e-6
    assert {-1, 0, 1} >= set(run.course.arcs.side.tolist()) > {0}


@pytest.mark.parametrize("resistance", [dry(3486.0), falling], ids=["dry", "falling"])
def test_periodic_regime_is_where_waiting_leads(resistance):
    drive, motion = spring(1e5, 0.1), published("cubic").cycle(0.3, 0.3)
    run = simulate_elastic(CART, drive, motion, resistance)
    assert run.course.end[:2] == pytest.approx(run.course.start[:2], rel=1e-8, abs=1e-12)
    problem = PeriodicProblem(CART, drive, motion, resistance, 1e-8)
    state = problem.at_rest
    for _ in range(12):
        _, state = problem.course(problem.law, state)
    assert state[:2] == pytest.approx(run.course.start[:2], rel=1e-8, abs=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-12])
@pytest.mark.parametrize("name", ["septic", "modified-trapezoid", "parabolic"])
def test_friction_that_is_rounding_holds_nothing(name, size):
    cart, drive = replace(CART, mass=10.0), ElasticDrive(5e6, 8 * math.sqrt(5e6 * 10.0))
    cubic = lambda velocity, acceleration: size * np.sign(velocity) + 1e5 * velocity**3  # noqa: E731
    run = simulate_elastic(cart, drive, published(name), cubic, regime="rest")
    assert run.standing < 1e-6
    assert run.energy_residual < 1e-6


# laws whose velocity jumps, behind an undamped spring: mass, stiffness, dry friction, dwell
UNDAMPED = {
    "heavy spring": ("gear-sector", 50.0, 6.66e4, 3486.0, 0.0),
    "with a dwell": ("gear-sector", 50.0, 6.66e4, 3486.0, 0.5),
    "slow to close": ("gear-sector", 119.3, 5.78e5, 1036.0, 0.0),
    "double root": ("constant-velocity", 18.54, 1.619e4, 255.2, 0.0),
}


@pytest.mark.parametrize("name", UNDAMPED)
def test_undamped_cart_that_sets_off_from_rest_peaks_at_friction_and_impact(name):
    """It swings about F/k at the pace V of the far end, and just comes to rest once in each: F + V sqrt(k m)."""
    law_name, mass, stiffness, size, dwell = UNDAMPED[name]
    cart = replace(CART, mass=mass)
    run = simulate_elastic(cart, ElasticDrive(stiffness, 0.0), published(law_name).cycle(dwell, dwell), dry(size))
    assert run.peak_force == pytest.approx(size + 0.4 / 3 * math.sqrt(stiffness * mass), rel=1e-8)
    assert run.course.end[:2] == pytest.approx(run.course.start[:2], rel=1e-8)
    assert run.energy_residual < 1e-6
    assert run.work.rounds < 25


def test_undamped_cart_near_a_resonance_closes_relative_to_its_swing():
    cart = replace(CART, mass=66.6873805120988)
    run = simulate_elastic(cart, ElasticDrive(5953.296791504955, 0.0), published("reversal-2"), free)
    assert run.energy_residual < 1e-6
    assert run.work.rounds <= 2


def test_cart_of_a_dwell_stands_still_exactly():
    run = simulate_elastic(CART, spring(1e6, 0.1), published("quintic").cycle(1.0, 1.0), dry(3486.0))
    standing = run.course.arcs.slip[run.course.places()[0]] == 0
    assert run.standing > 2.0
    assert np.all(run.state.velocity[standing] == 0)
    assert np.all(np.abs(run.drive_force[standing]) <= 3486.0 * (1 + 1e-9))


def test_tolerance_of_the_default_holds_the_peak():
    drive, motion = spring(3e5, 0.05), published("harmonic")
    one, tight = (simulate_elastic(CART, drive, motion, falling, tolerance=tolerance) for tolerance in (1e-8, 1e-10))
    assert one.peak_force == pytest.approx(tight.peak_force, rel=1e-7)
    loose = simulate_elastic(CART, drive, motion, falling, tolerance=1e-5)
    assert loose.peak_force == pytest.approx(tight.peak_force, rel=1e-4)


def test_peak_is_not_missed_between_samples():
    run = simulate_elastic(CART, spring(1e7, 0.02), published("reversal-2"), dry(3486.0))
    assert np.abs(run.drive_force).max() <= run.peak_force * (1 + 1e-12)
    assert run.peak_force == pytest.approx(np.abs(run.drive_force).max(), rel=1e-3)
    assert np.abs(run.drive_power).max() <= run.peak_power * (1 + 1e-12)


def test_spring_makes_a_jump_of_velocity_bearable():
    """Undamped, the far end starting at V against friction: F + V sqrt(k m)."""
    run = simulate_elastic(
        CART, ElasticDrive(1e6, 0.0), published("gear-sector").cycle(1.0, 1.0), dry(3486.0), regime="rest"
    )
    first = run.drive_force[run.time < 0.5]
    assert np.abs(first).max() == pytest.approx(3486.0 + 0.4 / 3 * math.sqrt(1e6 * MASS), rel=1e-2)
    assert math.isinf(run.rigid.peak_force)
    assert math.isnan(run.ringing)


def test_guide_friction_is_that_of_the_rigid_drive():
    elastic = simulate_elastic(CART_OF_C, spring(1e9, 0.7), published("septic"), dry(3486.0))
    moving = np.abs(elastic.state.velocity) > 1e-3
    assert np.abs(elastic.state.forces.guide_friction[moving]) == pytest.approx(0.008 * 9480, rel=1e-9)
    balance = MASS * elastic.state.acceleration + elastic.state.resistance + elastic.state.forces.guide_friction
    assert elastic.drive_force == pytest.approx(balance, abs=1e-6 * elastic.peak_force)


@pytest.mark.parametrize("name", ["cubic", "harmonic", "modified-trapezoid", "complex"])
def test_law_as_polynomials_is_the_law(name):
    run = simulate_elastic(CART, spring(1e6, 0.7), published(name), free)
    i, u, _ = run.course.places()
    for order, share in enumerate((1e-12, 1e-12, 1e-9)):
        exact = run.cycle.derivative(np.clip(run.time, 1e-12, None), order)
        inner = np.abs(np.subtract.outer(run.time, [0, 1.5, 3, 4.5, 6]).round(9)).min(axis=1) > 1e-6
        got = run.course.far_end(i, u, order)
        assert got[inner] == pytest.approx(exact[inner], abs=share * np.abs(exact).max() + 1e-14)


def test_resistance_of_a_motor_driven_cart_runs_through_the_measures():
    run = simulate(CART_OF_C, spring(1e6, 0.2), published("quintic"), dry(3486.0))
    assert run.mean_power * run.period == pytest.approx(run.energy, rel=1e-12)
    assert run.drawn_energy >= run.energy
    assert run.rms_force <= run.peak_force
    assert run.dynamic_factor == run.peak_force / run.steady_force
    assert damping_ratio(CART_OF_C, spring(1e6, 0.2)) == pytest.approx(0.2, rel=1e-14)


# properties


@settings(max_examples=60)
@given(
    st.sampled_from(["quintic", "parabolic", "harmonic", "reversal-4-free-both", "constant-velocity"]),
    st.floats(4, 9),
    st.floats(0.02, 2),
    st.floats(0, 2e4),
    st.floats(0, 5e3),
    st.sampled_from([0.0, 0.3]),
)
def test_any_cart_keeps_its_energy_and_sticks_as_friction_says(name, power, ratio, size, viscous, dwell):
    resistance = lambda velocity, acceleration: size * np.sign(velocity) + viscous * velocity  # noqa: E731
    run = simulate_elastic(CART, spring(10**power, ratio), Cycle(published(name), dwell, dwell), resistance)
    assert run.energy_residual < 1e-6
    arcs, (i, _, _) = run.course.arcs, run.course.places()
    slip = arcs.slip[i]
    assert np.all(slip * run.state.velocity >= -1e-9)
    assert np.all(np.abs(run.drive_force[slip == 0]) <= size * (1 + 1e-9) + 1e-6)
    assert arcs.length.sum() == pytest.approx(run.period, rel=1e-12)


# cost


@pytest.mark.parametrize("name", LAWS)
def test_stiffness_does_not_cost(name):
    soft, stiff = (simulate_elastic(CART_OF_C, spring(k, 0.05), published(name), dry(3486.0)).work for k in (1e6, 1e9))
    assert stiff.arcs <= 3 * soft.arcs
    assert stiff.evaluations <= 3 * soft.evaluations


@pytest.mark.parametrize("name", LAWS)
def test_run_costs_few_arcs(name):
    work = simulate_elastic(CART_OF_C, spring(1e6, 0.05), published(name), dry(3486.0)).work
    assert work.rounds <= 4
    assert work.arcs < 500


@pytest.mark.parametrize("count", [10, 30])
def test_search_of_what_touches_zero_costs_no_range_for_each_oscillation(count):
    """1 + cos(w t) and its product with 1: it touches zero and its top once in each oscillation."""
    one = np.zeros(count)
    one[0] = 1.0
    touching, even = Signal(one, 1.0, 0.0, 0.0, -1e12, 1.0), Signal(one, 0.0, 0.0, 0.0, 0.0, 1.0)
    searched = effort()
    assert first_fall(touching, searched) == 2.0
    assert largest_product(touching, even, 1.0, searched) == pytest.approx(2.0, rel=1e-14)
    assert searched.tolist() <= [200, 0]


def test_stiffness_beyond_all_sense_costs_no_range_for_each_oscillation():
    """Where the speed of the law ends as (1 - z)^3, rounding touches zero in millions of oscillations."""
    run = simulate_elastic(CART, spring(1e26, 0.05), published("septic"), free)
    assert np.abs(run.drive_force).max() == pytest.approx(MASS * run.cycle.forward.peaks().acceleration, rel=1e-3)


def test_search_may_take_all_ranges_that_the_samples_of_a_cycle_resolve():
    shortest = oscillator.OSCILLATION / 2  # rad: a longer range is halved
    assert 2 * MOST_SAMPLES / SAMPLES * TURN / shortest <= oscillator.MOST_RANGES


SPRUNG = replace(CART_OF_C, end_springs=EndSprings(4e5, 500.0, 0.08, 0.4))
STICKY = {
    "stick and slip": (CART_OF_C, spring(1e6, 0.05), falling),
    "undamped": (CART_OF_C, ElasticDrive(1e6, 0.0), dry(3486.0)),
    "backlash": (CART, spring(1e6, 0.1, 2e-3), dry(1500.0)),
    "end springs": (SPRUNG, spring(1e6, 0.05, 1e-3), falling),
}


@pytest.mark.parametrize("regime", ["rest", "periodic"])
@pytest.mark.parametrize("name", ["quintic", "parabolic", "constant-velocity"])
@pytest.mark.parametrize("case", STICKY)
def test_integration_in_slices_is_the_same_bit_for_bit(case, name, regime, monkeypatch):
    """Between two slices an interrupt gets in."""
    cart, drive, resistance = STICKY[case]
    cycle = published(name).cycle(0.5, 0.2)
    if case == "undamped" and regime == "periodic":
        cycle = published(name).cycle()
    ended, advance = [], event_driven.advance

    def counted(*given):
        ended.append(advance(*given))
        return ended[-1]

    whole = simulate_elastic(cart, drive, cycle, resistance, regime=regime)
    peaks_of_whole = whole.peak_force, whole.peak_power
    monkeypatch.setattr(event_driven, "SLICE", 1)
    monkeypatch.setattr(event_driven, "advance", counted)
    sliced = simulate_elastic(cart, drive, cycle, resistance, regime=regime)
    assert ended.count(event_driven.PAUSED) >= sliced.work.arcs - sliced.work.courses
    assert (sliced.peak_force, sliced.peak_power) == peaks_of_whole
    assert sliced.work == whole.work
    for one, other in zip(sliced.course.arcs, whole.course.arcs, strict=True):
        np.testing.assert_array_equal(one, other)


# an undamped cart that nothing resists swings through a dwell, each half swing an arc: half a minute
LONG = """
import sys
from dataclasses import replace
import numpy as np
from compact import cli
from compact.machine import elastic_cycle as regime, elastic_drive as elastic

usual = elastic.travel

def travel(cart, drive, cycle, *_, **__):
    cart, spring = replace(cart, guide_friction=0.0), elastic.ElasticDrive(1e6, 0.0)
    free = lambda velocity, acceleration: np.zeros_like(velocity)
    usual(cart, spring, cycle.forward.cycle(1.0, 1.0), free, regime="rest")
    regime.ARCS = 2_000_000
    print("begun", flush=True)
    return usual(cart, spring, cycle.forward.cycle(1e6, 0.0), free, regime="rest")

elastic.travel = travel
sys.argv = ["compact", "run", {scene!r}, "--engine", "formula", "--out", {out!r}, "--quiet",
            "--set", "drive.kind=elastic", "--set", "drive.stiffness=1e6", "--set", "drive.damping=3162.0",
            "--set", "output.items=['tables']", "--set", "motion.laws=['parabolic']"]
cli.main()
"""


def test_a_long_elastic_run_is_interrupted_within_a_second_or_so(tmp_path):
    scene = str(Path(__file__).parents[2] / "studies/scenes/loveikin-2015.toml")
    code, seconds, message = interrupted(LONG.format(scene=scene, out=str(tmp_path / "out")))
    assert (code, message) == (130, "compact: interrupted; every file already written is whole\n")
    assert seconds < 5  # a second, on machines that have other things to do


# refusals


def test_resistance_that_jumps_at_a_speed_is_refused():
    with pytest.raises(
        ValueError, match=r"`resistance` over speed \[m/s\] has a jump of .* at 0\.1\d*; .*without jumps"
    ):
        simulate_elastic(
            CART, spring(1e6, 0.1), published("cubic"), lambda v, a: np.sign(v) * np.where(np.abs(v) > 0.1, 9.0, 5.0)
        )


def test_constant_force_on_both_strokes_is_refused():
    with pytest.raises(ValueError, match=r"`resistance` must oppose the motion, got 3486 N at velocity -0\.133"):
        simulate_elastic(
            CART, spring(1e6, 0.1), published("cubic"), lambda velocity, acceleration: 3486.0, regime="rest"
        )


def test_map_that_drives_a_standing_cart_is_refused():
    pulling = ResistanceMap(np.array([0.1, 0.3, 0.9]), np.full(3, -10.0), 1e-3)
    with pytest.raises(ValueError, match=r"`resistance` must not push a standing cart on, got -10 N at speed \+0"):
        simulate_elastic(CART, spring(1e6, 0.1), published("cubic"), pulling)


def test_resonance_is_told():
    w = 5 * np.pi / 3.0  # the fifth harmonic of the cycle, which the cubic law excites
    with pytest.raises(RuntimeError, match=r"no periodic regime found in .*; the spring may resonate"):
        simulate_elastic(CART, ElasticDrive(MASS * w**2, 0.0), published("cubic"), free)


def test_unknown_regime_names_the_choices():
    with pytest.raises(ValueError, match=r"no regime 'rset'; did you mean 'rest'\? choose from periodic, rest"):
        simulate_elastic(CART, spring(1e6, 0.1), published("cubic"), free, regime="rset")


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((0.0, 1.0, 0.0), "`stiffness` must be positive and finite, got 0.0"),
        ((1e6, -1.0, 0.0), "`damping` must be zero or positive, and finite, got -1.0"),
        ((1e6, 1.0, math.nan), "`backlash` must be zero or positive, and finite, got nan"),
    ],
)
def test_impossible_springs_are_refused(numbers, words):
    with pytest.raises(ValueError, match=words):
        ElasticDrive(*numbers)


def test_lag_that_outweighs_the_cart_is_refused():
    with pytest.raises(ValueError, match=r"`mass` must exceed what the resistance lags by, got 1000 kg, a lag of 1500"):
        simulate_elastic(
            CART, ElasticDrive(1e6, 1e3, first_order=True), published("cubic"), lambda v, a: np.sign(v) - 1500 * a
        )


@pytest.mark.parametrize("name", ["quintic", "gear-sector"])
def test_oscillations_that_fit_no_memory_are_refused_before_they_are_sampled(name):
    words = (
        r"`stiffness` 1e\+15 N/m with a `damping` of 0 N s/m makes the cart swing 9.5e\+05 times in a cycle: .*rigid"
    )
    with pytest.raises(ValueError, match=words) as refusal:
        simulate_elastic(CART, ElasticDrive(1e15, 0.0), published(name), dry(3486.0))
    damping = float(re.search(r"a damping of (\S+) N s/m or more", str(refusal.value)).group(1))
    assert simulate_elastic(CART, ElasticDrive(1e15, damping), published("quintic"), dry(3486.0)).energy_residual < 1e-6


def test_oscillations_that_rounding_lets_nobody_search_are_refused():
    words = r"and no further: the end of an arc was not found in 500000 ranges of its oscillation; give more damping"
    with pytest.raises(RuntimeError, match=words):
        simulate_elastic(CART, spring(1e100, 0.05), published("septic"), free)


@pytest.mark.slow
def test_peak_that_rounding_lets_nobody_search_is_refused():
    run = simulate_elastic(CART, spring(1e40, 0.05), published("septic"), free)
    words = r"the largest force from 3 s on was not found in 500000 ranges of the oscillation; .* take a rigid drive"
    with pytest.raises(RuntimeError, match=words):
        _ = run.peak_force


def test_samples_are_counted_before_they_are_made():
    for run in (
        simulate_elastic(CART, spring(1e9, ratio), published("parabolic"), dry(3486.0)) for ratio in (0.0, 0.05)
    ):
        assert len(run.time) <= run.course.sample_count <= 1.2 * len(run.time)


def test_dwell_whose_oscillations_fit_no_memory_is_refused():
    with pytest.raises(ValueError, match=r"`stiffness` 1e\+06 N/m .* makes the cart swing \S+ times in a cycle"):
        simulate_elastic(CART, ElasticDrive(1e6, 0.0), published("parabolic").cycle(600.0, 600.0), free, regime="rest")


def test_massless_cart_is_refused():
    with pytest.raises(ValueError, match="`mass` must be positive"):
        simulate_elastic(replace(CART, mass=0.0), spring(1e6, 0.1), published("cubic"), free)


def test_polynomials_meet_a_boundary_layer():
    table = fit_piecewise(lambda x: np.exp(-x / 1e-4), (0, 1), 1e-10)
    x = np.concatenate([np.logspace(-8, 0, 300), np.linspace(0, 1, 300)])
    assert table(x) == pytest.approx(np.exp(-x / 1e-4), abs=2e-10)


def test_resistance_that_is_not_a_number_ends_the_integration():
    """Every arc that is tried fails, none gets shorter: tries are counted."""
    problem = PeriodicProblem(CART, spring(1e6, 0.1), published("harmonic").cycle(), dry(1500.0), 1e-8)
    there = problem.resistance.there
    problem.resistance = problem.resistance._replace(there=there._replace(coefficients=np.nan * there.coefficients))
    with pytest.raises(RuntimeError, match=r"the cart was followed to 0 s of 6 s in 0 arcs, .* and no further"):
        problem.course(problem.law, CartState(0.0, 0.1, 1))
