"""Incremental rolling: equilibrium after each element of travel.

Before a step all mix is convected towards the rear by one element (`RollerFrame`); then the roller, again at x = 0, is
brought into equilibrium. The prediction of a step is the displacement change of the last one, seen from the roller.
Artificial damping of departures from the prediction stabilises a bow wave in plastic flow; it is 0 in steady motion.
The tractions of the roller are multipliers and move with it. `steady_search` decides how far to roll.

The shear line of a `DruckerPragerCap` has no associated flow, so that increments on it need not converge. The pressure
that limits shear in a step is therefore carried over from the same place in the last steps (`drucker_prager_cap`),

    p' <- p' + (p - p')/2,

half of the change at a time, since p' would oscillate from step to step. In steady motion p' = p.
"""

from dataclasses import dataclass, replace

import numpy as np

from compact.engines.compaction.finite_strain_solid import FloatArray, SolidState
from compact.engines.compaction.newton import Equilibrium, IncrementSolver, Progress
from compact.engines.compaction.roller_contact import (
    ContactForces,
    ContactTractions,
    RollerSurface,
    RollingSurface,
)
from compact.engines.compaction.roller_frame import RollerFrame
from compact.material.laws import DruckerPragerCap
from compact.rolling_contact import EquilibriumError, GapGeometry, Heaping, HeapingError

PENALTY = 0.15  # [-], normal penalty over unloading modulus/step
PENALTY_ROWS = 20  # [-], layer height over the largest length that limits the penalty
PENALTY_REDUCTION = 0.1  # [-], factor of the penalty if an increment has no equilibrium
DAMPING = 0.02  # [-], share of the elastic stiffness; without it a high bow wave takes five times the iterations
FINAL_DAMPING_RATIO = 0.25  # [-], of the damping once the roller is at its height
MAX_HALVINGS = 3  # [-], halvings of a step that has no equilibrium
ROLLING_TOLERANCE = 1e-4  # [-], residual of a step over the nodal forces
CARRIED_SHARE = 0.5  # [-], of the change of the carried pressure in a step; with 1 it oscillates
PREDICTION_TAPER = 0.5  # [-], distance ahead of the roller over the contact length from which jumps are predicted


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


class IncrementalRolling:
    """Roller in a `RollerFrame`, moved by one element in each step.

    Parameters
    ----------
    frame : RollerFrame
        Mesh with its inflow.
    radius : float
        Roller radius [m].
    profile : {"deformed", "circle", "parabola"}
        Geometry of the gap.
    friction : float
        Coulomb's coefficient of a rotating roller, else the traction ratio of a sliding one [-].
    torque : float or None
        Torque on a rotating roller, + along the travel [N]; None for a roller that does not rotate.
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
        radius: float,
        *,
        profile: GapGeometry = "deformed",
        friction: float = 0.0,
        torque: float | None = None,
        max_wave_height: float = np.inf,
        progress: Progress | None = None,
    ) -> None:
        self.frame, self.max_wave_height, self.progress = frame, max_wave_height, progress
        material, height, nodes = frame.solid.material, frame.mesh.height, frame.surface_nodes
        penalty = PENALTY * material.unloading_modulus / min(frame.step, height / PENALTY_ROWS)
        geometry = frame.nodes[nodes], frame.surface_weights, radius, height, penalty, np.zeros(len(nodes)), profile
        self.surface: RollerSurface = RollerSurface(*geometry, friction)
        if torque is not None:
            self.surface = RollingSurface(*geometry, friction=friction, tangential_force=-torque / radius)
        self.solver = IncrementSolver(frame.solid, nodes, ROLLING_TOLERANCE)
        self.state = frame.initial_state()
        self.displacement_change = np.zeros_like(self.state.displacement)
        self.carried_pressure: FloatArray | None = None
        self.steps: tuple[RollingStep, ...] = ()
        self.contact: ContactForces = self.surface.normal_contact(self.state.displacement[nodes])

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
        convected = replace(self.frame.convect(self.state), carried_pressure=self._pressure_of_last_step())
        prediction = self._predict(convected.displacement)
        surface = self._surface_before_step(self.surface, convected).moved_to(bottom_height)
        try:
            equilibrium = self.solver.solve(convected, surface, prediction, damping)
        except EquilibriumError:
            equilibrium = self._solve_with_soft_penalty(convected, prediction, bottom_height)
        self.displacement_change = equilibrium.state.displacement - convected.displacement
        return self._accept(equilibrium, bottom_height)

    def initialise_from(self, other: "IncrementalRolling", state: SolidState, depth: float | None = None) -> None:
        """Continue from the state of another roller.

        Parameters
        ----------
        other : IncrementalRolling
            Other roller.
        state : SolidState
            Its state on the mesh of this frame.
        depth : float, optional
            Depth of the state [m]; that of the other roller by default.
        """
        x, old = (rolling.frame.nodes[rolling.frame.surface_nodes, 0] for rolling in (self, other))
        if depth is not None:  # stretched node by node
            old = x
        pressure, shear = (np.interp(x, old, values) for values in (other.contact.pressure, other.contact.shear))
        height = self.frame.mesh.height - (other.depth if depth is None else depth)
        self.steps = (replace(other.steps[-1], bottom_height=height),)
        self.surface = self.surface.moved_to(self.steps[-1].bottom_height)
        self.restart(state, ContactTractions(pressure, shear, other.contact.creepage))
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

    def _pressure_of_last_step(self) -> FloatArray | None:
        """Return the carried pressure of a step, if the mix has a shear line [Pa]."""
        if not isinstance(self.frame.solid.material, DruckerPragerCap):
            return None
        return mean_pressure(self.state) if self.carried_pressure is None else self.carried_pressure

    def _predict(self, convected: FloatArray) -> FloatArray:
        """Predict the displacement with the change of the last step."""
        prediction = convected + self.displacement_change
        fixed = self.frame.solid.fixed_dofs
        prediction.ravel()[fixed] = convected.ravel()[fixed]
        return prediction

    def _surface_before_step(self, surface: RollerSurface, convected: SolidState) -> RollerSurface:
        """Return the roller one element back on the convected mix."""
        back = surface.moved_to(surface.bottom_height, -self.frame.step)
        return back.begin_increment(convected.displacement[self.frame.surface_nodes])

    def _solve_with_soft_penalty(self, convected, prediction, bottom_height):
        """Solve a step with a lower penalty, if necessary in substeps; the multipliers compensate it later."""
        soft = replace(self.surface, penalty=self.surface.penalty * PENALTY_REDUCTION)
        self.solver.solve_tangent = None
        surface = self._surface_before_step(soft, convected).moved_to(bottom_height)
        try:
            return self.solver.solve(convected, surface, prediction)
        except EquilibriumError:
            return self._solve_in_substeps(convected, soft, bottom_height)

    def _solve_in_substeps(self, convected, surface, bottom_height):
        """Solve a step in halves, quarters and eighths."""
        start, step = surface.bottom_height, self.frame.step
        for halving in range(1, MAX_HALVINGS + 1):
            parts, iterations, state, moved = 2**halving, 0, convected, surface.moved_to(start, -step)
            try:
                for k in range(1, parts + 1):
                    moved = moved.begin_increment(state.displacement[self.frame.surface_nodes])
                    moved = moved.moved_to(start + (bottom_height - start) * k / parts, step * (k / parts - 1))
                    equilibrium = self.solver.solve(state, moved, state.displacement)
                    state, iterations = equilibrium.state, iterations + equilibrium.iterations
                return replace(equilibrium, iterations=iterations)
            except EquilibriumError as error:
                reason = error
        depth, reached = 1e3 * (self.frame.mesh.height - bottom_height), "no step converged before"
        if self.steps:
            reached = f"last step: travel {self.steps[-1].travel:.3g} m, {describe_step(self.steps[-1])}"
        raise EquilibriumError(f"step {len(self.steps) + 1} of rolling at depth {depth:.4g} mm: {reason}; {reached}")

    def _accept(self, equilibrium: Equilibrium, bottom_height: float) -> RollingStep:
        self.state, self.contact = equilibrium.state, equilibrium.contact
        if self.state.carried_pressure is not None:
            before = self.state.carried_pressure
            self.carried_pressure = before + CARRIED_SHARE * (mean_pressure(self.state) - before)
        self.surface = self.surface.with_multipliers(self.contact).moved_to(bottom_height)
        travel = self.steps[-1].travel if self.steps else 0.0
        load, resistance = self.load_and_resistance()
        step = RollingStep(
            travel=travel + self.frame.step,
            bottom_height=bottom_height,
            load=load,
            resistance=resistance,
            exit_density_ratio=self.frame.exit_density_ratio(equilibrium.state.points.density_ratio),
            peak_pressure=float(self.surface_pressure.max()),
            iterations=equilibrium.iterations,
            residual=equilibrium.residual,
            bow_wave=float(self.surface_positions[:, 1].max() - self.frame.mesh.height),
            wave_area=self._wave_area(),
        )
        self.steps += (step,)
        if self.progress is not None:
            self.progress(
                f"{round(self.frame.contact_length / self.frame.step)} increments per contact length, step "
                f"{len(self.steps)}: travel {step.travel:.3g} m, bow wave {1e3 * step.bow_wave:.3g} mm, residual "
                f"{step.residual:.1e}"
            )
        return step

    def _wave_area(self) -> float:
        """Area between the risen surface ahead of the roller and the fed layer [m2]."""
        x, y = self.surface_positions.T
        return float(np.trapezoid(np.where(x > 0, np.maximum(y - self.frame.mesh.height, 0.0), 0.0), x))

    def _surface_traction(self, nodal: FloatArray) -> FloatArray:
        """Return a traction on the deformed surface, linear between corners; midside nodes oscillate about it."""
        forces, x = self.surface.weights * nodal, self.frame.nodes[self.frame.surface_nodes, 0]
        corner_forces = forces[::2].copy()
        corner_forces[:-1] += forces[1::2] / 2
        corner_forces[1:] += forces[1::2] / 2
        traction = np.interp(x, x[::2], corner_forces / np.gradient(x[::2]))
        if self.surface.profile != "deformed":
            return traction
        return traction / np.hypot(*(np.gradient(part, x) for part in self.surface_positions.T))


def mean_pressure(state: SolidState) -> FloatArray:
    """Return the mean pressures of the Gauss points [Pa], shape (n,)."""
    return np.asarray(-state.points.stress[:, :3].mean(axis=1))


def require_low_wave(rolling: IncrementalRolling) -> None:
    """Require a bow wave below the height of the largest contact angle.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller with its steps.

    Raises
    ------
    HeapingError
        If the bow wave is too high.
    """
    step, limit = rolling.steps[-1], rolling.max_wave_height - rolling.depth
    if step.bow_wave >= limit:
        raise heaping_error(rolling, f"exceeds {1e3 * limit:.3g} mm, at which the contact angle is too large")


def heaping_error(rolling: IncrementalRolling, wave: str) -> HeapingError:
    """Return the error of a bow wave that has no steady state.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller with its steps.
    wave : str
        Clause about the bow wave.
    """
    step = rolling.steps[-1]
    edge = np.clip((rolling.depth + step.bow_wave) / rolling.surface.radius, 0.0, 2.0)
    heaping = Heaping(rolling.depth, float(np.arccos(1 - edge)), step.bow_wave, step.travel)
    return HeapingError(
        f"the mix heaps up in front of the roller at depth {1e3 * rolling.depth:.4g} mm: after {step.travel:.3g} m of "
        f"travel the bow wave {wave}; {describe_step(step)}",
        heaping,
    )


def describe_step(step: RollingStep) -> str:
    """Return load, resistance and bow wave of a step for a message."""
    return f"load {step.load:.0f} N/m, resistance {step.resistance:.0f} N/m, bow wave {1e3 * step.bow_wave:.3g} mm"
