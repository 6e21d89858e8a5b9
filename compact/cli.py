"""The command `compact`: each subcommand calls the analysis and the report, and prints a digest.

Exit codes: 0 success, 1 no result (no convergence, files), 2 invalid input, 130 interrupted. Heavy modules are imported
inside the commands, so that `--help` answers within a quarter of a second.
"""

import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from compact.analysis.numerical_failures import is_numeric, memory_sentence, numeric_sentence
from compact.files import ResultsError, default_directory

if TYPE_CHECKING:
    from compact.analysis.study import Study
    from compact.scene.loader import Scene

SUCCESS, NO_RESULT, INVALID_INPUT, INTERRUPTED = 0, 1, 2, 130
INTERRUPTED_MESSAGE = "interrupted; every file already written is whole"
MESSAGE_LIMIT, MESSAGE_END = 1000, 400  # [characters], longest message; kept of each end of a longer one
FORMER_OPTIONS = {"--indices": "--sobol", "--fit": "--parameters"}  # accepted for one release

# options that several commands share
ScenePath = Annotated[Path, Parameter(help="scene file in TOML")]
Engine = Annotated[
    Literal["formula", "column", "spectral", "fem", "compaction"] | None,
    Parameter(help="contact engine that replaces the engine of the scene"),
]
Changes = Annotated[
    tuple[str, ...],
    Parameter(name="--set", negative="", help="change one key of the scene, such as mix.moisture=0.11; repeatable"),
]
Force = Annotated[bool, Parameter(help="overwrite the results of another scene")]
Quiet = Annotated[bool, Parameter(help="print errors only")]

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
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _exit_code(arguments: Sequence[str]) -> int:
    """Run one command and convert its exceptions to messages and exit codes."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # a result with a numerical warning is not a result
            warnings.filterwarnings("default", ".*accepted for one release", DeprecationWarning)
            current = [_current_option(argument) for argument in arguments]
            return app(current, exit_on_error=False, print_error=True, result_action="return_value") or SUCCESS
    except CycloptsError:  # printed by cyclopts, with the nearest option
        return INVALID_INPUT
    except BrokenPipeError:
        raise
    except (KeyboardInterrupt, Exception) as error:
        message, code, is_expected = _diagnosis(error)
        if not is_expected and os.environ.get("COMPACT_TRACEBACK"):
            raise
        return _print_error(message, code)


def _diagnosis(error: BaseException) -> tuple[object, int, bool]:
    """Message, exit code, and True for a failure that needs no traceback."""
    interrupted = isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt)
    if interrupted:  # the latter while compiled code converts its result
        return INTERRUPTED_MESSAGE, INTERRUPTED, True
    if isinstance(error, MemoryError):
        return memory_sentence(error), NO_RESULT, True
    if isinstance(error, RuntimeWarning | ArithmeticError | ValueError):  # SceneError and other refused input
        if not is_numeric(error):
            return error, INVALID_INPUT, True
        return f"{numeric_sentence(error)} (COMPACT_TRACEBACK=1 prints the traceback)", NO_RESULT, False
    if isinstance(error, RuntimeError):  # ResultsError, or an engine that did not converge
        return error, NO_RESULT, True
    kind = type(error).__name__
    sentence = f"internal error, please report it: {kind}: {error} (COMPACT_TRACEBACK=1 prints the traceback)"
    return sentence, NO_RESULT, False


def _current_option(argument: str) -> str:
    """Present name of an option; warns if the argument is a former name."""
    name, equals, value = argument.partition("=")
    if name not in FORMER_OPTIONS:
        return argument
    present = FORMER_OPTIONS[name]
    warnings.warn(f"{name} is now {present}; the former name is accepted for one release", DeprecationWarning, 2)
    return present + equals + value


def _print_error(message: object, code: int) -> int:
    text = str(message)
    if len(text) > MESSAGE_LIMIT:  # an iteration history: its beginning and its end
        text = f"{text[:MESSAGE_END]} ... {text[-MESSAGE_END:]}"
    print(f"compact: {text}", file=sys.stderr)
    return code


warnings.formatwarning = lambda message, *_, **__: f"compact: warning: {message}\n"


@app.command
def new(directory: Path, /) -> None:
    """Write a commented scene that runs as it is.

    Parameters
    ----------
    directory
        folder for scene.toml; created if absent, and an existing scene is never overwritten
    """
    from compact.files import atomic_file
    from compact.scene.loader import starter_scene

    path = directory / "scene.toml"
    if path.exists():
        raise ResultsError(f"{path}: exists already; give another directory")
    with atomic_file(path) as stream:
        stream.write(starter_scene())
    print(f"{path} written; next: compact run {path}")


@app.command
def run(
    scene: ScenePath,
    /,
    *,
    out: Path | None = None,
    engine: Engine = None,
    tolerance: float | None = None,
    over: str | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compute the whole scene: resistance, motion laws, drive forces, ranking, cams, tables, figures and report.

    Parameters
    ----------
    out
        folder of the results; default out/NAME, with the name of the scene file or of the folder of a scene.toml
    tolerance
        relative error tolerance that replaces the tolerance of the scene
    over
        duration=LOW:HIGH:N, durations of a pass in s at which the laws are ranked again, with their crossovers
    """
    from compact.analysis.sizing.durations import read_durations
    from compact.analysis.worker_pool import ProcessExecutor, cores
    from compact.report import text
    from compact.report import writer as report
    from compact.report.progress import Progress
    from compact.rolling_contact import HeapingError

    progress = Progress(quiet=quiet)
    directory = out or default_directory(scene)
    study = _study(
        scene, quiet, {"accuracy.engine": engine, "accuracy.tolerance": tolerance}, changes, directory=directory,
        step=lambda stage: progress.begin(stage, study.plan.cost(stage), total=study.plan.total_cost),
        progress=progress.report, durations=() if over is None else read_durations(over),
    )  # fmt: skip
    progress.total = study.plan.total_cost
    others = study.scene.compared_engines if study.scene.compare and cores() > 1 else ()
    helpers = ProcessExecutor(min(cores(), len(others))) if others else None
    try:
        with progress:
            report.write_study(study, directory, force, helpers)
    except HeapingError as error:
        raise HeapingError(f"{error}; {text.other_resistances(study.scene)}", error.heaping) from error
    if not quiet:
        print(text.study_digest(study))
        print(f"\nresults: {directory}")


@app.command
def roll(
    scene: ScenePath,
    /,
    *,
    speed: float | None = None,
    engine: Engine = None,
    material: str | None = None,
    slip: float | None = None,
    out: Path | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compute one contact of roller and layer: load, resistance, edges, pressure and fields, for every pass.

    Parameters
    ----------
    speed
        speed of the cart in m/s; default its mean speed
    material
        terrain in place of the mix, by the engine column: a published soil such as dry-sand-lll, or a TOML file with a
        table [terrain]; needs contact.load or another target
    slip
        slip of the roller on terrain, above 0 driven, below 0 braked or towed; default that of the torque, free
    out
        folder of the results; default out/NAME-ENGINE, NAME as in `compact run`
    """
    from compact.files import claimed_directory
    from compact.report import contact_tables, text
    from compact.report.progress import Progress
    from compact.scene.plausible_ranges import check_speed

    if material is not None or slip is not None:
        _roll_on_terrain(scene, engine, material, slip, out, changes=changes, force=force, quiet=quiet)
        return
    progress = Progress(quiet=quiet)
    study = _study(scene, quiet, {"accuracy.engine": engine}, changes, progress=progress.report)
    if speed is not None:
        check_speed(speed, study.scene.unusual)
    speed = speed if speed is not None else study.scene.mean_speed
    name = study.scene.accuracy.engine
    place = out or default_directory(scene, name)
    with claimed_directory(place, study.scene.hash, force) as directory, progress:
        progress.begin(f"contact by {name}")
        passes = study.passes_at(speed)
        progress.begin("tables and figures")
        contact_tables.write_contact(directory, study, speed, passes)
    if not quiet:
        print(text.contact_digest(study, speed, passes))
        print(f"\nresults: {directory}")


def _roll_on_terrain(
    path: Path,
    engine: str | None,
    material: str | None,
    slip: float | None,
    out: Path | None,
    *,
    changes: Sequence[str],
    force: bool,
    quiet: bool,
) -> None:
    """Compute the roller of a scene on terrain, and write its files."""
    from compact.analysis.contact_cases import roll_on_terrain
    from compact.files import claimed_directory
    from compact.report.contact_tables import terrain_digest, write_terrain_contact

    if material is None:
        raise ValueError(f"--slip {slip:g} needs --material, the terrain under the wheel")
    if engine not in (None, "column"):
        raise ValueError(f"--material needs the engine column, got {engine}")
    given = _scene(path, True, changes, {"accuracy.engine": "column"})
    contact = roll_on_terrain(given, material, slip)
    place = out or default_directory(path, "terrain")
    with claimed_directory(place, given.hash, force) as directory:
        write_terrain_contact(directory, contact)
    if not quiet:
        print(terrain_digest(contact))
        print(f"\nresults: {place}")


@app.command
def cam(
    scene: ScenePath,
    /,
    *,
    law: str,
    follower: Literal["pointed", "roller", "flat"] = "roller",
    cutter: float | None = None,
    tolerance: float = 1e-6,
    out: Path | None = None,
    changes: Changes = (),
    quiet: Quiet = False,
) -> None:
    """Design the cam of constant breadth for one law: points as CSV, workshop drawing as SVG and DXF, animation.

    The scene requires a table [cam].

    Parameters
    ----------
    law
        name of the motion law; an optimal law of [motion.optimise] is called least-peak-force and so on
    follower
        kind of follower
    cutter
        radius of the cutter in m; adds the path of the cutter centre
    tolerance
        largest deviation in m of a follower on the exported points from its law
    out
        folder of the results; default out/NAME-cams, NAME as in `compact run`
    """
    from compact.cams import export as cam_files
    from compact.report import text

    study = _study(scene, quiet, {} if law.startswith("least-") else {"motion.laws": (law,)}, changes)
    made = study.law_stage.cam(law, follower)
    written = cam_files.write_cam_files(out or default_directory(scene, "cams"), study.scene, made, cutter, tolerance)
    if not quiet:
        print(text.cam_digest(law, made))
        print("\n".join(f"  {path}" for path in written))


@app.command
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

    given = _scene(scene, quiet, changes)
    mix = scene_mix(given)
    programme = LaboratoryProgramme(compaction_material(given, mix), given.mix.density_ratio, mix.required_pressure)
    place = out or default_directory(scene, "material")
    with claimed_directory(place, given.hash, force) as directory:
        write_material_tests(programme, given.mix.law, directory)
    if not quiet:
        print(material_digest(programme, given.mix.law))
        print(f"\nresults: {place}")


@app.command
def process(
    scene: ScenePath,
    /,
    *,
    quick: bool = False,
    deep: bool = False,
    out: Path | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compute the forming process of a table [process]: strokes over a moving mould with feed before each.

    Parameters
    ----------
    quick
        lumped lifts in two dimensions too, of one thickness and on one mesh: some minutes
    deep
        lumped lifts of three thicknesses and on three meshes, with errors: ten minutes or more
    out
        folder of process.json, tables, figures and fields; default out/NAME-process, NAME as in `compact run`
    """
    from compact.analysis.process import ProcessStudy
    from compact.files import claimed_directory
    from compact.report.process_writer import process_digest, write_process
    from compact.report.progress import Progress

    progress, place = Progress(quiet=quiet), out or default_directory(scene, "process")
    given = _scene(scene, quiet, changes)
    study = ProcessStudy(given, "deep" if deep else "quick" if quick else "columns", progress.report)
    with claimed_directory(place, given.hash, force) as directory, progress:
        progress.begin("strokes of the process")
        write_process(study, directory)
    if not quiet:
        print(f"{process_digest(study)}\n\nresults: {place}")


@app.command
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
    given = _scene(scene, quiet, changes)
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
    out: Path | None = None,
    engine: Engine = None,
    tolerance: float | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
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
    out
        folder of the results; default out/NAME-sweep, NAME as in `compact run`
    tolerance
        relative error tolerance that replaces the tolerance of the scene
    """
    from compact.analysis.worker_pool import choose_executor
    from compact.report import sweep_writer
    from compact.report.progress import Progress
    from compact.sweep import design as varying
    from compact.sweep import sobol_indices
    from compact.sweep.corrected import create_sweep

    workforce = choose_executor(workers, scheduler)
    asked = {"accuracy.engine": engine, "accuracy.tolerance": tolerance}
    given, varied = _scene(scene, quiet, changes, asked), [varying.read_design(text) for text in vary]
    many = create_sweep(given, varied, rank=rank, indices=sobol, direct=direct)
    directory, failed = out or default_directory(scene, "sweep"), 0

    def step(points: int, failures: int) -> None:
        nonlocal failed
        failed += failures
        progress.advance(points)
        progress.report(f"{failed} failed" if failed else "")

    with Progress(total=many.steps, quiet=quiet) as progress:
        progress.begin(f"{many.steps} points", 0.0)
        table = many.run(directory, executor=workforce, resume=resume, force=force, step=step)
    indices = sobol_indices.of_table(table)
    sweep_writer.write_sweep_report(directory, table, indices)
    if not quiet:
        for name in many.broken:
            print(f"compact: {name} was incomplete; its points have been computed again", file=sys.stderr)
        digest = sweep_writer.sweep_digest(table, indices)
        print(f"{digest}\n\n{many.computed} of {many.needed} computed now; results: {directory}")
    return SUCCESS if (table["reason"] == "").any() else _print_error("no point has a result", NO_RESULT)


@app.command
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
        return _print_error(f"{len(changed)} of {len(rows)} computed numbers have changed", NO_RESULT)
    print(f"\n{len(rows)} numbers checked: all are unchanged")
    return SUCCESS


@app.command
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
    return _print_error(f"{moved} computed numbers have moved from the recorded ones", NO_RESULT) if moved else SUCCESS


def _study(
    path: Path,
    quiet: bool,
    replacements: Mapping[str, object],
    changes: Sequence[str] = (),
    step: Callable[[str], None] = lambda _: None,
    directory: Path | None = None,
    progress: Callable[[str], None] | None = None,
    durations: Sequence[float] = (),
) -> "Study":
    """Load a scene file with some of its keys replaced, and return its study."""
    from compact.analysis.study import Study

    return Study(_scene(path, quiet, changes, replacements), step, directory, progress, durations)


def _scene(
    path: Path, quiet: bool, changes: Sequence[str] = (), replacements: Mapping[str, object] | None = None
) -> "Scene":
    """Load a scene file with some of its keys replaced, and print the advice on it."""
    from compact.scene.loader import load_scene, read_change

    wanted = dict(replacements or {}) | dict(map(read_change, changes))
    scene = load_scene(path, **{key: value for key, value in wanted.items() if value is not None})
    for sentence in scene.advice if not quiet else ():
        print(f"compact: advice: {sentence}", file=sys.stderr)
    return scene


if __name__ == "__main__":
    main()
