"""The HTML page of a study, `report.html`: the answer, its uncertainty, and all results in sections.

The page is one file without external resources: style, script and pictures are embedded. All text is escaped; text
between backticks is set as code, between asterisks strong. Tables are those of `report.results`, sentences those of
`report.text`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from itertools import chain, permutations
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.balance_checks import BalanceCheck
from compact.analysis.study import Study
from compact.files import atomic_file
from compact.machine.ranking import CRITERIA
from compact.report import sections, text
from compact.report.sections import Block, Mark, Table, as_sentence, figures_of, methods, term_of
from compact.report.tables import (
    format_quantity,
)
from compact.report.text import say

UNIT_SPACE = re.compile(r"(?<=\d) (?=(?:%|[GMkmµ]?(?:N|W|J|Pa|m|s|g|rad|Nm))(?:[/²³<,.;: )\n]|$))")
ANSWER_CRITERIA = 2  # [-], number of criteria in the answer; the tables have the others
CONTACT_MODELS = {
    "formula": "the engineering formulas 1.1–1.10",
    "column": "confined-compression columns with irreversible compaction",
    "spectral": "an elastic or viscoelastic layer on its base, solved in Fourier space",
    "fem": "an elastic or viscoelastic layer by finite elements",
    "compaction": "a layer with irreversible compaction by finite elements",
    "process": "all strokes of the forming process, with feed before each and a moving mould",
}


@cache
def _template() -> Any:
    environment = Environment(
        loader=PackageLoader("compact.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {
        "inline": _inline,
        "units": lambda html: Markup(UNIT_SPACE.sub("\u00a0", str(html))),  # a number and its unit stay on one line
        "sentence": as_sentence,
    }
    environment.tests["mark"] = lambda cell: isinstance(cell, Mark)
    return environment.get_template("page.html.j2")


def _inline(words: str) -> Markup:
    """Escape a text, and set what is between backticks as code and between asterisks strong."""
    marked = re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(words)))
    return Markup(re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", marked))


def render_page(title: str, **context: Any) -> str:
    """Render the page of a context, or of finished HTML `content`."""
    data = files("compact") / "data"
    style, script = ((data / name).read_text("utf-8") for name in ("page.css", "page.js"))
    return str(_template().render(title=title, style=style, script=script, **context))


def render_block(block: Block) -> str:
    """Render one block alone."""
    return str(_template().make_module({"title": "", "style": "", "script": "", "content": ""}).block(block))


def write_page(path: Path, study: Study, pictures: Mapping[str, bytes], versions: Mapping[str, str]) -> Path:
    """Write the page of a study."""
    parts = [
        sections.ranking_section(study, pictures),
        sections.contact_section(study, pictures),
        sections.laws_section(study, pictures),
        sections.forces_section(study, pictures),
        *([] if study.over_durations is None else [sections.duration_section(study.over_durations, pictures)]),
        sections.motor_section(study, pictures),
        sections.work_section(study),
        *([] if study.first_cam is None else [sections.cams_section(study, pictures, study.first_cam)]),
        sections.sensitivity_section(study.sensitivities),
        sections.scene_section(study.scene),
        sections.mix_section(study),
        sections.checks_section(study.checks),
        sections.versions_section(study, versions),
    ]
    with atomic_file(path) as stream:
        title = study.scene.title or "untitled scene"
        stream.write(render_page(title, sections=parts, **answer(study, study.checks, pictures)))
    return path


def answer(study: Study, checks: Sequence[BalanceCheck], pictures: Mapping[str, bytes] | None = None) -> dict[str, Any]:
    """Select question, answer and uncertainty: the variables of the template other than title and sections."""
    model = CONTACT_MODELS.get(study.scene.accuracy.engine, "an engine of another package")
    return {
        "first": first_screen(study, pictures or {}),
        "question": say("question", study.scene, list(study.cycles), model),
        "ranking": list(_ranking_in_words(study)),
        "uncertainty": [
            *(as_sentence(sentence) for sentence in _uncertainty(study, checks) if sentence),
            *(f"{remark}." for remark in chain(*study.scene.replacements.values())),
            *study.scene.advice,
        ],
    }


def first_screen(study: Study, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Select the first screen of the page, the variable `first` of the template; empty without a verdict."""
    if not study.verdicts:
        return {}
    motion, own = study.scene.motion, (study.scene.motion.duration, study.scene.drive.kind)
    known, laws, tables = study.uncertainty, {by: each.law for by, each in text.own_verdicts(study).items()}, {}
    for duration, drive in dict.fromkeys((duration, drive) for duration, drive, _ in study.verdicts):
        header, *rows = text.model_table(study, duration, drive)
        speed = format_quantity(motion.stroke / duration, "m/s", 3)
        caption = f"All models, {drive} drive, {format_quantity(duration, 's', 3)} a pass ({speed})"
        cells: list[list[str | Mark]] = []
        for model, validity, *rest in rows:
            said, _, reason = validity.replace(": ", "; ", 1).partition("; ")
            cells.append([model, Mark("good" if said == "yes" else "bad", said, reason), *rest])
        tables[duration, drive] = Table.of_rows(caption, header, cells)
    lines = [
        *text.duration_lines(study), text.stiffness_sentence(study), text.measurement_sentence(study),
        text.spread_sentence(study), text.sleeve_sentence(study), text.held_sentence(study),
    ]  # fmt: skip
    details = [table for case, table in tables.items() if case != own]
    if known is not None and known.sources:
        header, *rows = text.uncertainty_table(known, laws)
        caption = "Sources of uncertainty: change of the peaks of the recommended laws"
        details.insert(0, Table.of_rows(caption, header, rows))
    return {
        "recommendations": text.recommendations(study),
        "table": tables[own],
        "pictures": figures_of("first", pictures),
        "limits": [as_sentence(line) for line in text.limit_sentences(study)],
        "lines": [as_sentence(line) for line in lines if line],
        "details": details,
    }


def _first_criteria(orders: Mapping[str, list[Place]]) -> dict[str, list[Place]]:
    return dict(list(orders.items())[:ANSWER_CRITERIA])


def _first_places(order: list[Place]) -> list[Place]:
    """Return the places of rank 1; none where all values are infinite."""
    return [place for place in order if place.rank == 1 and not place.reason]


def _winner(by: str, order: list[Place]) -> str:
    """State the first law by a criterion, with the requirements of the next and the last one."""
    first, finite = _first_places(order), [place for place in order if not place.reason]
    following = finite[len(first)] if first and finite[-1].rank > 1 else None
    last = finite[-1] if following is not None and finite[-1] is not following else None
    return say("winner", term_of(by), CRITERIA[by], first or order, following, last, len(order) == 1)


def _ranking_in_words(study: Study) -> Iterator[str]:
    """State first laws, laws that no machine can follow, and forces at the mean speed."""
    scene, kind, places = study.scene, study.scene.drive.kind, study.stages.drive.places
    orders = _first_criteria(places[kind])
    yield from (_winner(by, order) for by, order in orders.items())
    reasons: dict[str, dict[str, None]] = {}
    for place in chain(*orders.values()):
        if place.reason:
            reasons.setdefault(place.reason, {})[place.law] = None
    yield from (f"no machine can follow {' and '.join(laws)}: {reason}" for reason, laws in reasons.items())
    conflicts = []
    for (by, order), (other, other_order) in permutations(orders.items(), 2):
        first, best = _first_places(order), _first_places(other_order)
        if first and best and best[0].law not in [place.law for place in first]:
            law = first[0].law
            value = next(place.value for place in other_order if place.law == law)
            if np.isfinite(value):
                conflicts.append((law, term_of(by), term_of(other), value, best[0].value, CRITERIA[other]))
    if conflicts:
        yield say("conflicts", conflicts)
    if kind != "rigid":
        rigid = _first_criteria(places.get("rigid", {}))
        yield from (f"with a rigid drive, {_winner(by, order)}" for by, order in rigid.items())
    yield from (f"the law **{law}** is omitted: {reason}" for law, reason in study.stages.laws.not_made.items())
    resistance = float(np.ravel(study.resistance(np.array([scene.mean_speed]), np.zeros(1)))[0])
    forces = as_sentence(say("mean_speed", scene.mean_speed, resistance, study.stages.contacts.roller_load))
    yield f"{forces} {as_sentence(text.guide_sentence(study))} {as_sentence(text.return_sentence(study))}"
    if not study.mix.density_achievable:
        yield f"**Not reachable by rolling:** {study.mix.density_achievable.reason}"


def _uncertainty(study: Study, checks: Sequence[BalanceCheck]) -> Iterator[str]:
    """State errors, spread, ranks that are resolved, other engines, sensitivity, checks and remarks."""
    stages, kind = study.stages, study.scene.drive.kind
    engine, orders = stages.contacts.engine, _first_criteria(stages.drive.places[kind])
    yield say(
        "numerical_error", engine, stages.resistance.map if stages.contacts.speeds else None, stages.contacts.compacts
    )
    yield from (text.spread_sentence(study), text.air_sentence(study))
    for by, order in orders.items():
        first = _first_places(order)
        if first and len(first) < len(order):
            known = None if first[0].error is None else max(place.error or 0.0 for place in first)
            resolved = all(place.resolved for place in first)
            yield say("resolution", term_of(by), first[0].tie, known, CRITERIA[by].unit, resolved)
    pressure = study.mix.parameter("required_pressure")
    yield say("required_pressure", pressure, stages.contacts.numbers["roller_force"])
    for name in study.comparison:
        found = [
            (study.places_by_engine[name][kind][each.by][0], term_of(each.by), CRITERIA[each.by].unit, each)
            for each in study.agreements
            if each.other_engine == name != each.engine and each.drive == each.other_drive == kind and each.by in orders
        ]
        if found:
            yield say("compared", name, found)
    changed: dict[str, set[str]] = {}
    for shift in study.sensitivities:
        for by in shift.base.law:
            if ends := shift.changed_ends(by):
                changed.setdefault(shift.name, set()).update(f"{end.law[by]} by {term_of(by)}" for end in ends)
    beyond = sum((shift.low is None) + (shift.high is None) for shift in study.sensitivities)
    yield say("sensitivity", methods(study.sensitivities), changed, len(study.sensitivities), beyond)
    yield say("checks", len(checks), [check.name for check in checks if not check.passed])
