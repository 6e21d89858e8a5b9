"""Unknown numbers of a model from measured ones, by a cheap model that is corrected until it agrees with a dear one.

    minimise |ln(predicted(u)/measured)|^2 over u

A dear model D is not differentiated: the cheap one C is fitted to measured C/D, D is asked there, and so on until the
two have moved together (output space mapping; Bandler et al., IEEE Trans. MTT 52 (2004) 337). Where C has the slopes of
D in proportion, a few runs of D are enough; a model that is its own cheap one needs one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

SLOPE_STEP = 1e-4  # of the unknowns, which are logs, for differences of the cheap model, which is smooth to 1e-8
FITTED = 1e-10  # relative change of the unknowns at which the cheap model is fitted
RUNS = 12  # of the dear model


@dataclass(frozen=True, eq=False)
class Fit:
    """Unknowns u, shape (m,), and what the model says there.

    predicted : of the data, shape (n,);  misfit : ln(predicted/measured), shape (n,)
    slopes : d ln predicted/du by the cheap model, shape (n, m)
    correction : ln of the dear model over the cheap one, shape (n,), zero where they are one
    history : misfits of each run of the dear model
    """

    unknowns: np.ndarray
    predicted: np.ndarray
    misfit: np.ndarray
    slopes: np.ndarray
    correction: np.ndarray
    history: tuple = ()

    @property
    def sensitivity(self):
        """d u/d ln measured, shape (m, n)."""
        return np.linalg.pinv(self.slopes)


def fit(cheap, measured, start, dear=None, tolerance=1e-3, correction=0.0):
    """The `Fit` of u to measured numbers.

    cheap, dear : callables u -> predictions > 0, shape (n,);  measured : shape (n,), > 0;  start : u, shape (m,)
    tolerance : change of the correction at which the dear model counts as met
    correction : ln of dear over cheap to start from, or to keep where there is no `dear`

    Raises ValueError for more unknowns than data or data that do not tell the unknowns apart; RuntimeError with the
    history if the two models do not come to agree.

    >>> found = fit(lambda u: np.exp([u[0] + u[1], u[0] - u[1]]), [6.0, 1.5], start=[0.0, 0.0])
    >>> [f"{value:.4f}" for value in np.exp(found.unknowns)]
    ['3.0000', '2.0000']
    """
    measured, start = np.asarray(measured, dtype=float), np.asarray(start, dtype=float)
    if start.size > measured.size:
        raise ValueError(f"{start.size} unknowns cannot be told from {measured.size} data; measure more or fit less")
    correction, history = np.zeros(measured.size) + correction, []
    for _ in range(RUNS):
        u, slopes, predicted = _fitted(cheap, measured * np.exp(-correction), start)
        if dear is None:
            return Fit(u, predicted * np.exp(correction), np.log(predicted / measured) + correction, slopes, correction)
        there = np.asarray(dear(u), dtype=float)
        renewed = np.log(there / predicted)
        history.append(np.log(there / measured).tolist())
        if np.abs(renewed - correction).max() <= tolerance:
            return Fit(u, there, np.log(there / measured), slopes, renewed, tuple(history))
        correction, start = renewed, u
    raise RuntimeError(f"the calibration did not settle in {RUNS} runs: ln(predicted/measured) were {history}")


def _fitted(cheap, measured, start):
    """u of the least squares, slopes and predictions there."""

    def misfit(u):
        return np.log(np.asarray(cheap(u)) / measured)

    def slopes(u):
        steps = SLOPE_STEP * np.eye(u.size)
        return np.array([misfit(u + step) - misfit(u - step) for step in steps]).T / (2 * SLOPE_STEP)

    found = least_squares(misfit, start, jac=slopes, xtol=FITTED, ftol=None, gtol=1e-15)
    if not found.success:
        raise RuntimeError(f"the fit did not settle: {found.message}; it reached {found.x.tolist()}")
    worst = np.linalg.cond(found.jac / np.abs(found.jac).max())
    if not worst < 1e6:
        raise ValueError(
            f"the data do not tell the unknowns apart (condition {worst:.1e}); measure another quantity or fit less"
        )
    return found.x, found.jac, np.exp(misfit(found.x)) * measured
