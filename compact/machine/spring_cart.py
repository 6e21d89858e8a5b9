"""Motion of a cart behind a spring, by collocation between events.

    m x'' = k (e - o) + c e' + S(x) - R(x', x'', s),   e = y(t) - x
    R = f + g(s) (F(v) - f + a' M(v)),   a' = a for |a| <= L |v|,   a' = L |v| sign(a) beyond
    S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between

y(t) is the imposed motion of the driven end, e the elongation, o the engaged half of the backlash, s the travel since
the last turn, f the guide friction without the mix, S the force of the end springs with the preload P.

On a step e and e' are polynomials of time that satisfy the equation of motion at Chebyshev points (Newton's method). A
step is as long as its last Chebyshev coefficients are below the tolerance, about a period of an oscillation; one that
has decayed does not limit it. A step ends at the first event: speed zero, breakaway from rest, opening or closing of
the backlash, the plate of an end spring, a place at which R is not smooth, and a drive force of zero, so that |H| is
smooth too. All forces are continued smoothly beyond an event, where the polynomials are cut.

R jumps at speed zero and holds a cart at rest while the other forces lie between both limits. The preload of an end
spring makes S jump at its plate, which holds a cart at rest likewise.
"""

import math
from typing import NamedTuple

import numpy as np

from compact.machine.shaft import DIFFERENTIATION, INTEGRATION, NODES, ORDER, TO_CHEBYSHEV
from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, internal
from compact.numerics.piecewise import PiecewisePolynomial

CONTINUATION = 0.5  # [-], of a table piece; its polynomial is continued so far beyond a knot, then by its tangent
BAND = 1e-10  # [-], of a speed or a travel; an event lies so far beyond its place, so that rounding repeats none
FORCE_BAND = 1e-6  # [-], of the force scale; likewise for the drive force, whose magnitude is smooth to its square
REST_BAND, PLATE_BAND = 1e-13, 1e-15  # [-], of the fastest speed, and of the stroke; likewise for rest and plates
HOLD = 1e-11  # [-], of the force scale; a cart at rest breaks away so far beyond the limit
PLATE_REST_SPEED = 1e-6  # [-], of the fastest speed; a slower cart does not rebound from the plate of an end spring
NEWTON_STEPS = 12  # [-], of the collocation; 1 for dry friction, 2 to 4 are usual
NEWTON_TOLERANCE = 1e-2  # [-], of the tolerance; residual of the equation of motion
MIN_RATIO, SAFETY = 0.1, 0.9  # [-], of the step control
RESOLVED = 1e-3  # [-], of the tolerance; a smaller defect may be rounding and does not lengthen a step further
OVERSHOOT = 1.01  # [-], of the time to an event; a shorter step contains it
STEPS_PER_OCTAVE = 8  # [-], of the grid of steps, so that rounding does not change them
MIN_STEP = 1e-13  # [-], of a piece of the driven-end motion; shorter steps are rounding
MAX_ATTEMPTS = 300  # [-], of one step
STEP_TOO_SHORT = f"steps below {MIN_STEP:g} of a piece of the law; use a smooth `resistance`"
ROOT_ITERATIONS = 60  # [-], of the bracketing of a root; to rounding

NEAR_SPRING, FAR_SPRING = 1.0, -1.0  # zones; the cart compresses an end spring, 0 between the springs
AT_NEAR_PLATE, AT_FAR_PLATE = 2.0, -2.0  # zones; the cart is at rest at the plate of an end spring
FREE_SATURATION = 2.0  # marker; the motion itself determines the saturation, distinct from -1, 0 and 1
FORCE, ADDED_MASS, FACTOR = range(3)  # tables of a `SpringCart`
NO_EVENT, PASSED, STOPPED, NEW_ZONE, NEW_FLANK = 0.0, 1.0, 2.0, 10.0, 20.0  # events; the new zone or flank is added
# indices of the progress of an integration; the first six are a `CartState`
ELONGATION, VELOCITY, FLANK, ZONE, TURN, HEADING, PIECE, FRACTION, STEP, ATTEMPTS, EVALUATIONS = range(11)
DONE, PAUSED, SPEED_BEYOND_TABLE = range(3)  # status of `advance`
ROW_HEAD, CHANNELS = 6, 6  # start, duration, slip, flank, zone and turn of a step; nodal y, y', y'', e, e', e''
START_SLOPE, TAIL = np.ascontiguousarray(DIFFERENTIATION[0]), np.ascontiguousarray(TO_CHEBYSHEV[ORDER - 1 :])
INTEGRATION_TWICE = INTEGRATION @ INTEGRATION


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
    force_scale, tolerance : float
        Largest force of inertia and resistance, and largest defect of a step [N].
    knots, travels : ndarray, shape (n,)
        Speeds |v| > 0 [m/s] at which F, and travels [m] at which g is not smooth; no travels for g = 1.
    pieces : ndarray, shape (n, 2 + terms)
        Ends and coefficients of the pieces of all tables: F [N] and M [kg] over v [m/s], and g [-] over s [m].
    firsts : ndarray, shape (4,)
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
    force_scale: float = 1.0
    tolerance: float = 1e-9
    knots: Array = np.empty(0)
    travels: Array = np.empty(0)
    pieces: Array = np.empty((0, 2))
    firsts: IntArray = np.zeros(4, np.int64)

    def with_tables(self, *tables: PiecewisePolynomial) -> "SpringCart":
        """Cart with other tables, in the order of `FORCE`, `ADDED_MASS`, `FACTOR`."""
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
    """Part of the resistance that is smooth: direction, limits of v [m/s] and s [m], sign of the saturation."""

    slip: float
    low: float
    high: float
    saturation: float
    travelled: float
    farthest: float


# forces


@internal
def _table(cart, which, abscissa, low, high):
    """Value and slope of a table, continued smoothly beyond a range from low to high."""
    rows, i, end = cart.pieces, cart.firsts[which], cart.firsts[which + 1]
    while end - i > 1:
        middle = (i + end) // 2
        if rows[middle, 0] <= max(abscissa, low) and rows[middle, 0] < high:
            i = middle
        else:
            end = middle
    width = rows[i, 1] - rows[i, 0]
    u, value, slope = (abscissa - rows[i, 0]) / width, 0.0, 0.0
    inside = min(max(u, -CONTINUATION), 1 + CONTINUATION)
    for j in range(rows.shape[1] - 1, 1, -1):
        slope = slope * inside + value
        value = value * inside + rows[i, j]
    return value + slope * (u - inside), slope / width


@internal
def _resistance(cart, within, velocity, acceleration, travel):
    """R [N], dR/dv [N s/m], dR/da [kg] and dR/dx [N/m], continued beyond a smooth range."""
    slip, limit = within.slip, cart.rate_limit
    force, damping = _table(cart, FORCE, velocity, within.low, within.high)
    mass, stiffness, saturation = 0.0, 0.0, within.saturation
    if limit > 0:
        mass, slope = _table(cart, ADDED_MASS, velocity, within.low, within.high)
        if saturation == FREE_SATURATION:
            saturation = np.sign(acceleration) if abs(acceleration) > limit * slip * velocity else 0.0
        if saturation == 0:
            force, damping = force + mass * acceleration, damping + slope * acceleration
        else:
            force += saturation * limit * mass * slip * velocity
            damping, mass = damping + saturation * limit * slip * (mass + slope * velocity), 0.0
    if len(cart.travels) > 0:
        factor, steepness = _table(cart, FACTOR, travel, within.travelled, within.farthest)
        guide = cart.forward_guide if slip > 0 else cart.backward_guide
        stiffness = slip * steepness * (force - guide)
        force, damping, mass = guide + factor * (force - guide), factor * damping, factor * mass
    return force, damping, mass, stiffness


@internal
def _smooth_range(cart, slip, velocity, travel, pull):
    """Smooth range of a cart that slides under a pull [N]."""
    speed, low, high, travelled, farthest = max(slip * velocity, 0.0), 0.0, np.inf, 0.0, np.inf
    for knot in cart.knots:
        low, high = (knot, high) if knot <= speed else (low, min(high, knot))
    for place in cart.travels:
        travelled, farthest = (place, farthest) if place <= travel else (travelled, min(farthest, place))
    if slip < 0:
        low, high = -high, -low
    within = SmoothRange(slip, low, high, 0.0, travelled, farthest)
    if not 0 < cart.rate_limit < np.inf:
        return within
    force, _, mass, _ = _resistance(cart, within, velocity, 0.0, travel)
    a = (pull - force) / (cart.mass + mass)
    if abs(a) < cart.rate_limit * speed:
        return within
    return SmoothRange(slip, low, high, slip if a == 0 else np.sign(a), travelled, farthest)


@internal
def _spring_force(cart, flank, zone):
    """k, p and constant of the force k e - p y + constant of drive and end springs [N]."""
    stiffness = cart.stiffness if flank != 0 else 0.0
    constant = -stiffness * flank * cart.backlash / 2
    if abs(zone) != NEAR_SPRING:
        return stiffness, 0.0, constant
    force = cart.end_preload + cart.end_stiffness * cart.end_length
    if zone == FAR_SPRING:
        force = cart.end_stiffness * cart.stroke - force
    return stiffness + cart.end_stiffness, cart.end_stiffness, constant + force


@internal
def _stiction_limits(cart, state, position, zone):
    """Smallest and largest pull [N] that holds a cart at rest."""
    travel, heading, limits = state[HEADING] * (position - state[TURN]), state[HEADING], np.empty(2)
    for i in range(2):
        slip = 2.0 * i - 1
        travelled = travel if heading == slip else 0.0
        limits[i] = _resistance(cart, _smooth_range(cart, slip, 0.0, travelled, 0.0), 0.0, 0.0, travelled)[0]
    if zone == AT_NEAR_PLATE:
        limits[0] -= cart.end_preload
    if zone == AT_FAR_PLATE:
        limits[1] += cart.end_preload
    return limits[0], limits[1]


# one step


@internal
def _driven_end(polynomial, scale, h, step):
    """Fill in y, y' and y'' at the nodes of a step of h [s] of a polynomial in time over a scale [s]."""
    for i in range(ORDER + 1):
        u, value, slope, bend = NODES[i] * h / scale, 0.0, 0.0, 0.0
        for j in range(len(polynomial) - 1, -1, -1):
            bend = bend * u + 2 * slope
            slope = slope * u + value
            value = value * u + polynomial[j]
        step[0, i], step[1, i], step[2, i] = value, slope / scale, bend / scale**2


@internal
def _eliminate(matrix, right):
    """Solve a small system in place by Gauss elimination with partial pivoting; faster than a library at this size."""
    n = len(right)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if pivot != k:
            right[k], right[pivot] = right[pivot], right[k]
            for j in range(k, n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            right[i] -= factor * right[k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]


@internal
def _collocate(cart, state, within, springs, h, step):
    """Fill in e, e' and e'' at the nodes of a step of h [s] of a sliding cart; returns true for a converged solution.

    The unknowns are e'' at all nodes but the first.
    """
    n, (stiffness, driven, constant) = ORDER, springs
    y, pace, change, turn = step[0], step[1], step[2], state[TURN]
    elongation, rate = state[ELONGATION], pace[0] - state[VELOCITY]
    bend, matrix, gap = np.zeros(n), np.empty((n, n)), np.empty(n)
    for _ in range(NEWTON_STEPS):
        r = rate + h * (INTEGRATION @ bend)
        e = elongation + h * (INTEGRATION @ r)
        worst = 0.0
        for i in range(n):
            a = change[i + 1] - bend[i]
            travel = within.slip * (y[i + 1] - e[i] - turn)
            force, damping, mass, steep = _resistance(cart, within, pace[i + 1] - r[i], a, travel)
            gap[i] = cart.mass * a + force - stiffness * e[i] - cart.damping * r[i] + driven * y[i + 1] - constant
            worst = max(worst, abs(gap[i])) if math.isfinite(gap[i]) else np.inf
            for j in range(n):
                matrix[i, j] = (cart.damping + damping) * h * INTEGRATION[i, j]
                matrix[i, j] += (stiffness + steep) * h**2 * INTEGRATION_TWICE[i, j]
            matrix[i, i] += cart.mass + mass
        if worst <= NEWTON_TOLERANCE * cart.tolerance or worst == np.inf:
            break
        _eliminate(matrix, gap)
        bend += gap
    step[3, 0], step[3, 1:] = elongation, e
    step[4, 0], step[4, 1:] = rate, r
    force, _, mass, _ = _resistance(cart, within, state[VELOCITY], 0.0, within.slip * (y[0] - elongation - turn))
    pull = stiffness * elongation + cart.damping * rate - driven * y[0] + constant
    step[5, 0], step[5, 1:] = change[0] - (pull - force) / (cart.mass + mass), bend
    return worst <= NEWTON_TOLERANCE * cart.tolerance


@internal
def _tail(values):
    """Larger of the last two Chebyshev coefficients of nodal values."""
    return np.abs(TAIL @ values).max()


@internal
def _value(coefficients, u):
    """Sum of Chebyshev polynomials at u in [0, 1], by Clenshaw's recurrence."""
    x, one, two = 2 * (2 * u - 1), 0.0, 0.0
    for k in range(ORDER, 0, -1):
        one, two = coefficients[k] + x * one - two, one
    return coefficients[0] + x / 2 * one - two


@internal
def _sign_change(coefficients, low, high):
    """Root of a polynomial between low and high, where its signs differ, by the Illinois method."""
    at_low, at_high = _value(coefficients, low), _value(coefficients, high)
    for _ in range(ROOT_ITERATIONS):
        place = high - at_high * (high - low) / (at_high - at_low)
        if not low < place < high:
            place = (low + high) / 2
        here = _value(coefficients, place)
        if here == 0 or high - low <= 2e-16 * high:
            return place
        if (here > 0) == (at_high > 0):
            high, at_high, at_low = place, here, at_low / 2
        else:
            low, at_low, at_high = place, here, at_high / 2
    return (low + high) / 2


@internal
def _earlier(first, values, candidate):
    """Earlier of an event (u, event) and of a candidate, the fall of nodal values below zero."""
    lowest, span = values.min(), values.max() - values.min()
    if lowest > span:  # no interpolated value is negative
        return first
    slopes = DIFFERENTIATION @ values
    for i in range(ORDER):
        low, high = NODES[i], NODES[i + 1]
        if low >= first[0]:
            break
        if values[i + 1] >= 0:  # a minimum between both nodes may be negative
            if not slopes[i] < 0 < slopes[i + 1]:
                continue
            if values[i] + values[i + 1] + (slopes[i] - slopes[i + 1]) * (high - low) / 2 > 0:  # of both tangents
                continue
            high = _sign_change(TO_CHEBYSHEV @ slopes, low, high)
        coefficients = TO_CHEBYSHEV @ values
        if _value(coefficients, high) < 0:
            place = _sign_change(coefficients, low, high) if values[i] > 0 else low
            return (place, candidate) if place < first[0] else first
    return first


@internal
def _first_event(cart, state, within, springs, limits, step):
    """First event of a step (u, event); (1, NO_EVENT) without one."""
    slip, flank, zone = within.slip, state[FLANK], state[ZONE]
    y, e, velocity = step[0], step[3], step[1] - step[4]
    fastest = cart.pieces[cart.firsts[FORCE + 1] - 1, 1]
    stiffness, _, constant = _spring_force(cart, flank, 0.0)
    force, band = stiffness * e + constant + cart.damping * step[4], BAND * cart.force_scale
    margin = FORCE_BAND * cart.force_scale
    side = force[0] if abs(force[0]) > margin else np.dot(START_SLOPE, force)
    first = _earlier((1.0, NO_EVENT), (force if side >= 0 else -force) + margin, PASSED)
    if slip == 0:
        pull = springs[0] * e - springs[1] * y + springs[2] + cart.damping * step[4]
        first = _earlier(first, limits[1] + HOLD * cart.force_scale - pull, PASSED)
        first = _earlier(first, pull - limits[0] + HOLD * cart.force_scale, PASSED)
    else:
        low, high = (within.low, within.high) if slip > 0 else (-within.high, -within.low)
        speed = slip * velocity
        first = _earlier(first, speed - low * (1 - BAND) + REST_BAND * fastest, STOPPED if low == 0 else PASSED)
        if high < np.inf:
            first = _earlier(first, high * (1 + BAND) + REST_BAND * fastest - speed, PASSED)
        if within.farthest < np.inf:
            first = _earlier(first, within.farthest * (1 + BAND) - slip * (y - e - state[TURN]), PASSED)
        if 0 < cart.rate_limit < np.inf:
            a, limit = step[2] - step[5], cart.rate_limit * speed
            for sign in (1.0, -1.0):
                if within.saturation == 0:
                    first = _earlier(first, limit - sign * a + band / cart.mass, PASSED)
                elif within.saturation == sign:
                    first = _earlier(first, sign * a - limit + band / cart.mass, PASSED)
        for side in (1.0, -1.0):
            if cart.end_length > 0 and zone != -side:
                into = side * (y - e) - (cart.end_length if side > 0 else cart.end_length - cart.stroke)
                if zone == side:
                    first = _earlier(first, PLATE_BAND * cart.stroke - into, NEW_ZONE)
                else:
                    first = _earlier(first, PLATE_BAND * cart.stroke + into, NEW_ZONE + side)
    if cart.backlash > 0:
        band /= cart.stiffness
        for side in (1.0, -1.0):
            beyond = side * e - cart.backlash / 2
            if flank == side:
                first = _earlier(first, beyond + band, NEW_FLANK)
            elif flank == 0:
                first = _earlier(first, band - beyond, NEW_FLANK + side)
    return first


@internal
def _cut(step, u, polynomial, scale, h):
    """Cut a step of h [s] at u."""
    _driven_end(polynomial, scale, h * u, step)
    for k in range(3, CHANNELS):
        coefficients = TO_CHEBYSHEV @ step[k]
        for i in range(ORDER + 1):
            step[k, i] = _value(coefficients, u * NODES[i])


@internal
def _rounded(step):
    """Longest step [s] of a geometric grid up to a step [s]."""
    return 2.0 ** (math.floor(STEPS_PER_OCTAVE * math.log2(step)) / STEPS_PER_OCTAVE)


@internal
def _leave(cart, state, slip, event, step):
    """State at the end of a step, with its event."""
    state[ELONGATION], state[VELOCITY] = step[3, ORDER], step[1, ORDER] - step[4, ORDER]
    if slip == 0 or event == STOPPED:
        state[VELOCITY] = 0.0
    if event >= NEW_FLANK - 1:
        state[FLANK] = event - NEW_FLANK
    elif event >= NEW_ZONE - 1:
        plate = 2 * (state[ZONE] + event - NEW_ZONE)  # the cart leaves one zone or enters another
        state[ZONE] = event - NEW_ZONE
        if abs(state[VELOCITY]) <= PLATE_REST_SPEED * cart.pieces[cart.firsts[FORCE + 1] - 1, 1]:
            stiffness, _, constant = _spring_force(cart, state[FLANK], plate)
            pull = stiffness * state[ELONGATION] + constant + cart.damping * step[1, ORDER]
            low, high = _stiction_limits(cart, state, step[0, ORDER] - state[ELONGATION], plate)
            if low <= pull <= high:
                state[VELOCITY], state[ZONE] = 0.0, plate


@internal
def _shifted(polynomial, start):
    """Coefficients of p(start + u), in ascending order as those of p."""
    out, n = polynomial.copy(), len(polynomial)
    for i in range(n):
        for j in range(n - 2, i - 1, -1):
            out[j] += start * out[j + 1]
    return out


@internal
def _direction(cart, state, limits, pull):
    """Direction in which a cart moves or starts under a pull [N]; 0 where friction or a plate holds it."""
    margin = HOLD / 2 * cart.force_scale
    if state[VELOCITY] != 0:
        return np.sign(state[VELOCITY])
    if limits[1] - limits[0] <= margin:
        return 1.0 if pull >= 0 else -1.0
    return 1.0 if pull > limits[1] + margin else -1.0 if pull < limits[0] - margin else 0.0


@internal
def _attempt(cart, state, within, springs, polynomial, scale, h, step):
    """Fill in a step of h [s]; returns the ratio of the admissible step to it, 0 for failure."""
    _driven_end(polynomial, scale, h, step)
    if within.slip == 0:  # the driven end alone moves
        moved = polynomial.copy()
        moved[0] = state[ELONGATION]
        _driven_end(moved, scale, h, step[3:])
        return 1.0
    state[EVALUATIONS] += ORDER
    if not _collocate(cart, state, within, springs, h, step):
        return 0.0
    impedance = max(cart.damping, math.sqrt(cart.stiffness * cart.mass))
    defect = max((cart.stiffness + springs[1]) * _tail(step[3]), impedance * _tail(step[4]))
    defect = max(defect, cart.mass * _tail(step[5])) / cart.tolerance
    ratio = SAFETY * max(defect, RESOLVED) ** (-1 / (ORDER - 2))
    return ratio if defect > 1 else max(ratio, 1.0)


@compiled
def advance(cart: SpringCart, law: PiecewisePolynomial, state: Array, rows: Array, attempts: int) -> tuple[int, int]:
    """Continue an integration by at most `attempts` attempts; returns the status and the number of filled rows."""
    filled, step, fastest = 0, np.empty((CHANNELS, ORDER + 1)), cart.pieces[cart.firsts[FORCE + 1] - 1, 1]
    for _ in range(attempts):
        i = int(state[PIECE])
        if i == len(law.coefficients):
            return DONE, filled
        width = law.breaks[i + 1] - law.breaks[i]
        remaining = (1 - state[FRACTION]) * width
        state[ATTEMPTS] += 1
        if state[STEP] < MIN_STEP * width or state[ATTEMPTS] > MAX_ATTEMPTS:
            raise RuntimeError(STEP_TOO_SHORT)

        # forces and direction of the motion
        polynomial = _shifted(law.coefficients[i], state[FRACTION])
        y, rate = polynomial[0], polynomial[1] / width - state[VELOCITY]
        position, zone = y - state[ELONGATION], state[ZONE]
        springs = _spring_force(cart, state[FLANK], zone)
        pull = springs[0] * state[ELONGATION] - springs[1] * y + springs[2] + cart.damping * rate
        limits = _stiction_limits(cart, state, position, zone)
        slip = _direction(cart, state, limits, pull)
        if slip == -state[HEADING]:
            state[HEADING], state[TURN] = slip, position
        if abs(zone) == AT_NEAR_PLATE and slip != 0:  # the cart leaves its plate
            state[ZONE] = zone / 2 if slip == -zone / 2 else 0.0
            springs = _spring_force(cart, state[FLANK], state[ZONE])
            pull = springs[0] * state[ELONGATION] - springs[1] * y + springs[2] + cart.damping * rate
        within = _smooth_range(cart, slip, state[VELOCITY], slip * (position - state[TURN]), pull)

        # one attempt
        h = remaining if slip == 0 and state[ATTEMPTS] == 1 else min(state[STEP], remaining)
        ratio = _attempt(cart, state, within, springs, polynomial, width, h, step)
        end, event = (1.0, NO_EVENT) if ratio == 0 else _first_event(cart, state, within, springs, limits, step)
        if ratio < 1:  # where an event ends a step that is too long, it may be the reason
            state[STEP] = _rounded(h * max(ratio, MIN_RATIO, OVERSHOOT * end if end < SAFETY else 0.0))
            continue
        if slip == 0:
            if end < 0.25 and h > 8 * MIN_STEP * width:  # a shorter step locates the breakaway behind a stiff spring
                state[STEP] = _rounded(max(2 * end * h, 4 * MIN_STEP * width))
                continue
        else:
            state[STEP] = max(_rounded(h * ratio), state[STEP] if h == remaining else 0.0)
        if end < 1:
            _cut(step, end, polynomial, width, h)
        if np.abs(step[1] - step[4]).max() > fastest:
            return SPEED_BEYOND_TABLE, filled

        # accept it
        if end * h > MIN_STEP * width:
            row = rows[filled]
            row[0], row[1], row[2] = law.breaks[i] + state[FRACTION] * width, end * h, slip
            row[3], row[4], row[5] = state[FLANK], state[ZONE], state[TURN]
            row[ROW_HEAD:] = step.ravel()
            filled += 1
            state[ATTEMPTS] = 0
        _leave(cart, state, slip, event, step)
        state[FRACTION] += end * h / width
        if (event == NO_EVENT and h == remaining) or state[FRACTION] > 1 - MIN_STEP:
            state[PIECE], state[FRACTION] = i + 1, 0.0
    return PAUSED, filled
