"""Roller in reciprocating motion over compacting mix, on a mesh fixed to the mix.

    position x_0, x_1, ...: each step is an increment in equilibrium of the whole layer

The mesh covers the stroke and a length beyond its ends, and the roller moves over it. No state is convected, so that
the return stroke needs no special treatment. The multiplier tractions move along the surface with the roller by whole
elements. Mix without rate effect depends on the path alone; with it, the yield pressure follows the rate of compaction
at the mean |v| of each step. Nothing changes while the roller is at rest.

Steps are half elements, the spacing of the Gauss points. After a
reversal they begin with 1/16 of an element. The error estimate is the change from steps twice as long on the same mesh.
The forces also oscillate within each element as its nodes enter the contact: with 6 elements per contact length by
1.3 % of the resistance and 0.3 % of the load.

Friction
    A rotating roller has Coulomb friction with stick and slip; its rotation follows from the torque
    (`roller_contact`). At a reversal nothing jumps: the whole contact sticks until slip begins again. A sliding roller
    has the traction f p along its travel, which is set-valued at v = 0, like a torque that changes sign with the
    travel. The instant of a reversal then appears twice, before and after. The change of sign moves the mix while the
    roller is at rest, and the slip work may decrease by that work.

Range
    2 mm depth in 0.1 m, 6 elements per contact length: mean load and resistance within 0.5 % of steady rolling after a
    travel of three heights, 0.4 s of processor time for a step, 65 s for both strokes over 0.12 m, half as much again
    with the error estimate. Free with friction 0.3: within 0.4 % and 0.8 %, on 8 elements 0.25 % and 0.5 %. Layers on a
    frictionless base and rollers with a prescribed load are refused.

Lifts
    Between two strokes a lift of fresh mix may be added on a flat layer of rows in the state of the middle of the
    stroke; then the roller is pressed to its indentation below the new surface. The ends of the stroke, about as long
    as the contact, are approximated by the middle. `multipass` proceeds likewise from pass to pass and is the reference
    for it.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, fields
from typing import Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from compact.engines.compaction.engine import require_compactable
from compact.engines.compaction.finite_strain_solid import FloatArray
from compact.engines.compaction.reciprocating_roller import ReciprocatingCase, ReciprocatingRoller, RollerState
from compact.engines.compaction.results import CompactionContactResult
from compact.engines.compaction.roller_frame import LayerState
from compact.engines.stroke_schedule import PLACE_TOLERANCE, Strokes, stroke_schedule
from compact.material.laws import Compaction
from compact.numerics.validation import require_finite, require_integers, require_known, require_nonnegative
from compact.rolling_contact import Layer, PrescribedMotion, Roller, TransientResult, require_torque_allowed

INCREMENTS = 6  # [-], elements per contact length sqrt(2 R depth)


class ReciprocatingOptions(TypedDict, total=False):
    """Numerical options of `simulate_reciprocating`; see `ReciprocatingNumerics`."""

    strain: Literal["finite", "small"]
    increments: int
    instants: Sequence[float]
    estimate: bool


@dataclass(frozen=True, kw_only=True)
class ReciprocatingNumerics:
    """Numerical options of `simulate_reciprocating`.

    Parameters
    ----------
    strain : {"finite", "small"}
        Strain measure.
    increments : int
        Elements per contact length; each is travelled in two steps.
    instants : sequence of float
        Times at which fields are kept as `frames`, each at the nearest end of a step [s].
    estimate : bool
        True for an error estimate from steps twice as long, at half as much work again.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    strain: Literal["finite", "small"] = "finite"
    increments: int = INCREMENTS
    instants: Sequence[float] = ()
    estimate: bool = True

    def __post_init__(self) -> None:
        require_known("strain", self.strain, ("finite", "small"))
        require_integers(increments=self.increments)
        require_finite(instants=self.instants)


@dataclass(frozen=True, eq=False, kw_only=True)
class CompactionTransientResult(TransientResult):
    """A `TransientResult` over compacting mix.

    If a lift is added, or friction or torque change sign, the instant of a reversal appears twice, before and after.

    Parameters
    ----------
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

    stroke: NDArray[np.int64]
    bottom_height: FloatArray
    angle: FloatArray
    input_work: FloatArray
    slip_work: FloatArray
    stored_work: FloatArray
    exit_layers: tuple[LayerState, ...]
    iterations: int

    @property
    def work_residual(self) -> float:
        """Largest difference of input and stored work over the largest input work [-]."""
        return float(np.abs(self.input_work - self.stored_work).max() / np.abs(self.input_work).max())

    @property
    def density_ratio(self) -> tuple[float, ...]:
        """Mean density ratios over the height in the middle of the stroke, after each stroke [-]."""
        return tuple(layer.density_ratio for layer in self.exit_layers)


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
    **options: Unpack[ReciprocatingOptions],
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
        Numerical options, see `ReciprocatingNumerics`.

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
    depth = _require_simulable(layer, roller, material, strokes, lift_thickness, fed_layer)
    if start is not None:
        _require_same_start(start, layer, depth, strokes, fed_layer)
    require_torque_allowed(roller, torque)
    length = float(np.sqrt(2 * roller.radius * depth))
    element = strokes.span / np.ceil(strokes.span * numerics.increments / length * (1 - PLACE_TOLERANCE))
    case = ReciprocatingCase(roller, material, strokes, torque or 0.0, element, length, numerics.strain == "finite")
    program = _StrokeProgram(case, layer.height, lift_thickness, fed_layer, start)
    with threadpool_limits(1):
        history = program.simulate(1, numerics.instants)
        coarse = program.simulate(2) if numerics.estimate else None
    return _build_transient_result(strokes, history, coarse)


@dataclass(eq=False)
class _StrokeHistory:
    """Results of strokes: (stroke, time, `RollerState`) of each step, layers, frames, and the rollers."""

    steps: list[tuple[int, float, RollerState]] = field(default_factory=list)
    exit_layers: list[LayerState] = field(default_factory=list)
    frames: list[tuple] = field(default_factory=list)
    rollers: list[ReciprocatingRoller] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _StrokeProgram:
    """Strokes over a layer, with lifts between them."""

    case: ReciprocatingCase
    height: float
    lift_thickness: float
    fed_layer: LayerState | None
    start: CompactionContactResult | None

    def simulate(self, every: int, instants: Sequence[float] = ()) -> _StrokeHistory:
        """Simulate all strokes in all steps, or in every second one."""
        history, roller = _StrokeHistory(), None
        for stroke in range(self.case.strokes.count):
            roller = self._simulate_stroke(history, stroke, roller, every, instants)
        return history

    def _simulate_stroke(self, history, stroke, roller, every, instants):
        """Simulate a stroke and return its roller, a new one after a lift."""
        strokes = self.case.strokes
        times, positions = strokes.steps(stroke, self.case.element, every)
        speeds = np.diff(positions) / np.diff(times)
        frames_at = strokes.nearest(stroke, times, instants)
        is_new = roller is None or self.lift_thickness > 0
        if is_new:
            roller = self._create_roller(history, positions[0], float(speeds[0]), every)
        rate_factors = [roller.rate_factor(speed) for speed in speeds.tolist()]
        if roller.is_set_valued:
            if is_new:
                history.steps.append((stroke, times[0], roller.roller_state))
            roller.reverse_friction(np.sign(positions[1] - positions[0]), rate_factors[0])
        for k, (time, position) in enumerate(zip(times, positions, strict=True)):
            if k:
                roller.move_to(position, roller.surface.bottom_height, rate_factors[k - 1])
            if k or is_new or roller.is_set_valued:
                history.steps.append((stroke, time, roller.roller_state))
            if k in frames_at:
                history.frames.append((float(time), roller.fields))
        history.exit_layers.append(roller.middle_layer)
        return roller

    def _create_roller(self, history, position, speed, every):
        """Create the roller on the last layer with its lift, on the first layer, or in steady motion."""
        fed_layer = self.fed_layer
        if history.exit_layers:
            fed_layer = history.exit_layers[-1].with_lift(self.lift_thickness, self.case.material)
        height = self.height if fed_layer is None else fed_layer.height
        roller = ReciprocatingRoller(self.case, height, fed_layer, position)
        if history.rollers:
            last = history.rollers[-1]
            roller.input_work, roller.stored_work = last.input_work, last.stored_work
        history.rollers.append(roller)
        if self.start is not None and not history.exit_layers:
            roller.initialise_from(self.start.solution)
        else:
            roller.press(height - self.case.roller.indentation, speed, every)
        return roller


def _build_transient_result(
    strokes: Strokes, history: _StrokeHistory, coarse: _StrokeHistory | None
) -> CompactionTransientResult:
    stroke, time, states = zip(*history.steps, strict=True)
    names = (entry.name for entry in fields(RollerState))
    values = {
        name: np.array(column) for name, column in zip(names, zip(*map(astuple, states), strict=True), strict=True)
    }
    return CompactionTransientResult(
        time=np.array(time),
        velocity=strokes.motion.velocity(np.array(time)),
        stroke=np.array(stroke) + 1,
        exit_layers=tuple(history.exit_layers),
        frames=tuple(history.frames),
        iterations=sum(roller.iterations for roller in history.rollers),
        error=None if coarse is None else _step_error(history, coarse),
        steps=len(history.steps) + (len(coarse.steps) if coarse else 0),
        **values,
    )


def _step_error(history: _StrokeHistory, coarse: _StrokeHistory) -> float:
    """Return the largest difference of the resistance at common steps over the largest resistance."""
    fine, rough = ({(stroke, time): state.resistance for stroke, time, state in run.steps} for run in (history, coarse))
    return max(abs(fine[step] - rough[step]) for step in rough) / max(map(abs, fine.values()))


def _require_simulable(
    layer: Layer,
    roller: Roller,
    material: Compaction,
    strokes: Strokes,
    lift_thickness: float,
    fed_layer: LayerState | None,
) -> float:
    """Require a case that can be simulated, and return the depth [m]."""
    depth = roller.indentation
    if depth is None:
        raise ValueError(f"`indentation` must be given for a roller of constant height, got its {roller.target[0]}")
    require_compactable(layer, roller, material, 1.0, fed_layer)
    if layer.lower_lift is not None or (fed_layer is not None and fed_layer.lower is not None):
        raise ValueError("a `lower_lift` is for steady rolling, got one under a stroke; use `roll`")
    if layer.base != "bonded":
        raise ValueError(f"`base` must be 'bonded', got {layer.base!r}: a frictionless base leaves the layer free")
    if not strokes.span > 0:
        raise ValueError(f"`motion` must move the roller, got a constant position of {strokes.low!r} m")
    require_nonnegative(lift_thickness=lift_thickness)
    least = depth / (1 - material.fed_density_ratio)
    if lift_thickness and not depth < lift_thickness * (1 - material.fed_density_ratio):
        raise ValueError(
            f"`lift_thickness` must be more than {least:.4g} m for an exit density below full density, got "
            f"{lift_thickness!r} m"
        )
    return depth


def _require_same_start(
    start: CompactionContactResult, layer: Layer, depth: float, strokes: Strokes, fed_layer: LayerState | None
) -> None:
    """Require a start on the same layer, at the same depth [m] and along the first stroke."""
    same = start.layer == layer and start.solution.frame.inflow is fed_layer
    if not same or abs(start.indentation - depth) > PLACE_TOLERANCE * depth:
        raise ValueError("`start` must have the same `layer`, `fed_layer` and `indentation`, got a result of others")
    if start.speed < 0 or strokes.places[1] < strokes.places[0]:
        raise ValueError(
            f"`start` must roll along +x and the `motion` begin along +x, got {start.speed!r} m/s and a first stroke "
            f"from {strokes.places[0]:.6g} to {strokes.places[1]:.6g} m"
        )
