"""Results of a sweep in addition to sweep.nc: figures, Sobol indices, and the digest on the terminal.

Maps of a sample show the median, and the ratio of the upper to the lower quantile BAND. A map is hatched where rolling
cannot reach the density, and grey where there is no number.
"""

import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from compact.files import write_csv, write_figure
from compact.material.mix import ROLLING_PRESSURE, ROLLING_SATURATION
from compact.quantities import CRITERIA, INPUT, SWEEP_POINT, unit_symbol
from compact.report.figures import label_contours, law_style
from compact.sweep.sobol_indices import SobolTable

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

SHOWN_SENTENCES = 6  # [-], number of different sentences in the digest
DIGEST_QUANTITIES = ("load", "resistance", "resistance_coefficient", "power", "capture_angle", "exit_density_ratio")
SOBOL_FIELDS = ("first", "first_low", "first_high", "total", "total_low", "total_high")
DIGITS = re.compile(r"\d[\d.e+-]*")
BAND = (0.05, 0.95)  # [-], quantiles of a sample
BAND_LABEL = f"{BAND[0]:.0%} to {BAND[1]:.0%} of the sample"
DRAWN_QUANTITIES = ("resistance", "load", "power", "capture_angle", "exit_density_ratio", "resistance_coefficient")
CONTOUR_LEVELS = 9  # [-]
PANEL_COLUMNS = 3  # [-]
LOGARITHMIC_RATIO = 10  # [-], of largest to smallest value, above which an axis is logarithmic
CONSTANT_SPAN = 1e-9  # [-], relative range below which a quantity is constant
NO_NUMBER = "0.82"  # grey


def write_sweep_report(directory: Path, table: "Dataset", sobol: SobolTable) -> None:
    """Write the figures and Sobol indices that the axes and numbers of a sweep admit."""
    if sobol:
        write_csv(directory / "sobol.csv", ("quantity", "input", *SOBOL_FIELDS, "rows"), [
            (quantity, name, *values, found.rows)
            for quantity, (names, found) in sobol.items()
            for name, *values in zip(names, *(getattr(found, field).tolist() for field in SOBOL_FIELDS), strict=True)
        ])  # fmt: skip
        write_figure(directory / "sobol.png", draw_sobol_indices(sobol))
    if not varying_quantities(table):
        return
    axes = numeric_axes(table)
    if len(axes) >= 2:
        write_figure(directory / "maps.png", draw_maps(table))
    if axes:
        write_figure(directory / "bands.png", draw_bands(table))
    if len(axes) >= 2 and any(str(name).startswith("best_law_by_") for name in table):
        write_figure(directory / "best_laws.png", draw_best_laws(table))


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
        "sobol_first": {name: dict(zip(names, each.first, strict=True)) for name, (names, each) in sobol.items()},
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
    for quantity, (names, found) in sobol.items():
        shares = zip(names, found.first, found.first_low, found.first_high, strict=True)
        text = ", ".join(f"{name} {share:.2f} ({low:.2f} to {high:.2f})" for name, share, low, high in shares)
        lines.append(f"  variance of {quantity}, first order: {text}")
    return "\n".join(lines)


def _count_sentences(sentences: Iterable[str]) -> list[str]:
    """Count sentences that differ in numbers only; return the most frequent ones."""
    counts: Counter[str] = Counter()
    examples: dict[str, str] = {}
    for sentence in filter(None, sentences):
        kind = DIGITS.sub("#", sentence)
        counts[kind] += 1
        examples.setdefault(kind, sentence)
    shown = counts.most_common(SHOWN_SENTENCES)
    rest = counts.total() - sum(count for _, count in shown)
    return [*(f"{count} x {examples[kind]}" for kind, count in shown), *[f"{rest} x for other reasons"] * bool(rest)]


# figures


def numeric_axes(table: "Dataset") -> list[str]:
    """List the keys varied over two or more numbers."""
    axes = [str(name) for name in table["load"].dims if name != "sample"]
    return [name for name in axes if table[name].dtype.kind in "fi" and table[name].size > 1]


def _axis_label(name: str) -> str:
    return INPUT[name].axis_label if name in INPUT else name.replace("_", " ")


def varying_quantities(table: "Dataset") -> list[str]:
    """List the quantities that vary over the table."""
    return [name for name in DRAWN_QUANTITIES if not _is_constant(np.ma.masked_invalid(table[name].values))]


def _is_constant(values: np.ma.MaskedArray) -> bool:
    """Return True if the numbers of an array are equal but for rounding; also without any."""
    found = values.compressed()
    return found.size == 0 or bool(np.ptp(found) <= CONSTANT_SPAN * np.abs(found).max())


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


def required_share(table: "Dataset") -> Any:
    """Compute the larger of required pressure and saturation over their limits of rolling.

    Returns
    -------
    DataArray
        Share [-]; rolling cannot reach the density where it is above 1.
    """
    pressure, filled = (band(table, name)[1] for name in ("required_pressure", "saturation"))
    return np.maximum(pressure / ROLLING_PRESSURE, filled / ROLLING_SATURATION)


def _grid(count: int, rows: int, height: float, **shared: Any) -> tuple[Figure, NDArray[Any]]:
    """Make a figure with hidden panels, PANEL_COLUMNS a row."""
    figure = Figure(figsize=(4.3 * PANEL_COLUMNS, 3.3 * rows + height), layout="constrained")
    axes = figure.subplots(rows, PANEL_COLUMNS, squeeze=False, **shared)
    for ax in axes.ravel()[count:]:
        ax.set_visible(False)
    return figure, axes


def _plane(table: "Dataset", x: str, y: str) -> "Dataset":
    """Select the table over two keys and the sample, at the first value of other keys."""
    others = {name: 0 for name in table["load"].dims if name not in (x, y, "sample")}
    return table.isel(others).transpose(y, x, ...)


def draw_maps(table: "Dataset") -> Figure:
    """Draw every quantity over the last two varied keys, with a second row for the bands of a sample."""
    y, x = numeric_axes(table)[-2:]
    table = _plane(table, x, y)
    names, deep = varying_quantities(table), 2 if "sample" in table.dims else 1
    figure, axes = _grid(0, -(-len(names) // PANEL_COLUMNS) * deep, 0.5, sharex=True, sharey=True)
    for place, name in enumerate(names):
        shown, (low, middle, high) = SWEEP_POINT[name], band(table, name)
        row, column = place // PANEL_COLUMNS * deep, place % PANEL_COLUMNS
        _draw_map(axes[row, column], table, middle * shown.plot_factor, "viridis", shown.axis_label)
        if deep == 2:
            _draw_map(axes[row + 1, column], table, high / low, "magma_r", f"{shown.term}: upper over lower band [-]")
    for ax in axes.ravel():
        ax.tick_params(labelbottom=True)
    marks = []
    if np.nanmax(required_share(table).values, initial=0.0) > 1:
        marks.append(Patch(facecolor="none", edgecolor="black", hatch="////", label="not reachable by rolling"))
    if (table["reason"] != "").any():
        marks.append(Patch(facecolor=NO_NUMBER, label="no result, reason in sweep.nc"))
    if deep == 2:
        marks.append(Patch(facecolor="none", label=f"above: median; below: its band, {BAND_LABEL}"))
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=len(marks), frameon=False, fontsize=9)
    return figure


def _draw_map(ax: Axes, table: "Dataset", values: "DataArray", cmap: str, title: str) -> None:
    """Draw filled and labelled contours over the axes of the values."""
    y, x = map(str, values.dims[:2])
    ax.set_visible(True)
    ax.set_facecolor(NO_NUMBER)
    ax.set(xlabel=_axis_label(x), ylabel=_axis_label(y))
    ax.set_title(title, fontsize=10)
    ax.set(xlim=(float(table[x].min()), float(table[x].max())), ylim=(float(table[y].min()), float(table[y].max())))
    shown = np.ma.masked_invalid(values.values)
    if shown.count() and _is_constant(shown):
        ax.set_facecolor("white")
        ax.text(0.5, 0.5, f"{shown.max():.4g} everywhere", transform=ax.transAxes, ha="center")
    elif shown.count():
        filled = ax.contourf(table[x], table[y], shown, CONTOUR_LEVELS, cmap=cmap)
        label_contours(ax, ax.contour(filled, colors="black", linewidths=0.6))
    share = required_share(table).transpose(y, x).values
    if np.nanmax(share, initial=0.0) > 1:
        ax.contourf(table[x], table[y], share, [1, np.inf], colors="none", hatches=["////"])


def draw_bands(table: "Dataset") -> Figure:
    """Draw every quantity over the last varied key, a line for each value of the key before, with bands of a sample."""
    *_, x = numeric_axes(table)
    before = [str(name) for name in table["load"].dims if name not in (x, "sample")][-1:]
    names = varying_quantities(table)
    figure, axes = _grid(len(names), -(-len(names) // PANEL_COLUMNS), 0.7)
    for ax, name in zip(axes.ravel(), names, strict=False):
        quantity, values = SWEEP_POINT[name], table[name].values
        for color, line, label in _lines(table, x, before):
            low, middle, high = (part.values * quantity.plot_factor for part in band(line, name))
            ax.plot(line[x], middle, color=color, marker=".", label=label)
            ax.fill_between(line[x], low, high, color=color, alpha=0.15, linewidth=0)
        ax.set(xlabel=_axis_label(x), ylabel=quantity.axis_label)
        ax.margins(x=0)
        if np.nanmin(values) > 0 and np.nanmax(values) > LOGARITHMIC_RATIO * np.nanmin(values):
            ax.set_yscale("log")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if any(labels):
        title, columns = f"bands: {BAND_LABEL}" if "sample" in table.dims else None, min(8, len(labels))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, title=title)
    return figure


def _lines(table: "Dataset", x: str, before: Sequence[str]) -> "Iterator[tuple[Any, Dataset, str | None]]":
    """Yield colour, table over x and the sample, and label for each value of the key before."""
    values = table[before[0]].values if before else [None]
    for i, value in enumerate(values):
        line = table.isel({before[0]: i}) if before else table
        line = line.isel({name: 0 for name in line["load"].dims if name not in (x, "sample")})
        shown = f"{value:.4g}" if isinstance(value, int | float | np.number) else value
        label = f"{before[0].replace('_', ' ')} {shown}" if before else None
        yield colormaps["viridis"](0.9 * i / max(len(values) - 1, 1)), line, label


def draw_best_laws(table: "Dataset") -> Figure:
    """Draw the first law over the last two varied keys, of a sample the most frequent one, for each criterion."""
    y, x = numeric_axes(table)[-2:]
    table = _plane(table, x, y)
    criteria = [str(name) for name in table if str(name).startswith("best_law_by_")]
    figure = Figure(figsize=(5.2 * len(criteria), 4.6), layout="constrained")
    axes = figure.subplots(1, len(criteria), squeeze=False, sharex=True, sharey=True)[0]
    shown: dict[str, str] = {}
    for ax, criterion in zip(axes, criteria, strict=True):
        best = _most_frequent(table[criterion])
        names = sorted(set(best.ravel()) - {""})
        shown |= {name: law_style(name)["color"] for name in names}
        numbers = np.ma.masked_where(best == "", np.searchsorted(names, best))
        colours = ListedColormap([shown[name] for name in names] or [NO_NUMBER])
        last = max(len(names), 1) - 0.5
        ax.set_facecolor(NO_NUMBER)
        ax.pcolormesh(table[x], table[y], numbers, cmap=colours, vmin=-0.5, vmax=last, shading="nearest")
        ax.set_title(f"least {CRITERIA[criterion.removeprefix('best_law_by_')].term}", fontsize=10)
        ax.set(xlabel=_axis_label(x), ylabel=_axis_label(y))
    marks = [Patch(facecolor=color, label=name) for name, color in shown.items()]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _most_frequent(laws: "DataArray") -> NDArray[Any]:
    """Return the most frequent law along the sample; empty names do not count."""
    values = laws.values.astype(str)
    if "sample" not in laws.dims:
        return values
    names = sorted(set(values.ravel()) - {""}) or [""]
    counts = np.array([(values == name).sum(axis=-1) for name in names])
    return np.where(counts.sum(axis=0) > 0, np.array(names)[counts.argmax(axis=0)], "")


def draw_sobol_indices(sobol: SobolTable) -> Figure:
    """Draw first-order and total Sobol indices with their confidence intervals."""
    figure = Figure(figsize=(3.9 * len(sobol) + 0.8, 3.4), layout="constrained")
    axes = figure.subplots(1, len(sobol), squeeze=False, sharey=True)[0]
    for ax, (quantity, (names, found)) in zip(axes, sobol.items(), strict=True):
        place = np.arange(len(names))
        for shift, kind, color, label in ((-0.2, "first", "tab:blue", "first order"), (0.2, "total", "0.65", "total")):
            value, low, high = (getattr(found, kind + end) for end in ("", "_low", "_high"))
            error = np.maximum([value - low, high - value], 0)
            ax.barh(place + shift, value, 0.38, xerr=error, color=color, error_kw={"linewidth": 1}, label=label)
        ax.set_yticks(place, [name.replace("_", " ") for name in names])
        ax.set_xlabel("share of the variance [-]")
        ax.set_title(f"{SWEEP_POINT[quantity].term} ({found.rows} rows)", fontsize=10)
        ax.axvline(0, color="0.6", linewidth=0.8)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].invert_yaxis()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    return figure
