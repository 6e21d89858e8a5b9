"""Incremental rolling: equilibrium after each element of travel, by Newton's method.

Before a step all mix is convected towards the rear by one element (`RollerFrame`); then the roller, again at x = 0, is
brought into equilibrium. The prediction of a step is the displacement change of the last one, seen from the roller. The
tractions of the roller are multipliers and move with it. `steady_search` decides how far to roll.

    contact forces of the roller - internal forces of the layer = 0    on the free degrees of freedom

An increment of an associated, hardening material minimises a convex energy. A step along the Newton direction is
therefore cut until the residual along that direction has decreased. The factorised tangent is reused, across
increments too, as long as it reduces the residual well (modified Newton). If steps remain short, a share of the elastic
stiffness is added to the tangent. A layer in plastic flow, such as a bow wave, has almost no stiffness. Artificial
damping then stabilises it: a share of the elastic forces of the departure from the predicted displacement. It vanishes
in steady motion.

The shear line of a `DruckerPragerCap` has no associated flow, so that increments on it need not converge. The pressure
that limits shear in a step is therefore carried over from the same place in the last steps (`drucker_prager_cap`),

    p' <- p' + (p - p')/2,

half of the change at a time, since p' would oscillate from step to step. In steady motion p' = p.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compact.engines.compaction.finite_strain_solid import (
    FiniteStrainSolid,
    FloatArray,
    LinearSolver,
    SolidIncrement,
    SolidState,
)
from compact.engines.compaction.roller_contact import ContactForces, ContactTractions, RollerSurface
from compact.engines.compaction.roller_frame import RollerFrame
from compact.material.laws import DruckerPragerCap
from compact.rolling_contact import EquilibriumError, Heaping, HeapingError, Roller

RESIDUAL_TOLERANCE = 1e-6  # [-], of the nodal forces
MAX_ITERATIONS = 60  # [-], Newton iterations of one increment
GOOD_REDUCTION = 0.3  # [-], ratio of successive residuals up to which a factorised tangent is reused
OVERSHOOT_LIMIT = 0.3  # [-], residual along the direction that a step beyond the minimum may leave, over its start
MAX_STEP_CUTS = 8  # [-], step lengths tried by one line search
LENGTH_GROWTH = 4.0  # [-], first step length of a line search over that of the last one, up to 1
SHORT_STEP = 0.2  # [-], step length below which elastic stiffness is added
FIRST_ELASTIC_SHARE = 0.005  # [-], share of the elastic stiffness that is added first
MAX_ELASTIC_SHARE = 10.0  # [-], share beyond which the increment fails
PENALTY = 0.15  # [-], normal penalty over unloading modulus/step
PENALTY_ROWS = 20  # [-], layer height over the largest length that limits the penalty
PENALTY_REDUCTION = 0.1  # [-], factor of the penalty if an increment has no equilibrium
DAMPING = 0.02  # [-], share of the elastic stiffness; without it a high bow wave takes five times the iterations
FINAL_DAMPING_RATIO = 0.25  # [-], of the damping once the roller is at its height
MAX_HALVINGS = 3  # [-], halvings of a step that has no equilibrium
ROLLING_TOLERANCE = 1e-4  # [-], residual of a step over the nodal forces
CARRIED_SHARE = 0.5  # [-], of the change of the carried pressure in a step; with 1 it oscillates
PREDICTION_TAPER = 0.5  # [-], distance ahead of the roller over the contact length from which jumps are predicted

Progress = Callable[[str], None]


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


@dataclass(frozen=True, eq=False)
class _Trial:
    """A displacement with its forces, residual on the ordered degrees of freedom, and sizes of it [-]."""

    increment: SolidIncrement
    contact: ContactForces
    residual: FloatArray
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
    """

    def __init__(self, solid: FiniteStrainSolid, nodes: ArrayLike, tolerance: float = RESIDUAL_TOLERANCE) -> None:
        self.solid, self.nodes, self.tolerance = solid, np.asarray(nodes, dtype=int), tolerance
        self.solve_tangent: LinearSolver | None = None
        self._last_increment: SolidIncrement | None = None

    @cached_property
    def elastic_stiffness(self) -> FloatArray:
        """Stiffness of the undeformed elements [N/m2], shape (elements, 16, 16)."""
        return self.solid.elastic_element_stiffness()

    def solve(
        self, before: SolidState, surface: RollerSurface, prediction: FloatArray, damping: float = 0.0
    ) -> Equilibrium:
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

        def attempt(displacement: FloatArray, near: SolidIncrement | None) -> _Trial | None:
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
            if trial.size <= self.tolerance:
                self._last_increment = trial.increment
                return Equilibrium(trial.increment.after, trial.contact, trial.undamped_size, iteration)
            stalled = iteration > 0 and residuals[-1] > GOOD_REDUCTION * residuals[-2]
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
        self.solve_tangent = None  # frees the factors of the last tangent
        displacement, contact = trial.increment.after.displacement, trial.contact
        stiffness = self.solid.increment(before, displacement, near=trial.increment).element_stiffness
        if elastic_share:
            stiffness += elastic_share * self.elastic_stiffness
        try:
            solve = self.solid.factorise(stiffness, self.nodes, contact.stiffness)
        except RuntimeError as error:
            raise EquilibriumError(f"no equilibrium: {error}") from error
        self.solve_tangent = solve
        if contact.creep_coupling is not None:  # by the formula of Sherman and Morrison for A + column row'
            spread = np.zeros((2, self.solid.basis.N, 2))
            spread[:, self.nodes] = contact.creep_coupling
            column, row = (part.ravel()[self.solid.ordered_dofs] for part in spread)
            solved_column = solve(column)
            part = solved_column / (1 + row @ solved_column)

            def solve_coupled(residual: FloatArray) -> FloatArray:
                plain = solve(residual)
                return plain - (row @ plain) * part

            self.solve_tangent = solve_coupled


def _line_search(
    attempt: Callable[[FloatArray, SolidIncrement], _Trial | None],
    trial: _Trial,
    dofs: NDArray[np.int64],
    direction: FloatArray,
    length: float,
) -> tuple[float, _Trial | None]:
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


@dataclass(frozen=True)
class RollingStep:
    """One step of incremental rolling.

    Parameters
    ----------
    travel : float
        Total travel [m].
    bottom_height : float
        Height of the lowest generatrix above the base [m].
    load, resistance : float
        Forces on the roller [N/m].
    exit_density_ratio : float
        Mean density ratio of the exit column [-].
    peak_pressure : float
        Largest pressure [Pa].
    iterations : int
        Newton iterations.
    residual : float
        Residual without damping over the nodal forces [-].
    bow_wave : float
        Rise of the surface above the fed layer [m].
    wave_area : float
        Area between the risen surface ahead of the roller and the fed layer [m2].
    stored_area : float
        Area of fed mix that is pushed ahead of the exit column [m2], the travel times inflow less outflow.
    """

    travel: float
    bottom_height: float
    load: float
    resistance: float
    exit_density_ratio: float
    peak_pressure: float
    iterations: int
    residual: float
    bow_wave: float
    wave_area: float
    stored_area: float

    def __str__(self) -> str:
        wave = f"bow wave {1e3 * self.bow_wave:.3g} mm"
        return f"load {self.load:.0f} N/m, resistance {self.resistance:.0f} N/m, {wave}"


def roller_surface(
    frame: RollerFrame, roller: Roller, torque: float, *, low: float = 0.0, position: float = 0.0
) -> RollerSurface:
    """Return a roller just in touch with the layer of a frame, for travel along +x.

    Parameters
    ----------
    frame : RollerFrame
        Mesh of the layer.
    roller : Roller
        Roller; its target is not used.
    torque : float
        Torque on a roller that rotates, + along the travel [N].
    low, position : float
        x of the origin of the frame and of the roller [m].
    """
    coordinates, height = frame.nodes[frame.surface_nodes] + [low, 0.0], frame.mesh.height
    rotates = roller.rolling in ("free", "driven") and roller.friction > 0
    return RollerSurface(
        coordinates,
        frame.surface_weights,
        roller.radius,
        height,
        PENALTY * frame.solid.material.unloading_modulus / min(frame.step, height / PENALTY_ROWS),
        roller.profile,
        0.0 if roller.rolling == "frictionless" else roller.friction,
        -torque / roller.radius if rotates else None,
        ContactTractions(*np.zeros((2, len(coordinates)))),
        position,
    )


class IncrementalRolling:
    """Roller in a `RollerFrame`, moved by one element in each step.

    Parameters
    ----------
    frame : RollerFrame
        Mesh with its inflow.
    roller : Roller
        Roller.
    torque : float
        Torque on a roller that rotates, + along the travel [N].
    max_wave_height : float
        Height above the lowest generatrix that the bow wave may reach [m].
    progress : callable, optional
        Called with a line of text after each step.

    Attributes
    ----------
    state : SolidState
        Current state of the layer.
    surface : RollerSurface
        Roller with its multipliers.
    contact : ContactForces
        Contact of the last step.
    steps : tuple of RollingStep
        All steps.
    displacement_change : ndarray, shape (N, 2)
        Displacement change of the last step seen from the roller [m].
    carried_pressure : ndarray, shape (n,), or None
        Carried pressure of the next step [Pa]; None for that of the present state, and for mix without a shear line.
    """

    def __init__(
        self,
        frame: RollerFrame,
        roller: Roller,
        torque: float = 0.0,
        *,
        max_wave_height: float = np.inf,
        progress: Progress | None = None,
    ) -> None:
        self.frame, self.max_wave_height, self.progress = frame, max_wave_height, progress
        self.surface = roller_surface(frame, roller, torque)
        self.solver = IncrementSolver(frame.solid, frame.surface_nodes, ROLLING_TOLERANCE)
        self.state = frame.initial_state()
        self.displacement_change = np.zeros_like(self.state.displacement)
        self.carried_pressure: FloatArray | None = None
        self.steps: tuple[RollingStep, ...] = ()
        self.contact: ContactForces = self.surface.normal_contact(self.state.displacement[frame.surface_nodes])

    @property
    def depth(self) -> float:
        """Depth of the lowest generatrix below the fed surface [m]."""
        return self.frame.mesh.height - self.steps[-1].bottom_height

    @property
    def mesh_depth(self) -> float:
        """Depth for which the mesh is made [m]."""
        return self.frame.contact_length**2 / (2 * self.surface.radius)

    def advance(self, bottom_height: float, damping: float = DAMPING) -> RollingStep:
        """Roll by one element.

        Parameters
        ----------
        bottom_height : float
            Height of the lowest generatrix after the step [m].
        damping : float
            Artificial damping as a share of the elastic stiffness [-].

        Returns
        -------
        RollingStep

        Raises
        ------
        RuntimeError
            If the step has no equilibrium; the message contains the last step.
        """
        frame, carried = self.frame, None
        if isinstance(frame.solid.material, DruckerPragerCap):
            carried = mean_pressure(self.state) if self.carried_pressure is None else self.carried_pressure
        convected = replace(frame.convect(self.state), carried_pressure=carried)
        prediction, fixed = convected.displacement + self.displacement_change, frame.solid.fixed_dofs
        prediction.ravel()[fixed] = convected.displacement.ravel()[fixed]
        # one element back on the convected mix, then at its new place
        surface = self.surface.moved_to(self.surface.bottom_height, -frame.step)
        surface = surface.begin_increment(convected.displacement[frame.surface_nodes]).moved_to(bottom_height)
        try:
            equilibrium = self.solver.solve(convected, surface, prediction, damping)
        except EquilibriumError:
            equilibrium = self._solve_in_parts(convected, bottom_height)

        self.state, self.contact = equilibrium.state, equilibrium.contact
        self.displacement_change = self.state.displacement - convected.displacement
        if carried is not None:
            self.carried_pressure = carried + CARRIED_SHARE * (mean_pressure(self.state) - carried)
        self.surface = self.surface.with_multipliers(self.contact).moved_to(bottom_height)
        load, resistance = self.load_and_resistance()
        step = RollingStep(
            travel=(self.steps[-1].travel if self.steps else 0.0) + frame.step,
            bottom_height=bottom_height,
            load=load,
            resistance=resistance,
            exit_density_ratio=frame.exit_density_ratio(self.state.points.density_ratio),
            peak_pressure=float(self.surface_pressure.max()),
            iterations=equilibrium.iterations,
            residual=equilibrium.residual,
            bow_wave=float(self.surface_positions[:, 1].max() - frame.mesh.height),
            wave_area=self.wave_area,
            stored_area=frame.stored_area(self.state.displacement),
        )
        self.steps += (step,)
        if self.progress is not None:
            self.progress(
                f"{round(frame.contact_length / frame.step)} increments per contact length, step {len(self.steps)}: "
                f"travel {step.travel:.3g} m, bow wave {1e3 * step.bow_wave:.3g} mm, residual {step.residual:.1e}"
            )
        return step

    def _solve_in_parts(self, convected: SolidState, bottom_height: float) -> Equilibrium:
        """Solve a step in halves, quarters, eighths, with a lower penalty; the multipliers compensate it later."""
        start, step, rolling = self.surface.bottom_height, self.frame.step, self.frame.surface_nodes
        soft = replace(self.surface, penalty=PENALTY_REDUCTION * self.surface.penalty)
        for parts in (2**halving for halving in range(1, MAX_HALVINGS + 1)):
            moved, state, self.solver.solve_tangent = soft.moved_to(start, -step), convected, None
            iterations = 0
            try:
                for share in np.arange(1, parts + 1) / parts:
                    moved = moved.begin_increment(state.displacement[rolling])
                    moved = moved.moved_to(start + (bottom_height - start) * share, step * (share - 1))
                    equilibrium = self.solver.solve(state, moved, state.displacement)
                    state, iterations = equilibrium.state, iterations + equilibrium.iterations
                return replace(equilibrium, iterations=iterations)
            except EquilibriumError as error:
                reason = error
        depth, reached = 1e3 * (self.frame.mesh.height - bottom_height), "no step before"
        if self.steps:
            reached = f"last step: travel {self.steps[-1].travel:.3g} m, {self.steps[-1]}"
        raise EquilibriumError(f"step {len(self.steps) + 1} of rolling at depth {depth:.4g} mm: {reason}; {reached}")

    def initialise_from(self, other: "IncrementalRolling", state: SolidState, depth: float | None = None) -> None:
        """Continue from the state of another roller.

        Parameters
        ----------
        other : IncrementalRolling
            Other roller.
        state : SolidState
            Its state on the mesh of this frame.
        depth : float, optional
            Depth of the state [m], stretched node by node; that of the other roller by default.
        """
        x = self.frame.surface_x
        height = self.frame.mesh.height - (other.depth if depth is None else depth)
        self.steps = (replace(other.steps[-1], bottom_height=height),)
        self.surface = self.surface.moved_to(height)
        self.restart(state, other.contact.at(x, other.frame.surface_x if depth is None else x))
        self.displacement_change = state.displacement - self.frame.convect(state).displacement

    def restart(self, state: SolidState, tractions: ContactTractions, displacement: FloatArray | None = None) -> None:
        """Continue from a changed state.

        Parameters
        ----------
        state : SolidState
            State of the layer.
        tractions : ContactTractions
            Multipliers of the roller.
        displacement : ndarray, shape (N, 2), optional
            Change of the displacement [m]. The prediction of the next step follows it ahead of the roller alone; behind
            it contains marks, which move with the mix.
        """
        self.state, self.surface = state, self.surface.with_multipliers(tractions)
        self.carried_pressure = None
        self.solver.solve_tangent = None
        if displacement is not None:
            share = np.clip(self.frame.nodes[:, :1] / (PREDICTION_TAPER * self.frame.contact_length), 0.0, 1.0)
            change = displacement - self.frame.convect_displacement(displacement)
            self.displacement_change = self.displacement_change + share * change

    def remove_marks_behind(self) -> None:
        """Make the layer uniform behind the exit column, where the start and changes of the depth left marks."""
        self.restart(self.frame.with_uniform_rear(self.state), self.contact)
        self.displacement_change = self.frame.with_uniform_rear_nodes(self.displacement_change)

    def load_and_resistance(self) -> tuple[float, float]:
        """Return load and resistance [N/m]."""
        return self.surface.load_and_resistance(self.contact)

    @property
    def surface_positions(self) -> FloatArray:
        """Current positions of the surface nodes [m], shape (n, 2)."""
        nodes = self.frame.surface_nodes
        return self.frame.nodes[nodes] + self.state.displacement[nodes]

    @property
    def surface_pressure(self) -> FloatArray:
        """Pressure on the deformed surface [Pa], shape (n,)."""
        return self._surface_traction(self.contact.pressure)

    @property
    def surface_shear(self) -> FloatArray:
        """Shear traction on the deformed surface [Pa], + along the travel, shape (n,)."""
        return self._surface_traction(self.contact.shear)

    def _surface_traction(self, nodal: FloatArray) -> FloatArray:
        """Return a traction on the deformed surface, linear between corners; midside nodes oscillate about it."""
        forces, x = self.surface.weights * nodal, self.frame.surface_x
        corner_forces = forces[::2].copy()
        corner_forces[:-1] += forces[1::2] / 2
        corner_forces[1:] += forces[1::2] / 2
        traction = np.interp(x, x[::2], corner_forces / np.gradient(x[::2]))
        if self.surface.profile != "deformed":
            return traction
        return traction / np.hypot(*(np.gradient(part, x) for part in self.surface_positions.T))

    @property
    def wave_area(self) -> float:
        """Area between the risen surface ahead of the roller and the fed layer [m2]."""
        x, y = self.surface_positions.T
        return float(np.trapezoid(np.where(x > 0, np.maximum(y - self.frame.mesh.height, 0.0), 0.0), x))

    def heaping_error(self, wave: str) -> HeapingError:
        """Return the error of a bow wave that has no steady state, with a clause about the wave."""
        step = self.steps[-1]
        edge = np.clip((self.depth + step.bow_wave) / self.surface.radius, 0.0, 2.0)
        heaping = Heaping(self.depth, float(np.arccos(1 - edge)), step.bow_wave, step.travel)
        return HeapingError(
            f"the mix heaps up in front of the roller at depth {1e3 * self.depth:.4g} mm: after {step.travel:.3g} m of "
            f"travel the bow wave {wave}; {step}",
            heaping,
        )


def mean_pressure(state: SolidState) -> FloatArray:
    """Return the mean pressures of the Gauss points [Pa], shape (n,)."""
    return np.asarray(-state.points.stress[:, :3].mean(axis=1))
