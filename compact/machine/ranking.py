"""Ranking of motion laws by a requirement on their drive, with the margin to the next law."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from types import MappingProxyType
from typing import Any

from compact import quantities
from compact.numerics.validation import require_known
from compact.quantities import Quantity

ROUNDING_TIE = 1e-9  # [-], of the scale of a criterion; closer values are equal but for rounding
BUILD_TOLERANCE = 0.01  # [-]; scatter of machines built to one drawing, from bearings, fits and motors


@dataclass(frozen=True)
class Criterion:
    """Quantity by which laws are ranked.

    Parameters
    ----------
    infinite_because : str
        Reason of an infinite value.
    floor : float
        Smallest scale of differences between values, in the unit; 0 if the value itself is the scale.
    cancelling : str
        Criterion that measures the terms whose sum the value is, or empty; smaller values than `ROUNDING_TIE` of that
        measure are rounding.
    """

    quantity: Quantity
    infinite_because: str = ""
    floor: float = 0.0
    cancelling: str = ""

    @property
    def unit(self) -> str:
        """SI unit of its values."""
        return self.quantity.unit

    def scale(self, value: float) -> float:
        """Scale of differences from a value, in the unit."""
        return max(abs(value), self.floor)


_IMPULSE = "the velocity jumps: impulsive force"
_INFINITE = {
    **dict.fromkeys(("peak_force", "rms_force", "mean_force", "dynamic_factor", "peak_power", "rms_power"), _IMPULSE),
    "peak_jerk": "the acceleration jumps",
    "dynamic_amplification": "the velocity jumps: a drive that imposes it has no finite peak force",
    "squared_acceleration": "the velocity of the law jumps",
    "squared_jerk": "velocity or acceleration of the law jumps",
    "squared_snap": "velocity, acceleration or jerk of the law jumps",
}
_FLOORS = {"nonuniformity": 1.0}  # of the mean speed
_CANCELLING = {"mean_power": "rms_power", "energy": "drawn_energy"}
CRITERIA = MappingProxyType(
    {
        name: Criterion(quantity, _INFINITE.get(name, ""), _FLOORS.get(name, 0.0), _CANCELLING.get(name, ""))
        for name, quantity in quantities.CRITERIA.items()
    }
)


@dataclass(frozen=True)
class Ranked:
    """Rank of a run.

    Parameters
    ----------
    rank : int
        From 1; equal values share a rank, infinite values share the last one.
    value : float
        Value of the criterion.
    margin : float
        Difference to the next larger value over `Criterion.scale` [-].
    reason : str
        Reason of an infinite value, or empty.
    """

    rank: int
    run: Any
    value: float
    margin: float
    reason: str

    @property
    def tie(self) -> bool:
        """True for a next larger value within the build tolerance."""
        return is_tie(self.margin)


def is_tie(margin: float) -> bool:
    """Return true for a margin below the build tolerance; nan, without a next value, is no tie."""
    return margin < BUILD_TOLERANCE


def value_of(run: Any, by: str) -> float:
    """Value of a criterion for a run, 0 within rounding."""
    value, criterion = getattr(run, by), CRITERIA[by]
    terms = getattr(run, criterion.cancelling) if criterion.cancelling else 0.0
    rounding = ROUNDING_TIE * max(criterion.floor, terms if math.isfinite(terms) else 0.0)
    return 0.0 if abs(value) <= rounding else value


def rank(runs: Iterable[Any], by: str = "peak_force") -> list[Ranked]:
    """Rank runs by a criterion, smallest value first.

    Parameters
    ----------
    runs : iterable of Run, ElasticRun, MotorRun or HydraulicRun
    by : str
        Criterion of `CRITERIA`.

    Returns
    -------
    list of Ranked
        Values that are equal but for rounding share a rank, in the given order. Infinite values are last, followed by
        nan; all of them share the last rank. The margin of the last finite value is infinite before infinite values,
        nan without them.
    """
    require_known("criterion", by, tuple(CRITERIA))
    runs = list(runs)
    if strange := [run for run in runs if not hasattr(run, by)]:
        raise ValueError(f"`runs` must be runs of a drive, got {strange[0]!r}; `compact.simulate` returns one")
    criterion = CRITERIA[by]
    values = [value_of(run, by) for run in runs]
    groups = group_equal(values, criterion.floor)
    ranked: list[Ranked] = []
    for group, behind in zip_longest(groups, groups[1:], fillvalue=()):
        first, larger = len(ranked) + 1, min((values[i] for i in behind), default=math.nan)
        for i in group:
            finite, scale = math.isfinite(values[i]), criterion.scale(values[i])
            margin = (larger - values[i]) / scale if finite and scale else math.nan
            reason = "" if finite else _reason_of_infinity(runs[i], by)
            ranked.append(Ranked(first if finite else len(runs), runs[i], values[i], margin, reason))
    return ranked


def _reason_of_infinity(run, by):
    """Reason of an infinite value of a criterion."""
    if by == "dynamic_factor" and math.isfinite(run.peak_force):
        return "zero force at the mean speed"
    return CRITERIA[by].infinite_because


def group_equal(values: Sequence[float], floor: float = 0.0, rounding: float = ROUNDING_TIE) -> list[list[int]]:
    """Group values that are equal but for rounding; every order of laws is taken from these groups.

    Parameters
    ----------
    values : sequence of float
        Values of one unit, infinite and nan ones allowed.
    floor : float
        Smallest scale of differences between values, in their unit.
    rounding : float
        Difference of equal values over the larger of value and floor [-].

    Returns
    -------
    list of list of int
        Positions of the values, smallest first; those of equal values in the given order. Nan is last.

    Examples
    --------
    >>> group_equal([3.0, 2.0 * (1 + 1e-15), 2.0])
    [[1, 2], [0]]
    """
    found: list[list[int]] = []
    least = math.nan  # smallest value of the present group
    for i in sorted(range(len(values)), key=lambda i: (math.isnan(values[i]), values[i])):
        value = values[i]  # nan equals nothing, infinity no finite value
        if not (value == least or abs(value - least) <= rounding * max(abs(value), abs(least), floor) < math.inf):
            least = value
            found.append([])
        found[-1].append(i)
    return [sorted(group) for group in found]


def first_of(values: Sequence[float], floor: float = 0.0) -> int:
    """Return the position of the smallest value; the first of several that are equal but for rounding."""
    return group_equal(values, floor)[0][0]
