"""Viscoelastic layer under a rolling cylinder by a Galerkin method in Jacobi polynomials, the engine "spectral"."""

from typing import TYPE_CHECKING

from compact.engines.interface import LINEAR, NO_AIR, RECOVERS, RIGID_BASE, Case, Engine, Limit
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    from compact.resistance import ResistanceExpansion


class SpectralEngine(Engine):
    """Integral equation of a linear layer: hundredths of a second, with an error estimate."""

    name, takes, cost, points_per_task = "spectral", "linear layer", 0.02, 5
    mix_parameters = LINEAR
    limits = (
        Limit("machine.gap_geometry", ("circle", "parabola"), "its gap is measured on the undeformed surface"),
        Limit(
            "machine.roller_condition", ("frictionless", "sliding", "driven"),
            "its rollers have no friction or slip everywhere", smooth=("free",),
        ),
        RIGID_BASE,
        NO_AIR,
        *RECOVERS,
    )  # fmt: skip

    def contact(self, case: Case, start: Contact | None = None) -> Contact:
        """Solve the contact to the tolerance of the case."""
        from compact.engines.spectral.engine import roll

        return roll(case.layer, case.roller, case.material, case.speed, **case.within("rtol"))

    def expand(self, case: Case) -> "ResistanceExpansion":
        """Expand the resistance to first order in the acceleration."""
        from compact.engines.spectral.speed_derivative import expand_resistance

        return expand_resistance(case.layer, case.roller, case.material, case.speed, **case.within("rtol"))


SPECTRAL = SpectralEngine()
