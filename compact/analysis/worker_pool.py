"""Tasks in this process, in worker processes, or on a dask cluster; a worker that dies does not end the job.

    for number, outcome in run_tasks(work, tasks, ProcessExecutor(2)):
        ...

`work` is a function of one task that a worker can import. If a worker process dies, the pool is rebuilt and the tasks
that were running are repeated one at a time; a task whose worker dies ATTEMPTS times has the outcome `WorkerDied`.
Workers use one BLAS thread.
"""

import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.synchronize import Event
from typing import Any, NamedTuple, Self

from compact.analysis.failures import run_marked

ATTEMPTS = 3  # deaths of a worker process after which its task is abandoned
TASKS_PER_THREAD = 2  # of a cluster, so that no thread waits for its next task
SCHEDULER_TIMEOUT = 20.0  # [s], to connect to a dask scheduler
CLUSTER_POLL = 5.0  # [s], between two looks at the workers of a cluster
WORKERLESS_LIMIT = 6 * 3600.0  # [s], without any worker, such as jobs that wait in the queue of a batch system
CLIENT_LOG = "distributed.client"  # logger of the tracebacks of a lost connection, which `DaskExecutor` states itself
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

_LOG = logging.getLogger(__name__)
Work = Callable[[Any], Any]
Outcomes = list[tuple[Any, Any]]  # name of a task and its outcome


@dataclass(frozen=True)
class WorkerDied:
    """Outcome of a task that no worker process survived."""

    reason: str


class SerialExecutor:
    """Executor in this process; a task runs when its outcome is waited for."""

    def __init__(self) -> None:
        self._submitted = deque[tuple[Any, Work, Any]]()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._submitted.clear()

    @property
    def free(self) -> bool:
        """True if no task is submitted."""
        return not self._submitted

    def submit(self, name: Any, work: Work, task: Any) -> None:
        """Keep a task until `finished`."""
        self._submitted.append((name, work, task))

    def finished(self) -> Outcomes:
        """Run the task that was submitted first."""
        name, work, task = self._submitted.popleft()
        return [(name, work(task))]


class _Job(NamedTuple):
    """A task in a worker process, and how often its worker has died."""

    name: Any
    work: Work
    task: Any
    deaths: int = 0


class ProcessExecutor:
    """Executor in worker processes.

    Attributes
    ----------
    deaths : int
        Number of times that the pool was rebuilt after the death of a worker.
    """

    def __init__(self, count: int) -> None:
        self.count, self.deaths = count, 0
        self._failed_starts = 0  # in succession
        self._running: dict[Future[Any], _Job] = {}
        self._repeated = deque[_Job]()  # after the death of a worker; one at a time, so that the cause is known

    def __enter__(self) -> Self:
        self._others = active_children()
        context = get_context("spawn")  # threads of numpy and of the progress do not survive a fork
        self._begun = context.Event()
        self._pool = ProcessPoolExecutor(self.count, context, _begin_worker, (self._begun,))
        with _one_thread(), suppress(BrokenProcessPool):
            # all processes start now: a pool that starts one while another dies may fail in its own thread
            for _ in range(self.count):
                self._pool.submit(os.getpid)
        return self

    def __exit__(self, *error: object) -> None:
        for process in active_children():
            if process not in self._others:
                process.kill()
        self._pool.shutdown(cancel_futures=True)

    @property
    def pids(self) -> list[int | None]:
        """Numbers of the worker processes."""
        return [process.pid for process in active_children() if process not in self._others]

    @property
    def free(self) -> bool:
        """True if a worker is idle and no task has to be repeated."""
        return not self._repeated and len(self._running) < self.count

    def submit(self, name: Any, work: Work, task: Any) -> None:
        """Start a task, or queue it where none would start now."""
        self._start(_Job(name, work, task))

    def finished(self) -> Outcomes:
        """Wait for one outcome at least, and return those that are available."""
        found: Outcomes = []
        while not found and (self._running or self._repeated):
            if not self._running:
                self._start(self._repeated.popleft())
            done = wait(self._running, return_when=FIRST_COMPLETED).done
            lost = any(isinstance(future.exception(), BrokenProcessPool) for future in done)
            begun = self._begun.is_set()
            for future in wait(self._running).done if lost else done:  # after a death all are done, most without result
                job = self._running.pop(future)
                if not isinstance(future.exception(), BrokenProcessPool):
                    found.append((job.name, future.result()))
                elif begun and job.deaths + 1 == ATTEMPTS:
                    found.append((job.name, WorkerDied(f"its worker process died {ATTEMPTS} times")))
                else:
                    self._repeated.append(job._replace(deaths=job.deaths + begun))
            if lost:
                _LOG.info("a worker process died; its tasks are repeated one at a time")
                self._rebuild()
        return found

    def _start(self, job: _Job) -> None:
        try:
            future = self._pool.submit(run_marked, job.work, job.task)
        except BrokenProcessPool:
            if self._running:  # `finished` rebuilds the pool
                self._repeated.append(job)
                return
            self._rebuild()
            future = self._pool.submit(run_marked, job.work, job.task)
        self._running[future] = job

    def _rebuild(self) -> None:
        self.deaths += 1
        self._failed_starts = 0 if self._begun.is_set() else self._failed_starts + 1
        if self._failed_starts == ATTEMPTS:
            raise RuntimeError(
                f"{ATTEMPTS} worker processes ended before they could begin; a script that sweeps needs "
                '`if __name__ == "__main__":`, or give one worker'
            )
        self.__exit__()
        self.__enter__()


def _begin_worker(begun: Event) -> None:
    """Prepare a worker process: it ignores interrupts and ends with its parent."""

    def end_with_parent() -> None:
        if parent := parent_process():
            parent.join()
            os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent receives it and kills its workers
    threading.Thread(target=end_with_parent, daemon=True).start()
    begun.set()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Set the environment of new processes to one thread of linear algebra."""
    before = dict(os.environ)
    os.environ |= dict.fromkeys(THREAD_VARIABLES, "1")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ |= before


class DaskExecutor:
    """Executor on the workers of a dask scheduler.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as tcp://host:8786.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._client: Any = None
        self._log_level, self._workerless = logging.NOTSET, 0.0  # [s], without any worker
        self._futures: dict[Any, Any] = {}

    def __enter__(self) -> Self:
        try:
            from distributed import Client
        except ImportError:
            remedy = "install it with `pip install 'compact[cluster]'`, or give --workers"
            raise RuntimeError(f"a cluster needs dask; {remedy}") from None
        log, remedy = logging.getLogger(CLIENT_LOG), "start one with `dask scheduler`, or give --workers"
        self._log_level = log.level
        try:
            self._client = Client(self.address, timeout=SCHEDULER_TIMEOUT, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise RuntimeError(f"no dask scheduler answers at {self.address!r}: {error}; {remedy}") from error
        log.setLevel(logging.CRITICAL)
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(Exception):  # the cluster may be gone
            self._client.cancel(list(self._futures))
        self._client.close()
        logging.getLogger(CLIENT_LOG).setLevel(self._log_level)

    @property
    def free(self) -> bool:
        """True if the cluster has fewer than TASKS_PER_THREAD tasks per thread."""
        with self._loss_explained():
            return len(self._futures) < TASKS_PER_THREAD * max(1, sum(self._client.nthreads().values()))

    def submit(self, name: Any, work: Work, task: Any) -> None:
        """Start a task, or queue it where none would start now."""
        with self._loss_explained():
            self._futures[self._client.submit(run_marked, work, task, pure=False)] = name

    def finished(self) -> Outcomes:
        """Wait for one outcome at least, and return those that are available.

        Raises
        ------
        RuntimeError
            If the scheduler is lost, or no worker is connected for WORKERLESS_LIMIT.
        """
        import distributed

        def outcome(future: Any) -> Any:
            try:
                return future.result()
            except distributed.KilledWorker as error:
                return WorkerDied(f"its workers died: {error}")

        with self._loss_explained(), self._client.as_current():
            while self._futures:
                try:
                    done = distributed.wait(list(self._futures), CLUSTER_POLL, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    self._require_workers()
                else:
                    self._workerless = 0.0
                    return [(self._futures.pop(future), outcome(future)) for future in done]
        return []

    def _require_workers(self) -> None:
        """Add a period to the time without any worker, or end it."""
        if self._client.nthreads():
            self._workerless = 0.0
            return
        if self._workerless == 0:
            _LOG.warning("no worker is connected to %s; waiting for workers", self.address)
        if self._workerless >= WORKERLESS_LIMIT:
            raise RuntimeError(
                f"no worker was connected to {self.address} for {WORKERLESS_LIMIT / 3600:g} h; start workers and "
                "repeat the command with --resume"
            )
        self._workerless += CLUSTER_POLL

    @contextmanager
    def _loss_explained(self) -> Iterator[None]:
        try:
            yield
        except (OSError, CancelledError) as error:  # of the connection; tasks of a lost scheduler are cancelled
            raise RuntimeError(
                f"the dask scheduler at {self.address} is lost ({type(error).__name__}); finished points are kept, "
                "start a scheduler and repeat the command with --resume"
            ) from error


Executor = SerialExecutor | ProcessExecutor | DaskExecutor


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def choose_executor(workers: int | None = None, scheduler: str | None = None) -> Executor:
    """Return the executor for the options of a command.

    Parameters
    ----------
    workers : int, optional
        Number of processes; one per processor by default, none for 1.
    """
    if workers is not None and scheduler is not None:
        raise ValueError("give --workers or --scheduler, got both")
    if scheduler is not None:
        return DaskExecutor(scheduler)
    number = cores() if workers is None else workers
    if not isinstance(number, int) or number < 1:
        raise ValueError(f"--workers must be at least 1, got {number!r}")
    return SerialExecutor() if number == 1 else ProcessExecutor(number)


def run_tasks(
    work: Work, tasks: Sequence[Any], executor: Executor, meanwhile: Callable[[], None] = lambda: None
) -> Generator[tuple[int, Any], None, None]:
    """Run tasks; the executor is stopped at the end, and also if the caller stops early.

    Parameters
    ----------
    meanwhile : callable
        Called once after the first tasks have been submitted, while workers start.

    Yields
    ------
    tuple
        Number of a task and its outcome, in the order of completion.
    """
    waiting, pending = deque(enumerate(tasks)), len(tasks)
    with executor:
        while pending:
            while waiting and executor.free:
                number, task = waiting.popleft()
                executor.submit(number, work, task)
            if pending == len(tasks):
                meanwhile()
            for number, outcome in executor.finished():
                pending -= 1
                yield number, outcome


class BackgroundTasks:
    """Tasks that an executor runs in their order while the caller continues.

        with BackgroundTasks(executor) as tasks:
            result = tasks.submit("name", work, task)
            ...
            result()  # waits for the outcome

    The executor has all tasks from the beginning, so that no worker is idle.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor, self._numbers = executor, count()
        self._found: dict[Any, Any] = {}

    def __enter__(self) -> Self:
        self._executor.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.__exit__(*error)

    def submit(self, name: str, work: Work, task: Any) -> Callable[[], Any]:
        """Start a task.

        Parameters
        ----------
        name : str
            Name of the task in errors.

        Returns
        -------
        callable
            Waits for the outcome and returns it; raises RuntimeError if it is `WorkerDied`.
        """
        number = next(self._numbers)
        self._executor.submit(number, work, task)

        def outcome() -> Any:
            while number not in self._found:
                self._found.update(self._executor.finished())
            if isinstance(self._found[number], WorkerDied):
                raise RuntimeError(f"{name}: {self._found[number].reason}")
            return self._found[number]

        return outcome
