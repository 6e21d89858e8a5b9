"""Unknown numbers of a model from measured ones, by a cheap model that is corrected until it agrees with a dear one.

    minimise |ln(predicted(u)/measured)|^2 over u

A dear model D is not differentiated: the cheap one C is fitted to measured C/D, D is asked there, and so on until it
says what the corrected C foretold (output space mapping; Bandler et al., IEEE Trans. MTT 52 (2004) 337). The correction
r = ln D/C varies with u, r + B (u - u_last), B by Broyden's rule from the answers of D; near to one another they are
averaged, since D may tremble. Where D fails to answer it is asked half-way back to where it did, and never more than a
leap away from there.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

SLOPE_STEP = 1e-4  # of the unknowns, which are logs, for differences of the cheap model, which is smooth to 1e-8
FITTED = 1e-10  # relative change of the unknowns at which the cheap model is fitted
RUNS = 24  # of the dear model
SHAKEN = 0.05  # change of the unknowns that teaches half of a slope, of dear models that are shaken by some 1e-3
FRESH = 1 / 3  # weight of the last answer in the mean of those near by
LEAP = 0.5  # change of the unknowns between two runs that the correction varies with, halved where a run has failed


@dataclass(frozen=True, eq=False)
class SpaceMappingFit:
    """Unknowns u, shape (m,), and what the model says there.

    predicted : of the data, shape (n,);  misfit : ln(predicted/measured), shape (n,)
    slopes : d ln predicted/du, shape (n, m), of the cheap model as corrected
    correction : the `Correction` of the cheap model, None where there is no dear one
    history : (u, ln(predicted/measured)) of each run of the dear model, the latter nan where it failed
    """

    unknowns: np.ndarray
    predicted: np.ndarray
    misfit: np.ndarray
    slopes: np.ndarray
    correction: object = None
    history: tuple = ()

    @property
    def scatter(self):
        """Largest |ln(predicted/measured)| of the runs of the dear model near u, shape (n,): how much it trembles."""
        return np.nanmax(np.abs([misfit for _, misfit in self.history[-max(self.correction.near, 1) :]]), axis=0)

    @property
    def sensitivity(self):
        """d u/d ln measured, shape (m, n)."""
        return np.linalg.pinv(self.slopes)


@dataclass(frozen=True, eq=False)
class Correction:
    """ln of the dear model over the cheap one, r + B (u - at): shapes (n,), (n, m), (m,).

    varies : 1 or 0, shape (m,), whether r may vary with an unknown;  near : runs in a row after a short way
    shaken : change of the unknowns that teaches half of a slope
    """

    ratio: np.ndarray
    slope: np.ndarray
    at: np.ndarray
    varies: np.ndarray
    near: int = 0
    shaken: float = SHAKEN

    def __call__(self, u):
        return self.ratio + self.slope @ (np.asarray(u) - self.at)

    def renewed(self, ratio, u):
        """The correction where `ratio` has been found at u.

        After a long way the ratio is believed; after a short one it is averaged, and teaches little of the slope.
        """
        way, missed = self.varies * (u - self.at), ratio - self(u)
        share = way @ way / (way @ way + self.shaken**2)
        near = self.near + 1 if share < 0.5 else 0
        believed = self(u) + max(share, FRESH, 1 / max(near, 1)) * missed
        change = np.outer(missed, way) / (way @ way + self.shaken**2)
        return replace(self, ratio=believed, slope=self.slope + change, at=u, near=near)


def fit_parameters(cheap, measured, start, dear=None, tolerance=1e-3, correction=None, varies=None, shaken=SHAKEN):
    """The `SpaceMappingFit` of u to measured numbers.

    cheap, dear : callables u -> predictions > 0, shape (n,);  measured : shape (n,), > 0
    start : u, shape (m,), where a dear model is asked first
    tolerance : of what the corrected cheap model foretold, at which the dear one counts as met
    correction : `Correction` to keep where there is no `dear`, or whose slope is believed at first where there is one
    varies : of each unknown, whether the two models come apart as it changes; all unless given
    shaken : change of the unknowns that teaches half of a slope; SHAKEN is for dear models that tremble by 1e-3

    Raises ValueError for more unknowns than data or data that do not tell the unknowns apart; RuntimeError with the
    history if the two models do not come to agree.

    >>> found = fit_parameters(lambda u: np.exp([u[0] + u[1], u[0] - u[1]]), [6.0, 1.5], start=[0.0, 0.0])
    >>> [f"{value:.4f}" for value in np.exp(found.unknowns)]
    ['3.0000', '2.0000']
    """
    measured, start = np.asarray(measured, dtype=float), np.asarray(start, dtype=float)
    if start.size > measured.size:
        raise ValueError(f"{start.size} unknowns cannot be told from {measured.size} data; measure more or fit less")
    if dear is not None:
        slope = np.zeros((measured.size, start.size)) if correction is None else correction.slope
        varies = np.ones(start.size) if varies is None else np.array(varies, dtype=float)
        return _mapped(cheap, measured, start, dear, tolerance, Correction(np.nan, slope, start, varies, 0, shaken))
    u, slopes, predicted = _fitted(cheap, measured, start, correction)
    return SpaceMappingFit(u, predicted, np.log(predicted / measured), slopes, correction)


def _mapped(cheap, measured, start, dear, tolerance, correction):
    """The `SpaceMappingFit` of the dear model, by a `Correction` of which only the slope is known."""
    u, last, leap, settled, history = start, None, LEAP, False, []
    for _ in range(RUNS):
        try:
            there = np.asarray(dear(u), dtype=float)
        except RuntimeError as error:
            history.append((u.tolist(), [np.nan] * measured.size))
            if last is None:
                raise RuntimeError(f"the calibration cannot start where it was told to: {error}") from error
            u, leap, settled = (u + last) / 2, leap / 2, False
            continue
        history.append((u.tolist(), np.log(there / measured).tolist()))
        ratio = np.log(there / np.asarray(cheap(u)))
        if last is None:  # nothing was foretold
            correction = replace(correction, ratio=ratio)
        met, last = settled and np.abs(ratio - correction(u)).max() <= tolerance, u
        correction = correction.renewed(ratio, u)
        aim, slopes, _ = _fitted(cheap, measured, u, correction)
        if met:
            return SpaceMappingFit(u, there, np.log(there / measured), slopes, correction, tuple(history))
        u, settled = _leapt(u, aim, leap, correction.varies)
    raise RuntimeError(f"the calibration did not settle in {RUNS} runs: u and ln(predicted/measured) were {history}")


def _leapt(u, aim, leap, varies):
    """The next u on the way to an aim, and whether it is there."""
    longest = np.abs((aim - u) * varies).max()
    return (aim, True) if longest <= leap else (u + (aim - u) * leap / longest, False)


def _fitted(cheap, measured, start, correction=None):
    """u of the least squares, slopes and predictions there, of the cheap model as corrected."""

    def misfit(u):
        there = np.log(np.asarray(cheap(u)) / measured)
        return there if correction is None else there + correction(u)

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
