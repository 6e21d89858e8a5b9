"""What the mix and the guides put up against a cart, for compiled code: tables over speed and acceleration.

    R(v, a, t) = F(v) + a' M(|v|) + D(t),   a' = a while |a| <= A |v|, else A |v| sign(a)

F jumps at v = 0 and has a table for each way. M follows the resistance of a mix with a memory at first order; beyond
A |v| that order is void and the second term stays as it is there (`resistance`). D is a force of time that is known
beforehand, such as what the mix remembers of the way up to now (`sprung_memory`).
"""

from typing import NamedTuple

import numpy as np

from compact import ringing
from compact.polynomials import Pieces
from compact.ringing import compiling

NONE = Pieces(np.array([0.0, 1.0]), np.zeros((1, 1)))
NOTHING_GIVEN = np.zeros((3, 2))
THERE, BACK, MIX = range(3)  # rows of what is given

compiled = compiling(__file__, ringing.__file__)


class Resistance(NamedTuple):
    """F [N] over |v| [m/s] on the way there and on the way back, `Pieces` from 0; knots: |v| where F is not smooth;
    added: M [kg] over |v|, `Pieces` from 0; pace: A [1/s], 0 where there is no M; given: D at the start of a law [N]
    and its rise [N/s], rows: on the way there, on the way back, and the mix's own share of both."""

    there: Pieces
    back: Pieces
    knots: np.ndarray
    added: Pieces = NONE
    pace: float = 0.0
    given: np.ndarray = NOTHING_GIVEN


@compiled
def later(resistance, after):
    """The same, some time [s] after."""
    there, back, knots, added, pace, given = resistance
    moved = given.copy()
    moved[:, 0] += after * given[:, 1]
    return Resistance(there, back, knots, added, pace, moved)


@compiled
def facing(slip):
    """Row of what is given on the side of `slip`."""
    return THERE if slip > 0 else BACK


@compiled
def looked_up(table, speed):
    """Value and slope of `Pieces`; beyond their ends they go on straight."""
    breaks = table.breaks
    i = min(max(np.searchsorted(breaks, speed, side="right") - 1, 0), len(breaks) - 2)
    width = breaks[i + 1] - breaks[i]
    p = table.coefficients[i]
    u, found, slope = (speed - breaks[i]) / width, 0.0, 0.0
    inside = min(max(u, 0.0), 1.0)
    for j in range(len(p) - 1, -1, -1):
        slope = slope * inside + found
        found = found * inside + p[j]
    return found + slope * (u - inside), slope / width


@compiled
def met(resistance, slip, velocity):
    """F and dF/dv at a velocity, seen from the side of `slip`."""
    force, rise = looked_up(resistance.there if slip > 0 else resistance.back, slip * velocity)
    return force, slip * rise


@compiled
def opposed(resistance, slip, velocity, acceleration):
    """R, dR/dv and dR/da, seen from the side of `slip`."""
    force, rise = met(resistance, slip, velocity)
    if resistance.pace == 0:
        return force, rise, 0.0
    mass, grows = looked_up(resistance.added, slip * velocity)
    most = np.inf if resistance.pace == np.inf else resistance.pace * slip * velocity
    if abs(acceleration) < most:
        return force + mass * acceleration, rise + slip * grows * acceleration, mass
    sign = np.sign(acceleration) if acceleration != 0 else float(slip)  # a cart sets off with its slip
    return force + sign * mass * most, rise + sign * slip * (resistance.pace * mass + grows * most), 0.0


@compiled
def accelerated(resistance, slip, velocity, mass, force):
    """The acceleration a of m a + R(v, a) = force, m + M > 0."""
    push = force - met(resistance, slip, velocity)[0]
    if resistance.pace == 0:
        return push / mass
    added = looked_up(resistance.added, slip * velocity)[0]
    a = push / (mass + added)
    most = np.inf if resistance.pace == np.inf else resistance.pace * slip * velocity
    return a if abs(a) < most else (push - np.sign(push) * added * most) / mass
