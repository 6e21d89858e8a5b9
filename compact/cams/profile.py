"""The cam that makes a motion there and back, one turn a cycle.

    phi = 2 pi t/period,  rho(phi) = b/2 + x(t) - stroke/2,  rho(phi) + rho(phi + pi) = b

b is the breadth, rho what the follower follows: the radius to a point or to a roller's centre, or the distance to a
flat face. The breadth is constant where the way back mirrors the way out and the two dwells are equal: see
`breadth_error`.
A point of the profile lies `radial` along the follower's travel and `offset` across it, in the frame of the cam:

    radial (cos phi, sin phi) + offset (-sin phi, cos phi)

Along phi the profile turns by `turn` dphi over an arc of `arc` dphi: its curvature is turn/arc, convex > 0, and where
arc <= 0 it would run backwards: the cutter that makes one part removes another, and the cam is undercut.
Angles in rad, lengths in m; primes are derivatives by phi, exact from the law; at a join the value just after it holds.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from compact.cams.followers import FlatFace, Pointed, RollerFollower
from compact.motion.profile import Cycle
from compact.numerics.piecewise import BREAK_OFFSET, find_maximum, interior_grid
from compact.numerics.validation import require_at_most, require_between, require_finite, require_positive

MOST_POINTS = 1_000_000  # [-], of a table: a step of a micrometre round a cam of 0.3 m

__all__ = [
    "Cam",
    "FlatFace",
    "LeastBreadth",
    "Pointed",
    "RollerFollower",
    "Stepper",
    "Table",
    "breadth_for_pressure_angle",
    "least_breadth",
    "stepper",
]

AXIS = "the axis must lie inside the profile"
ARC = "the profile must not run backwards"
FLANKS = "the flanks of the lobe must not cross"
EVEN_SAMPLES = 361  # of the breadth, which is constant or plainly not
SAMPLES = 2000  # a leg, where flanks may cross: least breadth then within 4e-7 of the stroke (against 32000)


@dataclass(frozen=True)
class LeastBreadth:
    """A cam must be broader than `breadth` [m], infinite if none will do; `rule` says why, `angle` [rad] where.

    The angle is nan where the lobe as a whole is too thin.
    """

    breadth: float
    angle: float
    rule: str


class Table(NamedTuple):
    """Names with units, and as many columns, ndarray of shape (names, rows)."""

    header: tuple
    columns: np.ndarray

    def rows(self):
        """The columns as rows of numbers."""
        return self.columns.T.tolist()


def least_breadth(cycle, follower):
    """`LeastBreadth` that a cam must exceed so that its profile holds the axis and does not run backwards.

        pointed    b > stroke
        roller     b > stroke + 2 max(r, rho_g - x), rho_g the pitch radius of curvature r (see `base_radius`)
        flat face  b > max(stroke, 2 max(stroke/2 - x - x''))

    over both passes and both sides of every join. Every broader cam will do. Where the velocity jumps down no roller
    and no flat face can follow; upwards the profile gets a round hollow (roller) or a flat (flat face). A law and
    its mirror image always jump both ways. After a long near dwell the lobe may be thinner than the roller asks:
    where the flanks would cross, b is bisected on dense samples (to about 1e-6 of the stroke, elsewhere to rounding).

    References
    ----------
    Monograph D, cams of laws 2.1-4.4; the flat-faced ones with the law as support function (reference/errata.md).

    >>> from compact.motion.profile import law
    >>> least = least_breadth(Cycle(law("combined-4", stroke=0.4, duration=3.0)), FlatFace())
    >>> f"{least.breadth / 0.4:.3f}: {least.rule}"
    '1.964: the profile must not run backwards'
    >>> least_breadth(Cycle(law("constant-velocity", stroke=0.4, duration=3.0)), FlatFace()).breadth
    inf
    """
    stroke = cycle.there.stroke
    drop = next((join for join in _velocity_jumps(cycle) if join.after < join.before), None)
    if drop is not None and follower.radius_at_kink < 0:
        angle = _to_angle(cycle, drop.time)
        rule = f"impossible: the velocity drops by {drop.before - drop.after:.4g} m/s at the angle {angle:.4g} rad"
        return LeastBreadth(np.inf, angle, rule)
    base, angle = _largest(cycle, lambda _, x, slope, second: follower.base_radius(x, slope, second))
    axis = getattr(follower, "radius", 0.0)
    rule = ARC if base > axis + 1e-12 * stroke else AXIS
    if isinstance(follower, RollerFollower):
        thicker = _uncrossed(cycle, follower, base)
        base, angle, rule = (thicker, np.nan, FLANKS) if thicker > base else (base, angle, rule)
    return LeastBreadth(stroke + 2 * base, angle, rule)


def breadth_for_pressure_angle(cycle, follower, limit):
    """Breadth [m] from which on the pressure angle keeps within `limit` [rad]; that of a flat face is always zero.

    tan(limit) = |x'|/rho:  b = stroke + 2 max(|x'|/tan(limit) - x, 0)
    """
    require_between(1e-3, 1.57, limit=limit)
    stroke = cycle.there.stroke
    if isinstance(follower, FlatFace):
        return stroke
    steep = np.tan(limit)
    return stroke + 2 * max(_largest(cycle, lambda _, x, slope, second: np.abs(slope) / steep - x)[0], 0.0)


@dataclass(frozen=True)
class Cam:
    """The cam of a `breadth` b [m] > stroke that moves a `follower` through a `Cycle`.

    An undercut cam can be made and drawn; `undercut` says so and `least_breadth` what would do.

    >>> from compact.motion.profile import law
    >>> cam = Cam(Cycle(law("harmonic", stroke=0.4, duration=3.0)), breadth=1.0, follower=FlatFace())
    >>> cam.radius_of_curvature([0.0, 1.0, 4.0]).round(12).tolist()  # an eccentric circle
    [0.5, 0.5, 0.5]
    """

    cycle: Cycle
    breadth: float
    follower: Pointed | RollerFollower | FlatFace

    def __post_init__(self):
        require_positive(breadth=self.breadth)
        stroke = self.cycle.there.stroke
        if not self.breadth > stroke:
            raise ValueError(
                f"`breadth` must be greater than the stroke, got {self.breadth:g} m for {stroke:g} m; "
                "the axis would lie outside the cam: give more than `least_breadth`"
            )

    def derivative(self, angle, order):
        """Derivative by phi of order 0, 1, 2 … of rho [m] at angle [rad], any shape."""
        require_finite(angle=angle)
        radians = self.cycle.period / (2 * np.pi)
        value = radians**order * self.cycle.derivative(self._after_join(angle), order)
        return value + (self.breadth - self.cycle.there.stroke) / 2 if order == 0 else value

    def radius(self, angle):
        """The law rho [m]: polar radius of a point or of the roller's centre, distance of a flat face."""
        return self.derivative(angle, 0)

    def profile(self, angle):
        """Points (x, y) of the profile [m] in the frame of the cam, ndarray of shape (2, n)."""
        angle = np.atleast_1d(np.asarray(angle, float))
        radial, offset = self.follower.contact(self.derivative(angle, 0), self.derivative(angle, 1))
        cos, sin = np.cos(angle), np.sin(angle)
        return np.array([radial * cos - offset * sin, radial * sin + offset * cos])

    def contact_offset(self, angle):
        """Distance [m] of the contact from the follower's line of travel; of a flat face rho'."""
        return self.follower.contact(self.derivative(angle, 0), self.derivative(angle, 1))[1]

    def rates(self, angle):
        """Turn [-] and arc [m] of the profile by phi."""
        return self.follower.rates(*(self.derivative(angle, order) for order in range(3)))

    def curvature(self, angle):
        """Curvature of the profile [1/m], convex > 0."""
        turn, arc = self.rates(angle)
        with np.errstate(divide="ignore"):
            return turn / arc

    def radius_of_curvature(self, angle):
        """Radius of curvature of the profile [m], convex > 0, infinite where it is straight."""
        turn, arc = self.rates(angle)
        with np.errstate(divide="ignore"):
            return arc / turn

    def pressure_angle(self, angle):
        """Angle [rad] between the follower's travel and the common normal, > 0 on the way out."""
        return self.follower.pressure_angle(self.derivative(angle, 0), self.derivative(angle, 1))

    @cached_property
    def kinks(self):
        """Angles [rad] where the velocity jumps: corners of the path of a point or of a roller's centre."""
        return tuple(_to_angle(self.cycle, join.time) for join in _velocity_jumps(self.cycle))

    @cached_property
    def joins(self):
        """Angles [rad] in [0, 2 pi) where pieces of the law and dwells meet, rising."""
        angles = np.unique([_to_angle(self.cycle, time) for time in self._breaks])
        distinct = angles[np.append(True, np.diff(angles) > 1e-9)]
        return tuple(distinct[distinct < 2 * np.pi - 1e-9].tolist())

    @cached_property
    def breadth_error(self):
        """Largest |rho(phi) + rho(phi + pi) - b| [m]: rounding if the breadth is constant."""

        def error(angle, *_):
            return np.abs(self.radius(angle) + self.radius(angle + np.pi) - self.breadth)

        sampled = float(error(np.linspace(0, np.pi, EVEN_SAMPLES)).max())
        return sampled if sampled < 1e-12 * self.breadth else _largest(self.cycle, error)[0]

    @cached_property
    def least_radius_of_curvature(self):
        """Least radius [m] of the convex parts; <= 0 where they are undercut, 0 at a pointed follower's corner."""

        def depth(_, *travel):
            turn, arc = self.follower.rates(*self._raised(*travel))
            return -np.divide(arc, turn, out=np.full_like(arc, np.inf), where=turn > 0)

        least = -_largest(self.cycle, depth)[0]
        return min(least, self.follower.radius_at_kink) if self._drops else least

    @cached_property
    def least_hollow_radius(self):
        """Least radius [m] of the concave parts, which a cutter must not exceed; infinite where there are none."""

        def depth(_, *travel):
            turn, arc = self.follower.rates(*self._raised(*travel))
            return -np.divide(arc, -turn, out=np.full_like(arc, np.inf), where=turn < 0)

        return -_largest(self.cycle, depth)[0]

    @cached_property
    def largest_pressure_angle(self):
        """Largest |pressure angle| [rad] of the turn, both sides of every join."""
        return _largest(self.cycle, lambda _, *t: np.abs(self.follower.pressure_angle(*self._raised(*t)[:2])))[0]

    @cached_property
    def largest_contact_offset(self):
        """Largest distance [m] of the contact from the line of travel: the half-width that a flat face needs."""
        return _largest(self.cycle, lambda _, *t: np.abs(self.follower.contact(*self._raised(*t)[:2])[1]))[0]

    @cached_property
    def undercut(self):
        """Whether the profile runs backwards, crosses itself or, of a roller, reaches the axis; see `least_breadth`."""
        if self._drops and self.follower.radius_at_kink < 0:
            return True
        if isinstance(self.follower, RollerFollower):
            angle, *travel = _dense(self.cycle)
            rho, slope, _ = self._raised(*travel)
            if rho.min() <= self.follower.radius or self.follower.flanks_cross(angle, rho, slope):
                return True
        return bool(_largest(self.cycle, lambda _, *t: -self.follower.rates(*self._raised(*t))[1])[0] >= 0)

    def least_breadth(self):
        """`LeastBreadth` of this cycle and follower."""
        return self._least_breadth

    @cached_property
    def _least_breadth(self):
        return least_breadth(self.cycle, self.follower)

    def table(self, points):
        """`Table` of the cam over a closed turn: at least `points` >= 2 equal steps' ends, and every join.

        Angles rise strictly from 0 to 2 pi; an end of a step closer than 1e-9 rad to a join gives way to it.
        """
        if not points >= 2:
            raise ValueError(f"`points` must be at least 2, got {points!r}")
        require_at_most(MOST_POINTS, "steps below a micrometre cut nothing", points=points)
        joins = np.array(self.joins)
        grid = np.linspace(0, 2 * np.pi, points)
        angle = np.sort(np.append(grid[np.abs(grid[:, None] - joins).min(axis=1) > 1e-9], joins))
        angle = angle[np.append(True, np.diff(angle) > 1e-9)]
        names = ("angle_rad", "radius_m", "x_m", "y_m", "pressure_angle_rad", "curvature_per_m", "contact_offset_m")
        quantities = (self.pressure_angle, self.curvature, self.contact_offset)
        columns = [angle, self.radius(angle), *self.profile(angle), *(quantity(angle) for quantity in quantities)]
        return Table(names, np.array(columns))

    @property
    def _drops(self):
        return any(join.after < join.before for join in _velocity_jumps(self.cycle))

    @cached_property
    def _breaks(self):
        return np.unique(np.concatenate([leg.start + leg.duration * leg.joined_at() for leg in self.cycle.legs()]))

    def _after_join(self, angle):
        """Time [s] in the cycle at angle; what rounding may have put before a join is put after it."""
        period = self.cycle.period
        time = np.mod(np.asarray(angle, float) / (2 * np.pi), 1.0) * period
        join = self._breaks[np.abs(time[..., None] - self._breaks).argmin(axis=-1)]
        return np.where(np.abs(time - join) <= BREAK_OFFSET * period, join + BREAK_OFFSET * period, time)

    def _raised(self, x, slope, second):
        """rho, rho', rho'' from the travel."""
        return x + (self.breadth - self.cycle.there.stroke) / 2, slope, second


@dataclass(frozen=True)
class Stepper:
    """Turn of a roller: `angle` [rad], `angular_velocity` [rad/s], `_acceleration` [rad/s^2], `_jerk` [rad/s^3]."""

    time: np.ndarray
    angle: np.ndarray
    angular_velocity: np.ndarray
    angular_acceleration: np.ndarray
    angular_jerk: np.ndarray


def stepper(cycle, roller_radius, time):
    """What a stepper motor inside a roller of radius R [m] must do at time [s] of the cycle to roll without slip.

        angle = x/R, angular velocity = v/R, and so on

    References
    ----------
    Paper B, eqs (44)-(52), with the signs and the scale of reference/errata.md B-7, B-8.

    >>> from compact.motion.profile import law
    >>> turn = stepper(Cycle(law("reversal-4-free-both", 0.4, 3.0)), roller_radius=0.11, time=[1.5, 4.5])
    >>> turn.angular_velocity.round(4).tolist()
    [1.3531, -1.3531]
    """
    require_positive(roller_radius=roller_radius)
    time = np.asarray(time, float)
    return Stepper(time, *(cycle.derivative(time, order) / roller_radius for order in range(4)))


def _velocity_jumps(cycle):
    return [join for join in cycle.joins() if join.order == 1]


def _to_angle(cycle, time):
    return float(2 * np.pi * (time / cycle.period))


def _largest(cycle, measure):
    """Largest `measure(phi, x, x', x'')` of the turn and its angle, both sides of every join."""
    best = (-np.inf, 0.0)
    for leg in cycle.legs():

        def along(z, leg=leg):
            return measure(_angle_in(cycle, leg, z), *_travel(cycle, leg, z))

        value, z = find_maximum(along, interior_grid(leg.joined_at()))
        if value > best[0]:
            best = (value, float(_angle_in(cycle, leg, z)))
    return best


def _angle_in(cycle, leg, z):
    return 2 * np.pi * (leg.start + leg.duration * z) / cycle.period


def _uncrossed(cycle, follower, base):
    """Least (b - stroke)/2 [m] from `base` on where no flanks cross, between it and where rho^2/w > r all round."""

    def crossed(base):
        return follower.flanks_cross(angle, base + x, slope)

    def seen_whole(_, x, slope, second):
        r = follower.radius
        return np.sqrt((r**2 + r * np.hypot(r, 2 * slope)) / 2) - x

    angle, x, slope, _ = _dense(cycle)
    if not crossed(base * (1 + 1e-9)):
        return base
    low, high = base, _largest(cycle, seen_whole)[0]
    while high - low > 1e-12 * (high + cycle.there.stroke):
        middle = (low + high) / 2
        low, high = (middle, high) if crossed(middle) else (low, middle)
    return high


def _dense(cycle):
    """Angle, x, x', x'' on dense samples of every leg."""
    z = np.linspace(BREAK_OFFSET, 1 - BREAK_OFFSET, SAMPLES)
    legs = [(_angle_in(cycle, leg, z), *_travel(cycle, leg, z)) for leg in cycle.legs()]
    return tuple(np.concatenate(column) for column in zip(*legs, strict=True))


def _travel(cycle, leg, z):
    """x, x', x'' [m] at phase z of a leg; taken there, not from the time, so that a join keeps its sides."""
    radians = cycle.period / (2 * np.pi)
    return tuple(radians**order * leg.at_phase(z, order) for order in range(3))
