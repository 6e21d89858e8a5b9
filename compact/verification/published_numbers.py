"""The published numbers beside ours: the table behind `compact check`.

    rows() -> list of Row,  table(rows) -> str,  markdown(rows) -> str

Sources: A and B, the papers on the third-order reversal and on its boundary conditions; C, the paper on the four-cart
crank (Loveikin and Pochka 2015); D, the monograph on cam-driven roller forming. `data/published.csv` holds a number a
line: what is printed, the verdict, and the value `expected` of our side, exact or from formulas evaluated by mpmath
apart from this package; its column `origin` says which. The functions here compute our side afresh. Verdicts:

reproduced     agrees with the print to half a unit of its last digit
rounding       does not, for the print read it from a coarse table, or cut a number on the way
misprint       does not, and the right value follows from what the source itself demands
contradiction  does not, and no reading of the source gives the print
derived        nothing is printed; it follows from what is printed, or is our check of a formula

`printed` is a number as it stands there, or the quotient of two that do. D ch. 5 gives accelerations to thousandths and
drops trailing zeros: its 0.6 is 0.600. Slips of type alone (a lost bracket, square or sign at a line break) have no
number and no row.
"""

import csv
import itertools
import math
import textwrap
from collections import Counter
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from compact.verification import published_laws, published_machine

TOLERANCE = 1e-9  # relative, of ours against the expected value
WIDTH = 120  # columns of the table
BAR = "\\|"  # of a cell of Markdown
INDENT = " " * 19  # of the notes below a row
VERDICTS = ("reproduced", "rounding", "misprint", "contradiction")  # of what is printed


@dataclass(frozen=True)
class Row:
    """A published number beside ours.

    key : group and name, as in `data/published.csv`
    printed : as its digits stand, or as a fraction; empty where nothing is printed
    ours, expected : computed now, and the frozen reference, both in `unit`
    decimals : of the print where it drops trailing zeros, else None
    """

    key: str
    source: str
    quantity: str
    unit: str
    printed: str
    ours: float
    verdict: str
    expected: float
    note: str = ""
    decimals: int | None = None

    @property
    def group(self):
        """The part of the table it belongs to."""
        return self.key.split(".")[0]

    @property
    def agrees(self):
        """Whether ours is the print to half a unit of its last digit; a fraction must be met exactly."""
        if not self.printed:
            return False
        if "/" in self.printed:
            return math.isclose(self.ours, Fraction(self.printed), rel_tol=TOLERANCE)
        printed = Decimal(self.printed)
        if not printed.is_finite():
            return self.ours == float(printed)
        decimals = -printed.as_tuple().exponent if self.decimals is None else self.decimals
        return abs(self.ours - float(printed)) <= 0.5 * 10.0**-decimals * (1 + TOLERANCE)

    @property
    def kept(self):
        """Whether ours is as expected and the verdict is true of it."""
        if not math.isclose(self.ours, self.expected, rel_tol=TOLERANCE):
            return False
        if not self.printed:
            return self.verdict == "derived"
        return self.agrees == (self.verdict == "reproduced") and self.verdict in VERDICTS


def rows():
    """Every `Row`, in the order of `data/published.csv`, with our side computed now."""
    ours = computed()
    return [
        Row(
            key=key,
            ours=ours[key],
            decimals=int(line["decimals"]) if line["decimals"] else None,
            expected=float("inf" if line["expected"] == "inf" else Fraction(line["expected"])),
            **{name: line[name] for name in ("source", "quantity", "unit", "printed", "verdict", "note")},
        )
        for key, line in recorded().items()
    ]


def recorded():
    """The lines of `data/published.csv` by key, as dicts of text."""
    from importlib.resources import files

    text = files("compact").joinpath("data/published.csv").read_text(encoding="utf-8")
    return {line["key"]: line for line in csv.DictReader(text.splitlines())}


def computed():
    """Our side by key `group.name`, in the unit of its row."""
    return {f"{group}.{name}": float(value) for group, (_, part) in GROUPS.items() for name, value in part().items()}


def table(rows):
    """The rows as ASCII text of at most 120 columns: grouped, notes below their rows, the counts at the end."""
    header = _line("source", "quantity", "printed", "ours", "unit", "verdict")
    lines = []
    for group, members in itertools.groupby(rows, key=lambda row: row.group):
        lines += ["", *textwrap.wrap(GROUPS[group][0], WIDTH), header, "-" * len(header)]
        for row in members:
            lines.append(_line(row.source, row.quantity, row.printed, f"{row.ours:.6g}", row.unit, row.verdict))
            lines += textwrap.wrap(_note(row), WIDTH, initial_indent=INDENT, subsequent_indent=INDENT)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(row.verdict for row in rows).most_common())
    return "\n".join([*lines[1:], "", f"{len(rows)} numbers: {counts}"])


def markdown(rows):
    """The rows as a table of Markdown for `docs/how_do_we_know.md`, with how far ours is off the print."""
    header = ("source", "quantity", "unit", "printed", "ours", "off the print", "verdict")
    cells = [
        (row.source, row.quantity, row.unit, row.printed, f"{row.ours:.6g}", _off(row), row.verdict) for row in rows
    ]
    lines = [header, ("---",) * len(header), *cells]
    return "".join(f"| {' | '.join(cell.replace('|', BAR) for cell in line)} |\n" for line in lines)


def _off(row):
    """Ours over the print less one, where there is a finite one; rounding is none."""
    printed = float("nan" if not row.printed else row.printed if row.printed == "inf" else Fraction(row.printed))
    if not (printed and math.isfinite(printed)):
        return ""
    off = row.ours / printed - 1
    return f"{off:+.2g}" if abs(off) > TOLERANCE else "0"


def _line(source, quantity, printed, ours, unit, verdict):
    return f"{source:<16} {quantity:<49} {printed:>8} {ours:>11} {unit:<6} {verdict}".rstrip()


def _note(row):
    if row.kept:
        return row.note
    return f"CHANGED: {row.ours:.12g} for {row.expected:.12g}, or not '{row.verdict}' any more. {row.note}"


GROUPS = {
    "contact": (
        "Engineering method (D 1.1-1.10) and the published operating point. Where nothing is said, nu 0.3, f 0.35, "
        "E 0.75 MPa, q 0.203 MPa, R 0.11 m, L 1.164 m, k2 1",
        published_machine.engineering,
    ),
    "crank": (
        "Four carts on a crank (C; stated: 7962 N on each of 2 rollers, 10.5 rad/s, m = 1000 kg, guide friction 0.008; "
        "used: 3562 N in all, 100 rpm, no inertia, no guide friction)",
        published_machine.crank,
    ),
    "peaks": ("Peaks of the motion laws (D ch. 5; stroke 0.4 m, one pass 3 s)", published_laws.peaks),
    "claims": ("Closures, criteria and optima of the motion laws (A, B, D; t1 = T/6)", published_laws.claims),
    "cams": ("Cams of constant breadth b (A, B, D; stroke dx)", published_laws.cams),
}
