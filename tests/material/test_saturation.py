"""Mix near full density: the end of Heckel's curve, the reaction beyond it, return mapping and tangents at the kink."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import MIX, shear_line

from compact.engines.column.engine import simulate_oedometer
from compact.material import cap_plasticity
from compact.material.cap_plasticity import MaterialPoint, integrate_points

FLAT = replace(MIX, unloading_modulus=300e6, fed_density_ratio=0.9)
LAWS = {
    "flat": FLAT,
    "ellipse": replace(FLAT, dry_side="ellipse"),
    "line": shear_line(0.92, heckel_slope=20e-6, unloading_modulus=400e6),
}


def adversarial(mix, n=6000):
    """Random points about the limit, inside or on the yield surface, and strain increments that reach it."""
    draw = np.random.default_rng(5)
    k = mix.saturation_limit + draw.uniform(-4e-4, 3e-4, n)
    densest = np.maximum(k, mix.saturation_limit + draw.uniform(-4e-4, 3e-4, n)) if mix.dry_side == "flat" else k
    stress = -draw.uniform(0, 5e5, n)[:, None] * [1, 1, 1, 0] + 2e5 * draw.normal(size=(n, 4))
    state = MaterialPoint(stress, k, densest, np.zeros(n))
    state, _ = integrate_points(mix, state, np.zeros((n, 3)), tangent=False)
    return state, 2e-3 * draw.normal(size=(n, 3)) * draw.uniform(0, 1, n)[:, None]


@pytest.mark.parametrize("law", LAWS)
def test_return_mapping_ends_on_the_yield_surface(law):
    mix = LAWS[law]
    state, strain = adversarial(mix)
    after, _ = integrate_points(mix, state, strain, tangent=False)
    again, _ = integrate_points(mix, after, np.zeros_like(strain), tangent=False)
    scale = mix.yield_pressure(mix.saturation_limit)
    assert np.abs(again.stress - after.stress).max() < 1e-12 * scale
    beyond = np.maximum(after.density_ratio, after.max_density_ratio) > mix.saturation_limit
    assert 0.2 < beyond.mean() < 0.95


@pytest.mark.parametrize("law", LAWS)
def test_tangents_are_those_of_differences(law):
    """Points where a second difference shows a kink, where yielding begins or the limit is passed, are left out."""
    mix = LAWS[law]
    state, strain = adversarial(mix)
    middle, tangent = integrate_points(mix, state, strain)
    eps, scale = 2e-9, mix.unloading_modulus
    for j in range(3):
        high, low = (
            integrate_points(mix, state, strain + sign * eps * np.eye(3)[j], tangent=False)[0].stress[:, [0, 1, 3]]
            for sign in (1, -1)
        )
        smooth = np.abs(high + low - 2 * middle.stress[:, [0, 1, 3]]).max(axis=1) < 1e-7 * scale * eps * 1e2
        assert smooth.mean() > 0.95
        error = np.abs((high - low) / (2 * eps) - tangent[:, :, j])[smooth]
        assert error.max() < 1e-5 * scale


def test_reaction_begins_at_the_limit():
    k = FLAT.saturation_limit * np.exp([-1e-4, 0.0, 1e-4])
    assert FLAT.saturation_pressure(k) == pytest.approx([0, 0, 0.8e5], abs=1e-4)
    assert np.ptp(FLAT.yield_pressure(k[1:])) == 0
    assert FLAT.yield_pressure(0.998) == pytest.approx(np.log(0.28 / 0.002) / 13e-6)


@pytest.mark.parametrize("law", LAWS)
def test_column_passes_the_limit_as_the_return_mapping_does(law):
    mix = LAWS[law]
    test = simulate_oedometer(mix, [1e5, 3e5, 4e5, 5e5, 0.0])
    state, strain = cap_plasticity.initial_state(mix, 1), 0.0
    for stress, target, k in zip(test.pressure, -np.log1p(-test.strain), test.density_ratio, strict=True):
        steps = max(int(abs(target - strain) / 4e-6), 1)
        for _ in range(steps):
            part = np.array([[0.0, (strain - target) / steps, 0.0]])
            state, _ = integrate_points(mix, state, part, tangent=False)
        strain = target
        assert state.density_ratio[0] == pytest.approx(k, abs=1e-6)
        assert -state.stress[0, 1] == pytest.approx(stress, abs=1e-3 * 5e5)
    assert mix.saturation_limit < test.density_ratio[-2] < mix.saturation_limit + 1e-3
