"""The equation of motion of a cart behind a spring, with dry friction, solved arc by arc without small steps.

    m x'' = k (e - o) + c e' + S(x) - R(x', x''),   e = y(t) - x

y(t) is the imposed motion of the far end, e the stretch, o the half of the backlash that is taken up, S the push of
end springs (`suspended`). R jumps at speed 0 and is set-valued there: the cart stands while it is pulled less than
R(0+) and more than R(0-). With K e - n y + g for the springs, in e,

    (m + M) e'' + (c + d) e' + K e = (m + M) y'' + n y - g + R0 + d (y' - v0) - M a0 + r(t)
    r = R(v, a) - R0 - d (v - v0) - M (a - a0),   d = dR/dv, M = dR/da at the start of the arc

is a linear oscillator under a force that is a polynomial wherever y is one and r is made one (`sliding`), and a
polynomial force is answered exactly (`oscillator`). So an arc lasts as long as the law, the sign of the speed and r
allow, however stiff the spring: for dry friction of one size it is a whole piece of the law. An arc ends where the
speed gets zero or R bends, where a standing cart is pulled off, where the backlash opens or closes, or where the cart
meets or leaves an end spring: at roots of signals (`ringing`), found to rounding. What r misses of the true resistance
anywhere is the defect: the arcs solve exactly the equation with a resistance that differs by less than the tolerance.

No compiled call lasts longer than a fraction of a second: an arc is tried `TRIES` times at most, each try is a bounded
amount of work, and `advance` pauses after a `SLICE` of it, so that an interrupt gets in.
"""

from typing import NamedTuple

import numpy as np

from compact.dynamics.collocation import (
    AHEAD,
    CHECKS,
    SLOWEST,
    defect,
    lined,
    pace_of,
    passed,
    slide,
    stretched,
)
from compact.dynamics.force_elements import (
    AT_FAR,
    AT_NEAR,
    FAR,
    NEAR,
    CartState,
    direction,
    engaged,
    hold,
    limits,
)
from compact.dynamics.oscillator import (
    CELLS,
    EXHAUSTED,
    MOST_RANGES,
    RANGES,
    TERMS,
    Signal,
    combined,
    effort,
    first_fall,
    largest_product,
    reach,
    shifted,
    slope,
    value,
)
from compact.numerics.jit import compiled

SHORTEST = 1e-13  # share of a piece of the law below which a step is no step
TRIES = 1000  # of one arc; each is shorter than the one before by a tenth or more, 300 lead to SHORTEST
BRIEF = 1e-7  # share of a piece of the law: over so short an arc a cart that does not get away stands
STILL = 1e-7  # of the fastest: so slow a cart does not bounce off the plate of an end spring any more

SLICE = 100_000  # evaluations of F and ranges searched in one compiled call, about: a tenth of a second or less

DONE, TOO_MANY, TOO_FAST, TOO_SHORT, UNSEARCHED, PAUSED = range(6)  # how `integrate` or `advance` ended
# what ends an arc; HELD: the cart stopped before it got away; PASSED: its resistance is another from there
NOTHING, STOPPED, HELD, PULLED, PUSHED, OPENED, CLOSED_AHEAD, CLOSED_BEHIND, LEFT, MET_NEAR, MET_FAR, PASSED = range(12)


class Intervals(NamedTuple):
    """One arc a row. At u = (t - start)/span, t <= start + length, the stretch is the `Signal` of stretch and ring,
    and the far end stands at sum_j law[j] u^j; slip: direction of the motion, 0 standing; side of the backlash; zone
    of the end springs."""

    start: np.ndarray
    span: np.ndarray
    length: np.ndarray
    law: np.ndarray
    stretch: np.ndarray
    ring: np.ndarray
    slip: np.ndarray
    side: np.ndarray
    zone: np.ndarray


def room(count, degree):
    """Empty `Intervals` for `count` rows under a law of the degree."""
    one = np.empty(count)
    kind = np.empty(count, np.int64)
    return Intervals(
        one, one.copy(), one.copy(), np.empty((count, degree + 1)), np.empty((count, TERMS)), np.empty((count, 4)),
        kind, kind.copy(), kind.copy(),
    )  # fmt: skip


@compiled
def event(spring, resistance, slip, state, law, stretch, effort):
    """(u, what) of the first event on an arc; (1, NOTHING) where there is none."""
    if slip != 0:
        first, what = earlier(1.0, NOTHING, combined(stretch, law, 0.0, -slip, 0.0, slip), STOPPED, effort)
        if spring.ends.length > 0:
            first, what = _at_plate(spring.ends, state.zone, law, stretch, first, what, effort)
    else:
        first, what = 1.0, NOTHING
        held, most = hold(spring, state.side, state.zone), limits(spring, resistance, state.zone)
        for way, limit, name in ((1, most[0], PULLED), (-1, most[1], PUSHED)):
            spare = combined(stretch, law, -way * held.stiffness, -way * spring.damping, way * held.along, 0.0)
            spare.poly[0] += way * (limit - held.constant)
            first, what = earlier(first, what, spare, name, effort)
    if spring.backlash > 0:
        for way, name in ((1, CLOSED_AHEAD), (-1, CLOSED_BEHIND)):
            if state.side == -way:
                continue
            on = 1.0 if state.side == way else -1.0
            play = combined(stretch, law, on * way, 0.0, 0.0, 0.0)
            play.poly[0] -= on * spring.backlash / 2
            first, what = earlier(first, what, play, OPENED if state.side == way else name, effort)
    return first, what


@compiled
def earlier(first, what, signal, name, effort):
    """(u, what) of a signal's first fall below zero where it comes before the first event so far."""
    u = first_fall(signal, effort)
    return (u, name) if u < first or (u == first and what == NOTHING) else (first, what)


@compiled
def _at_plate(ends, zone, law, stretch, first, what, effort):
    """The first event, or where the cart meets or leaves an end spring before it."""
    for end, begins, name in ((NEAR, ends.length, MET_NEAR), (FAR, ends.stroke - ends.length, MET_FAR)):
        if zone == -end:
            continue
        on = -end if zone == end else end
        apart = combined(stretch, law, -on, 0.0, on, 0.0)
        apart.poly[0] -= on * begins
        first, what = earlier(first, what, apart, LEFT if zone == end else name, effort)
    return first, what


class Trial(NamedTuple):
    """An arc that was tried: whether to keep it, the step to try next [s], far end and stretch over u, where and by
    what it ends."""

    kept: bool
    step: float
    law: np.ndarray
    stretch: Signal
    until: float
    what: int
    evaluations: int
    fastest: float


@compiled
def attempt(spring, resistance, state, slip, line, law, h, tolerance, effort):
    """The `Trial` of an arc of at most h [s] under law(u) of a cart that slides."""
    law, stretch, rest, converged, evaluations = slide(spring, resistance, state, slip, line, law, h, tolerance, effort)
    span = stretch.span
    if not converged:
        return Trial(False, span / 2, law, stretch, 0.0, NOTHING, evaluations, 0.0)
    until, what = event(spring, resistance, slip, state, law, stretch, effort)
    speed = combined(stretch, law, 0.0, -1.0, 0.0, 1.0)
    worst, fastest = defect(resistance, slip, line, speed, rest, until)
    evaluations += CHECKS
    leaves = passed(resistance, slip, line, speed, effort) if worst > tolerance else 2.0
    if leaves < until:
        until, what = leaves, PASSED
        worst, fastest = defect(resistance, slip, line, speed, rest, until)
        evaluations += CHECKS
    pace = pace_of(worst, tolerance)
    if worst > tolerance:
        step = span * min(max(pace, SLOWEST), AHEAD * until)
    elif what == STOPPED:
        step = span
    elif what == PASSED or span < h:  # it was the resistance that ended it, and not the step
        step = h
    else:
        step = span * stretched(pace, abs(value(speed, 0.0)), abs(value(speed, until)))
    return Trial(worst <= tolerance, step, law, stretch, until, what, evaluations, fastest)


@compiled
def stand(spring, resistance, state, law, h, effort):
    """The `Trial` of an arc of h [s] under law(u) of a cart that stands."""
    poly = law.copy()
    poly[0] = state.stretch
    stretch = Signal(poly, 0.0, 0.0, 0.0, 0.0, h)
    until, what = event(spring, resistance, 0, state, law, stretch, effort)
    return Trial(True, np.inf, law, stretch, until, what, 0, 0.0)


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
def outcome(spring, resistance, state, slip, trial):
    """The `CartState` at the end of an arc."""
    stretch, velocity, side, zone = value(trial.stretch, trial.until), 0.0, state.side, state.zone
    if slip != 0 and trial.what != STOPPED:
        velocity = value(combined(trial.stretch, trial.law, 0.0, -1.0, 0.0, 1.0), trial.until)
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
            pace = value(slope(Signal(trial.law, 0.0, 0.0, 0.0, 0.0, 1.0)), trial.until) / trial.stretch.span
            pull = held.stiffness * stretch + held.constant + spring.damping * pace
            if direction(spring, resistance, plate, pull) == 0:
                return CartState(stretch, 0.0, side, plate)
        zone = 0 if trial.what == LEFT else (NEAR if trial.what == MET_NEAR else FAR)
    return CartState(stretch, velocity, side, zone)


class Journey(NamedTuple):
    """A cart on its way through the pieces of a law; an integration that paused goes on from it.

    reals : the `CartState`'s stretch [m] and velocity [m/s]; share of the piece that is done; step to try next [s]
    counts : the `CartState`'s side and zone; the piece; what ended the last arc; tries of this one; arcs; evaluations of F
    effort : of the searches of this arc, for its end
    """

    reals: np.ndarray
    counts: np.ndarray
    effort: np.ndarray


STRETCH, VELOCITY, SHARE, STEP = range(4)  # of `Journey.reals`
SIDE, ZONE, PIECE, LAST, TRIED, ARC, EVALUATIONS = range(7)  # of `Journey.counts`


@compiled
def begun(state):
    """A `Journey` that has not set off."""
    reals = np.array([state.stretch, state.velocity, 0.0, np.inf])
    return Journey(reals, np.array([state.side, state.zone, 0, NOTHING, 0, 0, 0]), np.zeros(2, np.int64))


@compiled
def reached(journey):
    """The `CartState` where a journey is."""
    reals, counts = journey.reals, journey.counts
    return CartState(reals[STRETCH], reals[VELOCITY], counts[SIDE], counts[ZONE])


@compiled
def clock(law, journey):
    """Time [s] at which a journey is."""
    i = journey.counts[PIECE]
    if i == len(law.coefficients):
        return law.breaks[-1]
    return law.breaks[i] + journey.reals[SHARE] * (law.breaks[i + 1] - law.breaks[i])


def integrate(spring, law, resistance, state, tolerance, arcs):
    """Arcs from a state through all pieces of a law: (how it ended, arcs, evaluations of F, state, time).

    law : position of the far end over time, `Pieces` whose joins are the only places where it is not smooth
    tolerance : of the defect [N];  arcs : `room`, filled in place
    """
    state = CartState(float(state.stretch), float(state.velocity), int(state.side), int(state.zone))
    journey, ended = begun(state), PAUSED
    while ended == PAUSED:  # an interrupt gets in between two calls
        ended = advance(spring, law, resistance, journey, tolerance, arcs, SLICE)
    counts = journey.counts
    return ended, int(counts[ARC]), int(counts[EVALUATIONS]), reached(journey), float(clock(law, journey))


@compiled
def advance(spring, law, resistance, journey, tolerance, arcs, most):
    """How a journey ended, or PAUSED after about as much work as `most`, to go on by the same call.

    Work is evaluations of F, ranges searched, and tries. The result is a bare number: making a record of a result runs
    Python, where an interrupt would be lost.
    """
    reals, counts, effort = journey
    work = 0
    while counts[PIECE] < len(law.coefficients):
        i, done, step = counts[PIECE], reals[SHARE], reals[STEP]
        begin, whole, piece = law.breaks[i], law.breaks[i + 1] - law.breaks[i], law.coefficients[i]
        if not done < 1:
            counts[PIECE], reals[SHARE], counts[LAST] = i + 1, 0.0, NOTHING
            continue
        if work >= most:
            return PAUSED
        time, left = begin + done * whole, (1 - done) * whole
        counts[TRIED] += 1
        if counts[ARC] == len(arcs.start):
            return TOO_MANY
        if step < SHORTEST * whole or counts[TRIED] > TRIES:
            return TOO_SHORT
        state = reached(journey)
        here = shifted(piece, done, 1.0)
        pace = here[1] / whole
        slip = heading(spring, resistance, state, here[0], pace, counts[LAST])
        line = lined(spring, resistance, state, slip or 1, here[0], pace)
        h = left if slip == 0 else min(step, left)
        if slip != 0:
            stiffness = hold(spring, state.side, state.zone).stiffness
            h = reach(spring.mass + line.added, spring.damping + line.rise, stiffness, h)
        y = shifted(piece, done, h / whole)
        effort[RANGES] = 0
        if slip == 0:
            trial = stand(spring, resistance, state, y, h, effort)
        else:  # after a stand it goes on with steps as before
            trial = attempt(spring, resistance, state, slip, line, y, h, tolerance, effort)
            reals[STEP] = trial.step
        counts[EVALUATIONS] += trial.evaluations
        work += 1 + trial.evaluations + effort[RANGES]
        if effort[EXHAUSTED] == 1:
            return UNSEARCHED
        span = trial.stretch.span
        if not trial.kept:
            continue
        if slip != 0 and trial.fastest > (resistance.there if slip > 0 else resistance.back).breaks[-1]:
            return TOO_FAST
        stayed = state.velocity == 0 and trial.what == STOPPED and trial.until * span < SHORTEST * whole
        if stayed and span > BRIEF * whole:  # it hardly sets off: over a shorter arc rounding hides less
            reals[STEP] = span / 8
            continue
        _keep(arcs, counts[ARC], time, trial, slip, state)
        counts[ARC] += 1
        counts[TRIED], counts[LAST] = 0, HELD if stayed else trial.what
        if stayed:
            reals[STEP] = np.inf
        end = outcome(spring, resistance, state, slip, trial)
        reals[STRETCH], reals[VELOCITY], counts[SIDE], counts[ZONE] = end.stretch, end.velocity, end.side, end.zone
        reals[SHARE] = 1.0 if span == left and trial.what == NOTHING else done + trial.until * span / whole
    return DONE


@compiled
def _keep(arcs, n, start, trial, slip, state):
    span = trial.stretch.span
    arcs.start[n], arcs.span[n], arcs.length[n] = start, span, trial.until * span
    arcs.law[n], arcs.stretch[n] = trial.law, 0.0
    arcs.stretch[n, : len(trial.stretch.poly)] = trial.stretch.poly
    arcs.ring[n, 0], arcs.ring[n, 1] = trial.stretch.cosine, trial.stretch.sine
    arcs.ring[n, 2], arcs.ring[n, 3] = trial.stretch.decay, trial.stretch.bend
    arcs.slip[n], arcs.side[n], arcs.zone[n] = slip, state.side, state.zone


def peaks(spring, arcs):
    """Largest |force| of the spring [N] and largest |force times speed of the far end| [W] over all arcs.

    Raises RuntimeError where an arc oscillates too often to search it.
    """
    found, searched, ended = np.zeros(2), effort(), PAUSED
    at = np.zeros(1, np.int64)
    while ended == PAUSED:  # an interrupt gets in between two calls
        ended = _raise_peaks(spring, arcs, found, at, searched, SLICE)
    if ended != DONE:
        raise RuntimeError(
            f"the largest force from {arcs.start[at[0]]:g} s on was not found in {MOST_RANGES} ranges of the "
            "oscillation; give more damping, or take a rigid drive"
        )
    return float(found[0]), float(found[1])


@compiled
def _raise_peaks(spring, arcs, found, at, effort, most):
    """How the search from arc `at` on ended, or PAUSED after about as many ranges as `most`; `found` grows."""
    work, damping = 0, spring.damping
    for i in range(at[0], len(arcs.start)):
        at[0] = i
        if work >= most:
            return PAUSED
        stiffness, offset = engaged(spring, arcs.side[i])
        ring, law = arcs.ring[i], arcs.law[i]
        stretch = Signal(arcs.stretch[i], ring[0], ring[1], ring[2], ring[3], arcs.span[i])
        force = combined(stretch, law, stiffness, damping, 0.0, 0.0)
        force.poly[0] -= stiffness * offset
        still = Signal(np.zeros(TERMS), 0.0, 0.0, 0.0, 0.0, arcs.span[i])
        one, pace = combined(still, law, 0.0, 0.0, 0.0, 0.0), combined(still, law, 0.0, 0.0, 0.0, 1.0)
        one.poly[0] = 1.0
        until = arcs.length[i] / arcs.span[i]
        for which, other in ((0, one), (1, pace)):
            effort[RANGES] = 0
            found[which] = max(found[which], largest_product(force, other, until, effort))
            work += CELLS + effort[RANGES]
            if effort[EXHAUSTED] == 1:
                return UNSEARCHED
    return DONE
