"""Motor of a shaft and bearings of wheels and rollers: requirement over a cycle, choice, life.

    torque of the motor   T/(g eta) while it drives, T eta/g while it brakes
    required              margin rms <= rated torque,   margin peak <= peak torque
    rated power           margin rms torque x speed, of the motor
    inertia ratio         largest sum of m x'^2 over g^2 J_motor

T is the torque of all carts on the shaft (`shaft`), g the speed of the motor over that of the shaft, eta the
efficiency of the gear. The winding of a motor warms up by the square of its torque, over times long compared with a
cycle: the rms torque over the whole cycle, dwells included, is compared with the rated torque. The shaft turns
uniformly, so that the rotor takes no torque. The coefficient of speed fluctuation by the rotor alone, the excess energy
over J w^2, shows how much control or flywheel that takes.

Load cycles are counted by rainflow; the life of bearings is that of ISO 281:

    equivalent load   P = (int |F|^p |dx| / int |dx|)^(1/p)
    basic life        L10 = (C/P)^p  million revolutions,   p = 3 (ball), 10/3 (roller)

F is the radial load of one bearing, x the travel that turns it, C its basic dynamic rating. Load cycles are those of a
history that repeats: it is counted from its maximum on, so that every cycle is closed.

References
----------
R. L. Norton, Design of Machinery, McGraw-Hill, chapter 11 (flywheels: coefficient of fluctuation by excess energy).
ASTM E1049-85 (2017), 5.4.4 and 5.4.5 (rainflow, repeating histories); ISO 281:2007, basic rating life, valid for
P <= C/2 and without axial load.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import rainflow
from scipy.integrate import cumulative_trapezoid

from compact.machine.ranking import group_equal
from compact.machine.rigid_drive import Run, sample_pieces
from compact.machine.shaft import CartsOnShaft
from compact.numerics import Array, BoolArray
from compact.numerics.piecewise import find_maximum, interior_grid
from compact.numerics.validation import require_fields, require_integers, require_known, require_positive

POWER_DIGITS = 6  # [-], of a rated power in W; its torque times its speed is rounded
DEFAULT_MARGIN = 1.25  # [-], over rms and peak torque; customary service factor of moderate shocks in one shift
ROUNDING_SHARE = 1e-12  # [-], of the peak torque; smaller torques are rounding
LIFE_EXPONENTS = {"ball": 3.0, "roller": 10 / 3}  # kind of bearing -> p [-]
VALID_SHARE = 0.5  # [-], of the rating; largest equivalent load for which ISO 281 is valid
ROUNDING_RANGE = 1e-7  # [-], of the largest |load|; smaller load cycles, and smaller differences, are rounding
SECONDS_PER_HOUR = 3600.0  # [s]


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
    largest_inertia : float
        Largest sum of m x'^2 over all carts, their inertia reduced to the shaft [kg m2].
    peak_driving, peak_braking : float
        Largest torque, and largest torque in the opposite direction [N m], >= 0, also between samples.
    """

    speed: float
    angle: Array
    weights: Array
    torque: Array
    largest_inertia: float
    peak_driving: float
    peak_braking: float

    @property
    def peak_torque(self) -> float:
        """Largest |torque| [N m]."""
        return max(self.peak_driving, self.peak_braking)

    @property
    def mean_torque(self) -> float:
        """Mean torque [N m]; times 2 pi the work of a cycle."""
        return self.mean(self.torque)

    @property
    def rms_torque(self) -> float:
        """Root mean square of the torque [N m]."""
        return math.sqrt(self.mean(self.torque**2))

    @property
    def driving_share(self) -> float:
        """Share of the cycle in which the shaft drives the carts, to 1 % [-]."""
        return self.mean(self.torque > ROUNDING_SHARE * self.peak_torque)

    @property
    def braking_share(self) -> float:
        """Share of the cycle in which the carts drive the shaft, to 1 % [-]."""
        return self.mean(self.torque < -ROUNDING_SHARE * self.peak_torque)

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
        return math.sqrt(self.mean(torque**2)), max(driving * self.peak_driving, braking * self.peak_braking)

    def mean(self, values: Array | BoolArray) -> float:
        """Mean over the revolution."""
        return float(np.sum(self.weights * values) / (2 * np.pi))


def shaft_requirement(carts: CartsOnShaft) -> ShaftRequirement:
    """Compute the torque of carts on a shaft that turns uniformly, one revolution a cycle, under a continuous velocity.

    Parameters
    ----------
    carts : CartsOnShaft
        Carts, their law and the resistance.
    """
    speed, breaks = float(2 * np.pi / carts.cycle.period), carts.breaks()

    def torque(angle: Array) -> Array:
        return np.sum([state.drive_power for state in carts.uniform_states(angle)], axis=0) / speed

    angle, weights = sample_pieces(breaks, unit=2 * np.pi)
    slopes = np.array([carts.travel(np.mod(angle + lead, 2 * np.pi))[1] for lead in carts.angles])
    grid = interior_grid(breaks)
    driving, braking = find_maximum(torque, grid)[0], find_maximum(lambda at: -torque(at), grid)[0]
    inertia = carts.cart.mass * float(np.sum(slopes**2, axis=0).max())
    samples = angle.ravel(), weights.ravel(), torque(angle).ravel()
    return ShaftRequirement(speed, *samples, inertia, max(driving, 0.0), max(braking, 0.0))


def requirement_of_run(run: Run, angles: tuple[float, ...] = (0.0,)) -> ShaftRequirement:
    """Compute the torque of a uniform shaft from a run whose driven end follows the law, such as an elastic drive.

    Parameters
    ----------
    run : Run
        Run with samples in order of time that resolve its oscillation.
    angles : tuple of float
        Lead of each cart over the shaft [rad]; all carts have the same run.

    Notes
    -----
    Torques between samples are interpolated linearly for carts that are ahead of the first one.
    """
    speed = float(2 * np.pi / run.period)
    angle, slope = speed * run.time, run.cycle.derivative(run.time, 1) / speed

    def of_all_carts(values: Array) -> Array:
        ahead = (np.mod(angle + lead, 2 * np.pi) if lead else None for lead in angles)
        each = [values if at is None else np.interp(at, angle, values, period=2 * np.pi) for at in ahead]
        return np.sum(each, axis=0)

    torque = of_all_carts(run.drive_power / speed)
    peaks = max(float(torque.max()), 0.0), max(float(-torque.min()), 0.0)
    inertia = run.cart.mass * float(of_all_carts(slope**2).max())
    return ShaftRequirement(speed, angle, speed * run.weights, torque, inertia, *peaks)


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
        require_fields(self, positive="rated_torque peak_torque speed price", nonnegative="inertia")
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
    """Check a motor against the torque of a shaft by a rule."""
    ratio = rule.gear_ratio or motor.speed / requirement.speed
    speed, (rms, peak) = ratio * requirement.speed, requirement.at_motor(ratio, rule.efficiency)
    rated, largest, rotor = rule.margin * rms, rule.margin * peak, ratio**2 * motor.inertia
    inertia_ratio = requirement.largest_inertia / rotor if rotor else math.inf
    fluctuation = requirement.excess_energy / (rotor * requirement.speed**2) if rotor else math.inf
    limit = math.inf if rule.inertia_ratio is None else rule.inertia_ratio
    failures = {
        f"turns at {speed:.4g} rad/s, above the rated {motor.speed:.4g}": speed > motor.speed * (1 + ROUNDING_SHARE),
        f"has {motor.rated_torque:.4g} of the {rated:.4g} N m of rated torque required": rated > motor.rated_torque,
        f"has {motor.peak_torque:.4g} of the {largest:.4g} N m of peak torque required": largest > motor.peak_torque,
        f"has an inertia ratio of {inertia_ratio:.3g}, above {limit:g}": inertia_ratio > limit,
    }
    fails = tuple(words for words, failed in failures.items() if failed)
    return MotorFit(motor, ratio, rms, peak, inertia_ratio, fluctuation, fails)


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
        place = next((i for i, each in enumerate(self.fits) if each.holds), len(self.fits))
        return self.fits[place - 1] if place else None


def choose_motor(motors: Sequence[CatalogueMotor], requirement: ShaftRequirement, rule: SizingRule) -> MotorChoice:
    """Choose the smallest motor that holds by a rule: by price if every motor has one, else by rated power.

    Of equal ones the first of the catalogue is the smallest.
    """
    priced = all(each.price is not None for each in motors)

    def size(motor: CatalogueMotor) -> tuple[float, float]:
        return (motor.price or 0.0) if priced else 0.0, round(motor.rated_power, POWER_DIGITS)

    fits = tuple(check_motor(each, requirement, rule) for each in sorted(motors, key=size))
    return MotorChoice("price" if priced else "rated power", fits)


@dataclass(frozen=True)
class LoadCycle:
    """Load cycles of one range.

    Parameters
    ----------
    range, mean : float
        Range from minimum to maximum, and mean [N].
    count : float
        Number in one repetition of the history.
    """

    range: float
    mean: float
    count: float


def count_cycles(history: Array) -> list[LoadCycle]:
    """Count the load cycles of a repeating history by rainflow.

    Parameters
    ----------
    history : array_like, shape (n,)
        Load over one repetition [N].

    Returns
    -------
    list of LoadCycle
        Largest range first; equal ranges with equal means are one entry. Empty for a constant load.

    Examples
    --------
    >>> [(each.range, each.mean, each.count) for each in count_cycles([0.0, 5.0, 1.0, 4.0])]
    [(5.0, 2.5, 1.0), (3.0, 2.5, 1.0)]
    """
    load = np.asarray(history, float)
    start, largest = int(load.argmax()), float(np.abs(load).max())
    found = rainflow.extract_cycles(np.concatenate([load[start:], load[: start + 1]]))
    least, counted = ROUNDING_RANGE * largest, (map(float, cycle[:3]) for cycle in found)
    cycles = [LoadCycle(size, mean * (abs(mean) > least), share) for size, mean, share in counted if size > least]

    def alike(cycles: list[LoadCycle], values: Iterable[float]) -> list[list[LoadCycle]]:
        """Group cycles of equal values, largest first."""
        groups = group_equal([-value for value in values], largest, ROUNDING_RANGE)
        return [[cycles[i] for i in group] for group in groups]

    of_range = alike(cycles, (each.range for each in cycles))
    of_mean = (same for ranged in of_range for same in alike(ranged, (each.mean for each in ranged)))
    return [LoadCycle(same[0].range, same[0].mean, sum(each.count for each in same)) for same in of_mean]


@dataclass(frozen=True)
class Bearing:
    """Rolling bearings that share a load.

    Parameters
    ----------
    dynamic_rating : float
        C of one bearing [N].
    kind : {"ball", "roller"}
        Kind of its rolling elements.
    count : int
        Number of bearings that share the load equally, >= 1.
    """

    dynamic_rating: float
    kind: str
    count: int

    def __post_init__(self) -> None:
        require_positive(dynamic_rating=self.dynamic_rating)
        require_known("kind", self.kind, tuple(LIFE_EXPONENTS))
        require_integers(count=self.count)


@dataclass(frozen=True)
class BearingLife:
    """Basic life of a bearing under a repeating load.

    Parameters
    ----------
    equivalent_load : float
        P of one bearing [N]; its largest load without travel.
    million_revolutions : float
        L10, which 90 % of bearings reach, in million revolutions; infinite without load or travel.
    hours : float
        L10 of continuous operation [h].
    valid : bool
        True for P <= C/2, the range of ISO 281.
    """

    equivalent_load: float
    million_revolutions: float
    hours: float
    valid: bool


def bearing_life(bearing: Bearing, load: Array, travelled: Array, radius: float, period: float) -> BearingLife:
    """Compute the basic life of a bearing whose wheel rolls along a repeating travel.

    Parameters
    ----------
    load : ndarray, shape (n,)
        Radial load on all its bearings together [N].
    travelled : ndarray, shape (n,)
        Part of the distance that the wheel rolls under each load [m], >= 0.
    radius : float
        Radius of the wheel [m].
    period : float
        Time of one repetition [s].

    Examples
    --------
    >>> bearing = Bearing(20e3, "ball", count=1)
    >>> life = bearing_life(bearing, np.full(1, 2000.0), np.full(1, 0.8), radius=0.1, period=2.0)
    >>> f"{life.million_revolutions:.0f} million revolutions, {life.hours:.0f} h"
    '1000 million revolutions, 436332 h'
    """
    require_positive(radius=radius, period=period)
    exponent, distance, share = LIFE_EXPONENTS[bearing.kind], float(np.sum(travelled)), np.abs(load) / bearing.count
    equivalent, revolutions, hours = float(np.max(share)), math.inf, math.inf
    if distance:
        equivalent = float(np.sum(travelled * share**exponent) / distance) ** (1 / exponent)
    if distance and equivalent:
        revolutions = (bearing.dynamic_rating / equivalent) ** exponent
        hours = revolutions * 1e6 * 2 * np.pi * radius * period / distance / SECONDS_PER_HOUR
    return BearingLife(equivalent, revolutions, hours, equivalent <= VALID_SHARE * bearing.dynamic_rating)
