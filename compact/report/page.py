"""Parts of a page of HTML that needs nothing else: words, numbers with units, tables, pictures inside the page.

Each function gives a piece of HTML as text; what is not HTML already is escaped where it comes in.
"""

import math
import re
from base64 import b64encode
from html import escape
from importlib.resources import files
from typing import NamedTuple

DIGITS = 4  # of a number on the page; the files have twelve
ROUNDING = 1e-9  # a share below it is shown as none
PREFIXES = {"G": 1e9, "M": 1e6, "k": 1e3, "": 1.0, "m": 1e-3, "µ": 1e-6}
PREFIXED = {  # units that take a prefix, and those prefixes
    "N": "Mk", "N/m": "Mk", "Pa": "GMk", "W": "Mk", "J": "Mk", "m": "mµ", "s": "mµ", "Nm": "k",
}  # fmt: skip
UNIT_AFTER = re.compile(r"(?<=\d) (?=(?:%|[GMkmµ]?(?:N|W|J|Pa|m|s|g|rad|Nm))(?:[/²³<,.;: )]|$))")
WIDE = 880  # pixels of a picture, above which a narrow screen cannot show all of it legibly
SCROLL = "This figure is wider than the screen: scroll it sideways."
UNITS = {"1": "", "-": "", "m/s2": "m/s²", "m/s^3": "m/s³", "kg/m3": "kg/m³"}


def number(value, digits=DIGITS):
    """A number in words of the page: some digits, no exponent from a thousandth to a million."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool | str):
        return {True: "yes", False: "no"}.get(value, str(value))
    if math.isinf(value):
        return "infinite"
    if value and not 1e-3 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa} × 10{_raised(int(power))}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
    text = f"{value or 0:.{decimals}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")


def _raised(power):
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def quantity(value, unit, digits=DIGITS):
    """A number with its SI unit, with the prefix that shortens it.

    >>> quantity(203e3, "Pa"), quantity(0.05573, "m"), quantity(0.179, "1")
    ('203 kPa', '55.73 mm', '0.179')
    """
    if value is None or not math.isfinite(value):
        return number(value)
    size, sign = abs(value), UNITS.get(unit, unit)
    larger = [p for p in PREFIXED.get(unit, "") if PREFIXES[p] > 1 and size >= PREFIXES[p]]
    smaller = [p for p in PREFIXED.get(unit, "") if PREFIXES[p] < 1 and 0 < size < 0.1 and size >= PREFIXES[p]]
    prefix = next(iter(larger or smaller), "")
    return f"{number(value / PREFIXES[prefix], digits)} {prefix}{sign}".rstrip()


def column(values, unit, digits=DIGITS):
    """Quantities of one column: one prefix and as many decimals as give the smallest of note its digits.

    >>> column([532.5, 1048.0, float("inf")], "W")
    ['532.5 W', '1048.0 W', 'infinite']
    """
    sizes = [abs(value) for value in values if value is not None and math.isfinite(value) and value]
    if not sizes:
        return [quantity(value, unit) for value in values]
    least = min(size for size in sizes if size >= max(sizes) / 100)
    sign = quantity(least, unit).rpartition(" ")[2] if UNITS.get(unit, unit) else ""
    factor = 1.0 if sign == UNITS.get(unit, unit) else PREFIXES[sign[0]]
    decimals = max(0, digits - 1 - math.floor(math.log10(least / factor)))
    if decimals > 2 * digits:
        return [quantity(value, unit) for value in values]
    return [
        f"{value / factor or 0:.{decimals}f} {sign}".rstrip().replace("-", "−")
        if value is not None and math.isfinite(value)
        else number(value)
        for value in values
    ]


def percent(share, digits=2):
    """A share as per cent; rounding counts as nothing."""
    return "–" if not math.isfinite(share) else f"{number(100 * share if abs(share) > ROUNDING else 0.0, digits)} %"


def sentence(line):
    """A line of the digest as a sentence of the page."""
    return f"{escape(line[0].upper() + line[1:])}."


def paragraph(html):
    """A paragraph of HTML."""
    return f"<p>{html}</p>"


def listed(items):
    """A list of pieces of HTML."""
    return f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"


def strong(words):
    """Words that matter."""
    return f"<strong>{escape(str(words))}</strong>"


def mark(kind, words):
    """A badge: `kind` is "assumed", "known", "good" or "bad", and its words say it without colour."""
    return f'<span class="mark {kind}">{escape(words)}</span>'


def table(header, rows, caption, numeric=()):
    """A table that scrolls inside its own box; cells are HTML; `numeric` columns stand right."""
    classes = ["n" if i in numeric else "" for i in range(len(header))]
    head = "".join(f'<th scope="col"{_class(c)}>{escape(name)}</th>' for name, c in zip(header, classes, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{_class(c)}>{cell}</td>" for cell, c in zip(row, classes, strict=True)) + "</tr>"
        for row in rows
    )
    return (
        f'<div class="box" tabindex="0" role="region" aria-label="{escape(caption)}"><table>'
        f"<caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def table_of(columns, caption, words=("law",)):
    """A table of columns by their names; those that are `words` stand left."""
    numeric = [i for i, name in enumerate(columns) if name not in words]
    return table(tuple(columns), list(zip(*columns.values(), strict=True)), caption, numeric)


def _class(name):
    return f' class="{name}"' if name else ""


def picture(data, words, caption="", kind="png"):
    """A picture inside the page; `words` say what it shows, `caption` (HTML) what to see in it.

    One of more than WIDE pixels keeps its letters legible on a narrow screen, where it scrolls sideways and says so.
    """
    coded = b64encode(data).decode("ascii")
    source = f"data:image/{'svg+xml' if kind == 'svg' else kind};base64,{coded}"
    told = f"<figcaption>{caption}</figcaption>" if caption else ""
    box = f'<div class="box" tabindex="0" role="region" aria-label="{escape(words)}">'
    wide = kind == "svg" or _pixels(data) > WIDE
    scroll = f'<p class="scroll">{SCROLL}</p>' if wide else ""
    image = f'<img src="{source}" alt="{escape(words)}">'
    return f"<figure{_class('wide' * wide)}>{scroll}{box}{image}</div>{told}</figure>"


def _pixels(png):
    """Width of a PNG."""
    return int.from_bytes(png[16:20], "big")


class Section(NamedTuple):
    """A part of the page that opens: its name for links, its title, one line of what it says, and its body as HTML."""

    name: str
    title: str
    lead: str
    body: str

    def html(self):
        """The section, shut."""
        head = f"<summary><h2>{escape(self.title)}</h2> <span>{escape(self.lead)}</span></summary>"
        return f'<details id="{self.name}">{head}<div class="body">{self.body}</div></details>'

    def link(self):
        """A link to it."""
        return f'<a href="#{self.name}">{escape(self.title)}</a>'


def page(title, body):
    """The whole page; a number and its unit stay on one line."""
    body = UNIT_AFTER.sub("\u00a0", body)
    style, script = (files("compact").joinpath(f"data/{name}").read_text("utf-8") for name in ("page.css", "page.js"))
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f'<link rel="icon" href="data:,"><style>{style}</style></head>\n<body><main>{body}</main>'
        f"<script>{script}</script></body></html>\n"
    )
