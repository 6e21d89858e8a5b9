"""What pulls on a cart between a far end and the ends of its stroke: drive spring with backlash, damper, end springs.

    pull = k (e - o) + c e' + S(x),   e = y - x
    S = P + p (l - x) for x < l,   -(P + p (x - h + l)) for x > h - l,   0 between

y is the far end, x the cart, e the stretch, o the half of the backlash that is taken up. The preload P makes S jump
where the cart meets the plate of an end spring; a cart that stands there is held by any push from 0 to P.
"""

from typing import NamedTuple

from compact import resisted, ringing
from compact.resisted import met
from compact.ringing import compiling

SLACK = 1e-12  # share of the friction by which a standing cart may be overpulled: rounding
NEAR, FAR = 1, -1  # zones: on an end spring; 0 between
AT_NEAR, AT_FAR = 2, -2  # standing where an end spring begins

compiled = compiling(__file__, resisted.__file__, ringing.__file__)


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


class State(NamedTuple):
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
