"""Several carts on one crankshaft (paper C): forces, torque and power of each and of the shaft over a turn.

torque = H dx/dpsi = H r sin(psi + beta)/cos(beta),  power = torque * angular speed,  rod force = H/cos(beta)
"""

from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from functools import cached_property

import numpy as np

from compact.machine.cart import Balance, Cart, balance
from compact.machine.rigid_drive import CREEP, POINTS, Crank, evaluate_resistance
from compact.numerics.piecewise import clenshaw_curtis, find_maximum, interior_grid
from compact.numerics.validation import require_finite, require_opposing, require_positive

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
class Shaft:
    """Carts alike on one crankshaft; `angles` [rad] are their cranks ahead of the shaft's."""

    cart: Cart
    crank: Crank
    angular_speed: float
    resistance: Callable
    angles: tuple[float, ...]

    def at(self, angle):
        """A `CartTurn` per cart at angles of the shaft, shape (pieces, n): a row lies between two dead centres."""
        return tuple(self._cart_at(angle + ahead) for ahead in self.angles)

    def dead_centres(self):
        """Angles of the shaft in [0, 2 pi] where a cart turns round or meets a spring, both ends among them."""
        turns = np.concatenate([np.array([0.0, np.pi]) - ahead for ahead in self.angles])
        if self.cart.end_springs is not None:
            turns = np.append(turns, np.subtract.outer(self._zones.breaks, self.angles))
        edges = np.unique(np.append(np.mod(turns, 2 * np.pi), [0.0, 2 * np.pi]))
        return np.append(edges[:-1][np.diff(edges) > 1e-9], 2 * np.pi)

    @cached_property
    def _zones(self):
        return self.cart.end_springs.zones(
            lambda psi: crank_travel(self.crank, psi)[0], np.array([0.0, np.pi, 2 * np.pi])
        )

    def _cart_at(self, psi):
        direction = np.sign(np.sin(psi.mean(axis=1, keepdims=True)))
        position, slope, curvature = crank_travel(self.crank, psi)
        velocity, acceleration = self.angular_speed * slope, self.angular_speed**2 * curvature
        moving = direction * np.maximum(np.abs(velocity), CREEP * self.angular_speed * self.crank.radius)
        met = evaluate_resistance(self.resistance, moving, acceleration)
        beta = self.crank.rod_angle(psi)
        springs = self.cart.end_springs
        push = (
            0.0
            if springs is None
            else springs.push(position, self._zones.at(np.mod(psi.mean(axis=1, keepdims=True), 2 * np.pi)))
        )
        forces = balance(self.cart, acceleration, met, direction, np.tan(beta), push)
        rod_force = forces.drive_force / np.cos(beta)
        torque = rod_force * self.crank.radius * np.sin(psi + beta)
        power = torque * self.angular_speed
        return CartTurn(psi, position, velocity, acceleration, met, beta, forces, rod_force, torque, power)


@dataclass(frozen=True)
class Turn:
    """A turn of the shaft, sampled: `angle` [rad] and `weights` [rad] of shape (n,), the carts, and their sums."""

    shaft: Shaft
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

    @cached_property
    def peak_torque(self):
        """Largest |torque| of the shaft over the turn [N m], between the samples too."""
        grid = interior_grid(self.shaft.dead_centres())
        return find_maximum(lambda angle: np.abs(sum(cart.torque for cart in self.shaft.at(angle))), grid)[0]

    @property
    def peak_power(self):
        """Largest |power| of the shaft over the turn [W]: its speed is uniform."""
        return self.peak_torque * self.shaft.angular_speed

    def mean(self, values):
        """Mean over the turn."""
        return float(np.sum(self.weights * values) / (2 * np.pi))


def turn(cart, crank, angular_speed, resistance, angles=(0.0,)):
    """One turn of carts alike on one shaft at uniform speed, as a `Turn`.

    Parameters
    ----------
    cart : Cart; crank : Crank
    angular_speed : omega [rad/s], > 0
    resistance : callable(velocity, acceleration) -> N
    angles : crank angle of each cart ahead of the shaft's [rad]

    Samples hold both sides of every dead centre, where the resistance changes sign, and integrate exactly between.
    Raises ValueError for numbers that are not finite, a resistance that does not oppose the motion, and a rod that
    friction locks.
    """
    require_positive(angular_speed=angular_speed)
    require_finite(angles=angles)
    require_opposing(resistance, angular_speed * crank.radius)
    shaft = Shaft(cart, crank, angular_speed, resistance, tuple(angles))
    edges = shaft.dead_centres()
    nodes, unit_weights = clenshaw_curtis(POINTS)
    width = np.diff(edges)[:, None]
    angle = edges[:-1, None] + width * nodes
    carts = tuple(_flat(cart) for cart in shaft.at(angle))
    return Turn(shaft, angle.ravel(), (width * unit_weights).ravel(), carts)


def _flat(cart):
    """A `CartTurn` with its pieces one after another."""
    columns = {field.name: getattr(cart, field.name) for field in fields(cart)}
    forces = Balance(*(column.ravel() for column in astuple(columns.pop("forces"))))
    return CartTurn(**{name: column.ravel() for name, column in columns.items()}, forces=forces)


def crank_travel(crank: Crank, psi):
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
