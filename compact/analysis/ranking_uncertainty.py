"""How sure an order of laws is: how far the error of the resistance moves each value, and whether two orders agree."""

import math
from typing import NamedTuple

import numpy as np

from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, is_tie, value_of


class Place(NamedTuple):
    """A law in an order by one criterion.

    rank : from 1, shared by values that are equal but for rounding, infinite ones share the last
    margin : to the next worse value, over `Criterion.scale`
    error : of the value, in its own unit, None where the resistance does not know its error
    resolved : whether no law behind it can pass, each moved by its own error; None where that is not known. Infinite values
        are not sure, nor is a law that another of another rank comes closer to than the build tolerance
    reason : why the value is infinite
    """

    rank: int
    law: str
    value: float
    margin: float
    error: float | None
    resolved: bool | None
    reason: str

    @property
    def tie(self):
        """Whether the next worse value is within the build tolerance."""
        return is_tie(self.margin)


def places(ranked, by, heavier):
    """A `Place` for each `ranking.Ranked` by a criterion.

        error = |value against a resistance greater by its own relative error - value|

    heavier : law -> run against that resistance; a law that no run is left of there has an infinite error; None where
        the error of the resistance is not known
    """
    tied = ties(ranked, by)
    errors = [None if heavier is None else error(place.run, heavier.get(place.run.name), by) for place in ranked]
    placed = []
    for place, own, ambiguous in zip(ranked, errors, tied, strict=True):
        behind = [
            other.value - error for other, error in zip(ranked, errors, strict=True) if other.rank > place.rank
        ] if heavier is not None else []  # fmt: skip
        if ambiguous or place.reason:
            resolved = False
        else:
            resolved = None if heavier is None else place.value + own <= min(behind, default=math.inf)
        placed.append(Place(place.rank, place.run.name, place.value, place.margin, own, resolved, place.reason))
    return placed


def ties(order, by):
    """Whether another place, of another rank, is within the build tolerance, for each of an order by a criterion."""
    values, ranks = ([getattr(place, name) for place in order] for name in ("value", "rank"))
    close = ~_built_apart(values, CRITERIA[by].floor) & np.isfinite(values) & np.isfinite(values)[:, None]
    return (close & (np.not_equal.outer(ranks, ranks))).any(axis=-1).tolist()


def error(run, heavier, by):
    """How far a criterion of a run is from that of the run against a greater resistance; infinite without one."""
    if heavier is None:
        return math.inf
    value, moved = value_of(run, by), value_of(heavier, by)
    return 0.0 if value == moved else abs(moved - value)


class Agreement(NamedTuple):
    """How far two orders of the same laws agree.

    tau : Kendall's, 1 for the same order, ties in both counted (tau-b); nan for fewer than two laws
    discordant_pairs : pairs of laws in opposite order, of `pairs`;  resolved_discordant_pairs : those whose values differ in both by
        more than their errors, an unknown error counting as none, and by the build tolerance
    """

    tau: float
    discordant_pairs: int
    resolved_discordant_pairs: int
    pairs: int


def agreement(one, other, by):
    """The `Agreement` of two lists of `Place`s by a criterion, over the laws that are finite in both."""
    found = [{place.law: place for place in order if not place.reason} for order in (one, other)]
    laws = [law for law in found[0] if law in found[1]]
    first, second = (_signs([order[law].rank for law in laws]) for order in found)
    floor = CRITERIA[by].floor
    apart = np.logical_and(*(_apart([order[law] for law in laws], floor) for order in found))
    turned = first * second < 0
    size = math.sqrt(np.sum(first**2) * np.sum(second**2))
    return Agreement(
        tau=float(np.sum(first * second) / size) if size else math.nan,
        discordant_pairs=int(np.sum(turned)) // 2,
        resolved_discordant_pairs=int(np.sum(turned & apart)) // 2,
        pairs=len(laws) * (len(laws) - 1) // 2,
    )


def _signs(ranks):
    return np.sign(np.subtract.outer(np.array(ranks, float), np.array(ranks, float)))


def _apart(order, floor):
    """Whether two values differ by more than their errors and by the build tolerance, each of all pairs."""
    values, errors = (np.array(column, float) for column in ([p.value for p in order], [p.error or 0.0 for p in order]))
    return (np.abs(np.subtract.outer(values, values)) > np.add.outer(errors, errors)) & _built_apart(values, floor)


def _built_apart(values, floor):
    """Whether two values differ by the build tolerance or more, each of all pairs."""
    values = np.asarray(values, float)
    scale = np.maximum(np.minimum.outer(np.abs(values), np.abs(values)), floor)
    with np.errstate(invalid="ignore"):  # of infinite values, which are not compared
        return np.abs(np.subtract.outer(values, values)) >= BUILD_TOLERANCE * scale
