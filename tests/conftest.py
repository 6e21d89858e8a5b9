"""Hypothesis draws the same examples in every run, and compiled code is made once, before the workers start."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("compact", max_examples=50, deadline=None, derandomize=True, print_blob=True)
settings.load_profile("compact")

ROOT = Path(__file__).parents[1]
SMALL = str(ROOT / "studies" / "scenes" / "small.toml")
COMMANDS = (  # that compile the elastic drive and the columns, side by side
    [
        *("run", SMALL, "--set", "drive.kind=elastic", "--set", "drive.stiffness=1e6", "--set", "drive.damping=3e3"),
        *("--set", "drive.backlash=1e-4", "--set", "output.items=[]", "--set", "motion.laws=['cubic']"),
    ],
    ["roll", SMALL, "--engine", "column"],
)


def pytest_configure(config: pytest.Config) -> None:
    """Compile what most tests need, unless it is compiled or this is a worker or a single process."""
    compiled = any((ROOT / "compact" / "dynamics" / "__pycache__").glob("event_driven.*.nbi"))
    if compiled or hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        return
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder:
        calls = [
            [sys.executable, "-m", "compact", *command, "--quiet", "--out", str(Path(folder) / command[0])]
            for command in COMMANDS
        ]
        for process in [subprocess.Popen(call, env=environment) for call in calls]:
            process.wait()
