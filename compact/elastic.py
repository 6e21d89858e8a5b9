"""The elastic drive: the cart hangs on a spring and a damper whose far end follows the motion law.

    m x'' = H - W(x') - guide friction,   H = k (e - o) + c e',   e = y(t) - x

y is the law, x the cart, H the drive force, + towards the far end; with a backlash b the spring pulls from a stretch of
b/2 and pushes from -b/2, o = +-b/2, and is slack between, while the damper acts throughout (as in gear dynamics:
Kahraman and Singh, J. Sound Vib. 142 (1990) 49). The resistance W is taken quasi-steady, at acceleration 0. It and the
friction of the guide wheels depend on the speed alone, jump at rest and hold the cart there (`dynamics`).

Two regimes: from rest, and the periodic one, whose state is found by Newton's method on the map over one cycle.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.cart import Balance, Cart, balance
from compact.drive import CREEP, Means, Rigid, State, met_resistance, simulate, steady_force
from compact.dynamics import Arcs, Resistance, Spring, peaks
from compact.dynamics import State as SpringState
from compact.motion import Cycle, Join
from compact.pieces import clenshaw_curtis
from compact.polynomials import horner
from compact.refuse import refuse_negative, refuse_nonpositive, refuse_unknown
from compact.regime import Problem, Work

REGIMES = ("periodic", "rest")
SAMPLES, TURN = 17, 2.5  # points for each so many rad of an oscillation: integrals of its square to 1e-9
ALIVE = 1e-12  # of an oscillation's first amplitude
JUMP = 1e-6  # of the largest acceleration: less is rounding


@dataclass(frozen=True)
class ElasticDrive:
    """Spring and damper between the law and the cart: stiffness k [N/m], damping c [N s/m], backlash b >= 0 [m]."""

    stiffness: float
    damping: float
    backlash: float = 0.0

    def __post_init__(self):
        refuse_nonpositive(stiffness=self.stiffness)
        refuse_negative(damping=self.damping, backlash=self.backlash)

    def run(self, cart, cycle, resistance, working):
        """The periodic `ElasticRun`: what `drive.simulate` asks of a drive."""
        return travel(cart, self, cycle, resistance, working=working)


def damping_ratio(cart, drive):
    """c/(2 sqrt(k m)) of a cart on an `ElasticDrive`."""
    return drive.damping / (2 * math.sqrt(drive.stiffness * cart.mass))


def travel(cart, drive, motion, resistance, *, regime="periodic", working=(1 / 6, 5 / 6), tolerance=1e-8):
    """`ElasticRun` of one cycle of a cart behind a spring.

    Parameters
    ----------
    cart : Cart, mass > 0;  drive : ElasticDrive
    motion : Motion (there and back without a dwell) or Cycle
    resistance : callable(velocity, acceleration) -> N; it may jump at speed 0 only, and is asked at acceleration 0
    regime : "periodic", or "rest": the first cycle of a cart that stood relaxed at the near end
    working : shares of the pass there between which the speed should be even
    tolerance : of the resistance that the solution meets, relative to the largest force of inertia and resistance

    Raises ValueError for a resistance that jumps at a speed other than 0, or that drives the cart from rest, and
    RuntimeError where no periodic regime is found or the cart moves too wildly to follow.
    """
    refuse_nonpositive(mass=cart.mass, tolerance=tolerance)
    refuse_unknown("regime", regime, REGIMES)
    if cart.end_springs is not None:
        raise ValueError("`end_springs` are not known to an elastic drive; take them out, or choose another drive")
    cycle = motion if hasattr(motion, "legs") else motion.cycle()
    problem = Problem(cart, drive, cycle, resistance, tolerance)
    if regime == "rest":
        start = problem.at_rest
        arcs, end = problem.course(problem.law, start)
    else:
        arcs, start = problem.periodic()
        end = start
    course = Course(cart, drive, arcs, problem.resistance, start, end)
    return ElasticRun(cycle, resistance, working, course, problem.work)


@dataclass(frozen=True)
class Course:
    """The cart over a time: its arcs and what gives them meaning; it ran from the state `start` to `end`."""

    cart: Cart
    drive: ElasticDrive
    arcs: Arcs
    resistance: Resistance
    start: SpringState
    end: SpringState

    def places(self):
        """(arc, u, weight [s]) of samples that resolve law and ringing, each of shape (n,); weights integrate."""
        nodes, unit_weights = clenshaw_curtis(SAMPLES)
        columns = []
        for i, (span, length) in enumerate(zip(self.arcs.span, self.arcs.length, strict=True)):
            edges = self._edges(i, length)
            width = np.diff(edges)[:, None]
            t = (edges[:-1, None] + width * nodes).ravel()
            columns.append((np.full(t.shape, i), t / span, (width * unit_weights).ravel()))
        return tuple(np.concatenate(column) for column in zip(*columns, strict=True))

    def _edges(self, i, length):
        """Times of arc i, from 0 to its length, between which nothing swings more than TURN."""
        cosine, sine, decay, bend = self.arcs.ring[i]
        if not (cosine or sine):
            return np.linspace(0, length, 3)
        if bend >= 0:  # two real roots: halving towards the start, where the faster one lives
            halvings = math.ceil(math.log2(max(2.0, length * (abs(decay) + math.sqrt(bend)))))
            return np.append(0.0, length * 2.0 ** np.arange(-halvings, 1))
        alive = min(length, -math.log(ALIVE) / decay) if decay > 0 else length
        edges = np.linspace(0, alive, math.ceil(alive * math.sqrt(decay**2 - bend) / TURN) + 1)
        return edges if alive == length else np.append(edges, np.linspace(alive, length, 3)[1:])

    def at(self, time):
        """(arc, u) at times [s] within the course."""
        i = np.clip(np.searchsorted(self.arcs.start, time, side="right") - 1, 0, len(self.arcs.start) - 1)
        return i, (time - self.arcs.start[i]) / self.arcs.span[i]

    def stretch(self, i, u):
        """e [m] and its rate [m/s] at places u of arcs i."""
        span, ring = self.arcs.span[i], self.arcs.ring[i].T
        cosine, sine, decay, bend = ring
        g0, g1 = _swings(decay, bend, span * u)
        poly = self.arcs.stretch[i]
        stretch = horner(poly, u) + cosine * g0 + sine * g1
        rate = horner(_slope(poly), u) / span + (sine - decay * cosine) * g0 + (bend * cosine - decay * sine) * g1
        return stretch, rate

    def far_end(self, i, u, order=0):
        """y or its derivative by time at places u of arcs i."""
        poly = self.arcs.law[i]
        for _ in range(order):
            poly = _slope(poly)
        return horner(poly, u) / self.arcs.span[i] ** order

    def force(self, i, u):
        """H [N] at places u of arcs i."""
        stretch, rate = self.stretch(i, u)
        side = self.arcs.side[i]
        taken = np.where(side != 0, stretch - side * self.drive.backlash / 2, 0.0)
        return self.drive.stiffness * taken + self.drive.damping * rate

    def motion(self, i, u):
        """Position, velocity, acceleration, jerk of the cart and what resists it [N], at places u of arcs i."""
        stretch, rate = self.stretch(i, u)
        slip, side, mass = self.arcs.slip[i], self.arcs.side[i], self.cart.mass
        pace = self.far_end(i, u, 1)
        velocity = np.where(slip != 0, pace - rate, 0.0)
        force = self.force(i, u)
        there, back = ((table(slip * velocity), _rise(table, slip * velocity)) for table in self.resistance[:2])
        resisted = np.where(slip > 0, there[0], np.where(slip < 0, back[0], force))
        acceleration = np.where(slip != 0, (force - resisted) / mass, 0.0)
        rise = np.where(slip > 0, there[1], -back[1])
        pull = np.where(side != 0, self.drive.stiffness, 0.0) * rate
        pull = pull + self.drive.damping * (self.far_end(i, u, 2) - acceleration)
        jerk = np.where(slip != 0, (pull - rise * acceleration) / mass, 0.0)
        return self.far_end(i, u) - stretch, velocity, acceleration, jerk, resisted

    def energy(self, state):
        """Energy of cart and spring [J] in a state."""
        slack = state.side * self.drive.backlash / 2
        taken = state.stretch - slack if state.side else 0.0
        return self.cart.mass / 2 * state.velocity**2 + self.drive.stiffness / 2 * taken**2


@dataclass(frozen=True)
class ElasticRun(Means):
    """One cycle of a cart behind a spring; arrays of shape (n,) resolve the ringing, arcs one after another.

    Force and power are those of the far end, which follows the law. `met` is the resistance that it was given;
    `work` counts what the solution cost.
    """

    cycle: Cycle
    met: Callable
    working: tuple[float, float]
    course: Course
    work: Work

    impulses = ()  # a spring softens every jump of the law's velocity

    @property
    def name(self):
        """Name of the law."""
        return self.cycle.there.name

    @property
    def period(self):
        """Time of the cycle [s]."""
        return self.cycle.period

    @property
    def steady_force(self):
        """Force that keeps the mean speed [N]."""
        return steady_force(self.course.cart, self.cycle.there, self.met)

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
        """`drive.State` of the cart; while it stands, mix and guides share the pull as they share the limit."""
        i, u, _ = self._places
        position, velocity, acceleration, jerk, resisted = self.course.motion(i, u)
        force, moves = self.course.force(i, u), velocity != 0
        still = np.zeros(force.shape)
        way = np.where(moves, np.sign(velocity), np.sign(force))
        creep = way * CREEP * self.cycle.there.stroke / self.cycle.there.duration
        mix = met_resistance(self.met, np.where(moves, velocity, creep), still)
        limit = balance(self.course.cart, still, mix, way).drive_force
        mix = np.where(moves, mix, force * np.divide(mix, limit, out=np.zeros(mix.shape), where=limit != 0))
        reactions = balance(self.course.cart, acceleration, mix, np.where(moves, way, 0.0))
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
        spring = _spring(self.course)
        return peaks(spring, self.course.arcs)

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
        return simulate(self.course.cart, Rigid(), self.cycle, self.met, working=self.working)

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
        """Jumps of the cart's acceleration, as `Join`s."""
        arcs = self.course.arcs
        every = np.arange(len(arcs.start))
        after = self.course.motion(every, 0.0 * every)[2]
        before = self.course.motion(every, arcs.length / arcs.span)[2]
        largest = np.abs(self.state.acceleration).max()
        turns = [(i, before[i - 1], after[i]) for i in every]
        return tuple(
            Join(float(arcs.start[i]), 2, float(a), float(b)) for i, a, b in turns if abs(a - b) > JUMP * largest
        )

    @cached_property
    def drawn_energy(self):
        """Work given by a drive that cannot take back what the spring returns [J]."""
        return self._mean(np.maximum(self.drive_power, 0.0)) * self.period

    @cached_property
    def nonuniformity(self):
        """(v_max - v_min)/v_mean of the cart over the working part of the way there."""
        duration = self.cycle.there.duration
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
        taken = self.course.drive.damping * rate**2 + resisted * velocity
        missed = np.sum(weights * (self.drive_power - taken)) - gain
        return float(abs(missed) / np.sum(weights * np.abs(self.drive_power)))


def _spring(course):
    drive = course.drive
    return Spring(float(course.cart.mass), float(drive.stiffness), float(drive.damping), float(drive.backlash))


def _slope(poly):
    """Coefficients of the derivative by u, same shape."""
    slope = np.zeros_like(poly)
    slope[..., :-1] = poly[..., 1:] * np.arange(1, poly.shape[-1])
    return slope


def _rise(table, speed):
    """dF/d|v| of a table."""
    i = np.clip(np.searchsorted(table.breaks, speed, side="right") - 1, 0, len(table.coefficients) - 1)
    width = table.breaks[i + 1] - table.breaks[i]
    return horner(_slope(table.coefficients)[i], (speed - table.breaks[i]) / width) / width


def _swings(decay, bend, t):
    """g0, g1 of `ringing.swings`, arrays of one shape."""
    swing, growth = np.sqrt(np.abs(bend)), np.sqrt(np.maximum(bend, 0.0))
    safe = np.where(swing > 0, swing, 1.0)
    fall = np.exp(-decay * t)
    slow, fast = np.exp(-(decay - growth) * t), -np.expm1(-2 * growth * t)
    g0 = np.where(bend < 0, fall * np.cos(swing * t), slow * (1 - fast / 2))
    g1 = np.where(bend < 0, fall * np.sin(swing * t) / safe, slow * fast / (2 * safe))
    return np.where(bend == 0, fall, g0), np.where(bend == 0, fall * t, g1)
