"""Roller-compaction loads: a scene (machine, mix, motion) goes in, ranked motion laws come out.

    import compact
    study = compact.Study(compact.load_scene("studies/scenes/loveikin-2015.toml"))
    for place in study.rankings["peak_force"]:
        print(place.rank, place.run.name, place.value)

Names are loaded from their modules when first used, so that a formula costs no finite elements. SI units, radians.

Numerical envelope: peaks of motion laws are exact to 1e-12 relative for run-up shares from 1e-6 to 1 and complex-law
weights from 0 to 1; drive forces and powers between samples to 1e-8; moments of the cart close to 1e-9 N m.
"""

import warnings
from importlib import import_module
from typing import Any

_HOMES = {
    "analysis.study": ("Study",),
    "cams.machining": ("Cut", "cut"),
    "cams.profile": ("Cam", "FlatFace", "Pointed", "RollerFollower"),
    "resistance": ("DryResistance", "ResistanceMap", "dry_resistance", "sample_resistance"),
    "drive": ("Crank", "Rigid", "Run", "rank", "simulate"),
    "engines.halfplane": ("galin", "hertz", "pressure_exponent"),
    "files": ("ResultsError",),
    "machine.cart": ("Balance", "Cart", "MotionResistance", "balance"),
    "machine.elastic_drive": ("ElasticDrive", "ElasticRun", "simulate_elastic"),
    "machine.motor_characteristics": ("Belt", "Kloss", "LinearTorqueCurve"),
    "machine.motor_drive": ("Motor", "MotorRun", "simulate_motor"),
    "machine.roller_motors": ("CreepFreeRoller", "DrivenRoller", "RollerMotor"),
    "material.laws": ("Elastic", "Viscoelastic"),
    "material.mix": ("Mix", "prior"),
    "motion": ("LAWS", "CamLimits", "Cycle", "InfeasibleError", "Limits", "MotionProfile", "law", "optimise"),
    "motion.minimum_criterion": ("ComplexLaw", "minimiser"),
    "motion.tabulated": ("from_table",),
    "rolling_contact": ("Layer", "Roller", "ContactResult"),
    "scene.loader": ("Scene", "SceneError", "load_scene", "parse_scene"),
}
# Modules under the names that `from compact import ...` has for them
_ALIASES = {"column": "engines.column.engine", "spectral": "engines.spectral.engine", "mix": "material.mix"}
# Former names, accepted for one release
_RENAMED = {
    "Driven": "DrivenRoller",
    "FirstOrder": "CreepFreeRoller",
    "Motion": "MotionProfile",
    "Opposition": "MotionResistance",
    "Rolled": "ContactResult",
    "Straight": "LinearTorqueCurve",
    "revolve": "simulate_motor",
    "sampled": "sample_resistance",
    "travel": "simulate_elastic",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [*_HOME_OF]


def __getattr__(name: str) -> Any:
    if name in _ALIASES:
        return import_module(f"compact.{_ALIASES[name]}")
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(f"compact.{name} is now compact.{new}", DeprecationWarning, stacklevel=2)
        return getattr(import_module(f"compact.{_HOME_OF[new]}"), new)
    if name not in _HOME_OF:
        raise AttributeError(f"module 'compact' has no attribute {name!r}")
    return getattr(import_module(f"compact.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
