"""Rankings of the laws by every engine and drive of a study: tables, and the agreement of the rankings."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from compact.analysis.comparison import DIRECTORY
from compact.analysis.kept_results import KeptResults, write_results
from compact.analysis.ranking_uncertainty import Agreement, Place, agreement, error
from compact.analysis.study import Study
from compact.files import write_csv
from compact.machine.ranking import CRITERIA, value_of
from compact.report.contact_tables import ENGINE_HEADER, contact_row

NAMED_LAWS = 3  # [-], largest number of laws of one rank that are named
RANKING_HEADER = (
    "engine", "drive", "criterion", "rank", "law", "value", "unit", "margin", "tie", "error", "sure",
    "reason",
)  # fmt: skip
CRITERIA_HEADER = ("law", "drive", "criterion", "value", "unit", "error")
AGREEMENT_HEADER = (
    "engine", "drive", "other_engine", "other_drive", "criterion", "kendall_tau", "swaps", "sure_swaps", "pairs",
    "first", "other_first",
)  # fmt: skip


@dataclass(frozen=True)
class RankingAgreement:
    """Agreement of two rankings by one criterion.

    Parameters
    ----------
    engine, drive : str
        Engine and drive of the first ranking.
    other_engine, other_drive : str
        Engine and drive of the second ranking.
    by : str
        Criterion.
    agreement : Agreement
    first, other_first : str
        First law of either ranking; several laws, their number or "none" where there is not one.
    """

    engine: str
    drive: str
    other_engine: str
    other_drive: str
    by: str
    agreement: Agreement
    first: str
    other_first: str


def places(study: Study) -> dict[str, Mapping[str, Mapping[str, list[Place]]]]:
    """Collect the rankings by engine, drive and criterion.

    Parameters
    ----------
    study : Study

    Returns
    -------
    dict of str to mapping
        Lists of `Place`, engine and drive of the scene first.
    """
    return {study.scene.accuracy.engine: study.places} | {name: other.places for name, other in study.beside.items()}


def comparison_places(study: Study, kind: str, by: str) -> dict[str, dict[str, Place]]:
    """Collect the places of each law by the engines of the comparison.

    Parameters
    ----------
    study : Study
    kind : str
        Kind of drive.
    by : str
        Criterion.

    Returns
    -------
    dict of str to dict
        Places by engine and law.
    """
    return {name: {place.law: place for place in other.places[kind][by]} for name, other in study.beside.items()}


def agreements(study: Study) -> list[RankingAgreement]:
    """Compare the ranking of the scene with those of every other engine, and of its other drive.

    Parameters
    ----------
    study : Study

    Returns
    -------
    list of RankingAgreement
    """
    engine = study.scene.accuracy.engine
    drive, *other_drives = study.places
    cases = [(kind, name, kind) for name in study.beside for kind in study.places]
    found = []
    for kind, other_engine, other_kind in cases + [(drive, engine, other) for other in other_drives]:
        one, other = places(study)[engine][kind], places(study)[other_engine][other_kind]
        found += [
            RankingAgreement(
                engine=engine,
                drive=kind,
                other_engine=other_engine,
                other_drive=other_kind,
                by=by,
                agreement=agreement(one[by], other[by], by),
                first=_first_laws(one[by]),
                other_first=_first_laws(other[by]),
            )
            for by in one
        ]
    return found


def _first_laws(order: list[Place]) -> str:
    """Name the laws of rank 1, or their number where they are many; "none" where all values are infinite."""
    laws = [place.law for place in order if place.rank == 1 and not place.reason]
    if not laws:
        return "none"
    return "/".join(sorted(laws)) if len(laws) <= NAMED_LAWS else f"{len(laws)} laws alike"


def write_ranking_tables(study: Study, directory: Path) -> Iterator[Path]:
    """Write ranking.csv, criteria.csv and, where engines are compared, agreement.csv and their contacts.

    Parameters
    ----------
    study : Study
    directory : Path
        Directory of the results.

    Yields
    ------
    Path
        Path of each file.
    """
    yield write_csv(directory / "ranking.csv", RANKING_HEADER, [
        (
            engine, kind, by, p.rank, p.law, p.value, CRITERIA[by].unit, p.margin, p.tie, _or_empty(p.error),
            _or_empty(p.sure), p.reason,
        )
        for engine, orders in places(study).items() for kind, order in orders.items()
        for by, found in order.items() for p in found
    ])  # fmt: skip
    yield write_csv(directory / "criteria.csv", CRITERIA_HEADER, [
        (
            name, study.scene.drive.kind, by, value_of(run, by), criterion.unit,
            _or_empty(criterion_error(study, run, by)),
        )
        for name, run in study.runs.items() for by, criterion in CRITERIA.items()
    ])  # fmt: skip
    if study.beside:
        yield write_csv(directory / "agreement.csv", AGREEMENT_HEADER, [
            (
                a.engine, a.drive, a.other_engine, a.other_drive, a.by, a.agreement.tau, a.agreement.swaps,
                a.agreement.sure, a.agreement.pairs, a.first, a.other_first,
            )
            for a in agreements(study)
        ])  # fmt: skip
    for name, other in study.beside.items():
        if other.contacts:
            path = directory / DIRECTORY / name / "contact.csv"
            yield write_csv(path, ENGINE_HEADER, [contact_row(contact) for contact in other.contacts])


def _or_empty(value: Any) -> Any:
    return "" if value is None else value


def criterion_error(study: Study, run: Any, by: str) -> float | None:
    """Estimate the error of a criterion from the error of the resistance.

    Parameters
    ----------
    study : Study
    run : Run
        Run of one law.
    by : str
        Criterion.

    Returns
    -------
    float or None
        Error in the unit of the criterion; None where the error of the resistance is unknown.
    """
    return None if study.heavier_runs is None else error(run, study.heavier_runs.get(run.name), by)


def save_comparisons(study: Study, directory: Path) -> Iterator[Path]:
    """Save contacts and resistance maps of the compared engines for the next run.

    Parameters
    ----------
    study : Study
    directory : Path
        Directory of the results.

    Yields
    ------
    Path
        Path of each file.
    """
    for name, other in study.beside.items():
        if other.contacts:
            results = KeptResults(other.contacts, other.held, other.second_pass, other.resistance)
            yield from write_results(directory / DIRECTORY / name, results, other.key)
