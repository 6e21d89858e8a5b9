"""Uncertainty of a ranking of laws by the error of the resistance."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, Ranked, is_tie, value_of


class Place(NamedTuple):
    """Place of a law in a ranking by one criterion.

    Parameters
    ----------
    rank : int
        From 1; values that are equal but for rounding share a rank, infinite values share the last.
    margin : float
        Relative distance to the next worse value, over `Criterion.scale` [-].
    error : float or None
        Error of the value, in its unit; None without error estimate of the resistance.
    resolved : bool or None
        True if the rank is resolved: no law behind it is better if each value changes by its error. None if the errors
        are unknown. Infinite values are not resolved, nor laws of different rank within the build tolerance.
    reason : str
        Reason why the value is infinite; empty if it is finite.
    """

    rank: int
    law: str
    value: float
    margin: float
    error: float | None
    resolved: bool | None
    reason: str

    @property
    def tie(self) -> bool:
        """True if the next worse value is within the build tolerance."""
        return is_tie(self.margin)


Places = dict[str, dict[str, list[Place]]]  # by drive and criterion


def places(ranked: Sequence[Ranked], by: str, heavier: Mapping[str, Any] | None) -> list[Place]:
    """Add error and resolution to the ranking of laws by a criterion.

        error = |value under the resistance plus its error - value|

    Parameters
    ----------
    heavier : mapping or None
        Run of each law under the resistance plus its error; a law without such a run has an infinite error. None
        without error estimate.
    """
    tied = ties(ranked, by)
    errors = [None if heavier is None else error(place.run, heavier.get(place.run.name), by) for place in ranked]
    placed = []
    for place, own, ambiguous in zip(ranked, errors, tied, strict=True):
        behind = [
            other.value - change
            for other, change in zip(ranked, errors, strict=True)
            if change is not None and other.rank > place.rank
        ]
        resolved = None if own is None else place.value + own <= min(behind, default=math.inf)
        resolved = False if ambiguous or place.reason else resolved
        placed.append(Place(place.rank, place.run.name, place.value, place.margin, own, resolved, place.reason))
    return placed


def ties(order: Sequence[Place | Ranked], by: str) -> list[bool]:
    """Find the places that have another place, of another rank, within the build tolerance."""
    values, ranks = ([getattr(place, name) for place in order] for name in ("value", "rank"))
    size, finite = np.abs(values), np.isfinite(values)
    scale = np.maximum(np.minimum.outer(size, size), CRITERIA[by].floor)
    with np.errstate(invalid="ignore"):  # of infinite values, which are not compared
        apart = np.abs(np.subtract.outer(values, values)) >= BUILD_TOLERANCE * scale
    tied = np.asarray(~apart & finite & finite[:, None] & np.not_equal.outer(ranks, ranks))
    return [bool(row.any()) for row in tied]


def error(run: Any, heavier: Any, by: str) -> float:
    """Compute the change of a criterion under a greater resistance.

    Parameters
    ----------
    run, heavier : Run
        Runs of one law under both resistances; `heavier` may be None.

    Returns
    -------
    float
        In the unit of the criterion; infinite without `heavier`.
    """
    if heavier is None:
        return math.inf
    value, heavier_value = value_of(run, by), value_of(heavier, by)
    return 0.0 if value == heavier_value else abs(heavier_value - value)
