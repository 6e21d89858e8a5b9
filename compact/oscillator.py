"""A damped oscillator under a polynomial force, answered exactly over one span however stiff it is.

    m e'' + c e' + k e = f(u),  f(u) = sum_j f_j u^j,  t = h u,  0 <= u <= 1

(D + fast)(D + slow) e = f/m with the roots of the oscillator. Three answers take turns, each where it is well
conditioned: a polynomial and a free oscillation where even the slow root is fast for the span; a power series where
even the fast one is slow; between them, where damping is strong, a polynomial for what the fast root makes of the force
and a power series for the slow one, beside the fast root's own decay.
"""

import numpy as np

from compact import ringing
from compact.ringing import Signal, compiling

TERMS = 30  # of a power series, at most: to rounding up to |root| h = REACH
REACH = 3.0  # |root| h from which the polynomial answer is well conditioned, and to which the series holds
NOTHING_MORE = 1e-18  # of the largest term: where a power series may end

compiled = compiling(__file__, ringing.__file__)


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
