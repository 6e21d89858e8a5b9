"""Hypothesis draws the same examples in every run; samples of long tests; code is compiled before the workers start."""

import gc
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import pytest
import sampling
from hypothesis import settings

settings.register_profile("compact", max_examples=50, deadline=None, derandomize=True, print_blob=True)
settings.load_profile("compact")

ROOT = Path(__file__).parents[1]
SMALL = str(ROOT / "compact" / "data" / "scenes" / "small.toml")
ELASTIC_DRIVE = [
    *("run", SMALL, "--set", "drive.kind=elastic", "--set", "drive.stiffness=1e6", "--set", "drive.damping=3e3"),
    *("--set", "drive.backlash=1e-4", "--set", "output.items=[]", "--set", "motion.laws=['cubic']", "--quiet"),
]
COLUMNS_AND_COMPACTION = """
from compact.engines.column import engine as column
from compact.engines.compaction import engine as compaction
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller

mix = Compaction(
    unloading_modulus=20e6, poisson=0.3, heckel_slope=13e-6, loose_density_ratio=0.72, critical_slope=1.2,
    tensile_strength=14e3, fed_density_ratio=0.94,
)
layer, roller = Layer(0.1), Roller(20.0, indentation=0.002)
column.roll(layer, roller, mix, 0.2)
compaction.roll(layer, roller, mix, 0.2, increments=4)
"""


def pytest_configure(config: pytest.Config) -> None:
    """Compile what most tests need, unless it is compiled or this is a worker or a single process."""
    sampling.slow_run = config.getoption("markexpr", "") in ("", "slow")
    compiled = any((ROOT / "compact" / "machine" / "__pycache__").glob("spring_cart.*.nbi"))
    if compiled or hasattr(config, "workerinput") or not config.getoption("numprocesses", None):
        return
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder:
        calls = [
            [sys.executable, "-m", "compact", *ELASTIC_DRIVE, "--out", folder],
            [sys.executable, "-c", COLUMNS_AND_COMPACTION],
        ]
        for process in [subprocess.Popen(call, env=environment) for call in calls]:
            process.wait()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases outside a sample slow, and all tests that the slow run repeats with more examples."""
    cases = defaultdict(list)
    for item in items:
        if sampling.slow_run and item.get_closest_marker("repeated"):
            item.add_marker(pytest.mark.slow)
        if item.get_closest_marker("sampled") and not item.get_closest_marker("slow"):
            cases[item.nodeid.partition("[")[0]].append(item)
    for group in cases.values():
        default = sampling.sample(group, item_count(group[0]))
        for item in group:
            if item not in default:
                item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Exclude what collection made from the search for garbage, which saves 3 % of the time."""
    gc.collect()
    gc.freeze()


def item_count(item: pytest.Item) -> int:
    """Number of cases that the default run takes of a test."""
    return item.get_closest_marker("sampled").args[0]
