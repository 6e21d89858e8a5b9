"""Closed-form estimate of the largest depth of a roller in fresh mix, computed before any finite elements.

A prescribed height prescribes the mean exit density. Mix that is not compacted under the roller stays ahead of it as a
bow wave. The wave lengthens the contact until its pressure reaches deep enough. At a contact angle beyond a limit the
roller pushes the mix ahead instead of compacting it, so the depth is limited by

    D = int_0^H [1 - k_in/k(s)] dy,    s = p min(1, f(y) + f(2 H - y)),    A [pc(k(s)) + pt] - pt = s
    f(y) = (2/pi) [atan b + b/(1 + b^2)],  b = L/(2 y),    L = 1.07 R sin(angle)
    p = 1.3 [1 + L/(2 H)] N s_u,    s_u = M (pc(k_in) + pt)/(2 sqrt 3),    N = 1 + pi - t + cos t,  f N = sin t

with A = [1 + sqrt(1 + 4 M^2/9)]/2, the depth y below the surface and the height H of the fed layer. s is the vertical
stress in an elastic half-plane under a uniform pressure p over the length L, with its mirror image at the rigid base.
k(s) is the density ratio in confined compression. p is the bearing capacity of the fresh mix with its plane-strain
shear strength s_u: Prandtl's N = 2 + pi, and Green's for the traction f p of a sliding roller, 2.83 at f = 0.35. From f
= 0.389 on, where the traction reaches s_u, N = 1/f. Free rollers have no traction in the mean.

This is a heuristic with two factors fitted to 47 scenes with a computed steady state: their contact angles reach 35
degrees, the mean pressure of the wide contacts is 1.2 to 2.0 times the bearing capacity, and the largest of their
depths is 0.85 D. Of the 60 random lifts of `studies/random_lifts.py`, all steady, the largest is 0.80 D. The module is
separate because the estimate needs no mesh.

References
----------
L. Prandtl, Ueber die Haerte plastischer Koerper, Nachr. Ges. Wiss. Goettingen (1920) 74-85;
A. P. Green, The plastic yielding of metal junctions due to combined shear and pressure, J. Mech. Phys. Solids 2 (1954)
197-211 (inclined load).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from compact.material.laws import Compaction
from compact.numerics import Array
from compact.rolling_contact import Heaping, HeapingError

if TYPE_CHECKING:
    from compact.engines.compaction.rolling_case import DepthTarget

MAX_CONTACT_ANGLE = np.pi / 4  # [rad], beyond which a roller pushes the mix ahead
LENGTH_RATIO = 1.07  # [-], contact length over that ahead of the lowest generatrix; fitted
BEARING_RATIO = 1.3  # [-], mean pressure over the bearing capacity of a half-plane of fresh mix; fitted
CONFINEMENT = 0.5  # [-], increase of the bearing capacity with contact length over height by the rigid base
LOAD_RATIO = 2.0  # [-], load over pressure times length, with the hardening of the mix
DENSEST_TABULATED = 1.3  # [-], density ratio up to which confined compression is tabulated
TABLE_SIZE = 3000  # [-], points of that table
INTEGRATION_ROWS = 200  # [-], of the integral over the height


@dataclass(frozen=True)
class HeapingEstimate:
    """Limits of depth and load of a roller on a layer of fresh mix.

    Parameters
    ----------
    height : float
        Height of the fed layer, H [m].
    radius : float
        Roller radius, R [m].
    material : Compaction
        Constitutive law.
    contact_angle : float
        Largest contact angle [rad].
    rate_factor : float
        Factor of the yield pressure by the speed [-].
    sliding_friction : float
        Shear traction over pressure of a sliding roller, f [-], 0 for others.
    """

    height: float
    radius: float
    material: Compaction
    contact_angle: float = MAX_CONTACT_ANGLE
    rate_factor: float = 1.0
    sliding_friction: float = 0.0

    @property
    def contact_length(self) -> float:
        """Largest contact length, L [m]."""
        return LENGTH_RATIO * self.radius * np.sin(self.contact_angle)

    @property
    def contact_height(self) -> float:
        """Height of the contact edge above the lowest generatrix at the largest contact angle [m]."""
        return self.radius * (1 - np.cos(self.contact_angle))

    @property
    def bearing_pressure(self) -> float:
        """Mean pressure of the largest contact at the bearing capacity, p [Pa]."""
        material = self.material
        yield_pressure = self.rate_factor * float(material.yield_pressure(material.fed_density_ratio))
        limit = material.critical_slope * (yield_pressure + material.tensile_strength)
        bearing = bearing_factor(self.sliding_friction) * limit / (2 * np.sqrt(3))
        return BEARING_RATIO * (1 + CONFINEMENT * self.contact_length / self.height) * bearing

    @property
    def max_depth(self) -> float:
        """Largest depth that compaction can accommodate, D [m]."""
        edges = np.linspace(0, self.height, INTEGRATION_ROWS + 1)
        y, thickness = (edges[1:] + edges[:-1]) / 2, self.height / INTEGRATION_ROWS
        stress = self.bearing_pressure * np.minimum(self._stress_ratio(y) + self._stress_ratio(2 * self.height - y), 1)
        # density ratios under these vertical stresses in confined compression
        material, fed, strength = self.material, self.material.fed_density_ratio, self.material.tensile_strength
        ratios = np.linspace(material.loose_density_ratio, DENSEST_TABULATED, TABLE_SIZE)
        confined = material.confined_stress_ratio * (self.rate_factor * material.yield_pressure(ratios) + strength)
        compressed = np.interp(stress, confined - strength, ratios)
        return float(np.sum(1 - fed / np.maximum(compressed, fed)) * thickness)

    @property
    def max_load(self) -> float:
        """Largest load of the mix at the bearing capacity [N/m]."""
        return LOAD_RATIO * self.bearing_pressure * self.contact_length

    def _stress_ratio(self, y: Array) -> Array:
        """Vertical stress at a depth y [m] in a half-plane under a unit pressure over the contact length [-]."""
        half = self.contact_length / (2 * y)
        return 2 / np.pi * (np.arctan(half) + half / (1 + half**2))


def bearing_factor(friction: float) -> float:
    """Return the bearing capacity of a half-plane under p and friction times p, over its shear strength, N [-]."""
    if friction * (1 + np.pi / 2) >= 1:
        return 1 / friction
    turn = brentq(lambda t: friction * (1 + np.pi - t + np.cos(t)) - np.sin(t), 0.0, np.pi / 2)
    return float(1 + np.pi - turn + np.cos(turn))


def require_no_heaping(estimate: HeapingEstimate, target: "DepthTarget") -> None:
    """Require a depth or load within the limits of the estimate.

    Parameters
    ----------
    estimate : HeapingEstimate
        Limits of the layer.
    target : DepthTarget
        Prescribed quantity.

    Raises
    ------
    HeapingError
        If the limit is exceeded; the message contains the limit and a remedy from the same estimate.
    """
    name, value, depth = target.quantity, target.value, target.required_depth
    angle, reason = f"{np.degrees(estimate.contact_angle):.3g} degrees", ""
    contact = f"a contact of {angle}, {_millimetres(estimate.contact_length)} long,"
    if name == "load" and value > estimate.max_load:
        reason = (
            f"`load` must be at most about {estimate.max_load:.0f} N/m, the bearing capacity over {contact} before the "
            f"mix heaps up in front of the roller (an estimate), got {value:.0f} N/m; reduce the load or use a larger "
            "roller"
        )
    elif depth is not None and depth > estimate.contact_height:
        reason = (
            f"`{name}` requires a depth of {_millimetres(depth)}, at which the contact angle exceeds {angle} and the "
            f"roller pushes the mix ahead; stay below {_millimetres(estimate.contact_height)} or use a larger roller"
        )
    elif depth is not None and depth > estimate.max_depth:
        given = "" if name == "indentation" else f" {value:.4g}"
        reason = (
            f"`{name}`{given} requires a depth of {_millimetres(depth)}, more than about "
            f"{_millimetres(estimate.max_depth)}: the bearing capacity is about "
            f"{estimate.bearing_pressure / 1e3:.3g} kPa over {contact} which compacts the voids no further, and the "
            "rest heaps up in front of the roller (an estimate); reduce the depth, use a larger roller, or feed the "
            "mix denser (`layer.fed_density_ratio`) or in lifts (`layer.lift_thickness`)"
        )
    if reason:
        raise HeapingError(reason, Heaping(depth, estimate.contact_angle))


def _millimetres(length: float) -> str:
    return f"{1e3 * length:.3g} mm"
