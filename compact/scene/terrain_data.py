"""Terrain under a wheel: published soils by name, and own constants from the table [terrain] of a TOML file.

    [terrain]
    law = "bekker"                 # bekker, reece, power, johanson or table
    cohesive_modulus = 990.0       # kc in N/m^(n+1); reece: k1 in Pa
    frictional_modulus = 1.52843e6 # kphi in N/m^(n+2); reece: k2 in Pa/m
    exponent = 1.1
    cohesion = 1040.0              # Pa; these three together, or none for a wheel without shear
    friction_angle = 28.0          # degrees
    shear_displacement = 0.02      # m

`data/terrains.csv` is the registry of published soils.
"""

import csv
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from compact.material.pressure_sinkage import (
    JohansonLaw,
    PeakAngle,
    PowerSinkage,
    PressureLaw,
    ShearStrength,
    TabulatedLaw,
    Terrain,
    bekker,
    reece,
)
from compact.numerics.validation import require_known
from compact.scene.errors import key_lines, syntax_sentence

LAW_KEYS: Mapping[str, tuple[str, ...]] = {
    "bekker": ("cohesive_modulus", "frictional_modulus", "exponent"),
    "reece": ("cohesive_modulus", "frictional_modulus", "exponent"),
    "power": ("modulus", "exponent"),
    "johanson": ("initial_pressure", "compressibility"),
    "table": ("sinkage", "pressure"),
}
SHEAR_KEYS, PEAK_KEYS, FURTHER_KEYS = ("cohesion", "friction_angle", "shear_displacement"), ("c1", "c2"), ("source",)
REBOUND = "rebound_modulus"


def published_terrains() -> dict[str, dict[str, Any]]:
    """Return the constants of the published soils by their names."""
    text = files("compact").joinpath("data/terrains.csv").read_text(encoding="utf-8")
    words = ("law", "source")
    return {
        row.pop("name"): {key: cell if key in words else float(cell) for key, cell in row.items() if cell}
        for row in csv.DictReader(text.splitlines())
    }


def read_terrain(name: str) -> tuple[dict[str, Any], str]:
    """Return the constants of a published soil or of a TOML file, and the place for messages.

    Raises
    ------
    ValueError
        If no such soil or file exists, or the file breaks a rule.
    """
    if not name.endswith(".toml"):
        soils = published_terrains()
        if name not in soils:
            require_known("soil", name, (*soils, "FILE.toml"))
        return soils[name], name
    try:
        text = Path(name).read_text(encoding="utf-8")
        table = tomllib.loads(text).get("terrain")
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{name}:{syntax_sentence(error, text)}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{name}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not isinstance(table, dict):
        raise ValueError(f"{name}: has no table [terrain]; give its `law`, one of {', '.join(LAW_KEYS)}")
    _require_keys(table, name, key_lines(text))
    return table, name


def _require_keys(table: Mapping[str, Any], file: str, lines: Mapping[tuple[str, ...], int]) -> None:
    """Require the keys of the law and complete groups of the others."""
    first = f"{file}:{lines.get(('terrain',), 1)}: [terrain]"
    law = str(table.get("law"))
    if law not in LAW_KEYS:
        place = f"{file}:{lines.get(('terrain', 'law'), 1)}: [terrain]"
        raise ValueError(f"{place} `law` must be one of {', '.join(LAW_KEYS)}, got {law!r}")
    allowed = ("law", *LAW_KEYS[law], *SHEAR_KEYS, *PEAK_KEYS, REBOUND, *FURTHER_KEYS)
    for key, value in table.items():
        place = f"{file}:{lines.get(('terrain', key), 1)}: [terrain]"
        if key not in allowed:
            raise ValueError(f"{place} has no key `{key}` with law '{law}'; it takes {', '.join(allowed)}")
        if key in ("law", *FURTHER_KEYS):
            continue
        values = value if key in LAW_KEYS["table"] and isinstance(value, list) else [value]
        if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in values):
            raise ValueError(f"{place} `{key}` must be a number, got {value!r}")
    for group in (LAW_KEYS[law], SHEAR_KEYS, PEAK_KEYS):
        missing = [key for key in group if key not in table]
        if missing and (group is LAW_KEYS[law] or len(missing) < len(group)):
            raise ValueError(f"{first} must state {' and '.join(f'`{key}`' for key in missing)} too")


def build_terrain(constants: Mapping[str, Any], width: float) -> Terrain:
    """Build a terrain from its constants.

    Parameters
    ----------
    constants : dict
        Keys of [terrain], in SI units and degrees.
    width : float
        Width of the wheel [m], Bekker's b.

    Returns
    -------
    Terrain
    """
    values: list[Any] = [constants[key] for key in LAW_KEYS[constants["law"]]]
    law: PressureLaw
    if constants["law"] in ("bekker", "reece"):
        cohesive, frictional, exponent = values
        law = (bekker if constants["law"] == "bekker" else reece)(cohesive, frictional, exponent, width)
    elif constants["law"] == "table":
        law = TabulatedLaw(*(tuple(float(each) for each in column) for column in values))
    else:
        law = (PowerSinkage if constants["law"] == "power" else JohansonLaw)(*values)
    shear = ShearStrength(*(constants[key] for key in SHEAR_KEYS)) if SHEAR_KEYS[0] in constants else None
    peak = PeakAngle(*(constants[key] for key in PEAK_KEYS)) if PEAK_KEYS[0] in constants else None
    return Terrain(law, shear, peak, constants.get(REBOUND, np.inf))
