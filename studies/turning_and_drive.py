"""Which motion law is first over the drive, and over the resistance after a turn of the cart?

The first law by peak force and by peak power over stiffness and damping ratio of an elastic drive, with a step of the
resistance at the turn; and over the turn, from the step through a linear build-up to the own track of the roller, with
the drive of the scene. Each row is the scene under changes of its keys.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compact.analysis.study import Study
from compact.report.progress import tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parent / "scenes"
SPRINGS = ((1e6, 0.05), (1e6, 0.02), (3e5, 0.05), (3e6, 0.05), (1e7, 0.05), (1e6, 0.2))  # [N/m], damping ratio
TURNS: dict[str, Any] = {  # rows of travel [m] and share
    "step": "step",
    "rebuilt over 10 mm": [[0.0, 0.0], [0.010, 1.0]],
    "25 mm": [[0.0, 0.0], [0.025, 1.0]],
    "50 mm": [[0.0, 0.0], [0.050, 1.0]],
    "own track of 110 mm, then 26 mm": [[0.0, 0.0], [0.110, 0.0], [0.136, 1.0]],
    "build-up of the engine": "build-up",
}
FOLLOWED = "parabolic"  # law whose place is shown in every row
HEADER = ("case", "first by force", "force_N", f"{FOLLOWED} rank", f"{FOLLOWED}_N", "first by power", "power_W")
BASE = {"accuracy.engine": "formula", "compare": None, "output.items": [], "motion.other_durations": None}


class Row(NamedTuple):
    """First laws of one case: law and peak by force [N] and power [W], rank and peak force of the followed law [N]."""

    case: str
    law: str
    force: float
    rank: int
    followed: float
    frugal: str
    power: float


def main(scene="loveikin-2015-engines", springs=SPRINGS, turns=TURNS, out=None, **changes):
    """Return the rows of both tables."""
    base = load_scene(SCENES / f"{scene}.toml", **BASE | {"drive.turn": "step"} | changes)
    critical = 2 * np.sqrt(base.machine.mass)
    cases = [
        (f"k {stiffness:g} N/m, zeta {ratio:g}", {
            "drive.stiffness": stiffness, "drive.damping": float(ratio * critical * np.sqrt(stiffness)),
        })
        for stiffness, ratio in springs
    ]  # fmt: skip
    cases += [(label, {"drive.turn": turn}) for label, turn in turns.items()]
    rows = [_row(base, *case) for case in tracked(cases, "case")]
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "turning_and_drive.csv", HEADER, rows)
    return rows


def _row(base, label, keys):
    drive = Study(base.replaced(**keys)).stages.drive
    force, power = (drive.rankings[by] for by in ("peak_force", "peak_power"))
    followed = next(place for place in force if place.run.name == FOLLOWED)
    return Row(
        label, force[0].run.name, force[0].value, followed.rank, followed.value, power[0].run.name, power[0].value
    )


def show(rows):
    """Print the tables."""
    print(
        ("{:<34}" + "{:<30}{:>9}{:>6}{:>9}  " + "{:<30}{:>8}").format(
            "case", "first by force", "N", "place", "N", "first by power", "W"
        )
    )
    for row in rows:
        print("{:<34}{:<30}{:>9.0f}{:>6}{:>9.0f}  {:<30}{:>8.0f}".format(*row))


if __name__ == "__main__":
    show(main(out="out/turning_and_drive"))
