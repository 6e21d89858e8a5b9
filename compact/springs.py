"""Preloaded springs at both ends of the stroke, which stop the cart and set it going the other way.

    S = P + k (l - x) for x < l,   -(P + k (x - h + l)) for x > h - l,   0 between

x is the cart's position from 0 to the stroke h. The preload P makes S jump where the cart meets a spring; those places
are found beforehand, so that nothing is sampled across them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compact.pieces import sign_changes
from compact.refuse import refuse_negative, refuse_nonpositive


class Zones(NamedTuple):
    """breaks of a coordinate of the motion, ascending; side of each piece between: +1 on the near spring, -1 far, 0."""

    breaks: np.ndarray
    sides: np.ndarray

    def at(self, place):
        """Side at places of any shape."""
        return self.sides[np.clip(np.searchsorted(self.breaks, place, side="right") - 1, 0, len(self.sides) - 1)]


@dataclass(frozen=True)
class EndSprings:
    """stiffness : k [N/m];  preload : P [N];  length : l over which a spring pushes [m];  stroke : h [m], h >= 2 l."""

    stiffness: float
    preload: float
    length: float
    stroke: float

    def __post_init__(self):
        refuse_negative(stiffness=self.stiffness, preload=self.preload)
        refuse_nonpositive(length=self.length, stroke=self.stroke)
        if 2 * self.length > self.stroke:
            raise ValueError(f"`length` must be at most half the stroke, {self.stroke / 2:g} m, got {self.length!r}")

    def push(self, position, side):
        """S [N], + along the travel, at a position [m] on the side that `Zones` tell."""
        pressed = self.length - np.where(side > 0, position, self.stroke - position)
        return side * (self.preload + self.stiffness * pressed)

    def energy(self, position):
        """What both springs hold [J], their preload's work over `length` among it."""
        pressed = np.maximum(self.length - np.minimum(position, self.stroke - np.asarray(position)), 0.0)
        return self.preload * pressed + self.stiffness / 2 * pressed**2

    def zones(self, position, breaks):
        """`Zones` of position(place) over places that join at `breaks`."""
        edges = (self.length, self.stroke - self.length)
        breaks = np.asarray(breaks, float)
        met = [sign_changes(lambda place, edge=edge: position(place) - edge, breaks) for edge in edges]
        breaks = np.unique(np.concatenate([breaks, *met]))
        middle = position((breaks[:-1] + breaks[1:]) / 2)
        return Zones(breaks, np.where(middle < edges[0], 1.0, np.where(middle > edges[1], -1.0, 0.0)))
