"""Forming process in a directory: process.json, tables of strokes and lifts, figures, fields over strokes; its digest.

By columns every answer says two things: the load is a lower estimate, and the confined floor is not for sizing.
"""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from compact.analysis.process import ProcessStudy
from compact.engines.process.lifts import LumpedLift
from compact.engines.process.roller_row import RollerRow
from compact.files import write_figure, write_json, write_vtu_series
from compact.quantities import PROCESS, PROCESS_LIFTS, STROKE, Quantity, column_names
from compact.report.figures import PALETTE, panels
from compact.report.tables import TableSpec, format_percent, format_quantity, json_number, json_numbers, json_values
from compact.report.text import say, sentences

FORCES = {  # estimates by lumped lifts -> term
    "load": "load on one roller, drained", "resistance": "resistance of one roller, drained",
    "air_load": "load by pore air", "air_resistance": "resistance by pore air",
}  # fmt: skip
ROUNDING = 1e-6  # [-], of the product; less mix is rounding
CAUSE_WIDTH = 62  # [characters]
SECTION_COLOURS = "cividis_r"  # loose mix is light, dense mix is dark
PRODUCT_SHARE = 0.3  # [-], length of the product shown behind the roller, and half of that ahead, over the roller
MINUTE = 60.0  # [s]


def write_process(study: ProcessStudy, directory: Path) -> list[Path]:
    """Write tables, figures, fields and summary of a forming process.

    Parameters
    ----------
    directory : Path
        Existing directory.

    Returns
    -------
    list of Path
        Files written.
    """
    row, names, values = study.row, " ".join(column_names(STROKE)), list(stroke_columns(study).values())
    files = [write_figure(directory / "section.png", draw_section(study))]
    if row.lifts is not None:
        names += " load_by_lifts_N/m resistance_by_lifts_N/m"
        values += [row.of_strokes(name) for name in ("load", "resistance")]
        lifts = [(sequence.increments, lift) for sequence in row.lifts.sequences for lift in sequence.lifts]
        numbers = [each.name for each in fields(LumpedLift) if each.name not in ("rows", "mesh")]
        table = TableSpec.of("lifts", lifts, " ".join(["increments=0", *(f"{name}=1.{name}" for name in numbers)]))
        meshes = enumerate((lift.mesh for lift in row.thinnest.lifts), start=1)
        frames = [(float(number), mesh) for number, mesh in meshes if mesh is not None]
        files += [table.write(directory / "lifts.csv"), write_figure(directory / "lifts.png", draw_lifts(row))]
        files += write_vtu_series(directory / "lifts.pvd", "lifts", "lift", frames)
    files.append(TableSpec.of_arrays("strokes", names, values).write(directory / "strokes.csv"))
    files += write_vtu_series(directory / "fields.pvd", "fields", "strokes", row.frames())
    return [*files, write_json(directory / "process.json", process_summary(study))]


def stroke_columns(study: ProcessStudy) -> dict[str, Any]:
    """Return the columns of strokes.csv by the names of STROKE."""
    history, edges = study.history, study.problem.machine.edges
    return {name: (edges[:-1] + edges[1:]) / 2 if name == "position" else getattr(history, name) for name in STROKE}


def process_summary(study: ProcessStudy) -> dict[str, Any]:
    """Return the results for process.json: numbers with units, and sentences."""
    row, by_lifts = study.row, dict[str, Any]()
    if row.lifts is not None:
        by_lifts = {
            name: json_number(each.value, "N") | json_values(each, "error lumping_error mesh_error extrapolated_share")
            for name, each in ((name, row.estimate(name)) for name in FORCES)
        }
        by_lifts |= {"air_is_counted": study.counts_air} | _with_units(row.numbers_by_lifts, PROCESS_LIFTS)
        by_lifts["sequences"] = [
            json_numbers(each, "thickness_m") | json_values(each, "increments stopped") | {"lifts": len(each.lifts)}
            for each in row.lifts.sequences
        ]
    unit = "kg" if study.problem.machine.strokes is None else "m"
    return {
        "model": say("process_model", study),
        "rollers": study.scene.machine.rollers,
        "per_roller": _with_units(row.numbers, PROCESS),
        "mix_per_stroke": {name: json_number(value, unit) for name, value in study.mix_balance.items()},
        "parts": [
            json_values(part, "cause origin test") | json_numbers(part, "force_N low_N high_N work_J/m3")
            for part in study.parts
        ],
        "two_dimensions": by_lifts or None,
        "remarks": sentences("process_remarks", study),
    }


def _with_units(numbers: dict[str, float], known: dict[str, Quantity]) -> dict[str, Any]:
    return {name: json_number(value, known[name].unit) for name, value in numbers.items()}


def process_digest(study: ProcessStudy) -> str:
    """Return the results as lines of text."""
    row, rollers, lines = study.row, study.scene.machine.rollers, [say("process_model", study)]
    if row.lifts is not None:
        lines += ["", "one roller, two dimensions"]
        for name, term in FORCES.items():
            words, found = ", not counted" if "air" in name and not study.counts_air else "", row.estimate(name)
            lines.append(f"{_line(f'{term}{words}', format_quantity(found.value, 'N'))}  ± {found.error:.0%}")
        lines += _number_lines(row.numbers_by_lifts, PROCESS_LIFTS)
    lines += ["", "one roller, columns", *_number_lines(row.numbers, PROCESS), "", *_flow_lines(study)]
    lines += ["", f"force that moves one cart with {rollers} rollers"]
    for part in study.parts:
        force = "not computed" if part.force is None else format_quantity(part.force, "N")
        work = "" if part.work is None else f"{part.work / 1e3:8.3g} kJ/m³"
        ends = [format_quantity(e, "N") for e in (part.low, part.high) if e is not None and part.low != part.high]
        words = f" ({' to '.join(ends)})" if ends else ""
        lines.append(f"{_line(part.cause, force)}{work}  {part.origin}{words}; {part.test}")
    return "\n".join([*lines, "", *(f"note: {remark}" for remark in sentences("process_remarks", study))]).rstrip()


def _line(words: str, text: str) -> str:
    return f"  {words:<{CAUSE_WIDTH}}{text:>14}"


def _number_lines(numbers: dict[str, float], known: dict[str, Quantity]) -> Iterator[str]:
    for name, value in numbers.items():
        yield _line(known[name].term, format_quantity(value, known[name].unit))


def _flow_lines(study: ProcessStudy) -> Iterator[str]:
    """Yield the balance of the mix: masses per stroke, or heights of grains of a mould at rest."""
    balance, at_rest = study.mix_balance, study.problem.machine.strokes is not None
    terms = {
        "product": "product", "fill": "loose fill of the mould", "fed": "fed before the strokes",
        "extruded": "extruded towards the empty mould", "retained": "offered, left in the sleeves",
        "missing": "missing to the required density",
    }  # fmt: skip
    yield "mix, height of its grains" if at_rest else f"mix per stroke, on {study.covered_width:.4g} m of width"
    for name, value in balance.items():
        if value > ROUNDING * balance["product"]:
            yield _line(terms[name], format_quantity(value, "m" if at_rest else "kg"))


def draw_section(study: ProcessStudy) -> Figure:
    """Draw the section along the roller with the density in colour, and load, resistance and density of the strokes."""
    row, machine, fill = study.row, study.problem.machine, study.problem.fill
    length, fed, states = machine.roller_length, study.history.make_up, study.history.states
    figure, axes = panels(4, 1, (9.0, 1.3), (0.0, 0.25), "x", bottom=0.6, top=0.9)
    section, *below = axes[:, 0]
    ends = zip(row.edges[:-1], row.edges[1:], range(1, len(states)), states[1:], strict=True)
    pieces = [each for each in ends if each[1] > each[0]]
    if machine.strokes is None:
        pieces = [(-PRODUCT_SHARE / 2 * length, 0.0, 0, states[0]), *pieces]
        pieces.append((length, (1 + PRODUCT_SHARE) * length, len(states) - 1, states[-1]))
    corners, (ratios, *_) = row.rectangles(pieces)
    norm = Normalize(min(fill.density_ratio, study.problem.feed.density_ratio), 1.0)
    colours = colormaps[SECTION_COLOURS](norm(ratios))
    section.add_collection(
        PolyCollection(list(corners * [1.0, 1e3]), facecolors=colours, edgecolors=colours, linewidths=0.2)
    )
    section.plot([0.0, length], [machine.height * 1e3] * 2, color="black", linewidth=3, label="roller")
    section.set(xlim=(pieces[0][0], pieces[-1][1]), ylim=(0.0, 1.25e3 * machine.height), ylabel="height y\n[mm]")
    section.legend(frameon=False, loc="upper right")
    moved = f"moves at {machine.mould_speed * MINUTE:.3g} m/min →" if machine.strokes is None else "at rest"
    make_up = f"{fed[fed > 0].min() * 1e3:.2g} to {fed.max() * 1e3:.2g} mm" if fed.any() else "nothing"
    words = f"{machine.strokes_on_section:.3g} strokes on a section, mould {moved}, fed before each: {make_up}"
    section.set_title(words, fontsize=10, loc="right")
    width, total = figure.get_size_inches()
    bar = figure.add_axes((0.8 / width, 1 - 0.55 / total, 2.4 / width, 0.14 / total))
    figure.colorbar(ScalarMappable(norm, colormaps[SECTION_COLOURS]), cax=bar, orientation="horizontal", extend="max")
    bar.set_title("density ratio k", fontsize=9, loc="left")
    load, resistance = (row.of_strokes(name) for name in ("load", "resistance"))
    for ax, values, color, label in zip(
        below, (load / 1e3, resistance / 1e3, study.history.density_ratio), (PALETTE[0], "0.2", PALETTE[2]),
        ("load P\n[kN/m]", "resistance F\n[kN/m]", "mean density\nratio k [-]"), strict=True,
    ):  # fmt: skip
        force = ax is not below[-1]
        ax.stairs(values, row.edges, baseline=0 if force else None, color=color, fill=force, alpha=0.5 if force else 1)
        ax.set(ylabel=label, ylim=(0, None) if force else None)
    centre = row.centre_of(load)
    below[0].axvline(centre, color=PALETTE[1], linestyle="--", label=f"centre, {format_percent(centre / length)} of L")
    below[2].axhline(row.required_density_ratio, color="0.4", linestyle=":", label="required")
    for ax in (below[0], below[2]):
        ax.legend(frameon=False, fontsize=9, loc="upper left")
    below[2].set_xlabel(STROKE["position"].axis_label)
    return figure


def draw_lifts(row: RollerRow) -> Figure:
    """Draw load, resistance over the make-up, and density at bottom and top of lumped lifts over the mean density."""
    assert row.lifts is not None
    figure, ((loads, forces, ratios),) = panels(1, 3, (3.6, 2.9), (0.85, 0.3), top=0.3)
    for sequence, colour in zip(row.lifts.sequences, PALETTE, strict=False):
        ratio = sequence.values("density_ratio")
        label = f"lifts of {sequence.thickness * 1e3:.2g} mm, {sequence.increments} elements"
        style: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 3}
        loads.plot(ratio, sequence.values("load") / 1e3, label=label, **style)
        middle = (ratio + sequence.values("density_before")) / 2
        forces.plot(middle, sequence.values("resistance") / sequence.thickness / 1e3, **style)
    thinnest, history, fed = row.thinnest, row.history, row.history.make_up > 0
    dashed: dict[str, Any] = {"color": "0.4", "linestyle": "--"}
    loads.plot(history.density_ratio, history.load / 1e3, label="columns, single strokes", **dashed)
    forces.plot(history.density_ratio[fed], history.resistance[fed] / history.make_up[fed] / 1e3, **dashed)
    ratio = thinnest.values("density_ratio")
    ratios.plot(ratio, thinnest.values("top_density_ratio"), color=PALETTE[1], label="top quarter")
    ratios.plot(ratio, ratio, label="mean", **dashed)
    ratios.plot(ratio, thinnest.values("bottom_density_ratio"), color=PALETTE[0], label="bottom quarter")
    ratios.axhline(1.0, color="0.4", linestyle=":", label="no pores")
    labels = ("load P [kN/m]", "resistance over make-up, F/t [kPa]", "density ratio behind the roller [-]")
    for ax, label in zip((loads, forces, ratios), labels, strict=True):
        ax.set(xlabel="mean density ratio k [-]", ylabel=label)
    for ax in (loads, ratios):
        ax.legend(frameon=False, fontsize=8)
    for ax in (loads, forces):
        ax.set_ylim(0, None)
    return figure
