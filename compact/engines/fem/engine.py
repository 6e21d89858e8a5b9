"""Engine "fem": a rigid roller in steady motion over a linear layer of quadratic elements in plane strain.

The elastic layer is factorised once per mesh, Poisson's ratio and base and condensed to its surface (`compliance`). The
material at a speed retards that compliance along the surface. The contact with free edges is solved on it (`contact`),
with zones of stick and slip where the roller turns. The secant method in logarithms finds the indentation of a
prescribed load or peak pressure. The load is the sum of the surface tractions, the resistance that of the pressure on
the slope of the roller and of the shear. The energy balance uses stresses and strains inside the layer.

The first discretisation fits the elastic contact, so that all speeds at one indentation share a mesh and its factorised
stiffness. Retardation times that are short compared with the passage of the roller produce boundary layers at the edges
of the contact. Refined discretisations centre a mesh, finer at the edges, on the contact found last.

Range at default settings: contact half-widths from 0.001 to 3 layer heights (to 40 on a frictionless base); nu from 0
to 0.49; v tau/a from 1e-4 to 1e4; friction to 1.

Errors in this range, against closed forms and the engine "spectral":

    load                         0.02 %
    edges                        0.2 %, of viscoelastic layers 0.3 %, of viscoelastic plies 1.5 %
    peak pressure                0.1 %, of viscoelastic plies 0.5 %
    resistance, viscoelastic     0.3 %
    shear with stick and slip    2 %

They hold for plies whose moduli differ 20-fold, if the top ply is a fifth of the half-width thick or more.

Fields: the stress is that of the elastic layer of relaxed modulus under the same forces, with its strain e. Per length
rolled and unit volume, branch k of the creep function dissipates

    W' = E sum_k J_k (e - z_k) : c : (e - z_k)/l_k,    l_k = |v| theta_k,

where z_k is the retarded strain. Retardation of the elastic displacement along each line of nodes gives that of the
viscoelastic layer.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from compact import rolling_contact
from compact.engines.fem import FEM, compliance
from compact.engines.fem.contact import (
    BeyondWindowError,
    ContactSolution,
    Discretisation,
    RollingProblem,
    UnresolvedError,
    solve_at_indentation,
    solve_at_target,
)
from compact.engines.spectral import engine as spectral
from compact.engines.spectral.galerkin_system import creep_function
from compact.material.laws import Elastic
from compact.mesh import DEFAULT_ERROR, EDGE_REFINEMENT, RowMesh, elements_for, graded_mesh
from compact.numerics import Array
from compact.numerics.assembly import element_unknowns, strain_matrix
from compact.numerics.validation import require_instance, require_positive
from compact.rolling_contact import Contact, GapGeometry, Layer, Roller, RollerCondition

if TYPE_CHECKING:
    import meshio

PRESSURE_SAMPLES = 201  # [-], points along the contact in the result
TARGET_FACTOR = 10.0  # [-], tolerance of the target in the result over that of its solution
EXTRA_TERMS = 2  # [-], pressure terms added on the refined mesh of the error estimate, per `MAX_TERMS` or part of them
ERROR_FACTOR = 2.0  # [-], error estimate over the difference from the refined solution, see `_error_estimate`
SCATTER_FACTOR = 0.15  # [-], error estimate per scatter of the peak pressure, where the difference is small by chance
COMMON_ERROR = 3e-6  # [-], of both meshes
MIN_HALF_WIDTH = 1e-7  # [-], of a contact over the layer height, that a mesh of the layer can resolve
BASE_TERMS = 12  # [-], of the pressure; more resolve thinner boundary layers, but blur the edges beyond the mesh
TERMS_PER_WIDTH = 0.5  # [-], per half-width over the top ply, within whose thickness the pressure of a thin ply falls
MAX_TERMS = 30  # [-], of the first discretisation
MAX_LEVEL = 4  # [-], of refinement where the estimated error exceeds the tolerance; the first mesh has level 0
ELEMENT_GROWTH = 1.4  # [-], ratio of elements per half-width from one level to the next, from level 2
EDGE_GROWTH = 4  # [-], ratio of the refinement at the edges of the contact from one level to the next
MAX_EDGE_REFINEMENT = 128  # [-], elements inside the contact over those at its edges
FIRST_TERM_GROWTH = 2.0  # [-], ratio of pressure terms of level 1 to level 0
TERM_GROWTH = 1.5  # [-], ratio of pressure terms from one level to the next, from level 2
SPECTRAL_TOLERANCE = 1e-2  # [-], of the contact by the spectral engine to which a mesh is fitted
MAX_UNKNOWNS = 60_000  # [-], of a refined mesh; the mesh of its error estimate has four times as many
MESH_ROUNDING = 1e-6  # [-], of the layer height, by which a mesh may miss the surface or an interface
WINDOW = 1.3  # [-], half-width of the loaded zone over that of the estimated contact
WINDOW_GROWTH = 1.5  # [-], of a loaded zone that does not contain the contact
MAX_WINDOWS = 8  # [-], loaded zones
REMEDY_ERROR = 1.05  # [-], tolerance of a remedy over the error estimate, more than its rounding

GAUSS_WEIGHTS = np.array([5, 8, 5]) / 18  # [-], of the three streamlines in a row of elements

Found = TypeVar("Found")


@dataclass(frozen=True, kw_only=True)
class FemContactResult(Contact):
    """A `Contact` with the data that its fields require.

    Its `history` lists (trailing, leading, step over length) of every iteration, along the travel [m], as are `mesh`
    and `forces`.

    Parameters
    ----------
    mesh : RowMesh
        Mesh of the layer.
    forces : ndarray
        Forces on the surface nodes over the relaxed modulus [m], shape (2, n).
    """

    mesh: RowMesh
    forces: Array

    @property
    def stiffness(self) -> compliance.LayerStiffness:
        """Factorised stiffness of the layer, shared by all contacts on the same mesh."""
        return compliance.layer_stiffness(self.mesh, self.material.poisson, self.layer)

    @property
    def moduli(self) -> Array:
        """Relaxed moduli of the elements [Pa], shape (elements, 4)."""
        return self.material.youngs_modulus * compliance.element_moduli(self.mesh, self.material.poisson, self.layer)

    def elastic_displacement(self) -> Array:
        """Displacement of the layer of relaxed modulus under the same forces [m], shape (nodes, 2).

        On a frictionless base the displacements along x count from that of the base below the roller.
        """
        stiffness = self.stiffness
        forces = np.zeros((stiffness.basis.N, 2))
        forces[stiffness.surface] = self.forces.T
        u, base = stiffness.displacement(forces[:, :, None])[:, :, 0], stiffness.lines[0]
        u[:, 0] -= u[base[np.argmin(np.abs(stiffness.basis.doflocs[0][base]))], 0]
        return u

    def elastic_strain(self) -> Array:
        """Strain (e_xx, e_yy, 2 e_xy, e) of that layer at the Gauss points [-], shape (elements, points, 4)."""
        basis = self.stiffness.basis
        displacement = self.elastic_displacement().ravel()[element_unknowns(basis)]
        return np.einsum("eqsb,eb->eqs", strain_matrix(basis), displacement, optimize=True)


def roll(
    layer: Layer,
    roller: Roller,
    material: Elastic,
    speed: float,
    *,
    torque: float | None = None,
    mesh: RowMesh | None = None,
    tolerance: float = DEFAULT_ERROR,
    estimate: bool = True,
) -> FemContactResult:
    """Solve the steady motion of one roller over a linear layer.

    Parameters
    ----------
    layer : Layer
        Layer of any height, base and plies. A frictionless base holds the layer behind the roller; the indentation
        counts from the surface ahead.
    roller : Roller
        Roller of any profile. A "sliding" one exerts the traction f p along the travel on the whole contact; a "free"
        or "driven" one has zones of stick and slip.
    material : Elastic or Viscoelastic
        Material of the layer.
    speed : float
        Speed of the roller along x [m/s], not 0. For speed < 0 `leading` and `trailing` remain positive ahead; `x`,
        `shear_traction` and `resistance` refer to the fixed axis x.
    torque : float, optional
        Torque on a free or driven roller per unit length [N], positive in the sense of rolling along the travel.
    mesh : RowMesh, optional
        Mesh of the layer with a line of nodes at every interface of plies. Unless given, it is chosen for the expected
        contact, the same at every speed if the indentation is prescribed.
    tolerance : float
        Largest relative error of load and resistance [-] if no mesh is given. Mesh and pressure terms are refined until
        the error estimates are below it. The default has 0.03 % error of the resistance in
        studies/speed_against_error.py, at 0.1 s per further speed.
    estimate : bool
        Estimate the errors. Without the estimate `error` is None and the mesh is not refined.

    Raises
    ------
    RuntimeError
        If no mesh of up to `MAX_UNKNOWNS` unknowns reaches the tolerance, or no contact is found.

    Examples
    --------
    >>> from compact.rolling_contact import Contact, Layer, Roller
    >>> mix = Elastic(youngs_modulus=10e6, poisson=0.3)
    >>> rolled = roll(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.2)
    >>> f"load {rolled.load / 1e3:.2f} kN/m, edge {rolled.leading * 1e3:.2f} mm"
    'load 15.09 kN/m, edge 13.85 mm'
    """
    problem, mesh = along_travel(layer, roller, material, speed, mesh, tolerance)
    rolling_contact.require_torque_allowed(roller, torque)
    problem = replace(problem, torque=torque or 0.0)
    with threadpool_limits(1):  # the matrices are small; threads cost more than they save
        if mesh is None and estimate:
            found = _solve_to_tolerance(problem, tolerance)
        else:
            found = _solve_on(problem, initial_discretisation(problem, mesh, tolerance), estimate)
    return rolling_contact.for_travel(replace(found, speed=speed), speed)


def along_travel(
    layer: Layer, roller: Roller, material: Elastic, speed: float, mesh: RowMesh | None, tolerance: float
) -> tuple[RollingProblem, RowMesh | None]:
    """Return the problem and a given mesh seen along the travel; ValueError for arguments beyond the engine's range."""
    FEM.require(layer, roller, speed)
    require_positive(tolerance=tolerance)
    require_instance(Elastic, "Elastic or Viscoelastic for the engine fem", material=material)
    problem = RollingProblem(layer, roller, material, abs(speed))
    if mesh is None:
        return problem, None
    rounding = MESH_ROUNDING * layer.height
    if abs(mesh.height - layer.height) > rounding:
        raise ValueError(f"`mesh` must be as high as the layer, {layer.height!r} m, got {float(mesh.height)!r} m")
    missed = [y for y in layer.interfaces if np.abs(mesh.y - y).min() > rounding]
    if missed:
        raise ValueError(
            f"`mesh` must have a line of nodes at every interface of plies, got none at y = {missed[0]:.6g} m; "
            "move the nearest line there, or omit `mesh`"
        )
    return problem, mesh if speed > 0 else RowMesh(-mesh.x[:, ::-1], mesh.y)


def _solve_to_tolerance(problem: RollingProblem, tolerance: float) -> FemContactResult:
    """Refine the mesh and the pressure terms until the error estimates are within the tolerance."""

    def largest(result: FemContactResult) -> float:
        return max(result.error or (np.inf, np.inf))

    best: FemContactResult | None = None
    similar: Contact | None = None  # whose edges the next mesh is fitted to
    failure = None
    for level in range(MAX_LEVEL + 1):
        try:
            grid = None if similar is None else refined_discretisation(problem, level, tolerance, similar)
            if level == 0:
                grid = initial_discretisation(problem, None, tolerance)
            if grid is None:
                break
            result = _solve_on(problem, grid)
        except UnresolvedError as error:  # from the edges of a coarse contact; those of "spectral" are better
            failure, similar = error, spectral_estimate(problem) or best
        else:
            if largest(result) <= tolerance:
                return result
            similar = best = min(best or result, result, key=largest)
    limits = f"up to {MAX_LEVEL} refinements within {MAX_UNKNOWNS} unknowns"
    remedy = "use spectral, which has no stick and slip and a gap measured vertically"
    if best is None:
        raise UnresolvedError(f"no contact found by {limits}; {remedy}; {failure}")
    load, resistance = best.error or (np.inf, np.inf)
    raise RuntimeError(
        f"`tolerance` {tolerance:g} is not reached: the error estimate is {load:.1e} for the load and {resistance:.1e} "
        f"for the resistance on a mesh of {best.mesh.dofs} unknowns, the best of {limits}; raise the tolerance to "
        f"{REMEDY_ERROR * largest(best):.2g}, or {remedy}"
    )


def _solve_on(problem: RollingProblem, grid: Discretisation, estimate: bool = True) -> FemContactResult:
    """Solve a problem on one mesh."""

    def solve(window: float) -> ContactSolution:
        return solve_at_target(problem, retarded(problem, elastic_surface(problem, grid.mesh, window)), grid)

    contact = expand_window(grid, solve)
    patch, shear, E = contact.patch, contact.shear, problem.material.youngs_modulus
    x, pressure = patch.sampled(PRESSURE_SAMPLES, problem.exponent)
    traction = problem.traction_ratio * pressure if shear is None else shear.traction_at(x)
    trailing, leading = patch.edges
    resistance, lift = (E * contact.resultant).tolist()
    numbers = -lift, resistance, leading, trailing, x, E * pressure, E * traction
    result = FemContactResult(
        *numbers,
        indentation=contact.pressed.indentation,
        peak_pressure=float(E * patch.peak),
        creep=None if shear is None else shear.creepage,
        history=patch.history,
        mesh=grid.mesh,
        forces=contact.forces,
        **{name: getattr(problem, name) for name in ("layer", "roller", "material", "speed")},
    )
    torques = None
    if shear is not None:  # prescribed and computed
        moment = problem.roller.radius * E * np.sum(patch.weight * shear.traction_at(patch.x))
        torques = problem.torque, float(-moment)
    rolling_contact.require_on_target(result, problem.roller, TARGET_FACTOR * problem.target_tolerance, torque=torques)
    result = replace(result, work_residual=_work_residual(problem, result, contact))
    return replace(result, error=_error_estimate(grid, result, contact)) if estimate else result


def expand_window(grid: Discretisation, solve: Callable[[float], Found]) -> Found:
    """Call `solve(window)` with a growing half-width of the loaded zone [m] until the zone contains the contact.

    `solve` raises `BeyondWindowError` where the zone is too small.
    """
    window = WINDOW * grid.half_width
    for _ in range(MAX_WINDOWS):
        try:
            return solve(window)
        except BeyondWindowError as beyond:
            window, reason = WINDOW_GROWTH * window, beyond
    raise UnresolvedError(f"the contact extends beyond a loaded zone of {window:.3g} m to either side: {reason}")


def elastic_surface(
    problem: RollingProblem, mesh: RowMesh, window: float, stretch_rate: bool = False
) -> compliance.SurfaceCompliance:
    """Compliance of the elastic layer of unit modulus, loaded within a half-width `window` [m] of the mesh."""
    sheared = bool(problem.traction_ratio) or problem.turns_with_friction or problem.roller.profile == "deformed"
    layer, poisson = problem.layer, problem.material.poisson
    return compliance.surface_compliance(mesh, poisson, layer, window, sheared, stretch_rate)


def retarded(problem: RollingProblem, surface: compliance.SurfaceCompliance) -> compliance.SurfaceCompliance:
    """Compliance of the viscoelastic layer in steady motion from that of the elastic one."""
    return surface.retarded(compliance.steady_creep_operator(surface.x, problem.material, problem.speed))


def _error_estimate(grid: Discretisation, result: FemContactResult, contact: ContactSolution) -> tuple[float, float]:
    """Estimated relative errors of load and resistance.

        load        2 |P - P'|/P' + common,  common = 0.15 scatter of the peak pressure + 3e-6
        resistance  (2 |F - F'| + common |F - f P|)/max(|F'|, 1e-3 P) + work_residual/2

    P' and F' belong to the same contact with every element divided into four and more pressure terms; their error is a
    quarter or less. If the load is prescribed, P' is the load at the computed indentation. The share
    f P of a sliding roller is exact then. The energy balance detects boundary layers too thin for either mesh.

    The true error follows from the engine "spectral" on 240 random scenes, with indentation, load and peak pressure
    prescribed in each. The estimate over it is never below 0.3, and below 0.5 in 2 of 1357 cases. Its medians are 2.7
    and 2.9 for load and resistance; 95 % are below 16.
    """
    patch, surface, problem = contact.patch, contact.pressed.surface, contact.pressed.problem
    E = problem.material.youngs_modulus
    terms = grid.terms + EXTRA_TERMS * int(np.ceil(grid.terms / MAX_TERMS))
    edges = patch.edges if grid.edges else None
    finer = replace(grid, mesh=grid.mesh.refined(), indentation=result.indentation, terms=terms, edges=edges)
    window = surface.x[surface.loaded][-1] - grid.mesh.centre
    fine = retarded(problem, elastic_surface(problem, finer.mesh, window))
    refined = as_deep = solve_at_target(problem, fine, finer)
    if problem.roller.load is not None:
        as_deep = solve_at_indentation(problem, fine, finer, finer.indentation)
    true_resistance, true_lift = E * refined.resultant
    common = SCATTER_FACTOR * abs(patch.peaks[1] - patch.peaks[0]) / sum(patch.peaks) + COMMON_ERROR
    exact = 0.0 if problem.roller.load is None else problem.traction_ratio * result.load
    load = ERROR_FACTOR * abs(result.load / (-E * as_deep.resultant[1]) - 1) + common
    resistance = ERROR_FACTOR * abs(result.resistance - true_resistance) + common * abs(result.resistance - exact)
    resistance /= rolling_contact.resistance_scale(true_resistance, -true_lift)
    return float(load), float(resistance + (result.work_residual or 0.0) / 2)


def _work_residual(problem: RollingProblem, result: FemContactResult, contact: ContactSolution) -> float:
    """Energy balance over the resistance: work of the roller less dissipation in the layer and by slip.

    The held end of a slipping layer does the work Q e less the stored Q e/2 per length rolled,

        e = (1 - nu^2) Q/(E sum c thickness),

    with the shear force Q on the layer [N/m] and the relative modulus c of a ply.
    """
    patch, shear, E = contact.patch, contact.shear, problem.material.youngs_modulus
    supplied, slipped = result.resistance, 0.0
    if problem.layer.base == "slip":  # work at the held end less the energy that the strain of the layer stores
        Q, stiffness = contact.forces[0].sum(), sum(ply.stiffness * ply.thickness for ply in problem.layer.stack)
        supplied += E * (1 - problem.material.poisson**2) * Q**2 / (2 * stiffness)
    if shear is not None:
        supplied += problem.torque / problem.roller.radius * (1 + shear.creepage)
        slipped = E * shear.slip_work
    elif problem.traction_ratio:
        stretch = patch.displacement @ compliance.shape_matrix(contact.pressed.surface.x, patch.x, derivative=True).T
        slip = np.array([[1.0], [0.0]]) + stretch  # of the roller on the mix, over the speed
        power = np.sum((patch.direction - patch.normal) * slip, axis=0)
        slipped = E * float(np.sum(patch.weight * patch.pressure * power))
    inside, downstream = _dissipation(result, result.elastic_strain())
    balance = supplied - float(np.sum(inside) + downstream) - slipped
    return float(abs(balance) / rolling_contact.resistance_scale(result.resistance, result.load))


def initial_discretisation(problem: RollingProblem, mesh: RowMesh | None, tolerance: float) -> Discretisation:
    """Discretisation for the elastic contact on a given mesh or one for a relative tolerance of the forces [-].

    With a prescribed load or peak pressure the width of the contact by the engine "spectral" may select a finer mesh.
    """

    def fitted(half_width: float) -> Discretisation:  # with the indentation of the elastic contact
        layer = problem.layer
        if half_width < MIN_HALF_WIDTH * layer.height:
            raise RuntimeError(f"a contact of {2 * half_width:.1g} m is too narrow for a mesh; use spectral")
        elastic = spectral.contact_of_half_width(layer, problem.material, problem.roller.radius, half_width)
        chosen = mesh or graded_mesh(layer.height, half_width, elements_for(tolerance), interfaces=layer.interfaces)
        return Discretisation(chosen, half_width, elastic.indentation, _pressure_terms(layer, half_width))

    half_width = spectral.expected_half_width(problem.layer, problem.roller, problem.material, problem.speed)
    first = fitted(half_width)
    similar = spectral_estimate(problem) if problem.roller.indentation is None else None
    if similar is None:
        return first
    reach = max(-similar.trailing, similar.leading)
    if mesh is None and reach < half_width / spectral.WIDTH_RATIO**2:
        first = fitted(spectral.quantise_half_width(reach, half_width))
    return replace(first, indentation=similar.indentation)


def refined_discretisation(
    problem: RollingProblem, level: int, tolerance: float, similar: Contact
) -> Discretisation | None:
    """Discretisation of a level of refinement from 1 on for the edges of a contact; None beyond `MAX_UNKNOWNS`."""
    edges = similar.trailing, similar.leading
    layer, half_width = problem.layer, (edges[1] - edges[0]) / 2
    elements = int(np.ceil(elements_for(tolerance) * ELEMENT_GROWTH ** (level - 1)))
    at_edge = min(EDGE_REFINEMENT * EDGE_GROWTH**level, MAX_EDGE_REFINEMENT)
    wide, centre = half_width * (1 + 0.5 / (elements * at_edge)), (edges[0] + edges[1]) / 2  # no edge on a node
    mesh = graded_mesh(layer.height, wide, elements, centre=centre, interfaces=layer.interfaces, edge=at_edge)
    if mesh.dofs > MAX_UNKNOWNS:
        return None
    terms = _pressure_terms(layer, half_width) * FIRST_TERM_GROWTH * TERM_GROWTH ** (level - 1)
    return Discretisation(mesh, half_width, similar.indentation, int(terms), edges)


def spectral_estimate(problem: RollingProblem) -> Contact | None:
    """Contact by the engine "spectral" without stick and with a vertical gap; None where that engine has none."""
    rolling: RollerCondition = "sliding" if problem.traction_ratio else "frictionless"
    profile: GapGeometry = "circle" if problem.roller.profile == "circle" else "parabola"
    roller = replace(problem.roller, rolling=rolling, profile=profile)
    try:
        return spectral.roll(problem.layer, roller, problem.material, problem.speed, rtol=SPECTRAL_TOLERANCE)
    except RuntimeError:
        return None


def _pressure_terms(layer: Layer, half_width: float) -> int:
    return int(min(BASE_TERMS + TERMS_PER_WIDTH * half_width / layer.top.thickness, MAX_TERMS))


def field_mesh(result: FemContactResult) -> "meshio.Mesh":
    """Compute the fields inside the layer under a roller in steady motion.

    Returns
    -------
    meshio.Mesh
        Quadrilaterals of 9 nodes. Point data: displacement [m], 3 components. Cell data, means over the elements:
        stress (xx, yy, zz, xy, yz, xz) [Pa], tension positive; pressure, the mean normal stress [Pa], compression
        positive; dissipation [W/m3].
    """
    import meshio

    basis, elastic, strain = result.stiffness.basis, result.elastic_displacement(), result.elastic_strain()
    x, u, speed, mirror = basis.doflocs[0], np.empty_like(elastic), abs(result.speed), [np.sign(result.speed), 1.0]
    for line in result.stiffness.lines:
        u[line] = compliance.steady_creep_operator(x[line], result.material, speed) @ elastic[line]
    parts = result.moduli[:, None] * strain
    stress = np.zeros((*parts.shape[:2], 6))
    stress[..., :3] = parts[..., 3:]
    stress[..., :2] += parts[..., :2]
    stress[..., 3] = parts[..., 2] * mirror[0]
    area = basis.dx.sum(axis=1)
    stress = np.einsum("eq,eqs->es", basis.dx / area[:, None], stress)
    dissipation = speed * _dissipation(result, strain)[0] / area
    points, displacement = (np.pad(each * mirror, ((0, 0), (0, 1))) for each in (basis.doflocs.T, u))
    cells = {"stress": [stress], "pressure": [-stress[:, :3].mean(axis=1)], "dissipation": [dissipation]}
    return meshio.Mesh(points, [("quad9", basis.element_dofs.T)], {"displacement": displacement}, cells)


def _dissipation(result: FemContactResult, strain: Array) -> tuple[Array, float]:
    """Dissipation of the elements per length rolled [J/m per m], shape (elements,), and that downstream [J/m2].

    Downstream of the mesh the strain is constant; there the branches dissipate E J_k (e - z_k) : c : (e - z_k)/2 more.
    """
    (rows, columns), basis, (_, *branches) = result.mesh.shape, result.stiffness.basis, creep_function(result.material)
    stiff = np.repeat(result.moduli[::columns], len(GAUSS_WEIGHTS), axis=0)[:, None]
    heights = (np.diff(result.mesh.y)[:, None] * GAUSS_WEIGHTS).ravel()
    positions = np.asarray(basis.global_coordinates())[0][..., None]
    e, x, areas = (_streamlines(result, values) for values in (strain, positions, basis.dx[..., None]))
    inside, remaining = np.zeros(areas.shape[:2]), 0.0
    for share, time in zip(*branches, strict=True):
        length = time * abs(result.speed)
        energy = share * np.sum(stiff * (e - compliance.retarded_along_rows(e, x[..., 0], length)) ** 2, axis=-1)
        inside += energy / length
        remaining += float(heights @ energy[:, 0] / 2)
    return (areas[..., 0] * inside).reshape(rows, 3, columns, 3).sum(axis=(1, 3)).ravel(), remaining


def _streamlines(result: FemContactResult, values: Array) -> Array:
    """Values of the Gauss points, shape (elements, 9, n), as rows along x of shape (3 rows, 3 columns, n)."""
    (rows, columns), (x, y) = result.mesh.shape, result.stiffness.basis.X
    blocks = values[:, np.lexsort((x, y))].reshape(rows, columns, 3, 3, -1)
    return blocks.transpose(0, 2, 1, 3, 4).reshape(3 * rows, 3 * columns, -1)
