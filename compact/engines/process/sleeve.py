"""Drag of the mix that stands in the feed sleeves, sheared over the bed by the moving cart.

A sleeve of the width B_T along the travel and the roller length L is a silo whose bottom is the bed. Its walls carry
part of the weight (Janssen):

    s_J = g rho D/(4 mu K) [1 - exp(-4 mu K H/D)],    D = 2 B_T L/(B_T + L),    F_s = s_J B_T L tan phi

with the head H, the bulk density rho of the loose mix, the friction mu on the wall, the earth pressure coefficient
K = 1 - sin phi of mix that fills a silo (Jaky), the hydraulic diameter D and the angle of internal friction phi.

The drag is the friction of a silo on a rough bed at rest. It contains no cohesion, and no mix that leaves the sleeve.

References
----------
H. A. Janssen, Versuche ueber Getreidedruck in Silozellen, Z. VDI 39 (1895) 1045-1049; J. Jaky, The coefficient of earth
pressure at rest, J. Soc. Hung. Eng. Arch. 78 (1944) 355-358.
"""

from dataclasses import dataclass

import numpy as np

from compact.numerics.validation import require_fields, require_positive, require_that

GRAVITY = 9.80665  # [m/s2], standard acceleration of gravity


@dataclass(frozen=True)
class FeedSleeve:
    """Sleeve full of loose mix above the bed.

    Parameters
    ----------
    width : float
        Width B_T along the travel [m].
    length : float
        Length along the roller [m].
    head : float
        Height H of the mix above the bed [m].
    wall_friction : float
        Friction coefficient mu of mix on the wall [-]; 0 for a smooth wall, which carries no weight.
    """

    width: float
    length: float
    head: float
    wall_friction: float

    def __post_init__(self) -> None:
        require_fields(self, positive="width length head", nonnegative="wall_friction")

    @property
    def hydraulic_diameter(self) -> float:
        """Four times the area over the perimeter [m]."""
        return 2 * self.width * self.length / (self.width + self.length)

    def bed_stress(self, bulk_density: float, earth_pressure_coefficient: float) -> float:
        """Compute the vertical stress on the bed [Pa].

        Parameters
        ----------
        bulk_density : float
            Bulk density of the loose mix [kg/m3].
        earth_pressure_coefficient : float
            Lateral over vertical stress [-].

        Examples
        --------
        >>> f"{FeedSleeve(0.18, 1.164, 1.0, 0.35).bed_stress(1700.0, 0.43):.0f} Pa"
        '7384 Pa'
        """
        require_positive(bulk_density=bulk_density, earth_pressure_coefficient=earth_pressure_coefficient)
        decay = 4 * self.wall_friction * earth_pressure_coefficient * self.head / self.hydraulic_diameter
        carried = -np.expm1(-decay) / decay if decay else 1.0
        return float(GRAVITY * bulk_density * self.head * carried)

    def drag(self, bulk_density: float, friction_angle: float) -> float:
        """Compute the shear force of the bed on the mix of one sleeve [N].

        Parameters
        ----------
        bulk_density : float
            Bulk density of the loose mix [kg/m3].
        friction_angle : float
            Angle of internal friction [deg], between 0 and 90.
        """
        require_that(0 < friction_angle < 90, friction_angle, "`friction_angle` must lie between 0 and 90, got")
        angle = np.radians(friction_angle)
        stress = self.bed_stress(bulk_density, float(1 - np.sin(angle)))
        return float(stress * self.width * self.length * np.tan(angle))
