"""Validation as text, as the page docs/validation.md, and as files of a directory: page, table and figures."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import Any

from compact.files import atomic_file, write_csv, write_figure
from compact.report.figures.validation import draw_case
from compact.validation.case import KINDS, PREDICTED, VERDICTS, Comparison
from compact.validation.registry import RECORDED_HEADER, CaseResult, recorded_rows

TABLE_WIDTH = 120  # characters of a line
QUANTITY_WIDTH = 48  # characters; a longer quantity has a line of its own
NOTE_INDENT = " " * 4  # of the lines below a row
HEADER = ("quantity", "unit", "ours", "theirs", "scatter", "deviation", "expected", "verdict")
PAGE, PAGE_TEMPLATE = "validation.md", "page.md"


def text_table(results: Sequence[CaseResult]) -> str:
    """Format evaluated cases as text of about 120 columns, with a count of the verdicts."""
    lines: list[str] = []
    for result in results:
        case = result.case
        lines += ["", f"{case.name}: {case.title} ({KINDS[case.kind]}; {', '.join(case.engines)})"]
        lines.append(_line(*HEADER))
        lines.append("-" * TABLE_WIDTH)
        for each in result.comparisons:
            lines.append(_line(*_cells(each)))
            lines += _wrapped("; ".join(filter(None, (_bracket(each), *_reasons(each)))))
            if each in result.moved:
                lines += _wrapped(_movement(result, each))
        for remark in result.evaluation.remarks:
            lines += _wrapped(remark)
    return "\n".join([*lines[1:], "", counts_sentence(results)])


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


def counts_sentence(results: Sequence[CaseResult]) -> str:
    """Count the verdicts of evaluated cases in one sentence."""
    totals = {verdict: sum(result.counts[verdict] for result in results) for verdict in VERDICTS}
    shares = ", ".join(f"{count} {verdict}" for verdict, count in totals.items())
    return f"{sum(totals.values())} numbers of {len(results)} case{'s' if len(results) > 1 else ''}: {shares}"


def markdown_page(results: Sequence[CaseResult], figures: str = "validation/") -> str:
    """Format the page docs/validation.md.

    Parameters
    ----------
    results : sequence of CaseResult
        Evaluated cases.
    figures : str
        Folder of the figures, as seen from the page.
    """
    page = files("compact.validation").joinpath("data", PAGE_TEMPLATE).read_text(encoding="utf-8")
    measured = [result for result in results if result.case.validates]
    exact = [result for result in results if not result.case.validates]
    parts = {
        "{overview}": markdown_overview(results),
        "{validation}": "\n".join(markdown_case(result, figures) for result in measured),
        "{verification}": "\n".join(markdown_case(result, figures) for result in exact),
    }
    for place, text in parts.items():
        page = page.replace(place, text.rstrip())
    return page


def markdown_overview(results: Sequence[CaseResult]) -> str:
    """Format one line for each case with the count of its verdicts, as a table of Markdown."""
    rows: list[tuple[str, ...]] = [("case", "kind", "engines", *VERDICTS), ("---",) * 6]
    for result in results:
        case, counts = result.case, result.counts
        link = f"[{case.name}](#{case.name})"
        rows.append((link, KINDS[case.kind], ", ".join(case.engines), *(str(counts[name]) for name in VERDICTS)))
    return _markdown_table(rows) + f"\n{counts_sentence(results)}.\n"


def markdown_case(result: CaseResult, figures: str) -> str:
    """Format one case: setting, table, figure, source and licence."""
    case = result.case
    remarks: dict[str, int] = {}
    rows = [HEADER, ("---",) * len(HEADER), *(_cells_with_remarks(each, remarks) for each in result.comparisons)]
    parts = [f"### {case.name}", f"**{case.title}** ({KINDS[case.kind]}). {case.setting}", _markdown_table(rows)]
    if remarks:
        parts.append("\n".join(f"{number}. {text}." for text, number in remarks.items()) + "\n")
    parts += [f"{remark}\n" for remark in result.evaluation.remarks]
    if result.evaluation.panels:
        parts.append(f"![{case.title}]({figures}{case.name}.png)\n")
    parts.append(f"Source: {case.source}. Licence: {case.licence}.\n")
    return "\n".join(
        textwrap.fill(part, TABLE_WIDTH, break_on_hyphens=False) + "\n" if _is_prose(part) else part for part in parts
    )


def write_validation(directory: Path, results: Sequence[CaseResult]) -> list[Path]:
    """Write the page, the table of all values and one figure of each case.

    Parameters
    ----------
    directory : Path
        Directory; created if absent.

    Returns
    -------
    list of Path
        Files written.
    """
    page = directory / PAGE
    with atomic_file(page) as stream:
        stream.write(markdown_page(results))
    written = [page, write_csv(directory / "validation.csv", RECORDED_HEADER, recorded_rows(results))]
    for result in results:
        if result.evaluation.panels:
            path = directory / "validation" / f"{result.case.name}.png"
            written.append(write_figure(path, draw_case(result.evaluation.panels)))
    return written


def _is_prose(part: str) -> bool:
    return not part.startswith(("|", "#", "1.", "!"))


def _cells_with_remarks(each: Comparison, remarks: dict[str, int]) -> tuple[str, ...]:
    """Format the cells of one comparison, with the numbers of its remarks behind the verdict."""
    *cells, verdict = _cells(each)
    if each.bracket is not None:
        cells[2] = f"{each.ours:.4g} ({each.bracket[0]:.4g} to {each.bracket[1]:.4g})"
    places = sorted(remarks.setdefault(text, len(remarks) + 1) for text in _reasons(each))
    return (*cells, f"{verdict} ({', '.join(map(str, places))})" if places else verdict)


def _markdown_table(rows: Sequence[Sequence[str]]) -> str:
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in rows)


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
    """Return the basis of a fit, the explanation of a larger distance, and the note."""
    explanation = each.explanation if each.verdict == "explained" else ""
    basis = "" if each.basis == PREDICTED else each.basis
    return [text for text in (basis, explanation, each.note) if text]


def _bracket(each: Comparison) -> str:
    """Return the range of ours in words; empty without one."""
    if each.bracket is None:
        return ""
    return f"ours from {each.bracket[0]:.4g} to {each.bracket[1]:.4g} {each.unit}"


def _movement(result: CaseResult, each: Comparison) -> str:
    recorded = (result.recorded or {}).get(each.key)
    if recorded is None:
        return f"NOT RECORDED: ours {each.ours:.9g}"
    return f"MOVED: ours {each.ours:.9g}, recorded {recorded:.9g}"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, TABLE_WIDTH, initial_indent=NOTE_INDENT, subsequent_indent=NOTE_INDENT)


def _line(
    quantity: str, unit: str, ours: str, theirs: str, scatter: str, deviation: str, expected: str, verdict: str
) -> str:
    numbers = f"{ours:>11} {theirs:>11} {scatter:>8} {deviation:>9} {expected:>9}"
    first = f"{quantity}\n" if len(quantity) > QUANTITY_WIDTH else ""
    return f"{first}{'' if first else quantity:<{QUANTITY_WIDTH}} {unit:<7.7} {numbers:<52} {verdict}".rstrip()
