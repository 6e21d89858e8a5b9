"""Inverse dynamics of a cart under an imposed law: force and power of a rigid drive or a crank, and their peaks.

    drive force H = m a + resistance(v, a) + guide friction - end springs,  drive power = H v

`resistance` is any callable of velocity [m/s] and acceleration [m/s^2] that gives the force of the mix on all rollers
of one cart [N], odd in both. It is set-valued at rest; there the drive meets its limit from inside the motion.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from compact.machine.cart import Balance, Cart, balance
from compact.numerics.piecewise import BREAK_OFFSET, clenshaw_curtis, find_maximum, interior_grid
from compact.numerics.validation import require_opposing, require_positive

POINTS = 129  # per piece of a motion, at Chebyshev's points: integrals of smooth laws to rounding
CREEP = 1e-12  # share of the mean velocity that stands for "just moving" at rest


@dataclass(frozen=True)
class Rigid:
    """A drive that imposes the law exactly and pushes along the travel (cam, rack)."""

    def rod_tangent(self, time, period):
        """tan(beta) of the rod at time [s]: none."""
        return np.zeros(np.shape(time))


@dataclass(frozen=True)
class Crank:
    """Crank and connecting rod in line with the pin; psi from the outer dead centre, uniform rotation.

        sin(beta) = (r/l) sin(psi),  x = r (1 - cos psi) + l (1 - cos beta)

    radius : r [m]; rod_length : l > r [m]. The crank pin is above the line on the way to the crank.
    """

    radius: float
    rod_length: float

    def __post_init__(self):
        require_positive(radius=self.radius, rod_length=self.rod_length)
        if not self.rod_length > self.radius:
            raise ValueError(f"`rod_length` must exceed the crank radius {self.radius:g} m, got {self.rod_length!r}")

    def rod_angle(self, psi):
        """beta [rad] at crank angle psi [rad]."""
        return np.arcsin(self.radius / self.rod_length * np.sin(psi))

    def rod_tangent(self, time, period):
        """tan(beta) of the rod at time [s] from the outer dead centre."""
        return np.tan(self.rod_angle(2 * np.pi * np.asarray(time) / period))


class State(NamedTuple):
    """Cart and drive at some phases of a leg; arrays of one shape, SI."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    jerk: np.ndarray
    resistance: np.ndarray
    rod_tangent: np.ndarray
    forces: Balance

    @property
    def drive_power(self):
        """H v [W]."""
        return self.forces.drive_force * self.velocity


@dataclass(frozen=True)
class InverseDynamics:
    """What a cycle asks of a drive, at any phase: inverse dynamics of one cart against one resistance."""

    cart: Cart
    drive: Rigid | Crank
    cycle: object
    resistance: Callable

    def at(self, leg, phase):
        """`State` at phases of a leg, ndarray of any shape."""
        travel = [leg.at_phase(phase, order) for order in range(4)]
        moving = self._moving(leg, travel[1])
        time = leg.start + leg.duration * phase
        met = evaluate_resistance(self.resistance, moving, travel[2])
        tangent, push = self.drive.rod_tangent(time, self.cycle.period), self._push(leg, phase, travel[0])
        return State(*travel, met, tangent, balance(self.cart, travel[2], met, np.sign(moving), tangent, push))

    def breaks(self, leg):
        """Phases of a leg between which all is smooth, ends among them: joins of the law, and where springs are met."""
        return leg.breakpoints() if self.cart.end_springs is None else self._zones[leg.start].breaks

    def _push(self, leg, phase, position):
        springs = self.cart.end_springs
        return 0.0 if springs is None else springs.push(position, self._zones[leg.start].at(phase))

    @cached_property
    def _zones(self):
        zones = self.cart.end_springs.zones
        return {
            leg.start: zones(lambda phase, leg=leg: leg.at_phase(phase, 0), leg.breakpoints())
            for leg in self.cycle.legs()
        }

    def _moving(self, leg, velocity):
        """The velocity, at rest the limit from inside the motion."""
        creep = CREEP * self.cycle.forward.stroke / self.cycle.forward.duration
        return np.where(np.abs(velocity) < creep, leg.direction * creep, velocity)


def evaluate_resistance(resistance, velocity, acceleration):
    """Resistance [N] of the shape of velocity; 0 where it stands still, which asks nothing of the drive.

    Raises ValueError where the resistance is not finite.
    """
    met = np.zeros(np.shape(velocity))
    moves = np.asarray(velocity) != 0
    met[moves] = resistance(velocity[moves], acceleration[moves])
    if not np.all(np.isfinite(met)):
        worst = tuple(np.argwhere(~np.isfinite(met))[0])
        raise ValueError(
            f"`resistance` must be finite, got {met[worst]} at velocity {velocity[worst]:g} m/s "
            f"and acceleration {acceleration[worst]:g} m/s^2"
        )
    return met


class CycleStatistics:
    """Means over a cycle, of any run with `time`, `weights` [s], `period`, `drive_force`, `drive_power`."""

    @cached_property
    def rms_force(self):
        """Root mean square of H over the cycle [N]; infinite where the velocity jumps."""
        return math.inf if self.impulses else math.sqrt(self._mean(self.drive_force**2))

    @cached_property
    def rms_power(self):
        """Root mean square of H v over the cycle [W]; infinite where the velocity jumps."""
        return math.inf if self.impulses else math.sqrt(self._mean(self.drive_power**2))

    @cached_property
    def mean_force(self):
        """Mean of |H| over the cycle [N]; infinite where the velocity jumps."""
        return math.inf if self.impulses else self._mean(np.abs(self.drive_force))

    @cached_property
    def mean_power(self):
        """Mean of H v over the cycle [W]."""
        return self._mean(self.drive_power)

    @cached_property
    def energy(self):
        """Net work of the drive over the cycle [J]: what resistance and friction took."""
        return self.mean_power * self.period

    @property
    def dynamic_factor(self):
        """Peak force over the force that keeps the mean speed."""
        return self.peak_force / self.steady_force if self.steady_force else math.inf

    @property
    def ringing(self):
        """Peak force over that of a drive that imposes the law: 1 where this one does."""
        return 1.0

    def share(self, holds):
        """Share of the cycle in which something holds(velocity, acceleration) of the cart, to 1 %."""
        return self._mean(holds(self.state.velocity, self.state.acceleration))

    def _mean(self, values):
        return float(np.sum(self.weights * values) / self.period)


@dataclass(frozen=True)
class Run(CycleStatistics):
    """One cycle of a cart under one law, sampled; arrays of shape (n,), pieces of the motion one after another.

    A join appears twice, with its values before and after. `weights` [s] integrate over the cycle. `impulses` are
    the jumps of velocity, `shocks` those of velocity or acceleration, as `Discontinuity`s of the motion.
    """

    demand: InverseDynamics
    time: np.ndarray
    weights: np.ndarray
    direction: np.ndarray
    state: State
    steady_force: float
    nonuniformity: float
    impulses: tuple
    shocks: tuple

    @property
    def name(self):
        """Name of the law."""
        return self.demand.cycle.forward.name

    @property
    def period(self):
        """Time of the cycle [s]."""
        return self.demand.cycle.period

    @property
    def drive_force(self):
        """H [N], along the travel."""
        return self.state.forces.drive_force

    @property
    def drive_power(self):
        """H v [W]; negative where the cart drives the drive."""
        return self.state.drive_power

    @cached_property
    def peak_force(self):
        """Largest |H| [N]; infinite where the velocity jumps."""
        if self.impulses:
            return math.inf
        return self._largest(lambda leg, phase: self.demand.at(leg, phase).forces.drive_force)

    @cached_property
    def peak_power(self):
        """Largest |H v| [W]; infinite where the velocity jumps."""
        return math.inf if self.impulses else self._largest(lambda leg, phase: self.demand.at(leg, phase).drive_power)

    @cached_property
    def peak_jerk(self):
        """Largest |jerk| [m/s^3]; infinite where velocity or acceleration jumps."""
        return math.inf if self.shocks else self._largest(lambda leg, phase: leg.at_phase(phase, 3))

    @cached_property
    def drawn_energy(self):
        """Work given by a drive that cannot take back what the braking cart returns [J]; jumps of speed included."""
        starts = sum(_kinetic_gain(self.demand.cart.mass, join) for join in self.impulses)
        return self._mean(np.maximum(self.drive_power, 0.0)) * self.period + starts

    def _largest(self, quantity):
        """Largest |quantity(leg, phase)| over the cycle, found on the law itself."""
        return max(
            find_maximum(lambda phase, leg=leg: np.abs(quantity(leg, phase)), interior_grid(self.demand.breaks(leg)))[0]
            for leg in self.demand.cycle.legs()
        )


def _kinetic_gain(mass, join):
    """Kinetic energy [J] that a jump of velocity gives to the cart; what a stop sets free is lost."""
    before = join.before if join.before * join.after > 0 else 0.0
    return max(0.0, mass / 2 * (join.after**2 - before**2))


def simulate(cart, drive, motion, resistance, *, working=(1 / 6, 5 / 6)):
    """`Run` of one cycle with the law imposed exactly (inverse dynamics), or what a drive that yields makes of it.

    Parameters
    ----------
    cart : Cart
    drive : Rigid or Crank, or a drive with an equation of motion of its own, such as `elastic.ElasticDrive`: its `run`
    motion : Motion (there and back without a dwell) or Cycle
    resistance : callable(velocity, acceleration) -> N, of all rollers of the cart, that changes its sign with the
        velocity; `contact.dry_resistance` makes one of a constant force
    working : shares of the pass between which the speed should be even, for `nonuniformity`

    Raises ValueError where the resistance is not finite or does not oppose the motion, and where a crank is given
    another law than its own.
    """
    if not 0 <= working[0] < working[1] <= 1:
        raise ValueError(f"`working` must be two shares, 0 <= first < second <= 1, got {working!r}")
    cycle = motion if hasattr(motion, "legs") else motion.cycle()
    if hasattr(drive, "run"):
        return drive.run(cart, cycle, resistance, working)
    require_law_of_drive(drive, cycle)
    require_opposing(resistance, cycle.forward.stroke / cycle.forward.duration)
    demand = InverseDynamics(cart, drive, cycle, resistance)
    time, weights, direction, state = _sampled(demand)
    joins = cycle.discontinuities()
    return Run(
        demand=demand,
        time=time,
        weights=weights,
        direction=direction,
        state=state,
        steady_force=steady_force(cart, cycle.forward, resistance),
        nonuniformity=_nonuniformity(cycle.forward, working),
        impulses=tuple(join for join in joins if join.order == 1),
        shocks=tuple(join for join in joins if join.order <= 2),
    )


def _sampled(demand):
    """Time, weights, direction and `State` at Chebyshev's points of every piece, ends included from inside."""
    nodes, unit_weights = clenshaw_curtis(POINTS)
    columns = []
    for leg in demand.cycle.legs():
        breaks = demand.breaks(leg)[:, None]
        low, high = breaks[:-1] + BREAK_OFFSET, breaks[1:] - BREAK_OFFSET
        phase = np.clip(low + (high - low) * nodes, low, high)
        time, weights = leg.start + leg.duration * phase, leg.duration * np.diff(breaks, axis=0) * unit_weights
        state = demand.at(leg, phase)
        parts = (time, weights, np.full(phase.shape, float(leg.direction)), *state[:-1], *astuple(state.forces))
        columns.append([part.ravel() for part in parts])
    time, weights, direction, *rest = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    return time, weights, direction, State(*rest[:6], Balance(*rest[6:]))


def steady_force(cart, motion, resistance):
    """|H| that keeps the mean speed of a motion [N]."""
    return abs(float(steady_balance(cart, motion.stroke / motion.duration, resistance).drive_force[0]))


def steady_balance(cart, speed, resistance):
    """Forces on a cart at a constant speed > 0 [m/s], a `Balance` of arrays of shape (1,)."""
    none = np.zeros(1)
    return balance(cart, none, evaluate_resistance(resistance, np.array([speed]), none), 1.0)


def _nonuniformity(motion, working):
    """(v_max - v_min)/v_mean over the working part of the way there."""
    time = np.linspace(*working, 2001) * motion.duration
    velocity, ends = motion.velocity(time), motion.position(time[[0, -1]])
    mean = (ends[1] - ends[0]) / (time[-1] - time[0])
    return float((velocity.max() - velocity.min()) / mean)


def require_law_of_drive(drive, cycle):
    """Refuse a cycle that the crank does not turn; other drives turn every one."""
    if not isinstance(drive, Crank):
        return
    psi = np.linspace(0, np.pi, 9)
    travel = drive.radius * (1 - np.cos(psi)) + drive.rod_length * (1 - np.cos(drive.rod_angle(psi)))
    gap = np.abs(cycle.forward.at_phase(psi / np.pi, 0) - travel).max()
    if gap > 1e-9 * cycle.forward.stroke:
        raise ValueError(
            f"a crank turns its own law only, got '{cycle.forward.name}' that differs by {gap:g} m; "
            f"use Rigid(), or law('crank', ..., rod_length={drive.rod_length:g})"
        )
    if cycle.period > 2 * cycle.forward.duration:
        dwells = cycle.period - 2 * cycle.forward.duration
        raise ValueError(f"a crank does not stop, got dwells of {dwells:g} s in all; use Rigid(), or no dwells")
