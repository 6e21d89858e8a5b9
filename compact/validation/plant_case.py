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

import csv
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from compact.analysis.contact_cases import scene_mix
from compact.analysis.engines import ENGINES
from compact.analysis.stages.contacts import roll_scene
from compact.rolling_contact import ContactResult
from compact.scene.errors import key_lines, syntax_sentence
from compact.scene.loader import Scene, SceneError, parse_scene, read_value
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, ours, theirs

MEASURED = {"load": "N", "resistance": "N", "resistance_coefficient": "-", "exit_density_ratio": "-"}
COMPACTED = ("exit_density_ratio",)  # of an engine with irreversible compaction
SCATTER = "_scatter"
SPEED = "speed"
REQUIRED_KEYS, OPTIONAL_KEYS = ("title", "source", "licence", "expected"), ("fitted",)
TABLE_HEADER = re.compile(r"\s*\[+\s*([^\]\s]+)\s*\]")
LARGEST_DISTANCE = 10.0  # [-], relative
CONTACT_COST = 10.0  # [s], processor time of a trial by an engine without a cheaper one


@dataclass(frozen=True)
class Trial:
    """One row of the CSV.

    Parameters
    ----------
    line : int
        Line of the file.
    changes : dict
        Values by scene key.
    speed : float or None
        Speed of the roller [m/s]; None for the mean speed of the scene.
    measured : dict of str to float
        Measured values, names as in `MEASURED`.
    scatter : dict of str to float
        Their scatter.
    """

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

    Returns
    -------
    ValidationCase

    Raises
    ------
    ValueError
        If files are missing, or a line breaks a rule; the message names file, line and rule.
    """
    folder = Path(folder)
    toml, table = (_only_file(folder, suffix) for suffix in (".toml", ".csv"))
    text = _text(toml)
    header, scene = _case_header(text, toml), parse_scene(_without_case(text), str(toml))
    trials = read_trials(table, header["expected"], scene)
    engine = scene.accuracy.engine
    return ValidationCase(
        folder.resolve().name,
        header["title"],
        "measurement",
        (engine,),
        header["source"],
        header["licence"],
        f"{len(trials)} trials of a plant, each computed by the engine {engine} with the scene {toml.name}.",
        partial(_evaluate, scene, trials, header, str(table)),
        seconds=CONTACT_COST * len(trials) if not ENGINES[engine].cheap else 1.0,
    )


def _only_file(folder: Path, suffix: str) -> Path:
    """Return the only file of a folder with a suffix."""
    found = sorted(folder.glob(f"*{suffix}"))
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise ValueError(f"{folder}: a case has exactly one {suffix} file, got {names}")
    return found[0]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _case_header(text: str, path: Path) -> dict[str, Any]:
    """Return the table [case] with valid keys."""
    try:
        table = tomllib.loads(text).get("case")
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}:{syntax_sentence(error, text)}") from None
    if not isinstance(table, dict):
        raise ValueError(f"{path}: has no table [case]; give {', '.join(REQUIRED_KEYS)}")
    lines = key_lines(text)

    def place(*keys: str) -> str:
        return f"{path}:{lines.get(('case', *keys), lines.get(('case',), 1))}: [case]"

    for name in table:
        if name not in REQUIRED_KEYS + OPTIONAL_KEYS:
            raise ValueError(f"{place(name)} has no key `{name}`; it takes {', '.join(REQUIRED_KEYS + OPTIONAL_KEYS)}")
    for name in REQUIRED_KEYS:
        if name not in table:
            raise ValueError(f"{place()} must state `{name}`")
    for name in ("title", "source", "licence", "fitted"):
        value = table.get(name, "none")
        if not (isinstance(value, str) and value.strip()):
            raise ValueError(f"{place(name)} `{name}` must be a text, got {value!r}")
    _require_distances(table["expected"], place)
    return table


def _require_distances(expected: Any, place: Callable[..., str]) -> None:
    """Require relative distances of measured quantities."""
    if not isinstance(expected, dict) or not expected:
        raise ValueError(f"{place('expected')} `expected` must be a table such as {{load = 0.2}}, got {expected!r}")
    for name, value in expected.items():
        where = place("expected", name)
        if name not in MEASURED:
            raise ValueError(f"{where} `expected` has no `{name}`; it takes {', '.join(MEASURED)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < LARGEST_DISTANCE:
            raise ValueError(
                f"{where} `expected.{name}` must be a relative distance between 0 and {LARGEST_DISTANCE:g}, got "
                f"{value!r}"
            )


def _without_case(text: str) -> str:
    """Return the text of the scene: the lines of [case] are empty, so that all lines keep their numbers."""
    lines, inside = [], False
    for line in text.splitlines():
        found = TABLE_HEADER.match(line)
        if found:
            inside = found[1].split(".")[0] == "case"
        lines.append("" if inside else line)
    return "\n".join(lines)


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

    Returns
    -------
    tuple of Trial

    Raises
    ------
    ValueError
        If a line breaks a rule.
    """
    reader = csv.reader(_text(path).splitlines(), skipinitialspace=True)
    names: list[str] = []
    trials: list[Trial] = []
    seen: dict[Any, int] = {}
    for cells in reader:
        line = reader.line_num
        if not any(cell.strip() for cell in cells) or cells[0].lstrip().startswith("#"):
            continue
        if not names:
            names = [cell.strip() for cell in cells]
            _require_columns(names, expected, scene, f"{path}:{line}")
            continue
        trial = _trial(names, [cell.strip() for cell in cells], line, str(path))
        key = (
            tuple(sorted((name, repr(value)) for name, value in trial.changes.items())),
            trial.speed,
            *trial.measured.items(),
        )
        if key in seen:
            raise ValueError(f"{path}:{line}: repeats line {seen[key]}; give each trial once")
        seen[key] = line
        trials.append(trial)
    if not trials:
        raise ValueError(f"{path}: has no trial; give a header and a row for each trial")
    return tuple(trials)


def _require_columns(names: Sequence[str], expected: Mapping[str, float], scene: Scene, place: str) -> None:
    """Require a header of known columns, each once."""
    if len(set(names)) < len(names):
        raise ValueError(f"{place}: each column must have a name of its own, got {', '.join(names)}")
    compacting = ENGINES[scene.accuracy.engine].compacting
    for name in names:
        base = name.removesuffix(SCATTER)
        if "." in name or name == SPEED:
            continue
        if base not in MEASURED:
            raise ValueError(
                f"{place}: no column `{name}`; a column is a scene key such as contact.load, {SPEED}, "
                f"{', '.join(MEASURED)}, or one of these with {SCATTER}"
            )
        if base not in expected:
            raise ValueError(f"{place}: `{base}` has no expected distance; add it to `expected` of [case]")
        if base != name and base not in names:
            raise ValueError(f"{place}: `{name}` needs a column `{base}`")
        if base in COMPACTED and not compacting:
            raise ValueError(f"{place}: the engine {scene.accuracy.engine} computes no `{base}`")
    if not any(name in MEASURED for name in names):
        raise ValueError(f"{place}: no column is measured; give at least one of {', '.join(MEASURED)}")


def _trial(names: Sequence[str], cells: Sequence[str], line: int, path: str) -> Trial:
    """Return the trial of one row."""
    if len(cells) != len(names):
        raise ValueError(f"{path}:{line}: a row must have one cell for each of {len(names)} columns, got {len(cells)}")
    row = {name: cell for name, cell in zip(names, cells, strict=True) if cell}
    values = {name: _positive(cell, f"{path}:{line}: `{name}`") for name, cell in row.items() if "." not in name}
    measured = {name: value for name, value in values.items() if name in MEASURED}
    if not measured:
        raise ValueError(f"{path}:{line}: nothing is measured; give at least one of {', '.join(MEASURED)}")
    if "resistance" in measured and "resistance_coefficient" in measured:
        raise ValueError(f"{path}:{line}: give `resistance` or `resistance_coefficient`, not both")
    scatter = {name.removesuffix(SCATTER): value for name, value in values.items() if name.endswith(SCATTER)}
    changes = {name: read_value(cell) for name, cell in row.items() if "." in name}
    return Trial(line, changes, values.get(SPEED), measured, scatter)


def _positive(cell: str, place: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"{place} must be a number, got {cell!r}") from None
    if not 0 < value < np.inf:
        raise ValueError(f"{place} must be positive and finite, got {cell}")
    return value


def _evaluate(scene: Scene, trials: Sequence[Trial], header: Mapping[str, Any], path: str) -> Evaluation:
    """Compute all trials and compare them."""
    comparisons = [row for trial in trials for row in _comparisons(scene, trial, header, path)]
    panels = []
    for name in dict.fromkeys(name for trial in trials for name in trial.measured):
        rows = [each for each in comparisons if each.key.endswith(f"_{name}")]
        measured = np.array([each.theirs for each in rows])
        ends = np.array([0.0, 1.1 * max(*measured, *(each.ours for each in rows))])
        unit = MEASURED[name]
        label = name.replace("_", " ")
        panels.append(Panel(
            f"measured {label} [{unit}]", f"computed {label} [{unit}]",
            (ours("equal", ends, ends), theirs("trials", measured, [each.ours for each in rows])),
        ))  # fmt: skip
    return Evaluation(tuple(comparisons), tuple(panels))


def _comparisons(scene: Scene, trial: Trial, header: Mapping[str, Any], path: str) -> Iterator[Comparison]:
    """Yield the comparisons of one trial."""
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
    basis = f"fitted: {header['fitted']}" if "fitted" in header else "predicted"
    for name, value in trial.measured.items():
        yield Comparison(
            f"line_{trial.line}_{name}", f"{name.replace('_', ' ')}, line {trial.line}", MEASURED[name],
            _computed(found, name, length), value, float(header["expected"][name]), trial.scatter.get(name),
            basis=basis,
        )  # fmt: skip


def _computed(found: ContactResult, name: str, length: float) -> float:
    """Return a computed quantity of one roller of a length [m]."""
    if name == "resistance_coefficient":
        return float(found.resistance / found.load)
    value = float(getattr(found, name))
    return value * length if MEASURED[name] == "N" else value
