"""Space mapping: closed forms, noisy and failing fine models, data that do not determine the unknowns."""

import numpy as np
import pytest

from compact.numerics.space_mapping import fit_parameters


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
            r"did not converge in 24 evaluations of the fine model: u and ln\(predicted/measured\) were \[",
        ),
    ],
)
def test_fits_without_a_solution_are_refused(models, measured, error, message):
    first, *fine_models = models
    with pytest.raises(error, match=message):
        fit_parameters(first, measured, [0.0, 0.0], *fine_models)
