"""Shear traction of a rolling contact that sticks and slips, under a pressure already known.

Over the roller, and relative to the speed, the mix slips along the tangent t by

    s = 1 + creep - t.(e_x + du/dx),    creep = angular speed x radius/speed - 1,

and Coulomb's law holds at every point: |q| <= f p, and q = -f p sign(v s) where s is not zero. q is linear between
the surface nodes, s the mean between a node and the next one upstream, where its mix comes from. Which nodes stick is
found by exchanging those that break the law. The creep is such that q sums to what the torque on the roller asks.
"""

from dataclasses import dataclass

import numpy as np

from compact.patch import Roll, interpolation, quadrature

EXCHANGES = 200
AT_BOUND = 1e-9  # share by which a sticking traction may pass f p


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


@dataclass(frozen=True, eq=False)
class DrawnRoll(Roll):
    """A `Roll` on a surface that shear tractions have displaced already: `drawn` of its nodes, shape (2, n)."""

    nodes: np.ndarray | None = None
    drawn: np.ndarray | None = None

    def touch(self, x, displacement):
        """As of `Roll`, for the displacement that the pressure alone has to make."""
        drawn = self.drawn @ interpolation(self.nodes, x).T
        normal, depth = super().touch(x, displacement + drawn)
        return normal, depth - np.sum(normal * drawn, axis=0)


def stick_and_slip(surface, patch, friction, asked, direction):
    """The `Shear` with int q dx = `asked` under the pressure of a patch, for a roller that travels along +x (direction
    1) or -x (-1); RuntimeError if it skids.
    """
    x, hats, share = _hats(surface, patch)
    bound = friction * np.maximum(np.interp(x[1:-1], patch.x, patch.pressure), 0)
    if abs(asked) >= bound @ share:
        raise RuntimeError(f"the roller skids: {abs(asked) / (bound @ share):.3g} times the friction limit asked")
    response = np.einsum("iakb,kbj->iaj", surface.response, hats, optimize=True)
    upstream = slice(1, None) if direction > 0 else slice(0, -1)  # of the intervals, the one before each node
    slope = (np.diff(interpolation(surface.x, x), axis=0) / np.diff(x)[:, None])[upstream]
    tangent = _tangent(patch, ((x[1:] + x[:-1]) / 2)[upstream])
    A = -direction * sum(part[:, None] * (slope @ response[i]) for i, part in enumerate(tangent))
    moved = sum(part * (slope @ patch.displacement[i]) for i, part in enumerate(tangent))
    b = direction * (1 - tangent[0] - moved)
    q, creep, sticks = _exchanged(A, b, bound, share, asked)
    return Shear(
        x=x,
        traction=np.concatenate([[0.0], q, [0.0]]),
        creep=float(direction * creep),
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
        seen.add((state.tobytes(), direction.tobytes()))
        sticks, sign = state, direction
    raise RuntimeError(f"zones of stick and slip did not settle in {EXCHANGES} exchanges")


def _solved(A, b, slipping, share, asked, sticks):
    """q as given where it slips and with s = 0 where it sticks, and the creep that makes it sum to what is asked."""
    q, k = np.where(sticks, 0.0, slipping), np.flatnonzero(sticks)
    left = np.block([[A[np.ix_(k, k)], np.ones((len(k), 1))], [share[k][None], np.zeros((1, 1))]])
    answer = np.linalg.solve(left, np.append(-(A @ q + b)[k], asked - share @ q))
    q[k] = answer[:-1]
    return q, answer[-1]


def _hats(surface, patch):
    """Edges and nodes between; nodal forces of tractions that are hats on the latter, (2, m, k); integrals of these."""
    inside = surface.x[(surface.x > patch.trailing) & (surface.x < patch.leading)]
    x = np.concatenate([[patch.trailing], inside, [patch.leading]])
    points, weight, _, _ = quadrature(surface.x, (patch.trailing, patch.leading))
    hats = np.array([np.interp(points, x, row) for row in np.eye(len(x))[1:-1]]).T * weight[:, None]
    loads = interpolation(surface.x, points)[:, surface.first : surface.last].T
    forces = np.stack([loads @ (hats * part[:, None]) for part in _tangent(patch, points)])
    return x, forces, hats.sum(axis=0)


def _tangent(patch, x):
    """Unit tangent of the roller towards +x, shape (2, q); without friction the traction points along the normal."""
    normal = np.stack([np.interp(x, patch.x, part) for part in patch.direction - patch.shear])
    return np.stack([-normal[1], normal[0]])
