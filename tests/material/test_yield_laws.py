"""One battery over all yield laws: consistency, flow, work, tangent, objectivity, convergence, refusals."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from material_points import SHEAR_TWICE, admissible, dissipated, plastic_strain, scattered, split, von_mises, yielding
from mixes import STIFF, shear_line

from compact.material import cap_plasticity
from compact.material.laws import DruckerPragerCap

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
    "fed dense": {"fed_density_ratio": 0.9979},
}
CAPS = {
    f"{side}, {name}": replace(STIFF, dry_side=side, **changes)
    for side in ("ellipse", "flat")
    for name, changes in HARD.items()
}
LINES = {"line": shear_line(), "dilatant line": shear_line(dilatancy_angle=12.0)}
LAWS = CAPS | LINES
PLAIN = [LAWS[name] for name in ("ellipse, plain", "flat, plain", *LINES)]


def over(laws):
    return pytest.mark.parametrize("mix", laws.values(), ids=laws)


@pytest.mark.sampled(36)
@over(LAWS)
@pytest.mark.parametrize("largest", [1e-9, 1e-3, 0.05, 2.0])
def test_every_increment_converges_to_an_admissible_state(mix, largest):
    """Increments include pure shear, pure volume and zero; the states result from such increments."""
    n, state = 2000, cap_plasticity.initial_state(mix, 2000)
    for i in range(6):
        strain = scattered(n, largest, seed=i)
        strain[: n // 8, :2] = 0
        strain[n // 8 : n // 4, 1], strain[n // 8 : n // 4, 2] = strain[n // 8 : n // 4, 0], 0
        strain[n // 4 : n // 3] *= (-1) ** i
        strain[n // 3 : n // 2 : 2] = 0
        before, (state, slopes) = state, cap_plasticity.integrate_points(mix, state, strain)
        assert yielding(mix, state.stress, state.max_density_ratio)[0].max() < 1e-12
        assert np.isfinite(slopes).all()
        assert (state.density_ratio > 0).all()
        assert (state.max_density_ratio >= state.density_ratio).all()
        if largest == 0.05 and mix in PLAIN:
            assert (dissipated(mix, before, state) >= 0).all()


@over(CAPS)
@pytest.mark.parametrize("largest", [1e-4, 0.05])
def test_increment_satisfies_its_equations(mix, largest):
    """Yield limit, normality, density and work from stresses alone; the plastic strain follows from Hooke's law.

    Those of the shear line are Koiter's conditions, in `test_drucker_prager_cap`.
    """
    state, strain, G = admissible(mix, 1000), scattered(1000, largest, seed=5), mix.shear_modulus
    end, _ = cap_plasticity.integrate_points(mix, state, strain)
    flow = plastic_strain(mix, state, end, strain)
    f, f_p, f_q = yielding(mix, end.stress, end.max_density_ratio)
    volume, shear = -3 * split(flow)[0], np.sqrt(2 / 3 * (split(flow)[1] ** 2) @ SHEAR_TWICE)
    digits = 1e-15 + 1e-10 * (np.abs(strain).max(axis=1) + np.abs(end.stress).max(axis=1) / G)
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
    remembered = state.max_density_ratio if mix.dry_side == "flat" else 0
    assert (end.max_density_ratio == np.maximum(remembered, end.density_ratio)).all()
    work = (end.stress * flow) @ SHEAR_TWICE
    assert (
        np.abs(end.plastic_work - state.plastic_work - work) < (np.abs(end.stress).max(axis=1) + G * 1e-6) * digits
    ).all()
    assert (dissipated(mix, state, end) >= 0).all()


@pytest.mark.parametrize("mix", PLAIN)
def test_rotation_in_the_plane_rotates_stress_and_tangent(mix):
    n = 300
    state, strain = admissible(mix, n), scattered(n, 0.01, seed=3)
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array(
        [[cos**2, sin**2, 2 * sin * cos], [sin**2, cos**2, -2 * sin * cos], [-sin * cos, sin * cos, cos**2 - sin**2]]
    )
    plane, stress = [0, 1, 3], state.stress.copy()
    stress[:, plane] = state.stress[:, plane] @ turn.T
    end, slopes = cap_plasticity.integrate_points(mix, state, strain)
    turned, turned_slopes = cap_plasticity.integrate_points(
        mix, replace(state, stress=stress), strain @ np.linalg.inv(turn)
    )
    assert turned.stress[:, plane] == pytest.approx(end.stress[:, plane] @ turn.T, rel=1e-9, abs=1e-4)
    assert turned.stress[:, 2] == pytest.approx(end.stress[:, 2], rel=1e-9, abs=1e-4)
    assert turned.density_ratio == pytest.approx(end.density_ratio, rel=1e-12)
    assert turned_slopes == pytest.approx(turn @ slopes @ turn.T, abs=1e-9 * 161e6)


VISCOUS = shear_line(shear_viscosity=4000.0), shear_line(dilatancy_angle=12.0, shear_viscosity=4000.0)


@pytest.mark.parametrize(
    ("mix", "carried"),
    [
        *((LAWS[f"{side}, {name}"], False) for side in ("ellipse", "flat")
          for name in ("plain", "no strength", "nearly incompressible", "soft", "weak in shear", "fed dense")),
        *((mix, carried) for mix in (*LINES.values(), *VISCOUS) for carried in (False, True)),
    ],
)  # fmt: skip
def test_tangent_is_the_derivative(mix, carried):
    """Central differences of one step from random states, on every part of the surface and inside."""
    constants, random = cap_plasticity.cap_constants(mix, 1.0, travel=1e-3), np.random.default_rng(5)
    line = True if isinstance(mix, DruckerPragerCap) else None
    state, unit, smooth, kinds = admissible(mix, 400), constants.K + 4 * constants.G / 3, 0, set()
    size = 20.0 / unit if line is None else 3e-8
    for stress, *ratios in zip(state.stress, state.density_ratio, state.max_density_ratio, strict=True):
        before, strain = (*stress, *ratios), random.normal(size=3) * 10 ** random.uniform(-4, -1.7)
        limit = -stress[:3].mean() * random.uniform(0.5, 1.5) if carried else np.nan

        def step(e, before=before, limit=limit):
            derivatives = np.zeros((6, 3))
            good, after, *_ = cap_plasticity.integrate_point(
                constants, line, before, tuple(e), 0.0, 1.0, limit, derivatives
            )
            assert good
            return np.array(after[:4]), derivatives

        middle, slopes = step(strain)
        ahead, back = (np.array([step(strain + way * e)[0] for e in size * np.eye(3)]).T for way in (1, -1))
        if np.abs(ahead + back - 2 * middle[:, None]).max() < 3e-4 * size * unit:  # no kink within the difference
            assert np.abs((ahead - back) / (2 * size) - slopes[:4]).max() < 1e-6 * unit
            smooth += 1
            kinds.add(bool(abs(slopes[0, 0] / unit - 1) < 1e-9))  # elastic
    assert smooth > 300
    assert False in kinds


@pytest.mark.parametrize("mix", PLAIN[:2])
def test_tangent_at_an_isotropic_state_has_its_closed_form(mix):
    """Where the stress deviator vanishes, p = pc: B = K H/(K + H), with plastic shear."""
    constants, K = cap_plasticity.cap_constants(mix, 1.0), mix.bulk_modulus
    *_, slopes = cap_plasticity.return_map(constants, 0.03 * K, 0.0, 0.94, 0.94, 0.0)
    size = 1e-6 * K
    ahead, back = (
        cap_plasticity.return_map(constants, 0.03 * K + sign * size, 0.0, 0.94, 0.94, 0.0)[1] for sign in (1, -1)
    )
    assert 1 - K * slopes[0] == pytest.approx((ahead - back) / (2 * size), rel=1e-7)
    assert np.isfinite(slopes).all()


def test_perfectly_plastic_return_is_a_projection():
    """The dilating flat side: a symmetric tangent, and (s1 - s2) C^-1 (s1 - s2) <= (s1 - s2)(e1 - e2)."""
    mix, n = LAWS["flat, plain"], 2000
    strains = [scattered(n, 0.01, seed=seed) + np.array([0.002, 0.002, 0]) for seed in (0, 1)]
    ends, slopes = zip(
        *(cap_plasticity.integrate_points(mix, cap_plasticity.initial_state(mix, n), strain) for strain in strains),
        strict=True,
    )
    loosened = ends[0].density_ratio < 0.94
    assert loosened.sum() > 500
    assert np.abs(slopes[0] - slopes[0].transpose(0, 2, 1))[loosened].max() < 1e-12 * 161e6
    still = np.logical_and(*(end.max_density_ratio == 0.94 for end in ends))
    apart, strain = ends[1].stress - ends[0].stress, strains[1] - strains[0]
    elastic = apart[:, [0, 1, 3]] * strain
    lost = (apart * plastic_strain(mix, ends[0], ends[1], strain)) @ SHEAR_TWICE
    assert still.sum() > 500
    assert (lost[still] >= -1e-9 * np.abs(elastic).max(axis=1)[still]).all()


@pytest.mark.parametrize("side", ["ellipse", "flat"])
def test_trials_at_the_critical_state_converge(side):
    mix = LAWS[f"{side}, no strength"]
    constants = cap_plasticity.cap_constants(mix, 1.0)
    near, densities = (0.0, 1e-17, -1e-17, 1e-14, -1e-14, 1e-11, -1e-11, 1e-6, -1e-6), (0.721, 0.73, 0.96, 0.99, 1.02)
    for nearness, k in itertools.product(near, densities):
        a = mix.yield_pressure(k) / 2
        c = a + mix.saturation_pressure(k)
        iterations, p, scale, density_ratio, *_ = cap_plasticity.return_map(
            constants, c * (1 + nearness), 5e6, k, k, 0.0
        )
        assert p == pytest.approx(c, rel=2 * abs(nearness) + 1e-11)
        assert scale * 5e6 == pytest.approx(1.2 * a, rel=2 * abs(nearness) + 1e-12)
        assert density_ratio == pytest.approx(k, rel=abs(nearness) + 1e-14)
        assert iterations < 40


@pytest.mark.parametrize(
    ("error", "changes", "message"),
    [
        (ValueError, {"strain": (0.0, 0.0, np.nan)}, "`strain` must be finite, got .*nan"),
        (ValueError, {"density_ratio": np.nan}, r"`density_ratio` must be finite, got \[nan\]"),
        (ValueError, {"rate_factor": 0.0}, "`rate_factor` must be positive and finite, got"),
        (RuntimeError, {"strain": (0, 0, 1e200)}, r"for a strain increment of \S+ from .* use smaller"),
        (RuntimeError, {"strain": (-1e4, -1e4, 0)}, "the return mapping did not converge"),
    ],
)
def test_impossible_increments_are_refused(error, changes, message):
    state = cap_plasticity.initial_state(STIFF, 1)
    state.density_ratio[:] = changes.get("density_ratio", 0.94)
    strain = np.array([changes.get("strain", (0.01, 0.01, 0.01))], dtype=float)
    with pytest.raises(error, match=message):
        cap_plasticity.integrate_points(STIFF, state, strain, changes.get("rate_factor", 1.0))


@pytest.mark.parametrize("mix", PLAIN)
def test_zero_increment_changes_nothing(mix):
    state = admissible(mix, 500)
    still, _ = cap_plasticity.integrate_points(mix, state, np.zeros((500, 3)))
    assert np.abs(still.stress - state.stress).max() < 1e-14 * np.abs(state.stress).max()
    assert (still.density_ratio == state.density_ratio).all()
    assert (still.plastic_work == state.plastic_work).all()
