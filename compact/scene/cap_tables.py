"""Tables over the density ratio of the law "density-cap": a CSV file, named by `mix.cap_table`.

    # source and licence of the numbers; lines that begin with # are remarks
    density_ratio,yield_pressure,cohesion,friction_angle,eccentricity,youngs_modulus,poisson
    0.40,4.03e6,0.7225e6,68.776,0.312,,
    0.45,,,,,302e6,0.047

Stresses are in Pa and angles in degrees; the columns are those of `density_cap.DensityCap`. A row has the four cells of
the cap, the two of the elastic constants, or all six.
"""

import csv
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from compact.material.density_cap import DensityCap

DENSITY = "density_ratio"
CAP = ("yield_pressure", "cohesion", "friction_angle", "eccentricity")
ELASTIC = ("youngs_modulus", "poisson")
COLUMNS = (DENSITY, *CAP, *ELASTIC)
LIMITS = {DENSITY: 1.0, "friction_angle": 90.0, "poisson": 0.5}  # [-], [deg], [-], upper bounds of the cells
Row = tuple[int, dict[str, float]]  # line number and cells


def read_cap_tables(path: Path) -> DensityCap:
    """Read the tables of a cap.

    Raises
    ------
    ValueError
        If the file cannot be read or breaks a rule; the message contains file and line.
    """
    rows = _rows(path)
    cap = [row for row in rows if CAP[0] in row[1]]
    elastic = [row for row in rows if ELASTIC[0] in row[1]]
    for words, chosen in (("of the cap", cap), ("with elastic constants", elastic)):
        if len(chosen) < 2:
            raise ValueError(f"{path}: must have at least two rows {words}, got {len(chosen)}")
    for message in (*_falling(cap, DENSITY), *_falling(elastic, DENSITY), *_falling(cap, CAP[0]), *_centres(cap)):
        raise ValueError(f"{path}:{message}")
    columns = [tuple(cells[name] for _, cells in cap) for name in (DENSITY, *CAP)]
    return DensityCap(*columns, *(tuple(cells[name] for _, cells in elastic) for name in (DENSITY, *ELASTIC)))


def _rows(path: Path) -> list[Row]:
    """Return line numbers and cells of the rows below the header."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    kept = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not kept:
        raise ValueError(f"{path}: has no header; begin with the line {','.join(COLUMNS)}")
    header = [name.strip() for name in kept[0][1].split(",")]
    if sorted(header) != sorted(COLUMNS):
        raise ValueError(f"{path}:{kept[0][0]}: the columns must be {','.join(COLUMNS)}, got {','.join(header)}")
    found = []
    for (number, _), cells in zip(kept[1:], csv.reader(line for _, line in kept[1:]), strict=True):
        row = _cells(f"{path}:{number}", header, cells)
        _require_complete(f"{path}:{number}", row)
        found.append((number, row))
    return found


def _cells(place: str, header: list[str], cells: list[str]) -> dict[str, float]:
    """Return the numbers of a row by column; require bounds."""
    if len(cells) != len(header):
        raise ValueError(f"{place}: must have {len(header)} cells, got {len(cells)}")
    found = {}
    for name, cell in zip(header, cells, strict=True):
        if not cell.strip():
            continue
        try:
            found[name] = float(cell)
        except ValueError:
            raise ValueError(f"{place}: `{name}` must be a number, got {cell.strip()!r}") from None
        limit = LIMITS.get(name, math.inf)
        if not 0 < found[name] < limit:
            raise ValueError(f"{place}: `{name}` must be above 0 and below {limit:g}, got {cell.strip()}")
    return found


def _require_complete(place: str, row: dict[str, float]) -> None:
    """Require a density ratio and complete groups of cells."""
    if DENSITY not in row or len(row) == 1:
        raise ValueError(f"{place}: must have a `{DENSITY}` and the cells of the cap, the elastic constants or both")
    for group in (CAP, ELASTIC):
        missing = [name for name in group if name not in row]
        if 0 < len(missing) < len(group):
            raise ValueError(f"{place}: lacks `{'`, `'.join(missing)}`; fill {', '.join(group)} or leave all empty")


def _falling(rows: list[Row], name: str) -> Iterator[str]:
    """Yield line and rule of rows whose value does not exceed that of the row before."""
    for (_, before), (number, cells) in pairwise(rows):
        if not cells[name] > before[name]:
            yield f"{number}: `{name}` must ascend, got {cells[name]:g} after {before[name]:g}"


def _centres(rows: list[Row]) -> Iterator[str]:
    """Yield line and rule of rows whose cap has its top at no pressure, or at a lower one than the row before."""
    last = 0.0
    for number, cells in rows:
        pressure, cohesion, angle, eccentricity = (cells[name] for name in CAP)
        centre = (pressure - eccentricity * cohesion) / (1 + eccentricity * math.tan(math.radians(angle)))
        if not centre > last:
            yield (
                f"{number}: the pressure at the top of the cap, (yield_pressure - eccentricity cohesion)/(1 + "
                f"eccentricity tan friction_angle), must be positive and ascend, got {centre:.4g} Pa after {last:.4g}"
            )
        last = centre
