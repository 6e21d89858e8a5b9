"""Load of the required density over the number of strokes: strokes, fastest mould, and map over both speeds.

With the feed law "room" a gap determines the density after every stroke. One simulation therefore gives the number N of
strokes that a gap needs for the required density, and the mean load per roller length of these strokes. A row of gaps,
from that at the nip angle downwards, is a curve over N. The speeds of mould and cart enter by

    N = L v/(v_form s),    T = s/v,

with the stroke length s: the map interpolates the curve. The speed of the cart changes the rate of compaction too. The
map multiplies both forces by the ratio of the rate factors at the same gap, which is accurate to 0.5 % of the load for
a factor of two.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from compact.engines.process.forming import Feed
from compact.engines.process.section import BiteError, FormingProblem, OverfilledError
from compact.numerics import Array

CURVE_LAYERS = 1  # [-], merged layers; the load differs by 1e-9 from that of 20
CURVE_RTOL = 1e-6  # [-], error of a step of the integration
GAP_FACTOR, GAP_FACTOR_LAST = 0.75, 0.97  # [-], from one gap to the next; nearer gaps at the end of the curve
STROKES_MAX = 250  # [-], strokes of a curve; a smaller gap has no place on it


class OperatingMap(NamedTuple):
    """Forming at the required density over both speeds; arrays of shape (cart speeds, mould speeds).

    Parameters
    ----------
    mould_speeds, cart_speeds : ndarray
        Speeds [m/s].
    strokes : ndarray
        Strokes N on a section [-].
    load, resistance : ndarray
        Forces on one roller [N]; nan where the bite would exceed that at the nip angle.
    """

    mould_speeds: Array
    cart_speeds: Array
    strokes: Array
    load: Array
    resistance: Array


@dataclass(frozen=True, eq=False)
class DensityCurve:
    """Processes with the required density, arrays of shape (n,) with ascending numbers of strokes.

    Parameters
    ----------
    strokes : ndarray
        Strokes N on a section [-], fractions of the last one included.
    gap : ndarray
        Gap above the lowest generatrix [m].
    load : ndarray
        Mean load per unit roller length [N/m].
    work : ndarray
        Resistance of all strokes on a section [N/m], that of one roller over the advance of the mould.
    problem : FormingProblem
        Machine, mix and feed.
    """

    strokes: Array
    gap: Array
    load: Array
    work: Array
    problem: FormingProblem

    @property
    def least_strokes(self) -> float:
        """Least number of strokes [-], with the bite at the nip angle."""
        return float(self.strokes[0])

    def at(self, strokes: Array) -> Array:
        """Interpolate gap [m], load and work [N/m] over the logarithm of the strokes; nan outside the curve."""
        x, nodes = np.log(strokes), np.log(self.strokes)
        logarithms = np.log(np.array([self.gap, self.load, self.work]))
        if len(nodes) == 1:
            return np.array([np.where(x == nodes, np.exp(each), np.nan) for each in logarithms])
        return np.exp(PchipInterpolator(nodes, logarithms, axis=1, extrapolate=False)(x))

    def map(self, stroke: float, mould_speeds: Array, cart_speeds: Array) -> OperatingMap:
        """Interpolate the curve at speeds of mould and cart [m/s], with strokes of a length [m]."""
        length = self.problem.machine.roller_length
        advance = mould_speeds * stroke / cart_speeds[:, None]
        strokes = length / advance
        gap, load, work = self.at(strokes)
        factor = np.ones_like(gap)
        for row, speed in enumerate(cart_speeds.tolist()):
            faster, gaps = self.problem.at_speed(speed), np.nan_to_num(gap[row]).tolist()
            factor[row] = [faster.rate_factor(each) / self.problem.rate_factor(each) for each in gaps]
        return OperatingMap(mould_speeds, cart_speeds, strokes, load * factor * length, work * factor * advance)


def density_curve(problem: FormingProblem, density_ratio: float, most_strokes: float) -> DensityCurve:
    """Compute processes with a density ratio of the product and the feed law "room".

    Parameters
    ----------
    problem : FormingProblem
        Machine, mix and feed; the speed of the mould and the law of the feed are replaced.
    density_ratio : float
        Density ratio of the product [-].
    most_strokes : float
        Largest number of strokes of the curve [-], at most STROKES_MAX.

    Returns
    -------
    DensityCurve

    Raises
    ------
    BiteError
        If no gap within the nip angle leads to the density.
    """
    limit = int(np.ceil(min(most_strokes, STROKES_MAX)))
    feed = Feed(problem.feed.density_ratio, strokes=problem.feed.strokes)
    machine = replace(problem.machine, mould_speed=0.0, strokes=limit)
    base = replace(problem, machine=machine, feed=feed, layers=CURVE_LAYERS)
    gap, factor, points = machine.max_bite, GAP_FACTOR, list[tuple[float, ...]]()
    while factor < GAP_FACTOR_LAST:
        try:
            history = base.with_amount(gap, base.rate_factor(gap), rtol=CURVE_RTOL, until_density_ratio=density_ratio)
        except OverfilledError:  # the stroke that passes the density closes the pores: few strokes leave such holes
            gap *= GAP_FACTOR_LAST
            continue
        count = history.strokes_until(density_ratio)
        if 0 < count < np.inf:
            shares = np.clip(count - np.arange(history.count), 0, 1)
            points.append((count, gap, float(history.load @ shares) / count, float(history.resistance @ shares)))
            gap *= factor
        elif points:  # the gap is too small: half the way back to the last one
            factor = np.sqrt(factor)
            gap = points[-1][1] * factor
        else:
            raise BiteError(
                f"no gap within the nip angle leads to the density ratio {density_ratio!r} in {limit} strokes"
            )
    strokes, gaps, load, work = np.array(points).T
    return DensityCurve(strokes, gaps, load, work, problem)
