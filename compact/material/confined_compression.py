"""Confined compression of elastic-plastic mix on an elliptic cap: its stress path, and the yield pressure for it.

Let P = p + pt and a = (pc + pt)/2. Points of the cap are P = a (1 + cos t), q = M a sin t. The vertical stress
s_v = p + 2 q/3 is

    s_v + pt = a [1 + S cos(t - t0)],    S = sqrt(1 + 4 M^2/9),    tan t0 = 2 M/3

Without lateral strain the shear strain is 2/3 of the volumetric strain. Associated flow with a plastic volumetric
strain dV = dk/k and elastic strains dp/K and dq/(3 G) requires

    (tan t - 2 M/3)/M = 2/3 dp/dV/K - dq/dV/(3 G)

Rigid-plastic mix flows at t0, where s_v is largest. Elastic mix deviates by an angle d of first order in its elastic
strain, and s_v by second order. A Heckel curve s_v(k) is satisfied by

    a = (s_v + pt)/(1 + S) (1 + g),    g = (1 + S)/(1 + S cos d) - 1

The equation of flow for d has one smooth solution, from which other initial stresses depart within an elastic strain.
Chebyshev collocation over the logarithm of the curve finds it. Let x = k/(1 - k). For small elastic strains d is
proportional to x and g to x^2. Where the curve is as steep as the elastic mix, x = K_H K, both become constant. A short
polynomial in z = x/(1 + x/(K_H K)) represents g.

References
----------
J. P. Boyd, Chebyshev and Fourier Spectral Methods, 2nd ed., Dover 2001, section 3 (collocation).
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from compact.numerics import Array

NODES = 20  # [-], of the collocation; 28 change the factor by less than 1e-8 for moduli of 20 MPa and more
MAX_ITERATIONS = 30  # [-], of Newton's method; 4 are usual
ANGLE_TOLERANCE = 1e-12  # [rad], last change of the angle
TERMS = 4  # [-], of the polynomial; residual 1e-7 of the stress at 120 MPa up to a density ratio of 0.998
CACHED_LAWS = 256  # [-], whose polynomials are kept


@lru_cache(CACHED_LAWS)
def elastic_polynomial(law: Any, end: float) -> tuple[float, ...]:
    """Fit g = z^2 (c0 + c1 z + c2 z^2 + c3 z^3) over the Heckel curve of a law up to a density ratio.

    Parameters
    ----------
    law : Compaction
        Law of the mix.
    end : float
        Density ratio at the end of the curve [-].

    Returns
    -------
    tuple of float
        Coefficients c0 to c3 [-].
    """
    x, angle = stress_angle(law, end)
    z = x / (1 + x / (law.heckel_slope * law.bulk_modulus))
    powers = (z / z.max())[:, None] ** (2 + np.arange(TERMS))
    share = np.sqrt(1 + 4 * law.critical_slope**2 / 9)
    factor = (1 + share) / (1 + share * np.cos(angle)) - 1
    found = np.linalg.lstsq(powers, factor, rcond=None)[0]
    return tuple((found / z.max() ** (2 + np.arange(TERMS))).tolist())


def stress_angle(law: Any, end: float) -> tuple[Array, Array]:
    """Solve the equation of flow for the deviation of the stress from that of rigid-plastic mix.

    Parameters
    ----------
    end : float
        Density ratio at the end of the curve [-].

    Returns
    -------
    x : ndarray
        Ratio k/(1 - k) at the nodes [-].
    angle : ndarray
        Angle d = t - t0 there [rad].

    Raises
    ------
    RuntimeError
        If Newton's method does not converge.
    """
    M, K, G3 = law.critical_slope, law.bulk_modulus, 3 * law.shear_modulus
    length = np.log((1 - law.loose_density_ratio) / (1 - end))
    nodes = chebyshev.chebpts2(NODES)
    curve = length * (1 + nodes) / 2  # ln[(1 - k0)/(1 - k)], whose derivative by V is x
    x = np.exp(curve) / (1 - law.loose_density_ratio) - 1
    derivatives = chebyshev.chebval(nodes, chebyshev.chebder(np.eye(NODES))).T
    by_volume = x[:, None] * (derivatives @ np.linalg.inv(chebyshev.chebvander(nodes, NODES - 1))) * 2 / length
    share, rigid = np.sqrt(1 + 4 * M**2 / 9), np.arctan(2 * M / 3)
    total = curve / law.heckel_slope + law.tensile_strength
    angle = np.zeros(NODES)
    for _ in range(MAX_ITERATIONS):
        t, ratio = rigid + angle, 1 + share * np.cos(angle)
        a = total / ratio
        a_t = a * share * np.sin(angle) / ratio
        pressure, shear = a * (1 + np.cos(t)), M * a * np.sin(t)
        pressure_t, shear_t = a_t * (1 + np.cos(t)) - a * np.sin(t), M * (a_t * np.sin(t) + a * np.cos(t))
        residual = (np.tan(t) - 2 * M / 3) / M - by_volume @ (2 / 3 * pressure / K - shear / G3)
        slope = np.diag(1 / np.cos(t) ** 2 / M) - by_volume * (2 / 3 * pressure_t / K - shear_t / G3)
        change = np.linalg.solve(slope, -residual)
        angle = angle + change
        if np.abs(change).max() < ANGLE_TOLERANCE:
            return x, angle
    raise RuntimeError(
        f"the stress path of confined compression did not converge in {MAX_ITERATIONS} iterations; "
        f"`unloading_modulus` may be too small for the stresses of the Heckel curve, {total.max():.3g} Pa"
    )
