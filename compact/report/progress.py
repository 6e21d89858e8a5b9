"""Progress of a long job on the terminal, log of a command on standard error, and profile of its time by stage.

    with Progress(total=len(cases)) as progress:
        progress.begin("contact")
        ...
        progress.advance()

    for case in tracked(cases, "case"):
        ...

The line is refreshed by its own thread, and is erased at the end. In a notebook it is plain text. It names a function
that is being compiled. Nothing is written where standard error is no terminal or a dumb one, or where `quiet` is set.

Loggers are those of the standard library below "compact": `compact.stages` has the stages of a job (INFO) and the
iterations of its solvers (DEBUG), `compact.files` every file that is complete (INFO), `compact.analysis.worker_pool`
workers that died (INFO). A program that uses the package configures them as any other logger. A stage lasts until the
next one begins. Its time is wall time and processor time of this process; the processor time of worker processes is
known at their end, as a sum.
"""

import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from time import monotonic, process_time
from typing import Any, Self, TextIO, TypeVar

REFRESH_RATE = 4  # [1/s]
PLAIN_WIDTH = 100  # characters of the line in a notebook
STAGES = "compact.stages"  # logger of the stages, INFO, and of the lines of text on them, DEBUG
PACKAGE = "compact"  # parent of all loggers
BEFORE = "start"  # stage before the first one: imports and the scene
LINE = "%(relativeCreated)10d ms  %(name)s: %(message)s"  # of the log
ROW = "{:<{}}{:>15}{:>15}{:>15}{:>15}"  # of the profile

_LOG, _COMPILER = logging.getLogger(STAGES), logging.getLogger(f"{PACKAGE}.numerics.jit")
_RUNNING: list[Any] = []  # lines, the outer one first
Item = TypeVar("Item")


class Progress:
    """Line of progress on standard error, inside a `with` block.

    Parameters
    ----------
    total : int, optional
        Number of parts of the job, which `advance` counts.

    Attributes
    ----------
    stage, detail : str
        Running stage, and a line of text on it.
    """

    def __init__(self, *, total: int | None = None, quiet: bool = False, stream: TextIO | None = None) -> None:
        from rich import progress
        from rich.console import Console

        file, hidden = stream or sys.stderr, quiet or bool(_RUNNING)  # the outer line shows
        self._plain = not hidden and stream is None and "ipykernel" in sys.modules  # a notebook
        counted = [progress.MofNCompleteColumn(separator=" of ")] if total else []
        parts: list[Any] = [progress.SpinnerColumn("line"), progress.TimeElapsedColumn(), "elapsed", *counted]
        self._line = progress.Progress(
            *parts, "{task.description}", console=Console(file=file), transient=True, refresh_per_second=REFRESH_RATE,
            disable=hidden or not file.isatty(),
        )  # fmt: skip
        self._task = self._line.add_task("", total=total)
        self.stage, self.detail, self._runs = "", "", 0

    def begin(self, stage: str) -> None:
        """Begin a stage; stages of one name in a row are counted."""
        _LOG.info("%s", stage)
        self._runs = self._runs + 1 if stage == self.stage else 1
        self.stage = stage
        self.report("")

    def advance(self, parts: int = 1) -> None:
        """Count parts of the job that are done."""
        self._line.advance(self._task, parts)

    def report(self, detail: str) -> None:
        """Show a line of text on the running stage; the callback of solvers."""
        self.detail = detail
        if detail:
            _LOG.debug("%s", detail)
        stage = f"{self.stage} {self._runs}" if self._runs > 1 else self.stage
        self._show(", ".join(filter(None, (stage, detail))))

    def _show(self, words: str) -> None:
        self._line.update(self._task, description=words)
        if self._plain:
            print(f"\r{words:<{PLAIN_WIDTH}.{PLAIN_WIDTH}}", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        self._notice = logging.Handler(logging.INFO)  # shows what is being compiled
        self._notice.emit = lambda record: self.report(record.getMessage())  # type: ignore[method-assign]
        _COMPILER.addHandler(self._notice)
        _COMPILER.setLevel(logging.INFO)
        _RUNNING.append(self)
        self._line.start()
        return self

    def __exit__(self, *error: object) -> None:
        _COMPILER.removeHandler(self._notice)
        _RUNNING.remove(self)
        self._show("")
        self._line.stop()


def tracked(items: Iterable[Item], stage: str | Callable[[Item], str] = "case", **options: Any) -> Iterator[Item]:
    """Iterate over items while a line of `Progress` counts them.

    Parameters
    ----------
    items : iterable
        Items; a list is made of them.
    stage : str or callable
        Name of the stage, or a function of the item that returns it.
    """
    cases = list(items)
    with Progress(total=len(cases), **options) as progress:
        for case in cases:
            progress.begin(stage(case) if callable(stage) else stage)
            yield case
            progress.advance()


@contextmanager
def spinning(stage: str, **options: Any) -> Iterator[Progress]:
    """Show one stage with a spinner and the elapsed time."""
    with Progress(**options) as progress:
        progress.begin(stage)
        yield progress


class StageProfile(logging.Handler):
    """Handler that measures the time between the records of stages."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._begun = [(BEFORE, monotonic(), 0.0)]  # name, wall time and processor time of this process [s]
        self._children = _children_time()

    def emit(self, record: logging.LogRecord) -> None:
        """Begin the stage of a record."""
        if record.levelno == logging.INFO:
            self._begun.append((record.getMessage(), monotonic(), process_time()))

    def table(self) -> str:
        """Return the stages as lines of text, the longest first, with their sum."""
        found: dict[str, Any] = {}
        for (name, *begin), (_, *end) in pairwise([*self._begun, ("", monotonic(), process_time())]):
            runs, wall, processor = found.get(name, (0, 0.0, 0.0))
            found[name] = runs + 1, wall + end[0] - begin[0], processor + end[1] - begin[1]
        total, width = [sum(each[place] for each in found.values()) for place in (1, 2)], max(map(len, found))
        ordered: list[tuple[str, Any]] = sorted(found.items(), key=lambda item: -item[1][1])
        lines = [ROW.format("stage", width, "runs", "wall [s]", "processor [s]", "share")]
        for name, (runs, *times) in [*ordered, ("total", ("", *total))]:
            lines.append(
                ROW.format(name, width, runs, *(f"{each:.2f}" for each in times), f"{times[0] / total[0]:.0%}")
            )
        children = _children_time() - self._children
        return "\n".join([*lines, *([f"worker processes: {children:.2f} s of processor time"] if children else [])])


def _children_time() -> float:
    """Processor time of worker processes that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


@contextmanager
def logged(verbose: int, profile: bool, quiet: bool) -> Iterator[None]:
    """Log to standard error inside the block, and print the profile at its end.

    Parameters
    ----------
    verbose : int
        0 for warnings and errors, 1 for stages and files, 2 for the iterations of solvers too.
    profile : bool
        True to print the time of every stage.
    quiet : bool
        True for errors only.
    """
    package, measured = logging.getLogger(PACKAGE), StageProfile()
    stream, level = logging.StreamHandler(sys.stderr), package.level
    stream.setFormatter(logging.Formatter(LINE))
    handlers = [(package, stream)] * bool(verbose) + [(logging.getLogger(STAGES), measured)] * profile
    for logger, handler in handlers:
        logger.addHandler(handler)
    least = logging.ERROR if quiet else logging.WARNING
    package.setLevel(logging.DEBUG if verbose > 1 else logging.INFO if verbose or profile else least)
    try:
        yield
    finally:
        for logger, handler in handlers:
            logger.removeHandler(handler)
        package.setLevel(level)
        if profile:
            print(f"\n{measured.table()}", file=sys.stderr)
