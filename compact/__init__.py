"""Roller-compaction loads: a scene (machine, mix, motion) goes in, ranked motion laws come out.

    import compact
    scene = compact.load_scene("studies/scenes/loveikin-2015.toml")
    print(scene.rank(by="peak_force").to_dataframe())

Names are loaded from their modules when first used, so that a formula costs no finite elements. SI units, radians.

Numerical envelope: peaks of motion laws are exact to 1e-12 relative for run-up shares from 1e-6 to 1 and complex-law
weights from 0 to 1; drive forces and powers between samples to 1e-8; moments of the cart close to 1e-9 N m.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # for type checkers and editors; a test compares it with _HOMES
    from compact.analysis.engines import Engine as Engine
    from compact.analysis.engines import EngineCost as EngineCost
    from compact.analysis.own_material import laboratory_tests as laboratory_tests
    from compact.api.contacts import Contacts as Contacts
    from compact.api.fields import Fields as Fields
    from compact.api.fields import read_fields as read_fields
    from compact.api.ranking import Ranking as Ranking
    from compact.api.resistance import CartResistance as CartResistance
    from compact.api.scene import Scene as Scene
    from compact.api.scene import load_scene as load_scene
    from compact.api.scene import parse_scene as parse_scene
    from compact.api.study import Process as Process
    from compact.api.study import Study as Study
    from compact.cams.machining import Cut as Cut
    from compact.cams.machining import cut as cut
    from compact.cams.profile import Cam as Cam
    from compact.cams.profile import FlatFace as FlatFace
    from compact.cams.profile import Pointed as Pointed
    from compact.cams.profile import RollerFollower as RollerFollower
    from compact.drive import Crank as Crank
    from compact.drive import Rigid as Rigid
    from compact.drive import Run as Run
    from compact.drive import rank as rank
    from compact.drive import simulate as simulate
    from compact.engines.column import engine as column
    from compact.engines.halfplane import galin as galin
    from compact.engines.halfplane import hertz as hertz
    from compact.engines.halfplane import pressure_exponent as pressure_exponent
    from compact.engines.spectral import engine as spectral
    from compact.files import ResultsError as ResultsError
    from compact.machine.cart import Balance as Balance
    from compact.machine.cart import Cart as Cart
    from compact.machine.cart import MotionResistance as MotionResistance
    from compact.machine.cart import balance as balance
    from compact.machine.elastic_drive import ElasticDrive as ElasticDrive
    from compact.machine.elastic_drive import ElasticRun as ElasticRun
    from compact.machine.elastic_drive import simulate_elastic as simulate_elastic
    from compact.machine.motor_characteristics import Belt as Belt
    from compact.machine.motor_characteristics import Kloss as Kloss
    from compact.machine.motor_characteristics import LinearTorqueCurve as LinearTorqueCurve
    from compact.machine.motor_drive import Motor as Motor
    from compact.machine.motor_drive import MotorRun as MotorRun
    from compact.machine.motor_drive import simulate_motor as simulate_motor
    from compact.machine.roller_motors import CreepFreeRoller as CreepFreeRoller
    from compact.machine.roller_motors import DrivenRoller as DrivenRoller
    from compact.machine.roller_motors import RollerMotor as RollerMotor
    from compact.material import mix as mix
    from compact.material.laws import Elastic as Elastic
    from compact.material.laws import Viscoelastic as Viscoelastic
    from compact.material.mix import Mix as Mix
    from compact.material.mix import prior as prior
    from compact.material.state_update import StateUpdate as StateUpdate
    from compact.motion import LAWS as LAWS
    from compact.motion import CamLimits as CamLimits
    from compact.motion import Cycle as Cycle
    from compact.motion import InfeasibleError as InfeasibleError
    from compact.motion import Limits as Limits
    from compact.motion import MotionProfile as MotionProfile
    from compact.motion import law as law
    from compact.motion import optimise as optimise
    from compact.motion.minimum_criterion import ComplexLaw as ComplexLaw
    from compact.motion.minimum_criterion import minimiser as minimiser
    from compact.motion.tabulated import from_function as from_function
    from compact.motion.tabulated import from_table as from_table
    from compact.resistance import DryResistance as DryResistance
    from compact.resistance import ResistanceMap as ResistanceMap
    from compact.resistance import dry_resistance as dry_resistance
    from compact.resistance import sample_resistance as sample_resistance
    from compact.resistance import tabulated_resistance as tabulated_resistance
    from compact.rolling_contact import ContactResult as ContactResult
    from compact.rolling_contact import Layer as Layer
    from compact.rolling_contact import Roller as Roller
    from compact.scene.loader import SceneError as SceneError

_HOMES = {
    "analysis.engines": ("Engine", "EngineCost"),
    "analysis.own_material": ("laboratory_tests",),
    "api.contacts": ("Contacts",),
    "api.fields": ("Fields", "read_fields"),
    "api.ranking": ("Ranking",),
    "api.resistance": ("CartResistance",),
    "api.scene": ("Scene", "load_scene", "parse_scene"),
    "api.study": ("Process", "Study"),
    "cams.machining": ("Cut", "cut"),
    "cams.profile": ("Cam", "FlatFace", "Pointed", "RollerFollower"),
    "resistance": ("DryResistance", "ResistanceMap", "dry_resistance", "sample_resistance", "tabulated_resistance"),
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
    "material.state_update": ("StateUpdate",),
    "motion": ("LAWS", "CamLimits", "Cycle", "InfeasibleError", "Limits", "MotionProfile", "law", "optimise"),
    "motion.minimum_criterion": ("ComplexLaw", "minimiser"),
    "motion.tabulated": ("from_function", "from_table"),
    "rolling_contact": ("Layer", "Roller", "ContactResult"),
    "scene.loader": ("SceneError",),
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
