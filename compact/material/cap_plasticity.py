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
from scipy.optimize import brentq

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
NO_STRAIN = 1e-13  # [-], of a path that is elastic from any state; above the rounding of the strain
CONFINED_STEPS = 200  # [-], of the compression of mix by an earlier pass
NO_SLOPES = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # of an elastic step
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


def compacted_state(
    law: Compaction, density_ratio: float, rate_factor: float = 1.0, *, residual_stress: bool = True
) -> MaterialPoint:
    """Return one point of mix at rest that an earlier pass has compacted to a density ratio.

    Confined compression from the initial density ratio, and unloading until the vertical stress vanishes, leave a
    lateral stress. Mix without residual stress keeps the preconsolidation density ratio.

    Parameters
    ----------
    density_ratio : float
        Density ratio after unloading [-], above the initial one of the law.
    rate_factor : float
        Factor of pc at the speed of the earlier pass [-].
    residual_stress : bool
        True to keep the lateral stress.
    """
    fresh, constants = initial_state(law, 1), cap_constants(law, rate_factor)
    fed, stiffness = float(law.fed_density_ratio), constants.K + 4 * constants.G / 3
    if not fed < density_ratio < 1:
        raise ValueError(
            f"`density_ratio` of compacted mix must lie between that of the fed mix {fed:.6g} and 1, got "
            f"{density_ratio!r}"
        )

    def strained(state, strain):
        return integrate_points(law, state, np.array([[0.0, strain, 0.0]]), rate_factor, tangent=False)[0]

    def compacted(strain):
        state = fresh
        for _ in range(CONFINED_STEPS):
            state = strained(state, -strain / CONFINED_STEPS)
        rise = -2 * state.stress[0, 1] / stiffness
        return strained(state, brentq(lambda part: strained(state, part).stress[0, 1], 0.0, rise, xtol=NO_STRAIN))

    low = float(np.log(density_ratio / fed))
    high = low + 2 * hardening(constants, density_ratio)[0] / constants.K
    strain = brentq(lambda part: compacted(part).density_ratio[0] - density_ratio, low, high, xtol=NO_STRAIN)
    state = compacted(strain)
    stress = state.stress * [1.0, 0.0, 1.0, 0.0] if residual_stress else np.zeros((1, 4))
    return MaterialPoint(stress, state.density_ratio, state.max_density_ratio, np.zeros(1))


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
    """Constants of a `Compaction` at one speed, for compiled code.

    Parameters
    ----------
    K, G : float
        Bulk and shear modulus of unloading [Pa].
    M, loose : float
        Slope of the critical state, and density ratio k0 at which Heckel's curve starts [-].
    pt : float
        Isotropic tensile strength [Pa].
    slope : float
        Heckel's slope K_H over the rate factor [1/Pa].
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
    derivatives = np.empty((6, 3 if len(tangents) else 0))
    for i in range(first, end):
        before = (stress[i, 0], stress[i, 1], stress[i, 2], stress[i, 3], density_ratio[i], max_density_ratio[i])
        part = (strain[i, 0], strain[i, 1], strain[i, 2])
        derivatives[:] = 0.0
        converged, after, dissipated, _ = integrate_point(law, before, part, 0.0, 1.0, derivatives)
        if not converged:
            return i
        for j in range(4):
            new_stress[i, j] = after[j]
        new_scalars[0, i] = after[4]
        new_scalars[1, i] = after[5]
        new_scalars[2, i] = work[i] + dissipated
        if len(tangents):
            tangents[i, :2] = derivatives[:2]
            tangents[i, 2] = derivatives[3]
    return -1


@compiled
def integrate_path(law: CapConstants, before: tuple, strain: tuple, multipliers: Array, derivatives: Array) -> tuple:
    """Integrate the constitutive law of one point along a straight strain path; one step if the path is elastic.

    The yield surface is convex, so that a path is elastic if its ends are.

    Parameters
    ----------
    before : tuple of float
        Stress xx, yy, zz, xy [Pa], density ratio and largest density ratio [-] before the path.
    strain : tuple of float
        Strain of the path xx, yy, 2 xy [-].
    multipliers : ndarray
        One initial guess of x for each substep of a path that yields, 0 for none; replaced by the solution.
    derivatives : ndarray, shape (6, 3) or (6, 0)
        Output: derivatives of the stress and of the logarithms of the density ratios after the path by the strain, or
        none.

    Returns
    -------
    converged : bool
        False if the return mapping did not converge.
    after : tuple of float
        State after the path, as `before`.
    plastic_work, work : float
        Plastic work and work of deformation [J/m3].
    """
    derivatives[:] = 0.0
    p, q, deviator = _trial_state(law, before, strain)
    densest = before[5] if law.flat else before[4]
    still = max(abs(strain[0]), abs(strain[1]), abs(strain[2])) <= NO_STRAIN  # interpolated states may lie outside
    if still or _is_elastic(law, p, q, _yield_surface(law, p, densest)):
        end, converged, plastic_work = (*_stress(p, deviator, 1.0), before[4], densest), True, 0.0
        _propagate(law, deviator, 1.0, NO_SLOPES, not law.flat, 1.0, derivatives)
        work = _work(before, end, strain)
    else:
        steps, x = len(multipliers), 0.0
        part = (strain[0] / steps, strain[1] / steps, strain[2] / steps)
        end, converged, plastic_work, work = before, True, 0.0, 0.0
        for step in range(steps):
            start, guess = end, multipliers[step] if multipliers[step] > 0 else x
            good, end, dissipated, x = integrate_point(law, start, part, guess, 1 / steps, derivatives)
            multipliers[step] = x
            converged = converged and good
            plastic_work += dissipated
            work += _work(start, end, part)
    return converged, end, plastic_work, work


@compiled
def _work(before, after, strain):
    """Return the work of deformation of an increment [J/m3]."""
    xx, yy, xy = before[0] + after[0], before[1] + after[1], before[3] + after[3]
    return (xx * strain[0] + yy * strain[1] + xy * strain[2]) / 2


@compiled
def integrate_point(
    law: CapConstants, before: tuple, strain: tuple, guess: float, share: float, derivatives: Array
) -> tuple:
    """Integrate the constitutive law at one point in one step.

    Parameters
    ----------
    before : tuple of float
        Stress xx, yy, zz, xy [Pa], density ratio and largest density ratio [-] before the increment.
    strain : tuple of float
        Strain increment xx, yy, 2 xy [-].
    guess : float
        Initial guess of x of the return mapping [-], 0 for none.
    share : float
        Share of the increment in the strain of the path [-].
    derivatives : ndarray, shape (6, 3) or (6, 0)
        Derivatives of the stress and of the logarithms of the density ratios by the strain of the path, before the
        increment and, on return, after it; or none.

    Returns
    -------
    converged : bool
        False if the return mapping did not converge.
    after : tuple of float
        State after the increment, as `before`.
    plastic_work : float
        Plastic work of the increment [J/m3].
    x : float
        Solution of the return mapping [-], 0 off the curved part.
    """
    p, q, deviator = _trial_state(law, before, strain)
    densest = before[5] if law.flat else before[4]
    iterations, p, scale, k, densest, dissipated, x, slopes = return_map(law, p, q, before[4], densest, guess)
    hardened = densest == k and (k != before[4] or not law.flat)
    _propagate(law, deviator, scale, slopes, hardened, share, derivatives)
    converged = iterations <= MAX_ITERATIONS and np.isfinite(p + k + dissipated)
    return converged, (*_stress(p, deviator, scale), k, densest), dissipated, x


@compiled
def _stress(p, deviator, scale):
    """Return the stress (xx, yy, zz, xy) of a mean pressure and a scaled deviator."""
    sxx, syy, szz, sxy = deviator
    return scale * sxx - p, scale * syy - p, scale * szz - p, scale * sxy


@compiled
def _trial_state(law, before, strain):
    """Return mean pressure, von Mises stress and deviator (xx, yy, zz, xy) of the elastic trial state."""
    third = (strain[0] + strain[1]) / 3
    mean = (before[0] + before[1] + before[2]) / 3
    sxx = before[0] - mean + 2 * law.G * (strain[0] - third)
    syy = before[1] - mean + 2 * law.G * (strain[1] - third)
    szz = before[2] - mean - 2 * law.G * third
    sxy = before[3] + law.G * strain[2]
    q = np.sqrt(1.5 * (sxx * sxx + syy * syy + szz * szz + 2 * sxy * sxy))
    return -mean - 3 * law.K * third, q, (sxx, syy, szz, sxy)


@compiled
def _propagate(law, deviator, scale, slopes, hardened, share, derivatives):
    """Propagate derivatives through one increment by the slopes of `return_map`."""
    sxx, syy, szz, sxy = deviator
    V_p, V_s, V_k, V_densest, scale_p, scale_s, scale_k, scale_densest = slopes
    for j in range(derivatives.shape[1]):
        xx, yy, zz = derivatives[0, j], derivatives[1, j], derivatives[2, j]
        xy, k, densest = derivatives[3, j], derivatives[4, j], derivatives[5, j]
        exx = share if j == 0 else 0.0
        eyy = share if j == 1 else 0.0
        gamma = share if j == 2 else 0.0
        third, mean = (exx + eyy) / 3, (xx + yy + zz) / 3
        p = -mean - 3 * law.K * third
        xx += 2 * law.G * (exx - third) - mean
        yy += 2 * law.G * (eyy - third) - mean
        zz -= 2 * law.G * third + mean
        xy += law.G * gamma
        s = sxx * xx + syy * yy + szz * zz + 2 * sxy * xy
        V = V_p * p + V_s * s + V_k * k + V_densest * densest
        change = scale_p * p + scale_s * s + scale_k * k + scale_densest * densest
        p -= law.K * V
        derivatives[0, j] = scale * xx + change * sxx - p
        derivatives[1, j] = scale * yy + change * syy - p
        derivatives[2, j] = scale * zz + change * szz - p
        derivatives[3, j] = scale * xy + change * sxy
        derivatives[4, j] = k + V
        derivatives[5, j] = k + V if hardened else densest


@compiled
def return_map(law: CapConstants, p: float, q: float, k: float, densest: float, guess: float) -> tuple:
    """Map a trial state back to the yield surface.

    Parameters
    ----------
    p, q : float
        Trial mean pressure and von Mises stress [Pa].
    k, densest : float
        Density ratio before the step and the largest so far [-].
    guess : float
        Initial guess of x [-], 0 for none.

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
    x : float
        Solution on a curved part [-], else 0.
    slopes : tuple of float
        Derivatives of V and of `scale` with respect to trial pressure, half the square of the trial deviator, and
        logarithms of both density ratios.
    """
    surface = _yield_surface(law, p, densest)
    if _is_elastic(law, p, q, surface):
        return 0, p, 1.0, k, densest, 0.0, 0.0, NO_SLOPES
    if surface[3] == 0:
        return _return_to_flat(law, surface, p, q, k, densest)
    return _return_to_curve(law, surface, p, q, k, densest, guess)


@compiled
def _yield_surface(law, p, densest):
    """Return a, p0, start and aspect r of the curved part at the pressure p, and da/d ln k; r = 0 on the flat part."""
    pc, H = hardening(law, densest)
    a, c = (pc + law.pt) / 2, (pc - law.pt) / 2
    p0 = min(c, 0.0) if law.flat else c
    if p > c or p0 == c:
        return a, p0, c, 1.0, H / 2
    if p0 <= p or law.pt == 0:  # without tensile strength p >= 0
        return a, p0, p0, 0.0, H / 2
    return a, p0, p0, (a / law.pt) ** 2, H / 2


@compiled
def _is_elastic(law, p, q, surface):
    """Return True if a trial state does not yield."""
    a, p0, start, r, _ = surface
    if r == 0:
        return p >= p0 and q <= law.M * a
    return q * q / law.M**2 + r * (p - start) ** 2 <= (a * (1 + 2 * RESIDUAL_TOLERANCE)) ** 2


@compiled
def _return_to_flat(law, surface, p_trial, q_trial, k, densest):
    """Return the results of `return_map` on the flat part, q <= M a."""
    a, p0, _, _, rate = surface
    p, q = max(p_trial, p0), min(q_trial, law.M * a)
    V, scale = (p_trial - p) / law.K, 1.0
    work = p * V + q * (q_trial - q) / (3 * law.G)
    V_p = 0.0 if p == p_trial else 1 / law.K
    scale_s, scale_densest = 0.0, 0.0
    if q < q_trial:
        scale = q / q_trial
        scale_s, scale_densest = -1.5 * scale / q_trial**2, law.M * rate / q_trial
    return 0, p, scale, k * np.exp(V), densest, work, 0.0, (V_p, 0.0, 0.0, 0.0, 0.0, scale_s, 0.0, scale_densest)


@compiled
def _return_to_curve(law, surface, p_trial, q_trial, k, densest, guess):
    """Return the results of `return_map` for a trial state outside a curved part."""
    a, _, start, r, rate = surface
    distance = max(abs(p_trial - start), MIN_TRIAL_DISTANCE * a)
    A = distance if p_trial >= start else -distance
    onset = np.log(densest / k) if law.flat else 0.0  # V at which hardening starts
    iterations, x, (V, y, a, h, m, scale, N, _) = _solve_multiplier(
        law, (A, q_trial / law.M, densest, onset, a, r), guess
    )
    k *= np.exp(V)
    densest = max(k, densest) if law.flat else k
    a = (hardening(law, densest)[0] + law.pt) / 2
    if r == 1.0:  # c depends on pc
        start = a - law.pt
    p = start + y * (a / N)  # a/N removes the remaining residual
    scale *= a / N
    q = q_trial * scale
    work = p * V + q * (q_trial - q) / (3 * law.G)
    hardens = not law.flat or onset < V
    return iterations, p, scale, k, densest, work, x, _slopes(law, (y, a, h, m, scale), r, q, rate, hardens)


@compiled
def _solve_multiplier(law, trial, x):
    """Return the iterations, more than MAX_ITERATIONS without convergence, x, and the results of `_evaluate` there."""
    A, low, high = trial[0], 0.0, np.inf
    for iteration in range(MAX_ITERATIONS):
        values = _evaluate(law, trial, x)
        V, y, a, h, _, _, N, dN = values
        residual = a / N - 1 if y * A > 0 else np.inf  # y has changed its sign
        if residual <= 1:
            next_x = x + residual * N * N * law.K * (1 + x) ** 2 / ((a * dN - h * N) * A)
        else:  # far inside N is closer to linear, in V
            inner = V - (N - a) / (dN - h)
            next_x = law.K * inner / (A - law.K * inner) if residual < np.inf else -1.0
        stalled = min(abs(next_x - x), high - low) <= STEP_TOLERANCE * x
        if abs(residual) <= RESIDUAL_TOLERANCE or (stalled and abs(residual) <= RESIDUAL_ACCEPTED):
            return iteration + 1, x, values
        if residual < 0:
            low = x
        else:
            high = x
        middle = (low + high) / 2 if high < np.inf else 2 * x + 1
        x = next_x if low < next_x < high else middle
        if x >= high:  # no number between the bounds
            x = low
    return MAX_ITERATIONS + 1, x, values


@compiled
def _evaluate(law, trial, x):
    """Return V, y, a, h = da/dV, m, q/q_trial, N = sqrt(d^2 + r y^2) with d = q/M, and dN/dV at x."""
    A, d_trial, densest, onset, a_before, r = trial
    b, outer = 6 * law.G / law.M**2, 1 / (1 + x)
    V = A / law.K * (x * outer)
    rise, H = 0.0, 0.0
    if not law.flat or onset < V:
        rise, H = _pressure_rise(law, densest, V - onset)
    a, h = a_before + rise / 2, H / 2
    y, dy = A * outer - rise / 2, -law.K - h
    ry = r * y
    inverse = 1 / (2 * ry)
    m = V * inverse
    scale = 2 * ry / (2 * ry + b * V)  # 1/(1 + b m)
    d, dm = d_trial * scale, (1 - 2 * r * m * dy) * inverse
    N = np.sqrt(d * d + ry * y)
    return V, y, a, h, m, scale, N, (ry * dy - d * d * scale * b * dm) / N


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
def _slopes(law, solution, r, q, rate, hardens):
    """Return the slopes of `return_map` by the implicit derivatives of V = 2 m r y and f = 0.

    A change u of p_tr - p0 and the changes f' of f/2 and t of V - 2 m r y, both at constant V and m, cause the changes
    V' = (2 r y f' + Q t)/D and m' = (along f' - E t)/D.
    """
    y, a, h, m, scale = solution
    K, M2 = law.K, law.M**2
    b = 6 * law.G / M2
    along, E, Q = 1 + 2 * r * m * (K + h), r * y * (K + h) + a * h, b * (q / law.M) ** 2 * scale
    D = along * Q + 2 * r * y * E
    by_m = -scale * scale * b  # d scale/dm
    # by the trial state: f' = r y p' + 1.5 (scale/M)^2 s', t = 2 m r p'
    f_s = 1.5 * scale * scale / M2
    V_p, V_s = 2 * r * (r * y * y + m * Q) / D, 2 * r * y * f_s / D
    scale_p, scale_s = by_m * r * (y - 2 * m * a * h) / D, by_m * along * f_s / D
    # by the logarithm of the density ratio that determines a
    if hardens:
        rate = h
    if r == 1.0:  # c moves with a
        f, t = -rate * (y + a), -2 * m * rate
    else:  # r is proportional to a^2
        f, t = rate * (r * y * y / a - a), 4 * m * r * y * rate / a
    V_x, scale_x = (2 * r * y * f + Q * t) / D, by_m * (along * f - E * t) / D
    if hardens:
        return V_p, V_s, V_x, 0.0, scale_p, scale_s, scale_x, 0.0
    return V_p, V_s, 0.0, V_x, scale_p, scale_s, 0.0, scale_x
