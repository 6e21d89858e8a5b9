"""Linear programs of robust laws: the least worst peak over drives whose simulated histories are linearised at a law.

    minimise  T   subject to   |Q_i(t) + S_i(t) d| <= T   for all drives i and instants t,   limits of the law

Q_i is the history of the drive force H, or of the power H y', of drive i as simulated, d the change of the unknowns of
the law. With the resistance frozen over time the drive force of a change of y'' is exact,

    dH = G m dy'',   G = Z/(Z - m w^2),   Z = k + j w c,

on the periodic motion of both strokes. Rows enter where a solution violates them (exchange method); the `gap` is the
relative distance between the largest row of the solution and the dual value of its program, a bound from below.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg, sparse
from scipy.optimize import linprog

from compact.analysis.robust.drive_pool import STEPS, PassTable
from compact.motion.limits import Limits
from compact.motion.optimisation_problem import ConstraintSet, SplineSpace
from compact.motion.profile import MotionProfile
from compact.numerics import Array
from compact.numerics.convex_programs import HIGHS_TOLERANCE

PIECES = 30  # [-], of a law, with two unknowns each; 40 gain below 1 %
FIRST_ROWS, NEW_ROWS = 3, 5  # [-], of a drive: highest peaks at the start, and violated ones of a round
ROUNDS = 60  # [-], of the exchange; 8 to 11 are usual
ROW_TOLERANCE = 1e-7  # [-], by which a row may exceed the value of the program
BINDING = 1e-9  # [-], dual value of a row that is kept for the next program

Row = tuple[int, int, float]  # drive, instant, sign


class ProgramStep(NamedTuple):
    """Solution of a program.

    Parameters
    ----------
    change : ndarray, shape (unknowns,)
        d [-].
    value : float
        Predicted worst peak, in the unit of the histories.
    gap : float
        Relative gap between the largest row and the dual value [-].
    rows : set of Row
        Binding rows.
    """

    change: Array
    value: float
    gap: float
    rows: set[Row]


class LawSpace:
    """Laws of a stroke [m] in a duration [s] within limits, tabulated at the instants of a pass.

    The acceleration is continuous and piecewise quadratic on even pieces; on the return stroke it is opposite.
    """

    def __init__(self, limits: Limits, stroke: float, duration: float, mass: float) -> None:
        self.stroke, self.duration, self.mass = stroke, duration, mass
        self.space = SplineSpace(np.linspace(0, 1, PIECES + 1), max(2, limits.continuous))
        self.constraints = ConstraintSet(limits, self.space, stroke, duration)
        phases = np.linspace(0, 1, STEPS + 1)
        self._bases = [stroke / duration**k * np.asarray(self.space.derivatives[k](phases)) for k in range(3)]

    @property
    def start(self) -> Array:
        """Unknowns of the law with the least mean square of acceleration; InfeasibleError if no law exists."""
        return self.constraints.min_acceleration_law

    def table(self, unknowns: Array) -> PassTable:
        """Return position, velocity and acceleration at the instants."""
        y, v, a = (basis @ unknowns for basis in self._bases)
        return PassTable(y, v, a[:-1].copy(), a[1:].copy(), self.duration / STEPS, self.stroke)

    def motion(self, unknowns: Array, name: str) -> MotionProfile:
        """Return the law with a name."""
        return MotionProfile(name, self.stroke, self.duration, self.space.curve(unknowns))

    @cached_property
    def free_directions(self) -> Array:
        """Orthonormal changes of the unknowns that keep stroke and end conditions, shape (unknowns, directions)."""
        return np.asarray(linalg.null_space(self.constraints.program.equality_matrix))

    @cached_property
    def _spectrum(self):
        """Fourier coefficients of y'' of each unknown on both strokes, and their angular frequencies [rad/s]."""
        both = np.concatenate([self._bases[2][:-1], -self._bases[2][:-1]])
        return np.fft.rfft(both, axis=0), np.pi * np.arange(STEPS + 1) / self.duration

    def response(self, stiffness: float, damping: float) -> Array:
        """Return the derivatives of H [N] by the unknowns from the middle of a pass, shape (STEPS + 1, unknowns)."""
        spectrum, frequency = self._spectrum
        spring = stiffness + 1j * frequency * damping
        gain = self.mass * spring / (spring - self.mass * frequency**2)
        force = np.fft.irfft(gain[:, None] * spectrum, n=2 * STEPS, axis=0)
        return np.asarray(force[STEPS // 2 : STEPS // 2 + STEPS + 1])

    def minimise(
        self, unknowns: Array, histories: Array, slopes: Sequence[Array], rows: set[Row], radius: float = np.inf
    ) -> ProgramStep:
        """Minimise the worst linearised peak.

        Parameters
        ----------
        unknowns : ndarray
            Of the law at which the histories are linearised.
        histories : ndarray, shape (drives, STEPS + 1)
            Q, [N] or [W].
        slopes : sequence of ndarray, shape (STEPS + 1, unknowns)
            S of each drive.
        rows : set of Row
            Rows at the start, in addition to the highest peaks.
        radius : float
            Largest change of an unknown [-].
        """
        scale = float(np.abs(histories).max())
        rows = rows | {(i, *row) for i, history in enumerate(histories) for row in _peaks(history)[:FIRST_ROWS]}
        for _ in range(ROUNDS):
            listed = sorted(rows)
            change, value, weights = self._solve(unknowns, histories, slopes, listed, scale, radius)
            linear = [(history + slope @ change) / scale for history, slope in zip(histories, slopes, strict=True)]
            worst = max(float(np.abs(each).max()) for each in linear)
            entering = {
                (i, *row)
                for i, each in enumerate(linear)
                for row in _peaks(each)[:NEW_ROWS]
                if abs(each[row[0]]) > value * (1 + ROW_TOLERANCE)
            }
            if entering <= rows:
                break
            rows = rows | entering
        kept = {row for row, weight in zip(listed, weights, strict=True) if weight > BINDING}
        return ProgramStep(change, value * scale, worst / value - 1, kept)

    def _solve(self, unknowns, histories, slopes, rows, scale, radius):
        """Solve the dual of the program of some rows, divided by a scale: d, T and the dual value of each row.

            maximise  -h'l - b'm - r (p + q)   subject to   G'l + A'm + p - q = -c,   l, p, q >= 0

        of the program of (d, T) with G (d, T) <= h, A d = b and |d| <= r, whose solution is the dual one of this. With
        hundreds of rows and tens of unknowns it takes a third of the time.
        """
        equal, values, below, most = self.constraints.program
        drives, instants = [row[0] for row in rows], [row[1] for row in rows]
        signs, n = np.array([row[2] for row in rows]), len(unknowns)
        steep = np.array([slopes[i][t] for i, t in zip(drives, instants, strict=True)]) * signs[:, None] / scale
        bounds = np.append(most - below @ unknowns, -signs * histories[drives, instants] / scale)
        box = sparse.eye_array(n if np.isfinite(radius) else 0, n)
        cost = [bounds, np.full(2 * box.shape[0], radius), values - equal @ unknowns]
        rows_of_d = [[sparse.csr_array(each), None] for each in (below, box, -box, equal)]
        rows_of_d.insert(1, [steep, -np.ones((len(rows), 1))])
        task = np.concatenate(cost), None, None, sparse.block_array(rows_of_d).T, -np.eye(n + 1)[n]
        limits = [(0.0, None)] * (len(cost[0]) + len(cost[1])) + [(None, None)] * len(values)
        strict = {"primal_feasibility_tolerance": HIGHS_TOLERANCE, "dual_feasibility_tolerance": HIGHS_TOLERANCE}
        for options in (strict | {"presolve": False}, {"presolve": False}, {}):
            found = linprog(*task, bounds=limits, method="highs", options=options)
            if found.status == 0:
                return found.eqlin.marginals[:n], -float(found.fun), found.x[len(most) : len(bounds)]
        raise RuntimeError(f"HiGHS did not solve a program of {len(rows)} rows: {found.message}")


def _peaks(history):
    """(instant, sign) of the local maxima of a magnitude, the highest first."""
    size = np.abs(history)
    padded = np.concatenate([[-1.0], size, [-1.0]])
    tops = np.flatnonzero((size >= padded[:-2]) & (size >= padded[2:]))
    tops = tops[np.argsort(-size[tops])]
    return [(int(t), float(np.sign(history[t]))) for t in tops[: max(FIRST_ROWS, NEW_ROWS)]]
