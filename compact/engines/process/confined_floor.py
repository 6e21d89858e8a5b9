"""Confined floor of the resistance: work of confined compression of the throughput, in closed form.

    F = v_form T h_out w,    w = k_out sum_i c_i int_k_i^k_out s_v(k)/k^2 dk,    s_v = A (f pc(k) + pt) - pt

per roller, with the advance v_form T of the mould per stroke, the height h_out of the product, and the work w per
volume of the product. c_i is the share of grains that enter at the density ratio k_i, as fill or as feed. A rigid-
plastic column follows s_v; the elastic strain of a real one changes w by about 1 %.

F neither depends on the roller length nor on the number of strokes nor on the law of the feed: a stroke returns the
elastic work of the one before, and the plastic work of confined mix depends on its densities alone. It is the least
resistance that any model of the process can have, since shear in two dimensions adds to it. It is not for sizing.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from compact.material.laws import Compaction
from compact.numerics.validation import require_nonnegative, require_positive

QUADRATURE_POINTS = 64  # [-], of Gauss and Legendre over ln(1 - k); the error is below 1e-12 up to k = 0.99


@dataclass(frozen=True)
class GrainShare:
    """Share of the grains of a product that enter at one density ratio.

    Parameters
    ----------
    share : float
        Mass over that of the product [-].
    density_ratio : float
        Density ratio at entry [-].
    """

    share: float
    density_ratio: float


def confined_stress(material: Compaction, density_ratio: np.ndarray, rate_factor: float = 1.0) -> np.ndarray:
    """Return the vertical stress of rigid-plastic mix in confined compression [Pa].

    Parameters
    ----------
    density_ratio : ndarray
        Density ratio k [-].
    rate_factor : float
        Factor of the yield pressure [-].
    """
    ratio, strength = material.confined_stress_ratio, material.tensile_strength
    return ratio * (rate_factor * material.yield_pressure(density_ratio) + strength) - strength


def confined_work(
    material: Compaction, entries: Iterable[GrainShare], density_ratio: float, rate_factor: float = 1.0
) -> float:
    """Compute the work of confined compression per volume of the product [J/m3].

    Parameters
    ----------
    entries : iterable of GrainShare
        Grains by their density ratio at entry; the shares add up to 1.
    density_ratio : float
        Density ratio of the product [-], below 1.
    rate_factor : float
        Factor of the yield pressure [-].

    Returns
    -------
    float
        Work w per volume of the product [J/m3].

    Examples
    --------
    >>> mix = Compaction(60e6, 0.3, heckel_slope=13e-6, loose_density_ratio=0.72, critical_slope=1.2,
    ...                  tensile_strength=14e3, fed_density_ratio=0.75)
    >>> f"{confined_work(mix, [GrainShare(1.0, 0.75)], 0.98) / 1e3:.2f} kJ/m3"
    '22.81 kJ/m3'
    """
    if not 0 < density_ratio < 1:
        raise ValueError(f"`density_ratio` must lie between 0 and 1, got {density_ratio!r}")
    require_positive(rate_factor=rate_factor)
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    work = 0.0
    for entry in entries:
        low, high = -np.log1p(-entry.density_ratio), -np.log1p(-density_ratio)
        u = (low + high) / 2 + (high - low) / 2 * nodes
        k = -np.expm1(-u)
        integrand = confined_stress(material, k, rate_factor) / k**2 * (1 - k)  # dk = (1 - k) du
        work += entry.share * (high - low) / 2 * float(weights @ integrand)
    return density_ratio * work


def confined_floor(advance: float, height: float, work: float) -> float:
    """Return the confined floor of the resistance of one roller [N].

    Parameters
    ----------
    advance : float
        Advance of the mould per stroke [m].
    height : float
        Height of the product [m].
    work : float
        Confined work per volume of the product [J/m3].
    """
    require_nonnegative(advance=advance, height=height, work=work)
    return advance * height * work
