"""A motion cut where it turns, and the places of a stroke at which steps end.

Steps are parts of an element of the mesh, so that the roller meets the nodes the same way again after each element.
After a turn, where forces change over a small part of the contact, they are finer. Before it they are not: where the
roller meets mix anew, one node after the other takes its share of the pressure at once, which fine steps would show.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.numerics.piecewise import graded_grid

TURN_STEP_ENDS = np.cumsum([1 / 16] * 4 + [1 / 8] * 2 + [1 / 4] * 2)  # ends of the steps after a turn, in elements
STEP_LENGTH = 1 / 2  # of an element
NEAR = 1e-9  # of the duration, or of the span: instants and places closer than this are one
PLACE_TOLERANCE = 1e-9  # of an element, or of a stroke: what has not left its place
ROUNDING = 1e-12  # of all travel: a move that has no sign
ZOOM, ZOOMS = 20, 8  # cells, and zooms in on a turn: to 1e-8 of the grid it was found on
HALVINGS = 60  # of the time in which a place is reached


@dataclass(frozen=True, eq=False)
class Strokes:
    """A motion and the `times` and `places` of its beginning, turns and end, shape (strokes + 1,)."""

    motion: object
    times: np.ndarray
    places: np.ndarray

    @property
    def count(self):
        """Of the strokes."""
        return len(self.places) - 1

    @property
    def low(self):
        """The smallest x [m]."""
        return float(self.places.min())

    @property
    def span(self):
        """Between the smallest and the largest x [m]."""
        return float(np.ptp(self.places))

    def steps(self, stroke, element, every=1):
        """Times and places between the steps of a stroke, both ends among them, or of `every` second step."""
        begin, end = self.places[stroke : stroke + 2]
        sign = np.sign(end - begin)
        x = begin + sign * element * _parts(abs(end - begin) / element, every)
        low, high = np.repeat(self.times[stroke : stroke + 2][:, None], len(x) - 1, axis=1)
        # the roller may stand before it leaves
        leaves = _bisected(
            lambda t: sign * (self.motion.position(t) - begin) > PLACE_TOLERANCE * abs(end - begin), low[0], high[0]
        )
        reached = _bisected(lambda t: sign * (self.motion.position(t) - x[1:]) >= 0, low, high)
        return np.append(leaves, reached), x

    def nearest(self, stroke, times, instants):
        """Which times are nearest to those instants that lie in the stroke, a set of indices."""
        begin, end = self.times[stroke : stroke + 2]
        first = stroke == 0  # what ends a stroke begins the next one
        return {int(np.abs(times - t).argmin()) for t in instants if begin < t <= end or (first and t == begin)}


def stroke_schedule(motion):
    """The `Strokes` of a motion, its turns found on a grid that is fine at its joins."""
    joins = [join.time for join in motion.discontinuities()] if hasattr(motion, "discontinuities") else []
    times = graded_grid(np.unique([0.0, *joins, motion.duration]))
    moves = np.diff(motion.position(times))
    ways = np.where(np.abs(moves) > ROUNDING * np.ptp(motion.position(times)), np.sign(moves), 0.0)
    turns = [
        _turn(motion, times[i], times[j + 1], ways[i]) for i, j in pairwise(np.flatnonzero(ways)) if ways[i] != ways[j]
    ]
    times = np.array([0.0, *turns, motion.duration])
    return Strokes(motion, times, motion.position(times))


def smooth_intervals(motion, turns=False):
    """Times between which a motion is smooth, and if asked goes one way; 0 and its duration are among them."""
    joins = {float(join.time) for join in motion.discontinuities()} if hasattr(motion, "discontinuities") else set()
    starts = {float(leg.start) for leg in motion.legs()} if hasattr(motion, "legs") else set()
    breaks, near = [0.0], NEAR * motion.duration
    for time in sorted(joins | starts):
        if breaks[-1] + near < time < motion.duration - near:
            breaks.append(time)
    breaks.append(float(motion.duration))
    return _with_turns(motion, breaks) if turns else breaks


def _with_turns(motion, breaks):
    """The breaks and the times of turns at other places than those of the breaks next to them."""
    way = stroke_schedule(motion)
    for time, place in zip(way.times[1:-1], way.places[1:-1], strict=True):
        k = int(np.searchsorted(breaks, time))
        if np.abs(motion.position(np.array(breaks[max(k - 1, 0) : k + 1])) - place).min() > NEAR * way.span:
            breaks.insert(k, float(time))
    return breaks


def _parts(distance, every):
    """Places between steps in elements from the beginning of a stroke, 0 and the distance among them."""
    places = np.concatenate([TURN_STEP_ENDS, np.arange(1 + STEP_LENGTH, distance, STEP_LENGTH)])
    places = places[places < distance - PLACE_TOLERANCE]
    return np.concatenate([[0.0], places[every - 1 :: every], [distance]])


def _turn(motion, begin, end, way):
    """When the motion has gone farthest between two times."""
    for _ in range(ZOOMS):
        times = np.linspace(begin, end, ZOOM + 1)
        best = int(np.argmax(way * motion.position(times)))
        begin, end = times[max(best - 1, 0)], times[min(best + 1, ZOOM)]
    return times[best]


def _bisected(so, low, high):
    """The first times at which something is so, which is at `high`."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        there = so(middle)
        low, high = np.where(there, low, middle), np.where(there, middle, high)
    return high
