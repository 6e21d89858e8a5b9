"""Return mapping to a cap whose constants are tables over the density ratio: implicit, one point, in strains.

    cap   y^2 + (R q)^2 <= a^2,  y = p - pa   p >= pa,   associated,  dV = 2 l y,  de = 2 l R^2 q
    line  q <= d + p tan beta                 p <= pa,   e at constant volume
    cut   p >= -d/tan beta

The symbols are those of `density_cap`, with a = pb - pa; V and e are plastic volume and shear strain. The line meets
the top of the cap, where both flow at constant volume. All tables, moduli included, belong to the largest density
ratio D. Let E and T be the volumetric and the equivalent deviatoric elastic strain of the trial state. Backward Euler
results in

    p = K (E - V),  q = 3 G T w,  w = y/(y + 3 G R^2 V)        on the cap, one root V
    p = K E,        q = d + p tan beta                         on the line

at the tables of D = max(D_n, k_n exp V). Steady rolling replaces p on the line by the carried pressure of
`drucker_prager_cap`, which may then lie below the cap at p > pa: their corner has q of the line and V of the cap.

References
----------
I. C. Sinka, J. C. Cunningham and A. Zavaliangos, Powder Technol. 133 (2003) 33-43 (cap over density); J. C. Simo and
T. J. R. Hughes, Computational Inelasticity, Springer 1998, chapter 3 (return mapping).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from compact.material.density_cap import DensityDependentCap
from compact.material.elliptic_cap import MAX_ITERATIONS, RESIDUAL_ACCEPTED, RESIDUAL_TOLERANCE, STEP_TOLERANCE
from compact.numerics import Array
from compact.numerics.jit import compiled

ROUNDING = 4e-15  # [-], of stresses over a; a state on a surface is inside


class TableConstants(NamedTuple):
    """Tables of a `DensityDependentCap` at one speed, for compiled code.

    Parameters
    ----------
    knots : ndarray, shape (n,)
        Logarithms of the density ratios of the cap [-].
    pieces : ndarray, shape (n - 1, 4, 4)
        Coefficients of the cubic pieces of ln pb, d, tan beta and R, highest power first.
    elastic : ndarray, shape (m, 3)
        Density ratio [-], Young's modulus [Pa] and Poisson's ratio [-].
    rate_factor : float
        Factor of pb at the speed [-].
    flat : bool
        True, since the tables depend on the largest density ratio.
    """

    knots: Array
    pieces: Array
    elastic: Array
    rate_factor: float
    flat: bool


def table_constants(law: DensityDependentCap, rate_factor: float) -> TableConstants:
    """Return the tables of a law for compiled code.

    Parameters
    ----------
    rate_factor : float
        Factor of pb at the speed [-].

    Returns
    -------
    TableConstants
    """
    tables = law.tables
    pieces = np.ascontiguousarray(np.array([curve.c for curve in tables.curves]).transpose(2, 0, 1))
    elastic = np.array([tables.elastic_density_ratio, tables.youngs_modulus, tables.poisson]).T.copy()
    return TableConstants(np.log(tables.density_ratio), pieces, elastic, float(rate_factor), True)


def for_tables(variant: Callable[..., Any], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function for compiled code that the type of its first argument selects when its caller is compiled.

    Each type of constants thus has compiled callers of its own, and none of them contains the other function.

    Parameters
    ----------
    variant, otherwise : callable
        Compiled functions, whose first argument is a `TableConstants`, or constants of another law.
    """

    def selected(law: Any, *arguments: Any) -> Any:
        raise NotImplementedError("for compiled code only")

    @overload(selected)
    def select(law, *arguments):  # noqa: ANN002, ARG001 - numba compares both signatures, annotations included
        chosen = variant if getattr(law, "instance_class", None) is TableConstants else otherwise
        return lambda law, *arguments: chosen(law, *arguments)

    return selected


@compiled
def evaluate_tables(law: TableConstants, k: float) -> tuple:
    """Evaluate the tables at a density ratio.

    Beyond the last row pb rises by the modulus dpb/d ln k of its end, and the others keep their values.

    Returns
    -------
    tuple of float
        K, G, pa, a [Pa], R [-], d [Pa] and tan beta [-], each followed by its derivative by ln k.
    """
    rows = law.elastic
    E, nu, E_l, nu_l = rows[0, 1], rows[0, 2], 0.0, 0.0
    if k >= rows[-1, 0]:
        E, nu = rows[-1, 1], rows[-1, 2]
    elif k > rows[0, 0]:
        row = int(np.searchsorted(rows[:, 0], k, side="right")) - 1
        span = rows[row + 1, 0] - rows[row, 0]
        E_l, nu_l = (rows[row + 1, 1] - rows[row, 1]) / span, (rows[row + 1, 2] - rows[row, 2]) / span
        E, nu = rows[row, 1] + E_l * (k - rows[row, 0]), rows[row, 2] + nu_l * (k - rows[row, 0])
        E_l, nu_l = k * E_l, k * nu_l
    K, G = E / (3 - 6 * nu), E / (2 + 2 * nu)
    K_l, G_l = K * (E_l / E + 2 * nu_l / (1 - 2 * nu)), G * (E_l / E - nu_l / (1 + nu))
    place = np.log(k)
    beyond = max(place - law.knots[-1], 0.0)
    place = min(place, law.knots[-1])
    piece = min(max(int(np.searchsorted(law.knots, place, side="right")) - 1, 0), len(law.pieces) - 1)
    x = place - law.knots[piece]
    logarithm, logarithm_l = _cubic(law.pieces[piece, 0], x)
    d, d_l = _cubic(law.pieces[piece, 1], x)
    t, t_l = _cubic(law.pieces[piece, 2], x)
    R, R_l = _cubic(law.pieces[piece, 3], x)
    pb = law.rate_factor * np.exp(logarithm)
    pb_l = pb * logarithm_l
    if beyond > 0:
        pb, d_l, t_l, R_l = pb + pb_l * beyond, 0.0, 0.0, 0.0
    share = 1 / (1 + R * t)
    pa = (pb - R * d) * share
    pa_l = (pb_l - R_l * d - R * d_l - pa * (R_l * t + R * t_l)) * share
    return K, K_l, G, G_l, pa, pa_l, pb - pa, pb_l - pa_l, R, R_l, d, d_l, t, t_l


@compiled
def _cubic(piece, x):
    """Return the value and the slope of a cubic."""
    return ((piece[0] * x + piece[1]) * x + piece[2]) * x + piece[3], (3 * piece[0] * x + 2 * piece[1]) * x + piece[2]


@compiled
def elastic_table_path(
    law: TableConstants, before: tuple, strain: tuple, still: bool, carried: float, derivatives: Array
) -> tuple:
    """Return True if a path is elastic, and the state after it, as `cap_plasticity.elastic_cap_path`."""
    tables = evaluate_tables(law, before[5])
    volume, shear, deviator = _trial_strain(tables, before, strain)
    if not (still or _is_elastic(tables, volume, shear, carried)):
        return False, before
    response = 0.0, 2 * tables[2], (0.0, 0.0, 0.0, 0.0, 0.0, tables[3] * 2)
    _propagate(before, (volume, deviator), tables, tables, response, False, 1.0, derivatives)
    return True, (*_stress(tables[0] * volume, 2 * tables[2], deviator), before[4], before[5])


@compiled
def integrate_table_point(
    law: TableConstants,
    before: tuple,
    strain: tuple,
    guess: float,
    share: float,
    carried: float,
    derivatives: Array,
) -> tuple:
    """Integrate the constitutive law at one point in one step, as `cap_plasticity.integrate_point`."""
    k, densest = before[4], before[5]
    tables = evaluate_tables(law, densest)
    volume, shear, deviator = _trial_strain(tables, before, strain)
    iterations, response, x = _return(law, tables, (volume, shear, k, densest), guess, carried)
    V, S, _ = response
    k *= np.exp(V)
    hardens = k > densest
    end = tables
    if hardens:
        densest = k
        end = evaluate_tables(law, k)
    p = end[0] * (volume - V)
    _propagate(before, (volume, deviator), tables, end, response, hardens, share, derivatives)
    q = 1.5 * S * shear
    dissipated = p * V + q * (shear - q / (3 * end[2]))
    converged = iterations <= MAX_ITERATIONS and np.isfinite(p + k + dissipated)
    return converged, (*_stress(p, S, deviator), k, densest), dissipated, x


@compiled
def _stress(p, S, deviator):
    """Return the stress (xx, yy, zz, xy) of a mean pressure and a deviatoric strain times S."""
    xx, yy, zz, xy = deviator
    return S * xx - p, S * yy - p, S * zz - p, S * xy


@compiled
def _trial_strain(tables, before, strain):
    """Return volumetric compression, q/(3 G) and the deviator (xx, yy, zz, xy) of the trial elastic strain."""
    K, two_shear = tables[0], 2 * tables[2]
    third = (strain[0] + strain[1]) / 3
    mean = (before[0] + before[1] + before[2]) / 3
    xx, yy = (before[0] - mean) / two_shear + strain[0] - third, (before[1] - mean) / two_shear + strain[1] - third
    zz, xy = (before[2] - mean) / two_shear - third, before[3] / two_shear + strain[2] / 2
    return -mean / K - 3 * third, np.sqrt((xx * xx + yy * yy + zz * zz + 2 * xy * xy) / 1.5), (xx, yy, zz, xy)


@compiled
def _line_limit(tables, p, carried):
    """Return the largest q on the line and its derivatives by p and by ln D."""
    _, _, _, _, pa, pa_l, _, _, _, _, d, d_l, t, t_l = tables
    place = p if np.isnan(carried) else carried
    if place >= pa:
        return d + t * pa, 0.0, d_l + t_l * pa + t * pa_l
    if place <= -d / t:
        return 0.0, 0.0, 0.0
    return d + t * place, t if np.isnan(carried) else 0.0, d_l + t_l * place


@compiled
def _is_elastic(tables, volume, shear, carried):
    """Return True if a trial state does not yield."""
    K, _, G, _, pa, _, a, _, R, _, d, _, t, _ = tables
    p, q = K * volume, 3 * G * shear
    if d + t * p < -ROUNDING * a or q > _line_limit(tables, p, carried)[0] + ROUNDING * a:
        return False
    return p <= pa or (p - pa) ** 2 + (R * q) ** 2 <= (a * (1 + ROUNDING)) ** 2


@compiled
def _return(law, tables, trial, guess, carried):
    """Return iterations, the response (V, S, slopes), and V as a guess.

    The deviatoric stress is S times the deviatoric elastic strain of the trial state. The slopes are the derivatives of
    V and of S by volumetric and equivalent elastic strain of the trial state, and by the logarithm of the density ratio
    that determines D.
    """
    K, K_l, G, G_l, pa, _, a, _, R, _, d, d_l, t, t_l = tables
    volume, shear, _, _ = trial
    p = K * volume
    if _is_elastic(tables, volume, shear, carried):
        return 0, (0.0, 2 * G, (0.0, 0.0, 0.0, 0.0, 0.0, 2 * G_l)), 0.0
    limit, limit_p, limit_l = _line_limit(tables, p, carried)
    if p <= pa or (p - pa) ** 2 + (R * min(limit, 3 * G * shear)) ** 2 <= a * a:
        V, V_v, V_l, S, S_v, S_e, S_l = 0.0, 0.0, 0.0, 2 * G, 0.0, 0.0, 2 * G_l
        if d + t * p < 0:
            V, V_v, V_l = volume + d / (t * K), 1.0, d / (t * K) * (d_l / d - t_l / t - K_l / K)
        if 3 * G * shear > limit:
            S = limit / (1.5 * shear)
            S_v, S_e, S_l = limit_p * K / (1.5 * shear), -S / shear, (limit_l + limit_p * K_l * volume) / (1.5 * shear)
        return 0, (V, S, (V_v, 0.0, V_l, S_v, S_e, S_l)), 0.0
    iterations, V, partials = _solve(law, tables, trial, guess, np.nan)
    if not np.isnan(carried):
        end = _tables_after(law, tables, trial, V)
        if 1.5 * partials[6] * shear > _line_limit(end, np.inf, carried)[0] * (1 + ROUNDING):
            iterations, V, partials = _solve(law, tables, trial, V, carried)
    _, f_V, f_v, f_e, f_l, _, S, S_V, S_v, S_e, S_l = partials
    if np.log(trial[3] / trial[2]) < V:
        f_V, S_V = f_V + f_l, S_V + S_l
    V_v, V_e, V_l = -f_v / f_V, -f_e / f_V, -f_l / f_V
    return iterations, (V, S, (V_v, V_e, V_l, S_v + S_V * V_v, S_e + S_V * V_e, S_l + S_V * V_l)), V


@compiled
def _tables_after(law, tables, trial, V):
    """Return the tables after a plastic volumetric strain."""
    k = trial[2] * np.exp(V)
    return evaluate_tables(law, k) if k > trial[3] else tables


@compiled
def _solve(law, tables, trial, guess, carried):
    """Return iterations, V and `_partials` on the cap, or at its corner with the line at a carried pressure.

    Newton's method on a/N = 1, N^2 = y^2 + (R q)^2, or far inside on N = a, is safeguarded by bisection.
    """
    onset = np.log(trial[3] / trial[2])
    low, high = 0.0, trial[0]  # p = 0 there
    V = guess if low < guess < high else 0.0
    partials = _partials(tables, trial, 0.0, carried)
    for iteration in range(MAX_ITERATIONS):
        after = _tables_after(law, tables, trial, V)
        partials = _partials(after, trial, V, carried)
        y, f_V, _, _, f_l, N, _, _, _, _, _ = partials
        a, slope = after[6], 0.0
        if onset < V:
            f_V, slope = f_V + f_l, after[7]
        N_V = (f_V + a * slope) / N
        residual, change = a / N - 1, -1.0
        if y <= 0:
            residual, V_next = np.inf, -1.0
        else:
            change = residual * N * N / (a * N_V - slope * N) if residual <= 1 else (a - N) / (N_V - slope)
            V_next = V + change
        stalled = min(abs(change), high - low) <= STEP_TOLERANCE * V
        if abs(residual) <= RESIDUAL_TOLERANCE or (stalled and abs(residual) <= RESIDUAL_ACCEPTED):
            return iteration + 1, V, partials
        if residual < 0:
            low = V
        else:
            high = V
        V = V_next if low < V_next < high else (low + high) / 2
    return MAX_ITERATIONS + 1, V, partials


@compiled
def _partials(tables, trial, V, carried):
    """Return y, derivatives of f = (y^2 + (R q)^2 - a^2)/2 by V, E, T and ln D, N, and S with the same derivatives."""
    K, K_l, G, G_l, pa, pa_l, _, _, _, _, _, _, _, _ = tables
    a, a_l, R, R_l = tables[6], tables[7], tables[8], tables[9]
    volume, shear, _, _ = trial
    y, y_l = K * (volume - V) - pa, K_l * (volume - V) - pa_l
    if np.isnan(carried):
        b, b_l = 3 * G * R * R, 3 * R * (G_l * R + 2 * G * R_l)
        inverse = 1 / (y + b * V)
        w, w_y = y * inverse, b * V * inverse * inverse
        w_V, w_v, w_l = -K * w_y - y * b * inverse * inverse, K * w_y, w_y * y_l - y * V * b_l * inverse * inverse
        S, S_V, S_v, S_e, S_l = 2 * G * w, 2 * G * w_V, 2 * G * w_v, 0.0, 2 * (G_l * w + G * w_l)
    else:
        limit, _, limit_l = _line_limit(tables, np.inf, carried)
        S, S_V, S_v, S_l = limit / (1.5 * shear), 0.0, 0.0, limit_l / (1.5 * shear)
        S_e = -S / shear
    r, by_S = 1.5 * R * S * shear, 1.5 * R * shear
    f_V, f_v, f_e = -K * y + r * by_S * S_V, K * y + r * by_S * S_v, r * (1.5 * R * S + by_S * S_e)
    f_l = y * y_l + r * (by_S * S_l + 1.5 * R_l * S * shear) - a * a_l
    return y, f_V, f_v, f_e, f_l, np.sqrt(y * y + r * r), S, S_V, S_v, S_e, S_l


@compiled
def _propagate(before, trial, tables, end, response, hardens, share, derivatives):
    """Propagate the derivatives of stress and logarithms of the density ratios through one step."""
    K, K_l, G, G_l = tables[:4]
    volume, (sxx, syy, szz, sxy) = trial
    V, S, (V_v, V_e, V_l, S_v, S_e, S_l) = response
    mean = (before[0] + before[1] + before[2]) / 3
    two_shear, shear = 2 * G, np.sqrt((sxx * sxx + syy * syy + szz * szz + 2 * sxy * sxy) / 1.5)
    by_inner = 1 / (1.5 * shear) if shear > 0 else 0.0
    for j in range(derivatives.shape[1]):
        xx, yy, zz = derivatives[0, j], derivatives[1, j], derivatives[2, j]
        xy, k, densest = derivatives[3, j], derivatives[4, j], derivatives[5, j]
        exx = share if j == 0 else 0.0
        eyy = share if j == 1 else 0.0
        gamma = share if j == 2 else 0.0
        third, middle, softer = (exx + eyy) / 3, (xx + yy + zz) / 3, G_l / G * densest
        v = (mean * K_l / K * densest - middle) / K - 3 * third
        xx = (xx - middle - softer * (before[0] - mean)) / two_shear + exx - third
        yy = (yy - middle - softer * (before[1] - mean)) / two_shear + eyy - third
        zz = (zz - middle - softer * (before[2] - mean)) / two_shear - third
        xy = (xy - softer * before[3]) / two_shear + gamma / 2
        e = by_inner * (sxx * xx + syy * yy + szz * zz + 2 * sxy * xy)
        rise = k if hardens else densest
        V_j, S_j = V_v * v + V_e * e + V_l * rise, S_v * v + S_e * e + S_l * rise
        after = k + V_j if hardens else densest
        p = end[0] * (v - V_j) + end[1] * (volume - V) * after
        derivatives[0, j] = S * xx + S_j * sxx - p
        derivatives[1, j] = S * yy + S_j * syy - p
        derivatives[2, j] = S * zz + S_j * szz - p
        derivatives[3, j] = S * xy + S_j * sxy
        derivatives[4, j] = k + V_j
        derivatives[5, j] = after
