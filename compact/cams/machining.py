"""Machining of a cam: profile as a polygon within a tolerance, path of the cutter centre, and an independent check.

A cutter of radius c runs outside the profile, its centre c away along the outward normal

    n = (cos(phi - a), sin(phi - a)),    a the pressure angle

and fits if it is not larger than the concave parts: for all points P, Q of the profile and n at P,

    c <= |Q - P|^2/(2 (Q - P).n),    near P the radius of curvature of a concave part

A chord over dphi deviates by up to turn arc dphi^2/8 from the profile, which moves a follower by that over cos(a);
points are spaced so that the deviation is uniform. The check computes the follower on the rounded polygon alone,
without the law, and the points are refined until it keeps the law. At the angle phi the follower lies on the ray
u = (cos phi, sin phi) and is pressed inwards: it rests at the largest rho at which it touches a vertex P, or an edge
from A with the outward normal n:

    flat face          rho = P.u
    roller, vertex     rho = P.u + sqrt(r^2 - (u x P)^2)    where |u x P| <= r
    roller, edge       rho = (r + A.n)/(u.n)                where u.n > 0 and the foot of the centre lies on the edge

A point is a roller of radius 0. Lengths in m, angles in rad.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from compact.cams.profile import Cam, FlatFace, Follower
from compact.numerics import Array
from compact.numerics.validation import require_between, require_finite, require_instance, require_positive

MICROMETRE = 1e-6  # [m], default tolerance of the follower's motion
DECIMALS = 9  # [-], of coordinates in m: a nanometre
STEP_LIMIT = np.radians(1.0)  # [rad], between two points, also on a straight profile
SPACING_SAMPLES = 256  # [-], of the spacing between two breakpoints
CHORD_SHARE = 0.8  # [-], of the tolerance, for the chords; rounding and steep flanks use the rest
REFINEMENT_LIMIT = 6  # [-], each halves the deviation of the chords
CHECKS_PER_STEP = 4  # [-], angles of the check between two points, the first point included
CUTTER_SAMPLES = 1440  # [-], points of the profile whose clearance for the cutter is computed
CUTTER_MARGIN = 1e-7  # [-], of the largest cutter, below which a message states it
RAYS_PER_SEARCH = 48  # [-], neighbouring angles that share the search for nearby edges of the polygon


@dataclass(frozen=True)
class Cut:
    """Cam as closed polygons for machining, counterclockwise.

    Attributes
    ----------
    tolerance : float
        Tolerance of the follower's motion [m].
    angle : ndarray, shape (n,)
        Cam angles of the points [rad].
    profile : ndarray, shape (n, 2)
        Points of the profile [m], rounded to a nanometre.
    error : float
        Largest |follower on the polygon - law| [m], at four angles per point.
    cutter_radius : float, optional
        Radius of the cutter [m].
    cutter_path : ndarray, shape (n, 2), optional
        Centres of the cutter [m].
    """

    cam: Cam
    tolerance: float
    angle: Array
    profile: Array
    error: float
    cutter_radius: float | None = None
    cutter_path: Array | None = None

    @property
    def polar(self) -> Array:
        """Radius [m] and polar angle [rad] of the points of the profile, shape (2, n)."""
        x, y = self.profile.T
        return np.array([np.hypot(x, y), np.unwrap(np.arctan2(y, x))])


def cut(cam: Cam, cutter_radius: float | None = None, tolerance: float = MICROMETRE) -> Cut:
    """Compute polygons of a cam for machining.

    Parameters
    ----------
    cutter_radius : float, optional
        Radius of the cutter [m].
    tolerance : float
        Largest deviation of the follower from the law [m].

    Raises
    ------
    ValueError
        If the cam is undercut or has corners, or the cutter does not fit.
    RuntimeError
        If no polygon within the limit of refinements keeps the tolerance.

    Examples
    --------
    >>> from compact.motion.profile import Cycle, law
    >>> outline = cut(Cam(Cycle(law("quintic", stroke=0.4, duration=3.0)), breadth=0.9, follower=FlatFace()), 0.02)
    >>> len(outline.angle), outline.error < 1e-6
    (1662, True)
    """
    require_instance(Cam, "a Cam", cam=cam)
    require_between(1e-8, 1e-2, tolerance=tolerance)
    if cam.corner_angles:
        raise ValueError(
            f"`cam` has a corner where the velocity of the law jumps, at the angle {cam.corner_angles[0]:.4g} rad; "
            "use a law with continuous velocity"
        )
    if cam.undercut:
        least = cam.least_breadth()
        raise ValueError(
            f"`cam` is undercut: its breadth must exceed {least.breadth:.6g} m ({least.rule}), got {cam.breadth:g} m; "
            "increase the breadth"
        )
    if cutter_radius is not None:
        require_positive(cutter_radius=cutter_radius)
        if cutter_radius > (limit := largest_cutter(cam)):
            raise ValueError(
                f"`cutter_radius` must be at most {limit * (1 - CUTTER_MARGIN):.8g} m to fit the concave parts of the "
                f"cam, got {cutter_radius:g} m; use a smaller cutter"
            )
    breaks = np.append(cam.breakpoints, cam.breakpoints[0] + 2 * np.pi)
    for halving in range(REFINEMENT_LIMIT):  # the coarsest polygon that keeps the tolerance
        deviation = CHORD_SHARE * tolerance / 2**halving
        angle = np.concatenate([_angles_between(cam, low, high, deviation) for low, high in pairwise(breaks)])
        profile = _offset_points(cam, angle, 0.0)
        step = np.diff(angle, append=angle[0] + 2 * np.pi)
        checked = (angle[:, None] + step[:, None] * np.arange(CHECKS_PER_STEP) / CHECKS_PER_STEP).ravel()
        error = float(np.abs(follower_on_polygon(profile, cam.follower, checked) - cam.radius(checked)).max())
        if error <= tolerance:
            path = None if cutter_radius is None else _offset_points(cam, angle, cutter_radius)
            return Cut(cam, tolerance, angle, profile, error, cutter_radius, path)
    raise RuntimeError(
        f"the follower on {angle.size} points deviates by {error:.3g} m from its law, allowed {tolerance:g} m; "
        "increase the breadth of the cam or the tolerance"
    )


def largest_cutter(cam: Cam) -> float:
    """Compute the radius [m] of the largest cutter that reaches every point of a profile; infinite if it is convex."""
    angle = np.linspace(0, 2 * np.pi, CUTTER_SAMPLES, endpoint=False)
    place, normal = cam.profile(angle).T, _normal(cam, angle).T
    reach = place @ normal.T - np.sum(place * normal, axis=1)  # (Q - P).n, a column for each P
    squared_distance = np.sum((place[:, None] - place) ** 2, axis=2)
    blocked = reach > 1e-12 * squared_distance.max() ** 0.5
    sampled = np.min(squared_distance[blocked] / (2 * reach[blocked]), initial=np.inf)
    return min(float(sampled), cam.least_hollow_radius)


def follower_on_polygon(outline: ArrayLike, follower: Follower, angle: ArrayLike) -> Array:
    """Compute the distance rho [m] of a follower from the axis of a polygon, shape (n, 2) [m], at cam angles [rad].

    The vertices are counterclockwise; rho is -inf where the follower touches no edge.

    Examples
    --------
    >>> square = np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    >>> follower_on_polygon(square, FlatFace(), np.array([0.0, np.pi / 4])).round(6).tolist()
    [1.0, 1.414214]
    """
    outline, angle = np.asarray(outline, float), np.asarray(angle, float)
    require_finite(outline=outline, angle=angle)
    order = np.argsort(np.mod(angle, 2 * np.pi))
    rho = np.empty(angle.size)
    for part in np.array_split(order, -(-angle.size // RAYS_PER_SEARCH)):
        rays = np.mod(angle[part], 2 * np.pi)
        if isinstance(follower, FlatFace):
            rho[part] = (outline @ np.array([np.cos(rays), np.sin(rays)])).max(axis=0)
        else:
            rho[part] = _roller(outline, follower.radius, rays)
    return rho


def _angles_between(cam: Cam, low: float, high: float, deviation: float) -> Array:
    """Angles [rad] from `low` to below `high` whose chords move the follower by at most `deviation` [m]."""
    edges = np.linspace(low, high, SPACING_SAMPLES + 1)
    middle = (edges[:-1] + edges[1:]) / 2
    *_, pressure_angle, turn, arc = cam.contact(middle)
    density = np.sqrt(np.abs(turn * arc) / (8 * deviation * np.cos(pressure_angle)))
    count = np.append(0.0, np.cumsum(np.maximum(density, 1 / STEP_LIMIT) * np.diff(edges)))
    chords = int(np.ceil(count[-1]))
    return np.interp(np.linspace(0, count[-1], chords, endpoint=False), count, edges)


def _offset_points(cam: Cam, angle: Array, distance: float) -> Array:
    """Points `distance` [m] outside the profile, rounded, shape (n, 2)."""
    return np.round((cam.profile(angle) + distance * _normal(cam, angle)).T, DECIMALS)


def _normal(cam: Cam, angle: Array) -> Array:
    """Outward unit normal of the profile in the frame of the cam, shape (2, n)."""
    direction = angle - cam.contact(angle).pressure_angle
    return np.array([np.cos(direction), np.sin(direction)])


def _roller(outline, r, angle):
    """Largest rho of a roller on any edge or vertex near the rays, whose angles ascend."""
    start, edge = outline, np.roll(outline, -1, axis=0) - outline
    middle, spread = (angle[0] + angle[-1]) / 2, (angle[-1] - angle[0]) / 2
    across = start[:, 1] * np.cos(middle) - start[:, 0] * np.sin(middle)
    near = np.abs(across) <= r + np.hypot(*edge.T).max() + spread * np.hypot(*start.T).max()
    start, edge = start[near], edge[near]
    length = np.hypot(*edge.T)
    tangent = edge / length[:, None]
    u = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([tangent[:, 1], -tangent[:, 0]]).T
    cosine = normal @ u
    with np.errstate(divide="ignore", invalid="ignore"):
        on_edge = (r + np.sum(start * normal, axis=1))[:, None] / cosine
        foot = on_edge * (tangent @ u) - np.sum(start * tangent, axis=1)[:, None]
    touches = (cosine > 0) & (foot >= 0) & (foot <= length[:, None])
    across = np.outer(start[:, 1], u[0]) - np.outer(start[:, 0], u[1])
    on_vertex = start @ u + np.sqrt(np.maximum(r**2 - across**2, 0.0))
    on_edge, on_vertex = np.where(touches, on_edge, -np.inf), np.where(np.abs(across) <= r, on_vertex, -np.inf)
    return np.maximum(on_edge.max(axis=0), on_vertex.max(axis=0))
