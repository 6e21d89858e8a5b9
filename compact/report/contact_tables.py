"""Files of the contact of one roller: tables over the speeds of a scene, and one contact in full."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from compact import quantities
from compact.analysis.contact_cases import ContactRecord, TerrainContact, contact_record, contact_to_json
from compact.analysis.stages.roller_pair import pair_answer
from compact.analysis.study import Study
from compact.files import write_columns, write_csv, write_figure, write_json, write_vtu_series
from compact.report.number_format import json_number
from compact.rolling_contact import ContactResult

CONTACT_FIELDS = ("speed", "load", "resistance", "coefficient", "leading", "trailing", "peak_pressure")
ENGINE_HEADER = (
    *quantities.column_names(quantities.CONTACT, *CONTACT_FIELDS),
    "load_error", "resistance_error", "work_residual", "iterations",
)  # fmt: skip
CONTACT_HEADER = (*ENGINE_HEADER, "formula_load_N/m", "formula_coefficient", "exact_load_N/m")
PASSES_HEADER = (
    "speed_m/s", "pass", "load_N/m", "resistance_N/m", "coefficient", "indentation_m", "exit_height_m",
    "exit_density_ratio", "load_error", "resistance_error", "work_residual", "mass_residual",
)  # fmt: skip
WHEEL_HEADER = ("x_m", "angle_rad", "normal_stress_Pa", "shear_stress_on_terrain_Pa")
SLIP_HEADER = ("slip", "drawbar_N", "torque_Nm", "sinkage_m")
DENSITY_HEADER = ("speed_m/s", "pass", "bottom_m", "top_m", "density_ratio")


def write_contact_tables(study: Study, directory: Path) -> Iterator[Path]:
    """Write contact.csv; of a compacting layer also passes.csv and density.csv."""
    length, formulas = study.scene.machine.roller_length, study.engineering
    comparison = (formulas.roller_force / length, formulas.resistance_coefficient, float(study.exact.load))
    rows = [(*contact_row(contact), *comparison) for contact in study.contacts]
    yield write_csv(directory / "contact.csv", CONTACT_HEADER, rows)
    if study.engine.compacting:
        yield from study.standing(directory, "passes.csv", "density.csv") or _write_passes(study.passes, directory)


def contact_row(contact: ContactRecord) -> tuple[Any, ...]:
    """Return one contact in the columns of ENGINE_HEADER.

    Returns
    -------
    tuple
        An error estimate that is missing is an empty text.
    """
    errors = ("" if error is None else error for error in (contact.load_error, contact.resistance_error))
    values = (getattr(contact, name) for name in CONTACT_FIELDS)
    return (*values, *errors, contact.work_residual, contact.iterations)


def _write_passes(passes: Sequence[tuple[float, Sequence[ContactResult]]], directory: Path) -> Iterator[Path]:
    """Write forces and compaction of each pass, and the density over the height; even passes have negative speed."""
    from compact.analysis.multipass import density

    cases: list[tuple[float, int, Any]] = [
        (speed if number % 2 else -speed, number, contact)
        for speed, contacts in passes for number, contact in enumerate(contacts, start=1)
    ]  # fmt: skip
    yield write_csv(directory / "passes.csv", PASSES_HEADER, [
        (
            speed, number, c.load, c.resistance, c.resistance / c.load, c.indentation, c.exit_height,
            c.exit_density_ratio, *(c.error or ("", "")), c.work_residual, c.mass_residual,
        )
        for speed, number, c in cases
    ])  # fmt: skip
    rows = [(speed, number, *row) for speed, number, contact in cases for row in density(contact).tolist()]
    yield write_csv(directory / "density.csv", DENSITY_HEADER, rows)


def write_pressure_figure(study: Study, directory: Path) -> Path:
    """Draw the pressure along the contact at the mean speed, or at the nearest speed; the section of a process.

    Returns
    -------
    Path
        Path of the figure, of an earlier run where that is still valid.
    """
    if standing := study.standing(directory, "pressure.png"):
        return standing[0]
    from compact.report.figures import contact as contact_figures
    from compact.report.figures import process

    if study.contact_stage.process is not None:
        return write_figure(directory / "section.png", process.draw_section(study.contact_stage.process))
    speed, contact = study.contact_stage.typical
    return write_figure(directory / "pressure.png", contact_figures.draw_pressure(contact, study.exact, speed))


def write_contact(directory: Path, study: Study, speed: float, passes: Sequence[ContactResult]) -> None:
    """Write one contact: tractions, scalar results, figures, fields, and all passes of a compacting layer.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    passes : sequence of ContactResult
        Results of the passes in order; the tractions are those of the first.
    """
    from compact.report.figures import contact as contact_figures

    first, engine = passes[0], study.scene.accuracy.engine
    columns = first.x, first.pressure, first.shear_traction
    write_columns(directory / "pressure.csv", ("x_m", "pressure_Pa", "shear_traction_Pa"), columns)
    air = study.contact_stage.air_forces_of(first, speed)
    content = contact_to_json(contact_record(engine, speed, tuple(passes), air))
    pair = pair_answer(study.scene, study.mix, first, speed)
    if pair is not None:
        content["pair"] = pair.to_json()
    write_json(directory / "contact.json", content | {"replaced": list(study.scene.replacements[engine])})
    write_figure(directory / "pressure.png", contact_figures.draw_pressure(first, study.exact, speed))
    if study.engine.compacting:
        list(_write_passes([(speed, passes)], directory))
        write_figure(directory / "density.png", contact_figures.draw_density(passes))
    if study.engine.fields_module:
        list(write_fields(directory, [(study.contact_stage.field_mesh(first), first)]))


def write_fields(directory: Path, layers: list[tuple[Any, Any]]) -> Iterator[Path]:
    """Write the fields of contacts, pairs of mesh and result, as VTU files and as a figure; yield the paths."""
    from compact.report.figures import contact as contact_figures

    frames = ((contact.speed, mesh) for mesh, contact in layers)
    yield from write_vtu_series(directory / "fields.pvd", "fields", "speed", frames)
    yield write_figure(directory / "fields.png", contact_figures.draw_fields(layers))


def write_terrain_contact(directory: Path, contact: TerrainContact) -> list[Path]:
    """Write the summary, the stresses along the contact, drawbar over slip and the figure.

    Parameters
    ----------
    directory : Path
        Existing directory.
    """
    from compact.report.figures.contact import draw_terrain_contact

    found = contact.result
    angle = np.arcsin(np.clip(found.x / contact.radius, -1, 1))
    summary = directory / "contact.json"
    write_json(summary, terrain_summary(contact))
    columns = (found.x, angle, found.pressure, found.shear_traction)
    written = [summary, write_columns(directory / "contact.csv", WHEEL_HEADER, columns)]
    if contact.slip_curve.size:
        written.append(write_columns(directory / "slip.csv", SLIP_HEADER, tuple(contact.slip_curve.T)))
    written.append(write_figure(directory / "contact.png", draw_terrain_contact(contact)))
    return written


def terrain_summary(contact: TerrainContact) -> dict[str, Any]:
    """Return the results for contact.json, of the whole wheel, in SI units."""
    found, width = contact.result, contact.width
    return {
        "terrain": contact.name,
        "source": contact.source,
        "radius": json_number(contact.radius, "m"),
        "width": json_number(width, "m"),
        "load": json_number(found.load * width, "N"),
        "sinkage": json_number(found.indentation, "m"),
        "compaction_resistance": json_number(found.compaction_resistance * width, "N"),
        "drawbar": json_number(found.drawbar * width, "N"),
        "torque": json_number(found.torque * width, "Nm"),
        "slip": json_number(found.slip, "1"),
        "entry_angle": json_number(found.entry_angle, "rad"),
        "exit_angle": json_number(found.exit_angle, "rad"),
        "angle_of_peak_pressure": json_number(found.peak_angle, "rad"),
        "peak_pressure": json_number(found.peak_pressure, "Pa"),
        "contact_length": json_number(contact.contact_length, "m"),
    }


def terrain_digest(contact: TerrainContact) -> str:
    """Summarise the wheel in lines of text."""
    found, width = contact.result, contact.width
    rows = (
        ("load", found.load * width, "N"),
        ("sinkage", 1e3 * found.indentation, "mm"),
        ("compaction resistance", found.compaction_resistance * width, "N"),
        ("drawbar", found.drawbar * width, "N"),
        ("drawbar over load", found.drawbar / found.load, ""),
        ("torque", found.torque * width, "N m"),
        ("slip", found.slip, ""),
        ("entry angle", float(np.degrees(found.entry_angle)), "degrees"),
        ("exit angle", float(np.degrees(found.exit_angle)), "degrees"),
        ("peak pressure", found.peak_pressure / 1e3, "kPa"),
    )
    lines = [f"wheel of {contact.radius:g} m radius and {width:g} m width on {contact.name}, engine column"]
    lines += [f"  {name:<24}{value:>12.5g} {unit}".rstrip() for name, value, unit in rows if np.isfinite(value)]
    if contact.contact_length < width:
        lines.append(
            f"the contact of {contact.contact_length:.3g} m is shorter than the wheel is wide; the law has the "
            "width for Bekker's b, the smaller side of the loaded area"
        )
    if contact.source:
        lines.append(f"constants: {contact.source}")
    return "\n".join(lines)
