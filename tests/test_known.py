"""The page `docs/how_do_we_know.md` is true: its tests exist and hold what it says, its published numbers are ours."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from compact import published

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "how_do_we_know.md").read_text("utf-8")
ROWS = re.findall(r"^\| (.*?) \| `(.*?)` \| `(tests/\w+\.py)::(\w+)` \|$", PAGE, re.MULTILINE)

CLAIM = r"test_(published|printed)_"  # begins the name of a test of a published number


@cache
def sources(file):
    """Source of each test of a file, from its name on, by name."""
    text = (ROOT / file).read_text("utf-8")
    lines, found = text.split("\n"), [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    return {node.name: "\n".join(lines[node.lineno - 1 : node.end_lineno]) for node in found}


@pytest.mark.parametrize(("what", "held", "file", "name"), ROWS, ids=[row[3] for row in ROWS])
def test_what_is_known_is_tested_as_the_page_says(what, held, file, name):
    assert name in sources(file), f"{file} has no {name}; docs/how_do_we_know.md says that it holds: {what}"
    source = sources(file)[name]
    assert held in source, f"{name} does not hold {held} any more; docs/how_do_we_know.md says so"
    if bound := re.fullmatch(r"rel=([\d.]+(e-?\d+)?)", held):
        widest = max(float(rel[0]) for rel in re.findall(r"rel=([\d.]+(e-?\d+)?)", source))
        assert float(bound[1]) == widest, f"{name} allows rel={widest:g} somewhere; docs/how_do_we_know.md says {held}"


def test_every_test_named_on_the_page_is_read():
    assert len(ROWS) > 50
    named = re.findall(r"(tests/\w+\.py)::(\w+)", PAGE)
    assert all(name in sources(file) for file, name in named)
    assert len(named) == len(ROWS) + 1  # one in the text, of the published numbers


def test_published_numbers_of_the_page_are_those_of_the_check():
    table = published.markdown(published.rows())
    assert PAGE.endswith(table), "write the output of `compact check --markdown` to the end of docs/how_do_we_know.md"


def test_every_published_number_that_is_tested_is_told():
    """Tests that call a number published or printed stand on the page, but for those of the table and of this page."""
    told = {name for *_, name in ROWS}
    files = [
        path
        for path in (ROOT / "tests").glob("test_*.py")
        if path.stem not in ("test_published", "test_known", "test_page")
    ]
    claimed = {name for path in files for name in sources(f"tests/{path.name}") if re.match(CLAIM, name)}
    assert len(claimed) > 15
    assert claimed - told == set()
