"""Forming process in a directory: process.json, tables of strokes and map, figures, fields over strokes; its digest.

By columns every answer says two things: the load is a lower estimate, and the confined floor is not for sizing.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from compact.analysis.process import ProcessStudy
from compact.engines.process.lifts import TwoDimensionalRow, process_frames, section_rows
from compact.files import write_figure, write_json, write_vtu_series
from compact.quantities import PROCESS, STROKE, column_names
from compact.report.figures import PALETTE, label_contours, panels
from compact.report.tables import (
    TableSpec,
    columns,
    format_percent,
    format_quantity,
    json_number,
    json_numbers,
    write_arrays,
)
from compact.report.text import say

if TYPE_CHECKING:
    import meshio

MAP = "mould_speed_m/s cart_speed_m/s strokes load_N resistance_N"
LIFT = (
    "increments=0 thickness=1.thickness bite=1.bite load=1.load resistance=1.resistance load_error=1.load_error "
    "resistance_error=1.resistance_error density_ratio=1.density_ratio bottom_density_ratio=1.bottom_density_ratio "
    "top_density_ratio=1.top_density_ratio overpressed_height=1.overpressed_height surface=1.surface "
    "peak_pressure=1.peak_pressure work_residual=1.work_residual mass_residual=1.mass_residual air_load=1.air_load "
    "air_resistance=1.air_resistance air_excess_behind=1.air_excess_behind"
)
GRAINS = ("product", "fill", "fed", "extruded", "retained", "missing")  # parts of the balance of the mix
ROUNDING = 1e-6  # [-], of the product; less mix is rounding
CAUSE_WIDTH = 62  # [characters]
SECTION_COLOURS = "cividis_r"  # loose mix is light, dense mix is dark
SLOPE_ANGLE = 35.0  # [deg], of the loose mix at the empty mould, as drawn
PRODUCT_SHARE = 0.3  # [-], length of the product shown behind the roller over that of the roller
DECORATION_SHARE = 0.17  # [-], of the roller length, least height to which words and arrows are in proportion
SECTION_WIDTH = 10.0  # [inch]
PANEL_HEIGHT = 1.25  # [inch], of load, resistance and density along the roller
HEADROOM = 1.1  # [-], of an axis over the largest value
STEEL: dict[str, Any] = {"facecolor": "0.88", "edgecolor": "0.35"}
CENTRED: dict[str, Any] = {"ha": "center", "va": "center"}
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
    found, names, values = study.two_dimensions, " ".join(column_names(STROKE)), list(stroke_columns(study).values())
    if found is not None:
        names += " load_by_lifts_N/m resistance_by_lifts_N/m"
        values += [study.forces.of_strokes(name) for name in ("load", "resistance")]
    files = [
        write_arrays(directory / "strokes.csv", names, values),
        write_figure(directory / "section.png", draw_section(study)),
        write_figure(directory / "strokes.png", draw_strokes(study)),
    ]
    if (over := study.map) is not None:
        speeds = np.meshgrid(over.mould_speeds, over.cart_speeds)
        grid = [each.ravel() for each in (*speeds, over.strokes, over.load, over.resistance)]
        files.append(write_arrays(directory / "map.csv", MAP, grid))
        files.append(write_figure(directory / "map.png", draw_map(study)))
    if found is not None:
        lifts = [(sequence.increments, lift) for sequence in found.sequences for lift in sequence.lifts]
        meshes = enumerate((lift.mesh for lift in found.lumpings[0].lifts), start=1)  # of the thinnest lifts
        frames: list[tuple[float, meshio.Mesh]] = [(float(number), mesh) for number, mesh in meshes if mesh is not None]
        files.append(TableSpec.of("lifts", lifts, LIFT).write(directory / "lifts.csv"))
        files.append(write_figure(directory / "lifts.png", draw_lifts(found)))
        files += write_vtu_series(directory / "lifts.pvd", "lifts", "lift", frames)
    strokes = process_frames(study.row, None if found is None else found.lumpings[0])
    files += write_vtu_series(directory / "fields.pvd", "fields", "strokes", strokes)
    write_json(directory / "process.json", process_summary(study))
    return [*files, directory / "process.json"]


def process_numbers(study: ProcessStudy) -> Mapping[str, float | None]:
    """Return the results of one roller by the names of PROCESS."""
    row, machine, history = study.row, study.problem.machine, study.row.history
    own = {
        "strokes": machine.strokes_on_section,
        "largest_bite": float(history.bite.max()),
        "bite_limit": machine.max_bite,
        "fastest_mould": study.fastest_mould,
        "least_strokes": study.curve.least_strokes if study.curve else None,
        "rate_factor": history.rate_factor,
        "mass_residual": history.mass_residual,
        "work_residual": history.work_residual,
    }
    return {name: own[name] if name in own else getattr(row, name) for name in PROCESS}


def stroke_columns(study: ProcessStudy) -> dict[str, Any]:
    """Return the columns of strokes.csv by the names of STROKE."""
    history, edges = study.row.history, study.problem.machine.edges
    return {name: (edges[:-1] + edges[1:]) / 2 if name == "position" else getattr(history, name) for name in STROKE}


def process_summary(study: ProcessStudy) -> dict[str, Any]:
    """Return the results for process.json: numbers with units, and sentences."""
    flow = study.row.flow
    return {
        "model": _statement(study),
        "rollers": study.scene.machine.rollers,
        "per_roller": {name: json_number(value, PROCESS[name].unit) for name, value in process_numbers(study).items()},
        "mix_per_stroke": {name: json_number(study.mass_per_stroke(getattr(flow, name)), "kg") for name in GRAINS},
        "grains_of_a_section": {name: json_number(getattr(flow, name), "m") for name in GRAINS},
        "parts": [{"cause": part.cause} | json_numbers(part, "force_N work_J/m3") for part in study.parts],
        "printed": [
            {"name": each.name}
            | json_numbers(each, "printed_N computed_N")
            | {"causes": [{"cause": cause, "force": json_number(force, "N")} for cause, force in each.causes]}
            for each in study.printed
        ],
        "two_dimensions": _two_dimensional_summary(study),
        "remarks": list(study.remarks),
    }


def _two_dimensional_summary(study: ProcessStudy) -> dict[str, Any] | None:
    """Return the results in two dimensions for process.json; None without them."""
    found = study.two_dimensions
    if found is None:
        return None
    errors = ("error", "lumping_error", "mesh_error", "extrapolated_share")
    product = columns("bottom_density_ratio top_density_ratio overpressed_height surface")
    return {
        **{
            name: json_number(each.value, "N") | {error: getattr(each, error) for error in errors}
            for name in ("load", "resistance", "air_load", "air_resistance")
            for each in [getattr(found, name)]
        },
        "air_is_counted": study.counts_air,
        **json_numbers(found, "air_excess_behind_Pa load_centre_m skew_moment_Nm specific_work_J/m3"),
        **{name: json_number(found.of_product(name), "1" if "ratio" in name else "m") for name in product},
        "strip_stress_ratio": json_number(found.strip_stress_ratio(), "1"),
        "largest_work_residual": _largest_residual(found),
        "sequences": [
            json_numbers(each, "thickness_m")
            | {"increments": each.increments, "lifts": len(each.lifts), "stopped": each.stopped}
            for each in found.sequences
        ],
    }


def _largest_residual(found: TwoDimensionalRow) -> float:
    return max(sequence.largest_work_residual for sequence in found.sequences)


def _statement(study: ProcessStudy) -> str:
    air = study.scene.mix.pore_air if study.counts_air else ""
    return say("process_model", study.two_dimensions is not None, air)


def process_digest(study: ProcessStudy) -> str:
    """Return the results as lines of text."""
    length, rollers = study.scene.machine.roller_length, study.scene.machine.rollers
    lines = [_statement(study), *_two_dimensional_lines(study), "", "one roller, columns"]
    for name, value in process_numbers(study).items():
        if value is not None:
            share = f" ({format_percent(value / length)} of the roller length)" if name == "load_centre" else ""
            lines.append(_line(PROCESS[name].term, format_quantity(value, PROCESS[name].unit) + share))
    lines += ["", *_flow_lines(study), "", f"force that moves one cart with {rollers} rollers"]
    for part in study.parts:
        force = "not computed" if part.force is None else format_quantity(part.force, "N")
        work = "" if part.work is None else f"{part.work / 1e3:10.4g} kJ/m³ of product"
        lines.append(f"{_line(part.cause, force)}{work}")
    given = study.mix.parameter("heckel_slope").flag == "given"
    words = "not fitted" + ("" if given else ", but the Heckel slope of the prior passes through the published point")
    for each in study.printed:
        lines += ["", f"printed: {each.name} {each.printed:.0f} N, computed {each.computed:.0f} N; {words}"]
        lines += [f"{_line(cause, f'{force:.0f} N')}{force / each.printed:10.0%}" for cause, force in each.causes]
    if study.remarks:
        lines += ["", *(f"note: {remark}" for remark in study.remarks)]
    return "\n".join(lines)


def _line(words: str, text: str) -> str:
    return f"  {words:<{CAUSE_WIDTH}}{text:>14}"


def _two_dimensional_lines(study: ProcessStudy) -> Iterator[str]:
    """Yield the results in two dimensions."""
    found, length = study.two_dimensions, study.scene.machine.roller_length
    if found is None:
        return
    part = "" if study.counts_air else ", not counted"
    yield from ("", "one roller, two dimensions")
    for term, each in (
        ("load on one roller, drained", found.load), ("resistance of one roller, drained", found.resistance),
        (f"load by pore air{part}", found.air_load), (f"resistance by pore air{part}", found.air_resistance),
    ):  # fmt: skip
        yield f"{_line(term, format_quantity(each.value, 'N'))}  ± {each.error:.0%}"
    for term, text in (
        ("centre of the load, of the roller length", format_percent(found.load_centre / length)),
        ("skew moment of the load", format_quantity(found.skew_moment, "Nm")),
        ("work per volume of the product", f"{found.specific_work / 1e3:.4g} kJ/m³"),
        ("density ratio of the bottom quarter", f"{found.of_product('bottom_density_ratio'):.3f}"),
        ("density ratio of the top quarter", f"{found.of_product('top_density_ratio'):.3f}"),
        ("height with a density ratio above 1", format_quantity(found.of_product("overpressed_height"), "m")),
        ("stress at the bottom over 2 P/(pi h0), 1 to 1.5 expected", f"{found.strip_stress_ratio():.2f}"),
        ("largest residual of the energy balance of a pass", f"{_largest_residual(found):.1%}"),
    ):
        yield _line(term, text)


def _flow_lines(study: ProcessStudy) -> Iterator[str]:
    """Yield the balance of the mix: masses per stroke, or heights of grains of a mould at rest."""
    flow, at_rest = study.row.flow, study.problem.machine.strokes is not None
    filled = "filled by the first sleeve" if study.problem.fill.by_sleeve else "carried in by the mould"
    terms = (
        "product", filled, "fed before the strokes", "extruded towards the empty mould", "offered, left in the sleeves",
        "missing to the required density",
    )  # fmt: skip
    yield "mix, height of its grains" if at_rest else f"mix per stroke, on {study.covered_width:.4g} m of width"
    for term, name in zip(terms, GRAINS, strict=True):
        grains = getattr(flow, name)
        if grains > ROUNDING * flow.product:
            mass = grains if at_rest else study.mass_per_stroke(grains)
            yield _line(term, format_quantity(mass, "m" if at_rest else "kg"))


def draw_section(study: ProcessStudy) -> Figure:
    """Draw the section through mould and roller with the density in colour, and load, resistance and density."""
    row, machine, length = study.row, study.problem.machine, study.problem.machine.roller_length
    slope = study.problem.fill.height / np.tan(np.radians(SLOPE_ANGLE))
    span = (-slope - 0.12 * length, (1 + PRODUCT_SHARE) * length)
    unit = max(machine.height, DECORATION_SHARE * length)  # of words and arrows, readable above a thin product too
    low, high = -0.32 * unit, machine.height + 2 * machine.roller_radius + 0.5 * unit
    tall = (high - low) * SECTION_WIDTH / (span[1] - span[0])  # to scale
    heights = np.array([tall, *(PANEL_HEIGHT,) * 3])
    figure, axes = panels(
        4,
        1,
        (SECTION_WIDTH, heights.mean()),
        bottom=0.6,
        top=0.85,
        gaps=(0.0, 0.25),
        height_ratios=heights,
        sharex=True,
    )
    section, *below = axes[:, 0]
    norm = Normalize(min(study.problem.fill.density_ratio, study.problem.feed.density_ratio), 1.0)
    _draw_mix(section, study, norm, slope)
    _draw_machine(section, study, span, slope, unit)
    section.set(xlim=span, ylim=(low, high))
    section.axis("off")
    width, total = figure.get_size_inches()
    bar = figure.add_axes((0.8 / width, 1 - 0.55 / total, 3.2 / width, 0.16 / total))
    beyond: Literal["max", "neither"] = "neither" if study.two_dimensions is None else "max"
    colours = ScalarMappable(norm, colormaps[SECTION_COLOURS])
    figure.colorbar(colours, cax=bar, orientation="horizontal", extend=beyond)
    bar.set_title("density ratio k: left loose, right without pores", fontsize=9, loc="left")
    load, resistance = (study.forces.of_strokes(name) for name in ("load", "resistance"))
    for ax, values, color, label in zip(
        below, (load / 1e3, resistance, row.history.density_ratio), (PALETTE[0], "0.2", PALETTE[2]),
        ("load P\n[kN/m]", "resistance F\n[N/m]", "mean density\nratio k [-]"), strict=True,
    ):  # fmt: skip
        force = ax is not below[-1]
        ax.stairs(values, row.edges, baseline=0 if force else None, color=color, fill=force, alpha=0.5 if force else 1)
        ax.set(ylabel=label, ylim=(0, None) if force else None)
    centre, required = row.centre_of(load), row.required_density_ratio
    below[0].axvline(centre, color=PALETTE[1], linestyle="--")
    below[0].text(
        centre - 0.01 * length, 0.9, f"centre of the load, {centre / length:.0%} of the roller", color=PALETTE[1],
        transform=below[0].get_xaxis_transform(), ha="right", va="top", fontsize=9,
    )  # fmt: skip
    below[2].axhline(required, color="0.4", linestyle=":")
    below[2].text(span[0], required, " required", color="0.3", va="top", fontsize=9)
    below[2].set_xlabel(STROKE["position"].axis_label)
    return figure


def _draw_mix(ax: Axes, study: ProcessStudy, norm: Normalize, slope: float) -> None:
    """Draw the slope of loose mix, every section under the roller, and the product."""
    row, fill, found = study.row, study.problem.fill, study.two_dimensions
    states, edges, length = row.history.states, row.edges, study.problem.machine.roller_length
    pieces = [each for each in zip(edges[:-1], edges[1:], states[1:], strict=True) if each[1] > each[0]]
    if study.problem.machine.strokes is None:
        pieces.append((length, (1 + PRODUCT_SHARE) * length, states[-1]))
    outlines, ratios = [[(-slope, 0.0), (0.0, 0.0), (0.0, fill.height)]], [fill.density_ratio]
    for low, high, state in pieces:
        bottom = 0.0
        for height, ratio, _ in section_rows(state, None if found is None else found.lumpings[0]):
            outlines.append([(low, bottom), (high, bottom), (high, bottom + height), (low, bottom + height)])
            ratios.append(ratio)
            bottom += height
    colours = colormaps[SECTION_COLOURS](norm(ratios))
    ax.add_collection(PolyCollection(outlines, facecolors=colours, edgecolors=colours, linewidths=0.2))


def _draw_machine(ax: Axes, study: ProcessStudy, span: tuple[float, float], slope: float, unit: float) -> None:
    """Draw mould and roller with their words."""
    machine, row, fed = study.problem.machine, study.row, study.row.history.make_up
    h, R, L = machine.height, machine.roller_radius, machine.roller_length
    ax.add_patch(Rectangle((span[0], -0.12 * unit), span[1] - span[0], 0.12 * unit, **STEEL))
    ax.add_patch(Rectangle((0, h), L, 2 * R, **STEEL))
    make_up = f"{fed[fed > 0].min() * 1e3:.2g} to {fed.max() * 1e3:.2g} mm" if fed.any() else "none"
    moved, product = "mould at rest", ""
    if machine.strokes is None:
        moved = f"mould moves at {machine.mould_speed * MINUTE:.3g} m/min →, {machine.advance * 1e3:.3g} mm per stroke"
        product = f"product\n{row.product_height * 1e3:.1f} mm\nk = {row.product_density_ratio:.3f}"
    roller = f"roller, {L:.3g} m long, rolls across the picture\nat {machine.cart_speed:.3g} m/s"
    for x, y, words, style in (
        (span[0] + 0.01 * L, -0.06 * unit, "mould", {"fontsize": 8, "va": "center"}),
        (L / 2, h + 1.45 * R, roller, CENTRED),
        (L / 2, h + 0.5 * R, f"{machine.strokes_on_section:.3g} strokes on every section", CENTRED),
        (L, h + 2 * R + 0.1 * unit, f"↓ mix fed before each stroke: {make_up}", {"ha": "right", "color": PALETTE[1]}),
        (-slope, h / 2 + 0.05 * unit, "loose mix\nslides in", {"ha": "center", "fontsize": 9}),
        (L + PRODUCT_SHARE * L / 2, h + 0.08 * unit, product, {"ha": "center"}),
        (L / 2, -0.22 * unit, moved, CENTRED | {"color": PALETTE[1]}),
    ):
        ax.text(x, y, words, **style)


def draw_strokes(study: ProcessStudy) -> Figure:
    """Draw bite, make-up, peak pressure and density of the strokes on one section."""
    history, machine = study.row.history, study.problem.machine
    figure, ((heights, pressures, ratios),) = panels(1, 3, (3.6, 2.7), gaps=(0.85, 0.3), top=0.3)
    number = np.arange(1, history.count + 1)
    style: dict[str, Any] = {"where": "mid"} | ({} if history.count > 1 else {"marker": "o"})
    heights.step(number, history.bite * 1e3, color=PALETTE[0], label="bite: surface above the generatrix", **style)
    heights.step(number, history.make_up * 1e3, color=PALETTE[1], label="make-up: mix fed", **style)
    if HEADROOM * history.bite.max() > machine.max_bite:
        heights.axhline(machine.max_bite * 1e3, color="0.4", linestyle=":", label="bite at the nip angle")
    heights.set(ylabel="height [mm]", ylim=(0, HEADROOM * 1e3 * history.bite.max()))
    pressures.step(number, history.peak_pressure / 1e3, color=PALETTE[0], **style)
    pressures.set(ylabel=STROKE["peak_pressure"].axis_label, ylim=(0, None))
    ratios.plot([0, *number], [history.states[0].density_ratio, *history.density_ratio], color=PALETTE[2])
    ratios.axhline(study.row.required_density_ratio, color="0.4", linestyle=":", label="required")
    ratios.set_ylabel("mean density ratio k [-]")
    for ax in (heights, pressures, ratios):
        ax.set_xlabel("stroke on a section")
    heights.legend(frameon=False, fontsize=8)
    ratios.legend(frameon=False, loc="lower right")
    return figure


def draw_lifts(found: TwoDimensionalRow) -> Figure:
    """Draw load, resistance over the make-up, and density at bottom and top of lumped lifts over the mean density."""
    figure, ((loads, forces, ratios),) = panels(1, 3, (3.6, 2.9), gaps=(0.85, 0.3), top=0.3)
    for sequence, colour in zip(found.sequences, PALETTE, strict=False):
        ratio = sequence.values("density_ratio")
        label = f"lifts of {sequence.thickness * 1e3:.2g} mm, {sequence.increments} elements"
        style: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 3}
        loads.plot(ratio, sequence.values("load") / 1e3, label=label, **style)
        middle = (ratio + sequence.values("density_before")) / 2
        forces.plot(middle, sequence.values("resistance") / sequence.thickness / 1e3, **style)
    thinnest, history = found.lumpings[0], found.row.history
    dashed: dict[str, Any] = {"color": "0.4", "linestyle": "--"}
    loads.plot(history.density_ratio, history.load / 1e3, label="columns, single strokes", **dashed)
    fed = history.make_up > 0
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


def draw_map(study: ProcessStudy) -> Figure:
    """Draw load and resistance of one roller at the required density over the speeds of mould and cart."""
    found, machine = study.map, study.problem.machine
    assert found is not None
    figure, axes = panels(1, 2, (4.4, 3.1), gaps=(0.95, 0.3), bottom=0.95, top=0.35)
    x, y = found.mould_speeds * MINUTE, found.cart_speeds
    titles = ("load on one roller [kN], lower estimate", "confined floor of one roller [N], not for sizing")
    for ax, values, title in zip(axes[0], (found.load / 1e3, found.resistance), titles, strict=True):
        shown = np.ma.masked_invalid(values)
        ax.set_facecolor("0.82")
        if shown.count():
            filled = ax.contourf(x, y, shown, 9, cmap="viridis", alpha=0.85)
            label_contours(ax, ax.contour(filled, colors="black", linewidths=0.6))
        point = machine.mould_speed * MINUTE, study.scene.motion.stroke / machine.stroke_period
        ax.plot(*point, "o", color="white", markeredgecolor="black", markersize=7)
        ax.set(xlabel="speed of the mould [m/min]", ylabel="speed of the cart [m/s]", xscale="log", yscale="log")
        ax.set_xticks(x[::8], [f"{speed:.3g}" for speed in x[::8]])
        ax.set_yticks(y[::4], [f"{speed:.3g}" for speed in y[::4]])
        ax.minorticks_off()
        ax.set_title(title, fontsize=10)
    words = (
        f"density ratio {study.row.required_density_ratio:g}; circle: this machine; grey on the right: bite beyond the "
        "nip angle; grey on the left: more strokes than computed"
    )
    figure.legend(handles=[Patch(facecolor="none", label=words)], loc="lower center", frameon=False, fontsize=9)
    return figure
