"""Blocks of the HTML page and their rendering by the Jinja2 templates in `report/page/templates`.

The page is one file without external resources: style, script and pictures are embedded. All text is escaped by the
templates; text between backticks is set as code.
"""

import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

WIDE_PICTURE = 880  # [px], width above which a picture scrolls sideways on a narrow screen
UNIT_SPACE = re.compile(r"(?<=\d) (?=(?:%|[GMkmµ]?(?:N|W|J|Pa|m|s|g|rad|Nm))(?:[/²³<,.;: )\n]|$))")
PNG_WIDTH = slice(16, 20)  # bytes of the header of a PNG file


@dataclass(frozen=True)
class Mark:
    """Text with a label in front.

    Parameters
    ----------
    kind : str
        Style of the label: "assumed", "known", "good" or "bad".
    """

    kind: str
    label: str
    text: str = ""


Cell = str | Mark


@dataclass(frozen=True)
class Table:
    """Table with a caption.

    Parameters
    ----------
    numeric : collection of int
        Indices of the right-aligned columns.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    numeric: Sequence[int] = ()
    kind: str = "table"

    @classmethod
    def from_columns(
        cls, caption: str, columns: Mapping[str, Sequence[Cell]], text_columns: Sequence[str] = ("law",)
    ) -> Self:
        """Build a table from its columns.

        Parameters
        ----------
        text_columns : sequence of str
            Names of the left-aligned columns.
        """
        numeric = [i for i, name in enumerate(columns) if name not in text_columns]
        return cls(caption, tuple(columns), list(zip(*columns.values(), strict=True)), numeric)


@dataclass(frozen=True)
class Picture:
    """Embedded picture.

    Parameters
    ----------
    description : str
        Text for readers who cannot see the picture.
    media_type : str
        "image/png" or "image/svg+xml".
    summary : str
        Line under which the picture is hidden until it is opened; empty for a visible picture.
    """

    data: bytes
    description: str
    caption: str = ""
    media_type: str = "image/png"
    summary: str = ""
    kind: str = "picture"

    @property
    def source(self) -> str:
        """Data URL of the picture."""
        return f"data:{self.media_type};base64,{b64encode(self.data).decode('ascii')}"

    @property
    def wide(self) -> bool:
        """True if the picture scrolls sideways on a narrow screen."""
        return self.media_type != "image/png" or int.from_bytes(self.data[PNG_WIDTH], "big") > WIDE_PICTURE


@dataclass(frozen=True)
class Paragraph:
    """Paragraph of text."""

    text: str
    kind: str = "paragraph"


Block = Table | Picture | Paragraph


def embed_figures(pictures: Mapping[str, bytes], figures: Mapping[str, tuple[str, str]]) -> list[Picture]:
    """Return the pictures that exist of a table of figures, name to description and caption."""
    return [Picture(pictures[name], *texts) for name, texts in figures.items() if name in pictures]


@dataclass(frozen=True)
class Section:
    """Section of the page, closed until it is opened."""

    name: str
    title: str
    lead: str
    blocks: Sequence[Block]


def render_page(title: str, template: str = "page.html.j2", **context: Any) -> str:
    """Render the page.

    Returns
    -------
    str
        HTML document; a number and its unit stay on one line.
    """
    data = files("compact") / "data"
    style, script = ((data / name).read_text("utf-8") for name in ("page.css", "page.js"))
    return environment().get_template(template).render(title=title, style=style, script=script, **context)


def render_block(block: Block) -> str:
    """Render one block alone."""
    return str(environment().get_template("blocks.html.j2").module.block(block))  # type: ignore[attr-defined]


@cache
def environment() -> "Environment":
    """Build the template environment: automatic escaping, undefined variables raise."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from compact.report.tables import format_number, format_percent, format_quantity

    found = Environment(
        loader=PackageLoader("compact.report.page"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    found.filters |= {
        "number": format_number, "quantity": format_quantity, "percent": format_percent,
        "inline": _inline_code, "units": _keep_units, "sentence": as_sentence,
    }  # fmt: skip
    found.tests["mark"] = lambda cell: isinstance(cell, Mark)
    return found


def _inline_code(text: str) -> "Markup":
    """Escape a text and set what is between backticks as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _keep_units(html: "Markup") -> "Markup":
    """Join numbers and units by no-break spaces."""
    from markupsafe import Markup

    return Markup(UNIT_SPACE.sub("\u00a0", str(html)))


def as_sentence(text: str) -> str:
    """Capitalise a line of text and end it with a full stop."""
    return f"{text[0].upper()}{text[1:]}."
