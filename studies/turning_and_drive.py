"""Which motion law is first over the drive, and over the resistance after a turn of the cart?

The first law by peak force and by peak power over stiffness and damping ratio of an elastic drive, with a step of the
resistance at the turn; and over the turn, from the step through a linear build-up to the own track of the roller, with
the drive of the scene. Each row is the scene under changes of its keys. The second table checks peaks of the first with
a few lines of their own: even time steps without events or sticking, for friction that is smoothed about rest.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compact.analysis.study import Study
from compact.machine.cart import balance
from compact.report.progress import tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
SPRINGS = ((1e6, 0.05), (1e6, 0.02), (3e5, 0.05), (3e6, 0.05), (1e7, 0.05), (1e6, 0.2))  # [N/m], damping ratio
TURNS: dict[str, Any] = {  # rows of travel [m] and share
    "step": "step",
    "rebuilt over 10 mm": [[0.0, 0.0], [0.010, 1.0]],
    "25 mm": [[0.0, 0.0], [0.025, 1.0]],
    "50 mm": [[0.0, 0.0], [0.050, 1.0]],
    "own track of 110 mm, then 26 mm": [[0.0, 0.0], [0.110, 0.0], [0.136, 1.0]],
    "build-up of the engine": "build-up",
}
WIDTHS = (3e-3, 1e-3, 1e-4)  # [m/s], speeds up to which friction is in proportion to the speed
STEPS, PASSES, LAST = 10000, 14, 2  # [-], of a pass; passes from rest; those of the peaks
CHECKED = {  # laws by case
    "step": ("parabolic", "reversal-2"), "rebuilt over 10 mm": ("parabolic", "cubic"),
    "25 mm": ("cubic", "parabolic", "combined-2"), "50 mm": ("reversal-2", "parabolic", "combined-2"),
    "own track of 110 mm, then 26 mm": ("cycloidal", "parabolic", "combined-2"),
}  # fmt: skip
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


def checked(scene="loveikin-2015-engines", cases=CHECKED, steps=STEPS, **changes):
    """Peak force [N] and power [W] by case and law: of the program, and by even steps for each of `WIDTHS`."""
    base, rows = load_scene(SCENES / f"{scene}.toml", **BASE | changes), []
    for label, laws in tracked(list(cases.items()), "case"):
        stages = Study(base.replaced(**{"drive.turn": TURNS[label], "motion.laws": list(laws)})).stages
        for run in stages.drive.runs.values():
            peaks = stepped(run, np.array(WIDTHS), steps)
            rows.append((label, run.name, run.peak_force, *peaks[0], run.peak_power, *peaks[1]))
    return rows


def stepped(run, width, steps=STEPS):
    """Peak force [N] and power [W] of an elastic run by even steps, for each width w of the smoothed friction [m/s].

    v = (v + f dt) w/(w + r)  if |v + f dt| < w + r,  else nearer to zero by r = R(s) dt/m,   x = x + v dt
    """
    law, cart, steady = run.cycle.forward, run.cart, abs(float(run.resistance(run.cycle.forward.stroke, 0.0)))
    share = getattr(run.resistance, "forward", np.ones_like)
    travels = np.linspace(0, 1.2 * law.stroke, 5001)
    shares = share(travels)
    resistance = balance(cart, 0.0, steady * shares, np.ones(len(shares)), load_share=shares).drive_force
    phases, dt = np.arange(1, steps + 1) / steps, law.duration / steps
    y, rate = law.at_phase(phases, 0), law.at_phase(phases, 1)
    driven = zip(np.append(y, law.stroke - y), np.append(rate, -rate), strict=True)
    motion, turns = list(driven), PASSES // 2
    x, v, s, heading, peaks = *np.zeros((3, len(width))), np.ones(len(width)), np.zeros((2, len(width)))
    for number, (y, rate) in enumerate(motion * turns):
        limit = dt / cart.mass * np.interp(s, travels, resistance)
        free = v + dt / cart.mass * (run.drive.stiffness * (y - x) + run.drive.damping * (rate - v))
        v = np.where(np.abs(free) < width + limit, free * width / (width + limit), free - np.copysign(limit, free))
        s = np.where(v * heading < 0, 0.0, s) + np.abs(v) * dt
        heading, x = np.sign(v), x + v * dt
        if number >= (PASSES - LAST) * steps:
            force = run.drive.stiffness * (y - x) + run.drive.damping * (rate - v)
            peaks = np.maximum(peaks, np.abs([force, force * rate]))
    return peaks


def show_checked(rows):
    """Print the peaks of the program and those by even steps."""
    widths = "".join(f"{f'{1e3 * width:g} mm/s':>9}" for width in WIDTHS)
    print(f"{'even steps, friction smoothed over':<34}{'law':<22}{'N':>8}{widths}{'W':>8}{widths}")
    for case, law, *peaks in rows:
        print(f"{case:<34}{law:<22}" + "".join(f"{peak:>{8 if i % 4 == 0 else 9}.0f}" for i, peak in enumerate(peaks)))


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
    print()
    show_checked(checked())
