"""Models that reproduce the published operating point: 9740 N on a roller and 3562 N to move the cart.

Two rollers of the published machine leave the product at its height and density in one pass. First the prior is used
without calibration, by formulas, columns and the viscoelastic layer. Then Heckel slope and initial density ratio of the
compacting engines are calibrated to the two printed forces; contact edges and pressures are compared with equations
1.5-1.7. The finite elements roll one lift, whose thickness is assumed. They are calibrated again on a coarse mesh with
each unmeasured quantity at the end of its range, and with the whole product in one pass (VARIANTS). The calibration
reports the sensitivities.

A viscoelastic layer cannot reproduce the operating point: at the required pressure its rolling-resistance coefficient
is 0.01 to 0.07, that of the plant 0.18. Columns have 0.17 before any calibration. In two dimensions a bow wave forms
ahead of the roller, so a quarter of the indentation has the same resistance. Both forces are reproduced within the
prior by lifts only. The force on the cart is that of two rollers plus the guide friction, 0.008 of the load of the
rollers above the weight.
"""

import itertools
import time
import warnings
from pathlib import Path

import numpy as np

from compact.analysis.calibration import calibrate, calibration_digest
from compact.analysis.contact_cases import roll_scene, scene_mix
from compact.analysis.engineering_summary import engineering
from compact.engines import ENGINES
from compact.material.mix import prior
from compact.report.progress import tracked
from compact.scene.loader import load_scene
from compact.scene.plant_data import read_measurements

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
PRINTED_LOAD, PRINTED_FORCE = 9740.0, 3562.0  # [N]; Loveikin and Pochka 2015
# Prior: Heckel slope in confined compression at rest [1/Pa], with its range, and range of the initial density ratio [-]
PRIOR_SLOPE = prior(0.10, 0.98).parameter("heckel_slope")
SLOPES, INITIAL_RATIOS = (PRIOR_SLOPE.low, PRIOR_SLOPE.high), (0.93, 0.955)
CALIBRATED = ", calibrated"
NAMES = {"column": "column model", "fem": "linear layer", "compaction": "finite elements"}
REFIT_LABELS = {  # changed quantity -> label of the calibration repeated with it
    "machine.roller_length": "roller {:g} m",
    "resistance_coefficient": "coefficient {:g}",
}
LIFTS = {"layer.lift_thickness": 0.06}  # [m], compacted at a time; assumed, no source states it
MORE_COLOURS = ("black", "0.6")  # of curves beyond the palette
COARSE = 4  # [-], elements per contact length of the further variants, of which only the change is of interest
# Variants of the finite elements: changes of the scene, other coefficient, elements per contact length. The first one
# is the initial guess of the others.
VARIANTS = {
    "lifts": (LIFTS, None, 14),
    "lifts, friction angle 40°": (LIFTS | {"mix.overrides.friction_angle": 40.0}, None, COARSE),
    "lifts, roller 0.6 m": (LIFTS | {"machine.roller_length": 0.6}, None, COARSE),
    "lifts, coefficient 0.219": (LIFTS, 0.219, COARSE),
    "lifts, frictionless roller": (LIFTS | {"machine.roller_condition": "frictionless"}, None, COARSE),
    "whole product": ({}, None, COARSE),
}
HEADER = (
    "engine", "K_H_1/Pa", "initial_density_ratio", "load_N", "coefficient", "cart_force_N",
    "capture_angle_rad", "length_m", "peak_pressure_Pa", "bow_wave_m", "indentation_m",
)  # fmt: skip


def of_formulas(scene):
    """Return a row of HEADER by eqs 1.5-1.8."""
    results = engineering(scene, scene_mix(scene), scene_mix(scene).required_pressure)
    force = _cart_force(scene, results.roller_force, results.resistance_coefficient)
    return (
        "1.5-1.8", np.nan, np.nan, results.roller_force, results.resistance_coefficient, force,
        results.capture_angle, results.contact_length, results.pressure, np.nan, np.nan,
    )  # fmt: skip


def of_contact(engine, scene, rolled):
    """Return a row of HEADER by an engine."""
    load, coefficient = rolled.load * scene.machine.roller_length, rolled.resistance / rolled.load
    wave = rolled.bow_wave
    compacting = ENGINES[engine.split(",")[0]].reads("layer.fed_density_ratio")
    return (
        engine, scene_mix(scene).heckel_slope if compacting else np.nan,
        scene.layer.fed_density_ratio if compacting else np.nan, load, coefficient,
        _cart_force(scene, load, coefficient), float(np.arcsin(rolled.leading / scene.machine.roller_radius)),
        rolled.leading - rolled.trailing, rolled.peak_pressure, np.nan if wave is None else wave, rolled.indentation,
    )  # fmt: skip


def _cart_force(scene, load, coefficient):
    """Return the force [N] on the cart: resistance of its rollers and friction of the guides."""
    machine = scene.machine
    guide_load = abs(machine.rollers * load - machine.weight)
    return machine.rollers * load * coefficient + machine.guide_friction * guide_load


def calibrated(scene, readings, engines, variants):
    """Calibrate columns, and finite elements for each of the variants; return the calibrations by name.

    The result of the first variant is the initial guess of those with the same lift thickness. A variant that fails is
    left out with a warning, because the others take minutes each.
    """
    fits, first = {"column": calibrate(scene, readings)} if "column" in engines else {}, None
    requested = variants.items() if "compaction" in engines else ()
    for name, (changes, coefficient, increments) in tracked(requested, "calibration"):
        changed = scene.replaced(**changes)
        measured = readings if coefficient is None else readings.moved("resistance_coefficient", coefficient)
        guess = first if first and first.scene.lift_thickness == changed.lift_thickness else None
        try:
            fit = calibrate(changed, measured, "compaction", increments=increments, initial_guess=guess)
        except RuntimeError as error:
            warnings.warn(f"{name}: not calibrated: {error}", stacklevel=2)
            continue
        fits[f"compaction, {name}"], first = fit, first or fit
    return fits


def length_for(calibration, slope):
    """Interpolate the roller length [m] of a given Heckel slope [1/Pa] between the calibrations; nan outside."""
    key = "machine.roller_length"
    known = {refit.value: refit.heckel_slope for refit in calibration.refits if refit.name == key and not refit.reason}
    known[calibration.scene.machine.roller_length] = calibration.heckel_slope
    lengths = np.array(sorted(known))
    slopes = np.array([known[length] for length in lengths])
    found = np.interp(np.log(slope), np.log(slopes), np.log(lengths), left=np.nan, right=np.nan)
    return float(np.exp(found))


def main(
    scene="loveikin-2015",
    measured="loveikin-2015-printed",
    engines=("column", "fem", "compaction"),
    variants=VARIANTS,
    changes=None,
    out=None,
):
    """Return rows of HEADER before and after the calibration, and the calibrations by name.

    Compacting engines only are calibrated. Finite elements have no row before, because at the indentation of the prior
    the bow wave grows without limit.
    """
    scene = load_scene(SCENES / f"{scene}.toml", **(changes or {}))
    readings = read_measurements(SCENES / f"{measured}.toml")
    speed = scene.motion.stroke / scene.motion.duration
    linear = [engine for engine in engines if engine != "compaction"]
    found = {engine: roll_scene(scene, scene_mix(scene), speed, engine) for engine in tracked(linear, str)}
    before = [of_formulas(scene)] + [of_contact(engine, scene, rolled) for engine, rolled in found.items()]
    fits = calibrated(scene, readings, engines, variants)
    after = [of_contact(name, fit.scene, fit.rolled[0]) for name, fit in fits.items()]
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "operating_point.csv", ("calibrated", *HEADER), [
            (state, *row) for state, rows in (("no", before), ("yes", after)) for row in rows
        ])  # fmt: skip
        pressures = {name + CALIBRATED: fit.rolled[0] for name, fit in fits.items()}
        _draw(found | pressures, fits).savefig(Path(out) / "operating_point.png", dpi=110)
    return before, after, fits


def _draw(contacts, fits):
    """Draw the contact pressure of each engine, and the fitted parameters compared with the prior."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    from compact.report.figures import PALETTE

    figure = Figure(figsize=(10.4, 5.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    names = list(dict.fromkeys(name.removesuffix(CALIBRATED) for name in contacts))
    colours = dict(zip(names, itertools.cycle((*PALETTE, *MORE_COLOURS))))
    for name, rolled in contacts.items():
        plain, fitted = name.removesuffix(CALIBRATED), name.endswith(CALIBRATED)
        label = _label(plain) if fitted else f"{_label(plain)}, not calibrated"
        left.plot(rolled.x * 1e3, rolled.pressure / 1e3, "-" if fitted else "--", color=colours[plain], label=label)
    left.axvline(0, color="0.8", linewidth=0.8, zorder=0)
    left.set(xlabel="x from the lowest point, positive along the travel [mm]", ylabel="contact pressure p [kPa]")
    left.set_ylim(bottom=0)
    corner, width = (SLOPES[0] * 1e6, INITIAL_RATIOS[0]), np.ptp(SLOPES) * 1e6
    right.add_patch(Rectangle(corner, width, np.ptp(INITIAL_RATIOS), color="0.92", label="spread of the prior"))
    for name, fit in fits.items():
        right.plot(fit.heckel_slope * 1e6, fit.fed_density_ratio, "o", color=colours[name])
        for refit in fit.refits:
            at = refit.heckel_slope * 1e6, refit.fed_density_ratio
            right.plot(*at, "x", color=colours[name], markersize=4)
            if refit.name in REFIT_LABELS and not refit.reason and name == "column":  # labels of one engine only
                right.annotate(
                    REFIT_LABELS[refit.name].format(refit.value),
                    at,
                    (4, 3),
                    textcoords="offset points",
                    fontsize="x-small",
                )
    right.plot([], [], "x", color="0.4", markersize=4, label="one measured or assumed quantity at the end of its range")
    right.margins(x=0.12, y=0.08)
    right.set(xlabel="Heckel slope $K_H$ [1/MPa]", ylabel="initial density ratio k [-]")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure


def _label(name):
    engine, *rest = name.split(", ")
    return ", ".join([NAMES[engine], *rest])


def show(result):
    """Print the rows of `main`, and the uncertainty of the calibrations."""
    before, after, fits = result
    for title, rows in (("prior", before), ("calibrated", after)):
        print(f"{title:<44}{'K_H 1/MPa':>10}{'k init.':>8}{'load N':>9}{'coeff':>8}{'cart N':>8}{'angle':>8}"
              f"{'length mm':>10}{'peak kPa':>9}{'bow mm':>8}{'depth mm':>9}")  # fmt: skip
        for name, slope, initial_ratio, load, coefficient, force, angle, length, peak, bow, depth in rows:
            print(f"  {name:<42}{slope * 1e6:>10.3f}{initial_ratio:>8.4f}{load:>9.0f}{coefficient:>8.4f}{force:>8.0f}"
                  f"{np.degrees(angle):>7.1f}°{length * 1e3:>10.2f}{peak / 1e3:>9.1f}{bow * 1e3:>8.2f}"
                  f"{depth * 1e3:>9.2f}")  # fmt: skip
    print(f"{'printed':<62}{PRINTED_LOAD:>9.0f}{'':>8}{PRINTED_FORCE:>8.0f}")
    low, high = (1e6 * slope for slope in SLOPES)
    print(f"prior: K_H {low:.1f} to {high:.1f} 1/MPa, initial density ratio {INITIAL_RATIOS[0]} to {INITIAL_RATIOS[1]}")
    for name, fit in fits.items():
        length, slope = length_for(fit, PRIOR_SLOPE.value), 1e6 * PRIOR_SLOPE.value
        print(f"\n{name}; K_H {slope:.3g} 1/MPa of the prior requires a roller of {length:.2f} m")
        print(calibration_digest(fit))


if __name__ == "__main__":
    show(main(out="out/operating_point"))
    print(f"{time.process_time():.0f} s of processor time")
