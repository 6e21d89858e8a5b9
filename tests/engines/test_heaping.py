"""The estimate of the depth that loose mix takes up: confined compression, scaling, remedies that pass it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from compact.engines.column.engine import required_feed
from compact.engines.compaction import engine as compaction
from compact.engines.compaction.engine import HeapingError, roll
from compact.engines.compaction.heaping import Heaping, require_no_heaping
from compact.engines.compaction.roller_frame import fresh
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller

MIX = Compaction(120e6, 0.3, 14.75e-6, 0.72, 0.99345, 14281.0, 0.94)  # of a new scene
WEAK = replace(MIX, critical_slope=0.3)
PRODUCT = Heaping(0.2294, 0.11, MIX)


def pressed(depth, height=0.2294, material=MIX, radius=0.11, **asked):
    return roll(Layer(height), Roller(radius, depth, 0.35, "free", "deformed"), material, 0.13, **asked)


@pytest.fixture
def solving(monkeypatch):
    """Nothing is solved: what passes the door ends with a KeyError."""

    def reached(*given):
        raise KeyError("solving")

    monkeypatch.setattr(compaction, "_march", reached)


# (a) closed forms


def test_contact_three_heights_long_presses_the_layer_as_an_oedometer():
    """All of the height bears the pressure: k = 1 - (1 - k0) exp(-K_H p/A)."""
    heaping = Heaping(0.1, 0.3 / 1.07 / np.sin(np.pi / 4), WEAK)
    turned = (1 + np.sqrt(1 + 4 * 0.3**2 / 9)) / 2
    k = 1 - 0.28 * np.exp(-14.75e-6 * heaping.pressure / turned)
    assert heaping.length == pytest.approx(0.3)
    assert heaping.depth == pytest.approx(0.1 * (1 - 0.94 / k), rel=1e-5)


def test_pressure_over_a_deep_layer_is_prandtls_with_the_shear_strength_of_the_loose_mix():
    pc = np.log(0.28 / 0.06) / 14.75e-6
    shear_strength = 0.99345 * (pc + 14281) / 2 / np.sqrt(3)
    assert Heaping(1e6, 0.11, MIX).pressure == pytest.approx(1.3 * (2 + np.pi) * shear_strength, rel=1e-6)


# (b) scaling


def test_depth_goes_with_the_lengths_and_not_with_the_stresses():
    stiff = replace(MIX, heckel_slope=MIX.heckel_slope / 7, tensile_strength=7 * MIX.tensile_strength)
    assert Heaping(3 * 0.2294, 3 * 0.11, MIX).depth == pytest.approx(3 * PRODUCT.depth, rel=1e-12)
    assert replace(PRODUCT, material=stiff).depth == pytest.approx(PRODUCT.depth, rel=1e-9)
    assert replace(PRODUCT, material=stiff).load == pytest.approx(7 * PRODUCT.load, rel=1e-9)


# (c) refusals before anything is solved


def test_whole_product_of_a_new_scene_is_refused_before_a_mesh_is_made(solving):
    fed = required_feed(0.22, 0.98, MIX, 0.13)
    with pytest.raises(
        HeapingError, match=r"`indentation` must be at most about 6.4\d mm, got 9.[67]\d* mm: .* heaps up"
    ):
        pressed(fed.indentation, fed.height)
    with pytest.raises(HeapingError, match=r"`exit_density_ratio` 0.98 requires 9.\d+ mm of depth, .* heaps up"):
        pressed(fed.indentation, fed.height, exit_density_ratio=0.98)


def test_load_beyond_the_bearing_capacity_is_refused_before_a_mesh_is_made(solving):
    with pytest.raises(HeapingError, match=r"`load` must be at most about 4\d{4} N/m, .* got 1000000 N/m"):
        roll(Layer(0.2294), Roller(0.11, load=1e6), MIX, 0.13)


def test_roller_that_meets_the_surface_too_steeply_is_refused_before_a_mesh_is_made(solving):
    with pytest.raises(HeapingError, match=r"requires a depth of 8.1 mm, at which .* 45 degrees .* below 5.86 mm"):
        pressed(0.0081, radius=0.02, height=0.3, material=replace(MIX, fed_density_ratio=0.9))


@pytest.mark.parametrize(
    "asked", [{"steepest": None}, {"strain": "small"}, {"layer": Layer(0.2294, "slip")}], ids=["told", "small", "slip"]
)
def test_estimate_is_left_out_where_it_is_told_or_does_not_apply(asked, solving):
    given = {"layer": Layer(0.2294), "roller": Roller(0.11, 0.0097), "material": MIX, "speed": 0.13} | asked
    with pytest.raises(KeyError, match="solving"):
        roll(**given)


def test_mix_that_was_pressed_before_is_not_held_to_the_estimate(solving):
    fed = fresh(MIX, np.full(20, 0.2294 / 20))
    with pytest.raises(KeyError, match="solving"):
        pressed(0.0097, fed=fed)


@pytest.mark.parametrize("steepest", [0.0, 2.0, np.nan])
def test_angles_out_of_range_are_refused(steepest):
    with pytest.raises(ValueError, match="`steepest` must be"):
        pressed(0.001, steepest=steepest)


# (d) remedies


def told(heaping, name, value, depth):
    with pytest.raises(HeapingError) as refused:
        require_no_heaping(heaping, name, value, depth)
    return str(refused.value)


@pytest.mark.parametrize("name", ["indentation", "exit_density_ratio"])
def test_lifts_of_the_told_height_pass(name):
    message = told(PRODUCT, name, 0.98, 0.0097)
    lift = float(re.search(r"lifts of at most (\S+) m", message)[1])
    share = lift / (0.2294 - 0.0097)
    require_no_heaping(replace(PRODUCT, height=share * 0.2294), name, 0.98, share * 0.0097)
    assert 0.05 < lift < 0.15


def test_depth_that_is_told_passes():
    depth = 1e-3 * float(re.search(r"press at most (\S+) mm", told(PRODUCT, "indentation", 0.0097, 0.0097))[1])
    require_no_heaping(PRODUCT, "indentation", depth, depth)
    assert depth > 0.001


def test_denser_feed_that_is_told_passes():
    product = 0.94 * 0.2294
    message = told(PRODUCT, "exit_density_ratio", 0.98, 0.2294 - product / 0.98)
    ratio = float(re.search(r"density ratio of (\S+) or denser", message)[1])
    denser = Heaping(product / ratio, 0.11, replace(MIX, fed_density_ratio=ratio))
    require_no_heaping(denser, "exit_density_ratio", 0.98, product / ratio - product / 0.98)
    assert 0.95 < ratio < 0.98


# (e) marches whose wave grows


def march_of(waves, highest=0.032, depth=0.01, window=8):
    """A march that has stayed at its depth with waves [m]."""
    steps = tuple(
        SimpleNamespace(travel=0.01 * (n + 1), lowest=0.2 - depth, load=1e4, resistance=3e3, wave=wave)
        for n, wave in enumerate(waves)
    )
    mesh = SimpleNamespace(height=0.2)
    return SimpleNamespace(steps=steps, highest=highest, window=window, frame=SimpleNamespace(mesh=mesh))


def test_wave_as_high_as_the_roller_is_steep_stops_the_march():
    message = (
        "the mix heaps up in front of the roller at depth 10 mm: after 0.05 m of travel the bow wave has grown to the "
        "22 mm at which the contact is too steep to press the mix down; load 10000 N/m, resistance 3000 N/m, bow wave "
        "23 mm high"
    )
    with pytest.raises(HeapingError, match=f"^{message}$"):
        compaction._refuse_high_wave(march_of(np.linspace(0, 0.023, 5)), 0)


def test_wave_that_grows_evenly_stops_the_march_half_way():
    with pytest.raises(HeapingError, match=r"the bow wave tends to [\d.]+ mm, beyond the 22 mm"):
        compaction._refuse_high_wave(march_of(np.linspace(0, 0.0115, 40)), 0)


def test_wave_that_comes_to_rest_below_does_not_stop_the_march():
    waves = 0.02 * (1 - 0.9 ** np.arange(60))
    for count in range(1, 61):
        compaction._refuse_high_wave(march_of(waves[:count]), 0)
    assert waves[-1] > 0.019
