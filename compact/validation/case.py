"""Records of validation: a case of other authors, its comparisons with their verdicts, and the curves of its figure.

A comparison holds our value, theirs, the scatter of theirs and the distance expected before the run. Verdicts:

met         the values differ by at most the expected distance
explained   they differ by more, and another number of the same case shows the cause
not met     they differ by more; the note states the reason, if one is known

`basis` states the part of the comparison that was fitted to the same source; "predicted" is nothing.
"""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array
from compact.numerics.validation import require_known

REPEAT_TOLERANCE = 1e-6  # [-], relative, of our value against the recorded one; converged to 1e-9 and better
Kind = Literal["measurement", "calibration", "program", "model", "exact"]
Verdict = Literal["met", "explained", "not met"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
KINDS: Mapping[str, str] = MappingProxyType(
    {
        "measurement": "measured",
        "calibration": "calibrated to measurements by others",
        "program": "printed by another program",
        "model": "published model, evaluated independently",
        "exact": "exact solution",
    }
)
VALIDATING = ("measurement", "calibration")  # kinds that say something about the world; the others verify
PREDICTED = "predicted"


@dataclass(frozen=True)
class Comparison:
    """One number of ours and of theirs.

    Parameters
    ----------
    key : str
        Name within the case, as in `data/recorded.csv`.
    quantity : str
        Quantity in words.
    unit : str
        Unit of both values; "-" for a dimensionless quantity.
    ours, theirs : float
        Values.
    expected : float
        Largest expected distance: relative to theirs, or with `absolute` in the unit.
    scatter : float, optional
        Scatter or error of their value in the unit.
    absolute : bool
        True for an expected distance in the unit.
    basis : str
        "predicted", or "fitted: " and the data of the fit.
    explanation : str
        Cause of a larger distance that a number of the case demonstrates.
    note : str
        Remark, or the presumed reason of a larger distance.
    repeat : float
        Relative tolerance of our value against the recorded one [-].
    bracket : (float, float), optional
        Range of our values by equally valid inputs.
    """

    key: str
    quantity: str
    unit: str
    ours: float
    theirs: float
    expected: float
    scatter: float | None = None
    absolute: bool = False
    basis: str = PREDICTED
    explanation: str = ""
    note: str = ""
    repeat: float = REPEAT_TOLERANCE
    bracket: tuple[float, float] | None = None

    @property
    def deviation(self) -> float:
        """Relative deviation of ours from theirs [-]; nan where theirs is 0."""
        return self.ours / self.theirs - 1 if self.theirs else np.nan

    @property
    def allowed(self) -> float:
        """Largest distance of a met comparison, in the unit."""
        return self.expected if self.absolute else self.expected * abs(self.theirs)

    @property
    def verdict(self) -> Verdict:
        """Verdict on the distance."""
        if abs(self.ours - self.theirs) <= self.allowed:
            return "met"
        return "explained" if self.explanation else "not met"

    def moved(self, recorded: float | None) -> bool:
        """Return True if our value differs from the recorded one, or none is recorded."""
        if recorded is None:
            return True
        return not abs(self.ours - recorded) <= self.repeat * max(abs(recorded), abs(self.theirs))


@dataclass(frozen=True, eq=False)
class Curve:
    """Curve or points of a figure.

    Parameters
    ----------
    label : str
        Entry of the legend; empty for none.
    x, y : ndarray, shape (n,)
        Coordinates.
    style : {"ours", "theirs", "band"}
        Line of ours, points of theirs, or the area between `y` and `y_low`.
    y_low : ndarray, optional
        Lower edge of a band.
    """

    label: str
    x: Array
    y: Array
    style: Literal["ours", "theirs", "band"] = "ours"
    y_low: Array | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Panel of a figure.

    Parameters
    ----------
    x_label, y_label : str
        Labels of the axes, with units.
    curves : tuple of Curve
        Curves and points.
    log_x, log_y : bool
        True for a logarithmic axis.
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Comparisons and figure of a case.

    Parameters
    ----------
    comparisons : tuple of Comparison
        All numbers of the case.
    panels : tuple of Panel
        Panels of the figure, from left to right.
    remarks : tuple of str
        Sentences below the table.
    """

    comparisons: tuple[Comparison, ...]
    panels: tuple[Panel, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class ValidationCase:
    """Case of other authors.

    Parameters
    ----------
    name : str
        Name on the command line.
    title : str
        Title in words.
    kind : str
        One of `KINDS`.
    engines : tuple of str
        Engines or parts of the program that the case is held against.
    source, licence : str
        Origin of the data and their licence.
    setting : str
        The problem, the inputs and the way to the numbers of ours, in some sentences.
    evaluate : callable
        Computation of the comparisons.
    seconds : float
        Usual processor time [s].
    """

    name: str
    title: str
    kind: Kind
    engines: tuple[str, ...]
    source: str
    licence: str
    setting: str
    evaluate: Callable[[], Evaluation] = field(repr=False)
    seconds: float = 1.0

    def __post_init__(self) -> None:
        require_known("kind", self.kind, tuple(KINDS))

    @property
    def validates(self) -> bool:
        """True if the case was measured, False if it verifies the solution of equations."""
        return self.kind in VALIDATING


def read_rows(name: str, **conditions: str) -> list[dict[str, str]]:
    """Read the rows of a file in `compact/validation/data` that satisfy conditions.

    Parameters
    ----------
    name : str
        Name of the file.
    **conditions
        Column and text of the cell.

    Returns
    -------
    list of dict
        Cells of each row as text, by column.
    """
    text = files("compact.validation").joinpath("data", name).read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return [row for row in rows if all(row[column] == cell for column, cell in conditions.items())]


def numbers(rows: Sequence[Mapping[str, str]], column: str) -> Array:
    """Return a column of rows as numbers, shape (n,)."""
    return np.array([float(row[column]) for row in rows])


def ours(label: str, x: ArrayLike, y: ArrayLike) -> Curve:
    """Return a line of computed values."""
    return Curve(label, np.asarray(x, dtype=float), np.asarray(y, dtype=float))


def theirs(label: str, x: ArrayLike, y: ArrayLike) -> Curve:
    """Return points of values of other authors."""
    return Curve(label, np.asarray(x, dtype=float), np.asarray(y, dtype=float), "theirs")
