"""Contacts of one roller over its speed, as a table, a figure, and meshes of the fields inside the layer."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compact.api.fields import Fields
from compact.api.tables import Items, TabularOverSpeed
from compact.quantities import CONTACT, Quantity
from compact.report.tables import TableSpec
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from compact.analysis.stages.contacts import ContactStage

ERROR = Quantity("relative error estimate", "1")
QUANTITIES: dict[str, Quantity] = {}
for _name, _quantity in CONTACT.items():
    QUANTITIES[_name] = _quantity
    if _name in ("load", "resistance"):
        QUANTITIES[f"{_name}_error"] = ERROR
    if _name == "work_residual":
        QUANTITIES["iterations"] = Quantity("iterations", "1")
SHOWN = ("speed", "load", "resistance", "coefficient", "peak_pressure", "indentation", "exit_density_ratio")  # in HTML


@dataclass(frozen=True, eq=False)
class Contacts(TabularOverSpeed, Items[Contact]):
    """Contacts of one roller, a sequence of the results of the first pass at each speed.

    Parameters
    ----------
    records : tuple of Contact
        Scalar results per unit roller length, with the effect of the pore air where the scene has it.
    passes : tuple of tuple of Contact
        Results of all passes at each speed.
    stage : ContactStage
        Stage that computed them.
    title : str
        Title of the scene.
    """

    records: tuple[Contact, ...]
    passes: tuple[tuple[Contact, ...], ...]
    stage: "ContactStage"
    title: str = ""

    @property
    def items(self) -> tuple[Contact, ...]:
        """Results of the first pass at each speed."""
        return tuple(first for first, *_ in self.passes)

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self.stage.engine.name

    @property
    def speeds(self) -> tuple[float, ...]:
        """Speed of the roller in each contact [m/s]."""
        return tuple(each.speed for each in self.records)

    @property
    def table(self) -> TableSpec:
        """Scalar results that have a value, over the speed [m/s], per unit roller length."""
        return self._table(*QUANTITIES)

    def _table(self, *names: str) -> TableSpec:
        columns = {name: [getattr(each, name) for each in self.records] for name in names}
        known = {name: values for name, values in columns.items() if any(value is not None for value in values)}
        return TableSpec.of_columns(repr(self)[1:-1], known, QUANTITIES)

    @property
    def _attributes(self) -> dict[str, str]:
        return {"engine": self.engine, "title": self.title}

    def plot(self) -> "Figure":
        """Draw load and rolling-resistance coefficient over the speed.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from compact.report.contact_figures import draw_loads

        return draw_loads(self.records)

    @property
    def fields(self) -> Fields:
        """Fields inside the layer at each speed, by an engine that has them.

        Raises
        ------
        ValueError
            If the engine has no fields.
        """
        frames = tuple((speed, self.stage.field_mesh(each)) for speed, each in zip(self.speeds, self, strict=True))
        return Fields(frames, "speed", tuple(self))

    def to_pyvista(self) -> Any:
        """Return the fields as a pyvista grid, or as a block for each speed; see `Fields.to_pyvista`."""
        return self.fields.to_pyvista()

    def to_vtk(self, directory: str | Path) -> Path:
        """Write the fields as VTU files with a PVD collection of ParaView.

        Parameters
        ----------
        directory : str or Path
            Directory of fields.pvd; created where it is missing.

        Returns
        -------
        Path
            The collection.
        """
        return self.fields.to_vtk(directory)

    def __repr__(self) -> str:
        words = f"contact by {self.engine} at {self.speeds[0]:.3g} m/s"
        if len(self) > 1:
            words = f"{len(self)} contacts by {self.engine}, {min(self.speeds):.3g} to {max(self.speeds):.3g} m/s"
        return f"<{words}{', ' + self.title if self.title else ''}>"

    def _repr_html_(self) -> str:
        return self._table(*SHOWN).to_html()
