"""Cart behind a drive spring: its forces, and its trajectory of intervals between events.

    H + S = k (e - o) + c e' + S(x),   S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between
    R = f + g(s) (F(v) - f + a' M(|v|)),   a' = a for |a| <= L |v|,   a' = L |v| sign(a) beyond

e is the elongation, o the engaged half of the backlash, x the position of the cart, s its travel since the last turn, f
the guide friction without the mix. F jumps at v = 0 and has one table for each direction. M is the added mass of a
resistance that depends to first order on the acceleration; the expansion does not hold beyond L |v|. Because of the
preload P, S jumps at the plate of an end spring; a cart at rest there is held by any force from 0 to P.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from compact.machine.oscillator import (
    POLYNOMIAL,
    SCALE,
    SERIES_TERMS,
    ZERO_TOLERANCE,
    combine,
    evaluate,
    max_abs_product,
    transform,
)
from compact.numerics import Array, BoolArray, IntArray
from compact.numerics.jit import compiled, internal
from compact.numerics.piecewise import PiecewisePolynomial, clenshaw_curtis

KNOT_TOLERANCE = 1e-6  # [-], of a speed or of an interval; a motion so close to a knot is on it
EXTRAPOLATION_LENGTH = 0.5  # [-], of a table piece; its polynomial is continued so far beyond a knot
PULL_ROUNDING = 1e-10  # [-], of the pull; a smaller force of inertia is rounding and does not select a smooth range
STICTION_TOLERANCE = 1e-12  # [-], of the width of the stiction range; rounding of the pull
NEAR_SPRING, FAR_SPRING = 1.0, -1.0  # zones; the cart compresses an end spring, 0 between the springs
AT_NEAR_PLATE, AT_FAR_PLATE = 2.0, -2.0  # zones; the cart is at rest at the plate of an end spring
FREE_SATURATION = 2.0  # marker; the motion itself determines the saturation, distinct from -1, 0 and 1
FORWARD, BACKWARD, ADDED_MASS, FACTOR = range(4)  # tables of a `SpringCart`


class SpringCart(NamedTuple):
    """Cart on its drive spring, with its resistance as tables.

    Parameters
    ----------
    mass, stiffness, damping, backlash : float
        m [kg], k [N/m] and c [N s/m] of the drive, and play between the flanks [m].
    end_stiffness, end_preload, end_length, stroke : float
        Of the end springs [N/m], [N], [m] (0 without springs), and stroke [m].
    rate_limit : float
        Limit L of |a|/|v| [1/s] for the added-mass term; 0 without added mass.
    forward_guide, backward_guide : float
        Guide friction f [N] for v > 0 and for v < 0, without the mix.
    knots, travels : ndarray, shape (n,)
        Speeds |v| [m/s] at which F, and travels [m] at which g is not smooth; no travels for g = 1.
    pieces : ndarray, shape (n, 2 + terms)
        Ends and coefficients of the pieces of all tables: F [N] for v > 0 and for v < 0, and M [kg], over |v| [m/s]
        from 0, and g [-] over s [m].
    firsts : ndarray, shape (5,)
        Rows at which the tables begin and end.
    """

    mass: float
    stiffness: float
    damping: float
    backlash: float = 0.0
    end_stiffness: float = 0.0
    end_preload: float = 0.0
    end_length: float = 0.0
    stroke: float = 0.0
    rate_limit: float = 0.0
    forward_guide: float = 0.0
    backward_guide: float = 0.0
    knots: Array = np.empty(0)
    travels: Array = np.empty(0)
    pieces: Array = np.empty((0, 2))
    firsts: IntArray = np.zeros(5, np.int64)

    def with_tables(self, *tables: PiecewisePolynomial) -> "SpringCart":
        """Cart with other tables, in the order of `FORWARD`, `BACKWARD`, `ADDED_MASS`, `FACTOR`."""
        pieces = [np.column_stack([table.breaks[:-1], table.breaks[1:], table.coefficients]) for table in tables]
        firsts = np.cumsum([0, *map(len, pieces)] + [0] * (FACTOR + 1 - len(pieces)))
        return self._replace(pieces=np.concatenate(pieces), firsts=firsts)


class CartState(NamedTuple):
    """State of a cart behind a spring.

    Parameters
    ----------
    elongation, velocity : float
        e [m] of the drive spring and x' [m/s].
    flank : int
        +1 or -1 in contact with a flank, 0 within the backlash; always +1 without backlash.
    zone : int
        `NEAR_SPRING`, `FAR_SPRING`, `AT_NEAR_PLATE`, `AT_FAR_PLATE`, or 0 between the end springs.
    turn : float
        Position of the last turn [m].
    heading : int
        Direction of the last motion.
    """

    elongation: float
    velocity: float
    flank: int
    zone: int = 0
    turn: float = 0.0
    heading: int = -1


class SmoothRange(NamedTuple):
    """Limits of |v| [m/s] and of s [m] between which R is smooth, and sign of the saturated added-mass term."""

    low: float
    high: float
    saturation: float
    travelled: float
    farthest: float


class Tangent(NamedTuple):
    """R near the start: force + damping (v - velocity) + added_mass (a - acceleration) + stiffness (x - position).

    The position x is counted from the last turn.
    """

    force: float
    damping: float
    added_mass: float
    stiffness: float
    velocity: float
    acceleration: float
    position: float
    turn: float


FULL_RANGE = SmoothRange(0.0, np.inf, FREE_SATURATION, 0.0, np.inf)
UNSATURATED = SmoothRange(0.0, np.inf, 0.0, 0.0, np.inf)


@internal
def _table(rows, first, end, abscissa, low, high):
    """Value and slope of a table, continued beyond a smooth range from low to high.

    The outermost piece is continued by `EXTRAPOLATION_LENGTH` and by its tangent beyond; below the range the slope is
    the secant from rest, since the polynomial of a narrow piece would amplify rounding. Beyond its own ends the table
    is continued by its tangent.
    """
    i = first
    while end - i > 1:
        middle = (i + end) // 2
        if rows[middle, 0] <= max(abscissa, low) and rows[middle, 0] < high:
            i = middle
        else:
            end = middle
    width = rows[i, 1] - rows[i, 0]
    u, value, slope = (abscissa - rows[i, 0]) / width, 0.0, 0.0
    lowest = -EXTRAPOLATION_LENGTH if low > 0 else 0.0
    inside = min(max(u, lowest), 1 + EXTRAPOLATION_LENGTH if high < np.inf else 1.0)
    for j in range(rows.shape[1] - 1, 1, -1):
        slope = slope * inside + value
        value = value * inside + rows[i, j]
    if u < inside and low > 0:
        slope = (rows[i, 2] - rows[first, 2]) / low * width
    return value + slope * (u - inside), slope / width


@internal
def _saturation_sign(rate_limit, slip, speed, acceleration):
    """Sign of the saturated added-mass term, 0 within the limit."""
    if not 0 < rate_limit < np.inf or abs(acceleration) < rate_limit * speed:
        return 0.0
    return (
        slip if acceleration == 0 else 1.0 if acceleration > 0 else -1.0
    )  # at rest the cart accelerates with its slip


@internal
def differentiate_resistance(
    cart: SpringCart, slip: float, velocity: float, acceleration: float, travel: float, within: SmoothRange
) -> tuple[float, float, float, float]:
    """R [N], dR/dv [N s/m], dR/da [kg] and dR/dx [N/m], continued beyond a smooth range."""
    speed = slip * velocity
    rows, firsts, which = cart.pieces, cart.firsts, FORWARD if slip > 0 else BACKWARD
    force, slope = _table(rows, firsts[which], firsts[which + 1], speed, within.low, within.high)
    damping, mass, stiffness = slip * slope, 0.0, 0.0
    if cart.rate_limit > 0:
        mass, mass_slope = _table(rows, firsts[ADDED_MASS], firsts[ADDED_MASS + 1], speed, within.low, within.high)
        saturation = within.saturation
        if saturation == FREE_SATURATION:
            saturation = _saturation_sign(cart.rate_limit, slip, speed, acceleration)
        if saturation == 0:
            force, damping = force + mass * acceleration, slip * (slope + mass_slope * acceleration)
        else:
            force += saturation * mass * cart.rate_limit * speed
            damping, mass = slip * (slope + saturation * cart.rate_limit * (mass + mass_slope * speed)), 0.0
    if len(cart.travels) > 0:
        factor, steepness = _table(rows, firsts[FACTOR], firsts[FACTOR + 1], travel, within.travelled, within.farthest)
        guide = cart.forward_guide if slip > 0 else cart.backward_guide
        stiffness = slip * steepness * (force - guide)
        force, damping, mass = guide + factor * (force - guide), factor * damping, factor * mass
    return force, damping, mass, stiffness


@internal
def spring_force(cart: SpringCart, flank: float, zone: float) -> tuple[float, float, float]:
    """k, n and constant of the force k e - n y + constant of drive and end springs [N]."""
    stiffness = cart.stiffness if flank != 0 else 0.0
    constant = -stiffness * flank * cart.backlash / 2
    if abs(zone) != NEAR_SPRING:
        return stiffness, 0.0, constant
    force = cart.end_preload + cart.end_stiffness * cart.end_length
    if zone == FAR_SPRING:
        force = cart.end_stiffness * cart.stroke - force
    return stiffness + cart.end_stiffness, cart.end_stiffness, force + constant


@internal
def stiction_limits(cart: SpringCart, heading: float, travel: float, zone: float) -> tuple[float, float]:
    """Smallest and largest pull [N] under which a cart at rest stays at rest, after a travel in a heading."""
    lowest = differentiate_resistance(cart, -1.0, 0.0, 0.0, travel if heading < 0 else 0.0, FULL_RANGE)[0]
    highest = differentiate_resistance(cart, 1.0, 0.0, 0.0, travel if heading > 0 else 0.0, FULL_RANGE)[0]
    if zone == AT_NEAR_PLATE:
        lowest -= cart.end_preload
    if zone == AT_FAR_PLATE:
        highest += cart.end_preload
    return lowest, highest


@internal
def breakaway_direction(limits: tuple[float, float], pull: float) -> float:
    """Direction in which a cart at rest starts under a pull [N], 0 where friction or a plate holds it."""
    lowest, highest = limits
    tolerance = STICTION_TOLERANCE * (highest - lowest)
    return 1.0 if pull > highest + tolerance else -1.0 if pull < lowest - tolerance else 0.0


@internal
def _knots_around(knots, place):
    """Last knot up to a place, or 0, and first knot beyond it, or infinity."""
    low, high = 0.0, np.inf
    for k in range(len(knots)):
        if knots[k] <= place:
            low = knots[k]
        else:
            high = min(high, knots[k])
    return low, high


@internal
def solve_acceleration(cart: SpringCart, slip: float, velocity: float, travel: float, pull: float) -> float:
    """Acceleration a [m/s^2] with m a + R = pull, for m + M > 0."""
    net, added = pull - differentiate_resistance(cart, slip, velocity, 0.0, travel, FULL_RANGE)[0], 0.0
    if cart.rate_limit > 0:
        added = differentiate_resistance(cart, slip, velocity, 0.0, travel, UNSATURATED)[2]
    a = net / (cart.mass + added)
    limit = cart.rate_limit * slip * velocity if 0 < cart.rate_limit < np.inf else np.inf
    return a if abs(a) < limit else (net - np.sign(net) * added * limit) / cart.mass


@internal
def linearise(
    cart: SpringCart, slip: float, velocity: float, travel: float, turn: float, pull: float
) -> tuple[SmoothRange, Tangent]:
    """Smooth range that a sliding cart enters under a pull [N], and the tangent of R there."""
    a, speed = solve_acceleration(cart, slip, velocity, travel, pull), slip * velocity
    acceleration = 0.0 if abs(cart.mass * a) <= PULL_ROUNDING * abs(pull) else a
    margin = 1 + KNOT_TOLERANCE if slip * acceleration > 0 else 1 - KNOT_TOLERANCE
    low, high = _knots_around(cart.knots, speed * margin)
    travelled, farthest = _knots_around(cart.travels, travel * (1 + KNOT_TOLERANCE))
    saturation = _saturation_sign(cart.rate_limit, slip, speed, acceleration)
    within = SmoothRange(low, high, saturation, travelled, farthest)
    force, damping, added, stiffness = differentiate_resistance(cart, slip, velocity, a, travel, within)
    return within, Tangent(force, damping, added, max(stiffness, 0.0), velocity, a, slip * travel, turn)


CELL_POINTS = 17  # [-], points of a cell; integrals of the square of an oscillation are exact to 1e-9
CELL_ANGLE = 2.5  # [rad], of an oscillation; size of a cell
OSCILLATION_FLOOR = 1e-12  # [-], of the initial amplitude; a smaller oscillation is not resolved
MAX_SAMPLES = 250_000  # [-], of a cycle; 1 kB each at the peak, 128 B for the lifetime of the run
RANGES_PER_CALL = 50_000  # [-], of one compiled call; 0.1 s or less
ROW_HEAD = 6  # columns of an interval before its signal and its driven end: start, duration, slip, flank, zone, turn


class Intervals(NamedTuple):
    """Solution over intervals between events, one row per interval; u = (t - start)/scale.

    Parameters
    ----------
    start, duration, scale : ndarray, shape (n,)
        Start, duration and time over which u increases by 1 [s], duration <= scale.
    slip, flank, zone : ndarray, shape (n,)
        Direction of the motion, 0 at rest, and as in `CartState`.
    turn : ndarray, shape (n,)
        Position of the last turn [m].
    decay, discriminant, cosine, sine : ndarray, shape (n,)
        d, D, A and B of the elongation.
    elongation : ndarray, shape (n, SERIES_TERMS)
        Polynomial part of the elongation e(u) [m].
    driven_end : ndarray, shape (n, degree + 1)
        Coefficients of the driven-end position y(u) [m].
    """

    start: Array
    duration: Array
    slip: IntArray
    flank: IntArray
    zone: IntArray
    turn: Array
    decay: Array
    discriminant: Array
    scale: Array
    cosine: Array
    sine: Array
    elongation: Array
    driven_end: Array


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
    driven_end, driven_velocity : ndarray
        y [m] and y' [m/s].
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
    driven_end: Array
    driven_velocity: Array


@compiled
def _sample(cart: SpringCart, rows: Array, places: IntArray, us: Array) -> Array:
    """`Kinematics` at places of intervals, shape (11, n)."""
    out, last, first = np.empty((11, len(us))), -1, ROW_HEAD + POLYNOMIAL + SERIES_TERMS
    for n in range(len(us)):
        if places[n] != last:
            last = places[n]
            row = rows[last]
            e, slip, flank, zone = row[ROW_HEAD:first], row[2], row[3], row[4]
            y, e_rate = combine(e, row[first:], 0.0, 0.0, 1.0, 0.0, 0.0), transform(e, 0.0, 1.0, 0.0)
            y_rate = transform(y, 0.0, 1.0, 0.0)
            y_change = transform(y_rate, 0.0, 1.0, 0.0)
            stiffness, _, constant = spring_force(cart, flank, 0.0)
        u = us[n]
        elongation, rate, driven, pace = evaluate(e, u), evaluate(e_rate, u), evaluate(y, u), evaluate(y_rate, u)
        force, side = stiffness * elongation + constant + cart.damping * rate, np.sign(zone)
        position, velocity = driven - elongation, (pace - rate) * abs(slip)
        compressed = cart.end_preload + cart.end_stiffness * (
            cart.end_length - (position if side > 0 else cart.stroke - position)
        )
        holding = min(max(-side * force, 0.0), cart.end_preload)
        end_force = side * (holding if abs(zone) == AT_NEAR_PLATE else compressed)
        acceleration = jerk = 0.0
        resistance = pull = force + end_force
        if slip != 0:
            travel, until = slip * (position - row[5]), row[1] / e[SCALE]
            acceleration = solve_acceleration(cart, slip, velocity, travel, pull)
            resistance = pull - cart.mass * acceleration
            inside = min(max(u, KNOT_TOLERANCE), until * (1 - KNOT_TOLERANCE))  # slopes are limits from inside
            within = evaluate(y_rate, inside) - evaluate(e_rate, inside)
            _, damping, mass, steepness = differentiate_resistance(cart, slip, within, acceleration, travel, FULL_RANGE)
            steepness += cart.end_stiffness if abs(zone) == NEAR_SPRING else 0.0
            pull_rate = stiffness * rate + cart.damping * (evaluate(y_change, u) - acceleration)
            jerk = (pull_rate - damping * acceleration - steepness * velocity) / (cart.mass + mass)
        values = (position, velocity, acceleration, jerk, resistance, force, end_force, elongation, rate, driven, pace)
        for k in range(11):
            out[k, n] = values[k]
    return out


@dataclass(frozen=True)
class Trajectory:
    """Motion of a cart over a time. A place is an interval index i and u in [0, duration/scale]."""

    cart: SpringCart
    rows: Array
    start: CartState
    end: CartState

    @cached_property
    def intervals(self) -> Intervals:
        """Intervals between events, in order of time."""
        start, duration, slip, flank, zone, turn, *signal = self.rows[:, : ROW_HEAD + POLYNOMIAL].T
        elongation, driven_end = np.split(self.rows[:, ROW_HEAD + POLYNOMIAL :], [SERIES_TERMS], axis=1)
        directions = (column.astype(int) for column in (slip, flank, zone))
        return Intervals._make([start, duration, *directions, turn, *signal, elongation, driven_end])

    @cached_property
    def _cells(self) -> tuple[BoolArray, Array, IntArray]:
        """Oscillation beyond rounding, time [s] in which it is resolved, and number of cells, of each interval."""
        intervals, (rates, elongations) = self.intervals, (self.intervals.discriminant, self.intervals.elongation)
        reach = np.divide(1, np.sqrt(np.abs(rates)), out=np.full(len(rates), np.inf), where=rates != 0)
        amplitude = np.abs(intervals.cosine) + np.abs(intervals.sine) * np.minimum(intervals.duration, reach)
        oscillates = amplitude > ZERO_TOLERANCE * np.abs(elongations).max(axis=1)
        resolved = oscillation_time(intervals.decay, intervals.duration)
        angle = resolved * np.sqrt(np.maximum(intervals.decay**2 - rates, 0.0))
        return oscillates, resolved, np.ceil(angle / CELL_ANGLE * (oscillates & (rates < 0))).astype(int)

    @property
    def sample_count(self) -> int:
        """Upper bound of the number of `sample_points`, without their computation."""
        return CELL_POINTS * int(np.sum(self._cells[2] + 2))

    def sample_points(self) -> tuple[IntArray, Array, Array]:
        """Interval indices i, places u and weights [s] that resolve imposed motion and oscillation, shape (n,)."""
        nodes, unit_weights = clenshaw_curtis(CELL_POINTS)
        columns = []
        for i, scale in enumerate(self.intervals.scale):
            edges = self._cell_edges(i)
            width = np.diff(edges)[:, None]
            t = (edges[:-1, None] + width * nodes).ravel()
            columns.append((np.full(t.shape, i), t / scale, (width * unit_weights).ravel()))
        rows, places, weights = (np.concatenate(column) for column in zip(*columns, strict=True))
        return rows, places, weights

    def _cell_edges(self, i):
        """Edges [s] of cells of interval i in each of which the oscillation turns by `CELL_ANGLE` at most."""
        oscillates, resolved, count = (column[i] for column in self._cells)
        duration, decay, discriminant = (
            getattr(self.intervals, name)[i] for name in ("duration", "decay", "discriminant")
        )
        if not oscillates:
            return np.linspace(0, duration, 3)
        if discriminant >= 0:  # two real roots; bisection towards the start, where the faster one decays
            halvings = math.ceil(math.log2(max(2.0, duration * (abs(decay) + math.sqrt(discriminant)))))
            return np.append(0.0, duration * 2.0 ** np.arange(-halvings, 1))
        edges = np.linspace(0, resolved, count + 1)
        return edges if resolved == duration else np.append(edges, np.linspace(resolved, duration, 3)[1:])

    def locate(self, time: Array) -> tuple[IntArray, Array]:
        """Interval indices i and places u of times [s] within the trajectory."""
        starts = self.intervals.start
        i = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
        return i, (time - starts[i]) / self.intervals.scale[i]

    def at(self, i: IntArray, u: Array) -> Kinematics:
        """Motion and forces at places of the trajectory, arrays of shape (n,)."""
        return Kinematics(*_sample(self.cart, self.rows, i, u))

    def energy(self, state: CartState, driven_end: float = 0.0) -> float:
        """Energy of cart and springs [J] in a state, with the driven end at a position [m]."""
        cart, position = self.cart, driven_end - state.elongation
        stretch = state.elongation - state.flank * cart.backlash / 2 if state.flank else 0.0
        compression = max(cart.end_length - min(position, cart.stroke - position), 0.0) if cart.end_length else 0.0
        stored = cart.end_preload * compression + cart.end_stiffness / 2 * compression**2
        return cart.mass / 2 * state.velocity**2 + cart.stiffness / 2 * stretch**2 + stored

    def peak_force_and_power(self) -> tuple[float, float]:
        """Largest |H| of drive spring and damper [N] and largest |H y'| [W]."""
        peaks, row = np.zeros(2), 0
        while row < len(self.rows):  # Python handles interrupts between two calls
            try:
                row = _search_peaks(self.cart, self.rows, peaks, row)
            except RuntimeError as error:
                raise RuntimeError(f"the search for the peak force did not end: {error}") from None
        return float(peaks[0]), float(peaks[1])


@compiled
def _search_peaks(cart, rows, peaks, row):
    """Update the largest |H| and |H y'| from an interval on; returns the first one that is left."""
    work, first, degree = 0, ROW_HEAD + POLYNOMIAL, rows.shape[1] - ROW_HEAD - POLYNOMIAL - SERIES_TERMS
    for i in range(row, len(rows)):
        terms = SERIES_TERMS
        while terms > degree and rows[i, first + terms - 1] == 0:
            terms -= 1
        elongation, y, until = rows[i, ROW_HEAD : first + terms], rows[i, first + SERIES_TERMS :], rows[i, 1]
        stiffness, _, constant = spring_force(cart, rows[i, 3], 0.0)
        force = transform(elongation, stiffness, cart.damping, constant)
        one = transform(elongation, 0.0, 0.0, 1.0)
        pace = combine(elongation, y, 0.0, 0.0, 0.0, 1.0, 0.0)
        for which, factor in ((0, one), (1, pace)):
            largest, ranges = max_abs_product(force, factor, until / elongation[SCALE])
            peaks[which] = max(peaks[which], largest)
            work += ranges
        if work > RANGES_PER_CALL:
            return i + 1
    return len(rows)


def oscillation_time(decay: Array | float, duration: Array) -> Array:
    """Time [s] within a duration [s] during which an oscillation of a decay [1/s] exceeds `OSCILLATION_FLOOR`."""
    decays = np.maximum(decay, 1e-300)  # none without damping
    return np.minimum(duration, -math.log(OSCILLATION_FLOOR) / decays)
