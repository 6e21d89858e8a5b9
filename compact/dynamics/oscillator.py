"""A damped oscillator under a polynomial force: exact response, roots and extrema of its signals.

    m e'' + c e' + k e = f(u),   f(u) = sum_j f_j u^j,   t = h u,   0 <= u <= 1

The response and every linear combination of it and of its derivatives are signals

    q(u) = sum_j p_j u^j + A g0(t) + B g1(t)
    g0 = e^(-s t) cos(w t),   g1 = e^(-s t) sin(w t)/w,   w^2 = -D,   cosh and sinh for D = s^2 - w0^2 > 0

`solve_oscillator` selects one of three forms that is well conditioned for the step h and the characteristic roots:

- both roots fast: a polynomial particular solution and a free oscillation;
- both roots slow: a power series;
- one fast and one slow root (strong damping): a polynomial for the fast root, a power series for the slow one.

Searches bisect the range of u and drop each part where bounds of polynomial and envelope exclude a result. The cost
grows with the number of candidates, not with the number of oscillations. A search ends after `MAX_RANGES` parts, which
its counter records.

References
----------
The bracketing root finder is the Illinois variant of the false position method: M. Dowell and P. Jarratt, BIT 11
(1971) 168.
"""

from typing import NamedTuple

import numpy as np

from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, inlined

SHORT_RANGE = 1 / 8  # [-], of u; longest part that is searched by its end values
SHORT_OSCILLATION = 0.5  # [rad]; longest part of an oscillation that is searched by its end values
ZERO_TOLERANCE = 1e-14  # [-], of the magnitude of a signal; rounding
ROOT_ITERATIONS = 80  # [-], of the bracketing of a root; to rounding
STACK_DEPTH = 200  # [-], of the stack of ranges
MAXIMUM_TOLERANCE = 1e-10  # [-], relative; a larger value within it is not searched for
ZOOM_CELLS, ZOOM_STEPS = 8, 14  # [-], of the search for a maximum on a short range; each step refines by four
MAX_RANGES = 500_000  # [-], of the searches for one event or maximum; covers `trajectory.MAX_SAMPLES`, 1300 observed
ZOOM_COST = 20  # [-], ranges; cost of the search for a maximum on a short range
RANGES, EXHAUSTED = range(2)  # indices of a search counter: ranges searched, 1 after a search without result

SERIES_TERMS = 30  # [-], of a power series; to rounding up to |root| h = SERIES_REACH
SERIES_REACH = 3.0  # [-], |root| h; the polynomial form is well conditioned above, the power series below
SERIES_TOLERANCE = 1e-18  # [-], of the largest term; end of a power series


class Signal(NamedTuple):
    """Polynomial and free oscillation over 0 <= u <= 1.

    Parameters
    ----------
    polynomial : ndarray, shape (n,)
        Coefficients p, lowest order first.
    cosine, sine : float
        Coefficients A and B of g0 and g1.
    decay : float
        s [1/s].
    discriminant : float
        D = s^2 - w0^2 [1/s^2].
    scale : float
        Time [s] over which u increases by 1.
    """

    polynomial: Array
    cosine: float
    sine: float
    decay: float
    discriminant: float
    scale: float


def new_search_counter() -> IntArray:
    """Counter of a new search, shape (2,), indexed by `RANGES` and `EXHAUSTED`."""
    return np.zeros(2, np.int64)


@compiled
def free_oscillation(decay: float, discriminant: float, t: float) -> tuple[float, float]:
    """g0 and g1 at time t [s], in a form without overflow for a decaying oscillator.

    Parameters
    ----------
    decay : float
        Decay s [1/s].
    discriminant : float
        D = s^2 - w0^2 [1/s^2].
    t : float
        Time [s].

    Returns
    -------
    tuple of float
        g0 [-] and g1 [s].
    """
    if discriminant < 0:
        w, amplitude = np.sqrt(-discriminant), np.exp(-decay * t)
        return amplitude * np.cos(w * t), amplitude * np.sin(w * t) / w
    if discriminant > 0:
        q = np.sqrt(discriminant)
        slow, fast = np.exp(-(decay - q) * t), -np.expm1(-2 * q * t)
        return slow * (1 - fast / 2), slow * fast / (2 * q)
    return np.exp(-decay * t), np.exp(-decay * t) * t


@compiled
def evaluate(signal: Signal, u: float) -> float:
    """q(u)."""
    total = 0.0
    for j in range(len(signal.polynomial) - 1, -1, -1):
        total = total * u + signal.polynomial[j]
    if signal.cosine != 0 or signal.sine != 0:
        g0, g1 = free_oscillation(signal.decay, signal.discriminant, signal.scale * u)
        total += signal.cosine * g0 + signal.sine * g1
    return total


@compiled
def differentiate(signal: Signal) -> Signal:
    """dq/du as a signal: g0' = -s g0 + D g1, g1' = g0 - s g1."""
    n, A, B = len(signal.polynomial), signal.cosine, signal.sine
    polynomial = np.zeros(n)
    for j in range(1, n):
        polynomial[j - 1] = j * signal.polynomial[j]
    cosine = signal.scale * (B - signal.decay * A)
    sine = signal.scale * (signal.discriminant * A - signal.decay * B)
    return Signal(polynomial, cosine, sine, signal.decay, signal.discriminant, signal.scale)


@compiled
def combine(elongation: Signal, driven_end: Array, a: float, b: float, c: float, d: float) -> Signal:
    """Return a e + b de/dt + c y + d dy/dt for the signal e and the polynomial y(u) of one interval.

    Parameters
    ----------
    elongation : Signal
        Elongation e(u) [m].
    driven_end : ndarray
        Coefficients of the driven-end position y(u) [m].
    a : float
        Factor of e [-].
    b : float
        Factor of de/dt [s].
    c : float
        Factor of y [-].
    d : float
        Factor of dy/dt [s].

    Returns
    -------
    Signal
    """
    rate, h = differentiate(elongation), elongation.scale
    polynomial = a * elongation.polynomial + b / h * rate.polynomial
    for j in range(len(driven_end)):
        polynomial[j] += c * driven_end[j]
        if j > 0:
            polynomial[j - 1] += d / h * j * driven_end[j]
    cosine, sine = a * elongation.cosine + b / h * rate.cosine, a * elongation.sine + b / h * rate.sine
    return Signal(polynomial, cosine, sine, elongation.decay, elongation.discriminant, h)


@compiled
def cart_velocity(elongation: Signal, driven_end: Array) -> Signal:
    """Return the velocity of the cart, y' - e' [m/s], as a signal."""
    return combine(elongation, driven_end, 0.0, -1.0, 0.0, 1.0)


@compiled
def multiply(signal: Signal, factor: float) -> Signal:
    """Multiply a signal by a number."""
    return Signal(
        factor * signal.polynomial, factor * signal.cosine, factor * signal.sine, signal.decay, signal.discriminant,
        signal.scale,
    )  # fmt: skip


@compiled
def add(one: Signal, two: Signal) -> Signal:
    """Sum of two signals of the same oscillator."""
    return Signal(
        one.polynomial + two.polynomial, one.cosine + two.cosine, one.sine + two.sine, one.decay, one.discriminant,
        one.scale,
    )  # fmt: skip


@compiled
def substitute(polynomial: Array, start: float, width: float) -> Array:
    """Coefficients of p(start + width u).

    Parameters
    ----------
    polynomial : ndarray
        Coefficients of p in ascending order.
    start : float
        Value of the argument at u = 0 [-].
    width : float
        Increase of the argument over u from 0 to 1 [-].

    Returns
    -------
    ndarray
        Coefficients over u.
    """
    out = polynomial.copy()
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
def bounds(signal: Signal, low: float, high: float) -> tuple[float, float]:
    """Lower and upper bound of q for low <= u <= high.

    Parameters
    ----------
    signal : Signal
        Signal q(u).
    low : float
        Lower end of the range of u [-].
    high : float
        Upper end of the range of u [-].

    Returns
    -------
    tuple of float
        Bounds of q.
    """
    centred = substitute(signal.polynomial, (low + high) / 2, (high - low) / 2)
    radius = envelope(signal, low, high)
    for j in range(1, len(centred)):
        radius += abs(centred[j])
    return centred[0] - radius, centred[0] + radius


@compiled
def envelope(signal: Signal, low: float, high: float) -> float:
    """Upper bound of |A g0 + B g1| for low <= u <= high.

    Parameters
    ----------
    signal : Signal
        Signal q(u).
    low : float
        Lower end of the range of u [-].
    high : float
        Upper end of the range of u [-].

    Returns
    -------
    float
        Bound.
    """
    if signal.cosine == 0 and signal.sine == 0:
        return 0.0
    latest, frequency = high * signal.scale, np.sqrt(abs(signal.discriminant))
    slowest = signal.decay - frequency if signal.discriminant > 0 else signal.decay
    amplitude = np.exp(-slowest * signal.scale * (low if slowest > 0 else high))
    if frequency * latest < 1:
        return amplitude * (abs(signal.cosine) + abs(signal.sine) * latest)
    if signal.discriminant < 0:
        return amplitude * np.hypot(signal.cosine, signal.sine / frequency)
    return amplitude * (abs(signal.cosine) + abs(signal.sine) / frequency)


@compiled
def is_short(signal: Signal, low: float, high: float) -> bool:
    """Return true for a range so short that its end values determine the extrema of the signal.

    Parameters
    ----------
    signal : Signal
        Signal q(u).
    low : float
        Lower end of the range of u [-].
    high : float
        Upper end of the range of u [-].

    Returns
    -------
    bool
    """
    if high - low > SHORT_RANGE:
        return False
    if signal.discriminant >= 0 or (signal.cosine == 0 and signal.sine == 0):
        return True
    return np.sqrt(-signal.discriminant) * signal.scale * (high - low) <= SHORT_OSCILLATION


@compiled
def magnitude(signal: Signal) -> float:
    """Upper bound of |q| for 0 <= u <= 1."""
    return np.abs(signal.polynomial).sum() + envelope(signal, 0.0, 1.0)


@compiled
def find_sign_change(signal: Signal, low: float, high: float) -> float:
    """Root of q between low and high by the Illinois method, or low without a change of sign.

    Parameters
    ----------
    signal : Signal
        Signal q(u).
    low : float
        Lower end of the range of u [-].
    high : float
        Upper end of the range of u [-].

    Returns
    -------
    float
        u of the root [-].
    """
    at_low, at_high = evaluate(signal, low), evaluate(signal, high)
    if (at_low > 0) == (at_high > 0):
        return low
    for _ in range(ROOT_ITERATIONS):
        place = high - at_high * (high - low) / (at_high - at_low)
        if not low < place < high:
            place = (low + high) / 2
        here = evaluate(signal, place)
        if here == 0 or high - low <= 2e-16 * high:
            return place
        if (here > 0) == (at_high > 0):
            high, at_high, at_low = place, here, at_low / 2
        else:
            low, at_low, at_high = place, here, at_high / 2
    return (low + high) / 2


@compiled
def first_downcrossing(signal: Signal, counter: IntArray) -> float:
    """Smallest u at which q falls from >= 0 to < 0; 2.0 without one, or after an exhausted search."""
    if signal.polynomial[0] - (np.abs(signal.polynomial[1:]).sum() + envelope(signal, 0.0, 1.0)) > 0:
        return 2.0
    rate, zero = differentiate(signal), ZERO_TOLERANCE * magnitude(signal)
    stack = np.empty((STACK_DEPTH, 2))
    stack[0, 0], stack[0, 1], top = 0.0, 1.0, 1
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        if is_exhausted(counter):
            return 2.0
        lowest, highest = bounds(signal, low, high)
        if lowest >= -zero or highest < -zero:  # one sign throughout, but for rounding
            continue
        if is_short(signal, low, high) or top + 2 > STACK_DEPTH:
            place = _short_downcrossing(signal, rate, low, high, zero)
            if place <= 1:
                return place
            continue
        middle = (low + high) / 2
        stack[top, 0], stack[top, 1], stack[top + 1, 0], stack[top + 1, 1] = middle, high, low, middle
        top += 2
    return 2.0


@compiled
def is_exhausted(counter: IntArray) -> bool:
    """Count one more range and return true once a search exceeds `MAX_RANGES`."""
    counter[RANGES] += 1
    if counter[RANGES] > MAX_RANGES:
        counter[EXHAUSTED] = 1
    return counter[EXHAUSTED] == 1


@compiled
def _short_downcrossing(signal, rate, low, high, zero):
    """First downcrossing on a range with one extremum at most; 2.0 without one."""
    first, last = evaluate(signal, low), evaluate(signal, high)
    if first < -zero and last < -zero and evaluate(rate, low) < 0:
        return 2.0
    if last < -zero and first > zero:
        return find_sign_change(signal, low, high)
    extremum = find_sign_change(rate, low, high)
    here = evaluate(signal, extremum)
    if last < -zero:  # q is zero at the start, where the sign of its slope may be rounding; its extremum decides
        return find_sign_change(signal, extremum, high) if here > zero else low if first >= -zero else 2.0
    if here < -zero and first >= -zero and evaluate(rate, high) > 0:
        return find_sign_change(signal, low, extremum) if first > zero else low
    return 2.0


@compiled
def max_abs_product(one: Signal, two: Signal, until: float, counter: IntArray) -> float:
    """Compute the largest |q1 q2| for 0 <= u <= until; a lower bound if the search exceeds its limit.

    Parameters
    ----------
    one : Signal
        First factor.
    two : Signal
        Second factor.
    until : float
        Upper end of u [-].
    counter : ndarray
        Search counter, modified in place.

    Returns
    -------
    float
        Largest |q1 q2|.
    """
    best = 0.0
    for i in range(ZOOM_CELLS + 1):
        best = max(best, abs(evaluate(one, until * i / ZOOM_CELLS) * evaluate(two, until * i / ZOOM_CELLS)))
    stack = np.empty((STACK_DEPTH, 3))
    stack[0, 0], stack[0, 1], stack[0, 2], top = 0.0, until, _product_bound(one, two, 0.0, until), 1
    while top > 0:
        top -= 1
        low, high, highest = stack[top, 0], stack[top, 1], stack[top, 2]
        if highest <= best * (1 + MAXIMUM_TOLERANCE):
            continue
        if is_exhausted(counter):
            return best
        if (is_short(one, low, high) and is_short(two, low, high)) or top + 2 > STACK_DEPTH:
            best = max(best, _short_maximum(one, two, low, high))
            counter[RANGES] += ZOOM_COST
            continue
        middle = (low + high) / 2
        left, right = _product_bound(one, two, low, middle), _product_bound(one, two, middle, high)
        first = 0 if left < right else 1  # the half with the larger bound is on top of the stack
        stack[top + first, 0], stack[top + first, 1], stack[top + first, 2] = low, middle, left
        stack[top + 1 - first, 0], stack[top + 1 - first, 1], stack[top + 1 - first, 2] = middle, high, right
        top += 2
    return best


@compiled
def _product_bound(one, two, low, high):
    """Upper bound of |q1 q2| on a range."""
    a, b = bounds(one, low, high), bounds(two, low, high)
    return max(abs(a[0]), abs(a[1])) * max(abs(b[0]), abs(b[1]))


@compiled
def _short_maximum(one, two, low, high):
    """Largest |q1 q2| on a short range, by refinement around the largest sample."""
    best, place = 0.0, low
    for _ in range(ZOOM_STEPS):
        width = (high - low) / ZOOM_CELLS
        for i in range(ZOOM_CELLS + 1):
            u = low + width * i
            here = abs(evaluate(one, u) * evaluate(two, u))
            if here > best:
                best, place = here, u
        low, high = max(low, place - width), min(high, place + width)
    return best


@compiled
def characteristic_roots(mass: float, damping: float, stiffness: float) -> tuple[float, float, float, float]:
    """Decay s, discriminant D, and the smaller and the larger |root| [1/s] of the oscillator.

    Parameters
    ----------
    mass : float
        Mass m [kg].
    damping : float
        Damping c [N s/m].
    stiffness : float
        Stiffness k [N/m].

    Returns
    -------
    tuple of float
        s [1/s], D [1/s^2] and both |roots| [1/s].
    """
    decay, square = damping / (2 * mass), stiffness / mass
    discriminant = decay**2 - square
    if discriminant <= 0:
        return decay, discriminant, np.sqrt(square), np.sqrt(square)
    fast = abs(decay) + np.sqrt(discriminant)
    return decay, discriminant, square / fast, fast


@compiled
def limit_step(mass: float, damping: float, stiffness: float, h: float) -> float:
    """Step h [s], shortened for a growing oscillation to the reach of the power series.

    Parameters
    ----------
    mass : float
        Mass m [kg].
    damping : float
        Damping c [N s/m].
    stiffness : float
        Stiffness k [N/m].
    h : float
        Length of the interval [s].

    Returns
    -------
    float
        Step [s].
    """
    decay, _, slow, fast = characteristic_roots(mass, damping, stiffness)
    return h if decay > 0 or slow * h >= SERIES_REACH or fast * h <= SERIES_REACH else SERIES_REACH / fast


@compiled
def solve_oscillator(
    mass: float, damping: float, stiffness: float, force: Array, elongation: float, rate: float, h: float
) -> Signal:
    """Elongation over h [s] from its initial value [m] and rate [m/s] under force(u), a polynomial [N].

    The step h must not exceed `limit_step`. The polynomial of the result has at least as many terms as the force.
    """
    decay, discriminant, slow, fast = characteristic_roots(mass, damping, stiffness)
    if slow * h >= SERIES_REACH:
        return _particular_and_free(mass, damping, stiffness, force, elongation, rate, h)
    if fast * h > SERIES_REACH:
        return _overdamped_series(mass, slow, fast, force, elongation, rate, h)
    polynomial = _power_series(mass, damping, stiffness, force, elongation, rate, h)
    return Signal(polynomial, 0.0, 0.0, decay, discriminant, h)


@inlined
def _particular_and_free(mass, damping, stiffness, force, elongation, rate, h):
    """Polynomial particular solution and free oscillation."""
    decay, discriminant, _, _ = characteristic_roots(mass, damping, stiffness)
    n = len(force)
    polynomial = np.zeros(n + 2)
    for j in range(n - 1, -1, -1):
        higher = damping / h * (j + 1) * polynomial[j + 1] + mass / h**2 * (j + 1) * (j + 2) * polynomial[j + 2]
        polynomial[j] = (force[j] - higher) / stiffness
    cosine = elongation - polynomial[0]
    return Signal(polynomial[:n], cosine, rate - polynomial[1] / h + decay * cosine, decay, discriminant, h)


@inlined
def _power_series(mass, damping, stiffness, force, elongation, rate, h):
    """Power series of the response in u."""
    series, n = np.zeros(SERIES_TERMS), len(force)
    series[0], series[1] = elongation, rate * h
    drag, restoring, largest = damping / mass * h, stiffness / mass * h**2, 0.0
    for j in range(SERIES_TERMS - 2):
        applied = force[j] * h**2 / mass if j < n else 0.0
        series[j + 2] = (applied - drag * (j + 1) * series[j + 1] - restoring * series[j]) / ((j + 1) * (j + 2))
        largest = max(largest, abs(series[j + 2]))
        if j >= n and abs(series[j + 1]) + abs(series[j + 2]) <= SERIES_TOLERANCE * largest:
            return series[: j + 3]
    return series


@inlined
def _overdamped_series(mass, slow, fast, force, elongation, rate, h):
    """Response for fast h > SERIES_REACH > slow h.

    w = e' + slow e is a polynomial, solved from its highest order; e is a power series, solved from its lowest.
    """
    n = len(force)
    w, series = np.zeros(n + 1), np.zeros(SERIES_TERMS)
    for j in range(n - 1, -1, -1):
        w[j] = (force[j] / mass - (j + 1) / h * w[j + 1]) / fast
    half_gap = (fast - slow) / 2
    fast_part = (w[0] - slow * elongation - rate) / (fast - slow)
    series[0], largest, count = elongation - fast_part, 0.0, SERIES_TERMS
    for j in range(SERIES_TERMS - 1):
        applied = w[j] if j < n else 0.0
        series[j + 1] = h * (applied - slow * series[j]) / (j + 1)
        largest = max(largest, abs(series[j + 1]))
        if j >= n and abs(series[j + 1]) <= SERIES_TOLERANCE * largest:
            count = j + 2
            break
    return Signal(series[:count], fast_part, -half_gap * fast_part, (fast + slow) / 2, half_gap**2, h)
