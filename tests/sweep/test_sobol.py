"""Sobol indices: closed forms within the confidence bounds, estimates of scipy, refusals."""

import numpy as np
import pytest
from scipy.stats import qmc, sobol_indices

from compact.sweep.sobol_indices import Index, indices

ISHIGAMI_A, ISHIGAMI_B = 7.0, 0.1


def ishigami(x):
    return np.sin(x[0]) + ISHIGAMI_A * np.sin(x[1]) ** 2 + ISHIGAMI_B * x[2] ** 4 * np.sin(x[0])


def ishigami_indices():
    """First order and total, T. Ishigami and T. Homma 1990, by integration."""
    a, b, pi = ISHIGAMI_A, ISHIGAMI_B, np.pi
    variance = a**2 / 8 + b * pi**4 / 5 + b**2 * pi**8 / 18 + 0.5
    first = np.array([0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, 0.0]) / variance
    together = 8 * b**2 * pi**8 / 225 / variance
    return first, first + np.array([together, 0.0, together])


def rows(function, inputs, n, low=0.0, high=1.0):
    """f_A, f_B, f_AB of a function of x, shape (inputs, n), uniform between low and high."""
    shares = low + (high - low) * qmc.Sobol(2 * inputs, seed=1).random(n)
    A, B = shares[:, :inputs].T, shares[:, inputs:].T
    mixed = [np.where(np.arange(inputs)[:, None] == i, B, A) for i in range(inputs)]
    return function(A), function(B), np.array([function(x) for x in mixed])


def estimated(*values):
    """Indices with arrays over the inputs."""
    return Index(*np.array(indices(*values)).T)


def is_covered(found, first, total):
    return np.all(
        (found.first_low <= first)
        & (first <= found.first_high)
        & (found.total_low <= total)
        & (total <= found.total_high)
    )


def test_ishigami_lies_within_confidence_bounds_that_narrow_with_the_root_of_the_rows():
    found = {n: estimated(*rows(ishigami, 3, n, -np.pi, np.pi)) for n in (256, 1024, 4096)}
    assert all(is_covered(each, *ishigami_indices()) for each in found.values())
    wide, narrow = (found[n].first_high - found[n].first_low for n in (256, 4096))
    assert narrow == pytest.approx(wide / 4, rel=0.25)
    assert np.all(narrow < 0.07)


def test_product_has_its_closed_form():
    """f = prod (1 + c_i (2 x_i - 1)): V_i = c_i^2/3, V = prod (1 + V_i) - 1."""
    shares = np.array([1.0, 0.5, 0.2])
    parts = shares**2 / 3
    variance = np.prod(1 + parts) - 1
    found = estimated(*rows(lambda x: np.prod(1 + shares[:, None] * (2 * x - 1), axis=0), 3, 2048))
    assert is_covered(found, parts / variance, parts * np.prod(1 + parts) / (1 + parts) / variance)


def test_estimates_are_those_of_scipy():
    f_A, f_B, f_AB = rows(ishigami, 3, 128, -np.pi, np.pi)
    library = sobol_indices(func={"f_A": f_A[None], "f_B": f_B[None], "f_AB": f_AB[:, None]}, n=128)
    found = estimated(f_A, f_B, f_AB)
    assert found.first == pytest.approx(library.first_order, abs=1e-12)
    assert found.total == pytest.approx(library.total_order, abs=1e-12)
