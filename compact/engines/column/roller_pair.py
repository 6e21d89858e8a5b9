"""Two equal rolls that compact a powder (roller compactor): Johanson's nip angle, and columns of half the gap.

The mid-plane between the rolls is a smooth rigid base, so that one roll acts on a layer of half the height. From the
nip on, the powder moves with the rolls. Columns keep the mass k h between vertical sections,

    s_v/s_v(nip) = (h(nip)/h(t))^K,   h(t) = S/2 + R (1 - cos t)

Johanson keeps k h cos t, the mass between sections normal to the roll. His pressure relative to the peak has the
second cosine, and his gap pressure is lower. Ahead of the nip the powder slips; the nip is the angle at which the
pressure gradients of slip and of stick are equal.

References
----------
J. R. Johanson, A rolling theory for granular solids, J. Appl. Mech. 32 (1965) 842-848.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.optimize import brentq

from compact import rolling_contact
from compact.engines.column.rigid_wheel import WheelContactResult, roll_wheel
from compact.material.laws import Compaction
from compact.material.pressure_sinkage import JohansonLaw, Terrain
from compact.numerics import Array
from compact.numerics.validation import require_fields, require_that

ANGLE_MARGIN = 1e-9  # [rad], from the ends of the range of the nip angle
NIP_ANGLES = 400  # [-], of the search for the first change of sign
QUADRATURE_RTOL = 1e-12  # [-], of the force factor


@dataclass(frozen=True)
class RollerPair:
    """Two equal rolls with a gap, and the powder between them.

    Parameters
    ----------
    radius : float
        Radius R of each roll [m], > 0.
    gap : float
        Gap S between the rolls [m], > 0.
    compressibility : float
        K of the powder, s_v ~ k^K [-], > 0.
    effective_friction_angle, wall_friction_angle : float
        delta of the powder and phi_w of powder on roll [deg], 0 < phi_w < delta < 90.
    """

    radius: float
    gap: float
    compressibility: float
    effective_friction_angle: float
    wall_friction_angle: float

    def __post_init__(self) -> None:
        require_fields(self, positive="radius gap compressibility effective_friction_angle wall_friction_angle")
        wall, inner = self.wall_friction_angle, self.effective_friction_angle
        require_that(wall < inner < 90, wall, f"`wall_friction_angle` must be below {inner!r} and that below 90, got")

    @classmethod
    def of_mix(
        cls, material: Compaction, radius: float, gap: float, exit_density_ratio: float, friction: float
    ) -> Self:
        """Return the pair for a mix that is compacted to a density ratio, with the constants of Johanson's powder.

            K = ln(s_v,out/s_v,in)/ln(k_out/k_in),   delta = arcsin(M/sqrt(3)),   phi_w = arctan(friction)

        s_v is the vertical stress of confined compression at both density ratios.

        Parameters
        ----------
        material : Compaction
            Constitutive law with the fed density ratio.
        radius, gap : float
            Radius of each roll and gap between them [m].
        exit_density_ratio : float
            Density ratio of the strip [-].
        friction : float
            Friction coefficient of powder on roll [-].
        """
        ratios, strength = np.array([material.fed_density_ratio, exit_density_ratio]), material.tensile_strength
        stress = material.confined_stress_ratio * (material.yield_pressure(ratios) + strength) - strength
        compressibility = float(np.diff(np.log(stress))[0] / np.diff(np.log(ratios))[0])
        inner = float(np.degrees(np.arcsin(min(material.critical_slope / np.sqrt(3), 1.0))))
        return cls(radius, gap, compressibility, inner, float(np.degrees(np.arctan(friction))))

    @property
    def gap_ratio(self) -> float:
        """Gap over the diameter S/D [-]."""
        return self.gap / (2 * self.radius)

    def slip_gradient(self, angle: ArrayLike) -> Array:
        """Compute the gradient d ln s_v/dx of slipping powder over the diameter at angles [rad], in 2/D."""
        t = np.asarray(angle, dtype=float)
        delta, wall = np.radians(self.effective_friction_angle), np.radians(self.wall_friction_angle)
        nu = (np.pi - np.arcsin(np.sin(wall) / np.sin(delta)) - wall) / 2
        mu, mean = np.pi / 4 - delta / 2, (t + nu + np.pi / 2) / 2
        cotangents = 1 / np.tan(mean - mu) - 1 / np.tan(mean + mu)
        return 4 * (np.pi / 2 - t - nu) * np.tan(delta) / ((1 + self.gap_ratio - np.cos(t)) * cotangents)

    def stick_gradient(self, angle: ArrayLike) -> Array:
        """Compute the gradient d ln s_v/dx of powder that moves with the rolls at angles [rad], in 2/D."""
        t, height = np.asarray(angle, dtype=float), 1 + self.gap_ratio
        rise = (2 * np.cos(t) - height) * np.tan(t)
        return self.compressibility * rise / ((height - np.cos(t)) * np.cos(t))

    @property
    def nip_angle(self) -> float:
        """Nip angle [rad]: the smallest angle at which both gradients are equal.

        Raises
        ------
        ValueError
            If no angle has equal gradients.
        """
        angles = np.linspace(ANGLE_MARGIN, np.pi / 2 - ANGLE_MARGIN, NIP_ANGLES)
        excess = self.slip_gradient(angles) - self.stick_gradient(angles)
        change = np.flatnonzero((excess[:-1] > 0) & (excess[1:] <= 0) | (excess[:-1] < 0) & (excess[1:] >= 0))
        if not change.size:
            raise ValueError(
                "no angle has equal gradients of slip and of stick; use a larger compressibility or smaller angles"
            )
        low, high = angles[change[0]], angles[change[0] + 1]
        return float(brentq(lambda t: float(self.slip_gradient(t) - self.stick_gradient(t)), low, high, xtol=1e-15))

    def relative_pressure(self, angle: ArrayLike) -> Array:
        """Compute Johanson's pressure over the peak at angles between nip and gap [rad], with his second cosine."""
        t, ratio = np.asarray(angle, dtype=float), self.gap_ratio
        return (ratio / ((1 + ratio - np.cos(t)) * np.cos(t))) ** self.compressibility

    def force_factor(self, nip_angle: float) -> float:
        """Compute Johanson's factor F = 2 P/(p_max D) of the force per width P from nip to gap [-].

        Parameters
        ----------
        nip_angle : float
            Angle from which the powder moves with the rolls [rad].
        """

        def integrand(t: float) -> float:
            return float(self.relative_pressure(t)) * np.cos(t)

        return float(quad(integrand, 0, nip_angle, epsabs=0, epsrel=QUADRATURE_RTOL, limit=200)[0])

    def columns(self, nip_pressure: float, nip_angle: float) -> WheelContactResult:
        """Compute one roll on columns of half the height from the nip on, per unit width.

        Parameters
        ----------
        nip_pressure : float
            Vertical stress at the nip [Pa].
        nip_angle : float
            Angle of the nip [rad].

        Examples
        --------
        >>> pair = RollerPair(0.1, 0.004, 5.0, 40.0, 20.0)
        >>> roll = pair.columns(1e6, pair.nip_angle)
        >>> f"nip {np.degrees(pair.nip_angle):.2f} degrees, peak {roll.peak_pressure / 1e6:.1f} MPa"
        'nip 10.95 degrees, peak 25.5 MPa'
        """
        rise = 2 * self.radius * np.sin(nip_angle / 2) ** 2
        layer = rolling_contact.Layer(self.gap / 2 + rise, base="slip")
        roller = rolling_contact.Roller(self.radius, indentation=rise, profile="circle")
        return roll_wheel(layer, roller, Terrain(JohansonLaw(nip_pressure, self.compressibility)), 1.0)
