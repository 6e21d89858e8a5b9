"""Selection of the results that the page states first: best laws, resistance, and the uncertainty of both.

The templates `question.html.j2` and `answer.html.j2` phrase them.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, permutations
from typing import Any

import numpy as np

from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.balance_checks import BalanceCheck
from compact.analysis.stages.sensitivity import Shift
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.report.page import answer_text
from compact.report.page.blocks import Cell, Mark, Table, embed_figures
from compact.report.tables import format_percent, format_quantity
from compact.report.text import (
    air_sentence,
    guide_sentence,
    held_sentence,
    return_sentence,
    sleeve_sentence,
    spread_sentence,
)

ANSWER_CRITERIA = 2  # [-], number of criteria in the answer; the tables have the others
FIRST_FIGURES = {
    "models": (
        "Resistance of one cart over its speed by all models, with bands and the largest speeds of the best laws",
        "Thick: engine of the scene; grey band: other laws of the mix. Dotted verticals: largest speed of a law.",
    ),
    "best_cycles": (
        "Drive force and power of the three best laws over a cycle",
        "One cart with the drive of the scene, forward and return stroke.",
    ),
}
CONTACT_MODELS = {
    "formula": "the engineering formulas 1.1–1.10",
    "column": "confined-compression columns with irreversible compaction",
    "spectral": "an elastic or viscoelastic layer on its base, solved in Fourier space",
    "fem": "an elastic or viscoelastic layer by finite elements",
    "compaction": "a layer with irreversible compaction by finite elements",
    "process": "all strokes of the forming process, with feed before each and a moving mould",
}
OTHER_MODEL = "an engine of another package"


def question(study: Study) -> dict[str, Any]:
    """Select the variables of the template of the question."""
    scene = study.scene
    return {
        "scene": scene,
        "laws": list(study.cycles),
        "lift_thickness": scene.lift_thickness if scene.layer.lift_thickness else None,
        "contact_model": CONTACT_MODELS.get(scene.accuracy.engine, OTHER_MODEL),
    }


def first_screen(study: Study, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Select the first screen of the page, the variable `first` of the template; empty without a verdict."""
    if not study.verdicts:
        return {}
    motion, kind = study.scene.motion, study.scene.drive.kind
    known, laws = study.uncertainty, {by: each.law for by, each in answer_text.own_verdicts(study).items()}
    tables = []
    for duration, drive in dict.fromkeys((duration, drive) for duration, drive, _ in study.verdicts):
        header, *rows = answer_text.model_table(study, duration, drive)
        speed = format_quantity(motion.stroke / duration, "m/s", 3)
        caption = f"All models, {drive} drive, {format_quantity(duration, 's', 3)} a pass ({speed})"
        cells: list[list[Cell]] = [_marked(row) for row in rows]
        table = Table(caption, header, cells, range(len(header) - 5, len(header)))
        tables.append(((duration, drive) == (motion.duration, kind), table))
    sources = None
    if known is not None and known.sources:
        header, *rows = answer_text.uncertainty_table(known, laws)
        sources = Table("Sources of uncertainty: change of the peaks of the recommended laws", header, rows)
    lines = [
        *answer_text.duration_lines(study), answer_text.stiffness_sentence(study),
        answer_text.measurement_sentence(study), spread_sentence(study), sleeve_sentence(study), held_sentence(study),
    ]  # fmt: skip
    return {
        "recommendations": answer_text.recommendations(study),
        "table": next(table for own, table in tables if own),
        "other_tables": [table for own, table in tables if not own],
        "pictures": embed_figures(pictures, FIRST_FIGURES),
        "limits": list(answer_text.limit_sentences(study)),
        "lines": [line for line in lines if line],
        "sources": sources,
    }


def _marked(row: Sequence[str]) -> list[Cell]:
    """Mark the validity of a model."""
    model, validity, *cells = row
    said, _, reason = validity.replace(": ", "; ", 1).partition("; ")
    return [model, Mark("good" if said == "yes" else "bad", said, reason), *cells]


def answer(study: Study, checks: Sequence[BalanceCheck], pictures: Mapping[str, bytes] | None = None) -> dict[str, Any]:
    """Select the results that the page states first, the variable `answer` of the template."""
    scene, kind = study.scene, study.scene.drive.kind
    orders = _first_criteria(study.stages.drive.places[kind])
    rigid = _first_criteria(study.stages.drive.places.get("rigid", {}) if kind != "rigid" else {})
    force, reach = study.stages.contacts.numbers["roller_force"], study.mix.density_achievable
    resistance = study.resistance(np.array([scene.mean_speed]), np.zeros(1))
    return {
        "first": first_screen(study, pictures or {}),
        "winners": [_best_law(by, order) for by, order in orders.items()],
        "rigid_winners": [_best_law(by, order) for by, order in rigid.items()],
        "unfollowable": _unfollowable(orders),
        "conflicts": list(_conflicts(orders)),
        "omitted_laws": study.stages.laws.not_made,
        "mean_speed": scene.mean_speed,
        "mean_resistance": float(np.ravel(resistance)[0]),
        "roller_load": study.stages.contacts.roller_load,
        "guide_sentence": guide_sentence(study),
        "return_sentence": return_sentence(study),
        "air_sentence": air_sentence(study),
        "spread_sentence": spread_sentence(study),
        "unreachable": "" if reach else reach.reason,
        "engine": study.stages.contacts.engine,
        "resistance_map": study.stages.resistance.map if study.stages.contacts.engine.layered else None,
        "resolutions": list(_resolutions(orders)),
        "required_pressure": study.mix.parameter("required_pressure"),
        "roller_force": force if None not in (force.low, force.high) else None,
        "comparisons": _comparisons(study),
        "sensitivity": _sensitivity(study.sensitivities),
        "checks": len(checks),
        "failed_checks": [check.name for check in checks if not check.passed],
        "remarks": list(chain(*scene.replacements.values())),
        "advice": scene.advice,
    }


def _first_criteria(orders: Mapping[str, list[Place]]) -> dict[str, list[Place]]:
    return dict(list(orders.items())[:ANSWER_CRITERIA])


def term_of(by: str) -> str:
    """Return the standard term of a criterion."""
    return CRITERIA[by].quantity.term


def _best_law(by: str, order: list[Place]) -> dict[str, Any]:
    """Select the first law by a criterion, with the requirements of the next and the last one."""
    first, finite = _first_places(order), [place for place in order if not place.reason]
    if not first:
        return {"term": term_of(by), "reason": order[0].reason}
    least, laws = first[0].value, [place.law for place in first]
    best = {"term": term_of(by), "laws": laws, "value": _format(least, by), "single": len(order) == 1}
    if finite[-1].rank > 1:
        following, last = finite[len(first)], finite[-1]
        best |= {"tied": first[0].tie, "next_law": following.law, "next_amount": _excess(following.value, least, by)}
        if last is not following:
            best |= {"last_law": last.law, "last_amount": _excess(last.value, least, by)}
    return best


def _first_places(order: list[Place]) -> list[Place]:
    """Return the places of rank 1; none where all values are infinite."""
    return [place for place in order if place.rank == 1 and not place.reason]


def _excess(value: float, least: float, by: str) -> str:
    """Format a value as its share above the least, or as itself where that share has no meaning."""
    if CRITERIA[by].floor or not least > 0:
        return _format(value, by)
    return f"{format_percent(value / least - 1)} more"


def _format(value: float, by: str) -> str:
    return format_quantity(value, CRITERIA[by].unit, 3)


def _unfollowable(orders: Mapping[str, list[Place]]) -> list[dict[str, Any]]:
    """Collect the laws without a finite value, each reason once for all criteria."""
    reasons: dict[str, dict[str, None]] = {}
    for place in chain(*orders.values()):
        if place.reason:
            reasons.setdefault(place.reason, {})[place.law] = None
    return [{"laws": tuple(laws), "reason": reason} for reason, laws in reasons.items()]


def _conflicts(orders: Mapping[str, list[Place]]) -> Iterator[dict[str, str]]:
    """State the requirement by each criterion of the law that is first by another one only."""
    for (by, order), (other, other_order) in permutations(orders.items(), 2):
        first, best = _first_places(order), _first_places(other_order)
        if not first or not best or best[0].law in [place.law for place in first]:
            continue
        law = first[0].law
        value = next(place.value for place in other_order if place.law == law)
        if np.isfinite(value):
            amount = _excess(value, best[0].value, other)
            yield {"law": law, "term": term_of(by), "amount": amount, "other_term": term_of(other)}


def _resolutions(orders: Mapping[str, list[Place]]) -> Iterator[dict[str, Any]]:
    """State for each criterion whether the error of the resistance leaves the first law first."""
    for by, order in orders.items():
        first = _first_places(order)
        if not first or len(first) == len(order):
            continue
        tied, error = first[0].tie, ""
        if first[0].error is not None and not tied:
            error = format_quantity(max(place.error or 0.0 for place in first), CRITERIA[by].unit, 2)
        resolved = all(place.resolved for place in first)
        yield {"term": term_of(by), "tied": tied, "error": error, "resolved": resolved}


def _comparisons(study: Study) -> dict[str, list[dict[str, Any]]]:
    """Collect the first laws by the other engines under the drive of the scene."""
    kind = study.scene.drive.kind
    criteria = _first_criteria(study.stages.drive.places[kind])
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in study.comparison}
    for each in study.agreements:
        if each.other_engine == each.engine or not each.drive == each.other_drive == kind or each.by not in criteria:
            continue
        best = study.places_by_engine[each.other_engine][kind][each.by][0]
        found[each.other_engine].append({
            "law": best.law, "same": each.first == each.other_first, "term": term_of(each.by),
            "value": _format(best.value, each.by), "discordant": each.agreement.resolved_discordant_pairs,
            "pairs": each.agreement.pairs,
        })  # fmt: skip
    return {name: firsts for name, firsts in found.items() if firsts}


def methods(shifts: Sequence[Shift]) -> str:
    """Name the means by which the ends of the inputs were computed."""
    found = dict.fromkeys("formula" if shift.by == "formula" else f"the engine {shift.by}" for shift in shifts)
    return f"By {' or '.join(found) or 'formula'}"


def _sensitivity(shifts: Sequence[Shift]) -> dict[str, Any]:
    """Collect the inputs with an end at which another law is first."""
    changed: dict[str, set[str]] = {}
    for shift in shifts:
        for by in shift.base.law:
            if ends := shift.changed_ends(by):
                changed.setdefault(shift.name, set()).update(f"{end.law[by]} by {term_of(by)}" for end in ends)
    return {
        "methods": methods(shifts),
        "inputs": len(shifts),
        "out_of_range": sum((shift.low is None) + (shift.high is None) for shift in shifts),
        "changes": {name: sorted(laws) for name, laws in changed.items()},
    }
