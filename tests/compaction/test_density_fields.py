"""Density of the published lift, at rest and under load: fields for other programs, and numbers of the contact."""

import numpy as np
import pytest
from mixes import LIFT, LIFT_MIX, free_roller

from compact import fem
from compact.engines.compaction.engine import roll

FIELDS = {"density_ratio", "density_under_load", "pressure", "saturation_pressure", "stress", "plastic_work"}


@pytest.fixture(scope="module")
def rolled():
    return roll(LIFT, free_roller(), LIFT_MIX, 0.13, increments=4)


def read(rolled, path):
    """The fields as another program reads them from a file."""
    pyvista = pytest.importorskip("pyvista")
    fem.write_fields(rolled, path)
    return pyvista.read(path)


@pytest.fixture
def grid(rolled, tmp_path):
    return read(rolled, tmp_path / "lift.vtu")


def test_a_file_has_the_fields_and_the_density_under_load_is_that_at_rest_times_the_elastic_compression(grid):
    assert set(grid.cell_data) == FIELDS
    shapes = {name: grid.cell_data[name].shape for name in FIELDS}
    assert shapes == {name: (grid.n_cells, 6) if name == "stress" else (grid.n_cells,) for name in FIELDS}
    cells = grid.cell_data
    assert np.asarray(cells["pressure"]) == pytest.approx(-np.asarray(cells["stress"])[:, :3].mean(axis=1), abs=1e-6)
    loaded = cells["density_ratio"] * np.exp(cells["pressure"] / LIFT_MIX.bulk_modulus)
    assert np.asarray(cells["density_under_load"]) == pytest.approx(loaded, rel=1e-5)  # means of the elements
    assert cells["saturation_pressure"].min() == 0


def test_saturation_reaction_is_that_of_the_densest_state(rolled, grid):
    densest = rolled.solution.state.points.max_density_ratio
    reaction = LIFT_MIX.saturation_modulus * np.log(np.maximum(densest / LIFT_MIX.saturation_limit, 1))
    assert np.asarray(grid.cell_data["saturation_pressure"]) == pytest.approx(reaction.reshape(-1, 4).mean(axis=1))


def test_mix_at_rest_is_no_denser_than_the_limit_and_under_load_by_its_elastic_compression(rolled):
    assert LIFT_MIX.saturation_limit < rolled.peak_density_ratio < LIFT_MIX.saturation_limit + 1e-3
    pressure = -rolled.solution.state.points.stress[:, :3].mean(axis=1)
    highest = np.exp(pressure.max() / LIFT_MIX.bulk_modulus)
    assert 1 < rolled.peak_loaded_density_ratio / rolled.peak_density_ratio < highest


@pytest.mark.slow
def test_share_beyond_full_density_is_that_of_the_elements_between_the_edges(tmp_path):
    """An element counts by its mean density, the share by the points: 10 elements are needed."""
    rolled = roll(LIFT, free_roller(), LIFT_MIX, 0.13, increments=10)
    grid = read(rolled, tmp_path / "lift.vtu")
    grid.points += grid.point_data["displacement"]
    middle, area = grid.cell_centers().points[:, 0], grid.compute_cell_sizes()["Area"]
    between = (middle > rolled.trailing) & (middle < rolled.leading)
    full = between & (grid.cell_data["density_under_load"] > 1)
    assert rolled.overfull_share == pytest.approx(area[full].sum() / area[between].sum(), abs=0.02)
    assert 0 < rolled.overfull_share < 0.1


def test_mass_is_conserved_everywhere_and_the_density_is_reset_little(rolled):
    frame, state = rolled.solution.frame, rolled.solution.state
    interpolated, moved = frame.interpolated(state), frame.convect(state)
    ratio = moved.points.density_ratio / interpolated.points.density_ratio
    assert rolled.density_reset == pytest.approx(np.abs(np.log(ratio)).max(), rel=1e-9)
    assert rolled.density_reset < 1e-3
    assert rolled.mass_residual < 1e-9
