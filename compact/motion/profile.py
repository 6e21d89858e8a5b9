"""Motion of the cart: a law over a stroke in a time, its peaks, joins and criteria, and the cycle there and back.

    x(t) = stroke s(t/T),  x^(k) = stroke/T^k s^(k)

The laws themselves are in `compact.motion.laws`; `law` gives one by name. Times in s, travel in m, counted from the
near end.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from compact.motion.laws import LAWS, Shape
from compact.motion.limits import CamLimits, InfeasibleError, Limits
from compact.motion.objectives import OBJECTIVES
from compact.motion.sequential_programming import METHODS, optimum
from compact.numerics.piecewise import find_roots, graded_grid, integrate
from compact.numerics.validation import (
    require_at_most,
    require_between,
    require_finite,
    require_integers,
    require_known,
    require_nonnegative,
    require_opposing,
    require_positive,
)

__all__ = [
    "LAWS",
    "OBJECTIVES",
    "CamLimits",
    "Cycle",
    "InfeasibleError",
    "Join",
    "Limits",
    "Motion",
    "OptimalMotion",
    "Peaks",
    "law",
    "optimise",
]

ORDERS = ("position", "velocity", "acceleration", "jerk", "snap")
Turn = Literal["reversal", "dwell"]
# A jump smaller than this share of the derivative's own size is rounding.
JUMP_TOLERANCE = 1e-9
MOST_PIECES = 1024  # [-], of an optimal law: its dense programs take 0.1 GB then, four times as much at twice as many
SIDE_STEPS = 8  # roundings of phase by which the two sides of a join may lie apart
TURNS = ("reversal", "dwell")


def law(
    name,
    stroke,
    duration,
    run_up=1 / 6,
    run_down=1 / 6,
    energy_weight=0.5,
    acceleration_weight=0.3,
    rod_length=None,
):
    """The motion law `name` over a stroke [m] in a duration [s].

    Parameters
    ----------
    name : a key of LAWS
    stroke : travel between the two ends [m], > 0
    duration : time of one pass [s], > 0
    run_up, run_down : shares of the duration, used by the combined and reversal laws
    energy_weight, acceleration_weight : d1, d2 >= 0 of the complex law, d1 + d2 <= 1
    rod_length : connecting rod [m], > stroke/2, needed by the law "crank"

    Raises ValueError for an unknown name, naming the choices, and for values out of range.

    >>> m = law("reversal-4", stroke=0.4, duration=3.0)
    >>> f"{m.peaks().acceleration:.3f} m/s^2, {m.peaks().jerk:.5f} m/s^3"
    '0.600 m/s^2, 3.69504 m/s^3'
    """
    require_known("motion law", name, tuple(LAWS))
    require_positive(stroke=stroke, duration=duration)
    if rod_length is not None:
        require_positive(rod_length=rod_length)
    rod_ratio = None if rod_length is None else stroke / 2 / rod_length
    entry = LAWS[name]
    curve = entry.build(Shape(run_up, run_down, energy_weight, acceleration_weight, rod_ratio))
    return Motion(name, float(stroke), float(duration), curve, entry.retraces)


@dataclass(frozen=True)
class Peaks:
    """Largest |velocity| [m/s], |acceleration| [m/s^2], |jerk| [m/s^3], |snap| [m/s^4] inside the pieces."""

    velocity: float
    acceleration: float
    jerk: float
    snap: float


@dataclass(frozen=True)
class Join:
    """A jump of a derivative: at `time` [s] the `quantity` goes from `before` to `after` (SI)."""

    time: float
    order: int
    before: float
    after: float

    @property
    def quantity(self):
        """Name of the derivative that jumps."""
        return ORDERS[self.order]


@dataclass(frozen=True)
class Motion:
    """One pass: travel from 0 to `stroke` [m] over 0 <= t <= `duration` [s].

    `curve` is the normalised law; `retraces` says that the way back is the way out run backwards (a crank),
    otherwise it is its mirror image, stroke - x(t) (a cam of constant breadth).
    """

    name: str
    stroke: float
    duration: float
    curve: Callable
    retraces: bool = False

    def derivative(self, time, order):
        """Derivative of the travel of the given order, 0, 1, 2 …, at time [s] of any shape in [0, duration]."""
        if not (isinstance(order, int) and order >= 0):
            raise ValueError(f"`order` of a derivative must be a whole number >= 0, got {order!r}")
        time = np.asarray(time, float)
        slack = 1e-12 * self.duration
        if time.size and not (time.min() >= -slack and time.max() <= self.duration + slack):
            raise ValueError(f"`time` must lie in [0, {self.duration:g}] s, got {time.min():g} to {time.max():g}")
        return self.at_phase(np.clip(time / self.duration, 0.0, 1.0), order)

    def at_phase(self, z, order):
        """Derivative of the travel of the given order at phase z = t/T in [0, 1]."""
        return self._scale(order) * self.curve(z, nu=order)

    def position(self, time):
        """Travel x [m] at time [s]."""
        return self.derivative(time, 0)

    def velocity(self, time):
        """Velocity [m/s] at time [s]."""
        return self.derivative(time, 1)

    def acceleration(self, time):
        """Acceleration [m/s^2] at time [s]."""
        return self.derivative(time, 2)

    def jerk(self, time):
        """Jerk [m/s^3] at time [s]."""
        return self.derivative(time, 3)

    def snap(self, time):
        """Snap [m/s^4] at time [s]."""
        return self.derivative(time, 4)

    def peaks(self):
        """`Peaks` of this pass, found at the roots of the next derivative, not on samples. Impulses are in `joins`."""
        largest = (np.abs(self.curve(turning_points(self.curve, k), nu=k)).max() for k in range(1, 5))
        return Peaks(*(float(self._scale(k + 1) * peak) for k, peak in enumerate(largest)))

    def joins(self, turn: Turn = "reversal"):
        """Jumps of velocity … snap where pieces meet and at the ends, in order of time, as a tuple of `Join`.

        `turn` says what follows at the ends: "reversal" the way back at once, "dwell" a stand-still.
        """
        require_known("turn", turn, TURNS)
        found, places = [], self.curve.x
        grid, sides = graded_grid(places), [self._sides(k, turn) for k in range(1, 6)]
        for k, (here, next_one) in enumerate(itertools.pairwise(sides), start=1):
            smallest = JUMP_TOLERANCE * max(1.0, np.abs(self.curve(grid, nu=k)).max())
            drift = SIDE_STEPS * np.finfo(float).eps * np.abs(next_one).max(axis=0)
            for i in np.flatnonzero(np.abs(here[1] - here[0]) > smallest + drift):
                before, after = (self._scale(k) * here[:, i]).tolist()
                found.append(Join(float(places[i] * self.duration), k, before, after))
        return tuple(sorted(found, key=lambda join: join.time))

    def smoothness(self, turn: Turn = "reversal"):
        """Highest k up to 4 such that the travel and its derivatives up to k are continuous (C0 … C4)."""
        return min((join.order for join in self.joins(turn)), default=5) - 1

    def criterion(self, order, turn: Turn = "reversal"):
        """J_k = int (x^(k))^2 dt over one pass [m^2/s^(2k-1)]; infinite where x^(k) holds an impulse."""
        if any(join.order < order for join in self.joins(turn)):
            return np.inf
        return self._scale(order) ** 2 * self.duration * integrate(lambda z: self.curve(z, nu=order) ** 2, self.curve.x)

    def cycle(self, far_dwell=0.0, near_dwell=0.0):
        """There and back, with dwells [s] at the far and the near end, as a `Cycle`."""
        return Cycle(self, far_dwell, near_dwell)

    def back(self):
        """The pass from `stroke` back to 0, in its own time from 0."""
        return replace(self, curve=_Back(self.curve, self.retraces))

    def _scale(self, order):
        return self.stroke / self.duration**order

    def _sides(self, order, turn):
        """Values of s^(k) just before and just after each place where pieces meet, ends among them, shape (2, n)."""
        places = self.curve.x
        before = self.curve(np.nextafter(places[1:], -1.0), nu=order)
        after = self.curve(np.nextafter(places[:-1], 2.0), nu=order)
        if turn == "dwell":
            outside = np.zeros(2)
        elif self.retraces:
            outside = (-1) ** order * np.array([after[0], before[-1]])
        else:
            outside = -self.curve(1.0 - places[[0, -1]], nu=order)
        return np.array([[outside[0], *before], [*after, outside[1]]])


@dataclass(frozen=True)
class OptimalMotion(Motion):
    """A `Motion` found by `optimise`, and how: see `sequential_programming.Optimum` for gap, refinement and steps.

    value : the criterion that was made least, there and back without a dwell; `limits` : the `Limits` it keeps
    """

    value: float = np.nan
    gap: float = np.nan
    refinement: float = np.nan
    steps: int = 0
    limits: Limits = field(default_factory=Limits)


def optimise(
    objective,
    stroke,
    duration,
    mass,
    resistance,
    limits=None,
    *,
    quantile=1.0,
    regret=False,
    pieces=None,
    method="steps",
):
    """The motion law that asks least of the drive of a cart, an `OptimalMotion`.

        least J of H = m a + R(v, a),  P = H v,  there and back

    Parameters
    ----------
    objective : a name of OBJECTIVES: "peak_force" [N], "peak_power" [W], "rms_force" [N], "energy" (net work),
        "drawn_energy" (the work where P > 0) [J]; or name -> weight >= 0 of a weighted sum
    stroke, duration : travel [m] and time [s] of one pass, > 0
    mass : of the cart [kg], >= 0
    resistance : R(velocity, acceleration) [N], arrays of any shape, of the way there alone, where velocity > 0: the
        way back mirrors it; guide friction may be in it. Several
        make a law for all of them: J is the worst of them, or the `quantile`
    regret : count J of each resistance in what the best law for it alone would ask; J is then such a ratio
    limits : `Limits` that the law keeps at every instant; none but a way without turning back unless given
    pieces : of the spline outside the constant speed; as many as `sequential_programming.PIECES` says unless given
    method : "steps", sequential convex programs, or "casadi", IPOPT on the same spline (extra `optimise`)

    Raises InfeasibleError, with what would have to give and by how much, where no law keeps the limits, RuntimeError
    where the search does not end, ValueError for values out of range. Of several laws that do as well one is given:
    a small weight on "rms_force" chooses the calm one.

    >>> def none(velocity, acceleration): return 0 * velocity
    >>> m = optimise("peak_force", stroke=0.4, duration=3.0, mass=1000.0, resistance=none)
    >>> f"{m.value:.3f} N = 4 m stroke/duration^2, gap below 1e-9: {m.gap < 1e-9}"
    '177.778 N = 4 m stroke/duration^2, gap below 1e-9: True'
    """
    weights = {objective: 1.0} if isinstance(objective, str) else dict(objective)
    for one in weights:
        require_known("objective", one, tuple(OBJECTIVES))
    require_positive(stroke=stroke, duration=duration, quantile=quantile)
    require_nonnegative(mass=mass, weights=list(weights.values()))
    if not any(weights.values()):
        raise ValueError(f"`objective` must hold a weight > 0, got {objective!r}")
    require_between(0, 1, quantile=quantile)
    if pieces is not None:
        require_integers(pieces=pieces)
        require_at_most(MOST_PIECES, "finer ones change no law by a machine's tolerance", pieces=pieces)
    resistances = (resistance,) if callable(resistance) else tuple(resistance)
    for one in resistances:
        require_opposing(one, stroke / duration, directions=(1.0,))
    limits = limits or Limits()
    task = limits, float(stroke), float(duration), weights, float(mass)
    require_known("method", method, tuple(METHODS))
    how = {"pieces": pieces, "method": method}
    least = tuple(optimum(*task, (one,), **how).value for one in resistances) if regret else ()
    curve, *rest = optimum(*task, resistances, quantile, least=least, **how)
    return OptimalMotion(optimal_name(weights), float(stroke), float(duration), curve, False, *rest, limits)


def optimal_name(objectives: Iterable[str]) -> str:
    """Name of the law that `optimise` makes for the names of its objectives."""
    return "least-" + "-and-".join(objectives).replace("_", "-")


@dataclass(frozen=True)
class _Back:
    curve: Callable
    retraces: bool

    @property
    def x(self):
        return 1 - self.curve.x[::-1] if self.retraces else self.curve.x

    def __call__(self, z, nu=0):
        if self.retraces:
            return (-1) ** nu * self.curve(1 - np.asarray(z, float), nu=nu)
        return (1.0 if nu == 0 else 0.0) - self.curve(z, nu=nu)


@dataclass(frozen=True)
class Leg:
    """A pass or a dwell inside a cycle: begins at `start` [s]; `direction` +1 there, -1 back, 0 standing."""

    start: float
    duration: float
    direction: int
    motion: Motion | None = None
    position: float = 0.0

    def at_phase(self, z, order):
        """Derivative of the travel of the given order at phase z of this leg."""
        if self.motion is None:
            return np.full(np.shape(z), self.position if order == 0 else 0.0)
        return self.motion.at_phase(z, order)

    def joined_at(self):
        """Phases of this leg where its pieces meet, ends among them."""
        return np.array([0.0, 1.0]) if self.motion is None else self.motion.curve.x


@dataclass(frozen=True)
class Cycle:
    """There, dwell at the far end, back, dwell at the near end, and again (rise-dwell-return-dwell).

    >>> cycle = Cycle(law("quintic", 0.4, 3.0), far_dwell=0.5)
    >>> cycle.period, float(cycle.derivative(3.2, 0)), float(cycle.derivative(6.5, 0))
    (6.5, 0.4, 0.0)
    """

    there: Motion
    far_dwell: float = 0.0
    near_dwell: float = 0.0

    def __post_init__(self):
        require_nonnegative(far_dwell=self.far_dwell, near_dwell=self.near_dwell)

    @property
    def period(self):
        """Time of the whole cycle [s]."""
        return 2 * self.there.duration + self.far_dwell + self.near_dwell

    @property
    def duration(self):
        """The period [s], as of one pass."""
        return self.period

    def position(self, time):
        """Travel x [m] at time [s], periodic."""
        return self.derivative(time, 0)

    def velocity(self, time):
        """Velocity [m/s] at time [s], periodic."""
        return self.derivative(time, 1)

    def acceleration(self, time):
        """Acceleration [m/s^2] at time [s], periodic."""
        return self.derivative(time, 2)

    def legs(self):
        """The `Leg`s in order of time; dwells of zero length are left out."""
        duration, stroke = self.there.duration, self.there.stroke
        far, near = duration + self.far_dwell, 2 * duration + self.far_dwell
        legs = [
            Leg(0.0, duration, 1, self.there),
            Leg(duration, self.far_dwell, 0, position=stroke),
            Leg(far, duration, -1, self.there.back()),
            Leg(near, self.near_dwell, 0),
        ]
        return [leg for leg in legs if leg.duration > 0]

    def derivative(self, time, order):
        """Derivative of the travel of the given order at any time [s], periodic."""
        require_finite(time=time)
        time = np.mod(np.asarray(time, float), self.period)
        legs = self.legs()
        which = np.searchsorted([leg.start for leg in legs], time, side="right") - 1
        phases = [np.clip(time - leg.start, 0.0, leg.duration) / leg.duration for leg in legs]
        values = [leg.at_phase(phase, order) for leg, phase in zip(legs, phases, strict=True)]
        return np.select([which == i for i in range(len(legs))], values)

    def joins(self):
        """Jumps of velocity … snap over the whole cycle, as a tuple of `Join`."""
        return self._joins

    @cached_property
    def _joins(self):
        turns = ["dwell" if dwell > 0 else "reversal" for dwell in (self.near_dwell, self.far_dwell)]
        joins = []
        for leg in (leg for leg in self.legs() if leg.motion is not None):
            first, last = turns if leg.direction > 0 else turns[::-1]
            inner = [join for join in leg.motion.joins(first) if join.time < leg.duration]
            # a reversal belongs to the pass that it begins
            outer = [join for join in leg.motion.joins("dwell") if join.time == leg.duration] if last == "dwell" else []
            joins += [replace(join, time=leg.start + join.time) for join in inner + outer]
        return tuple(joins)


def turning_points(curve, order):
    """Phases where |s^(order)| can be largest: roots of the next derivative and both sides of every join."""
    edges = np.concatenate([np.nextafter(curve.x[:-1], 2.0), np.nextafter(curve.x[1:], -1.0)])
    if hasattr(curve, "roots"):
        roots = curve.derivative(order + 1).roots(discontinuity=False, extrapolate=False)
        return np.concatenate([edges, roots[np.isfinite(roots)]])
    # the grid catches a plateau behind a thin layer, where the next derivative is zero and changes no sign
    return np.concatenate([edges, graded_grid(curve.x), find_roots(lambda z: curve(z, nu=order + 1), curve.x)])
