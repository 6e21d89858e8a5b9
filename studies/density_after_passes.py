"""Effect of compaction in one to six lifts on load and resistance, over radius and moisture.

The mix of one product is fed in as many equal lifts as there are passes. The height of the roller in each pass is such
that the mix has the required density after elastic recovery. The column model compacts every lift uniformly. Work is
done on the new lift alone, so the resistance of a pass decreases with the number of passes. The load decreases by a
quarter for two passes and by half for six: the contact becomes shorter, but the mix below still recovers elastically.
The load is proportional to the square root of the radius; the resistance is independent of it. Both decrease by a fifth
for each percentage point of moisture content, by the Heckel slope of the prior.

Further passes at the same height do not replace lifts. The density by columns does not change. By finite elements the
density decreases from the top downwards; each pass compacts the top 4 mm a little more, above a density ratio of 1, and
the mix below not at all (`profiles`, half a minute of processor time).
"""

import itertools
from pathlib import Path

import numpy as np

from compact.analysis.contact_cases import Pass, compaction_material, density, passes, scene_mix, there_and_back
from compact.engines.column.engine import required_feed
from compact.report.progress import tracked
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
HEADER = ("radius_m", "moisture", "passes", "largest_load_N", "largest_resistance_N", "density_ratio")
PROFILE_HEADER = ("engine", "pass", "load_N/m", "resistance_N/m", "bottom_m", "top_m", "density_ratio")
CALIBRATED = {
    "mix.overrides.heckel_slope": 15.228e-6,
    "layer.fed_density_ratio": 0.93430,
}  # calibrated to 9740 N and 0.179

# Options of the finite elements for the profiles; coarse, as later passes have a contact of a few millimetres and roll
# over a layer of 0.23 m in increments
ELEMENTS = {"increments": 4, "steady_tolerance": 1e-2}
TOP = 0.01  # [m], depth below the surface in which passes at one height differ


def in_lifts(scene, count):
    """Return the contacts of all passes over a layer fed in equal lifts, each compacted to the density of the scene."""
    material, density_ratio = compaction_material(scene, scene_mix(scene)), scene.mix.density_ratio
    speed = scene.motion.stroke / scene.motion.duration
    radius = scene.machine.roller_radius
    lift = required_feed(scene.product.height, density_ratio, material, speed, radius=radius).height / count
    roller = Roller(radius, indentation=lift / 100, profile="circle")  # replaced by the density
    stages = [Pass(lift if number else 0.0, exit_density_ratio=density_ratio) for number in range(count)]
    return passes(Layer(lift), roller, material, speed, stages)


def profiles(scene="loveikin-2015", changes=CALIBRATED, indentation=0.002, count=6, **numerics):
    """Return rows of PROFILE_HEADER by columns and by finite elements; one lift, one roller height in all passes.

    numerics : options of the finite elements in addition to ELEMENTS
    """
    scene, rows = load_scene(SCENES / f"{scene}.toml", **changes), []
    material, speed = compaction_material(scene, scene_mix(scene)), scene.motion.stroke / scene.motion.duration
    layer = Layer(scene.product.height * scene.mix.density_ratio / material.fed_density_ratio)
    roller = Roller(scene.machine.roller_radius, indentation=indentation, profile="deformed")
    engines = {"column": {}, "compaction": ELEMENTS | numerics}
    for engine, options in tracked(engines.items(), "profile"):
        done = passes(layer, roller, material, speed, there_and_back(count), engine=engine, **options)
        rows += [
            (engine, number, rolled.load, abs(rolled.resistance), *row)
            for number, rolled in enumerate(done, start=1)
            for row in density(rolled).tolist()
        ]
    return rows


def at(base, radius, moisture):
    """Return the scene with another radius and moisture content; the Heckel slope changes by the ratio of the prior."""
    prior = {"mix.overrides.heckel_slope": None}
    changed = scene_mix(base.replaced(**prior | {"mix.moisture": moisture})).heckel_slope
    factor = changed / scene_mix(base.replaced(**prior)).heckel_slope
    return base.replaced(
        **{
            "machine.roller_radius": radius,
            "mix.moisture": moisture,
            "mix.overrides.heckel_slope": scene_mix(base).heckel_slope * factor,
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
    """Return rows of HEADER, SI; the density ratio is that after the last pass."""
    base, rows = load_scene(SCENES / f"{scene}.toml", **changes), []
    for radius, moisture, count in tracked(itertools.product(radii, moistures, counts), "passes"):
        results = in_lifts(at(base, radius, moisture), count)
        load, resistance = (max(getattr(r, name) for r in results) for name in ("load", "resistance"))
        length = base.machine.roller_length
        rows.append((radius, moisture, count, load * length, resistance * length, results[-1].exit_density_ratio))
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "density_after_passes.csv", HEADER, rows)
        _draw(rows).savefig(Path(out) / "density_after_passes.png", dpi=110)
    return rows


def _draw(rows):
    """Draw the largest load and resistance over the number of passes, one line for each radius and moisture content."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE

    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    moistures = sorted({row[1] for row in rows})
    radii = sorted({row[0] for row in rows})
    for (radius, moisture), group in itertools.groupby(rows, key=lambda row: row[:2]):
        _, _, counts, loads, resistances, _ = np.array(list(group)).T
        style = {
            "color": PALETTE[moistures.index(moisture) % len(PALETTE)],
            "linestyle": ("-", "--", ":")[radii.index(radius) % 3],
        }
        label = f"R = {radius * 1e3:.0f} mm, W = {moisture:.0%}"
        panels[0].plot(counts, loads / 1e3, **style, label=label)
        if radius == radii[0]:  # the resistance is independent of the radius
            panels[1].plot(counts, resistances / 1e3, **style, label=f"W = {moisture:.0%}, every radius")
    for ax, name in zip(panels, ("load of one roller [kN]", "resistance of one roller [kN]"), strict=True):
        ax.set(xlabel="number of passes = number of lifts", ylabel=f"largest {name}", ylim=(0, None))
        ax.legend(frameon=False, fontsize=8)
    panels[0].set_ylim(top=1.4e-3 * max(row[3] for row in rows))  # room for the legend
    return figure


def draw_profiles(rows):
    """Draw the density over depth behind each pass: in the whole layer, and near the surface, where passes differ."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE

    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2)
    for (engine, number), group in itertools.groupby(rows, key=lambda row: row[:2]):
        *_, bottom, top, ratio = zip(*group, strict=True)
        depth = (top[-1] - np.array([*bottom, top[-1]])) * 1e3
        for ax in panels:
            if engine == "compaction":
                style = {"color": PALETTE[(number - 1) % len(PALETTE)], "label": f"finite elements, pass {number}"}
                ax.stairs(ratio[::-1], depth[::-1], orientation="horizontal", baseline=None, **style)
            elif number == 1:  # the same after every pass
                ax.plot([ratio[0]] * 2, depth[[0, -1]], "k--", label="columns, every pass")
    for ax, deepest in zip(panels, (depth[0], TOP * 1e3), strict=True):
        ax.axvline(1, color="0.7", linewidth=0.8, zorder=0, label="fully compacted")
        ax.set(xlabel="density ratio k [-]", ylabel="depth below the surface [mm]", ylim=(deepest, 0))
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def show(rows):
    """Print the rows of `main`, one line for each radius and moisture content."""
    print(f"{'R mm':>5}{'W':>6}   passes: largest load and resistance in N for each")
    for (radius, moisture), group in itertools.groupby(rows, key=lambda row: row[:2]):
        cells = "  ".join(f"{row[2]}: {row[3]:.0f} {row[4]:.0f}" for row in group)
        print(f"{radius * 1e3:>5.0f}{moisture:>6.2f}   {cells}")


def show_profiles(rows):
    """Print the rows of `profiles`, one line for each pass."""
    print(f"{'engine':<12}{'pass':>5}{'load N/m':>10}{'resistance N/m':>16}{'mean k':>9}{'top k':>8}")
    for (engine, number, load, resistance), group in itertools.groupby(rows, key=lambda row: row[:4]):
        *_, bottom, top, ratio = np.array([row[4:] for row in group]).T
        mean = (top - bottom) @ ratio / top[-1]
        print(f"{engine:<12}{number:>5}{load:>10.0f}{resistance:>16.1f}{mean:>9.4f}{ratio[-1]:>8.4f}")


if __name__ == "__main__":
    from compact.files import write_csv

    place = Path("out/density_after_passes")
    show(main(out=place))
    found = profiles()
    show_profiles(found)
    write_csv(place / "profiles.csv", PROFILE_HEADER, found)
    draw_profiles(found).savefig(place / "profiles.png", dpi=110)
