"""Workshop drawing of a cam, and its files.

The drawing is a DXF document of ezdxf in millimetres, x to the right, y up, on the layers of `LAYERS`; its dimensions
are DIMENSION entities, whose number a CAD program measures from the geometry. Its SVG shows the same entities.

Notes
-----
The SVG is written here, not by the drawing add-on of ezdxf. The add-on converts text to outlines of glyphs, so that it
can be neither searched nor read aloud; it loses the names of the layers; and it rounds coordinates to the page width
over 10^6, 2 um on a cam of 1 m, more than the tolerance of the profile. Its files are seven times as large.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.cams.machining import MICROMETRE, Cut, cut, largest_cutter
from compact.cams.profile import Cam
from compact.files import write_bytes, write_csv
from compact.numerics import Array

if TYPE_CHECKING:
    from ezdxf.document import Drawing

MM = 1e3  # [mm/m]
LINE_SPACING = 1.7  # [-], over the height of a letter
LETTERS_PER_RADIUS = 38  # [-], heights of a letter in the largest radius
COORDINATE_DECIMALS = 6  # [-], of a length in mm: a nanometre
LETTER_WIDTH = 0.85  # [-], of the height of a capital: estimate of the width of text
FONT_SIZE = 1.35  # [-], of the height of a capital, which is 0.74 of the font size
MARGIN = 0.02  # [-], of the larger side of the drawing, left free around it
CIRCLE_SAGITTA = 0.05  # [mm], of the chords of a circle in SVG
LINE_TYPE_SCALE = 0.04  # [-], of the largest radius in mm: $LTSCALE of DXF
BY_LAYER, NO_TRAILING_ZEROS = 256, 8  # codes of DXF: colour of the layer, DIMZIN
# Sizes of a dimension over the height of its text [-]: text, arrow, extension lines and their offset, gap
DIMENSION_SIZES = {"dimtxt": 1.0, "dimasz": 0.9, "dimexe": 0.5, "dimexo": 0.4, "dimgap": 0.35}
# Style of all dimensions: colours of the layer, micrometres, text above the line
DIMENSION_STYLE = dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), BY_LAYER) | {
    "dimdec": 3, "dimdsep": ord("."), "dimzin": NO_TRAILING_ZEROS, "dimtad": 1,
}  # fmt: skip
# Layers: colour in SVG and in DXF (ACI), line width over the height of a letter [-], dashes and gaps in SVG over the
# line width [-], line type in DXF
LAYERS: Mapping[str, tuple[str, int, float, tuple[int, ...], str]] = {
    "PROFILE": ("#000000", 7, 0.19, (), "CONTINUOUS"),
    "CUTTER": ("#b3261e", 1, 0.095, (8, 4), "DASHED"),
    "FOLLOWER": ("#1f5fa8", 5, 0.095, (4, 3), "DASHED"),
    "CENTRE": ("#6b6b6b", 8, 0.065, (12, 3, 2, 3), "CENTER"),
    "BORE": ("#000000", 7, 0.13, (), "CONTINUOUS"),
    "DIMENSIONS": ("#3a3a3a", 3, 0.065, (), "CONTINUOUS"),
    "NOTES": ("#000000", 7, 0.065, (), "CONTINUOUS"),
}


@dataclass(frozen=True)
class WorkshopDrawing:
    """Drawing of a cam.

    Attributes
    ----------
    title, description : str
        Title, and description in one sentence for screen readers.
    document : ezdxf.document.Drawing
        Entities in the model space, lengths and coordinates in mm.
    letter : float
        Height of a letter [mm].
    """

    title: str
    description: str
    document: "Drawing"
    letter: float

    def dxf(self) -> str:
        """Return the drawing as DXF text, units millimetres."""
        text = StringIO()
        self.document.write(text)
        return text.getvalue()

    def svg(self) -> str:
        """Return the drawing as SVG text, true to scale, one unit a millimetre."""
        from ezdxf.disassemble import recursive_decompose  # 0.3 s

        found = [
            _svg_shape(part, entity.dxf.layer, self.letter)
            for entity in self.document.modelspace()
            for part in recursive_decompose([entity])  # of a dimension: lines, text, arrows
            if part.dxftype() != "POINT"  # a measured point, not drawn
        ]
        corners = np.concatenate([points for points, _ in found])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = MARGIN * (high - low).max()
        (left, bottom), (width, height) = low - margin, high - low + 2 * margin
        view = f'viewBox="{left:.6f} {-bottom - height:.6f} {width:.6f} {height:.6f}"'
        size = f'width="{width:.6f}mm" height="{height:.6f}mm" {view} role="img" aria-labelledby="title desc"'
        words = f'<title id="title">{escape(self.title)}</title><desc id="desc">{escape(self.description)}</desc>'
        shapes = "\n".join(shape for _, shape in found)
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{words}\n{shapes}\n</svg>\n'


def _svg_shape(entity: Any, layer: str, letter: float) -> tuple[Array, str]:
    """Corners [mm] and SVG of a simple entity; a solid is filled."""
    from ezdxf.path import make_path

    kind, dxf, (colour, _, share, dashes, _) = entity.dxftype(), entity.dxf, LAYERS[layer]
    if kind not in ("TEXT", "MTEXT"):
        path, line = make_path(entity), share * letter
        points = np.array([(x, y) for x, y, _ in path.flattening(CIRCLE_SAGITTA)])[: -1 if path.is_closed else None]
        pairs = " ".join(f"{x!r},{-y!r}" for x, y in points.round(COORDINATE_DECIMALS).tolist())
        lengths = " ".join(f"{each * line:.3f}" for each in dashes) or "none"
        style = f'fill="{colour if kind == "SOLID" else "none"}" stroke="{colour}" stroke-dasharray="{lengths}"'
        tag = "polygon" if path.is_closed else "polyline"
        return points, f'<{tag} class="{layer}" {style} stroke-width="{line:.3f}" points="{pairs}"/>'
    words, height = (dxf.text, dxf.height) if kind == "TEXT" else (entity.plain_text(), dxf.char_height)
    (x, y, _), turn, width = dxf.insert, "", LETTER_WIDTH * height * len(words)
    corners = np.array([[x, y], [x + width, y + height]])
    if kind == "MTEXT":  # of a dimension: centred, along its line
        corners = np.array([[x, y]]) + width / 2 * np.array([[-1], [1]])
        turned = f"rotate({-dxf.rotation:.6f} {x:.6f} {-y:.6f})"
        turn = f' text-anchor="middle" dominant-baseline="central" transform="{turned}"'
    place = f'x="{x:.6f}" y="{-y:.6f}" font-size="{FONT_SIZE * height:.6f}"{turn}'
    return corners, f'<text class="{layer}" font-family="sans-serif" {place}>{escape(words)}</text>'


def workshop_drawing(cut: Cut, bore: float | None = None) -> WorkshopDrawing:
    """Return the drawing of a cut with its dimensions and a bore of a diameter [m]."""
    import ezdxf  # 0.3 s

    cam, (radius, _) = cut.cam, MM * cut.polar
    if bore is not None and not 0 < bore < 2 * radius.min() / MM:
        raise ValueError(
            f"`bore` must be positive and below {2 * radius.min() / MM:.6g} m, the smallest diameter of the cam, "
            f"got {bore:g} m; use a smaller bore or a broader cam"
        )
    document = ezdxf.new("R2010", setup=["linetypes"], units=ezdxf.units.MM)
    document.header["$LTSCALE"] = LINE_TYPE_SCALE * radius.max()
    for name, (_, colour, _, _, line_type) in LAYERS.items():
        document.layers.add(name, color=colour, linetype=line_type)
    letter = float(radius.max()) / LETTERS_PER_RADIUS
    _draw(document.modelspace(), cut, bore, letter)
    title = f"cam for the law {cam.cycle.forward.name}, {cam.follower.words}"
    rows = (title, "", *_notes(cut))
    left, top = MM * float(cut.profile[:, 0].max() + 2 * cam.follower.radius) + 10 * letter, float(radius.max())
    for i, words in enumerate(rows):
        place = {"insert": (left, top - LINE_SPACING * letter * i), "layer": "NOTES"}
        document.modelspace().add_text(words, height=letter, dxfattribs=place)
    sizes = f"radius from {radius.min():.1f} to {radius.max():.1f} mm about the axis, breadth {MM * cam.breadth:.1f} mm"
    return WorkshopDrawing(title, f"profile of the {title}: {sizes}", document, letter)


def _draw(space: Any, cut: Cut, bore: float | None, letter: float) -> None:
    """Draw polygons, circles and centre lines, with the dimensions of breadth, radii, bore and roller."""
    cam, r, (radius, _) = cut.cam, MM * cut.cam.follower.radius, MM * cut.polar
    right, left = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
    path = (cam.radius(cut.angle) * np.array([np.cos(cut.angle), np.sin(cut.angle)])).T if r else None
    for layer, points in (("PROFILE", cut.profile), ("CUTTER", cut.cutter_path), ("FOLLOWER", path)):
        if points is not None:
            space.add_lwpolyline(np.round(MM * points, COORDINATE_DECIMALS), close=True, dxfattribs={"layer": layer})
    beyond = 3 * letter + 2 * r
    low, high = MM * cut.profile.min(axis=0) - beyond, MM * cut.profile.max(axis=0) + beyond
    for ends in (((low[0], 0.0), (high[0], 0.0)), ((0.0, low[1]), (0.0, high[1]))):
        space.add_line(*ends, dxfattribs={"layer": "CENTRE"})
    space.add_text("0°", height=letter, dxfattribs={"layer": "DIMENSIONS", "insert": (high[0], 0.3 * letter)})

    style = {name: share * letter for name, share in DIMENSION_SIZES.items()} | DIMENSION_STYLE
    shared = {"dimstyle": "Standard", "override": style, "dxfattribs": {"layer": "DIMENSIONS"}}
    farthest = tuple((MM * cut.profile[radius.argmax()]).tolist())
    below = MM * float(cut.profile[:, 1].min()) - 6 * letter
    for start, end, offset, prefix in (
        ((left, 0.0), (right, 0.0), below, "b = "),
        (*sorted([(0.0, 0.0), farthest]), 4 * letter, "R"),  # text from left to right
    ):
        space.add_aligned_dim(p1=start, p2=end, distance=offset, text=f"{prefix}<>", **shared).render()
    circles = [(0.0, float(radius.min()), "CENTRE", space.add_radius_dim, -110.0)]  # dimension and its angle [deg]
    if bore is not None:
        circles.append((0.0, MM * bore / 2, "BORE", space.add_diameter_dim, -45.0))
    if r:
        circles += [(right, r, "FOLLOWER", space.add_radius_dim, 60.0), (left, r, "FOLLOWER", None, 0.0)]
    for centre, size, layer, dimension, angle in circles:
        space.add_circle((centre, 0.0), size, dxfattribs={"layer": layer})
        if dimension is not None:
            x, y = (size + 3 * letter) * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
            dimension(center=(centre, 0.0), radius=size, angle=angle, location=(x + centre, y), **shared).render()


def _notes(cut: Cut) -> Iterator[str]:
    """Yield notes that the dimensions do not state, one line each."""
    cam, cutter = cut.cam, largest_cutter(cut.cam)
    yield "lengths in mm; the cam turns clockwise, the forward stroke begins at 0°"
    yield f"b between the followers, of rollers between their centres; stroke {MM * cam.cycle.forward.stroke:.3f}"
    yield f"profile of {len(cut.angle)} points: the follower deviates by {MM * cut.error:.5f} at most"
    if cam.follower.name == "flat":
        yield f"faces reach {MM * cam.largest_contact_offset:.3f} to each side at least"
    if cut.cutter_radius is not None:
        yield f"cutter: radius {MM * cut.cutter_radius:g}, path of its centre dashed red"
    fits = f"cutter radius up to {np.floor(100 * MM * cutter) / 100:.2f}"
    yield "cutter of any radius fits: no concave parts" if np.isinf(cutter) else fits


def write_cam_files(
    directory: str | Path,
    cam: Cam,
    cutter_radius: float | None = None,
    tolerance: float = MICROMETRE,
    bore: float | None = None,
) -> list[Path]:
    """Write the points of a cam as CSV, in mm and degrees, and its drawing as SVG and DXF.

    Parameters
    ----------
    directory : str or Path
        Folder of the files.
    cam : Cam
        Cam.
    cutter_radius : float, optional
        Radius of the cutter [m].
    tolerance : float
        Tolerance of the points [m].
    bore : float, optional
        Diameter of the bore [m].

    Returns
    -------
    list of Path
        Files written.
    """
    outline = cut(cam, cutter_radius, tolerance)
    drawing, stem = workshop_drawing(outline, bore), Path(directory) / f"{cam.cycle.forward.name}-{cam.follower.name}"
    (x, y), (radius, polar) = MM * outline.profile.T, outline.polar
    columns = {
        "cam_angle_deg": np.degrees(outline.angle), "follower_mm": MM * cam.radius(outline.angle), "x_mm": x, "y_mm": y,
        "radius_mm": MM * radius, "polar_angle_deg": np.degrees(polar),
    }  # fmt: skip
    if outline.cutter_path is not None:
        columns["cutter_x_mm"], columns["cutter_y_mm"] = MM * outline.cutter_path.T
    points = write_csv(Path(f"{stem}.csv"), tuple(columns), np.column_stack([*columns.values()]).tolist())
    texts = {".svg": drawing.svg(), ".dxf": drawing.dxf()}
    return [points, *(write_bytes(Path(f"{stem}{ending}"), text.encode()) for ending, text in texts.items())]
