"""Models that reproduce the published operating point: 9740 N on a roller and 3562 N to move the cart.

Two rollers of the published machine, one pass that leaves the product at its height and density. First the prior alone,
by formulas, columns and the viscoelastic layer. Then the compacting engines are calibrated to the two printed forces
(Heckel slope and initial density ratio), and edges and pressures are compared with equations 1.5-1.7. The finite
elements roll one lift, whose thickness is assumed. They are fitted again on a coarse mesh with each unmeasured quantity
at the end of its range, and with the whole product in one pass (VARIANTS). The calibration reports the sensitivities.

A viscoelastic layer fails: at the required pressure its coefficient is 0.01 to 0.07, where the plant needs 0.18.
Columns have 0.17 before any fit. In two dimensions a bow wave forms ahead of the roller, so a quarter of the
indentation has the same resistance. In lifts only, both forces are reproduced inside the prior. The force on the cart
is that of two rollers plus the guide friction, 0.008 of the load of the rollers above the weight.
"""

import itertools
import time
import warnings
from pathlib import Path

import numpy as np

from compact.analysis.calibration import calibrate, calibration_digest
from compact.analysis.contact_cases import scene_mix
from compact.analysis.engineering_summary import engineering
from compact.analysis.engines import ENGINES
from compact.analysis.stages.contacts import roll_scene
from compact.report.progress import tracked
from compact.scene.loader import load_scene
from compact.scene.plant_data import read_measurements

SCENES = Path(__file__).parent / "scenes"
PRINTED_LOAD, PRINTED_FORCE = 9740.0, 3562.0  # N; Loveikin and Pochka 2015
SLOPES, FED = (13e-6 / 1.5, 13e-6 * 1.5), (0.93, 0.955)  # what the prior allows: K_H one-dimensional, fed density
CALIBRATED = ", calibrated"
WORDS = {"column": "columns", "fem": "linear layer", "compaction": "finite elements"}
TOLD = {  # of the refits, beside their points
    "machine.roller_length": "roller {:g} m",
    "resistance_coefficient": "coefficient {:g}",
}
LIFTS = {"layer.lift_thickness": 0.06}  # m, pressed at a time; no source has one
COARSE = 4  # increments of what only moves the fit
VARIANTS = {  # of the finite elements: changes of the scene, another coefficient, increments; each begins at the first
    "lifts": (LIFTS, None, 12),
    "lifts, friction angle 40°": (LIFTS | {"mix.overrides.friction_angle": 40.0}, None, COARSE),
    "lifts, roller 0.6 m": (LIFTS | {"machine.roller_length": 0.6}, None, COARSE),
    "lifts, coefficient 0.219": (LIFTS, 0.219, COARSE),
    "lifts, smooth roller": (LIFTS | {"machine.roller_condition": "frictionless"}, None, COARSE),
    "whole product": ({}, None, COARSE),
}
HEADER = (
    "engine", "K_H_1/Pa", "fed_density_ratio", "load_N", "coefficient", "cart_force_N",
    "capture_angle_rad", "length_m", "peak_pressure_Pa", "bow_wave_m",
)  # fmt: skip


def of_formulas(scene):
    """A row of HEADER by eqs 1.5-1.8."""
    said = engineering(scene, scene_mix(scene), scene_mix(scene).required_pressure)
    force = _cart_force(scene, said.roller_force, said.resistance_coefficient)
    return (
        "1.5-1.8", np.nan, np.nan, said.roller_force, said.resistance_coefficient, force, said.capture_angle,
        said.contact_length, said.pressure, np.nan,
    )  # fmt: skip


def of_contact(engine, scene, rolled):
    """A row of HEADER by an engine."""
    load, coefficient = rolled.load * scene.machine.roller_length, rolled.resistance / rolled.load
    compacts = ENGINES[engine.split(",")[0]].compacting
    return (
        engine, scene_mix(scene).heckel_slope if compacts else np.nan,
        scene.layer.fed_density_ratio if compacts else np.nan, load, coefficient,
        _cart_force(scene, load, coefficient), float(np.arcsin(rolled.leading / scene.machine.roller_radius)),
        rolled.leading - rolled.trailing, rolled.peak_pressure, getattr(rolled, "bow_wave", np.nan),
    )  # fmt: skip


def _cart_force(scene, load, coefficient):
    """Force [N] to move the cart: resistance of its rollers and friction of the guides."""
    machine = scene.machine
    lifted = abs(machine.rollers * load - machine.weight)
    return machine.rollers * load * coefficient + machine.guide_friction * lifted


def calibrated(scene, readings, engines, variants):
    """Calibrations by name: of columns, and of finite elements for each of the variants.

    A variant starts from the result of the first one, except for another lift thickness. A variant that fails is
    reported and left out, because the others take minutes each.
    """
    fits, first = {"column": calibrate(scene, readings)} if "column" in engines else {}, None
    asked_for = variants.items() if "compaction" in engines else ()
    for name, (changes, coefficient, increments) in tracked(asked_for, "calibration", alike=False):
        changed = scene.replaced(**changes)
        asked = readings if coefficient is None else readings.moved("resistance_coefficient", coefficient)
        near = first if first and first.scene.lift_thickness == changed.lift_thickness else None
        try:
            fit = calibrate(changed, asked, "compaction", increments=increments, initial_guess=near)
        except RuntimeError as error:
            warnings.warn(f"{name}: not calibrated: {error}", stacklevel=2)
            continue
        fits[f"compaction, {name}"], first = fit, first or fit
    return fits


def length_for(calibration, slope):
    """Roller length [m] with a given Heckel slope [1/Pa], interpolated between the refits; nan outside."""
    key = "machine.roller_length"
    known = {refit.value: refit.heckel_slope for refit in calibration.refits if refit.name == key and not refit.reason}
    known[calibration.scene.machine.roller_length] = calibration.heckel_slope
    lengths = np.array(sorted(known))
    slopes = np.array([known[length] for length in lengths])
    found = np.interp(np.log(slope), np.log(slopes), np.log(lengths), left=np.nan, right=np.nan)
    return float(np.exp(found))


def main(
    scene="loveikin-2015",
    measured="loveikin-2015-measured",
    engines=("column", "fem", "compaction"),
    variants=VARIANTS,
    changes=None,
    out=None,
):
    """(rows before, rows after the calibration of HEADER, calibrations by name); compacting engines only are
    calibrated.

    Finite elements have no row before: at the indentation of the prior, the bow wave grows without end.
    """
    scene = load_scene(SCENES / f"{scene}.toml", **(changes or {}))
    readings = read_measurements(SCENES / f"{measured}.toml")
    speed = scene.motion.stroke / scene.motion.duration
    linear = [engine for engine in engines if engine != "compaction"]
    found = {engine: roll_scene(scene, scene_mix(scene), speed, engine) for engine in tracked(linear, str, alike=False)}
    before = [of_formulas(scene)] + [of_contact(engine, scene, rolled) for engine, rolled in found.items()]
    fits = calibrated(scene, readings, engines, variants)
    after = [of_contact(name, fit.scene, fit.rolled[0]) for name, fit in fits.items()]
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "operating_point.csv", ("calibrated", *HEADER), [
            (word, *row) for word, rows in (("no", before), ("yes", after)) for row in rows
        ])  # fmt: skip
        pressures = {name + CALIBRATED: fit.rolled[0] for name, fit in fits.items()}
        _draw(found | pressures, fits).savefig(Path(out) / "operating_point.png", dpi=110)
    return before, after, fits


def _draw(contacts, fits):
    """Draw the contact pressure of each engine, and the fitted parameters compared with the prior."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    from compact.report.figures.style import PALETTE

    figure = Figure(figsize=(10.4, 5.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    names = list(dict.fromkeys(name.removesuffix(CALIBRATED) for name in contacts))
    colours = dict(zip(names, itertools.cycle(PALETTE)))
    for name, rolled in contacts.items():
        plain, fitted = name.removesuffix(CALIBRATED), name.endswith(CALIBRATED)
        label = _in_words(plain) if fitted else f"{_in_words(plain)}, not calibrated"
        left.plot(rolled.x * 1e3, rolled.pressure / 1e3, "-" if fitted else "--", color=colours[plain], label=label)
    left.axvline(0, color="0.8", linewidth=0.8, zorder=0)
    left.set(xlabel="x from the lowest point, + along the travel [mm]", ylabel="contact pressure p [kPa]")
    left.set_ylim(bottom=0)
    allowed = Rectangle((SLOPES[0] * 1e6, FED[0]), np.ptp(SLOPES) * 1e6, np.ptp(FED), color="0.92", label="the prior")
    right.add_patch(allowed)
    for name, fit in fits.items():
        right.plot(fit.heckel_slope * 1e6, fit.fed_density_ratio, "o", color=colours[name])
        for refit in fit.refits:
            at = refit.heckel_slope * 1e6, refit.fed_density_ratio
            right.plot(*at, "x", color=colours[name], markersize=4)
            if refit.name in TOLD and not refit.reason and name == "column":  # not of all others too
                right.annotate(
                    TOLD[refit.name].format(refit.value), at, (4, 3), textcoords="offset points", fontsize="x-small"
                )
    right.plot([], [], "x", color="0.4", markersize=4, label="one number at its bound")
    right.margins(x=0.12, y=0.08)
    right.set(xlabel="Heckel's slope $K_H$ [1/MPa]", ylabel="density ratio of the mix as fed k [-]")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure


def _in_words(name):
    engine, *rest = name.split(", ")
    return ", ".join([WORDS[engine], *rest])


def show(result):
    """Print the rows of `main`, and the uncertainty of the calibrations."""
    before, after, fits = result
    for title, rows in (("as the prior has it", before), ("calibrated", after)):
        print(f"{title:<44}{'K_H 1/MPa':>10}{'k fed':>8}{'load N':>9}{'coeff':>8}{'cart N':>8}{'angle':>8}"
              f"{'length mm':>10}{'peak kPa':>9}{'bow mm':>8}")  # fmt: skip
        for name, slope, fed, load, coefficient, force, angle, length, peak, bow in rows:
            print(f"  {name:<42}{slope * 1e6:>10.3f}{fed:>8.4f}{load:>9.0f}{coefficient:>8.4f}{force:>8.0f}"
                  f"{np.degrees(angle):>7.1f}°{length * 1e3:>10.2f}{peak / 1e3:>9.1f}{bow * 1e3:>8.2f}")  # fmt: skip
    print(f"{'printed':<62}{PRINTED_LOAD:>9.0f}{'':>8}{PRINTED_FORCE:>8.0f}")
    print(f"the prior allows K_H {SLOPES[0] * 1e6:.1f}-{SLOPES[1] * 1e6:.1f}/MPa, fed {FED[0]}-{FED[1]}")
    for name, fit in fits.items():
        length = length_for(fit, 13e-6)
        print(f"\n{name}; the prior's K_H 13/MPa asks for a roller of {length:.2f} m\n{calibration_digest(fit)}")


if __name__ == "__main__":
    show(main(out="out/operating_point"))
    print(f"{time.process_time():.0f} s of processor time")
