"""A motor inside each roller of a cart that nothing else drives: its torque, its turn and its creep under a law.

    m a + W - n pull(v, T) + guide friction - end springs = 0,   W = resistance(v, a)
    pull(v, T) = F(v) - F(v, T),   phi' = (1 + creep(v, T)) v/R,   power = T phi'

n rollers of radius R carry the cart. F(v) is the resistance of the scene's own roller at speed v, F(v, T) that of one
driven by the torque T, which an engine that lets rollers stick and slip tells with its creep (`Driven`); an engine that
does not leaves T = R pull and no creep (`FirstOrder`). T and pull are those of one roller, and count along the travel.
The cart keeps its rollers at their height, whatever the torque. The mix answers as in steady motion.
"""

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from compact.machine.cart import balance
from compact.machine.rigid_drive import InverseDynamics
from compact.motion.profile import Cycle
from compact.numerics.piecewise import BREAK_OFFSET, find_maximum, interior_grid
from compact.numerics.validation import require_nonnegative, require_positive

HELD = 0.99  # of what friction holds, beyond which a roller counts as skidding
GAUSS = np.polynomial.legendre.leggauss(4)
FORCED = 1e-12  # of the forces, what may be left at the pin
TRIALS = 60  # of the guide friction; 3 to 5 are usual


def pulls(demand, rollers):
    """Least and largest pull [N] of one of the rollers along the travel, over the cycle of a `rigid_drive.Demand`."""
    found = []
    for leg in demand.cycle.legs():
        if leg.direction:
            state = demand.at(leg, interior_grid(demand.breaks(leg)))
            found.append(leg.direction * _pull(demand, state, leg.direction) / rollers)
    return min(float(pull.min()) for pull in found), max(float(pull.max()) for pull in found)


class Answer(NamedTuple):
    """Of one roller: torque T [N m], traction T/(R P) and its share of Coulomb's friction, creep; arrays of a shape."""

    torque: np.ndarray
    traction: np.ndarray
    share: np.ndarray
    creep: np.ndarray


def spent(share):
    """w = 1 - sqrt(1 - |u|), with the sign of the share u of friction: in it creep is a straight line on a half-plane.

    F. W. Carter, Proc. R. Soc. A 112 (1926) 151; K. L. Johnson, Contact Mechanics, CUP 1985, section 8.3.
    """
    return np.sign(share) * (1 - np.sqrt(1 - np.minimum(np.abs(share), 1)))


@dataclass(frozen=True)
class FirstOrder:
    """A roller of which no engine tells how a torque drives it: T = R pull, and no creep.

    radius : R [m];  load : P, of the mix on it [N];  friction : Coulomb's, of mix on steel
    """

    radius: float
    load: float
    friction: float

    tells_creep = False

    def __post_init__(self):
        require_positive(radius=self.radius, load=self.load)
        require_nonnegative(friction=self.friction)

    def __call__(self, speed, pull):
        """`Answer` at speeds [m/s] >= 0 to pulls [N]."""
        traction = pull / self.load
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(traction == 0, 0.0, traction / self.friction)
        return Answer(self.radius * pull, traction, share, np.zeros(np.shape(pull)))


@dataclass(frozen=True, eq=False)
class Driven:
    """A roller driven by its motor, sampled: pull and creep rise with the torque.

    radius : R [m];  friction : Coulomb's, of mix on steel
    speeds : rising [m/s], shape (k,);  torques : rising [N m];  pulls : F(v) - F(v, T) [N];  creeps : -
    loads : P of the mix [N];  all of these of shape (k, m)

    Between torques pull is taken monotone over T and creep over `spent` of T/(f R P), between speeds both are straight
    over ln v; below the slowest speed they stay, as creep of a relaxed layer does. Beyond the last torque T = R pull
    goes on, and there is no creep where friction does not hold.
    """

    radius: float
    friction: float
    speeds: np.ndarray
    torques: np.ndarray
    pulls: np.ndarray
    creeps: np.ndarray
    loads: np.ndarray

    tells_creep = True

    def __post_init__(self):
        require_positive(radius=self.radius, friction=self.friction, speeds=self.speeds, loads=self.loads)
        for name in ("torques", "pulls", "creeps"):
            if np.any(np.diff(getattr(self, name)) <= 0):
                raise ValueError(f"`{name}` must rise with the torque at every speed, got {getattr(self, name)}")

    def __call__(self, speed, pull):
        """`Answer` at speeds [m/s] >= 0 to pulls [N]."""
        speed, pull = np.broadcast_arrays(speed, pull)
        weights = self._weights(speed)
        torque = np.sum(weights * [by_pull(pull) for by_pull in self._torques], axis=0)
        load = np.sum(weights * [np.interp(torque, *row) for row in zip(self.torques, self.loads, strict=True)], axis=0)
        traction = torque / (self.radius * load)
        share = traction / self.friction
        creep = np.sum(weights * [by_share(spent(share)) for by_share in self._creeps], axis=0)
        return Answer(torque, traction, share, np.where(np.abs(share) <= HELD, creep, np.nan))

    def _weights(self, speed):
        """Of the sampled speeds at others, shape (k, ...)."""
        place = np.log(np.maximum(speed, self.speeds[0]))
        return np.array([np.interp(place, np.log(self.speeds), row) for row in np.eye(len(self.speeds))])

    @cached_property
    def _torques(self):
        """T(pull) at each speed."""
        return [_monotone(*row, self.radius) for row in zip(self.pulls, self.torques, strict=True)]

    @cached_property
    def _creeps(self):
        """creep(w) at each speed; what is asked beyond the samples is next to nothing."""
        w = spent(self.torques / (self.friction * self.radius * self.loads))
        return [_monotone(*row, 0.0) for row in zip(w, self.creeps, strict=True)]


@dataclass(frozen=True)
class RollerMotor:
    """The motors of one cart under one law, each as the others.

    demand : of a `Rigid` drive, which imposes the law;  roller : `Driven` or `FirstOrder`;  rollers : n
    """

    demand: InverseDynamics
    roller: FirstOrder | Driven
    rollers: int

    def at(self, leg, phase):
        """(velocity [m/s], `Answer`) at phases of a leg, ndarray; torque and traction + along x."""
        state = self.demand.at(leg, phase)
        way = leg.direction
        if way == 0:
            none = np.zeros(np.shape(phase))
            return none, Answer(none, none, none, none)
        answer = self.roller(np.abs(state.velocity), way * _pull(self.demand, state, way) / self.rollers)
        return state.velocity, Answer(way * answer.torque, way * answer.traction, answer.share, answer.creep)

    def over(self, time):
        """(velocity, `Answer`) at times of the cycle [s], any shape."""
        time = np.asarray(time, float)
        columns = np.zeros((5, *time.shape))
        for leg in self.demand.cycle.legs():
            phase = (time - leg.start) / leg.duration
            here = (phase >= 0) & (phase <= 1)
            velocity, answer = self.at(leg, np.clip(phase[here], BREAK_OFFSET, 1 - BREAK_OFFSET))
            columns[:, here] = velocity, *answer
        return columns[0], Answer(*columns[1:])

    def angle(self, time):
        """phi [rad] at rising times of the cycle [s], from the first one on; nan once the roller skids."""
        nodes, weights = GAUSS
        half = np.diff(time)[:, None] / 2
        velocity, answer = self.over(time[:-1, None] + half * (1 + nodes))
        crept = np.cumsum(np.sum(half * weights * answer.creep * velocity, axis=1))
        travel = self.demand.cycle.derivative(time, 0)
        return (travel - travel[0] + np.append(0.0, crept)) / self.roller.radius

    def angular_velocity(self, time):
        """phi' [rad/s] at times of the cycle [s]."""
        velocity, answer = self.over(time)
        return (1 + answer.creep) * velocity / self.roller.radius

    @cached_property
    def share(self):
        """Largest share of what friction holds that is asked."""
        return self._largest(lambda velocity, answer: answer.share)

    @property
    def lack(self):
        """What the motors have too little of for the law; empty where they have enough."""
        if any(join.order == 1 for join in self.demand.cycle.discontinuities()):
            return "force: the velocity jumps"
        most = HELD if self.roller.tells_creep else 1.0
        return f"friction: {self.share:.3g} of what it holds" if self.share > most else ""

    @cached_property
    def peak_torque(self):
        """Largest |T| of one motor [N m]; infinite where the law cannot be driven."""
        return inf if self.lack else self._largest(lambda velocity, answer: answer.torque)

    @cached_property
    def peak_power(self):
        """Largest |T phi'| of one motor [W]; infinite where the law cannot be driven."""
        return inf if self.lack else self._largest(lambda velocity, answer: self._power(velocity, answer))

    @cached_property
    def peak_creep(self):
        """Largest |creep|; infinite where the law cannot be driven, nan where no engine tells it."""
        if not self.roller.tells_creep:
            return np.nan
        return inf if self.lack else self._largest(lambda velocity, answer: answer.creep)

    def power(self, time):
        """T phi' of one motor [W] at times of the cycle [s]."""
        return self._power(*self.over(time))

    def _power(self, velocity, answer):
        return answer.torque * (1 + answer.creep) * velocity / self.roller.radius

    def _largest(self, quantity):
        demand = self.demand
        return max(
            find_maximum(
                lambda phase, leg=leg: np.abs(quantity(*self.at(leg, phase))), interior_grid(demand.breaks(leg))
            )[0]
            for leg in demand.cycle.legs()
        )


def _pull(demand, state, way):
    """Of all rollers [N], + along x, so that nothing pulls at the pin: guide wheels feel what the mix then resists."""
    forces, cart = state.forces, demand.cart
    push = cart.mass * state.acceleration + state.resistance + forces.guide_friction - forces.drive_force
    scale = np.max(np.abs(forces.drive_force), initial=0.0) + np.max(np.abs(state.resistance), initial=0.0)
    pull = forces.drive_force
    for _ in range(TRIALS):
        left = balance(cart, state.acceleration, state.resistance - pull, way, 0.0, push).drive_force
        pull = pull + left
        if np.all(np.abs(left) <= FORCED * scale):
            return pull
    raise RuntimeError(
        f"the guide wheels lock the cart under '{demand.cycle.forward.name}': {np.abs(left).max():g} N are left at the "
        f"pin after {TRIALS} trials"
    )


def _monotone(x, y, slope):
    """Through samples that rise, and on from both ends with a slope."""
    curve = PchipInterpolator(x, y)

    def value(at):
        within = np.clip(at, x[0], x[-1])
        return curve(within) + slope * (at - within)

    return value


@dataclass(frozen=True)
class RollerRotation:
    """Rotation of a roller that rolls without slip; arrays of the shape of `time`.

    Attributes
    ----------
    time : ndarray
        Time of the cycle [s].
    angle, angular_velocity, angular_acceleration, angular_jerk : ndarray
        Angle of rotation [rad] and its time derivatives [rad/s], [rad/s^2], [rad/s^3].
    """

    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    angular_velocity: NDArray[np.float64]
    angular_acceleration: NDArray[np.float64]
    angular_jerk: NDArray[np.float64]


def roller_rotation(cycle: Cycle, roller_radius: float, time: ArrayLike) -> RollerRotation:
    """Rotation of a motor inside a roller that rolls without slip: angle = x/R and its derivatives.

    Parameters
    ----------
    cycle : Cycle
        Motion of the cart.
    roller_radius : float
        Radius R of the roller [m].
    time : array_like
        Time of the cycle [s].

    References
    ----------
    Paper B, eqs (44)-(52), with the signs and the scale of reference/errata.md B-7, B-8.

    Examples
    --------
    >>> from compact.motion.profile import law
    >>> rotation = roller_rotation(Cycle(law("reversal-4-free-both", 0.4, 3.0)), roller_radius=0.11, time=[1.5, 4.5])
    >>> rotation.angular_velocity.round(4).tolist()
    [1.3531, -1.3531]
    """
    require_positive(roller_radius=roller_radius)
    time = np.asarray(time, float)
    return RollerRotation(time, *(cycle.derivative(time, order) / roller_radius for order in range(4)))
