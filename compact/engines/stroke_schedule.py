"""Strokes of a motion between its reversals, and the positions at which time steps of a stroke end.

A step is a fraction of an element of the mesh, so that the roller is at the same positions relative to the nodes in
each element. Steps are smaller after a reversal, where forces change over a small part of the contact. Before a
reversal they are not: as the contact reaches one node after the other, its share of the pressure changes by jumps,
which smaller steps would resolve.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.numerics import Array
from compact.numerics.piecewise import graded_grid
from compact.rolling_contact import PrescribedMotion

TURN_STEP_ENDS = np.cumsum([1 / 16] * 4 + [1 / 8] * 2)  # [-], ends of steps after a reversal, in elements
STEP_LENGTH = 1 / 4  # [-], further steps, in elements
PLACE_TOLERANCE = 1e-9  # [-], of an element or a stroke; a smaller displacement is rest
MOVE_ROUNDING = 1e-12  # [-], of the range of positions; a smaller displacement has no sign
SEARCH_CELLS, SEARCH_LEVELS = 20, 8  # [-], cells and levels of the search for a reversal, to 1e-8 of a grid cell
BISECTIONS = 60  # [-], halvings of the time in which a position is reached


@dataclass(frozen=True, eq=False)
class Strokes:
    """Motion divided at its reversals.

    Parameters
    ----------
    times, places : ndarray, shape (strokes + 1,)
        Times [s] and positions [m] of the start, the reversals and the end.
    """

    motion: PrescribedMotion
    times: Array
    places: Array

    @property
    def count(self) -> int:
        """Number of strokes."""
        return len(self.places) - 1

    @property
    def low(self) -> float:
        """Smallest position [m]."""
        return float(self.places.min())

    @property
    def span(self) -> float:
        """Range of the positions [m]."""
        return float(np.ptp(self.places))

    def steps(self, stroke: int, element: float, every: int = 1) -> tuple[Array, Array]:
        """Return times [s] and positions [m] between the steps of a stroke, both ends included, shape (steps + 1,).

        With `every` 2 each second step on elements of a length [m] is left out.
        """
        begin, end = self.places[stroke : stroke + 2]
        sign = np.sign(end - begin)
        distance = abs(end - begin) / element  # in elements
        places = np.concatenate([TURN_STEP_ENDS, np.arange(TURN_STEP_ENDS[-1] + STEP_LENGTH, distance, STEP_LENGTH)])
        places = places[places < distance - PLACE_TOLERANCE][every - 1 :: every]
        x = begin + sign * element * np.concatenate([[0.0], places, [distance]])
        low, high = np.repeat(self.times[stroke : stroke + 2][:, None], len(x) - 1, axis=1)
        # the roller may be at rest before it starts
        start = _first_time(
            lambda t: sign * (self.motion.position(t) - begin) > PLACE_TOLERANCE * abs(end - begin), low[0], high[0]
        )
        reached = _first_time(lambda t: sign * (self.motion.position(t) - x[1:]) >= 0, low, high)
        return np.append(start, reached), x

    def nearest(self, stroke: int, times: Array, instants: Iterable[float]) -> set[int]:
        """Return the indices of the times [s] nearest to the instants [s] within a stroke."""
        begin, end = self.times[stroke : stroke + 2]
        first = stroke == 0  # the end of a stroke belongs to it, not to the next one
        return {int(np.abs(times - t).argmin()) for t in instants if begin < t <= end or (first and t == begin)}


def stroke_schedule(motion: PrescribedMotion) -> Strokes:
    """Divide a motion at its reversals, located on a grid refined at its discontinuities."""
    jumps = motion.discontinuities() if hasattr(motion, "discontinuities") else []
    times = graded_grid(np.unique([0.0, *(float(jump.time) for jump in jumps), motion.duration]))
    moves = np.diff(motion.position(times))
    smallest = MOVE_ROUNDING * np.ptp(motion.position(times))
    directions = np.where(np.abs(moves) > smallest, np.sign(moves), 0.0)
    reversals = [
        _reversal(motion, times[i], times[j + 1], directions[i])
        for i, j in pairwise(np.flatnonzero(directions))
        if directions[i] != directions[j]
    ]
    times = np.array([0.0, *reversals, motion.duration])
    return Strokes(motion, times, motion.position(times))


def _reversal(motion: PrescribedMotion, begin: float, end: float, direction: float) -> float:
    """Return the time between two times at which the motion is farthest in a direction."""
    for _ in range(SEARCH_LEVELS):
        times = np.linspace(begin, end, SEARCH_CELLS + 1)
        best = int(np.argmax(direction * motion.position(times)))
        begin, end = times[max(best - 1, 0)], times[min(best + 1, SEARCH_CELLS)]
    return times[best]


def _first_time(condition: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return the first times at which a condition is true, by bisection; it is true at `high`."""
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        true = condition(middle)
        low, high = np.where(true, low, middle), np.where(true, middle, high)
    return high
