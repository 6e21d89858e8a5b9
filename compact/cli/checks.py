"""Commands on tests and checks: laboratory, calibration, published numbers, and cases of others.

Heavy modules are imported inside the commands, as in `compact.cli.program`.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from compact.cli import options as cli
from compact.cli.options import CONSOLE, JOB, OWNING_JOB, SUCCESS, Console, Job, OwningJob, ScenePath
from compact.files import read_json


def material(scene: ScenePath, /, *, job: OwningJob = OWNING_JOB) -> None:
    """Apply laboratory tests to the mix of a scene: oedometer, isotropic, biaxial, shear, unconfined strength."""
    from compact.analysis.material_tests import programme_of
    from compact.report.laboratory import material_digest, write_material_tests

    given = job.read(scene)
    programme = programme_of(given)
    with job.writing(scene, "material", given) as (place, _):
        write_material_tests(programme, given.mix.law, place)
    content = read_json(place / "material.json")
    job.show(lambda: material_digest(content), place, material=content)


def calibrate(
    scene: ScenePath,
    measured: Path,
    /,
    *,
    parameters: tuple[Literal["heckel_slope", "fed_density_ratio"], ...] = ("heckel_slope", "fed_density_ratio"),
    engine: Literal["column", "compaction"] = "column",
    increments: int | None = None,
    job: Job = JOB,
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
    """
    from compact.analysis import calibration
    from compact.files import write_json
    from compact.scene.plant_data import read_measurements

    readings = read_measurements(measured)
    options: dict[str, Any] = {} if increments is None else {"increments": increments}
    given = job.read(scene)
    with job.progress() as progress:
        progress.begin(f"fit by {engine}")
        found = calibration.calibrate(given, readings, engine, parameters, **options)
    path = job.place(scene, "calibration.json")
    summary = calibration.calibration_summary(found)
    write_json(path, summary)
    *values, (place, fit) = found.scene_changes.items()
    table = ", ".join(f"{name} = {json.dumps(value)}" for name, value in fit.items())
    changed = " ".join([*(f"--set {key}={value:.6g}" for key, value in values), f"--set '{place}={{{table}}}'"])
    job.show(lambda: f"{calibration.calibration_digest(found)}\n\nfor the scene: {changed}", path, calibration=summary)


def check(*, console: Console = CONSOLE) -> int:
    """Print every published number with the computed value and the verdict; exit 1 if a value has changed."""
    from compact.verification import published_numbers

    rows = published_numbers.rows()
    numbers = [asdict(row) | {"unchanged": row.unchanged} for row in rows]
    console.show(lambda: published_numbers.text_table(rows), numbers=numbers)
    changed = [row for row in rows if not row.unchanged]
    if changed:
        return cli.print_error(f"{len(changed)} of {len(rows)} computed numbers have changed", cli.NO_RESULT)
    if not (console.quiet or console.json):
        print(f"\n{len(rows)} numbers checked: all are unchanged")
    return SUCCESS


def validate(
    names: Annotated[tuple[str, ...], Parameter(name="CASE", negative="")] = (),
    /,
    *,
    out: Path | None = None,
    console: Console = CONSOLE,
) -> int:
    """Compute the cases that others measured or computed, and print ours, theirs and the verdict; exit 1 if ours moves.

    Parameters
    ----------
    names
        names of cases, all by default; or folders of a plant with one TOML, a scene with [case], and one CSV
    out
        folder for the text, the table and the figures
    """
    from compact.report import validation
    from compact.validation.plant_case import select_cases

    cases = select_cases(names)
    results = []
    with console.progress(len(cases)) as progress:
        for case in cases:
            progress.begin(case.name)
            results.append(case.evaluated())
            progress.advance()
    written = [] if out is None else validation.write_validation(out, results)
    files = "".join(f"\n  {path}" for path in written)
    summaries = validation.case_summaries(results)
    console.show(lambda: validation.validation_text(results) + files, files=written, cases=summaries)
    moved = sum(each.moved for result in results for each in result.rows.values())
    return (
        cli.print_error(f"{moved} computed numbers have moved from the recorded ones", cli.NO_RESULT)
        if moved
        else SUCCESS
    )
