"""Convex programs: least (1/2) x'Qx + c'x where A x = b and G x <= h.

Linear ones (Q = 0) go to HiGHS by scipy, quadratic ones to Clarabel, an interior point method. HiGHS takes entries
below 1e-9 for zero, and Clarabel requires rows of a like size: a row is divided by the larger of its largest entry and
its h; for HiGHS only if that is below 1, since its tolerance is that of the row. The unknowns are the caller's to
choose, of order 1 if a row holds small entries. A linear result is returned only if it keeps all rows.

References
----------
P. J. Goulart and Y. Chen, Clarabel: an interior-point solver for conic programs with quadratic objectives,
arXiv:2405.12762 (2024); Q. Huangfu and J. A. J. Hall, Math. Prog. Comp. 10 (2018) 119 (HiGHS).
"""

from typing import NamedTuple

import clarabel
import numpy as np
from scipy import linalg, sparse
from scipy.optimize import linprog

TIGHT = 1e-10  # [-], feasibility and optimality required of HiGHS: its strictest
CLOSE = 1e-12  # [-], residuals and duality gap required of Clarabel
NEAR = 1e-8  # [-], residuals and duality gap that are accepted where rounding allows no more
KEPT = 1e-6  # [-], of the terms of a row, by which a result may break it: ten times the default tolerance of HiGHS
FIXED = 1e-12  # [-], of a row: less than that is left in the null space of the equalities that fix it


class LinearConstraints(NamedTuple):
    """A x = b, G x <= h: arrays or sparse matrices of n columns."""

    equality_matrix: np.ndarray
    equality_values: np.ndarray
    inequality_matrix: np.ndarray
    inequality_bounds: np.ndarray


def minimise_linear(cost, program, box=None):
    """x of least c'x, shape (n,), or None where no x fits; `box` bounds each |x_i|, inf for none.

    Raises RuntimeError where HiGHS finds no solution that keeps all rows.
    """
    bounds = (None, None) if box is None else np.column_stack([-box, box])
    equal, equal_to = _scaled(program.equality_matrix, program.equality_values, most=1.0)
    below, below_to = _scaled(program.inequality_matrix, program.inequality_bounds, most=1.0)
    tight = {"primal_feasibility_tolerance": TIGHT, "dual_feasibility_tolerance": TIGHT}
    reasons = []
    for options in (tight, {}, {"presolve": False}):
        found = linprog(cost, below, below_to, equal, equal_to, bounds=bounds, method="highs", options=options)
        if found.status == 2:
            return None
        if found.status == 0:
            broken = _broken(found.x, equal, equal_to, below, below_to)
            if broken <= KEPT:
                return found.x
            found.message = f"a row is broken by {broken:.1e}"
        reasons.append(found.message)  # some settings cannot decide whether anything fits so tightly
    raise RuntimeError(f"HiGHS solved no program of {len(cost)} unknowns: {'; '.join(dict.fromkeys(reasons))}")


def minimise_quadratic(curvature, cost, program, box=None):
    """x of least (1/2) x'Qx + c'x, shape (n,); Q positive semidefinite, `box` as of `minimise_linear`.

    Raises RuntimeError, with the residuals reached, where Clarabel does not converge to `NEAR`.
    """
    equal, equal_to = _scaled(program.equality_matrix, program.equality_values)
    below, below_to = sparse.csr_array(program.inequality_matrix), np.asarray(program.inequality_bounds, float)
    if box is not None:
        held = np.flatnonzero(np.isfinite(box))
        unit = sparse.csr_array(sparse.eye_array(len(cost)))[held]
        below, below_to = sparse.vstack([below, unit, -unit]), np.concatenate([below_to, box[held], box[held]])
    below, below_to = _scaled(below, below_to)
    free = linalg.null_space(equal.toarray())
    moves = np.abs(below @ free).max(axis=1, initial=0.0) > FIXED  # a row that the equalities fix has no inside
    below, below_to = below[moves], below_to[moves]

    rows = sparse.csc_array(sparse.vstack([equal, below]))
    rows.eliminate_zeros()
    cones = [clarabel.ZeroConeT(len(equal_to)), clarabel.NonnegativeConeT(len(below_to))]
    upper = sparse.csc_array(np.triu((curvature + curvature.T) / 2))
    values, reached = np.concatenate([equal_to, below_to]), []
    for equilibrate in (False, True):  # the rows are scaled already
        solver = clarabel.DefaultSolver(upper, cost, rows, values, cones, _settings(equilibrate))
        found = solver.solve()
        if found.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            return np.array(found.x)
        reached.append(f"{found.status}, residuals {found.r_prim:.1e} and {found.r_dual:.1e}")
    raise RuntimeError(
        f"Clarabel solved no program of {len(cost)} unknowns to {NEAR:g}: {' or '.join(dict.fromkeys(reached))}"
    )


def _settings(equilibrate):
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.equilibrate_enable, settings.max_threads = False, equilibrate, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = CLOSE
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = settings.reduced_tol_feas = NEAR
    return settings


def _scaled(rows, values, most=np.inf):
    """Rows, sparse, and values, each divided by the larger of its largest entry and its value, or `most`."""
    rows, values = sparse.csr_array(rows, dtype=float), np.asarray(values, float)
    size = np.maximum(abs(rows).max(axis=1).toarray().ravel(), np.abs(values))
    size = np.where(size == 0, 1.0, np.minimum(size, most))
    return sparse.csr_array(sparse.diags_array(1 / size) @ rows), values / size


def _broken(x, equal, equal_to, below, below_to):
    """Largest violation of a row, relative to the sum of its terms' magnitudes, or 1 if that is larger."""
    missed = np.concatenate([np.abs(equal @ x - equal_to), below @ x - below_to])
    terms = np.concatenate([abs(equal) @ np.abs(x), abs(below) @ np.abs(x)])
    return float(np.max(missed / np.maximum(terms, 1.0), initial=0.0))
