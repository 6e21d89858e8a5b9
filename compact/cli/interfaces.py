"""Command on interfaces to other programs: table and unit of F(v, a) with the cart, and fields.

Heavy modules are imported inside the command, as in `compact.cli.program`.
"""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from compact.cli.options import DEFAULT_CONSOLE, Changes, Console, Engine, Force, ScenePath, read_scene
from compact.files import default_directory

Format = Literal["csv", "fmu", "vtu", "vtk", "xdmf", "gmsh"]


def export(
    scene: ScenePath,
    /,
    *,
    formats: Annotated[tuple[Format, ...], Parameter(name="--format", negative="", consume_multiple=True)],
    tolerance: float | None = None,
    speed: float | None = None,
    engine: Engine = None,
    out: Path | None = None,
    changes: Changes = (),
    force: Force = False,
    console: Console = DEFAULT_CONSOLE,
) -> None:
    """Write the force on the cart over velocity and acceleration, or the fields of one contact, for other programs.

    Contacts of an earlier `compact run` of the same scene are used.

    Parameters
    ----------
    formats
        csv is a table of F(v, a) with the guide friction; fmu is a functional mock-up unit with the cart (FMI 2.0);
        vtu, vtk, xdmf and gmsh have the fields of fem and compaction
    tolerance
        largest error of linear interpolation over the largest force; default the tolerance of the scene
    speed
        speed of the fields in m/s; default the mean speed
    out
        folder of the results; default out/NAME-export, NAME as in `compact run`
    """
    given = read_scene(scene, console.quiet, changes, {"accuracy.engine": engine})

    from compact.analysis.study import Study
    from compact.files import claimed_directory
    from compact.interfaces.field_formats import FIELD_FORMATS, write_fields
    from compact.interfaces.force_tables import CartModel, force_table, write_force_csv
    from compact.interfaces.functional_mockup import has_binary, write_fmu

    progress, place = console.progress(), out or default_directory(scene, "export")
    study = Study(given, progress.begin, default_directory(scene), progress.report)
    with_fields = [name for name in formats if name in FIELD_FORMATS]
    if with_fields and not study.stages.contacts.engine.has_fields:
        name = study.scene.accuracy.engine
        raise ValueError(
            f'--format {with_fields[0]} needs fields, which the engine "{name}" does not have; '
            "use --engine fem or compaction"
        )
    files, notes, numbers = [], [], {}
    with claimed_directory(place, study.scene.hash, force) as directory, progress:
        if set(formats) - set(with_fields):
            model = CartModel.of(study)
        if "csv" in formats:
            table = force_table(model, tolerance or study.scene.accuracy.tolerance)
            files.append(write_force_csv(table, directory / "force.csv"))
            numbers = {"mass": table.mass, "interpolation_error": table.interpolation_error}
            notes.append(
                f"force against the motion at {table.velocity.size} velocities and {table.acceleration.size} "
                f"accelerations, interpolation error {table.interpolation_error:.1e}; without the mass of the cart, "
                f"{table.mass:g} kg"
            )
        if "fmu" in formats:
            files.append(write_fmu(model, directory / "cart.fmu", study.scene.title))
            binary = (
                "with a binary for this platform" if has_binary(files[-1]) else "sources only, as no compiler is found"
            )
            notes.append(f"cart.fmu: FMI 2.0, co-simulation, {binary}")
        if with_fields:
            contact = study.stages.contacts.passes_at(speed or study.scene.mean_speed)[0]
            mesh = study.stages.contacts.field_mesh(contact)
            files += [write_fields(mesh, directory / f"fields{FIELD_FORMATS[name][0]}", name) for name in with_fields]
    lines = "\n".join([*notes, *(f"  {path}" for path in files)])
    console.show(lambda: lines, results=place, files=files, **numbers)
