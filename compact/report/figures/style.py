"""Style of all figures: colours and dashes of the laws, and grids of panels with fixed margins.

The colours are distinct with red-green colour blindness. Two laws differ by 16 or more in CIELAB (1976 distance) for
normal vision, deuteranopes and protanopes (Machado, Oliveira and Fernandes 2009); laws of one family also in lightness.
"""

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from compact.quantities import CRITERIA

FAMILIES: Mapping[str, Mapping[str, str]] = {  # family -> law -> colour, dark to light
    "rest to rest": {
        "constant-velocity": "#03255d", "cubic": "#00449f", "quintic": "#577388", "septic": "#509afa",
        "complex": "#9dc8fe",
    },
    "constant speed, combined": {"combined-2": "#1e4740", "combined-3": "#5b735f", "combined-4": "#5adda2"},
    "constant speed, reversal": {
        "reversal-2": "#702e01", "reversal-3": "#bf4809", "reversal-4": "#f7740f", "reversal-4-free-jerk": "#f5bc63",
    },
    "constant speed, free turn": {
        "reversal-3-free-acceleration": "#4d180e", "reversal-4-free-acceleration": "#c16243",
        "reversal-4-free-both": "#fe8b7b",
    },
    "comparators": {
        "parabolic": "#281b37", "harmonic": "#8862b1", "cycloidal": "#bf8ac2", "modified-trapezoid": "#e7b9d5",
    },
    "machines and tables": {"crank": "#000000", "gear-sector": "#989898"},
}  # fmt: skip
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # other curves; Okabe and Ito
DASHES = ("-", "--", ":", "-.", (0, (8, 2, 1, 2, 1, 2)))
TICKS, DECADES = (1, 2, 3, 5), range(-6, 9)  # labels of a logarithmic axis
TITLE_HEIGHT = 1.0  # [-], of a title above its panel; a fixed height saves measuring every label


def law_style(name: str) -> dict[str, Any]:
    """Return colour and dash of a law; laws outside FAMILIES, such as tables, are black."""
    for members in FAMILIES.values():
        if name in members:
            return {"color": members[name], "linestyle": DASHES[list(members).index(name)]}
    return {"color": "black", "linestyle": "-"}


def panels(
    rows: int,
    columns: int,
    size: tuple[float, float],
    *,
    left: float = 0.8,
    right: float = 0.2,
    bottom: float = 0.55,
    top: float = 0.15,
    gaps: tuple[float, float] = (0.8, 0.3),
    **shared: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Make a figure with a grid of panels.

    Parameters
    ----------
    size : tuple of float
        Width and height of a panel [inch].
    left, right, bottom, top : float
        Margins [inch].
    gaps : tuple of float
        Gaps between columns and between rows [inch].

    Returns
    -------
    tuple
        Figure and panels, array of shape (rows, columns).

    Notes
    -----
    A constrained layout would compute the margins, in as much time as the rest of the figure.
    """
    across, along = (count * (each + gap) - gap for count, each, gap in zip((columns, rows), size, gaps, strict=True))
    width, height = across + left + right, along + bottom + top
    figure = Figure(figsize=(width, height))
    axes = figure.subplots(rows, columns, squeeze=False, **shared)
    margins = {"left": left / width, "right": 1 - right / width, "bottom": bottom / height, "top": 1 - top / height}
    figure.subplots_adjust(**margins, wspace=gaps[0] / size[0], hspace=gaps[1] / size[1])
    return figure, axes


def legend_below(figure: Figure, ax: Axes, columns: int) -> None:
    """Place the legend of one panel below all panels."""
    figure.legend(*ax.get_legend_handles_labels(), loc="lower center", ncols=columns, frameon=False)


def write_none_finite(ax: Axes, by: str) -> None:
    """State in an empty panel that no law has a finite value of a criterion."""
    words = f"no law has a finite {CRITERIA[by].term}"
    ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", va="center", fontsize=9)


def label_decades(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic axis at 1, 2, 3 and 5 of every decade with plain numbers.

    Parameters
    ----------
    axis : Axis
        Logarithmic axis.
    low, high : float
        Range of the labels.
    """
    marks = [mark * 10.0**decade for decade in DECADES for mark in TICKS]
    axis.set_major_locator(FixedLocator([mark for mark in marks if low <= mark <= high]))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
