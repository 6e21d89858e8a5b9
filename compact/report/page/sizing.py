"""Sections of the page on the size of the machine: balances of work and mix, and peaks over the duration."""

from collections.abc import Mapping

from compact.analysis.sizing.durations import DurationStudy
from compact.analysis.study import Study
from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, Ranked
from compact.report.page.blocks import Block, Cell, Mark, Paragraph, Picture, Section, Table, as_sentence
from compact.report.sizing.duration_tables import duration_sentence
from compact.report.sizing.sentences import work_sentence, work_warnings
from compact.report.tables import format_number, format_percent, format_quantity

MEANINGS = {  # field of `WorkBalance` -> (words, unit)
    "pass_work": ("work of a pass over fresh mix, over the product", "J/m3"),
    "confined_work": ("work of confined compression, of the same mix", "J/m3"),
    "work_ratio": ("work of a pass over that of confined compression", "1"),
    "loose_work": ("work of confined compression from the loose state", "J/m3"),
    "cycle_work": ("work of the resistance in a cycle", "J"),
    "pressed_volume": ("product pressed from fresh mix in a stroke", "m3"),
    "carried_volume": ("product carried away by the mould in a stroke", "m3"),
    "feed_ratio": ("mix pressed over mix carried away, in a cycle", "1"),
    "strokes_on_section": ("strokes over a section of the product", "1"),
    "throughput_work": ("work of the resistance at this throughput", "J/m3"),
    "explained_share": ("share of confined compression from the loose state", "1"),
}
THROUGHPUT = ("carried_volume", "feed_ratio", "strokes_on_section", "throughput_work", "explained_share")


def work_section(study: Study) -> Section:
    """Tabulate the balances of work and mix, with a warning for those that do not fit.

    Parameters
    ----------
    study : Study
        A finished study, whose first law by the first criterion is balanced.
    """
    balance = study.work_balance
    shown = [name for name in MEANINGS if balance.carried_volume is not None or name not in THROUGHPUT]
    rows: list[tuple[Cell, ...]] = []
    for name in shown:
        words, unit = MEANINGS[name]
        rows.append((words, _value(getattr(balance, name), unit)))
    warnings = work_warnings(balance)
    blocks: list[Block] = [Paragraph(as_sentence(work_sentence(study)))]
    if warnings:
        marked = [(Mark("bad", "warning"), each) for each in warnings]
        blocks.append(Table("Balances that do not fit", ("", "reason"), marked))
    blocks.append(Table(f"Work and mix of one cart, with the law {balance.law}", ("quantity", "value"), rows, (1,)))
    count = len(warnings)
    fit = {0: "all balances fit", 1: "one balance does not fit"}.get(count, f"{count} balances do not fit")
    return Section("work", "Work and throughput", f"Specific work, mix fed and mix carried away: {fit}.", blocks)


def _value(value: float | None, unit: str) -> str:
    """Format a number of the balances.

    Specific work is in kilojoules, volume in litres, a ratio below 1 in per cent.
    """
    if value is None:
        return "–"
    if unit == "J/m3":
        return f"{format_number(value / 1e3, 3)} kJ/m³"
    if unit == "m3":
        return f"{format_number(1e3 * value, 3)} l"
    if unit == "1" and value < 1:
        return format_percent(value)
    return format_quantity(value, unit, 3)


def duration_section(found: DurationStudy, pictures: Mapping[str, bytes]) -> Section:
    """Show the first laws over the duration, their peaks and crossovers.

    Parameters
    ----------
    found : DurationStudy
        Ranking over the duration.
    pictures : mapping
        Figures by name, "duration" among them.
    """
    caption = (
        "Grey: all laws. Colour: the first law, where it is first. Dots: durations at which the first law changes."
    )
    blocks: list[Block] = [
        Paragraph(as_sentence(duration_sentence(found))),
        Picture(pictures["duration"], "Peak force and peak power of all laws over the duration of a pass", caption),
    ]
    for by, orders in found.orders.items():
        term, unit = CRITERIA[by].quantity.term, CRITERIA[by].unit
        rows: list[tuple[Cell, ...]] = [
            (
                f"{duration:.3g} s", order[0].run.name, format_quantity(order[0].value, unit), _margin(order[0]),
                _ties(order),
            )
            for duration, order in zip(found.durations, orders, strict=True)
        ]  # fmt: skip
        header = ("duration", "first law", term, "margin", "ties with it")
        blocks.append(Table(f"First law by {term}", header, rows, (0, 2, 3)))
    crossed: list[tuple[Cell, ...]] = [
        (
            CRITERIA[each.by].quantity.term, f"{each.duration:.3g} s", each.shorter, each.longer,
            format_quantity(each.value, CRITERIA[each.by].unit),
        )
        for each in found.crossovers
    ]  # fmt: skip
    header = ("criterion", "duration", "first for shorter passes", "first for longer passes", "peak of both")
    if crossed:
        blocks.append(Table("Crossovers of the first laws", header, crossed, (1, 4)))
    lead = f"First laws from {found.durations[0]:.3g} to {found.durations[-1]:.3g} s a pass, with crossovers."
    return Section("duration", "Duration of a pass", lead, blocks)


def _margin(first: Ranked) -> str:
    return "tie" if first.tie else format_percent(first.margin)


def _ties(order: list[Ranked]) -> str:
    """Name the other laws within the build tolerance of the first one."""
    least = order[0].value
    return ", ".join(each.run.name for each in order[1:] if each.value < least * (1 + BUILD_TOLERANCE))
