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

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from compact.analysis.contact_cases import compaction_material, scene_mix
from compact.material import cap_plasticity
from compact.material.drucker_prager_cap import return_to_line
from compact.material.elliptic_cap import return_map
from compact.material.laws import MEASURED_DENSITY_RATIO, Compaction
from compact.material.state_update import StateUpdate
from compact.numerics import Array
from compact.numerics.validation import require_positive
from compact.scene.loader import Scene

STEPS = 200  # [-], of one test
AXIAL_STRAIN = 0.05  # [-], at the end of biaxial, unconfined and shear tests
AXIAL_INCREMENTS = np.diff(AXIAL_STRAIN * np.linspace(0, 1, STEPS + 1) ** 2)  # [-], of the axial strain, first small
LATERAL_SHARES = (0.125, 0.25)  # [-], lateral pressures of the biaxial tests over the pressure of the oedometer
FIRST_STRAIN, LARGEST_STRAIN = 1e-6, 1.0  # [-], between which the strain of a step to a pressure is sought
STRAIN_ROUNDING = 1e-18  # [-], of that strain
VOLUME_LIMIT = 0.999  # [-], density ratio at which own materials end without reaching a pressure
LATERAL, AXIAL, TRANSVERSE, PLANE = 0, 1, 2, [0, 1, 3]  # components of x, y and z, and those of plane strain
CONFINED, EQUAL = np.array([0.0, -1.0, 0.0, 0.0]), np.array([-1.0, -1.0, -1.0, 0.0])  # directions of strain
ACROSS = np.array([-1.0, 0.0, 0.0, 0.0])


class MaterialTest(NamedTuple):
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
    def von_mises_stress(self) -> Array:
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
    """Tests of one mix or own material.

    Parameters
    ----------
    material : Compaction or StateUpdate
        Constitutive law of a mix, or own material.
    density_ratio : float or None
        Density ratio of the compacted specimens of a mix [-]; None for loose specimens alone, as of an own material.
    pressure : float
        Vertical stress at the end of the oedometer and of isotropic compression [Pa], > 0.
    """

    material: Compaction | StateUpdate
    density_ratio: float | None
    pressure: float

    def __post_init__(self) -> None:
        require_positive(pressure=self.pressure)

    @property
    def specimens(self) -> dict[str, float]:
        """Density ratio of each specimen before its tests [-]."""
        compacted = {} if self.density_ratio is None else {"compacted": self.density_ratio}
        return {"loose": self.material.fed_density_ratio} | compacted

    def path(self, specimen: str = "loose", share: float = 0.0) -> "StrainPath":
        """Return the path of a new specimen under a lateral pressure, given as a share of the largest [-]."""
        confining, law = share * self.pressure, self.material
        if isinstance(law, Compaction):
            law = _update_of_mix(law, confining, self.specimens[specimen])
        return StrainPath(law, specimen, self.pressure, confining)

    @cached_property
    def tests(self) -> tuple[MaterialTest, ...]:
        """All tests: oedometer, isotropic compression, and shear tests of each specimen.

        Raises
        ------
        RuntimeError
            If an own material does not reach the pressure before its pores close, or a lateral stress is not reached.
        """
        found = [self.path().oedometer(), self.path().isotropic()]
        for specimen in self.specimens:
            found += [self.path(specimen, share).biaxial() for share in (0.0, *LATERAL_SHARES)]
            found.append(self.path(specimen, LATERAL_SHARES[-1]).pure_shear())
        return tuple(found)

    def test(self, name: str, specimen: str = "loose") -> MaterialTest:
        """Return the first test of a kind, as of `MaterialTest`, with a specimen, "loose" or "compacted"."""
        return next(each for each in self.tests if (each.name, each.specimen) == (name, specimen))

    @property
    def earth_pressure_coefficient(self) -> float:
        """Lateral over vertical stress at the end of the oedometer's loading [-]."""
        test = self.test("oedometer")
        end = test.axial_stress.argmax()
        return float(test.lateral_stress[end] / test.axial_stress[end])

    def heckel_slope(self) -> float:
        """Fit the slope of ln[1/(1 - k)] over s_v to the oedometer beyond three quarters of its pressure [1/Pa]."""
        test = self.test("oedometer")
        end = int(test.axial_stress.argmax()) + 1
        stress, logarithm = test.axial_stress[:end], -np.log1p(-test.density_ratio[:end])
        used = stress > 0.75 * stress[-1]
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


def programme_of(scene: Scene) -> LaboratoryProgramme:
    """Return the tests of the mix of a scene, up to its required pressure."""
    mix = scene_mix(scene)
    return LaboratoryProgramme(compaction_material(scene, mix), scene.mix.density_ratio, mix.required_pressure)


def _update_of_mix(material: Compaction, confining: float, density_ratio: float) -> StateUpdate:
    """Return the law of a mix as a state update from a confining pressure [Pa] and a density ratio [-].

    It takes strains in plane strain, and equal principal strains by the return mapping itself.
    """
    start, constants = cap_plasticity.initial_state(material, 1), cap_plasticity.cap_constants(material, 1.0)
    start.stress[:, :3] = -confining
    start.density_ratio[:] = start.max_density_ratio[:] = density_ratio

    def update(state: cap_plasticity.MaterialPoint, strain: Array) -> tuple[Array, Any, Array]:
        whole = np.zeros((4, 4))
        if strain[2]:
            p = -float(state.stress[0, 0]) - constants.K * float(strain[:3].sum())
            trial = (p, 0.0, float(state.density_ratio[0]), float(state.max_density_ratio[0]), 0.0)
            if constants.line:
                _, p, _, *densities = return_to_line(constants, *trial, np.nan, 1.0)
            else:
                _, p, _, *densities = return_map(constants, *trial)
            k, densest = np.array(densities[:2])[:, None]
            after = replace(state, stress=p * EQUAL[None], density_ratio=k, max_density_ratio=densest)
        else:
            after, tangent = cap_plasticity.integrate_points(material, state, strain[None, PLANE])
            whole[np.ix_(PLANE, PLANE)] = tangent
        return after.stress[0], after, whole

    return StateUpdate(update, start, density_ratio, "the mix")


class StrainPath:
    """Strain path of one point with its history, compression positive; it begins under its confining pressure.

    Parameters
    ----------
    law : StateUpdate
        Material law with the state at the begin.
    specimen : str
        Name of the specimen.
    pressure : float
        Largest pressure of the tests [Pa].
    confining : float
        Lateral pressure [Pa].
    """

    def __init__(self, law: StateUpdate, specimen: str, pressure: float, confining: float) -> None:
        self.law, self.specimen, self.pressure, self.confining = law, specimen, pressure, confining
        self.state, self.strain, self.part = law.initial_state, np.zeros(4), 0.0
        self.rows: list[list[float]] = []
        self.advance(np.zeros(4))
        if self.rows[-1][2] < confining:
            self.advance_to(confining, AXIAL, EQUAL)
        self.rows = self.rows[-1:]

    def advance(self, strain: Array) -> None:
        """Apply a strain increment; record axial and volume strain, stresses and density ratio."""
        stress, self.state, _ = self.law.advance(self.state, strain)
        self.strain = self.strain + strain
        volume = -float(self.strain[:3].sum())
        of_mix = isinstance(self.state, cap_plasticity.MaterialPoint)  # without the elastic part of the volume
        ratio = self.state.density_ratio[0] if of_mix else self.law.fed_density_ratio * np.exp(volume)
        self.rows.append([-self.strain[AXIAL], volume, *-stress[[AXIAL, LATERAL, TRANSVERSE]], ratio])

    def advance_to(self, pressure: float, component: int, direction: Array, strain: Array | float = 0.0) -> None:
        """Apply a strain, and that part of a direction after which a stress is at a pressure [Pa].

        The stress rises with the part. The root is enclosed by steps from that of the increment before.
        """

        def excess(part: float) -> float:
            stress, *_ = self.law.advance(self.state, strain + part * direction)
            return -float(stress[component]) - pressure

        start, now = self.part, excess(self.part)
        step = -np.sign(now) * max(abs(start), FIRST_STRAIN)
        while now * excess(start + step) > 0:
            step *= 2
            if abs(step) > LARGEST_STRAIN or self.rows[-1][-1] > VOLUME_LIMIT:
                words = "before its pores close; test it at a lower pressure"
                raise RuntimeError(f"{self.law.name} does not reach {pressure:.4g} Pa {words}")
        self.part = float(brentq(excess, start, start + step, xtol=STRAIN_ROUNDING))
        self.advance(strain + self.part * direction)

    def oedometer(self) -> MaterialTest:
        """Compress the point without lateral strain up to the pressure, and release it."""
        for share in (*np.linspace(0, 1, STEPS + 1)[1:], *np.linspace(1, 0, STEPS // 4)[1:]):
            self.advance_to(share * self.pressure, AXIAL, CONFINED)
        return self.test("oedometer")

    def isotropic(self) -> MaterialTest:
        """Compress the point by equal principal stresses up to the pressure."""
        for share in np.linspace(0, 1, STEPS + 1)[1:]:
            self.advance_to(share * self.pressure, AXIAL, EQUAL)
        return self.test("isotropic")

    def pure_shear(self) -> MaterialTest:
        """Shear the point at constant volume."""
        for increment in AXIAL_INCREMENTS.tolist():
            self.advance(np.array([increment, -increment, 0.0, 0.0]))
        return self.test("pure shear")

    def biaxial(self) -> MaterialTest:
        """Compress the point along its axis at the confining pressure, up to the end of measured densities."""
        for axial in AXIAL_INCREMENTS.tolist():
            self.advance_to(self.confining, LATERAL, ACROSS, axial * CONFINED)
            if self.rows[-1][-1] > MEASURED_DENSITY_RATIO:
                break
        return self.test("biaxial" if self.confining else "unconfined")

    def test(self, name: str) -> MaterialTest:
        """Return the test with this path, its strains from the begin."""
        axial, volume, *others = np.array(self.rows).T
        return MaterialTest(name, self.specimen, self.confining, axial - axial[0], volume - volume[0], *others)
