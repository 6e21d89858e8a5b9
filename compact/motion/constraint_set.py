"""Limits of a motion law as linear constraints on the unknowns of a spline space.

Derivatives and cam limits are bounded by Bernstein coefficients, so that they hold at every instant, not at samples
only. Infeasible limits are reported one by one with the relaxation that each requires, from a linear program with
elastic bounds (phase-one relaxation). The curvature of a cam for a roller follower is not linear (`pitch_curve`); only
the condition that its flanks do not cross is included here.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse

from compact.motion.limits import BOUNDED_DERIVATIVES, VIOLATION_TOLERANCE, CamLimits, Conflict, InfeasibleError, Limits
from compact.motion.pitch_curve import PitchCurve
from compact.motion.spline_space import SplineSpace, graded_breaks
from compact.numerics import Array
from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic

HULL_HALVINGS = 2  # [-], of the pieces of a bound: the Bernstein hull of a parabola is then within 1/16 of its sagitta
FIXED_BOUND_COST = 1e3  # [-], of a bound that is not to be relaxed, over 1 of the relaxed bound
STEADY_PIECES = 16  # [-], of the phase of constant velocity where the velocity may deviate


class Bound(NamedTuple):
    """Elastic constraint rows @ c + offset <= limit.

    Attributes
    ----------
    name, unit : str
        Name and unit of the limit.
    limit : float
        Value of the limit.
    rows : ndarray, shape (rows, unknowns)
        Coefficients of the unknowns, in the unit of the limit.
    offset : ndarray, shape (rows,)
        Constant part, in the unit of the limit.
    """

    name: str
    unit: str
    limit: float
    rows: Array
    offset: Array

    def reached(self, unknowns: Array) -> float:
        """Return the smallest limit that a law satisfies, in the unit of the limit."""
        return float(np.max(self.rows @ unknowns + self.offset))


@dataclass(frozen=True, eq=False)
class ConstraintSet:
    """Limits on the laws of a spline space, as a `LinearConstraints` in its unknowns.

    Attributes
    ----------
    stroke, duration : float
        Travel [m] and time [s] of one pass.
    """

    limits: Limits
    space: SplineSpace
    stroke: float
    duration: float

    @cached_property
    def bounds(self) -> list[Bound]:
        """All elastic constraints."""
        bounds = []
        for name, (order, unit) in BOUNDED_DERIVATIVES.items():
            if (limit := getattr(self.limits, name)) is not None:
                rows = self.stroke / self.duration**order * self.space.hull(order, HULL_HALVINGS)
                rows = rows if order == 1 else np.concatenate([rows, -rows])
                bounds.append(Bound(name, unit, limit, rows, np.zeros(len(rows))))
        return bounds + (self._cam_bounds(self.limits.cam) if self.limits.cam else [])

    @cached_property
    def pitch(self) -> PitchCurve | None:
        """The `PitchCurve` of a roller follower with a limit on its profile, else None."""
        return self.limits.cam.pitch_curve(self.stroke, self.duration) if self.limits.cam else None

    @cached_property
    def program(self) -> LinearConstraints:
        """The `LinearConstraints` of all limits."""
        (equal, equal_to), (hard, hard_to) = self._equal, self._hard
        below = sparse.csr_array(np.concatenate([hard, *self._relative_rows]))
        return LinearConstraints(equal, equal_to, below, np.concatenate([hard_to, *self._relative_values]))

    @cached_property
    def min_acceleration_law(self) -> Array:
        """Unknowns of the law with the smallest rms acceleration, the start of a search."""
        together = self._relaxed_bounds(np.ones(len(self.bounds)))
        if together:
            costs = np.where(np.eye(len(self.bounds)), 1.0, FIXED_BOUND_COST)
            alone = [self._relaxed_bounds(row) for row in costs]  # bounds whose relaxation by itself suffices
            names = [bound.name for bound in self.bounds]
            single = [found[0] for found, name in zip(alone, names, strict=True) if [c.name for c in found] == [name]]
            raise InfeasibleError(single or together, alone=bool(single))
        u, weights = np.polynomial.legendre.leggauss(self.space.smoothness + 1)
        weights = np.outer(np.diff(self.space.breaks), weights / 2).ravel()
        rows = self.space.values(2, (u + 1) / 2) * np.sqrt(weights)[:, None]
        return minimise_quadratic(rows.T @ rows, np.zeros(self.space.size), self.program)

    @cached_property
    def max_margin_law(self) -> Array:
        """Unknowns of the law with the largest relative distance from the nearest bound."""
        relative = sum(map(len, self._relative_rows))
        margin = np.repeat([0.0, 1.0], [len(self._hard[0]), relative])
        solution = self._minimise_extended(np.array([-1.0]), margin)
        return solution[: self.space.size]

    def project(self, unknowns: Array) -> Array:
        """Return coefficients [-] that satisfy all constraints to rounding, from those of a solver that leaves 1e-10.

        Equalities are restored by least squares, bounds by the shortest step towards the law of maximum margin.
        """
        equal, equal_to, *_ = self.program
        unknowns = unknowns + np.linalg.lstsq(equal, equal_to - equal @ unknowns, rcond=None)[0]
        excess = self._largest_excess(unknowns)
        room = -self._largest_excess(self.max_margin_law) if excess > VIOLATION_TOLERANCE / 2 else 0.0
        return unknowns + excess / (excess + room) * (self.max_margin_law - unknowns) if room > 0 else unknowns

    def _cam_bounds(self, cam: CamLimits) -> list[Bound]:
        """Limits of the cam, each stated as the breadth that it requires."""
        bounds, radians = [], (self.duration + cam.dwell) / np.pi
        angles = {"cam breadth for the pressure angle": cam.pressure_angle}
        if self.pitch:
            angles["cam breadth for flanks that do not cross"] = self.pitch.crossing_angle
        for name, angle in angles.items():
            if angle is not None:
                slope = radians / np.tan(angle) * self._elevated_coefficients(1)
                place = self._elevated_coefficients(0)
                rows = 2 * np.concatenate([slope - place, slope + place])
                offset = np.repeat([self.stroke, -self.stroke], len(slope))
                bounds.append(Bound(name, "m", cam.breadth, rows, offset))
        if cam.radius_of_curvature is not None:
            second = self._elevated_coefficients(0) + radians**2 * self._elevated_coefficients(2)
            rows, radius = 2 * np.concatenate([-second, second]), 2 * cam.radius_of_curvature
            offset = radius + np.repeat([self.stroke, -self.stroke], len(second))
            bounds.append(Bound("cam breadth for the radius of curvature", "m", cam.breadth, rows, offset))
        return bounds

    def _elevated_coefficients(self, order):
        """Bernstein coefficients of a derivative, elevated to the degree of s so that they can be added."""
        rows = self.space.coefficients(order)
        for q in range(rows.shape[1] - 1, self.space.smoothness + 2):
            share = np.arange(1, q + 1)[:, None] / (q + 1)
            inner = share * rows[:, :-1] + (1 - share) * rows[:, 1:]
            rows = np.concatenate([rows[:, :1], inner, rows[:, -1:]], axis=1)
        return self.stroke / self.duration**order * rows.reshape(-1, self.space.size)

    @property
    def _relative_rows(self):
        """Rows of each bound over its limit."""
        return [bound.rows / bound.limit for bound in self.bounds]

    @property
    def _relative_values(self):
        """Values of each bound over its limit, less its offset."""
        return [1 - bound.offset / bound.limit for bound in self.bounds]

    @cached_property
    def _equal(self):
        """Rows and values: stroke, rest at the ends, continuity through the end condition, constant velocity."""
        space, limits = self.space, self.limits
        rows = []
        for order in range(1, limits.continuous + 1):
            first, last = (space.end(z, order) for z in (0, 1))
            zero = order == 1 or order in limits.at_rest or limits.end_condition == "dwell"
            rows += [first, last] if zero else [first + last]
        if limits.steady and limits.steady_tolerance == 0:
            rows += list(space.coefficients(2)[self._steady_pieces].reshape(-1, space.size))
        rows = np.array([space.end(1, 0)] + [row / np.abs(row).max() for row in rows if np.any(row)])
        return rows, np.append(1.0, np.zeros(len(rows) - 1))

    @cached_property
    def _hard(self):
        """Return rows and values that are never relaxed: velocity >= 0, and its tolerance at constant speed."""
        rows, tolerance = [-self.space.hull(1, HULL_HALVINGS)], self.limits.steady_tolerance
        if self.limits.steady and tolerance > 0:
            pieces = self._steady_pieces
            speed = self.space.coefficients(1)[pieces]
            place = self.space.coefficients(0)
            start, end = self.limits.steady
            mean = (place[pieces[-1], -1] - place[pieces[0], 0]) / (end - start)
            speed = np.unique(speed.reshape(-1, self.space.size), axis=0)
            rows += [speed - (1 + tolerance) * mean, (1 - tolerance) * mean - speed]
        rows = np.concatenate(rows)
        return rows, np.zeros(len(rows))

    @property
    def _steady_pieces(self):
        """Indices of the pieces in the phase of constant velocity."""
        start, end = self.limits.steady
        middle = (self.space.breaks[1:] + self.space.breaks[:-1]) / 2
        return np.flatnonzero((middle > start) & (middle < end))

    def _largest_excess(self, unknowns):
        """Largest relative excess over any bound; negative for a margin."""
        return max((bound.reached(unknowns) / bound.limit - 1 for bound in self.bounds), default=-np.inf)

    def _minimise_extended(self, costs, columns, signs=0):
        """Return law and additional variables of the smallest costs, given their columns of the inequalities."""
        (equal, equal_to), (hard, hard_to), size = self._equal, self._hard, self.space.size
        rows = np.concatenate([hard, np.zeros((signs, size)), *self._relative_rows])
        extended = LinearConstraints(
            np.column_stack([equal, np.zeros((len(equal), len(costs)))]),
            equal_to,
            np.column_stack([rows, columns]),
            np.concatenate([hard_to, np.zeros(signs), *self._relative_values]),
        )
        solution = minimise_linear(np.concatenate([np.zeros(size), costs]), extended)
        if solution is None:
            raise RuntimeError("no law exists on these pieces; raise `pieces` or lower `smoothness`")
        return solution

    def _relaxed_bounds(self, costs: Array) -> list[Conflict]:
        """Return the `Conflict` of each relaxed bound where the sum of costs times relative violations is smallest."""
        identity = np.eye(len(self.bounds))
        slacks = [np.zeros((len(self._hard[0]), len(identity))), -identity]
        slacks += [np.tile(-identity[i], (len(bound.rows), 1)) for i, bound in enumerate(self.bounds)]
        solution = self._minimise_extended(costs, np.concatenate(slacks), len(identity))
        pairs = zip(self.bounds, solution[self.space.size :], strict=True)
        return [
            Conflict(b.name, b.unit, b.limit, (1 + float(excess)) * b.limit)
            for b, excess in pairs
            if excess > VIOLATION_TOLERANCE
        ]


def spline_space_for(limits: Limits, pieces: int, halvings: int = 0) -> SplineSpace:
    """Return the `SplineSpace` for the smoothness and the phase of constant velocity of some limits.

    The pieces of acceleration and deceleration phases together are graded towards the ends of each phase; each piece is
    halved `halvings` times.
    """
    k, times = limits.continuous, 2**halvings
    if limits.steady is None:
        return SplineSpace(graded_breaks(0.0, 1.0, times * pieces, k), k)
    start, end = limits.steady
    first = min(max(2, round(pieces * limits.run_up / (limits.run_up + limits.run_down))), pieces - 2)
    inner = 1 if limits.steady_tolerance == 0 else STEADY_PIECES
    breaks = [
        graded_breaks(0.0, start, times * first, k)[:-1],
        np.linspace(start, end, inner + 1)[:-1],
        graded_breaks(end, 1.0, times * (pieces - first), k),
    ]
    return SplineSpace(np.concatenate(breaks), k)
