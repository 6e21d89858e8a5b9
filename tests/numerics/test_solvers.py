"""Convex programs, piecewise functions and space mapping: closed forms, infeasible constraints, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic
from compact.numerics.piecewise import clenshaw_curtis, find_maximum, find_roots, integrate, interior_grid
from compact.numerics.space_mapping import fit_parameters


def test_quadratic_program_equals_its_closed_form():
    """Nearest point of a simplex: x = max(y - t, 0) with the sum 1 (Held, Wolfe and Crowder 1974)."""
    y = np.random.default_rng(5).normal(size=40)
    constraints = LinearConstraints(np.ones((1, 40)), np.ones(1), -np.eye(40), np.zeros(40))
    x = minimise_quadratic(np.eye(40), -y, constraints)
    ordered = np.sort(y)[::-1]
    shifts = (np.cumsum(ordered) - 1) / np.arange(1, 41)
    assert x == pytest.approx(np.maximum(y - shifts[ordered > shifts][-1], 0), abs=1e-9)


def test_quadratic_program_without_curvature_equals_the_linear_one():
    rng = np.random.default_rng(7)
    inequalities = np.vstack([-np.eye(12), rng.normal(size=(9, 12))])
    constraints = LinearConstraints(np.ones((1, 12)), np.ones(1), inequalities, np.ones(21))
    cost, box = rng.normal(size=12), np.full(12, 5.0)
    quadratic = cost @ minimise_quadratic(np.zeros((12, 12)), cost, constraints, -box, box)
    assert quadratic == pytest.approx(cost @ minimise_linear(cost, constraints, -box, box), abs=1e-8)


def test_infeasible_linear_program_has_no_solution():
    constraints = LinearConstraints(np.zeros((0, 1)), np.zeros(0), [[1.0], [-1.0]], np.array([-1.0, -1.0]))
    assert minimise_linear(np.ones(1), constraints) is None


def test_entry_that_highs_drops_raises_an_error():
    constraints = LinearConstraints([[1.0, 1e-10], [0.0, 1.0]], np.array([1.0, 1e6]), np.zeros((0, 2)), np.zeros(0))
    with pytest.raises(RuntimeError, match=r"linear program of 2 unknowns: a row is violated by 1\.0e-04"):
        minimise_linear(np.ones(2), constraints)
    of_order_one = constraints._replace(equality_matrix=[[1.0, 1e-4], [0.0, 1e6]])  # the second unknown in millions
    assert minimise_linear(np.ones(2), of_order_one) == pytest.approx([1 - 1e-4, 1.0], rel=1e-12)


def test_infeasible_quadratic_program_raises_an_error_with_its_residuals():
    constraints = LinearConstraints(np.zeros((0, 1)), np.zeros(0), [[1.0], [-1.0]], np.array([-1.0, -1.0]))
    with pytest.raises(RuntimeError, match=r"quadratic program of 1 unknowns to 1e-08: .*residuals"):
        minimise_quadratic(np.eye(1), np.zeros(1), constraints)


# ---- Maxima, roots and integrals of piecewise functions: closed forms, boundary layers, jumps at breaks


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


# ---- Space mapping: closed forms, noisy and failing fine models, data that do not determine the unknowns


def fine(u):
    return np.exp([1.1 * u[0] + 0.5 * u[1] + 0.9, 0.95 * u[0] - 0.6 * u[1] - 0.2 + 0.05 * u[0] ** 2])


def coarse(u):
    return np.exp([u[0] + 0.4 * u[1], u[0] - 0.7 * u[1]])


def test_two_power_laws_are_identified():
    found = fit_parameters(coarse, [6.0, 1.5], [0.0, 0.0])
    exact = np.linalg.solve([[1, 0.4], [1, -0.7]], np.log([6.0, 1.5]))
    assert found.unknowns == pytest.approx(exact, rel=1e-8)
    assert found.sensitivity == pytest.approx(np.linalg.inv([[1, 0.4], [1, -0.7]]), rel=1e-6)


def test_corrected_coarse_model_reproduces_the_fine_one():
    found = fit_parameters(coarse, [6.0, 1.5], [0.0, 0.0], fine)
    assert fine(found.unknowns) == pytest.approx([6.0, 1.5], rel=1e-3)
    assert len(found.history) < 6
    again = fit_parameters(coarse, [6.0, 1.5], [0.0, 0.0], correction=found.correction)
    assert again.unknowns == pytest.approx(found.unknowns, abs=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_noisy_fine_model_is_fitted_in_the_mean(seed):
    rng = np.random.default_rng(seed)
    found = fit_parameters(np.exp, [6.0], [1.0], lambda u: np.exp(1.2 * u + rng.uniform(-5e-3, 5e-3)))
    assert found.unknowns == pytest.approx([np.log(6.0) / 1.2], abs=4e-3)
    assert found.correction.slope == pytest.approx(np.array([[0.2]]), abs=0.1)
    assert np.nanmax(np.abs([misfit for _, misfit in found.history[-found.correction.close_runs :]])) < 1.5e-2


def fails(u):
    raise RuntimeError("not steady")


RUNS = iter(range(100))


@pytest.mark.parametrize(
    ("models", "measured", "error", "message"),
    [
        ([coarse], [6.0], ValueError, "2 unknowns cannot be determined from 1 data"),
        ([lambda u: np.exp([u.sum(), u.sum()])], [6.0, 6.0], ValueError, "the data do not determine the unknowns"),
        ([coarse, fails], [6.0, 1.5], RuntimeError, r"failed at the initial unknowns \[0\.0, 0\.0\]: not steady"),
        (
            [coarse, lambda u: np.exp(u + (-1) ** next(RUNS))],
            [6.0, 1.5],
            RuntimeError,
            r"did not converge in 24 runs of the fine model; the closest, at \[.*\], was [\d.]+% from the data; use",
        ),
    ],
)
def test_fits_without_a_solution_are_refused(models, measured, error, message):
    first, *fine_models = models
    with pytest.raises(error, match=message):
        fit_parameters(first, measured, [0.0, 0.0], *fine_models)


def test_slope_of_the_correction_converges():
    """A constant correction of u by u^2.5 would overshoot more at each step."""
    found = fit_parameters(np.exp, [6.0], [0.0], lambda u: np.exp(2.5 * u))
    assert found.unknowns == pytest.approx([np.log(6.0) / 2.5], abs=1e-3)
    assert found.correction.slope == pytest.approx(np.array([[1.5]]), rel=0.02)
    assert found.sensitivity == pytest.approx(np.array([[1 / 2.5]]), rel=0.02)
