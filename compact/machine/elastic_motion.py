"""Motion of a cart behind a spring, exact between events.

    m x'' = k (e - o) + c e' + S(x) - R(x', x'', s),   e = y(t) - x

y(t) is the imposed motion of the driven end, e the elongation, o the engaged half of the backlash, S the force of the
end springs and s the travel since the last turn. Between two events the cart is a linear oscillator under a polynomial
force (`oscillator`, `spring_cart`). R is set-valued at speed 0: a cart remains at rest while the other forces
lie between both limits. While the cart slides, R is linearised at the start of the interval, and the remainder is
interpolated at Chebyshev points in a fixed-point iteration (collocation). It converges in one step for dry friction,
which can cover a whole piece of y. An interval ends at a knot of R where R continued smoothly beyond it differs by more
than the tolerance. Its length does not depend on the stiffness.

Events are a speed of zero, a knot of R, breakaway from rest, the opening or closing of the backlash and the contact
with an end spring. They are roots of signals and are located to rounding.
"""

import math

import numpy as np

from compact.machine.oscillator import (
    POLYNOMIAL,
    SCALE,
    SERIES_REACH,
    SERIES_TERMS,
    characteristic_roots,
    combine,
    evaluate,
    first_downcrossing,
    solve_oscillator,
    substitute,
    transform,
)
from compact.machine.spring_cart import (
    AT_FAR_PLATE,
    AT_NEAR_PLATE,
    BACKWARD,
    FAR_SPRING,
    FORWARD,
    FULL_RANGE,
    KNOT_TOLERANCE,
    NEAR_SPRING,
    ROW_HEAD,
    CartState,
    SpringCart,
    Trajectory,
    breakaway_direction,
    differentiate_resistance,
    linearise,
    spring_force,
    stiction_limits,
)
from compact.numerics import Array
from compact.numerics.jit import compiled, internal
from compact.numerics.piecewise import PiecewisePolynomial

MIN_STEP = 1e-13  # [-], of a piece of the driven-end motion; shorter steps are rounding
MAX_ATTEMPTS = 1000  # [-], of one interval; each is shorter by a tenth or more, 300 reach MIN_STEP
ATTEMPTS_PER_CALL = 500  # [-], of one compiled call; 0.1 s or less, then Python handles interrupts
STEP_TOO_SHORT = f"steps below {MIN_STEP:g} of a piece of the law; use a smooth `resistance`"
STICK_STEP = 1e-7  # [-], of a piece of the driven-end motion; a cart that stops again within such a step sticks
PLATE_REST_SPEED = 1e-7  # [-], of the largest speed; a slower cart does not rebound from the plate of an end spring
REST_ROUNDING = 1e-12  # [-], of the largest speed; a slower cart at the end of an interval is at rest


POINTS = 9  # [-], of the collocation; the defect falls with the ninth power of the step
DEFECT_POINTS = 16  # [-], cells between the points of an interval at which the defect is evaluated
COLLOCATION_ITERATIONS = 25  # [-], of the collocation; 1 for dry friction, 2 to 6 are usual
MIN_STEP_RATIO, MAX_STEP_RATIO, STEP_SAFETY = 0.2, 6.0, 0.9  # [-], of the step control
STEPS_PER_OCTAVE = 8  # [-], of the grid of steps, so that rounding of a defect does not change them
LEAST_RHO = 1 + 1e-3  # [-], of Bernstein's ellipse; an interval up to rest is within reach
FORCE_ROUNDING = 2e-12  # [-], of R; a thousand times the rounding of a defect by it
VELOCITY_ROUNDING = 2e-13  # [-], of the velocity of the driven end; a thousand times the rounding of a velocity
RESOLVED_DEFECT = 1e-3  # [-], of the tolerance; a larger defect determines the step, whatever its rounding
STOP_STEP_RATIO = 0.05  # [-]; smallest step ratio while the cart comes to rest
OVERSHOOT = 1.1  # [-], of the time to an event; the shortened interval still contains the event
EARLIEST_SATURATION = 1e-2  # [-], of an interval; earlier changes of the saturation are rounding at the limit
NODES = np.sin(np.pi * np.arange(POINTS) / (2 * (POINTS - 1))) ** 2
DEFECT_NODES = np.arange(DEFECT_POINTS + 1) / DEFECT_POINTS
TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))


DONE, PAUSED, SPEED_BEYOND_TABLE = range(3)  # status of `advance`
# events that end an interval; STUCK: a stop immediately after breakaway, RANGE_EXIT: a change of the smooth range of R,
# REJECTED: no interval, since an attempt exceeds the tolerance
(
    NO_EVENT, STOPPED, STUCK, BREAKAWAY_FORWARD, BREAKAWAY_BACKWARD, FLANK_OPENED, FRONT_FLANK_CLOSED,
    REAR_FLANK_CLOSED, END_SPRING_LEFT, NEAR_SPRING_REACHED, FAR_SPRING_REACHED, RANGE_EXIT, REJECTED,
) = map(float, range(13))  # fmt: skip
# indices of the progress of an integration; the first six are a `CartState`
ELONGATION, VELOCITY, FLANK, ZONE, TURN, HEADING, PIECE, FRACTION, STEP, LAST_EVENT, ATTEMPTS, EVALUATIONS = range(12)


@internal
def _respond(cart, springs, tangent, driven_end, remainder, elongation, h):
    """Elongation over h [s] under the linearised resistance and its remainder."""
    n, mass = len(driven_end), cart.mass + tangent.added_mass
    stiffness, driven_stiffness, constant = springs[0] + tangent.stiffness, springs[1] + tangent.stiffness, springs[2]
    force = np.empty(n)
    for j in range(n):
        force[j] = driven_stiffness * driven_end[j]
        if j + 2 < n:
            force[j] += mass / h**2 * (j + 1) * (j + 2) * driven_end[j + 2]
        if j + 1 < n:
            force[j] += tangent.damping / h * (j + 1) * driven_end[j + 1]
        if j < POINTS:
            force[j] += remainder[j]
    offset = tangent.damping * tangent.velocity + tangent.added_mass * tangent.acceleration
    force[0] += tangent.force - constant - offset - tangent.stiffness * (tangent.turn + tangent.position)
    rate = driven_end[1] / h - tangent.velocity
    return solve_oscillator(mass, cart.damping + tangent.damping, stiffness, force, elongation, rate, h)


@internal
def _remainders(cart, slip, tangent, within, motion, places, until):
    """Velocities [m/s] and R less its tangent [N] at places u/until of a motion x(u) from the turn, shape (2, n)."""
    out = np.empty((2, len(places)))
    velocity = transform(motion, 0.0, 1.0, 0.0)
    change = transform(velocity, 0.0, 1.0, 0.0)
    for i in range(len(places)):
        u = until * places[i]
        v, x = evaluate(velocity, u), 0.0
        a = evaluate(change, u) if cart.rate_limit > 0 else 0.0
        if len(cart.travels) > 0:
            x = evaluate(motion, u)
        force = differentiate_resistance(cart, slip, v, a, slip * x, within)[0]
        linear = tangent.force + tangent.damping * (v - tangent.velocity)
        linear += tangent.added_mass * (a - tangent.acceleration) + tangent.stiffness * (x - tangent.position)
        out[0, i], out[1, i] = v, force - linear
    return out


@internal
def _exit_fraction(cart, slip, tangent, within, motion, inside, tolerance):
    """Fraction of a motion to a little beyond its exit from the smooth range; 1 where the exit has no effect on R."""
    leaves = cart.rate_limit > 0 or len(cart.travels) > 0
    for i in range(POINTS):
        leaves = leaves or not within.low <= slip * inside[0, i] <= within.high
    if leaves:
        exact = _remainders(cart, slip, tangent, FULL_RANGE, motion, NODES, 1.0)
        for i in range(POINTS):
            if slip * inside[0, i] > 0 and abs(exact[1, i] - inside[1, i]) > tolerance:
                return min(1.0, OVERSHOOT * _range_exit(cart, slip, within, motion))
    return 1.0


@internal
def _range_exit(cart, slip, within, motion):
    """First u at which a motion x(u) from the turn leaves the smooth range of its start; 2.0 without an exit."""
    velocity, first = transform(motion, 0.0, 1.0, 0.0), 2.0
    for sign, limit in ((1.0, within.low), (-1.0, within.high)):
        if 0 < limit < np.inf:
            u = first_downcrossing(transform(velocity, sign * slip, 0.0, -sign * limit))
            first = min(first, u if u > KNOT_TOLERANCE else 2.0)
    if within.farthest < np.inf:
        u = first_downcrossing(transform(motion, -slip, 0.0, within.farthest))
        first = min(first, u if u > KNOT_TOLERANCE else 2.0)
    if 0 < cart.rate_limit < np.inf:
        side = 1.0 if within.saturation == 0 else -1.0
        for sign in (1.0, -1.0):
            if side > 0 or sign == within.saturation:
                margin = transform(velocity, side * slip * cart.rate_limit, -side * sign, 0.0)
                u = first_downcrossing(margin)
                first = min(first, u if u > EARLIEST_SATURATION else 2.0)
    return first


@internal
def _next_step(h, wanted, ratio, end, event, motion):
    """Step [s] after an interval within a step h of the wanted one, of which `ratio` was admissible.

    A power of |v| is singular at rest. Over an interval from one speed to another the error of the interpolation falls
    by the parameter of Bernstein's ellipse, rho = |(1 + s)/(1 - s)| with s^2 = after/before, per point. A step that
    reaches rest is not rounded: it would end before.
    """
    if event == STOPPED:
        return h
    if event == RANGE_EXIT or h < wanted:  # the resistance ended the interval, not the step
        return wanted
    velocity = transform(motion, 0.0, 1.0, 0.0)
    s = math.sqrt(abs(evaluate(velocity, end)) / max(abs(evaluate(velocity, 0.0)), 1e-300))
    longest = h * MAX_STEP_RATIO
    if abs(1 - s) < 1e-3:
        longest = h * min(ratio, MAX_STEP_RATIO)
    elif s <= 1e3:
        rho = max((1 + s) / abs(1 - s) / ratio, LEAST_RHO)
        last = (rho - 1) / (rho + 1) if s < 1 else (rho + 1) / (rho - 1)
        longest = h * min(max(s**2 * (1 - last**2) / (1 - s**2), STOP_STEP_RATIO), MAX_STEP_RATIO)
        if s < 1 and rho == LEAST_RHO:
            return longest
    return _round_step(longest)


@internal
def _round_step(step):
    """Longest step [s] of a geometric grid up to a step [s]."""
    return 2.0 ** (math.floor(STEPS_PER_OCTAVE * math.log2(step)) / STEPS_PER_OCTAVE)


@internal
def _defect(cart, slip, tangent, motion, remainder, until):
    """Largest defect of the remainder [N] and largest |v| [m/s] for 0 <= u <= until."""
    worst, fastest = 0.0, 0.0
    exact = _remainders(cart, slip, tangent, FULL_RANGE, motion, DEFECT_NODES, until)
    for i in range(len(DEFECT_NODES)):
        r = 0.0
        for j in range(POINTS - 1, -1, -1):
            r = r * (until * DEFECT_NODES[i]) + remainder[j]
        if slip * exact[0, i] > 0:
            worst = max(worst, abs(exact[1, i] - r))
        fastest = max(fastest, abs(exact[0, i]))
    return worst, fastest


@internal
def _first_event(cart, state, slip, signal, driven_end, limits):
    """First event (u, event) of an interval; (1, NO_EVENT) without one.

    Each event is the downcrossing of a e + b de/dt + c y + d dy/dt + constant.
    """
    end, event, flank, zone = 1.0, NO_EVENT, state[FLANK], state[ZONE]
    stiffness, driven_stiffness, offset = spring_force(cart, flank, zone)
    for k in range(6):
        a = b = c = d = constant = 0.0
        candidate, sign = NO_EVENT, 1.0 if k % 2 == 0 else -1.0
        if k == 0 and slip != 0:
            b, d, candidate = -slip, slip, STOPPED
        elif k < 2 and slip == 0:
            a, b, c = -sign * stiffness, -sign * cart.damping, sign * driven_stiffness
            constant = sign * ((limits[1] if k == 0 else limits[0]) - offset)
            candidate = BREAKAWAY_FORWARD if k == 0 else BREAKAWAY_BACKWARD
        elif 2 <= k < 4 and slip != 0 and cart.end_length > 0 and zone != -sign:
            candidate = NEAR_SPRING_REACHED if k == 2 else FAR_SPRING_REACHED
            plate, side = cart.end_length if k == 2 else cart.stroke - cart.end_length, sign
            if zone == sign:
                candidate, side = END_SPRING_LEFT, -sign
            a, c, constant = -side, side, -side * plate
        elif k >= 4 and cart.backlash > 0 and flank != -sign:
            candidate, side = FRONT_FLANK_CLOSED if k == 4 else REAR_FLANK_CLOSED, -1.0
            if flank == sign:
                candidate, side = FLANK_OPENED, 1.0
            a, constant = side * sign, -side * cart.backlash / 2
        if candidate != NO_EVENT:
            u = first_downcrossing(combine(signal, driven_end, a, b, c, d, constant))
            if u < end or (u == end and event == NO_EVENT):
                end, event = u, candidate
    return end, event


@internal
def _slide(cart, state, slip, pull, piece, steps, tolerance):
    """One attempt to slide over at most steps[0] of the remaining steps[1] of a piece of width steps[2] [s].

    Returns the elongation, the driven end, end and event of the interval and the largest speed.
    """
    springs = spring_force(cart, state[FLANK], state[ZONE])
    position = piece[0] - state[ELONGATION]
    within, tangent = linearise(cart, slip, state[VELOCITY], slip * (position - state[TURN]), state[TURN], pull)
    mass, damping = cart.mass + tangent.added_mass, cart.damping + tangent.damping
    decay, _, slow, fast = characteristic_roots(mass, damping, springs[0] + tangent.stiffness)
    h = wanted = min(steps[0], steps[1])
    if decay <= 0 and slow * h < SERIES_REACH < fast * h:  # a growing oscillation
        h = wanted = SERIES_REACH / fast
    remainder, previous = np.zeros(POINTS), np.zeros(POINTS)
    y, converged = substitute(piece, 0.0, h / steps[2]), False
    for iteration in range(COLLOCATION_ITERATIONS + 2):
        e = _respond(cart, springs, tangent, y, remainder, state[ELONGATION], h)
        motion = combine(e, y, -1.0, 0.0, 1.0, 0.0, -state[TURN])
        if converged:
            break
        values = _remainders(cart, slip, tangent, within, motion, NODES, 1.0)
        if iteration == 0:
            fraction = _exit_fraction(cart, slip, tangent, within, motion, values, tolerance)
            if fraction < 1:
                y, h = substitute(y, 0.0, fraction), h * fraction
                continue
        change = 0.0
        for i in range(POINTS):
            change = max(change, abs(values[1, i] - previous[i])) if math.isfinite(values[1, i]) else np.inf
            previous[i], remainder[i] = values[1, i], 0.0
            for j in range(POINTS):
                remainder[i] += TO_COEFFICIENTS[i, j] * values[1, j]
        state[EVALUATIONS] += POINTS
        if change == np.inf:
            break
        converged = change <= tolerance / 10  # the remaining error falls by the same factor
    if not converged:
        state[STEP] = h / 2
        return e, y, 0.0, REJECTED, 0.0

    # events and step control
    end, event = _first_event(cart, state, slip, e, y, (0.0, 0.0))
    defect, fastest = _defect(cart, slip, tangent, motion, remainder, end)
    leave = _range_exit(cart, slip, within, motion) if defect > tolerance else 2.0
    if leave < end:
        end, event = leave, RANGE_EXIT
        defect, fastest = _defect(cart, slip, tangent, motion, remainder, end)
    state[EVALUATIONS] += DEFECT_POINTS
    rounding = FORCE_ROUNDING * abs(tangent.force) + VELOCITY_ROUNDING * abs(tangent.damping * y[1] / h)
    resolved = min(rounding / tolerance, RESOLVED_DEFECT)  # a smaller defect counts as one without rounding
    ratio = STEP_SAFETY * max(defect / tolerance, resolved, 1e-300) ** (-1 / POINTS)
    if defect > tolerance:
        state[STEP] = _round_step(h * min(max(ratio, MIN_STEP_RATIO), OVERSHOOT * end))
        return e, y, 0.0, REJECTED, 0.0
    state[STEP] = _next_step(h, wanted, ratio, end, event, motion)
    return e, y, end, event, fastest


@internal
def _leave(cart, state, slip, event, e, y, end):
    """Advance a state to the end of an interval, with its event."""
    velocity, fastest = 0.0, cart.pieces[cart.firsts[FORWARD + 1] - 1, 1]
    if slip != 0 and event != STOPPED and event != STUCK:
        velocity = evaluate(combine(e, y, 0.0, -1.0, 0.0, 1.0, 0.0), end)
        if abs(velocity) <= REST_ROUNDING * fastest:
            velocity = 0.0
    zone = state[ZONE]
    state[ELONGATION], state[VELOCITY] = evaluate(e, end), velocity
    if event in (FLANK_OPENED, FRONT_FLANK_CLOSED, REAR_FLANK_CLOSED):
        state[FLANK] = 0 if event == FLANK_OPENED else 1 if event == FRONT_FLANK_CLOSED else -1
    elif event in (BREAKAWAY_FORWARD, BREAKAWAY_BACKWARD) and abs(zone) == AT_NEAR_PLATE:
        compresses = (zone == AT_NEAR_PLATE) == (event == BREAKAWAY_BACKWARD)
        state[ZONE] = 0 if not compresses else NEAR_SPRING if zone == AT_NEAR_PLATE else FAR_SPRING
    elif event in (END_SPRING_LEFT, NEAR_SPRING_REACHED, FAR_SPRING_REACHED):
        near = event == NEAR_SPRING_REACHED or zone == NEAR_SPRING
        state[ZONE] = 0 if event == END_SPRING_LEFT else NEAR_SPRING if near else FAR_SPRING
        if abs(velocity) <= PLATE_REST_SPEED * fastest:  # a slow cart may come to rest at the plate
            plate = AT_NEAR_PLATE if near else AT_FAR_PLATE
            stiffness, _, constant = spring_force(cart, state[FLANK], plate)
            pace = evaluate(combine(e, y, 0.0, 0.0, 0.0, 1.0, 0.0), end)
            pull = stiffness * state[ELONGATION] + constant + cart.damping * pace
            travel = state[HEADING] * (evaluate(combine(e, y, -1.0, 0.0, 1.0, 0.0, 0.0), end) - state[TURN])
            if breakaway_direction(stiction_limits(cart, state[HEADING], travel, plate), pull) == 0:
                state[VELOCITY], state[ZONE] = 0.0, plate


@internal
def _slip_direction(state, limits, pull):
    """Direction of the motion that follows a state under a pull [N]."""
    last = state[LAST_EVENT]
    if state[VELOCITY] != 0:
        return 1.0 if state[VELOCITY] > 0 else -1.0
    if last == BREAKAWAY_FORWARD:
        return 1.0
    if last == BREAKAWAY_BACKWARD:
        return -1.0
    return 0.0 if last == STUCK else breakaway_direction(limits, pull)


@compiled
def advance(
    cart: SpringCart, law: PiecewisePolynomial, state: Array, tolerance: float, rows: Array, attempts: int
) -> tuple[int, int]:
    """Continue an integration by at most `attempts` attempts; returns the status and the number of filled rows."""
    filled = 0
    for _ in range(attempts):
        i = int(state[PIECE])
        if i == len(law.coefficients):
            return DONE, filled
        width, fraction = law.breaks[i + 1] - law.breaks[i], state[FRACTION]
        if not fraction < 1:
            state[PIECE], state[FRACTION], state[LAST_EVENT] = i + 1, 0.0, NO_EVENT
            continue
        state[ATTEMPTS] += 1
        if state[STEP] < MIN_STEP * width or state[ATTEMPTS] > MAX_ATTEMPTS:
            raise RuntimeError(STEP_TOO_SHORT)

        # forces and direction of the motion
        piece, remaining = substitute(law.coefficients[i], fraction, 1.0), (1 - fraction) * width
        position, flank, zone = piece[0] - state[ELONGATION], state[FLANK], state[ZONE]
        stiffness, driven_stiffness, constant = spring_force(cart, flank, zone)
        pull = stiffness * state[ELONGATION] - driven_stiffness * piece[0] + constant
        pull += cart.damping * (piece[1] / width - state[VELOCITY])
        limits = stiction_limits(cart, state[HEADING], state[HEADING] * (position - state[TURN]), zone)
        slip = _slip_direction(state, limits, pull)
        if slip == -state[HEADING]:
            state[HEADING], state[TURN] = slip, position

        # one attempt
        if slip == 0:
            y, scale = substitute(piece, 0.0, remaining / width), remaining
            e = np.zeros(POLYNOMIAL + len(y))
            for j in range(1, len(y)):
                e[POLYNOMIAL + j] = y[j]
            e[SCALE], e[POLYNOMIAL] = remaining, state[ELONGATION]
            end, event = _first_event(cart, state, slip, e, y, limits)
        else:
            e, y, end, event, fastest = _slide(
                cart, state, slip, pull, piece, (state[STEP], remaining, width), tolerance
            )
            if event == REJECTED:
                continue
            if fastest > cart.pieces[cart.firsts[FORWARD + 1 if slip > 0 else BACKWARD + 1] - 1, 1]:
                return SPEED_BEYOND_TABLE, filled
            scale = e[SCALE]

        # accept it, or repeat a doubtful breakaway over a shorter interval, where rounding is smaller
        stuck = state[VELOCITY] == 0 and event == STOPPED and end * scale < MIN_STEP * width
        if stuck:
            state[STEP] = scale / 8
            if scale > STICK_STEP * width:
                continue
            state[STEP], event = np.inf, STUCK
        row = rows[filled]
        row[0], row[1], row[2] = law.breaks[i] + fraction * width, end * scale, slip
        row[3], row[4], row[5] = flank, zone, state[TURN]
        for j in range(ROW_HEAD, len(row)):
            row[j] = e[j - ROW_HEAD] if j - ROW_HEAD < len(e) else 0.0
        for j in range(len(y)):
            row[len(row) - len(y) + j] = y[j]
        filled += 1
        state[ATTEMPTS], state[LAST_EVENT] = 0, event
        _leave(cart, state, slip, event, e, y, end)
        reached = fraction + end * scale / width
        complete = scale == remaining and event == NO_EVENT
        state[FRACTION] = 1.0 if complete or reached > 1 - MIN_STEP else reached  # a remainder below it is rounding
    return PAUSED, filled


def integrate(
    cart: SpringCart, law: PiecewisePolynomial, start: CartState, tolerance: float, max_intervals: int
) -> tuple["Trajectory", bool, int]:
    """Integrate a cart through all pieces of a motion of the driven end [m] over time [s], smooth within each.

    Returns the trajectory, False where its speed exceeds the tables, and the number of evaluations of R, whose defect
    [N] is at most the tolerance.
    """
    state = np.array([*start, 0.0, 0.0, np.inf, NO_EVENT, 0.0, 0.0], float)
    parts, count, status = [], 0, PAUSED
    rows = np.empty((ATTEMPTS_PER_CALL, ROW_HEAD + POLYNOMIAL + SERIES_TERMS + law.coefficients.shape[1]))
    while status == PAUSED:  # Python handles interrupts between two calls
        try:
            status, filled = advance(cart, law, state, tolerance, rows, ATTEMPTS_PER_CALL)
            if (count := count + filled) > max_intervals:
                raise RuntimeError(f"more than {max_intervals} intervals; increase `damping`, or use a rigid drive")
        except RuntimeError as error:
            i = min(int(state[PIECE]), len(law.coefficients) - 1)
            time = law.breaks[i] + state[FRACTION] * (law.breaks[i + 1] - law.breaks[i])
            raise RuntimeError(
                f"the integration of the cart ended at {time:g} s of {law.breaks[-1]:g} s after {count} intervals, at "
                f"{state[VELOCITY]:g} m/s: {error}"
            ) from None
        parts.append(rows[:filled].copy())
    elongation, velocity, flank, zone, turn, heading = state[: HEADING + 1].tolist()
    end = CartState(elongation, velocity, int(flank), int(zone), turn, int(heading))
    return Trajectory(cart, np.concatenate(parts), start, end), status == DONE, int(state[EVALUATIONS])
