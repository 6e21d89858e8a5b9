"""Every key of a scene at both ends of what is allowed: the study has results or is refused in words of `compact`."""

import traceback
import warnings
from pathlib import Path
from typing import Any

import pytest
from test_extreme_scenes import SCENES, TABLES, at, ends, keys

from compact.analysis.failures import is_refusal
from compact.analysis.study import Study
from compact.report import text, writer
from compact.report.page import write_page
from compact.scene.loader import load_scene

SHORT = {"motion.laws": ["cubic"], "output.items": ["tables"]}  # changes of every scene, for speed
KEYS = [key for key in keys() if not key.startswith("compare.")]
LONG = (  # keys at whose ends a study takes more than a second
    *("motion.optimise.", "motion.laws", "output.items", "drive.rank_by", "drive.stiffness", "drive.damping"),
    *("drive.motor.inertia", "drive.motor.speed", "drive.motor.flywheel", "drive.hydraulics.transition"),
    *("drive.hydraulics.dead", "drive.hydraulics.bulk", "drive.hydraulics.supply"),
)
OF_ENGINES = ("machine.roller", "machine.gap", "product.", "mix.", "layer.", "motion.duration", "contact.", "accuracy.")


def complete(key: str, scene: str = "small.toml") -> dict[str, Any]:
    """Changes of a scene that give a key a value; none where no table does."""
    for changes in TABLES.values():
        try:
            tables = load_scene(SCENES / scene, **changes).model_dump(exclude_none=True)
        except ValueError:
            continue
        if at(tables, key) is not None:
            return changes
    return {}


def fault(scene: str, changes: dict[str, Any], folder: Path) -> str:
    """Traceback of a study that ends neither with results nor with a refusal; empty otherwise.

    A RuntimeWarning is an error, as in the command. No figure is drawn.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)
        try:
            study = Study(load_scene(SCENES / scene, **changes))
            writer.write_study(study, folder, force=True)
            text.study_digest(study)
            pictures = dict.fromkeys([*writer.study_figures(study), "pressure"], b"")
            write_page(folder / "report.html", study, pictures)
        except Exception as error:
            return "" if is_refusal(error) else traceback.format_exc()
    return ""


def faults(key, engine, folder):
    """What each end of the range of a key ended with, where that is neither results nor a refusal."""
    base = SHORT | complete(key) | {"accuracy.engine": engine}
    given = at(load_scene(SCENES / "small.toml", **complete(key)).model_dump(exclude_none=True), key)
    return "\n".join(
        f"{key} = {end!r}: {wrong}"
        for end in ends(key, given)
        if (wrong := fault("small.toml", base | {key: end}, folder))
    )


def mark(number, key):
    """No mark for every thirtieth key; a third of the others is slow, the rest and long ones run at night."""
    if key.startswith(LONG) or number % 3:
        return [pytest.mark.nightly]
    return [pytest.mark.slow] if number % 30 else []


@pytest.mark.parametrize("key", [pytest.param(key, marks=mark(*each)) for each in enumerate(KEYS) for key in each[1:]])
def test_a_scene_at_the_ends_of_a_key_has_results_or_is_refused(key, tmp_path):
    assert not faults(key, "formula", tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("engine", ["column", "spectral", "fem"])
@pytest.mark.parametrize("key", [key for key in KEYS if key.startswith(OF_ENGINES)])
def test_a_scene_at_the_ends_of_a_key_is_solved_by_an_engine_or_refused(key, engine, tmp_path):
    assert not faults(key, engine, tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("key", [key for key in KEYS if key.startswith(("process.", "sleeve."))])
def test_a_process_at_the_ends_of_a_key_has_results_or_is_refused(key, tmp_path):
    given = at(load_scene(SCENES / "process.toml").model_dump(exclude_none=True), key)
    for end in ends(key, given):
        assert not fault("process.toml", {"output.items": [], "accuracy.engine": "column", key: end}, tmp_path)
