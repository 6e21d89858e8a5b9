"""Static equilibrium of one increment by Newton's method.

    contact forces of the roller - internal forces of the layer = 0    on the free degrees of freedom

An increment of an associated, hardening material minimises a convex energy. A step along the Newton direction is
therefore cut until the residual along that direction has decreased. The factorised tangent is reused, across
increments too, as long as it reduces the residual well (modified Newton). If steps remain short, a share of the elastic
stiffness is added to the tangent.

A layer in plastic flow, such as a bow wave, has almost no stiffness. Artificial damping then stabilises it: a share of
the elastic forces of the departure from the predicted displacement. It vanishes if the prediction is exact.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from compact.engines.compaction.finite_strain_solid import (
    FiniteStrainSolid,
    FloatArray,
    LinearSolver,
    SolidIncrement,
    SolidState,
)
from compact.engines.compaction.roller_contact import ContactForces
from compact.rolling_contact import EquilibriumError

RESIDUAL_TOLERANCE = 1e-6  # [-], of the nodal forces
MAX_ITERATIONS = 60  # [-], Newton iterations of one increment
GOOD_REDUCTION = 0.3  # [-], ratio of successive residuals up to which a factorised tangent is reused
OVERSHOOT_LIMIT = 0.3  # [-], residual along the direction that a step beyond the minimum may leave, over its start
MAX_STEP_CUTS = 8  # [-], step lengths tried by one line search
LENGTH_GROWTH = 4.0  # [-], first step length of a line search over that of the last one, up to 1
SHORT_STEP = 0.2  # [-], step length below which elastic stiffness is added
FIRST_ELASTIC_SHARE = 0.005  # [-], share of the elastic stiffness that is added first
MAX_ELASTIC_SHARE = 10.0  # [-], share beyond which the increment fails

Progress = Callable[[str], None]


class ContactSurface(Protocol):
    """Any surface with contact forces on displaced nodes."""

    def contact_forces(self, displacement: FloatArray) -> ContactForces:
        """Return the forces on nodes with displacements of shape (n, 2)."""


def residual_clause(residuals: list[float]) -> str:
    """Return the clause of an error message for the relative residuals of all iterations."""
    return f"residual {min(residuals):.1e} of the nodal forces after {len(residuals)} iterations"


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Equilibrium at the end of an increment.

    Parameters
    ----------
    state : SolidState
        State of the layer.
    contact : ContactForces
        Contact with the roller.
    residual : float
        Norm of the residual without damping over that of the nodal forces [-].
    iterations : int
        Newton iterations.
    """

    state: SolidState
    contact: ContactForces
    residual: float
    iterations: int


class IncrementSolver:
    """Newton solver for increments of one layer; it keeps the factorised tangent between increments.

    Parameters
    ----------
    solid : FiniteStrainSolid
        Finite elements of the layer.
    nodes : array_like of int, shape (n,)
        Surface nodes that the roller may touch.
    tolerance : float
        Relative tolerance of the residual [-].
    """

    def __init__(self, solid: FiniteStrainSolid, nodes: ArrayLike, tolerance: float = RESIDUAL_TOLERANCE) -> None:
        self.solid, self.nodes, self.tolerance = solid, np.asarray(nodes, dtype=int), tolerance
        self.solve_tangent: LinearSolver | None = None
        self._last_increment: SolidIncrement | None = None

    def solve(
        self, before: SolidState, surface: ContactSurface, prediction: FloatArray, damping: float = 0.0
    ) -> Equilibrium:
        """Find the equilibrium that follows a state.

        Parameters
        ----------
        before : SolidState
            State before the increment.
        surface : ContactSurface
            Roller at the end of the increment.
        prediction : ndarray, shape (N, 2)
            Predicted displacement [m]; its fixed degrees of freedom are final. If elements invert in it, the iteration
            starts from the displacement before.
        damping : float
            Share of the elastic stiffness that resists departures from the prediction [-].

        Returns
        -------
        Equilibrium

        Raises
        ------
        EquilibriumError
            If Newton's method does not converge.
        """
        trial, share, residuals = self._first_trial(before, surface, prediction, damping), 0.0, []
        first_length = 1.0
        for iteration in range(MAX_ITERATIONS):
            residuals.append(trial.size)
            if trial.size <= self.tolerance:
                self._last_increment = trial.increment
                return Equilibrium(trial.increment.after, trial.contact, trial.undamped_size, iteration)
            stalled = iteration > 0 and residuals[-1] > GOOD_REDUCTION * residuals[-2]
            refactorised = self.solve_tangent is None or stalled
            if refactorised:
                self._factorise(trial, share)
            assert self.solve_tangent is not None  # set by `_factorise`
            direction = self.solve_tangent(trial.residual)
            length, next_trial = _line_search(trial, direction, first_length)
            first_length = min(LENGTH_GROWTH * length, 1.0) if next_trial else 1.0
            if next_trial is None and not refactorised:  # an outdated tangent may give no descent direction
                self.solve_tangent = None
                continue
            if next_trial is None or length < SHORT_STEP:
                share, self.solve_tangent = max(4 * share, FIRST_ELASTIC_SHARE), None
                if share > MAX_ELASTIC_SHARE:
                    break
            elif length == 1:
                share = share / 4 if share > FIRST_ELASTIC_SHARE / 20 else 0.0
            trial = next_trial or trial
        raise EquilibriumError(f"no equilibrium: {residual_clause(residuals)}")

    def _first_trial(
        self, before: SolidState, surface: ContactSurface, prediction: FloatArray, damping: float
    ) -> "_Trial":
        """Evaluate the prediction, or the displacement before the increment if elements invert in it."""
        fixed, start = self.solid.fixed_dofs, before.displacement.copy()
        start.ravel()[fixed] = prediction.ravel()[fixed]
        for displacement in (prediction, start):
            trial = _try_displacement(self, before, surface, displacement, damping, prediction, self._last_increment)
            if trial is not None:
                return trial
        raise EquilibriumError("no equilibrium: elements of the layer invert before the first iteration")

    def _factorise(self, trial: "_Trial", share: float) -> None:
        self.solve_tangent = None  # frees the factors of the last tangent
        stiffness = trial.element_stiffness()
        if share + trial.damping:
            stiffness += (share + trial.damping) * self.elastic_stiffness
        try:
            self.solve_tangent = self.solid.factorise(stiffness, self.nodes, trial.contact.stiffness)
        except RuntimeError as error:
            raise EquilibriumError(f"no equilibrium: {error}") from error
        if trial.contact.creep_coupling is not None:
            column, row = (self._scatter(part) for part in trial.contact.creep_coupling)
            self.solve_tangent = _rank_one_update(self.solve_tangent, column, row)

    def _scatter(self, values: FloatArray) -> FloatArray:
        """Scatter values at the surface nodes, shape (n, 2), to the ordered free degrees of freedom."""
        spread = np.zeros((self.solid.basis.N, 2))
        spread[self.nodes] = values
        return spread.ravel()[self.solid.ordered_dofs]

    @cached_property
    def elastic_stiffness(self) -> FloatArray:
        """Stiffness of the undeformed elements [N/m2], shape (elements, 16, 16)."""
        return self.solid.elastic_element_stiffness()

    def elastic_forces(self, displacement: FloatArray) -> FloatArray:
        """Return the nodal forces of an elastic layer on the free degrees of freedom [N/m], in their order.

        Parameters
        ----------
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes, 0 where it is fixed [m].
        """
        return self.solid.multiply(self.elastic_stiffness, displacement.ravel()[self.solid.ordered_dofs])


class _Trial:
    """A displacement with the internal and contact forces and the residual that follow from it."""

    def __init__(
        self,
        solver: IncrementSolver,
        before: SolidState,
        surface: ContactSurface,
        displacement: FloatArray,
        damping: float,
        prediction: FloatArray,
        near: SolidIncrement | None = None,
    ) -> None:
        self.solver, self.before, self.surface = solver, before, surface
        self.damping, self.prediction = damping, prediction
        solid = solver.solid
        self.increment = solid.increment(before, displacement, tangent=False, near=near)
        self.contact = surface.contact_forces(displacement[solver.nodes])
        internal = self.increment.internal_forces
        external = np.zeros_like(internal)
        external[solver.nodes] = self.contact.forces
        scale = max(np.linalg.norm(internal), np.linalg.norm(external)) or 1.0
        self.residual = (external - internal).ravel()[solid.ordered_dofs]
        self.undamped_size = float(np.linalg.norm(self.residual) / scale)
        if damping:
            self.residual = self.residual - damping * solver.elastic_forces(displacement - prediction)
        self.size = float(np.linalg.norm(self.residual) / scale)
        if not np.isfinite(self.size):
            raise FloatingPointError("elements of the layer invert")

    def element_stiffness(self) -> FloatArray:
        """Return the tangent stiffness of the elements; the increment is integrated again."""
        displacement = self.increment.after.displacement
        return self.solver.solid.increment(self.before, displacement, near=self.increment).element_stiffness

    def step(self, length: float, direction: FloatArray) -> "_Trial | None":
        """Return the trial one step further, or None if elements invert or the stress integration fails."""
        displacement = self.increment.after.displacement.copy()
        displacement.ravel()[self.solver.solid.ordered_dofs] += length * direction
        return _try_displacement(
            self.solver, self.before, self.surface, displacement, self.damping, self.prediction, self.increment
        )


def _try_displacement(*arguments: Any) -> _Trial | None:
    """Return the `_Trial` of these arguments, or None if elements invert or the stress integration fails."""
    try:
        with np.errstate(invalid="raise", divide="raise", over="raise"):
            return _Trial(*arguments)
    except (FloatingPointError, RuntimeError, ValueError):
        return None


def _rank_one_update(solve: LinearSolver, column: FloatArray, row: FloatArray) -> LinearSolver:
    """Return the solver of A + column row' from that of A by the Sherman-Morrison formula."""
    solved_column = solve(column)
    part = solved_column / (1 + row @ solved_column)

    def solve_updated(residual: FloatArray) -> FloatArray:
        plain = solve(residual)
        return plain - (row @ plain) * part

    return solve_updated


def _line_search(trial: _Trial, direction: FloatArray, length: float) -> tuple[float, _Trial | None]:
    """Return the step length and the trial with a smaller residual along the direction; None if there is none.

    The length given is tried first.
    """
    start = direction @ trial.residual
    if start <= 0:
        return 0.0, None
    for _ in range(MAX_STEP_CUTS):
        candidate = trial.step(length, direction)
        if candidate is not None:
            slope = direction @ candidate.residual
            if -OVERSHOOT_LIMIT * start <= slope <= start or candidate.size < GOOD_REDUCTION * trial.size:
                return length, candidate
            length *= float(np.clip(start / (start - slope), 0.1, 0.7)) if slope < 0 else 0.25  # secant
        else:
            length /= 4
    return length, None
