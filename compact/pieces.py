"""Functions given in pieces: where they are largest and what they integrate to, without missing a thin layer.

`breaks` are the places where pieces join, ends among them, ascending. A function takes an array of places of any shape
and gives its values in that shape; pieces are seen from inside, so a jump at a join keeps both its sides.
"""

import numpy as np

EPSILON = 4 * np.finfo(float).eps  # share of a unit interval by which a join is passed: 1 - z then sees the same side
HALVINGS = 40  # of a piece towards each of its ends, down to 1e-12 of it
ZOOM, ZOOMS = 20, 7  # cells, and zooms in on the best two: to 1e-7 of a cell, so a smooth top is right to rounding


def graded(breaks, steps=24):
    """Grid on each piece: uniform inside, halving towards both ends (boundary layers)."""
    near = 2.0 ** -np.arange(HALVINGS, 3, -1)
    unit = np.concatenate([[0.0], near, np.linspace(near[-1], 1 - near[-1], steps)[1:-1], 1 - near[::-1]])
    return np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * unit).ravel(), breaks[-1])


def inside(breaks, steps=64):
    """The graded grid of each piece, kept off its ends: shape (pieces, n)."""
    low, high = breaks[:-1, None] + EPSILON, breaks[1:, None] - EPSILON
    return np.clip(low + (high - low) * graded(np.array([0.0, 1.0]), steps), low, high)


def largest(function, grid):
    """(value, place) of the largest value: `grid` of shape (pieces, n) brackets each local top, a zoom finds it."""
    value = function(grid)
    best = np.unravel_index(np.argmax(value), value.shape)
    left, middle, right = value[:, :-2], value[:, 1:-1], value[:, 2:]
    with np.errstate(invalid="ignore"):  # a function may be -inf where it does not apply
        bend = 2 * middle - left - right  # more than a smooth top can rise between the samples
    rises = (middle + bend >= value[best]) & (bend > EPSILON * np.abs(value[best]))  # a plateau has as many tops
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


def sign_changes(function, breaks):
    """Roots of a function, bracketed on the graded grid and bisected to rounding."""
    grid = graded(breaks)
    values = function(grid)
    change = np.flatnonzero(values[:-1] * values[1:] < 0)
    low, high, sign = grid[change], grid[change + 1], np.sign(values[change])
    for _ in range(60 if change.size else 0):
        middle = (low + high) / 2
        left = np.sign(function(middle)) == sign
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    return (low + high) / 2


def integral(function, breaks):
    """Integral over the pieces by Gauss' rule of 12 points on the graded grid: exact for polynomials to degree 23."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    grid = graded(np.asarray(breaks, float))
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
