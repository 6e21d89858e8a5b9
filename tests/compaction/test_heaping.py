"""Estimate of the largest depth in fresh mix: confined compression, scaling, and remedies that satisfy it."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import STIFF

from compact.engines.column.engine import required_feed
from compact.engines.compaction.engine import HeapingError, roll
from compact.engines.compaction.heaping import HeapingEstimate, bearing_factor
from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
from compact.rolling_contact import Layer, Roller

# of the default scene
MIX = replace(STIFF, heckel_slope=14.75e-6, critical_slope=0.99345, tensile_strength=14281.0, dry_side="flat")
WEAK = replace(MIX, critical_slope=0.3)
PRODUCT = HeapingEstimate(0.2294, 0.11, MIX)


# (a) closed forms


def test_contact_of_three_heights_compresses_the_layer_as_an_oedometer():
    """The whole height has the bearing pressure: k = 1 - (1 - k0) exp{-K_H [(p + pt)/A - pt]}."""
    estimate = HeapingEstimate(0.1, 0.3 / 1.07 / np.sin(np.pi / 4), WEAK)
    vertical = (1 + np.sqrt(1 + 4 * 0.3**2 / 9)) / 2
    k = 1 - 0.28 * np.exp(-14.75e-6 * ((estimate.bearing_pressure + 14281.0) / vertical - 14281.0))
    assert estimate.contact_length == pytest.approx(0.3)
    assert estimate.max_depth == pytest.approx(0.1 * (1 - 0.94 / k), rel=1e-5)


def test_bearing_pressure_on_a_deep_layer_is_prandtls():
    pc = np.log(0.28 / 0.06) / 14.75e-6
    shear_strength = 0.99345 * (pc + 14281) / 2 / np.sqrt(3)
    pressure = HeapingEstimate(1e6, 0.11, MIX).bearing_pressure
    assert pressure == pytest.approx(1.3 * (2 + np.pi) * shear_strength, rel=1e-6)


@pytest.mark.parametrize(
    ("friction", "factor"), [(0.0, 2 + np.pi), (0.35, 2.833), (1 / (1 + np.pi / 2), 1 + np.pi / 2), (0.5, 2)]
)
def test_bearing_factor_of_a_sliding_roller_is_greens(friction, factor):
    assert bearing_factor(friction) == pytest.approx(factor, rel=2e-4)
    assert bearing_factor(friction) == pytest.approx(bearing_factor(friction * (1 + 1e-9)), rel=1e-4)


def test_friction_of_a_sliding_roller_alone_reduces_the_depth():
    layer, free = Layer(0.06), Roller(0.11, indentation=0.003, friction=0.3, rolling="free", profile="deformed")
    sliding = replace(free, rolling="sliding")
    cases = [RollingCase(layer, each, MIX, 0.13, None, None, RollingNumerics()).heaping for each in (free, sliding)]
    assert cases[0].bearing_pressure / cases[1].bearing_pressure == pytest.approx((2 + np.pi) / bearing_factor(0.3))
    assert cases[1].max_depth < cases[0].max_depth


# (b) scaling


def test_depth_scales_with_lengths_and_load_with_stresses():
    stiff = replace(MIX, heckel_slope=MIX.heckel_slope / 7, tensile_strength=7 * MIX.tensile_strength)
    assert HeapingEstimate(3 * 0.2294, 3 * 0.11, MIX).max_depth == pytest.approx(3 * PRODUCT.max_depth, rel=1e-12)
    assert replace(PRODUCT, material=stiff).max_depth == pytest.approx(PRODUCT.max_depth, rel=1e-9)
    assert replace(PRODUCT, material=stiff).max_load == pytest.approx(7 * PRODUCT.max_load, rel=1e-9)


# (c) refusals before any solution


FED = required_feed(0.22, 0.98, MIX, 0.13)
LOOSER = replace(MIX, fed_density_ratio=0.9)


@pytest.mark.parametrize(
    ("layer", "roller", "mix", "options", "message"),
    [
        (FED.height, {"indentation": FED.indentation}, MIX, {}, r"`indentation` requires .* about 6.3\d mm: .* heaps"),
        (FED.height, {"indentation": 0.001}, MIX, {"exit_density_ratio": 0.98}, r"`exit_density_ratio` 0.98 requires"),
        (0.2294, {"load": 1e6}, MIX, {}, r"`load` must be at most about 4\d{4} N/m, .* got 1000000 N/m; reduce"),
        (0.3, {"radius": 0.02, "indentation": 0.0081}, LOOSER, {}, r"angle exceeds 45 degrees .* stay below 5.86 mm"),
    ],
    ids=["depth", "density", "load", "angle"],
)
def test_case_that_heaps_up_is_refused(layer, roller, mix, options, message):
    with pytest.raises(HeapingError, match=message):
        roll(Layer(layer), Roller(**{"radius": 0.11} | roller), mix, 0.13, **options)


# (e) growing bow waves
