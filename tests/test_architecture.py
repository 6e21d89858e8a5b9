"""Architecture of the package: layers of imports, light start-up, public names that resolve."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from importlinter.application.use_cases import lint_imports

import compact

ROOT = Path(__file__).parents[1]
HEAVY = ("numpy", "scipy", "matplotlib", "pydantic")


def test_imports_keep_the_layers_of_pyproject(monkeypatch):
    from importlinter import configuration

    monkeypatch.chdir(ROOT)
    configuration.configure()
    assert lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None)


@pytest.mark.parametrize("module", ["compact", "compact.cli"])
def test_start_up_imports_no_heavy_package(module):
    script = f"import sys, {module}; print(*sorted(set({HEAVY}) & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == []


IMPORT_ALL = """
import importlib, pkgutil
import compact

before = {name: getattr(compact, name) for name in compact.__all__}
for module in pkgutil.walk_packages(compact.__path__, "compact."):
    importlib.import_module(module.name)
print(*(name for name in compact.__all__ if getattr(compact, name) is not before[name]))
"""


def test_every_module_imports_and_leaves_public_names_as_they_were():
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split() == []
    assert len(compact.__all__) > 40


def test_modules_are_importable_under_their_public_names():
    from compact import column, contact, drive, fem, material, mix, motion, spectral

    engines = (column.roll, contact.roll, fem.roll, spectral.roll)
    named = (drive.simulate, drive.rank, material.Elastic, mix.prior, motion.law, motion.LAWS, motion.optimise)
    assert all(engines)
    assert all(named)
