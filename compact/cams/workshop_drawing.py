"""Workshop drawing of a cam and its files: outlines, dimensions, sizes, key angles and points, in millimetres.

A `Drawing` collects shapes on named layers, x to the right, y up, and writes them as SVG true to scale and as DXF for
CAD programs. `LAYERS` defines colour and line of each layer. Dimensions are lines and text in SVG, DIMENSION entities
in DXF, whose number a CAD program measures from the geometry.

Notes
-----
The SVG is written here, not by the drawing add-on of ezdxf. The add-on converts text to outlines of glyphs, so that it
can be neither searched nor read aloud; it loses the names of the layers; and it rounds coordinates to the page width
over 10^6, 2 um on a cam of 1 m, more than the tolerance of the profile. Its files are seven times as large.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from compact.cams.animation import animated_svg
from compact.cams.machining import MICROMETRE, Cut, cut, largest_cutter
from compact.cams.profile import Cam, FlatFace, Follower, Pointed, ProfileTable, breadth_for_pressure_angle
from compact.files import write_bytes, write_csv
from compact.numerics import Array

if TYPE_CHECKING:
    from compact.scene.loader import Scene

Point = tuple[float, float]
Row = Sequence[str]

MM = 1e3  # [mm/m]
TABLE_ROWS = 36  # [-], of the table of points on the drawing, at equal cam angles
TABLE_COLUMNS = (0, 5, 12, 19)  # [-], columns of the table of points, in letters from its left
TABLE_WIDTH = 26  # [-], of half the table, in letters
NOTE_COLUMNS = (0, 8, 16)  # [-], columns of the notes, in letters from the left
LINE_SPACING = 1.7  # [-], over the height of a letter
LETTERS_PER_RADIUS = 38  # [-], heights of a letter in the largest radius
GUIDE_PRESSURE_ANGLE = np.radians(30.0)  # [rad], at which a sliding follower does not jam; rule of thumb
COORDINATE_DECIMALS = 6  # [-], of a length in mm: a nanometre
DIMENSION_DECIMALS = 3  # [-], of the number of a dimension in mm: a micrometre
LETTER_WIDTH = 0.85  # [-], of the height of a capital: estimate of the width of text
FONT_SIZE = 1.35  # [-], of the height of a capital, which is 0.74 of the font size
MARGIN = 0.02  # [-], of the larger side of the drawing, left free around it
LINE_TYPE_SCALE = 0.01  # [-], of the width of the drawing in mm: $LTSCALE of DXF
DIMENSION_LAYER = "DIMENSIONS"
BY_LAYER, NO_TRAILING_ZEROS = 256, 8  # codes of DXF: colour of the layer, DIMZIN
# Sizes of a DXF dimension over the height of its text [-]: text, arrow, extension lines and their offset, gap
DIMENSION_SIZES = MappingProxyType({"dimtxt": 1.0, "dimasz": 0.9, "dimexe": 0.5, "dimexo": 0.4, "dimgap": 0.35})


@dataclass(frozen=True)
class LayerStyle:
    """Look of a layer.

    Attributes
    ----------
    colour : str
        Colour in SVG.
    colour_index : int
        Colour in DXF (ACI).
    width : float
        Line width over the width of the drawing [-].
    dashes : tuple of float
        Lengths of dashes and gaps in SVG over the line width [-].
    line_type : str
        Line type in DXF.
    """

    colour: str
    colour_index: int
    width: float
    dashes: tuple[float, ...] = ()
    line_type: str = "CONTINUOUS"


LAYERS: Mapping[str, LayerStyle] = MappingProxyType(
    {
        "PROFILE": LayerStyle("#000000", 7, 1 / 700),
        "CUTTER": LayerStyle("#b3261e", 1, 1 / 1400, (8, 4), "DASHED"),
        "FOLLOWER": LayerStyle("#1f5fa8", 5, 1 / 1400, (4, 3), "DASHED"),
        "CENTRE": LayerStyle("#6b6b6b", 8, 1 / 2000, (12, 3, 2, 3), "CENTER"),
        "BORE": LayerStyle("#000000", 7, 1 / 1000),
        DIMENSION_LAYER: LayerStyle("#3a3a3a", 3, 1 / 2000),
        "NOTES": LayerStyle("#000000", 7, 1 / 2000),
    }
)


class Drawing:
    """Drawing, to which shapes are added: lengths and coordinates (x, y) in mm, layers by their name in `LAYERS`.

    Parameters
    ----------
    title : str
        Title of the SVG.
    """

    def __init__(self, title: str) -> None:
        self.title = title
        self._corners = list[Array]()  # whose bounding box contains the shapes
        self._svg = list[str]()
        self._dxf = list[tuple[str, dict[str, Any]]]()  # method of a DXF model space, and its arguments

    def polygon(self, points: Array, layer: str) -> None:
        """Add a closed polygon, shape (n, 2)."""
        pairs = " ".join(f"{_number(x)},{_number(-y)}" for x, y in points)
        self._add(points, f'<polygon class="{layer}" points="{pairs}"/>')
        self._add_dxf("add_lwpolyline", {"layer": layer}, points=np.round(points, COORDINATE_DECIMALS), close=True)

    def circle(self, centre: Point, radius: float, layer: str) -> None:
        """Add a circle."""
        place = f'cx="{_number(centre[0])}" cy="{_number(-centre[1])}"'
        corners = np.add(centre, radius * np.array([[-1, -1], [1, 1]]))
        self._add(corners, f'<circle class="{layer}" {place} r="{_number(radius)}"/>')
        self._add_dxf("add_circle", {"layer": layer}, center=centre, radius=radius)

    def line(self, start: Point, end: Point, layer: str) -> None:
        """Add a straight line."""
        self._add([start, end], _svg_line(start, end, layer))
        self._add_dxf("add_line", {"layer": layer}, start=start, end=end)

    def text(self, place: Point, text: str, height: float, layer: str = "NOTES") -> None:
        """Add a line of text from the left end of its base line, with a height of a capital."""
        self._add(_text_corners(place, text, height), _svg_text(place, text, height, layer))
        self._add_dxf("add_text", {"layer": layer, "insert": place}, text=text, height=height)

    def distance(self, start: Point, end: Point, offset: float, height: float, prefix: str = "") -> None:
        """Add the dimension of a distance, its line at an offset to the left, and a text before its number."""
        along = np.subtract(end, start) / np.hypot(*np.subtract(end, start))
        across = np.array([-along[1], along[0]])
        first, last = start + offset * across, end + offset * across
        beyond, tick = 0.5 * height * np.sign(offset) * across, 0.3 * height * (along + across)
        lines: list[tuple[Any, Any]] = [(first, last), (start, first + beyond), (end, last + beyond)]
        lines += [(each - tick, each + tick) for each in (first, last)]
        text = f"{prefix}{_number(np.hypot(*(last - first)), DIMENSION_DECIMALS)}"
        place = (first + last) / 2 - [LETTER_WIDTH * height * len(text) / 2, -height / 2]
        drawn = [_svg_line(*each, DIMENSION_LAYER) for each in lines]
        svg = "".join([*drawn, _svg_text(place, text, height, DIMENSION_LAYER)])
        self._add([start, end, first - 2 * height, last + 2 * height], svg)
        self._add_dimension("add_aligned_dim", height, p1=start, p2=end, distance=offset, text=f"{prefix}<>")

    def radius(self, centre: Point, radius: float, angle: float, height: float, diameter: bool = False) -> None:
        """Add the dimension of a radius or a diameter, on an arrow outwards at an angle [rad]."""
        ray = np.array([np.cos(angle), np.sin(angle)])
        start, end = centre + (-radius if diameter else 0.0) * ray, centre + (radius + height) * ray
        sign, size = ("Ø", 2 * radius) if diameter else ("R", radius)
        text = f"{sign}{_number(size, DIMENSION_DECIMALS)}"
        left = LETTER_WIDTH * height * len(text) * (ray[0] < 0)  # beyond the end of the arrow
        place = float(end[0] - left), float(end[1] - height * (ray[1] < 0))
        svg = _svg_line(start, end, DIMENSION_LAYER) + _svg_text(place, text, height, DIMENSION_LAYER)
        self._add([start, end, *_text_corners(place, text, height)], svg)
        method, angle = "add_diameter_dim" if diameter else "add_radius_dim", np.degrees(angle)
        self._add_dimension(method, height, center=centre, radius=radius, angle=angle, location=place)

    def rows(self, rows: Sequence[Row], left: float, top: float, letter: float, columns: Sequence[float]) -> None:
        """Add rows of text, their parts at `columns`, in letters from the left."""
        for i, row in enumerate(rows):
            for start, part in zip(columns, row, strict=False):
                self.text((left + letter * start, top - LINE_SPACING * letter * i), part, letter)

    def bounding_box(self) -> tuple[float, float, float, float]:
        """Return (left, bottom, right, top) [mm] of all shapes with a margin."""
        corners = np.concatenate(self._corners)
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = MARGIN * (high - low).max()
        return (*(low - margin), *(high + margin))

    def svg(self, description: str = "") -> str:
        """Return the drawing as SVG text with a description, true to scale, one unit a millimetre."""
        left, bottom, right, top = self.bounding_box()
        width, height = right - left, top - bottom
        words = f'<title id="title">{escape(self.title)}</title><desc id="desc">{escape(description)}</desc>'
        size = f'width="{_number(width)}mm" height="{_number(height)}mm"'
        view = f'viewBox="{_number(left)} {_number(-top)} {_number(width)} {_number(height)}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {view} role="img" aria-labelledby="title desc">'
        shapes = "\n".join(self._svg)
        return f"{head}\n{words}\n<style>{_style_sheet(width)}</style>\n{shapes}\n</svg>\n"

    def dxf(self) -> str:
        """Return the drawing as DXF text, units millimetres."""
        import ezdxf  # 0.3 s, not needed for SVG

        document = ezdxf.new("R2010", setup=["linetypes"], units=ezdxf.units.MM)
        for name, layer in LAYERS.items():
            document.layers.add(name, color=layer.colour_index, linetype=layer.line_type)
        left, _, right, _ = self.bounding_box()
        document.header["$LTSCALE"] = LINE_TYPE_SCALE * (right - left)
        for method, arguments in self._dxf:
            entity = getattr(document.modelspace(), method)(**arguments)
            if method.endswith("_dim"):
                entity.render()
        text = StringIO()
        document.write(text)
        return text.getvalue()

    def _add(self, corners: Any, svg: str) -> None:
        self._corners.append(np.asarray(corners, float))
        self._svg.append(svg)

    def _add_dxf(self, method: str, attributes: dict[str, Any], **arguments: Any) -> None:
        self._dxf.append((method, {**arguments, "dxfattribs": attributes}))

    def _add_dimension(self, method: str, height: float, **arguments: Any) -> None:
        """Add a DXF dimension with the variables of its look for a height of text [mm]."""
        style = {name: share * height for name, share in DIMENSION_SIZES.items()}
        style |= dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), BY_LAYER)
        style |= {"dimdec": DIMENSION_DECIMALS, "dimdsep": ord("."), "dimzin": NO_TRAILING_ZEROS, "dimtad": 1}
        self._add_dxf(method, {"layer": DIMENSION_LAYER}, **arguments, dimstyle="Standard", override=style)


def _svg_line(start: ArrayLike, end: ArrayLike, layer: str) -> str:
    (x1, y1), (x2, y2) = np.asarray(start), np.asarray(end)
    ends = f'x1="{_number(x1)}" y1="{_number(-y1)}" x2="{_number(x2)}" y2="{_number(-y2)}"'
    return f'<line class="{layer}" {ends}/>'


def _svg_text(place: ArrayLike, text: str, height: float, layer: str) -> str:
    x, y = np.asarray(place)
    at = f'x="{_number(x)}" y="{_number(-y)}" font-size="{_number(FONT_SIZE * height)}"'
    return f'<text class="{layer}" {at}>{escape(text)}</text>'


def _text_corners(place: Point, text: str, height: float) -> list[Point]:
    x, y = place
    return [place, (x + LETTER_WIDTH * height * len(text), y + height)]


def _style_sheet(width: float) -> str:
    """Style of the layers in a drawing of a width [mm]."""
    rules = ["text{fill:#000;stroke:none;font-family:sans-serif}", "polygon,circle,line{fill:none}"]
    for name, layer in LAYERS.items():
        line = layer.width * width
        dashes = f";stroke-dasharray:{' '.join(_number(dash * line) for dash in layer.dashes)}" if layer.dashes else ""
        rules.append(f".{name}{{stroke:{layer.colour};stroke-width:{_number(line)}{dashes}}}")
    return "".join([*rules, "text.NOTES,text.DIMENSIONS{stroke:none}"])


def _number(value: float, decimals: int = COORDINATE_DECIMALS) -> str:
    return f"{value:.{decimals}f}".rstrip("0").rstrip(".")


def workshop_drawing(cut: Cut, bore: float | None = None) -> Drawing:
    """Return the drawing of a cut with its dimensions and a bore of a diameter [m]."""
    smallest = float(np.hypot(*cut.profile.T).min())
    if bore is not None and not 0 < bore < 2 * smallest:
        raise ValueError(
            f"`bore` must be positive and below {2 * smallest:.6g} m, the smallest diameter of the cam, got {bore:g} m;"
            " use a smaller bore or a broader cam"
        )
    cam = cut.cam
    largest = MM * float(np.hypot(*cut.profile.T).max())
    letter = largest / LETTERS_PER_RADIUS
    title = f"cam for the law {cam.cycle.forward.name}, {_follower_words(cam.follower)}"
    drawing = Drawing(title)
    _draw_outlines(drawing, cut, bore, letter)
    _draw_dimensions(drawing, cut, bore, letter)
    left = MM * float(cut.profile[:, 0].max() + 2 * getattr(cam.follower, "radius", 0.0)) + 10 * letter
    angles = [
        (f"{np.degrees(angle):.4f}°", f"{MM * float(cam.radius(angle)):.4f}", words) for angle, words in key_angles(cam)
    ]
    sizes = [(line,) for line in _sizes(cut, bore)]
    notes = [(title,), (), *sizes, (), ("angle", "follower", "begins"), *angles, ()]
    drawing.rows(notes, left, largest, letter, NOTE_COLUMNS)
    below = largest - LINE_SPACING * letter * len(notes)
    for half, points in enumerate(np.array_split(_point_rows(cut), 2)):
        rows = [("angle", "follower", "radius", "at angle"), *points]
        drawing.rows(rows, left + TABLE_WIDTH * letter * half, below, 0.9 * letter, TABLE_COLUMNS)
    return drawing


def describe(cut: Cut) -> str:
    """Return a description of a cut in one sentence, for screen readers."""
    radius, _ = MM * cut.polar
    return (
        f"profile of the cam for the law {cut.cam.cycle.forward.name} with {_follower_words(cut.cam.follower)}: radius "
        f"from {radius.min():.1f} to {radius.max():.1f} mm about the axis, breadth {MM * cut.cam.breadth:.1f} mm"
    )


def key_angles(cam: Cam) -> list[tuple[float, str]]:
    """Return (angle [rad], what begins there) of every pass, dwell and breakpoint of the laws, ascending."""
    period, words = cam.cycle.period, {1: "forward stroke", -1: "return stroke"}
    found = {}
    for leg in cam.cycle.legs():
        for inner in leg.breakpoints()[1:-1]:
            found[2 * np.pi * (leg.start + leg.duration * inner) / period] = "next piece of the law"
        dwell = "far dwell" if leg.position > 0 else "near dwell"
        found[2 * np.pi * leg.start / period] = words.get(leg.direction, dwell)
    return sorted(found.items())


def _follower_words(follower: Follower) -> str:
    if isinstance(follower, FlatFace):
        return "flat-faced followers"
    return "pointed followers" if isinstance(follower, Pointed) else f"rollers of radius {MM * follower.radius:g} mm"


def _draw_outlines(drawing: Drawing, cut: Cut, bore: float | None, letter: float) -> None:
    """Profile, cutter path, pitch curve, base circle, bore and centre lines."""
    cam = cut.cam
    drawing.polygon(MM * cut.profile, "PROFILE")
    if cut.cutter_path is not None:
        drawing.polygon(MM * cut.cutter_path, "CUTTER")
    if not isinstance(cam.follower, FlatFace | Pointed):
        ray = np.array([np.cos(cut.angle), np.sin(cut.angle)])
        drawing.polygon((MM * cam.radius(cut.angle) * ray).T, "FOLLOWER")
        for side in (0.0, np.pi):
            drawing.circle((MM * float(cam.radius(side)) * np.cos(side), 0.0), MM * cam.follower.radius, "FOLLOWER")
    drawing.circle((0.0, 0.0), MM * float(np.hypot(*cut.profile.T).min()), "CENTRE")
    if bore is not None:
        drawing.circle((0.0, 0.0), MM * bore / 2, "BORE")
    beyond = 3 * letter + 2 * MM * getattr(cam.follower, "radius", 0.0)
    low, high = MM * cut.profile.min(axis=0) - beyond, MM * cut.profile.max(axis=0) + beyond
    drawing.line((low[0], 0.0), (high[0], 0.0), "CENTRE")
    drawing.line((0.0, low[1]), (0.0, high[1]), "CENTRE")
    drawing.text((high[0], 0.3 * letter), "0°", letter, DIMENSION_LAYER)


def _draw_dimensions(drawing: Drawing, cut: Cut, bore: float | None, letter: float) -> None:
    """Dimensions of breadth, base circle, largest radius, bore and roller."""
    cam, (radius, _) = cut.cam, cut.polar
    right, left = MM * float(cam.radius(0.0)), -MM * float(cam.radius(np.pi))
    below = MM * cut.profile[:, 1].min() - 6 * letter
    drawing.distance((left, 0.0), (right, 0.0), below, letter, "b = ")
    drawing.radius((0.0, 0.0), MM * float(radius.min()), np.radians(-110), letter)
    start, end = sorted([(0.0, 0.0), tuple((MM * cut.profile[radius.argmax()]).tolist())])  # text from left to right
    drawing.distance(start, end, 4 * letter, letter, "R")
    if bore is not None:
        drawing.radius((0.0, 0.0), MM * bore / 2, np.radians(-45), letter, diameter=True)
    if not isinstance(cam.follower, FlatFace | Pointed):
        drawing.radius((right, 0.0), MM * cam.follower.radius, np.radians(60), letter)


def _sizes(cut: Cut, bore: float | None) -> list[str]:
    """Sizes of the cam, one line each."""
    cam, (radius, _), flat = cut.cam, cut.polar, isinstance(cut.cam.follower, FlatFace)
    least, guide = cam.least_breadth(), breadth_for_pressure_angle(cam.cycle, cam.follower, GUIDE_PRESSURE_ANGLE)
    over = "faces" if flat else "points" if isinstance(cam.follower, Pointed) else "roller centres"
    face = f", {MM * cam.largest_contact_offset:.3f} to each side at least" if flat else ""
    lines = [
        "lengths in mm, angles counterclockwise from 0°; the cam turns clockwise",
        f"tolerance of the follower's travel {MM * cut.tolerance:g}",
        f"profile of {len(cut.angle)} points: largest deviation {MM * cut.error:.5f}",
        f"breadth b over the {over} {MM * cam.breadth:.3f}",
        f"stroke {MM * cam.cycle.forward.stroke:.3f}",
        f"base circle: radius {MM * radius.min():.3f}; largest radius {MM * radius.max():.3f}",
        "bore: not given" if bore is None else f"bore: diameter {MM * bore:g}",
        f"{_follower_words(cam.follower)}{face}",
        *_cutter_lines(cut),
        f"least radius of curvature {MM * cam.least_radius_of_curvature:.3f}",
        f"least breadth {MM * least.breadth:.3f}: {least.rule}",
        f"largest pressure angle {np.degrees(cam.largest_pressure_angle):.2f}°",
    ]
    within = f"pressure angle within {np.degrees(GUIDE_PRESSURE_ANGLE):g}° from b = {MM * guide:.1f}"
    return lines if flat else [*lines, within]


def _cutter_lines(cut: Cut) -> Iterator[str]:
    if cut.cutter_radius is not None:
        yield f"cutter: radius {MM * cut.cutter_radius:g}, path of its centre dashed red"
    limit = largest_cutter(cut.cam)
    yield (
        "cutter of any radius fits: no concave parts"
        if np.isinf(limit)
        else f"cutter radius up to {np.floor(100 * MM * limit) / 100:.2f}"
    )


def _point_rows(cut: Cut) -> list[Row]:
    """Points of the profile at equal cam angles."""
    cam, angle = cut.cam, np.linspace(0, 2 * np.pi, TABLE_ROWS, endpoint=False)
    x, y = cam.profile(angle)
    polar = np.degrees(np.arctan2(y, x)) % 360
    columns = (np.degrees(angle), MM * cam.radius(angle), MM * np.hypot(x, y), polar)
    return [
        (f"{a:.0f}°", f"{rho:.4f}", f"{radius:.4f}", f"{at:.4f}°") for a, rho, radius, at in zip(*columns, strict=True)
    ]


def write_cam_files(
    directory: str | Path, scene: "Scene", cam: Cam, cutter_radius: float | None = None, tolerance: float = MICROMETRE
) -> list[Path]:
    """Write points, drawing as SVG, animation and drawing as DXF of a cam.

    Parameters
    ----------
    directory : str or Path
        Folder of the files.
    scene : Scene
        Scene of the cam.
    cam : Cam
        Cam.
    cutter_radius : float, optional
        Radius of the cutter [m].
    tolerance : float
        Tolerance of the points [m].

    Returns
    -------
    list of Path
        Files written.
    """
    outline = cut(cam, cutter_radius, tolerance)
    drawing, table = workshop_drawing(outline, scene.cam.bore if scene.cam else None), point_table(outline)
    law, machine = cam.cycle.forward.name, scene.machine
    kind = type(cam.follower).__name__.removesuffix("Follower").removesuffix("Face").lower()
    label = f"the cam turns and its followers move the cart with the law {law}"
    texts = {
        ".svg": drawing.svg(describe(outline)),
        "-motion.svg": animated_svg(cam, machine.roller_radius, machine.roller_positions, label),
        ".dxf": drawing.dxf(),
    }
    paths = [write_csv(Path(directory) / f"{law}-{kind}.csv", table.header, table.rows())]
    for ending, text in texts.items():
        paths.append(write_bytes(Path(directory) / f"{law}-{kind}{ending}", text.encode()))
    return paths


def point_table(cut: Cut) -> ProfileTable:
    """Return every point of a cut: cam angle, follower, profile in both coordinates, cutter; mm and degrees."""
    radius, polar = cut.polar
    header = ["cam_angle_deg", "follower_mm", "x_mm", "y_mm", "radius_mm", "polar_angle_deg"]
    follower = MM * cut.cam.radius(cut.angle)
    columns = [np.degrees(cut.angle), follower, *MM * cut.profile.T, MM * radius, np.degrees(polar)]
    if cut.cutter_path is not None:
        header += ["cutter_x_mm", "cutter_y_mm"]
        columns += [*MM * cut.cutter_path.T]
    return ProfileTable(tuple(header), np.array(columns))
