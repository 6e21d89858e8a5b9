"""Log of a command on standard error, and the profile of its time by stage.

Loggers are those of the standard library below "compact": `compact.stages` has the stages of a job (INFO) and the
iterations of its solvers (DEBUG), `compact.files` every file that is complete (INFO), `compact.analysis.worker_pool`
workers that died (INFO). A program that uses the package configures them as any other logger.

A stage lasts until the next one begins. Its time is wall time and processor time of this process; the processor time of
worker processes is known at their end, as a sum.
"""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic, process_time

from compact.report.progress import STAGES

PACKAGE = "compact"  # parent of all loggers
BEFORE = "start"  # stage before the first one: imports and the scene
HEADER = ("stage", "runs", "wall [s]", "processor [s]", "share")


@dataclass
class StageTime:
    """Time of all runs of one stage.

    Parameters
    ----------
    runs : int
        Number of runs.
    wall, processor : float
        Wall time and processor time of this process [s].
    """

    runs: int = 0
    wall: float = 0.0
    processor: float = 0.0


class StageProfile(logging.Handler):
    """Handler that measures the time between the records of stages.

    Attributes
    ----------
    stages : dict
        `StageTime` by stage, in the order of their first runs.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.stages: dict[str, StageTime] = {BEFORE: StageTime(runs=1)}
        self._running, self._wall, self._processor = BEFORE, monotonic(), process_time()
        self.stages[BEFORE].processor = self._processor  # of this process since its start
        self._children = _children_time()

    def emit(self, record: logging.LogRecord) -> None:
        """Begin the stage of a record."""
        if record.levelno == logging.INFO:
            self.stop()
            self._running = record.getMessage()
            self.stages.setdefault(self._running, StageTime()).runs += 1

    def stop(self) -> None:
        """Add the time since the last record to the running stage."""
        wall, processor = monotonic(), process_time()
        stage = self.stages[self._running]
        stage.wall += wall - self._wall
        stage.processor += processor - self._processor
        self._wall, self._processor = wall, processor

    def table(self) -> str:
        """Return the stages as lines of text, the longest first, with their sum."""
        self.stop()
        total = sum(each.wall for each in self.stages.values())
        ordered = sorted(self.stages.items(), key=lambda item: -item[1].wall)
        rows = [HEADER, *(_row(name, each, total) for name, each in ordered)]
        rows.append(_row("total", StageTime(0, total, sum(each.processor for each in self.stages.values())), total))
        width = max(len(row[0]) for row in rows)
        lines = [f"{row[0]:<{width}}" + "".join(f"{cell:>15}" for cell in row[1:]) for row in rows]
        children = _children_time() - self._children
        return "\n".join([*lines, *([f"worker processes: {children:.2f} s of processor time"] if children else [])])


def _row(name: str, time: StageTime, total: float) -> tuple[str, ...]:
    share = time.wall / total if total else 0.0
    return name, str(time.runs or ""), f"{time.wall:.2f}", f"{time.processor:.2f}", f"{share:.0%}"


def _children_time() -> float:
    """Processor time of worker processes that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


class _Line(logging.Formatter):
    """Line of the log: seconds since the start, the module, the message."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record."""
        module = record.name.removeprefix(f"{PACKAGE}.")
        return f"{record.relativeCreated / 1000:8.2f} s  {module}: {record.getMessage()}"


@contextmanager
def logged(verbose: int, profile: bool) -> Iterator[None]:
    """Log to standard error inside the block, and print the profile at its end.

    Parameters
    ----------
    verbose : int
        0 for errors only, 1 for stages and files, 2 for the iterations of solvers too.
    profile : bool
        True to print the time of every stage.
    """
    package, stages = logging.getLogger(PACKAGE), logging.getLogger(STAGES)
    handlers: list[tuple[logging.Logger, logging.Handler]] = []
    level = package.level
    if verbose:
        stream = logging.StreamHandler(sys.stderr)
        stream.setFormatter(_Line())
        handlers.append((package, stream))
    measured = StageProfile()
    if profile:
        handlers.append((stages, measured))
    for logger, handler in handlers:
        logger.addHandler(handler)
    package.setLevel(logging.DEBUG if verbose > 1 else logging.INFO if verbose or profile else logging.ERROR)
    try:
        yield
    finally:
        for logger, handler in handlers:
            logger.removeHandler(handler)
        package.setLevel(level)
        if profile:
            print(f"\n{measured.table()}", file=sys.stderr)
