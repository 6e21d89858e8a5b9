"""Results of a forming process along one roller: load, resistance, density, balances, confined floor and feed sleeves.

The sections under the roller have had 1, 2, ... N strokes, so that the forces of the strokes on one section, in order,
are those along the roller at one instant:

    P = sum_n P_n dz_n,    F = sum_n F_n dz_n,    z_P = sum_n P_n z_n dz_n/P,    M = P (z_P - L/2)

with the length dz_n = v_form T on which stroke n meets its sections, of the last stroke the rest of L. M is the moment
by which the load tilts the roller in its guides.

The confined floor of the resistance is the work of confined compression of the throughput, in closed form:

    F = v_form T h_out w,    w = k_out sum_i c_i int_k_i^k_out s_v(k)/k^2 dk,    s_v = A (f pc(k) + pt) - pt

per roller, with the advance v_form T of the mould per stroke, the height h_out of the product, and the work w per
volume of the product. c_i is the share of grains that enter at the density ratio k_i, as fill or as feed. A rigid-
plastic column follows s_v; the elastic strain of a real one changes w by about 1 %.

The floor neither depends on the roller length nor on the number of strokes nor on the law of the feed: a stroke returns
the elastic work of the one before, and the plastic work of confined mix depends on its densities alone. It is the least
resistance that any model of the process can have, since shear in two dimensions adds to it. It is not for sizing.

A feed sleeve of the width B_T along the travel and the roller length L is a silo whose bottom is the bed. The moving
cart shears the mix that stands in it over the bed. Its walls carry part of the weight (Janssen):

    s_J = g rho D/(4 mu K) [1 - exp(-4 mu K H/D)],    D = 2 B_T L/(B_T + L),    F_s = s_J B_T L tan phi

with the head H, the bulk density rho of the loose mix, the friction mu on the wall, the earth pressure coefficient
K = 1 - sin phi of mix that fills a silo (Jaky), the hydraulic diameter D and the angle of internal friction phi. The
drag is the friction of a silo on a rough bed at rest. It contains no cohesion, and no mix that leaves the sleeve.

References
----------
H. A. Janssen, Versuche ueber Getreidedruck in Silozellen, Z. VDI 39 (1895) 1045-1049; J. Jaky, The coefficient of earth
pressure at rest, J. Soc. Hung. Eng. Arch. 78 (1944) 355-358.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.engines.process.section import FormingProblem, SectionHistory
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.validation import require_fields, require_positive, require_that

QUADRATURE_POINTS = 64  # [-], of Gauss and Legendre over ln(1 - k); the error is below 1e-12 up to k = 0.99
GRAVITY = 9.80665  # [m/s2], standard acceleration of gravity


@dataclass(frozen=True)
class MixFlow:
    """Mix that passes a section in one stroke, as heights of grains over the area that the roller sweeps [m].

    Times the advance of the mould, the length of the stroke and the density of the mix without air it is a mass.

    Parameters
    ----------
    product : float
        Grains in the product.
    fill : float
        Grains that the mould carries in.
    fed : float
        Grains that the strokes take from the sleeves.
    extruded : float
        Grains that are offered, not taken and pushed towards the empty mould, at most the fill.
    retained : float
        Grains that are offered and stay in the sleeves, since no more can be pushed out.
    missing : float
        Grains by which the product is lighter than one of the required density.
    """

    product: float
    fill: float
    fed: float
    extruded: float
    retained: float
    missing: float

    @property
    def residual(self) -> float:
        """Grains of the product over those of fill and feed, less 1 [-]."""
        return self.product / (self.fill + self.fed) - 1


@dataclass(frozen=True, eq=False)
class RollerRow:
    """Forming process of one roller.

    Parameters
    ----------
    history : SectionHistory
        Strokes on one section.
    required_density_ratio : float
        Density ratio that the product should have [-].
    """

    history: SectionHistory
    required_density_ratio: float

    @property
    def problem(self) -> FormingProblem:
        """Machine, mix and feed."""
        return self.history.problem

    @cached_property
    def lengths(self) -> Array:
        """Length of the roller on which each stroke meets its sections [m]; at rest the whole of it in the last."""
        machine = self.problem.machine
        if machine.strokes is not None:
            return np.append(np.zeros(machine.stroke_count - 1), machine.roller_length)
        return machine.advance * machine.stroke_shares

    @property
    def edges(self) -> Array:
        """Ends of these lengths along the roller [m], shape (strokes + 1,)."""
        return np.append(0.0, np.cumsum(self.lengths))

    @property
    def load(self) -> float:
        """Load of the roller [N]."""
        return float(self.history.load @ self.lengths)

    @property
    def resistance(self) -> float:
        """Resistance of the roller [N]."""
        return float(self.history.resistance @ self.lengths)

    @property
    def load_centre(self) -> float:
        """Centre of the load from the edge at the empty mould [m]; the middle of the roller without load."""
        return self.centre_of(self.history.load)

    def centre_of(self, line_load: Array) -> float:
        """Return the centre of the loads of the strokes per unit roller length [N/m], from the empty mould [m]."""
        middle = (self.edges[:-1] + self.edges[1:]) / 2
        load = line_load * self.lengths
        return float(load @ middle / load.sum()) if load.sum() else self.problem.machine.roller_length / 2

    @property
    def load_unevenness(self) -> float:
        """Largest over mean load per unit length [-]; 1 without load."""
        mean = self.load / self.problem.machine.roller_length
        return float(self.history.load[self.lengths > 0].max()) / mean if mean else 1.0

    @property
    def peak_pressure(self) -> float:
        """Largest vertical stress under the roller [Pa]."""
        return float(self.history.peak_pressure.max())

    @property
    def product_height(self) -> float:
        """Height of the product after its elastic recovery [m]."""
        return self.history.of_product("height")

    @property
    def product_density_ratio(self) -> float:
        """Mean density ratio of the product [-]."""
        return self.history.of_product("density_ratio")

    @property
    def bottom_density_ratio(self) -> float:
        """Mean density ratio of the bottom quarter of the product [-]."""
        return self.history.of_product("bottom_density_ratio")

    @property
    def top_density_ratio(self) -> float:
        """Mean density ratio of the top quarter of the product [-]."""
        return self.history.of_product("top_density_ratio")

    @property
    def overpressed_height(self) -> float:
        """Height of the product whose density ratio exceeds 1 [m]: columns close their pores before that."""
        return 0.0

    @cached_property
    def flow(self) -> MixFlow:
        """Grains of product, fill and feed per stroke."""
        history, mean, k = self.history, self.problem.machine.mean_of_product, self.problem.feed.density_ratio
        fill, product = history.states[0].grain_height, history.of_product("grain_height")
        strokes = history.make_up, history.offered - history.make_up
        fed, surplus = (k * mean(float(each[:-1].sum()), float(each.sum())) for each in strokes)
        extruded, lack = min(surplus, fill), self.required_density_ratio / self.product_density_ratio - 1
        return MixFlow(product, fill, fed, extruded, surplus - extruded, max(lack, 0.0) * product)

    @property
    def confined_work(self) -> float:
        """Work of confined compression in closed form per volume of the product [J/m3]; 0 without densification."""
        return self.confined_work_of(self.problem, self.history.rate_factor)

    def confined_work_of(self, problem: FormingProblem, rate_factor: float) -> float:
        """Return the work of confined compression of another mix [J/m3] with the same grains of fill and feed."""
        flow = self.flow
        total = flow.fill + flow.fed
        entries = (flow.fill / total, problem.fill.density_ratio), (flow.fed / total, problem.feed.density_ratio)
        return confined_work(problem.material, entries, self.product_density_ratio, rate_factor)

    @property
    def confined_floor(self) -> float:
        """Confined floor of the resistance of the roller [N]; 0 of a mould at rest."""
        return self.problem.machine.advance * self.product_height * self.confined_work

    @property
    def skew_moment(self) -> float:
        """Moment of the load about the middle of the roller [N m], + towards the finished product."""
        return self.load * (self.load_centre - self.problem.machine.roller_length / 2)

    @property
    def specific_work(self) -> float:
        """Work of the roller per volume of the product [J/m3]; nan of a mould at rest, which yields none."""
        return self.work_per_volume(self.resistance)

    def work_per_volume(self, resistance: float) -> float:
        """Return the work of a resistance [N] per volume of the product [J/m3]; nan of a mould at rest."""
        advance = self.problem.machine.advance
        return resistance / (advance * self.product_height) if advance else float("nan")

    @property
    def strokes_for_density(self) -> float:
        """Strokes after which a section has the required density with this feed [-]; inf if it has not."""
        return self.history.strokes_until(self.required_density_ratio)


def confined_stress(material: Compaction, density_ratio: np.ndarray, rate_factor: float = 1.0) -> np.ndarray:
    """Return the vertical stress of rigid-plastic mix in confined compression [Pa].

    Parameters
    ----------
    density_ratio : ndarray
        Density ratio k [-].
    rate_factor : float
        Factor of the yield pressure [-].
    """
    ratio, strength = material.confined_stress_ratio, material.tensile_strength
    return ratio * (rate_factor * material.yield_pressure(density_ratio) + strength) - strength


def confined_work(
    material: Compaction, entries: Iterable[tuple[float, float]], density_ratio: float, rate_factor: float = 1.0
) -> float:
    """Compute the work of confined compression per volume of the product [J/m3].

    Parameters
    ----------
    entries : iterable of (share, density_ratio)
        Share of the grains of the product [-] and their density ratio at entry [-]; the shares add up to 1.
    density_ratio : float
        Density ratio of the product [-], below 1.
    rate_factor : float
        Factor of the yield pressure [-].

    Returns
    -------
    float
        Work w per volume of the product [J/m3].

    Examples
    --------
    >>> mix = Compaction(unloading_modulus=60e6, poisson=0.3, heckel_slope=13e-6,
    ...                  loose_density_ratio=0.72, critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.75)
    >>> f"{confined_work(mix, [(1.0, 0.75)], 0.98) / 1e3:.2f} kJ/m3"
    '22.21 kJ/m3'
    """
    if not 0 < density_ratio < 1:
        raise ValueError(f"`density_ratio` must lie between 0 and 1, got {density_ratio!r}")
    require_positive(rate_factor=rate_factor)
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    work = 0.0
    for share, entry in entries:
        low, high = -np.log1p(-entry), -np.log1p(-density_ratio)
        u = (low + high) / 2 + (high - low) / 2 * nodes
        k = -np.expm1(-u)
        integrand = confined_stress(material, k, rate_factor) / k**2 * (1 - k)  # dk = (1 - k) du
        work += share * (high - low) / 2 * float(weights @ integrand)
    return density_ratio * work


@dataclass(frozen=True)
class FeedSleeve:
    """Sleeve full of loose mix above the bed.

    Parameters
    ----------
    width : float
        Width B_T along the travel [m].
    length : float
        Length along the roller [m].
    head : float
        Height H of the mix above the bed [m].
    wall_friction : float
        Friction coefficient mu of mix on the wall [-]; 0 for a smooth wall, which carries no weight.
    """

    width: float
    length: float
    head: float
    wall_friction: float

    def __post_init__(self) -> None:
        require_fields(self, positive="width length head", nonnegative="wall_friction")

    def bed_stress(self, bulk_density: float, earth_pressure_coefficient: float) -> float:
        """Compute the vertical stress on the bed [Pa].

        Parameters
        ----------
        bulk_density : float
            Bulk density of the loose mix [kg/m3].
        earth_pressure_coefficient : float
            Lateral over vertical stress [-].

        Examples
        --------
        >>> f"{FeedSleeve(0.18, 1.164, 1.0, 0.35).bed_stress(1700.0, 0.43):.0f} Pa"
        '7382 Pa'
        """
        require_positive(bulk_density=bulk_density, earth_pressure_coefficient=earth_pressure_coefficient)
        diameter = 2 * self.width * self.length / (self.width + self.length)
        decay = 4 * self.wall_friction * earth_pressure_coefficient * self.head / diameter
        carried = -np.expm1(-decay) / decay if decay else 1.0
        return float(GRAVITY * bulk_density * self.head * carried)

    def drag(self, bulk_density: float, friction_angle: float) -> float:
        """Compute the shear force of the bed on the mix of one sleeve [N].

        Parameters
        ----------
        bulk_density : float
            Bulk density of the loose mix [kg/m3].
        friction_angle : float
            Angle of internal friction [deg], between 0 and 90.
        """
        require_that(0 < friction_angle < 90, friction_angle, "`friction_angle` must lie between 0 and 90, got")
        angle = np.radians(friction_angle)
        stress = self.bed_stress(bulk_density, float(1 - np.sin(angle)))
        return float(stress * self.width * self.length * np.tan(angle))
