"""Motion law from a measured or drawn table of travel over time.

Differentiating a table three times amplifies its noise. The travel is therefore smoothed by a penalised quintic spline
(P-spline),

    minimise |x - B c|^2 + w |D4 c|^2,   w by generalised cross-validation,

so that the jerk is a continuous quadratic spline. The pass begins and ends at rest: the first two and the last two
coefficients are fixed.

References
----------
P. H. C. Eilers and B. D. Marx, Statist. Sci. 11 (1996) 89.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly

from compact.motion.profile import MotionProfile
from compact.numerics import Array
from compact.numerics.validation import as_numbers, require_finite, require_number, require_positive, require_that

DEGREE = 5  # [-], of the spline
FIXED_COEFFICIENTS = 2  # [-], at each end, by position and rest
INTERVAL_LIMIT = 60  # [-], knot intervals; more resolve nothing that a cart can follow
ROW_MINIMUM = 12  # [-], rows of a table
FUNCTION_ROWS = 1201  # [-], times at which a function is evaluated; 20 per interval
FUNCTION_TOLERANCE = 1e-6  # [-], root-mean-square deviation of a function from its fit over the stroke
PENALTY_WEIGHTS = np.logspace(-12, 6, 73)  # [-], candidates of w over the mean diagonal of B'B


@dataclass(frozen=True)
class TabulatedMotion(MotionProfile):
    """A `MotionProfile` smoothed from a table.

    Attributes
    ----------
    scatter : float
        Standard deviation of the rows about the law [m].
    """

    scatter: float = 0.0


def from_table(time: ArrayLike, position: ArrayLike, name: str = "table") -> TabulatedMotion:
    """Fit a motion law to a table of travel over time.

    Parameters
    ----------
    time : array_like, shape (n,)
        Times from rest to rest [s], strictly increasing, n >= 12.
    position : array_like, shape (n,)
        Positions [m], the last one greater than the first; both are interpolated exactly.
    name : str
        Name of the law.

    Raises
    ------
    ValueError
        If there are too few rows, or rows that are not finite, not in order of time or without forward travel.

    Examples
    --------
    >>> t = np.linspace(0, 3, 61)
    >>> x = 0.4 * (10 * (t / 3)**3 - 15 * (t / 3)**4 + 6 * (t / 3)**5)
    >>> m = from_table(t, np.round(x, 4))
    >>> f"largest velocity {m.peaks().velocity:.3f} m/s, rows within {m.scatter * 1e6:.0f} um"
    'largest velocity 0.250 m/s, rows within 32 um'
    """
    time, position = (np.asarray(as_numbers(*each), float) for each in (("time", time), ("position", position)))
    if time.shape != position.shape or time.ndim != 1 or time.size < ROW_MINIMUM:
        raise ValueError(
            f"`time` and `position` must be columns of one length >= {ROW_MINIMUM}, "
            f"got shapes {time.shape} and {position.shape}"
        )
    require_finite(time=time, position=position)
    require_that(np.diff(time) > 0, time[1:], "`time` must increase, got")
    require_that(position[-1] > position[0], position[-1], "`position` must end above its start, got")
    duration, stroke = time[-1] - time[0], position[-1] - position[0]
    z, s = (time - time[0]) / duration, (position - position[0]) / stroke
    intervals = min(INTERVAL_LIMIT, len(z) // 3)
    knots = np.concatenate([np.zeros(DEGREE), np.linspace(0, 1, intervals + 1), np.ones(DEGREE)])
    coefficients, scatter = _fit(BSpline.design_matrix(z, knots, DEGREE).toarray(), s)
    spline = PPoly.from_spline((knots, coefficients, DEGREE))
    curve = PPoly(spline.c[:, DEGREE:-DEGREE], np.linspace(0, 1, intervals + 1))
    return TabulatedMotion(name, float(stroke), float(duration), curve, False, float(stroke * scatter))


def from_function(position: Callable[[Array], ArrayLike], duration: float, name: str = "function") -> TabulatedMotion:
    """Fit a motion law to the travel as a function of time.

    Parameters
    ----------
    position : callable
        Travel [m] at an array of times [s], from rest at 0 to rest at the duration.
    duration : float
        Time of the pass [s], > 0.
    name : str
        Name of the law.

    Returns
    -------
    TabulatedMotion
        Piecewise polynomial of degree 5 on 60 intervals.

    Raises
    ------
    ValueError
        If the function is not from rest to rest, or not resolved by the intervals.

    Examples
    --------
    >>> m = from_function(lambda t: 0.4 * np.sin(np.pi * t / 6) ** 2, duration=3.0)
    >>> f"{m.peaks().velocity:.6f} m/s, exact {0.2 * np.pi / 3:.6f} m/s"
    '0.209440 m/s, exact 0.209440 m/s'
    """
    require_number(duration=duration)
    require_positive(duration=duration)
    time = np.linspace(0, duration, FUNCTION_ROWS)
    found = from_table(time, np.broadcast_to(as_numbers("position", position(time)), time.shape), name)
    if found.scatter > FUNCTION_TOLERANCE * found.stroke:
        raise ValueError(
            f"the law '{name}' deviates from its fit by {found.scatter / found.stroke:.1e} of the stroke, tolerance "
            f"{FUNCTION_TOLERANCE:g}: `position` must be smooth, and begin and end at rest"
        )
    return found


def _fit(basis: Array, s: Array) -> tuple[Array, float]:
    """Coefficients and standard deviation of the residuals."""
    fixed, penalty = FIXED_COEFFICIENTS, np.diff(np.eye(basis.shape[1]), n=4, axis=0)
    free, penalty_free = basis[:, fixed:-fixed], penalty[:, fixed:-fixed]
    rest, penalty_rest = s - basis[:, -fixed:].sum(axis=1), -penalty[:, -fixed:].sum(axis=1)
    normal = free.T @ free
    size = np.trace(normal) / len(normal)

    def solve(weight: float) -> tuple[float, Array, float]:
        inverse = np.linalg.inv(normal + weight * size * penalty_free.T @ penalty_free)
        inner = inverse @ (free.T @ rest + weight * size * penalty_free.T @ penalty_rest)
        residual = np.sum((rest - free @ inner) ** 2)
        freedom = max(len(s) - np.sum(inverse * normal), 1.0)
        return residual / freedom**2, inner, residual / freedom

    _, inner, variance = min((solve(weight) for weight in PENALTY_WEIGHTS), key=lambda trial: trial[0])
    return np.concatenate([np.zeros(fixed), inner, np.ones(fixed)]), float(np.sqrt(variance))
