"""Motion of a cart behind a spring over a cycle: tables of law and resistance, integration, periodic regime.

Law and resistance are approximated by piecewise polynomials, with which compiled code integrates the motion
(`spring_cart`). The periodic regime is a fixed point of the map of a state over one cycle. Friction that holds the cart
at the ends erases its history, so that the iteration over cycles converges in a few; Anderson's acceleration makes it
finite for a linear drive.

References
----------
D. G. Anderson, J. ACM 12 (1965) 547.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from compact.machine import spring_cart, spring_forces
from compact.machine.cart import Cart, Resistance, balance
from compact.machine.rigid_drive import SLOW_SPEED_RATIO, STANDSTILL_SPEED_RATIO, evaluate_resistance
from compact.machine.shaft import DIFFERENTIATION, ORDER, TO_CHEBYSHEV
from compact.machine.spring_forces import CartState, SpringCart
from compact.motion.profile import Cycle, Leg
from compact.numerics import Array
from compact.numerics.piecewise import (
    BREAK_OFFSET,
    PiecewisePolynomial,
    antiderivative,
    clenshaw_curtis,
    fit_piecewise,
    interior_grid,
)
from compact.turning import Share, StrokeResistance

MAX_STEPS = 20_000  # [-], of a cycle; 1 kB each, a hundred are usual
CANDIDATES = {129: 0.9, 2049: 0.99}  # samples of the steps with a share of the largest one [-]; others are lower
SAMPLES, WEIGHTS = clenshaw_curtis(2 * ORDER + 1)  # of a step; exact for the power, a product of two polynomials
SAMPLED_POLYNOMIALS = chebyshev.chebvander(2 * SAMPLES - 1, ORDER).T
FINE_POLYNOMIALS = [chebyshev.chebvander(np.linspace(-1, 1, count), ORDER).T for count in CANDIDATES]
ATTEMPTS_PER_CALL = 500  # [-], of one compiled call; 0.1 s or less, then Python handles interrupts
LAW_TOLERANCE = 1e-11  # [-], of the peak acceleration; polynomials of the law
TABLE_TOLERANCE = 1e-2  # [-], of the solution tolerance; polynomials of the resistance
TABLE_FLOOR = 1e-12  # [-], of the force scale; smaller tolerances resolve rounding
SHARE_TABLES = 64  # [-], tables of shares that are kept for further runs
SPEED_MARGIN, MAX_EXTENSIONS = 2.0, 8  # [-], growth of the speed range of the tables, and its repetitions
STANDSTILL_SPEED = 1e-6  # [-], of the peak speed of the law; a slower cart counts as at rest
STICTION_RISE = 1e-3  # [-], of the force scale; a larger rise of F below the standstill speed counts as stiction
DEFECT_SHARE = 0.3  # [-], of the solution tolerance; defect of a step
CLOSURE_TOLERANCE = 0.1  # [-], of the solution tolerance; residual of a closed cycle
PLACE_UNIT = 1e-4  # [-], of the stroke; a turn or front so far away changes the forces by their own size at most
MAX_MOVE = 30.0  # [-], of the force scale; change of the state by an extrapolation
MAX_DEPTH = 3  # [-], differences of an extrapolation
MAX_CYCLES = 400  # [-]; 3 to 8 are usual
DECIDING_CYCLES = 15  # [-], over which residuals fall, or do not
STEADY = 0.95  # [-], rate of residuals in a cycle that do not fall; stable regimes have less than 0.9, alternating and
# irregular cycles of soft springs 0.97 to 1.03


class Kinematics(NamedTuple):
    """Motion and forces at places of a trajectory; arrays of one shape.

    Parameters
    ----------
    position, velocity, acceleration, jerk : ndarray
        Of the cart [m], [m/s], [m/s^2], [m/s^3].
    resistance : ndarray
        Force of mix and guides on the cart [N]; the whole pull for a cart at rest.
    drive_force, end_spring_force : ndarray
        H of drive spring and damper [N], and S of the end springs [N], at a plate the force that holds the cart.
    elongation, elongation_rate : ndarray
        e [m] and e' [m/s].
    driven_velocity : ndarray
        y' of the driven end [m/s].
    force_share, load_share : ndarray
        Shares of the force of the mix and of its load after the last turn [-].
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    resistance: Array
    drive_force: Array
    end_spring_force: Array
    elongation: Array
    elongation_rate: Array
    driven_velocity: Array
    force_share: Array
    load_share: Array


@dataclass(frozen=True)
class Trajectory:
    """Motion of a cart over a time; its properties are arrays of shape (steps,)."""

    cart: SpringCart
    rows: Array
    start: CartState
    end: CartState

    begin = property(lambda self: self.rows[:, 0], doc="Begin of the steps [s].")
    duration = property(lambda self: self.rows[:, 1], doc="Duration of the steps [s].")
    slip = property(lambda self: self.rows[:, 2], doc="Direction of the motion, 0 at rest.")
    flank = property(lambda self: self.rows[:, 3], doc="Flank of the drive, as in `CartState`.")
    zone = property(lambda self: self.rows[:, 4], doc="Zone of the end springs, as in `CartState`.")
    heading = property(lambda self: self.rows[:, 5], doc="Direction of the last motion.")

    @cached_property
    def _nodal(self):
        """Nodal values of y, y', y'', e, e', e'', both shares and the jerk, shape (steps, 9, ORDER + 1)."""
        nodal = self.rows[:, spring_cart.ROW_HEAD :].reshape(-1, spring_cart.CHANNELS, ORDER + 1)
        jerk = (nodal[:, 2] - nodal[:, 5]) @ DIFFERENTIATION.T / self.duration[:, None]
        return np.concatenate([nodal, jerk[:, None]], axis=1)

    @cached_property
    def samples(self) -> Kinematics:
        """Motion and forces at `SAMPLES` of each step, shape (n,)."""
        values = np.moveaxis(self._nodal @ TO_CHEBYSHEV.T @ SAMPLED_POLYNOMIALS, 1, 0)
        return Kinematics(*(each.ravel() for each in self._kinematics(slice(None), values)))

    def at(self, time: Array) -> Kinematics:
        """Motion and forces at times [s] within the trajectory, shape (n,)."""
        i = np.clip(np.searchsorted(self.begin, time, side="right") - 1, 0, len(self.rows) - 1)
        polynomials = chebyshev.chebvander(2 * (time - self.begin[i]) / self.duration[i] - 1, ORDER)
        values = np.einsum("nk,nck->cn", polynomials, (self._nodal @ TO_CHEBYSHEV.T)[i])
        return Kinematics(*(each[:, 0] for each in self._kinematics(i, values[:, :, None])))

    def _kinematics(self, i, values):
        """Kinematics of steps by their `_nodal` quantities, each of shape (steps, n)."""
        cart, (y, pace, change, e, rate, bend, share, load, jerk) = self.cart, values
        slip, flank, zone = (each[i, None] for each in (self.slip, self.flank, self.zone))
        stiffness, side = cart.stiffness * (flank != 0), np.sign(zone)
        position, moves = y - e, slip != 0
        velocity, acceleration = (pace - rate) * moves, (change - bend) * moves
        force = stiffness * (e - flank * cart.backlash / 2) + cart.damping * rate
        compression = cart.end_length - np.where(side > 0, position, cart.stroke - position)
        holding = np.clip(-side * force, 0.0, cart.end_preload)
        pushing = np.where(
            np.abs(zone) == spring_forces.AT_NEAR_PLATE, holding, cart.end_preload + cart.end_stiffness * compression
        )
        end_force = side * pushing
        resistance = force + end_force - cart.mass * acceleration
        jerk = jerk * moves
        if not cart.turns.size:
            share = load = np.ones(y.shape)
        motion = position, velocity, acceleration, jerk, resistance
        return Kinematics(*motion, force, end_force, e, rate, pace, share, load)

    def energy(self, state: CartState, driven_end: float = 0.0) -> float:
        """Energy of cart and springs [J] in a state, with the driven end at a position [m]."""
        cart, position = self.cart, driven_end - state.elongation
        stretch = state.elongation - state.flank * cart.backlash / 2 if state.flank else 0.0
        compression = max(cart.end_length - min(position, cart.stroke - position), 0.0) if cart.end_length else 0.0
        stored = cart.end_preload * compression + cart.end_stiffness / 2 * compression**2
        return cart.mass / 2 * state.velocity**2 + cart.stiffness / 2 * stretch**2 + stored

    @cached_property
    def largest_force_and_power(self) -> tuple[float, float]:
        """Largest |H| [N] and |H y'| [W], also between samples."""
        pace, elongation, rate = (self._nodal[:, k] for k in (1, 3, 4))
        flank = self.flank[:, None]
        stretch = (flank != 0) * (elongation - flank * self.cart.backlash / 2)
        force = (self.cart.stiffness * stretch + self.cart.damping * rate) @ TO_CHEBYSHEV.T
        return self._largest(force), self._largest(force, pace @ TO_CHEBYSHEV.T)

    def _largest(self, *factors: Array) -> float:
        """Largest magnitude of a product of Chebyshev series of each step; by a parabola through three fine samples."""
        fine = np.abs(np.prod([series @ SAMPLED_POLYNOMIALS for series in factors], axis=0))
        for polynomials, share in zip(FINE_POLYNOMIALS, CANDIDATES.values(), strict=True):
            near = fine.max(axis=1) >= share * fine.max()
            factors = tuple(series[near] for series in factors)
            fine = np.abs(np.prod([series @ polynomials for series in factors], axis=0))
        left, middle, right = fine[:, :-2], fine[:, 1:-1], fine[:, 2:]
        summits = (middle > left) & (middle >= right)
        left, middle, right = left[summits], middle[summits], right[summits]
        rises = (right - left) ** 2 / (8 * (2 * middle - left - right))
        return float(max(fine.max(initial=0.0), (middle + rises).max(initial=0.0)))


def integrate(
    cart: SpringCart, law: PiecewisePolynomial, start: CartState, max_steps: int
) -> tuple[Trajectory, bool, int]:
    """Integrate a cart through all pieces of a motion of the driven end [m] over time [s], smooth within each.

    Returns the trajectory, False where its speed exceeds the tables, and the number of evaluations of R.
    """
    state = np.array([*start, 0.0, 0.0, law.breaks[-1] - law.breaks[0], 0.0, 0.0], float)
    parts, count, status = [], 0, spring_cart.PAUSED
    rows = np.empty((ATTEMPTS_PER_CALL, spring_cart.ROW_HEAD + spring_cart.CHANNELS * (ORDER + 1)))
    while status == spring_cart.PAUSED:  # Python handles interrupts between two calls
        status, filled = spring_cart.advance(cart, law, state, rows, ATTEMPTS_PER_CALL)
        count += filled
        if status == spring_cart.STEP_TOO_SHORT or count > max_steps:
            i = min(int(state[spring_cart.PIECE]), len(law.coefficients) - 1)
            time = law.breaks[i] + state[spring_cart.FRACTION] * (law.breaks[i + 1] - law.breaks[i])
            reason = f"more than {max_steps} steps; increase `damping`, or use a rigid drive"
            if status == spring_cart.STEP_TOO_SHORT:
                reason = f"steps below {spring_cart.MIN_STEP:g} of a piece of the law; use a smooth `resistance`"
            raise RuntimeError(
                f"the integration of the cart ended at {time:g} s of {law.breaks[-1]:g} s after {count} steps, at "
                f"{state[spring_forces.VELOCITY]:g} m/s: {reason}"
            )
        parts.append(rows[:filled].copy())
    elongation, velocity, flank, zone, turn, heading, *memory = state[: spring_cart.PIECE].tolist()
    end = CartState(elongation, velocity, int(flank), int(zone), turn, int(heading), *memory)
    return (
        Trajectory(cart, np.concatenate(parts), start, end),
        status == spring_cart.DONE,
        int(state[spring_cart.EVALUATIONS]),
    )


@dataclass
class SolutionCost:
    """Cost of a solution: integrations over parts of a cycle, steps of the last cycle, evaluations of R."""

    integrations: int = 0
    intervals: int = 0
    evaluations: int = 0


class CartMotion:
    """A cart on its spring, with polynomials of the law over time and of the resistance over speed and travel."""

    def __init__(self, cart: Cart, drive: Any, cycle: Cycle, resistance: Resistance, tolerance: float) -> None:
        self.cost = SolutionCost()
        self._cart, self._resistance, self.law = cart, resistance, _polynomial_law(cycle)
        self.half_stroke_time = cycle.forward.duration / 2
        self.mean_speed = cycle.forward.stroke / cycle.forward.duration
        phases = interior_grid(cycle.forward.curve.x)
        velocity, acceleration = (np.abs(cycle.forward.at_phase(phases, k)).max() for k in (1, 2))
        self.max_speed, self.standstill_speed = SPEED_MARGIN * velocity, STANDSTILL_SPEED * velocity
        impact = velocity * math.sqrt(drive.stiffness * cart.mass) if acceleration == 0 else 0.0
        inertia = cart.mass * acceleration + impact
        speeds = self.max_speed * np.linspace(STANDSTILL_SPEED_RATIO, 1, 65)
        self.strokes = resistance if isinstance(resistance, StrokeResistance) else None
        self.scale = max(inertia, np.abs(self.total(np.append(speeds, -speeds))).max())
        self.tolerance, self.table_tolerance = tolerance, max(TABLE_TOLERANCE * tolerance, TABLE_FLOOR) * self.scale
        ends = 0.0, 0.0, 0.0, cycle.forward.stroke
        if (springs := cart.end_springs) is not None:
            ends = springs.stiffness, springs.preload, springs.length, springs.stroke
        spring = cart.mass, drive.stiffness, drive.damping, drive.backlash
        scales = self.scale, DEFECT_SHARE * tolerance * self.scale
        numbers: list[Any] = [float(each) for each in (*spring, *ends, *scales)]
        self.cart = SpringCart(*numbers)
        self.shares: list[PiecewisePolynomial] = []
        if self.strokes is not None:
            self._follow_strokes(self.strokes)
        self._tabulate()

    def _follow_strokes(self, strokes):
        """Set the shares along the stroke, and the friction of the guide wheels, which depends on them."""
        pairs = (strokes.forward, strokes.forward_load), (strokes.backward, strokes.backward_load)
        self.shares = [share_table(share, TABLE_TOLERANCE * self.tolerance) for pair in pairs for share in pair]
        turns = [(force.distance, force.release, force.track, load.track) for force, load in pairs]
        travels = [sorted({*force.travels, *load.travels}) for force, load in pairs]
        count = max(map(len, travels))
        places = [each + [np.inf] * (count - len(each)) for each in travels]
        ratios = strokes.force_ratio(SLOW_SPEED_RATIO * self.mean_speed), self._cart.return_load_ratio
        self.cart = self.cart._replace(
            turns=np.array(turns, float), places=np.array(places, float), ratios=np.array([ratios]).ravel(),
            wheels=guide_wheels(self._cart, self.scale),
        )  # fmt: skip

    def total(self, velocity: Array) -> Array:
        """Resistance and guide friction [N] far from a turn, of velocities [m/s] except 0."""
        mix = evaluate_resistance(self._resistance, velocity, np.zeros(velocity.shape))
        return balance(self._cart, 0.0, mix, np.sign(velocity)).drive_force

    def _tabulated(self, velocity):
        """Force in the tables [N]: with shares along the stroke that of the mix alone."""
        if self.strokes is None:
            return self.total(velocity)
        return evaluate_resistance(self._resistance, velocity, np.zeros(velocity.shape))

    def _tabulate(self):
        """Tabulate the resistance up to the present speed range."""
        slowest, fastest = self.standstill_speed, self.max_speed
        knots = np.array([speed for speed in getattr(self._resistance, "speeds", ()) if slowest < speed < fastest])
        octaves = slowest * 2.0 ** np.arange(math.log2(min([*knots, fastest]) / slowest))
        speeds = np.concatenate([octaves, knots, [fastest]])
        breaks = np.concatenate([-speeds[::-1], [0.0], speeds])
        try:
            force = fit_piecewise(lambda v: self._tabulated(_faster(v, slowest)), breaks, self.table_tolerance)
        except ValueError as error:
            raise ValueError(f"`resistance` over speed [m/s] has {error}") from None
        self._set_rest(force)
        self.cart = self.cart._replace(knots=np.append(slowest, knots)).with_tables(force, *self.shares)

    def _set_rest(self, force):
        """Set the table of the resistance near rest, where it is constant.

        A steep rise from rest up to the standstill speed is stiction. Friction within rounding is set to zero, so that
        no cart sticks to it.
        """
        first, limits = int(np.searchsorted(force.breaks, 0.0)), []
        for sign, row in ((-1, force.coefficients[first - 1]), (1, force.coefficients[first])):
            moving, slowest = row[0], sign * STANDSTILL_SPEED_RATIO * self.standstill_speed
            rest = float(self._tabulated(np.array([slowest]))[0])
            rest *= abs(rest) > TABLE_FLOOR * self.scale
            if abs(moving - rest) <= STICTION_RISE * self.scale:
                row[:2] = (rest, moving - rest) if sign > 0 else (moving, rest - moving)
                moving = rest
            elif sign * moving < sign * rest:
                raise ValueError(
                    f"`resistance` over speed [m/s] has a jump at 0, from {rest:g} N to {moving:g} N at "
                    f"{self.standstill_speed:g} m/s, by which it falls; use a function without jumps"
                )
            limits.append(moving)
        lowest, highest = limits
        if highest < lowest:
            raise ValueError(
                f"`resistance` must not drive a cart at rest, got {highest:g} N at speed +0 and {lowest:g} N at -0; "
                "use a resistance with the sign of the velocity"
            )

    @property
    def rest_state(self) -> CartState:
        """State of a cart at rest at the near end after a return stroke, drive spring and end spring in balance."""
        cart, half_backlash = self.cart, self.cart.backlash / 2
        memory = cart.stroke, -1, cart.stroke, 0.0, 0.0, -cart.stroke
        if cart.end_length == 0:
            return CartState(0.0, 0.0, 1 if half_backlash == 0 else 0, 0, *memory)
        force = cart.end_preload + cart.end_stiffness * cart.end_length
        compression = (force + cart.stiffness * half_backlash) / (cart.stiffness + cart.end_stiffness)
        flank = 1 if half_backlash == 0 else -1
        if compression < cart.end_length:
            return CartState(-compression, 0.0, flank, int(spring_forces.NEAR_SPRING), *memory)
        return CartState(-cart.end_length, 0.0, flank, int(spring_forces.AT_NEAR_PLATE), *memory)

    def integrate(self, law: PiecewisePolynomial, state: CartState) -> Trajectory:
        """Integrate through a law [m] over time [s]; the speed range of the tables is extended where needed."""
        for _ in range(MAX_EXTENSIONS):
            trajectory, complete, evaluations = integrate(self.cart, law, state, MAX_STEPS)
            cost = self.cost
            self.cost = SolutionCost(cost.integrations + 1, len(trajectory.rows), cost.evaluations + evaluations)
            if complete:
                return trajectory
            self.max_speed *= SPEED_MARGIN
            self._tabulate()
        raise RuntimeError(
            f"the speed of the cart grows without limit, to {self.max_speed:g} m/s; use a `resistance` that falls less "
            "steeply with speed"
        )

    def _cycle(self, state: CartState, early: PiecewisePolynomial, late: PiecewisePolynomial) -> Trajectory:
        """Cycle from a state in the middle of the forward stroke; steps in order of time, state at that place."""
        second = self.integrate(late, state)
        first = self.integrate(early, second.end)
        self.cost.intervals += len(second.rows)
        return Trajectory(self.cart, np.concatenate([first.rows, second.rows]), second.end, first.end)

    def solve_periodic(self) -> Trajectory:
        """Solve the periodic regime: fixed point of a cycle by Anderson's acceleration.

        A cycle begins in the middle of the forward stroke, where the cart moves; the first one after half a stroke from
        rest. Where accelerated cycles do not close further, plain ones let a stable regime settle; there is none where
        they do not close further either.
        """
        middle = int(np.searchsorted(self.law.breaks, self.half_stroke_time * (1 - 1e-9)))
        early = PiecewisePolynomial(self.law.breaks[: middle + 1], self.law.coefficients[:middle])
        late = PiecewisePolynomial(self.law.breaks[middle:], self.law.coefficients[middle:])
        cart, state, halfway = self.cart, self.integrate(early, self.rest_state).end, early.coefficients[-1].sum()
        free = [0, 1]  # elongation and velocity, and the memory of the turns
        units = self.scale / np.array([cart.stiffness, math.sqrt(cart.stiffness * cart.mass)])
        if cart.turns.size:
            free = [0, 1, 4, *range(6, len(state))]
            shift = max(units[0], PLACE_UNIT * cart.stroke)
            units = np.concatenate([units, np.full(5, shift), [1.0, 1.0]])
        depth = min(len(free), MAX_DEPTH)
        places: list[Array] = []
        residuals: list[Array] = []
        sizes: list[float] = []
        first_plain = 0  # of the sizes; 0 while cycles are accelerated
        for _ in range(MAX_CYCLES):
            trajectory = self._cycle(state, early, late)
            end = trajectory.end
            position = halfway - end.elongation
            if cart.turns.size and end.heading > 0 and end.backward_front + position > cart.turns[1, 0]:
                # the next return stroke meets fresh mix, as after a turn here: the track of the last is without effect
                end = end._replace(backward_front=cart.turns[1, 0] - position, backward_origin=-position)
            place, residual = (np.array(each)[free] / units for each in (state, np.subtract(end, state)))
            size, amplitude = np.abs(residual).max(), max(1.0, np.abs(place[:2]).max())
            if size <= CLOSURE_TOLERANCE * self.tolerance * amplitude and end[2:4] == state[2:4]:
                return replace(trajectory, end=trajectory.start)
            sizes.append(float(size))
            if (rate := _rate(sizes[first_plain:])) > STEADY:
                if first_plain:
                    break
                first_plain = len(sizes)
            if residuals and size > np.abs(residuals[-1]).max():  # the extrapolation failed
                places, residuals = [], []
            places, residuals = [*places[-depth:], place], [*residuals[-depth:], residual]
            move = residual
            if len(places) > 1 and not first_plain:
                moves, changes = np.diff(places, axis=0).T, np.diff(residuals, axis=0).T
                move = residual - (moves + changes) @ np.linalg.lstsq(changes, residual, rcond=1e-10)[0]
                move *= min(1.0, MAX_MOVE / max(np.abs(move).max(), 1.0))
            values = list(end)
            for k, value in zip(free, ((place + move) * units).tolist(), strict=True):
                values[k] = value
            state = CartState._make(values)
        found = "no periodic regime found" if rate > STEADY else "a periodic regime is not decided"
        raise RuntimeError(
            f"{found} in {len(sizes)} cycles: a cycle ends {size * self.scale:g} N from its start, "
            'possibly by resonance of the spring or a subharmonic motion; increase `damping`, or use regime "rest"'
        )


def _rate(sizes):
    """Rate at which residuals fall in a cycle, by their largest over `DECIDING_CYCLES`; 0 while there are too few."""
    if len(sizes) < 2 * DECIDING_CYCLES:
        return 0.0
    before, after = max(sizes[-2 * DECIDING_CYCLES : -DECIDING_CYCLES]), max(sizes[-DECIDING_CYCLES:])
    return (after / before) ** (1 / DECIDING_CYCLES)


@lru_cache(maxsize=SHARE_TABLES)
def share_table(share: Share, tolerance: float) -> PiecewisePolynomial:
    """Tabulate a share over the travel [m], constant beyond its last; runs use one table, which never changes."""
    last = share.travels[-1] or 1.0
    table = fit_piecewise(share, np.unique([0.0, *share.travels, last]), tolerance)
    beyond = np.eye(1, table.coefficients.shape[1]) * share(2 * last)
    return PiecewisePolynomial(np.append(table.breaks, 2 * last), np.concatenate([table.coefficients, beyond]))


def guide_wheels(cart: Cart, size: float) -> Array:
    """Friction of both guide wheels by heading [N]: constant, over the load share and over the force of the mix [-]."""
    loads, forces, directions = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, size]), np.array([[1.0], [-1.0]])
    found = balance(cart, 0.0, forces, directions, load_share=loads)
    reactions = cart.guide_friction * np.stack([found.front_reaction, found.rear_reaction], axis=1)
    return np.stack(
        [reactions[..., 0], reactions[..., 1] - reactions[..., 0], (reactions[..., 2] - reactions[..., 0]) / size], -1
    )


def _faster(velocity: Array, slowest: float) -> Array:
    """Velocities [m/s] of a least magnitude."""
    return np.copysign(np.maximum(np.abs(velocity), slowest), velocity)


def _polynomial_law(cycle: Cycle) -> PiecewisePolynomial:
    """Position of the driven end over a cycle as polynomials in time, integrated twice from the acceleration."""
    breaks, rows = [], []
    for leg in cycle.legs():

        def curvature(phase: Array, leg: Leg = leg) -> Array:
            return leg.at_phase(phase, 2) * leg.duration**2

        joins = np.union1d(leg.breakpoints(), 0.5)
        tolerance = LAW_TOLERANCE * np.abs(curvature(interior_grid(joins))).max()
        second = fit_piecewise(curvature, joins, tolerance)
        starts = second.breaks[:-1] + BREAK_OFFSET
        velocity = antiderivative(second, leg.at_phase(starts, 1) * leg.duration)
        position = antiderivative(velocity, leg.at_phase(starts, 0))
        breaks.append(leg.start + leg.duration * position.breaks[:-1])
        rows.append(position.coefficients)
    return PiecewisePolynomial(np.append(np.concatenate(breaks), cycle.period), np.concatenate(rows))
