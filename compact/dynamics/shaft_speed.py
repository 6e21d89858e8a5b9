"""A loaded shaft through one turn: its speed over its angle, periodic or from a given speed, by spectral elements.

    dE/dphi = phi'',  E = phi'^2/2,  residual(phi, E, phi'') = 0 at every angle

The angle is the independent variable, so the joins of the laws and the dead centres of every cart lie at ends of
elements known beforehand, and the periodic regime is a linear condition: Newton's method solves element by element for
the change of E over the change at its start, chains these, and closes the turn. Elements are halved until the last
Chebyshev coefficients of E are below the tolerance.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev

from compact.numerics.piecewise import clenshaw_curtis

ORDER = 16  # of the polynomial on an element
NODES, WEIGHTS = clenshaw_curtis(ORDER + 1)
SLOPES = np.linalg.solve(
    chebyshev.chebvander(2 * NODES - 1, ORDER).T,
    np.array([2 * chebyshev.chebval(2 * NODES - 1, chebyshev.chebder(row)) for row in np.eye(ORDER + 1)]),
).T  # values at the nodes to values of the derivative over a unit element
INTEGRALS = np.linalg.inv(SLOPES[1:, 1:])  # of values at the nodes after the first, from the start
TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, ORDER))
INSET = 1e-13  # rad by which the ends of an element are asked from inside
ROUNDING = 1e-15  # [-], of the largest coefficient of E on an element
REAL = 1e-6  # [-], of half an element, imaginary part of a root that rounding leaves of a double one
ITERATIONS = 60  # of Newton's method; 4 to 8 are usual
LEAST = 0.2  # of E, that one step leaves
PROBE = 1e-7  # relative difference for derivatives
MOST_ELEMENTS = 20_000  # [-]; dozens are usual, and twice as many with each halving of a torque that is noise
HALVINGS = 30  # of elements; 2 to 5 are usual, more where a steep motor meets little inertia


@dataclass(frozen=True)
class Turning:
    """A turn: `breaks` of its elements [rad]; `angle`, `energy` E [1/s^2], `acceleration` [rad/s^2], a row for each."""

    breaks: np.ndarray
    angle: np.ndarray
    energy: np.ndarray
    acceleration: np.ndarray
    iterations: int

    @property
    def speed(self):
        """phi' [rad/s] at the nodes."""
        return np.sqrt(2 * self.energy)

    @property
    def jerk(self):
        """Third derivative of phi by time [rad/s^3] at the nodes."""
        return self.acceleration @ SLOPES.T / np.diff(self.breaks)[:, None] * self.speed

    @property
    def weights(self):
        """Weights [s] that integrate over the time of the turn."""
        return np.diff(self.breaks)[:, None] * WEIGHTS / self.speed

    @property
    def time(self):
        """Time [s] at the nodes from the start of the turn."""
        slowness, width = 1 / self.speed, np.diff(self.breaks)[:, None]
        # the derivative of the time within an element, whose value at its start is 0, is the slowness
        within = np.concatenate([np.zeros_like(width), width * (slowness[:, 1:] @ INTEGRALS.T)], axis=1)
        starts = np.concatenate([[0.0], np.cumsum(within[:-1, -1])])
        return starts[:, None] + within

    @cached_property
    def energy_range(self):
        """Least and largest E over the turn [1/s^2], at the ends of elements and at the roots of its derivative."""
        coefficients = self.energy @ TO_CHEBYSHEV.T
        size = np.abs(coefficients).max(axis=1)
        found = [self.energy[:, 0], self.energy[:, -1]]
        for row, most in zip(coefficients, size, strict=True):
            kept = np.flatnonzero(np.abs(row) > ROUNDING * most)[-1] + 1  # beyond, coefficients are rounding
            roots = chebyshev.chebroots(chebyshev.chebder(row[:kept])) if kept > 2 else np.empty(0)
            places = roots[np.abs(roots.imag) <= REAL].real
            found.append(chebyshev.chebval(places[np.abs(places) <= 1], row))
        every = np.concatenate(found)
        return float(every.min()), float(every.max())

    def at(self, angle):
        """E, phi'' and the third derivative at angles in [0, 2 pi] of any shape."""
        i = np.clip(np.searchsorted(self.breaks, angle, side="right") - 1, 0, len(self.angle) - 1)
        place = 2 * (angle - self.breaks[i]) / np.diff(self.breaks)[i] - 1
        polynomials = chebyshev.chebvander(place, ORDER)
        nodal = (self.energy, self.acceleration, self.jerk)
        return tuple(np.sum(polynomials * (values @ TO_CHEBYSHEV.T)[i], axis=-1) for values in nodal)


def turning(residual, breaks, speed, tolerance=1e-9, periodic=True):
    """`Turning` over the breaks [rad] of a shaft whose torques are out of balance by `residual`.

    residual : of (angle, E, phi''), arrays of shape (n, ORDER + 1), smooth between the breaks; what makes it makes E
    speed : first guess in the periodic regime, or the speed at the start [rad/s]

    Raises RuntimeError where the shaft comes to a stand, or no solution is found.
    """
    breaks, energy, iterations = np.asarray(breaks, float), None, 0
    for _ in range(HALVINGS):
        width = np.diff(breaks)[:, None]
        angle = np.clip(breaks[:-1, None] + width * NODES, breaks[:-1, None] + INSET, breaks[1:, None] - INSET)
        if energy is None:
            energy = np.full(angle.shape, speed**2 / 2)
        energy, count = _balanced(residual, angle, width, energy, periodic)
        iterations += count
        coefficients = np.abs(energy @ TO_CHEBYSHEV.T)
        rough = coefficients[:, -2:].max(axis=1) > tolerance * energy.max()
        if not rough.any():
            return Turning(breaks, angle, energy, energy @ SLOPES.T / width, iterations)
        halves = (breaks[:-1] + breaks[1:])[rough] / 2
        if len(breaks) + len(halves) > MOST_ELEMENTS:
            break
        coarse = Turning(breaks, angle, energy, energy, iterations)
        breaks = np.sort(np.append(breaks, halves))
        fine = breaks[:-1, None] + np.diff(breaks)[:, None] * NODES
        energy = np.maximum(coarse.at(fine)[0], LEAST * energy.min())
    raise RuntimeError(f"the turn was not resolved by {len(breaks) - 1} elements; is the torque or resistance smooth?")


def _balanced(residual, angle, width, energy, periodic):
    """E at the nodes by Newton's method, and the iterations."""
    for iteration in range(1, ITERATIONS + 1):
        change = _newton(residual, angle, width, energy, periodic)
        share = min(1.0, np.min(np.where(change < 0, (1 - LEAST) * energy / np.maximum(-change, 1e-300), np.inf)))
        energy = energy + share * change
        if np.abs(change).max() <= 1e-12 * energy.max():
            return energy, iteration
    slowest = np.unravel_index(energy.argmin(), energy.shape)
    raise RuntimeError(
        f"no balance of the shaft in {ITERATIONS} steps: its speed falls to {np.sqrt(2 * energy[slowest]):g} rad/s at "
        f"{angle[slowest]:g} rad; the motor is too weak, or give more inertia"
    )


def _newton(residual, angle, width, energy, periodic):
    """Change of E at the nodes that balances the linearised shaft."""
    acceleration = energy @ SLOPES.T / width
    now = residual(angle, energy, acceleration)
    small = PROBE * energy
    by_energy = (residual(angle, energy + small, acceleration) - now) / small
    small = PROBE * (np.abs(acceleration) + energy.max())
    by_acceleration = (residual(angle, energy, acceleration + small) - now) / small
    matrix = by_acceleration[:, :, None] * SLOPES / width[:, :, None]
    matrix[:, np.arange(ORDER + 1), np.arange(ORDER + 1)] += by_energy
    right = np.stack([-now[:, 1:], -matrix[:, 1:, 0]], axis=-1)
    own, passed = np.moveaxis(np.linalg.solve(matrix[:, 1:, 1:], right), -1, 0)
    gaps = energy[:, 0] - np.roll(energy[:, -1], 1)  # of E where elements meet, closed by the change
    if not periodic:
        gaps[0] = 0.0
    starts = _chained(own[:, -1], passed[:, -1], gaps, periodic)
    return np.concatenate([starts[:, None], own + passed * starts[:, None]], axis=1)


def _chained(own, passed, gaps, periodic):
    """Changes s at the start of each element: s_(i+1) = own_i + passed_i s_i - gap_(i+1), closed if periodic."""

    def through(start):
        starts = [start]
        for i in range(len(own) - 1):
            starts.append(own[i] + passed[i] * starts[-1] - gaps[i + 1])
        return np.array(starts), own[-1] + passed[-1] * starts[-1] - gaps[0]

    if not periodic:
        return through(0.0)[0]
    none, one = through(0.0)[1], through(1.0)[1]
    return through(none / (1 - (one - none)))[0]
