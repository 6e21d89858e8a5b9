"""Whole studies of random scenes, from plausible to wild: results, or a refusal in words of `compact`.

Each case takes a published scene, laws, drives and optional tables, and changes keys within what is plausible, at the
ends of what is allowed, or far beyond. The command runs in a child process.
"""

import math
import random
import shutil
from contextlib import suppress
from typing import get_args

import pytest
from extreme_scenes import SCENES, TABLES, Case, at, choices, ended, ends, keys

from compact.cli import program as cli
from compact.scene import plausible_ranges
from compact.scene.loader import LAW_NAMES, SceneError, load_scene
from compact.scene.schema import OutputItem

SECONDS = 600  # of processor time, after which a case does not end
FORBIDDEN = ("Traceback", "internal error", "encountered in", "RuntimeWarning")
FAILED = "the computation failed"  # allowed where a scene insists on implausible numbers
NAMES = ("small", "small", "loveikin-2015", "loveikin-2015-crank", "process")
ENGINES = ("formula", "formula", "formula", "column", "column", "spectral")
FILES = ("motors.csv",)
KEYS = {key: field for key, field in keys().items() if not key.startswith("compare.")}
WILD = (0, -1, 1, 1e-300, 1e300, 1e-9, 1e9, 5e-324, 1.7e308, math.nan, math.inf, True, "x", [], {})
OWN = ("motion.laws", "output.items", "accuracy.engine")  # keys that every case sets
LONG = ("motion.optimise", "accuracy.tolerance", "layer.passes")  # keys whose extremes take minutes


def value(draw, key, given):
    """A plausible value of a key, one at an end of what is allowed, or a wild one."""
    kind = draw.choice(("plausible", "plausible", "plausible", "end", "wild"))
    if words := choices(KEYS[key]):
        return [draw.choice(words)] if isinstance(given, list) else draw.choice(words)
    if kind == "wild" and not key.startswith(LONG):
        return draw.choice(WILD)
    if kind == "end" and not key.startswith(LONG) and (found := ends(key, given)):
        return draw.choice(found)
    if key in plausible_ranges.COMPARED_KEYS:
        found = plausible_ranges.range_of(key)
        size = math.exp(draw.uniform(math.log(found.low), math.log(found.high)))
    elif isinstance(given, int | float) and not isinstance(given, bool):
        size = abs(given) * 10 ** draw.uniform(-1, 1)
    else:
        return given
    if isinstance(given, list):
        return [size * (entry / (max(map(abs, given)) or 1.0)) for entry in given] or [size]
    return max(1, round(size)) if isinstance(given, int) else size


def case(seed):
    """The case of a number; most of its changes leave the scene valid."""
    draw = random.Random(seed)
    scene, engine, file = draw.choice(NAMES), draw.choice(ENGINES), draw.choice(get_args(OutputItem))
    changes = {"accuracy.engine": engine, "motion.laws": draw.sample(LAW_NAMES, draw.choice((1, 1, 2, 3)))}
    changes["output.items"] = draw.choice(([], ["tables"], ["tables"], ["report"], [file]))
    tables = load_scene(scene).model_dump(mode="json", exclude_none=True)
    if draw.random() < 0.7:
        changes["unusual"] = list(plausible_ranges.COMPARED_KEYS)
    for name in draw.sample(tuple(TABLES), 2):
        changes = one_of(draw, scene, changes, TABLES[name])
    given = {key: changes.get(key, at(tables, key)) for key in KEYS if key not in OWN}
    likely = [key for key, value in given.items() if value is not None]
    for key in draw.sample(likely, draw.choice((2, 3, 4, 6))) + draw.sample(tuple(given), 2):
        changes = one_of(draw, scene, changes, {key: value(draw, key, given[key])})
    return Case(scene, "run", engine, {key: each for key, each in changes.items() if key != "accuracy.engine"}, ())


def one_of(draw, scene, changes, more):
    """Changes with more of them, seldom without regard to the rules of a scene."""
    with suppress(SceneError):
        if draw.random() > 0.05:
            load_scene(scene, **changes | more)
        return changes | more
    return changes


def checked(seed, folder):
    asked = case(seed)
    for name in (f"{asked.scene}.toml", *FILES):
        shutil.copy(SCENES / name, folder)
    outcome = ended(asked, folder, SECONDS)
    words = FORBIDDEN if "unusual" in asked.changes else (*FORBIDDEN, FAILED)
    wrong = outcome.code not in (0, 1, 2) or any(word in outcome.said for word in words)
    assert not wrong, f"{outcome.code}: {outcome.said[-600:]}\ncompact {' '.join(map(repr, asked.arguments))}"


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """Load what the engines need once, in the process from which the cases are forked."""
    folder = tmp_path_factory.mktemp("warm")
    for engine in dict.fromkeys(ENGINES):
        arguments = ["run", str(SCENES / "small.toml"), "--engine", engine, "--out", str(folder / engine), "--quiet"]
        assert cli._exit_code([*arguments, "--set=output.items=[]", '--set=motion.laws=["cubic"]']) == 0


@pytest.mark.parametrize(
    "seed",
    [
        238,  # a shaft whose speed overflows; it and 204, an infinite margin of the motor, were internal errors
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in (*range(1, 16), 204)),
        *(pytest.param(seed, marks=pytest.mark.nightly) for seed in range(16, 301) if seed not in (204, 238)),
    ],
)
def test_a_random_scene_has_results_or_is_refused(seed, tmp_path, warm):
    checked(seed, tmp_path)
