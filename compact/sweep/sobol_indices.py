"""Sobol indices of first order and in total of a sweep, by `scipy.stats.sobol_indices`.

    S_i = E[f_B (f_ABi - f_A)] / V,    T_i = E[(f_A - f_ABi)^2] / 2V,    V = Var f

f_A and f_B are values at two independent samples, f_ABi at A with the i-th input from B. S_i is the share of the
variance that input i explains alone, T_i the share that remains if all other inputs are known. The confidence interval
is a bootstrap over the rows, which for Sobol points overestimates the error. Rows with a failed point are omitted, and
the others are cut to a power of two.

References
----------
A. Saltelli et al., Variance based sensitivity analysis of model output, Comput. Phys. Commun. 181, 2010, table 2, b f.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array, IntArray

if TYPE_CHECKING:
    import xarray

QUANTITIES = ("load", "resistance", "resistance_coefficient", "capture_angle")  # with indices in a sweep
BOOTSTRAPS = 1000
LEAST_ROWS = 16  # without failed point; with fewer the indices are not estimated
SPREAD_ROUNDING = 1e-12  # [-], of the largest value; a smaller spread counts as zero
SEED = 2015  # of the bootstrap


class Index(NamedTuple):
    """Sobol indices of one quantity for one input.

    Parameters
    ----------
    first, first_low, first_high : float
        Index of first order and its 95 % confidence interval [-].
    total, total_low, total_high : float
        Total index and its 95 % confidence interval [-].
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


def indices(values: ArrayLike) -> list[Index]:
    """Estimate the Sobol indices of a quantity for each input; a constant quantity has indices of 0.

    Parameters
    ----------
    values : array_like, shape (2 + inputs, rows)
        f_A, f_B, and f_AB of each input; the number of rows is a power of two.

    Examples
    --------
    >>> A, B = np.random.default_rng(1).random((2, 2, 4096))
    >>> def line(x, y):
    ...     return 2 * x + y
    >>> found = indices([line(*A), line(*B), line(B[0], A[1]), line(A[0], B[1])])
    >>> [round(each.first, 1) for each in found]  # of variances 4 and 1
    [0.8, 0.2]
    """
    from scipy.stats import bootstrap, sobol_indices

    values = np.asarray(values, dtype=float)
    inputs, n = len(values) - 2, values.shape[1]
    if np.ptp(values[:2]) <= SPREAD_ROUNDING * np.abs(values).max():
        return [Index(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, n)] * inputs
    f_A, f_B = values[:2]
    f_AB = np.vstack([values[2:], f_A])  # an input without influence is added, as scipy does not take a single one

    def estimate(rows: IntArray) -> Array:
        """Return S and T, shape (2, inputs)."""
        found = sobol_indices(func={"f_A": f_A[None, rows], "f_B": f_B[None, rows], "f_AB": f_AB[:, None, rows]}, n=n)
        return np.array([found.first_order, found.total_order])[:, :-1]

    rows, options = np.arange(n), {"n_resamples": BOOTSTRAPS, "vectorized": False, "method": "percentile", "rng": SEED}
    low, high = bootstrap([rows], estimate, **options).confidence_interval
    found = np.stack([estimate(rows), low, high], axis=1)  # order, estimate and bounds, input
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
            power_of_two = 1 << (rows.shape[1].bit_length() - 1)
            found[quantity] = dict(zip(names[2:], indices(rows[:, :power_of_two]), strict=True))
    return found
