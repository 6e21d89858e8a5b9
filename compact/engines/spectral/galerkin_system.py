"""The layer in Fourier space and under the contact: what `spectral` is made of.

Under a surface pressure p and the traction f p the surface of a linear layer slopes by u' = -(2/E*) C S p, where
S multiplies the Fourier transform of p (exp(-ikx), k > 0) by -i L - f M and C, the creep along the path of the
mix, by (1/E(k))/(1/E*):

    S = S0 - i (L - 1) - f (M - b),   S0 p = (1/pi) PV int p(s)/(x - s) ds - f b p,   b = (1 - 2 nu)/(2 - 2 nu).

L - 1 and M - b, see `plies`, die like exp(-2 k depth) with the depth of the first interface or of the base, so the
layer's share is a short quadrature. E* is that of the top ply. S0, its half-plane with its singular edges, is exact
in Jacobi polynomials, and so is each creep branch of C after it, see `edge_memory`. x is counted in half-widths,
+ along the travel, from the middle of the contact. `system` puts both together.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.special import digamma

from compact.engines.halfplane import pressure_exponent
from compact.engines.spectral.layer_compliance import surface_defects
from compact.rolling_contact import Layer

POINTS = 10  # of Gauss on each panel of the wave-number grid
WIDEST = 100.0  # depths to either side, where the waves of a contact take 0.1 GB, growing with the square
DECAYED = 20.0  # k depth beyond which exp(-2 k depth) is nothing
MILLER = 30  # modes, at least, above the last wanted one from which ratios are carried down
STEEP = 50.0  # beta from which the far end of the contact is out of memory's reach, exp(-2 beta) being nothing
LENGTHS = 1e-30, 1e10  # of creep, in heights, between which speed is told from 0 and from infinity


@dataclass(frozen=True)
class Creep:
    """Compliance over the relaxed one: C = instant + sum share/(1 - i k length), shape (n,) each, lengths in [m].

    `instant` and the shares of a material add up to 1; lengths ascend.
    """

    instant: float
    shares: np.ndarray
    lengths: np.ndarray

    @property
    def relaxed(self):
        """C at k = 0 [-]."""
        return self.instant + self.shares.sum()

    def at(self, wave_number):
        """C at the wave numbers k [1/m]."""
        terms = self.shares / (1 - 1j * np.multiply.outer(wave_number, self.lengths))
        return self.instant + terms.sum(axis=-1)


def creep(branches, speed, height):
    """The `Creep` of a Prony series, 1 + sum share_i exp(-t/time_i), met at a speed [m/s] > 0 on a layer [m] so high.

        Theta = diag(t) + r r^T,  r = sqrt(share time);  retardation times theta = eigenvalues of Theta,
        shares (v.r)^2/theta of its eigenvectors v

    Lengths stay within `LENGTHS` heights: shorter ones are relaxed, longer ones never relax, whatever is asked.

    >>> both = creep(((1.0, 0.1),), speed=2.0, height=0.2)
    >>> f"{both.instant}, {both.shares[0]:.3f}, {both.lengths[0]:.3f}"
    '0.5, 0.500, 0.400'
    """
    if not branches:
        return Creep(1.0, np.empty(0), np.empty(0))
    stiffness, time = np.array(branches, dtype=float).T
    root = np.sqrt(stiffness * time)
    theta, vectors = np.linalg.eigh(np.diag(time) + np.outer(root, root))
    lengths = height * np.clip(speed / height * theta, *LENGTHS)
    return Creep(1 / (1 + stiffness.sum()), (vectors.T @ root) ** 2 / theta, lengths)


@dataclass(frozen=True)
class LayerResponse:
    """What a roller meets: a layer, its Poisson's ratio nu, and how it creeps on the path.

    `friction` f is the traction on the mix over the pressure, + along the travel.
    """

    layer: Layer
    poisson: float
    friction: float
    creep: Creep

    @property
    def trailing_exponent(self):
        """alpha of (1.4) [-]; no modulus enters, so creep does not change it."""
        return float(pressure_exponent(self.poisson, self.friction))

    @property
    def coupling(self):
        """f b = cot(pi alpha) [-]."""
        return self.friction * (1 - 2 * self.poisson) / (2 - 2 * self.poisson)

    @property
    def depth(self):
        """Thickness of the top ply [m]."""
        return self.layer.top.thickness

    @property
    def drag(self):
        """f M at k = 0 [-]: on a slipping base the surface far ahead of a drag stays higher, far behind lower."""
        return self.coupling + self.friction * far_shear_defect(self.layer, self.poisson)

    def symbols(self, half_width):
        """zeta = k depth, weights, L - 1, M - b and C on a grid that follows the waves of a contact this wide [m]."""
        width = 2.0 ** np.floor(np.log2(min(2.0, 2.5 * self.depth / half_width)))
        longest = max((self.layer.height, *self.creep.lengths)) / self.depth
        decades = 6 + int(np.ceil(np.log10(longest)))
        zeta, weight, normal, shear = layer_symbols(self.layer, self.poisson, decades, width)
        return zeta, weight, normal, shear, self.creep.at(zeta / self.depth)

    def kept(self, wave_number):
        """L Im C - f M Re C at the wave numbers k [1/m]: what stays of the work of a wave of pressure."""
        normal, shear = surface_defects(wave_number, self.layer, self.poisson)
        creep = self.creep.at(wave_number)
        return (1 + normal) * creep.imag - (self.coupling + self.friction * shear) * creep.real


@lru_cache(maxsize=64)
def wave_grid(decades, width, end=DECAYED):
    """Nodes zeta and weights: panels from 10^-decades on growing fourfold, then not wider than `width`, to `end`."""
    start = min(1.0, width)
    growing = start * 4.0 ** np.arange(-np.ceil(decades / np.log10(4)), 0)
    even = np.linspace(start, end, 1 + int(np.ceil((end - start) / width)))
    edges = np.concatenate([[0], growing, even])
    node, weight = np.polynomial.legendre.leggauss(POINTS)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + node)).ravel(), (half * weight).ravel()


@lru_cache(maxsize=64)
def layer_symbols(layer, poisson, decades, width):
    """zeta, weights, L - 1 and M - b on the `wave_grid`: four arrays of shape (n,)."""
    zeta, weight = wave_grid(decades, width)
    return zeta, weight, *surface_defects(zeta / layer.top.thickness, layer, poisson)


@lru_cache(maxsize=64)
def far_shear_defect(layer, poisson):
    """M - b at k = 0 [-]."""
    return float(surface_defects(0.0, layer, poisson)[1])


@dataclass(frozen=True)
class Basis:
    """Polynomials on the contact whose edge powers fit the friction, sampled at Gauss points, orthonormal.

    Pressure is (1 - x)^A (1 + x)^B sum b_k Q_{k-1}, k = 1 ... modes, A = 1 - alpha ahead and B = alpha behind;
    it is tested with T_m/((1 - x)^A (1 + x)^B), m = 0 ... modes. S0 takes the former into T_k/sin(pi alpha).

    trailing_exponent : alpha of (1.4) [-]
    nodes, tests : Gauss points x of the tests; T_m there times the weights, shape (modes + 1, n)
    seats, pressures : Gauss points x of the pressure; Q_{k-1} there times the weights, shape (modes, n)
    """

    trailing_exponent: float
    nodes: np.ndarray
    tests: np.ndarray
    seats: np.ndarray
    pressures: np.ndarray

    @property
    def modes(self):
        return len(self.tests) - 1

    @property
    def sine(self):
        """sin(pi alpha)."""
        return np.sin(np.pi * self.trailing_exponent)

    @property
    def unit_test(self):
        """int of the test T_0: the square root of 2 pi/sin(pi alpha)."""
        return np.sqrt(2 * np.pi / self.sine)

    @property
    def unit_load(self):
        """int of the pressure b_1 = 1 makes, over x: the square root of 2 pi alpha (1 - alpha)/sin(pi alpha)."""
        alpha = self.trailing_exponent
        return np.sqrt(2 * np.pi * alpha * (1 - alpha) / self.sine)

    def transforms(self, tau):
        """G_m = m int T_m (exp(i tau x) - 1)/(i tau), m = 0 taken as 1, at tau > 0: shape (modes + 1, n).

        Rodrigues' formula makes (-1)^(m-1) G_m also the Fourier transform of the pressure of b_m = 1.
        """
        half = np.multiply.outer(self.nodes, tau / 2)
        sine = np.sin(half)
        rows = np.concatenate([sine * np.cos(half), sine * sine], axis=1)
        real, imaginary = np.split(self.tests @ rows, 2, axis=1)
        order = np.maximum(np.arange(len(self.tests)), 1)
        return (real + 1j * imaginary) * order[:, None] * (2 / tau)


@lru_cache(maxsize=64)
def jacobi_basis(trailing_exponent, modes, points):
    """The `Basis` of so many modes at so many Gauss points."""
    A, B = 1 - trailing_exponent, trailing_exponent
    total = np.pi / np.sin(np.pi * B)
    nodes, weights = _gauss(*_jacobi_matrix(-A, -B, points), total)
    tests = _orthonormal(nodes, *_jacobi_matrix(-A, -B, points), total, modes + 1)
    tests[0] *= np.sqrt(2)  # as T_0 = 1 stands beside T_m = cos(m arccos x)
    seats, loads = _gauss(*_jacobi_matrix(A, B, points), 2 * A * B * total)
    return Basis(B, nodes, tests * weights, seats, pressure_polynomials(seats, B, modes) * loads)


def pressure_polynomials(x, trailing_exponent, modes):
    """Q_0 ... Q_{modes - 1} at x, orthonormal under (1 - x)^A (1 + x)^B, A + B = 1, B = alpha: shape (modes, n)."""
    A, B = 1 - trailing_exponent, trailing_exponent
    total = 2 * np.pi * A * B / np.sin(np.pi * B)
    return _orthonormal(x, *_jacobi_matrix(A, B, modes + 1), total, modes)


def _jacobi_matrix(a, b, size):
    """Diagonal and off-diagonal of the recurrence of orthonormal Jacobi polynomials with a + b = -1 or 1."""
    n = np.arange(size)
    if a + b > 0:
        return (b - a) / ((2 * n + 1) * (2 * n + 3)), np.sqrt((n + a) * (n + b))[1:] / (2 * n + 1)[1:]
    diagonal = np.where(n == 0, b - a, (a - b) / ((2 * n - 1) * (2 * n + 1)))
    return diagonal, np.sqrt((n + a) * (n + b) * np.where(n == 1, 2, 1))[1:] / (2 * n - 1)[1:]


def _gauss(diagonal, beside, total):
    """Gauss points and weights, the weights adding up to `total`."""
    nodes, vectors = eigh_tridiagonal(diagonal, beside)
    return nodes, total * vectors[0] ** 2


def _orthonormal(x, diagonal, beside, total, count):
    """The first `count` orthonormal polynomials of a recurrence at x: shape (count, n)."""
    values = np.zeros((count, *np.shape(x)))
    values[0] = 1 / np.sqrt(total)
    below = np.zeros(np.shape(x))
    for n in range(count - 1):
        values[n + 1] = ((x - diagonal[n]) * values[n] - below) / beside[n]
        below = beside[n] * values[n]
    return values


def edge_memory(beta, trailing_exponent, modes):
    """What a creep branch 1/(1 - (1/beta) d/dx) makes of S0: matrix over tests m = 0 ... and pressures k = 1 ....

        sin(pi alpha) <T_m, branch S0 Q_{k-1}> = delta_mk - k Z_mk       for m >= k
                                               = -(-1)^(m + k) k Z_mk    for m < k
        Z_mk = 2 I_max(m,k)(beta) K_min(m,k)(beta)

    beta is the half-width over the length of the branch, shape (n,); the answer has shape (n, modes + 1, modes).
    I and K are the modified Bessel functions where alpha is 1/2 (Hunter's closed form is their first two), else the
    Coulomb functions of order m - 1/2 that friction puts in their place. Both fall out of the ratios
    r_m = I_{m+1}/I_m, carried down from high m, and of the products D_m = 2 I_m K_m, carried up, so that nothing
    overflows for any beta.
    """
    ratio = np.array([_ratios(each, trailing_exponent, modes) for each in beta.tolist()]).T
    product = np.empty((modes + 1, len(beta)))
    product[0] = _first_product(beta, trailing_exponent)
    steps = 2 / (beta * _slant(np.arange(1, modes + 1)[:, None], trailing_exponent))
    for m in range(modes):
        product[m + 1] = ratio[m] * (steps[m] - ratio[m] * product[m])
    fall = np.concatenate([np.zeros((1, len(beta))), np.cumsum(np.log(ratio), axis=0)]).T
    m, k = np.ogrid[: modes + 1, 1 : modes + 1]
    low, high = np.minimum(m, k), np.maximum(m, k)
    Z = product.T[:, low] * np.exp(fall[:, high] - fall[:, low])
    sign = np.where(m < k, (-1.0) ** (m + k), 1.0)
    return ((m == k) - sign * k * Z) / np.sin(np.pi * trailing_exponent)


def _ratios(beta, trailing_exponent, modes):
    """I_{m+1}/I_m for m = 0 ... modes - 1 at one beta: a list, from 1/ratio_{m-1} = share_m + keep_m ratio_m."""
    top = modes + MILLER + int(min(6 * np.sqrt(beta), 6 * MILLER))
    order = np.arange(top, 0, -1)
    slant = _slant(np.arange(top + 1, 0, -1), trailing_exponent)
    tilt = 2 * order * (0.5 - trailing_exponent) / (order**2 - 0.25)
    share, keep = ((2 * order / beta + tilt) / slant[1:]).tolist(), (slant[:-1] / slant[1:]).tolist()
    far = float(beta / (top + 0.5 + np.hypot(top + 0.5, beta)))  # exact for large orders
    down = accumulate(zip(share, keep, strict=True), lambda above, step: 1 / (step[0] + step[1] * above), initial=far)
    return list(down)[: -modes - 1 : -1]


def _slant(m, trailing_exponent):
    """R_m = sqrt((m - 1/2)^2 - (alpha - 1/2)^2)/(m - 1/2), which is 1 in Bessel's case (DLMF 33.4)."""
    return np.sqrt((m - trailing_exponent) * (m - 1 + trailing_exponent)) / (m - 0.5)


def _first_product(beta, trailing_exponent):
    """D_0 = 2 sin(pi alpha)/pi int_0^inf e^(-beta t) t^-B (2 + t)^-A dt int_0^2 e^(-beta t) t^-A (2 - t)^-B dt."""
    A, B = 1 - trailing_exponent, trailing_exponent
    s, weight = _half_line()
    t = s / beta[:, None]
    outer = np.sum(weight * np.exp(-s) * (t / (2 + t)) ** A, axis=1)
    steep = np.sum(weight * np.exp(-s) * np.minimum(t, 1) ** B * (2 - np.minimum(t, 1)) ** -B, axis=1)
    left, right, weight = _interval()
    mild = np.sum(weight * np.exp(-np.minimum(beta, STEEP)[:, None] * left) * left**B * right**A, axis=1)
    return 2 * np.sin(np.pi * B) / np.pi * outer * np.where(beta < STEEP, mild, steep)


@lru_cache(maxsize=1)
def _half_line():
    """Nodes s of (0, inf) and weights of ds/s, for any power > 0 at 0 and exp(-s) at infinity."""
    u = np.linspace(-4.7, 5, 401)
    return np.exp(u - np.exp(-u)), (u[1] - u[0]) * (1 + np.exp(-u))


@lru_cache(maxsize=1)
def _interval():
    """Nodes t of (0, 2), 2 - t, and weights of dt/(t (2 - t)), for any powers > 0 at both ends."""
    u = np.linspace(-4.3, 4.3, 201)
    logit = np.pi * np.sinh(u)
    return 2 / (1 + np.exp(-logit)), 2 / (1 + np.exp(logit)), (u[1] - u[0]) * np.pi / 2 * np.cosh(u)


@dataclass(frozen=True)
class System:
    """What a half-width [m] fixes: the rows <T_m, C S Q_{k-1}>, m = 0 ... modes, and the mean depth of each Q_{k-1}.

    rows : shape (modes + 1, modes)
    depths : <T_0, u> over half-width squared, times E*/2 over the scale of the pressure, from the surface far ahead
    """

    basis: Basis
    half_width: float
    rows: np.ndarray
    depths: np.ndarray


def system(ground, modes, half_width):
    """The `System` of a half-width [m] on a `LayerResponse`: half-plane and layer. RuntimeError where a ply is too thin."""
    if half_width > WIDEST * ground.depth:
        raise RuntimeError(
            f"the contact, {half_width:.3g} m to either side, is more than {WIDEST:g} times as wide as the top ply of "
            f"the layer is thick, {ground.depth:.3g} m; join that ply to the next"
        )
    waves = 0.75 * DECAYED * half_width / ground.depth
    pressures = jacobi_basis(ground.trailing_exponent, modes, _enough(max(waves + modes / 2, modes)))
    rows, depths = _half_plane(ground, pressures, half_width)
    more_rows, more_depths = _layer(ground, pressures, half_width)
    return System(pressures, half_width, rows + more_rows, depths + more_depths)


def _enough(least):
    """Gauss points for polynomials and waves, one of few numbers, so that a basis serves many half-widths."""
    return int(24 * 1.25 ** np.ceil(max(np.log((least + 2) / 24) / np.log(1.25), 0)))


def _half_plane(ground, basis, a):
    """Rows and depths of the half-plane, creep and all: u = u_relaxed + sum share length u'_branch."""
    creep, modes = ground.creep, basis.modes
    rows = creep.instant / basis.sine * np.eye(modes + 1)[:, 1:]
    depths = np.zeros(modes)
    mean = (np.log(ground.depth / a) - digamma(basis.trailing_exponent) - np.euler_gamma) / np.pi
    depths[0] = creep.relaxed * basis.unit_test * basis.unit_load * (mean - (ground.coupling + ground.drag) / 2)
    if len(creep.lengths):
        beta = a / creep.lengths
        memory = edge_memory(beta, basis.trailing_exponent, modes)
        rows += np.tensordot(creep.shares, memory, 1)
        depths -= (creep.shares / beta) @ memory[:, 0]
    return rows, depths


def _layer(ground, basis, a):
    """What the finite height adds to rows and depths.

        (1/pi) Re int_0^inf C (-i (L - 1) - f (M - b)) <T_m, e^(i tau x)> <Q_{k-1}, e^(-i tau x)> dtau

    and for the depths the same over -i tau; they take the logarithm of two depths off again as exp(-2 zeta)/tau.
    """
    zeta, weight, normal, shear, creep = ground.symbols(a)
    tau, order = zeta * a / ground.depth, np.arange(1, basis.modes + 1)
    G = basis.transforms(tau)
    tests = 1j * tau * G / np.maximum(np.arange(basis.modes + 1), 1)[:, None]
    tests[0] += basis.unit_test
    pressures = (-1.0) ** (order - 1)[:, None] * G[1:]
    waves = pressures * creep * (-1j * normal - ground.friction * shear) * weight * (a / ground.depth / np.pi)
    depths = np.real((waves * (1j / tau)) @ tests[0])
    logarithm = ground.creep.relaxed * np.sum(np.exp(-2 * zeta) / zeta * weight) / np.pi
    depths[0] += basis.unit_test * basis.unit_load * logarithm
    return tests.real @ waves.real.T - tests.imag @ waves.imag.T, depths


def power_spectrum(basis, coefficients, reach):
    """tau, weights, and the squared Fourier transform of the pressure of the coefficients, up to tau = `reach`."""
    tau, weight = wave_grid(6, 4.0, reach)
    modes = len(coefficients)
    finer = jacobi_basis(basis.trailing_exponent, modes, _enough(max(modes, modes / 2 + 0.75 * reach)))
    signs = (-1.0) ** np.arange(modes)
    return tau, weight, np.abs((coefficients * signs) @ finer.transforms(tau)[1:]) ** 2
