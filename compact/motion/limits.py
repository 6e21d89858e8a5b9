"""How curved the cam of a roller may be: what its motion law must keep so that the profile is cut as it is drawn.

    rho = b/2 +- (x - stroke/2),  rho' = +- q x',  rho'' = +- q^2 x'',  q = period/(2 pi),  + there and - back
    kappa = (rho^2 + 2 rho'^2 - rho rho'')/w^3,  w^2 = rho^2 + rho'^2        of the path of the roller's centre

The profile lies a roller's radius r inside that path: its radius of curvature is 1/kappa - r where it is convex and
1/|kappa| + r in a hollow (`cam`). Both are at least R, and nothing is undercut, where

    kappa (r + R) <= 1   and   kappa (r - R) <= 1

at every angle, standing at the near end among them. The larger of the two is the `crowding`.

What a motion law must keep: its share of constant speed, its continuity, and bounds that hold between all nodes.

Every limit is linear in the unknowns of a `lawspace.Space`. A bound is held by Bernstein coefficients, so it holds at
every instant. Bounds that no law can keep together are told one by one: how far each would have to give, the others
kept, by a linear program of its own.

    cam, phi = 2 pi t/period, rho = b/2 +- (x - stroke/2), + there and - back (`compact.cams.profile`):
    pressure angle      |dx/dphi| <= tan(angle) rho           of a pointed or a roller follower
    radius of curvature rho + rho'' >= radius                 of a flat face

That of a roller's cam is not linear: `pitch` has it, and here is only what keeps its flanks apart, w the speed of the
roller's centre along its path: rho^2/w > r all round, that is cos(pressure angle) > r/rho at least.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse

from compact.motion.objectives import Tangent
from compact.motion.spline_space import Space, graded_breaks
from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic
from compact.numerics.validation import require_between, require_known, require_nonnegative, require_positive

MARGIN = 2e-5  # of the crowding, kept free for peaks between the nodes: twice what these may be higher


@dataclass(frozen=True)
class Pitch:
    """The path of a roller's centre on a cam of constant `breadth` [m] that makes a law of a `stroke` [m].

    roller_radius : r [m];  profile_radius : R, the least radius of curvature of the profile [m]
    seconds : q, time in which the cam turns by one radian [s];  stands : whether the cart stands at the ends
    """

    breadth: float
    stroke: float
    roller_radius: float
    profile_radius: float
    seconds: float
    stands: bool

    @property
    def _spans(self):
        """r + R and r - R, shape (2, 1, 1)."""
        r, R = self.roller_radius, self.profile_radius
        return np.array([r + R, r - R])[:, None, None]

    def _ways(self, x, v, a):
        """rho, rho', rho'' there and back, each of shape (2, n), and the sign of the way."""
        sign, q = np.array([[1.0], [-1.0]]), self.seconds
        return self.breadth / 2 + sign * (x - self.stroke / 2), sign * q * v, sign * q**2 * a, sign

    def curvature(self, x, v, a):
        """kappa [1/m] there and back, shape (2, n), where the travel is x [m], x' = v, x'' = a."""
        rho, slope, second, _ = self._ways(x, v, a)
        w = np.hypot(rho, slope)
        return (w**2 + slope**2 - rho * second) / w**3

    def crowding(self, x, v, a):
        """kappa (r + R) and kappa (r - R) there and back, rows of shape (4 or 5, n); none may exceed 1."""
        found = (self._spans * self.curvature(x, v, a)).reshape(4, -1)
        near = (self.breadth - self.stroke) / 2
        return np.vstack([found, np.full(len(x), self._spans.max() / near)]) if self.stands else found

    def crowded(self, nodes, unknowns):
        """The `crowding` of a law at its nodes."""
        return self.crowding(*(rows @ unknowns for rows in (nodes.place, nodes.speed, nodes.change)))

    def reached(self, nodes, unknowns):
        """Largest R [m] that a law keeps with the `MARGIN`, convex or hollow."""
        kappa = self.curvature(*(rows @ unknowns for rows in (nodes.place, nodes.speed, nodes.change)))
        near, room = (self.breadth - self.stroke) / 2, 1 - MARGIN
        convex, hollow = max(kappa.max(), 1 / near if self.stands else -np.inf), -kappa.min()
        return float(
            min(room / convex - self.roller_radius, room / hollow + self.roller_radius if hollow > 0 else np.inf)
        )

    def tangent(self, nodes, unknowns):
        """`Tangent` of the largest crowding."""
        x, v, a = (rows @ unknowns for rows in (nodes.place, nodes.speed, nodes.change))
        rho, slope, second, sign = self._ways(x, v, a)
        w = np.hypot(rho, slope)
        top, q = w**2 + slope**2 - rho * second, self.seconds
        by_place = sign * ((2 * rho - second) / w**3 - 3 * rho * top / w**5)
        by_speed = sign * q * (4 * slope / w**3 - 3 * slope * top / w**5)
        by_change = sign * q**2 * -rho / w**3
        parts = zip((by_place, by_speed, by_change), (nodes.place, nodes.speed, nodes.change), strict=True)
        rows = (self._spans[..., None] * sum(part[..., None] * along for part, along in parts)).reshape(
            -1, len(unknowns)
        )
        values = self.crowding(x, v, a).ravel()
        return Tangent(values, np.vstack([rows, np.zeros((len(values) - len(rows), len(unknowns)))]))

    def excess(self, nodes, unknowns):
        """`Tangent` of what the crowding is above 1, less a `MARGIN`; 0 where it is below."""
        near = self.tangent(nodes, unknowns)
        values, rows = np.append(near.values - (1 - MARGIN), 0.0), np.vstack([near.rows, np.zeros(len(unknowns))])
        return Tangent(values, rows)


TURNS = ("reversal", "dwell")
BOUNDED = {"velocity": (1, "m/s"), "acceleration": (2, "m/s^2"), "jerk": (3, "m/s^3"), "snap": (4, "m/s^4")}
HALVINGS = 2  # of the pieces that a bound is held on: a parabola is then met within 1/16 of its bend
TINY = np.finfo(float).tiny
BROKEN = 1e-9  # relative, beyond which a limit is broken
KEPT = 1e3  # cost of a bound that is to be kept while another gives
STEADY_PIECES = 16  # of the constant speed where it may vary


@dataclass(frozen=True)
class CamLimits:
    """What a cam of constant `breadth` [m] that makes the law must keep; None leaves a bound out.

    pressure_angle : largest, of a pointed or a roller follower [rad], < pi/2
    radius_of_curvature : least, of a flat-faced cam [m]
    dwell : time standing at each end [s]
    profile_radius : least radius of curvature of the profile for a roller [m], convex or hollow; 0 for no undercut
    roller_radius : of that roller [m]
    """

    breadth: float
    pressure_angle: float | None = None
    radius_of_curvature: float | None = None
    dwell: float = 0.0
    profile_radius: float | None = None
    roller_radius: float | None = None

    def __post_init__(self):
        require_positive(breadth=self.breadth)
        require_nonnegative(dwell=self.dwell)
        if self.pressure_angle is not None and not 0 < self.pressure_angle < np.pi / 2:
            raise ValueError(f"`pressure_angle` must lie in (0, pi/2), got {self.pressure_angle!r} rad")
        if self.radius_of_curvature is not None:
            require_nonnegative(radius_of_curvature=self.radius_of_curvature)
        if self.profile_radius is not None:
            if self.roller_radius is None:
                raise ValueError("`profile_radius` is of a cam for a roller: give the `roller_radius` as well")
            require_nonnegative(profile_radius=self.profile_radius)
            require_positive(roller_radius=self.roller_radius)


@dataclass(frozen=True)
class Limits:
    """What a law must keep; None leaves a bound out. All velocities are >= 0: the cart does not turn inside a pass.

    velocity [m/s], acceleration [m/s^2], jerk [m/s^3], snap [m/s^4] : largest magnitudes
    run_up, run_down : shares of the duration before and after the constant speed, > 0, with a sum <= 1; 1 for none
    steady_tolerance : largest deviation there from the mean speed there, relative
    smoothness : the derivatives up to this order are continuous, 1 to 3; a bound on jerk asks for 2, on snap for 3
    turn : what follows at the ends, "reversal" the mirror image at once, "dwell" a stand-still
    at_rest : orders of derivatives, from 2 to smoothness, that vanish at both ends beside the velocity
    cam : `CamLimits` or None
    """

    velocity: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    snap: float | None = None
    run_up: float = 0.5
    run_down: float = 0.5
    steady_tolerance: float = 0.0
    smoothness: int = 1
    turn: str = "reversal"
    at_rest: tuple[int, ...] = ()
    cam: CamLimits | None = None

    def __post_init__(self):
        require_positive(**{name: getattr(self, name) for name in BOUNDED if getattr(self, name) is not None})
        require_positive(run_up=self.run_up, run_down=self.run_down)
        if self.run_up + self.run_down > 1 + 1e-12:
            raise ValueError(f"`run_up` + `run_down` must not exceed 1, got {self.run_up!r} + {self.run_down!r}")
        require_between(0, 1, steady_tolerance=self.steady_tolerance)
        require_known("turn", self.turn, TURNS)
        if self.smoothness not in (1, 2, 3):
            raise ValueError(f"`smoothness` must be 1, 2 or 3, got {self.smoothness!r}")
        if not set(self.at_rest) <= set(range(2, self.continuous + 1)):
            raise ValueError(
                f"`at_rest` takes orders from 2 to the smoothness, {self.continuous}, got {self.at_rest!r}; "
                "a derivative that may jump has no value at the ends: raise `smoothness`"
            )

    @property
    def continuous(self):
        """Order of the highest derivative that is continuous: the smoothness, or what a bound asks for."""
        return max(self.smoothness, 2 * (self.jerk is not None), 3 * (self.snap is not None))

    @property
    def steady(self):
        """Phases between which the speed is constant, or None."""
        return (self.run_up, 1 - self.run_down) if self.run_up + self.run_down < 1 - 1e-12 else None

    def replaced(self, **changes):
        """New limits with some changed."""
        return replace(self, **changes)


class Bound(NamedTuple):
    """rows @ c + offset <= asked, in `unit`: a bound that can give."""

    name: str
    unit: str
    asked: float
    rows: np.ndarray
    offset: np.ndarray

    def needed(self, unknowns):
        """Least value that a law would keep."""
        return float(np.max(self.rows @ unknowns + self.offset))


class Conflict(NamedTuple):
    """A bound that cannot be kept: `asked`, and what it would `need` to be with all others kept, in `unit`."""

    name: str
    unit: str
    asked: float
    needed: float

    def __str__(self):
        return f"{self.name} {self.needed:.6g} {self.unit} for {self.asked:.6g} ({self.needed / self.asked - 1:+.3g})"


class InfeasibleError(ValueError):
    """No law keeps all limits; `conflicts` are the bounds that would have to give, each a `Conflict`.

    `alone` says that each of them by itself would do; otherwise they must give together.
    """

    def __init__(self, conflicts, alone):
        self.conflicts, self.alone = tuple(conflicts), alone
        way = " or ".join(map(str, conflicts)) if alone else " together with ".join(map(str, conflicts))
        super().__init__(f"no law keeps all limits; what would do, the others kept: {way}")


@dataclass(frozen=True, eq=False)
class ConstraintSet:
    """Limits on the laws of a space over a stroke [m] in a duration [s], as a `LinearConstraints` on its unknowns."""

    limits: Limits
    space: Space
    stroke: float
    duration: float

    @cached_property
    def bounds(self):
        """All `Bound`s."""
        found = []
        for name, (order, unit) in BOUNDED.items():
            if (asked := getattr(self.limits, name)) is not None:
                rows = self.stroke / self.duration**order * self.space.hull(order, HALVINGS)
                rows = rows if order == 1 else np.concatenate([rows, -rows])
                found.append(Bound(name, unit, asked, rows, np.zeros(len(rows))))
        return found + (self._cam_bounds(self.limits.cam) if self.limits.cam else [])

    def asking(self, profile_radius):
        """The same limits with another bound on the profile of a roller's cam [m]."""
        cam = replace(self.limits.cam, profile_radius=profile_radius)
        return replace(self, limits=self.limits.replaced(cam=cam))

    @cached_property
    def pitch(self):
        """The `Pitch` of a roller's cam whose profile is bounded, else None."""
        return _pitch(self.limits.cam, self.stroke, self.duration) if self.limits.cam else None

    def _cam_bounds(self, cam):
        """All told by the breadth that they need."""
        found, radians = [], (self.duration + cam.dwell) / np.pi
        angles = {"cam breadth for its pressure angle": cam.pressure_angle}
        if self.pitch:
            angles["cam breadth that keeps its flanks apart"] = _parting(self.pitch)
        for name, angle in angles.items():
            if angle is not None:
                slope = radians / np.tan(angle) * self._lifted(1)
                rows = 2 * np.concatenate([slope - self._lifted(0), slope + self._lifted(0)])
                offset = np.repeat([self.stroke, -self.stroke], len(slope))
                found.append(Bound(name, "m", cam.breadth, rows, offset))
        if cam.radius_of_curvature is not None:
            bend = self._lifted(0) + radians**2 * self._lifted(2)
            rows, radius = 2 * np.concatenate([-bend, bend]), 2 * cam.radius_of_curvature
            offset = radius + np.repeat([self.stroke, -self.stroke], len(bend))
            found.append(Bound("cam breadth for its radius of curvature", "m", cam.breadth, rows, offset))
        return found

    def _lifted(self, order):
        """Bernstein coefficients of the derivative at the degree of s itself: these can be added."""
        rows = self.space.coefficients(order)
        for q in range(rows.shape[1] - 1, self.space.smoothness + 2):
            share = np.arange(1, q + 1)[:, None] / (q + 1)
            inner = share * rows[:, :-1] + (1 - share) * rows[:, 1:]
            rows = np.concatenate([rows[:, :1], inner, rows[:, -1:]], axis=1)
        return self.stroke / self.duration**order * rows.reshape(-1, self.space.size)

    @cached_property
    def program(self):
        """The `LinearConstraints` of all limits."""
        rows = [bound.rows / bound.asked for bound in self.bounds]
        values = [1 - bound.offset / bound.asked for bound in self.bounds]
        return self._with(rows, values)

    def _with(self, rows, values):
        hard, hard_to = self._hard
        below = sparse.csr_array(np.concatenate([hard, *rows]))
        return LinearConstraints(*self._equal, below, np.concatenate([hard_to, *values]))

    @cached_property
    def _equal(self):
        """The stroke, rest at the ends, continuity over the turn, and the constant speed."""
        space, limits = self.space, self.limits
        rows = []
        for order in range(1, limits.continuous + 1):
            first, last = (space.end(z, order) for z in (0, 1))
            stands = order == 1 or order in limits.at_rest or limits.turn == "dwell"
            rows += [first, last] if stands else [first + last]
        if limits.steady and limits.steady_tolerance == 0:
            rows += list(space.coefficients(2)[self._steady_pieces].reshape(-1, space.size))
        rows = np.array([space.end(1, 0)] + [row / np.abs(row).max() for row in rows if np.any(row)])
        return rows, np.append(1.0, np.zeros(len(rows) - 1))

    @cached_property
    def _hard(self):
        """Rows and values of what never gives: no way back inside a pass, and the speed within its tolerance."""
        rows, tolerance = [-self.space.hull(1, HALVINGS)], self.limits.steady_tolerance
        if self.limits.steady and tolerance > 0:
            pieces = self._steady_pieces
            speed = self.space.coefficients(1)[pieces]
            place = self.space.coefficients(0)
            start, end = self.limits.steady
            mean = (place[pieces[-1], -1] - place[pieces[0], 0]) / (end - start)
            speed = np.unique(speed.reshape(-1, self.space.size), axis=0)
            rows += [speed - (1 + tolerance) * mean, (1 - tolerance) * mean - speed]
        rows = np.concatenate(rows)
        return rows, np.zeros(len(rows))

    @property
    def _steady_pieces(self):
        start, end = self.limits.steady
        middle = (self.space.breaks[1:] + self.space.breaks[:-1]) / 2
        return np.flatnonzero((middle > start) & (middle < end))

    @cached_property
    def calmest(self):
        """Unknowns of the law of least rms acceleration: where a search begins.

        Raises InfeasibleError where no law keeps the limits.
        """
        together = self._giving(np.ones(len(self.bounds)))
        if together:
            alone = [self._alone(i) for i in range(len(self.bounds))]
            single = [conflict for conflict in alone if conflict]
            raise InfeasibleError(single or together, alone=bool(single))
        u, weights = np.polynomial.legendre.leggauss(self.space.smoothness + 1)
        weights = np.outer(np.diff(self.space.breaks), weights / 2).ravel()
        rows = self.space.values(2, (u + 1) / 2) * np.sqrt(weights)[:, None]
        return minimise_quadratic(rows.T @ rows, np.zeros(self.space.size), self.program)

    def closed(self, unknowns):
        """The unknowns with stroke, rest and continuity kept to rounding, and all bounds, where a program left 1e-10.

        The excess over a bound is removed by a step as small towards the innermost law.
        """
        equal, equal_to, *_ = self.program
        unknowns = unknowns + np.linalg.lstsq(equal, equal_to - equal @ unknowns, rcond=None)[0]
        more = self._excess(unknowns)
        room = -self._excess(self.innermost) if more > BROKEN / 2 else 0.0
        return unknowns + more / (more + room) * (self.innermost - unknowns) if room > 0 else unknowns

    def _excess(self, unknowns):
        """Largest relative excess over any bound; negative is the room left."""
        return max((bound.needed(unknowns) / bound.asked - 1 for bound in self.bounds), default=-np.inf)

    @cached_property
    def innermost(self):
        """Unknowns of a law with the largest relative distance from the nearest bound."""
        program = self._with([], [])
        rows = np.concatenate([bound.rows / bound.asked for bound in self.bounds])
        below = np.concatenate([program.inequality_matrix.toarray(), rows])
        margin = np.repeat([0.0, 1.0], [program.inequality_matrix.shape[0], len(rows)])
        values = [program.inequality_bounds, *(1 - bound.offset / bound.asked for bound in self.bounds)]
        wider = LinearConstraints(
            np.column_stack([program.equality_matrix, np.zeros(len(program.equality_matrix))]),
            program.equality_values,
            np.column_stack([below, margin]),
            np.concatenate(values),
        )
        return minimise_linear(np.append(np.zeros(self.space.size), -1.0), wider)[: self.space.size]

    def _alone(self, i):
        """The `Conflict` of bound i that gives alone, or None where that does not suffice."""
        costs = np.full(len(self.bounds), KEPT)
        costs[i] = 1.0
        given = self._giving(costs)
        return given[0] if [conflict.name for conflict in given] == [self.bounds[i].name] else None

    def _giving(self, costs):
        """A `Conflict` of each bound that gives, where the sum of costs times relative violations is least."""
        count, program = len(self.bounds), self._with([], [])
        give = np.eye(count)
        rows = [
            program.inequality_matrix.toarray(),
            np.zeros((count, self.space.size)),
            *(b.rows / b.asked for b in self.bounds),
        ]
        given = [np.zeros((rows[0].shape[0], count)), -give]
        given += [np.tile(-give[i], (len(bound.rows), 1)) for i, bound in enumerate(self.bounds)]
        values = [
            program.inequality_bounds,
            np.zeros(count),
            *(1 - bound.offset / bound.asked for bound in self.bounds),
        ]
        elastic = LinearConstraints(
            np.column_stack([program.equality_matrix, np.zeros((len(program.equality_matrix), count))]),
            program.equality_values,
            np.column_stack([np.concatenate(rows), np.concatenate(given)]),
            np.concatenate(values),
        )
        found = minimise_linear(np.concatenate([np.zeros(self.space.size), costs]), elastic)
        if found is None:
            raise RuntimeError("no law at all on these pieces: raise `pieces`, or lower the smoothness")
        pairs = zip(self.bounds, found[self.space.size :], strict=True)
        return [Conflict(b.name, b.unit, b.asked, (1 + float(more)) * b.asked) for b, more in pairs if more > BROKEN]


def _pitch(cam, stroke, duration):
    """The `Pitch` of `CamLimits`, or None; ValueError for a cam too narrow to have its axis inside."""
    if cam.profile_radius is None:
        return None
    least = stroke + 2 * cam.roller_radius
    if cam.breadth <= least:
        raise ValueError(f"`breadth` must exceed {least:g} m, the stroke and both rollers, got {cam.breadth:g} m")
    seconds = (duration + cam.dwell) / np.pi
    return Pitch(cam.breadth, stroke, cam.roller_radius, cam.profile_radius, seconds, cam.dwell > 0)


def _parting(pitch):
    """Pressure angle [rad] up to which flanks cannot cross: rho^2/w = rho cos(angle) >= r."""
    return np.arccos(2 * pitch.roller_radius / (pitch.breadth - pitch.stroke))


def space_of(limits, pieces, halvings=0):
    """The `Space` for some limits: `pieces` shared by run-up and run-down, crowded at their ends, then halved."""
    k, times = limits.continuous, 2**halvings
    if limits.steady is None:
        return Space(graded_breaks(0.0, 1.0, times * pieces, k), k)
    start, end = limits.steady
    first = min(max(2, round(pieces * limits.run_up / (limits.run_up + limits.run_down))), pieces - 2)
    inner = 1 if limits.steady_tolerance == 0 else STEADY_PIECES
    breaks = [
        graded_breaks(0.0, start, times * first, k)[:-1],
        np.linspace(start, end, inner + 1)[:-1],
        graded_breaks(end, 1.0, times * (pieces - first), k),
    ]
    return Space(np.concatenate(breaks), k)


def broken(limits, motion, instants=100_001):
    """What a `Motion` breaks: name to excess, relative to the bound; seen at so many even instants, no spline needed.

    Continuity and rest are told by the order that is reached, less what was asked for.
    """
    time = np.linspace(0, motion.duration, instants)
    x, v, a, *_ = travel = [motion.derivative(time, order) for order in range(5)]
    mean = motion.stroke / motion.duration
    excess = {
        name: np.abs(travel[k]).max() / getattr(limits, name) - 1
        for name, (k, _) in BOUNDED.items()
        if getattr(limits, name)
    }
    excess["way back"] = -v.min() / mean
    excess["smoothness"] = limits.continuous - motion.smoothness(limits.turn)
    for order in limits.at_rest:
        excess["at rest"] = max(
            excess.get("at rest", 0.0), np.abs(travel[order][[0, -1]]).max() / max(np.abs(travel[order]).max(), TINY)
        )
    if limits.steady:
        start, end = np.array(limits.steady) * motion.duration
        inside = (time >= start) & (time <= end)
        even = (motion.position(end) - motion.position(start)) / (end - start)
        excess["steady speed"] = np.abs(v[inside] / even - 1).max() - limits.steady_tolerance
    if cam := limits.cam:
        radians = (motion.duration + cam.dwell) / np.pi
        ways = [(cam.breadth / 2 + sign * (x - motion.stroke / 2), sign * radians**2 * a) for sign in (1, -1)]
        if cam.pressure_angle is not None:
            steepest = max(np.abs(np.arctan(radians * v / rho)).max() for rho, _ in ways)
            excess["pressure angle"] = steepest / cam.pressure_angle - 1
        if cam.radius_of_curvature is not None:
            least = min((rho + bend).min() for rho, bend in ways)
            excess["radius of curvature"] = (cam.radius_of_curvature - least) / cam.breadth
        if pitch := _pitch(cam, motion.stroke, motion.duration):
            steepest = max(np.arctan(radians * v / rho).max() for rho, _ in ways)
            excess["flanks apart"] = steepest / _parting(pitch) - 1
            excess["profile radius"] = pitch.crowding(x, v, a).max() - 1
    return {name: float(value) for name, value in excess.items() if value > BROKEN}
