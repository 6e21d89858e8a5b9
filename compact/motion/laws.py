"""Motion laws as normalised curves s(z), s(0) = 0, s(1) = 1, and the table LAWS of the laws by name.

The phase is z = t/T. Curves follow the protocol of scipy's PPoly (`NormalisedCurve`), which most laws are. Section
numbers are those of the monograph D.

Most laws minimise a quadratic criterion between two end states of a phase, 0 <= z <= 1. By the calculus of variations
(D 2.1) the law of order n minimises J_n = int (x^(n))^2 dz, so that

    x^(2n) = 0,  and a free end value x^(k), k < n, gives the natural condition x^(2n-1-k) = 0 there.

`minimiser` solves this for any end conditions. `ComplexLaw` is the rest-to-rest minimiser of the weighted sum of J_1,
J_2 and J_3, whose Euler-Poisson equation x^(6) - n1 x^(4) + n2 x'' = 0 has exponential and polynomial solutions.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from compact.numerics import Array
from compact.numerics.validation import require_between, require_number

Orders = tuple[int, ...]  # of derivatives

# [-], of the duration: a shorter acceleration or deceleration phase is left out, its breakpoints coincide in rounding
SHORTEST_PHASE = 1e-12
SUM_TOLERANCE = 1e-12  # [-], of the sum of run_up and run_down
SERIES_LIMIT = 12.0  # [-], root |p| up to which a power series about z = 1/2 is exact: cancellation costs e^(0.15 |p|)
THINNEST_LAYER = 1e12  # [-], root p; a thinner boundary layer is below the resolution of the phase and left out
LAYER_DEPTH = 40.0  # [-], p y at which e^(-p y) is below rounding
WEIGHT_ROUNDING = 4e-16  # [-], of d3: remainder of decimal weights whose sum is 1
SERIES_TERMS = 24  # [-], terms u^(2k+1)/(2k+1)! for |p u| <= 6: the last is below 1e-20 of the sum


class NormalisedCurve(Protocol):
    """Law s(z), 0 <= z <= 1, as a callable of phase and order of derivative."""

    @property
    def x(self) -> Array:
        """Breakpoints between the pieces, both ends included [-]."""

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        """Return the derivative of order `nu` at phase z [-]."""


class LawParameters(NamedTuple):
    """Parameters of the laws; each law uses those that it needs.

    Attributes
    ----------
    run_up, run_down : float
        Duration of the acceleration and of the deceleration phase over that of the pass [-]; combined, reversal.
    energy_weight, acceleration_weight : float
        Weights d1, d2 of the complex law [-].
    rod_ratio : float, optional
        Crank radius over rod length [-], 0 <= ratio < 1; crank.
    """

    run_up: float
    run_down: float
    energy_weight: float
    acceleration_weight: float
    rod_ratio: float | None


def require_phases(run_up: float, run_down: float) -> None:
    """Require acceleration and deceleration phase [-] to leave no negative phase between them."""
    require_number(run_up=run_up, run_down=run_down)
    require_between(0, 1, run_up=run_up, run_down=run_down)
    if run_up + run_down > 1 + SUM_TOLERANCE:
        raise ValueError(f"`run_up` + `run_down` must not exceed 1, got {run_up!r} + {run_down!r}")


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
    rows, values, columns = [], [], range(2 * order)
    for z, prescribed in ((0, start), (1, end)):
        free = [k for k in range(order) if k not in prescribed] if len(prescribed) < order else []
        conditions = dict(prescribed) | {2 * order - 1 - k: 0.0 for k in free}
        if len(conditions) != order or not conditions.keys() <= set(columns):
            raise ValueError(
                f"each end requires {order} conditions on derivatives of order 0 to {2 * order - 1}, got "
                f"{sorted(prescribed)}"
            )
        for k, value in sorted(conditions.items()):
            require_number(value=value)
            rows.append([math.perm(j, k) * z ** (j - k) if j >= k else 0 for j in columns])
            values.append(value)
    matrix, right = np.array(rows, float), np.array(values, float)
    if np.linalg.matrix_rank(matrix) < 2 * order:
        raise ValueError(f"`start` {start} and `end` {end} leave x undetermined; add a position, order 0, at one end")
    solution = np.linalg.solve(matrix, right)
    for _ in range(2):  # refined in extended precision, exact to rounding as the entries are integers
        residual = right - matrix.astype(np.longdouble) @ solution.astype(np.longdouble)
        solution = solution + np.linalg.solve(matrix, residual.astype(float))
    return Polynomial(solution)


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
        polynomial, layers = self._parts
        return polynomial.deriv(nu)(z - 0.5) + sum(amplitude * layer(z, nu) for amplitude, layer in layers)

    @cached_property
    def _parts(self):
        """Polynomial of z - 1/2, and amplitudes of the layers at the ends."""
        slope, amplitudes = self._amplitudes
        modes = list(zip(amplitudes, self._modes, strict=True))
        series = (amplitude * mode for amplitude, mode in modes if isinstance(mode, Polynomial))
        return sum(series, Polynomial([0.5, slope])), [each for each in modes if not isinstance(each[1], Polynomial)]

    @cached_property
    def x(self) -> Array:
        """Breakpoints for quadrature and root finding [-]: the ends, and the edges of thin boundary layers."""
        cuts = [cut for mode in self._modes if (cut := getattr(mode, "thickness", 1.0)) < 0.25]
        return np.unique([0.0, *cuts, *(1 - cut for cut in cuts), 1.0])

    @cached_property
    def _modes(self) -> list["Polynomial | _EndLayer"]:
        d1, d2, d3 = self.energy_weight, self.acceleration_weight, self.jerk_weight
        if d3 > 0:
            return _pair_of_modes(60 * d2 / d3, 720 * d1 / d3)
        return [_single_mode(math.sqrt(12 * d1 / d2))] if 12 * d1 < THINNEST_LAYER**2 * d2 else []

    @cached_property
    def _amplitudes(self):
        """Slope and amplitudes of the modes from s(1) = 1, s'(1) = 0, s''(1) = 0; s - 1/2 is odd about z = 1/2."""
        count = 1 + len(self._modes)
        modes = [[float(_mode_at(mode, 1.0, k)) for mode in self._modes] for k in range(count)]
        matrix = np.column_stack([(0.5, 1.0, 0.0)[:count], modes])
        scale = np.abs(matrix).max(axis=1)
        amplitudes = np.linalg.solve(matrix / scale[:, None], np.array([0.5, 0.0, 0.0])[:count] / scale)
        return amplitudes[0], amplitudes[1:]


def _pair_of_modes(n1: float, n2: float) -> list["Polynomial | _EndLayer"]:
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


def _mode_at(mode: "Polynomial | _EndLayer", z: ArrayLike, nu: int) -> Array:
    """Return the derivative of order `nu` of an odd solution: a power series about z = 1/2, or layers at the ends."""
    return mode.deriv(nu)(np.asarray(z) - 0.5) if isinstance(mode, Polynomial) else mode(z, nu)


def _single_mode(p: float) -> "Polynomial | _EndLayer":
    """Odd solution of m'' = p^2 m; for small p its remainder after u (divided difference at p^2 and 0)."""
    return _EndLayer(p, 0.0, True) if p > SERIES_LIMIT / 2 else _series(p**2, 0.0, 1)


def _series(n1: float, n2: float, lead: int) -> Polynomial:
    """Sum over k >= lead of h_(k-lead) u^(2k+1)/(2k+1)!, u = z - 1/2, h_k = n1 h_(k-1) - n2 h_(k-2), h_0 = 1.

    The divided differences of sinh(p u)/p over p^2 in {p1^2, p2^2} (lead 1) and {0, p1^2, p2^2} (lead 2):
    real, and smooth through double roots, complex roots and p = 0.
    """
    coefficients = np.zeros(2 * SERIES_TERMS + 2)
    before, h = 0.0, 1.0
    for k in range(lead, SERIES_TERMS):
        coefficients[2 * k + 1] = h / math.factorial(2 * k + 1)
        before, h = h, n1 * h - n2 * before
    return Polynomial(coefficients)


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

    def __call__(self, z, nu: int) -> Array:
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


def point_to_point(order: int) -> PPoly:
    """Return the rest-to-rest law x^(2n) = 0 of order n (D 2.1-2.4): s^(k) = 0 for 0 < k < n at both ends."""
    rest = dict.fromkeys(range(1, order), 0)
    return piecewise([1.0], [minimiser(order, {0: 0} | rest, {0: 1} | rest)])


def with_constant_velocity(order: int, rest: Orders, steady: Orders, run_up: float, run_down: float) -> PPoly:
    """Return a law of acceleration, constant velocity and deceleration, its mirror image (D 2.6-2.8, 3, 4).

    The acceleration phase is the `minimiser` from rest to unit velocity in unit time; with its travel A the velocity
    of the law is v = 1/(A run_up + 1 - run_up - run_down + A run_down).

    Parameters
    ----------
    rest, steady : tuple of int
        Orders of the derivatives that vanish at rest and at the constant velocity. The position there is free: its
        natural condition is added unless `order` derivatives are prescribed.
    """
    run = minimiser(order, dict.fromkeys((0, *rest), 0), {1: 1} | dict.fromkeys(steady, 0))
    up, down = (share if share > SHORTEST_PHASE else 0.0 for share in (run_up, run_down))
    down = 1 - (1 - down)  # the width that remains after rounding of its breakpoint
    even = max(0.0, 1 - up - down)
    speed = 1 / (run(1.0) * (up + down) + even)
    pieces = []
    if up > 0:
        pieces.append((up, speed * up * run(Polynomial([0, 1 / up]))))
    if even > SHORTEST_PHASE:
        pieces.append((even, Polynomial([speed * up * run(1.0), speed])))
    if down > 0:
        pieces.append((down, 1 - speed * down * run(Polynomial([1, -1 / down]))))
    return piecewise(*zip(*pieces, strict=True))


def piecewise(widths: Sequence[float], polynomials: Sequence[Polynomial]) -> PPoly:
    """Return polynomials in the distance from the start of each piece of a width [-] as one on 0 <= z <= 1."""
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    breaks[-1] = 1.0
    if len(widths) > 1:
        breaks[-2] = 1 - widths[-1]
    coefficients = np.zeros((max(p.degree() for p in polynomials) + 1, len(polynomials)))
    for i, polynomial in enumerate(polynomials):
        coefficients[-len(polynomial.coef) :, i] = polynomial.coef[::-1]
    return PPoly(coefficients, breaks)


@dataclass(frozen=True)
class SineCurve:
    """Piecewise polynomial plus sine: s(z) = P(z) + A sin(w z + phase), with A and phase of each piece.

    Attributes
    ----------
    polynomial : PPoly
        Piecewise polynomial P.
    frequency : float
        Angular frequency w over the phase [rad].
    amplitudes, phases : tuple of float
        Amplitude [-] and phase [rad] of each piece.
    """

    polynomial: PPoly
    frequency: float
    amplitudes: tuple[float, ...]
    phases: tuple[float, ...]

    @property
    def x(self) -> Array:
        """Breakpoints between the pieces, both ends included [-]."""
        return self.polynomial.x

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        """Return the derivative of order `nu` at phase z [-]."""
        z = np.asarray(z, float)
        piece = np.clip(np.searchsorted(self.x, z, side="right") - 1, 0, len(self.amplitudes) - 1)
        angle = self.frequency * z + np.take(self.phases, piece) + nu * np.pi / 2
        return self.polynomial(z, nu=nu) + np.take(self.amplitudes, piece) * self.frequency**nu * np.sin(angle)


def modified_trapezoid() -> SineCurve:
    """Return the modified trapezoidal law (VDI 2143; Norton, Cam Design and Manufacturing Handbook).

    Its acceleration is C sin 4 pi z (z < 1/8), C (1/8-3/8), C cos 4 pi (z - 3/8) (3/8-5/8), then antisymmetric;
    C = 8 pi/(2 + pi) = 4.8881 gives s(1) = 1.
    """
    c, w, breaks = 8 * np.pi / (2 + np.pi), 4 * np.pi, np.array([0, 1, 3, 5, 7, 8]) / 8
    # the sine part of s is -(C/w^2) sin(w z), less pi in the middle, and zero where s'' is constant
    steady = PPoly(c * np.array([[0.0, 1, 0, -1, 0]]), breaks).antiderivative(2)
    steady.c[1] += c / w
    steady.c[2] += c / w * breaks[:-1] + c / w**2 * np.array([0, -1, 0, 1, 0])
    return SineCurve(steady, w, (-c / w**2, 0, -c / w**2, 0, -c / w**2), (0, 0, -np.pi, 0, 0))


@dataclass(frozen=True)
class CrankCurve:
    """Half a turn of a slider-crank mechanism from the outer dead centre, at uniform angular velocity.

    With a finite rod the return stroke is the forward stroke reversed in time.

        s = (1 - cos psi)/2 + r,  r - k r^2 = (k/4) sin^2 psi,  psi = pi z,  k = radius/rod

    where r is due to the finite rod; its derivatives follow by the Leibniz rule. k = 0 is the harmonic law.

    Attributes
    ----------
    ratio : float
        Crank radius over rod length k [-], 0 <= k < 1.
    """

    ratio: float
    x = np.array([0.0, 1.0])

    @property
    def retraces(self) -> bool:
        """True for a finite rod."""
        return self.ratio > 0

    def __post_init__(self) -> None:
        if not 0 <= self.ratio < 1:
            raise ValueError(
                f"crank radius over rod length must lie in [0, 1), got {self.ratio!r}; use a rod longer than the crank"
            )

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        """Return the derivative of order `nu` at phase z [-]."""
        psi, k = np.pi * np.asarray(z, float), self.ratio
        infinite_rod = np.sin(psi / 2) ** 2 if nu == 0 else -np.cos(psi + nu * np.pi / 2) / 2
        q = np.sqrt(1 - (k * np.sin(psi)) ** 2)  # = 1 - 2 k r
        r = [k * np.sin(psi) ** 2 / (2 * (1 + q))]  # and its derivatives by psi
        for n in range(1, nu + 1):
            mixed = sum(math.comb(n, j) * r[j] * r[n - j] for j in range(1, n))
            r.append(k * (mixed - 2**n * np.cos(2 * psi + n * np.pi / 2) / 8) / q)
        return np.pi**nu * (infinite_rod + r[nu])


def _crank(parameters: LawParameters) -> CrankCurve:
    if parameters.rod_ratio is None:
        raise ValueError("the law 'crank' requires `rod_length`, got None; set the length of the connecting rod [m]")
    return CrankCurve(parameters.rod_ratio)


def _steady(order: int, rest: Orders, steady: Orders) -> Callable[[LawParameters], PPoly]:
    return lambda parameters: with_constant_velocity(order, rest, steady, parameters.run_up, parameters.run_down)


#: Published motion laws by name: the curve for a set of parameters.
LAWS: Mapping[str, Callable[[LawParameters], NormalisedCurve]] = MappingProxyType(
    {
        "constant-velocity": lambda _: point_to_point(1),  # D 2.1
        "cubic": lambda _: point_to_point(2),  # D 2.2
        "quintic": lambda _: point_to_point(3),  # D 2.3
        "septic": lambda _: point_to_point(4),  # D 2.4
        "complex": lambda p: ComplexLaw(p.energy_weight, p.acceleration_weight),  # D 2.5
        "combined-2": _steady(2, (1,), (2,)),  # D 2.6
        "combined-3": _steady(3, (1, 2), (2, 3)),  # D 2.7
        "combined-4": _steady(4, (1, 2, 3), (2, 3, 4)),  # D 2.8
        "reversal-2": _steady(2, (1,), ()),  # D 3.1
        "reversal-3": _steady(3, (1, 2), (2,)),  # D 3.2
        "reversal-4": _steady(4, (1, 2, 3), (2, 3)),  # D 3.3, A
        "reversal-3-free-acceleration": _steady(3, (1,), (2,)),  # D 4.1
        "reversal-4-free-acceleration": _steady(4, (1, 3), (2, 3)),  # D 4.2
        # D 4.3: the free jerk at the reversal is shared by deceleration and acceleration and odd in time, hence zero
        "reversal-4-free-jerk": _steady(4, (1, 2, 3), (2, 3)),
        "reversal-4-free-both": _steady(4, (1, 3), (2, 3)),  # D 4.4, B
        "crank": _crank,  # crank and connecting rod, uniform rotation; C
        "gear-sector": lambda _: point_to_point(1),  # constant speed with shocks; D 1.5
        "parabolic": lambda _: with_constant_velocity(2, (1,), (), 0.5, 0.5),  # constant acceleration; D 1.5
        "harmonic": lambda _: CrankCurve(0.0),  # (1 - cos pi z)/2, an infinite rod; VDI 2143, D 1.5
        "cycloidal": lambda _: SineCurve(  # z - sin(2 pi z)/(2 pi); VDI 2143, D 1.5
            piecewise([1.0], [Polynomial([0, 1])]), 2 * np.pi, (-1 / (2 * np.pi),), (0.0,)
        ),
        "modified-trapezoid": lambda _: modified_trapezoid(),  # VDI 2143, D 1.5
    }
)
