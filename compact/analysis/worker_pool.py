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
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.synchronize import Event
from types import ModuleType
from typing import Any, Protocol, Self

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


class Executor(Protocol):
    """Place where tasks are run."""

    def __enter__(self) -> Self:
        """Start."""

    def __exit__(self, *error: object) -> None:
        """Stop, and abandon unfinished tasks."""

    @property
    def free(self) -> bool:
        """True if a further task would start now."""

    def submit(self, name: Any, work: Work, task: Any) -> None:
        """Start a task."""

    def finished(self, timeout: float | None = None) -> Outcomes:
        """Return the outcomes that are available, after at most `timeout` [s]; at least one without timeout."""


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
    count = cores() if workers is None else workers
    if not isinstance(count, int) or count < 1:
        raise ValueError(f"--workers must be at least 1, got {count!r}")
    return SerialExecutor() if count == 1 else ProcessExecutor(count)


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

    The caller calls `poll` now and then, so that no worker is idle.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor, self._waiting = executor, deque[tuple[Any, Work, Any]]()
        self._found: dict[Any, Any] = {}

    def __enter__(self) -> Self:
        self._executor.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.__exit__(*error)

    def submit(self, name: str, work: Work, task: Any) -> Callable[[], Any]:
        """Queue a task.

        Parameters
        ----------
        name : str
            Unique name of the task.

        Returns
        -------
        callable
            Waits for the outcome and returns it; raises RuntimeError if it is `WorkerDied`.
        """
        self._waiting.append((name, work, task))
        self.poll()
        return partial(self._outcome, name)

    def poll(self, timeout: float | None = 0) -> None:
        """Collect outcomes after at most `timeout` [s], and start waiting tasks."""
        self._found.update(self._executor.finished(timeout))
        while self._waiting and self._executor.free:
            self._executor.submit(*self._waiting.popleft())

    def _outcome(self, name: str) -> Any:
        self._waiting = deque(sorted(self._waiting, key=lambda task: task[0] != name))  # this one first
        while name not in self._found:
            self.poll(timeout=None)
        if isinstance(self._found[name], WorkerDied):
            raise RuntimeError(f"{name}: {self._found[name].reason}")
        return self._found[name]


class SerialExecutor:
    """Executor in this process; a task runs when its outcome is waited for."""

    def __init__(self) -> None:
        self._submitted: list[tuple[Any, Work, Any]] = []

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

    def finished(self, timeout: float | None = None) -> Outcomes:
        """Run the submitted task; return nothing if there is a timeout [s]."""
        if timeout is not None:
            return []
        name, work, task = self._submitted.pop()
        return [(name, work(task))]


@dataclass(frozen=True)
class _Job:
    """A task in a worker process, and how often its worker has died."""

    name: Any
    work: Work
    task: Any
    deaths: int = 0


class _RecordingContext(SpawnContext):
    """Start method "spawn", with a record of the processes, so that they can be killed."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    # multiprocessing declares a class here and calls it only
    def Process(self, *args: Any, **options: Any) -> SpawnProcess:  # type: ignore[override]  # noqa: N802
        process = SpawnProcess(*args, **options)
        self.started.append(process)
        return process


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
        self._start_pool()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop_pool()

    @property
    def pids(self) -> list[int | None]:
        """Numbers of the worker processes."""
        return [process.pid for process in self._context.started if process.is_alive()]

    @property
    def free(self) -> bool:
        """True if a worker is idle and no task has to be repeated."""
        return not self._repeated and len(self._running) < self.count

    def submit(self, name: Any, work: Work, task: Any) -> None:
        """Start a task."""
        self._submit(_Job(name, work, task))

    def finished(self, timeout: float | None = None) -> Outcomes:
        """Return the outcomes that are available, after at most `timeout` [s]; at least one without timeout."""
        found: Outcomes = []
        while not found:
            if self._repeated and not self._running:
                self._submit(self._repeated.popleft())
            done = wait(self._running, timeout, FIRST_COMPLETED).done
            found = self._collect(done)
            if timeout is not None or not done:
                break
        return found

    def _submit(self, job: _Job) -> None:
        try:
            future = self._pool.submit(run_marked, job.work, job.task)
        except BrokenProcessPool:
            if self._running:  # `finished` rebuilds the pool
                self._repeated.append(job)
                return
            self._rebuild_pool()
            future = self._pool.submit(run_marked, job.work, job.task)
        self._running[future] = job

    def _collect(self, done: Iterable[Future[Any]]) -> Outcomes:
        """Return outcomes; after the death of a worker all tasks are done, but most without result."""
        broken = any(isinstance(future.exception(), BrokenProcessPool) for future in done)
        found: Outcomes = []
        for future in wait(self._running).done if broken else done:
            job = self._running.pop(future)
            if not isinstance(future.exception(), BrokenProcessPool):
                found.append((job.name, future.result()))
            elif job.deaths + 1 == ATTEMPTS and self._begun.is_set():
                found.append((job.name, WorkerDied(f"its worker process died {ATTEMPTS} times")))
            else:
                self._repeated.append(replace(job, deaths=job.deaths + self._begun.is_set()))
        if broken:
            _LOG.info("a worker process died; its tasks are repeated one at a time")
            self._rebuild_pool()
        return found

    def _rebuild_pool(self) -> None:
        self.deaths += 1
        self._failed_starts = 0 if self._begun.is_set() else self._failed_starts + 1
        if self._failed_starts == ATTEMPTS:
            raise RuntimeError(
                f"{ATTEMPTS} worker processes ended before they could begin; a script that sweeps needs "
                '`if __name__ == "__main__":`, or give one worker'
            )
        self._stop_pool()
        self._start_pool()

    def _start_pool(self) -> None:
        self._context = _RecordingContext()  # threads of numpy and of the progress do not survive a fork
        self._begun = self._context.Event()
        self._pool = ProcessPoolExecutor(self.count, self._context, _begin_worker, (self._begun,))
        with _one_thread(), suppress(BrokenProcessPool):
            # all processes start now: a pool that starts one while another dies may fail in its own thread
            for _ in range(self.count):
                self._pool.submit(os.getpid)

    def _stop_pool(self) -> None:
        for process in self._context.started:
            process.kill()
        self._pool.shutdown(cancel_futures=True)


def _begin_worker(begun: Event) -> None:
    """Prepare a worker process: it ignores interrupts and ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent receives it and kills its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()
    begun.set()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Set the environment of new processes to one thread of linear algebra."""
    before = {name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ}
    os.environ |= dict.fromkeys(THREAD_VARIABLES, "1")
    try:
        yield
    finally:
        for name in THREAD_VARIABLES:
            del os.environ[name]
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
        self._log_level = logging.NOTSET
        self._futures: dict[Any, Any] = {}

    def __enter__(self) -> Self:
        client, remedy = _distributed().Client, "start one with `dask scheduler`, or give --workers"
        log = logging.getLogger(CLIENT_LOG)
        self._log_level = log.level
        try:
            self._client = client(self.address, timeout=SCHEDULER_TIMEOUT, set_as_default=False)
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
            return len(self._futures) < TASKS_PER_THREAD * max(1, self._threads())

    def submit(self, name: Any, work: Work, task: Any) -> None:
        """Start a task."""
        with self._loss_explained():
            self._futures[self._client.submit(run_marked, work, task, pure=False)] = name

    def finished(self, timeout: float | None = None) -> Outcomes:
        """Return the outcomes that are available, after at most `timeout` [s]; at least one without timeout.

        Raises
        ------
        RuntimeError
            If the scheduler is lost, or no worker is connected for WORKERLESS_LIMIT.
        """
        distributed = _distributed()
        with self._loss_explained(), self._client.as_current():
            done: set[Any] = set()
            workerless = 0.0
            while self._futures and not done:
                try:
                    period = CLUSTER_POLL if timeout is None else timeout
                    done = distributed.wait(list(self._futures), period, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    if timeout is not None:
                        break
                    workerless = self._require_workers(workerless)
            return [(self._futures.pop(future), _dask_outcome(future, distributed.KilledWorker)) for future in done]

    def _threads(self) -> int:
        """Return the number of threads of all workers that are connected."""
        return sum(self._client.nthreads().values())

    def _require_workers(self, workerless: float) -> float:
        """Return the time without any worker [s], that of the last call by the last period."""
        if self._threads():
            return 0.0
        if workerless == 0:
            _LOG.warning("no worker is connected to %s; waiting for workers", self.address)
        if workerless >= WORKERLESS_LIMIT:
            raise RuntimeError(
                f"no worker was connected to {self.address} for {WORKERLESS_LIMIT / 3600:g} h; start workers and "
                "repeat the command with --resume"
            )
        return workerless + CLUSTER_POLL

    @contextmanager
    def _loss_explained(self) -> Iterator[None]:
        try:
            yield
        except (OSError, CancelledError) as error:  # of the connection; tasks of a lost scheduler are cancelled
            raise RuntimeError(
                f"the dask scheduler at {self.address} is lost ({type(error).__name__}); finished points are kept, "
                "start a scheduler and repeat the command with --resume"
            ) from error


def _dask_outcome(future: Any, killed: type[Exception]) -> Any:
    try:
        return future.result()
    except killed as error:
        return WorkerDied(f"its workers died: {error}")


def _distributed() -> ModuleType:
    try:
        import distributed
    except ImportError:
        remedy = "install it with `pip install 'compact[cluster]'`, or give --workers"
        raise RuntimeError(f"a cluster needs dask; {remedy}") from None
    return distributed
