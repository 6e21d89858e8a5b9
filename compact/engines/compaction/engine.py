"""Engine "compaction": steady rolling of a rigid roller over compacting mix, plane strain, finite strain.

The roller rolls element by element (`incremental_rolling`) until the motion is steady (`steady_search`), first on a
coarse mesh, then on finer ones that start from the interpolated state. What relaxes slowly is the bow wave: its
relaxation length is found on the coarse mesh, and each mesh jumps along its slow mode (`bow_wave`). A prescribed load,
peak pressure or exit density corrects the depth in the same cycles (`depth_target`). A neighbouring case, of another
depth, speed, roller or mix, starts from the last solution stretched to it. Mix with a shear line, whose wave has no
single mode, rolls on without jumps (`shear_line_search`).

The error has three parts: of the mesh, from the change between the last two meshes, of first order; of the drift, the
distance to the steady state along the slow mode; of the start, the scatter of that distance and the last transient.

Range: frictionless, sliding, free and driven rollers, bonded and frictionless bases, contact
angles up to some 25 degrees where the mix has the voids. On a layer that is high compared with the contact length, the
bow wave may grow without a steady state; then `HeapingError` is raised, for most such depths before any finite elements
(`heaping`). A mean exit density ratio of 1 or more is refused. Times and errors: `studies/speed_against_error.py`.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypedDict, Unpack, get_args

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.depth_target import MAX_ELONGATED_SHARE, DepthTarget
from compact.engines.compaction.finite_strain_kernels import announce_compilation
from compact.engines.compaction.finite_strain_solid import SolidState
from compact.engines.compaction.heaping import (
    MAX_CONTACT_ANGLE,
    HeapingEstimate,
    remedy,
    require_no_heaping,
)
from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.compaction.newton import Progress
from compact.engines.compaction.results import CompactionContactResult, build_result
from compact.engines.compaction.roller_frame import (
    LayerState,
    RollerFrame,
    compacted_lift,
    rate_factor_at,
    rolling_mesh,
)
from compact.engines.compaction.shear_line_search import search_class
from compact.engines.compaction.steady_search import SteadySearch, error_parts, mesh_errors
from compact.material import cap_plasticity
from compact.material.laws import Compaction, DruckerPragerCap
from compact.mesh import RowMesh
from compact.numerics.validation import require_between, require_known, require_positive
from compact.rolling_contact import (
    HEIGHT_TOLERANCE,
    HeapingError,
    Layer,
    Roller,
    RollerCondition,
    require_moving,
    require_torque_allowed,
)

__all__ = ["CompactionContactResult", "HeapingError", "roll"]

INCREMENTS = 14  # [-], elements per contact length sqrt(2 R depth)
COARSE_INCREMENTS = 4  # [-], elements per contact length of the first mesh
REFINEMENT, MIN_REFINEMENT = 2.0, 1.4  # [-], of successive meshes, and at least of the first two
STEADY_TOLERANCE = 2e-3  # [-], estimated distance of load, resistance and exit density from the steady state
COARSE_TOLERANCE = 2.0  # [-], tolerances of the coarser meshes over those of the last one
COARSE_TARGET_TOLERANCE = 10.0  # [-], tolerance of a target on the coarser meshes over that on the last one
NEIGHBOUR_DEPTH = 1.3  # [-], largest ratio of depths of neighbours; others are solved from scratch

Strain = Literal["finite", "small"]


class RollingOptions(TypedDict, total=False):
    """Numerical options of `roll`; see `RollingNumerics`."""

    strain: Strain
    increments: int
    steady_tolerance: float
    max_contact_angle: float | None
    threads: int
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
    threads : int
        Threads that share the elements; the number changes no digit. Two idle cores save a fifth of the time.
    progress : callable, optional
        Called with a line of text after each step.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    strain: Strain = "finite"
    increments: int = INCREMENTS
    steady_tolerance: float = STEADY_TOLERANCE
    max_contact_angle: float | None = MAX_CONTACT_ANGLE
    threads: int = 1
    progress: Progress | None = None

    def __post_init__(self) -> None:
        require_known("strain", self.strain, ("finite", "small"))
        require_positive(increments=self.increments, steady_tolerance=self.steady_tolerance, threads=self.threads)
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
        Layer with the height of the fed mix; it may lie on a lower lift. Density ratio and height of the exit refer to
        the layer alone.
    roller : Roller
        Roller of any profile; "circle" and "parabola" have vertical pressure. A sliding roller has the traction f p on
        the mix along the travel in the whole contact; a free or driven one sticks and slips.
    material : Compaction
        Constitutive law.
    speed : float
        Speed along x [m/s], not 0; it enters by its sign and the rate of compaction.
    torque : float, optional
        Torque per unit length on a free or driven roller, + along its travel [N]; 0 by default for a free one.
    fed_layer : LayerState, optional
        Layer of an earlier pass, its `exit`, with its own lower lift; by default mix without stress at
        `material.fed_density_ratio`, on the lower lift of `layer`.
    start : CompactionContactResult, optional
        Result of a neighbouring case on the same base and fed layer, used as initial guess if its depth is near; its
        mesh and the error of the mesh are then used too.
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
    target = DepthTarget(layer, roller, material, exit_density_ratio, fed_layer, case.lower)
    announce_compilation(numerics.progress)
    if case.heaping is not None and fed_layer is None and not isinstance(material, DruckerPragerCap):
        require_no_heaping(case.heaping, target.quantity, target.value, target.required_depth)
    with threadpool_limits(1):
        if start is None or not _is_neighbour(case, target, start):
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
    def lower(self) -> LayerState | None:
        """Lower lift before the pass, all mix below the fed layer; None on the rigid base."""
        if self.fed_layer is not None:
            return None if self.fed_layer.lower is None else self.fed_layer.lower.stacked
        lift = self.layer.lower_lift
        if lift is None:
            return None
        rate = lift.compaction_rate(self.speed, self.roller.radius, self.material.fed_density_ratio)
        return compacted_lift(lift, self.material, self.material.rate_factor(rate))

    @cached_property
    def heaping(self) -> HeapingEstimate | None:
        """Estimate of the largest depth; None if it does not apply. It regards a lower lift as rigid.

        It is fitted to the elliptic cap: with a shear line only its contact angle limits the wave.
        Small strain causes no bow wave, and mix on a frictionless base may elongate instead of being compacted.
        """
        angle = self.numerics.max_contact_angle
        if angle is None or self.numerics.strain == "small" or self.layer.base == "slip":
            return None
        estimate = HeapingEstimate(self.layer.height, self.roller.radius, self.material, angle)
        deepest = min(estimate.contact_height, self.layer.height * (1 - self.material.fed_density_ratio))
        return replace(estimate, rate_factor=self.rate_factor(deepest))

    def rate_factor(self, depth: float) -> float:
        """Return the factor of the yield pressure [-] by the rate of compaction at a depth [m]."""
        return rate_factor_at(self.material, self.roller.radius, self.layer.height, depth, self.speed, self.fed_layer)

    def create_frame(self, depth: float, increments: int) -> RollerFrame:
        """Create the frame for a depth [m] with a number of elements per contact length."""
        length = np.sqrt(2 * self.roller.radius * depth)
        mesh = rolling_mesh(
            self.layer.height, length, length / increments, 0.0 if self.lower is None else self.lower.height
        )
        return self.frame_on(mesh, depth, self.numerics.strain == "finite")

    def frame_on(self, mesh: RowMesh, depth: float, finite: bool) -> RollerFrame:
        """Create a frame on a mesh.

        Parameters
        ----------
        mesh : RowMesh
            Mesh of the fed layer.
        depth : float
            Depth [m].
        finite : bool
            True for finite strain.
        """
        frame = RollerFrame(
            mesh,
            self.material,
            self.layer.base,
            float(np.sqrt(2 * self.roller.radius * depth)),
            fed_layer=self.fed_layer,
            lower=self.lower,
            finite=finite,
            rate_factor=self.rate_factor(depth),
        )
        frame.solid.threads = self.numerics.threads
        return frame

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

    def stretched(self, old: IncrementalRolling, depth: float) -> IncrementalRolling:
        """Return the roller of this case at the state of another one stretched to a depth.

        The mesh is stretched with contact length and layer height. Strains change in proportion to depth over height,
        stresses to the yield pressure. The roller remains in place; the next steps move it and restore equilibrium.

        Parameters
        ----------
        old : IncrementalRolling
            Roller in a state with a similar fed layer.
        depth : float
            Depth [m].
        """
        frame, state = old.frame, old.state
        length = float(np.sqrt(2 * self.roller.radius * depth))
        below = 0.0 if self.lower is None else self.lower.height  # each lift is stretched by itself
        along, across = length / frame.contact_length, self.layer.height / (frame.mesh.height - frame.lower_height)
        layer, lower = across * (frame.mesh.y - frame.lower_height), np.minimum(frame.mesh.y, frame.lower_height)
        if below:
            layer = np.maximum(layer, 0.0) + lower * (below / frame.lower_height)
        mesh = RowMesh(along * frame.mesh.x, layer)
        rolling = self.roller_at_rest(self.frame_on(mesh, depth, frame.solid.finite))
        strain = depth / old.depth / across
        displacement = state.displacement * strain * across
        points, fed, old_fed = state.points, rolling.frame.initial_state().points, frame.initial_state().points
        ratios = {
            name: getattr(fed, name) * (getattr(points, name) / getattr(old_fed, name)) ** strain
            for name in ("density_ratio", "max_density_ratio")
        }
        solids = rolling.frame.solid, frame.solid
        pressure, old_pressure = (
            solid.material.yield_pressure(densest) * solid.rate_factor
            for solid, densest in zip(solids, (ratios["max_density_ratio"], points.max_density_ratio), strict=True)
        )
        stress = np.asarray(pressure / old_pressure)
        moved = cap_plasticity.MaterialPoint(
            points.stress * stress[:, None], **ratios, plastic_work=points.plastic_work * stress * strain
        )
        rolling.initialise_from(old, SolidState(displacement, moved, state.work * stress * strain), depth)
        return rolling


def mesh_cascade(increments: int) -> list[int]:
    """Return the numbers of elements per contact length of successive meshes; each has half those of the next."""
    counts = [increments]
    while counts[0] >= MIN_REFINEMENT * COARSE_INCREMENTS:
        counts.insert(0, max(round(counts[0] / REFINEMENT), COARSE_INCREMENTS))
    return counts


def _roll_from_scratch(case: RollingCase, target: DepthTarget) -> CompactionContactResult:
    """Solve on a cascade of meshes, each from the state of the last one."""
    searches: list[SteadySearch] = []
    for count in mesh_cascade(case.numerics.increments):
        searches.append(_search_on(case, target, count, searches[-1] if searches else None))
        _run(searches[-1], case)
    *coarser, last = searches
    return _to_result(case, last, mesh_errors(coarser[-1], last, *coarser[-2:-1]) if coarser else None)


def _search_on(case: RollingCase, target: DepthTarget, count: int, coarse: SteadySearch | None) -> SteadySearch:
    """Return the search on a mesh, from the state on a coarser one or from rest."""
    is_last = count == case.numerics.increments
    depth = target.initial_depth() if coarse is None else coarse.depth
    search = search_class(case.material)(
        rolling=case.roller_at_rest(case.create_frame(depth, count)),
        target=target,
        depth=depth,
        tolerance=case.numerics.steady_tolerance * (1 if is_last else COARSE_TOLERANCE),
        target_tolerance=target.tolerance * (1 if is_last else COARSE_TARGET_TOLERANCE),
        stretch=case.stretched,
        rate_factor=case.rate_factor,
        is_last=is_last,
    )
    if coarse is not None:
        search.start_from(coarse)
    return search


def _roll_from_neighbour(
    case: RollingCase, target: DepthTarget, start: CompactionContactResult
) -> CompactionContactResult:
    """Solve from a neighbouring result, on its mesh stretched to the depth."""
    depth = target.depth_from(start)
    search = search_class(case.material)(
        rolling=case.stretched(start.solution, depth),
        target=target,
        depth=depth,
        tolerance=case.numerics.steady_tolerance,
        target_tolerance=target.tolerance,
        stretch=case.stretched,
        rate_factor=case.rate_factor,
        relaxation=start.relaxation,
    )
    _run(search, case)
    return _to_result(case, search, start.error_parts.mesh)


def _is_neighbour(case: RollingCase, target: DepthTarget, start: CompactionContactResult) -> bool:
    """Return whether a result is near enough to start from; raise if its layer is another one."""
    frame = start.solution.frame
    same_base = (case.layer.base == "slip") == frame.has_frictionless_base
    if case.fed_layer is not frame.inflow or not same_base or case.layer.lower_lift != start.layer.lower_lift:
        raise ValueError("`start` must have the same `base`, `lower_lift` and `fed_layer`, got a result of others")
    ratio = target.depth_from(start) / start.indentation
    return max(ratio, 1 / ratio) <= NEIGHBOUR_DEPTH


def _to_result(case: RollingCase, search: SteadySearch, mesh: tuple[float, float] | None) -> CompactionContactResult:
    """Evaluate a steady solution and require what is prescribed."""
    rolled = build_result(search.rolling, case.layer, case.roller, case.material, case.speed)
    search.target.require_reached(rolled, search.rolling, case.torque)
    parts = error_parts(search, mesh)
    return replace(rolled, error=parts.total, error_parts=parts, relaxation=search.relaxation)


def _run(search: SteadySearch, case: RollingCase) -> None:
    """Run a search; its errors name a remedy for a depth in fresh mix without a steady state."""
    try:
        search.run()
    except RuntimeError as error:
        depth = search.target.required_depth
        if case.heaping is None or depth is None or case.fed_layer is not None:
            raise
        advice = remedy(case.heaping, depth, for_density=search.target.quantity == "exit_density_ratio")
        raise type(error)(f"{error}; {advice}", *error.args[1:]) from error


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
    require_known("rolling", roller.rolling, get_args(RollerCondition))
    require_known("profile", roller.profile, ("parabola", "circle", "deformed"))
    if fed_layer is not None and abs(fed_layer.height / layer.height - 1) > HEIGHT_TOLERANCE:
        raise ValueError(f"`layer` must be as high as `fed_layer`, {fed_layer.height!r} m, got {layer.height!r} m")
    if fed_layer is not None and layer.lower_lift is not None and fed_layer.lower is None:
        raise ValueError("`fed_layer` on a `lower_lift` must have a state `lower` of it, got None")
    fed_ratio = material.fed_density_ratio if fed_layer is None else fed_layer.density_ratio
    if exit_density_ratio is not None and not fed_ratio < exit_density_ratio < 1:
        raise ValueError(
            f"`exit_density_ratio` must lie between that of the fed mix {fed_ratio:.6g} and 1, got "
            f"{exit_density_ratio!r}"
        )
    if roller.indentation is not None:
        lower = (layer.lower_lift and layer.lower_lift.thickness) if fed_layer is None else fed_layer.lower
        elongates = layer.base == "slip"
        _require_indentation(
            roller.indentation, layer.height, roller, fed_ratio, has_lower=bool(lower), elongates=elongates
        )


def _require_indentation(
    depth: float, height: float, roller: Roller, fed_ratio: float, *, has_lower: bool, elongates: bool
) -> None:
    if roller.profile != "parabola" and depth >= roller.radius:
        raise ValueError(
            f"`indentation` must be less than the roller's `radius` {roller.radius!r} m, or its axle would be below "
            f"the mix in front, got {depth!r} m"
        )
    deepest = MAX_ELONGATED_SHARE * height
    if elongates and depth > deepest:
        raise ValueError(
            f"`indentation` must be at most {deepest:.6g} m on a frictionless base, got {depth!r} m in a layer of "
            f"{height!r} m"
        )
    if elongates:  # beyond full density the mix leaves along the travel
        return
    full = height * (1 - fed_ratio)
    if depth >= full and not has_lower:  # the depth includes the settlement of a lower lift
        raise ValueError(
            f"`indentation` must be less than {full:.6g} m, got {depth!r} m: it would press mix fed at {fed_ratio:.6g} "
            f"and {height!r} m beyond full density"
        )
