"""Galerkin matrix of a rolling contact on a linear layer, in Jacobi polynomials.

Under a surface pressure p and the traction f p the surface of a linear layer has the slope u' = -(2/E*) C S p. S
multiplies the Fourier transform of p (exp(-ikx), k > 0) by -i L - f M, and C, the creep along the path of the mix, by
(1/E(k))/(1/E*):

    S = S0 - i (L - 1) - f (M - b),   S0 p = (1/pi) PV int p(s)/(x - s) ds - f b p,   b = (1 - 2 nu)/(2 - 2 nu).

L - 1 and M - b, see `layer_compliance`, decay as exp(-2 k depth) with the depth of the first interface or of the base.
The contribution of the layer is therefore a short quadrature. E* is that of the top ply. S0, the half-plane with its
singular edges, is exact in Jacobi polynomials, and so is each creep branch of C applied to it, see
`creep_branch_matrices`. x is in half-widths, positive along the travel, from the middle of the contact.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
from scipy.special import digamma

from compact.engines.spectral.jacobi_basis import JacobiBasis, build_jacobi_basis
from compact.engines.spectral.layer_compliance import DECAY_DEPTH, LayerResponse, wave_grid
from compact.numerics import Array

HALF_WIDTH_MAX = 100.0  # [-], over the top ply; its grid of waves needs 0.1 GB, which grows with the square
MILLER_MODES = 30  # [-], least number of modes above the last at which the downward recurrence of ratios starts
BETA_SATURATED = 50.0  # [-], beta from which one edge of the contact does not influence the other: exp(-2 beta) = 0


def creep_branch_matrices(beta: Array, trailing_exponent: float, modes: int) -> Array:
    """Compute the Galerkin matrices of creep branches 1/(1 - (1/beta) d/dx) applied to S0.

    Over tests m = 0 ... modes and pressures k = 1 ... modes, shape (n, modes + 1, modes), for half-widths over the
    length of each branch beta [-], shape (n,):

        sin(pi alpha) <T_m, branch S0 Q_{k-1}> = delta_mk - k Z_mk       for m >= k
                                               = -(-1)^(m + k) k Z_mk    for m < k
        Z_mk = 2 I_max(m,k)(beta) K_min(m,k)(beta)

    Notes
    -----
    I and K are the modified Bessel functions if alpha is 1/2 (Hunter's closed form contains the first two), else the
    Coulomb functions of order m - 1/2. Both follow from the ratios r_m = I_{m+1}/I_m, by downward recurrence from high
    m, and the products D_m = 2 I_m K_m, by upward recurrence, so that nothing overflows for any beta.

    References
    ----------
    DLMF 10.29, 33.4; S. C. Hunter, J. Appl. Mech. 28 (1961) 611.
    """
    ratio = np.array([_bessel_ratios(each, trailing_exponent, modes) for each in beta.tolist()]).T
    product = np.empty((modes + 1, len(beta)))
    product[0] = _first_product(beta, trailing_exponent)
    steps = 2 / (beta * _coulomb_factor(np.arange(1, modes + 1)[:, None], trailing_exponent))
    for n in range(modes):
        product[n + 1] = ratio[n] * (steps[n] - ratio[n] * product[n])
    log_decay = np.concatenate([np.zeros((1, len(beta))), np.cumsum(np.log(ratio), axis=0)]).T
    m, k = np.ogrid[: modes + 1, 1 : modes + 1]
    low, high = np.minimum(m, k), np.maximum(m, k)
    Z = product.T[:, low] * np.exp(log_decay[:, high] - log_decay[:, low])
    sign = np.where(m < k, (-1.0) ** (m + k), 1.0)
    return ((m == k) - sign * k * Z) / np.sin(np.pi * trailing_exponent)


def _bessel_ratios(beta, trailing_exponent, modes):
    """List of I_{m+1}/I_m for m = 0 ... modes - 1 at one beta, from 1/ratio_{m-1} = constant_m + factor_m ratio_m."""
    top = modes + MILLER_MODES + int(min(6 * np.sqrt(beta), 6 * MILLER_MODES))
    order = np.arange(top, 0, -1)
    coulomb = _coulomb_factor(np.arange(top + 1, 0, -1), trailing_exponent)
    asymmetry = 2 * order * (0.5 - trailing_exponent) / (order**2 - 0.25)
    constant, factor = ((2 * order / beta + asymmetry) / coulomb[1:]).tolist(), (coulomb[:-1] / coulomb[1:]).tolist()
    start = float(beta / (top + 0.5 + np.hypot(top + 0.5, beta)))  # exact for large orders
    pairs = zip(constant, factor, strict=True)
    ratios = accumulate(pairs, lambda above, pair: 1 / (pair[0] + pair[1] * above), initial=start)
    return list(ratios)[: -modes - 1 : -1]


def _coulomb_factor(m, trailing_exponent):
    """R_m = sqrt((m - 1/2)^2 - (alpha - 1/2)^2)/(m - 1/2), which is 1 for Bessel functions (DLMF 33.4)."""
    return np.sqrt((m - trailing_exponent) * (m - 1 + trailing_exponent)) / (m - 0.5)


def _first_product(beta, trailing_exponent):
    """D_0 = 2 sin(pi alpha)/pi int_0^inf e^(-beta t) t^-B (2 + t)^-A dt int_0^2 e^(-beta t) t^-A (2 - t)^-B dt."""
    A, B = 1 - trailing_exponent, trailing_exponent
    s, weight = _half_line_rule()
    t = s / beta[:, None]
    outer = np.sum(weight * np.exp(-s) * (t / (2 + t)) ** A, axis=1)
    saturated = np.sum(weight * np.exp(-s) * np.minimum(t, 1) ** B * (2 - np.minimum(t, 1)) ** -B, axis=1)
    left, right, weight = _interval_rule()
    decay = np.exp(-np.minimum(beta, BETA_SATURATED)[:, None] * left)
    inner = np.sum(weight * decay * left**B * right**A, axis=1)
    return 2 * np.sin(np.pi * B) / np.pi * outer * np.where(beta < BETA_SATURATED, inner, saturated)


@lru_cache(maxsize=1)
def _half_line_rule():
    """Nodes s of (0, inf) and weights of ds/s, for any power > 0 at 0 and exp(-s) at infinity."""
    u = np.linspace(-4.7, 5, 401)
    return np.exp(u - np.exp(-u)), (u[1] - u[0]) * (1 + np.exp(-u))


@lru_cache(maxsize=1)
def _interval_rule():
    """Nodes t of (0, 2), 2 - t, and weights of dt/(t (2 - t)), for any powers > 0 at both ends."""
    u = np.linspace(-4.3, 4.3, 201)
    logit = np.pi * np.sinh(u)
    return 2 / (1 + np.exp(-logit)), 2 / (1 + np.exp(logit)), (u[1] - u[0]) * np.pi / 2 * np.cosh(u)


@dataclass(frozen=True)
class GalerkinSystem:
    """Discrete response of a layer to the pressure on a contact of one half-width.

    Parameters
    ----------
    half_width : float
        Half-width of the contact [m].
    matrix : ndarray
        <T_m, C S Q_{k-1}> [-], shape (modes + 1, modes).
    depths : ndarray
        Mean depth <T_0, u> for each Q_{k-1} over the squared half-width, times E*/2 over the scale of the pressure [-],
        from the surface far ahead, shape (modes,).
    """

    basis: JacobiBasis
    half_width: float
    matrix: Array
    depths: Array


def assemble_system(response: LayerResponse, modes: int, half_width: float) -> GalerkinSystem:
    """Assemble the `GalerkinSystem` of half-plane and layer with pressure modes on a half-width [m]."""
    if half_width > HALF_WIDTH_MAX * response.top_thickness:
        raise RuntimeError(
            f"the half-width of the contact, {half_width:.3g} m, is more than {HALF_WIDTH_MAX:g} times the thickness "
            f"of the top ply, {response.top_thickness:.3g} m; join that ply to the next"
        )
    waves = 0.75 * DECAY_DEPTH * half_width / response.top_thickness
    basis = build_jacobi_basis(response.trailing_exponent, modes, _gauss_point_count(max(waves + modes / 2, modes)))
    matrix, depths = _half_plane_part(response, basis, half_width)
    layer_matrix, layer_depths = _layer_part(response, basis, half_width)
    return GalerkinSystem(basis, half_width, matrix + layer_matrix, depths + layer_depths)


def _gauss_point_count(least):
    """Round a number of Gauss points up to one of a few values, so that many half-widths share a basis."""
    return int(24 * 1.25 ** np.ceil(max(np.log((least + 2) / 24) / np.log(1.25), 0)))


def _half_plane_part(response, basis, a):
    """Matrix and depths of the half-plane with creep: u = u_relaxed + sum share length u'_branch."""
    creep, modes = response.creep, basis.modes
    matrix = creep.instant / basis.sine * np.eye(modes + 1)[:, 1:]
    depths = np.zeros(modes)
    mean = (np.log(response.top_thickness / a) - digamma(basis.trailing_exponent) - np.euler_gamma) / np.pi
    rigid = creep.relaxed * basis.unit_test * basis.unit_load
    depths[0] = rigid * (mean - (response.coupling + response.far_coupling) / 2)
    if len(creep.lengths):
        beta = a / creep.lengths
        branches = creep_branch_matrices(beta, basis.trailing_exponent, modes)
        matrix += np.tensordot(creep.shares, branches, 1)
        depths -= (creep.shares / beta) @ branches[:, 0]
    return matrix, depths


def _layer_part(response, basis, a):
    """Contribution of the finite height to matrix and depths.

        (1/pi) Re int_0^inf C (-i (L - 1) - f (M - b)) <T_m, e^(i tau x)> <Q_{k-1}, e^(-i tau x)> dtau

    and the same over -i tau for the depths, less the logarithm of two depths as exp(-2 zeta)/tau.
    """
    zeta, weight, normal, shear, creep = response.symbols(a)
    tau, order = zeta * a / response.top_thickness, np.arange(1, basis.modes + 1)
    G = basis.transforms(tau)
    tests = 1j * tau * G / np.maximum(np.arange(basis.modes + 1), 1)[:, None]
    tests[0] += basis.unit_test
    pressures = (-1.0) ** (order - 1)[:, None] * G[1:]
    waves = (
        pressures * creep * (-1j * normal - response.friction * shear) * weight * (a / response.top_thickness / np.pi)
    )
    depths = np.real((waves * (1j / tau)) @ tests[0])
    logarithm = response.creep.relaxed * np.sum(np.exp(-2 * zeta) / zeta * weight) / np.pi
    depths[0] += basis.unit_test * basis.unit_load * logarithm
    return tests.real @ waves.real.T - tests.imag @ waves.imag.T, depths


def power_spectrum(basis: JacobiBasis, coefficients: Array, limit: float) -> tuple[Array, Array, Array]:
    """Compute wave numbers times half-width up to a limit, weights and |p|^2 [-] of a pressure, shape (n,)."""
    tau, weight = wave_grid(6, 4.0, limit)
    modes = len(coefficients)
    points = _gauss_point_count(max(modes, modes / 2 + 0.75 * limit))
    fine = build_jacobi_basis(basis.trailing_exponent, modes, points)
    signs = (-1.0) ** np.arange(modes)
    return tau, weight, np.abs((coefficients * signs) @ fine.transforms(tau)[1:]) ** 2
