"""Laboratory tests of a mix at a point: oedometer, isotropic and biaxial compression, pure shear, unconfined strength.

The tests apply the law that the engines of compaction integrate, so that its parameters can be compared with those of a
laboratory. Loose specimens have the initial density ratio, compacted ones that of the product. All tests but isotropic
compression are in plane strain; compression is positive.

    oedometer   no lateral strain, s_v up to a pressure and back to zero
    isotropic   s_1 = s_2 = s_3
    biaxial     constant lateral pressure, increasing axial strain, up to the end of measured densities
    pure shear  e_x = -e_y at constant volume, from a confining pressure
    unconfined  biaxial without lateral pressure
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from compact.material import cap_plasticity
from compact.material.drucker_prager_cap import return_to_line
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO, Compaction
from compact.numerics.validation import require_positive

STEPS = 200  # [-], of one test
AXIAL_STRAIN = 0.05  # [-], at the end of biaxial, unconfined and shear tests
AXIAL_INCREMENTS = np.diff(AXIAL_STRAIN * np.linspace(0, 1, STEPS + 1) ** 2)  # [-], of the axial strain, first small
LATERAL_SHARES = (0.125, 0.25)  # [-], lateral pressures of the biaxial tests over the pressure of the oedometer
STRESS_TOLERANCE = 1e-9  # [-], of the lateral stress over the pressure of the oedometer
MAX_ITERATIONS = 100  # [-], of the lateral strain in one step; some 5 are usual
STIFFNESS_SHARE = 1e-4  # [-], least tangent of the lateral strain over the bulk modulus

FloatArray = NDArray[np.float64]


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
    axial_strain: FloatArray
    volume_strain: FloatArray
    axial_stress: FloatArray
    lateral_stress: FloatArray
    transverse_stress: FloatArray
    density_ratio: FloatArray

    @property
    def mean_pressure(self) -> FloatArray:
        """Mean pressure p [Pa]."""
        return (self.axial_stress + self.lateral_stress + self.transverse_stress) / 3

    @property
    def shear_stress(self) -> FloatArray:
        """Von Mises stress q [Pa]."""
        a, b, c = self.axial_stress, self.lateral_stress, self.transverse_stress
        return np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2)

    @property
    def deviator_stress(self) -> FloatArray:
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
        return tuple(self._run())

    def _run(self) -> Iterator[MaterialTest]:
        yield oedometer(self.material, self.pressure)
        yield isotropic_compression(self.material, self.pressure)
        for specimen, ratio in (("loose", self.material.fed_density_ratio), ("compacted", self.density_ratio)):
            for share in (0.0, *LATERAL_SHARES):
                yield biaxial_compression(self.material, share * self.pressure, ratio, specimen)
            yield pure_shear(self.material, LATERAL_SHARES[-1] * self.pressure, ratio, specimen)

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
    """Compress loose mix without lateral strain, and release it.

    Parameters
    ----------
    material : Compaction
        Constitutive law.
    pressure : float
        Largest vertical stress [Pa].

    Returns
    -------
    MaterialTest
    """
    path = _Path(material, 0.0, material.fed_density_ratio)
    increment = 2 * -np.log(material.fed_density_ratio) / STEPS
    while path.stress(1) < pressure:
        before, state = path.stress(1), path.state
        path.advance(0.0, increment)
        if path.stress(1) > pressure:  # the last step ends at the pressure
            path.step_back(state)
            low, high = 0.0, increment
            while high - low > 1e-15 and abs(path.stress_after(0.0, high, 1) - pressure) > STRESS_TOLERANCE * pressure:
                middle = low + (high - low) / 2
                low, high = (middle, high) if path.stress_after(0.0, middle, 1) < pressure else (low, middle)
            path.advance(0.0, high)
            break
        increment *= 2.0 if path.stress(1) - before < pressure / STEPS else 0.7
    for release in np.diff(np.linspace(0, 1.0, STEPS // 4)):
        state = path.state
        path.advance(0.0, -release * pressure / path.oedometric_modulus)
        if path.stress(1) <= 0:
            path.step_back(state)
            break
    return path.test("oedometer", "loose", 0.0)


def isotropic_compression(material: Compaction, pressure: float) -> MaterialTest:
    """Compress loose mix by equal principal stresses.

    Parameters
    ----------
    material : Compaction
        Constitutive law.
    pressure : float
        Largest pressure [Pa].

    Returns
    -------
    MaterialTest
    """
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


def biaxial_compression(material: Compaction, pressure: float, density_ratio: float, specimen: str) -> MaterialTest:
    """Compress mix in plane strain at a constant lateral pressure.

    Parameters
    ----------
    material : Compaction
        Constitutive law.
    pressure : float
        Lateral pressure; zero for the unconfined test [Pa].
    density_ratio : float
        Density ratio of the specimen [-].
    specimen : {"loose", "compacted"}
        Name of the specimen.

    Returns
    -------
    MaterialTest
    """
    path = _Path(material, pressure, density_ratio)
    for increment in AXIAL_INCREMENTS:
        path.advance_at_pressure(float(increment), pressure)
        if path.history[-1].density_ratio[0] > HECKEL_MAX_DENSITY_RATIO:
            break
    return path.test("biaxial" if pressure else "unconfined", specimen, pressure)


def pure_shear(material: Compaction, pressure: float, density_ratio: float, specimen: str) -> MaterialTest:
    """Shear mix in plane strain at constant volume.

    Parameters
    ----------
    pressure : float
        Confining pressure before the test [Pa].
    material, density_ratio, specimen
        As of `biaxial_compression`.

    Returns
    -------
    MaterialTest
    """
    path = _Path(material, pressure, density_ratio)
    for increment in AXIAL_INCREMENTS:
        path.advance(-float(increment), float(increment))
    return path.test("pure shear", specimen, pressure)


class _Path:
    """Strain path of one point in plane strain with its history, compression positive."""

    def __init__(self, material: Compaction, pressure: float, density_ratio: float) -> None:
        start = cap_plasticity.initial_state(material, 1)
        start.stress[:] = -pressure * np.array([1.0, 1.0, 1.0, 0.0])
        start.density_ratio[:] = start.max_density_ratio[:] = density_ratio
        self.material, self.history, self.strains = material, [start], [np.zeros(2)]
        self.oedometric_modulus = material.unloading_modulus * (1 - material.poisson)
        self.oedometric_modulus /= (1 + material.poisson) * (1 - 2 * material.poisson)
        self.guess = 0.0

    @property
    def state(self) -> int:
        """Number of the present state."""
        return len(self.history)

    def step_back(self, state: int) -> None:
        """Return to an earlier state."""
        del self.history[state:], self.strains[state:]

    def stress(self, axis: int) -> float:
        """Return the stress along an axis [Pa]."""
        return -float(self.history[-1].stress[0, axis])

    def stress_after(self, lateral: float, axial: float, axis: int) -> float:
        """Return the stress along an axis after a strain increment [Pa]."""
        strain = np.array([[-lateral, -axial, 0.0]])
        new, _ = cap_plasticity.integrate_points(self.material, self.history[-1], strain, tangent=False)
        return -float(new.stress[0, axis])

    def advance(self, lateral: float, axial: float) -> None:
        """Apply a strain increment."""
        strain = np.array([[-lateral, -axial, 0.0]])
        new, _ = cap_plasticity.integrate_points(self.material, self.history[-1], strain, tangent=False)
        self.history.append(new)
        self.strains.append(self.strains[-1] + [lateral, axial])

    def advance_at_pressure(self, axial: float, pressure: float) -> None:
        """Apply an axial strain increment at a lateral stress [Pa]; Newton's method, safeguarded by bisection."""
        low, high, lateral = -np.inf, np.inf, self.guess * axial
        scale = max(pressure, float(self.material.yield_pressure(self.history[-1].max_density_ratio[0])))
        for _ in range(MAX_ITERATIONS):
            strain = np.array([[-lateral, -axial, 0.0]])
            new, slope = cap_plasticity.integrate_points(self.material, self.history[-1], strain)
            assert slope is not None  # as tangents are computed by default
            excess = -new.stress[0, 0] - pressure
            if abs(excess) < STRESS_TOLERANCE * scale:
                break
            low, high = (low, lateral) if excess > 0 else (lateral, high)
            lateral -= float(excess / max(slope[0, 0, 0], STIFFNESS_SHARE * self.oedometric_modulus))
            if not low < lateral < high:
                lateral = (low + high) / 2
        else:
            raise RuntimeError(f"the lateral stress differs by {excess:.3g} Pa after {MAX_ITERATIONS} iterations")
        self.guess = lateral / axial
        self.history.append(new)
        self.strains.append(self.strains[-1] + [lateral, axial])

    def test(self, name: str, specimen: str, pressure: float) -> MaterialTest:
        """Return the test with this path."""
        stress = -np.array([point.stress[0] for point in self.history])
        strain, ratio = np.array(self.strains), np.array([point.density_ratio[0] for point in self.history])
        return MaterialTest(
            name, specimen, pressure, strain[:, 1], strain.sum(axis=1), stress[:, 1], stress[:, 0], stress[:, 2], ratio
        )
