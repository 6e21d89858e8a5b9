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
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from compact.analysis.contact_cases import roll_scene
from compact.analysis.mix_laws import scene_mix
from compact.engines import ENGINES
from compact.scene.errors import key_lines, syntax_sentence
from compact.scene.loader import Scene, SceneError, parse_scene, read_value
from compact.validation.case import PREDICTED, Comparison, Computed, Panel, Rows, ValidationCase, ours, theirs

MEASURED = {"load": "N", "resistance": "N", "resistance_coefficient": "-", "exit_density_ratio": "-"}
COMPACTED = ("exit_density_ratio",)  # of an engine with irreversible compaction
SCATTER = "_scatter"
SPEED = "speed"
REQUIRED_TEXTS, OPTIONAL_TEXTS, EXPECTED = ("title", "source", "licence"), ("fitted",), "expected"
TABLE_HEADER = re.compile(r"\s*\[+\s*([^\]\s]+)\s*\]")
LARGEST_DISTANCE = 10.0  # [-], relative
CONTACT_COST = 10.0  # [s], processor time of a trial by an engine without a cheaper one


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
    folder = Path(folder)
    toml, table = (_only_file(folder, suffix) for suffix in (".toml", ".csv"))
    text = _text(toml)
    header, scene = _case_header(text, toml), parse_scene(_without_case(text), str(toml))
    trials = read_trials(table, header[EXPECTED], scene)
    rows = {
        (key := f"line_{trial.line}_{name}"): Comparison(
            key, f"{name.replace('_', ' ')}, line {trial.line}", MEASURED[name], math.nan, value,
            float(header[EXPECTED][name]), scatter=trial.scatter.get(name),
            basis=f"fitted: {header['fitted']}" if "fitted" in header else PREDICTED,
        )
        for trial in trials for name, value in trial.measured.items()
    }  # fmt: skip
    engine = scene.accuracy.engine
    return ValidationCase(
        folder.resolve().name,
        header["title"],
        "measured",
        (engine,),
        f"{header['source']}; {header['licence']}",
        partial(_compute, scene, trials, str(table)),
        seconds=CONTACT_COST * len(trials) if not ENGINES[engine].affordable else 1.0,
        given=rows,
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
    required = (*REQUIRED_TEXTS, EXPECTED)
    try:
        table = tomllib.loads(text).get("case")
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}:{syntax_sentence(error, text)}") from None
    if not isinstance(table, dict):
        raise ValueError(f"{path}: has no table [case]; give {', '.join(required)}")
    for keys, rule in _mistakes(table, required):
        lines = key_lines(text)
        raise ValueError(f"{path}:{lines.get(('case', *keys), lines.get(('case',), 1))}: [case] {rule}")
    return table


def _mistakes(table: Mapping[str, Any], required: Sequence[str]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the keys of each mistake in [case] and the rule that they break."""
    known = (*required, *OPTIONAL_TEXTS)
    yield from (((name,), f"has no key `{name}`; it takes {', '.join(known)}") for name in table if name not in known)
    yield from (((), f"must state `{name}`") for name in required if name not in table)
    for name in (*REQUIRED_TEXTS, *OPTIONAL_TEXTS):
        value = table.get(name, "none")
        if not (isinstance(value, str) and value.strip()):
            yield (name,), f"`{name}` must be a text, got {value!r}"
    expected = table.get(EXPECTED)
    if not isinstance(expected, dict) or not expected:
        yield (EXPECTED,), f"`expected` must be a table such as {{load = 0.2}}, got {expected!r}"
        return
    for name, value in expected.items():
        if name not in MEASURED:
            yield (EXPECTED, name), f"`expected` has no `{name}`; it takes {', '.join(MEASURED)}"
        elif isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < LARGEST_DISTANCE:
            rule = f"must be a relative distance between 0 and {LARGEST_DISTANCE:g}, got {value!r}"
            yield (EXPECTED, name), f"`expected.{name}` {rule}"


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

    Raises
    ------
    ValueError
        If a line breaks a rule.
    """
    reader = csv.reader(_text(path).splitlines(), skipinitialspace=True)
    names: list[str] = []
    trials: dict[Any, Trial] = {}
    for row in reader:
        place, cells = f"{path}:{reader.line_num}", [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if not names:
            names = cells
            _require_columns(names, expected, scene, place)
            continue
        trial = _trial(names, cells, reader.line_num, place)
        key = (repr(sorted(trial.changes.items())), trial.speed, *trial.measured.items())
        if key in trials:
            raise ValueError(f"{place}: repeats line {trials[key].line}; give each trial once")
        trials[key] = trial
    if not trials:
        raise ValueError(f"{path}: has no trial; give a header and a row for each trial")
    return tuple(trials.values())


def _require_columns(names: Sequence[str], expected: Mapping[str, float], scene: Scene, place: str) -> None:
    """Require a header of known columns, each once."""
    engine = scene.accuracy.engine
    if len(set(names)) < len(names):
        raise ValueError(f"{place}: each column must have a name of its own, got {', '.join(names)}")
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
        if base not in names:
            raise ValueError(f"{place}: `{name}` needs a column `{base}`")
        if base in COMPACTED and ENGINES[engine].takes in ("half-plane", "linear layer"):
            raise ValueError(f"{place}: the engine {engine} computes no `{base}`")
    if not any(name in MEASURED for name in names):
        raise ValueError(f"{place}: no column is measured; give at least one of {', '.join(MEASURED)}")


def _trial(names: Sequence[str], cells: Sequence[str], line: int, place: str) -> Trial:
    """Return the trial of one row."""
    if len(cells) != len(names):
        raise ValueError(f"{place}: a row must have one cell for each of {len(names)} columns, got {len(cells)}")
    row = {name: cell for name, cell in zip(names, cells, strict=True) if cell}
    values = {name: _positive(cell, f"{place}: `{name}`") for name, cell in row.items() if "." not in name}
    measured = {name: value for name, value in values.items() if name in MEASURED}
    if not measured:
        raise ValueError(f"{place}: nothing is measured; give at least one of {', '.join(MEASURED)}")
    if "resistance" in measured and "resistance_coefficient" in measured:
        raise ValueError(f"{place}: give `resistance` or `resistance_coefficient`, not both")
    scatter = {name.removesuffix(SCATTER): value for name, value in values.items() if name.endswith(SCATTER)}
    changes = {name: read_value(cell) for name, cell in row.items() if "." in name}
    return Trial(line, changes, values.get(SPEED), measured, scatter)


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
