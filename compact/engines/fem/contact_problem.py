"""Contact of one roller in steady motion on one mesh, at a prescribed indentation, load or peak pressure.

    u = C(v) S f + u0,    n.u = d under the pressure,    target(indentation) = prescribed value

S is the compliance of the elastic layer and C(v) its retardation by the material at the speed (`compliance`). The
contact at an indentation is that of `contact`, with its shear where the roller turns. The secant method in logarithms
finds the indentation of a prescribed load or peak pressure.

**Stick and slip.** The slip of the mix on the roller along the tangent t, relative to the rolling speed v, is

    s = 1 + creepage - t.(e_x + du/dx),    creepage = angular speed x radius/v - 1,

and Coulomb's law holds at every point: |q| <= f p, and q = -f p sign(v s) where s is not zero. Like the pressure, q
vanishes at both edges as a square root, times a factor linear between the surface nodes. The slip of a node is the mean
over the interval on its upstream side. An active-set method finds the nodes that stick; the creepage follows from the
prescribed sum of q, which is the torque over the radius. Pressure and shear are solved alternately.

References
----------
J. J. Kalker, Three-dimensional elastic bodies in rolling contact (Kluwer, 1990); K. L. Johnson, Contact mechanics
(Cambridge, 1985), chapter 8; B. M. Irons and R. C. Tuck, Int. J. Numer. Meth. Eng. 1 (1969) 275 (Aitken relaxation).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from compact.engines.fem import compliance
from compact.engines.fem.compliance import SurfaceCompliance
from compact.engines.fem.contact import (
    BeyondWindowError,
    ContactPatch,
    EdgeHistory,
    Edges,
    Indenter,
    UnresolvedError,
    beyond_circle_message,
    solve_contact_patch,
    with_peak_pressures,
)
from compact.engines.halfplane import pressure_exponent
from compact.material.laws import Elastic
from compact.mesh import RowMesh
from compact.numerics import Array, BoolArray
from compact.rolling_contact import Layer, Roller

WINDOW = 1.3  # [-], half-width of the loaded zone over that of the estimated contact
WINDOW_GROWTH = 1.5  # [-], of a loaded zone that does not contain the contact
MAX_WINDOWS = 8  # [-], loaded zones
SECANT_TOLERANCE = 1e-9  # [-], of a prescribed load or peak pressure
STICK_SECANT_TOLERANCE = 1e-6  # [-], the same with stick and slip, whose shear converges to 1e-7
MAX_SECANTS = 20  # [-], contacts solved for a prescribed load or peak pressure
INITIAL_POWER = 1.2  # [-], of load or peak pressure in the indentation, before two contacts are known
MAX_ALTERNATIONS = 60  # [-], solves for pressure and shear
SHEAR_TOLERANCE = 1e-7  # [-], change of the largest displacement at convergence; some 1e-6 of the peak pressure
FREE_ALTERNATIONS = 5  # [-], before the set of nodes is fixed; a node at an edge may otherwise alternate without end
RELAXATION_LIMITS = 0.1, 2.0  # [-], of the relaxation factor by Aitken's rule
MAX_EXCHANGES = 200  # [-], of nodes between stick and slip
EDGE_CLEARANCE = 0.5  # [-], least distance of a node from an edge over its distance to the next node
FRICTION_ROUNDING = 1e-9  # [-], by which a traction that sticks may exceed f p
MAX_LOG_STEP = 1.0  # [-], of the log of the indentation

Found = TypeVar("Found")


@dataclass(frozen=True)
class RollingProblem:
    """Roller in steady motion over a linear layer.

    Parameters
    ----------
    speed : float
        Speed along x [m/s].
    torque : float
        Torque on a roller that turns, per unit length, positive in the sense of rolling along the travel [N].
    """

    layer: Layer
    roller: Roller
    material: Elastic
    speed: float
    torque: float = 0.0

    @property
    def direction(self) -> float:
        """Direction of travel, 1 along +x or -1."""
        return float(np.sign(self.speed))

    @property
    def traction_ratio(self) -> float:
        """Shear traction on the mix along +x over pressure where the whole contact slides [-]."""
        return self.direction * self.roller.friction if self.roller.rolling == "sliding" else 0.0

    @property
    def turns_with_friction(self) -> bool:
        """True if the contact has zones of stick and slip."""
        return self.roller.rolling in ("free", "driven") and self.roller.friction > 0

    @property
    def needs_shear(self) -> bool:
        """True if forces along x act on the surface."""
        return self.traction_ratio != 0 or self.turns_with_friction or self.roller.profile == "deformed"

    def indenter(self, indentation: float) -> Indenter:
        """Roller at an indentation [m]."""
        exponent = float(pressure_exponent(self.material.poisson, self.traction_ratio))
        return Indenter(self.roller.radius, indentation, self.roller.profile, self.traction_ratio, exponent)

    @property
    def target_tolerance(self) -> float:
        """Relative tolerance of a prescribed load or peak pressure [-]."""
        return STICK_SECANT_TOLERANCE if self.turns_with_friction else SECANT_TOLERANCE


@dataclass(frozen=True, eq=False)
class ShearSolution:
    """Shear traction on the mix, in units of the relaxed modulus.

    Parameters
    ----------
    x, traction : ndarray
        Edges and the nodes between them [m], and the traction there [-], shape (k + 2,).
    creepage : float
        Angular speed x radius/speed - 1 [-].
    sticks : ndarray of bool
        Nodes between the edges that stick, shape (k,).
    resultant : ndarray
        Force (x, y) by the traction [m], shape (2,).
    forces, displacement : ndarray
        Forces on the loaded nodes, shape (2, m), and displacement of all by them, shape (2, n) [m].
    slip_work : float
        Energy dissipated by slip per length rolled, - sign(v) int q s dx [m].
    """

    x: Array
    traction: Array
    creepage: float
    sticks: BoolArray
    resultant: Array
    forces: Array
    displacement: Array
    slip_work: float

    def traction_at(self, x: Array) -> Array:
        """Interpolate the traction [-] to points x [m], shape (q,)."""
        return _traction_functions(self.x, x) @ self.traction[1:-1]


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """Contact of an indenter on a surface, in units of the relaxed modulus."""

    surface: SurfaceCompliance
    indenter: Indenter
    patch: ContactPatch
    shear: ShearSolution | None = None

    @property
    def resultant(self) -> Array:
        """Force (x, y) on the mix [m], shape (2,)."""
        patch = self.patch
        along = patch.direction[0] - self.indenter.slope(patch.x) * patch.direction[1]
        force = np.array([patch.integral(patch.pressure * part) for part in (along, patch.direction[1])])
        return force if self.shear is None else force + self.shear.resultant

    @property
    def forces(self) -> Array:
        """Forces on all surface nodes [m], shape (2, n)."""
        forces = np.zeros((2, len(self.surface.x)))
        forces[:, self.surface.loaded] = self.patch.forces
        if self.shear is not None:
            forces[:, self.surface.loaded] += self.shear.forces
        return forces

    @property
    def is_beyond_circle(self) -> bool:
        """True if the contact includes points where the roller has a vertical tangent or lies above its centre."""
        patch, indenter = self.patch, self.indenter
        if indenter.profile == "circle":
            return bool(np.abs(patch.x).max() >= indenter.radius)
        return indenter.profile == "deformed" and bool((patch.direction - patch.shear)[1].max() >= 0)


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


def solve_contact(
    problem: RollingProblem, discretisation: Discretisation, tolerance: float = SECANT_TOLERANCE
) -> ContactSolution:
    """Solve a steady contact in a loaded zone that is wide enough, its load or peak pressure within a tolerance [-]."""
    mesh = discretisation.mesh
    return expand_window(
        discretisation,
        lambda window: solve_at_target(problem, steady_surface(problem, mesh, window), discretisation, tolerance),
    )


def expand_window(discretisation: Discretisation, solve: Callable[[float], Found]) -> Found:
    """Call `solve(window)` with a growing half-width of the loaded zone [m] until the zone contains the contact.

    `solve` raises `BeyondWindowError` where the zone is too small.
    """
    window = WINDOW * discretisation.half_width
    for _ in range(MAX_WINDOWS):
        try:
            return solve(window)
        except BeyondWindowError as beyond:
            window, reason = WINDOW_GROWTH * window, beyond
    raise UnresolvedError(f"the contact extends beyond a loaded zone of {window:.3g} m to either side: {reason}")


def steady_surface(problem: RollingProblem, mesh: RowMesh, window: float) -> SurfaceCompliance:
    """Compliance of the viscoelastic layer in steady motion, loaded within a half-width `window` [m] of the mesh."""
    surface = elastic_surface(problem, mesh, window)
    return surface.retarded(compliance.steady_creep_operator(surface.x, problem.material, problem.speed))


def elastic_surface(
    problem: RollingProblem, mesh: RowMesh, window: float, stretch_rate: bool = False
) -> SurfaceCompliance:
    """Compliance of the elastic layer of unit modulus, or its derivative by the log of a stretch along x."""
    behind = 0 if problem.speed > 0 or problem.layer.base == "bonded" else 1
    options = window, problem.needs_shear, behind, stretch_rate
    return compliance.surface_compliance(mesh, problem.material.poisson, problem.layer, *options)


def solve_at_target(
    problem: RollingProblem,
    surface: SurfaceCompliance,
    discretisation: Discretisation,
    tolerance: float = SECANT_TOLERANCE,
    initial_guess: ContactSolution | None = None,
) -> ContactSolution:
    """Solve the contact with the prescribed indentation, load or peak pressure of the roller.

    A relative tolerance [-] is `STICK_SECANT_TOLERANCE` at least with stick.
    """
    if problem.roller.indentation is not None:
        return solve_at_indentation(problem, surface, problem.roller.indentation, discretisation, initial_guess)
    tolerance = max(tolerance, problem.target_tolerance)
    modulus, (name, value) = problem.material.youngs_modulus, problem.roller.target
    logs: list[float] = []
    errors: list[float] = []
    history: tuple = ()
    contact, beyond, log = initial_guess, None, np.log(discretisation.indentation)
    for _ in range(MAX_SECANTS):
        found = solve_at_indentation(problem, surface, float(np.exp(log)), discretisation, contact)
        history += found.patch.history
        if found.is_beyond_circle:  # the resultant needs the slope of the circle
            beyond, log = found, (log + logs[-1]) / 2 if logs else log - 1
            continue
        contact = found
        logs.append(log)
        reached = -modulus * contact.resultant[1] if name == "load" else modulus * contact.patch.peak
        errors.append(float(np.log(reached / value)))
        if abs(errors[-1]) < tolerance:
            return replace(contact, patch=replace(contact.patch, history=history))
        slope = INITIAL_POWER if len(logs) == 1 else (errors[-1] - errors[-2]) / (logs[-1] - logs[-2])
        log = log - np.clip(errors[-1] / slope, -MAX_LOG_STEP, MAX_LOG_STEP)
    if beyond is not None:
        raise RuntimeError(beyond_circle_message(beyond.patch.edges, problem.roller.radius))
    nearest = int(np.argmin(np.abs(errors)))
    raise UnresolvedError(
        f"`{name}` {value:.6g} is not reached in {len(logs)} secant steps; the nearest is "
        f"{np.expm1(errors[nearest]):+.1e} off, at an indentation of {1e3 * np.exp(logs[nearest]):.4g} mm"
    )


def solve_at_indentation(
    problem: RollingProblem,
    surface: SurfaceCompliance,
    indentation: float,
    discretisation: Discretisation,
    initial_guess: ContactSolution | None = None,
) -> ContactSolution:
    """Solve the contact at an indentation, with its shear where the roller turns with friction.

    Parameters
    ----------
    problem : RollingProblem
        Layer, roller and speed.
    surface : SurfaceCompliance
        Compliance of the surface.
    indentation : float
        Indentation [m].
    discretisation : Discretisation
        Mesh and terms of the pressure.
    initial_guess : ContactSolution, optional
        Solution of a neighbouring contact.

    Returns
    -------
    ContactSolution
    """
    indenter, terms = problem.indenter(indentation), discretisation.terms
    patch, shear = (None, None) if initial_guess is None else (initial_guess.patch, initial_guess.shear)
    if problem.turns_with_friction:
        patch = patch or solve_contact_patch(surface, indenter, terms, None, discretisation.edges)
        contact = solve_stick_slip(problem, surface, indenter, terms, patch, shear)
        return ContactSolution(surface, indenter, *contact)
    patch = solve_contact_patch(surface, indenter, terms, patch, discretisation.edges)
    return ContactSolution(surface, indenter, with_peak_pressures(surface, indenter, patch))


def solve_stick_slip(
    problem: RollingProblem,
    surface: SurfaceCompliance,
    indenter: Indenter,
    terms: int,
    patch: ContactPatch,
    shear: ShearSolution | None,
) -> tuple[ContactPatch, ShearSolution]:
    """Solve pressure and shear alternately, with Aitken relaxation of the displacement by shear.

    Returns the `ContactPatch`, with its peak pressures, and the `ShearSolution`.
    """
    drawn = np.zeros((2, len(surface.x))) if shear is None else shear.displacement
    nodes, relaxation, previous, changes = None, 1.0, None, []
    history: EdgeHistory = ()
    for alternation in range(MAX_ALTERNATIONS):
        sheared = surface.with_initial(drawn)
        patch = solve_contact_patch(sheared, indenter, terms, patch)
        history += patch.history
        shear = solve_shear(problem, surface, patch, nodes)
        change = shear.displacement - drawn
        changes.append(float(np.abs(change).max() / np.abs(patch.displacement).max()))
        if changes[-1] < SHEAR_TOLERANCE:
            return with_peak_pressures(sheared, indenter, replace(patch, history=history)), shear
        if previous is not None:
            fall = previous - change
            relaxation = np.clip(relaxation * np.sum(previous * fall) / np.sum(fall**2), *RELAXATION_LIMITS)
        drawn, previous = drawn + relaxation * change, change
        nodes = None if alternation < FREE_ALTERNATIONS else shear.x[1:-1]
    raise UnresolvedError(
        f"pressure and shear did not converge to {SHEAR_TOLERANCE:g} in {MAX_ALTERNATIONS} alternations; the changes "
        f"by shear over the displacement are {changes}"
    )


def solve_shear(
    problem: RollingProblem, surface: SurfaceCompliance, patch: ContactPatch, nodes: Array | None = None
) -> ShearSolution:
    """Solve Coulomb's law under the pressure of a patch; tractions at nodes [m], all surface nodes by default."""
    nodes = surface.x if nodes is None else nodes
    inner = nodes[(nodes > patch.trailing) & (nodes < patch.leading)]
    if len(inner) > 2:  # without nodes close to an edge
        low = inner[0] - patch.trailing < EDGE_CLEARANCE * (inner[1] - inner[0])
        high = patch.leading - inner[-1] < EDGE_CLEARANCE * (inner[-1] - inner[-2])
        inner = inner[int(low) : len(inner) - int(high)]
    x = np.concatenate([[patch.trailing], inner, [patch.leading]])

    def tangent(at: Array) -> Array:  # of the roller towards +x, of unit length, shape (2, q)
        normal = np.stack([np.interp(at, patch.x, part) for part in patch.direction - patch.shear])
        return np.stack([-normal[1], normal[0]])

    points, weight, _, _ = compliance.contact_quadrature(surface.x, patch.edges)
    functions = _traction_functions(x, points) * weight[:, None]
    loads, share = compliance.shape_matrix(surface.x, points)[:, surface.loaded].T, functions.sum(axis=0)
    hats = np.stack([loads @ (functions * part[:, None]) for part in tangent(points)])
    bound = problem.roller.friction * np.maximum(np.interp(inner, patch.x, patch.pressure), 0)
    direction = problem.direction
    force = -direction * problem.torque / problem.roller.radius / problem.material.youngs_modulus
    if abs(force) >= bound @ share:
        raise RuntimeError(
            f"the roller skids: the torque is {abs(force) / (bound @ share):.3g} times the friction limit; reduce the "
            "torque, or raise the load or `friction`"
        )
    # slip s = A q + b + creepage of the nodes, signed along the travel
    response = surface.displacement(hats)
    upstream = slice(1, None) if direction > 0 else slice(0, -1)  # intervals on the upstream side of the nodes
    rate = -direction * (np.diff(compliance.shape_matrix(surface.x, x), axis=0) / np.diff(x)[:, None])[upstream]
    along = tangent(((x[1:] + x[:-1]) / 2)[upstream])
    A = sum(part[:, None] * (rate @ response[i]) for i, part in enumerate(along))
    u = patch.displacement + (0.0 if surface.initial is None else surface.initial.values)
    b = direction * (1 - along[0]) + sum(part * (rate @ u[i]) for i, part in enumerate(along))
    q, creepage, sticks = _stick_slip_active_set(A, b, bound, share, force)
    return ShearSolution(
        x=x,
        traction=np.concatenate([[0.0], q, [0.0]]),
        creepage=float(direction * creepage),
        sticks=sticks,
        resultant=hats.sum(axis=1) @ q,
        forces=hats @ q,
        displacement=response @ q,
        slip_work=-float(np.sum(share * q * (A @ q + b + creepage))),
    )


def _stick_slip_active_set(
    A: Array, b: Array, bound: Array, share: Array, force: float
) -> tuple[Array, float, BoolArray]:
    """Traction, creepage and nodes that stick: s = A q + b + creepage and share.q = force, signed along the travel."""
    sticks, sign, visited = np.ones(len(b), dtype=bool), np.zeros(len(b)), set()
    for _ in range(MAX_EXCHANGES):
        q, k = np.where(sticks, 0.0, sign * bound), np.flatnonzero(sticks)  # s = 0 on the nodes k that stick
        left = np.block([[A[np.ix_(k, k)], np.ones((len(k), 1))], [share[k][None], np.zeros((1, 1))]])
        *q[k], creepage = np.linalg.solve(left, np.append(-(A @ q + b)[k], force - share @ q))
        slip = A @ q + b + creepage
        over, drags = sticks & (np.abs(q) > bound * (1 + FRICTION_ROUNDING)), ~sticks & (slip * sign > 0)
        if not (over | drags).any():
            return q, creepage, sticks
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
