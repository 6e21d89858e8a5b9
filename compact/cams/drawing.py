"""A drawing in millimetres, and its two forms: SVG, true to scale, and DXF for the workshop.

A `Drawing` is a title and shapes on layers, x to the right, y up. Layers and their look are in LAYERS.

Dimensions of a drawing [mm]: shapes that say how long something is, in SVG by lines and words, in DXF as DIMENSION.

    Distance    between two points, along a line beside them
    Radius      of a circle, or its diameter: an arrow from the centre out

A DIMENSION measures what it points at: CAD programs show the number from the geometry, and can be asked for it.
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


LAYER = "DIMENSIONS"
BY_LAYER, NO_TRAILING_ZEROS = 256, 8  # codes of DXF: of a colour, and of DIMZIN
DIMENSION_DECIMALS = 3  # of a number that a dimension shows: a micrometre


def _dimension_style(height):
    """DXF variables for letters of a height: arrows, gaps and lines in proportion, a point before the decimals."""
    sizes = {"dimtxt": 1.0, "dimasz": 0.9, "dimexe": 0.5, "dimexo": 0.4, "dimgap": 0.35}
    style = {name: share * height for name, share in sizes.items()}
    style |= dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), BY_LAYER)
    return style | {"dimdec": DIMENSION_DECIMALS, "dimdsep": ord("."), "dimzin": NO_TRAILING_ZEROS, "dimtad": 1}


def _shown(size):
    """A number as a dimension shows it."""
    return f"{size:.{DIMENSION_DECIMALS}f}".rstrip("0").rstrip(".")


@dataclass(frozen=True)
class Distance:
    """The distance between two points (x, y), shown on a line `aside` [mm] to the left of the way between them."""

    start: tuple
    end: tuple
    aside: float
    height: float
    sign: str = ""

    def _line(self):
        """Both ends of the line beside the points, and its direction."""
        start, end = np.array(self.start, float), np.array(self.end, float)
        along = (end - start) / np.hypot(*(end - start))
        beside = self.aside * np.array([-along[1], along[0]])
        return start + beside, end + beside, along

    def corners(self):
        """Points whose box holds the shape."""
        first, last, _ = self._line()
        reach = 2 * self.height
        return np.array([self.start, self.end, first - reach, last + reach])

    def svg(self):
        """As elements of SVG."""
        first, last, along = self._line()
        across, h = np.array([-along[1], along[0]]), self.height
        beyond = 0.5 * h * np.sign(self.aside) * across
        lines = [(first, last), (self.start, first + beyond), (self.end, last + beyond)]
        lines += [(end - 0.3 * h * (along + across), end + 0.3 * h * (along + across)) for end in (first, last)]
        text = f"{self.sign}{_shown(np.hypot(*(last - first)))}"
        words = (first + last) / 2 - [LETTER * h * len(text) / 2, -h / 2]
        parts = [Line(tuple(a), tuple(b), LAYER) for a, b in lines]
        return "".join(part.svg() for part in [*parts, Words(tuple(words), text, h, LAYER)])

    def into(self, space):
        """Into a DXF model space."""
        space.add_aligned_dim(
            p1=self.start, p2=self.end, distance=self.aside, text=f"{self.sign}<>", dimstyle="Standard",
            override=_dimension_style(self.height), dxfattribs={"layer": LAYER},
        ).render()  # fmt: skip


@dataclass(frozen=True)
class Radius:
    """The radius of a circle about a centre (x, y), shown on an arrow out at an `angle` [rad]; `twice` its diameter."""

    centre: tuple
    radius: float
    angle: float
    height: float
    twice: bool = False

    def _along(self, distance):
        """The point so far [mm] from the centre on the way of the arrow."""
        ray = np.array([np.cos(self.angle), np.sin(self.angle)])
        return tuple((np.array(self.centre) + distance * ray).tolist())

    def _words(self):
        sign, size = ("Ø", 2 * self.radius) if self.twice else ("R", self.radius)
        return Words(self._along(self.radius + self.height), f"{sign}{_shown(size)}", self.height, LAYER)

    def _line(self):
        start = -self.radius if self.twice else 0.0
        return Line(self._along(start), self._along(self.radius + self.height), LAYER)

    def corners(self):
        """Points whose box holds the shape."""
        return np.concatenate([self._line().corners(), self._words().corners()])

    def svg(self):
        """As elements of SVG."""
        return self._line().svg() + self._words().svg()

    def into(self, space):
        """Into a DXF model space."""
        add = space.add_diameter_dim if self.twice else space.add_radius_dim
        add(
            center=self.centre, radius=self.radius, angle=np.degrees(self.angle), location=self._words().place,
            dimstyle="Standard", override=_dimension_style(self.height), dxfattribs={"layer": LAYER},
        ).render()  # fmt: skip
