"""Elliptic cap with Heckel hardening: constants, hardening and return mapping of one material point.

    f = q^2/M^2 + r y^2 - a^2 <= 0,    a = (pc + pt)/2,  c = (pc - pt)/2 + u,  compression positive
    cap             p > c:           y = p - c,   r = 1
    flat part       p0 <= p <= c:    y = 0
    subcritical     p < p0:          y = p - p0,  r = a^2/(p0 + pt)^2

p is the mean pressure and q the von Mises stress. The full ellipse has p0 = c and no flat part; otherwise p0 =
min(c, 0). Flow is associated; pc hardens with the plastic volumetric strain V, k = k_n exp(V), up to the saturation
limit. Beyond, the reaction u rises by K_s dV and only c moves. Return mapping by backward Euler with the plastic
multiplier m results in

    p = p_tr - K V,  V = 2 m r y,    q = q_tr/(1 + 6 G m/M^2),    f(p, q, pc(k)) = 0,

where tr denotes the elastic trial state, c and a move with V. Plastic flow moves p and c towards one another and ends
before they coincide, so that the trial state determines the side. One unknown remains: x >= 0 of V = A x/((1 + x) K),
where A is the trial pressure beyond the flat part. Without hardening x = 2 r K m. As x grows from 0 the stress moves
inwards, from f > 0 to y = 0 and q = 0. A root always exists, and is unique if H = dpc/dV < 12 G/M^2. Beyond the limit H
= 0. With N^2 = f + a^2 the ratio a/N is nearly linear in x; Newton's method on a/N = 1 is safeguarded by bisection.
The sign of f at the limit, a kink, tells the side on which the root lies. Beyond, a is constant and the unknown is that
of the modulus K + K_s, so that the same iteration starts on the right side and never crosses the kink.

References
----------
J. C. Simo and T. J. R. Hughes, Computational Inelasticity, Springer 1998, chapter 3 (return mapping);
R. W. Heckel, Trans. Metall. Soc. AIME 221 (1961) 671 (hardening curve).
"""

from typing import NamedTuple

import numpy as np

from compact.material.laws import HECKEL_MIN_PRESSURE, Compaction, DruckerPragerCap
from compact.numerics.jit import compiled, internal

RESIDUAL_TOLERANCE = 1e-13  # [-], |a/N - 1| at convergence of Newton's method
STEP_TOLERANCE = 4e-16  # [-], relative change of x at convergence; far from c, x has no more digits
RESIDUAL_ACCEPTED = 1e-6  # [-], |a/N - 1| accepted with STEP_TOLERANCE
MIN_TRIAL_DISTANCE = 1e-12  # [-], |p_tr - c| over a; closer trial states use it, since V determines no x at c itself
MAX_ITERATIONS = 300  # [-], of Newton's method; 4 to 6 are usual, bisection alone needs up to 200
NO_SLOPES = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # of an elastic step


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
        Isotropic slope K_H of Heckel's curve over the rate factor [1/Pa].
    offset, porosity : float
        Offset of the curve, and largest 1 - k at which pc follows it [-].
    bias : float
        `Compaction.tensile_offset` [-].
    elastic : tuple of float
        Coefficients of g, `Compaction.elastic_polynomial` [-].
    span : float
        1/(K_H K) of the elastic strain in it [-].
    limit, saturation : float
        Saturation limit k_s [-], and modulus K_s of the reaction beyond it [Pa].
    flat : bool
        True for a flat subcritical side.
    line : bool
        True for the shear line of a `DruckerPragerCap` in its place.
    friction, dilatancy : float
        Slopes M and N of the line and of its plastic potential [-].
    viscosity : float
        Stress beyond the line per plastic shear strain of a path [Pa].
    """

    K: float
    G: float
    M: float
    pt: float
    slope: float
    offset: float
    porosity: float
    bias: float
    elastic: tuple[float, ...]
    span: float
    limit: float
    saturation: float
    loose: float
    flat: bool
    line: bool
    friction: float
    dilatancy: float
    viscosity: float


def cap_constants(law: Compaction, rate_factor: float, travel: float = np.inf) -> CapConstants:
    """Return the constants of a law for compiled code.

    Parameters
    ----------
    rate_factor : float
        Factor of pc at the speed [-].
    travel : float
        Travel of a strain path [m], over which the shear viscosity acts; infinite for slow shear.

    Returns
    -------
    CapConstants
    """
    offset, line = float(law.isotropic_offset), law if isinstance(law, DruckerPragerCap) else None
    return CapConstants(
        K=law.bulk_modulus,
        G=law.shear_modulus,
        M=float(law.critical_slope),
        pt=float(law.tensile_strength),
        slope=float(law.isotropic_slope / rate_factor),
        offset=offset,
        porosity=float((1 - law.loose_density_ratio) * np.exp(-HECKEL_MIN_PRESSURE - offset)),
        bias=float(law.tensile_offset),
        elastic=law.elastic_polynomial,
        span=float(1 / (law.heckel_slope * law.bulk_modulus)),
        limit=float(law.saturation_limit),
        saturation=float(law.saturation_modulus),
        loose=float(law.loose_density_ratio),
        flat=law.dry_side == "flat",
        line=line is not None,
        friction=float(line.friction_slope) if line else 0.0,
        dilatancy=float(line.dilatancy_slope) if line else 0.0,
        viscosity=float(line.shear_viscosity / travel) if line else 0.0,
    )


@compiled
def hardening(law: CapConstants, k: float) -> tuple[float, float]:
    """Evaluate the preconsolidation pressure of one point, as `Compaction.yield_pressure`.

    Parameters
    ----------
    law : CapConstants
        Constants of the mix.
    k : float
        Density ratio [-].

    Returns
    -------
    pc, H : float
        Preconsolidation pressure and its derivative dpc/dV by the plastic volumetric strain [Pa].
    """
    pc, H = heckel_curve(law, min(k, law.limit))
    return pc, H if k < law.limit else 0.0


@compiled
def heckel_curve(law: CapConstants, k: float) -> tuple[float, float]:
    """Evaluate Heckel's curve as `hardening`, beyond the saturation limit too."""
    x = k / (1 - k)
    gain, gain_x = _elastic_gain(law, x)
    curve = np.log((1 - law.loose) / (1 - k))
    xi = curve - law.offset + (curve + law.bias) * gain
    rise = (x * (1 + gain) + (curve + law.bias) * gain_x * x * (1 + x)) / law.slope
    if xi >= HECKEL_MIN_PRESSURE:
        return xi / law.slope, rise
    fading = np.exp(2 * (xi - HECKEL_MIN_PRESSURE) / HECKEL_MIN_PRESSURE)
    return HECKEL_MIN_PRESSURE * (1 + fading) / 2 / law.slope, rise * fading


@internal
def _elastic_gain(law, x):
    """Return g and dg/dx at x = k/(1 - k), by which elastic strain of confined compression raises pc + pt."""
    c0, c1, c2, c3 = law.elastic
    share = 1 / (1 + x * law.span)
    z = x * share
    gain_z = z * (2 * c0 + z * (3 * c1 + z * (4 * c2 + z * 5 * c3)))
    return z * z * (c0 + z * (c1 + z * (c2 + z * c3))), gain_z * share * share


@compiled
def reaction(law: CapConstants, k: float) -> tuple[float, float]:
    """Evaluate the reaction of saturated mix, as `Compaction.saturation_pressure`.

    Returns
    -------
    u, U : float
        Reaction and its derivative du/dV by the plastic volumetric strain [Pa].
    """
    if k < law.limit:
        return 0.0, 0.0
    return law.saturation * np.log(k / law.limit), law.saturation


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
    surface = yield_surface(law, p, densest)
    if is_elastic(law, p, q, surface):
        return 0, p, 1.0, k, densest, 0.0, 0.0, NO_SLOPES
    a, p0, _, r, rate, _ = surface
    if r != 0:
        return return_to_curve(law, surface, p, q, k, densest, guess)
    # the flat part, q <= M a
    end_p, end_q = max(p, p0), min(q, law.M * a)
    V, scale = (p - end_p) / law.K, 1.0
    work = end_p * V + end_q * (q - end_q) / (3 * law.G)
    V_p = 0.0 if end_p == p else 1 / law.K
    scale_s, scale_densest = 0.0, 0.0
    if end_q < q:
        scale = end_q / q
        scale_s, scale_densest = -1.5 * scale / q**2, law.M * rate / q
    return 0, end_p, scale, k * np.exp(V), densest, work, 0.0, (V_p, 0.0, 0.0, 0.0, 0.0, scale_s, 0.0, scale_densest)


@internal
def yield_surface(law: CapConstants, p: float, densest: float) -> tuple:
    """Return the part of the yield surface at a pressure.

    Parameters
    ----------
    law : CapConstants
        Constants of the mix.
    p : float
        Mean pressure [Pa].
    densest : float
        Density ratio that determines pc [-].

    Returns
    -------
    a, p0, start : float
        Half the length of the ellipse, end of the flat part and start of the curved part [Pa].
    r : float
        Aspect of the curved part [-], 0 on the flat part.
    rate, shift : float
        Derivatives da/d ln k and dc/d ln k [Pa].
    """
    (pc, H), (u, U) = hardening(law, densest), reaction(law, densest)
    a, c = (pc + law.pt) / 2, (pc - law.pt) / 2 + u
    p0 = min(c, 0.0) if law.flat else c
    if p > c or p0 == c:
        return a, p0, c, 1.0, H / 2, H / 2 + U
    if p0 <= p or law.pt == 0:  # without tensile strength p >= 0
        return a, p0, p0, 0.0, H / 2, H / 2 + U
    return a, p0, p0, (a / law.pt) ** 2, H / 2, H / 2 + U


@internal
def is_elastic(law: CapConstants, p: float, q: float, surface: tuple) -> bool:
    """Return True if a trial state does not yield.

    Parameters
    ----------
    law : CapConstants
        Constants of the mix.
    p, q : float
        Trial mean pressure and von Mises stress [Pa].
    surface : tuple of float
        Part of the yield surface at p, of `yield_surface`.

    Returns
    -------
    bool
    """
    a, p0, start, r, _, _ = surface
    if r == 0:
        return p >= p0 and q <= law.M * a
    return q * q / law.M**2 + r * (p - start) ** 2 <= (a * (1 + 2 * RESIDUAL_TOLERANCE)) ** 2


@internal
def return_to_curve(law, surface, p_trial, q_trial, k, densest, guess) -> tuple:
    """Map a trial state outside a curved part back to it.

    Parameters
    ----------
    law : CapConstants
        Constants of the mix.
    surface : tuple of float
        Curved part, of `yield_surface`.
    p_trial, q_trial : float
        Trial mean pressure and von Mises stress [Pa].
    k, densest : float
        Density ratio before the step and the largest so far [-].
    guess : float
        Initial guess of x [-], 0 for none.

    Returns
    -------
    tuple
        As of `return_map`.
    """
    a_before, _, start, r, rate, shift = surface
    distance = max(abs(p_trial - start), MIN_TRIAL_DISTANCE * a_before)
    A = distance if p_trial >= start else -distance
    onset = np.log(densest / k) if law.flat else 0.0  # V at which hardening starts
    d_trial, b, pc = q_trial / law.M, 6 * law.G / law.M**2, 2 * a_before - law.pt
    A, K, a_start, low, high = _side_of_limit(law, (A, d_trial, a_before, pc), k, densest, onset)
    saturated = K != law.K
    x, iterations = guess * (K / law.K), MAX_ITERATIONS + 1
    x = x if low <= x < high else low
    V, y, a, h, g, m, scale, N = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    for iteration in range(MAX_ITERATIONS):
        # V, y, a, h = da/dV, g = dc/dV, m, scale = q/q_trial, N = sqrt(d^2 + r y^2) with d = q/M, and dN/dV at x
        outer = 1 / (1 + x)
        V = A / K * (x * outer)
        rise, h, u_rise, g = 0.0, 0.0, 0.0, 0.0
        if not saturated and (not law.flat or onset < V):
            rise, H, u_rise, U = pressure_rise(law, densest, V - onset, pc)
            h, g = H / 2, H / 2 + U
        a = a_start + rise / 2
        y, dy = A * outer - rise / 2 - u_rise, -K - g
        ry = r * y
        inverse = 1 / (2 * ry)
        m = V * inverse
        scale = 2 * ry / (2 * ry + b * V)  # 1/(1 + b m)
        d, dm = d_trial * scale, (1 - 2 * r * m * dy) * inverse
        N = np.sqrt(d * d + ry * y)
        dN = (ry * dy - d * d * scale * b * dm) / N
        residual = a / N - 1 if y * A > 0 else np.inf  # y has changed its sign
        if residual <= 1:
            next_x = x + residual * N * N * K * (1 + x) ** 2 / ((a * dN - h * N) * A)
        else:  # far inside N is closer to linear, in V
            inner = V - (N - a) / (dN - h)
            next_x = K * inner / (A - K * inner) if residual < np.inf else -1.0
        stalled = min(abs(next_x - x), high - low) <= STEP_TOLERANCE * x
        if abs(residual) <= RESIDUAL_TOLERANCE or (stalled and abs(residual) <= RESIDUAL_ACCEPTED):
            iterations = iteration + 1
            break
        if residual < 0:
            low = x
        else:
            high = x
        middle = (low + high) / 2 if high < np.inf else 2 * x + 1
        x = next_x if low < next_x < high else middle
        if x >= high:  # no number between the bounds
            x = low

    if saturated:
        g = law.saturation
    k *= np.exp(V)
    densest = max(k, densest) if law.flat else k
    end_a = (hardening(law, densest)[0] + law.pt) / 2
    if r == 1.0:  # c depends on pc and u
        start = end_a - law.pt + reaction(law, densest)[0]
    p = start + y * (end_a / N)  # a/N removes the remaining residual
    scale *= end_a / N
    q = q_trial * scale
    work = p * V + q * (q_trial - q) / (3 * law.G)
    # slopes by the implicit derivatives of V = 2 m r y and f = 0: at constant V and m, let f/2 change by f' and
    # V - 2 m r y by t; then V' = (2 r y f' + Q t)/D and m' = (along f' - E t)/D
    a, M2 = end_a, law.M**2
    along, E, Q = 1 + 2 * r * m * (law.K + g), r * y * (law.K + g) + a * h, b * (q / law.M) ** 2 * scale
    D = along * Q + 2 * r * y * E
    by_m = -scale * scale * b  # d scale/dm
    # by the trial state: f' = r y p' + 1.5 (scale/M)^2 s', t = 2 m r p'
    f_s = 1.5 * scale * scale / M2
    V_p, V_s = 2 * r * (r * y * y + m * Q) / D, 2 * r * y * f_s / D
    scale_p, scale_s = by_m * r * (y - 2 * m * a * h) / D, by_m * along * f_s / D
    hardens = saturated or not law.flat or onset < V
    if hardens:
        rate, shift = h, g  # of a and c by the logarithm of the density ratio that determines them
    if r == 1.0:  # c moves too
        f, t = -shift * y - rate * a, -2 * m * shift
    else:  # r is proportional to a^2
        f, t = rate * (r * y * y / a - a), 4 * m * r * y * rate / a
    V_x, scale_x = (2 * r * y * f + Q * t) / D, by_m * (along * f - E * t) / D
    slopes = (V_p, V_s, 0.0, V_x, scale_p, scale_s, 0.0, scale_x)
    if hardens:
        slopes = (V_p, V_s, V_x, 0.0, scale_p, scale_s, scale_x, 0.0)
    return iterations, p, scale, k, densest, work, x * (law.K / K), slopes


@internal
def _side_of_limit(law, trial, k, densest, onset):
    """Return A, K and a for the side of the saturation limit on which the return ends, and the bounds of x there.

    Beyond the limit a is constant, and the centre moves by K_s dV. This is the return to a fixed surface with the
    modulus K + K_s, from the distance at which c would have started.
    """
    A, d_trial, a, pc = trial
    if A <= 0 and (law.flat or k <= law.limit):
        return A, law.K, a, 0.0, np.inf
    V = np.log(law.limit / k)  # at the limit
    if A > 0:
        V = max(V, onset)
    y = A - law.K * V
    if y * A <= 0:  # the limit is out of reach
        return A, law.K + (law.saturation if A < 0 else 0.0), a, 0.0, np.inf
    x = law.K * V / y
    rise, _, u_rise, _ = pressure_rise(law, densest, V - onset, pc)
    y -= rise / 2 + u_rise
    d = d_trial * 2 * y / (2 * y + 6 * law.G / law.M**2 * V)
    outside = y * A > 0 and np.sqrt(d * d + y * y) > a + rise / 2
    if outside == (A > 0):
        return A - rise / 2 - u_rise + law.saturation * V, law.K + law.saturation, a + rise / 2, 0.0, np.inf
    return (A, law.K, a, x, np.inf) if outside else (A, law.K, a, 0.0, x)


@internal
def pressure_rise(law: CapConstants, k: float, V: float, pc: float) -> tuple[float, float, float, float]:
    """Compute the rises of pc and u by a plastic volumetric strain, without cancellation on Heckel's curve.

    Parameters
    ----------
    law : CapConstants
        Constants of the mix.
    k : float
        Density ratio before the strain [-].
    V : float
        Plastic volumetric strain [-].
    pc : float
        Preconsolidation pressure at k [Pa].

    Returns
    -------
    rise, H, u_rise, U : float
        pc(k exp V) - pc(k), dpc/dV after the strain, and the same of u [Pa].
    """
    gain = k * np.expm1(V)
    end, u_rise, U, H_share = k + gain, 0.0, 0.0, 1.0
    if max(k, end) >= law.limit:  # pc follows the part of the strain below the limit, u the other
        beyond = np.log(k / law.limit)
        u_rise = law.saturation * (max(beyond + V, 0.0) - max(beyond, 0.0) if beyond < 0 or beyond + V < 0 else V)
        if end >= law.limit:
            U, H_share = law.saturation, 0.0
        k, end = min(k, law.limit), min(end, law.limit)
        gain = end - k
    if 1 - min(k, end) < law.porosity:
        x, rise = end / (1 - end), -np.log1p(-gain / (1 - k))
        before, _ = _elastic_gain(law, k / (1 - k))
        after, after_x = _elastic_gain(law, x)
        curve = (pc * law.slope + law.offset + law.bias) / (1 + before)  # ln[(1 - k0)/(1 - k)] + bias
        total = (rise * (1 + after) + curve * (after - before)) / law.slope
        H = (x * (1 + after) + (curve + rise) * after_x * x * (1 + x)) / law.slope
    else:
        pc_end, H = hardening(law, end)
        total = pc_end - pc
    return total, H_share * H, u_rise, U
