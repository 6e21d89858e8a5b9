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
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from compact.machine.cart import Cart, balance
from compact.machine.elastic_motion import integrate
from compact.machine.oscillator import substitute
from compact.machine.rigid_drive import STANDSTILL_SPEED_RATIO, Resistance, evaluate_resistance
from compact.machine.spring_cart import AT_NEAR_PLATE, FAR_SPRING, NEAR_SPRING, CartState, SpringCart, Trajectory
from compact.motion.profile import Cycle, Leg
from compact.numerics import Array
from compact.numerics.piecewise import (
    BREAK_OFFSET,
    DEGREE,
    PiecewisePolynomial,
    antiderivative,
    fit_piecewise,
    interior_grid,
)

MAX_INTERVALS = 20_000  # [-], of a cycle; a dozen are usual, hundreds for a resistance that is curved in speed
LAW_TOLERANCE = 1e-11  # [-], of the peak acceleration; polynomials of the law
TABLE_TOLERANCE = 1e-2  # [-], of the solution tolerance; polynomials of the resistance
TABLE_FLOOR = 1e-12  # [-], of the force scale; smaller tolerances resolve rounding
PRODUCT_TOLERANCE = 1e-9  # [-], of the factor of the travel, at all speeds
SPEED_MARGIN, MAX_EXTENSIONS = 2.0, 8  # [-], growth of the speed range of the tables, and its repetitions
STANDSTILL_SPEED = 1e-6  # [-], of the peak speed of the law; a slower cart counts as at rest
STICTION_RISE = 1e-3  # [-], of the force scale; a larger rise of F below the standstill speed counts as stiction
CLOSURE_TOLERANCE = 0.1  # [-], of the solution tolerance; residual of a closed cycle
PREDICTOR_TOLERANCE = 1e2  # [-], of the solution tolerance; the first cycle
STATE_PERTURBATION = 1e-5  # [-], of the force scale; finite differences of the cycle map
CONTRACTION = 0.03  # [-], of the residual; a cycle that leaves less is as good as a Newton step of three cycles
NEWTON_DECREASE = 0.5  # [-], of the residual; an accepted Newton step leaves less
AITKEN_FRACTIONS = (1.0, 0.25, 0.06)  # [-], of the extrapolation, tried in turn; the iterates lie on a curve
MAX_NEWTON_STEPS = 40  # [-]; 1 to 4 are usual
CONSTANT = PiecewisePolynomial(np.array([0.0, 1.0]), np.zeros((1, DEGREE + 1)))  # of a table that is not used
MAX_NEWTON_MOVE = 30.0  # [-], of the force scale; friction differs beyond


@dataclass
class SolutionCost:
    """Cost of a solution: integrations over a cycle or a part, intervals, evaluations of R, Newton steps."""

    integrations: int = 0
    intervals: int = 0
    evaluations: int = 0
    newton_steps: int = 0


class _CycleResult(NamedTuple):
    """One cycle from the middle of the forward stroke: its late and its early part, and its residual."""

    late: Trajectory
    early: Trajectory
    residual: Array

    @property
    def after(self) -> CartState:
        """State after the cycle."""
        return self.early.end


class CartMotion:
    """A cart on its spring, with polynomials of the law over time and of the resistance over speed and travel.

    Parameters
    ----------
    resistance : callable
        Force of the mix [N] of velocity [m/s], acceleration [m/s^2] and perhaps travel [m].
    tolerance : float
        Of the resistance, relative to the force scale.
    """

    def __init__(self, cart: Cart, drive: Any, cycle: Cycle, resistance: Resistance, tolerance: float) -> None:
        self.cost = SolutionCost()
        self._cart, self._resistance = cart, resistance
        self.law, self.half_stroke_time = _polynomial_law(cycle), cycle.forward.duration / 2
        phases = interior_grid(cycle.forward.curve.x)
        velocity, acceleration = (np.abs(cycle.forward.at_phase(phases, k)).max() for k in (1, 2))
        self.max_speed, self.standstill_speed = SPEED_MARGIN * velocity, STANDSTILL_SPEED * velocity
        impact = velocity * math.sqrt(drive.stiffness * cart.mass) if acceleration == 0 else 0.0
        inertia = cart.mass * acceleration + impact
        speeds = self.max_speed * np.linspace(STANDSTILL_SPEED_RATIO, 1, 65)
        self.force_scale = max(inertia, *(np.abs(self.total(sign * speeds)).max() for sign in (1, -1)))
        self.tolerance = tolerance * self.force_scale
        self._table_tolerance = max(TABLE_TOLERANCE * self.tolerance, TABLE_FLOOR * self.force_scale)
        self.acceleration_scale = inertia / cart.mass
        rate_limit = getattr(resistance, "rate_limit", np.inf) if drive.include_added_mass else 0.0
        self.cart = SpringCart(cart.mass, drive.stiffness, drive.damping, drive.backlash, rate_limit=rate_limit)
        if (ends := cart.end_springs) is not None:
            self.cart = self.cart._replace(
                end_stiffness=ends.stiffness, end_preload=ends.preload, end_length=ends.length, stroke=ends.stroke
            )
        self.cart = SpringCart._make([float(value) if np.ndim(value) == 0 else value for value in self.cart])
        self._factor = self._travel_factor(cycle)
        self._tabulate()
        self.units = self.force_scale / np.array([drive.stiffness, math.sqrt(drive.stiffness * cart.mass)])
        if self.cart.travels.size:
            self.units = self.units[[0, 1, 0]]
        self._late, self._early = _split(self.law, self.half_stroke_time)

    def total(self, velocity: Array, acceleration: Array | float = 0.0, travel: float = np.inf) -> Array:
        """Resistance and guide friction [N] of velocities [m/s] other than 0 and accelerations [m/s^2]."""
        acceleration, travels = (np.broadcast_to(value, np.shape(velocity)) for value in (acceleration, travel))
        force = evaluate_resistance(self._resistance, velocity, acceleration, travels)
        return balance(self._cart, 0.0, force, np.sign(velocity)).drive_force

    def _travel_factor(self, cycle):
        """Table of the factor of the travel; sets the guide friction without the mix."""
        travels = np.asarray(getattr(self._resistance, "travels", ()), float)
        if not travels.size:
            return CONSTANT
        speed = cycle.forward.stroke / cycle.forward.duration

        def factor(travel: Array, speed: float = speed) -> Array:
            velocity, zero = np.full(travel.shape, speed), np.zeros(travel.shape)
            evaluate = evaluate_resistance
            whole = evaluate(self._resistance, velocity, zero, np.full(travel.shape, np.inf))
            return evaluate(self._resistance, velocity, zero, travel) / whole

        table = fit_piecewise(factor, np.append(0.0, travels), TABLE_TOLERANCE * self.tolerance / self.force_scale)
        samples = np.linspace(0, travels[-1], 65)
        for other in (-speed, speed / 8):
            if np.abs(factor(samples, other) - factor(samples)).max() > PRODUCT_TOLERANCE:
                raise ValueError("`resistance` must be a product of a function of velocity and one of travel")
        forward, backward = balance(self._cart, 0.0, np.zeros(2), np.array([1.0, -1.0])).drive_force.tolist()
        self.cart = self.cart._replace(travels=travels, forward_guide=forward, backward_guide=backward)
        last = np.eye(1, table.coefficients.shape[1])  # 1 beyond the last knot
        breaks = np.append(table.breaks, 2 * travels[-1])
        return PiecewisePolynomial(breaks, np.concatenate([table.coefficients, last]))

    def _tabulate(self):
        """Tabulate the resistance up to the present speed range."""
        slowest, fastest = self.standstill_speed, self.max_speed
        knots = np.array([speed for speed in getattr(self._resistance, "speeds", ()) if slowest < speed < fastest])
        octaves = slowest * 2.0 ** np.arange(math.log2(min([*knots, fastest]) / slowest))
        breaks = np.concatenate([octaves, knots, [fastest]])
        forward, backward = (self._tabulate_force(sign, breaks) for sign in (1, -1))
        added_mass = self._tabulate_added_mass(breaks) if self.cart.rate_limit else CONSTANT
        highest, lowest = forward.coefficients[0, 0], backward.coefficients[0, 0]
        if highest < lowest:
            raise ValueError(
                f"`resistance` must not drive a cart at rest, got {highest:g} N at speed +0 and {lowest:g} N at -0; "
                "use a resistance with the sign of the velocity"
            )
        self.cart = self.cart._replace(knots=np.append(slowest, knots)).with_tables(
            forward, backward, added_mass, self._factor
        )

    def _tabulate_added_mass(self, breaks):
        """Tabulate the added mass M over |v|, constant below the slowest sample."""
        slowest = min(getattr(self._resistance, "speeds", ()), default=0.0)

        def added_mass(speed: Array) -> Array:
            speed = np.maximum(speed, slowest)
            acceleration = np.minimum(self.acceleration_scale, self.cart.rate_limit * speed) / 2
            return (self.total(speed, acceleration) - self.total(speed)) / acceleration

        masses = fit_piecewise(added_mass, breaks, self._table_tolerance / self.acceleration_scale)
        least = min(masses.coefficients[:, 0].min(), float(masses(masses.breaks[-1])))
        if self.cart.mass + least <= 0:
            raise ValueError(
                f"`mass` must exceed the negative added mass of the resistance, {-least:g} kg, got "
                f"{self.cart.mass:g} kg; use `include_added_mass=False`"
            )
        return _from_rest(masses, masses.coefficients[0, 0])

    def _tabulate_force(self, sign, breaks):
        """Tabulate the resistance F over |v| in one direction.

        A steep rise from rest up to the standstill speed is stiction. Friction within rounding is set to zero, so that
        no cart sticks to it.
        """
        try:
            table = fit_piecewise(lambda v: self.total(sign * v), breaks, self._table_tolerance)
        except ValueError as error:
            raise ValueError(f"`resistance` over speed [m/s] has {error}") from None
        force = table.coefficients[0, 0]
        slowest = sign * np.array([STANDSTILL_SPEED_RATIO * self.standstill_speed])
        rest = float(self.total(slowest)[0])
        rest *= abs(rest) > TABLE_FLOOR * self.force_scale
        if abs(force - rest) <= STICTION_RISE * self.force_scale:
            return _from_rest(table, rest, force - rest)
        if sign * force < sign * rest:
            raise ValueError(
                f"`resistance` over speed [m/s] has a jump at 0, from {rest:g} N to {force:g} N at "
                f"{self.standstill_speed:g} m/s, by which it falls; use a function without jumps"
            )
        return _from_rest(table, force, 0.0)

    @property
    def rest_state(self) -> CartState:
        """State of a cart at rest at the near end, with drive spring and end spring in balance."""
        cart, half_backlash = self.cart, self.cart.backlash / 2
        if cart.end_length == 0:
            return CartState(0.0, 0.0, 1 if half_backlash == 0 else 0, 0)
        force = cart.end_preload + cart.end_stiffness * cart.end_length
        compression = (force + cart.stiffness * half_backlash) / (cart.stiffness + cart.end_stiffness)
        flank = 1 if half_backlash == 0 else -1
        if compression < cart.end_length:
            return CartState(-compression, 0.0, flank, int(NEAR_SPRING))
        return CartState(-cart.end_length, 0.0, flank, int(AT_NEAR_PLATE))

    def integrate(self, law: PiecewisePolynomial, state: CartState, factor: float = 1.0) -> Trajectory:
        """Integrate through a law [m] over time [s], to a factor of the tolerance.

        The speed range of the tables is extended where needed.
        """
        for _ in range(MAX_EXTENSIONS):
            trajectory, complete, evaluations = integrate(self.cart, law, state, factor * self.tolerance, MAX_INTERVALS)
            self.cost.integrations += 1
            self.cost.intervals += len(trajectory.rows)
            self.cost.evaluations += evaluations
            if complete:
                return trajectory
            self.max_speed *= SPEED_MARGIN
            self._tabulate()
        raise RuntimeError(
            f"the speed of the cart grows without limit, to {self.max_speed:g} m/s; use a `resistance` that falls less "
            "steeply with speed"
        )

    def solve_periodic(self) -> Trajectory:
        """Solve the periodic regime over one cycle.

        A rough cycle predicts the initial state. While one cycle nearly erases the history, or a Newton step does not
        reduce the residual, the next cycle replaces the step.
        """
        state = self.integrate(self._late, self._quasi_static_state(), PREDICTOR_TOLERANCE).end
        state = self.integrate(self._early, state, PREDICTOR_TOLERANCE).end
        cycle, before = self._cycle(state), np.inf
        for _ in range(MAX_NEWTON_STEPS):
            size = np.abs(cycle.residual).max()
            if self._is_closed(cycle.residual, cycle.late.end) and cycle.after[2:4] == state[2:4]:
                rows, end = np.concatenate([cycle.early.rows, cycle.late.rows]), cycle.late.end
                return Trajectory(self.cart, rows, end, end)
            if size <= CONTRACTION * before:
                state, cycle, before = cycle.after, self._cycle(cycle.after, cycle), size
                continue
            self.cost.newton_steps += 1
            state, cycle = self._newton_step(state, cycle)
            before = 0.0
        raise RuntimeError(
            f"no periodic regime found in {MAX_NEWTON_STEPS} Newton steps: a cycle ends "
            f"{np.abs(cycle.residual).max() * self.force_scale:g} N from its start, possibly by resonance of the "
            'spring or a subharmonic motion; increase `damping`, or use regime "rest"'
        )

    def _quasi_static_state(self):
        """State in the middle of the forward stroke of a cart that follows the law without oscillation."""
        cart, width, row = self.cart, np.diff(self._early.breaks)[-1], self._early.coefficients[-1]
        powers = np.arange(len(row))
        velocity, acceleration = row @ powers / width, row @ (powers * (powers - 1)) / width**2
        pull = cart.mass * acceleration + float(self.total(np.array([velocity]))[0])
        flank = 1 if cart.backlash == 0 else int(np.sign(pull))
        elongation = pull / cart.stiffness + flank * cart.backlash / 2
        position = row.sum() - elongation
        in_far_spring = position > cart.stroke - cart.end_length > 0
        zone = int(NEAR_SPRING if position < cart.end_length else FAR_SPRING if in_far_spring else 0)
        return CartState(float(elongation), float(velocity), flank, zone, 0.0, 1)

    def _cycle(self, state: CartState, last: _CycleResult | None = None) -> _CycleResult:
        """Cycle from a state; the part before the middle is taken from the last cycle if it starts equally."""
        late = self.integrate(self._late, state)
        if last is not None and late.end[2:4] == last.late.end[2:4]:
            difference = self._difference(late.end, last.late.end)
            if self._is_closed(difference, late.end):
                return last._replace(late=late, residual=difference)
        early = self.integrate(self._early, late.end)
        return _CycleResult(late, early, self._difference(early.end, state))

    def _difference(self, one, other):
        """Difference of two states over the force scale."""
        return (_continuous(one) - _continuous(other))[: len(self.units)] / self.units

    def _is_closed(self, residual, state):
        """Return true for a residual within the tolerance, relative to the amplitude near a resonance."""
        amplitude = max(1.0, np.abs(np.array(state[:2]) / self.units[:2]).max())
        limit = CLOSURE_TOLERANCE * self.tolerance / self.force_scale * amplitude
        return np.abs(residual).max() <= limit

    def _newton_step(self, state, cycle):
        """State and cycle after a Newton step, or after a further cycle and Aitken's extrapolation."""
        n = len(self.units)
        jacobian = np.empty((n, n))
        for j in range(n):
            perturbed = _shifted(state, STATE_PERTURBATION * self.units * np.eye(n)[j])
            jacobian[:, j] = (self._cycle(perturbed).residual - cycle.residual) / STATE_PERTURBATION
        with suppress(np.linalg.LinAlgError, RuntimeError):  # a failed step is replaced by a cycle
            trial, tried = self._try(state, np.linalg.solve(jacobian, -cycle.residual))
            if np.abs(tried.residual).max() < NEWTON_DECREASE * np.abs(cycle.residual).max():
                return trial, tried
        last, state, cycle = cycle.residual, cycle.after, self._cycle(cycle.after)
        ratio = cycle.residual @ last / (last @ last)
        move = cycle.residual / (1 - ratio) if ratio < 1 else cycle.residual  # sum of a geometric series of residuals
        for fraction in AITKEN_FRACTIONS:
            with suppress(RuntimeError):
                _, tried = self._try(state, fraction * move)
                further = self._cycle(tried.after, tried)  # a further cycle returns to the curve of the iterates
                if np.abs(further.residual).max() < np.abs(cycle.residual).max():
                    return tried.after, further
        return state, cycle

    def _try(self, state, move):
        """State moved by multiples of the units, limited in length, and its cycle."""
        largest = max(np.abs(move).max(), np.finfo(float).tiny)
        trial = _shifted(state, move * min(1.0, MAX_NEWTON_MOVE / largest) * self.units)
        return trial, self._cycle(trial)


def _continuous(state):
    """Elongation [m], velocity [m/s] and position of the last turn [m] of a state."""
    return np.array([state.elongation, state.velocity, state.turn])


def _shifted(state, by):
    """State with elongation, velocity and perhaps the last turn changed."""
    moved = _continuous(state)
    moved[: len(by)] += by
    return state._replace(elongation=moved[0], velocity=moved[1], turn=moved[2])


def _from_rest(table: PiecewisePolynomial, *coefficients: float) -> PiecewisePolynomial:
    """Add a piece of given coefficients from 0 to the first break."""
    first = np.zeros((1, table.coefficients.shape[1]))
    first[0, : len(coefficients)] = coefficients
    return PiecewisePolynomial(np.append(0.0, table.breaks), np.concatenate([first, table.coefficients]))


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
    """Split a law after and before a time [s]."""
    i = int(np.searchsorted(law.breaks, time, side="left"))
    breaks, rows = law.breaks, law.coefficients
    if breaks[i] > time:
        u = (time - breaks[i - 1]) / (breaks[i] - breaks[i - 1])
        halves = substitute(rows[i - 1], 0.0, u), substitute(rows[i - 1], u, 1 - u)
        rows = np.concatenate([rows[: i - 1], halves, rows[i:]])
        breaks = np.insert(breaks, i, time)
    late, early = (breaks[i:], rows[i:]), (breaks[: i + 1], rows[:i])
    return PiecewisePolynomial(*map(np.copy, late)), PiecewisePolynomial(*map(np.copy, early))
