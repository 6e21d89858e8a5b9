"""Maxima, roots and integrals of piecewise functions: closed forms, boundary layers, jumps at breaks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact.numerics.piecewise import clenshaw_curtis, find_maximum, find_roots, integrate, interior_grid

BREAKS = np.array([0.0, 0.3, 1.0])


@pytest.mark.parametrize("count", [3, 5, 9, 33, 129])
def test_quadrature_is_exact_for_polynomials(count):
    nodes, weights = clenshaw_curtis(count)
    degrees = np.arange(count)
    assert weights @ nodes[:, None] ** degrees == pytest.approx(1 / (degrees + 1), rel=1e-12)
    assert np.all(weights > 0)
    assert weights.sum() == pytest.approx(1, rel=1e-14)
    assert [nodes[0], nodes[-1]] == [0, 1]


@pytest.mark.parametrize("thickness", [1e-2, 1e-5, 1e-9])
def test_integral_resolves_a_boundary_layer(thickness):
    assert integrate(lambda z: np.exp(-z / thickness) / thickness, BREAKS) == pytest.approx(1, rel=1e-9)


@given(st.floats(0.01, 0.99), st.floats(0.5, 20))
def test_maximum_between_samples_is_found_to_rounding(place, sharpness):
    value, found = find_maximum(lambda z: 1 / (1 + (sharpness * (z - place)) ** 2), interior_grid(np.array([0.0, 1.0])))
    assert value == pytest.approx(1, rel=1e-12)
    assert found == pytest.approx(place, abs=1e-6)


def test_maximum_does_not_overshoot_a_step():
    assert find_maximum(lambda z: np.where(z < 0.123, 100.0, 200.0), interior_grid(BREAKS))[0] == 200


def test_larger_of_two_close_maxima_is_found():
    value, place = find_maximum(lambda z: np.sin(20 * np.pi * z) + 1e-6 * z, interior_grid(BREAKS))
    assert place == pytest.approx(0.925, abs=1e-4)
    assert value == pytest.approx(1 + 0.925e-6, rel=1e-12)


def test_both_limits_at_a_jump_count():
    def jumps(z):
        return np.where(z < 0.3, z, -z)

    assert find_maximum(jumps, interior_grid(BREAKS))[0] == pytest.approx(0.3, rel=1e-14)
    assert find_maximum(lambda z: -jumps(z), interior_grid(BREAKS))[0] == pytest.approx(1, rel=1e-14)


def test_roots_are_found_to_rounding():
    found = find_roots(lambda z: np.sin(7 * np.pi * z), BREAKS)
    assert found == pytest.approx(np.arange(1, 7) / 7, rel=1e-14)
