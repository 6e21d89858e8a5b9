"""Carts on one crankshaft: closed form of the slider-crank, virtual power, published powers, cancellation, errors."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_cases import friction
from published import CART_OF_C
from sampling import examples

from compact.drive import Crank
from compact.machine.crankshaft import CRANK_ANGLES, simulate_crankshaft
from compact.motion.profile import law

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
    means = [shaft.mean(cart.drive_power) for cart in shaft.carts]
    assert means == pytest.approx([mean_power_of_one_cart(CART, 3562.0)] * len(angles), rel=1e-10)
    assert shaft.mean(shaft.power) == pytest.approx(sum(means), rel=1e-13)
    assert shaft.mean(shaft.torque) * 10.5 == pytest.approx(sum(means), rel=1e-13)


# errors
