"""Tasks spread over processes of this machine, or over a dask cluster; a worker that dies takes nothing with it.

    for number, outcome in outcomes(work, tasks, Processes(2)):
        ...

`work` is a function of a task that a worker can import. A task whose worker died is done again by a new one; after
ATTEMPTS deaths its outcome is `WorkerDied`. Every process has a pipe of its own: when one is killed it is known which task it
had, which no pool of the standard library tells. Workers compute with one BLAS thread.
"""

import os
import signal
from collections import deque
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection, get_context

ATTEMPTS = 3
WINDOW = 2  # tasks at once for every thread of a cluster, so that none waits for the next
SEEK = 20  # seconds to find a scheduler
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class WorkerDied:
    """The outcome of a task that no worker survived."""

    reason: str


def cores():
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def crew(workers=None, scheduler=None):
    """Who computes: the dask cluster of a scheduler, so many processes, by default one for each processor, or for one
    this process itself."""
    if workers is not None and scheduler is not None:
        raise ValueError("give --workers or --scheduler, got both")
    if scheduler is not None:
        return Cluster(scheduler)
    count = cores() if workers is None else workers
    if count < 1:
        raise ValueError(f"--workers must be at least 1, got {count}")
    return Here() if count == 1 else Processes(count)


def outcomes(work, tasks, crew, meanwhile=lambda: None):
    """(number of the task, outcome), as they come; the crew is dismissed at the end, however it comes.

    meanwhile : called once, here, when the first tasks are given and workers have still to start
    """
    waiting, pending = deque(enumerate(tasks)), len(tasks)
    with crew:
        while pending:
            while waiting and crew.free:
                number, task = waiting.popleft()
                crew.give(number, work, task)
            if pending == len(tasks):
                meanwhile()
            for number, outcome in crew.finished():
                pending -= 1
                yield number, outcome


class Errands:
    """Tasks for a crew of this machine while the caller goes on, done in the order in which they are sent.

        with Errands(crew) as errands:
            answer = errands.send("name", work, task)
            ...
            answer()  # waits for the outcome

    Who waits has the crew busy; who does not calls `turn` now and then, so that none of it is idle.
    """

    def __init__(self, crew):
        self._crew, self._waiting, self._found = crew, deque(), {}

    def __enter__(self):
        self._crew.__enter__()
        return self

    def __exit__(self, *how):
        self._crew.__exit__(*how)

    def send(self, name, work, task):
        """What waits for the outcome of a task, and gives it; raises RuntimeError for one that is `WorkerDied`."""
        self._waiting.append((name, work, task))
        self.turn()
        return partial(self._outcome, name)

    def turn(self):
        """Take what is done, and give what waits to those who are free."""
        self._take(timeout=0)

    def _take(self, timeout=None):
        self._found.update(self._crew.finished(timeout))
        while self._waiting and self._crew.free:
            self._crew.give(*self._waiting.popleft())

    def _outcome(self, name):
        self._waiting = deque(sorted(self._waiting, key=lambda task: task[0] != name))  # what is waited for comes first
        while name not in self._found:
            self._take()
        if isinstance(self._found[name], WorkerDied):
            raise RuntimeError(f"{name}: {self._found[name].reason}")
        return self._found[name]


class Here:
    """A crew of this process alone."""

    def __init__(self):
        self._given = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._given.clear()

    @property
    def free(self):
        return not self._given

    def give(self, number, work, task):
        self._given.append((number, work, task))

    def finished(self, timeout=None):
        """The outcome of what was given; none where that would take more than no time."""
        if timeout is not None:
            return []
        number, work, task = self._given.pop()
        return [(number, work(task))]


class Processes:
    """A crew of worker processes; those that die are replaced."""

    def __init__(self, count):
        self.count = count
        self.deaths = 0
        self._stillborn = 0  # one after the other
        self._workers = []

    def __enter__(self):
        self._workers = [_Worker() for _ in range(self.count)]
        return self

    def __exit__(self, *_):
        for worker in self._workers:
            worker.dismiss()

    @property
    def pids(self):
        """Numbers of the processes at work."""
        return [worker.process.pid for worker in self._workers]

    @property
    def free(self):
        return any(worker.task is None for worker in self._workers)

    def give(self, number, work, task):
        next(worker for worker in self._workers if worker.task is None).take(number, work, task, attempt=1)

    def finished(self, timeout=None):
        """The outcomes that have come in, at least one; fewer where none comes in the seconds given."""
        told, ready = [], True
        while ready and not told:
            ready = connection.wait([worker.pipe for worker in self._workers], timeout)
            for i, worker in enumerate(self._workers):
                if worker.pipe in ready:
                    told += self._heard(i, worker)
        return told

    def _heard(self, i, worker):
        """What a worker says, or for one that died, its task to another."""
        try:
            answers = worker.answers()
            self._stillborn = 0
            return answers
        except (EOFError, OSError):
            worker.dismiss()
        self.deaths += 1
        self._stillborn += not worker.started
        if self._stillborn == ATTEMPTS:
            raise RuntimeError(
                f"{ATTEMPTS} worker processes ended before they could begin; a script that sweeps needs "
                '`if __name__ == "__main__":`, or give one worker'
            )
        self._workers[i] = _Worker()
        if worker.task is None:
            return []
        number, work, task, attempt = worker.task
        if attempt == ATTEMPTS:
            return [
                (
                    number,
                    WorkerDied(f"its worker process died {ATTEMPTS} times, last with code {worker.process.exitcode}"),
                )
            ]
        self._workers[i].take(number, work, task, attempt + worker.started)
        return []


class _Worker:
    """One process, the pipe to it, and the task it has: (number, work, task, attempt) or None."""

    def __init__(self):
        context = get_context("spawn")  # threads of numpy and of the progress do not survive a fork
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other,), daemon=True)
        with _one_thread():
            self.process.start()
        other.close()  # so that the pipe ends when the process does
        self.task, self.started = None, False

    def take(self, number, work, task, attempt):
        self.task = number, work, task, attempt
        with suppress(OSError):  # one that has just died: its pipe tells
            self.pipe.send((work, task))

    def answers(self):
        """[(number, outcome)] of the task at hand, nothing when the process has only begun; EOFError when it died."""
        answer = self.pipe.recv()
        if not self.started:
            self.started = True
            return []
        number, self.task = self.task[0], None
        if isinstance(answer, Exception):
            raise answer
        return [(number, answer)]

    def dismiss(self):
        self.pipe.close()
        self.process.kill()
        self.process.join()


def _serve(pipe):
    """Do tasks until the pipe ends, with one thread for linear algebra."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command is told, and dismisses us
    with suppress(EOFError, OSError):
        pipe.send("begun")
        while True:
            pipe.send(_answer(*pipe.recv()))


def _answer(work, task):
    try:
        return work(task)
    except Exception as error:
        return error


@contextmanager
def _one_thread():
    """An environment for new processes in which linear algebra takes one thread."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class Cluster:
    """A crew of the workers of a dask scheduler at an address such as tcp://host:8786."""

    def __init__(self, address):
        self.address = address
        self._client = None
        self._futures = {}

    def __enter__(self):
        client = _distributed().Client
        try:
            self._client = client(self.address, timeout=SEEK, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise RuntimeError(
                f"no dask scheduler answers at {self.address!r}: {error}; start one with `dask scheduler`, or give "
                "--workers"
            ) from error
        return self

    def __exit__(self, *_):
        with suppress(Exception):  # a cluster that is gone cancels nothing
            self._client.cancel(list(self._futures))
        self._client.close()

    @property
    def free(self):
        return len(self._futures) < WINDOW * max(1, sum(self._client.nthreads().values()))

    def give(self, number, work, task):
        self._futures[self._client.submit(work, task, pure=False)] = number

    def finished(self):
        distributed = _distributed()
        with self._client.as_current():
            done = distributed.wait(list(self._futures), return_when="FIRST_COMPLETED").done
        return [(self._futures.pop(future), self._outcome(future, distributed.KilledWorker)) for future in done]

    def _outcome(self, future, killed):
        try:
            return future.result()
        except killed as error:
            return WorkerDied(f"its workers died: {error}")


def _distributed():
    try:
        import distributed
    except ImportError:
        raise RuntimeError(
            "a cluster needs dask; install it with `pip install '.[cluster]'`, or give --workers"
        ) from None
    return distributed
