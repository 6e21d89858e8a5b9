"""Engine "compaction": steady rolling of a rigid roller over compacting mix, plane strain, finite strain.

On a coarse mesh the steady state is found from scratch by continuation in the stiffness ratio and then solved directly
(`steady_newton_krylov`). It is the initial guess on the finer mesh. If either solution fails, incremental rolling
(`incremental_rolling`) continues until load, resistance and exit density are steady. A prescribed load, peak pressure
or exit density is satisfied by a search over the depth (`target_search`). A neighbouring case (another depth, speed or
parameter) starts from the last solution, on its mesh scaled with the contact length.

Range: frictionless, sliding, free and driven rollers, bonded and frictionless bases; `solution.is_direct` of the result
is True for the direct steady solve. Incremental rolling has a step error: the resistance on coarse meshes is 4 to 6 %
low, and the load on 12 increments is 1 to 2 % higher than on 24. The direct solve of 2 mm depth in a layer of 0.1 m,
contact angle 11 degrees, free roller with friction 0.3, takes 31 s of processor time on 12 increments. Lifts of 0.04 to
0.08 m of the prior's mix all become steady, most by incremental rolling, in about 50 s. On a layer that is high
compared with the contact length, the bow wave may grow without a steady state; then `HeapingError` is raised.
A mean exit density ratio of 1 or more is refused. A depth beyond the estimate of `heaping` is refused before any
solution, and incremental rolling whose bow wave grows too high ends with the same error.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypedDict, Unpack

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.finite_strain_kernels import announce_compilation
from compact.engines.compaction.heaping import (
    MAX_CONTACT_ANGLE,
    HeapingError,
    HeapingEstimate,
    remedies,
    require_no_heaping,
)
from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.compaction.newton import Progress
from compact.engines.compaction.results import CompactionContactResult, build_result
from compact.engines.compaction.roller_frame import LayerState, RollerFrame, rolling_mesh, transfer_state
from compact.engines.compaction.steady_newton_krylov import continue_in_stiffness
from compact.engines.compaction.target_search import COARSE_TOLERANCE, DepthTarget, solve_directly
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics.validation import require_between, require_known, require_positive
from compact.rolling_contact import HEIGHT_TOLERANCE, Layer, Roller, require_moving, require_torque_allowed

__all__ = ["CompactionContactResult", "HeapingError", "roll"]

INCREMENTS = 12  # [-], elements per contact length sqrt(2 R depth)
COARSE_INCREMENTS = 4  # [-], elements per contact length of the first mesh
STEADY_TOLERANCE = 5e-3  # [-], remaining change of load, resistance and exit density
NEIGHBOUR_PARTS = (1, 2)  # [-], steps of the depth from a neighbour by direct solves
STEP_ERROR = 0.25  # [-], error of incremental rolling times increments; six lifts differ by 0.8 to 1.9 % from 24
MESH_ERROR_RATIO = 0.5  # [-], error over the change from the coarse mesh; 12 against 6 increments: 0.5 % and 1.3 %
MIN_RESISTANCE = 1e-3  # [-], least scale of the error of the resistance over the load

Strain = Literal["finite", "small"]


class RollingOptions(TypedDict, total=False):
    """Numerical options of `roll`; see `RollingNumerics`."""

    strain: Strain
    increments: int
    steady_tolerance: float
    max_contact_angle: float | None
    progress: Progress | None


@dataclass(frozen=True, kw_only=True)
class RollingNumerics:
    """Numerical options of `roll`.

    Parameters
    ----------
    strain : {"finite", "small"}
        Strain measure; small strain is fair up to contact angles of 12 to 15 degrees, and its density ratio is low by
        half a squared strain.
    increments : int
        Elements and steps per contact length.
    steady_tolerance : float
        Relative tolerance of the steady state: estimated remaining change of load, resistance and exit density [-].
    max_contact_angle : float or None
        Contact angle at which a bow wave counts as unbounded [rad], up to pi/2. Depths and loads in fresh mix that
        require more are refused, and incremental rolling ends there. None omits both.
    progress : callable, optional
        Called with a line of text after each iteration of the direct solve and each step of incremental rolling.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    strain: Strain = "finite"
    increments: int = INCREMENTS
    steady_tolerance: float = STEADY_TOLERANCE
    max_contact_angle: float | None = MAX_CONTACT_ANGLE
    progress: Progress | None = None

    def __post_init__(self) -> None:
        require_known("strain", self.strain, ("finite", "small"))
        require_positive(increments=self.increments, steady_tolerance=self.steady_tolerance)
        if self.max_contact_angle is not None:
            require_positive(max_contact_angle=self.max_contact_angle)
            require_between(0.0, np.pi / 2, max_contact_angle=self.max_contact_angle)


def roll(
    layer: Layer,
    roller: Roller,
    material: Compaction,
    speed: float,
    *,
    torque: float | None = None,
    fed_layer: LayerState | None = None,
    start: CompactionContactResult | None = None,
    exit_density_ratio: float | None = None,
    **options: Unpack[RollingOptions],
) -> CompactionContactResult:
    """Compute one roller in steady motion over a layer of compacting mix.

    Parameters
    ----------
    layer : Layer
        Layer with the height of the fed mix.
    roller : Roller
        Roller of any profile; "circle" and "parabola" have vertical pressure. A sliding roller has the traction f p on
        the mix along the travel in the whole contact; a free or driven one sticks and slips.
    material : Compaction
        Constitutive law.
    speed : float
        Speed along x [m/s], not 0; it enters by its sign and `material.rate_factor`.
    torque : float, optional
        Torque per unit length on a free or driven roller, + along its travel [N]; 0 by default for a free one.
    fed_layer : LayerState, optional
        Layer of an earlier pass, its `exit`; by default mix without stress at `material.fed_density_ratio`.
    start : CompactionContactResult, optional
        Result of a neighbouring case with the same layer and fed layer, used as initial guess; its mesh and error
        estimate are used too.
    exit_density_ratio : float, optional
        Prescribed mean exit density ratio [-]; the indentation of the roller is then the first depth.
    **options
        Numerical options, see `RollingNumerics`.

    Returns
    -------
    CompactionContactResult

    Raises
    ------
    ValueError
        If an argument is out of its range.
    HeapingError
        If the estimate of `heaping` excludes the depth, or the bow wave exceeds `max_contact_angle`.
    RuntimeError
        If no equilibrium is found or the motion does not become steady; the message contains the last step.
    """
    numerics = RollingNumerics(**options)
    require_compactable(layer, roller, material, speed, fed_layer, exit_density_ratio)
    require_torque_allowed(roller, torque)
    case = RollingCase(layer, roller, material, speed, torque, fed_layer, numerics)
    target = DepthTarget(layer, roller, material, exit_density_ratio, fed_layer)
    announce_compilation(numerics.progress)
    if case.heaping is not None and fed_layer is None:
        require_no_heaping(case.heaping, target.quantity, target.value, target.required_depth)
    with threadpool_limits(1):
        if start is None:
            return _roll_from_scratch(case, target)
        return _roll_from_neighbour(case, target, start)


@dataclass(frozen=True, eq=False)
class RollingCase:
    """Arguments of `roll`, from which frames and rollers at rest are created.

    Parameters
    ----------
    layer, roller, material, speed, torque, fed_layer
        As of `roll`.
    numerics : RollingNumerics
        Numerical options.
    """

    layer: Layer
    roller: Roller
    material: Compaction
    speed: float
    torque: float | None
    fed_layer: LayerState | None
    numerics: RollingNumerics

    @cached_property
    def heaping(self) -> HeapingEstimate | None:
        """Estimate of the largest depth; None if it does not apply.

        Small strain causes no bow wave, and mix on a frictionless base may elongate instead of being compacted.
        """
        angle = self.numerics.max_contact_angle
        if angle is None or self.numerics.strain == "small" or self.layer.base == "slip":
            return None
        rate_factor = self.material.rate_factor(self.speed)
        return HeapingEstimate(self.layer.height, self.roller.radius, self.material, angle, rate_factor)

    def create_frame(self, depth: float, increments: int) -> RollerFrame:
        """Create the frame for a depth [m] with a number of elements per contact length."""
        length = np.sqrt(2 * self.roller.radius * depth)
        mesh = rolling_mesh(self.layer.height, length, length / increments)
        return self.frame_on(mesh, length, self.material, self.numerics.strain == "finite")

    def frame_on(self, mesh: RowMesh, contact_length: float, material: Compaction, finite: bool) -> RollerFrame:
        """Create a frame on a mesh.

        Parameters
        ----------
        mesh : RowMesh
            Mesh of the fed layer.
        contact_length : float
            Estimated contact length [m].
        material : Compaction
            Constitutive law.
        finite : bool
            True for finite strain.
        """
        rate_factor, base = self.material.rate_factor(self.speed), self.layer.base
        return RollerFrame(
            mesh, material, base, contact_length, fed_layer=self.fed_layer, finite=finite, rate_factor=rate_factor
        )

    def roller_at_rest(self, frame: RollerFrame) -> IncrementalRolling:
        """Create the roller above the fed layer of a frame."""
        roller = self.roller
        rotates = roller.rolling in ("free", "driven") and roller.friction > 0
        return IncrementalRolling(
            frame,
            roller.radius,
            profile=roller.profile,
            friction=0.0 if roller.rolling == "frictionless" else roller.friction,
            torque=(self.torque or 0.0) if rotates else None,
            max_wave_height=np.inf if self.heaping is None else self.heaping.contact_height,
            progress=self.numerics.progress,
        )

    def continuation_start(self, frame: RollerFrame, bottom_height: float) -> IncrementalRolling:
        """Solve a frame from scratch by continuation, with the lowest generatrix at a height [m]."""

        def create_rolling(ratio: float) -> IncrementalRolling:
            softer = replace(self.material, unloading_modulus=ratio * self.material.unloading_modulus)
            return self.roller_at_rest(self.frame_on(frame.mesh, frame.contact_length, softer, frame.solid.finite))

        return continue_in_stiffness(create_rolling, bottom_height)

    def scaled_from(self, old: IncrementalRolling, depth: float) -> IncrementalRolling:
        """Return the roller for a depth [m], with mesh and displacement of an old solution scaled by contact length."""
        factor = float(np.sqrt(depth / (self.layer.height - old.steps[-1].bottom_height)))
        mesh = RowMesh(factor * old.frame.mesh.x, old.frame.mesh.y)
        frame = self.frame_on(mesh, factor * old.frame.contact_length, self.material, old.frame.solid.finite)
        rolling = self.roller_at_rest(frame)
        rolling.initialise_from(old, replace(old.state, displacement=factor * old.state.displacement))
        rolling.surface = rolling.surface.with_multipliers(old.contact)
        return rolling


def _roll_from_scratch(case: RollingCase, target: DepthTarget) -> CompactionContactResult:
    """Solve on a coarse mesh, then on the fine one."""
    increments, tolerance = case.numerics.increments, case.numerics.steady_tolerance
    coarse: IncrementalRolling | None = None
    depth = target.initial_depth()
    for count in [increments] if increments <= COARSE_INCREMENTS else [COARSE_INCREMENTS, increments]:
        rolling = case.roller_at_rest(case.create_frame(depth, count))
        if coarse is not None:
            rolling.initialise_from(coarse, transfer_state(coarse.state, coarse.frame, rolling.frame))
        is_intermediate = count < increments and target.quantity != "indentation"
        try:
            rolling = target.reach(
                rolling,
                max(tolerance, COARSE_TOLERANCE) if is_intermediate else tolerance,
                depth,
                case.continuation_start if coarse is None else None,
            )
        except RuntimeError as error:
            raise type(error)(f"{error}{_advice(case, target)}") from error
        depth = rolling.depth
        coarse = rolling if count < increments else coarse
    rolled = build_result(rolling, case.layer, case.roller, case.material, case.speed)
    target.require_reached(rolled, rolling, case.torque)
    return _with_mesh_error(rolled, rolling, coarse)


def _roll_from_neighbour(
    case: RollingCase, target: DepthTarget, start: CompactionContactResult
) -> CompactionContactResult:
    """Solve from a neighbouring result, on its mesh."""
    depth = target.value if target.quantity == "indentation" else start.indentation
    rolling = target.reach(_initialise_from_neighbour(case, start, depth), case.numerics.steady_tolerance)
    rolled = build_result(rolling, case.layer, case.roller, case.material, case.speed)
    target.require_reached(rolled, rolling, case.torque)
    if start.error is None:
        return rolled
    load_error, resistance_error = (max(error, _step_error(rolling)) for error in start.error)
    return replace(rolled, error=(load_error, resistance_error))


def _initialise_from_neighbour(case: RollingCase, start: CompactionContactResult, depth: float) -> IncrementalRolling:
    """Return the roller at a depth: by direct solves in few steps from a direct solution, else initialised by it."""
    old = start.solution
    if case.layer != start.layer or case.fed_layer is not old.frame.inflow:
        raise ValueError("`start` must have the same `layer` and `fed_layer`, got a result of others")
    for parts in NEIGHBOUR_PARTS if old.is_direct else ():
        rolling = old
        for intermediate in np.geomspace(start.indentation, depth, parts + 1)[1:]:
            rolling = case.scaled_from(rolling, intermediate)
            if not solve_directly(rolling, case.layer.height - intermediate):
                break
        else:
            return rolling
    rolling = case.scaled_from(old, depth)
    rolling.failed_height = case.layer.height - depth
    return rolling


def _advice(case: RollingCase, target: DepthTarget) -> str:
    """Return a clause with remedies for a depth in fresh mix without steady state; empty for anything else."""
    depth = target.required_depth
    if case.heaping is None or depth is None or case.fed_layer is not None:
        return ""
    return f"; {remedies(case.heaping, depth, for_density=target.quantity == 'exit_density_ratio')}"


def _with_mesh_error(
    rolled: CompactionContactResult, rolling: IncrementalRolling, coarse: IncrementalRolling | None
) -> CompactionContactResult:
    """Return the result with an error estimate by its change from the coarse mesh."""
    if coarse is None:
        return rolled
    load, resistance = (coarse.extrapolate(name)[0] for name in ("load", "resistance"))
    scale = max(abs(rolled.resistance), MIN_RESISTANCE * rolled.load)
    changes = abs(rolled.load - load) / rolled.load, abs(abs(rolled.resistance) - resistance) / scale
    return replace(rolled, error=(max(MESH_ERROR_RATIO * max(changes), _step_error(rolling)),) * 2)


def _step_error(rolling: IncrementalRolling) -> float:
    """Return the least error of incremental rolling, since two meshes may agree by chance; 0 of a direct solve."""
    frame = rolling.frame
    return 0.0 if rolling.is_direct else float(STEP_ERROR * frame.step / frame.contact_length)


def require_compactable(
    layer: Layer,
    roller: Roller,
    material: Compaction,
    speed: float,
    fed_layer: LayerState | None = None,
    exit_density_ratio: float | None = None,
) -> None:
    """Require a case that the engine can compute.

    Parameters
    ----------
    layer, roller, material, speed, fed_layer, exit_density_ratio
        As of `roll`.

    Raises
    ------
    ValueError
        With the argument that is out of its range.
    """
    require_moving(speed)
    if not isinstance(material, Compaction):
        raise ValueError(f"`material` must be Compaction, got {type(material).__name__}; use the engine fem for others")
    if layer.plies:
        raise ValueError(f"`plies` are for linear layers, got {len(layer.plies)}; a compacting layer takes `fed_layer`")
    require_known("rolling", roller.rolling, ("frictionless", "sliding", "free", "driven"))
    require_known("profile", roller.profile, ("parabola", "circle", "deformed"))
    if fed_layer is not None and abs(fed_layer.height / layer.height - 1) > HEIGHT_TOLERANCE:
        raise ValueError(f"`layer` must be as high as `fed_layer`, {fed_layer.height!r} m, got {layer.height!r} m")
    fed_ratio = material.fed_density_ratio if fed_layer is None else fed_layer.density_ratio
    if exit_density_ratio is not None and not fed_ratio < exit_density_ratio < 1:
        raise ValueError(
            f"`exit_density_ratio` must lie between that of the fed mix {fed_ratio:.6g} and 1, got "
            f"{exit_density_ratio!r}"
        )
    if roller.indentation is not None:
        _require_indentation(roller.indentation, layer.height, roller, fed_ratio)


def _require_indentation(depth: float, height: float, roller: Roller, fed_ratio: float) -> None:
    if roller.profile != "parabola" and depth >= roller.radius:
        raise ValueError(
            f"`indentation` must be less than the roller's `radius` {roller.radius!r} m, or its axle would be below "
            f"the mix in front, got {depth!r} m"
        )
    full = height * (1 - fed_ratio)
    if depth >= full:
        raise ValueError(
            f"`indentation` must be less than {full:.6g} m, got {depth!r} m: it would press mix fed at {fed_ratio:.6g} "
            f"and {height!r} m beyond full density"
        )
