"""The HTML page of a study, `report.html`: the answer, and sections of figures and tables behind it.

The page is one file without external resources: style, script and pictures are embedded. All text is escaped; text
between backticks is set as code, between asterisks strong. Sentences are those of `report.text`; a table shows columns
of a table of `report.results`, whose file has all of them.
"""

import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup, escape

from compact.analysis.stages.drives import same_motions
from compact.analysis.study import Study
from compact.files import write_text
from compact.machine.ranking import CRITERIA
from compact.report import results, text
from compact.report.explain import KNOWN, explanation, origin_of
from compact.report.tables import Mark, TableSpec, format_column, format_percent

UNIT_SPACE = re.compile(r"(?<=\d) (?=(?:%|[GMkmµ]?(?:N|W|J|Pa|m|s|g|rad|Nm))(?:[/²³<,.;: )\n]|$))")
NUMERIC = re.compile(r"[−+<]?\s?\d.{,24}$|–|infinite|tie$|closed form|no estimate|out of|$")  # or in its place
PHONE_WIDTH = 400  # [px], of a narrow screen
SVG_WIDTH = 700  # [px], of the drawing of a cam
READABLE = 99.0  # [1/inch], pixels of a screen at which text of 8 points has 11 px
PNG_WIDTH = slice(16, 20)  # bytes of the header of a PNG file
SVG = "image/svg+xml"
SHOWN_CHECKS = 5  # [-], checks of the table, those nearest to their limits
KNOWN_FLAGS = ("measured", "given", "derived")  # of parameters of the mix; all others are assumed
NOT_INPUTS = ("title", "unusual", "output")  # of a scene


@dataclass(frozen=True)
class Picture:
    """Embedded picture.

    Parameters
    ----------
    description : str
        Text for readers who cannot see the picture.
    media_type : str
        "image/png" or "image/svg+xml".
    """

    data: bytes
    description: str
    caption: str = ""
    media_type: str = "image/png"

    @property
    def source(self) -> str:
        """Data URL of the picture."""
        return f"data:{self.media_type};base64,{b64encode(self.data).decode('ascii')}"

    @property
    def least_width(self) -> int:
        """Width on a screen at which text of 8 points has 11 px [px]; it scrolls sideways on a narrower one."""
        if self.media_type != "image/png":
            return SVG_WIDTH
        density = self.data.partition(b"pHYs")[2][:4]  # [1/m]
        per_inch = int.from_bytes(density, "big") * 0.0254 or 100.0
        return round(int.from_bytes(self.data[PNG_WIDTH], "big") / per_inch * READABLE)

    @property
    def wide(self) -> bool:
        """True if the picture scrolls sideways on a narrow screen."""
        return self.least_width > PHONE_WIDTH


Block = str | TableSpec | Picture


class Section(NamedTuple):
    """Section of the page, closed until it is opened; a block that is a text is a paragraph."""

    name: str
    title: str
    blocks: Sequence[Block] = ()


@cache
def _template() -> Any:
    environment = text.templates().overlay(autoescape=True)
    environment.filters |= {
        "inline": _inline,
        "units": lambda html: Markup(UNIT_SPACE.sub("\u00a0", str(html))),  # a number and its unit stay on one line
        "sentence": _as_sentence,
    }
    environment.tests["mark"] = lambda cell: isinstance(cell, Mark)
    environment.tests["numeric"] = lambda cells: all(isinstance(cell, str) and NUMERIC.match(cell) for cell in cells)
    environment.globals["zip"] = zip
    return environment.get_template("page.html.j2")


def _inline(words: str) -> Markup:
    """Escape a text, and set what is between backticks as code and between asterisks strong."""
    marked = re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(words)))
    return Markup(re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", marked))


def _as_sentence(line: str) -> str:
    """Capitalise a line of text and end it with a full stop."""
    return f"{line[0].upper()}{line[1:]}{'' if line.endswith(('.', '?')) else '.'}"


def render_page(title: str, **context: Any) -> str:
    """Render the page of a context, or of finished HTML `content`."""
    style, script = ((files("compact") / "data" / name).read_text("utf-8") for name in ("page.css", "page.js"))
    return str(_template().render(title=title, style=style, script=script, **context))


def write_page(path: Path, study: Study, pictures: Mapping[str, bytes]) -> Path:
    """Write the page of a study."""
    title = study.scene.title or "untitled scene"
    return write_text(path, render_page(title, sections=sections(study, pictures), **answer(study, pictures)))


def answer(study: Study, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Collect the answer: the variables of the template other than title and sections."""
    return {
        "question": text.say("question", study),
        "recommended": text.say("recommended", study),
        "tables": [text.decision_table(study), text.model_table(study)] if study.decision else [],
        "pictures": figures_of(("models", "best_cycles"), pictures),
        "sentences": text.answer_sentences(study),
    }


def figures_of(names: Iterable[str], pictures: Mapping[str, bytes]) -> list[Picture]:
    """Return the pictures of those names that exist, with description and caption."""
    return [Picture(pictures[name], *text.figures()[name]) for name in names if name in pictures]


def sections(study: Study, pictures: Mapping[str, bytes]) -> list[Section]:
    """Return the sections of a study, without those that are empty."""
    found = []
    for name, (title, macros, figures, tables) in SECTIONS.items():
        words = [_as_sentence(each) for macro in macros.split() for each in text.sentences(macro, study)]
        blocks = [*words, *figures_of(figures.split(), pictures), *(tables(study) if tables else ())]
        found += [Section(name, title, blocks)] if blocks else []
    return found


# tables of the sections


def _ranking(study: Study) -> Iterator[Block]:
    """Tabulate the laws by the criteria of the answer, with their ranks and the margins to the next law."""
    kind = study.scene.drive.kind
    orders = dict(islice(study.stages.drive.places[kind].items(), text.ANSWER_CRITERIA))
    same = same_motions(study.stages.laws.cycles)
    laws = [place.law for place in next(iter(orders.values())) if same[place.law] == place.law]
    columns: dict[str, list[str]] = {"law": [" = ".join(each for each in same if same[each] == law) for law in laws]}
    for by, order in orders.items():
        places = sorted((each for each in order if each.law in laws), key=lambda place: laws.index(place.law))
        values = [format_column([place.value], CRITERIA[by].unit, 3)[0] for place in places]
        head = f"{CRITERIA[by].quantity.term} (rank)"
        columns[head] = [f"{value} ({place.rank})" for value, place in zip(values, places, strict=True)]
        margins = ["tie" if place.tie else format_percent(place.margin) for place in places]
        columns["to the next" if len(columns) < 3 else "to its next"] = margins
    yield TableSpec.of_columns(f"Laws by engine and drive of the scene ({kind}); others in ranking.csv", columns)


def _contacts(study: Study) -> Iterator[Block]:
    """Tabulate the formulas, and the contacts over speed."""
    formulas = results.formula_table(study)
    quantities = {"quantity": [name.replace("_", " ") for name in formulas["quantity"]]}
    title = "By formulas 1.1–1.10, over the spread of the mix"
    yield TableSpec.of_columns(title, quantities | formulas.cells("value", "low", "high"))
    if study.stages.contacts.speeds:
        title = f"One roller by the engine {study.scene.accuracy.engine}, per metre of its length"
        names = "speed", "load", "resistance", "coefficient", "peak_pressure"
        errors = {"error": [format_percent(each.resistance_error) for each in study.stages.contacts.records]}
        yield results.contact_table(study).shown(title, *names, **errors)


def _motion(study: Study) -> Iterator[Block]:
    """Show the drawing of the cam of the decided law."""
    if (first := study.first_cam) is not None and first.drawing is not None:
        caption = f"{first.law}, true to scale in the file; `compact cam` writes it as CSV, SVG and DXF."
        yield Picture(first.drawing.svg().encode(), first.drawing.description, caption, SVG)


def _checks(study: Study) -> Iterator[Block]:
    """Tabulate the checks that are nearest to their limits."""
    nearest = sorted(study.checks, key=lambda each: -abs(each.residual) / (each.limit or 1e-300))[:SHOWN_CHECKS]
    marks = [Mark("good", "passes") if each.passed else Mark("bad", "fails") for each in nearest]
    yield TableSpec.of("", nearest, "check=name residual limit").shown("Checks", result=marks)


def _explained(study: Study) -> Iterator[Block]:
    """Explain every size of the decision, as `compact explain` does."""
    summary = {"decision": results.decision_numbers(study), "inputs": results.input_numbers(study.scene), "engine": ""}
    for key in study.decision.sizes if study.decision else ():
        yield ". ".join(explanation(summary, key))


def _inputs(study: Study) -> Iterator[Block]:
    """List every input of the scene and every parameter of the mix with its origin; assumed ones are marked."""
    for name, given in results.input_numbers(study.scene).items():
        values = [each["value"] for each in given.values()]
        if given and name not in NOT_INPUTS:
            yield TableSpec.of_columns(f"[{name}]", {
                "key": [f"`{key}`" for key in given],
                "value": [f"{each:.10g}" if isinstance(each, float) else str(each).strip("[]") for each in values],
                "origin": [remark(each["origin"]) for each in given.values()],
            })  # fmt: skip
    mix = results.mix_table(study)
    marks = [Mark("known" if flag in KNOWN_FLAGS else "assumed", flag) for flag in mix["flag"]]
    yield mix.shown("Parameters of the mix", "parameter", "value", "low", "high", flag=marks, origin=mix["origin"])


def remark(comment: str) -> str | Mark:
    """Mark the clause of a comment that states the origin of a value."""
    origin, rest = origin_of(comment)
    return Mark("known" if origin in KNOWN else "assumed", origin, rest) if origin else rest


Tables = Callable[[Study], Iterable[Block]] | None
SECTIONS: Mapping[str, tuple[str, str, str, Tables]] = {  # title, sentences, figures, tables
    "ranking": ("Ranking", "other_cases robust", "", _ranking),
    "contact": (
        "Contact and resistance", "held turn no_speed guides sleeves return_stroke air work",
        "pressure section resistance stroke fields", _contacts,
    ),
    "uncertainty": (
        "Uncertainty, and what to measure first", "uncertainty spread robust_gain", "", text.uncertainty_tables,
    ),
    "drive": ("Shaft, cam and duration", "motor bearings compliant no_cam", "shaft duration", _motion),
    "checks": ("Built-in checks", "checks", "", _checks),
    "explained": ("Where each number comes from", "", "", _explained),
    "inputs": ("Inputs and their origin", "replaced advice", "", _inputs),
}  # fmt: skip
