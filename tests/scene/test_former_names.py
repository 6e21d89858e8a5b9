"""Former names of scene keys: accepted with a warning that states the new name, and the same scene."""

from pathlib import Path

import pytest

from compact.scene.loader import SceneError, load_scene, parse_scene
from compact.sweep.design import read_design

SMALL = (Path(__file__).parents[2] / "studies" / "scenes" / "small.toml").read_text("utf-8")
PRESENT = (
    SMALL.replace('# roller_condition = "free" ', 'roller_condition = "frictionless" #')
    .replace('# gap_geometry = "deformed" ', 'gap_geometry = "parabola" #')
    .replace('base = "bonded"', 'base = "bonded"\nlift_thickness = 0.06')
    + '\n[compare.spectral.machine]\nroller_condition = "sliding"\n'
)
FORMER = (
    PRESENT.replace("roller_condition", "rolling")
    .replace("gap_geometry", "profile")
    .replace("lift_thickness", "lift")
    .replace("[compare.", "[beside.")
    .replace("items = ", "wanted = ")
)
RENAMED = ("beside", "layer.lift", "machine.profile", "machine.rolling", "output.wanted")


def test_a_scene_with_former_keys_is_the_scene_with_present_keys():
    with pytest.warns(DeprecationWarning, match="for one release") as caught:
        scene = parse_scene(FORMER, "old.toml")
    assert scene == parse_scene(PRESENT)
    messages = [str(warning.message) for warning in caught]
    for key in (*RENAMED, "compare.spectral.machine.rolling"):
        assert any(f"`{key}` is now `" in message for message in messages), key
    line = FORMER.split("\n").index(next(row for row in FORMER.split("\n") if row.startswith("wanted = "))) + 1
    assert (
        f"old.toml:{line}: `output.wanted` is now `output.items`; the former name is accepted for one release"
        in messages
    )


def test_a_mistake_under_a_former_key_names_its_line():
    broken = FORMER.replace('wanted = ["tables", "report"]', 'wanted = ["pictures"]')
    line = broken.split("\n").index(next(row for row in broken.split("\n") if row.startswith("wanted = "))) + 1
    with (
        pytest.warns(DeprecationWarning, match="for one release"),
        pytest.raises(SceneError, match=rf"old.toml:{line}: output.items\[0\]: must be"),
    ):
        parse_scene(broken, "old.toml")


def test_a_key_under_both_names_is_refused():
    both = SMALL.replace("items = ", "wanted = []\nitems = ")
    with pytest.raises(
        SceneError, match=r"output.wanted: is the former name of output.items, .* take one of the two out"
    ):
        parse_scene(both)


def test_a_caller_may_change_former_keys(tmp_path):
    (tmp_path / "scene.toml").write_text(PRESENT)
    motor = {"curve": "straight", "torque": 60.0, "speed": 157.0, "gear_ratio": 150.0, "inertia": 0.01}
    with pytest.warns(DeprecationWarning, match="for one release"):
        scene = load_scene(
            tmp_path / "scene.toml",
            **{
                "machine.rolling": "free",
                "beside": {"spectral": {"machine": {"profile": "circle", "rolling": "sliding"}}},
            },
        )
    assert scene.machine.roller_condition == "free"
    assert scene.with_engine("spectral").machine.gap_geometry == "circle"
    driven = scene.replaced(**{"drive.kind": "motor", "drive.motor": motor | {"flywheel_inertia": 50.0}})
    assert driven.drive.motor.curve == "linear"


def test_former_keys_of_plies_and_of_a_sweep():
    plies = [{"thickness": 0.2, "stiffness": 2.0}, {"thickness": 0.02, "stiffness": 1.0}]
    layered = {
        "accuracy.engine": "fem",
        "layer.lift_thickness": None,
        "compare": None,
        "machine.gap_geometry": "deformed",
    }
    scene = parse_scene(PRESENT).replaced(**layered, **{"layer.plies": plies})
    assert [ply.relative_modulus for ply in scene.layer.plies] == [2.0, 1.0]
    with pytest.warns(DeprecationWarning, match="`layer.lift` is now `layer.lift_thickness`"):
        assert read_design("layer.lift=0.05:0.06:2").key == "layer.lift_thickness"


def test_a_former_choice_of_a_list_is_renamed(tmp_path):
    text = SMALL.replace('rank_by = ["peak_force", "peak_power"]', 'rank_by = ["peak_force", "ringing"]')
    with pytest.warns(DeprecationWarning, match=r'"ringing" of `drive.rank_by` is now "dynamic_amplification"'):
        assert parse_scene(text).drive.rank_by == ("peak_force", "dynamic_amplification")


def test_rate_exponent_is_the_rate_sensitivity():
    former = SMALL.replace("[mix.overrides]", "[mix.overrides]\nrate_exponent = 0.018", 1)
    former += "\n[compare.column.mix.overrides]\nrate_exponent = 0.02\n"
    with pytest.warns(DeprecationWarning, match="rate_sensitivity`; the former name is accepted for one release"):
        scene = parse_scene(former)
    assert scene.mix.overrides.rate_sensitivity == 0.018
    assert scene.with_engine("column").mix.overrides.rate_sensitivity == 0.02


def test_reference_speed_is_refused_with_its_remedy():
    words = r"mix.reference_speed: is no longer a key, got 0.13: .*take the key out, and multiply a slope .* about 1.1"
    with pytest.raises(SceneError, match=words):
        parse_scene(SMALL.replace("moisture = ", "reference_speed = 0.13\nmoisture = ", 1))
    with pytest.raises(SceneError, match=words):
        parse_scene(SMALL).replaced(**{"mix.reference_speed": 0.13})
