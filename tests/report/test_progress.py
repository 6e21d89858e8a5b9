"""Progress: stage, counts and elapsed time; no output without a terminal."""

import io
import sys
import time
from pathlib import Path

import pytest

from compact.cli import program as cli
from compact.report import progress
from compact.report.progress import Progress, format_time, spinning, tracked

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_times_are_formatted_in_minutes():
    assert [format_time(seconds) for seconds in (0.2, 82.4, 3725)] == ["0:00", "1:22", "1:02:05"]


# the line


@pytest.fixture(autouse=True)
def terminal(monkeypatch):
    """A terminal of 100 columns, whatever that of the tests is."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")


def test_line_shows_stage_count_and_detail_is_refreshed_and_erased():
    stream = Terminal()
    for _ in tracked(range(3), "contact", stream=stream, after=0.0):
        time.sleep(0.4)
    assert "contact, 1 of 3" in stream.getvalue()
    assert "contact, 3 of 3" in stream.getvalue()
    stream = Terminal()
    with spinning("contact by fem", stream=stream, after=0.0) as job:
        time.sleep(0.5)
        job.report("step 12 of the march")
        time.sleep(0.5)
    seen = stream.getvalue()
    assert seen.count("contact by fem") >= 2
    assert "contact by fem, step 12 of the march" in seen
    assert "0:00 elapsed" in seen
    assert seen.endswith("\x1b[2K")  # the line is erased


@pytest.mark.parametrize(
    ("stream", "quiet"), [(io.StringIO(), False), (Terminal(), True)], ids=["no terminal", "quiet"]
)
def test_no_line_without_a_terminal_or_if_quiet(stream, quiet):
    with spinning("contact", stream=stream, quiet=quiet, after=0.0):
        time.sleep(0.3)
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
