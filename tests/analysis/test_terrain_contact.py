"""Wheel of a scene on terrain: registry of soils, own constants, files of the command, refusals with file and line."""

import json
from pathlib import Path

import numpy as np
import pytest

from compact.analysis.contact_cases import roll_on_terrain
from compact.analysis.engines import ENGINES
from compact.cli.program import roll
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene
from compact.scene.terrain_data import build_terrain, published_terrains, read_terrain

SCENE = Path(__file__).parents[2] / "studies" / "scenes" / "small.toml"
OWN = """[terrain]
law = "bekker"
cohesive_modulus = 990.0
frictional_modulus = 1.52843e6
exponent = 1.1
cohesion = 1040.0
friction_angle = 28.0
shear_displacement = 0.02
"""


def scene(**changes):
    return load_scene(SCENE, **{"accuracy.engine": "column", "contact.load": 3000.0} | changes)


def test_every_published_soil_carries_a_wheel():
    layer, roller = Layer(1.0), Roller(0.3, indentation=0.02)
    for name, constants in published_terrains().items():
        found = ENGINES["column"].roll(layer, roller, build_terrain(constants, 0.2), 1.0, slip=0.2)
        assert found.load > 0, name
        assert max(found.error) < 1e-9, name
        assert len(constants["source"]) > 20


def test_a_scene_rolls_on_a_soil_without_torque():
    found = roll_on_terrain(scene(), "dry-sand-lll")
    assert found.result.load * found.width == pytest.approx(3000.0, rel=1e-9)
    assert found.result.torque == pytest.approx(0, abs=1e-6)
    assert found.result.slip < 0
    assert (np.diff(found.slip_curve[:, 1]) > 0).all()
    slip = roll_on_terrain(scene(), "dry-sand-lll", slip=0.4).result.drawbar * found.width
    assert slip == pytest.approx(float(np.interp(0.4, found.slip_curve[:, 0], found.slip_curve[:, 1])), rel=1e-9)


def test_own_constants_are_those_of_the_registry(tmp_path):
    (tmp_path / "soil.toml").write_text(OWN)
    own = roll_on_terrain(scene(), str(tmp_path / "soil.toml"), slip=0.1).result
    assert own.drawbar == roll_on_terrain(scene(), "dry-sand-lll", slip=0.1).result.drawbar


def test_a_table_without_shear_and_with_rebound(tmp_path):
    z = np.linspace(0, 0.06, 61)
    pressure = (1e6 * z).tolist()
    text = f'[terrain]\nlaw = "table"\nsinkage = {z.tolist()}\npressure = {pressure}\nrebound_modulus = 1e7\n'
    (tmp_path / "table.toml").write_text(text)
    found = roll_on_terrain(scene(), str(tmp_path / "table.toml"))
    assert np.isnan(found.result.slip)
    assert found.result.exit_angle < 0
    assert not found.slip_curve.size


def test_the_command_writes_its_files(tmp_path, capsys):
    roll(SCENE, material="sandy-loam-15-lll", slip=0.2, changes=("contact.load=9740",), out=tmp_path / "wheel")
    assert "drawbar" in capsys.readouterr().out
    summary = json.loads((tmp_path / "wheel" / "contact.json").read_text())
    assert summary["load"] == {"value": pytest.approx(9740), "unit": "N"}
    assert summary["slip"]["value"] == 0.2
    assert {path.name for path in (tmp_path / "wheel").iterdir()} >= {"contact.csv", "slip.csv", "contact.png"}


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (OWN.replace("bekker", "berker"), r":2: \[terrain\] `law` must be one of"),
        (OWN + "width = 0.2\n", r":9: \[terrain\] has no key `width`"),
        (OWN.replace("= 28.0", '= "steep"'), r":7: \[terrain\] `friction_angle` must be a number, got 'steep'"),
        (OWN.replace("cohesion = 1040.0\n", ""), r"\[terrain\] must state `cohesion` too"),
        (OWN.replace("exponent = 1.1\n", ""), r"\[terrain\] must state `exponent` too"),
        ("[soil]\n", r"has no table \[terrain\]"),
        ("[terrain\n", r":1: not valid TOML"),
    ],
)
def test_broken_constants_are_refused_with_file_line_and_rule(tmp_path, text, match):
    (tmp_path / "soil.toml").write_text(text)
    with pytest.raises(ValueError, match=r"soil\.toml.*" + match):
        read_terrain(str(tmp_path / "soil.toml"))


@pytest.mark.parametrize(
    ("act", "match"),
    [
        (lambda: read_terrain("dry-sand"), "did you mean 'dry-sand-lll'"),
        (lambda: read_terrain("/nowhere/soil.toml"), "cannot be read"),
        (lambda: roll_on_terrain(load_scene(SCENE), "dry-sand-lll"), "needs one of contact.load"),
        (lambda: roll(SCENE, slip=0.1), "--slip 0.1 needs --material"),
        (lambda: roll(SCENE, material="dry-sand-lll", engine="fem"), "needs the engine column, got fem"),
    ],
)
def test_foreign_requests_are_refused(act, match):
    with pytest.raises(ValueError, match=match):
        act()
