"""Initial-value and periodic solutions of a cart behind a drive spring over one cycle.

The periodic regime is a fixed point of the map of a state over one cycle (shooting). Newton's method solves it from
the middle of the forward stroke, where the cart moves. A linear drive needs one Newton step. Dry friction that holds
the cart at the ends erases its history and needs one or two.

An undamped cart that starts from rest comes to rest again exactly once per oscillation: after a larger oscillation it
sticks, after a smaller one it does not. The map has a kink at that state, and finite differences across it do not
approximate a derivative. The iteration over cycles still contracts, and Aitken's extrapolation of two cycles replaces
the Newton step.

References
----------
A. C. Aitken, Proc. R. Soc. Edinburgh 46 (1926) 289.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.dynamics import force_elements as elements
from compact.dynamics.event_driven import (
    DONE,
    MIN_STEP,
    SEARCH_EXHAUSTED,
    SPEED_BEYOND_TABLE,
    STEP_TOO_SHORT,
    TOO_MANY_INTERVALS,
    Intervals,
    allocate_intervals,
    integrate,
)
from compact.dynamics.oscillator import MAX_RANGES, substitute
from compact.machine.cart import Cart, balance
from compact.machine.rigid_drive import STANDSTILL_SPEED_RATIO, Resistance, evaluate_resistance
from compact.motion.profile import Cycle, Leg
from compact.numerics import Array
from compact.numerics.piecewise import BREAK_OFFSET, PiecewisePolynomial, antiderivative, fit_piecewise, interior_grid

if TYPE_CHECKING:
    from compact.machine.elastic_drive import ElasticDrive

MAX_INTERVALS = 20_000  # [-], of a cycle; a dozen are usual, hundreds for a resistance that is curved in speed
LAW_TOLERANCE = 1e-11  # [-], of the peak acceleration; polynomials of the law
TABLE_TOLERANCE = 1e-2  # [-], of the solution tolerance; polynomials of the resistance
TABLE_FLOOR = 1e-12  # [-], of the force scale; smaller tolerances resolve rounding
SPEED_MARGIN, MAX_EXTENSIONS = 2.0, 8  # [-], growth of the speed range of the tables, and its repetitions
STANDSTILL_SPEED = 1e-6  # [-], of the peak speed of the law; a slower cart counts as at rest
STICTION_RISE = 1e-3  # [-], of the force scale; a larger rise of F below the standstill speed counts as stiction
CLOSURE_TOLERANCE = 0.1  # [-], of the solution tolerance; residual of a closed cycle
PREDICTOR_TOLERANCE = 1e2  # [-], of the solution tolerance; the first cycle
STATE_PERTURBATION = 1e-5  # [-], of the force scale; finite differences of the cycle map
CONTRACTION = 0.03  # [-], of the residual; a cycle that leaves less is as good as a Newton step of three cycles
NEWTON_DECREASE = 0.5  # [-], of the residual; an accepted Newton step leaves less
AITKEN_FRACTIONS = (1.0, 0.25, 0.06)  # [-], of the extrapolation, tried in turn; the iterates lie on a curve
TINY = np.finfo(float).tiny
MAX_NEWTON_STEPS = 40  # [-]; 1 to 4 are usual
MAX_NEWTON_MOVE = 30.0  # [-], of the force scale; friction differs beyond
FAILURES = {
    TOO_MANY_INTERVALS: f"more than {MAX_INTERVALS} intervals; increase `damping`, or use a rigid drive",
    SPEED_BEYOND_TABLE: "its speed grows without limit; use a `resistance` that falls less steeply with speed",
    STEP_TOO_SHORT: f"steps below {MIN_STEP:g} of a piece of the law; use a smooth `resistance`",
    SEARCH_EXHAUSTED: f"no event found in {MAX_RANGES} ranges of an oscillation; increase `damping`, or use a rigid "
    "drive",
}


@dataclass
class SolutionCost:
    """Cost of a solution: integrations over a cycle or a part, intervals, evaluations of R, Newton steps."""

    integrations: int = 0
    intervals: int = 0
    evaluations: int = 0
    newton_steps: int = 0


class CycleMapEvaluation(NamedTuple):
    """One cycle from the middle of the forward stroke.

    Parameters
    ----------
    first, second : Intervals
        Solution before and after the middle of the forward stroke.
    residual : ndarray, shape (2,)
        Difference of `after` and the initial state, over the force scale.
    """

    first: Intervals
    second: Intervals
    end: elements.CartState
    after: elements.CartState
    residual: Array

    @property
    def intervals(self) -> Intervals:
        """Intervals in order of time, from the start of the cycle."""
        return Intervals._make(map(np.concatenate, zip(self.first, self.second, strict=True)))


class PeriodicProblem:
    """A cart on its spring, with polynomials of the law over time and of the resistance over speed.

    Parameters
    ----------
    resistance : callable
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2].
    tolerance : float
        Of the resistance, relative to the force scale.
    """

    def __init__(
        self, cart: Cart, drive: "ElasticDrive", cycle: Cycle, resistance: Resistance, tolerance: float
    ) -> None:
        self.cost = SolutionCost()
        self.oscillator = _oscillator(cart, drive)
        self.law = _polynomial_law(cycle)
        self.half_stroke_time = cycle.forward.duration / 2
        self.total = _total_resistance(cart, resistance)
        self.sampled_speeds = getattr(resistance, "speeds", ())
        phases = interior_grid(cycle.forward.curve.x)
        velocity, acceleration = (np.abs(cycle.forward.at_phase(phases, k)).max() for k in (1, 2))
        self.max_speed, self.standstill_speed = SPEED_MARGIN * velocity, STANDSTILL_SPEED * velocity
        impact = velocity * math.sqrt(drive.stiffness * cart.mass) if acceleration == 0 else 0.0
        inertia = cart.mass * acceleration + impact
        speeds = self.max_speed * np.linspace(STANDSTILL_SPEED_RATIO, 1, 65)
        self.force_scale = max(inertia, *(np.abs(self.total(sign * speeds)).max() for sign in (1, -1)))
        self.tolerance = tolerance * self.force_scale
        self.acceleration_scale = inertia / cart.mass
        self.rate_limit = getattr(resistance, "rate_limit", np.inf) if drive.include_added_mass else 0.0
        self._tabulate()

    @property
    def _table_tolerance(self):
        """Tolerance of the polynomials of the resistance [N]."""
        return max(TABLE_TOLERANCE * self.tolerance, TABLE_FLOOR * self.force_scale)

    def _tabulate(self):
        """Tabulate the resistance up to the present speed range."""
        slowest, fastest = self.standstill_speed, self.max_speed
        knots = np.array([speed for speed in self.sampled_speeds if slowest < speed < fastest])
        octaves = slowest * 2.0 ** np.arange(math.log2(min([*knots, fastest]) / slowest))
        breaks = np.concatenate([octaves, knots, [fastest]])
        forward, backward = (self._tabulate_force(sign, breaks) for sign in (1, -1))
        added_mass = self._tabulate_added_mass(breaks) if self.rate_limit else elements.NO_ADDED_MASS
        knots = np.append(slowest, knots)
        self.resistance = elements.ResistanceTable(forward, backward, knots, added_mass, float(self.rate_limit))
        highest, lowest = forward.coefficients[0, 0], backward.coefficients[0, 0]
        if highest < lowest:
            raise ValueError(
                f"`resistance` must not drive a cart at rest, got {highest:g} N at speed +0 and {lowest:g} N at -0; "
                "use a resistance with the sign of the velocity"
            )

    def _added_mass(self, speed):
        """Return the added mass M [kg] at speeds > 0, constant below the slowest sample."""
        speed = np.maximum(speed, min(self.sampled_speeds, default=0.0))
        acceleration = np.minimum(self.acceleration_scale, self.rate_limit * speed) / 2
        return (self.total(speed, acceleration) - self.total(speed)) / acceleration

    def _tabulate_added_mass(self, breaks):
        """Tabulate the added mass M over |v|."""
        masses = fit_piecewise(self._added_mass, breaks, self._table_tolerance / self.acceleration_scale)
        least = min(masses.coefficients[:, 0].min(), float(masses(masses.breaks[-1])))
        if self.oscillator.mass + least <= 0:
            raise ValueError(
                f"`mass` must exceed the negative added mass of the resistance, {-least:g} kg, got "
                f"{self.oscillator.mass:g} kg; use `include_added_mass=False`"
            )
        return _from_rest(masses, masses.coefficients[0, 0])

    def _tabulate_force(self, sign, breaks):
        """Tabulate the resistance F over |v| in one direction."""
        try:
            table = fit_piecewise(lambda v: self.total(sign * v), breaks, self._table_tolerance)
        except ValueError as error:
            raise ValueError(f"`resistance` over speed [m/s] has {error}") from None
        return _from_rest(table, *self._standstill_force(sign, table.coefficients[0, 0]))

    def _standstill_force(self, sign, force):
        """F at rest and its rise [N] up to the standstill speed, where F is `force`; a steep rise is stiction.

        Friction within rounding is set to zero, so that no cart sticks to it.
        """
        rest = float(self.total(sign * np.array([STANDSTILL_SPEED_RATIO * self.standstill_speed]))[0])
        rest *= abs(rest) > TABLE_FLOOR * self.force_scale
        if abs(force - rest) <= STICTION_RISE * self.force_scale:
            return rest, force - rest
        if sign * force < sign * rest:
            raise ValueError(
                f"`resistance` over speed [m/s] has a jump at 0, from {rest:g} N to {force:g} N at "
                f"{self.standstill_speed:g} m/s, by which it falls; use a function without jumps"
            )
        return force, 0.0

    @property
    def rest_state(self) -> elements.CartState:
        """State of a cart at rest at the near end, with drive spring and end spring in balance."""
        spring, ends = self.oscillator.stiffness, self.oscillator.end_springs
        half_backlash = self.oscillator.backlash / 2
        if ends.length == 0:
            return elements.CartState(0.0, 0.0, 1 if half_backlash == 0 else 0, 0)
        force = ends.preload + ends.stiffness * ends.length
        compression = (force + spring * half_backlash) / (spring + ends.stiffness)
        flank = 1 if half_backlash == 0 else -1
        if compression < ends.length:
            return elements.CartState(-compression, 0.0, flank, elements.NEAR_SPRING)
        return elements.CartState(-ends.length, 0.0, flank, elements.AT_NEAR_PLATE)

    def integrate(
        self, law: PiecewisePolynomial, state: elements.CartState, tolerance_factor: float = 1.0
    ) -> tuple[Intervals, elements.CartState]:
        """Integrate through the pieces of a law [m] over time [s]: intervals and final state.

        The speed range of the tables is extended where needed.
        """
        for _ in range(MAX_EXTENSIONS):
            intervals = allocate_intervals(MAX_INTERVALS, law.coefficients.shape[1] - 1)  # pages are used when filled
            status, n, evaluations, end, time = integrate(
                self.oscillator, law, self.resistance, state, tolerance_factor * self.tolerance, intervals
            )
            self.cost.integrations += 1
            self.cost.intervals += n
            self.cost.evaluations += evaluations
            if status == DONE:
                return Intervals._make(column[:n].copy() for column in intervals), end
            if status != SPEED_BEYOND_TABLE:
                break
            self.max_speed *= SPEED_MARGIN
            self._tabulate()
        raise RuntimeError(
            f"the integration of the cart ended at {time:g} s of {law.breaks[-1]:g} s after {n} intervals, at "
            f"{end.velocity:g} m/s: {FAILURES[status]}"
        )

    def solve_periodic(self) -> tuple[Intervals, elements.CartState]:
        """Solve the periodic regime.

        A rough cycle predicts the initial state. While one cycle nearly erases the history, or a Newton step does not
        reduce the residual, the next cycle replaces the step.

        Returns
        -------
        tuple
            Intervals of one cycle and the state at its start.
        """
        cycle_map = _CycleMap(self)
        state = cycle_map.predict()
        cycle, before = cycle_map.evaluate(state), np.inf
        for _ in range(MAX_NEWTON_STEPS):
            size = np.abs(cycle.residual).max()
            if cycle_map.is_closed(cycle.residual, cycle.end) and cycle.after[2:] == state[2:]:
                return cycle.intervals, cycle.end
            if size <= CONTRACTION * before:
                state, cycle, before = cycle.after, cycle_map.evaluate(cycle.after, cycle), size
                continue
            self.cost.newton_steps += 1
            state, cycle = cycle_map.step(state, cycle)
            before = 0.0
        raise RuntimeError(
            f"no periodic regime found in {MAX_NEWTON_STEPS} Newton steps: a cycle ends "
            f"{np.abs(cycle.residual).max() * self.force_scale:g} N from its start, possibly by resonance of the "
            'spring or a subharmonic motion; increase `damping`, or use regime "rest"'
        )


class _CycleMap:
    """Map of a state in the middle of the forward stroke over one cycle."""

    def __init__(self, problem: PeriodicProblem) -> None:
        self.problem = problem
        self.late, self.early = _split(problem.law, problem.half_stroke_time)
        stiffness, mass = problem.oscillator.stiffness, problem.oscillator.mass
        self.units = problem.force_scale / np.array([stiffness, math.sqrt(stiffness * mass)])

    def predict(self) -> elements.CartState:
        """State after one rough cycle."""
        integrate, early = self.problem.integrate, self.early
        end = integrate(self.late, self._quasi_static_state(), PREDICTOR_TOLERANCE)[1]
        return integrate(early, end, PREDICTOR_TOLERANCE)[1]

    def _quasi_static_state(self):
        """State in the middle of the forward stroke of a cart that follows the law without oscillation."""
        oscillator, early = self.problem.oscillator, self.early
        width, row = np.diff(early.breaks)[-1], early.coefficients[-1]
        powers = np.arange(len(row))
        velocity, acceleration = row @ powers / width, row @ (powers * (powers - 1)) / width**2
        pull = oscillator.mass * acceleration + float(self.problem.total(np.array([velocity]))[0])
        flank = 1 if oscillator.backlash == 0 else int(np.sign(pull))
        elongation, ends = pull / oscillator.stiffness + flank * oscillator.backlash / 2, oscillator.end_springs
        position = row.sum() - elongation
        in_far_spring = position > ends.stroke - ends.length > 0
        zone = elements.NEAR_SPRING if position < ends.length else elements.FAR_SPRING if in_far_spring else 0
        return elements.CartState(elongation, velocity, flank, zone)

    def evaluate(self, state: elements.CartState, last: "CycleMapEvaluation | None" = None) -> "CycleMapEvaluation":
        """Cycle from a state; the part before the middle is taken from the last cycle if it starts equally."""
        second, end = self.problem.integrate(self.late, state)
        if last is not None and end[2:] == last.end[2:]:
            difference = self._difference(end, last.end)
            if self.is_closed(difference, end):
                return last._replace(second=second, residual=difference)
        first, after = self.problem.integrate(self.early, end)
        return CycleMapEvaluation(first, second, end, after, self._difference(after, state))

    def _difference(self, one, other):
        """Difference of two states over the force scale."""
        return (np.array(one[:2]) - np.array(other[:2])) / self.units

    def is_closed(self, residual: Array, state: elements.CartState) -> bool:
        """Return true for a residual within the tolerance, relative to the amplitude near a resonance."""
        amplitude = max(1.0, np.abs(np.array(state[:2]) / self.units).max())
        limit = CLOSURE_TOLERANCE * self.problem.tolerance / self.problem.force_scale * amplitude
        return np.abs(residual).max() <= limit

    def step(
        self, state: elements.CartState, cycle: "CycleMapEvaluation"
    ) -> tuple[elements.CartState, "CycleMapEvaluation"]:
        """State and cycle after a Newton step, or after a further cycle and Aitken's extrapolation."""
        jacobian = np.empty((2, 2))
        for j in range(2):
            perturbed = _shifted(state, STATE_PERTURBATION * self.units * np.eye(2)[j])
            jacobian[:, j] = (self.evaluate(perturbed).residual - cycle.residual) / STATE_PERTURBATION
        with suppress(np.linalg.LinAlgError, RuntimeError):  # a failed step is replaced by a cycle
            trial, tried = self._try(state, np.linalg.solve(jacobian, -cycle.residual))
            if np.abs(tried.residual).max() < NEWTON_DECREASE * np.abs(cycle.residual).max():
                return trial, tried
        last, state, cycle = cycle.residual, cycle.after, self.evaluate(cycle.after)
        move = _aitken(last, cycle.residual)
        for fraction in AITKEN_FRACTIONS:
            with suppress(RuntimeError):
                _, tried = self._try(state, fraction * move)
                further = self.evaluate(tried.after, tried)  # a further cycle returns to the curve of the iterates
                if np.abs(further.residual).max() < np.abs(cycle.residual).max():
                    return tried.after, further
        return state, cycle

    def _try(self, state, move):
        """State moved by multiples of the units, limited in length, and its cycle."""
        trial = _shifted(state, move * min(1.0, MAX_NEWTON_MOVE / max(np.abs(move).max(), TINY)) * self.units)
        return trial, self.evaluate(trial)


def _from_rest(table: PiecewisePolynomial, *coefficients: float) -> PiecewisePolynomial:
    """Add a piece of given coefficients from 0 to the first break."""
    first = np.zeros((1, table.coefficients.shape[1]))
    first[0, : len(coefficients)] = coefficients
    return PiecewisePolynomial(np.append(0.0, table.breaks), np.concatenate([first, table.coefficients]))


def _aitken(last, residual):
    """Sum of a geometric series of residuals: r q/(1 - q) + r with q = r . r_last/|r_last|^2."""
    ratio = residual @ last / (last @ last)
    return residual / (1 - ratio) if ratio < 1 else residual


def _shifted(state: elements.CartState, by: Array) -> elements.CartState:
    """State with elongation and velocity changed."""
    return elements.CartState(state.elongation + by[0], state.velocity + by[1], state.flank, state.zone)


def _polynomial_law(cycle: Cycle) -> PiecewisePolynomial:
    """Position of the driven end over a cycle as polynomials in time, integrated twice from the acceleration."""
    breaks, rows = [], []
    for leg in cycle.legs():

        def curvature(phase: Array, leg: Leg = leg) -> Array:
            return leg.at_phase(phase, 2) * leg.duration**2

        tolerance = LAW_TOLERANCE * np.abs(curvature(interior_grid(leg.breakpoints()))).max()
        second = fit_piecewise(curvature, leg.breakpoints(), tolerance)
        starts = second.breaks[:-1] + BREAK_OFFSET
        velocity = antiderivative(second, leg.at_phase(starts, 1) * leg.duration)
        position = antiderivative(velocity, leg.at_phase(starts, 0))
        breaks.append(leg.start + leg.duration * position.breaks[:-1])
        rows.append(position.coefficients)
    return PiecewisePolynomial(np.append(np.concatenate(breaks), cycle.period), np.concatenate(rows))


def _split(law: PiecewisePolynomial, time: float) -> tuple[PiecewisePolynomial, PiecewisePolynomial]:
    """PiecewisePolynomial of a law after and before a time [s]."""
    i = int(np.searchsorted(law.breaks, time, side="left"))
    breaks, rows = law.breaks, law.coefficients
    if breaks[i] > time:
        u = (time - breaks[i - 1]) / (breaks[i] - breaks[i - 1])
        halves = substitute(rows[i - 1], 0.0, u), substitute(rows[i - 1], u, 1 - u)
        rows = np.concatenate([rows[: i - 1], halves, rows[i:]])
        breaks = np.insert(breaks, i, time)
    return PiecewisePolynomial(breaks[i:].copy(), rows[i:].copy()), PiecewisePolynomial(
        breaks[: i + 1].copy(), rows[:i].copy()
    )


def _total_resistance(cart: Cart, resistance: Resistance) -> Callable[..., Array]:
    """Resistance and guide friction [N] of velocities [m/s] other than 0 and accelerations [m/s^2]."""

    def total(velocity: Array, acceleration: ArrayLike = 0.0) -> Array:
        acceleration = np.broadcast_to(acceleration, np.shape(velocity))
        force = evaluate_resistance(resistance, velocity, acceleration)
        return balance(cart, 0.0, force, np.sign(velocity)).drive_force

    return total


def _oscillator(cart: Cart, drive: "ElasticDrive") -> elements.OscillatorParameters:
    """Parameters for compiled code, as floats."""
    ends, parameters = cart.end_springs, (cart.mass, drive.stiffness, drive.damping, drive.backlash)
    end_springs = (0.0,) * 4 if ends is None else (ends.stiffness, ends.preload, ends.length, ends.stroke)
    return elements.OscillatorParameters._make(
        [*map(float, parameters), elements.EndSpringParameters._make(map(float, end_springs))]
    )
