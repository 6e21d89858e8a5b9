"""Jacobi polynomials on a contact with edge singularities, sampled at Gauss points.

    pressure: (1 - x)^A (1 + x)^B sum b_k Q_{k-1}(x), k = 1 ... modes;  tests: T_m(x)/((1 - x)^A (1 + x)^B),
    A = 1 - alpha,  B = alpha,  -1 <= x <= 1

x points along the travel. The leading edge has the exponent A and the trailing edge the exponent B. Q and T are
orthonormal under the weights (1 - x)^A (1 + x)^B and (1 - x)^-A (1 + x)^-B; T_0 is counted twice, so that T_m is
Chebyshev's cos(m arccos x) without friction. The half-plane maps Q_{k-1} to T_k/sin(pi alpha).

References
----------
F. Erdogan, G. D. Gupta, T. S. Cook, Numerical solution of singular integral equations, in: G. C. Sih (ed.), Methods of
Analysis and Solutions of Crack Problems, Noordhoff 1973.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

from compact.numerics import Array


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
    def modes(self) -> int:
        """Number of pressure polynomials."""
        return len(self.tests) - 1

    @property
    def sine(self) -> float:
        """Value of sin(pi alpha) [-]."""
        return np.sin(np.pi * self.trailing_exponent)

    @property
    def unit_test(self) -> float:
        """Integral of the test T_0 [-], the square root of 2 pi/sin(pi alpha)."""
        return np.sqrt(2 * np.pi / self.sine)

    @property
    def unit_load(self) -> float:
        """Integral of the pressure for b_1 = 1 [-], the square root of 2 pi alpha (1 - alpha)/sin(pi alpha)."""
        alpha = self.trailing_exponent
        return np.sqrt(2 * np.pi * alpha * (1 - alpha) / self.sine)

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
    nodes, weights = _gauss_rule(*_jacobi_recurrence(-A, -B, points), total)
    tests = _orthonormal_polynomials(nodes, *_jacobi_recurrence(-A, -B, points), total, modes + 1)
    tests[0] *= np.sqrt(2)  # T_0 = 1 belongs to T_m = cos(m arccos x)
    pressure_nodes, pressure_weights = _gauss_rule(*_jacobi_recurrence(A, B, points), 2 * A * B * total)
    pressures = pressure_polynomials(pressure_nodes, B, modes) * pressure_weights
    return JacobiBasis(B, nodes, tests * weights, pressure_nodes, pressures)


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


def _gauss_rule(diagonal, off_diagonal, total):
    """Gauss points and weights by Golub and Welsch; the weights add up to `total`."""
    nodes, vectors = eigh_tridiagonal(diagonal, off_diagonal)
    return nodes, total * vectors[0] ** 2


def _orthonormal_polynomials(x, diagonal, off_diagonal, total, count):
    """First `count` orthonormal polynomials of a recurrence at x, shape (count, n)."""
    values = np.zeros((count, *np.shape(x)))
    values[0] = 1 / np.sqrt(total)
    previous = np.zeros(np.shape(x))
    for n in range(count - 1):
        values[n + 1] = ((x - diagonal[n]) * values[n] - previous) / off_diagonal[n]
        previous = off_diagonal[n] * values[n]
    return values
