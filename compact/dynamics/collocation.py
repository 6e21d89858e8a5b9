"""One arc of a cart that slides behind a spring: how long it may last, and the motion, by collocation.

    (m + M) e'' + (c + d) e' + K e = (m + M) y'' + n y - g + R0 + d (y' - v0) - M a0 + r(t)
    r = R(v, a) - R0 - d (v - v0) - M (a - a0),   d = dR/dv, M = dR/da at the start of the arc

r is made a polynomial by collocation, so that the stretch e is answered exactly (`oscillator`); `dynamics` has the
letters. R is smooth but for its knots: an arc takes R as it is in the `Section` where it starts, also beyond, and ends
where it leaves that section, if it makes a difference. So no arc is tried across a knot, and none is lost there.
"""

from typing import NamedTuple

import numpy as np

from compact.dynamics.force_elements import AT, WHOLE, Section, accelerated, hold, opposed, section
from compact.dynamics.oscillator import (
    Signal,
    combined,
    first_fall,
    respond,
    scaled,
    shifted,
    slope,
    sum_of,
    value,
)
from compact.numerics.jit import compiled

POINTS = 9  # of the collocation, so that the defect falls with the 9th power of the step
CHECKS = 16  # places on an arc where the defect is measured
ITERATIONS = 25  # of the collocation; 1 for dry friction, 2 to 6 are usual
SLOWEST, FASTEST, SAFETY = 0.2, 6.0, 0.9  # of the step control
LEAST = 0.05  # of an arc: the next one, where the cart comes to rest
AHEAD = 1.1  # times the way to an end: an arc that is sure to get there
EARLY = 1e-2  # of an arc: where it starts on the verge of what a M may be, it does not leave its section before
NODES = np.sin(np.pi * np.arange(POINTS) / (2 * (POINTS - 1))) ** 2
EVENLY = np.arange(CHECKS + 1) / CHECKS
TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))


class Line(NamedTuple):
    """R near the start of an arc: R0 + rise (v - v0) + added (a - a0), v0 and a0 its velocity and acceleration; and the
    `Section` where it starts."""

    force: float
    rise: float
    added: float
    velocity: float
    acceleration: float
    section: Section


@compiled
def lined(spring, resistance, state, slip, place, pace):
    """The `Line` of a cart that moves, with the far end at a place [m] and a pace [m/s]."""
    held = hold(spring, state.side, state.zone)
    pull = held.stiffness * state.stretch - held.along * place + held.constant
    pull += spring.damping * (pace - state.velocity)
    a = accelerated(resistance, slip, state.velocity, spring.mass, pull)
    smooth = section(resistance, slip, state.velocity, a)
    table = resistance.there if slip > 0 else resistance.back
    force, rise, added = opposed(table, resistance.added, resistance.pace, slip, state.velocity, a, smooth)
    return Line(force, rise, added, state.velocity, a, smooth)


class Slide(NamedTuple):
    """A motion that was tried over law(u): its stretch, r(u) from its lowest coefficient, and whether it converged."""

    law: np.ndarray
    stretch: Signal
    rest: np.ndarray
    converged: bool
    evaluations: int


@compiled
def slide(spring, resistance, state, slip, line, law, h, tolerance, effort):
    """The `Slide` of at most h [s]: no farther than a little beyond where R leaves its `Section`, if that matters."""
    force = straight(spring, state, line, law, h)
    stretch = answer(spring, state, line, force, law, h)
    share = foreseen(resistance, slip, line, combined(stretch, law, 0.0, -1.0, 0.0, 1.0), tolerance, effort)
    if share < 1:
        law, h = shifted(law, 0.0, share), h * share
        force = straight(spring, state, line, law, h)
        stretch = answer(spring, state, line, force, law, h)
    rest, before = np.zeros(len(law)), np.zeros(POINTS)
    for iteration in range(ITERATIONS):
        speed = combined(stretch, law, 0.0, -1.0, 0.0, 1.0)
        there = beside(resistance, slip, line, speed, NODES, line.section)[1]
        moved = np.abs(there - before).max()
        if not moved < np.inf:
            return Slide(law, stretch, rest, False, (iteration + 1) * POINTS)
        before, rest[:POINTS] = there, TO_COEFFICIENTS @ there
        stretch = answer(spring, state, line, force + rest, law, h)
        if moved <= tolerance / 10:  # what is left falls by as much again
            return Slide(law, stretch, rest, True, (iteration + 1) * POINTS)
    return Slide(law, stretch, rest, False, ITERATIONS * POINTS)


@compiled
def straight(spring, state, line, law, h):
    """Force f(u) [N] on the oscillator of a cart that moves, but for r."""
    held, n = hold(spring, state.side, state.zone), len(law)
    mass, force = spring.mass + line.added, held.along * law
    for j in range(n):
        if j + 2 < n:
            force[j] += mass / h**2 * (j + 1) * (j + 2) * law[j + 2]
        if j + 1 < n:
            force[j] += line.rise / h * (j + 1) * law[j + 1]
    force[0] += line.force - held.constant - line.rise * line.velocity - line.added * line.acceleration
    return force


@compiled
def answer(spring, state, line, force, law, h):
    """The stretch under f(u) as a `Signal`."""
    mass, damping = spring.mass + line.added, spring.damping + line.rise
    stiffness = hold(spring, state.side, state.zone).stiffness
    return respond(mass, damping, stiffness, force, state.stretch, law[1] / h - state.velocity, h)


@compiled
def beside(resistance, slip, line, speed, places, within):
    """Velocities [m/s] and r [N] at places u of a motion whose velocity is a `Signal`, R as within a `Section`."""
    table, added, pace = resistance.there if slip > 0 else resistance.back, resistance.added, resistance.pace
    change, velocity, rest = slope(speed), np.empty(len(places)), np.empty(len(places))
    for i in range(len(places)):
        v = value(speed, places[i])
        a = value(change, places[i]) / speed.span if pace > 0 else 0.0
        force = opposed(table, added, pace, slip, v, a, within)[0]
        straight = line.force + line.rise * (v - line.velocity) + line.added * (a - line.acceleration)
        velocity[i], rest[i] = v, force - straight
    return velocity, rest


@compiled
def foreseen(resistance, slip, line, speed, tolerance, effort):
    """Share of a motion up to a little beyond where R leaves its `Section`, 1 where that makes no difference."""
    velocity, there = beside(resistance, slip, line, speed, NODES, line.section)
    low, high = (slip * velocity).min(), (slip * velocity).max()
    if resistance.pace == 0 and line.section.low <= low and high <= line.section.high:
        return 1.0
    true = beside(resistance, slip, line, speed, NODES, WHOLE)[1]
    for i in range(POINTS):
        if slip * velocity[i] > 0 and abs(true[i] - there[i]) > tolerance:
            return min(1.0, AHEAD * passed(resistance, slip, line, speed, effort))
    return 1.0


@compiled
def passed(resistance, slip, line, speed, effort):
    """The u at which a motion first leaves the `Section` where it starts, 2.0 where it does not."""
    smooth, first = line.section, 2.0
    for way, limit in ((1.0, smooth.low), (-1.0, smooth.high)):
        if 0 < limit < np.inf:
            left = scaled(speed, way * slip)
            left.poly[0] -= way * limit
            u = first_fall(left, effort)
            first = min(first, u if u > AT else 2.0)
    if 0 < resistance.pace < np.inf:
        change, inside = slope(speed), smooth.held == 0
        for sign in (1.0, -1.0):
            if inside or sign == smooth.held:
                spare = sum_of(scaled(speed, slip * resistance.pace), scaled(change, -sign / speed.span))
                u = first_fall(spare if inside else scaled(spare, -1.0), effort)
                first = min(first, u if u > EARLY else 2.0)
    return first


@compiled
def defect(resistance, slip, line, speed, rest, until):
    """Largest miss of r(u) [N] up to u = until, and the largest |v| met."""
    places = until * EVENLY
    velocity, there = beside(resistance, slip, line, speed, places, WHOLE)
    worst, fastest = 0.0, 0.0
    for i in range(len(places)):
        r = 0.0
        for j in range(POINTS - 1, -1, -1):
            r = r * places[i] + rest[j]
        if slip * velocity[i] > 0:
            worst = max(worst, abs(there[i] - r))
        fastest = max(fastest, abs(velocity[i]))
    return worst, fastest


@compiled
def pace_of(worst, tolerance):
    """How many times as long an arc may be for its defect, were R as smooth everywhere."""
    return SAFETY * (tolerance / max(worst, 1e-300)) ** (1 / POINTS)


@compiled
def stretched(pace, before, after):
    """The next arc over the last, which might have been `pace` times as long.

    A power of |v| has its singularity at rest: over an arc from |v| before to after the error of the collocation falls
    by Bernstein's ellipse, rho = |(1 + s)/(1 - s)|, s^2 = after/before, once for each of its points.
    """
    s = np.sqrt(after / max(before, 1e-300))
    if abs(1 - s) < 1e-3:
        return min(pace, FASTEST)
    if s > 1e3:
        return FASTEST
    rho = max((1 + s) / abs(1 - s) / pace, 1 + 1e-3)
    ahead = (rho - 1) / (rho + 1) if s < 1 else (rho + 1) / (rho - 1)
    return min(max(s**2 * (1 - ahead**2) / (1 - s**2), LEAST), FASTEST)
