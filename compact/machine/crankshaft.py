"""Several carts on one crankshaft at uniform speed: forces, torque and power of each cart and of the shaft.

    torque = H dx/dpsi = H r sin(psi + beta)/cos(beta),   power = torque * angular speed,   rod force = H/cos(beta)

References
----------
Paper C; errata C-1 to C-8.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from compact.machine.cart import Balance, Cart, Resistance, balance
from compact.machine.rigid_drive import (
    SAMPLES_PER_PIECE,
    STANDSTILL_SPEED_RATIO,
    Crank,
    evaluate_resistance,
    flattened,
    revolution_breaks,
)
from compact.numerics import Array
from compact.numerics.piecewise import clenshaw_curtis, find_maximum, interior_grid
from compact.numerics.validation import require_finite, require_opposing, require_positive

# [rad], phases of the published machines by number of carts: 90 degrees for 2 and 4, 120 degrees for 3 (paper C)
CRANK_ANGLES = {
    1: (0.0,),
    2: (0.0, np.pi / 2),
    3: (0.0, 2 * np.pi / 3, 4 * np.pi / 3),
    4: (0.0, np.pi / 2, np.pi, 3 * np.pi / 2),
}


class CartRevolution(NamedTuple):
    """One cart over a revolution of the shaft; arrays of one shape.

    Parameters
    ----------
    psi, rod_angle : ndarray
        Crank angle of this cart and beta [rad].
    position, velocity, acceleration : ndarray
        [m], [m/s], [m/s^2].
    resistance, rod_force : ndarray
        Force of the mix, and of the rod, positive in tension [N].
    forces : Balance
        Drive force, reactions and guide friction [N].
    torque, power : ndarray
        Torque of this cart on the shaft [N m] and its power [W].
    """

    psi: Array
    position: Array
    velocity: Array
    acceleration: Array
    resistance: Array
    rod_angle: Array
    forces: Balance
    rod_force: Array
    torque: Array
    power: Array


@dataclass(frozen=True)
class Crankshaft:
    """Identical carts on one crankshaft.

    Parameters
    ----------
    angular_speed : float
        omega [rad/s].
    resistance : callable
        Force of the mix on one cart [N] of velocity [m/s] and acceleration [m/s^2].
    angles : tuple of float
        Lead of each crank over the shaft [rad].
    """

    cart: Cart
    crank: Crank
    angular_speed: float
    resistance: Resistance
    angles: tuple[float, ...]

    def carts_at(self, angle: Array) -> tuple[CartRevolution, ...]:
        """Solve all carts at angles of the shaft [rad], shape (pieces, n), with one row between two dead centres."""
        return tuple(self._cart_at(angle + lead) for lead in self.angles)

    def dead_centres(self) -> Array:
        """Angles of the shaft in [0, 2 pi] of dead centres and spring contacts, both ends included [rad]."""
        places = np.concatenate([np.array([0.0, np.pi]) - lead for lead in self.angles])
        if self.cart.end_springs is not None:
            places = np.append(places, np.subtract.outer(self._zones.breaks, self.angles))
        return revolution_breaks(places)

    @cached_property
    def _zones(self):
        """Zones of the end springs over the crank angle."""
        return self.cart.end_springs.zones(lambda psi: crank_kinematics(self.crank, psi)[0], [0.0, np.pi, 2 * np.pi])

    def _cart_at(self, psi):
        """One cart at its crank angles [rad]."""
        middle = psi.mean(axis=1, keepdims=True)
        direction = np.sign(np.sin(middle))
        position, slope, curvature = crank_kinematics(self.crank, psi)
        velocity, acceleration = self.angular_speed * slope, self.angular_speed**2 * curvature
        slowest = STANDSTILL_SPEED_RATIO * self.angular_speed * self.crank.radius
        moving = direction * np.maximum(np.abs(velocity), slowest)
        resistance = evaluate_resistance(self.resistance, moving, acceleration)
        beta = self.crank.rod_angle(psi)
        springs, end_force = self.cart.end_springs, 0.0
        if springs is not None:
            end_force = springs.force(position, self._zones.side_at(np.mod(middle, 2 * np.pi)))
        forces = balance(self.cart, acceleration, resistance, direction, np.tan(beta), end_force)
        rod_force = forces.drive_force / np.cos(beta)
        torque = rod_force * self.crank.radius * np.sin(psi + beta)
        power = torque * self.angular_speed
        return CartRevolution(psi, position, velocity, acceleration, resistance, beta, forces, rod_force, torque, power)


@dataclass(frozen=True)
class CrankshaftRevolution:
    """One sampled revolution of a crankshaft.

    Parameters
    ----------
    angle, weights : ndarray, shape (n,)
        Angle and quadrature weights [rad].
    carts : tuple of CartRevolution
        Carts, arrays of shape (n,).
    """

    shaft: Crankshaft
    angle: Array
    weights: Array
    carts: tuple[CartRevolution, ...]

    @property
    def torque(self) -> Array:
        """Torque of all carts on the shaft [N m]."""
        return sum((cart.torque for cart in self.carts), start=np.zeros(()))

    @property
    def power(self) -> Array:
        """Power of all carts [W]."""
        return sum((cart.power for cart in self.carts), start=np.zeros(()))

    @cached_property
    def peak_torque(self) -> float:
        """Return the largest |torque| of the shaft [N m], also between samples."""
        grid = interior_grid(self.shaft.dead_centres())
        return find_maximum(lambda angle: np.abs(sum(cart.torque for cart in self.shaft.carts_at(angle))), grid)[0]

    @property
    def peak_power(self) -> float:
        """Largest |power| of the shaft [W]."""
        return self.peak_torque * self.shaft.angular_speed

    def mean(self, values: Array) -> float:
        """Mean over the revolution."""
        return float(np.sum(self.weights * values) / (2 * np.pi))


def simulate_crankshaft(
    cart: Cart, crank: Crank, angular_speed: float, resistance: Resistance, angles: tuple[float, ...] = (0.0,)
) -> CrankshaftRevolution:
    """Simulate one revolution of identical carts on a crankshaft at uniform speed.

    Parameters
    ----------
    cart : Cart
    crank : Crank
        Crank and rod.
    angular_speed : float
        omega [rad/s], > 0.
    resistance : callable
        Force of the mix on one cart [N] of velocity [m/s] and acceleration [m/s^2].
    angles : tuple of float
        Lead of each crank over the shaft [rad].

    Returns
    -------
    CrankshaftRevolution
        Samples on both sides of each dead centre, where the resistance changes sign; the quadrature is exact between.

    Raises
    ------
    ValueError
        If an argument is not finite, the resistance does not oppose the motion, or guide friction locks the cart.
    """
    require_positive(angular_speed=angular_speed)
    require_finite(angles=angles)
    require_opposing(resistance, angular_speed * crank.radius)
    shaft = Crankshaft(cart, crank, angular_speed, resistance, tuple(angles))
    edges = shaft.dead_centres()
    nodes, unit_weights = clenshaw_curtis(SAMPLES_PER_PIECE)
    width = np.diff(edges)[:, None]
    angle = edges[:-1, None] + width * nodes
    carts = tuple(flattened(cart) for cart in shaft.carts_at(angle))
    return CrankshaftRevolution(shaft, angle.ravel(), (width * unit_weights).ravel(), carts)


def crank_kinematics(crank: Crank, psi: Array) -> tuple[Array, Array, Array]:
    """Compute x [m], dx/dpsi and d2x/dpsi2 of a slider-crank at angles psi [rad] from the outer dead centre.

        dx/dpsi = r sin(psi + beta)/cos(beta),   d2x/dpsi2 = r cos(psi + beta)/cos(beta) (1 + b') + dx/dpsi tan(beta) b'

    with b' = dbeta/dpsi = r cos(psi)/(l cos(beta)).
    """
    beta = crank.rod_angle(psi)
    rate = crank.radius * np.cos(psi) / (crank.rod_length * np.cos(beta))
    position = 2 * crank.radius * np.sin(psi / 2) ** 2 + 2 * crank.rod_length * np.sin(beta / 2) ** 2
    slope = crank.radius * np.sin(psi + beta) / np.cos(beta)
    curvature = crank.radius * np.cos(psi + beta) / np.cos(beta) * (1 + rate) + slope * np.tan(beta) * rate
    return position, slope, curvature
