"""Motion of a cart behind a spring, by collocation between events.

    m x'' = k (e - o) + c e' + S(x) - R(x', x'', s),   e = y(t) - x
    S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between

y(t) is the imposed motion of the driven end, e the elongation, o the engaged half of the backlash, s the travel since
the last turn, R the force of mix and guides (`spring_forces`), S that of the end springs with the preload P.

On a step e and e' are polynomials of time that satisfy the equation of motion at Chebyshev points (Newton's method). A
step is as long as its last Chebyshev coefficients are below the tolerance, about a period of an oscillation; one that
has decayed does not limit it. A step ends at the first event: speed zero, breakaway from rest, opening or closing of
the backlash, the plate of an end spring, a place at which R is not smooth, and a drive force of zero, so that |H| is
smooth too. All forces are continued smoothly beyond an event, where the polynomials are cut.

R jumps at speed zero and holds a cart at rest while the other forces lie between both limits. With a release of the
old force the part of the mix does not jump. The preload of an end spring makes S jump at its plate, which holds a cart
at rest likewise.

Compiled functions have plain loops over scalars and few calls: products of matrices, expressions of arrays, `max` and
`min` of numpy and every further call compile slower than they run.
"""

import math

import numpy as np

from compact.machine.shaft import DIFFERENTIATION, INTEGRATION, NODES, ORDER, TO_CHEBYSHEV
from compact.machine.spring_forces import (
    AT_NEAR_PLATE,
    ELONGATION,
    FLANK,
    FORCE,
    HEADING,
    NEAR_SPRING,
    TURN,
    VELOCITY,
    ZONE,
    SpringCart,
    pull_on_cart,
    resistance,
    shares_of,
    smooth_range,
    stiction_limits,
    turn,
    wheel_friction,
)
from compact.numerics import Array
from compact.numerics.jit import compiled, inlined, internal
from compact.numerics.piecewise import PiecewisePolynomial

BAND = 1e-10  # [-], of a speed or a travel; an event lies so far beyond its place, so that rounding repeats none
KNOT_BAND = 30.0  # [-], of tolerance over force scale; likewise for a knot of the resistance, at which a cart may creep
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
ROOT_ITERATIONS = 60  # [-], of the bracketing of a root; to rounding

NO_EVENT, PASSED, STOPPED, NEW_ZONE, NEW_FLANK = 0.0, 1.0, 2.0, 10.0, 20.0  # events; the new zone or flank is added
EVENTS = 10  # [-], rows of the margins to the events of a step
PIECE, FRACTION, STEP, ATTEMPTS, EVALUATIONS = range(12, 17)  # of the progress of an integration, after a `CartState`
DONE, PAUSED, SPEED_BEYOND_TABLE, STEP_TOO_SHORT = range(4)  # status of `advance`
ROW_HEAD, CHANNELS = 6, 8  # start, duration, slip, flank, zone, heading of a step; nodal y, y', y'', e, e', e'', shares
FROM_START = np.pad(INTEGRATION, ((1, 0), (1, 0)))  # nodal values to integrals from the start
TWICE_FROM_START = FROM_START @ FROM_START
SLOPES, CHEBYSHEV = map(np.ascontiguousarray, (DIFFERENTIATION, TO_CHEBYSHEV))  # one layout, one compilation


# one step


@internal
def _follow(polynomial, constant, scale, h, step, channel):
    """Fill in value and two derivatives at the nodes of a step of h [s] of a polynomial in time over a scale [s]."""
    for i in range(ORDER + 1):
        u, value, slope, bend = NODES[i] * h / scale, 0.0, 0.0, 0.0
        for j in range(len(polynomial) - 1, -1, -1):
            bend = bend * u + 2 * slope
            slope = slope * u + value
            value = value * u + (polynomial[j] if j > 0 else constant)
        step[channel, i], step[channel + 1, i], step[channel + 2, i] = value, slope / scale, bend / scale**2


@inlined
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
def _collocate(cart, state, within, h, step, mix):
    """Fill in e, e', e'' and both shares at the nodes of a step of h [s] of a sliding cart, and the force of the mix.

    The unknowns are e'' at all nodes; the first iteration takes the resistance as linear about the start. Returns true
    for a converged solution. Iterations whose residual grows have failed: where they end depends on rounding.
    """
    n, flank, zone, limit = ORDER + 1, state[FLANK], state[ZONE], NEWTON_TOLERANCE * cart.tolerance
    matrix, gap, slopes, worst = np.empty((n, n)), np.empty(n), np.empty((2, n)), np.inf
    step[3, 0], step[4, 0] = state[ELONGATION], step[1, 0] - state[VELOCITY]
    for i in range(n):
        step[5, i] = 0.0
    for attempt in range(NEWTON_STEPS):
        for k in range(4, 2, -1):
            for i in range(1, n):
                step[k, i] = step[k, 0] + h * _product(FROM_START, i, step[k + 1])
        before, worst, start = worst if attempt > 1 else np.inf, 0.0, step[0, 0] - step[3, 0]
        for i in range(n):
            y, e, rate = step[0, i], step[3, i], step[4, i]
            position, velocity = y - e, step[1, i] - rate
            if attempt > 0 or i == 0:
                travel = within.slip * (position - state[TURN])
                found = resistance(cart, within, velocity, travel)
                force, damping, steep, mix[i], step[6, i], step[7, i] = found
            else:
                force = found[0] + damping * (velocity - state[VELOCITY]) + steep * (position - start)
            pull, stiffness = pull_on_cart(cart, flank, zone, y, e, rate)
            gap[i], slopes[0, i], slopes[1, i] = cart.mass * (step[2, i] - step[5, i]) + force - pull, damping, steep
            if not abs(gap[i]) <= worst:
                worst = abs(gap[i]) if math.isfinite(gap[i]) else np.inf
        if (worst <= limit and attempt > 0) or worst >= before or worst == np.inf:
            break
        for i in range(n):
            damping, steep = h * (cart.damping + slopes[0, i]), h**2 * (stiffness + slopes[1, i])
            for j in range(n):
                matrix[i, j] = damping * FROM_START[i, j] + steep * TWICE_FROM_START[i, j]
            matrix[i, i] += cart.mass
        _eliminate(matrix, gap)
        for i in range(n):
            step[5, i] += gap[i]
    return worst <= limit


@internal
def _product(matrix, row, values):
    """Product of a row of a matrix and values."""
    total = 0.0
    for j in range(len(values)):
        total += matrix[row, j] * values[j]
    return total


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
def _rounded(step):
    """Longest step [s] of a geometric grid up to a step [s]."""
    return 2.0 ** (math.floor(STEPS_PER_OCTAVE * math.log2(step)) / STEPS_PER_OCTAVE)


@internal
def _transform(matrix, values, out):
    """Fill in the product of a matrix and nodal values."""
    for i in range(len(values)):
        out[i] = _product(matrix, i, values)


@internal
def _fall(values, end, slopes, coefficients):
    """Place in [0, end] where nodal values fall below zero; end without one. Two arrays are for work."""
    lowest = highest = values[0]
    for value in values:
        lowest, highest = value if value < lowest else lowest, value if value > highest else highest
    if lowest > highest - lowest:  # no interpolated value is negative
        return end
    _transform(SLOPES, values, slopes)
    for i in range(ORDER):
        low, high = NODES[i], NODES[i + 1]
        if low >= end:
            break
        if values[i + 1] >= 0:  # a minimum between both nodes may be negative
            if not slopes[i] < 0 < slopes[i + 1]:
                continue
            if values[i] + values[i + 1] + (slopes[i] - slopes[i + 1]) * (high - low) / 2 > 0:  # of both tangents
                continue
            _transform(CHEBYSHEV, slopes, coefficients)
            high = _sign_change(coefficients, low, high)
        _transform(CHEBYSHEV, values, coefficients)
        if _value(coefficients, high) < 0:
            place = _sign_change(coefficients, low, high) if values[i] > 0 else low
            return place if place < end else end
    return end


@internal
def _find_wheel_margins(cart, within, loads, mix, margins):
    """Fill in the margins to the change of sign of both wheel reactions, by the shares of the load."""
    band = BAND * cart.force_scale
    for i in range(ORDER + 1):
        front, rear = wheel_friction(cart, within, mix[i], loads[i])
        margins[8, i], margins[9, i] = band + within.signs[0] * front, band + within.signs[1] * rear
    for k in range(2):
        start = margins[8 + k, 0]
        for i in range(ORDER + 1 if start < band else 0):  # a sign that rounding mistook costs no event
            margins[8 + k, i] += band - start


@internal
def _find_margins(cart, state, within, limits, step, mix, margins, events):
    """Fill in the margins to all events of a step at its nodes; an event is the fall of its margin below zero."""
    slip, flank, zone, scale = within.slip, state[FLANK], state[ZONE], cart.force_scale
    fastest = cart.pieces[cart.firsts[FORCE + 1] - 1, 1]
    low, high = (within.low, within.high) if slip > 0 else (-within.high, -within.low)
    band = KNOT_BAND * cart.tolerance / scale
    band = band if band > BAND else BAND
    for k in range(EVENTS):
        events[k] = PASSED
        for i in range(ORDER + 1):
            margins[k, i] = 1.0  # never falls
    for i in range(ORDER + 1):
        y, e, rate = step[0, i], step[3, i], step[4, i]
        speed = slip * (step[1, i] - rate)
        margins[0, i] = pull_on_cart(cart, flank, 0.0, y, e, rate)[0]
        if slip == 0:
            pull = pull_on_cart(cart, flank, zone, y, e, rate)[0]
            margins[1, i], margins[2, i] = limits[1] + HOLD * scale - pull, pull - limits[0] + HOLD * scale
        else:
            margins[1, i] = speed - low * (1 - band) + REST_BAND * fastest
            if high < np.inf:
                margins[2, i] = high * (1 + band) + REST_BAND * fastest - speed
            if within.event < np.inf:
                margins[3, i] = within.event + BAND * cart.stroke - slip * (y - e - state[TURN])
        for k in range(2):
            side = 1.0 - 2 * k
            if slip != 0 and cart.end_length > 0 and zone != -side:
                into = side * (y - e) - (cart.end_length if side > 0 else cart.end_length - cart.stroke)
                margins[4 + k, i] = PLATE_BAND * cart.stroke + (-into if zone == side else into)
                events[4 + k] = NEW_ZONE if zone == side else NEW_ZONE + side
            if cart.backlash > 0 and flank != -side:
                beyond = side * e - cart.backlash / 2
                margins[6 + k, i] = BAND * scale / cart.stiffness + (beyond if flank == side else -beyond)
                events[6 + k] = NEW_FLANK if flank == side else NEW_FLANK + side
    if slip != 0 and low == 0:
        events[1] = STOPPED
    if slip != 0 and len(cart.turns) > 0:
        _find_wheel_margins(cart, within, step[7], mix, margins)
    start, slope, band = margins[0, 0], 0.0, FORCE_BAND * scale
    for i in range(ORDER + 1):
        slope += SLOPES[0, i] * margins[0, i]
    start = start if abs(start) > band else slope
    for i in range(ORDER + 1):
        margins[0, i] = (margins[0, i] if start >= 0 else -margins[0, i]) + band


@internal
def _leave(cart, state, slip, event, step):
    """Set the state at the end of a step, with its event."""
    state[ELONGATION], state[VELOCITY] = step[3, ORDER], step[1, ORDER] - step[4, ORDER]
    if slip == 0 or event == STOPPED:
        state[VELOCITY] = 0.0
    if event >= NEW_FLANK - 1:
        state[FLANK] = event - NEW_FLANK
    elif event >= NEW_ZONE - 1:
        plate = 2 * (state[ZONE] + event - NEW_ZONE)  # the cart leaves one zone or enters another
        state[ZONE] = event - NEW_ZONE
        if abs(state[VELOCITY]) <= PLATE_REST_SPEED * cart.pieces[cart.firsts[FORCE + 1] - 1, 1]:
            pull = pull_on_cart(cart, state[FLANK], plate, step[0, ORDER], state[ELONGATION], step[1, ORDER])[0]
            low, high = stiction_limits(cart, state, step[0, ORDER] - state[ELONGATION], plate)
            if low <= pull <= high:
                state[VELOCITY], state[ZONE] = 0.0, plate


@inlined
def _cut(polynomial, scale, h, u, step, work):
    """Cut a step of h [s] at u."""
    for channel in range(0, 3, 3):  # a literal 0 would be compiled anew
        _follow(polynomial, polynomial[0], scale, h * u, step, channel)
    for k in range(3, 6):
        _transform(CHEBYSHEV, step[k], work)
        for i in range(ORDER + 1):
            step[k, i] = _value(work, u * NODES[i])


@inlined
def _fill_shares(cart, state, within, slip, position, end, step):
    """Fill in both shares at the nodes of a cut step, or at rest; there those of the last heading."""
    if len(cart.turns) > 0 and within.slip == 0:
        within, _ = smooth_range(cart, state, state[HEADING], 0.0, position)
    for i in range(ORDER + 1 if slip == 0 or end < 1 else 0):
        step[6, i] = step[7, i] = 1.0
        if len(cart.turns) > 0:
            travel = within.slip * (step[0, i] - step[3, i] - state[TURN])
            step[6, i], _, step[7, i], _ = shares_of(cart, within, travel)


@inlined
def _largest_speed(step):
    """Largest speed of the cart at the nodes of a step [m/s]."""
    largest = 0.0
    for i in range(ORDER + 1):
        largest = max(largest, abs(step[1, i] - step[4, i]))
    return largest


@inlined
def _shift(polynomial, start, out):
    """Fill in the coefficients of p(start + u), in ascending order as those of p."""
    n = len(out)
    for i in range(n):
        out[i] = polynomial[i]
    for i in range(n):
        for j in range(n - 2, i - 1, -1):
            out[j] += start * out[j + 1]


@inlined
def _direction(cart, state, limits, pull):
    """Direction in which a cart moves or starts under a pull [N]; 0 where friction or a plate holds it."""
    margin = HOLD / 2 * cart.force_scale
    if state[VELOCITY] != 0:
        return 1.0 if state[VELOCITY] > 0 else -1.0
    if limits[1] - limits[0] <= margin:
        return 1.0 if pull >= (limits[0] + limits[1]) / 2 else -1.0
    return 1.0 if pull > limits[1] + margin else -1.0 if pull < limits[0] - margin else 0.0


@inlined
def _attempt(cart, state, within, polynomial, scale, h, step, mix):
    """Fill in a step of h [s]; returns the ratio of the admissible step to it, 0 for failure."""
    for channel in range(0, 3 if within.slip != 0 else 6, 3):  # for a cart at rest the driven end alone moves
        _follow(polynomial, polynomial[0] if channel == 0 else state[ELONGATION], scale, h, step, channel)
    if within.slip == 0:
        return 1.0
    state[EVALUATIONS] += ORDER
    if not _collocate(cart, state, within, h, step, mix):
        return 0.0
    impedance, end_stiffness = math.sqrt(cart.stiffness * cart.mass), 0.0
    if cart.damping > impedance:
        impedance = cart.damping
    if abs(state[ZONE]) == NEAR_SPRING:
        end_stiffness = cart.end_stiffness
    defect = RESOLVED
    for k in range(ORDER - 1, ORDER + 1):  # the last two Chebyshev coefficients
        for channel in range(3, 6):
            weight = cart.stiffness + end_stiffness if channel == 3 else impedance if channel == 4 else cart.mass
            size = weight / cart.tolerance * abs(_product(CHEBYSHEV, k, step[channel]))
            defect = size if size > defect else defect
    ratio = SAFETY * defect ** (-1 / (ORDER - 2))
    return ratio if defect > 1 or ratio > 1 else 1.0


@inlined
def _shorter_step(h, ratio, end):
    """Step [s] after a failed one of h [s]; an event that ends a step which is too long may be the reason."""
    ratio = MIN_RATIO if ratio < MIN_RATIO else ratio
    return _rounded(h * (OVERSHOOT * end if ratio < OVERSHOOT * end and end < SAFETY else ratio))


@compiled
def advance(cart: SpringCart, law: PiecewisePolynomial, state: Array, rows: Array, attempts: int) -> tuple[int, int]:
    """Continue an integration by at most `attempts` attempts; returns the status and the number of filled rows."""
    filled, fastest = 0, cart.pieces[cart.firsts[FORCE + 1] - 1, 1]
    step, polynomial = np.empty((CHANNELS, ORDER + 1)), np.empty(law.coefficients.shape[1])
    margins, events, work = np.empty((EVENTS, ORDER + 1)), np.empty(EVENTS), np.empty((3, ORDER + 1))
    for _ in range(attempts):
        piece = int(state[PIECE])
        if piece == len(law.coefficients):
            return DONE, filled
        width = law.breaks[piece + 1] - law.breaks[piece]
        remaining = (1 - state[FRACTION]) * width
        state[ATTEMPTS] += 1
        if state[STEP] < MIN_STEP * width or state[ATTEMPTS] > MAX_ATTEMPTS:
            return STEP_TOO_SHORT, filled

        # motion of the driven end from here on, forces and direction of the cart
        _shift(law.coefficients[piece], state[FRACTION], polynomial)
        y, rate = polynomial[0], polynomial[1] / width - state[VELOCITY]
        position, zone = y - state[ELONGATION], state[ZONE]
        pull = pull_on_cart(cart, state[FLANK], zone, y, state[ELONGATION], rate)[0]
        limits = stiction_limits(cart, state, position, zone) if state[VELOCITY] == 0 else (0.0, 0.0)
        slip = _direction(cart, state, limits, pull)
        if slip == -state[HEADING]:
            turn(cart, state, slip, position)
        if abs(zone) == AT_NEAR_PLATE and slip != 0:  # the cart leaves its plate
            state[ZONE] = zone / 2 if slip == -zone / 2 else 0.0
        within, _ = smooth_range(cart, state, slip, state[VELOCITY], position)

        # one attempt, up to its first event
        h = remaining if (slip == 0 and state[ATTEMPTS] == 1) or state[STEP] > remaining else state[STEP]
        ratio, end, event = _attempt(cart, state, within, polynomial, width, h, step, work[2]), 1.0, NO_EVENT
        _find_margins(cart, state, within, limits, step, work[2], margins, events)
        for k in range(EVENTS if ratio > 0 else 0):
            place = _fall(margins[k], end, work[0], work[1])
            end, event = (place, events[k]) if place < end else (end, event)
        if ratio < 1:
            state[STEP] = _shorter_step(h, ratio, end)
            continue
        if slip == 0:
            if end < 0.25 and h > 8 * MIN_STEP * width:  # a shorter step locates the breakaway behind a stiff spring
                state[STEP] = _rounded(2 * end * h if end * h > 2 * MIN_STEP * width else 4 * MIN_STEP * width)
                continue
        else:
            longer = _rounded(h * ratio)
            state[STEP] = state[STEP] if h == remaining and state[STEP] > longer else longer
        if end < 1:
            _cut(polynomial, width, h, end, step, work[0])
        if _largest_speed(step) > fastest:
            return SPEED_BEYOND_TABLE, filled

        # accept it
        if end * h > MIN_STEP * width:
            row = rows[filled]
            row[0], row[1], row[2] = law.breaks[piece] + state[FRACTION] * width, end * h, slip
            row[3], row[4], row[5] = state[FLANK], state[ZONE], state[HEADING]
            _fill_shares(cart, state, within, slip, position, end, step)
            for k in range(step.size):
                row[ROW_HEAD + k] = step.flat[k]
            filled += 1
            state[ATTEMPTS] = 0
        _leave(cart, state, slip, event, step)
        state[FRACTION] += end * h / width
        if (event == NO_EVENT and h == remaining) or state[FRACTION] > 1 - MIN_STEP:
            state[PIECE], state[FRACTION] = piece + 1, 0.0
    return PAUSED, filled
