"""Measurements of a plant: forces of rollers, strokes of a process, tests of the drive; TOML or CSV, validated once.

    [[measurement]]
    load = 9740.0                                                     # N on one roller
    resistance_coefficient = {value = 0.179, low = 0.179, high = 0.219}
    exit_density_ratio = 0.98

    [assumptions]                                                     # scene keys without a measurement: [low, high]
    "machine.roller_length" = [0.3, 1.2]

    [[deflection]]                                                    # of the blocked cart
    force = 1000.0                                                    # N, at the driven end
    deflection = 0.00105                                              # m

    [[tap]]                                                           # on the cart, its drive blocked
    frequency = 5.03                                                  # Hz, damped
    damping_ratio = 0.05                                              # or decay in 1/s, or decrement

    [[kneading]]                                                      # of a gyratory compactor
    cycles = 10                                                       # gyrations, 0 before the first
    pressure = 600e3                                                  # Pa
    density_ratio = 0.93
    specimen = "A"                                                    # optional; each has its static slope

    [[compression]]                                                   # confined compression of the mix
    pressure = 100e3                                                  # Pa
    density_ratio = 0.95

    [[value]]                                                         # of a key of the scene
    key = "machine.sleeve_distance"
    value = 0.11
    error = 0.005                                                     # in the unit of the key

    [[stroke]]                                                        # of a forming process with a moving mould
    mould_speed = 0.0175                                              # m/s
    strokes_per_minute = 67.5
    density_ratio = 0.975                                             # of the product, or force, or both
    force = 3600.0                                                    # N, that moves a cart

A CSV has one measurement or one test a row under the same names, and for a band the columns NAME_low and NAME_high.
"""

import math
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from compact.engines.process.kneading import Reading
from compact.files import read_table, scene_file

FITTED = ("load", "resistance", "resistance_coefficient")  # data of a fit
STATED = ("exit_density_ratio", "speed")  # conditions of a measurement
DECAYS = ("damping_ratio", "decay", "decrement")  # of which a tap test has one
EDGES = ("low", "high")
MINUTE = 60.0  # [s]
TESTS = {
    "deflection": "deflection",
    "tap": "frequency",
    "kneading": "cycles",
    "stroke": "strokes_per_minute",
    "compression": "pressure",
    "value": "key",
}  # table of a test -> column by which a CSV file has it


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
class Deflection:
    """Reading of a deflection test: the cart is blocked, the driven end is loaded.

    Parameters
    ----------
    force : float
        Force [N], with its sign.
    deflection : float
        Displacement of the driven end [m], from any zero.
    """

    force: float
    deflection: float


@dataclass(frozen=True)
class Tap:
    """Reading of a tap test: the driven end is blocked, the cart swings.

    Parameters
    ----------
    frequency : float
        Damped natural frequency f [Hz].
    damping_ratio : float
        Damping over critical damping [-], in [0, 1).
    """

    frequency: float
    damping_ratio: float

    def __post_init__(self) -> None:
        if not 0 <= self.damping_ratio < 1:
            raise ValueError(f"`damping_ratio` must be in [0, 1) for a cart that swings, got {self.damping_ratio:g}")

    @property
    def natural_frequency(self) -> float:
        """Undamped angular frequency 2 pi f/sqrt(1 - zeta^2) [rad/s]."""
        return 2 * math.pi * self.frequency / math.sqrt(1 - self.damping_ratio**2)


class StrokeRow(NamedTuple):
    """Row of a forming process: density ratio of the product [-], and force that moves a cart [N]; None if unknown."""

    mould_speed: float
    strokes_per_minute: float
    density_ratio: float | None = None
    force: float | None = None

    def changes(self, dwell: float) -> dict[str, object]:
        """Return the changes of a scene with a dwell at each end [s]."""
        return {"process.mould_speed": self.mould_speed, "motion.duration": MINUTE / self.strokes_per_minute - dwell}


class Compression(NamedTuple):
    """Reading of a confined compression test: pressure [Pa] and density ratio [-]."""

    pressure: float
    density_ratio: float


class KeyValue(NamedTuple):
    """Measured value of a key of the scene with its half-width, in the unit of the key."""

    key: str
    value: float
    error: float


@dataclass(frozen=True)
class Measured:
    """All measurements of a plant.

    Parameters
    ----------
    measurements : tuple of Measurement
        Forces of rollers, which calibrate the mix.
    assumptions : dict
        (low, high) of scene keys without a measurement.
    deflections, taps : tuple
        Tests of the drive.
    kneading : tuple of Reading
        Density over cycles of kneading.
    strokes : tuple of StrokeRow
        Density and force of a forming process.
    compressions : tuple of Compression
        Pressure and density of confined compression.
    values : tuple of KeyValue
        Values of keys.
    """

    measurements: tuple[Measurement, ...]
    assumptions: dict[str, tuple[float, float]] = field(default_factory=dict)
    deflections: tuple[Deflection, ...] = ()
    taps: tuple[Tap, ...] = ()
    kneading: tuple[Reading, ...] = ()
    strokes: tuple[StrokeRow, ...] = ()
    compressions: tuple[Compression, ...] = ()
    values: tuple[KeyValue, ...] = ()

    @property
    def of_drive(self) -> bool:
        """True if there are tests of the drive."""
        return bool(self.deflections or self.taps)

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
    path = scene_file(path)
    try:
        if path.suffix.lower() == ".csv":
            cells = [each for _, each in read_table(path)]
            kind = next((kind for kind, name in TESTS.items() if cells and name in cells[0]), "measurement")
            data: dict[str, Any] = {kind: cells}
        else:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        readers = (_measurement, _deflection, _tap, _kneading, _stroke, _compression, _value)
        kinds = dict(zip(("measurement", *TESTS), readers, strict=True))
        tables, assumptions = {kind: data.pop(kind, []) for kind in kinds}, data.pop("assumptions", {})
        if data:
            raise ValueError(f"the file has no key `{next(iter(data))}`; it takes {', '.join(kinds)}, assumptions")
        lists = all(isinstance(each, list) for each in tables.values())
        rows = [each for found in tables.values() for each in found] if lists else []
        if not (rows and all(isinstance(each, dict) for each in (*rows, assumptions))):
            raise ValueError("contains no measurement; add a table [[measurement]], or a row of a CSV file")
        read: list[Any] = [
            tuple(kinds[kind](table, f"{kind} {i}") for i, table in enumerate(found, 1))
            for kind, found in tables.items()
        ]
        ranges = {key: _range(key, value) for key, value in assumptions.items()}
        return Measured(read[0], ranges, *read[1:])
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # also of a text that is not UTF-8 or not TOML
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def number(value: Any, where: str, least: float = -math.inf, words: str = "a number") -> float:
    """Return a number of TOML or a cell of CSV, which must be finite and greater than `least`."""
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not least < found < math.inf:
        raise ValueError(f"{where} must be {words}, got {value!r}")
    return found


def positive(value: Any, where: str) -> float:
    """Return a number of TOML or a cell of CSV, which must be positive and finite."""
    return number(value, where, 0.0, "a positive number")


def _require_keys(table: dict[str, Any], where: str, *names: str) -> None:
    if table.keys() != {*names}:
        raise ValueError(f"{where} must have {', '.join(names)}, got {', '.join(table) or 'nothing'}")


def _deflection(table: dict[str, Any], where: str) -> Deflection:
    _require_keys(table, where, "force", "deflection")
    return Deflection(*(number(table[name], f"{where}, `{name}`") for name in ("force", "deflection")))


def _compression(table: dict[str, Any], where: str) -> Compression:
    _require_keys(table, where, *Compression._fields)
    return Compression(positive(table["pressure"], f"{where}, `pressure`"), _density(table, where))


def _value(table: dict[str, Any], where: str) -> KeyValue:
    _require_keys(table, where, *KeyValue._fields)
    sizes = (number(table[name], f"{where}, `{name}`") for name in ("value", "error"))
    return KeyValue(str(table["key"]), *sizes)


def _density(table: dict[str, Any], where: str) -> float:
    found = positive(table["density_ratio"], f"{where}, `density_ratio`")
    if found >= 1:
        raise ValueError(f"{where}, `density_ratio` must be below 1, got {found:g}")
    return found


def _tap(table: dict[str, Any], where: str) -> Tap:
    given = {name: value for name, value in table.items() if value != ""}
    if "frequency" not in given or len(given) != 2 or not given.keys() & {*DECAYS}:
        raise ValueError(f"{where} must have `frequency` and one of {', '.join(DECAYS)}, got {', '.join(given)}")
    frequency = positive(given.pop("frequency"), f"{where}, `frequency`")
    (name, value), turn = given.popitem(), 2 * math.pi
    found = number(value, f"{where}, `{name}`")
    # decay over the damped angular frequency, zeta/sqrt(1 - zeta^2); a decrement is that of one period
    ratio = {"decay": found / (turn * frequency), "decrement": found / turn}.get(name)
    return Tap(frequency, found if ratio is None else math.copysign(ratio / math.hypot(1, ratio), found))


def _kneading(table: dict[str, Any], where: str) -> Reading:
    given = {name: each for name, each in table.items() if each != ""}
    specimen = str(given.pop("specimen", ""))
    _require_keys(given, where, "cycles", "pressure", "density_ratio")
    cycles = number(given["cycles"], f"{where}, `cycles`", -1e-9, "a number in range")
    return Reading(cycles, positive(given["pressure"], f"{where}, `pressure`"), _density(given, where), specimen)


def _stroke(table: dict[str, Any], where: str) -> StrokeRow:
    given = {name: positive(each, f"{where}, `{name}`") for name, each in table.items() if each != ""}
    if given.keys() - {*StrokeRow._fields} or len(given) < 3 or not given.keys() >= {*StrokeRow._fields[:2]}:
        words = "must have mould_speed, strokes_per_minute, and density_ratio or force"
        raise ValueError(f"{where} {words}, got {', '.join(given) or 'nothing'}")
    return StrokeRow(**given)


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
