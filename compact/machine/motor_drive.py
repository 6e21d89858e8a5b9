"""The motor drive: carts on one shaft that a motor turns at a speed of its own, with gear and flywheel.

    J phi'' = g T(g phi') - sum over carts of H x'(phi),  J = J_flywheel + g^2 J_motor

A turn of the shaft is a cycle of the law, x(phi) = y(T phi/2 pi): a cam, or a crank with its own law. H is the drive
force of each cart at v = x' phi' and a = x'' phi'^2 + x' phi'' (`cart.balance`); T is the motor's torque over its
speed, g its speed over the shaft's. Where a cart turns x' = 0, so that the jump of the friction asks no torque. Behind
a belt (`belt`) the motor runs ahead of g phi' by what the belt creeps under T - J_motor g phi'', its load.

The start of a motor drive: from rest through as many turns of the shaft as it takes to reach its periodic regime.

    J w' = g T(g w) - sum over carts of H x'(phi),  phi' = w

The angle is the variable, turn by turn as in the periodic regime (`shaft`), on elements that are graded towards the
start, where w is the root of it. What stands is held by its friction: a motor too weak for carts that do not begin at a
dead centre does not start.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from compact.dynamics.shaft_speed import Turning, turning
from compact.machine.cart import Balance, Cart, balance
from compact.machine.motor_characteristics import Belt
from compact.machine.rigid_drive import (
    CREEP,
    Crank,
    CycleStatistics,
    Rigid,
    State,
    evaluate_resistance,
    require_law_of_drive,
    simulate,
    steady_force,
)
from compact.numerics.piecewise import find_maximum, interior_grid
from compact.numerics.validation import (
    require_finite,
    require_nonnegative,
    require_opposing,
    require_positive,
)

RIGID = Rigid()
SPEEDS = 200  # trial speeds between rest and no load, for the first guess


@dataclass(frozen=True)
class Motor:
    """A motor drive: what turns the shaft, and what hangs on it.

    curve : one of `torque`, or anything with `torque(speed)` and `no_load_speed`;  gear_ratio : g, motor over shaft
    motor_inertia, flywheel_inertia : of the rotor, and on the shaft [kg m^2];  angles : of each cart ahead [rad]
    rod : Rigid (a cam) or Crank;  belt : between motor and gear, or None; g holds the ratio of its pulleys
    """

    curve: object
    gear_ratio: float
    motor_inertia: float
    flywheel_inertia: float
    angles: tuple[float, ...] = (0.0,)
    rod: Rigid | Crank = RIGID
    belt: Belt | None = None

    def __post_init__(self):
        require_positive(gear_ratio=self.gear_ratio)
        require_nonnegative(motor_inertia=self.motor_inertia, flywheel_inertia=self.flywheel_inertia)
        require_finite(angles=self.angles)
        if not self.angles:
            raise ValueError("`angles` must hold one angle per cart, got none")

    @property
    def inertia(self):
        """J on the shaft [kg m^2]."""
        return self.flywheel_inertia + self.gear_ratio**2 * self.motor_inertia

    def torque(self, speed, acceleration=0.0):
        """g T [N m] on the shaft at its speed [rad/s] and acceleration [rad/s^2], which moves a belt alone."""
        return self.gear_ratio * self.curve.torque(self.speed(speed, acceleration))

    def speed(self, speed, acceleration=0.0):
        """Of the motor [rad/s] at those of the shaft: g phi' without a belt."""
        geared = self.gear_ratio * speed
        if self.belt is None:
            return geared
        return self.belt.motor_speed(lambda own: self.curve.torque(own) - self._spins_up(acceleration), geared)

    def power(self, speed, acceleration):
        """T w [W] of the motor, w its own speed, at speed [rad/s] and acceleration [rad/s^2] of the shaft."""
        return self.torque(speed, acceleration) / self.gear_ratio * self.speed(speed, acceleration)

    def belt_torque(self, speed, acceleration):
        """What the motor puts on the belt, or straight on the gear [N m]."""
        return self.torque(speed, acceleration) / self.gear_ratio - self._spins_up(acceleration)

    def _spins_up(self, acceleration):
        """What the rotor takes for itself [N m]."""
        return self.motor_inertia * self.gear_ratio * acceleration

    def run(self, cart, cycle, resistance, working):
        """The periodic `MotorRun`: what `rigid_drive.simulate` asks of a drive."""
        return simulate_motor(cart, self, cycle, resistance, working=working)


@dataclass(frozen=True)
class Load:
    """Carts alike on one shaft: what they ask at an angle; `period` is that of the law at even speed."""

    cart: Cart
    motor: Motor
    cycle: object
    resistance: Callable

    def breaks(self):
        """Angles in [0, 2 pi] where the law of any cart joins its pieces, ends among them."""
        rate = 2 * np.pi / self.cycle.period
        joins = np.concatenate([rate * (leg.start + leg.duration * leg.breakpoints()) for leg in self.cycle.legs()])
        every = np.mod(np.subtract.outer(joins, self.motor.angles).ravel(), 2 * np.pi)
        if self.cart.end_springs is not None:
            met = np.mod(np.subtract.outer(self._zones.breaks, self.motor.angles).ravel(), 2 * np.pi)
            every = np.append(every, met)
        edges = np.unique(np.append(every, [0.0, 2 * np.pi]))
        return np.append(edges[:-1][np.diff(edges) > 1e-9], 2 * np.pi)

    def at(self, angle, energy, acceleration, jerk=0.0):
        """A `State` for each cart at angles; E = phi'^2/2, phi'' and what follows, arrays of shape (pieces, n)."""
        turned = [np.mod(angle + ahead, 2 * np.pi) for ahead in self.motor.angles]
        return [self._cart(angle, energy, acceleration, jerk) for angle in turned]

    def _cart(self, angle, energy, acceleration, jerk):
        x, slope, curvature, third = self.travel(angle)
        speed = np.sqrt(2 * energy)
        velocity, pace = slope * speed, curvature * 2 * energy + slope * acceleration
        direction = np.sign(slope.mean(axis=-1, keepdims=True))
        creep = CREEP * self.cycle.forward.stroke / self.cycle.forward.duration
        moving = np.where(np.abs(velocity) < creep, direction * creep, velocity)
        met = evaluate_resistance(self.resistance, moving, pace)
        tangent = self.motor.rod.rod_tangent(angle / (2 * np.pi) * self.cycle.period, self.cycle.period)
        springs = self.cart.end_springs
        push = 0.0 if springs is None else springs.push(x, self._zones.at(angle))
        third = third * speed**3 + 3 * curvature * speed * acceleration + slope * jerk
        return State(
            x, velocity, pace, third, met, tangent, balance(self.cart, pace, met, np.sign(moving), tangent, push)
        )

    @cached_property
    def _zones(self):
        return self.cart.end_springs.zones(lambda angle: self.travel(angle)[0], np.array([0.0, np.pi, 2 * np.pi]))

    def travel(self, angle):
        """x and its first three derivatives by the shaft's angle [rad], within [0, 2 pi)."""
        rate = self.cycle.period / (2 * np.pi)
        return [self.cycle.derivative(angle * rate, order) * rate**order for order in range(4)]

    def torque(self, angle, energy, acceleration):
        """sum of H x' [N m]."""
        states = self.at(angle, energy, acceleration)
        return sum(state.forces.drive_force * state.velocity for state in states) / np.sqrt(2 * energy)

    def residual(self, angle, energy, acceleration):
        """J phi'' + sum of H x' - g T [N m]."""
        driven = self.motor.torque(np.sqrt(2 * energy), acceleration)
        return self.motor.inertia * acceleration + self.torque(angle, energy, acceleration) - driven


def simulate_motor(cart, motor, motion, resistance, *, working=(1 / 6, 5 / 6), start_speed=None, tolerance=1e-9):
    """`MotorRun` of one turn of carts alike on a shaft that a motor turns.

    Parameters
    ----------
    cart : Cart;  motor : Motor;  motion : Motion or Cycle, of which a turn is one cycle
    resistance : callable(velocity, acceleration) -> N
    working : shares of the pass there between which the speed should be even
    start_speed : of the shaft at the start [rad/s], for a turn that is not periodic
    tolerance : of phi'^2, relative

    Raises ValueError for a law whose velocity jumps, which no motor follows, and for a resistance that does not oppose
    the motion; RuntimeError where the motor stalls or its belt slips.
    """
    cycle = motion if hasattr(motion, "legs") else motion.cycle()
    if any(join.order == 1 for join in cycle.discontinuities()):
        raise ValueError(f"the velocity of '{cycle.forward.name}' jumps, which no motor can follow; choose another law")
    require_law_of_drive(motor.rod, cycle)
    require_opposing(resistance, cycle.forward.stroke / cycle.forward.duration)
    load = Load(cart, motor, cycle, resistance)
    guess = _first_speed(load) if start_speed is None else start_speed
    turned = turning(load.residual, load.breaks(), guess, tolerance, periodic=start_speed is None)
    run = MotorRun(load, turned, working)
    run.refuse_slip()
    return run


def _first_speed(load):
    """Highest even speed at which the motor gives, on the mean, what the carts take [rad/s]."""
    breaks = load.breaks()
    angle = np.concatenate([np.linspace(a, b, 18)[None, 1:-1] for a, b in pairwise(breaks)])
    width = np.diff(breaks)[:, None]
    for share in np.linspace(1, 0, SPEEDS, endpoint=False):
        speed = share * load.motor.curve.no_load_speed / load.motor.gear_ratio
        energy = np.full(angle.shape, speed**2 / 2)
        taken = np.sum(width * load.torque(angle, energy, 0 * energy)) / angle.shape[1] / (2 * np.pi)
        if load.motor.torque(speed) >= taken:
            return speed
    raise RuntimeError(
        f"the motor stalls: the carts take {taken:g} N m on the mean at {speed:g} rad/s, it gives "
        f"{load.motor.torque(speed):g} N m on the shaft; give a stronger motor or more gear"
    )


@dataclass(frozen=True)
class MotorRun(CycleStatistics):
    """One turn of the shaft: the first cart, arrays of shape (n,), elements one after another, and the shaft."""

    load: Load
    turn: Turning
    working: tuple[float, float]

    impulses = ()

    @property
    def name(self):
        """Name of the law."""
        return self.load.cycle.forward.name

    @property
    def time(self):
        """Time [s]."""
        return self.turn.time.ravel()

    @property
    def weights(self):
        """Weights [s] that integrate over the turn."""
        return self.turn.weights.ravel()

    @property
    def direction(self):
        """Way of the law: +1 there, -1 back, 0 in a dwell."""
        legs, rate = self.load.cycle.legs(), self.load.cycle.period / (2 * np.pi)
        middle = (self.turn.breaks[:-1] + self.turn.breaks[1:]) / 2 + self.load.motor.angles[0]
        which = np.searchsorted([leg.start for leg in legs], np.mod(middle, 2 * np.pi) * rate) - 1
        return np.repeat(np.array([float(leg.direction) for leg in legs])[which], self.turn.angle.shape[1])

    @cached_property
    def period(self):
        """Time of the turn [s]."""
        return float(self.weights.sum())

    @cached_property
    def steady_force(self):
        """Force that keeps the law's mean speed [N]."""
        return steady_force(self.load.cart, self.load.cycle.forward, self.load.resistance)

    @cached_property
    def state(self):
        """`rigid_drive.State` of the first cart."""
        state = self.load.at(self.turn.angle, self.turn.energy, self.turn.acceleration, self.turn.jerk)[0]
        columns = [column.ravel() for column in state[:-1]]
        return State(*columns, Balance(*(column.ravel() for column in astuple(state.forces))))

    @property
    def drive_force(self):
        """H [N] of the first cart."""
        return self.state.forces.drive_force

    @property
    def drive_power(self):
        """H v [W] of the first cart."""
        return self.state.drive_power

    @property
    def angle(self):
        """phi [rad]."""
        return self.turn.angle.ravel()

    @property
    def speed(self):
        """phi' [rad/s] of the shaft."""
        return self.turn.speed.ravel()

    @property
    def least_speed(self):
        """Least phi' [rad/s] over the turn."""
        return math.sqrt(2 * self.turn.energy_range[0])

    @property
    def largest_speed(self):
        """Largest phi' [rad/s] over the turn."""
        return math.sqrt(2 * self.turn.energy_range[1])

    @property
    def motor_torque(self):
        """g T [N m] on the shaft."""
        return self.load.motor.torque(self.speed, self.turn.acceleration.ravel())

    @property
    def motor_power(self):
        """T w [W] of the motor, w its own speed."""
        return self.load.motor.power(self.speed, self.turn.acceleration.ravel())

    @cached_property
    def belt_torque(self):
        """On the motor's pulley [N m]."""
        return self.load.motor.belt_torque(self.speed, self.turn.acceleration.ravel())

    @cached_property
    def peak_motor_torque(self):
        """Largest |T| [N m] of the motor."""
        motor = self.load.motor
        return self._largest_of_shaft(motor.torque) / motor.gear_ratio

    @cached_property
    def peak_belt_torque(self):
        """Largest torque on the motor's pulley, or straight on the gear [N m]."""
        return self._largest_of_shaft(self.load.motor.belt_torque)

    @property
    def belt_creep(self):
        """Largest |creep| of the belt; 0 without one."""
        belt = self.load.motor.belt
        return 0.0 if belt is None else self.peak_belt_torque / belt.creep_torque

    @property
    def belt_loss(self):
        """What the motor gives over the turn and the shaft does not get [J]."""
        return float(np.sum(self.weights * (self.motor_power - self.motor_torque * self.speed)))

    def refuse_slip(self):
        """RuntimeError, with the preload that would hold, where a belt slips."""
        belt = self.load.motor.belt
        if belt is not None and (asked := self.peak_belt_torque) > belt.holds:
            raise RuntimeError(
                f"the belt slips under '{self.name}': {asked:.4g} N m on the motor's pulley, it holds "
                f"{belt.holds:.4g}; give a preload of at least {belt.needed_preload(asked):.4g} N, or more wrap"
            )

    @cached_property
    def shaft_torque(self):
        """What all carts take [N m]."""
        return self.load.torque(self.turn.angle, self.turn.energy, self.turn.acceleration).ravel()

    @property
    def fluctuation(self):
        """(phi'_max - phi'_min)/phi'_mean of the shaft, the mean over time."""
        return (self.largest_speed - self.least_speed) * self.period / (2 * math.pi)

    @property
    def shocks(self):
        """Jumps of the law's acceleration, as `Discontinuity`s at the even speed."""
        return tuple(join for join in self.load.cycle.discontinuities() if join.order == 2)

    @cached_property
    def peak_jerk(self):
        """Largest |jerk| [m/s^3] of the first cart; infinite where the law's acceleration jumps."""
        return math.inf if self.shocks else self._largest(lambda states: states[0].jerk)

    @cached_property
    def peak_force(self):
        """Largest |H| [N] of the first cart."""
        return self._largest(lambda states: states[0].forces.drive_force)

    @cached_property
    def ringing(self):
        """Peak force of the first cart over that of a drive that turns evenly, in the law's own time."""
        load = self.load
        return self.peak_force / simulate(load.cart, load.motor.rod, load.cycle, load.resistance).peak_force

    @cached_property
    def peak_power(self):
        """Largest |H v| [W] of the first cart."""
        return self._largest(lambda states: states[0].drive_power)

    @cached_property
    def peak_motor_power(self):
        """Largest |T w| [W] of the motor."""
        return self._largest_of_shaft(self.load.motor.power)

    @cached_property
    def drawn_energy(self):
        """Work of a motor over the turn that cannot take any back [J]."""
        return float(np.sum(self.weights * np.maximum(self.motor_power, 0.0)))

    @cached_property
    def nonuniformity(self):
        """(v_max - v_min)/v_mean of the first cart over the working part of the law's way there."""
        first, last = (share * self.load.cycle.forward.duration / self.load.cycle.period for share in self.working)
        angle = 2 * np.pi * np.linspace(first, last, 2001)
        energy, acceleration, _ = self.turn.at(angle[None])
        velocity = self.load.at(angle[None], energy, acceleration)[0].velocity
        time = np.trapezoid(1 / np.sqrt(2 * energy[0]), angle)
        travelled = np.diff(self.load.travel(angle[[0, -1]])[0])[0]
        return float((velocity.max() - velocity.min()) * time / travelled)

    @cached_property
    def energy_residual(self):
        """|work on the shaft - what the carts take - gain of the shaft| over the work turned over."""
        power = self.speed * np.array([self.motor_torque, self.shaft_torque])
        gain = self.load.motor.inertia * (self.turn.energy[-1, -1] - self.turn.energy[0, 0])
        return float(abs(np.sum(self.weights * (power[0] - power[1])) - gain) / np.sum(self.weights * np.abs(power[1])))

    def _largest(self, quantity):
        """Largest |quantity| of the carts' `State`s over the turn, found on the solution itself."""
        return self._top(lambda angle: quantity(self.load.at(angle, *self.turn.at(angle))))

    def _largest_of_shaft(self, quantity):
        """Largest |quantity(speed, acceleration)| of the shaft over the turn, found on the solution itself."""

        def over(angle):
            energy, acceleration, _ = self.turn.at(angle)
            return quantity(np.sqrt(2 * energy), acceleration)

        return self._top(over)

    def _top(self, over):
        return find_maximum(lambda angle: np.abs(over(angle)), interior_grid(self.turn.breaks, steps=12))[0]


NEAR = 1e-3  # relative distance from the periodic speed at the start of a turn, at which it is reached
MOST = 2000  # turns
FIRST = 1e-10  # of the first piece of a turn, over which the torque at rest acts
GRADE = 4.0  # times longer is each element after the start
LEAST = 1e-30  # of the square of the speed without load: rest
TOLERANCE = 1e-9  # of w^2, relative


@dataclass(frozen=True)
class RunUp:
    """A start; arrays of shape (n,): time [s], angle of the shaft from the start [rad], its speed [rad/s].

    turns : whole ones until the periodic regime, `periodic`, is reached
    motor_work, taken : of the motor on the shaft and by the carts [J];  residual : of their balance, over the former
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    turns: int
    motor_work: float
    taken: float
    residual: float
    periodic: MotorRun


def runup(cart, motor, motion, resistance, *, near=NEAR):
    """The `RunUp` of carts alike on a shaft that stands, until its speed is within `near` of the periodic one.

    cart, motor, motion, resistance : as of `motor.revolve`

    Raises RuntimeError where the motor does not start, stalls or slips its belt on its way, or takes more than 2000
    turns.
    """
    require_positive(near=near)
    periodic = simulate_motor(cart, motor, motion, resistance)
    wanted = periodic.speed[0]
    load, breaks = periodic.load, periodic.load.breaks()
    done, works = [tuple(np.array([value]) for value in _first(load))], np.zeros(2)
    for turn in range(MOST):
        for stretch in [breaks] if turn else _graded(done[0][1][0], breaks):
            turned = turning(load.residual, stretch, done[-1][2][-1], TOLERANCE, periodic=False)
            run = MotorRun(load, turned, periodic.working)
            run.refuse_slip()
            power = run.speed * np.array([run.motor_torque, run.shaft_torque])
            works = works + power @ run.weights
            done.append((done[-1][0][-1] + run.time, 2 * np.pi * turn + run.angle, run.speed))
        if abs(run.speed[-1] - wanted) <= near * wanted:
            break
    else:
        reached = f"{run.speed[-1]:g} of {wanted:g} rad/s after {MOST} turns"
        raise RuntimeError(f"the shaft turns at {reached}; give more torque or less flywheel")
    done.insert(0, (np.zeros(1),) * 3)
    time, angle, speed = (np.concatenate(column) for column in zip(*done, strict=True))
    gain = motor.inertia * speed[-1] ** 2 / 2
    residual = abs(works[0] - works[1] - gain) / works[0]
    return RunUp(time, angle, speed, turn + 1, *works.tolist(), float(residual), periodic)


def _graded(first, breaks):
    """Breaks of the first turn in stretches that are solved one by one, since the energy grows by decades."""
    edges = first * GRADE ** np.arange(math.floor(math.log(breaks[1] / first, GRADE)))
    return [*map(np.array, pairwise([*edges, breaks[1]])), breaks[1:]]


def _first(load):
    """(time, angle, speed) a moment after the start: w^2 = 2 w' phi under the torque at rest."""
    angle, rest = FIRST * load.breaks()[1], np.zeros((1, 1))
    place, least = np.full((1, 1), angle), np.full((1, 1), LEAST * load.motor.curve.no_load_speed**2)
    here, beyond = (load.residual(place, least, rest + step) for step in (0.0, 1.0))
    acceleration = float((-here / (beyond - here))[0, 0])
    if not acceleration > 0:
        raise RuntimeError(
            f"the motor does not start: it gives {load.motor.torque(0.0):g} N m on the shaft at rest, less than what "
            "holds the carts; give more torque or gear, or start at a dead centre"
        )
    speed = float(np.sqrt(2 * acceleration * angle))
    return speed / acceleration, angle, speed
