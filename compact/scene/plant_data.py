"""Measurements of a plant: load, resistance and density, read from TOML or CSV and validated once.

    [[measurement]]
    load = 9740.0                                                     # N on one roller
    resistance_coefficient = {value = 0.179, low = 0.179, high = 0.219}
    exit_density_ratio = 0.98

    [assumptions]                                                     # scene keys without a measurement: [low, high]
    "machine.roller_length" = [0.3, 1.2]

A CSV has one measurement a row under the same names, and for a band the columns NAME_low and NAME_high.
"""

import math
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from compact.files import read_table

FITTED = ("load", "resistance", "resistance_coefficient")  # data of a fit
STATED = ("exit_density_ratio", "speed")  # conditions of a measurement
EDGES = ("low", "high")


@dataclass(frozen=True)
class Band:
    """Measured value with its lower and upper bound."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Measurement:
    """One measurement on one roller; None for a quantity that was not measured.

    Parameters
    ----------
    load : Band or None
        Vertical force on the roller [N].
    resistance : Band or None
        Horizontal force of the mix on the roller [N].
    resistance_coefficient : Band or None
        Resistance over load [-].
    exit_density_ratio : float or None
        Density ratio behind the roller [-]; default that of the scene.
    speed : float or None
        Speed of the roller [m/s]; default that of the scene.
    """

    load: Band | None = None
    resistance: Band | None = None
    resistance_coefficient: Band | None = None
    exit_density_ratio: float | None = None
    speed: float | None = None

    @property
    def data(self) -> tuple[tuple[str, Band], ...]:
        """Name and band of each datum of a fit."""
        return tuple((name, band) for name in FITTED if (band := getattr(self, name)) is not None)


@dataclass(frozen=True)
class Measured:
    """All measurements of a plant.

    Parameters
    ----------
    assumptions : dict
        (low, high) of scene keys without a measurement.
    """

    measurements: tuple[Measurement, ...]
    assumptions: dict[str, tuple[float, float]] = field(default_factory=dict)

    def moved(self, name: str, value: float) -> "Measured":
        """Return the measurements with another value of the datum `name`, its band widened to contain it."""

        def moved(measurement: Measurement) -> Measurement:
            band = getattr(measurement, name)
            wider: Any = band and Band(value, min(band.low, value), max(band.high, value))
            return replace(measurement, **{name: wider})

        return replace(self, measurements=tuple(map(moved, self.measurements)))


def read_measurements(path: str | Path) -> Measured:
    """Read measurements from a TOML or CSV file.

    Raises
    ------
    ValueError
        If the file cannot be read or a key is unknown or out of bounds; the message names file and key.
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".csv":
            data: dict[str, Any] = {"measurement": [_nested(cells) for _, cells in read_table(path)]}
        else:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        _require_keys(data, ("measurement", "assumptions"), "the file")
        tables, assumptions = data.get("measurement", []), data.get("assumptions", {})
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise ValueError("`measurement` must be tables, each under [[measurement]]")
        if not tables:
            raise ValueError("contains no measurement; add a table [[measurement]], or a row of a CSV file")
        measurements = (_measurement(table, f"measurement {i}") for i, table in enumerate(tables, 1))
        return Measured(tuple(measurements), {key: _range(key, value) for key, value in assumptions.items()})
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # also of a text that is not UTF-8 or not TOML
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def _nested(cells: dict[str, str]) -> dict[str, Any]:
    """Return the nonempty cells of a CSV row, with bands nested as in TOML."""
    bands: dict[str, dict[str, float]] = {}
    for name, cell in cells.items():
        quantity, _, end = name.rpartition("_")
        try:
            value = float(cell) if cell else None
        except ValueError:
            raise ValueError(f"`{name}` must be a number, got {cell!r}") from None
        if value is not None:
            of_band = end in EDGES and quantity in FITTED
            bands.setdefault(quantity if of_band else name, {})[end if of_band else "value"] = value
    return {name: band.get("value") if band.keys() == {"value"} else band for name, band in bands.items()}


def _measurement(table: dict[str, Any], where: str) -> Measurement:
    _require_keys(table, FITTED + STATED, where)
    if "resistance" in table and "resistance_coefficient" in table:
        raise ValueError(f"{where}: give `resistance` or `resistance_coefficient`, not both")
    bands: dict[str, Any] = {name: _band(table[name], f"{where}, `{name}`") for name in FITTED if name in table}
    if not bands:
        raise ValueError(f"{where}: give at least one of {', '.join(FITTED)}")
    stated: dict[str, Any] = {name: _positive(table[name], f"{where}, `{name}`") for name in STATED if name in table}
    return Measurement(**bands, **stated)


def _band(value: Any, where: str) -> Band:
    if not isinstance(value, dict):
        return Band(*[_positive(value, where)] * 3)
    _require_keys(value, ("value", *EDGES), where)
    middle = _positive(value.get("value"), f"{where} value")
    low, high = (_positive(value.get(end, middle), f"{where} {end}") for end in EDGES)
    if not low <= middle <= high:
        raise ValueError(f"{where}: low <= value <= high must hold, got {low:g}, {middle:g}, {high:g}")
    return Band(middle, low, high)


def _range(key: str, value: Any) -> tuple[float, float]:
    where = f"assumptions, `{key}`"
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"{where} must be [low, high], got {value!r}")
    low, high = (_positive(end, where) for end in value)
    if not low < high:
        raise ValueError(f"{where}: low < high must hold, got {low:g}, {high:g}")
    return low, high


def _positive(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ValueError(f"{where} must be a positive number, got {value!r}")
    return float(value)


def _require_keys(table: dict[str, Any], allowed: tuple[str, ...], where: str) -> None:
    for name in table:
        if name not in allowed:
            raise ValueError(f"{where} has no key `{name}`; it takes {', '.join(allowed)}")
