"""Cap plasticity at a point: closed forms, rate equations, published paths, hard cases, balances, iterations."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from mixes import STIFF as MIX
from mixes import shear_line
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from compact.material import cap_plasticity
from compact.material.laws import DruckerPragerCap

SIDES = pytest.mark.parametrize("dry_side", ["ellipse", "flat"])
LAWS = {
    "ellipse": MIX,
    "flat": replace(MIX, dry_side="flat"),
    "shear line": shear_line(),
    "dilatant line": shear_line(dilatancy_angle=12.0),
}
ALL = pytest.mark.parametrize("mix", LAWS.values(), ids=LAWS)
SHEAR_TWICE = np.array([1.0, 1.0, 1.0, 2.0])  # weights of (xx, yy, zz, xy) in a product of tensors
ONE = np.array([1.0, 1.0, 1.0, 0.0])
HARD = {
    "plain": {},
    "no strength": {"tensile_strength": 0.0},
    "hardly any strength": {"tensile_strength": 1e-6},
    "stronger than its cap": {"tensile_strength": 300e3},
    "nearly incompressible": {"poisson": 0.4999},
    "no Poisson's ratio": {"poisson": 0.0},
    "soft": {"unloading_modulus": 5e6},
    "rigid": {"unloading_modulus": 1e12},
    "weak in shear": {"critical_slope": 0.3},
    "strong in shear": {"critical_slope": 2.5},
    "fed loose": {"fed_density_ratio": 0.7201},
    "fed dense": {"fed_density_ratio": 0.9999},
}


def law(**other):
    return replace(MIX, **other)


def walked(mix, steps, state=None, move=cap_plasticity.integrate_points, **options):
    """State of one point after strain increments (xx, yy, 2 xy), compression positive."""
    state = cap_plasticity.initial_state(mix, 1) if state is None else state
    for strain in -np.atleast_2d(np.asarray(steps, dtype=float)):
        state, _ = move(mix, state, strain[None], tangent=False, **options)
    return state


def moduli(mix):
    E, nu = mix.unloading_modulus, mix.poisson
    return E / (3 - 6 * nu), E / (2 + 2 * nu)


def split(tensor):
    """Mean and deviator of (xx, yy, zz, xy) along the last axis."""
    mean = tensor[..., :3].mean(axis=-1)
    return mean, tensor - mean[..., None] * ONE


def von_mises(stress):
    s = split(stress)[1]
    return np.sqrt(1.5 * (s * s) @ SHEAR_TWICE)


def yielding(mix, stress, hardened, factor=1.0):
    """f/a^2, df/dp and df/dq from the definition; p and q compression positive."""
    M, pt, pc = mix.critical_slope, mix.tensile_strength, mix.yield_pressure(hardened) * factor
    p, q = -split(stress)[0], von_mises(stress)
    if isinstance(mix, DruckerPragerCap):
        P, C = p + pt, pc + pt
        cap = np.where(M**2 / (M**2 + mix.friction_slope**2) * C < P, q**2 / M**2 + P * (P - C), -np.inf)
        return np.max([4 * cap / C**2, (q - mix.friction_slope * P) / C, -P / C], axis=0), np.nan, np.nan
    a, c = (pc + pt) / 2, (pc - pt) / 2
    if mix.dry_side == "ellipse":
        return (q**2 / M**2 + (p + pt) * (p - pc)) / a**2, 2 * p + pt - pc, 2 * q / M**2
    p0, rounding = np.minimum(c, 0), 0.0 if pt > 1 else 1e-12 * a  # p comes from stresses of the size of a
    inward = a / (p0 + pt + rounding)
    dry, wet = inward * np.minimum(p - p0 + rounding, 0), np.maximum(p - c, 0)
    return (q**2 / M**2 + wet**2 + dry**2) / a**2 - 1, 2 * (wet + dry * inward), 2 * q / M**2


def plastic_strain(mix, before, after, strain):
    """Plastic part of strain increments (xx, yy, 2 xy) by Hooke's law, as a tensor (xx, yy, zz, xy), shape (n, 4)."""
    K, G = moduli(mix)
    total = np.column_stack((strain[:, 0], strain[:, 1], np.zeros(len(strain)), strain[:, 2] / 2))
    mean, s = split(after.stress - before.stress)
    return total - mean[:, None] / (3 * K) * ONE - s / (2 * G)


def scattered(n, largest, seed=0):
    """Random strain increments up to `largest`."""
    random = np.random.default_rng(seed)
    strain = random.normal(size=(n, 3))
    return strain * (largest * random.random(n) / np.linalg.norm(strain, axis=1))[:, None]


def admissible(mix, n, steps=3, largest=0.03, seed=1):
    """Random admissible states, on the yield surface and inside."""
    state = cap_plasticity.initial_state(mix, n)
    for i in range(steps):
        state, _ = cap_plasticity.integrate_points(mix, state, scattered(n, largest, seed + i), tangent=False)
    return cap_plasticity.integrate_points(mix, state, scattered(n, 1e-4, seed + steps), tangent=False)[0]


# closed form


@pytest.mark.parametrize("steps", [1, 7, 200])
def test_isotropic_compression_follows_heckels_law(steps):
    K, constants = moduli(MIX)[0], cap_plasticity.cap_constants(MIX, 1.0)
    p, k = 0.0, 0.94
    for _ in range(steps):
        _, p, _, k, *_ = cap_plasticity.return_map(constants, p + K * 0.04 / steps, 0.0, k, k, 0.0)
    assert p == pytest.approx(np.log(0.28 / (1 - k)) / 13e-6, rel=1e-12)
    assert np.log(k / 0.94) + p / K == pytest.approx(0.04, rel=1e-12)


@pytest.mark.parametrize("steps", [1, 10, 100])
@pytest.mark.parametrize(
    ("critical_slope", "side_share", "over_cap"), [(1, 0.7481, 1.1009), (1.2, 0.6713, 1.1403), (1.42, 0.5893, 1.1885)]
)
def test_oedometer_of_a_rigid_plastic_mix(critical_slope, side_share, over_cap, steps):
    mix = law(critical_slope=critical_slope, tensile_strength=0.0, unloading_modulus=3e10)
    end = walked(mix, [(0, 0.03 / steps, 0)] * steps)
    side, up = -end.stress[0, :2]
    assert side / up == pytest.approx(side_share, rel=1e-3)
    assert up / mix.yield_pressure(end.density_ratio[0]) == pytest.approx(over_cap, rel=1e-3)


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


def test_flat_side_without_strength_has_no_negative_pressure():
    mix = law(dry_side="flat", tensile_strength=0.0)
    end = walked(mix, [(-0.01, -0.01, 0.02)])
    limit = 1.2 * mix.yield_pressure(0.94) / 2
    assert split(end.stress)[0][0] == pytest.approx(0, abs=1e-9 * limit)
    assert von_mises(end.stress)[0] == pytest.approx(limit, rel=1e-12)
    assert end.density_ratio[0] == pytest.approx(0.94 * np.exp(-0.02), rel=1e-12)


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


def test_rate_independent_mix_has_the_rate_factor_one():
    assert MIX.rate_factor(17.0) == law(rate_sensitivity=0.03).rate_factor(0.0) == 1.0


def test_stress_relaxes_onto_the_cap_of_a_lower_speed():
    fast = walked(MIX, [(0, 0.01, 0)] * 3, rate_factor=1.06)
    still = walked(MIX, [(0, 0, 0)], fast)
    assert abs(yielding(MIX, still.stress, still.max_density_ratio)[0][0]) < 1e-12
    assert 0 < np.log(still.density_ratio[0] / fast.density_ratio[0]) < 1e-3


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


@pytest.mark.sampled(4)
@SIDES
@pytest.mark.parametrize(
    "name", [name for name in PATHS if not name.startswith("log")]
)  # log: other strains of the oedometer
def test_small_steps_converge_to_the_rate_equations(name, dry_side):
    strain = np.array(PATHS[name][0])
    stress, density_ratio = followed(MIX, strain)
    got = extrapolated(law(dry_side=dry_side), strain)
    assert got[:4] == pytest.approx(stress, rel=1e-8, abs=1e-8 * stress[1])
    assert got[4] == pytest.approx(density_ratio, rel=1e-8)


@pytest.mark.parametrize("name", ["oedometer .03", "x stretched", "x pressed", "sheared"])
def test_error_is_of_first_order_in_the_step(name):
    strain = np.array(PATHS[name][0])
    exact = np.append(*followed(MIX, strain))
    steps = np.array([40, 80, 160, 320])
    error = [np.abs((stepped(MIX, strain, n) - exact) / exact.max()).max() for n in steps]
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(-1, abs=0.05)


def test_error_of_fifty_equal_steps_is_as_documented():
    """6.5e-7 in s_v and 7e-5 in s_h at e = .04, with first yield anywhere in its step."""
    exact, _ = followed(MIX, np.array([0, 0.04, 0, 0]))
    end = walked(MIX, [(0, 0.04 / 50, 0)] * 50)
    assert np.abs(-end.stress[0, :2] / exact[:2] - 1) == pytest.approx([7.0e-5, 6.5e-7], rel=0.01)


def test_small_steps_on_the_subcritical_side_converge_to_the_rate_equations():
    """The full ellipse dilates and softens there."""
    strain = np.array([-0.0015, 0, 0, 0.003])
    stress, density_ratio = followed(MIX, strain)
    assert density_ratio < 0.9395
    got = extrapolated(MIX, strain)
    assert got[:4] == pytest.approx(stress, rel=1e-8, abs=1e-8 * von_mises(stress))
    assert got[4] == pytest.approx(density_ratio, rel=1e-8)


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


# hard cases


@pytest.mark.sampled(32)
@SIDES
@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("largest", [1e-9, 1e-3, 0.05, 2.0])
def test_every_increment_converges(name, dry_side, largest):
    """Increments include pure shear, pure volume and zero; the states result from such increments."""
    mix, n = law(dry_side=dry_side, **HARD[name]), 2000
    state = cap_plasticity.initial_state(mix, n)
    for i in range(6):
        strain = scattered(n, largest, seed=i)
        strain[: n // 8, :2] = 0
        strain[n // 8 : n // 4, 1], strain[n // 8 : n // 4, 2] = strain[n // 8 : n // 4, 0], 0
        strain[n // 4 : n // 3] *= (-1) ** i
        strain[n // 3 : n // 2 : 2] = 0
        state, slopes = cap_plasticity.integrate_points(mix, state, strain)
        assert yielding(mix, state.stress, state.max_density_ratio)[0].max() < 1e-12
        assert np.isfinite(slopes).all()
        assert (state.density_ratio > 0).all()
        assert (state.max_density_ratio >= state.density_ratio).all()


@ALL
@pytest.mark.parametrize("n", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_random_increments_converge(mix, n):
    """No stress exceeds the yield surface, and no plastic work is negative."""
    state = cap_plasticity.initial_state(mix, n)
    for i in range(10):
        before, (state, slopes) = state, cap_plasticity.integrate_points(mix, state, scattered(n, 0.05, seed=i))
        assert yielding(mix, state.stress, state.max_density_ratio)[0].max() < 1e-12
        assert np.isfinite(slopes).all()
        assert (state.plastic_work >= before.plastic_work).all()


@SIDES
@pytest.mark.parametrize("nearness", [0.0, 1e-17, 1e-14, 1e-11, 1e-6])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("k", [0.721, 0.73, 0.96, 0.99, 1.02])
def test_trials_at_the_critical_state_converge(k, sign, nearness, dry_side):
    mix = law(dry_side=dry_side, tensile_strength=0.0)
    constants, c = cap_plasticity.cap_constants(mix, 1.0), mix.yield_pressure(k) / 2
    trial = c * (1 + sign * nearness), 5e6, k, k
    iterations, p, scale, density_ratio, *_ = cap_plasticity.return_map(constants, *trial, 0.0)
    assert p == pytest.approx(c, rel=2 * nearness + 1e-11)
    assert scale * 5e6 == pytest.approx(1.2 * c, rel=2 * nearness + 1e-12)
    assert density_ratio == pytest.approx(k, rel=nearness + 1e-14)
    assert iterations < 40


@ALL
def test_zero_increment_changes_nothing(mix):
    state = admissible(mix, 500)
    still, _ = cap_plasticity.integrate_points(mix, state, np.zeros((500, 3)))
    assert np.abs(still.stress - state.stress).max() < 1e-14 * np.abs(state.stress).max()
    assert (still.density_ratio == state.density_ratio).all()
    assert (still.plastic_work == state.plastic_work).all()


def test_compression_continues_beyond_full_density():
    mix = law(dry_side="flat")
    state = walked(mix, [(0.02, 0.02, 0)] * 10)
    assert 1 < state.density_ratio[0] < np.exp(0.4) * 0.94
    assert np.isfinite(state.stress).all()


# balances and symmetries


@SIDES
@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("largest", [1e-4, 0.05])
def test_increment_satisfies_its_equations(name, dry_side, largest):
    """Yield limit, normality, density and work from stresses alone; the plastic strain follows from Hooke's law."""
    mix, n = law(dry_side=dry_side, **HARD[name]), 1000
    state, strain = admissible(mix, n), scattered(n, largest, seed=5)
    end, _ = cap_plasticity.integrate_points(mix, state, strain)
    flow = plastic_strain(mix, state, end, strain)
    f, f_p, f_q = yielding(mix, end.stress, end.max_density_ratio)
    volume, shear = -3 * split(flow)[0], np.sqrt(2 / 3 * (split(flow)[1] ** 2) @ SHEAR_TWICE)
    digits = 1e-15 + 1e-10 * (np.abs(strain).max(axis=1) + np.abs(end.stress).max(axis=1) / moduli(mix)[1])
    flows = np.hypot(volume, shear) > digits

    assert f.max() < 1e-12
    if mix.tensile_strength > 1:  # a wall has no one normal
        assert np.abs(f[flows]).max() < 1e-12
        length = np.hypot(f_p, f_q)
        assert (np.abs(volume * f_q - shear * f_p)[flows] < (digits * length)[flows]).all()
        assert (volume * f_p + shear * f_q >= -digits * length).all()
    s = split(end.stress)[1]
    across = np.linalg.norm(von_mises(end.stress)[:, None] * split(flow)[1] - 1.5 * shear[:, None] * s, axis=1)
    assert (across <= digits * von_mises(end.stress) + 1e-30).all()
    assert (np.abs(np.log(end.density_ratio / state.density_ratio) - volume) < digits).all()
    assert (
        end.max_density_ratio == np.maximum(state.max_density_ratio if dry_side == "flat" else 0, end.density_ratio)
    ).all()
    work = (end.stress * flow) @ SHEAR_TWICE
    scale = np.abs(end.stress).max(axis=1) + moduli(mix)[1] * 1e-6
    assert (np.abs(end.plastic_work - state.plastic_work - work) < scale * digits).all()
    assert (end.plastic_work >= state.plastic_work).all()


@ALL
def test_rotation_in_the_plane_rotates_stress_and_tangent(mix):
    n = 300
    state, strain = admissible(mix, n), scattered(n, 0.01, seed=3)
    cos, sin = np.cos(0.7), np.sin(0.7)
    stress_turn = np.array(
        [[cos**2, sin**2, 2 * sin * cos], [sin**2, cos**2, -2 * sin * cos], [-sin * cos, sin * cos, cos**2 - sin**2]]
    )
    strain_turn = np.linalg.inv(stress_turn).T
    turned_stress = state.stress.copy()
    turned_stress[:, [0, 1, 3]] = state.stress[:, [0, 1, 3]] @ stress_turn.T
    end, slopes = cap_plasticity.integrate_points(mix, state, strain)
    turned, turned_slopes = cap_plasticity.integrate_points(
        mix, replace(state, stress=turned_stress), strain @ strain_turn.T
    )
    assert turned.stress[:, [0, 1, 3]] == pytest.approx(end.stress[:, [0, 1, 3]] @ stress_turn.T, rel=1e-9, abs=1e-4)
    assert turned.stress[:, 2] == pytest.approx(end.stress[:, 2], rel=1e-9, abs=1e-4)
    assert turned.density_ratio == pytest.approx(end.density_ratio, rel=1e-12)
    assert turned_slopes == pytest.approx(stress_turn @ slopes @ stress_turn.T, abs=1e-9 * 161e6)


def differences(move, strain, size=1e-7):
    """One-sided forward and backward differences d stress/d strain, shape (n, 3, 3)."""
    middle = move(strain).stress
    ahead, back = np.empty((len(strain), 3, 3)), np.empty((len(strain), 3, 3))
    for j, e in enumerate(size * np.eye(3)):
        ahead[:, :, j] = (move(strain + e).stress - middle)[:, [0, 1, 3]] / size
        back[:, :, j] = (middle - move(strain - e).stress)[:, [0, 1, 3]] / size
    return ahead, back


@SIDES
@pytest.mark.parametrize("largest", [1e-3, 0.05])
@pytest.mark.parametrize(
    "name", ["plain", "no strength", "nearly incompressible", "soft", "weak in shear", "fed dense"]
)
def test_tangent_is_the_derivative(name, dry_side, largest):
    mix, n = law(dry_side=dry_side, **HARD[name]), 500
    K, G = moduli(mix)
    state, strain = admissible(mix, n), scattered(n, largest, seed=7)
    slopes = cap_plasticity.integrate_points(mix, state, strain)[1] / (K + 4 * G / 3)
    size = 20.0 / (K + 4 * G / 3)
    ahead, back = differences(lambda e: cap_plasticity.integrate_points(mix, state, e, tangent=False)[0], strain, size)
    central = (ahead + back) / (2 * (K + 4 * G / 3))
    smooth = np.abs(ahead - back).max(axis=(1, 2)) < 3e-4 * (K + 4 * G / 3)  # no kink within the difference
    assert np.abs(central - slopes)[smooth].max() < 1e-6
    assert smooth.mean() > 0.85


@SIDES
def test_tangent_at_an_isotropic_state_has_its_closed_form(dry_side):
    """Where the stress deviator vanishes, p = pc: B = K H/(K + H), with plastic shear."""
    constants, K = cap_plasticity.cap_constants(law(dry_side=dry_side), 1.0), moduli(MIX)[0]
    *_, slopes = cap_plasticity.return_map(constants, 0.03 * K, 0.0, 0.94, 0.94, 0.0)
    size = 1e-6 * K
    ahead, back = (
        cap_plasticity.return_map(constants, 0.03 * K + sign * size, 0.0, 0.94, 0.94, 0.0)[1] for sign in (1, -1)
    )
    assert 1 - K * slopes[0] == pytest.approx((ahead - back) / (2 * size), rel=1e-7)
    assert np.isfinite(slopes).all()


def test_tangent_is_symmetric_without_hardening():
    """The dilating flat side is perfectly plastic, a projection."""
    mix = law(dry_side="flat")
    strain = scattered(2000, 0.02, seed=11) + np.array([0.01, 0.01, 0])
    end, slopes = cap_plasticity.integrate_points(mix, cap_plasticity.initial_state(mix, 2000), strain)
    loosened = end.density_ratio < 0.94
    assert loosened.sum() > 500
    assert np.abs(slopes - slopes.transpose(0, 2, 1))[loosened].max() < 1e-12 * 161e6


def test_asymmetry_of_the_tangent_is_proportional_to_the_increment():
    def skewness(size):
        state = walked(MIX, [(0, 0.02, 0.004)])
        _, slopes = cap_plasticity.integrate_points(MIX, state, np.array([[0, -size, -size]]))
        return np.abs(slopes - slopes.transpose(0, 2, 1)).max() / 161e6

    sizes = np.array([1e-6, 2e-6, 4e-6])
    skew = [skewness(size) for size in sizes]
    assert skew[-1] > 1e-6
    assert np.polyfit(np.log(sizes), np.log(skew), 1)[0] == pytest.approx(1, abs=0.05)


def test_perfectly_plastic_return_is_contractive():
    """The flat side is a projection in the energy norm: (s1 - s2) C^-1 (s1 - s2) <= (s1 - s2)(e1 - e2)."""
    mix, n = law(dry_side="flat"), 2000
    strains = [scattered(n, 0.01, seed=seed) + np.array([0.002, 0.002, 0]) for seed in (0, 1)]
    ends = [
        cap_plasticity.integrate_points(mix, cap_plasticity.initial_state(mix, n), strain, tangent=False)[0]
        for strain in strains
    ]
    still = np.logical_and(*(end.max_density_ratio == 0.94 for end in ends))
    apart, strain = ends[1].stress - ends[0].stress, strains[1] - strains[0]
    elastic = apart[:, [0, 1, 3]] * strain
    lost = (apart * plastic_strain(mix, ends[0], ends[1], strain)) @ SHEAR_TWICE
    assert still.sum() > 500
    assert (lost[still] >= -1e-9 * np.abs(elastic).max(axis=1)[still]).all()


# iterations


@SIDES
@pytest.mark.parametrize(("largest", "mean", "most"), [(1e-3, 5.5, 9), (0.05, 6.0, 15), (0.5, 8.5, 45)])
def test_iterations_are_few(largest, mean, most, dry_side):
    mix = law(dry_side=dry_side)
    constants, state = cap_plasticity.cap_constants(mix, 1.0), admissible(mix, 3000, largest=largest)
    strain = scattered(3000, largest, seed=21)
    tensor = np.column_stack((strain[:, 0], strain[:, 1], np.zeros(3000), strain[:, 2] / 2))
    trial = state.stress + hooke(mix, tensor)
    p, q = -split(trial)[0], von_mises(trial)
    points = zip(p, q, state.density_ratio, state.max_density_ratio, strict=True)
    iterations = np.array([cap_plasticity.return_map(constants, *point, 0.0)[0] for point in points])
    assert iterations[iterations > 0].mean() < mean
    assert iterations.max() < most


# errors


@pytest.mark.parametrize(
    ("error", "changes", "message"),
    [
        (ValueError, {"strain": (0.0, 0.0, np.nan)}, "`strain` must be finite, got .*nan"),
        (ValueError, {"strain": (0.0, -np.inf, 0.0)}, "`strain` must be finite, got .*inf"),
        (ValueError, {"density_ratio": np.nan}, r"`density_ratio` must be finite, got \[nan\]"),
        (ValueError, {"rate_factor": 0.0}, "`rate_factor` must be positive and finite, got"),
        (ValueError, {"rate_factor": np.nan}, "`rate_factor` must be positive and finite, got"),
        (
            RuntimeError,
            {"strain": (0, 0, 1e200)},
            r"for a strain increment of \S+ from .* use smaller",
        ),
        (RuntimeError, {"strain": (-1e300, 0, 0)}, "the return mapping did not converge"),
        (RuntimeError, {"strain": (-2000, -2000, 0)}, "the return mapping did not converge"),
    ],
)
def test_impossible_increments_are_refused(error, changes, message):
    state = cap_plasticity.initial_state(MIX, 1)
    state.density_ratio[:] = changes.get("density_ratio", 0.94)
    strain = np.array([changes.get("strain", (0.01, 0.01, 0.01))], dtype=float)
    with pytest.raises(error, match=message):
        cap_plasticity.integrate_points(MIX, state, strain, changes.get("rate_factor", 1.0))


def test_batches_of_points_give_the_same_result(monkeypatch):
    """An interrupt is handled between two batches."""
    strain = scattered(50, 1e-3, seed=5)
    whole, slopes = cap_plasticity.integrate_points(MIX, cap_plasticity.initial_state(MIX, 50), strain)
    monkeypatch.setattr(cap_plasticity, "BATCH_POINTS", 7)
    sliced, same = cap_plasticity.integrate_points(MIX, cap_plasticity.initial_state(MIX, 50), strain)
    assert np.array_equal(sliced.stress, whole.stress)
    assert np.array_equal(same, slopes)
    strain[41] = np.nan
    with pytest.raises(ValueError, match="`strain` must be finite, got nan at index"):
        cap_plasticity.integrate_points(MIX, cap_plasticity.initial_state(MIX, 50), strain)
