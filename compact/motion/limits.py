"""Limits of a motion law: bounds on its derivatives, its constant velocity, its continuity and the cam that drives it.

A law satisfies its limits at every instant. `optimisation_problem` turns them into linear constraints on a spline;
`violations` checks any law against them, independently of splines.

    cam, phi = 2 pi t/period, rho = b/2 +- (x - stroke/2), + forward and - return (`compact.cams.profile`):
    pressure angle      |dx/dphi| <= tan(angle) rho           of a pointed or a roller follower
    radius of curvature rho + rho'' >= radius                 of a flat-faced follower
    profile of a roller follower: see `PitchCurve`
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from compact.motion.laws import SUM_TOLERANCE, require_phases
from compact.motion.profile import END_CONDITIONS, EndCondition, MotionProfile
from compact.numerics import Array
from compact.numerics.validation import require_between, require_fields, require_known, require_number

# Bounded derivatives: order and unit, by the name of their limit
BOUNDED_DERIVATIVES: Mapping[str, tuple[int, str]] = MappingProxyType(
    {"velocity": (1, "m/s"), "acceleration": (2, "m/s^2"), "jerk": (3, "m/s^3"), "snap": (4, "m/s^4")}
)
VIOLATION_TOLERANCE = 1e-9  # [-], of a limit: a smaller excess is rounding of the convex programs
IMAGINARY_STEP = 1e-30j  # [m], [m/s], [m/s^2], of a derivative
CURVATURE_MARGIN = 2e-5  # [-], of the curvature ratio: reserve for peaks between the nodes, twice their usual excess


@dataclass(frozen=True)
class PitchCurve:
    """Path of the centre of a roller on a cam of constant breadth, whose curvature limits the profile of the cam.

        rho = b/2 +- (x - stroke/2),  rho' = +- q x',  rho'' = +- q^2 x'',  q = period/(2 pi),  + forward and - return
        kappa = (rho^2 + 2 rho'^2 - rho rho'')/w^3,  w^2 = rho^2 + rho'^2

    The cam profile is the pitch curve offset inwards by the roller radius r: its radius of curvature is 1/kappa - r
    where it is convex and 1/|kappa| + r where it is concave. Both are at least R, without undercut, where

        kappa (r + R) <= 1   and   kappa (r - R) <= 1

    at every angle, the near dwell included. The left-hand sides are the `curvature_ratios`. The constraint is not
    linear in the unknowns of a spline; sequential convex programming linearises it.

    Attributes
    ----------
    breadth, stroke, roller_radius : float
        Breadth b of the cam, travel of one pass, and roller radius r [m].
    profile_radius : float
        Smallest allowed radius of curvature R of the profile [m].
    seconds_per_radian : float
        Period over 2 pi, q [s/rad].
    dwells : bool
        True if the cart dwells at the ends.
    """

    breadth: float
    stroke: float
    roller_radius: float
    profile_radius: float
    seconds_per_radian: float
    dwells: bool

    @property
    def crossing_angle(self) -> float:
        """Pressure angle [rad] below which the flanks of the profile cannot cross: rho^2/w = rho cos(angle) >= r."""
        return float(np.arccos(2 * self.roller_radius / (self.breadth - self.stroke)))

    def curvature(self, x: Array, v: Array, a: Array) -> Array:
        """Return kappa [1/m] of both strokes, shape (2, n), at x [m], v [m/s] and a [m/s^2]."""
        sign, q = np.array([[1.0], [-1.0]]), self.seconds_per_radian
        rho, slope, second = self.breadth / 2 + sign * (x - self.stroke / 2), sign * q * v, sign * q**2 * a
        square = rho**2 + slope**2
        return (square + slope**2 - rho * second) / square**1.5

    def curvature_ratios(self, x: Array, v: Array, a: Array) -> Array:
        """Return kappa (r + R) and kappa (r - R) [-] of both strokes and a dwell, shape (4 or 5, n); all at most 1."""
        spans = self.roller_radius + self.profile_radius * np.array([1.0, -1.0])
        ratios = (spans[:, None, None] * self.curvature(x, v, a)).reshape(4, -1)
        near = (self.breadth - self.stroke) / 2
        return np.vstack([ratios, np.full(len(x), spans.max() / near)]) if self.dwells else ratios

    def ratio_slopes(self, x: Array, v: Array, a: Array) -> list[Array]:
        """Return the derivatives of the `curvature_ratios` by x, v and a, by imaginary steps, exact to rounding."""
        moved = ((x + IMAGINARY_STEP, v, a), (x, v + IMAGINARY_STEP, a), (x, v, a + IMAGINARY_STEP))
        return [np.imag(self.curvature_ratios(*travel)) / IMAGINARY_STEP.imag for travel in moved]

    def reached_radius(self, x: Array, v: Array, a: Array) -> float:
        """Return the largest R [m] that the profile of a law satisfies with the `CURVATURE_MARGIN`."""
        kappa = self.curvature(x, v, a)
        near, room = (self.breadth - self.stroke) / 2, 1 - CURVATURE_MARGIN
        convex, concave = max(kappa.max(), 1 / near if self.dwells else -np.inf), -kappa.min()
        of_concave = room / concave + self.roller_radius if concave > 0 else np.inf
        return float(min(room / convex - self.roller_radius, of_concave))


@dataclass(frozen=True)
class CamLimits:
    """Limits of a cam of constant breadth that drives the law; None disables a limit.

    Attributes
    ----------
    breadth : float
        Breadth of the cam [m].
    pressure_angle : float, optional
        Largest pressure angle of a pointed or a roller follower [rad], < pi/2.
    radius_of_curvature : float, optional
        Smallest radius of curvature of a cam for a flat-faced follower [m].
    dwell : float
        Dwell time at each end [s].
    profile_radius : float, optional
        Smallest radius of curvature of the profile for a roller follower [m], convex or concave; 0 excludes undercut.
    roller_radius : float, optional
        Radius of that roller [m]; required with `profile_radius`.
    """

    breadth: float
    pressure_angle: float | None = None
    radius_of_curvature: float | None = None
    dwell: float = 0.0
    profile_radius: float | None = None
    roller_radius: float | None = None

    def __post_init__(self) -> None:
        require_fields(self, positive="breadth roller_radius", nonnegative="dwell radius_of_curvature profile_radius")
        if self.pressure_angle is not None:
            require_number(pressure_angle=self.pressure_angle)
            if not 0 < self.pressure_angle < np.pi / 2:
                raise ValueError(
                    f"`pressure_angle` must lie in (0, pi/2) rad, got {self.pressure_angle!r}; use None for no limit"
                )
        if self.profile_radius is not None and self.roller_radius is None:
            raise ValueError("`profile_radius` requires `roller_radius`, got None; set that of the roller [m]")

    def pitch_curve(self, stroke: float, duration: float) -> PitchCurve | None:
        """Return the `PitchCurve` of a roller follower for a stroke [m] and a duration [s], or None."""
        if self.profile_radius is None or self.roller_radius is None:
            return None
        minimum = stroke + 2 * self.roller_radius
        if self.breadth <= minimum:
            raise ValueError(
                f"`breadth` must exceed {minimum:g} m, the stroke and two roller radii, got {self.breadth:g} m; "
                "increase the breadth or use a smaller roller"
            )
        seconds = (duration + self.dwell) / np.pi
        return PitchCurve(self.breadth, stroke, self.roller_radius, self.profile_radius, seconds, self.dwell > 0)


@dataclass(frozen=True)
class Limits:
    """Limits of a law; None disables a limit. The velocity is nonnegative: the cart does not reverse inside a pass.

    Attributes
    ----------
    velocity, acceleration, jerk, snap : float, optional
        Largest magnitudes [m/s], [m/s^2], [m/s^3], [m/s^4].
    run_up, run_down : float
        Duration of the acceleration and of the deceleration phase over the duration of the pass [-], > 0, sum <= 1;
        a sum of 1 leaves no phase of constant velocity.
    steady_tolerance : float
        Largest relative deviation from the mean velocity in between [-].
    smoothness : int
        Highest order of a continuous derivative, 1 to 3; a limit on jerk implies 2, on snap 3.
    end_condition : {"reversal", "dwell"}
        Motion after the pass: its mirror image without a dwell, or a dwell.
    cam : CamLimits, optional
    """

    velocity: float | None = None
    acceleration: float | None = None
    jerk: float | None = None
    snap: float | None = None
    run_up: float = 0.5
    run_down: float = 0.5
    steady_tolerance: float = 0.0
    smoothness: int = 1
    end_condition: EndCondition = "reversal"
    cam: CamLimits | None = None

    def __post_init__(self) -> None:
        require_fields(self, positive=" ".join([*BOUNDED_DERIVATIVES, "run_up", "run_down"]))
        require_phases(self.run_up, self.run_down)
        require_between(0, 1, steady_tolerance=self.steady_tolerance)
        require_known("end condition", self.end_condition, END_CONDITIONS)
        if self.smoothness not in (1, 2, 3):
            raise ValueError(f"`smoothness` must be 1, 2 or 3, got {self.smoothness!r}")

    @property
    def continuous(self) -> int:
        """Order of the highest continuous derivative: the smoothness, or the order that a limit implies."""
        return max(self.smoothness, 2 * (self.jerk is not None), 3 * (self.snap is not None))

    @property
    def steady(self) -> tuple[float, float] | None:
        """Phases t/T between which the velocity is constant, or None."""
        return (self.run_up, 1 - self.run_down) if self.run_up + self.run_down < 1 - SUM_TOLERANCE else None


class Conflict(NamedTuple):
    """A limit that cannot be satisfied.

    Attributes
    ----------
    name, unit : str
        Name and unit of the limit.
    limit, required : float
        Value of the limit, and that which makes the problem feasible, all other limits unchanged.
    """

    name: str
    unit: str
    limit: float
    required: float

    def __str__(self) -> str:
        change = self.required / self.limit - 1
        return f"{self.name} {self.required:.6g} {self.unit} for {self.limit:.6g} ({change:+.3g})"


class InfeasibleError(ValueError):
    """No law satisfies all limits.

    Attributes
    ----------
    conflicts : tuple of Conflict
        Limits to relax.
    alone : bool
        True if relaxing any one of them suffices; otherwise all of them have to be relaxed.
    """

    def __init__(self, conflicts: Iterable[Conflict], alone: bool) -> None:
        self.conflicts, self.alone = tuple(conflicts), alone
        changes = (" or " if alone else " together with ").join(map(str, self.conflicts))
        super().__init__(f"no law satisfies all limits; relax, the others unchanged: {changes}")


def violations(limits: Limits, motion: MotionProfile, instants: int = 100_001) -> dict[str, float]:
    """Return the limits that a law violates, with the excess relative to the limit, sampled at even instants.

    Parameters
    ----------
    instants : int
        Number of samples over the pass.

    Returns
    -------
    dict of str to float
        Relative excess by name [-]; for the smoothness, the missing orders. Empty if the law satisfies all limits.
    """
    time, excess = np.linspace(0, motion.duration, instants), {}
    x, v, a, *_ = travel = [motion.derivative(time, order) for order in range(5)]
    for name, (order, _) in BOUNDED_DERIVATIVES.items():
        if limit := getattr(limits, name):
            excess[name] = np.abs(travel[order]).max() / limit - 1
    excess["reversal inside the pass"] = -v.min() / (motion.stroke / motion.duration)
    excess["smoothness"] = limits.continuous - motion.smoothness(limits.end_condition)
    if limits.steady:
        start, end = np.array(limits.steady) * motion.duration
        mean = (motion.position(end) - motion.position(start)) / (end - start)
        deviation = np.abs(v[(time >= start) & (time <= end)] / mean - 1).max()
        excess["constant velocity"] = deviation - limits.steady_tolerance
    if cam := limits.cam:
        radians, sides = (motion.duration + cam.dwell) / np.pi, np.array([[1], [-1]])
        rho = cam.breadth / 2 + sides * (x - motion.stroke / 2)
        steepest = np.abs(np.arctan(radians * v / rho)).max()
        if cam.pressure_angle is not None:
            excess["pressure angle"] = steepest / cam.pressure_angle - 1
        if cam.radius_of_curvature is not None:
            excess["radius of curvature"] = (cam.radius_of_curvature - rho - sides * radians**2 * a).max() / cam.breadth
        if pitch := cam.pitch_curve(motion.stroke, motion.duration):
            excess["crossing flanks"] = steepest / pitch.crossing_angle - 1
            excess["profile radius"] = pitch.curvature_ratios(x, v, a).max() - 1
    return {name: float(value) for name, value in excess.items() if value > VIOLATION_TOLERANCE}
