"""Case of a plant: a scene with [case] and a CSV of trials; every broken line is refused with file, line and rule."""

from pathlib import Path

import pytest

from compact.analysis.contact_cases import roll_scene, scene_mix
from compact.scene.loader import load_scene
from compact.validation.plant_case import read_plant_case, select_cases

SCENE = (Path(__file__).parents[2] / "compact" / "data" / "scenes" / "small.toml").read_text("utf-8")
CASE = """
[case]
title = "Slab of line 2"
source = "load cells on both axles"
licence = "internal"
expected = {load = 0.2, resistance_coefficient = 0.3, exit_density_ratio = 0.01}
"""
TABLE = """layer.fed_density_ratio, load, load_scatter, exit_density_ratio
# first day
0.94, 11000, 300, 0.98
0.93, 14000, ,
"""


@pytest.fixture
def folder(tmp_path):
    def written(case=CASE, table=TABLE, scene=SCENE):
        column = scene.replace('engine = "formula"', 'engine = "column"')
        (tmp_path / "line2.toml").write_text(column + case, encoding="utf-8")
        (tmp_path / "trials.csv").write_text(table, encoding="utf-8")
        return tmp_path

    return written


def test_a_plant_case_is_computed_by_the_engine_of_its_scene(folder):
    place = folder()
    (case,) = select_cases([str(place)])
    assert case.engines == ("column",)
    result = case.evaluated()
    rows = [*result.rows.values()]
    assert [each.key for each in rows] == ["line_3_load", "line_3_exit_density_ratio", "line_4_load"]
    (place / "scene").mkdir()
    plain = (place / "line2.toml").read_text("utf-8").split("\n[case]")[0]
    (place / "scene" / "plain.toml").write_text(plain, encoding="utf-8")
    scene = load_scene(place / "scene" / "plain.toml", **{"layer.fed_density_ratio": 0.93})
    contact = roll_scene(scene, scene_mix(scene), scene.mean_speed)
    assert rows[2].ours == pytest.approx(contact.load * scene.machine.roller_length, rel=1e-12)
    assert rows[0].scatter == 300
    assert not any(each.moved for each in rows)
    assert case.source == "load cells on both axles; internal"
    assert len(result.panels) == 2


def test_calibrated_scenes_say_so(folder):
    case = read_plant_case(folder(CASE + 'fitted = "heckel_slope to line 3"\n'))
    assert {each.basis for each in case.rows.values()} == {"fitted: heckel_slope to line 3"}


@pytest.mark.parametrize(
    ("table", "match"),
    [
        ("load, weight\n1, 2\n", r"trials.csv:2: no column `weight`; a column is a scene key"),
        ("resistance\n10\n", r"trials.csv:2: no column `resistance`; .* need a distance in `expected`"),
        ("layer.fed_density_ratio\n0.94\n", r"trials.csv:2: nothing is measured"),
        ("load\nheavy\n", r"trials.csv:2: `load` must be a number, got 'heavy'"),
    ],
)
def test_broken_tables_are_refused_with_file_line_and_rule(folder, table, match):
    with pytest.raises(ValueError, match=match):
        read_plant_case(folder(table=table))
