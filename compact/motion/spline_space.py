"""Motion laws as splines: s(z) in pieces, every derivative linear in the unknowns and bounded between the nodes.

    s^(k) = a continuous parabola by piece,  s in C^k,  0 <= z <= 1,  s(0) = 0, s'(0) = 0

The unknowns are Bernstein coefficients of s^(j), j = min(k, 2): of the speed for k = 1, of the acceleration for k = 2
and 3. For j = k neighbours share the coefficient at their join. For k = 3 the acceleration is a cubic in C1: unknowns
are both inner coefficients of each piece and both ends; the coefficient at a join divides the line between its
neighbours as the widths of the pieces. On a piece of width h the Bernstein coefficients b_i of a derivative of degree q
give those of the next and of the one before exactly, (q/h) (b_(i+1) - b_i) and sums of h/(q+1) b_i. A polynomial lies
between its least and its largest Bernstein coefficient, and as near as required when the piece is halved.

The acceleration lies between the forces, integrals of it, and the jerk and snap, quotients by h and h^2. Unknowns in
the jerk would be as large as 1/h^2, and enter the travel at the far end by h^3, which a solver of linear programs takes
for zero (`quadratic`).

References
----------
C. de Boor, A Practical Guide to Splines, ch. IX; G. Farin, Curves and Surfaces for CAGD, ch. 5 (de Casteljau).
"""

from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial

import numpy as np
from scipy.interpolate import PPoly


@dataclass(frozen=True, eq=False)
class Space:
    """Laws in C^k, k = `smoothness` from 1 to 3, on pieces between `breaks` from 0 to 1, shape (pieces + 1,).

    The derivative k + 1 jumps where pieces meet and is straight inside.
    """

    breaks: np.ndarray
    smoothness: int

    @property
    def size(self):
        """Number of unknowns."""
        return 2 * len(self.breaks) - 1 + (self.smoothness == 3)

    @property
    def basic(self):
        """Order of the derivative whose coefficients are the unknowns: 1 or 2."""
        return min(self.smoothness, 2)

    @cached_property
    def _basis(self):
        """Bernstein coefficients of that derivative, shape (pieces, degree + 1, unknowns)."""
        count, unit = len(self.breaks) - 1, np.eye(self.size)
        if self.smoothness < 3:
            return unit[2 * np.arange(count)[:, None] + np.arange(3)]
        inner, width = unit[1:-1].reshape(count, 2, self.size), np.diff(self.breaks)[:, None]
        left, right = width[:-1], width[1:]
        joins = (right * inner[:-1, 1] + left * inner[1:, 0]) / (left + right)
        first, last = (np.concatenate(ends)[:, None] for ends in ((unit[:1], joins), (joins, unit[-1:])))
        return np.concatenate([first, inner, last], axis=1)

    @cached_property
    def _down(self):
        """Bernstein coefficients of s^(j) … s, in that order, each of shape (pieces, degree + 1, unknowns)."""
        found, width = [self._basis], np.diff(self.breaks)[:, None, None]
        for _ in range(self.basic):  # speed and travel begin with 0
            inner = np.cumsum(found[-1], axis=1) * width / found[-1].shape[1]
            ends = np.concatenate([0 * inner[:1, -1], np.cumsum(inner[:-1, -1], axis=0)])
            found.append(np.concatenate([0 * inner[:, :1], inner], axis=1) + ends[:, None])
        return found

    def coefficients(self, order):
        """Bernstein coefficients of s^(order) by piece, by the unknowns: shape (pieces, degree + 1, unknowns)."""
        if order <= self.basic:
            return self._down[self.basic - order]
        rows, width = self._basis, np.diff(self.breaks)[:, None, None]
        for _ in range(order - self.basic):
            rows = (rows.shape[1] - 1) * np.diff(rows, axis=1) / width
        return rows

    def values(self, order, u):
        """s^(order) at places 0 <= u <= 1 of every piece: rows of shape (pieces * places, unknowns)."""
        rows = self.coefficients(order)
        return (bernstein_basis(rows.shape[1] - 1, u) @ rows).reshape(-1, self.size)

    def hull(self, order, halvings):
        """Bernstein coefficients of s^(order) on pieces halved so often: what bounds it, shape (rows, unknowns)."""
        rows = self.coefficients(order)
        rows = halved(rows, halvings if rows.shape[1] > 2 else 0).reshape(-1, self.size)  # a straight line is met
        return rows[np.sort(np.unique(rows, axis=0, return_index=True)[1])]

    def end(self, z, order):
        """s^(order) at z = 0 or 1: a row, shape (unknowns,)."""
        return self.coefficients(order)[(0, 0) if z == 0 else (-1, -1)]

    def curve(self, unknowns):
        """The law itself, a PPoly; each derivative is taken by itself, none is a difference of the one before."""
        orders = range(self.smoothness + 2, -1, -1)
        return PPoly([self.coefficients(k)[:, 0] @ unknowns / factorial(k) for k in orders], self.breaks)

    def rows_at(self, order, z):
        """s^(order) at phases z, from inside the piece to their right: rows of shape (phases, unknowns)."""
        piece = np.clip(np.searchsorted(self.breaks, z, side="right") - 1, 0, len(self.breaks) - 2)
        rows, u = self.coefficients(order)[piece], (z - self.breaks[piece]) / np.diff(self.breaks)[piece]
        return np.einsum("pi,pij->pj", bernstein_basis(rows.shape[1] - 1, u), rows)

    def taken_over(self, curve):
        """Unknowns of a curve that lies in this space, such as one of a space whose pieces were halved."""
        width, degree = np.diff(self.breaks), self._basis.shape[1] - 1
        shares = np.arange(1, degree + 2) / (degree + 2)
        values = [curve(self.breaks[:-1] + share * width, nu=self.basic) for share in shares]
        found = np.linalg.solve(bernstein_basis(degree, shares), values)
        if self.smoothness == 3:
            return np.concatenate([found[0, :1], found[1:3].T.ravel(), found[3, -1:]])
        return np.append(found[:2].T.ravel(), found[2, -1])


def bernstein_basis(degree, u):
    """Bernstein's polynomials at u: shape (places, degree + 1)."""
    u, i = np.asarray(u, float)[:, None], np.arange(degree + 1)
    return np.array([comb(degree, k) for k in i]) * u**i * (1 - u) ** (degree - i)


def halved(rows, times):
    """Bernstein coefficients, shape (pieces, degree + 1, unknowns), of pieces halved so often (de Casteljau)."""
    m = rows.shape[1]
    left = np.array([[comb(i, j) / 2**i if j <= i else 0.0 for j in range(m)] for i in range(m)])
    for _ in range(times):
        rows = np.concatenate([left @ rows, left[::-1, ::-1] @ rows])
    return rows


def graded_breaks(start, end, count, smoothness):
    """Breaks that crowd at both ends, where a law may leave rest with infinite acceleration; halved pieces nest.

    z = u^3 (10 - 15 u + 6 u^2), u = i/count, where the acceleration may jump: the first piece is 10/count^3 of the
    whole; z = u^2 (3 - 2 u) for smoother laws.
    """
    u = np.linspace(0, 1, count + 1)
    z = u**3 * (10 + u * (6 * u - 15)) if smoothness == 1 else u**2 * (3 - 2 * u)
    return start + (end - start) * z
