"""Load cycles of wheels and rollers by rainflow counting, and the life of their bearings by ISO 281.

    equivalent load   P = (int |F|^p |dx| / int |dx|)^(1/p)
    basic life        L10 = (C/P)^p  million revolutions,   p = 3 (ball), 10/3 (roller)

F is the radial load of one bearing, x the travel that turns it, C its basic dynamic rating. Load cycles are those of a
history that repeats: it is counted from its maximum on, so that every cycle is closed.

References
----------
ASTM E1049-85 (2017), 5.4.4 and 5.4.5 (rainflow, repeating histories); ISO 281:2007, basic rating life, valid for
P <= C/2 and without axial load.
"""

import math
from dataclasses import dataclass

import numpy as np
import rainflow

from compact.machine.ranking import group_equal
from compact.numerics import Array
from compact.numerics.validation import require_integers, require_known, require_positive

LIFE_EXPONENTS = {"ball": 3.0, "roller": 10 / 3}  # kind of bearing -> p [-]
VALID_SHARE = 0.5  # [-], of the rating; largest equivalent load for which ISO 281 is valid
ROUNDING_RANGE = 1e-7  # [-], of the largest |load|; smaller load cycles, and smaller differences, are rounding
SECONDS_PER_HOUR = 3600.0  # [s]


@dataclass(frozen=True)
class LoadCycle:
    """Load cycles of one range.

    Parameters
    ----------
    range, mean : float
        Range from minimum to maximum, and mean [N].
    count : float
        Number in one repetition of the history.
    """

    range: float
    mean: float
    count: float


def count_cycles(history: Array) -> list[LoadCycle]:
    """Count the load cycles of a repeating history by rainflow.

    Parameters
    ----------
    history : array_like, shape (n,)
        Load over one repetition [N].

    Returns
    -------
    list of LoadCycle
        Largest range first; equal ranges with equal means are one entry. Empty for a constant load.

    Examples
    --------
    >>> [(each.range, each.mean, each.count) for each in count_cycles([0.0, 5.0, 1.0, 4.0])]
    [(5.0, 2.5, 1.0), (3.0, 2.5, 1.0)]
    """
    load = np.asarray(history, float)
    start = int(load.argmax())
    repeated = np.concatenate([load[start:], load[: start + 1]])
    largest = float(np.abs(load).max())
    extracted = (map(float, cycle[:3]) for cycle in rainflow.extract_cycles(repeated))
    cycles = [LoadCycle(*cycle) for cycle in extracted]
    cycles = [each for each in cycles if each.range > ROUNDING_RANGE * largest]
    found = []
    for alike in _grouped(cycles, "range", largest):
        for same in _grouped(alike, "mean", largest):
            found.append(LoadCycle(same[0].range, same[0].mean, sum(each.count for each in same)))
    return found


def _grouped(cycles: list[LoadCycle], quantity: str, largest: float) -> list[list[LoadCycle]]:
    """Group cycles of equal range or mean, largest first."""
    values = [-getattr(each, quantity) for each in cycles]
    return [[cycles[i] for i in group] for group in group_equal(values, largest, ROUNDING_RANGE)]


@dataclass(frozen=True)
class Bearing:
    """Rolling bearings that share a load.

    Parameters
    ----------
    dynamic_rating : float
        C of one bearing [N].
    kind : {"ball", "roller"}
        Kind of its rolling elements.
    count : int
        Number of bearings that share the load equally, >= 1.
    """

    dynamic_rating: float
    kind: str
    count: int

    def __post_init__(self) -> None:
        require_positive(dynamic_rating=self.dynamic_rating)
        require_known("kind", self.kind, tuple(LIFE_EXPONENTS))
        require_integers(count=self.count)

    @property
    def exponent(self) -> float:
        """Exponent p of life over load [-]."""
        return LIFE_EXPONENTS[self.kind]


@dataclass(frozen=True)
class BearingLife:
    """Basic life of a bearing under a repeating load.

    Parameters
    ----------
    equivalent_load : float
        P of one bearing [N].
    million_revolutions : float
        L10, which 90 % of bearings reach, in million revolutions; infinite without load or travel.
    hours : float
        L10 of continuous operation [h].
    valid : bool
        True for P <= C/2, the range of ISO 281.
    """

    equivalent_load: float
    million_revolutions: float
    hours: float
    valid: bool


def bearing_life(bearing: Bearing, load: Array, travelled: Array, radius: float, period: float) -> BearingLife:
    """Compute the basic life of a bearing whose wheel rolls along a repeating travel.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Radial load on all its bearings together [N].
    travelled : ndarray, shape (n,)
        Part of the distance that the wheel rolls under each load [m], >= 0.
    radius : float
        Radius of the wheel [m].
    period : float
        Time of one repetition [s].

    Returns
    -------
    BearingLife

    Examples
    --------
    >>> bearing = Bearing(20e3, "ball", count=1)
    >>> life = bearing_life(bearing, np.full(1, 2000.0), np.full(1, 0.8), radius=0.1, period=2.0)
    >>> f"{life.million_revolutions:.0f} million revolutions, {life.hours:.0f} h"
    '1000 million revolutions, 436332 h'
    """
    require_positive(radius=radius, period=period)
    exponent, distance = bearing.exponent, float(np.sum(travelled))
    if not distance:  # a cart that its drive does not move
        standing = float(np.max(np.abs(load / bearing.count)))
        return BearingLife(standing, math.inf, math.inf, standing <= VALID_SHARE * bearing.dynamic_rating)
    moment = float(np.sum(travelled * np.abs(load / bearing.count) ** exponent)) / distance
    equivalent = moment ** (1 / exponent)
    revolutions = (bearing.dynamic_rating / equivalent) ** exponent if equivalent else math.inf
    per_second = distance / (2 * np.pi * radius) / period
    hours = revolutions * 1e6 / per_second / SECONDS_PER_HOUR
    valid = equivalent <= VALID_SHARE * bearing.dynamic_rating
    return BearingLife(equivalent, revolutions, hours, valid)
