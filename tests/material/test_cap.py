"""Cap plasticity at a point: closed forms, rate equations, published paths. `test_yield_laws` has the properties."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from material_points import ONE, SHEAR_TWICE, split, von_mises, walked, yielding
from mixes import STIFF as MIX
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from compact.material import cap_plasticity

SIDES = pytest.mark.parametrize("dry_side", ["ellipse", "flat"])


def law(**other):
    return replace(MIX, **other)


def moduli(mix):
    return mix.bulk_modulus, mix.shear_modulus


# closed form


@pytest.mark.parametrize("steps", [1, 7, 200])
def test_isotropic_compression_follows_heckels_law(steps):
    K, constants = moduli(MIX)[0], cap_plasticity.cap_constants(MIX, 1.0)
    p, k = 0.0, 0.94
    for _ in range(steps):
        _, p, _, k, *_ = cap_plasticity.return_map(constants, p + K * 0.04 / steps, 0.0, k, k, 0.0)
    assert p == pytest.approx(np.log(0.28 / (1 - k)) / 13e-6, rel=1e-12)
    assert np.log(k / 0.94) + p / K == pytest.approx(0.04, rel=1e-12)


@pytest.mark.parametrize("critical_slope", [1, 1.2, 1.42])
def test_rigid_plastic_limit_follows_the_flow_rule(critical_slope):
    """Plastic strain without lateral part: eta = q/p = (sqrt(9 + 4 M^2) - 3)/2, and the ellipse at it."""
    mix = law(critical_slope=critical_slope, tensile_strength=0.0, unloading_modulus=1e15)
    end = walked(mix, [(0, 0.03, 0)])
    eta = (np.sqrt(9 + 4 * critical_slope**2) - 3) / 2
    side, up = -end.stress[0, :2]
    assert side / up == pytest.approx((3 - eta) / (3 + 2 * eta), rel=1e-8)
    expected = (1 + np.sqrt(1 + 4 * critical_slope**2 / 9)) / 2
    assert up / mix.yield_pressure(end.density_ratio[0]) == pytest.approx(expected, rel=1e-8)


@SIDES
def test_shear_at_constant_volume_ends_in_the_critical_state(dry_side):
    mix = law(dry_side=dry_side)
    pressed = walked(mix, [(0, 1e-4, 0)] * 300)
    sheared = walked(mix, [(0, 0, 0.01)] * 100, pressed)
    p, k = -split(sheared.stress)[0][0], sheared.density_ratio[0]
    assert 2 * p + 14e3 == pytest.approx(mix.yield_pressure(k), rel=1e-12)
    assert abs(sheared.stress[0, 3]) == pytest.approx(1.2 * (p + 14e3) / np.sqrt(3), rel=1e-12)
    assert sheared.density_ratio == pytest.approx(walked(mix, [(0, 0, 0.01)], sheared).density_ratio, rel=1e-14)


@SIDES
def test_unloading_is_elastic(dry_side):
    mix = law(dry_side=dry_side)
    K, G = moduli(mix)
    start = walked(mix, [(0, 0.02, 0.01)])
    end, slope = cap_plasticity.integrate_points(mix, start, np.array([[1e-4, 2e-4, -3e-4]]))
    wide, side = K + 4 * G / 3, K - 2 * G / 3
    assert slope[0] == pytest.approx(np.array([[wide, side, 0], [side, wide, 0], [0, 0, G]]), rel=1e-14)
    gained = [wide * 1e-4 + side * 2e-4, side * 1e-4 + wide * 2e-4, side * 3e-4, -G * 3e-4]
    assert (end.stress - start.stress)[0] == pytest.approx(np.array(gained), rel=1e-9)
    assert end.density_ratio == start.density_ratio
    assert end.plastic_work == start.plastic_work


def test_flat_side_shears_at_constant_volume():
    mix = law(dry_side="flat")
    end = walked(mix, [(0, 0, 0.001)] * 50)
    limit = 1.2 * (mix.yield_pressure(0.94) + 14e3) / 2
    assert von_mises(end.stress)[0] == pytest.approx(limit, rel=1e-12)
    assert end.density_ratio[0] == 0.94
    assert split(end.stress)[0][0] == pytest.approx(0, abs=1e-6 * limit)


@SIDES
def test_tension_ends_at_the_tensile_strength(dry_side):
    """Isotropic tension ends at p = -pt at any density."""
    mix = law(dry_side=dry_side)
    constants, K = cap_plasticity.cap_constants(mix, 1.0), moduli(mix)[0]
    _, p, _, k, memory, work, *_ = cap_plasticity.return_map(constants, -0.05 * K, 0.0, 0.94, 0.94, 0.0)
    assert p == pytest.approx(-14e3, rel=1e-12)
    assert np.log(k / 0.94) == pytest.approx(-0.05 - p / K, rel=1e-12)
    assert memory == (0.94 if dry_side == "flat" else k)
    assert work == pytest.approx(p * np.log(k / 0.94), rel=1e-12)


def test_pc_depends_on_the_largest_density():
    """Cycles do not ratchet: after loosening, the mix hardens only beyond its largest density."""
    mix = law(dry_side="flat")
    state = walked(mix, [(0, 0.03, 0)])
    densest = state.density_ratio[0]
    for _ in range(5):
        state = walked(mix, [(0, -0.02, 0), (0, 0.02, 0)], state)
        assert state.max_density_ratio[0] == max(densest, state.density_ratio[0])
        densest = state.max_density_ratio[0]
    assert densest < 0.9713  # an elastic stroke is all that five cycles have pressed further


@pytest.mark.parametrize("rate", [0.02, 2.0])
def test_rate_factor_scales_the_cap(rate):
    slow = law(rate_sensitivity=0.025, reference_rate=1e-3)
    factor = slow.rate_factor(rate)
    assert factor == pytest.approx(1 + 0.025 * np.log(1 + rate / 1e-3), rel=1e-15)
    end = walked(slow, [(0, 0.001, 0.0005)] * 20, rate_factor=factor)
    other = walked(law(heckel_slope=13e-6 / factor), [(0, 0.001, 0.0005)] * 20)
    assert end.stress == pytest.approx(other.stress, rel=1e-13)
    assert abs(yielding(slow, end.stress, end.max_density_ratio, factor)[0][0]) < 1e-12


# the rate equations of the full ellipse, integrated without any return mapping


def rates(mix, stress, k, strain):
    """d stress and dk for a strain rate (xx, yy, zz, xy), compression positive, on the yield surface."""
    K, G = moduli(mix)
    M, pt, pc = mix.critical_slope, mix.tensile_strength, float(mix.yield_pressure(k))
    H = k / (mix.heckel_slope * (1 - k))
    (p, s), (mean, e) = split(stress), split(strain)
    u, q2 = 2 * p + pt - pc, 1.5 * (s * s) @ SHEAR_TWICE
    flow = K * u * 3 * mean + 6 * G / M**2 * (s * e) @ SHEAR_TWICE
    flow /= K * u**2 + 12 * G * q2 / M**4 + (p + pt) * H * u
    return K * 3 * mean * ONE + 2 * G * e - flow * (K * u * ONE + 6 * G / M**2 * s), k * flow * u


def hooke(mix, strain):
    K, G = moduli(mix)
    mean, e = split(strain)
    return 3 * K * mean[..., None] * ONE + 2 * G * e


def first_yield(mix, strain):
    """Share of a straight path from zero stress at which the mix yields."""
    return brentq(lambda t: yielding(mix, -t * hooke(mix, strain), mix.fed_density_ratio)[0], 1e-9, 1, xtol=1e-16)


def followed(mix, strain, **conditions):
    """Stress (compression positive) and k at the end of the straight path, by the rate equations."""
    start = first_yield(mix, strain)
    stress = start * hooke(mix, strain)

    def right(_, y):
        return np.append(*rates(mix, y[:4], y[4], strain))

    path = solve_ivp(right, (start, 1), [*stress, mix.fed_density_ratio], method="DOP853", rtol=1e-12, atol=1e-9)
    return path.y[:4, -1], path.y[4, -1]


def stepped(mix, strain, steps):
    """The same by one elastic step and equal plastic ones, at increments (xx, yy, 2 xy)."""
    start, plane = first_yield(mix, strain), strain[[0, 1, 3]] * [1, 1, 2]
    end = walked(mix, [start * plane] + [(1 - start) / steps * plane] * steps)
    return np.append(-end.stress[0], end.density_ratio[0])


def extrapolated(mix, strain, finest=512, levels=7):
    """Romberg's table over step sizes h, h/2, ... of an error in whole powers of h."""
    row = [stepped(mix, strain, finest >> level) for level in range(levels)][::-1]
    for order in range(1, levels):
        row = [fine + (fine - rough) / (2**order - 1) for rough, fine in pairwise(row)]
    return row[0]


PATHS = {  # uniform small strain (xx, yy, zz, xy), compression positive: sx, sy, sz, tau in kPa, k
    "oedometer .01": ((0, 0.01, 0, 0), (96.0440, 150.2551, None, 0), 0.94836432),
    "oedometer .03": ((0, 0.03, 0, 0), (122.5914, 190.1193, None, 0), 0.96722280),
    "oedometer .05": ((0, 0.05, 0, 0), (172.5328, 265.8910, None, 0), 0.98618440),
    "log .01": ((0, -np.log(0.99), 0, 0), (96.0975, 150.3352, None, 0), 0.94841147),
    "log .02": ((0, -np.log(0.98), 0, 0), (108.0620, 168.2789, None, 0), 0.95795542),
    "log .03": ((0, -np.log(0.97), 0, 0), (123.3706, 191.2924, None, 0), 0.96765824),
    "log .05": ((0, -np.log(0.95), 0, 0), (177.7910, 273.9638, None, 0), 0.98739946),
    "x stretched": ((-0.009, 0.03, 0, 0), (79.3042, 165.3647, 99.1644, 0), 0.95884915),
    "x pressed": ((0.0045, 0.015, 0, 0), (127.7755, 163.9442, 112.2746, 0), 0.95721998),
    "sheared": ((0, 0.015, 0, 0.0075), (96.8506, 146.9643, 96.8506, 25.0568), 0.95312334),
}


@pytest.mark.parametrize("name", PATHS)
def test_rate_equations_give_the_published_paths(name):
    strain, stress, k = PATHS[name]
    got, density_ratio = followed(MIX, np.array(strain))
    published = [value * 1e3 if value is not None else got[2] for value in stress]
    assert got == pytest.approx(published, abs=0.051)
    assert density_ratio == pytest.approx(k, abs=6e-9)


SUBCRITICAL = (-0.0015, 0, 0, 0.003)  # where the full ellipse dilates and softens


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    ("path", "dry_side"),
    [
        *((PATHS[name][0], side) for side in ("flat", "ellipse") for name in PATHS if not name.startswith("log")),
        (SUBCRITICAL, "ellipse"),
    ],
)
def test_small_steps_converge_to_the_rate_equations(path, dry_side):
    strain = np.array(path)
    stress, density_ratio = followed(MIX, strain)
    got = extrapolated(law(dry_side=dry_side), strain)
    assert got[:4] == pytest.approx(stress, rel=1e-8, abs=1e-8 * von_mises(stress))
    assert got[4] == pytest.approx(density_ratio, rel=1e-8)
    assert (density_ratio < 0.9395) == (path == SUBCRITICAL)


@pytest.mark.parametrize("name", ["oedometer .03", "x stretched", "x pressed", "sheared"])
def test_error_is_of_first_order_in_the_step(name):
    strain = np.array(PATHS[name][0])
    exact = np.append(*followed(MIX, strain))
    steps = np.array([40, 80, 160, 320])
    error = [np.abs((stepped(MIX, strain, n) - exact) / exact.max()).max() for n in steps]
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(-1, abs=0.05)


@SIDES
def test_lateral_pressure_of_50_kpa_is_kept(dry_side):
    """Biaxial: e_y = .05 from 50 kPa all round while s_x stays."""
    mix = law(dry_side=dry_side)

    def held(steps):
        state, e_x = replace(cap_plasticity.initial_state(mix, 1), stress=-50e3 * ONE[None]), 0.0
        for _ in range(steps):
            for _ in range(30):
                new, slope = cap_plasticity.integrate_points(mix, state, np.array([[-e_x, -0.05 / steps, 0.0]]))
                excess = -new.stress[0, 0] - 50e3
                if abs(excess) < 1e-6:
                    break
                e_x -= excess / slope[0, 0, 0]
            state = new
        assert abs(excess) < 1e-6
        return np.append(-state.stress[0, :3], state.density_ratio[0])

    assert 2 * held(800) - held(400) == pytest.approx([50e3, 158508.0, 90120.5, 0.96256004], rel=1e-6)


def test_shear_at_constant_volume_gives_the_published_stress():
    def sheared(steps):
        state = walked(MIX, [(0, 0.03 / steps, 0)] * steps)
        state = walked(MIX, [(0, 0, 0.02 / steps)] * steps + [(0, 0, 0.2)] * 10, state)
        return np.array([-split(state.stress)[0][0], abs(state.stress[0, 3]), state.density_ratio[0]])

    coarse, fine = sheared(200), sheared(400)
    assert 2 * fine - coarse == pytest.approx([76291.4, 62555.7, 0.96788856], rel=2e-5)


@SIDES
@pytest.mark.parametrize(
    ("other", "pressed", "released", "side_before", "side_after"),
    [
        ({}, 0.02, 0.01897858, 108.0620, 35.9425),
        ({}, 0.03, 0.02885065, 123.3706, 41.3881),
        ({"critical_slope": 1.0, "poisson": 0.2}, 0.02, 0.0188183434, 116.1076, 75.9395),
    ],
)
def test_release_of_the_oedometer_is_elastic(other, pressed, released, side_before, side_after, dry_side):
    mix = law(dry_side=dry_side, **other)
    down, up = -np.log(1 - pressed), np.log((1 - released) / (1 - pressed))

    def side(steps):
        loaded = walked(mix, [(0, down / steps, 0)] * steps)
        free = walked(mix, [(0, -up, 0)], loaded)
        assert free.density_ratio == loaded.density_ratio
        return -np.array([loaded.stress[0, 0], free.stress[0, 0], free.stress[0, 1]])

    got = 2 * side(800) - side(400)
    assert got == pytest.approx([side_before * 1e3, side_after * 1e3, 0], rel=2e-5, abs=2.0)


@pytest.mark.parametrize("tensile_strength", [0.0, 0.4e6, 1e6])
def test_compacted_state_of_cohesive_mix_is_left_in_tension(tensile_strength):
    """Its Heckel curve lies below the stress that the tensile strength carries, so that the rest strain is smaller."""
    mix = law(tensile_strength=tensile_strength, fed_density_ratio=0.85, heckel_test="confined")
    found = cap_plasticity.compacted_state(mix, 0.9)
    assert found.density_ratio[0] == pytest.approx(0.9, abs=1e-12)
    assert (found.stress[0, 0] > 0) == (tensile_strength > 0)
    assert found.stress[0, 1] == pytest.approx(0.0, abs=1e-6)
