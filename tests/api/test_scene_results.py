"""Python interface: results of a scene as tables, datasets, figures and meshes, equal to those of a study."""

import ast
from pathlib import Path

import numpy as np
import pytest
import xarray
from matplotlib.figure import Figure

import compact

SPEEDS = (0.05, 0.1, 0.2)


@pytest.fixture(scope="module")
def scene():
    return compact.load_scene("small", **{"accuracy.engine": "column", "drive.rank_by": ["peak_force"]})


@pytest.fixture(scope="module")
def contacts(scene):
    return scene.roll(SPEEDS)


def test_contacts_equal_those_of_a_study_and_have_units(scene, contacts):
    study = compact.Study(scene)
    first = study.stages.contacts.passes_at(SPEEDS[-1])[0]
    frame = contacts.to_dataframe()
    assert frame.index.tolist() == list(SPEEDS)
    assert frame.loc[SPEEDS[-1], "resistance"] == first.resistance == contacts[-1].resistance
    assert frame.attrs["units"]["load"] == "N/m"
    dataset = contacts.to_xarray()
    assert dataset["peak_pressure"].attrs == {"units": "Pa", "long_name": "peak contact pressure"}
    assert float(dataset["load"].sel(speed=0.1)) == contacts[1].load
    assert "creep" not in frame  # which no column has
    assert isinstance(contacts.plot(), Figure)
    assert repr(contacts) == "<3 contacts by column, 0.05 to 0.2 m/s, Small: the published machine, three laws>"
    assert " kN/m<" in contacts._repr_html_()


def test_resistance_is_a_function_and_a_table(scene):
    resistance = scene.resistance()
    assert (
        float(resistance(-0.1))
        == -float(resistance(0.1))
        == -float(compact.Study(scene).stages.resistance.resistance(0.1))
    )
    frame = resistance.to_dataframe()
    assert frame["resistance"].loc[resistance.law.speeds[0]] == resistance.law.resistance.forces[0]
    assert resistance.to_xarray()["resistance"].attrs["units"] == "N"
    assert isinstance(resistance.plot(), Figure)
    assert isinstance(scene.resistance(engine="formula").plot(), Figure)
    assert "<resistance by column" in repr(resistance)


def test_ranking_equals_that_of_a_study(scene):
    ranking, study = scene.rank(resistance=scene.resistance()), scene.study()
    assert ranking.by == "peak_force"
    assert [place.law for place in ranking] == [place.run.name for place in study.stages.drive.rankings["peak_force"]]
    assert ranking.to_dataframe()["peak_force"].tolist() == study.to_dataframe()["peak_force"].tolist()
    assert isinstance(ranking.plot(), Figure)
    assert repr(ranking) == f"<3 laws by peak drive force, rigid drive; first {ranking[0].law}>"


def test_own_law_in_three_forms_has_one_value(scene):
    def travel(time):
        return 0.2 * (1 - np.cos(np.pi * time / 3.0))

    time = np.linspace(0, 3.0, 601)
    laws = {"function": travel, "table": (time, travel(time)), "profile": compact.law("harmonic", 0.4, 3.0)}
    values = scene.rank(laws=laws).to_dataframe().set_index("law")["peak_force"]
    assert values["function"] == pytest.approx(values["profile"], rel=1e-6)
    assert values["table"] == pytest.approx(values["profile"], rel=1e-6)


def test_own_resistance_replaces_that_of_the_engine(scene):
    dry = scene.rank(resistance=compact.dry_resistance(3e3))
    same = scene.rank(resistance=lambda v, a: 3e3 * np.sign(v) + 0 * a)
    table = scene.rank(resistance=compact.tabulated_resistance([0.01, 0.1, 0.5], [3e3, 3e3, 3e3]))
    assert dry[0].value == same[0].value == pytest.approx(table[0].value, rel=1e-12)
    assert dry[0].error is None


def test_sweep_is_a_dataset_whose_points_are_contacts(scene):
    table = scene.sweep({"mix.moisture": np.array([0.09, 0.1]), "motion.duration": "2:4:2"})
    assert isinstance(table, xarray.Dataset)
    assert dict(table.sizes) == {"moisture": 2, "duration": 2}
    point = scene.replaced(**{"mix.moisture": 0.1, "motion.duration": 2.0}).roll([0.2])[0]
    assert float(table["load"].sel(moisture=0.1, duration=2)) == pytest.approx(point.load * scene.machine.roller_length)


def test_type_checkers_see_every_public_name():
    tree = ast.parse(Path(compact.__file__).read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    seen = {alias.asname for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert seen == set(compact.__all__)
    assert not any(alias.asname != alias.name for node in block.body for alias in node.names)
