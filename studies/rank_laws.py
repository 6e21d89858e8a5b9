"""Which law asks least of the drive, do finite elements say what the formula says, and how sure is the order?

Every law, by every engine, against every drive. A place is sure where no law behind it can pass, each at its own worst,
and no other comes closer than the 1 % to which a machine is built: one law is run with the resistance less its error,
the other with the resistance and its error. The error is that of the map and of the engine, not that of the model: for
that the engines stand side by side, and formula and columns are ranked again over a sample of the prior's spread, with
nothing calibrated. The calibrated columns resist as the formula does, so they repeat its order; an order can change
only where the resistance knows the speed.

Limits: the resistance is that of a steady motion at the speed of the moment, which the turns are not (`reversal`). The
linear layer resists with a seventh of what the plant needs. Finite elements that compact press by 3 mm under a smooth
roller, with a rate of the mix, at three speeds: most of the time of all. Spring, its damping and motor are assumed, no
source names one. A hydraulic drive imposes the law: its forces are rigid ones.

`markdown` makes the table of the README. Each row names the roller, the gap and the quantity that is kept over speed,
so that a row of an engine is the main job of the scene with that engine unless the row says otherwise.
"""

from pathlib import Path

import numpy as np
from scipy.stats import kendalltau

from compact.analysis import machine_models as machine
from compact.analysis.engines import inputs
from compact.analysis.ranking_uncertainty import ties
from compact.analysis.study import Study
from compact.drive import CRITERIA, rank, simulate
from compact.engines.compaction import engine as compaction
from compact.machine.ranking import is_tie
from compact.report.progress import tracked
from compact.resistance import ResistanceMap
from compact.scene.engine_capabilities import adapt
from compact.scene.loader import load_scene
from compact.sweep import design as vary

SCENES = Path(__file__).parent / "scenes"
SMOOTH = {"machine.roller_condition": "frictionless"}
ENGINES = {  # what they change of the scene
    "formula": {},
    "column": {"mix.overrides.heckel_slope": 13.995e-6, "layer.fed_density_ratio": 0.93444},  # to 9740 N and 0.179
    "fem": {},
    "fem, half tolerance": {"accuracy.tolerance": 0.005},
    "compaction": SMOOTH | {"contact.indentation": 0.003, "mix.reference_speed": 0.2},
}
INCREMENTS = 4  # of elements that compact, a third of the engine's own
# Relative error of their resistance. On 6 increments the engine tells 0.0195, half of the change from these 4 (five
# minutes of processor time at the slowest speed): that change, and what it tells of the rest.
COARSE = 3 * 0.0195
CHEAP, SPREAD = ("formula", "column"), ("rigid", "elastic")  # engines and drives of the spread; a motor may stall
MOTOR = {  # as in `motor_and_flywheel`, of one cart
    "curve": "kloss",
    "torque": 8.0,
    "speed": 157.0,
    "breakdown_slip": 0.15,
    "gear_ratio": 145.0,
    "inertia": 0.1,
    "flywheel_inertia": 0.0,
}
STIFFNESS, DAMPING = 1e6, 3162.0  # N/m and N s/m: a damping ratio of 0.05 with the cart of 1000 kg
DRIVES = {
    "rigid": {"drive.kind": "rigid"},
    "elastic": {"drive.kind": "elastic", "drive.stiffness": STIFFNESS, "drive.damping": DAMPING},
    "motor": {"drive.kind": "motor", "drive.motor": MOTOR},
}
SHOWN = ("peak_force", "peak_power")
HEADER = (
    "engine", "drive", "criterion", "rank", "law", "value", "margin", "low", "high", "error", "sure", "roller", "gap",
    "held",
)  # fmt: skip
TITLES = {  # of the rows of the README's table
    "formula": "formula",
    "column": "columns, calibrated",
    "fem": "linear layer, `fem`",
    "compaction": "`compaction`, 3 mm, rate of the mix, coarse mesh",
}
MARKDOWN = ("resistance by", "roller, gap; kept over speed", "drive", "least peak force", "least peak power")
SPREAD_HEADER = (
    "engine", "drive", "criterion", "first", "stays_first", "kendall_tau", "least_resistance_N",
    "largest_resistance_N", "mixes",
)  # fmt: skip


def main(scene="loveikin-2015", engines=tuple(ENGINES), drives=tuple(DRIVES), samples=32, out=None, **changes):
    """(rows of HEADER, rows of SPREAD_HEADER), SI; the maps are kept in `out` for the next run."""
    rows, spreads = [], []
    for engine in tracked(engines, str, alike=False):
        asked = {"output.items": [], "accuracy.engine": engine.split(",")[0], **changes, **ENGINES[engine]}
        base = load_scene(SCENES / f"{scene}.toml", **asked)
        rows += ranked(base, engine, drives, out and Path(out) / engine.replace(", ", "-").replace(" ", "-"))
        if engine in CHEAP:
            spreads += spread(base, [drive for drive in drives if drive in SPREAD], samples)
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "rank_laws.csv", HEADER, rows)
        write_csv(Path(out) / "rank_laws_spread.csv", SPREAD_HEADER, spreads)
        _draw(rows, spreads).savefig(Path(out) / "rank_laws.png", dpi=100)
    return rows, spreads


def ranked(base, engine, drives, directory):
    """Rows of HEADER by one engine, every law against every drive; the map is that of a drive that swings, if any."""
    swings = next((name for name in drives if name != "rigid"), "rigid")
    fastest = Study(base.replaced(**DRIVES[swings]), directory=directory)
    if engine == "compaction":
        cart, resistance = compacting(fastest)
    else:
        cart, resistance = fastest.cart, fastest.resistance
        if fastest.layered and directory:
            directory.mkdir(parents=True, exist_ok=True)
            list(fastest.keep(directory, []))
    error = resistance.error + resistance.engine_error if fastest.layered else 0.0
    contact = condition(fastest)
    rows = []
    for name in drives:
        study = Study(base.replaced(**DRIVES[name]))
        carried = runs(study, cart, resistance)
        moved = [runs(study, cart, resistance.scaled(1 + way * error)) for way in (-1, 1)] if error else []
        for by in CRITERIA:
            rows += [(engine, name, by, *place, *contact) for place in places(by, carried, moved, error)]
    return rows


def condition(study):
    """Roller, gap and quantity kept over speed, as the engine of a study has them; empty for the formulas."""
    if not study.layered:
        return "", "", ""
    machine = adapt(study.scene, study.scene.accuracy.engine)[0].machine
    return machine.roller_condition, machine.gap_geometry, study.held.name


def compacting(study, increments=INCREMENTS):
    """(cart, `ResistanceMap`) by finite elements that compact, on a mesh a third as fine as the engine's own.

    Three speeds do: the rate enters with a small power of the speed, and the middle one tells what a line misses.
    """
    scene, rolls = study.scene, []
    speeds = study.fastest * np.array([1 / 10, 1 / 3, 1])
    for speed in speeds:
        layer, roller, material = inputs(scene, study.mix, "compaction", float(speed))
        near = rolls[-1] if rolls else None
        rolls.append(compaction.roll(layer, roller, material, float(speed), increments=increments, start=near))
    load, force = scene.machine.roller_length * np.array([[rolled.load, rolled.resistance] for rolled in rolls]).T
    force = scene.machine.rollers * force
    miss = abs(np.interp(np.log(speeds[1]), np.log(speeds[::2]), force[::2]) / force[1] - 1)
    cart = machine.cart(scene, float(load.mean()))
    return cart, ResistanceMap(speeds, force, float(miss), COARSE)


def runs(study, cart, resistance):
    """Law -> its run with a cart and a resistance, by the drive of the study."""
    working = (study.scene.motion.run_up, 1 - study.scene.motion.run_down)
    return {
        name: simulate(cart, study.means(name), cycle, resistance, working=working)
        for name, cycle in study.cycles.items()
    }


def places(by, runs, moved, error):
    """(rank, law, value, margin, low, high, error, sure) in order of a criterion."""
    ends = {name: [getattr(some[name], by) for some in (runs, *moved)] for name in runs}
    ordered = rank(runs.values(), by)
    for place, tied in zip(ordered, ties(ordered, by), strict=True):
        low, high = min(ends[place.run.name]), max(ends[place.run.name])
        behind = [min(ends[other.run.name]) for other in ordered if other.rank > place.rank]
        sure = high < min(behind, default=np.inf) and not (tied or place.reason)
        yield place.rank, place.run.name, place.value, place.margin, low, high, error, sure


def spread(base, drives, samples):
    """Rows of SPREAD_HEADER: over the prior's spread of all that the engine looks at of the mix, nothing calibrated."""
    base = base.replaced(**{"drive.rank_by": list(SHOWN)})
    given = base.mix.overrides.model_dump(exclude_none=True)
    prior = base.replaced(**{f"mix.overrides.{name}": None for name in given})
    design = vary.design(prior, [vary.read_design(f"mix.overrides=~{samples}")])
    mixes = [vary.scene_at(prior, *design.point(number))[0] for number in range(samples)]
    return [row for drive in drives for row in _survival(base, mixes, drive)]


def _survival(base, mixes, drive):
    studies = [Study(scene.replaced(**DRIVES[drive])) for scene in (base, *mixes)]
    nominal, *others = [study.rankings for study in studies]
    forces = [
        float(study.resistance(study.scene.motion.stroke / study.scene.motion.duration, 0.0)) for study in studies[1:]
    ]
    for by in SHOWN:
        best, value = _firsts(nominal[by]), _values(nominal[by])
        stays = np.mean([best == _firsts(other[by]) for other in others])
        tau = np.mean([_tau(value, _values(other[by])) for other in others])
        yield base.accuracy.engine, drive, by, "/".join(sorted(best)), stays, tau, min(forces), max(forces), len(mixes)


def _firsts(places):
    return {place.run.name for place in places if place.rank == 1}


def _values(places):
    return {place.run.name: place.value for place in places if np.isfinite(place.value)}


def _tau(one, other):
    """Kendall's tau between two rankings of the same laws [-]."""
    return kendalltau(list(one.values()), [other[law] for law in one]).statistic


def agreement(rows, engine, other, drive="rigid"):
    """Kendall's tau between the orders by two engines, by criterion of SHOWN."""
    found = {}
    for by in SHOWN:
        one, beside = (_finite(rows, name, drive, by) for name in (engine, other))
        found[by] = _tau(one, beside)
    return found


def _finite(rows, *key):
    """Law -> value by engine, drive and criterion, where it is finite."""
    return {row[4]: row[5] for row in rows if row[:3] == key and np.isfinite(row[5])}


def _draw(rows, spreads, most=8):
    """What each law asks above the least with its error, by engine; and the share of mixes in which the first stays."""
    from matplotlib.figure import Figure

    from compact.report.ranking_figures import ENGINE_LOOKS, dodges

    figure = Figure(figsize=(12.5, 4.6), layout="constrained")
    panels = figure.subplots(1, len(SHOWN) + 1, width_ratios=[3] * len(SHOWN) + [2])
    engines = [name for name in dict.fromkeys(row[0] for row in rows) if "," not in name]
    for ax, by in zip(panels, SHOWN, strict=False):
        values = {engine: _excess(rows, engine, by) for engine in engines}
        laws = sorted(values[engines[0]], key=lambda law: min(values[engine][law][0] for engine in engines))[:most]
        laws.sort(key=lambda law: values[engines[0]][law][0])
        for engine, dodge in zip(engines, dodges(len(engines)), strict=True):
            value, below, above = np.transpose([values[engine][law] for law in laws])
            color, mark, _ = ENGINE_LOOKS[engine]
            error = np.where((below > 0) | (above > 0), [below, above], np.nan)  # no whisker of none
            drawn = {"color": color, "mfc": "white", "markersize": 5, "linewidth": 1.0, "capsize": 2.5}
            ax.errorbar(value, np.arange(len(laws)) + dodge, xerr=error, fmt=mark, label=engine, **drawn)
        ax.set_yticks(range(len(laws)), laws, fontsize=8)
        ax.set_ylim(len(laws) - 0.5, -0.5)
        ax.set(xlabel=f"{by.replace('_', ' ')} above the least [%], rigid drive")
        ax.set_yticks(np.arange(len(laws) - 1) + 0.5, minor=True)
        ax.grid(axis="y", which="minor", color="0.92")
        ax.tick_params(axis="y", which="minor", length=0)
    said = {"title": "whiskers: the error of the resistance, of its map and of the engine", "title_fontsize": 8}
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=len(engines), frameon=False, fontsize=8, **said)
    for row, (_, _, _, first, stays, tau, *_) in enumerate(spreads):
        panels[-1].barh(row, 100 * stays, color="0.8")
        panels[-1].text(2, row, f"{first.split('/')[0]}, τ = {tau:.2f}", va="center", fontsize=7)
    told = [f"{engine}, {drive}\n{by.replace('_', ' ')}" for engine, drive, by, *_ in spreads]
    panels[-1].set_yticks(range(len(told)), told, fontsize=7)
    panels[-1].set(xlabel="mixes where the first stays [%]", xlim=(0, 100))
    panels[-1].invert_yaxis()
    return figure


def _excess(rows, engine, by):
    """Law -> (what it asks above the least, how much less and how much more its error makes of that) [%], rigid drive.

    The least is that without the error, so that the error of all laws together shows too.
    """
    found = {row[4]: (row[5], row[7], row[8]) for row in rows if row[:3] == (engine, "rigid", by)}
    found = {law: ends for law, ends in found.items() if np.isfinite(ends).all()}
    least = min(value for value, _, _ in found.values())
    return {
        law: (100 * (value / least - 1), 100 * (value - low) / least, 100 * (high - value) / least)
        for law, (value, low, high) in found.items()
    }


def markdown(rows):
    """Lines of the README's table: the first law by force and by power, by engine and drive."""
    lines = [f"| {' | '.join(MARKDOWN)} |", "|" + "---|" * len(MARKDOWN)]
    for engine, title in TITLES.items():
        drives = dict.fromkeys(row[1] for row in rows if row[0] == engine)
        for number, drive in enumerate(drives):
            first = {row[2]: row for row in reversed(rows) if row[:2] == (engine, drive) and row[3] == 1}
            roller, gap, held = first[SHOWN[0]][11:]
            contact = f"{roller}, {gap}; {held}" if held else "-"
            cells = [_first_cell(first[by], CRITERIA[by].unit) for by in SHOWN]
            lines.append(f"| {' | '.join(['' if number else title, '' if number else contact, drive, *cells])} |")
    return lines


def _first_cell(row, unit):
    """Law, value and margin of a first place; tie below the build tolerance, * if an error can change it."""
    if is_tie(row[6]):
        return f"{row[4]}, {row[5]:.0f} {unit} (tie)"
    doubt = "" if row[10] else " *"
    return f"{row[4]}, {row[5]:.0f} {unit} ({100 * row[6]:.2g} %){doubt}"


def show(result, best=3):
    """Print the best places of `main`, and what the spread leaves of them."""
    rows, spreads = result
    print(f"{'engine':<21}{'drive':<9}{'criterion':<12}{'':>2} {'law':<30}{'value':>8}{'margin':>8}{'error':>8}  sure")
    for engine, drive, by, place, law, value, margin, _, _, error, sure, *_ in rows:
        if by in SHOWN and place <= best:
            print(f"{engine:<21}{drive:<9}{by:<12}{place:>2} {law:<30}{value:>8.0f}", end="")
            print(f"{'tie' if is_tie(margin) else f'{margin:.2%}':>8}{error:>8.2%}  {'sure' if sure else '-'}")
    for engine, drive, by, first, stays, tau, low, high, mixes in spreads:
        print(f"{engine}, {drive}, {by}: {first} stays first in {stays:.0%} of {mixes} mixes, ", end="")
        print(f"Kendall's tau {tau:.3f}; the cart meets {low:.0f} to {high:.0f} N")
    engines = list(dict.fromkeys(row[0] for row in rows))
    for engine in engines[1:]:
        other = engine.split(",")[0] if "," in engine else engines[0]
        found = ", ".join(f"{by} {tau:.3f}" for by, tau in agreement(rows, engine, other).items())
        print(f"{engine} beside {other}: Kendall's tau {found}")


if __name__ == "__main__":
    result = main(out="out/rank_laws")
    show(result)
    print("\n".join(markdown(result[0])))
