"""Several passes of one roller, forward and back over the same mix, or with fresh mix spread in between.

    for result in passes(layer, roller, material, 0.2, (Pass(), Pass(forward=False), Pass(lift=0.05, height=0.27))):
        print(result.load, result.resistance, result.exit_density_ratio)

Density and residual stress of each row behind a pass are the initial state of the next one. Fresh mix is added on top,
and mass is conserved. The state of the mix has no direction: the return stroke differs from the forward stroke by the
sign of the resistance only.

A second pass at the same height
    In the column model the elastic recovery is reversible: the second pass has no resistance, its load is twice the
    load of the recovery in the first (a quarter in usual mix), its contact is symmetric. A wide thin bonded layer
    behaves alike. A layer that is thick compared with the contact recovers by more than its contact shows. The second
    contact is then short, its peak exceeds that of the first pass, and the top yields again. For a circular roller,
    indentation 2 % of the height, E = 60 MPa and K_H = 13/MPa:

    contact in front over height       8      4      2      1     1/2    1/4
    resistance over that of the first .0012  .0033  .008   .023   .048   .067
    peak pressure over the first      0.99   0.97   0.93   1.04   1.17   1.27

    The table is without a saturation limit. With it, for an indentation of 2 mm in 100 mm under a roller of radius
    110 mm, the ratio is .077 on 8 and on 12 elements; both strokes by elements that move with the mix, without transfer
    of a state, have .076. The top 10 mm, which horizontal tension behind the first pass has loosened, dissipate more
    than 90 % of the work. In further passes the ratio decays to .023 and .017.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from compact.engines import ENGINES
from compact.engines.interface import Case, Engine
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.validation import require_known, require_nonnegative, require_positive
from compact.rolling_contact import Contact, Layer, Roller

__all__ = ["Pass", "density", "passes", "there_and_back"]


@dataclass(frozen=True)
class Pass:
    """One pass of the roller.

    At most one of `height`, `load` and `exit_density_ratio` is given. Without any, the target of the roller holds: its
    load or peak pressure in every pass, its indentation in the first; later passes then keep the height of the one
    before.

    Parameters
    ----------
    lift : float
        Thickness of fresh mix that is spread before the pass [m].
    height : float, optional
        Height of the lowest generatrix above the rigid base [m].
    load : float, optional
        Load per unit roller length [N/m].
    exit_density_ratio : float, optional
        Mean density ratio of the whole layer behind the roller [-].
    forward : bool
        Whether the roller travels along +x.
    """

    lift: float = 0.0
    height: float | None = None
    load: float | None = None
    exit_density_ratio: float | None = None
    forward: bool = True

    def __post_init__(self) -> None:
        require_nonnegative(lift=self.lift)
        names = "height", "load", "exit_density_ratio"
        given = {name: value for name in names if (value := getattr(self, name)) is not None}
        require_positive(**given)
        if len(given) > 1:
            raise ValueError(f"give at most one of `height`, `load`, `exit_density_ratio`, got {sorted(given)}")


class PassEnd(NamedTuple):
    """State of the mix and heights [m] behind a pass, which another process takes as first pass."""

    indentation: float
    exit: Any
    exit_height: float
    lower_height: float | None

    @classmethod
    def of(cls, contact: Any) -> Self:
        """Return the end of a pass over compacting mix."""
        return cls(*(getattr(contact, name) for name in cls._fields))


def there_and_back(count: int) -> tuple[Pass, ...]:
    """Return a number of passes over the same mix, every second one back."""
    require_positive(count=count)
    return tuple(Pass(forward=number % 2 == 0) for number in range(count))


def passes(
    layer: Layer,
    roller: Roller,
    material: Compaction,
    speed: float,
    stages: int | Sequence[Pass],
    *,
    engine: str = "column",
    first: Contact | None = None,
    **numerics: Any,
) -> tuple[Contact, ...]:
    """Compute several passes of one roller.

    Parameters
    ----------
    layer : Layer
        Fresh mix before the first pass; it may lie on a lower lift, to which densities behind a pass do not refer.
    roller : Roller
        Its target holds for passes without their own.
    speed : float
        Speed of forward passes along x [m/s], not 0.
    engine : {"column", "compaction"}

    Returns
    -------
    tuple of Contact
        One contact per pass.

    Examples
    --------
    >>> from compact.rolling_contact import Roller
    >>> mix = Compaction(unloading_modulus=120e6, poisson=0.3, heckel_slope=13e-6,
    ...                  loose_density_ratio=0.72, critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.94)
    >>> roller = Roller(0.11, indentation=0.0093617, profile="circle")
    >>> for result in passes(Layer(0.2293617), roller, mix, 0.2, (Pass(), Pass(forward=False))):
    ...     print(f"{result.load:.0f} N/m, {abs(result.resistance):.0f} N/m")
    9639 N/m, 1570 N/m
    2484 N/m, 0 N/m
    """
    require_known("engine", engine, ENGINES)
    if not isinstance(material, Compaction):
        raise ValueError(f"several passes require a `material` Compaction, got {type(material).__name__}")
    stages = there_and_back(stages) if isinstance(stages, int) else tuple(stages)
    case = Case(layer=layer, roller=roller, material=material, speed=speed, numerics=numerics)
    return roll_stages(case, stages, ENGINES[engine], first)


def roll_stages(
    case: Case, stages: Sequence[Pass], engine: Engine, first: Contact | PassEnd | None = None
) -> tuple[Contact, ...]:
    """Compute several passes of the roller of a case; see `passes`."""
    layer, state = case.layer, None  # of the mix behind the last pass; None of fresh mix
    lowest, lower_height = None, 0.0 if layer.lower_lift is None else layer.lower_lift.thickness
    done: list[Any] = []
    for number, stage in enumerate(stages, start=1):
        if stage.lift:
            layer = replace(layer, height=layer.height + stage.lift)
            state = None if state is None else state.with_lift(stage.lift, case.material)
        if number == 1 and first is not None:
            done.append(first)
        else:
            roller = _roller_of(stage, case.roller, layer.height + lower_height, lowest, number)
            speed = case.speed if stage.forward else -case.speed
            target = stage.exit_density_ratio
            now = replace(case, layer=layer, roller=roller, speed=speed, exit_density_ratio=target)
            done.append(engine.roll_over(state, now))
        lowest, state = layer.height + lower_height - done[-1].indentation, done[-1].exit
        layer, lower_height = replace(layer, height=done[-1].exit_height), done[-1].lower_height or 0.0
    return tuple(done)


def density(result: Contact) -> Array:
    """Return the density over the height behind a pass.

    Returns
    -------
    Array, shape (rows, 3)
        Bottom [m], top [m] and density ratio [-] of each row of mix, of a lower lift too, from the base upwards.
    """
    heights, ratios = result.exit.density_rows
    tops = np.cumsum(heights)
    return np.column_stack([tops - heights, tops, ratios])


def _roller_of(stage: Pass, roller: Roller, height: float, lowest: float | None, number: int) -> Roller:
    """Return the roller of a pass; `height` of the surface, `lowest` generatrix in the pass before [m]."""
    if stage.load is not None:
        return replace(roller, load=stage.load, indentation=None, peak_pressure=None)
    target = stage.height
    if target is None and lowest is not None and roller.indentation is not None:
        target = lowest
    if target is None:
        return roller
    if not target < height:
        surface = f"the surface of the mix, {height:.6g} m before pass {number}"
        raise ValueError(f"`height` must be below {surface}, got {float(target)!r}")
    return replace(roller, indentation=height - target, load=None, peak_pressure=None)
