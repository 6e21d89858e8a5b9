"""Shear traction of a rolling contact with stick and slip zones, coupled with its pressure.

The slip of the mix on the roller along the tangent t, relative to the rolling speed v, is

    s = 1 + creepage - t.(e_x + du/dx),    creepage = angular speed x radius/v - 1,

and Coulomb's law holds at every point: |q| <= f p, and q = -f p sign(v s) where s is not zero. Like the pressure, q
vanishes at both edges as a square root, times a factor linear between the surface nodes. The slip of a node is the mean
over the interval on its upstream side. An active-set method finds the nodes that stick; the creepage follows from the
prescribed sum of q, which is the torque over the radius. Pressure and shear are solved alternately.

References
----------
J. J. Kalker, Three-dimensional elastic bodies in rolling contact (Kluwer, 1990); K. L. Johnson, Contact
mechanics (Cambridge, 1985), chapter 8; B. M. Irons and R. C. Tuck, Int. J. Numer. Meth. Eng. 1 (1969) 275 (Aitken
relaxation).
"""

from dataclasses import dataclass, replace

import numpy as np

from compact.engines.fem.contact_patch import (
    ContactPatch,
    EdgeHistory,
    Indenter,
    UnresolvedError,
    solve_contact_patch,
    with_peak_pressures,
)
from compact.engines.fem.surface import SurfaceCompliance, contact_quadrature, shape_matrix
from compact.numerics import Array, BoolArray

MAX_ALTERNATIONS = 60  # [-], solves for pressure and shear
SHEAR_TOLERANCE = 1e-7  # [-], change of the largest displacement at convergence; some 1e-6 of the peak pressure
FREE_ALTERNATIONS = 5  # [-], before the set of nodes is fixed; a node at an edge may otherwise alternate without end
RELAXATION_LIMITS = 0.1, 2.0  # [-], of the relaxation factor by Aitken's rule
MAX_EXCHANGES = 200  # [-], of nodes between stick and slip
EDGE_CLEARANCE = 0.5  # [-], least distance of a node from an edge over its distance to the next node
FRICTION_ROUNDING = 1e-9  # [-], by which a traction that sticks may exceed f p


@dataclass(frozen=True, eq=False)
class FrictionCondition:
    """Coulomb friction of a roller under a prescribed tangential force.

    In unsteady motion the slip is a velocity and includes the rate of the displacement,

        v s = v (1 + creepage - t.(e_x + du/dx)) + rate t.(u - previous),    the last term at the nodes.

    In steady motion v s is s with the sign of the travel, and the creepage is dimensionless.

    Parameters
    ----------
    friction, tangential_force, direction : float
        Coefficient f [-], prescribed int q dx over the relaxed modulus [m], and direction of travel, 1 along +x or -1.
    velocity : float, optional
        Velocity v of the roller [m/s]; None in steady motion.
    rate : float
        Inverse of the time step [1/s].
    previous : ndarray
        Displacement of the surface nodes one step earlier in coordinates of the roller [m], shape (2, n).
    """

    friction: float
    tangential_force: float
    direction: float
    velocity: float | None = None
    rate: float = 0.0
    previous: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class ShearSolution:
    """Shear traction on the mix, in units of the relaxed modulus.

    Parameters
    ----------
    x, traction : ndarray
        Edges and the nodes between them [m], and the traction there [-], shape (k + 2,).
    creepage : float
        Angular speed x radius/speed - 1 [-]; in unsteady motion the excess of the peripheral speed [m/s].
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


def solve_stick_slip(
    surface: SurfaceCompliance,
    indenter: Indenter,
    terms: int,
    friction: FrictionCondition,
    patch: ContactPatch | None = None,
    shear: ShearSolution | None = None,
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
        shear = solve_shear(surface, patch, friction, nodes)
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
    surface: SurfaceCompliance, patch: ContactPatch, friction: FrictionCondition, nodes: Array | None = None
) -> ShearSolution:
    """Solve Coulomb's law under the pressure of a patch.

    Parameters
    ----------
    surface : SurfaceCompliance
        Compliance of the surface.
    patch : ContactPatch
        Contact with its pressure.
    friction : FrictionCondition
        Coefficient of friction and prescribed tangential force.
    nodes : ndarray, optional
        Positions of the tractions [m]; all surface nodes by default.

    Returns
    -------
    ShearSolution
    """
    x = _nodes_between_edges(patch, surface.x if nodes is None else nodes)
    hats, share = _nodal_forces(surface, patch, x)
    bound = friction.friction * np.maximum(np.interp(x[1:-1], patch.x, patch.pressure), 0)
    force = friction.tangential_force
    if abs(force) >= bound @ share:
        raise RuntimeError(
            f"the roller skids: the torque is {abs(force) / (bound @ share):.3g} times the friction limit; reduce the "
            "torque, or raise the load or `friction`"
        )
    response = surface.displacement(hats)
    A, b = _slip_equations(surface, patch, friction, x, response)
    q, creepage, sticks = _stick_slip_active_set(A, b, bound, share, force)
    return ShearSolution(
        x=x,
        traction=np.concatenate([[0.0], q, [0.0]]),
        creepage=float(friction.direction * creepage),
        sticks=sticks,
        resultant=hats.sum(axis=1) @ q,
        forces=hats @ q,
        displacement=response @ q,
        slip_work=-float(np.sum(share * q * (A @ q + b + creepage))),
    )


def _slip_equations(
    surface: SurfaceCompliance, patch: ContactPatch, friction: FrictionCondition, x: Array, response: Array
) -> tuple[Array, Array]:
    """Assemble A and b of the slip s = A q + b + creepage at the nodes between the edges."""
    velocity = friction.direction if friction.velocity is None else friction.velocity
    upstream = slice(1, None) if friction.direction > 0 else slice(0, -1)  # intervals on the upstream side of the nodes
    at_nodes = shape_matrix(surface.x, x)
    slope = (np.diff(at_nodes, axis=0) / np.diff(x)[:, None])[upstream]
    rising = friction.rate * at_nodes[1:-1]  # at the nodes, since means filter out alternating tractions
    tangent = _tangent(patch, ((x[1:] + x[:-1]) / 2)[upstream])
    A = sum(part[:, None] * ((rising - velocity * slope) @ response[i]) for i, part in enumerate(tangent))
    initial = 0.0 if surface.initial is None else surface.initial.values
    u, risen = (patch.displacement + given for given in (initial, initial - friction.previous))
    moved = sum(part * (rising @ risen[i] - velocity * (slope @ u[i])) for i, part in enumerate(tangent))
    return A, velocity * (1 - tangent[0]) + moved


def _stick_slip_active_set(
    A: Array, b: Array, bound: Array, share: Array, force: float
) -> tuple[Array, float, BoolArray]:
    """Traction, creepage and nodes that stick: s = A q + b + creepage and share.q = force, signed along the travel."""
    sticks, sign, visited = np.ones(len(b), dtype=bool), np.zeros(len(b)), set()
    for _ in range(MAX_EXCHANGES):
        q, creepage = _solve_stick_zone(A, b, sign * bound, share, force, sticks)
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


def _solve_stick_zone(
    A: Array, b: Array, slipping: Array, share: Array, force: float, sticks: BoolArray
) -> tuple[Array, float]:
    """Return the traction, s = 0 in the stick zone and the friction limit elsewhere, and the creepage for its sum."""
    q, k = np.where(sticks, 0.0, slipping), np.flatnonzero(sticks)
    left = np.block([[A[np.ix_(k, k)], np.ones((len(k), 1))], [share[k][None], np.zeros((1, 1))]])
    answer = np.linalg.solve(left, np.append(-(A @ q + b)[k], force - share @ q))
    q[k] = answer[:-1]
    return q, answer[-1]


def _nodes_between_edges(patch: ContactPatch, nodes: Array) -> Array:
    """Both edges and the nodes between them, without nodes close to an edge."""
    x = nodes[(nodes > patch.trailing) & (nodes < patch.leading)]
    if len(x) > 2:
        low = x[0] - patch.trailing < EDGE_CLEARANCE * (x[1] - x[0])
        high = patch.leading - x[-1] < EDGE_CLEARANCE * (x[-1] - x[-2])
        x = x[int(low) : len(x) - int(high)]
    return np.concatenate([[patch.trailing], x, [patch.leading]])


def _nodal_forces(surface: SurfaceCompliance, patch: ContactPatch, x: Array) -> tuple[Array, Array]:
    """Nodal forces of the traction functions, shape (2, m, k), and their integrals, shape (k,)."""
    points, weight, _, _ = contact_quadrature(surface.x, patch.edges)
    functions = _traction_functions(x, points) * weight[:, None]
    loads = shape_matrix(surface.x, points)[:, surface.loaded].T
    forces = np.stack([loads @ (functions * part[:, None]) for part in _tangent(patch, points)])
    return forces, functions.sum(axis=0)


def _traction_functions(x: Array, points: Array) -> Array:
    """Functions that are 1 at one node between the edges x[0] and x[-1] and 0 at the others, shape (q, k).

    Hats between the nodes, constant outside the outermost ones, times square roots of the distances to the edges.
    """
    hats = np.array([np.interp(points, x[1:-1], row) for row in np.eye(len(x) - 2)]).T
    root, unit = (np.sqrt(np.maximum((at - x[0]) * (x[-1] - at), 0)) for at in (points, x[1:-1]))
    return hats * root[:, None] / unit


def _tangent(patch: ContactPatch, x: Array) -> Array:
    """Tangent of the roller towards +x, of unit length, shape (2, q)."""
    normal = np.stack([np.interp(x, patch.x, part) for part in patch.direction - patch.shear])
    return np.stack([-normal[1], normal[0]])
