"""The command `compact`: each subcommand calls the analysis and the report, and prints a digest.

Exit codes: 0 success, 1 no result (no convergence, files), 2 invalid input, 130 interrupted. Heavy modules are imported
inside the commands, so that `--help` answers within a quarter of a second, and after the scene is read, so that a
refusal of the scene does not wait for them.
"""

import gc
import logging
import os
import re
import sys
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from compact.analysis.failures import is_refusal, sentence_of
from compact.cli import INTERRUPTED, INTERRUPTED_MESSAGE
from compact.cli import options as cli
from compact.cli.options import ENGINE_JOB, JOB, OWNING_JOB, SUCCESS, Console, EngineJob, Job, OwningJob, ScenePath
from compact.files import ResultsError, default_directory, json_text, read_json, write_figure, write_json, write_text
from compact.report.progress import logged, tracked

Format = Literal["csv", "fmu", "vtu"]
app = App(
    name="compact",
    help="Roller-compaction loads: from a scene (machine, mix, motion) to ranked motion laws.",
    help_format="plaintext",
    suppress_keyboard_interrupt=False,  # handled in `_exit_code`
)


def main() -> None:
    """Run the command line and exit; every failure prints one sentence and sets an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        code = _exit_code(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = SUCCESS
    if code == INTERRUPTED:  # an interrupt inside `eval` would make the interpreter end by the signal itself
        gc.collect()  # releases semaphores of worker processes, which would be reported as leaked
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _exit_code(arguments: Sequence[str]) -> int:
    """Run one command and convert its exceptions to messages and exit codes."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # a result with a numerical warning is not a result
            command, bound, _ = app.parse_args(arguments, exit_on_error=False, print_error=False)
            given = (each for each in bound.arguments.values() if isinstance(each, Console))
            console = next(given, cli.CONSOLE)
            with logged(console.verbose, console.profile, console.quiet):
                return command(*bound.args, **bound.kwargs) or SUCCESS
    except CycloptsError as error:
        return cli.print_error(_with_remedy(error, arguments), cli.INVALID_INPUT)
    except BrokenPipeError:
        raise
    except (KeyboardInterrupt, Exception) as error:
        if cli.is_interrupt(error):
            return cli.print_error("; ".join([INTERRUPTED_MESSAGE, *getattr(error, "__notes__", ())]), INTERRUPTED)
        if isinstance(error, MemoryError):
            return cli.print_error(sentence_of(error), cli.NO_RESULT)
        if is_refusal(error):  # invalid input, or a RuntimeError: ResultsError, or an engine that did not converge
            return cli.print_error(error, cli.INVALID_INPUT if isinstance(error, ValueError) else cli.NO_RESULT)
        if os.environ.get("COMPACT_TRACEBACK"):
            raise
        return cli.print_error(f"{sentence_of(error)} (COMPACT_TRACEBACK=1 prints the traceback)", cli.NO_RESULT)


def _with_remedy(error: CycloptsError, arguments: Sequence[str]) -> str:
    """Return the sentence of cyclopts on the options, with a remedy where it has none."""
    said = " ".join(str(error).split()).rstrip(".")
    if "into float" in said or "into int" in said:
        return f"{said}; give a plain number in SI units, with a decimal point and without a unit"
    named = [name for name in arguments[:1] if name in app]
    remedy = f"; `{' '.join(['compact', *named, '--help'])}` lists what it takes"
    return said if "Did you mean" in said or "Choose from" in said else said + remedy


if logging.lastResort:  # the handler of warnings to a logger that nobody has configured
    logging.lastResort.setFormatter(logging.Formatter("compact: %(message)s"))
warnings.formatwarning = lambda message, *_, **__: f"compact: warning: {message}\n"


@app.command
def new(
    directory: Path,
    /,
    *,
    source: Annotated[str | None, Parameter(name="--from")] = None,
    measurements: Annotated[bool, Parameter(negative="")] = False,
    machine: Annotated[cli.NewMachine, Parameter(name="*")] = cli.NewMachine(),  # noqa: B008
) -> None:
    """Write a commented scene that runs as it is, and the schema by which editors complete its keys.

    In a terminal and without options of the machine, the user is prompted for each of them.

    Parameters
    ----------
    directory
        folder for scene.toml; created if absent, and an existing scene is never overwritten
    source
        name of a published scene to copy, such as loveikin-2015
    measurements
        write measured.toml as well: an empty sheet of what to measure, how, and what to expect
    machine
        the machine: what follows from it is derived, and printed; the rest is assumed, and nothing is fitted
    """
    from compact.scene import new_scene
    from compact.scene.loader import SCENE_SCHEMA_FILE, scene_schema

    path, given = directory / "scene.toml", machine.given()
    if path.exists():
        raise ResultsError(f"{path}: exists already; give another directory")
    if source is not None and given:
        raise ValueError("--from copies a published scene as it is; leave the other options out, or edit the copy")
    if source is None and not given and sys.stdin and sys.stdin.isatty():
        given = _asked(path)
    text, derived = (new_scene.published_scene(source), []) if source else new_scene.new_scene(given, str(path))
    write_text(path, text)
    write_json(directory / SCENE_SCHEMA_FILE, scene_schema())
    if measurements:
        derived.append(f"{new_scene.write_sheet(directory)} written; fill it in, then: compact calibrate {path} SHEET")
    print("\n".join([*derived, f"{path} written; next: compact run {path}"]))


def _asked(path: Path) -> dict[str, Any]:
    """Ask for the machine as by its options; a wrong answer gets the refusal of its option, and the question again."""
    from compact.scene import new_scene

    shown, typed = new_scene.assumed(), dict[str, str]()
    words = dict(re.findall(r"(?m)^    (\w+)\n        (.+)", cli.NewMachine.__doc__ or ""))
    print("Enter takes what is in brackets; Ctrl-C ends and writes nothing.")

    def given(names: Iterable[str]) -> dict[str, Any]:
        options = [f"--{name.replace('_', '-')}={typed[name]}" for name in names if typed.get(name)]
        _, bound, _ = app.parse_args(["new", str(path), *options], exit_on_error=False, print_error=False)
        return dict(bound.arguments.get("machine", cli.NewMachine()).given())

    waiting = list(words)
    while waiting:
        name, *waiting = again = waiting
        before = typed.get(name, "")
        typed[name] = input(f"{name}, {words[name]} [{before or shown[name]}]: ").strip() or before
        try:
            new_scene.require_given(given([name]), str(path))
            before, again = typed[name], list(words)
            if not waiting:
                new_scene.new_scene(given(words), str(path))
        except (CycloptsError, ValueError) as error:
            cli.print_error(_with_remedy(error, ["new"]) if isinstance(error, CycloptsError) else error, SUCCESS)
            waiting, typed[name] = again, before
    return given(words)


@app.command
def schema(name: Literal["scene", "summary"] = "scene", /) -> None:
    """Print the JSON schema of a scene file or of summary.json.

    Parameters
    ----------
    name
        file that the schema describes
    """
    from compact.scene.loader import scene_schema, summary_schema

    print(json_text(scene_schema() if name == "scene" else summary_schema()))


@app.command
def run(scene: ScenePath, /, *, over: str | None = None, job: EngineJob = ENGINE_JOB) -> None:
    """Compute the whole scene: resistance, motion laws, drive forces, ranking, cams, tables, figures and report.

    Parameters
    ----------
    over
        duration=LOW:HIGH:N, durations of a pass in s at which the laws are ranked again, with their crossovers
    """
    given = job.read(scene)

    from compact.analysis.sizing.durations import read_durations
    from compact.analysis.study import Study
    from compact.analysis.worker_pool import ProcessExecutor, cores
    from compact.report import text
    from compact.report import writer as report

    progress = job.progress()
    directory = job.place(scene, given)
    study = Study(
        given, directory=directory, progress=progress.report, durations=() if over is None else read_durations(over),
        step=progress.begin,
    )  # fmt: skip
    others = study.scene.compared_engines if study.scene.compare and cores() > 1 else ()
    helpers = ProcessExecutor(min(cores(), len(others))) if others else None
    kept = f"complete files are in {directory}; the same command computes the others"
    with cli.interrupt_noted(lambda: kept), progress:
        summary = report.write_study(study, directory, job.force, helpers)
    job.show(lambda: text.study_digest(study), directory, summary=summary)


@app.command
def explain(results: Path, key: str, /) -> None:
    """Explain a number of finished results: value, range, chain of models, inputs with origin, fits, sources, theory.

    Parameters
    ----------
    results
        folder of results, with summary.json
    key
        name in summary.json, as peak_force, or a path, as work_balance.feed_ratio
    """
    from compact.report.explain import explanation

    print("\n".join(explanation(read_json(results / "summary.json"), key)))


@app.command
def roll(
    scene: ScenePath, /, *, speed: float | None = None, picture: Path | None = None, job: EngineJob = ENGINE_JOB
) -> None:
    """Compute one contact of roller and layer: load, resistance, edges, pressure and fields, for every pass.

    Parameters
    ----------
    speed
        speed of the cart in m/s; default its mean speed
    picture
        PNG file for a picture of the displaced layer with its density ratio or pressure; needs an engine with fields,
        fem or compaction
    """
    given = job.read(scene)

    from compact.analysis.study import Study
    from compact.report import text, writer
    from compact.report.contact_figures import draw_picture

    if speed is not None:
        given.require_fields(**{"contact.speeds": [speed]})
    speed = given.mean_speed if speed is None else speed
    with job.writing(scene, "roll", given) as (directory, progress):
        study = Study(given, progress=progress.report)
        contacts = study.stages.contacts
        if picture is not None:
            contacts.require_fields()
        progress.begin(f"contact by {given.accuracy.engine}")
        passes = contacts.passes_at(speed)
        progress.begin("tables and figures")
        writer.write_contact(directory, study, speed, passes)
        if picture is not None:
            write_figure(picture, draw_picture(contacts.field_mesh(passes[0]), passes[0]))
    contact = read_json(directory / "contact.json")
    job.show(lambda: text.contact_digest(study, speed, passes), directory, contact=contact)


@app.command
def cam(
    scene: ScenePath,
    /,
    *,
    law: str,
    follower: Literal["pointed", "roller", "flat"] = "roller",
    cutter: float | None = None,
    tolerance: float = 1e-6,
    job: Job = JOB,
) -> None:
    """Design the cam of constant breadth for one law: points as CSV, workshop drawing as SVG and DXF.

    The scene requires a table [cam].

    Parameters
    ----------
    law
        name of the motion law; a law of motion.tables has the name of its file without suffix, an optimal law of
        [motion.optimise] is called least-peak-force and so on
    follower
        kind of follower
    cutter
        radius of the cutter in m; adds the path of the cutter centre
    tolerance
        largest deviation in m of a follower on the exported points from its law
    """
    from compact.scene.schema import LAW_NAMES

    given = job.read(scene, **{"motion.laws": (law,)} if law in LAW_NAMES else {})

    from compact.analysis.study import Study
    from compact.cams import workshop_drawing as cam_files
    from compact.numerics.validation import require_known
    from compact.report import text

    if not law.startswith(("least-", "robust-")):
        require_known("motion law", law, (*LAW_NAMES, *(path.stem for path in given.table_paths)))
    study = Study(given)
    made, bore = study.stages.laws.cam(law, follower), given.cam.bore if given.cam else None
    written = cam_files.write_cam_files(job.place(scene, given, "cams"), made, cutter, tolerance, bore)
    told = text.lines("cam", law, type(made.follower).__name__, made, made.least_breadth())
    job.show(lambda: "\n".join([*told, *(f"  {path}" for path in written)]), files=written)


@app.command
def process(scene: ScenePath, /, *, deep: bool = False, job: OwningJob = OWNING_JOB) -> None:
    """Compute the forming process of a table [process]: strokes over a moving mould with feed before each.

    Parameters
    ----------
    deep
        lumped lifts in two dimensions too, of two thicknesses, with errors: some minutes on two processors
    """
    from compact.analysis.process import ProcessStudy
    from compact.analysis.worker_pool import choose_executor
    from compact.report.process import process_digest, write_process

    given = job.read(scene)
    detail = "deep" if deep else (given.process and given.process.detail) or "columns"
    helpers = choose_executor(None if detail == "deep" else 1)
    with job.writing(scene, "process", given) as (directory, progress), helpers:
        study = ProcessStudy(given, detail, progress.report, executor=helpers)
        progress.begin("strokes of the process")
        write_process(study, directory)
    job.show(lambda: process_digest(study), directory, process=read_json(directory / "process.json"))


@app.command
def sweep(
    scene: ScenePath,
    /,
    *,
    vary: Annotated[tuple[str, ...], Parameter(negative="")],
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    rank: bool = False,
    sobol: bool = False,
    direct: int | Literal["all"] | None = None,
    job: EngineJob = ENGINE_JOB,
) -> int:
    """Compute many scenes with keys varied on grids, lists or samples, and write one labelled netCDF file.

    Parameters
    ----------
    vary
        KEY=LOW:HIGH:N, KEY=A,B,C, or mix.overrides.NAME=~N for N Sobol points over its spread; repeatable
    workers
        worker processes on this machine; default one per processor, 1 computes in the command itself
    scheduler
        address of a dask scheduler, such as tcp://host:8786, whose workers compute the points
    resume
        complete an interrupted sweep
    rank
        rank the motion laws at every point as well
    sobol
        design the sample for Sobol indices, the share of the spread that each parameter explains
    direct
        points that the engine compaction computes itself, a number or all; at the others it corrects columns
    """
    from compact.analysis.worker_pool import choose_executor
    from compact.report.sweep import sweep_digest, sweep_summary, write_sweep_report
    from compact.sweep import sobol_indices
    from compact.sweep.corrected import create_sweep
    from compact.sweep.design import read_design

    workforce = choose_executor(workers, scheduler)
    given = job.read(scene)
    many = create_sweep(given, [*map(read_design, vary)], rank=rank, indices=sobol, direct=direct)
    directory, failed = job.place(scene, given, "sweep"), 0

    def step(points: int, failures: int) -> None:
        nonlocal failed
        failed += failures
        progress.advance(points)
        progress.report(f"{failed} failed" if failed else "")

    def kept() -> str:
        return f"{many.store.computed} points of this run are kept in {directory}; --resume computes the others"

    with cli.interrupt_noted(kept), job.progress(many.steps) as progress:
        progress.begin("points")
        table = many.run(directory, executor=workforce, resume=resume, force=job.force, step=step)
    indices, store = sobol_indices.of_table(table), many.store
    write_sweep_report(directory, table, indices)
    notes = [f"{name} was incomplete; its points have been computed again" for name in store.broken]
    if (unused := len(store.known.keys() - store.used)) and store.computed:
        notes.append(f"{unused} points of earlier runs in {directory} are of another sweep or program: not used")
    for note in () if job.quiet else notes:
        print(f"compact: {note}", file=sys.stderr)
    counts = f"{store.computed} of {len(store.used)} computed now"
    job.show(
        lambda: f"{sweep_digest(table, indices)}\n\n{counts}", directory,
        points=len(store.used), computed_now=store.computed, **sweep_summary(table, indices),
    )  # fmt: skip
    return SUCCESS if (table["reason"] == "").any() else cli.print_error("no point has a result", cli.NO_RESULT)


@app.command
def export(
    scene: ScenePath,
    /,
    *,
    formats: Annotated[tuple[Format, ...], Parameter(name="--format", negative="", consume_multiple=True)],
    tolerance: float | None = None,
    speed: float | None = None,
    job: EngineJob = ENGINE_JOB,
) -> None:
    """Write the force on the cart over velocity and acceleration, or the fields of one contact, for other programs.

    Contacts of an earlier `compact run` of the same scene are used.

    Parameters
    ----------
    formats
        csv is a table of F(v, a) with the guide friction; fmu is a functional mock-up unit with the cart (FMI 2.0);
        vtu has the fields of fem and compaction
    tolerance
        largest error of linear interpolation over the largest force; default the tolerance of the scene
    speed
        speed of the fields in m/s; default the mean speed
    """
    given = job.read(scene)

    from compact.analysis.study import Study
    from compact.files import write_vtu
    from compact.interfaces.force_tables import CartModel, force_table, write_force_csv
    from compact.interfaces.functional_mockup import has_binary, write_fmu

    files, notes, numbers = [], [], {}
    with job.writing(scene, "export", given) as (directory, progress):
        study = Study(given, progress.begin, default_directory(scene, "", given.changed_values), progress.report)
        contacts = study.stages.contacts
        for name in dict.fromkeys(formats):
            if name == "csv":
                table = force_table(CartModel.of(study), tolerance or given.accuracy.tolerance)
                files.append(write_force_csv(table, directory / "force.csv"))
                error = table.interpolation_error
                numbers = {"mass": table.mass, "interpolation_error": error}
                notes.append(f"force without the cart, {table.mass:g} kg; interpolation error {error:.1e}")
            elif name == "fmu":
                files.append(write_fmu(CartModel.of(study), directory / "cart.fmu", given.title))
                notes.append("" if has_binary(files[-1]) else "cart.fmu: sources only, as no compiler is found")
            elif contacts.engine.has_fields:
                mesh = contacts.field_mesh(contacts.passes_at(speed or given.mean_speed)[0])
                files.append(write_vtu(mesh, directory / "fields.vtu"))
            else:
                raise ValueError(f"--format {name} needs fields; use --engine fem or compaction")
    lines = [note for note in notes if note] + [f"  {path}" for path in files]
    job.show(lambda: "\n".join(lines), directory, files=files, **numbers)


@app.command
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


@app.command
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
    """Fit mix and process of a scene to forces and densities of its plant or to kneading, and the drive to its tests.

    Parameters
    ----------
    measured
        TOML or CSV file of measured load, resistance and exit density, of deflection and tap tests of the drive, of
        density over cycles of kneading and pressure, or of density and force over mould speed and strokes a minute
    parameters
        parameters to fit, at most as many as there are data
    engine
        contact engine of every trial: columns take a second, finite elements take minutes
    increments
        elements of travel per contact length (finite elements); 14 by default, 7 cost a third and differ by 1 to 2 %
    """
    from compact.analysis import calibration, operating_window
    from compact.engines.process.kneading import fit_kneading
    from compact.material import mix
    from compact.scene.plant_data import read_measurements

    readings = read_measurements(measured)
    options: dict[str, Any] = {} if increments is None else {"increments": increments}
    given = job.read(scene)
    path = job.place(scene, given, "calibration.json")
    summary: dict[str, Any] = {}
    told = []
    if readings.deflections or readings.taps:
        drive = calibration.calibrate_drive(given, readings)
        summary["drive"] = {name: vars(each) | {"spread": each.spread} for name, each in drive.items()}
        told.append(calibration.drive_digest(drive, given.machine.mass))
    if readings.kneading:
        kneaded = fit_kneading(readings.kneading, mix.LOOSE_DENSITY_RATIO)
        summary["kneading"] = {**vars(kneaded.kneading), "static_slopes": kneaded.static_slopes, "rms": kneaded.rms}
        told.append(calibration.kneading_digest(kneaded))
    if readings.compressions:
        pressed = calibration.fit_slope(readings.compressions)
        summary["heckel_slope"] = pressed.value
        told.append(calibration.slope_digest(given, pressed))
    if readings.values:
        told.append(calibration.value_lines(given, readings.values))
        summary["values"] = [asdict(each) for each in readings.values]
    if readings.strokes:
        window = operating_window.calibrate_window(given, readings.strokes)
        summary["window"] = window.values
        told.append(operating_window.window_digest(window))
    if readings.measurements:
        with job.progress() as progress:
            progress.begin(f"fit by {engine}")
            found = calibration.calibrate(given, readings, engine, parameters, **options)
        summary |= calibration.calibration_summary(found)
        told.append(calibration.calibration_digest(found))
    write_json(path, summary)
    job.show(lambda: "\n\n".join(told), path, calibration=summary)


@app.command
def check(*, console: Console = cli.CONSOLE) -> int:
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


@app.command
def validate(
    names: Annotated[tuple[str, ...], Parameter(name="CASE", negative="")] = (),
    /,
    *,
    out: Path | None = None,
    console: Console = cli.CONSOLE,
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

    cases = tracked(select_cases(names), attrgetter("name"), quiet=console.quiet or bool(console.verbose))
    results = [case.evaluated() for case in cases]
    written = [] if out is None else validation.write_validation(out, results)
    files = "".join(f"\n  {path}" for path in written)
    summaries = validation.case_summaries(results)
    console.show(lambda: validation.validation_text(results) + files, files=written, cases=summaries)
    moved = sum(each.moved for result in results for each in result.rows.values())
    words = f"{moved} computed numbers have moved from the recorded ones"
    return cli.print_error(words, cli.NO_RESULT) if moved else SUCCESS
