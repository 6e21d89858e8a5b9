"""Tasks in this process, in worker processes, or on the workers of a dask cluster.

    with ProcessExecutor(2) as executor:
        job = executor.submit(work, task)
        ...
        job.result()                               # waits for it

        for number, job in run_tasks(work, tasks, executor):
            job.result()                           # in the order of completion

`work` is a function of one task that a worker can import. If a worker process dies, the pool is rebuilt and the tasks
that were running are repeated one at a time; a task whose worker dies ATTEMPTS times raises `WorkerError`.
Workers use one BLAS thread.
"""

import logging
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import active_children, get_context, parent_process
from typing import Any, Self

from threadpoolctl import threadpool_limits

from compact.analysis.failures import run_marked

ATTEMPTS = 3  # deaths of a worker process after which its task is abandoned
TASKS_PER_THREAD = 2  # of a cluster, so that no thread waits for its next task
SCHEDULER_TIMEOUT = 20.0  # [s], to connect to a dask scheduler
CLUSTER_POLL = 5.0  # [s], between two looks at the workers of a cluster
CLIENT_LOG = "distributed.client"  # logger of the tracebacks of a lost connection, which `DaskExecutor` states itself
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

_LOG = logging.getLogger(__name__)
Work = Callable[[Any], Any]


class WorkerError(RuntimeError):
    """No worker process survived the task."""


class Job(Future[Any]):
    """Task of an executor."""

    def __init__(self, executor: "SerialExecutor", work: Work, task: Any) -> None:
        super().__init__()
        self.executor, self.work, self.task, self.deaths = executor, work, task, 0

    def result(self, timeout: float | None = None) -> Any:
        """Wait for the result and return it, or raise the error of the task."""
        self.executor.wait([self])
        return super().result(timeout)

    def settle(self, compute: Callable[[], Any]) -> None:
        """Keep the result of a function or its error; errors of a connection are raised."""
        try:
            self.set_result(compute())
        except (CancelledError, OSError):
            raise
        except Exception as error:
            self.set_exception(error)


class SerialExecutor:
    """Executor in this process; a task runs when a job is waited for."""

    def __init__(self) -> None:
        self._running: dict[Any, Job] = {}  # job by its future, or by itself

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._running.clear()

    @property
    def free(self) -> bool:
        """True if another task would begin now."""
        return not self._running

    def submit(self, work: Work, task: Any) -> Job:
        """Start a task, or queue it where none would start now."""
        job = Job(self, work, task)
        self._start(job)
        return job

    def wait(self, jobs: Sequence[Job]) -> list[Job]:
        """Return those of some jobs that are done, one at least."""
        while not (done := [job for job in jobs if job.done()]):
            self._advance()
        return done

    def _start(self, job: Job) -> None:
        self._running[job] = job

    def _advance(self) -> None:
        """Wait for any job."""
        job = self._running.pop(next(iter(self._running)))
        job.settle(partial(job.work, job.task))


class ProcessExecutor(SerialExecutor):
    """Executor in worker processes.

    Attributes
    ----------
    deaths : int
        Number of times that the pool was rebuilt after the death of a worker.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self.count, self.deaths = count, 0
        self._repeated = deque[Job]()  # after the death of a worker; one at a time, so that the cause is known

    def __enter__(self) -> Self:
        self._others = active_children()
        context = get_context("spawn")  # threads of numpy and of the progress do not survive a fork
        self._pool, self._started = ProcessPoolExecutor(self.count, context, _begin_worker), []
        with suppress(BrokenProcessPool):
            # all processes start now: a pool that starts one while another dies may fail in its own thread
            for _ in range(self.count):
                self._started.append(self._pool.submit(os.getpid))
        return self

    def __exit__(self, *error: object) -> None:
        for process in active_children():
            if process not in self._others:
                process.kill()
        self._pool.shutdown(cancel_futures=True)

    @property
    def free(self) -> bool:
        """True if a worker is idle and no task has to be repeated."""
        return not self._repeated and len(self._running) < self.count

    def _start(self, job: Job) -> None:
        try:
            self._running[self._pool.submit(run_marked, job.work, job.task)] = job
        except BrokenProcessPool:
            self._repeated.append(job)
            if not self._running:  # else `_advance` rebuilds the pool
                self._rebuild()

    def _advance(self) -> None:
        if not self._running:
            self._start(self._repeated.popleft())
        done = wait(self._running, return_when=FIRST_COMPLETED).done
        lost = any(isinstance(future.exception(), BrokenProcessPool) for future in done)
        for future in wait(self._running).done if lost else done:  # after a death all are done, most without result
            job = self._running.pop(future)
            if not isinstance(future.exception(), BrokenProcessPool):
                job.settle(future.result)
                continue
            job.deaths += 1
            if job.deaths < ATTEMPTS:
                self._repeated.append(job)
            else:
                job.set_exception(WorkerError(f"its worker process died {ATTEMPTS} times"))
        if lost:
            _LOG.info("a worker process died; its tasks are repeated one at a time")
            self._rebuild()

    def _rebuild(self) -> None:
        self.deaths += 1
        if not any(each.done() and each.exception() is None for each in self._started):
            raise RuntimeError(
                "a worker process ended before any could begin; a script that sweeps needs "
                '`if __name__ == "__main__":`, or give one worker'
            )
        self.__exit__()
        self.__enter__()


def _begin_worker() -> None:
    """Prepare a worker process: one thread of linear algebra, no interrupts, and its end with that of the parent."""

    def end_with_parent() -> None:
        if parent := parent_process():
            parent.join()
            os._exit(1)

    os.environ |= dict.fromkeys(THREAD_VARIABLES, "1")  # of libraries that are loaded from now on
    threadpool_limits(1)  # of those that a script has loaded already
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent receives it and kills its workers
    threading.Thread(target=end_with_parent, daemon=True).start()


class DaskExecutor(SerialExecutor):
    """Executor on the workers of a dask scheduler.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as tcp://host:8786.
    """

    def __init__(self, address: str) -> None:
        super().__init__()
        self.address = address
        self._client: Any = None
        self._log_level, self._workerless = logging.NOTSET, False

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
            self._client.cancel(list(self._running))
        self._client.close()
        logging.getLogger(CLIENT_LOG).setLevel(self._log_level)

    @property
    def free(self) -> bool:
        """True if the cluster has fewer than TASKS_PER_THREAD tasks per thread."""
        with self._loss_explained():
            return len(self._running) < TASKS_PER_THREAD * max(1, sum(self._client.nthreads().values()))

    def _start(self, job: Job) -> None:
        with self._loss_explained():
            self._running[self._client.submit(run_marked, job.work, job.task, pure=False)] = job

    def _advance(self) -> None:
        import distributed

        def outcome(future: Any) -> Any:
            try:
                return future.result()
            except distributed.KilledWorker as error:
                raise WorkerError(f"its workers died: {error}") from error

        with self._loss_explained(), self._client.as_current():
            try:
                done = distributed.wait(list(self._running), CLUSTER_POLL, return_when="FIRST_COMPLETED").done
            except TimeoutError:  # warn once that no worker is connected; they may wait in the queue of a batch system
                before, self._workerless = self._workerless, not self._client.nthreads()
                if self._workerless and not before:
                    _LOG.warning("no worker is connected to %s; waiting for workers", self.address)
                return
            for future in done:
                self._running.pop(future).settle(partial(outcome, future))

    @contextmanager
    def _loss_explained(self) -> Iterator[None]:
        try:
            yield
        except (OSError, CancelledError) as error:  # of the connection; tasks of a lost scheduler are cancelled
            raise RuntimeError(
                f"the dask scheduler at {self.address} is lost ({type(error).__name__}); finished points are kept, "
                "start a scheduler and repeat the command with --resume"
            ) from error


Executor = SerialExecutor  # or one of its subclasses


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


def run_tasks(work: Work, tasks: Sequence[Any], executor: Executor) -> Iterator[tuple[int, Job]]:
    """Run tasks by an open executor, which is not given more of them than it can begin.

    Yields
    ------
    tuple
        Number of a task and its job, in the order of completion.
    """
    waiting, running = deque(enumerate(tasks)), dict[Job, int]()
    while waiting or running:
        while waiting and (executor.free or not running):
            number, task = waiting.popleft()
            running[executor.submit(work, task)] = number
        for job in executor.wait(list(running)):
            yield running.pop(job), job
