"""The rigid roller on the nodes of a surface: how deep each stands in it, and the force that pushes it out.

    pressure = max(carried - penalty gap, 0),    force on the mix = weight pressure (n + friction t)

The weights are Simpson's on the reference. A node that has settled carries its pressure into the next increment; what
is left of the gap dies out as the motion gets steady, and nothing jumps where the first node touches.

"deformed": gap normal to the circle from where the node is now, n its normal into the mix, t along the travel.
"circle", "parabola": gap vertical from where the node was fed, n vertical; the resistance is that of the pressure on
the slope of the roller, the work of the vertical forces.
"""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Push:
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
class Face:
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
        """The `Push` on nodes displaced by (n, 2)."""
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
        """Load and resistance of a `Push` [N/m]; where pressure is vertical it resists on the slope of the roller."""
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
        return Push(gap, pressure, self.friction * pressure, (self.weight * pressure)[:, None] * pushed, stiffness)

    def _vertical(self, displacement):
        x = self.place[:, 0] - self.offset
        inside = np.abs(x) < self.radius
        circle = x**2 / (self.radius + np.sqrt(np.maximum(self.radius**2 - x**2, 0)))
        rise = x**2 / (2 * self.radius) if self.profile == "parabola" else np.where(inside, circle, np.inf)
        gap = self.lowest + rise - self.place[:, 1] - displacement[:, 1]
        pressure = self._pressure(gap)
        pushed = np.stack([np.broadcast_to(self.friction, x.shape), np.full_like(x, -1.0)], axis=-1)
        stiffness = self._rising(pressure)[:, None, None] * pushed[:, :, None] * np.array([0.0, -1.0])
        return Push(gap, pressure, self.friction * pressure, (self.weight * pressure)[:, None] * pushed, stiffness)

    def _pressure(self, gap):
        relieved = np.multiply(self.penalty, gap, out=np.full_like(gap, np.inf), where=np.isfinite(gap))
        return np.maximum(self.carried - relieved, 0.0)

    def _rising(self, pressure):
        """Minus the derivative of the nodal force by the gap."""
        return np.where(pressure > 0, self.penalty * self.weight, 0.0)
