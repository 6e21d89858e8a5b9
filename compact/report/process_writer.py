"""Forming process in a directory: process.json, tables of strokes and map, figures, fields over strokes; its digest.

By columns every answer says two things: the load is a lower estimate, and the confined floor is not for sizing.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compact.analysis.process import ProcessStudy
from compact.engines.process.fields import process_frames
from compact.engines.process.lifts import TwoDimensionalRow
from compact.files import write_columns, write_csv, write_figure, write_json, write_vtu_series
from compact.quantities import PROCESS, STROKE, column_names
from compact.report.figures.process import draw_lifts, draw_map, draw_section, draw_strokes
from compact.report.tables import format_percent, format_quantity, json_number

if TYPE_CHECKING:
    import meshio

MAP_HEADER = ("mould_speed_m/s", "cart_speed_m/s", "strokes", "load_N", "resistance_N")
PRODUCT_FIELDS = {"bottom_density_ratio": "1", "top_density_ratio": "1", "overpressed_height": "m", "surface": "m"}
LIFTED_HEADER = ("load_by_lifts_N/m", "resistance_by_lifts_N/m")
ROUNDING = 1e-6  # [-], of the product; less mix is rounding
CAUSE_WIDTH = 62  # [characters]
NOT_FITTED = "not fitted"
HALF_FITTED = "not fitted, but the Heckel slope of the prior passes through the published point"
COLUMNS_STATEMENT = (
    "confined columns: the load is a lower estimate, the resistance is the confined floor and not for sizing; shear "
    "and the density over the height need two dimensions"
)
LIFTS_STATEMENT = (
    "lumped lifts in two dimensions, {}: load and resistance with the errors of lumping and mesh, without that of the "
    "law of the mix; strokes and map by columns, drained"
)
STRIP_FACTORS = (1.0, 1.5)  # [-], of the stress on a rigid base over 2 P/(pi h0), of a half-plane and on a base
LIFT_NAMES = (
    "thickness", "bite", "load", "resistance", "load_error", "resistance_error", "density_ratio",
    "bottom_density_ratio", "top_density_ratio", "overpressed_height", "surface", "peak_pressure",
    "work_residual", "mass_residual", "air_load", "air_resistance", "air_excess_behind",
)  # fmt: skip


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
    files = [
        write_columns(directory / "strokes.csv", *_stroke_table(study)),
        write_figure(directory / "section.png", draw_section(study)),
        write_figure(directory / "strokes.png", draw_strokes(study)),
    ]
    if study.map is not None:
        files.append(write_csv(directory / "map.csv", MAP_HEADER, _map_rows(study)))
        files.append(write_figure(directory / "map.png", draw_map(study)))
    if study.two_dimensions is not None:
        files.append(write_csv(directory / "lifts.csv", ("increments", *LIFT_NAMES), _lift_rows(study)))
        files.append(write_figure(directory / "lifts.png", draw_lifts(study.two_dimensions)))
        files += write_vtu_series(directory / "lifts.pvd", "lifts", "lift", _lift_frames(study.two_dimensions))
    lifts = None if study.two_dimensions is None else study.two_dimensions.lumpings[0]
    files += write_vtu_series(directory / "fields.pvd", "fields", "strokes", process_frames(study.row, lifts))
    summary = directory / "process.json"
    write_json(summary, process_summary(study))
    return [*files, summary]


def process_summary(study: ProcessStudy) -> dict[str, Any]:
    """Return the results for process.json: numbers with units, and sentences."""
    flow = study.row.flow
    grains = {name: getattr(flow, name) for name in ("product", "fill", "fed", "extruded", "retained", "missing")}
    return {
        "model": _statement(study),
        "rollers": study.scene.machine.rollers,
        "per_roller": {name: json_number(value, PROCESS[name].unit) for name, value in process_numbers(study).items()},
        "mix_per_stroke": {name: json_number(study.mass_per_stroke(height), "kg") for name, height in grains.items()},
        "grains_of_a_section": {name: json_number(height, "m") for name, height in grains.items()},
        "parts": [
            {"cause": part.cause, "force": json_number(part.force, "N"), "work": json_number(part.work, "J/m3")}
            for part in study.parts
        ],
        "printed": [
            {
                "name": each.name,
                "printed": json_number(each.printed, "N"),
                "computed": json_number(each.computed, "N"),
                "causes": [{"cause": cause, "force": json_number(force, "N")} for cause, force in each.causes],
            }
            for each in study.printed
        ],
        "two_dimensions": _two_dimensional_summary(study),
        "remarks": list(study.remarks),
    }


def process_digest(study: ProcessStudy) -> str:
    """Return the results as lines of text."""
    numbers = process_numbers(study)
    lines = [_statement(study), *_two_dimensional_lines(study), "", "one roller, columns"]
    for name, value in numbers.items():
        if value is not None:
            text = format_quantity(value, PROCESS[name].unit)
            if name == "load_centre":
                text += f" ({format_percent(value / study.scene.machine.roller_length)} of the roller length)"
            lines.append(_line(PROCESS[name].term, text))
    lines += ["", *_flow_lines(study), "", f"force that moves one cart with {study.scene.machine.rollers} rollers"]
    for part in study.parts:
        force = "not computed" if part.force is None else format_quantity(part.force, "N")
        work = "" if part.work is None else f"{part.work / 1e3:10.4g} kJ/m³ of product"
        lines.append(f"{_line(part.cause, force)}{work}")
    words = NOT_FITTED if study.mix.parameter("heckel_slope").flag == "given" else HALF_FITTED
    for each in study.printed:
        lines += ["", f"printed: {each.name} {each.printed:.0f} N, computed {each.computed:.0f} N; {words}"]
        lines += [f"{_line(cause, f'{force:.0f} N')}{force / each.printed:10.0%}" for cause, force in each.causes]
    if study.remarks:
        lines += ["", *(f"note: {remark}" for remark in study.remarks)]
    return "\n".join(lines)


def _statement(study: ProcessStudy) -> str:
    if study.two_dimensions is None:
        return COLUMNS_STATEMENT
    return LIFTS_STATEMENT.format(f"with {study.scene.mix.pore_air} pore air" if study.counts_air else "drained")


def _two_dimensional_summary(study: ProcessStudy) -> dict[str, Any] | None:
    """Return the results in two dimensions for process.json; None without them."""
    found = study.two_dimensions
    if found is None:
        return None
    estimates = {
        "load": (found.load, "N"),
        "resistance": (found.resistance, "N"),
        "air_load": (found.air_load, "N"),
        "air_resistance": (found.air_resistance, "N"),
    }
    return {
        **{name: json_number(each.value, unit) | {"error": each.error, "lumping_error": each.lumping_error,
           "mesh_error": each.mesh_error, "extrapolated_share": each.extrapolated_share}
           for name, (each, unit) in estimates.items()},
        "air_is_counted": study.counts_air,
        "air_excess_behind": json_number(found.air_excess_behind, "Pa"),
        "load_centre": json_number(found.load_centre, "m"),
        "skew_moment": json_number(found.skew_moment, "Nm"),
        "specific_work": json_number(found.specific_work, "J/m3"),
        **{name: json_number(found.of_product(name), unit) for name, unit in PRODUCT_FIELDS.items()},
        "strip_stress_ratio": json_number(found.strip_stress_ratio(), "1"),
        "largest_work_residual": max(sequence.largest_work_residual for sequence in found.sequences),
        "sequences": [
            {"thickness": json_number(each.thickness, "m"), "increments": each.increments, "lifts": len(each.lifts),
             "stopped": each.stopped}
            for each in found.sequences
        ],
    }  # fmt: skip


def _two_dimensional_lines(study: ProcessStudy) -> Iterator[str]:
    """Yield the results in two dimensions."""
    found = study.two_dimensions
    if found is None:
        return
    yield from ("", "one roller, two dimensions")
    part = "" if study.counts_air else ", not counted"
    rows = (
        ("load on one roller, drained", found.load), ("resistance of one roller, drained", found.resistance),
        (f"load by pore air{part}", found.air_load), (f"resistance by pore air{part}", found.air_resistance),
    )  # fmt: skip
    for term, each in rows:
        yield f"{_line(term, format_quantity(each.value, 'N'))}  ± {each.error:.0%}"
    share = found.load_centre / study.scene.machine.roller_length
    yield _line("centre of the load, of the roller length", format_percent(share))
    yield _line("skew moment of the load", format_quantity(found.skew_moment, "Nm"))
    yield _line("work per volume of the product", f"{found.specific_work / 1e3:.4g} kJ/m³")
    for name, term in (("bottom_density_ratio", "bottom"), ("top_density_ratio", "top")):
        yield _line(f"density ratio of the {term} quarter", f"{found.of_product(name):.3f}")
    yield _line("height with a density ratio above 1", format_quantity(found.of_product("overpressed_height"), "m"))
    low, high = STRIP_FACTORS
    words = f"stress at the bottom over 2 P/(pi h0), {low:g} to {high:g} expected"
    yield _line(words, f"{found.strip_stress_ratio():.2f}")
    residual = max(sequence.largest_work_residual for sequence in found.sequences)
    yield _line("largest residual of the energy balance of a pass", f"{residual:.1%}")


def _line(words: str, text: str) -> str:
    return f"  {words:<{CAUSE_WIDTH}}{text:>14}"


def _flow_lines(study: ProcessStudy) -> Iterator[str]:
    """Yield the balance of the mix: masses per stroke, or heights of grains of a mould at rest."""
    flow, at_rest = study.row.flow, study.problem.machine.strokes is not None
    filled = "filled by the first sleeve" if study.problem.fill.by_sleeve else "carried in by the mould"
    rows = {
        "product": flow.product, filled: flow.fill, "fed before the strokes": flow.fed,
        "extruded towards the empty mould": flow.extruded, "offered, left in the sleeves": flow.retained,
        "missing to the required density": flow.missing,
    }  # fmt: skip
    yield "mix, height of its grains" if at_rest else f"mix per stroke, on {study.covered_width:.4g} m of width"
    for words, grains in rows.items():
        if grains > ROUNDING * flow.product:
            text = format_quantity(grains, "m") if at_rest else format_quantity(study.mass_per_stroke(grains), "kg")
            yield _line(words, text)


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
    own = {"position": (edges[:-1] + edges[1:]) / 2}
    return {name: own[name] if name in own else getattr(history, name) for name in STROKE}


def _stroke_table(study: ProcessStudy) -> tuple[tuple[str, ...], list[Any]]:
    """Return header and columns of strokes.csv; forces in two dimensions last, where they are computed."""
    header, columns = tuple(column_names(STROKE)), list(stroke_columns(study).values())
    if study.two_dimensions is None:
        return header, columns
    return (*header, *LIFTED_HEADER), [*columns, *(study.forces.of_strokes(name) for name in ("load", "resistance"))]


def _lift_rows(study: ProcessStudy) -> Iterator[tuple[float, ...]]:
    """Yield the lifts of all sequences, in SI units."""
    found = study.two_dimensions
    assert found is not None
    for sequence in found.sequences:
        for lift in sequence.lifts:
            yield sequence.increments, *(getattr(lift, name) for name in LIFT_NAMES)


def _lift_frames(found: TwoDimensionalRow) -> Iterator[tuple[float, "meshio.Mesh"]]:
    """Yield number and fields under the roller of the thinnest lifts."""
    for number, lift in enumerate(found.lumpings[0].lifts, start=1):
        if lift.mesh is not None:
            yield float(number), lift.mesh


def _map_rows(study: ProcessStudy) -> Iterator[tuple[float, ...]]:
    """Yield the cells of the map."""
    found = study.map
    assert found is not None
    for i, cart_speed in enumerate(found.cart_speeds.tolist()):
        for j, mould_speed in enumerate(found.mould_speeds.tolist()):
            cells = (found.strokes[i, j], found.load[i, j], found.resistance[i, j])
            yield mould_speed, cart_speed, *map(float, cells)
