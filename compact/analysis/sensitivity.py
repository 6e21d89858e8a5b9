"""What moves the answer: one input after another from its low to its high end, with a rigid drive.

Inputs of the mix go over the spread of the prior; those that are given as one number, and those of the machine, go a
tenth down and up, the fed density a tenth of the way that it is pressed. Each end is a scene of its own, ranked afresh:

    column, spectral     by the engine itself, rolled anew at the speeds of the scene
    fem, compaction      by the engine's map where the input leaves the layer alone, else by formula, as every other
                         end would cost what the study itself does
    formula              by formula

What is rolled anew is the resistance at steady speed. A `Shift` says by what it is, and what its `base` is: the scene
as it is, by the same means. Peaks are those of the samples of a cycle, right to 1e-3.
"""

from dataclasses import dataclass, replace

import numpy as np

from compact import drive
from compact.analysis import machine_models
from compact.analysis.engines import roll, speeds
from compact.analysis.study import Study
from compact.machine.ranking import BUILD_TOLERANCE, ROUNDING_TIE
from compact.resistance import ResistanceMap

TENTH = 0.1
ROOM = 1.2  # times the fastest law, up to which an engine is asked: a duration a tenth shorter has its place
ELASTIC = ("required_pressure", "effective_modulus", "poisson", "steel_friction")
MIX = {  # what each engine knows of it
    "formula": ELASTIC,
    "spectral": (*ELASTIC, "instant_over_relaxed", "relaxation_time"),
    "column": ("heckel_slope", "friction_angle", "cohesion", "unloading_modulus", "poisson", "steel_friction"),
}
RATE = "rate_exponent"  # of a column whose mix knows a speed to count from
MACHINE = {  # inputs besides, and their units
    "machine.roller_length": "m",
    "machine.roller_friction": "1",
    "machine.bearing_friction": "1",
    "machine.guide_friction": "1",
    "machine.mass": "kg",
    "motion.duration": "s",
}
ENGINEERING = ("machine.roller_friction", "machine.bearing_friction")  # what eqs 1.8 and 1.9 alone know
BESIDE = ("machine.guide_friction", "machine.mass", "motion.duration")  # what the layer does not know
FED = "layer.fed_density_ratio"
PEAKS = {"peak_force": "drive_force", "peak_power": "drive_power"}
PRIOR, SHARE, PRESSED = "spread of the prior", "a tenth less, more", "a tenth of what is pressed"


@dataclass(frozen=True)
class End:
    """Result at one end of an input: least peak over all laws and the law that has it, by quantity of PEAKS.

    `ties` are the laws within the build tolerance of the least peak, that law among them.
    """

    least: dict
    law: dict
    ties: dict


@dataclass(frozen=True)
class Shift:
    """An input that is moved to both `ends` in `unit`, how far, and what is made of it there by an engine or formula.

    `base` is what is made of the scene as it is; `low` and `high` are None where that engine does not reach.
    """

    name: str
    ends: tuple
    unit: str
    how: str
    by: str
    base: End
    low: End | None
    high: End | None


def shifts(study):
    """A `Shift` for each input of the mix and the machine that the scene's engine or the formulas know."""
    asked = _Asked(study)
    found = []
    for key, (low, high, how, unit) in _moved(study).items():
        if high > low:
            by = asked.by(key)
            ends = (asked.reached(by, {key: float(value)}) for value in (low, high))
            found.append(Shift(key, (low, high), unit, how, by, asked.base(by), *ends))
    return found


def _moved(study):
    """Key to (low, high, how far that is, unit)."""
    scene, mix, engine = study.scene, study.mix, study.scene.accuracy.engine
    names = [*MIX.get(engine, ELASTIC), *([RATE] if engine == "column" and scene.mix.reference_speed else [])]
    moved = {f"mix.overrides.{name}": (*_ends(mix.parameter(name)), mix.parameter(name).unit) for name in names}
    if engine == "column":
        fed = scene.layer.fed_density_ratio
        step = TENTH * (scene.mix.density_ratio - fed)
        moved[FED] = (fed - step, fed + step, PRESSED, "1")
    keys = MACHINE if engine not in MIX or engine == "formula" else MACHINE.keys() - ENGINEERING
    return moved | {key: (*_tenth(_at(scene, key)), MACHINE[key]) for key in MACHINE if key in keys}


def _ends(parameter):
    if parameter.low < parameter.high:
        return parameter.low, parameter.high, PRIOR
    return _tenth(parameter.value)


def _tenth(value):
    return value * (1 - TENTH), value * (1 + TENTH), SHARE


def _at(scene, key):
    table, name = key.split(".")
    return getattr(getattr(scene, table), name)


class _Asked:
    """What is made of scenes that differ in one input from that of a study, by formula or by its engine."""

    def __init__(self, study):
        self.study, self.bases, self.met = study, {}, None
        self.engine = study.scene.accuracy.engine

    def by(self, key):
        """Who is asked about an input: the scene's engine where that is cheap, else "formula"."""
        if self.engine in MIX:
            return self.engine
        covered = ROOM * self.study.fastest <= self.study.resistance_map.speeds[-1]
        return self.engine if key in BESIDE and (covered or key != "motion.duration") else "formula"

    def base(self, by):
        """The `End` of the scene as it is."""
        if by not in self.bases:
            self.bases[by] = self.end(by, {})
        return self.bases[by]

    def reached(self, by, changes):
        """The `End` of a changed scene, None where the engine or the formulas do not reach."""
        try:
            return self.end(by, changes)
        except (ValueError, RuntimeError):  # no such angle, no such machine, or no solution there
            return None

    def end(self, by, changes):
        """The `End` of a changed scene."""
        end = Study(self.study.scene.with_engine(by).replaced(**changes))
        cycles = self._stretched(end) if "motion.duration" in changes else self.study.cycles
        if by == "formula":
            return _least(end.cart, end.resistance, cycles)
        load, resistance = self._layer(end, changes)
        return _least(machine_models.cart(end.scene, load, end.return_ratios[0]), resistance, cycles)

    def _stretched(self, end):
        """The laws in the duration of a changed scene; those made for the machine keep their shape."""
        duration, dwell = end.scene.motion.duration, end.scene.motion.dwell
        made = {name: cycle.there for name, cycle in self.study.optimal_cycles.items()}
        return end.given_cycles | {
            name: replace(there, duration=duration).cycle(dwell, dwell) for name, there in made.items()
        }

    def _layer(self, end, changes):
        """(force on a roller, resistance) by the engine; rolled anew where the layer knows of the change."""
        if self.engine not in MIX:
            return self.study.roller_load, self.study.resistance_map
        if changes and not changes.keys() & set(BESIDE):
            return _rolled(end, ROOM * self.study.fastest)
        if self.met is None:
            self.met = _rolled(self.study, ROOM * self.study.fastest)
        return self.met


def _rolled(study, fastest):
    """(force on a roller at the mean speed, resistance over speed) of a study by its engine."""
    places = [speed for speed in speeds(study.scene) if speed < fastest] + [fastest]
    rolled = [roll(study.scene, study.mix, speed, held=study.held) for speed in places]
    length = study.scene.machine.roller_length
    load = length * np.interp(np.log(study.scene.mean_speed), np.log(places), [each.load for each in rolled])
    forces = study.scene.machine.rollers * length * np.array([each.resistance for each in rolled])
    ratio = study.return_ratios[1]
    return float(load), ResistanceMap(np.array(places), forces, error=np.nan, return_ratio=ratio)


def _least(cart, resistance, cycles):
    least, law = dict.fromkeys(PEAKS, np.inf), dict.fromkeys(PEAKS, "")
    peaks = {peak: {} for peak in PEAKS}
    for name, cycle in cycles.items():
        run = drive.simulate(cart, drive.Rigid(), cycle, resistance)
        for peak, quantity in PEAKS.items():
            largest = np.inf if run.impulses else float(np.abs(getattr(run, quantity)).max())
            peaks[peak][name] = largest
            if largest < least[peak] * (1 - ROUNDING_TIE):
                least[peak], law[peak] = largest, name
    ties = {
        peak: frozenset(name for name, value in found.items() if value < least[peak] * (1 + BUILD_TOLERANCE))
        for peak, found in peaks.items()
    }
    return End(least, law, ties)
