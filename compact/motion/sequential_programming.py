"""Optimal motion laws by sequential convex programming with a trust region.

    minimise  J = sum_j w_j J_j  of H = m a + R(v, a) and P = H v,  the largest over samples of R, or a quantile

The law is a spline (`spline_space`) within linear constraints (`constraint_set`); `objectives` provides the J_j and
their convex linearisations. Each step minimises the linearised criterion inside a trust region and is accepted only if
J itself decreases; otherwise the region shrinks. The curvature of a cam for a roller follower enters as an exact
penalty. Peaks between the nodes are added as nodes (exchange method).

The result states its `gap`: the relative decrease that the linearisations at the result allow *any* law within the
constraints. Where H is linear in v and a and no power is a criterion, J is convex, its linearisations bound it from
below, and the gap is a duality gap: no law of the space is better by more. Otherwise it measures stationarity.

References
----------
J. Nocedal and S. J. Wright, Numerical Optimization, Springer 2006, ch. 17-18 (exact penalty, trust region).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import PPoly

from compact.motion.constraint_set import ConstraintSet, spline_space_for
from compact.motion.limits import Conflict, InfeasibleError, Limits
from compact.motion.objectives import OBJECTIVES, PEAKS, Linearisation, QuadratureNodes, Resistance, evaluate_state
from compact.motion.pitch_curve import CURVATURE_MARGIN
from compact.numerics import Array
from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic

# Pieces of a law, by its smoothness [-]: the last doubling gains about 1e-3, 1e-4, 1e-4 of the criterion
PIECES_BY_SMOOTHNESS = {1: 128, 2: 64, 3: 48}
CAM_PIECES = 64  # [-], at most with a cam: its bounds on the travel are dense, each depends on all unknowns before it
PROFILE_PIECES = 48  # [-], at most with a limit on the profile, whose penalty takes more steps; doubling gains 1e-3
COARSEST_PIECES = 16  # [-], at least, of the first search; they are halved until the number is reached
LOBATTO_NODES = np.array([0.0, (1 - (3 / 7) ** 0.5) / 2, 0.5, (1 + (3 / 7) ** 0.5) / 2, 1.0])  # [-], of a piece
LOBATTO_WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180  # [-], their sum is 1
PEAK_SAMPLES = 33  # [-], of a piece: samples of the search for peaks between the nodes
PEAK_TOLERANCE = 1e-5  # [-], relative, by which a peak between the nodes may exceed those at the nodes
EXCHANGE_ROUNDS = 8  # [-], of adding such peaks to the nodes; 2 to 4 are usual
STEP_LIMIT = 60  # [-], convex subproblems on one set of pieces
GAP_TOLERANCE = 1e-6  # [-], largest optimality gap of a result
DECREASE_TOLERANCE = 1e-9  # [-], relative predicted decrease at which a search ends
FINE_DECREASE = 1e-14  # [-], the same where the gap, of the order of its square root, remains too large
RADIUS_TOLERANCE = 1e-9  # [-], of the largest unknown: smallest trust region
ACTIVE_TOLERANCE = 1e-6  # [-], relative to the worst sample, within which samples contribute their curvature
RESTORATION_TOLERANCE = 1e-4  # [-], relative increase of the radius below which the feasibility restoration ends
PENALTY_FACTORS = np.geomspace(10.0, 1e5, 5)  # [-], times J of the first law: price of a curvature ratio of 2
ACCEPTED, POOR, GOOD = 0.02, 0.25, 0.75  # [-], actual over predicted decrease: accept the step, shrink, enlarge region


@dataclass(frozen=True, eq=False)
class DriveCriterion:
    """Weighted sum of drive criteria over samples of the resistance.

    Attributes
    ----------
    weights : mapping of str to float
        Weight >= 0 of each criterion, by its name in `OBJECTIVES`.
    mass : float
        Mass of the cart [kg].
    resistances : tuple of callables
        Samples of R(v, a) [N].
    quantile : float
        Quantile over the samples [-]; 1 for the largest.
    minima : tuple of float
        Divisor of the criterion of each sample, in the unit of the criterion; empty for 1.
    """

    weights: Mapping[str, float]
    mass: float
    resistances: tuple[Resistance, ...]
    quantile: float = 1.0
    minima: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class OptimisationProblem:
    """Criterion and constraints of a law on one spline space.

    Attributes
    ----------
    criterion : DriveCriterion
        Criterion to minimise; without weights the largest curvature ratio of the pitch curve.
    extra_phases : tuple of float
        Phases t/T of peaks between the nodes, checked in addition to the nodes.
    penalty : float
        Weight of the violation of the curvature limit, in the unit of the criterion.
    """

    constraints: ConstraintSet
    criterion: DriveCriterion
    extra_phases: tuple[float, ...] = ()
    penalty: float = 1.0

    @cached_property
    def nodes(self) -> QuadratureNodes:
        """Lobatto nodes of every piece, and the extra phases with zero weight."""
        space = self.constraints.space
        weights = np.outer(np.diff(space.breaks), LOBATTO_WEIGHTS).ravel()
        extra = np.array(self.extra_phases)
        rows = (np.concatenate([space.values(k, LOBATTO_NODES), space.rows_at(k, extra)]) for k in range(3))
        return self._scaled_nodes(rows, np.append(weights, np.zeros(len(extra))))

    @cached_property
    def _fine_nodes(self):
        space = self.constraints.space
        rows = (space.values(k, np.linspace(0, 1, PEAK_SAMPLES)) for k in range(3))
        return self._scaled_nodes(rows, np.repeat(np.diff(space.breaks), PEAK_SAMPLES) / PEAK_SAMPLES)

    def _scaled_nodes(self, rows: Iterable[Array], weights: Array) -> QuadratureNodes:
        """Nodes in SI units from rows of s, s', s'' and weights over the phase."""
        stroke, duration = self.constraints.stroke, self.constraints.duration
        place, speed, change = rows
        mean = stroke / duration
        return QuadratureNodes(stroke * place, mean * speed, mean / duration * change, duration * weights, mean)

    def peaks_between_nodes(self, unknowns: Array) -> tuple[float, ...]:
        """Return the phases of peaks between the nodes that exceed all nodes, the largest of each piece.

        Each peak is that of the parabola through three samples.
        """
        phases, space = [], self.constraints.space
        quantities = (self._peak_quantities(nodes, unknowns) for nodes in (self._fine_nodes, self.nodes))
        for (fine, threshold), (coarse, _) in zip(*quantities, strict=True):
            values = fine.reshape(-1, PEAK_SAMPLES)
            left, top, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
            bend, tilt = 2 * top - left - right, right - left
            bend[(top < left) | (top < right) | (bend <= 0)] = np.inf
            tops = np.where(np.isfinite(bend), top + tilt**2 / (8 * bend), 0.0)
            pieces, i = np.arange(len(tops)), tops.argmax(axis=1)
            high = tops[pieces, i] > max(coarse.max(), threshold) * (1 + PEAK_TOLERANCE)
            u = (i + 1 + (tilt / (2 * bend))[pieces, i]) / (PEAK_SAMPLES - 1)
            phases += list((space.breaks[:-1] + np.diff(space.breaks) * u)[high])
        return tuple(phases)

    def _peak_quantities(self, nodes: QuadratureNodes, unknowns: Array) -> Iterator[tuple[Array, float]]:
        """(values of shape (nodes,), threshold below which a peak is irrelevant) of each quantity with a peak."""
        peaks = [PEAKS[name] for name in self.criterion.weights if name in PEAKS]
        for resistance in self.criterion.resistances if peaks else ():
            state = evaluate_state(nodes, unknowns, self.criterion.mass, resistance)
            yield from ((np.abs(peak(state)), 0.0) for peak in peaks)
        if self.constraints.pitch:
            yield from ((row, 1 - CURVATURE_MARGIN) for row in self.constraints.pitch.nodal_ratios(nodes, unknowns))

    def linearise(self, unknowns: Array) -> list[list[Linearisation]]:
        """Return the `Linearisation` of every criterion, a list for each sample of the resistance."""
        criterion = self.criterion
        states = [evaluate_state(self.nodes, unknowns, criterion.mass, one) for one in criterion.resistances]
        models = [[OBJECTIVES[name](state) for name in criterion.weights] for state in states]
        if pitch := self.constraints.pitch:
            linearise = pitch.linearise_violation if criterion.weights else pitch.linearise
            curvature = linearise(self.nodes, unknowns)
            models = [[*of_sample, curvature] for of_sample in models]
        return models

    def value(self, unknowns: Array) -> float:
        """Return the criterion J of a law."""
        return self.counted_samples(self.linearise(unknowns))[1]

    def weights_of(self, k: int) -> list[float]:
        """Return the weights of the linearisations of sample k, the penalty last."""
        divisor = self.criterion.minima[k] if self.criterion.minima else 1.0
        weights = [weight / divisor for weight in self.criterion.weights.values()]
        return [*weights, self.penalty] if self.constraints.pitch else weights

    def counted_samples(self, models: list[list[Linearisation]]) -> tuple[NDArray[np.intp], float]:
        """Return the samples within the quantile, in ascending order of J, and the J of the last of them."""
        weights = [self.weights_of(k) for k in range(len(models))]
        sums = [sum(w * m.value for w, m in zip(*pair, strict=True)) for pair in zip(weights, models, strict=True)]
        count = max(1, int(np.ceil(self.criterion.quantile * len(sums) - 1e-9)))
        order = np.argsort(sums, kind="stable")[:count]
        return order, sums[order[-1]]


class _Subproblem:
    """Linearised problem as a convex program: changes d, epigraph variable T to minimise, and auxiliary variables."""

    def __init__(self, problem, unknowns, models) -> None:
        self.size = len(unknowns)
        self.rows: list[Array] = []
        self.values: list[Sequence[float] | Array] = []
        self.entries: list[tuple[int, int, float]] = []
        self.height = 0
        self.width = self.size + 1
        counted, worst = problem.counted_samples(models)
        self.scale = abs(worst) or 1.0
        weights = {k: [weight / self.scale for weight in problem.weights_of(k)] for k in counted}
        for k in counted:
            tops = [self._add_epigraph(model, weight) for model, weight in zip(models[k], weights[k], strict=True)]
            entries = [(0, top, 1.0) for top in tops] + [(0, self.size, -1.0)]
            self._add_rows(np.zeros((1, self.size)), [0.0], entries)
        self.curvature = self._mean_curvature(models, counted, weights)
        self.program = self._program_with(problem.constraints.program, unknowns)

    def _add_rows(self, rows, values, entries):
        """Add rows d + entries of the other variables <= values."""
        self.rows.append(rows)
        self.values.append(values)
        self.entries += [(self.height + row, column, value) for row, column, value in entries]
        self.height += len(values)

    def _add_variables(self, count):
        self.width += count
        return range(self.width - count, self.width)

    def _add_epigraph(self, model, weight):
        """Add a variable that is at least a weighted linearisation; return its column."""
        (top,), count = self._add_variables(1), len(model.values)
        gradients, values = weight * model.gradients, -weight * model.values
        if model.shares is None:
            self._add_rows(gradients, values, [(i, top, -1.0) for i in range(count)])
            return top
        parts = self._add_variables(count)
        zeros = np.zeros((count, self.size))
        self._add_rows(gradients, values, [(i, part, -1.0) for i, part in enumerate(parts)])
        self._add_rows(zeros, np.zeros(count), [(i, part, -1.0) for i, part in enumerate(parts)])
        shared = [(0, part, share) for part, share in zip(parts, model.shares, strict=True)]
        self._add_rows(zeros[:1], [0.0], [*shared, (0, top, -1.0)])
        return top

    def _mean_curvature(self, models, counted, weights):
        """Mean weighted curvature of the samples within `ACTIVE_TOLERANCE` of the worst, or None."""
        active = [
            k
            for k in counted
            if sum(w * m.value for w, m in zip(weights[k], models[k], strict=True)) > 1 - ACTIVE_TOLERANCE
        ]
        curvatures = [
            weight * model.curvature / max(len(active), 1)
            for k in active
            for model, weight in zip(models[k], weights[k], strict=True)
            if model.curvature is not None
        ]
        return sum(curvatures) if curvatures else None

    def _program_with(self, constraints, unknowns):
        added = self.width - self.size
        entries = np.array(self.entries).T
        right = sparse.coo_array((entries[2], entries[:2].astype(int)), shape=(self.height, self.width))
        left = sparse.csr_array(np.concatenate(self.rows))
        left.resize((self.height, self.width))
        below = constraints.inequality_matrix.copy()
        below.resize((below.shape[0], self.width))
        room = constraints.inequality_bounds - constraints.inequality_matrix @ unknowns
        return LinearConstraints(
            np.column_stack([constraints.equality_matrix, np.zeros((len(constraints.equality_matrix), added))]),
            constraints.equality_values - constraints.equality_matrix @ unknowns,
            sparse.csr_array(sparse.vstack([below, left + right])),
            np.concatenate([room, *self.values]),
        )

    def solve(self, radius: float = np.inf, with_curvature: bool = True) -> tuple[Array, float]:
        """(change of the unknowns, each within the radius; criterion predicted after the change)."""
        cost = np.zeros(self.width)
        cost[self.size] = 1.0
        box = np.full(self.width, np.inf)
        box[: self.size] = radius
        if self.curvature is None or not with_curvature:
            solution = minimise_linear(cost, self.program, box)
            if solution is None:
                raise RuntimeError("the linear subproblem is infeasible although the present law satisfies its limits")
            return solution[: self.size], self.scale * solution[self.size]
        curvature = np.zeros((self.width, self.width))
        curvature[: self.size, : self.size] = self.curvature
        solution = minimise_quadratic(curvature, cost, self.program, box)
        change = solution[: self.size]
        return change, self.scale * (solution[self.size] + change @ self.curvature @ change / 2)


class OptimalLaw(NamedTuple):
    """Normalised optimal law and the record of its search.

    Attributes
    ----------
    curve : PPoly
        Law s(z), 0 <= z <= 1 [-].
    value : float
        Criterion; peaks between the nodes are exact to 3e-4, without steep ramps to 1e-5.
    gap : float
        Relative optimality gap [-].
    refinement : float
        Relative decrease by the last halving of the pieces [-], or nan.
    steps : int
        Number of convex subproblems accepted.
    """

    curve: PPoly
    value: float
    gap: float
    refinement: float
    steps: int


def trust_region_search(
    problem: OptimisationProblem, unknowns: Array, decrease: float = DECREASE_TOLERANCE
) -> tuple[Array, float, int]:
    """Minimise the criterion by sequential convex programming from coefficients [-] within the constraints.

    The search ends at a relative predicted decrease [-]. Returns the stationary law, its criterion and the number of
    accepted steps.
    """
    radius, models = np.inf, problem.linearise(unknowns)
    value = problem.counted_samples(models)[1]
    if value == 0:
        raise ValueError("the criterion is zero for every law; set a `mass` > 0 or a resistance that enters it")
    for steps in range(STEP_LIMIT):
        subproblem = _Subproblem(problem, unknowns, models)
        while True:
            change, predicted = subproblem.solve(radius)
            models = problem.linearise(unknowns + change)
            reached = problem.counted_samples(models)[1]
            if value - predicted <= decrease * abs(value) or radius < RADIUS_TOLERANCE * np.abs(unknowns).max():
                return (unknowns + change, reached, steps) if reached <= value else (unknowns, value, steps)
            ratio = (value - reached) / (value - predicted)
            longest = np.abs(change).max()
            if ratio < POOR:
                radius = longest / 4
            elif ratio > GOOD and longest > 0.99 * radius:
                radius *= 2
            if ratio > ACCEPTED:
                break
        unknowns, value = unknowns + change, reached
    raise RuntimeError(
        f"no stationary law after {STEP_LIMIT} steps: criterion {value:g}, predicted decrease {value - predicted:g}; "
        "use fewer `pieces` or wider limits"
    )


def optimality_gap(problem: OptimisationProblem, unknowns: Array) -> float:
    """Return the relative decrease that the linearisations allow any law within the constraints [-]."""
    models = problem.linearise(unknowns)
    value = problem.counted_samples(models)[1]
    _, predicted = _Subproblem(problem, unknowns, models).solve(with_curvature=False)
    return max(0.0, (value - predicted) / abs(value))


def find_optimal_law(
    limits: Limits, stroke: float, duration: float, criterion: DriveCriterion, pieces: int | None = None
) -> OptimalLaw:
    """Find the law that minimises a criterion for a stroke [m] and a duration [s], first on few pieces, then halved."""
    pieces = pieces or _default_pieces(limits)
    rounds = max(0, int(np.log2(pieces / COARSEST_PIECES)))
    previous, curve, steps = np.nan, None, 0
    for halvings in range(rounds + 1):
        space = spline_space_for(limits, pieces >> rounds, halvings)
        problem = OptimisationProblem(ConstraintSet(limits, space, stroke, duration), criterion)
        try:
            start = problem.constraints.min_acceleration_law if curve is None else space.interpolate(curve)
            start = _restore_feasibility(problem, start)
        except InfeasibleError:
            if halvings < rounds:
                continue  # smaller pieces may admit a law
            raise
        unknowns, value, taken, problem = _penalty_search(problem, start)
        curve, refinement, previous, steps = space.curve(unknowns), previous / value - 1, value, steps + taken
    for _ in range(EXCHANGE_ROUNDS):
        peaks = problem.peaks_between_nodes(unknowns)
        if not peaks:
            break
        problem = replace(problem, extra_phases=problem.extra_phases + peaks)
        unknowns, value, taken, problem = _penalty_search(problem, unknowns)
        steps += taken
    unknowns = problem.constraints.project(unknowns)
    gap = optimality_gap(problem, unknowns)
    if gap > GAP_TOLERANCE:
        unknowns, value, taken = trust_region_search(problem, unknowns, FINE_DECREASE)
        unknowns, steps = problem.constraints.project(unknowns), steps + taken
        gap = optimality_gap(problem, unknowns)
    if gap > GAP_TOLERANCE:
        raise RuntimeError(
            f"the search ended after {steps} steps without a stationary law: criterion {value:g}, optimality gap "
            f"{gap:.1e}, allowed {GAP_TOLERANCE:g}; use fewer `pieces` or wider limits"
        )
    return OptimalLaw(space.curve(unknowns), value, gap, refinement, steps)


def _default_pieces(limits):
    if limits.cam is None:
        return PIECES_BY_SMOOTHNESS[limits.continuous]
    of_cam = CAM_PIECES if limits.cam.profile_radius is None else PROFILE_PIECES
    return min(PIECES_BY_SMOOTHNESS[limits.continuous], of_cam)


def _restore_feasibility(problem: OptimisationProblem, unknowns: Array) -> Array:
    """Unknowns that satisfy the curvature limit too, by minimising the largest curvature ratio.

    Raises InfeasibleError, with the largest radius reached, if the search finds none.
    """
    pitch = problem.constraints.pitch
    if pitch is None or pitch.nodal_ratios(problem.nodes, unknowns).max() <= 1 - CURVATURE_MARGIN:
        return unknowns
    limit, reached = pitch.profile_radius, -np.inf
    problem = replace(problem, criterion=replace(problem.criterion, weights={}))
    for _ in range(EXCHANGE_ROUNDS):
        unknowns, *_ = trust_region_search(problem, unknowns)
        previous, reached = reached, pitch.reached_radius(problem.nodes, unknowns)
        if reached >= limit:
            return unknowns
        peaks = problem.peaks_between_nodes(unknowns)
        if reached <= 0 or (not peaks and abs(reached - previous) <= RESTORATION_TOLERANCE * reached):
            break
        # the radius reached balances convex and concave parts
        limits = problem.constraints.limits
        limits = replace(limits, cam=limits.cam and replace(limits.cam, profile_radius=reached))
        constraints = replace(problem.constraints, limits=limits)
        problem = replace(problem, extra_phases=problem.extra_phases + peaks, constraints=constraints)
    name = "smallest radius of curvature of the cam for the roller follower"
    raise InfeasibleError([Conflict(name, "m", limit, reached)], alone=True)


def _penalty_search(problem, unknowns):
    """(unknowns, J, steps, problem): search with the smallest penalty that leaves no violation of the curvature."""
    if problem.constraints.pitch is None:
        return *trust_region_search(problem, unknowns), problem
    value = replace(problem, penalty=0.0).value(unknowns)
    for factor in PENALTY_FACTORS:
        problem = replace(problem, penalty=factor * abs(value))
        result = trust_region_search(problem, unknowns)
        if problem.constraints.pitch.nodal_ratios(problem.nodes, result[0]).max() <= 1 - CURVATURE_MARGIN / 2:
            return *result, problem
    raise RuntimeError(
        f"the cam profile violates its limit of curvature at any penalty up to {problem.penalty:g}; "
        "increase the breadth of the cam or lower `profile_radius`"
    )
