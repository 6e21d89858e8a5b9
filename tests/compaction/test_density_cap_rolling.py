"""Steady rolling over mix with tables over the density: thin layers against columns, powder, concrete, refinement."""

from pathlib import Path

import pytest

from compact.engines.column import engine as column
from compact.engines.compaction.engine import roll
from compact.material.density_cap import density_dependent_cap
from compact.rolling_contact import Layer, Roller
from compact.scene.cap_tables import read_cap_tables
from compact.validation.powder import ph102

pytestmark = pytest.mark.slow  # kernels of their own, compiled for some ten seconds
SCENES = Path(__file__).parents[2] / "studies" / "scenes"
HEIGHT, DEPTH = 0.01, 0.001


@pytest.mark.parametrize(("increments", "load", "resistance"), [(24, 1e-3, 1e-3), (48, 5e-4, 5e-4)])
def test_thin_layer_tends_to_columns(increments, load, resistance):
    """The contact is twenty heights long."""
    law, roller = density_dependent_cap(ph102(), 0.6), Roller((20 * HEIGHT) ** 2 / (2 * DEPTH), DEPTH, profile="circle")
    columns = column.roll(Layer(HEIGHT), roller, law, 0.1)
    found = roll(Layer(HEIGHT), roller, law, 0.1, increments=increments)
    assert found.load == pytest.approx(columns.load, rel=load)
    assert found.resistance == pytest.approx(columns.resistance, rel=resistance)
    assert found.exit_density_ratio == pytest.approx(columns.exit_density_ratio, abs=2e-4)


def test_powder_is_found_with_its_error():
    """Compressed by 30 % in one pass; a mesh of 14 elements differs by less than both error estimates."""
    law, roller = density_dependent_cap(ph102(), 0.4), Roller(0.11, 0.006, 0.3, "free", "circle")
    coarse, fine = (roll(Layer(0.02), roller, law, 0.1, increments=n) for n in (8, 14))
    assert fine.exit_density_ratio == pytest.approx(0.556, abs=2e-3)
    assert max(coarse.error) < 0.04
    assert fine.load == pytest.approx(coarse.load, rel=fine.error[0] + coarse.error[0])
    assert fine.resistance == pytest.approx(coarse.resistance, rel=fine.error[1] + coarse.error[1])
    assert max(fine.mass_residual, coarse.mass_residual) < 5e-4  # of any law in steep contacts


def test_concrete_fed_loose_is_found():
    law = density_dependent_cap(read_cap_tables(SCENES / "concrete-cap.csv"), 0.9)
    found = roll(Layer(0.0653), Roller(0.11, 0.0054, 0.35, "free", "deformed"), law, 0.133, increments=4)
    assert found.exit_density_ratio == pytest.approx(0.982, abs=2e-3)
    assert found.load == pytest.approx(8240, rel=0.01)
    assert found.bow_wave < 2e-4
