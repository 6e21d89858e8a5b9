"""Tables over the density from a CSV file: the example, every rule with file and line, and the rules of the scene."""

from pathlib import Path

import pytest

from compact.scene.cap_tables import COLUMNS, read_cap_tables
from compact.scene.loader import SceneError, load_scene
from compact.validation.powder import ph102

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
HEADER = ",".join(COLUMNS)
ROWS = ("0.8,20e3,20e3,45,0.35,120e6,0.3", "0.9,50e3,20e3,45,0.35,120e6,0.3", "0.99,170e3,20e3,45,0.35,,")


def read(folder, *lines):
    path = folder / "cap.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return read_cap_tables(path)


def test_the_example_has_the_tables_of_the_validation():
    tables, published = read_cap_tables(SCENES / "avicel-ph102.csv"), ph102()
    for name in ("density_ratio", "yield_pressure", "cohesion", "friction_angle", "eccentricity"):
        assert getattr(tables, name) == pytest.approx(getattr(published, name), rel=1e-6)
    for name in ("elastic_density_ratio", "youngs_modulus", "poisson"):
        assert getattr(tables, name) == pytest.approx(getattr(published, name), rel=1e-6)


def test_cells_of_cap_and_elastic_constants_may_be_in_rows_of_their_own(tmp_path):
    tables = read(tmp_path, "# remark", HEADER, *ROWS)
    assert tables.density_ratio == (0.8, 0.9, 0.99)
    assert tables.elastic_density_ratio == (0.8, 0.9)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ((), "has no header"),
        (("density_ratio,pressure",), r"cap.csv:1: the columns must be density_ratio,yield_pressure"),
        ((HEADER, ROWS[0]), "at least two rows of the cap, got 1"),
        ((HEADER, *ROWS, "0.995,1"), r"cap.csv:5: must have 7 cells, got 2"),
        ((HEADER, ROWS[0].replace("20e3,20e3", "x,20e3")), r"cap.csv:2: `yield_pressure` must be a number, got 'x'"),
        ((HEADER, ROWS[0].replace("45", "90")), r"`friction_angle` must be above 0 and below 90, got 90"),
        ((HEADER, ROWS[0].replace("45", "")), r"cap.csv:2: lacks `friction_angle`; fill"),
        ((HEADER, "0.8,,,,,,"), r"cap.csv:2: must have a `density_ratio` and"),
        ((HEADER, *ROWS[:2], ROWS[0]), r"cap.csv:4: `density_ratio` must ascend, got 0.8 after 0.9"),
        ((HEADER, ROWS[0], ROWS[1].replace("50e3", "19e3")), r"cap.csv:3: `yield_pressure` must ascend"),
        ((HEADER, ROWS[0].replace("0.35", "1.5"), ROWS[1]), r"cap.csv:2: the pressure at the top of the cap"),
    ],
)
def test_foreign_tables_are_refused_with_file_line_and_rule(tmp_path, lines, words):
    with pytest.raises(ValueError, match=words):
        read(tmp_path, *lines)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mix.cap_table": None}, "mix.cap_table: is missing, and mix.law is"),
        ({"mix.cap_table": "none.csv"}, "cannot be read: No such file"),
        ({"mix.law": "ellipse"}, 'is for mix.law "density-cap"; take it out'),
        ({"layer.fed_density_ratio": 0.79}, "has tables from 0.8 to 0.995, which must begin below"),
        ({"output.items": ("model_spread",)}, "has tables in their place"),
    ],
)
def test_scenes_that_contradict_their_tables_are_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        load_scene(SCENES / "density-cap.toml", **changes)


def test_the_hash_contains_the_tables(tmp_path):
    text = (SCENES / "density-cap.toml").read_text("utf-8").replace("concrete-cap.csv", "cap.csv")
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    read(tmp_path, HEADER, *ROWS)
    before = load_scene(tmp_path / "scene.toml").hash
    read(tmp_path, HEADER, *ROWS, "0.995,210e3,20e3,45,0.35,,")
    assert load_scene(tmp_path / "scene.toml").hash != before
