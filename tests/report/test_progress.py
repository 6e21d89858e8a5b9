"""Progress: stage, counts and elapsed time; no output without a terminal."""

import io
import re
import sys
import time
from pathlib import Path

import pytest

from compact.cli import program as cli
from compact.report.progress import spinning, tracked

SCENES = Path(__file__).parents[2] / "compact" / "data" / "scenes"


class Terminal(io.StringIO):
    def isatty(self):
        return True


# the line


@pytest.fixture(autouse=True)
def terminal(monkeypatch):
    """A terminal of 100 columns, whatever that of the tests is."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")


def test_line_shows_stage_count_and_detail_is_refreshed_and_erased():
    stream = Terminal()
    for _ in tracked(range(3), "contact", stream=stream):
        time.sleep(0.4)
    seen = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", stream.getvalue())
    assert "elapsed 0 of 3 contact" in seen
    assert "2 of 3 contact 3" in seen
    stream = Terminal()
    with spinning("contact by fem", stream=stream) as job:
        time.sleep(0.5)
        job.report("step 12 of the march")
        time.sleep(0.5)
    seen = stream.getvalue()
    assert seen.count("contact by fem") >= 2
    assert "contact by fem, step 12 of the march" in seen
    assert "elapsed contact by fem" in seen
    assert seen.endswith("\x1b[2K")  # the line is erased


@pytest.mark.parametrize(
    ("stream", "quiet"), [(io.StringIO(), False), (Terminal(), True)], ids=["no terminal", "quiet"]
)
def test_no_line_without_a_terminal_or_if_quiet(stream, quiet):
    with spinning("contact", stream=stream, quiet=quiet):
        time.sleep(0.3)
    assert stream.getvalue() == ""


CALLS = {
    "roll": (
        "roll", "--engine", "spectral", "--set", "machine.gap_geometry=circle",
        "--set", "machine.roller_condition=frictionless",
    ),
    "run": ("run", "--set", "output.items=['tables','figures']"),
    "sweep": ("sweep", "--vary", "mix.moisture=0.09:0.11:3", "--workers", "1", "--set", "output.items=[]"),
}  # fmt: skip


@pytest.mark.sampled(3)
@pytest.mark.parametrize("quiet", [False, True], ids=["shown", "quiet"])
@pytest.mark.parametrize("command", CALLS)
def test_commands_show_their_progress(command, quiet, tmp_path, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    name, *options = CALLS[command]
    scene, out = str(SCENES / "small.toml"), str(tmp_path / "out")
    code = cli._exit_code([name, scene, *options, "--out", out, *["--quiet"] * quiet])
    assert code == 0, stream.getvalue()
    assert ("elapsed" in stream.getvalue()) != quiet
