"""The elastic drive: the cart hangs on a spring and a damper whose far end follows the motion law.

    m x'' = H - W(x', x'') - guide friction + end springs,   H = k (e - o) + c e',   e = y(t) - x

y is the law, x the cart, H the drive force, + towards the far end; with a backlash b the spring pulls from a stretch of
b/2 and pushes from -b/2, o = +-b/2, and is slack between, while the damper acts throughout (as in gear dynamics:
Kahraman and Singh, J. Sound Vib. 142 (1990) 49). The resistance W of the mix is that of the steady speed, or follows
the acceleration at first order, F(v) + a M(v), as a map gives it; while a cart swings the map holds the second term
most of the time, and following it through costs several times as much. W and the friction of the guide wheels jump at
rest and hold the cart there, as does the plate of a preloaded end spring (`dynamics`). A resistance that vanishes with
a small power of the speed, such as v^0.02 of a mix that compacts, holds like dry friction: a millionth of the fastest
speed is as good as standing, and what the mix resists there is what holds.

Two regimes: from rest, and the periodic one, whose state is found by Newton's method on the map over one cycle.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.dynamics.event_driven import peaks
from compact.dynamics.trajectory import ALIVE, MOST_SAMPLES, SAMPLES, TURN, Course, alive_time
from compact.machine.cart import Balance, Cart, balance
from compact.machine.elastic_cycle import PeriodicProblem, Work
from compact.machine.rigid_drive import (
    CREEP,
    CycleStatistics,
    Rigid,
    State,
    evaluate_resistance,
    simulate,
    steady_force,
)
from compact.motion.profile import Cycle, Discontinuity
from compact.numerics.validation import require_known, require_nonnegative, require_opposing, require_positive

REGIMES = ("periodic", "rest")
JUMP = 1e-6  # of the largest acceleration: less is rounding


@dataclass(frozen=True)
class ElasticDrive:
    """Spring and damper between the law and the cart: stiffness k [N/m], damping c [N s/m], backlash b >= 0 [m].

    first_order : whether the resistance follows the acceleration, F + a M, or is that of the steady speed
    """

    stiffness: float
    damping: float
    backlash: float = 0.0
    first_order: bool = False

    def __post_init__(self):
        require_positive(stiffness=self.stiffness)
        require_nonnegative(damping=self.damping, backlash=self.backlash)

    def run(self, cart, cycle, resistance, working):
        """The periodic `ElasticRun`: what `rigid_drive.simulate` asks of a drive."""
        return simulate_elastic(cart, self, cycle, resistance, working=working)


def damping_ratio(cart, drive):
    """c/(2 sqrt(k m)) of a cart on an `ElasticDrive`."""
    return drive.damping / (2 * math.sqrt(drive.stiffness * cart.mass))


def simulate_elastic(cart, drive, motion, resistance, *, regime="periodic", working=(1 / 6, 5 / 6), tolerance=1e-8):
    """`ElasticRun` of one cycle of a cart behind a spring.

    Parameters
    ----------
    cart : Cart, mass > 0;  drive : ElasticDrive
    motion : Motion (there and back without a dwell) or Cycle
    resistance : callable(velocity, acceleration) -> N, linear in the acceleration; it may jump at speed 0 only.
        A `ResistanceMap` has its samples, `speeds`, and the `rate_limit` |a|/|v| up to which it is linear
    regime : "periodic", or "rest": the first cycle of a cart that stood at the near end, its springs in balance
    working : shares of the pass there between which the speed should be even
    tolerance : of the resistance that the solution meets, relative to the largest force of inertia and resistance

    Raises ValueError for a resistance that does not oppose the motion, or jumps at a speed other than 0, and for an
    oscillation that takes more than `MOST_SAMPLES` samples;
    RuntimeError where no periodic regime is found or the cart moves too wildly to follow.
    """
    require_positive(mass=cart.mass, tolerance=tolerance)
    require_known("regime", regime, REGIMES)
    cycle = motion if hasattr(motion, "legs") else motion.cycle()
    require_opposing(resistance, cycle.forward.stroke / cycle.forward.duration)
    _require_few_samples(cart, drive, cycle, _expected_samples(cart, drive, cycle))
    problem = PeriodicProblem(cart, drive, cycle, resistance, tolerance)
    if regime == "rest":
        start = problem.at_rest
        arcs, end = problem.course(problem.law, start)
    else:
        arcs, start = problem.periodic()
        end = start
    course = Course(problem.spring, arcs, problem.resistance, start, end)
    _require_few_samples(cart, drive, cycle, course.sample_count)
    return ElasticRun(cart, cycle, resistance, working, course, problem.work, drive.first_order)


def _expected_samples(cart, drive, cycle):
    """Samples that resolve the oscillation of a cart after each join of the law; in a dwell friction may hold it."""
    decay = drive.damping / (2 * cart.mass)
    square = drive.stiffness / cart.mass - decay**2
    if square <= 0:
        return 0
    pieces = [leg.duration * np.diff(leg.breakpoints()) for leg in cycle.legs() if leg.direction]
    alive = sum(alive_time(decay, float(length)) for length in np.concatenate(pieces))
    return SAMPLES * alive * math.sqrt(drive.stiffness / cart.mass) / TURN


def _require_few_samples(cart, drive, cycle, samples):
    """ValueError, with a damping that would do, where the oscillations of a cycle take more than `MOST_SAMPLES`."""
    if samples <= MOST_SAMPLES:
        return
    swing = math.sqrt(drive.stiffness / cart.mass)
    times = sum(len(leg.breakpoints()) for leg in cycle.legs())  # that the oscillation begins, about
    decay = 2 * times * SAMPLES * -math.log(ALIVE) * swing / TURN / MOST_SAMPLES
    raise ValueError(
        f"`stiffness` {drive.stiffness:g} N/m with a `damping` of {drive.damping:g} N s/m makes the cart swing "
        f"{samples * TURN / SAMPLES / (2 * math.pi):.2g} times in a cycle: {samples:.2g} samples, at most "
        f"{MOST_SAMPLES} are kept; take a rigid drive, or give a damping of {2 * cart.mass * decay:.2g} N s/m or more"
    )


@dataclass(frozen=True)
class ElasticRun(CycleStatistics):
    """One cycle of a cart behind a spring; arrays of shape (n,) resolve the ringing, arcs one after another.

    Force and power are those of the far end, which follows the law. `met` is the resistance that it was given;
    `work` counts what the solution cost.
    """

    cart: Cart
    cycle: Cycle
    met: Callable
    working: tuple[float, float]
    course: Course
    work: Work
    first_order: bool

    impulses = ()  # a spring softens every jump of the law's velocity

    @property
    def name(self):
        """Name of the law."""
        return self.cycle.forward.name

    @property
    def period(self):
        """Time of the cycle [s]."""
        return self.cycle.period

    @property
    def steady_force(self):
        """Force that keeps the mean speed [N]."""
        return steady_force(self.cart, self.cycle.forward, self.met)

    @cached_property
    def _places(self):
        return self.course.places()

    @property
    def weights(self):
        """Weights [s] that integrate over the cycle."""
        return self._places[2]

    @cached_property
    def time(self):
        """Time [s] from the start of the way there."""
        i, u, _ = self._places
        return self.course.arcs.start[i] + self.course.arcs.span[i] * u

    @cached_property
    def direction(self):
        """Way of the law: +1 there, -1 back, 0 in a dwell."""
        legs = self.cycle.legs()
        which = np.searchsorted([leg.start for leg in legs], self.course.arcs.start + 1e-9 * self.period) - 1
        return np.array([float(leg.direction) for leg in legs])[which][self._places[0]]

    @cached_property
    def state(self):
        """`rigid_drive.State` of the cart; while it stands, mix and guides share the pull as they share the limit."""
        i, u, _ = self._places
        position, velocity, acceleration, jerk, resisted = self.course.motion(i, u)
        force, push, slip = self.course.force(i, u), self.course.push(i, u), self.course.arcs.slip[i]
        still, moves, pull = np.zeros(force.shape), slip != 0, force + push
        way = np.where(moves, slip, np.sign(pull))
        creep = way * CREEP * self.cycle.forward.stroke / self.cycle.forward.duration
        mix = evaluate_resistance(self.met, np.where(velocity != 0, velocity, creep), self.first_order * acceleration)
        limit = balance(self.cart, still, mix, way).drive_force
        share = np.divide(mix, limit, out=np.zeros(mix.shape), where=limit != 0)
        mix = np.where(moves, mix, pull * share)
        reactions = balance(self.cart, acceleration, mix, np.where(moves, way, 0.0), push=push)
        forces = Balance(force, reactions.front_reaction, reactions.rear_reaction, resisted - mix)
        return State(position, velocity, acceleration, jerk, mix, still, forces)

    @cached_property
    def drive_force(self):
        """H [N], along the travel."""
        i, u, _ = self._places
        return self.course.force(i, u)

    @cached_property
    def drive_power(self):
        """H y' [W]: what the far end gives."""
        i, u, _ = self._places
        return self.drive_force * self.course.far_end(i, u, 1)

    @cached_property
    def _peaks(self):
        return peaks(self.course.spring, self.course.arcs)

    @property
    def peak_force(self):
        """Largest |H| [N]."""
        return self._peaks[0]

    @property
    def peak_power(self):
        """Largest |H y'| [W]."""
        return self._peaks[1]

    @cached_property
    def rigid(self):
        """The `Run` with the law imposed on the cart itself."""
        return simulate(self.cart, Rigid(), self.cycle, self.met, working=self.working)

    @property
    def ringing(self):
        """Peak force over that of the rigid drive; nan where that is infinite."""
        return self.peak_force / self.rigid.peak_force if math.isfinite(self.rigid.peak_force) else math.nan

    @cached_property
    def peak_jerk(self):
        """Largest |jerk| of the cart [m/s^3]; infinite where its acceleration jumps, as where friction stops it."""
        return math.inf if self.shocks else float(np.abs(self.state.jerk).max())

    @cached_property
    def shocks(self):
        """Jumps of the cart's acceleration, as `Discontinuity`s."""
        arcs = self.course.arcs
        every = np.arange(len(arcs.start))
        after = self.course.motion(every, 0.0 * every)[2]
        before = self.course.motion(every, arcs.length / arcs.span)[2]
        largest = np.abs(self.state.acceleration).max()
        turns = [(i, before[i - 1], after[i]) for i in every]
        return tuple(
            Discontinuity(float(arcs.start[i]), 2, float(a), float(b)) for i, a, b in turns if abs(a - b) > JUMP * largest
        )

    @cached_property
    def drawn_energy(self):
        """Work given by a drive that cannot take back what the spring returns [J]."""
        return self._mean(np.maximum(self.drive_power, 0.0)) * self.period

    @cached_property
    def nonuniformity(self):
        """(v_max - v_min)/v_mean of the cart over the working part of the way there."""
        duration = self.cycle.forward.duration
        time = np.linspace(*self.working, 2001) * duration
        position, velocity, *_ = self.course.motion(*self.course.at(time))
        mean = (position[-1] - position[0]) / (time[-1] - time[0])
        return float((velocity.max() - velocity.min()) / mean)

    @property
    def standing(self):
        """Time for which friction holds the cart [s]."""
        return float(self.course.arcs.length[self.course.arcs.slip == 0].sum())

    @cached_property
    def energy_residual(self):
        """|work of the far end - gain of cart and spring - loss in damper, mix and guides| over int |H y'| dt."""
        i, u, weights = self._places
        _, velocity, _, _, resisted = self.course.motion(i, u)
        _, rate = self.course.stretch(i, u)
        gain = self.course.energy(self.course.end) - self.course.energy(self.course.start)
        taken = self.course.spring.damping * rate**2 + resisted * velocity
        missed = np.sum(weights * (self.drive_power - taken)) - gain
        return float(abs(missed) / np.sum(weights * np.abs(self.drive_power)))
