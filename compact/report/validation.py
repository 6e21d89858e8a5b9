"""Validation as tables of Markdown, on the terminal too, as figures, and as files of a directory."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from itertools import cycle
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from compact.files import write_figure, write_json, write_text
from compact.report.figures import DASHES, PALETTE, panels
from compact.validation.case import PREDICTED, VERDICTS, Panel, ValidationCase

PANEL = (4.3, 3.0)  # [inch], of a figure
MARKER_SIZE = 4  # [points]
MARKERS = ("o", "s", "^", "D", "v", "P")
HEADER = ("quantity", "unit", "ours", "theirs", "scatter", "deviation", "expected", "verdict")


def validation_text(cases: Sequence[ValidationCase]) -> str:
    """Format evaluated cases as Markdown, with a count of the verdicts."""
    parts = [
        f"## {case.name}\n\n{case.title} ({case.kind}; {', '.join(case.engines)})\n\n{markdown_case(case)}"
        for case in cases
    ]
    return "\n".join([*parts, counts_sentence(cases)])


def counts_sentence(cases: Sequence[ValidationCase]) -> str:
    """Count the verdicts of evaluated cases in one sentence."""
    totals = {verdict: sum(case.counts[verdict] for case in cases) for verdict in VERDICTS}
    shares = ", ".join(f"{count} {verdict}" for verdict, count in totals.items())
    return f"{sum(totals.values())} numbers of {len(cases)} case{'s' if len(cases) > 1 else ''}: {shares}"


def case_summaries(cases: Sequence[ValidationCase]) -> list[dict[str, Any]]:
    """Return cases with their comparisons and verdicts, for JSON."""
    return [
        {
            "case": case.name,
            "title": case.title,
            "engines": list(case.engines),
            "comparisons": [asdict(each) | {"verdict": each.verdict} for each in case.rows.values()],
        }
        for case in cases
    ]


def markdown_case(case: ValidationCase) -> str:
    """Format one case as a table of Markdown, with numbered remarks and the source."""
    remarks: dict[str, int] = {}
    rows: list[Sequence[str]] = []
    for each in case.rows.values():
        scatter = "" if each.scatter is None else f"{each.scatter:.2g}"
        deviation = "" if math.isnan(each.deviation) else _percent(each.deviation, sign="+")
        absolute = "" if each.absolute is None else f"{each.absolute:.2g} {each.unit}".removesuffix(" -")
        expected = absolute if each.relative is None else _percent(each.relative)
        cells = (each.quantity, each.unit, f"{each.ours:.6g}", f"{each.theirs:.6g}", scatter, deviation, expected)
        basis = each.basis if each.basis != PREDICTED else ""
        moved = f"MOVED: ours {each.ours:.9g}, recorded {each.recorded:.9g}" if each.moved else ""
        told = [text for text in (basis, each.why, moved) if text]
        places = sorted(remarks.setdefault(text, len(remarks) + 1) for text in told)
        rows.append((*cells, f"{each.verdict} ({', '.join(map(str, places))})" if places else each.verdict))
    listed = "".join(f"{number}. {text}.\n" for text, number in remarks.items())
    return f"{markdown_table(HEADER, rows)}\n{listed}\nSource: {case.source}.\n"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format rows of cells as a table of Markdown, whose columns are aligned as text too."""
    escaped = [[cell.replace("|", "\\|") for cell in row] for row in (header, *rows)]
    widths = [max(map(len, column)) for column in zip(*escaped, strict=True)]
    escaped.insert(1, ["-" * max(width, 3) for width in widths])
    return "".join(f"| {' | '.join(map(str.ljust, row, widths))} |\n" for row in escaped)


def write_validation(directory: Path, cases: Sequence[ValidationCase]) -> list[Path]:
    """Write the tables, all values and one figure of each case; return the files.

    Parameters
    ----------
    directory : Path
        Directory; created if absent.
    """
    written = [write_text(directory / "validation.md", validation_text(cases) + "\n")]
    written.append(write_json(directory / "validation.json", {"cases": case_summaries(cases)}))
    figures = [(directory / "validation" / f"{case.name}.png", case.panels) for case in cases if case.panels]
    return written + [write_figure(path, draw_case(panels)) for path, panels in figures]


def draw_case(contents: tuple[Panel, ...]) -> Figure:
    """Draw the panels of a case side by side; a single set of points is black, several have the colours of the lines.

    Parameters
    ----------
    contents : tuple of Panel
        Finished curves; at least one panel.
    """
    figure, axes = panels(1, len(contents), PANEL, (0.95, 0.3), left=0.85)
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


def _percent(share: float, sign: str = "") -> str:
    """Format a share with two digits, as per cent above a thousandth."""
    if abs(share) >= 1:
        return f"{100 * share:{sign}.0f} %"
    return f"{100 * share:{sign}.2g} %" if abs(share) >= 1e-3 else f"{share:{sign}.1e}" if share else "0"
