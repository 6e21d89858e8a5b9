"""Steady contact without air shared by the tests of pore air."""

import pytest

from compact.engines.compaction.engine import roll
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller


@pytest.fixture(scope="session")
def contact():
    """Roller 2 mm deep in a layer of 100 mm, on 4 increments per contact length."""
    mix = Compaction(
        unloading_modulus=60e6,
        poisson=0.3,
        heckel_slope=13e-6,
        loose_density_ratio=0.72,
        critical_slope=1.2,
        tensile_strength=14e3,
        fed_density_ratio=0.94,
    )
    return roll(Layer(0.1), Roller(0.11, indentation=0.002, profile="deformed"), mix, 0.2, increments=4)
