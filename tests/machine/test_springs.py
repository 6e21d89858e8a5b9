"""Springs at the ends of the stroke: closed forms, work, every drive, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published import CART_OF_C

from compact.drive import Crank, Rigid, simulate
from compact.dynamics.event_driven import DONE, integrate, room
from compact.dynamics.force_elements import AT_NEAR, NEAR, CartState, Ends, Resistance, Spring
from compact.dynamics.trajectory import Course
from compact.machine.cart import EndSprings
from compact.machine.crankshaft import USUAL_ANGLES, turn
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.machine.motor_characteristics import Kloss
from compact.machine.motor_drive import Motor
from compact.motion.profile import LAWS, law
from compact.numerics.piecewise import PiecewisePolynomial

CART = replace(CART_OF_C, guide_friction=0.0)
SIZE = 3486.0
GENTLE = [name for name in LAWS if name not in ("constant-velocity", "gear-sector")]


def dry(velocity, acceleration):
    return SIZE * np.sign(velocity)


def sprung(stiffness=4e3, preload=300.0, length=0.08, cart=CART):
    return replace(cart, end_springs=EndSprings(stiffness, preload, length, stroke=0.4))


def published(name, duration=3.0):
    return law(name, stroke=0.4, duration=duration, rod_length=0.8)


# closed form


@pytest.mark.parametrize("duration", [3.0, 0.3])
def test_harmonic_cart_on_tuned_springs_asks_for_the_resistance_alone(duration):
    """k = m (pi/T)^2 over half the stroke at each end is the pendulum that the law is: H = F."""
    stiffness = CART.mass * (np.pi / duration) ** 2
    run = simulate(sprung(stiffness, 0.0, 0.2), Rigid(), published("harmonic", duration), dry)
    assert np.abs(run.drive_force) == pytest.approx(SIZE, rel=1e-9)
    assert run.peak_force == pytest.approx(SIZE, rel=1e-9)
    assert run.drawn_energy == pytest.approx(0.8 * SIZE, rel=1e-9)


@pytest.mark.parametrize("preload", [0.0, 300.0, 1500.0])
def test_peak_of_the_parabolic_law_falls_by_the_spring_at_its_end(preload):
    """a = 4 s/T^2 up to the middle: after the spring the peak is m a + F, on it less by P + k (l - x)."""
    acceleration = 4 * 0.4 / 9
    run = simulate(sprung(0.0, preload, 0.2), Rigid(), published("parabolic"), dry)
    push = preload - CART.mass * acceleration
    assert run.peak_force == pytest.approx(SIZE + abs(push), rel=1e-9)


def test_energy_of_a_spring_is_the_integral_of_its_push():
    springs = EndSprings(4e3, 300.0, 0.08, stroke=0.4)
    x, weight = np.polynomial.legendre.leggauss(20)
    x, weight = 0.04 * (1 + x), 0.04 * weight
    assert springs.energy(0.0) == pytest.approx(weight @ springs.push(x, np.ones(20)), rel=1e-13)
    assert springs.energy([0.1, 0.2, 0.4]) == pytest.approx([0, 0, springs.energy(0.0)], abs=1e-12)
    assert [springs.push(0.03, 1.0), -springs.push(0.37, -1.0)] == pytest.approx([300 + 4e3 * 0.05] * 2)


# every drive


@pytest.mark.parametrize("name", GENTLE)
def test_springs_give_back_what_they_take(name):
    run = simulate(sprung(), Rigid(), published(name), dry)
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-9)


def test_springs_of_four_carts_on_a_motor_balance_their_work():
    motor = Motor(Kloss(40.0, 0.15, 157.0), 150.0, 1e-3, 20.0, USUAL_ANGLES[4])
    bare, run = (simulate(cart, motor, published("cubic"), dry) for cart in (CART, sprung()))
    assert run.energy_residual < 1e-8
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-6)
    near = run.state.position < 0.08
    assert run.state.forces.drive_force[near].min() < bare.state.forces.drive_force[bare.state.position < 0.08].min()


def test_heavy_flywheel_meets_the_springs_of_the_rigid_drive():
    run = simulate(sprung(), Motor(Kloss(40.0, 0.15, 157.0), 150.0, 0.0, 1e9), published("cubic"), dry)
    even = simulate(sprung(), Rigid(), published("cubic", run.period / 2), dry)
    assert run.peak_force == pytest.approx(even.peak_force, rel=1e-6)
    assert run.rms_power == pytest.approx(even.rms_power, rel=1e-6)


def test_crankshaft_gives_no_work_to_springs():
    crank = Crank(0.2, 0.8)
    bare, run = (turn(cart, crank, np.pi / 3, dry, USUAL_ANGLES[2]) for cart in (CART, sprung()))
    assert run.mean(run.power) == pytest.approx(bare.mean(bare.power), rel=1e-9)
    alone, even = turn(sprung(), crank, np.pi / 3, dry), simulate(sprung(), crank, published("crank"), dry)
    assert alone.peak_power == pytest.approx(even.peak_power, rel=1e-6)


# behind an elastic drive


def thrown(stiffness, preload, push, size, speed, time):
    """`Course` of a cart at its near spring, going in, that hardly more than a constant push holds."""
    weak = 1.0 if push else 1e-9  # N/m, pressed so far that its force is even to a millionth
    numbers = Spring(CART.mass, weak, 0.0, 0.0, Ends(stiffness, preload, 0.08, 0.4))
    stretch = -push / weak
    far_end = PiecewisePolynomial(np.array([0.0, time]), np.array([[0.08 + stretch] + [0.0] * 10]))
    side = PiecewisePolynomial(np.array([0.0, 10.0]), np.array([[size] + [0.0] * 8]))
    back = PiecewisePolynomial(side.breaks, -side.coefficients)
    arcs, start = room(2000, 10), CartState(stretch, -speed, 1, NEAR)
    resistance = Resistance(side, back, np.empty(0))
    ended, n, _, end, _ = integrate(numbers, far_end, resistance, start, 1e-9, arcs)
    assert ended == DONE
    return Course(numbers, type(arcs)(*(column[:n].copy() for column in arcs)), resistance, start, end)


@pytest.mark.parametrize("preload", [0.0, 50.0, 3000.0])
def test_thrown_cart_leaves_its_spring_in_time(preload):
    """z'' = -(P + p z)/m: it is back after 2/w atan(v p/(w P)), as fast as it came."""
    stiffness, speed = 4e5, 0.2
    w = np.sqrt(stiffness / CART.mass)
    course = thrown(stiffness, preload, 0.0, 0.0, speed, 0.2)
    assert course.arcs.zone.tolist() == [NEAR, NEAR, 0]
    away = course.arcs.start[2:]
    assert away == pytest.approx(2 / w * np.arctan2(speed * stiffness, w * preload), rel=1e-9)
    assert course.motion(*course.at(away))[1] == pytest.approx([speed], rel=1e-9)


def test_pushed_cart_comes_to_stand_at_the_plate_of_its_spring():
    """F < h < P - F: each bounce takes the same share of the speed, all together a time, and then the plate holds."""
    preload, push, size, speed, mass = 3000.0, 1200.0, 800.0, 0.05, CART.mass
    spare = preload - push
    into, out, away, back = np.array([spare + size, spare - size, push + size, push - size]) / mass
    left, again = speed * np.sqrt(out / into), speed * np.sqrt(out / into * back / away)
    time = (speed / into + left / out + left / away + again / back) / (1 - again / speed)
    course = thrown(0.0, preload, push, size, speed, 2 * time)
    assert course.end[2:] == (1, AT_NEAR)
    assert course.end.velocity == 0
    assert course.arcs.start[-1] == pytest.approx(time, rel=1e-5)
    assert course.motion(np.array([len(course.arcs.start) - 1]), np.zeros(1))[0] == pytest.approx([0.08], abs=1e-9)
    assert len(course.arcs.start) < 200


@pytest.mark.parametrize("stiffness", [1e5, 1e9])
def test_harmonic_cart_on_tuned_springs_asks_nothing_of_an_elastic_drive(stiffness):
    tuned = CART.mass * (np.pi / 3.0) ** 2
    drive = ElasticDrive(stiffness, 0.1 * np.sqrt(stiffness * CART.mass))
    run = simulate_elastic(sprung(tuned, 0.0, 0.2), drive, published("harmonic"), lambda v, a: 0.0 * v)
    assert run.peak_force < 1e-7 * CART.mass * 0.2 * (np.pi / 3) ** 2


@pytest.mark.parametrize("regime", ["rest", "periodic"])
@pytest.mark.parametrize("stiffness", [2e4, 1e6, 1e8])
@pytest.mark.parametrize("name", ["cubic", "reversal-4", "parabolic", "constant-velocity"])
def test_elastic_drive_accounts_for_the_work_of_springs(name, stiffness, regime):
    drive = ElasticDrive(stiffness, 0.1 * np.sqrt(stiffness * CART.mass), 1e-3 if stiffness == 1e6 else 0.0)
    run = simulate_elastic(sprung(stiffness=2e4), drive, published(name), dry, regime=regime)
    assert run.energy_residual < 1e-6
    assert {-1, 0, 1} & set(run.course.arcs.zone.tolist())
    if regime == "periodic":
        lost = run.course.spring.damping * run.course.stretch(*run.course.places()[:2])[1] ** 2
        assert run.energy == pytest.approx(np.sum(run.weights * (lost + SIZE * np.abs(run.state.velocity))), rel=1e-6)


def test_stiff_elastic_drive_meets_the_springs_of_the_rigid_one():
    drive = ElasticDrive(1e9, 1.4 * np.sqrt(1e9 * CART.mass))
    run = simulate_elastic(sprung(preload=0.0), drive, published("septic"), lambda v, a: 0.0 * v)
    assert run.peak_force == pytest.approx(run.rigid.peak_force, rel=1e-3)


# properties


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(GENTLE), st.floats(0, 1e5), st.floats(0, 5e3), st.floats(1e-3, 0.2))
def test_any_springs_do_no_work_over_a_cycle(name, stiffness, preload, length):
    run = simulate(sprung(stiffness, preload, length), Rigid(), published(name), dry)
    turned = preload * length + stiffness * length**2 / 2
    assert run.energy == pytest.approx(0.8 * SIZE, abs=1e-6 * (0.8 * SIZE + turned))


# refusals


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((-1.0, 0.0, 0.1), "`stiffness` must be zero or positive"),
        ((1.0, np.nan, 0.1), "`preload` must be zero or positive"),
        ((1.0, 0.0, 0.0), "`length` must be positive"),
        ((1.0, 0.0, 0.3), r"`length` must be at most half the stroke, 0\.2 m, got 0\.3"),
    ],
)
def test_impossible_springs_are_refused(given, words):
    with pytest.raises(ValueError, match=words):
        EndSprings(*given, stroke=0.4)
