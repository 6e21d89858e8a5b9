"""Terrain of terramechanics: pressure over sinkage, shear stress over displacement, distribution along a wheel.

    Bekker     p = (kc/b + kphi) z^n
    Reece      p = (k1 + k2 b) (z/b)^n
    Johanson   s_v = s_0 (k/k_0)^K,  k = k_0 H/(H - z) in a layer of height H
    other      p(z) or s_v(k) as a table with monotone interpolation, or as a function

    Janosi-Hanamoto   tau = (c + sigma tan phi) (1 - exp(-j/K))

p is the pressure under a plate at the sinkage z, b the smaller side of the loaded area, j the shear displacement.

References
----------
M. G. Bekker, Introduction to Terrain-Vehicle Systems, University of Michigan Press 1969; A. R. Reece, Proc. Inst. Mech.
Eng. 180 (1965) 45-66; Z. Janosi and B. Hanamoto, Proc. 1st Int. Conf. Mech. Soil-Vehicle Systems, Turin 1961, 707-736;
J. Y. Wong and A. R. Reece, J. Terramechanics 4 (1967) no. 1, 81-98, and no. 2, 7-25; J. R. Johanson, J. Appl. Mech. 32
(1965) 842-848.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from compact.numerics import Array
from compact.numerics.validation import require_fields, require_positive

TABLE_POINTS_MIN = 2  # [-], points of a tabulated law


class PressureLaw(Protocol):
    """Vertical stress under a loaded area, or in confined layers, over the sinkage."""

    def pressure(self, sinkage: ArrayLike, height: float) -> Array:
        """Compute the pressure p [Pa] at sinkages z [m], >= 0, of a layer of a height [m]."""

    def knots(self, height: float) -> Array:
        """Return the sinkages [m] at which a derivative of the law jumps, ascending."""


class _SmoothLaw:
    """Law without knots."""

    def knots(self, height: float) -> Array:  # noqa: ARG002
        """Return no sinkage."""
        return np.empty(0)


@dataclass(frozen=True)
class PowerSinkage(_SmoothLaw):
    """Power law of a deep deposit, p = k z^n.

    Parameters
    ----------
    modulus : float
        k [Pa/m^n], > 0.
    exponent : float
        n [-], > 0.
    """

    modulus: float
    exponent: float

    def __post_init__(self) -> None:
        require_fields(self, positive="modulus exponent")

    def pressure(self, sinkage: ArrayLike, height: float = np.inf) -> Array:  # noqa: ARG002
        """Compute the pressure p [Pa] at sinkages z [m]; the deposit has any height."""
        return self.modulus * np.asarray(sinkage, dtype=float) ** self.exponent


def bekker(cohesive_modulus: float, frictional_modulus: float, exponent: float, width: float) -> PowerSinkage:
    """Build Bekker's law p = (kc/b + kphi) z^n.

    Parameters
    ----------
    cohesive_modulus : float
        kc [N/m^(n+1)], >= 0.
    frictional_modulus : float
        kphi [N/m^(n+2)], >= 0.
    exponent : float
        n [-], > 0.
    width : float
        Smaller side b of the loaded area [m], > 0.

    Returns
    -------
    PowerSinkage

    Examples
    --------
    >>> soil = bekker(990.0, 1.52843e6, 1.1, width=0.15)
    >>> f"{float(soil.pressure(0.02)) / 1e3:.2f} kPa"
    '20.76 kPa'
    """
    require_positive(width=width)
    return PowerSinkage(cohesive_modulus / width + frictional_modulus, exponent)


def reece(k1: float, k2: float, exponent: float, width: float) -> PowerSinkage:
    """Build Reece's law p = (k1 + k2 b) (z/b)^n.

    Parameters
    ----------
    k1, k2 : float
        Moduli [Pa] and [Pa/m], >= 0.
    exponent : float
        n [-], > 0.
    width : float
        Smaller side b of the loaded area [m], > 0.

    Returns
    -------
    PowerSinkage
    """
    require_positive(width=width)
    return PowerSinkage((k1 + k2 * width) / width**exponent, exponent)


@dataclass(frozen=True)
class JohansonLaw(_SmoothLaw):
    """Power law of a confined powder, s_v = s_0 (k/k_0)^K, with k = k_0 H/(H - z) in a layer of height H.

    Parameters
    ----------
    initial_pressure : float
        s_0 at the initial density ratio [Pa], > 0.
    compressibility : float
        K [-], > 0.
    """

    initial_pressure: float
    compressibility: float

    def __post_init__(self) -> None:
        require_fields(self, positive="initial_pressure compressibility")

    def pressure(self, sinkage: ArrayLike, height: float) -> Array:
        """Compute the vertical stress [Pa] at sinkages z [m] of a layer of a height [m]."""
        z = np.asarray(sinkage, dtype=float)
        return self.initial_pressure * (height / (height - z)) ** self.compressibility


@dataclass(frozen=True)
class FunctionLaw(_SmoothLaw):
    """Pressure over sinkage by any smooth function p(z).

    Parameters
    ----------
    function : callable
        Function of sinkages [m], shape (n,), that returns pressures [Pa], shape (n,).
    """

    function: Callable[[Array], ArrayLike]

    def pressure(self, sinkage: ArrayLike, height: float = np.inf) -> Array:  # noqa: ARG002
        """Compute the pressure [Pa] at sinkages z [m]."""
        return np.asarray(self.function(np.asarray(sinkage, dtype=float)), dtype=float)


@dataclass(frozen=True)
class TabulatedLaw:
    """Pressure over sinkage by a table with monotone cubic interpolation.

    Parameters
    ----------
    sinkage : tuple of float
        Sinkages [m], ascending from 0.
    values : tuple of float
        Pressures [Pa], not descending.
    """

    sinkage: tuple[float, ...]
    values: tuple[float, ...]
    _curve: PchipInterpolator = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        _require_table("sinkage", self.sinkage, self.values)
        if self.sinkage[0] != 0:
            raise ValueError(f"`sinkage` of a table must begin at 0, got {self.sinkage[0]!r}")
        object.__setattr__(self, "_curve", PchipInterpolator(self.sinkage, self.values, extrapolate=False))

    def pressure(self, sinkage: ArrayLike, height: float = np.inf) -> Array:  # noqa: ARG002
        """Interpolate the pressure [Pa] at sinkages z [m]; nan beyond the table."""
        return self._curve(np.asarray(sinkage, dtype=float))

    def knots(self, height: float) -> Array:  # noqa: ARG002
        """Return the sinkages of the table [m]."""
        return np.array(self.sinkage)


@dataclass(frozen=True)
class DensityLaw:
    """Vertical stress of a confined layer over its density ratio, by a table or a function s_v(k).

    Parameters
    ----------
    initial_density_ratio : float
        k_0 [-], 0 < k_0 < 1.
    stress : callable or tuple of (float, float)
        Function of the density ratio [-] that returns the vertical stress [Pa], or points (k, s_v) of a table.
    """

    initial_density_ratio: float
    stress: Callable[[Array], Array] | tuple[tuple[float, float], ...]
    _curve: Callable[[Array], Array] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        require_positive(initial_density_ratio=self.initial_density_ratio)
        if not self.initial_density_ratio < 1:
            raise ValueError(f"`initial_density_ratio` must be below 1, got {self.initial_density_ratio!r}")
        curve = self.stress
        if not callable(curve):
            density, values = zip(*curve, strict=True)
            _require_table("density_ratio", density, values)
            curve = PchipInterpolator(density, values, extrapolate=False)
        object.__setattr__(self, "_curve", curve)

    def pressure(self, sinkage: ArrayLike, height: float) -> Array:
        """Compute the vertical stress [Pa] at sinkages z [m] of a layer of a height [m]; nan beyond a table."""
        z = np.asarray(sinkage, dtype=float)
        return np.asarray(self._curve(self.initial_density_ratio * height / (height - z)), dtype=float)

    def knots(self, height: float) -> Array:
        """Return the sinkages of the points of the table [m]."""
        if callable(self.stress):
            return np.empty(0)
        density = np.array([ratio for ratio, _ in self.stress])
        return height * (1 - self.initial_density_ratio / density[density >= self.initial_density_ratio])


def _require_table(name: str, places: tuple[float, ...], values: tuple[float, ...]) -> None:
    """Require finite columns of a table of equal length, ascending and not descending."""
    if len(places) != len(values) or len(places) < TABLE_POINTS_MIN:
        raise ValueError(
            f"`{name}` and its stresses must have the same number of points, at least {TABLE_POINTS_MIN}, got "
            f"{len(places)} and {len(values)}"
        )
    if not (np.isfinite(places).all() and np.isfinite(values).all()):
        raise ValueError(f"`{name}` and its stresses must be finite")
    if not (np.diff(places) > 0).all():
        raise ValueError(f"`{name}` of a table must ascend, got {tuple(places)!r}")
    if values[0] < 0 or not (np.diff(values) >= 0).all():
        raise ValueError(f"the stresses of a table must be at least 0 and must not descend, got {tuple(values)!r}")


@dataclass(frozen=True)
class ShearStrength:
    """Shear stress over the shear displacement by Janosi and Hanamoto.

    Parameters
    ----------
    cohesion : float
        c [Pa], >= 0.
    friction_angle : float
        phi [deg], 0 <= phi < 90.
    displacement : float
        K [m], > 0: two thirds of the strength are mobilised at j = K.
    """

    cohesion: float
    friction_angle: float
    displacement: float

    def __post_init__(self) -> None:
        require_fields(self, positive="displacement", nonnegative="cohesion friction_angle")
        if not self.friction_angle < 90:
            raise ValueError(f"`friction_angle` must be below 90 degrees, got {self.friction_angle!r}")

    def stress(self, normal_stress: Array, displacement: Array) -> Array:
        """Compute the shear stress [Pa] at normal stresses [Pa] and signed displacements [m].

        Parameters
        ----------
        normal_stress : ndarray
            sigma [Pa], >= 0.
        displacement : ndarray
            Shear displacement j [m], with its sign.

        Returns
        -------
        ndarray
            tau with the sign of j [Pa].
        """
        strength = self.cohesion + normal_stress * np.tan(np.radians(self.friction_angle))
        return -np.sign(displacement) * strength * np.expm1(-np.abs(displacement) / self.displacement)


@dataclass(frozen=True)
class PeakAngle:
    """Place of the largest normal stress under a driven wheel, theta_m = (c1 + c2 slip) theta_1.

    Parameters
    ----------
    c1, c2 : float
        Constants [-], >= 0.
    """

    c1: float
    c2: float

    def __post_init__(self) -> None:
        require_fields(self, nonnegative="c1 c2")


@dataclass(frozen=True)
class Terrain:
    """Terrain under a rigid wheel.

    Parameters
    ----------
    law : PressureLaw
        Pressure over sinkage.
    shear : ShearStrength, optional
        Shear stress; a frictionless wheel without.
    peak : PeakAngle, optional
        Largest normal stress ahead of the lowest point, by Wong and Reece; without it the columns of the law carry the
        wheel from the entry to the lowest point.
    rebound_modulus : float
        Slope dp/dz of unloading behind the lowest point [Pa/m], > 0; infinite for a rut without rebound.
    """

    law: PressureLaw
    shear: ShearStrength | None = None
    peak: PeakAngle | None = None
    rebound_modulus: float = np.inf

    def __post_init__(self) -> None:
        if not self.rebound_modulus > 0:
            raise ValueError(f"`rebound_modulus` must be positive, got {self.rebound_modulus!r}")
        if self.peak is not None and self.shear is None:
            raise ValueError("the distribution of Wong and Reece needs a `shear` strength, got None")
        if self.peak is not None and np.isfinite(self.rebound_modulus):
            raise ValueError("`rebound_modulus` must be infinite with the distribution of Wong and Reece, got a number")
