"""Several carts on one crankshaft at uniform speed: forces, torque and power of each cart and of the shaft.

    torque = H dx/dpsi = H r sin(psi + beta)/cos(beta),   power = torque * angular speed,   rod force = H/cos(beta)

References
----------
Paper C; errata C-1 to C-8.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compact.machine.cart import Balance, Cart, Resistance
from compact.machine.component_sizing import ShaftRequirement, shaft_requirement
from compact.machine.rigid_drive import SAMPLES_PER_PIECE, Crank, flattened
from compact.machine.shaft import CartsOnShaft
from compact.motion.profile import law
from compact.numerics import Array
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


@dataclass(frozen=True, eq=False)
class CrankshaftRevolution(ShaftRequirement):
    """One revolution of a crankshaft.

    Parameters
    ----------
    shaft : CartsOnShaft
        Carts under the law of the crank.
    carts : tuple of CartRevolution
        Carts, arrays of shape (n,).
    """

    shaft: CartsOnShaft
    carts: tuple[CartRevolution, ...]

    @property
    def power(self) -> Array:
        """Power of all carts [W]."""
        return self.torque * self.speed

    @property
    def peak_power(self) -> float:
        """Largest |power| of the shaft [W]."""
        return self.peak_torque * self.speed


def carts_at(shaft: CartsOnShaft, angle: Array) -> tuple[CartRevolution, ...]:
    """Solve all carts at angles of the shaft [rad], shape (pieces, n), with one row between two breaks."""
    speed, carts = 2 * np.pi / shaft.cycle.period, []
    states = shaft.states_at(angle, np.full(angle.shape, speed**2 / 2), np.zeros(angle.shape))
    for psi, state in zip([angle + lead for lead in shaft.angles], states, strict=True):
        beta, power, force = np.arctan(state.rod_tangent), state.drive_power, state.forces.drive_force
        motion = state.position, state.velocity, state.acceleration, state.resistance
        carts.append(CartRevolution(psi, *motion, beta, state.forces, force / np.cos(beta), power / speed, power))
    return tuple(carts)


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
    forward = law("crank", 2 * crank.radius, np.pi / angular_speed, rod_length=crank.rod_length)
    shaft = CartsOnShaft(cart, forward.cycle(), resistance, tuple(angles), crank)
    found = shaft_requirement(shaft)
    carts = carts_at(shaft, found.angle.reshape(-1, SAMPLES_PER_PIECE))
    return CrankshaftRevolution(**vars(found), shaft=shaft, carts=tuple(flattened(each) for each in carts))
