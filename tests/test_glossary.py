"""Words of the public surface: names, scene keys, options and headings use the terms of docs/glossary.md."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted((ROOT / "compact").rglob("*.py"))
# Words of names that have a standard term; whole words of an identifier, split at underscores and capitals
NAMES = {
    "answered", "aside", "beside", "calmest", "crew", "crowding", "grip", "march", "softly", "sought", "swing", "told",
    "wanted", "yielding",
}  # fmt: skip
# Phrases that headings and messages replace
PHRASES = (
    "stays pressed", "way back", "in doubt", "cold start", "made for the machine", "knows its", "turned round",
    "springs back", "asks least", "tells its", "work left over", "beside",
)  # fmt: skip
OPENINGS = ("What", "Who", "Where", "How", "Whether")


@cache
def words(name: str) -> set[str]:
    """Lower-case words of an identifier."""
    return {word.lower() for part in name.split("_") for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", part)}


def public_names(tree: ast.Module):
    """Public functions, classes, methods and their arguments."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node.name
            if isinstance(node, ast.FunctionDef):
                yield from (argument.arg for argument in [*node.args.args, *node.args.kwonlyargs])


@pytest.mark.parametrize("package", sorted({path.parent for path in MODULES}), ids=lambda path: path.name)
def test_names_messages_and_docstrings_use_terms_of_the_glossary(package):
    found = set()
    for path in package.glob("*.py"):
        tree = ast.parse(path.read_text("utf-8"))
        found |= {f"{path.name}: {name}" for name in public_names(tree) if words(name) & NAMES}
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                if (ast.get_docstring(node) or "-").split()[0] in OPENINGS:
                    found.add(f"{path.name}: {getattr(node, 'name', 'module')}")
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found |= {f"{path.name}:{node.lineno}: {phrase}" for phrase in PHRASES if phrase in node.value}
    assert found == set()


@pytest.mark.parametrize(
    "page", [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"], ids=lambda path: path.name
)
def test_headings_use_terms_of_the_glossary(page):
    headings = [line for line in page.read_text("utf-8").split("\n") if line.startswith("#")]
    assert [line for line in headings for phrase in PHRASES if phrase in line.lower()] == []


def test_every_term_is_listed_once():
    rows = [line.split("|")[1].strip() for line in (ROOT / "docs" / "glossary.md").read_text("utf-8").split("\n")
            if line.startswith("| ")]  # fmt: skip
    assert len(rows) == len(set(rows))
    assert len(rows) > 50
