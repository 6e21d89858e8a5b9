"""Spline space of motion laws: every derivative is linear in the unknowns and bounded between the breaks.

    s^(k) is continuous and piecewise quadratic,  s in C^k,  0 <= z <= 1,  s(0) = 0, s'(0) = 0

The unknowns are Bernstein coefficients of s^(j), j = min(k, 2): of the velocity for k = 1, of the acceleration for
k = 2 and 3. For j = k, adjacent pieces share the coefficient at their break. For k = 3 the acceleration is a cubic in
C1: the unknowns are both inner coefficients of each piece and both end values; the coefficient at a break divides the
line between its neighbours in the ratio of the piece widths. On a piece of width h, the Bernstein coefficients b_i of a
derivative of degree q give those of the next derivative, (q/h) (b_(i+1) - b_i), and of the previous one, sums of
h/(q+1) b_i, exactly. A polynomial lies between its smallest and its largest Bernstein coefficient; halving the piece
tightens this hull.

Unknowns in the acceleration are well scaled: the forces are linear in them, jerk and snap quotients by h and h^2.
Unknowns in the jerk would be of order 1/h^2 and enter the stroke by h^3, below the zero tolerance of linear programming
solvers (`numerics.convex_programs`).

References
----------
C. de Boor, A Practical Guide to Splines, ch. IX; G. Farin, Curves and Surfaces for CAGD, ch. 5 (de Casteljau).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from compact.numerics import Array


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Laws in C^k whose derivative k + 1 is linear inside each piece and may jump at the breaks.

    Attributes
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Phases between the pieces, ascending from 0 to 1 [-].
    smoothness : int
        Order k, from 1 to 3.
    """

    breaks: Array
    smoothness: int

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 2 * len(self.breaks) - 1 + (self.smoothness == 3)

    @property
    def basis_order(self) -> int:
        """Order of the derivative whose Bernstein coefficients are the unknowns: 1 or 2."""
        return min(self.smoothness, 2)

    @cached_property
    def _basis(self):
        """Bernstein coefficients of that derivative, shape (pieces, degree + 1, unknowns)."""
        count, unit = len(self.breaks) - 1, np.eye(self.size)
        if self.smoothness < 3:
            return unit[2 * np.arange(count)[:, None] + np.arange(3)]
        inner, width = unit[1:-1].reshape(count, 2, self.size), np.diff(self.breaks)[:, None]
        left, right = width[:-1], width[1:]
        shared = (right * inner[:-1, 1] + left * inner[1:, 0]) / (left + right)
        first, last = (np.concatenate(ends)[:, None] for ends in ((unit[:1], shared), (shared, unit[-1:])))
        return np.concatenate([first, inner, last], axis=1)

    @cached_property
    def _antiderivatives(self):
        """Bernstein coefficients of s^(j), ..., s, in that order, each of shape (pieces, degree + 1, unknowns)."""
        found, width = [self._basis], np.diff(self.breaks)[:, None, None]
        for _ in range(self.basis_order):  # velocity and travel are 0 at z = 0
            inner = np.cumsum(found[-1], axis=1) * width / found[-1].shape[1]
            ends = np.concatenate([0 * inner[:1, -1], np.cumsum(inner[:-1, -1], axis=0)])
            found.append(np.concatenate([0 * inner[:, :1], inner], axis=1) + ends[:, None])
        return found

    def coefficients(self, order: int) -> Array:
        """Return the Bernstein coefficients of s^(order) of each piece, shape (pieces, degree + 1, unknowns)."""
        if order <= self.basis_order:
            return self._antiderivatives[self.basis_order - order]
        rows, width = self._basis, np.diff(self.breaks)[:, None, None]
        for _ in range(order - self.basis_order):
            rows = (rows.shape[1] - 1) * np.diff(rows, axis=1) / width
        return rows

    def values(self, order: int, u: ArrayLike) -> Array:
        """Return the rows of s^(order) at local coordinates u [-] of every piece, (pieces * places, unknowns)."""
        rows = self.coefficients(order)
        return (bernstein_basis(rows.shape[1] - 1, u) @ rows).reshape(-1, self.size)

    def hull(self, order: int, halvings: int) -> Array:
        """Return the Bernstein coefficients that bound s^(order) after halving each piece, shape (rows, unknowns)."""
        rows = self.coefficients(order)
        rows = halve(rows, halvings if rows.shape[1] > 2 else 0).reshape(-1, self.size)
        return rows[np.sort(np.unique(rows, axis=0, return_index=True)[1])]

    def end(self, z: int, order: int) -> Array:
        """Return the row of s^(order) at z = 0 or 1, shape (unknowns,)."""
        return self.coefficients(order)[(0, 0) if z == 0 else (-1, -1)]

    def curve(self, unknowns: Array) -> PPoly:
        """Return the law; its Taylor coefficients are those of each derivative, without rounded differences."""
        orders = range(self.smoothness + 2, -1, -1)
        return PPoly([self.coefficients(k)[:, 0] @ unknowns / factorial(k) for k in orders], self.breaks)

    def rows_at(self, order: int, z: Array) -> Array:
        """Return the rows of s^(order) at phases z, right limits at the breaks, shape (phases, unknowns)."""
        piece = np.clip(np.searchsorted(self.breaks, z, side="right") - 1, 0, len(self.breaks) - 2)
        rows, u = self.coefficients(order)[piece], (z - self.breaks[piece]) / np.diff(self.breaks)[piece]
        return np.einsum("pi,pij->pj", bernstein_basis(rows.shape[1] - 1, u), rows)

    def interpolate(self, curve: Callable[..., Array]) -> Array:
        """Return the unknowns of a law that lies in this space, such as one of the space before halving."""
        width, degree = np.diff(self.breaks), self._basis.shape[1] - 1
        shares = np.arange(1, degree + 2) / (degree + 2)
        values = [curve(self.breaks[:-1] + share * width, nu=self.basis_order) for share in shares]
        found = np.linalg.solve(bernstein_basis(degree, shares), values)
        if self.smoothness == 3:
            return np.concatenate([found[0, :1], found[1:3].T.ravel(), found[3, -1:]])
        return np.append(found[:2].T.ravel(), found[2, -1])


def bernstein_basis(degree: int, u: ArrayLike) -> Array:
    """Return the Bernstein polynomials of a degree at coordinates u from 0 to 1 [-], shape (places, degree + 1)."""
    u, i = np.asarray(u, float)[:, None], np.arange(degree + 1)
    return np.array([comb(degree, k) for k in i]) * u**i * (1 - u) ** (degree - i)


def halve(rows: Array, times: int) -> Array:
    """Return Bernstein coefficients, shape (pieces, degree + 1, unknowns), of halved pieces (de Casteljau)."""
    m = rows.shape[1]
    left = np.array([[comb(i, j) / 2**i if j <= i else 0.0 for j in range(m)] for i in range(m)])
    for _ in range(times):
        rows = np.concatenate([left @ rows, left[::-1, ::-1] @ rows])
    return rows


def graded_breaks(start: float, end: float, count: int, smoothness: int) -> Array:
    """Return count + 1 breaks [-] graded towards both ends, where the jerk is largest; halved pieces are nested.

    z = u^3 (10 - 15 u + 6 u^2)   for k = 1, whose acceleration may jump: the first piece is 10/count^3 of the whole
    z = u^2 (3 - 2 u)             for k = 2 and 3,   u = i/count
    """
    u = np.linspace(0, 1, count + 1)
    z = u**3 * (10 + u * (6 * u - 15)) if smoothness == 1 else u**2 * (3 - 2 * u)
    return start + (end - start) * z
