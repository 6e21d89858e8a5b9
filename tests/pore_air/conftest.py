"""Steady contact without air shared by the tests of pore air."""

import pytest
from column_cases import mix

from compact.engines.compaction.engine import roll
from compact.rolling_contact import Layer, Roller


@pytest.fixture(scope="session")
def contact():
    """Roller 2 mm deep in a layer of 100 mm, on 4 increments per contact length."""
    material = mix(unloading_modulus=60e6, fed_density_ratio=0.94, dry_side="flat")
    return roll(Layer(0.1), Roller(0.11, indentation=0.002, profile="deformed"), material, 0.2, increments=4)


@pytest.fixture(scope="session")
def wide():
    """Contact eight heights long over a thin layer, where columns do not move sideways, on 12 increments."""
    material = mix(unloading_modulus=20e6, fed_density_ratio=0.94, dry_side="flat")
    roller = Roller((8 * 0.05) ** 2 / (2 * 0.0015), indentation=0.0015, profile="deformed")
    return roll(Layer(0.05), roller, material, 0.2, increments=12)
