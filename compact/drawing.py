"""A drawing in millimetres, and its two forms: SVG, true to scale, and DXF for the workshop.

A `Drawing` is a title and shapes on layers, x to the right, y up. Layers and their look are in LAYERS.
"""

from dataclasses import dataclass
from html import escape
from io import StringIO
from types import MappingProxyType

import numpy as np

DECIMALS = 6  # of coordinates in both forms: a nanometre
LETTER = 0.85  # width of a letter over the height of a capital, for the room that words take
MARGIN = 0.02  # of the drawing's width, left free around it


@dataclass(frozen=True)
class Layer:
    """How a layer looks: colour in SVG and as DXF index, line width [of the drawing's width], dashes, DXF line type."""

    colour: str
    index: int
    width: float
    dashes: tuple = ()
    line_type: str = "CONTINUOUS"


LAYERS = MappingProxyType(
    {
        "PROFILE": Layer("#000000", 7, 1 / 700),
        "CUTTER": Layer("#b3261e", 1, 1 / 1400, (8, 4), "DASHED"),
        "FOLLOWER": Layer("#1f5fa8", 5, 1 / 1400, (4, 3), "DASHED"),
        "CENTRE": Layer("#6b6b6b", 8, 1 / 2000, (12, 3, 2, 3), "CENTER"),
        "BORE": Layer("#000000", 7, 1 / 1000),
        "DIMENSIONS": Layer("#3a3a3a", 3, 1 / 2000),
        "NOTES": Layer("#000000", 7, 1 / 2000),
    }
)


@dataclass(frozen=True)
class Outline:
    """A closed polygon of points [mm], ndarray of shape (n, 2)."""

    points: np.ndarray
    layer: str

    def corners(self):
        """Points whose box holds the shape."""
        return self.points

    def svg(self):
        """As an element of SVG."""
        points = " ".join(f"{_number(x)},{_number(-y)}" for x, y in self.points)
        return f'<polygon class="{self.layer}" points="{points}"/>'

    def into(self, space):
        """Into a DXF model space."""
        space.add_lwpolyline(np.round(self.points, DECIMALS), close=True, dxfattribs={"layer": self.layer})


@dataclass(frozen=True)
class Circle:
    """A circle about a centre (x, y) [mm]."""

    centre: tuple
    radius: float
    layer: str

    def corners(self):
        """Points whose box holds the shape."""
        return np.add(self.centre, self.radius * np.array([[-1, -1], [1, 1]]))

    def svg(self):
        """As an element of SVG."""
        x, y = self.centre
        return f'<circle class="{self.layer}" cx="{_number(x)}" cy="{_number(-y)}" r="{_number(self.radius)}"/>'

    def into(self, space):
        """Into a DXF model space."""
        space.add_circle(self.centre, self.radius, dxfattribs={"layer": self.layer})


@dataclass(frozen=True)
class Line:
    """A line between two points (x, y) [mm]."""

    start: tuple
    end: tuple
    layer: str

    def corners(self):
        """Points whose box holds the shape."""
        return np.array([self.start, self.end])

    def svg(self):
        """As an element of SVG."""
        (x1, y1), (x2, y2) = self.start, self.end
        ends = f'x1="{_number(x1)}" y1="{_number(-y1)}" x2="{_number(x2)}" y2="{_number(-y2)}"'
        return f'<line class="{self.layer}" {ends}/>'

    def into(self, space):
        """Into a DXF model space."""
        space.add_line(self.start, self.end, dxfattribs={"layer": self.layer})


@dataclass(frozen=True)
class Words:
    """A line of words [letters `height` mm high] that begins at a place (x, y) [mm]."""

    place: tuple
    text: str
    height: float
    layer: str = "NOTES"

    def corners(self):
        """Points whose box holds the shape."""
        x, y = self.place
        return np.array([[x, y], [x + LETTER * self.height * len(self.text), y + self.height]])

    def svg(self):
        """As an element of SVG."""
        x, y = self.place
        size = _number(1.35 * self.height)  # a capital letter is 0.74 of the font's size
        place = f'x="{_number(x)}" y="{_number(-y)}" font-size="{size}"'
        return f'<text class="{self.layer}" {place}>{escape(self.text)}</text>'

    def into(self, space):
        """Into a DXF model space."""
        space.add_text(self.text, height=self.height, dxfattribs={"layer": self.layer, "insert": self.place})


@dataclass(frozen=True)
class Drawing:
    """A title, and the shapes that make the drawing."""

    title: str
    shapes: tuple

    def box(self):
        """(left, bottom, right, top) [mm] of all shapes with a margin."""
        corners = np.concatenate([shape.corners() for shape in self.shapes])
        low, high = corners.min(axis=0), corners.max(axis=0)
        free = MARGIN * (high - low).max()
        return (*(low - free), *(high + free))

    def svg(self, description=""):
        """The drawing as a page of SVG, a unit a millimetre; `description` is for those who cannot see it."""
        left, bottom, right, top = self.box()
        wide, high = right - left, top - bottom
        told = f'<title id="title">{escape(self.title)}</title><desc id="desc">{escape(description)}</desc>'
        size = f'width="{_number(wide)}mm" height="{_number(high)}mm"'
        view = f'viewBox="{_number(left)} {_number(-top)} {_number(wide)} {_number(high)}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} {view} role="img" aria-labelledby="title desc">'
        shapes = "\n".join(shape.svg() for shape in self.shapes)
        return f"{head}\n{told}\n<style>{_style(wide)}</style>\n{shapes}\n</svg>\n"

    def dxf(self):
        """The drawing as DXF text, units millimetres."""
        import ezdxf  # 0.3 s that a drawing as SVG need not pay

        document = ezdxf.new("R2010", setup=["linetypes"], units=ezdxf.units.MM)
        for name, layer in LAYERS.items():
            document.layers.add(name, color=layer.index, linetype=layer.line_type)
        document.header["$LTSCALE"] = (self.box()[2] - self.box()[0]) / 100
        for shape in self.shapes:
            shape.into(document.modelspace())
        text = StringIO()
        document.write(text)
        return text.getvalue()


def _style(wide):
    """Look of the layers in a drawing of a width [mm]."""
    rules = ["text{fill:#000;stroke:none;font-family:sans-serif}", "polygon,circle,line{fill:none}"]
    for name, layer in LAYERS.items():
        width = layer.width * wide
        dashes = f";stroke-dasharray:{' '.join(_number(dash * width) for dash in layer.dashes)}" if layer.dashes else ""
        rules.append(f".{name}{{stroke:{layer.colour};stroke-width:{_number(width)}{dashes}}}")
    return "".join([*rules, "text.NOTES,text.DIMENSIONS{stroke:none}"])


def _number(value):
    return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
