"""Required stiffness of an elastic drive, and motion laws that excite it.

Each law drives the cart through a spring of increasing stiffness, at one damping ratio, in periodic motion. The dynamic
amplification is the peak force over that of a rigid drive. A resistance that builds up after a turn lets go before the
cart has speed: a stiff spring then acts as a rigid drive. Against a step, as no mix has it, stiffness alone does not
remove the amplification. Friction stops the cart at a reversal until the spring has reversed its force; the driven end
gains speed meanwhile, and the cart starts with an impact. For a law whose acceleration a does not vanish at the
reversal, the impact is independent of stiffness: sqrt(4 F m a - (m a)^2) above F + m a without damping. For laws with
vanishing acceleration it decreases slowly, with k^(-1/6) if the law has a jerk at the reversal and k^(-1/4) if it has
only a snap.
"""

from itertools import product
from pathlib import Path

import numpy as np

from compact.analysis.study import Study
from compact.drive import simulate
from compact.machine.elastic_drive import ElasticDrive
from compact.report.progress import tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
HEADER = (
    "law", "stiffness_N/m", "peak_force_N", "dynamic_amplification", "nonuniformity", "peak_power_W", "stick_time_s",
    "energy_residual", "intervals", "turn",
)  # fmt: skip
LAWS = ("parabolic", "cubic", "quintic", "septic", "reversal-2", "reversal-4-free-acceleration", "combined-4")
STIFFNESSES = (1e5, 1e6, 1e7, 1e8, 1e9)  # [N/m]
TURNS = ("build-up", "step")  # the resistance after a turn


def main(scene="loveikin-2015", laws=LAWS, stiffnesses=STIFFNESSES, ratio=0.05, turns=TURNS, out=None, **changes):
    """Return rows of HEADER, SI, for each turn, law and stiffness; `ratio` is the damping ratio c/(2 sqrt(k m))."""
    scene = load_scene(SCENES / f"{scene}.toml", **{"motion.laws": list(laws), "output.items": [], **changes})
    studies = {turn: Study(scene.replaced(**{"drive.turn": turn})) for turn in turns}
    rows, runs = [], {}
    for turn, name, stiffness in tracked(product(turns, laws, stiffnesses), "drive"):
        stage, cycle = studies[turn].stages.resistance, studies[turn].stages.laws.cycles[name]
        spring = ElasticDrive(stiffness, 2 * ratio * np.sqrt(stiffness * stage.cart.mass))
        working = (scene.motion.run_up, 1 - scene.motion.run_down)
        run = runs[turn, name, stiffness] = simulate(stage.cart, spring, cycle, stage.resistance, working=working)
        rows.append((
            name, stiffness, run.peak_force, run.dynamic_amplification, run.nonuniformity, run.peak_power,
            run.stick_time, run.energy_residual, run.cost.intervals, turn,
        ))  # fmt: skip
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "elastic_drive.csv", HEADER, rows)
        _draw(rows, runs).savefig(Path(out) / "elastic_drive.png", dpi=110)
    return rows


def _draw(rows, runs):
    """Draw dynamic amplification and non-uniformity over stiffness for each law, and the drive force of two laws."""
    from matplotlib.figure import Figure

    from compact.report.figures import law_style

    figure = Figure(figsize=(13.0, 4.0), layout="constrained")
    panels = figure.subplots(1, 3)
    names, stiffnesses = list(dict.fromkeys(row[0] for row in rows)), sorted({row[1] for row in rows})
    turns = list(dict.fromkeys(row[-1] for row in rows))
    for (place, turn), name in product(enumerate(turns), names):
        found = (row for row in rows if (row[0], row[-1]) == (name, turn))
        _, stiffness, _, amplification, nonuniformity, *_ = zip(*found, strict=True)
        style = law_style(name) | ({"linewidth": 0.7, "alpha": 0.6} if place else {"marker": "o", "markersize": 3})
        panels[0].semilogx(stiffness, amplification, **style)
        if not place:
            panels[1].semilogx(stiffness, nonuniformity, **style, label=name)
    thin = f"; thin: {turns[1]}" if len(turns) > 1 else ""
    panels[0].set(xlabel="stiffness k [N/m]", ylabel="dynamic amplification of the peak force [-]")
    panels[0].set_title(f"{turns[0]}{thin}", fontsize=10)
    panels[1].set(xlabel="stiffness k [N/m]", ylabel="non-uniformity of the speed, working part [-]")
    panels[1].legend(frameon=False, fontsize=8)
    middle = stiffnesses[len(stiffnesses) // 2]
    for name in (names[0], names[-1]):
        run = runs[turns[0], name, middle]
        style = law_style(name) | {"linestyle": "-", "linewidth": 0.8}
        panels[2].plot(run.time, run.drive_force / 1e3, **style, label=name)
        panels[2].plot(run.rigid.time, run.rigid.drive_force / 1e3, linewidth=0.8, color="0.6", zorder=0)
    panels[2].set(xlabel="time t [s]", ylabel="drive force H [kN]")
    panels[2].set_title(f"{turns[0]}, k = {middle / 1e6:g} kN/mm; grey: rigid drive", fontsize=10)
    panels[2].legend(frameon=False, fontsize=8)
    return figure


def show(rows):
    """Print the rows of `main`."""
    print(f"{'turn':<10}{'law':<30}{'k N/m':>8}{'peak N':>9}{'dyn. ampl.':>12}{'non-unif.':>11}{'stick s':>9}")
    for name, stiffness, peak, amplification, nonuniformity, _, stick_time, *_, turn in rows:
        print(f"{turn:<10}{name:<30}{stiffness:>8.0e}{peak:>9.0f}{amplification:>12.3f}{nonuniformity:>11.3f}", end="")
        print(f"{stick_time:>9.4f}")


if __name__ == "__main__":
    show(main(out="out/elastic_drive"))
