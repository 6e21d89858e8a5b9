"""Dimensions of a drawing [mm]: shapes that say how long something is, in SVG by lines and words, in DXF as DIMENSION.

    Distance    between two points, along a line beside them
    Radius      of a circle, or its diameter: an arrow from the centre out

A DIMENSION measures what it points at: CAD programs show the number from the geometry, and can be asked for it.
"""

from dataclasses import dataclass

import numpy as np

from compact.drawing import LETTER, Line, Words

LAYER = "DIMENSIONS"
BY_LAYER, NO_TRAILING_ZEROS = 256, 8  # codes of DXF: of a colour, and of DIMZIN
DECIMALS = 3  # of a number that a dimension shows: a micrometre


def _style(height):
    """DXF variables for letters of a height: arrows, gaps and lines in proportion, a point before the decimals."""
    sizes = {"dimtxt": 1.0, "dimasz": 0.9, "dimexe": 0.5, "dimexo": 0.4, "dimgap": 0.35}
    style = {name: share * height for name, share in sizes.items()}
    style |= dict.fromkeys(("dimclrd", "dimclre", "dimclrt"), BY_LAYER)
    return style | {"dimdec": DECIMALS, "dimdsep": ord("."), "dimzin": NO_TRAILING_ZEROS, "dimtad": 1}


def _shown(size):
    """A number as a dimension shows it."""
    return f"{size:.{DECIMALS}f}".rstrip("0").rstrip(".")


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
            override=_style(self.height), dxfattribs={"layer": LAYER},
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
            dimstyle="Standard", override=_style(self.height), dxfattribs={"layer": LAYER},
        ).render()  # fmt: skip
