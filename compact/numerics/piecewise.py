"""Functions given in pieces: where they are largest and what they integrate to, without missing a thin layer.

`breaks` are the places where pieces join, ends among them, ascending. A function takes an array of places of any shape
and gives its values in that shape; pieces are seen from inside, so a jump at a join keeps both its sides.

Smooth functions as polynomials in pieces, as near as asked: what compiled code takes of a law or a resistance.

On the piece from `breaks[i]` to `breaks[i + 1]` the function is sum_j coefficients[i, j] u^j, 0 <= u <= 1.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial, chebyshev

BREAK_OFFSET = (
    4 * np.finfo(float).eps
)  # share of a unit interval by which a join is passed: 1 - z then sees the same side
HALVINGS = 40  # of a piece towards each of its ends, down to 1e-12 of it
ZOOM, ZOOMS = 20, 7  # cells, and zooms in on the best two: to 1e-7 of a cell, so a smooth top is right to rounding


def graded_grid(breaks, steps=24):
    """Grid on each piece: uniform inside, halving towards both ends (boundary layers)."""
    near = 2.0 ** -np.arange(HALVINGS, 3, -1)
    unit = np.concatenate([[0.0], near, np.linspace(near[-1], 1 - near[-1], steps)[1:-1], 1 - near[::-1]])
    return np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * unit).ravel(), breaks[-1])


def interior_grid(breaks, steps=64):
    """The graded grid of each piece, kept off its ends: shape (pieces, n)."""
    low, high = breaks[:-1, None] + BREAK_OFFSET, breaks[1:, None] - BREAK_OFFSET
    return np.clip(low + (high - low) * graded_grid(np.array([0.0, 1.0]), steps), low, high)


def find_maximum(function, grid):
    """(value, place) of the largest value: `grid` of shape (pieces, n) brackets each local top, a zoom finds it."""
    value = function(grid)
    best = np.unravel_index(np.argmax(value), value.shape)
    left, middle, right = value[:, :-2], value[:, 1:-1], value[:, 2:]
    with np.errstate(invalid="ignore"):  # a function may be -inf where it does not apply
        bend = 2 * middle - left - right  # more than a smooth top can rise between the samples
    rises = (middle + bend >= value[best]) & (bend > BREAK_OFFSET * np.abs(value[best]))  # a plateau has as many tops
    rows, columns = np.nonzero((middle >= left) & (middle >= right) & rises)  # as samples, and none rises
    low, high = grid[rows, columns, None], grid[rows, columns + 2, None]
    tops = [(float(value[best]), float(grid[best]))]
    for _ in range(ZOOMS if rows.size else 0):
        place = low + (high - low) * np.linspace(0, 1, ZOOM + 1)
        value = function(place)
        top = value.argmax(axis=1)[:, None]
        tops.append((float(value.max()), float(place[np.unravel_index(np.argmax(value), value.shape)])))
        low, high = (np.take_along_axis(place, np.clip(top + step, 0, ZOOM), axis=1) for step in (-1, 1))
    return max(tops)


def find_roots(function, breaks):
    """Roots of a function, bracketed on the graded grid and bisected to rounding."""
    grid = graded_grid(breaks)
    values = function(grid)
    change = np.flatnonzero(values[:-1] * values[1:] < 0)
    low, high, sign = grid[change], grid[change + 1], np.sign(values[change])
    for _ in range(60 if change.size else 0):
        middle = (low + high) / 2
        left = np.sign(function(middle)) == sign
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    return (low + high) / 2


def integrate(function, breaks):
    """Integral over the pieces by Gauss' rule of 12 points on the graded grid: exact for polynomials to degree 23."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    grid = graded_grid(np.asarray(breaks, float))
    half = np.diff(grid) / 2
    points = (grid[:-1] + half)[:, None] + half[:, None] * nodes
    return float(np.sum(half[:, None] * weights * function(points)))


def clenshaw_curtis(count):
    """Nodes on [0, 1], ends included, and weights of Clenshaw and Curtis' rule of odd `count`."""
    n = count - 1
    theta = np.pi * np.arange(count) / n
    k = np.arange(1, n // 2 + 1)
    factors = np.where(k == n // 2, 1.0, 2.0) / (4.0 * k**2 - 1)
    weights = (1 - np.cos(2 * np.outer(theta, k)) @ factors) / n
    weights[[0, -1]] /= 2
    return np.sin(theta / 2) ** 2, weights


DEGREE = 8
NARROWEST = 1e-12  # share of the range: a function that is not met on such a piece jumps there
MOST = 20_000  # pieces of a round: a function that asks for more is noise
NODES = np.sin(np.pi * np.arange(DEGREE + 1) / (2 * DEGREE)) ** 2  # Chebyshev's, ends included
BETWEEN = (NODES[1:] + NODES[:-1]) / 2
EVERYWHERE = np.concatenate([NODES, BETWEEN])
BETWEEN_POWERS = np.vander(BETWEEN, DEGREE + 1, increasing=True).T
# values at the nodes to Chebyshev's coefficients, and those to powers of u: two steps, since one would lose digits
TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, DEGREE))
TO_POWERS = np.column_stack(
    [
        np.append(Polynomial(chebyshev.cheb2poly([0] * k + [1]))(Polynomial([-1, 2])).coef, [0] * (DEGREE - k))
        for k in range(DEGREE + 1)
    ]
)


class PiecewisePolynomial(NamedTuple):
    """breaks, shape (n + 1,), ascending; coefficients, shape (n, degree + 1), lowest first."""

    breaks: np.ndarray
    coefficients: np.ndarray

    def __call__(self, place):
        """Value at places of any shape; beyond the ends the outer pieces go on."""
        i = np.clip(np.searchsorted(self.breaks, place, side="right") - 1, 0, len(self.coefficients) - 1)
        u = (place - self.breaks[i]) / (self.breaks[i + 1] - self.breaks[i])
        return horner(self.coefficients[i], u)


def horner(coefficients, u):
    """Sum of coefficients[..., j] u^j, u of the shape of the leading axes."""
    value = np.zeros(np.shape(u))
    for j in range(coefficients.shape[-1] - 1, -1, -1):
        value = value * u + coefficients[..., j]
    return value


def fit_piecewise(function, breaks, tolerance):
    """`PiecewisePolynomial` that meet a function of places within a tolerance in its own unit; pieces are halved until they do.

    function : of an array of places; it is asked inside the pieces only, never at a join
    breaks : places where the function may jump or kink, ends among them, ascending

    Raises ValueError, with the place, where a function jumps between the breaks, and for one that is noise.
    """
    breaks = np.asarray(breaks, float)
    low, high, span = breaks[:-1], breaks[1:], breaks[-1] - breaks[0]
    done = []
    while low.size:
        width, inset = (high - low)[:, None], BREAK_OFFSET * span
        asked = np.clip(low[:, None] + width * EVERYWHERE, low[:, None] + inset, high[:, None] - inset)
        at_nodes, between = np.split(function(asked), [DEGREE + 1], axis=1)
        coefficients = at_nodes @ TO_CHEBYSHEV.T @ TO_POWERS.T
        miss = np.abs(coefficients @ BETWEEN_POWERS - between).max(axis=1)
        met = miss <= tolerance
        done += zip(low[met], high[met], coefficients[met], strict=True)
        if np.any(~met & (high - low < NARROWEST * span)):
            place = low[~met & (high - low < NARROWEST * span)][0]
            raise ValueError(f"a jump at {place:g}, by more than {tolerance:g}; give a function without jumps")
        if np.count_nonzero(~met) > MOST:
            raise ValueError(f"noise of more than {tolerance:g} all over; give a smooth function")
        middle = (low + high) / 2
        low, high = np.append(low[~met], middle[~met]), np.append(middle[~met], high[~met])
    done.sort(key=lambda piece: piece[0])
    return PiecewisePolynomial(
        np.append([piece[0] for piece in done], breaks[-1]), np.array([piece[2] for piece in done])
    )


def antiderivative(derivative, start):
    """The integral of `PiecewisePolynomial`, with its own value at the start of each piece, shape (n,): no rounding adds up."""
    width = np.diff(derivative.breaks)[:, None]
    powers = np.arange(1, derivative.coefficients.shape[1] + 1)
    return PiecewisePolynomial(derivative.breaks, np.column_stack([start, width * derivative.coefficients / powers]))
