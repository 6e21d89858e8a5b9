"""The ranking of laws: runs in order of what they ask of their drive, with the margin to the next."""

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from compact import quantities
from compact.numerics.validation import require_known
from compact.quantities import Quantity

ROUNDING_TIE = 1e-9  # [-], of the scale of a criterion: values closer than this are equal but for rounding
BUILD_TOLERANCE = 0.01  # [-]; machines built to one drawing differ as much: bearings, fits and motors scatter by 1 %


@dataclass(frozen=True)
class Criterion:
    """Quantity by which laws are ranked.

    quantity : term and unit of its values;  infinite_because : reason of an infinite value
    floor : least scale of differences between values, in the unit; 0 where the value itself is the scale
    cancelling : name of the criterion that gives the size of the terms of which the value is a sum, or empty; the value
        is rounding below `ROUNDING_TIE` of that size
    """

    quantity: Quantity
    infinite_because: str = ""
    floor: float = 0.0
    cancelling: str = ""

    @property
    def unit(self) -> str:
        """SI unit of its values."""
        return self.quantity.unit

    def scale(self, value):
        """Scale of differences from a value."""
        return max(abs(value), self.floor)


_JUMP = "the velocity jumps: an infinite force for no time"
_RULES: dict[str, dict[str, Any]] = {
    "peak_force": {"infinite_because": _JUMP},
    "peak_power": {"infinite_because": _JUMP},
    "rms_force": {"infinite_because": _JUMP},
    "rms_power": {"infinite_because": _JUMP},
    "mean_force": {"infinite_because": _JUMP},
    "dynamic_factor": {"infinite_because": _JUMP},
    "mean_power": {"cancelling": "rms_power"},
    "energy": {"cancelling": "drawn_energy"},
    "peak_jerk": {"infinite_because": "the acceleration jumps"},
    "nonuniformity": {"floor": 1.0},  # of the mean speed
    "ringing": {"infinite_because": "a drive that imposes a jump of the velocity has no peak to compare with"},
}
CRITERIA = MappingProxyType(
    {name: Criterion(quantity, **_RULES.get(name, {})) for name, quantity in quantities.CRITERIA.items()}
)


@dataclass(frozen=True)
class Ranked:
    """A run's place.

    rank : from 1, shared by values that are equal but for rounding; infinite values share the last
    margin : to the next worse value, over `Criterion.scale`;  reason : why the value is infinite, or empty
    """

    rank: int
    run: object
    value: float
    margin: float
    reason: str

    @property
    def tie(self):
        """Whether the next worse value is within the build tolerance."""
        return is_tie(self.margin)


def is_tie(margin):
    """Whether a margin is below the build tolerance; nan, of no next value, is none."""
    return margin < BUILD_TOLERANCE


def value_of(run, by):
    """Value of a criterion of a run, 0 where it is rounding."""
    value, criterion = getattr(run, by), CRITERIA[by]
    terms = getattr(run, criterion.cancelling) if criterion.cancelling else 0.0
    noise = ROUNDING_TIE * max(criterion.floor, terms if math.isfinite(terms) else 0.0)
    return 0.0 if abs(value) <= noise else value


def rank(runs, by="peak_force"):
    """Runs in order of a criterion, least first, as a list of `Ranked`.

    Values equal but for rounding share a rank. Infinite values come last, and after them what is no number; all of
    these share the last rank. The margin of the last finite value is infinite where worse ones follow, nan where none
    does.
    """
    require_known("criterion", by, tuple(CRITERIA))
    criterion = CRITERIA[by]
    ordered = sorted(((value_of(run, by), run) for run in runs), key=lambda pair: (math.isnan(pair[0]), pair[0]))
    values = [value for value, _ in ordered]
    places, best = [], math.nan  # the least value of those that share a rank
    for i, (value, run) in enumerate(ordered):
        if not math.isfinite(value):
            places.append(Ranked(len(ordered), run, value, math.nan, _why_infinite(by, run)))
            continue
        shared = _equal(best, value, criterion)
        best = best if shared else value
        worse = next((other for other in values[i:] if not _equal(best, other, criterion)), math.nan)
        scale = criterion.scale(value)
        margin = (worse - value) / scale if scale else math.nan
        places.append(Ranked(places[-1].rank if shared else i + 1, run, value, margin, ""))
    return places


def _why_infinite(by, run):
    return CRITERIA[by].infinite_because if run.shocks else "no force keeps the mean speed"


def _equal(a, b, criterion):
    """Whether two values differ by rounding only; nan is equal to nothing, infinity to no finite value."""
    return a == b or abs(a - b) <= ROUNDING_TIE * max(criterion.scale(a), criterion.scale(b)) < math.inf
