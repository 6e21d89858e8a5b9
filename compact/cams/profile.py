"""Profile of a disc cam that drives a cycle, one turn of the cam a cycle.

    phi = 2 pi t/period,  rho(phi) = b/2 + x(t) - stroke/2,  rho(phi) + rho(phi + pi) = b

b is the breadth, rho the distance of the follower from the axis: of its point, its roller centre or its flat face. The
breadth is constant if the return stroke is the mirror image of the forward stroke and both dwells are equal, see
`Cam.breadth_error`. A point of the profile lies `radial` along the follower's travel and `offset` across it, in the
frame of the cam:

    radial (cos phi, sin phi) + offset (-sin phi, cos phi)

Over dphi the tangent of the profile turns by `turn` dphi along an arc of `arc` dphi: its curvature is turn/arc, convex
> 0. Where arc <= 0 the profile runs backwards: the cutter of one part removes another, the cam is undercut. Angles in
rad, lengths in m; primes are derivatives by phi, exact from the law, right limits at a breakpoint.

A follower is a point, a roller or a flat face. From rho, rho' and rho'' it computes its `FollowerContact`, and the
increase of rho required so that no part of the profile runs backwards.

References
----------
R. L. Norton, Cam Design and Manufacturing Handbook, Industrial Press 2009, ch. 7 (size, pressure angle, undercut).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from operator import itemgetter
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.motion.profile import Cycle, Discontinuity, Leg
from compact.numerics import Array, validation
from compact.numerics.piecewise import BREAK_OFFSET, find_maximum, interior_grid

Measure = Callable[..., Array]  # of phi [rad] and the travel x, x', x'' by phi [m]

SHARED_CYCLES = 64  # [-], whose samples the cams of different followers share
LEG_SAMPLES = 2000  # [-], for crossing flanks: least breadth within 4e-7 of the stroke (compared with 32000)
ANGLE_TOLERANCE = 1e-9  # [rad], between distinct breakpoints
LENGTH_ROUNDING = 1e-12  # [-], of the length
AXIS = "the axis must lie inside the profile"
ARC = "the profile must not run backwards"
FLANKS = "the flanks of the lobe must not cross"
NEWTON_TOLERANCE = 16 * np.finfo(float).eps  # [-], of rho: change of the last step
NEWTON_LIMIT = 100  # [-], steps to rounding: 10-25 are usual, a double root needs 50


class FollowerContact(NamedTuple):
    """Contact of a follower with its cam, arrays over angles.

    Attributes
    ----------
    radial, offset : ndarray
        Place of the contact along and across the follower's travel [m]; a flat face must extend to the largest offset.
    pressure_angle : ndarray
        Angle between travel and common normal [rad], > 0 on the forward stroke.
    turn, arc : ndarray
        Direction [-] and length [m] of the profile by phi.
    """

    radial: Array
    offset: Array
    pressure_angle: Array
    turn: Array
    arc: Array

    @property
    def curvature(self) -> Array:
        """Curvature of the profile [1/m], convex > 0."""
        with np.errstate(divide="ignore"):
            return self.turn / self.arc

    def place(self, angle: Array) -> Array:
        """Return the points (x, y) at the angles of the contact [rad] in the frame of the cam [m], shape (2, n)."""
        cos, sin = np.cos(angle), np.sin(angle)
        return np.array([self.radial * cos - self.offset * sin, self.radial * sin + self.offset * cos])


@dataclass(frozen=True)
class _RadialFollower:
    """Point or roller on a line through the axis; its centre traces the pitch curve rho(phi).

        w^2 = rho^2 + rho'^2,  turn = (rho^2 + 2 rho'^2 - rho rho'')/w^2,  arc = w - r turn

    The profile is the pitch curve offset inwards by the roller radius r along its normal (rho, -rho')/w.
    """

    radius: float
    name: ClassVar[str]

    @property
    def words(self) -> str:
        """Both followers of a cam, in words."""
        return f"rollers of radius {1e3 * self.radius:g} mm" if self.radius else "pointed followers"

    @property
    def radius_at_kink(self) -> float:
        """Radius of curvature [m] at a downward jump of rho': a corner of the pitch curve, offset by r."""
        return -self.radius

    def contact(self, rho: Array, slope: Array, second: Array) -> FollowerContact:
        """Return the contact from rho, rho' and rho'' [m]."""
        r, w = self.radius, np.hypot(rho, slope)
        turn = 1 + (slope**2 - rho * second) / w**2
        return FollowerContact(rho - r * rho / w, r * slope / w, np.arctan2(slope, rho), turn, w - r * turn)

    def base_radius(self, x: Array, slope: Array, second: Array) -> Array:
        """Return the smallest (b - stroke)/2 [m] whose profile does not run backwards.

            g(rho) = w^3 - r (rho^2 + 2 rho'^2 - rho rho'') = 0,  its largest root with rho >= r, minus x

        g is convex for rho >= r and positive from 4r/3 + |rho''| on, so that Newton's method descends monotonically
        from there to the largest root; without a root, rho = r and the axis lies on the profile.

        Parameters
        ----------
        x, slope, second : ndarray
            Travel and its derivatives by phi [m].
        """
        r, rho = self.radius, 4 * self.radius / 3 + np.abs(second)
        for _ in range(NEWTON_LIMIT):
            w = np.hypot(rho, slope)
            g = w**3 - r * (w**2 + slope**2 - rho * second)
            derivative = 3 * rho * w - r * (2 * rho - second)
            step = np.divide(g, derivative, out=np.full_like(rho, np.inf), where=derivative > 0)
            lower = np.maximum(rho - step, r)
            if np.all(np.abs(lower - rho) <= NEWTON_TOLERANCE * rho):
                break
            rho = lower
        return rho - x


@dataclass(frozen=True)
class Pointed(_RadialFollower):
    """Knife-edge follower: the profile is the pitch curve itself, corners at velocity jumps included.

    Attributes
    ----------
    radius : float
        0 [m].
    """

    radius: float = field(default=0.0, init=False)
    name = "pointed"

    def base_radius(self, x: Array, slope: Array, second: Array) -> Array:  # noqa: ARG002, protocol of followers
        """Return the smallest (b - stroke)/2 [m]: any value with rho > 0 is valid."""
        return -x


@dataclass(frozen=True)
class RollerFollower(_RadialFollower):
    """Roller follower on a line through the axis.

    Attributes
    ----------
    radius : float
        Roller radius r [m], > 0.
    """

    name = "roller"

    def __post_init__(self) -> None:
        validation.require_positive(radius=self.radius)

    def flanks_cross(self, angle: Array, rho: Array, slope: Array) -> bool:
        """Return True if a point of the profile is nearer than r to another part of the pitch curve rho(angle) [m].

        This is excluded where rho^2/w > r all round: the whole profile is then visible from the axis.
        """
        outwards = rho**2 / np.hypot(rho, slope)
        if np.min(outwards) > self.radius:
            return False
        from scipy.spatial import cKDTree

        near = outwards < 2 * self.radius  # flanks meet where it is the radius
        profile = self.contact(rho, slope, slope).place(angle)[:, near].T
        pitch = (rho * np.array([np.cos(angle), np.sin(angle)])).T
        rounding = 1e-9 * self.radius + 1e-12 * np.max(rho)
        return bool(cKDTree(pitch).query(profile)[0].min() < self.radius - rounding)


@dataclass(frozen=True)
class FlatFace:
    """Flat-faced follower at right angles to its travel: the law is the support function of the profile.

    (x, y) = (rho cos - rho' sin, rho sin + rho' cos),  turn = 1,  arc = rho + rho''
    """

    name, words = "flat", "flat-faced followers"
    radius = 0.0
    radius_at_kink = -np.inf

    def contact(self, rho: Array, slope: Array, second: Array) -> FollowerContact:
        """Return the contact from rho, rho' and rho'' [m]; the normal of the face is the direction of travel."""
        return FollowerContact(rho, slope, np.zeros(np.shape(rho)), np.ones(np.shape(rho)), rho + second)

    def base_radius(self, x: Array, slope: Array, second: Array) -> Array:  # noqa: ARG002
        """Return the smallest (b - stroke)/2 [m] with rho + rho'' >= 0 and rho >= 0."""
        return np.maximum(-x - second, 0.0)


Follower = Pointed | RollerFollower | FlatFace
FOLLOWERS: Mapping[str, Callable[[float], Follower]] = {  # by name, of the radius of rollers [m]
    "pointed": lambda _: Pointed(), "roller": RollerFollower, "flat": lambda _: FlatFace(),
}  # fmt: skip


@dataclass(frozen=True)
class LeastBreadth:
    """Breadth that a cam must exceed.

    Attributes
    ----------
    breadth : float
        Limit of the breadth [m]; infinite if no cam is possible.
    angle : float
        Cam angle that determines it [rad]; nan where the flanks of the lobe would cross.
    rule : str
        Condition that determines it.
    """

    breadth: float
    angle: float
    rule: str


@lru_cache(maxsize=SHARED_CYCLES)
def least_breadth(cycle: Cycle, follower: Follower) -> LeastBreadth:
    """Compute the breadth that a cam must exceed so that its profile contains the axis and is not undercut.

        pointed    b > stroke
        roller     b > stroke + 2 max(r, rho_g - x), with rho_g of `RollerFollower.base_radius`
        flat face  b > max(stroke, 2 max(stroke/2 - x - x''))

    over both passes and both sides of every breakpoint. Every broader cam is valid. Where the velocity jumps down, no
    roller and no flat face can follow; where it jumps up, the profile has a concave arc (roller) or a straight part
    (flat face). A law and its mirror image always jump both ways. After a long near dwell the lobe may be too thin for
    the roller: b is then bisected on dense samples (to about 1e-6 of the stroke, otherwise to rounding).

    References
    ----------
    Monograph D, cams of laws 2.1-4.4; the flat-faced ones with the law as support function (reference/errata.md).

    Examples
    --------
    >>> from compact.motion.profile import law
    >>> least = least_breadth(Cycle(law("combined-4", stroke=0.4, duration=3.0)), FlatFace())
    >>> f"{least.breadth / 0.4:.3f}: {least.rule}"
    '1.964: the profile must not run backwards'
    >>> least_breadth(Cycle(law("constant-velocity", stroke=0.4, duration=3.0)), FlatFace()).breadth
    inf
    """
    stroke = cycle.forward.stroke
    if (drop := _velocity_drop(cycle)) and follower.radius_at_kink < 0:
        angle = float(_angle(cycle, drop.time))
        rule = f"impossible: the velocity drops by {drop.before - drop.after:.4g} m/s at the angle {angle:.4g} rad"
        return LeastBreadth(np.inf, angle, rule)
    base, angle = _maximum(cycle, lambda _, *travel: follower.base_radius(*travel))
    rule = ARC if base > follower.radius + LENGTH_ROUNDING * stroke else AXIS
    if isinstance(follower, RollerFollower):
        larger = _base_without_crossing(cycle, follower, base)
        base, angle, rule = (larger, np.nan, FLANKS) if larger > base else (base, angle, rule)
    return LeastBreadth(stroke + 2 * base, angle, rule)


@dataclass(frozen=True)
class Cam:
    """Cam of constant breadth that moves a follower through a cycle.

    An undercut cam can be computed and drawn; `undercut` reports it, `least_breadth` the breadth to exceed.

    Attributes
    ----------
    cycle : Cycle
        Motion of the follower.
    breadth : float
        Breadth b [m], > stroke.
    follower : Pointed, RollerFollower or FlatFace

    Examples
    --------
    >>> from compact.motion.profile import law
    >>> cam = Cam(Cycle(law("harmonic", stroke=0.4, duration=3.0)), breadth=1.0, follower=FlatFace())
    >>> cam.curvature([0.0, 1.0, 4.0]).round(12).tolist()  # an eccentric circle
    [2.0, 2.0, 2.0]
    """

    cycle: Cycle
    breadth: float
    follower: Follower

    def __post_init__(self) -> None:
        validation.require_number(breadth=self.breadth)
        validation.require_positive(breadth=self.breadth)
        validation.require_instance(Cycle, "the Cycle of a motion law", cycle=self.cycle)
        validation.require_instance(Follower, "a follower", follower=self.follower)
        stroke = self.cycle.forward.stroke
        if not self.breadth > stroke:
            raise ValueError(
                f"`breadth` must be greater than the stroke, got {self.breadth:g} m for {stroke:g} m; "
                "the axis would lie outside the cam: set more than `least_breadth`"
            )

    def derivative(self, angle: ArrayLike, order: int) -> Array:
        """Return the derivative of rho with respect to phi [m] at angles phi [rad] of any shape."""
        return self._derivatives(angle, order)[0]

    def _derivatives(self, angle: ArrayLike, *orders: int) -> list[Array]:
        validation.require_finite(angle=angle)
        period = self.cycle.period
        time = np.mod(np.asarray(angle, float) / (2 * np.pi), 1.0) * period
        nearest = self._break_times[np.searchsorted((self._break_times[1:] + self._break_times[:-1]) / 2, time)]
        rounding = BREAK_OFFSET * period  # a time that it placed before a breakpoint is moved behind it
        time = np.where(np.abs(time - nearest) <= rounding, nearest + rounding, time)
        values = [(period / (2 * np.pi)) ** order * self.cycle.derivative(time, order) for order in orders]
        return [value if order else value + self._base for order, value in zip(orders, values, strict=True)]

    def radius(self, angle: ArrayLike) -> Array:
        """Return rho [m] at an angle [rad]: radius to the point or roller centre, or distance of the flat face."""
        return self.derivative(angle, 0)

    def contact(self, angle: ArrayLike) -> FollowerContact:
        """Return the contact of the follower at angles [rad] of any shape."""
        return self.follower.contact(*self._derivatives(angle, 0, 1, 2))

    def profile(self, angle: ArrayLike) -> Array:
        """Return the points (x, y) of the profile [m] at angles [rad] in the frame of the cam, shape (2, n)."""
        angle = np.atleast_1d(np.asarray(angle, float))
        return self.contact(angle).place(angle)

    def curvature(self, angle: ArrayLike) -> Array:
        """Return the curvature of the profile [1/m] at an angle [rad], convex > 0."""
        return self.contact(angle).curvature

    @cached_property
    def corner_angles(self) -> tuple[float, ...]:
        """Angles [rad] where the velocity jumps: corners of the path of the point or of the roller centre."""
        return tuple(float(_angle(self.cycle, jump.time)) for jump in self.cycle.discontinuities() if jump.order == 1)

    @cached_property
    def breakpoints(self) -> tuple[float, ...]:
        """Angles [rad] in [0, 2 pi) between the pieces of the laws and the dwells, ascending."""
        angles = _angle(self.cycle, self._break_times)
        distinct = angles[np.append(True, np.diff(angles) > ANGLE_TOLERANCE)]
        return tuple(distinct[distinct < 2 * np.pi - ANGLE_TOLERANCE].tolist())

    @property
    def breadth_error(self) -> float:
        """Largest |rho(phi) + rho(phi + pi) - b| [m]: rounding if the breadth is constant."""
        return _breadth_error(self.cycle, self.breadth)

    @cached_property
    def least_radius_of_curvature(self) -> float:
        """Smallest radius [m] of the convex parts; <= 0 if undercut, 0 at a corner of a pointed follower."""
        return min(self._smallest_radius(1), self.follower.radius_at_kink if _velocity_drop(self.cycle) else np.inf)

    @cached_property
    def least_hollow_radius(self) -> float:
        """Smallest radius [m] of the concave parts, the limit of the cutter radius; infinite without concave parts."""
        return self._smallest_radius(-1)

    @cached_property
    def largest_pressure_angle(self) -> float:
        """Largest |pressure angle| [rad] over the turn, both sides of every breakpoint."""
        return self._largest(lambda contact: np.abs(contact.pressure_angle))

    @cached_property
    def largest_contact_offset(self) -> float:
        """Largest distance [m] of the contact from the line of travel: required half-width of a flat face."""
        return self._largest(lambda contact: np.abs(contact.offset))

    @property
    def undercut(self) -> bool:
        """True if the profile runs backwards, crosses itself or, for a roller, reaches the axis: `least_breadth`."""
        return self.breadth <= self.least_breadth().breadth

    def least_breadth(self) -> LeastBreadth:
        """Return the `LeastBreadth` of this cycle and follower."""
        return least_breadth(self.cycle, self.follower)

    def table(self, points: int) -> dict[str, Array]:
        """Return columns by name over a closed turn, at equal steps between `points` angles from 0 to 2 pi."""
        angle = np.linspace(0, 2 * np.pi, points)
        derivatives = self._derivatives(angle, 0, 1, 2)
        contact = self.follower.contact(*derivatives)
        x, y = contact.place(angle)
        return {
            "angle_rad": angle, "radius_m": derivatives[0], "x_m": x, "y_m": y,
            "pressure_angle_rad": contact.pressure_angle, "curvature_per_m": contact.curvature,
            "contact_offset_m": contact.offset,
        }  # fmt: skip

    @property
    def _base(self):
        """Distance rho [m] at zero travel."""
        return (self.breadth - self.cycle.forward.stroke) / 2

    def _largest(self, measure: Callable[[FollowerContact], Array]) -> float:
        """Largest measure of the contact over the turn, both sides of every breakpoint."""
        return _maximum(self.cycle, lambda _, x, *slopes: measure(self.follower.contact(x + self._base, *slopes)))[0]

    def _smallest_radius(self, sign: int) -> float:
        """Smallest |radius of curvature| [m] of the convex (1) or the concave parts (-1), both sides of breakpoints."""

        def negative_radius(contact: FollowerContact) -> Array:
            turn, arc = sign * contact.turn, contact.arc
            return -np.divide(arc, turn, out=np.full_like(arc, np.inf), where=turn > 0)

        return -self._largest(negative_radius)

    @cached_property
    def _break_times(self):
        return np.unique(np.concatenate([leg.start + leg.duration * leg.breakpoints() for leg in self.cycle.legs()]))


def _velocity_drop(cycle: Cycle) -> Discontinuity | None:
    """First jump of the velocity downwards."""
    return next((jump for jump in cycle.discontinuities() if jump.order == 1 and jump.after < jump.before), None)


@lru_cache(maxsize=SHARED_CYCLES)
def _breadth_error(cycle: Cycle, breadth: float) -> float:
    cam = Cam(cycle, breadth, Pointed())

    def error(z: Array, leg: Leg) -> Array:
        angle = _angle(cycle, leg.start + leg.duration * z)
        here, opposite = cam.radius(np.array([angle, angle + np.pi]))
        return np.abs(here + opposite - breadth)

    return max(find_maximum(partial(error, leg=leg), grid)[0] for leg, grid, _ in _samples(cycle))


def _maximum(cycle: Cycle, measure: Measure) -> tuple[float, float]:
    """Largest `measure(phi, x, x', x'')` over the turn and its angle, both sides of every breakpoint."""

    def along(z: Array, leg: Leg) -> Array:
        return measure(*_travel(cycle, leg, z))

    found = []
    for leg, grid, travel in _samples(cycle):
        value, z = find_maximum(partial(along, leg=leg), grid, measure(*travel))
        found.append((value, float(_angle(cycle, leg.start + leg.duration * z))))
    return max(found, key=itemgetter(0))


@lru_cache(maxsize=SHARED_CYCLES)
def _samples(cycle: Cycle) -> list[tuple[Leg, Array, tuple[Array, ...]]]:
    """Legs of a cycle, the phases of their fine grids, and `_travel` there."""
    grids = [(leg, interior_grid(leg.breakpoints())) for leg in cycle.legs()]
    return [(leg, grid, _travel(cycle, leg, grid)) for leg, grid in grids]


def _travel(cycle: Cycle, leg: Leg, z) -> tuple[Array, ...]:
    """Phi [rad] and x, x', x'' [m] at phase z of a leg, evaluated by phase so that a breakpoint keeps its sides."""
    radians = cycle.period / (2 * np.pi)
    return _angle(cycle, leg.start + leg.duration * z), *(radians**order * leg.at_phase(z, order) for order in range(3))


def _angle(cycle: Cycle, time):
    return 2 * np.pi * time / cycle.period


def _base_without_crossing(cycle: Cycle, follower: RollerFollower, base: float) -> float:
    """Smallest (b - stroke)/2 [m] >= base without crossing flanks; rho^2/w > r all round is sufficient."""
    z = np.linspace(BREAK_OFFSET, 1 - BREAK_OFFSET, LEG_SAMPLES)
    angle, x, slope, _ = np.hstack([_travel(cycle, leg, z) for leg in cycle.legs()])

    def crossed(base: float) -> bool:
        return follower.flanks_cross(angle, base + x, slope)

    def sufficient(_: Array, x: Array, slope: Array, __: Array) -> Array:
        r = follower.radius
        return np.sqrt((r**2 + r * np.hypot(r, 2 * slope)) / 2) - x

    if not crossed(base * (1 + 1e-9)):
        return base
    low, high = base, _maximum(cycle, sufficient)[0]
    while high - low > LENGTH_ROUNDING * (high + cycle.forward.stroke):
        middle = (low + high) / 2
        low, high = (middle, high) if crossed(middle) else (low, middle)
    return high
