"""Steady contact without air shared by the tests of pore air."""

import pytest

from compact.engines.compaction.engine import roll
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller


@pytest.fixture(scope="session")
def contact():
    """Roller 2 mm deep in a layer of 100 mm, on 4 increments per contact length."""
    mix = Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)
    return roll(Layer(0.1), Roller(0.11, 0.002, profile="deformed"), mix, 0.2, increments=4)
