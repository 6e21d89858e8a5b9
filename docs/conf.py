"""Settings of the documentation: `python -m sphinx -W --keep-going -b html docs out/site`.

Nothing is fetched from the network. Equations become MathML, which browsers draw without a script.
"""

import re
import sys
from pathlib import Path

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # of `compact`, without installation, and of `tables`

from tables import insert_tables  # noqa: E402

project = "compact"
author = "The compact developers"
copyright = author
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_templates"]
templates_path = ["_templates"]
default_role = "code"

# Pages
html_theme = "furo"
html_title = "compact"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
pygments_style = "friendly"
highlight_language = "none"  # equations of docstrings

# Markdown: anchors of headings as on GitHub, and its fenced equations
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_fence_as_directive = {"math"}

# Reference of the package: one page for each public name
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False


def write_math(translator, node: nodes.Element) -> None:
    """Write an equation as MathML."""
    block = isinstance(node, nodes.math_block)
    try:
        element = latex2mathml.tex2mathml(node.astext(), as_block=block)
    except MathError as error:
        logging.getLogger(__name__).warning(str(error), location=node)
        raise nodes.SkipNode from error
    translator.body.append(f'<div class="equation">{element}</div>' if block else element)
    raise nodes.SkipNode


def escape_bar(found: re.Match[str]) -> str:
    """Escape a bar outside of code, which starts a substitution in reStructuredText."""
    return r"\|" if found[0] == "|" else found[0]


def prepare_docstring(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Keep the equations and tables above the sections as they are, and bars of absolute values as bars."""
    sections = next((i - 1 for i, line in enumerate(lines) if i and re.fullmatch(r"-{3,}", line)), len(lines))
    prepared: list[str] = []
    for i, line in enumerate(lines):
        literal = i < sections and line.startswith("    ")
        if literal and not prepared[-1].strip() and next(above for above in reversed(prepared) if above)[0] != " ":
            prepared += ["::", ""]
        prepared.append(line if literal or ">>>" in line else re.sub(r"`[^`]*`|[|]", escape_bar, line))
    lines[:] = prepared


def write_tables(_app: Sphinx, _page: str, source: list[str]) -> None:
    """Write the tables of a page in place of their marks."""
    source[0] = insert_tables(source[0])


def setup(app: Sphinx) -> None:
    """Register tables, equations, and docstrings, which are written for a terminal."""
    app.connect("source-read", write_tables)
    app.connect("autodoc-process-docstring", prepare_docstring, priority=400)  # before numpydoc
    app.add_html_math_renderer("mathml", (write_math, None), (write_math, None))
