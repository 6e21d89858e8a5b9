"""Incremental rolling: equilibrium after each element of travel until the motion is steady.

Before a step all mix is convected towards the rear by one element (`RollerFrame`); then the roller, again at x = 0, is
brought into equilibrium. The prediction of a step is the displacement change of the last one, seen from the roller.
Artificial damping of departures from the prediction stabilises a bow wave in plastic flow; it is 0 in steady motion.
The tractions of the roller are multipliers and move with it. Convergence to the steady state is judged by the decay of
load, resistance and exit density (`extrapolate_tail`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from compact.engines.compaction.finite_strain_solid import FloatArray, SolidState
from compact.engines.compaction.heaping import HeapingError
from compact.engines.compaction.newton import Equilibrium, EquilibriumError, IncrementSolver, Progress
from compact.engines.compaction.roller_contact import ContactForces, ContactTractions, RollerSurface, RollingSurface
from compact.engines.compaction.roller_frame import RollerFrame
from compact.rolling_contact import GapGeometry

PENALTY = 0.15  # [-], normal penalty over unloading modulus/step
PENALTY_ROWS = 20  # [-], layer height over the largest length that limits the penalty
SLOWEST_DECAY = 0.97  # [-], largest ratio of successive changes that counts as a decay
PENALTY_REDUCTION = 0.1  # [-], factor of the penalty if an increment has no equilibrium
DAMPING = 0.02  # [-], share of the elastic stiffness; without it a high bow wave takes five times the iterations
FINAL_DAMPING_RATIO = 0.25  # [-], of the damping once the roller is at its height
MAX_HALVINGS = 3  # [-], halvings of a step that has no equilibrium
ROLLING_TOLERANCE = 1e-4  # [-], residual of a step over the nodal forces
MAX_TRAVEL = 12.0  # [-], travel over the layer height or contact length after which rolling is not steady
MAX_DAMPING_SHARE = 1e-2  # [-], of the nodal forces, that damping may still hold in steady motion
MIN_RESISTANCE = 1e-2  # [-], least scale of the resistance over the load, as of a second pass
HIGH_WAVE = 0.5  # [-], of the largest bow wave, from which the extrapolated wave is considered
EXTRAPOLATED_WAVE = 2.0  # [-], of the largest bow wave, extrapolated wave that ends rolling


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


def extrapolate_tail(values: Sequence[float] | FloatArray, window: int) -> tuple[float, float]:
    """Extrapolate a decaying series by the means of its last three windows.

    With the means a, b, c and r = (c - b)/(b - a), the limit is c + (c - b) r/(1 - r). A series without decay has r
    near 1 and a large remaining change.

    Parameters
    ----------
    values : array_like
        Series.
    window : int
        Number of values in a window.

    Returns
    -------
    limit : float
        Extrapolated limit.
    remaining : float
        Estimated remaining change; inf for a series shorter than three windows.
    """
    if len(values) < 3 * window:
        return values[-1], np.inf
    a, b, c = np.reshape(values[-3 * window :], (3, window)).mean(axis=1)
    if c == b:
        return values[-1], 0.0
    ratio = min(abs((c - b) / (b - a)), SLOWEST_DECAY) if b != a else SLOWEST_DECAY
    limit = c + (c - b) * ratio / (1 - ratio)
    return float(limit), float(abs(limit - values[-1]) + np.ptp(values[-window:]) * ratio)


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
    is_direct : bool
        True if the last step is a direct steady solve.
    failed_height : float or None
        Height of the lowest generatrix at which the direct steady solve failed [m].
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
        self.is_direct = False
        self.failed_height: float | None = None
        material, height, nodes = frame.solid.material, frame.mesh.height, frame.surface_nodes
        penalty = PENALTY * material.unloading_modulus / min(frame.step, height / PENALTY_ROWS)
        geometry = frame.nodes[nodes], frame.surface_weights, radius, height, penalty, np.zeros(len(nodes)), profile
        self.surface: RollerSurface = (
            RollerSurface(*geometry, friction)
            if torque is None
            else RollingSurface(*geometry, friction=friction, tangential_force=-torque / radius)
        )
        self.solver = IncrementSolver(frame.solid, nodes, ROLLING_TOLERANCE)
        self.state = frame.initial_state()
        self.displacement_change = np.zeros_like(self.state.displacement)
        self.steps: tuple[RollingStep, ...] = ()
        self.contact: ContactForces = self.surface.normal_contact(self.state.displacement[nodes])

    @property
    def window(self) -> int:
        """Steps in a window of `extrapolate_tail`: a third of the layer height or contact length, if longer."""
        length = max(self.frame.mesh.height, self.frame.contact_length)
        return max(4, int(np.ceil(length / (3 * self.frame.step))))

    @property
    def depth(self) -> float:
        """Depth of the lowest generatrix below the fed surface [m]."""
        return self.frame.mesh.height - self.steps[-1].bottom_height

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
        convected = self.frame.convect(self.state)
        prediction = self._predict(convected.displacement)
        surface = self._surface_before_step(self.surface, convected).moved_to(bottom_height)
        try:
            equilibrium = self.solver.solve(convected, surface, prediction, damping)
        except EquilibriumError:
            equilibrium = self._solve_with_soft_penalty(convected, prediction, bottom_height)
        self.displacement_change = equilibrium.state.displacement - convected.displacement
        self.is_direct = False
        return self._accept(equilibrium, bottom_height)

    def accept_steady(self, equilibrium: Equilibrium, bottom_height: float) -> RollingStep:
        """Continue from a direct steady solve.

        Parameters
        ----------
        equilibrium : Equilibrium
            Steady equilibrium.
        bottom_height : float
            Height of the lowest generatrix [m].

        Returns
        -------
        RollingStep
        """
        self._set_steady_change(equilibrium.state)
        self.is_direct = True
        return self._accept(equilibrium, bottom_height)

    def initialise_from(self, other: "IncrementalRolling", state: SolidState) -> None:
        """Continue from the state of another roller.

        Parameters
        ----------
        other : IncrementalRolling
            Other roller.
        state : SolidState
            Its state on the mesh of this frame.
        """
        x, old = (rolling.frame.nodes[rolling.frame.surface_nodes, 0] for rolling in (self, other))
        pressure, shear = (np.interp(x, old, values) for values in (other.contact.pressure, other.contact.shear))
        tractions = ContactTractions(pressure, shear, other.contact.creepage)
        self.state, self.steps = state, other.steps[-1:]
        self.is_direct, self.failed_height = other.is_direct, other.failed_height
        self.surface = self.surface.with_multipliers(tractions).moved_to(self.steps[-1].bottom_height)
        self._set_steady_change(state)

    def extrapolate(self, name: str) -> tuple[float, float]:
        """Return the steady value of a field of `RollingStep`, and its estimated remaining change."""
        values = [getattr(step, name) for step in self.steps]
        return (values[-1], 0.0) if self.is_direct else extrapolate_tail(values, self.window)

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

    def _set_steady_change(self, state: SolidState) -> None:
        self.displacement_change = state.displacement - self.frame.convect(state).displacement

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
        raise RuntimeError(f"step {len(self.steps) + 1} of rolling at depth {depth:.4g} mm: {reason}; {reached}")

    def _accept(self, equilibrium: Equilibrium, bottom_height: float) -> RollingStep:
        self.state, self.contact = equilibrium.state, equilibrium.contact
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
        )
        self.steps += (step,)
        if self.progress is not None:
            self.progress(
                f"{round(self.frame.contact_length / self.frame.step)} increments per contact length, step "
                f"{len(self.steps)}: travel {step.travel:.3g} m, bow wave {1e3 * step.bow_wave:.3g} mm, residual "
                f"{step.residual:.1e}"
            )
        return step

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


def roll_until_steady(rolling: IncrementalRolling, bottom_height: float, tolerance: float) -> None:
    """Roll at a height until load, resistance and exit density are steady; the last step has no damping.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller at any height; it is moved to the new one gradually.
    bottom_height : float
        Height of the lowest generatrix [m].
    tolerance : float
        Relative remaining change of load, resistance and exit density [-].

    Raises
    ------
    HeapingError
        If the bow wave exceeds the height of the largest contact angle.
    RuntimeError
        If the motion is not steady after MAX_TRAVEL, or a step has no equilibrium.
    """
    frame, window = rolling.frame, rolling.window
    steps_at_height = _count_steps_at(rolling, bottom_height)
    approach: Sequence[float] | FloatArray = [] if steps_at_height else _approach_heights(rolling, bottom_height)
    arrival = len(rolling.steps) + len(approach) - steps_at_height
    steps_to_exit = int(frame.exit_distance / frame.step)
    reach, steady_count = MAX_TRAVEL * max(frame.mesh.height, frame.contact_length), 0
    for k in range(int(reach / frame.step)):
        since_arrival = len(rolling.steps) + 1 - arrival
        damping = DAMPING if since_arrival <= window else FINAL_DAMPING_RATIO * DAMPING
        step = rolling.advance(approach[k] if k < len(approach) else bottom_height, damping)
        if k >= len(approach):
            require_low_wave(rolling, arrival)
        complete = since_arrival >= steps_to_exit + 3 * window and step.residual < MAX_DAMPING_SHARE
        steady_count = steady_count + 1 if complete and _remaining_change(rolling, arrival) < tolerance else 0
        if steady_count > window:  # a series has no change at its extrema
            rolling.advance(bottom_height, damping=0.0)
            return
    depth = 1e3 * (frame.mesh.height - bottom_height)
    raise RuntimeError(
        f"not steady at depth {depth:.4g} mm after {rolling.steps[-1].travel:.3g} m of travel and "
        f"{len(rolling.steps)} steps: remaining change {_percent(_remaining_change(rolling, arrival))} of load, "
        f"resistance or exit density, {_percent(step.residual)} of the forces held by damping; {describe_step(step)}"
    )


def require_low_wave(rolling: IncrementalRolling, arrival: int) -> None:
    """Require a bow wave that stays below the height of the largest contact angle.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller with its steps.
    arrival : int
        First step at the present height.

    Raises
    ------
    HeapingError
        If the bow wave is too high, or tends to be.
    """
    step, depth = rolling.steps[-1], rolling.depth
    limit = rolling.max_wave_height - depth
    wave, remaining = extrapolate_tail([s.bow_wave for s in rolling.steps[arrival:]], rolling.window)
    tends_beyond = step.bow_wave > HIGH_WAVE * limit and EXTRAPOLATED_WAVE * limit < wave and remaining < np.inf
    if step.bow_wave < limit and not tends_beyond:
        return
    growth = "exceeds" if step.bow_wave >= limit else f"tends to {1e3 * wave:.3g} mm, beyond"
    raise HeapingError(
        f"the mix heaps up in front of the roller at depth {1e3 * depth:.4g} mm: after {step.travel:.3g} m of travel "
        f"the bow wave {growth} {1e3 * limit:.3g} mm, at which the contact angle is too large for compaction; "
        f"{describe_step(step)}"
    )


def describe_step(step: RollingStep) -> str:
    """Return load, resistance and bow wave of a step for a message."""
    return f"load {step.load:.0f} N/m, resistance {step.resistance:.0f} N/m, bow wave {1e3 * step.bow_wave:.3g} mm"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 10 else "more than 1000 %"


def _count_steps_at(rolling: IncrementalRolling, bottom_height: float) -> int:
    """Count the last steps at a height, without the step that rolling was initialised from."""
    heights = np.array([step.bottom_height for step in rolling.steps[1:]])
    return int(np.argmax(np.append(heights[::-1] != bottom_height, True)))


def _approach_heights(rolling: IncrementalRolling, bottom_height: float) -> FloatArray:
    """Heights of the lowest generatrix of the steps to a new height."""
    start = rolling.steps[-1].bottom_height if rolling.steps else rolling.frame.mesh.height
    return np.linspace(start, bottom_height, rolling.window * (1 if rolling.steps else 2) + 1)[1:]


def _remaining_change(rolling: IncrementalRolling, arrival: int) -> float:
    """Estimated relative remaining change of load, resistance and exit density since the arrival at the height."""
    last = rolling.steps[-1]
    steps = rolling.steps[arrival:] or [last]
    resistance = max(abs(last.resistance), MIN_RESISTANCE * last.load)
    scale = {"load": last.load, "resistance": resistance, "exit_density_ratio": 1.0}
    return max(
        extrapolate_tail([getattr(step, name) for step in steps], rolling.window)[1] / scale[name] for name in scale
    )
