"""Peaks of all laws on many elastic drives at once, within 1e-3 of their runs.

They tell which laws may be first, which alone are then run.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.analysis.stages.drives import same_motions
from compact.analysis.stages.ensemble import Change, Peaks
from compact.analysis.stages.resistance import ResistanceLaw
from compact.analysis.stages.robust_range import missing_for_pool
from compact.analysis.stages.verdict import SIZING_PEAKS
from compact.machine.cart import Cart
from compact.motion.profile import Cycle
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from compact.analysis.robust.drive_pool import PassTable

Springs = Mapping[str, tuple[float, float]]  # stiffness [N/m] and damping [N s/m] of drives by label
POOL_ERROR = 1e-3  # [-], of a peak on an elastic drive
POOL_KEYS = "machine.mass", "machine.weight", "drive.stiffness", "drive.damping"
DECIDED = 10 * POOL_ERROR  # [-], of the least peak, beyond which a law is not first


class PooledLaws:
    """Laws that a pool of drives simulates: those that mirror their forward stroke without a jump of the velocity.

    Parameters
    ----------
    cycles : mapping
        All laws.
    others : mapping
        Laws that may be first where the pool does not simulate them.
    """

    def __init__(self, cycles: Mapping[str, Cycle], others: Iterable[str] = ()) -> None:
        self.cycles, self.others = cycles, {*others}

    @cached_property
    def tables(self) -> dict[str, "PassTable"]:
        """Table of each law that is simulated; those of one motion have one table."""
        from compact.analysis.robust.drive_pool import pass_table  # compiled code, imported when required

        simulated = {name: each for name, each in self.cycles.items() if not (each.forward.retraces or jumps(each))}
        same = same_motions(simulated)
        tables = {name: pass_table(simulated[name].forward) for name in {*same.values()}}
        return {name: tables[same[name]] for name in simulated}

    def peaks(self, cart: Cart, resistance: ResistanceLaw, springs: Springs) -> dict[str, Peaks]:
        """Return the peaks by drive, criterion and law [N] or [W]; infinite without a periodic cycle."""
        laws = self.tables if springs else {}
        if not laws:
            return {}
        from compact.analysis.robust.drive_pool import DrivePool, travel_table

        stiffness, damping = (np.array(each) for each in zip(*springs.values(), strict=True))
        fastest = max(float(each.velocity.max()) for each in laws.values())
        table = travel_table(cart, resistance, next(iter(laws.values())).stroke, fastest)
        ratio = damping / (2 * np.sqrt(stiffness * cart.mass))
        pool = DrivePool.of(cart.mass, np.column_stack([stiffness, ratio]), (table,))
        alike = {}
        for law in {id(each): each for each in laws.values()}.values():
            forces = pool.simulate(law)
            settled = np.where(forces.passes > 0, 1.0, np.inf)
            alike[id(law)] = forces.peaks * settled, np.abs(forces.powers(law)).max(axis=1) * settled
        return {
            drive: {
                by: {name: float(alike[id(law)][i][number]) for name, law in laws.items()}
                for i, by in enumerate(SIZING_PEAKS)
            }
            for number, drive in enumerate(springs)
        }

    def likely_firsts(
        self, scene: Scene, cart: Cart, met: ResistanceLaw, changes: Iterable[Change]
    ) -> dict[str, set[str]]:
        """Return the laws that may be first by label of a change of drive, cart or resistance [N].

        Drives with one cart and resistance are one pool; a scene or change of which a pool has no model is left out.
        """
        pools: dict[Any, dict[str, tuple[float, float]]] = {}
        found = defaultdict[str, set[str]](set)  # two changes may have a label in common
        if missing_for_pool(scene, cart):
            return found
        for each in changes:
            resistance = each.resistance or met
            mass, weight, *spring = (each.keys.get(key, attrgetter(key)(scene)) for key in POOL_KEYS)
            if is_mirrored(resistance):
                pools.setdefault((mass, weight, resistance), {})[each.label] = spring[0], spring[1]
        for (mass, weight, resistance), springs in pools.items():
            for label, peaks in self.peaks(replace(cart, mass=mass, weight=weight), resistance, springs).items():
                found[label] |= self._near_first(peaks)
        return found

    def _near_first(self, peaks: Peaks) -> set[str]:
        """Laws that may be first by peaks of the pool; those without a periodic cycle, or a table, may."""
        near = {law for law in self.cycles if law not in self.tables} & self.others
        for found in peaks.values():
            limit = (1 + DECIDED) * min(found.values())
            near |= {law for law, peak in found.items() if peak <= limit or math.isinf(peak)}
        return near


def is_mirrored(resistance: ResistanceLaw) -> bool:
    """Return True for a resistance [N] whose return stroke is the mirror image, as a pool requires."""
    return bool(getattr(getattr(resistance, "resistance", resistance), "return_ratio", 1.0) == 1)


def jumps(cycle: Cycle) -> bool:
    """Return True for a law whose velocity jumps."""
    return any(jump.order == 1 for jump in cycle.discontinuities())
