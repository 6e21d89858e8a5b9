"""Motion laws that minimise a quadratic criterion between two end states.

A phase of a motion, 0 <= z <= 1, connects two states. By the calculus of variations (D 2.1) the law of order n
minimises J_n = int (x^(n))^2 dz, so that

    x^(2n) = 0,  and a free end value x^(k), k < n, gives the natural condition x^(2n-1-k) = 0 there.

`minimiser` solves this for any end conditions. `ComplexLaw` is the rest-to-rest minimiser of the weighted sum of J_1,
J_2 and J_3, whose Euler-Poisson equation x^(6) - n1 x^(4) + n2 x'' = 0 has exponential and polynomial solutions.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from compact.numerics import Array
from compact.numerics.validation import require_number

Mode = Callable[[Array, int], Array]  # odd solution about z = 1/2, by phase and order of derivative

SERIES_LIMIT = 12.0  # [-], root |p| up to which a power series about z = 1/2 is exact: cancellation costs e^(0.15 |p|)
THINNEST_LAYER = 1e12  # [-], root p; a thinner boundary layer is below the resolution of the phase and left out
LAYER_DEPTH = 40.0  # [-], p y at which e^(-p y) is below rounding
WEIGHT_ROUNDING = 4e-16  # [-], of d3: remainder of decimal weights whose sum is 1
SERIES_TERMS = 24  # [-], terms u^(2k+1)/(2k+1)! for |p u| <= 6: the last is below 1e-20 of the sum


def minimiser(order: int, start: Mapping[int, float], end: Mapping[int, float]) -> Polynomial:
    """Return the polynomial x(z) of degree < 2n, 0 <= z <= 1, that solves x^(2n) = 0 between two end states.

    Each end has n conditions. An end with fewer prescribed values is free: each x^(k), k < n, that is not prescribed
    adds the natural condition x^(2n-1-k) = 0. Conditions of order k >= n replace natural ones (combined laws of D
    2.6-2.8); all n conditions of that end are then required.

    Parameters
    ----------
    order : int
        Order n of the criterion.
    start, end : mapping of int to float
        Value of each prescribed derivative x^(k), 0 <= k < 2n, by its order k.

    Raises
    ------
    ValueError
        If the conditions do not fit the order or leave the position undetermined.

    Examples
    --------
    >>> minimiser(3, {0: 0, 1: 0, 2: 0}, {0: 1, 1: 0, 2: 0}).coef.round(12).tolist()
    [0.0, 0.0, 0.0, 10.0, -15.0, 6.0]
    """
    rows, right_side = [], []
    for z, prescribed in ((0, start), (1, end)):
        for k, value in sorted(_with_natural_conditions(order, prescribed).items()):
            rows.append([math.perm(j, k) * z ** (j - k) if j >= k else 0 for j in range(2 * order)])
            require_number(value=value)
            right_side.append(value)
    matrix = np.array(rows, float)
    if np.linalg.matrix_rank(matrix) < 2 * order:
        raise ValueError(f"`start` {start} and `end` {end} leave x undetermined; add a position, order 0, at one end")
    return Polynomial(_solve_to_rounding(matrix, np.array(right_side, float)))


def _solve_to_rounding(matrix: Array, values: Array) -> NDArray[np.floating]:
    """Solve a system of integer entries to rounding by iterative refinement in extended precision."""
    solution = np.linalg.solve(matrix, values)
    for _ in range(2):
        residual = values - matrix.astype(np.longdouble) @ solution.astype(np.longdouble)
        solution = solution + np.linalg.solve(matrix, residual.astype(float))
    return solution


def _with_natural_conditions(order: int, prescribed: Mapping[int, float]) -> dict[int, float]:
    """Conditions of one end, natural ones included, by order of derivative."""
    if any(not 0 <= k < 2 * order for k in prescribed):
        raise ValueError(
            f"orders of prescribed derivatives must lie in 0..{2 * order - 1} for order {order}, "
            f"got {sorted(prescribed)}"
        )
    free = [k for k in range(order) if k not in prescribed] if len(prescribed) < order else []
    conditions = dict(prescribed) | {2 * order - 1 - k: 0.0 for k in free}
    if len(conditions) != order:
        raise ValueError(
            f"each end requires {order} conditions for order {order}, got derivatives of order {sorted(prescribed)}"
        )
    return conditions


@dataclass(frozen=True)
class ComplexLaw:
    """Rest-to-rest law that minimises a weighted sum of energy, acceleration and jerk (D 2.5).

        I = d1 J1 + d2 J2 / 12 + d3 J3 / 720,  d3 = 1 - d1 - d2,  J_k = int_0^1 (s^(k))^2 dz
        s^(6) - n1 s^(4) + n2 s'' = 0,  n1 = 60 d2/d3,  n2 = 720 d1/d3

    with s(0) = 0, s(1) = 1 and s' = s'' = 0 at both ends (only s' = 0 if d3 = 0, neither if d2 = d3 = 0: the order of
    the equation decreases). The roots p of p^4 - n1 p^2 + n2 = 0 are real, double or complex, see `_pair_of_modes`.

    Attributes
    ----------
    energy_weight, acceleration_weight : float
        d1, d2 >= 0 [-], d1 + d2 <= 1.

    Examples
    --------
    >>> law = ComplexLaw(energy_weight=0.5, acceleration_weight=0.3)
    >>> f"{law(0.5, nu=1):.10f}"
    '1.6954401560'
    """

    energy_weight: float
    acceleration_weight: float

    def __post_init__(self) -> None:
        d1, d2 = self.energy_weight, self.acceleration_weight
        require_number(energy_weight=d1, acceleration_weight=d2)
        if not (d1 >= 0 and d2 >= 0 and d1 + d2 <= 1 + 1e-15):
            raise ValueError(
                f"`energy_weight` and `acceleration_weight` must be >= 0 with a sum <= 1, got {d1!r} and {d2!r}"
            )

    @property
    def jerk_weight(self) -> float:
        """Weight d3 = 1 - d1 - d2 [-]."""
        rest = math.fsum((1.0, -self.energy_weight, -self.acceleration_weight))
        return rest if rest > WEIGHT_ROUNDING else 0.0

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        """Return the derivative of order `nu` at phase z, 0 <= z <= 1 [-]."""
        z = np.asarray(z, float)
        slope, amplitudes = self._amplitudes
        value = sum(a * mode(z, nu) for a, mode in zip(amplitudes, self._modes, strict=True))
        return value + (0.5 + slope * (z - 0.5), slope)[nu] if nu < 2 else value + 0.0 * z

    @cached_property
    def x(self) -> Array:
        """Breakpoints for quadrature and root finding [-]: the ends, and the edges of thin boundary layers."""
        cuts = [cut for mode in self._modes if (cut := getattr(mode, "thickness", 1.0)) < 0.25]
        return np.unique([0.0, *cuts, *(1 - cut for cut in cuts), 1.0])

    @cached_property
    def _modes(self) -> list[Mode]:
        d1, d2, d3 = self.energy_weight, self.acceleration_weight, self.jerk_weight
        if d3 > 0:
            return _pair_of_modes(60 * d2 / d3, 720 * d1 / d3)
        return [_single_mode(math.sqrt(12 * d1 / d2))] if 12 * d1 < THINNEST_LAYER**2 * d2 else []

    @cached_property
    def _amplitudes(self):
        """Slope and amplitudes of the modes from s(1) = 1, s'(1) = 0, s''(1) = 0; s - 1/2 is odd about z = 1/2."""
        count = 1 + len(self._modes)
        matrix = np.array([[(0.5, 1.0, 0.0)[k]] + [float(m(1.0, k)) for m in self._modes] for k in range(count)])
        scale = np.abs(matrix).max(axis=1)
        amplitudes = np.linalg.solve(matrix / scale[:, None], np.array([0.5, 0.0, 0.0])[:count] / scale)
        return amplitudes[0], amplitudes[1:]


def _pair_of_modes(n1: float, n2: float) -> list[Mode]:
    """Two odd solutions of m^(4) - n1 m'' + n2 m = 0 modulo u, linearly independent for real, double and complex roots.

    For p1, p2 > 0 or conjugate: (p1 +- p2)/2 = sqrt(n1 +- 2 sqrt(n2))/2.
    """
    mean = math.sqrt(n1 + 2 * math.sqrt(n2)) / 2
    half_gap_squared = (n1 - 2 * math.sqrt(n2)) / 4
    if half_gap_squared > 0:
        large = mean + math.sqrt(half_gap_squared)
        small = math.sqrt(n2) / large
        if large > SERIES_LIMIT and small < large / 2:
            return [_single_mode(large), _single_mode(small)]
    if math.sqrt(mean**2 + abs(half_gap_squared)) > SERIES_LIMIT:
        return [_EndLayer(mean, half_gap_squared, first) for first in (True, False)]
    return [_series(n1, n2, lead) for lead in (1, 2)]


def _single_mode(p: float) -> Mode:
    """Odd solution of m'' = p^2 m; for small p its remainder after u (divided difference at p^2 and 0)."""
    return _EndLayer(p, 0.0, True) if p > SERIES_LIMIT / 2 else _series(p**2, 0.0, 1)


def _series(n1: float, n2: float, lead: int) -> Mode:
    """Sum over k >= lead of h_(k-lead) u^(2k+1)/(2k+1)!, u = z - 1/2, h_k = n1 h_(k-1) - n2 h_(k-2), h_0 = 1.

    The divided differences of sinh(p u)/p over p^2 in {p1^2, p2^2} (lead 1) and {0, p1^2, p2^2} (lead 2):
    real, and smooth through double roots, complex roots and p = 0.
    """
    coefficients = np.zeros(2 * SERIES_TERMS + 2)
    before, h = 0.0, 1.0
    for k in range(lead, SERIES_TERMS):
        coefficients[2 * k + 1] = h / math.factorial(2 * k + 1)
        before, h = h, n1 * h - n2 * before
    return _Series([Polynomial(coefficients)])


@dataclass(frozen=True)
class _Series:
    """Odd mode as a power series about z = 1/2; holds the derivatives computed so far, can be pickled."""

    derivatives: list[Polynomial]

    def __call__(self, z: Array, nu: int) -> Array:
        while len(self.derivatives) <= nu:
            self.derivatives.append(self.derivatives[-1].deriv())
        return self.derivatives[nu](z - 0.5)


@dataclass(frozen=True)
class _EndLayer:
    """Odd mode G(1 - z) - G(z) of a boundary layer at each end; its terms decay and cannot overflow.

    G is g1 = e^(-m y) cosh(q y) or g2 = e^(-m y) sinh(q y)/q, with q^2 of either sign; g1' = -m g1 + q^2 g2 and
    g2' = -m g2 + g1, so that a derivative changes only the two factors.
    """

    mean: float
    half_gap_squared: float
    first: bool

    @property
    def thickness(self) -> float:
        """Phase beyond which the layer is below rounding [-]."""
        slowest = self.mean - math.sqrt(max(0.0, self.half_gap_squared))
        return LAYER_DEPTH / slowest

    def __call__(self, z: Array, nu: int) -> Array:
        rate = np.array([[-self.mean, 1.0], [self.half_gap_squared, -self.mean]])
        factors = np.linalg.matrix_power(rate, nu) @ ([1.0, 0.0] if self.first else [0.0, 1.0])
        return (-1) ** nu * self._layer(1 - z, factors) - self._layer(z, factors)

    def _layer(self, y, factors):
        m, q = self.mean, math.sqrt(abs(self.half_gap_squared))
        if self.half_gap_squared > 0:
            slow = np.exp(-(m - q) * y)
            fall = -np.expm1(-2 * q * y)
            return slow * (factors[0] * (1 - fall / 2) + factors[1] * fall / (2 * q))
        return np.exp(-m * y) * (factors[0] * np.cos(q * y) + factors[1] * y * np.sinc(q * y / np.pi))
