"""What a follower does on a polygon: the check of a cam that knows its points and nothing of its law.

At the angle phi the follower stands on the ray u = (cos phi, sin phi) from the axis and is pressed inwards. On a closed
polygon it rests at the largest rho at which it touches a vertex P, or an edge from A with the outward normal n:

    flat face          rho = P.u
    roller, vertex     rho = P.u + sqrt(r^2 - (u x P)^2)    where |u x P| <= r
    roller, edge       rho = (r + A.n)/(u.n)                where u.n > 0 and the foot of the centre lies on the edge

A point is a roller without radius. Lengths in m, angles in rad.
"""

import numpy as np

from compact.follower import FlatFace
from compact.refuse import refuse_nonfinite

TOGETHER = 48  # neighbouring angles that share the search for the part of the polygon before them


def rerolled(outline, follower, angle):
    """Distance rho [m] of a flat face, a point or a roller's centre from the axis of a polygon.

    Parameters
    ----------
    outline : vertices of the closed polygon [m], counterclockwise about the axis, ndarray of shape (n, 2)
    follower : Pointed, RollerFollower or FlatFace
    angle : cam angles phi [rad], ndarray of shape (m,)

    Returns an ndarray of shape (m,); -inf where the follower meets nothing.

    >>> square = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    >>> rerolled(square, FlatFace(), np.array([0.0, np.pi / 4])).round(6).tolist()
    [1.0, 1.414214]
    """
    outline, angle = np.asarray(outline, float), np.asarray(angle, float)
    refuse_nonfinite(outline=outline, angle=angle)
    rest = _on_face if isinstance(follower, FlatFace) else _on_roller
    order = np.argsort(np.mod(angle, 2 * np.pi))
    rho = np.empty(angle.size)
    for part in np.array_split(order, -(-angle.size // TOGETHER)):
        rho[part] = rest(outline, follower, np.mod(angle[part], 2 * np.pi))
    return rho


def _on_face(outline, _, angle):
    return (outline @ np.array([np.cos(angle), np.sin(angle)])).max(axis=0)


def _on_roller(outline, follower, angle):
    """The largest rho of all edges and vertices within reach of the rays; `angle` rises."""
    r, start = follower.radius, outline
    edge = np.roll(outline, -1, axis=0) - start
    near = _within_reach(start, edge, r, angle)
    start, edge = start[near], edge[near]
    length = np.hypot(*edge.T)
    tangent = edge / length[:, None]
    u = np.array([np.cos(angle), np.sin(angle)])
    return np.maximum(_on_edges(start, tangent, length, r, u), _on_vertices(start, r, u))


def _within_reach(start, edge, r, angle):
    """Edges that a roller on any of the rays may touch: the rays lie about the middle one."""
    middle, spread = (angle[0] + angle[-1]) / 2, (angle[-1] - angle[0]) / 2
    across = start[:, 1] * np.cos(middle) - start[:, 0] * np.sin(middle)
    return np.abs(across) <= r + np.hypot(*edge.T).max() + spread * np.hypot(*start.T).max()


def _on_edges(start, tangent, length, r, u):
    """Largest rho at which the roller touches an edge inside it, by ray."""
    normal = np.array([tangent[:, 1], -tangent[:, 0]]).T
    lean = normal @ u
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = (r + np.sum(start * normal, axis=1))[:, None] / lean
        foot = rho * (tangent @ u) - np.sum(start * tangent, axis=1)[:, None]
    rests = (lean > 0) & (foot >= 0) & (foot <= length[:, None])
    return np.where(rests, rho, -np.inf).max(axis=0)


def _on_vertices(start, r, u):
    """Largest rho at which the roller touches a vertex, by ray."""
    across = np.outer(start[:, 1], u[0]) - np.outer(start[:, 0], u[1])
    rho = start @ u + np.sqrt(np.maximum(r**2 - across**2, 0.0))
    return np.where(np.abs(across) <= r, rho, -np.inf).max(axis=0)
