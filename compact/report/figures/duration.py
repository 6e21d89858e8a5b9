"""Figure of the peaks over the duration of a pass: all laws in grey, the first ones in colour, with crossovers."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from compact.analysis.sizing.durations import DurationStudy
from compact.quantities import CRITERIA
from compact.report.figures.style import law_style, panels

PANEL = (5.2, 3.4)  # [inch]
OTHERS: dict[str, Any] = {"color": "0.82", "linewidth": 0.8}
FIRST_WIDTH = 2.2  # [pt]
TICKS = (1, 2, 3, 5)  # of every decade
DECADES = range(-6, 9)  # of times and peaks


def draw_durations(found: DurationStudy, own_duration: float) -> Figure:
    """Draw peak force and peak power over the duration.

    Parameters
    ----------
    found : DurationStudy
        Ranking over the duration.
    own_duration : float
        Duration of the scene [s], marked where it is within the range.
    """
    figure, axes = panels(1, len(found.orders), PANEL, bottom=0.6, gaps=(0.85, 0.3))
    for ax, by in zip(axes[0], found.orders, strict=True):
        _draw_peak(ax, found, by)
        if found.durations[0] <= own_duration <= found.durations[-1]:
            ax.axvline(own_duration, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
            ax.annotate("scene", (own_duration, 0.02), (-3, 0), xycoords=("data", "axes fraction"), color="0.4",
                        textcoords="offset points", ha="right", fontsize="small")  # fmt: skip
    return figure


def _draw_peak(ax: Axes, found: DurationStudy, by: str) -> None:
    """Draw one peak: the laws, the first ones where they are first, and the crossovers."""
    quantity = CRITERIA[by]
    factor, times = quantity.plot_factor, np.array(found.durations)
    for values in found.values(by).values():
        ax.plot(times, np.where(np.isfinite(values), values, np.nan) * factor, **OTHERS)
    ax.set(xscale="log", yscale="log", xlabel="duration of a pass T [s]", ylabel=quantity.axis_label)
    peaks = found.values(by)
    for law, low, high in found.segments(by):
        grid = np.unique(np.concatenate([[low, high], times[(times > low) & (times < high)]]))
        line = np.exp(np.interp(np.log(grid), np.log(times), np.log(peaks[law])))
        for cross in found.crossovers:
            if cross.by == by:
                line = np.where(np.isclose(grid, cross.duration), cross.value, line)
        ax.plot(grid, line * factor, **law_style(law) | {"linewidth": FIRST_WIDTH, "label": law})
    for cross in (each for each in found.crossovers if each.by == by):
        ax.plot(cross.duration, cross.value * factor, "o", color="black", markersize=4, zorder=3)
        ax.annotate(f"{cross.duration:.3g} s", (cross.duration, cross.value * factor), (4, 4),
                    textcoords="offset points", fontsize="small")  # fmt: skip
    _label_decades(ax.xaxis, times[0], times[-1])
    _label_decades(ax.yaxis, *ax.get_ylim())
    ax.set_xlim(times[0], times[-1])
    ax.grid(color="0.93")
    ax.legend(loc="upper right", fontsize="small", title="first law", title_fontsize="small")


def _label_decades(axis: Axis, low: float, high: float) -> None:
    """Label a logarithmic axis at 1, 2, 3 and 5 of every decade with plain numbers."""
    marks = [mark * 10.0**decade for decade in DECADES for mark in TICKS]
    axis.set_major_locator(FixedLocator([mark for mark in marks if low <= mark <= high]))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
