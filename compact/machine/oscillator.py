"""A damped oscillator under a polynomial force: exact response, roots and maxima of its signals.

    m e'' + c e' + k e = f(u),   f(u) = sum_j f_j u^j,   t = h u,   0 <= u <= 1

The response, and every linear combination of it and of its derivatives, is a signal

    q(u) = sum_j p_j u^j + A g0(t) + B g1(t)
    g0 = e^(-d t) cos(w t),   g1 = e^(-d t) sin(w t)/w,   w^2 = -D,   cosh and sinh for D > 0

All functions are compiled and take a signal as an array: decay d, discriminant D, h, A, B, p_0, p_1, ... Searches
bisect the range of u and drop each part where bounds of polynomial and envelope exclude a result. Their cost grows with
the number of candidates, not with the number of oscillations.

References
----------
M. Dowell and P. Jarratt, BIT 11 (1971) 168: the Illinois variant of the false position method.
"""

import math

import numpy as np

from compact.numerics import Array
from compact.numerics.jit import compiled, internal

MAX_RANGES = 500_000  # [-], of the search for one event or maximum; covers `MAX_SAMPLES`, 1300 observed
SHORT_RANGE = 1 / 8  # [-], of u; longest part that is searched by its end values
SHORT_OSCILLATION = 0.5  # [rad]; longest part of an oscillation that is searched by its end values
ZERO_TOLERANCE = 1e-14  # [-], of the magnitude of a signal; rounding
ROOT_ITERATIONS = 80  # [-], of the bracketing of a root; to rounding
STACK_DEPTH = 200  # [-], of the stack of ranges
MAXIMUM_TOLERANCE = 1e-10  # [-], relative; a larger value within it is not searched for
ZOOM_CELLS, ZOOM_STEPS = 8, 14  # [-], of the search for a maximum on a short range; each step refines by four
SERIES_TERMS = 30  # [-], of a power series; to rounding up to |root| h = SERIES_REACH
SERIES_REACH = 3.0  # [-], |root| h; the polynomial form is well conditioned above, the power series below
SERIES_TOLERANCE = 1e-18  # [-], of the largest term; end of a power series
DECAY, DISCRIMINANT, SCALE, COSINE, SINE, POLYNOMIAL = range(6)  # indices of a signal
SEARCH_ENDED = f"no event found in {MAX_RANGES} ranges of an oscillation; increase `damping`, or use a rigid drive"


@internal
def free_oscillation(decay: float, discriminant: float, t: float) -> tuple[float, float]:
    """g0 [-] and g1 [s] at time t [s], in a form without overflow for a decaying oscillator."""
    if discriminant < 0:
        w, amplitude = math.sqrt(-discriminant), math.exp(-decay * t)
        return amplitude * math.cos(w * t), amplitude * math.sin(w * t) / w
    if discriminant > 0:
        q = math.sqrt(discriminant)
        slow, fast = math.exp(-(decay - q) * t), -math.expm1(-2 * q * t)
        return slow * (1 - fast / 2), slow * fast / (2 * q)
    return math.exp(-decay * t), math.exp(-decay * t) * t


@internal
def evaluate(signal: Array, u: float) -> float:
    """q(u)."""
    total = 0.0
    for j in range(len(signal) - 1, POLYNOMIAL - 1, -1):
        total = total * u + signal[j]
    if signal[COSINE] != 0 or signal[SINE] != 0:
        g0, g1 = free_oscillation(signal[DECAY], signal[DISCRIMINANT], signal[SCALE] * u)
        total += signal[COSINE] * g0 + signal[SINE] * g1
    return total


@internal
def transform(signal: Array, a: float, b: float, constant: float) -> Array:
    """Return a q + b dq/dt + constant, with g0' = -d g0 + D g1, g1' = g0 - d g1."""
    out, n, rate = signal.copy(), len(signal), b / signal[SCALE]
    for j in range(POLYNOMIAL, n):
        out[j] = a * signal[j]
        if j + 1 < n:
            out[j] += rate * (j - POLYNOMIAL + 1) * signal[j + 1]
    out[POLYNOMIAL] += constant
    out[COSINE] = a * signal[COSINE] + b * (signal[SINE] - signal[DECAY] * signal[COSINE])
    out[SINE] = a * signal[SINE] + b * (signal[DISCRIMINANT] * signal[COSINE] - signal[DECAY] * signal[SINE])
    return out


@internal
def combine(signal: Array, driven_end: Array, a: float, b: float, c: float, d: float, constant: float) -> Array:
    """Return a q + b dq/dt + c y + d dy/dt + constant."""
    out = transform(signal, a, b, constant)
    for j in range(len(driven_end)):
        out[POLYNOMIAL + j] += c * driven_end[j]
        if j > 0:
            out[POLYNOMIAL + j - 1] += d / signal[SCALE] * j * driven_end[j]
    return out


@compiled
def substitute(polynomial: Array, start: float, width: float) -> Array:
    """Coefficients of p(start + width u), in ascending order as those of p."""
    out = polynomial.copy()
    n, scale = len(out), 1.0
    for i in range(n):
        for j in range(n - 2, i - 1, -1):
            out[j] += start * out[j + 1]
    for j in range(n):
        out[j] *= scale
        scale *= width
    return out


@internal
def _envelope(signal, low, high):
    """Upper bound of |A g0 + B g1| for low <= u <= high."""
    cosine, sine = abs(signal[COSINE]), abs(signal[SINE])
    if cosine == 0 and sine == 0:
        return 0.0
    decay, discriminant, scale = signal[DECAY], signal[DISCRIMINANT], signal[SCALE]
    latest, frequency = high * scale, math.sqrt(abs(discriminant))
    slowest = decay - frequency if discriminant > 0 else decay
    amplitude = math.exp(-slowest * scale * (low if slowest > 0 else high))
    if frequency * latest < 1:
        return amplitude * (cosine + sine * latest)
    if discriminant < 0:
        return amplitude * math.hypot(cosine, sine / frequency)
    return amplitude * (cosine + sine / frequency)


@internal
def _bounds(signal, low, high):
    """Lower and upper bound of q for low <= u <= high."""
    centred = substitute(signal[POLYNOMIAL:], (low + high) / 2, (high - low) / 2)
    radius = _envelope(signal, low, high)
    for j in range(1, len(centred)):
        radius += abs(centred[j])
    return centred[0] - radius, centred[0] + radius


@internal
def _is_short(signal, low, high):
    """Return true for a range so short that its end values determine the extrema of the signal."""
    if high - low > SHORT_RANGE:
        return False
    if signal[DISCRIMINANT] >= 0 or (signal[COSINE] == 0 and signal[SINE] == 0):
        return True
    return math.sqrt(-signal[DISCRIMINANT]) * signal[SCALE] * (high - low) <= SHORT_OSCILLATION


@internal
def _sign_change(signal, low, high):
    """Root of q between low and high by the Illinois method, or low without a change of sign."""
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
def first_downcrossing(signal: Array) -> float:
    """Smallest u at which q falls from >= 0 to < 0; 2.0 without one."""
    size = _envelope(signal, 0.0, 1.0)
    for j in range(POLYNOMIAL + 1, len(signal)):
        size += abs(signal[j])
    if signal[POLYNOMIAL] - size > 0:
        return 2.0
    zero = ZERO_TOLERANCE * (size + abs(signal[POLYNOMIAL]))
    rate = transform(signal, 0.0, signal[SCALE], 0.0)
    stack = np.empty((STACK_DEPTH, 2))
    stack[0, 0], stack[0, 1], top = 0.0, 1.0, 1
    for _ in range(MAX_RANGES):
        if top == 0:
            return 2.0
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        lowest, highest = _bounds(signal, low, high)
        if lowest >= -zero or highest < -zero:  # one sign throughout, but for rounding
            continue
        if not (_is_short(signal, low, high) or top + 2 > STACK_DEPTH):
            middle = (low + high) / 2
            stack[top, 0], stack[top, 1], stack[top + 1, 0], stack[top + 1, 1] = middle, high, low, middle
            top += 2
            continue
        first, last = evaluate(signal, low), evaluate(signal, high)  # at most one extremum between
        if first < -zero and last < -zero and evaluate(rate, low) < 0:
            continue
        if last < -zero and first > zero:
            return _sign_change(signal, low, high)
        extremum = _sign_change(rate, low, high)
        here = evaluate(signal, extremum)
        if last < -zero:  # q is zero at the start, where the sign of its slope may be rounding; its extremum decides
            if here > zero:
                return _sign_change(signal, extremum, high)
            if first >= -zero:
                return low
        elif here < -zero and first >= -zero and evaluate(rate, high) > 0:
            return _sign_change(signal, low, extremum) if first > zero else low
    raise RuntimeError(SEARCH_ENDED)


@internal
def _product_bound(one, two, low, high):
    """Upper bound of |q1 q2| on a range."""
    a, b = _bounds(one, low, high), _bounds(two, low, high)
    return max(abs(a[0]), abs(a[1])) * max(abs(b[0]), abs(b[1]))


@compiled
def max_abs_product(one: Array, two: Array, until: float) -> tuple[float, int]:
    """Largest |q1 q2| for 0 <= u <= until, and the number of searched ranges."""
    best, stack = 0.0, np.empty((STACK_DEPTH, 3))
    stack[0, 0], stack[0, 1], stack[0, 2], top = 0.0, until, np.inf, 1
    for count in range(MAX_RANGES):
        if top == 0:
            return best, count
        top -= 1
        low, high, highest = stack[top, 0], stack[top, 1], stack[top, 2]
        if highest <= best * (1 + MAXIMUM_TOLERANCE):
            continue
        short = (_is_short(one, low, high) and _is_short(two, low, high)) or top + 2 > STACK_DEPTH
        first, last = low, high
        for _ in range(ZOOM_STEPS if short else 1 if count == 0 else 0):
            width, place = (last - first) / ZOOM_CELLS, first
            largest = -1.0
            for i in range(ZOOM_CELLS + 1):
                here = abs(evaluate(one, first + width * i) * evaluate(two, first + width * i))
                if here > largest:
                    largest, place = here, first + width * i
            best = max(best, largest)
            first, last = max(first, place - width), min(last, place + width)
        if not short:
            middle = (low + high) / 2
            left, right = _product_bound(one, two, low, middle), _product_bound(one, two, middle, high)
            upper = 0 if left < right else 1  # the half with the larger bound is on top of the stack
            stack[top + upper, 0], stack[top + upper, 1], stack[top + upper, 2] = low, middle, left
            stack[top + 1 - upper, 0], stack[top + 1 - upper, 1], stack[top + 1 - upper, 2] = middle, high, right
            top += 2
    raise RuntimeError(SEARCH_ENDED)


@internal
def characteristic_roots(mass: float, damping: float, stiffness: float) -> tuple[float, float, float, float]:
    """Decay d, discriminant D, and the smaller and the larger |root| [1/s] of the oscillator."""
    decay, square = damping / (2 * mass), stiffness / mass
    discriminant = decay**2 - square
    if discriminant <= 0:
        return decay, discriminant, math.sqrt(square), math.sqrt(square)
    fast = abs(decay) + math.sqrt(discriminant)
    return decay, discriminant, square / fast, fast


@internal
def solve_oscillator(
    mass: float, damping: float, stiffness: float, force: Array, elongation: float, rate: float, h: float
) -> Array:
    """Signal of m e'' + c e' + k e = f(u) over h [s] from the initial elongation [m] and rate [m/s].

    Three forms are well conditioned: both roots fast, a polynomial particular solution and a free oscillation; both
    slow, a power series; one of each, a polynomial w = e' + slow e, solved from its highest order, and a power series.
    """
    decay, discriminant, slow, fast = characteristic_roots(mass, damping, stiffness)
    n, series, w = len(force), np.zeros(POLYNOMIAL + SERIES_TERMS), np.zeros(len(force) + 2)
    series[DECAY], series[DISCRIMINANT], series[SCALE] = decay, discriminant, h
    p = series[POLYNOMIAL:]
    count, largest = SERIES_TERMS, 0.0
    if slow * h >= SERIES_REACH:
        for j in range(n - 1, -1, -1):
            higher = damping / h * (j + 1) * w[j + 1] + mass / h**2 * (j + 1) * (j + 2) * w[j + 2]
            w[j] = (force[j] - higher) / stiffness
            p[j] = w[j]
        series[COSINE], count = elongation - p[0], n
        series[SINE] = rate - p[1] / h + decay * series[COSINE]
    elif fast * h > SERIES_REACH:
        for j in range(n - 1, -1, -1):
            w[j] = (force[j] / mass - (j + 1) / h * w[j + 1]) / fast
        half_gap = (fast - slow) / 2
        fast_part = (w[0] - slow * elongation - rate) / (fast - slow)
        series[DECAY], series[DISCRIMINANT] = (fast + slow) / 2, half_gap**2
        series[COSINE], series[SINE], p[0] = fast_part, -half_gap * fast_part, elongation - fast_part
        for j in range(SERIES_TERMS - 1):
            applied = w[j] if j < n else 0.0
            p[j + 1] = h * (applied - slow * p[j]) / (j + 1)
            largest = max(largest, abs(p[j + 1]))
            if j >= n and abs(p[j + 1]) <= SERIES_TOLERANCE * largest:
                count = j + 2
                break
    else:
        p[0], p[1] = elongation, rate * h
        drag, restoring = damping / mass * h, stiffness / mass * h**2
        for j in range(SERIES_TERMS - 2):
            applied = force[j] * h**2 / mass if j < n else 0.0
            p[j + 2] = (applied - drag * (j + 1) * p[j + 1] - restoring * p[j]) / ((j + 1) * (j + 2))
            largest = max(largest, abs(p[j + 2]))
            if j >= n and abs(p[j + 1]) + abs(p[j + 2]) <= SERIES_TOLERANCE * largest:
                count = j + 3
                break
    return series[: POLYNOMIAL + count].copy()
