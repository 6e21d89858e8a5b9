"""Comparison of engines: each gives the results of its own scene, in one process or several, or from stored files."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from interrupts import heed_interrupts, of_unix

from compact.analysis.study import Study
from compact.analysis.worker_pool import ProcessExecutor
from compact.report import writer as report
from compact.scene.loader import load_scene

ROOT = Path(__file__).parents[2]
ENGINES = ROOT / "compact" / "data" / "scenes" / "loveikin-2015-engines.toml"
PLAIN = {"machine.gap_geometry": "circle", "machine.roller_condition": "frictionless"}
QUICK = {"contact.speeds": [0.05, 0.15], "contact.peak_pressure": 203e3, "accuracy.tolerance": 0.05}
COMPARED = {"column": {"layer": {"fed_density_ratio": 0.95}, "contact": {"peak_pressure": 180e3}}}
STUDY = {
    "accuracy.engine": "spectral", "compare": COMPARED, "output.items": ["tables"], "drive.turn": "step",
}  # fmt: skip


def scene(**changes):
    return load_scene("small", **PLAIN | QUICK | STUDY | changes)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Study, summary and directory of a scene whose compared engines ran in other processes."""
    directory = tmp_path_factory.mktemp("comparison")
    study = Study(scene(), directory=directory)
    return study, report.write_study(study, directory, executor=ProcessExecutor(1)), directory


# results


@pytest.mark.parametrize(
    ("engine", "given"),
    [("column", {"layer.fed_density_ratio": 0.95, "contact.peak_pressure": 180e3}), ("formula", {})],
)
def test_compared_engine_gives_the_results_of_its_own_scene(written, engine, given):
    study, _, _ = written
    alone = Study(scene(**{"accuracy.engine": engine, "compare": None, "output.items": []} | given))
    compared_engine = study.comparison[engine]
    speed = np.array([0.06, 0.12])
    assert compared_engine.resistance(speed, 0 * speed) == pytest.approx(
        alone.stages.resistance.resistance(speed, 0 * speed), rel=1e-12
    )
    for by, ranked in alone.stages.drive.rankings.items():
        found = [(place.rank, place.law, place.value) for place in study.places_by_engine[engine]["rigid"][by]]
        assert found == [(place.rank, place.run.name, pytest.approx(place.value, rel=1e-12)) for place in ranked]


def test_error_of_a_criterion_follows_from_the_error_of_the_resistance(written):
    study, summary, _ = written
    share = study.stages.resistance.error
    assert 0 < share < 0.1
    friction = study.stages.resistance.cart.guide_friction * (
        2 * study.stages.contacts.roller_load - study.stages.resistance.cart.weight
    )
    for name, run in study.stages.drive.runs.items():  # energy of a cycle less the friction of the guides
        mix = run.energy - 0.8 * friction
        assert summary["laws"][name]["errors"]["energy"] == pytest.approx(share * mix, rel=0.02)
        assert summary["units"]["energy"] == "J"


# files


@of_unix
def test_interrupted_run_leaves_complete_files_and_no_process(tmp_path):
    call = [sys.executable, "-m", "compact.cli", "run", str(ENGINES), "--out", str(tmp_path / "out")]
    options = {"start_new_session": True, "preexec_fn": heed_interrupts}
    job = subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **options)
    until = time.monotonic() + 120
    while len(children(job.pid)) < 3 and time.monotonic() < until:  # resource tracker and two workers
        time.sleep(0.1)
    helpers = children(job.pid)
    assert len(helpers) >= 3
    os.kill(job.pid, signal.SIGINT)
    message = job.communicate(timeout=60)[1]
    assert job.returncode == 130
    assert message.startswith("compact: interrupted; every file already written is whole; complete files are in ")
    assert not list(tmp_path.rglob("*.part"))
    while any(map(alive, helpers)) and time.monotonic() < until:  # the tracker ends with its pipe
        time.sleep(0.1)
    assert not [pid for pid in helpers if alive(pid)]


def children(pid):
    """Process identifiers of the children of a process."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            number, rest = stat.parent.name, stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(rest[1]) == pid:
            found.append(int(number))
    return found


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
