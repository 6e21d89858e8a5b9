"""Optimal motion of a cart: the motion law that minimises a drive criterion, by sequential convex programming.

    minimise  J = sum_j w_j J_j  of H = m a + R(v, a) and P = H v,  the largest over samples of R

The law is a spline within linear constraints; `optimisation_problem` provides both, the J_j and their convex
linearisations. Each step minimises the linearised criterion inside a trust region and is accepted only if J itself
decreases; otherwise the region shrinks. Peaks between the nodes are added as nodes (exchange method).

The result states its `gap`: the relative decrease that the linearisations at the result allow *any* law within the
constraints. Where H is linear in v and a and no power is a criterion, J is convex, its linearisations bound it from
below, and the gap is a duality gap: no law of the space is better by more. Otherwise it measures stationarity.

References
----------
J. Nocedal and S. J. Wright, Numerical Optimization, Springer 2006, ch. 18 (trust region).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import ClassVar

import numpy as np
from scipy import sparse

from compact.motion.limits import Limits
from compact.motion.optimisation_problem import (
    OBJECTIVES,
    PEAKS,
    ConstraintSet,
    Linearisation,
    QuadratureNodes,
    Resistance,
    evaluate_state,
    spline_space_for,
)
from compact.motion.profile import LARGEST, SMALLEST, MotionProfile
from compact.numerics import Array, validation
from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic

PROGRAM_TOLERANCE = 1e-6  # [-], of the largest value of a derivative: a smaller jump is left by the convex programs
PIECES_LIMIT = 1024  # [-], of an optimal law, whose dense programs take 0.1 GB; more lower no criterion measurably
# Pieces of a law, by its smoothness [-]: the last doubling gains about 1e-3, 1e-4, 1e-4 of the criterion
PIECES_BY_SMOOTHNESS = {1: 128, 2: 64, 3: 48}
CAM_PIECES = 64  # [-], at most with a cam: its bounds on the travel are dense, each depends on all unknowns before it
LOBATTO_NODES = np.array([0.0, (1 - (3 / 7) ** 0.5) / 2, 0.5, (1 + (3 / 7) ** 0.5) / 2, 1.0])  # [-], of a piece
LOBATTO_WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180  # [-], their sum is 1
PEAK_SAMPLES = 33  # [-], of a piece: samples of the search for peaks between the nodes
PEAK_TOLERANCE = 1e-5  # [-], relative, by which a peak between the nodes may exceed those at the nodes
EXCHANGE_ROUNDS = 8  # [-], of adding such peaks to the nodes; 2 to 4 are usual
STEP_LIMIT = 300  # [-], convex subproblems of one search
GAP_TOLERANCE = 1e-6  # [-], largest optimality gap of a result
DECREASE_TOLERANCE = 1e-9  # [-], relative predicted decrease at which a search ends
FINE_DECREASE = 1e-14  # [-], the same where the gap, of the order of its square root, remains too large
VALUE_ROUNDING = 1e-13  # [-], of the criterion: within it the last step is taken, which corrects noise of the law
RADIUS_TOLERANCE = 1e-9  # [-], of the largest unknown: smallest trust region
ACTIVE_TOLERANCE = 1e-6  # [-], relative to the worst sample, within which samples contribute their curvature
ACCEPTED, POOR, GOOD = 0.02, 0.25, 0.75  # [-], actual over predicted decrease: accept the step, shrink, enlarge region


@dataclass(frozen=True)
class OptimalMotion(MotionProfile):
    """A `MotionProfile` found by `optimise`, and the record of the search.

    Attributes
    ----------
    value : float
        Minimum of the criterion over forward and return stroke without dwells, in the unit of the criterion; peaks
        between the nodes are exact to 3e-4, without steep ramps to 1e-5.
    gap : float
        Relative optimality gap [-], see `optimality_gap`.
    steps : int
        Number of convex subproblems accepted.
    """

    value: float = np.nan
    gap: float = np.nan
    steps: int = 0
    jump_tolerance: ClassVar[float] = PROGRAM_TOLERANCE


def optimise(
    objective: str | Mapping[str, float],
    stroke: float,
    duration: float,
    mass: float,
    resistance: Resistance | Sequence[Resistance],
    limits: Limits | None = None,
    *,
    regret: bool = False,
    pieces: int | None = None,
) -> OptimalMotion:
    """Find the motion law that minimises a drive criterion of a cart over forward and return stroke.

    Parameters
    ----------
    objective : str or mapping of str to float
        Name in `OBJECTIVES`: "peak_force" [N], "peak_power" [W], "rms_force" [N], "energy" (net work) [J],
        "drawn_energy" (work where P > 0) [J]; or the weights >= 0 of a weighted sum by name.
    stroke : float
        Travel of one pass [m], > 0.
    duration : float
        Time of one pass [s], > 0.
    mass : float
        Mass of the cart [kg], >= 0.
    resistance : callable or sequence of callables
        R(velocity [m/s], acceleration [m/s^2]) -> [N] of the forward stroke, velocity > 0, for arrays of any shape; the
        return stroke is its mirror image. It may include guide friction. For several resistances, the criterion is
        the largest value over them.
    limits : Limits, optional
        Constraints at every instant; without them the velocity is nonnegative.
    regret : bool
        Divide the criterion of each resistance by its minimum for that resistance alone (minimax regret).
    pieces : int, optional
        Number of polynomial pieces of the acceleration and deceleration phases.

    Returns
    -------
    OptimalMotion
        One of the minimisers where there are several; a small weight of "rms_force" selects the smoothest.

    Raises
    ------
    InfeasibleError
        If no law satisfies the limits; the error states which limits to relax, and by how much.
    RuntimeError
        If the search does not converge.

    Examples
    --------
    >>> def none(velocity, acceleration): return 0 * velocity
    >>> m = optimise("peak_force", stroke=0.4, duration=3.0, mass=1000.0, resistance=none)
    >>> f"{m.value:.3f} N = 4 m stroke/duration^2, gap below 1e-9: {m.gap < 1e-9}"
    '177.778 N = 4 m stroke/duration^2, gap below 1e-9: True'
    """
    validation.require_instance((str, Mapping), "the name of an objective, or weights by name", objective=objective)
    weights = {objective: 1.0} if isinstance(objective, str) else dict(objective)
    for name in weights:
        validation.require_known("objective", name, tuple(OBJECTIVES))
    validation.require_number(stroke=stroke, duration=duration, mass=mass)
    validation.require_positive(stroke=stroke, duration=duration)
    validation.require_between(SMALLEST, LARGEST, stroke=stroke, duration=duration)
    validation.require_nonnegative(mass=mass, weights=list(weights.values()))
    if not any(weights.values()):
        raise ValueError(f"`objective` must have at least one weight > 0, got {objective!r}; raise a weight")
    limits = limits or Limits()
    if pieces is None:
        most = CAM_PIECES if limits.cam else PIECES_LIMIT
        pieces = min(PIECES_BY_SMOOTHNESS[limits.continuous], most)
    validation.require_integers(pieces=pieces)
    validation.require_between(1, PIECES_LIMIT, pieces=pieces)
    resistances = (resistance,) if callable(resistance) else tuple(resistance)
    for one in resistances:
        validation.require_opposing(one, stroke / duration, directions=(1.0,))
    laws = ConstraintSet(limits, spline_space_for(limits, pieces), float(stroke), float(duration))
    problem = OptimisationProblem(laws, weights, float(mass), resistances)
    if regret:
        alone = (_find_optimal_law(replace(problem, resistances=(one,))) for one in resistances)
        problem = replace(problem, minima=tuple(law.value for law in alone))
    return _find_optimal_law(problem)


def optimal_law_name(objectives: Iterable[str]) -> str:
    """Return the name of the optimal law for the names of its objectives, such as "least-peak-force"."""
    name = "-and-".join(objectives).replace("_", "-")
    return name if name.startswith("robust-") else f"least-{name}"


Models = list[list[Linearisation]]  # weighted, of every criterion for each sample of the resistance


@dataclass(frozen=True, eq=False)
class OptimisationProblem:
    """A criterion over the laws of a spline space within constraints.

    The criterion is a weighted sum of drive criteria, the largest over samples of the resistance.

    Attributes
    ----------
    weights : mapping of str to float
        Weight >= 0 of each criterion, by its name in `OBJECTIVES`.
    mass : float
        Mass of the cart [kg].
    resistances : tuple of callables
        Samples of R(v, a) [N].
    minima : tuple of float
        Divisor of the criterion of each sample, in the unit of the criterion; empty for 1.
    extra_phases : tuple of float
        Phases [-] that are nodes in addition to those of every piece.
    """

    constraints: ConstraintSet
    weights: Mapping[str, float]
    mass: float
    resistances: tuple[Resistance, ...]
    minima: tuple[float, ...] = ()
    extra_phases: tuple[float, ...] = ()

    @cached_property
    def nodes(self) -> QuadratureNodes:
        """Lobatto nodes of every piece, and the extra phases with zero weight."""
        return self._nodes_at(LOBATTO_NODES, LOBATTO_WEIGHTS, self.extra_phases)

    def _nodes_at(self, u: Array, weights: Array, extra: Sequence[float] = ()) -> QuadratureNodes:
        """Nodes at local coordinates of every piece, with their shares of its width as weights, and at extra phases."""
        space, stroke, duration = self.constraints.space, self.constraints.stroke, self.constraints.duration
        speed, change = (
            stroke / duration**k * np.concatenate([space.values(k, u), space.derivatives[k](np.array(extra))])
            for k in (1, 2)
        )
        weights = np.append(np.outer(np.diff(space.breaks), weights), np.zeros(len(extra)))
        return QuadratureNodes(speed, change, duration * weights, stroke / duration)

    def peaks_between_nodes(self, unknowns: Array) -> tuple[float, ...]:
        """Return the phases of peaks between the nodes that exceed all nodes, the largest of each piece.

        Each peak is that of the parabola through three samples.
        """
        phases, breaks = [], self.constraints.space.breaks
        fine_nodes = self._nodes_at(np.linspace(0, 1, PEAK_SAMPLES), np.full(PEAK_SAMPLES, 1 / PEAK_SAMPLES))
        peaks = [PEAKS[name] for name in self.weights if name in PEAKS]
        for resistance, peak in product(self.resistances, peaks):
            fine, coarse = (
                np.abs(peak(evaluate_state(nodes, unknowns, self.mass, resistance))[0])
                for nodes in (fine_nodes, self.nodes)
            )
            values = fine.reshape(-1, PEAK_SAMPLES)
            left, top, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
            bend, tilt = 2 * top - left - right, right - left
            bend[(top < left) | (top < right) | (bend <= 0)] = np.inf
            tops = np.where(np.isfinite(bend), top + tilt**2 / (8 * bend), 0.0)
            highest = np.arange(len(tops)), tops.argmax(axis=1)
            high = tops[highest] > coarse.max() * (1 + PEAK_TOLERANCE)
            u = (highest[1] + 1 + (tilt / (2 * bend))[highest]) / (PEAK_SAMPLES - 1)
            phases += list((breaks[:-1] + np.diff(breaks) * u)[high])
        return tuple(phases)

    def linearise(self, unknowns: Array) -> Models:
        """Return the weighted `Linearisation` of every criterion, a list for each sample of the resistance."""
        models = []
        for resistance, least in zip(self.resistances, self.minima or (1.0,) * len(self.resistances), strict=True):
            state = evaluate_state(self.nodes, unknowns, self.mass, resistance)
            models.append([OBJECTIVES[name](state).times(w / least) for name, w in self.weights.items()])
        return models


def _sums(models: Models) -> Array:
    """J of each sample, shape (samples,)."""
    return np.array([sum(model.value for model in of_sample) for of_sample in models])


def _largest(models: Models) -> float:
    """J of the worst sample."""
    return float(_sums(models).max())


def solve_linearised(
    problem: OptimisationProblem, unknowns: Array, models: Models, radius: float = np.inf, with_curvature: bool = True
) -> tuple[Array, float]:
    """Minimise linearisations at a law: change d of its unknowns, each within the radius, and J predicted after it.

        minimise T + d' C d / 2    subject to    sum_j t_kj <= T for each sample k,  A d = b,  G d <= h

    t_kj is at least the weighted linearisation j of the sample, or the shares of its positive parts, which are further
    variables >= 0; C is the mean weighted curvature of the samples within `ACTIVE_TOLERANCE` of the worst.
    """
    sums, size = _sums(models), len(unknowns)
    scale = abs(float(sums.max())) or 1.0
    scaled = [[model.times(1 / scale) for model in of_sample] for of_sample in models]
    every = [model for of_sample in scaled for model in of_sample]
    active = np.flatnonzero(sums / scale > 1 - ACTIVE_TOLERANCE)
    curved = [model.curvature for k in active for model in scaled[k] if model.curvature is not None]
    parts, _, lowest = zip(*(model.epigraph() for model in every), strict=True)
    shares = [np.concatenate([model.epigraph()[1] for model in of_sample])[None] for of_sample in scaled]
    equal, equal_to, below, below_to = problem.constraints.program
    rows = [
        [below, None, None],
        [np.concatenate([model.gradients for model in every]), None, -sparse.block_diag(parts)],
        [None, -np.ones((len(models), 1)), sparse.block_diag(shares)],
    ]
    low = np.concatenate([np.full(size, -radius), [-np.inf], *lowest])
    high = np.where(np.arange(len(low)) < size, radius, np.inf)
    program = LinearConstraints(
        np.pad(equal, ((0, 0), (0, len(low) - size))),
        equal_to - equal @ unknowns,
        sparse.block_array(rows, format="csr"),
        np.concatenate([below_to - below @ unknowns, *(-model.values for model in every), np.zeros(len(models))]),
    )
    cost = np.eye(1, len(low), size).ravel()
    if with_curvature and curved:
        curvature = sum(curved) / len(active)
        solution = minimise_quadratic(np.pad(curvature, (0, len(low) - size)), cost, program, low, high)
        change = solution[:size]
        return change, scale * float(solution[size] + change @ curvature @ change / 2)
    found = minimise_linear(cost, program, low, high)
    if found is None:
        raise RuntimeError("the linear subproblem is infeasible although the present law satisfies its limits")
    return found[:size], scale * float(found[size])


def trust_region_search(
    problem: OptimisationProblem, unknowns: Array, decrease: float = DECREASE_TOLERANCE
) -> tuple[Array, float, int]:
    """Minimise the criterion by sequential convex programming from coefficients [-] within the constraints.

    The search ends at a relative predicted decrease [-]. Returns the stationary law, its criterion and the number of
    accepted steps.
    """
    radius, models = np.inf, problem.linearise(unknowns)
    value = _largest(models)
    if value == 0:
        raise ValueError("the criterion is zero for every law; set a `mass` > 0 or a resistance that enters it")
    for steps in range(STEP_LIMIT):
        here = models
        while True:
            change, predicted = solve_linearised(problem, unknowns, here, radius)
            models = problem.linearise(unknowns + change)
            reached = _largest(models)
            if value - predicted <= decrease * abs(value) or radius < RADIUS_TOLERANCE * np.abs(unknowns).max():
                better = reached <= value + VALUE_ROUNDING * abs(value)
                return (unknowns + change, reached, steps) if better else (unknowns, value, steps)
            ratio, longest = (value - reached) / (value - predicted), np.abs(change).max()
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
    value = _largest(models)
    return max(0.0, (value - solve_linearised(problem, unknowns, models, with_curvature=False)[1]) / abs(value))


def _find_optimal_law(problem: OptimisationProblem) -> OptimalMotion:
    """Find the law that minimises a criterion, from that of the least mean square of acceleration."""
    laws = problem.constraints
    unknowns, value, steps = trust_region_search(problem, laws.min_acceleration_law)
    for _ in range(EXCHANGE_ROUNDS):
        peaks = problem.peaks_between_nodes(unknowns)
        if not peaks:
            break
        problem = replace(problem, extra_phases=problem.extra_phases + peaks)
        unknowns, value, taken = trust_region_search(problem, unknowns)
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
    name, curve = optimal_law_name(problem.weights), laws.space.curve(unknowns)
    return OptimalMotion(name, laws.stroke, laws.duration, curve, False, value, gap, steps)
