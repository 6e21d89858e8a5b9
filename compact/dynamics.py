"""The equation of motion of a cart behind a spring, with dry friction, solved arc by arc without small steps.

    m x'' = k (e - o) + c e' + S(x) - R(x', x'') - D(t),   e = y(t) - x

y(t) is the imposed motion of the far end, e the stretch, o the half of the backlash that is taken up, S the push of
end springs (`suspended`), D a force of time, straight over the law. R jumps at speed 0 and is set-valued there: the
cart stands while it is pulled less than R(0+) + D and more than R(0-) + D. With K e - n y + g for the springs, in e,

    (m + M) e'' + (c + d) e' + K e = (m + M) y'' + n y - g + R0 + d (y' - v0) - M a0 + D(t) + r(t)
    r = R(v, a) - R0 - d (v - v0) - M (a - a0),   d = dR/dv, M = dR/da at the start of the arc

is a linear oscillator under a force that is a polynomial wherever y is one and r is made one by collocation, and a
polynomial force is answered exactly (`oscillator`). So an arc lasts as long as the law, the sign of the speed and r
allow, however stiff the spring: for dry friction of one size it is a whole piece of the law. An arc ends where the
speed gets zero, where a standing cart is pulled off, where the backlash opens or closes, or where the cart meets or
leaves an end spring: at roots of signals (`ringing`), found to rounding. What r misses of the true resistance anywhere
is the defect: the arcs solve exactly the equation with a resistance that differs by less than the tolerance.
"""

from typing import NamedTuple

import numpy as np

from compact import oscillator, resisted, ringing, suspended
from compact.oscillator import TERMS, reach, respond
from compact.resisted import BACK, THERE, accelerated, facing, later, opposed
from compact.ringing import (
    Signal,
    combined,
    compiling,
    first_fall,
    largest_product,
    scaled,
    shifted,
    slope,
    sum_of,
    value,
)
from compact.suspended import AT_FAR, AT_NEAR, FAR, NEAR, State, direction, engaged, hold, limits

POINTS = 9  # of the collocation, so that the defect falls with the 9th power of the step
CHECKS = 16  # places on an arc where the defect is measured
ITERATIONS = 25  # of the collocation; 1 for dry friction, 2 to 6 are usual
SLOWEST, FASTEST, SAFETY = 0.2, 4.0, 0.9  # of the step control
# where an arc that fails passes a knot of the resistance the next one ends a share past it, unless that is LATE times
# as far as the defect allows, or ALMOST the whole; a knot is passed that lies AT a share from the start, or farther
PAST, LATE, ALMOST, AT = 1 + 1e-3, 4.0, 0.9, 1e-6
EARLY = 1e-2  # of an arc: where it starts on the verge of what a M may be, that is no knot ahead
SHORTEST = 1e-13  # share of a piece of the law below which a step is no step
BRIEF = 1e-7  # share of a piece of the law: over so short an arc a cart that does not get away stands
STILL = 1e-7  # of the fastest: so slow a cart does not bounce off the plate of an end spring any more
NODES = np.sin(np.pi * np.arange(POINTS) / (2 * (POINTS - 1))) ** 2
TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))

DONE, TOO_MANY, TOO_FAST, TOO_SHORT = range(4)  # how `integrate` ended
# what ends an arc; HELD: the cart stopped before it got away
NOTHING, STOPPED, HELD, PULLED, PUSHED, OPENED, CLOSED_AHEAD, CLOSED_BEHIND, LEFT, MET_NEAR, MET_FAR = range(11)

compiled = compiling(__file__, *(module.__file__ for module in (oscillator, resisted, ringing, suspended)))


class Arcs(NamedTuple):
    """One arc a row. At u = (t - start)/span, t <= start + length, the stretch is the `Signal` of stretch and ring,
    and the far end stands at sum_j law[j] u^j; slip: direction of the motion, 0 standing; side of the backlash; zone
    of the end springs; given: D at the start and its rise, rows as of a `Resistance`."""

    start: np.ndarray
    span: np.ndarray
    length: np.ndarray
    law: np.ndarray
    stretch: np.ndarray
    ring: np.ndarray
    slip: np.ndarray
    side: np.ndarray
    zone: np.ndarray
    given: np.ndarray


def room(count, degree):
    """Empty `Arcs` for `count` rows under a law of the degree."""
    one = np.empty(count)
    kind = np.empty(count, np.int64)
    return Arcs(
        one, one.copy(), one.copy(), np.empty((count, degree + 1)), np.empty((count, TERMS)), np.empty((count, 4)),
        kind, kind.copy(), kind.copy(), np.empty((count, 3, 2)),
    )  # fmt: skip


class Line(NamedTuple):
    """R near the start of an arc: R0 + rise (v - v0) + added (a - a0); velocity v0, acceleration a0."""

    force: float
    rise: float
    added: float
    velocity: float
    acceleration: float


@compiled
def lined(spring, resistance, state, slip, place, pace):
    """The `Line` of a cart that moves, with the far end at a place [m] and a pace [m/s]."""
    held = hold(spring, state.side, state.zone)
    pull = held.stiffness * state.stretch - held.along * place + held.constant
    pull += spring.damping * (pace - state.velocity) - resistance.given[facing(slip), 0]
    a = accelerated(resistance, slip, state.velocity, spring.mass, pull)
    force, rise, added = opposed(resistance, slip, state.velocity, a)
    return Line(force, rise, added, state.velocity, a)


@compiled
def rest_of(resistance, slip, line, velocity, acceleration):
    """r [N]: what R has beside its `Line`."""
    force = opposed(resistance, slip, velocity, acceleration)[0]
    straight = line.rise * (velocity - line.velocity) + line.added * (acceleration - line.acceleration)
    return force - line.force - straight


@compiled
def slide(spring, resistance, state, slip, line, law, h, tolerance):
    """(stretch, coefficients of r, converged?, evaluations) of a cart that moves, over one trial arc."""
    held = hold(spring, state.side, state.zone)
    mass, damping, n = spring.mass + line.added, spring.damping + line.rise, len(law)
    force = held.along * law
    for j in range(n):
        if j + 2 < n:
            force[j] += mass / h**2 * (j + 1) * (j + 2) * law[j + 2]
        if j + 1 < n:
            force[j] += line.rise / h * (j + 1) * law[j + 1]
    force[0] += line.force - held.constant - line.rise * line.velocity - line.added * line.acceleration
    force[0] += resistance.given[facing(slip), 0]
    force[1] += resistance.given[facing(slip), 1] * h
    rest, there, before = np.zeros(n), np.zeros(POINTS), np.zeros(POINTS)
    rate = law[1] / h - state.velocity
    stretch = respond(mass, damping, held.stiffness, force, state.stretch, rate, h)
    for iteration in range(ITERATIONS):
        speed, moved = combined(stretch, law, 0.0, -1.0, 0.0, 1.0), 0.0
        change = slope(speed)
        for i in range(POINTS):
            acceleration = value(change, NODES[i]) / h if resistance.pace > 0 else 0.0
            there[i] = rest_of(resistance, slip, line, value(speed, NODES[i]), acceleration)
            moved = max(moved, abs(there[i] - before[i]))
            if not abs(there[i]) < np.inf:
                return stretch, rest, False, (iteration + 1) * POINTS
        before[:] = there
        rest[:POINTS] = TO_COEFFICIENTS @ there
        stretch = respond(mass, damping, held.stiffness, force + rest, state.stretch, rate, h)
        if moved <= tolerance / 10:  # what is left falls by as much again
            return stretch, rest, True, (iteration + 1) * POINTS
    return stretch, rest, False, ITERATIONS * POINTS


@compiled
def defect(resistance, slip, line, speed, rest, until):
    """Largest |R - its `Line` - r| [N] up to u = until, and the largest |v| met."""
    worst, fastest, change = 0.0, 0.0, slope(speed)
    for i in range(CHECKS + 1):
        u = until * i / CHECKS
        velocity, r = value(speed, u), 0.0
        for j in range(POINTS - 1, -1, -1):
            r = r * u + rest[j]
        if slip * velocity > 0:
            acceleration = value(change, u) / speed.span if resistance.pace > 0 else 0.0
            worst = max(worst, abs(rest_of(resistance, slip, line, velocity, acceleration) - r))
        fastest = max(fastest, abs(velocity))
    return worst, fastest


@compiled
def event(spring, resistance, slip, state, law, stretch):
    """(u, what) of the first event on an arc; (1, NOTHING) where there is none."""
    if slip != 0:
        first, what = earlier(1.0, NOTHING, combined(stretch, law, 0.0, -slip, 0.0, slip), STOPPED)
        if spring.ends.length > 0:
            first, what = _at_plate(spring.ends, state.zone, law, stretch, first, what)
    else:
        first, what = 1.0, NOTHING
        held, most = hold(spring, state.side, state.zone), limits(spring, resistance, state.zone)
        for way, limit, row, name in ((1, most[0], THERE, PULLED), (-1, most[1], BACK, PUSHED)):
            spare = combined(stretch, law, -way * held.stiffness, -way * spring.damping, way * held.along, 0.0)
            spare.poly[0] += way * (limit - held.constant)
            spare.poly[1] += way * resistance.given[row, 1] * stretch.span
            first, what = earlier(first, what, spare, name)
    if spring.backlash > 0:
        for way, name in ((1, CLOSED_AHEAD), (-1, CLOSED_BEHIND)):
            if state.side == -way:
                continue
            on = 1.0 if state.side == way else -1.0
            play = combined(stretch, law, on * way, 0.0, 0.0, 0.0)
            play.poly[0] -= on * spring.backlash / 2
            first, what = earlier(first, what, play, OPENED if state.side == way else name)
    return first, what


@compiled
def earlier(first, what, signal, name):
    """(u, what) of a signal's first fall below zero where it comes before the first event so far."""
    u = first_fall(signal)
    return (u, name) if u < first or (u == first and what == NOTHING) else (first, what)


@compiled
def _at_plate(ends, zone, law, stretch, first, what):
    """The first event, or where the cart meets or leaves an end spring before it."""
    for end, begins, name in ((NEAR, ends.length, MET_NEAR), (FAR, ends.stroke - ends.length, MET_FAR)):
        if zone == -end:
            continue
        on = -end if zone == end else end
        apart = combined(stretch, law, -on, 0.0, on, 0.0)
        apart.poly[0] -= on * begins
        first, what = earlier(first, what, apart, LEFT if zone == end else name)
    return first, what


class Trial(NamedTuple):
    """An arc that was tried: whether to keep it, the step to try next [s], its stretch, where and by what it ends."""

    kept: bool
    step: float
    stretch: Signal
    until: float
    what: int
    evaluations: int
    fastest: float


@compiled
def heading(spring, resistance, state, place, pace, last):
    """Direction of the arc that begins in a state, the far end at a place [m] and a pace [m/s], after what ended the
    last."""
    if state.velocity != 0:
        return 1 if state.velocity > 0 else -1
    if last in (PULLED, PUSHED):
        return 1 if last == PULLED else -1
    if last == HELD:
        return 0
    held = hold(spring, state.side, state.zone)
    pull = held.stiffness * state.stretch - held.along * place + held.constant + spring.damping * pace
    return direction(spring, resistance, state.zone, pull)


@compiled
def attempt(spring, resistance, state, slip, line, law, h, tolerance):
    """The `Trial` of an arc of h [s] under law(u)."""
    if slip == 0:
        poly = law.copy()
        poly[0] = state.stretch
        stretch = Signal(poly, 0.0, 0.0, 0.0, 0.0, h)
        until, what = event(spring, resistance, 0, state, law, stretch)
        return Trial(True, np.inf, stretch, until, what, 0, 0.0)
    stretch, rest, converged, evaluations = slide(spring, resistance, state, slip, line, law, h, tolerance)
    if not converged:
        return Trial(False, h / 2, stretch, 0.0, NOTHING, evaluations, 0.0)
    until, what = event(spring, resistance, slip, state, law, stretch)
    speed = combined(stretch, law, 0.0, -1.0, 0.0, 1.0)
    worst, fastest = defect(resistance, slip, line, speed, rest, until)
    pace = SAFETY * (tolerance / max(worst, 1e-300)) ** (1 / POINTS)
    kept = worst <= tolerance
    if kept:
        step = min(FASTEST, max(1.0, pace))
    else:
        to_knot = PAST * min(passed(resistance, slip, line, speed), until)
        step = to_knot if to_knot < min(ALMOST, LATE * pace) else max(SLOWEST, pace)
    return Trial(kept, h * step, stretch, until, what, evaluations + CHECKS, fastest)


@compiled
def passed(resistance, slip, line, speed):
    """The u at which a motion first passes a knot of R beyond the one where it starts, 2.0 where it passes none."""
    knots, start, first = resistance.knots, slip * line.velocity, 2.0
    above = np.searchsorted(knots, start * (1 + AT), side="right")
    below = np.searchsorted(knots, start * (1 - AT), side="left") - 1
    for k, way in ((above, slip), (below, -slip)):
        if 0 <= k < len(knots):
            left = scaled(speed, -way)
            left.poly[0] += way * slip * knots[k]
            first = min(first, first_fall(left))
    if 0 < resistance.pace < np.inf:
        change, inside = slope(speed), line.added != 0
        for sign in (1.0, -1.0):
            if inside or sign * line.acceleration > 0:
                spare = sum_of(scaled(speed, slip * resistance.pace), scaled(change, -sign / speed.span))
                u = first_fall(spare if inside else scaled(spare, -1.0))
                first = min(first, u if u > EARLY else 2.0)
    return first


@compiled
def outcome(spring, resistance, state, slip, law, trial):
    """The `State` at the end of an arc."""
    stretch, velocity, side, zone = value(trial.stretch, trial.until), 0.0, state.side, state.zone
    if slip != 0 and trial.what != STOPPED:
        velocity = value(combined(trial.stretch, law, 0.0, -1.0, 0.0, 1.0), trial.until)
    if trial.what == OPENED:
        side = 0
    elif trial.what in (CLOSED_AHEAD, CLOSED_BEHIND):
        side = 1 if trial.what == CLOSED_AHEAD else -1
    elif trial.what in (PULLED, PUSHED) and zone in (AT_NEAR, AT_FAR):
        pressed = (zone == AT_NEAR) == (trial.what == PUSHED)
        zone = (NEAR if zone == AT_NEAR else FAR) if pressed else 0
    elif trial.what in (LEFT, MET_NEAR, MET_FAR):
        plate = AT_NEAR if trial.what == MET_NEAR or zone == NEAR else AT_FAR
        if abs(velocity) <= STILL * resistance.there.breaks[-1]:
            held = hold(spring, side, plate)
            pace = value(slope(Signal(law, 0.0, 0.0, 0.0, 0.0, 1.0)), trial.until) / trial.stretch.span
            then = later(resistance, trial.until * trial.stretch.span)
            if direction(spring, then, plate, held.stiffness * stretch + held.constant + spring.damping * pace) == 0:
                return State(stretch, 0.0, side, plate)
        zone = 0 if trial.what == LEFT else (NEAR if trial.what == MET_NEAR else FAR)
    return State(stretch, velocity, side, zone)


@compiled
def integrate(spring, law, resistance, state, tolerance, arcs):
    """Arcs from a state through all pieces of a law: (how it ended, arcs, evaluations of F, state, time).

    law : position of the far end over time, `Pieces` whose joins are the only places where it is not smooth
    tolerance : of the defect [N];  arcs : `room`, filled in place
    """
    n, work, step = 0, 0, np.inf
    for i in range(len(law.coefficients)):
        begin, whole, piece = law.breaks[i], law.breaks[i + 1] - law.breaks[i], law.coefficients[i]
        done, last = 0.0, NOTHING
        while done < 1:
            time, left = begin + done * whole, (1 - done) * whole
            if n == len(arcs.start) or step < SHORTEST * whole:
                return TOO_MANY if n == len(arcs.start) else TOO_SHORT, n, work, state, time
            here = shifted(piece, done, 1.0)
            pace = here[1] / whole
            now = later(resistance, time - law.breaks[0])
            slip = heading(spring, now, state, here[0], pace, last)
            line = lined(spring, now, state, slip or 1, here[0], pace)
            h = left if slip == 0 else min(step, left)
            if slip != 0:
                stiffness = hold(spring, state.side, state.zone).stiffness
                h = reach(spring.mass + line.added, spring.damping + line.rise, stiffness, h)
            y = shifted(piece, done, h / whole)
            trial = attempt(spring, now, state, slip, line, y, h, tolerance)
            work += trial.evaluations
            if slip != 0:  # after a stand it goes on with steps as before
                step = trial.step
            if not trial.kept:
                continue
            if slip != 0 and trial.fastest > (resistance.there if slip > 0 else resistance.back).breaks[-1]:
                return TOO_FAST, n, work, state, time
            stayed = state.velocity == 0 and trial.what == STOPPED and trial.until * h < SHORTEST * whole
            if stayed and h > BRIEF * whole:  # it hardly sets off: over a shorter arc rounding hides less
                step = h / 8
                continue
            _keep(arcs, n, time, h, y, trial, slip, state, now.given)
            n += 1
            last, step = (HELD, np.inf) if stayed else (trial.what, step)
            state = outcome(spring, now, state, slip, y, trial)
            done = 1.0 if h == left and trial.what == NOTHING else done + trial.until * h / whole
    return DONE, n, work, state, law.breaks[-1]


@compiled
def _keep(arcs, n, start, span, law, trial, slip, state, given):
    arcs.start[n], arcs.span[n], arcs.length[n] = start, span, trial.until * span
    arcs.law[n], arcs.stretch[n] = law, 0.0
    arcs.stretch[n, : len(trial.stretch.poly)] = trial.stretch.poly
    arcs.ring[n, 0], arcs.ring[n, 1] = trial.stretch.cosine, trial.stretch.sine
    arcs.ring[n, 2], arcs.ring[n, 3] = trial.stretch.decay, trial.stretch.bend
    arcs.slip[n], arcs.side[n], arcs.zone[n], arcs.given[n] = slip, state.side, state.zone, given


@compiled
def peaks(spring, arcs):
    """Largest |force| of the spring [N] and largest |force times speed of the far end| [W] over all arcs."""
    force_peak, power_peak = 0.0, 0.0
    for i in range(len(arcs.start)):
        stiffness, offset = engaged(spring, arcs.side[i])
        ring, law = arcs.ring[i], arcs.law[i]
        stretch = Signal(arcs.stretch[i], ring[0], ring[1], ring[2], ring[3], arcs.span[i])
        damping = spring.damping
        force = combined(stretch, law, stiffness, damping, 0.0, 0.0)
        force.poly[0] -= stiffness * offset
        still = Signal(np.zeros(TERMS), 0.0, 0.0, 0.0, 0.0, arcs.span[i])
        one, pace = combined(still, law, 0.0, 0.0, 0.0, 0.0), combined(still, law, 0.0, 0.0, 0.0, 1.0)
        one.poly[0] = 1.0
        until = arcs.length[i] / arcs.span[i]
        force_peak = max(force_peak, largest_product(force, one, until))
        power_peak = max(power_peak, largest_product(force, pace, until))
    return force_peak, power_peak
