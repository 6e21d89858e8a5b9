"""Forces on a cart between guide rails: drive force, guide-wheel reactions and preloaded end springs.

Axes: x along the travel from the centre of the cart, positive towards the drive; y upwards from the drive pin. The mix
lifts the rollers, and the guide wheels run on the upper rail. A wheel with a negative reaction has lifted off and runs
on the lower rail. With s = sign of velocity, H the drive force and V = H tan(beta) the vertical component of an
inclined rod:

    H = m a + W - S + s f (|N1| + |N2|)
    N1 + N2 = sum R - G + V
    N1 x1 + N2 x2 = sum R x + V z - W (e + r) + s f (D/2) (N1 + N2)

W is the resistance of the mix at the lowest points of the rollers, e + r below the pin. S is the force of the end
springs at the height of the pin:

    S = P + k (l - x) for x < l,   -(P + k (x - h + l)) for x > h - l,   0 between

with the position x from 0 to the stroke h. The preload P makes S jump at the plate of a spring; these positions bound
the pieces of a motion, so that no sample interval extends across a jump.

The centre of mass and the axles of the guide wheels are assumed at the height of the pin. The source does not state
this, but its numbers agree with it.

References
----------
Paper C, eqs 1-9, valid as printed for s = +1 only; reconstructed here, see errata C-6 to C-8.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array
from compact.numerics.piecewise import find_sign_changes, graded_grid
from compact.numerics.validation import as_numbers, require_fields, require_finite, require_instance

# force of the mix on all rollers of a cart [N] over velocity [m/s] and acceleration [m/s^2]
Resistance = Callable[[Array, Array], ArrayLike]


class SpringZones(NamedTuple):
    """End spring in contact along a motion.

    Parameters
    ----------
    breaks : ndarray, shape (n + 1,)
        Ascending coordinates of the motion, such as its phase, at which the zone may change.
    sides : ndarray, shape (n,)
        +1 at the near spring, -1 at the far spring, 0 between.
    """

    breaks: Array
    sides: Array

    def side_at(self, coordinate: ArrayLike) -> Array:
        """Side at coordinates of any shape."""
        return self.sides[np.clip(np.searchsorted(self.breaks, coordinate, side="right") - 1, 0, len(self.sides) - 1)]


@dataclass(frozen=True)
class EndSprings:
    """Preloaded springs at both ends of the stroke.

    Parameters
    ----------
    stiffness, preload : float
        k [N/m] and P [N], >= 0.
    length : float
        Working length l of one spring [m], at most half the stroke.
    stroke : float
        h [m].
    """

    stiffness: float
    preload: float
    length: float
    stroke: float

    def __post_init__(self) -> None:
        require_fields(self, positive="length stroke", nonnegative="stiffness preload")
        if 2 * self.length > self.stroke:
            raise ValueError(f"`length` must be at most half the stroke, {self.stroke / 2:g} m, got {self.length!r}")

    def force(self, position: Array, side: Array) -> Array:
        """Force S [N] along the travel at positions [m] on the sides of `SpringZones`."""
        compression = self.length - np.where(side > 0, position, self.stroke - position)
        return side * (self.preload + self.stiffness * compression)

    def energy(self, position: ArrayLike) -> Array:
        """Energy of both springs [J] relative to their preloaded state."""
        compression = np.maximum(self.length - np.minimum(position, self.stroke - np.asarray(position)), 0.0)
        return self.preload * compression + self.stiffness / 2 * compression**2

    def zones(self, position: Callable[[Array], Array], breaks: ArrayLike) -> SpringZones:
        """Find the zones of a motion given by its position [m] over a coordinate, smooth between ascending breaks."""
        plates = np.array([self.length, self.stroke - self.length])
        breaks = np.asarray(breaks, float)

        contacts = find_sign_changes(lambda at, plate: position(at) - plates[plate], 2, graded_grid(breaks))
        breaks = np.union1d(breaks, contacts)
        middle = position((breaks[:-1] + breaks[1:]) / 2)
        return SpringZones(breaks, np.where(middle < plates[0], 1.0, np.where(middle > plates[1], -1.0, 0.0)))


@dataclass(frozen=True)
class Cart:
    """A cart with its rollers, guide wheels and end springs.

    Parameters
    ----------
    mass : float
        m [kg].
    weight : float
        G [N].
    roller_positions : tuple of float
        x of the rollers [m].
    roller_reactions : tuple of float
        Lift R of the mix on each roller [N].
    guide_positions : tuple of float
        x of the front and the rear guide wheel [m], front > rear.
    pin_position : float
        x of the drive pin, z [m].
    pin_height : float
        Height e of the pin above the axles of the rollers [m].
    roller_radius : float
        r [m].
    guide_wheel_diameter : float
        D [m].
    guide_friction : float
        Coefficient f of Coulomb friction of the guide wheels [-].
    end_springs : EndSprings, optional
        Springs at the ends of the stroke.
    return_load_ratio : float
        Ratio of the roller reactions on the return stroke to those on the forward stroke [-]; < 1 over compacted mix.
    """

    mass: float
    weight: float
    roller_positions: tuple[float, ...]
    roller_reactions: tuple[float, ...]
    guide_positions: tuple[float, float]
    pin_position: float
    pin_height: float
    roller_radius: float
    guide_wheel_diameter: float
    guide_friction: float
    end_springs: EndSprings | None = None
    return_load_ratio: float = 1.0

    def __post_init__(self) -> None:
        require_fields(
            self,
            positive="roller_radius",
            nonnegative="return_load_ratio mass weight roller_reactions guide_friction guide_wheel_diameter",
            finite="roller_positions guide_positions pin_position pin_height",
        )
        for name in ("roller_positions", "roller_reactions", "guide_positions"):
            if as_numbers(name, getattr(self, name)).ndim != 1:
                raise ValueError(f"`{name}` must be a list of numbers, got {getattr(self, name)!r}")
        if len(self.roller_positions) != len(self.roller_reactions):
            raise ValueError(
                f"`roller_reactions` must be one per roller, got {len(self.roller_reactions)} "
                f"for {len(self.roller_positions)} positions"
            )
        if not self.guide_positions[0] > self.guide_positions[1]:
            raise ValueError(f"`guide_positions` must be (front, rear) with front > rear, got {self.guide_positions}")


@dataclass(frozen=True)
class MotionResistance:
    """Resistance of mix and guide wheels to a drive along the rails, odd in velocity.

    Parameters
    ----------
    resistance : callable
        Force of the mix on all rollers [N] of velocity [m/s] and acceleration [m/s^2].
    """

    cart: Cart
    resistance: Resistance

    @property
    def odd(self) -> bool:
        """True for a resistance of the mix that is odd in velocity by construction."""
        return getattr(self.resistance, "odd", False)

    def __call__(self, velocity: Array, acceleration: Array) -> Array:
        """Return W + guide friction [N] at velocities [m/s] and accelerations [m/s^2] of one shape."""
        force = self.resistance(velocity, acceleration)
        return balance(self.cart, 0.0, force, np.sign(velocity)).drive_force


class Balance(NamedTuple):
    """Forces in equilibrium with the cart; arrays of one shape.

    Parameters
    ----------
    drive_force : ndarray
        H along the travel [N], positive towards the drive.
    front_reaction, rear_reaction : ndarray
        N1 and N2 of the guide wheels [N], positive from the upper rail.
    guide_friction : ndarray
        s f (|N1| + |N2|) [N].
    """

    drive_force: Array
    front_reaction: Array
    rear_reaction: Array
    guide_friction: Array


def balance(
    cart: Cart,
    acceleration: ArrayLike,
    resistance: ArrayLike,
    direction: ArrayLike,
    rod_tangent: ArrayLike = 0.0,
    end_spring_force: ArrayLike = 0.0,
    load_share: ArrayLike = 1.0,
) -> Balance:
    """Solve the equilibrium of a moving cart; all arguments but the cart broadcast.

    Parameters
    ----------
    acceleration : array_like
        a [m/s^2].
    resistance : array_like
        W with the sign of the velocity [N].
    direction : array_like
        Sign s of the velocity, 0 at rest.
    rod_tangent : array_like
        tan(beta) [-], positive for a rod that rises towards the drive.
    end_spring_force : array_like
        S along the travel [N].
    load_share : array_like
        Share of the roller reactions after a turn [-], >= 0.

    Raises
    ------
    ValueError
        If an argument is not finite, or if guide friction locks the cart at this inclination of the rod.

    Notes
    -----
    The reactions are linear in H, N_i = A_i + B_i H. Thus H - s f (|N1| + |N2|) = m a + W - S is piecewise linear and
    increasing for f (|B1| + |B2|) < 1, and one of the four pairs of signs satisfies it.
    """
    require_instance(Cart, "a Cart", cart=cart)
    require_finite(
        acceleration=acceleration, resistance=resistance, rod_tangent=rod_tangent, end_spring_force=end_spring_force,
        direction=direction, load_share=load_share,
    )  # fmt: skip
    a, force_of_mix, sign, tangent, end_force, share = np.broadcast_arrays(
        acceleration, resistance, direction, rod_tangent, end_spring_force, load_share
    )
    required = cart.mass * a + force_of_mix - end_force
    friction_factor = sign * cart.guide_friction
    (front_0, rear_0), (front_1, rear_1) = _reaction_coefficients(cart, force_of_mix, sign, tangent, share)
    if np.any(np.abs(friction_factor) * (np.abs(front_1) + np.abs(rear_1)) >= 1):
        raise ValueError(
            f"the rod is too steep: `guide_friction` {cart.guide_friction!r} locks the cart; use a longer rod or less "
            "friction"
        )
    if not tangent.any():  # a drive along the rails does not affect the reactions
        friction = friction_factor * (np.abs(front_0) + np.abs(rear_0))
        return Balance(required + friction, front_0, rear_0, friction)
    force, gap = np.zeros(required.shape), np.full(required.shape, np.inf)
    for front_sign, rear_sign in product((1, -1), repeat=2):
        offset, slope = front_sign * front_0 + rear_sign * rear_0, front_sign * front_1 + rear_sign * rear_1
        trial = (required + friction_factor * offset) / (1 - friction_factor * slope)
        friction = friction_factor * (np.abs(front_0 + front_1 * trial) + np.abs(rear_0 + rear_1 * trial))
        trial_gap = np.abs(trial - friction - required)
        force, gap = np.where(trial_gap < gap, trial, force), np.minimum(gap, trial_gap)
    front, rear = front_0 + front_1 * force, rear_0 + rear_1 * force
    return Balance(force, front, rear, friction_factor * (np.abs(front) + np.abs(rear)))


def _reaction_coefficients(cart, resistance, direction, tangent, load_share):
    """(A1, A2), (B1, B2) of N_i = A_i + B_i H from the vertical forces and the moments about the height of the pin."""
    front, rear = cart.guide_positions
    # of the reactions to those of the forward stroke far from its turn
    ratio = load_share * np.where(direction < 0, cart.return_load_ratio, 1.0)
    lift = ratio * np.sum(cart.roller_reactions) - cart.weight
    lever = direction * cart.guide_friction * cart.guide_wheel_diameter / 2
    moment = ratio * np.dot(cart.roller_reactions, cart.roller_positions)
    moment = moment - resistance * (cart.pin_height + cart.roller_radius)
    constant = _distribute(lift, moment + lever * lift, front, rear)
    return constant, _distribute(tangent, cart.pin_position * tangent + lever * tangent, front, rear)


def _distribute(total, moment, front, rear):
    """Return N1 and N2 with N1 + N2 = total and N1 x1 + N2 x2 = moment."""
    return (moment - rear * total) / (front - rear), (front * total - moment) / (front - rear)
