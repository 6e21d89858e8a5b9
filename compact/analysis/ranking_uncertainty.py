"""Uncertainty of a ranking of laws by the error of the resistance, and agreement of two rankings (Kendall's tau-b).

References
----------
Kendall M. G. (1945): The treatment of ties in ranking problems. Biometrika 33, 239-251.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, Ranked, is_tie, value_of

NAMED_LAWS = 3  # [-], largest number of laws of one rank that are named


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
    close = ~_built_apart(values, CRITERIA[by].floor) & np.isfinite(values) & np.isfinite(values)[:, None]
    tied = np.asarray(close & np.not_equal.outer(ranks, ranks))
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


class Agreement(NamedTuple):
    """Agreement of two rankings of the same laws by one criterion.

    Parameters
    ----------
    tau : float
        Kendall's tau-b [-]: 1 for the same order; nan for fewer than two laws.
    resolved_discordant_pairs : int
        Number of resolved discordant pairs: both differences exceed the errors and the build tolerance. An unknown
        error counts as zero.
    first, other_first : str
        First law of either ranking; several laws, their number or "none" where there is not one.
    engine, drive, other_engine, other_drive : str
        Engine and kind of drive of either ranking.
    """

    tau: float
    discordant_pairs: int
    resolved_discordant_pairs: int
    pairs: int
    first: str
    other_first: str
    by: str
    engine: str = ""
    drive: str = ""
    other_engine: str = ""
    other_drive: str = ""


def agreement(one: Sequence[Place], other: Sequence[Place], by: str, *case: str) -> Agreement:
    """Compare two rankings over the laws that are finite in both; `case` is engine and drive of either."""
    found = [{place.law: place for place in order if not place.reason} for order in (one, other)]
    laws = [law for law in found[0] if law in found[1]]
    signs, apart = [], []  # of all pairs of laws, in either ranking
    for order in found:
        rows = [(place.rank, place.value, place.error or 0.0) for place in map(order.__getitem__, laws)]
        ranks, values, errors = np.array(rows, float).reshape(-1, 3).T
        signs.append(np.sign(np.subtract.outer(ranks, ranks)))
        beyond = np.abs(np.subtract.outer(values, values)) > np.add.outer(errors, errors)
        apart.append(beyond & _built_apart(values, CRITERIA[by].floor))
    discordant = signs[0] * signs[1] < 0
    size = math.sqrt(np.sum(signs[0] ** 2) * np.sum(signs[1] ** 2))
    return Agreement(
        float(np.sum(signs[0] * signs[1]) / size) if size else math.nan,
        int(np.sum(discordant)) // 2,
        int(np.sum(discordant & apart[0] & apart[1])) // 2,
        len(laws) * (len(laws) - 1) // 2,
        _first_laws(one),
        _first_laws(other),
        by,
        *case,
    )


def agreements(places_by_engine: Mapping[str, Places]) -> list[Agreement]:
    """Compare the first ranking with those of every other engine, and with those of its other drives.

    Parameters
    ----------
    places_by_engine : mapping of str to Places
        Places by engine, drive and criterion; engine and drive of the scene first.
    """
    engine, *others = places_by_engine
    own = places_by_engine[engine]
    drive, *other_drives = own
    cases = [(engine, kind, name, kind) for name in others for kind in own]
    cases += [(engine, drive, engine, other) for other in other_drives]
    return [
        agreement(order, places_by_engine[case[2]][case[3]][by], by, *case)
        for case in cases
        for by, order in own[case[1]].items()
    ]


def _first_laws(order: Sequence[Place]) -> str:
    """Name the laws of rank 1, or their number where they are many; "none" where all values are infinite."""
    laws = [place.law for place in order if place.rank == 1 and not place.reason]
    if not laws:
        return "none"
    return "/".join(sorted(laws)) if len(laws) <= NAMED_LAWS else f"{len(laws)} laws alike"


def _built_apart(values: ArrayLike, floor: float) -> NDArray[np.bool_]:
    """Find the pairs of values that differ by the build tolerance or more."""
    values = np.asarray(values, float)
    scale = np.maximum(np.minimum.outer(np.abs(values), np.abs(values)), floor)
    with np.errstate(invalid="ignore"):  # of infinite values, which are not compared
        return np.abs(np.subtract.outer(values, values)) >= BUILD_TOLERANCE * scale
