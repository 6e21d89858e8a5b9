"""Records of validation: a case of other authors, its numbers with their verdicts, and the curves of its figure.

A case is its line in `data/cases.csv`, its rows in `data/rows.csv` and one function that computes our value of each. A
row states their value with its scatter, the distance expected before the run, and the value of ours when the case was
last examined. Verdicts:

met         the values differ by at most the expected distance
explained   they differ by more, and another number of the same case shows the cause
not met     they differ by more; the row states the reason, if one is known

`basis` states the part of a row that was fitted to the same source; "predicted" is nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.resources import files
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from compact.files import read_table
from compact.numerics import Array

REPEAT_TOLERANCE = 1e-6  # [-], relative, of our value against the recorded one; converged to 1e-9 and better
PREDICTED = "predicted"
Verdict = Literal["met", "explained", "not met"]


@dataclass(frozen=True)
class Comparison:
    """One number of ours and of theirs.

    Parameters
    ----------
    key : str
        Name within the case.
    quantity : str
        Quantity in words.
    unit : str
        Unit of both values; "-" for a dimensionless quantity.
    ours, theirs : float
        Values.
    expected : float
        Largest expected distance: relative to theirs, or with `absolute` in the unit.
    absolute : bool
        True for an expected distance in the unit.
    scatter : float, optional
        Scatter or error of their value in the unit.
    basis : str
        "predicted", or "fitted: " and the data of the fit.
    why : str
        Cause or presumed reason of a larger distance, or a remark.
    explained : bool
        True if another number of the case demonstrates the cause of a larger distance.
    recorded : float, optional
        Value of ours when the case was last examined; none for a case of the user.
    repeat : float
        Relative tolerance of our value against the recorded one [-].
    """

    key: str
    quantity: str
    unit: str
    ours: float
    theirs: float
    expected: float
    absolute: bool = False
    scatter: float | None = None
    basis: str = PREDICTED
    why: str = ""
    explained: bool = False
    recorded: float | None = None
    repeat: float = REPEAT_TOLERANCE

    @property
    def deviation(self) -> float:
        """Relative deviation of ours from theirs [-]; nan where theirs is 0."""
        return self.ours / self.theirs - 1 if self.theirs else np.nan

    @property
    def verdict(self) -> Verdict:
        """Verdict on the distance."""
        if abs(self.ours - self.theirs) <= self.expected * (1 if self.absolute else abs(self.theirs)):
            return "met"
        return "explained" if self.explained else "not met"

    @property
    def moved(self) -> bool:
        """True if our value differs from the recorded one."""
        if self.recorded is None:
            return False
        return not abs(self.ours - self.recorded) <= self.repeat * max(abs(self.recorded), abs(self.theirs))


@dataclass(frozen=True, eq=False)
class Curve:
    """Line of computed values, or points of other authors, in a figure; arrays of shape (n,)."""

    label: str
    x: ArrayLike
    y: ArrayLike
    is_ours: bool


@dataclass(frozen=True, eq=False)
class Panel:
    """Diagram of a figure; labels of the axes with units."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    log_x: bool = False


Rows = Mapping[str, Comparison]  # by key
Computed = tuple[Mapping[str, float], Sequence[Panel]]  # our value by key, and the figure


@dataclass(frozen=True)
class ValidationCase:
    """Case of other authors.

    Parameters
    ----------
    name, title : str
        Name on the command line, and title in words.
    kind : str
        What their numbers are.
    engines : tuple of str
        Engines or parts of the program that the case is held against.
    source : str
        Origin of the data and their licence.
    compute : callable
        Our value of each row, and the figure.
    rows : dict of str to Comparison
        Rows by key, with the recorded value as ours.
    seconds : float
        Usual processor time [s].
    """

    name: str
    title: str
    kind: str
    engines: tuple[str, ...]
    source: str
    compute: Callable[[Rows], Computed] = field(repr=False)
    rows: Rows = field(repr=False)
    seconds: float = 1.0


def recorded_case(name: str, compute: Callable[[Rows], Computed]) -> ValidationCase:
    """Return a case by its lines in `data/cases.csv` and `data/rows.csv`."""
    (about,) = read_rows("cases.csv", case=name)
    rows = {row["key"]: _comparison(row) for row in read_rows("rows.csv", case=name)}
    engines, seconds = tuple(about["engines"].split()), float(about["seconds"])
    return ValidationCase(name, about["title"], about["kind"], engines, about["source"], compute, rows, seconds)


def _comparison(row: Mapping[str, str]) -> Comparison:
    """Return a row of `data/rows.csv`; of the two columns of the expected distance one is filled."""
    absolute, recorded = bool(row["absolute"]), float(row["ours"])
    return Comparison(
        **{name: row[name] for name in ("key", "quantity", "unit", "basis", "why")},
        ours=recorded,
        theirs=float(row["theirs"]),
        expected=float(row["absolute"] or row["relative"]),
        absolute=absolute,
        scatter=float(row["scatter"]) if row["scatter"] else None,
        explained=row["verdict"] == "explained",
        recorded=recorded,
        repeat=float(row["repeat"]),
    )


def read_rows(name: str, **conditions: str) -> list[dict[str, str]]:
    """Read the rows of a file in `compact/validation/data` whose cells satisfy conditions, as text by column."""
    rows = read_table(files("compact.validation").joinpath("data", name))
    return [row for _, row in rows if all(row[column] == cell for column, cell in conditions.items())]


def numbers(rows: Sequence[Mapping[str, str]], column: str) -> Array:
    """Return a column of rows as numbers, shape (n,)."""
    return np.array([float(row[column]) for row in rows])


ours, theirs = partial(Curve, is_ours=True), partial(Curve, is_ours=False)
