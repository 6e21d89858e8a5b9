"""Drawing in millimetres on named layers, written as SVG true to scale and as DXF for CAD programs.

A `Drawing` is a title and shapes, x to the right, y up. `LAYERS` defines colour and line of each layer. Dimensions are
lines and text in SVG, DIMENSION entities in DXF, whose number a CAD program measures from the geometry.

Notes
-----
The SVG is written here, not by the drawing add-on of ezdxf. The add-on converts text to outlines of glyphs, so that it
can be neither searched nor read aloud; it loses the names of the layers; and it rounds coordinates to the page width
over 10^6, 2 um on a cam of 1 m, more than the tolerance of the profile. Its files are seven times as large.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from io import StringIO
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

import numpy as np

from compact.numerics import Array

if TYPE_CHECKING:
    from ezdxf.layouts import Modelspace

Point = tuple[float, float]

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


class Shape(Protocol):
    """Shape of a drawing, coordinates in mm."""

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (n, 2)."""

    def svg(self) -> str:
        """Return the shape as SVG elements."""

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""


@dataclass(frozen=True)
class Polygon:
    """Closed polygon.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        Vertices [mm].
    layer : str
        Name in `LAYERS`.
    """

    points: Array
    layer: str

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (n, 2)."""
        return self.points

    def svg(self) -> str:
        """Return the shape as an SVG element."""
        points = " ".join(f"{_number(x)},{_number(-y)}" for x, y in self.points)
        return f'<polygon class="{self.layer}" points="{points}"/>'

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""
        points = np.round(self.points, COORDINATE_DECIMALS)
        space.add_lwpolyline(points, close=True, dxfattribs={"layer": self.layer})


@dataclass(frozen=True)
class Circle:
    """Circle.

    Attributes
    ----------
    centre : tuple of float
        (x, y) [mm].
    radius : float
        Radius [mm].
    layer : str
        Name in `LAYERS`.
    """

    centre: Point
    radius: float
    layer: str

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (2, 2)."""
        return np.add(self.centre, self.radius * np.array([[-1, -1], [1, 1]]))

    def svg(self) -> str:
        """Return the shape as an SVG element."""
        x, y = self.centre
        return f'<circle class="{self.layer}" cx="{_number(x)}" cy="{_number(-y)}" r="{_number(self.radius)}"/>'

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""
        space.add_circle(self.centre, self.radius, dxfattribs={"layer": self.layer})


@dataclass(frozen=True)
class Line:
    """Straight line.

    Attributes
    ----------
    start, end : tuple of float
        (x, y) [mm].
    layer : str
        Name in `LAYERS`.
    """

    start: Point
    end: Point
    layer: str

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (2, 2)."""
        return np.array([self.start, self.end])

    def svg(self) -> str:
        """Return the shape as an SVG element."""
        (x1, y1), (x2, y2) = self.start, self.end
        ends = f'x1="{_number(x1)}" y1="{_number(-y1)}" x2="{_number(x2)}" y2="{_number(-y2)}"'
        return f'<line class="{self.layer}" {ends}/>'

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""
        space.add_line(self.start, self.end, dxfattribs={"layer": self.layer})


@dataclass(frozen=True)
class Text:
    """Line of text.

    Attributes
    ----------
    place : tuple of float
        Left end of the base line (x, y) [mm].
    text : str
    height : float
        Height of a capital [mm].
    layer : str
        Name in `LAYERS`.
    """

    place: Point
    text: str
    height: float
    layer: str = "NOTES"

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (2, 2)."""
        x, y = self.place
        return np.array([[x, y], [x + LETTER_WIDTH * self.height * len(self.text), y + self.height]])

    def svg(self) -> str:
        """Return the shape as an SVG element."""
        x, y = self.place
        place = f'x="{_number(x)}" y="{_number(-y)}" font-size="{_number(FONT_SIZE * self.height)}"'
        return f'<text class="{self.layer}" {place}>{escape(self.text)}</text>'

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""
        space.add_text(self.text, height=self.height, dxfattribs={"layer": self.layer, "insert": self.place})


@dataclass(frozen=True)
class DistanceDimension:
    """Dimension of the distance between two points.

    Attributes
    ----------
    start, end : tuple of float
        Points (x, y) [mm].
    offset : float
        Distance of the dimension line from the points, to the left of the direction from start to end [mm].
    height : float
        Height of a capital [mm].
    prefix : str
        Text before the number.
    """

    start: Point
    end: Point
    offset: float
    height: float
    prefix: str = ""

    def _dimension_line(self):
        """Both ends of the dimension line [mm], and its direction."""
        start, end = np.array(self.start, float), np.array(self.end, float)
        along = (end - start) / np.hypot(*(end - start))
        shift = self.offset * np.array([-along[1], along[0]])
        return start + shift, end + shift, along

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (4, 2)."""
        first, last, _ = self._dimension_line()
        reach = 2 * self.height
        return np.array([self.start, self.end, first - reach, last + reach])

    def svg(self) -> str:
        """Return the shape as SVG elements."""
        first, last, along = self._dimension_line()
        across, h = np.array([-along[1], along[0]]), self.height
        beyond = 0.5 * h * np.sign(self.offset) * across
        lines = [(first, last), (self.start, first + beyond), (self.end, last + beyond)]
        lines += [(end - 0.3 * h * (along + across), end + 0.3 * h * (along + across)) for end in (first, last)]
        text = f"{self.prefix}{_dimension_number(np.hypot(*(last - first)))}"
        place = (first + last) / 2 - [LETTER_WIDTH * h * len(text) / 2, -h / 2]
        drawn = [Line(tuple(a), tuple(b), DIMENSION_LAYER).svg() for a, b in lines]
        return "".join([*drawn, Text(tuple(place), text, h, DIMENSION_LAYER).svg()])

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""
        space.add_aligned_dim(
            p1=self.start, p2=self.end, distance=self.offset, text=f"{self.prefix}<>", dimstyle="Standard",
            override=_dimension_style(self.height), dxfattribs={"layer": DIMENSION_LAYER},
        ).render()  # fmt: skip


@dataclass(frozen=True)
class RadiusDimension:
    """Dimension of the radius or the diameter of a circle, on an arrow from the centre outwards.

    Attributes
    ----------
    centre : tuple of float
        (x, y) [mm].
    radius : float
        Radius [mm].
    angle : float
        Direction of the arrow [rad].
    height : float
        Height of a capital [mm].
    diameter : bool
        True to state the diameter.
    """

    centre: Point
    radius: float
    angle: float
    height: float
    diameter: bool = False

    def _along(self, distance):
        """Point at a distance [mm] from the centre in the direction of the arrow."""
        ray = np.array([np.cos(self.angle), np.sin(self.angle)])
        return tuple((np.array(self.centre) + distance * ray).tolist())

    def _text(self):
        sign, size = ("Ø", 2 * self.radius) if self.diameter else ("R", self.radius)
        text, (x, y) = f"{sign}{_dimension_number(size)}", self._along(self.radius + self.height)
        left = LETTER_WIDTH * self.height * len(text) * (np.cos(self.angle) < 0)  # beyond the end of the arrow
        return Text((x - left, y - self.height * (np.sin(self.angle) < 0)), text, self.height, DIMENSION_LAYER)

    def _line(self):
        start = -self.radius if self.diameter else 0.0
        return Line(self._along(start), self._along(self.radius + self.height), DIMENSION_LAYER)

    def corners(self) -> Array:
        """Return points whose bounding box contains the shape [mm], shape (4, 2)."""
        return np.concatenate([self._line().corners(), self._text().corners()])

    def svg(self) -> str:
        """Return the shape as SVG elements."""
        return self._line().svg() + self._text().svg()

    def add_to(self, space: "Modelspace") -> None:
        """Add the shape to a DXF model space."""
        add = space.add_diameter_dim if self.diameter else space.add_radius_dim
        add(
            center=self.centre, radius=self.radius, angle=np.degrees(self.angle), location=self._text().place,
            dimstyle="Standard", override=_dimension_style(self.height), dxfattribs={"layer": DIMENSION_LAYER},
        ).render()  # fmt: skip


@dataclass(frozen=True)
class Drawing:
    """Drawing.

    Attributes
    ----------
    title : str
    shapes : tuple of Shape
        Shapes of the drawing.
    """

    title: str
    shapes: tuple[Shape, ...]

    def bounding_box(self) -> tuple[float, float, float, float]:
        """Return (left, bottom, right, top) [mm] of all shapes with a margin."""
        corners = np.concatenate([shape.corners() for shape in self.shapes])
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
        shapes = "\n".join(shape.svg() for shape in self.shapes)
        return f"{head}\n{words}\n<style>{_style_sheet(width)}</style>\n{shapes}\n</svg>\n"

    def dxf(self) -> str:
        """Return the drawing as DXF text, units millimetres."""
        import ezdxf  # 0.3 s, not needed for SVG

        document = ezdxf.new("R2010", setup=["linetypes"], units=ezdxf.units.MM)
        for name, layer in LAYERS.items():
            document.layers.add(name, color=layer.colour_index, linetype=layer.line_type)
        left, _, right, _ = self.bounding_box()
        document.header["$LTSCALE"] = LINE_TYPE_SCALE * (right - left)
        for shape in self.shapes:
            shape.add_to(document.modelspace())
        text = StringIO()
        document.write(text)
        return text.getvalue()


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


def _dimension_number(size: float) -> str:
    return _number(size, DIMENSION_DECIMALS)


def _dimension_style(height: float) -> dict[str, float]:
    """DXF variables of a dimension for a height of text [mm]."""
    style = {name: share * height for name, share in DIMENSION_SIZES.items()}
    style |= dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), BY_LAYER)
    return style | {"dimdec": DIMENSION_DECIMALS, "dimdsep": ord("."), "dimzin": NO_TRAILING_ZEROS, "dimtad": 1}
