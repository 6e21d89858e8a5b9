"""Scenes at and beyond the ends of what is allowed: complete tables, ends of the keys, random changes, outcomes."""

import json
import math
import os
import resource
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple, get_args

from pydantic.fields import FieldInfo

from compact.cli import program as cli
from compact.scene import plausible_ranges
from compact.scene.schema import Layer, declared_keys, table_of

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
HUGE = 1.7e308  # largest number of a scene
WALL = 600  # seconds after which a case that waits for something is ended
MEMORY = 6 << 30  # bytes of address space for one case
DRIVES: dict[str, dict[str, Any]] = {  # complete tables, whose numbers a case then changes
    "rigid": {},
    "springs": {"drive.end_springs": {"stiffness": 5e3, "preload": 200.0, "length": 0.1}},
    "elastic": {"drive.kind": "elastic", "drive.stiffness": 1e6, "drive.damping": 3e3, "drive.backlash": 1e-4},
    "motor": {
        "drive.kind": "motor",
        "drive.motor": {
            "curve": "kloss", "torque": 40.0, "speed": 157.0, "breakdown_slip": 0.15, "gear_ratio": 150.0,
            "inertia": 0.01, "flywheel_inertia": 50.0,
        },
    },
    "hydraulic": {
        "drive.kind": "hydraulic",
        "drive.hydraulics": {
            "piston_area": 1e-3, "supply_pressure": 8e6, "pump_flow": 5e-4, "valve_area": 2e-5,
            "discharge_coefficient": 0.62, "oil_density": 870.0, "transition_drop": 1e3,
        },
    },
    "optimise": {"motion.optimise": {"objectives": ["peak_force"], "smoothness": 1, "acceleration": 0.6}},
}  # fmt: skip
LIMITS = {"velocity": 0.4, "acceleration": 0.9, "jerk": 6.0, "snap": 60.0, "steady_tolerance": 0.5}
CAM_LIMITS = {"pressure_angle": 0.8, "radius_of_curvature": 0.05}
BEARING = {"dynamic_rating": 1e4, "kind": "ball", "count": 2}
TABLES: dict[str, dict[str, Any]] = DRIVES | {  # with the optional keys and tables of the other parts of a scene
    "catalogue": {"drive.catalogue": {"file": "motors.csv", "margin": 1.5, "efficiency": 0.9, "gear_ratio": 60.0,
                                      "inertia_ratio": 10.0}},
    "bearings": {"machine.guide_bearing": BEARING, "machine.roller_bearing": BEARING},
    "limits": {"motion.optimise": {"objectives": ["peak_force"], "smoothness": 1} | LIMITS},
    "cam limits": {"motion.optimise": {"objectives": ["peak_force"], "smoothness": 1} | CAM_LIMITS},
    "durations": {"motion.other_durations": [1.5], "motion.dwell": 0.2, "drive.carts": 2, "drive.angles": [0.0, 3.0]},
    "plies": {"layer.plies": [{"thickness": height, "relative_modulus": 1.0} for height in (0.1, 0.12)]},
    "lower lift": {"layer.lift_thickness": 0.11, "layer.lower_lift": {"thickness": 0.1, "density_ratio": 0.97}},
    "driven": {"machine.roller_condition": "driven", "machine.roller_torque": 10.0},
    "indentation": {"contact.indentation": 3e-3, "contact.held": "height", "contact.speeds": [0.05, 0.2]},
    "load": {"contact.load": 5e3, "contact.held": "load", "contact.speeds": [0.05, 0.2]},
    "pressure": {"contact.peak_pressure": 1e5, "contact.speeds": [0.05, 0.2]},
}  # fmt: skip
LISTS = {"layer.plies": Layer}  # keys whose values are lists of tables
BOUNDS = ("gt", "ge", "lt", "le", "min_length", "max_length")


def choices(field: FieldInfo) -> list[str]:
    """Words that a field takes, those within lists too."""
    found, kinds = [], [field.annotation]
    while kinds:
        for part in get_args(kinds.pop()):
            found += [part] if isinstance(part, str) else []
            kinds += [] if isinstance(part, str) else [part]
    return found


def at(tables: Any, key: str) -> Any:
    """Value at a key path of nested tables, None where there is none."""
    for name in key.split("."):
        tables = tables.get(name) if isinstance(tables, dict) else None
    return tables


def keys() -> dict[str, FieldInfo]:
    """Field of every key of a scene but those that name it, and its engine."""
    others = ("title", "unusual", "accuracy.engine", *(f"{name}." for name in LISTS))
    return {key: field for key, field in declared_keys().items() if not key.startswith(others)} | {
        name: table.model_fields[name.rpartition(".")[2]] for name, table in LISTS.items()
    }


def ends(key: str, given: Any) -> list[Any]:
    """Values at the ends of the range that a key takes, every word of one that takes words; of a list each entry."""
    field = keys()[key]
    if inner := table_of(field):
        limits = [(name, bounds(each)) for name, each in inner.model_fields.items()]
        return [[{**given[0], name: end}, *given[1:]] for name, both in limits for end in both] if given else []
    if words := choices(field):
        return [[word] for word in words] if isinstance(given, tuple | list) else words
    if bool in (field.annotation, *get_args(field.annotation)):
        return [True, False]
    if str in (field.annotation, *get_args(field.annotation)):
        return []
    low, high = bounds(field)
    if key in plausible_ranges.COMPARED_KEYS:
        plausible, beyond = plausible_ranges.range_of(key), plausible_ranges.REFUSED
        high = min(high, plausible.high * beyond)
        low = max(low, plausible.low / beyond) if low >= 0 else -high
    if int in (field.annotation, *get_args(field.annotation)):
        return [math.ceil(low), math.floor(min(high, 1e15))]
    if isinstance(given, tuple | list) and given:
        size = max(map(abs, given)) or 1.0
        return [[end * (entry / size) for entry in given] for end in (low, high)]
    return [low, high]


def bounds(field: FieldInfo) -> tuple[float, float]:
    """Smallest and largest number that the schema allows."""
    limits = {name: getattr(part, name) for part in field.metadata for name in BOUNDS if hasattr(part, name)}
    low = limits.get("ge", math.nextafter(limits["gt"], math.inf) if "gt" in limits else -HUGE)
    high = limits.get("le", math.nextafter(limits["lt"], -math.inf) if "lt" in limits else HUGE)
    return low, high


class Case(NamedTuple):
    """A call of the command, and the changes of the scene in it."""

    scene: str
    command: str
    engine: str
    changes: dict[str, Any]
    options: tuple[str, ...]

    @property
    def arguments(self):
        changed = [part for key, value in self.changes.items() for part in ("--set", f"{key}={toml(value)}")]
        return [self.command, f"{self.scene}.toml", "--engine", self.engine, "--out", "out", *changed, *self.options]


def toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    return json.dumps(value) if isinstance(value, str) else repr(value)


class Outcome(NamedTuple):
    """How a case ended: exit code, or minus the signal that ended it, and what it said."""

    code: int
    said: str
    seconds: float


def ended(asked, folder, seconds):
    """Run a case in a child process for some seconds of processor time at most; its `Outcome`."""
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        code = 99
        try:
            os.chdir(folder)
            said = os.open("said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(said, 1)
            os.dup2(said, 2)
            sys.stdout = os.fdopen(1, "w", closefd=False)
            sys.stderr = os.fdopen(2, "w", closefd=False)
            used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
            resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used) + seconds, math.ceil(used) + seconds + 1))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            signal.signal(signal.SIGXCPU, signal.SIG_DFL)
            warnings.resetwarnings()  # those of pytest, which fail a test; the command prints its warnings
            code = cli._exit_code(asked.arguments)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - start > WALL:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.005)
    return Outcome(os.waitstatus_to_exitcode(status), (folder / "said.txt").read_text(), time.monotonic() - start)
