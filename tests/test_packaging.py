"""Packaging: one version, dependencies of pip and conda, versions of Python, a container that runs a scene."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import yaml

from compact.files import published_scenes

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
CONDA_NAMES = {"matplotlib": "matplotlib-base"}  # of conda-forge, where they differ
SUPPORTED = ("3.11", "3.12", "3.13", "3.14")


def conda_dependency(requirement):
    """Dependency of pip as conda writes it."""
    name, bounds = re.fullmatch(r"([\w-]+)(\S*)", requirement).groups()
    return f"{CONDA_NAMES.get(name, name)} {bounds}"


def test_version_has_one_value():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text("utf-8"))
    assert {citation["version"], recipe["context"]["version"], version("compact")} == {PROJECT["version"]}


def test_conda_recipe_has_the_dependencies_of_the_wheel():
    recipe = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text("utf-8"))
    required = [f"python {PROJECT['requires-python']}", *map(conda_dependency, PROJECT["dependencies"])]
    assert recipe["requirements"]["run"] == required


def test_versions_of_python_are_those_of_the_workflow():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8"))
    assert tuple(workflow["jobs"]["tests"]["strategy"]["matrix"]["python"]) == SUPPORTED
    named = [each.rpartition(" ")[2] for each in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", each)]
    assert tuple(named) == SUPPORTED


def test_container_copies_what_exists():
    lines = (ROOT / "Dockerfile").read_text("utf-8").splitlines()
    copied = [name for line in lines if re.match(r"COPY (?!--)", line) for name in line.split()[1:-1]]
    assert "compact" in copied
    assert all((ROOT / name).exists() for name in copied)
    assert re.search(r'CMD \["run", "(.*)"\]', "\n".join(lines))[1] in published_scenes()
    kept = [line[1:] for line in (ROOT / ".dockerignore").read_text("utf-8").splitlines() if line.startswith("!")]
    assert set(copied) <= set(kept)


def test_notes_of_a_release_are_a_section_of_the_changelog():
    call = [sys.executable, str(ROOT / ".ci" / "release_notes")]
    notes = subprocess.run([*call, "Unreleased"], capture_output=True, text=True, check=True).stdout
    assert notes.startswith("###")
    refused = subprocess.run([*call, "99.0"], capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "no section [99.0]; move the lines of [Unreleased] there" in refused.stderr


def test_scripts_of_ci_name_tests_that_exist():
    scripts = [path.read_text("utf-8") for path in (ROOT / ".ci").iterdir() if path.is_file()]
    named = set(re.findall(r"\b(?:tests|studies|docs)/[\w/.-]*\w", "\n".join(scripts)))
    assert "tests/regression" in named
    assert not [name for name in named if not (ROOT / name).exists()]
