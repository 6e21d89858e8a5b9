"""Cases of validation: numbers of other authors with ours and their verdicts, the curves of a figure, the evaluation.

A case is its line in `data/cases.csv`, its rows in `data/rows.csv` and one function that computes our value of each. A
row states their value with its scatter, the distance expected before the run, and the value of ours when the case was
last examined. A value that moves from the recorded one is reported, met or not. Verdicts:

met         the values differ by at most the expected distance
explained   they differ by more, and another number of the same case shows the cause
not met     they differ by more; the row states the reason, if one is known

`basis` states the part of a row that was fitted to the same source; "predicted" is nothing.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.resources import files
from pkgutil import resolve_name
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from compact.files import read_table
from compact.numerics import Array

REPEAT_TOLERANCE = 1e-6  # [-], relative, of our value against the recorded one; converged to 1e-9 and better
PREDICTED = "predicted"
Verdict = Literal["met", "explained", "not met"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


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
    relative, absolute : float
        Largest expected distance, as a share of theirs or in the unit; one of the two.
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
    relative: float | None = None
    absolute: float | None = None
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
        expected = self.absolute if self.relative is None else self.relative * abs(self.theirs)
        if abs(self.ours - self.theirs) <= (expected or 0.0):
            return "met"
        return "explained" if self.explained else "not met"

    @property
    def moved(self) -> bool:
        """True if our value differs from the recorded one."""
        if self.recorded is None:
            return False
        return not abs(self.ours - self.recorded) <= self.repeat * max(abs(self.recorded), abs(self.theirs))


class Curve(NamedTuple):
    """Line of computed values, or points of other authors, in a figure; arrays of shape (n,)."""

    label: str
    x: ArrayLike
    y: ArrayLike
    is_ours: bool


class Panel(NamedTuple):
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
        Rows by key, with the recorded value as ours until the case is evaluated.
    panels : tuple of Panel
        Figure of the evaluated case.
    """

    name: str
    title: str
    kind: str
    engines: tuple[str, ...]
    source: str
    compute: Callable[[Rows], Computed] = field(repr=False)
    rows: Rows = field(repr=False)
    panels: tuple[Panel, ...] = field(default=(), repr=False)

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows by verdict."""
        found = Counter(each.verdict for each in self.rows.values())
        return {verdict: found[verdict] for verdict in VERDICTS}

    def evaluated(self) -> "ValidationCase":
        """Return the case with the computed rows, on one thread, on which the recorded values were computed.

        Raises
        ------
        KeyError
            If a value has no row, or a row no value.
        """
        with threadpool_limits(1):
            values, panels = self.compute(self.rows)
        if set(values) != set(self.rows):
            raise KeyError(f"{self.name}: rows and values differ in {', '.join(set(values) ^ set(self.rows))}")
        rows = {key: replace(row, ours=float(values[key])) for key, row in self.rows.items()}
        return replace(self, rows=rows, panels=tuple(panels))


def read_rows(name: str, **conditions: str) -> list[dict[str, str]]:
    """Read the rows of a file in `compact/validation/data` whose cells satisfy conditions, as text by column."""
    rows = read_table(files("compact.validation").joinpath("data", name))
    return [row for _, row in rows if all(row[column] == cell for column, cell in conditions.items())]


def numbers(rows: Sequence[Mapping[str, str]], column: str) -> Array:
    """Return a column of rows as numbers, shape (n,)."""
    return np.array([float(row[column]) for row in rows])


ours, theirs = partial(Curve, is_ours=True), partial(Curve, is_ours=False)


def _comparison(row: Mapping[str, str]) -> Comparison:
    """Return a row of `data/rows.csv`."""
    texts: dict[str, Any] = {name: row[name] for name in ("key", "quantity", "unit", "basis", "why")}
    values = {name: float(row[name]) for name in ("theirs", "relative", "absolute", "scatter", "repeat") if row[name]}
    recorded = float(row["ours"])
    return Comparison(ours=recorded, recorded=recorded, explained=row["verdict"] == "explained", **texts | values)


def _recorded_case(about: Mapping[str, str]) -> ValidationCase:
    """Return the case of a row of `data/cases.csv`."""
    name, rows = about["case"], read_rows("rows.csv", case=about["case"])
    return ValidationCase(
        name, about["title"], about["kind"], tuple(about["engines"].split()), about["source"],
        lambda rows: resolve_name(f"compact.validation.{about['function']}")(rows),
        {row["key"]: _comparison(row) for row in rows},
    )  # fmt: skip


CASES: Mapping[str, ValidationCase] = {about["case"]: _recorded_case(about) for about in read_rows("cases.csv")}
