"""One motor inside each roller of a cart without another drive: torque, rotation and creepage under a law.

    m a + W - n pull(v, T) + guide friction - end springs = 0,   W = resistance(v, a)
    pull(v, T) = F(v) - F(v, T),   phi' = (1 + creep(v, T)) v/R,   power = T phi'

n rollers of radius R carry the cart. F(v) is the resistance of the roller without torque at speed v, F(v, T) that of a
roller driven by the torque T. An engine with stick and slip computes both and the creepage (`DrivenRoller`). Without
such an engine, T = R pull and there is no creepage (`CreepFreeRoller`). T and pull are those of one roller, positive
along the travel. The height of the rollers does not depend on the torque, and the mix responds as in steady motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from compact.machine.cart import balance
from compact.machine.rigid_drive import DriveState, InverseDynamics
from compact.motion.profile import Cycle, Leg
from compact.numerics import Array
from compact.numerics.piecewise import BREAK_OFFSET, interior_grid
from compact.numerics.validation import require_fields, require_positive

FULL_SLIP_SHARE = 0.99  # [-], of the Coulomb limit; a roller beyond slides
GAUSS_RULE = np.polynomial.legendre.leggauss(4)
PIN_FORCE_TOLERANCE = 1e-12  # [-], of the forces; residual force at the pin
FRICTION_ITERATIONS = 60  # [-], of the guide friction; 3 to 5 are usual


def pull_range(dynamics: InverseDynamics, rollers: int) -> tuple[float, float]:
    """Smallest and largest pull [N] of one of the rollers along the travel, over a cycle of a rigid drive."""
    legs = [leg for leg in dynamics.cycle.legs() if leg.direction]
    states = [dynamics.state_at(leg, interior_grid(dynamics.breaks(leg))) for leg in legs]
    pulls = [
        leg.direction * _total_pull(dynamics, state, leg.direction) for leg, state in zip(legs, states, strict=True)
    ]
    return min(float(pull.min()) for pull in pulls) / rollers, max(float(pull.max()) for pull in pulls) / rollers


class RollerTraction(NamedTuple):
    """Traction of one roller; arrays of one shape.

    Parameters
    ----------
    torque : ndarray
        T [N m].
    traction, share, creep : ndarray
        Traction coefficient T/(R P), traction over the Coulomb limit, and creepage [-].
    """

    torque: Array
    traction: Array
    share: Array
    creep: Array


def carter_parameter(share: Array) -> Array:
    """Carter's parameter w = sign(u) (1 - sqrt(1 - |u|)) of a share u of the Coulomb limit [-].

    The creepage on a half-plane is linear in w.

    References
    ----------
    F. W. Carter, Proc. R. Soc. A 112 (1926) 151; K. L. Johnson, Contact Mechanics, CUP 1985, section 8.3.
    """
    return np.sign(share) * (1 - np.sqrt(1 - np.minimum(np.abs(share), 1)))


@dataclass(frozen=True)
class CreepFreeRoller:
    """Roller of an engine without torque: T = R pull, no creepage.

    Parameters
    ----------
    radius, load, friction : float
        R [m], load P of the mix [N], and Coulomb coefficient of mix on steel [-].
    """

    radius: float
    load: float
    friction: float

    has_creep = False

    def __post_init__(self) -> None:
        require_fields(self, positive="radius load", nonnegative="friction")

    def __call__(self, _speed: Array, pull: Array) -> RollerTraction:
        """Return the traction for pulls [N]."""
        traction = pull / self.load
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(traction == 0, 0.0, traction / self.friction)
        return RollerTraction(self.radius * pull, traction, share, np.zeros(np.shape(pull)))


@dataclass(frozen=True, eq=False)
class DrivenRoller:
    """Roller driven by its motor, interpolated between contact solutions; pull and creepage increase with the torque.

    Between torques the torque is monotone over the pull and the creepage over `carter_parameter`; between speeds both
    are linear in ln v. Below the slowest speed they are constant, as the creepage of a relaxed layer is. Beyond the
    last torque T increases by R times the pull. Beyond the Coulomb limit there is no creepage (nan).

    Parameters
    ----------
    radius : float
        R [m].
    friction : float
        Coulomb coefficient of mix on steel [-].
    speeds : ndarray, shape (k,)
        Ascending speeds [m/s].
    torques, pulls : ndarray, shape (k, m)
        Ascending torques T [N m] and F(v) - F(v, T) [N].
    creeps, loads : ndarray, shape (k, m)
        Creepage [-] and load P of the mix [N].
    """

    radius: float
    friction: float
    speeds: Array
    torques: Array
    pulls: Array
    creeps: Array
    loads: Array

    has_creep = True

    def __post_init__(self) -> None:
        require_positive(radius=self.radius, friction=self.friction, speeds=self.speeds, loads=self.loads)
        for name in ("torques", "pulls", "creeps"):
            if np.any(np.diff(getattr(self, name)) <= 0):
                raise ValueError(f"`{name}` must increase with the torque at every speed, got {getattr(self, name)}")

    def __call__(self, speed: Array, pull: Array) -> RollerTraction:
        """Interpolate the traction at speeds >= 0 [m/s] for pulls [N]."""
        speed, pull = np.broadcast_arrays(speed, pull)
        place = np.log(np.maximum(speed, self.speeds[0]))
        weights = np.array([np.interp(place, np.log(self.speeds), row) for row in np.eye(len(self.speeds))])
        by_pull, by_share = self._curves
        torque = np.sum(weights * [curve(pull) for curve in by_pull], axis=0)
        load = np.sum(weights * [np.interp(torque, *row) for row in zip(self.torques, self.loads, strict=True)], axis=0)
        traction = torque / (self.radius * load)
        share = traction / self.friction
        creep = np.sum(weights * [curve(carter_parameter(share)) for curve in by_share], axis=0)
        return RollerTraction(torque, traction, share, np.where(np.abs(share) <= FULL_SLIP_SHARE, creep, np.nan))

    @cached_property
    def _curves(self):
        """Return the curves T(pull) and creep(w) at each speed; the latter is constant beyond the samples."""
        w = carter_parameter(self.torques / (self.friction * self.radius * self.loads))
        torques = [_monotone_curve(*row, self.radius) for row in zip(self.pulls, self.torques, strict=True)]
        return torques, [_monotone_curve(*row, 0.0) for row in zip(w, self.creeps, strict=True)]


@dataclass(frozen=True)
class RollerMotor:
    """Identical motors of one cart under one law.

    Parameters
    ----------
    rollers : int
        n.
    """

    dynamics: InverseDynamics
    roller: CreepFreeRoller | DrivenRoller
    rollers: int

    def traction_at(self, leg: Leg, state: DriveState) -> tuple[Array, RollerTraction]:
        """Solve velocity [m/s] and traction for a state of a leg; torque and traction are positive along x."""
        way = leg.direction
        if way == 0:
            return state.velocity, RollerTraction(*np.zeros((4, *state.velocity.shape)))
        roller = self.roller(np.abs(state.velocity), way * _total_pull(self.dynamics, state, way) / self.rollers)
        return state.velocity, RollerTraction(way * roller.torque, way * roller.traction, roller.share, roller.creep)

    def traction_over(self, time: ArrayLike) -> tuple[Array, RollerTraction]:
        """Solve velocity [m/s] and traction at times of the cycle [s] of any shape."""
        time = np.asarray(time, float)
        columns = np.zeros((5, *time.shape))
        for leg in self.dynamics.cycle.legs():
            phase = (time - leg.start) / leg.duration
            within = (phase >= 0) & (phase <= 1)
            state = self.dynamics.state_at(leg, np.clip(phase[within], BREAK_OFFSET, 1 - BREAK_OFFSET))
            velocity, traction = self.traction_at(leg, state)
            columns[:, within] = velocity, *traction
        return columns[0], RollerTraction(*columns[1:])

    def angle(self, time: Array) -> Array:
        """Integrate phi [rad] over ascending times of the cycle [s] from the first one; nan after sliding."""
        nodes, weights = GAUSS_RULE
        half = np.diff(time)[:, None] / 2
        velocity, traction = self.traction_over(time[:-1, None] + half * (1 + nodes))
        slipped = np.cumsum(np.sum(half * weights * traction.creep * velocity, axis=1))
        travel = self.dynamics.cycle.derivative(time, 0)
        return (travel - travel[0] + np.append(0.0, slipped)) / self.roller.radius

    def angular_velocity(self, time: ArrayLike) -> Array:
        """Return phi' [rad/s] at times of the cycle [s]."""
        velocity, traction = self.traction_over(time)
        return (1 + traction.creep) * velocity / self.roller.radius

    @cached_property
    def share(self) -> float:
        """Largest traction over the Coulomb limit [-]."""
        return self._largest(lambda _, traction: traction.share)

    @property
    def lack(self) -> str:
        """Quantity of the drive that is insufficient for the law; empty for a sufficient drive."""
        if any(join.order == 1 for join in self.dynamics.cycle.discontinuities()):
            return "force: the velocity jumps"
        limit = FULL_SLIP_SHARE if self.roller.has_creep else 1.0
        return f"friction: {self.share:.3g} of the Coulomb limit" if self.share > limit else ""

    @cached_property
    def peak_torque(self) -> float:
        """Largest |T| of one motor [N m]; infinite for a law that the motors cannot follow."""
        return inf if self.lack else self._largest(lambda _, traction: traction.torque)

    @cached_property
    def peak_power(self) -> float:
        """Largest |T phi'| of one motor [W]; infinite for a law that the motors cannot follow."""
        return inf if self.lack else self._largest(self._motor_power)

    @cached_property
    def peak_creep(self) -> float:
        """Largest |creepage| [-]; infinite for a law that the motors cannot follow, nan without a creepage model."""
        if not self.roller.has_creep:
            return np.nan
        return inf if self.lack else self._largest(lambda _, traction: traction.creep)

    def power(self, time: ArrayLike) -> Array:
        """Return T phi' of one motor [W] at times of the cycle [s]."""
        return self._motor_power(*self.traction_over(time))

    def _motor_power(self, velocity, traction):
        return traction.torque * (1 + traction.creep) * velocity / self.roller.radius

    def _largest(self, quantity: Callable[..., Array]) -> float:
        """Return the largest |quantity(velocity, traction)| over the cycle, also between samples."""
        return self.dynamics.largest(lambda leg, state: quantity(*self.traction_at(leg, state)))


def _total_pull(dynamics: InverseDynamics, state: DriveState, way: int) -> Array:
    """Pull of all rollers [N] along x for zero force at the pin, by fixed-point iteration on the guide friction."""
    forces, cart = state.forces, dynamics.cart
    end_force = cart.mass * state.acceleration + state.resistance + forces.guide_friction - forces.drive_force
    scale = np.max(np.abs(forces.drive_force), initial=0.0) + np.max(np.abs(state.resistance), initial=0.0)
    pull = forces.drive_force
    for _ in range(FRICTION_ITERATIONS):
        moved = state.acceleration, state.resistance - pull
        residual = balance(cart, *moved, way, 0.0, end_force, state.load_share).drive_force
        pull = pull + residual
        if np.all(np.abs(residual) <= PIN_FORCE_TOLERANCE * scale):
            return pull
    raise RuntimeError(
        f"the guide wheels lock the cart under '{dynamics.cycle.forward.name}': the residual force at the pin is "
        f"{np.abs(residual).max():g} N after {FRICTION_ITERATIONS} iterations; use less `guide_friction`"
    )


def _monotone_curve(x: Array, y: Array, slope: float) -> Callable[..., Array]:
    """Monotone interpolation of ascending samples, extrapolated from both ends with a slope."""
    curve = PchipInterpolator(x, y)

    def value(place: Array) -> Array:
        within = np.clip(place, x[0], x[-1])
        return curve(within) + slope * (place - within)

    return value


def roller_rotation(cycle: Cycle, roller_radius: float, time: ArrayLike) -> list[Array]:
    """Rotation of a motor inside a roller of a radius [m] that rolls without slip, x/R, at times of the cycle [s].

    Returns angle [rad] and its first three derivatives [rad/s], [rad/s^2] and [rad/s^3], of the shape of `time`.

    References
    ----------
    Paper B, eqs (44)-(52), with the signs and the scale of reference/errata.md B-7, B-8.

    Examples
    --------
    >>> from compact.motion.profile import law
    >>> cycle = Cycle(law("reversal-4-free-both", 0.4, 3.0))
    >>> _, speed, *_ = roller_rotation(cycle, roller_radius=0.11, time=[1.5, 4.5])
    >>> speed.round(4).tolist()
    [1.3531, -1.3531]
    """
    require_positive(roller_radius=roller_radius)
    return [cycle.derivative(np.asarray(time, float), order) / roller_radius for order in range(4)]
