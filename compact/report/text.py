"""Results as text: sentences that terminal and page share, and the digests that the commands print.

The sentences stand in `templates/sentences.j2`, of a study; this module has the numbers that they do not find in it.
Numbers are in SI units with the unit in the text. Sentences have no full stop.
"""

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import islice
from textwrap import wrap
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from compact.analysis.engineering_summary import coverage
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.sensitivity import Shift
from compact.analysis.stages.uncertainty import AIR, DRIVE, FED, LAW, MARGIN_SOURCES, MIX, RankingUncertainty
from compact.analysis.stages.verdict import Verdict, reason_against, resistances_without_wave, sizing_model
from compact.analysis.study import Study
from compact.cams.profile import Cam
from compact.engines.interface import FLOOR, VISCOELASTIC
from compact.machine.ranking import CRITERIA, first_of
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO
from compact.report.tables import Mark, format_column, format_percent, format_quantity
from compact.rolling_contact import Contact
from compact.scene.loader import Scene
from compact.scene.schema import Overrides

TEXT_WIDTH = 118  # characters of a line, without its indent
DIGEST_LINES = 38  # [-]; the digest and the line of the results fit 40 lines
DIGEST = (  # sentences of the terminal, the most important first
    "limits", "other_cases", "stiffness", "measurement", "spread", "motor", "motor_margin", "heaping", "not_made",
    "reachable", "held", "sleeves", "return_stroke", "air", "durations", "best_laws", "guides", "valid_formulas",
    "bearings", "work", "replaced",
)  # fmt: skip
ANSWER_CRITERIA = 2  # [-], number of criteria in the answer; the tables have the others
SIGNS = (  # kind of mark and first words of a clause of a remark
    ("assumed", ("assumed", "guess", "changed by the caller")), ("known", ("published", "measured", "calibrated")),
)  # fmt: skip
NOT_INPUTS = ("title", "unusual", "output")  # of a scene
SPREAD_WORDS = {"formula": "not stated", "column": "no bow wave"}
LEFT_OUT = 2  # [-], last columns of the table of models that the page alone has
SHORT_CELLS = {  # words of the table of models in the terminal, which the page has in full
    re.escape(f"no: {VISCOELASTIC}"): "no (part)", re.escape(f"no: {FLOOR}"): "no (floor)",
    "no: [^;]*": "no (layer)", "; fitted": ", fitted", "^discretisation error": "error",
    "^mean resistance": "resistance", "^least peak drive": "least peak", r" of \w+\)$": ")",
}  # fmt: skip
SPACE = re.compile(r"\s+(?=[;,:)])|(?<=\()\s+|(?<=\s)\s+")  # before marks, and more than one


@cache
def _macros() -> Any:
    environment = Environment(
        loader=PackageLoader("compact.report"), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "f": lambda value, spec: format(value, spec),
        "q": lambda value, unit, digits=3: format_quantity(value, unit, digits),
        "q3": _three_digits,
        "pct": format_percent,
        "signed": _signed,
        "degrees": math.degrees,
        "some": lambda value: "no" if value is None else f"{value:.2g}",
        "work": lambda value: "–" if value is None else f"{value / 1e3:.3g} kJ/m³",
        "hours": lambda value: "infinite" if math.isinf(value) else f"{float(f'{value:.2g}'):.0f} h",
    }
    environment.tests |= {"finite": math.isfinite, "all_true": all}
    functions = (
        assumed_inputs, changed_firsts, coverage, first_criteria, first_measurement, fitted_inputs,
        infinite_laws, methods, other_verdicts,
    )  # fmt: skip
    environment.globals |= {each.__name__: each for each in functions}
    environment.globals |= {"CRITERIA": CRITERIA, "AIR": AIR, "DRIVE": DRIVE, "FULL": HECKEL_MAX_DENSITY_RATIO}
    return environment.get_template("sentences.j2").module


def sentences(name: str, *facts: Any) -> list[str]:
    """Render the sentences of a macro of `sentences.j2`, most of a study alone; those that do not apply are absent."""
    found = str(getattr(_macros(), name)(*facts)).split("¶")
    return [SPACE.sub("", " ".join(each.split())) for each in found if each.strip()]


def say(name: str, *facts: Any) -> str:
    """Render the first sentence of a macro; empty where it does not apply."""
    return next(iter(sentences(name, *facts)), "")


def figures() -> dict[str, dict[str, tuple[str, str]]]:
    """Return description and caption of the figures of the page, by section and name."""
    return dict(_macros().figures)


def plain(text: str) -> str:
    """Return a text without the marks of strong words."""
    return text.replace("**", "")


def _three_digits(value: float, unit: str) -> str:
    """Format a quantity with three digits, zeros at its end included."""
    return format_column([value], unit, 3)[0]


def _signed(share: float) -> str:
    return f"{100 * share:+.0f} %".replace("-", "−")


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


def first_criteria(orders: Mapping[str, list[Place]]) -> dict[str, list[Place]]:
    """Return the rankings by the criteria of the answer."""
    return dict(islice(orders.items(), ANSWER_CRITERIA))


def infinite_laws(orders: Mapping[str, list[Place]]) -> dict[str, list[str]]:
    """Return the laws that no machine can follow, by reason."""
    reasons: dict[str, dict[str, None]] = {}
    for place in (place for order in orders.values() for place in order if place.reason):
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


def methods(shifts: Sequence[Shift]) -> str:
    """Name the means by which the ends of the inputs were computed."""
    found = dict.fromkeys("formula" if shift.by == "formula" else f"the engine {shift.by}" for shift in shifts)
    return f"By {' or '.join(found) or 'formula'}"


def remark(scene: Scene, table: str, key: str) -> str | Mark:
    """Mark the clause of a comment that states the origin of a value."""
    clauses = [clause.strip() for clause in scene.remark(table, key).split(";")]
    for kind, signs in SIGNS:
        for sign in signs:
            origin = next((clause for clause in clauses if clause.startswith(sign)), None)
            if origin is not None:
                rest = [origin.removeprefix(sign).strip(" :,"), *(clause for clause in clauses if clause != origin)]
                return Mark(kind, sign, "; ".join(filter(None, rest)))
    return "; ".join(clauses)


def assumed_inputs(scene: Scene) -> int:
    """Count the inputs of a scene whose comments state an assumption or a change."""
    shown = {name: getattr(scene, name) for name in type(scene).model_fields if name not in NOT_INPUTS}
    given = [
        (table, key)
        for table, part in shown.items()
        for key in (type(part).model_fields if part is not None else ())
        if getattr(part, key) is not None
    ]
    return sum(getattr(remark(scene, *each), "kind", "") == "assumed" for each in given)


def other_resistances(scene: Scene) -> str:
    """State the resistance by the engines that have one where the mix heaps up, and the option that ranks by it."""
    return say("other_resistances", resistances_without_wave(scene))


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


def model_table(study: Study, duration: float | None = None, drive: str | None = None) -> dict[str, list[str]]:
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
    dict
        Cells of each column by its head; linear engines are marked as not for sizing. Engines without a steady state
        are last.
    """
    duration, drive = duration or study.scene.motion.duration, drive or study.scene.drive.kind
    models, lead = study.models, sizing_model(study.models)
    criteria = [by for (time, kind, by) in study.verdicts if (time, kind) == (duration, drive)]
    columns = {"model": ["forming process" if each.engine == "process" else each.engine for each in models]}
    columns["for sizing?"] = [
        ("yes" if each.valid else f"no: {each.invalid}") + ("; fitted" if each.fitted else "") for each in models
    ]
    for by in criteria:
        firsts = [each.first(duration, drive, by) for each in models]
        cells = [f"{each[0].law} {_three_digits(each[0].value, CRITERIA[by].unit)}" if each else "" for each in firsts]
        columns[f"least {CRITERIA[by].quantity.term}"] = [cell or "none finite" for cell in cells]
    forces = [each.mean_resistance[duration] for each in models]
    parts = [f" ({format_percent(force / lead.mean_resistance[duration])} of {lead.engine})" for force in forces]
    shown = zip(models, format_column(forces, "N", 3), parts, strict=True)
    columns["mean resistance"] = [force + ("" if each.valid == lead.valid else part) for each, force, part in shown]
    columns["coefficient"] = [f"{each.coefficient[duration]:.3f}" for each in models]
    columns["discretisation error"], columns["model spread"] = [], []
    for each in models:
        error = "closed form" if each.engine == "formula" else "no estimate"
        if each.error is not None:
            error = "< 0.1 %" if each.error < 1e-3 else format_percent(each.error)
        spread = SPREAD_WORDS.get(each.engine, "not computed") if each.valid else "–"
        if each.spread is not None:
            spread = "{:+.0f} to {:+.0f} %".format(*(100 * (end - 1) for end in each.spread)).replace("-", "−")
        columns["discretisation error"].append(error)
        columns["model spread"].append(spread)
    columns["layer over contact"] = [
        "–" if each.height_ratio is None else f"{each.height_ratio:.2g}" for each in models
    ]
    without = dict.fromkeys(study.heaping, "heaps up") | dict.fromkeys(study.unsteady, "not steady")
    for name, reason in (without | dict.fromkeys(study.without_equilibrium, "no equilibrium")).items():
        against = reason_against(study.scene.with_engine(name), None)
        told = {"model": name, "for sizing?": f"no: {against}" if against else "yes", "mean resistance": reason}
        for head, cells in columns.items():
            cells.append(told.get(head, "–"))
    return columns


def uncertainty_table(known: RankingUncertainty, peaks: Mapping[str, str]) -> dict[str, list[str]]:
    """Tabulate the sources of uncertainty: variation, change of the peaks, and first laws at the ends.

    Parameters
    ----------
    peaks : mapping of str to str
        Recommended law by criterion.

    Returns
    -------
    dict
        Cells of each column by its head.
    """
    sources, columns = known.sources, dict[str, list[str]]()
    columns["source"], columns["variation"] = [each.name for each in sources], [each.variation for each in sources]
    for by, law in peaks.items():
        ends = [dict.fromkeys(map(_signed, each.changes(law, by))) for each in sources]
        columns[CRITERIA[by].quantity.term] = [" to ".join(each) for each in ends]
    for by, law in peaks.items():
        others = [dict.fromkeys(each.other_firsts(by, law).values()) for each in sources]
        columns[f"first by {CRITERIA[by].quantity.term}"] = [", ".join(each) or "the same" for each in others]
    columns["in the margin?"] = ["yes" if each.name in MARGIN_SOURCES else "no" for each in sources]
    return columns


# the terminal


def study_digest(study: Study) -> str:
    """Summarise a study: recommended laws, models, further questions, contact, and the best laws.

    Returns
    -------
    str
        At most DIGEST_LINES lines of TEXT_WIDTH characters; the last one counts the sentences that do not fit.
    """
    lines = [study.scene.title or "untitled scene"]
    for clauses in recommendations(study):
        lines += _wrapped(plain("; ".join(clauses)))
    lines += ["", *_model_lines(study), ""] if study.verdicts else [""]
    if not study.stages.contacts.speeds:
        number = study.stages.contacts.numbers["roller_force"]
        high = "beyond the range of the formulas" if number.high is None else f"{number.high:.4g}"
        spread = "" if number.low is None else f"   {number.low:.4g} to {high} over the spread of the mix"
        lines.append(f"  {'roller force':<24}{number.value:>10.4g} {number.unit:<4}{spread}")
    waiting = [_wrapped(sentence) for name in DIGEST for sentence in sentences(name, study)]
    while waiting and len(lines) + len(waiting[0]) < DIGEST_LINES:
        lines += waiting.pop(0)
    if waiting:
        lines.append(f"  {len(waiting)} more in report.html and summary.json")
    return "\n".join(lines)


def _wrapped(text: str) -> list[str]:
    return [f"  {line}" for line in wrap(text, TEXT_WIDTH)]


def _model_lines(study: Study) -> list[str]:
    """List the models in columns of equal width; the page has the reasons in full."""
    columns = []
    for head, cells in list(model_table(study).items())[:-LEFT_OUT]:
        column = [head, *cells]
        for words, short in SHORT_CELLS.items():
            column = [re.sub(words, short, cell) for cell in column]
        columns.append([cell.ljust(max(map(len, column))) for cell in column])
    return ["  " + "  ".join(row).rstrip() for row in zip(*columns, strict=True)]


def contact_digest(study: Study, speed: float, passes: Sequence[Contact]) -> str:
    """Summarise one contact against the formulas and the exact half-plane, with all its passes.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    """
    found: Any = passes[0]
    stage, engine, machine = study.stages.contacts, study.scene.accuracy.engine, study.scene.machine
    formulas, exact, length = stage.engineering, stage.exact, machine.roller_length
    resistance, leading = formulas.roller_resistance, machine.roller_radius * np.sin(formulas.capture_angle)
    lines = [f"{f'at {speed:g} m/s':<20}{engine:>12}{'eqs 1.5-1.8':>14}{'Galin':>12}"]
    for name, *values in (
        ("load [N/m]", found.load, formulas.roller_force / length, exact.load),
        ("  a roller [N]", found.load * length, formulas.roller_force, exact.load * length),
        ("resistance [N/m]", found.resistance, resistance / length, np.nan),
        ("  a roller [N]", found.resistance * length, resistance, np.nan),
        ("resistance/load", found.resistance / found.load, formulas.resistance_coefficient, np.nan),
        ("contact length [m]", found.leading - found.trailing, formulas.contact_length, exact.contact_length),
        ("leading edge [m]", found.leading, leading, exact.leading),
        ("peak pressure [Pa]", found.peak_pressure, formulas.pressure, exact.peak_pressure),
    ):
        computed, formula, galin = (f"{value:.5g}" if np.isfinite(value) else "-" for value in values)
        lines.append(f"{name:<20}{computed:>12}{formula:>14}{galin:>12}")
    lines.append(f"a roller is {length:g} m long, the cart has {machine.rollers}")
    if found.error:
        lines += sentences("contact", found)
    lines += [*sentences("held", study), *study.scene.replacements[engine]]
    lines += sentences("contact_air", stage.air_forces_of(found, speed))
    if len(passes) > 1:
        lines += ["", "pass   load [N/m]   resistance [N/m]   exit height [mm]   density ratio"]
        for number, each in enumerate(passes, start=1):  # the resistance is positive against either direction
            force = each.resistance if number % 2 else -each.resistance
            compacted = f"{each.exit_height * 1e3:>19.2f}{each.exit_density_ratio:>16.4f}"
            lines.append(f"{number:>4}{each.load:>13.5g}{force:>19.4g}{compacted}")
    return "\n".join(lines)


def cam_digest(law: str, cam: Cam) -> str:
    """Summarise the dimensions of one cam."""
    return str(_macros().cam(law, type(cam.follower).__name__, cam, cam.least_breadth())).strip()
