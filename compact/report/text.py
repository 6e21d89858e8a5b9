"""Results as text: sentences that terminal and page share, and the digests that the commands print.

The sentences stand in `templates/sentences.j2`; this module reads the study for them. Numbers are in SI units with the
unit in the text. Sentences have no full stop, and are empty where they do not apply.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import chain
from textwrap import wrap
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from compact.analysis.engineering_summary import coverage
from compact.analysis.sizing.durations import DurationStudy
from compact.analysis.sizing.machine_sizing import MachineSizing
from compact.analysis.sizing.work_balance import WorkBalance
from compact.analysis.stages.comparison import resistances_without_wave
from compact.analysis.stages.laws import COMPLIANT_DRIVES
from compact.analysis.stages.uncertainty import AIR, DRIVE, FED, LAW, MARGIN_SOURCES, MIX, RankingUncertainty
from compact.analysis.stages.verdict import ModelAnswer, Verdict, reason_against, sizing_model
from compact.analysis.study import Study
from compact.cams.profile import Cam
from compact.engines.interface import FLOOR, VISCOELASTIC
from compact.machine.ranking import CRITERIA, first_of
from compact.material.laws import HECKEL_MAX_DENSITY_RATIO
from compact.report.tables import format_column, format_percent, format_quantity
from compact.rolling_contact import Contact
from compact.scene.loader import Scene
from compact.scene.schema import Overrides

TEXT_WIDTH = 118  # characters of a line, without its indent
DIGEST_LINES = 38  # [-]; the digest and the line of the results fit 40 lines
DIGEST_CRITERIA, BEST_LAWS = 2, 3  # [-], criteria in the digest, the first of the scene, and laws of each
NAMED_TIES = 3  # [-], laws of a tie that are named
MODEL_HEADER = (
    "model", "for sizing?", "mean resistance", "coefficient", "discretisation error", "model spread",
    "layer over contact",
)  # fmt: skip
MODEL_NAMES = {"process": "forming process"}  # in the table of the models
SPREAD_WORDS = {"formula": "not stated", "column": "no bow wave"}
PART_OF = re.compile(r" of \w+\)$")  # end of the share of a resistance in another
SHORT_REASONS = {VISCOELASTIC: "part", FLOOR: "floor"}  # in the terminal; a layer otherwise
LEFT_OUT = 2  # [-], last columns of the table of models that the page alone has
SHORT_CELLS = {  # words of the table of models in the terminal
    "discretisation error": "error", "mean resistance": "resistance",
    "least peak drive force": "least peak force", "least peak drive power": "least peak power",
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
    return environment.get_template("sentences.j2").module


def say(name: str, *facts: Any) -> str:
    """Render a macro of `sentences.j2` as one sentence."""
    return SPACE.sub("", " ".join(str(getattr(_macros(), name)(*facts)).split()))


def lines_of(name: str, *facts: Any) -> list[str]:
    """Render a macro of `sentences.j2` line by line, without empty lines."""
    return [line for line in str(getattr(_macros(), name)(*facts)).splitlines() if line.strip()]


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


def _range(low: float, high: float) -> str:
    return _signed(low) if low == high else f"{_signed(low)} to {_signed(high)}"


# the answer


def own_verdicts(study: Study) -> dict[str, Verdict]:
    """Return the verdicts at the duration and with the drive of the scene, by criterion."""
    own = study.scene.motion.duration, study.scene.drive.kind
    return {by: each for (*case, by), each in study.verdicts.items() if tuple(case) == own}


def recommendations(study: Study) -> list[list[str]]:
    """State the recommended law, its peak and the margin of the drive by each criterion of the verdict.

    Returns
    -------
    list of list of str
        Clauses by criterion, with marks of strong words: law and peaks, what the drive must deliver, agreement of the
        models, and the drives by which the peak changes.
    """
    motion, kind, known = study.scene.motion, study.scene.drive.kind, study.uncertainty
    valid, sizing, own = [each for each in study.models if each.valid], sizing_model(study.models), own_verdicts(study)
    by_engine, found = "" if sizing is study.models[0] else f" by {sizing.engine}", []
    heaped = [each for each in study.model_spread.variants if each.heaping] if study.model_spread else []

    def listed(peaks: Mapping[str, float]) -> str:
        return " and ".join(_three_digits(value, CRITERIA[each].unit) for each, value in peaks.items())

    for by, verdict in own.items():
        law, order = verdict.law, (by, *(other for other in own if other != by))
        values = {each: sizing.values(motion.duration, kind, each).get(law) for each in order}
        peaks = {each: value for each, value in values.items() if value is not None}
        margins = {} if known is None else {each: known.margin(each, law=law) for each in peaks}
        required = listed({each: peaks[each] * (1 + margin) for each, margin in margins.items()})
        source, unknown = known and known.source(DRIVE), ""
        if known is not None and source:
            first = known.laws[by]
            low, high = (verdict.value * (1 + change) for change in source.changes(first, by))
            others = source.other_firsts(by, first)
            unknown = say("unknown_drive", low, high, CRITERIA[by].unit, first, source.variation, others)
        found.append(lines_of(
            "recommendation", CRITERIA[by].quantity.term, law, listed(peaks) + by_engine, required,
            list(margins.values()), heaped, agreement(verdict, valid), unknown, "" if valid else sizing.invalid,
        ))  # fmt: skip
    return found


def agreement(verdict: Verdict, valid: Sequence[ModelAnswer]) -> str:
    """State the agreement of the models on rank 1, or the tie; models fitted to one point are one witness."""
    return say("agreement", verdict, len(valid), sum(bool(each.fitted) for each in valid), NAMED_TIES)


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
    duration, drive = duration or study.scene.motion.duration, drive or study.scene.drive.kind
    criteria = [by for (time, kind, by) in study.verdicts if (time, kind) == (duration, drive)]
    lead = sizing_model(study.models)
    rows = [[*MODEL_HEADER[:2], *(f"least {CRITERIA[by].quantity.term}" for by in criteria), *MODEL_HEADER[2:]]]
    forces = format_column([model.mean_resistance[duration] for model in study.models], "N", 3)
    for model, force in zip(study.models, forces, strict=True):
        cells = [MODEL_NAMES.get(model.engine, model.engine)]
        cells.append(("yes" if model.valid else f"no: {model.invalid}") + ("; fitted" if model.fitted else ""))
        for by in criteria:
            first = model.first(duration, drive, by)
            words = f"{first[0].law} {_three_digits(first[0].value, CRITERIA[by].unit)}" if first else "none finite"
            cells.append(words)
        part = model.mean_resistance[duration] / lead.mean_resistance[duration]
        cells.append(force + ("" if model.valid == lead.valid else f" ({format_percent(part)} of {lead.engine})"))
        cells.append(f"{model.coefficient[duration]:.3f}")
        if model.error is None:
            cells.append("closed form" if model.engine == "formula" else "no estimate")
        else:
            cells.append("< 0.1 %" if model.error < 1e-3 else format_percent(model.error))
        if model.spread is None:
            cells.append(SPREAD_WORDS.get(model.engine, "not computed") if model.valid else "–")
        else:
            low, high = (100 * (each - 1) for each in model.spread)
            cells.append(f"{low:+.0f} to {high:+.0f} %".replace("-", "−"))
        rows.append([*cells, "–" if model.height_ratio is None else f"{model.height_ratio:.2g}"])
    without = dict.fromkeys(study.heaping, "heaps up") | dict.fromkeys(study.unsteady, "not steady")
    for name, reason in (without | dict.fromkeys(study.without_equilibrium, "no equilibrium")).items():
        against = reason_against(study.scene.with_engine(name), None)
        rows.append([name, f"no: {against}" if against else "yes", *["–"] * len(criteria), reason, *["–"] * 4])
    return rows


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
    rows = [["source", "variation", *terms, *(f"first by {term}" for term in terms), "in the margin?"]]
    for each in known.sources:
        changes = [_range(*each.changes(law, by)) for by, law in peaks.items()]
        firsts = [
            ", ".join(dict.fromkeys(each.other_firsts(by, law).values())) or "the same" for by, law in peaks.items()
        ]
        rows.append([each.name, each.variation, *changes, *firsts, "yes" if each.name in MARGIN_SOURCES else "no"])
    return rows


def limit_sentences(study: Study) -> list[str]:
    """State what was fitted to what, whether the machine feeds what it presses, and the air."""
    engines: dict[str, list[str]] = {}  # by the fitted input, with the words of its comment
    for model in study.models:
        own = study.scene if model is study.models[0] else study.scene.with_engine(model.engine)
        for key in model.fitted:
            table, _, name = key.rpartition(".")
            point = own.remark(table, name).partition("calibrated")[2].lstrip(":, ")
            engines.setdefault(f"{name}, {point}" if point else name, []).append(model.engine)
    fitted = "; ".join(f"{' and '.join(names)}: {each}" for each, names in engines.items())
    air = study.uncertainty.source(AIR) if study.uncertainty else None
    found = [
        say("fitted", fitted, sum(bool(model.fitted) for model in study.models)), study.scene.mix.fit_remark or "",
        *work_warnings(study.work_balance), say("air_margin", air),
    ]  # fmt: skip
    return [sentence for sentence in found if sentence]


def duration_lines(study: Study) -> list[str]:
    """State the recommended laws at the other durations of a pass, and with a rigid drive."""
    motion, kind, found = study.scene.motion, study.scene.drive.kind, []
    for duration, drive in dict.fromkeys((duration, drive) for duration, drive, _ in study.verdicts):
        if (duration, drive) == (motion.duration, kind) or (drive != kind and duration != motion.duration):
            continue
        laws = [
            (each, _three_digits(each.value, CRITERIA[by].unit), each.contenders[1 : 1 + NAMED_TIES])
            for (*case, by), each in study.verdicts.items() if case == [duration, drive]
        ]  # fmt: skip
        found.append(say("other_case", duration, "" if drive == kind else drive, laws))
    return found


def stiffness_sentence(study: Study) -> str:
    """State the peaks of the recommended laws for a mix that is twice as stiff."""
    known = study.uncertainty
    if known is None or known.mix is None or not math.isfinite(known.mix.twice_as_stiff):
        return ""
    ratio = known.mix.twice_as_stiff
    return say("stiffness", ratio, {CRITERIA[by].quantity.term: known.peak_change(by, ratio) for by in known.peaks})


def measurement_sentence(study: Study) -> str:
    """State which parameter should be measured first, with its share of the variance and its effect on the peak."""
    known = study.uncertainty
    if known is None or known.mix is None or not known.peaks:
        return ""
    by = next(iter(known.peaks))
    shares, law, remaining = known.mix.shares[by], known.laws[by], known.margin(by, (MIX,))
    name = list(shares)[first_of([-share for share in shares.values()], floor=1.0)]
    ends = sorted(known.peak_change(by, ratio) for ratio in known.mix.alone[name])
    words = (Overrides.model_fields[name].description or name) if name != FED else ""
    what = f"{words.rsplit(' in ', 1)[0]} (`{name}`)" if words else "the density ratio of the fed mix"
    rest = {each.name: each.changes(law, by)[1] for each in known.sources if each.name in set(MARGIN_SOURCES) - {MIX}}
    largest = max(rest, key=rest.__getitem__, default="")
    largest = largest if largest and rest[largest] > 0.8 * remaining > 0.01 else ""
    source = known.source(LAW)
    change = (0.0, 0.0) if source is None else source.changes(law, by)
    loose = f"{_signed(change[0])} to {_signed(change[1])}" if max(map(abs, change)) > 0.01 else ""
    return say("measurement", what, shares[name], CRITERIA[by].quantity.term, ends, remaining, largest, loose)


# the contact


def held_sentence(study: Study) -> str:
    """State the quantity of the contact that is constant over speed, and the target at which it was determined."""
    held, scene = study.stages.contacts.held, study.scene
    if held is None:
        return ""
    compacting = study.stages.contacts.compacts
    target = say("target", scene.target, compacting, scene.mix, study.mix.required_pressure)
    return say("held", held, scene.machine.roller_length, target)


def sleeve_sentence(study: Study) -> str:
    """State the part of the feed sleeves in the resistance of a forming process, which follows from an assumed head."""
    return say("sleeves", study.stages.contacts.sleeve_drag)


def heaping_sentences(study: Study) -> list[str]:
    """State each engine of the comparison without a steady state: mix heaps up, no steady motion, no equilibrium."""
    return [
        *(say("heaping", name, error.heaping) for name, error in study.heaping.items()),
        *(say("unsteady", name, error.unsteady) for name, error in study.unsteady.items()),
        *(say("no_equilibrium", name) for name in study.without_equilibrium),
    ]


def other_resistances(scene: Scene) -> str:
    """State the resistance by the engines that have one where the mix heaps up, and the option that ranks by it."""
    return say("other_resistances", resistances_without_wave(scene))


def return_sentence(study: Study) -> str:
    """State the mix under the return stroke, with the energy per cycle where both states are computed."""
    stage, drive = study.stages.contacts, study.stages.drive
    strokes = stage.process is not None
    ratios = stage.return_ratios if strokes else None
    over, law = study.scene.layer.return_stroke, drive.best_law if drive.cycle_energies else ""
    return say("return_stroke", over, stage.second_pass, drive.cycle_energies, law, strokes, ratios, bool(stage.speeds))


def air_sentence(study: Study) -> str:
    """State the part of the pore air in load and resistance, the de-aeration speed and the tension behind."""
    contacts = study.stages.contacts
    if not contacts.compacts:
        return ""
    if contacts.process is not None:
        found = None if contacts.process.pore_air is None else contacts.process.two_dimensions
        return say("air_of_process", found, contacts.has_air)
    return say("air", study.pore_air, study.scene.mix.pore_air, contacts.engine.name)


def spread_sentence(study: Study) -> str:
    """State the spread of load and resistance over the laws of the mix; empty for an engine without compaction."""
    engine, spread = study.stages.contacts.engine, study.model_spread
    if not study.stages.contacts.compacts:
        return ""
    variants = spread.variants if spread else ()
    heaped = [each for each in variants if each.heaping is not None]
    failed = [each for each in variants if each.load is None and each.heaping is None]
    return say("spread", spread, engine.name, heaped, failed)


def guide_sentence(study: Study) -> str:
    """State the drive force at the mean speed, its guide friction, and the value of eq 1.9."""
    steady, friction = study.stages.resistance.steady, study.scene.machine.guide_friction
    forces = float(steady.drive_force[0]), float(steady.guide_friction[0])
    return say("guides", *forces, friction, study.stages.contacts.engineering)


# the machine


def work_sentence(study: Study) -> str:
    """State the work of a pass and of confined compression, and the mix pressed against the mix carried away."""
    return say("work", study.work_balance)


def work_warnings(balance: WorkBalance) -> list[str]:
    """State the balances that do not fit."""
    return [sentence for name in ("viscoelastic", "feed") if (sentence := say(name, balance))]


def motor_sentence(sizing: MachineSizing) -> str:
    """State the torque of the shaft under the first law, the required rated power and the motor of the catalogue."""
    return say("motor", sizing.first, sizing.rule)


def margin_sentence(study: Study) -> str:
    """State that the margin of the motor is below that of models and mix on the peak power; empty where it is not."""
    known, margin = study.uncertainty, study.machine_sizing.rule.margin
    if known is None or study.machine_sizing.first is None or "peak_power" not in known.peaks:
        return ""
    required = 1 + known.margin("peak_power")
    if margin >= required or math.isnan(required):
        return ""
    covering = math.ceil(100 * required) / 100 if math.isfinite(required) else None
    return say("motor_margin", margin, required, covering)


def bearing_sentence(sizing: MachineSizing) -> str:
    """State the lives of the bearings; empty without ratings in the scene."""
    return say("bearings", sizing.first_law, sizing.lives)


def duration_sentence(found: DurationStudy) -> str:
    """State the first laws over the duration."""
    return say("durations", found, {CRITERIA[by].quantity.term: found.segments(by) for by in found.orders})


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
    waiting = [found for sentence in _digest_sentences(study) if (found := _wrapped(sentence))]
    while waiting and len(lines) + len(waiting[0]) < DIGEST_LINES:
        lines += waiting.pop(0)
    if waiting:
        lines.append(f"  {len(waiting)} more in report.html and summary.json")
    return "\n".join(lines)


def _digest_sentences(study: Study) -> Iterator[str]:
    """List the sentences of the digest, the most important first; some are empty."""
    yield from limit_sentences(study)
    yield from duration_lines(study)
    yield from (stiffness_sentence(study), measurement_sentence(study), spread_sentence(study))
    yield from (motor_sentence(study.machine_sizing), margin_sentence(study))
    yield from heaping_sentences(study)
    yield from (f"not made: {name}: {reason}" for name, reason in study.stages.laws.not_made.items())
    yield from (study.mix.density_achievable.reason, held_sentence(study), sleeve_sentence(study))
    yield from (return_sentence(study), air_sentence(study))
    yield "" if study.over_durations is None else duration_sentence(study.over_durations)
    kind, engine = study.scene.drive.kind, study.scene.accuracy.engine
    for by, order in list(study.stages.drive.places[kind].items())[:DIGEST_CRITERIA]:
        amplified = kind in COMPLIANT_DRIVES
        ratios = [getattr(study.runs.get(place.law), "dynamic_amplification", math.nan) for place in order[:BEST_LAWS]]
        shown = [ratio if amplified and math.isfinite(ratio) else None for ratio in ratios]
        laws = list(zip(order, shown, strict=False))
        yield say("best_laws", CRITERIA[by].quantity.term, CRITERIA[by].unit, engine, kind, laws)
    yield guide_sentence(study).partition("; for comparison")[0]
    yield from (coverage(study.scene, study.stages.contacts.engineering), bearing_sentence(study.machine_sizing))
    yield work_sentence(study)
    fits = study.scene.mix.fit_remark
    yield from (each for each in chain(*study.scene.replacements.values()) if not fits or fits not in each)


def _wrapped(text: str) -> list[str]:
    return [f"  {line}" for line in wrap(text, TEXT_WIDTH)]


def _model_lines(study: Study) -> Iterator[str]:
    """List the models in columns of equal width; the page has the reasons in full."""
    table = []
    for name, validity, *cells in model_table(study):
        valid, _, fitted = validity.partition("; ")
        if valid.startswith("no: "):
            valid = f"no ({SHORT_REASONS.get(valid[4:], 'layer')})"
        row = [name, f"{valid}, {fitted}" if fitted else valid, *cells][:-LEFT_OUT]
        table.append([PART_OF.sub(")", SHORT_CELLS.get(cell, cell)) for cell in row])
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        yield "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


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
    lines = [f"{'at ' + format(speed, 'g') + ' m/s':<20}{engine:>12}{'eqs 1.5-1.8':>14}{'Galin':>12}"]
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
        lines += lines_of("contact", found, HECKEL_MAX_DENSITY_RATIO)
    air = say("contact_air", stage.air_forces_of(found, speed))
    lines += [each for each in (held_sentence(study), *study.scene.replacements[engine], air) if each]
    if len(passes) > 1:
        lines += ["", "pass   load [N/m]   resistance [N/m]   exit height [mm]   density ratio"]
    for number, each in enumerate(passes if len(passes) > 1 else (), start=1):
        against: Any = each  # the resistance is positive against the travel of either direction
        force = against.resistance if number % 2 else -against.resistance
        compacted = f"{against.exit_height * 1e3:>19.2f}{against.exit_density_ratio:>16.4f}"
        lines.append(f"{number:>4}{against.load:>13.5g}{force:>19.4g}{compacted}")
    return "\n".join(lines)


def cam_digest(law: str, cam: Cam) -> str:
    """Summarise the dimensions of one cam."""
    return "\n".join(lines_of("cam", law, type(cam.follower).__name__, cam, cam.least_breadth()))
