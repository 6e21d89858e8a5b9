"""Cap plasticity with Heckel hardening: implicit integration of many material points.

A strain increment is split into equal substeps. Each maps its elastic trial state back to the yield surface by backward
Euler. The surface is the ellipse (`elliptic_cap`), or the ellipse with the shear line of Drucker and Prager
(`drucker_prager_cap`).

References
----------
J. C. Simo and T. J. R. Hughes, Computational Inelasticity, Springer 1998, chapter 3 (return mapping).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from compact.material.drucker_prager_cap import is_elastic_in_line, return_to_line
from compact.material.elliptic_cap import (
    MAX_ITERATIONS,
    NO_SLOPES,
    CapConstants,
    cap_constants,
    hardening,
    is_elastic,
    return_map,
    yield_surface,
)
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.jit import compiled, internal
from compact.numerics.validation import require_finite, require_inside, require_positive

__all__ = ["CapConstants", "cap_constants", "hardening", "return_map"]  # re-exported

FIELDS = ("stress", "density_ratio", "max_density_ratio", "plastic_work")  # of a `MaterialPoint`
NO_STRAIN = 1e-13  # [-], of a path that is elastic from any state; above the rounding of the strain
CONFINED_STEPS = 200  # [-], of the compression of mix by an earlier pass


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

    @property
    def pressure(self) -> Array:
        """Mean pressure [Pa], shape (n,)."""
        return np.asarray(-self.stress[:, :3].mean(axis=1))

    def density_under_load(self, law: Compaction) -> Array:
        """Return the density ratio with the elastic compression, k exp(p/K) [-], shape (n,)."""
        return np.asarray(self.density_ratio * np.exp(self.pressure / law.bulk_modulus))

    def map(self, function: Callable[..., Array], *others: "MaterialPoint") -> "MaterialPoint":
        """Return the points whose fields are a function of the fields of these points and of others."""
        return MaterialPoint(*(function(*(getattr(each, name) for each in (self, *others))) for name in FIELDS))


def initial_state(law: Compaction, n: int) -> MaterialPoint:
    """Return stress-free points at the initial density ratio of a law.

    Parameters
    ----------
    law : Compaction
        Constitutive law.
    n : int
        Number of points.

    Returns
    -------
    MaterialPoint
    """
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

    Returns
    -------
    MaterialPoint
    """
    fresh, fed = initial_state(law, 1), float(law.fed_density_ratio)
    constants = cap_constants(law, rate_factor)
    stiffness = constants.K + 4 * constants.G / 3
    require_inside(fed, 1, density_ratio=density_ratio)

    def strained(state: MaterialPoint, strain: float) -> MaterialPoint:
        return integrate_points(law, state, np.array([[0.0, strain, 0.0]]), rate_factor, tangent=False)[0]

    def compacted(strain: float) -> MaterialPoint:
        state = fresh
        for _ in range(CONFINED_STEPS):
            state = strained(state, -strain / CONFINED_STEPS)
        rise = -2 * state.stress[0, 1] / stiffness
        return strained(state, brentq(lambda part: strained(state, part).stress[0, 1], 0.0, rise, xtol=NO_STRAIN))

    plastic = float(np.log(density_ratio / fed))
    low = max(plastic - constants.pt / constants.K, 0.0)  # cohesive mix may be left in tension
    high = plastic + 2 * hardening(constants, density_ratio)[0] / constants.K
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
    stress, scalars, tangents = np.empty((n, 4)), np.empty((3, n)), np.empty((n if tangent else 0, 3, 3))
    results = stress, scalars, tangents
    failed = _integrate_all(constants, constants.line or None, tuple(arrays), strain, results)
    if failed >= 0:
        require_finite(strain=strain, stress=state.stress, density_ratio=state.density_ratio)
        raise RuntimeError(
            f"the return mapping did not converge for a strain increment of {np.abs(strain[failed]).max():.3g} "
            f"from a stress of {np.abs(state.stress[failed]).max():.3g} Pa at density ratio "
            f"{state.density_ratio[failed]:.6g} (point {failed}); use smaller increments"
        )
    return MaterialPoint(stress, *scalars), tangents if tangent else None


@compiled
def _integrate_all(law, line, state, strain, results):
    """Integrate all points; return the first that did not converge, or -1."""
    stress, density_ratio, max_density_ratio, work = state
    new_stress, new_scalars, tangents = results
    derivatives = np.empty((6, 3 if len(tangents) else 0))
    for i in range(len(strain)):
        before = (stress[i, 0], stress[i, 1], stress[i, 2], stress[i, 3], density_ratio[i], max_density_ratio[i])
        part = (strain[i, 0], strain[i, 1], strain[i, 2])
        derivatives[:] = 0.0
        converged, after, dissipated, _ = integrate_point(law, line, before, part, 0.0, 1.0, np.nan, derivatives)
        if not converged:
            return i
        for j in range(4):
            new_stress[i, j] = after[j]
        new_scalars[0, i] = after[4]
        new_scalars[1, i] = after[5]
        new_scalars[2, i] = work[i] + dissipated
        if len(tangents):
            for j in range(3):  # assignments of arrays take seconds to compile
                tangents[i, 0, j] = derivatives[0, j]
                tangents[i, 1, j] = derivatives[1, j]
                tangents[i, 2, j] = derivatives[3, j]
    return -1


@compiled
def integrate_path(law, line, before, strain, multipliers, carried, derivatives) -> tuple:
    """Integrate the constitutive law of one point along a straight strain path; one step if the path is elastic.

    The yield surface is convex, so that a path is elastic if its ends are.

    Parameters
    ----------
    line : True or None
        True for a law with a shear line; None, a type of its own, compiles the ellipse without it.
    before : tuple of float
        Stress xx, yy, zz, xy [Pa], density ratio and largest density ratio [-] before the path.
    strain : tuple of float
        Strain of the path xx, yy, 2 xy [-].
    multipliers : ndarray
        One initial guess of x for each substep of a path that yields, 0 for none; replaced by the solution.
    carried : float
        Carried pressure at the end of the path, which it approaches linearly [Pa], NaN for the pressure itself; see
        `drucker_prager_cap`.
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
    still = max(abs(strain[0]), abs(strain[1]), abs(strain[2])) <= NO_STRAIN  # interpolated states may lie outside
    p, q, deviator = _trial_state(law, before, strain)
    densest = before[5] if law.flat else before[4]
    if line is None:
        elastic = is_elastic(law, p, q, yield_surface(law, p, densest))
    else:
        elastic = is_elastic_in_line(law, p, q, densest, carried)
    if still or elastic:
        _propagate(law, deviator, 1.0, NO_SLOPES, not law.flat, 1.0, derivatives)
        xx, yy, zz, xy = _stress(p, deviator, 1.0)
        end = (xx, yy, zz, xy, before[4], densest)
        converged, plastic_work = True, 0.0
        work = _work(before, end, strain)
    else:
        steps, x = len(multipliers), 0.0
        part = (strain[0] / steps, strain[1] / steps, strain[2] / steps)
        end, converged, plastic_work, work = before, True, 0.0, 0.0
        pressure = -(before[0] + before[1] + before[2]) / 3
        for step in range(steps):
            start, guess = end, multipliers[step] if multipliers[step] > 0 else x
            limit = pressure + (carried - pressure) * ((step + 1) / steps)
            good, end, dissipated, x = integrate_point(law, line, start, part, guess, 1 / steps, limit, derivatives)
            multipliers[step] = x
            converged = converged and good
            plastic_work += dissipated
            work += _work(start, end, part)
    return converged, end, plastic_work, work


@internal
def _work(before, after, strain):
    """Return the work of deformation of an increment [J/m3]."""
    xx, yy, xy = before[0] + after[0], before[1] + after[1], before[3] + after[3]
    return (xx * strain[0] + yy * strain[1] + xy * strain[2]) / 2


@compiled
def integrate_point(law, line, before, strain, guess, share, carried, derivatives) -> tuple:
    """Integrate the constitutive law at one point in one step.

    Parameters
    ----------
    line : True or None
        As of `integrate_path`.
    before : tuple of float
        Stress xx, yy, zz, xy [Pa], density ratio and largest density ratio [-] before the increment.
    strain : tuple of float
        Strain increment xx, yy, 2 xy [-].
    guess : float
        Initial guess of x of the return mapping [-], 0 for none.
    share : float
        Share of the increment in the strain of the path [-].
    carried : float
        Carried pressure [Pa], NaN for the pressure itself.
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
    if line is None:
        result = return_map(law, p, q, before[4], densest, guess)
    else:
        result = return_to_line(law, p, q, before[4], densest, guess, carried, share)
    iterations, p, scale, k, densest, dissipated, x, slopes = result
    hardened = densest == k and (k != before[4] or not law.flat)
    _propagate(law, deviator, scale, slopes, hardened, share, derivatives)
    converged = iterations <= MAX_ITERATIONS and np.isfinite(p + k + dissipated)
    return converged, (*_stress(p, deviator, scale), k, densest), dissipated, x


@internal
def _stress(p, deviator, scale):
    """Return the stress (xx, yy, zz, xy) of a mean pressure and a scaled deviator."""
    sxx, syy, szz, sxy = deviator
    return scale * sxx - p, scale * syy - p, scale * szz - p, scale * sxy


@internal
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


@internal
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
