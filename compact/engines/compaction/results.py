"""Results of rolling over compacting mix: forces, contact, exit state, balances and fields.

mass    solids and water of the exit column = those of the fed column, both at rest (`LayerState.solid_height`)
work    resistance = sum of W dY + int t (slip velocity) dx/v,    W = int J sigma : d strain of the exit column
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from compact.engines.compaction.finite_strain_solid import POINT_FIELDS, FiniteStrainSolid, FloatArray, SolidState
from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.compaction.roller_contact import RollingSurface
from compact.engines.compaction.roller_frame import LayerState, RollerFrame
from compact.material import cap_plasticity
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO, Compaction
from compact.numerics.assembly import unit_moduli
from compact.rolling_contact import ContactResult, Layer, Roller

if TYPE_CHECKING:
    import meshio

    from compact.engines.compaction.bow_wave import Relaxation
    from compact.engines.compaction.steady_search import ErrorParts

MAX_ITERATIONS = 2100  # [-], of the exit state at rest; one as a rule, hundreds if it yields
ELASTIC_ITERATIONS = 2000  # [-], of them with the elastic stiffness, which converge monotonically; then Newton's method
ELASTIC_SHARE = 1e-4  # [-], of the elastic stiffness, added to the tangent of yielding mix, which may be singular
STRESS_TOLERANCE = 1e-9  # [-], stress on horizontal planes at rest over the unloading modulus
MIN_RESISTANCE = 1e-3  # [-], least scale of the work residual over the load


@dataclass(frozen=True)
class CompactionContactResult(ContactResult):
    """A `ContactResult` over compacting mix.

    Parameters
    ----------
    indentation : float
        Depth of the lowest generatrix below the fed surface [m].
    creep : float or None
        Creepage, angular speed x radius/speed - 1, of a roller that sticks and slips [-], else None.
    exit : LayerState
        Exit state by rows from the base up, for the next pass, with the lower lift behind the roller.
    exit_height : float
        Height of the layer behind the roller [m], without a lower lift.
    exit_density_ratio : float
        Mean density ratio over the exit height [-].
    elastic_recovery : float
        Rise of the surface behind the lowest generatrix [m].
    bow_wave : float
        Rise of the surface ahead of the roller above the fed layer [m].
    peak_density_ratio : float
        Largest density ratio of the layer [-].
    lower_height, lower_density_ratio : float or None
        Height [m] and mean density ratio [-] of the lower lift behind the roller; None without one.
    mass_residual, equilibrium_residual : float
        Relative residuals of mass, the larger one of both lifts, and of nodal forces [-].
    yield_residual : float
        Largest stress beyond the cap over its pressure [-].
    overdense_work : float
        Share of the plastic work at density ratios above that of the densest measurement of the pressure curve,
        where the constitutive law extrapolates [-].
    error_parts : ErrorParts
        Parts of `error`.
    solution : IncrementalRolling
        Finite-element solution, the initial guess of a neighbour.
    relaxation : Relaxation
        Slow relaxation of the bow wave of the solution.
    layer, roller, material, speed : Layer, Roller, Compaction, float
        Case.
    """

    indentation: float = 0.0
    creep: float | None = None
    exit: LayerState = None  # type: ignore[assignment]  # set by `build_result`, like those below
    exit_height: float = 0.0
    exit_density_ratio: float = 0.0
    elastic_recovery: float = 0.0
    bow_wave: float = 0.0
    peak_density_ratio: float = 0.0
    lower_height: float | None = None
    lower_density_ratio: float | None = None
    mass_residual: float = 0.0
    equilibrium_residual: float = 0.0
    yield_residual: float = 0.0
    overdense_work: float = 0.0
    error_parts: "ErrorParts" = None  # type: ignore[assignment]
    solution: IncrementalRolling = None  # type: ignore[assignment]
    relaxation: "Relaxation" = None  # type: ignore[assignment]
    layer: Layer = None  # type: ignore[assignment]
    roller: Roller = None  # type: ignore[assignment]
    material: Compaction = None  # type: ignore[assignment]
    speed: float = 0.0

    @property
    def exceeds_full_density(self) -> bool:
        """True if the density ratio exceeds 1 anywhere, outside the range of the constitutive law."""
        return self.peak_density_ratio > 1


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
    frame, state, last = solution.frame, solution.state, solution.steps[-1]
    direction = 1.0 if speed > 0 else -1.0
    x, pressure, shear = _contact_tractions(solution)
    _require_grip(solution)
    exit_state, length_ratio = exit_layer(frame, state, frame.exit_column)
    solid, lower = frame.solid.material, exit_state.lower
    return CompactionContactResult(
        load=last.load,
        resistance=direction * last.resistance,
        leading=float(x[-1]),
        trailing=float(x[0]),
        x=x if direction > 0 else -x[::-1],
        pressure=pressure if direction > 0 else pressure[::-1],
        shear_traction=shear if direction > 0 else -shear[::-1],
        work_residual=work_residual(solution),
        peak_pressure=float(pressure.max()),
        indentation=frame.mesh.height - last.bottom_height,
        creep=solution.contact.creepage,
        exit=exit_state,
        exit_height=exit_state.height,
        exit_density_ratio=exit_state.density_ratio,
        elastic_recovery=exit_state.stacked.height - last.bottom_height,
        bow_wave=float(max(solution.surface_positions[:, 1].max() - frame.mesh.height, 0.0)),
        peak_density_ratio=float(frame.to_rows(state.points.density_ratio)[frame.lower_rows :].max()),
        lower_height=None if lower is None else lower.height,
        lower_density_ratio=None if lower is None else lower.density_ratio,
        mass_residual=max(
            abs(after.solid_height(solid) * length_ratio / before.solid_height(solid) - 1)
            for after, before in ((exit_state, frame.fed_layer), (lower, frame.fed_layer.lower))
            if after is not None and before is not None
        ),
        equilibrium_residual=last.residual,
        yield_residual=_yield_residual(frame.solid, state.points),
        overdense_work=_overdense_work(solution),
        solution=solution,
        layer=layer,
        roller=roller,
        material=material,
        speed=speed,
    )


def field_mesh(rolled: CompactionContactResult) -> "meshio.Mesh":
    """Return the fields inside the layer on 8-node quadrilaterals of the fed layer.

    Parameters
    ----------
    rolled : CompactionContactResult
        Result of `roll`.

    Returns
    -------
    meshio.Mesh
        Point data: displacement [m], 3 components. Cell data, means of the elements: stress (xx, yy, zz, xy, yz, xz)
        [Pa], tension positive; mean pressure [Pa], compression positive; density_ratio [-]; plastic_work [J/m3].
    """
    return state_mesh(rolled.solution.frame, rolled.solution.state, 1.0 if rolled.speed > 0 else -1.0)


def state_mesh(frame: RollerFrame, state: SolidState, direction: float = 1.0) -> "meshio.Mesh":
    """Return the mesh of `field_mesh` for any state.

    Parameters
    ----------
    frame : RollerFrame
        Mesh under the roller.
    state : SolidState
        State of the layer.
    direction : float
        1, or -1 for a mesh mirrored about x = 0.
    """
    import meshio

    mirror = np.array([direction, 1.0])
    points, count = state.points, frame.solid.basis.nelems
    stress = np.zeros((count, 6))
    stress[:, :4] = points.stress.reshape(count, -1, 4).mean(axis=1) * [1, 1, 1, mirror[0]]
    scalars = {
        name: getattr(points, name).reshape(count, -1).mean(axis=1) for name in ("density_ratio", "plastic_work")
    }
    cells = {"stress": stress, "pressure": -stress[:, :3].mean(axis=1), **scalars}
    return meshio.Mesh(
        np.pad(frame.nodes * mirror, ((0, 0), (0, 1))),
        [("quad8", frame.solid.basis.element_dofs.T)],
        point_data={"displacement": np.pad(state.displacement * mirror, ((0, 0), (0, 1)))},
        cell_data={name: [values] for name, values in cells.items()},
    )


def work_residual(solution: IncrementalRolling) -> float:
    """Return the residual of the energy balance over the resistance [-].

    It is the work of the roller less the work of deformation of the exit column and the work of slip.

    Parameters
    ----------
    solution : IncrementalRolling
        Steady solution.
    """
    frame, surface, (load, resistance) = solution.frame, solution.surface, solution.load_and_resistance()
    nodes = frame.surface_nodes
    deformation = frame.row_heights @ frame.to_rows(solution.state.work)[:, frame.exit_column]
    slip = np.array([1.0, 0.0]) - solution.displacement_change[nodes] / frame.step  # of the roller, over its speed
    sliding = np.sum(surface.tangents(solution.state.displacement[nodes]) * slip, axis=1)
    # the work of rotation, - (1 + creepage) times the sum of the shear, cancels with its share of the slip
    slip_work = np.sum(surface.weights * solution.contact.shear * sliding)
    return float(abs(resistance - deformation - slip_work) / max(abs(resistance), MIN_RESISTANCE * load))


def _overdense_work(solution: IncrementalRolling) -> float:
    """Return the share of the plastic work of one step at density ratios beyond the measured curve [-]."""
    frame, points = solution.frame, solution.state.points
    work = points.plastic_work - frame.convect(solution.state).points.plastic_work
    near = frame.solid.point_coordinates[:, 0] > -frame.exit_distance
    area = frame.solid.point_areas * _volume_ratio(frame.solid, solution.state.displacement)
    work = np.where(near, np.maximum(work, 0.0), 0.0) * area  # interpolated where elements grow, so never negative
    overdense = points.density_ratio > HECKEL_MAX_DENSITY_RATIO
    return float(work[overdense].sum() / work.sum()) if overdense.any() else 0.0


def exit_layer(frame: RollerFrame, state: SolidState, column: int) -> tuple[LayerState, float]:
    """Return the mix of a column of Gauss points as the layer of the next pass.

    Far behind the roller the layer is uniform along x: horizontal planes have no stress, and a bonded layer has its fed
    length. A layer on a frictionless base keeps its force along x, which is 0.

    Parameters
    ----------
    frame : RollerFrame
        Mesh under the roller.
    state : SolidState
        State of the layer.
    column : int
        Index of the column.

    Returns
    -------
    layer : LayerState
        Layer at rest, with its lower lift.
    length_ratio : float
        Its length over that as fed [-].

    Raises
    ------
    RuntimeError
        If elements of the column invert, or it has no equilibrium at rest.
    """
    points = cap_plasticity.MaterialPoint(
        *(frame.to_rows(getattr(state.points, name))[:, column] for name in POINT_FIELDS)
    )
    along = frame.to_rows(frame.solid.displacement_gradient(state.displacement)[:, 0])[:, column]
    if along.min() <= -1:
        raise RuntimeError("elements of the exit column invert along the travel; reduce the depth")
    stretch = np.log1p(along)
    area = frame.row_heights * frame.to_rows(_volume_ratio(frame.solid, state.displacement))[:, column]
    mean = area @ stretch / area.sum() if frame.has_frictionless_base else 0.0
    rest, volume = relax_rows(frame.solid, points, mean - stretch)
    return LayerState(area * volume * np.exp(-mean), rest).split(frame.lower_rows), float(np.exp(mean))


def relax_rows(
    solid: FiniteStrainSolid, points: cap_plasticity.MaterialPoint, strain_along: FloatArray
) -> tuple[cap_plasticity.MaterialPoint, FloatArray]:
    """Strain rows of mix along x, and across until their horizontal planes have no stress.

    Parameters
    ----------
    solid : FiniteStrainSolid
        Solid with the constitutive law.
    points : MaterialPoint
        States of the rows.
    strain_along : ndarray, shape (n,)
        Strain along x [-].

    Returns
    -------
    points : MaterialPoint
        States at rest.
    volume_ratio : ndarray, shape (n,)
        Volumes over those before [-].

    Raises
    ------
    RuntimeError
        If the iteration does not converge.
    """
    strain = np.zeros((len(strain_along), 3))
    strain[:, 0] = strain_along
    material = solid.material
    modulus, poisson = material.elastic_moduli(points.max_density_ratio)
    two_shear, _, shear, lame = modulus * unit_moduli(poisson)
    elastic = np.zeros((*np.shape(shear), 2, 2))
    elastic[..., 0, 0], elastic[..., 1, 1] = two_shear + lame, shear
    for iteration in range(MAX_ITERATIONS):
        rest, tangent = cap_plasticity.integrate_points(
            material, points, strain, solid.rate_factor, tangent=iteration >= ELASTIC_ITERATIONS
        )
        if np.abs(rest.stress[:, [1, 3]]).max() < STRESS_TOLERANCE * material.unloading_modulus:
            rest.stress[:, [1, 3]] = 0.0
            return rest, np.exp(strain[:, 0] + strain[:, 1])
        stiffness = elastic if tangent is None else tangent[:, 1:, 1:] + ELASTIC_SHARE * elastic
        strain[:, 1:] -= np.linalg.solve(stiffness, rest.stress[:, [1, 3], None])[..., 0]
    raise RuntimeError(
        f"the exit column has no equilibrium at rest: {np.abs(rest.stress[:, [1, 3]]).max():.3g} Pa on horizontal "
        f"planes after {MAX_ITERATIONS} iterations; reduce the depth"
    )


def _require_grip(solution: IncrementalRolling) -> None:
    """Require a torque within the friction limit; the creepage of a skidding roller is undetermined."""
    if not isinstance(solution.surface, RollingSurface):
        return
    utilisation = solution.surface.friction_utilisation(solution.contact)
    if utilisation >= 1:
        raise RuntimeError(
            f"the roller skids: the torque requires {utilisation:.3g} times the friction limit; reduce the torque"
        )


def _contact_tractions(solution: IncrementalRolling) -> tuple[FloatArray, ...]:
    """Return x, pressure and shear along the contact; its edges lie half-way to the first node without contact."""
    touching = np.flatnonzero(solution.contact.pressure > 0)
    x = solution.surface_positions[:, 0]
    if not len(touching):
        raise RuntimeError("the roller does not touch the layer; increase the depth")
    first, last = touching[0], touching[-1]
    if first == 0 or last == len(x) - 1:
        raise RuntimeError(
            f"the contact reaches the end of the mesh, from {x[first]:.3g} to {x[last]:.3g} m; reduce the depth"
        )
    trailing, leading = (x[first - 1] + x[first]) / 2, (x[last] + x[last + 1]) / 2
    inside = slice(first, last + 1)
    tractions = (solution.surface_pressure, solution.surface_shear)
    return (
        np.concatenate([[trailing], x[inside], [leading]]),
        *(np.concatenate([[0.0], traction[inside], [0.0]]) for traction in tractions),
    )


def _volume_ratio(solid: FiniteStrainSolid, displacement: FloatArray) -> FloatArray:
    """Return J of the Gauss points; 1 plus the change of area in small strain."""
    gradient = solid.displacement_gradient(displacement)
    if solid.finite:
        return (1 + gradient[:, 0]) * (1 + gradient[:, 3]) - gradient[:, 1] * gradient[:, 2]
    return 1 + gradient[:, 0] + gradient[:, 3]


def _yield_residual(solid: FiniteStrainSolid, points: cap_plasticity.MaterialPoint) -> float:
    """Return the largest stress correction of one more step without strain, over the yield pressure."""
    strain = np.zeros((len(points.stress), 3))
    rest, _ = cap_plasticity.integrate_points(solid.material, points, strain, solid.rate_factor, tangent=False)
    yield_pressure = solid.material.yield_pressure(points.max_density_ratio) * solid.rate_factor
    return float((np.abs(rest.stress - points.stress).max(axis=1) / yield_pressure).max())
