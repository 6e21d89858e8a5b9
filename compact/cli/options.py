"""Options that commands share, exit codes, and the scene or study of a command."""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from compact.analysis.study import Study
    from compact.scene.loader import Scene

SUCCESS, NO_RESULT, INVALID_INPUT, INTERRUPTED = 0, 1, 2, 130
MESSAGE_LIMIT, MESSAGE_END = 1000, 400  # [characters], longest message; kept of each end of a longer one

ScenePath = Annotated[Path, Parameter(help="scene file in TOML")]
Engine = Annotated[
    Literal["formula", "column", "spectral", "fem", "compaction", "process"] | None,
    Parameter(help="contact engine that replaces the engine of the scene"),
]
Changes = Annotated[
    tuple[str, ...],
    Parameter(name="--set", negative="", help="change one key of the scene, such as mix.moisture=0.11; repeatable"),
]
Force = Annotated[bool, Parameter(help="overwrite the results of another scene")]
Quiet = Annotated[bool, Parameter(help="print errors only")]


def read_study(
    path: Path,
    quiet: bool,
    replacements: Mapping[str, object],
    changes: Sequence[str] = (),
    step: Callable[[str], None] = lambda _: None,
    directory: Path | None = None,
    progress: Callable[[str], None] | None = None,
    durations: Sequence[float] = (),
) -> "Study":
    """Load a scene file with some of its keys replaced, and return its study.

    Parameters
    ----------
    path : Path
        Scene file.
    quiet : bool
        True to print no advice.
    replacements : mapping
        Values by key of the scene, None for the value of the scene.
    changes : sequence of str
        Changes of the option --set, KEY=VALUE.
    step, directory, progress, durations
        Parameters of `Study`.

    Returns
    -------
    Study
    """
    from compact.analysis.study import Study

    return Study(read_scene(path, quiet, changes, replacements), step, directory, progress, durations)


def read_scene(
    path: Path, quiet: bool, changes: Sequence[str] = (), replacements: Mapping[str, object] | None = None
) -> "Scene":
    """Load a scene file with some of its keys replaced, and print the advice on it.

    Parameters
    ----------
    path, quiet, changes, replacements
        As of `read_study`.

    Returns
    -------
    Scene
    """
    from compact.scene.loader import load_scene, read_change

    wanted = dict(replacements or {}) | dict(map(read_change, changes))
    scene = load_scene(path, **{key: value for key, value in wanted.items() if value is not None})
    for sentence in scene.advice if not quiet else ():
        print(f"compact: advice: {sentence}", file=sys.stderr)
    return scene


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
