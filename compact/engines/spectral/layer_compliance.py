"""Surface compliance of a viscoelastic layer of plies on a rigid base, in Fourier space.

Under tractions that vary as exp(ikx) each ply, in plane strain with K = 3 - 4 nu, carries four waves. With y in units
of 1/k, u_x = i U, s_xy = i k mu T and s_yy = k mu S, two waves decay downwards,

    (U, V, T, S) = (1, 1, 2, 2) e^y  and  (y, y - K, 2y + 1 - K, 2y - 1 - K) e^y,

and two upwards, their mirror images. The ratio of upward to downward waves is a 2 x 2 reflection matrix. That of the
base follows from its boundary condition. It is carried through each ply, where it decays by exp(-2 k thickness), and
across each interface by continuity of displacement and traction. No exponential grows, so that neither short waves nor
stiff plies lose digits.

Under a roller at steady speed, d/dt = -v d/dx. The compliance is multiplied by that of the Prony series at the
frequency -v k, which is a sum of branches 1/(1 - i k length) with lengths v theta.

References
----------
K. L. Johnson, Contact Mechanics, CUP 1985, section 5.8, for one ply.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from compact.engines.halfplane import pressure_exponent
from compact.numerics import Array
from compact.rolling_contact import Layer

WAVELENGTH_MAX = 1e4  # [-], over 2 pi heights; beyond it the compliance is proportional to k, and digits would be lost
CREEP_LENGTH_BOUNDS = 1e-30, 1e10  # [-], over the height; beyond them speed is indistinguishable from 0 or infinity
PANEL_POINTS = 10  # [-], Gauss points on each panel of the wave-number grid
DECAY_DEPTH = 20.0  # [-], k depth from which exp(-2 k depth) is neglected


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

    @property
    def relaxed(self) -> float:
        """Compliance C at k = 0 [-]."""
        return self.instant + self.shares.sum()

    def at(self, wave_number: Array) -> NDArray[np.complex128]:
        """Evaluate C [-] at wave numbers k [1/m]."""
        terms = self.shares / (1 - 1j * np.multiply.outer(wave_number, self.lengths))
        return self.instant + terms.sum(axis=-1)


def creep_compliance(branches: tuple[tuple[float, float], ...], speed: float, height: float) -> CreepCompliance:
    """Convert a spectrum 1 + sum share_i exp(-t/time_i) to the `CreepCompliance` at a speed [m/s] and a height [m].

        Theta = diag(t) + r r^T,  r = sqrt(share time);  retardation times theta = eigenvalues of Theta,
        shares (v.r)^2/theta of its eigenvectors v

    Examples
    --------
    >>> creep = creep_compliance(((1.0, 0.1),), speed=2.0, height=0.2)
    >>> f"{creep.instant}, {creep.shares[0]:.3f}, {creep.lengths[0]:.3f}"
    '0.5, 0.500, 0.400'
    """
    if not branches:
        return CreepCompliance(1.0, np.empty(0), np.empty(0))
    stiffness, time = np.array(branches, dtype=float).T
    root = np.sqrt(stiffness * time)
    theta, vectors = np.linalg.eigh(np.diag(time) + np.outer(root, root))
    lengths = height * np.clip(speed / height * theta, *CREEP_LENGTH_BOUNDS)
    return CreepCompliance(1 / (1 + stiffness.sum()), (vectors.T @ root) ** 2 / theta, lengths)


@dataclass(frozen=True)
class LayerResponse:
    """Response of a layer to a pressure and a proportional traction that move at a steady speed.

    Parameters
    ----------
    poisson : float
        Poisson's ratio nu [-].
    friction : float
        Traction on the mix over the pressure, f [-], positive along the travel.
    """

    layer: Layer
    poisson: float
    friction: float
    creep: CreepCompliance

    @property
    def trailing_exponent(self) -> float:
        """Edge exponent alpha of (1.4) [-]; it is independent of the modulus and thus of creep."""
        return float(pressure_exponent(self.poisson, self.friction))

    @property
    def coupling(self) -> float:
        """Coupling of traction and normal displacement on the half-plane, f b = cot(pi alpha) [-]."""
        return self.friction * (1 - 2 * self.poisson) / (2 - 2 * self.poisson)

    @property
    def top_thickness(self) -> float:
        """Thickness of the top ply [m]."""
        return self.layer.top.thickness

    @property
    def far_coupling(self) -> float:
        """Coupling f M at k = 0 [-]; on a frictionless base the traction raises the surface far ahead."""
        return self.coupling + self.friction * far_shear_deviation(self.layer, self.poisson)

    def symbols(self, half_width: float) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Evaluate zeta, weights, L - 1, M - b and C [-] on a grid for a half-width of the contact [m]."""
        width = 2.0 ** np.floor(np.log2(min(2.0, 2.5 * self.top_thickness / half_width)))
        longest = max((self.layer.height, *self.creep.lengths)) / self.top_thickness
        decades = 6 + int(np.ceil(np.log10(longest)))
        zeta, weight, normal, shear = _layer_symbols(self.layer, self.poisson, decades, width)
        return zeta, weight, normal, shear, self.creep.at(zeta / self.top_thickness)

    def dissipation_symbol(self, wave_number: Array) -> Array:
        """Evaluate L Im C - f M Re C [-], the share of the work of a pressure wave k [1/m] that is not returned."""
        normal, shear = compliance_deviation(wave_number, self.layer, self.poisson)
        creep = self.creep.at(wave_number)
        return (1 + normal) * creep.imag - (self.coupling + self.friction * shear) * creep.real


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


@lru_cache(maxsize=64)
def far_shear_deviation(layer: Layer, poisson: float) -> float:
    """Return M - b at k = 0 [-] for a layer and Poisson's ratio."""
    return float(compliance_deviation(0.0, layer, poisson)[1])


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
    >>> one, two = Layer(1.0), Layer(1.0, plies=(Ply(0.8, 20.0), Ply(0.2, 1.0)))
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
