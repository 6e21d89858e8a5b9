"""Contact of a rigid roller with the surface nodes: normal contact, sliding friction, stick and slip.

Normal contact, augmented Lagrangian (Simo and Laursen 1992):

    pressure = max(multiplier pressure - penalty gap, 0),    nodal force = weight pressure (n + traction ratio t)

The weights are those of Simpson's rule on the reference configuration. The pressure of a converged increment is the
multiplier of the next one. The gap thus vanishes as the motion becomes steady, and no force jumps as the first node
touches.

Profile "deformed": gap normal to the circle at the current position of the node, n its normal into the mix, t along the
travel. Profiles "circle" and "parabola": vertical gap at the reference position of the node, n vertical; the pressure
resists on the slope of the roller.

A roller that rotates, with Coulomb friction:

    slip = arc - arc before + (1 + creepage) travel,    creepage = angular speed x radius/speed - 1
    shear = multiplier shear - stiffness slip, between +- friction pressure
    sum of weight shear = - torque/radius

The arc of a node is measured on the circle from its lowest point, so that the slip is the motion of the mix along the
roller surface, + ahead. The multiplier shear moves with the roller like the multiplier pressure. If it no longer
changes, sticking nodes have no slip and slipping nodes are at their bound for any stiffness. The shears decrease
monotonically with the creepage, so one creepage satisfies the torque; it depends on the displacement and couples all
sticking nodes.

References
----------
J. C. Simo and T. A. Laursen, An augmented Lagrangian treatment of contact problems involving friction, Computers and
Structures 42 (1992) 97-116.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from compact.numerics import Array
from compact.rolling_contact import GapGeometry

MIN_SLOPE_ROOT = 1e-12  # [-], of R^2, least R^2 - x^2 of the slope of the circle


@dataclass(frozen=True, eq=False)
class ContactTractions:
    """Tractions of the roller on the surface nodes.

    Parameters
    ----------
    pressure, shear : ndarray, shape (n,)
        Nodal tractions on the reference configuration [Pa]; shear + along the travel.
    creepage : float or None
        Creepage of a roller that sticks and slips [-], else None.
    """

    pressure: Array
    shear: Array
    creepage: float | None = None

    def at(self, x: Array, known: Array) -> "ContactTractions":
        """Interpolate from nodes at `known` to nodes at x [m]."""
        return ContactTractions(np.interp(x, known, self.pressure), np.interp(x, known, self.shear), self.creepage)


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactForces(ContactTractions):
    """Tractions with the nodal forces and their derivatives.

    Parameters
    ----------
    gap : ndarray, shape (n,)
        Gap between node and roller [m].
    forces : ndarray, shape (n, 2)
        Forces of the roller on the nodes [N/m].
    stiffness : ndarray, shape (n, 2, 2)
        Minus the derivative of the forces by the displacement at constant creepage [N/m2].
    creep_travel : float or None
        Creepage times travel of the increment [m], else None.
    creep_coupling : tuple of ndarray, shape (n, 2) each, or None
        Column and row of the rank-one stiffness by the creepage.
    """

    gap: Array
    forces: Array
    stiffness: Array
    creep_travel: float | None = None
    creep_coupling: tuple[Array, Array] | None = None


@dataclass(frozen=True, eq=False)
class RollerSurface:
    """Rigid roller and the surface nodes that it may touch.

    Parameters
    ----------
    coordinates : ndarray, shape (n, 2)
        Nodes in the reference configuration [m].
    weights : ndarray, shape (n,)
        Integration weights of the nodes [m].
    radius : float
        Roller radius [m].
    bottom_height : float
        Height of the lowest generatrix above the base [m].
    penalty : float
        Normal penalty [Pa/m].
    profile : {"deformed", "circle", "parabola"}
        Geometry of the gap.
    friction : float
        Coulomb's coefficient of a roller that rotates, else traction on the mix along +x over pressure [-].
    tangential_force : float or None
        Required sum of weight times shear of a roller that rotates, - torque/radius [N/m]; else None.
    multipliers : ContactTractions
        Multipliers of the contact, and the creepage of the last increment.
    position : float
        x of the lowest generatrix [m].
    start_arcs : ndarray, shape (n,)
        Arcs of the nodes at the begin of the increment [m].
    start_position : float
        x of the lowest generatrix at the begin of the increment [m].
    shear_penalty_ratio : float
        Tangential over normal penalty [-]; 0.2 to 5 give the same steady motion.
    """

    coordinates: Array
    weights: Array
    radius: float
    bottom_height: float
    penalty: float
    profile: GapGeometry
    friction: float
    tangential_force: float | None
    multipliers: ContactTractions
    position: float = 0.0
    start_arcs: Array | float = 0.0
    start_position: float = 0.0
    shear_penalty_ratio: float = 1.0

    @property
    def rotates(self) -> bool:
        """True for a roller that sticks and slips."""
        return self.tangential_force is not None

    def moved_to(self, bottom_height: float, position: float = 0.0) -> Self:
        """Return the surface with the lowest generatrix at a height and a position [m]."""
        return replace(self, bottom_height=bottom_height, position=position)

    def multiplier_error(self, contact: ContactForces) -> float:
        """Return the largest difference between the tractions and their multipliers [Pa]."""
        names = ("pressure", "shear") if self.rotates else ("pressure",)
        return float(max(np.abs(getattr(contact, name) - getattr(self.multipliers, name)).max() for name in names))

    def begin_increment(self, displacement: Array) -> Self:
        """Return the surface at the begin of an increment from nodal displacements [m], shape (n, 2)."""
        return replace(self, start_arcs=self.arcs(displacement), start_position=self.position)

    def contact_forces(self, displacement: Array) -> ContactForces:
        """Return the contact forces on nodes with displacements [m] of shape (n, 2)."""
        normal = self.normal_contact(displacement)
        if self.tangential_force is None:
            return normal
        # normals and tangents, rotation and arc growth per tangential motion of the nodes
        n, distance = self._normals(displacement)
        t, rotation, growth = _turned(n), 1 / distance, self.radius / distance
        if self.profile != "deformed":
            growth = 1.0
        bound, travel = self.friction * normal.pressure, self.position - self.start_position
        stiffness = self.shear_penalty_ratio * self.penalty
        without_creep = self.multipliers.shear - stiffness * (self.arcs(displacement) - self.start_arcs + travel)
        creepage, touching = self.multipliers.creepage or 0.0, bound > 0
        if touching.any():  # every shear is linear in creepage times travel between its bounds
            trial, limit = without_creep[touching], bound[touching]
            ends = np.sort(np.concatenate([trial - limit, trial + limit])) / stiffness
            sums = np.clip(trial - stiffness * ends[:, None], -limit, limit) @ self.weights[touching]
            creep_travel = float(np.interp(self.tangential_force, sums[::-1], ends[::-1]))
        else:
            creep_travel = creepage * travel
        trial_shear = without_creep - stiffness * creep_travel
        shear, sticking = np.clip(trial_shear, -bound, bound), np.abs(trial_shear) < bound
        # minus the derivatives of the nodal shear by the displacement at constant creepage
        gradient = np.where(sticking, stiffness * self.weights * growth, 0.0)[:, None] * t
        slipping = np.sign(shear) * self.friction * self._penalty_stiffness(normal.pressure)
        gradient += np.where(sticking, 0.0, slipping)[:, None] * n
        geometric = (self.weights * shear * rotation)[:, None, None] * n[:, :, None] * t[:, None, :]
        coupling = None
        if sticking.any():  # the sticking nodes take the loss of the sum of the shears
            share = np.where(sticking, self.weights, 0.0)
            coupling = (share / (self.weights * sticking).sum())[:, None] * t, -gradient
        return replace(
            normal,
            shear=shear,
            forces=normal.forces + (self.weights * shear)[:, None] * t,
            stiffness=normal.stiffness + t[:, :, None] * gradient[:, None, :] + geometric,
            creepage=creep_travel / travel if travel else creepage,
            creep_travel=creep_travel,
            creep_coupling=coupling,
        )

    def normal_contact(self, displacement: Array) -> ContactForces:
        """Return the contact forces of pressure and sliding friction alone.

        Parameters
        ----------
        displacement : ndarray, shape (n, 2)
            Displacement of the nodes [m].
        """
        ratio = 0.0 if self.rotates else self.friction
        n, distance = self._normals(displacement)
        if self.profile == "deformed":
            gap = np.where(n[:, 1] < 0, distance - self.radius, np.inf)  # the upper half of the roller has no contact
        else:
            x = self.coordinates[:, 0] - self.position
            circle = x**2 / (self.radius + np.sqrt(np.maximum(self.radius**2 - x**2, 0)))
            outside = np.where(np.abs(x) < self.radius, circle, np.inf)
            rise = x**2 / (2 * self.radius) if self.profile == "parabola" else outside
            gap = self.bottom_height + rise - self.coordinates[:, 1] - displacement[:, 1]
        t, pressure = _turned(n), np.maximum(self.multipliers.pressure - self.penalty * gap, 0.0)
        direction = n + ratio * t
        stiffness = self._penalty_stiffness(pressure)[:, None, None] * direction[:, :, None] * n[:, None, :]
        # rotation of the normal as the node moves along the roller
        geometric = (self.weights * pressure / distance)[:, None, None]
        stiffness -= geometric * (t - ratio * n)[:, :, None] * t[:, None, :]
        forces = (self.weights * pressure)[:, None] * direction
        return ContactForces(pressure=pressure, shear=ratio * pressure, gap=gap, forces=forces, stiffness=stiffness)

    def profile_slope(self) -> Array:
        """Return dy/dx of the roller above the nodes; 0 for a pressure normal to the circle [-], shape (n,)."""
        x = self.coordinates[:, 0] - self.position
        if self.profile == "deformed":
            return np.zeros_like(x)
        inside = np.abs(x) < self.radius
        root = np.sqrt(np.maximum(self.radius**2 - x**2, MIN_SLOPE_ROOT * self.radius**2))
        return x / self.radius if self.profile == "parabola" else np.where(inside, x / root, 0.0)

    def load_and_resistance(self, contact: ContactForces) -> tuple[float, float]:
        """Return load and resistance [N/m]; a vertical pressure resists on the slope of the roller."""
        x, y = contact.forces.sum(axis=0)
        return float(-y), float(x + np.sum(self.weights * contact.pressure * self.profile_slope()))

    def tangents(self, displacement: Array) -> Array:
        """Return unit vectors along positive friction at nodes displaced by (n, 2) [m], shape (n, 2)."""
        return _turned(self._normals(displacement)[0])

    def require_friction(self, contact: ContactForces, place: str = "") -> None:
        """Require a torque within the friction limit: the creepage of a skidding roller is undetermined."""
        if not self.tangential_force:
            return
        used = abs(self.tangential_force) / (self.friction * (self.weights @ contact.pressure))
        if used >= 1:
            raise RuntimeError(
                f"the roller skids{place}: the torque requires {used:.3g} times the friction limit; reduce the torque"
            )

    def arcs(self, displacement: Array) -> Array:
        """Return the arcs from the lowest point of the roller to nodes displaced by (n, 2) [m], shape (n,)."""
        x, y = (self.coordinates + displacement).T
        if self.profile != "deformed":
            return x - self.position
        return self.radius * np.arctan2(x - self.position, self.bottom_height + self.radius - y)

    def _normals(self, displacement):
        """Return unit vectors from the roller axis to the nodes, and their distances from it; downwards from infinity.

        The pressure is normal to the roller on the deformed surface alone.
        """
        if self.profile != "deformed":
            return np.tile([0.0, -1.0], (len(displacement), 1)), np.inf
        ray = self.coordinates + displacement - np.array([self.position, self.bottom_height + self.radius])
        distance = np.hypot(*ray.T)
        return ray / distance[:, None], distance

    def _penalty_stiffness(self, pressure):
        """Return minus the derivative of the nodal force by the gap [N/m2], shape (n,)."""
        return np.where(pressure > 0, self.penalty * self.weights, 0.0)


def _turned(normals):
    """Return unit vectors turned from the normals by a right angle, along positive friction."""
    return np.stack([-normals[:, 1], normals[:, 0]], axis=-1)
