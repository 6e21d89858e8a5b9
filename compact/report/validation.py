"""Validation as text, as tables of Markdown, as figures, and as files of a directory."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from itertools import cycle
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from compact.files import atomic_file, write_csv, write_figure
from compact.report.figures import DASHES, PALETTE, panels
from compact.validation.case import PREDICTED, Comparison, Panel
from compact.validation.runner import VERDICTS, CaseResult

TABLE_WIDTH = 120  # characters of a line
QUANTITY_WIDTH = 48  # characters; a longer quantity has a line of its own
NOTE_INDENT = " " * 4  # of the lines below a row
PANEL = (4.3, 3.0)  # [inch], of a figure
MARKER_SIZE = 4  # [points]
MARKERS = ("o", "s", "^", "D", "v", "P")
HEADER = ("quantity", "unit", "ours", "theirs", "scatter", "deviation", "expected", "verdict")


def text_table(results: Sequence[CaseResult]) -> str:
    """Format evaluated cases as text of about 120 columns, with a count of the verdicts."""
    lines: list[str] = []
    for result in results:
        case = result.case
        lines += ["", f"{case.name}: {case.title} ({case.kind}; {', '.join(case.engines)})"]
        lines += [_line(*HEADER), "-" * TABLE_WIDTH]
        for each in result.comparisons:
            moved = f"MOVED: ours {each.ours:.9g}, recorded {each.recorded:.9g}" if each.moved else ""
            lines += [_line(*_cells(each)), *_wrapped("; ".join(_reasons(each))), *_wrapped(moved)]
        lines += _wrapped(f"Source: {case.source}.")
    return "\n".join([*lines[1:], "", counts_sentence(results)])


def counts_sentence(results: Sequence[CaseResult]) -> str:
    """Count the verdicts of evaluated cases in one sentence."""
    totals = {verdict: sum(result.counts[verdict] for result in results) for verdict in VERDICTS}
    shares = ", ".join(f"{count} {verdict}" for verdict, count in totals.items())
    return f"{sum(totals.values())} numbers of {len(results)} case{'s' if len(results) > 1 else ''}: {shares}"


def case_summaries(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """Return cases with their comparisons and verdicts, for JSON."""
    return [
        {
            "case": result.case.name,
            "title": result.case.title,
            "engines": list(result.case.engines),
            "comparisons": [asdict(each) | {"verdict": each.verdict} for each in result.comparisons],
        }
        for result in results
    ]


def markdown_case(result: CaseResult) -> str:
    """Format one case as a table of Markdown, with numbered remarks and the source."""
    remarks: dict[str, int] = {}
    rows: list[Sequence[str]] = [HEADER, ("---",) * len(HEADER)]
    for each in result.comparisons:
        *cells, verdict = _cells(each)
        places = sorted(remarks.setdefault(text, len(remarks) + 1) for text in _reasons(each))
        rows.append((*cells, f"{verdict} ({', '.join(map(str, places))})" if places else verdict))
    listed = "".join(f"{number}. {text}.\n" for text, number in remarks.items())
    return f"{markdown_table(rows)}\n{listed}\nSource: {result.case.source}.\n"


def markdown_overview(results: Sequence[CaseResult]) -> str:
    """Format one line for each case with the count of its verdicts, as a table of Markdown."""
    rows: list[Sequence[str]] = [("case", "kind", "engines", *VERDICTS), ("---",) * 6]
    for result in results:
        case, counts = result.case, (str(count) for count in result.counts.values())
        rows.append((f"[{case.name}](#{case.name})", case.kind, ", ".join(case.engines), *counts))
    return f"{markdown_table(rows)}\n{counts_sentence(results)}.\n"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Format rows of cells, the second of them the rule, as a table of Markdown."""
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in rows)


def write_validation(directory: Path, results: Sequence[CaseResult]) -> list[Path]:
    """Write the text, the table of all values and one figure of each case; return the files.

    Parameters
    ----------
    directory : Path
        Directory; created if absent.
    """
    rows = [
        (result.case.name, each.key, each.ours, each.theirs, each.verdict)
        for result in results
        for each in result.comparisons
    ]
    written = [directory / "validation.txt", directory / "validation.csv"]
    with atomic_file(written[0]) as stream:
        stream.write(text_table(results) + "\n")
    write_csv(written[1], ("case", "key", "ours", "theirs", "verdict"), rows)
    return written + [
        write_figure(directory / "validation" / f"{result.case.name}.png", draw_case(result.panels))
        for result in results
        if result.panels
    ]


def draw_case(contents: tuple[Panel, ...]) -> Figure:
    """Draw the panels of a case side by side; a single set of points is black, several have the colours of the lines.

    Parameters
    ----------
    contents : tuple of Panel
        Finished curves; at least one panel.
    """
    figure, axes = panels(1, len(contents), PANEL, gaps=(0.95, 0.3), left=0.85)
    for ax, panel in zip(axes[0], contents, strict=True):
        lines = [curve for curve in panel.curves if curve.is_ours]
        points = [curve for curve in panel.curves if not curve.is_ours]
        for curve, colour, dash in zip(lines, cycle(PALETTE), cycle(DASHES), strict=False):
            ax.plot(curve.x, curve.y, color=colour, linestyle=dash, label=curve.label)
        for curve, colour, marker in zip(points, cycle(PALETTE), cycle(MARKERS), strict=False):
            style = {"color": "black" if len(points) == 1 else colour, "markerfacecolor": "none"}
            ax.plot(curve.x, curve.y, marker, markersize=MARKER_SIZE, label=curve.label, **style)
        ax.set(xlabel=panel.x_label, ylabel=panel.y_label, xscale="log" if panel.log_x else "linear")
        ax.legend(frameon=False, fontsize="small")
    return figure


def _cells(each: Comparison) -> tuple[str, ...]:
    """Format the cells of one comparison."""
    scatter = "" if each.scatter is None else f"{each.scatter:.2g}"
    expected = f"{each.expected:.2g} {each.unit}".removesuffix(" -") if each.absolute else _percent(each.expected)
    deviation = "" if math.isnan(each.deviation) else _percent(each.deviation, sign="+")
    return (
        each.quantity, each.unit, f"{each.ours:.6g}", f"{each.theirs:.6g}", scatter, deviation, expected, each.verdict
    )  # fmt: skip


def _percent(share: float, sign: str = "") -> str:
    """Format a share with two digits, as per cent above a thousandth."""
    if abs(share) >= 1:
        return f"{100 * share:{sign}.0f} %"
    return f"{100 * share:{sign}.2g} %" if abs(share) >= 1e-3 else f"{share:{sign}.1e}" if share else "0"


def _reasons(each: Comparison) -> list[str]:
    """Return the basis of a fit and the remark of a row."""
    return [text for text in (each.basis if each.basis != PREDICTED else "", each.why) if text]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, TABLE_WIDTH, initial_indent=NOTE_INDENT, subsequent_indent=NOTE_INDENT)


def _line(
    quantity: str, unit: str, ours: str, theirs: str, scatter: str, deviation: str, expected: str, verdict: str
) -> str:
    numbers = f"{ours:>11} {theirs:>11} {scatter:>8} {deviation:>9} {expected:>9}"
    first = f"{quantity}\n" if len(quantity) > QUANTITY_WIDTH else ""
    return f"{first}{'' if first else quantity:<{QUANTITY_WIDTH}} {unit:<7.7} {numbers:<52} {verdict}".rstrip()
