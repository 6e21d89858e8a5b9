"""Viscoelastic layer under a rolling cylinder by plane-strain finite elements, the engine "fem"."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from compact.engines.interface import LINEAR, NO_AIR, RECOVERS, RIGID_BASE, Case, Engine
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    from compact.resistance import ResistanceExpansion


class FemEngine(Engine):
    """Finite elements of a linear layer, with stick and slip of the roller and an error estimate."""

    name, takes, cost = "fem", "linear layer", 0.55
    mix_parameters = (*LINEAR, "steel_friction")
    limits = (RIGID_BASE, NO_AIR, *RECOVERS)
    optional_keys = ("machine.roller_torque",)

    def contact(self, case: Case, start: Contact | None = None) -> Contact:
        """Solve the contact to the tolerance of the case."""
        from compact.engines.fem.engine import roll

        options = {"torque": case.torque, "estimate": case.estimate} | case.within("tolerance")
        return roll(case.layer, case.roller, case.material, case.speed, **options)

    def expand(self, case: Case) -> "ResistanceExpansion":
        """Expand the resistance to first order in the acceleration, of a rolling roller without friction."""
        from compact.engines.fem.speed_derivative import expand_resistance

        roller = case.roller
        if roller.rolling in ("free", "driven"):
            roller = replace(roller, rolling="frictionless")
        within = case.within("tolerance")
        return expand_resistance(case.layer, roller, case.material, case.speed, estimate=False, **within)

    def fields(self, contact: Any) -> Any:
        """Return a mesh with displacement, stress and pressure."""
        from compact.engines.fem.engine import field_mesh

        return field_mesh(contact)


FEM = FemEngine()
