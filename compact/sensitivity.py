"""What moves the answer: one input after another from its low to its high end, by formula and with a rigid drive.

Inputs of the mix go over the spread of the prior; those that are given as one number, and those of the machine, go a
tenth down and up. Each end is a scene of its own, ranked afresh; what the engine of the scene would make of it is not
asked, as that costs as much as the study itself. Peaks are those of the samples of a cycle, right to 1e-3.
"""

from dataclasses import dataclass

import numpy as np

from compact import drive
from compact.study import Study

TENTH = 0.1
MIX = ("required_pressure", "effective_modulus", "poisson", "steel_friction")  # what the formulas know of it
MACHINE = {  # inputs besides, and their units
    "machine.roller_length": "m",
    "machine.roller_friction": "1",
    "machine.bearing_friction": "1",
    "machine.guide_friction": "1",
    "machine.mass": "kg",
    "motion.duration": "s",
}
PEAKS = {"peak_force": "drive_force", "peak_power": "drive_power"}


@dataclass(frozen=True)
class End:
    """What is made of one end of an input: least peak over all laws and the law that has it, by quantity of PEAKS."""

    least: dict
    law: dict


@dataclass(frozen=True)
class Shift:
    """An input that is moved to both `ends` in `unit`, those of its own spread or not, and what is made of it there.

    `low` and `high` are None where the formulas do not reach.
    """

    name: str
    ends: tuple
    unit: str
    spread: bool
    low: End | None
    high: End | None


def nominal(study):
    """The `End` of the scene of a study as it is."""
    return _end(study, {})


def shifts(study):
    """A `Shift` for each input of the mix and the machine that the formulas know."""
    scene, mix = study.scene, study.mix
    moved = {f"mix.overrides.{name}": (*_ends(mix.parameter(name)), mix.parameter(name).unit) for name in MIX}
    moved |= {key: (*_tenth(_at(scene, key)), unit) for key, unit in MACHINE.items()}
    return [
        Shift(key, (low, high), unit, spread, *(_reached(study, key, value) for value in (low, high)))
        for key, (low, high, spread, unit) in moved.items()
        if high > low
    ]


def _ends(parameter):
    if parameter.low < parameter.high:
        return parameter.low, parameter.high, True
    return _tenth(parameter.value)


def _tenth(value):
    return value * (1 - TENTH), value * (1 + TENTH), False


def _at(scene, key):
    table, name = key.split(".")
    return getattr(getattr(scene, table), name)


def _reached(study, key, value):
    try:
        return _end(study, {key: float(value)})
    except ValueError:  # beyond the formulas: no such angle, or no such machine
        return None


def _end(study, changes):
    end = Study(study.scene.by("formula").replaced(**changes))
    cycles = end.cycles if any(key.startswith("motion.") for key in changes) else study.cycles  # costly, so kept
    least, law = dict.fromkeys(PEAKS, np.inf), dict.fromkeys(PEAKS, "")
    for name, cycle in cycles.items():
        run = drive.simulate(end.cart, drive.Rigid(), cycle, end.resistance)
        for peak, quantity in PEAKS.items():
            largest = np.inf if run.impulses else float(np.abs(getattr(run, quantity)).max())
            if largest < least[peak] * (1 - drive.TIE):
                least[peak], law[peak] = largest, name
    return End(least, law)
