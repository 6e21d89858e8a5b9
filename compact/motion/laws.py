"""Motion laws as normalised curves s(z), s(0) = 0, s(1) = 1, and the table LAWS of the laws by name.

The phase is z = t/T. Curves follow the protocol of scipy's PPoly (`NormalisedCurve`), which most laws are. Section
numbers are those of the monograph D.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from compact.motion.minimum_criterion import ComplexLaw, minimiser
from compact.numerics import Array
from compact.numerics.validation import require_between

# [-], of the duration: a shorter acceleration or deceleration phase is left out, its breakpoints coincide in rounding
SHORTEST_PHASE = 1e-12
SUM_TOLERANCE = 1e-12  # [-], of the sum of run_up and run_down


class NormalisedCurve(Protocol):
    """Law s(z), 0 <= z <= 1, as a callable of phase and order of derivative."""

    @property
    def x(self) -> Array:
        """Breakpoints between the pieces, both ends included [-]."""

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        """Return the derivative of order `nu` at phase z [-]."""


@dataclass(frozen=True)
class LawParameters:
    """Parameters of the laws; each law uses those that it needs.

    Attributes
    ----------
    run_up, run_down : float
        Duration of the acceleration and of the deceleration phase over that of the pass [-], >= 0 with a sum <= 1;
        combined and reversal laws.
    energy_weight, acceleration_weight : float
        Weights d1, d2 of the complex law [-].
    rod_ratio : float, optional
        Crank radius over rod length [-], 0 <= ratio < 1; crank.
    """

    run_up: float = 1 / 6
    run_down: float = 1 / 6
    energy_weight: float = 0.5
    acceleration_weight: float = 0.3
    rod_ratio: float | None = None

    def __post_init__(self) -> None:
        require_between(0, 1, run_up=self.run_up, run_down=self.run_down)
        if self.run_up + self.run_down > 1 + SUM_TOLERANCE:
            raise ValueError(f"`run_up` + `run_down` must not exceed 1, got {self.run_up!r} + {self.run_down!r}")


@dataclass(frozen=True)
class LawDefinition:
    """Entry of `LAWS`.

    Attributes
    ----------
    build : callable
        Returns the curve of a set of parameters.
    source : str
        Section of the source.
    retraces : bool
        True if the return stroke is the forward stroke reversed in time.
    """

    build: Callable[[LawParameters], NormalisedCurve]
    source: str
    retraces: bool = False


def point_to_point(order: int) -> PPoly:
    """Return the rest-to-rest law x^(2n) = 0 of order n (D 2.1-2.4): s^(k) = 0 for 0 < k < n at both ends."""
    rest = dict.fromkeys(range(1, order), 0)
    return piecewise([1.0], [minimiser(order, {0: 0} | rest, {0: 1} | rest)])


def with_constant_velocity(
    order: int, start: Mapping[int, float], end: Mapping[int, float], parameters: LawParameters
) -> PPoly:
    """Return a law of acceleration, constant velocity and deceleration, its mirror image (D 2.6-2.8, 3, 4).

    The acceleration phase is `minimiser(order, {x: 0} | start, end)` to unit velocity in unit time; with its travel A
    the velocity of the law is v = 1/(A run_up + 1 - run_up - run_down + A run_down).
    """
    run = minimiser(order, {0: 0} | dict(start), end)
    up, down = (share if share > SHORTEST_PHASE else 0.0 for share in (parameters.run_up, parameters.run_down))
    down = 1 - (1 - down)  # the width that remains after rounding of its breakpoint
    steady = max(0.0, 1 - up - down)
    speed = 1 / (run(1.0) * (up + down) + steady)
    pieces = []
    if up > 0:
        pieces.append((up, speed * up * run(Polynomial([0, 1 / up]))))
    if steady > SHORTEST_PHASE:
        pieces.append((steady, Polynomial([speed * up * run(1.0), speed])))
    if down > 0:
        pieces.append((down, 1 - speed * down * run(Polynomial([1, -1 / down]))))
    return piecewise([width for width, _ in pieces], [piece for _, piece in pieces])


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


def harmonic() -> SineCurve:
    """Return the simple harmonic law s = (1 - cos pi z)/2, whose acceleration is not zero at the ends."""
    return SineCurve(piecewise([1.0], [Polynomial([0.5])]), np.pi, (-0.5,), (np.pi / 2,))


def cycloidal() -> SineCurve:
    """Return the cycloidal law s = z - sin(2 pi z)/(2 pi)."""
    return SineCurve(piecewise([1.0], [Polynomial([0, 1])]), 2 * np.pi, (-1 / (2 * np.pi),), (0.0,))


def parabolic() -> PPoly:
    """Return the law of constant acceleration and deceleration: s'' = 4, then -4."""
    return piecewise([0.5, 0.5], [Polynomial([0, 0, 2]), Polynomial([0.5, 2, -2])])


def modified_trapezoid() -> SineCurve:
    """Return the modified trapezoidal law (VDI 2143; Norton, Cam Design and Manufacturing Handbook).

    Its acceleration is C sin 4 pi z (z < 1/8), C (1/8-3/8), C cos 4 pi (z - 3/8) (3/8-5/8), then antisymmetric;
    C = 8 pi/(2 + pi) = 4.8881 gives s(1) = 1.
    """
    c, w = 8 * np.pi / (2 + np.pi), 4 * np.pi
    # s'' = C sin(w z), C, C sin(w z - pi), -C, C sin(w z - 2 pi): sine part of s, and half the constant s''
    amplitudes, phases = (-c / w**2, 0, -c / w**2, 0, -c / w**2), (0, 0, -np.pi, 0, 0)
    widths, halves = (1 / 8, 1 / 4, 1 / 4, 1 / 4, 1 / 8), (0, c / 2, 0, -c / 2, 0)
    position, speed, start, pieces = 0.0, 0.0, 0.0, []
    for width, amplitude, phase, half in zip(widths, amplitudes, phases, halves, strict=True):
        at = [amplitude * w**k * math.sin(w * start + phase + k * math.pi / 2) for k in (0, 1)]
        piece = Polynomial([position - at[0], speed - at[1], half])
        pieces.append(piece)
        start += width
        position = piece(width) + amplitude * math.sin(w * start + phase)
        speed = piece.deriv()(width) + amplitude * w * math.cos(w * start + phase)
    return SineCurve(piecewise(widths, pieces), w, amplitudes, phases)


@dataclass(frozen=True)
class CrankCurve:
    """Half a turn of a slider-crank mechanism from the outer dead centre, at uniform angular velocity.

        s = (1 - cos psi)/2 + r,  r - k r^2 = (k/4) sin^2 psi,  psi = pi z,  k = radius/rod

    where r is due to the finite rod; its derivatives follow by the Leibniz rule. k = 0 is the harmonic law.

    Attributes
    ----------
    ratio : float
        Crank radius over rod length k [-], 0 <= k < 1.
    """

    ratio: float
    x = np.array([0.0, 1.0])

    def __post_init__(self) -> None:
        if not 0 <= self.ratio < 1:
            raise ValueError(
                f"crank radius over rod length must lie in [0, 1), got {self.ratio!r}; use a rod longer than the crank"
            )

    def __call__(self, z: ArrayLike, nu: int = 0) -> Array:
        """Return the derivative of order `nu` at phase z [-]."""
        psi = np.pi * np.asarray(z, float)
        infinite_rod = np.sin(psi / 2) ** 2 if nu == 0 else -np.cos(psi + nu * np.pi / 2) / 2
        return np.pi**nu * (infinite_rod + self._rod_term(psi, nu))

    def _rod_term(self, psi, nu):
        """Return the derivative of order `nu` of r with respect to psi."""
        k = self.ratio
        q = np.sqrt(1 - (k * np.sin(psi)) ** 2)  # = 1 - 2 k r
        r = [k * np.sin(psi) ** 2 / (2 * (1 + q))]
        for n in range(1, nu + 1):
            mixed = sum(math.comb(n, j) * r[j] * r[n - j] for j in range(1, n))
            r.append(k * (mixed - 2**n * np.cos(2 * psi + n * np.pi / 2) / 8) / q)
        return r[nu]


def _crank(parameters: LawParameters) -> CrankCurve:
    if parameters.rod_ratio is None:
        raise ValueError("the law 'crank' requires `rod_length`, got None; set the length of the connecting rod [m]")
    return CrankCurve(parameters.rod_ratio)


def _steady(order: int, start: Mapping[int, float], end: Mapping[int, float]) -> Callable[[LawParameters], PPoly]:
    return lambda parameters: with_constant_velocity(order, start, end, parameters)


# Arguments of `_steady`: order, derivatives prescribed at rest, and at the constant velocity. The position there is
# free: its natural condition is added unless n derivatives are prescribed.
#: Published motion laws by name, with the source of each.
LAWS: Mapping[str, LawDefinition] = MappingProxyType(
    {
        "constant-velocity": LawDefinition(lambda _: point_to_point(1), "D 2.1"),
        "cubic": LawDefinition(lambda _: point_to_point(2), "D 2.2"),
        "quintic": LawDefinition(lambda _: point_to_point(3), "D 2.3"),
        "septic": LawDefinition(lambda _: point_to_point(4), "D 2.4"),
        "complex": LawDefinition(lambda p: ComplexLaw(p.energy_weight, p.acceleration_weight), "D 2.5"),
        "combined-2": LawDefinition(_steady(2, {1: 0}, {1: 1, 2: 0}), "D 2.6"),
        "combined-3": LawDefinition(_steady(3, {1: 0, 2: 0}, {1: 1, 2: 0, 3: 0}), "D 2.7"),
        "combined-4": LawDefinition(_steady(4, {1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0, 4: 0}), "D 2.8"),
        "reversal-2": LawDefinition(_steady(2, {1: 0}, {1: 1}), "D 3.1"),
        "reversal-3": LawDefinition(_steady(3, {1: 0, 2: 0}, {1: 1, 2: 0}), "D 3.2"),
        "reversal-4": LawDefinition(_steady(4, {1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 3.3, A"),
        "reversal-3-free-acceleration": LawDefinition(_steady(3, {1: 0}, {1: 1, 2: 0}), "D 4.1"),
        "reversal-4-free-acceleration": LawDefinition(_steady(4, {1: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 4.2"),
        # The free jerk at the reversal is shared by deceleration and acceleration and odd in time, hence zero.
        "reversal-4-free-jerk": LawDefinition(_steady(4, {1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 4.3"),
        "reversal-4-free-both": LawDefinition(_steady(4, {1: 0, 3: 0}, {1: 1, 2: 0, 3: 0}), "D 4.4, B"),
        "crank": LawDefinition(_crank, "crank and connecting rod, uniform rotation; C", retraces=True),
        "gear-sector": LawDefinition(lambda _: point_to_point(1), "gear sector: constant speed with shocks; D 1.5"),
        "parabolic": LawDefinition(lambda _: parabolic(), "constant acceleration; D 1.5"),
        "harmonic": LawDefinition(lambda _: harmonic(), "simple harmonic; VDI 2143, D 1.5"),
        "cycloidal": LawDefinition(lambda _: cycloidal(), "VDI 2143, D 1.5"),
        "modified-trapezoid": LawDefinition(lambda _: modified_trapezoid(), "VDI 2143, D 1.5"),
    }
)
