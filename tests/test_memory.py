"""Resistance that remembers: columns against tables, the fit to one transient, other motions, a drive that uses it."""

import numpy as np
import pytest
from published import CART_OF_C

from compact import fem, spectral
from compact.drive import Rigid, simulate
from compact.material import Elastic, Viscoelastic
from compact.memory import Columns, fitted, instants
from compact.motion import law
from compact.records import Layer, Roller
from compact.resistance import sampled

LAYER, ROLLER = Layer(0.22), Roller(0.11, indentation=0.006)
MIX = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
UNIT = Columns(1.0, 1.0, ((1.0, 1.0),))


class Turn:
    """s = v t - a t^2/2, from a speed to the same one back."""

    def __init__(self, speed, deceleration, duration=None):
        self.speed, self.deceleration = speed, deceleration
        self.duration = duration or 2 * speed / deceleration

    def position(self, time):
        return self.speed * time - self.deceleration * time**2 / 2

    def velocity(self, time):
        return self.speed - self.deceleration * time


@pytest.fixture(scope="module")
def steady():
    return sampled(lambda speed: (spectral.roll(LAYER, ROLLER, MIX, speed).resistance, None), 0.003, 0.6, 1e-3)


@pytest.fixture(scope="module")
def memory(steady):
    return fitted(fem.travel(LAYER, ROLLER, MIX, Turn(0.3, 0.6), estimate=False), steady, ROLLER, MIX)


# published numbers: contact.md e, m = 1


@pytest.mark.parametrize(
    ("speed", "resistance"),
    [(0.03, 0.01868985), (0.1, 0.05309453), (0.3, 0.10107269), (0.5, 0.11235094), (1, 0.10445711), (3, 0.06130111)],
)
def test_columns_in_steady_motion_are_the_winkler_foundation(speed, resistance):
    assert UNIT.steady(speed) == pytest.approx(resistance, rel=6e-4)


def test_columns_turn_as_the_winkler_foundation():
    table = {0.4: 0.10038, 0.8: 0.08993, 1.0: 0.07897, 1.4: 0.03180, 1.6: -0.00483, 2.0: -0.07607, 2.4: -0.10787}
    table |= {3.0: -0.08986, 4.0: -0.06638}
    turn = Turn(1.0, 1.0, 4.0)
    time = instants(turn.position, turn.duration, UNIT)
    found = UNIT.resistance(time, turn.position(time), speed=1.0)
    assert np.interp(list(table), time, found) == pytest.approx(list(table.values()), abs=2e-3 * 0.10446)


def test_columns_scale_as_the_fourth_power_of_their_half_length():
    wide = Columns(0.5, 3.0, ((0.5, 0.2), (1.0, 2.0)))
    assert wide.steady(0.6) == pytest.approx(Columns(1.0, 1.0, wide.branches).steady(0.2) * 3.0**4 / 0.5**2, rel=1e-9)


# the fit


@pytest.mark.slow
def test_fit_to_a_thin_slipping_layer_finds_its_columns():
    mix, roller = Viscoelastic(0.91, 0.3, branches=((1.0, 1.0),)), Roller(100.0, indentation=0.005)
    thin = Layer(0.1, "slip")
    steady = sampled(lambda speed: (spectral.roll(thin, roller, mix, speed).resistance, None), 0.02, 1.0, 1e-3)
    found = fitted(fem.travel(thin, roller, mix, Turn(1.0, 1.0), estimate=False), steady, roller, mix)
    assert found.columns.half_length == pytest.approx(1.0, rel=0.03)
    assert found.stiffness == pytest.approx(0.91 / 0.91 / 0.1, rel=0.1)  # E*/H
    assert found.error < 0.01


@pytest.mark.parametrize(
    ("motion", "close"),
    [
        pytest.param(law("quintic", 0.4, 3.0), 0.025, marks=pytest.mark.slow),
        (law("parabolic", 0.2, 1.0), 0.09),
    ],
    ids=["another law", "four times as sudden"],
)
def test_other_motions_are_met_where_the_map_fails(motion, close, steady, memory):
    exact = fem.travel(LAYER, ROLLER, MIX, motion.cycle(), estimate=False)
    peak = np.abs(exact.resistance).max()
    course = motion.cycle()
    time = instants(course.position, course.duration, memory.columns)
    force = memory.over(time, course.position(time), course.velocity(time))
    assert np.interp(exact.time, time, force) == pytest.approx(exact.resistance, abs=close * peak)
    assert np.abs(steady(exact.velocity) - exact.resistance).max() > 6 * close * peak


def test_error_told_is_what_is_missed_of_the_transient(steady, memory):
    turn = Turn(0.3, 0.6)
    exact = fem.travel(LAYER, ROLLER, MIX, turn, estimate=False)
    found = memory.along(turn).of_time(exact.time)
    missed = np.abs(found - exact.resistance).max() / np.abs(exact.resistance).max()
    assert missed == pytest.approx(memory.error, rel=0.05)
    assert missed < 0.06


# properties


def test_steady_motion_is_the_map(steady, memory):
    time = np.linspace(0, 0.5, 2001)
    assert memory.over(time, -0.2 * time, np.full(2001, -0.2)) == pytest.approx(steady(-0.2), rel=5e-3)
    assert memory(0.2) == steady(0.2)


def test_cycle_has_the_memory_of_those_before(memory):
    cycle = law("parabolic", 0.2, 1.0).cycle(far_dwell=0.1)
    remembered = memory.along(cycle)
    assert remembered.of_time(0.0) == pytest.approx(remembered.of_time(cycle.period))
    time = np.concatenate([remembered.time[:-1] + turn * cycle.period for turn in range(4)])
    many = memory.over(time, cycle.position(time), cycle.velocity(time))
    largest = np.abs(many).max()
    assert many[-len(remembered.time) + 1 :] == pytest.approx(remembered.force[:-1], abs=1e-3 * largest)


# a drive


def test_drive_meets_what_is_remembered(memory):
    cycle = law("quintic", 0.4, 3.0).cycle()
    run = simulate(CART_OF_C, Rigid(), cycle, memory)
    assert run.state.resistance == pytest.approx(memory.along(cycle).of_time(run.time))
    back = np.argmax(run.direction < 0)
    assert run.state.resistance[back] > 0.1 * run.state.resistance.max()  # still of the way there


# refusals


def test_what_cannot_be_fitted_is_refused(steady):
    with pytest.raises(ValueError, match="`material` must be Viscoelastic to remember, got Elastic"):
        fitted(None, steady, ROLLER, Elastic(1e7, 0.3))
    with pytest.raises(ValueError, match="a `roller` is fitted at an `indentation`, got `load`"):
        fitted(None, steady, Roller(0.11, load=1e4), MIX)
    with pytest.raises(ValueError, match="`half_length` must be positive"):
        Columns(1.0, 0.0, ((1.0, 1.0),))
