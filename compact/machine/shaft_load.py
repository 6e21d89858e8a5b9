"""Torque of identical carts on one shaft, of which one revolution is one cycle of the law.

    x(phi) = y(T phi/2 pi),   torque = sum over carts of H x'(phi)

H is the drive force of each cart at v = x' phi' and a = x'' phi'^2 + x' phi'' (`cart.balance`). `motor_drive` solves
the speed of the shaft, `motor_sizing` assumes it uniform.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.machine import rigid_drive
from compact.machine.cart import Cart, Resistance, balance
from compact.motion.profile import Cycle
from compact.numerics import Array

RIGID = rigid_drive.Rigid()


@dataclass(frozen=True)
class CartsOnShaft:
    """Identical carts on one shaft.

    Parameters
    ----------
    cycle : Cycle
        Law; its period is that of one revolution at uniform speed.
    resistance : callable
        Force of the mix on one cart [N] of velocity [m/s] and acceleration [m/s^2].
    angles : tuple of float
        Lead of each cart over the shaft [rad].
    rod : Rigid or Crank
        Rigid for a cam.
    """

    cart: Cart
    cycle: Cycle
    resistance: Resistance
    angles: tuple[float, ...] = (0.0,)
    rod: rigid_drive.Rigid | rigid_drive.Crank = RIGID

    def breaks(self) -> Array:
        """Angles in [0, 2 pi] at joins of the law and spring contacts of any cart, ends included [rad]."""
        rate = 2 * np.pi / self.cycle.period
        joins = np.concatenate([rate * (leg.start + leg.duration * leg.breakpoints()) for leg in self.cycle.legs()])
        if self.cart.end_springs is not None:
            joins = np.append(joins, self._zones.breaks)
        return rigid_drive.revolution_breaks(np.subtract.outer(joins, self.angles))

    def states_at(
        self, angle: Array, energy: Array, acceleration: Array, jerk: Array | float = 0.0
    ) -> list[rigid_drive.DriveState]:
        """Solve motion and forces of each cart at angles [rad], shape (pieces, n).

        Energy is phi'^2/2 [1/s^2], acceleration phi'' [rad/s^2] and jerk the third derivative [rad/s^3].
        """
        angles = [np.mod(angle + lead, 2 * np.pi) for lead in self.angles]
        return [self._cart_state(angle, energy, acceleration, jerk) for angle in angles]

    def _cart_state(self, angle, energy, acceleration, jerk):
        """Motion and forces of a cart at its own angle [rad]."""
        x, slope, curvature, third = self.travel(angle)
        speed = np.sqrt(2 * energy)
        velocity, cart_acceleration = slope * speed, curvature * 2 * energy + slope * acceleration
        direction = np.sign(slope.mean(axis=-1, keepdims=True))
        slowest = rigid_drive.STANDSTILL_SPEED_RATIO * self.cycle.forward.stroke / self.cycle.forward.duration
        moving = np.where(np.abs(velocity) < slowest, direction * slowest, velocity)
        force = rigid_drive.evaluate_resistance(self.resistance, moving, cart_acceleration)
        tangent = self.rod.rod_tangent(angle / (2 * np.pi) * self.cycle.period, self.cycle.period)
        springs = self.cart.end_springs
        end_force = 0.0 if springs is None else springs.force(x, self._zones.side_at(angle))
        cart_jerk = third * speed**3 + 3 * curvature * speed * acceleration + slope * jerk
        forces = balance(self.cart, cart_acceleration, force, np.sign(moving), tangent, end_force)
        return rigid_drive.DriveState(x, velocity, cart_acceleration, cart_jerk, force, tangent, forces)

    @cached_property
    def _zones(self):
        """Zones of the end springs over the angle."""
        return self.cart.end_springs.zones(lambda angle: self.travel(angle)[0], [0.0, np.pi, 2 * np.pi])

    def travel(self, angle: Array) -> list[Array]:
        """Return x [m] and its first three derivatives with respect to the angle [m/rad^k], angle in [0, 2 pi)."""
        rate = self.cycle.period / (2 * np.pi)
        return [self.cycle.derivative(angle * rate, order) * rate**order for order in range(4)]

    def torque(self, angle: Array, energy: Array, acceleration: Array) -> Array:
        """Return the torque of all carts, sum of H x' [N m].

        Parameters
        ----------
        angle : ndarray, shape (pieces, n)
            Angle of the shaft [rad].
        energy, acceleration : ndarray
            phi'^2/2 [1/s^2] and phi'' [rad/s^2] there.

        Returns
        -------
        ndarray
            Torque [N m].
        """
        states = self.states_at(angle, energy, acceleration)
        return sum(state.forces.drive_force * state.velocity for state in states) / np.sqrt(2 * energy)
