"""Confined-compression (oedometric) columns under a rolling cylinder, and the engine "column"."""

import math
from typing import Any

from compact.engines.interface import ONE_MIX, PLASTIC, Case, Engine, Limit, Turning, shares_of
from compact.rolling_contact import Contact

LARGEST_RATIO = 2.0  # [-], height of a layer over the contact length up to which columns are valid


class ColumnEngine(Engine):
    """Columns that move vertically, by ordinary differential equations: milliseconds, no bow wave."""

    name, takes, cost, points_per_task = "column", "compacting layer", 0.03, 100
    mix_parameters = PLASTIC
    limits = (
        Limit("machine.gap_geometry", ("circle", "parabola"), "columns move vertically only", fixed=True),
        Limit(
            "machine.roller_condition", ("frictionless", "free"), "columns carry no shear", smooth=("sliding", "driven")
        ),
        Limit("layer.base", ("bonded",), "mix on a slipping base moves sideways, which no column does"),
        ONE_MIX,
        Limit(
            "mix.pore_air", ("one-way", "drained"), "columns under a held height do not yield to the air", fixed=True
        ),
    )

    def contact(self, case: Case, start: Contact | None = None) -> Contact:
        """Compute a pass over fresh mix."""
        from compact.engines.column.engine import roll

        return roll(case.layer, case.roller, case.material, case.speed)

    def roll_over(self, state: Any, case: Case) -> Contact:
        """Compute a pass over the columns of an earlier one, `state.layer` on `state.lower`."""
        from compact.engines.column.engine import roll, roll_over

        options: dict[str, Any] = {"exit_density_ratio": case.exit_density_ratio, **case.numerics}
        if state is None:
            return roll(case.layer, case.roller, case.material, case.speed, **options)
        return roll_over(state.layer, case.roller, case.material, case.speed, lower=state.lower, **options)

    def turning(self, contact: Contact, radius: float, release: float, film: float | None = None) -> Turning:
        """Return the shares of a contact that grows into fresh mix as its own imprint.

        The exponent n of the pressure over the depth is that of the force: F = p0 depth/(n + 1).
        """
        depth = contact.indentation
        force = abs(contact.resistance - (contact.air_resistance or 0.0))
        exponent = max(contact.peak_pressure * depth / force - 1, 0.0)
        return shares_of("imprint", math.sqrt(2 * radius * depth), exponent, release)

    def valid(self, height_ratio: float | None = None, detail: str | None = None) -> str:
        """Refuse high layers: columns have no bow wave."""
        high = height_ratio is not None and height_ratio > LARGEST_RATIO
        return f"no bow wave, layer {height_ratio:.2g} contact lengths high" if high else ""


COLUMN = ColumnEngine()
