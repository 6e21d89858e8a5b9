"""Return mapping to an elliptic cap and the shear line of Drucker and Prager, with their corner and the apex.

    cap   (P - b)^2 + (q/Mc)^2 <= a^2    P >= b,   associated,       dV = 2 lc (P - b),  de = 2 lc q/Mc^2
    line  q <= M P                       P >= 0,   potential q - N P,  dV = -N ls,       de = ls
    cut   P >= 0

with P = p + pt, a = (pc + pt)/2 and b = a + u. Steady rolling (`engines.compaction.rolling`) has q <= M (p' + pt) for
the line. The carried pressure p' is that of the same place in the last step. Flow with N = 0 is then associated and
every increment convex; in steady motion p' = p, and the law is the same. Both are q <= m P + l, with m = M, l = 0
or m = 0, l = M (p' + pt). A viscous stress n ls may exceed the line, up to the top Mc a of the cap where P < b.

Backward Euler from the trial state (P_tr, q_tr), with V and e the increments of plastic volume and shear strain:

    line    ls = (q_tr - m P_tr - l)/(3 G + K m N + n),  P = P_tr + K N ls,  q = q_tr - 3 G ls
    apex    P = 0,  q = l + n ls                  where P of the line is negative
    cap     the root of `elliptic_cap`            where line and apex lie outside the cap
    corner  both surfaces                         where the cap violates the line

The corner has one root V. With P = P_tr - K V and q of the cap, the flow of both surfaces determines ls,

    y = P - b(k exp V),  q^2 = Mc^2 (a^2 - y^2),  ls = (q_tr - q - w V)/(3 G + w N),  w = 3 G q/(y Mc^2)

and the line requires q = m P + l + n ls. q^2 of the cap less that of the line increases with V; Newton's method on it
is safeguarded by bisection.

References
----------
J. C. Simo, J. G. Kennedy and S. Govindjee, Non-smooth multisurface plasticity and viscoplasticity, Int. J. Numer.
Methods Eng. 26 (1988) 2161-2185 (Koiter's conditions at a corner).
"""

import numpy as np

from compact.material.elliptic_cap import (
    MAX_ITERATIONS,
    NO_SLOPES,
    CapConstants,
    hardening,
    pressure_rise,
    reaction,
    return_to_curve,
    yield_surface,
)
from compact.numerics.jit import compiled, internal

ROUNDING = 4e-15  # [-], of stresses over a; a state on a surface is inside
CORNER_TOLERANCE = 4e-16  # [-], change of the pressure of the corner over trial pressure and a at convergence
TOP_DISTANCE = 4e-5  # [-], pressure of a viscous corner above b, over a, below which it counts as top of the cap


@compiled
def is_elastic_in_line(law: CapConstants, p: float, q: float, densest: float, carried: float) -> bool:
    """Return True if a trial state does not yield.

    Parameters
    ----------
    p, q : float
        Trial mean pressure and von Mises stress [Pa].
    densest : float
        Largest density ratio so far [-].
    carried : float
        Pressure p' that limits shear [Pa], NaN for p itself.

    Returns
    -------
    bool
    """
    a, b, slope, limit = _surfaces(law, densest, carried)
    P = p + law.pt
    if P < 0 or q > slope * P + limit + ROUNDING * a:
        return False
    if b >= P:
        return q <= law.M * a
    return (q / law.M) ** 2 + (P - b) ** 2 <= (a * (1 + ROUNDING)) ** 2


@compiled
def return_to_line(law, p, q, k, densest, guess, carried, share) -> tuple:
    """Map a trial state back to cap, line, corner or apex.

    Parameters
    ----------
    p, q, k, densest, guess
        As of `elliptic_cap.return_map`.
    carried : float
        Pressure p' that limits shear [Pa], NaN for p itself.
    share : float
        Share of the increment in the path of `law.viscosity` [-].

    Returns
    -------
    tuple
        As of `elliptic_cap.return_map`.
    """
    if is_elastic_in_line(law, p, q, densest, carried):
        return 0, p, 1.0, k, densest, 0.0, 0.0, NO_SLOPES
    a, b, slope, limit = _surfaces(law, densest, carried)
    viscosity, P, G3 = law.viscosity / share, p + law.pt, 3 * law.G
    D = G3 + law.K * slope * law.dilatancy + viscosity
    shear = max((q - slope * P - limit) / D, 0.0)
    end, top = P + law.K * law.dilatancy * shear, law.M * a
    if b >= P and slope == 0 and limit >= top:
        return _return_to_top(law, p, q, k, densest, slope, limit, viscosity)
    if end < 0:  # the apex P = 0
        shear, by_q = max((q - limit) / (G3 + viscosity), 0.0), 0.0
        if shear > 0:
            by_q = 1 / (G3 + viscosity)
        derivatives = (1 / law.K, 0.0, 0.0, 1 - G3 * by_q, 0.0, 0.0)
        return _result(law, (p, q, k, densest), (P / law.K, -law.pt, q - G3 * shear), derivatives, False)
    end_q = q - G3 * shear
    if b >= P and end_q > top and (end <= b or (b - P) * (D - G3) >= (top - limit - slope * P) * law.K * law.dilatancy):
        return _return_to_top(law, p, q, k, densest, slope, limit, viscosity)
    if end <= b or (end_q / law.M) ** 2 + (end - b) ** 2 <= (a * (1 + ROUNDING)) ** 2:
        by_p, by_q = (-slope / D, 1 / D) if shear > 0 else (0.0, 0.0)
        N = law.dilatancy
        derivatives = (-N * by_p, -N * by_q, -G3 * by_p, 1 - G3 * by_q, 0.0, 0.0)
        return _result(law, (p, q, k, densest), (-N * shear, end - law.pt, end_q), derivatives, False)
    if b < P:
        found = return_to_curve(law, yield_surface(law, p, densest), p, q, k, densest, guess)
        if q * found[2] <= slope * (found[1] + law.pt) + limit + ROUNDING * a:
            return found
    return _return_to_corner(law, p, q, k, densest, slope, limit, viscosity)


@internal
def _surfaces(law, densest, carried):
    """Return a and b of the cap, and slope and intercept of the line."""
    a = (hardening(law, densest)[0] + law.pt) / 2
    b = a + reaction(law, densest)[0]
    if np.isnan(carried):
        return a, b, law.friction, 0.0
    return a, b, 0.0, law.friction * max(carried + law.pt, 0.0)


@internal
def _result(law, trial, solution, derivatives, hardens):
    """Return the results of `return_map` for V, p and q and their derivatives.

    `derivatives` are those of V and q by trial pressure and von Mises stress, and by the logarithm of the density ratio
    that determines pc.
    """
    _, q_trial, k, densest = trial
    V, p, q = solution
    V_p, V_q, q_p, q_q, V_x, q_x = derivatives
    scale, by_s, inverse = 1.0, 0.0, 0.0
    if q_trial > 0:
        scale, by_s, inverse = q / q_trial, 1.5 / q_trial, 1 / q_trial
    work = p * V + q * (q_trial - q) / (3 * law.G)
    k *= np.exp(V)
    scale_s = (q_q - scale) * inverse * by_s
    if hardens:
        slopes = (V_p, V_q * by_s, V_x, 0.0, q_p * inverse, scale_s, q_x * inverse, 0.0)
    else:
        slopes = (V_p, V_q * by_s, 0.0, V_x, q_p * inverse, scale_s, 0.0, q_x * inverse)
    return 0, p, scale, k, max(k, densest), work, 0.0, slopes


@internal
def _return_to_top(law, p, q, k, densest, slope, limit, viscosity):
    """Return the results below the top q = Mc a of the cap, which bounds the viscous stress and the line where P < b.

    At the top the shear of the line is that of its viscous stress; the rest flows on the cap, without dilatancy.
    """
    pc, H = hardening(law, densest)
    top, top_x, N = law.M * (pc + law.pt) / 2, law.M * H / 2, law.dilatancy
    D, shear, by_p, by_x, q_q = viscosity + law.K * slope * N, 0.0, 0.0, 0.0, 0.0
    if D > 0 and q > top > limit + slope * (p + law.pt):
        shear, by_p, by_x = (top - limit - slope * (p + law.pt)) / D, -slope / D, top_x / D
    if q <= top:
        top, top_x, q_q = q, 0.0, 1.0
    V, V_p, V_x = -N * shear, -N * by_p, -N * by_x
    if p - law.K * V < -law.pt:
        V, V_p, V_x = (p + law.pt) / law.K, 1 / law.K, 0.0
    return _result(law, (p, q, k, densest), (V, p - law.K * V, top), (V_p, 0.0, 0.0, q_q, V_x, top_x), False)


@internal
def _return_to_corner(law, p, q, k, densest, slope, limit, viscosity):
    """Return the results at the intersection of cap and line.

    The residual, q^2 of the cap less that of the line, increases with V. The derivatives are the implicit ones of
    y^2 + (q/Mc)^2 = a^2 and q + 3 G ls + 3 G q (V + N ls)/(y Mc^2) = q_tr with y = P_tr - K V - b.
    """
    P_trial, onset, K, M2, G3, N = p + law.pt, np.log(densest / k), law.K, law.M**2, 3 * law.G, law.dilatancy
    pc = hardening(law, densest)[0]
    a_before = (pc + law.pt) / 2
    b_before = a_before + reaction(law, densest)[0]
    # from the intersection of line and supercritical side before hardening, or the nearest point
    square, half = 1 + slope * slope / M2, b_before - slope * limit / M2
    root = np.sqrt(max(half * half - square * (b_before**2 - a_before**2 + limit * limit / M2), 0.0))
    V = (P_trial - (half + root) / square) / K
    low, high, tolerance = -np.inf, np.inf, CORNER_TOLERANCE * (abs(P_trial) + b_before) / K
    shear, a, b, h, g, iterations = 0.0, a_before, b_before, 0.0, 0.0, MAX_ITERATIONS + 1
    for _ in range(MAX_ITERATIONS):
        a, b, h, g = a_before, b_before, 0.0, 0.0  # h = da/dV, g = db/dV
        if onset < V:
            rise, H, u_rise, U = pressure_rise(law, densest, V - onset, pc)
            a, b, h, g = a_before + rise / 2, b_before + rise / 2 + u_rise, H / 2, H / 2 + U
        y = P_trial - K * V - b
        if y > 0:
            y_V = -K - g
            q_square, q_square_V = M2 * (a - y) * (a + y), 2 * M2 * (a * h - y * y_V)
            q_cap = np.sqrt(max(q_square, 0.0))
            ratio = G3 * q_cap / (y * M2)
            shear = (q - q_cap - ratio * V) / (G3 + ratio * N)
            line, by_V = slope * (P_trial - K * V) + limit, -slope * K
            if viscosity > 0 and shear > 0:
                line += viscosity * shear
                if q_cap > 0:
                    q_V = q_square_V / (2 * q_cap)
                    ratio_V = ratio * (q_V / q_cap - y_V / y)
                    by_V -= viscosity * (q_V + ratio_V * (V + N * shear) + ratio) / (G3 + ratio * N)
            residual = q_square - line * line
            change = -residual / (q_square_V - 2 * line * by_V)
        else:
            residual, change = -y, (y - a / 2) / (K + g)
        if (y > 0 and abs(change) <= tolerance) or high - low <= tolerance:
            iterations = 0
            break
        if residual > 0:
            high = V
        else:
            low = V
        next_V = V + change
        V = next_V if low < next_V < high else (low + high) / 2

    P = P_trial - K * V
    if viscosity > 0 and P - b < TOP_DISTANCE * a:
        return _return_to_top(law, p, q, k, densest, slope, limit, viscosity)
    q_end, hardens = slope * P + limit + viscosity * shear, onset < V
    rate, shift = h, g  # of a and b by the logarithm of the density ratio that determines pc
    if not hardens:
        rate = hardening(law, densest)[1] / 2
        shift = rate + reaction(law, densest)[1]
    y = P - b
    flow, weight = V + N * shear, G3 / (y * M2)
    q_V, q_l = -slope * K, viscosity
    # residuals by V and ls
    f_V, f_l = -2 * y * (K + g) + 2 * q_end * q_V / M2 - 2 * a * h, 2 * q_end * q_l / M2
    g_V = q_V + weight * (q_V * flow + q_end + q_end * flow * (K + g) / y)
    g_l = q_l + G3 + weight * (q_l * flow + q_end * N)
    determinant = f_V * g_l - f_l * g_V
    # by the trial pressure, the trial shear stress, and the density ratio that determines pc
    f_p, g_p = 2 * y + 2 * q_end * slope / M2, slope + weight * (slope * flow - q_end * flow / y)
    f_x, g_x = -2 * (shift * y + rate * a), weight * q_end * flow * shift / y
    V_p, l_p = (-f_p * g_l + f_l * g_p) / determinant, (-f_V * g_p + g_V * f_p) / determinant
    V_q, l_q = -f_l / determinant, f_V / determinant
    V_x, l_x = (-f_x * g_l + f_l * g_x) / determinant, (-f_V * g_x + g_V * f_x) / determinant
    by_p, by_q, by_x = slope + q_V * V_p + q_l * l_p, q_V * V_q + q_l * l_q, q_V * V_x + q_l * l_x
    result = _result(law, (p, q, k, densest), (V, P - law.pt, q_end), (V_p, V_q, by_p, by_q, V_x, by_x), hardens)
    return (iterations, *result[1:])
