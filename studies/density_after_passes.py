"""Effect of compaction in one to six lifts on load and resistance, over radius and moisture.

The mix of one product is fed in as many equal lifts as there are passes. In each pass the height of the roller is such
that the mix has the required density after elastic recovery: by columns, which compact every lift uniformly. The work
belongs to the lift, so the resistance decreases with the number of passes. The load decreases by a quarter for two
passes and by half for six, because the contact becomes shorter while the recovery of the mix below continues. The load
is proportional to the root of the radius; the resistance is independent of it. Both decrease by a fifth for each
percent of moisture, within the spread of the prior.

Further passes at the same height do not replace lifts. Columns do not change; finite elements, in which the density
decreases from the top downwards, compact the top 4 mm a little more in each pass, beyond full density, and nothing
below (`profiles`, four minutes of processor time).
"""

import itertools
from pathlib import Path

import numpy as np

from compact.analysis.contact_cases import compaction_material, scene_mix
from compact.analysis.multipass import Pass, density, passes, there_and_back
from compact.engines.column.engine import required_feed
from compact.report.progress import tracked
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene

SCENES = Path(__file__).parent / "scenes"
HEADER = ("radius_m", "moisture", "passes", "largest_load_N", "largest_resistance_N", "density_ratio")
PROFILE_HEADER = ("engine", "pass", "load_N/m", "resistance_N/m", "bottom_m", "top_m", "density_ratio")
CALIBRATED = {"mix.overrides.heckel_slope": 13.995e-6, "layer.fed_density_ratio": 0.93444}  # to 9740 N and 0.179

# of the profiles: coarse and loose, since later passes have a contact of millimetres to march over a layer of 0.23 m
ELEMENTS = {"increments": 4, "steady_tolerance": 1e-2}
TOP = 0.01  # m below the surface, where passes at one height differ


def in_lifts(scene, count):
    """Contacts of all passes over a layer fed in equal lifts, each compacted to the density of the scene."""
    material, wanted = compaction_material(scene, scene_mix(scene)), scene.mix.density_ratio
    speed = scene.motion.stroke / scene.motion.duration
    lift = required_feed(scene.product.height, wanted, material, speed).height / count
    roller = Roller(scene.machine.roller_radius, indentation=lift / 100, profile="circle")  # gives way to the density
    stages = [Pass(lift if number else 0.0, exit_density_ratio=wanted) for number in range(count)]
    return passes(Layer(lift), roller, material, speed, stages)


def profiles(scene="loveikin-2015", changes=CALIBRATED, indentation=0.002, count=6, **numerics):
    """Rows of PROFILE_HEADER, by columns and by finite elements; the whole layer is fed first, with one height for all
    passes.

    numerics : options of the finite elements, default ELEMENTS
    """
    scene, rows = load_scene(SCENES / f"{scene}.toml", **changes), []
    material, speed = compaction_material(scene, scene_mix(scene)), scene.motion.stroke / scene.motion.duration
    layer = Layer(scene.product.height * scene.mix.density_ratio / material.fed_density_ratio)
    roller = Roller(scene.machine.roller_radius, indentation, profile="deformed")
    asked = {"column": {}, "compaction": ELEMENTS | numerics}
    for engine, options in tracked(asked.items(), "profile", alike=False):
        done = passes(layer, roller, material, speed, there_and_back(count), engine=engine, **options)
        rows += [
            (engine, number, rolled.load, abs(rolled.resistance), *row)
            for number, rolled in enumerate(done, start=1)
            for row in density(rolled).tolist()
        ]
    return rows


def at(base, radius, moisture):
    """Scene with another roller and another moisture; the Heckel slope changes by the factor of the prior."""
    prior = {"mix.overrides.heckel_slope": None}
    there = scene_mix(base.replaced(**prior | {"mix.moisture": moisture})).heckel_slope
    factor = there / scene_mix(base.replaced(**prior)).heckel_slope
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
    """Rows of HEADER, SI; the density ratio is that after the last pass."""
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
    """Draw the largest load and the resistance over the number of passes, one line for each roller and mix."""
    from matplotlib.figure import Figure

    from compact.report.figures.style import PALETTE

    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True)
    moistures = sorted({row[1] for row in rows})
    radii = sorted({row[0] for row in rows})
    for (radius, moisture), group in itertools.groupby(rows, key=lambda row: row[:2]):
        _, _, counts, loads, resistances, _ = np.array(list(group)).T
        look = {
            "color": PALETTE[moistures.index(moisture) % len(PALETTE)],
            "linestyle": ("-", "--", ":")[radii.index(radius) % 3],
        }
        label = f"R {radius * 1e3:.0f} mm, W {moisture:.0%}"
        panels[0].plot(counts, loads / 1e3, **look, label=label)
        if radius == radii[0]:  # the resistance does not know the radius
            panels[1].plot(counts, resistances / 1e3, **look, label=f"W {moisture:.0%}, any radius")
    for ax, name in zip(panels, ("load on one roller [kN]", "resistance of one roller [kN]"), strict=True):
        ax.set(xlabel="passes, as many lifts", ylabel=f"largest {name}", ylim=(0, None))
        ax.legend(frameon=False, fontsize=8)
    panels[0].set_ylim(top=1.4e-3 * max(row[3] for row in rows))  # room for the legend
    return figure


def draw_profiles(rows):
    """Draw the density over depth behind each pass: the whole layer, and the top, where passes differ."""
    from matplotlib.figure import Figure

    from compact.report.figures.style import PALETTE

    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2)
    for (engine, number), group in itertools.groupby(rows, key=lambda row: row[:2]):
        *_, bottom, top, ratio = zip(*group, strict=True)
        depth = (top[-1] - np.array([*bottom, top[-1]])) * 1e3
        for ax in panels:
            if engine == "compaction":
                look = {"color": PALETTE[(number - 1) % len(PALETTE)], "label": f"finite elements, pass {number}"}
                ax.stairs(ratio[::-1], depth[::-1], orientation="horizontal", baseline=None, **look)
            elif number == 1:  # the same after all
                ax.plot([ratio[0]] * 2, depth[[0, -1]], "k--", label="columns, every pass")
    for ax, deepest in zip(panels, (depth[0], TOP * 1e3), strict=True):
        ax.axvline(1, color="0.7", linewidth=0.8, zorder=0, label="full density")
        ax.set(xlabel="density ratio k [-]", ylabel="depth below the surface [mm]", ylim=(deepest, 0))
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def show(rows):
    """Print the rows of `main`, one line for each roller and mix."""
    print(f"{'R mm':>5}{'W':>6}   passes: largest load and resistance in N for each")
    for (radius, moisture), group in itertools.groupby(rows, key=lambda row: row[:2]):
        told = "  ".join(f"{row[2]}: {row[3]:.0f} {row[4]:.0f}" for row in group)
        print(f"{radius * 1e3:>5.0f}{moisture:>6.2f}   {told}")


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
