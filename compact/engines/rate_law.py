"""Resistance over speed where the speed enters through the rate factor of the yield pressure alone.

Forces of a compacting mix are homogeneous in the stresses. With the yield pressure pc f, Young's modulus E and the
tensile strength pt they are

    F = f Phi(E/f, pt/f)

So ln F is one smooth function of ln f, for a prescribed height, load or peak pressure. The factor f follows from the
rate of compaction, `rolling_contact.compaction_rate`. It changes by some 4 % in a decade of the speed, so that two or
three contacts define F over decades.

References
----------
C. M. Bishop, Pattern Recognition and Machine Learning, Springer 2006, section 3.3 (Bayesian linear regression).
"""

import warnings
from collections.abc import Callable, Iterable, Sequence
from math import factorial

import numpy as np

from compact.numerics import Array
from compact.numerics.validation import require_finite, require_positive
from compact.resistance import ForceSample, ResistanceMap, sample_resistance

LAW_DERIVATIVES = (2.0, 8.0, 24.0)  # [-], scales of the derivatives of ln F over ln f; columns have up to .95, 7 and 12
LAW_CONTACTS = 5  # [-], contacts of a law
LAW_SPEEDS = 65  # [-], speeds at which the error of a law is estimated
LAW_NODES = (5, 9, 17, 33, 65)  # [-], samples of a map that may reproduce a law
LAW_REPRODUCTION = 1e-5  # [-], relative deviation of a map from its law
MIN_NOISE = 1e-4  # [-], least scatter of a contact
NOISE_MARGIN = 1.5  # [-], error over the scatter of one contact that further contacts do not reduce


Law = Callable[[Array], Array]  # of speeds [m/s], shape (n,)


def fit_rate_law(samples: Sequence[ForceSample], rate_factor: Callable[[float], float]) -> tuple[Law, Law]:
    """Fit the resistance as a smooth function of the rate factor f of the yield pressure.

        ln F = b0 + b1 x + b2 x^2/2 + b3 x^3/6,    x = ln f - mean,    bk ~ N(0, LAW_DERIVATIVES[k - 1]^2),  k > 0

    The coefficients are those of Bayesian linear regression. Where the contacts resolve no curvature beyond their
    scatter, the law is close to a line, else to a parabola.

    Parameters
    ----------
    samples : sequence of ForceSample
        Contacts with F > 0, at least one.
    rate_factor : callable
        Factor f [-] at a speed [m/s].

    Returns
    -------
    tuple of callable
        Resistance [N], and its relative standard error by the scatter of the contacts and the prior [-], at speeds.
    """
    speeds, forces = np.array([each[:2] for each in samples]).T
    scatter = np.maximum([each.noise for each in samples], MIN_NOISE)
    mean = np.log([rate_factor(speed) for speed in speeds.tolist()]).mean()

    def terms(at: Array) -> Array:
        """Return x^k/k!, shape (speeds, coefficients)."""
        x = np.log([rate_factor(speed) for speed in at.tolist()]) - mean
        return np.stack([x**k / factorial(k) for k in range(len(LAW_DERIVATIVES) + 1)], axis=-1)

    prior = np.pad(np.diag(1 / np.array(LAW_DERIVATIVES)), ((0, 0), (1, 0)))
    matrix = np.vstack([terms(speeds) / scatter[:, None], prior])
    coefficients = np.linalg.lstsq(matrix, np.append(np.log(forces) / scatter, np.zeros(len(prior))))[0]
    covariance = np.linalg.inv(matrix.T @ matrix)
    return (
        lambda at: np.exp(terms(at) @ coefficients),
        lambda at: np.sqrt(np.sum((terms(at) @ covariance) * terms(at), axis=1)),
    )


def sample_rate_law(
    resistance: Callable[[float], ForceSample],
    rate_factor: Callable[[float], float],
    slowest: float,
    fastest: float,
    tolerance: float,
    known: Iterable[ForceSample] = (),
) -> ResistanceMap:
    """Sample a resistance that depends on the speed by the rate factor of the yield pressure alone.

    Contacts are added at the speed of the largest standard error while the error exceeds the tolerance, up to
    `LAW_CONTACTS` in all. Without a rate effect one contact suffices. If a force is not positive, such as that of a
    driven roller, `sample_resistance` replaces the law.

    Parameters
    ----------
    resistance : callable
        Contact at a speed [m/s].
    rate_factor : callable
        Factor f [-] of the yield pressure at a speed [m/s].
    slowest, fastest : float
        Range of speeds [m/s], > 0.
    tolerance : float
        Largest relative error of the law [-], > 0.
    known : iterable of ForceSample
        Contacts that exist already; their speeds may lie outside the range.

    Returns
    -------
    ResistanceMap
        Its error is the largest standard error of the law or, if larger, that of a held-out contact.

    Warns
    -----
    UserWarning
        If the error exceeds the tolerance, and the scatter of the contacts is not the cause.
    """
    require_positive(slowest=slowest, fastest=fastest, tolerance=tolerance)
    samples = {each.speed: each for each in known} or {fastest: resistance(fastest)}
    if rate_factor(slowest) == rate_factor(fastest):
        contacts = tuple(sorted(samples.values()))  # without an error of interpolation
        forces = np.full(2, contacts[0].force)
        require_finite(resistance=forces)
        return ResistanceMap(np.array([slowest, fastest]), forces, 0.0, _largest_error(contacts), contacts=contacts)
    speeds = np.geomspace(slowest, fastest, LAW_SPEEDS)
    while True:
        require_finite(resistance=[each.force for each in samples.values()])
        if min(each.force for each in samples.values()) <= 0:
            rest = [each[:3] for each in samples.values()]
            return sample_resistance(lambda speed: resistance(speed)[1:3], slowest, fastest, tolerance, rest)
        contacts = tuple(sorted(samples.values()))
        law, standard_error = fit_rate_law(contacts, rate_factor)
        noise = max(MIN_NOISE, *(each.noise for each in contacts))
        errors, limit = standard_error(speeds), max(tolerance, NOISE_MARGIN * noise)
        held_out = [0.0]  # relative errors of contacts predicted by the others, between which they are
        for k, sample in list(enumerate(contacts))[1:-1]:
            predict, _ = fit_rate_law(contacts[:k] + contacts[k + 1 :], rate_factor)
            held_out.append(abs(float(predict(np.array([sample.speed]))[0]) / sample.force - 1))
        error = max(float(errors.max()), *held_out)
        if error <= limit or len(samples) >= LAW_CONTACTS:
            break
        if errors.max() <= limit:  # the contacts contradict the prior: the speed farthest from all of them
            errors = np.abs(np.log(speeds[:, None] / [each.speed for each in contacts])).min(axis=1)
        speed = float(speeds[np.argmax(errors)])
        samples[speed] = resistance(speed)
    if error > limit:
        warnings.warn(
            f"the resistance from {slowest:.3g} to {fastest:.3g} m/s by {len(samples)} contacts has an error of "
            f"{error:.2g}, tolerance {tolerance:g}; raise the tolerance, or compute contacts at further speeds",
            stacklevel=2,
        )
    for count in LAW_NODES:
        nodes = np.geomspace(slowest, fastest, count)
        found = ResistanceMap(nodes, law(nodes), error, _largest_error(contacts), contacts=contacts)
        if np.abs(found(speeds) / law(speeds) - 1).max() <= LAW_REPRODUCTION:
            break
    return found


def _largest_error(samples: Iterable[ForceSample]) -> float | None:
    return max((each.error for each in samples if each.error is not None), default=None)
