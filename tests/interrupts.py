"""Processes that tests start, and interrupt."""

import os
import signal
import subprocess
import sys
from time import monotonic, sleep

import pytest

of_unix = pytest.mark.skipif(os.name != "posix", reason="signals of Unix")


def heed_interrupts():
    """A shell lets what it starts in the background ignore them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(code, signs=b"begun"):
    """Exit code of a program that gets an interrupt as soon as it has said that it has begun, and seconds it took."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "preexec_fn": heed_interrupts}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as started:
        try:
            assert started.stdout.readline().strip() == signs, started.stderr.read()
            sleep(0.3)
            sent = monotonic()
            started.send_signal(signal.SIGINT)
            message = started.communicate(timeout=60)[1].decode()
            return started.returncode, monotonic() - sent, message
        finally:
            started.kill()
