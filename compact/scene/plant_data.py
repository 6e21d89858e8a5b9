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

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise ValueError(f"low <= value <= high must hold, got {self.low:g}, {self.value:g}, {self.high:g}")


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
            data: dict[str, Any] = {"measurement": [cells for _, cells in read_table(path)]}
        else:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        tables, assumptions = data.pop("measurement", None), data.pop("assumptions", {})
        if data:
            raise ValueError(f"the file has no key `{next(iter(data))}`; it takes measurement, assumptions")
        if not (tables and isinstance(tables, list) and all(isinstance(each, dict) for each in (*tables, assumptions))):
            raise ValueError("contains no measurement; add a table [[measurement]], or a row of a CSV file")
        measurements = tuple(_measurement(table, f"measurement {i}") for i, table in enumerate(tables, 1))
        return Measured(measurements, {key: _range(key, value) for key, value in assumptions.items()})
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # also of a text that is not UTF-8 or not TOML
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def positive(value: Any, where: str) -> float:
    """Return a number of TOML or a cell of CSV, which must be positive and finite."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0 < number < math.inf:
        raise ValueError(f"{where} must be a positive number, got {value!r}")
    return number


def _measurement(table: dict[str, Any], where: str) -> Measurement:
    flat: dict[str, Any] = {}  # by the names of the columns of CSV
    for name, value in table.items():
        ends = value if isinstance(value, dict) else {"value": value}
        flat |= {name if end == "value" else f"{name}_{end}": each for end, each in ends.items() if each != ""}
    known = (*FITTED, *STATED, *(f"{name}_{end}" for name in FITTED for end in EDGES))
    if unknown := [name for name in flat if name not in known]:
        raise ValueError(f"{where} has no key `{unknown[0]}`; it takes {', '.join(known)}")
    given = {name: positive(value, f"{where}, `{name}`") for name, value in flat.items()}
    values = {name: given[name] for name in FITTED if name in given}
    if not values or {"resistance", "resistance_coefficient"} <= values.keys():
        raise ValueError(f"{where}: give `load`, and `resistance` or `resistance_coefficient`; at least one, not all")
    read: dict[str, Any] = {name: given[name] for name in STATED if name in given}
    for name, value in values.items():
        read[name] = Band(value, *(given.get(f"{name}_{end}", value) for end in EDGES))
    return Measurement(**read)


def _range(key: str, value: Any) -> tuple[float, float]:
    where = f"assumptions, `{key}`"
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"{where} must be [low, high], got {value!r}")
    low, high = (positive(end, where) for end in value)
    if not low < high:
        raise ValueError(f"{where}: low < high must hold, got {low:g}, {high:g}")
    return low, high
