"""The motion laws as normalised curves s(z), s(0) = 0, s(1) = 1, and the table LAWS that names them.

A curve is called as `curve(z, nu=k)` for the derivative of order k at phase z = t/T and holds in `curve.x` the phases
where its pieces join: the protocol of scipy's PPoly, which most laws are. Sections are those of the monograph D.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import PPoly

from compact.motion.minimum_criterion import ComplexLaw, minimiser
from compact.numerics.validation import require_between

SHORTEST = 1e-12  # share of the duration that still counts as a run-up or run-down: below it, phases blur to rounding


@dataclass(frozen=True)
class Shape:
    """What a law may be shaped by; each law takes what it needs.

    run_up, run_down : shares of the stroke's duration, >= 0 with a sum <= 1 (combined and reversal laws)
    energy_weight, acceleration_weight : d1, d2 of the complex law
    rod_ratio : crank radius over rod length, 0 <= ratio < 1, or None where no rod is given (crank)
    """

    run_up: float = 1 / 6
    run_down: float = 1 / 6
    energy_weight: float = 0.5
    acceleration_weight: float = 0.3
    rod_ratio: float | None = None

    def __post_init__(self):
        require_between(0, 1, run_up=self.run_up, run_down=self.run_down)
        if self.run_up + self.run_down > 1 + 1e-12:
            raise ValueError(f"`run_up` + `run_down` must not exceed 1, got {self.run_up!r} + {self.run_down!r}")


@dataclass(frozen=True)
class Law:
    """One entry of LAWS: how to build the curve, where it is printed, whether the way back retraces the way out."""

    build: Callable[[Shape], Callable]
    source: str
    retraces: bool = False


def point_to_point(order):
    """Rest to rest, x^(2n) = 0 (D 2.1-2.4): s^(k) = 0 for 0 < k < n at both ends."""
    rest = dict.fromkeys(range(1, order), 0)
    return _one_piece(minimiser(order, {0: 0} | rest, {0: 1} | rest))


def with_steady_part(order, start, end, shape):
    """Run-up, constant speed, run-down that mirrors the run-up (D 2.6-2.8, 3, 4).

    The run-up is `minimiser(order, {x: 0} | start, end)` to unit speed in unit time; its length A closes the stroke:
    v = 1/(A run_up + 1 - run_up - run_down + A run_down).
    """
    run = minimiser(order, {0: 0} | start, end)
    up, down = (share if share > SHORTEST else 0.0 for share in (shape.run_up, shape.run_down))
    down = 1 - (1 - down)  # the width that is left after its break is rounded
    steady = max(0.0, 1 - up - down)
    speed = 1 / (run(1.0) * (up + down) + steady)
    pieces = []
    if up > 0:
        pieces.append((up, speed * up * run(Polynomial([0, 1 / up]))))
    if steady > SHORTEST:
        pieces.append((steady, Polynomial([speed * up * run(1.0), speed])))
    if down > 0:
        pieces.append((down, 1 - speed * down * run(Polynomial([1, -1 / down]))))
    return piecewise([width for width, _ in pieces], [piece for _, piece in pieces])


def piecewise(widths, polynomials):
    """PPoly on 0 <= z <= 1 from the width of each piece and its polynomial in the distance from its start."""
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    breaks[-1] = 1.0
    if len(widths) > 1:
        breaks[-2] = 1 - widths[-1]
    coefficients = np.zeros((max(p.degree() for p in polynomials) + 1, len(polynomials)))
    for i, polynomial in enumerate(polynomials):
        coefficients[-len(polynomial.coef) :, i] = polynomial.coef[::-1]
    return PPoly(coefficients, breaks)


def _one_piece(polynomial):
    return piecewise([1.0], [polynomial])


@dataclass(frozen=True)
class SineCurve:
    """Pieces of polynomial plus sine: s(z) = P(z) + A sin(w z + phase), A and phase by piece."""

    polynomial: PPoly
    frequency: float
    amplitudes: tuple[float, ...]
    phases: tuple[float, ...]

    @property
    def x(self):
        """Phases where pieces join."""
        return self.polynomial.x

    def __call__(self, z, nu=0):
        """Derivative of order `nu` at z."""
        z = np.asarray(z, float)
        piece = np.clip(np.searchsorted(self.x, z, side="right") - 1, 0, len(self.amplitudes) - 1)
        angle = self.frequency * z + np.take(self.phases, piece) + nu * np.pi / 2
        return self.polynomial(z, nu=nu) + np.take(self.amplitudes, piece) * self.frequency**nu * np.sin(angle)


def harmonic():
    """s = (1 - cos pi z)/2: the acceleration jumps at both ends."""
    return SineCurve(_one_piece(Polynomial([0.5])), np.pi, (-0.5,), (np.pi / 2,))


def cycloidal():
    """s = z - sin(2 pi z)/(2 pi)."""
    return SineCurve(_one_piece(Polynomial([0, 1])), 2 * np.pi, (-1 / (2 * np.pi),), (0.0,))


def parabolic():
    """Constant acceleration and deceleration: s'' = 4, then -4."""
    return piecewise([0.5, 0.5], [Polynomial([0, 0, 2]), Polynomial([0.5, 2, -2])])


def modified_trapezoid():
    """Acceleration C sin 4 pi z (z < 1/8), C (1/8-3/8), C cos 4 pi (z - 3/8) (3/8-5/8), then antisymmetric.

    C = 8 pi/(2 + pi) = 4.8881 closes the stroke (VDI 2143; Norton, Cam Design and Manufacturing Handbook).
    """
    c, w = 8 * np.pi / (2 + np.pi), 4 * np.pi
    # sine part of s with s'' = C sin(w z), C, C sin(w z - pi), -C, C sin(w z - 2 pi)
    amplitudes, phases = (-c / w**2, 0, -c / w**2, 0, -c / w**2), (0, 0, -np.pi, 0, 0)
    sine = SineCurve(_one_piece(Polynomial([0.0])), w, (1.0,), (0.0,))
    widths, halves = (1 / 8, 1 / 4, 1 / 4, 1 / 4, 1 / 8), (0, c / 2, 0, -c / 2, 0)
    position, speed, start, pieces = 0.0, 0.0, 0.0, []
    for width, amplitude, phase, half in zip(widths, amplitudes, phases, halves, strict=True):
        at = [amplitude * w**k * math.sin(w * start + phase + k * math.pi / 2) for k in (0, 1)]
        piece = Polynomial([position - at[0], speed - at[1], half])
        pieces.append(piece)
        start += width
        position = piece(width) + amplitude * math.sin(w * start + phase)
        speed = piece.deriv()(width) + amplitude * w * math.cos(w * start + phase)
    return SineCurve(piecewise(widths, pieces), sine.frequency, amplitudes, phases)


@dataclass(frozen=True)
class CrankCurve:
    """Half a turn of a crank and connecting rod from the outer dead centre, at uniform speed.

        s = (1 - cos psi)/2 + r,  r - k r^2 = (k/4) sin^2 psi,  psi = pi z,  k = radius/rod

    where r is the rod's share; its derivatives follow by Leibniz' rule. k = 0 is the harmonic law.
    """

    ratio: float
    x = np.array([0.0, 1.0])

    def __post_init__(self):
        if not 0 <= self.ratio < 1:
            raise ValueError(f"radius/rod must lie in [0, 1), got {self.ratio!r}; the rod is longer than the crank")

    def __call__(self, z, nu=0):
        """Derivative of order `nu` at z."""
        psi = np.pi * np.asarray(z, float)
        cosine = np.sin(psi / 2) ** 2 if nu == 0 else -np.cos(psi + nu * np.pi / 2) / 2
        return np.pi**nu * (cosine + self._rod(psi, nu))

    def _rod(self, psi, nu):
        """Derivative of order `nu` of r by psi."""
        k = self.ratio
        q = np.sqrt(1 - (k * np.sin(psi)) ** 2)  # = 1 - 2 k r
        r = [k * np.sin(psi) ** 2 / (2 * (1 + q))]
        for n in range(1, nu + 1):
            mixed = sum(math.comb(n, j) * r[j] * r[n - j] for j in range(1, n))
            r.append(k * (mixed - 2**n * np.cos(2 * psi + n * np.pi / 2) / 8) / q)
        return r[nu]


def _crank(shape):
    if shape.rod_ratio is None:
        raise ValueError("the law 'crank' needs `rod_length`, got None; give the connecting rod's length in m")
    return CrankCurve(shape.rod_ratio)


def _steady(order, start, end):
    return lambda shape: with_steady_part(order, start, end, shape)


# Order, what is given where the run-up leaves rest, what is given where it meets the constant speed. The position
# there is free, so its natural condition joins unless the given ones fill all n places.
LAWS = MappingProxyType(
    {
        "constant-velocity": Law(lambda shape: point_to_point(1), "D 2.1"),
        "cubic": Law(lambda shape: point_to_point(2), "D 2.2"),
        "quintic": Law(lambda shape: point_to_point(3), "D 2.3"),
        "septic": Law(lambda shape: point_to_point(4), "D 2.4"),
        "complex": Law(lambda shape: ComplexLaw(shape.energy_weight, shape.acceleration_weight), "D 2.5"),
        "combined-2": Law(_steady(2, {1: 0}, {1: 1, 2: 0}), "D 2.6"),
        "combined-3": Law(_steady(3, {1: 0, 2: 0}, {1: 1, 2: 0, 3: 0}), "D 2.7"),
        "combined-4": Law(_steady(4, {1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0, 4: 0}), "D 2.8"),
        "reversal-2": Law(_steady(2, {1: 0}, {1: 1}), "D 3.1"),
        "reversal-3": Law(_steady(3, {1: 0, 2: 0}, {1: 1, 2: 0}), "D 3.2"),
        "reversal-4": Law(_steady(4, {1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 3.3, A"),
        "reversal-3-free-acceleration": Law(_steady(3, {1: 0}, {1: 1, 2: 0}), "D 4.1"),
        "reversal-4-free-acceleration": Law(_steady(4, {1: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 4.2"),
        # Free jerk at the turn: brake and start share it, and reversing time turns it into minus itself, so it is 0.
        "reversal-4-free-jerk": Law(_steady(4, {1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 4.3"),
        "reversal-4-free-both": Law(_steady(4, {1: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 4.4, B"),
        "crank": Law(_crank, "crank and connecting rod, uniform rotation; C", retraces=True),
        "gear-sector": Law(lambda shape: point_to_point(1), "gear sector: constant speed, shock at both ends; D 1.5"),
        "parabolic": Law(lambda shape: parabolic(), "constant acceleration; D 1.5"),
        "harmonic": Law(lambda shape: harmonic(), "simple harmonic; VDI 2143, D 1.5"),
        "cycloidal": Law(lambda shape: cycloidal(), "VDI 2143, D 1.5"),
        "modified-trapezoid": Law(lambda shape: modified_trapezoid(), "VDI 2143, D 1.5"),
    }
)
