"""The HTML page of a study, `report.html`: the answer, its uncertainty, and all results in sections.

The page is one file without external resources: style, script and pictures are embedded. All text is escaped; text
between backticks is set as code, between asterisks strong. Sentences are those of `report.text`, tables those of
`report.sections`.
"""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from compact.analysis.study import Study
from compact.files import atomic_file
from compact.report import text
from compact.report.sections import Block, Table, as_sentence, figures_of, sections
from compact.report.tables import Mark, format_quantity

UNIT_SPACE = re.compile(r"(?<=\d) (?=(?:%|[GMkmµ]?(?:N|W|J|Pa|m|s|g|rad|Nm))(?:[/²³<,.;: )\n]|$))")
LINES = ("other_cases", "stiffness", "measurement", "spread", "sleeves", "held")  # sentences below the first table


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


def write_page(path: Path, study: Study, pictures: Mapping[str, bytes]) -> Path:
    """Write the page of a study."""
    with atomic_file(path) as stream:
        title = study.scene.title or "untitled scene"
        stream.write(render_page(title, sections=sections(study, pictures), **answer(study, pictures)))
    return path


def answer(study: Study, pictures: Mapping[str, bytes] | None = None) -> dict[str, Any]:
    """Select question, answer and uncertainty: the variables of the template other than title and sections."""
    return {
        "first": first_screen(study, pictures or {}),
        "question": text.say("question", study),
        "ranking": text.sentences("ranking", study),
        "uncertainty": [
            *map(as_sentence, text.sentences("uncertainty", study)),
            *(f"{each}." for each in chain(*study.scene.replacements.values())),
            *study.scene.advice,
        ],
    }


def first_screen(study: Study, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Select the first screen of the page, the variable `first` of the template; empty without a verdict."""
    if not study.verdicts:
        return {}
    known, tables = study.uncertainty, {}
    for duration, drive in dict.fromkeys((duration, drive) for duration, drive, _ in study.verdicts):
        speed = format_quantity(study.scene.motion.stroke / duration, "m/s", 3)
        caption = f"All models, {drive} drive, {format_quantity(duration, 's', 3)} a pass ({speed})"
        columns: dict[str, Any] = dict(text.model_table(study, duration, drive))
        told = [validity.replace(": ", "; ", 1).partition("; ") for validity in columns["for sizing?"]]
        columns["for sizing?"] = [Mark("good" if said == "yes" else "bad", said, reason) for said, _, reason in told]
        tables[duration, drive] = Table(caption, columns)
    own, *details = (tables.pop((study.scene.motion.duration, study.scene.drive.kind)), *tables.values())
    if known is not None and known.sources:
        laws = {by: each.law for by, each in text.own_verdicts(study).items()}
        caption = "Sources of uncertainty: change of the peaks of the recommended laws"
        details.insert(0, Table(caption, text.uncertainty_table(known, laws)))
    return {
        "recommendations": text.recommendations(study),
        "table": own,
        "pictures": figures_of("first", pictures),
        "limits": [as_sentence(each) for each in text.sentences("limits", study)],
        "lines": [as_sentence(each) for name in LINES for each in text.sentences(name, study)],
        "details": details,
    }
