"""What the mix and the guides put up against a cart, for compiled code: tables over speed and acceleration.

    R(v, a) = F(v) + a' M(|v|),   a' = a while |a| <= A |v|, else A |v| sign(a)

F jumps at v = 0 and has a table for each way. M follows the resistance of a mix with a memory at first order; beyond
A |v| that order is void and the second term stays as it is there (`resistance`).

What pulls on a cart between a far end and the ends of its stroke: drive spring with backlash, damper, end springs.

    pull = k (e - o) + c e' + S(x),   e = y - x
    S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between

y is the far end, x the cart, e the stretch, o the half of the backlash that is taken up. The preload P makes S jump
where the cart meets the plate of an end spring; a cart that stands there is held by any push from 0 to P.
"""

from typing import NamedTuple

import numpy as np

from compact.numerics.jit import compiled
from compact.numerics.piecewise import PiecewisePolynomial

AT = 1e-6  # of a speed, or of an arc: so near a knot a motion is at it
FARTHER = 0.5  # of a piece of a table, for which it goes on as it is beyond a knot
EITHER = 2  # neither 0 nor a sign
NONE = PiecewisePolynomial(np.array([0.0, 1.0]), np.zeros((1, 1)))


class Resistance(NamedTuple):
    """F [N] over |v| [m/s] on the way there and on the way back, `PiecewisePolynomial` from 0; knots: |v| where F is not smooth;
    added: M [kg] over |v|, `PiecewisePolynomial` from 0; pace: A [1/s], 0 where there is no M."""

    there: PiecewisePolynomial
    back: PiecewisePolynomial
    knots: np.ndarray
    added: PiecewisePolynomial = NONE
    pace: float = 0.0


class Section(NamedTuple):
    """Where R is smooth, to be taken beyond as it is within: |v| from low to high [m/s]; held: the sign with which the
    second term stays as it is at A |v|, 0 where it follows the acceleration, EITHER as a motion has it."""

    low: float
    high: float
    held: int


WHOLE = Section(0.0, np.inf, EITHER)


@compiled
def section(resistance, slip, velocity, acceleration):
    """The `Section` into which a motion goes."""
    knots, speed = resistance.knots, slip * velocity
    k = np.searchsorted(knots, speed * (1 + AT if slip * acceleration > 0 else 1 - AT), side="right")
    held = which(resistance.pace, slip, speed, acceleration) if resistance.pace > 0 else 0
    return Section(knots[k - 1] if k > 0 else 0.0, knots[k] if k < len(knots) else np.inf, held)


@compiled
def which(pace, slip, speed, acceleration):
    """0 while the second term follows the acceleration, else the sign with which it does not."""
    if pace == np.inf or abs(acceleration) < pace * speed:
        return 0
    return slip if acceleration == 0 else 1 if acceleration > 0 else -1  # a cart sets off with its slip


@compiled
def looked_up(table, speed, within):
    """Value and slope of `PiecewisePolynomial` as they are within a `Section`.

    Beyond it the outermost piece goes on for a while, and then straight: from below as from rest to the section, so
    that rounding in a narrow piece does not grow. Beyond their ends the pieces go on straight at once.
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
    u, found, slope = (speed - breaks[i]) / width, 0.0, 0.0
    inside = min(max(u, -FARTHER if within.low > 0 else 0.0), 1 + FARTHER if within.high < np.inf else 1.0)
    for j in range(rows.shape[1] - 1, -1, -1):
        slope = slope * inside + found
        found = found * inside + rows[i, j]
    if u < inside and within.low > 0:
        slope = (rows[i, 0] - rows[0, 0]) / within.low * width
    return found + slope * (u - inside), slope / width


@compiled
def met(resistance, slip, velocity):
    """F and dF/dv at a velocity, seen from the side of `slip`."""
    force, rise = looked_up(resistance.there if slip > 0 else resistance.back, slip * velocity, WHOLE)
    return force, slip * rise


@compiled
def opposed(table, added, pace, slip, velocity, acceleration, within):
    """R, dR/dv and dR/da by the table of F on the side of `slip`, as within a `Section`."""
    speed = slip * velocity
    force, rise = looked_up(table, speed, within)
    if pace == 0:
        return force, slip * rise, 0.0
    mass, grows = looked_up(added, speed, within)
    held = which(pace, slip, speed, acceleration) if within.held == EITHER else within.held
    if held == 0:
        return force + mass * acceleration, slip * (rise + grows * acceleration), mass
    return force + held * mass * pace * speed, slip * (rise + held * pace * (mass + grows * speed)), 0.0


@compiled
def accelerated(resistance, slip, velocity, mass, force):
    """The acceleration a of m a + R(v, a) = force, m + M > 0."""
    push = force - met(resistance, slip, velocity)[0]
    if resistance.pace == 0:
        return push / mass
    added = looked_up(resistance.added, slip * velocity, WHOLE)[0]
    a = push / (mass + added)
    most = np.inf if resistance.pace == np.inf else resistance.pace * slip * velocity
    return a if abs(a) < most else (push - np.sign(push) * added * most) / mass


SLACK = 1e-12  # share of the friction by which a standing cart may be overpulled: rounding
NEAR, FAR = 1, -1  # zones: on an end spring; 0 between
AT_NEAR, AT_FAR = 2, -2  # standing where an end spring begins


class Ends(NamedTuple):
    """End springs: stiffness p [N/m], preload P [N], length l [m], 0 without; stroke h [m]."""

    stiffness: float
    preload: float
    length: float
    stroke: float


class Spring(NamedTuple):
    """mass [kg], stiffness k [N/m], damping c [N s/m], backlash: play between the flanks [m], and the `Ends`."""

    mass: float
    stiffness: float
    damping: float
    backlash: float
    ends: Ends = Ends(0.0, 0.0, 0.0, 0.0)


class CartState(NamedTuple):
    """stretch e [m], velocity x' [m/s], side: +1 and -1 on a flank, 0 in the backlash, always +1 without one; zone."""

    stretch: float
    velocity: float
    side: int
    zone: int = 0


class Hold(NamedTuple):
    """The pull but for the damper's: stiffness e - along y + constant."""

    stiffness: float
    along: float
    constant: float


@compiled
def engaged(spring, side):
    """Stiffness and offset o of the drive spring on a side of the backlash."""
    return (0.0, 0.0) if side == 0 else (spring.stiffness, side * spring.backlash / 2)


@compiled
def hold(spring, side, zone):
    """`Hold` on a side of the backlash and in a zone of the end springs."""
    stiffness, offset = engaged(spring, side)
    if abs(zone) != NEAR:
        return Hold(stiffness, 0.0, -stiffness * offset)
    ends = spring.ends
    pushed = ends.preload + ends.stiffness * ends.length
    push = pushed if zone == NEAR else ends.stiffness * ends.stroke - pushed
    return Hold(stiffness + ends.stiffness, ends.stiffness, push - stiffness * offset)


@compiled
def limits(spring, resistance, zone):
    """Largest and least pull [N] that moves no standing cart."""
    most, least = met(resistance, 1, 0.0)[0], met(resistance, -1, 0.0)[0]
    if zone == AT_NEAR:
        least -= spring.ends.preload
    if zone == AT_FAR:
        most += spring.ends.preload
    return most, least


@compiled
def direction(spring, resistance, zone, pull):
    """Which way a standing cart goes under a pull [N]: 0 where friction, or a plate, holds it."""
    most, least = limits(spring, resistance, zone)
    slack = SLACK * (most - least)
    return 1 if pull > most + slack else -1 if pull < least - slack else 0
