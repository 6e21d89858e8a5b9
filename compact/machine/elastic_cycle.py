"""A cart on a spring over whole cycles: from rest, and the periodic regime, found directly.

The periodic regime is the state that comes back after a cycle: Newton's method on the map of a state over one cycle,
taken in the middle of the way there, where the cart surely moves. A linear drive needs one round; friction that holds
the cart at the ends wipes out the past, and needs one or two. An undamped cart that sets off from rest comes to rest
again once in each swing, just so: a larger swing sticks there and a smaller one does not. The map has a kink at that
state, and differences across it give no derivative. Cycles still contract along the states that they leave, and
Aitken's extrapolation of two of them takes the place of Newton's step.
"""

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from compact.dynamics.event_driven import (
    DONE,
    SHORTEST,
    TOO_FAST,
    TOO_MANY,
    TOO_SHORT,
    UNSEARCHED,
    Intervals,
    integrate,
    room,
)
from compact.dynamics.force_elements import AT_NEAR, FAR, NEAR, NONE, CartState, Ends, Resistance, Spring
from compact.dynamics.oscillator import MOST_RANGES, shifted
from compact.machine.cart import balance
from compact.machine.rigid_drive import CREEP, evaluate_resistance
from compact.numerics.piecewise import BREAK_OFFSET, PiecewisePolynomial, antiderivative, fit_piecewise, interior_grid

ARCS = 20_000  # of a cycle; a dozen are usual, hundreds where the resistance bends with the speed
LAW = 1e-11  # of the peak acceleration, by which polynomials may miss it
TABLE = 1e-2  # of the tolerance, by which polynomials may miss the resistance, and not below
TABLE_FLOOR = 1e-12  # of the largest force: closer there is only rounding
WIDER, WIDENINGS = 2.0, 8  # of the range of speeds, where a cart overshoots it
CREEPING = 1e-6  # of the fastest: slower is as good as standing
AT_ONCE = 1e-3  # of the largest force: what rises by more within the creep, such as v^0.02, holds a standing cart
CLOSED = 0.1  # of the tolerance, and of the larger of force scale and swing: a cycle that ends so near to its start
ROUGHLY = 1e2  # times the tolerance, of a first cycle
PROBE = 1e-5  # of the force scale: difference for the derivative of the map over one cycle
FORGOTTEN = 0.03  # of a residual, that one more cycle leaves: as good as Newton's method, which takes three for a round
HELPS = 0.5  # [-], of a residual, that a Newton step leaves at most: with a true derivative it leaves far less
SHARES = (1.0, 0.25, 0.06)  # [-], of Aitken's step, tried in turn: the states that cycles leave lie on a curve
TINY = np.finfo(float).tiny
ROUNDS = 40  # of Newton's method; 1 to 4 are usual
FARTHEST = 30.0  # of the force scale, that one round may move the state: beyond, friction is another
FAILURES = {
    TOO_MANY: f"more than {ARCS} arcs; give more damping, or take a rigid drive",
    TOO_FAST: "it gets faster without end, its resistance falls too steeply with the speed",
    TOO_SHORT: f"steps below {SHORTEST:g} of a piece of the law; `resistance` is not smooth",
    UNSEARCHED: f"the end of an arc was not found in {MOST_RANGES} ranges of its oscillation; give more damping, or "
    "take a rigid drive",
}


@dataclass
class Work:
    """What a run cost: cycles and parts of cycles integrated, arcs, evaluations of the resistance, Newton's rounds."""

    courses: int = 0
    arcs: int = 0
    evaluations: int = 0
    rounds: int = 0


class CycleMapEvaluation(NamedTuple):
    """A cycle from the middle of the way there: the arcs before and after that, the states at its end and in the middle
    again, and how far it is from closed, in units of force. The arcs meet as near as that."""

    first: Intervals
    second: Intervals
    end: CartState
    after: CartState
    residual: np.ndarray

    @property
    def arcs(self):
        """All arcs, from the start of the cycle."""
        return Intervals(*map(np.concatenate, zip(self.first, self.second, strict=True)))


class PeriodicProblem:
    """A cart, its spring, the law as polynomials over time, and the resistance as polynomials over speed."""

    def __init__(self, cart, drive, cycle, resistance, tolerance):
        self.work = Work()
        self.spring = _spring(cart, drive)
        self.law = _polynomial_law(cycle)
        self.middle = cycle.forward.duration / 2
        self.total = _total(cart, resistance)
        self.knots = getattr(resistance, "speeds", ())
        phases = interior_grid(cycle.forward.curve.x)
        velocity, acceleration = (np.abs(cycle.forward.at_phase(phases, k)).max() for k in (1, 2))
        self.fastest, self.creep = WIDER * velocity, CREEPING * velocity
        impact = velocity * math.sqrt(drive.stiffness * cart.mass) if acceleration == 0 else 0.0
        inertia = cart.mass * acceleration + impact
        speeds = self.fastest * np.linspace(CREEP, 1, 65)
        self.scale = max(inertia, *(np.abs(self.total(sign * speeds)).max() for sign in (1, -1)))
        self.tolerance = tolerance * self.scale
        self.hurry = inertia / cart.mass
        self.pace = getattr(resistance, "rate_limit", np.inf) if drive.first_order else 0.0
        self._tabulate()

    def _tabulate(self):
        knots = np.array([speed for speed in self.knots if self.creep < speed < self.fastest])
        octaves = self.creep * 2.0 ** np.arange(math.log2(min([*knots, self.fastest]) / self.creep))
        breaks = np.concatenate([octaves, knots, [self.fastest]])
        there, back = (self._side(sign, breaks) for sign in (1, -1))
        added = self._added_masses(breaks) if self.pace else NONE
        self.resistance = Resistance(there, back, np.append(self.creep, knots), added, float(self.pace))
        most, least = there.coefficients[0, 0], back.coefficients[0, 0]
        if most < least:
            raise ValueError(
                f"`resistance` must not push a standing cart on, got {most:g} N at speed +0 and {least:g} N at -0"
            )

    def _added(self, speed):
        """M [kg] at speeds > 0, by which the resistance follows the acceleration; below the slowest sample as there."""
        speed = np.maximum(speed, min(self.knots, default=0.0))
        acceleration = np.minimum(self.hurry, self.pace * speed) / 2
        return (self.total(speed, acceleration) - self.total(speed)) / acceleration

    def _added_masses(self, breaks):
        miss = max(TABLE * self.tolerance, TABLE_FLOOR * self.scale) / self.hurry
        masses = fit_piecewise(self._added, breaks, miss)
        least = min(masses.coefficients[:, 0].min(), float(masses(masses.breaks[-1])))
        if self.spring.mass + least <= 0:
            raise ValueError(
                f"`mass` must exceed what the resistance lags by, got {self.spring.mass:g} kg, a lag of {-least:g} kg; "
                "take the resistance without its added masses"
            )
        still = np.zeros((1, masses.coefficients.shape[1]))
        still[0, 0] = masses.coefficients[0, 0]
        return PiecewisePolynomial(np.append(0.0, masses.breaks), np.concatenate([still, masses.coefficients]))

    def _side(self, sign, breaks):
        """F over |v| on one way: from the creep on as near as asked, and below it as `_crept`."""
        miss = max(TABLE * self.tolerance, TABLE_FLOOR * self.scale)
        try:
            side = fit_piecewise(lambda v: self.total(sign * v), breaks, miss)
        except ValueError as error:
            raise ValueError(f"`resistance` over speed [m/s] has {error}") from None
        below = np.zeros((1, side.coefficients.shape[1]))
        below[0, :2] = self._crept(sign, side.coefficients[0, 0])
        return PiecewisePolynomial(np.append(0.0, side.breaks), np.concatenate([below, side.coefficients]))

    def _crept(self, sign, force):
        """(F, its rise) from rest to the creep, where F is `force`: what it rises by at once holds the cart.

        Friction that is rounding is none: nothing sticks to it.
        """
        rest = float(self.total(sign * np.array([CREEP * self.creep]))[0])
        rest *= abs(rest) > TABLE_FLOOR * self.scale
        if abs(force - rest) <= AT_ONCE * self.scale:
            return rest, force - rest
        if sign * force < sign * rest:
            raise ValueError(
                f"`resistance` over speed [m/s] has a jump at 0, from {rest:g} N to {force:g} N at {self.creep:g} m/s, "
                "by which it falls; give a function without jumps"
            )
        return force, 0.0

    @property
    def at_rest(self):
        """State of a cart that stands at the near end, drive and end spring in balance."""
        ends, stiffness, slack = self.spring.ends, self.spring.stiffness, self.spring.backlash / 2
        if ends.length == 0:
            return CartState(0.0, 0.0, 1 if slack == 0 else 0, 0)
        pushed = ends.preload + ends.stiffness * ends.length
        given = (pushed + stiffness * slack) / (stiffness + ends.stiffness)  # by the drive, to the end spring
        side = 1 if slack == 0 else -1
        return (
            CartState(-given, 0.0, side, NEAR) if given < ends.length else CartState(-ends.length, 0.0, side, AT_NEAR)
        )

    def course(self, law, state, roughly=1.0):
        """(`Intervals`, end state) through the pieces of a law, to so many times the tolerance; the range of speeds widens
        as need be."""
        for _ in range(WIDENINGS):
            arcs = room(ARCS, law.coefficients.shape[1] - 1)  # memory is taken as it is filled
            ended, n, evaluations, end, time = integrate(
                self.spring, law, self.resistance, state, roughly * self.tolerance, arcs
            )
            self.work.courses += 1
            self.work.arcs += n
            self.work.evaluations += evaluations
            if ended == DONE:
                return Intervals(*(column[:n].copy() for column in arcs)), end
            if ended != TOO_FAST:
                break
            self.fastest *= WIDER
            self._tabulate()
        raise RuntimeError(
            f"the cart was followed to {time:g} s of {law.breaks[-1]:g} s in {n} arcs, speed {end.velocity:g} m/s, "
            f"and no further: {FAILURES[ended]}"
        )

    def periodic(self):
        """(`Intervals`, state at the start) of the cycle that comes back after it.

        Newton's method on the map over one cycle, from the middle of the way there, where the cart surely moves, after
        a rough one; while a cycle wipes out nearly all of the past, or a step does not help, it is one more instead.
        """
        late, early = _cut(self.law, self.middle)
        state = self.course(early, self.course(late, self._steady(early), ROUGHLY)[1], ROUGHLY)[1]
        stiffness, mass = self.spring.stiffness, self.spring.mass
        units = self.scale / np.array([stiffness, math.sqrt(stiffness * mass)])

        def miss(state, last=None):
            second, end = self.course(late, state)
            known = last is not None and end[2:] == last.end[2:]
            if known and close(short := away(end, last.end), end):
                return last._replace(second=second, residual=short)  # the rest of the cycle is known
            first, after = self.course(early, end)
            return CycleMapEvaluation(first, second, end, after, away(after, state))

        def away(one, other):
            return (np.array(one[:2]) - np.array(other[:2])) / units

        def close(residual, state):
            swing = max(1.0, np.abs(np.array(state[:2]) / units).max())  # near a resonance many times the scale
            return np.abs(residual).max() <= CLOSED * self.tolerance / self.scale * swing

        turn, before = miss(state), np.inf
        for _ in range(ROUNDS):
            left = np.abs(turn.residual).max()
            if close(turn.residual, turn.end) and turn.after[2:] == state[2:]:
                return turn.arcs, turn.end
            if left <= FORGOTTEN * before:
                state, turn, before = turn.after, miss(turn.after, turn), left
                continue
            self.work.rounds += 1
            slopes = np.empty((2, 2))
            for j in range(2):
                probe = _moved(state, PROBE * units * np.eye(2)[j])
                slopes[:, j] = (miss(probe).residual - turn.residual) / PROBE
            state, turn = self._step(miss, state, turn, slopes, units)
            before = 0.0
        raise RuntimeError(
            f"no periodic regime found in {ROUNDS} rounds: a cycle ends {np.abs(turn.residual).max() * self.scale:g} N "
            "from where it began; the spring may resonate, or the motion repeat after several cycles only; "
            'give more damping, or regime "rest"'
        )

    def _steady(self, early):
        """State at the end of the early part of a cart that follows the law without swinging."""
        width, row = np.diff(early.breaks)[-1], early.coefficients[-1]
        powers = np.arange(len(row))
        pace, bend = row @ powers / width, row @ (powers * (powers - 1)) / width**2
        resisted = float(self.total(np.array([pace]))[0])
        pull = self.spring.mass * bend + resisted
        side = 1 if self.spring.backlash == 0 else int(np.sign(pull))
        stretch, ends = pull / self.spring.stiffness + side * self.spring.backlash / 2, self.spring.ends
        place = row.sum() - stretch
        zone = NEAR if place < ends.length else FAR if place > ends.stroke - ends.length > 0 else 0
        return CartState(stretch, pace, side, zone)

    def _step(self, miss, state, turn, slopes, units):
        """(state, `CycleMapEvaluation`) after a Newton step; where it does not help, after one more cycle and Aitken's step."""
        with suppress(np.linalg.LinAlgError, RuntimeError):  # a step that leads nowhere is none: one more cycle does
            move = np.linalg.solve(slopes, -turn.residual)
            trial, tried = self._tried(miss, state, move, units)
            if np.abs(tried.residual).max() < HELPS * np.abs(turn.residual).max():
                return trial, tried
        last, state, turn = turn.residual, turn.after, miss(turn.after)
        move = _extrapolated(last, turn.residual)
        for share in SHARES:
            with suppress(RuntimeError):
                _, tried = self._tried(miss, state, share * move, units)
                further = miss(tried.after, tried)  # a cycle later the state is one that cycles leave
                if np.abs(further.residual).max() < np.abs(turn.residual).max():
                    return tried.after, further
        return state, turn

    def _tried(self, miss, state, move, units):
        """A state moved by multiples of the units, and its `CycleMapEvaluation`."""
        trial = _moved(state, move * min(1.0, FARTHEST / max(np.abs(move).max(), TINY)) * units)
        return trial, miss(trial)


def _extrapolated(last, residual):
    """Aitken's extrapolation: the sum of all residuals to come where each follows from the one before by a factor.

    r q/(1 - q) + r,   q = r . r_last/|r_last|^2
    """
    share = residual @ last / (last @ last)
    return residual / (1 - share) if share < 1 else residual


def _moved(state, by):
    return CartState(state.stretch + by[0], state.velocity + by[1], state.side, state.zone)


def _polynomial_law(cycle):
    """Position of the far end over a cycle as `PiecewisePolynomial` in time, twice integrated from its acceleration."""
    breaks, rows = [], []
    for leg in cycle.legs():
        bend = partial(_bend, leg)
        bent = fit_piecewise(bend, leg.breakpoints(), LAW * np.abs(bend(interior_grid(leg.breakpoints()))).max())
        starts = bent.breaks[:-1] + BREAK_OFFSET
        speed = antiderivative(bent, leg.at_phase(starts, 1) * leg.duration)
        place = antiderivative(speed, leg.at_phase(starts, 0))
        breaks.append(leg.start + leg.duration * place.breaks[:-1])
        rows.append(place.coefficients)
    return PiecewisePolynomial(np.append(np.concatenate(breaks), cycle.period), np.concatenate(rows))


def _bend(leg, phase):
    return leg.at_phase(phase, 2) * leg.duration**2


def _cut(law, time):
    """The pieces of a law from `time` on, and those before."""
    i = int(np.searchsorted(law.breaks, time, side="left"))
    breaks, rows = law.breaks, law.coefficients
    if breaks[i] > time:
        u = (time - breaks[i - 1]) / (breaks[i] - breaks[i - 1])
        halves = shifted(rows[i - 1], 0.0, u), shifted(rows[i - 1], u, 1 - u)
        rows = np.concatenate([rows[: i - 1], halves, rows[i:]])
        breaks = np.insert(breaks, i, time)
    return PiecewisePolynomial(breaks[i:].copy(), rows[i:].copy()), PiecewisePolynomial(
        breaks[: i + 1].copy(), rows[:i].copy()
    )


def _total(cart, resistance):
    """Resistance and guide friction [N] over velocity [m/s], none of them 0, and acceleration [m/s^2]."""

    def total(velocity, acceleration=0.0):
        acceleration = np.broadcast_to(acceleration, np.shape(velocity))
        return balance(
            cart, 0.0, evaluate_resistance(resistance, velocity, acceleration), np.sign(velocity)
        ).drive_force

    return total


def _spring(cart, drive):
    ends, numbers = cart.end_springs, (cart.mass, drive.stiffness, drive.damping, drive.backlash)
    given = (0.0,) * 4 if ends is None else (ends.stiffness, ends.preload, ends.length, ends.stroke)
    return Spring(*map(float, numbers), Ends(*map(float, given)))
