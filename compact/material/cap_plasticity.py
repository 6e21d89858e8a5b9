"""Elliptic cap plasticity with Heckel hardening: implicit integration of many material points.

    f = q^2/M^2 + r y^2 - a^2 <= 0,    a = (pc + pt)/2,  c = (pc - pt)/2,  compression positive
    cap             p > c:           y = p - c,   r = 1
    flat part       p0 <= p <= c:    y = 0
    subcritical     p < p0:          y = p - p0,  r = a^2/(p0 + pt)^2

p is the mean pressure and q the von Mises stress. The full ellipse has p0 = c and no flat part; otherwise p0 =
min(c, 0). Flow is associated; pc hardens with the plastic volumetric strain V, k = k_n exp(V). Return mapping by
backward Euler with the plastic multiplier m gives

    p = p_tr - K V,  V = 2 m r y,    q = q_tr/(1 + 6 G m/M^2),    f(p, q, pc(k)) = 0,

where tr denotes the elastic trial state. Plastic flow moves p and c towards one another and ends before they coincide,
so that the trial state determines the side. One unknown remains: x >= 0 of V = A x/((1 + x) K), with A the trial
pressure beyond the flat part; without hardening x = 2 r K m. As x grows from 0 the stress moves inwards, from f > 0 to
y = 0 and q = 0. A root always exists, and is unique if H = dpc/dV < 12 G/M^2. With N^2 = f + a^2 the ratio a/N is
nearly linear in x; Newton's method on a/N = 1 is safeguarded by bisection.

References
----------
J. C. Simo and T. J. R. Hughes, Computational Inelasticity, Springer 1998, chapter 3 (return mapping);
R. W. Heckel, Trans. Metall. Soc. AIME 221 (1961) 671 (hardening curve).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compact.material.laws import HECKEL_MAX_DENSITY_RATIO, HECKEL_MIN_PRESSURE, Compaction
from compact.numerics import Array
from compact.numerics.jit import compiled
from compact.numerics.validation import require_finite, require_positive

RESIDUAL_TOLERANCE = 1e-13  # [-], |a/N - 1| at convergence of Newton's method
STEP_TOLERANCE = 4e-16  # [-], relative change of x at convergence; far from c, x has no more digits
RESIDUAL_ACCEPTED = 1e-6  # [-], |a/N - 1| accepted with STEP_TOLERANCE
MIN_TRIAL_DISTANCE = 1e-12  # [-], |p_tr - c| over a; closer trial states use it, since V determines no x at c itself
MAX_ITERATIONS = 300  # [-], of Newton's method; 4 to 6 are usual, bisection alone needs up to 200
BATCH_POINTS = 20_000  # [-], points of one compiled call; some 20 ms, so that an interrupt is handled between calls
MIN_POROSITY_RATIO = np.exp(-HECKEL_MIN_PRESSURE)  # [-], (1 - k)/(1 - k0) where pc leaves Heckel's curve


@dataclass(frozen=True, eq=False)
class MaterialPoint:
    """State of n material points.

    Parameters
    ----------
    stress : ndarray, shape (n, 4)
        Cauchy stress xx, yy, zz, xy, tension positive [Pa].
    density_ratio : ndarray, shape (n,)
        Density ratio k [-].
    max_density_ratio : ndarray, shape (n,)
        Largest density ratio so far [-], which determines pc; k itself on the full ellipse.
    plastic_work : ndarray, shape (n,)
        Accumulated plastic work per current volume [J/m3].
    """

    stress: Array
    density_ratio: Array
    max_density_ratio: Array
    plastic_work: Array


def initial_state(law: Compaction, n: int) -> MaterialPoint:
    """Return n stress-free points at the initial density ratio of a law."""
    density_ratio = np.full(n, float(law.fed_density_ratio))
    return MaterialPoint(np.zeros((n, 4)), density_ratio, density_ratio.copy(), np.zeros(n))


def integrate_points(
    law: Compaction, state: MaterialPoint, strain: Array, rate_factor: float = 1.0, tangent: bool = True
) -> tuple[MaterialPoint, Array | None]:
    """Integrate the constitutive law over one strain increment.

    Parameters
    ----------
    strain : ndarray, shape (n, 3)
        Increments xx, yy, 2 xy of plane strain, tension positive [-]; logarithmic, in the rotated frame, where strains
        are finite.
    rate_factor : float
        Factor of pc at the speed, `law.rate_factor(speed)` [-].
    tangent : bool
        True to compute the consistent tangent.

    Returns
    -------
    state : MaterialPoint
        State after the increment.
    tangent : ndarray, shape (n, 3, 3), or None
        Algorithmic tangent d stress/d strain of (xx, yy, xy) [Pa]. It is unsymmetric where the cap hardens, by a share
        that decreases with the increment.
    """
    require_positive(rate_factor=rate_factor)
    before = (strain, state.stress, state.density_ratio, state.max_density_ratio, state.plastic_work)
    strain, *arrays = (np.ascontiguousarray(values, dtype=float) for values in before)  # one layout, compiled once
    n, constants = len(strain), cap_constants(law, rate_factor)
    stress, scalars = np.empty((n, 4)), np.empty((3, n))
    tangents = np.empty((n, 3, 3) if tangent else (0, 3, 3))
    for first in range(0, n, BATCH_POINTS):
        end = min(first + BATCH_POINTS, n)
        failed = _integrate_batch(first, end, constants, tuple(arrays), strain, (stress, scalars, tangents))
        if failed >= 0:
            require_finite(strain=strain, stress=state.stress, density_ratio=state.density_ratio)
            raise RuntimeError(
                f"the return mapping did not converge for a strain increment of {np.abs(strain[failed]).max():.3g} "
                f"from a stress of {np.abs(state.stress[failed]).max():.3g} Pa at density ratio "
                f"{state.density_ratio[failed]:.6g} (point {failed}); use smaller increments"
            )
    return MaterialPoint(stress, *scalars), tangents if tangent else None


class CapConstants(NamedTuple):
    """CapConstants of a `Compaction` at one speed, for compiled code.

    Parameters
    ----------
    K, G : float
        Bulk and shear modulus of unloading [Pa].
    M : float
        Slope of the critical state [-].
    pt : float
        Isotropic tensile strength [Pa].
    slope : float
        Heckel's slope K_H over the rate factor [1/Pa].
    loose : float
        Density ratio k0 at which Heckel's curve starts [-].
    flat : bool
        True for a flat subcritical side.
    """

    K: float
    G: float
    M: float
    pt: float
    slope: float
    loose: float
    flat: bool


def cap_constants(law: Compaction, rate_factor: float) -> CapConstants:
    """Return the `CapConstants` of a law at a rate factor [-]."""
    E, nu = float(law.unloading_modulus), float(law.poisson)
    return CapConstants(
        K=E / (3 - 6 * nu),
        G=E / (2 + 2 * nu),
        M=float(law.critical_slope),
        pt=float(law.tensile_strength),
        slope=float(law.heckel_slope / rate_factor),
        loose=float(law.loose_density_ratio),
        flat=law.dry_side == "flat",
    )


@compiled
def hardening(law: CapConstants, k: float) -> tuple[float, float]:
    """Evaluate pc and dpc/dV [Pa] of one point at a density ratio [-], as `Compaction.yield_pressure`."""
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
def _integrate_batch(first, end, law, state, strain, results):
    """Integrate points `first` to `end` - 1; return the first that did not converge, or -1."""
    stress, density_ratio, max_density_ratio, work = state
    new_stress, new_scalars, tangents = results
    for i in range(first, end):
        before = (stress[i, 0], stress[i, 1], stress[i, 2], stress[i, 3], density_ratio[i], max_density_ratio[i])
        converged, after, dissipated, coefficients, (sxx, syy, sxy) = integrate_point(
            law, before, strain[i, 0], strain[i, 1], strain[i, 2]
        )
        if not converged:
            return i
        for j in range(4):
            new_stress[i, j] = after[j]
        new_scalars[0, i] = after[4]
        new_scalars[1, i] = after[5]
        new_scalars[2, i] = work[i] + dissipated
        if len(tangents):
            _tangent(tangents[i], coefficients, sxx, syy, sxy)
    return -1


@compiled
def integrate_point(law: CapConstants, before: tuple, exx: float, eyy: float, gamma: float) -> tuple:
    """Integrate the constitutive law at one point.

    Parameters
    ----------
    before : tuple of float
        Stress xx, yy, zz, xy [Pa], density ratio and largest density ratio [-] before the increment.
    exx, eyy, gamma : float
        Strain increment xx, yy, 2 xy [-].

    Returns
    -------
    converged : bool
        False if the return mapping did not converge.
    after : tuple of float
        State after the increment, as `before`.
    plastic_work : float
        Plastic work of the increment [J/m3].
    coefficients : tuple of float
        B, G', R, L, S of the tangent B 1x1 + 2 G' (I - 1x1/3) + R 1xs + L sx1 + S sxs.
    deviator : tuple of float
        Stress deviator s of the tangent, xx, yy, xy [Pa].
    """
    # elastic trial
    third = (exx + eyy) / 3
    mean = (before[0] + before[1] + before[2]) / 3
    p = -mean - 3 * law.K * third
    sxx = before[0] - mean + 2 * law.G * (exx - third)
    syy = before[1] - mean + 2 * law.G * (eyy - third)
    szz = before[2] - mean - 2 * law.G * third
    sxy = before[3] + law.G * gamma
    q = np.sqrt(1.5 * (sxx * sxx + syy * syy + szz * szz + 2 * sxy * sxy))
    densest = before[5] if law.flat else before[4]

    iterations, p, scale, k, densest, dissipated, coefficients = return_map(law, p, q, before[4], densest)
    converged = iterations <= MAX_ITERATIONS and np.isfinite(p + k + dissipated)
    sxx, syy, szz, sxy = scale * sxx, scale * syy, scale * szz, scale * sxy
    return converged, (sxx - p, syy - p, szz - p, sxy, k, densest), dissipated, coefficients, (sxx, syy, sxy)


@compiled
def _tangent(out, coefficients, sxx, syy, sxy):
    """Compute the tangent of (xx, yy, xy) from its coefficients and the stress deviator, as of `integrate_point`."""
    B, G, R, L, S = coefficients
    s = (sxx, syy, sxy)
    one = (1.0, 1.0, 0.0)
    shear = (2 * G, 2 * G, G)
    for i in range(3):
        for j in range(3):
            out[i, j] = (B - 2 * G / 3) * one[i] * one[j] + R * one[i] * s[j] + L * s[i] * one[j] + S * s[i] * s[j]
        out[i, i] += shear[i]


@compiled
def return_map(law: CapConstants, p: float, q: float, k: float, densest: float) -> tuple:
    """Map a trial state back to the yield surface.

    Parameters
    ----------
    p, q : float
        Trial mean pressure and von Mises stress [Pa].
    k, densest : float
        Density ratio before the step and the largest so far [-].

    Returns
    -------
    iterations : int
        Newton iterations, more than MAX_ITERATIONS without convergence.
    p, scale : float
        Mean pressure [Pa] and von Mises stress over its trial value [-].
    k, densest : float
        Density ratios after the step [-].
    plastic_work : float
        Plastic work [J/m3].
    coefficients : tuple of float
        Coefficients of the tangent, as of `integrate_point`.
    """
    pc, _ = hardening(law, densest)
    a, c = (pc + law.pt) / 2, (pc - law.pt) / 2
    p0 = min(c, 0.0) if law.flat else c
    half_axis = p0 + law.pt  # of the subcritical side
    if law.flat and (p0 <= p <= c or (p < p0 and half_axis == 0)):  # without tensile strength p >= 0
        return _return_to_flat(law, p, q, k, densest, max(p, p0), law.M * a)
    start = c if p > c else p0
    r = (a / half_axis) ** 2 if law.flat and p < p0 else 1.0
    if q * q / law.M**2 + r * (p - start) ** 2 <= (a * (1 + 2 * RESIDUAL_TOLERANCE)) ** 2:
        return 0, p, 1.0, k, densest, 0.0, (law.K, law.G, 0.0, 0.0, 0.0)
    distance = max(abs(p - start), MIN_TRIAL_DISTANCE * a)
    return _return_to_curve(law, start, distance if p >= start else -distance, q, k, densest, a, r)


@compiled
def _return_to_flat(law, p_trial, q_trial, k, densest, p, max_q):
    """Return the results of `return_map` on the flat part, q <= `max_q` at the pressure p."""
    V = (p_trial - p) / law.K
    q = min(q_trial, max_q)
    work = p * V + q * (q_trial - q) / (3 * law.G)
    bulk = law.K if p == p_trial else 0.0
    if q == q_trial:
        return 0, p, 1.0, k * np.exp(V), densest, work, (bulk, law.G, 0.0, 0.0, 0.0)
    scale = q / q_trial
    return 0, p, scale, k * np.exp(V), densest, work, (bulk, scale * law.G, 0.0, 0.0, -3 * law.G * scale / q**2)


@compiled
def _return_to_curve(law, start, A, q_trial, k, densest, a, r):
    """Return the results of `return_map` for p_trial = start + A, A != 0, outside a curved part."""
    onset = np.log(densest / k) if law.flat else 0.0  # V at which hardening starts
    iterations, V, y, a, h, m, scale, N, _ = _solve_multiplier(law, A, q_trial / law.M, densest, onset, a, r)
    k *= np.exp(V)
    densest = max(k, densest) if law.flat else k
    a = (hardening(law, densest)[0] + law.pt) / 2
    if r == 1.0:  # c depends on pc
        start = a - law.pt
    p = start + y * (a / N)  # a/N removes the remaining residual
    scale *= a / N
    q = q_trial * scale
    work = p * V + q * (q_trial - q) / (3 * law.G)
    return iterations, p, scale, k, densest, work, _tangent_coefficients(law, y, a, h, m, r, q, scale)


@compiled
def _solve_multiplier(law, A, d_trial, densest, onset, a_before, r):
    """Return the iterations, more than MAX_ITERATIONS without convergence, and the results of `_evaluate` at x."""
    low, high, x = 0.0, np.inf, 0.0
    for iteration in range(MAX_ITERATIONS):
        values = _evaluate(law, A, d_trial, densest, onset, a_before, r, x)
        V, y, a, h, _, _, N, dN = values
        residual = a / N - 1 if y * A > 0 else np.inf  # y has changed its sign
        if residual <= 1:
            next_x = x + residual * N * N * law.K * (1 + x) ** 2 / ((a * dN - h * N) * A)
        else:  # far inside N is closer to linear, in V
            inner = V - (N - a) / (dN - h)
            next_x = law.K * inner / (A - law.K * inner) if residual < np.inf else -1.0
        stalled = min(abs(next_x - x), high - low) <= STEP_TOLERANCE * x
        if abs(residual) <= RESIDUAL_TOLERANCE or (stalled and abs(residual) <= RESIDUAL_ACCEPTED):
            return iteration + 1, *values
        if residual < 0:
            low = x
        else:
            high = x
        middle = (low + high) / 2 if high < np.inf else 2 * x + 1
        x = next_x if low < next_x < high else middle
        if x >= high:  # no number between the bounds
            x = low
    return MAX_ITERATIONS + 1, *values


@compiled
def _evaluate(law, A, d_trial, densest, onset, a_before, r, x):
    """Return V, y, a, h = da/dV, m, q/q_trial, N = sqrt(d^2 + r y^2) with d = q/M, and dN/dV at x."""
    b, outer = 6 * law.G / law.M**2, 1 / (1 + x)
    V = A * x * outer / law.K
    rise, H = 0.0, 0.0
    if not law.flat or onset < V:
        rise, H = _pressure_rise(law, densest, V - onset)
    a, h = a_before + rise / 2, H / 2
    y, dy = A * outer - rise / 2, -law.K - h
    inverse = 1 / (2 * r * y)
    m = V * inverse
    scale = 1 / (1 + b * m)
    d, dm = d_trial * scale, (1 - 2 * r * m * dy) * inverse
    N = np.sqrt(d * d + r * y * y)
    return V, y, a, h, m, scale, N, (r * y * dy - d * d * scale * b * dm) / N


@compiled
def _pressure_rise(law, k, V):
    """Return pc(k exp V) - pc(k) and the final H, without cancellation on Heckel's curve."""
    gain = k * np.expm1(V)
    low_k, high_k = min(k, k + gain), max(k, k + gain)
    if high_k <= HECKEL_MAX_DENSITY_RATIO and 1 - low_k < (1 - law.loose) * MIN_POROSITY_RATIO:
        return -np.log1p(-gain / (1 - k)) / law.slope, (k + gain) / (1 - k - gain) / law.slope
    pc, H = hardening(law, k + gain)
    if low_k >= HECKEL_MAX_DENSITY_RATIO:
        return H * V, H
    return pc - hardening(law, k)[0], H


@compiled
def _tangent_coefficients(law, y, a, h, m, r, q, scale):
    """Return the coefficients of the tangent: derivatives of p and q by the trial pair, from V = 2 m r y and f = 0."""
    K, G, M2 = law.K, law.G, law.M**2
    along = 1 + 2 * r * m * (K + h)
    Q = 6 * G * q * q * scale / M2**2
    D = along * Q + 2 * r * y * (a * h + r * y * (K + h))
    cross = 6 * K * G * r * scale / (M2 * D)
    return (
        K * (1 - 2 * K * r * (r * y * y + m * Q) / D),
        scale * G,
        cross * y,
        cross * (y - 2 * a * h * m),
        -18 * G**2 * scale**2 * along / (M2**2 * D),
    )
