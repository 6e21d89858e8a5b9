"""A refused scene states file, line, key, rule, value and remedy: the table of `refusals`, read from a file and set."""

import re

import pytest
import refusals

from compact.scene.loader import SceneError, load_scene

ALL = ("BOUNDS", "NAMES", "RULES", "ENGINES", "UNITS", "PROCESS")


def rows(*names):
    """Scene, changes and words of the rows of some lists."""
    return [
        pytest.param("process" if name == "PROCESS" else "loveikin-2015", *row, id=f"{name.lower()}-{row[1][:60]}")
        for name in names
        for row in getattr(refusals, name)
    ]


def has(mistake, words):
    parts = words.split("…")
    return re.search(".*".join(map(re.escape, parts)), mistake) is not None


@pytest.mark.parametrize(("scene", "changes", "words"), rows(*ALL, "CALLS"))
def test_a_refusal_states_key_rule_value_and_remedy(scene, changes, words):
    with pytest.raises(SceneError) as caught:
        load_scene(scene, **changes)
    (mistake,) = [each for each in caught.value.mistakes if has(each, f": {words}")][:1] or [caught.value.mistakes]
    assert isinstance(mistake, str), mistake
    assert not re.search(r"\n|nan at|Error|pydantic", mistake)
