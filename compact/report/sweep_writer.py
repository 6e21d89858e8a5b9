"""What `compact sweep` leaves behind beside sweep.nc, and what it says: figures, Sobol indices, grouped reasons."""

import re
from collections import Counter

import numpy as np

from compact.files import write_csv, write_figure
from compact.quantities import SWEEP_POINT, unit_symbol
from compact.sweep.sobol_indices import of_table

SHOWN = 6  # reasons on the screen
TOLD = ("load", "resistance", "resistance_coefficient", "power", "capture_angle", "exit_density_ratio")
EXPLAINED = ("load", "resistance", "resistance_coefficient", "capture_angle")  # by Sobol indices
INDEX_HEADER = ("quantity", "input", "first", "first_low", "first_high", "total", "total_low", "total_high", "rows")


def write_sweep_report(directory, table):
    """Figures and Sobol indices of a table of a sweep, as far as it has what they need."""
    from compact.report import sweep_figures

    if explained := _explained(table):
        write_csv(directory / "sobol.csv", INDEX_HEADER, list(_index_rows(table, explained)))
        write_figure(directory / "sobol.png", sweep_figures.sobol_bars(table, explained))
    if not sweep_figures.drawn(table):
        return
    axes = sweep_figures.numeric_axes(table)
    if len(axes) >= 2:
        write_figure(directory / "maps.png", sweep_figures.maps(table))
    if axes:
        write_figure(directory / "bands.png", sweep_figures.bands(table))
    if len(axes) >= 2 and any(name.startswith("best_law_by_") for name in table):
        write_figure(directory / "best_laws.png", sweep_figures.best_laws(table))


def _explained(table):
    """Quantities of which a sample without other axes tells indices."""
    if table["load"].dims != ("sample",) or set(table["part"].values) == {"A"}:
        return ()
    enough = [name for name in EXPLAINED if np.isfinite(table[name].values).any()]
    return tuple(name for name in enough if _has_indices(table, name))


def _has_indices(table, name):
    try:
        of_table(table, name)
    except ValueError:  # too few rows without a failure
        return False
    return True


def _index_rows(table, quantities):
    for quantity in quantities:
        names, found = of_table(table, quantity)
        columns = (
            found.first, found.first_low, found.first_high, found.total, found.total_low, found.total_high,
        )  # fmt: skip
        for name, values in zip(names, np.array(columns).T.tolist(), strict=True):
            yield (quantity, name, *values, found.rows)


def sweep_digest(table):
    """What a person wants to read: how many points have numbers, their range, and why the others have none."""
    failed = (table["reason"] != "").values
    lines = [f"{failed.size} points by {table.attrs['engine']}, {failed.sum()} without numbers"]
    for name in TOLD:
        values = table[name].values
        values = values[np.isfinite(values)]
        if values.size:
            unit = unit_symbol(SWEEP_POINT[name].unit)
            low, middle, high = np.quantile(values, [0, 0.5, 1])
            lines.append(f"  {name:<24}{low:>10.4g} to {high:<10.4g} {unit:<4} median {middle:.4g}")
    beyond = (table["not_reachable"] != "").values.sum()
    if beyond:
        lines.append(f"  not reachable by rolling: {beyond} points, as not_reachable says")
    for name, words in (("reason", "without numbers"), ("warnings", "warned"), ("replaced", "replaced")):
        lines += [f"  {words}: {said}" for said in _grouped(table[name].values.ravel())]
    for quantity in _explained(table):
        names, found = of_table(table, quantity)
        shares = zip(names, found.first, found.first_low, found.first_high, strict=True)
        said = ", ".join(f"{name} {share:.2f} ({low:.2f} to {high:.2f})" for name, share, low, high in shares)
        lines.append(f"  variance of {quantity}, first order: {said}")
    return "\n".join(lines)


def _grouped(sentences):
    """How often each sentence is told, numbers in it apart; the most frequent ones."""
    groups, first = Counter(), {}
    for sentence in filter(None, sentences):
        kind = re.sub(r"\d[\d.e+-]*", "#", sentence)
        groups[kind] += 1
        first.setdefault(kind, sentence)
    said = [f"{count} x {first[kind]}" for kind, count in groups.most_common(SHOWN)]
    rest = sum(groups.values()) - sum(count for _, count in groups.most_common(SHOWN))
    return [*said, f"{rest} x for other reasons"] if rest else said
