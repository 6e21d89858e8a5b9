"""Newton's method for one increment of a layer in contact with a roller.

    contact forces of the roller - internal forces of the layer = 0    on the free degrees of freedom

An increment of an associated, hardening material minimises a convex energy. A step along the Newton direction is
therefore cut until the residual along that direction has decreased. The factorised tangent is reused, across
increments too, as long as it reduces the residual well (modified Newton). If steps remain short, a share of the elastic
stiffness is added to the tangent. A layer in plastic flow, such as a bow wave, has almost no stiffness. Artificial
damping then stabilises it: a share of the elastic forces of the departure from the predicted displacement. It vanishes
in steady motion.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid, LinearSolver, SolidIncrement, SolidState
from compact.engines.compaction.roller_contact import ContactForces, RollerSurface
from compact.numerics import Array
from compact.rolling_contact import EquilibriumError

PREDICTED_SHARE = 0.1  # [-], of the tolerance of a prediction, or steady motion would repeat its residual
MAX_ITERATIONS = 60  # [-], Newton iterations of one increment
GOOD_REDUCTION = 0.3  # [-], ratio of successive residuals up to which a factorised tangent is reused
OVERSHOOT_LIMIT = 0.3  # [-], residual along the direction that a step beyond the minimum may leave, over its start
MAX_STEP_CUTS = 8  # [-], step lengths tried by one line search
LENGTH_GROWTH = 4.0  # [-], first step length of a line search over that of the last one, up to 1
SHORT_STEP = 0.2  # [-], step length below which elastic stiffness is added
FIRST_ELASTIC_SHARE = 0.005  # [-], share of the elastic stiffness that is added first
MAX_ELASTIC_SHARE = 10.0  # [-], share beyond which the increment fails


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
    """

    state: SolidState
    contact: ContactForces
    residual: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """A displacement with its forces, residual on the ordered degrees of freedom, and sizes of it [-]."""

    increment: SolidIncrement
    contact: ContactForces
    residual: Array
    undamped_size: float
    size: float


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

    Attributes
    ----------
    iterations : int
        Newton iterations of all increments.
    """

    def __init__(self, solid: FiniteStrainSolid, nodes: ArrayLike, tolerance: float) -> None:
        self.solid, self.nodes, self.tolerance = solid, np.asarray(nodes, dtype=int), tolerance
        self.solve_tangent: LinearSolver | None = None
        self.iterations = 0
        self._last_increment: SolidIncrement | None = None

    @cached_property
    def elastic_stiffness(self) -> Array:
        """Stiffness of the undeformed elements [N/m2], shape (elements, 16, 16)."""
        undeformed = self.solid.undeformed_state()
        return self.solid.increment(undeformed, undeformed.displacement).element_stiffness

    def solve(self, before: SolidState, surface: RollerSurface, prediction: Array, damping: float = 0.0) -> Equilibrium:
        """Find the equilibrium that follows a state.

        Parameters
        ----------
        before : SolidState
            State before the increment.
        surface : RollerSurface
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
        solid, dofs = self.solid, self.solid.ordered_dofs

        def attempt(displacement: Array, near: SolidIncrement | None) -> _Trial | None:
            """Return the trial, or None if elements invert or the stress integration fails."""
            try:
                with np.errstate(invalid="raise", divide="raise", over="raise"):
                    increment = solid.increment(before, displacement, tangent=False, near=near)
                    contact = surface.contact_forces(displacement[self.nodes])
                    internal = increment.internal_forces
                    external = np.zeros_like(internal)
                    external[self.nodes] = contact.forces
                    scale = max(np.linalg.norm(internal), np.linalg.norm(external)) or 1.0
                    residual = (external - internal).ravel()[dofs]
                    undamped_size = float(np.linalg.norm(residual) / scale)
                    if damping:
                        departure = (displacement - prediction).ravel()[dofs]
                        residual = residual - damping * solid.multiply(self.elastic_stiffness, departure)
                    size = float(np.linalg.norm(residual) / scale)
            except (FloatingPointError, RuntimeError, ValueError):
                return None
            return _Trial(increment, contact, residual, undamped_size, size) if np.isfinite(size) else None

        start = before.displacement.copy()
        start.ravel()[solid.fixed_dofs] = prediction.ravel()[solid.fixed_dofs]
        trial = attempt(prediction, self._last_increment) or attempt(start, self._last_increment)
        if trial is None:
            raise EquilibriumError("no equilibrium: elements of the layer invert before the first iteration")
        share, first_length, residuals = 0.0, 1.0, []
        for iteration in range(MAX_ITERATIONS):
            residuals.append(trial.size)
            if trial.size <= (self.tolerance if iteration else PREDICTED_SHARE * self.tolerance):
                self._last_increment, self.iterations = trial.increment, self.iterations + iteration
                return Equilibrium(trial.increment.after, trial.contact, trial.undamped_size)
            stalled = iteration and residuals[-1] > GOOD_REDUCTION * residuals[-2]
            refactorised = self.solve_tangent is None or stalled
            if refactorised:
                self._factorise(before, trial, share + damping)
            assert self.solve_tangent is not None  # set by `_factorise`
            direction = self.solve_tangent(trial.residual)
            length, next_trial = _line_search(attempt, trial, dofs, direction, first_length)
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
        raise EquilibriumError(
            f"no equilibrium: residual {min(residuals):.1e} of the nodal forces after {len(residuals)} iterations"
        )

    def _factorise(self, before: SolidState, trial: _Trial, elastic_share: float) -> None:
        """Factorise the tangent at a trial, whose increment is integrated again, with a share of the elastic one."""
        near, contact = trial.increment, trial.contact
        stiffness = self.solid.increment(before, near.after.displacement, near=near).element_stiffness
        if elastic_share:
            stiffness += elastic_share * self.elastic_stiffness
        self.solve_tangent = solve = self.solid.factorise(stiffness, self.nodes, contact.stiffness)
        if contact.creep_coupling is not None:  # by the formula of Sherman and Morrison for A + column row'
            spread = np.zeros((2, self.solid.basis.N, 2))
            spread[:, self.nodes] = contact.creep_coupling
            column, row = (part.ravel()[self.solid.ordered_dofs] for part in spread)
            solved = solve(column)
            solved /= 1 + row @ solved

            def solve_coupled(residual: Array) -> Array:
                plain = solve(residual)
                return plain - (row @ plain) * solved

            self.solve_tangent = solve_coupled


def _line_search(attempt, trial, dofs, direction, length):
    """Return the step length and the trial with a smaller residual along the direction; None if there is none.

    The length given is tried first.
    """
    start = direction @ trial.residual
    if start <= 0:
        return 0.0, None
    for _ in range(MAX_STEP_CUTS):
        displacement = trial.increment.after.displacement.copy()
        displacement.ravel()[dofs] += length * direction
        candidate = attempt(displacement, trial.increment)
        if candidate is not None:
            slope = direction @ candidate.residual
            if -OVERSHOOT_LIMIT * start <= slope <= start or candidate.size < GOOD_REDUCTION * trial.size:
                return length, candidate
            length *= float(np.clip(start / (start - slope), 0.1, 0.7)) if slope < 0 else 0.25  # secant
        else:
            length /= 4
    return length, None
