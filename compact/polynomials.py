"""Smooth functions as polynomials in pieces, as near as asked: what compiled code takes of a law or a resistance.

On the piece from `breaks[i]` to `breaks[i + 1]` the function is sum_j coefficients[i, j] u^j, 0 <= u <= 1.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial, chebyshev

from compact.pieces import EPSILON

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


class Pieces(NamedTuple):
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


def pieces(function, breaks, tolerance):
    """`Pieces` that meet a function of places within a tolerance in its own unit; pieces are halved until they do.

    function : of an array of places; it is asked inside the pieces only, never at a join
    breaks : places where the function may jump or kink, ends among them, ascending

    Raises ValueError, with the place, where a function jumps between the breaks, and for one that is noise.
    """
    breaks = np.asarray(breaks, float)
    low, high, span = breaks[:-1], breaks[1:], breaks[-1] - breaks[0]
    done = []
    while low.size:
        width, inset = (high - low)[:, None], EPSILON * span
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
    return Pieces(np.append([piece[0] for piece in done], breaks[-1]), np.array([piece[2] for piece in done]))


def integrated(derivative, start):
    """The integral of `Pieces`, with its own value at the start of each piece, shape (n,): no rounding adds up."""
    width = np.diff(derivative.breaks)[:, None]
    powers = np.arange(1, derivative.coefficients.shape[1] + 1)
    return Pieces(derivative.breaks, np.column_stack([start, width * derivative.coefficients / powers]))
