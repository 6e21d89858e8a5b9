"""Tasks in worker processes that die or fail, and a cluster without scheduler."""

import os
import signal
import sys
import time

import pytest

from compact.analysis import worker_pool
from compact.analysis.worker_pool import (
    BackgroundTasks,
    DaskExecutor,
    ProcessExecutor,
    SerialExecutor,
    WorkerDied,
    run_tasks,
)

EXECUTORS = pytest.mark.parametrize("create", [SerialExecutor, lambda: ProcessExecutor(2)], ids=["here", "processes"])

# functions of a task


def square(number):
    return number**2


def dies_once(task):
    """Kill its worker at the first attempt."""
    number, mark = task
    if not mark.exists():
        mark.touch()
        os._exit(9)
    return number**2


def dies_or_squares(number):
    if number == 3:
        os._exit(9)
    return number**2


def fails(number):
    raise RuntimeError(f"{number} does not converge")


def threads(_):
    return os.environ["OMP_NUM_THREADS"], signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def collected(work, tasks, executor):
    return dict(run_tasks(work, tasks, executor))


@EXECUTORS
def test_every_task_returns_its_outcome_or_raises_its_error(create):
    assert collected(square, list(range(9)), create()) == {number: number**2 for number in range(9)}
    with pytest.raises(RuntimeError, match="5 does not converge"):
        collected(fails, [5], create())


def test_meanwhile_is_called_once_after_the_first_tasks_are_submitted():
    executor, free = SerialExecutor(), []
    assert len(list(run_tasks(square, [1, 2, 3], executor, meanwhile=lambda: free.append(executor.free)))) == 3
    assert free == [False]


def test_task_of_a_killed_worker_is_repeated(tmp_path):
    executor = ProcessExecutor(2)
    found = collected(dies_once, [(number, tmp_path / f"{number}") for number in range(4)], executor)
    assert found == {number: number**2 for number in range(4)}
    assert 1 <= executor.deaths <= 4


@pytest.mark.slow
def test_only_the_task_that_kills_its_workers_is_abandoned():
    executor = ProcessExecutor(2)
    found = collected(dies_or_squares, list(range(6)), executor)
    assert found[3] == WorkerDied("its worker process died 3 times")
    assert [found[number] for number in (0, 1, 2, 4, 5)] == [0, 1, 4, 16, 25]
    assert executor.deaths == 3


def test_workers_use_one_thread_and_ignore_interrupts():
    before = os.environ.get("OMP_NUM_THREADS")
    assert collected(threads, [0], ProcessExecutor(1)) == {0: ("1", True)}
    assert os.environ.get("OMP_NUM_THREADS") == before


def test_workers_are_killed_when_the_caller_stops():
    executor = ProcessExecutor(2)
    coming = run_tasks(square, list(range(100)), executor)
    next(coming)
    pids = executor.pids
    coming.close()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_processes_that_cannot_begin_raise(monkeypatch):
    monkeypatch.setattr(worker_pool, "_begin_worker", sys.exit)
    with pytest.raises(RuntimeError, match="3 worker processes ended before they could begin"):
        collected(square, [1], ProcessExecutor(1))


@EXECUTORS
def test_background_results_are_returned_in_any_order_and_again(create):
    with BackgroundTasks(create()) as tasks:
        results = [tasks.submit(f"square of {number}", square, number) for number in range(5)]
        assert [answer() for answer in reversed(results)] == [16, 9, 4, 1, 0]
        assert results[2]() == 4
        with pytest.raises(RuntimeError, match="5 does not converge"):
            tasks.submit("fifth", fails, 5)()


def test_background_tasks_run_while_the_caller_continues(tmp_path):
    marks = [tmp_path / f"{number}" for number in range(4)]
    with BackgroundTasks(ProcessExecutor(1)) as tasks:
        for mark in marks:
            tasks.submit(mark.name, type(mark).touch, mark)
        until = time.monotonic() + 30
        while not all(mark.exists() for mark in marks) and time.monotonic() < until:
            time.sleep(0.01)
        assert all(mark.exists() for mark in marks)


@pytest.mark.slow
def test_background_task_of_a_killed_worker_is_repeated_three_times(tmp_path):
    with BackgroundTasks(ProcessExecutor(1)) as tasks:
        assert tasks.submit("once", dies_once, (7, tmp_path / "mark"))() == 49
        with pytest.raises(RuntimeError, match="third: its worker process died 3 times"):
            tasks.submit("third", dies_or_squares, 3)()


@pytest.mark.parametrize(
    ("module", "words"),
    [
        (None, r"a cluster needs dask; install it with `pip install 'compact\[cluster\]'`"),
        ("", "no dask scheduler"),
    ],
)
def test_cluster_requires_dask_and_a_scheduler(monkeypatch, module, words):
    if module is None:
        monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setattr(worker_pool, "SCHEDULER_TIMEOUT", 0.2)
    with pytest.raises(RuntimeError, match=words):
        collected(square, [1], DaskExecutor("tcp://127.0.0.1:1"))
