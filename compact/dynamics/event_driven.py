"""Event-driven integration of a cart behind a spring with dry friction, backlash and end springs.

    m x'' = k (e - o) + c e' + S(x) - R(x', x''),   e = y(t) - x

y(t) is the imposed motion of the driven end, e the elongation, o the engaged half of the backlash, S the force of the
end springs. R is discontinuous at speed 0 and set-valued there: a cart remains at rest while the sum of the other
forces lies between R(0-) and R(0+).

The solution consists of intervals between events. In an interval of sliding the equation is a linear oscillator under
a polynomial force (`collocation`) with a closed-form solution (`oscillator`). The length of an interval depends on the
motion of the driven end, the sign of the speed and the smoothness of R, but not on the stiffness. Under dry friction it
can cover a whole polynomial piece of y.

Events are a speed of zero, a kink of R, breakaway from rest, the opening or closing of the backlash and the contact
with an end spring. They are roots of signals and are located to rounding. The defect is the difference between R and
its interpolant; its largest value is below the tolerance.

Each compiled call lasts a fraction of a second: an interval is attempted `MAX_ATTEMPTS` times at most, each attempt is
bounded, and `advance` pauses after `WORK_SLICE` so that Python handles interrupts.
"""

from typing import NamedTuple

import numpy as np

from compact.dynamics import collocation
from compact.dynamics import force_elements as elements
from compact.dynamics import oscillator as signals
from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, inlined
from compact.numerics.piecewise import PiecewisePolynomial

MIN_STEP = 1e-13  # [-], of a piece of the driven-end motion; shorter steps are rounding
MAX_ATTEMPTS = 1000  # [-], of one interval; each is shorter by a tenth or more, 300 reach MIN_STEP
STICK_STEP = 1e-7  # [-], of a piece of the driven-end motion; a cart that stops again within such a step sticks
PLATE_REST_SPEED = 1e-7  # [-], of the largest speed; a slower cart does not rebound from the plate of an end spring
REST_ROUNDING = 1e-12  # [-], of the largest speed; a slower cart at the end of an interval is at rest
WORK_SLICE = 100_000  # [-], evaluations of R and searched ranges of one compiled call; 0.1 s or less

# status of `integrate` and `advance`
DONE, TOO_MANY_INTERVALS, SPEED_BEYOND_TABLE, STEP_TOO_SHORT, SEARCH_EXHAUSTED, PAUSED = range(6)
# events that end an interval; STUCK is a stop immediately after breakaway, RANGE_EXIT a change of the smooth range of R
(
    NO_EVENT, STOPPED, STUCK, BREAKAWAY_FORWARD, BREAKAWAY_BACKWARD, FLANK_OPENED, FRONT_FLANK_CLOSED,
    REAR_FLANK_CLOSED, END_SPRING_LEFT, NEAR_SPRING_REACHED, FAR_SPRING_REACHED, RANGE_EXIT,
) = range(12)  # fmt: skip


class Intervals(NamedTuple):
    """Solution over intervals between events, one row per interval; u = (t - start)/scale.

    Parameters
    ----------
    start, scale, duration : ndarray, shape (n,)
        Start, time over which u increases by 1 and duration [s], duration <= scale.
    driven_end : ndarray, shape (n, degree + 1)
        Coefficients of the driven-end position y(u) [m].
    elongation : ndarray, shape (n, SERIES_TERMS)
        Polynomial part of the elongation e(u) [m].
    oscillation : ndarray, shape (n, 4)
        Cosine, sine, decay and discriminant of its `Signal`.
    slip : ndarray, shape (n,)
        Direction of the motion, 0 at rest.
    flank, zone : ndarray, shape (n,)
        As in `CartState`.
    """

    start: Array
    scale: Array
    duration: Array
    driven_end: Array
    elongation: Array
    oscillation: Array
    slip: IntArray
    flank: IntArray
    zone: IntArray


def allocate_intervals(count: int, degree: int) -> Intervals:
    """Allocate uninitialised rows of `Intervals` for a driven-end motion of a degree."""
    reals = [np.empty(count) for _ in range(3)]
    columns = [np.empty((count, width)) for width in (degree + 1, signals.SERIES_TERMS, 4)]
    return Intervals._make([*reals, *columns, *(np.empty(count, np.int64) for _ in range(3))])


class TrialInterval(NamedTuple):
    """An attempted interval.

    Parameters
    ----------
    accepted : bool
        True within the tolerance.
    next_step, max_speed : float
        Step of the next attempt [s] and largest |v| [m/s].
    slip, event, evaluations : int
        Direction of the motion, 0 at rest; event at the end; evaluations of R.
    driven_end : ndarray
        Coefficients of y(u) [m].
    elongation : Signal
        e(u) [m].
    end : float
        u at the end.
    """

    accepted: bool
    next_step: float
    slip: int
    driven_end: Array
    elongation: signals.Signal
    end: float
    event: int
    evaluations: int
    max_speed: float


class IntegrationProgress(NamedTuple):
    """Progress of an integration through the pieces of the driven-end motion, which `advance` continues.

    Parameters
    ----------
    reals : ndarray, shape (4,)
        Elongation [m], velocity [m/s], completed fraction of the piece, step of the next attempt [s].
    counts : ndarray, shape (7,)
        Flank, zone, piece, last event, attempts of this interval, intervals, evaluations of R.
    counter : ndarray, shape (2,)
        Search counter of this interval.
    """

    reals: Array
    counts: IntArray
    counter: IntArray


ELONGATION, VELOCITY, FRACTION, STEP = range(4)  # indices of `IntegrationProgress.reals`
FLANK, ZONE, PIECE, LAST_EVENT, ATTEMPTS, INTERVAL, EVALUATIONS = range(7)  # indices of `IntegrationProgress.counts`


def integrate(
    oscillator: elements.OscillatorParameters,
    driven_end: PiecewisePolynomial,
    resistance: elements.ResistanceTable,
    state: elements.CartState,
    tolerance: float,
    intervals: Intervals,
) -> tuple[int, int, int, elements.CartState, float]:
    """Integrate a cart through all pieces of the driven-end motion y [m] over time [s], smooth within each.

    Returns status, number of intervals, evaluations of R, final state and final time [s]; the defect of R [N] is at
    most the tolerance.
    """
    state = elements.CartState(float(state.elongation), float(state.velocity), int(state.flank), int(state.zone))
    progress, status = initial_progress(state), PAUSED
    while status == PAUSED:  # Python handles interrupts between two calls
        status = advance(oscillator, driven_end, resistance, progress, tolerance, intervals, WORK_SLICE)
    counts = progress.counts
    time = float(current_time(driven_end, progress))
    return status, int(counts[INTERVAL]), int(counts[EVALUATIONS]), current_state(progress), time


@compiled
def initial_progress(state: elements.CartState) -> IntegrationProgress:
    """Progress at the start of an integration."""
    reals = np.array([state.elongation, state.velocity, 0.0, np.inf])
    return IntegrationProgress(reals, np.array([state.flank, state.zone, 0, NO_EVENT, 0, 0, 0]), np.zeros(2, np.int64))


@compiled
def current_state(progress: IntegrationProgress) -> elements.CartState:
    """State of the cart."""
    reals, counts = progress.reals, progress.counts
    return elements.CartState(reals[ELONGATION], reals[VELOCITY], counts[FLANK], counts[ZONE])


@compiled
def current_time(driven_end: PiecewisePolynomial, progress: IntegrationProgress) -> float:
    """Time [s] of an integration."""
    i = progress.counts[PIECE]
    if i == len(driven_end.coefficients):
        return driven_end.breaks[-1]
    return driven_end.breaks[i] + progress.reals[FRACTION] * (driven_end.breaks[i + 1] - driven_end.breaks[i])


@compiled
def advance(
    oscillator: elements.OscillatorParameters,
    driven_end: PiecewisePolynomial,
    resistance: elements.ResistanceTable,
    progress: IntegrationProgress,
    tolerance: float,
    intervals: Intervals,
    max_work: int,
) -> int:
    """Continue an integration by about `max_work` and return its status, `PAUSED` before the end.

    Work counts evaluations of R, searched ranges and attempts. The status is a plain number: the conversion of a
    record to Python runs Python code, in which an interrupt would be lost.
    """
    reals, counts, counter = progress
    work = 0
    while counts[PIECE] < len(driven_end.coefficients):
        if not reals[FRACTION] < 1:
            counts[PIECE], reals[FRACTION], counts[LAST_EVENT] = counts[PIECE] + 1, 0.0, NO_EVENT
            continue
        if work >= max_work:
            return PAUSED
        counts[ATTEMPTS] += 1
        if counts[INTERVAL] == len(intervals.start):
            return TOO_MANY_INTERVALS
        width = driven_end.breaks[counts[PIECE] + 1] - driven_end.breaks[counts[PIECE]]
        if reals[STEP] < MIN_STEP * width or counts[ATTEMPTS] > MAX_ATTEMPTS:
            return STEP_TOO_SHORT
        counter[signals.RANGES] = 0
        trial = _attempt_interval(oscillator, driven_end, resistance, progress, tolerance)
        counts[EVALUATIONS] += trial.evaluations
        work += 1 + trial.evaluations + counter[signals.RANGES]
        if counter[signals.EXHAUSTED] == 1:
            return SEARCH_EXHAUSTED
        if not trial.accepted:
            continue
        table = resistance.forward if trial.slip > 0 else resistance.backward
        if trial.slip != 0 and trial.max_speed > table.breaks[-1]:
            return SPEED_BEYOND_TABLE
        _accept_interval(oscillator, driven_end, resistance, progress, trial, intervals)
    return DONE


@inlined
def _attempt_interval(oscillator, driven_end, resistance, progress, tolerance):
    """Attempt the next interval; the step is updated after sliding."""
    reals, counts, counter = progress
    i, fraction = counts[PIECE], reals[FRACTION]
    width, piece = driven_end.breaks[i + 1] - driven_end.breaks[i], driven_end.coefficients[i]
    remaining, state = (1 - fraction) * width, current_state(progress)
    shifted = signals.substitute(piece, fraction, 1.0)
    position, velocity = shifted[0], shifted[1] / width
    slip = _slip_direction(oscillator, resistance, state, position, velocity, counts[LAST_EVENT])
    if slip == 0:
        motion = signals.substitute(piece, fraction, remaining / width)
        return _stick(oscillator, resistance, state, motion, remaining, counter)
    problem = collocation.set_up_sliding(oscillator, resistance, state, slip, position, velocity, tolerance)
    h = collocation.limit_sliding_step(problem, min(reals[STEP], remaining))
    trial = _slide(problem, signals.substitute(piece, fraction, h / width), h, counter)
    reals[STEP] = trial.next_step
    return trial


@inlined
def _slip_direction(oscillator, resistance, state, position, velocity, last_event):
    """Direction of the interval after an event, with the driven end at a position [m] and a velocity [m/s]."""
    if state.velocity != 0:
        return 1 if state.velocity > 0 else -1
    if last_event in (BREAKAWAY_FORWARD, BREAKAWAY_BACKWARD):
        return 1 if last_event == BREAKAWAY_FORWARD else -1
    if last_event == STUCK:
        return 0
    springs = elements.spring_force(oscillator, state.flank, state.zone)
    pull = springs.stiffness * state.elongation - springs.driven_end_stiffness * position + springs.constant
    return elements.breakaway_direction(oscillator, resistance, state.zone, pull + oscillator.damping * velocity)


@inlined
def _stick(oscillator, resistance, state, driven_end, h, counter):
    """Interval of at most h [s] of a cart at rest under driven_end(u)."""
    polynomial = driven_end.copy()
    polynomial[0] = state.elongation
    elongation = signals.Signal(polynomial, 0.0, 0.0, 0.0, 0.0, h)
    end, event = _breakaway(oscillator, resistance, state, driven_end, elongation, counter)
    end, event = _flank_event(oscillator, state, driven_end, elongation, end, event, counter)
    return TrialInterval(True, np.inf, 0, driven_end, elongation, end, event, 0, 0.0)


@inlined
def _slide(problem, driven_end, h, counter):
    """Interval of at most h [s] of a sliding cart under driven_end(u)."""
    driven_end, elongation, remainder, converged, evaluations = collocation.solve_sliding(
        problem, driven_end, h, counter
    )
    scale, tolerance = elongation.scale, problem.tolerance
    if not converged:
        return TrialInterval(False, scale / 2, problem.slip, driven_end, elongation, 0.0, NO_EVENT, evaluations, 0.0)
    end, event = _sliding_event(problem, driven_end, elongation, counter)
    velocity = signals.cart_velocity(elongation, driven_end)
    defect, max_speed = collocation.evaluate_defect(problem, velocity, remainder, end)
    evaluations += collocation.DEFECT_POINTS
    exit_place = collocation.range_exit(problem, velocity, counter) if defect > tolerance else 2.0
    if exit_place < end:
        end, event = exit_place, RANGE_EXIT
        defect, max_speed = collocation.evaluate_defect(problem, velocity, remainder, end)
        evaluations += collocation.DEFECT_POINTS
    ratio = collocation.step_ratio(problem, driven_end[1] / scale, defect)
    if defect > tolerance:
        step = scale * min(max(ratio, collocation.MIN_STEP_RATIO), collocation.OVERSHOOT * end)
        step = collocation.round_step(step)
    elif event == STOPPED:
        step = scale
    elif event == RANGE_EXIT or scale < h:  # the resistance ended the interval, not the step
        step = h
    else:
        before, after = abs(signals.evaluate(velocity, 0.0)), abs(signals.evaluate(velocity, end))
        step = collocation.next_step(scale, ratio, before, after)
    return TrialInterval(
        defect <= tolerance, step, problem.slip, driven_end, elongation, end, event, evaluations, max_speed
    )


@inlined
def _sliding_event(problem, driven_end, elongation, counter):
    """First event (u, event) of sliding; (1, NO_EVENT) without one."""
    oscillator, state = problem.oscillator, problem.state
    slip = 1.0 * problem.slip
    speed = signals.combine(elongation, driven_end, 0.0, -slip, 0.0, slip)
    end, event = _earlier_event(1.0, NO_EVENT, speed, STOPPED, counter)
    if oscillator.end_springs.length > 0:
        end, event = _end_spring_event(oscillator, state, driven_end, elongation, end, event, counter)
    return _flank_event(oscillator, state, driven_end, elongation, end, event, counter)


@inlined
def _breakaway(oscillator, resistance, state, driven_end, elongation, counter):
    """First breakaway (u, event) of a cart at rest; (1, NO_EVENT) without one."""
    end, event = 1.0, NO_EVENT
    springs = elements.spring_force(oscillator, state.flank, state.zone)
    highest, lowest = elements.stiction_limits(oscillator, resistance, state.zone)
    for sign, limit, candidate in ((1, highest, BREAKAWAY_FORWARD), (-1, lowest, BREAKAWAY_BACKWARD)):
        margin = signals.combine(
            elongation, driven_end, -sign * springs.stiffness, -sign * oscillator.damping,
            sign * springs.driven_end_stiffness, 0.0,
        )  # fmt: skip
        margin.polynomial[0] += sign * (limit - springs.constant)
        end, event = _earlier_event(end, event, margin, candidate, counter)
    return end, event


@compiled
def _flank_event(oscillator, state, driven_end, elongation, end, event, counter):
    """First opening or closing of the backlash, or the given event before it."""
    if oscillator.backlash > 0:
        for flank, closing in ((1, FRONT_FLANK_CLOSED), (-1, REAR_FLANK_CLOSED)):
            if state.flank == -flank:
                continue
            sign = 1.0 if state.flank == flank else -1.0
            play = signals.combine(elongation, driven_end, sign * flank, 0.0, 0.0, 0.0)
            play.polynomial[0] -= sign * oscillator.backlash / 2
            candidate = FLANK_OPENED if state.flank == flank else closing
            end, event = _earlier_event(end, event, play, candidate, counter)
    return end, event


@inlined
def _end_spring_event(oscillator, state, driven_end, elongation, end, event, counter):
    """First contact with an end spring or its loss, or the given event before it."""
    ends, zone = oscillator.end_springs, state.zone
    for spring, plate, reached in (
        (elements.NEAR_SPRING, ends.length, NEAR_SPRING_REACHED),
        (elements.FAR_SPRING, ends.stroke - ends.length, FAR_SPRING_REACHED),
    ):
        if zone == -spring:
            continue
        sign = -spring if zone == spring else spring
        gap = signals.combine(elongation, driven_end, -sign, 0.0, sign, 0.0)
        gap.polynomial[0] -= sign * plate
        candidate = END_SPRING_LEFT if zone == spring else reached
        end, event = _earlier_event(end, event, gap, candidate, counter)
    return end, event


@compiled
def _earlier_event(end, event, signal, candidate, counter):
    """First downcrossing of a signal as an event, or the given event before it."""
    u = signals.first_downcrossing(signal, counter)
    return (u, candidate) if u < end or (u == end and event == NO_EVENT) else (end, event)


@inlined
def _accept_interval(oscillator, driven_end, resistance, progress, trial, intervals):
    """Store an interval and move on to its end; repeat a doubtful breakaway over a shorter one instead."""
    reals, counts, _ = progress
    i, fraction, n = counts[PIECE], reals[FRACTION], counts[INTERVAL]
    width, scale, state = (
        driven_end.breaks[i + 1] - driven_end.breaks[i],
        trial.elongation.scale,
        current_state(progress),
    )
    stuck = state.velocity == 0 and trial.event == STOPPED and trial.end * scale < MIN_STEP * width
    if stuck and scale > STICK_STEP * width:  # rounding is smaller over a shorter interval
        reals[STEP] = scale / 8
        return
    _store(intervals, n, driven_end.breaks[i] + fraction * width, trial, state)
    counts[INTERVAL] += 1
    counts[ATTEMPTS], counts[LAST_EVENT] = 0, STUCK if stuck else trial.event
    if stuck:
        reals[STEP] = np.inf
    end = _state_after(oscillator, resistance, state, trial)
    reals[ELONGATION], reals[VELOCITY] = end.elongation, end.velocity
    counts[FLANK], counts[ZONE] = end.flank, end.zone
    complete = scale == (1 - fraction) * width and trial.event == NO_EVENT
    reached = fraction + trial.end * scale / width
    reals[FRACTION] = 1.0 if complete or reached > 1 - MIN_STEP else reached  # a remainder below it is rounding


@inlined
def _store(intervals, n, start, trial, state):
    """Store an interval in row n."""
    signal = trial.elongation
    intervals.start[n], intervals.scale[n], intervals.duration[n] = start, signal.scale, trial.end * signal.scale
    intervals.elongation[n] = 0.0
    for j in range(len(trial.driven_end)):  # assignments of arrays take seconds to compile
        intervals.driven_end[n, j] = trial.driven_end[j]
    for j in range(len(signal.polynomial)):
        intervals.elongation[n, j] = signal.polynomial[j]
    intervals.oscillation[n, 0], intervals.oscillation[n, 1] = signal.cosine, signal.sine
    intervals.oscillation[n, 2], intervals.oscillation[n, 3] = signal.decay, signal.discriminant
    intervals.slip[n], intervals.flank[n], intervals.zone[n] = trial.slip, state.flank, state.zone


@inlined
def _state_after(oscillator, resistance, state, trial):
    """State at the end of an interval."""
    elongation, velocity, flank, zone = signals.evaluate(trial.elongation, trial.end), 0.0, state.flank, state.zone
    if trial.slip != 0 and trial.event != STOPPED:
        velocity = signals.evaluate(signals.cart_velocity(trial.elongation, trial.driven_end), trial.end)
        if abs(velocity) <= REST_ROUNDING * resistance.forward.breaks[-1]:
            velocity = 0.0
    if trial.event == FLANK_OPENED:
        flank = 0
    elif trial.event in (FRONT_FLANK_CLOSED, REAR_FLANK_CLOSED):
        flank = 1 if trial.event == FRONT_FLANK_CLOSED else -1
    elif trial.event in (BREAKAWAY_FORWARD, BREAKAWAY_BACKWARD) and zone in (
        elements.AT_NEAR_PLATE,
        elements.AT_FAR_PLATE,
    ):
        compresses = (zone == elements.AT_NEAR_PLATE) == (trial.event == BREAKAWAY_BACKWARD)
        zone = (elements.NEAR_SPRING if zone == elements.AT_NEAR_PLATE else elements.FAR_SPRING) if compresses else 0
    elif trial.event in (END_SPRING_LEFT, NEAR_SPRING_REACHED, FAR_SPRING_REACHED):
        return _state_at_plate(oscillator, resistance, elements.CartState(elongation, velocity, flank, zone), trial)
    return elements.CartState(elongation, velocity, flank, zone)


@inlined
def _state_at_plate(oscillator, resistance, state, trial):
    """State of a cart that reaches or leaves the plate of an end spring; a slow one may come to rest there."""
    elongation, velocity, flank, zone = state
    plate = (
        elements.AT_NEAR_PLATE
        if trial.event == NEAR_SPRING_REACHED or zone == elements.NEAR_SPRING
        else elements.AT_FAR_PLATE
    )
    if abs(velocity) <= PLATE_REST_SPEED * resistance.forward.breaks[-1]:
        springs = elements.spring_force(oscillator, flank, plate)
        driven_end = signals.Signal(trial.driven_end, 0.0, 0.0, 0.0, 0.0, 1.0)
        driven_end_velocity = signals.evaluate(signals.differentiate(driven_end), trial.end) / trial.elongation.scale
        pull = springs.stiffness * elongation + springs.constant + oscillator.damping * driven_end_velocity
        if elements.breakaway_direction(oscillator, resistance, plate, pull) == 0:
            return elements.CartState(elongation, 0.0, flank, plate)
    reached = elements.NEAR_SPRING if trial.event == NEAR_SPRING_REACHED else elements.FAR_SPRING
    return elements.CartState(elongation, velocity, flank, 0 if trial.event == END_SPRING_LEFT else reached)


def peak_force_and_power(oscillator: elements.OscillatorParameters, intervals: Intervals) -> tuple[float, float]:
    """Find the largest |H| of drive spring and damper [N] and the largest |H y'| [W] over all intervals."""
    peaks, counter, status = np.zeros(2), signals.new_search_counter(), PAUSED
    row = np.zeros(1, np.int64)
    while status == PAUSED:  # Python handles interrupts between two calls
        status = _search_peaks(oscillator, intervals, peaks, row, counter, WORK_SLICE)
    if status != DONE:
        raise RuntimeError(
            f"the search for the peak force after {intervals.start[row[0]]:g} s did not end within "
            f"{signals.MAX_RANGES} ranges of the oscillation; increase `damping`, or use a rigid drive"
        )
    return float(peaks[0]), float(peaks[1])


@compiled
def _search_peaks(oscillator, intervals, peaks, row, counter, max_work):
    """Continue the search from an interval on by about `max_work` ranges and return its status."""
    work, damping = 0, oscillator.damping
    for i in range(row[0], len(intervals.start)):
        row[0] = i
        if work >= max_work:
            return PAUSED
        stiffness, offset = elements.engaged_spring(oscillator, intervals.flank[i])
        driven_end, scale, free = intervals.driven_end[i], intervals.scale[i], intervals.oscillation[i]
        elongation = signals.Signal(intervals.elongation[i], free[0], free[1], free[2], free[3], scale)
        force = signals.combine(elongation, driven_end, stiffness, damping, 0.0, 0.0)
        force.polynomial[0] -= stiffness * offset
        zero = signals.Signal(np.zeros(signals.SERIES_TERMS), 0.0, 0.0, 0.0, 0.0, scale)
        one, velocity = (
            signals.combine(zero, driven_end, 0.0, 0.0, 0.0, 0.0),
            signals.combine(zero, driven_end, 0.0, 0.0, 0.0, 1.0),
        )
        one.polynomial[0] = 1.0
        end = intervals.duration[i] / scale
        for which, factor in ((0, one), (1, velocity)):
            counter[signals.RANGES] = 0
            peaks[which] = max(peaks[which], signals.max_abs_product(force, factor, end, counter))
            work += signals.ZOOM_CELLS + counter[signals.RANGES]
            if counter[signals.EXHAUSTED] == 1:
                return SEARCH_EXHAUSTED
    return DONE
