"""Preloaded springs at both ends of the stroke, which stop the cart and set it going the other way.

    S = P + k (l - x) for x < l,   -(P + k (x - h + l)) for x > h - l,   0 between

x is the cart's position from 0 to the stroke h. The preload P makes S jump where the cart meets a spring; those places
are found beforehand, so that nothing is sampled across them.

Forces on a cart that rolls between guide rails: the drive force and the reactions of its two guide wheels.

Axes: x along the travel from the cart's centre, + towards the drive; y up from the drive pin. The mix lifts the
rollers, the guide wheels press down on the cart from the upper rail; a wheel whose reaction turns negative has lifted
off and runs on the lower rail. With s = sign of velocity, H the drive force and V = H tan(beta) the vertical pull of
an inclined rod (paper C eqs 1-9, which hold as printed only for s = +1; reconstructed here, see errata C-6 to C-8):

    H = m a + W - S + s f (|N1| + |N2|)
    N1 + N2 = sum R - G + V
    N1 x1 + N2 x2 = sum R x + V z - W (e + r) + s f (D/2) (N1 + N2)

W is the resistance of the mix on the rollers' lowest points, e + r below the pin, S the push of springs at the ends of
the stroke (`springs`), at the height of the pin. The cart's centre of mass and the
guide wheels' axles lie at the height of the pin: the paper does not say, and its numbers agree with that.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from compact.numerics.piecewise import find_roots
from compact.numerics.validation import require_finite, require_nonnegative, require_positive


class Zones(NamedTuple):
    """breaks of a coordinate of the motion, ascending; side of each piece between: +1 on the near spring, -1 far, 0."""

    breaks: np.ndarray
    sides: np.ndarray

    def at(self, place):
        """Side at places of any shape."""
        return self.sides[np.clip(np.searchsorted(self.breaks, place, side="right") - 1, 0, len(self.sides) - 1)]


@dataclass(frozen=True)
class EndSprings:
    """stiffness : k [N/m];  preload : P [N];  length : l over which a spring pushes [m];  stroke : h [m], h >= 2 l."""

    stiffness: float
    preload: float
    length: float
    stroke: float

    def __post_init__(self):
        require_nonnegative(stiffness=self.stiffness, preload=self.preload)
        require_positive(length=self.length, stroke=self.stroke)
        if 2 * self.length > self.stroke:
            raise ValueError(f"`length` must be at most half the stroke, {self.stroke / 2:g} m, got {self.length!r}")

    def push(self, position, side):
        """S [N], + along the travel, at a position [m] on the side that `Zones` tell."""
        pressed = self.length - np.where(side > 0, position, self.stroke - position)
        return side * (self.preload + self.stiffness * pressed)

    def energy(self, position):
        """What both springs hold [J], their preload's work over `length` among it."""
        pressed = np.maximum(self.length - np.minimum(position, self.stroke - np.asarray(position)), 0.0)
        return self.preload * pressed + self.stiffness / 2 * pressed**2

    def zones(self, position, breaks):
        """`Zones` of position(place) over places that join at `breaks`."""
        edges = (self.length, self.stroke - self.length)
        breaks = np.asarray(breaks, float)
        met = [find_roots(lambda place, edge=edge: position(place) - edge, breaks) for edge in edges]
        breaks = np.unique(np.concatenate([breaks, *met]))
        middle = position((breaks[:-1] + breaks[1:]) / 2)
        return Zones(breaks, np.where(middle < edges[0], 1.0, np.where(middle > edges[1], -1.0, 0.0)))


@dataclass(frozen=True)
class Cart:
    """A cart and what presses on it.

    mass : m [kg]; weight : G [N]
    roller_positions : x of the rollers [m]; roller_reactions : R, lift of the mix on each [N]
    guide_positions : x of the front and the rear guide wheel [m], front > rear
    pin_position : x of the drive pin, z [m]; pin_height : e, above the rollers' axles [m]
    roller_radius : r [m]; guide_wheel_diameter : D [m]; guide_friction : f, Coulomb at the guide wheels
    end_springs : at the ends of the stroke, or None
    return_load_ratio : of the roller reactions at negative velocities over R [-]; below 1 if the return stroke rolls
        over compacted mix
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

    def __post_init__(self):
        require_nonnegative(
            return_load_ratio=self.return_load_ratio,
            mass=self.mass,
            weight=self.weight,
            roller_reactions=self.roller_reactions,
            guide_friction=self.guide_friction,
            guide_wheel_diameter=self.guide_wheel_diameter,
        )
        require_positive(roller_radius=self.roller_radius)
        require_finite(
            roller_positions=self.roller_positions,
            guide_positions=self.guide_positions,
            pin_position=self.pin_position,
            pin_height=self.pin_height,
        )
        if len(self.roller_positions) != len(self.roller_reactions):
            raise ValueError(
                f"`roller_reactions` must be one per roller, got {len(self.roller_reactions)} "
                f"for {len(self.roller_positions)} positions"
            )
        if not self.guide_positions[0] > self.guide_positions[1]:
            raise ValueError(f"`guide_positions` must be (front, rear) with front > rear, got {self.guide_positions}")


@dataclass(frozen=True)
class MotionResistance:
    """What a straight push meets beside the cart's inertia: the mix and the guide wheels [N], odd in velocity.

    resistance : callable(velocity, acceleration) -> N, of the mix on all rollers of the cart
    """

    cart: Cart
    resistance: Callable

    @property
    def odd(self):
        """Whether the resistance of the mix changes its sign with the velocity by construction."""
        return getattr(self.resistance, "odd", False)

    def __call__(self, velocity, acceleration):
        """W + guide friction [N], of the common shape of velocity [m/s] and acceleration [m/s^2]."""
        met = self.resistance(velocity, acceleration)
        return balance(self.cart, 0.0, met, np.sign(velocity)).drive_force


@dataclass(frozen=True)
class Balance:
    """Forces that keep the cart in balance; arrays of one shape.

    drive_force : H, along the travel [N], + towards the drive
    front_reaction, rear_reaction : N1, N2 of the guide wheels [N], + from the upper rail, - from the lower one
    guide_friction : s f (|N1| + |N2|) [N]
    """

    drive_force: np.ndarray
    front_reaction: np.ndarray
    rear_reaction: np.ndarray
    guide_friction: np.ndarray


def balance(cart, acceleration, resistance, direction, rod_tangent=0.0, push=0.0):
    """`Balance` of a cart in motion; all but the cart are arrays or numbers that broadcast.

    acceleration : a [m/s^2]; resistance : W, signed like the velocity [N]
    direction : s, sign of the velocity, 0 standing; rod_tangent : tan(beta), + where the rod rises to the drive
    push : S [N], + along the travel

    The reactions are linear in H, N_i = A_i + B_i H, so H - s f (|N1| + |N2|) = m a + W - S is piecewise linear and
    rises while f (|B1| + |B2|) < 1: of the four pairs of signs one fits. Raises ValueError for a rod so steep that
    friction locks the cart, and for numbers that are not finite.
    """
    require_finite(acceleration=acceleration, resistance=resistance, rod_tangent=rod_tangent, push=push)
    acceleration, resistance, direction, tangent, push = np.broadcast_arrays(
        acceleration, resistance, direction, rod_tangent, push
    )
    needed = cart.mass * acceleration + resistance - push
    slide = direction * cart.guide_friction
    (front_0, rear_0), (front_1, rear_1) = _reactions(cart, resistance, direction, tangent)
    if np.any(np.abs(slide) * (np.abs(front_1) + np.abs(rear_1)) >= 1):
        raise ValueError(f"the rod is too steep: `guide_friction` {cart.guide_friction!r} locks the cart")
    if not tangent.any():  # the drive pulls along the rails and moves no reaction
        friction = slide * (np.abs(front_0) + np.abs(rear_0))
        return Balance(needed + friction, front_0, rear_0, friction)
    force, gap = np.zeros(needed.shape), np.full(needed.shape, np.inf)
    for front_sign, rear_sign in product((1, -1), repeat=2):
        offset, slope = front_sign * front_0 + rear_sign * rear_0, front_sign * front_1 + rear_sign * rear_1
        trial = (needed + slide * offset) / (1 - slide * slope)
        friction = slide * (np.abs(front_0 + front_1 * trial) + np.abs(rear_0 + rear_1 * trial))
        trial_gap = np.abs(trial - friction - needed)
        force, gap = np.where(trial_gap < gap, trial, force), np.minimum(gap, trial_gap)
    front, rear = front_0 + front_1 * force, rear_0 + rear_1 * force
    return Balance(force, front, rear, slide * (np.abs(front) + np.abs(rear)))


def _reactions(cart, resistance, direction, tangent):
    """(A1, A2), (B1, B2) of N_i = A_i + B_i H from the sum of vertical forces and of moments about the pin's height."""
    front, rear = cart.guide_positions
    share = _load_share(cart, direction)
    lift = share * np.sum(cart.roller_reactions) - cart.weight
    lever = direction * cart.guide_friction * cart.guide_wheel_diameter / 2
    moment = share * np.dot(cart.roller_reactions, cart.roller_positions)
    moment = moment - resistance * (cart.pin_height + cart.roller_radius)
    constant = _share(lift, moment + lever * lift, front, rear)
    return constant, _share(tangent, cart.pin_position * tangent + lever * tangent, front, rear)


def _load_share(cart, direction):
    """Roller reactions over those of the way out [-], of the shape of the direction."""
    return np.where(np.asarray(direction) < 0, cart.return_load_ratio, 1.0)


def _share(total, moment, front, rear):
    """N1, N2 with N1 + N2 = total and N1 x1 + N2 x2 = moment."""
    return (moment - rear * total) / (front - rear), (front * total - moment) / (front - rear)


def moment_residual(cart, forces, resistance, direction, rod_tangent=0.0):
    """What is left of the moments about the pin [N m], written out wheel by wheel: zero for a `Balance`."""
    rollers = _load_share(cart, direction) * np.dot(cart.roller_reactions, cart.roller_positions)
    mix = -np.asarray(resistance) * (cart.pin_height + cart.roller_radius)
    rod = cart.pin_position * forces.drive_force * rod_tangent
    guides = 0.0
    for x, reaction in zip(cart.guide_positions, (forces.front_reaction, forces.rear_reaction), strict=True):
        rail = np.sign(reaction) * cart.guide_wheel_diameter / 2  # the wheel touches the rail that loads it
        guides = guides - reaction * x + rail * direction * cart.guide_friction * np.abs(reaction)
    return rollers + mix + rod + guides
