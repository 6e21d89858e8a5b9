"""Spread of load and resistance of a forming process over the unmeasured parameters of its mix, by columns.

Each parameter takes the ends of its spread, one at a time, with the same closure. The factors on load and resistance
apply to lumped lifts as well: confined compression of the same product dominates both, and stresses of a mix without
cohesion are in proportion to 1/K_H in any dimension. Friction angle, cohesion and friction of the roller do not enter
columns; the factors are therefore a part of the spread.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compact.engines.process.closures import solve_closure
from compact.engines.process.roller_row import RollerRow


@dataclass(frozen=True)
class ParameterEffect:
    """Factors on load and resistance by one end of the spread of a parameter.

    Parameters
    ----------
    name : str
        Field of the constitutive law.
    value : float
        End of the spread, in the unit of the field.
    load, resistance : float
        Factors [-]; nan where the process with this value is refused.
    """

    name: str
    value: float
    load: float
    resistance: float


@dataclass(frozen=True)
class MixSpread:
    """Spread over several parameters.

    Parameters
    ----------
    effects : tuple of ParameterEffect
        Effects of both ends of each parameter.
    """

    effects: tuple[ParameterEffect, ...]

    def bounds(self, force: str) -> tuple[float, float]:
        """Return the factors of the low and the high end, of independent parameters: squared logarithms are added.

        Parameters
        ----------
        force : {"load", "resistance"}
            Force.

        Returns
        -------
        low, high : float
            Factors [-], of a load of 1.
        """
        logs: dict[str, list[float]] = {}
        for effect in self.effects:
            factor = getattr(effect, force)
            logs.setdefault(effect.name, [0.0]).append(0.0 if np.isnan(factor) else float(np.log(factor)))
        low, high = (np.sqrt(sum(end(each) ** 2 for each in logs.values())) for end in (min, max))
        return float(np.exp(-low)), float(np.exp(high))

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of parameters with a refused end."""
        return tuple(effect.name for effect in self.effects if np.isnan(effect.load))


def mix_spread(row: RollerRow, ends: Mapping[str, tuple[float, float]]) -> MixSpread:
    """Compute the process at both ends of the spread of each parameter.

    Parameters
    ----------
    row : RollerRow
        Process with the values.
    ends : mapping of str to (low, high)
        Spread of fields of the constitutive law, such as "heckel_slope" [1/Pa].

    Returns
    -------
    MixSpread
    """
    return MixSpread(tuple(_effect(row, name, value) for name, pair in ends.items() for value in pair))


def _effect(row: RollerRow, name: str, value: float) -> ParameterEffect:
    """Return the factors by one value of a parameter."""
    changed: dict[str, Any] = {name: value}
    material = replace(row.problem.material, **changed)
    problem = replace(row.problem, material=material)
    try:
        varied = replace(row, problem=problem, closed=solve_closure(problem, row.closure))
    except ValueError:  # beyond the nip angle, or no room for the mix
        return ParameterEffect(name, value, float("nan"), float("nan"))
    resistance = varied.resistance / row.resistance if row.resistance else 1.0
    return ParameterEffect(name, value, varied.load / row.load if row.load else 1.0, resistance)
