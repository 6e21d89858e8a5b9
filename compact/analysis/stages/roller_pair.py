"""Gap, strip and speeds of two equal rollers that draw mix in, compared with Johanson's theory of their nip angle.

Johanson's powder has an effective angle of friction, that on the roll, and s_v ~ k^K. Both angles are those of the mix;
K is the mean slope of its confined compression between feed and strip. His load is that at the peak pressure of the
engine, over the arc from his nip angle to the gap, with powder ahead of the layer's edge too.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from compact.analysis.contact_cases import contact_inputs
from compact.engines.column.roller_pair import RollerPair
from compact.material.laws import Compaction
from compact.material.mix import Mix
from compact.rolling_contact import ContactResult
from compact.scene.loader import Scene

UNITS = {
    "gap": "m", "strip_thickness": "m", "entry_angle": "rad", "rim_over_feed": "1", "strip_over_feed": "1",
    "power": "W", "johanson_compressibility": "1", "johanson_nip_angle": "rad", "johanson_load": "N/m",
}  # fmt: skip


@dataclass(frozen=True)
class PairAnswer:
    """One contact of a pair of rollers.

    Parameters
    ----------
    gap, strip_thickness : float
        Gap between the rollers and thickness of the strip behind them [m].
    entry_angle : float
        Angle at which the fed layer touches the rollers [rad].
    rim_over_feed : float or None
        Speed of the rims over that of the fed mix [-]; None for columns, which move with the rollers.
    strip_over_feed : float
        Speed of the strip over that of the fed mix, by its mass [-]; 1 for columns.
    power : float
        Power of both rollers over their length in the scene [W].
    johanson_compressibility : float or None
        K of the mix between feed and strip [-]; None if the theory has no nip angle.
    johanson_nip_angle, johanson_load : float or None
        Nip angle [rad], and load at the peak pressure of the engine [N/m].
    """

    gap: float
    strip_thickness: float
    entry_angle: float
    rim_over_feed: float | None
    strip_over_feed: float
    power: float
    johanson_compressibility: float | None = None
    johanson_nip_angle: float | None = None
    johanson_load: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Convert to nested dictionaries with "value" and "unit"."""
        return {name: {"value": value, "unit": UNITS[name]} for name, value in asdict(self).items()}


def pair_answer(scene: Scene, mix: Mix, result: ContactResult, speed: float) -> PairAnswer | None:
    """Evaluate one contact of a pair of rollers; None for a scene with another roller condition.

    Parameters
    ----------
    result : ContactResult
        Contact at the speed by the engine of the scene.
    speed : float
        Speed of the fed mix [m/s].
    """
    if scene.machine.roller_condition != "pair":
        return None
    layer, roller, material = contact_inputs(scene, mix, scene.accuracy.engine, speed)
    assert isinstance(material, Compaction)  # of the engines that compute a pair
    found: Any = result
    gap = 2 * (layer.height - found.indentation)
    solids = layer.height * material.fed_density_ratio
    creep, exit_layer = getattr(result, "creep", None), getattr(result, "exit", None)
    answer = PairAnswer(
        gap=gap,
        strip_thickness=2 * found.exit_height,
        entry_angle=float(np.arcsin(min(result.leading / roller.radius, 1.0))),
        rim_over_feed=None if creep is None else 1 + creep,
        strip_over_feed=1.0 if exit_layer is None else solids / exit_layer.solid_height(material),
        power=2 * abs(result.resistance * speed) * scene.machine.roller_length,
    )
    try:
        pair = RollerPair.of_mix(material, roller.radius, gap, found.exit_density_ratio, roller.friction)
        nip = pair.nip_angle
    except ValueError:  # friction of the roller above that of the mix, or no equal gradients
        return answer
    load = result.peak_pressure * roller.radius * pair.force_factor(nip)
    return PairAnswer(
        **asdict(answer) | {
            "johanson_compressibility": pair.compressibility, "johanson_nip_angle": nip, "johanson_load": load,
        }
    )  # fmt: skip
