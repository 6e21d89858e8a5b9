"""Pore air under the roller of the published lift: one-way, coupled, and by columns, over permeability and speed.

    python studies/pore_air.py
    python studies/pore_air.py --coupled
    python studies/pore_air.py --growth --increments 7

The first command prints the changes of load and resistance by the air at the deformation without air, for a constant
permeability and with occlusion, by finite elements and by columns, and the speeds at which the air takes a tenth of the
load. The second one solves for coupled contacts: the pressure depends on speed over permeability alone, so that one
series over this ratio serves every permeability. A ratio at which the bow wave finds no steady state ends a series.

The third command rolls on without a search, at the permeability of the prior, with occlusion. It starts from the
skeleton without air, from the pressure at its deformation, and from a high wave (0.1 m at `FAST`). It prints the
growth of the wave per travel [mm2/mm]: of its area, and of its mass, inflow less outflow over the density as fed.

Lift: 0.06 m thick, of 0.98 after compaction, 3 mm deep, with the Heckel slope and initial density ratio of an earlier
fit; mix of the prior without an effect of the rate.
Changes are relative to the contact without air.
"""

import argparse
from pathlib import Path
from time import process_time

import numpy as np

from compact.analysis.contact_cases import case_of, scene_mix
from compact.analysis.pore_air import air_curve, air_under
from compact.engines.column import engine as column
from compact.engines.compaction import engine as compaction
from compact.engines.compaction.rolling import DAMPING
from compact.engines.pore_air.coupled_rolling import CoupledRolling, roll_coupled
from compact.engines.pore_air.steady_flow import RollerAir
from compact.files import write_figure
from compact.material.pore_air import PoreAir, water_volume
from compact.scene.loader import load_scene

SCENE = Path(__file__).parents[1] / "compact" / "data" / "scenes" / "loveikin-2015.toml"
DEPTH = 3.0e-3  # [m]
FED, LOOSE, LOOSE_DEPTH = 0.936, 0.90, 5.3e-3  # [-], [-], [m]; the looser feed reaches a similar density
SPEEDS = (0.007, 0.03, 0.133, 0.45, 2.1)  # [m/s]
PERMEABILITIES = (1e-12, 1e-13, 1e-14)  # [m2]
OCCLUSIONS = (None, 0.95, 0.90, 0.85)  # [-], saturations; None: constant permeability
RATIOS = (7e10, 2e11, 5e11, 1e12, 2e12)  # [1/(m s)], speed over permeability of the coupled contacts
OCCLUDED_RATIOS = (1e10, 3e10, 1e11, 2e11, 4e11)
GROWTH_SPEEDS = (0.003, 0.01, 0.03, 0.13, 0.45)  # [m/s]
FAST = 2.1  # [m/s], at which the bow wave of the third start rises
STARTS = ("drained", "one-way", "high wave")


def lift(fed=FED, depth=DEPTH):
    """Return layer, roller and mix of the lift for the engine compaction, and its moisture."""
    scene = load_scene(SCENE, **{
        "accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "layer.fed_density_ratio": fed,
        "mix.overrides.heckel_slope": 1.487e-5, "mix.overrides.rate_sensitivity": 0.0, "contact.indentation": depth,
    })  # fmt: skip
    case = case_of(scene, scene_mix(scene), scene.mean_speed)
    return case.layer, case.roller, case.material, scene.mix.moisture


def rolled(increments=None, **changes):
    """Return layer, roller, moisture and contact without air by finite elements."""
    layer, roller, mix, moisture = lift(**changes)
    options = {} if increments is None else {"increments": increments}
    return layer, roller, moisture, compaction.roll(layer, roller, mix, 0.133, **options)


def pore_air(permeability, moisture, fed=FED, occlusion=None):
    """Return the pore air of the lift."""
    return PoreAir(
        permeability=permeability, water=water_volume(moisture), fed_density_ratio=fed, occlusion_saturation=occlusion
    )


def one_way(case, occlusion, permeabilities=PERMEABILITIES, speeds=SPEEDS):
    """Return the changes of load and resistance [-], shape (permeabilities, speeds, 2)."""
    layer, roller, moisture, contact = case
    found = []
    for permeability in permeabilities:
        under = air_under(contact, layer, roller, pore_air(permeability, moisture, occlusion=occlusion))
        forces = [under.forces(under.pressure(speed))[:2] for speed in speeds]
        found.append(np.array(forces) / [contact.load, contact.resistance])
    return np.array(found)


def deaeration_speed(case, occlusion, permeability=1e-13):
    """Return the speed at which the air takes a tenth of the load [m/s]."""
    layer, roller, moisture, contact = case
    under = air_under(contact, layer, roller, pore_air(permeability, moisture, occlusion=occlusion))
    return air_curve(under, permeability, contact).deaeration_speed(permeability)


def coupled(case, ratios, occlusion=None, fed=FED):
    """Yield ratio, changes of load and resistance one-way and coupled [-], bow wave [m] and seconds.

    A ratio without a steady state has the reason in place of the coupled changes, and ends the series.
    """
    layer, roller, moisture, contact = case
    air, start = pore_air(1e-13, moisture, fed, occlusion), None
    under = air_under(contact, layer, roller, air)
    scale = np.array([contact.load, contact.resistance])
    for ratio in ratios:
        speed, begin = ratio * air.permeability, process_time()
        alone = np.array(under.forces(under.pressure(speed))[:2]) / scale
        try:
            start = roll_coupled(contact, air, speed, start=start)
        except RuntimeError as error:
            yield ratio, alone, str(error), None, process_time() - begin
            return
        changes = np.array(start.changes[:2]) / scale
        yield ratio, alone, changes, start.rolling.steps[-1].bow_wave, process_time() - begin


def growth(case, speed, start, travel=0.4, parts=4):
    """Yield travel [m], load, resistance [N/m], bow wave [m], and growth per travel of its area and its mass [m].

    The rolling is coupled at each step; each row is the mean of its part of the travel.
    """
    layer, _, moisture, contact = case
    air = pore_air(1e-13, moisture, occlusion=0.90)
    rolling = CoupledRolling(contact.solution, air, speed)
    frame, fed = rolling.frame, layer.height * FED
    bottom, damping = layer.height - contact.indentation, DAMPING / 4
    if start == "one-way":
        under = RollerAir(contact.solution, air)
        rolling.excess = under.at_points(under.pressure(speed))
    elif start == "high wave":
        rolling.speed = FAST
        for _ in range(round(0.1 / frame.step)):
            rolling.advance(bottom, damping)
        rolling.speed = speed
    begin = rolling.steps[-1].travel
    for _ in range(parts):
        steps, outflows = [], []
        for _ in range(round(travel / parts / frame.step)):
            steps.append(rolling.advance(bottom, damping))
            stretch = 1 + frame.to_rows(frame.solid.displacement_gradient(rolling.state.displacement)[:, 0])
            density = frame.to_rows(rolling.state.points.density_ratio)
            volume = frame.to_rows(frame.solid.volume_ratio(rolling.state.displacement))
            outflow = frame.row_heights @ (density * volume / stretch)
            outflows.append(outflow[frame.exit_column - 4 : frame.exit_column + 4].mean())
        slope = np.polyfit([step.travel for step in steps], [step.wave_area for step in steps], 1)[0]
        load, resistance = np.mean([(step.load, step.resistance) for step in steps], axis=0)
        mass = (fed - np.mean(outflows)) / FED
        yield steps[-1].travel - begin, load, resistance, steps[-1].bow_wave, slope, mass


def show_growth(case, speeds=GROWTH_SPEEDS, starts=STARTS):
    """Print the growth of the bow wave by speed and start."""
    print("   m/s     start  travel m    load  resistance  wave mm    area       mass")
    for speed in speeds:
        for start in starts:
            try:
                for travel, load, resistance, wave, area, mass in growth(case, speed, start):
                    forces = f"{travel:>10.3f}{load:>8.0f}{resistance:>12.0f}{1e3 * wave:>9.2f}"
                    print(f"{speed:>6g}{start:>10}{forces}{1e3 * area:>8.3f}{1e3 * mass:>11.3f}", flush=True)
            except RuntimeError as error:
                print(f"{speed:>6g}{start:>10}  {error}", flush=True)


def columns():
    """Return layer, roller, moisture and contact without air by columns at the same depth."""
    layer, roller, mix, moisture = lift()
    return layer, roller, moisture, column.roll(layer, roller, mix, 0.133)


def show_one_way(name, case, occlusions=OCCLUSIONS):
    """Print the changes by occlusion, permeability and speed."""
    print(f"\n{name}: load {case[3].load:.0f} N/m, resistance {case[3].resistance:.0f} N/m without air")
    print(f"{'occlusion':>10}{'m2':>8}" + "".join(f"{f'{speed:g} m/s':>16}" for speed in SPEEDS))
    for occlusion in occlusions:
        for permeability, row in zip(PERMEABILITIES, one_way(case, occlusion), strict=True):
            cells = "".join(f"{f'{100 * load:.2f} / {100 * resistance:.2f} %':>16}" for load, resistance in row)
            print(f"{'none' if occlusion is None else occlusion:>10}{permeability:>8.0e}{cells}")
        speed = deaeration_speed(case, occlusion)
        print(f"{'':>10}a tenth of the load at {'no speed' if speed is None else f'{speed:.3g} m/s'} with 1e-13 m2")


def draw(cases, occlusion=0.90):
    """Draw the change of the resistance over the speed for each permeability, one panel for each of the cases."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE

    speeds = np.geomspace(SPEEDS[0], SPEEDS[-1], 13)
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    panels = figure.subplots(1, len(cases), sharey=True)
    for panel, (name, case) in zip(panels, cases.items(), strict=True):
        for style, occluded in (("--", None), ("-", occlusion)):
            for colour, permeability, changes in zip(
                PALETTE, PERMEABILITIES, one_way(case, occluded, speeds=speeds), strict=False
            ):
                label = f"{permeability:.0e} m2" if occluded else None
                panel.loglog(speeds, 100 * changes[:, 1], style, color=colour, label=label)
        panel.axhline(10, color="0.6", linewidth=0.8)
        panel.set(xlabel="speed v [m/s]", ylim=(0.1, 300), title=name)
    panels[0].set(ylabel="change of the resistance by pore air [%]")
    panels[-1].legend(frameon=False, fontsize=8, title=f"dashed: open pores; full: occlusion at {occlusion:g}")
    return figure


def show_coupled(name, case, ratios, occlusion=None, fed=FED):
    """Print the coupled contacts next to the changes at the deformation without air."""
    wave = case[3].bow_wave
    print(f"\n{name}: bow wave {1e3 * wave:.2f} mm without air")
    print(f"{'v/kappa, 1/(m s)':>18}{'one-way load / resistance':>28}{'coupled':>20}{'bow wave, mm':>14}{'s':>6}")
    for ratio, alone, changes, height, seconds in coupled(case, ratios, occlusion, fed):
        cell = f"{100 * alone[0]:.2f} / {100 * alone[1]:.2f} %"
        if height is None:
            print(f"{ratio:>18.2g}{cell:>28}  no steady state: {changes}", flush=True)
        else:
            both = f"{100 * changes[0]:.2f} / {100 * changes[1]:.2f} %"
            print(f"{ratio:>18.2g}{cell:>28}{both:>20}{1e3 * height:>14.2f}{seconds:>6.1f}", flush=True)


def main(arguments=None):
    """Parse the command line and print what it requires."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--coupled", action="store_true", help="coupled contacts in place of the tables")
    parser.add_argument("--growth", action="store_true", help="growth of the bow wave without a search")
    parser.add_argument("--increments", type=int, help="elements per contact length")
    parser.add_argument("--out", type=Path, help="folder of the figure; default: no figure")
    given = parser.parse_args(arguments)
    case = rolled(given.increments)
    if given.growth:
        show_growth(case)
    elif given.coupled:
        show_coupled("constant permeability", case, RATIOS)
        show_coupled("occlusion at 0.90", case, OCCLUDED_RATIOS, 0.90)
        loose = rolled(given.increments, fed=LOOSE, depth=LOOSE_DEPTH)
        show_coupled(f"fed at {LOOSE:g}, constant permeability", loose, RATIOS, fed=LOOSE)
    else:
        cases = {"finite elements": case, "columns": columns()}
        show_one_way("finite elements", case)
        show_one_way("columns", cases["columns"], (None, 0.90))
        if given.out:
            write_figure(given.out / "pore_air.png", draw(cases))


if __name__ == "__main__":
    main()
