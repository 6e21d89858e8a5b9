"""What a drive is spared: criteria of a motion law and their tangents, for programs that make them least.

    H = m a + R(v, a),    P = H v

A `Tangent` is a criterion near a law, convex in the change d of its unknowns: peaks and positive parts stay what they
are over the tangents of H and P, and a smooth criterion keeps its curvature where that is convex.
"""

from types import MappingProxyType
from typing import NamedTuple

import numpy as np

CREEP = 1e-12  # share of the mean speed that stands for "just moving" at rest
SECANT = 1e-4  # share of the mean speed, and of that over the duration, by which the resistance is differenced


class Nodes(NamedTuple):
    """Where a law is looked at: x [m], v [m/s] and a [m/s^2] by the unknowns, rows of shape (nodes, unknowns).

    `weights` [s] integrate over one pass; `mean` is the mean speed [m/s].
    """

    place: np.ndarray
    speed: np.ndarray
    change: np.ndarray
    weights: np.ndarray
    mean: float


class MotionState(NamedTuple):
    """Motion and forces at the `nodes` against one sample of the resistance; arrays of shape (nodes,), SI."""

    nodes: Nodes
    velocity: np.ndarray
    resistance: np.ndarray
    force: np.ndarray
    slope: np.ndarray
    inertia: np.ndarray

    def force_rows(self):
        """H by the unknowns: dR/dv v + (m + dR/da) a."""
        return self.slope[:, None] * self.nodes.speed + self.inertia[:, None] * self.nodes.change

    def power_rows(self):
        """H v by the unknowns."""
        return self.velocity[:, None] * self.force_rows() + self.force[:, None] * self.nodes.speed


def state(nodes, unknowns, mass, resistance):
    """`MotionState` of a law; at rest the resistance has the limit from inside the motion. Secants stand for derivatives."""
    v, a = np.maximum(nodes.speed @ unknowns, CREEP * nodes.mean), nodes.change @ unknowns
    step = SECANT * nodes.mean
    shift = step / nodes.weights.sum()
    beside = np.where(v > 2 * step, v - step, v + step)  # never beyond the fastest
    here, slower, later = (np.broadcast_to(resistance(*at), v.shape) for at in ((v, a), (beside, a), (v, a + shift)))
    slope, lag = (slower - here) / (beside - v), (later - here) / shift
    return MotionState(nodes, v, here, mass * a + here, slope, mass + lag)


class Tangent(NamedTuple):
    """A criterion near a law: max(values + rows d) + (1/2) d' curvature d.

    With `shares` it is instead the sum of shares max(values + rows d, 0).
    """

    values: np.ndarray
    rows: np.ndarray
    curvature: np.ndarray | None = None
    shares: np.ndarray | None = None

    @property
    def value(self):
        """The criterion itself, d = 0."""
        return float(np.max(self.values) if self.shares is None else self.shares @ np.maximum(self.values, 0.0))


def _peak_force(state):
    return _magnitude(PEAKS["peak_force"](state), state.force_rows())


def _peak_power(state):
    return _magnitude(PEAKS["peak_power"](state), state.power_rows())


def _magnitude(values, rows):
    return Tangent(np.concatenate([values, -values]), np.concatenate([rows, -rows]))


def _rms_force(state):
    """(1/T int H^2 dt)^(1/2), a norm: its Hessian is that of the squares less the part along the gradient."""
    root = np.sqrt(state.nodes.weights / state.nodes.weights.sum())
    rows, force = root[:, None] * state.force_rows(), root * state.force
    rms = max(np.sqrt(force @ force), np.finfo(float).tiny)
    gradient = force @ rows / rms
    across = rows - np.outer(force / rms, gradient)  # its square is the Hessian, semidefinite to rounding
    return Tangent(np.array([rms]), gradient[None], across.T @ across / rms)


def _energy(state):
    """2 int R v dt, there and back. Its bend in v is taken as 2 dR/dv: not less than the true one where R'' < 0."""
    speed, weights = state.nodes.speed, 2 * state.nodes.weights
    bend = weights * np.maximum(2 * state.slope, 0.0)
    work = np.array([weights @ (state.resistance * state.velocity)])  # inertia takes none over a pass
    return Tangent(work, (weights @ state.power_rows())[None], (speed.T * bend) @ speed)


def _drawn_energy(state):
    """2 int max(H v, 0) dt, there and back: what a drive gives that cannot take back."""
    return Tangent(state.force * state.velocity, state.power_rows(), shares=2 * state.nodes.weights)


# name to what is largest at an instant
PEAKS = MappingProxyType(
    {"peak_force": lambda state: state.force, "peak_power": lambda state: state.force * state.velocity}
)
# name, as in `ranking.CRITERIA`, to the tangent of a `MotionState`
OBJECTIVES = MappingProxyType(
    {
        "peak_force": _peak_force,
        "peak_power": _peak_power,
        "rms_force": _rms_force,
        "energy": _energy,
        "drawn_energy": _drawn_energy,
    }
)
