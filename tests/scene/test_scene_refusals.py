"""A refused scene states file, line, key, rule, value and remedy: the table of `refusals`, read from a file and set."""

import datetime
import re
from pathlib import Path

import pytest
import refusals
from extreme_scenes import toml

from compact.scene.errors import key_places
from compact.scene.loader import SceneError, load_scene, parse_scene

SCENES = Path(__file__).parents[2] / "compact" / "data" / "scenes"
FILE = "scene.toml"
HEADER, KEY = re.compile(r"\[\[?([\w.]+)\]"), re.compile(r"([\w-]+) *=")
ALL = ("BOUNDS", "NAMES", "RULES", "ENGINES", "UNITS", "PROCESS")


def rows(*names):
    """Scene, changes and words of the rows of some lists."""
    return [
        pytest.param("process" if name == "PROCESS" else "loveikin-2015", *row, id=f"{name.lower()}-{row[1][:60]}")
        for name in names
        for row in getattr(refusals, name)
    ]


def lines_of(text):
    """Line of each table and key of a scene of one key a line, as a reader counts them."""
    found, table = {}, ""
    for number, line in enumerate(text.split("\n"), 1):
        if header := HEADER.match(line):
            table = f"{header[1]}."
            found = {table.rsplit(".", left)[0]: number for left in range(table.count("."), 0, -1)} | found
            found[header[1]] = number
        elif key := KEY.match(line):
            found[table + key[1]] = number
    return found


def written(text, changes):
    """The text of a scene with changes: a line replaced, taken out, or added below the header of its table."""
    for path, value in changes.items():
        table, _, key = path.rpartition(".")
        lines, known = text.split("\n"), lines_of(text)
        if value is None and path not in known:
            continue
        if value is None and HEADER.match(lines[known[path] - 1]):  # a table with the tables in it
            kept = [""]
            for line in lines:
                header = HEADER.match(line)
                inside = header and f"{header[1]}.".startswith(f"{path}.") if header else kept[-1] is None
                kept.append(None if inside else line)
            lines = [line for line in kept[1:] if line is not None]
        elif value is None:
            del lines[known[path] - 1]
        else:
            said = value.isoformat() if isinstance(value, datetime.date) else toml(value)
            if path in known:
                lines[known[path] - 1] = f"{key} = {said}"
            elif table in known:
                lines.insert(known[table], f"{key} = {said}")
            elif table:
                lines += [f"[{table}]", f"{key} = {said}"]
            else:
                lines.insert(0, f"{key} = {said}")
        text = "\n".join(lines)
    return text


def has(mistake, words):
    parts = words.split("…")
    return re.search(".*".join(map(re.escape, parts)), mistake) is not None


@pytest.mark.parametrize(("scene", "changes", "words"), rows(*ALL, "CALLS"))
def test_a_refusal_states_key_rule_value_and_remedy(scene, changes, words):
    with pytest.raises(SceneError) as caught:
        load_scene(SCENES / f"{scene}.toml", **changes)
    (mistake,) = [each for each in caught.value.mistakes if has(each, f": {words}")][:1] or [caught.value.mistakes]
    assert isinstance(mistake, str), mistake
    assert not re.search(r"\n|nan at|Error|pydantic", mistake)


@pytest.mark.parametrize(("scene", "changes", "words"), rows(*ALL))
def test_a_refusal_states_the_line_of_its_key(scene, changes, words):
    text = written((SCENES / f"{scene}.toml").read_text("utf-8"), changes)
    with pytest.raises(SceneError) as caught:
        parse_scene(text, FILE)
    known, key = lines_of(text), re.split(r"[\[:]", words)[0]
    around = (key.rsplit(".", number)[0] for number in range(key.count(".") + 1))
    line = next((known[each] for each in around if each in known), None)
    place = FILE if line is None else f"{FILE}:{line}"
    assert any(has(each, f"{place}: {words}") for each in caught.value.mistakes), (place, caught.value.mistakes)
    assert key_places(text)[0].items() >= {tuple(each.split(".")): number for each, number in known.items()}.items()
