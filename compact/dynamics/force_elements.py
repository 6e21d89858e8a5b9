"""Forces on a cart behind a drive spring: resistance tables, drive spring with backlash, damper and end springs.

The resistance is tabulated over speed and follows the acceleration up to a limit A |v|:

    R(v, a) = F(v) + a' M(|v|),   a' = a for |a| <= A |v|,   a' = A |v| sign(a) beyond

F jumps at v = 0 and has one table for each direction. M is the added mass of a resistance that depends to first order
on the acceleration; the expansion does not hold beyond A |v|, where the term is saturated.

Drive and end springs pull the cart by

    H + S = k (e - o) + c e' + S(x),   e = y - x
    S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between

with the driven end y, the cart x, the elongation e and the engaged half o of the backlash. Because of the preload P, S
is discontinuous at the plate of an end spring; a cart at rest there is held by any force from 0 to P.

All functions are compiled. Arrays and records are passed without checks.
"""

from typing import NamedTuple

import numpy as np

from compact.numerics import Array
from compact.numerics.jit import compiled
from compact.numerics.piecewise import PiecewisePolynomial

KNOT_TOLERANCE = 1e-6  # [-], of a speed or of an interval; a motion so close to a knot is on it
EXTRAPOLATION_LENGTH = 0.5  # [-], of a table piece; its polynomial is continued so far beyond a knot
STICTION_TOLERANCE = 1e-12  # [-], of the width of the stiction range; rounding of the pull
UNDETERMINED_SATURATION = 2  # marker; the motion itself determines the saturation, distinct from -1, 0 and 1
NEAR_SPRING, FAR_SPRING = 1, -1  # zones; the cart compresses an end spring, 0 between the springs
AT_NEAR_PLATE, AT_FAR_PLATE = 2, -2  # zones; the cart is at rest at the plate of an end spring
NO_ADDED_MASS = PiecewisePolynomial(np.array([0.0, 1.0]), np.zeros((1, 1)))


class ResistanceTable(NamedTuple):
    """Resistance of a cart as polynomials of the speed.

    Parameters
    ----------
    forward, backward : PiecewisePolynomial
        F [N] over |v| [m/s] from 0, for v > 0 and for v < 0.
    knots : ndarray, shape (n,)
        Speeds |v| [m/s] at which F is not smooth.
    added_mass : PiecewisePolynomial
        M [kg] over |v| [m/s] from 0.
    rate_limit : float
        Limit A of |a|/|v| [1/s] for the added-mass term; 0 without added mass.
    """

    forward: PiecewisePolynomial
    backward: PiecewisePolynomial
    knots: Array
    added_mass: PiecewisePolynomial = NO_ADDED_MASS
    rate_limit: float = 0.0


class SmoothRange(NamedTuple):
    """Range of motions in which R is smooth.

    Parameters
    ----------
    low, high : float
        Limits of |v| [m/s].
    saturation : int
        0 where the added-mass term follows the acceleration, the sign of the saturated term otherwise, or
        `UNDETERMINED_SATURATION`.
    """

    low: float
    high: float
    saturation: int


FULL_RANGE = SmoothRange(0.0, np.inf, UNDETERMINED_SATURATION)


@compiled
def smooth_range(resistance: ResistanceTable, slip: int, velocity: float, acceleration: float) -> SmoothRange:
    """Smooth range that a motion enters; slip is the sign of the motion.

    Parameters
    ----------
    resistance : ResistanceTable
        Resistance of the mix.
    slip : int
        Direction of the motion, +1 or -1.
    velocity : float
        Velocity of the cart [m/s].
    acceleration : float
        Acceleration of the cart [m/s^2].

    Returns
    -------
    SmoothRange
    """
    knots, speed = resistance.knots, slip * velocity
    margin = 1 + KNOT_TOLERANCE if slip * acceleration > 0 else 1 - KNOT_TOLERANCE
    k = np.searchsorted(knots, speed * margin, side="right")
    limited = resistance.rate_limit > 0
    saturation = saturation_sign(resistance.rate_limit, slip, speed, acceleration) if limited else 0
    return SmoothRange(knots[k - 1] if k > 0 else 0.0, knots[k] if k < len(knots) else np.inf, saturation)


@compiled
def saturation_sign(rate_limit: float, slip: int, speed: float, acceleration: float) -> int:
    """Sign of the saturated added-mass term, 0 within the limit.

    Parameters
    ----------
    rate_limit : float
        Limit A of |a|/|v| [1/s].
    slip : int
        Direction of the motion, +1 or -1.
    speed : float
        Speed |v| [m/s].
    acceleration : float
        Acceleration of the cart [m/s^2].

    Returns
    -------
    int
        Sign of the saturated term, or 0.
    """
    if rate_limit == np.inf or abs(acceleration) < rate_limit * speed:
        return 0
    return slip if acceleration == 0 else 1 if acceleration > 0 else -1  # at rest the cart accelerates with its slip


@compiled
def evaluate_table(table: PiecewisePolynomial, speed: float, within: SmoothRange) -> tuple[float, float]:
    """Value and slope of a table, continued beyond a smooth range.

    The outermost piece is continued by `EXTRAPOLATION_LENGTH` and by its tangent beyond; below the range the slope is
    the secant from rest, since the polynomial of a narrow piece would amplify rounding. Beyond its own ends the table
    is continued by its tangent.
    """
    breaks, rows = table.breaks, table.coefficients
    i, end = 0, len(breaks) - 1
    while end - i > 1:
        middle = (i + end) // 2
        if breaks[middle] <= max(speed, within.low) and breaks[middle] < within.high:
            i = middle
        else:
            end = middle
    width = breaks[i + 1] - breaks[i]
    u, value, slope = (speed - breaks[i]) / width, 0.0, 0.0
    lowest = -EXTRAPOLATION_LENGTH if within.low > 0 else 0.0
    inside = min(max(u, lowest), 1 + EXTRAPOLATION_LENGTH if within.high < np.inf else 1.0)
    for j in range(rows.shape[1] - 1, -1, -1):
        slope = slope * inside + value
        value = value * inside + rows[i, j]
    if u < inside and within.low > 0:
        slope = (rows[i, 0] - rows[0, 0]) / within.low * width
    return value + slope * (u - inside), slope / width


@compiled
def steady_force(resistance: ResistanceTable, slip: int, velocity: float) -> float:
    """Return F [N] at a velocity [m/s], as the limit from the side of the slip.

    Parameters
    ----------
    resistance : ResistanceTable
        Resistance of the mix.
    slip : int
        Direction of the motion, +1 or -1.
    velocity : float
        Velocity of the cart [m/s].

    Returns
    -------
    float
        F [N].
    """
    return evaluate_table(resistance.forward if slip > 0 else resistance.backward, slip * velocity, FULL_RANGE)[0]


@compiled
def differentiate_resistance(
    table: PiecewisePolynomial,
    added_mass: PiecewisePolynomial,
    rate_limit: float,
    slip: int,
    velocity: float,
    acceleration: float,
    within: SmoothRange,
) -> tuple[float, float, float]:
    """Return R [N], dR/dv [N s/m] and dR/da [kg], continued beyond a smooth range; table is F for the slip.

    Parameters
    ----------
    table : PiecewisePolynomial
        F for the slip [N] over |v|.
    added_mass : PiecewisePolynomial
        M [kg] over |v|.
    rate_limit : float
        Limit A of |a|/|v| [1/s].
    slip : int
        Direction of the motion, +1 or -1.
    velocity : float
        Velocity of the cart [m/s].
    acceleration : float
        Acceleration of the cart [m/s^2].
    within : SmoothRange
        Range whose polynomials are continued.

    Returns
    -------
    tuple of float
        R [N], dR/dv [N s/m] and dR/da [kg].
    """
    speed = slip * velocity
    force, slope = evaluate_table(table, speed, within)
    if rate_limit == 0:
        return force, slip * slope, 0.0
    mass, mass_slope = evaluate_table(added_mass, speed, within)
    saturation = within.saturation
    if saturation == UNDETERMINED_SATURATION:
        saturation = saturation_sign(rate_limit, slip, speed, acceleration)
    if saturation == 0:
        return force + mass * acceleration, slip * (slope + mass_slope * acceleration), mass
    damping = slip * (slope + saturation * rate_limit * (mass + mass_slope * speed))
    return force + saturation * mass * rate_limit * speed, damping, 0.0


@compiled
def solve_acceleration(resistance: ResistanceTable, slip: int, velocity: float, mass: float, force: float) -> float:
    """Acceleration a [m/s^2] with m a + R(v, a) = force, for m + M > 0.

    Parameters
    ----------
    resistance : ResistanceTable
        Resistance of the mix.
    slip : int
        Direction of the motion, +1 or -1.
    velocity : float
        Velocity of the cart [m/s].
    mass : float
        Mass m [kg].
    force : float
        Sum of the other forces on the cart [N].

    Returns
    -------
    float
        a [m/s^2].
    """
    net = force - steady_force(resistance, slip, velocity)
    if resistance.rate_limit == 0:
        return net / mass
    added = evaluate_table(resistance.added_mass, slip * velocity, FULL_RANGE)[0]
    a = net / (mass + added)
    limit = np.inf if resistance.rate_limit == np.inf else resistance.rate_limit * slip * velocity
    return a if abs(a) < limit else (net - np.sign(net) * added * limit) / mass


class EndSpringParameters(NamedTuple):
    """Preloaded end springs: stiffness p [N/m], preload P [N], length l [m] (0 without springs), stroke h [m]."""

    stiffness: float
    preload: float
    length: float
    stroke: float


class OscillatorParameters(NamedTuple):
    """Cart on its drive spring.

    Parameters
    ----------
    mass : float
        m [kg].
    stiffness, damping : float
        k [N/m] and c [N s/m] of the drive.
    backlash : float
        Play between the flanks [m].
    """

    mass: float
    stiffness: float
    damping: float
    backlash: float
    end_springs: EndSpringParameters = EndSpringParameters(0.0, 0.0, 0.0, 0.0)


class CartState(NamedTuple):
    """State of a cart behind a spring.

    Parameters
    ----------
    elongation : float
        e [m] of the drive spring.
    velocity : float
        x' [m/s].
    flank : int
        +1 or -1 in contact with a flank, 0 within the backlash; always +1 without backlash.
    zone : int
        `NEAR_SPRING`, `FAR_SPRING`, `AT_NEAR_PLATE`, `AT_FAR_PLATE`, or 0 between the end springs.
    """

    elongation: float
    velocity: float
    flank: int
    zone: int = 0


class SpringForce(NamedTuple):
    """Force of drive and end springs [N]: stiffness e - driven_end_stiffness y + constant."""

    stiffness: float
    driven_end_stiffness: float
    constant: float


@compiled
def engaged_spring(oscillator: OscillatorParameters, flank: int) -> tuple[float, float]:
    """Stiffness [N/m] and offset o [m] of the drive spring on a flank."""
    return (0.0, 0.0) if flank == 0 else (oscillator.stiffness, flank * oscillator.backlash / 2)


@compiled
def spring_force(oscillator: OscillatorParameters, flank: int, zone: int) -> SpringForce:
    """Force of drive and end springs on a flank and in a zone.

    Parameters
    ----------
    oscillator : OscillatorParameters
        Cart on its drive spring.
    flank : int
        Flank in contact, as of `CartState`.
    zone : int
        Zone, as of `CartState`.

    Returns
    -------
    SpringForce
    """
    stiffness, offset = engaged_spring(oscillator, flank)
    if abs(zone) != NEAR_SPRING:
        return SpringForce(stiffness, 0.0, -stiffness * offset)
    ends = oscillator.end_springs
    end_force = ends.preload + ends.stiffness * ends.length
    force = end_force if zone == NEAR_SPRING else ends.stiffness * ends.stroke - end_force
    return SpringForce(stiffness + ends.stiffness, ends.stiffness, force - stiffness * offset)


@compiled
def stiction_limits(oscillator: OscillatorParameters, resistance: ResistanceTable, zone: int) -> tuple[float, float]:
    """Largest and smallest pull [N] under which a cart at rest stays at rest.

    Parameters
    ----------
    oscillator : OscillatorParameters
        Cart on its drive spring.
    resistance : ResistanceTable
        Resistance of the mix.
    zone : int
        Zone, as of `CartState`.

    Returns
    -------
    tuple of float
        Largest and smallest pull [N].
    """
    highest, lowest = steady_force(resistance, 1, 0.0), steady_force(resistance, -1, 0.0)
    if zone == AT_NEAR_PLATE:
        lowest -= oscillator.end_springs.preload
    if zone == AT_FAR_PLATE:
        highest += oscillator.end_springs.preload
    return highest, lowest


@compiled
def breakaway_direction(oscillator: OscillatorParameters, resistance: ResistanceTable, zone: int, pull: float) -> int:
    """Direction in which a cart at rest starts under a pull [N], 0 where friction or a plate holds it.

    Parameters
    ----------
    oscillator : OscillatorParameters
        Cart on its drive spring.
    resistance : ResistanceTable
        Resistance of the mix.
    zone : int
        Zone, as of `CartState`.
    pull : float
        Force of the springs and the damper [N].

    Returns
    -------
    int
        +1, -1, or 0 at rest.
    """
    highest, lowest = stiction_limits(oscillator, resistance, zone)
    tolerance = STICTION_TOLERANCE * (highest - lowest)
    return 1 if pull > highest + tolerance else -1 if pull < lowest - tolerance else 0
