"""Linear and convex quadratic programs.

    minimise (1/2) x'Qx + c'x    subject to    A x = b,  G x <= h

HiGHS (through scipy) solves linear programs, Q = 0; Clarabel, an interior-point solver, solves quadratic ones. HiGHS
drops entries below 1e-9, and Clarabel requires rows of similar size. Each row is therefore divided by the larger of its
largest entry and its h; for HiGHS only where that is below 1, since its tolerance is absolute. The caller scales the
unknowns to order 1 if a row has small entries. A linear solution is returned only if it satisfies all rows.

References
----------
P. J. Goulart and Y. Chen, Clarabel: an interior-point solver for conic programs with quadratic objectives,
arXiv:2405.12762 (2024); Q. Huangfu and J. A. J. Hall, Math. Prog. Comp. 10 (2018) 119 (HiGHS).
"""

from typing import NamedTuple, TypeAlias

import clarabel
import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, sparse
from scipy.optimize import linprog

from compact.numerics import Array

HIGHS_TOLERANCE = 1e-10  # [-], primal and dual feasibility of HiGHS; its strictest
CLARABEL_TOLERANCE = 1e-12  # [-], residuals and duality gap of Clarabel
CLARABEL_ACCEPTED = 1e-8  # [-], residuals and duality gap accepted where rounding prevents CLARABEL_TOLERANCE
ROW_TOLERANCE = 1e-6  # [-], violation of a row over the size of its terms; ten times the default tolerance of HiGHS
NULL_SPACE_TOLERANCE = 1e-12  # [-], part of a row in the null space of the equalities; below it they determine the row

Matrix: TypeAlias = Array | sparse.csr_array


class LinearConstraints(NamedTuple):
    """Linear constraints A x = b, G x <= h on n unknowns.

    Parameters
    ----------
    equality_matrix : array or sparse array, shape (k, n)
    equality_values : ndarray, shape (k,)
        b.
    inequality_matrix : array or sparse array, shape (m, n)
        G.
    inequality_bounds : ndarray, shape (m,)
        h.
    """

    equality_matrix: Matrix
    equality_values: Array
    inequality_matrix: Matrix
    inequality_bounds: Array


def minimise_linear(
    cost: Array, constraints: LinearConstraints, low: ArrayLike = -np.inf, high: ArrayLike = np.inf
) -> Array | None:
    """Minimise c'x, low <= x <= high; None if the constraints are infeasible, RuntimeError without a solution."""
    bounds = np.stack(np.broadcast_arrays(low, high, cost)[:2], axis=1)
    A, b = _scaled(constraints.equality_matrix, constraints.equality_values, largest=1.0)
    G, h = _scaled(constraints.inequality_matrix, constraints.inequality_bounds, largest=1.0)
    strict = {"primal_feasibility_tolerance": HIGHS_TOLERANCE, "dual_feasibility_tolerance": HIGHS_TOLERANCE}
    failures = []
    for options in (strict, {}, {"presolve": False}):
        result = linprog(cost, G, h, A, b, bounds=bounds, method="highs", options=options)
        if result.status == 2:
            return None
        if result.status == 0:
            x = result.x  # violation of a row over the sum of the magnitudes of its terms, or over 1 if that is larger
            terms = np.concatenate([abs(A) @ np.abs(x), abs(G) @ np.abs(x)])
            rows = np.concatenate([np.abs(A @ x - b), G @ x - h])
            violation = float(np.max(rows / np.maximum(terms, 1.0), initial=0.0))
            if violation <= ROW_TOLERANCE:
                return result.x
            result.message = f"a row is violated by {violation:.1e}"
        failures.append(result.message)  # strict tolerances may leave the feasibility undecided
    raise RuntimeError(
        f"HiGHS did not solve a linear program of {len(cost)} unknowns: {'; '.join(dict.fromkeys(failures))}"
    )


def minimise_quadratic(
    curvature: Array, cost: Array, constraints: LinearConstraints, low: ArrayLike = -np.inf, high: ArrayLike = np.inf
) -> Array:
    """Minimise (1/2) x'Qx + c'x with Q positive semidefinite, shape (n, n), and low <= x <= high."""
    A, b = _scaled(constraints.equality_matrix, constraints.equality_values)
    G, h = sparse.csr_array(constraints.inequality_matrix), np.asarray(constraints.inequality_bounds, float)
    unit = sparse.csr_array(sparse.eye_array(len(cost)))
    for sign, limit in ((-1, low), (1, high)):
        values = sign * np.broadcast_to(limit, cost.shape)
        bounded = np.flatnonzero(np.isfinite(values))
        G, h = sparse.vstack([G, sign * unit[bounded]]), np.append(h, values[bounded])
    G, h = _scaled(G, h)
    # rows that the equalities determine have no interior
    undetermined = np.abs(G @ linalg.null_space(A.toarray())).max(axis=1, initial=0.0) > NULL_SPACE_TOLERANCE
    G, h = G[undetermined], h[undetermined]
    rows = sparse.csc_array(sparse.vstack([A, G]))
    rows.eliminate_zeros()
    cones = [clarabel.ZeroConeT(len(b)), clarabel.NonnegativeConeT(len(h))]
    upper = sparse.csc_array(np.triu((curvature + curvature.T) / 2))
    values, failures = np.concatenate([b, h]), []
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = CLARABEL_TOLERANCE
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = settings.reduced_tol_feas = CLARABEL_ACCEPTED
    for settings.equilibrate_enable in (False, True):  # the rows are scaled already
        result = clarabel.DefaultSolver(upper, cost, rows, values, cones, settings).solve()
        if result.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            return np.array(result.x)
        failures.append(f"{result.status}, residuals {result.r_prim:.1e} and {result.r_dual:.1e}")
    raise RuntimeError(
        f"Clarabel did not solve a quadratic program of {len(cost)} unknowns to {CLARABEL_ACCEPTED:g}: "
        f"{' or '.join(dict.fromkeys(failures))}"
    )


def _scaled(matrix: Matrix, values: ArrayLike, largest: float = np.inf) -> tuple[sparse.csr_array, Array]:
    """Rows, sparse, and values, each divided by the larger of its largest entry and its value, or by `largest`."""
    rows, values = sparse.csr_array(matrix, dtype=float), np.asarray(values, float)
    size = np.maximum(abs(rows).max(axis=1).toarray().ravel(), np.abs(values))
    size = np.where(size == 0, 1.0, np.minimum(size, largest))
    return sparse.csr_array(sparse.diags_array(1 / size) @ rows), values / size
