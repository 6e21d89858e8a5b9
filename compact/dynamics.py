"""The equation of motion of a cart behind a spring, with dry friction, solved arc by arc without small steps.

    m x'' = k (e - o) + c e' - F(x'),   e = y(t) - x

y(t) is the imposed motion of the far end, e the stretch, o the half of the backlash that is taken up. F jumps at
speed 0 and is set-valued there: the cart stands while the spring pulls less than F(0+) and more than F(0-). In e,

    m e'' + (c + d) e' + k e = m y'' + k o + F0 + d (y' - v0) + r(t),   r = F(v) - F0 - d (v - v0)

is a linear oscillator under a force that is a polynomial wherever y is one and r is made one by collocation, and a
polynomial force is answered exactly: by a polynomial and a free oscillation, or, over a time too short for that to be
well conditioned, by a power series. So an arc lasts as long as the law, the sign of the speed and r allow, however
stiff the spring: for dry friction of one size it is a whole piece of the law. An arc ends where the speed gets zero,
where the spring overcomes the friction of a standing cart, or where the backlash opens or closes: at roots of signals
(`ringing`), found to rounding. What r misses of the true resistance anywhere is the defect: the arcs solve exactly the
equation with a resistance that differs by less than the tolerance.
"""

from typing import NamedTuple

import numpy as np

from compact import oscillator, ringing
from compact.oscillator import TERMS, reach, respond
from compact.polynomials import Pieces
from compact.ringing import Signal, combined, compiling, first_fall, largest_product, shifted, value

POINTS = 9  # of the collocation, so that the defect falls with the 9th power of the step
CHECKS = 16  # places on an arc where the defect is measured
ITERATIONS = 25  # of the collocation; 1 for dry friction, 2 to 6 are usual
SLOWEST, FASTEST, SAFETY = 0.2, 4.0, 0.9  # of the step control
# where an arc that fails passes a knot of the resistance the next one ends a share past it, unless that is LATE times
# as far as the defect allows, or NEAR the end; a knot is passed that lies AT a share from where the arc starts, or more
PAST, LATE, NEAR, AT = 1 + 1e-3, 4.0, 0.9, 1e-6
SHORTEST = 1e-13  # share of a piece of the law below which a step is no step
BRIEF = 1e-7  # share of a piece of the law: over so short an arc a cart that does not get away stands
SLACK = 1e-12  # share of the friction by which a standing cart may be overpulled: rounding
NODES = np.sin(np.pi * np.arange(POINTS) / (2 * (POINTS - 1))) ** 2
TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))

DONE, TOO_MANY, TOO_FAST, TOO_SHORT = range(4)  # how `integrate` ended
# what ends an arc; HELD: the cart stopped before it got away
NOTHING, STOPPED, HELD, PULLED, PUSHED, OPENED, CLOSED_AHEAD, CLOSED_BEHIND = range(8)

compiled = compiling(__file__, oscillator.__file__, ringing.__file__)


class Spring(NamedTuple):
    """mass [kg], stiffness [N/m], damping [N s/m], backlash: play between the flanks [m]."""

    mass: float
    stiffness: float
    damping: float
    backlash: float


class Resistance(NamedTuple):
    """F [N] over |v| [m/s] on the way there and on the way back, `Pieces` from 0; knots: |v| where F is not smooth."""

    there: Pieces
    back: Pieces
    knots: np.ndarray


class State(NamedTuple):
    """stretch e [m], velocity x' [m/s], side: +1 and -1 on a flank, 0 in the backlash; always +1 without one."""

    stretch: float
    velocity: float
    side: int


class Arcs(NamedTuple):
    """One arc a row. At u = (t - start)/span, t <= start + length, the stretch is the `Signal` of stretch and ring,
    and the far end stands at sum_j law[j] u^j; slip: direction of the motion, 0 standing; side: of the backlash."""

    start: np.ndarray
    span: np.ndarray
    length: np.ndarray
    law: np.ndarray
    stretch: np.ndarray
    ring: np.ndarray
    slip: np.ndarray
    side: np.ndarray


def room(count, degree):
    """Empty `Arcs` for `count` rows under a law of the degree."""
    one = np.empty(count)
    kind = np.empty(count, np.int64)
    return Arcs(
        one, one.copy(), one.copy(), np.empty((count, degree + 1)), np.empty((count, TERMS)), np.empty((count, 4)),
        kind, kind.copy(),
    )  # fmt: skip


@compiled
def met(resistance, slip, velocity):
    """F and dF/dv at a velocity, seen from the side of `slip`; beyond the ends of its table it goes on straight."""
    pieces, speed = (resistance.there, velocity) if slip > 0 else (resistance.back, -velocity)
    breaks = pieces.breaks
    i = min(max(np.searchsorted(breaks, speed, side="right") - 1, 0), len(breaks) - 2)
    width = breaks[i + 1] - breaks[i]
    p = pieces.coefficients[i]
    u, force, rise = (speed - breaks[i]) / width, 0.0, 0.0
    inside = min(max(u, 0.0), 1.0)
    for j in range(len(p) - 1, -1, -1):
        rise = rise * inside + force
        force = force * inside + p[j]
    return force + rise * (u - inside), slip * rise / width


@compiled
def direction(resistance, pull):
    """Which way a standing cart goes under a pull [N]: 0 where the friction holds it."""
    most, least = met(resistance, 1, 0.0)[0], met(resistance, -1, 0.0)[0]
    slack = SLACK * (most - least)
    return 1 if pull > most + slack else -1 if pull < least - slack else 0


@compiled
def engaged(spring, side):
    """Stiffness and offset o of the spring on a side of the backlash."""
    return (0.0, 0.0) if side == 0 else (spring.stiffness, side * spring.backlash / 2)


@compiled
def slide(spring, resistance, state, slip, law, h, tolerance):
    """(stretch, coefficients of r, converged?, evaluations) of a cart that moves, over one trial arc."""
    stiffness, offset = engaged(spring, state.side)
    first, rise = met(resistance, slip, state.velocity)
    n = len(law)
    force = np.zeros(n)
    for j in range(n):
        if j + 2 < n:
            force[j] += spring.mass / h**2 * (j + 1) * (j + 2) * law[j + 2]
        if j + 1 < n:
            force[j] += rise / h * (j + 1) * law[j + 1]
    force[0] += stiffness * offset + first - rise * state.velocity
    rest, there, before = np.zeros(n), np.zeros(POINTS), np.zeros(POINTS)
    rate = law[1] / h - state.velocity
    for iteration in range(ITERATIONS):
        stretch = respond(spring.mass, spring.damping + rise, stiffness, force + rest, state.stretch, rate, h)
        speed, moved = combined(stretch, law, 0.0, -1.0, 0.0, 1.0), 0.0
        for i in range(POINTS):
            velocity = value(speed, NODES[i])
            there[i] = met(resistance, slip, velocity)[0] - first - rise * (velocity - state.velocity)
            moved = max(moved, abs(there[i] - before[i]))
            if not abs(there[i]) < np.inf:
                return stretch, rest, False, (iteration + 1) * POINTS
        before[:] = there
        rest[:POINTS] = TO_COEFFICIENTS @ there
        if moved <= tolerance / 10:  # what is left falls by as much again
            stretch = respond(spring.mass, spring.damping + rise, stiffness, force + rest, state.stretch, rate, h)
            return stretch, rest, True, (iteration + 1) * POINTS
    return stretch, rest, False, ITERATIONS * POINTS


@compiled
def defect(resistance, state, slip, speed, rest, until):
    """Largest |F(v) - F0 - d (v - v0) - r| [N] up to u = until, and the largest |v| met."""
    first, rise = met(resistance, slip, state.velocity)
    worst, fastest = 0.0, 0.0
    for i in range(CHECKS + 1):
        u = until * i / CHECKS
        velocity, r = value(speed, u), 0.0
        for j in range(POINTS - 1, -1, -1):
            r = r * u + rest[j]
        if slip * velocity > 0:
            worst = max(worst, abs(met(resistance, slip, velocity)[0] - first - rise * (velocity - state.velocity) - r))
        fastest = max(fastest, abs(velocity))
    return worst, fastest


@compiled
def event(spring, resistance, slip, side, law, stretch):
    """(u, what) of the first event on an arc; (1, NOTHING) where there is none."""
    stiffness, offset = engaged(spring, side)
    first, what = 1.0, NOTHING
    if slip != 0:
        u = first_fall(combined(stretch, law, 0.0, -slip, 0.0, slip))
        if u <= first:
            first, what = u, STOPPED
    else:
        for way, name in ((1, PULLED), (-1, PUSHED)):
            spare = combined(stretch, law, -way * stiffness, -way * spring.damping, 0.0, 0.0)
            spare.poly[0] += way * (met(resistance, way, 0.0)[0] + stiffness * offset)
            u = first_fall(spare)
            if u <= first:
                first, what = u, name
    if spring.backlash > 0:
        for way, name in ((1, CLOSED_AHEAD), (-1, CLOSED_BEHIND)):
            if side == -way:
                continue
            on = 1.0 if side == way else -1.0
            play = combined(stretch, law, on * way, 0.0, 0.0, 0.0)
            play.poly[0] -= on * spring.backlash / 2
            u = first_fall(play)
            if u < first:
                first, what = u, (OPENED if side == way else name)
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
def heading(spring, resistance, state, pace, last):
    """Direction of the arc that begins in a state, with the far end at `pace` [m/s] and after what ended the last."""
    if state.velocity != 0:
        return 1 if state.velocity > 0 else -1
    if last in (PULLED, PUSHED):
        return 1 if last == PULLED else -1
    if last == HELD:
        return 0
    stiffness, offset = engaged(spring, state.side)
    return direction(resistance, stiffness * (state.stretch - offset) + spring.damping * pace)


@compiled
def longest_answer(spring, resistance, state, slip, h):
    """h [s], or less where no answer of `respond` holds for it."""
    if slip == 0:
        return h
    rise = met(resistance, slip, state.velocity)[1]
    return reach(spring.mass, spring.damping + rise, engaged(spring, state.side)[0], h)


@compiled
def attempt(spring, resistance, state, slip, law, h, tolerance):
    """The `Trial` of an arc of h [s] under law(u)."""
    if slip == 0:
        poly = law.copy()
        poly[0] = state.stretch
        stretch = Signal(poly, 0.0, 0.0, 0.0, 0.0, h)
        until, what = event(spring, resistance, 0, state.side, law, stretch)
        return Trial(True, np.inf, stretch, until, what, 0, 0.0)
    stretch, rest, converged, evaluations = slide(spring, resistance, state, slip, law, h, tolerance)
    if not converged:
        return Trial(False, h / 2, stretch, 0.0, NOTHING, evaluations, 0.0)
    until, what = event(spring, resistance, slip, state.side, law, stretch)
    speed = combined(stretch, law, 0.0, -1.0, 0.0, 1.0)
    worst, fastest = defect(resistance, state, slip, speed, rest, until)
    pace = SAFETY * (tolerance / max(worst, 1e-300)) ** (1 / POINTS)
    kept = worst <= tolerance
    if kept:
        step = min(FASTEST, max(1.0, pace))
    else:
        to_knot = PAST * min(passed(resistance.knots, slip, state.velocity, speed), until)
        step = to_knot if to_knot < min(NEAR, LATE * pace) else max(SLOWEST, pace)
    return Trial(kept, h * step, stretch, until, what, evaluations + CHECKS, fastest)


@compiled
def passed(knots, slip, velocity, speed):
    """The u at which a speed first passes a knot beyond the one where it starts, 2.0 where it passes none."""
    start, first = slip * velocity, 2.0
    above = np.searchsorted(knots, start * (1 + AT), side="right")
    below = np.searchsorted(knots, start * (1 - AT), side="left") - 1
    for k, way in ((above, slip), (below, -slip)):
        if 0 <= k < len(knots):
            left = Signal(-way * speed.poly, -way * speed.cosine, -way * speed.sine, *speed[3:])
            left.poly[0] += way * slip * knots[k]
            first = min(first, first_fall(left))
    return first


@compiled
def outcome(state, slip, law, trial):
    """The `State` at the end of an arc."""
    stretch, velocity, side = value(trial.stretch, trial.until), 0.0, state.side
    if slip != 0 and trial.what != STOPPED:
        velocity = value(combined(trial.stretch, law, 0.0, -1.0, 0.0, 1.0), trial.until)
    if trial.what == OPENED:
        side = 0
    elif trial.what in (CLOSED_AHEAD, CLOSED_BEHIND):
        side = 1 if trial.what == CLOSED_AHEAD else -1
    return State(stretch, velocity, side)


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
            slip = heading(spring, resistance, state, shifted(piece, done, 1.0)[1] / whole, last)
            h = longest_answer(spring, resistance, state, slip, left if slip == 0 else min(step, left))
            y = shifted(piece, done, h / whole)
            trial = attempt(spring, resistance, state, slip, y, h, tolerance)
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
            _keep(arcs, n, time, h, y, trial, slip, state.side)
            n += 1
            last, step = (HELD, np.inf) if stayed else (trial.what, step)
            state = outcome(state, slip, y, trial)
            done = 1.0 if h == left and trial.what == NOTHING else done + trial.until * h / whole
    return DONE, n, work, state, law.breaks[-1]


@compiled
def _keep(arcs, n, start, span, law, trial, slip, side):
    arcs.start[n], arcs.span[n], arcs.length[n] = start, span, trial.until * span
    arcs.law[n], arcs.stretch[n] = law, 0.0
    arcs.stretch[n, : len(trial.stretch.poly)] = trial.stretch.poly
    arcs.ring[n, 0], arcs.ring[n, 1] = trial.stretch.cosine, trial.stretch.sine
    arcs.ring[n, 2], arcs.ring[n, 3] = trial.stretch.decay, trial.stretch.bend
    arcs.slip[n], arcs.side[n] = slip, side


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
