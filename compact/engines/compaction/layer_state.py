"""States of a layer by rows from the base up: fresh, compacted, stacked, relaxed at rest."""

from dataclasses import dataclass, replace

import numpy as np

from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.assembly import unit_moduli
from compact.rolling_contact import LowerLift, compaction_rate

MAX_ITERATIONS = 2100  # [-], of the exit state at rest; one as a rule, hundreds if it yields
ELASTIC_ITERATIONS = 2000  # [-], of them with the elastic stiffness, which converge monotonically; then Newton's method
ELASTIC_SHARE = 1e-4  # [-], of the elastic stiffness, added to the tangent of yielding mix, which may be singular
STRESS_TOLERANCE = 1e-9  # [-], stress on horizontal planes at rest over the unloading modulus


@dataclass(frozen=True, eq=False)
class LayerState:
    """Mix ahead of a roller, at rest and uniform along x, by rows from the base up.

    A layer at rest under a free surface has no shear stress on horizontal planes (d s_xy/dy = 0), and the cap has no
    anisotropic memory. The state therefore holds for either direction of the next pass.

    Parameters
    ----------
    heights : ndarray, shape (n,)
        Heights of the rows [m].
    points : MaterialPoint
        Mean states of the rows, without stress on horizontal planes.
    lower : LayerState, optional
        Lift below, bonded to the layer; None on the rigid base.
    """

    heights: Array
    points: cap_plasticity.MaterialPoint
    lower: "LayerState | None" = None

    @property
    def height(self) -> float:
        """Height of the layer [m], without a lower lift."""
        return float(self.heights.sum())

    @property
    def stacked(self) -> "LayerState":
        """Rows of the lower lift and of the layer, as one layer on the rigid base."""
        if self.lower is None:
            return self
        below = self.lower.stacked
        points = below.points.map(lambda *rows: np.concatenate(rows), self.points)
        return LayerState(np.concatenate([below.heights, self.heights]), points)

    def split(self, count: int) -> "LayerState":
        """Return the layer with its lowest rows, a number of them, as lower lift; the inverse of `stacked`."""
        if not count:
            return self

        def part(rows: slice) -> LayerState:
            return LayerState(self.heights[rows], self.points.map(lambda values: values[rows]))

        return replace(part(slice(count, None)), lower=part(slice(count)))

    @property
    def y(self) -> Array:
        """Heights of the row centres above the base [m], shape (n,)."""
        return np.cumsum(self.heights) - self.heights / 2

    @property
    def density_ratio(self) -> float:
        """Mean density ratio over the height [-]."""
        return float(self.heights @ self.points.density_ratio / self.height)

    def solid_height(self, material: Compaction) -> float:
        """Return the height filled by solids and water [m].

        The elastic volume strain of mix under pressure adds to its density ratio.

        Parameters
        ----------
        material : Compaction
            Constitutive law.
        """
        return float(self.heights @ self.points.density_under_load(material))

    def with_lift(self, lift_thickness: float, material: Compaction) -> "LayerState":
        """Return the layer with a lift of fresh mix on top.

        Parameters
        ----------
        lift_thickness : float
            Thickness of the lift [m].
        material : Compaction
            Constitutive law with the fed density ratio.
        """
        lift = cap_plasticity.initial_state(material, 1)
        covered = LayerState(np.array([lift_thickness]), lift, replace(self, lower=None)).stacked
        return replace(covered, lower=self.lower)

    @property
    def density_rows(self) -> Array:
        """Heights [m] and density ratios [-] of all rows, those of the lower lift first, shape (2, n)."""
        return np.stack([self.stacked.heights, self.stacked.points.density_ratio])

    def resampled(self, heights: Array, material: Compaction) -> "LayerState":
        """Return the layer by rows of other heights [m]; sums over the height are conserved, of solids, not of k."""
        points = self.points.map(lambda values: _conservative_means(values, self.heights, heights))
        solids = _conservative_means(self.points.density_under_load(material), self.heights, heights)
        ratio = points.density_ratio * solids / points.density_under_load(material)
        # the preconsolidation density ratio is at least the density ratio
        densest = np.maximum(points.max_density_ratio, ratio)
        return LayerState(heights, replace(points, density_ratio=ratio, max_density_ratio=densest), self.lower)


def fresh_layer(material: Compaction, heights: Array) -> LayerState:
    """Return a layer of fresh mix.

    Parameters
    ----------
    material : Compaction
        Constitutive law with the fed density ratio.
    heights : ndarray, shape (n,)
        Heights of the rows [m].

    Returns
    -------
    LayerState
    """
    return LayerState(heights, cap_plasticity.initial_state(material, len(heights)))


def compacted_lift(lift: LowerLift, material: Compaction, rate_factor: float = 1.0) -> LayerState:
    """Return the state of a lower lift before the pass, in one row.

    Parameters
    ----------
    lift : LowerLift
        Thickness, density ratio and residual stress.
    material : Compaction
        Constitutive law.
    rate_factor : float
        Factor of the yield pressure by the speed of the earlier pass [-].
    """
    points = cap_plasticity.compacted_state(
        material, lift.density_ratio, rate_factor, residual_stress=lift.residual_stress
    )
    return LayerState(np.array([lift.thickness]), points)


def _conservative_means(values, old, new):
    """Means over new rows of values that are linear within the old rows and conserve their means.

    A slope is the smaller one to the two neighbours, and 0 at an extremum or an end (minmod limiter). Fresh mix on
    compacted mix thus causes no overshoot.
    """
    shape = (-1,) + (1,) * (values.ndim - 1)
    edges = np.concatenate([[0.0], np.cumsum(old)])
    slopes = np.diff(values, axis=0) / np.diff((edges[1:] + edges[:-1]) / 2).reshape(shape)
    down, up = slopes[:-1], slopes[1:]
    slope = np.zeros_like(values)
    slope[1:-1] = np.where(down * up > 0, np.sign(up) * np.minimum(abs(down), abs(up)), 0.0)
    below = np.concatenate([0 * values[:1], np.cumsum(values * old.reshape(shape), axis=0)])

    ends = np.concatenate([[0.0], np.cumsum(new)]) * (edges[-1] / np.sum(new))
    row = np.clip(np.searchsorted(edges, ends, side="right") - 1, 0, len(old) - 1)
    into = (ends - edges[row]).reshape(shape)
    sums = below[row] + values[row] * into + slope[row] * into * (into - old[row].reshape(shape)) / 2
    return np.diff(sums, axis=0) / np.diff(ends).reshape(shape)


def rate_factor_at(
    material: Compaction, radius: float, height: float, depth: float, speed: float, fed_layer: LayerState | None = None
) -> float:
    """Compute the factor of the yield pressure by the rate of compaction, see `rolling_contact.compaction_rate` [-].

    Parameters
    ----------
    material : Compaction
        Constitutive law.
    radius : float
        Roller radius [m].
    height, depth : float
        Height of the layer before the pass and depth of the lowest generatrix below it [m].
    speed : float
        Speed of the roller [m/s].
    fed_layer : LayerState, optional
        Layer of an earlier pass; fresh mix by default.
    """
    fed_height = height
    if fed_layer is not None:
        fed_height *= fed_layer.density_ratio / material.fed_density_ratio
    depth = min(depth + fed_height - height, fed_height * (1 - material.fed_density_ratio))  # a lower lift settles too
    return material.rate_factor(compaction_rate(speed, radius, fed_height, depth))


def relax_rows(
    solid: FiniteStrainSolid, points: cap_plasticity.MaterialPoint, strain_along: Array
) -> tuple[cap_plasticity.MaterialPoint, Array]:
    """Strain rows of mix along x, and across until their horizontal planes have no stress.

    Parameters
    ----------
    solid : FiniteStrainSolid
        Solid with the constitutive law.
    points : MaterialPoint
        States of the rows.
    strain_along : ndarray, shape (n,)
        Strain along x [-].

    Returns
    -------
    points : MaterialPoint
        States at rest.
    volume_ratio : ndarray, shape (n,)
        Volumes over those before [-].

    Raises
    ------
    RuntimeError
        If the iteration does not converge.
    """
    strain, material = np.zeros((len(strain_along), 3)), solid.material
    strain[:, 0] = strain_along
    two_shear, _, shear, lame = material.unloading_modulus * unit_moduli(material.poisson)
    elastic = np.diag([two_shear + lame, shear])
    for iteration in range(MAX_ITERATIONS):
        rest, tangent = cap_plasticity.integrate_points(
            material, points, strain, solid.rate_factor, tangent=iteration >= ELASTIC_ITERATIONS
        )
        if np.abs(rest.stress[:, [1, 3]]).max() < STRESS_TOLERANCE * material.unloading_modulus:
            released = rest.stress[:, 1] / 3 / material.bulk_modulus  # volume strain of the stress that is left
            rest.stress[:, [1, 3]] = 0.0
            return rest, np.exp(strain[:, 0] + strain[:, 1] - released)
        stiffness = elastic if tangent is None else tangent[:, 1:, 1:] + ELASTIC_SHARE * elastic
        strain[:, 1:] -= np.linalg.solve(stiffness, rest.stress[:, [1, 3], None])[..., 0]
    raise RuntimeError(
        f"the exit column has no equilibrium at rest: {np.abs(rest.stress[:, [1, 3]]).max():.3g} Pa on horizontal "
        f"planes after {MAX_ITERATIONS} iterations; reduce the depth"
    )
