"""What the mix retains while a roller moves over it: z of each creep branch at places that stay with the layer.

    theta_k dz_k/dt + z_k = w(X - s(t), t)

Over a step w is linear in time at each x = X - s under the roller, so that what it leaves at a place is a sum along the
way s(t) of the roller, with weights that are exact for values linear between even instants, see `streamline.fading`.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from compact.patch import interpolated
from compact.streamline import fading, memory


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
