"""A shaft with carts, its motor and its belt: torque of each and speed over one revolution.

Any object with `torque(speed)` and `no_load_speed` is a torque curve. The belt stretches under its tension and
therefore creeps:

    w_g = w (1 - T/C),   C = r E A,   |T| <= 2 r F0 (e^(mu alpha) - 1)/(e^(mu alpha) + 1)

w is the speed of the motor, w_g its speed without creep, T the torque on the motor pulley of radius r. The tensions of
the two strands differ by T/r, and their sum remains twice the preload F0. The belt enters each pulley with the strain
of one strand and leaves it with that of the other; the mass flow is equal, so the speeds are in the ratio of
1 + strain, to first order. The torque is conserved and the power T (w - w_g) is lost. Beyond Eytelwein's limit, with
friction mu over the angle of wrap alpha, the belt slips. Mass and transient strain of the belt are neglected.

The torque of identical carts, of which one revolution is one cycle of the law, is

    x(phi) = y(T phi/2 pi),   torque = sum over carts of H x'(phi)

H is the drive force of each cart at v = x' phi' and a = x'' phi'^2 + x' phi'' (`cart.balance`). The speed is solved by
spectral elements over the angle, periodic or from an initial speed:

    dE/dphi = phi'',   E = phi'^2/2,   residual(phi, E, phi'') = 0 at each angle

The shaft angle is the independent variable. The joins of the motion laws and the dead centres are therefore known
boundaries of elements, and the periodic regime is a linear condition. Newton's method eliminates each element for the
change of E at its start, propagates that change over the elements and closes the revolution. Elements are bisected
until the last Chebyshev coefficients of E fall below the tolerance.

References
----------
J. A. Eytelwein, Handbuch der Statik fester Koerper, Berlin 1808. O. Reynolds, The Engineer 38 (1874) 396: creep.
M. Kloss, Archiv fuer Elektrotechnik 5 (1916) 59: induction motor.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import spsolve

from compact.machine import rigid_drive
from compact.machine.cart import Cart, Resistance
from compact.motion.profile import Cycle
from compact.numerics import Array
from compact.numerics.piecewise import clenshaw_curtis, find_maximum, interior_grid
from compact.numerics.validation import require_positive

ORDER = 16  # [-], of the polynomial on an element
NODES, WEIGHTS = clenshaw_curtis(ORDER + 1)
DIFFERENTIATION = np.linalg.solve(
    chebyshev.chebvander(2 * NODES - 1, ORDER).T,
    np.array([2 * chebyshev.chebval(2 * NODES - 1, chebyshev.chebder(row)) for row in np.eye(ORDER + 1)]),
).T  # nodal values to nodal derivatives on a unit element
INTEGRATION = np.linalg.inv(DIFFERENTIATION[1:, 1:])  # nodal values after the first to integrals from the start
TO_CHEBYSHEV = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, ORDER))
ENERGY_TOLERANCE = 1e-9  # [-], of E, relative to its largest value
END_INSET = 1e-13  # [rad]; the ends of an element are evaluated from inside
NEWTON_ITERATIONS = 60  # [-], of Newton's method; 4 to 8 are usual
NEWTON_TOLERANCE = 1e-12  # [-], of the largest E; change at convergence
MIN_ENERGY_RATIO = 0.2  # [-], of E; a Newton step reduces E no further
MAX_ENERGY_RATIO = 1e12  # [-], energy over its first guess, beyond which Newton steps diverge
RESIDUAL_PERTURBATION = 1e-7  # [-], relative; finite differences of the residual
MAX_ELEMENTS = 20_000  # [-]; dozens are usual, the number doubles in each refinement of a noisy torque
MAX_REFINEMENTS = 30  # [-]; 2 to 5 are usual, more for a steep motor curve and little inertia
DIVERGED = "the speed of the shaft did not converge: Newton steps diverge; use a stronger motor or more inertia"

MAX_BELT_CREEP = 0.1  # [-], at the slip limit; the first order in the strain is not sufficient beyond
BELT_ITERATIONS = 50  # [-], of Newton's method; 3 to 5 are usual
SPEED_TOLERANCE = 1e-14  # [-], of the largest speed; change at convergence
SPEED_PERTURBATION = 1e-7  # [-], relative; finite difference of the torque
RIGID = rigid_drive.Rigid()

Residual = Callable[[Array, Array, Array], Array]


class TorqueCurve(Protocol):
    """Torque of a motor over its speed."""

    @property
    def no_load_speed(self) -> float:
        """Speed without load [rad/s]."""

    def torque(self, speed: Array) -> Array:
        """Return the torque [N m] at speeds [rad/s]."""


@dataclass(frozen=True)
class LinearTorqueCurve:
    """Direct-current motor: T = stall_torque (1 - w/no_load_speed).

    Parameters
    ----------
    stall_torque : float
        Torque at rest [N m].
    no_load_speed : float
        Speed without load [rad/s].
    """

    stall_torque: float
    no_load_speed: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def torque(self, speed: Array) -> Array:
        """Return T [N m] at speeds of the motor [rad/s]."""
        return self.stall_torque * (1 - speed / self.no_load_speed)


@dataclass(frozen=True)
class Kloss:
    """Induction motor by the formula of Kloss, without stator resistance: T = 2 T_b/(s/s_b + s_b/s), s = 1 - w/w_s.

    Parameters
    ----------
    breakdown_torque : float
        T_b [N m].
    breakdown_slip : float
        s_b [-].
    synchronous_speed : float
        w_s [rad/s].

    Examples
    --------
    >>> f"{Kloss(50.0, 0.2, 157.0).torque(0.8 * 157.0):.1f} N m"
    '50.0 N m'
    """

    breakdown_torque: float
    breakdown_slip: float
    synchronous_speed: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    @property
    def no_load_speed(self) -> float:
        """Synchronous speed w_s [rad/s]."""
        return self.synchronous_speed

    def torque(self, speed: Array) -> Array:
        """Return T [N m] at speeds of the motor [rad/s], negative above w_s."""
        slip = 1 - speed / self.synchronous_speed
        return 2 * self.breakdown_torque * slip * self.breakdown_slip / (slip**2 + self.breakdown_slip**2)


@dataclass(frozen=True)
class Belt:
    """Flat belt.

    Parameters
    ----------
    pulley_radius : float
        r of the motor pulley [m].
    stiffness, preload : float
        E A, force over strain, and F0, tension of both strands at rest [N].
    friction, wrap : float
        mu [-] and alpha of the smaller pulley [rad].

    Examples
    --------
    >>> belt = Belt(pulley_radius=0.1, stiffness=50e3, preload=500.0, friction=0.4, wrap=3.0)
    >>> f"slips beyond {belt.slip_torque:.1f} N m, with a creep of {belt.slip_torque / belt.creep_torque:.2%}"
    'slips beyond 53.7 N m, with a creep of 1.07%'
    """

    pulley_radius: float
    stiffness: float
    preload: float
    friction: float
    wrap: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))
        creep = self.slip_torque / self.creep_torque
        if creep > MAX_BELT_CREEP:
            raise ValueError(
                f"`stiffness` {self.stiffness:g} N is too low for the `preload` {self.preload:g} N: the belt would "
                f"creep by {creep:.2g} before it slips, allowed are {MAX_BELT_CREEP:g}; use a stiffer belt"
            )

    @property
    def creep_torque(self) -> float:
        """Torque C for a creep of 1 [N m]; the creep is T/C."""
        return self.pulley_radius * self.stiffness

    @property
    def slip_torque(self) -> float:
        """Largest |T| on the motor pulley without slip [N m]."""
        return 2 * self.pulley_radius * self.preload * math.tanh(self.friction * self.wrap / 2)

    def required_preload(self, torque: float) -> float:
        """Smallest F0 [N] that transmits a torque [N m] without slip."""
        return abs(torque) / (2 * self.pulley_radius * math.tanh(self.friction * self.wrap / 2))

    def motor_speed(self, belt_torque: Callable[[Array], Array], speed: Array) -> Array:
        """Solve the speed w [rad/s] for the torque on the pulley [N m] over w and the speed w_g without creep.

        w (1 - belt_torque(w)/C) = w_g
        """
        C, geared = self.creep_torque, np.asarray(speed, float)
        w, step = geared, SPEED_PERTURBATION * (np.abs(geared) + np.abs(geared).max())
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(BELT_ITERATIONS):
                residual = w * (1 - belt_torque(w) / C) - geared
                slope = (w + step) * (1 - belt_torque(w + step) / C) - geared - residual
                change = np.where(residual == 0, 0.0, -residual * step / slope)
                w = w + change
                if np.all(np.abs(change) <= SPEED_TOLERANCE * np.abs(w).max()) and np.all(np.isfinite(w)):
                    return w
        raise RuntimeError(
            f"the speed of the motor behind its belt did not converge, last change {np.abs(change).max():g} rad/s; use "
            "a stiffer belt"
        )


@dataclass(frozen=True)
class CartsOnShaft:
    """Identical carts on one shaft.

    Parameters
    ----------
    cycle : Cycle
        Law; its period is that of one revolution at uniform speed.
    resistance : callable
        Force of the mix on one cart [N] of velocity [m/s] and acceleration [m/s^2].
    angles : tuple of float
        Lead of each cart over the shaft [rad].
    rod : Rigid or Crank
        Rigid for a cam.
    """

    cart: Cart
    cycle: Cycle
    resistance: Resistance
    angles: tuple[float, ...] = (0.0,)
    rod: rigid_drive.Rigid | rigid_drive.Crank = RIGID

    def breaks(self) -> Array:
        """Angles in [0, 2 pi] at joins of the law and spring contacts of any cart, ends included [rad]."""
        rate = 2 * np.pi / self.cycle.period
        joins = [rate * (leg.start + leg.duration * self.dynamics.breaks(leg)) for leg in self.cycle.legs()]
        return rigid_drive.revolution_breaks(np.subtract.outer(np.concatenate(joins), self.angles))

    def states_at(
        self, angle: Array, energy: Array, acceleration: Array, jerk: Array | float = 0.0
    ) -> list[rigid_drive.DriveState]:
        """Solve motion and forces of each cart at angles [rad], shape (pieces, n).

        Energy is phi'^2/2 [1/s^2], acceleration phi'' [rad/s^2] and jerk the third derivative [rad/s^3].
        """
        return [self._cart_state(np.mod(angle + lead, 2 * np.pi), energy, acceleration, jerk) for lead in self.angles]

    def uniform_states(self, angle: Array) -> list[rigid_drive.DriveState]:
        """Solve motion and forces of each cart at angles [rad] of a shaft at uniform speed, one revolution a cycle."""
        speed = 2 * np.pi / self.cycle.period
        return self.states_at(angle, np.full(angle.shape, speed**2 / 2), np.zeros(angle.shape))

    def _cart_state(self, angle, energy, acceleration, jerk):
        """Motion and forces of a cart at its own angle [rad]."""
        x, slope, curvature, third = self.travel(angle)
        speed = np.sqrt(2 * energy)
        velocity, cart_acceleration = slope * speed, curvature * 2 * energy + slope * acceleration
        direction = np.sign(slope.mean(axis=-1, keepdims=True))
        tangent = self.rod.rod_tangent(angle / (2 * np.pi) * self.cycle.period, self.cycle.period)
        cart_jerk = third * speed**3 + 3 * curvature * speed * acceleration + slope * jerk
        side = None if self.cart.end_springs is None else self._zones.side_at(angle)
        motion = x, velocity, cart_acceleration, cart_jerk
        return self.dynamics.solve(motion, direction, tangent, side)

    @cached_property
    def dynamics(self) -> rigid_drive.InverseDynamics:
        """Inverse dynamics of one cart on the shaft at uniform speed."""
        return rigid_drive.InverseDynamics(self.cart, self.rod, self.cycle, self.resistance)

    @cached_property
    def _zones(self):
        """Zones of the end springs over the angle."""
        return self.cart.end_springs.zones(lambda angle: self.travel(angle)[0], [0.0, np.pi, 2 * np.pi])

    def travel(self, angle: Array) -> list[Array]:
        """Return x [m] and its first three derivatives with respect to the angle [m/rad^k], angle in [0, 2 pi)."""
        rate = self.cycle.period / (2 * np.pi)
        return [self.cycle.derivative(angle * rate, order) * rate**order for order in range(4)]

    def torque(self, angle: Array, energy: Array, acceleration: Array) -> Array:
        """Return the torque of all carts, sum of H x' [N m].

        Parameters
        ----------
        angle : ndarray, shape (pieces, n)
            Angle of the shaft [rad].
        energy, acceleration : ndarray
            phi'^2/2 [1/s^2] and phi'' [rad/s^2] there.

        Returns
        -------
        ndarray
            Torque [N m].
        """
        states = self.states_at(angle, energy, acceleration)
        return sum(state.forces.drive_force * state.velocity for state in states) / np.sqrt(2 * energy)


@dataclass(frozen=True)
class ShaftRevolution:
    """Speed of a shaft over one revolution, one row per element.

    Parameters
    ----------
    breaks : ndarray, shape (n + 1,)
        Ends of the elements [rad].
    angle, energy, acceleration : ndarray, shape (n, ORDER + 1)
        phi [rad], E [1/s^2] and phi'' [rad/s^2] at the nodes.
    """

    breaks: Array
    angle: Array
    energy: Array
    acceleration: Array

    @property
    def speed(self) -> Array:
        """Speed phi' at the nodes [rad/s]."""
        return np.sqrt(2 * self.energy)

    @property
    def jerk(self) -> Array:
        """Third derivative of phi with respect to time at the nodes [rad/s^3]."""
        return self.acceleration @ DIFFERENTIATION.T / np.diff(self.breaks)[:, None] * self.speed

    @property
    def weights(self) -> Array:
        """Quadrature weights over time [s]."""
        return np.diff(self.breaks)[:, None] * WEIGHTS / self.speed

    @property
    def time(self) -> Array:
        """Time since the start of the revolution at the nodes [s]."""
        slowness, width = 1 / self.speed, np.diff(self.breaks)[:, None]
        within = np.concatenate([np.zeros_like(width), width * (slowness[:, 1:] @ INTEGRATION.T)], axis=1)
        starts = np.concatenate([[0.0], np.cumsum(within[:-1, -1])])
        return starts[:, None] + within

    @cached_property
    def energy_range(self) -> tuple[float, float]:
        """Smallest and largest E [1/s^2], also between the nodes."""
        grid = interior_grid(self.breaks)
        least = -find_maximum(lambda angle: -self.evaluate(angle)[0], grid)[0]
        return least, find_maximum(lambda angle: self.evaluate(angle)[0], grid)[0]

    def evaluate(self, angle: Array) -> tuple[Array, Array, Array]:
        """E [1/s^2], phi'' [rad/s^2] and the third derivative [rad/s^3] at angles in [0, 2 pi] of any shape."""
        i = np.clip(np.searchsorted(self.breaks, angle, side="right") - 1, 0, len(self.angle) - 1)
        place = 2 * (angle - self.breaks[i]) / np.diff(self.breaks)[i] - 1
        polynomials = chebyshev.chebvander(place, ORDER)
        energy, acceleration, jerk = (
            np.sum(polynomials * (values @ TO_CHEBYSHEV.T)[i], axis=-1)
            for values in (self.energy, self.acceleration, self.jerk)
        )
        return energy, acceleration, jerk


def solve_shaft_speed(residual: Residual, breaks: ArrayLike, speed: float, *, periodic: bool) -> ShaftRevolution:
    """Solve the speed of a shaft over its angle.

    Parameters
    ----------
    residual : callable
        Residual torque of (angle, E, phi''), arrays of shape (n, ORDER + 1), smooth between the breaks. Any unit.
    breaks : array_like, shape (n + 1,)
        Angles between which the residual is smooth [rad].
    speed : float
        Initial speed, or a first guess of it in the periodic regime [rad/s].
    periodic : bool
        Solve the periodic regime.
    """
    breaks = np.asarray(breaks, float)
    for _ in range(MAX_REFINEMENTS):
        width = np.diff(breaks)[:, None]
        energy = np.full((len(width), ORDER + 1), speed**2 / 2)
        angle = np.clip(breaks[:-1, None] + width * NODES, breaks[:-1, None] + END_INSET, breaks[1:, None] - END_INSET)
        energy = _solve_elements(residual, angle, width, energy, periodic)
        coefficients = np.abs(energy @ TO_CHEBYSHEV.T)
        unresolved = coefficients[:, -2:].max(axis=1) > ENERGY_TOLERANCE * energy.max()
        if not unresolved.any():
            return ShaftRevolution(breaks, angle, energy, energy @ DIFFERENTIATION.T / width)
        middles = (breaks[:-1] + breaks[1:])[unresolved] / 2
        if len(breaks) + len(middles) > MAX_ELEMENTS:
            break
        breaks = np.sort(np.append(breaks, middles))
    raise RuntimeError(
        f"the speed of the shaft is not resolved by {len(breaks) - 1} elements; use a torque curve and a resistance "
        "that are smooth in speed"
    )


def _solve_elements(residual, angle, width, energy, periodic):
    """Solve for E at the nodes by Newton's method."""
    largest = MAX_ENERGY_RATIO * energy.max()
    for _ in range(NEWTON_ITERATIONS):
        try:
            with np.errstate(over="raise"):
                change = _newton_step(residual, angle, width, energy, periodic)
        except (FloatingPointError, np.linalg.LinAlgError) as error:  # how far a diverging step goes hangs on rounding
            raise RuntimeError(DIVERGED) from error
        largest_fall = np.max(-change / energy, initial=1 - MIN_ENERGY_RATIO)
        energy = energy + (1 - MIN_ENERGY_RATIO) / largest_fall * change
        if np.abs(change).max() <= NEWTON_TOLERANCE * energy.max():
            return energy
        if energy.max() > largest:
            raise RuntimeError(DIVERGED)
    slowest = np.unravel_index(energy.argmin(), energy.shape)
    raise RuntimeError(
        f"the speed of the shaft did not converge in {NEWTON_ITERATIONS} Newton steps: it falls to "
        f"{np.sqrt(2 * energy[slowest]):g} rad/s at {angle[slowest]:g} rad; use a stronger motor or more inertia"
    )


def _newton_step(residual, angle, width, energy, periodic):
    """Change of E at the nodes by one Newton step."""
    acceleration = energy @ DIFFERENTIATION.T / width
    here = residual(angle, energy, acceleration)
    step = RESIDUAL_PERTURBATION * energy
    by_energy = (residual(angle, energy + step, acceleration) - here) / step
    step = RESIDUAL_PERTURBATION * (np.abs(acceleration) + energy.max())
    by_acceleration = (residual(angle, energy, acceleration + step) - here) / step
    matrix = by_acceleration[:, :, None] * DIFFERENTIATION / width[:, :, None]
    matrix[:, np.arange(ORDER + 1), np.arange(ORDER + 1)] += by_energy
    right = np.stack([-here[:, 1:], -matrix[:, 1:, 0]], axis=-1)
    particular, propagation = np.moveaxis(np.linalg.solve(matrix[:, 1:, 1:], right), -1, 0)
    # s at the starts of the elements closes the jumps of E: s_(i+1) = particular_i + propagation_i s_i - gap_(i+1)
    gaps = energy[:, 0] - np.roll(energy[:, -1], 1)
    right, before = np.roll(particular[:, -1], 1) - gaps, np.roll(propagation[:, -1], 1)
    if not periodic:
        right[0] = before[0] = 0.0
    rows = np.arange(len(right))
    columns = np.concatenate([rows, np.roll(rows, 1)])
    starts = spsolve(sparse.csc_array((np.append(np.ones(len(rows)), -before), (np.tile(rows, 2), columns))), right)
    return np.concatenate([starts[:, None], particular + propagation * starts[:, None]], axis=1)
