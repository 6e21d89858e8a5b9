"""Mix near full density: the end of Heckel's curve, the reaction beyond it, return mapping and tangents at the kink."""

from dataclasses import replace

import numpy as np
import pytest
from material_points import yielding
from mixes import MIX, shear_line

from compact.engines.column.column_ode import COLUMN_STATE, STRESS, PathControl
from compact.engines.column.column_pass import PLATE, Column, column_layer
from compact.engines.column.engine import simulate_oedometer
from compact.material import cap_plasticity
from compact.material.cap_plasticity import MaterialPoint, integrate_points

FLAT = replace(MIX, unloading_modulus=300e6, fed_density_ratio=0.9)
LAWS = {
    "flat": FLAT,
    "ellipse": replace(FLAT, dry_side="ellipse"),
    "line": shear_line(0.92, heckel_slope=20e-6, unloading_modulus=400e6),
    "dilatant line": shear_line(0.92, heckel_slope=20e-6, unloading_modulus=400e6, dilatancy_angle=12.0),
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
    scale = mix.yield_pressure(mix.saturation_limit)
    rounding = 4 * np.finfo(float).eps * mix.saturation_modulus / scale  # of k, which determines u
    assert yielding(mix, after.stress, after.max_density_ratio)[0].max() < 1e-12 + rounding
    again, _ = integrate_points(mix, after, np.zeros_like(strain), tangent=False)
    assert np.abs(again.stress - after.stress).max() < 1e-12 * scale
    beyond = np.maximum(after.density_ratio, after.max_density_ratio) > mix.saturation_limit
    assert 0.2 < beyond.mean() < 0.95


@pytest.mark.parametrize("law", LAWS)
def test_tangents_are_those_of_differences(law):
    """Differences of order 4; a third difference shows a kink where yielding begins or the limit is passed."""
    mix = LAWS[law]
    state, strain = adversarial(mix)
    _, tangent = integrate_points(mix, state, strain)
    eps, scale = 5e-8, mix.unloading_modulus
    for j in range(3):
        around = (strain + shift * eps * np.eye(3)[j] for shift in range(-2, 3))
        f = np.array([integrate_points(mix, state, each, tangent=False)[0].stress[:, [0, 1, 3]] for each in around])
        smooth = np.abs(np.diff(f, 3, axis=0)).max(axis=(0, 2)) < 3e-7 * scale * eps
        assert smooth.mean() > 0.99
        slope = (8 * (f[3] - f[1]) - (f[4] - f[0])) / (12 * eps)
        assert np.abs(slope - tangent[:, :, j])[smooth].max() < 5e-8 * scale


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


@pytest.mark.parametrize("law", ["flat", "line"])
def test_oedometer_follows_heckel_up_to_the_limit(law):
    """Confined curves at the modulus of 120 MPa; strain under load would exceed the pores before k_s does."""
    mix = replace(LAWS[law], unloading_modulus=120e6, fed_density_ratio=0.9, heckel_test="confined")
    layer = column_layer((Column(1.0, 0.9),), mix, 1.0, PLATE)
    limit = np.log(0.28 / (1 - mix.saturation_limit)) / mix.heckel_slope
    control = PathControl(-1.0, limit - 1.0, layer.error_scale(layer.max_indentation, 1e-11), 1e-3)
    path, _, _ = layer.integrate(0.0, layer.initial_state, control)
    k = 0.9 * np.exp(path[:, 1 + COLUMN_STATE + 1])
    compared = k > 0.91
    assert path[compared, 1 + STRESS] == pytest.approx(np.log(0.28 / (1 - k[compared])) / mix.heckel_slope, rel=1e-7)
    assert k[-1] == pytest.approx(mix.saturation_limit, abs=1e-7)
