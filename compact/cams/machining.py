"""Cams to cut: the profile as a polygon to a tolerance, the path of the cutter's centre, and the check of both.

The cutter of radius c runs outside the profile, its centre c away along the outward normal

    n = (cos(phi - a), sin(phi - a)),    a the pressure angle

and fits where it is no larger than the hollows: for all points P, Q of the profile, n that at P,

    c <= |Q - P|^2/(2 (Q - P).n),    near P the radius of curvature of a concave part

A chord over dphi lies up to turn arc dphi^2/8 inside the profile (outside a hollow), which moves a follower by that
over cos(a); points are spaced so that this is even all round. What the follower then does on the rounded points is
computed by `reroll`, apart from the law, and the points are refined until it keeps the law. Lengths in m, angles in
rad.

What a follower does on a polygon: the check of a cam that knows its points and nothing of its law.

At the angle phi the follower stands on the ray u = (cos phi, sin phi) from the axis and is pressed inwards. On a closed
polygon it rests at the largest rho at which it touches a vertex P, or an edge from A with the outward normal n:

    flat face          rho = P.u
    roller, vertex     rho = P.u + sqrt(r^2 - (u x P)^2)    where |u x P| <= r
    roller, edge       rho = (r + A.n)/(u.n)                where u.n > 0 and the foot of the centre lies on the edge

A point is a roller without radius. Lengths in m, angles in rad.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.cams.followers import FlatFace
from compact.cams.profile import Cam
from compact.numerics.validation import require_between, require_finite, require_positive

MICROMETRE = 1e-6
DECIMALS = 9  # of the points in m, six of a millimetre
WIDEST = np.radians(1.0)  # between two points, however straight the profile is
SAMPLES = 256  # of the spacing between two joins
SHARE = 0.8  # of the tolerance that the chords may take; rounding and steep flanks take the rest
REFINEMENTS = 6  # each halves what the chords may take
FEELERS = 1440  # points of the profile at which the cutter is tried against all others


@dataclass(frozen=True)
class Cut:
    """A cam ready to be cut, closed polygons counterclockwise.

    angle : cam angles of the points [rad], shape (n,)
    profile : points of the profile [m], shape (n, 2), rounded to a nanometre
    cutter_path : centres of the cutter [m], shape (n, 2), or None without a cutter
    error : largest |re-rolled follower - law| of the rounded polygon [m], at four angles a point
    """

    cam: Cam
    tolerance: float
    angle: np.ndarray
    profile: np.ndarray
    error: float
    cutter_radius: float | None = None
    cutter_path: np.ndarray | None = None

    @property
    def polar(self):
        """Polar radius [m] and polar angle [rad] of the points of the profile, ndarray of shape (2, n)."""
        x, y = self.profile.T
        return np.array([np.hypot(x, y), np.unwrap(np.arctan2(y, x))])


def cut(cam, cutter_radius=None, tolerance=MICROMETRE):
    """`Cut` of a cam to a tolerance [m] of its follower's motion, for a cutter of a radius [m] if one is given.

    Raises ValueError where the cam is undercut or has corners, where the cutter does not fit, and RuntimeError where
    no polygon of the refinements tried keeps the tolerance.

    >>> from compact.cams.profile import FlatFace
    >>> from compact.motion.profile import Cycle, law
    >>> made = cut(Cam(Cycle(law("quintic", stroke=0.4, duration=3.0)), breadth=0.9, follower=FlatFace()), 0.02)
    >>> len(made.angle), made.error < 1e-6
    (1662, True)
    """
    require_between(1e-8, 1e-2, tolerance=tolerance)
    _refuse_uncuttable(cam)
    if cutter_radius is not None:
        _refuse_large_cutter(cam, cutter_radius)
    angle, profile, error = _polygon(cam, tolerance)
    path = None if cutter_radius is None else _moved_out(cam, angle, cutter_radius)
    return Cut(cam, tolerance, angle, profile, error, cutter_radius, path)


def largest_cutter(cam):
    """Radius [m] of the largest cutter that reaches every point of a profile from outside; infinite if it is convex."""
    angle = np.linspace(0, 2 * np.pi, FEELERS, endpoint=False)
    place, normal = cam.profile(angle).T, _normal(cam, angle).T
    reach = place @ normal.T - np.sum(place * normal, axis=1)  # (Q - P).n, a column for each P
    apart = np.sum((place[:, None] - place) ** 2, axis=2)
    blocked = reach > 1e-12 * apart.max() ** 0.5
    feelers = np.min(apart[blocked] / (2 * reach[blocked]), initial=np.inf)
    return min(float(feelers), cam.least_hollow_radius)


def _refuse_uncuttable(cam):
    if cam.kinks:
        raise ValueError(
            f"`cam` has a corner where the velocity of the law jumps, at the angle {cam.kinks[0]:.4g} rad; "
            "choose a law without jumps of velocity"
        )
    if cam.undercut:
        least = cam.least_breadth()
        raise ValueError(
            f"`cam` is undercut: its breadth must exceed {least.breadth:.6g} m ({least.rule}), got {cam.breadth:g} m"
        )


def _refuse_large_cutter(cam, cutter_radius):
    require_positive(cutter_radius=cutter_radius)
    if cutter_radius > (limit := largest_cutter(cam)):
        raise ValueError(
            f"`cutter_radius` must be at most {limit * (1 - 1e-7):.8g} m, or the cutter does not fit the hollows of "
            f"the cam, got {cutter_radius:g} m; take a smaller cutter"
        )


def _polygon(cam, tolerance):
    """Angles, rounded points and error of the coarsest polygon tried that keeps the tolerance."""
    for halving in range(REFINEMENTS):
        angle = _spaced(cam, SHARE * tolerance / 2**halving)
        profile = _moved_out(cam, angle, 0.0)
        error = _error(cam, angle, profile)
        if error <= tolerance:
            return angle, profile, error
    raise RuntimeError(
        f"{angle.size} points leave the follower {error:.3g} m off its law, more than the tolerance of {tolerance:g} "
        "m; make the cam broader, or the tolerance wider"
    )


def _spaced(cam, sagitta):
    """Angles [rad] in [0, 2 pi), joins among them, whose chords move the follower by `sagitta` [m] at most."""
    joins = np.append(cam.breakpoints, cam.breakpoints[0] + 2 * np.pi)
    return np.concatenate([_share_out(cam, low, high, sagitta) for low, high in pairwise(joins)])


def _share_out(cam, low, high, sagitta):
    """Angles from `low` on to before `high`, as many as the chords need and spaced as they need."""
    edges = np.linspace(low, high, SAMPLES + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    turn, arc = cam.rates(middle)
    needed = np.sqrt(np.abs(turn * arc) / (8 * sagitta * np.cos(cam.pressure_angle(middle))))
    counted = np.append(0.0, np.cumsum(np.maximum(needed, 1 / WIDEST) * np.diff(edges)))
    chords = int(np.ceil(counted[-1]))
    return np.interp(np.linspace(0, counted[-1], chords, endpoint=False), counted, edges)


def _error(cam, angle, profile):
    """Largest |re-rolled follower - law| [m], at every point's angle and three between each two."""
    step = np.diff(angle, append=angle[0] + 2 * np.pi)
    tried = (angle[:, None] + step[:, None] * np.arange(4) / 4).ravel()
    return float(np.abs(rerolled(profile, cam.follower, tried) - cam.radius(tried)).max())


def _moved_out(cam, angle, distance):
    """Points `distance` [m] outside the profile, rounded, ndarray of shape (n, 2)."""
    return np.round((cam.profile(angle) + distance * _normal(cam, angle)).T, DECIMALS)


def _normal(cam, angle):
    """Outward unit normal of the profile in the frame of the cam, ndarray of shape (2, n)."""
    turned = angle - cam.pressure_angle(angle)
    return np.array([np.cos(turned), np.sin(turned)])


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
    require_finite(outline=outline, angle=angle)
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
