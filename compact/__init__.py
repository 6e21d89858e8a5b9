"""Roller-compaction loads: a scene (machine, mix, motion) goes in, ranked motion laws come out.

    import compact
    scene = compact.load_scene("loveikin-2015")
    print(scene.rank(by="peak_force").to_dataframe())

Names are loaded from their modules when first used, so that a formula costs no finite elements. SI units, radians.

Numerical envelope: peaks of motion laws are exact to 1e-12 relative for run-up shares from 1e-6 to 1 and complex-law
weights from 0 to 1; drive forces and powers between samples to 1e-8; moments of the cart close to 1e-9 N m.
"""

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

# isort: off
if TYPE_CHECKING:  # for type checkers and editors, and the one list of public names
    from compact.engines.interface import Engine as Engine
    from compact.api.fields import Fields as Fields, read_fields as read_fields
    from compact.api.results import LaboratoryTests as LaboratoryTests, laboratory_tests as laboratory_tests
    from compact.api.results import CartResistance as CartResistance, Contacts as Contacts, Ranking as Ranking
    from compact.api.scene import Scene as Scene, load_scene as load_scene, parse_scene as parse_scene
    from compact.api.results import Process as Process, Study as Study
    from compact.cams.machining import Cut as Cut, cut as cut
    from compact.cams.profile import Cam as Cam, FlatFace as FlatFace, Pointed as Pointed
    from compact.cams.profile import RollerFollower as RollerFollower
    from compact.drive import Crank as Crank, Rigid as Rigid, Run as Run, rank as rank, simulate as simulate
    from compact.engines.halfplane import galin as galin, hertz as hertz, pressure_exponent as pressure_exponent
    from compact.files import ResultsError as ResultsError
    from compact.machine.cart import Balance as Balance, Cart as Cart, MotionResistance as MotionResistance
    from compact.machine.cart import balance as balance
    from compact.machine.drives import Drive as Drive
    from compact.machine.elastic_drive import ElasticDrive as ElasticDrive, ElasticRun as ElasticRun
    from compact.machine.elastic_drive import simulate_elastic as simulate_elastic
    from compact.machine.shaft import Belt as Belt, Kloss as Kloss, LinearTorqueCurve as LinearTorqueCurve
    from compact.machine.motor_drive import Motor as Motor, MotorRun as MotorRun, simulate_motor as simulate_motor
    from compact.machine.roller_motors import CreepFreeRoller as CreepFreeRoller, DrivenRoller as DrivenRoller
    from compact.machine.roller_motors import RollerMotor as RollerMotor
    from compact.material.laws import Elastic as Elastic, Viscoelastic as Viscoelastic
    from compact.material.mix import Mix as Mix, prior as prior
    from compact.material.state_update import StateUpdate as StateUpdate
    from compact.motion.laws import LAWS as LAWS, ComplexLaw as ComplexLaw, minimiser as minimiser
    from compact.motion.limits import CamLimits as CamLimits, InfeasibleError as InfeasibleError, Limits as Limits
    from compact.motion.optimal_motion import optimise as optimise
    from compact.motion.profile import Cycle as Cycle, MotionProfile as MotionProfile, law as law
    from compact.motion.tabulated import from_function as from_function, from_table as from_table
    from compact.resistance import DryResistance as DryResistance, ResistanceMap as ResistanceMap
    from compact.resistance import dry_resistance as dry_resistance, sample_resistance as sample_resistance
    from compact.resistance import tabulated_resistance as tabulated_resistance
    from compact.rolling_contact import ContactResult as ContactResult, Layer as Layer, Roller as Roller
    from compact.scene.loader import SceneError as SceneError
# isort: on

# Modules under the names that `from compact import ...` has for them
_ALIASES = {"column": "engines.column.engine", "spectral": "engines.spectral.engine", "mix": "material.mix"}


@cache
def _homes() -> dict[str, str]:
    """Return the module of each public name: the imports above, which only type checkers execute."""
    import ast
    from importlib.resources import files

    body = ast.parse(files("compact").joinpath("__init__.py").read_text("utf-8")).body
    block = next(node for node in body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> Any:
    if name in _ALIASES:
        return import_module(f"compact.{_ALIASES[name]}")
    if name == "__all__":
        return [*_homes()]
    if name.startswith("__") or name not in _homes():
        raise AttributeError(f"module 'compact' has no attribute {name!r}")
    return getattr(import_module(_homes()[name]), name)


def __dir__() -> list[str]:
    return sorted(_homes())
