"""Engine "compaction": steady rolling of a rigid roller over compacting mix, plane strain, finite strain.

The roller rolls element by element (`rolling`) until the motion is steady (`steady_search`), first on a coarse mesh,
then on finer ones that start from the interpolated state. What relaxes slowly is the bow wave: its relaxation length is
found on the coarse mesh, and each mesh jumps along its slow mode (`steady_state`). A prescribed load, peak pressure or
exit density corrects the depth in the same cycles. A neighbouring case, of a near depth or of another speed, roller or
mix, starts from the last solution stretched to it.

    mass    solids and water of the exit column = those of the fed column, both at rest (`LayerState.solid_height`)
    work    resistance = sum of W dY + int t (slip velocity) dx/v,    W = int J sigma : d strain of the exit column

The forces converge with first order in the length of an increment, the load from above on all lifts that were computed.
The length of the elements matters less. The last two searches therefore have the same mesh, and the load is that in the
limit of short increments, by loads P of increments of half the length and P_c of twice that. Searches on coarser meshes
tell the error by the length of the elements.

    P_limit = P + (P - P_c)

The error has three parts: of mesh and increments; of the drift, the distance to the steady state along the slow mode;
of the start, the scatter of that distance, the last transient and the miss of a target.

Range: frictionless, sliding, free and driven rollers, bonded and frictionless bases, contact
angles up to some 25 degrees where the mix has the voids. On a layer that is high compared with the contact length, the
bow wave may grow without a steady state; then `HeapingError` is raised, for most such depths before any finite elements
(`heaping`). A mean exit density ratio of 1 or more is refused. Times and errors: `studies/speed_against_error.py`.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from compact import rolling_contact
from compact.engines.compaction import COMPACTION
from compact.engines.compaction.finite_strain_kernels import announce_compilation
from compact.engines.compaction.heaping import require_no_heaping
from compact.engines.compaction.layer_state import LayerState
from compact.engines.compaction.rolling import PARTS, IncrementalRolling
from compact.engines.compaction.rolling_case import TARGET_TOLERANCE, DepthTarget, RollingCase, RollingNumerics
from compact.engines.compaction.steady_search import SteadySearch
from compact.engines.compaction.steady_state import ErrorParts, Relaxation
from compact.material import cap_plasticity
from compact.material.laws import MEASURED_DENSITY_RATIO, Compaction, DruckerPragerCap
from compact.rolling_contact import Contact, HeapingError, Layer, Roller, resistance_scale

if TYPE_CHECKING:
    import meshio

__all__ = ["CompactionContactResult", "HeapingError", "roll"]

COARSE_INCREMENTS = 4  # [-], least elements per contact length of a mesh
RATIO = 2  # [-], of the elements of successive meshes, and of the parts of a step on the last one
CORRECTION_SHARE = 0.5  # [-], error of the extrapolated load over its correction; see docs/theory/compaction.md
TYPICAL_CHANGE = 0.1  # [-], of the forces over the length of an increment in contact lengths, least measured one
TYPICAL_REFINEMENT = 0.1  # [-], of the forces over the squared length of an element, median of random lifts
MAX_ELONGATED_SHARE = 0.7  # [-], largest depth over the layer height on a frictionless base
NEIGHBOUR_DEPTH = 1.03  # [-], largest ratio of depths of neighbours; waves further apart relax longer than from rest


@dataclass(frozen=True, kw_only=True)
class CompactionContactResult(Contact):
    """A `Contact` over compacting mix, the start of a neighbouring one.

    Parameters
    ----------
    elastic_recovery : float
        Rise of the surface behind the lowest generatrix [m].
    solution : IncrementalRolling
        Finite-element solution.
    error_parts : ErrorParts
        Parts of `error`.
    load_factor : float
        Reported load, in the limit of short increments, over that of the mesh, which pressures and fields have [-].
    relaxation : Relaxation
        Slow relaxation of the bow wave of the solution.
    """

    elastic_recovery: float
    solution: IncrementalRolling
    error_parts: ErrorParts = field(default_factory=ErrorParts)
    relaxation: Relaxation = field(default_factory=Relaxation)
    load_factor: float = 1.0


def build_result(
    solution: IncrementalRolling, layer: Layer, roller: Roller, material: Compaction, speed: float
) -> CompactionContactResult:
    """Evaluate a steady solution.

    Parameters
    ----------
    solution : IncrementalRolling
        Steady solution.
    layer, roller, material : Layer, Roller, Compaction
        Case.
    speed : float
        Speed of the roller along x [m/s].

    Returns
    -------
    CompactionContactResult

    Raises
    ------
    RuntimeError
        If the roller has no contact or skids, the contact reaches the end of the mesh, or the exit state has no
        equilibrium at rest.
    """
    frame, points = solution.frame, solution.state.points
    touching, positions = np.flatnonzero(solution.contact.pressure > 0), solution.surface_positions
    if not len(touching):
        raise RuntimeError("the roller does not touch the layer; increase the depth")
    first, end = touching[0], touching[-1] + 1
    if first == 0 or end == len(positions):
        edges = positions[[first, end - 1], 0]
        raise RuntimeError(
            f"the contact reaches the end of the mesh, from {edges[0]:.3g} to {edges[1]:.3g} m; reduce the depth"
        )
    solution.surface.require_friction(solution.contact)
    last = solution.steps[-1]
    # the edges lie half-way to the first node without contact
    trailing, leading = positions[first - 1 : first + 1, 0].mean(), positions[end - 1 : end + 1, 0].mean()
    x = np.concatenate([[trailing], positions[first:end, 0], [leading]])
    nodal = solution.contact.pressure, solution.contact.shear
    pressure, shear = (np.pad(solution.surface_traction(each)[first:end], 1) for each in nodal)
    exit_state, length_ratio = frame.exit_layer(solution.state)
    solid, lower = frame.solid.material, exit_state.lower
    given = frame.inflow or frame.fed_layer
    lost = [
        abs(after.solid_height(solid) * length_ratio / before.solid_height(solid) - 1)
        for after, before in ((exit_state, given), (lower, given.lower))
        if after is not None and before is not None
    ]
    # one more step without strain corrects the stresses beyond the yield surface
    still = np.zeros((len(points.stress), 3))
    rest, _ = cap_plasticity.integrate_points(solid, points, still, frame.solid.rate_factor, tangent=False)
    # work of the roller less the work of deformation of the exit column and the work of slip
    deformation = frame.row_heights @ frame.to_rows(solution.state.work)[:, frame.exit_column]
    balance = abs(last.resistance - deformation - last.slip_resistance)
    excess = np.abs(rest.stress - points.stress).max(axis=1)
    wave = float(max(positions[:, 1].max() - frame.mesh.height, 0.0))
    loaded = points.density_under_load(solid)
    result = CompactionContactResult(
        load=last.load,
        resistance=last.resistance,
        leading=float(leading),
        trailing=float(trailing),
        x=x,
        pressure=pressure,
        shear_traction=shear,
        work_residual=float(balance / resistance_scale(last.resistance, last.load)),
        peak_pressure=float(pressure.max()),
        indentation=frame.mesh.height - last.bottom_height,
        creep=solution.creepage,
        exit=exit_state,
        exit_height=exit_state.height,
        exit_density_ratio=exit_state.density_ratio,
        elastic_recovery=exit_state.stacked.height - last.bottom_height,
        bow_wave=wave,
        peak_density_ratio=float(frame.to_rows(points.density_ratio)[frame.lower_rows :, frame.exit_column :].max()),
        peak_loaded_density_ratio=float(frame.to_rows(loaded)[:, frame.exit_column :].max()),
        overfull_share=_share_between_edges(solution, loaded > 1, trailing, leading),
        density_reset=frame.density_reset(solution.state),
        lower_height=None if lower is None else lower.height,
        lower_density_ratio=None if lower is None else lower.density_ratio,
        mass_residual=max(float(np.abs(frame.mass_residuals(solution.state)).max()), *lost),
        equilibrium_residual=last.residual,
        yield_residual=float((excess / frame.solid.yield_pressure(points.max_density_ratio)).max()),
        overdense_work=_overdense_work(solution),
        solution=solution,
        layer=layer,
        roller=roller,
        material=material,
        speed=speed,
        effort=f"force residual {last.residual:.1e}; {len(solution.steps)} steps on the last mesh; bow wave "
        f"{wave * 1e3:.2f} mm",
    )
    return rolling_contact.for_travel(result, speed)


def field_mesh(rolled: CompactionContactResult) -> "meshio.Mesh":
    """Return the fields inside the layer of a result, see `RollerFrame.field_mesh`."""
    return rolled.solution.frame.field_mesh(rolled.solution.state, 1.0 if rolled.speed > 0 else -1.0)


def _share_between_edges(solution, chosen, trailing, leading):
    """Return the share of chosen Gauss points in the area of deformed mix between the edges of the contact [-]."""
    solid, displacement = solution.frame.solid, solution.state.displacement
    x = solid.point_coordinates[:, 0] + np.asarray(solid.basis.interpolate(displacement[:, 0])).ravel()
    inside = (x > trailing) & (x < leading)
    area = np.where(inside, solid.point_areas * solid.volume_ratio(displacement), 0.0)
    return float(area[chosen].sum() / area.sum())


def _overdense_work(solution: IncrementalRolling) -> float:
    """Return the share of the plastic work of one step at density ratios beyond the measured curve [-]."""
    frame, points = solution.frame, solution.state.points
    work = points.plastic_work - frame.convect(solution.state).points.plastic_work
    near = frame.solid.point_coordinates[:, 0] > -frame.exit_distance
    area = frame.solid.point_areas * frame.solid.volume_ratio(solution.state.displacement)
    work = np.where(near, np.maximum(work, 0.0), 0.0) * area  # interpolated where elements grow, so never negative
    overdense = points.density_ratio > MEASURED_DENSITY_RATIO
    return float(work[overdense].sum() / work.sum()) if overdense.any() else 0.0


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
    **options: Any,
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
    require_compactable(layer, roller, material, speed, fed_layer)
    rolling_contact.require_torque_allowed(roller, torque)
    case = RollingCase(layer, roller, material, speed, torque, fed_layer, numerics)
    target = DepthTarget(case, exit_density_ratio)
    announce_compilation(numerics.progress)
    if case.heaping is not None and fed_layer is None and not isinstance(material, DruckerPragerCap):
        require_no_heaping(case.heaping, target)
    with threadpool_limits(1):
        search = None if start is None else _neighbour(target, start)
        if start is not None and search is not None:
            search.run()
            return _to_result(search, start.error_parts.mesh)
        for elements, parts in refinements(numerics.increments):
            depth = target.initial_depth() if search is None else search.depth
            rolling = case.roller_at_rest(case.create_frame(depth, elements), parts)
            search = SteadySearch(target, rolling, depth, search)
            search.run()
        assert search is not None  # there is a refinement
        return _to_result(search)


def refinements(elements: int) -> list[tuple[int, int]]:
    """Return elements per contact length and parts of a step of successive refinements."""
    counts = [elements]
    while (coarser := round(counts[0] / RATIO)) >= COARSE_INCREMENTS:
        counts.insert(0, coarser)
    halves = PARTS // RATIO
    if len(counts) == 1:
        return [(elements, 1), (elements, halves), (elements, PARTS)]  # the first one finds the depth of a target
    # two meshes of equal parts tell the error by the elements
    return [*((count, 1) for count in counts[:-2]), (counts[-2], halves), (elements, halves), (elements, PARTS)]


def mesh_errors(fine: SteadySearch) -> tuple[float, float] | None:
    """Return the relative errors of load and resistance by elements and increments [-]; None without a coarser search.

    That by the increments is a share of the correction for the load, and the whole of it for the resistance, which is
    not extrapolated. That by the elements is the error of second order after the last change of the mesh. Both are at
    least those of a typical lift, since two searches may agree by chance; their squares add. Searches are compared at
    the depth of the coarser one.

    Parameters
    ----------
    fine : SteadySearch
        Search on the last refinement, with those on the coarser ones.
    """
    halves = fine.coarse
    if halves is None:
        return None
    load, resistance = fine.values[:2] * [fine.load_factor, 1.0]
    scales = np.array([load, resistance_scale(resistance, load)])
    corrections = (fine.first[0] - halves.values)[:2] / (fine.increments / halves.increments - 1)
    by_increments = np.maximum(np.abs(corrections) / scales, TYPICAL_CHANGE / fine.increments)
    if fine.load_factor != 1:
        by_increments[0] *= CORRECTION_SHARE
    by_elements = np.full(2, TYPICAL_REFINEMENT / fine.elements**2)
    coarser = halves.coarse
    if coarser is not None and round(coarser.elements) < round(halves.elements):
        order = (halves.elements / coarser.elements) ** 2 - 1
        changes = (halves.first[0] - coarser.values)[:2] / order
        by_elements = np.maximum(np.abs(changes) / scales, by_elements)
    load_error, resistance_error = np.hypot(by_increments, by_elements).tolist()
    return load_error, resistance_error


def _neighbour(target: DepthTarget, start: CompactionContactResult) -> SteadySearch | None:
    """Return the search from a result, or None if its depth is not near enough; raise if its layer is another one."""
    case, old, frame = target.case, start.solution, start.solution.frame
    same_base = (case.layer.base == "slip") == frame.has_frictionless_base
    if case.fed_layer is not frame.inflow or not same_base or case.layer.lower_lift != start.layer.lower_lift:
        raise ValueError("`start` must have the same `base`, `lower_lift` and `fed_layer`, got a result of others")
    depth = target.depth_from(getattr(start, target.quantity), start.indentation)
    ratio = depth / start.indentation
    if max(ratio, 1 / ratio) > NEIGHBOUR_DEPTH:
        return None
    search = SteadySearch(target, case.stretched(old, depth), depth)
    search.relaxation, search.known_factor = start.relaxation.at_depth(depth / old.depth), start.load_factor
    return search


def _to_result(search: SteadySearch, known_mesh: tuple[float, float] | None = None) -> CompactionContactResult:
    """Evaluate a steady solution and require what is prescribed; a neighbour has the known error of the mesh.

    Raises
    ------
    UnsteadyError
        If the search has not decided whether the motion becomes steady.
    """
    search.require_steady()
    case, solution, target = search.case, search.rolling, search.target
    rolled = build_result(solution, case.layer, case.roller, case.material, case.speed)
    rolled = replace(rolled, load=rolled.load * search.load_factor, load_factor=search.load_factor)
    surface, torques, tolerance = solution.surface, None, TARGET_TOLERANCE
    if solution.contact.creepage is not None:
        torques = case.torque or 0.0, float(-surface.radius * (surface.weights @ solution.contact.shear))
    density = target.value if target.quantity == "exit_density_ratio" else None
    if density is not None and not solution.frame.solid.finite:
        tolerance += 0.5 * (1 - target.fed_ratio / density) ** 2  # small strain determines it to half a squared strain
    rolling_contact.require_on_target(rolled, case.roller, tolerance, exit_density_ratio=density, torque=torques)
    mesh = known_mesh or mesh_errors(search)
    if mesh is not None:  # the work balance is another estimate of the resistance
        mesh = mesh[0], max(mesh[1], rolled.work_residual or 0.0)
    parts = search.error_parts(mesh)
    return replace(rolled, error=parts.total, error_parts=parts, relaxation=search.relaxation)


def require_compactable(
    layer: Layer, roller: Roller, material: Compaction, speed: float, fed_layer: LayerState | None = None
) -> None:
    """Require a case that the engine can compute.

    Parameters
    ----------
    layer, roller, material, speed, fed_layer
        As of `roll`.

    Raises
    ------
    ValueError
        With the argument that is out of its range.
    """
    if not isinstance(material, Compaction):
        raise ValueError(f"`material` must be Compaction, got {type(material).__name__}; use the engine fem for others")
    if layer.plies:
        raise ValueError(f"`plies` are for linear layers, got {len(layer.plies)}; a compacting layer takes `fed_layer`")
    COMPACTION.require(layer, roller, speed)
    if fed_layer is not None and abs(fed_layer.height / layer.height - 1) > rolling_contact.HEIGHT_TOLERANCE:
        raise ValueError(f"`layer` must be as high as `fed_layer`, {fed_layer.height!r} m, got {layer.height!r} m")
    if fed_layer is not None and layer.lower_lift is not None and fed_layer.lower is None:
        raise ValueError("`fed_layer` on a `lower_lift` must have a state `lower` of it, got None")
    fed_ratio = material.fed_density_ratio if fed_layer is None else fed_layer.density_ratio
    depth, height = roller.indentation, layer.height
    lower = layer.lower_lift if fed_layer is None else fed_layer.lower  # the depth includes its settlement
    slips, filled = layer.base == "slip", f"mix fed at {fed_ratio:.6g} and {height!r} m beyond full density"
    limits = (
        (roller.profile != "parabola", roller.radius, "the axle would be below the mix in front"),
        (slips, MAX_ELONGATED_SHARE * height, "mix on a frictionless base leaves along the travel"),
        (not slips and lower is None, height * (1 - fed_ratio), f"it would press {filled}"),
    )
    for applies, limit, why in limits:
        if depth is not None and applies and depth >= limit:
            raise ValueError(f"`indentation` must be less than {limit:.6g} m, got {depth!r} m: {why}")
