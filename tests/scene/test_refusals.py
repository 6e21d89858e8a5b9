"""Refusals of scenes: keys of engines, plausible ranges, wrong inputs, and one table of changes and words."""

import json
import re
from itertools import product
from pathlib import Path
from typing import get_args

import pytest
import refusals
from drive_tables import HYDRAULICS

from compact.analysis.contact_cases import case_of
from compact.analysis.study import Study
from compact.cli import program as cli
from compact.engines import BUILT_IN, formula
from compact.engines.compaction import engine as compaction
from compact.engines.fem import engine as fem_engine
from compact.material import mix
from compact.rolling_contact import BaseCondition, GapGeometry, Layer, Ply, Roller, RollerCondition
from compact.scene import plausible_ranges
from compact.scene.constraints import adapt
from compact.scene.loader import SceneError, load_scene
from compact.scene.new_scene import starter_scene
from compact.scene.schema import Overrides

SPEED = 0.1


def doors(engine, layer, roller, material):
    """Call what an engine refuses before it computes."""
    if engine == "formula":
        formula.roll(layer, roller, material, SPEED)
    elif engine in ("column", "spectral"):
        BUILT_IN[engine].require(layer, roller, SPEED)
    elif engine == "fem":
        fem_engine.along_travel(layer, roller, material, SPEED, None, 0.01)
    else:
        compaction.require_compactable(layer, roller, material, SPEED)


def taken(engine, key, value, friction):
    return all(limit.takes(value, friction) or limit.fixed for limit in BUILT_IN[engine].limits if limit.key == key)


@pytest.mark.parametrize("engine", [engine for engine in BUILT_IN if engine != "process"])
@pytest.mark.parametrize("friction", [0.0, 0.35])
def test_table_and_engines_accept_the_same_values(engine, friction):
    study = Study(load_scene("small", **{"mix.overrides.steel_friction": friction}))
    case = case_of(study.scene, study.stages.contacts.mix, SPEED, engine)
    layer, material = case.layer, case.material
    plies = (), (Ply(thickness=layer.height, stiffness=2.0),)
    cases = product(get_args(RollerCondition), get_args(GapGeometry), get_args(BaseCondition), plies)
    for rolling, profile, base, stack in cases:
        by_table = (
            taken(engine, "machine.roller_condition", rolling, friction)
            and taken(engine, "machine.gap_geometry", profile, friction)
            and taken(engine, "layer.base", base, friction)
            and (not stack or taken(engine, "layer.plies", stack, friction))
        )
        shown = "parabola" if engine == "formula" else profile  # a fixed limit: `inputs` gives the engine its own
        roller = Roller(0.11, peak_pressure=2e5, friction=friction, rolling=rolling, profile=shown)
        try:
            doors(engine, Layer(layer.height, base=base, plies=stack), roller, material)
            by_engine = True
        except ValueError:
            by_engine = False
        assert by_table == by_engine, (rolling, profile, base, stack)


def test_spectral_replaces_roller_and_gap_and_states_it():
    scene = load_scene("small", **{"accuracy.engine": "spectral"})
    given, sentences = adapt(scene, "spectral")
    assert (given.machine.roller_condition, given.machine.gap_geometry) == ("frictionless", "circle")
    assert sentences == (
        'spectral: machine.gap_geometry "circle" in place of "deformed", as its gap is measured on the undeformed '
        "surface",
        'spectral: machine.roller_condition "frictionless" in place of "free", as its rollers have no friction or slip '
        "everywhere",
    )
    assert (scene.machine.roller_condition, scene.machine.gap_geometry) == ("free", "deformed")


def test_compared_formulas_neglect_keys_that_they_do_not_accept():
    plies = [{"thickness": 0.16, "relative_modulus": 2.0}, {"thickness": 0.06, "relative_modulus": 1.0}]
    scene = load_scene("small", **{"accuracy.engine": "fem", "layer.plies": plies, "contact": {"indentation": 0.002}})
    assert scene.with_engine("formula").contact.indentation is None
    assert scene.replacements["fem"] == ()
    replaced = [sentence.partition(", as ")[0] for sentence in scene.replacements["formula"]]
    assert replaced == [
        "formula: contact.indentation absent in place of 0.002",
        "formula: layer.plies absent in place of 2 plies",
        'formula: machine.gap_geometry "parabola" in place of "deformed"',
    ]


# results


def new_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli._exit_code(["new", "mine"]) == 0
    return "mine/scene.toml"


HIGH = ("--set", "layer.lift_thickness=")  # the whole product, on which the formulas are valid


@pytest.mark.parametrize("engine", ["formula", "column", "spectral", pytest.param("fem", marks=pytest.mark.slow)])
def test_the_new_scene_is_rolled_by_every_engine(engine, tmp_path, monkeypatch, capsys):
    assert cli._exit_code(["roll", new_scene(tmp_path, monkeypatch), "--engine", engine, *HIGH, "--out", "out"]) == 0
    told = capsys.readouterr().out
    contact = json.loads(Path("out/contact.json").read_text())
    assert all(sentence in told for sentence in contact["replaced"])
    assert bool(contact["replaced"]) == (engine != "fem")


# ---- Plausible ranges: a value in other units is advised against or refused, and the user may insist


def test_every_key_of_the_mix_is_checked_against_the_spread_of_the_prior():
    for name in Overrides.model_fields:
        found = plausible_ranges.range_of(f"mix.overrides.{name}")
        for moisture, ratio in ((0.08, 0.90), (0.10, 0.98), (0.12, 0.99), (0.093, 0.957)):
            known = mix.prior(moisture, ratio).parameter(name)
            assert found.low < known.low or known.low == 0
            assert known.low <= known.high < found.high


@pytest.mark.parametrize(("times", "advised", "refused"), [(0.99, 0, 0), (1.01, 1, 0), (9.9, 1, 0), (10.1, 0, 1)])
@pytest.mark.parametrize("key", ["mix.overrides.heckel_slope", "machine.roller_length", "drive.stiffness"])
@pytest.mark.parametrize("side", ["low", "high"])
def test_outside_is_advice_and_ten_times_outside_is_refused(times, advised, refused, key, side):
    found = plausible_ranges.range_of(key)
    value = found.high * times if side == "high" else found.low / times
    assert bool(found.advice(key, value)) == bool(advised)
    assert bool(found.refusal(key, value)) == bool(refused)
    assert bool(found.refusal(key, -value)) == bool(refused)


def test_a_key_named_unusual_is_neither_refused_nor_advised_against():
    scene = load_scene("small", **{"unusual": ["mix.overrides.heckel_slope"], "mix.overrides.heckel_slope": 13.0})
    assert scene.mix.overrides.heckel_slope == 13.0
    assert scene.advice == ()
    assert scene.replaced(**{"mix.overrides.heckel_slope": 2e-4}).advice == ()


@pytest.mark.parametrize(("modulus", "told"), [(2e8, False), (1e8, True)])
def test_soft_oil_is_told_beforehand(modulus, told):
    """8 MPa x 3e-4 m3/(2 K 1e-3 m2) of 0.4 m: 3 % at 100 MPa, 1.5 % at 200 MPa."""
    oil = HYDRAULICS | {"bulk_modulus": modulus}
    scene = load_scene("small", **{"drive.kind": "hydraulic", "drive.hydraulics": oil})
    found = [sentence for sentence in scene.advice if "the oil yields by" in sentence]
    assert len(found) == told
    assert all(f"by {8e6 * 3e-4 / (2e-3 * modulus):.3g} m" in sentence for sentence in found)


# ---- Wrong inputs of a new user: each is answered in one sentence with its place and a remedy, and exit code 2


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
    "no scene": (("run", "nowhere.toml"), "nowhere.toml"),
    "unknown option": (("run", "small", "--engin", "fem"), "Did you mean --engine?"),
    "change without a value": (("run", "small", "--set", "mix.moisture"), "--set takes KEY=VALUE"),
    "tolerance not a number": (("export", "small", "--format", "csv", "--tolerance", "tight"), "tight"),
    "cutter that does not fit": (("cam", "small", "--law", "reversal-3", "--cutter", "0.8"), "use a smaller cutter"),
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


# ---- A refused scene states file, line, key, rule, value and remedy: the table of `refusals`, read from a file and set


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
