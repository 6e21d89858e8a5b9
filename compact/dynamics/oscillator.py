"""Signals of a damped oscillator under a polynomial force: their value, first fall below zero and largest value.

    q(u) = sum_j p_j u^j + A g0(t) + B g1(t),  t = span u,  0 <= u <= 1
    g0 = e^(-s t) cos(w t),  g1 = e^(-s t) sin(w t)/w,  w^2 = -bend,  or cosh and sinh for bend > 0

Stretch, speed and force of a spring and any linear combination of them are such signals, and so is their derivative.
A range of u is left out of a search when bounds of polynomial and envelope allow no find in it, so that the cost of a
search grows with what may be found, not with the number of oscillations. Where rounding lets it grow nevertheless, a
search ends after `MOST_RANGES` ranges, and its `effort` records that.

A damped oscillator under a polynomial force, answered exactly over one span however stiff it is.

    m e'' + c e' + k e = f(u),  f(u) = sum_j f_j u^j,  t = h u,  0 <= u <= 1

(D + fast)(D + slow) e = f/m with the roots of the oscillator. Three answers take turns, each where it is well
conditioned: a polynomial and a free oscillation where even the slow root is fast for the span; a power series where
even the fast one is slow; between them, where damping is strong, a polynomial for what the fast root makes of the force
and a power series for the slow one, beside the fast root's own decay.
"""

from typing import NamedTuple

import numpy as np

from compact.numerics.jit import compiled

SHORT = 1 / 8  # longest range of u that is searched by its ends; of an oscillation, in rad: OSCILLATION
OSCILLATION = 0.5
ROUNDING = 1e-14  # of the size of a signal: less is zero
HALVINGS = 80  # of a range that holds a root: to rounding
DEPTH = 200  # of the stack of ranges
NEARLY = 1e-10  # relative: what can be larger by less is left out
CELLS, ZOOMS = 8, 14  # of the search for a top on a short range: each zoom goes four times closer
MOST_RANGES = 500_000  # [-], of the searches for one event or top: all that `course.MOST_SAMPLES` has; 1300 were met
TOP = 20  # [-], ranges that cost as much as the search for a top on a short one
RANGES, EXHAUSTED = range(2)  # of an `effort`: ranges searched; 1 where a search ended before it had searched all


class Signal(NamedTuple):
    """poly : p, lowest first;  cosine, sine : A, B;  decay, bend : s [1/s], s^2 - w0^2 [1/s^2];  span [s]."""

    poly: np.ndarray
    cosine: float
    sine: float
    decay: float
    bend: float
    span: float


def effort():
    """Counts of searches that have not begun, shape (2,): RANGES and EXHAUSTED."""
    return np.zeros(2, np.int64)


@compiled
def swings(decay, bend, t):
    """g0 and g1 at time t [s]: nothing grows that the oscillator lets fall."""
    if bend < 0:
        w, fall = np.sqrt(-bend), np.exp(-decay * t)
        return fall * np.cos(w * t), fall * np.sin(w * t) / w
    if bend > 0:
        q = np.sqrt(bend)
        slow, fast = np.exp(-(decay - q) * t), -np.expm1(-2 * q * t)
        return slow * (1 - fast / 2), slow * fast / (2 * q)
    return np.exp(-decay * t), np.exp(-decay * t) * t


@compiled
def value(signal, u):
    """q(u)."""
    total = 0.0
    for j in range(len(signal.poly) - 1, -1, -1):
        total = total * u + signal.poly[j]
    if signal.cosine != 0 or signal.sine != 0:
        g0, g1 = swings(signal.decay, signal.bend, signal.span * u)
        total += signal.cosine * g0 + signal.sine * g1
    return total


@compiled
def slope(signal):
    """dq/du as a signal: g0' = -s g0 + bend g1, g1' = g0 - s g1."""
    n, A, B = len(signal.poly), signal.cosine, signal.sine
    poly = np.zeros(n)
    for j in range(1, n):
        poly[j - 1] = j * signal.poly[j]
    cosine = signal.span * (B - signal.decay * A)
    sine = signal.span * (signal.bend * A - signal.decay * B)
    return Signal(poly, cosine, sine, signal.decay, signal.bend, signal.span)


@compiled
def combined(stretch, law, a, b, c, d):
    """a e + b de/dt + c y + d dy/dt for the signal e and the polynomial y(u) of one span."""
    rate, h = slope(stretch), stretch.span
    poly = a * stretch.poly + b / h * rate.poly
    for j in range(len(law)):
        poly[j] += c * law[j]
        if j > 0:
            poly[j - 1] += d / h * j * law[j]
    cosine, sine = a * stretch.cosine + b / h * rate.cosine, a * stretch.sine + b / h * rate.sine
    return Signal(poly, cosine, sine, stretch.decay, stretch.bend, h)


@compiled
def scaled(signal, by):
    """A signal times a number."""
    return Signal(by * signal.poly, by * signal.cosine, by * signal.sine, signal.decay, signal.bend, signal.span)


@compiled
def sum_of(one, two):
    """Sum of two signals of the same oscillator."""
    return Signal(one.poly + two.poly, one.cosine + two.cosine, one.sine + two.sine, one.decay, one.bend, one.span)


@compiled
def shifted(poly, start, width):
    """Coefficients of p(start + width u)."""
    out = poly.copy()
    n = len(out)
    for i in range(n):
        for j in range(n - 2, i - 1, -1):
            out[j] += start * out[j + 1]
    scale = 1.0
    for j in range(n):
        out[j] *= scale
        scale *= width
    return out


@compiled
def bounds(signal, low, high):
    """Numbers between which q stays for low <= u <= high."""
    about = shifted(signal.poly, (low + high) / 2, (high - low) / 2)
    reach = envelope(signal, low, high)
    for j in range(1, len(about)):
        reach += abs(about[j])
    return about[0] - reach, about[0] + reach


@compiled
def envelope(signal, low, high):
    """What |A g0 + B g1| does not exceed for low <= u <= high."""
    if signal.cosine == 0 and signal.sine == 0:
        return 0.0
    latest, swing = high * signal.span, np.sqrt(abs(signal.bend))
    slowest = signal.decay - swing if signal.bend > 0 else signal.decay
    most = np.exp(-slowest * signal.span * (low if slowest > 0 else high))
    if swing * latest < 1:
        return most * (abs(signal.cosine) + abs(signal.sine) * latest)
    return (
        most * np.hypot(signal.cosine, signal.sine / swing)
        if signal.bend < 0
        else (most * (abs(signal.cosine) + abs(signal.sine) / swing))
    )


@compiled
def short(signal, low, high):
    """Whether a range is so short that its ends tell where the signal turns."""
    if high - low > SHORT:
        return False
    if signal.bend >= 0 or (signal.cosine == 0 and signal.sine == 0):
        return True
    return np.sqrt(-signal.bend) * signal.span * (high - low) <= OSCILLATION


@compiled
def size(signal):
    """How large q may get within the span, roughly."""
    return np.abs(signal.poly).sum() + envelope(signal, 0.0, 1.0)


@compiled
def change(signal, low, high):
    """The place between low and high where q changes its sign, low where it does not: Illinois' rule, to rounding."""
    at_low, at_high = value(signal, low), value(signal, high)
    if (at_low > 0) == (at_high > 0):
        return low
    for _ in range(HALVINGS):
        place = high - at_high * (high - low) / (at_high - at_low)
        if not low < place < high:
            place = (low + high) / 2
        here = value(signal, place)
        if here == 0 or high - low <= 2e-16 * high:
            return place
        if (here > 0) == (at_high > 0):
            high, at_high, at_low = place, here, at_low / 2
        else:
            low, at_low, at_high = place, here, at_high / 2
    return (low + high) / 2


@compiled
def first_fall(signal, effort):
    """The least u at which q falls from >= 0 to below, 2.0 where it never does or the `effort` is exhausted."""
    if signal.poly[0] - (np.abs(signal.poly[1:]).sum() + envelope(signal, 0.0, 1.0)) > 0:
        return 2.0
    rate, zero = slope(signal), ROUNDING * size(signal)
    stack = np.empty((DEPTH, 2))
    stack[0, 0], stack[0, 1], top = 0.0, 1.0, 1
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        if exhausted(effort):
            return 2.0
        least, most = bounds(signal, low, high)
        if least >= -zero or most < -zero:  # all of it is above zero or below, but for rounding
            continue
        if short(signal, low, high) or top + 2 > DEPTH:
            place = _fall(signal, rate, low, high, zero)
            if place <= 1:
                return place
            continue
        middle = (low + high) / 2
        stack[top, 0], stack[top, 1], stack[top + 1, 0], stack[top + 1, 1] = middle, high, low, middle
        top += 2
    return 2.0


@compiled
def exhausted(effort):
    """Whether a search must end; counts one more range."""
    effort[RANGES] += 1
    if effort[RANGES] > MOST_RANGES:
        effort[EXHAUSTED] = 1
    return effort[EXHAUSTED] == 1


@compiled
def _fall(signal, rate, low, high, zero):
    """The same on a short range, where q turns once at most."""
    first, last = value(signal, low), value(signal, high)
    if first < -zero and last < -zero and value(rate, low) < 0:
        return 2.0
    if last < -zero and first > zero:
        return change(signal, low, high)
    turn = change(rate, low, high)
    here = value(signal, turn)
    if last < -zero:  # it begins at zero, where its slope may be one of rounding: what it does next decides
        return change(signal, turn, high) if here > zero else low if first >= -zero else 2.0
    if here < -zero and first >= -zero and value(rate, high) > 0:
        return change(signal, low, turn) if first > zero else low
    return 2.0


@compiled
def largest_product(one, two, until, effort):
    """Largest |q1 q2| for 0 <= u <= until, of those found where the `effort` is exhausted."""
    best = 0.0
    for i in range(CELLS + 1):
        best = max(best, abs(value(one, until * i / CELLS) * value(two, until * i / CELLS)))
    stack = np.empty((DEPTH, 3))
    stack[0, 0], stack[0, 1], stack[0, 2], top = 0.0, until, _most(one, two, 0.0, until), 1
    while top > 0:
        top -= 1
        low, high, most = stack[top, 0], stack[top, 1], stack[top, 2]
        if most <= best * (1 + NEARLY):
            continue
        if exhausted(effort):
            return best
        if (short(one, low, high) and short(two, low, high)) or top + 2 > DEPTH:
            best = max(best, _top(one, two, low, high))
            effort[RANGES] += TOP
            continue
        middle = (low + high) / 2
        left, right = _most(one, two, low, middle), _most(one, two, middle, high)
        first = 0 if left < right else 1  # the better half lies on top of the stack
        stack[top + first, 0], stack[top + first, 1], stack[top + first, 2] = low, middle, left
        stack[top + 1 - first, 0], stack[top + 1 - first, 1], stack[top + 1 - first, 2] = middle, high, right
        top += 2
    return best


@compiled
def _most(one, two, low, high):
    a, b = bounds(one, low, high), bounds(two, low, high)
    return max(abs(a[0]), abs(a[1])) * max(abs(b[0]), abs(b[1]))


@compiled
def _top(one, two, low, high):
    """Largest |q1 q2| on a short range, by zooming in on the best of CELLS + 1 places."""
    best, place = 0.0, low
    for _ in range(ZOOMS):
        width = (high - low) / CELLS
        for i in range(CELLS + 1):
            u = low + width * i
            here = abs(value(one, u) * value(two, u))
            if here > best:
                best, place = here, u
        low, high = max(low, place - width), min(high, place + width)
    return best


TERMS = 30  # of a power series, at most: to rounding up to |root| h = REACH
REACH = 3.0  # |root| h from which the polynomial answer is well conditioned, and to which the series holds
NOTHING_MORE = 1e-18  # of the largest term: where a power series may end


@compiled
def roots(mass, damping, stiffness):
    """Decay s, bend s^2 - w0^2, and the smaller and larger |root| of the oscillator."""
    decay, square = damping / (2 * mass), stiffness / mass
    bend = decay**2 - square
    if bend <= 0:
        return decay, bend, np.sqrt(square), np.sqrt(square)
    fast = abs(decay) + np.sqrt(bend)
    return decay, bend, square / fast, fast


@compiled
def reach(mass, damping, stiffness, h):
    """h, or less where none of the answers of `respond` holds for it: a motion that feeds itself."""
    decay, _, slow, fast = roots(mass, damping, stiffness)
    return h if decay > 0 or slow * h >= REACH or fast * h <= REACH else REACH / fast


@compiled
def respond(mass, damping, stiffness, force, stretch, rate, h):
    """Stretch as a `Signal` over h [s] from its start value and rate under force(u), a polynomial [N].

    h is within what `reach` gives; the polynomial of the answer has no fewer terms than the force.
    """
    decay, bend, slow, fast = roots(mass, damping, stiffness)
    if slow * h >= REACH:
        return _settled(mass, damping, stiffness, force, stretch, rate, h)
    if fast * h > REACH:
        return _crept(mass, slow, fast, force, stretch, rate, h)
    return Signal(_series(mass, damping, stiffness, force, stretch, rate, h), 0.0, 0.0, decay, bend, h)


@compiled
def _settled(mass, damping, stiffness, force, stretch, rate, h):
    decay, bend, _, _ = roots(mass, damping, stiffness)
    n = len(force)
    poly = np.zeros(n + 2)
    for j in range(n - 1, -1, -1):
        later = damping / h * (j + 1) * poly[j + 1] + mass / h**2 * (j + 1) * (j + 2) * poly[j + 2]
        poly[j] = (force[j] - later) / stiffness
    cosine = stretch - poly[0]
    return Signal(poly[:n], cosine, rate - poly[1] / h + decay * cosine, decay, bend, h)


@compiled
def _series(mass, damping, stiffness, force, stretch, rate, h):
    poly, n = np.zeros(TERMS), len(force)
    poly[0], poly[1] = stretch, rate * h
    drag, hold, largest = damping / mass * h, stiffness / mass * h**2, 0.0
    for j in range(TERMS - 2):
        pushed = force[j] * h**2 / mass if j < n else 0.0
        poly[j + 2] = (pushed - drag * (j + 1) * poly[j + 1] - hold * poly[j]) / ((j + 1) * (j + 2))
        largest = max(largest, abs(poly[j + 2]))
        if j >= n and abs(poly[j + 1]) + abs(poly[j + 2]) <= NOTHING_MORE * largest:
            return poly[: j + 3]
    return poly


@compiled
def _crept(mass, slow, fast, force, stretch, rate, h):
    """w = (D + slow) e: its polynomial from its end, as fast h > REACH; then e from its start, as slow h < REACH."""
    n = len(force)
    w, poly = np.zeros(n + 1), np.zeros(TERMS)
    for j in range(n - 1, -1, -1):
        w[j] = (force[j] / mass - (j + 1) / h * w[j + 1]) / fast
    swing = (fast - slow) / 2
    gone = (w[0] - slow * stretch - rate) / (fast - slow)  # with the fast root
    poly[0], largest, count = stretch - gone, 0.0, TERMS
    for j in range(TERMS - 1):
        pushed = w[j] if j < n else 0.0
        poly[j + 1] = h * (pushed - slow * poly[j]) / (j + 1)
        largest = max(largest, abs(poly[j + 1]))
        if j >= n and abs(poly[j + 1]) <= NOTHING_MORE * largest:
            count = j + 2
            break
    return Signal(poly[:count], gone, -swing * gone, (fast + slow) / 2, swing**2, h)
