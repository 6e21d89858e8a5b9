"""Sobol indices of first order and in total, with bootstrap confidence intervals.

    S_i = E[f_B (f_ABi - f_A)] / V,    T_i = E[(f_A - f_ABi)^2] / 2V,    V = Var f

f_A and f_B are values at two independent samples, f_ABi at A with the i-th input from B. S_i is the share of the
variance that input i explains alone, T_i the share that remains if all other inputs are known. The confidence interval
is a bootstrap over the n rows, which for Sobol points overestimates the error.

`scipy.stats.sobol_indices` has the same estimators, for powers of two only; here rows with a failed point are omitted.

References
----------
A. Saltelli et al., Variance based sensitivity analysis of model output, Comput. Phys. Commun. 181, 2010, table 2, b f.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array, IntArray
from compact.numerics.validation import require_finite

if TYPE_CHECKING:
    import xarray

QUANTITIES = ("load", "resistance", "resistance_coefficient", "capture_angle")  # with indices in a sweep
BOOTSTRAPS = 1000
CONFIDENCE = 0.95  # [-], level of the intervals
LEAST_ROWS = 16  # without failed point; with fewer the indices are not estimated
SPREAD_ROUNDING = 1e-12  # [-], of the mean; a smaller spread counts as zero
SEED = 2015  # of the bootstrap


class Index(NamedTuple):
    """Sobol indices of one quantity for one input.

    Parameters
    ----------
    first, first_low, first_high : float
        Index of first order and its confidence interval [-].
    total, total_low, total_high : float
        Total index and its confidence interval [-].
    rows : int
        Number of rows.
    """

    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float
    rows: int


SobolTable = dict[str, dict[str, Index]]  # by quantity and input


def indices(at_first: ArrayLike, at_second: ArrayLike, at_mixed: ArrayLike) -> list[Index]:
    """Estimate the Sobol indices of a quantity for each input; a constant quantity has indices of 0.

    Parameters
    ----------
    at_first, at_second : array_like, shape (n,)
        Values f_A and f_B.
    at_mixed : array_like, shape (inputs, n)
        Values f_AB.

    Raises
    ------
    ValueError
        If there are fewer than LEAST_ROWS rows.

    Examples
    --------
    >>> A, B = np.random.default_rng(1).random((2, 2, 4096))
    >>> def line(x, y):
    ...     return 2 * x + y
    >>> found = indices(line(*A), line(*B), np.array([line(B[0], A[1]), line(A[0], B[1])]))
    >>> [round(each.first, 1) for each in found]  # of variances 4 and 1
    [0.8, 0.2]
    """
    require_finite(at_first=at_first, at_second=at_second, at_mixed=at_mixed)
    values = np.vstack([at_first, at_second, at_mixed]).astype(float)
    inputs, n = len(values) - 2, values.shape[1]
    if n < LEAST_ROWS:
        raise ValueError(f"Sobol indices need {LEAST_ROWS} rows without a failure, got {n}; take a larger sample")
    middle = np.mean(values[:2])  # subtracted, as the errors of the estimators grow with the mean
    values -= middle
    if np.ptp(values[:2], axis=1).max() <= SPREAD_ROUNDING * abs(middle):
        return [Index(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, n)] * inputs

    def estimate(rows: IntArray | slice) -> Array:
        """Return S and T, shape (2, inputs)."""
        f_A, f_B, *f_AB = values[:, rows]
        variance = np.var(np.concatenate([f_A, f_B]))
        return np.array([np.mean(f_B * (f_AB - f_A), axis=-1), np.mean((f_A - f_AB) ** 2, axis=-1) / 2]) / variance

    drawn = np.random.default_rng(SEED).integers(n, size=(BOOTSTRAPS, n))
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile([estimate(rows) for rows in drawn], [tail, 1 - tail], axis=0)
    found = np.stack([estimate(slice(None)), low, high], axis=1)  # order, estimate and bounds, input
    return [Index._make([*each, n]) for each in found.reshape(6, inputs).T.tolist()]


def of_table(table: "xarray.Dataset") -> SobolTable:
    """Estimate the indices of each of QUANTITIES of a sweep.

    Returns
    -------
    dict
        Indices by quantity and input; empty for a sample that was not designed for indices. A quantity with fewer than
        LEAST_ROWS rows is left out.
    """
    if table["load"].dims != ("sample",) or set(table["part"].values) == {"A"}:
        return {}
    parts, found = table["part"].values, {}
    names = list(dict.fromkeys(parts))  # A, B, and the inputs
    for quantity in QUANTITIES:
        rows = np.array([table[quantity].values[parts == part] for part in names])
        rows = rows[:, np.isfinite(rows).all(axis=0)]
        if rows.shape[1] >= LEAST_ROWS:
            found[quantity] = dict(zip(names[2:], indices(rows[0], rows[1], rows[2:]), strict=True))
    return found
