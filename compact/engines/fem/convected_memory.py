"""What a material point remembers on its way along a streamline under a roller in steady motion.

Seen from the roller nothing changes in time, d/dt = -v d/dx. A layer that is the same all along x, with one relaxation
function E(t) for all its stresses, deforms as an elastic layer of unit modulus under the same pressure whose
displacements w and strains e are then retarded along their streamlines,

    u = J_0 w + sum_k J_k z_k,    z_k + theta_k dz_k/dt = w,

because the retardation acts along x alone and commutes with equilibrium, compatibility and the base. J(t) is the creep
function that belongs to E(t). The updates below are exact for the interpolation they name.

What the mix retains while a roller moves over it: z of each creep branch at places that stay with the layer.

    theta_k dz_k/dt + z_k = w(X - s(t), t)

Over a step w is linear in time at each x = X - s under the roller, so that what it leaves at a place is a sum along the
way s(t) of the roller, with weights that are exact for values linear between even instants, see `streamline.fading`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from compact.engines.fem.contact_patch import interpolated

SERIES_BELOW = 2.0  # interval over relaxation length: below it the recursion for the weights would lose digits
POINTS = 14  # of Gauss, exact to rounding there


@dataclass(frozen=True)
class Creep:
    """J(t) E = instant + sum_k share_k (1 - exp(-t/time_k)), with instant + sum of shares = 1 for the relaxed E."""

    instant: float
    shares: tuple[float, ...] = ()
    times: tuple[float, ...] = ()


def creep(material):
    """The `Creep` of a material with or without `branches` (stiffness share s, relaxation time tau).

    With S = 1 + sum s and g = sqrt(s/tau) the retardation rates are the eigenvalues of diag(1/tau) - g g'/S.

    >>> from compact.material.laws import Viscoelastic
    >>> law = creep(Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),)))
    >>> f"{law.instant:.3f} at once, {law.shares[0]:.3f} within {law.times[0]:.3f} s"
    '0.500 at once, 0.500 within 0.200 s'
    """
    branches = getattr(material, "branches", ())
    if not branches:
        return Creep(1.0)
    share, time = np.array(branches, dtype=float).T
    total = 1 + share.sum()
    g = np.sqrt(share / time)
    rate, mode = np.linalg.eigh(np.diag(1 / time) - np.outer(g, g) / total)
    shares = (g @ mode) ** 2 / (total**2 * rate)
    return Creep(float(1 / total), tuple(shares.tolist()), tuple((1 / rate).tolist()))


def retardation(x, material, speed):
    """u = C w on surface nodes x, corners and middles ascending, for w quadratic on each element: C, shape (n, n)."""
    law = creep(material)
    C = law.instant * np.eye(len(x))
    for share, time in zip(law.shares, law.times, strict=True):
        C += share * memory(x, time * speed)
    return C


def memory(x, length):
    """z = M w of z - length dz/dx = w for w quadratic between corners x[::2]: M, shape (n, n).

    length : v theta [m]; the mix flows along -x for length > 0, along +x for length < 0
    """
    if length < 0:
        return memory(-x[::-1], -length)[::-1, ::-1]
    flow = -x[::-1]  # ascends downstream
    M = np.zeros((len(x), len(x)))
    M[0, 0] = 1.0
    starts, ends = flow[:-2:2], flow[2::2]
    for place in (1, 2):
        reach = flow[place::2][: len(starts)] - starts
        weights = _quadratic_weights(reach, ends - starts, (flow[1::2] - starts), length)
        rows = np.arange(len(starts)) * 2 + place
        for k in range(3):
            M[rows, rows - place + k] = weights[k]
    decay_half, decay = np.exp(-(flow[1::2] - starts) / length), np.exp(-(ends - starts) / length)
    for j in range(len(starts)):  # what is remembered from farther upstream
        M[2 * j + 1] += decay_half[j] * M[2 * j]
        M[2 * j + 2] += decay[j] * M[2 * j]
    return M[::-1, ::-1]


def retarded(values, x, length):
    """z of z - length dz/dx = values, piecewise linear along the last but one axis of points x, ascending.

    values, x : shape (rows, n, ...) and (rows, n); the mix flows along -x for length > 0, else along +x
    """
    if length < 0:
        return retarded(values[:, ::-1], -x[:, ::-1], -length)[:, ::-1]
    z = np.empty_like(values)
    z[:, -1] = values[:, -1]
    steps = np.diff(x, axis=1)
    zeroth, first, _ = _moments(steps / length)
    decay = np.exp(-steps / length)
    shape = (len(x),) + (1,) * (values.ndim - 2)
    for j in range(x.shape[1] - 2, -1, -1):
        old, new = (zeroth - first)[:, j].reshape(shape), first[:, j].reshape(shape)
        z[:, j] = decay[:, j].reshape(shape) * z[:, j + 1] + old * values[:, j + 1] + new * values[:, j]
    return z


def fading(count, interval, time):
    """Weights of values at count + 1 even instants of an interval [s] in z at its end, from time dz/dt + z = value.

    Piecewise linear between the instants, from z = 0; shape (count + 1,).
    """
    zeroth, first, _ = _moments(np.array(interval / count / time))
    left = np.exp(-interval / count / time * np.arange(count)[::-1])
    weights = np.zeros(count + 1)
    weights[:-1] += left * (zeroth - first)
    weights[1:] += left * first
    return weights


def _moments(y):
    """int_0^1 r^k y exp(-y (1 - r)) dr for k = 0, 1, 2."""
    g, w = np.polynomial.legendre.leggauss(POINTS)
    r, w = (1 + g) / 2, w / 2
    small = np.minimum(y, SERIES_BELOW)[..., None]
    kernel = w * small * np.exp(-small * (1 - r))
    large = np.maximum(y, SERIES_BELOW)
    zeroth = -np.expm1(-large)
    first = 1 - zeroth / large
    recursion = (zeroth, first, 1 - 2 * first / large)
    return tuple(np.where(y < SERIES_BELOW, np.sum(kernel * r**k, axis=-1), recursion[k]) for k in range(3))


def _quadratic_weights(reach, size, middle, length):
    """Weights of the start, middle and end value of a quadratic in what z gains over `reach` from the start."""
    zeroth, first, second = _moments(reach / length)
    r, m = reach / size, middle / size  # in units of the element
    first, second = first * r, second * r**2
    return (
        zeroth - first * (1 + m) / m + second / m,
        (first - second) / (m * (1 - m)),
        (second - m * first) / (1 - m),
    )


@dataclass(frozen=True, eq=False)
class Fading:
    """What a step does to z_k of k branches with `shares` J_k, shape (k,).

    way : positions of the roller at even instants, shape (n,);  new : share of the later w at each, shape (n,)
    weights : of w at the instants, shape (k, n);  decays : of what was before, shape (k,)
    """

    shares: np.ndarray
    way: np.ndarray
    new: np.ndarray
    weights: np.ndarray
    decays: np.ndarray

    def faded(self, before):
        """What is left of z, shape (k, ..., m)."""
        return self.decays.reshape(-1, *[1] * (before.ndim - 1)) * before

    def retained(self, x, places, before, old, new):
        """z of the places, shape (k, ..., m), from that before and from w on the nodes x at both ends, (..., n)."""
        met = np.array([
            interpolated(x, (1 - share) * old + share * new, within(x, places - place))
            for place, share in zip(self.way, self.new, strict=True)
        ])  # fmt: skip
        return self.faded(before) + np.tensordot(self.weights, met, axes=1)


def fading_over(law, way, interval):
    """The `Fading` by a `Creep` over an interval [s] in which the roller goes a way."""
    count, times = len(way) - 1, np.array(law.times)
    weights = np.array([fading(count, interval, time) for time in times]).reshape(-1, count + 1)
    return Fading(np.array(law.shares), way, np.linspace(0, 1, count + 1), weights, np.exp(-interval / times))


def retained_by(shares, places, z, x):
    """sum J_k z_k at points x of the layer."""
    return np.tensordot(shares, CubicSpline(places, z, axis=-1)(x), axes=1)


def steadily_retained(law, nodes, w, speed, x):
    """z in steady motion at points x that may lie behind the mesh, (k, ..., m); all of w where nothing moves."""
    inside = within(nodes, x)
    z = np.empty((len(law.times), *w.shape[:-1], len(x)))
    for branch, time in enumerate(law.times):
        length = abs(time * speed)
        if length:
            behind = np.exp(-np.abs(inside - x) / length)
            z[branch] = interpolated(nodes, w @ memory(nodes, time * speed).T, inside) * behind
        else:
            z[branch] = interpolated(nodes, w, inside)
    return z


def within(nodes, x):
    """Points x, those beyond the mesh at its ends, where nothing moves any more."""
    return np.clip(x, nodes[0], nodes[-1])
