"""Loads by formula and exact line contact: closed forms, published numbers, hard cases, balances, errors."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact import contact
from compact.material.laws import Elastic
from compact.rolling_contact import Layer, Roller

MIX = {"youngs_modulus": 0.75e6, "poisson": 0.3}
MODULUS = 0.75e6 / (1 - 0.3**2)  # [Pa], contact modulus of MIX
BULK = Layer(height=10.0)  # high enough to be a half-plane

frictions = st.floats(-3, 3)
poissons = st.floats(0, 0.5)
radii = st.floats(0.01, 1.0)
moduli = st.floats(1e4, 1e9)
loads = st.floats(1.0, 1e5)


def double_exponential(trailing, length):
    """Nodes and weights over the contact, exponentially exact for any power at the edges."""
    t = np.linspace(-3.2, 3.2, 321)
    share = 1 / (1 + np.exp(-np.pi * np.sinh(t)))
    weights = np.pi * np.cosh(t) * share * (1 - share) * (t[1] - t[0])
    return trailing + length * share, length * weights


# closed form


@pytest.mark.parametrize("target", [{"load": 8e3}, {"peak_pressure": 1e5}, {"contact_length": 0.05}], ids=str)
def test_galin_without_friction_is_hertz(target):
    twin = {"half_width": 0.025} if "contact_length" in target else target
    hertz = contact.hertz(radius=0.11, contact_modulus=MODULUS, **twin)
    galin = contact.galin(radius=0.11, friction=0.0, **MIX, **target)
    x = np.linspace(-0.05, 0.05, 101)
    assert galin.pressure(x) == pytest.approx(hertz.pressure(x), rel=1e-13)
    for name in ("exponent", "contact_length", "load", "peak_pressure", "leading", "trailing"):
        assert getattr(galin, name) == pytest.approx(getattr(hertz, name), rel=1e-14)
    assert galin.centroid == hertz.centroid == 0


@pytest.mark.parametrize("friction", [-0.8, -0.1, 0.0, 0.35, 2.0])
@pytest.mark.parametrize("share", [0.1, 0.37, 0.9])
def test_pressure_satisfies_the_equation_of_sliding_contact(friction, share):
    c = contact.galin(radius=0.11, friction=friction, contact_length=0.05, **MIX)
    x = c.trailing + share * c.contact_length
    s, weights = double_exponential(c.trailing, c.contact_length)
    p = c.pressure(x)
    principal = np.sum(weights * (c.pressure(s) - p) / (x - s)) + p * np.log((x - c.trailing) / (c.leading - x))
    b = (1 - 2 * 0.3) / (2 - 2 * 0.3)
    assert principal / np.pi - friction * b * p == pytest.approx(MODULUS * x / (2 * 0.11), rel=1e-9)


def test_engineering_capture_angle_is_5_9_percent_below_hertz():
    hertz = contact.hertz(radius=0.11, peak_pressure=0.05e6, contact_modulus=MODULUS)
    sine = np.sin(contact.capture_angle(0.05e6, 0.75e6, 0.3, 0.5))
    assert sine / (hertz.half_width / 0.11) == pytest.approx(0.94125, rel=1e-12)


def test_engineering_force_is_0_26_percent_above_hertz():
    phi = 0.2
    hertz = contact.hertz(radius=0.11, half_width=0.11 * np.sin(phi), contact_modulus=MODULUS)
    force = contact.roller_force(phi, 0.75e6, 0.3, 0.5, 0.11, length=1.0)
    assert force / hertz.load == pytest.approx(1 / (20.32 / 16 * np.pi / 4), rel=1e-12)
    assert force / hertz.load == pytest.approx(1.0026, abs=5e-5)


def test_engineering_contact_length_is_that_of_a_driven_roller():
    driven = contact.galin(radius=0.11, friction=-0.35, load=5e3, **MIX)
    alpha = contact.pressure_exponent(0.3, 0.35)
    length = contact.contact_length(np.arcsin(driven.leading / 0.11), 0.11, alpha)
    assert length == pytest.approx(driven.contact_length, rel=1e-13)


# published numbers


# theory.md section 2: the data of Loveikin and Pochka 2015, our reconstruction of the operators


def test_regression_of_the_layout():
    rollers = contact.rollers_needed(1.164, 0.11, 0.18, 0.012)
    assert rollers == 3
    assert contact.stroke_needed(1.164, rollers, 0.012) == pytest.approx(0.400, rel=1e-9)
    bounds = contact.radius_range(0.22)
    assert (bounds.low, bounds.high) == pytest.approx((0.088, 0.121), rel=1e-9)


# reference/contact.md a
@pytest.mark.parametrize(
    ("youngs_modulus", "poisson", "half_width", "load", "peak_pressure"),
    [
        (1e6, 0.3, 0.0200, 3138.4542, 99900.100),
        (1e6, 0.3, 0.0376, 11092.5525, 187812.188),
        (1e6, 0.45, 0.0200, 3581.1828, 113992.590),
    ],
)
def test_published_hertz(youngs_modulus, poisson, half_width, load, peak_pressure):
    c = contact.hertz(radius=0.11, youngs_modulus=youngs_modulus, poisson=poisson, half_width=half_width)
    assert (c.load, c.peak_pressure) == pytest.approx(
        (load, peak_pressure), rel=2e-8
    )  # printed digits are cut, not rounded


# reference/contact.md b: l = 1, R = 1, E* = 1
@pytest.mark.parametrize(
    ("friction", "exponent", "load", "peak_pressure", "centroid", "lowest", "arm"),
    [
        (0.0, 0.5, 0.19634954, 0.25, 0.5, 0.5, 0.0),
        (0.1, 0.49090791, 0.19628461, 0.24993934, 0.49696930, 0.50909209, -0.01212279),
        (0.3, 0.47278282, 0.19576774, 0.24945615, 0.49092761, 0.52721718, -0.03628957),
        (0.5, 0.45483276, 0.19474727, 0.24850061, 0.48494425, 0.54516724, -0.06022298),
    ],
)
def test_published_galin(friction, exponent, load, peak_pressure, centroid, lowest, arm):
    c = contact.galin(radius=1.0, youngs_modulus=0.91, poisson=0.3, friction=friction, contact_length=1.0)
    got = (c.exponent, c.load, c.peak_pressure, c.centroid - c.trailing, -c.trailing, c.centroid)
    assert got == pytest.approx((exponent, load, peak_pressure, centroid, lowest, arm), abs=1.01e-8)


# hard cases


@pytest.mark.parametrize("friction", [1e-300, 1e-12, 0.35, 1e3, 1e12, 1e300])
def test_exponent_keeps_its_digits(friction):
    with mpmath.workdps(340):
        exact = mpmath.acot(mpmath.mpf(friction) * (1 - 2 * mpmath.mpf(0.3)) / (2 - 2 * mpmath.mpf(0.3))) / mpmath.pi
        assert contact.pressure_exponent(0.3, friction) == pytest.approx(float(exact), rel=1e-14)


@pytest.mark.parametrize("friction", [-1e12, -30.0, -3.4, 3.4, 30.0, 1e12])
def test_edges_and_load_are_consistent_at_huge_friction(friction):
    c = contact.galin(radius=0.11, friction=friction, load=8e3, **MIX)
    small = min(c.leading, -c.trailing)
    assert small == pytest.approx(np.arctan2(1, abs(friction) * 0.4 / 1.4) / np.pi * c.contact_length, rel=1e-13)
    assert c.leading - c.trailing == pytest.approx(c.contact_length, rel=1e-14)
    ratio = small / c.contact_length
    assert c.contact_length == pytest.approx(
        np.sqrt(4 * 0.11 * 8e3 / (np.pi * ratio * (1 - ratio) * MODULUS)), rel=1e-13
    )


# properties


@given(radii, moduli, poissons, frictions, loads)
def test_pressure_carries_the_load_at_its_centroid(radius, modulus, poisson, friction, load):
    c = contact.galin(radius=radius, youngs_modulus=modulus, poisson=poisson, friction=friction, load=load)
    x, weights = double_exponential(c.trailing, c.contact_length)
    carried = weights * c.pressure(x)
    assert np.sum(carried) == pytest.approx(load, rel=1e-10)
    assert np.sum(carried * x) / load == pytest.approx(c.centroid, abs=1e-10 * c.contact_length)


@given(poissons, frictions)
def test_reversed_traction_mirrors_the_contact(poisson, friction):
    one = contact.galin(radius=0.11, youngs_modulus=1e6, poisson=poisson, friction=friction, load=8e3)
    other = contact.galin(radius=0.11, youngs_modulus=1e6, poisson=poisson, friction=-friction, load=8e3)
    assert (one.leading, one.trailing) == pytest.approx((-other.trailing, -other.leading), rel=1e-13)
    assert one.centroid == pytest.approx(-other.centroid, rel=1e-13)


ROLLINGS = ["frictionless", "free", "sliding", "driven"]


@pytest.mark.parametrize("friction", [0.0, 0.35])
@pytest.mark.parametrize("speed", [-0.2, 0.2])
def test_pressure_of_the_formulas_has_the_peak_the_edges_and_the_exponent(friction, speed):
    rolled = contact.roll(BULK, Roller(0.11, peak_pressure=1e5, friction=friction), Elastic(**MIX), speed)
    assert rolled.pressure.max() == pytest.approx(1e5, rel=1e-3)
    assert (rolled.pressure[0], rolled.pressure[-1]) == pytest.approx((0, 0), abs=1e-6)
    assert rolled.leading - rolled.trailing == pytest.approx(rolled.contact_length, rel=1e-14)
    assert rolled.shear_traction == pytest.approx(-np.sign(speed) * friction * rolled.pressure)
    exact = contact.galin(radius=0.11, peak_pressure=1e5, friction=-friction, **MIX)
    assert rolled.leading / exact.leading == pytest.approx(rolled.contact_length / exact.contact_length, rel=1e-12)
    assert np.trapezoid(rolled.pressure, rolled.x) == pytest.approx(rolled.load, rel=0.07)  # (1.6) is not its integral
    assert rolled.error is rolled.work_residual is None


@pytest.mark.parametrize("rolling", ROLLINGS)
def test_engine_equals_the_formulas_in_every_roller_condition(rolling):
    rolled = contact.roll(
        BULK, Roller(0.11, load=4e3, friction=0.35, rolling=rolling), Elastic(**MIX), 0.2,
        rolling_friction=0.17, nonuniformity=1.1,
    )  # fmt: skip
    alpha = contact.pressure_exponent(0.3, 0.35)
    phi = contact.capture_angle(rolled.peak_pressure, 0.75e6, 0.3, alpha)
    length = contact.contact_length(phi, 0.11, alpha)
    assert (rolled.own["exponent"], rolled.own["capture_angle"], rolled.contact_length) == (alpha, phi, length)
    assert rolled.load == contact.roller_force(phi, 0.75e6, 0.3, alpha, 0.11, 1.0, 1.1)
    assert rolled.load == pytest.approx(4e3, rel=1e-13)
    assert rolled.resistance == contact.roller_resistance(rolled.load, length, 0.11, alpha, 0.17)


# errors


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: contact.rollers_needed(1.164, 0.11, 0.18, 0.5), r"`overlap` must be less than 2 `radius` \+ `feeder"),
        (lambda: contact.stroke_needed(1.164, 3, 0.5), "`overlap` must be less than .* `width`/`rollers`, exceeds by"),
        (lambda: contact.pressure_exponent(0.6, 0.35), "`poisson` must be between 0 and 0.5, got 0.6"),
        (lambda: contact.capture_angle([1e5, 1e6], 1e6, 0.3, 0.47), r"sin phi would be .*1\.8.*"),
        (lambda: contact.hertz(radius=0.11, contact_modulus=1e6, poisson=0.3, load=1e3), "either `contact_modulus`"),
        (lambda: contact.galin(radius=0.11, friction=0.3, **MIX), "exactly one of `load`, .* must be set, got none"),
    ],
)
def test_impossible_values_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
