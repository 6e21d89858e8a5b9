"""Figures of the rankings: bars with the values by other engines, excess over the first law, and resistances by engine.

Each function draws one figure from finished results and returns it; an engine has the same colour and mark in all.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from compact.analysis.ranking_uncertainty import Place
from compact.machine.ranking import CRITERIA, group_equal
from compact.quantities import MOTION, SPEED
from compact.report.figures.style import PALETTE, law_style, panels, write_none_finite

DRIVE_PANELS = 2  # [-], number of criteria of the comparison of engines, for each drive
RANKING_PANELS = 4  # [-], number of criteria of the rankings, the first of the scene
LETTER_WIDTH = 0.061  # [inch], of a letter of 8 points
ROW_HEIGHT, PANEL_WIDTH = 0.24, 2.8  # [inch]; a panel and its labels fit a narrow screen
MARK_SPREAD = 0.6  # [-], of a row, over which the marks of engines are spread so that none hides another
ENGINE_STYLES: Mapping[str, tuple[str, str, Any]] = {  # colour, mark and dash
    "formula": ("0.35", "x", ":"),
    "column": (PALETTE[2], "o", "--"),
    "spectral": (PALETTE[0], "s", "-."),
    "fem": (PALETTE[1], "D", (0, (5, 1.5, 1, 1.5, 1, 1.5))),
    "compaction": ("0.05", "^", "-"),
    "process": (PALETTE[3], "v", (0, (7, 2))),
}
OTHER_STYLE: tuple[str, str, Any] = (PALETTE[3], "v", (0, (4, 1.5)))  # of engines of other packages


def engine_style(engine: str) -> tuple[str, str, Any]:
    """Return colour, mark and dash of an engine; those of other packages share one."""
    return ENGINE_STYLES.get(engine, OTHER_STYLE)


def draw_rankings(
    orders: Mapping[str, list[Place]], comparisons: Mapping[str, Mapping[str, Mapping[str, Place]]]
) -> Figure:
    """Draw bars of the ranked laws, first law on top, a panel for each of the first criteria.

    Parameters
    ----------
    comparisons : mapping
        Places by criterion, engine and law, drawn as marks.

    Returns
    -------
    Figure
        Infinite values are named in place of a bar.
    """
    orders = dict(list(orders.items())[:RANKING_PANELS])
    labels = {by: [_row_label(by, place) for place in order] for by, order in orders.items()}
    figure, axes = _stacked_panels(len(orders), max(map(len, orders.values())), itertools.chain(*labels.values()))
    for ax, (by, order) in zip(axes, orders.items(), strict=True):
        _draw_bars(ax, by, order, labels[by])
        _draw_marks(ax, by, order, comparisons.get(by, {}))
    _common_legend(figure, axes)
    return figure


def draw_engines(orders: Mapping[str, Mapping[str, Mapping[str, list[Place]]]], most: int = 12) -> Figure:
    """Draw the excess of the laws over the first one, a mark with its error for each engine.

    Parameters
    ----------
    orders : mapping
        Rankings by engine, drive and criterion, the engine of the scene first.
    most : int
        Largest number of laws in a panel: those that are first by any engine, in the order of the first engine.

    Returns
    -------
    Figure
        A panel for each drive and criterion.
    """
    reference = next(iter(orders))
    shown = [(kind, by) for kind, found in orders[reference].items() for by in list(found)[:DRIVE_PANELS]]
    names = (place.law for kind, by in shown for place in orders[reference][kind][by])
    rows = min(most, max(len(orders[reference][kind][by]) for kind, by in shown))
    figure, axes = _stacked_panels(len(shown), rows, names)
    for ax, (kind, by) in zip(axes, shown, strict=True):
        _draw_excess(ax, {engine: _excess(found[kind][by], by) for engine, found in orders.items()}, by, most)
        ax.set_xlabel(f"excess {CRITERIA[by].quantity.term} [%], {kind} drive", fontsize=9)
    _common_legend(figure, axes)
    return figure


def draw_resistances(maps: Mapping[str, Any]) -> Figure:
    """Draw the resistance of one cart over speed by each engine.

    Parameters
    ----------
    maps : mapping of str to callable
        Resistance [N] of velocity [m/s] and acceleration [m/s2] by engine; the first is a `ResistanceMap`, whose
        computed values are drawn as well.
    """
    figure, ((ax,),) = panels(1, 1, (6.2, 3.1))
    reference, first = next(iter(maps.items()))
    widths = np.linspace(4.0, 1.5, len(maps))  # the lower line is broader, so that none hides another
    for (engine, force), width in zip(reversed(list(maps.items())), widths, strict=True):
        (color, _, dash), fastest = engine_style(engine), getattr(force, "speeds", first.speeds)[-1]
        speed = np.linspace(0, min(fastest, first.speeds[-1]), 801)[1:]
        ax.plot(speed, force(speed, 0.0) / 1e3, linestyle=dash, color=color, linewidth=width, label=engine)
    color, label = engine_style(reference)[0], f"{reference}, computed"
    ax.plot(first.speeds, first.forces / 1e3, "o", color=color, markersize=4, label=label)
    ax.set(xlabel=SPEED.axis_label, ylabel=MOTION["cart_resistance"].axis_label)
    ax.set(xlim=(0, 1.02 * first.speeds[-1]), ylim=(min(0.0, 1.1 * first.forces.min() / 1e3), None))
    ax.legend(frameon=False, reverse=True, handlelength=3.2)
    return figure


def _stacked_panels(count: int, rows: int, labels: Iterable[str]) -> tuple[Figure, NDArray[Any]]:
    """Make a column of panels with a margin for the labels of their rows."""
    margin = 0.3 + LETTER_WIDTH * max(map(len, labels))
    size = (PANEL_WIDTH, ROW_HEIGHT * rows + 0.2)
    figure, axes = panels(count, 1, size, left=margin, top=0.5, gaps=(0.0, 0.6))
    return figure, axes[:, 0]


def _common_legend(figure: Figure, axes: Iterable[Axes]) -> None:
    """Place one legend with the labels of all panels above them."""
    found = {label: mark for ax in axes for mark, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(list(found.values()), list(found), loc="upper center", ncols=len(found), frameon=False, fontsize=8)


def _draw_bars(ax: Axes, by: str, order: list[Place], labels: Sequence[str]) -> None:
    """Draw a bar with its error and its label for each place."""
    quantity = CRITERIA[by].quantity
    factor = quantity.plot_factor
    for row, place in enumerate(order):
        if place.reason:
            ax.text(0, row, f" infinite: {place.reason.split(':')[0]}", va="center", fontsize=8, color="0.35")
    rows = [row for row, place in enumerate(order) if not place.reason]
    finite = np.array([order[row].value * factor for row in rows])
    errors = np.nan_to_num([(order[row].error or 0.0) * factor for row in rows], posinf=0.0)
    colors = [law_style(order[row].law)["color"] for row in rows]
    ax.barh(rows, finite, color=colors, height=0.72, edgecolor="black", linewidth=0.4)
    known = np.flatnonzero(errors)
    if known.size:
        whisker: dict[str, Any] = {"fmt": "none", "ecolor": "black", "capsize": 2.5, "elinewidth": 1.2}
        ax.errorbar(finite[known], np.array(rows)[known], xerr=errors[known], label="error", **whisker)
    ax.set_yticks(range(len(order)), labels, fontsize=8)
    ax.set_xlim(0, 1.15 * max(finite + errors, default=1.0) or 1.0)
    ax.set_ylim(len(order) - 0.4, -0.6)
    ax.set_xlabel(quantity.axis_label)
    ax.spines[["top", "right"]].set_visible(False)


def _row_label(by: str, place: Place) -> str:
    value = "" if place.reason else f"{place.value * CRITERIA[by].quantity.plot_factor:#.4g}".rstrip(".")
    return f"{place.rank}  {place.law}  {value}"


def mark_offsets(count: int) -> NDArray[np.float64]:
    """Return the vertical offsets of the marks of engines in a row.

    Returns
    -------
    ndarray
        Offsets over the height of a row [-], shape (count,).
    """
    return np.linspace(-MARK_SPREAD / 2, MARK_SPREAD / 2, count) if count > 1 else np.zeros(count)


def _draw_marks(ax: Axes, by: str, order: list[Place], comparison: Mapping[str, Mapping[str, Place]]) -> None:
    """Mark the values by other engines."""
    factor = CRITERIA[by].quantity.plot_factor
    for (engine, places), offset in zip(comparison.items(), mark_offsets(len(comparison)), strict=True):
        found = [(places[place.law].value * factor, row) for row, place in enumerate(order) if place.law in places]
        found = [mark for mark in found if np.isfinite(mark[0])]
        if found:
            color, mark, _ = engine_style(engine)
            value, row = np.transpose(found)
            style: dict[str, Any] = {"mfc": "white", "markersize": 4, "linestyle": "none", "clip_on": False}
            ax.plot(value, row + offset, mark, color=color, label=f"by {engine}", **style)
            ax.set_xlim(0, max(ax.get_xlim()[1], 1.05 * value.max()))


def _draw_excess(ax: Axes, excess: Mapping[str, Mapping[str, tuple[float, float]]], by: str, most: int) -> None:
    """Mark the excess of the laws by each engine, with its error."""
    reference = next(iter(excess.values()))
    least = {law: min(found[law][0] for found in excess.values() if law in found) for law in reference}
    nearest = itertools.chain(*group_equal(list(least.values()), floor=100.0))
    shown = {list(least)[i] for i in itertools.islice(nearest, most)}
    laws = [law for law in reference if law in shown]  # in their order by the first engine
    for (engine, found), offset in zip(excess.items(), mark_offsets(len(excess)), strict=True):
        color, mark, _ = engine_style(engine)
        value, error = np.reshape([found.get(law, (np.nan, 0.0)) for law in laws], (-1, 2)).T
        style: dict[str, Any] = {"color": color, "mfc": "white", "markersize": 4, "lw": 0.8, "capsize": 2}
        error = np.where(error, error, np.nan)  # no whisker without an error
        ax.errorbar(value, np.arange(len(laws)) + offset, xerr=error, fmt=mark, label=engine, **style)
    if not laws:
        write_none_finite(ax, by)
    ax.set_yticks(range(len(laws)), laws, fontsize=8)
    ax.set_ylim(len(laws) - 0.4, -0.6)
    ax.set_yticks(np.arange(max(len(laws) - 1, 0)) + 0.5, minor=True)
    ax.grid(axis="y", which="minor", color="0.9")
    ax.tick_params(axis="y", which="minor", length=0)


def _excess(order: Iterable[Place], by: str) -> dict[str, tuple[float, float]]:
    """Return excess over the first law and its error [%] by law, of finite values."""
    finite = [place for place in order if not place.reason]
    least = min((place.value for place in finite), default=0.0)
    scale = CRITERIA[by].scale(least) or max((place.value for place in finite), default=0.0) or 1.0
    errors = [place.error if place.error and np.isfinite(place.error) else 0.0 for place in finite]
    return {
        place.law: (100 * (place.value - least) / scale, 100 * error / scale)
        for place, error in zip(finite, errors, strict=True)
    }
