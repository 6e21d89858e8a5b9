"""Numerical stability at the limits of Poisson's ratio, width, depth, speed, friction and stiffness.

Each case is solved and compared with a result of another method: a closed form, another engine, a limit or a balance.
The table has the result, its relative error and the processor time. A case without a solution must raise an error with
an explanation; `result` is then that message, without a relative error.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from compact import fem, resistance
from compact.analysis import contact_cases
from compact.analysis.study import Study
from compact.cams import profile as cam
from compact.drive import Rigid, simulate
from compact.engines.column import engine as column
from compact.engines.halfplane import galin, hertz
from compact.engines.spectral import engine as spectral
from compact.machine.elastic_drive import ElasticDrive
from compact.material.laws import Elastic, Viscoelastic
from compact.motion import profile as motion
from compact.report.progress import tracked
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene

SCENE = Path(__file__).parents[1] / "compact" / "data" / "scenes" / "loveikin-2015.toml"
HEADER = ("case", "reference", "result", "relative error", "seconds")
LAYER, MIX = Layer(0.22), Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
STIFF = Elastic(youngs_modulus=10e6, poisson=0.3)
CASES = {}


def case(name, reference):
    """Register a function that returns a result and its relative error."""

    def register(solve):
        CASES[name] = (reference, solve)
        return solve

    return register


def both_engines(layer, roller, material, speed=0.2):
    """Return the load by finite elements, and its relative difference to the spectral engine."""
    exact = spectral.roll(layer, roller, material, speed)
    found = fem.roll(layer, roller, material, speed, tolerance=5e-3)
    return f"P {found.load:.6g} N/m", found.load / exact.load - 1


@case("Poisson's ratio 0.49, bonded", "spectral engine")
def nearly_incompressible():
    return both_engines(LAYER, Roller(0.11, indentation=0.003), replace(MIX, poisson=0.49))


@case("Poisson's ratio 0.5 - 1e-9, spectral", "Poisson's ratio 0.4999")
def incompressible():
    loads = [
        spectral.roll(LAYER, Roller(0.11, indentation=0.003), Elastic(youngs_modulus=10e6, poisson=nu), 0.2).load
        for nu in (0.5 - 1e-9, 0.4999)
    ]
    return f"P {loads[0]:.6g} N/m", loads[0] / loads[1] - 1


@case("frictionless base", "spectral engine")
def frictionless_base():
    return both_engines(Layer(0.22, base="slip"), Roller(0.11, indentation=0.003), MIX)


@case("contact 0.02 layer heights wide", "Hertz")
def narrow_contact():
    half_width = 0.02 * LAYER.height
    roller = Roller(10.0, peak_pressure=float(STIFF.contact_modulus * half_width / 20.0))
    found = spectral.roll(LAYER, roller, STIFF, 0.2)
    exact = hertz(radius=10.0, contact_modulus=STIFF.contact_modulus, half_width=half_width)
    return f"a {found.leading * 1e3:.4g} mm", found.load / exact.load - 1


@case("contact 5 layer heights wide, finite elements", "spectral engine")
def wide_contact():
    half_width, radius = 5 * LAYER.height, 40.0
    return both_engines(LAYER, Roller(radius, indentation=half_width**2 / (2 * radius)), STIFF)


@case("indentation 1e-9 m", "spectral engine")
def small_indentation():
    return both_engines(LAYER, Roller(0.11, indentation=1e-9), STIFF)


@case("speed 1e-9 m/s", "relaxed elastic layer")
def lowest_speed():
    roller = Roller(0.11, indentation=0.003)
    found = spectral.roll(LAYER, roller, MIX, 1e-9)
    return f"F/P {found.resistance / found.load:.1e}", found.load / spectral.roll(LAYER, roller, STIFF, 1.0).load - 1


@case("speed 1e9 m/s", "elastic layer of the instantaneous modulus")
def highest_speed():
    roller = Roller(0.11, indentation=0.003)
    found = spectral.roll(LAYER, roller, MIX, 1e9)
    instant = spectral.roll(LAYER, roller, Elastic(youngs_modulus=20e6, poisson=0.3), 1.0)
    return f"F/P {found.resistance / found.load:.1e}", found.load / instant.load - 1


@case("friction 1, sliding, high layer", "Galin")
def frictional():
    pressed = Roller(0.11, peak_pressure=5e4, friction=1.0, rolling="sliding")
    found = spectral.roll(Layer(20.0), pressed, STIFF, 0.2)
    exact = galin(radius=0.11, youngs_modulus=10e6, poisson=0.3, friction=1.0, peak_pressure=5e4)
    return f"F/P {found.resistance / found.load:.4f}", float(found.load / exact.load - 1)


@case("lower ply a thousand times as stiff", "layer of the upper ply alone")
def stiff_ply():
    from compact.rolling_contact import Ply

    plies = (Ply(thickness=0.12, stiffness=1e3), Ply(thickness=0.10, stiffness=1.0))
    roller = Roller(0.11, indentation=0.003)
    found = spectral.roll(Layer(0.22, plies=plies), roller, STIFF, 0.2)
    return f"P {found.load:.6g} N/m", found.load / spectral.roll(Layer(0.10), roller, STIFF, 0.2).load - 1


@case("columns compacted to a density ratio of 0.995", "mass balance")
def fully_compacted():
    scene = load_scene(SCENE)
    material = contact_cases.compaction_material(scene, Study(scene).stages.contacts.mix)
    fed = column.required_feed(0.22, 0.995, material, 0.2, radius=1.0)
    roller = Roller(1.0, indentation=fed.indentation)
    found = column.roll(Layer(fed.height), roller, material, 0.2)
    return f"k {found.exit_density_ratio:.6f}", found.mass_residual


@case("columns, second pass at the same height", "no resistance: the mix is compacted already")
def second_pass():
    scene = load_scene(SCENE)
    case = contact_cases.case_of(scene, Study(scene).stages.contacts.mix, 0.2, "column")
    layer, roller, material = case.layer, replace(case.roller, rolling="frictionless"), case.material
    first = column.roll(layer, roller, material, 0.2)
    height = layer.height - first.indentation
    recovered = sum(part.height for part in first.exit.layer)
    second = column.roll_over(first.exit.layer, replace(roller, indentation=recovered - height), material, -0.2)
    return f"F {second.resistance:.1e} N/m", second.resistance / first.resistance


@case("spring of 1e9 N/m, dry friction, parabolic law", "closed form of the impact without damping")
def stiff_drive():
    changes = {"motion.laws": ["parabolic"], "output.items": [], "drive.turn": "step"}  # of the closed form
    study = Study(load_scene(SCENE, **changes))
    cart = replace(study.stages.resistance.cart, guide_friction=0.0)
    force, inertia = study.stages.resistance.resistance.force, cart.mass * 4 * 0.4 / 9
    spring = ElasticDrive(1e9, 2 * 0.01 * math.sqrt(1e9 * cart.mass))
    run = simulate(cart, spring, study.stages.laws.cycles["parabolic"], study.stages.resistance.resistance)
    impact = force + inertia + math.sqrt(4 * force * inertia - inertia**2)
    return f"H {run.peak_force:.6g} N", run.peak_force / impact - 1


@case("speed through 0, stick and slip", "energy balance")
def stick_slip():
    study = Study(load_scene(SCENE, **{"motion.laws": ["quintic"], "output.items": []}))
    run = simulate(
        study.stages.resistance.cart,
        ElasticDrive(2e5, 1e3),
        study.stages.laws.cycles["quintic"],
        study.stages.resistance.resistance,
    )
    return f"stick time {run.stick_time:.4f} s", run.energy_residual


@case("complex law at a double root", "weights that differ by 1e-9")
def double_root():
    peaks = [
        motion.law("complex", 0.4, 3.0, energy_weight=0.625, acceleration_weight=0.25 + offset).peaks().acceleration
        for offset in (0.0, 1e-9)
    ]
    return f"a {peaks[0]:.9g} m/s2", peaks[0] / peaks[1] - 1


@case("dwell of length zero", "no dwell")
def no_dwell():
    law = motion.law("reversal-4", 0.4, 3.0)
    study = Study(load_scene(SCENE, **{"motion.laws": ["reversal-4"], "output.items": []}))
    runs = [
        simulate(study.stages.resistance.cart, Rigid(), cycle, study.stages.resistance.resistance)
        for cycle in (law, law.cycle(0.0, 0.0))
    ]
    return f"H {runs[1].peak_force:.6g} N", runs[1].peak_force / runs[0].peak_force - 1


@case("run-up of a millionth of the pass", "constant velocity")
def short_run_up():
    law = motion.law("reversal-4", 0.4, 3.0, 1e-6, 1e-6)
    return f"v {law.peaks().velocity:.9g} m/s", law.peaks().velocity / (0.4 / 3.0) - 1


@case("cam too narrow for its follower", "undercut is reported")
def undercut():
    narrow_cam = cam.Cam(motion.law("combined-3", 0.4, 3.0).cycle(0.0, 0.0), 0.5, cam.FlatFace())
    return f"undercut: {bool(narrow_cam.undercut)}", 1.0 - bool(narrow_cam.undercut)


@case("discontinuous resistance over speed", "error with an explanation")
def discontinuous_resistance():
    return resistance.sample_resistance(lambda v: (1e3 + 1e3 * (v > 0.1), None), 0.01, 0.2, 1e-6), math.nan


@case("load that exceeds the capacity of the layer", "error with an explanation")
def excessive_load():
    frictionless = {
        "accuracy.engine": "spectral",
        "machine.gap_geometry": "parabola",
        "machine.roller_condition": "frictionless",
    }
    scene = load_scene(SCENE, **{"contact.load": 1e7, **frictionless})
    return contact_cases.roll_scene(scene, Study(scene).stages.contacts.mix, 0.2).load, math.nan


@case("non-finite speed, load, indentation", "an error for each")
def not_a_number():
    refused, tried = 0, 0
    for solve in (spectral.roll, fem.roll):
        for roller, speed in ((Roller(0.11, indentation=0.003), math.nan), (Roller(0.11, indentation=0.003), math.inf)):
            tried += 1
            try:
                solve(LAYER, roller, MIX, speed)
            except ValueError:
                refused += 1
    for target in ({"load": math.nan}, {"indentation": math.inf}, {"peak_pressure": -math.inf}):
        tried += 1
        try:
            Roller(0.11, **target)
        except ValueError:
            refused += 1
    return f"{refused} of {tried} refused", refused / tried - 1


def main(names=None, out=None):
    """Return rows of HEADER for all cases, or for those in `names`."""
    rows = []
    for name in tracked(names or CASES, str):
        reference, solve = CASES[name]
        start = process_time()
        try:
            result, error = solve()
        except (ValueError, RuntimeError) as refusal:
            result, error = f"refused: {refusal}", math.nan
        rows.append((name, reference, str(result), float(np.abs(error)), process_time() - start))
    if out:
        from compact.files import write_csv, write_figure

        write_csv(Path(out) / "hard_cases.csv", HEADER, rows)
        write_figure(Path(out) / "hard_cases.png", draw(rows))
    return rows


def draw(rows):
    """Draw the relative error of each case that has one, below the name of its reference."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE

    errors = {f"{name}\n({reference})": error for name, reference, _, error, _ in rows if not math.isnan(error)}
    figure = Figure(figsize=(9.0, 0.8 + 0.42 * len(errors)), layout="constrained")
    panel = figure.subplots()
    panel.barh(list(errors), [max(error, 1e-16) for error in errors.values()], color=PALETTE[0], height=0.5)
    panel.set(xscale="log", xlim=(1e-16, 1), xlabel="relative error to the reference in brackets [-]")
    panel.tick_params(axis="y", labelsize=8)
    panel.invert_yaxis()
    return figure


def show(rows):
    """Print the rows of `main`."""
    for name, reference, result, error, seconds in rows:
        shown = "" if math.isnan(error) else f"{error:.1e}"
        print(f"{name:<48}{shown:>9}{seconds:8.2f} s  reference: {reference}\n    {result[:150]}")


if __name__ == "__main__":
    show(main(sys.argv[1:] or None, out="out/hard_cases"))
