"""Pore air of a compacting mix: voids, saturation, and the intrinsic permeability to air with its occlusion.

The density ratio k counts solids and water, so that the air voids over solids and water are e = (1 - k)/k. With the
volume w of the water over that of solids and water, the saturation is

    S = w/(w + e),    w = (W/rho_w)/(1/rho_s + W/rho_w)

The intrinsic permeability to air falls to a small share as the water closes the paths of the air (occlusion):

    kappa(S) = kappa_fed f(S)/f(S_fed),    f = (1 - S/S_o)^2 (1 - (S/S_o)^2),    at least `OCCLUDED_SHARE` kappa_fed

Without an occlusion saturation S_o kappa is constant. The air is isothermal: p times the voids of the same solids is
constant without drainage. The pressure curve of the skeleton does not resolve voids below those
of the densest measured state, k = 0.99. Smaller voids tend smoothly to `MIN_VOID_RATIO`.

References
----------
A. T. Corey, Producers Monthly 19 (1954) 38 (relative permeability to the non-wetting phase); D. G. Fredlund and
H. Rahardjo, Soil Mechanics for Unsaturated Soils, Wiley 1993, chapters 2, 5 (continuous air up to S 0.80-0.90); J. W.
Hilf, U.S. Bureau of Reclamation Technical Memorandum 654 (1956) (undrained compression of pore air).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from compact.material.laws import MEASURED_DENSITY_RATIO
from compact.material.mix import GRAIN_DENSITY, OCCLUSION_SATURATION, WATER_DENSITY
from compact.numerics import Array
from compact.numerics.validation import require_between, require_fields, require_positive

AIR_VISCOSITY = 1.8e-5  # [Pa s], of air at 20 degrees Celsius
ATMOSPHERIC_PRESSURE = 101325.0  # [Pa], absolute
MIN_VOID_RATIO = 1 / MEASURED_DENSITY_RATIO - 1  # [-], air voids at the end of measured pressure curves
BOUND_WIDTH = 0.25  # [-], of the least voids, over which they are approached
OCCLUDED_SHARE = 1e-9  # [-], least permeability over that as fed; the slow tests of pressure curves are drained


@dataclass(frozen=True, kw_only=True)
class PoreAir:
    """Pore air of a mix with its permeability.

    Parameters
    ----------
    permeability : float
        Intrinsic permeability to air at the density of the fed mix [m2], > 0.
    water : float
        Volume of the water over that of solids and water [-], 0 <= w < 1.
    fed_density_ratio : float
        Density ratio at which `permeability` is valid [-], between 0 and 1.
    occlusion_saturation : float or None
        Saturation above which the air is occluded [-]; None for a constant permeability.
    viscosity : float
        Dynamic viscosity of the air [Pa s], > 0.
    ambient_pressure : float
        Absolute pressure of the surroundings [Pa], > 0.

    Raises
    ------
    ValueError
        If a value is out of its range, or the fed mix is occluded already.
    """

    permeability: float
    water: float
    fed_density_ratio: float
    occlusion_saturation: float | None = OCCLUSION_SATURATION
    viscosity: float = AIR_VISCOSITY
    ambient_pressure: float = ATMOSPHERIC_PRESSURE

    def __post_init__(self) -> None:
        require_fields(self, positive="permeability viscosity ambient_pressure fed_density_ratio", nonnegative="water")
        require_between(0, 1, water=self.water, fed_density_ratio=self.fed_density_ratio)
        occlusion = self.occlusion_saturation
        if occlusion is None:
            return
        require_positive(occlusion_saturation=occlusion)
        require_between(0, 1, occlusion_saturation=occlusion)
        fed = float(self.saturation(1 / self.fed_density_ratio - 1))
        if fed >= occlusion:
            raise ValueError(
                f"`occlusion_saturation` must exceed the saturation of the fed mix, {fed:.4g}, got {occlusion!r}: its "
                "air is occluded, so that a permeability does not apply; use None for a constant permeability"
            )

    def saturation(self, void_ratio: ArrayLike) -> Array:
        """Compute the saturation [-] at air voids over solids and water e [-]."""
        return np.asarray(self.water / (self.water + np.asarray(void_ratio, dtype=float)))

    @property
    def min_void_ratio(self) -> float:
        """Least air voids over solids and water [-]."""
        if self.occlusion_saturation is None:
            return MIN_VOID_RATIO
        return max(self.water * (1 / self.occlusion_saturation - 1), MIN_VOID_RATIO)

    def bounded(self, void_ratio: ArrayLike) -> Array:
        """Return air voids of at least `min_void_ratio` [-], with a continuous slope; exact above 1.25 times it.

        Parameters
        ----------
        void_ratio : array_like
            Air voids over solids and water e [-], also negative where the skeleton extrapolates.

        Returns
        -------
        ndarray
            Air voids [-].
        """
        void_ratio, least = np.asarray(void_ratio, dtype=float), self.min_void_ratio
        width = BOUND_WIDTH * least
        above = np.clip(void_ratio - least + width, 0.0, 2 * width)
        return np.where(void_ratio > least + width, void_ratio, least + above**2 / (4 * width))

    def mobility(self, void_ratio: ArrayLike) -> Array:
        """Compute permeability over viscosity [m2/(Pa s)] at air voids over solids and water e [-]."""
        occlusion = self.occlusion_saturation
        if occlusion is None:
            return np.full(np.shape(void_ratio), self.permeability / self.viscosity)

        def relative(void_ratio: ArrayLike) -> Array:
            over = np.minimum(self.saturation(void_ratio) / occlusion, 1.0)
            return (1 - over) ** 2 * (1 - over**2)

        share = relative(void_ratio) / relative(1 / self.fed_density_ratio - 1)
        return self.permeability * np.maximum(share, OCCLUDED_SHARE) / self.viscosity


def water_volume(moisture: float) -> float:
    """Return the volume of the water over that of solids and water [-] at a moisture W [-].

    Examples
    --------
    >>> f"{water_volume(0.10):.4f}"
    '0.2095'
    """
    water = moisture / WATER_DENSITY
    return water / (1 / GRAIN_DENSITY + water)
