"""Numbers as text of the HTML page: significant digits, SI prefixes and typeset units; numbers with units for JSON.

A number has four significant digits by default; the files hold twelve. All numbers of a column have one prefix and one
number of decimals.
"""

import math
from collections.abc import Sequence
from typing import Any

from compact.quantities import unit_symbol

DIGITS = 4  # [-], significant digits on the page
ZERO_SHARE = 1e-9  # [-], below which a share is rounding and shown as zero
COLUMN_SPAN = 100  # [-], over which the smallest value of a column still shows all its digits
PREFIX_FACTORS = {"G": 1e9, "M": 1e6, "k": 1e3, "": 1.0, "m": 1e-3, "µ": 1e-6}
UNIT_PREFIXES = {  # units that have a prefix, and their prefixes, largest first
    "N": "Mk", "N/m": "Mk", "Pa": "GMk", "W": "Mk", "J": "Mk", "m": "mµ", "s": "mµ", "Nm": "k",
}  # fmt: skip
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def json_number(value: float | None, unit: str) -> dict[str, Any]:
    """Return a number with its unit for a JSON file.

    Parameters
    ----------
    value : float or None
        Number in the unit.
    unit : str
        SI unit, "1" for a dimensionless number.
    """
    return {"value": value, "unit": unit}


def format_number(value: float | str | bool | None, digits: int = DIGITS) -> str:
    """Format a number without an exponent between 0.001 and a million.

    Parameters
    ----------
    value : float or str or bool or None
        Number; text is returned unchanged, None and nan as a dash.
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    if math.isinf(value):
        return "infinite"
    if value and not 1e-3 <= abs(value) < 1e6:
        mantissa, power = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa} × 10{str(int(power)).translate(SUPERSCRIPTS)}"
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


def format_percent(share: float, digits: int = 2) -> str:
    """Format a share as per cent; a share within rounding of zero is zero.

    Parameters
    ----------
    share : float
        Share [-].
    """
    if not math.isfinite(share):
        return "–"
    return f"{format_number(100 * share if abs(share) > ZERO_SHARE else 0.0, digits)} %"


def _prefix(value: float, unit: str) -> str:
    """Return the prefix of a finite value: the largest below it, or the largest small one below 0.1."""
    size, prefixes = abs(value), UNIT_PREFIXES.get(unit, "")
    larger = [p for p in prefixes if PREFIX_FACTORS[p] > 1 and size >= PREFIX_FACTORS[p]]
    smaller = [p for p in prefixes if PREFIX_FACTORS[p] < 1 and 0 < size < 0.1 and size >= PREFIX_FACTORS[p]]
    return next(iter(larger or smaller), "")
