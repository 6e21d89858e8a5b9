"""Laboratory tests of a mix or of an own material, as a table and a figure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

from compact.analysis.contact_cases import compaction_material, scene_mix
from compact.analysis.material_tests import LaboratoryProgramme, MaterialTest
from compact.api.own_material import own_material_tests
from compact.api.tables import build_frame, render_html
from compact.material.state_update import StateUpdate
from compact.quantities import Quantity
from compact.scene.loader import Scene

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

STRESS = Quantity("stress", "Pa", "kPa")
STRESSES = (
    "lateral_pressure", "axial_stress", "lateral_stress", "transverse_stress", "mean_pressure", "von_mises_stress",
    "strength",
)  # fmt: skip
QUANTITIES = dict.fromkeys(STRESSES, STRESS)


@dataclass(frozen=True, eq=False)
class LaboratoryTests(Sequence[MaterialTest]):
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

    @overload
    def __getitem__(self, index: int) -> MaterialTest: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[MaterialTest]: ...

    def __getitem__(self, index: int | slice) -> MaterialTest | Sequence[MaterialTest]:
        return self.tests[index]

    def __len__(self) -> int:
        return len(self.tests)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the points of all paths as a table in SI units, compression positive."""
        from compact.report.material_writer import HEADER, path_rows

        names = [name.removesuffix("_Pa") for name in HEADER]
        columns = dict(zip(names, zip(*path_rows(self.tests), strict=True), strict=True))
        return build_frame(columns, QUANTITIES)

    def plot(self) -> "Figure":
        """Draw the tests: those of a mix as `compact material`, those of an own material as stress over strain.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from compact.report.figures.material import draw_material_tests, draw_stress_strain

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
        return render_html(repr(self)[1:-1], columns, QUANTITIES)


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
