"""Forces on a cart behind a drive spring: drive and end springs, and the resistance with its smooth continuation.

    H + S = k (e - o) + c e' + S(x),   S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between
    R = f + g(s) (F(v) - f + a' M(|v|)),   a' = a for |a| <= L |v|,   a' = L |v| sign(a) beyond

e is the elongation, o the engaged half of the backlash, x the position of the cart, s its travel since the last turn, f
the guide friction without the mix. F jumps at v = 0 and has one table for each direction. M is the added mass of a
resistance that depends to first order on the acceleration; the expansion does not hold beyond L |v|. Because of the
preload P, S jumps at the plate of an end spring; a cart at rest there is held by any force from 0 to P. All functions
are compiled.
"""

from typing import NamedTuple

import numpy as np

from compact.numerics import Array, IntArray
from compact.numerics.jit import internal
from compact.numerics.piecewise import PiecewisePolynomial

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
