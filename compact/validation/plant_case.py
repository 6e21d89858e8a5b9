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
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from compact.analysis.contact_cases import roll_scene
from compact.analysis.mix_laws import scene_mix
from compact.engines import ENGINES
from compact.files import read_table
from compact.scene.loader import Scene, SceneError, read_value
from compact.scene.schema import Table, key, optional
from compact.validation.case import PREDICTED, Comparison, Computed, Panel, Rows, ValidationCase, ours, theirs

MEASURED = {"load": "N", "resistance": "N", "resistance_coefficient": "-", "exit_density_ratio": "-"}
COMPACTED = ("exit_density_ratio",)  # of an engine with irreversible compaction
SCATTER = "_scatter"
SPEED = "speed"
TEXT = r"\S"  # pattern of a text that is not blank
LARGEST_DISTANCE = 10.0  # [-], relative
CONTACT_COST = 10.0  # [s], processor time of a trial by an engine without a cheaper one


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


@dataclass(frozen=True)
class Trial:
    """One row of the CSV: its line, changes of scene keys, speed [m/s] or None for that of the scene, readings."""

    line: int
    changes: Mapping[str, Any]
    speed: float | None
    measured: Mapping[str, float]
    scatter: Mapping[str, float]


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
    toml, table = paths
    scene = PlantScene.load(toml)
    header, expected = scene.case, scene.case.expected.model_dump(exclude_none=True)
    trials = read_trials(table, expected, scene)
    basis = f"fitted: {header.fitted}" if header.fitted else PREDICTED
    rows = {}
    for trial in trials:
        for name, value in trial.measured.items():
            row, words = f"line_{trial.line}_{name}", f"{name.replace('_', ' ')}, line {trial.line}"
            given = Comparison(row, words, MEASURED[name], math.nan, value, expected[name], basis=basis)
            rows[row] = replace(given, scatter=trial.scatter.get(name))
    engine = scene.accuracy.engine
    return ValidationCase(
        folder.resolve().name,
        header.title,
        "measured",
        (engine,),
        f"{header.source}; {header.licence}",
        partial(_compute, scene, trials, str(table)),
        seconds=CONTACT_COST * len(trials) if not ENGINES[engine].affordable else 1.0,
        given=rows,
    )


def read_trials(path: Path, expected: Mapping[str, float], scene: Scene) -> tuple[Trial, ...]:
    """Read the trials of a CSV.

    Parameters
    ----------
    path : Path
        The file.
    expected : dict of str to float
        Expected distances; every measured quantity has one.
    scene : Scene
        Scene of the case, whose keys the columns change.

    Raises
    ------
    ValueError
        If a line breaks a rule.
    """
    rows = read_table(path)
    if not rows:
        raise ValueError(f"{path}: has no trial; give a header and a row for each trial")
    if rule := _broken_header(tuple(rows[0][1]), expected, scene.accuracy.engine):
        raise ValueError(f"{path}:1: {rule}")
    trials: dict[Any, Trial] = {}
    for line, row in rows:
        place, changes, values = f"{path}:{line}", {}, dict[str, float]()
        for name, cell in row.items():
            if cell and "." in name:
                changes[name] = read_value(cell)
            elif cell:
                values[name] = _positive(cell, f"{place}: `{name}`")
        measured = {name: value for name, value in values.items() if name in MEASURED}
        if not measured:
            raise ValueError(f"{place}: nothing is measured; give at least one of {', '.join(MEASURED)}")
        if "resistance" in measured and "resistance_coefficient" in measured:
            raise ValueError(f"{place}: give `resistance` or `resistance_coefficient`, not both")
        scatter = {name.removesuffix(SCATTER): value for name, value in values.items() if name.endswith(SCATTER)}
        trial = Trial(line, changes, values.get(SPEED), measured, scatter)
        same = trials.setdefault((repr(sorted(changes.items())), trial.speed, *measured.items()), trial)
        if same is not trial:
            raise ValueError(f"{place}: repeats line {same.line}; give each trial once")
    return tuple(trials.values())


def _broken_header(names: Sequence[str], expected: Mapping[str, float], engine: str) -> str | None:
    """Return the rule that the names of the columns break, or None."""
    for name in names:
        base = name.removesuffix(SCATTER)
        if "." in name or name == SPEED:
            continue
        if base not in MEASURED:
            return (
                f"no column `{name}`; a column is a scene key such as contact.load, {SPEED}, {', '.join(MEASURED)}, or "
                f"one of these with {SCATTER}"
            )
        if base not in expected:
            return f"`{base}` has no expected distance; add it to `expected` of [case]"
        if base not in names:
            return f"`{name}` needs a column `{base}`"
        if base in COMPACTED and ENGINES[engine].takes in ("half-plane", "linear layer"):
            return f"the engine {engine} computes no `{base}`"
    if not any(name in MEASURED for name in names):
        return f"no column is measured; give at least one of {', '.join(MEASURED)}"
    return None


def _positive(cell: str, place: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"{place} must be a number, got {cell!r}") from None
    if not 0 < value < math.inf:
        raise ValueError(f"{place} must be positive and finite, got {cell}")
    return value


def _compute(scene: Scene, trials: Sequence[Trial], path: str, rows: Rows) -> Computed:
    """Compute every trial by the engine of the scene."""
    values: dict[str, float] = {}
    for trial in trials:
        place = f"{path}:{trial.line}"
        try:
            changed = scene.replaced(**trial.changes)
        except SceneError as error:
            raise ValueError(f"{place}: {error}") from None
        try:
            found = roll_scene(changed, scene_mix(changed), trial.speed or changed.mean_speed)
        except (ValueError, RuntimeError) as error:
            raise RuntimeError(f"{place}: the engine has no result: {error}") from None
        length = changed.machine.roller_length
        on_roller = {
            "load": found.load * length,
            "resistance": found.resistance * length,
            "resistance_coefficient": found.resistance / found.load,
            "exit_density_ratio": getattr(found, "exit_density_ratio", math.nan),
        }
        values |= {f"line_{trial.line}_{name}": float(on_roller[name]) for name in trial.measured}

    panels = []
    for name in dict.fromkeys(name for trial in trials for name in trial.measured):
        keys = [f"line_{trial.line}_{name}" for trial in trials if name in trial.measured]
        measured, computed = [rows[key].theirs for key in keys], [values[key] for key in keys]
        ends, label = [0.0, 1.1 * max(*measured, *computed)], f"{name.replace('_', ' ')} [{MEASURED[name]}]"
        curves = ours("equal", ends, ends), theirs("trials", measured, computed)
        panels.append(Panel(f"measured {label}", f"computed {label}", curves))
    return values, panels
