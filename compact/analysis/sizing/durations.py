"""First laws, peak force and peak power over the duration of a pass, with the crossovers between laws.

    compact run scene.toml --over duration=0.3:3:8

Inertia grows with the inverse square of the duration, the resistance of the mix hardly depends on it. Short passes
therefore prefer laws of small acceleration, long ones laws of constant speed. The contacts are those of the scene: the
height of the rollers is that at its own duration, and the resistance map covers the speeds of the shortest pass. All
laws keep their shape, optimal ones too, which are optimal at the duration of the scene alone.

A crossover is the duration at which two laws require the same peak. It is found between neighbouring durations with
different first laws. A law that is first only between two of them is found only if it is first at a crossover.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from compact import drive
from compact.analysis.stages.drives import Stages, simulate_laws
from compact.machine.drives import DRIVES
from compact.machine.ranking import ROUNDING_TIE, Ranked, value_of
from compact.scene.loader import Scene

PEAKS = ("peak_force", "peak_power")  # criteria of the durations
KEYS = ("duration", "motion.duration")  # keys of the option
MAX_DURATIONS = 200  # [-], of one run; a figure shows no more
DURATION_TOLERANCE = 1e-6  # [-], relative; of a crossover
DEPTH = 8  # [-], of further first laws between two durations; there are as many families of laws


class Crossover(NamedTuple):
    """Duration at which the first law changes.

    Parameters
    ----------
    by : str
        Criterion of PEAKS.
    duration : float
        Duration of a pass [s].
    shorter, longer : str
        First law for shorter and for longer passes.
    value : float
        Peak of both laws there [N] or [W].
    """

    by: str
    duration: float
    shorter: str
    longer: str
    value: float


class DurationStudy(NamedTuple):
    """Ranking over the duration.

    Parameters
    ----------
    durations : tuple of float
        Durations of a pass [s], ascending.
    orders : dict
        Laws in order at each duration, by criterion of PEAKS.
    crossovers : tuple of Crossover
        In order of criterion and duration.
    """

    durations: tuple[float, ...]
    orders: dict[str, tuple[list[Ranked], ...]]
    crossovers: tuple[Crossover, ...]

    def segments(self, by: str) -> list[tuple[str, float, float]]:
        """Return the first laws by a criterion, each with the durations between which it is first [s]."""
        found = [each for each in self.crossovers if each.by == by]
        ends = [self.durations[0], *(each.duration for each in found), self.durations[-1]]
        first = _first(self.orders[by][0])
        laws = [first, *(each.longer for each in found)] if first else []
        return [(law, *span) for law, span in zip(laws, pairwise(ends), strict=False)]

    def values(self, by: str) -> dict[str, np.ndarray]:
        """Return the peak of each law over the durations [N] or [W]; infinite for an impulsive force."""
        laws = [each.run.name for each in self.orders[by][0]]
        found = [{each.run.name: each.value for each in order} for order in self.orders[by]]
        return {law: np.array([values[law] for values in found]) for law in laws}


def read_durations(text: str) -> tuple[float, ...]:
    """Parse the option --over, "duration=LOW:HIGH:N", into durations in equal ratios [s].

    Parameters
    ----------
    text : str
        Option, such as "duration=0.3:3:8" [s].

    Returns
    -------
    tuple of float
        Durations of a pass [s], ascending.

    Raises
    ------
    ValueError
        If the text has another form, or the numbers are out of range.

    Examples
    --------
    >>> read_durations("duration=0.5:2:3")
    (0.5, 1.0, 2.0)
    """
    key, _, values = (part.strip() for part in text.partition("="))
    if key not in KEYS:
        raise ValueError(f"--over takes duration=LOW:HIGH:N, such as duration=0.3:3:8 in s, got {text!r}")
    try:
        low, high, count = (read(part) for read, part in zip((float, float, int), values.split(":"), strict=True))
    except ValueError:
        raise ValueError(
            f"--over duration takes LOW:HIGH:N, two numbers in s and a whole one, got {values!r}"
        ) from None
    if not 0 < low < high < math.inf:
        raise ValueError(f"--over duration runs from LOW > 0 up to a larger HIGH in s, got {low:g}:{high:g}")
    if not 2 <= count <= MAX_DURATIONS:
        raise ValueError(f"--over duration takes 2 to {MAX_DURATIONS} values, got {count}")
    return tuple(np.geomspace(low, high, count).round(12).tolist())


def require_durations(scene: Scene, durations: Sequence[float]) -> None:
    """Validate durations of a pass [s] like `motion.duration`.

    Raises
    ------
    SceneError
        If a duration is implausible.
    ValueError
        If the drive determines the duration itself.
    """
    if durations and DRIVES[scene.drive.kind].sets_duration:
        words = f'drive.kind = "{scene.drive.kind}" determines the duration of a pass itself'
        raise ValueError(f"{words}; give --over another drive, such as --set drive.kind=rigid, or vary its gear ratio")
    for duration in durations:
        scene.replaced(**{"motion.duration": duration})


def over_durations(stages: Stages, durations: Sequence[float]) -> DurationStudy:
    """Rank the laws of a scene at several durations and find the crossovers.

    Parameters
    ----------
    stages : Stages
        Stages whose resistance map covers the shortest duration.
    durations : sequence of float
        Durations of a pass [s], ascending.
    """
    runs = [_runs(stages, duration) for duration in durations]
    for _ in durations:
        stages.drive.count("durations")
    orders = {by: tuple(drive.rank(each.values(), by) for each in runs) for by in PEAKS}
    crossovers: list[Crossover] = []
    for by in PEAKS:
        firsts: list[str] = []  # of each duration: that of the one before if it shares the first rank
        for order in orders[by]:
            shared = [each.run.name for each in order if each.rank == 1 and not each.reason]
            firsts.append(firsts[-1] if firsts and firsts[-1] in shared else _first(order))
        for laws, ends in zip(pairwise(firsts), pairwise(durations), strict=True):
            if all(laws):
                crossovers += _between(stages, by, laws, ends)
    return DurationStudy(tuple(durations), orders, tuple(crossovers))


def _runs(stages: Stages, duration: float, laws: Collection[str] = ()) -> dict[str, Any]:
    """Simulate laws, all by default, over a duration of a pass [s] under the drive of the scene."""
    over = stages.drive.over(duration)
    cycles = {law: cycle for law, cycle in over.cycles.items() if law in (laws or over.cycles)}
    return dict(simulate_laws(over.scene, over.resistance.cart, cycles, over.resistance.resistance))


def _first(order: list[Ranked]) -> str:
    """Name of the first law; empty if all forces are infinite."""
    return "" if order[0].reason else order[0].run.name


def _between(
    stages: Stages, by: str, laws: tuple[str, str], ends: tuple[float, float], depth: int = DEPTH
) -> Iterator[Crossover]:
    """Yield the crossovers between two durations with their first laws, ascending."""
    shorter, longer = laws
    if shorter == longer:
        return

    def difference(logarithm: float) -> float:
        runs = _runs(stages, math.exp(logarithm), laws)
        ratio = value_of(runs[shorter], by) / value_of(runs[longer], by)
        return 0.0 if abs(ratio - 1) <= ROUNDING_TIE else float(np.clip(ratio - 1, -1, 1))

    duration = math.exp(brentq(difference, *np.log(ends), xtol=DURATION_TOLERANCE))
    runs = _runs(stages, duration)
    first, value = _first(drive.rank(runs.values(), by)), value_of(runs[shorter], by)
    if first not in laws and depth and value_of(runs[first], by) < value * (1 - DURATION_TOLERANCE):
        yield from _between(stages, by, (shorter, first), (ends[0], duration), depth - 1)
        yield from _between(stages, by, (first, longer), (duration, ends[1]), depth - 1)
    else:
        yield Crossover(by, duration, shorter, longer, value)
