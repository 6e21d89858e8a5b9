"""End springs: closed forms, work, all drives, errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import CART, SIZE, dry, published_law
from sampling import examples

from compact.drive import Crank, Rigid, simulate
from compact.machine.cart import EndSprings
from compact.machine.crankshaft import CRANK_ANGLES, simulate_crankshaft
from compact.machine.elastic_motion import integrate
from compact.machine.spring_forces import AT_NEAR_PLATE, NEAR_SPRING, CartState, SpringCart
from compact.motion.profile import LAWS
from compact.numerics.piecewise import PiecewisePolynomial

WITHOUT_IMPULSE = [name for name in LAWS if name not in ("constant-velocity", "gear-sector")]


def cart_with_springs(stiffness=4e3, preload=300.0, length=0.08, cart=CART):
    return replace(cart, end_springs=EndSprings(stiffness, preload, length, stroke=0.4))


# closed form


@pytest.mark.parametrize("duration", [3.0, 0.3])
def test_tuned_springs_balance_the_inertia_of_the_harmonic_law(duration):
    """k = m (pi/T)^2 over half the stroke at each end makes the law a free oscillation: H = F."""
    stiffness = CART.mass * (np.pi / duration) ** 2
    run = simulate(cart_with_springs(stiffness, 0.0, 0.2), Rigid(), published_law("harmonic", duration), dry)
    assert np.abs(run.drive_force) == pytest.approx(SIZE, rel=1e-9)
    assert run.peak_force == pytest.approx(SIZE, rel=1e-9)
    assert run.drawn_energy == pytest.approx(0.8 * SIZE, rel=1e-9)


@pytest.mark.parametrize("preload", [0.0, 300.0, 1500.0])
def test_springs_reduce_the_peak_of_the_parabolic_law(preload):
    """a = 4 s/T^2 up to the middle; within the spring the force is smaller by P + k (l - x)."""
    acceleration = 4 * 0.4 / 9
    run = simulate(cart_with_springs(0.0, preload, 0.2), Rigid(), published_law("parabolic"), dry)
    push = preload - CART.mass * acceleration
    assert run.peak_force == pytest.approx(SIZE + abs(push), rel=1e-9)


def test_force_of_a_spring_grows_from_its_preload():
    springs = EndSprings(4e3, 300.0, 0.08, stroke=0.4)
    assert [springs.force(0.03, 1.0), -springs.force(0.37, -1.0)] == pytest.approx([300 + 4e3 * 0.05] * 2)


# every drive


def test_springs_do_no_net_work_on_a_crankshaft():
    crank = Crank(0.2, 0.8)
    bare, run = (
        simulate_crankshaft(cart, crank, np.pi / 3, dry, CRANK_ANGLES[2]) for cart in (CART, cart_with_springs())
    )
    assert run.mean(run.power) == pytest.approx(bare.mean(bare.power), rel=1e-9)
    alone, even = (
        simulate_crankshaft(cart_with_springs(), crank, np.pi / 3, dry),
        simulate(cart_with_springs(), crank, published_law("crank"), dry),
    )
    assert alone.peak_power == pytest.approx(even.peak_power, rel=1e-6)


# behind an elastic drive


def bounce(stiffness, preload, push, friction, speed, time):
    """Trajectory of a cart that moves into its near spring under a constant force, part of its resistance."""
    scales = {"force_scale": max(friction, preload, 100.0), "tolerance": 1e-7}
    cart = SpringCart(CART.mass, 1e-9, 0.0, 0.0, float(stiffness), preload, 0.08, 0.4, **scales)
    driven_end = PiecewisePolynomial(np.array([0.0, time]), np.array([[0.08] + [0.0] * 10]))
    table = PiecewisePolynomial(np.array([-1.0, 0.0, 1.0]), np.array([[push - friction], [push + friction]]))
    start = CartState(0.0, -speed, 1, int(NEAR_SPRING))
    trajectory, complete, _ = integrate(cart.with_tables(table), driven_end, start, 2000)
    assert complete
    return trajectory


@pytest.mark.parametrize("preload", [0.0, 50.0, 3000.0])
def test_contact_time_of_a_free_cart_with_its_spring(preload):
    """z'' = -(P + p z)/m: the cart returns after 2/w atan(v p/(w P)) with its initial speed."""
    stiffness, speed = 4e5, 0.2
    w = np.sqrt(stiffness / CART.mass)
    trajectory = bounce(stiffness, preload, 0.0, 0.0, speed, 0.2)
    assert np.all(np.diff(trajectory.zone) <= 0)
    away = trajectory.begin[np.flatnonzero(trajectory.zone == 0)[:1]]
    assert away == pytest.approx(2 / w * np.arctan2(speed * stiffness, w * preload), rel=1e-9)
    assert trajectory.at(away)[1] == pytest.approx([speed], rel=1e-9)


def test_driven_cart_comes_to_rest_at_the_plate_of_its_spring():
    """F < h < P - F: each bounce reduces the speed by the same ratio, until the plate holds the cart."""
    preload, push, size, speed, mass = 3000.0, 1200.0, 800.0, 0.05, CART.mass
    net = preload - push
    into, out, away, back = np.array([net + size, net - size, push + size, push - size]) / mass
    left, again = speed * np.sqrt(out / into), speed * np.sqrt(out / into * back / away)
    time = (speed / into + left / out + left / away + again / back) / (1 - again / speed)
    trajectory = bounce(0.0, preload, push, size, speed, 2 * time)
    assert trajectory.end[2:4] == (1, AT_NEAR_PLATE)
    assert trajectory.end.velocity == 0
    assert trajectory.begin[-1] == pytest.approx(time, rel=3e-5)
    assert trajectory.at(trajectory.begin[-1:]).position == pytest.approx([0.08], abs=1e-9)
    assert len(trajectory.rows) < 400


# properties


@examples(6, slow=25)
@given(st.sampled_from(WITHOUT_IMPULSE), st.floats(0, 1e5), st.floats(0, 5e3), st.floats(1e-3, 0.2))
def test_any_springs_do_no_net_work(name, stiffness, preload, length):
    run = simulate(cart_with_springs(stiffness, preload, length), Rigid(), published_law(name), dry)
    turned = preload * length + stiffness * length**2 / 2
    assert run.energy == pytest.approx(0.8 * SIZE, abs=1e-6 * (0.8 * SIZE + turned))


# errors
