"""Tasks in worker processes that die or fail, and a cluster without scheduler."""

import os
import signal
from contextlib import suppress

import pytest

from compact.analysis.worker_pool import ProcessExecutor, SerialExecutor, WorkerError, run_tasks

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
    with executor:
        return {number: job.result() for number, job in run_tasks(work, tasks, executor)}


@EXECUTORS
def test_results_are_returned_in_any_order_and_again_and_errors_are_raised(create):
    assert collected(square, list(range(9)), create()) == {number: number**2 for number in range(9)}
    with create() as executor:
        jobs = [executor.submit(square, number) for number in range(5)]
        assert [job.result() for job in reversed(jobs)] == [16, 9, 4, 1, 0]
        assert jobs[2].result() == 4
        with pytest.raises(RuntimeError, match="5 does not converge"):
            executor.submit(fails, 5).result()


def test_task_of_a_killed_worker_is_repeated_by_workers_of_one_thread_without_interrupts(tmp_path):
    before, executor = os.environ.get("OMP_NUM_THREADS"), ProcessExecutor(2)
    found = collected(dies_once, [(number, tmp_path / f"{number}") for number in range(4)], executor)
    assert found == {number: number**2 for number in range(4)}
    assert 1 <= executor.deaths <= 4
    assert collected(threads, [0], ProcessExecutor(1)) == {0: ("1", True)}
    assert os.environ.get("OMP_NUM_THREADS") == before


@pytest.mark.slow
def test_only_the_task_that_kills_its_workers_is_abandoned():
    with ProcessExecutor(2) as executor:
        jobs = dict(run_tasks(dies_or_squares, list(range(6)), executor))
    with pytest.raises(WorkerError, match="its worker process died 3 times"):
        jobs[3].result()
    assert [jobs[number].result() for number in (0, 1, 2, 4, 5)] == [0, 1, 4, 16, 25]
    assert executor.deaths == 3


def test_workers_are_killed_when_the_caller_stops():
    with suppress(KeyboardInterrupt), ProcessExecutor(2) as executor:
        next(run_tasks(square, list(range(100)), executor))
        pids = executor.pids
        raise KeyboardInterrupt
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
