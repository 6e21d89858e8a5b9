"""Roller in reciprocating motion over compacting mix, on a mesh fixed to the mix.

    position x_0, x_1, ...: each step is an increment in equilibrium of the whole layer

The mesh covers the stroke and a length beyond its ends, and the roller moves over it. No state is convected, so that
the return stroke needs no special treatment. The multiplier tractions move along the surface with the roller by whole
elements; the prediction of a step is the displacement change of the step one element before. Mix without rate effect
depends on the path alone; with it, the yield pressure follows the rate of compaction at the mean |v| of each step.
Nothing changes while the roller is at rest.

Steps are quarter elements, as long as the parts of a step of `rolling`; after a reversal they begin with 1/16 of an
element. The error estimate is the change from steps twice as long on the same mesh. The forces oscillate within each
element as its nodes enter the contact: with 8 elements per contact length by 0.9 % of the load. A step on
the shear line of a `DruckerPragerCap` that has no equilibrium is solved with a carried pressure (`drucker_prager_cap`),
first that before the step, then half-way to that after it, until both agree.

Friction
    A rotating roller has Coulomb friction with stick and slip; its rotation follows from the torque
    (`roller_contact`). At a reversal nothing jumps: the whole contact sticks until slip begins again. A sliding roller
    has the traction f p along its travel, which is set-valued at v = 0, like a torque that changes sign with the
    travel. The instant of a reversal then appears twice, before and after. The change of sign moves the mix while the
    roller is at rest, and the slip work may decrease by that work.

Range
    2 mm depth in 0.1 m, 7 elements per contact length, free with friction 0.3: mean load and resistance of each element
    within the told error of steady rolling after twenty contact lengths, in which the bow wave relaxes. Layers on
    a frictionless base and rollers with a prescribed load are refused.

Lifts
    Between two strokes a lift of fresh mix may be added on a flat layer of rows in the state of the middle of the
    stroke; then the roller is pressed to its indentation below the new surface. The ends of the stroke, about as long
    as the contact, are approximated by the middle; `contact_cases.passes` is the reference. With an `edge_distance` the
    roller stays down: at each reversal mix in the fed state is laid behind it up to the fed height (`laid_state`), so
    that it returns on its own track and then meets the layer of the stroke before (`studies/reversal.py`).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy.sparse import csr_matrix
from threadpoolctl import threadpool_limits

from compact.engines.compaction.engine import CompactionContactResult, require_compactable
from compact.engines.compaction.increment_solver import Equilibrium, IncrementSolver
from compact.engines.compaction.layer_state import LayerState, rate_factor_at
from compact.engines.compaction.roller_contact import ContactForces, ContactTractions, RollerSurface
from compact.engines.compaction.roller_frame import RollerFrame, laid_state, rolling_mesh, transfer_state
from compact.engines.compaction.rolling import CARRIED_SHARE, MIN_SUBSTEPS, IncrementalRolling, roller_surface
from compact.engines.stroke_schedule import PLACE_TOLERANCE, STEP_LENGTH, Strokes, stroke_schedule
from compact.material.laws import Compaction, DruckerPragerCap
from compact.numerics import Array, IntArray
from compact.numerics.validation import require_finite, require_integers, require_known, require_nonnegative
from compact.rolling_contact import EquilibriumError, Layer, PrescribedMotion, Roller, require_torque_allowed

if TYPE_CHECKING:
    import meshio

SHORTEST_STEP = 1 / 32  # [-], of an element; longer steps without equilibrium are halved
PRESSING_STEPS = 6  # [-], steps in which the roller is pressed to its depth
STEP_TOLERANCE = 1e-4  # [-], residual of a step over the nodal forces
MULTIPLIER_TOLERANCE = 0.01  # [-], change of a multiplier in an augmentation over the largest pressure
MAX_AUGMENTATIONS = 10  # [-], in a step; one in ten steps on thick layers ends with more, which the next steps reduce
MAX_CARRYING = 30  # [-], solutions of a step with a carried pressure; the differences halve
CARRIED_TOLERANCE = 0.01  # [-], mean of |p - p'| over the mean pressure of the contact
INCREMENTS = 6  # [-], elements per contact length sqrt(2 R depth)
STEPS_PER_ELEMENT = round(1 / STEP_LENGTH)  # [-], steps with stored changes for the prediction


@dataclass(frozen=True, kw_only=True)
class ReciprocatingNumerics:
    """Options of `simulate_reciprocating`.

    Parameters
    ----------
    strain : {"finite", "small"}
        Strain measure.
    increments : int
        Elements per contact length; each is travelled in four steps.
    instants : sequence of float
        Times at which fields are kept as `frames`, each at the nearest end of a step [s].
    estimate : bool
        True for an error estimate from steps twice as long, at half as much work again.
    edge_distance : float, optional
        Distance from the axle back to the edge of fresh mix that is laid at each reversal [m], at least the contact
        length; none is laid by default.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    strain: Literal["finite", "small"] = "finite"
    increments: int = INCREMENTS
    instants: Sequence[float] = ()
    estimate: bool = True
    edge_distance: float | None = None

    def __post_init__(self) -> None:
        require_known("strain", self.strain, ("finite", "small"))
        require_integers(increments=self.increments)
        require_finite(instants=self.instants)


@dataclass(frozen=True, eq=False, kw_only=True)
class CompactionTransientResult:
    """Rolling of one roller over compacting mix by a motion, per unit roller length, at the ends of the n time steps.

    If a lift is added, or friction or torque change sign, the instant of a reversal appears twice, before and after.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Time from 0 on [s].
    position, velocity : ndarray, shape (n,)
        Position [m] and velocity [m/s] of the motion.
    load : ndarray, shape (n,)
        Normal force P [N/m].
    resistance : ndarray, shape (n,)
        Minus the x-force of the mix on the roller [N/m], positive against a motion along +x, in the fixed x axis.
    leading, trailing : ndarray, shape (n,)
        Contact edges at larger and at smaller x, from the lowest point [m], in either direction of travel.
    error : float, optional
        Estimated time-integration error of the resistance, the largest over the largest |resistance| [-].
    steps : int
        Number of time steps solved, those of the estimate included.
    frames : tuple of (float, meshio.Mesh)
        Time [s] and fields at each requested instant.
    stroke : ndarray, shape (n,)
        Number of the stroke, from 1.
    bottom_height : ndarray, shape (n,)
        Height of the lowest generatrix [m].
    angle : ndarray, shape (n,)
        Rotation of the roller [rad], + as it rolls along +x; 0 without rotation.
    input_work : ndarray, shape (n,)
        Work of the roller without slip work, int resistance dx - int load d(bottom height) + int torque dangle [J/m].
    slip_work : ndarray, shape (n,)
        Work of slip [J/m].
    stored_work : ndarray, shape (n,)
        Work of deformation of the layer, int J sigma : d strain [J/m].
    exit_layers : tuple of LayerState
        State in the middle of the stroke, after each stroke.
    iterations : int
        Newton iterations of all steps.
    """

    time: Array
    position: Array
    velocity: Array
    load: Array
    resistance: Array
    leading: Array
    trailing: Array
    error: float | None
    steps: int
    frames: tuple[tuple[float, Any], ...]
    stroke: IntArray
    bottom_height: Array
    angle: Array
    input_work: Array
    slip_work: Array
    stored_work: Array
    exit_layers: tuple[LayerState, ...]
    iterations: int

    def __post_init__(self) -> None:
        require_finite(load=self.load, resistance=self.resistance)

    @property
    def work_residual(self) -> float:
        """Largest difference of input and stored work over the largest input work [-]."""
        return float(np.abs(self.input_work - self.stored_work).max() / np.abs(self.input_work).max())

    @property
    def density_ratio(self) -> tuple[float, ...]:
        """Mean density ratios over the height in the middle of the stroke, after each stroke [-]."""
        return tuple(layer.density_ratio for layer in self.exit_layers)


class ReciprocatingRoller:
    """Roller on one layer, at first just in touch with it.

    Parameters
    ----------
    frame : RollerFrame
        Mesh of the layer, along the whole stroke.
    roller : Roller
        Roller of a constant indentation.
    strokes : Strokes
        Motion, cut at its reversals.
    torque : float
        Torque per unit length on a rotating roller, + along its travel [N].
    position : float
        x of the roller [m].

    Attributes
    ----------
    is_set_valued : bool
        True if the friction or torque change sign with the travel.
    """

    def __init__(
        self, frame: RollerFrame, roller: Roller, strokes: Strokes, torque: float = 0.0, position: float = 0.0
    ) -> None:
        self.frame, self.strokes = frame, strokes
        frame.solid.substeps = MIN_SUBSTEPS  # as in a part of `rolling`
        self.surface = roller_surface(frame, roller, torque, low=strokes.low, position=float(position))
        self._friction, self._tangential_force = self.surface.friction, self.surface.tangential_force  # along +x
        self.is_set_valued = bool(self._tangential_force if self.surface.rotates else self._friction)
        self.solver = IncrementSolver(frame.solid, frame.surface_nodes, STEP_TOLERANCE)
        self.state = frame.initial_state()
        self._past: list[tuple[float, float, ContactForces, Array]] = []  # place, travel, contact, change of steps
        self.contact = self.surface.normal_contact(self._surface_displacement)
        self.angle, self.input_work, self.slip_work, self.stored_work = 0.0, 0.0, 0.0, 0.0

    @property
    def record(self) -> dict[str, float]:
        """Present position, forces and works, by the names of `CompactionTransientResult`."""
        surface = self.surface
        x = surface.coordinates[:, 0] + self._surface_displacement[:, 0] - surface.position
        touching, leading, trailing = np.flatnonzero(self.contact.pressure > 0), np.nan, np.nan
        if len(touching):
            first, last = touching[[0, -1]]
            leading, trailing = float(x[last] + x[last + 1]) / 2, float(x[first - 1] + x[first]) / 2
        load, resistance = surface.load_and_resistance(self.contact)
        return {
            "position": surface.position, "bottom_height": surface.bottom_height, "load": load,
            "resistance": resistance, "leading": leading, "trailing": trailing, "angle": self.angle,
            "input_work": self.input_work, "slip_work": self.slip_work, "stored_work": self.stored_work,
        }  # fmt: skip

    @property
    def fields(self) -> "meshio.Mesh":
        """Fields of the layer as of `RollerFrame.field_mesh`, a meshio mesh at the positions of the motion."""
        mesh = self.frame.field_mesh(self.state)
        mesh.points[:, 0] += self.strokes.low
        return mesh

    def initialise_from(self, solution: IncrementalRolling) -> None:
        """Continue from a steady solution at the position of the roller."""
        shift = self.surface.position - self.strokes.low
        tractions = solution.contact.at(self.frame.surface_x - shift, solution.frame.surface_x)
        self.state = transfer_state(solution.state, solution.frame, self.frame, shift)
        surface = replace(self._surface_along(1.0), bottom_height=solution.steps[-1].bottom_height)
        self.surface = replace(surface, multipliers=tractions).begin_increment(self._surface_displacement)
        self.contact = self.surface.contact_forces(self._surface_displacement)

    def rate_factor(self, speed: float, bottom_height: float | None = None) -> float:
        """Return the factor of the yield pressure [-] at a speed [m/s] and a height [m], the present one by default."""
        frame, height = self.frame, self.frame.mesh.height
        depth = height - (self.surface.bottom_height if bottom_height is None else bottom_height)
        return rate_factor_at(frame.solid.material, self.surface.radius, height, depth, speed, frame.inflow)

    def lay_mix(self, distance: float, side: float) -> None:
        """Lay mix beyond an edge at a distance [m] from the axle, towards a sign of x, see `laid_state`."""
        edge = self.surface.position - self.strokes.low + side * distance
        self.state, self._past = laid_state(self.state, self.frame, edge, side), []

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

    def move_to(self, x: float, bottom_height: float, rate_factor: float, sign: float | None = None) -> None:
        """Move the roller by one step.

        Parameters
        ----------
        x, bottom_height : float
            Position and height of the lowest generatrix after the step [m].
        rate_factor : float
            Factor of the yield pressure [-].
        sign : float, optional
            Direction of friction and torque along x [-]; that of the step by default.
        """
        old, travel, solid, nodes = self.surface, x - self.surface.position, self.frame.solid, self.frame.surface_nodes
        sign = float(np.sign(travel)) if sign is None else sign
        forces_before = old.load_and_resistance(self.contact)
        tractions, prediction = self._predict(travel)
        surface = replace(self._surface_along(sign), multipliers=tractions)
        surface = surface.begin_increment(self._surface_displacement).moved_to(bottom_height, x)
        solid.rate_factor, solid.travel = rate_factor, abs(travel) or self.frame.step
        try:
            equilibrium = self._solve_augmented(surface, self.state.displacement + prediction)
        except EquilibriumError as reason:
            if abs(travel) > SHORTEST_STEP * self.frame.step:  # in halves
                for share in (0.5, 1.0):
                    height = old.bottom_height + share * (bottom_height - old.bottom_height)
                    self.move_to(old.position + share * travel, height, rate_factor, sign)
                return
            raise RuntimeError(
                f"step from {old.position:.6g} to {x:.6g} m, lowest generatrix at {bottom_height:.6g} m: {reason}; "
                f"last step: load {forces_before[0]:.6g} N/m, resistance {forces_before[1]:.6g} N/m"
            ) from reason
        contact, change = equilibrium.contact, equilibrium.state.displacement - self.state.displacement
        surface.require_friction(contact, f" at {x:.6g} m")
        rotation = 0.0 if contact.creep_travel is None else travel + contact.creep_travel
        load, resistance = np.add(forces_before, surface.load_and_resistance(contact)) / 2
        # of slip along the roller surface, which has moved back by the rotation
        slip = np.array([travel, 0.0]) - change[nodes]
        along = np.sum(surface.tangents(equilibrium.state.displacement[nodes]) * slip, axis=1) - rotation
        slip_work = surface.weights * (self.contact.shear + contact.shear) / 2 @ along
        self.angle += rotation / surface.radius
        pressed = load * (bottom_height - old.bottom_height)
        driven = sign * (self._tangential_force or 0.0) * rotation
        self.input_work += resistance * travel - pressed - driven - slip_work
        self.slip_work += slip_work
        self.stored_work += float(solid.point_areas @ (equilibrium.state.work - self.state.work))
        self._past = [*self._past[1 - STEPS_PER_ELEMENT :], (x, travel, contact, change)]
        self.state, self.contact = equilibrium.state, contact
        self.surface = replace(surface, multipliers=contact)

    @property
    def _surface_displacement(self) -> Array:
        return self.state.displacement[self.frame.surface_nodes]

    def _surface_along(self, sign: float) -> RollerSurface:
        """Return the surface of a roller with travel along `sign` x, 0 for none."""
        if self._tangential_force is not None:
            return replace(self.surface, tangential_force=sign * self._tangential_force)
        return replace(self.surface, friction=sign * self._friction)

    def _predict(self, travel: float) -> tuple[ContactTractions, Array]:
        """Predict tractions and displacement change: as one element before, or with the last tractions."""
        x, sign, element = self.surface.position + travel, np.sign(travel), self.frame.step
        shift, tractions = travel, self.contact
        change = np.zeros_like(self.state.displacement)
        for place, past_travel, contact, past_change in self._past:
            distance = abs(x - place - sign * element) + abs(travel - past_travel)
            if travel and distance < PLACE_TOLERANCE * element:
                shift, tractions, change = sign * element, contact, self._shift_matrices[sign] @ past_change
        change.ravel()[self.frame.solid.fixed_dofs] = 0.0
        nodes = self.surface.coordinates[:, 0]
        return replace(tractions.at(nodes - shift, nodes), creepage=self.contact.creepage), change

    @cached_property
    def _shift_matrices(self) -> dict[float, csr_matrix]:
        """Matrices that shift nodal fields by one element, by the sign of the travel."""
        (x, y), probes = self.frame.nodes.T, self.frame.solid.basis.probes
        low, high = x.min(), x.max()
        return {sign: probes(np.array([np.clip(x - sign * self.frame.step, low, high), y])) for sign in (1.0, -1.0)}

    def _solve_augmented(self, surface: RollerSurface, guess: Array) -> Equilibrium:
        """Solve a step, with updates of the multipliers until they no longer change."""
        for _ in range(MAX_AUGMENTATIONS):
            try:
                equilibrium = self.solver.solve(self.state, surface, guess)
            except EquilibriumError:
                self.solver.solve_tangent = None
                if not isinstance(self.frame.solid.material, DruckerPragerCap):
                    raise
                equilibrium = self._solve_carrying(surface)
            contact = equilibrium.contact
            if surface.multiplier_error(contact) <= MULTIPLIER_TOLERANCE * contact.pressure.max():
                break
            surface, guess = replace(surface, multipliers=contact), equilibrium.state.displacement
        return equilibrium

    def _solve_carrying(self, surface: RollerSurface) -> Equilibrium:
        """Solve a step with the carried pressure that equals the pressure after it."""
        carried, guess = self.state.points.pressure, self.state.displacement
        for _ in range(MAX_CARRYING):
            found = self.solver.solve(replace(self.state, carried_pressure=carried), surface, guess)
            after = found.state.points.pressure
            if np.abs(after - carried).mean() < CARRIED_TOLERANCE * np.abs(after).mean():
                return replace(found, state=replace(found.state, carried_pressure=None))
            guess = found.state.displacement
            carried = carried + CARRIED_SHARE * (after - carried)
        raise EquilibriumError(f"no equilibrium: the pressure on the shear line changes after {MAX_CARRYING} solutions")


def simulate_reciprocating(
    layer: Layer,
    roller: Roller,
    material: Compaction,
    motion: PrescribedMotion,
    *,
    torque: float | None = None,
    lift_thickness: float = 0.0,
    fed_layer: LayerState | None = None,
    start: CompactionContactResult | None = None,
    **options: Any,
) -> CompactionTransientResult:
    """Simulate the motion of a roller at a constant indentation over compacting mix.

    The motion begins with the roller pressed into flat mix at rest, or in steady motion from a `start`.

    Parameters
    ----------
    layer : Layer
        Bonded layer with the height of the mix before the first stroke.
    roller : Roller
        Roller with an `indentation`, of any profile. A sliding one has the traction f p on the mix along the travel; a
        free or driven one sticks and slips.
    material : Compaction
        Constitutive law.
    motion : PrescribedMotion
        Position and velocity over the duration, such as `Motion` and `Cycle`.
    torque : float, optional
        Torque per unit length on a free or driven roller, + along its travel [N]; 0 by default for a free one.
    lift_thickness : float
        Thickness of fresh mix that is added before every stroke but the first [m].
    fed_layer : LayerState, optional
        Layer of an earlier pass; fresh mix by default.
    start : CompactionContactResult, optional
        Steady rolling along +x on the same layer, from which the motion begins.
    **options
        Options, see `ReciprocatingNumerics`.

    Returns
    -------
    CompactionTransientResult

    Raises
    ------
    ValueError
        If an argument is out of its range.
    RuntimeError
        If a step has no equilibrium or the roller skids; the message contains the position.
    """
    numerics = ReciprocatingNumerics(**options)
    strokes = stroke_schedule(motion)
    require_compactable(layer, roller, material, 1.0, fed_layer)
    edge = numerics.edge_distance
    depth = require_simulable(layer, roller, strokes, lift_thickness, edge, fed_layer, start)
    require_torque_allowed(roller, torque)
    length = float(np.sqrt(2 * roller.radius * depth))
    element = strokes.span / np.ceil(strokes.span * numerics.increments / length * (1 - PLACE_TOLERANCE))

    def roller_on(fed: LayerState | None, position: float, before: ReciprocatingRoller | None) -> ReciprocatingRoller:
        height = layer.height if fed is None else fed.height
        mesh = rolling_mesh(height, length, element, stroke=round(strokes.span / element))
        frame = RollerFrame(mesh, material, "bonded", length, fed_layer=fed, finite=numerics.strain == "finite")
        frame.step = element  # that of the strokes, without the rounding of the nodes
        rolling = ReciprocatingRoller(frame, roller, strokes, torque or 0.0, position)
        if before is not None:
            rolling.input_work, rolling.stored_work = before.input_work, before.stored_work
            rolling.solver.iterations = before.solver.iterations
        return rolling

    def simulate(every: int) -> _History:
        """Simulate all strokes in all steps, or in every second one; a new roller presses each lift."""
        run, fed, rolling = _History(), fed_layer, None
        for stroke in range(strokes.count):
            times, positions = strokes.steps(stroke, element, every)
            is_new = rolling is None or lift_thickness > 0
            if rolling is None or is_new:
                if stroke:
                    fed = run.exit_layers[-1].with_lift(lift_thickness, material)
                    room = fed.height - fed.solid_height(material)
                    if depth > room:
                        warnings.warn(
                            f"stroke {stroke + 1}: the pores of the layer and its lift are shut at {room:.3g} of "
                            f"{depth:.3g} m; the mix beyond is pushed ahead of the roller",
                            stacklevel=3,
                        )
                rolling = roller_on(fed, positions[0], rolling)
                if start is not None and stroke == 0:
                    rolling.initialise_from(start.solution)
                else:
                    speed = float((positions[1] - positions[0]) / (times[1] - times[0]))
                    rolling.press(rolling.surface.bottom_height - depth, speed, every)
            elif edge is not None:  # behind the stroke before, ahead of this one
                rolling.lay_mix(edge, float(np.sign(positions[1] - positions[0])))
            kept = strokes.nearest(stroke, times, numerics.instants)
            run.add_stroke(rolling, stroke, (times, positions), is_new, kept)
        return run

    with threadpool_limits(1):
        run = simulate(1)
        coarse = simulate(2) if numerics.estimate else None
    error = None
    if coarse is not None:  # largest difference of the resistance at common steps over the largest resistance
        fine, rough = ({step[:2]: step[2]["resistance"] for step in each.steps} for each in (run, coarse))
        error = max(abs(fine[step] - rough[step]) for step in rough) / max(map(abs, fine.values()))
    stroke, time, records = zip(*run.steps, strict=True)
    return CompactionTransientResult(
        time=np.array(time),
        velocity=motion.velocity(np.array(time)),
        stroke=np.array(stroke) + 1,
        exit_layers=tuple(run.exit_layers),
        frames=tuple(run.frames),
        iterations=run.iterations,
        error=error,
        steps=len(run.steps) + (len(coarse.steps) if coarse else 0),
        **{name: np.array([record[name] for record in records]) for name in records[0]},
    )


@dataclass(eq=False)
class _History:
    """Results of strokes: (stroke, time, record of the roller) of each step, layers, frames, Newton iterations."""

    steps: list[tuple[int, float, dict[str, float]]] = field(default_factory=list)
    exit_layers: list[LayerState] = field(default_factory=list)
    frames: list[tuple[float, Any]] = field(default_factory=list)
    iterations: int = 0

    def add_stroke(
        self, roller: ReciprocatingRoller, stroke: int, steps: tuple[Array, Array], is_new: bool, kept: set[int]
    ) -> None:
        """Move the roller by one stroke; fields are kept after some steps."""
        times, positions = steps
        rate_factors = [roller.rate_factor(speed) for speed in (np.diff(positions) / np.diff(times)).tolist()]
        if roller.is_set_valued:
            if is_new:
                self.steps.append((stroke, times[0], roller.record))
            sign = float(np.sign(positions[1] - positions[0]))  # friction and torque change theirs at rest
            roller.move_to(roller.surface.position, roller.surface.bottom_height, rate_factors[0], sign)
        for k, (time, position) in enumerate(zip(times, positions, strict=True)):
            if k:
                roller.move_to(position, roller.surface.bottom_height, rate_factors[k - 1])
            if k or is_new or roller.is_set_valued:
                self.steps.append((stroke, time, roller.record))
            if k in kept:
                self.frames.append((float(time), roller.fields))
        middle = int(np.searchsorted(roller.frame.row_x, roller.strokes.span / 2))
        self.exit_layers.append(roller.frame.exit_layer(roller.state, middle)[0])
        self.iterations = roller.solver.iterations


def require_simulable(
    layer: Layer,
    roller: Roller,
    strokes: Strokes,
    lift: float,
    edge_distance: float | None,
    fed_layer: LayerState | None,
    start: CompactionContactResult | None,
) -> float:
    """Require a case that can be simulated, from a steady contact where it has one, and return the depth [m]."""
    depth = roller.indentation
    if depth is None:
        raise ValueError(f"`indentation` must be given for a roller of constant height, got its {roller.target[0]}")
    if layer.lower_lift is not None or (fed_layer is not None and fed_layer.lower is not None):
        raise ValueError("a `lower_lift` is for steady rolling, got one under a stroke; use `roll`")
    if layer.base != "bonded":
        raise ValueError(f"`base` must be 'bonded', got {layer.base!r}: a frictionless base leaves the layer free")
    if not strokes.span > 0:
        raise ValueError(f"`motion` must move the roller, got a constant position of {strokes.low!r} m")
    require_nonnegative(lift_thickness=lift)
    length = float(np.sqrt(2 * roller.radius * depth))
    if edge_distance is not None and (lift or not edge_distance >= length):
        raise ValueError(
            f"`edge_distance` must be at least the contact length {length:.4g} m and `lift_thickness` 0, got "
            f"{edge_distance!r} m and {lift!r} m"
        )
    if start is None:
        return depth
    same = start.layer == layer and start.solution.frame.inflow is fed_layer
    if not same or abs(start.indentation - depth) > PLACE_TOLERANCE * depth:
        raise ValueError("`start` must have the same `layer`, `fed_layer` and `indentation`, got a result of others")
    if start.speed < 0 or strokes.places[1] < strokes.places[0]:
        raise ValueError(
            f"`start` must roll along +x and the `motion` begin along +x, got {start.speed!r} m/s and a first stroke "
            f"from {strokes.places[0]:.6g} to {strokes.places[1]:.6g} m"
        )
    return depth
