"""Tables of results, each declared once for CSV, page, notebook, data frame and dataset; numbers as text and JSON.

A column is named as in its CSV file, `peak_force_N`: field and SI unit in ASCII. Term, symbol and unit of plots follow
from `compact.quantities`; a field that is not in it has its name as term. The files hold twelve digits, the page four.
"""

import math
import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from compact import quantities
from compact.files import write_csv
from compact.quantities import Quantity, column_names, unit_symbol

if TYPE_CHECKING:
    import pandas
    import xarray

DIGITS = 4  # [-], significant digits of a table on the page; sentences have three
HTML_ROWS = 60  # [-], rows of a table in a notebook; the middle of a longer one is left out
CELL = "text-align: left; padding: 0.15em 1.2em 0.15em 0"  # style of a cell in a notebook
ZERO_SHARE = 1e-9  # [-], below which a share is rounding and shown as zero
COLUMN_SPAN = 100  # [-], over which the smallest value of a column still shows all its digits
PREFIX_FACTORS = {"G": 1e9, "M": 1e6, "k": 1e3, "": 1.0, "m": 1e-3, "µ": 1e-6}
UNIT_PREFIXES = {  # units that have a prefix, and their prefixes, largest first
    "N": "Mk", "N/m": "Mk", "Pa": "GMk", "W": "Mk", "J": "Mk", "m": "mµ", "s": "mµ", "Nm": "k", "J/m3": "k",
}  # fmt: skip
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
UNIT = re.compile(r"(?:(?:rad|kg|Pa|SI|[NWJmsh])\d?/?)+")  # at the end of the name of a column
WORD = Quantity("", "")  # of a column of words
OF_ROW = ("value", "low", "high")  # columns in the unit of each row, where a table has a column "unit"
Getter = str | Callable[[Any], Any]


@cache
def _known() -> dict[tuple[str, str], Quantity]:
    """Collect the quantities of the package by field and unit; the first record that has one defines it."""
    tables = [table for table in vars(quantities).values() if isinstance(table, dict)]
    items = [item for table in reversed(tables) for item in table.items()]
    return {(name, each.unit): each for name, each in items if isinstance(each, Quantity)}


def columns(names: str) -> dict[str, Getter]:
    """Declare columns: names as in the CSV file, each of a field of the same name, or with another path, `NAME=PATH`.

    Parameters
    ----------
    names : str
        Columns separated by blanks. A path joins attributes and indices by dots; None on the way is the value.

    Examples
    --------
    >>> columns("law=name peak_force_N")
    {'law': 'name', 'peak_force_N': 'peak_force'}
    """
    found: dict[str, Getter] = {}
    for each in names.split():
        column, _, path = each.partition("=")
        found[column] = path or split_unit(column)[0]
    return found


def split_unit(column: str) -> tuple[str, str]:
    """Return field and unit of the name of a column, unit "1" without one.

    Examples
    --------
    >>> split_unit("peak_jerk_m/s3"), split_unit("exit_density_ratio")
    (('peak_jerk', 'm/s3'), ('exit_density_ratio', '1'))
    """
    name, _, unit = column.rpartition("_")
    return (name, unit) if name and UNIT.fullmatch(unit) else (column, "1")


def value_of(record: Any, getter: Getter) -> Any:
    """Return a value of a record by a path or a function."""
    if callable(getter):
        return getter(record)
    for part in getter.split("."):
        if record is None:
            return None
        record = record[int(part)] if part.isdigit() else getattr(record, part)
    return record


def json_number(value: Any, unit: str) -> dict[str, Any]:
    """Return a number with its SI unit for a JSON file, "1" for a dimensionless number."""
    return {"value": value, "unit": unit}


def json_values(record: Any, names: str) -> dict[str, Any]:
    """Return values of a record for a JSON file, by the names of `columns`."""
    return {name: value_of(record, getter) for name, getter in columns(names).items()}


def json_numbers(record: Any, names: str) -> dict[str, dict[str, Any]]:
    """Return values of a record with their units for a JSON file, in the columns of `columns`."""
    found = {}
    for column, getter in columns(names).items():
        name, unit = split_unit(column)
        found[name] = json_number(value_of(record, getter), {"kgm2": "kg m2"}.get(unit, unit))
    return found


@dataclass(frozen=True)
class Mark:
    """Text of a page with a label in front.

    Parameters
    ----------
    kind : str
        Style of the label: "assumed", "known", "good" or "bad".
    """

    kind: str
    label: str
    text: str = ""


@dataclass(frozen=True)
class TableSpec:
    """Table of results.

    Parameters
    ----------
    title : str
        Title on the page and in a notebook.
    quantities : mapping of str to Quantity
        Quantity of each column; `WORD` for words.
    rows : sequence
        Values of each row in SI units; None is an empty cell.
    """

    title: str
    quantities: Mapping[str, Quantity]
    rows: Sequence[Sequence[Any]]

    @classmethod
    def of(cls, title: str, records: Iterable[Any], names: str, **getters: Getter) -> Self:
        """Make a table of records, a row each, in the columns of `columns`, with further ones by functions."""
        declared = columns(names) | getters
        rows = [[value_of(record, getter) for getter in declared.values()] for record in records]
        found = {}
        for place, column in enumerate(declared):
            name, unit = split_unit(column)
            words = unit == "1" and any(isinstance(row[place], str | Mark) for row in rows)
            found[name] = WORD if words else _known().get((name, unit), Quantity("", unit))
        return cls(title, found, rows)

    @classmethod
    def of_arrays(cls, title: str, names: str, values: Sequence[Any]) -> Self:
        """Make a table of arrays of numbers, in columns as of `columns`."""
        known = dict(map(split_unit, names.split()))
        return cls(title, {name: Quantity("", unit) for name, unit in known.items()}, np.column_stack(values).tolist())

    @classmethod
    def of_columns(
        cls, title: str, values: Mapping[str, Iterable[Any]], known: Mapping[str, Quantity] | None = None
    ) -> Self:
        """Make a table of columns by field; a field that has no quantity is of words."""
        rows = list(zip(*values.values(), strict=True))
        return cls(title, {name: (known or {}).get(name, WORD) for name in values}, rows)

    def __getitem__(self, name: str) -> list[Any]:
        place = list(self.quantities).index(name)
        return [row[place] for row in self.rows]

    def shown(self, title: str, *names: str, **more: Sequence[Any]) -> Self:
        """Return some columns as text of the page under another title, and further columns of words."""
        return type(self).of_columns(title, {**self.cells(*names), **more})

    def text(self, name: str) -> list[Any]:
        """Return a column as text of the page: one prefix and one number of decimals, words as they are."""
        values = self[name]
        if self.quantities[name] is WORD:
            return ["" if value is None else value for value in values]
        if name in OF_ROW and "unit" in self.quantities:
            return [format_quantity(*each) for each in zip(values, self["unit"], strict=True)]
        if all(isinstance(value, int) for value in values):
            return [format_number(value) for value in values]
        return format_column(values, self.quantities[name].unit)

    def cells(self, *names: str) -> dict[str, list[Any]]:
        """Return columns as text of the page by their heads, the terms or the names; all of them by default."""
        heads = {name: each.term or name.replace("_", " ") for name, each in self.quantities.items()}
        return {heads[name]: self.text(name) for name in names or self.quantities}

    def write(self, path: Path) -> Path:
        """Write CSV in SI units with twelve digits; return the path."""
        return write_csv(path, column_names(self.quantities), self.rows)

    def to_dataframe(self, index: str | None = None) -> "pandas.DataFrame":
        """Return a data frame in SI units, whose `attrs["units"]` has the unit of each column of numbers.

        Parameters
        ----------
        index : str, optional
            Column that becomes the index.
        """
        import pandas

        frame = pandas.DataFrame({name: self[name] for name in self.quantities})
        frame = frame if index is None else frame.set_index(index)
        frame.attrs["units"] = {name: each.unit for name, each in self.quantities.items() if each is not WORD}
        return frame

    def to_xarray(self, dimension: str, attributes: Mapping[str, Any]) -> "xarray.Dataset":
        """Return a dataset over one dimension, whose variables have `units` and `long_name`.

        Parameters
        ----------
        dimension : str
            Column that becomes the coordinate.
        attributes : mapping
            Attributes of the dataset.
        """
        import xarray

        found = {}
        for name, quantity in self.quantities.items():
            told = {"units": quantity.unit, "long_name": quantity.long_name or name.replace("_", " ")}
            found[name] = ((dimension,), [math.nan if value is None else value for value in self[name]], told)
        coordinate = {dimension: found.pop(dimension)}
        return xarray.Dataset(found, coordinate, dict(attributes))

    def to_html(self) -> str:
        """Return the table with its title for a notebook, as text of the page."""
        import pandas

        frame = pandas.DataFrame({name.replace("_", " "): self.text(name) for name in self.quantities})
        table = frame.to_html(index=False, max_rows=HTML_ROWS, border=0, justify="left")
        for tag in ("th", "td"):
            table = table.replace(f"<{tag}>", f'<{tag} style="{CELL}">')
        return f"<p><b>{escape(self.title)}</b></p>{table}"


class Tabular:
    """Result with one table in SI units, from which data frame, dataset and the view in a notebook follow."""

    _index: ClassVar[str | None] = None  # column that becomes the index
    _quantities: ClassVar[Mapping[str, Quantity]] = {}  # of the columns of numbers

    @abstractmethod
    def columns(self) -> Mapping[str, Iterable[Any]]:
        """Return the values of the columns by field, in SI units."""

    @property
    def table(self) -> TableSpec:
        """Table of the result, with its quantities."""
        return TableSpec.of_columns(repr(self)[1:-1], self.columns(), self._quantities)

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the table in SI units; `attrs["units"]` maps each column to its unit."""
        return self.table.to_dataframe(self._index)

    def to_xarray(self) -> "xarray.Dataset":
        """Return the table as a dataset over its index, such as the speed [m/s], with units."""
        attributes = {name: getattr(self, name) for name in ("engine", "title") if hasattr(self, name)}
        return self.table.to_xarray(self._index or next(iter(self.table.quantities)), attributes)

    def _repr_html_(self) -> str:
        return self.table.to_html()


def format_number(value: float | bool | None, digits: int = DIGITS) -> str:
    """Format a number without an exponent between 0.001 and a million.

    Parameters
    ----------
    value : float or bool or None
        Number; None and nan are a dash.
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if math.isinf(value):
        return "infinite"
    if value and not 1e-3 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa.replace('-', '−')} × 10{str(int(power)).translate(SUPERSCRIPTS)}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
    text = f"{value or 0:.{decimals}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")


def format_quantity(value: float | None, unit: str, digits: int = DIGITS) -> str:
    """Format a quantity with the prefix that makes it shortest.

    Parameters
    ----------
    value : float or None
        Value in the unit.
    unit : str
        SI unit in ASCII, "1" for a dimensionless quantity.

    Examples
    --------
    >>> format_quantity(203e3, "Pa"), format_quantity(0.05573, "m"), format_quantity(0.179, "1")
    ('203 kPa', '55.73 mm', '0.179')
    """
    if value is None or not math.isfinite(value):
        return format_number(value)
    prefix = _prefix(value, unit)
    return f"{format_number(value / PREFIX_FACTORS[prefix], digits)} {prefix}{unit_symbol(unit)}".rstrip()


def format_column(values: Sequence[float | None], unit: str, digits: int = DIGITS) -> list[str]:
    """Format the quantities of a column with one prefix and one number of decimals.

    Parameters
    ----------
    values : sequence of float or None
        Values in the unit.
    unit : str
        SI unit in ASCII.
    digits : int
        Significant digits of the smallest value that is not negligible against the largest.

    Examples
    --------
    >>> format_column([532.5, 1048.0, float("inf")], "W")
    ['532.5 W', '1048.0 W', 'infinite']
    """
    sizes = [abs(value) for value in values if value is not None and math.isfinite(value) and value]
    least = min((size for size in sizes if size >= max(sizes) / COLUMN_SPAN), default=0.0)
    prefix = _prefix(least, unit)
    factor = PREFIX_FACTORS[prefix]
    decimals = max(0, digits - 1 - math.floor(math.log10(least / factor))) if least else math.inf
    if decimals > 2 * digits:
        return [format_quantity(value, unit) for value in values]
    return [
        f"{value / factor or 0:.{decimals}f} {prefix}{unit_symbol(unit)}".rstrip().replace("-", "−")
        if value is not None and math.isfinite(value)
        else format_number(value)
        for value in values
    ]


def format_percent(share: float | None) -> str:
    """Format a share as per cent; a share within rounding of zero is zero, None and nan a dash.

    Parameters
    ----------
    share : float or None
        Share [-].
    """
    if share is None or not math.isfinite(share):
        return "–"
    return f"{format_number(100 * share if abs(share) > ZERO_SHARE else 0.0, 2)} %"


def _prefix(value: float, unit: str) -> str:
    """Return the prefix of a finite value: the largest below it, or the largest small one below 0.1."""
    size, factors = abs(value), PREFIX_FACTORS
    fits = (p for p in UNIT_PREFIXES.get(unit, "") if size >= factors[p] and (factors[p] > 1 or size < 0.1))
    return next(fits, "")
