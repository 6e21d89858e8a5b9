"""Progress of a long job on the terminal: stage, parts that are done, and elapsed time.

    with Progress(total=len(cases)) as progress:
        progress.begin("contact")
        ...
        progress.advance()

    for case in tracked(cases, "case"):
        ...

The line appears after two seconds, is refreshed by its own thread, and is erased at the end. Nothing is written where
standard error is no terminal or a dumb one, or where `quiet` is set.
"""

import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Timer
from time import monotonic
from typing import TYPE_CHECKING, Any, Self, TextIO, TypeVar

if TYPE_CHECKING:
    from rich.live import Live
    from rich.spinner import Spinner
    from rich.table import Table

DELAY = 2.0  # [s], before the line appears
REFRESH_RATE = 4  # [1/s]

STAGES = "compact.stages"  # logger of the stages, INFO, and of the lines of text on them, DEBUG

_LOG = logging.getLogger(STAGES)
Item = TypeVar("Item")


class Progress:
    """Line of progress on standard error, inside a `with` block.

    Parameters
    ----------
    total : int, optional
        Number of parts of the job, which `advance` counts.
    after : float, optional
        Delay before the line appears [s]; `DELAY` by default.
    clock : callable
        Monotonic time [s].

    Attributes
    ----------
    stage, detail : str
        Running stage, and a line of text on it.
    done : int
        Parts that are done.
    """

    def __init__(
        self,
        *,
        total: int | None = None,
        quiet: bool = False,
        stream: TextIO | None = None,
        after: float | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._stream = sys.stderr if stream is None else stream
        self.silent = quiet or not self._stream.isatty()
        self._delay, self._clock = DELAY if after is None else after, clock
        self._start = clock()
        self._line: Live | None = None
        self._timer: Timer | None = None
        self._spinner: Spinner | None = None
        self.stage, self.detail, self.total = "", "", total
        self.done = self._runs = 0

    def begin(self, stage: str) -> None:
        """Begin a stage; stages of one name in a row are counted."""
        _LOG.info("%s", stage)
        self._runs = self._runs + 1 if stage == self.stage else 1
        self.stage, self.detail = stage, ""

    def advance(self, parts: int = 1) -> None:
        """Count parts of the job that are done."""
        self.done += parts

    def report(self, detail: str) -> None:
        """Show a line of text on the running stage; the callback of solvers."""
        self.detail = detail
        if detail:
            _LOG.debug("%s", detail)

    @property
    def elapsed(self) -> float:
        """Time since the start of the job [s]."""
        return self._clock() - self._start

    def __enter__(self) -> Self:
        self._start = self._clock()
        if not self.silent:
            self._timer = Timer(self._delay, self._show)
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()  # a line that is about to appear must exist before it is erased
        if self._line is not None:
            self._line.stop()

    def _show(self) -> None:
        from rich.console import Console
        from rich.live import Live

        console = Console(file=self._stream)
        self._line = Live(get_renderable=self._render, console=console, transient=True, refresh_per_second=REFRESH_RATE)
        self._line.start(refresh=True)

    def _render(self) -> "Table":
        from rich.spinner import Spinner
        from rich.table import Table

        self._spinner = self._spinner or Spinner("line")
        stage = f"{self.stage} {self._runs}" if self._runs > 1 else self.stage
        parts = "" if self.total is None else f"{self.done} of {self.total}"
        line = Table.grid(padding=(0, 1))
        text = ", ".join(filter(None, (stage, parts, self.detail)))
        line.add_row(self._spinner, f"{format_time(self.elapsed)} elapsed", text)
        return line


def format_time(seconds: float) -> str:
    """Format a time as minutes:seconds, from an hour as hours:minutes:seconds.

    Parameters
    ----------
    seconds : float
        Time [s].

    Examples
    --------
    >>> format_time(82.4), format_time(3725)
    ('1:22', '1:02:05')
    """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


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
    with Progress(**options) as progress:
        for number, case in enumerate(cases, start=1):
            progress.begin(f"{stage(case) if callable(stage) else stage}, {number} of {len(cases)}")
            yield case


@contextmanager
def spinning(stage: str, **options: Any) -> Iterator[Progress]:
    """Show one stage with a spinner and the elapsed time."""
    with Progress(**options) as progress:
        progress.begin(stage)
        yield progress
