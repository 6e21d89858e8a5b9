"""Sentences and table of the answer that the terminal and the first screen of the page share.

One line answers each question of a designer in docs/how_to/answer.md: the law, the force, the motor, the model, the
agreement, another duration, a rigid drive, a stiffer mix, the first measurement, and the quantity that is held.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from compact.analysis.engines import ENGINES
from compact.analysis.stages.uncertainty import FED, LAW, MARGIN_SOURCES, MIX, RankingUncertainty
from compact.analysis.stages.verdict import ModelAnswer, Verdict
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.report.number_format import format_column, format_percent
from compact.scene.schema import Overrides

NAMED_TIES = 3  # [-], laws of a tie that are named
NOT_FOR_SIZING = "viscoelastic part only, not for sizing"
MODEL_HEADER = (
    "model", "for sizing?", "mean resistance", "coefficient", "discretisation error", "model spread",
)  # fmt: skip
CONFINED_FLOOR = "confined floor, not for sizing"
ONE_ROLLER = "one roller instead of a pair, not for sizing"
MODEL_NAMES = {"process": "forming process"}  # in the table of the models
SPREAD_WORDS = {"formula": "not stated", "column": "no bow wave"}


class Recommendation(NamedTuple):
    """Recommended law by one criterion, in words.

    Parameters
    ----------
    term, law : str
        Criterion and law.
    peak, required : str
        Peak, and peak with its margin; `required` is empty without the uncertainty of the result.
    part : str
        Statement that no model is valid for sizing; empty otherwise.
    other : str
        Peak of the law by the other criterion; empty without one.
    margin : str
        Margin in per cent, and the mix that it leaves out.
    agreement : str
        Clause on the agreement of the models, or on the tie.
    """

    term: str
    law: str
    peak: str
    required: str
    margin: str
    agreement: str
    part: str
    other: str

    @property
    def sentence(self) -> str:
        """One sentence without a full stop."""
        least = f"least {self.term}: {self.law}, {self.peak}{f' ({self.other})' if self.other else ''}"
        if self.part:
            return f"{least}, {self.part}; {self.agreement}"
        size = f"; the drive must deliver {self.required}, a margin of {self.margin}"
        return f"{least}; {self.agreement}{size if self.required else ''}"


def _sizing_model(study: Study) -> ModelAnswer:
    """Return the first model that is valid for sizing, the first model where there is none."""
    return next((model for model in study.models if model.valid), study.models[0])


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
    valid, found = [each.engine for each in study.models if each.valid], []
    sizing = _sizing_model(study)
    by_engine = "" if sizing is study.models[0] else f" by {sizing.engine}"
    for by, verdict in own_verdicts(study).items():
        margin = None if study.uncertainty is None else study.uncertainty.margin(by)
        unit = CRITERIA[by].unit
        found.append(Recommendation(
            CRITERIA[by].quantity.term, verdict.law, _three_digits(verdict.value, unit) + by_engine,
            "" if margin is None else _three_digits(verdict.value * (1 + margin), unit),
            "" if margin is None else format_percent(margin) + _without_heaping(study), _agreement(verdict, valid),
            "" if valid else _reason_against(sizing.engine), _other_peaks(study, by, verdict.law),
        ))  # fmt: skip
    return found


def _without_heaping(study: Study) -> str:
    """Return the clause on the laws of the mix by which it heaps up, which have no resistance for the margin."""
    variants = study.model_spread.variants if study.model_spread else ()
    heaped = [each for each in variants if each.heaping is not None]
    if not heaped:
        return ""
    cohesions = ", ".join(f"{each.cohesion_loose / 1e3:.3g}" for each in heaped if each.cohesion_loose is not None)
    return f" without mix that heaps up{f' (cohesion {cohesions} kPa)' if cohesions else ''}"


def _other_peaks(study: Study, by: str, law: str) -> str:
    """State the peaks of a law by the other criteria of the verdict, by the engine of the scene."""
    motion, kind = study.scene.motion, study.scene.drive.kind
    found = []
    for other in own_verdicts(study):
        value = _sizing_model(study).values(motion.duration, kind, other).get(law)
        if other != by and value is not None:
            found.append(f"{CRITERIA[other].quantity.term} {_three_digits(value, CRITERIA[other].unit)}")
    return ", ".join(found)


def _agreement(verdict: Verdict, valid: Sequence[str]) -> str:
    """State the agreement of the models on rank 1, or the tie."""
    models = "the only valid model" if len(valid) < 2 else f"all {len(valid)} valid models"
    if verdict.resolved:
        errors = f"{'its' if len(valid) < 2 else 'their'} errors"
        return f"resolved: first by {models}, beyond {errors} and the spread of the mix"
    others = verdict.contenders[1:]
    names = ", ".join(others[:NAMED_TIES]) + (f" and {len(others) - NAMED_TIES} more" * (len(others) > NAMED_TIES))
    if verdict.agree:
        return f"tie with {names}: first by {models}, but not beyond the errors and the spread of the mix"
    return f"tie with {names}: the models disagree, and this law loses least, {format_percent(verdict.regret)} at most"


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
    lead, rows = _sizing_model(study), []
    forces = format_column([model.mean_resistance[duration] for model in study.models], "N", 3)
    for model, force in zip(study.models, forces, strict=True):
        part = model.mean_resistance[duration] / lead.mean_resistance[duration]
        ratio = "" if model.valid == lead.valid else f" ({format_percent(part)} of {lead.engine})"
        rows.append([
            MODEL_NAMES.get(model.engine, model.engine), _validity(model.engine, model.valid),
            *(_first_cell(model, duration, drive, by) for by in criteria), force + ratio,
            f"{model.coefficient[duration]:.3f}", _error_cell(model), _spread_cell(model),
        ])  # fmt: skip
    for name, reason in _without_result(study).items():
        rows.append([name, _validity(name, ENGINES[name].sizing), *["–"] * len(criteria), reason, *["–"] * 3])
    return [[MODEL_HEADER[0], MODEL_HEADER[1], *terms, *MODEL_HEADER[2:]], *rows]


def _without_result(study: Study) -> dict[str, str]:
    """Return the reason why an engine of the comparison has no resistance, in two words, by its name."""
    reasons: dict[str, Mapping[str, RuntimeError]] = {
        "heaps up": study.heaping, "not steady": study.unsteady, "no equilibrium": study.without_equilibrium,
    }  # fmt: skip
    return {name: reason for reason, found in reasons.items() for name in found}


def _validity(engine: str, valid: bool) -> str:
    return "yes" if valid else f"no: {_reason_against(engine)}"


def _reason_against(engine: str) -> str:
    """State why a model is not valid for sizing."""
    return {"process": CONFINED_FLOOR, "formula": ONE_ROLLER}.get(engine, NOT_FOR_SIZING)


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
    name = max(shares, key=shares.__getitem__)
    low, high = sorted(known.peak_change(by, ratio) for ratio in known.mix.alone[name])
    after = format_percent(known.margin(by, (MIX,)))
    measured = "the density ratio of the fed mix" if name == FED else _meaning(name)
    share, term = format_percent(shares[name]), CRITERIA[by].quantity.term
    sentence = (
        f"measure first: {measured}, {share} of the variance of the {term} over the mix ({_signed(low)} to "
        f"{_signed(high)}); with the mix measured the margin is {after}"
    )
    law = known.source(LAW)
    if law is not None and (rest := _spread(law.low.change[by], law.high.change[by])):
        sentence += f"; then measure the strength of loose mix ({rest})"
    return sentence


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
        changes = [_change(each.low.change[by], each.high.change[by]) for by in peaks]
        firsts = [_firsts(each.low.first[by], each.high.first[by], law) for by, law in peaks.items()]
        rows.append([each.name, each.variation, *changes, *firsts, "yes" if each.name in MARGIN_SOURCES else "no"])
    return rows


def _change(low: float, high: float) -> str:
    return _signed(low) if low == high else f"{_signed(low)} to {_signed(high)}"


def _firsts(low: str, high: str, recommended: str) -> str:
    others = [law for law in dict.fromkeys((low, high)) if law != recommended]
    return ", ".join(others) or "the same"


def _three_digits(value: float, unit: str) -> str:
    """Format a quantity with three digits, zeros at its end included."""
    return format_column([value], unit, 3)[0]
