"""Maxima, roots, integrals and polynomial approximation of functions defined piecewise.

`breaks` are the ascending abscissae at which pieces join, both ends included. A function accepts an array of abscissae
of any shape and returns values of that shape. Pieces are evaluated at interior points only, so that both limits at a
discontinuity count. Grids are graded geometrically towards the breaks and resolve boundary layers down to 1e-12 of a
piece.

On the piece from `breaks[i]` to `breaks[i + 1]` a `PiecewisePolynomial` is sum_j coefficients[i, j] u^j, 0 <= u <= 1.
Compiled code evaluates motion laws and resistances in this form.

References
----------
L. N. Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, chapters 2 and 19 (Chebyshev interpolation,
Clenshaw-Curtis quadrature).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial, chebyshev, polynomial
from numpy.typing import ArrayLike

from compact.numerics import Array, IntArray

Function = Callable[[Array], Array]

BREAK_OFFSET = 4 * np.finfo(float).eps  # [-], distance from a break over the unit interval; resolved in 1 - z too
HALVINGS = 40  # [-], halvings of a piece towards each of its ends, down to 1e-12 of it
ZOOM_CELLS, ZOOM_LEVELS = 100, 4  # [-], cells and levels of the search, to 1e-7 of a cell; a smooth maximum needs 2
SMOOTH_RISE = 1e-6  # [-], of a maximum; larger ones between such samples are kinks or jumps
ROOT_ROUNDING = 3e-13  # [-], of the largest value; a smaller one is zero
ROOT_ITERATIONS = 16  # [-], of the Illinois method from a graded grid; more would follow the rounding of a flat root
GAUSS_POINTS = 12  # [-], per cell; exact for polynomials up to degree 23

DEGREE = 8  # [-], of the polynomial on each piece
MIN_PIECE = 1e-12  # [-], length of a piece over the range; an error on such a piece indicates a discontinuity
MAX_PIECES = 20_000  # [-], pieces halved at one level; more indicate noise
NODES = np.sin(np.pi * np.arange(DEGREE + 1) / (2 * DEGREE)) ** 2  # Chebyshev nodes on [0, 1], ends included
CHECK_POINTS = (NODES[1:] + NODES[:-1]) / 2  # points between the nodes at which the error is measured
SAMPLE_POINTS = np.concatenate([NODES, CHECK_POINTS])
CHECK_POWERS = np.vander(CHECK_POINTS, DEGREE + 1, increasing=True).T
# nodal values to Chebyshev coefficients, and those to powers of u: two steps, since their product loses digits
TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, DEGREE))
TO_POWERS = np.column_stack(
    [np.pad(Chebyshev.basis(k, [0, 1]).convert(kind=Polynomial).coef, (0, DEGREE - k)) for k in range(DEGREE + 1)]
).astype(float)


def graded_grid(breaks: Array, cells: int = 24) -> Array:
    """Return a grid with all breaks, uniform inside each piece and graded by halving towards both of its ends."""
    graded = 2.0 ** -np.arange(HALVINGS, 3, -1)
    unit = np.concatenate([[0.0], graded, np.linspace(graded[-1], 1 - graded[-1], cells)[1:-1], 1 - graded[::-1]])
    return np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * unit).ravel(), breaks[-1])


def interior_grid(breaks: Array, steps: int = 64) -> Array:
    """Return the graded grid of each piece, its ends moved inwards by `BREAK_OFFSET`, shape (pieces, n)."""
    low, high = breaks[:-1, None] + BREAK_OFFSET, breaks[1:, None] - BREAK_OFFSET
    return np.clip(low + (high - low) * graded_grid(np.array([0.0, 1.0]), steps), low, high)


def find_maximum(function: Function, grid: Array, values: Array | None = None) -> tuple[float, float]:
    """Find the global maximum of a function and its position on a grid of pieces as of `interior_grid`.

    Local maxima are bracketed by the values on the grid, computed by default, and located by repeated subdivision of
    the two best cells, until the parabola through the best three samples changes no more.
    """
    values = function(grid) if values is None else values
    best = np.unravel_index(np.argmax(values), values.shape)
    left, middle, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
    with np.errstate(invalid="ignore"):  # -inf - -inf
        bend = 2 * middle - left - right  # upper bound of the rise of a smooth maximum between samples
    # on a plateau every sample is a local maximum, and none can rise
    rises = (middle + bend >= values[best]) & (bend > BREAK_OFFSET * np.abs(values[best]))
    rows, columns = np.nonzero((middle >= left) & (middle >= right) & rises)
    low, high = grid[rows, columns, None], grid[rows, columns + 2, None]
    sampled = found = float(values[best]), float(grid[best])
    for _ in range(ZOOM_LEVELS if rows.size else 0):
        points = low + (high - low) * np.linspace(0, 1, ZOOM_CELLS + 1)
        values = function(points)
        highest = np.clip(values.argmax(axis=1), 1, ZOOM_CELLS - 1)[:, None] + np.array([-1, 0, 1])
        points, values = (np.take_along_axis(each, highest, axis=1) for each in (points, values))
        low, high = points[:, :1], points[:, 2:]
        heights, places = _vertices(points, values)
        top, before = heights.argmax(), found[0]
        found = float(heights[top]), float(places[top])
        if abs(found[0] - before) <= BREAK_OFFSET * abs(before):
            break
    return max(sampled, found)


def _vertices(places: Array, values: Array) -> tuple[Array, Array]:
    """Heights and places of parabolas through three even samples each; the middle sample at a kink or jump."""
    left, middle, right = values.T
    bend = 2 * middle - left - right
    shift = np.divide(right - left, 2 * bend, out=np.zeros(bend.shape), where=bend > 0)
    shift[bend * shift**2 > SMOOTH_RISE * np.abs(middle)] = 0.0
    return middle + bend * shift**2 / 2, places[:, 1] + shift * (places[:, 2] - places[:, 0]) / 2


def find_roots(function: Function, breaks: Array) -> Array:
    """Find the roots at which a function changes its sign between breaks, ascending."""
    return find_sign_changes(lambda abscissa, _: function(abscissa), 1, graded_grid(breaks), 4 * ROOT_ITERATIONS)


def find_sign_changes(
    function: Callable[[Array, IntArray], Array], count: int, grid: Array, iterations: int = ROOT_ITERATIONS
) -> Array:
    """Find where functions of (abscissa, number), 0 to count - 1, change sign on a grid, by the Illinois method."""
    values = np.broadcast_to(function(grid, np.arange(count)[:, None]), (count, len(grid)))
    rows, columns = np.nonzero((values[:, 1:] < 0) != (values[:, :-1] < 0))
    low, high = grid[columns], grid[columns + 1]
    at_low, at_high, nearest, least = values[rows, columns], values[rows, columns + 1], low, np.full(low.shape, np.inf)
    side, rounding = np.full(low.shape, -1), ROOT_ROUNDING * np.abs(values).max(axis=1)[rows]
    for _ in range(iterations if rows.size else 0):
        with np.errstate(divide="ignore", invalid="ignore"):
            place = high - at_high * (high - low) / (at_high - at_low)
        place = np.where((place > low) & (place < high), place, (low + high) / 2)
        here = function(place, rows)
        nearest, least = np.where(np.abs(here) < least, place, nearest), np.minimum(np.abs(here), least)
        if np.all(least <= rounding):
            break
        upper = (here < 0) == (at_high < 0)
        kept = np.where(upper == side, 0.5, 1.0)  # an end that stays twice
        low, at_low = np.where(upper, low, place), np.where(upper, kept * at_low, here)
        high, at_high, side = np.where(upper, place, high), np.where(upper, here, kept * at_high), upper
    return nearest


def integrate(function: Function, breaks: ArrayLike) -> float:
    """Integrate a function over its pieces by Gauss quadrature on the graded grid; exact up to degree 23."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)
    grid = graded_grid(np.asarray(breaks, float))
    half = np.diff(grid) / 2
    points = (grid[:-1] + half)[:, None] + half[:, None] * nodes
    return float(np.sum(half[:, None] * weights * function(points)))


def clenshaw_curtis(count: int) -> tuple[Array, Array]:
    """Return nodes, ascending with both ends, and weights of Clenshaw-Curtis quadrature on [0, 1]; `count` is odd."""
    n = count - 1
    theta = np.pi * np.arange(count) / n
    k = np.arange(1, n // 2 + 1)
    factors = np.where(k == n // 2, 1.0, 2.0) / (4.0 * k**2 - 1)
    weights = (1 - np.cos(2 * np.outer(theta, k)) @ factors) / n
    weights[[0, -1]] /= 2
    return np.sin(theta / 2) ** 2, weights


class PiecewisePolynomial(NamedTuple):
    """Polynomial on each piece.

    Parameters
    ----------
    breaks : ndarray, shape (pieces + 1,)
        Breaks, ascending.
    coefficients : ndarray, shape (pieces, degree + 1)
        Coefficients of the powers of the local coordinate u, 0 <= u <= 1, lowest first.
    """

    breaks: Array
    coefficients: Array

    def __call__(self, abscissa: Array) -> Array:
        """Evaluate at abscissae of any shape; beyond the ends the outer polynomials are extrapolated."""
        i = np.clip(np.searchsorted(self.breaks, abscissa, side="right") - 1, 0, len(self.coefficients) - 1)
        u = (abscissa - self.breaks[i]) / (self.breaks[i + 1] - self.breaks[i])
        return np.asarray(polynomial.polyval(u, np.moveaxis(self.coefficients[i], -1, 0), tensor=False))


def fit_piecewise(function: Function, breaks: ArrayLike, tolerance: float) -> PiecewisePolynomial:
    """Approximate a function by a piecewise polynomial; pieces are halved until they satisfy the tolerance.

    Parameters
    ----------
    function : callable
        Function of abscissae; evaluated in the interior of the pieces only.
    breaks : array_like, shape (pieces + 1,)
        Abscissae at which the function may have a jump or a kink, ascending, both ends included.
    tolerance : float
        Largest error, in the unit of the function.

    Raises
    ------
    ValueError
        If the function has a discontinuity between the breaks, or noise larger than the tolerance.
    """
    breaks = np.asarray(breaks, float)
    low, high, span = breaks[:-1], breaks[1:], breaks[-1] - breaks[0]
    starts, pieces = [], []
    while low.size:
        inside, width = (low[:, None] + BREAK_OFFSET * span, high[:, None] - BREAK_OFFSET * span), high - low
        points = np.clip(low[:, None] + width[:, None] * SAMPLE_POINTS, *inside)
        at_nodes, at_checks = np.split(function(points), [DEGREE + 1], axis=1)
        coefficients = at_nodes @ TO_CHEBYSHEV.T @ TO_POWERS.T
        good = np.abs(coefficients @ CHECK_POWERS - at_checks).max(axis=1) <= tolerance
        starts.append(low[good])
        pieces.append(coefficients[good])
        if np.any(short := ~good & (width < MIN_PIECE * span)):
            raise ValueError(f"a jump of more than {tolerance:g} at {low[short][0]:g}; supply a function without jumps")
        if np.count_nonzero(~good) > MAX_PIECES:
            raise ValueError(f"noise of more than {tolerance:g} throughout; supply a smooth function")
        middle = (low + high) / 2
        low, high = np.append(low[~good], middle[~good]), np.append(middle[~good], high[~good])
    start = np.concatenate(starts)
    order = np.argsort(start)
    return PiecewisePolynomial(np.append(start[order], breaks[-1]), np.concatenate(pieces)[order])


def antiderivative(derivative: PiecewisePolynomial, start: Array) -> PiecewisePolynomial:
    """Integrate a piecewise polynomial with a given value at the start of each piece, against rounding."""
    width = np.diff(derivative.breaks)[:, None]
    powers = np.arange(1, derivative.coefficients.shape[1] + 1)
    return PiecewisePolynomial(derivative.breaks, np.column_stack([start, width * derivative.coefficients / powers]))
