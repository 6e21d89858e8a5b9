"""Figures of the order of the laws: bars of a ranking, what engines say side by side, and what each resists.

Each function draws one figure and returns it; an engine keeps its colour and mark in all of them.
"""

import itertools

import numpy as np

from compact.machine.ranking import CRITERIA
from compact.quantities import MOTION, SPEED
from compact.report.figures import PALETTE, look, panels

PANELS = 2  # criteria of the comparison of engines, for each drive
LETTER = 0.061  # width of a letter of 8 points [inch]
SHOWN = 4  # criteria, those that the scene names first
ENGINE_LOOKS = {  # colour, mark and dash of an engine
    "formula": ("0.35", "x", ":"),
    "column": (PALETTE[2], "o", "--"),
    "spectral": (PALETTE[0], "s", "-."),
    "fem": (PALETTE[1], "D", "-"),
    "compaction": (PALETTE[3], "^", "-"),
}
ROW, PANEL_WIDTH = 0.24, 2.8  # of a panel of laws: height of a row and width [inch]; names and it fit a narrow screen
SPREAD = 0.6  # of a row, over which the marks of engines stand one above the other, so that none hides another


def ranking(order, beside):
    """Bars of the ranked laws, best on top, a panel for each of the first criteria; infinite ones are named.

    order : lists of `ordering.Place` by criterion;  beside : criterion -> engine -> law -> `Place`, marks on the bars
    """
    order = dict(list(order.items())[:SHOWN])
    named = {by: [f"{place.rank}  {place.law}  {_said(by, place)}" for place in places] for by, places in order.items()}
    figure, axes = _below_one_another(len(order), max(map(len, order.values())), itertools.chain(*named.values()))
    for ax, (by, places) in zip(axes, order.items(), strict=True):
        _bars(ax, by, places, named[by])
        _marks(ax, by, places, beside.get(by, {}))
    _legend(figure, axes)
    return figure


def _below_one_another(count, rows, names):
    """A figure of so many panels, one below the other, with room for the names of their rows."""
    room = _room(names)
    size, margins = (PANEL_WIDTH, ROW * rows + 0.2), {"left": room, "top": 0.5, "gaps": (0.0, 0.6)}
    figure, axes = panels(count, 1, size, **margins)
    return figure, axes[:, 0]


def _legend(figure, axes):
    """One legend above all panels, of what any of them shows."""
    found = {label: mark for ax in axes for mark, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(found.values(), found, loc="upper center", ncols=len(found), frameon=False, fontsize=8)


def _bars(ax, by, places, named):
    """A bar with its error and its name for each place, in its order."""
    quantity = CRITERIA[by].quantity
    factor = quantity.plot_factor
    for row, place in enumerate(places):
        if place.reason:
            ax.text(0, row, f" infinite: {place.reason.split(':')[0]}", va="center", fontsize=8, color="0.35")
    rows = [row for row, place in enumerate(places) if not place.reason]
    finite = np.array([places[row].value * factor for row in rows])
    errors = np.nan_to_num([(places[row].error or 0.0) * factor for row in rows], posinf=0.0)
    colors = [look(places[row].law)["color"] for row in rows]
    ax.barh(rows, finite, color=colors, height=0.72, edgecolor="black", linewidth=0.4)
    told = np.flatnonzero(errors)
    if told.size:
        whisker = {"fmt": "none", "ecolor": "black", "capsize": 2.5, "elinewidth": 1.2, "label": "error"}
        ax.errorbar(finite[told], np.array(rows)[told], xerr=errors[told], **whisker)
    ax.set_yticks(range(len(places)), named, fontsize=8)
    ax.set_xlim(0, 1.15 * max(finite + errors, default=1.0) or 1.0)
    ax.set_ylim(len(places) - 0.4, -0.6)
    ax.set_xlabel(quantity.axis_label)
    ax.spines[["top", "right"]].set_visible(False)


def _said(by, place):
    return "" if place.reason else f"{place.value * CRITERIA[by].quantity.plot_factor:#.4g}".rstrip(".")


def _room(names):
    """Inches that the longest of the names beside an axis takes."""
    return 0.3 + LETTER * max(map(len, names))


def dodges(count):
    """Heights of the marks of engines in a row, so that none hides another."""
    return np.linspace(-SPREAD / 2, SPREAD / 2, count) if count > 1 else np.zeros(count)


def _marks(ax, by, places, beside):
    """The values by other engines beside the bars."""
    factor = CRITERIA[by].quantity.plot_factor
    for (engine, order), dodge in zip(beside.items(), dodges(len(beside)), strict=True):
        found = [(order[place.law].value * factor, row) for row, place in enumerate(places) if place.law in order]
        found = [mark for mark in found if np.isfinite(mark[0])]
        if found:
            color, mark, _ = ENGINE_LOOKS[engine]
            value, row = np.transpose(found)
            seen = {"mfc": "white", "markersize": 4, "linestyle": "none", "clip_on": False}
            ax.plot(value, row + dodge, mark, color=color, label=f"by {engine}", **seen)
            ax.set_xlim(0, max(ax.get_xlim()[1], 1.05 * value.max()))


def engines(orders, most=12):
    """What the laws ask above the least, a mark with its error for each engine, panels for drives and criteria.

    orders : lists of `ordering.Place` by engine, drive and criterion; laws are those that are best by any engine, in
    the order of the first engine
    """
    ours = next(iter(orders))
    shown = [(kind, by) for kind, found in orders[ours].items() for by in list(found)[:PANELS]]
    names = (place.law for kind, by in shown for place in orders[ours][kind][by])
    rows = min(most, max(len(orders[ours][kind][by]) for kind, by in shown))
    figure, axes = _below_one_another(len(shown), rows, names)
    for ax, (kind, by) in zip(axes, shown, strict=True):
        excess = {engine: _excess(found[kind][by], by) for engine, found in orders.items()}
        laws = sorted(excess[ours], key=lambda law: min(found[law][0] for found in excess.values() if law in found))
        laws = sorted(laws[:most], key=lambda law: excess[ours][law][0])
        for (engine, found), dodge in zip(excess.items(), dodges(len(excess)), strict=True):
            color, mark, _ = ENGINE_LOOKS[engine]
            value, error = np.reshape([found.get(law, (np.nan, 0.0)) for law in laws], (-1, 2)).T
            drawn = {"color": color, "mfc": "white", "markersize": 4, "lw": 0.8, "capsize": 2}
            error = np.where(error, error, np.nan)  # no whisker of none
            ax.errorbar(value, np.arange(len(laws)) + dodge, xerr=error, fmt=mark, label=engine, **drawn)
        if not laws:
            none = f"no law has a finite {CRITERIA[by].quantity.term}"
            ax.text(0.5, 0.5, none, transform=ax.transAxes, ha="center", va="center", fontsize=9)
        ax.set_yticks(range(len(laws)), laws, fontsize=8)
        ax.set_ylim(len(laws) - 0.4, -0.6)
        ax.set_xlabel(f"excess {CRITERIA[by].quantity.term} [%], {kind} drive", fontsize=9)
        ax.set_yticks(np.arange(max(len(laws) - 1, 0)) + 0.5, minor=True)
        ax.grid(axis="y", which="minor", color="0.9")
        ax.tick_params(axis="y", which="minor", length=0)
    _legend(figure, axes)
    return figure


def _excess(order, by):
    """Law -> (what it asks above the least, the error of that) [%], of finite places."""
    finite = [place for place in order if not place.reason]
    least = min((place.value for place in finite), default=0.0)
    scale = CRITERIA[by].scale(least) or max((place.value for place in finite), default=0.0) or 1.0
    errors = [place.error if place.error and np.isfinite(place.error) else 0.0 for place in finite]
    return {
        place.law: (100 * (place.value - least) / scale, 100 * error / scale)
        for place, error in zip(finite, errors, strict=True)
    }


def resistance(resistances):
    """Resistance of one cart over speed by each engine, callables by name; of the first, a map, its samples too."""
    figure, ((ax,),) = panels(1, 1, (6.2, 3.1))
    ours, met = next(iter(resistances.items()))
    widths = np.linspace(4.0, 1.5, len(resistances))  # those below are the broader, so that none hides another
    for (engine, force), width in zip(reversed(resistances.items()), widths, strict=True):
        (color, _, dash), fastest = ENGINE_LOOKS[engine], getattr(force, "speeds", met.speeds)[-1]
        speed = np.linspace(0, min(fastest, met.speeds[-1]), 801)[1:]
        ax.plot(speed, force(speed, 0.0) / 1e3, dash, color=color, linewidth=width, label=engine)
    ax.plot(met.speeds, met.forces / 1e3, "o", color=ENGINE_LOOKS[ours][0], markersize=4, label=f"{ours}, computed")
    ax.set_xlabel(SPEED.axis_label)
    ax.set_ylabel(MOTION["cart_resistance"].axis_label)
    ax.set_xlim(0, 1.02 * met.speeds[-1])
    ax.set_ylim(min(0.0, 1.1 * met.forces.min() / 1e3), None)
    ax.legend(frameon=False, reverse=True, handlelength=3.2)
    return figure
