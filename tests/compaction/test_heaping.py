"""Estimate of the largest depth in fresh mix: confined compression, scaling, and remedies that satisfy it."""

import pickle
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mixes import STIFF

from compact.engines.column.engine import required_feed
from compact.engines.compaction.engine import HeapingError, roll
from compact.engines.compaction.heaping import HeapingEstimate, require_no_heaping
from compact.engines.compaction.layer_state import fresh_layer
from compact.engines.compaction.rolling import IncrementalRolling, RollingStep
from compact.engines.compaction.rolling_case import RollingCase
from compact.engines.compaction.steady_search import SteadySearch
from compact.rolling_contact import Layer, Roller

# of the default scene
MIX = replace(STIFF, heckel_slope=14.75e-6, critical_slope=0.99345, tensile_strength=14281.0, dry_side="flat")
WEAK = replace(MIX, critical_slope=0.3)
PRODUCT = HeapingEstimate(0.2294, 0.11, MIX)


class SolutionReached(Exception):  # noqa: N818 - no error of the package
    """The arguments are accepted and the solution begins."""


@pytest.fixture
def no_solution(monkeypatch):
    """End `roll` before any finite elements."""

    def reached(*arguments):
        raise SolutionReached

    monkeypatch.setattr(RollingCase, "create_frame", reached)


def roll_product(depth, height=0.2294, material=MIX, radius=0.11, **options):
    return roll(
        Layer(height),
        Roller(radius, indentation=depth, friction=0.35, rolling="free", profile="deformed"),
        material,
        0.13,
        **options,
    )


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


# (b) scaling


def test_depth_scales_with_lengths_and_load_with_stresses():
    stiff = replace(MIX, heckel_slope=MIX.heckel_slope / 7, tensile_strength=7 * MIX.tensile_strength)
    assert HeapingEstimate(3 * 0.2294, 3 * 0.11, MIX).max_depth == pytest.approx(3 * PRODUCT.max_depth, rel=1e-12)
    assert replace(PRODUCT, material=stiff).max_depth == pytest.approx(PRODUCT.max_depth, rel=1e-9)
    assert replace(PRODUCT, material=stiff).max_load == pytest.approx(7 * PRODUCT.max_load, rel=1e-9)


# (c) refusals before any solution


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, r"`indentation` must be at most about 6.3\d mm, got 9.[67]\d* mm: .* heaps up"),
        ({"exit_density_ratio": 0.98}, r"`exit_density_ratio` 0.98 requires a depth of 9.\d+ mm, .* heaps up"),
    ],
    ids=["depth", "density"],
)
def test_whole_product_of_the_default_scene_is_refused(no_solution, options, message):
    fed = required_feed(0.22, 0.98, MIX, 0.13)
    with pytest.raises(HeapingError, match=message):
        roll_product(fed.indentation, fed.height, **options)


def test_load_beyond_the_bearing_capacity_is_refused(no_solution):
    with pytest.raises(HeapingError, match=r"`load` must be at most about 4\d{4} N/m, .* got 1000000 N/m; reduce"):
        roll(Layer(0.2294), Roller(0.11, load=1e6), MIX, 0.13)


def test_too_large_contact_angle_is_refused(no_solution):
    message = r"requires a depth of 8.1 mm, at which the contact angle exceeds 45 degrees .* stay below 5.86 mm"
    with pytest.raises(HeapingError, match=message):
        roll_product(0.0081, radius=0.02, height=0.3, material=replace(MIX, fed_density_ratio=0.9))


@pytest.mark.parametrize(
    "changes",
    [{"max_contact_angle": None}, {"strain": "small"}, {"layer": Layer(0.2294, base="slip")}],
    ids=["omitted", "small strain", "frictionless base"],
)
def test_estimate_is_omitted_where_it_does_not_apply(no_solution, changes):
    arguments = {
        "layer": Layer(0.2294),
        "roller": Roller(0.11, indentation=0.0097),
        "material": MIX,
        "speed": 0.13,
    } | changes
    with pytest.raises(SolutionReached):
        roll(**arguments)


def test_estimate_is_omitted_on_compacted_mix(no_solution):
    with pytest.raises(SolutionReached):
        roll_product(0.0097, fed_layer=fresh_layer(MIX, np.full(20, 0.2294 / 20)))


# (d) remedies


def refusal(estimate, name, value, depth):
    with pytest.raises(HeapingError) as refused:
        require_no_heaping(estimate, name, value, depth)
    return str(refused.value)


def test_depth_of_the_remedy_is_accepted():
    message = refusal(PRODUCT, "indentation", 0.0097, 0.0097)
    depth = 1e-3 * float(re.search(r"reduce the depth to at most (\S+) mm", message)[1])
    require_no_heaping(PRODUCT, "indentation", depth, depth)
    assert depth > 0.001


def test_density_of_the_remedy_is_accepted():
    message = refusal(PRODUCT, "exit_density_ratio", 0.98, 0.2294 * (1 - 0.94 / 0.98))
    ratio = float(re.search(r"reaches a density ratio of (\S+);", message)[1])
    require_no_heaping(PRODUCT, "exit_density_ratio", ratio, 0.2294 * (1 - 0.94 / ratio))
    assert 0.94 < ratio < 0.98


# (e) growing bow waves


def rolled_with(layer_height, bow_wave, max_wave_height=0.032, depth=0.01):
    """Roll a search whose last step has a bow wave [m]."""
    step = RollingStep(0.05, layer_height - depth, 1e4, 3e3, 0.95, 2e5, 1, 1e-4, bow_wave, 1e-4)
    rolling = IncrementalRolling.__new__(IncrementalRolling)
    rolling.steps, rolling.max_wave_height = (step,), max_wave_height
    rolling.surface, rolling.advance = SimpleNamespace(radius=0.11), lambda height, damping: step
    rolling.frame = SimpleNamespace(contact_length=0.05, step=0.05, mesh=SimpleNamespace(height=layer_height))
    SteadySearch(rolling, None, depth, 2e-3, 1e-3, None)._roll(1.0)


def test_bow_wave_of_the_largest_contact_angle_ends_rolling():
    message = (
        "the mix heaps up in front of the roller at depth 10 mm: after 0.05 m of travel the bow wave exceeds 22 mm, at "
        "which the contact angle is too large; load 10000 N/m, resistance 3000 N/m, bow wave 23 mm"
    )
    with pytest.raises(HeapingError, match=f"^{message}$") as raised:
        rolled_with(0.1, 0.023)
    heaping = raised.value.heaping
    assert (heaping.depth, heaping.wave_height, heaping.travel) == pytest.approx((0.01, 0.023, 0.05))
    assert heaping.contact_angle == pytest.approx(np.arccos(1 - 0.033 / 0.11))
    copy = pickle.loads(pickle.dumps(raised.value))
    assert (str(copy), copy.heaping) == (str(raised.value), heaping)
    rolled_with(0.1, 0.0219)
