"""Linear and quadratic programs: closed forms, rows of unequal size, infeasible constraints."""

import numpy as np
import pytest

from compact.numerics.convex_programs import LinearConstraints, minimise_linear, minimise_quadratic


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
