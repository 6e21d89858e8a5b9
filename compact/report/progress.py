"""Progress of a long job on the terminal: stage, share of the work that is done, elapsed time and an estimate.

    with Progress(total=job.cost) as progress:
        progress.begin("contact", cost=0.7)
        ...

    for case in tracked(cases, "case"):
        ...

Work is weighed by its cost, in seconds on any machine: the speed of this one shows as the job goes on. The line appears
after two seconds, moves by a thread of its own, and is gone when the job ends. Nothing is written where the standard
error is no terminal, or where the caller asks for quiet.

Let c be the cost of all finished stages, t_0 the time that they took, t the time and c_1 the cost of the running stage.
The speed is s = c/t_0; done is d = c + min(s (t - t_0), c_1), and (total - d) t/d is left.
"""

import sys
from contextlib import contextmanager
from threading import Timer
from time import monotonic

AFTER = 2.0  # seconds before the line appears
PER_SECOND = 4  # times that it is drawn
LEAST_SHARE = 0.02  # of the work, below which no estimate is given


class Progress:
    """A line of progress on the standard error, inside a `with` block.

    Parameters
    ----------
    total : cost of the whole job, in the unit of the costs of its stages; None where it is not known, which shows a
        spinner, the stage and the elapsed time
    quiet : whether to write nothing
    stream : in place of the standard error
    after : seconds before the line appears, AFTER unless given
    clock : seconds of any origin, never going back

    Raises ValueError for a cost or a total that is negative or not finite.
    """

    def __init__(self, *, total=None, quiet=False, stream=None, after=None, clock=monotonic):
        self._stream = sys.stderr if stream is None else stream
        self.silent = quiet or not self._stream.isatty()
        self._after, self._clock = AFTER if after is None else after, clock
        self._finished, self._finished_at, self._running = 0.0, 0.0, 0.0  # cost, seconds, cost
        self._began = clock()
        self._line = self._timer = None
        self.stage, self.detail, self.total = "", "", total

    @property
    def total(self):
        """Cost of the whole job, None where it is not known."""
        return self._total

    @total.setter
    def total(self, value):
        if value is not None and not 0 <= value < float("inf"):
            raise ValueError(f"`total` must be finite and not negative, got {value!r}; give None where it is not known")
        self._total = value

    def begin(self, stage, cost=1.0, *, total=None):
        """A stage begins, and with it the one before has ended; `total` of the job where that has changed."""
        if not 0 <= cost < float("inf"):
            raise ValueError(f"`cost` of a stage must be finite and not negative, got {cost!r}; give seconds")
        self._finished, self._finished_at, self._running = self._finished + self._running, self.elapsed, cost
        self.stage, self.detail = stage, ""
        if total is not None:
            self.total = total

    def advance(self, cost=1.0):
        """Count finished work; the stage goes on."""
        self.begin(self.stage, 0.0)
        self._finished += cost

    def report(self, detail):
        """Show a line of text beside the stage; the callback of a solver that takes one."""
        self.detail = detail

    @property
    def elapsed(self):
        """Time since the job began [s]."""
        return self._clock() - self._began

    @property
    def share(self):
        """Share of the work that is done, at most 1; None where the whole is not known."""
        if not self.total:
            return None
        running = 0.0
        if self._finished_at > 0:
            speed = self._finished / self._finished_at
            running = min(speed * (self.elapsed - self._finished_at), self._running)
        return min((self._finished + running) / self.total, 1.0)

    @property
    def left(self):
        """Estimate of the time that the job still takes [s]; None where nothing is known of it."""
        share = self.share
        if share is None or share < LEAST_SHARE:
            return None
        return self.elapsed * (1 - share) / share

    def __enter__(self):
        self._began = self._clock()
        if not self.silent:
            self._timer = Timer(self._after, self._appear)
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *_):
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()  # a line that is about to appear does so before it goes
        if self._line is not None:
            self._line.stop()

    def _appear(self):
        from rich.console import Console
        from rich.live import Live

        console = Console(file=self._stream)
        self._line = Live(get_renderable=self._drawn, console=console, transient=True, refresh_per_second=PER_SECOND)
        self._line.start(refresh=True)

    def _drawn(self):
        from rich.progress_bar import ProgressBar
        from rich.spinner import Spinner
        from rich.table import Table

        share, line = self.share, Table.grid(padding=(0, 1))
        what = ", ".join(filter(None, (self.stage, self.detail)))
        if share is None:
            self._spinner = getattr(self, "_spinner", None) or Spinner("line")
            line.add_row(self._spinner, what, f"{spoken(self.elapsed)} elapsed")
        else:
            left = "" if self.left is None else f", about {spoken(self.left)} left"
            bar = ProgressBar(total=1.0, completed=share, width=24)
            line.add_row(bar, f"{share:4.0%}", f"{spoken(self.elapsed)} elapsed{left}", what)
        return line


def spoken(seconds):
    """Seconds as minutes:seconds, with hours where there are any.

    >>> spoken(82.4), spoken(3725)
    ('1:22', '1:02:05')
    """
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


def tracked(items, stage="case", *, alike=True, **options):
    """Yield each of some items while the line of `Progress` shows how many are done.

    Parameters
    ----------
    items : iterable; a list is made of it
    stage : name of what is done with each, or a callable that names it from the item
    alike : whether all cost about the same, so that there is an estimate; otherwise a spinner
    options : of `Progress`
    """
    items = list(items)
    with Progress(total=len(items) if alike else None, **options) as progress:
        for number, item in enumerate(items, start=1):
            progress.begin(f"{stage(item) if callable(stage) else stage}, {number} of {len(items)}")
            yield item


@contextmanager
def spinning(stage, **options):
    """Show a stage whose cost is not known, with a spinner and the elapsed time; gives the `Progress`."""
    with Progress(**options) as progress:
        progress.begin(stage)
        yield progress
