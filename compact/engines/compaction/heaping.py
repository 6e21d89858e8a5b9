"""Estimate of the depth that fresh mix can take up under a roller, before anything is solved.

A height that is prescribed prescribes the mean density that leaves. What the mix under the roller does not take up
stays in front as a bow wave, which lengthens the contact until its pressure reaches deep enough. A contact steeper than
an angle pushes the mix ahead rather than down, so the depth is limited by

    D = int_0^H [1 - k_in/k(s)] dy,    A pc(k(s)) = s = p min(1, f(y) + f(2 H - y)),    A = [1 + sqrt(1 + 4 M^2/9)]/2
    f(y) = (2/pi) [atan b + b/(1 + b^2)],  b = L/(2 y),    L = 1.07 R sin(angle)
    p = 1.3 [1 + L/(2 H)] (2 + pi) s_u,    s_u = M (pc(k_in) + pt)/(2 sqrt 3)

y depth below the surface, H height of the layer as fed. s is the vertical stress of an elastic half-plane under a
uniform pressure p over the length L, with its mirror image at the rigid base; k(s) is the density ratio of confined
compression; p is Prandtl's bearing capacity of the loose mix, whose shear strength in plane strain is s_u.

This is a heuristic. Two numbers are fitted to 47 scenes with a computed steady state: their contacts reach 35 degrees,
the mean pressure of the wide ones is 1.2 to 2.0 times the bearing capacity, and the largest of their depths is 0.85 D.
It stays a module of its own since nothing in it needs a mesh.
"""

from dataclasses import dataclass, replace

import numpy as np

STEEPEST = np.pi / 4  # contact angle [rad]; steeper, a roller pushes more ahead than down
USUAL = np.pi / 9  # contact angle [rad] of which remedies make use; that of most of the lifts that get steady
TRAILING = 1.07  # [-], contact length over that in front of the lowest generatrix
CAPACITY = 1.3  # [-], mean pressure over the bearing capacity of a half-plane of loose mix
CONFINED = 0.5  # [-], increase of that with the contact length over the height: the rigid base confines the mix
LOAD = 2.0  # [-], load over pressure times length, which the mix hardened by compaction may still bear
SURPLUS = 1.2  # [-], of what mix can take up over what it must, where a remedy is computed
SHARES = 200  # [-], parts of a layer, a depth or a range of densities that are tried as remedies
DENSEST = 1.3  # [-], density ratio up to which confined compression is tabulated
ROWS = 200  # [-], of the integral over the height


class HeapingError(RuntimeError):
    """Loose mix would heap up, or heaps up, in front of the roller without end."""


@dataclass(frozen=True)
class Heaping:
    """Limits of the depth and the load of a roller on a layer of fresh mix.

    Parameters
    ----------
    height : of the layer as fed, H [m]
    radius : of the roller, R [m]
    material : Compaction
    steepest : largest contact angle [rad]
    rate_factor : by which the speed raises pc [-]
    """

    height: float
    radius: float
    material: object
    steepest: float = STEEPEST
    rate_factor: float = 1.0

    @property
    def length(self):
        """Longest contact, L [m]."""
        return TRAILING * self.radius * np.sin(self.steepest)

    @property
    def highest(self):
        """Height above the lowest generatrix at which the roller is so steep [m]."""
        return self.radius * (1 - np.cos(self.steepest))

    @property
    def pressure(self):
        """Mean pressure that the mix bears without flowing from under such a contact, p [Pa]."""
        law = self.material
        yields = self.rate_factor * float(law.yield_pressure(law.fed_density_ratio))
        limit = law.critical_slope * (yields + law.tensile_strength)
        bearing = (2 + np.pi) * limit / (2 * np.sqrt(3))
        return CAPACITY * (1 + CONFINED * self.length / self.height) * bearing

    @property
    def depth(self):
        """Largest depth that the mix takes up, D [m]."""
        edges = np.linspace(0, self.height, ROWS + 1)
        y, thickness = (edges[1:] + edges[:-1]) / 2, self.height / ROWS
        stress = self.pressure * np.minimum(self._spread(y) + self._spread(2 * self.height - y), 1)
        loose = self.material.fed_density_ratio
        return float(np.sum(1 - loose / np.maximum(self._confined(stress), loose)) * thickness)

    @property
    def load(self):
        """Largest load that the mix bears under such a contact [N/m]."""
        return LOAD * self.pressure * self.length

    def _spread(self, y):
        half = self.length / (2 * y)
        return 2 / np.pi * (np.arctan(half) + half / (1 + half**2))

    def _confined(self, stress):
        """Density ratio under a vertical stress [Pa] in confined compression."""
        law = self.material
        turned = (1 + np.sqrt(1 + 4 * law.critical_slope**2 / 9)) / 2
        ratios = np.linspace(law.loose_density_ratio, DENSEST, 3000)
        return np.interp(stress, turned * self.rate_factor * law.yield_pressure(ratios), ratios)


def require_no_heaping(heaping, name, value, depth):
    """Raise HeapingError for a depth that the mix cannot take up, or a load that it cannot bear.

    Parameters
    ----------
    heaping : Heaping
    name, value : of what is prescribed: "indentation" [m], "exit_density_ratio" [-] or "load" [N/m]
    depth : that it requires [m], None for a load

    The message has the limit and remedies, each computed by the same estimate.
    """
    contact = f"a contact of {np.degrees(heaping.steepest):.3g} degrees, {_mm(heaping.length)} long,"
    if name == "load" and value > heaping.load:
        raise HeapingError(
            f"`load` must be at most about {heaping.load:.0f} N/m, which the mix bears over {contact} before it heaps "
            f"up in front of the roller (an estimate), got {value:.0f} N/m; prescribe less or take a larger roller"
        )
    if depth is None or depth <= min(heaping.depth, heaping.highest):
        return
    if depth > heaping.highest:
        raise HeapingError(
            f"`{name}` requires a depth of {_mm(depth)}, at which the roller meets the surface at more than "
            f"{np.degrees(heaping.steepest):.3g} degrees and pushes the mix ahead; stay below "
            f"{_mm(heaping.highest)} or take a larger roller"
        )
    rule = f"`indentation` must be at most about {_mm(heaping.depth)}, got {_mm(depth)}"
    if name == "exit_density_ratio":
        rule = f"`exit_density_ratio` {value:.4g} requires {_mm(depth)} of depth, more than about {_mm(heaping.depth)}"
    raise HeapingError(
        f"{rule}: the mix bears about {heaping.pressure / 1e3:.3g} kPa over {contact} which presses no more into its "
        "voids, and the rest heaps up in front of the roller (an estimate); "
        + remedies(heaping, depth, for_density=name == "exit_density_ratio")
    )


def remedies(heaping, depth, *, for_density):
    """Clause with the changes of a scene that each suffice for a depth [m] by the estimate at the USUAL angle.

    for_density : the depth follows from the density that leaves and changes with the density that is fed
    """

    def suffices(depth, **changes):
        return replace(heaping, steepest=min(heaping.steepest, USUAL), **changes).depth >= SURPLUS * depth

    if suffices(depth):
        return "press less deep, feed it in lifts, or take a larger roller"
    height, law, found = heaping.height, heaping.material, []
    shares = np.linspace(1, 0, SHARES, endpoint=False)[1:]
    for share in shares:
        if suffices(share * depth, height=share * height):
            found.append(f"feed it in lifts of at most {share * (height - depth):.2g} m (`layer.lift_thickness`)")
            break
    leaving = law.fed_density_ratio * height / (height - depth)
    for share in shares[::-1] if for_density and leaving < 1 else ():
        ratio = float(law.fed_density_ratio + share * (leaving - law.fed_density_ratio))
        fed_height = (height - depth) * leaving / ratio
        denser = replace(law, fed_density_ratio=ratio)
        if suffices(depth + fed_height - height, height=fed_height, material=denser):
            found.append(f"feed it at a density ratio of {ratio:.3f} or denser (`layer.fed_density_ratio`)")
            break
    for share in shares if not for_density else ():
        if suffices(share * depth):
            found.append(f"press at most {_mm(share * depth)} deep (`contact.indentation`)")
            break
    return "; or ".join(found) or "take a larger roller"


def _mm(length):
    return f"{1e3 * length:.3g} mm"
