"""Parameter estimation by output space mapping between a coarse and a fine model.

    minimise |ln(predicted(u)/measured)|^2 over u

The fine model is not differentiated. The corrected coarse model is fitted to the data and the fine model evaluated at
the solution, until both models agree there. The correction

    ln(fine/coarse) = r + B (u - u_last)

varies linearly with u; Broyden's rule updates B from the evaluations of the fine model. Evaluations close to one
another are averaged, since a fine model has numerical noise. If the fine model fails, the next evaluation is half-way
back to the last successful one. A step is at most `MAX_STEP`.

References
----------
J. W. Bandler et al., Space mapping: the state of the art, IEEE Trans. Microw. Theory Tech. 52 (2004) 337.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from compact.numerics import Array

AGREEMENT = 1e-3  # [-], largest |ln(fine/corrected coarse)| at convergence, by default
DIFFERENCE_STEP = 1e-4  # [-], of the unknowns, for central differences of the coarse model, smooth to 1e-8
UNKNOWNS_TOLERANCE = 1e-10  # [-], relative change of the unknowns at which the fit of the coarse model ends
MAX_FINE_RUNS = 24  # [-], evaluations of the fine model
BROYDEN_LENGTH = 0.05  # [-], step that updates half of a slope; for fine models with noise of some 1e-3
MIN_WEIGHT = 1 / 3  # [-], weight of the last evaluation in the mean of close ones
MAX_STEP = 0.5  # [-], between two fine evaluations; halved after a failure
MAX_CONDITION = 1e6  # [-], condition number of the slopes; above it the data do not determine the unknowns

Model = Callable[[Array], ArrayLike]


@dataclass(frozen=True, eq=False)
class Correction:
    """Logarithmic correction of the coarse model, ln(fine/coarse) = r + B (u - u_last).

    Parameters
    ----------
    ratio : ndarray, shape (n,)
        r [-].
    slope : ndarray, shape (n, m)
        B [-].
    at : ndarray, shape (m,)
        u_last.
    close_runs : int
        Number of consecutive evaluations after a short step.
    """

    ratio: Array
    slope: Array
    at: Array
    close_runs: int = 0

    def __call__(self, u: ArrayLike) -> Array:
        """Return ln(fine/coarse) at u, shape (n,)."""
        return self.ratio + self.slope @ (np.asarray(u) - self.at)

    def updated(self, ratio: Array, u: Array, broyden_length: float) -> "Correction":
        """Return the correction updated by ln(fine/coarse) found at u.

        After a long step the ratio is adopted; after a short one it is averaged, and changes the slope little.
        """
        step, error = u - self.at, ratio - self(u)
        size = step @ step + broyden_length**2
        share = float(step @ step / size)
        close_runs = self.close_runs + 1 if share < 0.5 else 0
        adopted = self(u) + max(share, MIN_WEIGHT, 1 / max(close_runs, 1)) * error
        return Correction(adopted, self.slope + np.outer(error, step) / size, u, close_runs)


@dataclass(frozen=True, eq=False)
class SpaceMappingFit:
    """Fitted unknowns and the model there.

    Parameters
    ----------
    unknowns : ndarray, shape (m,)
        u.
    misfit : ndarray, shape (n,)
        ln(predicted/measured) [-].
    slopes : ndarray, shape (n, m)
        d ln predicted/du of the corrected coarse model [-].
    correction : Correction, optional
        Correction of the coarse model; None without a fine model.
    history : tuple of (list, list)
        u and ln(predicted/measured) of each fine evaluation; nan where it failed.
    """

    unknowns: Array
    misfit: Array
    slopes: Array
    correction: Correction | None = None
    history: tuple[tuple[list[float], list[float]], ...] = ()

    @property
    def sensitivity(self) -> Array:
        """Sensitivity d u/d ln measured [-], shape (m, n)."""
        return np.asarray(np.linalg.pinv(self.slopes))


def fit_parameters(
    coarse_model: Model,
    measured: ArrayLike,
    start: ArrayLike,
    fine_model: Model | None = None,
    *,
    correction: Correction | None = None,
    broyden_length: float = BROYDEN_LENGTH,
    agreement: float = AGREEMENT,
) -> SpaceMappingFit:
    """Fit unknowns to measured data.

    Parameters
    ----------
    coarse_model, fine_model : callable
        Predictions > 0, shape (n,), of u, shape (m,).
    measured : array_like, shape (n,)
        Measured data > 0.
    start : array_like, shape (m,)
        Initial u, at which the fine model is evaluated first.
    correction : Correction, optional
        Correction to apply where there is no fine model; initial slope where there is one.
    broyden_length : float
        Step that updates half of a slope [-]; the default is for fine models with noise of 1e-3.
    agreement : float
        Largest |ln(fine/corrected coarse)| at convergence [-]; above the noise of the fine model.

    Raises
    ------
    ValueError
        If there are more unknowns than data, or the data do not determine the unknowns.
    RuntimeError
        If the two models do not converge to one another; the message contains the closest run.

    Examples
    --------
    >>> fit = fit_parameters(lambda u: np.exp([u[0] + u[1], u[0] - u[1]]), [6.0, 1.5], start=[0.0, 0.0])
    >>> [f"{value:.4f}" for value in np.exp(fit.unknowns)]
    ['3.0000', '2.0000']
    """
    measured, start = np.asarray(measured, dtype=float), np.asarray(start, dtype=float)
    if start.size > measured.size:
        raise ValueError(
            f"{start.size} unknowns cannot be determined from {measured.size} data; measure more or fit fewer unknowns"
        )
    if fine_model is None:
        return _fit(coarse_model, measured, start, correction)
    slope = np.zeros((measured.size, start.size)) if correction is None else correction.slope
    u, last, max_step, at_optimum, found = start, None, MAX_STEP, False, Correction(np.array(np.nan), slope, start)
    history: list[tuple[list[float], list[float]]] = []
    for _ in range(MAX_FINE_RUNS):
        try:
            predicted = np.asarray(fine_model(u), dtype=float)
        except RuntimeError as error:
            history.append((u.tolist(), [np.nan] * measured.size))
            if last is None:
                raise RuntimeError(f"the fine model failed at the initial unknowns {u.tolist()}: {error}") from error
            u, max_step, at_optimum = (u + last) / 2, max_step / 2, False
            continue
        misfit, ratio = np.log(predicted / measured), np.log(predicted / np.asarray(coarse_model(u)))
        history.append((u.tolist(), misfit.tolist()))
        if last is None:  # no prediction to compare with
            found = replace(found, ratio=ratio)
        converged, last = at_optimum and np.abs(ratio - found(u)).max() <= agreement, u
        found = found.updated(ratio, u, broyden_length)
        optimum = _fit(coarse_model, measured, u, found)
        if converged:
            return SpaceMappingFit(u, misfit, optimum.slopes, found, tuple(history))
        longest = np.abs(optimum.unknowns - u).max()
        at_optimum = longest <= max_step
        u = optimum.unknowns if at_optimum else u + (optimum.unknowns - u) * max_step / longest
    farthest, at = min((np.abs(misfit).max(), place) for place, misfit in history if np.isfinite(misfit).all())
    raise RuntimeError(
        f"the calibration did not converge in {MAX_FINE_RUNS} runs of the fine model; the closest, at {at}, was "
        f"{np.expm1(farthest):.2%} from the data; use a finer mesh, or measure again"
    )


def _fit(model: Model, measured: Array, start: Array, correction: Correction | None) -> SpaceMappingFit:
    """Least-squares fit of the coarse model with its correction."""

    def misfit(u: Array) -> Array:
        return np.log(np.asarray(model(u)) / measured) + (0.0 if correction is None else correction(u))

    def slopes(u: Array) -> Array:
        steps = DIFFERENCE_STEP * np.eye(u.size)
        return np.array([misfit(u + step) - misfit(u - step) for step in steps]).T / (2 * DIFFERENCE_STEP)

    result = least_squares(misfit, start, jac=slopes, xtol=UNKNOWNS_TOLERANCE, ftol=None, gtol=1e-15)
    if not result.success:
        raise RuntimeError(f"the fit did not converge: {result.message}; its last unknowns were {result.x.tolist()}")
    condition = np.linalg.cond(result.jac / np.abs(result.jac).max())
    if not condition < MAX_CONDITION:
        raise ValueError(
            f"the data do not determine the unknowns (condition number {condition:.1e}); measure another quantity or "
            "fit fewer unknowns"
        )
    return SpaceMappingFit(result.x, result.fun, result.jac, correction)
