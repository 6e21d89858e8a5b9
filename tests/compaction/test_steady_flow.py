"""Pore air of a mix and its steady flow: permeability, voids, limits of drainage, consolidation, order, mass."""

import numpy as np
import pytest

from compact.engines.pore_air.steady_flow import AirFlow
from compact.material.mix import saturation
from compact.material.pore_air import PoreAir, water_volume

AMBIENT = 1e5  # [Pa]
SPEED = 0.1  # [m/s]


def grid_flow(columns, rows, mobility, drained_top=True):
    """Flow under a smooth compression from 0.07 to 0.03 of air voids, deeper at the surface."""
    x, y = np.linspace(-0.1, 0.1, columns + 1), np.linspace(0.0, 0.05, rows + 1)
    X, Y = np.meshgrid(x, y, indexing="ij")
    volume = 0.05 + 0.02 * np.tanh(X / 0.02) * (0.5 + 10 * Y)
    tensor = mobility * np.array([[1.0, 0.2], [0.2, 0.8]])
    drained = np.zeros(X.shape, bool)
    drained[:, -1] = drained_top
    return AirFlow(x, y, volume, np.multiply.outer(tensor, np.ones(X.shape)), drained, AMBIENT)


def test_without_drainage_boyles_law_holds_at_every_node():
    flow = grid_flow(24, 8, 1e-19, drained_top=False)
    found = flow.solve(SPEED)
    boyle = AMBIENT * flow.air_volume[-1] / flow.air_volume
    np.testing.assert_allclose(found.pressure, boyle, rtol=1e-6)
    assert found.pressure.max() > 2 * AMBIENT


def test_with_full_drainage_there_is_no_pressure():
    found = grid_flow(24, 8, 1.0).solve(SPEED)
    assert np.abs(found.excess).max() < 1e-9 * AMBIENT


@pytest.mark.parametrize("mobility", [1e-17, 1e-11, 1e-9, 1e-5])
def test_the_mass_of_the_air_is_conserved(mobility):
    found = grid_flow(24, 8, mobility).solve(SPEED)
    assert abs(found.mass_residual) < 1e-9


def test_pressure_depends_on_speed_over_permeability_alone():
    slow, fast = grid_flow(24, 8, 1e-10).solve(SPEED), grid_flow(24, 8, 1e-9).solve(10 * SPEED)
    np.testing.assert_allclose(fast.pressure, slow.pressure, rtol=1e-9)


@pytest.mark.parametrize("mobility", [1e-9, 1e-8])
def test_the_mesh_is_of_second_order(mobility):
    reference = grid_flow(128, 32, mobility).solve(SPEED).excess
    errors = [
        np.abs(grid_flow(n, n // 4, mobility).solve(SPEED).excess - reference[:: 128 // n, :: 128 // n]).max()
        for n in (16, 32, 64)
    ]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders.min() > 1.75
    assert errors[-1] < 5e-3 * reference.max()


def test_a_column_consolidates_as_terzaghis_series():
    """A sudden small compression at x = 0; behind it the air leaves through the surface of a column."""
    height, mobility, volume, step = 0.05, 1e-9, 0.05, 1e-6
    coefficient = mobility * AMBIENT / volume  # of consolidation [m2/s]
    duration = height**2 / coefficient  # of a time factor of 1
    times = duration * np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 500)])
    x = np.concatenate([-SPEED * times[::-1], SPEED * duration * np.array([1e-7, 1e-2])])
    y = height * np.sin(np.linspace(0, np.pi / 2, 81))  # finer at the surface
    air = np.where(x[:, None] <= 0, volume, volume * (1 + step)) * np.ones(len(y))
    tensor = np.zeros((2, 2, *air.shape))
    tensor[1, 1] = mobility
    drained = np.zeros(air.shape, bool)
    drained[:, -1] = True
    found = AirFlow(x, y, air, tensor, drained, AMBIENT).solve(SPEED)

    M = (2 * np.arange(400) + 1) * np.pi / 2
    for wanted in (0.2, 0.4, 0.8):
        column = np.argmin(abs(x + SPEED * wanted * duration))
        factor, excess = -x[column] / (SPEED * duration), found.excess[column]
        series = np.sum(2 / M * np.sin(np.outer(1 - y / height, M)) * np.exp(-(M**2) * factor), axis=1)
        np.testing.assert_allclose(excess / (step * AMBIENT), series, atol=1e-4)


def test_leakage_empties_a_column():
    x = np.linspace(-0.2, 0.1, 601)
    volume = np.where(x < 0, 0.04, 0.05)[:, None] * np.ones(2)
    tensor, drained = np.full((2, 2, 601, 2), 1e-20), np.zeros((601, 2), bool)
    flow = AirFlow(x, np.arange(2.0), volume, tensor, drained, AMBIENT, leakage=np.full((601, 2), 2e-7))
    found = flow.solve(SPEED)
    # v a dp/dx = s (p^2 - p0^2)/2 behind the compression: artanh of p0/p grows linearly
    rate = 2e-7 * AMBIENT / (2 * 0.04 * SPEED)
    first = np.flatnonzero(x < 0)[-1]
    start = np.arctanh(AMBIENT / found.pressure[first, 0])
    expected = AMBIENT / np.tanh(start + rate * (x[first] - x[: first + 1]))
    np.testing.assert_allclose(found.pressure[: first + 1, 0], expected, rtol=2e-4)


# ---- Pore air of a mix: saturation, permeability with occlusion, bounded voids, refusals


FED = 0.936


def pore_air(occlusion=0.90, permeability=1e-13, moisture=0.10, fed=FED):
    return PoreAir(
        permeability=permeability, water=water_volume(moisture), fed_density_ratio=fed, occlusion_saturation=occlusion
    )


@pytest.mark.parametrize("moisture", [0.08, 0.10, 0.12])
def test_saturation_is_that_of_the_mix(moisture):
    k = np.linspace(0.90, 0.99, 7)
    np.testing.assert_allclose(pore_air(None, moisture=moisture).saturation(1 / k - 1), saturation(moisture, k))


def test_permeability_is_that_given_at_the_fed_density_and_vanishes_at_occlusion():
    air = pore_air()
    assert air.mobility(1 / FED - 1) * air.viscosity == pytest.approx(1e-13, rel=1e-12)
    occluded = air.water * (1 / 0.90 - 1)
    assert (air.mobility([occluded, 0.01, 0.0]) * air.viscosity).max() < 1e-21
    voids = np.linspace(occluded, 0.1, 50)
    assert np.all(np.diff(air.mobility(voids)) > 0)


@pytest.mark.parametrize("occlusion", [None, 0.85, 0.90])
def test_voids_are_bounded_with_a_continuous_slope(occlusion):
    air = pore_air(occlusion)
    voids = np.linspace(-0.05, 0.08, 26001)
    bounded, least = air.bounded(voids), air.min_void_ratio
    assert bounded.min() == least
    np.testing.assert_array_equal(bounded[voids > 1.2501 * least], voids[voids > 1.2501 * least])
    slopes = np.diff(bounded) / np.diff(voids)
    assert np.abs(np.diff(slopes)).max() < 2e-3
    assert slopes.min() >= -1e-9


@pytest.mark.parametrize(("changes", "message"), [
    ({"permeability": 0.0}, "`permeability`"),
    ({"occlusion": 1.2}, "`occlusion_saturation`"),
    ({"occlusion": 0.75}, "exceed the saturation of the fed mix"),
    ({"fed": 0.985}, "exceed the saturation of the fed mix"),
])  # fmt: skip
def test_values_out_of_range_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        pore_air(**changes)
