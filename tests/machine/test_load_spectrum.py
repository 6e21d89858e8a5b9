"""Rainflow counting against the examples of ASTM E1049-85, and bearing lives by hand."""

import math

import numpy as np
import pytest
import rainflow
from hypothesis import given
from hypothesis import strategies as st

from compact.machine.component_sizing import Bearing, LoadCycle, bearing_life, count_cycles

HISTORY = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0]  # of the figures 6 and 7
BALL, ROLLER = Bearing(20e3, "ball", 1), Bearing(20e3, "roller", 1)


def test_library_counts_the_example_of_the_standard():
    """Figure 6: half cycles of 3, 6 and 9, one and a half of 4, one of 8."""
    counted = rainflow.count_cycles(HISTORY)
    assert counted == [(3.0, 0.5), (4.0, 1.5), (6.0, 0.5), (8.0, 1.0), (9.0, 0.5)]


def test_repeating_history_has_the_closed_cycles_of_the_standard():
    """Figure 7, the same history repeated: one cycle each of 9, 7, 4 and 3."""
    found = count_cycles(HISTORY)
    assert [(each.range, each.count) for each in found] == [(9.0, 1.0), (7.0, 1.0), (4.0, 1.0), (3.0, 1.0)]
    assert found[0] == LoadCycle(9.0, 0.5, 1.0)


@given(st.lists(st.integers(-9, 9), min_size=2, max_size=30))
def test_cycles_hold_the_whole_variation_of_the_history(history):
    """Twice the sum of all ranges is the variation over one repetition, all cycles are whole."""
    load = np.array(history, float)
    found = count_cycles(load)
    assert 2 * sum(each.range * each.count for each in found) == pytest.approx(np.abs(np.diff([*load, load[0]])).sum())
    assert all(each.count == int(each.count) for each in found)
    assert (found[0].range if found else 0.0) == np.ptp(load)


def test_constant_load_has_no_cycles_and_bearings_without_load_or_travel_last():
    assert count_cycles(np.zeros(3)) == count_cycles(7.0 + 1e-12 * np.array([0.0, 1.0, 0.0, 1.0])) == []
    life = bearing_life(Bearing(20e3, "ball", count=2), np.full(3, -6e3), np.zeros(3), radius=0.1, period=2.0)
    assert (life.equivalent_load, life.million_revolutions, life.hours, life.valid) == (3e3, math.inf, math.inf, True)
    assert math.isinf(bearing_life(BALL, np.zeros(2), np.ones(2), 0.1, 1.0).hours)
    assert not bearing_life(BALL, np.full(1, 11e3), np.ones(1), 0.1, 1.0).valid


@pytest.mark.parametrize("noise", [0.0, 1e-9, -1e-9])
def test_cycles_that_differ_by_rounding_are_one_and_equal_ranges_are_in_order_of_the_mean(noise):
    """Of the run, whose tolerance is 1e-8: 15e-8 is on the edge between two rounded ranges."""
    twins = [0.0, 9.0, 1.0, 3.0 + 15e-8 + noise, 1.0, 3.0 + 15e-8, 1.0, 9.0, 5.0, 7.0 + 15e-8 - noise, 5.0, 9.0]
    found = [(round(each.range, 6), round(each.mean, 6), each.count) for each in count_cycles(twins)]
    assert found == [(9.0, 4.5, 1.0), (8.0, 5.0, 1.0), (4.0, 7.0, 1.0), (2.0, 6.0, 1.0), (2.0, 2.0, 2.0)]


def test_life_by_hand():
    """(20/2)^3 = 1000 and (20/2)^(10/3) = 2154 million revolutions; 0.8 m in 2 s on a wheel of 0.1 m."""
    load, travelled = np.full(4, 2000.0), np.full(4, 0.2)
    ball, roller = (bearing_life(each, load, travelled, 0.1, 2.0) for each in (BALL, ROLLER))
    assert ball.equivalent_load == pytest.approx(2000.0)
    assert ball.million_revolutions == pytest.approx(1000.0)
    assert roller.million_revolutions == pytest.approx(2154.43, abs=0.01)
    assert ball.hours == pytest.approx(1e9 * 2 * math.pi * 0.1 / 0.4 / 3600)
    assert ball.valid


def test_equivalent_load_is_the_mean_of_the_damage():
    """Half the travel at 1, half at 3 kN, p = 3: (28/2)^(1/3) kN; loads at rest do not count."""
    found = bearing_life(BALL, np.array([1e3, -3e3, 9e3]), np.array([0.4, 0.4, 0.0]), 0.1, 2.0)
    assert found.equivalent_load == pytest.approx(1e3 * 14 ** (1 / 3))
