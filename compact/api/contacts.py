"""Contacts of one roller over its speed, as a table, a figure, and meshes of the fields inside the layer."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from compact.api.fields import Fields
from compact.api.tables import build_dataset, build_frame, render_html
from compact.quantities import CONTACT, Quantity
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    import pandas
    import xarray
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
class Contacts(Sequence[Contact]):
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

    @overload
    def __getitem__(self, index: int) -> Contact: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Contact]: ...

    def __getitem__(self, index: int | slice) -> Contact | Sequence[Contact]:
        found = [first for first, *_ in self.passes]
        return found[index]

    def __len__(self) -> int:
        return len(self.passes)

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self.stage.engine.name

    @property
    def speeds(self) -> tuple[float, ...]:
        """Speed of the roller in each contact [m/s]."""
        return tuple(each.speed for each in self.records)

    @property
    def _columns(self) -> dict[str, list[Any]]:
        """Fields of the records that have a value, by name."""
        columns = {name: [getattr(each, name) for each in self.records] for name in QUANTITIES}
        return {name: values for name, values in columns.items() if any(value is not None for value in values)}

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the scalar results as a table over the speed [m/s], in SI units per unit roller length."""
        return build_frame(self._columns, QUANTITIES, "speed")

    def to_xarray(self) -> "xarray.Dataset":
        """Return the scalar results as a dataset over the speed [m/s], with units."""
        columns = {name: [float("nan") if value is None else value for value in values]
                   for name, values in self._columns.items()}  # fmt: skip
        return build_dataset(columns, QUANTITIES, "speed", {"engine": self.engine, "title": self.title})

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
        columns = self._columns
        return render_html(repr(self)[1:-1], {name: columns[name] for name in SHOWN if name in columns}, QUANTITIES)
