"""The order of the laws by every engine and drive of a study: tables, whether they agree, and what is kept of each."""

from compact.analysis import resistance_stage
from compact.analysis.ranking_uncertainty import agreement, error
from compact.analysis.study import BESIDE
from compact.files import write_csv
from compact.machine.ranking import CRITERIA, value_of
from compact.report.contact_tables import ENGINE_HEADER, row

FEW = 3  # laws that share a place are named
RANKING_HEADER = (
    "engine", "drive", "criterion", "rank", "law", "value", "unit", "margin", "tie", "error", "sure",
    "reason",
)  # fmt: skip
CRITERIA_HEADER = ("law", "drive", "criterion", "value", "unit", "error")
AGREEMENT_HEADER = (
    "engine", "drive", "other_engine", "other_drive", "criterion", "kendall_tau", "swaps", "sure_swaps", "pairs",
    "first", "other_first",
)  # fmt: skip


def places(study):
    """Lists of `Place` by engine, drive and criterion, the scene's engine and drive first."""
    return {study.scene.accuracy.engine: study.places} | {name: aside.places for name, aside in study.beside.items()}


def beside(study, kind, by):
    """Law -> `Place`, of each engine beside the scene's, for one drive and criterion."""
    return {name: {place.law: place for place in aside.places[kind][by]} for name, aside in study.beside.items()}


def agreements(study):
    """(engine, drive, other engine, other drive, criterion, `Agreement`, first of one, first of the other).

    Every engine beside the scene's, under each drive; and of the scene's engine the other drive beside its own.
    """
    found, ours = [], study.scene.accuracy.engine
    pairs = [(ours, kind, name, kind) for name in study.beside for kind in study.places]
    own, *others = study.places
    for pair in pairs + [(ours, own, ours, other) for other in others]:
        one, other = (places(study)[engine][kind] for engine, kind in (pair[:2], pair[2:]))
        found += [(*pair, by, agreement(one[by], other[by], by), _first(one[by]), _first(other[by])) for by in one]
    return found


def _first(order):
    """The law that is first; a few that share the place, and of more their number; none where all are infinite."""
    laws = [place.law for place in order if place.rank == 1 and not place.reason]
    if not laws:
        return "none"
    return "/".join(sorted(laws)) if len(laws) <= FEW else f"{len(laws)} laws alike"


def write_ranking_tables(study, directory):
    """Every place with its margin and error, every criterion of every law, and where orders agree; yields paths."""
    yield write_csv(directory / "ranking.csv", RANKING_HEADER, [
        (
            engine, kind, by, p.rank, p.law, p.value, CRITERIA[by].unit, p.margin, p.tie, _told(p.error),
            _told(p.sure), p.reason,
        )
        for engine, orders in places(study).items() for kind, order in orders.items()
        for by, found in order.items() for p in found
    ])  # fmt: skip
    yield write_csv(directory / "criteria.csv", CRITERIA_HEADER, [
        (name, study.scene.drive.kind, by, value_of(run, by), criterion.unit, _told(moved(study, run, by)))
        for name, run in study.runs.items() for by, criterion in CRITERIA.items()
    ])  # fmt: skip
    if study.beside:
        rows = [
            (*who, by, *agreed, *firsts)
            for *who, by, agreed, one, other in agreements(study)
            for firsts in [(one, other)]
        ]
        yield write_csv(directory / "agreement.csv", AGREEMENT_HEADER, rows)
    for name, aside in study.beside.items():
        if aside.contacts:
            path = directory / BESIDE / name / "contact.csv"
            yield write_csv(path, ENGINE_HEADER, [row(contact) for contact in aside.contacts])


def _told(known):
    return "" if known is None else known


def moved(study, run, by):
    """How far the error of the resistance moves a criterion of a run, in its unit; None where it is not known."""
    return None if study.heavier_runs is None else error(run, study.heavier_runs.get(run.name), by)


def keep(study, directory):
    """Leave contacts and maps of the engines beside for the next run; yields what is written."""
    for name, aside in study.beside.items():
        if aside.contacts:
            found = aside.contacts, aside.held, aside.second_pass, aside.resistance
            yield from resistance_stage.save(directory / BESIDE / name, *found, aside.key, [])


def lines(study, criteria):
    """How far each engine beside agrees, a line for each drive and criterion."""
    for engine, kind, other, also, by, found, one, first in agreements(study) if study.beside else []:
        if by not in criteria:
            continue
        who = f"{other} beside {engine}, {kind} drive" if other != engine else f"{engine}, {also} beside {kind} drive"
        same = "the same first" if one == first else f"first {first}, not {one}"
        yield (
            f"  {by.replace('_', ' ')}, {who}: {found.swaps} of {found.pairs} pairs swapped, {found.sure} beyond "
            f"the errors, Kendall's tau {found.tau:.3f}; {same}"
        )


def resistances(study):
    """Resistance of one cart by engine, the scene's first."""
    return {study.scene.accuracy.engine: study.resistance} | {
        name: aside.resistance for name, aside in study.beside.items()
    }
