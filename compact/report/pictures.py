"""Pictures of the fields inside the layer by pyvista, rendered off screen, and their view in a notebook.

pyvista is optional: `pip install 'compact[view]'`. VTK 9.4 and later renders without a display by EGL, or by OSMesa
where the system has its library. Without either library VTK ends the process, so that a command renders last.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from compact.files import ResultsError, write_bytes
from compact.quantities import FIELD

if TYPE_CHECKING:
    import meshio
    import pyvista

COLOURS = {"pressure": "viridis", "dissipation": "magma", "density_ratio": "cividis", "plastic_work": "magma"}
PREFERRED_FIELDS = ("density_ratio", "pressure")  # shown unless another is named
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
SIZE = (1600, 760)  # [pixel], width and height of a picture
SHOWN_CONTACTS = 2.2  # [-], contact lengths shown on each side of the roller
ROLLER_SIDES = 720  # [-], of the polygon that is drawn as the roller
DEPTH_SHARE, ABOVE_SHARE = 0.55, 0.25  # [-], shown below and above the lowest generatrix over the half-width
FRONT = 1e-4  # [m], of roller and strip before the layer
STRIP_SHARE = 0.16  # [-], of the height, below the layer for the colour scale
OUTLINE_NODES = [0, 4, 1, 5, 2, 6, 3, 7]  # of a quadrilateral with nodes on its sides, in order
TICKS = 8  # [-], intervals of the colour scale at most
CORNERS = 4  # [-], nodes of a quadrilateral without nodes on its sides

Window = tuple[float, float, float, float]


def require_picture(path: Path, engine: Any) -> None:
    """Require pyvista, a format of pictures and an engine with fields, before anything is computed.

    Parameters
    ----------
    path : Path
        File of the picture.
    engine : Engine
        Engine of the contact.

    Raises
    ------
    ValueError
        If the format is unknown, or the engine has no fields.
    ResultsError
        If pyvista is not installed.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"--picture takes a file that ends in {', '.join(SUFFIXES)}, got {path.name!r}")
    if not engine.has_fields:
        raise ValueError(
            f"--picture: the engine {engine.name} computes no fields inside the layer; choose fem or compaction"
        )
    _pyvista()


def displaced_grid(mesh: "meshio.Mesh") -> "pyvista.UnstructuredGrid":
    """Convert a mesh with fields to a pyvista grid of the displaced layer.

    Parameters
    ----------
    mesh : meshio.Mesh
        Mesh with the point data "displacement" [m], as an engine returns it or as read from VTU.

    Returns
    -------
    pyvista.UnstructuredGrid
        Grid with all data of the mesh; its points are displaced.
    """
    grid = _pyvista().from_meshio(mesh)
    if "displacement" in grid.point_data:
        grid.points = grid.points + grid.point_data["displacement"]
    return grid


def render_fields(
    mesh: "meshio.Mesh",
    contact: Any = None,
    *,
    field: str | None = None,
    size: Sequence[int] = SIZE,
) -> Any:
    """Render one field of the displaced layer, to scale.

    Parameters
    ----------
    mesh : meshio.Mesh
        Mesh with displacement and element means.
    contact : Contact, optional
        Contact whose roller is drawn, and around which the layer is shown; the whole layer without one.
    field : str, optional
        Name of the field; the density ratio, or the pressure of a linear layer, by default.
    size : sequence of int
        Width and height [pixel].

    Returns
    -------
    ndarray, shape (height, width, 3)
        Colours of the picture [0-255].

    Raises
    ------
    ValueError
        If the mesh has no such field.
    """
    pyvista = _pyvista()
    name = shown_field(mesh, field)
    layer, (left, right, low, high) = _elements(mesh, name), _window(mesh, contact)
    width, height = right - left, high - low
    x, y, _ = layer.cell_centers().points.T
    values = layer.cell_data["shown"][(x > left) & (x < right) & (y > low)]
    ticks = MaxNLocator(TICKS).tick_values(float(values.min()), float(values.max()))  # round, over the shown elements
    below = [(left - width, low - height, FRONT), (right + width, low - height, FRONT), (left - width, low, FRONT)]
    with pyvista.vtk_verbosity("off"):  # without a display VTK warns before it renders by EGL
        plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
        plotter.set_background("white")
        drawn = plotter.add_mesh(
            layer, scalars="shown", cmap=COLOURS.get(name, "viridis"), clim=(ticks[0], ticks[-1]), show_edges=True,
            edge_opacity=0.15, line_width=0.5, lighting=False, show_scalar_bar=False,
        )  # fmt: skip
        plotter.add_mesh(pyvista.Rectangle(below), color="white", lighting=False)  # hides the layer below the window
        if contact is not None:
            radius = contact.roller.radius
            centre = (0.0, contact.layer.height - contact.indentation + radius, FRONT)
            disc = {"center": centre, "inner": 0.0, "outer": radius, "normal": (0, 0, 1), "c_res": ROLLER_SIDES}
            roller = pyvista.Disc(r_res=1, **disc)
            plotter.add_mesh(roller, color="#e9e9e9", lighting=False)
            plotter.add_mesh(roller.extract_feature_edges(), color="#444444", line_width=2.5, lighting=False)
        plotter.add_scalar_bar(
            FIELD[name].axis_label if name in FIELD else name, mapper=drawn.mapper, color="black", title_font_size=28,
            label_font_size=24, n_labels=len(ticks), fmt="%.4g", font_family="arial", width=0.56, height=0.09,
            position_x=0.22, position_y=0.015,
        )  # fmt: skip
        scale = min(size[0] / width, (1 - STRIP_SHARE) * size[1] / height)  # [pixel/m]
        half = 0.5 * size[1] / scale
        middle = 0.5 * (left + right), low - STRIP_SHARE * size[1] / scale + half
        plotter.view_xy()
        plotter.enable_parallel_projection()
        plotter.camera.focal_point, plotter.camera.position = (*middle, 0.0), (*middle, 1.0)
        plotter.camera.parallel_scale = half
        picture = plotter.screenshot(return_img=True)
        plotter.close()
    return picture


def write_picture(path: Path, mesh: "meshio.Mesh", contact: Any = None, field: str | None = None) -> Path:
    """Write a picture of one field of the displaced layer; return the path.

    Parameters
    ----------
    path : Path
        File, whose suffix is one of `SUFFIXES`.
    mesh, contact, field
        As of `render_fields`.
    """
    return write_bytes(path, encode_picture(render_fields(mesh, contact, field=field), path.suffix))


def encode_picture(colours: Any, suffix: str = ".png") -> bytes:
    """Encode the colours of a picture in the format of a suffix."""
    from io import BytesIO

    from PIL import Image

    stream = BytesIO()
    image = Image.fromarray(colours)
    image.save(stream, format=Image.registered_extensions()[suffix.lower()])
    return stream.getvalue()


def shown_field(mesh: "meshio.Mesh", field: str | None = None) -> str:
    """Return the name of the field to show.

    Raises
    ------
    ValueError
        If the mesh has no field of that name, or none at all.
    """
    known = [name for name, values in mesh.cell_data.items() if np.ndim(values[0]) == 1]
    found = [name for name in ((field,) if field else (*PREFERRED_FIELDS, *known)) if name in known]
    if not found:
        raise ValueError(f"the layer has the fields {', '.join(known) or 'none'}, got {field!r}")
    return found[0]


def _elements(mesh: "meshio.Mesh", name: str) -> "pyvista.PolyData":
    """Return the displaced elements as polygons, with the values of a field in the unit of plots."""
    points = mesh.points + mesh.point_data.get("displacement", 0.0)
    nodes = mesh.cells[0].data
    nodes = nodes[:, OUTLINE_NODES] if nodes.shape[1] > CORNERS else nodes
    layer = _pyvista().PolyData(points, faces=np.insert(nodes, 0, nodes.shape[1], axis=1).ravel())
    factor = FIELD[name].plot_factor if name in FIELD else 1.0
    layer.cell_data["shown"] = np.asarray(mesh.cell_data[name][0]) * factor
    return layer


def _window(mesh: "meshio.Mesh", contact: Any) -> Window:
    """Return the shown range: smallest and largest x, lowest and highest y [m]."""
    points = mesh.points + mesh.point_data.get("displacement", 0.0)
    (left, low), (right, high) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    if contact is None:
        return left, right, low, high
    reach = SHOWN_CONTACTS * (contact.leading - contact.trailing)
    surface = contact.layer.height - contact.indentation
    return max(left, -reach), min(right, reach), max(low, surface - DEPTH_SHARE * reach), surface + ABOVE_SHARE * reach


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise ResultsError(f"pictures need pyvista ({error}); install it: pip install 'compact[view]'") from None
    return pyvista
