"""Several carts on one crankshaft at uniform speed: forces, torque and power of each cart and of the shaft.

    torque = H dx/dpsi = H r sin(psi + beta)/cos(beta),   power = torque * angular speed,   rod force = H/cos(beta)

References
----------
Paper C; errata C-1 to C-8.
"""

from dataclasses import dataclass

import numpy as np

from compact.machine.cart import Cart, Resistance
from compact.machine.component_sizing import ShaftRequirement, shaft_requirement
from compact.machine.rigid_drive import SAMPLES_PER_PIECE, Crank, DriveState, flattened
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


@dataclass(frozen=True, eq=False)
class CrankshaftRevolution(ShaftRequirement):
    """One revolution of a crankshaft.

    Parameters
    ----------
    shaft : CartsOnShaft
        Carts under the law of the crank.
    carts : tuple of DriveState
        Motion and forces of each cart, arrays of shape (n,); its torque is its power over the speed of the shaft.
    """

    shaft: CartsOnShaft
    carts: tuple[DriveState, ...]

    @property
    def power(self) -> Array:
        """Power of all carts [W]."""
        return self.torque * self.speed

    @property
    def peak_power(self) -> float:
        """Largest |power| of the shaft [W]."""
        return self.peak_torque * self.speed


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
    carts = shaft.uniform_states(found.angle.reshape(-1, SAMPLES_PER_PIECE))
    return CrankshaftRevolution(**vars(found), shaft=shaft, carts=tuple(map(flattened, carts)))
