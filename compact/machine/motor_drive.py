"""Motor drive: a motor with gear and flywheel turns carts on one shaft at variable speed, periodic or from rest.

    J phi'' = g T(g phi') - sum over carts of H x'(phi),   J = J_flywheel + g^2 J_motor

One revolution of the shaft is one cycle of the law, x(phi) = y(T phi/2 pi): a cam, or a crank with its own law. H is
the drive force of each cart at v = x' phi' and a = x'' phi'^2 + x' phi'' (`cart.balance`). T is the torque of the
motor over its speed, g the ratio of motor to shaft speed. At a reversal x' = 0, so a jump of friction causes no
torque. Behind a belt the motor is faster than g phi' by the creep under its load T - J_motor g phi''.

The shaft angle is the independent variable (`shaft`). The acceleration phase from rest is solved revolution by
revolution. Near rest phi' is the square root of the angle, and the elements are graded towards the start. At rest
friction holds the carts: a motor that is too weak for carts away from a dead centre does not start.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from compact.machine import rigid_drive
from compact.machine.cart import Cart, Resistance
from compact.machine.shaft import RIGID, Belt, CartsOnShaft, ShaftRevolution, TorqueCurve, solve_shaft_speed
from compact.motion.profile import Cycle, MotionProfile
from compact.numerics import Array
from compact.numerics.piecewise import find_maximum, interior_grid
from compact.numerics.validation import require_fields, require_nonnegative, require_opposing

SPEED_TRIALS = 200  # [-], speeds between rest and no load for the first guess
GUESS_POINTS = 18  # [-], per piece of the law, ends included; mean torque of the first guess
PEAK_STEPS = 12  # [-], per element; grid of the search for a peak
PERIODIC_TOLERANCE = 1e-3  # [-], of the initial speed of the periodic regime; end of the acceleration phase
MAX_REVOLUTIONS = 2000  # [-]
FIRST_ANGLE = 1e-10  # [-], of the first piece of a revolution; the torque at rest acts over it
GRADING = 4.0  # [-], ratio of the lengths of successive elements after the start
REST_ENERGY = 1e-30  # [-], of the square of the no-load speed; stands for rest


@dataclass(frozen=True)
class Motor:
    """Motor, gear, flywheel and optional belt.

    Parameters
    ----------
    curve : TorqueCurve
        Torque over the speed of the motor.
    gear_ratio : float
        g, speed of motor over shaft [-]; includes the ratio of the pulleys of a belt.
    motor_inertia, flywheel_inertia : float
        Of the rotor, and on the shaft [kg m^2].
    angles : tuple of float
        Lead of each cart over the shaft [rad].
    rod : Rigid or Crank
        Rigid for a cam.
    belt : Belt, optional
        Belt between motor and gear.
    """

    curve: TorqueCurve
    gear_ratio: float
    motor_inertia: float
    flywheel_inertia: float
    angles: tuple[float, ...] = (0.0,)
    rod: rigid_drive.Rigid | rigid_drive.Crank = RIGID
    belt: Belt | None = None

    def __post_init__(self) -> None:
        require_fields(self, positive="gear_ratio", nonnegative="motor_inertia flywheel_inertia", finite="angles")
        if not self.angles:
            raise ValueError("`angles` must hold one angle per cart, got none")

    @property
    def inertia(self) -> float:
        """Inertia J reduced to the shaft [kg m^2]."""
        return self.flywheel_inertia + self.gear_ratio**2 * self.motor_inertia

    def torque(self, speed: Array, acceleration: Array | float = 0.0) -> Array:
        """Return g T [N m] at speeds [rad/s] and accelerations [rad/s^2] of the shaft."""
        return self.gear_ratio * self.curve.torque(self.motor_speed(speed, acceleration))

    def motor_speed(self, speed: Array, acceleration: Array | float = 0.0) -> Array:
        """Return the speed of the motor [rad/s] at speeds [rad/s] and accelerations [rad/s^2] of the shaft."""
        geared = self.gear_ratio * speed
        if self.belt is None:
            return geared
        return self.belt.motor_speed(lambda w: self.curve.torque(w) - self._rotor_torque(acceleration), geared)

    def power(self, speed: Array, acceleration: Array) -> Array:
        """Return the power T w of the motor [W] at speeds [rad/s] and accelerations [rad/s^2] of the shaft."""
        return self.torque(speed, acceleration) / self.gear_ratio * self.motor_speed(speed, acceleration)

    def belt_torque(self, speed: Array, acceleration: Array) -> Array:
        """Return the torque on the belt, or on the gear without one [N m]."""
        return self.torque(speed, acceleration) / self.gear_ratio - self._rotor_torque(acceleration)

    def _rotor_torque(self, acceleration):
        """Torque that accelerates the rotor [N m]."""
        return self.motor_inertia * self.gear_ratio * acceleration

    def residual(self, load: CartsOnShaft, angle: Array, energy: Array, acceleration: Array) -> Array:
        """Return the residual torque J phi'' + sum of H x' - g T [N m] of carts on the shaft."""
        driving = self.torque(np.sqrt(2 * energy), acceleration)
        return self.inertia * acceleration + load.torque(angle, energy, acceleration) - driving

    def run(self, cart: Cart, cycle: Cycle, resistance: Resistance, working: tuple[float, float]) -> "MotorRun":
        """Simulate the periodic regime, for `rigid_drive.simulate`."""
        return simulate_motor(cart, self, cycle, resistance, working=working)


def simulate_motor(
    cart: Cart,
    motor: Motor,
    motion: MotionProfile | Cycle,
    resistance: Resistance,
    *,
    working: tuple[float, float] = rigid_drive.WORKING_PART,
    start_speed: float | None = None,
) -> "MotorRun":
    """Simulate one revolution of identical carts on a shaft with a motor.

    Parameters
    ----------
    cart : Cart
    motor : Motor
        Motor and shaft.
    motion : MotionProfile or Cycle
        Law, one cycle per revolution; a `MotionProfile` is repeated without dwells.
    resistance : callable
        Force of the mix on one cart [N] of velocity [m/s] and acceleration [m/s^2].
    working : tuple of float
        Start and end of the working part of the forward stroke [-], for `nonuniformity`.
    start_speed : float, optional
        Initial speed of the shaft [rad/s]; the periodic regime without it.

    Raises
    ------
    ValueError
        If the velocity of the law jumps, or the resistance does not oppose the motion.
    RuntimeError
        If the motor stalls, the belt slips, or the solution does not converge.
    """
    cycle = motion if isinstance(motion, Cycle) else motion.cycle()
    if any(join.order == 1 for join in cycle.discontinuities()):
        raise ValueError(
            f"the velocity of '{cycle.forward.name}' jumps, which requires an infinite torque; use a law with "
            "continuous velocity"
        )
    rigid_drive.require_law_of_drive(motor.rod, cycle)
    require_opposing(resistance, cycle.forward.stroke / cycle.forward.duration)
    load = CartsOnShaft(cart, cycle, resistance, motor.angles, motor.rod)
    require_nonnegative(start_speed=0.0 if start_speed is None else start_speed)
    speed = _first_guess(motor, load) if start_speed is None else start_speed
    revolution = solve_shaft_speed(partial(motor.residual, load), load.breaks(), speed, periodic=start_speed is None)
    run = MotorRun(cart, cycle, resistance, working, motor, load, revolution)
    run.require_no_slip()
    return run


def _first_guess(motor: Motor, load: CartsOnShaft) -> float:
    """Highest uniform speed at which the motor torque exceeds the mean load torque [rad/s]."""
    breaks = load.breaks()
    angle = np.concatenate([np.linspace(a, b, GUESS_POINTS)[None, 1:-1] for a, b in pairwise(breaks)])
    width = np.diff(breaks)[:, None]
    for share in np.linspace(1, 0, SPEED_TRIALS, endpoint=False):
        speed = share * motor.curve.no_load_speed / motor.gear_ratio
        energy = np.full(angle.shape, speed**2 / 2)
        mean_load = np.sum(width * load.torque(angle, energy, 0 * energy)) / angle.shape[1] / (2 * np.pi)
        if motor.torque(speed) >= mean_load:
            return speed
    raise RuntimeError(
        f"the motor stalls: the mean load torque is {mean_load:g} N m at {speed:g} rad/s, the motor delivers "
        f"{motor.torque(speed):g} N m on the shaft; use a stronger motor or a larger `gear_ratio`"
    )


@dataclass(frozen=True)
class MotorRun(rigid_drive.Run):
    """One revolution of the shaft; arrays of shape (n,) in order of angle. Forces are those of the first cart.

    Parameters
    ----------
    load : CartsOnShaft
        Carts on the shaft.
    revolution : ShaftRevolution
        Speed of the shaft.
    """

    load: CartsOnShaft
    revolution: ShaftRevolution

    @cached_property
    def samples(self) -> tuple[Array, Array, Array, rigid_drive.DriveState]:
        """Time and quadrature weights [s], direction of the law, and state of the first cart."""
        solved = self.revolution
        middle = (solved.breaks[:-1] + solved.breaks[1:]) / 2 + self.drive.angles[0]
        direction = self.cycle.direction(np.mod(middle, 2 * np.pi) * (self.cycle.period / (2 * np.pi)))
        state = self.load.states_at(solved.angle, solved.energy, solved.acceleration, solved.jerk)[0]
        directions = np.repeat(direction, solved.angle.shape[1])
        return solved.time.ravel(), solved.weights.ravel(), directions, rigid_drive.flattened(state)

    @cached_property
    def period(self) -> float:
        """Duration of the revolution [s]."""
        return float(self.weights.sum())

    @property
    def angle(self) -> Array:
        """Angle phi of the shaft [rad]."""
        return self.revolution.angle.ravel()

    @property
    def speed(self) -> Array:
        """Speed phi' of the shaft [rad/s]."""
        return self.revolution.speed.ravel()

    @property
    def least_speed(self) -> float:
        """Smallest phi' over the revolution [rad/s]."""
        return math.sqrt(2 * self.revolution.energy_range[0])

    @property
    def largest_speed(self) -> float:
        """Largest phi' over the revolution [rad/s]."""
        return math.sqrt(2 * self.revolution.energy_range[1])

    @property
    def _of_shaft(self):
        """Speed and acceleration of the shaft."""
        return self.speed, self.revolution.acceleration.ravel()

    @property
    def motor_torque(self) -> Array:
        """Torque g T of the motor on the shaft [N m]."""
        return self.drive.torque(*self._of_shaft)

    @property
    def motor_power(self) -> Array:
        """Power T w of the motor [W]."""
        return self.drive.power(*self._of_shaft)

    @property
    def belt_torque(self) -> Array:
        """Torque on the motor pulley [N m]."""
        return self.drive.belt_torque(*self._of_shaft)

    @cached_property
    def shaft_torque(self) -> Array:
        """Load torque of all carts [N m]."""
        revolution = self.revolution
        return self.load.torque(revolution.angle, revolution.energy, revolution.acceleration).ravel()

    def largest(self, quantity: Callable[[rigid_drive.DriveState], Array]) -> float:
        """Return the largest |quantity(state)| of the first cart over the revolution, also between samples."""
        return self._largest_of_shaft(lambda *at: quantity(self.load.states_at(*at)[0]))

    @cached_property
    def peak_jerk(self) -> float:
        """Largest |jerk| of the first cart [m/s^3]; infinite if velocity or acceleration of the law jumps."""
        return math.inf if self.shocks else self.largest(lambda state: state.jerk)

    def _largest_of_shaft(self, quantity: Callable[..., Array]) -> float:
        """Largest |quantity(angle, energy, acceleration, jerk)| over the revolution, also between samples."""
        evaluate, grid = self.revolution.evaluate, interior_grid(self.revolution.breaks, steps=PEAK_STEPS)
        return find_maximum(lambda angle: np.abs(quantity(angle, *evaluate(angle))), grid)[0]

    def _largest_of_motor(self, quantity: Callable[..., Array]) -> float:
        """Largest |quantity(speed, acceleration)| of the shaft."""
        return self._largest_of_shaft(lambda _, energy, acceleration, __: quantity(np.sqrt(2 * energy), acceleration))

    @cached_property
    def peak_motor_torque(self) -> float:
        """Largest |T| of the motor [N m]."""
        return self._largest_of_motor(self.drive.torque) / self.drive.gear_ratio

    @cached_property
    def peak_motor_power(self) -> float:
        """Largest |T w| of the motor [W]."""
        return self._largest_of_motor(self.drive.power)

    @cached_property
    def peak_belt_torque(self) -> float:
        """Largest torque on the motor pulley, or on the gear without a belt [N m]."""
        return self._largest_of_motor(self.drive.belt_torque)

    @property
    def belt_creep(self) -> float:
        """Largest |creep| of the belt [-]; 0 without one."""
        belt = self.drive.belt
        return 0.0 if belt is None else self.peak_belt_torque / belt.creep_torque

    @property
    def belt_loss(self) -> float:
        """Energy lost between motor and shaft over the revolution [J]."""
        return float(np.sum(self.weights * (self.motor_power - self.motor_torque * self.speed)))

    def require_no_slip(self) -> None:
        """Require a belt torque within the slip limit."""
        belt = self.drive.belt
        if belt is not None and (torque := self.peak_belt_torque) > belt.slip_torque:
            raise RuntimeError(
                f"the belt slips under '{self.name}': {torque:.4g} N m on the motor pulley, its limit is "
                f"{belt.slip_torque:.4g} N m; use a preload of at least {belt.required_preload(torque):.4g} N, or more "
                "wrap"
            )

    @property
    def fluctuation(self) -> float:
        """Coefficient of speed fluctuation of the shaft, (phi'_max - phi'_min)/phi'_mean [-], mean over time."""
        return (self.largest_speed - self.least_speed) * self.period / (2 * math.pi)

    @cached_property
    def rigid(self) -> rigid_drive.Run:
        """Run at uniform speed in the period of the law."""
        return rigid_drive.Run(self.cart, self.cycle, self.resistance, self.working, self.drive.rod)

    @cached_property
    def drawn_energy(self) -> float:
        """Work of a motor without energy recovery over the revolution [J]."""
        return float(np.sum(self.weights * np.maximum(self.motor_power, 0.0)))

    @cached_property
    def nonuniformity(self) -> float:
        """(v_max - v_min)/v_mean over the working part of the forward stroke [-]."""
        share = np.linspace(*self.working, rigid_drive.NONUNIFORMITY_SAMPLES)[None]
        angle = 2 * np.pi * self.cycle.forward.duration / self.cycle.period * share
        energy, acceleration, _ = self.revolution.evaluate(angle)
        state = self.load.states_at(angle, energy, acceleration)[0]
        time = np.trapezoid(1 / np.sqrt(2 * energy[0]), angle[0])
        return float(np.ptp(state.velocity) * time / np.ptp(state.position[0, [0, -1]]))

    @cached_property
    def energy_residual(self) -> float:
        """Energy-balance residual of motor, carts and shaft over int |load power| dt [-]."""
        driving, loading = self.speed * np.array([self.motor_torque, self.shaft_torque])
        gain = self.drive.inertia * (self.revolution.energy[-1, -1] - self.revolution.energy[0, 0])
        return float(abs(np.sum(self.weights * (driving - loading)) - gain) / np.sum(self.weights * np.abs(loading)))


@dataclass(frozen=True)
class AccelerationPhase:
    """Acceleration phase of a motor drive; arrays of shape (n,).

    Parameters
    ----------
    time, angle, speed : ndarray
        Time [s] and angle of the shaft [rad] since the start, and its speed [rad/s].
    energy_residual : float
        Energy-balance residual over the work of the motor [-].
    """

    time: Array
    angle: Array
    speed: Array
    energy_residual: float


def simulate_acceleration_phase(periodic: MotorRun) -> AccelerationPhase:
    """Simulate the acceleration phase of carts and shaft from rest to a periodic regime.

    Parameters
    ----------
    periodic : MotorRun
        Run of the periodic regime.

    Raises
    ------
    RuntimeError
        If the motor does not start or stalls, the belt slips, or `MAX_REVOLUTIONS` do not suffice.
    """
    motor, load, target, breaks = periodic.drive, periodic.load, periodic.speed[0], periodic.load.breaks()
    first = _first_instant(motor, load)
    parts = [(np.zeros(1),) * 3, tuple(np.array([value]) for value in first)]
    # sections of the first revolution are graded to the first break, since the energy grows by decades
    edges = first[1] * GRADING ** np.arange(math.floor(math.log(breaks[1] / first[1], GRADING)))
    works, sections = np.zeros(2), list(map(np.array, pairwise([*edges, *breaks[1:]])))
    for revolution in range(MAX_REVOLUTIONS):
        for section in [breaks] if revolution else sections:
            solution = solve_shaft_speed(partial(motor.residual, load), section, parts[-1][2][-1], periodic=False)
            run = replace(periodic, revolution=solution)
            run.require_no_slip()
            works = works + run.speed * np.array([run.motor_torque, run.shaft_torque]) @ run.weights
            parts.append((parts[-1][0][-1] + run.time, 2 * np.pi * revolution + run.angle, run.speed))
        if abs(run.speed[-1] - target) <= PERIODIC_TOLERANCE * target:
            break
    else:
        raise RuntimeError(
            f"the shaft turns at {run.speed[-1]:g} of {target:g} rad/s after {MAX_REVOLUTIONS} revolutions; use more "
            "torque or a smaller flywheel"
        )
    time, angle, speed = (np.concatenate(column) for column in zip(*parts, strict=True))
    residual = abs(works[0] - works[1] - motor.inertia * speed[-1] ** 2 / 2) / works[0]
    return AccelerationPhase(time, angle, speed, float(residual))


def _first_instant(motor: Motor, load: CartsOnShaft) -> tuple[float, float, float]:
    """Time [s], angle [rad] and speed [rad/s] an instant after the start: w^2 = 2 w' phi under the torque at rest."""
    angle, rest = FIRST_ANGLE * load.breaks()[1], np.zeros((1, 1))
    place, energy = np.full((1, 1), angle), np.full((1, 1), REST_ENERGY * motor.curve.no_load_speed**2)
    static, unit = (motor.residual(load, place, energy, rest + step) for step in (0.0, 1.0))
    acceleration = float((-static / (unit - static))[0, 0])
    if not acceleration > 0:
        torque = float(motor.torque(np.zeros(())))
        raise RuntimeError(
            f"the motor does not start: it delivers {torque:g} N m on the shaft at rest, less than friction holds; "
            "use more torque or a larger `gear_ratio`, or start at a dead centre"
        )
    speed = float(np.sqrt(2 * acceleration * angle))
    return speed / acceleration, angle, speed
