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
from collections.abc import Mapping
from dataclasses import field, fields, is_dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from compact.engines.process.kneading import Reading
from compact.files import read_table, scene_file
from compact.scene.errors import rule_of

PULLS = ("resistance", "resistance_coefficient", "cart_force")  # one of them is given
FITTED = ("load", *PULLS)  # data of a fit
DECAYS = {"damping_ratio", "decay", "decrement"}  # of which a tap test has one
MINUTE = 60.0  # [s]
STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
Positive = Annotated[float, Field(gt=0)]
DensityRatio = Annotated[float, Field(gt=0, lt=1)]


@dataclass(frozen=True, config=STRICT)
class Band:
    """Measured value with its lower and upper bound."""

    value: Positive
    low: Positive
    high: Positive

    def __post_init__(self) -> None:
        if not self.low <= self.value <= self.high:
            raise ValueError(f"low <= value <= high must hold, got {self.low:g}, {self.value:g}, {self.high:g}")


def _band(given: Any) -> Any:
    """Return a number, or a table of a value and its bounds, with both bounds."""
    if isinstance(given, Band):
        return given
    table = given if isinstance(given, dict) else {"value": given}
    return dict.fromkeys(("low", "high"), table.get("value")) | table


OptionalBand = Annotated[Band | None, BeforeValidator(lambda given: given and _band(given))]


@dataclass(frozen=True, config=STRICT)
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
    cart_force : Band or None
        Force that moves a cart at steady speed, guide friction included [N].
    exit_density_ratio : float or None
        Density ratio behind the roller [-]; default that of the scene.
    speed : float or None
        Speed of the roller [m/s]; default that of the scene.
    error : float or None
        Half-width of both forces over them [-], which replaces the spread of the prior; None for design values.
    """

    load: OptionalBand = None
    resistance: OptionalBand = None
    resistance_coefficient: OptionalBand = None
    cart_force: OptionalBand = None
    exit_density_ratio: Positive | None = None
    speed: Positive | None = None
    error: Annotated[float, Field(gt=0, lt=1)] | None = None

    def __post_init__(self) -> None:
        if not 0 < len(self.data) <= 1 + (self.load is not None):
            raise ValueError(f"give `load`, one of `{'`, `'.join(PULLS)}`, or `load` with one of these")

    @property
    def data(self) -> tuple[tuple[str, Band], ...]:
        """Name and band of each datum of a fit."""
        return tuple((name, band) for name in FITTED if (band := getattr(self, name)) is not None)


@dataclass(frozen=True, config=STRICT)
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


@dataclass(frozen=True, config=STRICT)
class Tap:
    """Reading of a tap test: the driven end is blocked, the cart swings.

    Parameters
    ----------
    frequency : float
        Damped natural frequency f [Hz].
    damping_ratio : float
        Damping over critical damping [-], in [0, 1).
    """

    frequency: Positive
    damping_ratio: Annotated[float, Field(ge=0, lt=1)]

    @property
    def natural_frequency(self) -> float:
        """Undamped angular frequency 2 pi f/sqrt(1 - zeta^2) [rad/s]."""
        return 2 * math.pi * self.frequency / math.sqrt(1 - self.damping_ratio**2)


@dataclass(frozen=True, config=STRICT)
class StrokeRow:
    """Row of a forming process: density ratio of the product [-], and force that moves a cart [N]; None if unknown."""

    mould_speed: Positive
    strokes_per_minute: Positive
    density_ratio: Positive | None = None
    force: Positive | None = None

    def __post_init__(self) -> None:
        if self.density_ratio is None and self.force is None:
            raise ValueError("must have mould_speed, strokes_per_minute, and density_ratio or force")

    def changes(self, dwell: float) -> dict[str, object]:
        """Return the changes of a scene with a dwell at each end [s]."""
        return {"process.mould_speed": self.mould_speed, "motion.duration": MINUTE / self.strokes_per_minute - dwell}


@dataclass(frozen=True, config=STRICT)
class Compression:
    """Reading of a confined compression test: pressure [Pa] and density ratio [-]."""

    pressure: Positive
    density_ratio: DensityRatio


@dataclass(frozen=True, config=STRICT)
class KeyValue:
    """Measured value of a key of the scene with its half-width, in the unit of the key."""

    key: str
    value: float
    error: float


@dataclass(frozen=True, config=STRICT)
class _Kneaded:
    """Reading of a gyratory compactor."""

    cycles: Annotated[float, Field(ge=0)]
    pressure: Positive
    density_ratio: DensityRatio
    specimen: str = ""


@dataclass(frozen=True, config=STRICT)
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
    assumptions: dict[str, tuple[Positive, Positive]] = field(default_factory=dict)
    deflections: tuple[Deflection, ...] = ()
    taps: tuple[Tap, ...] = ()
    kneading: tuple[Reading, ...] = ()
    strokes: tuple[StrokeRow, ...] = ()
    compressions: tuple[Compression, ...] = ()
    values: tuple[KeyValue, ...] = ()

    def __post_init__(self) -> None:
        for key, (low, high) in self.assumptions.items():
            if not low < high:
                raise ValueError(f"assumptions, `{key}`: low < high must hold, got {low:g}, {high:g}")

    def moved(self, name: str, value: float) -> "Measured":
        """Return the measurements with another value of the datum `name`, its band widened to contain it."""

        def moved(measurement: Measurement) -> Measurement:
            band = getattr(measurement, name)
            wider: Any = band and Band(value, min(band.low, value), max(band.high, value))
            return replace(measurement, **{name: wider})

        return replace(self, measurements=tuple(map(moved, self.measurements)))


KINDS: dict[str, tuple[Any, str, str]] = {  # table of a file -> record, column by which a CSV file has it, field
    "deflection": (Deflection, "deflection", "deflections"), "tap": (Tap, "frequency", "taps"),
    "kneading": (_Kneaded, "cycles", "kneading"), "stroke": (StrokeRow, "strokes_per_minute", "strokes"),
    "compression": (Compression, "pressure", "compressions"), "value": (KeyValue, "key", "values"),
    "measurement": (Measurement, "", "measurements"),
}  # fmt: skip


def instruments() -> dict[str, dict[str, str]]:
    """Return how each quantity is measured, by its name: how (the instrument), procedure, expected and cost."""
    return {row.pop("name"): row for _, row in read_table(files("compact") / "data" / "instruments.csv")}


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
            kind = next((kind for kind, (_, name, _) in KINDS.items() if cells and name in cells[0]), "measurement")
            data: dict[str, Any] = {kind: cells}
        else:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        if unknown := [name for name in data if name not in (*KINDS, "assumptions")]:
            raise ValueError(f"the file has no key `{unknown[0]}`; it takes {', '.join(KINDS)}, assumptions")
        if not any(data.get(kind) for kind in KINDS):
            raise ValueError("contains no measurement; add a table [[measurement]], or a row of a CSV file")
        found: dict[str, Any] = {"measurements": (), "assumptions": data.get("assumptions", {})}
        for kind, (record, _, name) in KINDS.items():
            rows = TypeAdapter(list[dict[str, Any]]).validate_python(data.get(kind, []))
            found[name] = tuple(validated(record, _row(kind, row), f"{kind} {i}") for i, row in enumerate(rows, 1))
        found["kneading"] = tuple(Reading(*vars(each).values()) for each in found["kneading"])
        return validated(Measured, found, "the file")
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # also of a text that is not UTF-8 or not TOML
        raise ValueError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def _row(kind: str, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the cells of a row that are filled: bounds of a CSV file as bands, any decay as a damping ratio."""
    given = {name: value for name, value in row.items() if value != ""}
    if kind == "measurement":
        for name in (name for name in FITTED if name in given):
            ends = {end: given.pop(f"{name}_{end}") for end in ("low", "high") if f"{name}_{end}" in given}
            given[name] = {"value": given[name]} | ends if ends else given[name]
    elif kind == "tap" and len(names := DECAYS & given.keys()) == 1:
        (name,), value, turn = names, given.pop(*names), 2 * math.pi
        if name != "damping_ratio":  # over the damped angular frequency, zeta/sqrt(1 - zeta^2)
            period = turn * validated(Positive, given.get("frequency"), "`frequency`") if name == "decay" else turn
            ratio = validated(float, value, f"`{name}`") / period
            value = math.copysign(ratio / math.hypot(1, ratio), ratio)
        given["damping_ratio"] = value
    return given


def validated(kind: Any, value: Any, where: str) -> Any:
    """Return a value of a type or record; ValueError with the place, the rule and the value for the first mistake."""
    try:
        return TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    name, kinds = ".".join(str(part) for part in first["loc"]), fields(kind) if is_dataclass(kind) else ()
    if first["type"] == "unexpected_keyword_argument":
        raise ValueError(f"{where} has no key `{name}`; it takes {', '.join(each.name for each in kinds)}")
    if first["type"] == "value_error":
        raise ValueError(f"{where}: {first['ctx']['error']}")
    if first["type"] == "missing":
        raise ValueError(f"{where} has no `{name}`, got {', '.join(first['input']) or 'nothing'}")
    raise ValueError(f"{where}{name and f', `{name}`'} {rule_of(first['msg'])}, got {first['input']!r}")
