"""Options that commands share, exit codes, and the scene of a command."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from compact.files import claimed_directory, default_directory, json_text
from compact.report.progress import Progress

if TYPE_CHECKING:
    from compact.scene.loader import Scene

SUCCESS, NO_RESULT, INVALID_INPUT = 0, 1, 2
MESSAGE_LIMIT, MESSAGE_END = 1000, 400  # [characters], longest message; kept of each end of a longer one

ScenePath = Annotated[Path, Parameter(help="scene file in TOML, or name of a published scene, such as loveikin-2015")]
Flag = Annotated[bool, Parameter(negative="", show_default=False)]


@Parameter(name="*")
@dataclass(frozen=True)
class Console:
    """Output of a command on the terminal: options of every command that computes.

    Parameters
    ----------
    quiet
        print errors only
    json
        print the results as JSON in place of the digest
    verbose
        log stages and files; twice: iterations of solvers too
    profile
        print where the time went, stage by stage
    """

    quiet: Flag = False
    json: Flag = False
    verbose: Annotated[int, Parameter(count=True, show_default=False)] = 0
    profile: Flag = False

    def progress(self, total: int | None = None) -> Progress:
        """Return the line of progress, of a job of some parts, or of unknown extent."""
        return Progress(total=total, quiet=self.quiet or bool(self.verbose))

    def show(self, digest: Callable[[], str], results: Path | None = None, **content: Any) -> None:
        """Print the digest and the place of the results, or the content as JSON.

        Parameters
        ----------
        digest : callable
            Returns the text; not called where it is not printed.
        results : Path, optional
            Folder or file of the results.
        **content : object
            What the option --json prints.
        """
        place = {} if results is None else {"results": results}
        if self.json:
            print(json_text(place | content))
        elif not self.quiet:
            print("\n\n".join([digest(), *(f"results: {path}" for path in place.values())]))


@Parameter(name="*")
@dataclass(frozen=True)
class Job(Console):
    """Options of every command that computes a scene.

    Parameters
    ----------
    out
        folder of the results; default out/NAME-CHANGES-COMMAND, NAME of the scene file or its folder
    changes
        change a key of the scene, as mix.moisture=0.11; KEY= removes it; repeatable
    """

    out: Path | None = None
    changes: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = ()

    def place(self, path: Path, scene: "Scene", suffix: str = "") -> Path:
        """Return the folder or file of the results; a changed value of the scene enters the name."""
        return self.out or default_directory(path, suffix, scene.changed_values)

    def read(self, path: Path, **replacements: object) -> "Scene":
        """Load a scene file with some of its keys replaced, and print the advice on it.

        Parameters
        ----------
        path : Path
            Scene file.
        **replacements : object
            Values by key of the scene, None for the value of the scene; those of the option --set come before.
        """
        from compact.scene.loader import load_scene, read_change

        given = {key: value for key, value in replacements.items() if value is not None}
        scene = load_scene(path, **given | dict(map(read_change, self.changes)))
        for sentence in scene.advice if not self.quiet else ():
            print(f"compact: advice: {sentence}", file=sys.stderr)
        return scene


@Parameter(name="*")
@dataclass(frozen=True)
class OwningJob(Job):
    """Options of a command whose folder holds results of one scene.

    Parameters
    ----------
    force
        overwrite the results of another scene
    """

    force: Flag = False

    @contextmanager
    def writing(self, path: Path, suffix: str, scene: "Scene") -> Iterator[tuple[Path, Progress]]:
        """Claim the folder of the results of a scene file inside the block, and show the line of progress."""
        progress = self.progress()
        with claimed_directory(self.place(path, scene, suffix), scene.owner, self.force) as directory, progress:
            yield directory, progress


@Parameter(name="*")
@dataclass(frozen=True)
class EngineJob(OwningJob):
    """Options of a command that computes contacts.

    Parameters
    ----------
    engine
        contact engine that replaces the engine of the scene
    """

    engine: Literal["auto", "formula", "column", "spectral", "fem", "compaction", "process"] | None = None

    def read(self, path: Path, **replacements: object) -> "Scene":
        """Load a scene file with the engine of the option, as `Job.read`."""
        return super().read(path, **{"accuracy.engine": self.engine} | replacements)


@dataclass(frozen=True)
class NewMachine:
    """Machine of `compact new`.

    Parameters
    ----------
    rollers
        number of rollers side by side
    diameter
        of a roller, m
    plate
        WIDTHxLENGTHxHEIGHT of the plate or mould in m, along the travel, along the rollers, and up
    stroke
        from end to end, m
    duration
        of one stroke, s
    mass
        of the cart, kg
    moisture
        water mass / dry mass, 0.10 for 10 %
    density_ratio
        density of the product / density without air
    """

    rollers: float | None = None  # cyclopts would cut 2.5 to a whole number
    diameter: float | None = None
    plate: str | None = None
    stroke: float | None = None
    duration: float | None = None
    mass: float | None = None
    moisture: float | None = None
    density_ratio: float | None = None

    def given(self) -> dict[str, Any]:
        """Return the options that are given, the plate as three lengths [m]."""
        from compact.scene.new_scene import read_plate

        read: dict[str, Any] = {"plate": read_plate, "rollers": lambda count: int(count) if count % 1 == 0 else count}
        return {name: read.get(name, float)(value) for name, value in vars(self).items() if value is not None}


CONSOLE, JOB, OWNING_JOB, ENGINE_JOB = Console(), Job(), OwningJob(), EngineJob()  # without options


@contextmanager
def interrupt_noted(sentence: Callable[[], str]) -> Iterator[None]:
    """Add a note to an interrupt inside the block: what is kept, and how it is used."""
    try:
        yield
    except BaseException as error:
        if is_interrupt(error):
            error.add_note(sentence())
        raise


def is_interrupt(error: BaseException) -> bool:
    """Return True for Ctrl-C, also while compiled code converts its result."""
    return isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt)


def print_error(message: object, code: int) -> int:
    """Print an error, the middle of a long one left out, and return the exit code.

    Parameters
    ----------
    message : object
        Message or exception.
    code : int
        Exit code.

    Returns
    -------
    int
        The exit code.
    """
    text = str(message)
    if len(text) > MESSAGE_LIMIT:  # an iteration history: its beginning and its end
        text = f"{text[:MESSAGE_END]} ... {text[-MESSAGE_END:]}"
    print(f"compact: {text}", file=sys.stderr)
    return code
