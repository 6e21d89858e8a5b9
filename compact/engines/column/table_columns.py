"""Columns of mix with tables over the density ratio (`density_cap_return`): rates and events of one column.

In the symbols of `column_ode`, with R, pa and a of the tables and dots for derivatives by ln k, the cap has

    P = p - pa,  Q = R^2 D,  h = (a a' + P pa' - R R' D^2) P

The moduli follow the density, so that dp = K (de - dV) + (K'/K) p dV and dD = 3G (2de/3 - Q w) + (G'/G) D dV. Then

    w/ds_v = (3/2)(b + g Q)/(g h + b B),  dp/ds_v = (3/2 - w B)/g,  B = 2G b + (G'/G D - 2G K'/K^2 p) P

Below pa the line D = +-(d + p tan beta) limits the deviator at constant volume, with friction tan beta and no
dilatancy. Neither the tables nor the moduli change below the largest density ratio so far.
"""

import numpy as np
from numpy.typing import ArrayLike

from compact.material.density_cap_return import TableConstants, evaluate_tables
from compact.material.elliptic_cap import CapConstants, hardening
from compact.numerics import Array
from compact.numerics.jit import compiled

CENTRE_SIDE = 1e-12  # [-], of p below pa over it, from which powder is on the shear line


@compiled
def table_rates(
    law: TableConstants, start: tuple, state: tuple, regime: tuple
) -> tuple[float, float, float, float, float, float]:
    """Return the rates of a column, as `column_ode.cap_rates`."""
    stress, p, _, k, k_max, by_V = state
    yielding, on_line = regime
    K, K_l, G, G_l, pa, pa_l, a, a_l, R, R_l, _, _, t, _ = evaluate_tables(law, max(k, k_max))
    D, ratio, g = 1.5 * (stress - p), 2 * G / K, 1.5 + 2 * G / K
    strain = p / K - start[1]
    if not yielding:
        dp = 1.5 / g
        return dp, 0.0, 0.0, dp / K, p * dp / K + D * (1 - dp) / (2 * G), strain
    if on_line:
        sign = 1.0 if D > 0 else -1.0
        dp = 1 / (1 + sign * t / 1.5)
        dD = 1.5 * (1 - dp)
        return dp, 0.0, (ratio * dp - dD) / (3 * G), dp / K, (p * dp + D * dD * K / (3 * G)) / K, strain
    scale = by_V if k >= k_max else 0.0
    K_l, G_l, pa_l, a_l, R_l = scale * K_l, scale * G_l, scale * pa_l, scale * a_l, scale * R_l
    P, Q = p - pa, R * R * D
    b, h = P - 1.5 * Q, (a * a_l + P * pa_l - R * R_l * D * D) * P
    B = 2 * G * b + (G_l / G * D - ratio * K_l / K * p) * P
    w = 1.5 * (b + g * Q) / (g * h + b * B)
    dp, dV = (1.5 - w * B) / g, w * P
    de = (dp - K_l / K * p * dV) / K
    return dp, dV, w * Q, de, p * de + D * (2 / 3 * (de + dV) - w * Q), strain


@compiled
def table_yield_stress(law: TableConstants, state: tuple, direction: float) -> float:
    """Vertical stress at which a column yields in loading (direction 1) or unloading (-1)."""
    stress, p, k = state
    K, _, G, _, pa, _, a, _, R, _, d, _, t, _ = evaluate_tables(law, k)
    oedometric = K + 4 * G / 3
    D, dp, dD = 1.5 * (stress - p), direction * K / oedometric, direction * 2 * G / oedometric
    square, half = dp * dp + (R * dD) ** 2, (p - pa) * dp + R * R * D * dD
    rest = (p - pa) ** 2 + (R * D) ** 2 - a * a
    cap = max(0.0, (np.sqrt(max(half * half - square * rest, 0.0)) - half) / square)
    if p + cap * dp >= pa and (p >= pa or abs(D + (pa - p) / dp * dD) <= d + t * pa):
        return stress + direction * cap
    cap = np.inf
    for sign in (1.0, -1.0):
        distance, approach = d + t * p - sign * D, sign * dD - t * dp
        if approach > 0:
            cap = min(cap, max(distance / approach, 0.0))
    return stress + direction * cap


@compiled
def table_centre_stress(law: TableConstants, state: tuple, direction: float) -> float:
    """Vertical stress at which loading leaves the shear line."""
    stress, p, k = state
    tables = evaluate_tables(law, k)
    distance = tables[4] - p
    rises = direction > 0 and stress > p and distance > 0
    return stress + distance * (1 + tables[12] / 1.5) if rises else direction * np.inf


@compiled
def is_below_centre(law: TableConstants, state: tuple) -> bool:
    """Return True if a column that yields lies on the shear line."""
    _, p, k = state
    return p < evaluate_tables(law, k)[4] * (1 - CENTRE_SIDE)


def moduli(law: CapConstants | TableConstants, density_ratio: ArrayLike) -> tuple[float | Array, float | Array]:
    """Return bulk and shear modulus [Pa] at density ratios [-]."""
    if isinstance(law, CapConstants):
        return law.K, law.G
    rows = [evaluate_tables(law, k) for k in np.ravel(density_ratio).tolist()]
    shape = np.shape(density_ratio)
    return np.array([row[0] for row in rows]).reshape(shape), np.array([row[2] for row in rows]).reshape(shape)


def isotropic_limits(law: CapConstants | TableConstants, density_ratio: float) -> tuple[float, float, float]:
    """Return isotropic yield pressure, tensile strength [Pa] and slope of the cap [-] at a density ratio [-]."""
    if isinstance(law, CapConstants):
        return hardening(law, density_ratio)[0], law.pt, law.M
    tables = evaluate_tables(law, density_ratio)
    return tables[4] + tables[6], tables[10] / tables[12], 1 / tables[8]
