"""Stick and slip of free, driven and braked rollers: closed forms and an independent boundary-element solution.

Its elements were hats of traction on a bonded layer, with the kernels of its 2 x 2 Fourier symbols that couple pressure
and shear. It rolled from rest cell by cell until it was steady; every step was a convex programme for the pressure and
one for the shear, solved by alternating directions. The symbols agreed with the four modes of Navier's equations to
1e-9, the pressure with little friction with the engine "spectral". Its results are `boundary_elements.csv`; the
solution itself was removed after revision ddbd3f65.
"""

from collections import defaultdict
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampling import examples

from compact import fem, mesh
from compact.files import read_table
from compact.material.laws import Elastic, Viscoelastic
from compact.rolling_contact import Layer, Roller

H, R, DEPTH, NU = 0.22, 0.11, 0.006, 0.3
LAYER = Layer(H)
MIX = Elastic(youngs_modulus=1.0, poisson=NU)
SLS = Viscoelastic(youngs_modulus=1.0, poisson=NU, branches=((1.0, 1.0),))  # v tau is v
FREE, DRIVEN, BRAKED = 0.0, 0.5, -0.5  # torque over the friction limit
FRICTIONLESS_LOAD = 3.4452e-3  # of MIX at DEPTH; times friction the reference of torques


# boundary elements


class BoundaryElementContact:
    """Recorded steady state at DEPTH: x, pressure, shear traction, slip over speed, creepage."""

    def __init__(self, rows):
        self.x, self.pressure, self.traction, self.slip = (
            np.array([float(row[name]) for row in rows]) for name in ("x", "pressure", "shear", "slip")
        )
        self.creepage = float(rows[0]["creepage"])

    def sum(self, values):
        return float(np.sum(values)) * (self.x[1] - self.x[0])

    @property
    def load(self):
        return self.sum(self.pressure)

    @property
    def resistance(self):
        return self.sum(self.pressure * self.x / R + self.traction)


@cache
def recorded():
    """Recorded contacts by material, speed, friction and share of the torque in the friction limit."""
    found = defaultdict(list)
    for _, row in read_table(Path(__file__).parent / "boundary_elements.csv", ("creepage",)):
        found[row["material"], *(float(row[name]) for name in ("speed", "friction", "share"))].append(row)
    return {key: BoundaryElementContact(rows) for key, rows in found.items()}


@cache
def both_contacts(material, speed, friction, share):
    """Contact by finite and by boundary elements under the same torque."""
    torque = share * friction * R * fem.roll(LAYER, Roller(R, indentation=DEPTH), material, speed, estimate=False).load
    roller = Roller(R, indentation=DEPTH, friction=friction, rolling="driven")
    rolled = fem.roll(LAYER, roller, material, speed, torque=torque, estimate=False)
    return rolled, recorded()["elastic" if material == MIX else "relaxing", speed, friction, share]


# (a) closed forms


def adhesion(x, half_width):
    """p + i q over E* and the creepage of a free roller with full stick on a half-plane.

        H w + i b w = (x - i creepage R)/(2R),  w = p + i q,  H w = (1/pi) PV int w(s)/(x - s) ds

    is Galin's equation with -i b for f b, so alpha = 1/2 + i gamma, gamma = artanh(b)/pi, creepage = -2 gamma a/R.
    """
    gamma = np.arctanh((1 - 2 * NU) / (2 - 2 * NU)) / np.pi
    phase = np.exp(1j * gamma * np.log((half_width + x) / (half_width - x)))
    w = np.cosh(np.pi * gamma) / (2 * R) * np.sqrt(half_width**2 - x**2) * phase
    return w, -2 * gamma * half_width / R


@pytest.mark.slow
def test_free_roller_with_high_friction_sticks_completely():
    a, x = 0.004, np.linspace(-0.0038, 0.0038, 77)
    exact, creepage = adhesion(x, a)
    gamma = -creepage * R / (2 * a)
    numbers = []
    for height in (100 * a, 200 * a):
        load = np.pi * a**2 / (4 * R) * (1 + 4 * gamma**2)
        roller = Roller(R, load=load, friction=1.0, rolling="free")
        rolled = fem.roll(Layer(height), roller, Elastic(youngs_modulus=1 - NU**2, poisson=NU), 1.0, estimate=False)
        fields = np.interp(x, rolled.x, rolled.pressure), np.interp(x, rolled.x, rolled.shear_traction)
        numbers.append(np.concatenate([*fields, [rolled.creep]]))
    thick = 2 * numbers[1] - numbers[0]  # to a half-plane
    pressure, traction = np.split(thick[:-1], 2)
    assert pressure == pytest.approx(exact.real, abs=5e-3 * exact.real.max())
    assert traction == pytest.approx(exact.imag, abs=0.02 * exact.imag.max())
    assert thick[-1] == pytest.approx(creepage, rel=5e-3)


# (c) boundary elements


def zone_boundaries(reference, friction):
    """Boundaries of stick and slip zones by boundary elements."""
    sticks = np.abs(reference.traction) < friction * reference.pressure * (1 - 1e-4)
    return ((reference.x[1:] + reference.x[:-1]) / 2)[np.diff(sticks.astype(int)) != 0]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("friction", "share"),
    [
        *((0.1, share) for share in (FREE, DRIVEN, BRAKED)),
        (1.0, DRIVEN),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((0.35, FREE), (0.35, DRIVEN), (0.35, BRAKED))),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((1.0, FREE), (1.0, BRAKED))),
    ],
)
def test_elastic_rolling_agrees_with_boundary_elements(friction, share):
    assert_agreement(*both_contacts(MIX, 1.0, friction, share), friction)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "friction", "share"),
    [
        (0.003, 0.1, DRIVEN),
        (0.03, 0.35, BRAKED),
        pytest.param(0.003, 0.35, FREE, marks=pytest.mark.slow),
        pytest.param(0.03, 0.1, FREE, marks=pytest.mark.slow),
    ],
)
def test_viscoelastic_rolling_agrees_with_boundary_elements(speed, friction, share):
    assert_agreement(*both_contacts(SLS, speed, friction, share), friction)


def assert_agreement(rolled, reference, friction):
    """Traction within 2 % of the friction limit, farther than an element, a tenth of a, from a zone boundary."""
    a, limit = (rolled.leading - rolled.trailing) / 2, friction * rolled.peak_pressure
    assert rolled.load == pytest.approx(reference.load, rel=1e-3)
    assert rolled.resistance == pytest.approx(reference.resistance, abs=1e-3 * friction * rolled.load)
    assert rolled.creep == pytest.approx(reference.creepage, abs=0.01 * friction * a / R)
    x = np.linspace(rolled.trailing, rolled.leading, 401)[10:-10]
    traction, other = np.interp(x, rolled.x, rolled.shear_traction), np.interp(x, reference.x, reference.traction)
    away = np.abs(x[:, None] - zone_boundaries(reference, friction)).min(axis=1) > 0.1 * a
    assert np.abs(traction - other).mean() < 0.01 * limit
    assert traction[away] == pytest.approx(other[away], abs=0.02 * limit)
    pressure, under = np.interp(x, rolled.x, rolled.pressure), np.interp(x, reference.x, reference.pressure)
    slips, slipped = np.abs(traction) > 0.97 * friction * pressure, np.abs(other) > 0.97 * friction * under
    assert slips.mean() == pytest.approx(slipped.mean(), abs=0.03)  # share of the contact that slips


@pytest.mark.slow
@pytest.mark.parametrize("share", [FREE, DRIVEN, BRAKED], ids=["free", "driven", "braked"])
def test_work_of_resistance_and_torque_on_an_elastic_layer_is_dissipated_by_slip(share):
    # resistance + torque (1 + creepage)/R = - int q s dx, by either method
    rolled, reference = both_contacts(MIX, 1.0, 0.1, share)
    pull = reference.sum(reference.traction)
    lost = -reference.sum(reference.traction * reference.slip)
    assert lost == pytest.approx(reference.resistance - pull * (1 + reference.creepage), rel=0.05)
    assert lost == pytest.approx(rolled.resistance - pull * (1 + rolled.creep), rel=0.05)
    assert rolled.work_residual * max(abs(rolled.resistance), 1e-3 * rolled.load) < 0.05 * lost


# (d) hard cases


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("layer", "poisson", "friction", "share", "indentation"),
    [
        (LAYER, 0.074, 0.037, 0.5, 0.00235),  # all nodes slip in an iteration, which leaves the creepage undetermined
        (Layer(H, base="slip"), 0.005, 0.288, 0.9, 0.00032),
        (LAYER, 0.065, 0.777, 0.0, 0.00088),  # an edge converges to a node
        (Layer(H, base="slip"), 0.137, 0.934, 0.0, 0.00046),  # pressure and shear converge slowly
        (LAYER, 0.3, 3.0, 0.0, 0.0005),
    ],
    ids=["all-slip", "narrow-stick", "edge-on-node", "slow-convergence", "full-stick"],
)
def test_difficult_contact_converges(layer, poisson, friction, share, indentation):
    mix = Elastic(youngs_modulus=1.0, poisson=poisson)
    limit = friction * R * fem.roll(layer, Roller(R, indentation=indentation), mix, 1.0, estimate=False).load
    roller = Roller(R, indentation=indentation, friction=friction, rolling="driven")
    rolled = fem.roll(layer, roller, mix, 1.0, torque=share * limit, estimate=False)
    assert rolled.work_residual < 5e-3


# (e) properties


COARSE = mesh.graded_mesh(H, 0.0206, 6)


@examples(2, slow=6)
@given(
    st.floats(0.0, 0.49),
    st.floats(0.03, 0.5),
    st.floats(-0.8, 0.8),
    st.floats(-3, 1),
    st.sampled_from(["bonded", "slip"]),
    st.sampled_from(["parabola", "circle", "deformed"]),
)
def test_coulomb_law_holds_and_reversal_mirrors_the_contact(poisson, friction, share, decade, base, profile):
    mix = Viscoelastic(youngs_modulus=1.0, poisson=poisson, branches=((1.0, 1.0),))
    layer = Layer(H, base=base)
    speed = 0.02 * 10**decade
    numerics = {"mesh": COARSE, "estimate": False}
    limit = friction * R * fem.roll(layer, Roller(R, indentation=DEPTH, profile=profile), mix, speed, **numerics).load
    roller = Roller(R, indentation=DEPTH, friction=friction, rolling="driven", profile=profile)
    forth, back = (fem.roll(layer, roller, mix, sign * speed, torque=share * limit, **numerics) for sign in (1, -1))
    assert np.all(np.abs(forth.shear_traction) <= friction * (forth.pressure + 0.03 * forth.peak_pressure))
    assert np.trapezoid(forth.shear_traction, forth.x) == pytest.approx(-share * limit / R, abs=2e-3 * forth.load)
    assert forth.work_residual < 1e-2
    assert (back.load, -back.resistance, back.creep) == pytest.approx(
        (forth.load, forth.resistance, forth.creep), abs=1e-4 * friction * forth.load, rel=1e-6
    )
    assert back.shear_traction[::-1] == pytest.approx(-forth.shear_traction, abs=1e-4 * forth.peak_pressure)


# (f) cost


def rolled_by(material, speed, friction, share):
    """Contact of a driven roller; its torque is a share of friction times `FRICTIONLESS_LOAD`."""
    turned = Roller(R, indentation=DEPTH, friction=friction, rolling="driven")
    torque = share * friction * R * FRICTIONLESS_LOAD
    return fem.roll(LAYER, turned, material, speed, torque=torque, estimate=False)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("share", [FREE, DRIVEN], ids=["free", "driven"])
@pytest.mark.parametrize(("deborah", "modulus"), [(1e-4, 1.0), (1e4, 2.0)], ids=["slow", "fast"])
def test_limits_of_slow_and_fast_rolling_are_elastic(deborah, modulus, share):
    rolled = rolled_by(SLS, deborah * 0.0206, 0.35, share * modulus)
    elastic = rolled_by(replace(MIX, youngs_modulus=modulus), 1.0, 0.35, share * modulus)
    assert rolled.load == pytest.approx(elastic.load, rel=1e-3)
    assert rolled.creep == pytest.approx(elastic.creep, abs=2e-3 * 0.35 * 0.0206 / R)
    inside = np.abs(elastic.x) < 0.95 * elastic.leading
    traction = np.interp(elastic.x, rolled.x, rolled.shear_traction)
    assert traction[inside] == pytest.approx(elastic.shear_traction[inside], abs=0.02 * 0.35 * elastic.peak_pressure)


def test_closed_form_of_full_stick_satisfies_its_equation():
    a, b, x = 0.004, (1 - 2 * NU) / (2 - 2 * NU), np.linspace(-0.0035, 0.0035, 8)
    angle = (np.arange(20_000) + 0.5) * np.pi / 20_000
    s = a * np.cos(angle)
    (w, creepage), source = adhesion(x, a), adhesion(s, a)[0]
    smooth = (source - w[:, None]) / (x[:, None] - s) * a * np.sin(angle)
    principal = smooth.mean(axis=1) + w / np.pi * np.log((a + x) / (a - x))
    assert principal + 1j * b * w == pytest.approx((x - 1j * creepage * R) / (2 * R), abs=1e-6 * a / R)


def test_signs_of_torque_creepage_and_resistance():
    driven, free, braked = (rolled_by(SLS, 0.03, 0.3, share) for share in (DRIVEN, FREE, BRAKED))
    assert driven.creep > free.creep > braked.creep
    assert driven.resistance < 0 < free.resistance < braked.resistance
    for rolled, share in ((driven, DRIVEN), (free, FREE), (braked, BRAKED)):
        drag = rolled.resistance - np.trapezoid(rolled.pressure * rolled.x / R, rolled.x)
        assert drag == pytest.approx(-share * 0.3 * FRICTIONLESS_LOAD, abs=1e-3 * rolled.load)
