"""The engine of `accuracy.engine = "auto"`: the cheapest that may size the drive of a scene, and the reason.

Irreversible compaction causes most of the resistance, so that an engine must have a density of the fed mix. The height
of the layer over the contact length is estimated without a contact:

    H/L,    L = sqrt(2 R depth),    depth = H (k/k_fed - 1)

The model that another engine corrects, columns, needs a fit to forces of a roller as well: without one it has 0.3 to
0.7 of the resistance by finite elements on lifts of 0.5 to 1.7 contact lengths (R 0.09 m, k_fed 0.85 and 0.94).
"""

import math
from collections.abc import Mapping
from typing import Any

from compact.engines import BUILT_IN
from compact.engines.interface import Engine
from compact.scene.constraints import value_at

AUTO = "auto"
SIZES = ("machine.roller_radius", "mix.density_ratio", "layer.fed_density_ratio")
FED, SLOPE = SIZES[-1], "heckel_slope"


def choose_engine(data: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name of the engine of a scene, given as nested tables, and the reason as a clause.

    Where no engine may size the drive, it is the last of them.
    """

    def value(key: str) -> Any:
        return value_at(data, tuple(key.split(".")))

    radius, density_ratio, fed = map(value, SIZES)
    ratio = _height_ratio(radius, density_ratio, fed, value("layer.lift_thickness") or value("product.height"))
    fitted = {SLOPE, FED.rpartition(".")[2]} <= {*(value("mix.fitted_at.parameters") or ())}
    able = sorted((each for each in BUILT_IN.values() if each.reads(FED)), key=lambda each: each.cost)
    against = {each.name: _reason_against(each, value, ratio, fitted) for each in able}
    chosen = next((each.name for each in able if not against[each.name]), able[-1].name)
    passed = [f"{name} has {words}" for name, words in against.items() if words and name != chosen]
    return chosen, "; ".join(["the cheapest that may size this scene", *passed])


def _reason_against(engine: Engine, value: Any, ratio: float | None, fitted: bool) -> str:
    """State what an engine lacks on a scene; empty if nothing."""
    if found := engine.valid(ratio):
        return found
    if not fitted and any(each.low_fidelity == engine.name for each in BUILT_IN.values()):
        return "no fit to forces of a roller"
    for limit in engine.limits:
        given = value(limit.key)
        if not (given is None or limit.fixed or limit.takes(given, value("mix.overrides.steel_friction"))):
            return f"no {limit.key} = {given}"
    return ""


def _height_ratio(radius: Any, density_ratio: Any, fed: Any, height: Any) -> float | None:
    """Estimate the height of the layer over the contact length; None without these numbers."""
    if not all(isinstance(each, float) and each > 0 for each in (radius, density_ratio, fed, height)):
        return None
    strain = density_ratio / fed - 1
    return math.sqrt(height / (2 * radius * strain)) if strain > 0 else None
