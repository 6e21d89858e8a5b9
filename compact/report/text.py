"""Results as text: sentences that terminal and page share, and the digests that the commands print.

The sentences stand in `templates/sentences.j2`, of a study; this module has the numbers that they do not find in it.
Numbers are in SI units with three digits and the unit in the text. Sentences have no full stop.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import islice
from textwrap import wrap
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from compact.analysis.engineering_summary import coverage
from compact.analysis.sizing.decision import measurements
from compact.analysis.stages import robust_range, uncertainty
from compact.analysis.stages.drives import Place
from compact.analysis.stages.verdict import Verdict
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.material.laws import MEASURED_DENSITY_RATIO
from compact.report.tables import TableSpec, format_column, format_percent
from compact.rolling_contact import Contact, EquilibriumError, HeapingError, UnsteadyError

TEXT_WIDTH = 118  # characters of a line, without its indent
DIGEST_LINES = 20  # [-], of a digest
ANSWER = (  # sentences of the answer, of terminal and page, the most important first
    "cam_fit", "unknown_drive", "other_models", "fitted", "feed", "measure", "infinite", "heaping", "process",
    "not_made", "reachable", "durations", "valid_formulas",
)  # fmt: skip
FAILURES: dict[type[Exception], str] = {
    HeapingError: "heaps up", UnsteadyError: "not steady", EquilibriumError: "no equilibrium",
}  # fmt: skip
SIZED = "peak_force", "peak_power", "shaft_torque", "motor_rating", "roller_load"  # columns of the decision
ANSWER_CRITERIA = 2  # [-], number of criteria in the answer; the tables have the others
SPACE = re.compile(r"\s+(?=[;,:)])|(?<=\()\s+|(?<=\s)\s+")  # before marks, and more than one


@cache
def templates() -> Environment:
    """Return the templates of sentences and page, with their filters."""
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
    functions = coverage, fitted_inputs, infinite_laws, measurements, robust_range.missing_for_pool, other_verdicts
    environment.globals |= {each.__name__: each for each in functions}
    environment.globals |= {"CRITERIA": CRITERIA, "DRIVE": uncertainty.DRIVE, "FULL": MEASURED_DENSITY_RATIO}
    return environment


@cache
def _macros() -> Any:
    return templates().get_template("sentences.j2").module


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


def answer_sentences(study: Study) -> list[str]:
    """Return the sentences of the answer below the table of models."""
    return [each for name in ANSWER for each in sentences(name, study)]


# numbers of the sentences


def other_verdicts(study: Study) -> dict[tuple[float, str], list[Verdict]]:
    """Return the verdicts at the other durations of a pass, and with a rigid drive, by duration and drive."""
    found: dict[tuple[float, str], list[Verdict]] = {}
    for (duration, drive, _), each in study.verdicts.items():
        if (duration != study.scene.motion.duration) != (drive != study.scene.drive.kind):
            found.setdefault((duration, drive), []).append(each)
    return found


def fitted_inputs(study: Study) -> list[str]:
    """Return the fitted inputs of all models by name."""
    return list(dict.fromkeys(key.rpartition(".")[2] for model in study.models for key in model.fitted))


def infinite_laws(orders: Mapping[str, list[Place]]) -> dict[str, list[str]]:
    """Return the laws that no machine can follow by the criteria of the answer, by reason."""
    reasons: dict[str, dict[str, None]] = {}
    for place in (place for order in islice(orders.values(), ANSWER_CRITERIA) for place in order if place.reason):
        reasons.setdefault(place.reason, {})[place.law] = None
    return {reason: list(laws) for reason, laws in reasons.items()}


# the answer


def decision_table(study: Study) -> TableSpec:
    """Tabulate the sizes with the decided law: value, range and margin, and the upper end by the alternative."""
    found = study.decision
    assert found is not None  # of a study with a decision
    known = ["range", "margin"] if any(size.changes for size in found.sizes.values()) else []
    columns = {"law": [found.law, *known, *([f"or {found.alternative}"] if found.alternative else [])]}
    for key in (key for key in SIZED if key in found.sizes):
        size, other = found.sizes[key], found.other_sizes.get(key)
        more = f"{say('top', other)} {say('change', other.high / size.high - 1)}" if other else ""
        spread = [say("band", size), format_percent(size.margin)] if known else []
        columns[key.replace("_", " ")] = [say("size", size), *spread, more][: len(columns["law"])]
    return TableSpec.of_columns(say("decision", study), columns)


def model_table(study: Study) -> TableSpec:
    """Tabulate the models at the duration and with the drive of the scene; engines without a steady state are last."""
    models, duration, kind = study.models, study.scene.motion.duration, study.scene.drive.kind
    forces = [format_column([each.mean_resistance[duration]], "N", 3)[0] for each in models]
    priors = [format_column([each.prior and each.prior[1]], "N", 3)[0] for each in models]
    fits = [bool(each.fitted) for each in models]
    columns: dict[str, list[str]] = {"model": [each.engine for each in models]}
    if any(fits):
        columns["fitted"] = [force if fit else "–" for force, fit in zip(forces, fits, strict=True)]
    columns["prior"] = [prior if fit else force for force, prior, fit in zip(forces, priors, fits, strict=True)]
    for by in study.sizing_peaks:
        firsts = [each.first(duration, kind, by) for each in models]
        columns[f"first by {by.rpartition('_')[2]}"] = [say("least", each, CRITERIA[by].unit) for each in firsts]
    *before, last = columns.items()
    columns = dict([*before, ("for sizing?", [say("sizing", each) for each in models]), last])
    for name, failure in study.failures.items():
        told = {"model": name, "for sizing?": f"no, {FAILURES[type(failure)]}"}
        for head, cells in columns.items():
            cells.append(told.get(head, "–"))
    return TableSpec.of_columns("Resistance of a cart and first laws by every model", columns)


def measurement_table(study: Study) -> TableSpec:
    """Tabulate what may be measured, how, what to expect, and the margins that remain."""
    found = measurements(study)
    names = {"quantity": "what", "instrument": "how", "procedure": "procedure", "expected": "", "cost": "cost"}
    columns = {head: [each.get(name) or say("band", each["range"]) for each in found] for head, name in names.items()}
    for by, before in found[0]["before"].items() if found else ():
        head = f"margin of {by.rpartition('_')[2]}, {format_percent(before)} today"
        columns[head] = [format_percent(each["after"][by]) for each in found]
    return TableSpec.of_columns("What to measure first, and the margin that remains", columns)


def uncertainty_tables(study: Study) -> Iterator[TableSpec]:
    """Tabulate what to measure first, and the sources of uncertainty: changes of the peaks of the decided law."""
    known, law = study.uncertainty, study.choice.law if study.choice else ""
    if known is None or not known.sources:
        return
    yield measurement_table(study)
    columns = {"source": [each.name for each in known.sources], "variation": [each.variation for each in known.sources]}
    for by in known.laws:
        columns[CRITERIA[by].quantity.term] = [say("changes", each.changes(law, by)) for each in known.sources]
    yield TableSpec.of_columns(f"Sources of uncertainty: change of the peaks of {law}", columns)


# the terminal


def study_digest(study: Study) -> str:
    """Summarise a study: the decision, the models, and the sentences of the answer.

    Returns
    -------
    str
        At most DIGEST_LINES lines of TEXT_WIDTH characters; the last one counts the sentences that do not fit.
    """
    found = [study.scene.title or "untitled scene"]
    if study.decision:
        found += _wrapped(say("recommended", study)) + _rows(decision_table(study)) + _rows(model_table(study))
    waiting = [_wrapped(each) for each in answer_sentences(study)]
    while waiting and len(found) + len(waiting[0]) + (len(waiting) > 1) <= DIGEST_LINES:
        found += waiting.pop(0)
    return "\n".join([*found, *([f"  {len(waiting)} more in report.html and summary.json"] if waiting else [])])


def _rows(table: TableSpec) -> list[str]:
    """Return the rows of a table in columns of text; the last columns are left out where a line is too long."""
    columns = [[cell.ljust(max(map(len, column))) for cell in column]
               for column in ([head, *cells] for head, cells in table.cells().items())]  # fmt: skip
    while len("  ".join(column[0] for column in columns)) > TEXT_WIDTH:
        columns.pop()
    return [f"  {'  '.join(row).rstrip()}" for row in zip(*columns, strict=True)]


def _wrapped(text: str) -> list[str]:
    """Return a text without the marks of strong words in lines."""
    return [f"  {line}" for line in wrap(text.replace("**", ""), TEXT_WIDTH)]


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
