"""The rigid roller on the nodes of a surface: how deep each stands in it, and the force that pushes it out.

    pressure = max(carried - penalty gap, 0),    force on the mix = weight pressure (n + friction t)

The weights are Simpson's on the reference. A node that has settled carries its pressure into the next increment; what
is left of the gap dies out as the motion gets steady, and nothing jumps where the first node touches.

"deformed": gap normal to the circle from where the node is now, n its normal into the mix, t along the travel.
"circle", "parabola": gap vertical from where the node was fed, n vertical; the resistance is that of the pressure on
the slope of the roller, the work of the vertical forces.

The roller that turns on the nodes of a surface: it grips the mix, which sticks to it or slips.

    slip = arc - arc before + (1 + creep) way,    creep = angular speed x radius/speed - 1
    shear = carried - stiffness slip, between +- grip pressure
    sum of weight shear = - torque/radius

The arc of a node is that of the circle from its lowest point to the node, so that slip is how far the mix moves along
the roller's surface, + ahead, while the roller goes its way. Coulomb's law has no memory of its own: like the pressure
the shear stays with the roller from one increment to the next, and when it changes no more, nodes that stick do not
slip at all and nodes that slip are at their bound, whatever the stiffness. No shear rises with the creep, so that one
creep makes their sum what the torque asks; it follows from the displacement and couples all nodes that stick. Beyond
what friction can hold all of them are at their bounds. Where the steady motion is found at once shear has no memory at
all: it falls with the slip between its bounds, over a slip that is small (`Slip`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq


@dataclass(frozen=True, eq=False)
class ContactForces:
    """What the roller does to the nodes: gap [m], pressure and shear on the reference [Pa], shape (n,), forces, shape
    (n, 2), and minus their derivatives by the displacement, shape (n, 2, 2).

    creep, ahead : of a roller that turns, creep and way [m] by which its surface turns more than it travels, else None
    coupling : column and row, shape (n, 2) each, of what the creep adds to the derivatives, or None
    """

    gap: np.ndarray
    pressure: np.ndarray
    shear: np.ndarray
    forces: np.ndarray
    stiffness: np.ndarray
    creep: float | None = None
    ahead: float | None = None
    coupling: tuple | None = None


@dataclass(frozen=True, eq=False)
class RollerSurface:
    """The roller and the surface nodes it may touch.

    place, weight : of the nodes on the reference [m], shape (n, 2), (n,);  carried : their pressures [Pa]
    radius, profile, friction : of the roller, friction the traction on the mix along +x over pressure, one or of each
    lowest : height of its lowest generatrix, at x = `offset` [m];  penalty : [Pa/m]
    """

    place: np.ndarray
    weight: np.ndarray
    radius: float
    lowest: float
    penalty: float
    carried: np.ndarray
    profile: str = "deformed"
    friction: np.ndarray | float = 0.0
    offset: float = 0.0

    def at(self, lowest, offset=0.0):
        """The same face at another height or place."""
        return replace(self, lowest=lowest, offset=offset)

    def carrying(self, pressure, shear, creep):
        """The same face with the pressures, and where it turns the shears and the creep, of the increment before."""
        return replace(self, carried=pressure)

    def missed(self, push):
        """By how much the tractions of a push miss those carried, at most [Pa]."""
        return np.abs(push.pressure - self.carried).max()

    def starting(self, displacement):
        """The same face where an increment begins, the nodes displaced by (n, 2)."""
        return self

    def push(self, displacement):
        """The `ContactForces` on nodes displaced by (n, 2)."""
        return self.pressed(displacement)

    def pressed(self, displacement):
        """The same of the pressures and their friction alone."""
        return self._normal_to_circle(displacement) if self.profile == "deformed" else self._vertical(displacement)

    def at_once(self, displacement, before, pressure):
        """The same face with the friction of steady motion, and the `Slip` where that follows from the motion."""
        return self, None

    def slope(self):
        """dy/dx of the roller under the nodes, by which a vertical pressure resists; 0 where it is normal to it."""
        x = self.place[:, 0] - self.offset
        if self.profile == "deformed":
            return np.zeros_like(x)
        inside = np.abs(x) < self.radius
        return x / self.radius if self.profile == "parabola" else np.where(inside, self._steepness(x), 0.0)

    def forces(self, push):
        """Load and resistance of a `ContactForces` [N/m]; where pressure is vertical it resists on the slope of the roller."""
        x, y = push.forces.sum(axis=0)
        return float(-y), float(x + np.sum(self.weight * push.pressure * self.slope()))

    def tangent(self, displacement):
        """Which way friction pulls the mix, unit vectors, shape (n, 2)."""
        if self.profile != "deformed":
            return np.tile([1.0, 0.0], (len(self.place), 1))
        n, _ = self._normal(displacement)
        return np.stack([-n[:, 1], n[:, 0]], axis=-1)

    def _normal(self, displacement):
        """Unit vectors from the axis of the roller to the nodes, and their distances from it."""
        ray = self.place + displacement - np.array([self.offset, self.lowest + self.radius])
        distance = np.hypot(*ray.T)
        return ray / distance[:, None], distance

    def _steepness(self, x):
        return x / np.sqrt(np.maximum(self.radius**2 - x**2, 1e-12 * self.radius**2))

    def _normal_to_circle(self, displacement):
        n, distance = self._normal(displacement)
        t = self.tangent(displacement)
        below = n[:, 1] < 0  # the far side of the roller touches nothing
        gap = np.where(below, distance - self.radius, np.inf)
        pressure = self._pressure(gap)
        pushed = n + np.reshape(self.friction, (-1, 1)) * t
        # the roller's normal turns as the node slides along it
        stiffness = self._rising(pressure)[:, None, None] * pushed[:, :, None] * n[:, None, :]
        turning = (self.weight * pressure / distance)[:, None, None]
        stiffness -= turning * (t - np.reshape(self.friction, (-1, 1)) * n)[:, :, None] * t[:, None, :]
        return ContactForces(
            gap, pressure, self.friction * pressure, (self.weight * pressure)[:, None] * pushed, stiffness
        )

    def _vertical(self, displacement):
        x = self.place[:, 0] - self.offset
        inside = np.abs(x) < self.radius
        circle = x**2 / (self.radius + np.sqrt(np.maximum(self.radius**2 - x**2, 0)))
        rise = x**2 / (2 * self.radius) if self.profile == "parabola" else np.where(inside, circle, np.inf)
        gap = self.lowest + rise - self.place[:, 1] - displacement[:, 1]
        pressure = self._pressure(gap)
        pushed = np.stack([np.broadcast_to(self.friction, x.shape), np.full_like(x, -1.0)], axis=-1)
        stiffness = self._rising(pressure)[:, None, None] * pushed[:, :, None] * np.array([0.0, -1.0])
        return ContactForces(
            gap, pressure, self.friction * pressure, (self.weight * pressure)[:, None] * pushed, stiffness
        )

    def _pressure(self, gap):
        relieved = np.multiply(self.penalty, gap, out=np.full_like(gap, np.inf), where=np.isfinite(gap))
        return np.maximum(self.carried - relieved, 0.0)

    def _rising(self, pressure):
        """Minus the derivative of the nodal force by the gap."""
        return np.where(pressure > 0, self.penalty * self.weight, 0.0)


STICKING = 1e-3  # of the way, slip up to which shear rises to its bound where the steady motion is found at once
STIFFNESS = 1.0  # against slip over the penalty of the gap; a fifth or five times of it give the same steady motion


@dataclass(frozen=True, eq=False)
class Slip:
    """Of the mix along a roller in steady motion, and what it does to the friction of the nodes.

        slip = (arc - arc before)/way + 1 + creep,    friction = - grip phi(slip/sticking),    phi = x (3 - x^2)/2

    creep : with which weight pressure friction sums to the pull;  falls : minus d friction/d slip, shape (n,)
    here, before : d slip by the displacement of the node and by that with which it came, shape (n, 2)
    """

    creep: float
    falls: np.ndarray
    here: np.ndarray
    before: np.ndarray

    def change(self, face, pressure, more, displacement, before):
        """Of the friction of a face's nodes with those of pressure, displacement and displacement before."""
        slip = np.sum(self.here * displacement, axis=1) + np.sum(self.before * before, axis=1)
        held = face.weight * pressure * self.falls
        lost = face.weight @ (more * face.friction) - held @ slip
        creep = lost / held.sum() if held.any() else 0.0
        return -self.falls * (slip + creep)


@dataclass(frozen=True, eq=False)
class RollingSurface(RollerSurface):
    """A `RollerSurface` without friction of its own, and the shear that its turning adds.

    grip : Coulomb's coefficient;  pull : sum of weight shear that is asked, + along the travel [N/m]
    sheared : shears that the roller carries on [Pa];  creep : of the increment before
    sticking : slip over the way at which shear is at its bound, where the steady motion is found at once
    arcs, left : of the nodes, and where the lowest generatrix was, when the increment began [m]
    """

    grip: float = 0.0
    pull: float = 0.0
    sheared: np.ndarray | float = 0.0
    creep: float = 0.0
    arcs: np.ndarray | float = 0.0
    left: float = 0.0
    sticking: float = STICKING

    def carrying(self, pressure, shear, creep):
        creep = self.creep if creep is None else creep
        return replace(self, carried=pressure, sheared=shear, creep=creep)

    def missed(self, push):
        return max(super().missed(push), np.abs(push.shear - self.sheared).max())

    def starting(self, displacement):
        return replace(self, arcs=self._arcs(displacement), left=self.offset)

    def push(self, displacement):
        pressed = self.pressed(displacement)
        bound, way = self.grip * pressed.pressure, self.offset - self.left
        stiffness = STIFFNESS * self.penalty
        rolling = self.sheared - stiffness * (self._arcs(displacement) - self.arcs + way)  # without creep
        ahead = self._ahead(rolling, bound, stiffness)
        tried = rolling - stiffness * ahead
        shear, sticks = np.clip(tried, -bound, bound), np.abs(tried) < bound
        n, t, turning, growing = self._axes(displacement)
        # minus the derivatives of the nodal shear by the displacement, the creep as it is
        falls = np.where(sticks, stiffness * self.weight * growing, 0.0)[:, None] * t
        falls += np.where(sticks, 0.0, np.sign(shear) * self.grip * self._rising(pressed.pressure))[:, None] * n
        turned = (self.weight * shear * turning)[:, None, None] * n[:, :, None] * t[:, None, :]
        return replace(
            pressed,
            shear=shear,
            forces=pressed.forces + (self.weight * shear)[:, None] * t,
            stiffness=pressed.stiffness + t[:, :, None] * falls[:, None, :] + turned,
            creep=ahead / way if way else self.creep,
            ahead=ahead,
            coupling=self._coupling(t, falls, sticks),
        )

    def asked(self, push):
        """Share of what friction can hold that the pull asks; from 1 on the roller skids."""
        return abs(self.pull) / (self.grip * (self.weight @ push.pressure))

    def at_once(self, displacement, before, pressure):
        """The same face with the friction of nodes displaced by (n, 2) that came displaced by `before`; the `Slip`."""
        way = self.offset - self.left
        came = replace(self, offset=self.left)
        slip = (self._arcs(displacement) - came._arcs(before)) / way + 1
        bound = self.grip * np.maximum(pressure, 0.0) * self.weight
        creep = _root(slip, bound, self.pull, self.sticking)
        x = np.clip((slip + creep) / self.sticking, -1, 1)
        gradients = []
        for face, where, sign in ((self, displacement, 1), (came, before, -1)):
            _, t, _, growing = face._axes(where)
            gradients.append(sign * growing[:, None] * t / way)
        falls = self.grip * 1.5 * (1 - x * x) / self.sticking
        friction = -self.grip * x * (3 - x * x) / 2
        return replace(self, friction=friction), Slip(creep, falls, *gradients)

    def _ahead(self, rolling, bound, stiffness):
        """creep way, with which the shears, `rolling` without it, sum to the pull; they are lines between bounds."""
        touching = bound > 0
        if not touching.any():
            return self.creep * (self.offset - self.left)
        rolling, bound, weight = rolling[touching], bound[touching], self.weight[touching]
        ends = np.sort(np.concatenate([rolling - bound, rolling + bound])) / stiffness
        sums = np.clip(rolling - stiffness * ends[:, None], -bound, bound) @ weight
        return float(np.interp(self.pull, sums[::-1], ends[::-1]))

    def _coupling(self, t, falls, sticks):
        """What all shears lose together comes back on the nodes that stick."""
        if not sticks.any():
            return None
        share = np.where(sticks, self.weight, 0.0)
        return (share / share.sum())[:, None] * t, -falls

    def _axes(self, displacement):
        """Normal and tangent at the nodes, shape (n, 2); per slide of a node along them their turn and its arc's
        growth, shape (n,)."""
        t = self.tangent(displacement)
        n = np.stack([t[:, 1], -t[:, 0]], axis=-1)
        if self.profile != "deformed":
            return n, t, np.zeros(len(t)), np.ones(len(t))
        _, distance = self._normal(displacement)
        return n, t, 1 / distance, self.radius / distance

    def _arcs(self, displacement):
        x, y = (self.place + displacement).T
        if self.profile != "deformed":
            return x - self.offset
        return self.radius * np.arctan2(x - self.offset, self.lowest + self.radius - y)


def _root(slip, bound, pull, sticking):
    """The creep with which - bound phi((slip + creep)/sticking) sums to the pull, or that of the bounds beyond."""

    def excess(creep):
        x = np.clip((slip + creep) / sticking, -1, 1)
        return -bound @ (x * (3 - x * x) / 2) - pull

    touching = bound > 1e-9 * bound.max()
    if not touching.any():
        return 0.0
    low, high = -slip[touching].max() - sticking, -slip[touching].min() + sticking
    if excess(low) * excess(high) >= 0:
        return low if excess(low) <= 0 else high
    return float(brentq(excess, low, high, xtol=1e-14))
