"""Keys that an engine replaces or refuses: the table agrees with the engines, and the results say what was replaced."""

import json
from itertools import product
from pathlib import Path
from typing import get_args

import pytest

from compact.analysis.contact_cases import contact_inputs
from compact.analysis.study import Study
from compact.cli import program as cli
from compact.engines import BUILT_IN, formula
from compact.engines.compaction import engine as compaction
from compact.engines.fem import engine as fem_engine
from compact.rolling_contact import BaseCondition, GapGeometry, Layer, Ply, Roller, RollerCondition
from compact.scene.constraints import adapt
from compact.scene.loader import load_scene

SPEED = 0.1


def doors(engine, layer, roller, material):
    """Call what an engine refuses before it computes."""
    if engine == "formula":
        formula.roll(layer, roller, material, SPEED)
    elif engine in ("column", "spectral"):
        BUILT_IN[engine].require(layer, roller, SPEED)
    elif engine == "fem":
        fem_engine.require_linear_range(layer, roller, material, SPEED, None, 0.01)
    else:
        compaction.require_compactable(layer, roller, material, SPEED)


def taken(engine, key, value, friction):
    return all(limit.takes(value, friction) or limit.fixed for limit in BUILT_IN[engine].limits if limit.key == key)


@pytest.mark.parametrize("engine", [engine for engine in BUILT_IN if engine != "process"])
@pytest.mark.parametrize("friction", [0.0, 0.35])
def test_table_and_engines_accept_the_same_values(engine, friction):
    study = Study(load_scene("small", **{"mix.overrides.steel_friction": friction}))
    layer, _, material = contact_inputs(study.scene, study.stages.contacts.mix, engine, SPEED)
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


def test_formulas_meet_a_prescribed_load():
    load = 15000.0
    study = Study(load_scene("small", **{"contact.load": load}))
    assert study.stages.contacts.engineering.roller_force == pytest.approx(load, rel=1e-12)
    assert study.stages.contacts.numbers["roller_force"].low is None
    assert study.stages.contacts.numbers["pressure"].known_by.startswith("contact: as prescribed")
