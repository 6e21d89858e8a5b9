"""Fields of a contact in formats of other programs, by meshio.

    write_fields(study.stages.contacts.field_mesh(contact), "fields.msh", "gmsh")

| format | file | program |
|---|---|---|
| vtu | XML | ParaView, pyvista |
| vtk | VTK legacy | VisIt, Mayavi |
| xdmf | XML, one file | ParaView, FEniCS |
| gmsh | MSH 2.2, stresses as full tensors | Gmsh |
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from compact.files import atomic_file

if TYPE_CHECKING:
    import meshio

# Suffix, format of meshio, and its options
FIELD_FORMATS: Mapping[str, tuple[str, str, dict[str, Any]]] = MappingProxyType(
    {
        "vtu": (".vtu", "vtu", {}),
        "vtk": (".vtk", "vtk", {}),
        "xdmf": (".xdmf", "xdmf", {"data_format": "XML"}),  # otherwise a second file holds the numbers
        "gmsh": (".msh", "gmsh22", {}),
    }
)
FULL_TENSOR = (0, 3, 5, 3, 1, 4, 5, 4, 2)  # components xx, yy, zz, xy, yz, xz by row of the tensor


def write_fields(mesh: "meshio.Mesh", path: Path | str, name: str) -> Path:
    """Write a mesh with its fields.

    Parameters
    ----------
    mesh : meshio.Mesh
        Mesh with fields; it is not changed.
    path : path
        File.
    name : {"vtu", "vtk", "xdmf", "gmsh"}
        Format.

    Returns
    -------
    Path
        The path.
    """
    import meshio

    _, kind, options = FIELD_FORMATS[name]
    if name == "gmsh":  # which admits 1, 3 or 9 components, and requires a tag for each cell
        tags = [[1] * len(block.data) for block in mesh.cells]
        cells: dict[str, Any] = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        for key, blocks in mesh.cell_data.items():
            cells[key] = [each[:, FULL_TENSOR] if each.ndim == 2 and each.shape[1] == 6 else each for each in blocks]
        mesh = meshio.Mesh(mesh.points, mesh.cells, mesh.point_data, cells)
    with atomic_file(path, "wb") as stream:  # meshio opens the file by its name
        meshio.write(stream.name, mesh, file_format=kind, **options)
    return Path(path)
