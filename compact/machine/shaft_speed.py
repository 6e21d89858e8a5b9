"""Speed of a loaded shaft over one revolution, periodic or from an initial speed, by spectral elements.

    dE/dphi = phi'',   E = phi'^2/2,   residual(phi, E, phi'') = 0 at each angle

The shaft angle is the independent variable. The joins of the motion laws and the dead centres are therefore known
boundaries of elements, and the periodic regime is a linear condition. Newton's method eliminates each element for the
change of E at its start, propagates that change over the elements and closes the revolution. Elements are bisected
until the last Chebyshev coefficients of E fall below the tolerance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from compact.numerics import Array
from compact.numerics.piecewise import clenshaw_curtis

ORDER = 16  # [-], of the polynomial on an element
NODES, WEIGHTS = clenshaw_curtis(ORDER + 1)
DIFFERENTIATION = np.linalg.solve(
    chebyshev.chebvander(2 * NODES - 1, ORDER).T,
    np.array([2 * chebyshev.chebval(2 * NODES - 1, chebyshev.chebder(row)) for row in np.eye(ORDER + 1)]),
).T  # nodal values to nodal derivatives on a unit element
INTEGRATION = np.linalg.inv(DIFFERENTIATION[1:, 1:])  # nodal values after the first to integrals from the start
TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, ORDER))
END_INSET = 1e-13  # [rad]; the ends of an element are evaluated from inside
COEFFICIENT_ROUNDING = 1e-15  # [-], of the largest coefficient of E on an element; smaller ones are rounding
ROOT_ROUNDING = 1e-6  # [-], of half an element; imaginary part of a double root due to rounding
NEWTON_ITERATIONS = 60  # [-], of Newton's method; 4 to 8 are usual
NEWTON_TOLERANCE = 1e-12  # [-], of the largest E; change at convergence
MIN_ENERGY_RATIO = 0.2  # [-], of E; a Newton step reduces E no further
MAX_ENERGY_RATIO = 1e12  # [-], energy over its first guess, beyond which Newton steps diverge
RESIDUAL_PERTURBATION = 1e-7  # [-], relative; finite differences of the residual
MAX_ELEMENTS = 20_000  # [-]; dozens are usual, the number doubles in each refinement of a noisy torque
MAX_REFINEMENTS = 30  # [-]; 2 to 5 are usual, more for a steep motor curve and little inertia
DIVERGED = "the speed of the shaft did not converge: Newton steps diverge; use a stronger motor or more inertia"

Residual = Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class ShaftRevolution:
    """Speed of a shaft over one revolution, one row per element.

    Parameters
    ----------
    breaks : ndarray, shape (n + 1,)
        Ends of the elements [rad].
    angle, energy, acceleration : ndarray, shape (n, ORDER + 1)
        phi [rad], E [1/s^2] and phi'' [rad/s^2] at the nodes.
    iterations : int
        Newton iterations.
    """

    breaks: Array
    angle: Array
    energy: Array
    acceleration: Array
    iterations: int

    @property
    def speed(self) -> Array:
        """Speed phi' at the nodes [rad/s]."""
        return np.sqrt(2 * self.energy)

    @property
    def jerk(self) -> Array:
        """Third derivative of phi with respect to time at the nodes [rad/s^3]."""
        return self.acceleration @ DIFFERENTIATION.T / np.diff(self.breaks)[:, None] * self.speed

    @property
    def weights(self) -> Array:
        """Quadrature weights over time [s]."""
        return np.diff(self.breaks)[:, None] * WEIGHTS / self.speed

    @property
    def time(self) -> Array:
        """Time since the start of the revolution at the nodes [s]."""
        slowness, width = 1 / self.speed, np.diff(self.breaks)[:, None]
        within = np.concatenate([np.zeros_like(width), width * (slowness[:, 1:] @ INTEGRATION.T)], axis=1)
        starts = np.concatenate([[0.0], np.cumsum(within[:-1, -1])])
        return starts[:, None] + within

    @cached_property
    def energy_range(self) -> tuple[float, float]:
        """Smallest and largest E [1/s^2], at the ends of elements and at the roots of its derivative."""
        coefficients = self.energy @ TO_CHEBYSHEV.T
        size = np.abs(coefficients).max(axis=1)
        candidates = [self.energy[:, 0], self.energy[:, -1]]
        for row, largest in zip(coefficients, size, strict=True):
            count = np.flatnonzero(np.abs(row) > COEFFICIENT_ROUNDING * largest)[-1] + 1
            roots = chebyshev.chebroots(chebyshev.chebder(row[:count])) if count > 2 else np.empty(0)
            places = roots[np.abs(roots.imag) <= ROOT_ROUNDING].real
            candidates.append(chebyshev.chebval(places[np.abs(places) <= 1], row))
        extrema = np.concatenate(candidates)
        return float(extrema.min()), float(extrema.max())

    def evaluate(self, angle: Array) -> tuple[Array, Array, Array]:
        """E [1/s^2], phi'' [rad/s^2] and the third derivative [rad/s^3] at angles in [0, 2 pi] of any shape."""
        i = np.clip(np.searchsorted(self.breaks, angle, side="right") - 1, 0, len(self.angle) - 1)
        place = 2 * (angle - self.breaks[i]) / np.diff(self.breaks)[i] - 1
        polynomials = chebyshev.chebvander(place, ORDER)
        energy, acceleration, jerk = (
            np.sum(polynomials * (values @ TO_CHEBYSHEV.T)[i], axis=-1)
            for values in (self.energy, self.acceleration, self.jerk)
        )
        return energy, acceleration, jerk


def solve_shaft_speed(
    residual: Residual, breaks: ArrayLike, speed: float, tolerance: float = 1e-9, periodic: bool = True
) -> ShaftRevolution:
    """Solve the speed of a shaft over its angle.

    Parameters
    ----------
    residual : callable
        Residual torque of (angle, E, phi''), arrays of shape (n, ORDER + 1), smooth between the breaks. Any unit.
    breaks : array_like, shape (n + 1,)
        Angles between which the residual is smooth [rad].
    speed : float
        Initial speed, or a first guess of it in the periodic regime [rad/s].
    tolerance : float
        Of E, relative to its largest value.
    periodic : bool
        Solve the periodic regime.
    """
    breaks, iterations = np.asarray(breaks, float), 0
    energy = np.full((len(breaks) - 1, ORDER + 1), speed**2 / 2)
    for _ in range(MAX_REFINEMENTS):
        width = np.diff(breaks)[:, None]
        angle = np.clip(breaks[:-1, None] + width * NODES, breaks[:-1, None] + END_INSET, breaks[1:, None] - END_INSET)
        energy, count = _solve_elements(residual, angle, width, energy, periodic)
        iterations += count
        coefficients = np.abs(energy @ TO_CHEBYSHEV.T)
        unresolved = coefficients[:, -2:].max(axis=1) > tolerance * energy.max()
        if not unresolved.any():
            return ShaftRevolution(breaks, angle, energy, energy @ DIFFERENTIATION.T / width, iterations)
        middles = (breaks[:-1] + breaks[1:])[unresolved] / 2
        if len(breaks) + len(middles) > MAX_ELEMENTS:
            break
        coarse = ShaftRevolution(breaks, angle, energy, energy, iterations)
        breaks = np.sort(np.append(breaks, middles))
        fine = breaks[:-1, None] + np.diff(breaks)[:, None] * NODES
        energy = np.maximum(coarse.evaluate(fine)[0], MIN_ENERGY_RATIO * energy.min())
    raise RuntimeError(
        f"the speed of the shaft is not resolved by {len(breaks) - 1} elements; use a torque curve and a resistance "
        "that are smooth in speed"
    )


def _solve_elements(residual, angle, width, energy, periodic):
    """Solve for E at the nodes by Newton's method; return E and the number of iterations."""
    largest = MAX_ENERGY_RATIO * energy.max()
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        change = _newton_step(residual, angle, width, energy, periodic)
        largest_fall = np.max(-change / energy, initial=1 - MIN_ENERGY_RATIO)
        energy = energy + (1 - MIN_ENERGY_RATIO) / largest_fall * change
        if np.abs(change).max() <= NEWTON_TOLERANCE * energy.max():
            return energy, iteration
        if energy.max() > largest:
            raise RuntimeError(DIVERGED)
    slowest = np.unravel_index(energy.argmin(), energy.shape)
    raise RuntimeError(
        f"the speed of the shaft did not converge in {NEWTON_ITERATIONS} Newton steps: it falls to "
        f"{np.sqrt(2 * energy[slowest]):g} rad/s at {angle[slowest]:g} rad; use a stronger motor or more inertia"
    )


def _newton_step(residual, angle, width, energy, periodic):
    """Change of E at the nodes by one Newton step."""
    acceleration = energy @ DIFFERENTIATION.T / width
    here = residual(angle, energy, acceleration)
    step = RESIDUAL_PERTURBATION * energy
    by_energy = (residual(angle, energy + step, acceleration) - here) / step
    step = RESIDUAL_PERTURBATION * (np.abs(acceleration) + energy.max())
    by_acceleration = (residual(angle, energy, acceleration + step) - here) / step
    matrix = by_acceleration[:, :, None] * DIFFERENTIATION / width[:, :, None]
    matrix[:, np.arange(ORDER + 1), np.arange(ORDER + 1)] += by_energy
    right = np.stack([-here[:, 1:], -matrix[:, 1:, 0]], axis=-1)
    try:
        particular, propagation = np.moveaxis(np.linalg.solve(matrix[:, 1:, 1:], right), -1, 0)
    except np.linalg.LinAlgError as error:  # on another processor the step is huge, and diverges
        raise RuntimeError(DIVERGED) from error
    gaps = energy[:, 0] - np.roll(energy[:, -1], 1)  # jumps of E between elements, closed by the step
    if not periodic:
        gaps[0] = 0.0
    starts = _propagate(particular[:, -1], propagation[:, -1], gaps, periodic)
    return np.concatenate([starts[:, None], particular + propagation * starts[:, None]], axis=1)


def _propagate(particular, propagation, gaps, periodic):
    """Compute s at the starts of the elements: s_(i+1) = particular_i + propagation_i s_i - gap_(i+1)."""

    def from_start(start: Array) -> tuple[Array, Array]:
        starts = [start]
        for i in range(len(particular) - 1):
            starts.append(particular[i] + propagation[i] * starts[-1] - gaps[i + 1])
        return np.array(starts), particular[-1] + propagation[-1] * starts[-1] - gaps[0]

    if not periodic:
        return from_start(0.0)[0]
    zero, one = from_start(0.0)[1], from_start(1.0)[1]
    return from_start(zero / (1 - (one - zero)))[0]
