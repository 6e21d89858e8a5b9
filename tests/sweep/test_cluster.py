"""Sweeps on a cluster of separate processes that fail, and the lock of a directory on a shared disk."""

import json
import logging
import os
import platform
import signal
import subprocess
import sys
import time

import pytest
import xarray
from interrupts import of_unix
from sweeps import COLUMNS

from compact.analysis.stages.ensemble import LOCK, open_store
from compact.analysis.worker_pool import DaskExecutor, SerialExecutor
from compact.files import ResultsError
from compact.sweep.design import read_design
from compact.sweep.run import Sweep

GRID = ("mix.moisture=0.08:0.12:6", "mix.density_ratio=0.94:0.98:100")  # 6 tasks
START_SECONDS = 60.0  # [s], limit


def sweep():
    return Sweep(COLUMNS, [read_design(text) for text in GRID])


class Cluster:
    """Scheduler and workers of one thread, each a process, as they run on the nodes of a cluster."""

    def __init__(self, folder, workers):
        self.file = folder / "scheduler.json"
        self.scheduler = self._start(
            "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-show", "--scheduler-file", self.file
        )
        self.workers = [
            self._start(
                *("dask_worker", "--scheduler-file", self.file, "--nthreads", "1", "--no-nanny"),
                *("--local-directory", folder / f"worker-{number}"),
            )
            for number in range(workers)
        ]
        self.wait(workers)

    def _start(self, module, *arguments):
        call = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, arguments), "--no-dashboard"]
        return subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def wait(self, workers):
        from distributed import Client

        limit = time.monotonic() + START_SECONDS
        while not self.file.exists() and time.monotonic() < limit:
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]
        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=START_SECONDS)

    def stop(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    running = Cluster(tmp_path, workers=2)
    yield running
    running.stop()


# lost processes


@of_unix
@pytest.mark.slow
def test_sweep_is_complete_though_a_worker_is_lost_with_its_tasks(cluster, tmp_path):
    os.kill(cluster.workers[0].pid, signal.SIGSTOP)  # it gets tasks and does not return them
    lost = []

    def lose(points, failed):
        if points and not lost:
            lost.append(points)
            cluster.workers[0].kill()

    table = sweep().run(tmp_path / "lost", executor=DaskExecutor(cluster.address), step=lose)
    assert lost
    assert lost[0] < 600
    assert (table["reason"] == "").all()
    whole = sweep().run(tmp_path / "whole", executor=SerialExecutor())
    xarray.testing.assert_identical(table, whole)


# lock


def test_directory_of_a_running_sweep_is_refused(tmp_path):
    with open_store(tmp_path / "points"):
        with pytest.raises(ResultsError, match="another command writes to this directory; wait for it"):
            Sweep(COLUMNS, [read_design("mix.moisture=0.1")]).run(tmp_path, executor=SerialExecutor(), force=True)
        assert (tmp_path / LOCK).exists()
    assert not (tmp_path / LOCK).exists()


@pytest.mark.skipif(os.name != "posix", reason="no process can be looked up")
def test_lock_of_an_ended_process_is_taken_over(tmp_path):
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    (tmp_path / LOCK).write_text(f"{ended.pid}\n{platform.node()}\n")
    with open_store(tmp_path / "points"):
        assert (tmp_path / LOCK).read_text().startswith(f"{os.getpid()}\n")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of threads of the client, whose connection ends
def test_lost_scheduler_ends_the_sweep_in_a_sentence_and_the_rest_is_resumed(cluster, tmp_path, caplog, monkeypatch):
    log = logging.getLogger("distributed.client")
    monkeypatch.setattr(log, "handlers", [*log.handlers, caplog.handler])

    def lose(points, failed):
        if points:
            cluster.scheduler.kill()

    first = sweep()
    with pytest.raises(RuntimeError, match=r"scheduler at tcp://.* is lost .*; finished points are kept, .* --resume"):
        first.run(tmp_path / "out", executor=DaskExecutor(cluster.address), step=lose)
    rest = sweep()
    table = rest.run(tmp_path / "out", executor=SerialExecutor(), resume=True)
    assert not [record.getMessage() for record in caplog.records if record.exc_info]  # no traceback before the sentence
    assert first.store.computed >= 100
    assert first.store.computed + rest.store.computed == 600
    assert (table["reason"] == "").all()
