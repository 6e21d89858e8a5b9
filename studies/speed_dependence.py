"""Resistance of the published machine over the speed of its cart, by every engine.

    python studies/speed_dependence.py

The printed formula has no speed. Columns and finite elements are calibrated to the printed 9740 N and 0.179 at the mean
speed of the scene, where all their curves meet the formula; the height of the roller is that of this point at every
speed. The yield pressure then grows with the logarithm of the rate of compaction, and the pore air adds its pressure,
within the spread of the permeability of the mix. The linear layer has the viscoelastic part of the resistance only, and
is not for sizing. The finite elements roll a lift of assumed thickness; a roller of 0.11 m does not compact the whole
product in one pass.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from compact.analysis.study import Study
from compact.report.progress import tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
SPEEDS = np.geomspace(0.007, 2.1, 13)  # [m/s]; a twentieth of the mean speed to five times the printed one
PRINTED_SPEED = 0.45  # [m/s], of the cart; Loveikin and Pochka 2015
COLUMNS = {"accuracy.engine": "column", "mix.overrides.heckel_slope": 15.228e-6, "layer.fed_density_ratio": 0.93430}
LIFT = {
    "accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "mix.overrides.heckel_slope": 16.955e-6,
    "layer.fed_density_ratio": 0.94834,
}  # fmt: skip
LINEAR = {
    "accuracy.engine": "spectral", "machine.roller_condition": "frictionless", "machine.gap_geometry": "circle",
}  # fmt: skip
# Cap with a shear line on the subcritical side and a cohesion of loose mix [Pa] at which the lift is steady; with that
# of the prior no steady state is found. Heckel slope and initial density ratio remain those of the elliptic cap.
LINE = {"mix.law": "drucker-prager-cap", "mix.overrides.cohesion_loose": 20e3}
ELEMENTS, RATE, NO_RATE, AIR = "finite elements", " with rate", " without rate", " with rate and pore air"
CASES = {  # label -> changes of the scene
    "printed formula": {},
    "columns" + RATE: COLUMNS,
    ELEMENTS + RATE: LIFT,
    ELEMENTS + ", shear line, 20 kPa," + RATE: LIFT | LINE,
    "linear layer, viscoelastic part only": LINEAR,
}
HEADER = ("model", "speed_m/s", "resistance_N", "least_N", "largest_N")


@dataclass(frozen=True)
class Curve:
    """Resistance of a cart [N] over SPEEDS, or the reason of its absence; the band is that of the permeability."""

    name: str
    speeds: np.ndarray
    forces: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    reason: str = ""


def curves_of(name, scene, speeds):
    """Yield the curve of a case, and those of finite elements without a rate and with pore air."""
    study = Study(scene)
    try:
        if not study.stages.contacts.speeds:
            yield Curve(
                name, speeds, np.full(len(speeds), float(study.stages.resistance.resistance(scene.mean_speed, 0.0)))
            )
            return
        resistance = study.stages.resistance.sampled_map(None, float(speeds[-1]))
    except RuntimeError as error:
        yield Curve(name, speeds, np.full(len(speeds), np.nan), reason=str(error))
        return
    forces = resistance(speeds)
    yield Curve(name, speeds, forces)
    curve = study.stages.contacts.air_curve
    if name == ELEMENTS + RATE and curve is not None:
        # a mix of the yield pressure at the mean speed, without rate sensitivity, has the contact of that speed at all
        yield Curve(ELEMENTS + NO_RATE, speeds, np.full(len(speeds), float(resistance(scene.mean_speed))))
        permeability, length = (
            study.stages.contacts.mix.parameter("air_permeability"),
            scene.machine.rollers * scene.machine.roller_length,
        )
        by_air = [
            forces + length * np.array([curve.at(speed, value).resistance for speed in speeds.tolist()])
            for value in (permeability.value, permeability.high, permeability.low)
        ]
        yield Curve(ELEMENTS + AIR, speeds, *by_air)


def main(scene="loveikin-2015", cases=tuple(CASES), speeds=SPEEDS, changes=None, out=None):
    """Return the curves of some cases."""
    curves = []
    for name in tracked(cases, str):
        given = load_scene(SCENES / f"{scene}.toml", **CASES[name] | (changes or {}))
        curves += curves_of(name, given, speeds)
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "speed_dependence.csv", HEADER, rows(curves))
        _draw(curves).savefig(Path(out) / "speed_dependence.png", dpi=110)
    return curves


def rows(curves):
    """Return rows of HEADER; the band of a curve without one is nan."""
    missing = np.nan * curves[0].speeds
    return [
        (each.name, *map(float, row))
        for each in curves
        for row in zip(
            each.speeds, each.forces, missing if each.low is None else each.low,
            missing if each.high is None else each.high, strict=True,
        )
    ]  # fmt: skip


def _draw(curves):
    """Draw the resistance over the speed."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE

    figure = Figure(figsize=(8.6, 5.2), layout="constrained")
    axes = figure.subplots()
    styles = {"printed formula": "k-", "linear layer, viscoelastic part only": "0.55"}
    colours = iter(PALETTE)
    for each in curves:
        if each.reason:
            axes.plot([], [], " ", label=f"{each.name}: no steady state")
            continue
        style = styles.get(each.name)
        colour = {} if style == "k-" else {"color": style or next(colours)}
        line = "-" if style == "k-" else ("--" if NO_RATE in each.name else ":" if style else "-")
        (drawn,) = axes.plot(each.speeds, each.forces / 1e3, line, label=each.name, **(colour or {"color": "k"}))
        if each.low is not None:
            axes.fill_between(
                each.speeds, each.low / 1e3, each.high / 1e3, color=drawn.get_color(), alpha=0.15, linewidth=0,
                label="spread of the permeability",
            )  # fmt: skip
    axes.axvline(PRINTED_SPEED, color="0.8", linewidth=0.8, zorder=0)
    axes.annotate("printed speed", (PRINTED_SPEED, 0.02), (3, 0), xycoords=("data", "axes fraction"),
                  textcoords="offset points", fontsize="small", color="0.4")  # fmt: skip
    axes.set(xscale="log", xlabel="speed of the cart v [m/s]", ylabel="resistance of the cart F [kN]")
    axes.set_ylim(bottom=0)
    axes.grid(color="0.93")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure


def show(curves):
    """Print the resistance at some speeds."""
    shown = np.linspace(0, len(curves[0].speeds) - 1, 5).round().astype(int)
    print(f"{'N on a cart at':<40}" + "".join(f"{curves[0].speeds[k]:>10.3g}" for k in shown) + "  m/s")
    for each in curves:
        for name, forces in ((each.name, each.forces), ("  low", each.low), ("  high", each.high)):
            if each.reason:
                print(f"{name:<40} {each.reason[:300]}")
                break
            if forces is not None:
                print(f"{name:<40}" + "".join(f"{forces[k]:>10.0f}" for k in shown))


if __name__ == "__main__":
    show(main(out="out/speed_dependence"))
    print(f"{time.process_time():.0f} s of processor time")
