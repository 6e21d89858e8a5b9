"""Progress: stage, counts and elapsed time; no output without a terminal."""

import io
import re
import time

import pytest

from compact.report.progress import spinning, tracked


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
