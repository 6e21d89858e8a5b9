"""Speed fluctuation of one induction motor that drives one to four carts, and the effect of a flywheel.

The carts share one shaft at their usual angles; the torque of the motor is proportional to their number. The inertia is
on the motor shaft, so that the gear multiplies it by the square of its ratio. Three carts balance the load without a
flywheel. Four carts at right angles are no better than two, because a cart on its forward and one on its return stroke
load the shaft equally. The motor is assumed; no source specifies one.
"""

from itertools import product
from pathlib import Path

import numpy as np

from compact.analysis.study import Study
from compact.report.progress import tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
HEADER = (
    "law", "carts", "motor_inertia_kgm2", "period_s", "fluctuation", "peak_motor_power_W", "mean_motor_power_W",
    "peak_force_N", "nonuniformity", "energy_residual",
)  # fmt: skip
MOTOR = {  # for one cart; assumed: twice the mean power of a cart at the published cycle time
    "curve": "kloss",
    "torque": 8.0,
    "speed": 157.0,
    "breakdown_slip": 0.15,
    "gear_ratio": 145.0,
    "flywheel_inertia": 0.0,
}


LAWS, CARTS, INERTIAS = ("cubic", "reversal-4"), (1, 2, 3, 4), (0.01, 0.1, 1.0)  # inertias of the motor [kg m^2]


def main(scene="loveikin-2015", laws=LAWS, carts=CARTS, inertias=INERTIAS, out=None, **changes):
    """Return rows of HEADER, SI, for each law, number of carts and inertia of the motor with its flywheel."""
    base = load_scene(SCENES / f"{scene}.toml", **{"motion.laws": list(laws), "output.items": [], **changes})
    rows, runs = [], {}
    for count, inertia in tracked(product(carts, inertias), "motor"):
        motor = MOTOR | {"torque": MOTOR["torque"] * count, "inertia": inertia}
        study = Study(base.replaced(**{"drive.kind": "motor", "drive.carts": count, "drive.motor": motor}))
        for name, run in study.stages.drive.runs.items():
            runs[name, count, inertia] = run
            mean = float(np.sum(run.weights * run.motor_torque * run.speed)) / run.period
            rows.append((
                name, count, inertia, run.period, run.fluctuation, run.peak_motor_power, mean, run.peak_force,
                run.nonuniformity, run.energy_residual,
            ))  # fmt: skip
    rows.sort(key=lambda row: laws.index(row[0]))
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "motor_and_flywheel.csv", HEADER, rows)
        _draw(rows, runs).savefig(Path(out) / "motor_and_flywheel.png", dpi=110)
    return rows


def _draw(rows, runs):
    """Draw the fluctuation over the inertia, and the motor power over a turn with the least and largest inertia."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.5, 3.9), layout="constrained")
    panels, law = figure.subplots(1, 3), rows[0][0]
    counts, inertias = sorted({row[1] for row in rows}), sorted({row[2] for row in rows})
    for count in counts:
        label = f"{count} cart{'s' * (count > 1)}"
        fluctuation = [row[4] for row in rows if row[:2] == (law, count)]
        panels[0].loglog(inertias, fluctuation, marker="o", label=label)
        for ax, inertia in zip(panels[1:], (inertias[0], inertias[-1]), strict=True):
            run = runs[law, count, inertia]
            ax.plot(np.degrees(run.angle), run.motor_torque * run.speed, label=label)
            ax.set(xlabel="angle of the crankshaft [°]", xticks=range(0, 361, 90))
            ax.set_title(f"{law}, inertia {inertia:g} kg m²", fontsize=10)
    panels[0].set(xlabel="inertia on the motor shaft [kg m²]", ylabel="fluctuation of the shaft speed [-]")
    panels[0].set_title(law, fontsize=10)
    panels[0].legend(frameon=False, fontsize=8)
    top = 1.05 * max(line.get_ydata().max() for ax in panels[1:] for line in ax.lines)
    for ax in panels[1:]:
        ax.set(ylabel="motor power [W]", ylim=(0, top))
    return figure


def show(rows):
    """Print the rows of `main`."""
    print(f"{'law':<15}{'carts':>6}{'inertia':>9}{'period s':>10}{'fluctuation':>12}", end="")
    print(f"{'peak W':>8}{'mean W':>8}{'force N':>8}")
    for name, count, inertia, period, fluctuation, peak, mean, force, *_ in rows:
        print(
            f"{name:<15}{count:>6}{inertia:>9g}{period:>10.3f}{fluctuation:>12.4f}{peak:>8.0f}{mean:>8.0f}{force:>8.0f}"
        )


if __name__ == "__main__":
    show(main(out="out/motor_and_flywheel"))
