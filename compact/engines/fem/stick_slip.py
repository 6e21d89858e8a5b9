"""Shear traction of a rolling contact that sticks and slips, together with its pressure.

Over the roller, and relative to the speed, the mix slips along the tangent t by

    s = 1 + creep - t.(e_x + du/dx),    creep = angular speed x radius/speed - 1,

and Coulomb's law holds at every point: |q| <= f p, and q = -f p sign(v s) where s is not zero. Like the pressure, q
ends with square roots at both edges, times a factor that is linear between the surface nodes; s is the mean between a
node and the next one upstream, where its mix comes from. Which nodes stick is found by exchanging those that break the
law. The creep is such that q sums to what the torque on the roller asks. Pressure and shear are found in turn.
"""

from dataclasses import dataclass, replace

import numpy as np

from compact.engines.fem.contact_patch import UnresolvedError, interpolation, press, quadrature, with_peaks

TURNS = 60  # of pressure and shear
TURN_TOLERANCE = 1e-7  # of the largest displacement, about 1e-6 of the peak pressure
FREE_TURNS = 5  # after which shear takes no more nodes in, lest one at an edge come and go for ever
SHARES = 0.1, 2.0  # of the change that the shear asks for, between which Aitken's rule chooses
EXCHANGES = 200
NEAR_EDGE = 0.5  # of the distance to the next node: what is nearer to an edge sees too little of the contact
AT_BOUND = 1e-9  # share by which a sticking traction may pass f p


@dataclass(frozen=True, eq=False)
class FrictionCondition:
    """Friction f, int q dx `asked` [m of relaxed modulus], and the `direction` of travel, 1 along +x or -1.

    Where the motion is not steady the slip has a rate besides, and is one itself, v s as above:

        v s = v (1 + creep - t.(e_x + du/dx)) + rate t.(u - before),    the last at the nodes

    velocity : v;  rate : one over a step in time;  aside, before : displacement of the surface nodes besides that by
    pressure and shear, and all of it before the step, seen from the roller, shape (2, n)
    In steady motion v s is s with the sign of the travel, and the creep has no unit.
    """

    friction: float
    asked: float
    direction: float
    velocity: float | None = None
    rate: float = 0.0
    aside: np.ndarray | float = 0.0
    before: np.ndarray | float = 0.0


@dataclass(frozen=True, eq=False)
class Shear:
    """Shear traction q on the mix at `x`, the edges and the nodes between them, and what it does.

    creep : angular speed x radius/speed - 1;  sticks : of the nodes inside, shape (k,)
    sum : of the traction as a force (x, y) [m of relaxed modulus], shape (2,)
    forces : on the loaded nodes, shape (2, m);  displacement : of the surface nodes, shape (2, n)
    lost : work of slip per length rolled, - sign(v) int q s dx
    """

    x: np.ndarray
    traction: np.ndarray
    creep: float
    sticks: np.ndarray
    sum: np.ndarray
    forces: np.ndarray
    displacement: np.ndarray
    lost: float

    def at(self, x):
        """The traction at x, shape (q,)."""
        return _shapes(self.x, x) @ self.traction[1:-1]


def pressed_and_sheared(surface, roll, terms, grip, patch=None, shear=None):
    """The `Patch`, with its peaks, and the `Shear` that belong together, from others near them on; terms as of `press`.

    Aitken's rule chooses how much of each change is taken, so that what swings or creeps settles too. RuntimeError with
    the changes if nothing does, or if the roller skids.
    """
    drawn = np.zeros((2, len(surface.x))) if shear is None else shear.displacement
    nodes, share, before, changes, history = None, 1.0, None, [], ()
    for turn in range(TURNS):
        under = roll.over(surface.x, drawn)
        patch = press(surface, under, terms, patch)
        history += patch.history
        shear = stick_and_slip(surface, patch, grip, nodes)
        change = shear.displacement - drawn
        changes.append(float(np.abs(change).max() / np.abs(patch.displacement).max()))
        if changes[-1] < TURN_TOLERANCE:
            return with_peaks(surface, under, replace(patch, history=history)), shear
        if before is not None:
            fall = before - change
            share = np.clip(share * np.sum(before * fall) / np.sum(fall**2), *SHARES)
        drawn, before = drawn + share * change, change
        nodes = None if turn < FREE_TURNS else shear.x[1:-1]
    raise UnresolvedError(f"pressure and shear did not settle: changes by shear over the displacement were {changes}")


def stick_and_slip(surface, patch, grip, nodes=None):
    """The `Shear` under the pressure of a patch, on all surface nodes or on some; RuntimeError if the roller skids."""
    x = _from_edge_to_edge(patch, surface.x if nodes is None else nodes)
    hats, share = _hats(surface, patch, x)
    bound = grip.friction * np.maximum(np.interp(x[1:-1], patch.x, patch.pressure), 0)
    if abs(grip.asked) >= bound @ share:
        raise RuntimeError(f"the roller skids: {abs(grip.asked) / (bound @ share):.3g} times the friction limit asked")
    response = np.einsum("iakb,kbj->iaj", surface.response, hats, optimize=True)
    upstream = slice(1, None) if grip.direction > 0 else slice(0, -1)  # of the intervals, the one before each node
    at_nodes, velocity = interpolation(surface.x, x), grip.direction if grip.velocity is None else grip.velocity
    slope = (np.diff(at_nodes, axis=0) / np.diff(x)[:, None])[upstream]
    rising = grip.rate * at_nodes[1:-1]  # at the nodes: means would not see tractions that alternate
    tangent = _tangent(patch, ((x[1:] + x[:-1]) / 2)[upstream])
    A = sum(part[:, None] * ((rising - velocity * slope) @ response[i]) for i, part in enumerate(tangent))
    u, risen = (patch.displacement + given for given in (grip.aside, grip.aside - grip.before))
    moved = sum(part * (rising @ risen[i] - velocity * (slope @ u[i])) for i, part in enumerate(tangent))
    b = velocity * (1 - tangent[0]) + moved
    q, creep, sticks = _exchanged(A, b, bound, share, grip.asked)
    return Shear(
        x=x,
        traction=np.concatenate([[0.0], q, [0.0]]),
        creep=float(grip.direction * creep),
        sticks=sticks,
        sum=hats.sum(axis=1) @ q,
        forces=hats @ q,
        displacement=response @ q,
        lost=-float(np.sum(share * q * (A @ q + b + creep))),
    )


def _exchanged(A, b, bound, share, asked):
    """q, creep and who sticks: s = A q + b + creep, sum share q = asked, all with the sign of the travel."""
    sticks, sign, seen = np.ones(len(b), dtype=bool), np.zeros(len(b)), set()
    for _ in range(EXCHANGES):
        q, creep = _solved(A, b, sign * bound, share, asked, sticks)
        slip = A @ q + b + creep
        over, drags = sticks & (np.abs(q) > bound * (1 + AT_BOUND)), ~sticks & (slip * sign > 0)
        if not (over | drags).any():
            return q, creep, sticks
        state, direction = (sticks & ~over) | drags, np.where(over, np.sign(q), sign)
        if (state.tobytes(), direction.tobytes()) in seen:  # one at a time where all at once goes round
            worst = np.argmax(np.where(over, np.abs(q), 0) + np.where(drags, bound.max(), 0))
            state, direction = sticks.copy(), sign.copy()
            state[worst], direction[worst] = ~sticks[worst], np.sign(q[worst])
        if not state.any():  # one has to stick, or nothing tells the creep
            state[_first_to_stick(A, b, direction * bound, share, asked)] = True
        seen.add((state.tobytes(), direction.tobytes()))
        sticks, sign = state, direction
    raise UnresolvedError(f"zones of stick and slip did not settle in {EXCHANGES} exchanges")


def _first_to_stick(A, b, q, share, asked):
    """Of the nodes whose slip keeps the sum of q from what is asked, the one that slips least."""
    lacking = np.sign(asked - share @ q)
    return np.argmin(np.where(q * lacking < 0, lacking * (A @ q + b), np.inf))


def _solved(A, b, slipping, share, asked, sticks):
    """q as given where it slips and with s = 0 where it sticks, and the creep that makes it sum to what is asked."""
    q, k = np.where(sticks, 0.0, slipping), np.flatnonzero(sticks)
    left = np.block([[A[np.ix_(k, k)], np.ones((len(k), 1))], [share[k][None], np.zeros((1, 1))]])
    answer = np.linalg.solve(left, np.append(-(A @ q + b)[k], asked - share @ q))
    q[k] = answer[:-1]
    return q, answer[-1]


def _from_edge_to_edge(patch, nodes):
    """The two edges and the nodes between them, but for such as crowd an edge."""
    x = nodes[(nodes > patch.trailing) & (nodes < patch.leading)]
    if len(x) > 2:
        crowds = x[0] - patch.trailing < NEAR_EDGE * (x[1] - x[0]), patch.leading - x[-1] < NEAR_EDGE * (x[-1] - x[-2])
        x = x[int(crowds[0]) : len(x) - int(crowds[1])]
    return np.concatenate([[patch.trailing], x, [patch.leading]])


def _hats(surface, patch, x):
    """Nodal forces of the tractions that `_shapes` are, shape (2, m, k), and their integrals."""
    points, weight, _, _ = quadrature(surface.x, (patch.trailing, patch.leading))
    hats = _shapes(x, points) * weight[:, None]
    loads = interpolation(surface.x, points)[:, surface.first : surface.last].T
    forces = np.stack([loads @ (hats * part[:, None]) for part in _tangent(patch, points)])
    return forces, hats.sum(axis=0)


def _shapes(x, points):
    """Tractions that are one at one of the nodes between the edges x[0], x[-1] and zero at the others, shape (q, k).

    Hats between the nodes, flat from the outermost to the edges, times the square roots of the distances to the edges.
    """
    hats = np.array([np.interp(points, x[1:-1], row) for row in np.eye(len(x) - 2)]).T
    root, unit = (np.sqrt(np.maximum((at - x[0]) * (x[-1] - at), 0)) for at in (points, x[1:-1]))
    return hats * root[:, None] / unit


def _tangent(patch, x):
    """Unit tangent of the roller towards +x, shape (2, q); without friction the traction points along the normal."""
    normal = np.stack([np.interp(x, patch.x, part) for part in patch.direction - patch.shear])
    return np.stack([-normal[1], normal[0]])
