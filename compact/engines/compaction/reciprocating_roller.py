"""Roller on a mesh fixed to the mix, moved step by step in any direction.

Each step is an increment in equilibrium of the whole layer. The multiplier tractions move along the surface with the
roller, and the prediction of a step is the displacement change of the step one element before.

A step on the shear line of a `DruckerPragerCap` that has no equilibrium is solved with a carried pressure
(`drucker_prager_cap`), first that before the step, then half-way to that after it, until both agree.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_matrix

from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.incremental_rolling import (
    CARRIED_SHARE,
    PENALTY,
    PENALTY_REDUCTION,
    PENALTY_ROWS,
    IncrementalRolling,
    mean_pressure,
)
from compact.engines.compaction.newton import Equilibrium, IncrementSolver
from compact.engines.compaction.results import exit_layer, state_mesh
from compact.engines.compaction.roller_contact import ContactForces, ContactTractions, RollerSurface, RollingSurface
from compact.engines.compaction.roller_frame import LayerState, RollerFrame, rate_factor_at, stroke_mesh, transfer_state
from compact.engines.stroke_schedule import PLACE_TOLERANCE, STEP_LENGTH, Strokes
from compact.material.laws import Compaction, DruckerPragerCap
from compact.rolling_contact import EquilibriumError, Roller

if TYPE_CHECKING:
    import meshio

PRESSING_STEPS = 6  # [-], steps in which the roller is pressed to its depth
STEP_TOLERANCE = 1e-4  # [-], residual of a step over the nodal forces
MULTIPLIER_TOLERANCE = 0.01  # [-], change of a multiplier in an augmentation over the largest pressure
MAX_AUGMENTATIONS = 10  # [-], in a step; one in ten steps on thick layers ends with more, which the next steps reduce
MAX_CARRYING = 30  # [-], solutions of a step with a carried pressure; the differences halve
CARRIED_TOLERANCE = 0.01  # [-], mean of |p - p'| over the mean pressure of the contact
STEPS_PER_ELEMENT = round(1 / STEP_LENGTH)  # [-], steps with stored changes for the prediction


@dataclass(frozen=True)
class RollerState:
    """Position, forces and works of a roller; see `CompactionTransientResult`."""

    position: float
    bottom_height: float
    load: float
    resistance: float
    leading: float
    trailing: float
    angle: float
    input_work: float
    slip_work: float
    stored_work: float


@dataclass(frozen=True, eq=False)
class ReciprocatingCase:
    """Arguments of `simulate_reciprocating` that determine a roller.

    Parameters
    ----------
    roller, material : Roller, Compaction
        Roller and constitutive law.
    strokes : Strokes
        Motion, cut at its reversals.
    torque : float
        Torque per unit length on a rotating roller, + along its travel [N].
    element, contact_length : float
        Lengths of an element and of the contact [m].
    finite : bool
        True for finite strain.
    """

    roller: Roller
    material: Compaction
    strokes: Strokes
    torque: float
    element: float
    contact_length: float
    finite: bool


class ReciprocatingRoller:
    """Roller on one layer, at first just in touch with it.

    Parameters
    ----------
    case : ReciprocatingCase
        Roller, mix and strokes.
    height : float
        Height of the layer [m].
    fed_layer : LayerState or None
        Layer of an earlier pass, None for fresh mix.
    position : float
        x of the roller [m].
    """

    def __init__(self, case: ReciprocatingCase, height: float, fed_layer: LayerState | None, position: float) -> None:
        roller, strokes, element = case.roller, case.strokes, case.element
        self.strokes, self.element = strokes, element
        self.rotates = roller.rolling in ("free", "driven") and roller.friction > 0
        # for travel along +x: traction over pressure of a sliding roller, sum of the tractions of a rotating one
        self.traction_ratio = roller.friction if roller.rolling == "sliding" else 0.0
        self.tangential_force = -case.torque / roller.radius
        mesh = stroke_mesh(height, case.contact_length, element, round(strokes.span / element))
        self.frame = frame = RollerFrame(
            mesh, case.material, "bonded", case.contact_length, fed_layer=fed_layer, finite=case.finite
        )
        coordinates = frame.nodes[frame.surface_nodes] + [strokes.low, 0.0]
        penalty = PENALTY * case.material.unloading_modulus / min(element, height / PENALTY_ROWS)
        zero = np.zeros(len(coordinates))
        geometry = coordinates, frame.surface_weights, roller.radius, height, penalty, zero, roller.profile
        self.surface: RollerSurface = (
            RollingSurface(*geometry, position=float(position), friction=roller.friction, multiplier_shear=zero)
            if self.rotates
            else RollerSurface(*geometry, position=float(position))
        )
        self.solver = IncrementSolver(frame.solid, frame.surface_nodes, STEP_TOLERANCE)
        self.state, self.iterations = frame.initial_state(), 0
        self._past: list[_PastStep] = []
        self.contact = self.surface.normal_contact(self._surface_displacement())
        self.angle, self.input_work, self.slip_work, self.stored_work = 0.0, 0.0, 0.0, 0.0

    @property
    def is_set_valued(self) -> bool:
        """True if the friction or torque change sign with the travel."""
        return bool(self.traction_ratio or self.tangential_force)

    @property
    def roller_state(self) -> RollerState:
        """Present position, forces and works."""
        surface = self.surface
        x = surface.coordinates[:, 0] + self._surface_displacement()[:, 0] - surface.position
        touching, edges = np.flatnonzero(self.contact.pressure > 0), (np.nan, np.nan)
        if len(touching):
            first, last = touching[[0, -1]]
            edges = float(x[last] + x[last + 1]) / 2, float(x[first - 1] + x[first]) / 2
        forces = surface.load_and_resistance(self.contact)
        works = self.input_work, self.slip_work, self.stored_work
        return RollerState(surface.position, surface.bottom_height, *forces, *edges, self.angle, *works)

    @property
    def middle_layer(self) -> LayerState:
        """State of the layer in the middle of the stroke."""
        middle = int(np.searchsorted(self.frame.row_x, self.strokes.span / 2))
        return exit_layer(self.frame, self.state, middle)[0]

    @property
    def fields(self) -> "meshio.Mesh":
        """Fields of the layer as of `results.field_mesh`, a meshio mesh at the positions of the motion."""
        mesh = state_mesh(self.frame, self.state)
        mesh.points[:, 0] += self.strokes.low
        return mesh

    def initialise_from(self, solution: IncrementalRolling) -> None:
        """Continue from steady rolling with x = 0 at the lower end of the stroke.

        Parameters
        ----------
        solution : IncrementalRolling
            Steady solution.
        """
        x, old = (frame.nodes[frame.surface_nodes, 0] for frame in (self.frame, solution.frame))
        pressure, shear = (
            np.interp(x, old, traction, left=0.0, right=0.0)
            for traction in (solution.contact.pressure, solution.contact.shear)
        )
        self.state = transfer_state(solution.state, solution.frame, self.frame)
        surface = self._surface_along(1.0).with_multipliers(
            ContactTractions(pressure, shear, solution.contact.creepage)
        )
        surface = replace(surface, bottom_height=solution.steps[-1].bottom_height)
        self.surface = surface.begin_increment(self._surface_displacement())
        self.contact = self.surface.contact_forces(self._surface_displacement())

    def rate_factor(self, speed: float, bottom_height: float | None = None) -> float:
        """Return the factor of the yield pressure [-] at a speed [m/s] and a height [m], the present one by default."""
        frame, height = self.frame, self.frame.mesh.height
        depth = height - (self.surface.bottom_height if bottom_height is None else bottom_height)
        return rate_factor_at(frame.solid.material, self.surface.radius, height, depth, speed, frame.inflow)

    def press(self, bottom_height: float, speed: float, every: int = 1) -> None:
        """Press the roller down.

        Parameters
        ----------
        bottom_height : float
            Final height of the lowest generatrix [m].
        speed : float
            Speed of the stroke that follows [m/s].
        every : int
            1 for all steps, 2 for every second step.
        """
        factor = self.rate_factor(speed, bottom_height)
        for height in np.linspace(self.surface.bottom_height, bottom_height, PRESSING_STEPS + 1)[every::every]:
            self.move_to(self.surface.position, height, factor)

    def move_to(self, x: float, bottom_height: float, rate_factor: float) -> None:
        """Move the roller by one step.

        Parameters
        ----------
        x, bottom_height : float
            Position and height of the lowest generatrix after the step [m].
        rate_factor : float
            Factor of the yield pressure by the rate of compaction [-].
        """
        self._step(x, bottom_height, rate_factor, np.sign(x - self.surface.position))

    def reverse_friction(self, sign: float, rate_factor: float) -> None:
        """Apply the friction and torque of a travel along `sign` x [-] at rest, with a `rate_factor` [-]."""
        self._step(self.surface.position, self.surface.bottom_height, rate_factor, sign)

    def _surface_displacement(self) -> FloatArray:
        return self.state.displacement[self.frame.surface_nodes]

    def _step(self, x: float, bottom_height: float, rate_factor: float, sign: float) -> None:
        old, travel = self.surface, x - self.surface.position
        forces_before = old.load_and_resistance(self.contact)
        tractions, prediction = self._predict(travel)
        surface = self._surface_along(sign).with_multipliers(tractions)
        surface = surface.begin_increment(self._surface_displacement()).moved_to(bottom_height, x)
        self.frame.solid.rate_factor = rate_factor
        self.frame.solid.travel = abs(travel) or self.element
        equilibrium = self._solve_augmented(surface, self.state.displacement + prediction)
        contact, change = equilibrium.contact, equilibrium.state.displacement - self.state.displacement
        self._require_grip(surface, contact)
        rotation = 0.0 if contact.creep_travel is None else travel + contact.creep_travel
        load, resistance = np.add(forces_before, surface.load_and_resistance(contact)) / 2
        slip_work = self._slip_work(surface, equilibrium, change, travel, rotation)
        self.angle += rotation / surface.radius
        self.input_work += (
            resistance * travel
            - load * (bottom_height - old.bottom_height)
            - sign * self.tangential_force * rotation
            - slip_work
        )
        self.slip_work += slip_work
        self.stored_work += float(self.frame.solid.point_areas @ (equilibrium.state.work - self.state.work))
        self._past = [*self._past[1 - STEPS_PER_ELEMENT :], _PastStep(x, travel, contact, change)]
        self.state, self.contact = equilibrium.state, contact
        self.iterations += equilibrium.iterations
        self.surface = surface.with_multipliers(contact)

    def _surface_along(self, sign: float) -> RollerSurface:
        """Return the surface of a roller with travel along `sign` x, 0 for none."""
        if isinstance(self.surface, RollingSurface):
            return replace(self.surface, tangential_force=sign * self.tangential_force)
        return replace(self.surface, traction_ratio=sign * self.traction_ratio)

    def _predict(self, travel: float) -> tuple[ContactTractions, FloatArray]:
        """Predict tractions and displacement change: as one element before, or with the last tractions."""
        x, sign = self.surface.position + travel, np.sign(travel)
        shift, tractions = travel, self.contact
        change = np.zeros_like(self.state.displacement)
        for past in self._past:
            distance = abs(x - past.position - sign * self.element) + abs(travel - past.travel)
            if travel and distance < PLACE_TOLERANCE * self.element:
                shift, tractions = sign * self.element, past.contact
                change = self._shift_matrices[sign] @ past.displacement_change
        change.ravel()[self.frame.solid.fixed_dofs] = 0.0
        nodes = self.surface.coordinates[:, 0]
        pressure, shear = (
            np.interp(nodes - shift, nodes, traction) for traction in (tractions.pressure, tractions.shear)
        )
        return ContactTractions(pressure, shear, self.contact.creepage), change

    @cached_property
    def _shift_matrices(self) -> dict[float, csr_matrix]:
        """Matrices that shift nodal fields by one element, by the sign of the travel."""
        (x, y), probes = self.frame.nodes.T, self.frame.solid.basis.probes
        low, high = x.min(), x.max()
        return {sign: probes(np.array([np.clip(x - sign * self.element, low, high), y])) for sign in (1.0, -1.0)}

    def _solve_augmented(self, surface: RollerSurface, guess: FloatArray) -> Equilibrium:
        """Solve a step, with updates of the multipliers until they no longer change."""
        iterations = 0
        for _ in range(MAX_AUGMENTATIONS):
            equilibrium = self._solve_penalised(surface, guess)
            iterations += equilibrium.iterations
            contact = equilibrium.contact
            if surface.multiplier_error(contact) <= MULTIPLIER_TOLERANCE * contact.pressure.max():
                break
            surface, guess = surface.with_multipliers(contact), equilibrium.state.displacement
        return replace(equilibrium, iterations=iterations)

    def _solve_penalised(self, surface: RollerSurface, guess: FloatArray) -> Equilibrium:
        """Solve a step with constant multipliers, with a lower penalty if necessary."""
        try:
            return self.solver.solve(self.state, surface, guess)
        except EquilibriumError:
            self.solver.solve_tangent = None
        try:
            soft = replace(surface, penalty=PENALTY_REDUCTION * surface.penalty)
            if isinstance(self.frame.solid.material, DruckerPragerCap):
                return self._solve_carrying(surface)
            return self.solver.solve(self.state, soft, self.state.displacement)
        except EquilibriumError as reason:
            load, resistance = self.surface.load_and_resistance(self.contact)
            raise RuntimeError(
                f"step from {self.surface.position:.6g} to {surface.position:.6g} m, lowest generatrix at "
                f"{surface.bottom_height:.6g} m: {reason}; last step: load {load:.6g} N/m, resistance "
                f"{resistance:.6g} N/m"
            ) from reason

    def _solve_carrying(self, surface: RollerSurface) -> Equilibrium:
        """Solve a step with the carried pressure that equals the pressure after it."""
        carried, guess, iterations = mean_pressure(self.state), self.state.displacement, 0
        for _ in range(MAX_CARRYING):
            found = self.solver.solve(replace(self.state, carried_pressure=carried), surface, guess)
            after = mean_pressure(found.state)
            guess, iterations = found.state.displacement, iterations + found.iterations
            if np.abs(after - carried).mean() < CARRIED_TOLERANCE * np.abs(after).mean():
                state = replace(found.state, carried_pressure=None)
                return replace(found, state=state, iterations=iterations)
            carried = carried + CARRIED_SHARE * (after - carried)
        raise EquilibriumError(f"no equilibrium: the pressure on the shear line changes after {MAX_CARRYING} solutions")

    def _require_grip(self, surface: RollerSurface, contact: ContactForces) -> None:
        """Require a torque within the friction limit; the creepage of a skidding roller is undetermined."""
        if not isinstance(surface, RollingSurface) or not surface.tangential_force:
            return
        utilisation = surface.friction_utilisation(contact)
        if utilisation >= 1:
            raise RuntimeError(
                f"the roller skids at {surface.position:.6g} m: the torque requires {utilisation:.3g} times the "
                "friction limit; reduce the torque"
            )

    def _slip_work(self, surface, equilibrium, change, travel, rotation):
        """Return the work of slip along the roller surface, which has moved back by `rotation` [m] [J/m]."""
        nodes = self.frame.surface_nodes
        slip = np.array([travel, 0.0]) - change[nodes]
        along = np.sum(surface.tangents(equilibrium.state.displacement[nodes]) * slip, axis=1) - rotation
        return surface.weights * (self.contact.shear + equilibrium.contact.shear) / 2 @ along


@dataclass(frozen=True, eq=False)
class _PastStep:
    """Position, travel [m], contact and displacement change [m] of a step."""

    position: float
    travel: float
    contact: ContactForces
    displacement_change: FloatArray
