"""Laboratory tests of a mix or of an own material, as a table and a figure; contacts of an own material."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from compact.analysis.contact_cases import contact_inputs, prescribed_target
from compact.analysis.material_tests import LaboratoryProgramme, MaterialTest, own_material_tests
from compact.analysis.mix_laws import compaction_material, scene_mix
from compact.analysis.pore_air import has_air
from compact.api.tables import Items
from compact.engines.column.state_update_columns import required_height
from compact.material.state_update import StateUpdate
from compact.numerics.validation import require_instance
from compact.quantities import Quantity
from compact.report.tables import TableSpec
from compact.rolling_contact import Contact
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STRESS = Quantity("stress", "Pa", "kPa")
STRESSES = (
    "lateral_pressure", "axial_stress", "lateral_stress", "transverse_stress", "mean_pressure", "von_mises_stress",
    "strength",
)  # fmt: skip
QUANTITIES = dict.fromkeys(STRESSES, STRESS)


@dataclass(frozen=True, eq=False)
class LaboratoryTests(Items[MaterialTest]):
    """Laboratory tests, a sequence of `MaterialTest`.

    Parameters
    ----------
    tests : tuple of MaterialTest
        Paths of the tests.
    name : str
        Name of the material.
    programme : LaboratoryProgramme, optional
        Programme of a mix; None for an own material.
    """

    tests: tuple[MaterialTest, ...]
    name: str
    programme: LaboratoryProgramme | None = None

    @property
    def items(self) -> tuple[MaterialTest, ...]:
        """Paths of the tests."""
        return self.tests

    @property
    def table(self) -> TableSpec:
        """Points of all paths, compression positive."""
        from compact.report.laboratory import HEADER, path_rows

        names = [name.removesuffix("_Pa") for name in HEADER]
        columns = dict(zip(names, zip(*path_rows(self.tests), strict=True), strict=True))
        return TableSpec.of_columns(repr(self)[1:-1], columns, QUANTITIES)

    def plot(self) -> "Figure":
        """Draw the tests: those of a mix as `compact material`, those of an own material as stress over strain.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from compact.report.laboratory import draw_material_tests, draw_stress_strain

        return draw_stress_strain(self.tests) if self.programme is None else draw_material_tests(self.programme)

    def __repr__(self) -> str:
        return f"<{len(self)} laboratory tests of {self.name}>"

    def _repr_html_(self) -> str:
        columns: dict[str, list[Any]] = {
            "test": [each.name for each in self],
            "specimen": [each.specimen for each in self],
            "lateral_pressure": [each.lateral_pressure for each in self],
            "strength": [each.strength for each in self],
        }
        return TableSpec.of_columns(repr(self)[1:-1], columns, QUANTITIES).to_html()


def laboratory_tests(material: StateUpdate, pressure: float) -> LaboratoryTests:
    """Apply the laboratory tests to loose mix of an own material.

    Parameters
    ----------
    material : StateUpdate
        Material law.
    pressure : float
        Vertical stress at the end of the oedometer and of isotropic compression [Pa], > 0.

    Returns
    -------
    LaboratoryTests
        Oedometer with unloading, isotropic compression, biaxial tests, among them the unconfined one, and pure shear.

    Raises
    ------
    RuntimeError
        If the material does not reach the pressure before its pores close, or a lateral stress is not reached.
    """
    return LaboratoryTests(own_material_tests(material, pressure), material.name)


def tests_of_mix(scene: Scene) -> LaboratoryTests:
    """Apply the laboratory tests to the mix of a scene, as `compact material` does.

    Parameters
    ----------
    scene : Scene
        Scene, of any engine.

    Returns
    -------
    LaboratoryTests
    """
    mix = scene_mix(scene)
    programme = LaboratoryProgramme(compaction_material(scene, mix), scene.mix.density_ratio, mix.required_pressure)
    return LaboratoryTests(programme.tests, f"the mix, law {scene.mix.law}", programme)


def roll_material(scene: Scene, material: StateUpdate, speed: float) -> Contact:
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
    Contact

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
    from compact.engines.column.engine import roll

    return roll(layer, roller, material, speed, **options)
