"""Figures of the order of the laws: bars of a ranking, what engines say side by side, and what each resists.

Each function draws one figure and returns it; an engine keeps its colour and mark in all of them.
"""

import itertools

import numpy as np

from compact.drive import CRITERIA
from compact.figures import legend_below, look, panels

PANELS = 2  # in a row
LETTER = 0.061  # width of a letter of 8 points [inch]
SHOWN = 4  # criteria, those that the scene names first
UNITS = {"peak_force": ("kN", 1e-3), "rms_force": ("kN", 1e-3), "mean_force": ("kN", 1e-3), "peak_jerk": ("m/s³", 1.0)}
ENGINE_LOOKS = {  # colour, mark and dash of an engine
    "formula": ("0.35", "|", ":"),
    "column": ("tab:green", "o", "--"),
    "spectral": ("tab:blue", "s", "-."),
    "fem": ("tab:red", "D", "-"),
    "compaction": ("tab:purple", "^", "-"),
}


def quantity(by):
    """(words, unit, factor to it) of a criterion."""
    unit, factor = UNITS.get(by, (CRITERIA[by].unit, 1.0))
    return by.replace("_", " "), unit, factor


def ranking(order, beside):
    """Bars of the ranked laws, best on top, a panel for each of the first criteria; infinite ones are named.

    order : lists of `ordering.Place` by criterion;  beside : criterion -> engine -> law -> `Place`, marks on the bars
    """
    order = dict(list(order.items())[:SHOWN])
    most = max(len(places) for places in order.values())
    columns = min(PANELS, len(order))
    rows = -(-len(order) // columns)
    named = {by: [f"{place.rank}  {place.law}  {_said(by, place)}" for place in places] for by, places in order.items()}
    room = _room(itertools.chain(*named.values()))
    size, margins = (4.0, 0.29 * most + 0.2), {"left": room, "bottom": 0.85, "gaps": (room, 0.6)}
    figure, axes = panels(rows, columns, size, **margins)
    for ax, (by, places) in zip(axes.ravel(), order.items(), strict=False):
        _bars(ax, by, places, named[by])
        _marks(ax, by, places, beside.get(by, {}))
    for ax in axes.ravel()[len(order) :]:
        ax.set_axis_off()
    legend_below(figure, axes[0, 0], columns=len(ENGINE_LOOKS))
    return figure


def _bars(ax, by, places, named):
    """A bar with its error and its name for each place, in its order."""
    words, unit, factor = quantity(by)
    for row, place in enumerate(places):
        if place.reason:
            ax.text(0, row, f" infinite: {place.reason.split(':')[0]}", va="center", fontsize=8, color="0.35")
    rows = [row for row, place in enumerate(places) if not place.reason]
    finite = np.array([places[row].value * factor for row in rows])
    errors = np.nan_to_num([(places[row].error or 0.0) * factor for row in rows], posinf=0.0)
    colors = [look(places[row].law)["color"] for row in rows]
    ax.barh(rows, finite, color=colors, height=0.72, xerr=np.where(errors, errors, np.nan), ecolor="0.4")
    ax.set_yticks(range(len(places)), named, fontsize=8)
    ax.set_xlim(0, 1.15 * max(finite, default=1.0) or 1.0)
    ax.set_ylim(len(places) - 0.4, -0.6)
    ax.set_xlabel(f"{words} [{unit}]")
    ax.spines[["top", "right"]].set_visible(False)


def _said(by, place):
    return "" if place.reason else f"{place.value * quantity(by)[2]:#.4g}".rstrip(".")


def _room(names):
    """Inches that the longest of the names beside an axis takes."""
    return 0.3 + LETTER * max(map(len, names))


def _marks(ax, by, places, beside):
    """The values by other engines beside the bars."""
    factor = quantity(by)[2]
    for engine, order in beside.items():
        found = [(order[place.law].value * factor, row) for row, place in enumerate(places) if place.law in order]
        found = [mark for mark in found if np.isfinite(mark[0])]
        if found:
            color, mark, _ = ENGINE_LOOKS[engine]
            ax.plot(*zip(*found, strict=True), mark, color=color, mfc="none", markersize=6, label=f"by {engine}")
            ax.set_xlim(0, max(ax.get_xlim()[1], 1.05 * max(value for value, _ in found)))


def engines(orders, most=12):
    """What the laws ask above the least, a mark with its error for each engine, panels for drives and criteria.

    orders : lists of `ordering.Place` by engine, drive and criterion; laws are those that are best by any engine, in
    the order of the first engine
    """
    ours = next(iter(orders))
    shown = [(kind, by) for kind, found in orders[ours].items() for by in list(found)[:PANELS]]
    columns = min(PANELS, len(shown))
    rows = -(-len(shown) // columns)
    room = _room(place.law for kind, by in shown for place in orders[ours][kind][by])
    size, margins = (3.9, 0.28 * most + 0.4), {"left": room, "bottom": 0.85, "gaps": (room, 0.6)}
    figure, axes = panels(rows, columns, size, **margins)
    for ax, (kind, by) in zip(axes.ravel(), shown, strict=False):
        excess = {engine: _excess(found[kind][by], by) for engine, found in orders.items()}
        laws = sorted(excess[ours], key=lambda law: min(found[law][0] for found in excess.values() if law in found))
        laws = sorted(laws[:most], key=lambda law: excess[ours][law][0])
        for engine, found in excess.items():
            color, mark, _ = ENGINE_LOOKS[engine]
            value, error = np.array([found.get(law, (np.nan, 0.0)) for law in laws]).T
            ax.errorbar(value, range(len(laws)), xerr=error, fmt=mark, color=color, mfc="none", label=engine, lw=0.8)
        ax.set_yticks(range(len(laws)), laws, fontsize=8)
        ax.invert_yaxis()
        ax.set_xlabel(f"{by.replace('_', ' ')} above the least [%], {kind} drive")
        ax.grid(axis="y", color="0.92")
    for ax in axes.ravel()[len(shown) :]:
        ax.set_axis_off()
    legend_below(figure, axes[0, 0], columns=len(orders))
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
    for engine, force in resistances.items():
        (color, _, dash), fastest = ENGINE_LOOKS[engine], getattr(force, "speeds", met.speeds)[-1]
        speed = np.linspace(0, min(fastest, met.speeds[-1]), 801)[1:]
        ax.plot(speed, force(speed, 0.0) / 1e3, dash, color=color, label=engine)
    ax.plot(met.speeds, met.forces / 1e3, "o", color=ENGINE_LOOKS[ours][0], markersize=4, label="computed")
    ax.set_xlabel("speed v [m/s]")
    ax.set_ylabel("resistance of the mix to one cart [kN]")
    ax.set_xlim(0, 1.02 * met.speeds[-1])
    ax.set_ylim(min(0.0, 1.1 * met.forces.min() / 1e3), None)
    ax.legend(frameon=False)
    return figure
