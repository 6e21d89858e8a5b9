"""The scene: what is accepted, what is refused and in which words."""

import math
import pickle
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from sampling import examples

from compact.scene.errors import key_lines, key_remarks
from compact.scene.loader import LAW_NAMES, Scene, SceneError, load_scene, parse_scene, starter_scene
from compact.scene.schema import (
    BearingTable,
    BeltTable,
    CatalogueTable,
    EndSpringTable,
    FittedAt,
    Hydraulics,
    LowerLift,
    Motor,
    Optimise,
)

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
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


LEAVES = dict(leaves(tomllib.loads(PUBLISHED)))


def another(value):
    """A neighbour of a valid value; what this makes of a text is not a valid name, so texts are changed apart."""
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value * 0.999 if value else 0.001
        case list() if isinstance(value[0], float):
            return [entry * 1.001 for entry in value]


OTHER_TEXTS = {
    "layer.base": "slip",
    "mix.fitted_at.parameters": ["effective_modulus"],
    "motion.laws": ["cubic", "crank"],
    "drive.kind": "crank",
    "drive.rank_by": ["energy"],
    "accuracy.engine": "fem",
}
# changes that the rules between the keys tie to another key
TIED = {
    "machine.rollers": {"machine.rollers": 1, "machine.roller_positions": [0.0]},
    "layer.passes": {"layer.passes": 2, "accuracy.engine": "column"},
    "motion.stroke": {"motion.stroke": 0.41},
    "motion.rod_length": {"motion.rod_length": 0.9},
}


# (a) what is read


@pytest.mark.parametrize("name", ["loveikin-2015", "loveikin-2015-crank", "loveikin-2015-engines", "small"])
def test_the_scenes_of_the_studies_are_valid_and_within_the_rules_of_thumb(name):
    assert load_scene(SCENES / f"{name}.toml").advice == ()


@pytest.mark.parametrize("name", ["loveikin-2015", "loveikin-2015-crank", "loveikin-2015-engines", "small"])
def test_every_value_of_a_study_scene_states_its_origin(name):
    lines = (SCENES / f"{name}.toml").read_text("utf-8").splitlines()
    values = [line for line in lines if re.match(r"\w+ = ", line) and not line.startswith("title")]
    assert [line for line in values if not re.search(r"# .*(published|assumed|calibrated)", line)] == []


def test_the_starter_is_valid_and_led_by_columns():
    scene = parse_scene(starter_scene(), "new.toml")
    assert scene.accuracy.engine == "column"
    assert scene.advice == ()


def test_the_starter_shows_every_key_there_is():
    keys = set(re.findall(r"^(?:# )?(\w+) = ", starter_scene(), re.MULTILINE))
    tables = [field.annotation for field in Scene.model_fields.values()]
    known = {key for table in tables for part in getattr(table, "__args__", (table,)) for key in fields_of(part)}
    beside = {"formula", "column", "spectral", "fem", "compaction", "process"}
    tables = {"overrides", "fitted_at", "motor", "optimise", "end_springs", "hydraulics", "lower_lift", "catalogue"}
    assert known - keys == tables | {"guide_bearing", "roller_bearing"} | beside
    shown = (FittedAt, Motor, BeltTable, Optimise, EndSpringTable, Hydraulics, LowerLift, BearingTable, CatalogueTable)
    assert {key for table in shown for key in table.model_fields} - keys == {"belt"}


def fields_of(table):
    return getattr(table, "model_fields", {})


def test_the_overrides_shown_in_the_starter_are_valid_once_uncommented():
    start, end = starter_scene().index("[mix.overrides]"), starter_scene().index("[layer]")
    block = starter_scene()[start:end]
    scene = parse_scene(starter_scene().replace(block, block.replace("\n# ", "\n")))
    assert None not in scene.mix.overrides.model_dump().values()


def test_the_crank_scene_turns_at_the_published_speed():
    crank = load_scene(SCENES / "loveikin-2015-crank.toml")
    assert math.pi / crank.motion.duration == pytest.approx(10.5, rel=1e-15)
    assert crank.drive.angles == pytest.approx([0, math.pi / 2, math.pi, 3 * math.pi / 2], rel=1e-15)


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


def test_whole_numbers_are_read_as_floats():
    assert repr(parse_scene(edited("mass = 1000.0", "mass = 1000")).machine.mass) == "1000.0"


def test_all_expands_to_every_law(published):
    assert published.law_names == LAW_NAMES
    assert published.replaced(**{"motion.laws": ["cubic", "crank"]}).law_names == ("cubic", "crank")


def test_tables_are_found_in_the_folder_of_the_scene(tmp_path):
    (tmp_path / "own.csv").write_text("0,0\n1,1\n")
    path = tmp_path / "scene.toml"
    path.write_text(edited('laws = ["all"]', 'tables = ["own.csv"]\nlaws = ["all"]'))
    assert load_scene(path).table_paths == (tmp_path / "own.csv",)


def test_a_table_may_be_written_in_any_toml_style():
    text = "mix.moisture = 0.10\nmix.density_ratio = 0.98\nmix.overrides = {effective_modulus = 1364535.2}\n"
    fit = "moisture = 0.10, density_ratio = 0.98, parameters = ['effective_modulus', 'roller_friction']"
    text += f"mix.fitted_at = {{{fit}}}\n"
    start, end = PUBLISHED.index("[mix]"), PUBLISHED.index("[layer]")
    assert parse_scene(text + PUBLISHED[:start] + PUBLISHED[end:]) == parse_scene(PUBLISHED)


# (b) values, equality, hash


@pytest.mark.parametrize("path", ["mass", "machine.mass"])
def test_a_scene_cannot_be_changed_in_place(published, path):
    *tables, key = path.split(".")
    target = getattr(published, tables[0]) if tables else published
    with pytest.raises(ValidationError, match=r"frozen|no field|extra"):
        setattr(target, key, 2.0)


def test_lists_of_a_scene_are_tuples(published):
    lists = [value for _, value in leaves(published.model_dump()) if isinstance(value, list)]
    assert lists == []


def test_a_scene_is_equal_to_its_copy_from_another_file(published):
    assert published == parse_scene(PUBLISHED, "elsewhere/copy.toml")


def test_a_scene_can_be_pickled(published):
    twin = pickle.loads(pickle.dumps(published))
    assert (twin, twin.hash) == (published, published.hash)


def test_a_scene_error_can_be_pickled():
    error = pickle.loads(pickle.dumps(SceneError(["one", "two"])))
    assert (error.mistakes, str(error)) == (("one", "two"), "one\ntwo")


def test_the_hash_is_a_sha256(published):
    assert re.fullmatch("[0-9a-f]{64}", published.hash)


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


def test_the_hash_is_independent_of_number_format(published):
    assert parse_scene(edited("mass = 1000.0", "mass = 1e3")).hash == published.hash


def test_the_hash_is_independent_of_the_output(published):
    assert published.replaced(**{"output.items": []}).hash == published.hash


@pytest.mark.parametrize("path", sorted(LEAVES.keys() - {"title", "output.items"}))
def test_the_hash_depends_on_every_other_key(published, path):
    value = OTHER_TEXTS[path] if path in OTHER_TEXTS else another(LEAVES[path])
    changed = published.replaced(**TIED.get(path, {path: value}))
    assert changed.hash != published.hash
    assert changed != published


def test_the_hash_depends_on_the_contents_of_the_tables(tmp_path):
    table = tmp_path / "own.csv"
    table.write_text("0,0\n1,1\n")
    scene = parse_scene(edited('laws = ["all"]', 'tables = ["own.csv"]\nlaws = ["all"]'), str(tmp_path / "scene.toml"))
    before = scene.hash
    table.write_text("0,0\n1,2\n")
    assert scene.hash != before


# (c) changes


def test_a_changed_scene_is_new_and_the_old_one_stays(published):
    wetter = published.replaced(**{"mix.moisture": 0.11})
    assert (published.mix.moisture, wetter.mix.moisture) == (0.10, 0.11)
    assert wetter.replaced(**{"mix.moisture": 0.10}) == published


def test_a_change_to_none_removes_an_optional_key(published):
    prior = published.replaced(**{"mix.overrides.effective_modulus": None})
    assert prior.mix.overrides.effective_modulus is None


def test_a_change_may_add_a_table():
    bare = parse_scene(starter_scene())
    assert bare.replaced(**{"mix.overrides.poisson": 0.25}).mix.overrides.poisson == 0.25
    assert bare.replaced(cam={"breadth": 0.9, "roller_follower_radius": 0.03}).cam.breadth == 0.9


def test_bounds_of_a_cam_without_a_cam_are_refused():
    bare = parse_scene(starter_scene())
    made = {"objectives": ["peak_force"], "smoothness": 1, "pressure_angle": 0.7}
    with pytest.raises(SceneError, match=r"bounds pressure_angle of a cam, and the table \[cam\] is missing"):
        bare.replaced(**{"motion.optimise": made})


def test_optimisation_of_an_unknown_objective_is_refused():
    with pytest.raises(SceneError, match=r"motion\.optimise\.objectives"):
        parse_scene(starter_scene()).replaced(**{"motion.optimise": {"objectives": ["peak_noise"], "smoothness": 1}})


def test_objectives_and_parameters_of_scenes_are_those_of_the_modules():
    from compact.material.mix import CALIBRATED
    from compact.motion.objectives import OBJECTIVES as KNOWN
    from compact.scene.schema import Fit, MixParameter, Objective, Overrides

    assert get_args(Objective) == tuple(KNOWN)
    assert set(get_args(MixParameter)) == set(Overrides.model_fields)
    assert set(get_args(Fit)) == {*CALIBRATED, "fed_density_ratio", "roller_friction"}


@pytest.mark.parametrize(("moisture", "factor"), [(0.08, 0.55), (0.09, 0.78), (0.10, 1.0), (0.12, 1.45)])
def test_a_fitted_heckel_slope_follows_the_prior_over_the_moisture(moisture, factor):
    scene = parse_scene(starter_scene()).replaced(**{"mix.moisture": moisture})
    assert scene.mix.values["heckel_slope"] == pytest.approx(15.228e-6 * factor, rel=1e-12)
    assert scene.mix.overrides.heckel_slope == 15.228e-6
    remark = (
        "column: fits hold at moisture 0.1 and density ratio 0.98; scaled by the prior: effective_modulus, "
        "heckel_slope; not scaled, as the prior lacks them: fed_density_ratio"
    )
    stated = [sentence for engine in scene.replacements.values() for sentence in engine if "fits hold" in sentence]
    assert stated == ([remark] if factor != 1.0 else [])


def test_a_fit_within_rounding_of_its_moisture_stays_bit_for_bit():
    scene = parse_scene(starter_scene()).replaced(**{"mix.moisture": 0.10 * (1 + 1e-15)})
    assert scene.mix.values == scene.mix.overrides.model_dump(exclude_none=True)
    assert scene.mix.fit_remark == ""


def test_a_value_that_the_caller_gives_is_no_fit():
    wetter = parse_scene(starter_scene()).replaced(**{"mix.moisture": 0.12})
    given = wetter.replaced(**{"mix.overrides.heckel_slope": 2e-5})
    assert given.mix.values["heckel_slope"] == 2e-5
    assert given.mix.values["effective_modulus"] == wetter.mix.values["effective_modulus"]
    every = wetter.replaced(**{"mix.overrides": {"heckel_slope": 2e-5, "effective_modulus": 1e6}})
    assert every.mix.values == {"heckel_slope": 2e-5, "effective_modulus": 1e6}
    fit = {"moisture": 0.09, "density_ratio": 0.98, "parameters": ["heckel_slope"]}
    refitted = wetter.replaced(**{"mix.overrides.heckel_slope": 2e-5, "mix.fitted_at": fit})
    assert refitted.mix.values["heckel_slope"] == pytest.approx(2e-5 * 1.45 / 0.78, rel=1e-12)


def test_values_without_a_stated_fit_stay_as_given(published):
    measured = published.replaced(**{"mix.fitted_at": None, "mix.moisture": 0.09})
    assert measured.mix.values == {"effective_modulus": 1364535.2}
    assert measured.mix.fit_remark == ""


def test_fits_of_a_compared_engine_are_scaled_too():
    scene = load_scene(SCENES / "loveikin-2015-engines.toml", **{"mix.moisture": 0.09})
    assert scene.with_engine("column").mix.values["heckel_slope"] == pytest.approx(15.228e-6 * 0.78, rel=1e-12)
    assert scene.mix.values["heckel_slope"] == pytest.approx(16.3796e-6 * 0.78, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": ["heckel_slop"]}, r"mix\.fitted_at\.parameters.*heckel_slop"),
        ({"parameters": ["friction_angle"]}, r"mix\.fitted_at\.parameters.*friction_angle"),
        ({"parameters": []}, r"mix\.fitted_at\.parameters"),
        ({"moisture": 0.2}, r"mix\.fitted_at\.moisture: must be between 0\.08 and 0\.12, got 0\.2"),
    ],
)
def test_an_impossible_place_of_a_fit_is_refused(changes, message):
    fit = {"moisture": 0.10, "density_ratio": 0.98, "parameters": ["heckel_slope"]} | changes
    with pytest.raises(SceneError, match=message):
        parse_scene(starter_scene()).replaced(**{"mix.fitted_at": fit})


def test_changes_may_mend_a_broken_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(edited("moisture = 0.10", "moisture = 10"))
    assert load_scene(path, **{"mix.moisture": 0.1}) == parse_scene(PUBLISHED)


def test_changes_leave_the_callers_table_alone(published):
    mine = {"poisson": 0.2}
    published.replaced(**{"mix.overrides": mine, "mix.overrides.cohesion": 1e3})
    assert mine == {"poisson": 0.2}


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("mix.moisture", 0.2, "mix.moisture: must be between 0.08 and 0.12, got 0.2; give the moisture W"),
        ("mix.moistur", 0.1, "mix.moistur: unknown key in [mix], got 0.1; did you mean `moisture`?"),
        ("machine.mass", None, "machine.mass: is missing; give the mass m of the cart in kg"),
        ("machine", None, "machine: the table [machine] is missing"),
        ("machine", {1: 2.0}, "machine: must have texts as keys, got 1"),
        ("title.line", "x", "title.line: `title` is no table, so it has no key `line`"),
        ("machine.roller_positions.0", 0.2, "`machine.roller_positions` is no table, so it has no key `0`"),
        ("motion.stroke", 0.3, "machine.roller_radius: roller too large for the stroke"),
        ("", 1, "unknown key at the top of the file, before any table, got 1"),
    ],
)
def test_a_change_is_checked_like_a_file(published, path, value, words):
    with pytest.raises(SceneError) as caught:
        published.replaced(**{path: value})
    assert words in str(caught.value)


def test_a_refused_change_is_not_blamed_on_a_line_of_the_file(published):
    with pytest.raises(SceneError, match=r"^loveikin\.toml \(changed by the caller\): mix\.moisture: .* got 0\.2"):
        published.replaced(**{"mix.moisture": 0.2})


# (d) advice


@pytest.mark.parametrize(
    ("change", "advice"),
    [
        (
            {"product.height": 0.30},
            "loveikin.toml:9: machine.roller_radius: eq 1.1 advises 0.40 to 0.55 of product.height, 0.12 to 0.165 m, "
            "got 0.11",
        ),
        (
            {"machine.mass": 1200.0},
            "loveikin.toml:7: machine.weight: weight / mass is 8.33333 m/s2, expected 9.5 to 10.5; "
            "is one of the two in other units?",
        ),
        (
            {"machine.roller_condition": "driven", "machine.roller_torque": 5.0, "accuracy.engine": "spectral"},
            'loveikin.toml (changed by the caller): machine.roller_condition: the engine "spectral" assumes full '
            'slip of a driven roller, whatever its torque; "fem" resolves stick',
        ),
        (
            {"machine.roller_torque": -5.0},
            'loveikin.toml (changed by the caller): machine.roller_torque: the engine "formula" neglects '
            'machine.roller_torque; "fem" and "compaction" use it',
        ),
    ],
)
def test_the_unusual_is_advised_against_but_not_refused(published, change, advice):
    assert published.replaced(**change).advice == (advice,)


@pytest.mark.parametrize("height", [0.11 / 0.40, 0.11 / 0.55])
def test_the_ends_of_the_advised_radii_are_within(published, height):
    assert published.replaced(**{"product.height": height}).advice == ()


# (e) limits that are allowed


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("moisture = 0.10", "moisture = 0.08"),
        ("moisture = 0.10", "moisture = 0.12"),
        ("density_ratio = 0.98", "density_ratio = 0.99"),
        ("fed_density_ratio = 0.94", "fed_density_ratio = 0.7200001"),
        ("feeder_sleeve = 0.18 ", "feeder_sleeve = 0.0 "),
        ("guide_friction = 0.008", "guide_friction = 1"),
        ("rib_factor = 1.5", "rib_factor = 1"),
        ("roller_positions = [0.27, -0.27]", "roller_positions = [0.11, -0.11]"),
        ("energy_weight = 0.5", "energy_weight = 0.7"),
        ("run_up = 0.16666666666666666 ", "run_up = 0.5 "),
        ('"figures", "cams", "reactions", "crank", "report"]', "]"),
        ("carts = 1", "angles = [0.5]\ncarts = 1"),
        ("effective_modulus = 1364535.2", "poisson = 0"),
    ],
)
def test_a_value_on_its_bound_is_accepted(old, new):
    assert isinstance(parse_scene(edited(old, new)), Scene)


def test_a_scene_without_any_crank_needs_no_rod():
    text = edited('laws = ["all"]', 'laws = ["cubic"]', edited(', "crank", "report"] # -; assumed: everything', "]"))
    assert parse_scene(edited("rod_length = 0.8", "", text)).motion.rod_length is None


# (g) refusals: old text, new text, the line blamed (the new text's if None), words


def refused(name, old, new, *words, at=None, also=("", "")):
    """The published scene with `old` made `new`; the mistake blamed on the line of `at`, or of `new`, has the words."""
    text = edited(old, new, edited(*also))
    line = text[: text.index(at or new)].count("\n") + 1
    return pytest.param(text, line, words, id=name)


MOTOR = """[drive.motor]
curve = "kloss"
torque = 40.0
speed = 157.0
breakdown_slip = 0.15
gear_ratio = 150.0
inertia = 0.01
flywheel_inertia = 50.0
"""
BELT = """[drive.motor.belt]
pulley_radius = 0.1
stiffness = 50000.0
preload = 500.0
friction = 0.4
wrap = 3.0
"""
SPRINGS = """[drive.end_springs]
stiffness = 5000.0
preload = 200.0
length = 0.1
"""
HYDRAULICS = """[drive.hydraulics]
piston_area = 1e-3
supply_pressure = 8e6
pump_flow = 5e-4
valve_area = 2e-5
discharge_coefficient = 0.62
oil_density = 870.0
transition_drop = 1e3
bulk_modulus = 1.4e9
dead_volume = 1e-4
"""
BROKEN = [
    refused(
        "negative",
        "roller_radius = 0.11",
        "roller_radius = -0.11",
        "machine.roller_radius: must be positive, got -0.11; give the radius in m",
    ),
    refused(
        "zero",
        "mass = 1000.0",
        "mass = 0",
        "machine.mass: must be positive, got 0; give the mass m of the cart in kg",
    ),
    refused(
        "nan",
        "weight = 10000.0",
        "weight = nan",
        "machine.weight: must be finite, got nan; give the weight G",
    ),
    refused(
        "infinite",
        "pin_height = 0.1",
        "pin_height = inf",
        "machine.pin_height: must be finite, got inf; give the height",
    ),
    refused(
        "number in quotes",
        "height = 0.22",
        'height = "0.22"',
        "product.height: must be a number, got '0.22'; give the height h0 of the product in m, without quotes",
    ),
    refused(
        "true as number",
        "mass = 1000.0",
        "mass = true",
        "machine.mass: must be a number, got true; give the mass",
    ),
    refused(
        "true as count",
        "rollers = 2",
        "rollers = true",
        "machine.rollers: must be a whole number, got true; give the number of rollers",
    ),
    refused(
        "date as number",
        "mass = 1000.0",
        "mass = 2015-01-01",
        "machine.mass: must be a number, got the time 2015-01-01; give the mass",
    ),
    refused(
        "table as number",
        "mass = 1000.0",
        "mass = {a = 1}",
        "machine.mass: must be a number, got a table; give the mass",
    ),
    refused(
        "count with a point",
        "passes = 1",
        "passes = 2.0",
        "layer.passes: must be a whole number, got 2.0; give the number of passes, without a decimal point",
    ),
    refused(
        "passes that leave no mark",
        "passes = 1",
        "passes = 2",
        'layer.passes: the engine "formula" takes no 2 passes, as an elastic layer keeps no trace of a pass; give 1, '
        'or choose accuracy.engine = "column" or "compaction"',
    ),
    refused(
        "no roller",
        "rollers = 2",
        "rollers = 0",
        "machine.rollers: must be between 1 and 1000000, got 0; give the number",
    ),
    refused(
        "five carts",
        "carts = 1",
        "carts = 5",
        "drive.carts: must be between 1 and 4, got 5; give the number of carts",
    ),
    refused(
        "number as bool",
        "one_sided = false",
        "one_sided = 0",
        "machine.one_sided: must be true or false, got 0; give true for contact on the front half only",
    ),
    refused(
        "number as text",
        'title = "Loveikin and Pochka 2015, two rollers, rigid drive"',
        "title = 3",
        "title: must be a text in quotes, got 3; give a title in quotes",
    ),
    refused(
        "friction above one",
        "guide_friction = 0.008",
        "guide_friction = 8",
        "machine.guide_friction: must be between 0 and 1, got 8; give the Coulomb coefficient",
    ),
    refused(
        "negative arm",
        "rolling_arm = 0.0005",
        "rolling_arm = -1e-9",
        "machine.rolling_arm: must be zero or positive, got -1e-09; give the rolling-friction arm f4",
    ),
    refused(
        "rib factor below one",
        "rib_factor = 1.5",
        "rib_factor = 0.9",
        "machine.rib_factor: must be at least 1, got 0.9; give the factor f5",
    ),
    refused(
        "moisture in per cent",
        "moisture = 0.10",
        "moisture = 10",
        "mix.moisture: must be between 0.08 and 0.12, got 10; give the moisture W as water mass / dry "
        "mass, 0.10 for 10 %",
    ),
    refused(
        "k above the table",
        "density_ratio = 0.98",
        "density_ratio = 0.995",
        "mix.density_ratio: must be between 0.9 and 0.99, got 0.995; give the required density ratio k",
    ),
    refused(
        "k below the table",
        "density_ratio = 0.98",
        "density_ratio = 0.89",
        "mix.density_ratio: must be between 0.9 and 0.99, got 0.89",
    ),
    refused(
        "incompressible",
        "effective_modulus = 1364535.2",
        "poisson = 0.5",
        "mix.overrides.poisson: must be at least 0 and below 0.5, got 0.5; give Poisson's ratio",
    ),
    refused(
        "modulus zero",
        "effective_modulus = 1364535.2",
        "effective_modulus = 0.0",
        "mix.overrides.effective_modulus: must be positive, got 0.0; give the secant contact modulus E",
    ),
    refused(
        "instant below relaxed",
        "effective_modulus = 1364535.2",
        "instant_over_relaxed = 0.99",
        "mix.overrides.instant_over_relaxed: must be at least 1, got 0.99",
    ),
    refused(
        "angle in a wrong unit",
        "effective_modulus = 1364535.2",
        "friction_angle = 61",
        "mix.overrides.friction_angle: must be between 0 and 60, got 61; give the angle of internal "
        "friction in degrees",
    ),
    refused(
        "fed below the loosest",
        "fed_density_ratio = 0.94",
        "fed_density_ratio = 0.72",
        "layer.fed_density_ratio: must be above 0.72 and at most 0.99, got 0.72; give the density ratio of "
        "the mix as fed",
    ),
    refused(
        "run-up above a half",
        "run_up = 0.16666666666666666",
        "run_up = 0.6",
        "motion.run_up: must be between 1e-06 and 0.5, got 0.6; give the share of the pass",
    ),
    refused(
        "tolerance a half",
        "tolerance = 0.01",
        "tolerance = 0.5",
        "accuracy.tolerance: must be above 0 and below 0.5, got 0.5; give the relative error",
    ),
    refused(
        "unknown base",
        'base = "bonded"',
        'base = "bonder"',
        "layer.base: must be one of bonded, slip, got 'bonder'; did you mean 'bonded'?",
    ),
    refused(
        "unknown engine",
        'engine = "formula"',
        'engine = "x"',
        "accuracy.engine: must be one of formula, column, spectral, fem, compaction, process, got 'x'; give the",
    ),
    refused(
        "engine not a text",
        'engine = "formula"',
        "engine = 1",
        "accuracy.engine: must be one of formula, column, spectral, fem, compaction, process, got 1; give the",
    ),
    refused(
        "unknown law",
        'laws = ["all"]',
        'laws = ["cubic", "cubik"]',
        "motion.laws[1]: must be one of constant-velocity, cubic,",
        "got 'cubik'; did you mean 'cubic'?",
    ),
    refused(
        "unknown output",
        '"figures", "cams"',
        '"figure", "cams"',
        "output.items[1]: must be one of tables, figures, cams, reactions, crank, fields, model_spread, "
        "roller_motors, report, got "
        "'figure'; did you mean 'figures'?",
    ),
    refused(
        "law outside a list",
        'laws = ["all"]',
        'laws = "all"',
        "motion.laws: must be a list, got 'all'; give the laws to compare, or [\"all\"] in square brackets",
    ),
    refused(
        "no law",
        'laws = ["all"]',
        "laws = []",
        "motion.laws: must have at least 1 entry, got 0; give the laws to compare",
    ),
    refused(
        "one guide",
        "guide_positions = [0.37, -0.37]",
        "guide_positions = [0.37]",
        "machine.guide_positions: must have exactly 2 entries, got 1; give the positions of the [front, "
        "rear] guide wheels",
    ),
    refused(
        "entry of a list",
        "guide_positions = [0.37, -0.37]",
        "guide_positions = [0.37, true]",
        "machine.guide_positions[1]: must be a number, got true; give the positions",
    ),
    refused(
        "entry of a list over lines",
        "guide_positions = [0.37, -0.37]",
        "guide_positions = [\n0.37, # front ]\n'x']",
        "machine.guide_positions[1]: must be a number, got 'x'; give the positions",
    ),
    refused(
        "missing key",
        "mass = 1000.0",
        "",
        "machine.mass: is missing; give the mass m of the cart in kg",
        at="[machine]",
    ),
    refused(
        "table spelt wrong",
        "[machine]",
        "[machin]",
        "machin: unknown table at the top of the file, before any table, got a table; did you mean `machine`?",
    ),
    refused(
        "table twice with brackets",
        "[product]",
        "[[product]]",
        "product: must be a table, got [{",
        "write [product] on a line of its own, its keys below",
    ),
    refused(
        "key spelt wrong",
        "roller_radius = 0.11",
        "roler_radius = 0.11",
        "machine.roler_radius: unknown key in [machine], got 0.11; did you mean `roller_radius`?",
    ),
    refused(
        "key of another table",
        "roller_radius = 0.11",
        "stroke = 0.4\nroller_radius = 0.11",
        "machine.stroke: unknown key in [machine], got 0.4; `stroke` belongs in [motion]",
    ),
    refused(
        "key before any table",
        'title = "',
        'stroke = 0.4\ntitle = "',
        "stroke: unknown key at the top of the file, before any table, got 0.4; `stroke` belongs in [motion]",
    ),
    refused(
        "title in a table",
        "mass = 1000.0",
        'mass = 1000.0\ntitle = "x"',
        "machine.title: unknown key in [machine], got 'x'; `title` belongs at the top of the file, before any table",
        at='title = "x"',
    ),
    refused(
        "misspelt key of another table",
        "mass = 1000.0",
        "mass = 1000.0\nstroks = 0.4",
        "machine.stroks: unknown key in [machine], got 0.4; did you mean `stroke`, which belongs in [motion]?",
        at="stroks",
    ),
    refused(
        "key like no other",
        "height = 0.22",
        "height = 0.22\nzzz = 1",
        "product.zzz: unknown key in [product], got 1; take it out, or choose from height, width, mould_speed",
        at="zzz",
    ),
    refused(
        "key in an inline table",
        "[mix.overrides]",
        "overrides = {poisson = 0.7}\n[mix.overrides2]",
        "mix.overrides.poisson: must be at least 0 and below 0.5, got 0.7",
    ),
    # rules between keys
    refused(
        "three positions for two rollers",
        "[0.27, -0.27]",
        "[0.5, 0.0, -0.5]",
        "machine.roller_positions: needs one position per roller, machine.rollers = 2, got 3; make the two agree",
    ),
    refused(
        "rollers overlap",
        "[0.27, -0.27]",
        "[0.10, -0.10]",
        "machine.roller_positions: rollers overlap: neighbours must be at least 2*roller_radius = 0.22 m "
        "apart, got 0.2; move them apart",
    ),
    refused(
        "roller too large for the stroke",
        "stroke = 0.4 ",
        "stroke = 0.39 ",
        "machine.roller_radius: roller too large for the stroke: 2*roller_radius + feeder_sleeve must be "
        "at most motion.stroke = 0.39 m (eqs 1.2, 1.3), got 0.4; make the roller or the sleeve smaller",
        at="roller_radius = 0.11",
    ),
    refused(
        "guides swapped",
        "[0.37, -0.37]",
        "[-0.37, 0.37]",
        "machine.guide_positions: front must be greater than rear, got [-0.37, 0.37]; give [front, rear]",
    ),
    refused(
        "journal as large as the wheel",
        "journal_diameter = 0.02",
        "journal_diameter = 0.046",
        "machine.journal_diameter: must be below machine.guide_wheel_diameter = 0.046 m, got 0.046; give the journal",
    ),
    refused(
        "fed denser than the product",
        "fed_density_ratio = 0.94",
        "fed_density_ratio = 0.98",
        "layer.fed_density_ratio: must be below mix.density_ratio = 0.98, got 0.98; give the looser state",
    ),
    refused(
        "weights above one",
        "energy_weight = 0.5",
        "energy_weight = 0.8",
        "motion.energy_weight: energy_weight + acceleration_weight must be at most 1, got 1.1; the rest up "
        "to 1 is the weight",
    ),
    refused(
        "rod shorter than the crank",
        "rod_length = 0.8",
        "rod_length = 0.2",
        "motion.rod_length: must be greater than the crank, stroke/2 = 0.2 m, got 0.2; give a longer rod",
    ),
    refused(
        "no rod for the crank",
        "rod_length = 0.8",
        "# rod_length = 0.8",
        'motion.rod_length: is missing, and motion.laws is ["all"], crank included and output.items holds '
        '"crank"; give the length of the connecting rod in m',
        at="[motion]",
    ),
    refused(
        "spring of a rigid drive",
        'kind = "rigid"',
        'kind = "rigid"\nstiffness = 1e6',
        'drive.kind: "rigid" has no stiffness; take it out, or choose "elastic"',
        at='kind = "rigid"',
    ),
    refused(
        "resistance at first order of a rigid drive",
        'kind = "rigid"',
        'kind = "rigid"\ninclude_added_mass = true',
        'drive.kind: "rigid" has no include_added_mass; take it out, or choose "elastic"',
        at='kind = "rigid"',
    ),
    refused(
        "resistance at an order that is none",
        'kind = "rigid"',
        'kind = "elastic"\nstiffness = 1e6\ndamping = 0.0\ninclude_added_mass = 1',
        "drive.include_added_mass: must be true or false, got 1; give true if the resistance of an elastic "
        "drive includes the added mass, F + a M, else false",
        at="include_added_mass = 1",
    ),
    refused(
        "elastic drive without its numbers",
        'kind = "rigid"',
        'kind = "elastic"',
        'drive.kind: "elastic" needs drive.stiffness and drive.damping, got none; give N/m and N s/m',
    ),
    refused(
        "spring that is none",
        'kind = "rigid"',
        'kind = "elastic"\ndamping = 0.0\nstiffness = 0.0',
        "drive.stiffness: must be positive, got 0.0; give the stiffness of an elastic drive in N/m",
        at="stiffness = 0.0",
    ),
    refused(
        "motor drive without a motor",
        'kind = "rigid"',
        'kind = "motor"',
        'drive.kind: "motor" needs the table [drive.motor], got none; give its curve, gear and inertias',
    ),
    refused(
        "motor of a rigid drive",
        "[cam]",
        MOTOR + "\n[cam]",
        'drive.kind: "rigid" has no motor; take the table [drive.motor] out, or choose "motor"',
        at='kind = "rigid"',
    ),
    refused(
        "slip of a straight curve",
        "[cam]",
        MOTOR.replace("kloss", "linear") + "\n[cam]",
        'drive.motor.breakdown_slip: is for drive.motor.curve "kloss", got 0.15 with "linear"; take it out',
        at="breakdown_slip",
        also=('kind = "rigid"', 'kind = "motor"'),
    ),
    refused(
        "belt too soft for its preload",
        "[cam]",
        MOTOR + BELT.replace("50000.0", "9000.0") + "\n[cam]",
        "drive.motor.belt.stiffness: must be at least 20*drive.motor.belt.preload = 10000 N",
        at="stiffness = 9000.0",
        also=('kind = "rigid"', 'kind = "motor"'),
    ),
    refused(
        "springs that meet",
        "[cam]",
        SPRINGS.replace("0.1", "0.3") + "\n[cam]",
        "drive.end_springs.length: must be at most half of motion.stroke = 0.4 m, got 0.3; give shorter springs",
        at="length = 0.3",
    ),
    refused(
        "hydraulic drive without its table",
        'kind = "rigid"',
        'kind = "hydraulic"',
        'drive.kind: "hydraulic" needs the table [drive.hydraulics], got none; give its cylinders, pump and oil',
    ),
    refused(
        "hydraulics of a rigid drive",
        "[cam]",
        HYDRAULICS + "\n[cam]",
        'drive.kind: "rigid" has no hydraulics; take the table [drive.hydraulics] out, or choose "hydraulic"',
        at='kind = "rigid"',
    ),
    refused(
        "two angles for one cart",
        "carts = 1",
        "angles = [0, 1.57]\ncarts = 1",
        "drive.angles: needs one angle per cart, drive.carts = 1, got 2; make the two agree",
    ),
    refused(
        "cam narrower than the stroke",
        "breadth = 0.9",
        "breadth = 0.4",
        "cam.breadth: must be greater than motion.stroke = 0.4 m, got 0.4; give a broader cam",
    ),
    refused(
        "torque on a roller that does not turn",
        '# roller_condition = "free"',
        'roller_torque = 5.0\nroller_condition = "sliding"',
        'machine.roller_torque: is for machine.roller_condition "free" or "driven", got 5 with "sliding"; take it out',
        at="roller_torque",
    ),
    refused(
        "bearings that drive",
        '# roller_condition = "free"',
        'roller_torque = 5.0\nroller_condition = "free"',
        'machine.roller_torque: must not be positive for a "free" roller, which bearings only brake, got 5; give -5',
        at="roller_torque",
    ),
    refused(
        "roller driven by nothing",
        '# roller_condition = "free"  ',
        'roller_condition = "driven" #',
        'machine.roller_torque: is missing, and the engine "fem" rolls a "driven" roller by it; give the torque on one',
        at="[machine]",
        also=('engine = "formula"', 'engine = "fem"'),
    ),
    refused(
        "roller in the base",
        "[accuracy]",
        "[contact]\nindentation = 0.22\n[accuracy]",
        "contact.indentation: must be below product.height = 0.22 m, got 0.22; the base lies there",
        at="indentation = 0.22",
    ),
    refused(
        "lift above the product",
        'base = "bonded"  ',
        'base = "bonded"\nlift_thickness = 0.3  ',
        "layer.lift_thickness: must be at most product.height = 0.22 m, got 0.3; without it the product is one lift",
        at="lift_thickness = 0.3",
    ),
    refused(
        "roller below a lift",
        'base = "bonded"  ',
        'base = "bonded"\nlift_thickness = 0.06  ',
        "contact.indentation: must be below layer.lift_thickness = 0.06 m, got 0.07; the base lies there",
        at="indentation = 0.07",
        also=("[accuracy]", "[contact]\nindentation = 0.07\n[accuracy]"),
    ),
    refused(
        "roller that does not touch",
        "[accuracy]",
        "[contact]\nload = 0.0\n[accuracy]",
        "contact.load: must be positive, got 0.0; give the normal force on one roller in N (zero means no contact)",
        at="load = 0.0",
    ),
    refused(
        "fields of a formula",
        '"figures", "cams"',
        '"fields", "cams"',
        'output.items: holds "fields", which accuracy.engine = "formula" does not compute; take it out, or',
    ),
    refused(
        "law twice",
        'laws = ["all"]',
        'laws = ["cubic", "crank", "cubic"]',
        "motion.laws: must not repeat an entry, got 'cubic' more than once; keep one of each",
    ),
    refused(
        "all beside others",
        'laws = ["all"]',
        'laws = ["all", "cubic"]',
        'motion.laws: "all" already holds every law, got it with others; write ["all"] or the names',
    ),
    refused(
        "no such table",
        'laws = ["all"]',
        'tables = ["no.csv"]\nlaws = ["all"]',
        "motion.tables: no such file: 'no.csv' under '.'; give CSV files relative to the scene file",
    ),
    # not TOML
    refused(
        "decimal comma",
        "roller_radius = 0.11",
        "roller_radius = 0,11",
        "not valid TOML at column 18: Expected newline or end of document after a statement, got "
        "'roller_radius = 0,11'; write `key = value`, texts in quotes, decimal point",
    ),
    refused(
        "unit behind the number",
        "mass = 1000.0",
        "mass = 1000.0 kg",
        "not valid TOML at column 15",
        "got 'mass = 1000.0 kg'; write",
        "units only in comments after #",
    ),
    refused(
        "text without quotes",
        'base = "bonded"',
        "base = bonded",
        "not valid TOML at column 8: Invalid value, got 'base = bonded'",
    ),
    refused(
        "key twice",
        "mass = 1000.0",
        "mass = 1000.0\nmass = 1.0 ",
        "not valid TOML at column 11: a key must be given once, got 'mass = 1.0'; take one of the two out",
        at="mass = 1.0 ",
    ),
    refused(
        "table twice",
        "[mix.overrides]",
        "[machine] # again",
        "not valid TOML at column 9: a table must be given once, got '[machine]'; put its keys together",
        at="[machine] # again",
    ),
    refused(
        "key as table",
        "[product]",
        "[product.x]",
        "product.x: unknown table in [product], got a table",
        at="[product.x]",
    ),
    refused(
        "table like no other",
        "[product]\n",
        "[other]\n",
        "other: unknown table at the top of the file, before any table, got a table; take it out, or choose from",
    ),
]


PLIES = "plies = [ { thickness = 0.16, relative_modulus = 2.0 }, { thickness = 0.06, relative_modulus = 1.0 } ]"


def with_plies(plies=PLIES, engine="fem"):
    text = PUBLISHED.replace('engine = "formula"', f'engine = "{engine}"')
    return text.replace('base = "bonded"', f'base = "bonded"\n{plies}', 1)


def test_plies_are_read_from_either_form_of_table():
    tables = "".join(
        f"[[layer.plies]]\nthickness = {d}\nrelative_modulus = {c}\n" for d, c in ((0.16, 2.0), (0.06, 1.0))
    )
    scene = parse_scene(with_plies())
    assert [(ply.thickness, ply.relative_modulus) for ply in scene.layer.plies] == [(0.16, 2.0), (0.06, 1.0)]
    assert parse_scene(with_plies("") + tables) == scene


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (with_plies(PLIES.replace("0.06", "0.05")), "layer.plies: must be product.height = 0.22 m thick together, got"),
        (with_plies(PLIES.replace("0.06", "-0.06")), "layer.plies[1].thickness: must be positive, got -0.06; give the"),
        (
            with_plies(PLIES.replace("2.0", '"hard"')),
            "layer.plies[0].relative_modulus: must be a number, got 'hard'; give",
        ),
        (
            with_plies(PLIES.replace("2.0", "1" + "0" * 400)),
            "layer.plies[0].relative_modulus: must be finite and below",
        ),
        (with_plies(PLIES.replace("0.06", "1" + "0" * 308)), "0.22 m thick together, got 1e+308; change one"),
        (
            with_plies(PLIES.replace("relative_modulus = 1.0", "E = 1")),
            "layer.plies[1].relative_modulus: is missing; give the",
        ),
        (
            with_plies(PLIES.replace("relative_modulus", "relative_modulu")),
            "unknown key in [layer.plies], got 2.0; did you mean",
        ),
        (with_plies("plies = [0.22]"), "layer.plies[0]: must be a table, got 0.22; write { thickness = …, relative"),
        (with_plies("plies = 0.22"), "layer.plies: must be a list, got 0.22; give the plies from the base upwards"),
        (with_plies("plies = []"), "layer.plies: must have at least 1 entry, got 0; give the plies"),
        (
            with_plies(engine="formula"),
            'the engine "formula" takes no 2 plies, as it has one modulus for the whole layer; take the key out, or '
            'choose accuracy.engine = "spectral" or "fem"',
        ),
    ],
    ids=[
        *("sum", "negative", "text", "monstrous", "too-thick", "missing", "unknown", "entry", "list", "none"),
        "engine",
    ],
)
def test_invalid_plies_are_refused_at_their_line(text, words):
    mistakes = mistakes_of(text)
    assert any(words in mistake for mistake in mistakes), mistakes
    assert all(":" in mistake.removeprefix(FILE)[:5] for mistake in mistakes)  # the line is told


def mistakes_of(text, file=FILE):
    with pytest.raises(SceneError) as caught:
        parse_scene(text, file)
    return caught.value.mistakes


@pytest.mark.parametrize(("text", "line", "words"), BROKEN)
def test_a_refusal_states_place_rule_value_and_remedy(text, line, words):
    mistakes = mistakes_of(text)
    blamed = [mistake for mistake in mistakes if mistake.startswith(f"{FILE}:{line}: {words[0]}")]
    assert blamed, mistakes
    assert [word for word in words if word not in blamed[0]] == []


@pytest.mark.parametrize(
    ("number", "got"),
    [("1" + "0" * 400, "1" + "0" * 59 + "…"), ("0x" + "f" * 9000, "a number of thousands of digits")],
    ids=["beyond a float", "beyond printing"],
)
def test_a_monstrous_number_is_refused_in_few_words(number, got):
    assert mistakes_of(edited("mass = 1000.0", f"mass = {number}")) == (
        f"{FILE}:6: machine.mass: must be finite and below 1.8e308, got {got}; give the mass m of the cart in kg",
    )


def test_whole_numbers_near_the_largest_float_are_compared_like_any_other():
    number = "1" + "0" * 308
    mistakes = mistakes_of(edited("roller_radius = 0.11", f"roller_radius = {number}"))
    assert any("roller too large for the stroke" in mistake and "got inf" in mistake for mistake in mistakes)


def test_a_missing_table_has_no_line_but_its_name():
    start, end = PUBLISHED.index("[product]"), PUBLISHED.index("[mix]")
    assert mistakes_of(PUBLISHED[:start] + PUBLISHED[end:]) == (
        f"{FILE}: product: the table [product] is missing; "
        "add it with its keys (`compact new DIR` writes a commented scene)",
    )


def test_output_of_cams_requires_a_cam():
    start, end = PUBLISHED.index("[cam]"), PUBLISHED.index("[accuracy]")
    assert mistakes_of(PUBLISHED[:start] + PUBLISHED[end:]) == (
        f'{FILE}: cam: the table [cam] is missing, and output.items holds "cams"; give [cam] with breadth and '
        'roller_follower_radius in m, or take "cams" out',
    )


def test_run_up_and_run_down_of_a_half_fill_the_pass(published):
    full = published.replaced(**{"motion.run_up": 0.5, "motion.run_down": 0.5})
    assert full.motion.run_up + full.motion.run_down == 1


@pytest.mark.parametrize("user", ["laws", "kind", "wanted"])
def test_each_use_of_the_crank_requires_the_rod(published, user):
    base = {"motion.laws": ["cubic"], "drive.kind": "rigid", "output.items": [], "motion.rod_length": None}
    asks = {"laws": ("motion.laws", ["crank"]), "kind": ("drive.kind", "crank"), "wanted": ("output.items", ["crank"])}
    path, value = asks[user]
    with pytest.raises(SceneError, match=f"motion.rod_length: is missing, and {path} .*give the length of the conn"):
        published.replaced(**{**base, path: value})


def test_a_line_is_right_after_comments_and_strings_that_look_like_toml():
    text = edited("[machine]", "# [x] {\n[machine] # ] [[\n", edited("two rollers, rigid", "[[ # two = {"))
    text = edited("guide_positions = [0.37, -0.37] ", "guide_positions = [ # [\n0.37,\n-0.37, # }\n] ", text)
    text = edited("carts = 1", "'carts' = 0", text)
    line = text[: text.index("'carts'")].count("\n") + 1
    assert mistakes_of(text)[0].startswith(f"{FILE}:{line}: drive.carts: must be between 1 and 4, got 0")


LONG = 300_000  # characters; a scanner of cubic or quadratic time would not end


@pytest.mark.parametrize(
    "filling",
    [" " * LONG, " " * LONG + "\n", f"#{' ' * LONG}\n", "# remark\n" * (LONG // 3), f"x = [{' ' * LONG}]\n[drive]\n"],
    ids=["blanks before a key", "line of blanks", "blank comment", "many comments", "blanks in a list"],
)
def test_lines_and_remarks_of_long_texts_are_found_in_linear_time(filling):
    text = f"[drive]\n{filling}carts = 1 # one\n"
    key, line = ("drive", "carts"), text[: text.index("carts")].count("\n") + 1
    assert key_lines(text)[key] == line
    assert key_remarks(text)[key] == "one"


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
    # the misspelt key is also missing, which is said at its table
    assert blamed == {re.sub(r"^\[.*", "guide_positions = [-0.37, 0.37]", new) for new in TEN.values()} | {"[machine]"}
    assert len(mistakes) == len(TEN) + 1
    assert mistakes_of(text) == tuple(str(SceneError(mistakes)).split("\n"))


def test_a_rule_between_keys_is_skipped_for_a_refused_key():
    mistakes = mistakes_of(edited("stroke = 0.4 ", "stroke = -0.4 "))
    assert mistakes == (
        f"{FILE}:53: motion.stroke: must be positive, got -0.4; give the travel between the two ends in m",
    )


# (h) files


def test_a_missing_file_is_refused_with_a_similar_name():
    with pytest.raises(SceneError, match=r"loveikin-2051\.toml: no such file; did you mean 'loveikin-2015\.toml'\?"):
        load_scene(SCENES / "loveikin-2051.toml")


def test_a_missing_file_in_an_empty_folder_points_to_the_starter(tmp_path):
    with pytest.raises(SceneError, match=r"a\.toml: no such file; `compact new DIR` writes a scene to start from"):
        load_scene(tmp_path / "a.toml")


def test_a_directory_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"is a directory; give the scene file in it, DIR/NAME\.toml"):
        load_scene(tmp_path)


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000])
def test_an_impossible_name_is_refused(name):
    with pytest.raises(SceneError, match=r"cannot be read: .*; give the path of a scene file"):
        load_scene(name)


def test_a_table_of_an_impossible_name_is_refused():
    name = "x" * 5000
    assert "motion.tables: no such file: 'xxxx" in mistakes_of(edited("dwell =", f"tables = ['{name}']\ndwell ="))[0]


def test_a_table_that_went_away_is_refused_by_the_hash(tmp_path):
    (tmp_path / "own.csv").write_text("0,0\n1,1\n")
    scene = parse_scene(edited("dwell =", "tables = ['own.csv']\ndwell ="), str(tmp_path / "scene.toml"))
    (tmp_path / "own.csv").unlink()
    with pytest.raises(SceneError, match=r"own\.csv: no such file"):
        _ = scene.hash


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "scene.toml: is empty; `compact new DIR` writes a commented scene to start from"),
        (b" \n\n", "scene.toml: is empty"),
        (b"\xef\xbb\xbf[machine]\n", "scene.toml:1: starts with a byte-order mark; save the file as UTF-8 without BOM"),
        (b"# one\n# caf\xe9\n", "scene.toml:2: not UTF-8 text (byte 0xe9); save the file as UTF-8"),
        ("title".encode("utf-16"), "scene.toml:1: not UTF-8 text (byte 0xff); save the file as UTF-8"),
        (b"a = " + b"[" * 5000, "scene.toml: not valid as a scene: brackets nested too deep"),
        (b"a = [1", "scene.toml: not valid TOML: Unclosed array; is a quote or a bracket left open at the end?"),
        (b"a = " + b"9" * 5000, "scene.toml: not valid TOML: a whole number has thousands of digits"),
        (b"# nothing\n", "scene.toml: machine: the table [machine] is missing"),
    ],
    ids=["empty", "blank", "mark", "latin-1", "utf-16", "deep", "open", "long number", "comment only"],
)
def test_a_file_that_is_no_scene_is_refused(tmp_path, content, words):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
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


@given(st.text())
@settings(deadline=None)
def test_any_text_is_a_scene_or_refused(text):
    assert made_or_refused(parse_scene, text)


@given(st.integers(0, len(PUBLISHED)), st.integers(0, 40), st.text(alphabet="[]{}=\"'#.,\n\\ ax0-_e+", max_size=12))
@examples(40, slow=300)
def test_any_damage_to_a_scene_is_refused_or_harmless(start, length, text):
    assert made_or_refused(parse_scene, PUBLISHED[:start] + text + PUBLISHED[start + length :])


@given(st.binary())
@settings(deadline=None)
def test_any_bytes_are_a_scene_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "junk.toml"
    path.write_bytes(content)
    assert made_or_refused(load_scene, path)


paths = st.sampled_from([*LEAVES, *Scene.model_fields, "mix.overrides", "motion.tables", "drive.angles"])


@given(st.dictionaries(paths | st.text(max_size=12), junk, max_size=4))
@examples(40, slow=300)
def test_any_change_makes_a_scene_or_is_refused(published, changes):
    assert made_or_refused(published.replaced, **changes)


# (j) neighbours


def test_reading_a_scene_loads_no_heavy_library():
    """Start-up: 0.3 s for the whole command; scipy and matplotlib cost more than that each."""
    code = (
        "import sys, compact.scene.loader; print(sorted({'scipy', 'matplotlib', 'skfem', 'pandas'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


LOWER_LIFT = "\n[layer.lower_lift]\nthickness = 0.06\ndensity_ratio = 0.98\n"


def test_lower_lift_is_read_for_engines_that_compact():
    scene = parse_scene(with_plies("", "column") + LOWER_LIFT)
    assert scene.layer.lower_lift.model_dump() == {"thickness": 0.06, "density_ratio": 0.98, "residual_stress": True}


@pytest.mark.parametrize(
    ("engine", "table", "message"),
    [
        ("fem", LOWER_LIFT, 'layer.lower_lift: the engine "fem" takes no lower lift, as its layer does not compact'),
        ("spectral", LOWER_LIFT, 'the engine "spectral" takes no lower lift'),
        ("formula", LOWER_LIFT, 'take the key out, or choose accuracy.engine = "column" or "compaction"'),
        ("column", LOWER_LIFT.replace("0.98", "0.9"), "density_ratio: must be above layer.fed_density_ratio = 0.94"),
        ("column", LOWER_LIFT.replace("0.06", "-0.06"), "layer.lower_lift.thickness: must be positive, got -0.06"),
        ("column", LOWER_LIFT.replace("0.06", "60"), "thickness: 60 m is far outside the plausible 0.005 to 2 m"),
        ("column", LOWER_LIFT + "residual_stress = 1\n", "layer.lower_lift.residual_stress: must be true or false"),
        ("column", LOWER_LIFT.replace("density_ratio = 0.98", ""), "layer.lower_lift.density_ratio: is missing"),
    ],
)
def test_impossible_lower_lifts_are_refused(engine, table, message):
    with pytest.raises(SceneError, match=re.escape(message)):
        parse_scene(with_plies("", engine) + table)


# the law of the mix


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"mix.overrides.friction_angle": 46.0},
            r"coefficient: must be between 0\.2\d+ and 0\.\d+ .* 46 ",
        ),
        (
            {"mix.overrides.friction_angle": 45.0, "mix.overrides.cohesion_loose": 0.0},
            "45 degrees and a cohesion of 0 kPa at 2.* kPa, got 0.2929: .*friction_angle or .*cohesion_loose",
        ),
        ({"mix.overrides.earth_pressure_coefficient": 0.3}, "must be between .* got 0.3: below, mix in confined"),
        ({"mix.overrides.dilatancy_angle": 36.0}, "`dilatancy_angle` must lie between 0 and `friction_angle`"),
    ],
    ids=["friction 46", "friction 45", "K0 0.3", "dilatancy"],
)
def test_drucker_prager_cap_refuses_angles_without_a_cap(published, changes, words):
    with pytest.raises(SceneError, match=words):
        published.replaced(**{"mix.law": "drucker-prager-cap"} | changes)
    published.replaced(**changes)  # no limits of the ellipse


def test_drucker_prager_cap_of_the_prior_is_accepted(published):
    from compact.analysis.contact_cases import compaction_material, scene_mix

    scene = published.replaced(**{"mix.law": "drucker-prager-cap", "mix.overrides.cohesion_loose": 5e3})
    law = compaction_material(scene, scene_mix(scene))
    assert law.tensile_strength == pytest.approx(5e3 / math.tan(math.radians(35)))
    assert law.shear_viscosity == 600.0
    assert law.dilatancy_slope == 0.0
