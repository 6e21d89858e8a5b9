"""Motion of the cart: a law over a stroke and a duration, its peaks, discontinuities and criteria, and its cycle.

    x(t) = stroke s(t/T),  x^(k) = stroke/T^k s^(k)

`compact.motion.laws` defines the laws s(z); `law` returns one by name. SI units; the travel is measured from the near
end of the stroke.
"""

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from compact.motion.laws import LAWS, LawParameters, NormalisedCurve, require_phases
from compact.numerics import Array, validation
from compact.numerics.piecewise import find_roots, graded_grid, integrate

EndCondition = Literal["reversal", "dwell"]
END_CONDITIONS: tuple[EndCondition, ...] = get_args(EndCondition)
DERIVATIVE_NAMES = ("position", "velocity", "acceleration", "jerk", "snap")
JUMP_TOLERANCE = 1e-9  # [-], of the largest value of the derivative: a smaller jump is rounding
PHASE_ROUNDING = 8 * np.finfo(float).eps  # [-], of the phase: distance between the two sides of a breakpoint
HIGHEST_ORDER = 20  # [-], of a derivative
SMALLEST, LARGEST = 1e-20, 1e20  # [m], [s], between which all derivatives and their squares are finite numbers
TIME_TOLERANCE = 1e-12  # [-], of the duration: a time beyond the ends by less is rounding


def law(
    name: str,
    stroke: float,
    duration: float,
    run_up: float = 1 / 6,
    run_down: float = 1 / 6,
    energy_weight: float = 0.5,
    acceleration_weight: float = 0.3,
    rod_length: float | None = None,
) -> "MotionProfile":
    """Return a motion law by name over a stroke and a duration.

    Parameters
    ----------
    name : str
        Key of `LAWS`.
    stroke : float
        Travel between the two ends [m], > 0.
    duration : float
        Time of one pass [s], > 0.
    run_up, run_down : float
        Duration of the acceleration and of the deceleration phase over that of the pass [-]; combined and reversal
        laws.
    energy_weight, acceleration_weight : float
        Weights d1, d2 >= 0 of the complex law [-], d1 + d2 <= 1.
    rod_length : float, optional
        Length of the connecting rod [m], > stroke/2; required by the law "crank".

    Examples
    --------
    >>> m = law("reversal-4", stroke=0.4, duration=3.0)
    >>> f"{m.peaks().acceleration:.3f} m/s^2, {m.peaks().jerk:.5f} m/s^3"
    '0.600 m/s^2, 3.69504 m/s^3'
    """
    validation.require_known("motion law", name, tuple(LAWS))
    sizes = {"stroke": stroke, "duration": duration} | ({} if rod_length is None else {"rod_length": rod_length})
    validation.require_number(**sizes, energy_weight=energy_weight, acceleration_weight=acceleration_weight)
    validation.require_positive(**sizes)
    require_phases(run_up, run_down)
    rod_ratio = None if rod_length is None else stroke / 2 / rod_length
    curve = LAWS[name](LawParameters(run_up, run_down, energy_weight, acceleration_weight, rod_ratio))
    return MotionProfile(name, float(stroke), float(duration), curve, getattr(curve, "retraces", False))


@dataclass(frozen=True)
class Peaks:
    """Largest magnitudes inside the pieces of a law.

    Attributes
    ----------
    velocity, acceleration, jerk, snap : float
        [m/s], [m/s^2], [m/s^3], [m/s^4].
    """

    velocity: float
    acceleration: float
    jerk: float
    snap: float


@dataclass(frozen=True)
class Discontinuity:
    """Jump of a derivative of the travel.

    Attributes
    ----------
    time, order : float, int
        Time of the jump [s] and order of the derivative, from 1.
    before, after : float
        Left and right limit [m/s^order].
    """

    time: float
    order: int
    before: float
    after: float

    @property
    def quantity(self) -> str:
        """Name of the derivative."""
        return DERIVATIVE_NAMES[self.order]


class TravelDerivatives:
    """Named derivatives of a travel over time."""

    def derivative(self, time: ArrayLike, order: int) -> Array:
        """Return the derivative of the travel [m/s^order] at times [s]."""
        raise NotImplementedError

    def position(self, time: ArrayLike) -> Array:
        """Return the travel x [m] at a time [s]."""
        return self.derivative(time, 0)

    def velocity(self, time: ArrayLike) -> Array:
        """Return the velocity [m/s] at a time [s]."""
        return self.derivative(time, 1)

    def acceleration(self, time: ArrayLike) -> Array:
        """Return the acceleration [m/s^2] at a time [s]."""
        return self.derivative(time, 2)

    def jerk(self, time: ArrayLike) -> Array:
        """Return the jerk [m/s^3] at a time [s]."""
        return self.derivative(time, 3)

    def snap(self, time: ArrayLike) -> Array:
        """Return the snap [m/s^4] at a time [s]."""
        return self.derivative(time, 4)


@dataclass(frozen=True)
class MotionProfile(TravelDerivatives):
    """One pass: travel from 0 to the stroke over 0 <= t <= duration.

    Attributes
    ----------
    name : str
        Name of the law.
    stroke, duration : float
        Travel [m] and time [s] of the pass.
    curve : NormalisedCurve
        Law s(z).
    retraces : bool
        True if the return stroke is the forward stroke reversed in time, as of a crank; otherwise it is the mirror
        image stroke - x(t), as of a cam of constant breadth.
    """

    name: str
    stroke: float
    duration: float
    curve: NormalisedCurve
    retraces: bool = False
    jump_tolerance: ClassVar[float] = JUMP_TOLERANCE

    def __post_init__(self) -> None:
        validation.require_between(SMALLEST, LARGEST, stroke=self.stroke, duration=self.duration)

    def derivative(self, time: ArrayLike, order: int) -> Array:
        """Return the derivative of the travel [m/s^order] at times [s] of any shape within [0, duration]."""
        time = np.asarray(validation.as_numbers("time", time), float)
        slack = TIME_TOLERANCE * self.duration
        if time.size and not (time.min() >= -slack and time.max() <= self.duration + slack):
            raise ValueError(f"`time` must lie in [0, {self.duration:g}] s, got {time.min():g} to {time.max():g}")
        return self.at_phase(np.clip(time / self.duration, 0.0, 1.0), order)

    def at_phase(self, z: ArrayLike, order: int) -> Array:
        """Return the derivative of the travel [m/s^order] at phase z = t/T in [0, 1]."""
        _require_order(order)
        return self._scale(order) * self.curve(validation.as_numbers("z", z), nu=order)

    def peaks(self) -> Peaks:
        """Return the `Peaks` inside the pieces, from the roots of the next derivative; impulses are excluded."""
        return self._peaks

    @cached_property
    def _peaks(self):
        largest = (np.abs(self.curve(extremum_candidates(self.curve, k), nu=k)).max() for k in range(1, 5))
        return Peaks(*(float(self._scale(k) * peak) for k, peak in enumerate(largest, start=1)))

    def discontinuities(self, end_condition: EndCondition = "reversal") -> tuple[Discontinuity, ...]:
        """Return the jumps of velocity, acceleration, jerk and snap at breakpoints and ends, in order of time.

        Before and after the pass is the return stroke without a dwell ("reversal"), or a dwell.
        """
        return tuple(jump for jump in self._between(end_condition).discontinuities() if jump.time <= self.duration)

    def smoothness(self, end_condition: EndCondition = "reversal") -> int:
        """Return the highest k up to 4 such that the travel is in C^k (C0 to C4)."""
        return min((jump.order for jump in self.discontinuities(end_condition)), default=5) - 1

    def criterion(self, order: int, end_condition: EndCondition = "reversal") -> float:
        """Return J_k of `Cycle.criterion` [m^2/s^(2k-1)], without a dwell at the ends or with one."""
        return self._between(end_condition).criterion(order)

    def cycle(self, far_dwell: float = 0.0, near_dwell: float = 0.0) -> "Cycle":
        """Return the `Cycle` of forward and return stroke, with dwells [s] at the far and the near end."""
        return Cycle(self, far_dwell, near_dwell)

    def return_stroke(self) -> "MotionProfile":
        """Return the pass from the stroke to 0, in its own time from 0."""
        return replace(self, curve=_ReturnCurve(self.curve, self.retraces))

    def _between(self, end_condition):
        """Cycle with an end condition."""
        validation.require_known("end condition", end_condition, END_CONDITIONS)
        dwell = self.duration if end_condition == "dwell" else 0.0
        return self.cycle(dwell, dwell)

    def _scale(self, order):
        return self.stroke / self.duration**order


@dataclass(frozen=True)
class _ReturnCurve:
    """Normalised curve of a return stroke, from 1 to 0."""

    curve: NormalisedCurve
    retraces: bool

    @property
    def x(self) -> Array:
        """Breakpoints [-]."""
        return 1 - self.curve.x[::-1] if self.retraces else self.curve.x

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        if self.retraces:
            return (-1) ** nu * self.curve(1 - np.asarray(z, float), nu=nu)
        return (1.0 if nu == 0 else 0.0) - self.curve(z, nu=nu)


@dataclass(frozen=True)
class Leg:
    """Pass or dwell of a cycle.

    Attributes
    ----------
    start, duration : float
        Time of its begin in the cycle, and its time [s].
    direction : int
        +1 forward, -1 return, 0 dwell.
    position : float
        Travel of a dwell [m].
    """

    start: float
    duration: float
    direction: int
    motion: MotionProfile | None = None
    position: float = 0.0

    def at_phase(self, z: ArrayLike, order: int) -> Array:
        """Return the derivative of the travel [m/s^order] at phase z in [0, 1] of this leg."""
        if self.motion is None:
            return np.full(np.shape(z), self.position if order == 0 else 0.0)
        return self.motion.at_phase(z, order)

    def breakpoints(self) -> Array:
        """Return the phases between the pieces of this leg, both ends included [-]."""
        return np.array([0.0, 1.0]) if self.motion is None else self.motion.curve.x


@dataclass(frozen=True, eq=False)
class Cycle(TravelDerivatives):
    """Periodic motion: forward stroke, dwell at the far end, return stroke, dwell at the near end.

    Attributes
    ----------
    forward : MotionProfile
        Forward stroke.
    far_dwell, near_dwell : float
        Dwell times [s], >= 0.

    Examples
    --------
    >>> cycle = Cycle(law("quintic", 0.4, 3.0), far_dwell=0.5)
    >>> cycle.period, float(cycle.derivative(3.2, 0)), float(cycle.derivative(6.5, 0))
    (6.5, 0.4, 0.0)
    """

    forward: MotionProfile
    far_dwell: float = 0.0
    near_dwell: float = 0.0

    def __post_init__(self) -> None:
        validation.require_nonnegative(far_dwell=self.far_dwell, near_dwell=self.near_dwell)

    @property
    def period(self) -> float:
        """Time of the cycle [s]."""
        return 2 * self.forward.duration + self.far_dwell + self.near_dwell

    @property
    def duration(self) -> float:
        """The period [s], under the name that a `MotionProfile` has for it."""
        return self.period

    def legs(self) -> list[Leg]:
        """Return passes and dwells in order of time; dwells of zero length are left out."""
        return self._legs

    @cached_property
    def _legs(self):
        duration, stroke = self.forward.duration, self.forward.stroke
        far, near = duration + self.far_dwell, 2 * duration + self.far_dwell
        legs = [
            Leg(0.0, duration, 1, self.forward),
            Leg(duration, self.far_dwell, 0, position=stroke),
            Leg(far, duration, -1, self.forward.return_stroke()),
            Leg(near, self.near_dwell, 0),
        ]
        return [leg for leg in legs if leg.duration > 0]

    def direction(self, time: ArrayLike) -> Array:
        """Return +1 on the forward stroke, -1 on the return stroke and 0 in a dwell, at times [s] of a cycle."""
        which = np.searchsorted([leg.start for leg in self.legs()], time) - 1
        return np.array([float(leg.direction) for leg in self.legs()])[which]

    def derivative(self, time: ArrayLike, order: int) -> Array:
        """Return the derivative of the travel [m/s^order] at times [s] of any shape; right limit at a jump."""
        validation.require_finite(time=time)
        instants = np.mod(np.asarray(time, float), self.period)
        which = np.searchsorted([leg.start for leg in self.legs()], instants, side="right") - 1
        values = np.empty(instants.shape)
        for i, leg in enumerate(self.legs()):
            if (here := which == i).any():
                values[here] = leg.at_phase(np.minimum(instants[here] - leg.start, leg.duration) / leg.duration, order)
        return values

    def discontinuities(self) -> tuple[Discontinuity, ...]:
        """Return the jumps of velocity, acceleration, jerk and snap at breakpoints and ends, in order of time."""
        return self._discontinuities

    def criterion(self, order: int) -> float:
        """Return J_k = int (x^(k))^2 dt over one pass [m^2/s^(2k-1)]; infinite where x^(k) contains an impulse."""
        _require_order(order)
        if any(jump.order < order for jump in self.discontinuities()):
            return np.inf
        law, curve = self.forward, self.forward.curve
        return law._scale(order) ** 2 * law.duration * integrate(lambda z: curve(z, nu=order) ** 2, curve.x)

    @cached_property
    def _discontinuities(self):
        legs, forward, found = self.legs(), self.forward, []
        time = np.concatenate([leg.start + leg.duration * leg.breakpoints()[:-1] for leg in legs])

        def limits(order: int) -> Array:
            """Left and right limit of a derivative at the start of every piece, shape (2, pieces)."""
            left = [leg.at_phase(np.nextafter(leg.breakpoints()[1:], -1.0), order) for leg in legs]
            right = [leg.at_phase(np.nextafter(leg.breakpoints()[:-1], 2.0), order) for leg in legs]
            return np.array([np.roll(np.concatenate(left), 1), np.concatenate(right)])

        grid, sides = graded_grid(forward.curve.x), [limits(order) for order in range(1, 6)]
        for k, (values, slopes) in enumerate(itertools.pairwise(sides), start=1):
            smallest = forward.jump_tolerance * max(1.0, np.abs(forward.curve(grid, nu=k)).max())
            smallest = forward._scale(k) * smallest + PHASE_ROUNDING * forward.duration * np.abs(slopes).max(axis=0)
            jumps = np.flatnonzero(np.abs(values[1] - values[0]) > smallest)
            found += [Discontinuity(float(time[i]), k, *values[:, i].tolist()) for i in jumps]
        return tuple(sorted(found, key=lambda jump: jump.time))


def extremum_candidates(curve: NormalisedCurve, order: int) -> Array:
    """Return phases at which |s^(order)| can be largest: roots of the next derivative, both sides of breakpoints."""
    edges = np.concatenate([np.nextafter(curve.x[:-1], 2.0), np.nextafter(curve.x[1:], -1.0)])
    if isinstance(curve, PPoly):
        roots = curve.derivative(order + 1).roots(discontinuity=False, extrapolate=False)
        return np.concatenate([edges, roots[np.isfinite(roots)]])
    # the grid resolves a plateau next to a thin boundary layer, where the next derivative is zero without a sign change
    return np.concatenate([edges, graded_grid(curve.x), find_roots(lambda z: curve(z, nu=order + 1), curve.x)])


def _require_order(order: object) -> None:
    if not (isinstance(order, int) and 0 <= order <= HIGHEST_ORDER):
        raise ValueError(f"`order` of a derivative must be a whole number from 0 to {HIGHEST_ORDER}, got {order!r}")
