"""Which model gives the published operating point, 9740 N on a roller and 3562 N to move the cart?

Two rollers of the published machine, one pass that leaves the product its height and density. Each engine first says
what the prior gives, before anything is fitted; then the engines that compact are calibrated to the two printed forces
(Heckel's slope and the density of the mix as fed), and edges and pressures stand beside eqs 1.5-1.7.

A linear layer cannot: at the pressure that the mix needs it resists with 1 to 7 % of its load, where the plant needs
18 %. Columns that stay pressed give 17 % before any fit. The force on the cart is two rollers and the friction of its
guides, 0.008 of what the rollers lift beyond the weight.
"""

from pathlib import Path

import numpy as np

from compact.calibrate import blend, calibrate
from compact.engine import COMPACTING, roll
from compact.measurements import read
from compact.scene import load_scene
from compact.study import engineering

SCENES = Path(__file__).parent / "scenes"
PRINTED_LOAD, PRINTED_FORCE = 9740.0, 3562.0  # N; Loveikin and Pochka 2015
HEADER = (
    "engine", "K_H_1/Pa", "fed_density_ratio", "load_N", "coefficient", "cart_force_N",
    "capture_angle_rad", "length_m", "peak_pressure_Pa",
)  # fmt: skip


def of_formulas(scene):
    """A row of HEADER by eqs 1.5-1.8."""
    said = engineering(scene, blend(scene), blend(scene).required_pressure)
    force = _cart_force(scene, said.roller_force, said.resistance_coefficient)
    return (
        "1.5-1.8", np.nan, np.nan, said.roller_force, said.resistance_coefficient, force, said.capture_angle,
        said.contact_length, said.pressure,
    )  # fmt: skip


def of_contact(engine, scene, rolled):
    """A row of HEADER by an engine."""
    load, coefficient = rolled.load * scene.machine.roller_length, rolled.resistance / rolled.load
    compacts = engine in COMPACTING
    return (
        engine, blend(scene).heckel_slope if compacts else np.nan,
        scene.layer.fed_density_ratio if compacts else np.nan, load, coefficient,
        _cart_force(scene, load, coefficient), float(np.arcsin(rolled.leading / scene.machine.roller_radius)),
        rolled.leading - rolled.trailing, rolled.peak_pressure,
    )  # fmt: skip


def _cart_force(scene, load, coefficient):
    """Force [N] to move the cart: its rollers, and guides that carry what they lift beyond the weight."""
    machine = scene.machine
    lifted = abs(machine.rollers * load - machine.weight)
    return machine.rollers * load * coefficient + machine.guide_friction * lifted


def main(
    scene="loveikin-2015",
    measured="loveikin-2015-measured",
    engines=("column", "fem", "compaction"),
    changes=None,
    out=None,
):
    """(rows before, rows after the calibration) of HEADER; only engines that compact are calibrated."""
    scene = load_scene(SCENES / f"{scene}.toml", **{"machine.rolling": "frictionless"} | (changes or {}))
    readings = read(SCENES / f"{measured}.toml")
    speed = scene.motion.stroke / scene.motion.duration
    found = {engine: roll(scene, blend(scene), speed, engine) for engine in engines}
    before = [of_formulas(scene)] + [of_contact(engine, scene, rolled) for engine, rolled in found.items()]
    fits = {engine: calibrate(scene, readings, engine) for engine in engines if engine in COMPACTING}
    after = [of_contact(engine, fit.scene, fit.rolled[0]) for engine, fit in fits.items()]
    if out:
        from compact.results import write_csv

        write_csv(Path(out) / "operating_point.csv", ("calibrated", *HEADER), [
            (word, *row) for word, rows in (("no", before), ("yes", after)) for row in rows
        ])  # fmt: skip
        calibrated = {f"{engine}, calibrated": fit.rolled[0] for engine, fit in fits.items()}
        _draw(found | calibrated).savefig(Path(out) / "operating_point.png", dpi=110)
    return before, after


def _draw(contacts):
    """Contact pressure of each engine."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    ax = figure.subplots()
    for name, rolled in contacts.items():
        ax.plot(rolled.x * 1e3, rolled.pressure / 1e3, "--" if name.endswith("calibrated") else "-", label=name)
    ax.axvline(0, color="0.8", linewidth=0.8, zorder=0)
    ax.set_xlabel("x from the lowest point, + along the travel [mm]")
    ax.set_ylabel("contact pressure p [kPa]")
    ax.legend(frameon=False)
    return figure


def show(result):
    """Print the rows of `main`."""
    for title, rows in zip(("as the prior has it", "calibrated"), result, strict=True):
        print(f"{title:<20}{'K_H 1/MPa':>10}{'k fed':>8}{'load N':>9}{'coeff':>8}{'cart N':>8}{'angle':>8}"
              f"{'length mm':>10}{'peak kPa':>9}")  # fmt: skip
        for name, slope, fed, load, coefficient, force, angle, length, peak in rows:
            print(f"  {name:<18}{slope * 1e6:>10.3f}{fed:>8.4f}{load:>9.0f}{coefficient:>8.4f}{force:>8.0f}"
                  f"{np.degrees(angle):>7.1f}°{length * 1e3:>10.2f}{peak / 1e3:>9.1f}")  # fmt: skip
    print(f"{'printed':<38}{PRINTED_LOAD:>9.0f}{'':>8}{PRINTED_FORCE:>8.0f}")


if __name__ == "__main__":
    show(main(out="out/operating_point"))
