"""Rate of compaction in the yield pressure: its definition, the engine "column" and consistency with the depth."""

from dataclasses import replace

import numpy as np
import pytest
from column_cases import DEPTH, FED, FED_HEIGHT, HEIGHT, MIX, SPEED, R, circle

from compact.analysis.multipass import Pass, passes
from compact.engines.column.engine import required_feed, roll
from compact.rolling_contact import Layer, Roller, compaction_rate

RATED = replace(MIX, rate_sensitivity=0.03)


def at_factor(factor):
    """Rate-independent mix with a yield pressure that is larger by a factor."""
    return replace(MIX, heckel_slope=MIX.heckel_slope / factor)


def forces(contact):
    return contact.load, contact.resistance, contact.peak_pressure, contact.exit_density_ratio


# definition


def test_rate_is_speed_times_strain_over_contact_length():
    rate = compaction_rate(-SPEED, R, FED_HEIGHT, DEPTH)
    assert rate == pytest.approx(SPEED * np.log(0.98 / FED) / np.sqrt(2 * R * DEPTH), rel=1e-12)
    assert compaction_rate(0.0, R, HEIGHT, DEPTH) == compaction_rate(SPEED, R, HEIGHT, 0.0) == 0


# engine "column"


def test_rate_scales_the_yield_pressure():
    factor = RATED.rate_factor(compaction_rate(SPEED, R, FED_HEIGHT, DEPTH))
    rated, stronger = (roll(Layer(FED_HEIGHT), circle(), material, SPEED) for material in (RATED, at_factor(factor)))
    assert 1.1 < factor < 1.2
    assert forces(rated) == pytest.approx(forces(stronger), rel=1e-13)


def test_force_at_rest_is_finite_and_that_of_the_heckel_slope():
    still, slow = (roll(Layer(FED_HEIGHT), circle(), material, 1e-12) for material in (MIX, RATED))
    assert forces(slow) == pytest.approx(forces(still), rel=1e-9)


@pytest.mark.parametrize(
    "target", [{"load": 12e3}, {"peak_pressure": 250e3}, {"indentation": 1.3 * DEPTH}, {"exit_density_ratio": 0.97}]
)
def test_rate_belongs_to_the_depth_that_is_found(target):
    density = {name: value for name, value in target.items() if name == "exit_density_ratio"}
    roller = circle() if density else Roller(R, profile="circle", **target)
    found = roll(Layer(FED_HEIGHT), roller, RATED, SPEED, **density)
    factor = RATED.rate_factor(compaction_rate(SPEED, R, FED_HEIGHT, found.indentation))
    again = roll(Layer(FED_HEIGHT), circle(found.indentation), at_factor(factor), SPEED)
    assert forces(found) == pytest.approx(forces(again), rel=2e-8)
    (name, value) = next(iter(target.items()))
    assert getattr(found, name) == pytest.approx(value, rel=1e-8)


def test_feed_of_a_product_has_the_rate_of_its_own_depth():
    fed = required_feed(HEIGHT, 0.98, RATED, SPEED, radius=R)
    contact = roll(Layer(fed.height), circle(fed.indentation), RATED, SPEED)
    assert contact.exit_density_ratio == pytest.approx(0.98, abs=1e-9)
    assert contact.exit_height == pytest.approx(HEIGHT, rel=1e-8)


def test_second_pass_at_the_same_height_stays_elastic():
    """Mix that was compacted before counts as fed, so that the second pass has the rate of the first."""
    stages = (Pass(height=HEIGHT), Pass(height=HEIGHT), Pass(height=0.99 * HEIGHT))
    first, second, third = passes(Layer(FED_HEIGHT), circle(), RATED, SPEED, stages)
    assert abs(second.resistance) < 1e-9 * second.load
    at_once = roll(Layer(FED_HEIGHT), circle(FED_HEIGHT - 0.99 * HEIGHT), RATED, SPEED)
    assert third.peak_pressure == pytest.approx(at_once.peak_pressure, rel=1e-8)
    assert first.peak_pressure < third.peak_pressure
