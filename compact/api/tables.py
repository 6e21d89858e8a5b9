"""Results as pandas tables, xarray datasets and HTML, with units and meanings from `compact.quantities`.

A table is a mapping from the name of a column to its values. `units` of the attributes of a data frame, and `units` and
`long_name` of a variable of a dataset, state the SI unit of each quantity.
"""

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from compact.quantities import Quantity

if TYPE_CHECKING:
    import pandas
    import xarray

HTML_ROWS = 60  # [-], rows of a table in a notebook; the middle of a longer one is left out
CELL = "text-align: left; padding: 0.15em 1.2em 0.15em 0"  # style of a cell
WORD = Quantity("", "")  # of a column without unit

Columns = Mapping[str, Sequence[Any]]
Quantities = Mapping[str, Quantity]


def build_frame(columns: Columns, quantities: Quantities, index: str | None = None) -> "pandas.DataFrame":
    """Return a data frame in SI units.

    Parameters
    ----------
    columns : mapping
        Values by column.
    quantities : mapping
        Quantity by column; a column without one has no unit.
    index : str, optional
        Column that becomes the index.

    Returns
    -------
    pandas.DataFrame
        Its `attrs["units"]` maps each column to its unit.
    """
    import pandas

    frame = pandas.DataFrame({name: list(values) for name, values in columns.items()})
    frame = frame if index is None else frame.set_index(index)
    frame.attrs["units"] = {name: quantities[name].unit for name in columns if name in quantities}
    return frame


def build_dataset(
    columns: Columns, quantities: Quantities, dimension: str, attributes: Mapping[str, Any]
) -> "xarray.Dataset":
    """Return a dataset over one dimension, whose variables have `units` and `long_name`.

    Parameters
    ----------
    columns : mapping
        Values by variable; one of them is the coordinate.
    quantities : mapping
        Quantity by variable.
    dimension : str
        Name of the coordinate.
    attributes : mapping
        Attributes of the dataset.

    Returns
    -------
    xarray.Dataset
    """
    import xarray

    found = {}
    for name, values in columns.items():
        quantity = quantities.get(name, WORD)
        told = {"units": quantity.unit, "long_name": quantity.long_name or name.replace("_", " ")}
        found[name] = ((dimension,), list(values), told)
    coordinate = {dimension: found.pop(dimension)}
    return xarray.Dataset(found, coordinate, dict(attributes))


def render_html(title: str, columns: Columns, quantities: Quantities) -> str:
    """Return a table with a title as HTML: units of plots in the head, four digits.

    Parameters
    ----------
    title : str
        Line above the table.
    columns, quantities : mapping
        As of `build_frame`.

    Returns
    -------
    str
    """
    frame = build_frame(columns, quantities)
    for name in columns:
        if (factor := quantities.get(name, WORD).plot_factor) != 1:
            frame[name] = frame[name] * factor
    frame.columns = [_head(name, quantities.get(name, WORD)) for name in columns]
    table = frame.to_html(
        index=False, max_rows=HTML_ROWS, float_format="{:.4g}".format, border=0, na_rep="", justify="left"
    )
    for tag in ("th", "td"):
        table = table.replace(f"<{tag}>", f'<{tag} style="{CELL}">')
    return f"<p><b>{escape(title)}</b></p>{table}"


def _head(name: str, quantity: Quantity) -> str:
    words, unit = name.replace("_", " "), quantity.shown_unit
    return f"{words} [{unit}]" if unit else words
