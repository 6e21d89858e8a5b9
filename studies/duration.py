"""First laws of the published machine over the duration of a pass, by the engines valid for sizing.

    python studies/duration.py
    python studies/duration.py models [RESULTS]

The second command prints the first laws and the resistance of every model of the main scene at the printed speed and at
3 s, with their ratio to the linear layer that once led; it uses the maps in the folder RESULTS of `compact run`.

The formula, columns and finite elements are calibrated to the printed 9740 N and 0.179 at 3 s a pass, so that they
agree there by construction; over the duration they differ by the rate of compaction and by the pore air. The drive is
rigid. The height of the rollers is that of 3 s at every duration. Columns have no bow wave and are no second witness of
the formula. Finite elements roll a lift of assumed thickness.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from compact.analysis.sizing.durations import PEAKS, read_durations
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.report.progress import tracked
from compact.report.tables import format_column
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
OVER = "duration=0.3:3:8"
STATED = (3.0, 0.4 / 0.45, 0.3)  # [s]; chapter 5 of the source, the printed 0.45 m/s, and the limit of the range
COLUMNS = {"accuracy.engine": "column", "mix.overrides.heckel_slope": 15.228e-6, "layer.fed_density_ratio": 0.93430}
LIFT = {
    "accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "mix.overrides.heckel_slope": 16.955e-6,
    "layer.fed_density_ratio": 0.94834,
}  # fmt: skip
AIR = {"mix.pore_air": "one-way"}
CASES = {  # label -> changes of the scene
    "formula": {},
    "columns": COLUMNS,
    "columns, air": COLUMNS | AIR,
    "finite elements": LIFT,
    "finite elements, air": LIFT | AIR,
}
HEADER = ("model", "criterion", "first_law", "from_s", "to_s")


@dataclass(frozen=True)
class Answer:
    """First laws of a model: segments over the duration, and (law, value, margin) at STATED, by criterion."""

    name: str
    segments: dict
    stated: dict


def answer_of(name, scene, over=OVER, stated=STATED):
    """Rank the laws of a case over the duration."""
    durations = read_durations(over)
    every = tuple(sorted({*durations, *(each for each in stated if durations[0] <= each <= durations[-1])}))
    found = Study(scene, durations=every).over_durations
    at = {by: {each: found.orders[by][every.index(each)][0] for each in stated if each in every} for by in PEAKS}
    numbers = {
        by: {each: (first.run.name, first.value, first.margin) for each, first in firsts.items()}
        for by, firsts in at.items()
    }
    return Answer(name, {by: found.segments(by) for by in PEAKS}, numbers)


def main(scene="loveikin-2015", cases=tuple(CASES), over=OVER, stated=STATED, changes=None, out=None):
    """Return the first laws by some cases."""
    answers = []
    for name in tracked(cases, str):
        given = load_scene(SCENES / f"{scene}.toml", **CASES[name] | (changes or {}))
        answers.append(answer_of(name, given, over, stated))
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "duration.csv", HEADER, rows(answers))
        _draw(answers).savefig(Path(out) / "duration.png", dpi=110)
    return answers


def rows(answers):
    """Return rows of HEADER."""
    return [(each.name, by, *segment) for each in answers for by in PEAKS for segment in each.segments[by]]


def _draw(answers):
    """Draw the durations over which each law is first, a bar for each model."""
    from matplotlib.patches import Patch

    from compact.report.figures import law_style, panels

    figure, axes = panels(1, 2, (4.6, 0.38 * len(answers) + 0.35), left=1.7, bottom=1.05, top=0.35, gaps=(0.3, 0.3))
    names = {}
    for k, (ax, by) in enumerate(zip(axes[0], PEAKS, strict=True)):
        for row, each in enumerate(answers):
            for law, low, high in each.segments[by]:
                colour = names.setdefault(law, law_style(law)["color"])
                ax.barh(row, high - low, left=low, height=0.62, color=colour, edgecolor="white")
        ax.set(xscale="log", xlabel="duration of a pass T [s]", title=f"least {CRITERIA[by].quantity.term}")
        ax.set_xlim(min(s[1] for s in answers[0].segments[by]), max(s[2] for s in answers[0].segments[by]))
        marks = [mark for mark in (0.3, 0.5, 1, 2, 3) if ax.get_xlim()[0] <= mark <= ax.get_xlim()[1]]
        ax.set_xticks(marks, [f"{mark:g}" for mark in marks])
        ax.set_xticks([], minor=True)
        ax.set_yticks(range(len(answers)), [each.name for each in answers] if k == 0 else [""] * len(answers))
        ax.set_ylim(len(answers) - 0.2, -0.6)
        ax.axvline(STATED[1], color="black", linewidth=1, linestyle=":")
        ax.annotate("printed speed", (STATED[1], 0), (3, 2), xycoords=("data", "axes fraction"),
                    textcoords="offset points", fontsize="small")  # fmt: skip
        ax.spines[["top", "right"]].set_visible(False)
    figure.legend(
        [Patch(color=colour) for colour in names.values()], list(names), loc="lower center", ncols=4, frameon=False
    )
    return figure


def show(answers):
    """Print the crossovers and the first laws at the stated durations, as tables of Markdown."""
    print("| model | least | first laws over the duration |\n|---|---|---|")
    for each in answers:
        for by in PEAKS:
            parts = each.segments[by]
            words = ", ".join([f"{law} up to {high:.3g} s" for law, _, high in parts[:-1]] + [parts[-1][0]])
            print(f"| {each.name} | {CRITERIA[by].quantity.term} | {words} |")
    print("\n| model | least |" + "".join(f" {duration:.3g} s |" for duration in answers[0].stated[PEAKS[0]]))
    print("|---|---|" + "---|" * len(answers[0].stated[PEAKS[0]]))
    for each in answers:
        for by in PEAKS:
            cells = (
                f" {law}, {value:.4g} {CRITERIA[by].unit}, {'tie' if margin < 0.01 else f'{100 * margin:.2g} %'} |"
                for law, value, margin in each.stated[by].values()
            )
            print(f"| {each.name} | {CRITERIA[by].quantity.term} |" + "".join(cells))


def model_rows(study, old_lead="fem"):
    """Return first laws and resistance by model at each duration, with the ratio to an engine that once led, as text.

    Parameters
    ----------
    study : Study
        Study with an engine for comparison; the drive is that of the scene.
    """
    drive = study.scene.drive.kind
    old = next(model for model in study.models if model.engine == old_lead)
    lines = [f"| pass | model | least peak force | least peak power | mean resistance | over `{old_lead}` |"]
    lines.append("|---|---|---|---|---|---|")
    for duration in old.places:
        for model in study.models:
            cells = [f"{duration:.3g} s", f"`{model.engine}`"]
            for by in PEAKS:
                order = model.places[duration][drive][by]
                tie = " (tie)" if order[0].tie else ""
                cells.append(f"{order[0].law} {format_column([order[0].value], CRITERIA[by].unit, 3)[0]}{tie}")
            force = model.mean_resistance[duration]
            lines.append(
                "| " + " | ".join([*cells, f"{force:.4g} N", f"{force / old.mean_resistance[duration]:.3g}"]) + " |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:2] == ["models"]:
        results = Path(sys.argv[2]) if sys.argv[2:] else None
        print(model_rows(Study(load_scene(SCENES / "loveikin-2015-engines.toml"), directory=results)))
        sys.exit()
    show(main(out="out/duration"))
    print(f"{time.process_time():.0f} s of processor time")
