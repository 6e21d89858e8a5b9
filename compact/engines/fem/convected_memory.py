"""Retarded displacement of a viscoelastic layer that moves relative to the roller.

A layer that is uniform along x, with one relaxation function E(t) of all stresses, deforms as an elastic layer of unit
modulus under the same tractions. Its displacement u at a material point X follows from the elastic displacement w by
the creep function J(t) that belongs to E(t),

    u = J_0 w + sum_k J_k z_k,    theta_k dz_k/dt + z_k = w,

with an internal variable z_k per branch. The convolution acts along x and in time only; it commutes with equilibrium,
compatibility and the condition at the base.

Steady motion: d/dt = -v d/dx in coordinates of the roller, so that z_k = M_k w with the operator M_k of

    z - l dz/dx = w,    l = v theta_k.

M_k is exact for the interpolation of w that it names.

References
----------
N. W. Tschoegl, The phenomenological theory of linear viscoelastic behavior (Springer, 1989): interconversion of
creep and relaxation functions.
"""

import numpy as np

from compact.engines.spectral.galerkin_system import creep_spectrum
from compact.material.laws import Elastic
from compact.numerics import Array

QUADRATURE_LIMIT = 2.0  # [-], interval over relaxation length; below it the recursion of the moments loses digits
QUADRATURE_POINTS = 14  # [-], of Gauss; exact to rounding below the limit


def creep_function(material: Elastic) -> tuple[float, Array, Array]:
    """Convert the Prony series of a material to its creep function.

        J(t) E = instant + sum_k share_k (1 - exp(-t/time_k)),    E the relaxed modulus

    Returns
    -------
    instant : float
        Instantaneous compliance J_0 [-]; it sums to 1 with the shares.
    shares, times : ndarray
        Compliances J_k of the branches [-] and their retardation times theta_k [s], shape (branches,).

    Examples
    --------
    >>> from compact.material.laws import Viscoelastic
    >>> creep = creep_function(Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),)))
    >>> instant, (share,), (time,) = creep
    >>> f"{instant:.3f} instantaneous, {share:.3f} with {time:.3f} s"
    '0.500 instantaneous, 0.500 with 0.200 s'
    """
    return creep_spectrum(getattr(material, "branches", ()))


def steady_creep_operator(x: Array, material: Elastic, speed: float) -> Array:
    """Operator C of u = C w at a speed [m/s], for w quadratic on each element of the nodes x [m], shape (n, n)."""
    instant, *branches = creep_function(material)
    C = instant * np.eye(len(x))
    for share, time in zip(*branches, strict=True):
        C += share * retardation_operator(x, time * speed)
    return C


def retardation_operator(x: Array, length: float) -> Array:
    """Operator M of z = M w with z - length dz/dx = w, for w quadratic between the corners x[::2] [m], shape (n, n).

    The mix flows along -x if the length v theta [m] is positive; z = w at the upstream end.
    """
    if length < 0:
        return retardation_operator(-x[::-1], -length)[::-1, ::-1]
    flow = -x[::-1]  # ascends downstream
    M = np.zeros((len(x), len(x)))
    M[0, 0] = 1.0
    starts, ends = flow[:-2:2], flow[2::2]
    for place in (1, 2):
        reach = flow[place::2][: len(starts)] - starts
        zeroth, first, second = _exponential_moments(reach / length)
        r, m = reach / (ends - starts), (flow[1::2] - starts) / (ends - starts)  # in units of the element
        first, second = first * r, second * r**2
        of_start, of_end = zeroth - first * (1 + m) / m + second / m, (second - m * first) / (1 - m)
        rows = np.arange(len(starts)) * 2 + place
        for k, weight in enumerate((of_start, (first - second) / (m * (1 - m)), of_end)):
            M[rows, rows - place + k] = weight
    decay_half, decay = np.exp(-(flow[1::2] - starts) / length), np.exp(-(ends - starts) / length)
    for j in range(len(starts)):  # contributions of the elements farther upstream
        M[2 * j + 1] += decay_half[j] * M[2 * j]
        M[2 * j + 2] += decay[j] * M[2 * j]
    return M[::-1, ::-1]


def retarded_along_rows(values: Array, x: Array, length: float) -> Array:
    """Solve z - length dz/dx = values, shape (rows, n, ...), piecewise linear along rows of points x [m]."""
    if length < 0:
        return retarded_along_rows(values[:, ::-1], -x[:, ::-1], -length)[:, ::-1]
    z = np.empty_like(values)
    z[:, -1] = values[:, -1]
    steps = np.diff(x, axis=1)
    zeroth, first, _ = _exponential_moments(steps / length)
    decay = np.exp(-steps / length)
    shape = (len(x),) + (1,) * (values.ndim - 2)
    for j in range(x.shape[1] - 2, -1, -1):
        old, new = (zeroth - first)[:, j].reshape(shape), first[:, j].reshape(shape)
        z[:, j] = decay[:, j].reshape(shape) * z[:, j + 1] + old * values[:, j + 1] + new * values[:, j]
    return z


def _exponential_moments(y: Array) -> tuple[Array, ...]:
    """int_0^1 r^k y exp(-y (1 - r)) dr for k = 0, 1, 2."""
    g, w = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    r, w = (1 + g) / 2, w / 2
    small = np.minimum(y, QUADRATURE_LIMIT)[..., None]
    kernel = w * small * np.exp(-small * (1 - r))
    large = np.maximum(y, QUADRATURE_LIMIT)
    zeroth = -np.expm1(-large)
    first = 1 - zeroth / large
    recursion = (zeroth, first, 1 - 2 * first / large)
    return tuple(np.where(y < QUADRATURE_LIMIT, np.sum(kernel * r**k, axis=-1), recursion[k]) for k in range(3))
