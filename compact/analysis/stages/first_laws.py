"""First laws over what nobody has measured: drive, distance to fresh mix behind the roller, and model.

Every engine has a case for each resistance after a turn:

    own track     the share of a second pass along the whole stroke, which no build-up falls below
    D             build-up, with the edge of fresh mix at the scene's distance and at both ends of what is known of it
    step          the steady resistance from the turn on, as of no mix; linear engines have no other

In each case the laws are ranked with a rigid drive and with every elastic drive of the scene's range. An excess is the
peak of a law over the least one of its case and drive.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from compact.analysis import machine_models
from compact.analysis.stages.drives import motion_of
from compact.analysis.stages.ensemble import first_law
from compact.analysis.stages.resistance import DEFAULT_TURN, ResistanceLaw, along_stroke
from compact.analysis.stages.robust_range import missing_for_pool, sleeve_ends
from compact.analysis.stages.verdict import SIZING_PEAKS, ModelAnswer
from compact.drive import Rigid
from compact.machine.cart import Cart
from compact.machine.drives import DRIVES
from compact.machine.rigid_drive import InverseDynamics
from compact.motion.profile import Cycle
from compact.numerics import Array
from compact.numerics.piecewise import interior_grid
from compact.scene.loader import Scene
from compact.turning import LOAD_TRACK, TRACK, StrokeResistance, table_share

if TYPE_CHECKING:
    from compact.analysis.robust.drive_pool import PassTable

RIGID, SCENE_DRIVE = "rigid", "drive of the scene"
OWN_TRACK, STEP = "own track", "step"
PHASES = 384  # [-], of a piece of a law; peaks with a rigid drive are within 1e-3


@dataclass(frozen=True)
class TurnCase:
    """Peaks of all laws by one engine with one resistance after a turn.

    Parameters
    ----------
    engine, turn : str
        Engine, and the resistance after a turn in words.
    valid : bool
        Whether the engine may size a drive.
    peaks : dict
        Peak by criterion, drive and law [N] or [W]; infinite without a periodic cycle.
    """

    engine: str
    turn: str
    valid: bool
    peaks: dict[str, dict[str, dict[str, float]]]

    def first(self, by: str, drive: str) -> tuple[str, float]:
        """Return the first law with a drive and its peak; empty and infinite where no law has a cycle."""
        found = self.peaks[by][drive]
        law = first_law(found)
        return law, found.get(law, math.inf)

    def elastic(self, by: str) -> tuple[dict[str, int], tuple[float, float]]:
        """Return the first laws over the elastic drives with their number, and the range of their peaks."""
        firsts = [self.first(by, drive) for drive in self.peaks[by] if drive != RIGID]
        peaks = [peak for _, peak in firsts]
        return dict(Counter(law for law, _ in firsts if law).most_common()), (min(peaks), max(peaks))


@dataclass(frozen=True)
class FirstLaws:
    """First laws over drive, distance to fresh mix, and model."""

    cases: tuple[TurnCase, ...]
    drives: tuple[str, ...]

    @cached_property
    def least_excess(self) -> dict[str, tuple[str, float]]:
        """Law of the least largest excess over all cases of the valid engines, by criterion, and that excess [-]."""
        found = {}
        for by in SIZING_PEAKS:
            ranked = [peaks for each in self._judged for peaks in each.peaks[by].values() if first_law(peaks)]
            laws = set.intersection(*map(set, ranked)) if ranked else ()
            excess = {law: max(peaks[law] / min(peaks.values()) - 1 for peaks in ranked) for law in sorted(laws)}
            law = first_law(excess)
            found[by] = law, excess.get(law, math.inf)
        return found

    def firsts(self, by: str) -> dict[str, int]:
        """Return the first laws over all cases and drives of the valid engines, with their number."""
        named = Counter(each.first(by, drive)[0] for each in self._judged for drive in each.peaks[by])
        return {law: count for law, count in named.most_common() if law}

    @property
    def number(self) -> int:
        """Number of cases and drives of the valid engines."""
        return len(self._judged) * len(self.drives)

    @property
    def _judged(self) -> list[TurnCase]:
        return [each for each in self.cases if each.valid] or list(self.cases)

    def step(self, engine: str) -> dict[str, tuple[str, float]]:
        """Return the first laws of an engine by criterion with a step at the turn and the drive of the scene."""
        drive = SCENE_DRIVE if SCENE_DRIVE in self.drives else RIGID
        found = [each for each in self.cases if (each.engine, each.turn) == (engine, STEP)]
        return {by: each.first(by, drive) for each in found for by in SIZING_PEAKS}


def first_laws(scene: Scene, models: Sequence[ModelAnswer], cycles: Mapping[str, Cycle]) -> FirstLaws:
    """Rank the laws by every engine over the resistances after a turn and the drives of the scene.

    A law that retraces its forward stroke, such as a crank's, or whose velocity jumps is ranked with a rigid drive
    alone; so are all laws with a dwell, backlash or end springs.

    Parameters
    ----------
    models : sequence of ModelAnswer
        Answers of the engines that were run.

    Returns
    -------
    FirstLaws
    """
    springs = _springs(scene, models)
    tables = _pass_tables(cycles) if springs else {}
    cases = []
    for model in models:
        cart = machine_models.cart(scene, model.roller_load, (model.second_pass or (1.0,))[0])
        for turn, resistance in _turns(scene, model):
            peaks = {by: {RIGID: each} for by, each in _rigid_peaks(cart, resistance, cycles).items()}
            for drive, found in _elastic_peaks(cart, resistance, tables, springs) if tables else ():
                for by, each in found.items():
                    peaks[by][drive] = each
            cases.append(TurnCase(model.engine, turn, model.valid, peaks))
    return FirstLaws(tuple(cases), (RIGID, *(springs if tables else ())))


def _pass_tables(cycles: Mapping[str, Cycle]) -> dict[str, "PassTable"]:
    """Tabulate the laws that `DrivePool` simulates; those of one motion have one table."""
    from compact.analysis.robust.drive_pool import pass_table  # compiled code, imported when required

    simulated = {name: each for name, each in cycles.items() if not (each.forward.retraces or _jumps(each))}
    tables = {motion_of(each): pass_table(each.forward) for each in simulated.values()}
    return {name: tables[motion_of(each)] for name, each in simulated.items()}


def _springs(scene: Scene, models: Sequence[ModelAnswer]) -> dict[str, tuple[float, float]]:
    """Return stiffness and damping of the elastic drives of the scene by label; none where `DrivePool` has no model."""
    mirrored = all(each.second_pass is None and getattr(each.steady, "return_ratio", 1.0) == 1 for each in models)
    cart = machine_models.cart(scene, models[0].roller_load)
    if not mirrored or missing_for_pool(scene, cart):
        return {}
    keys = ("drive.stiffness", "drive.damping")
    variants = DRIVES[scene.drive.kind].variants(scene)
    own = attrgetter("stiffness", "damping")(scene.drive)
    return {SCENE_DRIVE: own} | {
        each.label: (each.keys[keys[0]], each.keys[keys[1]]) for each in variants if {*keys} <= each.keys.keys()
    }


def _turns(scene: Scene, model: ModelAnswer) -> Iterator[tuple[str, ResistanceLaw]]:
    """Yield the resistances of a model after a turn, in words."""
    if model.turning is not None:
        turn = scene.drive.turn or DEFAULT_TURN
        distances = {"the scene's table": scene.sleeve_distances}
        if isinstance(turn, str):
            force, load = (table_share((0.0,), (share,)) for share in (TRACK, LOAD_TRACK))
            yield OWN_TRACK, StrokeResistance(model.steady, force, force, load, load)
            own = " and ".join(f"{1e3 * each:.3g} mm" for each in dict.fromkeys(scene.sleeve_distances))
            distances = {f"{1e3 * ends[0]:.3g} mm, {words}": ends for words, ends in sleeve_ends(scene).items()}
            distances = dict(sorted((distances | {own: scene.sleeve_distances}).items(), key=lambda each: each[1]))
        for words, ends in distances.items():
            yield words, along_stroke(model.steady, model.turning, ends)
    yield STEP, model.steady


def _jumps(cycle: Cycle) -> bool:
    """Return True for a law whose velocity jumps."""
    return any(jump.order == 1 for jump in cycle.discontinuities())


def _rigid_peaks(cart: Cart, resistance: ResistanceLaw, cycles: Mapping[str, Cycle]) -> dict[str, dict[str, float]]:
    """Return the peaks of the laws with a rigid drive by criterion, at samples of the cycle."""
    found: dict[str, dict[str, float]] = {by: {} for by in SIZING_PEAKS}
    for name, cycle in cycles.items():
        required = InverseDynamics(cart, Rigid(), cycle, resistance)
        states = [required.state_at(leg, interior_grid(leg.breakpoints(), PHASES)) for leg in cycle.legs()]
        for by, values in zip(SIZING_PEAKS, ("forces.drive_force", "drive_power"), strict=True):
            largest = max(float(np.abs(attrgetter(values)(each)).max()) for each in states)
            found[by][name] = math.inf if _jumps(cycle) else largest
    return found


def _elastic_peaks(
    cart: Cart, resistance: ResistanceLaw, laws: Mapping[str, "PassTable"], springs: Mapping[str, tuple[float, float]]
) -> Iterator[tuple[str, dict[str, dict[str, float]]]]:
    """Yield each elastic drive with the peaks of the laws by criterion."""
    from compact.analysis.robust.drive_pool import DrivePool, travel_table

    stiffness, damping = (np.array(each) for each in zip(*springs.values(), strict=True))
    fastest = max(float(each.velocity.max()) for each in laws.values())
    table = travel_table(cart, resistance, next(iter(laws.values())).stroke, fastest)
    ratio = damping / (2 * np.sqrt(stiffness * cart.mass))
    pool = DrivePool.of(cart.mass, np.column_stack([stiffness, ratio]), (table,))
    alike: dict[int, tuple[Array, Array]] = {}
    for law in laws.values():
        if id(law) not in alike:
            forces = pool.simulate(law)
            settled = np.where(forces.passes > 0, 1.0, np.inf)
            alike[id(law)] = forces.peaks * settled, np.abs(forces.powers(law)).max(axis=1) * settled
    for number, drive in enumerate(springs):
        yield (
            drive,
            {
                by: {name: float(alike[id(law)][i][number]) for name, law in laws.items()}
                for i, by in enumerate(SIZING_PEAKS)
            },
        )
