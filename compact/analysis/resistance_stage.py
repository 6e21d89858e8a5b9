"""The resistance map of a scene, made from its contacts, and what a results directory keeps of both for the next run.

A kept map serves every scene with the same key: the same roller, layer, mix, contact, accuracy, engine, speeds and
versions. Cart, laws, drive and output are not in the key. Where a law is faster than the map only speeds are added.
"""

import json
import warnings
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from importlib.metadata import version

import numpy as np

from compact import resistance
from compact.analysis.contact_cases import ContactRecord, read_contacts, write_contacts
from compact.analysis.engines import HeldQuantity, added_mass, roll, speeds
from compact.resistance import ResistanceMap, sample_resistance

SLOWEST = 1 / 50  # of the fastest, where samples of the resistance begin
MAP, CONTACTS = "resistance.nc", "contacts.json"
LASTING = (
    "passes.csv",
    "density.csv",
    "pressure.png",
    "fields.pvd",
    "fields.png",
    "fields/",
)  # files that contacts alone decide
VERSIONED = ("compact", "numpy", "scipy", "scikit-fem")
BESIDE = {  # what of the machine no engine of a layer looks at
    *("mass", "weight", "roller_positions", "guide_positions", "pin_position", "pin_height", "guide_wheel_diameter"),
    *("guide_friction", "journal_diameter", "bearing_friction", "rolling_arm", "rib_factor", "roller_friction"),
    *("feeder_sleeve", "overlap", "pressure_nonuniformity", "one_sided"),
}


@dataclass(frozen=True)
class Kept:
    """What an earlier run has left: numbers of its contacts, what they hold over speed, its map, and files that need
    not be made again."""

    contacts: list[ContactRecord]
    held: HeldQuantity
    second_pass: tuple[float, float] | None
    met: ResistanceMap
    files: tuple[str, ...]


def key(scene, mix):
    """Fingerprint of all that decides the contacts and the resistance of a scene."""
    decides = {
        "machine": scene.machine.model_dump(exclude=BESIDE),
        "height": scene.lift_thickness,
        "mix": [scene.mix.model_dump(exclude={"overrides"}), {each.name: each.value for each in mix.parameters}],
        "layer": scene.layer.model_dump(),
        "contact": scene.contact and scene.contact.model_dump(),
        "accuracy": scene.accuracy.model_dump(),
        "speeds": speeds(scene),
        "versions": [version(name) for name in VERSIONED],
    }
    return sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()


def kept(directory, wanted):
    """`Kept` of a results directory under a key; None where there is none, or one under another key."""
    try:
        found, more, files = read_contacts(directory / CONTACTS, wanted)
        met = resistance.load_resistance_map(directory / MAP, wanted)
    except (OSError, ValueError):
        return None
    second = more["second_pass"] and tuple(more["second_pass"])
    return Kept(
        found, HeldQuantity(**more["held"]), second, met, tuple(name for name in files if (directory / name).is_file())
    )


def save(directory, found, held, second_pass, met, wanted, files):
    """Keep contacts, what they hold, the ratios of a second pass and the map under a key, and those of the files that
    last; yields what is written."""
    (directory / CONTACTS).unlink(missing_ok=True)  # it vouches for the files, so it goes first and comes last
    met.save(directory / MAP, wanted)
    more = {"held": asdict(held), "second_pass": second_pass}
    write_contacts(directory / CONTACTS, found, more, wanted, [name for name in files if name.startswith(LASTING)])
    yield directory / MAP
    yield directory / CONTACTS


def mapped(
    scene,
    mix,
    fastest,
    found,
    held,
    *,
    return_ratio=1.0,
    near=(),
    met=None,
    count=lambda stage: None,
    progress=None,
):
    """The `ResistanceMap` of one cart up to its fastest [m/s], by the scene's engine.

    found : records of the contacts so far;  held : kept at every speed, a `HeldQuantity`
    return_ratio : resistance of the return stroke over that of the way out [-]
    near : (speed, `ContactResult`) from which others go on
    met : a map whose samples are there too;  count : called with the stage of each solution
    progress : called with lines of text by "compaction"
    """
    near = list(near)
    whole = scene.machine.rollers * scene.machine.roller_length

    def force(speed):
        count("resistance")
        start = min(near, key=lambda rolled: abs(np.log(rolled[0] / speed)))[1] if near else None
        rolled = roll(scene, mix, speed, near=start, held=held, progress=progress)
        near.append((speed, rolled))
        return whole * rolled.resistance, (rolled.error or (None, None))[1]

    known = [(each.speed, whole * each.resistance, each.resistance_error) for each in found]
    if met is not None:
        known = [
            (float(speed), float(each), met.engine_error) for speed, each in zip(met.speeds, met.forces, strict=True)
        ]
    least = min(SLOWEST * fastest, known[0][0])
    met = sample_resistance(force, least, fastest, scene.accuracy.tolerance, known)
    met = replace(met, return_ratio=return_ratio)
    return _with_masses(scene, mix, met, held, whole, count)


def covers(met, fastest):
    """Whether a map reaches a speed [m/s]."""
    return fastest <= met.speeds[-1] * (1 + resistance.SPEED_ROUNDING)


def _with_masses(scene, mix, met, held, whole, count):
    """The map with M at its speeds; without it where the engine cannot tell."""
    try:
        found = [added_mass(scene, mix, float(speed), held, count) for speed in met.speeds]
    except RuntimeError as error:
        warnings.warn(f"acceleration is left out of the resistance: {error}", stacklevel=2)
        return met
    if None in found:
        return met
    masses, times = np.array(found).T
    return replace(met, added_masses=whole * masses, relaxation_time=float(times.max()))
