"""Steady contact of a rigid roller with a surface of known compliance: pressure with free edges, stick and slip.

    u = S f + u0,    n.u = d under the pressure

S is the compliance of the layer (`compliance`), u0 an initial displacement.

**Pressure.** The pressure on trailing < x < leading vanishes at both edges with the exponents of sliding contact,

    p = xi^alpha (1 - xi)^(1 - alpha) [c_0 T_0 + ... + c_(n-1) T_(n-1)](2 xi - 1),   xi = (x - trailing)/length.

Petrov-Galerkin equations require the surface to follow the roller; their test functions may be singular at an edge.
Between fixed edges the solution contains two further pressures, singular at one edge each. Newton's method moves the
edges until both singular amplitudes vanish. The pressure is then unilateral, and the edges are independent of the mesh.

**Stick and slip.** The slip of the mix on the roller along the tangent t, relative to the rolling speed, is

    s = 1 + creepage - t.(e_x + du/dx),    creepage = angular speed x radius/v - 1,

and Coulomb's law holds at every point: |q| <= f p, and q = -f p sign(s) where s is not zero. Like the pressure, q
vanishes at both edges as a square root, times a factor linear between the surface nodes. The slip of a node is the mean
over the interval on its upstream side. An active-set method finds the nodes that stick; the creepage follows from the
prescribed sum of q, which is the torque over the radius. Pressure and shear are solved alternately.

References
----------
L. A. Galin, Contact problems (Springer, 2008): edge exponents; C. G. Broyden, Math. Comp. 19 (1965) 577: secant update;
J. J. Kalker, Three-dimensional elastic bodies in rolling contact (Kluwer, 1990); K. L. Johnson, Contact mechanics
(Cambridge, 1985), chapter 8; B. M. Irons and R. C. Tuck, Int. J. Numer. Meth. Eng. 1 (1969) 275 (Aitken relaxation).
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from compact.engines.fem.compliance import SurfaceCompliance, contact_quadrature, interpolant, shape_matrix
from compact.engines.halfplane import pressure_exponent
from compact.material.laws import Elastic
from compact.mesh import RowMesh
from compact.numerics import Array, BoolArray
from compact.rolling_contact import Layer, Roller

EDGE_TOLERANCE = 1e-9  # [-], step of an edge over the contact length at convergence
INITIAL_TERMS = 6  # [-], terms of the pressure in the first solve, whose amplitudes are smooth in the edges
TERM_GROWTH = 2.0  # [-], largest ratio of terms in successive solves; with many terms the edges converge locally only
NODES_PER_TERM = 3  # [-], surface nodes under the contact for each term; more terms resolve single nodes
PEAK_TERMS_OMITTED = 2  # [-], of the second peak pressure, whose scatter has the opposite sign
PEAK_SAMPLES = 2001  # [-], points that locate the peak pressure
MIN_LENGTH = 1e-6  # [-], contact length over the loaded zone that a mesh can resolve
MAX_STEP = 0.25  # [-], step of an edge over the contact length
MAX_EDGE_ITERATIONS = 60  # [-], of Newton's method; damped steps need 30
HISTORY_REPORTED = 4  # [-], iterations listed in an error message
FULL_STEPS = 12  # [-], iterations before steps are halved, which do not cross the kink of an edge on a node
DIFFERENCE_STEP = 1e-4  # [-], of an edge over the contact length, for the Jacobian
SECANT_TOLERANCE = 1e-9  # [-], of a prescribed load or peak pressure
STICK_SECANT_TOLERANCE = 1e-6  # [-], the same with stick and slip, whose shear converges to 1e-7
MAX_ALTERNATIONS = 60  # [-], solves for pressure and shear
SHEAR_TOLERANCE = 1e-7  # [-], change of the largest displacement at convergence; some 1e-6 of the peak pressure
FREE_ALTERNATIONS = 5  # [-], before the set of nodes is fixed; a node at an edge may otherwise alternate without end
RELAXATION_LIMITS = 0.1, 2.0  # [-], of the relaxation factor by Aitken's rule
MAX_SECANTS = 20  # [-], contacts solved for a prescribed load or peak pressure
INITIAL_POWER = 1.2  # [-], of load or peak pressure in the indentation, before two contacts are known
MAX_LOG_STEP = 1.0  # [-], of the log of the indentation
MAX_EXCHANGES = 200  # [-], of nodes between stick and slip
EDGE_CLEARANCE = 0.5  # [-], least distance of a node from an edge over its distance to the next node
FRICTION_ROUNDING = 1e-9  # [-], by which a traction that sticks may exceed f p

Edges = tuple[float, float]


class UnresolvedError(RuntimeError):
    """The contact does not converge on this mesh with this number of pressure terms; a finer mesh may resolve it."""


class BeyondWindowError(UnresolvedError):
    """The contact extends beyond the loaded zone, the nodes whose compliance is known."""


class BeyondCircleError(RuntimeError):
    """The contact includes points where the roller has a vertical tangent or lies above its centre."""


@dataclass(frozen=True)
class RollingProblem:
    """Roller in steady motion along +x over a linear layer, at a speed [m/s] and with the torque of `engine.roll`."""

    layer: Layer
    roller: Roller
    material: Elastic
    speed: float
    torque: float = 0.0

    @property
    def traction_ratio(self) -> float:
        """Shear traction on the mix along +x over pressure where the whole contact slides [-]."""
        return self.roller.friction if self.roller.rolling == "sliding" else 0.0

    @property
    def turns_with_friction(self) -> bool:
        """True if the contact has zones of stick and slip."""
        return self.roller.rolling in ("free", "driven") and self.roller.friction > 0

    @property
    def target_tolerance(self) -> float:
        """Relative tolerance of a prescribed load or peak pressure [-]."""
        return STICK_SECANT_TOLERANCE if self.turns_with_friction else SECANT_TOLERANCE

    @cached_property
    def exponent(self) -> float:
        """Edge exponent alpha of the pressure at the trailing side [-]; 1 - alpha at the leading side."""
        return float(pressure_exponent(self.material.poisson, self.traction_ratio))

    def slope(self, x: Array) -> Array:
        """Slope dy/dx [-] at x [m], by which a vertical pressure has a component along x; 0 for "deformed"."""
        R, profile = self.roller.radius, self.roller.profile
        if profile == "deformed":
            return np.zeros_like(x)
        return x / R if profile == "parabola" else x / np.sqrt(R**2 - x**2)


@dataclass(frozen=True)
class Discretisation:
    """Mesh and pressure terms for a contact, with an initial guess of it.

    Parameters
    ----------
    half_width : float
        Half-width of the contact for which the mesh is fine [m].
    indentation : float
        Initial guess of the indentation [m].
    terms : int
        Pressure terms.
    edges : (float, float), optional
        Initial guess of the trailing and leading edge in x [m].
    """

    mesh: RowMesh
    half_width: float
    indentation: float
    terms: int
    edges: Edges | None = None


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """Contact between two edges with its pressure, in units of the relaxed modulus.

    Parameters
    ----------
    edges : tuple of float
        Trailing and leading edge in x [m].
    x, weight, pressure : ndarray
        Quadrature points and weights [m], and the pressure there [-], shape (q,).
    normal, direction : ndarray
        Unit normal towards the layer and traction over pressure [-], shape (2, q).
    forces : ndarray
        Forces on the loaded nodes [m], shape (2, m).
    displacement : ndarray
        Displacement of the surface nodes by these forces [m], shape (2, n).
    coefficients : ndarray
        Coefficients of the regular pressures, then of the two singular ones.
    jacobian : ndarray, optional
        Derivatives of the two singular amplitudes with respect to the edges, shape (2, 2).
    history : tuple
        (trailing, leading, step over length) of every iteration, those of the patches from which it started included.
    peaks : tuple of float
        Peak pressures with fewer and with all terms [-]; empty unless computed.
    """

    edges: Edges
    x: Array
    weight: Array
    pressure: Array
    normal: Array
    direction: Array
    forces: Array
    displacement: Array
    coefficients: Array
    jacobian: Array | None = None
    history: tuple[tuple[float, float, float], ...] = ()
    peaks: tuple[float, ...] = ()

    @property
    def terms(self) -> int:
        """Number of regular pressure terms."""
        return len(self.coefficients) - 2

    @property
    def peak(self) -> float:
        """Peak pressure [-]: the mean of both estimates, whose errors are ten times as large and of opposite sign."""
        return sum(self.peaks) / 2

    def sampled(self, count: int, exponent: float) -> tuple[Array, Array]:
        """Sample x [m] and pressure [-] at `count` points clustered at the edges, where the pressure is zero."""
        half, (trailing, leading) = np.linspace(0, np.pi / 2, count), self.edges
        fraction, complement = np.sin(half) ** 2, np.cos(half) ** 2
        functions = _pressure_functions(fraction[1:-1], complement[1:-1], exponent, self.terms)
        x = trailing + (leading - trailing) * fraction
        x[-1] = leading
        return x, np.concatenate([[0.0], functions @ self.coefficients, [0.0]])


@dataclass(frozen=True, eq=False)
class ShearSolution:
    """Shear traction on the mix, in units of the relaxed modulus.

    Parameters
    ----------
    x, traction : ndarray
        Edges and the nodes between them [m], and the traction there [-], shape (k + 2,).
    creepage : float
        Angular speed x radius/speed - 1 [-].
    resultant : ndarray
        Force (x, y) by the traction [m], shape (2,).
    forces, displacement : ndarray
        Forces on the loaded nodes, shape (2, m), and displacement of all by them, shape (2, n) [m].
    slip_work : float
        Energy dissipated by slip per length rolled, - int q s dx [m].
    """

    x: Array
    traction: Array
    creepage: float
    resultant: Array
    forces: Array
    displacement: Array
    slip_work: float

    def traction_at(self, x: Array) -> Array:
        """Interpolate the traction [-] to points x [m], shape (q,)."""
        return _traction_functions(self.x, x) @ self.traction[1:-1]


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """Contact of a pressed roller, in units of the relaxed modulus."""

    pressed: "PressedRoller"
    patch: ContactPatch
    shear: ShearSolution | None = None

    @property
    def resultant(self) -> Array:
        """Force (x, y) on the mix [m], shape (2,)."""
        patch, shear = self.patch, self.shear
        along = patch.direction[0] - self.pressed.problem.slope(patch.x) * patch.direction[1]
        force = np.array([np.sum(patch.weight * patch.pressure * part) for part in (along, patch.direction[1])])
        return force if shear is None else force + shear.resultant

    @property
    def forces(self) -> Array:
        """Forces on all surface nodes [m], shape (2, n)."""
        surface = self.pressed.surface
        forces = np.zeros((2, len(surface.x)))
        forces[:, surface.loaded] = self.patch.forces + (0.0 if self.shear is None else self.shear.forces)
        return forces


def solve_at_target(
    problem: RollingProblem, surface: SurfaceCompliance, grid: Discretisation, start: ContactSolution | None = None
) -> ContactSolution:
    """Solve the contact with the prescribed indentation, load or peak pressure; `start` is a neighbouring contact."""
    name, value = problem.roller.target
    if name == "indentation":
        return solve_at_indentation(problem, surface, grid, value, start)
    modulus = problem.material.youngs_modulus
    logs, errors = list[float](), list[float]()
    contact, beyond, log = start, None, np.log(grid.indentation)
    for _ in range(MAX_SECANTS):
        try:
            contact = solve_at_indentation(problem, surface, grid, float(np.exp(log)), contact)
        except BeyondCircleError as error:
            beyond, log = error, (log + logs[-1]) / 2 if logs else log - 1
            continue
        logs.append(log)
        reached = -modulus * contact.resultant[1] if name == "load" else modulus * contact.patch.peak
        errors.append(float(np.log(reached / value)))
        if abs(errors[-1]) < problem.target_tolerance:
            return contact
        slope = INITIAL_POWER if len(logs) == 1 else (errors[-1] - errors[-2]) / (logs[-1] - logs[-2])
        log = log - np.clip(errors[-1] / slope, -MAX_LOG_STEP, MAX_LOG_STEP)
    if beyond is not None:
        raise beyond
    nearest = int(np.argmin(np.abs(errors)))
    raise UnresolvedError(
        f"`{name}` {value:.6g} is not reached in {len(logs)} secant steps; the nearest is "
        f"{np.expm1(errors[nearest]):+.1e} off, at an indentation of {1e3 * np.exp(logs[nearest]):.4g} mm"
    )


def solve_at_indentation(
    problem: RollingProblem,
    surface: SurfaceCompliance,
    grid: Discretisation,
    indentation: float,
    start: ContactSolution | None = None,
) -> ContactSolution:
    """Solve the contact at an indentation [m], with its shear where the roller turns with friction.

    Pressure and shear are solved alternately, with Aitken relaxation of the displacement by shear.

    Parameters
    ----------
    surface : SurfaceCompliance
        Compliance of the layer at the speed.
    grid : Discretisation
        Pressure terms, and an initial guess of the edges.
    start : ContactSolution, optional
        Solution of a neighbouring contact.
    """
    pressed = PressedRoller(problem, surface, indentation)
    patch = pressed.solve(grid.terms, grid.edges) if start is None else start.patch
    if not problem.turns_with_friction:
        return ContactSolution(pressed, pressed.finish(patch if start is None else pressed.follow(patch, patch.terms)))
    drawn = np.zeros((2, len(surface.x))) if start is None or start.shear is None else start.shear.displacement
    nodes, relaxation, previous, changes = surface.x, 1.0, None, []
    for alternation in range(MAX_ALTERNATIONS):
        sheared = replace(pressed, surface=replace(surface, initial=interpolant(surface.x, drawn)))
        patch = sheared.follow(patch, patch.terms)
        shear = _solve_shear(problem, surface, patch, nodes)
        change = shear.displacement - drawn
        changes.append(float(np.abs(change).max() / np.abs(patch.displacement).max()))
        if changes[-1] < SHEAR_TOLERANCE:
            return ContactSolution(pressed, sheared.finish(patch), shear)
        if previous is not None:
            fall = previous - change
            relaxation = np.clip(relaxation * np.sum(previous * fall) / np.sum(fall**2), *RELAXATION_LIMITS)
        drawn, previous = drawn + relaxation * change, change
        nodes = surface.x if alternation < FREE_ALTERNATIONS else shear.x[1:-1]
    raise UnresolvedError(
        f"pressure and shear did not converge to {SHEAR_TOLERANCE:g} in {MAX_ALTERNATIONS} alternations; the changes "
        f"by shear over the displacement are {changes}"
    )


@dataclass(frozen=True, eq=False)
class PressedRoller:
    """Roller at an indentation [m] with a constant ratio of traction to pressure: pressure with free edges."""

    problem: RollingProblem
    surface: SurfaceCompliance
    indentation: float

    def contact_condition(self, x: Array, displacement: Array) -> tuple[Array, Array]:
        """Linearise the contact condition n.u = d about a displacement by contact [m], shape (2, q), at x [m].

        The gap is vertical to a parabola, vertical to a circle, or normal to the circle on the deformed surface.
        Returns the unit normal n towards the layer, shape (2, q), and the depth d [m], shape (q,).
        """
        R, profile, initial = self.problem.roller.radius, self.problem.roller.profile, self.surface.initial(x)
        if profile == "deformed":
            moved = displacement + initial
            ray = np.array([x, np.zeros_like(x)]) + moved - np.array([[0.0], [R - self.indentation]])
            distance = np.hypot(*ray)
            normal = ray / distance
            depth = np.sum(normal * moved, axis=0) - (distance - R)
        else:
            drop = x**2 / (2 * R) if profile == "parabola" else x**2 / (R + np.sqrt(np.maximum(R**2 - x**2, 0)))
            normal, depth = np.array([np.zeros_like(x), -np.ones_like(x)]), self.indentation - drop
        return normal, depth - np.sum(normal * initial, axis=0)

    def solve(self, terms: int, edges: Edges | None = None) -> ContactPatch:
        """Solve the contact with one pressure term per `NODES_PER_TERM` nodes at most, which increase in stages.

        The search starts from given edges [m] or from those of an active set. UnresolvedError lists the last
        iterations; BeyondWindowError: the edges leave the loaded zone.
        """
        if edges is not None:
            with suppress(UnresolvedError):  # a surface that moves far along x has other edges than one at rest
                return self.solve_in_stages(np.array(edges), terms)
        return self.solve_in_stages(self.estimate_edges(), terms)

    def solve_in_stages(self, edges: Array, terms: int) -> ContactPatch:
        """Solve from initial edges, first with few terms, then with more."""
        x = self.surface.x
        terms = min(terms, max(1, int(np.sum((edges[0] < x) & (x < edges[1]))) // NODES_PER_TERM))
        few = min(terms, INITIAL_TERMS)
        patch = self._solve(few, edges, np.zeros((2, len(x))))
        while patch.terms < terms:
            patch = self.follow(patch, min(int(TERM_GROWTH * patch.terms), terms))
        return patch

    def follow(self, guess: ContactPatch, terms: int) -> ContactPatch:
        """Solve from the edges, displacement and Jacobian of the patch of a similar problem."""
        return self._solve(terms, np.array(guess.edges), guess.displacement, guess.jacobian, guess.history)

    def finish(self, patch: ContactPatch) -> ContactPatch:
        """Add the peak pressure of a patch and that of a patch with `PEAK_TERMS_OMITTED` terms fewer."""
        profile, R = self.problem.roller.profile, self.problem.roller.radius
        if (profile == "circle" and abs(patch.x).max() >= R) or (profile == "deformed" and patch.normal[1].max() >= 0):
            raise self.beyond_circle(patch.edges)  # where the slope, or the pressure along x, is undefined
        fewer = self.follow(patch, max(1, patch.terms - PEAK_TERMS_OMITTED))
        samples = (each.sampled(PEAK_SAMPLES, self.problem.exponent)[1] for each in (fewer, patch))
        return replace(patch, peaks=tuple(float(pressure.max()) for pressure in samples), history=fewer.history)

    def beyond_circle(self, edges: Edges) -> BeyondCircleError:
        """Return the error of a contact with edges [m] that is wider than the circle."""
        return BeyondCircleError(
            f"the contact, from {edges[0]:.3g} to {edges[1]:.3g} m, is wider than the circle of radius "
            f"{self.problem.roller.radius:g} m; reduce the indentation or the load"
        )

    def estimate_edges(self) -> Array:
        """Estimate both edges [m], shape (2,), from a pressure linear between corner nodes by an active-set method."""
        surface = self.surface
        loaded_x = surface.x[surface.loaded]
        corners = loaded_x[::2]
        sizes, k = np.diff(corners), np.arange(len(corners) - 1)
        H = np.zeros((len(loaded_x), len(corners)))  # nodal forces of pressures that are hats on the corners
        H[2 * k, k] += sizes / 6
        H[2 * k + 1, k] = H[2 * k + 1, k + 1] = sizes / 3
        H[2 * k + 2, k + 1] += sizes / 6
        response = surface.response[1, surface.loaded]
        A = H.T @ (response[:, 1] - self.problem.traction_ratio * response[:, 0]) @ H
        depth = H.T @ self.contact_condition(loaded_x, np.zeros((2, len(loaded_x))))[1]
        active: BoolArray = depth > 0
        visited: set[bytes] = set()
        while active.any() and active.tobytes() not in visited:
            visited.add(active.tobytes())
            pressure = np.zeros(len(depth))
            pressure[active] = np.linalg.solve(A[np.ix_(active, active)], depth[active])
            active = np.where(active, pressure > 0, depth - A @ pressure > 0)
        if not active.any():
            raise UnresolvedError(
                f"no corner node is in contact at an indentation of {self.indentation:.3g} m: the mesh is too coarse "
                "under the contact, or the indentation is too large for the roller; refine the mesh or reduce the "
                "indentation"
            )
        if active[0] or active[-1]:
            raise BeyondWindowError("the contact fills the loaded zone")
        first, last = np.flatnonzero(active)[[0, -1]]
        return np.array([corners[first - 1 : first + 1].mean(), corners[last : last + 2].mean()])

    def _solve(self, terms, edges, displacement, jacobian=None, history=()):
        """Find the `ContactPatch`; update the Jacobian by Broyden's rule, recompute it where the steps grow."""
        patch, step_size, rows = self._solve_between(edges, displacement, terms), np.inf, []
        for iteration in range(MAX_EDGE_ITERATIONS):
            amplitudes, length = patch.coefficients[-2:], edges[1] - edges[0]
            if jacobian is None:  # by forward differences
                reach = DIFFERENCE_STEP * length
                shifted = [self._solve_between(edges + reach * side, displacement, terms) for side in np.eye(2)]
                jacobian = (np.array([each.coefficients[-2:] for each in shifted]) - amplitudes).T / reach
            previous, step = step_size, np.linalg.solve(jacobian, -amplitudes)
            step_size = (np.abs(step).max() / length).item()
            rows.append((*edges.tolist(), step_size))
            change = np.abs(patch.displacement - displacement).max()  # the normal is that of the displacement
            stationary = change <= EDGE_TOLERANCE * np.abs(patch.displacement).max()
            if step_size < EDGE_TOLERANCE and (stationary or self.problem.roller.profile != "deformed"):
                return replace(patch, jacobian=jacobian, history=history + tuple(rows))
            step *= min(1.0, MAX_STEP / max(step_size, MAX_STEP)) * (1.0 if iteration < FULL_STEPS else 0.5)
            edges, displacement = edges + step, patch.displacement
            patch = self._solve_between(edges, displacement, terms)
            residual = patch.coefficients[-2:] - amplitudes - jacobian @ step
            updated = jacobian + np.outer(residual, step) / (step @ step)
            jacobian = updated if step_size < max(previous, EDGE_TOLERANCE) else None
        if self.problem.roller.profile == "circle" and np.abs(edges).max() > self.problem.roller.radius:
            raise self.beyond_circle((edges[0], edges[1]))
        raise UnresolvedError(
            f"the contact edges did not converge in {MAX_EDGE_ITERATIONS} iterations; the last (trailing [m], "
            f"leading [m], step over length) are {rows[-HISTORY_REPORTED:]}"
        )

    def _solve_between(self, edges: Array, displacement: Array, terms: int) -> ContactPatch:
        """Solve between fixed edges; the last two coefficients are the amplitudes of the singular pressures."""
        surface, exponent = self.surface, self.problem.exponent
        low, high = surface.x[surface.loaded][[0, -1]]
        if edges[0] < low or edges[1] > high:
            raise BeyondWindowError(f"the edges {edges.tolist()} m leave the loaded zone, {low:.3g} to {high:.3g} m")
        if not edges[1] - edges[0] > MIN_LENGTH * (high - low):
            raise UnresolvedError(f"the contact between {edges.tolist()} m is too narrow for the mesh; refine it")
        x, weight, fraction, complement = contact_quadrature(surface.x, edges)
        N = shape_matrix(surface.x, x)
        normal, depth = self.contact_condition(x, displacement @ N.T)
        direction = normal + self.problem.traction_ratio * _perpendicular(normal)
        trial = _pressure_functions(fraction, complement, exponent, terms)
        test = _pressure_functions(fraction, complement, 1 - exponent, terms) * weight[:, None]
        loads = N[:, surface.loaded].T
        forces = np.stack([loads @ (trial * (weight * part)[:, None]) for part in direction])
        response = surface.displacement(forces)
        A = sum((test * normal[i][:, None]).T @ (N @ response[i]) for i in range(2))
        try:
            c = np.linalg.solve(A, test.T @ depth)
        except np.linalg.LinAlgError as singular:
            raise UnresolvedError(
                f"the mesh is too coarse under the contact for {terms} terms of the pressure; refine it"
            ) from singular
        low, high = edges.tolist()
        return ContactPatch((low, high), x, weight, trial @ c, normal, direction, forces @ c, response @ c, c)


def _perpendicular(normal: Array) -> Array:
    """Tangent of the roller towards +x, shape (2, q), for unit normals towards the layer."""
    return np.stack([-normal[1], normal[0]])


def _pressure_functions(fraction: Array, complement: Array, exponent: float, terms: int) -> Array:
    """Regular pressures by Chebyshev polynomials, then those singular at the trailing and at the leading edge."""
    angle = 2 * np.arcsin(np.sqrt(np.minimum(complement, 1.0)))
    base = fraction**exponent * complement ** (1 - exponent)
    regular = base[:, None] * np.cos(angle[:, None] * np.arange(terms))
    return np.column_stack([regular, base / fraction, base / complement])


def _solve_shear(problem, surface, patch, nodes):
    """`ShearSolution` of Coulomb's law under the pressure of a patch, with tractions at nodes [m] between its edges."""
    trailing, leading = patch.edges
    inner = nodes[(nodes > trailing) & (nodes < leading)]
    if len(inner) > 2:  # without nodes close to an edge
        low = inner[0] - trailing < EDGE_CLEARANCE * (inner[1] - inner[0])
        high = leading - inner[-1] < EDGE_CLEARANCE * (inner[-1] - inner[-2])
        inner = inner[int(low) : len(inner) - int(high)]
    x = np.concatenate([[trailing], inner, [leading]])
    functions = _traction_functions(x, patch.x) * patch.weight[:, None]
    loads, share = shape_matrix(surface.x, patch.x)[:, surface.loaded].T, functions.sum(axis=0)
    hats = np.stack([loads @ (functions * part[:, None]) for part in _perpendicular(patch.normal)])
    bound = problem.roller.friction * np.maximum(np.interp(inner, patch.x, patch.pressure), 0)
    force = -problem.torque / problem.roller.radius / problem.material.youngs_modulus
    if abs(force) >= bound @ share:
        raise RuntimeError(
            f"the roller skids: the torque is {abs(force) / (bound @ share):.3g} times the friction limit; reduce the "
            "torque, or raise the load or `friction`"
        )
    # slip s = A q + b + creepage of the nodes, in the intervals on their upstream side
    response = surface.displacement(hats)
    rate = -np.diff(shape_matrix(surface.x, x[1:]), axis=0) / np.diff(x[1:])[:, None]
    middle = (x[2:] + x[1:-1]) / 2
    along = _perpendicular(np.stack([np.interp(middle, patch.x, part) for part in patch.normal]))
    A = sum(part[:, None] * (rate @ response[i]) for i, part in enumerate(along))
    b = 1 - along[0] + sum(part * (rate @ patch.displacement[i]) for i, part in enumerate(along))
    q, creepage = _stick_slip_active_set(A, b, bound, share, force)
    slip_work = -float(np.sum(share * q * (A @ q + b + creepage)))
    traction = np.concatenate([[0.0], q, [0.0]])
    return ShearSolution(x, traction, float(creepage), hats.sum(axis=1) @ q, hats @ q, response @ q, slip_work)


def _stick_slip_active_set(A: Array, b: Array, bound: Array, share: Array, force: float) -> tuple[Array, float]:
    """Return traction and creepage: s = A q + b + creepage and share.q = force."""
    sticks, sign, visited = np.ones(len(b), dtype=bool), np.zeros(len(b)), set()
    for _ in range(MAX_EXCHANGES):
        q, k = np.where(sticks, 0.0, sign * bound), np.flatnonzero(sticks)  # s = 0 on the nodes k that stick
        left = np.block([[A[np.ix_(k, k)], np.ones((len(k), 1))], [share[k][None], np.zeros((1, 1))]])
        *q[k], creepage = np.linalg.solve(left, np.append(-(A @ q + b)[k], force - share @ q))
        slip = A @ q + b + creepage
        over, drags = sticks & (np.abs(q) > bound * (1 + FRICTION_ROUNDING)), ~sticks & (slip * sign > 0)
        if not (over | drags).any():
            return q, creepage
        state, direction = (sticks & ~over) | drags, np.where(over, np.sign(q), sign)
        if (state.tobytes(), direction.tobytes()) in visited:  # exchange one node where exchanges cycle
            worst = np.argmax(np.where(over, np.abs(q), 0) + np.where(drags, bound.max(), 0))
            state, direction = sticks.copy(), sign.copy()
            state[worst], direction[worst] = ~sticks[worst], np.sign(q[worst])
        if not state.any():  # the creepage is undetermined unless a node sticks
            q = direction * bound
            lacking = np.sign(force - share @ q)  # the node of least slip whose traction opposes the lacking force
            state[np.argmin(np.where(q * lacking < 0, lacking * (A @ q + b), np.inf))] = True
        visited.add((state.tobytes(), direction.tobytes()))
        sticks, sign = state, direction
    raise UnresolvedError(f"the zones of stick and slip did not converge in {MAX_EXCHANGES} exchanges")


def _traction_functions(x: Array, points: Array) -> Array:
    """Functions that are 1 at one node between the edges x[0] and x[-1] and 0 at the others, shape (q, k).

    Hats between the nodes, constant outside the outermost ones, times square roots of the distances to the edges.
    """
    hats = np.array([np.interp(points, x[1:-1], row) for row in np.eye(len(x) - 2)]).T
    root, unit = (np.sqrt(np.maximum((at - x[0]) * (x[-1] - at), 0)) for at in (points, x[1:-1]))
    return hats * root[:, None] / unit
