"""Load and resistance over moisture and density, by formula, columns and finite elements.

A sweep over moisture content, density ratio and engine, with the mix of the prior and a frictionless roller at the
required pressure. Finite elements solve the viscoelastic layer that equations 1.5-1.7 idealise, so that a difference
between the two is an error of the formula. The column model compacts irreversibly; a difference between it and both
others is an error of the linear model.

Result: the load by formula agrees with that of the viscoelastic layer within 7 % up to 10 % moisture content. It is 1.3
times as large at 11 % and 1.7 times at 12 %, where the mix relaxes more slowly than the roller passes. The resistance
differs everywhere: it is 3.5 to 18 times that of a viscoelastic layer by formula, and 1.2 to 16 times by columns, most
in dry mix. The resistance is caused by compaction. The coefficient by formula is constant, f2 + f3 = 0.168; that of
columns is 0.13 to 0.24 and increases with the density change.
"""

import sys
from pathlib import Path

import numpy as np

from compact.analysis.worker_pool import ProcessExecutor, SerialExecutor
from compact.report.progress import Progress
from compact.scene.loader import load_scene
from compact.sweep import design as vary
from compact.sweep.run import Sweep

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
PLAIN = {
    "machine.roller_condition": "frictionless",
    "layer.fed_density_ratio": 0.9,
    "mix.overrides.effective_modulus": None,  # that of the prior
    "mix.overrides.steel_friction": 0.0,
    "output.items": [],
}
COMPARED = {"load": "load", "resistance": "resistance", "capture_angle": "contact angle φ"}
ENGINES = ("formula", "column", "fem")


def main(
    scene="loveikin-2015",
    moistures="0.08:0.12:5",
    ratios="0.92:0.99:6",
    engines=ENGINES,
    workers=1,
    out=None,
    **changes,
):
    """Return the table of the sweep, moisture x density ratio x engine; kept in `out` and resumed from there."""
    from tempfile import TemporaryDirectory

    base = load_scene(SCENES / f"{scene}.toml", **PLAIN | changes)
    varied = [f"accuracy.engine={','.join(engines)}", f"mix.moisture={moistures}", f"mix.density_ratio={ratios}"]
    executor = SerialExecutor() if workers == 1 else ProcessExecutor(workers)
    with TemporaryDirectory() as temporary:
        many = Sweep(base, [vary.read_design(text) for text in varied])
        with Progress(total=many.size) as progress:
            progress.begin("points")
            step = lambda points, failed: progress.advance(points)  # noqa: E731
            table = many.run(out or temporary, executor=executor, resume=True, step=step)
    if out:
        from compact.files import write_figure

        write_figure(Path(out) / "moisture_density.png", figure(table))
    return table


def ratios_to(table, reference):
    """Return ratios to the reference by (engine, quantity), arrays over moisture and density ratio."""
    exact = table.sel(engine=reference)
    others = [engine for engine in table.engine.values if engine != reference]
    return {(e, name): table.sel(engine=e)[name] / exact[name] for e in others for name in COMPARED}


def figure(table, reference="fem"):
    """Draw maps of the ratio to the reference, one row for each engine, one column for each quantity."""
    from matplotlib.figure import Figure

    from compact.report.figures import label_contours

    found = ratios_to(table, reference)
    engines = list(dict.fromkeys(engine for engine, _ in found))
    drawn = Figure(figsize=(4.2 * len(COMPARED), 3.4 * len(engines)), layout="constrained")
    panels = drawn.subplots(len(engines), len(COMPARED), squeeze=False, sharex=True, sharey=True)
    for (engine, name), ax in zip(found, panels.ravel(), strict=True):
        values = found[engine, name]
        filled = ax.contourf(table.density_ratio, table.moisture, values, 9, cmap="viridis")
        label_contours(ax, ax.contour(filled, colors="black", linewidths=0.6))
        unreachable = (table.sel(engine=engine).not_reachable != "").values
        ax.contourf(table.density_ratio, table.moisture, unreachable, [0.5, 1.5], colors="none", hatches=["////"])
        ax.set_title(f"{COMPARED[name]}, {engine} over {reference} [-]", fontsize=10)
    for ax in panels[-1]:
        ax.set_xlabel("density ratio k [-]; hatched: not reachable by rolling")
    for ax in panels[:, 0]:
        ax.set_ylabel("moisture content W [-]")
    return drawn


def show(table, reference="fem"):
    """Print the largest differences between the engines."""
    for (engine, name), values in ratios_to(table, reference).items():
        finite = values.values[np.isfinite(values.values)]
        if finite.size:
            agreeing = np.mean(np.abs(finite - 1) < 0.1)
            print(
                f"{engine:<10}{name:<15} over {reference}: {finite.min():6.3f} to {finite.max():6.3f}, within 10 % at "
                f"{agreeing:.0%} of the points"
            )
    for engine in table.engine.values:
        failed = int((table.sel(engine=engine).reason != "").sum())
        print(f"{engine:<10}{failed} points without numbers")


if __name__ == "__main__":
    more = ("compaction",) if "compaction" in sys.argv else ()  # hours
    show(main(engines=(*ENGINES, *more), workers=2, out="out/moisture_density"))
