"""Elastic drive: a spring and a damper between the imposed motion law and the cart.

    m x'' = H - W(x', x'', s) - guide friction + end springs,   H = k (e - o) + c e',   e = y(t) - x

y is the law, x the cart, H the drive force, positive towards the driven end. With a backlash b the spring is engaged
for e > b/2 (o = b/2) and e < -b/2 (o = -b/2), and slack between; the damper acts throughout. The resistance W is that
of the steady speed, or depends on the acceleration to first order, F(v) + a M(v). During oscillations the added-mass
term is saturated for most of the time; the solution then takes several times as long. A resistance with the attribute
`travels` is called with the travel s since the last turn [m] as a third argument.

W and the guide friction jump at rest and hold the cart there, as does the plate of a preloaded end spring. A
resistance that vanishes with a small power of the speed, such as v^0.02 of a compacting mix, acts like dry friction: a
cart slower than a millionth of the peak speed counts as at rest, and the resistance at that speed holds it.

Two regimes are available: the first cycle from rest, and the periodic regime (`elastic_cycle`).

References
----------
Backlash with parallel damper: A. Kahraman and R. Singh, J. Sound Vib. 142 (1990) 49.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.machine import rigid_drive
from compact.machine.cart import Balance, Cart, balance
from compact.machine.elastic_cycle import CartMotion, SolutionCost
from compact.machine.elastic_motion import MIN_STEP
from compact.machine.spring_cart import (
    CELL_ANGLE,
    CELL_POINTS,
    MAX_SAMPLES,
    OSCILLATION_FLOOR,
    Kinematics,
    Trajectory,
    oscillation_time,
)
from compact.motion.profile import Cycle, Discontinuity, MotionProfile
from compact.numerics import Array
from compact.numerics.validation import require_fields, require_known, require_opposing, require_positive

REGIMES = ("periodic", "rest")
JUMP_TOLERANCE = 1e-6  # [-], of the largest acceleration; smaller jumps are rounding


@dataclass(frozen=True)
class ElasticDrive:
    """Spring and damper between the law and the cart.

    Parameters
    ----------
    stiffness, damping, backlash : float
        k [N/m], > 0; c [N s/m] and b [m], >= 0.
    include_added_mass : bool
        Use the resistance F(v) + a M(v) instead of the steady F(v).
    """

    stiffness: float
    damping: float
    backlash: float = 0.0
    include_added_mass: bool = False

    def __post_init__(self) -> None:
        require_fields(self, positive="stiffness", nonnegative="damping backlash")

    def run(
        self, cart: Cart, cycle: Cycle, resistance: rigid_drive.Resistance, working: tuple[float, float]
    ) -> "ElasticRun":
        """Simulate the periodic regime, for `rigid_drive.simulate`."""
        return simulate_elastic(cart, self, cycle, resistance, working=working)


def simulate_elastic(
    cart: Cart,
    drive: ElasticDrive,
    motion: MotionProfile | Cycle,
    resistance: rigid_drive.Resistance,
    *,
    regime: str = "periodic",
    working: tuple[float, float] = rigid_drive.WORKING_PART,
    tolerance: float = 1e-8,
) -> "ElasticRun":
    """Simulate one cycle of a cart behind a spring.

    Parameters
    ----------
    cart : Cart
        Cart of mass > 0.
    drive : ElasticDrive
        Spring and damper.
    motion : MotionProfile or Cycle
        Law of the driven end; a `MotionProfile` is repeated without dwells.
    resistance : callable
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2], linear in the acceleration, with a jump at
        speed 0 only. A `ResistanceMap` provides its sampled speeds and the limit of |a|/|v| of its linear range. With
        the attribute `travels`, ascending travels [m] at which it is not smooth, it is also a function of the travel
        since the last turn [m]: a product of one of velocity and acceleration and one of the travel, which is 1 beyond
        the last of them and by default.
    regime : str
        "periodic", or "rest": the first cycle of a cart at rest at the near end, with its springs in balance.
    working : tuple of float
        Start and end of the working part of the forward stroke [-], for `nonuniformity`.
    tolerance : float
        Of the resistance, relative to the largest force of inertia and resistance [-].

    Raises
    ------
    ValueError
        If the resistance does not oppose the motion or jumps at a speed other than 0, if the period of the oscillation
        is not resolved, or if the oscillation needs more than `MAX_SAMPLES` samples.
    RuntimeError
        If the integration ends early or no periodic regime is found.

    Notes
    -----
    In double precision a step shorter than `MIN_STEP` of a piece of the law, of duration T, is rounding. A radian of
    the oscillation must last as long, sqrt(m/k) >= MIN_STEP T, which limits the stiffness to m/(MIN_STEP T)^2.
    """
    require_positive(mass=cart.mass, tolerance=tolerance)
    require_known("regime", regime, REGIMES)
    cycle = motion if isinstance(motion, Cycle) else motion.cycle()
    require_opposing(resistance, cycle.forward.stroke / cycle.forward.duration)
    _require_resolved_period(cart, drive, cycle)
    _require_resolvable(cart, drive, cycle, _expected_samples(cart, drive, cycle))
    problem = CartMotion(cart, drive, cycle, resistance, tolerance)
    periodic = regime == "periodic"
    trajectory = problem.solve_periodic() if periodic else problem.integrate(problem.law, problem.rest_state)
    _require_resolvable(cart, drive, cycle, trajectory.sample_count)
    return ElasticRun(cart, cycle, resistance, working, trajectory, problem.cost, drive.include_added_mass)


def _require_resolved_period(cart, drive, cycle):
    """Require an oscillation of which a radian is no shorter than the shortest step."""
    shortest = MIN_STEP * max(leg.duration * np.diff(leg.breakpoints()).max() for leg in cycle.legs())
    if math.sqrt(cart.mass / drive.stiffness) < shortest:
        raise ValueError(
            f"`stiffness` {drive.stiffness:g} N/m: the cart oscillates with a period of "
            f"{2 * math.pi * math.sqrt(cart.mass / drive.stiffness):.3g} s, of which steps of {shortest:.3g} s, the "
            f"shortest in double precision, resolve no radian; use at most {cart.mass / shortest**2:.3g} N/m, or a "
            "rigid drive"
        )


def _expected_samples(cart, drive, cycle):
    """Estimate the samples that resolve the oscillation after each join of the law, outside dwells."""
    decay = drive.damping / (2 * cart.mass)
    square = drive.stiffness / cart.mass - decay**2
    if square <= 0:
        return 0
    pieces = [leg.duration * np.diff(leg.breakpoints()) for leg in cycle.legs() if leg.direction]
    resolved = float(oscillation_time(decay, np.concatenate(pieces)).sum())
    return CELL_POINTS * resolved * math.sqrt(drive.stiffness / cart.mass) / CELL_ANGLE


def _require_resolvable(cart, drive, cycle, samples):
    """Require at most `MAX_SAMPLES` samples; the error states a sufficient damping."""
    if samples <= MAX_SAMPLES:
        return
    frequency = math.sqrt(drive.stiffness / cart.mass)
    excitations = sum(len(leg.breakpoints()) for leg in cycle.legs())
    decay = 2 * excitations * CELL_POINTS * -math.log(OSCILLATION_FLOOR) * frequency / CELL_ANGLE / MAX_SAMPLES
    raise ValueError(
        f"`stiffness` {drive.stiffness:g} N/m with `damping` {drive.damping:g} N s/m: the cart oscillates "
        f"{samples * CELL_ANGLE / CELL_POINTS / (2 * math.pi):.2g} times per cycle, which needs {samples:.2g} samples, "
        f"allowed are {MAX_SAMPLES}; use a rigid drive, or a damping of at least {2 * cart.mass * decay:.2g} N s/m"
    )


@dataclass(frozen=True)
class ElasticRun(rigid_drive.CycleStatistics):
    """One cycle of a cart behind a spring; arrays of shape (n,) resolve the oscillation, intervals in order of time.

    Force and power are those of the driven end, which follows the law.

    Parameters
    ----------
    resistance : callable
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2].
    working : tuple of float
        Working part of the forward stroke [-].
    include_added_mass : bool
        Resistance that depends on the acceleration.
    """

    cart: Cart
    cycle: Cycle
    resistance: rigid_drive.Resistance
    working: tuple[float, float]
    trajectory: Trajectory
    cost: SolutionCost
    include_added_mass: bool

    @cached_property
    def _points(self):
        """Interval indices, places and weights of the samples."""
        return self.trajectory.sample_points()

    @property
    def weights(self) -> Array:
        """Quadrature weights over the cycle [s]."""
        return self._points[2]

    @cached_property
    def time(self) -> Array:
        """Time since the start of the forward stroke [s]."""
        i, u, _ = self._points
        return self.trajectory.intervals.start[i] + self.trajectory.intervals.scale[i] * u

    @cached_property
    def direction(self) -> Array:
        """Direction of the law: +1 forward, -1 on the return stroke, 0 in a dwell."""
        return self.cycle.direction(self.trajectory.intervals.start + 1e-9 * self.period)[self._points[0]]

    @cached_property
    def motion(self) -> Kinematics:
        """Motion and forces of the cart and its spring."""
        i, u, _ = self._points
        return self.trajectory.at(i, u)

    @cached_property
    def state(self) -> rigid_drive.DriveState:
        """Motion and forces of the cart.

        Slower than the integration resolves, mix and guides share its resistance in the ratio of their limits.
        """
        motion, i = self.motion, self._points[0]
        slip, zero = self.trajectory.intervals.slip[i], np.zeros(len(i))
        slowest, acceleration = self.trajectory.cart.knots[0], motion.acceleration
        direction = np.where(slip != 0, slip, np.sign(motion.drive_force + motion.end_spring_force))
        velocity = np.where(slip * motion.velocity > 0, motion.velocity, 0.0)  # rounding at the ends of a slip
        moving = direction * np.maximum(np.abs(velocity), slowest)  # limit from inside the motion
        travel = slip * (motion.position - self.trajectory.intervals.turn[i])
        mix = rigid_drive.evaluate_resistance(self.resistance, moving, self.include_added_mass * acceleration, travel)
        limit = balance(self.cart, zero, mix, direction).drive_force
        share = np.divide(mix, limit, out=np.zeros(mix.shape), where=limit != 0)
        mix = np.where(np.abs(velocity) < slowest, motion.resistance * share, mix)
        reactions = balance(self.cart, acceleration, mix, slip, end_spring_force=motion.end_spring_force)
        forces = Balance(motion.drive_force, reactions.front_reaction, reactions.rear_reaction, motion.resistance - mix)
        return rigid_drive.DriveState(motion.position, velocity, acceleration, motion.jerk, mix, zero, forces)

    @property
    def drive_force(self) -> Array:
        """Drive force H [N], positive towards the driven end."""
        return self.motion.drive_force

    @property
    def drive_power(self) -> Array:
        """Power H y' of the driven end [W]."""
        return self.motion.drive_force * self.motion.driven_velocity

    @cached_property
    def _peaks(self):
        """Largest |H| [N] and |H y'| [W]."""
        return self.trajectory.peak_force_and_power()

    @property
    def peak_force(self) -> float:
        """Largest |H| [N]."""
        return self._peaks[0]

    @property
    def peak_power(self) -> float:
        """Largest |H y'| [W]."""
        return self._peaks[1]

    @cached_property
    def rigid(self) -> rigid_drive.Run:
        """Run with the law imposed on the cart itself."""
        return rigid_drive.simulate(self.cart, rigid_drive.Rigid(), self.cycle, self.resistance, working=self.working)

    @property
    def dynamic_amplification(self) -> float:
        """Dynamic amplification: peak force over that of the rigid drive [-]; nan if that is infinite."""
        return self.peak_force / self.rigid.peak_force if math.isfinite(self.rigid.peak_force) else math.nan

    @cached_property
    def peak_jerk(self) -> float:
        """Largest |jerk| of the cart [m/s^3]; infinite if its acceleration jumps, as at a stop by friction."""
        return math.inf if self.shocks else float(np.abs(self.state.jerk).max())

    @cached_property
    def shocks(self) -> tuple[Discontinuity, ...]:
        """Jumps of the acceleration of the cart."""
        intervals = self.trajectory.intervals
        rows = np.arange(len(intervals.start))
        after = self.trajectory.at(rows, np.zeros(len(rows))).acceleration
        before = self.trajectory.at(rows, intervals.duration / intervals.scale).acceleration
        largest = np.abs(self.state.acceleration).max()
        jumps = [(i, before[i - 1], after[i]) for i in rows]
        return tuple(
            Discontinuity(float(intervals.start[i]), 2, float(a), float(b))
            for i, a, b in jumps
            if abs(a - b) > JUMP_TOLERANCE * largest
        )

    @cached_property
    def nonuniformity(self) -> float:
        """(v_max - v_min)/v_mean of the cart over the working part of the forward stroke [-]."""
        time = np.linspace(*self.working, rigid_drive.NONUNIFORMITY_SAMPLES) * self.cycle.forward.duration
        position, velocity, *_ = self.trajectory.at(*self.trajectory.locate(time))
        mean = (position[-1] - position[0]) / (time[-1] - time[0])
        return float((velocity.max() - velocity.min()) / mean)

    @property
    def stick_time(self) -> float:
        """Stick time: time during which friction holds the cart at rest [s]; named as in summary.json."""
        intervals = self.trajectory.intervals
        return float(intervals.duration[intervals.slip == 0].sum())

    @cached_property
    def energy_residual(self) -> float:
        """Energy-balance residual of driven end, cart, springs and losses over int |H y'| dt [-]."""
        trajectory, motion = self.trajectory, self.motion
        gain = trajectory.energy(trajectory.end) - trajectory.energy(trajectory.start)
        loss = trajectory.cart.damping * motion.elongation_rate**2 + motion.resistance * motion.velocity
        residual = np.sum(self.weights * (self.drive_power - loss)) - gain
        return float(abs(residual) / np.sum(self.weights * np.abs(self.drive_power)))
