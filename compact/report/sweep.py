"""Results of a sweep in addition to sweep.nc: figures, Sobol indices, and the digest on the terminal.

Maps of a sample show the median. A map is hatched where rolling cannot reach the density, and grey without a number.
Over mould speed and duration of a forming process one figure is its operating window.
"""

import json
import re
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from compact.files import write_csv, write_figure
from compact.quantities import CRITERIA, SWEEP_POINT, unit_symbol
from compact.report.figures import PALETTE, label_contours, law_style
from compact.scene.constraints import value_at
from compact.scene.schema import declared_keys, extra_of
from compact.sweep.sobol_indices import Index, SobolTable

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

SHOWN_SENTENCES = 6  # [-], number of different sentences in the digest
DIGEST_QUANTITIES = ("load", "resistance", "resistance_coefficient", "power", "capture_angle", "exit_density_ratio")
DIGITS = re.compile(r"\d[\d.e+-]*")
BAND = (0.05, 0.95)  # [-], quantiles of a sample
DRAWN_QUANTITIES = ("resistance", "load", "power", "capture_angle", "exit_density_ratio", "resistance_coefficient")
BEST_LAW = "best_law_by_"
PANEL_COLUMNS = 3  # [-]
LOGARITHMIC_RATIO = 10  # [-], of largest to smallest value, above which an axis is logarithmic
CONSTANT_SPAN = 1e-9  # [-], relative range below which a quantity is constant
NO_NUMBER = "0.82"  # grey
LEGEND_WIDTH = 130  # [characters]
WINDOW = ("mould_speed", "duration")
HATCHES = ("//", "\\\\", "..", "xx", "++", "oo")  # of limits
MINUTE = 60.0  # [s]
REASON_WIDTH = 90  # [characters], of a reason in a legend


def write_sweep_report(directory: Path, table: "Dataset", sobol: SobolTable) -> None:
    """Write the figures and Sobol indices that the axes and numbers of a sweep admit."""
    if sobol:
        rows = [(quantity, name, *each) for quantity, found in sobol.items() for name, each in found.items()]
        write_csv(directory / "sobol.csv", ("quantity", "input", *Index._fields), rows)
        write_figure(directory / "sobol.png", draw_sobol_indices(sobol))
    axes, names = numeric_axes(table), varying_quantities(table)
    if axes and names and (len(axes) == 1 or "sample" in table.dims):
        write_figure(directory / "bands.png", draw_bands(table, names))
    if {*axes[-2:]} == {*WINDOW} and "limit" in table and "sample" not in table.dims:
        write_figure(directory / "window.png", draw_window(table))
    elif len(axes) >= 2 and names:
        write_figure(directory / "maps.png", draw_maps(table, names))
        if best := [] if "sample" in table.dims else [str(name) for name in table if str(name).startswith(BEST_LAW)]:
            write_figure(directory / "best_laws.png", draw_maps(table, best))


def sweep_summary(table: "Dataset", sobol: SobolTable) -> dict[str, Any]:
    """Return counts, ranges of the quantities and Sobol indices of a sweep, for JSON."""
    found = {}
    for name in DIGEST_QUANTITIES:
        values = table[name].values[np.isfinite(table[name].values)]
        low, middle, high = np.quantile(values, [0, 0.5, 1]) if values.size else (None, None, None)
        found[name] = {"low": low, "median": middle, "high": high, "unit": SWEEP_POINT[name].unit}
    return {
        "engine": table.attrs["engine"],
        "without_numbers": (table["reason"] != "").values.sum(),
        "quantities": found,
        "sobol_first": {by: {name: each.first for name, each in found.items()} for by, found in sobol.items()},
    }


def sweep_digest(table: "Dataset", sobol: SobolTable) -> str:
    """Summarise a sweep: ranges of the quantities, failures, warnings and Sobol indices."""
    summary, beyond = sweep_summary(table, sobol), (table["not_reachable"] != "").values.sum()
    lines = [f"{table['reason'].size} points by {summary['engine']}, {summary['without_numbers']} without numbers"]
    lines += [f"  {sentence}" for sentence in filter(None, table.attrs.get("correction", "").splitlines())]
    for name, each in summary["quantities"].items():
        if each["low"] is not None:
            low, high, unit = each["low"], each["high"], unit_symbol(each["unit"])
            lines.append(f"  {name:<24}{low:>10.4g} to {high:<10.4g} {unit:<4} median {each['median']:.4g}")
    if beyond:
        lines.append(f"  not reachable by rolling: {beyond} points, reasons in not_reachable")
    for name, words in (("reason", "without numbers"), ("warnings", "warned"), ("replaced", "replaced")):
        lines += [f"  {words}: {sentence}" for sentence in _count_sentences(table[name].values.ravel())]
    for quantity, found in sobol.items():
        shares = (f"{name} {i.first:.2f} ({i.first_low:.2f} to {i.first_high:.2f})" for name, i in found.items())
        lines.append(f"  variance of {quantity}, first order: {', '.join(shares)}")
    return "\n".join(lines)


def _count_sentences(sentences: Iterable[str]) -> list[str]:
    """Count sentences that differ in numbers only; return the most frequent ones."""
    kinds: dict[str, list[str]] = {}
    for sentence in filter(None, sentences):
        kinds.setdefault(DIGITS.sub("#", sentence), []).append(sentence)
    ordered = sorted(kinds.values(), key=len, reverse=True)
    rest = sum(map(len, ordered[SHOWN_SENTENCES:]))
    shown = [f"{len(each)} x {each[0]}" for each in ordered[:SHOWN_SENTENCES]]
    return [*shown, f"{rest} x for other reasons"] if rest else shown


# figures


def numeric_axes(table: "Dataset") -> list[str]:
    """List the keys varied over two or more numbers."""
    axes = [str(name) for name in table["load"].dims if name != "sample"]
    return [name for name in axes if table[name].dtype.kind in "fi" and table[name].size > 1]


def varying_quantities(table: "Dataset") -> list[str]:
    """List the quantities that vary over the table."""
    numbers = {name: table[name].values[np.isfinite(table[name].values)] for name in DRAWN_QUANTITIES}
    spans = {name: (np.ptp(each), CONSTANT_SPAN * np.abs(each).max()) for name, each in numbers.items() if each.size}
    return [name for name, (span, rounding) in spans.items() if span > rounding]


def band(table: "Dataset", quantity: str) -> "tuple[DataArray, DataArray, DataArray]":
    """Compute the quantiles BAND and the median of a quantity over a sample.

    Returns
    -------
    tuple of DataArray
        Lower quantile, median, upper quantile; three times the values without a sample.
    """
    values = table[quantity]
    if "sample" not in table.dims:
        return values, values, values
    values = values.isel(sample=np.isin(table["part"].values, ("A", "B")))  # the independent rows
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # all of a sample failed
        low, middle, high = values.quantile([BAND[0], 0.5, BAND[1]], dim="sample", skipna=True)
    return low, middle, high


def _plane(table: "Dataset", *names: str) -> "Dataset":
    """Return a sweep over some of its keys, at the first value of the others."""
    return table.isel({name: 0 for name in table["load"].dims if name not in names})


def _axis_label(table: "Dataset", name: str) -> str:
    """Return the label of a varied key with its unit."""
    key, words = table[name].attrs["key"], name.replace("_", " ")
    return f"{words} [{extra_of(key).get('unit', '-')}]" if key in declared_keys() else words


def _panels(count: int, **labels: str) -> tuple[Figure, list[Axes]]:
    """Make a figure of a number of panels with the same labels of axes, PANEL_COLUMNS a row."""
    rows = -(-count // PANEL_COLUMNS)
    figure = Figure(figsize=(4.3 * PANEL_COLUMNS, 3.3 * rows + 0.7), layout="constrained")
    return figure, [figure.add_subplot(rows, PANEL_COLUMNS, number, **labels) for number in range(1, count + 1)]


def _legend(figure: Figure, marks: Sequence[Any]) -> None:
    if marks:
        columns = min(8, len(marks), max(1, LEGEND_WIDTH // max(len(str(mark.get_label())) for mark in marks)))
        figure.legend(handles=marks, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def draw_maps(table: "Dataset", names: Sequence[str]) -> Figure:
    """Draw quantities, or first laws, over the last two varied keys, at the first value of other keys."""
    y, x = numeric_axes(table)[-2:]
    plane = _plane(table, x, y, "sample").transpose(y, x, ...)
    best = sorted({law for name in names if name.startswith(BEST_LAW) for law in plane[name].values.flat} - {""})
    unreachable = plane["not_reachable"] != ""
    if "sample" in unreachable.dims:
        unreachable = unreachable.mean("sample") > 0.5
    figure, axes = _panels(len(names), xlabel=_axis_label(table, x), ylabel=_axis_label(table, y), facecolor=NO_NUMBER)
    for ax, name in zip(axes, names, strict=True):
        if name.startswith(BEST_LAW):
            laws = plane[name].values
            numbers = np.ma.masked_where(laws == "", np.searchsorted(best, laws))
            colours = ListedColormap([law_style(law)["color"] for law in best] or [NO_NUMBER])
            ax.pcolormesh(plane[x], plane[y], numbers, cmap=colours, vmin=-0.5, vmax=max(len(best), 1) - 0.5)
            ax.set_title(f"least {CRITERIA[name.removeprefix(BEST_LAW)].term}", fontsize=10)
            continue
        values = np.ma.masked_invalid(band(plane, name)[1].values * SWEEP_POINT[name].plot_factor)
        ax.set_title(SWEEP_POINT[name].axis_label, fontsize=10)
        if values.count() and np.ma.ptp(values) > CONSTANT_SPAN * np.abs(values).max():
            filled = ax.contourf(plane[x], plane[y], values, cmap="viridis")
            label_contours(ax, ax.contour(filled, colors="black", linewidths=0.6))
        elif values.count():
            ax.set(facecolor="white", title=f"{SWEEP_POINT[name].axis_label}: {values.max():.4g}")
        if unreachable.any():
            ax.contourf(plane[x], plane[y], unreachable.values, [0.5, 1.5], colors="none", hatches=["////"])
    marks: list[Any] = [Patch(facecolor=law_style(law)["color"], label=law) for law in best]
    if unreachable.any():
        marks.append(Patch(facecolor="none", edgecolor="black", hatch="////", label="not reachable by rolling"))
    if (table["reason"] != "").any():
        marks.append(Patch(facecolor=NO_NUMBER, label="no result, reason in sweep.nc"))
    _legend(figure, marks)
    return figure


def draw_window(table: "Dataset") -> Figure:
    """Draw the operating window of a forming process: density reached, force, power, limits and the scene itself.

    Over speed of the mould and strokes a minute; hatched where a limit is met, or, by its reason, without a number.
    """
    plane = _plane(table, *WINDOW).transpose(*WINDOW)
    scene = json.loads(table.attrs["scene"])
    dwell = scene["motion"]["dwell"]
    rate, speed = MINUTE / (plane["duration"].values + dwell), MINUTE * plane["mould_speed"].values
    figure = Figure(figsize=(7.6, 5.6), layout="constrained")
    ax = figure.add_subplot()
    ax.set(xlabel="strokes a minute [1/min]", ylabel="speed of the mould [m/min]")
    density = np.ma.masked_invalid(plane["exit_density_ratio"].values)
    marks: list[Any] = []
    if density.count() and np.ma.ptp(density) > CONSTANT_SPAN:
        figure.colorbar(ax.contourf(rate, speed, density, 12, cmap="viridis"), label="density ratio of the product [-]")
    for name, colour in (("resistance", "black"), ("power", "white")):
        values = np.ma.masked_invalid(plane[name].values * SWEEP_POINT[name].plot_factor)
        if values.count():
            label_contours(ax, ax.contour(rate, speed, values, colors=colour, linewidths=1.0))
            outline = [Stroke(linewidth=3.0, foreground="0.6"), Normal()]
            marks.append(Line2D([], [], color=colour, path_effects=outline, label=SWEEP_POINT[name].axis_label))
    met: dict[str, Any] = {}
    for place, told in np.ndenumerate(np.where(plane["reason"] == "", plane["limit"], plane["reason"])):
        for word in [told] if plane["reason"].values[place] else filter(None, told.split(", ")):
            met.setdefault(DIGITS.sub("#", word), (word, np.zeros(density.shape)))[1][place] = 1.0
    for (word, cells), hatch in zip(met.values(), HATCHES, strict=False):
        ax.contourf(rate, speed, cells, [0.5, 1.5], colors="none", hatches=[hatch])
        label = shorten(word, REASON_WIDTH, placeholder=" …")
        marks.append(Patch(facecolor="none", edgecolor="black", hatch=hatch, label=label))
    mould, duration = (value_at(scene, table[name].attrs["key"]) for name in WINDOW)
    if mould is not None and duration is not None:
        ax.plot(MINUTE / (duration + dwell), MINUTE * mould, "*w", markeredgecolor="black", markersize=14)
    _legend(figure, marks)
    return figure


def draw_bands(table: "Dataset", names: Sequence[str]) -> Figure:
    """Draw quantities over the last varied key, at the first value of other keys, with bands of a sample."""
    x = numeric_axes(table)[-1]
    plane = _plane(table, x, "sample")
    figure, axes = _panels(len(names), xlabel=_axis_label(table, x))
    for ax, name in zip(axes, names, strict=True):
        quantity = SWEEP_POINT[name]
        low, middle, high = (part * quantity.plot_factor for part in band(plane, name))
        ax.plot(plane[x], middle, color=PALETTE[0], marker=".")
        ax.fill_between(plane[x], low, high, color=PALETTE[0], alpha=0.15, linewidth=0)
        ax.set_ylabel(quantity.axis_label)
        ax.margins(x=0)
        ax.locator_params(axis="x", nbins=5)
        if np.nanmin(low) > 0 and np.nanmax(high) > LOGARITHMIC_RATIO * np.nanmin(low):
            ax.set_yscale("log")
    if "sample" in table.dims:
        figure.suptitle(f"bands: {BAND[0]:.0%} to {BAND[1]:.0%} of the sample", fontsize=9)
    return figure


def draw_sobol_indices(sobol: SobolTable) -> Figure:
    """Draw first-order and total Sobol indices with their confidence intervals."""
    figure = Figure(figsize=(3.9 * len(sobol) + 0.8, 3.4), layout="constrained")
    axes = figure.subplots(1, len(sobol), squeeze=False, sharey=True)[0]
    for ax, (quantity, found) in zip(axes, sobol.items(), strict=True):
        place, columns = np.arange(len(found)), np.array(list(found.values())).T
        for shift, of, color, label in ((-0.2, 0, "tab:blue", "first order"), (0.2, 3, "0.65", "total")):
            value, low, high = columns[of : of + 3]
            error = np.maximum([value - low, high - value], 0)
            ax.barh(place + shift, value, 0.38, xerr=error, color=color, error_kw={"linewidth": 1}, label=label)
        ax.set_yticks(place, [name.replace("_", " ") for name in found])
        ax.set_xlabel("share of the variance [-]")
        ax.set_title(f"{SWEEP_POINT[quantity].term} ({columns[-1, 0]:.0f} rows)", fontsize=10)
        ax.axvline(0, color="0.6", linewidth=0.8)
    axes[0].invert_yaxis()
    _legend(figure, axes[0].get_legend_handles_labels()[0])
    return figure
