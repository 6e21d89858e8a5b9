"""Figures of a study, each drawn from finished results: laws and drives, contact and fields, rankings, durations.

A law, and an engine, has the same colour and dash in all figures. The colours are distinct with red-green colour
blindness: two laws differ by 16 or more in CIELAB (1976 distance) for normal vision, deuteranopes and protanopes
(Machado, Oliveira and Fernandes 2009), laws of one family also in lightness. Curves differ by dash as well, so that the
figures can be read in grey.
"""

import math
from collections.abc import Mapping
from itertools import islice
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from compact.analysis.sizing import durations, machine_sizing
from compact.analysis.stages.drives import Place
from compact.machine.component_sizing import SizingRule
from compact.machine.ranking import CRITERIA
from compact.quantities import MOTION, TIME, Quantity
from compact.report.tables import format_column

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
ENGINE_STYLES: Mapping[str, tuple[str, str, Any]] = {  # colour, mark and dash
    "formula": ("0.35", "x", ":"),
    "column": (PALETTE[2], "o", "--"),
    "spectral": (PALETTE[0], "s", "-."),
    "fem": (PALETTE[1], "D", (0, (5, 1.5, 1, 1.5, 1, 1.5))),
    "compaction": ("0.05", "^", "-"),
    "process": (PALETTE[3], "v", (0, (7, 2))),
}
OTHER_STYLE: tuple[str, str, Any] = (PALETTE[3], "v", (0, (4, 1.5)))  # of engines of other packages
TICKS = (1.0, 2.0, 3.0, 5.0)  # [-], labels of a decade of a logarithmic axis
MARGINS = {"left": 0.8, "bottom": 0.55, "right": 0.2, "top": 0.15}  # [inch], of a figure
ZERO: dict[str, Any] = {"color": "0.8", "linewidth": 0.8, "zorder": 0}
LABELLED = 0.45  # [-], of a panel on each side of its middle, with labels of contour lines
RANKING_PANELS = 2  # [-], number of criteria of the rankings, the first of the scene
LETTER_WIDTH = 0.061  # [inch], of a letter of 8 points
ROW_HEIGHT, PANEL_WIDTH = 0.24, 2.8  # [inch]; a panel and its labels fit a narrow screen
CYCLE_SIZE = (2.9, 1.35)  # [inch]; two such figures lie side by side on a screen, one fills a phone
PHONE_DPI, PHONE_TEXT = 220, 8.8  # [1/inch, points], of these figures; 8.8 points are 11 px on a screen of 400 px
PHONE_MARGINS: dict[str, Any] = {"left": 0.6, "right": 0.1, "top": 0.62, "bottom": 0.45}  # [inch]
PHONE_LEGEND: dict[str, Any] = {
    "frameon": False, "fontsize": PHONE_TEXT, "loc": "upper left", "handlelength": 3.2, "labelspacing": 0.2,
    "borderpad": 0.1,
}  # fmt: skip
BEST_STYLES: tuple[tuple[Any, float], ...] = (("-", 2.4), ((0, (6, 2)), 1.9), ((0, (1, 1.4)), 2.2))  # dash, points
LEVELS: tuple[tuple[str, Any, int], ...] = (  # of the torque of a shaft, then of its motor: colour, dash and order
    (PALETTE[0], "--", 3), ("0.45", ":", 3), (PALETTE[1], "-.", 2), (PALETTE[1], (0, (8, 2)), 2),
)  # fmt: skip


def law_style(name: str) -> dict[str, Any]:
    """Return colour and dash of a law; laws outside FAMILIES, such as tables, are black."""
    for members in FAMILIES.values():
        if name in members:
            return {"color": members[name], "linestyle": DASHES[list(members).index(name)]}
    return {"color": "black", "linestyle": "-"}


def panels(
    rows: int, columns: int, size: tuple[float, float], gaps: tuple[float, float] = (0.8, 0.3), shared: str = "",
    **margins: float,
) -> tuple[Figure, NDArray[Any]]:  # fmt: skip
    """Make a figure with a grid of panels.

    Parameters
    ----------
    size : tuple of float
        Width and height of a panel [inch].
    gaps : tuple of float
        Gaps between columns and between rows [inch].
    shared : {"", "x", "xy"}
        Axes that all panels share.
    **margins : float
        Margins [inch] in place of those of MARGINS.

    Returns
    -------
    tuple
        Figure and panels, array of shape (rows, columns).

    Notes
    -----
    A constrained layout would compute the margins, in as much time as the rest of the figure.
    """
    across, along = (count * (each + gap) - gap for count, each, gap in zip((columns, rows), size, gaps, strict=True))
    left, bottom, right, top = (MARGINS | margins).values()
    width, height = across + left + right, along + bottom + top
    figure = Figure(figsize=(width, height))
    ends = left / width, bottom / height, 1 - right / width, 1 - top / height
    figure.subplots_adjust(*ends, gaps[0] / size[0], gaps[1] / size[1])
    return figure, figure.subplots(rows, columns, squeeze=False, sharex="x" in shared, sharey="y" in shared)


def curve(ax: Axes, x: Quantity, y: Quantity, across: Any, along: Any, *mark: str, **style: Any) -> None:
    """Draw values in SI units in the units of plots of their quantities, and label both axes.

    Parameters
    ----------
    x, y : Quantity
        Quantities of the axes.
    across, along : array_like
        Values in SI units.
    """
    ax.plot(np.multiply(across, x.plot_factor), np.multiply(along, y.plot_factor), *mark, **style)
    ax.set(xlabel=x.axis_label, ylabel=y.axis_label)


def label_decades(axis: Axis) -> None:
    """Label a logarithmic axis at TICKS of every decade with plain numbers."""
    axis.set_major_locator(LogLocator(subs=TICKS))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def label_contours(ax: Axes, lines: QuadContourSet) -> None:
    """Label contour lines in a panel with its final limits; labels at its frame, which would be cut, are left out."""
    for text in ax.clabel(lines, fontsize=8, fmt="{:.4g}".format, inline=False, colors="black"):
        place = ax.transAxes.inverted().transform(ax.transData.transform(text.get_position()))
        text.set_visible(np.abs(place - 0.5).max() < LABELLED)
        text.set_path_effects([withStroke(linewidth=2, foreground="white")])


# drives


def draw_best_cycles(runs: Mapping[str, Any]) -> Figure:
    """Draw drive force, positive along the motion, and power of the best laws over a cycle.

    Parameters
    ----------
    runs : mapping
        Run of each law, as many as BEST_STYLES at most.
    """
    figure, axes = panels(2, 1, CYCLE_SIZE, (0.0, 0.2), "x", **PHONE_MARGINS)
    force, power = axes[:, 0]
    for (name, run), (dash, width) in zip(runs.items(), BEST_STYLES, strict=False):
        style = {"color": law_style(name)["color"], "linestyle": dash, "linewidth": width, "label": name}
        force.plot(run.time, run.direction * run.drive_force / 1e3, **style)
        power.plot(run.time, run.drive_power / 1e3, **style)
    for ax, label in ((force, "force [kN]"), (power, "power [kW]")):
        ax.axhline(0, **ZERO)
        ax.margins(x=0)
        for_phone(ax, "" if ax is force else TIME.axis_label, label)
    figure.legend(*force.get_legend_handles_labels(), **PHONE_LEGEND)
    return figure


def for_phone(ax: Axes, x_label: str, y_label: str) -> None:
    """Label a panel of a figure that is read on a phone."""
    ax.figure.set_dpi(PHONE_DPI)
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_xlabel(x_label, fontsize=PHONE_TEXT)
    ax.set_ylabel(y_label, fontsize=PHONE_TEXT)
    ax.tick_params(labelsize=PHONE_TEXT)


def draw_stroke(
    position: NDArray[np.float64], along: NDArray[np.float64], steady: NDArray[np.float64], law: str
) -> Figure:
    """Draw the resistance of one cart over a cycle of position, with its value far from the turns dashed: a step.

    Parameters
    ----------
    position, along, steady : ndarray, shape (n,)
        Position [m], resistance and its value far from the turns [N], of the forward and then the return stroke.
    law : str
        Motion law of the cycle.
    """
    figure, ((ax,),) = panels(1, 1, (7.0, 2.9), top=0.3)
    force, place = MOTION["cart_resistance"], MOTION["position"]
    curve(ax, place, force, position, steady, "--", color=PALETTE[1], label="step at the turn")
    curve(ax, place, force, position, along, color=PALETTE[0], linewidth=2, label="along the stroke")
    ax.axhline(0, **ZERO)
    ax.set_title(f"Resistance over one cycle of position, {law}", fontsize=10, loc="left", fontweight="bold")
    ax.legend(frameon=False, fontsize=8)
    return figure


def draw_shaft_torque(sizing: machine_sizing.LawSizing, rule: SizingRule) -> Figure:
    """Draw the torque of all carts over the angle of the shaft.

    Parameters
    ----------
    sizing : LawSizing
        Requirement of a law, with the motor of the catalogue if there is one.
    rule : SizingRule
        Rule by which the motor holds; its torques are shown at the shaft, divided by the margin.
    """
    found = sizing.requirement
    assert found is not None  # a law with finite torque
    figure, ((ax,),) = panels(1, 1, (7.2, 3.0), right=1.6, bottom=0.6)
    ax.plot(np.degrees(found.angle), found.torque, color="black", linewidth=1.6, label=sizing.law)
    levels = [(found.rms_torque, "rms torque"), (found.mean_torque, "mean torque")]
    chosen = None if sizing.choice is None else sizing.choice.chosen
    if chosen is not None:
        at_shaft = chosen.gear_ratio * rule.efficiency / rule.margin
        levels += [(chosen.motor.rated_torque * at_shaft, f"rated, {chosen.motor.name}")]
        levels += [(chosen.motor.peak_torque * at_shaft, f"peak, {chosen.motor.name}")]
    for (value, label), (colour, line, order) in zip(levels, LEVELS, strict=False):
        ax.axhline(value, color=colour, linestyle=line, linewidth=1.4, label=label, zorder=order)
    ax.axhline(0.0, color="0.7", linewidth=0.8)
    ax.set(xlabel="angle of the shaft [°]", ylabel="torque of the shaft [N m]", xlim=(0, 360))
    ax.set_xticks(range(0, 361, 90))
    ax.grid(color="0.93")
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize="small")
    return figure


def draw_durations(found: durations.DurationStudy, own_duration: float) -> Figure:
    """Draw peak force and peak power over the duration: the laws, the first ones where they are first, the crossovers.

    Parameters
    ----------
    found : DurationStudy
        Ranking over the duration.
    own_duration : float
        Duration of the scene, a dotted line [s].
    """
    figure, (axes,) = panels(1, len(found.orders), (5.2, 3.4), (0.85, 0.3), bottom=0.6)
    times = np.array(found.durations)
    for ax, by in zip(axes, found.orders, strict=True):
        quantity, peaks = CRITERIA[by].quantity, found.values(by)
        ax.set(xlabel="duration of a pass T [s]", ylabel=quantity.axis_label, xlim=(times[0], times[-1]))
        ax.axvline(own_duration, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
        if not np.isfinite(list(peaks.values())).any():
            ax.text(0.5, 0.5, f"no law has a finite {quantity.term}", transform=ax.transAxes, ha="center", fontsize=9)
            continue
        ax.set(xscale="log", yscale="log")
        for values in peaks.values():
            finite = np.where(np.isfinite(values), values, np.nan)
            ax.plot(times, finite * quantity.plot_factor, color="0.82", linewidth=0.8)
        for law, low, high in found.segments(by):
            grid = np.unique([low, high, *times[(times > low) & (times < high)]])
            line = np.exp(np.interp(np.log(grid), np.log(times), np.log(peaks[law])))
            ax.plot(grid, line * quantity.plot_factor, **law_style(law) | {"linewidth": 2.2, "label": law})
        for each in (each for each in found.crossovers if each.by == by):
            place = each.duration, each.value * quantity.plot_factor
            ax.plot(*place, "o", color="black", markersize=4, zorder=3)
            ax.annotate(f"{each.duration:.3g} s", place, (4, 4), textcoords="offset points", fontsize="small")
        label_decades(ax.xaxis)
        label_decades(ax.yaxis)
        ax.set_xlim(times[0], times[-1])
        ax.legend(loc="upper right", fontsize="small", title="first law", title_fontsize="small")
    return figure


# rankings


def draw_rankings(orders: Mapping[str, list[Place]]) -> Figure:
    """Draw bars of the ranked laws with their errors, first law on top, a panel for each of the first criteria.

    Returns
    -------
    Figure
        Infinite values are named in place of a bar.
    """
    orders = dict(islice(orders.items(), RANKING_PANELS))
    labels: dict[str, list[str]] = {}
    for by, order in orders.items():
        finite = [math.nan if each.reason else each.value for each in order]
        values = format_column(finite, CRITERIA[by].unit, 3)
        labels[by] = [f"{each.rank}  {each.law}  {value}" for each, value in zip(order, values, strict=True)]
    size = PANEL_WIDTH, ROW_HEIGHT * max(map(len, orders.values())) + 0.2
    margin = 0.3 + LETTER_WIDTH * max(len(label) for each in labels.values() for label in each)
    figure, axes = panels(len(orders), 1, size, (0.0, 0.6), left=margin)
    whisker = {"capsize": 2.5, "elinewidth": 1.2}
    for ax, (by, order) in zip(axes[:, 0], orders.items(), strict=True):
        quantity, longest = CRITERIA[by].quantity, 0.0
        for row, place in enumerate(order):
            if place.reason:
                ax.text(0, row, f" infinite: {place.reason.split(':')[0]}", va="center", fontsize=8, color="0.35")
                continue
            error = place.error if place.error and np.isfinite(place.error) else 0.0
            value, error = place.value * quantity.plot_factor, error * quantity.plot_factor
            style = {"color": law_style(place.law)["color"], "edgecolor": "black", "linewidth": 0.4}
            ax.barh(row, value, 0.72, xerr=error or None, error_kw=whisker, **style)
            longest = max(longest, value + error)
        ax.set(xlim=(0, 1.15 * longest or 1.0), ylim=(len(order) - 0.4, -0.6), xlabel=quantity.axis_label)
        ax.spines[["top", "right"]].set_visible(False)
        ax.set_yticks(range(len(order)), labels[by], fontsize=8)
    return figure
