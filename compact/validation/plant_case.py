"""Case of a plant: a folder with one TOML, the scene with a table [case], and one CSV of trials.

    [case]
    title = "Slab of 70 mm, line 2"
    source = "load cells on both roller axles, 2026-03-14, three passes each"
    licence = "internal"
    expected = {load = 0.2, resistance = 0.3}     # relative distances, stated before the comparison

    layer.fed_density_ratio, load, load_scatter, resistance
    0.94,                    9740, 300,          1740

Columns with a dot are keys of the scene, and `speed` is that of the roller; the others are measured on one roller, with
the name and NAME_scatter. Every trial is computed by the engine of the scene. Nothing is fitted here; a scene that was
calibrated with the same trials says so by `fitted = "..."` in [case].
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from compact.analysis.contact_cases import on_roller, roll_scene, scene_mix
from compact.engines import ENGINES
from compact.files import read_table
from compact.numerics.validation import require_known
from compact.scene.loader import Scene, SceneError, read_value
from compact.scene.plant_data import Positive, validated
from compact.scene.schema import Table, key, optional
from compact.validation.case import CASES, PREDICTED, Comparison, Computed, Panel, Rows, ValidationCase, ours, theirs

COMPACTED = "exit_density_ratio"  # of an engine with irreversible compaction
MEASURED = {"load": "N", "resistance": "N", "resistance_coefficient": "-", COMPACTED: "-"}  # units
SCATTER = "_scatter"
SPEED = "speed"
TEXT = r"\S"  # pattern of a text that is not blank
LARGEST_DISTANCE = 10.0  # [-], relative


class Expected(Table):
    """Expected distances of the measured quantities, relative to them."""

    load: float | None = optional("the relative distance expected of the load", lt=LARGEST_DISTANCE)
    resistance: float | None = optional("the relative distance expected of the resistance", lt=LARGEST_DISTANCE)
    resistance_coefficient: float | None = optional("that of resistance over load", lt=LARGEST_DISTANCE)
    exit_density_ratio: float | None = optional("that of the density ratio", lt=LARGEST_DISTANCE)


class CaseTable(Table):
    """Origin of the measurements, and the distances expected before the comparison."""

    title: str = key("a title in quotes", pattern=TEXT)
    source: str = key("what measured, when and how", pattern=TEXT)
    licence: str = key("the licence of the data, or internal", pattern=TEXT)
    fitted: str | None = key("what was fitted to the trials", pattern=TEXT, default=None)
    expected: Expected


class PlantScene(Scene):
    """Scene of a plant with the table [case]."""

    case: CaseTable


class Trial(NamedTuple):
    """One row of the CSV: file and line, changes of scene keys, and values [SI units] by column."""

    place: str
    key: str
    changes: Mapping[str, Any]
    values: Mapping[str, float]


def read_plant_case(folder: str | Path) -> ValidationCase:
    """Read the case of a plant.

    Parameters
    ----------
    folder : path
        Folder with one TOML and one CSV file.

    Raises
    ------
    ValueError
        If files are missing, or a line breaks a rule; the message names file, line and rule.
    """
    folder, paths = Path(folder), []
    for suffix in (".toml", ".csv"):
        found = sorted(folder.glob(f"*{suffix}"))
        if len(found) != 1:
            names = ", ".join(path.name for path in found) or "none"
            raise ValueError(f"{folder}: a case has exactly one {suffix} file, got {names}")
        paths += found
    scene = PlantScene.load(paths[0])
    case, engine = scene.case, ENGINES[scene.accuracy.engine]
    expected = case.expected.model_dump(exclude_none=True)
    if COMPACTED in expected and not engine.reads(engine.fed_key):
        raise ValueError(f"{paths[0]}: case.expected: the engine {engine.name} computes no `{COMPACTED}`")
    trials = [_trial(f"{paths[1]}:{line}", f"line_{line}", cells, expected) for line, cells in read_table(paths[1])]
    if not trials:
        raise ValueError(f"{paths[1]}: has no trial; give a header and a row for each trial")
    basis = f"fitted: {case.fitted}" if case.fitted else PREDICTED
    rows = {
        f"{trial.key}_{name}": Comparison(
            f"{trial.key}_{name}", f"{trial.key} {name}".replace("_", " "), MEASURED[name], math.nan,
            trial.values[name], relative=expected[name], scatter=trial.values.get(name + SCATTER), basis=basis,
        )
        for trial in trials
        for name in expected
        if name in trial.values
    }  # fmt: skip
    source, compute = f"{case.source}; {case.licence}", partial(_compute, scene, trials)
    return ValidationCase(folder.resolve().name, case.title, "measured", (engine.name,), source, compute, rows)


def _trial(place: str, key: str, row: Mapping[str, str], expected: Mapping[str, float]) -> Trial:
    """Return the trial of a row, whose columns are keys of the scene and quantities with an expected distance."""
    columns = (SPEED, *expected, *(name + SCATTER for name in expected))
    if unknown := [name for name in row if "." not in name and name not in columns]:
        raise ValueError(
            f"{place}: no column `{unknown[0]}`; a column is a scene key such as contact.load, {', '.join(columns)}; "
            "other measured quantities need a distance in `expected` of [case]"
        )
    given = {name: cell for name, cell in row.items() if cell}
    changes = {name: read_value(cell) for name, cell in given.items() if "." in name}
    values = {name: validated(Positive, cell, f"{place}: `{name}`") for name, cell in given.items() if "." not in name}
    if not values.keys() & expected.keys():
        raise ValueError(f"{place}: nothing is measured; give at least one of {', '.join(expected)}")
    return Trial(place, key, changes, values)


def _compute(scene: Scene, trials: Sequence[Trial], rows: Rows) -> Computed:
    """Compute every trial by the engine of the scene."""
    values: dict[str, float] = {}
    for trial in trials:
        try:
            changed = scene.replaced(**trial.changes)
            found = roll_scene(changed, scene_mix(changed), trial.values.get(SPEED, changed.mean_speed))
        except SceneError as error:
            raise ValueError(f"{trial.place}: {error}") from None
        except (ValueError, RuntimeError) as error:
            raise RuntimeError(f"{trial.place}: the engine has no result: {error}") from None
        known = on_roller(found, changed.machine.roller_length)
        values |= {f"{trial.key}_{name}": value for name, value in known.items() if name in trial.values}

    panels = []
    for name in MEASURED:
        keys = [key for key in rows if key.endswith(f"_{name}")]
        if keys:
            measured, computed = [rows[key].theirs for key in keys], [values[key] for key in keys]
            ends, label = [0.0, 1.1 * max(*measured, *computed)], f"{name.replace('_', ' ')} [{MEASURED[name]}]"
            curves = ours("equal", ends, ends), theirs("trials", measured, computed)
            panels.append(Panel(f"measured {label}", f"computed {label}", curves))
    return values, panels


def select_cases(names: Sequence[str]) -> tuple[ValidationCase, ...]:
    """Return the cases of some names in the order of the registry, then those of folders; all without names.

    Parameters
    ----------
    names : sequence of str
        Names of cases, and folders with the case of a plant.
    """
    folders = [name for name in names if name not in CASES and Path(name).is_dir()]
    for name in names:
        if name not in folders:
            require_known("case", name, tuple(CASES))
    listed = tuple(case for case in CASES.values() if not names or case.name in names)
    return (*listed, *(read_plant_case(folder) for folder in folders))
