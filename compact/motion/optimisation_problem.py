"""Optimal motion as a discrete problem: laws of a spline space, linear constraints, criteria and their linearisations.

Every derivative of a law is linear in the unknowns and bounded between the breaks:

    s^(k) is continuous and piecewise quadratic,  s in C^k,  0 <= z <= 1,  s(0) = 0, s'(0) = 0

The unknowns are the coefficients of s^(j), j = min(k, 2), as a B-spline of double knots, which are Bernstein
coefficients: of the velocity for k = 1, of the acceleration for k = 2 and 3. Adjacent pieces share the coefficient at
their break for k = 1 and 2; for k = 3 it divides the line between its neighbours in the ratio of the piece widths. A
polynomial lies between its smallest and its largest Bernstein coefficient; halving the piece tightens this hull.
Derivatives and cam limits are bounded by it, so that they hold at every instant, not at samples only. Unknowns in the
acceleration are well scaled: the forces are linear in them, jerk and snap quotients by h and h^2. Unknowns in the jerk
would enter the stroke by h^3, below the zero tolerance of linear programming solvers (`numerics.convex_programs`).

The criteria are of the drive force and the drive power,

    H = m a + R(v, a),    P = H v.

A `Linearisation` approximates a criterion near a law, convex in the change d of its unknowns: peaks and positive parts
are taken over the linearised H and P, and a smooth criterion keeps the positive semidefinite part of its curvature
(Gauss-Newton).

References
----------
C. de Boor, A Practical Guide to Splines, ch. IX; G. Farin, Curves and Surfaces for CAGD, ch. 5 (de Casteljau).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.interpolate import BPoly, PPoly

from compact.motion.limits import BOUNDED_DERIVATIVES, VIOLATION_TOLERANCE, Conflict, InfeasibleError, Limits
from compact.numerics import Array
from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic

Resistance = Callable[[Array, Array], Array]  # R(v [m/s], a [m/s^2]) -> [N]

HULL_HALVINGS = 2  # [-], of the pieces of a bound: the Bernstein hull of a parabola is then within 1/16 of its sagitta
FIXED_BOUND_COST = 1e3  # [-], of a bound that is not to be relaxed, over 1 of the relaxed bound
STEADY_PIECES = 16  # [-], of the phase of constant velocity where the velocity may deviate
VELOCITY_FLOOR = 1e-12  # [-], of the mean velocity: the resistance at rest is its limit from inside the motion
DIFFERENCE_STEP = 1e-4  # [-], of the mean velocity, and of that over the duration: step of difference quotients


# ---- laws ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Laws in C^k whose derivative k + 1 is linear inside each piece and may jump at the breaks.

    Attributes
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Phases between the pieces, ascending from 0 to 1 [-].
    smoothness : int
        Order k, from 1 to 3.
    """

    breaks: Array
    smoothness: int

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 2 * len(self.breaks) - 1 + (self.smoothness == 3)

    @cached_property
    def derivatives(self) -> list[BPoly]:
        """Derivatives s, s', ... of order 0 to k + 2 of the law of each unknown, in Bernstein form."""
        unit, count = np.eye(self.size), len(self.breaks) - 1
        if self.smoothness < 3:
            pieces = unit[2 * np.arange(count) + np.arange(3)[:, None]]
        else:
            inner, width = unit[1:-1].reshape(count, 2, -1), np.diff(self.breaks)[:, None]
            shared = (width[1:] * inner[:-1, 1] + width[:-1] * inner[1:, 0]) / (width[1:] + width[:-1])
            ends = np.concatenate([unit[:1], shared, unit[-1:]])
            pieces = np.array([ends[:-1], *inner.swapaxes(0, 1), ends[1:]])
        basis, orders = BPoly(pieces, self.breaks), range(self.smoothness + 3)
        return [basis.derivative(order - min(self.smoothness, 2)) for order in orders]  # of a negative order: integral

    def coefficients(self, order: int) -> Array:
        """Return the Bernstein coefficients of s^(order) of each piece, shape (pieces, degree + 1, unknowns)."""
        return np.asarray(self.derivatives[order].c, float).swapaxes(0, 1)

    def values(self, order: int, u: ArrayLike) -> Array:
        """Return the rows of s^(order) at local coordinates u [-] of every piece, (pieces * places, unknowns)."""
        rows = self.coefficients(order)
        return np.asarray(bernstein_basis(rows.shape[1] - 1, u) @ rows).reshape(-1, self.size)

    def hull(self, order: int) -> Array:
        """Return the Bernstein coefficients that bound s^(order) on halved pieces, shape (rows, unknowns)."""
        rows = self.coefficients(order)
        rows = halve(rows, HULL_HALVINGS if rows.shape[1] > 2 else 0).reshape(-1, self.size)
        return rows[np.sort(np.unique(rows, axis=0, return_index=True)[1])]

    def elevated(self, order: int) -> Array:
        """Return the Bernstein coefficients of s^(order) elevated to the degree of s, shape (rows, unknowns)."""
        rows = self.coefficients(order)
        m, d = rows.shape[1] - 1, self.smoothness + 2
        raised = [
            [comb(m, j) * comb(d - m, max(i - j, 0)) / comb(d, i) * (i >= j) for j in range(m + 1)]
            for i in range(d + 1)
        ]
        return np.asarray(np.array(raised) @ rows).reshape(-1, self.size)

    def curve(self, unknowns: Array) -> PPoly:
        """Return the law; its Taylor coefficients are those of each derivative, without rounded differences."""
        orders = range(self.smoothness + 2, -1, -1)
        return PPoly([self.coefficients(k)[:, 0] @ unknowns / factorial(k) for k in orders], self.breaks)


def bernstein_basis(degree: int, u: ArrayLike) -> Array:
    """Return the Bernstein polynomials of a degree at coordinates u from 0 to 1 [-], shape (places, degree + 1)."""
    u, i = np.asarray(u, float)[:, None], np.arange(degree + 1)
    return np.array([comb(degree, k) for k in i]) * u**i * (1 - u) ** (degree - i)


def halve(rows: Array, times: int) -> Array:
    """Return Bernstein coefficients, shape (pieces, degree + 1, unknowns), of halved pieces (de Casteljau)."""
    m = rows.shape[1]
    left = np.array([[comb(i, j) / 2**i for j in range(m)] for i in range(m)])
    for _ in range(times):
        rows = np.concatenate([left @ rows, left[::-1, ::-1] @ rows])
    return rows


def graded_breaks(start: float, end: float, count: int, smoothness: int) -> Array:
    """Return count + 1 breaks [-] graded towards both ends, where the jerk is largest.

    z = u^3 (10 - 15 u + 6 u^2)   for k = 1, whose acceleration may jump: the first piece is 10/count^3 of the whole
    z = u^2 (3 - 2 u)             for k = 2 and 3,   u = i/count
    """
    u = np.linspace(0, 1, count + 1)
    z = u**3 * (10 + u * (6 * u - 15)) if smoothness == 1 else u**2 * (3 - 2 * u)
    return start + (end - start) * z


def spline_space_for(limits: Limits, pieces: int) -> SplineSpace:
    """Return the `SplineSpace` for the smoothness and the phase of constant velocity of some limits.

    The pieces of acceleration and deceleration phases together are graded towards the ends of each phase.
    """
    k = limits.continuous
    if limits.steady is None:
        return SplineSpace(graded_breaks(0.0, 1.0, pieces, k), k)
    start, end = limits.steady
    first = min(max(2, round(pieces * limits.run_up / (limits.run_up + limits.run_down))), pieces - 2)
    inner = 1 if limits.steady_tolerance == 0 else STEADY_PIECES
    breaks = [
        graded_breaks(0.0, start, first, k)[:-1],
        np.linspace(start, end, inner + 1)[:-1],
        graded_breaks(end, 1.0, pieces - first, k),
    ]
    return SplineSpace(np.concatenate(breaks), k)


# ---- constraints -----------------------------------------------------------------------------------------------------


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


@dataclass(frozen=True, eq=False)
class ConstraintSet:
    """Limits on the laws of a spline space, as `LinearConstraints` in its unknowns.

    Infeasible limits are reported one by one with the relaxation that each requires, from a linear program with elastic
    bounds (phase-one relaxation).

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
        """All elastic constraints: those of the derivatives, then those of the cam, stated as its breadth."""
        bounds = []
        for name, (order, unit) in BOUNDED_DERIVATIVES.items():
            if (limit := getattr(self.limits, name)) is not None:
                rows = self.stroke / self.duration**order * self.space.hull(order)
                rows = rows if order == 1 else np.concatenate([rows, -rows])
                bounds.append(Bound(name, unit, limit, rows, np.zeros(len(rows))))
        if cam := self.limits.cam:
            place, slope, second = (  # derivatives by the cam angle
                self.stroke * (1 + cam.dwell / self.duration) ** k / np.pi**k * self.space.elevated(k) for k in range(3)
            )
            needs = []
            if cam.pressure_angle is not None:
                needs.append(("the pressure angle", np.tile(slope / np.tan(cam.pressure_angle), (2, 1)), 0.0))
            if (radius := cam.radius_of_curvature) is not None:
                needs.append(("the radius of curvature", np.concatenate([-second, second]), 2 * radius))
            sides, ends = np.concatenate([-place, place]), np.repeat([self.stroke, -self.stroke], len(place))
            for words, rows, least in needs:
                bounds.append(Bound(f"cam breadth for {words}", "m", cam.breadth, 2 * (rows + sides), least + ends))
        return bounds

    @cached_property
    def program(self) -> LinearConstraints:
        """The `LinearConstraints` of all limits; each bound is divided by its limit."""
        below = sparse.csr_array(np.concatenate([self._hard, *(bound.rows / bound.limit for bound in self.bounds)]))
        most = np.concatenate([np.zeros(len(self._hard)), *(1 - bound.offset / bound.limit for bound in self.bounds)])
        return LinearConstraints(*self._equal, below, most)

    @cached_property
    def _equal(self) -> tuple[Array, Array]:
        """Rows and values: stroke, rest at the ends, continuity through the end condition, constant velocity."""
        space, limits, rows = self.space, self.limits, []
        for order in range(1, limits.continuous + 1):
            first, last = space.coefficients(order)[[0, -1], [0, -1]]
            rows += [first, last] if order == 1 or limits.end_condition == "dwell" else [first + last]
        if limits.steady and limits.steady_tolerance == 0:
            rows += list(space.coefficients(2)[self._steady_pieces].reshape(-1, space.size))
        rows = [space.coefficients(0)[-1, -1], *(row / np.abs(row).max() for row in rows if np.any(row))]
        return np.array(rows), np.append(1.0, np.zeros(len(rows) - 1))

    @cached_property
    def _hard(self) -> Array:
        """Rows that are never relaxed and never positive: reversed velocity, and its excess at constant speed."""
        space, tolerance, rows = self.space, self.limits.steady_tolerance, [-self.space.hull(1)]
        if self.limits.steady and tolerance > 0:
            pieces, place, (start, end) = self._steady_pieces, space.coefficients(0), self.limits.steady
            mean = (place[pieces[-1], -1] - place[pieces[0], 0]) / (end - start)
            speed = np.unique(space.coefficients(1)[pieces].reshape(-1, space.size), axis=0)
            rows += [speed - (1 + tolerance) * mean, (1 - tolerance) * mean - speed]
        return np.concatenate(rows)

    @property
    def _steady_pieces(self):
        """Indices of the pieces in the phase of constant velocity."""
        (start, end), middle = self.limits.steady, (self.space.breaks[1:] + self.space.breaks[:-1]) / 2
        return np.flatnonzero((middle > start) & (middle < end))

    @cached_property
    def min_acceleration_law(self) -> Array:
        """Unknowns of the law with the smallest rms acceleration, the start of a search."""
        everyone = np.arange(len(self.bounds))
        if together := self._conflicts(np.ones(len(everyone))):
            alone = [self._conflicts(np.where(everyone == i, 1.0, FIXED_BOUND_COST)) for i in everyone]
            single = [found[0] for i, found in enumerate(alone) if [c.name for c in found] == [self.bounds[i].name]]
            raise InfeasibleError(single or together, alone=bool(single))
        u, weights = np.polynomial.legendre.leggauss(self.space.smoothness + 1)
        weights = np.outer(np.diff(self.space.breaks), weights / 2).ravel()
        rows = self.space.values(2, (u + 1) / 2) * np.sqrt(weights)[:, None]
        return minimise_quadratic(rows.T @ rows, np.zeros(self.space.size), self.program)

    def _conflicts(self, costs: Array) -> list[Conflict]:
        """Return the `Conflict` of each relaxed bound where the sum of costs times relative violations is smallest."""
        excess = self._relax(costs, list(range(len(costs))), 0.0)[self.space.size :].tolist()
        relaxed = ((b, each) for b, each in zip(self.bounds, excess, strict=True) if each > VIOLATION_TOLERANCE)
        return [Conflict(b.name, b.unit, b.limit, (1 + each) * b.limit) for b, each in relaxed]

    def _relax(self, costs: Array, excess_of: list[int], least: float) -> Array:
        """Return a law and its relative excesses >= least of the smallest costs, and which of them each bound has."""
        program, size, count = self.program, self.space.size, len(costs)
        unit = np.concatenate([np.zeros((1, count)), np.eye(count)])  # the hard rows have no excess
        rows = np.repeat([0, *(1 + i for i in excess_of)], [len(self._hard), *(len(b.rows) for b in self.bounds)])
        extended = program._replace(
            equality_matrix=np.pad(program.equality_matrix, ((0, 0), (0, count))),
            inequality_matrix=sparse.hstack([program.inequality_matrix, -unit[rows]], format="csr"),
        )
        low = np.repeat([-np.inf, least], [size, count])
        solution = minimise_linear(np.append(np.zeros(size), costs), extended, low)
        if solution is None:
            raise RuntimeError("no law exists on these pieces; raise `pieces` or lower `smoothness`")
        return solution

    def project(self, unknowns: Array) -> Array:
        """Return coefficients [-] that satisfy all constraints to rounding, from those of a solver that leaves 1e-10.

        Equalities are restored by least squares, bounds by the shortest step towards the law of maximum margin, whose
        relative distance from the nearest bound is largest.
        """
        equal, equal_to, below, below_to = self.program

        def excess(law: Array) -> float:
            return float(np.max((below @ law - below_to)[len(self._hard) :], initial=-np.inf))

        unknowns = unknowns + np.linalg.lstsq(equal, equal_to - equal @ unknowns, rcond=None)[0]
        if (over := excess(unknowns)) <= VIOLATION_TOLERANCE / 2:
            return unknowns
        inside = self._relax(np.ones(1), [0] * len(self.bounds), -np.inf)[: self.space.size]
        room = -excess(inside)
        return unknowns + over / (over + room) * (inside - unknowns) if room > 0 else unknowns


# ---- criteria --------------------------------------------------------------------------------------------------------


class QuadratureNodes(NamedTuple):
    """Nodes at which a law is evaluated: v and a are linear in the unknowns.

    Attributes
    ----------
    velocity, acceleration : ndarray, shape (nodes, unknowns)
        Matrices that give v [m/s] and a [m/s^2] from the unknowns.
    weights : ndarray, shape (nodes,)
        Quadrature weights over one pass [s]; 0 for a node that is only checked for peaks.
    mean_velocity : float
        Stroke over duration [m/s].
    """

    velocity: Array
    acceleration: Array
    weights: Array
    mean_velocity: float


class MotionState(NamedTuple):
    """Motion and drive force at the nodes for one resistance; arrays of shape (nodes,).

    Attributes
    ----------
    velocity : ndarray
        v [m/s], at least the velocity floor.
    resistance, force : ndarray
        R and H [N].
    damping : ndarray
        dR/dv [N s/m].
    force_gradient : ndarray, shape (nodes, unknowns)
        dH/d(unknowns) = dR/dv dv + (m + dR/da) da.
    """

    nodes: QuadratureNodes
    velocity: Array
    resistance: Array
    force: Array
    damping: Array
    force_gradient: Array

    @property
    def power(self) -> Array:
        """Drive power H v [W]."""
        return self.force * self.velocity

    def power_gradient(self) -> Array:
        """Return d(H v)/d(unknowns), shape (nodes, unknowns)."""
        return self.velocity[:, None] * self.force_gradient + self.force[:, None] * self.nodes.velocity


def evaluate_state(nodes: QuadratureNodes, unknowns: Array, mass: float, resistance: Resistance) -> MotionState:
    """Evaluate motion and drive force of a law with coefficients [-] for a mass [kg] and R(v, a) [N].

    Derivatives of the resistance are difference quotients.
    """
    v, a = np.maximum(nodes.velocity @ unknowns, VELOCITY_FLOOR * nodes.mean_velocity), nodes.acceleration @ unknowns
    step = DIFFERENCE_STEP * nodes.mean_velocity
    shift = step / nodes.weights.sum()
    other = np.where(v > 2 * step, v - step, v + step)  # a lower velocity where there is one: R may end at the largest
    here, at_other, at_shift = (
        np.broadcast_to(resistance(*at), v.shape) for at in ((v, a), (other, a), (v, a + shift))
    )
    damping, inertia = (at_other - here) / (other - v), mass + (at_shift - here) / shift
    gradient = damping[:, None] * nodes.velocity + inertia[:, None] * nodes.acceleration
    return MotionState(nodes, v, here, mass * a + here, damping, gradient)


class Linearisation(NamedTuple):
    """Convex model of a criterion near a law: max(values + gradients d) + d' curvature d / 2.

    With `shares` the model is the sum of shares max(values + gradients d, 0) instead.

    Attributes
    ----------
    values : ndarray, shape (rows,)
        Values at d = 0, in the unit of the criterion.
    gradients : ndarray, shape (rows, unknowns)
        Derivatives by the unknowns.
    curvature : ndarray, shape (unknowns, unknowns), optional
        Positive semidefinite Hessian.
    shares : ndarray, shape (rows,), optional
        Weights of a sum of positive parts.
    """

    values: Array
    gradients: Array
    curvature: Array | None = None
    shares: Array | None = None

    @property
    def value(self) -> float:
        """The criterion at d = 0."""
        return float(np.max(self.values) if self.shares is None else self.shares @ np.maximum(self.values, 0.0))

    def times(self, weight: float) -> "Linearisation":
        """Return the model of the criterion times a weight."""
        curvature = None if self.curvature is None else weight * self.curvature
        return Linearisation(weight * self.values, weight * self.gradients, curvature, self.shares)

    def epigraph(self) -> tuple[Any, Array, Array]:
        """Return the columns of the variables that are at least the rows, their shares of J, and their least values."""
        if self.shares is None:
            return np.ones((len(self.values), 1)), np.ones(1), np.array([-np.inf])
        return sparse.eye_array(len(self.values)), self.shares, np.zeros(len(self.values))


def _magnitude(values: Array, gradients: Array) -> Linearisation:
    return Linearisation(np.concatenate([values, -values]), np.concatenate([gradients, -gradients]))


def _rms_force(state: MotionState) -> Linearisation:
    """(1/T int H^2 dt)^(1/2), a norm: its Hessian is that of the squares less the part along the gradient."""
    root = np.sqrt(state.nodes.weights / state.nodes.weights.sum())
    rows, force = root[:, None] * state.force_gradient, root * state.force
    rms = max(np.sqrt(force @ force), np.finfo(float).tiny)
    gradient = force @ rows / rms
    across = rows - np.outer(force / rms, gradient)  # its square is the Hessian, semidefinite to rounding
    return Linearisation(np.array([rms]), gradient[None], across.T @ across / rms)


def _energy(state: MotionState) -> Linearisation:
    """2 int R v dt over both strokes. Its curvature in v, 2 dR/dv + v R'', is replaced by 2 dR/dv >= 0."""
    velocity, weights = state.nodes.velocity, 2 * state.nodes.weights
    curvature = weights * np.maximum(2 * state.damping, 0.0)
    work = np.array([weights @ (state.resistance * state.velocity)])  # the work of inertia over a pass is zero
    return Linearisation(work, (weights @ state.power_gradient())[None], (velocity.T * curvature) @ velocity)


# Quantity whose largest magnitude is the criterion, and its gradients, by name of the criterion
PEAKS: Mapping[str, Callable[[MotionState], tuple[Array, Array]]] = MappingProxyType(
    {
        "peak_force": lambda state: (state.force, state.force_gradient),
        "peak_power": lambda state: (state.power, state.power_gradient()),
    }
)
# Linearisation of each criterion, by the names of `ranking.CRITERIA`
OBJECTIVES: Mapping[str, Callable[[MotionState], Linearisation]] = MappingProxyType(
    {name: lambda state, peak=peak: _magnitude(*peak(state)) for name, peak in PEAKS.items()}
    | {
        "rms_force": _rms_force,
        "energy": _energy,
        # 2 int max(H v, 0) dt over both strokes: work of a drive that recovers none
        "drawn_energy": lambda state: Linearisation(state.power, state.power_gradient(), None, 2 * state.nodes.weights),
    }
)
