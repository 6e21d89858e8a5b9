"""Incremental rolling: equilibrium after each part of an element of travel.

Before a step all mix is convected towards the rear by one element (`RollerFrame`). The roller then returns to x = 0 in
parts of an element, each an increment in equilibrium (`increment_solver`). Load and resistance of a step are the means
of its parts: they oscillate within an element as its nodes enter the contact. The prediction of a part is the
displacement change of the same part of the last step, and the tractions of that part are its multipliers, so that a
steady motion repeats itself. Newton's method begins with the factorised tangent of that part, which in steady motion
need not be factorised again. `steady_search` decides how far to roll.

The length of an increment causes a far larger error than the size of the elements. Mix that enters the contact is
strained along a straight path in each increment, in truth first along the free surface and then along the roller.

The shear line of a `DruckerPragerCap` has no associated flow, so that increments on it need not converge. The pressure
that limits shear in a part is therefore carried over from the same place in the last steps (`drucker_prager_cap`),

    p' <- p' + (p - p')/2,

half of the change at a time, since p' would oscillate from step to step. In steady motion p' = p.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from compact.engines.compaction.finite_strain_solid import SUBSTEPS, LinearSolver, SolidState
from compact.engines.compaction.increment_solver import Equilibrium, IncrementSolver
from compact.engines.compaction.roller_contact import ContactForces, ContactTractions, RollerSurface
from compact.engines.compaction.roller_frame import RollerFrame
from compact.material.laws import DruckerPragerCap
from compact.numerics import Array
from compact.rolling_contact import EquilibriumError, Roller

PENALTY = 0.15  # [-], normal penalty over unloading modulus/step
PENALTY_ROWS = 20  # [-], layer height over the largest length that limits the penalty
PENALTY_REDUCTION = 0.1  # [-], factor of the penalty if an increment has no equilibrium
DAMPING = 0.02  # [-], share of the elastic stiffness; without it a high bow wave takes five times the iterations
FINAL_DAMPING_RATIO = 0.25  # [-], of the damping once the roller is at its height
MAX_HALVINGS = 3  # [-], halvings of a step that has no equilibrium
ROLLING_TOLERANCE = 1e-4  # [-], residual of a step over the nodal forces
CARRIED_SHARE = 0.5  # [-], of the change of the carried pressure in a step; with 1 it oscillates
PARTS = 4  # [-], of a step; see docs/theory/compaction.md for load and resistance with 1 to 8
MIN_SUBSTEPS = 2  # [-], of the stress integration in a part; 1 leaves a work residual of 0.7 to 1.2 %

Progress = Callable[[str], None]


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
        Forces on the roller, means of the parts [N/m].
    slip_resistance : float
        Part of the resistance that is work of slip per travel [N/m].
    exit_density_ratio : float
        Mean density ratio of the exit column [-].
    peak_pressure : float
        Largest pressure [Pa].
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
    slip_resistance: float
    exit_density_ratio: float
    peak_pressure: float
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
    penalty = PENALTY * frame.solid.material.unloading_modulus / min(frame.step, height / PENALTY_ROWS)
    friction, force = 0.0 if roller.rolling == "frictionless" else roller.friction, -torque / roller.radius
    geometry = coordinates, frame.surface_weights, roller.radius, height, penalty, roller.profile
    tractions = ContactTractions(*np.zeros((2, len(coordinates))))
    return RollerSurface(*geometry, friction, force if rotates else None, tractions, position)


@dataclass(frozen=True, eq=False)
class RollingPart:
    """Part of a step, from which the same part of the next step starts.

    Parameters
    ----------
    contact : ContactTractions
        Tractions of the roller at the end of the part.
    displacement_change : ndarray, shape (N, 2)
        Change of the displacement [m].
    load, resistance, slip_resistance : float
        As of `RollingStep`.
    carried_pressure : ndarray, shape (n,), or None
        Carried pressure of the same part of the next step [Pa]; None for that of the present state, and for mix without
        a shear line.
    """

    contact: ContactTractions
    displacement_change: Array
    load: float = 0.0
    resistance: float = 0.0
    slip_resistance: float = 0.0
    carried_pressure: Array | None = None


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
    parts : int
        Parts of a step.

    Attributes
    ----------
    max_wave_height : float
        Height above the lowest generatrix that the bow wave may reach [m].
    progress : callable or None
        Called with a line of text after each step.
    state : SolidState
        Current state of the layer.
    surface : RollerSurface
        Roller.
    contact : ContactForces
        Contact at the end of the last step.
    steps : tuple of RollingStep
        All steps.
    parts : tuple of RollingPart
        Parts of the last step.
    """

    def __init__(self, frame: RollerFrame, roller: Roller, torque: float = 0.0, parts: int = PARTS) -> None:
        self.frame, self.max_wave_height = frame, np.inf
        self.progress: Progress | None = None
        frame.solid.travel, frame.solid.substeps = frame.step / parts, max(SUBSTEPS // parts, MIN_SUBSTEPS)
        # the slip of a part is as much smaller, and its multiplier shall change as fast
        self.surface = replace(roller_surface(frame, roller, torque), shear_penalty_ratio=float(parts))
        self.solver = IncrementSolver(frame.solid, frame.surface_nodes, ROLLING_TOLERANCE)
        self._positions = frame.step * np.arange(1 - parts, 1) / parts  # of the roller at the ends of the parts [m]
        self._tangents: list[LinearSolver | None] = [None] * parts  # factorised, of the parts; copies share them
        self.state = frame.initial_state()
        self.parts = (RollingPart(self.surface.multipliers, np.zeros_like(self.state.displacement)),) * parts
        self.steps: tuple[RollingStep, ...] = ()
        self.contact: ContactForces = self.surface.normal_contact(self.state.displacement[frame.surface_nodes])

    @property
    def depth(self) -> float:
        """Depth of the lowest generatrix below the fed surface [m]."""
        return self.frame.mesh.height - self.steps[-1].bottom_height

    @property
    def creepage(self) -> float | None:
        """Creepage of a roller that sticks and slips, mean of the parts [-], else None."""
        of_parts = [part.contact.creepage or 0.0 for part in self.parts]
        return None if self.contact.creepage is None else float(np.mean(of_parts))

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
        frame, nodes, count = self.frame, self.frame.surface_nodes, len(self.parts)
        travel = frame.step / count
        heights = np.linspace(self.surface.bottom_height, bottom_height, count + 1)[1:]
        # one element back on the convected mix, then part by part to its new place
        surface, state = self.surface.moved_to(self.surface.bottom_height, -frame.step), frame.convect(self.state)
        pressures = self.state.points.pressure
        parts: tuple[RollingPart, ...] = ()
        for index, (part, height, position) in enumerate(zip(self.parts, heights, self._positions, strict=True)):
            last = pressures if part.carried_pressure is None else part.carried_pressure
            carried = last if isinstance(frame.solid.material, DruckerPragerCap) else None
            state = replace(state, carried_pressure=carried)
            moved = replace(surface, multipliers=part.contact).begin_increment(state.displacement[nodes])
            surface = moved.moved_to(float(height), position)
            prediction, fixed = state.displacement + part.displacement_change, frame.solid.fixed_dofs
            prediction.ravel()[fixed] = state.displacement.ravel()[fixed]
            self.solver.solve_tangent = self._tangents[index] or self.solver.solve_tangent
            try:
                equilibrium = self.solver.solve(state, surface, prediction, damping)
            except EquilibriumError:
                equilibrium = self._solve_in_halves(state, moved, surface)
            self._tangents[index] = self.solver.solve_tangent
            pressures = equilibrium.state.points.pressure
            contact, after = equilibrium.contact, equilibrium.state.displacement
            change = after - state.displacement
            # the work of rotation, - (1 + creepage) times the sum of the shear, cancels with its share of the slip
            slip = np.sum(surface.tangents(after[nodes]) * ([travel, 0.0] - change[nodes]), axis=1) / travel
            if carried is not None:
                carried = carried + CARRIED_SHARE * (pressures - carried)
            forces = *surface.load_and_resistance(contact), float(np.sum(surface.weights * contact.shear * slip))
            parts += (RollingPart(contact, change, *forces, carried),)
            state, surface = equilibrium.state, replace(surface, multipliers=contact)

        self.state, self.contact, self.surface, self.parts = state, equilibrium.contact, surface, parts
        means = np.mean([[part.load, part.resistance, part.slip_resistance] for part in parts], axis=0)
        load, resistance, slip_resistance = means.tolist()
        travel, (x, y) = (self.steps[-1].travel if self.steps else 0.0) + frame.step, self.surface_positions.T
        rise = np.maximum(y - frame.mesh.height, 0.0)
        step = RollingStep(
            load=load,
            resistance=resistance,
            slip_resistance=slip_resistance,
            travel=travel,
            bottom_height=surface.bottom_height,
            exit_density_ratio=frame.exit_density_ratio(state.points.density_ratio),
            peak_pressure=float(self.surface_traction(self.contact.pressure).max()),
            residual=equilibrium.residual,
            bow_wave=float(y.max() - frame.mesh.height),
            wave_area=float(np.trapezoid(np.where(x > 0, rise, 0.0), x)),
            stored_area=frame.stored_area(state.displacement),
        )
        self.steps += (step,)
        if self.progress is not None:
            self.progress(
                f"{round(frame.contact_length / frame.step)} elements per contact length, step {len(self.steps)}: "
                f"travel {step.travel:.3g} m, bow wave {1e3 * step.bow_wave:.3g} mm, residual {step.residual:.1e}"
            )
        return step

    def _solve_in_halves(self, start: SolidState, before: RollerSurface, after: RollerSurface) -> Equilibrium:
        """Solve a part in halves, quarters, eighths, with a lower penalty; the multipliers compensate it later."""
        nodes = self.frame.surface_nodes
        heights, positions = zip(*((each.bottom_height, each.position) for each in (before, after)), strict=True)
        for pieces in (2**halving for halving in range(1, MAX_HALVINGS + 1)):
            moved, state = replace(before, penalty=PENALTY_REDUCTION * before.penalty), start
            self.solver.solve_tangent = None
            try:
                for share in np.arange(1, pieces + 1) / pieces:
                    moved = moved.begin_increment(state.displacement[nodes])
                    moved = moved.moved_to(*(float(low + (high - low) * share) for low, high in (heights, positions)))
                    equilibrium = self.solver.solve(state, moved, state.displacement)
                    state = equilibrium.state
                return equilibrium
            except EquilibriumError as error:
                reason = error
        depth, last = 1e3 * (self.frame.mesh.height - after.bottom_height), self.steps[-1] if self.steps else None
        reached = f"last step: travel {last.travel:.3g} m, {last}" if last else "no step before"
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
        x, count = self.frame.surface_x, len(self.parts)
        height = self.frame.mesh.height - (other.depth if depth is None else depth)
        self.steps = (replace(other.steps[-1], bottom_height=height),)
        self.surface = self.surface.moved_to(height)
        change = (state.displacement - self.frame.convect_displacement(state.displacement)) / count
        known = other.parts if len(other.parts) == count else other.parts[-1:] * count
        places = other._positions if len(other.parts) == count else np.zeros(count)
        nodes = other.frame.surface_x
        if depth is not None:
            nodes, places = x, self._positions
        before = zip(known, self._positions, places, strict=True)
        parts = (RollingPart(part.contact.at(x - now, nodes - place), change) for part, now, place in before)
        self.restart(state, parts)

    def restart(self, state: SolidState, parts: Iterable[RollingPart]) -> None:
        """Continue from a changed state, and from parts whose carried pressure no longer counts."""
        self.state, self.parts = state, tuple(replace(part, carried_pressure=None) for part in parts)

    def remove_marks_behind(self) -> None:
        """Make the layer uniform behind the exit column, where the start and changes of the depth left marks."""
        uniform = self.frame.with_uniform_rear_nodes
        parts = (replace(part, displacement_change=uniform(part.displacement_change)) for part in self.parts)
        self.restart(self.frame.with_uniform_rear(self.state), parts)

    @property
    def surface_positions(self) -> Array:
        """Current positions of the surface nodes [m], shape (n, 2)."""
        nodes = self.frame.surface_nodes
        return self.frame.nodes[nodes] + self.state.displacement[nodes]

    def surface_traction(self, nodal: Array) -> Array:
        """Return a traction on the deformed surface [Pa] from that of the nodes, shape (n,).

        It is linear between corners; midside nodes oscillate about it.
        """
        forces, x = self.surface.weights * nodal, self.frame.surface_x
        corner_forces = forces[::2].copy()
        corner_forces[:-1] += forces[1::2] / 2
        corner_forces[1:] += forces[1::2] / 2
        traction = np.interp(x, x[::2], corner_forces / np.gradient(x[::2]))
        if self.surface.profile != "deformed":
            return traction
        return traction / np.hypot(*(np.gradient(part, x) for part in self.surface_positions.T))
