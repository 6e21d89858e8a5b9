"""One-at-a-time sensitivity of the least peaks of force and power to the inputs, with a rigid drive.

Inputs of the mix vary over the spread of the prior. Inputs without spread, and those of the machine, vary by a tenth;
the density ratio before the pass varies by a tenth of its change. At each end the scene is ranked again:

    column, spectral     by the engine, with new contacts at the speeds of the scene
    fem, compaction      by the resistance map if the input does not change the layer, else by formula, as a new
                         map would cost as much as the study itself
    formula              by formula

New contacts are steady: they have no added mass. Peaks are those of the samples of a cycle, accurate to 1e-3.
"""

from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from compact.analysis import machine_models
from compact.analysis.contact_cases import contact_speeds, roll_scene
from compact.analysis.pore_air import has_air
from compact.analysis.stages.drives import Stages, build_stages
from compact.analysis.stages.ensemble import Change, Peaks, ensemble, first_law
from compact.analysis.stages.pooled_peaks import RigidLaws
from compact.analysis.stages.resistance import along_stroke
from compact.engines import ENGINES
from compact.engines.pore_air import NO_FORCES
from compact.machine.ranking import BUILD_TOLERANCE
from compact.quantities import INPUT
from compact.resistance import ResistanceMap
from compact.scene.loader import Scene

VARIATION = 0.1  # [-], relative variation of an input without spread
SPEED_MARGIN = 1.2  # [-], range of new contacts over the largest speed; a duration shorter by a tenth is within it
MACHINE_INPUTS = (  # inputs of the machine and the motion
    "machine.roller_length", "machine.roller_friction", "machine.bearing_friction", "machine.guide_friction",
    "machine.mass", "motion.duration",
)  # fmt: skip
FORMULA_INPUTS = ("machine.roller_friction", "machine.bearing_friction")  # of eqs 1.8 and 1.9 only
CART_INPUTS = ("machine.guide_friction", "machine.mass", "motion.duration")  # on which no layer depends
DENSITY_INPUT = "layer.fed_density_ratio"
PRIOR, SHARE, PRESSED = "spread of the prior", "a tenth less, more", "a tenth of what is pressed"


@dataclass(frozen=True)
class End:
    """Least peaks over all laws at one value of an input.

    Parameters
    ----------
    least : dict
        Least peak by criterion [N], [W].
    law : dict
        Law with the least peak by quantity.
    ties : dict
        Laws within the build tolerance of the least peak by quantity, that law among them.
    """

    least: dict[str, float]
    law: dict[str, str]
    ties: dict[str, frozenset[str]]


@dataclass(frozen=True)
class Shift:
    """Sensitivity to one input.

    Parameters
    ----------
    how : {PRIOR, SHARE, PRESSED}
        Kind of variation.
    base : End
        Result of the scene itself by the same engine.
    low, high : End or None
        Results at the ends; None where the engine has no solution.
    """

    name: str
    ends: tuple[float, float]
    unit: str
    how: str
    by: str
    base: End
    low: End | None
    high: End | None

    def changed_ends(self, by: str) -> list[End]:
        """Return the ends at which the first law of the scene by a criterion is not first."""
        return [end for end in (self.low, self.high) if end is not None and self.base.law[by] not in end.ties[by]]


def sensitivities(stages: Stages) -> list[Shift]:
    """Compute the sensitivity to each input of the mix and the machine that the engine or the formulas depend on."""
    scene, run = stages.contacts.scene, _RigidPeaks(stages)
    bases: dict[str, End] = {}
    found = []
    for key, (low, high, how, unit) in _ranges(stages).items():
        if low >= high:
            continue
        by = run.engine_for(key)
        if by not in bases:
            bases[by] = _end(run(scene.with_engine(by), Change("scene")))
        changes = [Change("low", {key: float(low)}), Change("high", {key: float(high)})]
        peaks = ensemble(scene.with_engine(by), changes, run)
        ends = (None if "reason" in peaks[i] else _end(peaks[i]) for i in (0, 1))
        found.append(Shift(key, (low, high), unit, how, by, bases[by], *ends))
    return found


def _ranges(stages: Stages) -> dict[str, tuple[float, float, str, str]]:
    """Return low and high value, kind of variation and unit of each input by its scene key."""
    scene, mix, engine = stages.contacts.scene, stages.contacts.mix, stages.contacts.engine
    new_layer = engine.affordable and stages.contacts.compacts
    varied = engine if engine.affordable else ENGINES["formula"]
    names = varied.parameters_of(scene.mix.law, new_layer and has_air(scene))
    by_formula = not (engine.affordable and stages.contacts.speeds)
    keys = [key for key in MACHINE_INPUTS if by_formula or key not in FORMULA_INPUTS]

    ranges = {
        f"mix.overrides.{each.name}": (each.low, each.high, PRIOR, each.unit)
        if each.low < each.high
        else (*each.spread_about(each.value, VARIATION), SHARE, each.unit)
        for each in map(mix.parameter, names)
    }
    if new_layer:
        before = scene.layer.fed_density_ratio
        step = VARIATION * (scene.mix.density_ratio - before)
        ranges[DENSITY_INPUT] = (before - step, before + step, PRESSED, INPUT[DENSITY_INPUT].unit)
    values = {key: attrgetter(key)(scene) for key in keys}
    return ranges | {
        key: ((1 - VARIATION) * value, (1 + VARIATION) * value, SHARE, INPUT[key].unit) for key, value in values.items()
    }


class _RigidPeaks:
    """Run of an ensemble of scenes that differ in one input, by formula or by the engine of the study."""

    def __init__(self, stages: Stages) -> None:
        self.stages, self.engine = stages, stages.contacts.engine
        self.largest_speed = SPEED_MARGIN * stages.resistance.largest_speed if stages.contacts.speeds else 0.0
        self.own_layer: tuple[float, ResistanceMap] | None = None
        self.laws = RigidLaws(stages.drive.cycles)

    def engine_for(self, key: str) -> str:
        """Return the engine of the scene if it can vary an input, else "formula"."""
        if self.engine.affordable:
            return self.engine.name
        covered = self.largest_speed <= self.stages.resistance.map.speeds[-1]
        return self.engine.name if key in CART_INPUTS and (covered or key != "motion.duration") else "formula"

    def __call__(self, scene: Scene, change: Change) -> Peaks:
        """Return the peaks by law with a rigid drive."""
        changed = build_stages(scene)
        drive = self.stages.drive
        other = drive.over(scene.motion.duration) if "motion.duration" in change.keys else None
        laws = RigidLaws(other.cycles) if other else self.laws
        if not changed.contacts.speeds:
            return laws.peaks(changed.resistance.cart, changed.resistance.resistance)
        over = self.stages.resistance.over(scene.motion.duration)
        if not self.engine.affordable:
            load, resistance = over.contacts.roller_load, over.map
        elif change.keys and not change.keys.keys() & set(CART_INPUTS):
            load, resistance = _new_contacts(changed, self.largest_speed)
        else:
            self.own_layer = self.own_layer or _new_contacts(self.stages, self.largest_speed)
            load, resistance = self.own_layer
        contacts = changed.contacts if self.engine.affordable else over.contacts  # whose passes are not computed again
        cart = machine_models.cart(scene, load, contacts.return_ratios[0])
        return laws.peaks(cart, along_stroke(resistance, self.stages.resistance.turning, scene.sleeve_distances))


def _new_contacts(stages: Stages, largest_speed: float) -> tuple[float, ResistanceMap]:
    """Return load on a roller at the mean speed [N], and resistance over speed, from new contacts."""
    contacts, scene = stages.contacts, stages.contacts.scene
    speeds = [speed for speed in contact_speeds(scene) if speed < largest_speed] + [largest_speed]
    rolled = [roll_scene(scene, contacts.mix, speed, held=contacts.held) for speed in speeds]
    air = [contacts.air_forces(speed) or NO_FORCES for speed in speeds]
    length = scene.machine.roller_length
    loads = [each.load + more.load for each, more in zip(rolled, air, strict=True)]
    load = length * np.interp(np.log(scene.mean_speed), np.log(speeds), loads)
    resistances = [each.resistance + more.resistance for each, more in zip(rolled, air, strict=True)]
    forces = scene.machine.rollers * length * np.array(resistances)
    return float(load), ResistanceMap(np.array(speeds), forces, error=np.nan, return_ratio=contacts.return_ratios[1])


def _end(peaks: Peaks) -> End:
    least = {by: min(found.values()) for by, found in peaks.items()}
    ties = {
        by: frozenset(law for law, value in found.items() if value < least[by] * (1 + BUILD_TOLERANCE))
        for by, found in peaks.items()
    }
    return End(least, {by: first_law(found) for by, found in peaks.items()}, ties)
