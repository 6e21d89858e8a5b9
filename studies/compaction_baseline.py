"""Time and steady state of the compaction engine on the published lift, compared with an older version.

    python studies/compaction_baseline.py --against CHECKOUT
    python studies/compaction_baseline.py --reference 24

The first command rolls the lift from scratch, and deeper, at another speed and with another slope as neighbours, by
both versions, each in a process of its own with its folder on the path. It prints processor seconds on one core, after
a coarse contact that compiles.

The second one computes a reference by two starts: the bow wave of the steady state is raised and lowered by a tenth
along its slow mode, and the roller rolls on from both by increments, without any search. The waves approach the steady
one from both sides, so that the two last states bracket load and resistance.

Lift: 0.06 m thick, of 0.98 after compaction, with the Heckel slope and initial density ratio of an earlier fit.
The roller of 0.11 m is free with friction 0.35. Forces are those of one roller of 1.164 m.
"""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

DEPTH, SPEED, OTHER_SPEED = 3.0e-3, 0.4 / 3, 1.0  # [m], [m/s], [m/s]
FED = 0.9362  # [-], initial density ratio
ROLLER_LENGTH = 1.164  # [m]
WAVE_CHANGE = 0.1  # [-], of the area of the bow wave at either start of the reference
REFERENCE_TRAVEL = 120.0  # [-], travel of the reference over the contact length; a wave relaxes in some 24
COARSE = 4  # [-], elements per contact length of the contact that compiles
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
MEASURE = "--measure"  # option of the inner process
CASES = {  # depth [m] and speed [m/s] of neighbours, and Heckel slope over that of the lift [-]
    "from scratch": (DEPTH, SPEED, 1.0), "5 % deeper": (1.05 * DEPTH, SPEED, 1.0),
    "10 % deeper": (1.1 * DEPTH, SPEED, 1.0), "15 % deeper": (1.15 * DEPTH, SPEED, 1.0),
    "another speed": (DEPTH, OTHER_SPEED, 1.0), "slope 5 % higher": (DEPTH, SPEED, 1.05),
}  # fmt: skip


def published_lift(depth=DEPTH):
    """Return layer, roller and mix of the published lift at a depth [m]."""
    from compact.material.laws import Compaction
    from compact.rolling_contact import Layer, Roller

    angle = np.radians(35)
    mix = Compaction(  # as by `contact_cases.compaction_material`
        unloading_modulus=120e6, poisson=0.3, heckel_slope=16.38e-6, heckel_test="confined", loose_density_ratio=0.72,
        critical_slope=float(np.sqrt(3) * np.sin(angle)), tensile_strength=10e3 / float(np.tan(angle)),
        fed_density_ratio=FED, rate_sensitivity=0.02, reference_rate=1e-3,
    )  # fmt: skip
    roller = Roller(0.11, indentation=depth, profile="deformed", friction=0.35, rolling="free")
    return Layer(0.06 * 0.98 / FED), roller, mix


def measure(increments=None):
    """Return name, processor seconds, load [N] and resistance [N] of the cases by the version on the path."""
    from compact.engines.compaction.engine import roll

    options = {} if increments is None else {"increments": increments}
    layer, roller, mix = published_lift()
    roll(layer, roller, mix, SPEED, increments=COARSE)
    rows, first = [], None
    for name, (depth, speed, slope) in CASES.items():
        changed = replace(mix, heckel_slope=slope * mix.heckel_slope)
        begin = process_time()
        found = roll(layer, replace(roller, indentation=depth), changed, speed, start=first, **options)
        seconds = process_time() - begin
        first = first or found
        rows.append((name, seconds, found.load * ROLLER_LENGTH, found.resistance * ROLLER_LENGTH))
    return rows


def measured(folder, increments):
    """Return `measure` by the version in a folder."""
    option = [] if increments is None else ["--increments", str(increments)]
    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(Path(folder).resolve())}
    command = [sys.executable, str(Path(__file__).resolve()), MEASURE, *option]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def compare(older, increments=None):
    """Return rows of both versions: case, seconds older and newer, load [N], resistance [N] older and newer."""
    folders = (older, Path(__file__).parent.parent)
    before, now = (measured(folder, increments) for folder in folders)
    return [
        (name, old[0], new[0], old[1], new[1], old[2], new[2])
        for (name, *old), (_, *new) in zip(before, now, strict=True)
    ]


def reference(increments=24, travel=REFERENCE_TRAVEL, change=WAVE_CHANGE):
    """Return loads and resistances [N] of the search, and after a travel from below and above its bow wave.

    Loads are those on the mesh. The travel is one over the contact length. Values are means over the last one.
    """
    from compact.engines.compaction.engine import roll

    layer, roller, mix = published_lift()
    steady = roll(layer, roller, mix, SPEED, increments=increments)
    results = [(steady.load / steady.load_factor * ROLLER_LENGTH, steady.resistance * ROLLER_LENGTH)]
    for share in (-change, change):
        steps = rolled_on(moved(steady, share), round(travel * increments)).steps[-increments:]
        results.append(
            tuple(ROLLER_LENGTH * float(np.mean([getattr(s, name) for s in steps])) for name in ("load", "resistance"))
        )
    return results


def rolled_on(rolling, steps):
    """Return a roller after more steps at its depth, each to the full tolerance."""
    from compact.engines.compaction.rolling import DAMPING, FINAL_DAMPING_RATIO, ROLLING_TOLERANCE

    rolling.solver.tolerance = ROLLING_TOLERANCE
    height = rolling.frame.mesh.height - rolling.depth
    for _ in range(steps):
        rolling.advance(height, FINAL_DAMPING_RATIO * DAMPING)
    return rolling


def moved(result, share):
    """Return the solution with the area of its bow wave changed by a share along the slow mode."""
    from copy import copy

    rolling = copy(result.solution)
    result.relaxation.mode.add_to(rolling, share * rolling.steps[-1].wave_area)
    return rolling


def show(rows):
    """Print both versions and the ratio of their times."""
    print(f"{'published lift':<15}{'seconds older':>14}{'now':>7}{'ratio':>7}{'load, N':>18}{'resistance, N':>18}")
    for name, old, new, *forces in rows:
        loads, resistances = (f"{a:.0f} -> {b:.0f}" for a, b in (forces[:2], forces[2:]))
        print(f"{name:<15}{old:14.1f}{new:7.1f}{old / new:7.1f}{loads:>18}{resistances:>18}")


def show_reference(increments, rows):
    """Print the steady state, that of both starts, and their difference."""
    names = ("steady state", "from a lower wave", "from a higher wave")
    print(f"{increments} elements per contact length{'load, N':>18}{'resistance, N':>16}")
    for name, (load, resistance) in zip(names, rows, strict=True):
        print(f"{name:<30}{load:16.1f}{resistance:16.1f}")
    load, resistance = (100 * abs(high / low - 1) for low, high in zip(*rows[1:], strict=True))
    print(f"{'difference of both starts':<30}{load:14.2f} %{resistance:14.2f} %")


def main(arguments=None):
    """Parse the command line and print what it requires."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", metavar="CHECKOUT", help="folder of an older version")
    parser.add_argument("--reference", metavar="N", type=int, help="elements per contact length of the reference")
    parser.add_argument("--increments", type=int, help="elements per contact length of both versions")
    parser.add_argument(MEASURE, action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.measure:
        print(json.dumps(measure(given.increments)))
    if given.against:
        show(compare(given.against, given.increments))
    if given.reference:
        show_reference(given.reference, reference(given.reference))
    if not (given.measure or given.against or given.reference):
        parser.error("`--against CHECKOUT` or `--reference N` is required")


if __name__ == "__main__":
    main()
