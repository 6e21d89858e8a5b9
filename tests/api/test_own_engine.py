"""Engines of other packages by entry points: a tiny installed distribution."""

import sys

import pytest
from entry_points import install

import compact
from compact.engines import ENGINES

SMALL = "compact/data/scenes/small.toml"
PACKAGE = '''
import dataclasses
from compact.engines.column.engine import roll
from compact.engines.interface import Engine, Limit

class Winkler(Engine):
    name, takes, mix_parameters = "winkler", "compacting layer", ("heckel_slope",)
    limits = (Limit("layer.base", ("bonded",), "springs do not slip"),)

    def contact(self, case, start=None):
        """Return twice the load of columns."""
        found = roll(case.layer, dataclasses.replace(case.roller, rolling="frictionless"), case.material, case.speed)
        return dataclasses.replace(found, load=2 * found.load)

WINKLER = Winkler()
MISNAMED = "no engine"
'''


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install a distribution with one engine, and one faulty entry point, in a folder of the path."""
    install(tmp_path, "winkler_engine", PACKAGE, "compact.engines", winkler="WINKLER", broken="MISNAMED")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("winkler_engine", None)


def test_engine_of_another_package_rolls(installed):
    scene = compact.load_scene(SMALL, **{"accuracy.engine": "winkler"})
    assert {*ENGINES} >= {"column", "winkler", "broken"}
    columns = scene.roll(0.2, engine="column")
    found = scene.roll(0.2)
    assert found.engine == "winkler"
    assert found[0].load == pytest.approx(2 * columns[0].load)
    assert scene.replaced(**{"mix.moisture": 0.11}).accuracy.engine == "winkler"
    assert scene.hash != scene.replaced(**{"accuracy.engine": "column"}).hash


def test_engine_of_another_package_is_compared(installed, tmp_path):
    few = {"motion.laws": ["cubic"], "contact.speeds": [0.05, 0.2], "output.items": ["tables"]}
    scene = compact.load_scene(SMALL, **{"accuracy.engine": "column", "compare": {"winkler": {}}} | few)
    assert [*scene.run(tmp_path / "out").places_by_engine] == ["column", "formula", "winkler"]
    assert (tmp_path / "out" / "comparison" / "winkler").is_dir()
    with pytest.raises(compact.SceneError, match='the engine "winkler" takes no "slip", as springs do not slip'):
        scene.replaced(compare={"winkler": {"layer": {"base": "slip"}}})
    with pytest.raises(compact.SceneError, match=r"compare\.spring: unknown"):
        scene.replaced(compare={"spring": {}})
