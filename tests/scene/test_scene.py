"""The scene: what is accepted, what is refused and in which words."""

import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling import examples

from compact.analysis.robust.law import ROBUST_OBJECTIVES
from compact.motion.optimisation_problem import OBJECTIVES
from compact.scene import plausible_ranges
from compact.scene.loader import Scene, SceneError, load_scene, parse_scene
from compact.scene.new_scene import starter_scene
from compact.scene.schema import Objective, declared_keys

SCENES = Path(__file__).parents[2] / "compact" / "data" / "scenes"
PUBLISHED = (SCENES / "loveikin-2015.toml").read_text("utf-8")
FILE = "loveikin.toml"


@pytest.fixture(scope="module")
def published():
    return parse_scene(PUBLISHED, FILE)


def edited(old, new, text=PUBLISHED):
    assert old in text, f"the published scene has no {old!r} to edit"
    return text.replace(old, new, 1)


def leaves(table, path=()):
    """Every key path of nested tables with its value."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield ".".join((*path, key)), value


COLUMNS = load_scene("loveikin-2015-engines").with_engine("column")
LEAVES = dict(leaves(tomllib.loads(PUBLISHED)))


# (a) what is read


@pytest.mark.parametrize("name", ["loveikin-2015", "loveikin-2015-crank", "loveikin-2015-engines", "small"])
def test_the_scenes_of_the_studies_are_valid_and_within_the_rules_of_thumb(name):
    assert load_scene(name).advice == ()


def test_the_starter_shows_every_key_there_is():
    shown = set(re.findall(r"(\w+) = ", starter_scene()))
    assert {key.rpartition(".")[2] for key in declared_keys() if not key.startswith("compare.")} <= shown


def test_every_key_has_words_and_every_range_is_ordered():
    for key, info in declared_keys().items():
        assert info.description, key
    for key in plausible_ranges.COMPARED_KEYS:
        found = plausible_ranges.range_of(key)
        assert 0 < found.low < found.high, key
        assert found.reason, key


def test_the_tables_of_the_starter_are_valid_once_uncommented():
    text = starter_scene()
    start, end = text.index("# [process]"), text.index("\n[accuracy]") + 1
    lines = text[start:end].replace("\n# ", "\n").removeprefix("# ").split("\n")
    optional = ("strokes", "gap", "extrusion_pressure", "offered_thickness", "feed_count", "kneading")
    kept = [line for line in lines if not line.startswith(optional)]
    table = "\n".join(kept)
    scene = parse_scene(text.replace(text[start:end], table + "\n"))
    assert scene.process.feed == "room"
    assert scene.sleeve.count == 2


def test_the_crank_scene_turns_at_the_published_speed():
    crank = load_scene("loveikin-2015-crank")
    assert math.pi / crank.motion.duration == pytest.approx(10.5, rel=1e-15)
    assert crank.drive.angles == pytest.approx([0, math.pi / 2, math.pi, 3 * math.pi / 2], rel=1e-15)


# (b) values, equality, hash


@given(st.randoms())
@settings(max_examples=20, deadline=None)
def test_the_hash_is_independent_of_order_comments_and_title(random):
    head, *tables = re.split(r"\n(?=\[)", re.sub(r" *#.*", "", PUBLISHED))
    shuffled = []
    for table in tables:
        header, *keys = table.strip().split("\n")
        random.shuffle(keys)
        shuffled.append("\n".join([header, "# a comment", *keys]))
    random.shuffle(shuffled)
    text = "\n".join([head.replace("Loveikin", "Another"), *shuffled])
    assert parse_scene(text).hash == parse_scene(PUBLISHED).hash


@pytest.mark.parametrize(
    "changes",
    [
        {"machine.mass": 1001.0}, {"layer.base": "slip"}, {"motion.laws": ["cubic", "crank"]},
        {"machine.guide_positions": [0.37, -0.36]}, {"mix.overrides.effective_modulus": 1.4e6}, {"mix.fitted_at": None},
        {"machine.rollers": 1, "machine.roller_positions": [0.0]}, {"drive.rank_by": ["energy"]},
    ],
    ids=lambda changes: next(iter(changes)),
)  # fmt: skip
def test_the_hash_depends_on_every_kind_of_value(published, changes):
    changed = published.replaced(**changes)
    assert changed.hash != published.hash
    assert changed != published


def test_the_hash_depends_on_the_contents_of_the_tables(tmp_path):
    table = tmp_path / "own.csv"
    table.write_text("0,0\n1,1\n")
    scene = parse_scene(edited('laws = ["all"]', 'tables = ["own.csv"]\nlaws = ["all"]'), str(tmp_path / "scene.toml"))
    before = scene.hash
    assert scene.table_paths == (table,)
    table.write_text("0,0\n1,2\n")
    assert scene.hash != before
    table.unlink()
    with pytest.raises(SceneError, match=r"own\.csv: no such file"):
        _ = scene.hash


# (c) changes


def test_objectives_of_scenes_are_those_of_the_modules():
    assert get_args(Objective) == (*OBJECTIVES, *ROBUST_OBJECTIVES)


@pytest.mark.parametrize(("moisture", "factor"), [(0.08, 0.55), (0.09, 0.78), (0.10, 1.0), (0.12, 1.45)])
def test_a_fitted_heckel_slope_follows_the_prior_over_the_moisture(moisture, factor):
    scene = COLUMNS.replaced(**{"mix.moisture": moisture})
    assert scene.mix.values["heckel_slope"] == pytest.approx(15.228e-6 * factor, rel=1e-12)
    assert scene.mix.overrides.heckel_slope == 15.228e-6
    remark = (
        "column: fits hold at moisture 0.1 and density ratio 0.98; scaled by the prior: effective_modulus, "
        "heckel_slope; not scaled, as the prior lacks them: roller_friction, fed_density_ratio"
    )
    stated = [sentence for engine in scene.replacements.values() for sentence in engine if "fits hold" in sentence]
    assert stated == ([remark] if factor != 1.0 else [])


def test_a_value_that_the_caller_gives_is_no_fit():
    wetter = COLUMNS.replaced(**{"mix.moisture": 0.12})
    given = wetter.replaced(**{"mix.overrides.heckel_slope": 2e-5})
    assert given.mix.values["heckel_slope"] == 2e-5
    assert given.mix.values["effective_modulus"] == wetter.mix.values["effective_modulus"]
    every = wetter.replaced(**{"mix.overrides": {"heckel_slope": 2e-5, "effective_modulus": 1e6}})
    assert every.mix.values == {"heckel_slope": 2e-5, "effective_modulus": 1e6}
    fit = {"moisture": 0.09, "density_ratio": 0.98, "parameters": ["heckel_slope"]}
    refitted = wetter.replaced(**{"mix.overrides.heckel_slope": 2e-5, "mix.fitted_at": fit})
    assert refitted.mix.values["heckel_slope"] == pytest.approx(2e-5 * 1.45 / 0.78, rel=1e-12)


# (d) advice


def test_the_unusual_is_advised_against_but_not_refused(published):
    changes = {"machine.mass": 1200.0, "motion.duration": 3000.0, "mix.overrides.heckel_slope": 2e-4}
    found = published.replaced(**changes).advice
    for words in (f"{FILE}:7: machine.weight: weight / mass", "0.000133333 m/s is outside", "0.0002 1/Pa is outside"):
        assert sum(words in sentence for sentence in found) == 1


# (e) positions in the file


def mistakes_of(text, file=FILE):
    with pytest.raises(SceneError) as caught:
        parse_scene(text, file)
    return caught.value.mistakes


def test_a_line_is_right_after_comments_and_strings_that_look_like_toml():
    text = edited("[machine]", "# [x] {\n[machine] # ] [[\n", edited("two rollers, rigid", "[[ # two = {"))
    text = edited("guide_positions = [0.37, -0.37] ", "guide_positions = [ # [\n0.37,\n-0.37, # }\n] ", text)
    text = edited("carts = 1", "'carts' = 0", text)
    line = text[: text.index("'carts'")].count("\n") + 1
    assert mistakes_of(text)[0].startswith(f"{FILE}:{line}: drive.carts: must be greater than or equal to 1, got 0")


TEN = {
    "mass = 1000.0": "mass = -1",
    "rollers = 2": "rollers = 2.5",
    "roller_radius = 0.11": "roler_radius = 0.11",
    "[0.37, -0.37]": "[-0.37, 0.37]",
    "guide_friction = 0.008": "guide_friction = 8",
    "height = 0.22": 'height = "0.22"',
    "moisture = 0.10": "moisture = 10",
    'base = "bonded"': 'base = "glued"',
    "rod_length = 0.8": "rod_length = 0.1",
    "tolerance = 0.01": "tolerance = nan",
}


def test_ten_mistakes_are_reported_together_in_the_order_of_the_file():
    text = PUBLISHED
    for old, new in TEN.items():
        text = edited(old, new, text)
    mistakes = mistakes_of(text)
    lines = [int(mistake.split(":")[1]) for mistake in mistakes]
    blamed = {text.split("\n")[line - 1].split(" #")[0].strip() for line in lines}
    assert lines == sorted(lines)
    assert blamed == {re.sub(r"^\[.*", "guide_positions = [-0.37, 0.37]", new) for new in TEN.values()}
    assert len(mistakes) == len(TEN)  # the misspelt key is not missing as well
    assert mistakes_of(text) == tuple(str(SceneError(mistakes)).split("\n"))


# (h) files


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "loveikin.tml: no such file; did you mean 'loveikin.toml'?"),
        (b"", "loveikin.toml: holds no key; `compact new DIR` writes a commented scene"),
        (b"# one\n# caf\xe9\n", "loveikin.toml: cannot be read: 'utf-8' codec"),
        (b"a = " + b"[" * 5000, "loveikin.toml: not valid TOML: "),
        (b"a = [1", "loveikin.toml: not valid TOML: Unclosed array"),
        (b"a = " + b"9" * 5000, "loveikin.toml: not valid TOML: "),
        (b"a = 1\nb 2\n", "loveikin.toml:2: not valid TOML at column 3: "),
    ],
    ids=["no file", "empty", "latin-1", "deep", "open", "long number", "line"],
)
def test_a_file_that_is_no_scene_is_refused(tmp_path, content, words):
    path = tmp_path / FILE
    path.write_bytes(content or b"")
    with pytest.raises(SceneError) as caught:
        load_scene(path.with_suffix(".tml") if content is None else path)
    assert words in str(caught.value)


# (i) anything else is refused too: nothing but SceneError comes out

junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.binary(max_size=4) | st.dates(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


def made_or_refused(make, *arguments, **keywords):
    try:
        return isinstance(make(*arguments, **keywords), Scene)
    except SceneError as error:
        return bool(error.mistakes)


@given(st.integers(0, len(PUBLISHED)), st.integers(0, 40), st.text(alphabet="[]{}=\"'#.,\n\\ ax0-_e+", max_size=12))
@examples(40, slow=300)
def test_any_damage_to_a_scene_is_refused_or_harmless(start, length, text):
    assert made_or_refused(parse_scene, PUBLISHED[:start] + text + PUBLISHED[start + length :])


paths = st.sampled_from([*LEAVES, *Scene.model_fields, "mix.overrides", "motion.tables", "drive.angles"])


@given(st.dictionaries(paths | st.text(max_size=12), junk, max_size=4))
@examples(40, slow=300)
def test_any_change_makes_a_scene_or_is_refused(published, changes):
    assert made_or_refused(published.replaced, **changes)


# (j) neighbours


@pytest.mark.parametrize("name", ["loveikin-2015", "loveikin-2015-crank", "loveikin-2015-engines", "small"])
def test_every_value_of_a_study_scene_states_its_origin(name):
    lines = (SCENES / f"{name}.toml").read_text("utf-8").splitlines()
    values = [line for line in lines if re.match(r"\w+ = ", line) and not line.startswith("title")]
    assert [line for line in values if not re.search(r"# .*(published|assumed|calibrated)", line)] == []


def test_the_calibrated_values_give_the_published_force_and_coefficient(published):
    """Theory section 2: F of (1.6) is 9740 N, (1.8) is 0.178961 of it; the formulas are written out here once more."""
    nu, mu, q = 0.3, 0.35, 0.203e6
    machine, modulus = published.machine, published.mix.overrides.effective_modulus
    alpha = math.atan((2 - 2 * nu) / (mu * (1 - 2 * nu))) / math.pi
    sine = 7.53 * (1 - nu**2) * alpha ** (1 - alpha) * (1 - alpha) ** (1 + alpha) * q / modulus
    force = machine.roller_length * modulus * machine.roller_radius * sine**2
    force /= 20.32 * (1 - nu**2) * alpha * (1 - alpha) ** 3
    arm = sine / (1 - alpha) * (1 - 2 * alpha) / 3
    assert force == pytest.approx(9740, rel=1e-6)
    assert arm + machine.roller_friction + machine.bearing_friction == pytest.approx(
        (3562 - 0.008 * 9480) / (2 * 9740), abs=1e-6
    )


def test_reading_a_scene_loads_no_heavy_library():
    """Start-up: 0.3 s for the whole command; scipy and matplotlib cost more than that each."""
    code = (
        "import sys, compact.scene.loader; print(sorted({'scipy', 'matplotlib', 'skfem', 'pandas'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
