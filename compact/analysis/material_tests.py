"""Laboratory tests of a mix or an own material at a point, as strain paths of its `StateUpdate`.

The tests of a mix apply the law that the engines of compaction integrate, so that its parameters can be compared with
those of a laboratory. Loose specimens have the initial density ratio, compacted ones that of the product. An own
material is first compressed by equal strains up to the lateral pressure, as its state at rest as fed has no stress. All
tests but isotropic compression are in plane strain; compression is positive.

    oedometer   no lateral strain, s_v up to a pressure and back to zero
    isotropic   s_1 = s_2 = s_3
    biaxial     constant lateral pressure, increasing axial strain, up to the end of measured densities
    pure shear  e_x = -e_y at constant volume, from a confining pressure
    unconfined  biaxial without lateral pressure
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact.material import cap_plasticity
from compact.material.drucker_prager_cap import return_to_line
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO, Compaction
from compact.material.state_update import StateUpdate
from compact.numerics import Array
from compact.numerics.validation import require_instance, require_positive

STEPS = 200  # [-], of one test
AXIAL_STRAIN = 0.05  # [-], at the end of biaxial, unconfined and shear tests
AXIAL_INCREMENTS = np.diff(AXIAL_STRAIN * np.linspace(0, 1, STEPS + 1) ** 2)  # [-], of the axial strain, first small
LATERAL_SHARES = (0.125, 0.25)  # [-], lateral pressures of the biaxial tests over the pressure of the oedometer
STRESS_TOLERANCE, OWN_TOLERANCE = 1e-9, 1e-8  # [-], of the lateral stress over the pressure; of own materials
STRAIN_ROUNDING = 1e-15  # [-], of the last increment of a path to a pressure
OWN_FIRST, LARGEST = 1e-6, 1e-2  # [-], first increment of own materials and largest one of a path to a pressure
VOLUME_LIMIT = 0.999  # [-], density ratio at which own materials end without reaching a pressure
MAX_ITERATIONS = 100  # [-], of the lateral strain in one step; some 5 are usual
STIFFNESS_SHARE = 1e-4  # [-], least tangent of the lateral strain over that at rest
LATERAL, AXIAL = 0, 1  # components of x and y
CONFINED, EQUAL = np.array([0.0, -1.0, 0.0, 0.0]), np.array([-1.0, -1.0, -1.0, 0.0])  # directions of strain


@dataclass(frozen=True, eq=False)
class MaterialTest:
    """Path of one test, arrays of shape (n,).

    Parameters
    ----------
    name : {"oedometer", "isotropic", "biaxial", "pure shear", "unconfined"}
        Kind of test.
    specimen : {"loose", "compacted"}
        Specimen.
    lateral_pressure : float
        Pressure before the test [Pa].
    axial_strain, volume_strain : ndarray
        Logarithmic strains, compression positive [-].
    axial_stress, lateral_stress, transverse_stress : ndarray
        Principal stresses along, across and normal to the plane of the test [Pa].
    density_ratio : ndarray
        Density ratio [-].
    """

    name: str
    specimen: str
    lateral_pressure: float
    axial_strain: Array
    volume_strain: Array
    axial_stress: Array
    lateral_stress: Array
    transverse_stress: Array
    density_ratio: Array

    @property
    def mean_pressure(self) -> Array:
        """Mean pressure p [Pa]."""
        return (self.axial_stress + self.lateral_stress + self.transverse_stress) / 3

    @property
    def shear_stress(self) -> Array:
        """Von Mises stress q [Pa]."""
        a, b, c = self.axial_stress, self.lateral_stress, self.transverse_stress
        return np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)

    @property
    def deviator_stress(self) -> Array:
        """Axial less lateral stress [Pa]."""
        return self.axial_stress - self.lateral_stress

    @property
    def strength(self) -> float:
        """Largest axial less lateral stress [Pa]."""
        return float(self.deviator_stress.max())


@dataclass(frozen=True)
class LaboratoryProgramme:
    """Tests of one mix.

    Parameters
    ----------
    material : Compaction
        Constitutive law.
    density_ratio : float
        Density ratio of compacted specimens [-].
    pressure : float
        Vertical stress at the end of the oedometer [Pa].
    """

    material: Compaction
    density_ratio: float
    pressure: float

    def __post_init__(self) -> None:
        require_positive(density_ratio=self.density_ratio, pressure=self.pressure)
        if not self.material.fed_density_ratio <= self.density_ratio < 1:
            raise ValueError(
                f"`density_ratio` of the compacted specimen must lie between the initial one "
                f"{self.material.fed_density_ratio!r} and 1, got {self.density_ratio!r}"
            )

    @cached_property
    def tests(self) -> tuple[MaterialTest, ...]:
        """All tests: oedometer, isotropic compression, and shear tests of both specimens."""
        found = [oedometer(self.material, self.pressure), isotropic_compression(self.material, self.pressure)]
        for specimen, ratio in (("loose", self.material.fed_density_ratio), ("compacted", self.density_ratio)):
            path = partial(_path_of_mix, self.material, self.pressure, density_ratio=ratio)
            found += _shear_tests(path, self.pressure, specimen)
        return tuple(found)

    def test(self, name: str, specimen: str = "loose", lateral_pressure: float | None = None) -> MaterialTest:
        """Return the first test with a name and a specimen.

        Parameters
        ----------
        name : str
            Kind of test, as of `MaterialTest`.
        specimen : {"loose", "compacted"}
            Specimen.
        lateral_pressure : float, optional
            Pressure before the test [Pa]; any by default.

        Returns
        -------
        MaterialTest

        Raises
        ------
        KeyError
            If there is no such test.
        """
        for each in self.tests:
            if (each.name, each.specimen) == (name, specimen) and lateral_pressure in (None, each.lateral_pressure):
                return each
        raise KeyError(f"no test {name!r} of the {specimen} specimen at {lateral_pressure!r} Pa")

    @property
    def earth_pressure_coefficient(self) -> float:
        """Lateral over vertical stress at the end of the oedometer's loading [-]."""
        test = self.test("oedometer")
        end = int(test.axial_stress.argmax())
        return float(test.lateral_stress[end] / test.axial_stress[end])

    def heckel_slope(self) -> float:
        """Fit the slope of ln[1/(1 - k)] over s_v to the oedometer beyond half of its pressure [1/Pa]."""
        test = self.test("oedometer")
        end = int(test.axial_stress.argmax()) + 1
        stress, logarithm = test.axial_stress[:end], -np.log1p(-test.density_ratio[:end])
        used = stress > stress[-1] / 2
        return float(np.polyfit(stress[used], logarithm[used], 1)[0])

    def mohr_coulomb(self, specimen: str) -> tuple[float, float]:
        """Fit the criterion of Mohr and Coulomb to the biaxial tests of a specimen, the unconfined one included.

        Parameters
        ----------
        specimen : {"loose", "compacted"}
            Specimen.

        Returns
        -------
        friction_angle, cohesion : float
            Angle [deg] and cohesion [Pa].

        Notes
        -----
        s_1 = s_3 (1 + sin phi)/(1 - sin phi) + 2 c cos phi/(1 - sin phi) at the largest difference. Specimens that
        compact in the test, beyond the friction of the mix, have smaller angles and larger cohesions.
        """
        used = [each for each in self.tests if each.specimen == specimen and each.name in ("biaxial", "unconfined")]
        lateral = np.array([each.lateral_pressure for each in used])
        slope, unconfined = np.polyfit(lateral, lateral + [each.strength for each in used], 1)
        sine = (slope - 1) / (slope + 1)
        cohesion = unconfined * (1 - sine) / (2 * np.sqrt(1 - sine**2))
        return float(np.degrees(np.arcsin(sine))), float(cohesion)


def oedometer(material: Compaction, pressure: float) -> MaterialTest:
    """Compress loose mix without lateral strain up to a vertical stress [Pa], and release it."""
    return _path_of_mix(material, pressure).oedometer()


def isotropic_compression(material: Compaction, pressure: float) -> MaterialTest:
    """Compress loose mix by equal principal stresses up to a pressure [Pa], by the return mapping itself."""
    constants = cap_plasticity.cap_constants(material, 1.0)
    k = densest = float(material.fed_density_ratio)
    p, strain, step = 0.0, 0.0, pressure / STEPS / constants.K
    rows = [(strain, p, k)]
    while p < pressure:
        trial = (p + constants.K * step, 0.0, k, densest, 0.0)
        if constants.line:
            found = return_to_line(constants, *trial, np.nan, 1.0)
        else:
            found = cap_plasticity.return_map(constants, *trial)
        strain += step
        step *= 1.5 if found[1] - p < 0.5 * pressure / STEPS else 1.0
        p, k, densest = float(found[1]), float(found[3]), float(found[4])
        rows.append((strain, p, k))
    volume, stress, ratio = np.array(rows).T
    return MaterialTest("isotropic", "loose", 0.0, volume / 3, volume, stress, stress, stress, ratio)


def own_material_tests(material: StateUpdate, pressure: float) -> tuple[MaterialTest, ...]:
    """Apply the laboratory tests to loose mix of an own material; see `api.results.laboratory_tests`.

    Parameters
    ----------
    material : StateUpdate
        Material law.
    pressure : float
        Vertical stress at the end of the oedometer and of isotropic compression [Pa], > 0.

    Returns
    -------
    tuple of MaterialTest
        Oedometer with unloading, isotropic compression, biaxial tests, among them the unconfined one, and pure shear.

    Raises
    ------
    RuntimeError
        If the material does not reach the pressure before its pores close, or a lateral stress is not reached.
    """
    require_instance(StateUpdate, "a StateUpdate", material=material)
    require_positive(pressure=pressure)

    def path(confining: float = 0.0) -> StrainPath:
        return StrainPath(material, material.initial_state, pressure, confining)

    isotropic = path()
    isotropic.compress(EQUAL, pressure)
    return path().oedometer(), isotropic.test("isotropic"), *_shear_tests(path, pressure, "loose")


def _shear_tests(path: "Callable[[float], StrainPath]", pressure: float, specimen: str) -> Iterator[MaterialTest]:
    """Apply the shear tests to specimens under lateral pressures [Pa], each on a new path."""
    for share in (0.0, *LATERAL_SHARES):
        yield path(share * pressure).biaxial(specimen)
    sheared = path(LATERAL_SHARES[-1] * pressure)
    for increment in AXIAL_INCREMENTS.tolist():
        sheared.advance(np.array([increment, -increment, 0.0, 0.0]))
    yield sheared.test("pure shear", specimen)


def _path_of_mix(
    material: Compaction, pressure: float, confining: float = 0.0, density_ratio: float | None = None
) -> "StrainPath":
    """Return the path of mix under a confining pressure [Pa] at a density ratio [-], that of the fed mix by default."""
    start = cap_plasticity.initial_state(material, 1)
    start.stress[:, :3] = -confining
    if density_ratio is not None:
        start.density_ratio[:] = start.max_density_ratio[:] = density_ratio

    def update(state: cap_plasticity.MaterialPoint, strain: Array) -> tuple[Array, Any, Array]:
        after, tangent = cap_plasticity.integrate_points(material, state, strain[None, [0, 1, 3]])
        assert tangent is not None  # as tangents are computed by default
        whole = np.zeros((4, 4))
        whole[np.ix_([0, 1, 3], [0, 1, 3])] = tangent[0]
        return after.stress[0], after, whole

    law = StateUpdate(update, start, material.fed_density_ratio, "the mix")
    return StrainPath(
        law, start, pressure, confining, STRESS_TOLERANCE, 2 * -np.log(material.fed_density_ratio) / STEPS, of_mix=True
    )


class StrainPath:
    """Strain path of one point with its history, compression positive; it begins under its confining pressure.

    Parameters
    ----------
    law : StateUpdate
        Material law.
    state : object
        State at the begin.
    pressure : float
        Largest pressure of the tests [Pa], to which tolerances refer.
    confining : float
        Lateral pressure [Pa].
    tolerance : float
        Of the lateral stress over the pressure [-].
    first : float
        First increment of a path to a pressure [-].
    of_mix : bool
        State of a mix, a `MaterialPoint`, which has a density ratio without the elastic part of the volume.
    """

    def __init__(
        self, law: StateUpdate, state: Any, pressure: float, confining: float = 0.0, tolerance: float = OWN_TOLERANCE,
        first: float = OWN_FIRST, of_mix: bool = False,
    ) -> None:  # fmt: skip
        self.law, self.pressure, self.confining, self.tolerance = law, pressure, confining, tolerance
        self.first, self.of_mix, self.volume, self.guess = first, of_mix, 0.0, 0.0
        self.stress, self.state, self.tangent = law.advance(state, np.zeros(4))
        self.stiffness = float(self.tangent[LATERAL, LATERAL])  # at rest
        self.rows = [self._row(0.0, 0.0)]
        if self.axial_stress < confining:
            self.compress(EQUAL, confining)
            self.rows = [self._row(0.0, 0.0)]

    def _row(self, axial: float, volume: float) -> tuple[float, ...]:
        """Return axial and volume strain since the begin, stresses and density ratio."""
        ratio = self.state.density_ratio[0] if self.of_mix else self.law.fed_density_ratio * np.exp(self.volume)
        return axial, volume, *(-self.stress[:3]), float(ratio)

    def advance(self, strain: Array) -> None:
        """Apply a strain increment."""
        self.stress, self.state, self.tangent = self.law.advance(self.state, strain)
        volume = -float(strain[:3].sum())
        self.volume += volume
        self.rows.append(self._row(self.rows[-1][0] - strain[AXIAL], self.rows[-1][1] + volume))

    @property
    def axial_stress(self) -> float:
        """Axial stress [Pa]."""
        return -float(self.stress[AXIAL])

    def _approach(self, direction: Array, pressure: float, step: float) -> bool:
        """Advance by a step in a direction, or by its part after which the axial stress equals a pressure [Pa].

        Returns True for a part.
        """

        def excess(part: float) -> float:
            return -float(self.law.advance(self.state, part * direction)[0][AXIAL]) - pressure

        beyond = excess(step) * np.sign(step) > 0
        if beyond:
            step = float(brentq(excess, min(0.0, step), max(0.0, step), xtol=STRAIN_ROUNDING))
        self.advance(step * direction)
        return beyond

    def compress(self, direction: Array, pressure: float) -> None:
        """Strain in a direction until the axial stress equals a pressure [Pa]."""
        step, fed = self.first, self.law.fed_density_ratio
        while (reached := self.axial_stress) < pressure:
            if not self.of_mix and fed * np.exp(self.volume) > VOLUME_LIMIT:
                raise RuntimeError(
                    f"{self.law.name} bears {reached:.4g} Pa at a density ratio of {VOLUME_LIMIT}, required "
                    f"{pressure:.4g} Pa; lower the pressure of the tests"
                )
            if self._approach(direction, pressure, step):
                return
            step = min(LARGEST, step * (2.0 if self.axial_stress - reached < pressure / STEPS else 0.7))

    def oedometer(self) -> MaterialTest:
        """Compress the point without lateral strain up to the pressure, and release it."""
        self.compress(CONFINED, self.pressure)
        while (stress := self.axial_stress) > 0:
            step = -self.pressure / (STEPS // 4 - 1) / max(float(self.tangent[AXIAL, AXIAL]), self.stiffness)
            if not np.isfinite(step) or step >= 0:
                raise RuntimeError(f"the tangent of {self.law.name} in confined compression must be positive")
            if self._approach(CONFINED, 0.0, step):
                break
            if self.axial_stress >= stress:
                raise RuntimeError(f"{self.law.name} does not unload in confined compression")
        return self.test("oedometer")

    def biaxial(self, specimen: str) -> MaterialTest:
        """Compress the point along its axis at the confining pressure, up to the end of measured densities of a mix."""
        for axial in AXIAL_INCREMENTS.tolist():
            self._advance_at_pressure(axial)
            if self.of_mix and self.rows[-1][-1] > HECKEL_MAX_DENSITY_RATIO:
                break
        return self.test("biaxial" if self.confining else "unconfined", specimen)

    def _advance_at_pressure(self, axial: float) -> None:
        """Apply an axial compression at the confining pressure; Newton's method, safeguarded by bisection."""
        low, high, lateral = -np.inf, np.inf, self.guess * axial
        for _ in range(MAX_ITERATIONS):
            strain = np.array([-lateral, -axial, 0.0, 0.0])
            stress, _, tangent = self.law.advance(self.state, strain)
            excess = -float(stress[LATERAL]) - self.confining
            if abs(excess) < self.tolerance * self.pressure:
                self.guess = lateral / axial
                self.advance(strain)
                return
            low, high = (low, lateral) if excess > 0 else (lateral, high)
            lateral -= excess / max(float(tangent[LATERAL, LATERAL]), STIFFNESS_SHARE * self.stiffness)
            if not low < lateral < high:
                lateral = (low + high) / 2
        raise RuntimeError(
            f"the lateral stress of {self.law.name} differs by {excess:.3g} Pa from {self.confining:.3g} Pa after "
            f"{MAX_ITERATIONS} iterations; check the tangent"
        )

    def test(self, name: str, specimen: str = "loose") -> MaterialTest:
        """Return the test with this path."""
        axial, volume, side, along, across, ratio = np.array(self.rows).T
        return MaterialTest(name, specimen, self.confining, axial, volume, along, side, across, ratio)
