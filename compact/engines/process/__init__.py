"""Forming process: strokes of one roller over a moving mould, fed before every stroke; the engine "process"."""

import math
from typing import Any

from compact.engines.compaction import PEAK_ERROR
from compact.engines.interface import FLOOR, ONE_MIX, PLASTIC, Limit, RateEngine, Turning, shares_of
from compact.rolling_contact import Contact


class ProcessEngine(RateEngine):
    """All strokes of the forming process in place of one pass over a layer; its case is a process and a speed."""

    name, takes, cost = "process", "process", 0.4
    mix_parameters = (*PLASTIC, "steel_friction")
    limits = (
        Limit("machine.roller_condition", ("free",), "its rollers roll freely over the bed"),
        Limit("machine.gap_geometry", ("deformed",), "its lifts press the deformed surface", fixed=True),
        Limit("layer.base", ("bonded",), "the mix sticks to the base of the mould"),
        Limit("layer.passes", (1,), "the strokes of [process] are its passes"),
        Limit("layer.return_stroke", ("fresh",), "`process.feeds` states the strokes that are fed", fixed=True),
        Limit("layer.lift_thickness", (None,), "the whole height of the product lies under the roller"),
        *(
            Limit(f"contact.{name}", (None,), "the closure of [process] determines the contact")
            for name in ("indentation", "load", "peak_pressure", "held")
        ),
        ONE_MIX,
        Limit("layer.lower_lift", (None,), "the whole height of the product lies under the roller"),
        Limit("mix.pore_air", ("one-way", "drained"), "its lifts do not yield to the air", fixed=True),
    )
    fed_key, turning_error = "process.feed_density_ratio", PEAK_ERROR

    def contact(self, case: Any, start: Any = None) -> Contact:
        """Compute the means over the strokes under a roller at a speed of the cart."""
        return case.process.row_at(abs(case.speed)).contact(case.speed)

    def turning(self, contact: Contact, radius: float, release: float, film: float | None = None) -> Turning | None:
        """Return the shares of a roller that climbs from its own track onto the make-up, a film, without a wave."""
        depth = contact.indentation
        return shares_of("wave", math.sqrt(2 * radius * depth), depth, 0.0, release, thickness=depth) if depth else None

    def valid(self, height_ratio: float | None = None, detail: str | None = None) -> str:
        """Refuse columns alone: the confined floor."""
        return FLOOR if detail == "columns" else ""


PROCESS = ProcessEngine()
