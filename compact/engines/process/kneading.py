"""Kneading: density that mix gains by shear work under pressure, beyond the static curve of confined compression.

    ln[(1 - k0)/(1 - k)] = K1 p (1 + gain n^exponent),    n = int dW/(0.064 p)

K1 is the static Heckel slope, p the pressure. n counts gyrations: W is the shear work per volume, 0.064 p that of one
revolution in a gyratory compactor, of a shear path of 0.127 and a shear stress of half the pressure. The density tends
to full density and does not exceed it. A cap model alone gains nothing from a repeated equal stress.

The required pressures of roller machines, and with them the Heckel slope of the prior, come from kneaded mix. They are
never combined with this law.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from compact.numerics import Array
from compact.numerics.validation import require_fields

GYRATION_WORK = 0.064  # [-], shear work of a gyration over the pressure, 0.038 to 0.089: 2 pi tan 1.16 deg times tau/p
START = (0.5, 0.7)  # [-], gain and exponent from which a fit begins, near those of hot asphalt


@dataclass(frozen=True)
class Kneading:
    """Gain of the Heckel slope by gyrations.

    Parameters
    ----------
    gain : float
        Relative gain of the slope by the first gyration [-].
    exponent : float
        Exponent of the number of gyrations [-].

    Examples
    --------
    >>> Kneading(gain=0.5, exponent=0.7).slope_factor(10.0).round(2)
    np.float64(3.51)
    """

    gain: float
    exponent: float

    def __post_init__(self) -> None:
        require_fields(self, positive="exponent", nonnegative="gain")

    def slope_factor(self, gyrations: float | Array) -> Array:
        """Return the Heckel slope after gyrations over the static one [-]."""
        return np.asarray(1 + self.gain * np.asarray(gyrations, float) ** self.exponent)[()]


class Reading(NamedTuple):
    """Density ratio k of a specimen after n gyrations at a pressure p [Pa]."""

    gyrations: float
    pressure: float
    density_ratio: float
    specimen: str = ""


class KneadingFit(NamedTuple):
    """Law of readings.

    Parameters
    ----------
    kneading : Kneading
        Law of all specimens.
    static_slopes : dict
        Static Heckel slope K1 of each specimen [1/Pa].
    rms : float
        Root mean square of the residuals of the density ratio [-].
    """

    kneading: Kneading
    static_slopes: dict[str, float]
    rms: float


def fit_kneading(readings: Sequence[Reading], loose_density_ratio: float) -> KneadingFit:
    """Fit one gain and exponent, and the static slope of each specimen, by least squares of the density ratio.

    Parameters
    ----------
    readings : sequence of Reading
        Readings, of each specimen at two numbers of gyrations or more.
    loose_density_ratio : float
        Density ratio k0 at the start of Heckel's curve [-].

    Raises
    ------
    ValueError
        If there are fewer readings than parameters, or none after a gyration.
    """
    names = list(dict.fromkeys(each.specimen for each in readings))
    which = np.array([names.index(each.specimen) for each in readings], int)
    count, pressure, found = np.array([each[:3] for each in readings], float).reshape(-1, 3).T
    if len(readings) < len(names) + 2 or not count.any():
        raise ValueError(f"{len(names) + 2} readings are needed, some after gyrations, got {len(readings)}")

    def residuals(unknowns: Array) -> Array:
        kneading = Kneading(*np.exp(unknowns[:2]))
        rise = np.exp(unknowns[2:])[which] * pressure * kneading.slope_factor(count)
        return np.asarray(1 - (1 - loose_density_ratio) * np.exp(-rise) - found)

    slopes = np.log((1 - loose_density_ratio) / (1 - found)) / pressure / Kneading(*START).slope_factor(count)
    first = [slopes[which == place].mean() for place in range(len(names))]
    fit = least_squares(residuals, np.log([*START, *first]))
    static = dict(zip(names, np.exp(fit.x[2:]).tolist(), strict=True))
    return KneadingFit(Kneading(*np.exp(fit.x[:2]).tolist()), static, float(np.sqrt(np.mean(fit.fun**2))))
