"""Drive criteria of a motion law and their convex linearisations, for sequential convex programming.

    H = m a + R(v, a),    P = H v

H is the drive force, P the drive power. A `Linearisation` approximates a criterion near a law, convex in the change d
of its unknowns: peaks and positive parts are taken over the linearised H and P, and a smooth criterion keeps the
positive semidefinite part of its curvature (Gauss-Newton).
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from compact.numerics import Array

Resistance = Callable[[Array, Array], Array]  # R(v [m/s], a [m/s^2]) -> [N]

VELOCITY_FLOOR = 1e-12  # [-], of the mean velocity: the resistance at rest is its limit from inside the motion
DIFFERENCE_STEP = 1e-4  # [-], of the mean velocity, and of that over the duration: step of difference quotients


class QuadratureNodes(NamedTuple):
    """Nodes at which a law is evaluated: x, v and a are linear in the unknowns.

    Attributes
    ----------
    position, velocity, acceleration : ndarray, shape (nodes, unknowns)
        Matrices that give x [m], v [m/s] and a [m/s^2] from the unknowns.
    weights : ndarray, shape (nodes,)
        Quadrature weights over one pass [s]; 0 for a node that is only checked for peaks.
    mean_velocity : float
        Stroke over duration [m/s].
    """

    position: Array
    velocity: Array
    acceleration: Array
    weights: Array
    mean_velocity: float


class MotionState(NamedTuple):
    """Motion and drive force at the nodes for one resistance; arrays of shape (nodes,).

    Attributes
    ----------
    velocity : ndarray
        v [m/s], at least the velocity floor.
    resistance, force : ndarray
        R and H [N].
    damping : ndarray
        dR/dv [N s/m].
    inertia : ndarray
        m + dR/da [kg].
    """

    nodes: QuadratureNodes
    velocity: Array
    resistance: Array
    force: Array
    damping: Array
    inertia: Array

    @property
    def power(self) -> Array:
        """Drive power H v [W]."""
        return self.force * self.velocity

    def force_gradient(self) -> Array:
        """Return dH/d(unknowns) = dR/dv dv + (m + dR/da) da, shape (nodes, unknowns)."""
        return self.damping[:, None] * self.nodes.velocity + self.inertia[:, None] * self.nodes.acceleration

    def power_gradient(self) -> Array:
        """Return d(H v)/d(unknowns), shape (nodes, unknowns)."""
        return self.velocity[:, None] * self.force_gradient() + self.force[:, None] * self.nodes.velocity


def evaluate_state(nodes: QuadratureNodes, unknowns: Array, mass: float, resistance: Resistance) -> MotionState:
    """Evaluate motion and drive force of a law with coefficients [-] for a mass [kg] and R(v, a) [N].

    Derivatives of the resistance are difference quotients.
    """
    v, a = np.maximum(nodes.velocity @ unknowns, VELOCITY_FLOOR * nodes.mean_velocity), nodes.acceleration @ unknowns
    step = DIFFERENCE_STEP * nodes.mean_velocity
    shift = step / nodes.weights.sum()
    other = np.where(v > 2 * step, v - step, v + step)  # a lower velocity where there is one: R may end at the largest
    here, at_other, at_shift = (
        np.broadcast_to(resistance(*at), v.shape) for at in ((v, a), (other, a), (v, a + shift))
    )
    damping, added_mass = (at_other - here) / (other - v), (at_shift - here) / shift
    return MotionState(nodes, v, here, mass * a + here, damping, mass + added_mass)


class Linearisation(NamedTuple):
    """Convex model of a criterion near a law: max(values + gradients d) + d' curvature d / 2.

    With `shares` the model is the sum of shares max(values + gradients d, 0) instead.

    Attributes
    ----------
    values : ndarray, shape (rows,)
        Values at d = 0, in the unit of the criterion.
    gradients : ndarray, shape (rows, unknowns)
        Derivatives by the unknowns.
    curvature : ndarray, shape (unknowns, unknowns), optional
        Positive semidefinite Hessian.
    shares : ndarray, shape (rows,), optional
        Weights of a sum of positive parts.
    """

    values: Array
    gradients: Array
    curvature: Array | None = None
    shares: Array | None = None

    @property
    def value(self) -> float:
        """The criterion at d = 0."""
        return float(np.max(self.values) if self.shares is None else self.shares @ np.maximum(self.values, 0.0))


def _magnitude(values: Array, gradients: Array) -> Linearisation:
    return Linearisation(np.concatenate([values, -values]), np.concatenate([gradients, -gradients]))


def _rms_force(state: MotionState) -> Linearisation:
    """(1/T int H^2 dt)^(1/2), a norm: its Hessian is that of the squares less the part along the gradient."""
    root = np.sqrt(state.nodes.weights / state.nodes.weights.sum())
    rows, force = root[:, None] * state.force_gradient(), root * state.force
    rms = max(np.sqrt(force @ force), np.finfo(float).tiny)
    gradient = force @ rows / rms
    across = rows - np.outer(force / rms, gradient)  # its square is the Hessian, semidefinite to rounding
    return Linearisation(np.array([rms]), gradient[None], across.T @ across / rms)


def _energy(state: MotionState) -> Linearisation:
    """2 int R v dt over both strokes. Its curvature in v, 2 dR/dv + v R'', is replaced by 2 dR/dv >= 0."""
    velocity, weights = state.nodes.velocity, 2 * state.nodes.weights
    curvature = weights * np.maximum(2 * state.damping, 0.0)
    work = np.array([weights @ (state.resistance * state.velocity)])  # the work of inertia over a pass is zero
    return Linearisation(work, (weights @ state.power_gradient())[None], (velocity.T * curvature) @ velocity)


# Quantity whose largest magnitude is the criterion, by name of the criterion
PEAKS: Mapping[str, Callable[[MotionState], Array]] = MappingProxyType(
    {"peak_force": lambda state: state.force, "peak_power": lambda state: state.power}
)
# Linearisation of each criterion, by the names of `ranking.CRITERIA`
OBJECTIVES: Mapping[str, Callable[[MotionState], Linearisation]] = MappingProxyType(
    {
        "peak_force": lambda state: _magnitude(state.force, state.force_gradient()),
        "peak_power": lambda state: _magnitude(state.power, state.power_gradient()),
        "rms_force": _rms_force,
        "energy": _energy,
        # 2 int max(H v, 0) dt over both strokes: work of a drive that recovers none
        "drawn_energy": lambda state: Linearisation(state.power, state.power_gradient(), None, 2 * state.nodes.weights),
    }
)
