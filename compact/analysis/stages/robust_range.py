"""Range of drives and resistances of a scene, over which robust laws have the least worst peak.

Stiffness and damping ratio span the values of the drive's `variants`, the distance to fresh mix that of `sleeve_ends`,
the steady force the resistances at both ends of the spread of the mix that [motion.optimise] names. Measured values
have the ± of their comment, so that a measurement narrows the range.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.analysis.stages.resistance import ResistanceStage, along_stroke
from compact.machine.cart import Cart, Resistance
from compact.machine.drives import DRIVES, levels
from compact.scene.loader import Scene
from compact.turning import StrokeResistance

if TYPE_CHECKING:
    from compact.analysis.robust.law import PlantRange

SLEEVE = "machine.sleeve_distance"
OPEN_SHARE = 0.24  # [-], of the radius; contact length of the published lift, where an open sleeve leaves fresh mix
MIDWAY_SHARE = 1.6  # [-], of the radius; a sleeve midway between two rollers of the published machine
SHARES = (0.0, 0.5, 1.0)  # [-], of the range of the distance to fresh mix: samples of a search; judges lie inside


def sleeve_ends(scene: Scene) -> Mapping[str, tuple[float, float]]:
    """Return the ends of the distance to fresh mix [m] by label: of its stated spread, or open to midway sleeves."""
    machine, (near, far) = scene.machine, scene.sleeve_distances
    if scene.stated_spread(SLEEVE) is not None:
        sides = (levels(scene, SLEEVE, "sleeve distance", (), item) for item in (0, -1))
        return {label: (by * near, other * far) for (label, by), (_, other) in zip(*sides, strict=True)}
    places = sorted(machine.roller_positions)
    gaps = [(after - before - machine.feeder_sleeve) / 2 for before, after in pairwise(places)]
    ends = {"open": OPEN_SHARE * machine.roller_radius, "midway": max([MIDWAY_SHARE * machine.roller_radius, *gaps])}
    return {f"{word} sleeve": (end, end) for word, end in ends.items()}


def plant_range(scene: Scene, stage: ResistanceStage, resistances: Sequence[Resistance]) -> "PlantRange":
    """Return the range of drives and resistances of a scene.

    Parameters
    ----------
    stage : ResistanceStage
        Resistance of the scene.
    resistances : sequence of callable
        Resistance as computed, and at both ends of each spread of the mix [N].

    Raises
    ------
    RuntimeError
        If no robust law exists for the kind of drive, its backlash, dwells or end springs.
    """
    from compact.analysis.robust.law import PlantRange  # compiled code, imported when required

    if missing := missing_for_pool(scene, stage.cart):
        raise RuntimeError(f"a robust law requires {' and '.join(missing)}")
    mass, drive = scene.machine.mass, scene.drive
    values: list[tuple[Any, Any]] = [(drive.stiffness, drive.damping)]
    for variant in DRIVES[drive.kind].variants(scene):
        values.append((variant.keys["drive.stiffness"], variant.keys["drive.damping"]))
    stiffness = [k for k, _ in values]
    ratios = [c / (2 * math.sqrt(k * mass)) for k, c in values]
    steady = [each.resistance if isinstance(each, StrokeResistance) else each for each in resistances]
    places = _sleeve_samples(scene) if stage.turning else [scene.sleeve_distances]
    samples = [along_stroke(law, stage.turning, each) for law, each in product(steady, places)]
    inner = list(_inside(steady, stage.turning, places, scene.mean_speed)) if len(samples) > 1 else []
    return PlantRange((min(stiffness), max(stiffness)), (min(ratios), max(ratios)), samples, inner)


def _inside(steady, turning, places, speed):
    """Resistances inside the range of forces at a speed [m/s] and places of fresh mix at both ends [m]."""
    from compact.analysis.robust.law import between  # compiled code, imported when required

    forces = np.array([float(law(speed, 0.0)) for law in steady])
    sides = 1 if all(near == far for near, far in places) else 2
    ends = [[end(forces) / forces[0], *end(places, axis=0)[:sides]] for end in (np.min, np.max)]
    for by, *place in between(*ends).tolist():
        law = steady[0] if len(steady) == 1 else steady[0].scaled(by)
        yield along_stroke(law, turning, (place[0], place[-1]))


def _sleeve_samples(scene):
    """Distances to fresh mix at both ends [m], at shares of their ranges; equal where given equal."""
    given = scene.sleeve_distances
    ranges = [(min(side), max(side)) for side in zip(given, *sleeve_ends(scene).values(), strict=True)]
    pairs = [(share, share) for share in SHARES]
    if given[0] != given[1]:  # corners and centre
        pairs = [pair for pair in product(SHARES, repeat=2) if pair.count(SHARES[1]) != 1]
    return sorted(
        {tuple(low + by * (high - low) for by, (low, high) in zip(pair, ranges, strict=True)) for pair in pairs}
    )


def missing_for_pool(scene: Scene, cart: Cart) -> list[str]:
    """Return in words what a scene lacks to be simulated by `analysis.robust.drive_pool`."""
    drive = scene.drive
    reasons = {
        "an elastic drive": "drive.stiffness" in DRIVES[drive.kind].keys,
        "no backlash": not drive.backlash,
        "no dwell": not scene.motion.dwell,
        "no end springs": cart.end_springs is None,
        "a return stroke over loose mix": cart.return_load_ratio == 1,
        "damping": bool(drive.damping),
    }
    return [words for words, holds in reasons.items() if not holds]
