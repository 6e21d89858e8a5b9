"""One section of the product under its strokes, as stacked columns of the engine "column".

Mix is added on the section before a stroke, and the roller presses the stack down to the lowest generatrix h0. Behind
the roller the stack recovers elastically; density and locked-in stress of every layer are the initial state of the next
stroke. All layers share the vertical stress. Layers that have yielded under the same stress are nearly in the same
state and are merged, two neighbours into one of the same height and mass of grains.

The mass of grains, over the area of a section and the density of mix without air, is a height,

    m = k h exp(p/K),

with the plastic density ratio k, the height h and the mean stress p of a layer at rest: k h alone misses the elastic
strain, 1e-3 of it. Strokes conserve m, and so does merging.

Columns neither shear nor flow sideways. Their load is a lower estimate: in two dimensions the top of the section is
pressed first, and the same mean density requires a load several times as large.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from compact.engines.column.column_ode import GapShape
from compact.engines.column.column_pass import PLATE, STRAINS, Column, ColumnLayer, PassResult, column_layer
from compact.engines.column.engine import INTEGRATION_RTOL, require_integrable
from compact.engines.column.indentation_search import plate_indentation
from compact.engines.process.forming import Feed, Fill, FormingMachine
from compact.material.cap_plasticity import CapConstants
from compact.material.laws import Compaction
from compact.numerics import Array

DEFAULT_LAYERS = 20  # [-], merged layers of a section; 3 and 80 give the same load to 1e-8
CONTACT_SHARE = 1e-12  # [-], of the height; a smaller bite is no contact
QUARTER = 0.25  # [-], share of the height over which the density of bottom and top is averaged

MakeUp = Callable[[int, "SectionState"], float]  # thickness [m] before a stroke, from its index and the section


class BiteError(ValueError):
    """Error for a bite beyond the nip angle of the roller."""


class OverfilledError(ValueError):
    """Error for a section with more grains and water than fit below the lowest generatrix.

    Parameters
    ----------
    stroke : int
        Number of the stroke, from 1.
    """

    def __init__(self, message: str, stroke: int) -> None:
        super().__init__(message)
        self.stroke = stroke

    def __reduce__(self) -> tuple[type["OverfilledError"], tuple[str, int]]:
        return OverfilledError, (str(self), self.stroke)


class SectionState(NamedTuple):
    """Section at rest.

    Parameters
    ----------
    columns : tuple of Column
        Layers from the base upwards.
    law : CapConstants
        Constants of the mix at the rate of the process.
    """

    columns: tuple[Column, ...]
    law: CapConstants

    @property
    def height(self) -> float:
        """Height of the surface [m]."""
        return sum(column.height for column in self.columns)

    @property
    def grain_height(self) -> float:
        """Mass of grains as a height [m], elastic strain included."""
        return sum(grain_height(column, self.law.K) for column in self.columns)

    @property
    def density_ratio(self) -> float:
        """Mean density ratio over the height [-]."""
        return mean_density_ratio(self.columns, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class SectionHistory:
    """Strokes on one section, arrays of shape (strokes,); forces per unit roller length.

    Parameters
    ----------
    make_up, bite : ndarray
        Thickness of mix added before the stroke, and height of the surface above the lowest generatrix [m].
    load, resistance : ndarray
        P and F [N/m].
    peak_pressure : ndarray
        Vertical stress under the lowest generatrix [Pa].
    leading, trailing : ndarray
        Distance of the contact's edges from the lowest generatrix, ahead and behind [m].
    work : ndarray
        Plastic work and increase of the locked-in elastic energy per unit length of travel [N/m].
    states : tuple of SectionState
        Section before the first stroke and after each, length strokes + 1.
    rate_factor : float
        Factor of the yield pressure by the rate of compaction [-].
    fed_density_ratio : float
        Density ratio of the mix as fed [-].
    """

    make_up: Array
    bite: Array
    load: Array
    resistance: Array
    peak_pressure: Array
    leading: Array
    trailing: Array
    work: Array
    states: tuple[SectionState, ...]
    rate_factor: float
    fed_density_ratio: float

    @property
    def count(self) -> int:
        """Number of strokes."""
        return len(self.load)

    @property
    def surface(self) -> Array:
        """Height of the surface after each stroke [m]."""
        return np.array([state.height for state in self.states[1:]])

    @property
    def density_ratio(self) -> Array:
        """Mean density ratio after each stroke [-]."""
        return np.array([state.density_ratio for state in self.states[1:]])

    @property
    def mass_residual(self) -> float:
        """Grains in the section after the last stroke over those of fill and feed, less 1 [-]."""
        fed = self.states[0].grain_height + self.fed_density_ratio * float(self.make_up.sum())
        return self.states[-1].grain_height / fed - 1

    @property
    def work_residual(self) -> float:
        """Resistance of all strokes over the work left in the mix, less 1 [-]; 0 without resistance."""
        total = float(self.resistance.sum())
        return abs(total - float(self.work.sum())) / total if total else 0.0


@dataclass(frozen=True)
class SectionOptions:
    """Rate of compaction, layers and accuracy of a section.

    Parameters
    ----------
    rate_factor : float
        Factor of the yield pressure [-].
    layers : int
        Largest number of merged layers between two strokes, at least 1.
    rtol : float
        Error of a step of the integration over the size of a stroke [-].
    until_density_ratio : float
        Mean density ratio after which no further stroke is computed [-].
    """

    rate_factor: float = 1.0
    layers: int = DEFAULT_LAYERS
    rtol: float = INTEGRATION_RTOL
    until_density_ratio: float = np.inf


def simulate_section(
    machine: FormingMachine,
    material: Compaction,
    fill: Fill,
    feed: Feed,
    make_up: MakeUp,
    options: SectionOptions,
) -> SectionHistory:
    """Compute all strokes on a section.

    Parameters
    ----------
    make_up : callable(index, SectionState) -> float
        Thickness of the mix added before a stroke [m].

    Returns
    -------
    SectionHistory

    Raises
    ------
    OverfilledError
        If grains and water fill the room below the lowest generatrix.
    BiteError
        If a bite would bury the roller to its axis.
    """
    columns, factor = _filled(fill, material, options.layers), options.rate_factor
    loosest = (*columns, Column(fill.height, feed.density_ratio))
    require_integrable(_stack(loosest, machine, material, factor), material)
    law = _stack(columns, machine, material, factor).law
    if not isinstance(law, CapConstants):
        raise ValueError("the process needs a `material` with constants, got tables over the density; use another law")
    state = SectionState(columns, law)
    rows, states = [], [state]
    for index in range(machine.stroke_count):
        added = make_up(index, state)
        raised = (*state.columns, Column(added, feed.density_ratio)) if added > 0 else state.columns
        bite = state.height + added - machine.height
        forces: tuple[float, ...] = (0.0,) * 6
        if bite > CONTACT_SHARE * machine.height:
            result = _stroke(_stack(raised, machine, material, factor), bite, index + 1, options.rtol)
            forces, raised = _results(result), result.columns
        rows.append((added, bite, *forces))
        state = SectionState(merge_layers(raised, options.layers, state.law.K), state.law)
        states.append(state)
        if state.density_ratio >= options.until_density_ratio:
            break
    made_up, bites, load, resistance, peak, leading, trailing, work = np.array(rows).T
    return SectionHistory(
        made_up, bites, load, resistance, peak, leading, trailing, work, tuple(states), factor, feed.density_ratio
    )


def thickness_at_pressure(
    state: SectionState,
    machine: FormingMachine,
    material: Compaction,
    density_ratio: float,
    pressure: float,
    rate_factor: float,
    rtol: float = INTEGRATION_RTOL,
) -> float:
    """Compute the make-up with which the stress under the lowest generatrix reaches a pressure.

        t = [h0 - h(s_v)]/[h_fresh(s_v)/h_fresh],    0 if the section alone exceeds the pressure

    Parameters
    ----------
    density_ratio : float
        Density ratio of the mix as fed [-].
    pressure : float
        Vertical stress s_v [Pa].

    Returns
    -------
    float
        Thickness of the loose mix [m].
    """
    layer = replace(_stack(state.columns, machine, material, rate_factor), gap=PLATE)
    fresh = replace(_stack((Column(1.0, density_ratio),), machine, material, rate_factor), gap=PLATE)
    room = machine.height - (layer.height - plate_indentation(layer, pressure, rtol))
    return max(room, 0.0) / (1 - plate_indentation(fresh, pressure, rtol))


def merge_layers(columns: Sequence[Column], count: int, bulk_modulus: float) -> tuple[Column, ...]:
    """Merge neighbours until `count` layers remain, those with the least difference of density over height first.

    Layers that have yielded under the same stress have the same density; fill that is denser than the feed stays apart
    until it yields.

    Parameters
    ----------
    columns : sequence of Column
        Layers from the base upwards.
    count : int
        Largest number of layers, at least 1.
    bulk_modulus : float
        Bulk modulus K of the mix [Pa].

    Returns
    -------
    tuple of Column
        Merged layers, of the same height and grains.
    """
    kept = list(columns)
    while len(kept) > count:
        differences = [
            abs(above.density_ratio - below.density_ratio) * min(below.height, above.height)
            for below, above in pairwise(kept)
        ]
        place = int(np.argmin(differences))
        kept[place : place + 2] = [_merged(kept[place], kept[place + 1], bulk_modulus)]
    return tuple(kept)


def grain_height(column: Column, bulk_modulus: float) -> float:
    """Return the mass of grains of a column at rest as a height [m]."""
    return column.density_ratio * column.height * float(np.exp(column.lateral_stress / 1.5 / bulk_modulus))


def mean_density_ratio(columns: Sequence[Column], low: float, high: float) -> float:
    """Return the mean density ratio between two shares of the height, 0 at the base and 1 at the surface [-].

    Parameters
    ----------
    columns : sequence of Column
        Layers from the base upwards.
    low, high : float
        Shares of the height [-], low < high.

    Returns
    -------
    float
        Mean density ratio [-].
    """
    heights = np.array([column.height for column in columns])
    tops = np.cumsum(heights)
    bounds = np.clip(np.append(0.0, tops), low * tops[-1], high * tops[-1])
    return float(np.diff(bounds) @ [column.density_ratio for column in columns] / (bounds[-1] - bounds[0]))


def overpressed_height(columns: Sequence[Column]) -> float:
    """Return the height of layers whose density ratio exceeds 1 [m], beyond the range of the law."""
    return sum(column.height for column in columns if column.density_ratio > 1)


def _filled(fill: Fill, material: Compaction, layers: int) -> tuple[Column, ...]:
    """Return the fill in layers of equal height."""
    if not fill.density_ratio > material.loose_density_ratio:
        raise ValueError(
            f"`density_ratio` of the fill must exceed that of Heckel's curve at its start, "
            f"{material.loose_density_ratio!r}, got {fill.density_ratio!r}"
        )
    return (Column(fill.height / layers, fill.density_ratio),) * layers


def _stack(
    columns: tuple[Column, ...], machine: FormingMachine, material: Compaction, rate_factor: float
) -> ColumnLayer:
    gap = GapShape(float(machine.roller_radius), 1.0)
    return column_layer(columns, material, rate_factor, gap, STRAINS["logarithmic"])


def _stroke(layer: ColumnLayer, bite: float, number: int, rtol: float) -> PassResult:
    if not bite < layer.gap.radius:
        raise BiteError(f"stroke {number} would bury the roller to its axis, {bite:.3g} m below the surface; feed less")
    if not bite < layer.max_indentation:
        raise OverfilledError(
            f"stroke {number} closes all pores: grains and water fill {layer.solid_height:.6g} m, and "
            f"{layer.height - bite:.6g} m remain below the lowest generatrix; feed less mix",
            number,
        )
    return layer.compute_pass(bite, rtol)


def _results(result: PassResult) -> tuple[float, ...]:
    """Return load, resistance, peak pressure, edges of the contact and work."""
    layer = result.layer
    trailing = float(layer.positions(result.unloading[-1:, 0])[0])
    plastic, elastic = result.work
    return (
        result.load, result.resistance, result.peak_pressure, layer.edge(result.indentation), trailing,
        plastic + elastic,
    )  # fmt: skip


def _merged(below: Column, above: Column, bulk_modulus: float) -> Column:
    """Return one layer with the height and the grains of two."""
    mass = np.array([grain_height(below, bulk_modulus), grain_height(above, bulk_modulus)])
    total = float(mass.sum())
    share = mass / total
    stress = float(share @ [below.lateral_stress, above.lateral_stress])
    height = below.height + above.height
    return replace(
        below,
        height=height,
        density_ratio=total / height * float(np.exp(-stress / 1.5 / bulk_modulus)),
        lateral_stress=stress,
        max_density_ratio=float(share @ [below.max_density_ratio, above.max_density_ratio]),
    )
