"""Which input explains how much of the spread: Sobol indices of first order and in total, with their error.

    S_i = E[f_B (f_ABi - f_A)] / V,    T_i = E[(f_A - f_ABi)^2] / 2V,    V = Var f

f_A and f_B are values at two independent samples, f_ABi at A with the i-th input from B. S_i is the share of the
variance that goes when input i is known, T_i the share that stays when all others are. The error is that of n rows:
percentiles of BOOTSTRAPS samples drawn again from the rows, which for Sobol points is more than they err.

`scipy.stats.sobol_indices` has the same estimators, for powers of two only and with another error in every call; here
rows of which a point failed are left out.

References
----------
A. Saltelli et al., Variance based sensitivity analysis of model output, Comput. Phys. Commun. 181, 2010, table 2, b f.
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics.validation import require_finite

BOOTSTRAPS = 1000
CONFIDENCE = 0.95
FEWEST = 16  # rows without a failure, below which no index is told
ROUNDING = 1e-12  # of the mean: a spread that is none
SEED = 2015  # of the drawing


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one quantity [-], each of shape (inputs,), with the ends of their confidence intervals.

    rows : without a failure, of which they are made
    """

    first: np.ndarray
    first_low: np.ndarray
    first_high: np.ndarray
    total: np.ndarray
    total_low: np.ndarray
    total_high: np.ndarray
    rows: int


def indices(at_first, at_second, at_mixed):
    """`Indices` of values f_A, f_B, shape (n,), and f_AB, shape (inputs, n).

    A quantity that does not vary has indices of 0. Raises ValueError below FEWEST rows.

    >>> A, B = np.random.default_rng(1).random((2, 2, 4096))
    >>> def line(x, y):
    ...     return 2 * x + y
    >>> found = indices(line(*A), line(*B), np.array([line(B[0], A[1]), line(A[0], B[1])]))
    >>> found.first.round(1).tolist()  # of variances 4 and 1
    [0.8, 0.2]
    """
    require_finite(at_first=at_first, at_second=at_second, at_mixed=at_mixed)
    f_A, f_B, f_AB = (np.asarray(values, dtype=float) for values in (at_first, at_second, at_mixed))
    n = f_A.size
    if n < FEWEST:
        raise ValueError(f"Sobol indices need {FEWEST} rows without a failure, got {n}; take a larger sample")
    middle = np.mean([f_A, f_B])  # without it the estimates err by as much as the mean is large
    f_A, f_B, f_AB = f_A - middle, f_B - middle, f_AB - middle
    if max(np.ptp(f_A), np.ptp(f_B)) <= ROUNDING * abs(middle):
        return Indices(*np.zeros((6, len(f_AB))), n)
    drawn = np.random.default_rng(SEED).integers(n, size=(BOOTSTRAPS, n))
    spread = np.array([_estimated(f_A[rows], f_B[rows], f_AB[:, rows]) for rows in drawn])
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(spread, [tail, 1 - tail], axis=0)
    first, total = _estimated(f_A, f_B, f_AB)
    return Indices(first, low[0], high[0], total, low[1], high[1], n)


def _estimated(f_A, f_B, f_AB):
    """S and T, shape (2, inputs)."""
    variance = np.var(np.concatenate([f_A, f_B]))
    return np.array([np.mean(f_B * (f_AB - f_A), axis=-1), np.mean((f_A - f_AB) ** 2, axis=-1) / 2]) / variance


def of_table(table, quantity):
    """(names of the inputs, `Indices`) of a quantity of a sweep over a sample alone, made with `indices`."""
    parts = table["part"].values
    names = tuple(dict.fromkeys(part for part in parts if part not in ("A", "B")))
    values = table[quantity].values
    rows = np.array([values[parts == part] for part in ("A", "B", *names)])
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    return names, indices(rows[0], rows[1], rows[2:])
