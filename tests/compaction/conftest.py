"""Steady solutions shared by the tests of the engine "compaction"."""

import pytest
from mixes import MIX

from compact.engines.compaction.engine import roll
from compact.engines.compaction.rolling_case import RollingCase
from compact.rolling_contact import Layer, Roller

# 2 mm depth in a layer of 100 mm: contact length 21 mm, bow wave of the height of the depth
LAYER, ROLLER = Layer(0.1), Roller(0.11, indentation=0.002, profile="deformed")


@pytest.fixture(scope="session")
def mix():
    """Compacting mix."""
    return MIX


@pytest.fixture(scope="session")
def layer():
    """Layer that is high compared with the contact length."""
    return LAYER


@pytest.fixture(scope="session")
def roller():
    """Frictionless roller at a depth of 2 mm."""
    return ROLLER


@pytest.fixture(scope="session")
def coarse():
    """Steady rolling on 4 elements per contact length."""
    return roll(LAYER, ROLLER, MIX, 0.2, increments=4)


@pytest.fixture(scope="session")
def fine():
    """Steady rolling on 8 elements per contact length, for slow tests."""
    return roll(LAYER, ROLLER, MIX, 0.2, increments=8)


class SolutionReached(Exception):  # noqa: N818 - no error of the package
    """The arguments are accepted and the solution begins."""


@pytest.fixture
def no_solution(monkeypatch):
    """End `roll` before any finite elements by the exception that the fixture is."""

    def reached(*arguments):
        raise SolutionReached

    monkeypatch.setattr(RollingCase, "create_frame", reached)
    return SolutionReached
