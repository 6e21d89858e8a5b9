"""Results as text: sentences that terminal and page share, and the digests that the commands print.

The sentences stand in `templates/sentences.j2`, of a study; this module has the numbers that they do not find in it.
Numbers are in SI units with three digits and the unit in the text. Sentences have no full stop.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import islice
from textwrap import wrap
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from compact.analysis.engineering_summary import coverage
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.first_laws import RIGID
from compact.analysis.stages.uncertainty import AIR, DRIVE, FED, LAW, MARGIN_SOURCES, MIX
from compact.analysis.stages.verdict import SIZING_PEAKS, Verdict, sizing_model
from compact.analysis.study import Study
from compact.cams.profile import Cam
from compact.machine.drives import INSTRUMENTS
from compact.machine.ranking import CRITERIA, first_of
from compact.material.laws import MEASURED_DENSITY_RATIO
from compact.report.tables import TableSpec, format_column, format_percent
from compact.rolling_contact import Contact, EquilibriumError, HeapingError, UnsteadyError
from compact.scene.schema import Overrides

TEXT_WIDTH = 118  # characters of a line, without its indent
DIGEST_LINES = 36  # [-], of a digest; recommendations and models are never left out
ANSWER = (  # sentences of the answer, of terminal and page, the most important first
    "measurement", "stiffness", "process", "other_cases", "first_laws", "turn", "held", "limits", "spread", "motor",
    "motor_margin", "heaping", "infinite", "not_made", "reachable", "sleeves", "durations", "bearings",
    "valid_formulas",
)  # fmt: skip
FAILURES: dict[type[Exception], str] = {
    HeapingError: "heaps up", UnsteadyError: "not steady", EquilibriumError: "no equilibrium",
}  # fmt: skip
WORTH = 0.05  # [-], of a margin that a measurement of the drive must be worth to be named
ANSWER_CRITERIA = 2  # [-], number of criteria in the answer; the tables have the others
SPACE = re.compile(r"\s+(?=[;,:)])|(?<=\()\s+|(?<=\s)\s+")  # before marks, and more than one


@cache
def _macros() -> Any:
    environment = Environment(
        loader=PackageLoader("compact.report"), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "f": lambda value, spec: format(value, spec),
        "q": lambda value, unit: format_column([value], unit, 3)[0],
        "pct": format_percent,
        "signed": lambda share: "–" if share is None else f"{100 * share:+.0f} %".replace("-", "−"),
        "cell": lambda value: "-" if value is None else f"{value:.5g}",
        "degrees": math.degrees,
    }
    environment.tests["finite"] = math.isfinite
    functions = (
        changed_firsts, coverage, drive_measurements, first_measurement, fitted_inputs, infinite_laws, other_verdicts,
    )  # fmt: skip
    environment.globals |= {each.__name__: each for each in functions}
    environment.globals |= {"CRITERIA": CRITERIA, "AIR": AIR, "DRIVE": DRIVE, "FULL": MEASURED_DENSITY_RATIO}
    return environment.get_template("sentences.j2").module


def sentences(name: str, *facts: Any) -> list[str]:
    """Render the sentences of a macro of `sentences.j2`, most of a study alone; those that do not apply are absent."""
    found = str(getattr(_macros(), name)(*facts)).split("¶")
    return [SPACE.sub("", " ".join(each.split())) for each in found if each.strip()]


def say(name: str, *facts: Any) -> str:
    """Render the first sentence of a macro; empty where it does not apply."""
    return next(iter(sentences(name, *facts)), "")


def lines(name: str, *facts: Any) -> list[str]:
    """Render a macro of lines that are aligned in columns."""
    return [line.rstrip() for line in str(getattr(_macros(), name)(*facts)).splitlines() if line.strip()]


def figures() -> dict[str, tuple[str, str]]:
    """Return description and caption of the figures of the page by name."""
    return dict(_macros().figures)


def plain(text: str) -> str:
    """Return a text without the marks of strong words."""
    return text.replace("**", "")


def answer_sentences(study: Study) -> list[str]:
    """Return the sentences of the answer below the table of models."""
    return [each for name in ANSWER for each in sentences(name, study)]


# numbers of the sentences


def own_verdicts(study: Study) -> dict[str, Verdict]:
    """Return the verdicts at the duration and with the drive of the scene, by criterion."""
    own = study.scene.motion.duration, study.scene.drive.kind
    return {by: each for (*case, by), each in study.verdicts.items() if tuple(case) == own}


def other_verdicts(study: Study) -> dict[tuple[float, str], list[Verdict]]:
    """Return the verdicts at the other durations of a pass, and with a rigid drive, by duration and drive."""
    found: dict[tuple[float, str], list[Verdict]] = {}
    for (duration, drive, _), each in study.verdicts.items():
        if (duration != study.scene.motion.duration) != (drive != study.scene.drive.kind):
            found.setdefault((duration, drive), []).append(each)
    return found


def fitted_inputs(study: Study) -> dict[str, list[str]]:
    """Return the engines of each fitted input, with the words of its comment in the scene."""
    engines: dict[str, list[str]] = {}
    for model in study.models:
        own = study.scene if model is study.models[0] else study.scene.with_engine(model.engine)
        for key in model.fitted:
            table, _, name = key.rpartition(".")
            point = own.remark(table, name).partition("calibrated")[2].lstrip(":, ")
            engines.setdefault(f"{name}, {point}" if point else name, []).append(model.engine)
    return engines


def first_measurement(study: Study) -> dict[str, Any] | None:
    """Return the parameter that should be measured first: its share of the variance, and its effect on the peak."""
    known = study.uncertainty
    if known is None or known.mix is None or not known.peaks:
        return None
    by = next(iter(known.peaks))
    shares, law, remaining = known.mix.shares[by], known.laws[by], known.margin(by, (MIX,))
    name = list(shares)[first_of([-share for share in shares.values()], floor=1.0)]
    words = (Overrides.model_fields[name].description or name) if name != FED else ""
    rest = {each.name: each.changes(law, by)[1] for each in known.sources if each.name in set(MARGIN_SOURCES) - {MIX}}
    largest, source = max(rest, key=rest.__getitem__, default=""), known.source(LAW)
    return {
        "what": f"{words.rsplit(' in ', 1)[0]} (`{name}`)" if words else "the density ratio of the fed mix",
        "share": shares[name], "term": CRITERIA[by].quantity.term, "margin": remaining,
        "ends": sorted(known.peak_change(by, ratio) for ratio in known.mix.alone[name]),
        "rest": largest if largest and rest[largest] > 0.8 * remaining > 0.01 else "",
        "law": (0.0, 0.0) if source is None else source.changes(law, by),
    }  # fmt: skip


def drive_measurements(study: Study) -> list[dict[str, Any]]:
    """Return the quantities of drive and cart that are worth a measurement, the largest gain of margin first.

    A quantity is if at its ends another law is first, or if without its spread a margin is lower by `WORTH`.
    """
    known = study.uncertainty
    source = known.source(DRIVE) if known else None
    if known is None or source is None:
        return []
    found = []
    for name in source.quantities:
        alone = replace(source, ends=source.alone(name))
        margins = {by: (known.margin(by), known.margin(by, known=name)) for by in known.laws}
        margins = {by: each for by, each in margins.items() if each[0] - each[1] > WORTH}
        firsts = dict.fromkeys(law for by in known.laws for law in alone.other_firsts(by, known.laws[by]))
        if margins or firsts:
            found.append(
                {"what": name, "how": INSTRUMENTS.get(name, "by its maker"), "margins": margins, "firsts": [*firsts]}
            )
    return sorted(
        found, key=lambda each: min((after - before for before, after in each["margins"].values()), default=0)
    )


def infinite_laws(orders: Mapping[str, list[Place]]) -> dict[str, list[str]]:
    """Return the laws that no machine can follow by the criteria of the answer, by reason."""
    reasons: dict[str, dict[str, None]] = {}
    for place in (place for order in islice(orders.values(), ANSWER_CRITERIA) for place in order if place.reason):
        reasons.setdefault(place.reason, {})[place.law] = None
    return {reason: list(laws) for reason, laws in reasons.items()}


def changed_firsts(study: Study) -> dict[str, set[str]]:
    """Return the first laws at the ends of the inputs that are others, by input."""
    changed: dict[str, set[str]] = {}
    for shift in study.sensitivities:
        for by in shift.base.law:
            for end in shift.changed_ends(by):
                changed.setdefault(shift.name, set()).add(f"{end.law[by]} by {CRITERIA[by].quantity.term}")
    return changed


# the answer


def recommendations(study: Study) -> list[list[str]]:
    """State the recommended law, its peak and the margin of the drive by each criterion of the verdict.

    Returns
    -------
    list of list of str
        Clauses by criterion, with marks of strong words: law and peaks, what the drive must deliver, agreement of the
        models, and the drives by which the peak changes.
    """
    case, known = (study.scene.motion.duration, study.scene.drive.kind), study.uncertainty
    sizing, own, found = sizing_model(study.models), own_verdicts(study), []
    for by, verdict in own.items():
        order = (by, *(other for other in own if other != by))
        values = {each: sizing.values(*case, each).get(verdict.law) for each in order}
        peaks = {each: value for each, value in values.items() if value is not None}
        margins = {} if known is None else {each: known.margin(each, law=verdict.law) for each in peaks}
        found.append(sentences("recommendation", study, verdict, peaks, margins, sizing))
    return found


def model_table(study: Study) -> TableSpec:
    """Tabulate the models at the duration and with the drive of the scene; engines without a steady state are last."""
    models, duration, kind = study.models, study.scene.motion.duration, study.scene.drive.kind
    columns: dict[str, list[str]] = {"model": [each.engine for each in models]}
    for by in own_verdicts(study):
        firsts = [each.first(duration, kind, by) for each in models]
        columns[f"least {by.replace('_', ' ')}"] = [say("least", each, CRITERIA[by].unit) for each in firsts]
    columns["resistance"] = format_column([each.mean_resistance[duration] for each in models], "N", 3)
    columns["error"] = [say("model_error", each) for each in models]
    columns["laws of the mix"] = [say("model_spread", each) for each in models]
    columns["for sizing?"] = [say("sizing", each.invalid, each.fitted) for each in models]
    for name, failure in study.failures.items():
        told = {"model": name, "resistance": FAILURES[type(failure)]}
        for head, cells in columns.items():
            cells.append(told.get(head, "–"))
    return TableSpec.of_columns(say("models", study), columns)


def first_laws_table(study: Study) -> TableSpec:
    """Tabulate the first laws by model and resistance after a turn, with a rigid and over the elastic drives."""
    found = study.first_laws
    assert found is not None  # of a page with an uncertainty
    springs = len(found.drives) - 1
    columns: dict[str, list[str]] = {
        "model": [each.engine if each.valid else f"{each.engine}, not for sizing" for each in found.cases],
        "fresh mix from the axle": [each.turn for each in found.cases],
    }
    for by in SIZING_PEAKS:
        unit, word = CRITERIA[by].unit, by.rpartition("_")[2]
        columns[f"{word}, rigid"] = [say("first_rigid", *each.first(by, RIGID), unit) for each in found.cases]
        if springs:
            columns[f"{word}, {springs} springs"] = [
                say("first_elastic", *each.elastic(by), unit) for each in found.cases
            ]
    title = "First laws over drive, fresh mix behind the roller, and model; in brackets the number of springs"
    return TableSpec.of_columns(title, columns)


def uncertainty_table(study: Study) -> TableSpec:
    """Tabulate the sources of uncertainty: change of the peaks of the recommended laws, and first laws at the ends."""
    sources = study.uncertainty.sources if study.uncertainty else ()
    columns = {"source": [each.name for each in sources], "variation": [each.variation for each in sources]}
    for by, verdict in own_verdicts(study).items():
        law, term = verdict.law, CRITERIA[by].quantity.term
        columns[term] = [say("changes", each.changes(law, by)) for each in sources]
        others = [each.other_firsts(by, law) for each in sources]
        columns[f"first by {term}"] = [", ".join(each) or "the same" for each in others]
    columns["in the margin?"] = ["yes" if each.name in MARGIN_SOURCES else "no" for each in sources]
    return TableSpec.of_columns("Sources of uncertainty: change of the peaks of the recommended laws", columns)


# the terminal


def study_digest(study: Study) -> str:
    """Summarise a study: recommended laws, models, and the sentences of the answer.

    Returns
    -------
    str
        At most DIGEST_LINES lines of TEXT_WIDTH characters; the last one counts the sentences that do not fit.
    """
    found = [study.scene.title or "untitled scene"]
    for clauses in recommendations(study):
        found += _wrapped(plain("; ".join(clauses)))
    found.append("")
    if study.verdicts:
        cells = model_table(study).cells()
        cells["for sizing?"] = [each.partition(":")[0] for each in cells["for sizing?"]]  # the page has the reasons
        columns = [
            [cell.ljust(max(map(len, column))) for cell in column] for column in ([k, *v] for k, v in cells.items())
        ]
        found += [*(f"  {'  '.join(row).rstrip()}" for row in zip(*columns, strict=True)), ""]
    if not study.stages.contacts.speeds:
        found += _wrapped(say("formula_force", study.stages.contacts.numbers["roller_force"]))
    waiting = [_wrapped(plain(each)) for each in answer_sentences(study)]
    while waiting and len(found) + len(waiting[0]) < DIGEST_LINES:
        found += waiting.pop(0)
    return "\n".join([*found, *(_wrapped(say("more", len(waiting))) if waiting else ())])


def _wrapped(text: str) -> list[str]:
    return [f"  {line}" for line in wrap(text, TEXT_WIDTH)]


def contact_digest(study: Study, speed: float, passes: Sequence[Contact]) -> str:
    """Summarise one contact against the formulas and the exact half-plane, with all its passes.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    """
    band = study.stages.contacts.air_band_of(passes[0], speed)
    found = [*lines("contact", study, speed, passes[0]), *sentences("held", study)]
    found += [*study.scene.replacements[study.scene.accuracy.engine], *sentences("contact_air", *band)]
    return "\n".join([*found, *lines("passes", passes)])


def cam_digest(law: str, cam: Cam) -> str:
    """Summarise the dimensions of one cam."""
    return "\n".join(lines("cam", law, type(cam.follower).__name__, cam, cam.least_breadth()))
