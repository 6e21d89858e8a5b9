"""Inverse dynamics of a cart under an imposed law: force and power of a rigid drive or a crank, and their peaks.

    drive force H = m a + resistance(v, a) + guide friction - end springs,   drive power = H v

`resistance` is a callable of velocity [m/s] and acceleration [m/s^2] that returns the force of the mix on all rollers
of one cart [N], odd in both. It is set-valued at rest, where the limit from inside the motion applies.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.machine.cart import Balance, Cart, Resistance, balance
from compact.motion.profile import Cycle, Discontinuity, Leg, MotionProfile
from compact.numerics import Array, BoolArray
from compact.numerics.piecewise import (
    BREAK_OFFSET,
    clenshaw_curtis,
    find_maximum,
    find_sign_changes,
    graded_grid,
    interior_grid,
)
from compact.numerics.validation import as_numbers, require_instance, require_opposing, require_positive
from compact.turning import StrokeResistance, StrokeShares

SAMPLES_PER_PIECE = 129  # [-], Chebyshev points per piece of a motion; integrals of smooth laws to rounding
SLOW_SPEED_RATIO = 1e-6  # [-], of the mean speed; ratio of the forces of both headings at a turn
STANDSTILL_SPEED_RATIO = 1e-12  # [-], of the mean speed; stands for the limit v -> 0
WORKING_PART = (1 / 6, 5 / 6)  # [-], of the forward stroke; default part for the nonuniformity
NONUNIFORMITY_SAMPLES = 2001  # [-], of the speed over the working part
PHASE_UNIT = 2.0**-40  # [-], to which roots between pieces are rounded, so that no sample hangs on their last digits
MIN_PIECE_ANGLE = 1e-9  # [rad]; closer joins and dead centres coincide
CRANK_LAW_TOLERANCE = 1e-9  # [-], of the stroke; a law within it is that of the crank


@dataclass(frozen=True)
class Rigid:
    """Drive that imposes the law exactly and pushes along the travel (cam, rack)."""

    def run(self, cart: Cart, cycle: Cycle, resistance: Resistance, working: tuple[float, float]) -> "Run":
        """Run a cart under the law, for `simulate`."""
        return solved(Run(cart, cycle, resistance, working, self))

    def rod_tangent(self, time: ArrayLike, _period: float) -> Array:
        """Return tan(beta) of the rod [-]: zero."""
        return np.zeros(np.shape(time))


@dataclass(frozen=True)
class Crank(Rigid):
    """Crank with uniform rotation and connecting rod, in line with the pin.

        sin(beta) = (r/l) sin(psi),   x = r (1 - cos psi) + l (1 - cos beta)

    psi is counted from the outer dead centre. The crank pin is above the line of travel on the stroke towards the
    crank.

    Parameters
    ----------
    radius : float
        r [m].
    rod_length : float
        l > r [m].
    """

    radius: float
    rod_length: float

    def __post_init__(self) -> None:
        require_positive(radius=self.radius, rod_length=self.rod_length)
        if not self.rod_length > self.radius:
            raise ValueError(f"`rod_length` must exceed the crank radius {self.radius:g} m, got {self.rod_length!r}")

    def rod_angle(self, psi: ArrayLike) -> Array:
        """Return beta [rad] at crank angles psi [rad]."""
        return np.arcsin(self.radius / self.rod_length * np.sin(psi))

    def rod_tangent(self, time: ArrayLike, period: float) -> Array:
        """Return tan(beta) [-] at times [s] from the outer dead centre, for a period [s]."""
        return np.tan(self.rod_angle(2 * np.pi * np.asarray(time) / period))


class DriveState(NamedTuple):
    """Motion of a cart and its forces; arrays of one shape.

    Parameters
    ----------
    position, velocity, acceleration, jerk : ndarray
        [m], [m/s], [m/s^2], [m/s^3].
    resistance : ndarray
        Force of the mix [N].
    rod_tangent : ndarray
        tan(beta) of the rod [-].
    load_share : ndarray
        Share of the roller reactions after a turn [-].
    forces : Balance
        Drive force, reactions and guide friction [N].
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    resistance: Array
    rod_tangent: Array
    load_share: Array
    forces: Balance

    @property
    def drive_power(self) -> Array:
        """Power H v [W]."""
        return self.forces.drive_force * self.velocity

    @property
    def rod_force(self) -> Array:
        """Force of the rod, H/cos(beta), positive in tension [N]."""
        return self.forces.drive_force * np.hypot(1.0, self.rod_tangent)


@dataclass(frozen=True)
class InverseDynamics:
    """Forces that a law requires of a drive, at any phase.

    Parameters
    ----------
    resistance : callable
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2].
    """

    cart: Cart
    drive: Rigid
    cycle: Cycle
    resistance: Resistance

    def state_at(self, leg: Leg, phase: Array) -> DriveState:
        """Solve motion and forces at phases of a leg [-] of any shape."""
        position, velocity, acceleration, jerk = (leg.at_phase(phase, order) for order in range(4))
        tangent = self.drive.rod_tangent(leg.start + leg.duration * phase, self.cycle.period)
        side = None if self.cart.end_springs is None else self._zones[leg.start].side_at(phase)
        return self.solve((position, velocity, acceleration, jerk), leg.direction, tangent, side)

    def solve(
        self, motion: tuple[Array, Array, Array, Array], direction: Any, tangent: Array, side: Array | None
    ) -> DriveState:
        """Solve the forces on the cart in motion; at rest the limit from inside the motion applies.

        Parameters
        ----------
        motion : tuple of ndarray
            Position, velocity, acceleration and jerk [m], [m/s], [m/s^2], [m/s^3].
        direction : int or ndarray
            Sign of the velocity inside the motion, 0 in a dwell.
        tangent : ndarray
            tan(beta) of the rod [-].
        side : ndarray, optional
            Side of the end springs of `SpringZones`; without them by default.
        """
        position, velocity, acceleration, _ = motion
        stroke = self.cycle.forward.stroke
        slowest = STANDSTILL_SPEED_RATIO * stroke / self.cycle.forward.duration
        moving = np.where(np.abs(velocity) < slowest, direction * slowest, velocity)
        share = load = np.ones(position.shape)
        heading = np.sign(moving)
        if self.shares is not None:
            ahead, back = self.shares
            forward = np.where(moving != 0, moving > 0, position > stroke / 2)
            travel = np.maximum(np.where(forward, position, stroke - position), 0.0)
            share = np.where(forward, ahead.force_share(travel), back.force_share(travel))
            load = np.where(forward, ahead.load_share(travel), back.load_share(travel))
            if ahead.force.release and back.force.release:  # in a dwell the mix still pushes
                moving = np.where(moving != 0, moving, np.where(forward, slowest, -slowest))
        force = share * evaluate_resistance(self.resistance, moving, acceleration)
        springs = self.cart.end_springs
        end_force = 0.0 if springs is None or side is None else springs.force(position, side)
        forces = balance(self.cart, acceleration, force, heading, tangent, end_force, load)
        return DriveState(*motion, force, tangent, load, forces)

    def breaks(self, leg: Leg) -> Array:
        """Phases of a leg between which all forces are smooth, ends included."""
        breaks = leg.breakpoints() if self.cart.end_springs is None else self._zones[leg.start].breaks
        return breaks if self.shares is None or not leg.direction else np.union1d(breaks, self._turning[leg.start])

    @cached_property
    def shares(self) -> tuple[StrokeShares, StrokeShares] | None:
        """Shares of force and load over forward and return stroke."""
        return stroke_shares(self.cart, self.cycle.forward.stroke, self.cycle.forward.duration, self.resistance)

    @cached_property
    def _turning(self):
        """Phases of each moving leg at which a share is not smooth, or the reaction of a guide wheel vanishes."""
        stroke, found = self.cycle.forward.stroke, {}
        for leg in self.cycle.legs():
            if leg.direction:
                travels = np.array([each for each in self.shares[leg.direction < 0].travels if each < stroke])
                places = travels if leg.direction > 0 else stroke - travels
                grid = graded_grid(leg.breakpoints())
                joins = find_sign_changes(
                    lambda z, k, leg=leg, at=places: leg.at_phase(z, 0) - at[k], len(places), grid
                )
                grid = graded_grid(np.union1d(leg.breakpoints(), joins))
                roots = np.append(joins, find_sign_changes(partial(self._reaction, leg), 2, grid))
                found[leg.start] = np.round(roots / PHASE_UNIT) * PHASE_UNIT
        return found

    def _reaction(self, leg, phase, wheel):
        """Reactions of guide wheels, 0 or 1, at phases of a leg [N]."""
        forces = self.state_at(leg, phase).forces
        return np.where(wheel == 0, forces.front_reaction, forces.rear_reaction)

    def largest(self, quantity: Callable[[Leg, DriveState], Array]) -> float:
        """Return the largest |quantity(leg, state)| over the cycle, also between samples."""

        def magnitude(leg: Leg, phase: Array) -> Array:
            return np.abs(quantity(leg, self.state_at(leg, phase)))

        return max(
            find_maximum(partial(magnitude, leg), grid, np.abs(quantity(leg, state)))[0]
            for leg, grid, state in self._resolved
        )

    @cached_property
    def _resolved(self):
        """Legs with the grids on which maxima are bracketed, and the states there."""
        grids = [(leg, interior_grid(self.breaks(leg))) for leg in self.cycle.legs()]
        return [(leg, grid, self.state_at(leg, grid)) for leg, grid in grids]

    @cached_property
    def _zones(self):
        """Zones of the end springs for each leg."""
        zones = self.cart.end_springs.zones
        return {
            leg.start: zones(lambda phase, leg=leg: leg.at_phase(phase, 0), leg.breakpoints())
            for leg in self.cycle.legs()
        }


def stroke_shares(
    cart: Cart, stroke: float, duration: float, resistance: Any
) -> tuple[StrokeShares, StrokeShares] | None:
    """Return the shares of force and load over strokes [m] of a duration [s]; None for a step at the turn."""
    if not isinstance(resistance, StrokeResistance):
        return None
    ratio = resistance.force_ratio(SLOW_SPEED_RATIO * stroke / duration)
    return resistance.over(stroke, ratio, cart.return_load_ratio)


def evaluate_resistance(resistance: Resistance, velocity: Array, acceleration: Array) -> Array:
    """Evaluate a resistance [N] far from the turn at velocities [m/s] and accelerations [m/s^2].

    It is 0 in a dwell and required to be finite.
    """
    force = np.zeros(np.shape(velocity))
    moves = np.asarray(velocity) != 0
    force[moves] = resistance(velocity[moves], acceleration[moves])
    if not np.all(np.isfinite(force)):
        worst = tuple(np.argwhere(~np.isfinite(force))[0])
        raise ValueError(
            f"`resistance` must be finite, got {force[worst]} at velocity {velocity[worst]:g} m/s "
            f"and acceleration {acceleration[worst]:g} m/s^2"
        )
    return force


@dataclass(frozen=True)
class Run:
    """One cycle of a cart under a drive: arrays over time, shape (n,), pieces of the motion in order, and statistics.

    A join of pieces appears twice, with its values before and after. This run imposes the law on the cart; those of
    drives that solve an equation of motion have the same statistics over their own motion.

    Parameters
    ----------
    resistance : callable
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2].
    working : tuple of float
        Start and end of the working part of the forward stroke [-], for `nonuniformity`.
    drive : Rigid, Crank, ElasticDrive, Motor or Hydraulic
        Drive of the run.
    """

    cart: Cart
    cycle: Cycle
    resistance: Resistance
    working: tuple[float, float]
    drive: Any

    @cached_property
    def inverse_dynamics(self) -> InverseDynamics:
        """Forces that the law requires of a drive that imposes it."""
        return InverseDynamics(self.cart, self.drive, self.cycle, self.resistance)

    @cached_property
    def samples(self) -> tuple[Array, Array, Array, DriveState]:
        """Time and quadrature weights [s], direction of the law, and state of the cart."""
        return _sample(self.inverse_dynamics)

    @property
    def time(self) -> Array:
        """Time since the start of the forward stroke [s]."""
        return self.samples[0]

    @property
    def weights(self) -> Array:
        """Quadrature weights over the cycle [s]."""
        return self.samples[1]

    @property
    def direction(self) -> Array:
        """Direction of the law: +1 forward, -1 on the return stroke, 0 in a dwell."""
        return self.samples[2]

    @property
    def state(self) -> DriveState:
        """Motion and forces of the cart."""
        return self.samples[3]

    @property
    def rigid(self) -> "Run":
        """Run with the law imposed on the cart itself, such as this one."""
        return self

    def largest(self, quantity: Callable[[DriveState], Array]) -> float:
        """Return the largest |quantity(state)| over the cycle, also between samples."""
        return self.inverse_dynamics.largest(lambda _, state: quantity(state))

    @property
    def impulses(self) -> tuple[Discontinuity, ...]:
        """Jumps of velocity that the drive imposes; a compliant drive turns them into finite forces."""
        return tuple(join for join in self.shocks if join.order == 1)

    @cached_property
    def shocks(self) -> tuple[Discontinuity, ...]:
        """Jumps of velocity or acceleration."""
        return tuple(join for join in self.cycle.discontinuities() if join.order <= 2)

    @cached_property
    def peak_force(self) -> float:
        """Largest |H| [N]; infinite if the velocity jumps."""
        return math.inf if self.impulses else self.largest(lambda state: state.forces.drive_force)

    @cached_property
    def peak_power(self) -> float:
        """Largest |H v| [W]; infinite if the velocity jumps."""
        return math.inf if self.impulses else self.largest(lambda state: state.drive_power)

    @cached_property
    def peak_jerk(self) -> float:
        """Largest |jerk| [m/s^3]; infinite if velocity or acceleration jumps."""
        return math.inf if self.shocks else self.cycle.forward.peaks().jerk

    @cached_property
    def nonuniformity(self) -> float:
        """(v_max - v_min)/v_mean over the working part of the forward stroke [-]."""
        motion = self.cycle.forward
        time = np.linspace(*self.working, NONUNIFORMITY_SAMPLES) * motion.duration
        velocity, ends = motion.velocity(time), motion.position(time[[0, -1]])
        return float((velocity.max() - velocity.min()) / ((ends[1] - ends[0]) / (time[-1] - time[0])))

    @cached_property
    def squared_velocity(self) -> float:
        """J1 of the law over a pass [m^2/s]."""
        return self.cycle.criterion(1)

    @cached_property
    def squared_acceleration(self) -> float:
        """J2 of the law over a pass [m^2/s^3]; infinite if its velocity jumps."""
        return self.cycle.criterion(2)

    @cached_property
    def squared_jerk(self) -> float:
        """J3 of the law over a pass [m^2/s^5]; infinite if its velocity or acceleration jumps."""
        return self.cycle.criterion(3)

    @cached_property
    def squared_snap(self) -> float:
        """J4 of the law over a pass [m^2/s^7]; infinite if its velocity, acceleration or jerk jumps."""
        return self.cycle.criterion(4)

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.cycle.forward.name

    @property
    def period(self) -> float:
        """Duration of the cycle [s]."""
        return self.cycle.period

    @cached_property
    def steady_force(self) -> float:
        """|H| at the constant mean speed of the law [N]."""
        speed = self.cycle.forward.stroke / self.cycle.forward.duration
        return abs(float(steady_balance(self.cart, speed, self.resistance).drive_force[0]))

    @property
    def drive_force(self) -> Array:
        """Drive force H along the travel [N]."""
        return self.state.forces.drive_force

    @property
    def drive_power(self) -> Array:
        """Power H v [W]; negative while the cart returns energy."""
        return self.state.drive_power

    @cached_property
    def drawn_energy(self) -> float:
        """Work of a drive without recovery of the energy that cart or spring return [J], velocity jumps included."""
        starts = sum(_kinetic_gain(self.cart.mass, join) for join in self.impulses)
        return self._mean(np.maximum(self.drive_power, 0.0)) * self.period + starts

    @cached_property
    def rms_force(self) -> float:
        """Root mean square of H [N]; infinite if the velocity jumps."""
        return math.inf if self.impulses else math.sqrt(self._mean(self.drive_force**2))

    @cached_property
    def rms_power(self) -> float:
        """Root mean square of H v [W]; infinite if the velocity jumps."""
        return math.inf if self.impulses else math.sqrt(self._mean(self.drive_power**2))

    @cached_property
    def mean_force(self) -> float:
        """Mean of |H| [N]; infinite if the velocity jumps."""
        return math.inf if self.impulses else self._mean(np.abs(self.drive_force))

    @cached_property
    def mean_power(self) -> float:
        """Mean of H v [W]."""
        return self._mean(self.drive_power)

    @cached_property
    def energy(self) -> float:
        """Net work of the drive over the cycle [J], equal to the losses."""
        return self.mean_power * self.period

    @property
    def dynamic_factor(self) -> float:
        """Peak force over the force at the constant mean speed [-]."""
        return self.peak_force / self.steady_force if self.steady_force else math.inf

    @cached_property
    def dynamic_amplification(self) -> float:
        """Peak force over that of a drive that imposes the law [-]: 1 for such a drive, nan if that is infinite."""
        if self.rigid is self:
            return 1.0
        return self.peak_force / self.rigid.peak_force if math.isfinite(self.rigid.peak_force) else math.nan

    def time_fraction(self, condition: Callable[[Array, Array], BoolArray]) -> float:
        """Fraction of the cycle in which a condition on velocity and acceleration of the cart is true, to 1 % [-]."""
        return self._mean(condition(self.state.velocity, self.state.acceleration))

    def _mean(self, values):
        """Mean over the cycle."""
        return float(np.sum(self.weights * values) / self.period)


def _kinetic_gain(mass: float, join: Discontinuity) -> float:
    """Kinetic energy [J] that a velocity jump supplies to the cart; energy of a stop is lost."""
    before = join.before if join.before * join.after > 0 else 0.0
    return max(0.0, mass / 2 * (join.after**2 - before**2))


def simulate(
    cart: Cart,
    drive: Any,
    motion: MotionProfile | Cycle,
    resistance: Resistance,
    *,
    working: tuple[float, float] = WORKING_PART,
) -> Any:
    """Simulate one cycle of a cart: inverse dynamics under an imposed law, or the motion of a compliant drive.

    Parameters
    ----------
    cart : Cart
    drive : Rigid, Crank, ElasticDrive, Motor or Hydraulic
        Drive; its method `run` returns the run.
    motion : MotionProfile or Cycle
        Law; a `MotionProfile` is repeated without dwells.
    resistance : callable
        Force of the mix on all rollers of the cart [N] of velocity [m/s] and acceleration [m/s^2], with the sign of
        the velocity; `contact.dry_resistance` makes one of a constant force.
    working : tuple of float
        Start and end of the working part of the forward stroke [-], for `nonuniformity`.

    Raises
    ------
    ValueError
        If the resistance is not finite or does not oppose the motion, or if the law is not that of the crank.
    """
    if as_numbers("working", working).shape != (2,) or not 0 <= working[0] < working[1] <= 1:
        raise ValueError(f"`working` must be two fractions, 0 <= first < second <= 1, got {working!r}")
    require_instance(Cart, "a Cart", cart=cart)
    require_instance((MotionProfile, Cycle), "a motion law or its Cycle", motion=motion)
    cycle = motion if isinstance(motion, Cycle) else motion.cycle()
    if not hasattr(drive, "run"):
        require_instance(Rigid, "a drive, such as Rigid()", drive=drive)
    return drive.run(cart, cycle, resistance, working)


def solved(run: Run) -> Run:
    """Solve a run that imposes its law, a subclass of `Run` too; mistakes of law and resistance are raised here."""
    require_law_of_drive(run.drive, run.cycle)
    require_opposing(run.resistance, run.cycle.forward.stroke / run.cycle.forward.duration)
    _ = run.state
    return run


def _sample(dynamics):
    """Time, weights, direction and `DriveState` at Chebyshev points of each piece, ends included from inside."""
    columns = []
    for leg in dynamics.cycle.legs():
        phase, weights = sample_pieces(dynamics.breaks(leg))
        state, direction = dynamics.state_at(leg, phase), np.full(phase.shape, float(leg.direction))
        parts = (leg.start + leg.duration * phase, leg.duration * weights, direction, *state[:-1], *state.forces)
        columns.append([part.ravel() for part in parts])
    time, weights, direction, *rest = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    return time, weights, direction, DriveState(*rest[:7], Balance(*rest[7:]))


def sample_pieces(breaks: Array, unit: float = 1.0) -> tuple[Array, Array]:
    """Return Chebyshev points of each piece between breaks and their weights, shape (pieces, SAMPLES_PER_PIECE).

    Points lie inside the pieces by `BREAK_OFFSET` of a unit of the abscissa.
    """
    nodes, weights = clenshaw_curtis(SAMPLES_PER_PIECE)
    low, high = breaks[:-1, None] + BREAK_OFFSET * unit, breaks[1:, None] - BREAK_OFFSET * unit
    return np.clip(low + (high - low) * nodes, low, high), np.diff(breaks)[:, None] * weights


def steady_balance(cart: Cart, speed: float, resistance: Resistance) -> Balance:
    """Solve the forces on a cart at a constant speed > 0 [m/s]; arrays of shape (1,)."""
    zero = np.zeros(1)
    return balance(cart, zero, evaluate_resistance(resistance, np.array([speed]), zero), 1.0)


def revolution_breaks(angles: Array) -> Array:
    """Return the breaks of a revolution [rad] at angles of any shape, ascending from 0 to 2 pi without close ones."""
    edges = np.unique(np.append(np.mod(angles, 2 * np.pi), [0.0, 2 * np.pi]))
    return np.append(edges[:-1][np.diff(edges) > MIN_PIECE_ANGLE], 2 * np.pi)


def flattened(record: Any) -> Any:
    """Return a named tuple of arrays, or of such tuples, with each array flattened."""
    return record._make(flattened(part) if isinstance(part, tuple) else part.ravel() for part in record)


def require_law_of_drive(drive: Any, cycle: Cycle) -> None:
    """Require the law of the crank without dwells for a crank; other drives accept every law."""
    if not isinstance(drive, Crank):
        return
    psi = np.linspace(0, np.pi, 9)
    travel = drive.radius * (1 - np.cos(psi)) + drive.rod_length * (1 - np.cos(drive.rod_angle(psi)))
    gap = np.abs(cycle.forward.at_phase(psi / np.pi, 0) - travel).max()
    if gap > CRANK_LAW_TOLERANCE * cycle.forward.stroke:
        raise ValueError(
            f"a crank imposes its own law only, got '{cycle.forward.name}', which differs by {gap:g} m; "
            f"use Rigid(), or law('crank', ..., rod_length={drive.rod_length:g})"
        )
    if cycle.period > 2 * cycle.forward.duration:
        dwells = cycle.period - 2 * cycle.forward.duration
        raise ValueError(f"a crank cannot dwell, got dwells of {dwells:g} s in all; use Rigid(), or no dwells")
