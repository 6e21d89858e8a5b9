"""Motor of a shaft at uniform speed: rms and peak torque over a cycle, required rated power, choice from a catalogue.

    torque of the motor   T/(g eta) while it drives, T eta/g while it brakes
    required              margin rms <= rated torque,   margin peak <= peak torque
    rated power           margin rms torque x speed, of the motor
    inertia ratio         largest sum of m x'^2 over g^2 J_motor

T is the torque of all carts on the shaft (`shaft_load`), g the speed of the motor over that of the shaft, eta the
efficiency of the gear. The winding of a motor warms up by the square of its torque, over times long compared with a
cycle: the rms torque over the whole cycle, dwells included, is compared with the rated torque. The shaft turns
uniformly, so that the rotor takes no torque. The coefficient of speed fluctuation by the rotor alone, the excess energy
over J w^2, shows how much control or flywheel that takes.

References
----------
R. L. Norton, Design of Machinery, McGraw-Hill, chapter 11 (flywheels: coefficient of fluctuation by excess energy).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid

from compact.machine.rigid_drive import SAMPLES_PER_PIECE, CycleStatistics
from compact.machine.shaft_load import CartsOnShaft
from compact.numerics import Array
from compact.numerics.piecewise import BREAK_OFFSET, clenshaw_curtis, find_maximum, interior_grid
from compact.numerics.validation import require_fields, require_positive

DEFAULT_MARGIN = 1.25  # [-], over rms and peak torque; customary service factor of moderate shocks in one shift
ROUNDING_SHARE = 1e-12  # [-], of the peak torque; smaller torques are rounding


@dataclass(frozen=True, eq=False)
class ShaftRequirement:
    """Torque that a law requires of a shaft at uniform speed; arrays of shape (n,) over one revolution.

    Parameters
    ----------
    speed : float
        Speed of the shaft [rad/s].
    angle, weights : ndarray
        Angle and quadrature weights [rad].
    torque : ndarray
        Torque of all carts [N m].
    inertia : ndarray
        Sum of m x'^2 over all carts [kg m2].
    peak_driving, peak_braking : float
        Largest torque, and largest torque in the opposite direction [N m], >= 0, also between samples.
    """

    speed: float
    angle: Array
    weights: Array
    torque: Array
    inertia: Array
    peak_driving: float
    peak_braking: float

    @property
    def peak_torque(self) -> float:
        """Largest |torque| [N m]."""
        return max(self.peak_driving, self.peak_braking)

    @property
    def mean_torque(self) -> float:
        """Mean torque [N m]; times 2 pi the work of a cycle."""
        return self._mean(self.torque)

    @property
    def rms_torque(self) -> float:
        """Root mean square of the torque [N m]."""
        return math.sqrt(self._mean(self.torque**2))

    @property
    def rms_power(self) -> float:
        """Rms torque times speed [W]."""
        return self.rms_torque * self.speed

    @property
    def driving_share(self) -> float:
        """Share of the cycle in which the shaft drives the carts, to 1 % [-]."""
        return self._mean((self.torque > ROUNDING_SHARE * self.peak_torque).astype(float))

    @property
    def braking_share(self) -> float:
        """Share of the cycle in which the carts drive the shaft, to 1 % [-]."""
        return self._mean((self.torque < -ROUNDING_SHARE * self.peak_torque).astype(float))

    @property
    def largest_inertia(self) -> float:
        """Largest inertia of the carts, reduced to the shaft [kg m2]."""
        return float(self.inertia.max())

    @cached_property
    def excess_energy(self) -> float:
        """Range of the work of the mean torque less that of the carts over a revolution [J]."""
        return float(np.ptp(cumulative_trapezoid(self.mean_torque - self.torque, self.angle, initial=0.0)))

    def at_motor(self, gear_ratio: float, efficiency: float) -> tuple[float, float]:
        """Return rms and peak torque of a motor [N m] behind a gear.

        Parameters
        ----------
        gear_ratio : float
            Speed of the motor over that of the shaft [-].
        efficiency : float
            Efficiency of the gear [-], in both directions.
        """
        driving, braking = 1 / (gear_ratio * efficiency), efficiency / gear_ratio
        torque = np.where(self.torque > 0, driving, braking) * self.torque
        return math.sqrt(self._mean(torque**2)), max(driving * self.peak_driving, braking * self.peak_braking)

    def _mean(self, values: Array) -> float:
        return float(np.sum(self.weights * values) / (2 * np.pi))


def shaft_requirement(carts: CartsOnShaft) -> ShaftRequirement:
    """Compute the torque of carts on a shaft that turns uniformly, one revolution a cycle.

    Parameters
    ----------
    carts : CartsOnShaft
        Carts, their law and the resistance.

    Returns
    -------
    ShaftRequirement

    Raises
    ------
    ValueError
        If the velocity of the law jumps, which requires an infinite torque.
    """
    if any(join.order == 1 for join in carts.cycle.discontinuities()):
        raise ValueError(
            f"the velocity of '{carts.cycle.forward.name}' jumps, which requires an infinite torque; use a law with "
            "continuous velocity"
        )
    speed, breaks = 2 * np.pi / carts.cycle.period, carts.breaks()

    def torque(angle: Array) -> Array:
        return carts.torque(angle, np.full(angle.shape, speed**2 / 2), np.zeros(angle.shape))

    nodes, unit_weights = clenshaw_curtis(SAMPLES_PER_PIECE)
    low, high = breaks[:-1, None], breaks[1:, None]
    inset = BREAK_OFFSET * 2 * np.pi
    angle = np.clip(low + (high - low) * nodes, low + inset, high - inset)
    slopes = np.array([carts.travel(np.mod(angle + lead, 2 * np.pi))[1] for lead in carts.angles])
    grid = interior_grid(breaks)
    driving, braking = find_maximum(torque, grid)[0], find_maximum(lambda at: -torque(at), grid)[0]
    return ShaftRequirement(
        speed=float(speed),
        angle=angle.ravel(),
        weights=((high - low) * unit_weights).ravel(),
        torque=torque(angle).ravel(),
        inertia=(carts.cart.mass * np.sum(slopes**2, axis=0)).ravel(),
        peak_driving=max(driving, 0.0),
        peak_braking=max(braking, 0.0),
    )


def requirement_of_run(run: CycleStatistics, angles: tuple[float, ...] = (0.0,)) -> ShaftRequirement:
    """Compute the torque of a uniform shaft from a run whose driven end follows the law, such as an elastic drive.

    Parameters
    ----------
    run : CycleStatistics
        Run with samples in order of time that resolve its oscillation.
    angles : tuple of float
        Lead of each cart over the shaft [rad]; all carts have the same run.

    Returns
    -------
    ShaftRequirement

    Notes
    -----
    Torques between samples are interpolated linearly for carts that are ahead of the first one.
    """
    speed = 2 * np.pi / run.period
    angle, torque = speed * run.time, run.drive_power / speed
    slope = run.cycle.derivative(run.time, 1) / speed
    ahead = [np.mod(angle + lead, 2 * np.pi) for lead in angles]
    whole = np.sum([_interpolated(at, angle, torque, lead) for at, lead in zip(ahead, angles, strict=True)], axis=0)
    inertia = [_interpolated(at, angle, slope**2, lead) for at, lead in zip(ahead, angles, strict=True)]
    return ShaftRequirement(
        speed=float(speed),
        angle=angle,
        weights=speed * run.weights,
        torque=whole,
        inertia=run.cart.mass * np.sum(inertia, axis=0),
        peak_driving=max(float(whole.max()), 0.0),
        peak_braking=max(float(-whole.min()), 0.0),
    )


def _interpolated(at: Array, angle: Array, values: Array, lead: float) -> Array:
    """Values of a cart at its own angles [rad]; those of the samples for a cart without lead."""
    return values if lead == 0 else np.interp(at, angle, values, period=2 * np.pi)


@dataclass(frozen=True)
class CatalogueMotor:
    """Motor of a catalogue.

    Parameters
    ----------
    name : str
        Name in the catalogue.
    rated_torque, peak_torque : float
        Continuous and largest torque [N m].
    speed : float
        Rated speed [rad/s].
    inertia : float
        Of the rotor [kg m2].
    price : float, optional
        In any one currency.
    """

    name: str
    rated_torque: float
    peak_torque: float
    speed: float
    inertia: float
    price: float | None = None

    def __post_init__(self) -> None:
        require_fields(self, positive="rated_torque peak_torque speed", nonnegative="inertia")
        if self.price is not None:
            require_positive(price=self.price)
        if self.peak_torque < self.rated_torque:
            raise ValueError(
                f"`peak_torque` must be at least `rated_torque` {self.rated_torque!r} N m, got {self.peak_torque!r}"
            )

    @property
    def rated_power(self) -> float:
        """Rated torque times rated speed [W]."""
        return self.rated_torque * self.speed


@dataclass(frozen=True)
class SizingRule:
    """Rule by which a motor holds.

    Parameters
    ----------
    margin : float
        Factor of rms and peak torque [-], >= 1.
    efficiency : float
        Efficiency of the gear [-], 0 < eta <= 1.
    gear_ratio : float, optional
        Speed of the motor over that of the shaft [-]; each motor at its rated speed by default.
    inertia_ratio : float, optional
        Largest inertia of the carts over that of the rotor, both at the motor [-]; unlimited by default.
    """

    margin: float = DEFAULT_MARGIN
    efficiency: float = 1.0
    gear_ratio: float | None = None
    inertia_ratio: float | None = None

    def required_power(self, requirement: ShaftRequirement) -> float:
        """Return the required rated power of a motor at its rated speed, with the margin [W]."""
        return self.margin * requirement.at_motor(1.0, self.efficiency)[0] * requirement.speed


@dataclass(frozen=True)
class MotorFit:
    """Motor behind a gear against a requirement.

    Parameters
    ----------
    gear_ratio : float
        Speed of the motor over that of the shaft [-].
    rms_torque, peak_torque : float
        Torque of the motor, without margin [N m].
    inertia_ratio : float
        Inertia of the carts over that of the rotor, both at the motor [-]; infinite for a rotor without inertia.
    fluctuation : float
        Coefficient of speed fluctuation under a constant torque, by the inertia of the rotor alone [-].
    failures : tuple of str
        Requirements that the motor does not satisfy, in words.
    """

    motor: CatalogueMotor
    gear_ratio: float
    rms_torque: float
    peak_torque: float
    inertia_ratio: float
    fluctuation: float
    failures: tuple[str, ...]

    @property
    def holds(self) -> bool:
        """True if the motor satisfies all requirements."""
        return not self.failures


def check_motor(motor: CatalogueMotor, requirement: ShaftRequirement, rule: SizingRule) -> MotorFit:
    """Check a motor against the torque of a shaft.

    Parameters
    ----------
    motor : CatalogueMotor
        Motor.
    requirement : ShaftRequirement
        Torque of the shaft.
    rule : SizingRule
        Rule by which the motor holds.

    Returns
    -------
    MotorFit
    """
    ratio = rule.gear_ratio or motor.speed / requirement.speed
    rms, peak = requirement.at_motor(ratio, rule.efficiency)
    rotor = ratio**2 * motor.inertia
    inertia_ratio = requirement.largest_inertia / rotor if rotor else math.inf
    fluctuation = requirement.excess_energy / (rotor * requirement.speed**2) if rotor else math.inf
    failures = []
    if ratio * requirement.speed > motor.speed * (1 + ROUNDING_SHARE):
        failures.append(f"turns at {ratio * requirement.speed:.4g} rad/s, above the rated {motor.speed:.4g}")
    if rule.margin * rms > motor.rated_torque:
        failures.append(f"has {motor.rated_torque:.4g} of the {rule.margin * rms:.4g} N m of rated torque required")
    if rule.margin * peak > motor.peak_torque:
        failures.append(f"has {motor.peak_torque:.4g} of the {rule.margin * peak:.4g} N m of peak torque required")
    if rule.inertia_ratio is not None and inertia_ratio > rule.inertia_ratio:
        failures.append(f"has an inertia ratio of {inertia_ratio:.3g}, above {rule.inertia_ratio:g}")
    return MotorFit(motor, ratio, rms, peak, inertia_ratio, fluctuation, tuple(failures))


@dataclass(frozen=True)
class MotorChoice:
    """Motors of a catalogue against a requirement, smallest first.

    Parameters
    ----------
    by : {"price", "rated power"}
        Measure of size.
    fits : tuple of MotorFit
        All motors, ascending.
    """

    by: str
    fits: tuple[MotorFit, ...]

    @property
    def chosen(self) -> MotorFit | None:
        """Smallest motor that holds; None without one."""
        return next((each for each in self.fits if each.holds), None)

    @property
    def next_smaller(self) -> MotorFit | None:
        """Largest motor below the chosen one, or of all where none holds; None for the smallest motor."""
        chosen = self.chosen
        place = len(self.fits) if chosen is None else self.fits.index(chosen)
        return self.fits[place - 1] if place else None


def choose_motor(motors: Sequence[CatalogueMotor], requirement: ShaftRequirement, rule: SizingRule) -> MotorChoice:
    """Choose the smallest motor that holds: by price if every motor has one, else by rated power.

    Parameters
    ----------
    motors : sequence of CatalogueMotor
        Motors in any order.
    requirement : ShaftRequirement
        Torque of the shaft.
    rule : SizingRule
        Rule by which a motor holds.

    Returns
    -------
    MotorChoice

    Raises
    ------
    ValueError
        If there are no motors.
    """
    if not motors:
        raise ValueError("`motors` must hold at least one motor, got none")
    priced = all(each.price is not None for each in motors)

    def size(motor: CatalogueMotor) -> tuple[float, float, str]:
        return (motor.price or 0.0) if priced else 0.0, motor.rated_power, motor.name

    fits = tuple(check_motor(each, requirement, rule) for each in sorted(motors, key=size))
    return MotorChoice("price" if priced else "rated power", fits)
