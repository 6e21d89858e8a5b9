"""Several carts on one crankshaft (paper C): forces, torque and power of each and of the shaft over a turn.

torque = H dx/dpsi = H r sin(psi + beta)/cos(beta),  power = torque * angular speed,  rod force = H/cos(beta)
"""

from dataclasses import dataclass

import numpy as np

from compact.cart import Balance, balance
from compact.drive import POINTS, Crank, clenshaw_curtis, peak
from compact.refuse import refuse_nonfinite, refuse_nonpositive

# Phases of the published machines: 1, 2 carts at 90 degrees, 3 at 120, 4 at 90 (paper C).
USUAL_ANGLES = {
    1: (0.0,),
    2: (0.0, np.pi / 2),
    3: (0.0, 2 * np.pi / 3, 4 * np.pi / 3),
    4: (0.0, np.pi / 2, np.pi, 3 * np.pi / 2),
}


@dataclass(frozen=True)
class CartTurn:
    """One cart over a turn of the shaft; arrays of shape (n,).

    psi : crank angle of this cart [rad]; rod_force : T, + in tension [N]; torque : of this cart on the shaft [N m]
    """

    psi: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    resistance: np.ndarray
    rod_angle: np.ndarray
    forces: Balance
    rod_force: np.ndarray
    torque: np.ndarray
    power: np.ndarray


@dataclass(frozen=True)
class Turn:
    """A turn of the shaft: `angle` [rad] and `weights` [rad] of shape (n,), the carts, and their sums."""

    angle: np.ndarray
    weights: np.ndarray
    carts: tuple[CartTurn, ...]

    @property
    def torque(self):
        """Torque of all carts on the shaft [N m]."""
        return sum(cart.torque for cart in self.carts)

    @property
    def power(self):
        """Power of all carts [W]."""
        return sum(cart.power for cart in self.carts)

    def mean(self, values):
        """Mean over the turn."""
        return float(np.sum(self.weights * values) / (2 * np.pi))

    def peak(self, values):
        """Largest |value| over the turn, between the samples too."""
        return peak(self.angle, values)


def turn(cart, crank, angular_speed, resistance, angles=(0.0,)):
    """One turn of carts alike on one shaft at uniform speed, as a `Turn`.

    Parameters
    ----------
    cart : Cart; crank : Crank
    angular_speed : omega [rad/s], > 0
    resistance : callable(velocity, acceleration) -> N
    angles : crank angle of each cart ahead of the shaft's [rad]

    Samples hold both sides of every dead centre, where the resistance changes sign, and integrate exactly between.
    """
    refuse_nonpositive(angular_speed=angular_speed)
    refuse_nonfinite(angles=angles)
    edges = np.unique(np.mod(np.concatenate([[0.0], *(np.array([0, np.pi]) - a for a in angles)]), 2 * np.pi).round(14))
    edges = np.append(edges[np.append(np.diff(edges) > 1e-12, True)], 2 * np.pi)
    nodes, unit_weights = clenshaw_curtis(POINTS)
    width = np.diff(edges)[:, None]
    angle, weights = edges[:-1, None] + width * nodes, width * unit_weights
    carts = tuple(_cart_turn(cart, crank, angular_speed, resistance, angle + ahead) for ahead in angles)
    return Turn(angle.ravel(), weights.ravel(), carts)


def _cart_turn(cart, crank, speed, resistance, psi):
    """One cart at crank angles of shape (pieces, n); each piece lies on one side of the dead centres."""
    direction = np.broadcast_to(np.sign(np.sin(psi.mean(axis=1, keepdims=True))), psi.shape).ravel()
    psi = psi.ravel()
    position, slope, curvature = travel(crank, psi)
    velocity, acceleration = speed * slope, speed**2 * curvature
    moving = direction * np.maximum(np.abs(velocity), 1e-12 * speed * crank.radius)
    met = resistance(moving, acceleration)
    beta = crank.rod_angle(psi)
    forces = balance(cart, acceleration, met, direction, np.tan(beta))
    rod_force = forces.drive_force / np.cos(beta)
    torque = rod_force * crank.radius * np.sin(psi + beta)
    return CartTurn(
        psi, position, velocity, acceleration, np.asarray(met), beta, forces, rod_force, torque, torque * speed
    )


def travel(crank: Crank, psi):
    """Travel x [m] and its first and second derivative by the crank angle, at psi [rad] from the outer dead centre.

        dx/dpsi = r sin(psi + beta)/cos(beta),  d2x/dpsi2 = r cos(psi + beta)/cos(beta) (1 + b') + dx/dpsi tan(beta) b'

    with b' = dbeta/dpsi = r cos(psi)/(l cos(beta)).
    """
    beta = crank.rod_angle(psi)
    rate = crank.radius * np.cos(psi) / (crank.rod_length * np.cos(beta))
    position = 2 * crank.radius * np.sin(psi / 2) ** 2 + 2 * crank.rod_length * np.sin(beta / 2) ** 2
    slope = crank.radius * np.sin(psi + beta) / np.cos(beta)
    curvature = crank.radius * np.cos(psi + beta) / np.cos(beta) * (1 + rate) + slope * np.tan(beta) * rate
    return position, slope, curvature
