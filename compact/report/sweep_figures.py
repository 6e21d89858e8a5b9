"""Figures of a sweep: maps over two keys, bands over one, best laws, and bars of Sobol indices.

Each function draws one figure from the table of a sweep and returns it. Of a sample, maps show the median and how many
times the upper end of the band is above the lower one; the band holds BAND of the sample. Where rolling does not reach
the density the map is hatched, where there is no number it is grey.
"""

import warnings

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from compact.material.mix import ROLLING_PRESSURE, ROLLING_SATURATION
from compact.quantities import INPUT, SWEEP_POINT
from compact.report.figures import look
from compact.sweep.sobol_indices import of_table

BAND = (0.05, 0.95)
BAND_SAID = f"{BAND[0]:.0%} to {BAND[1]:.0%} of the sample"
SHOWN = ("resistance", "load", "power", "capture_angle", "exit_density_ratio", "resistance_coefficient")
LEVELS = 9
COLUMNS = 3
DECADE = 10  # by which values differ that are shown by their logarithm
CHANGES = 1e-9  # relative, below which a quantity is one number and no map
NO_NUMBER = "0.82"


def numeric_axes(table):
    """Names of the keys varied over two numbers or more, in the order of the table."""
    return [name for name in table["load"].dims if name != "sample" and _is_numeric(table[name])]


def _axis_label(name):
    return INPUT[name].axis_label if name in INPUT else name.replace("_", " ")


def _is_numeric(values):
    return values.dtype.kind in "fi" and values.size > 1


def drawn(table):
    """Quantities of the table that have numbers, and more than one."""
    found = []
    for name in SHOWN:
        values = table[name].values
        values = values[np.isfinite(values)]
        if values.size and np.ptp(values) > CHANGES * np.abs(values).max():
            found.append(name)
    return found


def _sample(table):
    """The rows of a sample that are drawn at random; the table itself without one."""
    return table.isel(sample=np.isin(table["part"].values, ("A", "B"))) if "sample" in table.dims else table


def band(table, quantity):
    """(low, middle, high) of a quantity over the sample: quantiles BAND and the median; the same thrice without one."""
    values = _sample(table)[quantity]
    if "sample" not in table.dims:
        return values, values, values
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # where all of the sample failed there is no band
        low, middle, high = values.quantile([BAND[0], 0.5, BAND[1]], dim="sample", skipna=True)
    return low, middle, high


def reach(table):
    """The larger of required pressure and saturation over what rolling reaches: above 1 it does not."""
    pressure, filled = (band(table, name)[1] for name in ("required_pressure", "saturation"))
    return np.maximum(pressure / ROLLING_PRESSURE, filled / ROLLING_SATURATION)


def maps(table, point=None):
    """A panel for every quantity over the two keys varied last, a second row for the bands of a sample.

    point : (x, y) of a mark, in the units of the table
    """
    y, x = numeric_axes(table)[-2:]
    table = _plane(table, x, y)
    quantities, deep = drawn(table), 2 if "sample" in table.dims else 1
    rows = -(-len(quantities) // COLUMNS) * deep
    figure = Figure(figsize=(4.3 * COLUMNS, 3.3 * rows + 0.5), layout="constrained")
    panels = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True)
    for ax in panels.ravel():
        ax.set_visible(False)
    for place, name in enumerate(quantities):
        shown, (low, middle, high) = SWEEP_POINT[name], band(table, name)
        row, column = place // COLUMNS * deep, place % COLUMNS
        _map(panels[row, column], table, middle * shown.plot_factor, x, y, "viridis", shown.axis_label)
        if deep == 2:
            _map(panels[row + 1, column], table, high / low, x, y, "magma_r", f"{shown.term}: band, high over low [-]")
    for ax in panels.ravel():
        ax.tick_params(labelbottom=True)
        if point is not None:
            ax.plot(*point, "o", color="white", markeredgecolor="black", markersize=6)
    _legend(figure, table)
    return figure


def _plane(table, x, y):
    """The table over two keys and the sample; of other keys the first value."""
    others = {name: 0 for name in table["load"].dims if name not in (x, y, "sample")}
    return table.isel(others).transpose(y, x, ...)


def _map(ax, table, values, x, y, cmap, title):
    """Filled and labelled contours; hatched where rolling does not reach, grey where there is no number."""
    ax.set_visible(True)
    ax.set_facecolor(NO_NUMBER)
    ax.set(xlabel=_axis_label(x), ylabel=_axis_label(y))
    ax.set_title(title, fontsize=10)
    shown = np.ma.masked_invalid(values.values)
    if shown.count() and np.ptp(shown.compressed()) <= CHANGES * np.abs(shown).max():
        ax.set_facecolor("white")
        ax.text(0.5, 0.5, f"{_short(shown.max())} everywhere", transform=ax.transAxes, ha="center")
    elif shown.count():
        filled = ax.contourf(table[x], table[y], shown, LEVELS, cmap=cmap)
        lines = ax.contour(filled, colors="black", linewidths=0.6)
        for text in ax.clabel(lines, fontsize=8, fmt=_short):
            text.set_path_effects([withStroke(linewidth=2, foreground="white")])
    beyond = reach(table).transpose(y, x).values
    if np.nanmax(beyond, initial=0.0) > 1:
        ax.contourf(table[x], table[y], beyond, [1, np.inf], colors="none", hatches=["////"])
    ax.set_xlim(float(table[x].min()), float(table[x].max()))
    ax.set_ylim(float(table[y].min()), float(table[y].max()))


def _short(value):
    return f"{value:.4g}"


def _legend(figure, table):
    marks = []
    if np.nanmax(reach(table).values, initial=0.0) > 1:
        marks.append(Patch(facecolor="none", edgecolor="black", hatch="////", label="not reachable by rolling"))
    if (table["reason"] != "").any():
        marks.append(Patch(facecolor=NO_NUMBER, label="no number: see the reasons"))
    if "sample" in table.dims:
        marks.append(Patch(facecolor="none", label=f"above: median; below: its band, {BAND_SAID}"))
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9)


def bands(table, point=None):
    """A panel for every quantity over the key varied last, a line for each value of the one before; bands of a sample.

    point : {name: value} of a mark, names of the keys and quantities among them
    """
    *_, x = numeric_axes(table)
    before = [name for name in table["load"].dims if name not in (x, "sample")][-1:]
    quantities = drawn(table)
    rows = -(-len(quantities) // COLUMNS)
    figure = Figure(figsize=(4.3 * COLUMNS, 3.3 * rows + 0.7), layout="constrained")
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for ax, name in zip(panels, quantities, strict=False):
        _bands(ax, table, name, x, before)
        if point is not None and name in point:
            value = point[name] * SWEEP_POINT[name].plot_factor
            ax.plot(point[x], value, "o", color="white", markeredgecolor="black", label="calibrated")
    for ax in panels[len(quantities) :]:
        ax.set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    if any(labels):
        title = f"bands: {BAND[0]:.0%} to {BAND[1]:.0%} of the sample" if "sample" in table.dims else None
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(8, len(labels)), frameon=False, title=title
        )
    return figure


def _bands(ax, table, name, x, before):
    quantity = SWEEP_POINT[name]
    values = table[name].values
    for color, line, said in _lines(table, x, before):
        low, middle, high = (part.values * quantity.plot_factor for part in band(line, name))
        ax.plot(line[x], middle, color=color, marker=".", label=said)
        ax.fill_between(line[x], low, high, color=color, alpha=0.15, linewidth=0)
    ax.set(xlabel=_axis_label(x), ylabel=quantity.axis_label)
    ax.margins(x=0)
    if np.nanmin(values) > 0 and np.nanmax(values) > DECADE * np.nanmin(values):
        ax.set_yscale("log")


def _lines(table, x, before):
    """(colour, table over x and the sample, label) for each value of the key before."""
    from matplotlib import colormaps

    values = table[before[0]].values if before else [None]
    for i, value in enumerate(values):
        line = table.isel({before[0]: i}) if before else table
        line = line.isel({name: 0 for name in line["load"].dims if name not in (x, "sample")})
        said = f"{before[0].replace('_', ' ')} {_word(value)}" if before else None
        yield colormaps["viridis"](0.9 * i / max(len(values) - 1, 1)), line, said


def _word(value):
    return f"{value:.4g}" if isinstance(value, int | float | np.number) else str(value)


def best_laws(table):
    """The law that ranks first, of a sample most often, over the two keys varied last; a panel for each criterion."""
    y, x = numeric_axes(table)[-2:]
    table = _plane(table, x, y)
    criteria = [name for name in table if name.startswith("best_law_by_")]
    figure = Figure(figsize=(5.2 * len(criteria), 4.6), layout="constrained")
    panels = figure.subplots(1, len(criteria), squeeze=False, sharex=True, sharey=True)[0]
    shown = {}
    for ax, criterion in zip(panels, criteria, strict=True):
        best = _most_frequent(table[criterion])
        names = sorted(set(best.ravel()) - {""})
        shown |= {name: look(name)["color"] for name in names}
        numbers = np.ma.masked_where(best == "", np.searchsorted(names, best))
        ax.set_facecolor(NO_NUMBER)
        colours = ListedColormap([shown[name] for name in names] or [NO_NUMBER])
        ax.pcolormesh(
            table[x], table[y], numbers, cmap=colours, vmin=-0.5, vmax=max(len(names), 1) - 0.5, shading="nearest"
        )
        ax.set_title(f"least {criterion.removeprefix('best_law_by_').replace('_', ' ')}", fontsize=10)
        ax.set(xlabel=_axis_label(x), ylabel=_axis_label(y))
    marks = [Patch(facecolor=color, label=name) for name, color in shown.items()]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _most_frequent(laws):
    """The word that is most frequent along the sample, empty ones left out."""
    values = laws.values.astype(str)
    if "sample" not in laws.dims:
        return values
    names = sorted(set(values.ravel()) - {""}) or [""]
    counts = np.array([(values == name).sum(axis=-1) for name in names])
    return np.where(counts.sum(axis=0) > 0, np.array(names)[counts.argmax(axis=0)], "")


def sobol_bars(table, quantities):
    """First-order and total Sobol indices of some quantities, bars with their confidence intervals."""
    figure = Figure(figsize=(3.9 * len(quantities) + 0.8, 3.4), layout="constrained")
    panels = figure.subplots(1, len(quantities), squeeze=False, sharey=True)[0]
    for ax, quantity in zip(panels, quantities, strict=True):
        names, found = of_table(table, quantity)
        place = np.arange(len(names))
        for shift, kind, color in ((-0.2, "first", "tab:blue"), (0.2, "total", "0.65")):
            value, low, high = (getattr(found, kind + end) for end in ("", "_low", "_high"))
            error = np.maximum([value - low, high - value], 0)
            said = {"first": "first order", "total": "in total"}[kind]
            ax.barh(place + shift, value, 0.38, xerr=error, color=color, error_kw={"linewidth": 1}, label=said)
        ax.set_yticks(place, [name.replace("_", " ") for name in names])
        ax.set_xlabel("share of the variance [-]")
        ax.set_title(f"{SWEEP_POINT[quantity].term} ({found.rows} rows)", fontsize=10)
        ax.axvline(0, color="0.6", linewidth=0.8)
        ax.spines[["top", "right"]].set_visible(False)
    panels[0].invert_yaxis()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure
