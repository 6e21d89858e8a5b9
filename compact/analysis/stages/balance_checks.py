"""Balance checks of a study: residuals that vanish for an exact solution, each with its limit.

Checked are the balances of energy, mass and forces of every contact, the energy balance of every cycle, and the
constant breadth of every cam. The engines satisfy the same limits in their own tests.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from compact.analysis.stages.contacts import ContactStage
from compact.analysis.stages.drives import DriveStage, Stages

LINEAR_WORK_LIMIT = 1e-2  # [-], of the work of a contact with a linear layer
COMPACTED_WORK_LIMIT = 2e-2  # [-], of the work of a contact with a compacting layer
CYCLE_WORK_LIMIT = 1e-6  # [-], of the work of resistance and friction over a cycle
BREADTH_LIMIT = 1e-9  # [-], of the breadth of a cam
RESIDUALS = {  # field of a contact -> (term, limit [-]); compacting layers only
    "mass_residual": ("mass", 2e-3),
    "yield_residual": ("stress within the cap", 1e-2),
    "equilibrium_residual": ("equilibrium", 1e-2),
}


@dataclass(frozen=True)
class BalanceCheck:
    """Residual of one balance and its limit.

    Parameters
    ----------
    residual : float
        Relative residual, or a count [-].
    limit : float
        Largest admissible magnitude of the residual [-].
    """

    name: str
    residual: float
    limit: float

    @property
    def passed(self) -> bool:
        """True if the residual is within its limit."""
        return abs(self.residual) <= self.limit


def balance_checks(stages: Stages) -> list[BalanceCheck]:
    """Check every contact, run and cam of a scene."""
    checks = [*_contact_checks(stages.contacts), *_cycle_checks(stages.drive)]
    if "cams" in stages.laws.scene.output.items:
        checks += [
            BalanceCheck(f"constant breadth of the cam, {law}", cam.breadth_error / cam.breadth, BREADTH_LIMIT)
            for (law, follower), cam in stages.laws.cams.items()
            if follower == "roller" and not cam.cycle.forward.retraces
        ]
    return checks


def _contact_checks(stage: ContactStage) -> Iterator[BalanceCheck]:
    """Check energy of every contact; of a compacting layer also mass, yield condition and forces."""
    work_limit = COMPACTED_WORK_LIMIT if stage.compacts else LINEAR_WORK_LIMIT
    limits = RESIDUALS | {"work_residual": ("work of the contact", work_limit)}
    for contact in stage.records:
        case = f"at {contact.speed:.4g} m/s"
        for name, (term, limit) in limits.items():
            residual = getattr(contact, name)
            if residual is not None:
                yield BalanceCheck(f"{term} {case}", residual, limit)


def _cycle_checks(stage: DriveStage) -> Iterator[BalanceCheck]:
    """Compare the energy of a cycle with the work of resistance and guide friction."""
    for name, run in stage.runs.items():
        if run.impulses:
            continue
        residual = getattr(run, "energy_residual", None)
        if residual is None:
            force = run.state.resistance + run.state.forces.guide_friction
            residual = float(np.sum(run.weights * force * run.state.velocity)) / run.energy - 1
        yield BalanceCheck(f"work over a cycle, {name}", residual, CYCLE_WORK_LIMIT)
