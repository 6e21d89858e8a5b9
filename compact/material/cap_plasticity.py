"""What a compacting mix does at a point: one implicit step of the elliptic cap, for many points at once.

    f = q^2/M^2 + r y^2 - a^2 <= 0,    a = (pc + pt)/2,  c = (pc - pt)/2,  compression positive
    wet   p > c:           y = p - c,   r = 1
    flat  p0 <= p <= c:    y = 0
    dry   p < p0:          y = p - p0,  r = a^2/(p0 + pt)^2

The full ellipse has p0 = c and no flat part; the flat dry side has p0 = min(c, 0). Flow is associated, pc hardens with
the plastic volume strain V, k = k_n exp(V). All is implicit (backward Euler): with the multiplier m,

    p = p_tr - K V,  V = 2 m r y,    q = q_tr/(1 + 6 G m/M^2),    f(p, q, pc(k)) = 0,

where the trial state tr is elastic. Flow brings p and c together on either side and ends before they meet, so the side
is known, and one unknown is left: x >= 0 of V = A x/((1 + x) K), A the pressure of the trial beyond the flat part; x is
2 r K m while nothing hardens. As x grows from 0 the trial stress moves inwards, from f > 0 to y = 0 and q = 0: a root
is always there, and only one if H = dpc/dV < 12 G/M^2. With N^2 = f + a^2, a/N is nearly straight in x; Newton's method
on a/N = 1 is kept between bounds and bisects where it would leave them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compact.material.laws import HECKEL_MAX_DENSITY_RATIO, HECKEL_MIN_PRESSURE
from compact.numerics.jit import compiled
from compact.numerics.validation import require_finite, require_nonnegative, require_positive

SLACK = 1e-13  # of N against a, where Newton's method stops
ROUNDING = 4e-16  # of x, where it stops too, if N is within ROUGHEST of a: far from c, x has no more digits to give
ROUGHEST = 1e-6
NEAREST = 1e-12  # of a, from a trial to p = c: nearer ones take it, since at c itself V tells nothing of x
ATTEMPTS = 300  # of Newton's method; 4 to 6 are usual, bisection alone needs up to 200
SLICE = 20_000  # points of one compiled call: some 20 ms, half a second where each takes all attempts
LOOSEST = np.exp(-HECKEL_MIN_PRESSURE)  # (1 - k)/(1 - k0) where pc leaves Heckel's curve


@dataclass(frozen=True, eq=False)
class MaterialPoint:
    """Of n points: where they are on their way.

    stress : Cauchy (xx, yy, zz, xy), tension positive [Pa], shape (n, 4)
    density_ratio : k, shape (n,);  hardened : the k that pc remembers, shape (n,), k itself on the full ellipse
    plastic_work : of all steps, in the volume of its time [J/m3], shape (n,)
    """

    stress: np.ndarray
    density_ratio: np.ndarray
    max_density_ratio: np.ndarray
    plastic_work: np.ndarray


def initial_state(law, n):
    """The `MaterialPoint` of n points of mix as it is fed: free of stress at `law.fed_density_ratio`."""
    density_ratio = np.full(n, float(law.fed_density_ratio))
    return MaterialPoint(np.zeros((n, 4)), density_ratio, density_ratio.copy(), np.zeros(n))


def integrate_points(law, state, strain, rate_factor=1.0, tangent=True):
    """The next `MaterialPoint` and d stress/d strain, shape (n, 3, 3), of (xx, yy, xy); None without `tangent`.

    law : `Compaction`;  rate_factor : by which the speed raises pc, `law.rate_factor(speed)`
    strain : increments (xx, yy, 2 xy) of plane strain, tension positive, shape (n, 3); logarithmic in the turned frame
        where strains are finite

    The tangent is that of the step, not of the rate: unsymmetric where the cap hardens, by a share that falls with the
    increment.
    """
    require_positive(rate_factor=rate_factor)
    before = (strain, state.stress, state.density_ratio, state.max_density_ratio, state.plastic_work)
    strain, *before = (np.ascontiguousarray(values, dtype=float) for values in before)  # one layout, compiled once
    n = len(strain)
    stress, numbers = np.empty((n, 4)), np.empty((3, n))
    slopes = np.empty((n, 3, 3) if tangent else (0, 3, 3))
    given = cap_constants(law, rate_factor), *before, strain, stress, numbers, slopes
    for first in range(0, n, SLICE):  # an interrupt gets in between two calls
        failed = _sweep(first, min(first + SLICE, n), *given)
        if failed >= 0:
            _raise(failed, state, strain)
    return MaterialPoint(stress, *numbers), slopes if tangent else None


def viscous_step(law, state, strain, lag, rate_factor=1.0, tangent=True):
    """The same for a mix that lags behind (Duvaut and Lions): tau de_p/dt = C^-1 (stress - stress on the limit).

        stress = (stress_c + lag stress_tr)/(1 + lag),    k = k_n (k_c/k_n)^(1/(1 + lag)),    by backward Euler

    lag : relaxation time tau over the duration of the step, >= 0; 0 gives `step`

    The overstress is that of unloading and large: a tau [s] that slows the yielding of a layer by little is far below
    the relaxation times of a viscoelastic mix.
    """
    require_nonnegative(lag=lag)
    closest, slopes = integrate_points(law, state, strain, rate_factor, tangent)
    share, elastic = 1 / (1 + lag), _elasticity(law)
    trial = state.stress + strain @ elastic.T
    stress = share * closest.stress + (1 - share) * trial
    density_ratio = state.density_ratio * (closest.density_ratio / state.density_ratio) ** share
    hardened = density_ratio if law.dry_side == "ellipse" else np.maximum(state.max_density_ratio, density_ratio)
    work = state.plastic_work + share * _work(law, stress, trial - closest.stress)
    if tangent:
        slopes = share * slopes + (1 - share) * elastic[[0, 1, 3]]
    return MaterialPoint(stress, density_ratio, hardened, work), slopes


def _elasticity(law):
    """d stress (xx, yy, zz, xy)/d strain (xx, yy, 2 xy), shape (4, 3)."""
    K, G = cap_constants(law, 1.0)[:2]
    wide, side = K + 4 * G / 3, K - 2 * G / 3
    return np.array([[wide, side, 0], [side, wide, 0], [side, side, 0], [0, 0, G]])


def _work(law, stress, other):
    """stress : C^-1 other, shape (n,)."""
    K, G = cap_constants(law, 1.0)[:2]
    traces = stress[:, :3].sum(axis=1) * other[:, :3].sum(axis=1) / 3
    products = (stress * other) @ np.array([1.0, 1.0, 1.0, 2.0])
    return traces / (3 * K) + (products - traces) / (2 * G)


def _raise(i, state, strain):
    require_finite(strain=strain, stress=state.stress, density_ratio=state.density_ratio)
    raise RuntimeError(
        f"the yield limit is not met after a strain increment of {np.abs(strain[i]).max():.3g} from a stress of "
        f"{np.abs(state.stress[i]).max():.3g} Pa at density ratio {state.density_ratio[i]:.6g} (point {i}); take "
        "smaller increments"
    )


class Constants(NamedTuple):
    """Of a `Compaction` at one speed, for compiled code: `slope` is K_H over the rate factor, `loose` k0."""

    K: float
    G: float
    M: float
    pt: float
    slope: float
    loose: float
    flat: bool


def cap_constants(law, rate_factor):
    """The `Constants` of a law."""
    E, nu = float(law.unloading_modulus), float(law.poisson)
    return Constants(
        K=E / (3 - 6 * nu),
        G=E / (2 + 2 * nu),
        M=float(law.critical_slope),
        pt=float(law.tensile_strength),
        slope=float(law.heckel_slope / rate_factor),
        loose=float(law.loose_density_ratio),
        flat=law.dry_side == "flat",
    )


@compiled
def hardening(law, k):
    """pc and H = dpc/dV at the density ratio k: `Compaction.yield_pressure` point by point."""
    if k >= HECKEL_MAX_DENSITY_RATIO:
        stiffness = HECKEL_MAX_DENSITY_RATIO / (1 - HECKEL_MAX_DENSITY_RATIO)
        xi = np.log((1 - law.loose) / (1 - HECKEL_MAX_DENSITY_RATIO)) + stiffness * np.log(k / HECKEL_MAX_DENSITY_RATIO)
        return xi / law.slope, stiffness / law.slope
    xi = np.log((1 - law.loose) / (1 - k))
    rise = k / (1 - k) / law.slope
    if xi >= HECKEL_MIN_PRESSURE:
        return xi / law.slope, rise
    fading = np.exp(2 * (xi - HECKEL_MIN_PRESSURE) / HECKEL_MIN_PRESSURE)
    return HECKEL_MIN_PRESSURE * (1 + fading) / 2 / law.slope, rise * fading


@compiled
def _sweep(first, end, law, stress, density_ratio, hardened, work, strain, new_stress, new_numbers, slopes):
    """Each point from `first` to before `end` in turn; the first that failed, or -1."""
    for i in range(first, end):
        before = (stress[i, 0], stress[i, 1], stress[i, 2], stress[i, 3], density_ratio[i], hardened[i])
        closed, after, dissipated, slope, (sxx, syy, sxy) = integrate_point(
            law, before, strain[i, 0], strain[i, 1], strain[i, 2]
        )
        if not closed:
            return i
        for k in range(4):
            new_stress[i, k] = after[k]
        new_numbers[0, i] = after[4]
        new_numbers[1, i] = after[5]
        new_numbers[2, i] = work[i] + dissipated
        if len(slopes):
            _tangent(slopes[i], slope, sxx, syy, sxy)
    return -1


@compiled
def integrate_point(law, before, exx, eyy, gamma):
    """One point: closed or not, (xx, yy, zz, xy, k, hardened) after, plastic work, and (B, G', R, L, S) and the stress
    deviator (xx, yy, xy) of `_tangent`."""
    # elastic trial
    third = (exx + eyy) / 3
    mean = (before[0] + before[1] + before[2]) / 3
    p = -mean - 3 * law.K * third
    sxx = before[0] - mean + 2 * law.G * (exx - third)
    syy = before[1] - mean + 2 * law.G * (eyy - third)
    szz = before[2] - mean - 2 * law.G * third
    sxy = before[3] + law.G * gamma
    q = np.sqrt(1.5 * (sxx * sxx + syy * syy + szz * szz + 2 * sxy * sxy))
    memory = before[5] if law.flat else before[4]

    attempts, p, shrink, k, memory, dissipated, slope = return_map(law, p, q, before[4], memory)
    closed = attempts <= ATTEMPTS and np.isfinite(p + k + dissipated)
    sxx, syy, szz, sxy = shrink * sxx, shrink * syy, shrink * szz, shrink * sxy
    return closed, (sxx - p, syy - p, szz - p, sxy, k, memory), dissipated, slope, (sxx, syy, sxy)


@compiled
def _tangent(out, slope, sxx, syy, sxy):
    """B 1x1 + 2 G' (I - 1x1/3) + R 1xs + L sx1 + S sxs of the stress deviator s, in (xx, yy, xy)."""
    B, G, R, L, S = slope
    s = (sxx, syy, sxy)
    one = (1.0, 1.0, 0.0)
    shear = (2 * G, 2 * G, G)
    for i in range(3):
        for j in range(3):
            out[i, j] = (B - 2 * G / 3) * one[i] * one[j] + R * one[i] * s[j] + L * s[i] * one[j] + S * s[i] * s[j]
        out[i, i] += shear[i]


@compiled
def return_map(law, p, q, k, memory):
    """From the trial p and q: attempts, p, q/q_trial, k, memory, plastic work, and (B, G', R, L, S) of `_tangent`."""
    pc, _ = hardening(law, memory)
    a, c = (pc + law.pt) / 2, (pc - law.pt) / 2
    p0 = min(c, 0.0) if law.flat else c
    reach = p0 + law.pt  # of the dry side
    if law.flat and (p0 <= p <= c or (p < p0 and reach == 0)):  # no strength in tension is a wall at p = 0
        return _flat(law, p, q, k, memory, max(p, p0), law.M * a)
    start = c if p > c else p0
    r = (a / reach) ** 2 if law.flat and p < p0 else 1.0
    if q * q / law.M**2 + r * (p - start) ** 2 <= (a * (1 + 2 * SLACK)) ** 2:
        return 0, p, 1.0, k, memory, 0.0, (law.K, law.G, 0.0, 0.0, 0.0)
    beyond = max(abs(p - start), NEAREST * a)
    return _closed(law, start, beyond if p >= start else -beyond, q, k, memory, a, r)


@compiled
def _flat(law, p_trial, q_trial, k, memory, p, limit):
    """The same where the limit is q <= `limit` at the pressure p."""
    V = (p_trial - p) / law.K
    q = min(q_trial, limit)
    work = p * V + q * (q_trial - q) / (3 * law.G)
    bulk = law.K if p == p_trial else 0.0
    if q == q_trial:
        return 0, p, 1.0, k * np.exp(V), memory, work, (bulk, law.G, 0.0, 0.0, 0.0)
    shrink = q / q_trial
    return 0, p, shrink, k * np.exp(V), memory, work, (bulk, shrink * law.G, 0.0, 0.0, -3 * law.G * shrink / q**2)


@compiled
def _closed(law, start, A, q_trial, k, memory, a, r):
    """The same where the trial lies outside, at the pressure A != 0 beyond the `start` of a curved part."""
    older = np.log(memory / k) if law.flat else 0.0  # the V at which the mix is as dense as it ever was
    attempts, V, y, a, h, m, shrink, N, _ = _root(law, A, q_trial / law.M, memory, older, a, r)
    k *= np.exp(V)
    memory = max(k, memory) if law.flat else k
    a = (hardening(law, memory)[0] + law.pt) / 2
    if r == 1.0:  # c has moved
        start = a - law.pt
    p = start + y * (a / N)  # a/N takes the last rounding off the yield limit
    shrink *= a / N
    q = q_trial * shrink
    work = p * V + q * (q_trial - q) / (3 * law.G)
    return attempts, p, shrink, k, memory, work, _slopes(law, y, a, h, m, r, q, shrink)


@compiled
def _root(law, A, d_trial, memory, older, a_before, r):
    """Attempts, more than ATTEMPTS where all failed, and what `_inwards` gives at the last x."""
    low, high, x = 0.0, np.inf, 0.0
    for attempt in range(ATTEMPTS):
        there = _inwards(law, A, d_trial, memory, older, a_before, r, x)
        V, y, a, h, _, _, N, dN = there
        defect = a / N - 1 if y * A > 0 else np.inf  # past y = 0
        if defect <= 1:
            newton = x + defect * N * N * law.K * (1 + x) ** 2 / ((a * dN - h * N) * A)
        else:  # so deep inside N is the straighter one, in V
            inner = V - (N - a) / (dN - h)
            newton = law.K * inner / (A - law.K * inner) if defect < np.inf else -1.0
        still = min(abs(newton - x), high - low) <= ROUNDING * x
        if abs(defect) <= SLACK or (still and abs(defect) <= ROUGHEST):
            return attempt + 1, *there
        if defect < 0:
            low = x
        else:
            high = x
        middle = (low + high) / 2 if high < np.inf else 2 * x + 1
        x = newton if low < newton < high else middle
        if x >= high:  # nothing lies between
            x = low
    return ATTEMPTS + 1, *there


@compiled
def _inwards(law, A, d_trial, memory, older, a_before, r, x):
    """At x: V, y, a, h = da/dV, m, q/q_trial, N = sqrt(d^2 + r y^2) with d = q/M, and dN/dV."""
    b, outer = 6 * law.G / law.M**2, 1 / (1 + x)
    V = A * x * outer / law.K
    rise, H = 0.0, 0.0
    if not law.flat or older < V:
        rise, H = _rise(law, memory, V - older)
    a, h = a_before + rise / 2, H / 2
    y, dy = A * outer - rise / 2, -law.K - h
    ease = 1 / (2 * r * y)
    m = V * ease
    shrink = 1 / (1 + b * m)
    d, dm = d_trial * shrink, (1 - 2 * r * m * dy) * ease
    N = np.sqrt(d * d + r * y * y)
    return V, y, a, h, m, shrink, N, (r * y * dy - d * d * shrink * b * dm) / N


@compiled
def _rise(law, k, V):
    """pc(k exp V) - pc(k) and H at its end, without the rounding of the difference on Heckel's curve."""
    gain = k * np.expm1(V)
    sparse, dense = min(k, k + gain), max(k, k + gain)
    if dense <= HECKEL_MAX_DENSITY_RATIO and 1 - sparse < (1 - law.loose) * LOOSEST:
        return -np.log1p(-gain / (1 - k)) / law.slope, (k + gain) / (1 - k - gain) / law.slope
    pc, H = hardening(law, k + gain)
    if sparse >= HECKEL_MAX_DENSITY_RATIO:
        return H * V, H
    return pc - hardening(law, k)[0], H


@compiled
def _slopes(law, y, a, h, m, r, q, shrink):
    """(B, G', R, L, S) of `_tangent`: derivatives of p and q by the trial pair, through V = 2 m r y and f = 0."""
    K, G, M2 = law.K, law.G, law.M**2
    along = 1 + 2 * r * m * (K + h)
    Q = 6 * G * q * q * shrink / M2**2
    D = along * Q + 2 * r * y * (a * h + r * y * (K + h))
    cross = 6 * K * G * r * shrink / (M2 * D)
    return (
        K * (1 - 2 * K * r * (r * y * y + m * Q) / D),
        shrink * G,
        cross * y,
        cross * (y - 2 * a * h * m),
        -18 * G**2 * shrink**2 * along / (M2**2 * D),
    )
