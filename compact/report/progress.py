"""Progress of a long job on the terminal: stage, share of the work done, elapsed and estimated remaining time.

    with Progress(total=job.cost) as progress:
        progress.begin("contact", cost=0.7)
        ...

    for case in tracked(cases, "case"):
        ...

Work is weighted by its cost, in seconds of a reference machine; the speed of the present machine is estimated on the
way. The line appears after two seconds, is refreshed by its own thread, and is erased at the end. Nothing is written
where standard error is no terminal, or where `quiet` is set.

Let c be the cost of all finished stages, t_0 their time, t the elapsed time and c_1 the cost of the running stage. With
the speed s = c/t_0 the work done is d = c + min(s (t - t_0), c_1), and (total - d) t/d remains.
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
LEAST_SHARE = 0.02  # [-], of the work, below which the remaining time is not estimated
BAR_WIDTH = 24  # characters

STAGES = "compact.stages"  # logger of the stages, INFO, and of the lines of text on them, DEBUG

_LOG = logging.getLogger(STAGES)
Item = TypeVar("Item")


class Progress:
    """Line of progress on standard error, inside a `with` block.

    Parameters
    ----------
    total : float, optional
        Cost of the whole job in the unit of the costs of its stages; without it the line has a spinner and no estimate.
    after : float, optional
        Delay before the line appears [s]; `DELAY` by default.
    clock : callable
        Monotonic time [s].

    Attributes
    ----------
    stage, detail : str
        Running stage, and a line of text on it.

    Raises
    ------
    ValueError
        If a cost or the total is negative or not finite.
    """

    def __init__(
        self,
        *,
        total: float | None = None,
        quiet: bool = False,
        stream: TextIO | None = None,
        after: float | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._stream = sys.stderr if stream is None else stream
        self.silent = quiet or not self._stream.isatty()
        self._delay, self._clock = DELAY if after is None else after, clock
        self._finished, self._finished_at, self._running = 0.0, 0.0, 0.0  # cost, seconds, cost
        self._start = clock()
        self._line: Live | None = None
        self._timer: Timer | None = None
        self._spinner: Spinner | None = None
        self.stage, self.detail = "", ""
        self.total = total

    @property
    def total(self) -> float | None:
        """Cost of the whole job; None where it is unknown."""
        return self._total

    @total.setter
    def total(self, value: float | None) -> None:
        if value is not None and not 0 <= value < float("inf"):
            raise ValueError(f"`total` must be finite and not negative, got {value!r}; give None if it is unknown")
        self._total = value

    def begin(self, stage: str, cost: float = 1.0, *, total: float | None = None) -> None:
        """Begin a stage and finish the one before.

        Parameters
        ----------
        total : float, optional
            New cost of the whole job.
        """
        if not 0 <= cost < float("inf"):
            raise ValueError(f"`cost` of a stage must be finite and not negative, got {cost!r}; give seconds")
        _LOG.info("%s", stage)
        self._switch(stage, cost)
        if total is not None:
            self.total = total

    def _switch(self, stage: str, cost: float) -> None:
        """Finish the running stage and make another one the running stage."""
        self._finished, self._finished_at, self._running = self._finished + self._running, self.elapsed, cost
        self.stage, self.detail = stage, ""

    def advance(self, cost: float = 1.0) -> None:
        """Count finished work of the running stage."""
        self._switch(self.stage, 0.0)
        self._finished += cost

    def report(self, detail: str) -> None:
        """Show a line of text on the running stage; the callback of solvers."""
        self.detail = detail
        if detail:
            _LOG.debug("%s", detail)

    @property
    def elapsed(self) -> float:
        """Time since the start of the job [s]."""
        return self._clock() - self._start

    @property
    def share(self) -> float | None:
        """Share of the work that is done [-], at most 1; None where the total is unknown."""
        if not self.total:
            return None
        speed = self._finished / self._finished_at if self._finished_at > 0 else 0.0
        running = min(speed * (self.elapsed - self._finished_at), self._running)
        return min((self._finished + running) / self.total, 1.0)

    @property
    def remaining(self) -> float | None:
        """Estimated remaining time [s]; None without an estimate."""
        share = self.share
        if share is None or share < LEAST_SHARE:
            return None
        return self.elapsed * (1 - share) / share

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
        from rich.progress_bar import ProgressBar
        from rich.spinner import Spinner
        from rich.table import Table

        share, line = self.share, Table.grid(padding=(0, 1))
        text = ", ".join(filter(None, (self.stage, self.detail)))
        if share is None:
            self._spinner = self._spinner or Spinner("line")
            line.add_row(self._spinner, text, f"{format_time(self.elapsed)} elapsed")
        else:
            remaining = "" if self.remaining is None else f", about {format_time(self.remaining)} left"
            bar = ProgressBar(total=1.0, completed=share, width=BAR_WIDTH)
            line.add_row(bar, f"{share:4.0%}", f"{format_time(self.elapsed)} elapsed{remaining}", text)
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


def tracked(
    items: Iterable[Item], stage: str | Callable[[Item], str] = "case", *, alike: bool = True, **options: Any
) -> Iterator[Item]:
    """Iterate over items while a line of `Progress` counts them.

    Parameters
    ----------
    items : iterable
        Items; a list is made of them.
    stage : str or callable
        Name of the stage, or a function of the item that returns it.
    alike : bool
        All items have about the same cost, so that the remaining time is estimated.
    """
    cases = list(items)
    with Progress(total=len(cases) if alike else None, **options) as progress:
        for number, case in enumerate(cases, start=1):
            progress.begin(f"{stage(case) if callable(stage) else stage}, {number} of {len(cases)}")
            yield case


@contextmanager
def spinning(stage: str, **options: Any) -> Iterator[Progress]:
    """Show a stage of unknown cost with a spinner and the elapsed time."""
    with Progress(**options) as progress:
        progress.begin(stage)
        yield progress
