"""Equilibrium of the cart: closed form, published reactions, lift-off, independent force and moment sums, errors."""

from dataclasses import replace

import numpy as np
import pytest
from cart_moments import moment_residual
from hypothesis import assume, given
from hypothesis import strategies as st
from published import CART_OF_C

from compact.machine.cart import Cart, balance

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
    assert abs(moment_residual(cart, got, resistance, direction, tangent)) <= 1e-11 * scale


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
