"""Sentences and table of the answer that the terminal and the first screen of the page share.

One line answers each question of a designer in docs/how_to/answer.md: the law, the force, the motor, the model, the
agreement, another duration, a rigid drive, a stiffer mix, the first measurement, and the quantity that is held.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from compact.analysis.stages.uncertainty import AIR, DRIVE, FED, LAW, MARGIN_SOURCES, MIX, RankingUncertainty
from compact.analysis.stages.verdict import (
    ModelAnswer,
    Verdict,
    reason_against,
    sizing_model,
)
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA, first_of
from compact.report.sizing.sentences import work_warnings
from compact.report.tables import format_column, format_percent
from compact.scene.schema import Overrides

NAMED_TIES = 3  # [-], laws of a tie that are named
MODEL_HEADER = (
    "model", "for sizing?", "mean resistance", "coefficient", "discretisation error", "model spread",
    "layer over contact",
)  # fmt: skip
MODEL_NAMES = {"process": "forming process"}  # in the table of the models
SPREAD_WORDS = {"formula": "not stated", "column": "no bow wave"}


class Recommendation(NamedTuple):
    """Recommended law by one criterion, in words.

    Parameters
    ----------
    term, law : str
        Criterion and law.
    peaks : str
        Peaks of the law by this and the other criteria.
    required : str
        The same peaks with their margins; empty without the uncertainty of the result.
    margin : str
        Margins in per cent, and the mix that they leave out.
    agreement : str
        Clause on the agreement of the models, or on the tie.
    drive : str
        Clause on the drives by which the peak or the first law change; empty for a drive that is known.
    part : str
        Statement that no model is valid for sizing; empty otherwise.
    """

    term: str
    law: str
    peaks: str
    required: str
    margin: str
    agreement: str
    drive: str
    part: str

    @property
    def sentence(self) -> str:
        """One sentence without a full stop."""
        least = f"least {self.term}: {self.law}, {self.peaks}"
        if self.part:
            return f"{least}, {self.part}; {self.agreement}"
        size = (
            f"with {self.law} the drive must deliver {self.required}, a margin of {self.margin}"
            if self.required
            else ""
        )
        return "; ".join(filter(None, (least, size, self.agreement, self.drive)))


def own_verdicts(study: Study) -> dict[str, Verdict]:
    """Return the verdicts at the duration and with the drive of the scene, by criterion."""
    own = study.scene.motion.duration, study.scene.drive.kind
    return {by: each for (*case, by), each in study.verdicts.items() if tuple(case) == own}


def recommendations(study: Study) -> list[Recommendation]:
    """State the recommended law, its peak and the margin of the drive by each criterion of the verdict.

    Returns
    -------
    list of Recommendation
    """
    valid, found = [each for each in study.models if each.valid], []
    sizing, known = sizing_model(study.models), study.uncertainty
    by_engine = "" if sizing is study.models[0] else f" by {sizing.engine}"
    for by, verdict in own_verdicts(study).items():
        law, peaks = verdict.law, _peaks(study, by, verdict.law)
        margins = {} if known is None else {each: known.margin(each, law=law) for each in peaks}
        found.append(Recommendation(
            CRITERIA[by].quantity.term, law, _listed(peaks) + by_engine,
            _listed({each: peaks[each] * (1 + margin) for each, margin in margins.items()}),
            " and ".join(map(format_percent, margins.values())) + _without_heaping(study) if margins else "",
            _agreement(verdict, valid), "" if known is None else _drive_clause(known, by, verdict.value),
            "" if valid else f"{sizing.invalid}, not for sizing",
        ))  # fmt: skip
    return found


def _listed(peaks: Mapping[str, float]) -> str:
    return " and ".join(_three_digits(value, CRITERIA[by].unit) for by, value in peaks.items())


def _drive_clause(known: RankingUncertainty, by: str, peak: float) -> str:
    """State the range of the peak over the drives that the scene may have, and where another law is first."""
    source, law = known.source(DRIVE), known.laws[by]
    if source is None:
        return ""
    low, high = (peak * (1 + change) for change in source.changes(law, by))
    unit = CRITERIA[by].unit
    clause = (
        f"the peak is {_three_digits(low, unit)} to {_three_digits(high, unit)} over the drive, which is not measured"
    )
    others = source.other_firsts(by, law)
    if not others:
        return f"{clause} ({source.variation}: {law} stays first)"
    firsts = ", ".join(f"{first} with {words}" for words, first in others.items())
    return f"{clause}: first are {firsts}"


def _without_heaping(study: Study) -> str:
    """Return the clause on the laws of the mix by which it heaps up, which have no resistance for the margin."""
    variants = study.model_spread.variants if study.model_spread else ()
    heaped = [each for each in variants if each.heaping is not None]
    if not heaped:
        return ""
    cohesions = ", ".join(f"{each.cohesion_loose / 1e3:.3g}" for each in heaped if each.cohesion_loose is not None)
    return f" without mix that heaps up{f' (cohesion {cohesions} kPa)' if cohesions else ''}"


def _peaks(study: Study, by: str, law: str) -> dict[str, float]:
    """Return the peaks of a law by the model that sizes the machine, that of a criterion first."""
    motion, kind = study.scene.motion, study.scene.drive.kind
    model, others = sizing_model(study.models), [other for other in own_verdicts(study) if other != by]
    found = {each: model.values(motion.duration, kind, each).get(law) for each in (by, *others)}
    return {each: value for each, value in found.items() if value is not None}


def _agreement(verdict: Verdict, valid: Sequence[ModelAnswer]) -> str:
    """State the agreement of the models on rank 1, or the tie; models fitted to one point are one witness."""
    fitted = sum(bool(each.fitted) for each in valid)
    models = "the only valid model" if len(valid) < 2 else f"all {len(valid)} valid models"
    models += f" (the {fitted} that are fitted count as one)" * (fitted > 1)
    if verdict.resolved:
        return f"resolved: first by {models}, beyond the errors and all that is unknown of mix and drive"
    others = verdict.contenders[1:]
    names = ", ".join(others[:NAMED_TIES]) + (f" and {len(others) - NAMED_TIES} more" * (len(others) > NAMED_TIES))
    if verdict.agree:
        return f"not resolved, tie with {names}: first by {models}, but not beyond the errors, the mix and the drive"
    return (
        f"not resolved, tie with {names}: the models disagree, and this law loses least, "
        f"{format_percent(verdict.regret)} at most"
    )


def model_table(study: Study, duration: float | None = None, drive: str | None = None) -> list[list[str]]:
    """Tabulate the models: first law and peak by each criterion, resistance, errors and validity.

    Parameters
    ----------
    study : Study
        A finished study.
    duration : float, optional
        Duration of a pass [s]; that of the scene by default.
    drive : str, optional
        Kind of drive; that of the scene by default.

    Returns
    -------
    list of list of str
        Header and rows; linear engines are marked as not for sizing. Engines without a steady state are last.
    """
    motion = study.scene.motion
    duration, drive = duration or motion.duration, drive or study.scene.drive.kind
    criteria = [by for (time, kind, by) in study.verdicts if (time, kind) == (duration, drive)]
    terms = [f"least {CRITERIA[by].quantity.term}" for by in criteria]
    lead, rows = sizing_model(study.models), []
    forces = format_column([model.mean_resistance[duration] for model in study.models], "N", 3)
    for model, force in zip(study.models, forces, strict=True):
        part = model.mean_resistance[duration] / lead.mean_resistance[duration]
        ratio = "" if model.valid == lead.valid else f" ({format_percent(part)} of {lead.engine})"
        rows.append([
            MODEL_NAMES.get(model.engine, model.engine), _validity(model),
            *(_first_cell(model, duration, drive, by) for by in criteria), force + ratio,
            f"{model.coefficient[duration]:.3f}", _error_cell(model), _spread_cell(model),
            "–" if model.height_ratio is None else f"{model.height_ratio:.2g}",
        ])  # fmt: skip
    for name, reason in _without_result(study).items():
        against = reason_against(study.scene.with_engine(name), None)
        rows.append([name, f"no: {against}" if against else "yes", *["–"] * len(criteria), reason, *["–"] * 4])
    return [[MODEL_HEADER[0], MODEL_HEADER[1], *terms, *MODEL_HEADER[2:]], *rows]


def _without_result(study: Study) -> dict[str, str]:
    """Return the reason why an engine of the comparison has no resistance, in two words, by its name."""
    reasons: dict[str, Mapping[str, RuntimeError]] = {
        "heaps up": study.heaping, "not steady": study.unsteady, "no equilibrium": study.without_equilibrium,
    }  # fmt: skip
    return {name: reason for reason, found in reasons.items() for name in found}


def _validity(model: ModelAnswer) -> str:
    fitted = "fitted" if model.fitted else ""
    return "; ".join(filter(None, ("yes" if model.valid else f"no: {model.invalid}", fitted)))


def limit_sentences(study: Study) -> Iterator[str]:
    """State what the answer rests on: what was fitted to what, whether the machine feeds what it presses, and the air.

    Yields
    ------
    str
        One sentence without a full stop.
    """
    yield from filter(None, (_fitted_sentence(study), study.scene.mix.fit_remark))
    yield from work_warnings(study.work_balance)
    air = study.uncertainty and study.uncertainty.source(AIR)
    if air:
        yield f"pore air is not part of the resistance but of the margin: {air.variation}"


def _fitted_sentence(study: Study) -> str:
    """State which inputs of which models are fitted to what, by the comments of the scene; empty without a fit."""
    engines: dict[str, list[str]] = {}  # by the fitted input, with the words of its comment
    for model in study.models:
        own = study.scene if model is study.models[0] else study.scene.with_engine(model.engine)
        for key in model.fitted:
            table, _, name = key.rpartition(".")
            point = own.remark(table, name).partition("calibrated")[2].lstrip(":, ")
            engines.setdefault(f"{name}, {point}" if point else name, []).append(model.engine)
    found = "; ".join(f"{' and '.join(names)}: {inputs}" for inputs, names in engines.items())
    count = sum(bool(model.fitted) for model in study.models)
    return f"fitted, not predicted: {found}{f'; these {count} models are one witness' * (count > 1)}" if found else ""


def _first_cell(model: ModelAnswer, duration: float, drive: str, by: str) -> str:
    first = model.first(duration, drive, by)
    return f"{first[0].law} {_three_digits(first[0].value, CRITERIA[by].unit)}" if first else "none finite"


def _error_cell(model: ModelAnswer) -> str:
    if model.error is None:
        return "closed form" if model.engine == "formula" else "no estimate"
    return "< 0.1 %" if model.error < 1e-3 else format_percent(model.error)


def _spread_cell(model: ModelAnswer) -> str:
    if model.spread is None:
        return SPREAD_WORDS.get(model.engine, "not computed") if model.valid else "–"
    low, high = (100 * (each - 1) for each in model.spread)
    return f"{low:+.0f} to {high:+.0f} %".replace("-", "−")


def duration_lines(study: Study) -> list[str]:
    """State the recommended laws at the other durations of a pass, and with a rigid drive.

    Returns
    -------
    list of str
        Sentences without full stops.
    """
    motion, kind = study.scene.motion, study.scene.drive.kind
    groups: dict[tuple[float, str], list[Verdict]] = {}
    for (duration, drive, _), verdict in study.verdicts.items():
        groups.setdefault((duration, drive), []).append(verdict)
    found = []
    for (duration, drive), verdicts in groups.items():
        if (duration, drive) == (motion.duration, kind) or (drive != kind and duration != motion.duration):
            continue
        case = f"with a {drive} drive" if drive != kind else f"at {duration:.3g} s a pass"
        found.append(f"{case}: {'; '.join(map(_short, verdicts))}")
    return found


def _short(verdict: Verdict) -> str:
    value = _three_digits(verdict.value, CRITERIA[verdict.by].unit)
    ties = ", ".join(verdict.contenders[1 : 1 + NAMED_TIES])
    return f"{verdict.law}, {value}{f' (tie with {ties})' if ties else ''}"


def stiffness_sentence(study: Study) -> str:
    """State the peaks of the recommended laws for a mix that is twice as stiff.

    Returns
    -------
    str
        One sentence without a full stop; empty without the uncertainty of the result.
    """
    known = study.uncertainty
    if known is None or known.mix is None or not math.isfinite(known.mix.twice_as_stiff):
        return ""
    ratio = known.mix.twice_as_stiff
    changes = " and the ".join(
        f"{CRITERIA[by].quantity.term} by {known.peak_change(by, ratio):+.0%}".replace("+", "").replace("%", " %")
        for by in known.peaks
    )
    return (
        f"a mix twice as stiff (half the Heckel slope) has {ratio:.1f} times the resistance, and raises the {changes}"
    )


def measurement_sentence(study: Study) -> str:
    """State which parameter should be measured first, with its share of the variance and its effect on the peak force.

    Returns
    -------
    str
        One sentence without a full stop; empty without the uncertainty of the result.
    """
    known = study.uncertainty
    if known is None or known.mix is None or not known.peaks:
        return ""
    by = next(iter(known.peaks))
    shares = known.mix.shares[by]
    name = list(shares)[first_of([-share for share in shares.values()], floor=1.0)]
    low, high = sorted(known.peak_change(by, ratio) for ratio in known.mix.alone[name])
    after = format_percent(known.margin(by, (MIX,))) + _largest_rest(known, by)
    measured = "the density ratio of the fed mix" if name == FED else _meaning(name)
    share, term = format_percent(shares[name]), CRITERIA[by].quantity.term
    sentence = (
        f"measure first: {measured}, {share} of the variance of the {term} over the mix ({_signed(low)} to "
        f"{_signed(high)}); with the mix measured the margin is {after}"
    )
    law = known.source(LAW)
    if law is not None and (rest := _spread(*law.changes(known.laws[by], by))):
        sentence += f"; then measure the strength of loose mix ({rest})"
    return sentence


def _largest_rest(known: RankingUncertainty, by: str) -> str:
    """Name the source of most of the margin with the mix measured, where there is one."""
    law = known.laws[by]
    rest = {each.name: each.changes(law, by)[1] for each in known.sources if each.name in set(MARGIN_SOURCES) - {MIX}}
    largest = max(rest, key=rest.__getitem__, default="")
    return f", most of it by {largest}" if largest and rest[largest] > 0.8 * known.margin(by, (MIX,)) > 0.01 else ""


def _meaning(name: str) -> str:
    """Return the meaning of a parameter of the mix in words, without its unit."""
    words = Overrides.model_fields[name].description or name
    return f"{words.rsplit(' in ', 1)[0]} (`{name}`)"


def _signed(share: float) -> str:
    return f"{100 * share:+.0f} %".replace("-", "−")


def _spread(low: float, high: float) -> str:
    return f"{_signed(low)} to {_signed(high)}" if max(abs(low), abs(high)) > 0.01 else ""


def uncertainty_table(known: RankingUncertainty, peaks: Mapping[str, str]) -> list[list[str]]:
    """Tabulate the sources of uncertainty: variation, change of the peaks, and first laws at the ends.

    Parameters
    ----------
    peaks : mapping of str to str
        Recommended law by criterion.

    Returns
    -------
    list of list of str
        Header and rows.
    """
    terms = [CRITERIA[by].quantity.term for by in peaks]
    header = ["source", "variation", *terms, *(f"first by {term}" for term in terms), "in the margin?"]
    rows = [header]
    for each in known.sources:
        changes = [_change(*each.changes(law, by)) for by, law in peaks.items()]
        firsts = [
            ", ".join(dict.fromkeys(each.other_firsts(by, law).values())) or "the same" for by, law in peaks.items()
        ]
        rows.append([each.name, each.variation, *changes, *firsts, "yes" if each.name in MARGIN_SOURCES else "no"])
    return rows


def _change(low: float, high: float) -> str:
    return _signed(low) if low == high else f"{_signed(low)} to {_signed(high)}"


def _three_digits(value: float, unit: str) -> str:
    """Format a quantity with three digits, zeros at its end included."""
    return format_column([value], unit, 3)[0]
