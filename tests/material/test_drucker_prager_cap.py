"""Drucker-Prager cap at a point: closed forms, Koiter's conditions, carried pressure, order, viscosity, refusals."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from material_points import split, von_mises, walked
from mixes import oedometer, shear_line
from scipy.optimize import brentq

from compact.material import cap_plasticity
from compact.material.drucker_prager_cap import is_elastic_in_line, return_to_line
from compact.material.laws import cap_slope, earth_pressure_bounds, matched_slopes

PRESSURE = 200e3  # Pa, at which K0 holds
HECKEL_SLOPE = 14.96e-6
DENSE = 0.94
ROUNDING = 1e-12
law = partial(shear_line, 0.9)


# (a) closed forms


@pytest.mark.parametrize(("friction_angle", "slope"), [(28, 1.4715), (35, 1.786), (38, 1.9274)])
def test_cap_slope_has_the_published_values(friction_angle, slope):
    strength = 10e3 / np.tan(np.radians(friction_angle))
    coefficient = 1 - np.sin(np.radians(friction_angle))
    assert cap_slope(coefficient, PRESSURE, strength) == pytest.approx(slope, abs=5e-4)


def test_bounds_of_the_earth_pressure_are_those_of_the_line():
    found = [earth_pressure_bounds(matched_slopes(angle)[0], PRESSURE, 0.0) for angle in (28, 35, 38, 40, 45)]
    assert [low for low, _ in found] == pytest.approx([0.473, 0.402, 0.377, 0.361, 0.326], abs=5e-4)
    assert [high for _, high in found][:3] == pytest.approx([0.819, 0.751, 0.723], abs=5e-4)


def biaxial_failure(mix, pressure):
    """Principal stresses, shifted by pt, of plane compression at a lateral pressure."""
    state = replace(
        cap_plasticity.initial_state(mix, 1),
        stress=-pressure * np.array([[1.0, 1, 1, 0]]),
        max_density_ratio=np.array([0.985]),  # a large cap, so that mix fails on the line
    )
    for _ in range(40):
        strain = np.array([1e-6, -2e-4, 0.0])
        for _ in range(60):
            new, slope = cap_plasticity.integrate_points(mix, state, strain[None])
            excess = new.stress[0, 0] + pressure
            if abs(excess) < 1e-9 * pressure:
                break
            strain[0] -= excess / slope[0, 0, 0] if slope[0, 0, 0] > 1e3 else -1e-5
        state = new
    return -state.stress[0, [0, 1]] + mix.tensile_strength


@pytest.mark.parametrize("friction_angle", [20.0, 30.0, 35.0])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_biaxial_test_mobilises_the_friction_angle(friction_angle, share):
    mix = law(friction_angle, 0.6, dilatancy_angle=share * friction_angle)
    lateral, vertical = biaxial_failure(mix, 10e3)
    angle = np.degrees(np.arcsin((vertical - lateral) / (vertical + lateral)))
    assert angle == pytest.approx(friction_angle, abs=0.001)


def test_shear_below_the_corner_leaves_the_density():
    mix = law()
    state = replace(
        cap_plasticity.initial_state(mix, 1),
        stress=-5e3 * np.array([[1.0, 1, 1, 0]]), max_density_ratio=np.array([DENSE]),
    )  # fmt: skip
    end = walked(mix, [(0, 0, 1e-3)] * 20, state)
    (p,), (q,) = -split(end.stress)[0], von_mises(end.stress)
    assert p == pytest.approx(5e3, rel=1e-9)
    assert q == pytest.approx(mix.friction_slope * (5e3 + mix.tensile_strength), rel=1e-12)
    assert end.density_ratio[0] == 0.9


def test_dilatant_shear_does_not_soften_the_cap():
    mix = law(dilatancy_angle=10.0)
    start = walked(mix, [(0, 1e-3, 0)] * 20)
    end = walked(mix, [(-1e-3, 0.5e-3, 1e-3)] * 20, start)
    assert end.density_ratio < start.density_ratio
    assert end.max_density_ratio == start.max_density_ratio


# (b) Koiter's conditions


def random_steps(mix, count, seed=0):
    """Trial states around the surfaces and their returns: trial P, q; P, q, V, a, u, work; a of the trial."""
    random = np.random.default_rng(seed)
    constants = cap_plasticity.cap_constants(mix, 1.0)
    k = random.uniform(0.85, 0.985, count)
    largest = np.maximum(k, np.where(random.random(count) < 0.5, k, random.uniform(0.85, 0.985, count)))
    a, u = (mix.yield_pressure(largest) + mix.tensile_strength) / 2, mix.saturation_pressure(largest)
    size = 10 ** random.uniform(-3, 1.5, count)
    P, q = a * (random.uniform(-0.5, 2.2, count) + size * random.normal(size=count)), a * size * random.random(count)
    P += u * random.uniform(0, 1.2, count)
    q += a * random.uniform(0, 2, count)
    rows = []
    for trial in zip(P - mix.tensile_strength, q, k, largest, strict=True):
        iterations, p, scale, after, hardened, work, _, _ = return_to_line(constants, *trial, 0.0, np.nan, 1.0)
        assert iterations < 100
        rows.append((p + constants.pt, scale * trial[1], np.log(after / trial[2]), work, hardened))
    end, end_q, V, work, hardened = np.array(rows).T
    end_a = (mix.yield_pressure(hardened) + mix.tensile_strength) / 2
    return constants, (P, q), (end, end_q, V, end_a, mix.saturation_pressure(hardened), work), a


@pytest.mark.parametrize("dilatancy_angle", [0.0, 12.0])
@pytest.mark.parametrize(
    "limit", [{}, {"saturation_limit": 0.95, "saturation_modulus": 3e6}, {"saturation_limit": 0.95}]
)
def test_random_steps_satisfy_koiters_conditions(limit, dilatancy_angle):
    """Active are the cap or its top, the line, and the cut-off; where u is large, the line meets the top."""
    mix = replace(law(dilatancy_angle=dilatancy_angle), **limit)
    law_, (P_tr, q_tr), (P, q, V, a, u, work), _ = random_steps(mix, 10_000)
    M, N, cap = law_.friction, law_.dilatancy, law_.M
    e = (q_tr - q) / (3 * law_.G)
    size = np.abs(P_tr) + q_tr + a + u  # of stresses; strains are compared times the moduli
    assert (P_tr - P - law_.K * V) / size == pytest.approx(0, abs=ROUNDING)
    # yield limits
    y = np.maximum(P - a - u, 0.0)
    f_cap = (q**2 / cap**2 + y**2 - a**2) / (a * size)
    f_line = (q - M * P) / size
    assert P.min() >= 0
    assert f_line.max() < ROUNDING
    assert f_cap.max() < ROUNDING
    # multipliers
    on_cap, on_line, apex = f_cap > -ROUNDING, f_line > -ROUNDING, ROUNDING * a >= P
    normal = q / cap**2  # of the cap over shear, y over volume; the larger determines its multiplier
    with np.errstate(divide="ignore", invalid="ignore"):
        shared = np.nan_to_num((e * y - normal * V) / (y + N * normal))
        line = np.where(on_cap & on_line, shared, np.where(on_line, e, 0.0))
        by_cap = np.where(on_cap, np.where(y > normal, (V + N * line) / y, (e - line) / normal), 0.0)
    cut = np.where(apex, -V - N * line, 0.0)
    for multiplier, scale in ((line, law_.G), (by_cap * a, law_.K), (cut, law_.K)):
        assert (multiplier * scale / size).min() > -ROUNDING
    # flow of the active surfaces only
    assert (law_.K * np.abs(V - (by_cap * y - N * line - cut)) / size).max() < ROUNDING
    assert (law_.G * np.abs(e - by_cap * normal - line) / size).max() < ROUNDING
    assert (work >= -ROUNDING * size).all()
    # every part of the surface is met
    yields, round_cap = (V != 0) | (e != 0), on_cap & (y > 0)
    top = on_cap & (y == 0)
    parts = [round_cap & ~on_line, round_cap & on_line, on_line & ~on_cap & ~apex, apex]
    if limit:
        parts += [top & ~on_line, (u > 0) & round_cap & ~on_line]
    if "saturation_modulus" in limit:
        parts += [(u > 0) & round_cap & on_line] + [top & on_line] * (N > 0)
    counts = [np.sum(part & yields) for part in parts]
    assert min(counts[:4]) > 300, counts
    assert min(counts) > 20, counts


def test_carried_pressure_at_the_solution_gives_the_same_stress():
    """Where p' is the pressure after the step, both forms of the line are one law without dilatancy."""
    mix = law()
    constants = cap_plasticity.cap_constants(mix, 1.0)
    random = np.random.default_rng(3)
    for _ in range(500):
        k = random.uniform(0.9, 0.98)
        C = mix.yield_pressure(k) + mix.tensile_strength
        trial = (C * random.uniform(0.02, 1.3) - mix.tensile_strength, C * random.uniform(0.1, 3), k, k)
        direct = return_to_line(constants, *trial, 0.0, np.nan, 1.0)
        carried = return_to_line(constants, *trial, 0.0, direct[1], 1.0)
        assert carried[1] == pytest.approx(direct[1], abs=1e-9 * C)
        assert carried[2] * trial[1] == pytest.approx(direct[2] * trial[1], abs=1e-9 * C)
        assert carried[3] == pytest.approx(direct[3], rel=1e-9)


# (c) order and viscosity


def test_error_is_of_first_order_in_the_step():
    """Backward Euler along a path over cap, corner and line; the apex is left out."""
    mix = law()
    path = np.array([(0, 0.03, 0.0), (-0.004, 0.006, 0.01), (0.001, 0.01, -0.01)])

    def end(steps):
        state = walked(mix, np.repeat(path / steps, steps, axis=0))
        return np.append(state.stress[0] / 1e5, state.density_ratio[0])

    results = [end(steps) for steps in (50, 100, 200, 400, 800)]
    changes = [np.abs(fine - coarse).max() for coarse, fine in pairwise(results)]
    assert np.polyfit(np.arange(4), np.log2(changes), 1)[0] == pytest.approx(-1, abs=0.1)


def test_viscous_stress_is_proportional_to_the_shear_over_the_travel():
    """Simple shear on the line: q - M P = S times the plastic shear strain over the travel."""
    mix = law(shear_viscosity=600.0)
    state = -5e3 * np.array([1.0, 1, 1, 0])
    for travel in (1e-3, 1e-2):
        constants = cap_plasticity.cap_constants(mix, 1.0, travel=travel)
        before = (*state, 0.9, DENSE)
        for _ in range(30):
            good, before, _, _ = cap_plasticity.integrate_point(
                constants, True, before, (0.0, 0.0, 1e-3), 0.0, 1.0, np.nan, np.empty((6, 0))
            )
            assert good
        stress = np.array(before[:4])
        p, q = -split(stress)[0], von_mises(stress)
        excess = q - mix.friction_slope * (p + mix.tensile_strength)
        assert excess == pytest.approx(600.0 * 1e-3 / np.sqrt(3) / travel, rel=1e-9)


# (d) refusals


def bound_of_45_degrees():
    """Least cohesion at which the cap of Jaky's K0 lies inside the line, K0' = (3 - M)/(3 + 2 M) with pt = c cot 45."""
    jaky, slope = 1 - np.sqrt(0.5), np.sqrt(1.5)
    least = (3 - slope) / (3 + 2 * slope)
    return PRESSURE * (least - jaky) / (1 - least)


def test_jakys_coefficient_at_45_degrees_requires_cohesion():
    """A steeper cap is refused; at the bound itself the oedometer flows on the cap at K0, off the line."""
    least = bound_of_45_degrees()
    assert least == pytest.approx(9751, abs=1)
    for cohesion in (0.0, least - 1):
        with pytest.raises(ValueError, match=r"must be between 0\.\d+ and 0\.\d+ for a friction angle of 45 degrees"):
            law(45.0, cohesion=cohesion)
    mix = law(45.0, cohesion=10e3)
    stress, coefficient, k = oedometer(mix, PRESSURE)[-1]
    assert coefficient == pytest.approx(1 - np.sqrt(0.5), abs=0.005)
    assert stress == pytest.approx(np.log(0.28 / (1 - k)) / HECKEL_SLOPE, rel=1e-6)
    vertical, lateral = stress + mix.tensile_strength, coefficient * stress + mix.tensile_strength
    assert vertical - lateral < mix.friction_slope * (vertical + 2 * lateral) / 3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: law(35.0, 0.85), r"`earth_pressure_coefficient` must be between .* got 0.8500"),
        (lambda: matched_slopes(30.0, 31.0), "dilatancy_angle"),
        (lambda: replace(law(), dilatancy_slope=1.1), "`dilatancy_slope` must be between 0 and"),
        (lambda: replace(law(), dry_side="ellipse"), "dry_side"),
    ],
)
def test_angles_and_slopes_out_of_order_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_limit_of_the_elastic_range_is_that_of_the_return():
    mix = law()
    constants, (P, q), (end, end_q, V, _, _, _), a = random_steps(mix, 2000, seed=4)
    rng = np.random.default_rng(1)
    for i in rng.integers(0, 2000, 300):
        densest = float(brentq(lambda k, i=i: (mix.yield_pressure(k) + mix.tensile_strength) / 2 - a[i], 0.73, 0.998))
        inside = is_elastic_in_line(constants, P[i] - mix.tensile_strength, q[i], densest, np.nan)
        assert inside == (V[i] == 0 and end_q[i] == q[i] and end[i] == P[i]) or abs(V[i]) < 1e-14
