"""One pass of a cart behind a spring by even time steps, for compiled code; its periodic regime by Broyden's method.

    m e'' + c e' + k e = m y'' + R,   R = h (F(|x'|) g + f),   x = y - e,   H = k e + c e'

y is the law, x the cart, e the elongation, h the heading, F the steady force of the mix, g its share along the stroke
and f the friction of the guide wheels, which follows the share of the load. On a step y'' + R/m is linear in time, and
the oscillator is solved exactly; R is that of both ends of the step. Turns, stops and breakaways divide a step.

The roller remembers, for either heading, the position P of its front and the origin O of its travel:

    x >= P            P = x,  first = share(x - O)
    x < P             first = track + (share(P - O) - track) exp(-(P - x)/r)
    away by over d    P = x + d, O = x: the sleeve has laid fresh mix, at the distance of that stroke
    g = first - (g_end + first at the turn) exp(-s/r),   s the travel since the turn

so that the force of the mix does not jump at a turn (`compact.turning`). Without a release, r = 0, the mix holds a cart
at rest as dry friction does.

The state is seen from the stroke: it is mirrored where the law turns. Where both strokes are mirror images, a pass that
ends as it started is periodic; otherwise two passes are. A soft spring may have two regimes: the first passes are not
extrapolated, so that the one is found to which a cart comes that follows the law at first.
"""

import math
from typing import NamedTuple

import numpy as np

from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, internal

PASSES = 60  # [-], at most; 3 to 12 are usual
UNSETTLED_PASSES = 12  # [-], where none is periodic: the one with the largest force counts
CLOSURE = 3e-7  # [-], of the force scale; residual of a closed pass
WORSE = 4.0  # [-], residual over the least one, beyond which Broyden's method starts again
FADED_SHARE = 0.25  # [-], of the first transient, after which passes are extrapolated to a regime
MOVE_LIMIT = 8.0  # [-], of the residual; change of the state by an extrapolation
CORRECTORS = 2  # [-], evaluations of the resistance at the end of a step
STEEP = 0.01  # [-], of F; a larger change of the resistance in one step is not extrapolated to the next
HELD = 1e-6  # [-], of the range of pulls that hold a cart; a pull within it of an end breaks away
SHORTEST = 1e-12  # [-], of a step; a shorter rest is left out
EVENTS = 8  # [-], turns, stops and breakaways of one step, at most
FADED = 30.0  # [-], travel over r at which a release has decayed
SIZE = 13  # [-], numbers of a state
UNKNOWNS = 3  # [-], of a periodic regime
ELONGATION, RATE, HEADING, STUCK, TURN, DROP, LOAD_DROP, FRONT, BACK_FRONT, ORIGIN, BACK_ORIGIN, FORCE, GUIDE = range(
    SIZE
)
FASTEST, TRAVEL_STEP, TRACK, DISTANCE, RELEASE, LOAD_TRACK, WHEELS = range(7)  # numbers of a `TravelTable`


class Spring(NamedTuple):
    """Cart and spring: m [kg], k [N/m], c [N s/m]."""

    mass: float
    stiffness: float
    damping: float


class TravelTable(NamedTuple):
    """Resistance of one cart over speed and travel, in rows of forward stroke, return stroke and forward stroke.

    Parameters
    ----------
    forces : ndarray, shape (SPEED_SAMPLES + 1,)
        Steady force F [N] of the mix at the speeds `fastest` u^2, u even from 0 to 1.
    shares, load_shares : ndarray, shape (3, SHARE_SAMPLES + 1)
        Shares of force and load [-] at even travels from 0 to the stroke.
    numbers : ndarray, shape (3, 12)
        `fastest` [m/s], step of the travels [m], share of the force on the own track [-], travel d [m] before fresh
        mix is met, length r of the release [m], share of the load on the own track, and friction of both guide wheels
        [N]: constant, over the load share, over the force of the mix.
    """

    forces: Array
    shares: Array
    load_shares: Array
    numbers: Array

    @property
    def sides(self) -> int:
        """Passes of a periodic regime: 1 where the strokes are mirror images, else 2."""
        pairs = ((each[0], each[1]) for each in (self.shares, self.load_shares, self.numbers))
        return 1 if all(np.array_equal(*pair) for pair in pairs) else 2


class PassTable(NamedTuple):
    """Law at even instants of one pass, both ends included, and both limits of its acceleration in each step.

    Parameters
    ----------
    position, velocity : ndarray, shape (n + 1,)
        y [m] and y' [m/s].
    starts, ends : ndarray, shape (n,)
        y'' at start and end of each step [m/s^2].
    step : float
        Duration of a step [s].
    stroke : float
        [m].
    """

    position: Array
    velocity: Array
    starts: Array
    ends: Array
    step: float
    stroke: float


@internal
def _interpolate(values, place):
    """Value between even samples, held beyond the last."""
    i = int(place)
    last = len(values) - 1
    if i >= last:
        return values[last]
    return values[i] + (place - i) * (values[i + 1] - values[i])


@internal
def _first_part(state, own, numbers, shares, track, way):
    """Share of old front and new mix at a position in the sense of a heading (own 0 or 1: forward, backward)."""
    front, origin = state[FRONT + own], state[ORIGIN + own]
    if way >= front:
        return _interpolate(shares[own], max(way - origin, 0.0) / numbers[own, TRAVEL_STEP])
    if front - way >= FADED * numbers[own, RELEASE]:
        return numbers[own, track]
    built = _interpolate(shares[own], max(front - origin, 0.0) / numbers[own, TRAVEL_STEP])
    return numbers[own, track] + (built - numbers[own, track]) * math.exp(-(front - way) / numbers[own, RELEASE])


@internal
def _share(state, numbers, shares, track, drop, x):
    """Share g at a position, in the present heading, of which the release takes an amount at the turn."""
    heading = state[HEADING]
    own = 0 if heading > 0 else 1
    first = _first_part(state, own, numbers, shares, track, heading * x)
    travel, release = max(heading * (x - state[TURN]), 0.0), numbers[own, RELEASE]
    return first - drop * math.exp(-travel / release) if travel < FADED * release else first


@internal
def _act(state, table, x, speed):
    """Set force of the mix and guide friction [N] at a position and a speed, positive in the heading."""
    numbers, forces, own = table.numbers, table.forces, 0 if state[HEADING] > 0 else 1
    steady = _interpolate(forces, math.sqrt(abs(speed) / numbers[own, FASTEST]) * (len(forces) - 1))
    force, load = steady * _share(state, numbers, table.shares, TRACK, state[DROP], x), 1.0
    if numbers[own, WHEELS + 1] != 0 or numbers[own, WHEELS + 4] != 0:
        load = _share(state, numbers, table.load_shares, LOAD_TRACK, state[LOAD_DROP], x)
    state[FORCE], state[GUIDE] = force, 0.0
    for i in range(WHEELS, WHEELS + 6, 3):
        state[GUIDE] += abs(numbers[own, i] + numbers[own, i + 1] * load + numbers[own, i + 2] * force)


@internal
def _holding(state, table, x):
    """Largest and smallest pull in the heading [N] that hold a cart at rest at a position."""
    ahead, back, heading = state[FORCE], state[FORCE], state[HEADING]
    other = 1 if heading > 0 else 0
    if table.numbers[other, RELEASE] == 0:
        back = -table.forces[0] * _first_part(state, other, table.numbers, table.shares, TRACK, -heading * x)
    return ahead + state[GUIDE], back - state[GUIDE]


@internal
def _move_fronts(state, numbers, x):
    """Move the front ahead with the roller, and that behind once the sleeve has laid fresh mix."""
    own = 0 if state[HEADING] > 0 else 1
    other = 1 - own
    way, distance = state[HEADING] * x, numbers[other, DISTANCE]
    state[FRONT + own] = max(state[FRONT + own], way)
    if state[FRONT + other] + way > distance:
        state[FRONT + other], state[ORIGIN + other] = distance - way, -way


@internal
def _turn(state, table, x):
    """Reverse the heading at a position; force and load of the mix do not jump if they have a release."""
    numbers, shares, loads = table.numbers, table.shares, table.load_shares
    end = _share(state, numbers, shares, TRACK, state[DROP], x)
    load_end = _share(state, numbers, loads, LOAD_TRACK, state[LOAD_DROP], x)
    state[HEADING], state[TURN] = -state[HEADING], x
    own = 0 if state[HEADING] > 0 else 1
    way = state[HEADING] * x
    state[DROP] = end + _first_part(state, own, numbers, shares, TRACK, way)
    state[LOAD_DROP] = _first_part(state, own, numbers, loads, LOAD_TRACK, way) - load_end
    _act(state, table, x, 0.0)


@internal
def _propagator(frequency, decay, h, out):
    """Fill in the free motion of an oscillator over h [s]: e and e' after it for unit e and unit e' before."""
    square = frequency**2 - decay**2
    if square > 0:
        q = math.sqrt(square)
        cosine, sine = math.cos(q * h), math.sin(q * h) / q
        fall = math.exp(-decay * h)
    else:
        q = math.sqrt(-square)
        up, down = math.exp((q - decay) * h), math.exp((-q - decay) * h)
        cosine, sine, fall = (up + down) / 2, (up - down) / (2 * q) if q * h > 1e-6 else h * up, 1.0
    out[0], out[1] = fall * (cosine + decay * sine), fall * sine
    out[2], out[3] = -(frequency**2) * fall * sine, fall * (cosine - decay * sine)


@internal
def _oscillate(frequency, decay, free, e, rate, start, end, h):
    """Elongation and rate after h [s] under an acceleration that is linear in time."""
    slope, square = (end - start) / h, frequency**2
    lag = 2 * decay * slope / square
    before, moving = (start - lag) / square, slope / square
    after = (end - lag) / square
    de, dr = e - before, rate - moving
    return after + free[0] * de + free[1] * dr, moving + free[2] * de + free[3] * dr


@internal
def _law_at(y, v, starts, slope, t):
    """Position and velocity of the law a time t [s] into a step."""
    return y + v * t + starts * t**2 / 2 + slope * t**3 / 6, v + starts * t + slope * t**2 / 2


@internal
def _seen_from(table, stroke):
    """Table of which the first rows are those of stroke 0 or 1 and of the other one."""
    rows = slice(stroke, stroke + 2)
    return TravelTable(table.forces, table.shares[rows], table.load_shares[rows], table.numbers[rows])


@internal
def _advance(spring, tables, side, law, state, out):
    """Simulate one pass from the middle of stroke 0 or 1 to that of the other, and mirror the state to its start."""
    mass, stiffness, damping = spring
    y, v, starts, ends, step, stroke = law
    frequency, decay, n, sign = math.sqrt(stiffness / mass), damping / (2 * mass), len(starts), 1.0
    whole, part, smooth, past, table = np.empty(4), np.empty(4), False, 0.0, _seen_from(tables, side)
    _propagator(frequency, decay, step, whole)
    _act(state, table, y[n // 2] - state[ELONGATION], v[n // 2] - state[RATE])
    out[0] = stiffness * state[ELONGATION] + damping * state[RATE]
    for j in range(n):
        i = (j + n // 2) % n
        if i == 0:  # the law turns: its next pass is the mirror image
            _mirror(state, stroke)
            table, sign = _seen_from(tables, 1 - side), -sign
        t, slope = 0.0, (ends[i] - starts[i]) / step
        smooth = smooth and state[STUCK] == 0
        for event in range(EVENTS + 1):
            h, heading, last = step - t, state[HEADING], event == EVENTS
            if h <= SHORTEST * step:
                break
            if state[STUCK] > 0:
                place = _law_at(y[i], v[i], starts[i], slope, t)[0]
                ahead, back = _holding(state, table, place - state[ELONGATION])
                now = (stiffness * state[ELONGATION] + damping * state[RATE]) * heading
                e = state[ELONGATION] + y[i + 1] - place
                then = (stiffness * e + damping * v[i + 1]) * heading
                if back <= then <= ahead or last:
                    state[ELONGATION], state[RATE] = e, v[i + 1]
                    break
                limit = back if then < back else ahead
                theta = min(max((limit - now) / (then - now), 0.0), 1.0) if then != now else 0.0
                state[ELONGATION] += theta * (e - state[ELONGATION])
                t += theta * h
                state[STUCK] = 0.0
            else:
                free = whole
                if t > 0:
                    _propagator(frequency, decay, h, part)
                    free = part
                before = starts[i] + slope * t + heading * (state[FORCE] + state[GUIDE]) / mass
                e, rate, after = state[ELONGATION], state[RATE], 0.0
                here = state[FORCE] + state[GUIDE]
                for _ in range(1 if smooth else CORRECTORS):  # after a smooth step its forces predict those of the next
                    there = 2 * here - past if smooth else state[FORCE] + state[GUIDE]
                    after = ends[i] + heading * there / mass
                    e, rate = _oscillate(frequency, decay, free, state[ELONGATION], state[RATE], before, after, h)
                    _act(state, table, y[i + 1] - e, max(heading * (v[i + 1] - rate), 0.0))
                speed = (v[i + 1] - rate) * heading
                if speed >= 0 or last:
                    state[ELONGATION], state[RATE] = e, rate
                    _move_fronts(state, table.numbers, y[i + 1] - e)
                    smooth = t == 0 and abs(state[FORCE] + state[GUIDE] - here) < STEEP * table.forces[-1]
                    past = here
                    break
                first = (_law_at(y[i], v[i], starts[i], slope, t)[1] - state[RATE]) * heading
                theta = min(max(first / (first - speed), 0.0), 1.0)
                if theta > 0:
                    _propagator(frequency, decay, theta * h, part)
                    middle = before + theta * (after - before)
                    state[ELONGATION], _ = _oscillate(
                        frequency, decay, part, state[ELONGATION], state[RATE], before, middle, theta * h
                    )
                t += theta * h
            smooth = False
            place, pace = _law_at(y[i], v[i], starts[i], slope, t)
            x, state[RATE] = place - state[ELONGATION], pace
            _act(state, table, x, 0.0)
            _move_fronts(state, table.numbers, x)
            pull = (stiffness * state[ELONGATION] + damping * pace) * heading
            ahead, back = _holding(state, table, x)
            if pull < back * (1 - HELD) + HELD * ahead:
                _turn(state, table, x)
            elif pull < ahead * (1 - HELD) + HELD * back:
                state[STUCK] = 1.0
        out[j + 1] = sign * (stiffness * state[ELONGATION] + damping * state[RATE])


@internal
def _mirror(state, stroke):
    """Mirror a state at the middle of the stroke."""
    for i in (ELONGATION, RATE, HEADING):
        state[i] = -state[i]
    state[TURN] = stroke - state[TURN]
    for i in (FRONT, ORIGIN):
        forward, backward = state[i], state[i + 1]
        state[i], state[i + 1] = backward + stroke, forward - stroke


@internal
def _product(matrix, vector, out):
    """Fill in the product of a matrix and a vector."""
    for k in range(len(out)):
        out[k] = 0.0
        for j in range(len(vector)):
            out[k] += matrix[k, j] * vector[j]


@internal
def _linear_inverse(spring, law, sides, units, inverse):
    """Fill in the inverse of the fall of the residual over the state of a spring without mix, in units of the state."""
    free = np.empty(4)
    frequency, decay = math.sqrt(spring.stiffness / spring.mass), spring.damping / (2 * spring.mass)
    _propagator(frequency, decay, sides * law.step * len(law.starts), free)
    if sides == 1:  # the state is mirrored once
        free = -free
    a, b = 1 - free[0], -free[1] * units[1] / units[0]
    c, d = -free[2] * units[0] / units[1], 1 - free[3]
    det = a * d - b * c
    inverse[:] = 0.0
    inverse[0, 0], inverse[0, 1], inverse[2, 2] = d / det, -b / det, 1.0
    inverse[1, 0], inverse[1, 1] = -c / det, a / det


@internal
def _update(inverse, change, fall):
    """Update an inverse so that it maps the fall of the residual to the change of the state (Broyden)."""
    n = len(change)
    moved, row, dot = np.empty(n), np.zeros(n), 0.0
    _product(inverse, fall, moved)
    for k in range(n):
        dot += change[k] * moved[k]
        for j in range(n):
            row[j] += change[k] * inverse[k, j]
    if abs(dot) > HELD * HELD:
        for k in range(n):
            for j in range(n):
                inverse[k, j] += (change[k] - moved[k]) * row[j] / dot


@internal
def _close(spring, table, law, units, state, inverse, out):
    """Find the periodic regime over elongation, rate and origin at the middle of a stroke; returns the passes, or 0."""
    places, n, least, start = (ELONGATION, RATE, ORIGIN), 3, np.inf, np.empty(SIZE)
    change, residual, last = np.zeros(n), np.empty(n), np.zeros(n)
    cold, decay = not inverse.any(), spring.damping / (2 * spring.mass) * len(out) * law.step * len(law.starts)
    settling = min(math.log(1 / FADED_SHARE) / decay, PASSES // 4) if cold else 0.0
    for count in range(1, PASSES + 1):
        start[:] = state
        for side in range(len(out)):
            _advance(spring, table, side, law, state, out[side])
        size = 0.0
        for k in range(n):
            residual[k] = (state[places[k]] - start[places[k]]) / units[k]
            size = max(size, abs(residual[k]))
        if size < CLOSURE:
            return count
        if count <= settling or count >= PASSES // 2 or (count > 1 and size >= WORSE * least):
            inverse[:] = np.eye(n)  # the next pass goes on from the end of this one
        elif cold:
            cold = False
            _linear_inverse(spring, law, len(out), units, inverse)
        elif count > 1:
            _update(inverse, change, last - residual)
        least = min(least, size)
        last[:] = residual
        _product(inverse, residual, change)
        largest = max(abs(change[0]), abs(change[1]), abs(change[2]))
        change *= min(1.0, MOVE_LIMIT * size / largest)
        state[ELONGATION] += units[0] * (change[0] - residual[0])
        state[RATE] += units[1] * (change[1] - residual[1])
        for k in (ORIGIN, FRONT, TURN):
            state[k] += units[2] * (change[2] - residual[2])
    return 0


@internal
def _unsettled(spring, table, law, state, out):
    """Fill in the passes with the largest force of several further ones."""
    highest, trial = 0.0, np.empty(out.shape)
    for _ in range(UNSETTLED_PASSES):
        for side in range(len(out)):
            _advance(spring, table, side, law, state, trial[side])
        peak = np.abs(trial).max()
        if peak > highest:
            highest = peak
            out[:] = trial


@compiled
def simulate_all(springs, which, tables, law, states, out) -> IntArray:
    """Fill in states and drive forces of all springs [N], shape (springs, sides, n + 1).

    Returns the repetitions until each is periodic, 0 where none is.
    """
    passes = np.zeros(len(springs), np.int64)
    for i in range(len(springs)):
        k, spring = which[i], Spring(springs[i, 0], springs[i, 1], springs[i, 2])
        table = TravelTable(tables.forces[k], tables.shares[k], tables.load_shares[k], tables.numbers[k])
        scale = table.forces.max() + spring.mass * np.abs(law.starts).max()
        impedance = math.sqrt(spring.stiffness * spring.mass)
        units = np.array([scale / spring.stiffness, scale / impedance, scale / spring.stiffness])
        state, inverse = states[i, :SIZE], states[i, SIZE:].reshape(3, 3)
        passes[i] = _close(spring, table, law, units, state, inverse, out[i])
        if passes[i] == 0:
            inverse[:] = 0.0
            _unsettled(spring, table, law, state, out[i])
    return passes
