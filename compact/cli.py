"""The command `compact`: thin doors to scene, study, report, cam and check; exit 0 done, 1 could not, 2 bad input.

Heavy modules are imported inside the commands, so that help answers at once.
"""

import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from compact.analysis.numerical_failures import is_numeric, memory_sentence, numeric_sentence
from compact.files import ResultsError, default_directory

DONE, COULD_NOT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
STOPPED = "interrupted; every file already written is whole"
LONGEST, KEPT = 1000, 400  # characters of a message; of a longer one, kept of its beginning and of its end

# options that several commands share
ScenePath = Annotated[Path, Parameter(help="the scene, a TOML file")]
Engine = Annotated[
    Literal["formula", "column", "spectral", "fem", "compaction"] | None,
    Parameter(help="contact engine in place of the scene's"),
]
Changes = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set", negative="", help="change a key of the scene, such as mix.moisture=0.11; as often as needed"
    ),
]
Force = Annotated[bool, Parameter(help="overwrite the results of another scene")]
Quiet = Annotated[bool, Parameter(help="say nothing but errors")]

app = App(
    name="compact",
    help="Roller-compaction loads: from a scene (machine, mix, motion) to ranked motion laws.",
    help_format="plaintext",
    suppress_keyboard_interrupt=False,  # told in `main`
)


def main():
    """Run the command line; every failure is a sentence and an exit code, never a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        code = _told(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = DONE
    sys.exit(code)


def _told(arguments):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # a number that numpy warns of is no result
            warnings.filterwarnings("default", ".*accepted for one release", DeprecationWarning)
            return app(arguments, exit_on_error=False, print_error=True, result_action="return_value") or DONE
    except CycloptsError:  # printed by cyclopts, with the nearest option
        return BAD_INPUT
    except MemoryError as error:
        return _say(memory_sentence(error), COULD_NOT)
    except (RuntimeWarning, ArithmeticError, ValueError) as error:  # SceneError and the refusals of the formulas
        if not is_numeric(error):
            return _say(error, BAD_INPUT)
        if os.environ.get("COMPACT_TRACEBACK"):
            raise
        return _say(f"{numeric_sentence(error)} (COMPACT_TRACEBACK=1 shows where)", COULD_NOT)
    except RuntimeError as error:  # ResultsError, or an engine that did not converge
        return _say(error, COULD_NOT)
    except KeyboardInterrupt:
        return _say(STOPPED, INTERRUPTED)
    except BrokenPipeError:
        raise
    except Exception as error:
        if isinstance(error.__cause__, KeyboardInterrupt):  # came in while compiled code made its result
            return _say(STOPPED, INTERRUPTED)
        if os.environ.get("COMPACT_TRACEBACK"):
            raise
        return _say(
            f"internal error, please report it: {type(error).__name__}: {error} (COMPACT_TRACEBACK=1 shows where)",
            COULD_NOT,
        )


def _say(message, code):
    text = str(message)
    if len(text) > LONGEST:  # a history: how it began and how it ended
        text = f"{text[:KEPT]} ... {text[-KEPT:]}"
    print(f"compact: {text}", file=sys.stderr)
    return code


def _warn_in_a_line(message, category, filename, lineno, line=None):
    return f"compact: warning: {message}\n"


warnings.formatwarning = _warn_in_a_line


@app.command
def new(directory: Path, /):
    """Write a commented scene that runs.

    Parameters
    ----------
    directory
        where scene.toml is written; made if need be, a scene that stands there is kept
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
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
):
    """Do the main job: resistance by every engine, every law, forces, ranking, cams, tables and figures.

    Parameters
    ----------
    out
        directory for the results; out/NAME unless given, NAME that of the scene file, or of the folder of a scene.toml
    tolerance
        relative error asked for in place of the scene's
    """
    from compact.analysis.worker_pool import Processes, cores
    from compact.report import text
    from compact.report import writer as report
    from compact.report.progress import Progress

    progress = Progress(quiet=quiet)
    directory = out or default_directory(scene)
    study = _study(
        scene, quiet, engine, tolerance, changes=changes, directory=directory,
        step=lambda stage: progress.begin(stage, study.cost(stage), total=study.whole_cost), progress=progress.report,
    )  # fmt: skip
    progress.total = study.whole_cost
    others = study.scene.compared_engines if study.scene.compare and cores() > 1 else ()
    helpers = Processes(min(cores(), len(others))) if others else None
    with progress:
        report.write_study(study, directory, force, helpers)
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
    out: Path | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
):
    """Compute one contact of roller and layer: load, resistance, edges, pressure, fields; every pass of a layer that
    stays pressed.

    Parameters
    ----------
    speed
        of the cart in m/s; its mean speed unless given
    out
        directory for the results; out/NAME-ENGINE unless given, NAME as of `compact run`
    """
    from compact.files import claimed_directory
    from compact.report import contact_tables, text
    from compact.report.progress import Progress
    from compact.scene.plausible_ranges import check_speed

    progress = Progress(quiet=quiet)
    study = _study(scene, quiet, engine, changes=changes, progress=progress.report)
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
):
    """Make the cam of constant breadth for one law: CSV of its points, SVG and DXF for the workshop, and it in motion.

    The scene needs a table [cam].

    Parameters
    ----------
    law
        name of the motion law; of one that [motion.optimise] makes least-peak-force and the like
    follower
        what runs on the cam
    cutter
        radius of the cutter in m; its centre's path is given besides
    tolerance
        in m, within which a follower on the exported points keeps to its law
    out
        directory; out/NAME-cams unless given, NAME as of `compact run`
    """
    from compact.cams import export as cam_files
    from compact.report import text

    study = _study(scene, quiet, laws=None if law.startswith("least-") else (law,), changes=changes)
    made = study.cam(law, follower)
    written = cam_files.write_cam_files(out or default_directory(scene, "cams"), study.scene, made, cutter, tolerance)
    if not quiet:
        print(text.cam_digest(law, made))
        print("\n".join(f"  {path}" for path in written))


@app.command
def calibrate(
    scene: ScenePath,
    measured: Path,
    /,
    *,
    fit: tuple[Literal["heckel_slope", "fed_density_ratio"], ...] = ("heckel_slope", "fed_density_ratio"),
    engine: Literal["column", "compaction"] = "column",
    increments: int | None = None,
    out: Path | None = None,
    changes: Changes = (),
    quiet: Quiet = False,
):
    """Fit Heckel's slope and the fed density of a scene to what its plant has measured.

    Parameters
    ----------
    measured
        TOML or CSV of measured load, resistance and exit density
    fit
        what is fitted; at most as many as there are data
    engine
        contact engine of every trial: columns in a second, finite elements in minutes
    increments
        of travel per contact length, of finite elements; 6 are a part of the work of 12 and differ by 2 %
    out
        the JSON file; out/NAME-calibration.json unless given, NAME as of `compact run`
    """
    from compact.analysis import calibration
    from compact.files import write_json
    from compact.report.progress import spinning
    from compact.scene.plant_data import read_measurements

    readings = read_measurements(measured)
    options = {} if increments is None else {"increments": increments}
    asked = _scene(scene, quiet, changes)
    with spinning(f"fit by {engine}", quiet=quiet):
        found = calibration.calibrate(asked, readings, engine, fit, **options)
    path = out or default_directory(scene, "calibration.json")
    write_json(path, calibration.summary(found))
    if not quiet:
        print(calibration.digest(found))
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
    indices: bool = False,
    out: Path | None = None,
    engine: Engine = None,
    tolerance: float | None = None,
    changes: Changes = (),
    force: Force = False,
    quiet: Quiet = False,
):
    """Compute many scenes: keys varied on grids, lists or samples of the mix's spread, into one labelled netCDF.

    Parameters
    ----------
    vary
        KEY=LOW:HIGH:N, KEY=A,B,C, or mix.overrides.NAME=~N for N Sobol points over its spread; as often as needed
    workers
        processes on this machine; as many as it has processors unless given, 1 computes in the command itself
    scheduler
        address of a dask scheduler, such as tcp://host:8786, whose workers compute instead
    resume
        go on with what an interrupted sweep has left
    rank
        rank the motion laws at every point too
    indices
        take the sample so that Sobol indices tell what the spread comes from
    out
        directory for the results; out/NAME-sweep unless given, NAME as of `compact run`
    tolerance
        relative error asked for in place of the scene's
    """
    from compact.analysis.worker_pool import crew
    from compact.report import sweep_writer
    from compact.report.progress import Progress
    from compact.sweep import design as varying
    from compact.sweep.run import Sweep

    workforce = crew(workers, scheduler)
    asked = {"accuracy.engine": engine, "accuracy.tolerance": tolerance}
    many = Sweep(
        _scene(scene, quiet, changes, asked), [varying.read_design(text) for text in vary], rank=rank, indices=indices
    )
    directory, failed = out or default_directory(scene, "sweep"), 0

    def step(points, failures):
        nonlocal failed
        failed += failures
        progress.advance(points)
        progress.report(f"{failed} failed" if failed else "")

    with Progress(total=many.size, quiet=quiet) as progress:
        progress.begin(f"{many.size} points", 0.0)
        table = many.run(directory, crew=workforce, resume=resume, force=force, step=step)
    sweep_writer.write_sweep_report(directory, table)
    if not quiet:
        for name in many.broken:
            print(f"compact: {name} was cut short; its points were computed again", file=sys.stderr)
        print(
            f"{sweep_writer.sweep_digest(table)}\n\n{many.computed} of {many.size} computed now; results: {directory}"
        )
    return DONE if (table["reason"] == "").any() else _say("no point has numbers", COULD_NOT)


@app.command
def check(*, markdown: bool = False):
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
        return _say(f"{len(changed)} of {len(rows)} computed numbers have changed", COULD_NOT)
    print(f"\n{len(rows)} numbers checked: all are unchanged")
    return DONE


def _study(
    path,
    quiet,
    engine=None,
    tolerance=None,
    laws=None,
    changes=(),
    step=lambda stage: None,
    directory=None,
    progress=None,
):
    """The study of a scene file with some of its keys changed."""
    from compact.analysis.study import Study

    asked = {"accuracy.engine": engine, "accuracy.tolerance": tolerance, "motion.laws": laws}
    return Study(_scene(path, quiet, changes, asked), step, directory, progress)


def _scene(path, quiet, changes=(), asked=()):
    """The scene of a file with some of its keys changed; its advice is told."""
    from compact.scene.loader import load_scene, read_change

    asked = dict(asked) | dict(map(read_change, changes))
    scene = load_scene(path, **{key: value for key, value in asked.items() if value is not None})
    for sentence in scene.advice if not quiet else ():
        print(f"compact: advice: {sentence}", file=sys.stderr)
    return scene


if __name__ == "__main__":
    main()
