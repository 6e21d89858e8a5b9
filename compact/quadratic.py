"""Convex programs: least (1/2) x'Qx + c'x where A x = b and G x <= h.

Linear ones (Q = 0) go to HiGHS. Quadratic ones go to a primal-dual interior point method with Mehrotra's predictor and
corrector, for which scipy has no solver: in the null space of A, with slacks s and multipliers z > 0, each step solves

    (Q + G'(z/s)G) dx = - residuals of  Qx + c + G'z = 0,  G x + s = h,  s z = 0

References
----------
S. Mehrotra, SIAM J. Optim. 2 (1992) 575; J. Nocedal and S. Wright, Numerical Optimization, 2nd ed., section 16.6.
"""

from typing import NamedTuple

import numpy as np
from scipy import linalg, sparse
from scipy.optimize import linprog

TIGHT = 1e-10  # feasibility and optimality asked of HiGHS: its strictest
MOST = 100  # interior point steps: 10-30 are taken
CLOSE = 1e-11  # relative residuals and complementarity at which the interior point stops
NEAR = 1e-8  # ... that it may be left with where rounding allows no more
FIXED = 1e-12  # of a row: less than that is left in the null space of what the equalities fix
STAY = 0.995  # share of the way to the boundary


class Program(NamedTuple):
    """A x = b, G x <= h: arrays or sparse matrices of n columns."""

    equal: np.ndarray
    equal_to: np.ndarray
    below: np.ndarray
    below_to: np.ndarray


def least_linear(cost, program, box=None):
    """x of least c'x, shape (n,), or None where no x fits; `box` bounds each |x_i|, inf for none.

    Raises RuntimeError where HiGHS gives up.
    """
    bounds = (None, None) if box is None else np.column_stack([-box, box])
    matrices = sparse.csr_array(program.below), program.below_to, sparse.csr_array(program.equal), program.equal_to
    tight = {"primal_feasibility_tolerance": TIGHT, "dual_feasibility_tolerance": TIGHT}
    for options in (tight, {}, {"presolve": False}):
        found = linprog(cost, *matrices, bounds=bounds, method="highs", options=options)
        if found.status in (0, 2):  # else it cannot tell whether anything fits so tightly
            return found.x
    raise RuntimeError(f"HiGHS gave up on {len(cost)} unknowns: {found.message}")


def least_quadratic(curvature, cost, program, box=None):
    """x of least (1/2) x'Qx + c'x, shape (n,); Q positive semidefinite, `box` as of `least_linear`.

    Raises RuntimeError, with what was reached, where the interior point does not close.
    """
    equal, n = np.asarray(program.equal, float), len(cost)
    start = np.linalg.lstsq(equal, program.equal_to, rcond=None)[0]
    free = linalg.null_space(equal)  # x = start + free w: equalities hold to rounding
    below, below_to = sparse.csr_array(program.below), np.asarray(program.below_to, float)
    if box is not None:
        held = np.flatnonzero(np.isfinite(box))
        unit = sparse.csr_array(sparse.eye_array(n))[held]
        below = sparse.csr_array(sparse.vstack([below, unit, -unit]))
        below_to = np.concatenate([below_to, box[held], box[held]])
    rows, room = below @ free, below_to - below @ start
    size, whole = np.abs(rows).max(axis=1), abs(below).max(axis=1).toarray().ravel()
    moves = size > FIXED * whole  # what the equalities fix has no inside
    point = _Point(
        free.T @ curvature @ free,
        free.T @ (cost + curvature @ start),
        rows[moves] / size[moves, None],
        room[moves] / size[moves],
    )
    for _ in range(MOST):
        if point.miss <= CLOSE or not point.advance():
            break
    if point.miss > NEAR:
        raise RuntimeError(f"interior point: residual {point.miss:.1e} after {point.steps} steps, {NEAR:g} was asked")
    return start + free @ point.x


class _Point:
    """An iterate x, z, s of the interior point method on Qx + c + G'z = 0, G x + s = h, and its residuals."""

    def __init__(self, curvature, cost, below, below_to):
        self.Q, self.c, self.G, self.h, self.steps = curvature, cost, below, below_to, 0
        self.x, self.s, self.z = np.zeros(len(cost)), np.ones(len(below_to)), np.ones(len(below_to))
        self._residuals()
        dx, *_ = self._direction(self._factors(), 0.0)
        self.x = dx
        self.s = np.maximum(self.h - self.G @ dx, 1.0)
        self._residuals()

    def _residuals(self):
        self.dual = self.Q @ self.x + self.c + self.G.T @ self.z
        self.slack = self.G @ self.x + self.s - self.h
        self.gap = float(self.s @ self.z) / len(self.h)
        worth = 1 + abs(self.c @ self.x + self.x @ self.Q @ self.x / 2)
        self.miss = max(
            np.abs(self.dual).max() / (1 + np.abs(self.c).max()),
            np.abs(self.slack).max() / (1 + np.abs(self.h).max()),
            self.s @ self.z / worth,
        )

    def _factors(self):
        matrix = self.Q + (self.G.T * (self.z / self.s)) @ self.G
        return linalg.lu_factor(matrix, check_finite=False)

    def _direction(self, factors, target):
        """Step towards s z = target, all residuals zero."""
        complementary = self.s * self.z - target
        right = -self.dual + self.G.T @ ((complementary - self.z * self.slack) / self.s)
        dx = linalg.lu_solve(factors, right, check_finite=False)
        ds = -self.slack - self.G @ dx
        return dx, -(complementary + self.z * ds) / self.s, ds

    def advance(self):
        """One predictor and corrector step; whether it led on."""
        factors = self._factors()
        _, dz, ds = self._direction(factors, 0.0)
        after = float((self.s + _reach(self.s, ds) * ds) @ (self.z + _reach(self.z, dz) * dz)) / len(self.h)
        dx, dz, ds = self._direction(factors, (after / self.gap) ** 3 * self.gap - ds * dz)
        length = min(1.0, STAY * min(_reach(self.s, ds, np.inf), _reach(self.z, dz, np.inf)))
        kept = self.x, self.z, self.s, self.miss
        self.x, self.z, self.s = self.x + length * dx, self.z + length * dz, self.s + length * ds
        self.steps += 1
        self._residuals()
        if not np.isfinite(self.miss) or (self.miss > kept[-1] and kept[-1] <= NEAR):  # rounding: the best was before
            self.x, self.z, self.s, self.miss = kept
            return False
        return True


def _reach(value, change, most=1.0):
    """Largest length <= most that keeps value + length change >= 0."""
    falling = change < 0
    return min(most, float(np.min(-value[falling] / change[falling], initial=np.inf)))
