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

from compact.analysis import machine_models
from compact.analysis.stages.ensemble import first_law
from compact.analysis.stages.pooled_peaks import PooledLaws, RigidLaws, Springs, is_mirrored
from compact.analysis.stages.resistance import DEFAULT_TURN, ResistanceLaw, along_stroke
from compact.analysis.stages.robust_range import missing_for_pool, sleeve_ends
from compact.analysis.stages.verdict import SIZING_PEAKS, ModelAnswer
from compact.machine.drives import DRIVES
from compact.motion.profile import Cycle
from compact.scene.loader import Scene
from compact.turning import LOAD_TRACK, TRACK, StrokeResistance, table_share

RIGID, SCENE_DRIVE = "rigid", "drive of the scene"
OWN_TRACK, STEP = "own track", "step"


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
    peaks: dict[str, dict[str, Mapping[str, float]]]

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
    rigid, pooled = RigidLaws(cycles), PooledLaws(cycles)
    cases = []
    for model in models:
        cart = machine_models.cart(scene, model.roller_load, model.return_load_ratio)
        for turn, resistance in _turns(scene, model):
            found = {RIGID: rigid.peaks(cart, resistance)} | pooled.peaks(cart, resistance, springs)
            peaks = {by: {drive: each[by] for drive, each in found.items()} for by in SIZING_PEAKS}
            cases.append(TurnCase(model.engine, turn, model.valid, peaks))
    return FirstLaws(tuple(cases), tuple(found))


def _springs(scene: Scene, models: Sequence[ModelAnswer]) -> Springs:
    """Return stiffness and damping of the elastic drives of the scene by label; none where `DrivePool` has no model."""
    mirrored = all(each.return_load_ratio == 1 and is_mirrored(each.steady) for each in models)
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
