"""Published numbers and the values that this package computes for them: the table of `compact check`.

Sources: A and B, the papers on the third-order reversal and on its boundary conditions; C, the paper on the four-cart
crank (Loveikin and Pochka 2015); D, the monograph on cam-driven roller forming. Each line of `data/published.csv` holds
a printed number, the verdict on it, the `formula` of ours in the names of `formulas`, and
the `expected` value. The expected value is exact, or follows from formulas
evaluated by mpmath independently of this package; the column `origin` states which. Verdicts:

reproduced     computed and printed number agree to half a unit of the last printed digit
rounding       they differ; the source read a coarse table or rounded an intermediate number
misprint       they differ; the correct value follows from the conditions that the source states
contradiction  they differ; no reading of the source gives the printed number
derived        no number is printed; the value follows from printed ones or verifies a formula

`printed` is a printed number or the quotient of two. D ch. 5 gives accelerations to thousandths without trailing zeros:
its 0.6 is 0.600. Purely typographic errors (a missing bracket, square or sign at a line break) have no row.
"""

import itertools
import math
import textwrap
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from importlib.resources import files

from compact.files import read_table
from compact.verification import formulas

TOLERANCE = 1e-9  # [-], relative, of a computed value against the expected one
TABLE_WIDTH = 120  # characters of a line
NOTE = textwrap.TextWrapper(TABLE_WIDTH, initial_indent=" " * 19, subsequent_indent=" " * 19)  # below a row
VERDICTS = ("reproduced", "rounding", "misprint", "contradiction")  # on a printed number

GROUPS = {
    "contact": "Engineering method (D 1.1-1.10) and the published operating point. Unless stated otherwise, nu 0.3, "
    "f 0.35, E 0.75 MPa, q 0.203 MPa, R 0.11 m, L 1.164 m, k2 1",
    "crank": "Four carts on a crank (C; stated: 7962 N on each of 2 rollers, 10.5 rad/s, m = 1000 kg, guide friction "
    "0.008; used: 3562 N in all, 100 rpm, no inertia, no guide friction)",
    "machine": "Technical data of the machine (D: 14 products an hour, 5100 kg, mean speeds 0.133, 0.45 and 1.34 m/s)",
    "peaks": "Peaks of the motion laws (D ch. 5; stroke 0.4 m, one pass 3 s)",
    "claims": "Closures, criteria and optima of the motion laws (A, B, D; t1 = T/6)",
    "cams": "Cams of constant breadth b (A, B, D; stroke dx)",
}


@dataclass(frozen=True)
class PublishedNumber:
    """A published number with its computed and its expected value.

    Parameters
    ----------
    key : str
        Group and name, as in `data/published.csv`.
    unit : str
        Unit of all values of the row; "-" for a dimensionless quantity.
    printed : str
        Printed digits or a fraction; empty where no number is printed.
    verdict : str
        One of `VERDICTS`, or "derived".
    decimals : int or None
        Decimals of the print where it omits trailing zeros.
    """

    key: str
    source: str
    quantity: str
    unit: str
    printed: str
    computed: float
    verdict: str
    expected: float
    note: str = ""
    decimals: int | None = None

    @property
    def group(self) -> str:
        """Group of the row, a key of `GROUPS`."""
        return self.key.split(".")[0]

    @property
    def matches_print(self) -> bool:
        """True if computed and printed number agree to half a unit of the last digit; a fraction must agree exactly."""
        if not self.printed:
            return False
        if "/" in self.printed or self.printed == "inf":
            return math.isclose(self.computed, _number(self.printed), rel_tol=TOLERANCE)
        decimals = len(self.printed.partition(".")[2]) if self.decimals is None else self.decimals
        return abs(self.computed - float(self.printed)) <= 0.5 * 10.0**-decimals * (1 + TOLERANCE)

    @property
    def unchanged(self) -> bool:
        """True if the computed value is the expected one and the verdict is correct."""
        if not math.isclose(self.computed, self.expected, rel_tol=TOLERANCE):
            return False
        if not self.printed:
            return self.verdict == "derived"
        return self.matches_print == (self.verdict == "reproduced") and self.verdict in VERDICTS


def rows() -> list[PublishedNumber]:
    """Evaluate the formula of every line of `data/published.csv`."""
    return [
        PublishedNumber(
            computed=float(eval(line["formula"], vars(formulas))),
            decimals=int(line["decimals"]) if line["decimals"] else None,
            expected=_number(line["expected"]),
            **{name: line[name] for name in ("key", "source", "quantity", "unit", "printed", "verdict", "note")},
        )
        for line in recorded_lines()
    ]


def _number(text: str) -> float:
    """Return the value of a decimal number, a fraction or "inf"."""
    return math.inf if text == "inf" else float(Fraction(text))


def recorded_lines() -> list[dict[str, str]]:
    """Read `data/published.csv`."""
    return [line for _, line in read_table(files("compact").joinpath("data/published.csv"))]


def text_table(rows: Sequence[PublishedNumber]) -> str:
    """Format rows as ASCII text of at most 120 columns, grouped, with notes and a count of the verdicts."""
    line = "{:<16} {:<49} {:>8} {:>11} {:<6} {}"
    header = line.format("source", "quantity", "printed", "computed", "unit", "verdict")
    lines = []
    for group, members in itertools.groupby(rows, key=lambda row: row.group):
        lines += ["", *textwrap.wrap(GROUPS[group], TABLE_WIDTH), header, "-" * len(header)]
        for row in members:
            cells = row.source, row.quantity, row.printed, f"{row.computed:.6g}", row.unit, row.verdict
            changed = f"CHANGED: computed {row.computed:.12g}, expected {row.expected:.12g}, verdict '{row.verdict}'. "
            note = row.note if row.unchanged else changed + row.note
            lines += [line.format(*cells), *NOTE.wrap(note)]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(row.verdict for row in rows).most_common())
    return "\n".join([*lines[1:], "", f"{len(rows)} numbers: {counts}"])
