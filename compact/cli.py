"""The command `compact`: thin doors to scene, study, report, cam and check; exit 0 done, 1 could not, 2 bad input.

Heavy modules are imported inside the commands, so that help answers at once.
"""

import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter

from compact.results import ResultsError

Engine = Literal["formula", "column", "spectral", "fem", "compaction"]
Changes = Annotated[tuple[str, ...], Parameter(name="--set", negative="")]
DONE, COULD_NOT, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
BAR_AFTER = 2.0  # seconds before a progress bar shows

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
        return app(arguments, exit_on_error=False, print_error=True, result_action="return_value") or DONE
    except CycloptsError:  # printed by cyclopts, with the nearest option
        return BAD_INPUT
    except RuntimeError as error:  # ResultsError, or an engine that did not converge
        return _say(error, COULD_NOT)
    except ValueError as error:  # SceneError and the refusals of the formulas
        return _say(error, BAD_INPUT)
    except KeyboardInterrupt:
        return _say("interrupted; every file already written is whole", INTERRUPTED)
    except BrokenPipeError:
        raise
    except Exception as error:
        if os.environ.get("COMPACT_TRACEBACK"):
            raise
        return _say(
            f"internal error, please report it: {type(error).__name__}: {error} (COMPACT_TRACEBACK=1 shows where)",
            COULD_NOT,
        )


def _say(message, code):
    print(f"compact: {message}", file=sys.stderr)
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
    from compact.results import whole_file
    from compact.scene import starter_scene

    path = directory / "scene.toml"
    if path.exists():
        raise ResultsError(f"{path}: exists already; give another directory")
    with whole_file(path) as stream:
        stream.write(starter_scene())
    print(f"{path} written; next: compact run {path}")


@app.command
def run(
    scene: Path,
    /,
    *,
    out: Path | None = None,
    engine: Engine | None = None,
    tolerance: float | None = None,
    changes: Changes = (),
    force: bool = False,
    quiet: bool = False,
):
    """Do the main job: resistance, every law, forces, ranking, cams, tables and figures.

    Parameters
    ----------
    scene
        the scene, a TOML file
    out
        directory for the results; out/NAME OF THE SCENE unless given
    engine
        contact engine in place of the scene's
    tolerance
        relative error asked for in place of the scene's
    changes
        change a key of the scene, such as mix.moisture=0.11; as often as needed
    force
        overwrite the results of another scene
    quiet
        say nothing but errors
    """
    from compact import report

    study, bar = _study(scene, quiet, engine, tolerance, changes=changes)
    directory = out or Path("out") / scene.stem
    with bar:
        report.write(study, directory, force)
    if not quiet:
        print(report.digest(study))
        print(f"\nresults: {directory}")


@app.command
def roll(
    scene: Path,
    /,
    *,
    speed: float | None = None,
    engine: Engine | None = None,
    out: Path | None = None,
    changes: Changes = (),
    force: bool = False,
    quiet: bool = False,
):
    """Compute one contact of roller and layer: load, resistance, edges, pressure.

    Parameters
    ----------
    scene
        the scene, a TOML file
    speed
        of the cart in m/s; its mean speed unless given
    engine
        contact engine in place of the scene's
    out
        directory for the results; out/NAME OF THE SCENE-contact unless given
    changes
        change a key of the scene, such as machine.rolling='frictionless'; as often as needed
    force
        overwrite the results of another scene
    quiet
        say nothing but errors
    """
    from compact import engine as engines
    from compact import report
    from compact.results import claim

    study, _ = _study(scene, quiet, engine, changes=changes)
    speed = speed if speed is not None else study.scene.motion.stroke / study.scene.motion.duration
    rolled = engines.roll(study.scene, study.mix, speed)
    directory = claim(out or Path("out") / f"{scene.stem}-contact", study.scene.hash, force)
    report.write_contact(directory, study, speed, rolled)
    if not quiet:
        print(report.contact_digest(study, speed, rolled))
        print(f"\nresults: {directory}")


@app.command
def cam(
    scene: Path,
    /,
    *,
    law: str,
    follower: Literal["pointed", "roller", "flat"] = "roller",
    out: Path | None = None,
    quiet: bool = False,
):
    """Make the cam of constant breadth for one law: its profile as CSV, its sizes on the screen.

    Parameters
    ----------
    scene
        the scene, a TOML file with a table [cam]
    law
        name of the motion law
    follower
        what runs on the cam
    out
        the CSV file; out/cam-LAW-FOLLOWER.csv unless given
    quiet
        say nothing but errors
    """
    from compact import report

    study, _ = _study(scene, quiet, laws=(law,))
    path = out or Path("out") / f"cam-{law}-{follower}.csv"
    made = study.cam(law, follower)
    report.write_cam(path, made)
    if not quiet:
        print(report.cam_digest(law, made))
        print(f"\nprofile: {path}")


@app.command
def check():
    """Print every published number beside ours with the verdict; exit 1 if our side has changed."""
    from compact import published

    rows = published.rows()
    print(published.table(rows))
    changed = [row for row in rows if not row.kept]
    if changed:
        return _say(f"{len(changed)} of {len(rows)} numbers on our side have changed", COULD_NOT)
    print(f"\n{len(rows)} numbers checked: our side is unchanged")
    return DONE


def _study(path, quiet, engine=None, tolerance=None, laws=None, changes=()):
    """The study of a scene file, and the bar that counts its stages."""
    from tqdm import tqdm

    from compact.scene import load_scene
    from compact.study import Study

    asked = {"accuracy.engine": engine, "accuracy.tolerance": tolerance, "motion.laws": laws}
    asked |= dict(_change(change) for change in changes)
    scene = load_scene(path, **{key: value for key, value in asked.items() if value is not None})
    for sentence in scene.advice if not quiet else ():
        print(f"compact: advice: {sentence}", file=sys.stderr)
    bar = tqdm(disable=quiet or not sys.stderr.isatty(), delay=BAR_AFTER, unit=" steps", leave=False)

    def step(stage):
        bar.set_description(stage, refresh=False)
        bar.update()

    study = Study(scene, step)
    bar.total = study.steps
    return study, bar


def _change(text):
    """Key path and value of KEY=VALUE; the value is read as in a scene, or as a bare word."""
    import tomllib

    key, equals, value = text.partition("=")
    if not (key and equals):
        raise ValueError(f"--set takes KEY=VALUE, such as mix.moisture=0.11, got {text!r}")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


if __name__ == "__main__":
    main()
