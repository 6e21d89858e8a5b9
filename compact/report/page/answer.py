"""Selection of the results that the page states first: best laws, resistance, and the uncertainty of both.

The templates `question.html.j2` and `answer.html.j2` phrase them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.sensitivity import Shift
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.material.mix import Parameter
from compact.report.number_format import format_percent, format_quantity
from compact.report.text import guide_sentence, return_sentence
from compact.verification.balance_checks import BalanceCheck

ANSWER_CRITERIA = 2  # [-], number of criteria in the answer; the tables have the others
CONTACT_MODELS = {
    "formula": "the engineering formulas 1.1–1.10",
    "column": "confined-compression columns with irreversible compaction",
    "spectral": "an elastic or viscoelastic layer on its base, solved in Fourier space",
    "fem": "an elastic or viscoelastic layer by finite elements",
    "compaction": "a layer with irreversible compaction by finite elements",
}


@dataclass(frozen=True)
class BestLaw:
    """First law by a criterion; `next_amount` and `last_amount` are the requirements of the next and the last law.

    `reason` is set where all values are infinite, `single` where there is one law only.
    """

    term: str
    laws: tuple[str, ...] = ()
    value: str = ""
    single: bool = False
    tied: bool = False
    next_law: str = ""
    next_amount: str = ""
    last_law: str = ""
    last_amount: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Conflict:
    """Requirement by one criterion of the law that is first by another."""

    law: str
    term: str
    amount: str
    other_term: str


@dataclass(frozen=True)
class Unfollowable:
    """Laws without a finite value, and the reason."""

    laws: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class EngineAccuracy:
    """Error estimates of a layered engine [-], `interpolation` over the largest resistance; the kind of its model."""

    engine: str
    error: float | None
    interpolation: float
    speeds: int
    compacting: bool
    one_dimensional: bool


@dataclass(frozen=True)
class Resolution:
    """Resolution of rank 1 against the error of the resistance; `error` is empty where it is unknown."""

    term: str
    tied: bool
    error: str
    resolved: bool


@dataclass(frozen=True)
class ComparedFirst:
    """First law by another engine, with the pairs of laws that are discordant beyond the errors."""

    law: str
    same: bool
    term: str
    value: str
    discordant: int
    pairs: int


@dataclass(frozen=True)
class SensitivitySummary:
    """Inputs that change the first law, by name, and how the ends were computed."""

    methods: str
    inputs: int
    out_of_range: int
    changes: Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class Answer:
    """Results of the answer box and of the list of uncertainties."""

    winners: list[BestLaw]
    rigid_winners: list[BestLaw]
    unfollowable: list[Unfollowable]
    conflicts: list[Conflict]
    omitted_laws: Mapping[str, str]
    mean_speed: float
    mean_resistance: float
    roller_load: float
    guide_sentence: str
    return_sentence: str
    unreachable: str
    engine_accuracy: EngineAccuracy | None
    resolutions: list[Resolution]
    required_pressure: Parameter
    roller_force_low: float | None
    roller_force_high: float | None
    comparisons: Mapping[str, list[ComparedFirst]]
    sensitivity: SensitivitySummary
    checks: int
    failed_checks: list[str]
    remarks: list[str]
    advice: tuple[str, ...]


def question(study: Study) -> dict[str, Any]:
    """Select the variables of the template of the question."""
    scene = study.scene
    return {
        "scene": scene,
        "laws": list(study.cycles),
        "lift_thickness": scene.lift_thickness if scene.layer.lift_thickness else None,
        "contact_model": CONTACT_MODELS[scene.accuracy.engine],
    }


def answer(study: Study, checks: Sequence[BalanceCheck]) -> Answer:
    """Select the results that the page states first."""
    scene, kind = study.scene, study.scene.drive.kind
    orders = _first_criteria(study.places[kind])
    rigid = _first_criteria(study.places.get("rigid", {}) if kind != "rigid" else {})
    force = study.numbers["roller_force"]
    reach = study.mix.density_achievable
    resistance = study.resistance(np.array([scene.mean_speed]), np.zeros(1))
    return Answer(
        winners=[_best_law(by, order) for by, order in orders.items()],
        rigid_winners=[_best_law(by, order) for by, order in rigid.items()],
        unfollowable=_unfollowable(orders),
        conflicts=_conflicts(orders),
        omitted_laws=study.laws_not_made,
        mean_speed=scene.mean_speed,
        mean_resistance=float(np.ravel(resistance)[0]),
        roller_load=study.roller_load,
        guide_sentence=guide_sentence(study),
        return_sentence=return_sentence(study),
        unreachable="" if reach else reach.reason,
        engine_accuracy=_engine_accuracy(study) if study.layered else None,
        resolutions=list(_resolutions(orders)),
        required_pressure=study.mix.parameter("required_pressure"),
        roller_force_low=None if force.high is None else force.low,
        roller_force_high=None if force.low is None else force.high,
        comparisons=_comparisons(study),
        sensitivity=_sensitivity(study.sensitivities),
        checks=len(checks),
        failed_checks=[check.name for check in checks if not check.passed],
        remarks=[sentence for sentences in scene.replacements.values() for sentence in sentences],
        advice=scene.advice,
    )


def _first_criteria(orders: Mapping[str, list[Place]]) -> dict[str, list[Place]]:
    return dict(list(orders.items())[:ANSWER_CRITERIA])


def _term(by: str) -> str:
    return CRITERIA[by].quantity.term


def _best_law(by: str, order: list[Place]) -> BestLaw:
    """Select the first law by a criterion, with the requirements of the next and the last one."""
    first = _first_places(order)
    if not first:
        return BestLaw(_term(by), reason=order[0].reason)
    least = first[0].value
    value = format_quantity(least, CRITERIA[by].unit, 3)
    laws = tuple(place.law for place in first)
    finite = [place for place in order if not place.reason]
    if finite[-1].rank == 1:
        return BestLaw(_term(by), laws, value, single=len(order) == 1)
    following, last = finite[len(first)], finite[-1]
    return BestLaw(
        _term(by),
        laws,
        value,
        tied=first[0].tie,
        next_law=following.law,
        next_amount=_excess(following.value, least, by),
        last_law=last.law if last is not following else "",
        last_amount=_excess(last.value, least, by),
    )


def _first_places(order: list[Place]) -> list[Place]:
    """Return the places of rank 1; none where all values are infinite."""
    return [place for place in order if place.rank == 1 and not place.reason]


def _excess(value: float, least: float, by: str) -> str:
    """Format a value as its share above the least, or as itself where that share has no meaning."""
    criterion = CRITERIA[by]
    if criterion.floor or not least > 0:
        return format_quantity(value, criterion.unit, 3)
    return f"{format_percent(value / least - 1)} more"


def _unfollowable(orders: Mapping[str, list[Place]]) -> list[Unfollowable]:
    """Collect the laws without a finite value, each reason once for all criteria."""
    reasons: dict[str, dict[str, None]] = {}
    for place in (place for order in orders.values() for place in order if place.reason):
        reasons.setdefault(place.reason, {})[place.law] = None
    return [Unfollowable(tuple(laws), reason) for reason, laws in reasons.items()]


def _conflicts(orders: Mapping[str, list[Place]]) -> list[Conflict]:
    """Collect the requirements by each criterion of the laws that are first by another one only."""
    found: dict[Conflict, None] = {}
    for by, order in orders.items():
        first = _first_places(order)
        for other, other_order in orders.items():
            best = _first_places(other_order)
            if by == other or not first or not best or best[0].law in [place.law for place in first]:
                continue
            value = next(place.value for place in other_order if place.law == first[0].law)
            if np.isfinite(value):
                found[Conflict(first[0].law, _term(by), _excess(value, best[0].value, other), _term(other))] = None
    return list(found)


def _engine_accuracy(study: Study) -> EngineAccuracy:
    engine, resistance = study.scene.accuracy.engine, study.resistance_map
    return EngineAccuracy(
        engine=engine,
        error=resistance.engine_error,
        interpolation=resistance.error,
        speeds=len(resistance.speeds),
        compacting=study.engine.compacting,
        one_dimensional=engine == "column",
    )


def _resolutions(orders: Mapping[str, list[Place]]) -> Iterator[Resolution]:
    """State for each criterion whether the error of the resistance leaves the first law first."""
    for by, order in orders.items():
        first = _first_places(order)
        if not first or len(first) == len(order):
            continue
        tied, error = first[0].tie, ""
        if first[0].error is not None and not tied:
            error = format_quantity(max(place.error or 0.0 for place in first), CRITERIA[by].unit, 2)
        yield Resolution(_term(by), tied, error, all(place.resolved for place in first))


def _comparisons(study: Study) -> dict[str, list[ComparedFirst]]:
    """Collect the first laws by the other engines under the drive of the scene."""
    kind = study.scene.drive.kind
    criteria = _first_criteria(study.places[kind])
    found: dict[str, list[ComparedFirst]] = {name: [] for name in study.comparison}
    for each in study.agreements:
        if each.other_engine == each.engine or not each.drive == each.other_drive == kind or each.by not in criteria:
            continue
        best = study.places_by_engine[each.other_engine][kind][each.by][0]
        found[each.other_engine].append(
            ComparedFirst(
                law=best.law,
                same=each.first == each.other_first,
                term=_term(each.by),
                value=format_quantity(best.value, CRITERIA[each.by].unit, 3),
                discordant=each.agreement.resolved_discordant_pairs,
                pairs=each.agreement.pairs,
            )
        )
    return {name: firsts for name, firsts in found.items() if firsts}


def methods(shifts: Sequence[Shift]) -> str:
    """Name the means by which the ends of the inputs were computed."""
    found = dict.fromkeys("formula" if shift.by == "formula" else f"the engine {shift.by}" for shift in shifts)
    return f"By {' or '.join(found) or 'formula'}"


def _sensitivity(shifts: Sequence[Shift]) -> SensitivitySummary:
    """Collect the inputs with an end at which another law is first."""
    changed: dict[str, set[str]] = {}
    for shift in shifts:
        for by, law in shift.base.law.items():
            ends = [end for end in (shift.low, shift.high) if end is not None and law not in end.ties[by]]
            if ends:
                changed.setdefault(shift.name, set()).update(f"{end.law[by]} by {_term(by)}" for end in ends)
    return SensitivitySummary(
        methods=methods(shifts),
        inputs=len(shifts),
        out_of_range=sum((shift.low is None) + (shift.high is None) for shift in shifts),
        changes={name: sorted(laws) for name, laws in changed.items()},
    )
