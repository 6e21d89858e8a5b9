"""Results of a sweep in addition to sweep.nc: figures, Sobol indices, and the digest on the terminal."""

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.files import write_csv, write_figure
from compact.quantities import SWEEP_POINT, unit_symbol
from compact.sweep.sobol_indices import SobolTable

if TYPE_CHECKING:
    from xarray import Dataset

SHOWN_SENTENCES = 6  # [-], number of different sentences in the digest
DIGEST_QUANTITIES = ("load", "resistance", "resistance_coefficient", "power", "capture_angle", "exit_density_ratio")
SOBOL_HEADER = ("quantity", "input", "first", "first_low", "first_high", "total", "total_low", "total_high", "rows")
SOBOL_FIELDS = SOBOL_HEADER[2:-1]
NONE = (None, None, None)  # range of a quantity without a number
DIGITS = re.compile(r"\d[\d.e+-]*")


def write_sweep_report(directory: Path, table: "Dataset", sobol: SobolTable) -> None:
    """Write the figures and Sobol indices that the axes and numbers of a sweep admit."""
    from compact.report.figures import sweep as sweep_figures

    if sobol:
        write_csv(directory / "sobol.csv", SOBOL_HEADER, [
            (quantity, name, *values, found.rows)
            for quantity, (names, found) in sobol.items()
            for name, *values in zip(names, *(getattr(found, field).tolist() for field in SOBOL_FIELDS), strict=True)
        ])  # fmt: skip
        write_figure(directory / "sobol.png", sweep_figures.draw_sobol_indices(sobol))
    if not sweep_figures.varying_quantities(table):
        return
    axes = sweep_figures.numeric_axes(table)
    if len(axes) >= 2:
        write_figure(directory / "maps.png", sweep_figures.draw_maps(table))
    if axes:
        write_figure(directory / "bands.png", sweep_figures.draw_bands(table))
    if len(axes) >= 2 and any(str(name).startswith("best_law_by_") for name in table):
        write_figure(directory / "best_laws.png", sweep_figures.draw_best_laws(table))


def sweep_digest(table: "Dataset", sobol: SobolTable) -> str:
    """Summarise a sweep: ranges of the quantities, failures, warnings and Sobol indices."""
    failed = (table["reason"] != "").values
    lines = [f"{failed.size} points by {table.attrs['engine']}, {failed.sum()} without numbers"]
    lines += [f"  {sentence}" for sentence in filter(None, table.attrs.get("correction", "").splitlines())]
    for name in DIGEST_QUANTITIES:
        values = table[name].values
        values = values[np.isfinite(values)]
        if values.size:
            unit = unit_symbol(SWEEP_POINT[name].unit)
            low, middle, high = np.quantile(values, [0, 0.5, 1])
            lines.append(f"  {name:<24}{low:>10.4g} to {high:<10.4g} {unit:<4} median {middle:.4g}")
    beyond = (table["not_reachable"] != "").values.sum()
    if beyond:
        lines.append(f"  not reachable by rolling: {beyond} points, reasons in not_reachable")
    for name, words in (("reason", "without numbers"), ("warnings", "warned"), ("replaced", "replaced")):
        lines += [f"  {words}: {sentence}" for sentence in _count_sentences(table[name].values.ravel())]
    for quantity, (names, found) in sobol.items():
        shares = zip(names, found.first, found.first_low, found.first_high, strict=True)
        text = ", ".join(f"{name} {share:.2f} ({low:.2f} to {high:.2f})" for name, share, low, high in shares)
        lines.append(f"  variance of {quantity}, first order: {text}")
    return "\n".join(lines)


def sweep_summary(table: "Dataset", sobol: SobolTable) -> dict[str, Any]:
    """Return counts, ranges of the quantities and Sobol indices of a sweep, for JSON."""
    quantities = {}
    for name in DIGEST_QUANTITIES:
        values = table[name].values
        low, middle, high = np.quantile(values[np.isfinite(values)], [0, 0.5, 1]) if np.isfinite(values).any() else NONE
        quantities[name] = {"low": low, "median": middle, "high": high, "unit": SWEEP_POINT[name].unit}
    first = {quantity: dict(zip(names, found.first, strict=True)) for quantity, (names, found) in sobol.items()}
    return {
        "engine": table.attrs["engine"],
        "without_numbers": (table["reason"] != "").values.sum(),
        "quantities": quantities,
        "sobol_first": first,
    }


def _count_sentences(sentences: Iterable[str]) -> list[str]:
    """Count sentences that differ in numbers only; return the most frequent ones."""
    counts: Counter[str] = Counter()
    examples: dict[str, str] = {}
    for sentence in filter(None, sentences):
        kind = DIGITS.sub("#", sentence)
        counts[kind] += 1
        examples.setdefault(kind, sentence)
    shown = counts.most_common(SHOWN_SENTENCES)
    lines = [f"{count} x {examples[kind]}" for kind, count in shown]
    rest = counts.total() - sum(count for _, count in shown)
    return [*lines, f"{rest} x for other reasons"] if rest else lines
