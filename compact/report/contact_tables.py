"""Files of the contact of one roller: tables over the speeds of a scene, and one contact in full."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from compact import quantities
from compact.analysis.contact_cases import ContactRecord, contact_record, contact_to_json
from compact.analysis.study import Study
from compact.files import write_columns, write_csv, write_figure, write_json, write_vtu_series
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
DENSITY_HEADER = ("speed_m/s", "pass", "bottom_m", "top_m", "density_ratio")


def write_contact_tables(study: Study, directory: Path) -> Iterator[Path]:
    """Write contact.csv; of a compacting layer also passes.csv and density.csv."""
    length, formulas = study.scene.machine.roller_length, study.stages.contacts.engineering
    comparison = (
        formulas.roller_force / length,
        formulas.resistance_coefficient,
        float(study.stages.contacts.exact.load),
    )
    rows = [(*contact_row(contact), *comparison) for contact in study.contacts]
    yield write_csv(directory / "contact.csv", CONTACT_HEADER, rows)
    if study.stages.contacts.engine.compacting:
        yield from study.standing(directory, "passes.csv", "density.csv") or _write_passes(
            study.stages.contacts.passes, directory
        )


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

    if study.stages.contacts.process is not None:
        return write_figure(directory / "section.png", process.draw_section(study.stages.contacts.process))
    speed, contact = study.stages.contacts.typical
    return write_figure(
        directory / "pressure.png", contact_figures.draw_pressure(contact, study.stages.contacts.exact, speed)
    )


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
    air = study.stages.contacts.air_forces_of(first, speed)
    content = contact_to_json(contact_record(engine, speed, tuple(passes), air))
    write_json(directory / "contact.json", content | {"replaced": list(study.scene.replacements[engine])})
    write_figure(directory / "pressure.png", contact_figures.draw_pressure(first, study.stages.contacts.exact, speed))
    if study.stages.contacts.engine.compacting:
        list(_write_passes([(speed, passes)], directory))
        write_figure(directory / "density.png", contact_figures.draw_density(passes))
    if study.stages.contacts.engine.fields_module:
        list(write_fields(directory, [(study.stages.contacts.field_mesh(first), first)]))


def write_fields(directory: Path, layers: list[tuple[Any, Any]]) -> Iterator[Path]:
    """Write the fields of contacts, pairs of mesh and result, as VTU files and as a figure; yield the paths."""
    from compact.report.figures import contact as contact_figures

    frames = ((contact.speed, mesh) for mesh, contact in layers)
    yield from write_vtu_series(directory / "fields.pvd", "fields", "speed", frames)
    yield write_figure(directory / "fields.png", contact_figures.draw_fields(layers))
