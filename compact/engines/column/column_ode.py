"""What columns of a compacting mix go through between a base and something that presses them: confined compression.

A column knows no lateral strain, so its stress is p, mean, and D = s_v - s_h; columns on top of one another share
s_v = p + 2D/3. Compression positive, V plastic volume strain. On the yield limit of `cap` with the outward normal
(P, Q) = (df/dp, df/dD)/2, and with pc = pc(k), H = dpc/dV,

    dp = K (de - dV),  dD = 3G (2de/3 - Q w),  dV = P w,  P dp + Q dD = h w,  h = (p + pt) H P/2,

de the strain of the column and w >= 0 the flow. Per unit of s_v, with b = P - 3Q/2 and g = 3/2 + 2G/K,

    dp/ds_v = (3/2)(h - 2G b Q)/B,   w/ds_v = (3/2)(P + 2G Q/K)/B,   B = g h + 2G b^2,

and inside the limit dp/ds_v = 3/(2g). The strains change the heights h_i of the columns, whose sum follows the roller:
ds_v = -dgap/sum (de/ds_v) h_i. The gap of a circle rises ever more steeply with the distance x from the lowest point,
without bound where its side is upright. The path is therefore integrated over the tangent of half the angle, u = 2 R t:

    q = 1/(1 + c u^2/(4 R^2)),   x = u q,   gap = u^2 q/(2R),   dx/du = q (2q - 1),   dgap/du = u q^2/R,

c = 1 for the circle, whose side is upright at u = 2R, and c = 0 for the parabola, where u is x. The work and the forces
are integrated with the stress by the method of Dormand and Prince of order 8; each yield and the end of the rebound are
met exactly.

References
----------
E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, Springer 1993, II.5, II.10.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from compact.material.cap_plasticity import hardening
from compact.numerics.jit import compiled

STAGES, ORDER = 12, 8
A, C = np.vstack([DOP853.A, DOP853.B]), np.append(DOP853.C, 1.0)  # the last row is the step itself
E3, E5 = DOP853.E3.copy(), DOP853.E5.copy()
FIRST = 1 / 64  # share of the way that a first step may take
STEPS = 40_000  # tried; 50 are usual, a mix a thousand times stiffer to unload takes a thousand times as many
SAFETY, SLOWEST, FASTEST = 0.9, 0.2, 10.0  # of the step control
POINTS = 16  # of the trapezoids of `settling`, dense where pc may rise from next to nothing
CUTS = 60  # of a step that meets a yield; 5 are usual
MET = 1e-4  # share of the error allowed of s_v by which the end of a cut step may miss
ROUNDING = 1e-14  # share of s_v by which it may miss too

STRESS, PUSH, DRAG, PLASTIC, ELASTIC, OWN = 0, 1, 2, 3, 4, 5  # places in y; from OWN on p and V of each column
REACHED, PAUSED, TOO_MANY, COLLAPSED, UNCUT = range(5)  # how `travel` ended
ROW, EVALUATIONS, TRIED, NEXT = range(4)  # places in the counts of a `Journey`; NEXT the column that yields next
LOGARITHMIC, SMALL, MASS_TRUE = 0, 1, 2  # strain ln(h0/h); (h0 - h)/h0 with k = k0 exp V; the same with k = k0/(1 - V)


class Stack(NamedTuple):
    """Columns on top of one another at rest, shape (n,): heights [m], density ratios, mean pressures [Pa], and the
    density ratios that pc remembers, 0 where it has no memory."""

    height: np.ndarray
    density_ratio: np.ndarray
    pressure: np.ndarray
    hardened: np.ndarray


class Profile(NamedTuple):
    """gap(x) of the roller, x from the lowest point: curl c = 1 circle, 0 parabola; R = 0 a plate, whose gap is u."""

    radius: float
    curl: float


class Journey(NamedTuple):
    """State of an integration between two calls of `travel`, changed in place.

    hardened, yielding, stops : of each column: the density ratio that pc remembers, whether it yields, and the stress
    at which that changes next [Pa]
    step : over u to try next, 0 before the first and after each of these changes;  counts : see ROW
    """

    hardened: np.ndarray
    yielding: np.ndarray
    stops: np.ndarray
    step: np.ndarray
    counts: np.ndarray


def begun(stack):
    """A `Journey` that has not set off."""
    n = len(stack.height)
    return Journey(stack.hardened.copy(), np.zeros(n, np.bool_), np.empty(n), np.zeros(1), np.array([0, 0, 0, -1]))


@compiled
def travel(law, stack, profile, measure, u_to, stress_to, scale, longest, journey, path, most):
    """Columns from the last row of a path to u_to or until the stress is `stress_to` [Pa]: how it ended.

    path : rows of (u, y), one for each step, the last at `journey.counts[ROW]`
    y : (s_v, int s_v dx, int s_v gap' dx, plastic work, elastic work, p_1, V_1, ...), SI, V from `stack`
    scale : of y, the errors of a step that are allowed;  longest : step over u

    PAUSED after trying as many steps as `most`, or where the path is full, to go on by the same call. The others end
    it: REACHED; TOO_MANY steps; COLLAPSED, steps too short to move u; UNCUT, a stress not met. It returns a bare
    number: making an array of a result runs Python, where an interrupt would be lost.
    """
    hardened, yielding, stops, _, counts = journey
    n = len(stops)
    y = path[counts[ROW], 1:]
    way = 1.0 if stress_to > y[STRESS] else -1.0
    # what yields as near to the end as this does not: at rest a column without strength is on its yield limit
    before = stress_to - way * max(MET * scale[STRESS], ROUNDING * abs(path[0, 1 + STRESS]))
    if counts[NEXT] < 0:
        for i in range(n):
            stops[i] = _yield_stress(law, measure, stack, y, i, way)
        counts[NEXT] = _next(stops, before, way)
    column, last = (law, stack, hardened, profile, measure, yielding), counts[TRIED] + most
    for _ in range(3 * n + 1):  # a column yields once, turns to the wet side once
        k = counts[NEXT]
        ended = _follow(path, journey, u_to, stress_to if k == n else stops[k], way, longest, column, scale, last)
        if ended != REACHED or k == n or path[counts[ROW], 0] == u_to:
            return ended
        stops[k] = way * np.inf
        if not yielding[k]:
            yielding[k] = True
            stops[k] = _wet_stress(law, measure, stack, path[counts[ROW], 1:], k, way)
        counts[NEXT] = _next(stops, before, way)
        journey.step[0] = 0.0
    return TOO_MANY


@compiled
def _next(stops, before, way):
    """The column that yields before all others and `before` a stress, or their number where none does."""
    found, stop = len(stops), before
    for i in range(len(stops)):
        if way * (stop - stops[i]) > 0:
            found, stop = i, stops[i]
    return found


@compiled
def _follow(path, journey, u_to, stop, way, longest, column, scale, last):
    """How it ended, REACHED where s_v is `stop` or u is u_to; the steps until then are on the path."""
    law, stack, hardened, _, measure, _ = column
    counts = journey.counts
    u, y = path[counts[ROW], 0], path[counts[ROW], 1:].copy()
    z, K = np.empty(len(y)), np.empty((STAGES + 1, len(y)))
    _rates(u, y, K[0], column)
    step = journey.step[0] if journey.step[0] != 0 else (u_to - u) * FIRST
    while u != u_to and not way * (stop - y[STRESS]) <= 0:
        if counts[TRIED] >= STEPS:
            return TOO_MANY
        if counts[TRIED] >= last or counts[ROW] + 1 == len(path):
            journey.step[0] = step
            return PAUSED
        counts[TRIED] += 1
        step = np.sign(u_to - u) * min(abs(step), abs(u_to - u), longest)
        if u + step == u:
            return COLLAPSED
        error = _step(u, step, y, z, K, column, scale)
        counts[EVALUATIONS] += STAGES
        if error <= 1:
            if way * (stop - z[STRESS]) <= 0:
                met, step, cuts = _cut(u, step, y, z, K, column, scale, stop)
                counts[EVALUATIONS] += STAGES * cuts
                if not met:
                    return UNCUT
                z[STRESS] = stop
            u = u_to if step == u_to - u else u + step
            for m in range(len(y)):
                y[m], K[0, m] = z[m], K[STAGES, m]
            for i in range(len(hardened)):
                if law.flat:
                    k = _density_ratio(measure, stack.density_ratio[i], y[OWN + 2 * i + 1])
                    hardened[i] = max(hardened[i], k)
            counts[ROW] += 1
            path[counts[ROW], 0] = u
            for m in range(len(y)):
                path[counts[ROW], m + 1] = y[m]
        step *= min(FASTEST, max(SLOWEST, SAFETY * max(error, 1e-20) ** (-1 / ORDER)))
    return REACHED


@compiled
def _step(u, step, y, z, K, column, scale):
    """One step of Dormand and Prince from y, with K[0] there, to z, with K[STAGES] there; its error over `scale`."""
    for stage in range(1, STAGES + 1):
        for m in range(len(y)):
            slope = 0.0
            for before in range(stage):
                slope += A[stage, before] * K[before, m]
            z[m] = y[m] + step * slope
        _rates(u + C[stage] * step, z, K[stage], column)
    third, fifth = 0.0, 0.0
    for m in range(len(y)):
        of_third, of_fifth = 0.0, 0.0
        for stage in range(STAGES + 1):
            of_third += E3[stage] * K[stage, m]
            of_fifth += E5[stage] * K[stage, m]
        third += (of_third / scale[m]) ** 2
        fifth += (of_fifth / scale[m]) ** 2
    if fifth == 0:
        return 0.0
    error = abs(step) * fifth / np.sqrt((fifth + 0.01 * third) * len(y))
    return error if error >= 0 else np.inf  # not a number: a step too far


@compiled
def _cut(u, step, y, z, K, column, scale, stress):
    """Whether a part of a step ends at s_v = `stress`, that part by regula falsi (Illinois), and the tries; z and
    K[STAGES] are there after."""
    low, high, below, above = 0.0, step, y[STRESS] - stress, z[STRESS] - stress
    near = max(MET * scale[STRESS], ROUNDING * max(abs(stress), abs(y[STRESS])))
    for cuts in range(CUTS + 1):
        if abs(above) <= near or low == high:
            return True, high, cuts
        middle = high - above * (high - low) / (above - below)
        _step(u, middle, y, z, K, column, scale)
        miss = z[STRESS] - stress
        if miss * above < 0:
            low, below = high, above
        else:
            below /= 2
        high, above = middle, miss
    return False, high, CUTS


@compiled
def _rates(u, y, out, column):
    """dy/du."""
    law, stack, hardened, profile, measure, yielding = column
    stress, yielded, stored, give = y[STRESS], 0.0, 0.0, 0.0
    for i in range(len(stack.height)):
        p, V = y[OWN + 2 * i], y[OWN + 2 * i + 1]
        dp, dV, dshear = _flow(law, measure, stack.density_ratio[i], hardened[i], stress, p, V, yielding[i])
        height = stack.height[i]
        if measure == LOGARITHMIC:
            height *= np.exp(-(V + (p - stack.pressure[i]) / law.K))
        D = 1.5 * (stress - p)
        give += height * (dp / law.K + dV)
        yielded += height * (p * dV + D * dshear)
        stored += height * (p * dp / law.K + D * (1 - dp) / (2 * law.G))
        out[OWN + 2 * i], out[OWN + 2 * i + 1] = dp, dV
    along, rise = 1.0, 1.0  # dx/du, dgap/du
    if profile.radius > 0:
        t = u / profile.radius
        q = 1 / (1 + profile.curl * t * t / 4)
        along, rise = q * (2 * q - 1), t * q * q
    rate = -rise / give
    out[STRESS], out[PUSH], out[DRAG] = rate, stress * along, stress * rise
    out[PLASTIC], out[ELASTIC] = yielded * rate, stored * rate
    for m in range(OWN, len(y)):
        out[m] *= rate


@compiled
def settling(law, k):
    """Powers of e by which p of a given s_v settles on the way from the density ratio k to 1.

        int 4 G A (1 + 9/(4 M^2))/(g B (pc + pt)) dV,    A = s_v/pc, B = (p + pt)/(pc + pt) of the rigid-plastic column

    where b = 0: the slope of dp/ds_v by p, times ds_v = A H dV. An explicit step can take some six.
    """
    M2, total, before, rate_before = law.M**2, 0.0, k, 0.0
    root = np.sqrt(9 + 4 * M2)
    share = (1 + root / 3) / (1 + 3 / root)
    for point in range(POINTS + 1):
        ratio = k + (1 - k) * (point / POINTS) ** 3
        rate = 1 / (hardening(law, ratio)[0] + law.pt)
        total += (rate + rate_before) / 2 * np.log(ratio / before)
        before, rate_before = ratio, rate
    return 4 * law.G * share * (1 + 9 / (4 * M2)) / (1.5 + 2 * law.G / law.K) * total


@compiled
def _flow(law, measure, k0, hardened, stress, p, V, yielding):
    """dp, dV and the plastic shear Q w per unit of s_v; the letters are the module's."""
    ratio, g = 2 * law.G / law.K, 1.5 + 2 * law.G / law.K
    if not yielding:
        return 1.5 / g, 0.0, 0.0
    k = _density_ratio(measure, k0, V)
    pc, H = hardening(law, max(k, hardened))
    if k < hardened:
        H = 0.0
    elif measure == MASS_TRUE:
        H *= k / k0
    a, c, p0 = _shape(law, pc)
    P, Q = p - c, 1.5 * (stress - p) / law.M**2
    if law.flat and p <= c:
        P = min(p - p0, 0.0)
        if p0 > -law.pt:
            P *= (a / (p0 + law.pt)) ** 2
        elif p <= p0:  # no strength: a wall
            P, Q = -1.0, 0.0
    h, b = (p + law.pt) * H * P / 2, P - 1.5 * Q
    w = 1.5 / (g * h + 2 * law.G * b * b)
    return w * (h - 2 * law.G * b * Q), w * (P + ratio * Q) * P, w * (P + ratio * Q) * Q


@compiled
def _density_ratio(measure, k0, V):
    return k0 / (1 - V) if measure == MASS_TRUE else k0 * np.exp(V)


@compiled
def _shape(law, pc):
    """Of the yield limit: half its length a, its highest point c, and where its dry side begins."""
    c = (pc - law.pt) / 2
    return (pc + law.pt) / 2, c, min(c, 0.0) if law.flat else c


@compiled
def _yield_stress(law, measure, stack, y, i, way):
    """s_v at which column i yields on the way up (`way` 1) or down (-1): a root of a quadratic on one of the sides."""
    p, V = y[OWN + 2 * i], y[OWN + 2 * i + 1]
    k = _density_ratio(measure, stack.density_ratio[i], V)
    a, c, p0 = _shape(law, hardening(law, max(k, stack.hardened[i]))[0])
    C = law.K + 4 * law.G / 3
    D, dp, dD = 1.5 * (y[STRESS] - p), way * law.K / C, way * 2 * law.G / C
    wet = _exit(p - c, D / law.M, 1.0, dp, dD / law.M, a)
    if not law.flat or p + wet * dp >= c:
        return y[STRESS] + way * wet
    if p0 > -law.pt:
        dry = _exit(p - p0, D / law.M, (a / (p0 + law.pt)) ** 2, dp, dD / law.M, a)
        if p + dry * dp <= p0:
            return y[STRESS] + way * dry
    elif way < 0:
        wall = max((p0 - p) / dp, 0.0)
        if abs(D + wall * dD) <= law.M * a:
            return y[STRESS] + way * wall
    return y[STRESS] + way * _exit(0.0, D / law.M, 0.0, dp, dD / law.M, a)


@compiled
def _wet_stress(law, measure, stack, y, i, way):
    """s_v at which column i, yielding on the way up, leaves the flat side, where D and pc stay and dp = ds_v."""
    p, V = y[OWN + 2 * i], y[OWN + 2 * i + 1]
    k = _density_ratio(measure, stack.density_ratio[i], V)
    _, c, _ = _shape(law, hardening(law, max(k, stack.hardened[i]))[0])
    return y[STRESS] + c - p if law.flat and way > 0 and p < c else way * np.inf


@compiled
def _exit(y, z, r, dy, dz, a):
    """The largest t >= 0 at which r (y + t dy)^2 + (z + t dz)^2 = a^2."""
    square, half, rest = r * dy * dy + dz * dz, r * y * dy + z * dz, r * y * y + z * z - a * a
    return max(0.0, (np.sqrt(max(half * half - square * rest, 0.0)) - half) / square)
