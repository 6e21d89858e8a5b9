"""Cap of a compacting powder whose constants are tables over the density ratio: compression in a die and isotropic.

    f = sqrt[(p - pa)^2 + (R q)^2] - R (d + pa tan beta) = 0,   pa = (pb - R d)/(1 + R tan beta)

is the cap of the modified Drucker-Prager law with alpha = 0: an ellipse through (pb, 0) with its top on the shear line
q = d + p tan beta. pb, d, beta and R are tables over the density ratio k, and so are Young's modulus and Poisson's
ratio. Flow is associated, and dk/k is the plastic volumetric strain. p is the mean pressure and q the von Mises stress.
Below pa the shear line limits q, at constant density. Stresses are the moduli at k times the elastic strains.

Rigid-plastic powder in a die has q = 2 (p - pa)/(3 R^2), from a radial strain rate of zero.

`DensityCap` has the tables, `DensityDependentCap` is the law of the finite elements (`density_cap_return`).

References
----------
I. C. Sinka, J. C. Cunningham and A. Zavaliangos, Powder Technol. 133 (2003) 33-43 (calibration by dies).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from compact.material.laws import REFERENCE_RATE, DruckerPragerCap
from compact.material.pressure_sinkage import DensityLaw
from compact.numerics import Array
from compact.numerics.validation import require_positive

STEPS = 400  # [-], of one compression; twice as many change the stresses by less than 1e-3
LAW_POINTS = 120  # [-], of a tabulated law for columns
ROOT_TOLERANCE = 1e-14  # [-], of the plastic volumetric strain of one step
CENTRE_MARGIN = 1e-12  # [-], least distance of p from the centre of the ellipse over it, where q vanishes


class CapState(NamedTuple):
    """Cap at one density ratio: pa [Pa], R [-], d [Pa], tan beta [-]."""

    centre: float
    eccentricity: float
    cohesion: float
    tangent: float


@dataclass(frozen=True, eq=False)
class CompressionPath:
    """Stresses of one compression, arrays of shape (n,).

    Parameters
    ----------
    density_ratio : ndarray
        Density ratio k without the elastic strain [-].
    mean_pressure, von_mises_stress : ndarray
        p and q [Pa].
    elastic_strain : ndarray
        Elastic volumetric strain [-], by which the density under load exceeds k.
    """

    density_ratio: Array
    mean_pressure: Array
    von_mises_stress: Array
    elastic_strain: Array

    @property
    def axial_stress(self) -> Array:
        """Axial stress [Pa]."""
        return self.mean_pressure + 2 / 3 * self.von_mises_stress

    @property
    def radial_stress(self) -> Array:
        """Radial stress on the wall of the die [Pa]."""
        return self.mean_pressure - self.von_mises_stress / 3

    def at(self, density_ratio: ArrayLike, name: str = "axial_stress") -> Array:
        """Interpolate a stress [Pa] at density ratios [-] within the path.

        Parameters
        ----------
        density_ratio : array_like
            Density ratios k [-].
        name : str
            Stress, a field or property of the path.

        Returns
        -------
        ndarray
            Stress [Pa].
        """
        return np.interp(np.asarray(density_ratio, dtype=float), self.density_ratio, getattr(self, name))


@dataclass(frozen=True)
class DensityCap:
    """Cap with tables over the density ratio.

    Parameters
    ----------
    density_ratio : tuple of float
        Density ratios k of the tables of the cap [-], ascending.
    yield_pressure : tuple of float
        Isotropic yield pressure pb [Pa], ascending.
    cohesion, friction_angle, eccentricity : tuple of float
        d [Pa], beta [deg] and R [-].
    elastic_density_ratio : tuple of float
        Density ratios of the elastic tables [-], ascending.
    youngs_modulus, poisson : tuple of float
        E [Pa] and nu [-]; the first and last value hold beyond the table.
    """

    density_ratio: tuple[float, ...]
    yield_pressure: tuple[float, ...]
    cohesion: tuple[float, ...]
    friction_angle: tuple[float, ...]
    eccentricity: tuple[float, ...]
    elastic_density_ratio: tuple[float, ...]
    youngs_modulus: tuple[float, ...]
    poisson: tuple[float, ...]

    def __post_init__(self) -> None:
        columns = ("density_ratio", "yield_pressure", "cohesion", "friction_angle", "eccentricity")
        _require_columns(self, columns, ascending=columns[:2])
        elastic = ("elastic_density_ratio", "youngs_modulus", "poisson")
        _require_columns(self, elastic, ascending=elastic[:1])
        if max(self.poisson) >= 0.5:
            raise ValueError(f"`poisson` must be below 0.5, got {max(self.poisson)!r}")

    @cached_property
    def curves(self) -> tuple[PchipInterpolator, ...]:
        """Curves of ln pb, d, tan beta and R over ln k."""
        tangent = np.tan(np.radians(self.friction_angle))
        values = (np.log(self.yield_pressure), self.cohesion, tangent, self.eccentricity)
        return tuple(PchipInterpolator(np.log(self.density_ratio), each, extrapolate=False) for each in values)

    def cap(self, density_ratio: float) -> CapState:
        """Return the cap at a density ratio [-] within the tables."""
        logarithm, d, tangent, R = (float(curve(np.log(density_ratio))) for curve in self.curves)
        return CapState((np.exp(logarithm) - R * d) / (1 + R * tangent), R, d, tangent)

    def elastic_moduli(self, density_ratio: float) -> tuple[float, float]:
        """Return bulk and shear modulus [Pa] at a density ratio [-]."""
        E = float(np.interp(density_ratio, self.elastic_density_ratio, self.youngs_modulus))
        nu = float(np.interp(density_ratio, self.elastic_density_ratio, self.poisson))
        return E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))

    def rigid_die(self, density_ratio: ArrayLike) -> CompressionPath:
        """Compute the stresses of rigid-plastic powder in a die at density ratios [-]."""
        density = np.atleast_1d(np.asarray(density_ratio, dtype=float))
        rows = []
        for k in density.tolist():
            pa, R, d, tangent = self.cap(k)
            radius = R * (d + pa * tangent)
            rise = radius / np.sqrt(1 + 4 / (9 * R**2))
            rows.append((pa + rise, 2 * rise / (3 * R**2)))
        p, q = np.array(rows).T
        return CompressionPath(density, p, q, np.zeros_like(p))

    def die(self, start: float, end: float, steps: int = STEPS) -> CompressionPath:
        """Compress powder in a rigid die without wall friction from zero stress.

        Parameters
        ----------
        start, end : float
            Density ratios k before the test and at its end [-], within the tables.
        steps : int
            Steps of the strain from `start` to `end` without elastic strain.
        """
        return self._compress(start, end, steps, 2 / 3)

    def isotropic(self, start: float, end: float, steps: int = STEPS) -> CompressionPath:
        """Compress powder by equal principal stresses; parameters as of `die`."""
        return self._compress(start, end, steps, 0.0)

    def column_law(self, initial_density_ratio: float, end: float) -> DensityLaw:
        """Return the axial stress in a die over the density ratio, as a law for the engine "column".

        Parameters
        ----------
        initial_density_ratio : float
            Density ratio of the powder as fed [-].
        end : float
            Largest density ratio [-].
        """
        path = self.die(initial_density_ratio, end)
        density = path.density_ratio * np.exp(path.elastic_strain)  # under load
        chosen = np.linspace(0, len(density) - 1, min(LAW_POINTS, len(density))).astype(int)
        points = zip(density[chosen].tolist(), np.maximum.accumulate(path.axial_stress[chosen]).tolist(), strict=True)
        return DensityLaw(initial_density_ratio, tuple(points))

    def _compress(self, start: float, end: float, steps: int, shear_share: float) -> CompressionPath:
        """Integrate steps of the volumetric strain with a share of deviatoric strain, by backward Euler."""
        low, high = self.density_ratio[0], self.density_ratio[-1]
        if not low <= start < end <= high:
            raise ValueError(
                f"density ratios must satisfy {low:g} <= start < end <= {high:g} of the tables, got {start!r} and "
                f"{end!r}"
            )
        require_positive(steps=steps)
        k, volume, shear = float(start), 0.0, 0.0  # elastic strains
        strain, rows = np.log(end / start) / steps, [(k, 0.0, 0.0, 0.0)]
        while k < end * (1 - 1e-12):
            trial = (volume + strain, shear + shear_share * strain)
            found = self._return(k, trial, min(trial[0], np.log(high / k) * (1 - 1e-12)))
            if found is None:  # beyond the tables
                break
            x, p, q = found
            k *= np.exp(x)
            volume, shear = trial[0] - x, q / (3 * self.elastic_moduli(k)[1])
            rows.append((k, p, q, volume))
        density, p_path, q_path, strains = np.array(rows).T
        return CompressionPath(density, p_path, q_path, strains)

    def _return(self, k: float, trial: tuple[float, float], largest: float) -> tuple[float, float, float] | None:
        """Return plastic volumetric strain, p and q [Pa] of one step from the elastic strains of its trial state.

        None if the step leads beyond the tables.
        """

        def stresses(x: float) -> tuple[float, float, float]:
            pa, R, d, tangent = self.cap(k * np.exp(x))
            bulk, shear = self.elastic_moduli(k * np.exp(x))
            p = bulk * (trial[0] - x)
            rise = max(p - pa, CENTRE_MARGIN * abs(pa))
            q = 3 * shear * trial[1] / (1 + 3 * shear * R**2 * x / rise)  # x = 2 lambda (p - pa)
            return np.hypot(p - pa, R * q) - R * (d + pa * tangent), p, q

        def above_centre(x: float) -> float:
            return self.elastic_moduli(k * np.exp(x))[0] * (trial[0] - x) - self.cap(k * np.exp(x)).centre

        excess, p, q = stresses(0.0)
        centre, _, cohesion, tangent = self.cap(k)
        if p <= centre:
            return 0.0, p, min(q, cohesion + p * tangent)
        if excess <= 0:
            return 0.0, p, q
        if above_centre(largest) < 0:  # the flow is compaction above pa alone
            largest = float(brentq(above_centre, 0.0, largest, xtol=ROOT_TOLERANCE, rtol=1e-14))
        if stresses(largest)[0] > 0:
            return None
        x = float(brentq(lambda x: stresses(x)[0], 0.0, largest, xtol=ROOT_TOLERANCE, rtol=1e-14))
        return (x, *stresses(x)[1:])


@dataclass(frozen=True, kw_only=True)
class DensityDependentCap(DruckerPragerCap):
    """Irreversible compaction: a cap with the shear line of Drucker and Prager, both by tables over the density ratio.

    All tables belong to the largest density ratio so far, so that the opening of powder in tension does not soften it.
    The slopes and moduli of the base class are those of the powder as fed; `density_dependent_cap` sets them.

    Parameters
    ----------
    tables : DensityCap
        Tables of cap, line and moduli.
    """

    tables: DensityCap

    def yield_pressure(self, density_ratio: ArrayLike) -> Array:
        """Compute the isotropic yield pressure pb(k) [Pa] at rest.

        Parameters
        ----------
        density_ratio : array_like
            Density ratio k [-]. Beyond the tables pb continues along their tangent over ln k.

        Returns
        -------
        ndarray
            Pressure pb [Pa].
        """
        curve, place = self.tables.curves[0], np.log(np.asarray(density_ratio, dtype=float))
        low, high = curve.x[[0, -1]]
        inside = np.clip(place, low, high)
        return np.exp(curve(inside)) * (1 + curve(high, 1) * np.maximum(place - high, 0.0))

    def elastic_moduli(self, density_ratio: ArrayLike) -> tuple[float | Array, float | Array]:
        """Return Young's modulus [Pa] and Poisson's ratio [-] at density ratios [-]."""
        tables, ratio = self.tables, np.asarray(density_ratio, dtype=float)
        columns = tables.youngs_modulus, tables.poisson
        E, nu = (np.interp(ratio, tables.elastic_density_ratio, column) for column in columns)
        return np.asarray(E), np.asarray(nu)


def density_dependent_cap(
    tables: DensityCap, fed_density_ratio: float, rate_sensitivity: float = 0.0, reference_rate: float = REFERENCE_RATE
) -> DensityDependentCap:
    """Build the law of a powder or mix fed at a density ratio within the tables.

    Parameters
    ----------
    tables : DensityCap
        Tables of cap, line and moduli.
    fed_density_ratio : float
        Initial density ratio [-], within the tables of the cap and below 1.
    rate_sensitivity, reference_rate
        As of `Compaction`; the rate raises pb.

    Returns
    -------
    DensityDependentCap

    Raises
    ------
    ValueError
        If the density ratio lies outside the tables.
    """
    low, high = tables.density_ratio[0], tables.density_ratio[-1]
    if not low < fed_density_ratio < min(high, 1.0):
        raise ValueError(
            f"`fed_density_ratio` must lie within the tables of the cap, above {low:g} and below {min(high, 1.0):g}, "
            f"got {fed_density_ratio!r}"
        )
    _, eccentricity, cohesion, tangent = tables.cap(fed_density_ratio)
    E, nu = (
        float(np.interp(fed_density_ratio, tables.elastic_density_ratio, column))
        for column in (tables.youngs_modulus, tables.poisson)
    )
    pressure = float(np.interp(fed_density_ratio, tables.density_ratio, tables.yield_pressure))
    return DensityDependentCap(
        unloading_modulus=E,
        poisson=nu,
        heckel_slope=float(-np.log1p(-fed_density_ratio) / pressure),
        loose_density_ratio=low,
        critical_slope=1 / eccentricity,
        tensile_strength=cohesion / tangent,
        fed_density_ratio=fed_density_ratio,
        rate_sensitivity=rate_sensitivity,
        reference_rate=reference_rate,
        friction_slope=min(tangent, 1 / eccentricity),
        tables=tables,
    )


def heckel_slope(density_ratio: ArrayLike, pressure: ArrayLike) -> float:
    """Fit the slope of ln 1/(1 - k) over the pressure by least squares [1/Pa].

    Parameters
    ----------
    density_ratio, pressure : array_like, shape (n,)
        Density ratios k [-] and pressures [Pa].

    Returns
    -------
    float
        Slope K_H [1/Pa].
    """
    return float(np.polyfit(np.asarray(pressure), -np.log1p(-np.asarray(density_ratio)), 1)[0])


def _require_columns(record: object, names: Sequence[str], ascending: Sequence[str]) -> None:
    """Require columns of a table of equal length with positive values, some of them ascending."""
    columns = {name: getattr(record, name) for name in names}
    require_positive(**columns)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1 or min(lengths.values()) < 2:
        raise ValueError(f"columns of a table must have the same length of at least 2, got {lengths}")
    for name in ascending:
        if not (np.diff(columns[name]) > 0).all():
            raise ValueError(f"`{name}` of a table must ascend, got {columns[name]!r}")
