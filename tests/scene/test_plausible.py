"""Plausible ranges: a value in other units is advised against or refused, and the user may insist."""

import pytest

from compact.material import mix
from compact.scene import plausible_ranges
from compact.scene.loader import load_scene
from compact.scene.schema import Overrides


def test_every_key_of_the_mix_is_checked_against_the_spread_of_the_prior():
    for name in Overrides.model_fields:
        found = plausible_ranges.range_of(f"mix.overrides.{name}")
        for moisture, ratio in ((0.08, 0.90), (0.10, 0.98), (0.12, 0.99), (0.093, 0.957)):
            known = mix.prior(moisture, ratio).parameter(name)
            assert found.low < known.low or known.low == 0
            assert known.low <= known.high < found.high


@pytest.mark.parametrize(("times", "advised", "refused"), [(0.99, 0, 0), (1.01, 1, 0), (9.9, 1, 0), (10.1, 0, 1)])
@pytest.mark.parametrize("key", ["mix.overrides.heckel_slope", "machine.roller_length", "drive.stiffness"])
@pytest.mark.parametrize("side", ["low", "high"])
def test_outside_is_advice_and_ten_times_outside_is_refused(times, advised, refused, key, side):
    found = plausible_ranges.range_of(key)
    value = found.high * times if side == "high" else found.low / times
    assert bool(found.advice(key, value)) == bool(advised)
    assert bool(found.refusal(key, value)) == bool(refused)
    assert bool(found.refusal(key, -value)) == bool(refused)


def test_a_key_named_unusual_is_neither_refused_nor_advised_against():
    scene = load_scene("small", **{"unusual": ["mix.overrides.heckel_slope"], "mix.overrides.heckel_slope": 13.0})
    assert scene.mix.overrides.heckel_slope == 13.0
    assert scene.advice == ()
    assert scene.replaced(**{"mix.overrides.heckel_slope": 2e-4}).advice == ()
