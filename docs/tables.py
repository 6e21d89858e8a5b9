"""Tables of the pages: a line `<!-- table: NAME -->` becomes a table of Markdown when the site is built.

    python docs/tables.py NAME      # prints one

Names are `published`, `validation`, `validation/CASE`, `verification/SECTION`, and CSV files of `docs`.
"""

import csv
import re
import sys
from pathlib import Path

from compact.report import validation
from compact.validation.case import CASES, VERDICTS
from compact.verification import published_numbers

DOCS = Path(__file__).parent
MARK = re.compile(r"(?m)^<!-- table: (.+) -->$")


def table(name: str) -> str:
    """Return a table by its name."""
    kind, _, part = name.partition("/")
    if kind == "published":
        header = ["source", "quantity", "unit", "printed", "computed", "verdict"]
        cells = [
            [row.source, row.quantity, row.unit, row.printed, f"{row.computed:.6g}", row.verdict]
            for row in published_numbers.rows()
        ]
        return validation.markdown_table(header, cells)
    if kind == "validation" and not part.endswith(".csv"):
        recorded = CASES[part] if part else None  # the tests compute them again
        return validation.markdown_case(recorded) if recorded else overview()
    path = DOCS / ("verification.csv" if kind == "verification" else name)
    header, *rows = csv.reader(path.read_text("utf-8").splitlines())
    if kind == "verification":
        header = header[1:]
        rows = [[text, f"`{limit}`", files(paths)] for section, text, limit, paths in rows if section == part]
    if not rows:
        raise KeyError(f"no table {name}")
    return validation.markdown_table(header, rows)


def overview() -> str:
    """Return the count of verdicts of every case."""
    rows = [
        (f"[{case.name}](#{case.name})", case.kind, ", ".join(case.engines), *map(str, case.counts.values()))
        for case in CASES.values()
    ]
    table = validation.markdown_table(("case", "kind", "engines", *VERDICTS), rows)
    return f"{table}\n{validation.counts_sentence([*CASES.values()])}.\n"


def files(paths: str) -> str:
    """Return paths as code."""
    return ", ".join(f"`{path}`" for path in paths.split())


def insert_tables(text: str) -> str:
    """Return a page with its tables."""
    return MARK.sub(lambda mark: table(mark[1]), text)


if __name__ == "__main__":
    print(table(sys.argv[1]))
