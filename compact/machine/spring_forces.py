"""Forces on a cart behind a spring, for compiled code: resistance along the stroke, guides, drive and end springs.

    R = g_h(s) F(v) + guide friction

s is the travel since the last turn, and g_h the share of the force in the heading h. The guide friction follows from
the reactions of both guide wheels, linear in the load share and in the force of the mix. Without shares g = 1, and
the tables contain the guide friction. The memory of the turns is that of `compact.turning`; places are xi = h x in the
sense of the heading.

Each `SmoothRange` is part of R that is smooth; beyond it R is continued smoothly.
"""

import math
from typing import NamedTuple

import numpy as np

from compact.numerics import Array, IntArray
from compact.numerics.jit import internal
from compact.numerics.piecewise import PiecewisePolynomial

CONTINUATION = 0.5  # [-], of a table piece; its polynomial is continued so far beyond a knot, then by its tangent
NO_ENDS = 1e300  # [m], a place that is never met
TABLES = 5  # [-], of a `SpringCart`
FORCE, FORWARD = 0, 1  # and the shares: forward force and load, backward force and load
DISTANCE, RELEASE, TRACK = 0, 1, 2  # columns of `turns`; TRACK + 1 is the share of the load on the own track
NEAR_SPRING, FAR_SPRING = 1.0, -1.0  # zones; the cart compresses an end spring, 0 between the springs
AT_NEAR_PLATE, AT_FAR_PLATE = 2.0, -2.0  # zones; the cart is at rest at the plate of an end spring
# indices of a `CartState`; front and origin of the backward heading follow those of the forward heading
ELONGATION, VELOCITY, FLANK, ZONE, TURN, HEADING, FRONT, ORIGIN = range(8)
RELEASED = 10  # followed by that of the load


class SpringCart(NamedTuple):
    """Cart on its drive spring, with its resistance as tables.

    Parameters
    ----------
    mass, stiffness, damping, backlash : float
        m [kg], k [N/m] and c [N s/m] of the drive, and play between the flanks [m].
    end_stiffness, end_preload, end_length, stroke : float
        Of the end springs [N/m], [N], [m] (0 without springs), and stroke [m].
    force_scale, tolerance : float
        Largest force of inertia and resistance, and largest defect of a step [N].
    knots : ndarray, shape (n,)
        Speeds |v| > 0 [m/s] at which F is not smooth.
    pieces : ndarray, shape (n, 2 + terms)
        Ends and coefficients of the pieces of all tables: F [N] over v [m/s], shares [-] over s [m].
    firsts : ndarray, shape (TABLES + 1,)
        Rows at which the tables begin and end.
    turns : ndarray, shape (2, 4) or (0, 4)
        Distance and release [m], shares of force and load on the own track [-], forward and backward; none for g = 1.
    places : ndarray, shape (2, n)
        Travels [m] at which a share is not smooth, forward and backward, padded by infinity.
    wheels : ndarray, shape (2, 2, 3)
        Friction of both guide wheels, forward and backward [N]: constant, over the load share, over the force [-].
    ratios : ndarray, shape (2,)
        Force at rest and load of the backward over those of the forward heading [-].
    """

    mass: float
    stiffness: float
    damping: float
    backlash: float = 0.0
    end_stiffness: float = 0.0
    end_preload: float = 0.0
    end_length: float = 0.0
    stroke: float = 0.0
    force_scale: float = 1.0
    tolerance: float = 1e-9
    knots: Array = np.empty(0)
    pieces: Array = np.empty((0, 2))
    firsts: IntArray = np.zeros(TABLES + 1, np.int64)
    turns: Array = np.empty((0, 4))
    places: Array = np.empty((2, 0))
    wheels: Array = np.zeros((2, 2, 3))
    ratios: Array = np.ones(2)

    def with_tables(self, *tables: PiecewisePolynomial) -> "SpringCart":
        """Cart with other tables: F and the shares of force and load, forward and backward."""
        terms = max(table.coefficients.shape[1] for table in tables)
        pieces = [
            np.column_stack([
                table.breaks[:-1], table.breaks[1:],
                np.pad(table.coefficients, ((0, 0), (0, terms - table.coefficients.shape[1]))),
            ])
            for table in tables
        ]  # fmt: skip
        firsts = np.cumsum([0, *map(len, pieces)] + [0] * (TABLES - len(pieces)))
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
    forward_front, forward_origin, backward_front, backward_origin : float
        Front of the rolled mix and origin of the travel in the sense of each heading [m].
    released, load_released : float
        Amounts that the release takes from the shares of force and load at the last turn [-].
    """

    elongation: float
    velocity: float
    flank: int
    zone: int = 0
    turn: float = 0.0
    heading: int = -1
    forward_front: float = 0.0
    forward_origin: float = 0.0
    backward_front: float = 0.0
    backward_origin: float = 0.0
    released: float = 0.0
    load_released: float = 0.0


class Memory(NamedTuple):
    """Memory of a cart in one heading: places xi = h x [m] of front, origin and turn; amounts of the release [-]."""

    front: float
    origin: float
    turn: float
    released: tuple[float, float]


class SmoothRange(NamedTuple):
    """Part of the resistance that is smooth.

    Parameters
    ----------
    slip, low, high : float
        Direction, limits of v [m/s].
    travelled, farthest : float
        Limits of the abscissa of the shares [m].
    offset, gap : float
        Abscissa of the shares at the turn, and travel to the front ahead [m]; gap 0 on fresh mix.
    event : float
        Travel s at which the range ends [m].
    at_front, released : tuple of float
        Shares of force and load at the front ahead, and amounts of the release [-].
    signs : ndarray
        Signs of the reactions of front and rear wheel, shape (2,).
    """

    slip: float
    low: float
    high: float
    travelled: float
    farthest: float
    offset: float
    gap: float
    event: float
    at_front: tuple[float, float]
    released: tuple[float, float]
    signs: Array


@internal
def table_value(rows, i, end, abscissa, low, high) -> tuple[float, float]:
    """Return value and slope of the table in rows from i to an end, continued smoothly beyond low and high."""
    place = abscissa if abscissa > low else low
    while end - i > 1:
        middle = (i + end) // 2
        if rows[middle, 0] <= place and rows[middle, 0] < high:
            i = middle
        else:
            end = middle
    width = rows[i, 1] - rows[i, 0]
    u, value, slope = (abscissa - rows[i, 0]) / width, 0.0, 0.0
    inside = -CONTINUATION if u < -CONTINUATION else 1 + CONTINUATION if u > 1 + CONTINUATION else u
    for j in range(rows.shape[1] - 1, 1, -1):
        slope = slope * inside + value
        value = value * inside + rows[i, j]
    return value + slope * (u - inside), slope / width


@internal
def _fading(travel, length):
    """Value and slope of exp(travel/length), with its tangent from `CONTINUATION` on; 0 for no length."""
    if length == 0:
        return 0.0, 0.0
    u = travel / length
    value = math.exp(u if u < CONTINUATION else CONTINUATION)
    return value + (value * (u - CONTINUATION) if u > CONTINUATION else 0.0), value / length


@internal
def shares_of(cart, within, travel) -> tuple[float, float, float, float]:
    """Return the share of the force at a travel since the turn and its slope [1/m], and those of the load."""
    row = 0 if within.slip > 0 else 1
    release, track, load_track = cart.turns[row, RELEASE], cart.turns[row, TRACK], cart.turns[row, TRACK + 1]
    if within.gap > 0:
        value, slope = _fading(travel - within.gap, release)
        rise, load_rise = within.at_front[0] - track, within.at_front[1] - load_track
        share, steepness = track + rise * value, rise * slope
        load, change = load_track + load_rise * value, load_rise * slope
    else:
        i, place, low, high = FORWARD + 2 * row, travel + within.offset, within.travelled, within.farthest
        share, steepness = table_value(cart.pieces, cart.firsts[i], cart.firsts[i + 1], place, low, high)
        load, change = table_value(cart.pieces, cart.firsts[i + 1], cart.firsts[i + 2], place, low, high)
    if within.released[0] != 0 or within.released[1] != 0:
        value, slope = _fading(-travel, release)
        share, steepness = share - within.released[0] * value, steepness + within.released[0] * slope
        load, change = load - within.released[1] * value, change + within.released[1] * slope
    return share, steepness, load, change


@internal
def force_of_mix(cart, within, velocity) -> tuple[float, float]:
    """Return F [N] and its slope [N s/m], continued beyond a smooth range."""
    first, end = cart.firsts[FORCE], cart.firsts[FORCE + 1]
    return table_value(cart.pieces, first, end, velocity, within.low, within.high)


@internal
def resistance(cart, within, velocity, travel) -> tuple[float, float, float, float, float, float]:
    """Return R [N], dR/dv [N s/m] and dR/dx [N/m], continued beyond a smooth range, and of the mix force and shares."""
    force, damping = force_of_mix(cart, within, velocity)
    if len(cart.turns) == 0:
        return force, damping, 0.0, force, 1.0, 1.0
    share, steepness, load, rise = shares_of(cart, within, travel)
    row, slip, gain, friction, over_load = 0 if within.slip > 0 else 1, within.slip, 1.0, 0.0, 0.0
    for i in range(2):
        sign = slip * within.signs[i]
        gain += sign * cart.wheels[row, i, 2]
        over_load += sign * cart.wheels[row, i, 1]
        friction += sign * cart.wheels[row, i, 0]
    total = gain * share * force + over_load * load + friction
    slope = slip * (gain * steepness * force + over_load * rise)
    return total, gain * share * damping, slope, share * force, share, load


@internal
def wheel_friction(cart, within, force, load) -> tuple[float, float]:
    """Return the friction of both guide wheels [N] by force [N] and load share of the mix, with their signs."""
    row = 0 if within.slip > 0 else 1
    front, rear = cart.wheels[row, 0], cart.wheels[row, 1]
    return front[0] + front[1] * load + front[2] * force, rear[0] + rear[1] * load + rear[2] * force


# memory of the turns


@internal
def _first_part(cart, row, k, memory, place):
    """Share before the release at a place xi [m] in a heading."""
    i = FORWARD + 2 * row + k
    first, end, beyond = cart.firsts[i], cart.firsts[i + 1], place >= memory.front
    at = place if beyond else memory.front
    value = table_value(cart.pieces, first, end, at - memory.origin, at - memory.origin, NO_ENDS)[0]
    if beyond:
        return value
    track = cart.turns[row, TRACK + k]
    return track + (value - track) * _fading(place - memory.front, cart.turns[row, RELEASE])[0]


@internal
def _memory(cart, state, slip, position):
    """Memory for a motion that continues the last heading, or turns at a position [m]."""
    row, heading = 0 if slip > 0 else 1, state[HEADING]
    front, origin = state[FRONT + 2 * row], state[ORIGIN + 2 * row]
    released = state[RELEASED], state[RELEASED + 1]
    memory = Memory(front, origin, slip * state[TURN], released)
    if slip == heading or len(cart.turns) == 0:
        return memory
    place, other, last = slip * position, 1 - row, heading * position
    if front - place > cart.turns[row, DISTANCE]:  # the sleeve has laid fresh mix
        front, origin = place + cart.turns[row, DISTANCE], place
    memory = Memory(front, origin, place, (0.0, 0.0))
    if cart.turns[row, RELEASE] == 0:
        return memory
    before = Memory(state[FRONT + 2 * other], state[ORIGIN + 2 * other], heading * state[TURN], released)
    fading = _fading(before.turn - last, cart.turns[other, RELEASE])[0]
    force = _first_part(cart, other, 0, before, last) - released[0] * fading
    load = _first_part(cart, other, 1, before, last) - released[1] * fading
    if cart.ratios[0] > 0:  # neither force nor load jumps
        force *= cart.ratios[0] if slip > 0 else 1 / cart.ratios[0]
    if cart.ratios[1] > 0:
        load *= cart.ratios[1] if slip > 0 else 1 / cart.ratios[1]
    first, first_load = _first_part(cart, row, 0, memory, place), _first_part(cart, row, 1, memory, place)
    return Memory(front, origin, place, (first + force, first_load - load))


@internal
def turn(cart, state, slip, position) -> None:
    """Update a state whose cart turns at a position [m] into a direction."""
    if len(cart.turns) > 0:
        row, old = (0, 1) if slip > 0 else (1, 0)
        memory, reached = _memory(cart, state, slip, position), -slip * position
        if reached > state[FRONT + 2 * old]:
            state[FRONT + 2 * old] = reached
        state[FRONT + 2 * row], state[ORIGIN + 2 * row] = memory.front, memory.origin
        state[RELEASED], state[RELEASED + 1] = memory.released
    state[HEADING], state[TURN] = slip, position


# smooth parts


@internal
def smooth_range(cart, state, slip, velocity, position) -> tuple[SmoothRange, float]:
    """Return the smooth range of a cart that slides, and its travel since the turn [m]."""
    speed, low, high = slip * velocity, 0.0, np.inf
    for knot in cart.knots:
        if knot <= speed:
            low = knot
        elif knot < high:
            high = knot
    if slip < 0:
        low, high = -high, -low
    travel, travelled, farthest, offset, gap, event = 0.0, 0.0, np.inf, 0.0, 0.0, np.inf
    at_front, released, wheels = (1.0, 1.0), (0.0, 0.0), len(cart.turns) > 0 and slip != 0
    if wheels:
        row, memory = 0 if slip > 0 else 1, _memory(cart, state, slip, position)
        travel, offset, gap = slip * position - memory.turn, memory.turn - memory.origin, memory.front - memory.turn
        released = memory.released
        if travel < gap:
            event, front = gap, memory.front
            at_front = _first_part(cart, row, 0, memory, front), _first_part(cart, row, 1, memory, front)
        else:
            gap = 0.0
            for each in cart.places[row]:
                if each - offset <= travel:
                    travelled = each
                elif each < farthest:
                    farthest = each
            event = farthest - offset
    signs = np.ones(2)
    within = SmoothRange(slip, low, high, travelled, farthest, offset, gap, event, at_front, released, signs)
    if wheels:
        _, _, _, force, _, load = resistance(cart, within, velocity, travel)
        front, rear = wheel_friction(cart, within, force, load)
        signs[0], signs[1] = 1.0 if front >= 0 else -1.0, 1.0 if rear >= 0 else -1.0
    return within, travel


@internal
def pull_on_cart(cart, flank, zone, y, e, rate) -> tuple[float, float]:
    """Return the pull of drive spring, damper and end springs [N], and its slope over e."""
    stiffness, end_stiffness = cart.stiffness if flank != 0 else 0.0, 0.0
    constant = -stiffness * flank * cart.backlash / 2
    if abs(zone) == NEAR_SPRING:
        end_stiffness, force = cart.end_stiffness, cart.end_preload + cart.end_stiffness * cart.end_length
        constant += force if zone == NEAR_SPRING else cart.end_stiffness * cart.stroke - force
        stiffness += end_stiffness
    return stiffness * e - end_stiffness * y + constant + cart.damping * rate, stiffness


@internal
def stiction_limits(cart, state, position, zone) -> tuple[float, float]:
    """Return the smallest and largest pull [N] that holds a cart at rest."""
    low = high = 0.0
    for i in range(2):
        within, travel = smooth_range(cart, state, 2.0 * i - 1, 0.0, position)
        low, high = high, resistance(cart, within, 0.0, travel)[0]
    if zone == AT_NEAR_PLATE:
        low -= cart.end_preload
    if zone == AT_FAR_PLATE:
        high += cart.end_preload
    return low, high
