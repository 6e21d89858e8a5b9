"""Own material of a user: contacts of a scene by the engine "column", and laboratory tests of a point.

The tests are those of `material_tests` on loose mix, driven through strain increments of a `StateUpdate`. The mix is
first compressed by equal strains up to the lateral pressure, as its state at rest as fed has no stress.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact.analysis.contact_cases import contact_inputs, prescribed_target, scene_mix
from compact.analysis.engines import ENGINES
from compact.analysis.material_tests import AXIAL_STRAIN, LATERAL_SHARES, STEPS, MaterialTest
from compact.analysis.pore_air import has_air
from compact.engines.column.state_update_columns import required_height
from compact.material.state_update import StateUpdate
from compact.numerics import Array
from compact.numerics.validation import require_instance, require_positive
from compact.rolling_contact import ContactResult
from compact.scene.loader import Scene

STRESS_SHARE = 1 / STEPS  # [-], change of the driven stress in one increment over the pressure, aimed at
STRAIN_ROUNDING = 1e-15  # [-], of the last increment of a path to a pressure
STRAIN_FIRST, STRAIN_MAX = 1e-6, 1e-2  # [-], first and largest increment of a path to a pressure
VOLUME_LIMIT = 0.999  # [-], density ratio at which a path to a pressure ends without reaching it
LATERAL_ITERATIONS = 60  # [-], of the lateral strain in one increment; some 5 are usual
LATERAL_TOLERANCE = 1e-8  # [-], of the lateral stress over the pressure of the oedometer
LATERAL, AXIAL = 0, 1  # components of x and y
ONE, ALL = np.array([0.0, -1.0, 0.0, 0.0]), np.array([-1.0, -1.0, -1.0, 0.0])  # confined, and equal strains


def roll_material(scene: Scene, material: StateUpdate, speed: float) -> ContactResult:
    """Compute the contact of one roller of a scene over an own material.

    Parameters
    ----------
    scene : Scene
        Scene of the engine "column" with one pass. Without a target in [contact] the pass leads to the thickness and
        the density ratio of the product.
    material : StateUpdate
        Material law, whose initial density ratio replaces that of the scene.
    speed : float
        Speed of the roller [m/s].

    Returns
    -------
    ContactResult

    Raises
    ------
    ValueError
        If the engine of the scene is another, or the scene has several passes or pore air.
    """
    require_instance(StateUpdate, "a StateUpdate", material=material)
    if scene.accuracy.engine != "column" or scene.layer.passes != 1:
        raise ValueError(
            f"an own material needs the engine column and one pass, got {scene.accuracy.engine} and "
            f"{scene.layer.passes}; the other engines have no Python interface to the stress of a point"
        )
    if has_air(scene):
        raise ValueError(f'{scene.file}: an own material has no pore air; set mix.pore_air = "drained"')
    scene = scene.replaced(**{"layer.fed_density_ratio": material.fed_density_ratio})
    layer, roller, _ = contact_inputs(scene, scene_mix(scene), "column", speed)
    options: dict[str, Any] = {"rtol": scene.accuracy.tolerance / 10}
    if not prescribed_target(scene):
        ratio = scene.mix.density_ratio
        layer = replace(layer, height=required_height(scene.lift_thickness, ratio, material))
        options["exit_density_ratio"] = ratio
    return ENGINES["column"].roll(layer, roller, material, speed, **options)


def own_material_tests(material: StateUpdate, pressure: float) -> tuple[MaterialTest, ...]:
    """Apply the laboratory tests of `material_tests` to loose mix; see `laboratory.laboratory_tests`.

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
    return tuple(_tests(material, pressure))


def _tests(material: StateUpdate, pressure: float) -> Iterator[MaterialTest]:
    path = _StrainPath(material, pressure)
    path.compress(ONE, pressure)
    path.release()
    yield path.test("oedometer", 0.0)
    path = _StrainPath(material, pressure)
    path.compress(ALL, pressure)
    yield path.test("isotropic", 0.0)
    increments = np.diff(AXIAL_STRAIN * np.linspace(0, 1, STEPS + 1) ** 2)
    for share in (0.0, *LATERAL_SHARES):
        path = _StrainPath(material, pressure, share * pressure)
        for increment in increments.tolist():
            path.advance_at_pressure(increment)
        yield path.test("biaxial" if share else "unconfined", share * pressure)
    path = _StrainPath(material, pressure, LATERAL_SHARES[-1] * pressure)
    for increment in increments.tolist():
        path.advance(np.array([increment, -increment, 0.0, 0.0]))
    yield path.test("pure shear", LATERAL_SHARES[-1] * pressure)


class _StrainPath:
    """Strain path of one point, from rest or from a confining pressure [Pa]."""

    def __init__(self, material: StateUpdate, pressure: float, confining: float = 0.0) -> None:
        self.material, self.pressure, self.confining = material, pressure, confining
        self.stress, self.state, self.tangent = material.advance(material.initial_state, np.zeros(4))
        self.volume, self.guess = 0.0, 0.0
        if confining:
            self.compress(ALL, confining)
        self.rows = [self._row(np.zeros(2))]

    def _row(self, strain: Array) -> Array:
        ratio = self.material.fed_density_ratio * np.exp(self.volume)
        return np.concatenate([strain, -self.stress[:3], [ratio]])

    def advance(self, strain: Array) -> None:
        """Apply a strain increment."""
        self.stress, self.state, self.tangent = self.material.advance(self.state, strain)
        self.volume -= float(strain[:3].sum())
        if hasattr(self, "rows"):
            self.rows.append(self._row(self.rows[-1][:2] - strain[[LATERAL, AXIAL]]))

    def _pressure_after(self, strain: Array) -> float:
        return -float(self.material.advance(self.state, strain)[0][AXIAL])

    def _root(self, direction: Array, pressure: float, low: float, high: float) -> float:
        """Return the strain in a direction, between two, after which the axial stress equals a pressure [Pa]."""
        return float(
            brentq(lambda part: self._pressure_after(part * direction) - pressure, low, high, xtol=STRAIN_ROUNDING)
        )

    def compress(self, direction: Array, pressure: float) -> None:
        """Strain in a direction until the axial stress equals a pressure [Pa]."""
        step, fed = STRAIN_FIRST, self.material.fed_density_ratio
        while (reached := -float(self.stress[AXIAL])) < pressure:
            if fed * np.exp(self.volume) > VOLUME_LIMIT:
                raise RuntimeError(
                    f"{self.material.name} bears {reached:.4g} Pa at a density ratio of {VOLUME_LIMIT}, required "
                    f"{pressure:.4g} Pa; lower the pressure of the tests"
                )
            after = self._pressure_after(step * direction)
            if after > pressure:  # the last increment ends at the pressure
                self.advance(direction * self._root(direction, pressure, 0.0, step))
                return
            self.advance(step * direction)
            rise = max(after - reached, 0.0)
            step = min(STRAIN_MAX, step * (2.0 if rise < STRESS_SHARE * pressure else 0.7))

    def release(self) -> None:
        """Unload without lateral strain until the axial stress vanishes."""
        share = self.pressure * 4 / STEPS
        while (stress := -float(self.stress[AXIAL])) > 0:
            step = -share / float(self.tangent[AXIAL, AXIAL])
            if not np.isfinite(step) or step >= 0:
                raise RuntimeError(f"the tangent of {self.material.name} in confined compression must be positive")
            if self._pressure_after(step * ONE) < 0:
                self.advance(ONE * self._root(ONE, 0.0, step, 0.0))
                return
            self.advance(step * ONE)
            if -float(self.stress[AXIAL]) >= stress:
                raise RuntimeError(f"{self.material.name} does not unload in confined compression")

    def advance_at_pressure(self, axial: float) -> None:
        """Apply an axial compression at the confining pressure; Newton's method, safeguarded by bisection."""
        low, high, lateral = -np.inf, np.inf, self.guess * axial
        for _ in range(LATERAL_ITERATIONS):
            strain = np.array([-lateral, -axial, 0.0, 0.0])
            stress, _, tangent = self.material.advance(self.state, strain)
            excess = -float(stress[LATERAL]) - self.confining
            if abs(excess) < LATERAL_TOLERANCE * self.pressure:
                self.guess = lateral / axial
                self.advance(strain)
                return
            low, high = (low, lateral) if excess > 0 else (lateral, high)
            lateral -= excess / float(tangent[LATERAL, LATERAL])
            if not low < lateral < high:
                lateral = (low + high) / 2
        raise RuntimeError(
            f"the lateral stress of {self.material.name} differs by {excess:.3g} Pa from {self.confining:.3g} Pa after "
            f"{LATERAL_ITERATIONS} iterations; check the tangent"
        )

    def test(self, name: str, lateral_pressure: float) -> MaterialTest:
        """Return the test with this path."""
        _, axial, side, along, across, ratio = np.array(self.rows).T
        volume = np.log(ratio / ratio[0])
        return MaterialTest(name, "loose", lateral_pressure, axial, volume, along, side, across, ratio)
