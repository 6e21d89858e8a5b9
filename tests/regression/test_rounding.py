"""Inputs changed by rounding: the same names, orders and whole numbers in all results, and the same numbers to 1e-6.

Every sort, event and step of a study is a decision; none may hang on the last digits, which differ between processors.
"""

import math
from copy import deepcopy
from functools import cache

import pytest
from test_regression import ABSOLUTE, ESTIMATE, RELATIVE, SCENES, SMALL, different, is_estimate, written

from compact.engines.compaction.rolling import ROLLING_TOLERANCE
from compact.scene.loader import load_scene

ROUNDING = 1e-15  # [-], a few units of the last place
SEARCHED = 3e-3  # [-], of forces by `compaction` at a density, met within 9e-4 of its increase; 2.3 times that in R
SIBLINGS = 1e-9  # [-], of the largest number beside it; a mean of a load cycle may be zero but for rounding
INPUTS = {"mass": ("machine", "mass"), "radius": ("machine", "roller_radius"), "stroke": ("motion", "stroke")}
UNSTABLE = ("versions", "scene_hash", "files", "advice", "inputs")
PUBLISHED = {"loveikin-formula": "formula", "loveikin-column": "column"}  # name -> engine of loveikin-2015.toml
ENGINES = "loveikin-engines"
ITEMS = {"output.items": ["tables", "reactions", "crank"]}  # without figures, which take most of the time
CASES = [
    *(pytest.param(name, marks=[pytest.mark.slow] * (name != "column")) for name in SCENES),
    *(pytest.param(name, marks=pytest.mark.slow) for name in PUBLISHED),
]


def scene(name, **changes):
    """A scene of the regression, or a published one, with changes."""
    if name in SCENES:
        return load_scene(SMALL, **(SCENES[name] | changes))
    if name == ENGINES:
        return load_scene(SMALL.with_name("loveikin-2015-engines.toml"), **(ITEMS | changes))
    return load_scene(SMALL.with_name("loveikin-2015.toml"), **({"accuracy.engine": PUBLISHED[name]} | ITEMS | changes))


def results(name, directory, **changes):
    """Summary and all tables of a scene; without rows that are the steps of an integration, which adapt to rounding."""
    summary, tables = written(scene(name, **changes), directory, UNSTABLE)
    return summary, {path: table for path, table in tables.items() if not path.startswith("passage-")}


@pytest.fixture(scope="module")
def unchanged(tmp_path_factory):
    """Results of the scenes themselves, each computed once."""
    return cache(lambda name: results(name, tmp_path_factory.mktemp("unchanged") / name))


def differences(found, expected):
    """Differences of two summaries with tables: relative to a number, to those beside it, or to those of its column."""
    (summary, tables), (expected_summary, expected_tables) = found, expected
    yield from different_beside(summary, expected_summary, "summary")
    assert tables.keys() == expected_tables.keys()
    for path, table in expected_tables.items():
        assert list(tables[path]) == list(table)
        for name, column in table.items():
            largest = max((abs(cell) for cell in column if isinstance(cell, float) and math.isfinite(cell)), default=0)
            absolute = max(ABSOLUTE, (ESTIMATE if is_estimate(name) else RELATIVE) * largest)
            yield from different(tables[path][name], column, f"{path}.{name}", absolute=absolute)


def different_beside(found, expected, path):
    """Differences of nested results; small numbers are compared with the largest beside them."""
    if isinstance(expected, dict) and isinstance(found, dict) and found.keys() == expected.keys():
        numbers = [abs(each) for each in expected.values() if isinstance(each, float) and math.isfinite(each)]
        absolute = max(ABSOLUTE, SIBLINGS * max(numbers, default=0.0))
        for key, value in expected.items():
            if isinstance(value, dict | list):
                yield from different_beside(found[key], value, f"{path}.{key}")
            else:
                estimate = isinstance(value, float) and is_estimate(f"{path}.{key}")
                least = ESTIMATE * abs(value) if estimate else absolute
                yield from different(found[key], value, f"{path}.{key}", absolute=max(least, absolute))
    elif isinstance(expected, list) and isinstance(found, list) and len(found) == len(expected):
        for i, pair in enumerate(zip(found, expected, strict=True)):
            yield from different_beside(*pair, f"{path}[{i}]")
    else:
        yield from different(found, expected, path)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("sign", [1, -1], ids=["up", "down"])
@pytest.mark.parametrize("key", INPUTS)
@pytest.mark.parametrize("name", CASES)
def test_rounding_of_an_input_changes_no_decision(name, key, sign, unchanged, tmp_path):
    table, field = INPUTS[key]
    value = getattr(getattr(scene(name), table), field) * (1 + sign * ROUNDING)
    found = results(name, tmp_path / name, **{f"{table}.{field}": value})
    expected = deepcopy(unchanged(name))
    if name == "compaction":  # the second pass is as steady as the first, from which it starts
        passes = [each[0]["return_stroke"] for each in (found, expected)]
        for key in ("second_pass_load", "second_pass_resistance"):
            now, before = (each.pop(key)["value"] for each in passes)
            assert now == pytest.approx(before, rel=ROLLING_TOLERANCE)
        sizing = [each[0].pop("machine_sizing") for each in (found, expected)]  # its load cycles contain that pass
        assert list(different(*sizing, relative=ROLLING_TOLERANCE)) == []
        for contact in (*found[0]["contacts"], *expected[0]["contacts"]):  # what the last iteration leaves
            assert contact.pop("equilibrium_residual")["value"] < ROLLING_TOLERANCE
    assert list(differences(found, expected)) == []


@pytest.mark.parametrize(
    ("key", "sign"), [pytest.param(key, sign, marks=pytest.mark.nightly) for key in INPUTS for sign in (1, -1)]
)
def test_rounding_changes_no_decision_of_the_main_scene(key, sign, unchanged, tmp_path):
    """Contacts at a density are found to the tolerance of a search, whose path depends on rounding."""
    table, field = INPUTS[key]
    value = getattr(getattr(scene(ENGINES), table), field) * (1 + sign * ROUNDING)
    found, expected = results(ENGINES, tmp_path / ENGINES, **{f"{table}.{field}": value})[0], unchanged(ENGINES)[0]
    for name, order in expected["rankings"].items():
        assert [(each["law"], each["rank"]) for each in found["rankings"][name]] == [
            (each["law"], each["rank"]) for each in order
        ]
    for name, law in expected["laws"].items():
        for by in ("peak_force", "peak_power", "energy"):
            assert found["laws"][name][by] == pytest.approx(law[by], rel=SEARCHED), (name, by)
