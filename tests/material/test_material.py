"""Material laws: closed forms of the hardening curve, and invalid parameters."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import STIFF

from compact.material import cap_plasticity
from compact.material.elliptic_cap import reaction
from compact.material.laws import HECKEL_MIN_PRESSURE, SATURATION_LIMIT

MIX = replace(STIFF, dry_side="flat")
LOOSEST = 1 - 0.28 * np.exp(-HECKEL_MIN_PRESSURE)  # where pc leaves the curve near k0


# closed form


@pytest.mark.parametrize("k", [LOOSEST, 0.75, 0.94, 0.98, SATURATION_LIMIT])
def test_yield_pressure_follows_heckels_curve(k):
    assert MIX.yield_pressure(k) == pytest.approx(np.log(0.28 / (1 - k)) / 13e-6, rel=1e-13)


def test_curve_is_heckels_up_to_the_saturation_limit_and_constant_beyond():
    k = np.array([0.995, 0.9979, 0.998, 1.0, 1.07])
    expected = np.log(0.28 / (1 - np.minimum(k, 0.998))) / 13e-6
    assert MIX.yield_pressure(k) == pytest.approx(expected, rel=1e-14)
    assert MIX.saturation_pressure(k) == pytest.approx([0, 0, 0, *(0.8e9 * np.log(k[3:] / 0.998))], rel=1e-13)


def test_loose_mix_has_half_of_the_minimum_pressure():
    assert MIX.yield_pressure(np.array([0.5, 1e-9])) == pytest.approx(HECKEL_MIN_PRESSURE / 2 / 13e-6, rel=1e-12)


@pytest.mark.parametrize(
    "mix", [MIX, *(replace(MIX, heckel_test="confined", unloading_modulus=E) for E in (3e6, 60e6))]
)
def test_compiled_hardening_equals_that_of_the_law(mix):
    k = np.concatenate((np.linspace(0.01, 1.5, 600), [LOOSEST, SATURATION_LIMIT]))
    constants = cap_plasticity.cap_constants(mix, 1.0)
    u = [reaction(constants, value)[0] for value in k]
    assert u == pytest.approx(mix.saturation_pressure(k), rel=1e-13)
    pc, modulus = np.array([cap_plasticity.hardening(constants, value) for value in k]).T
    assert pc == pytest.approx(mix.yield_pressure(k), rel=1e-13)
    h = 1e-6
    smooth = np.minimum(abs(k - LOOSEST), abs(k - SATURATION_LIMIT)) > 2 * h  # not across a joint
    central = (mix.yield_pressure(k * np.exp(h)) - mix.yield_pressure(k * np.exp(-h))) / (2 * h)
    assert modulus[smooth] == pytest.approx(central[smooth], rel=1e-6, abs=1e-3)


# errors

POSITIVE = ("unloading_modulus", "heckel_slope", "loose_density_ratio", "critical_slope", "reference_rate")
RULES = {
    "must be positive and finite, got": [(name, value) for name in POSITIVE for value in (0.0, -1.0, np.nan, np.inf)],
    "must be zero or positive, and finite, got -1": [("tensile_strength", -1.0), ("rate_sensitivity", -1.0)],
    r"must lie in \[0, 0.5\), got": [("poisson", value) for value in (-0.1, 0.5, np.nan)],
    "must be above 0.72 and below 0.998, got": [("fed_density_ratio", value) for value in (0.72, 0.5, 0.998, np.nan)],
}


@pytest.mark.parametrize(("rule", "name", "value"), [(rule, *each) for rule, cases in RULES.items() for each in cases])
def test_parameters_out_of_range_are_refused(rule, name, value):
    with pytest.raises(ValueError, match=f"`{name}` {rule}"):
        replace(MIX, **{name: value})
