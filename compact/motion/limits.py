"""Limits of a motion law: bounds on its derivatives, its constant velocity, its continuity and the cam that drives it.

A law satisfies its limits at every instant. `optimisation_problem` turns them into linear constraints on a spline;
`violations` checks any law against them, independently of splines.

    cam, phi = 2 pi t/period, rho = b/2 +- (x - stroke/2), + forward and - return (`compact.cams.profile`):
    pressure angle      |dx/dphi| <= tan(angle) rho           of a pointed or a roller follower
    radius of curvature rho + rho'' >= radius                 of a flat-faced follower
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from compact.motion.laws import SUM_TOLERANCE, require_phases
from compact.motion.profile import END_CONDITIONS, EndCondition, MotionProfile
from compact.numerics.validation import require_between, require_fields, require_known, require_number

# Bounded derivatives: order and unit, by the name of their limit
BOUNDED_DERIVATIVES: Mapping[str, tuple[int, str]] = MappingProxyType(
    {"velocity": (1, "m/s"), "acceleration": (2, "m/s^2"), "jerk": (3, "m/s^3"), "snap": (4, "m/s^4")}
)
VIOLATION_TOLERANCE = 1e-9  # [-], of a limit: a smaller excess is rounding of the convex programs


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
    """

    breadth: float
    pressure_angle: float | None = None
    radius_of_curvature: float | None = None
    dwell: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, positive="breadth", nonnegative="dwell radius_of_curvature")
        if self.pressure_angle is not None:
            require_number(pressure_angle=self.pressure_angle)
            if not 0 < self.pressure_angle < np.pi / 2:
                raise ValueError(
                    f"`pressure_angle` must lie in (0, pi/2) rad, got {self.pressure_angle!r}; use None for no limit"
                )


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
        if cam.pressure_angle is not None:
            excess["pressure angle"] = np.abs(np.arctan(radians * v / rho)).max() / cam.pressure_angle - 1
        if cam.radius_of_curvature is not None:
            excess["radius of curvature"] = (cam.radius_of_curvature - rho - sides * radians**2 * a).max() / cam.breadth
    return {name: float(value) for name, value in excess.items() if value > VIOLATION_TOLERANCE}
