"""Elastic drive: a spring and a damper between the imposed motion law and the cart.

    m x'' = H - W(x', x'', s) - guide friction + end springs,   H = k (e - o) + c e',   e = y(t) - x

y is the law, x the cart, H the drive force, positive towards the driven end. With a backlash b the spring is engaged
for e > b/2 (o = b/2) and e < -b/2 (o = -b/2), and slack between; the damper acts throughout. The resistance W is that
of the steady speed; a `StrokeResistance` depends on the travel s since the last turn too.

W and the guide friction jump at rest and hold the cart there, as does the plate of a preloaded end spring. A
resistance that vanishes with a small power of the speed, such as v^0.02 of a compacting mix, acts like dry friction: a
cart slower than a millionth of the peak speed counts as at rest, and the resistance at that speed holds it.

Two regimes are available: the first cycle from rest, and the periodic regime (`elastic_motion`).

References
----------
Backlash with parallel damper: A. Kahraman and R. Singh, J. Sound Vib. 142 (1990) 49.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.machine import rigid_drive
from compact.machine.cart import Balance, Cart, Resistance, balance
from compact.machine.elastic_motion import MAX_STEPS, SAMPLES, WEIGHTS, CartMotion, Kinematics, SolutionCost, Trajectory
from compact.machine.rigid_drive import evaluate_resistance
from compact.machine.spring_forces import RELEASE
from compact.motion.profile import Cycle, Discontinuity, MotionProfile
from compact.numerics import Array
from compact.numerics.validation import require_fields, require_known, require_opposing, require_positive

REGIMES = ("periodic", "rest")
JUMP_TOLERANCE = 1e-6  # [-], of the largest acceleration; smaller jumps are rounding
MAX_STIFFNESS_RATIO = 1e9  # [-], of a piece of the law to a radian of the oscillation; rounding of the speed is felt
STEP_ANGLE = 6.0  # [rad], of an oscillation in one step
OSCILLATION_FLOOR = 1e-9  # [-], of the initial amplitude; a smaller oscillation is not resolved


@dataclass(frozen=True)
class ElasticDrive:
    """Spring and damper between the law and the cart.

    Parameters
    ----------
    stiffness, damping, backlash : float
        k [N/m], > 0; c [N s/m] and b [m], >= 0.
    tolerance : float
        Of the forces, relative to the largest force of inertia and resistance [-].
    """

    stiffness: float
    damping: float
    backlash: float = 0.0
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        require_fields(self, positive="stiffness tolerance", nonnegative="damping backlash")

    def run(self, cart: Cart, cycle: Cycle, resistance: Resistance, working: tuple[float, float]) -> "ElasticRun":
        """Simulate the periodic regime, for `rigid_drive.simulate`."""
        return simulate_elastic(cart, self, cycle, resistance, working=working)


def simulate_elastic(
    cart: Cart,
    drive: ElasticDrive,
    motion: MotionProfile | Cycle,
    resistance: Resistance,
    *,
    regime: str = "periodic",
    working: tuple[float, float] = rigid_drive.WORKING_PART,
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
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2], taken at no acceleration, with a jump at
        speed 0 only. A `ResistanceMap` provides its sampled speeds, a `StrokeResistance` its shares along the stroke.
    regime : str
        "periodic", or "rest": the first cycle of a cart at rest at the near end, with its springs in balance.
    working : tuple of float
        Start and end of the working part of the forward stroke [-], for `nonuniformity`.

    Raises
    ------
    ValueError
        If the resistance does not oppose the motion or jumps at a speed other than 0, or if the period of the
        oscillation is not resolved.
    RuntimeError
        If the integration ends early or no periodic regime is found.

    Notes
    -----
    A radian of the oscillation must last a billionth of a piece of the law of duration T, k <= 1e18 m/T^2, and the
    oscillation must decay within `MAX_STEPS` steps.
    """
    require_positive(mass=cart.mass)
    require_known("regime", regime, REGIMES)
    cycle = motion if isinstance(motion, Cycle) else motion.cycle()
    require_opposing(resistance, cycle.forward.stroke / cycle.forward.duration)
    _require_resolvable(cart, drive, cycle)
    problem = CartMotion(cart, drive, cycle, resistance, drive.tolerance)
    periodic = regime == "periodic"
    trajectory = problem.solve_periodic() if periodic else problem.integrate(problem.law, problem.rest_state)
    return ElasticRun(cart, cycle, resistance, working, drive, trajectory, problem.cost)


def _require_resolvable(cart, drive, cycle):
    """Require an oscillation that double precision and `MAX_STEPS` steps resolve."""
    frequency, decay = math.sqrt(drive.stiffness / cart.mass), drive.damping / (2 * cart.mass)
    pieces = np.concatenate([leg.duration * np.diff(leg.breakpoints()) for leg in cycle.legs() if leg.direction])
    lasting = np.minimum(pieces, -math.log(OSCILLATION_FLOOR) / max(decay, 1e-300)).sum() if decay < frequency else 0.0
    if frequency * lasting > STEP_ANGLE * MAX_STEPS or frequency * pieces.max() > MAX_STIFFNESS_RATIO:
        raise ValueError(
            f"`stiffness` {drive.stiffness:g} N/m with `damping` {drive.damping:g} N s/m: the cart oscillates "
            f"{frequency * lasting / (2 * math.pi):.2g} times per cycle with a period of "
            f"{2 * math.pi / frequency:.3g} s, allowed are {STEP_ANGLE * MAX_STEPS / (2 * math.pi):.2g} times and "
            f"{2 * math.pi * pieces.max() / MAX_STIFFNESS_RATIO:.3g} s; use a rigid drive, or more damping"
        )


@dataclass(frozen=True)
class ElasticRun(rigid_drive.Run):
    """One cycle of a cart behind a spring; arrays of shape (n,) resolve the oscillation, steps in order of time.

    Force and power are those of the driven end, which follows the law.
    """

    trajectory: Trajectory
    cost: SolutionCost

    impulses = ()

    @cached_property
    def samples(self) -> tuple[Array, Array, Array, rigid_drive.DriveState]:
        """Time and quadrature weights [s], direction of the law, and state of the cart."""
        begin, duration = self.trajectory.begin, self.trajectory.duration[:, None]
        time, weights = begin[:, None] + duration * SAMPLES, duration * WEIGHTS
        direction = np.repeat(self.cycle.direction(begin + 1e-9 * self.period), len(SAMPLES))
        return time.ravel(), weights.ravel(), direction, self._state()

    @cached_property
    def motion(self) -> Kinematics:
        """Motion and forces of the cart and its spring."""
        return self.trajectory.samples

    def _state(self) -> rigid_drive.DriveState:
        """Motion and forces of the cart.

        Slower than the integration resolves, mix and guides share its resistance in the ratio of their limits.
        """
        motion, trajectory = self.motion, self.trajectory
        slip, heading = (np.repeat(each, len(SAMPLES)) for each in (trajectory.slip, trajectory.heading))
        slowest, acceleration, zero = trajectory.cart.knots[0], motion.acceleration, np.zeros(len(slip))
        releases = (
            trajectory.cart.turns[:, RELEASE].all() and trajectory.cart.turns.size
        )  # no jump of the mix at a turn
        pulled = heading if releases else np.sign(motion.drive_force + motion.end_spring_force)
        direction = np.where(slip != 0, slip, pulled)
        velocity = np.where(slip * motion.velocity > 0, motion.velocity, 0.0)  # rounding at the ends of a slip
        moving = direction * np.maximum(np.abs(velocity), slowest)  # limit from inside the motion
        mix = evaluate_resistance(self.resistance, moving, zero)
        mix, load = mix * motion.force_share, motion.load_share
        if not releases:
            limit = balance(self.cart, zero, mix, direction, load_share=load).drive_force
            share = np.divide(mix, limit, out=np.zeros(mix.shape), where=limit != 0)
            mix = np.where(np.abs(velocity) < slowest, motion.resistance * share, mix)
        end_force = motion.end_spring_force
        reactions = balance(self.cart, acceleration, mix, slip, end_spring_force=end_force, load_share=load)
        forces = Balance(motion.drive_force, reactions.front_reaction, reactions.rear_reaction, motion.resistance - mix)
        return rigid_drive.DriveState(motion.position, velocity, acceleration, motion.jerk, mix, zero, load, forces)

    @property
    def drive_power(self) -> Array:
        """Power H y' of the driven end [W]."""
        return self.motion.drive_force * self.motion.driven_velocity

    @property
    def peak_force(self) -> float:
        """Largest |H| [N]."""
        return self.trajectory.largest_force_and_power[0]

    @property
    def peak_power(self) -> float:
        """Largest |H y'| [W]."""
        return self.trajectory.largest_force_and_power[1]

    @cached_property
    def rigid(self) -> rigid_drive.Run:
        """Run with the law imposed on the cart itself."""
        return rigid_drive.Run(self.cart, self.cycle, self.resistance, self.working, rigid_drive.Rigid())

    @cached_property
    def peak_jerk(self) -> float:
        """Largest |jerk| of the cart [m/s^3]; infinite if its acceleration jumps, as at a stop by friction."""
        return math.inf if self.shocks else float(np.abs(self.motion.jerk).max())

    @cached_property
    def shocks(self) -> tuple[Discontinuity, ...]:
        """Jumps of the acceleration of the cart."""
        acceleration = self.motion.acceleration.reshape(-1, len(SAMPLES))
        before, after = np.roll(acceleration[:, -1], 1), acceleration[:, 0]
        jumps = np.abs(after - before) > JUMP_TOLERANCE * np.abs(acceleration).max()
        columns = zip(*(each[jumps].tolist() for each in (self.trajectory.begin, before, after)), strict=True)
        return tuple(Discontinuity(time, 2, one, other) for time, one, other in columns)

    @cached_property
    def nonuniformity(self) -> float:
        """(v_max - v_min)/v_mean of the cart over the working part of the forward stroke [-]."""
        time = np.linspace(*self.working, rigid_drive.NONUNIFORMITY_SAMPLES) * self.cycle.forward.duration
        motion = self.trajectory.at(time)
        mean = (motion.position[-1] - motion.position[0]) / (time[-1] - time[0])
        return float((motion.velocity.max() - motion.velocity.min()) / mean)

    @property
    def stick_time(self) -> float:
        """Stick time: time during which friction holds the cart at rest [s]; named as in summary.json."""
        return float(self.trajectory.duration[self.trajectory.slip == 0].sum())

    @cached_property
    def energy_residual(self) -> float:
        """Energy-balance residual of driven end, cart, springs and losses over int |H y'| dt [-]."""
        trajectory, motion = self.trajectory, self.motion
        gain = trajectory.energy(trajectory.end) - trajectory.energy(trajectory.start)
        loss = trajectory.cart.damping * motion.elongation_rate**2 + motion.resistance * motion.velocity
        residual = np.sum(self.weights * (self.drive_power - loss)) - gain
        return float(abs(residual) / np.sum(self.weights * np.abs(self.drive_power)))
