"""Ensembles and worker pools: closed forms of the formulas under changes, order, reasons, interrupts."""

import os
import signal
from contextlib import suppress
from functools import partial
from multiprocessing import active_children

import numpy as np
import pytest

from compact.analysis.stages.drives import build_stages
from compact.analysis.stages.ensemble import Change, drive_peaks, ensemble, first_law
from compact.analysis.worker_pool import ProcessExecutor, SerialExecutor, WorkerError, run_tasks
from compact.resistance import dry_resistance
from compact.scene.loader import load_scene

SMALL = load_scene("small", **{"output.items": []})
LAWS = SMALL.replaced(**{"motion.laws": ["parabolic", "constant-velocity"], "machine.guide_friction": 0.0})


def peaks_of(scene, change):
    """Values of all laws by each criterion of a scene, with contacts of its own."""
    ranked = build_stages(scene, own_resistance=change.resistance).drive.rankings
    return {by: {place.run.name: place.value for place in order} for by, order in ranked.items()}


def test_peaks_are_those_of_each_scene_and_a_refusal_is_a_reason():
    """Peak force of the parabolic law: W + 4 m s/T2."""
    changes = [Change("own"), Change("slow", {"motion.duration": 6.0}), Change("wet", {"mix.moisture": 0.5})]
    found = ensemble(LAWS, [*changes, Change("free", resistance=dry_resistance(0.0))], peaks_of)
    own, slow, free = (found[number]["peak_force"]["parabolic"] for number in (0, 1, 3))
    inertia = 4 * LAWS.machine.mass * LAWS.motion.stroke / LAWS.motion.duration**2
    assert free == pytest.approx(inertia)
    assert own - slow == pytest.approx(0.75 * inertia)
    assert np.isinf(found[0]["peak_force"]["constant-velocity"])
    assert first_law(found[0]["peak_force"]) == "parabolic"
    assert list(found[2]) == ["reason"]
    assert "mix.moisture: must be " in found[2]["reason"]


def test_held_resistance_scales_the_peak_here_and_in_a_worker():
    stages = build_stages(LAWS)
    cycles, cart = stages.laws.cycles, stages.resistance.cart
    run = partial(drive_peaks, cart, {"": cycles}, dry_resistance(1e8), ("peak_force",))  # inertia is nothing to it
    changes = [Change(f"{scale:g}", resistance=dry_resistance(1e8 * scale)) for scale in (1.0, 1.5)]
    here = ensemble(LAWS, changes, run)
    found = [here[number]["peak_force"]["parabolic"] for number in (0, 1)]
    assert found == pytest.approx([1e8, 1.5e8], rel=0.02)  # guides too
    with ProcessExecutor(1) as executor:
        assert ensemble(LAWS, changes, run, executor) == here


# ---- Tasks in worker processes that die or fail, and a cluster without scheduler


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
    with create() as executor:
        found = {number: job.result() for number, job in run_tasks(square, list(range(9)), executor)}
        assert found == {number: number**2 for number in range(9)}
        jobs = [executor.submit(square, number) for number in range(5)]
        assert [job.result() for job in reversed(jobs)] == [16, 9, 4, 1, 0]
        assert jobs[2].result() == 4
        with pytest.raises(RuntimeError, match="5 does not converge"):
            executor.submit(fails, 5).result()


@pytest.mark.slow
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
    others = active_children()
    with suppress(KeyboardInterrupt), ProcessExecutor(2) as executor:
        next(run_tasks(square, list(range(100)), executor))
        pids = [each.pid for each in active_children() if each not in others]
        raise KeyboardInterrupt
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
