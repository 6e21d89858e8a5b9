"""Tables of the rankings of the laws by every engine and drive of a study, and of their agreement."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from compact.analysis.ranking_uncertainty import Place, error
from compact.analysis.stages.comparison import DIRECTORY
from compact.analysis.stages.kept_results import KeptResults, write_results
from compact.analysis.study import Study
from compact.files import write_csv
from compact.machine.ranking import CRITERIA, value_of
from compact.report.contact_tables import ENGINE_HEADER, contact_row

RANKING_HEADER = (
    "engine", "drive", "criterion", "rank", "law", "value", "unit", "margin", "tie", "error", "resolved",
    "reason",
)  # fmt: skip
CRITERIA_HEADER = ("law", "drive", "criterion", "value", "unit", "error")
AGREEMENT_HEADER = (
    "engine", "drive", "other_engine", "other_drive", "criterion", "kendall_tau", "discordant_pairs",
    "resolved_discordant_pairs", "pairs", "first", "other_first",
)  # fmt: skip


def comparison_places(study: Study, kind: str, by: str) -> dict[str, dict[str, Place]]:
    """Collect the places of each law by the engines of the comparison."""
    return {name: {place.law: place for place in other.places[kind][by]} for name, other in study.comparison.items()}


def write_ranking_tables(study: Study, directory: Path) -> Iterator[Path]:
    """Write ranking.csv, criteria.csv and, where engines are compared, agreement.csv and their contacts."""
    kind = study.scene.drive.kind
    yield write_csv(directory / "ranking.csv", RANKING_HEADER, [
        (
            engine, moved_by, by, p.rank, p.law, p.value, CRITERIA[by].unit, p.margin, p.tie, _or_empty(p.error),
            _or_empty(p.resolved), p.reason,
        )
        for engine, orders in study.places_by_engine.items() for moved_by, order in orders.items()
        for by, found in order.items() for p in found
    ])  # fmt: skip
    yield write_csv(directory / "criteria.csv", CRITERIA_HEADER, [
        (name, kind, by, value_of(run, by), criterion.unit, _or_empty(criterion_error(study, run, by)))
        for name, run in study.runs.items() for by, criterion in CRITERIA.items()
    ])  # fmt: skip
    if study.comparison:
        yield write_csv(directory / "agreement.csv", AGREEMENT_HEADER, [
            (a.engine, a.drive, a.other_engine, a.other_drive, a.by, *a.agreement, a.first, a.other_first)
            for a in study.agreements
        ])  # fmt: skip
    for name, other in study.comparison.items():
        if other.records:
            path = directory / DIRECTORY / name / "contact.csv"
            yield write_csv(path, ENGINE_HEADER, [contact_row(contact) for contact in other.records])


def _or_empty(value: Any) -> Any:
    return "" if value is None else value


def criterion_error(study: Study, run: Any, by: str) -> float | None:
    """Estimate the error of a criterion from the error of the resistance.

    Returns
    -------
    float or None
        Error in the unit of the criterion; None where the error of the resistance is unknown.
    """
    return (
        None
        if study.stages.drive.heavier_runs is None
        else error(run, study.stages.drive.heavier_runs.get(run.name), by)
    )


def save_comparisons(study: Study, directory: Path) -> Iterator[Path]:
    """Save contacts and resistance maps of the compared engines for the next run."""
    for name, other in study.comparison.items():
        if other.records:
            found: tuple[Any, ...] = (other.records, other.held, other.second_pass, other.resistance)
            results = KeptResults(*found)
            yield from write_results(directory / DIRECTORY / name, results, other.key)
