"""Tasks over workers that die, fail, are interrupted; a cluster that is not there."""

import os
import signal
import sys
import time

import pytest

from compact.analysis import worker_pool
from compact.analysis.worker_pool import Cluster, Errands, Here, Processes, WorkerDied, outcomes

# what workers do


def square(number):
    return number**2


def dies_once(task):
    """Killed by a signal that nothing can catch, at the first attempt."""
    number, mark = task
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def dies_or_squares(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def fails(number):
    raise RuntimeError(f"{number} does not converge")


def threads(_):
    return os.environ["OMP_NUM_THREADS"], signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def collected(work, tasks, crew):
    return dict(outcomes(work, tasks, crew))


@pytest.mark.parametrize("crew", [Here(), Processes(2)], ids=["here", "two processes"])
def test_every_task_has_its_outcome(crew):
    assert collected(square, list(range(9)), crew) == {number: number**2 for number in range(9)}


def test_what_passes_the_time_is_done_once_when_tasks_are_given():
    crew, free = Here(), []
    assert len(list(outcomes(square, [1, 2, 3], crew, meanwhile=lambda: free.append(crew.free)))) == 3
    assert free == [False]


def test_task_of_a_killed_worker_is_done_by_another(tmp_path):
    crew = Processes(2)
    found = collected(dies_once, [(number, tmp_path / f"{number}") for number in range(4)], crew)
    assert found == {number: number**2 for number in range(4)}
    assert crew.deaths == 4


def test_task_that_kills_every_worker_is_lost_alone():
    crew = Processes(2)
    found = collected(dies_or_squares, list(range(6)), crew)
    assert found[3] == WorkerDied("its worker process died 3 times, last with code -9")
    assert [found[number] for number in (0, 1, 2, 4, 5)] == [0, 1, 4, 16, 25]
    assert crew.deaths == 3


def test_workers_have_one_thread_and_leave_interrupts_to_the_command():
    before = os.environ.get("OMP_NUM_THREADS")
    assert collected(threads, [0], Processes(1)) == {0: ("1", True)}
    assert os.environ.get("OMP_NUM_THREADS") == before


@pytest.mark.parametrize("crew", [Here(), Processes(1)], ids=["here", "a process"])
def test_error_of_the_work_stops_and_is_told(crew):
    with pytest.raises(RuntimeError, match="5 does not converge"):
        collected(fails, [5], crew)


def test_workers_are_gone_when_the_reader_stops():
    crew = Processes(2)
    coming = outcomes(square, list(range(100)), crew)
    next(coming)
    pids = crew.pids
    coming.close()
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_processes_that_cannot_begin_are_told(monkeypatch):
    monkeypatch.setattr(worker_pool, "_serve", "not a function")
    with pytest.raises(RuntimeError, match="3 worker processes ended before they could begin"):
        collected(square, [1], Processes(1))


@pytest.mark.parametrize("crew", [Here(), Processes(2)], ids=["here", "two processes"])
def test_errands_are_answered_in_any_order_and_again(crew):
    with Errands(crew) as errands:
        answers = [errands.send(f"square of {number}", square, number) for number in range(5)]
        assert [answer() for answer in reversed(answers)] == [16, 9, 4, 1, 0]
        assert answers[2]() == 4


def test_errands_are_run_while_nobody_waits(tmp_path):
    marks = [tmp_path / f"{number}" for number in range(4)]
    with Errands(Processes(1)) as errands:
        for mark in marks:
            errands.send(mark.name, type(mark).touch, mark)
        for _ in range(3000):  # half a minute at most
            errands.turn()
            if all(mark.exists() for mark in marks):
                break
            time.sleep(0.01)
        assert all(mark.exists() for mark in marks)


def test_errand_of_a_killed_worker_is_run_by_another(tmp_path):
    with Errands(Processes(1)) as errands:
        assert errands.send("once", dies_once, (7, tmp_path / "mark"))() == 49


def test_errand_that_kills_every_worker_is_told():
    with Errands(Processes(1)) as errands, pytest.raises(RuntimeError, match="third: its worker process died 3 times"):
        errands.send("third", dies_or_squares, 3)()


def test_failed_errand_is_told():
    with Errands(Processes(1)) as errands, pytest.raises(RuntimeError, match="5 does not converge"):
        errands.send("fifth", fails, 5)()


def test_cluster_without_dask_is_refused_in_words(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RuntimeError, match=r"a cluster needs dask; install it with `pip install '.\[cluster\]'`"):
        collected(square, [1], Cluster("tcp://127.0.0.1:1"))


def test_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr(worker_pool, "SEEK", 0.2)
    with pytest.raises(RuntimeError, match=r"no dask scheduler answers at 'tcp://127.0.0.1:1'"):
        collected(square, [1], Cluster("tcp://127.0.0.1:1"))
