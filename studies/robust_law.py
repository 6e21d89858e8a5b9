"""Which motion law is least hurt by a drive that nobody has measured?

The law with the least worst peak of the drive force over elastic drives of 0.3 to 10 MN/m and damping ratios of 0.02 to
0.2, against the best published law over the same drives, judged by simulation. The first table knows force and place of
the fresh mix; the second shows what is left of the gain where they are known by less: what measuring them is worth.
Outside its range a robust law is worse than a published one. The cart of the published machine weighs 1000 kg and runs
0.4 m in 0.889 s; F is 3486 N, the friction of the guides 80 N. 15 to 75 s on two processors for each row.
"""

from pathlib import Path
from typing import NamedTuple

from compact.analysis.robust.law import GAIN, Effort, PlantRange, between, robust_law
from compact.machine.cart import Cart
from compact.motion.limits import Limits
from compact.report.progress import tracked
from compact.resistance import DryResistance
from compact.turning import StrokeResistance, wave_shares

STROKE, DURATION, JERK = 0.4, 0.889, 200.0  # [m], [s], [m/s3]
STIFFNESS, DAMPING_RATIO = (3e5, 1e7), (0.02, 0.2)  # [N/m], [-]
FORCE, MASS, GUIDE_FRICTION = 3486.0, 1000.0, 0.05  # [N], [kg], [-]
# [m]: contact length, depth, bow wave, release
PUBLISHED_LIFT, THIN = (0.026, 2.1e-3, 2.54e-3, 0.20085e-3), (0.015, 1e-3, 0.13e-3, 0.19161e-3)
EDGE = 0.110  # [m], from the axle back to fresh mix at the turn
SPREAD = (0.64, 1.0, 1.43, 1.86)  # [-], of F over the whole spread of the mix
CART = Cart(
    mass=MASS, weight=1600.0, roller_positions=(0.27, -0.27), roller_reactions=(0.0, 0.0), guide_positions=(0.4, -0.4),
    pin_position=0.0, pin_height=0.0, roller_radius=0.2, guide_wheel_diameter=0.0, guide_friction=GUIDE_FRICTION,
)  # fmt: skip


class Known(NamedTuple):
    """What is known: samples of (F over `FORCE`, D [m]) that a search takes, and the lift."""

    words: str
    samples: list
    lift: tuple = PUBLISHED_LIFT

    def inner(self):
        """Return points inside the range of the samples, with which fresh drives judge."""
        ends = min(self.samples), max(self.samples)
        return between(*ends).tolist() if ends[0] < ends[1] else []


def pairs(forces, edges):
    """Every force with every distance."""
    return [(force, edge) for force in forces for edge in edges]


def within(words, force, edge):
    """Force known to a share [-] and D to an error [m]: corners and centre."""
    corners = pairs((1 - force, 1 + force), (EDGE - edge, EDGE + edge))
    return Known(words, [(1.0, EDGE), *sorted(set(corners))])


EXACT = (
    Known("open, D 26 mm", [(1.0, 0.026)]),
    Known("closed, D 110 mm", [(1.0, EDGE)]),
    Known("midway, D 180 mm", [(1.0, 0.180)]),
    Known("D 110 mm, make-up of 1 mm", [(1.0, EDGE)], lift=THIN),
)
LESS = (
    within("D within 5 mm", 0.0, 0.005),
    within("F within 10 %", 0.1, 0.0),
    within("D within 15 mm", 0.0, 0.015),
    within("D within 5 mm, F 10 %", 0.1, 0.005),
    within("F within 30 %", 0.3, 0.0),
    within("D within 5 mm, F 30 %", 0.3, 0.005),
    Known("F over the spread of the mix", pairs(SPREAD, (EDGE,))),
    Known("D over 26 to 154 mm", pairs((1.0,), (0.026, 0.068, 0.110, 0.154))),
    Known("nothing", pairs((0.64, 1.2, 1.86), (0.026, 0.090, 0.154))),
)
HEADER = ("known", "best published", "published_N", "robust_N", "ratio", "mean_N", "gap", "stiffness", "force", "edge")


def main(cases=EXACT + LESS, effort=None, out=None):
    """Return a row of HEADER for each case."""
    rows = [_row(case, effort or Effort()) for case in tracked(cases, "case")]
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "robust_law.csv", HEADER, rows)
    return rows


def _row(case, effort):
    """Row of HEADER of one case."""
    places = [*case.samples, *case.inner()]
    resistances, count = [_resistance(*each, case.lift) for each in places], len(case.samples)
    plants = PlantRange(STIFFNESS, DAMPING_RATIO, resistances[:count], resistances[count:])
    found = robust_law(CART, plants, STROKE, DURATION, Limits(jerk=JERK), effort=effort)
    worst, rival = found.worst, found.published_worst
    place = places[worst.resistance]
    return (
        case.words, found.published, rival.peak, worst.peak, found.ratio, found.mean, found.gap, worst.stiffness, *place
    )  # fmt: skip


def _resistance(force, edge, lift):
    """Resistance along the stroke for a force over `FORCE` and a distance of fresh mix [m]."""
    contact = (*lift, edge)
    share, load = wave_shares(*contact)
    return StrokeResistance(DryResistance(force * FORCE), share, share, load, load)


def show(rows):
    """Print rows of HEADER."""
    for words, name, published, robust, ratio, mean, _, stiffness, force, edge in rows:
        gain = (
            "gains nothing"
            if ratio > GAIN
            else f"worst at {stiffness / 1e6:.2g} MN/m, F {force:.2f}, D {edge * 1e3:.0f} mm"
        )
        print(f"{words:<30}{name:<20}{published:>6.0f} N{robust:>7.0f} N (mean {mean:.0f}){ratio:>6.2f}  {gain}")


if __name__ == "__main__":
    show(main(out="out/robust_law"))
