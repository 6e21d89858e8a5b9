"""Steady search: drift and jumps of the bow wave, one answer whatever the start, and the error estimate."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from mixes import LIFT, LIFT_MIX, free_roller

from compact.engines.compaction.engine import roll
from compact.engines.compaction.rolling import RollingStep
from compact.engines.compaction.rolling_case import STEADY_TOLERANCE
from compact.engines.compaction.steady_state import QUANTITIES, WaveDrift

PUBLISHED = LIFT, free_roller(), LIFT_MIX
# load and resistance of the published lift on the mesh, N/m, after 96 contact lengths from bow waves 10 % below and
# above the steady one, on 7 elements per contact length
BELOW, ABOVE = (9190.8, 1909.7), (9194.0, 1911.7)


def step(travel, wave_area, **values):
    fields = dict.fromkeys(RollingStep.__dataclass_fields__, 0.0)
    return RollingStep(**fields | {"travel": travel, "wave_area": wave_area} | values)


def decay(start, length=0.24, limit=1e-4, count=12):
    """Steps of a wave that relaxes exponentially; the load follows its area."""
    travel = start + 0.001 * np.arange(count)
    areas = limit * (1 - np.exp(-travel / length))
    return [step(s, area, load=5e3 + 2e7 * area) for s, area in zip(travel, areas, strict=True)]


def test_drift_is_the_slope_of_wave_and_load():
    drift = WaveDrift.of_steps(decay(0.1))
    assert drift.wave_slope == pytest.approx(1e-4 / 0.24 * np.exp(-0.1055 / 0.24), rel=1e-3)
    assert drift.slopes[QUANTITIES.index("load")] == pytest.approx(2e7 * drift.wave_slope, rel=1e-9)
    assert drift.wave_error < 1e-2 * drift.wave_slope


def test_rolled_state_is_steady(coarse):
    """The next step repeats the last one, part by part: forces within 0.2 %, displacements within 2 %.

    Marks of the start far behind the roller are left out, behind 1.2 contact lengths.
    """
    solution = coarse.solution
    frame = solution.frame
    again = copy(solution)
    step = again.advance(solution.steps[-1].bottom_height, 0.0)
    last = solution.steps[-1]
    assert (step.load, step.resistance) == pytest.approx((last.load, last.resistance), rel=2e-3)
    near = frame.nodes[:, 0] > -1.2 * frame.contact_length
    for part, before in zip(again.parts, solution.parts, strict=True):
        change = part.displacement_change - before.displacement_change
        assert np.linalg.norm(change[near]) < 0.02 * np.linalg.norm(before.displacement_change[near])


def test_two_percent_deeper_and_back_gives_the_first_solution(coarse, layer, roller, mix):
    deeper = roll(layer, replace(roller, indentation=0.00204), mix, 0.2, start=coarse)
    back = roll(layer, roller, mix, 0.2, start=deeper)
    assert back.load == pytest.approx(coarse.load, rel=3e-3)
    assert back.resistance == pytest.approx(coarse.resistance, rel=3e-3)


@pytest.mark.slow
def test_published_lift_is_that_of_two_starts():
    rolled = roll(*PUBLISHED, 0.13, increments=7)
    found = np.array([rolled.load / rolled.load_factor, rolled.resistance])  # on the mesh
    told = np.add(rolled.error_parts.drift, rolled.error_parts.start)
    assert np.all(np.abs(found / np.mean([BELOW, ABOVE], axis=0) - 1) < STEADY_TOLERANCE + told)
    assert np.all(told < 2e-3)
    assert rolled.error[0] < 0.03
    assert rolled.overdense_work == pytest.approx(0.4, abs=0.1)


@pytest.mark.slow
def test_answer_does_not_depend_on_the_path():
    """Deeper by 3 % and back, and up and down in friction; deeper by 15 % at once is no neighbour any more."""
    layer, roller, mix = PUBLISHED
    first = roll(*PUBLISHED, 0.13)

    def changed(start, **changes):
        return roll(layer, replace(roller, **changes), mix, 0.13, start=start)

    for path in ([{"indentation": 0.00308}, {}], [{"friction": 0.45}, {}]):
        found = first
        for changes in path:
            found = changed(found, **changes)
        assert (found.load, found.resistance) == pytest.approx((first.load, first.resistance), rel=3e-3)
    deeper = replace(roller, indentation=0.00345)
    scratch = roll(layer, deeper, mix, 0.13)
    neighbour = roll(layer, deeper, mix, 0.13, start=first)
    assert (neighbour.load, neighbour.resistance) == pytest.approx((scratch.load, scratch.resistance), rel=3e-3)
