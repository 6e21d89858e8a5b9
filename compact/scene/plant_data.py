"""What a plant has measured of its rolling: read from TOML or CSV, checked once.

    [[measurement]]
    load = 9740.0                                                     # N on one roller
    resistance_coefficient = {value = 0.179, low = 0.179, high = 0.219}
    exit_density_ratio = 0.98

    [assumptions]                                                     # scene keys that nobody measured: [low, high]
    "machine.roller_length" = [0.3, 1.2]

A CSV has one measurement a row under the same names, and for a band the columns NAME_low and NAME_high.
"""

import csv
import math
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path

from compact.scene.former_names import current_path

FITTED = ("load", "resistance", "resistance_coefficient")  # what a fit meets
STATED = ("exit_density_ratio", "speed")  # at what it is met
EDGES = ("low", "high")


@dataclass(frozen=True)
class Band:
    """A measured value and the bounds that it lies between."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Measurement:
    """One reading, of one roller; None what was not measured.

    load : vertical force [N];  resistance : horizontal force of the mix on the roller [N], or its `coefficient`, over
    the load;  exit_density_ratio, speed [m/s] : at which it was read, the scene's unless given
    """

    load: Band | None = None
    resistance: Band | None = None
    resistance_coefficient: Band | None = None
    exit_density_ratio: float | None = None
    speed: float | None = None

    @property
    def data(self):
        """Name and `Band` of each number that a fit meets."""
        return tuple((name, band) for name in FITTED if (band := getattr(self, name)) is not None)


@dataclass(frozen=True)
class Measured:
    """All readings, and scene keys with the (low, high) within which they are assumed."""

    measurements: tuple[Measurement, ...]
    assumptions: dict[str, tuple[float, float]] = field(default_factory=dict)

    def moved(self, name, value):
        """The same with the datum `name` of every measurement that has it at another value, and its band as it was."""
        return replace(self, measurements=tuple(_moved(m, name, value) for m in self.measurements))


def _moved(measurement, name, value):
    band = getattr(measurement, name)
    if band is None:
        return measurement
    return replace(measurement, **{name: Band(value, min(band.low, value), max(band.high, value))})


def read_measurements(path):
    """The `Measured` in a TOML or CSV file; ValueError names file, key, what is wrong and what is allowed."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        return _from_csv(text) if path.suffix.lower() == ".csv" else _from_toml(text)
    except ValueError as error:  # TOMLDecodeError is one
        raise ValueError(f"{path}: {error}") from None


def _from_toml(text):
    data = tomllib.loads(text)
    _refuse_other(data, ("measurement", "assumptions"), "the file")
    tables = data.get("measurement", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ValueError("`measurement` must be tables, each under [[measurement]]")
    assumptions = data.get("assumptions", {})
    return Measured(
        _all(_measurement(table, f"measurement {i}") for i, table in enumerate(tables, 1)),
        {current_path(key): _range(key, value) for key, value in assumptions.items()},
    )


def _from_csv(text):
    rows = csv.DictReader(line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    return Measured(_all(_measurement(_nested(row), f"row {i}") for i, row in enumerate(rows, 1)))


def _nested(row):
    """The cells of a CSV row that hold something, bands put together as in TOML."""
    if None in row or None in row.values():
        raise ValueError(f"each row must have one cell for each name of the header, got {list(row.values())}")
    numbers = {name.strip(): _parsed(name, cell) for name, cell in row.items() if cell.strip()}
    table = {name: value for name, value in numbers.items() if not name.endswith(("_low", "_high"))}
    for name in FITTED:
        ends = {end: numbers.pop(f"{name}_{end}") for end in EDGES if f"{name}_{end}" in numbers}
        if ends:
            table[name] = {"value": table.get(name), **ends}
    return table | {name: value for name, value in numbers.items() if name not in table}


def _parsed(name, cell):
    try:
        return float(cell)
    except ValueError:
        raise ValueError(f"`{name}` must be a number, got {cell!r}") from None


def _all(measurements):
    measurements = tuple(measurements)
    if not measurements:
        raise ValueError("holds no measurement; write one under [[measurement]], or as a row of a CSV")
    return measurements


def _measurement(table, where):
    _refuse_other(table, FITTED + STATED, where)
    if "resistance" in table and "resistance_coefficient" in table:
        raise ValueError(f"{where}: give `resistance` or `resistance_coefficient`, not both")
    bands = {name: _band(table[name], f"{where}, `{name}`") for name in FITTED if name in table}
    if not bands:
        raise ValueError(f"{where}: give at least one of {', '.join(FITTED)}")
    stated = {name: _positive(table[name], f"{where}, `{name}`") for name in STATED if name in table}
    return Measurement(**bands, **stated)


def _band(value, where):
    if not isinstance(value, dict):
        return Band(*[_positive(value, where)] * 3)
    _refuse_other(value, ("value", *EDGES), where)
    middle = _positive(value.get("value"), f"{where} value")
    low, high = (_positive(value.get(end, middle), f"{where} {end}") for end in EDGES)
    if not low <= middle <= high:
        raise ValueError(f"{where}: low <= value <= high must hold, got {low:g}, {middle:g}, {high:g}")
    return Band(middle, low, high)


def _range(key, value):
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"assumptions, `{key}` must be [low, high], got {value!r}")
    low, high = (_positive(end, f"assumptions, `{key}`") for end in value)
    if not low < high:
        raise ValueError(f"assumptions, `{key}`: low < high must hold, got {low:g}, {high:g}")
    return low, high


def _positive(value, where):
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ValueError(f"{where} must be a positive number, got {value!r}")
    return float(value)


def _refuse_other(table, allowed, where):
    for name in table:
        if name not in allowed:
            raise ValueError(f"{where} has no key `{name}`; it takes {', '.join(allowed)}")
