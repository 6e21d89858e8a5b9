"""Options of `simulate_reciprocating`, and the cases that it refuses."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from compact.engines.compaction.engine import CompactionContactResult
from compact.engines.compaction.layer_state import LayerState
from compact.engines.stroke_schedule import PLACE_TOLERANCE, Strokes
from compact.material.laws import Compaction
from compact.numerics.validation import require_finite, require_integers, require_known, require_nonnegative
from compact.rolling_contact import Layer, Roller

INCREMENTS = 6  # [-], elements per contact length sqrt(2 R depth)


@dataclass(frozen=True, kw_only=True)
class ReciprocatingNumerics:
    """Options of `simulate_reciprocating`.

    Parameters
    ----------
    strain : {"finite", "small"}
        Strain measure.
    increments : int
        Elements per contact length; each is travelled in four steps.
    instants : sequence of float
        Times at which fields are kept as `frames`, each at the nearest end of a step [s].
    estimate : bool
        True for an error estimate from steps twice as long, at half as much work again.
    edge_distance : float, optional
        Distance from the axle back to the edge of fresh mix that is laid at each reversal [m], at least the contact
        length; none is laid by default.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    strain: Literal["finite", "small"] = "finite"
    increments: int = INCREMENTS
    instants: Sequence[float] = ()
    estimate: bool = True
    edge_distance: float | None = None

    def __post_init__(self) -> None:
        require_known("strain", self.strain, ("finite", "small"))
        require_integers(increments=self.increments)
        require_finite(instants=self.instants)


def require_simulable(
    layer: Layer,
    roller: Roller,
    strokes: Strokes,
    lift: float,
    edge_distance: float | None,
    fed_layer: LayerState | None,
) -> float:
    """Require a case that can be simulated, and return the depth [m]."""
    depth = roller.indentation
    if depth is None:
        raise ValueError(f"`indentation` must be given for a roller of constant height, got its {roller.target[0]}")
    if layer.lower_lift is not None or (fed_layer is not None and fed_layer.lower is not None):
        raise ValueError("a `lower_lift` is for steady rolling, got one under a stroke; use `roll`")
    if layer.base != "bonded":
        raise ValueError(f"`base` must be 'bonded', got {layer.base!r}: a frictionless base leaves the layer free")
    if not strokes.span > 0:
        raise ValueError(f"`motion` must move the roller, got a constant position of {strokes.low!r} m")
    require_nonnegative(lift_thickness=lift)
    length = float(np.sqrt(2 * roller.radius * depth))
    if edge_distance is not None and (lift or not edge_distance >= length):
        raise ValueError(
            f"`edge_distance` must be at least the contact length {length:.4g} m and `lift_thickness` 0, got "
            f"{edge_distance!r} m and {lift!r} m"
        )
    return depth


def warn_of_shut_pores(fed: LayerState, material: Compaction, depth: float, stroke: int) -> None:
    """Warn if a layer with its lift has fewer voids than a roller at a depth [m] takes: the mix is pushed ahead."""
    room = fed.height - fed.solid_height(material)
    if depth > room:
        warnings.warn(
            f"stroke {stroke}: the pores of the layer and its lift are shut at {room:.3g} of {depth:.3g} m; the mix "
            "beyond is pushed ahead of the roller",
            stacklevel=4,
        )


def require_start(
    start: CompactionContactResult, layer: Layer, depth: float, fed_layer: LayerState | None, strokes: Strokes
) -> None:
    """Require a steady contact from which the motion can begin."""
    same = start.layer == layer and start.solution.frame.inflow is fed_layer
    if not same or abs(start.indentation - depth) > PLACE_TOLERANCE * depth:
        raise ValueError("`start` must have the same `layer`, `fed_layer` and `indentation`, got a result of others")
    if start.speed < 0 or strokes.places[1] < strokes.places[0]:
        raise ValueError(
            f"`start` must roll along +x and the `motion` begin along +x, got {start.speed!r} m/s and a first stroke "
            f"from {strokes.places[0]:.6g} to {strokes.places[1]:.6g} m"
        )
