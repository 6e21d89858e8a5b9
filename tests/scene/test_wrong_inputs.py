"""Wrong inputs of a new user: each is answered in one sentence with its place and a remedy, and exit code 2."""

import re

import pytest

from compact.cli import program as cli
from compact.scene.new_scene import starter_scene

EDITS = {  # what -> (key of the starter, its line in place), words of the answer
    "decimal comma": ("stroke", "stroke = 0,4", "s.toml:LINE: not valid TOML …; write a decimal point in place of"),
    "unit behind": ("mass", "mass = 1000 kg", "s.toml:LINE: not valid TOML …; write the number alone, in SI units"),
    "unit in quotes": (
        "mass",
        'mass = "1000 kg"',
        "must be a number, got '1000 kg'; …without quotes, decimal comma",
    ),
    "millimetres": ("roller_radius", "roller_radius = 110", "was 110 mm = 0.11 m meant? Give the value in m"),
    "positions in mm": ("roller_positions", "roller_positions = [270.0, -270.0]", "was 270 mm = 0.27 m meant?"),
    "positions in quotes": ("roller_positions", 'roller_positions = "0.27"', "must be a list, …in square brackets"),
    "moisture in per cent": ("moisture", "moisture = 10", "at most 0.12|equal to 0.12, got 10; …0.10 for 10 %"),
    "density in per cent": ("density_ratio", "density_ratio = 98", "equal to 0.99, got 98; …0.98 for 98 %"),
    "kilonewtons": ("weight", "weight = 10", "weight / mass is 0.01 m/s2, must be about 9.81; give 9810 N for 1000 kg"),
    "milliseconds": ("duration", "duration = 7000.0", "was 7000 ms = 7 s meant? Give the value in s"),
    "megapascals": ("# required_pressure", "required_pressure = 0.203", "was 0.203 MPa = 203000 Pa meant?"),
    "per megapascal": ("# heckel_slope", "heckel_slope = 14.4", "was 14.4 1/MPa = 1.44e-05 1/Pa meant?"),
    "swapped": ("stroke", "stroke = 12.0", "are motion.stroke and motion.duration swapped? Give 3 m and 12 s"),
    "rollers missing": ("rollers", "", "machine.rollers: is missing; give the number of rollers of one cart"),
    "position missing": (
        "rollers",
        "rollers = 3",
        "one entry for each of machine.rollers = 3, got 2; make",
    ),
    "rollers overlap": ("roller_positions", "roller_positions = [0.05, -0.05]", "must be at least …= 0.22 m apart"),
    "guides swapped": ("guide_positions", "guide_positions = [-0.37, 0.37]", "give [front, rear], + towards the drive"),
    "misspelt key": (
        "roller_radius",
        "roler_radius = 0.11",
        "unknown key …did you mean `roller_radius`?",
    ),
    "misspelt table": (r"\[machine\]", "[machin]", "unknown table …did you mean `machine`?"),
    "other table": ("dwell", "dwell = 0.0\nmass = 5.0", "`mass` belongs in [machine]"),
    "misspelt law": ("laws", 'laws = ["cubc"]', "got 'cubc'; did you mean 'cubic'?"),
    "misspelt engine": ("engine", 'engine = "columns"', "got 'columns'; did you mean 'column'?"),
    "misspelt drive": ("kind", 'kind = "rigit"', "got 'rigit'; did you mean 'rigid'?"),
    "word without quotes": ("kind", "kind = rigid", "; write the word in quotes"),
    "truth of Python": ("one_sided", "one_sided = False", "; write true or false"),
    "open bracket": ("laws", 'laws = ["all"', "; close the bracket of the list before"),
    "twice": ("mass", "mass = 1000.0\nmass = 900.0", "; give each key once"),
    "negative": ("mass", "mass = -1000.0", "must be positive, got -1000.0; give the mass m of the cart in kg"),
    "short stroke": ("stroke", "stroke = 0.3", "give a smaller roller or sleeve, or a longer stroke"),
    "high lift": ("lift_thickness", "lift_thickness = 0.3", "at most product.height = 0.22 m, got 0.3; without it"),
    "fed too dense": ("fed_density_ratio", "fed_density_ratio = 0.985", "give the looser state before the first pass"),
    "no such file": ("# tables", 'tables = ["my_law.csv"]', "no such file: 'my_law.csv' under '.'; give CSV files"),
}
CALLS = {
    "set with a comma": (("roll", "small", "--set", "motion.stroke=0,4"), "without quotes, decimal comma or unit"),
    "set without a table": (("roll", "small", "--set", "mass=1000"), "`mass` belongs in [machine]"),
    "set of nothing": (("roll", "small", "--set", "=3"), "--set takes KEY=VALUE, such as mix.moisture=0.11"),
    "misspelt scene": (("run", "smal"), "no such file; did you mean 'small'?"),
    "misspelt command": (("rnu", "small"), 'Unknown command "rnu". Did you mean "run"?'),
    "nothing to vary": (("sweep", "small"), '"sweep" parameter --vary requires an argument; `compact sweep --help`'),
    "grid without a number": (("sweep", "small", "--vary", "mix.moisture=0.08:0.12"), "--vary takes KEY=LOW:HIGH:N"),
    "vary in per cent": (("sweep", "small", "--vary", "mix.moisture=8:12:5"), "got 8; give the moisture W …0.10 for"),
    "per cent": (("run", "small", "--tolerance", "1%"), 'unable to convert "1%" into float; give a plain number in SI'),
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
