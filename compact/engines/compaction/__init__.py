"""Irreversible compaction of the layer under a rolling cylinder by plane-strain finite elements: "compaction"."""

import math
from dataclasses import replace
from typing import Any

from compact.engines.interface import ONE_MIX, PLASTIC, Case, RateEngine, Turning, shares_of
from compact.rolling_contact import Contact

SAME_LAYER = 5e-5  # [-], of the height before the pass; its change with speed, by the elastic recovery, is smaller
# [-], of peaks behind 1 and 3 MN/m by the shares after a turn: the largest of 18 histories of lifts and loose make-ups
# differs by 5.2 % (docs/theory/resistance.md)
PEAK_ERROR = 0.06


class CompactionEngine(RateEngine):
    """Finite strain of a compacting layer with its bow wave: seconds to minutes, each contact a start of the next."""

    name, takes, cost, points_per_task, line = "compaction", "compacting layer", 8.0, 8, 8
    mix_parameters = (*PLASTIC, "steel_friction")
    limits = (ONE_MIX,)
    optional_keys = ("machine.roller_torque",)
    low_fidelity, turning_error = "column", PEAK_ERROR

    def contact(self, case: Case, start: Any = None) -> Contact:
        """Compute a pass over fresh mix, from a contact in the same direction on the same base, of any height."""
        from compact.engines.compaction.engine import roll

        if self.equal(case, start):
            return replace(start, speed=case.speed)
        options, layer = self._options(case), case.layer
        if self._continues(case, start):
            options["start"] = start
            layer = start.layer if self._same_height(case, start) else layer
        return roll(layer, case.roller, case.material, case.speed, **options)

    def roll_over(self, state: Any, case: Case) -> Contact:
        """Compute a pass over the layer of an earlier one."""
        from compact.engines.compaction.engine import roll

        roller, target = case.roller, case.exit_density_ratio
        before = case.material.fed_density_ratio if state is None else state.density_ratio
        if target is not None and target > before:  # initial guess, for a layer without elastic recovery
            depth = case.layer.height * (1 - before / target)
            roller = replace(roller, indentation=depth, load=None, peak_pressure=None)
        return roll(case.layer, roller, case.material, case.speed, fed_layer=state, **self._options(case))

    def target(self, case: Case) -> tuple[str, float]:
        """Return the density behind the roller where it is prescribed: the depth follows from it."""
        density = case.exit_density_ratio
        return case.roller.target if density is None else ("exit_density_ratio", density)

    def equal(self, case: Case, known: Any) -> bool:
        """Return True for mix without rate sensitivity, if nothing but the speed differs."""
        if not (self._continues(case, known) and self._same_height(case, known)):
            return False
        if case.speed == known.speed or case.material != known.material or case.material.rate_sensitivity:
            return False
        as_found = replace(known.roller, indentation=known.indentation, load=None, peak_pressure=None)
        return case.roller in (known.roller, as_found)

    def as_start(self, contact: Contact | None) -> Contact | None:
        """Return the contact."""
        return contact

    def turning(self, contact: Contact, radius: float, release: float, film: float | None = None) -> Turning:
        """Return the shares of a contact that climbs onto fresh mix and builds up its bow wave."""
        depth = contact.indentation
        return shares_of("wave", math.sqrt(2 * radius * depth), depth, contact.bow_wave, release, thickness=film)

    def fields(self, contact: Any) -> Any:
        """Return a mesh with displacement, stress, pressure, density ratio and plastic work."""
        from compact.engines.compaction.engine import field_mesh

        return field_mesh(contact)

    def noise(self, contact: Any) -> float:
        """Add the errors by the drift and by the start of the search."""
        parts = getattr(contact, "error_parts", None)
        return 0.0 if parts is None else float(parts.drift[1] + parts.start[1])

    @staticmethod
    def _continues(case: Case, start: Any) -> bool:
        """Return True for a contact in the same direction on the same base."""
        if start is None or not start.speed * case.speed > 0:
            return False
        return bool(replace(start.layer, height=case.layer.height) == case.layer)

    @staticmethod
    def _same_height(case: Case, start: Any) -> bool:
        """Return True if the layer is as high as that of the start, but for the elastic recovery."""
        return bool(abs(start.layer.height / case.layer.height - 1) < SAME_LAYER)

    @staticmethod
    def _options(case: Case) -> dict[str, Any]:
        """Return the keywords of `engine.roll`."""
        options: dict[str, Any] = {name: getattr(case, name) for name in ("torque", "progress", "exit_density_ratio")}
        return options | ({"max_contact_angle": None} if case.unlimited else {}) | dict(case.numerics)


COMPACTION = CompactionEngine()
