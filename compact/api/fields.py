"""Fields inside the layer, computed or read from VTU and PVD files, for pyvista, tables, pictures and notebooks."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.files import read_vtu_series, render_png, write_figure, write_vtu_series
from compact.numerics.validation import require_instance
from compact.quantities import FIELD
from compact.report.tables import WORD, TableSpec

if TYPE_CHECKING:
    import meshio
    import pandas
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Fields:
    """Meshes with fields, one or a series.

    Parameters
    ----------
    frames : tuple of (float, meshio.Mesh)
        Value of the series parameter, such as the speed [m/s] or the time [s], and mesh.
    parameter : str
        Name of the series parameter.
    contacts : sequence of Contact
        Contact of each mesh, whose roller pictures show; empty for fields from a file.
    """

    frames: tuple[tuple[float, "meshio.Mesh"], ...]
    parameter: str = "frame"
    contacts: Sequence[Any] = ()

    @property
    def mesh(self) -> "meshio.Mesh":
        """The first mesh."""
        return self.frames[0][1]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the fields with one value in each element."""
        return tuple(name for name, values in self.mesh.cell_data.items() if np.ndim(values[0]) == 1)

    def to_pyvista(self, displaced: bool = True) -> Any:
        """Convert to pyvista.

        Parameters
        ----------
        displaced : bool
            True for the displaced layer, False for the layer as fed.

        Returns
        -------
        pyvista.UnstructuredGrid or pyvista.MultiBlock
            Grid with all point and cell data; of a series a block for each frame, called "PARAMETER=VALUE".
        """
        import pyvista

        grids = {f"{self.parameter}={value:g}": pyvista.from_meshio(mesh) for value, mesh in self.frames}
        for grid in grids.values():
            if displaced and "displacement" in grid.point_data:
                grid.points = grid.points + grid.point_data["displacement"]
        return next(iter(grids.values())) if len(grids) == 1 else pyvista.MultiBlock(grids)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the element means as a table: centre of the element as fed [m], and every field in its SI unit."""
        rows: list[list[Any]] = []
        for value, mesh in self.frames:
            centres = mesh.points[mesh.cells[0].data].mean(axis=1)
            means = [np.asarray(mesh.cell_data[name][0]) for name in self.names]
            rows += [[value, *row] for row in np.column_stack([centres[:, :2], *means]).tolist()]
        known = {"x": FIELD["position"], "y": FIELD["height"]} | FIELD
        heads = {name: known.get(name, WORD) for name in (self.parameter, "x", "y", *self.names)}
        return TableSpec("", heads, rows).to_dataframe()

    def to_vtk(self, directory: str | Path) -> Path:
        """Write VTU files with a PVD collection of ParaView.

        Parameters
        ----------
        directory : str or Path
            Directory of fields.pvd; created where it is missing.

        Returns
        -------
        Path
            The collection.
        """
        *_, collection = write_vtu_series(Path(directory) / "fields.pvd", "fields", self.parameter, self.frames)
        return collection

    def picture(self, path: str | Path, field: str | None = None, frame: int = 0) -> Path:
        """Write a picture of one field of the displaced layer as PNG.

        Parameters
        ----------
        path : str or Path
            PNG file.
        field : str, optional
            Name of the field; the density ratio, or the pressure of a linear layer, by default.
        frame : int
            Number of the mesh.

        Returns
        -------
        Path
            The file.
        """
        return write_figure(Path(path), self._drawn(field, frame))

    def _drawn(self, field: str | None = None, frame: int = 0) -> "Figure":
        from compact.report.contact_figures import draw_picture

        return draw_picture(self.frames[frame][1], self.contacts[frame] if self.contacts else None, field)

    def __repr__(self) -> str:
        cells = sum(len(block.data) for block in self.mesh.cells)
        frames = f", {len(self.frames)} frames" if len(self.frames) > 1 else ""
        return f"<fields {', '.join(self.names)} on {cells} elements{frames}>"

    def _repr_png_(self) -> bytes:
        return render_png(self._drawn())


def read_fields(path: str | Path) -> Fields:
    """Read fields that `compact` or another program has written.

    Parameters
    ----------
    path : str or Path
        PVD collection, VTU file, or any other mesh that meshio reads.

    Returns
    -------
    Fields

    Raises
    ------
    ValueError
        If the file is no such mesh.
    """
    require_instance((str, PathLike), "the path of a file", path=path)
    path = Path(path)
    if path.suffix.lower() == ".pvd":
        parameter, frames = read_vtu_series(path)
        return Fields(frames, parameter)
    import meshio

    try:
        return Fields(((0.0, meshio.read(path)),))
    except (OSError, SystemExit, meshio.ReadError) as error:
        raise ValueError(f"{path}: not a mesh that meshio reads ({error}); give a PVD or VTU file") from None
