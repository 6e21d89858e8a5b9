"""Several passes of one roller: there and back over what lies, or with fresh mix spread in between.

    for rolled in passes(layer, roller, material, 0.2, (Pass(), Pass(forward=False), Pass(lift=0.05, height=0.27))):
        print(rolled.load, rolled.resistance, rolled.exit_density_ratio)

What a pass leaves, density and locked-in stress by rows, is what the next one meets; fresh mix comes on top, and no
mass is lost or made on the way. The mix remembers no direction (see `frame.Fed`): the way back differs from the way
there by the sign of the resistance alone.

A second pass at the same height
    Columns rebound as they were pressed: it costs nothing, its load is twice what the rebound bore of the first (a
    quarter in usual mix), its contact is symmetric. A wide thin bonded layer does the same. A layer that is thick
    against the contact rebounds by more than its contact shows, the roller meets it on a short one, whose peak is above
    that of the first pass, and the top flows once more. Of a circle 2 % deep in mix of E 60 MPa and K_H 13/MPa:

    contact in front over height       8      4      2      1     1/2    1/4
    resistance over that of the first .0012  .0033  .008   .023   .048   .067
    peak pressure over the first      0.99   0.97   0.93   1.04   1.17   1.27

    That is no fault of mesh or of handing over: 2 mm deep in 100 mm under a roller of 110 mm it is .075, .076 of the
    first at 6 and 12 increments; two rollers in one march, where nothing is handed over, give .074; 85 % of the work is
    done in the top 2.3 mm; further passes fade, .016, .005, .002, .001, and their contact gets symmetric.
"""

from dataclasses import dataclass, replace

import numpy as np

from compact.engines.column.column_pass import Column
from compact.material.laws import Compaction
from compact.numerics.validation import require_known, require_nonnegative, require_positive
from compact.rolling_contact import Layer

__all__ = ["Pass", "density", "passes", "there_and_back"]


@dataclass(frozen=True)
class Pass:
    """One pass: `lift` [m] of fresh mix is spread, or none, and the roller passes, along +x or back.

    height : of the lowest generatrix above the base [m]
    load : P [N/m]
    exit_density_ratio : mean over all that lies there, behind the roller

    One of the three at most. Without any the roller keeps to what it prescribes, its load or its peak pressure; where
    that is an indentation, it is that of the first pass, and later ones keep the height of the one before.
    """

    lift: float = 0.0
    height: float | None = None
    load: float | None = None
    exit_density_ratio: float | None = None
    forward: bool = True

    def __post_init__(self):
        require_nonnegative(lift=self.lift)
        told = {name: getattr(self, name) for name in ("height", "load", "exit_density_ratio")}
        given = {name: value for name, value in told.items() if value is not None}
        require_positive(**given)
        if len(given) > 1:
            raise ValueError(f"give one of `height`, `load`, `exit_density_ratio` at most, got {sorted(given)}")


def there_and_back(count):
    """So many passes over the same mix, every other one back, as a tuple of `Pass`."""
    require_positive(count=count)
    return tuple(Pass(forward=number % 2 == 0) for number in range(count))


def passes(layer, roller, material, speed, stages, *, engine="column", first=None, **numerics):
    """One result of the engine for each pass, a tuple of `ColumnContactResult` or `CompactionContactResult`.

    Parameters
    ----------
    layer : Layer of fresh mix before the first pass
    roller : Roller, what it prescribes for the passes that say nothing else
    material : Compaction
    speed : of passes forward along x [m/s], not 0
    stages : of `Pass`, one or more, or their number, there and back
    engine : "column" or "compaction"
    first : result of the first pass, if that is known
    numerics : as the engine's `roll` has them

    >>> from compact.rolling_contact import Roller
    >>> mix = Compaction(120e6, 0.3, heckel_slope=13e-6, loose_density_ratio=0.72, critical_slope=1.2,
    ...                  tensile_strength=14e3, fed_density_ratio=0.94)
    >>> roller = Roller(0.11, indentation=0.0093617, profile="circle")
    >>> for rolled in passes(Layer(0.2293617), roller, mix, 0.2, (Pass(), Pass(forward=False))):
    ...     print(f"{rolled.load:.0f} N/m, {abs(rolled.resistance):.0f} N/m")
    9639 N/m, 1570 N/m
    2484 N/m, 0 N/m
    """
    require_known("engine", engine, BEDS)
    if not isinstance(material, Compaction):
        raise ValueError(f"passes leave their mark on a `material` Compaction only, got {type(material).__name__}")
    stages = there_and_back(stages) if isinstance(stages, int) else tuple(stages)
    bed, done, lowest = BEDS[engine](layer, material), [], None
    for number, stage in enumerate(stages, start=1):
        bed = bed.under(stage.lift) if stage.lift else bed
        height, asked = bed.layer.height, dict(numerics)
        if stage.exit_density_ratio is not None:
            asked["exit_density_ratio"] = stage.exit_density_ratio
        if number == 1 and first is not None:
            done.append(first)
        else:
            pressed = _told(stage, roller, height, lowest, number)
            done.append(bed.rolled(pressed, speed if stage.forward else -speed, **asked))
        lowest = height - done[-1].indentation
        bed = bed.left(done[-1])
    return tuple(done)


def density(rolled):
    """What a pass leaves, by rows of mix from the base up: bottom [m], top [m], density ratio; shape (rows, 3)."""
    if hasattr(rolled, "exit"):
        heights, ratios = rolled.exit.heights, rolled.exit.points.density_ratio
    else:
        heights, ratios = np.array([(column.height, column.density_ratio) for column in rolled.columns]).T
    tops = np.cumsum(heights)
    return np.column_stack([tops - heights, tops, ratios])


def _told(stage, roller, height, lowest, number):
    """The roller of a pass over mix of a height, which stood at the height `lowest` in the pass before."""
    if stage.load is not None:
        return replace(roller, load=stage.load, indentation=None, peak_pressure=None)
    stand = stage.height
    if stand is None and lowest is not None and roller.indentation is not None:
        stand = lowest
    if stand is None:
        return roller
    if not stand < height:
        raise ValueError(
            f"`height` must lie below the mix, {height:.6g} m high before pass {number}, got {float(stand)!r}"
        )
    return replace(roller, indentation=height - stand, load=None, peak_pressure=None)


@dataclass(frozen=True)
class _Bed:
    """Mix between two passes: a layer, fresh as long as there is no `rest` of an earlier pass."""

    layer: Layer
    material: Compaction
    rest: object = None

    def under(self, lift):
        """The same with fresh mix on top."""
        higher = replace(self.layer, height=self.layer.height + lift)
        return replace(self, layer=higher, rest=None if self.rest is None else self.covered(lift))

    def left(self, rolled):
        """What a pass leaves of it."""
        return replace(self, layer=replace(self.layer, height=rolled.exit_height), rest=self.rest_of(rolled))


class _Columns(_Bed):
    """Mix between passes of the engine "column"; its rest are `Column`s."""

    def covered(self, lift):
        return (*self.rest, Column(lift, self.material.fed_density_ratio))

    def rest_of(self, rolled):
        return rolled.columns

    def rolled(self, roller, speed, **asked):
        from compact.engines.column import engine as column

        if self.rest is None:
            return column.roll(self.layer, roller, self.material, speed, **asked)
        return column.roll_over(self.rest, roller, self.material, speed, **asked)


class _Rows(_Bed):
    """Mix between passes of the engine "compaction"; its rest is a `LayerState`."""

    def covered(self, lift):
        return self.rest.with_lift(lift, self.material)

    def rest_of(self, rolled):
        return rolled.exit

    def rolled(self, roller, speed, **asked):
        from compact.engines.compaction import engine as compaction

        wanted = asked.get("exit_density_ratio")
        fed = self.material.fed_density_ratio if self.rest is None else self.rest.density_ratio
        if wanted is not None and wanted > fed:  # a first guess, that of a layer without rebound
            depth = self.layer.height * (1 - fed / wanted)
            roller = replace(roller, indentation=depth, load=None, peak_pressure=None)
        return compaction.roll(self.layer, roller, self.material, speed, fed_layer=self.rest, **asked)


BEDS = {"column": _Columns, "compaction": _Rows}
