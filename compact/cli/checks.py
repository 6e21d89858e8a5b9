"""Commands on tests and checks: laboratory, calibration, published numbers, and cases of others.

Heavy modules are imported inside the commands, as in `compact.cli.program`.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from compact.cli.options import NO_RESULT, SUCCESS, Changes, Force, Quiet, ScenePath, print_error, read_scene
from compact.files import default_directory


def material(
    scene: ScenePath,
    /,
    *,
    out: Path | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Apply the tests of a laboratory to the mix of a scene: oedometer, isotropic, biaxial, shear, unconfined strength.

    Parameters
    ----------
    out
        folder of material.csv, material.json and material.png; default out/NAME-material, NAME as in `compact run`
    """
    from compact.analysis.contact_cases import compaction_material, scene_mix
    from compact.analysis.material_tests import LaboratoryProgramme
    from compact.files import claimed_directory
    from compact.report.material_writer import material_digest, write_material_tests

    given = read_scene(scene, quiet, changes)
    mix = scene_mix(given)
    programme = LaboratoryProgramme(compaction_material(given, mix), given.mix.density_ratio, mix.required_pressure)
    place = out or default_directory(scene, "material")
    with claimed_directory(place, given.hash, force) as directory:
        write_material_tests(programme, given.mix.law, directory)
    if not quiet:
        print(material_digest(programme, given.mix.law))
        print(f"\nresults: {place}")


def calibrate(
    scene: ScenePath,
    measured: Path,
    /,
    *,
    parameters: tuple[Literal["heckel_slope", "fed_density_ratio"], ...] = ("heckel_slope", "fed_density_ratio"),
    engine: Literal["column", "compaction"] = "column",
    increments: int | None = None,
    out: Path | None = None,
    changes: Changes = (),
    quiet: Quiet = False,
) -> None:
    """Fit the Heckel slope and the initial density ratio of a scene to measurements of its plant.

    Parameters
    ----------
    measured
        TOML or CSV file of measured load, resistance and exit density
    parameters
        parameters to fit, at most as many as there are data
    engine
        contact engine of every trial: columns take a second, finite elements take minutes
    increments
        elements of travel per contact length (finite elements); 14 by default, 7 cost a third and differ by 1 to 2 %
    out
        the JSON file; default out/NAME-calibration.json, NAME as in `compact run`
    """
    from compact.analysis import calibration
    from compact.files import write_json
    from compact.report.progress import spinning
    from compact.scene.plant_data import read_measurements

    readings = read_measurements(measured)
    options: dict[str, Any] = {} if increments is None else {"increments": increments}
    given = read_scene(scene, quiet, changes)
    with spinning(f"fit by {engine}", quiet=quiet):
        found = calibration.calibrate(given, readings, engine, parameters, **options)
    path = out or default_directory(scene, "calibration.json")
    write_json(path, calibration.calibration_summary(found))
    if not quiet:
        print(calibration.calibration_digest(found))
        print(
            f"\nfor the scene: --set mix.overrides.heckel_slope={found.heckel_slope:.6g} "
            f"--set layer.fed_density_ratio={found.fed_density_ratio:.6g}\nresults: {path}"
        )


def check(*, markdown: bool = False) -> int:
    """Print every published number with the computed value and the verdict; exit 1 if a value has changed.

    Parameters
    ----------
    markdown
        print them as a table of Markdown
    """
    from compact.verification import published_numbers

    rows = published_numbers.rows()
    print(published_numbers.markdown(rows) if markdown else published_numbers.text_table(rows))
    changed = [row for row in rows if not row.unchanged]
    if changed:
        return print_error(f"{len(changed)} of {len(rows)} computed numbers have changed", NO_RESULT)
    print(f"\n{len(rows)} numbers checked: all are unchanged")
    return SUCCESS


def validate(
    names: Annotated[tuple[str, ...], Parameter(name="CASE", negative="")] = (),
    /,
    *,
    out: Path | None = None,
    markdown: bool = False,
    quiet: Quiet = False,
) -> int:
    """Compute the cases that others measured or computed, and print ours, theirs and the verdict; exit 1 if ours moves.

    Parameters
    ----------
    names
        names of cases, all by default; or folders of a plant with one TOML, a scene with [case], and one CSV
    out
        folder for the page, the table and the figures
    markdown
        print the page docs/validation.md
    """
    from compact.report import validation_writer
    from compact.report.progress import Progress
    from compact.validation.registry import evaluate_case, select_cases

    cases = select_cases(names)
    results = []
    with Progress(total=sum(case.seconds for case in cases), quiet=quiet) as progress:
        for case in cases:
            progress.begin(case.name, case.seconds)
            results.append(evaluate_case(case))
    written = [] if out is None else validation_writer.write_validation(out, results)
    if not quiet:
        print(validation_writer.markdown_page(results) if markdown else validation_writer.text_table(results))
        print("".join(f"  {path}\n" for path in written), end="")
    moved = sum(len(result.moved) for result in results)
    return print_error(f"{moved} computed numbers have moved from the recorded ones", NO_RESULT) if moved else SUCCESS
