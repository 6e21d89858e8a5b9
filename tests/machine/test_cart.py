"""Cart and crankshaft: closed forms, published reactions and powers, independent sums of forces and moments."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from machine_cases import friction
from published import CART_OF_C
from sampling import examples

from compact.drive import Crank
from compact.machine.cart import Cart, balance
from compact.machine.crankshaft import CRANK_ANGLES, simulate_crankshaft
from compact.motion.profile import law

PUBLISHED = CART_OF_C
LIFT = 2 * 9740.0 - 10e3

lengths = st.floats(-1, 1)
forces = st.floats(-3e4, 3e4)
directions = st.sampled_from([-1.0, 0.0, 1.0])
tangents = st.floats(-1.5, 1.5)


@st.composite
def carts(draw):
    rollers = draw(st.integers(0, 3))
    rear = draw(lengths)
    return Cart(
        mass=draw(st.floats(0, 5e3)),
        weight=draw(st.floats(0, 4e4)),
        roller_positions=tuple(draw(lengths) for _ in range(rollers)),
        roller_reactions=tuple(draw(st.floats(0, 3e4)) for _ in range(rollers)),
        guide_positions=(rear + draw(st.floats(0.05, 2)), rear),
        pin_position=draw(lengths),
        pin_height=draw(st.floats(-0.3, 0.3)),
        roller_radius=draw(st.floats(0.01, 0.5)),
        guide_wheel_diameter=draw(st.floats(0, 0.3)),
        guide_friction=draw(st.floats(0, 0.4)),
    )


def reactions(cart, force, resistance, direction, tangent):
    """N1 and N2 for a drive force, by the linear system of vertical forces and moments."""
    front, rear = cart.guide_positions
    torque_of_rail = direction * cart.guide_friction * cart.guide_wheel_diameter / 2
    pull = force * tangent
    up = sum(cart.roller_reactions) - cart.weight + pull
    turning = sum(r * x for r, x in zip(cart.roller_reactions, cart.roller_positions, strict=True))
    turning += cart.pin_position * pull - resistance * (cart.pin_height + cart.roller_radius)
    return np.linalg.solve([[1, 1], [front - torque_of_rail, rear - torque_of_rail]], [up, turning])


def lock(cart, direction, tangent):
    """f (|dN1/dH| + |dN2/dH|): from 1 on friction grows as fast as the drive force."""
    bare = replace(cart, weight=0.0, roller_positions=(), roller_reactions=())
    return abs(direction) * cart.guide_friction * np.abs(reactions(bare, 1.0, 0.0, direction, tangent)).sum()


def residual(cart, force, needed, resistance, direction, tangent):
    """H - s f (|N1| + |N2|) - (m a + W)."""
    friction = np.abs(reactions(cart, force, resistance, direction, tangent)).sum()
    return force - direction * cart.guide_friction * friction - needed


def force_scale(cart, required, forces):
    """Largest force, as a scale of rounding."""
    parts = (cart.weight, *cart.roller_reactions, required, forces.drive_force, forces.front_reaction)
    return max(1.0, *(abs(float(part)) for part in parts), abs(float(forces.rear_reaction)))


# closed form


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_pressed_guides_give_coulomb_friction_of_the_lift(direction):
    got = balance(PUBLISHED, 0.5, direction * 3562.0, direction)
    assert got.guide_friction == pytest.approx(direction * 0.008 * LIFT, rel=1e-14)
    assert got.drive_force == pytest.approx(500 + direction * (3562 + 0.008 * LIFT), rel=1e-14)


# published numbers: paper C with W = 2 * 7962 N and no inertia (errata C-7, C-8)


def published_half(direction):
    psi = np.linspace(0, np.pi, 2001)
    tangent = direction * np.tan(np.arcsin(0.25 * np.sin(psi)))
    return balance(replace(PUBLISHED, mass=0.0), 0.0, direction * 15924.0, direction, tangent)


def test_published_reactions_towards_the_crank():
    half = published_half(1.0)
    assert [half.rear_reaction.min(), half.rear_reaction.max()] == pytest.approx([7.7e3, 9.3e3], abs=50)
    assert [half.front_reaction.min(), half.front_reaction.max()] == pytest.approx([0.2e3, 5.9e3], abs=50)


def test_published_rear_wheel_lifts_off_on_the_return_stroke():
    half = published_half(-1.0)
    assert half.rear_reaction.min() == pytest.approx(-1344, abs=0.5)
    assert np.mean(half.rear_reaction < 0) == pytest.approx(0.9, abs=0.015)
    assert half.front_reaction.min() > 0


def test_published_lift_off_adds_at_most_22_newtons_of_friction():
    half = published_half(-1.0)
    plain = 0.008 * np.abs(half.front_reaction + half.rear_reaction)
    extra = np.abs(half.guide_friction) - plain
    assert extra.min() >= -1e-9
    assert extra.max() == pytest.approx(21.5, abs=0.5)


def test_published_force_includes_the_guide_friction_once():
    """Theory 2: of 3562 N, 76 N are guide friction; the rest is 0.179 of the roller load."""
    mix = 0.17896 * 2 * 9740
    assert balance(PUBLISHED, 0.0, mix, 1.0).drive_force == pytest.approx(3562, abs=0.5)


# properties


@given(carts(), forces, st.floats(-30, 30), directions, tangents)
def test_forces_and_moments_balance(cart, resistance, acceleration, direction, tangent):
    assume(lock(cart, direction, tangent) < 0.999)
    got = balance(cart, acceleration, resistance, direction, tangent)
    needed = cart.mass * acceleration + resistance
    scale = force_scale(cart, needed, got)
    pull, wheels = got.drive_force * tangent, (got.front_reaction, got.rear_reaction)
    friction = [direction * cart.guide_friction * abs(wheel) for wheel in wheels]
    assert abs(got.drive_force - sum(friction) - needed) <= 1e-12 * scale
    assert abs(sum(cart.roller_reactions) - cart.weight + pull - sum(wheels)) <= 1e-12 * scale
    assert got.guide_friction == pytest.approx(sum(friction), abs=1e-12 * scale)
    # moments about the origin, forces as (x, y, Fx, Fy); the loaded rail is above or below the axle of a wheel
    loads = [(x, 0, 0, lift) for x, lift in zip(cart.roller_positions, cart.roller_reactions, strict=True)]
    loads += [(0, -cart.pin_height - cart.roller_radius, -resistance, 0), (cart.pin_position, 0, 0, pull)]
    for x, wheel, drag in zip(cart.guide_positions, wheels, friction, strict=True):
        loads.append((x, np.copysign(cart.guide_wheel_diameter / 2, wheel), -drag, -wheel))
    assert abs(sum(x * fy - y * fx for x, y, fx, fy in loads)) <= 1e-11 * scale


@given(carts(), forces, directions, tangents)
def test_force_is_the_only_root_of_the_balance(cart, needed, direction, tangent):
    """Bisection of the increasing residual, without the four pairs of signs, yields the same force."""
    steepness = lock(cart, direction, tangent)
    assume(steepness < 0.95)
    got = float(balance(cart, 0.0, needed, direction, tangent).drive_force)
    reach = (abs(residual(cart, 0.0, needed, needed, direction, tangent)) + 1) / (1 - steepness)
    low, high = -reach, reach
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if residual(cart, middle, needed, needed, direction, tangent) < 0 else (low, middle)
    assert got == pytest.approx(low, rel=1e-9, abs=1e-9 * reach)


# errors


@given(carts(), st.sampled_from([-1.0, 1.0]), st.floats(-50, 50))
def test_only_a_self_locking_rod_raises(cart, direction, tangent):
    steepness = lock(cart, direction, tangent)
    assume(abs(steepness - 1) > 1e-6)
    if steepness > 1:
        with pytest.raises(ValueError, match="too steep"):
            balance(cart, 0.0, 100.0, direction, tangent)
    else:
        assert np.isfinite(balance(cart, 0.0, 100.0, direction, tangent).drive_force)


# ---- Carts on one crankshaft: closed form of the slider-crank, virtual power, published powers, cancellation, errors


CRANK = Crank(radius=0.2, rod_length=0.8)
CART = CART_OF_C
WITHOUT_FRICTION = replace(CART, guide_friction=0.0)
MASSLESS = replace(WITHOUT_FRICTION, mass=0.0)
HUNDRED_RPM = 2 * np.pi * 100 / 60

radii = st.floats(0.01, 1)
ratios = st.floats(0.01, 0.99)
speeds = st.floats(0.1, 50)
masses = st.just(0.0) | st.floats(1e-3, 5e3)


def closed_travel(radius, rod_length, psi):
    return radius * (1 - mpmath.cos(psi)) + rod_length - mpmath.sqrt(rod_length**2 - (radius * mpmath.sin(psi)) ** 2)


def closed_published(psi):
    return closed_travel(mpmath.mpf("0.2"), mpmath.mpf("0.8"), psi)


def exact_travel(crank, psi):
    """Travel and its two derivatives with 50 digits, by numerical differentiation."""
    with mpmath.workdps(50):
        r, rod = mpmath.mpf(crank.radius), mpmath.mpf(crank.rod_length)
        return [float(mpmath.diff(lambda p: closed_travel(r, rod, p), mpmath.mpf(psi), n)) for n in (0, 1, 2)]


# closed form


@pytest.mark.parametrize("rod_length", [0.2002, 0.25, 0.8, 200.0], ids=str)
@pytest.mark.parametrize("psi", [0.0, 1e-8, 0.3, np.pi / 2, 2.0, np.pi, 4.0, 5.9], ids=lambda psi: f"{psi:.3g}")
def test_travel_is_the_slider_crank(rod_length, psi):
    cycle = law("crank", 0.4, np.pi, rod_length=rod_length).cycle()  # 1 rad/s
    got = [float(cycle.derivative(psi, order)) for order in range(3)]
    assert got == pytest.approx(exact_travel(Crank(0.2, rod_length), psi), rel=1e-11, abs=1e-15)


def test_acceleration_is_largest_at_the_outer_dead_centre():
    cart = simulate_crankshaft(CART, CRANK, 10.5, friction(3562.0)).carts[0]
    assert cart.position[0] == pytest.approx(0, abs=1e-14)
    assert cart.acceleration[0] == pytest.approx(0.2 * 10.5**2 * (1 + 0.2 / 0.8), rel=1e-14)
    assert cart.acceleration[0] == pytest.approx(27.56, abs=0.005)  # errata C-3
    assert np.abs(cart.acceleration).max() == cart.acceleration[0]


# published numbers: paper C and its errata


def test_published_powers_of_one_cart():
    shaft = simulate_crankshaft(MASSLESS, CRANK, HUNDRED_RPM, friction(3562.0))
    closed = 3562 * 4 * 0.2 * HUNDRED_RPM / (2 * np.pi)
    assert shaft.mean(shaft.power) == pytest.approx(closed, rel=1e-13)
    assert closed == pytest.approx(4749.33, abs=0.005)
    assert shaft.power.max() == pytest.approx(7690.6, abs=0.05)


def test_published_powers_of_four_carts():
    shaft = simulate_crankshaft(MASSLESS, CRANK, HUNDRED_RPM, friction(3562.0), CRANK_ANGLES[4])
    assert shaft.power.max() == pytest.approx(21100.7, abs=0.05)
    assert shaft.mean(shaft.power) == pytest.approx(18997.3, abs=0.05)
    assert shaft.carts[0].drive_power.max() / shaft.power.max() * 4 == pytest.approx(1.458, abs=5e-4)


def test_inertia_dominates_the_published_machine():
    """Errata C-3: with the mass and the forces of both rollers the peak is seven times the printed one."""
    shaft = simulate_crankshaft(CART, CRANK, 10.5, friction(2 * 7962.0))
    assert np.abs(shaft.power).max() == pytest.approx(55.6e3, abs=50)
    assert shaft.mean(shaft.power) == pytest.approx(21_425, abs=15)  # C-1, with friction
    smaller = simulate_crankshaft(CART, CRANK, 10.5, friction(3562.0))
    assert np.abs(smaller.power).max() == pytest.approx(34.9e3, abs=60)


# hard cases


def test_peak_between_samples_is_found():
    with mpmath.workdps(30):
        best = mpmath.findroot(lambda psi: mpmath.diff(closed_published, psi, 2), 1.33)
        peak = 3562 * HUNDRED_RPM * float(mpmath.diff(closed_published, best))
    shaft = simulate_crankshaft(MASSLESS, CRANK, HUNDRED_RPM, friction(3562.0))
    assert shaft.peak_power == pytest.approx(peak, rel=1e-9)
    assert shaft.power.max() == pytest.approx(peak, rel=2e-4)


def mean_power_of_one_cart(cart, resistance):
    shaft = simulate_crankshaft(cart, CRANK, 10.5, friction(resistance))
    return shaft.mean(shaft.power)


# properties


@examples(6, slow=100)
@given(st.floats(0.05, 0.6), speeds, masses)
def test_shaft_power_equals_rod_power_with_friction(ratio, speed, mass):
    cart = simulate_crankshaft(replace(CART, mass=mass), Crank(0.2, 0.2 / ratio), speed, friction(15924.0)).carts[0]
    work = cart.forces.drive_force * cart.velocity
    assert cart.rod_force * np.cos(np.arctan(cart.rod_tangent)) == pytest.approx(cart.forces.drive_force, rel=1e-12)
    assert cart.drive_power == pytest.approx(work, rel=1e-12, abs=1e-12 * np.abs(work).max())


@examples(6, slow=100)
@given(radii, ratios, speeds, masses, st.floats(1, 3e4))
def test_mean_power_depends_on_neither_rod_nor_mass(radius, ratio, speed, mass, resistance):
    shaft = simulate_crankshaft(
        replace(WITHOUT_FRICTION, mass=mass), Crank(radius, radius / ratio), speed, friction(resistance)
    )
    closed = resistance * 4 * radius * speed / (2 * np.pi)
    rounding = 1e-13 * np.abs(shaft.power).max()
    assert shaft.mean(shaft.power) == pytest.approx(closed, rel=1e-11, abs=rounding)


@examples(6, slow=100)
@given(ratios, st.floats(1, 3e4), speeds)
def test_four_massless_carts_have_a_fixed_power_fluctuation(ratio, resistance, speed):
    shaft = simulate_crankshaft(MASSLESS, Crank(0.2, 0.2 / ratio), speed, friction(resistance), CRANK_ANGLES[4])
    assert shaft.power.max() / shaft.mean(shaft.power) == pytest.approx(np.pi / (2 * np.sqrt(2)), rel=1e-12)
    assert shaft.power.min() / shaft.mean(shaft.power) == pytest.approx(np.pi / 4, rel=1e-12)


@examples(6, slow=100)
@given(st.lists(st.floats(-10, 10), min_size=1, max_size=4))
def test_mean_of_the_sum_equals_the_sum_of_the_means(angles):
    """Errata C-5: an identity for any crank angles."""
    shaft = simulate_crankshaft(CART, CRANK, 10.5, friction(3562.0), angles)
    assert shaft.weights.sum() == pytest.approx(2 * np.pi, rel=1e-13)
    means = [shaft.mean(cart.drive_power) for cart in shaft.carts]
    assert means == pytest.approx([mean_power_of_one_cart(CART, 3562.0)] * len(angles), rel=1e-10)
    assert shaft.mean(shaft.power) == pytest.approx(sum(means), rel=1e-13)
    assert shaft.mean(shaft.torque) * 10.5 == pytest.approx(sum(means), rel=1e-13)
