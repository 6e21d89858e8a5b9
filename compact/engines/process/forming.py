"""Forming process of one roller: geometry and motion of mould and roller, mix that enters, law and closure of the feed.

The rollers of a machine lie side by side along the travel, each over its own stroke. The mould moves along the axis of
the roller, so that the position z along the roller counts strokes: z = 0 is the edge at the empty mould, and

    a = v_form T,    N = L/a

are the advance of the mould per stroke and the number of strokes on a section of the product. N is a property of the
machine. Where it is not a whole number, the last stroke presses the remaining part of the roller length.

The lowest generatrix is horizontal at the height h0 above the base. The surface of the mix lies the bite d above it
before a stroke. A roller draws mix in up to the nip angle,

    d <= R (1 - cos nip).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from compact.numerics import Array
from compact.numerics.validation import require_fields

FeedLaw = Literal["room", "even", "first"]
FedStrokes = Literal["both", "forward"]
ClosureKind = Literal["gap", "product_density_ratio", "extrusion_pressure"]
COUNT_ROUNDING = 1e-9  # [-], of the number of strokes; 70.0000000001 is 70


@dataclass(frozen=True)
class FormingMachine:
    """One roller over its strip of a mould.

    Parameters
    ----------
    roller_radius, roller_length : float
        R and L [m]; the length lies along the motion of the mould.
    height : float
        Height h0 of the lowest generatrix above the base of the mould [m].
    cart_speed : float
        Mean speed of the roller in a stroke [m/s].
    stroke_period : float
        Time T from one stroke to the next [s].
    mould_speed : float
        Speed v_form of the mould [m/s]; 0 at rest.
    nip_angle : float
        Largest angle at which the roller draws mix in [deg].
    strokes : int, optional
        Number of strokes of a mould at rest; None of a moving one.
    """

    roller_radius: float
    roller_length: float
    height: float
    cart_speed: float
    stroke_period: float
    mould_speed: float
    nip_angle: float
    strokes: int | None = None

    def __post_init__(self) -> None:
        positive = "roller_radius roller_length height cart_speed stroke_period nip_angle strokes"
        require_fields(self, positive=positive, nonnegative="mould_speed")

    @property
    def advance(self) -> float:
        """Advance a of the mould per stroke [m]."""
        return self.mould_speed * self.stroke_period

    @property
    def strokes_on_section(self) -> float:
        """Number N of strokes on a section [-], not a whole number in general."""
        return float(self.strokes) if self.strokes is not None else self.roller_length / self.advance

    @property
    def stroke_count(self) -> int:
        """Number of strokes to compute: N rounded up."""
        return int(np.ceil(self.strokes_on_section * (1 - COUNT_ROUNDING)))

    @property
    def stroke_shares(self) -> Array:
        """Share of each stroke on a section [-], shape (stroke_count,): 1, of the last stroke the rest."""
        shares = np.ones(self.stroke_count)
        shares[-1] = self.strokes_on_section - (self.stroke_count - 1)
        return shares

    @property
    def edges(self) -> Array:
        """Positions z between which each stroke meets its sections [m], shape (stroke_count + 1,)."""
        if self.strokes is not None:  # every section under the roller has had the same strokes
            return np.linspace(0, self.roller_length, self.stroke_count + 1)
        return np.append(self.advance * np.arange(self.stroke_count), self.roller_length)

    @property
    def max_bite(self) -> float:
        """Largest bite [m], at the nip angle."""
        return float(self.roller_radius * (1 - np.cos(np.radians(self.nip_angle))))

    def mean_of_product(self, before_last: float, last: float) -> float:
        """Return the mean of a quantity over the product from its values one stroke before the last, and at the last.

        Sections have had N strokes rounded down or up.
        """
        share = float(self.stroke_shares[-1])
        return float((1 - share) * before_last + share * last)


@dataclass(frozen=True)
class Feed:
    """Mix fed before the strokes, and the law by which it is distributed over them.

    Parameters
    ----------
    density_ratio : float
        Density ratio of the mix as fed [-].
    law : {"room", "even", "first"}
        Make-up of each stroke: the room up to a gap above the lowest generatrix; the same thickness; the same in the
        first strokes, nothing later.
    count : int
        Number of fed strokes of the law "first".
    strokes : {"both", "forward"}
        Fed strokes: every one, or every second one.
    """

    density_ratio: float
    law: FeedLaw = "room"
    count: int = 0
    strokes: FedStrokes = "both"

    def shares(self, machine: FormingMachine) -> Array:
        """Return the make-up of each stroke over the largest one [-], shape (stroke_count,); 0 of a stroke without."""
        fed = np.ones(machine.stroke_count)
        if self.strokes == "forward":
            fed[1::2] = 0.0
        if self.law == "first":
            fed[np.cumsum(fed) > self.count] = 0.0
        return fed


@dataclass(frozen=True)
class Closure:
    """Condition that determines the amount of the feed.

    Parameters
    ----------
    kind : {"gap", "product_density_ratio", "extrusion_pressure"}
        Gap of the law "room" above the lowest generatrix [m]; mean density ratio of the product [-]; or pressure under
        the lowest generatrix that a section does not exceed [Pa].
    value : float
        Its value.
    offered : float, optional
        Thickness that the sleeves offer in a stroke [m], of an extrusion pressure; default as the nip allows.
    """

    kind: ClosureKind
    value: float
    offered: float | None = None
