"""Wrong inputs of a new user: each is answered in one sentence with its place and a remedy, and exit code 2."""

import re

import pytest

from compact.cli import program as cli
from compact.scene.new_scene import starter_scene

EDITS = {  # what -> (key of the starter, its line in place), words of the answer
    "decimal comma": ("stroke", "stroke = 0,4", "s.toml:LINE: not valid TOML …; write a decimal point in place of"),
    "unit behind": ("mass", "mass = 1000 kg", "s.toml:LINE: not valid TOML …; write the number alone, in SI units"),
    "moisture in per cent": ("moisture", "moisture = 10", "at most 0.12|equal to 0.12, got 10; …0.10 for 10 %"),
    "swapped": ("stroke", "stroke = 12.0", "are motion.stroke and motion.duration swapped? Give 3 m and 12 s"),
    "word without quotes": ("kind", "kind = rigid", "; write the word in quotes"),
    "truth of Python": ("one_sided", "one_sided = False", "; write true or false"),
    "open bracket": ("laws", 'laws = ["all"', "; close the bracket of the list before"),
    "twice": ("mass", "mass = 1000.0\nmass = 900.0", "; give each key once"),
}
CALLS = {
    "set with a comma": (("roll", "small", "--set", "motion.stroke=0,4"), "without quotes, decimal comma or unit"),
    "nothing to vary": (("sweep", "small"), '"sweep" parameter --vary requires an argument; `compact sweep --help`'),
    "vary in per cent": (("sweep", "small", "--vary", "mix.moisture=8:12:5"), "got 8; give the moisture W …0.10 for"),
    "speed in mm/s": (("roll", "small", "--speed", "130"), "was 130 mm/s = 0.13 m/s meant?"),
    "unknown format": (("export", "small", "--format", "xls"), 'Invalid value "xls" for --format. Choose from: "csv"'),
}


def answer(capsys, arguments, words):
    assert cli._exit_code([*arguments]) == 2
    said = capsys.readouterr().err
    assert said.startswith("compact: ")
    assert said.count("\n") == 1, said
    pattern = ".*".join("|".join(map(re.escape, part.split("|"))) if "|" in part else re.escape(part)
                        for part in words.split("…"))  # fmt: skip
    assert re.search(pattern, said), said


@pytest.mark.parametrize(("key", "line", "words"), EDITS.values(), ids=EDITS)
def test_a_wrong_line_is_answered_in_one_sentence(key, line, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text, number = re.subn(rf"(?m)^{key}\b.*$", line, starter_scene(), count=1)
    if not number:
        text, number = re.subn(rf"(?m)^{key}.*$", line, starter_scene(), count=1)
    assert number == 1
    (tmp_path / "s.toml").write_text(text)
    place = next((i for i, each in enumerate(text.split("\n"), 1) if each.startswith(line.split("\n")[0])), 0)
    answer(capsys, ("roll", "s.toml"), words.replace("LINE", str(place)))


@pytest.mark.parametrize(("arguments", "words"), CALLS.values(), ids=CALLS)
def test_a_wrong_call_is_answered_in_one_sentence(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    answer(capsys, arguments, words)
