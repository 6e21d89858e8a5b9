"""Progress: stage, elapsed and remaining time weighted by cost; no output without a terminal."""

import io
import os
import re
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from compact.analysis.stages import costs as stage_costs
from compact.analysis.study import Study
from compact.cli import program as cli
from compact.report import progress
from compact.report.progress import Progress, format_time, spinning, tracked
from compact.scene.loader import load_scene

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    """Clock that the test sets."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def paced(total):
    clock = Clock()
    return clock, Progress(total=total, stream=Terminal(), after=1e9, clock=clock)


# the estimate


def test_work_is_weighted_by_its_cost():
    clock, job = paced(10.0)
    for _ in range(5):  # half of the stages, a tenth of the work
        job.begin("small", 0.2)
        clock.now += 0.4
    job.begin("large", 9.0)
    assert job.share == pytest.approx(0.1)
    assert job.remaining == pytest.approx(18.0)


def test_remaining_time_decreases_in_a_long_stage_up_to_its_cost():
    clock, job = paced(10.0)
    job.begin("first", 2.0)
    clock.now = 4.0
    job.begin("second", 4.0)
    left = []
    for clock.now in (4.0, 8.0, 12.0, 16.0):
        left.append(job.remaining)
    assert left[:3] == pytest.approx([16.0, 12.0, 8.0])  # half a unit of cost a second
    assert job.share == pytest.approx(0.6)  # not beyond the stage that still runs


def test_new_total_changes_the_estimate():
    clock, job = paced(4.0)
    job.begin("first", 2.0)
    clock.now = 2.0
    job.begin("second", 2.0, total=8.0)
    assert job.remaining == pytest.approx(6.0)


def test_no_estimate_before_the_first_stage_ends():
    clock, job = paced(4.0)
    job.begin("first", 4.0)
    clock.now = 100.0
    assert job.remaining is None


@pytest.mark.parametrize("bad", [-1.0, float("nan"), float("inf")])
def test_invalid_costs_raise(bad):
    _, job = paced(4.0)
    with pytest.raises(ValueError, match=f"`cost` of a stage must be finite and not negative, got {bad}"):
        job.begin("first", bad)
    with pytest.raises(ValueError, match=f"`total` must be finite and not negative, got {bad}"):
        job.begin("first", 1.0, total=bad)


def test_times_are_formatted_in_minutes():
    assert [format_time(seconds) for seconds in (0.2, 82.4, 3725)] == ["0:00", "1:22", "1:02:05"]


# seconds of processor time, each stage as often as it ran; measured on one machine, not by these costs
MEASURED = {
    "loveikin-2015-engines": [
        ("laws", 21, 0.01), ("contact", 1, 0.01), ("rolled", 1, 14.3), ("rolled", 1, 4.0), ("second pass", 1, 2.2),
        ("runs", 42, 1.84), ("cams", 63, 0.0), ("cams measured", 63, 1.06), ("crank", 5, 0.58), ("fields", 2, 0.5),
        ("figures", 1, 0.3), ("rankings", 1, 0.31), ("comparison", 4, 3.0), ("model spread", 1, 10.0),
        ("uncertainty", 1, 4.0), ("report", 1, 1.3), ("figures", 13, 4.2),
    ],
    "loveikin-2015": [
        ("contact", 1, 0.01), ("laws", 21, 0.01), ("runs", 21, 0.05), ("cams", 63, 0.0), ("cams measured", 63, 1.30),
        ("crank", 5, 0.03), ("rankings", 1, 0.34), ("uncertainty", 1, 2.5), ("report", 1, 1.3), ("figures", 9, 3.6),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", MEASURED)
def test_remaining_time_of_a_study_is_within_half_after_a_third(name):
    study, (clock, job) = Study(load_scene(SCENES / f"{name}.toml")), paced(0.0)
    whole, told = sum(seconds for *_, seconds in MEASURED[name]), []
    for stage, count, seconds in MEASURED[name]:
        for _ in range(count):
            study.counts[stage] += 1
            job.begin(stage, study.plan.cost(stage), total=study.plan.total_cost)
            clock.now += seconds / count
            if whole / 3 < clock.now < 0.9 * whole:
                told.append(job.remaining / (whole - clock.now))
    assert 1 / 1.5 < min(told) < max(told) < 1.5


def test_every_stage_of_a_study_has_a_cost():
    study = Study(load_scene(SCENES / "loveikin-2015-engines.toml"))
    assert set(study.plan.planned) <= {
        "runs",
        "rolled",
        "resistance",
        "added mass",
        "second pass",
        "driven",
        "report",
        "durations",
        "comparison",
        "model spread",
        "coupled",
    } | set(stage_costs.OTHERS)
    assert all(study.plan.cost(stage) >= 0 for stage in study.plan.planned)
    assert study.plan.total_cost > 3 * study.plan.cost("rolled")


def test_plan_counts_the_contacts_coupled_with_their_pore_air():
    """One at each speed of the scene, none by the other models of the air, by columns, and with kept results."""
    lift = {"accuracy.engine": "compaction", "layer.lift_thickness": 0.06, "contact.indentation": 0.003}
    scene = load_scene(SCENES / "loveikin-2015.toml", **lift | {"contact.speeds": [0.1, 0.2, 0.4]})
    plans = {air: Study(scene.replaced(**{"mix.pore_air": air})).plan for air in ("drained", "one-way", "coupled")}
    assert [plan.planned["coupled"] for plan in plans.values()] == [0, 0, 3]
    assert plans["coupled"].total_cost - plans["one-way"].total_cost == pytest.approx(
        3 * plans["coupled"].cost("coupled")
    )
    columns = scene.replaced(**{"accuracy.engine": "column", "mix.pore_air": "coupled"})
    assert Study(columns).plan.planned["coupled"] == 0
    kept = Study(scene.replaced(**{"mix.pore_air": "coupled"}))
    kept.counts["kept"] = 1
    assert kept.plan.planned["coupled"] == 0


def test_whole_cost_at_the_end_is_that_of_the_stages():
    study = Study(load_scene(SCENES / "loveikin-2015-engines.toml"))
    study.counts |= Counter({"resistance": 9, "added mass": 15, "runs": 42, "rankings": 1, "driven": 12})
    each = sum(count * study.plan.cost(stage) for stage, count in study.plan.planned.items())
    assert study.plan.total_cost == pytest.approx(each + study.engine.cost.first_contact)


# the line


def test_line_is_refreshed_and_erased():
    stream = Terminal()
    with spinning("contact by fem", stream=stream, after=0.0):
        time.sleep(0.9)
    seen = stream.getvalue()
    assert seen.count("contact by fem") >= 2
    assert "0:00 elapsed" in seen
    assert seen.endswith("\x1b[2K")  # the line is erased


def test_line_shows_the_detail_of_a_solver():
    stream = Terminal()
    with spinning("contact by compaction", stream=stream, after=0.0) as job:
        job.report("step 12 of the march")
        time.sleep(0.4)
    assert "contact by compaction, step 12 of the march" in stream.getvalue()


def test_cases_are_counted_and_estimated():
    stream = Terminal()
    for _ in tracked(range(3), "contact", stream=stream, after=0.0):
        time.sleep(0.4)
    seen = stream.getvalue()
    assert "contact, 1 of 3" in seen
    assert "contact, 3 of 3" in seen
    assert re.search(r"\d+% .*elapsed, about 0:0\d left", seen)


@pytest.mark.parametrize(
    ("stream", "quiet"), [(io.StringIO(), False), (Terminal(), True)], ids=["no terminal", "quiet"]
)
def test_no_line_without_a_terminal_or_if_quiet(stream, quiet):
    with spinning("contact", stream=stream, quiet=quiet, after=0.0):
        time.sleep(0.3)
    assert stream.getvalue() == ""


def test_short_job_has_no_line():
    stream = Terminal()
    with spinning("contact", stream=stream):
        pass
    assert stream.getvalue() == ""


def test_line_of_a_failed_job_is_erased():
    stream = Terminal()

    def fails():
        with spinning("contact", stream=stream, after=0.0):
            time.sleep(0.3)
            raise RuntimeError("not settled")

    with pytest.raises(RuntimeError, match="not settled"):
        fails()
    assert stream.getvalue().endswith("\x1b[2K")


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminal on this system")
def test_script_shows_its_progress_on_a_terminal():
    script = (
        "import time; from compact.report.progress import tracked\n"
        "for case in tracked(range(2), 'case', after=0.0): time.sleep(0.4)\n"
    )
    master, slave = os.openpty()
    job = subprocess.Popen([sys.executable, "-c", script], stderr=slave, env=os.environ | {"TERM": "xterm"})
    assert job.wait(timeout=60) == 0
    os.close(slave)
    seen = os.read(master, 100_000).decode()
    os.close(master)
    assert "case, 2 of 2" in seen


CALLS = {
    "roll": (
        "roll", "--engine", "spectral", "--set", "machine.gap_geometry=circle",
        "--set", "machine.roller_condition=frictionless",
    ),
    "run": ("run", "--set", "output.items=['tables','figures']"),
    "calibrate": ("calibrate", str(SCENES / "loveikin-2015-printed.toml")),
    "sweep": ("sweep", "--vary", "mix.moisture=0.09:0.11:3", "--workers", "1", "--set", "output.items=[]"),
}  # fmt: skip


@pytest.mark.sampled(3)
@pytest.mark.parametrize("quiet", [False, True], ids=["shown", "quiet"])
@pytest.mark.parametrize("command", CALLS)
def test_commands_show_their_progress(command, quiet, tmp_path, monkeypatch):
    drawn, stream = [], Terminal()
    monkeypatch.setattr(progress, "DELAY", 0.0)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(Progress, "_render", lambda self: drawn.append((self.stage, self.elapsed)) or self.stage)
    name, *options = CALLS[command]
    scene = str(SCENES / ("loveikin-2015.toml" if command == "calibrate" else "small.toml"))
    ahead = [scene, options.pop(0)] if command == "calibrate" else [scene]
    out = tmp_path / ("out.json" if command == "calibrate" else "out")
    code = cli._exit_code([name, *ahead, *options, "--out", str(out), *["--quiet"] * quiet])
    assert code == 0, stream.getvalue()
    assert bool(drawn) != quiet
