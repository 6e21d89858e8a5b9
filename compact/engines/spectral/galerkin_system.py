"""Galerkin matrix of a rolling contact on a linear layer of plies, in Jacobi polynomials.

**Contact.** Under a surface pressure p and the traction f p the surface of a linear layer has the slope
u' = -(2/E*) C S p. S multiplies the Fourier transform of p (exp(-ikx), k > 0) by -i L - f M, and C, the creep along the
path of the mix, by (1/E(k))/(1/E*):

    S = S0 - i (L - 1) - f (M - b),   S0 p = (1/pi) PV int p(s)/(x - s) ds - f b p,   b = (1 - 2 nu)/(2 - 2 nu).

L - 1 and M - b decay as exp(-2 k depth) with the depth of the first interface or of the base. The contribution of the
layer is therefore a short quadrature. E* is that of the top ply. S0, the half-plane with its singular edges, is exact
in Jacobi polynomials, and so is each creep branch of C applied to it, see `creep_branch_matrices`. x is in half-widths,
positive along the travel, from the middle of the contact.

**Polynomials.**

    pressure: (1 - x)^A (1 + x)^B sum b_k Q_{k-1}(x), k = 1 ... modes;  tests: T_m(x)/((1 - x)^A (1 + x)^B),
    A = 1 - alpha,  B = alpha,  -1 <= x <= 1

The leading edge has the exponent A and the trailing edge the exponent B. Q and T are orthonormal under the weights
(1 - x)^A (1 + x)^B and (1 - x)^-A (1 + x)^-B; T_0 is counted twice, so that T_m is Chebyshev's cos(m arccos x) without
friction. The half-plane maps Q_{k-1} to T_k/sin(pi alpha).

**Layer.** Under tractions that vary as exp(ikx) each ply, in plane strain with K = 3 - 4 nu, carries four waves. With y
in units of 1/k, u_x = i U, s_xy = i k mu T and s_yy = k mu S, two waves decay downwards,

    (U, V, T, S) = (1, 1, 2, 2) e^y  and  (y, y - K, 2y + 1 - K, 2y - 1 - K) e^y,

and two upwards, their mirror images. The ratio of upward to downward waves is a 2 x 2 reflection matrix. That of the
base follows from its boundary condition. It is carried through each ply, where it decays by exp(-2 k thickness), and
across each interface by continuity of displacement and traction. No exponential grows, so that neither short waves nor
stiff plies lose digits.

Under a roller at steady speed, d/dt = -v d/dx. The compliance is multiplied by that of the Prony series at the
frequency -v k, which is a sum of branches 1/(1 - i k length) with lengths v theta.

References
----------
K. L. Johnson, Contact Mechanics, CUP 1985, section 5.8, for one ply; F. Erdogan, G. D. Gupta, T. S. Cook, Numerical
solution of singular integral equations, in: G. C. Sih (ed.), Methods of Analysis and Solutions of Crack Problems,
Noordhoff 1973.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal
from scipy.special import digamma, hyp1f1

from compact.engines.halfplane import pressure_exponent
from compact.material.laws import Elastic
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller

WAVELENGTH_MAX = 1e4  # [-], over 2 pi heights; beyond it the compliance is proportional to k, and digits would be lost
CREEP_LENGTH_BOUNDS = 1e-30, 1e10  # [-], over the height; beyond them speed is indistinguishable from 0 or infinity
PANEL_POINTS = 10  # [-], Gauss points on each panel of the wave-number grid
DECAY_DEPTH = 20.0  # [-], k depth from which exp(-2 k depth) is neglected
HALF_WIDTH_MAX = 100.0  # [-], over the top ply; its grid of waves needs 0.1 GB, which grows with the square
CIRCLE_SHARE_MAX = 0.9  # [-], largest half-width over the radius of a circle
TRACTION_SIGN = {"frictionless": 0, "free": 0, "sliding": 1, "driven": -1}  # [-], of the traction on the mix
MILLER_MODES = 30  # [-], least number of modes above the last at which the downward recurrence of ratios starts


@dataclass(frozen=True)
class JacobiBasis:
    """Pressure and test polynomials for one pair of edge exponents.

    Parameters
    ----------
    trailing_exponent : float
        alpha of (1.4) [-].
    nodes, tests : ndarray
        Gauss points x of the tests, and T_m there times the weights, shape (modes + 1, n).
    pressure_nodes, pressures : ndarray
        Gauss points x of the pressure, and Q_{k-1} there times the weights, shape (modes, n).
    """

    trailing_exponent: float
    nodes: Array
    tests: Array
    pressure_nodes: Array
    pressures: Array

    @property
    def unit_test(self) -> float:
        """Integral of the test T_0 [-], the square root of 2 pi/sin(pi alpha)."""
        return self.tests[0].sum()

    @property
    def unit_load(self) -> float:
        """Integral of the pressure for b_1 = 1 [-], the square root of 2 pi alpha (1 - alpha)/sin(pi alpha)."""
        return self.pressures[0].sum()

    def transforms(self, tau: Array) -> NDArray[np.complex128]:
        """Compute G_m = m int T_m (exp(i tau x) - 1)/(i tau) dx, factor 1 for m = 0, shape (modes + 1, n), at tau > 0.

        By Rodrigues' formula (-1)^(m-1) G_m is the Fourier transform of the pressure for b_m = 1.
        """
        half = np.multiply.outer(self.nodes, tau / 2)
        sine = np.sin(half)
        rows = np.concatenate([sine * np.cos(half), sine * sine], axis=1)
        real, imaginary = np.split(self.tests @ rows, 2, axis=1)
        order = np.maximum(np.arange(len(self.tests)), 1)
        return (real + 1j * imaginary) * order[:, None] * (2 / tau)


@lru_cache(maxsize=64)
def build_jacobi_basis(trailing_exponent: float, modes: int, points: int) -> JacobiBasis:
    """Build the basis of `modes` pressure polynomials at `points` Gauss points."""
    A, B = 1 - trailing_exponent, trailing_exponent
    total = np.pi / np.sin(np.pi * B)
    recurrence = _jacobi_recurrence(-A, -B, points)
    nodes, vectors = eigh_tridiagonal(*recurrence)  # Golub and Welsch
    tests = _orthonormal_polynomials(nodes, *recurrence, total, modes + 1)
    tests[0] *= np.sqrt(2)  # T_0 = 1 belongs to T_m = cos(m arccos x)
    tests *= total * vectors[0] ** 2
    pressure_nodes, vectors = eigh_tridiagonal(*_jacobi_recurrence(A, B, points))
    pressures = pressure_polynomials(pressure_nodes, B, modes) * (2 * A * B * total * vectors[0] ** 2)
    return JacobiBasis(B, nodes, tests, pressure_nodes, pressures)


def pressure_polynomials(x: Array | float, trailing_exponent: float, modes: int) -> Array:
    """Evaluate Q_0 ... Q_{modes - 1}, orthonormal under (1 - x)^A (1 + x)^B, shape (modes, n) or (modes,)."""
    A, B = 1 - trailing_exponent, trailing_exponent
    total = 2 * np.pi * A * B / np.sin(np.pi * B)
    return _orthonormal_polynomials(x, *_jacobi_recurrence(A, B, modes + 1), total, modes)


def _jacobi_recurrence(a: float, b: float, size: int) -> tuple[Array, Array]:
    """Diagonal and off-diagonal of the recurrence of orthonormal Jacobi polynomials with a + b = -1 or 1."""
    n = np.arange(size)
    if a + b > 0:
        return (b - a) / ((2 * n + 1) * (2 * n + 3)), np.sqrt((n + a) * (n + b))[1:] / (2 * n + 1)[1:]
    diagonal = np.where(n == 0, b - a, (a - b) / ((2 * n - 1) * (2 * n + 1)))
    return diagonal, np.sqrt((n + a) * (n + b) * np.where(n == 1, 2, 1))[1:] / (2 * n - 1)[1:]


def _orthonormal_polynomials(x, diagonal, off_diagonal, total, count):
    """First `count` orthonormal polynomials of a recurrence at x, shape (count, n)."""
    values = np.zeros((count, *np.shape(x)))
    values[0] = 1 / np.sqrt(total)
    previous = np.zeros(np.shape(x))
    for n in range(count - 1):
        values[n + 1] = ((x - diagonal[n]) * values[n] - previous) / off_diagonal[n]
        previous = off_diagonal[n] * values[n]
    return values


@dataclass(frozen=True)
class CreepCompliance:
    """Compliance over its relaxed value on the path of the mix, C = instant + sum share/(1 - i k length).

    Parameters
    ----------
    instant : float
        Instantaneous compliance [-].
    shares : ndarray
        Shares of the branches [-], shape (n,); `instant` and the shares of a material add up to 1.
    lengths : ndarray
        Retardation lengths v theta [m], ascending, shape (n,).
    """

    instant: float
    shares: Array
    lengths: Array

    def at(self, wave_number: Array) -> NDArray[np.complex128]:
        """Evaluate C [-] at wave numbers k [1/m]."""
        terms = self.shares / (1 - 1j * np.multiply.outer(wave_number, self.lengths))
        return self.instant + terms.sum(axis=-1)


def creep_function(material: Elastic) -> tuple[float, Array, Array]:
    """Convert the Prony series of a material, shares and times, to its creep function.

        J(t) E = instant + sum_k share_k (1 - exp(-t/time_k)),    E the relaxed modulus
        Theta = diag(t) + r r^T,  r = sqrt(share time);  retardation times theta = eigenvalues of Theta,
        shares (v.r)^2/theta of its eigenvectors v

    Returns
    -------
    instant : float
        Instantaneous compliance over the relaxed one [-].
    shares, times : ndarray
        Shares of the branches [-], which add up to 1 with `instant`, and retardation times [s], ascending; shape (n,).

    Examples
    --------
    >>> from compact.material.laws import Viscoelastic
    >>> instant, (share,), (time,) = creep_function(Viscoelastic(youngs_modulus=1e7, poisson=0.3, branches=((1, 0.1),)))
    >>> f"{instant:.3f} instantaneous, {share:.3f} with {time:.3f} s"
    '0.500 instantaneous, 0.500 with 0.200 s'
    """
    stiffness, time = np.array(getattr(material, "branches", ()), dtype=float).reshape(-1, 2).T
    root = np.sqrt(stiffness * time)
    theta, vectors = np.linalg.eigh(np.diag(time) + np.outer(root, root))
    return float(1 / (1 + stiffness.sum())), (vectors.T @ root) ** 2 / theta, theta


def creep_compliance(material: Elastic, speed: float, height: float) -> CreepCompliance:
    """Build the `CreepCompliance` of a material at a speed [m/s] on a layer of a height [m]."""
    instant, shares, times = creep_function(material)
    return CreepCompliance(instant, shares, height * np.clip(abs(speed) / height * times, *CREEP_LENGTH_BOUNDS))


@dataclass(frozen=True)
class RollingProblem:
    """Steady rolling contact without its half-width.

    Parameters
    ----------
    layer, roller, material
        As of `spectral.roll`.
    creep : CreepCompliance
        Creep along the path of the mix.
    """

    layer: Layer
    roller: Roller
    material: Elastic
    creep: CreepCompliance

    @property
    def friction(self) -> float:
        """Traction on the mix over the pressure, f [-], positive along the travel."""
        return TRACTION_SIGN[self.roller.rolling] * self.roller.friction

    @property
    def contact_modulus(self) -> float:
        """Relaxed E* of the top ply [Pa]."""
        return self.material.contact_modulus * self.layer.top.stiffness

    @property
    def widest(self) -> float:
        """Largest half-width of the search [m]; a circle ends at its radius."""
        return CIRCLE_SHARE_MAX * self.roller.radius if self.roller.profile == "circle" else np.inf

    @property
    def trailing_exponent(self) -> float:
        """Edge exponent alpha of (1.4) [-]; it is independent of the modulus and thus of creep."""
        return float(pressure_exponent(self.material.poisson, self.friction))

    def gap(self, x: Array) -> Array:
        """Return the height [m] of the roller above its lowest generatrix at x [m], free of cancellation."""
        R = self.roller.radius
        return x**2 / (2 * R if self.roller.profile == "parabola" else R + np.sqrt(R**2 - x**2))

    def slope(self, x: Array) -> tuple[Array, Array]:
        """Return gap' [-] and gap'' [1/m] at x [m]."""
        R = self.roller.radius
        if self.roller.profile == "parabola":
            return x / R, np.full_like(x, 1 / R)
        root = np.sqrt((R - x) * (R + x))
        return x / root, R**2 / root**3

    def dissipation_symbol(self, wave_number: Array) -> Array:
        """Evaluate L Im C - f M Re C [-], the share of the work of a pressure wave k [1/m] that is not returned."""
        normal, shear = compliance_deviation(wave_number, self.layer, self.material.poisson)
        creep = self.creep.at(wave_number)
        return (1 + normal) * creep.imag - self.friction * (coupling(self.material.poisson) + shear) * creep.real


def coupling(poisson: float) -> float:
    """Return b = (1 - 2 nu)/(2 - 2 nu) [-], M of the half-plane."""
    return (1 - 2 * poisson) / (2 - 2 * poisson)


@lru_cache(maxsize=64)
def wave_grid(decades: int, width: float, end: float = DECAY_DEPTH) -> tuple[Array, Array]:
    """Build nodes and weights, shape (n,), of a composite Gauss rule on (0, end).

    Panels grow fourfold over the resolved decades below 1, to a largest width [-].
    """
    start = min(1.0, width)
    growing = start * 4.0 ** np.arange(-np.ceil(decades / np.log10(4)), 0)
    even = np.linspace(start, end, 1 + int(np.ceil((end - start) / width)))
    edges = np.concatenate([[0], growing, even])
    node, weight = np.polynomial.legendre.leggauss(PANEL_POINTS)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + node)).ravel(), (half * weight).ravel()


@lru_cache(maxsize=64)
def _layer_symbols(layer, poisson, decades, width):
    """Nodes zeta, weights, L - 1 and M - b on the `wave_grid`."""
    zeta, weight = wave_grid(decades, width)
    return zeta, weight, *compliance_deviation(zeta / layer.top.thickness, layer, poisson)


def compliance_deviation(wave_number: Array | float, layer: Layer, poisson: float) -> tuple[Array, Array]:
    """Compute the deviation of the surface compliance from that of the half-plane.

    Parameters
    ----------
    wave_number : ndarray
        Wave numbers k [1/m], >= 0, shape (n,).
    poisson : float
        Poisson's ratio nu [-].

    Returns
    -------
    normal, shear : ndarray
        L - 1 and M - b [-], shape (n,). L and M are the normal displacements under a pressure and under a shear
        traction, over that of the half-plane of the top ply under a pressure. b = (1 - 2 nu)/(2 - 2 nu) is M of the
        half-plane.

    Notes
    -----
    For one ply, with z = k H,

        L = (2K sinh 2z - 4z)/(2K cosh 2z + 4z^2 + 1 + K^2) bonded,  L = (cosh 2z - 1)/(sinh 2z + 2z) without friction.

    Examples
    --------
    >>> from compact.rolling_contact import Layer, Ply
    >>> one, two = Layer(1.0), Layer(1.0, plies=(Ply(thickness=0.8, stiffness=20.0), Ply(thickness=0.2, stiffness=1.0)))
    >>> [f"{compliance_deviation(np.array([1.0]), layer, 0.3)[0][0]:.6f}" for layer in (one, two)]
    ['-0.584248', '-0.901422']
    """
    k = np.maximum(wave_number, 1 / (WAVELENGTH_MAX * layer.height))
    K = 3 - 4 * poisson  # (U, V, T, S) at y = 0 of the waves that decay downwards and of those that decay upwards
    down = np.array([[1, 0], [1, -K], [2, 1 - K], [2, -1 - K]])
    up = down * np.array([1, -1, -1, 1])[:, None]
    reflection = _surface_reflection(k, layer, down, up)
    half_plane = down[:2] @ np.linalg.inv(down[2:])
    deviation = (up[:2] - half_plane @ up[2:]) @ reflection @ np.linalg.inv(down[2:] + up[2:] @ reflection)
    normal, shear = deviation[..., 1, 1] / (1 - poisson), -deviation[..., 1, 0] / (1 - poisson)
    return normal + (1 + normal) * (wave_number / k - 1), shear


def _surface_reflection(k, layer, down, up):
    """Reflection matrix of everything below the surface, shape (n, 2, 2)."""
    fixed = [0, 1] if layer.base == "bonded" else [1, 2]
    reflection, below = -np.linalg.solve(up[fixed], down[fixed]), None
    for ply in layer.stack:
        if below is not None:
            ratio = below / ply.stiffness
            continuity = np.array([1, 1, ratio, ratio])  # displacement and traction
            waves = np.linalg.solve(np.hstack([down, up]), continuity[:, None] * (down + up @ reflection))
            reflection = waves[..., 2:, :] @ np.linalg.inv(waves[..., :2, :])
        z = (k * ply.thickness)[..., None, None]
        transfer = np.exp(-z) * (np.eye(2) - z * np.array([[0, 1], [0, 0]]))
        reflection, below = transfer @ reflection @ transfer, ply.stiffness
    return reflection


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
    ratio = _bessel_ratios(beta, trailing_exponent, modes)
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
    """I_{m+1}/I_m for m = 0 ... modes - 1, shape (modes, n), from 1/ratio_{m-1} = constant_m + factor_m ratio_m."""
    top = modes + MILLER_MODES + int(min(6 * np.sqrt(beta.max(initial=0)), 6 * MILLER_MODES))
    order, coulomb = (np.arange(first, 0, -1)[:, None] for first in (top, top + 1))
    coulomb = _coulomb_factor(coulomb, trailing_exponent)
    constant = (2 * order / beta + 2 * order * (0.5 - trailing_exponent) / (order**2 - 0.25)) / coulomb[1:]
    start = beta / (top + 0.5 + np.hypot(top + 0.5, beta))  # exact for large orders
    pairs = zip(constant, coulomb[:-1] / coulomb[1:], strict=True)
    ratios = accumulate(pairs, lambda above, pair: 1 / (pair[0] + pair[1] * above), initial=start)
    return np.array(list(ratios)[: -modes - 1 : -1])


def _coulomb_factor(m, trailing_exponent):
    """R_m = sqrt((m - 1/2)^2 - (alpha - 1/2)^2)/(m - 1/2), which is 1 for Bessel functions (DLMF 33.4)."""
    return np.sqrt((m - trailing_exponent) * (m - 1 + trailing_exponent)) / (m - 0.5)


def _first_product(beta, trailing_exponent):
    """D_0 = 2 Gamma(A) U(A, 1, 2 beta) 1F1(B, 1, -2 beta),  Gamma(A) U = int_0^inf e^(-s) (s/(2 beta + s))^A ds/s."""
    A, B = 1 - trailing_exponent, trailing_exponent
    u = np.linspace(-6.5, 5, 475)  # weights of ds/s, for any power > 0 at 0 and exp(-s) at infinity
    s, weight = np.exp(u - np.exp(-u)), (u[1] - u[0]) * (1 + np.exp(-u))
    integrand = weight * np.exp(-s) * (s / (2 * beta[:, None] + s)) ** A
    return 2 * integrand.sum(axis=1) * hyp1f1(B, 1.0, -2 * beta)


def assemble_system(problem: RollingProblem, modes: int, half_width: float) -> tuple[JacobiBasis, Array, Array]:
    """Assemble the response of half-plane and layer to the pressure on a contact of a half-width [m].

    Branches of the half-plane: u = u_relaxed + sum share length u'_branch. The finite height adds

        (1/pi) Re int_0^inf C (-i (L - 1) - f (M - b)) <T_m, e^(i tau x)> <Q_{k-1}, e^(-i tau x)> dtau

    to the matrix, and the same over -i tau to the depths, less the logarithm of two depths as exp(-2 zeta)/tau.

    Returns
    -------
    basis : JacobiBasis
        Basis of `modes` pressure polynomials.
    matrix : ndarray
        <T_m, C S Q_{k-1}> [-], shape (modes + 1, modes).
    depths : ndarray
        Mean depth <T_0, u> for each Q_{k-1} over the squared half-width, times E*/2 over the scale of the pressure [-],
        from the surface far ahead, shape (modes,).
    """
    layer, poisson, creep, friction = problem.layer, problem.material.poisson, problem.creep, problem.friction
    alpha, ratio = problem.trailing_exponent, half_width / layer.top.thickness
    if ratio > HALF_WIDTH_MAX:
        raise RuntimeError(
            f"the half-width of the contact, {half_width:.3g} m, is more than {HALF_WIDTH_MAX:g} times the thickness "
            f"of the top ply, {layer.top.thickness:.3g} m; join that ply to the next"
        )
    basis = build_jacobi_basis(alpha, modes, _gauss_point_count(max(0.75 * DECAY_DEPTH * ratio + modes / 2, modes)))
    # half-plane
    beta = half_width / creep.lengths
    branches = creep_branch_matrices(beta, alpha, modes)
    matrix = creep.instant / np.sin(np.pi * alpha) * np.eye(modes + 1)[:, 1:] + np.tensordot(creep.shares, branches, 1)
    depths = -(creep.shares / beta) @ branches[:, 0]
    # finite height
    decades = 6 + int(np.ceil(np.log10(creep.lengths.max(initial=layer.height) / layer.top.thickness)))
    width = 2.0 ** np.floor(np.log2(min(2.0, 2.5 / ratio)))
    zeta, weight, normal, shear = _layer_symbols(layer, poisson, decades, width)
    tau, order = zeta * ratio, np.arange(modes + 1)[:, None]
    G, symbol = basis.transforms(tau), creep.at(zeta / layer.top.thickness) * (-1j * normal - friction * shear)
    tests = 1j * tau * G / np.maximum(order, 1)
    tests[0] += basis.unit_test
    waves = -((-1.0) ** order[1:]) * G[1:] * symbol * weight * (ratio / np.pi)
    matrix += tests.real @ waves.real.T - tests.imag @ waves.imag.T
    depths += np.real((waves * (1j / tau)) @ tests[0])
    # mean depth of the relaxed layer; on a frictionless base the traction raises the surface far ahead: f M at k = 0
    far = float(compliance_deviation(0.0, layer, poisson)[1])
    mean = (np.sum(np.exp(-2 * zeta) / zeta * weight) - np.log(ratio) - digamma(alpha) - np.euler_gamma) / np.pi
    relaxed = creep.instant + creep.shares.sum()
    depths[0] += relaxed * basis.unit_test * basis.unit_load * (mean - friction * (coupling(poisson) + far / 2))
    return basis, matrix, depths


def _gauss_point_count(least):
    """Round a number of Gauss points up to one of a few values, so that many half-widths share a basis."""
    return int(24 * 1.25 ** np.ceil(max(np.log((least + 2) / 24) / np.log(1.25), 0)))


def power_spectrum(basis: JacobiBasis, coefficients: Array, limit: float) -> tuple[Array, Array, Array]:
    """Compute wave numbers times half-width up to a limit, weights and |p|^2 [-] of a pressure, shape (n,)."""
    tau, weight = wave_grid(6, 4.0, limit)
    modes = len(coefficients)
    points = _gauss_point_count(max(modes, modes / 2 + 0.75 * limit))
    fine = build_jacobi_basis(basis.trailing_exponent, modes, points)
    signs = (-1.0) ** np.arange(modes)
    return tau, weight, np.abs((coefficients * signs) @ fine.transforms(tau)[1:]) ** 2
