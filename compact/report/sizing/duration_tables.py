"""Results over the duration of a pass: CSV files, content of summary.json and a sentence of the digest."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from compact.analysis.sizing.durations import DurationStudy
from compact.files import write_csv
from compact.machine.ranking import CRITERIA

DURATION_HEADER = ("duration_s", "criterion", "rank", "law", "value", "unit", "margin", "tie", "reason")
CROSSOVER_HEADER = ("criterion", "duration_s", "shorter", "longer", "value", "unit")


def write_durations(found: DurationStudy, directory: Path) -> Iterator[Path]:
    """Write duration.csv, the laws at every duration, and duration-crossovers.csv.

    Parameters
    ----------
    found : DurationStudy
        Ranking over the duration.
    directory : Path
        Existing directory.

    Yields
    ------
    Path
        File written.
    """
    yield write_csv(directory / "duration.csv", DURATION_HEADER, [
        (duration, by, each.rank, each.run.name, each.value, CRITERIA[by].unit, each.margin, each.tie, each.reason)
        for by, orders in found.orders.items()
        for duration, order in zip(found.durations, orders, strict=True)
        for each in order
    ])  # fmt: skip
    yield write_csv(directory / "duration-crossovers.csv", CROSSOVER_HEADER, [
        (each.by, each.duration, each.shorter, each.longer, each.value, CRITERIA[each.by].unit)
        for each in found.crossovers
    ])  # fmt: skip


def duration_numbers(found: DurationStudy | None) -> dict[str, Any] | None:
    """Convert the first laws over the duration to the content of summary.json; None without durations."""
    if found is None:
        return None
    return {
        by: {
            "unit": CRITERIA[by].unit,
            "first": [
                {"duration": duration, "law": order[0].run.name, "value": order[0].value, "margin": order[0].margin}
                for duration, order in zip(found.durations, orders, strict=True)
            ],
            "crossovers": [
                {"duration": each.duration, "shorter": each.shorter, "longer": each.longer, "value": each.value}
                for each in found.crossovers
                if each.by == by
            ],
        }
        for by, orders in found.orders.items()
    }


def duration_sentence(found: DurationStudy) -> str:
    """State the first laws over the duration.

    Returns
    -------
    str
        One sentence without a full stop.
    """
    parts = []
    for by in found.orders:
        segments = found.segments(by)
        laws = [f"{law} up to {high:.3g} s" for law, _, high in segments[:-1]]
        laws += [f"{law} {'beyond' if laws else 'throughout'}" for law, *_ in segments[-1:]]
        parts.append(f"least {CRITERIA[by].quantity.term}: {', '.join(laws) or 'no law with finite forces'}")
    ends = f"{found.durations[0]:.3g} to {found.durations[-1]:.3g} s"
    return f"over durations of a pass of {ends}, at the height of the scene: {'; '.join(parts)}"
