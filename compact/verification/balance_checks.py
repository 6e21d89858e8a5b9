"""Built-in checks of a study: what must be zero, or unchanged, whatever the answer is."""

from typing import NamedTuple

import numpy as np

from compact.analysis.contact_cases import value
from compact.analysis.engines import COMPACTING

# Shares that may be left over. Engines close their balances to these in their own tests; a study that does not is told.
LINEAR_WORK, COMPACTED_WORK, MASS, YIELD, EQUILIBRIUM = 1e-2, 2e-2, 2e-3, 1e-2, 1e-2
CYCLE_WORK, BREADTH = 1e-6, 1e-9
COMPACTED = {
    "mass_residual": ("mass", MASS),
    "yield_residual": ("stress within the cap", YIELD),
    "equilibrium_residual": ("equilibrium", EQUILIBRIUM),
}


class Check(NamedTuple):
    """What is checked, what is left over [-], and how much may be."""

    what: str
    left: float
    limit: float

    @property
    def holds(self):
        """Whether no more is left than may be."""
        return abs(self.left) <= self.limit


def checks(study):
    """Every `Check` of what the study has computed."""
    found = [*_contacts(study), *_cycles(study), *_published()]
    if "cams" in study.scene.output.wanted:
        found += [
            Check(f"constant breadth of the cam, {law}", cam.breadth_error / cam.breadth, BREADTH)
            for (law, follower), cam in study.cams.items()
            if follower == "roller" and not cam.cycle.forward.retraces
        ]
    return found


def _contacts(study):
    """Balances of work, and of a layer that stays pressed those of mass, stress and forces."""
    allowed = COMPACTED_WORK if study.scene.accuracy.engine in COMPACTING else LINEAR_WORK
    limits = COMPACTED | {"work_residual": ("work of the contact", allowed)}
    for contact in study.contacts:
        at = f"at {value(contact, 'speed')[0]:.4g} m/s"
        for name, (words, limit) in limits.items():
            left = value(contact, name)[0] if name in contact else None
            if left is not None:
                yield Check(f"{words} {at}", left, limit)


def _cycles(study):
    """Energy of a cycle less the work of resistance and friction: what moves the mass comes back."""
    for name, run in study.runs.items():
        if run.impulses:
            continue
        left = getattr(run, "energy_residual", None)
        if left is None:
            force = run.state.resistance + run.state.forces.guide_friction
            left = float(np.sum(run.weights * force * run.state.velocity)) / run.energy - 1
        yield Check(f"work over a cycle, {name}", left, CYCLE_WORK)


def _published():
    """Numbers of the publications, computed afresh: how many have changed on our side."""
    from compact.verification import published_numbers

    rows = published_numbers.rows()
    yield Check(f"{len(rows)} published numbers, computed again: changed", sum(not row.kept for row in rows), 0.0)
