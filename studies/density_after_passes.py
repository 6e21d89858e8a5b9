"""What does a density ratio of 0.98 take in one to six passes: which load, which radius, which moisture?

The mix of one product is fed in as many equal lifts as there are passes. Under each the roller stands so high that all
that lies there has, after its rebound, the density asked for: by columns, which press every lift evenly. What a lift
takes is its own work: the resistance falls with the number of passes, and the load, whose contact gets shorter, by a
quarter for two passes and by half for six; what rebounds below bears the rest. The load goes with the root of the
radius, the resistance does not know it; both fall by a fifth for each percent of water, within what the prior knows.
"""

import itertools
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from compact.calibrate import blend
from compact.column import Column, feed, roll_over
from compact.engine import compaction
from compact.records import Roller
from compact.scene import load_scene

SCENES = Path(__file__).parent / "scenes"
HEADER = ("radius_m", "moisture", "passes", "largest_load_N", "largest_resistance_N", "density_ratio")
CALIBRATED = {"mix.overrides.heckel_slope": 13.995e-6, "layer.fed_density_ratio": 0.93444}  # to 9740 N and 0.179


def passes(scene, count):
    """The `ColumnRolled` of each pass over a layer fed in so many equal lifts, pressed to the scene's density."""
    material, product = compaction(scene, blend(scene)), scene.product.height
    speed, columns, results = scene.motion.stroke / scene.motion.duration, (), []
    lift = feed(product, scene.mix.density_ratio, material, speed).height / count
    for number in range(1, count + 1):
        columns += (Column(lift, material.fed_density_ratio),)

        def rolled(depth, columns=columns):
            roller = Roller(scene.machine.roller_radius, indentation=depth, profile="circle")
            return roll_over(columns, roller, material, speed)

        wanted = product * number / count
        nominal = sum(column.height for column in columns) - wanted  # the rebound comes on top
        depth = brentq(lambda depth, w=wanted: rolled(depth).exit_height - w, nominal, 1.3 * nominal, rtol=1e-10)
        results.append(rolled(depth))
        columns = results[-1].columns
    return results


def at(base, radius, moisture):
    """The scene with another roller and another moisture; Heckel's slope moves by the prior's factor."""
    prior = {"mix.overrides.heckel_slope": None}
    there = blend(base.replaced(**prior | {"mix.moisture": moisture})).heckel_slope
    factor = there / blend(base.replaced(**prior)).heckel_slope
    return base.replaced(
        **{
            "machine.roller_radius": radius,
            "mix.moisture": moisture,
            "mix.overrides.heckel_slope": blend(base).heckel_slope * factor,
        }
    )


def main(
    scene="loveikin-2015",
    changes=CALIBRATED,
    radii=(0.07, 0.09, 0.11),
    moistures=(0.09, 0.10, 0.11),
    counts=(1, 2, 3, 4, 5, 6),
    out=None,
):
    """Rows of HEADER, SI; the density ratio is that after the last pass."""
    base, rows = load_scene(SCENES / f"{scene}.toml", **changes), []
    for radius, moisture, count in itertools.product(radii, moistures, counts):
        results = passes(at(base, radius, moisture), count)
        load, resistance = (max(getattr(r, name) for r in results) for name in ("load", "resistance"))
        length = base.machine.roller_length
        rows.append((radius, moisture, count, load * length, resistance * length, results[-1].exit_density_ratio))
    if out:
        from compact.results import write_csv

        write_csv(Path(out) / "density_after_passes.csv", HEADER, rows)
        _draw(rows).savefig(Path(out) / "density_after_passes.png", dpi=110)
    return rows


def _draw(rows):
    """Largest load and resistance over the number of passes, a line for each roller and mix."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    moistures = sorted({row[1] for row in rows})
    radii = sorted({row[0] for row in rows})
    for (radius, moisture), group in itertools.groupby(rows, key=lambda row: row[:2]):
        _, _, counts, loads, resistances, _ = np.array(list(group)).T
        look = {"color": f"C{moistures.index(moisture)}", "linestyle": ("-", "--", ":")[radii.index(radius) % 3]}
        label = f"R {radius * 1e3:.0f} mm, W {moisture:.0%}"
        panels[0].plot(counts, loads / 1e3, **look, label=label)
        if radius == radii[0]:  # the resistance does not know the radius
            panels[1].plot(counts, resistances / 1e3, **look, label=f"W {moisture:.0%}, any radius")
    for ax, name in zip(panels, ("load on one roller [kN]", "resistance of one roller [kN]"), strict=True):
        ax.set(xlabel="passes, as many lifts", ylabel=f"largest {name}", ylim=(0, None))
        ax.legend(frameon=False, fontsize=8)
    panels[0].set_ylim(top=1.4e-3 * max(row[3] for row in rows))  # room for the legend
    return figure


def show(rows):
    """Print the rows of `main`, one line for each roller and mix."""
    print(f"{'R mm':>5}{'W':>6}   passes: largest load and resistance in N for each")
    for (radius, moisture), group in itertools.groupby(rows, key=lambda row: row[:2]):
        told = "  ".join(f"{row[2]}: {row[3]:.0f} {row[4]:.0f}" for row in group)
        print(f"{radius * 1e3:>5.0f}{moisture:>6.2f}   {told}")


if __name__ == "__main__":
    show(main(out="out/density_after_passes"))
