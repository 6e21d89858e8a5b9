"""A motion law from a measured or drawn table of travel over time, with an honest jerk.

Differentiating a table three times multiplies its noise. The travel is therefore smoothed by a penalised quintic
spline (P-spline: Eilers and Marx, Statist. Sci. 11 (1996) 89),

    minimise |x - B c|^2 + w |D4 c|^2,   w by generalised cross-validation,

so that the jerk is a continuous quadratic spline, and its standard error follows from the scatter of the residuals.
The pass begins and ends at rest, since the cart turns there: the first two and last two coefficients are given.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PPoly

from compact.motion.profile import Motion
from compact.numerics.validation import require_finite

DEGREE = 5
GIVEN = 2  # coefficients at each end fixed by position and rest
MOST_INTERVALS = 60  # knots beyond this resolve nothing that a cart can follow
LEAST_ROWS = 12
PENALTIES = np.logspace(-12, 6, 73)  # of w over the mean diagonal of B'B


@dataclass(frozen=True)
class MeasuredMotion(Motion):
    """A `Motion` smoothed from a table; `scatter` [m] is the standard deviation of the rows about it."""

    scatter: float = 0.0
    covariance: np.ndarray | None = None
    knots: np.ndarray | None = None

    def standard_error(self, time, order):
        """Standard error of the derivative of the given order at time [s] of any shape: noise of the table, not bias.

        The end rows are met exactly, so their own noise is not in it.
        """
        z = np.clip(np.asarray(time, float) / self.duration, 0, 1)
        basis = BSpline(self.knots, np.eye(len(self.covariance)), DEGREE)(z, nu=order)
        return self._scale(order) * np.sqrt(np.einsum("...j,jk,...k->...", basis, self.covariance, basis))


def from_table(time, position, name="table"):
    """Motion through a table of travel over time, as a `MeasuredMotion`.

    Parameters
    ----------
    time : ndarray, shape (n,), n >= 12, strictly increasing [s], from rest to rest
    position : ndarray, shape (n,) [m]; the last row lies ahead of the first, and both are met exactly

    Raises ValueError for rows that are too few, not finite, not in order of time or not going ahead.

    >>> t = np.linspace(0, 3, 61)
    >>> x = 0.4 * (10 * (t / 3)**3 - 15 * (t / 3)**4 + 6 * (t / 3)**5)
    >>> m = from_table(t, np.round(x, 4))
    >>> f"jerk at the start {m.jerk(0.0):.2f} +- {m.standard_error(0.0, 3):.2f} m/s^3"
    'jerk at the start 0.91 +- 0.99 m/s^3'
    """
    time, position = _checked(time, position)
    duration, stroke = time[-1] - time[0], position[-1] - position[0]
    z, s = (time - time[0]) / duration, (position - position[0]) / stroke
    intervals = min(MOST_INTERVALS, len(z) // 3)
    knots = np.concatenate([np.zeros(DEGREE), np.linspace(0, 1, intervals + 1), np.ones(DEGREE)])
    coefficients, variance, inverse = _smooth(BSpline.design_matrix(z, knots, DEGREE).toarray(), s)
    spline = PPoly.from_spline((knots, coefficients, DEGREE))
    curve = PPoly(spline.c[:, DEGREE:-DEGREE], np.linspace(0, 1, intervals + 1))
    covariance = np.pad(variance * inverse, GIVEN)
    return MeasuredMotion(
        name, float(stroke), float(duration), curve, False, float(stroke * np.sqrt(variance)), covariance, knots
    )


def _checked(time, position):
    time, position = np.asarray(time, float), np.asarray(position, float)
    if time.shape != position.shape or time.ndim != 1 or time.size < LEAST_ROWS:
        raise ValueError(
            f"`time` and `position` must be columns of one length >= {LEAST_ROWS}, "
            f"got shapes {time.shape} and {position.shape}"
        )
    require_finite(time=time, position=position)
    if not np.all(np.diff(time) > 0):
        row = int(np.flatnonzero(np.diff(time) <= 0)[0]) + 1
        raise ValueError(f"`time` must increase, got {time[row]:g} after {time[row - 1]:g} in row {row + 1}")
    if not position[-1] > position[0]:
        raise ValueError(f"`position` must end ahead of its start, got {position[0]:g} to {position[-1]:g}")
    return time, position


def _smooth(basis, s):
    """Coefficients, variance of the rows about the spline, and inverse of the normal matrix of the free ones."""
    rough = np.diff(np.eye(basis.shape[1]), n=4, axis=0)
    free, rough_free = basis[:, GIVEN:-GIVEN], rough[:, GIVEN:-GIVEN]
    rest, rough_rest = s - basis[:, -GIVEN:].sum(axis=1), -rough[:, -GIVEN:].sum(axis=1)
    normal = free.T @ free
    size = np.trace(normal) / len(normal)

    def solve(weight):
        inverse = np.linalg.inv(normal + weight * size * rough_free.T @ rough_free)
        inner = inverse @ (free.T @ rest + weight * size * rough_free.T @ rough_rest)
        residual = np.sum((rest - free @ inner) ** 2)
        freedom = max(len(s) - np.sum(inverse * normal), 1.0)
        return residual / freedom**2, inner, residual / freedom, inverse

    _, inner, variance, inverse = min((solve(weight) for weight in PENALTIES), key=lambda trial: trial[0])
    return np.concatenate([np.zeros(GIVEN), inner, np.ones(GIVEN)]), variance, inverse
