"""Unilateral contact with free edges between a rigid indenter and a surface of known compliance.

**Pressure.** The pressure on trailing < x < leading vanishes at both edges with the exponents of sliding contact,

    p = xi^alpha (1 - xi)^(1 - alpha) [c_0 T_0 + ... + c_(n-1) T_(n-1)](2 xi - 1),   xi = (x - trailing)/length.

Petrov-Galerkin equations require the surface to follow the indenter; their test functions may be singular at an edge.
Between fixed edges the solution contains two further pressures, singular at one edge each. Newton's method moves the
edges until both singular amplitudes vanish. The pressure is then unilateral, and the edges are independent of the mesh.

References
----------
L. A. Galin, Contact problems (Springer, 2008): edge exponents; C. G. Broyden, Math. Comp. 19 (1965) 577: secant update.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from compact.engines.fem.compliance import SurfaceCompliance, contact_quadrature, shape_matrix
from compact.numerics import Array, BoolArray
from compact.rolling_contact import GapGeometry

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

Edges = tuple[float, float]
EdgeHistory = tuple[tuple[float, float, float], ...]


class UnresolvedError(RuntimeError):
    """The contact does not converge on this mesh with this number of pressure terms; a finer mesh may resolve it."""


class BeyondWindowError(UnresolvedError):
    """The contact extends beyond the loaded zone, the nodes whose compliance is known."""


@dataclass(frozen=True, eq=False)
class Indenter:
    """Rigid roller at an indentation, with a constant ratio of traction to pressure.

    Parameters
    ----------
    radius, indentation : float
        R and delta [m].
    profile : {"parabola", "circle", "deformed"}
        The gap is vertical to a parabola, vertical to a circle, or normal to the circle on the deformed surface.
    friction : float
        Shear traction along +x over pressure [-], signed.
    exponent : float
        Edge exponent alpha of the pressure at the trailing side [-]; 1 - alpha at the leading side.
    """

    radius: float
    indentation: float
    profile: GapGeometry
    friction: float
    exponent: float

    def contact_condition(self, x: Array, displacement: Array | float) -> tuple[Array, Array]:
        """Linearise the contact condition n.u = d about a displacement [m], shape (2, q), at points x [m].

        Returns the unit normal n towards the layer, shape (2, q), and the depth d [m], shape (q,).
        """
        R = self.radius
        if self.profile == "deformed":
            ray = np.array([x, np.zeros_like(x)]) + displacement - np.array([[0.0], [R - self.indentation]])
            distance = np.hypot(*ray)
            normal = ray / distance
            return normal, np.sum(normal * displacement, axis=0) - (distance - R)
        drop = x**2 / (2 * R) if self.profile == "parabola" else x**2 / (R + np.sqrt(np.maximum(R**2 - x**2, 0)))
        return np.array([np.zeros_like(x), -np.ones_like(x)]), self.indentation - drop

    def slope(self, x: Array) -> Array:
        """Slope dy/dx [-] at x [m], by which a vertical pressure has a component along x; 0 for "deformed"."""
        if self.profile == "deformed":
            return np.zeros_like(x)
        return x / self.radius if self.profile == "parabola" else x / np.sqrt(self.radius**2 - x**2)


@dataclass(frozen=True, eq=False)
class ContactPatch:
    """Contact between two edges with its pressure, in units of the relaxed modulus.

    Parameters
    ----------
    trailing, leading : float
        Lower and upper edge in x [m], for either direction of travel.
    x, weight, pressure : ndarray
        Quadrature points and weights [m], and the pressure there [-], shape (q,).
    direction, shear : ndarray
        Traction over pressure and its tangential part [-], shape (2, q).
    forces : ndarray
        Forces on the loaded nodes [m], shape (2, m).
    displacement : ndarray
        Displacement of the surface nodes by these forces [m], shape (2, n).
    coefficients : ndarray
        Coefficients of the regular pressures, then of the two singular ones.
    exponent : float
        Edge exponent alpha [-].
    jacobian : ndarray, optional
        Derivatives of the two singular amplitudes with respect to the edges, shape (2, 2).
    peaks : tuple of float
        Peak pressures with fewer and with all terms [-]; empty unless computed.
    history : tuple
        (trailing, leading, step over length) of every iteration.
    """

    trailing: float
    leading: float
    x: Array
    weight: Array
    pressure: Array
    direction: Array
    shear: Array
    forces: Array
    displacement: Array
    coefficients: Array
    exponent: float
    jacobian: Array | None = None
    peaks: tuple[float, ...] = ()
    history: EdgeHistory = ()

    @property
    def edges(self) -> Edges:
        """Trailing and leading edge [m]."""
        return self.trailing, self.leading

    @property
    def terms(self) -> int:
        """Number of regular pressure terms."""
        return len(self.coefficients) - 2

    @property
    def peak(self) -> float:
        """Peak pressure [-]: the mean of both estimates, whose errors are ten times as large and of opposite sign."""
        return sum(self.peaks) / 2

    @property
    def scatter(self) -> float:
        """Half the relative difference of both peak pressures [-]."""
        return abs(self.peaks[1] - self.peaks[0]) / sum(self.peaks)

    def integral(self, values: Array) -> float:
        """Integrate values at the quadrature points, shape (q,), over the contact."""
        return float(np.sum(self.weight * values))

    def sampled(self, count: int) -> tuple[Array, Array]:
        """Sample x [m] and pressure [-] at `count` points clustered at the edges, where the pressure is zero."""
        half = np.linspace(0, np.pi / 2, count)
        fraction, complement = np.sin(half) ** 2, np.cos(half) ** 2
        functions = _pressure_functions(fraction[1:-1], complement[1:-1], self.exponent, self.terms)
        x = self.trailing + (self.leading - self.trailing) * fraction
        x[-1] = self.leading
        return x, np.concatenate([[0.0], functions @ self.coefficients, [0.0]])


def solve_contact_patch(
    surface: SurfaceCompliance,
    indenter: Indenter,
    terms: int,
    initial_guess: ContactPatch | None = None,
    edges: Edges | None = None,
) -> ContactPatch:
    """Solve the contact of an indenter on a surface with one pressure term per `NODES_PER_TERM` nodes at most.

    The search starts from the solution of a similar problem, whose number of terms is kept, from given edges [m], or
    from those of an active set; the number of terms then increases in stages. UnresolvedError lists the last
    iterations; BeyondWindowError: the edges leave the loaded zone.
    """
    solver, patch = _EdgeSolver(surface, indenter), None
    if initial_guess is not None:
        patch = solver.solve_from(initial_guess, initial_guess.terms)
    elif edges is not None:
        with suppress(
            UnresolvedError
        ):  # a surface that moves far along x has other edges than one without displacement
            patch = solver.solve_in_stages(np.array(edges), terms)
    patch = patch or solver.solve_in_stages(estimate_edges(surface, indenter), terms)
    return replace(patch, history=tuple(solver.history))


def with_peak_pressures(surface: SurfaceCompliance, indenter: Indenter, patch: ContactPatch) -> ContactPatch:
    """Add the peak pressure of a patch and that of a patch with `PEAK_TERMS_OMITTED` terms fewer."""
    solver = _EdgeSolver(surface, indenter)
    fewer = solver.solve_from(patch, max(1, patch.terms - PEAK_TERMS_OMITTED))
    peaks = tuple(float(each.sampled(PEAK_SAMPLES)[1].max()) for each in (fewer, patch))
    return replace(patch, peaks=peaks, history=patch.history + tuple(solver.history))


def estimate_edges(surface: SurfaceCompliance, indenter: Indenter) -> Array:
    """Estimate both edges [m], shape (2,), from a pressure linear between corner nodes by an active-set method."""
    loaded_x = surface.x[surface.loaded]
    corners = loaded_x[::2]
    sizes, k = np.diff(corners), np.arange(len(corners) - 1)
    H = np.zeros((len(loaded_x), len(corners)))  # nodal forces of pressures that are hats on the corners
    H[2 * k, k] += sizes / 6
    H[2 * k + 1, k] = H[2 * k + 1, k + 1] = sizes / 3
    H[2 * k + 2, k + 1] += sizes / 6
    response = surface.response[1, surface.loaded]
    A = H.T @ (response[:, 1] - indenter.friction * response[:, 0]) @ H
    depth = H.T @ _contact_condition(surface, indenter, loaded_x, 0.0)[1]
    active: BoolArray = depth > 0
    visited: set[bytes] = set()
    while active.any() and active.tobytes() not in visited:
        visited.add(active.tobytes())
        pressure = np.zeros(len(depth))
        pressure[active] = np.linalg.solve(A[np.ix_(active, active)], depth[active])
        active = np.where(active, pressure > 0, depth - A @ pressure > 0)
    if not active.any():
        raise UnresolvedError(
            f"no corner node is in contact at an indentation of {indenter.indentation:.3g} m: the mesh is too coarse "
            f"under the contact, or the indentation is too large for the roller radius {indenter.radius:g} m; refine "
            "the mesh or reduce the indentation"
        )
    if active[0] or active[-1]:
        raise BeyondWindowError("the contact fills the loaded zone")
    first, last = np.flatnonzero(active)[[0, -1]]
    return np.array([corners[first - 1 : first + 1].mean(), corners[last : last + 2].mean()])


def beyond_circle_message(edges: Edges, radius: float) -> str:
    """Error message for the edges [m] of a contact wider than a circle of a radius [m]."""
    contact = f"the contact, from {edges[0]:.3g} to {edges[1]:.3g} m,"
    return f"{contact} is wider than the circle of radius {radius:g} m; reduce the indentation or the load"


@dataclass(frozen=True, eq=False)
class _EdgeSolver:
    """Newton's method for the edges of a contact, with the history of its iterations."""

    surface: SurfaceCompliance
    indenter: Indenter
    history: list[tuple[float, float, float]] = field(default_factory=list)

    def solve_in_stages(self, edges: Array, terms: int) -> ContactPatch:
        """Solve from initial edges, first with few terms, then with more."""
        x = self.surface.x
        terms = min(terms, max(1, int(np.sum((edges[0] < x) & (x < edges[1]))) // NODES_PER_TERM))
        few = min(terms, INITIAL_TERMS)
        patch = self._solve(few, edges, np.zeros((2, len(x))), None)
        while TERM_GROWTH * few < terms:
            few = int(TERM_GROWTH * few)
            patch = self.solve_from(patch, few)
        return self.solve_from(patch, terms)

    def solve_from(self, guess: ContactPatch, terms: int) -> ContactPatch:
        """Solve from the edges, displacement and Jacobian of another patch."""
        return self._solve(terms, np.array(guess.edges), guess.displacement, guess.jacobian)

    def _solve(self, terms: int, edges: Array, displacement: Array, jacobian: Array | None) -> ContactPatch:
        """Update the Jacobian by Broyden's rule; recompute it where the steps grow."""
        patch = self._solve_between(edges, displacement, terms)
        step_size = np.inf
        for iteration in range(MAX_EDGE_ITERATIONS):
            amplitudes = patch.coefficients[-2:]
            if jacobian is None:  # by forward differences
                reach = DIFFERENCE_STEP * (edges[1] - edges[0])
                shifted = [self._solve_between(edges + reach * side, displacement, terms) for side in np.eye(2)]
                jacobian = (np.array([each.coefficients[-2:] for each in shifted]) - amplitudes).T / reach
            previous, step = step_size, np.linalg.solve(jacobian, -amplitudes)
            step_size = (np.abs(step).max() / (edges[1] - edges[0])).item()
            self.history.append((*edges.tolist(), step_size))
            change = np.abs(patch.displacement - displacement).max()  # the normal is that of the displacement
            stationary = change <= EDGE_TOLERANCE * np.abs(patch.displacement).max()
            if step_size < EDGE_TOLERANCE and (stationary or self.indenter.profile != "deformed"):
                return replace(patch, jacobian=jacobian)
            step *= min(1.0, MAX_STEP / max(step_size, MAX_STEP)) * (1.0 if iteration < FULL_STEPS else 0.5)
            edges, displacement = edges + step, patch.displacement
            patch = self._solve_between(edges, displacement, terms)
            residual = patch.coefficients[-2:] - amplitudes - jacobian @ step
            updated = jacobian + np.outer(residual, step) / (step @ step)
            jacobian = updated if step_size < max(previous, EDGE_TOLERANCE) else None
        if self.indenter.profile == "circle" and np.abs(edges).max() > self.indenter.radius:
            raise RuntimeError(beyond_circle_message((edges[0], edges[1]), self.indenter.radius))
        raise UnresolvedError(
            f"the contact edges did not converge in {MAX_EDGE_ITERATIONS} iterations; the last (trailing [m], "
            f"leading [m], step over length) are {self.history[-HISTORY_REPORTED:]}"
        )

    def _solve_between(self, edges: Array, displacement: Array, terms: int) -> ContactPatch:
        """Solve between fixed edges; the last two coefficients are the amplitudes of the singular pressures."""
        surface, indenter = self.surface, self.indenter
        low, high = surface.x[surface.first], surface.x[surface.last - 1]
        if edges[0] < low or edges[1] > high:
            raise BeyondWindowError(f"the edges {edges.tolist()} m leave the loaded zone, {low:.3g} to {high:.3g} m")
        if not edges[1] - edges[0] > MIN_LENGTH * (high - low):
            raise UnresolvedError(f"the contact between {edges.tolist()} m is too narrow for the mesh; refine it")
        x, weight, fraction, complement = contact_quadrature(surface.x, edges)
        N = shape_matrix(surface.x, x)
        normal, depth = _contact_condition(surface, indenter, x, displacement @ N.T)
        shear = indenter.friction * np.array([-normal[1], normal[0]])
        direction = normal + shear
        trial = _pressure_functions(fraction, complement, indenter.exponent, terms)
        test = _pressure_functions(fraction, complement, 1 - indenter.exponent, terms) * weight[:, None]
        loads = N[:, surface.loaded].T
        forces = np.stack([loads @ (trial * (weight * part)[:, None]) for part in direction])
        response = surface.displacement(forces)
        A = sum((test * normal[i][:, None]).T @ (N @ response[i]) for i in range(2))
        try:
            coefficients = np.linalg.solve(A, test.T @ depth)
        except np.linalg.LinAlgError as singular:
            raise UnresolvedError(
                f"the mesh is too coarse under the contact for {terms} terms of the pressure; refine it"
            ) from singular
        return ContactPatch(
            trailing=float(edges[0]),
            leading=float(edges[1]),
            x=x,
            weight=weight,
            pressure=trial @ coefficients,
            direction=direction,
            shear=shear,
            forces=forces @ coefficients,
            displacement=response @ coefficients,
            coefficients=coefficients,
            exponent=indenter.exponent,
        )


def _contact_condition(
    surface: SurfaceCompliance, indenter: Indenter, x: Array, displacement: Array | float
) -> tuple[Array, Array]:
    """Linearise the contact condition; the depth is what remains for the displacement by contact."""
    if surface.initial is None:
        return indenter.contact_condition(x, displacement)
    initial = surface.initial.at(x)
    normal, depth = indenter.contact_condition(x, displacement + initial)
    return normal, depth - np.sum(normal * initial, axis=0)


def _pressure_functions(fraction: Array, complement: Array, exponent: float, terms: int) -> Array:
    """Regular pressures by Chebyshev polynomials, then those singular at the trailing and at the leading edge."""
    angle = 2 * np.arcsin(np.sqrt(np.minimum(complement, 1.0)))
    base = fraction**exponent * complement ** (1 - exponent)
    regular = base[:, None] * np.cos(angle[:, None] * np.arange(terms))
    return np.column_stack([regular, base / fraction, base / complement])
