"""One pass of a roller over stacked columns: loading under the front, unloading behind, load, resistance and work.

    P = int s_v dx,    F = int s_v gap' dx

Both integrals are components of the differential equation in `column_ode`. The pass is integrated from the front edge
to the lowest generatrix and from there to the rear edge, where s_v = 0. On the way to the rear edge the coordinate u
increases from zero; on the way to the lowest generatrix it decreases to zero.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from compact.engines.column import column_ode as ode
from compact.engines.column.column_ode import STRESS, ColumnStack, GapShape, PathControl
from compact.engines.column.table_columns import isotropic_limits, moduli
from compact.material.cap_plasticity import kernel_constants
from compact.material.density_cap_return import TableConstants
from compact.material.elliptic_cap import CapConstants
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.validation import require_fields

SAMPLED_STEP_SHARE = 1 / 32  # [-], largest step over the front of a pass whose pressure is returned at every step
INDENTATION_SHARE_MAX = 1 - 1e-9  # [-], of the limit of the indentation; the last pore cannot be closed
REBOUND_SHARE_MAX = 2.0  # [-], rise of the gap behind the roller over the indentation, in which unloading must end
STIFFNESS_RATIO_MAX = 2e5  # [-], largest `stiffness_ratio` that is integrated; one step covers 6 of it
STRAINS = {
    "logarithmic": ode.LOGARITHMIC,
    "small": ode.SMALL,
    "mass-true": ode.MASS_TRUE,
}  # strain measures by their names
PLATE = GapShape(0.0, 0.0)
PATH_ROWS_INITIAL = 128  # [-], rows of a path, doubled on demand; room for all steps would cost more than most steps
STEPS_PER_CALL = 20_000  # [-], steps in one compiled call over the number of columns; at most 0.1 s to an interrupt
FAILURES = {
    ode.STEPS_EXHAUSTED: "more steps are needed",
    ode.STEP_UNDERFLOW: "shorter steps do not change x",
    ode.EVENT_NOT_LOCATED: "the stress at which a column yields was not located",
}


@dataclass(frozen=True)
class Column:
    """Mix at rest between two passes, free of vertical stress and confined laterally.

    Parameters
    ----------
    height : float
        Height [m], > 0.
    density_ratio : float
        Density ratio k [-], 0 < k < 1.
    lateral_stress : float
        Lateral stress s_h [Pa], positive in compression.
    max_density_ratio : float
        Largest density ratio reached [-], which fixes pc if it exceeds `density_ratio`.
    """

    height: float
    density_ratio: float
    lateral_stress: float = 0.0
    max_density_ratio: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, positive="height density_ratio", nonnegative="max_density_ratio", finite="lateral_stress")
        if not self.density_ratio < 1:
            raise ValueError(f"`density_ratio` must be below 1, got {self.density_ratio!r}")


@dataclass(frozen=True)
class ColumnLayer:
    """Columns in front of a roller, with the material law and the gap.

    Parameters
    ----------
    law : CapConstants or TableConstants
        Material constants; with `law_at` those at the largest indentation.
    strain_measure : int
        One of the values of STRAINS.
    lower_count : int
        Number of columns of the lower lift, from the base upwards; 0 on the rigid base.
    law_at : callable, optional
        Material constants at an indentation [m], for mix whose yield pressure depends on the rate of compaction.
    """

    law: CapConstants | TableConstants
    stack: ColumnStack
    gap: GapShape
    strain_measure: int
    lower_count: int = 0
    law_at: Callable[[float], CapConstants | TableConstants] | None = None

    @property
    def without_lower(self) -> "ColumnLayer":
        """Columns without those of the lower lift."""
        rows = (values[self.lower_count :] for values in self.stack)
        return replace(self, stack=ColumnStack(*rows), lower_count=0)

    @cached_property
    def height(self) -> float:
        """Height of the layer with the lower lift [m]."""
        return float(self.stack.height.sum())

    @cached_property
    def solid_height(self) -> float:
        """Height that grains and water fill [m]."""
        return float(self.stack.density_ratio @ self.stack.height)

    @property
    def unstressed_solid_height(self) -> float:
        """Height that grains and water fill after release of the lateral stress [m]; passes do not change it."""
        return float(self.stack.density_ratio * np.exp(self.stack.initial_strain) @ self.stack.height)

    @property
    def max_indentation(self) -> float:
        """Indentation [m] just short of full density, or of the axis of the circle."""
        limit = self.gap.radius if self.limited_by_axis else self.height - self.solid_height
        return INDENTATION_SHARE_MAX * limit

    @property
    def limited_by_axis(self) -> bool:
        """True if the circle sinks to its axis before all pores are closed."""
        return bool(self.gap.circular) and self.gap.radius < self.height - self.solid_height

    @property
    def initial_state(self) -> Array:
        """State vector y before the pass."""
        y = np.zeros(ode.COLUMN_STATE + 2 * len(self.stack.height))
        y[ode.COLUMN_STATE :: 2] = self.stack.mean_stress
        return y

    @property
    def stiffness_ratio(self) -> float:
        """Stiffness of the differential equation up to full density [-], an upper bound over the columns."""
        if isinstance(self.law, TableConstants):
            return 0.0  # no measured powder is as stiff
        return max(ode.stiffness_ratio(self.law, k) for k in self.stack.density_ratio.tolist())

    @property
    def oedometric_modulus(self) -> float:
        """Elastic modulus in confined compression [Pa]."""
        bulk, shear = moduli(self.law, self._densest)
        return float(bulk + 4 * shear / 3)

    @property
    def _densest(self) -> float:
        """Largest density ratio of the columns so far [-]."""
        return max(*self.stack.density_ratio.tolist(), *self.stack.max_density_ratio.tolist())

    @property
    def max_elastic_expansion(self) -> float:
        """Upper bound of the elastic volume strain released beyond the initial state, under lateral tension [-]."""
        densest = self._densest
        strength = isotropic_limits(self.law, densest)[1]
        return float((strength + max(0.0, float(self.stack.mean_stress.max()))) / moduli(self.law, densest)[0])

    def edge(self, depth: float) -> float:
        """Return x [m] at which the gap has risen by `depth` [m] above the lowest generatrix."""
        R, c = self.gap
        return math.sqrt(depth * (2 * R - c * depth)) if R else depth

    def front(self, depth: float) -> float:
        """Return the coordinate u [m] at which the gap has risen by `depth` [m]."""
        R, c = self.gap
        return 2 * R * math.sqrt(depth / (2 * R - c * depth)) if R else depth

    def positions(self, u: Array) -> Array:
        """Return x [m] of coordinates u [m]."""
        R, c = self.gap
        return u / (1 + c * (u / (2 * R)) ** 2) if R else u

    def stress_estimate(self, depth: float) -> float:
        """Estimate the vertical stress [Pa] at the lowest generatrix for an indentation `depth` [m]."""
        densest = max(max(self.stack.density_ratio.tolist()), self.solid_height / (self.height - depth))
        pressure, strength, _ = isotropic_limits(self.law, densest)
        return min(self.oedometric_modulus * -math.log1p(-depth / self.height), pressure + strength)

    def error_scale(self, depth: float, rtol: float) -> Array:
        """Return the error of each component of y allowed in one step, relative to its size at a depth [m]."""
        stress = self.stress_estimate(depth)
        of_columns = [stress, -math.log1p(-depth / self.height)] * len(self.stack.height)
        return rtol * np.array([stress, stress * self.edge(depth), *[stress * depth] * 3, *of_columns])

    def density_ratios(self, y: Array) -> Array:
        """Return the density ratio [-] of each column for a state vector."""
        V, k0 = y[ode.COLUMN_STATE + 1 :: 2], self.stack.density_ratio
        return k0 / (1 - V) if self.strain_measure == ode.MASS_TRUE else k0 * np.exp(V)

    def elastic_strains(self, y: Array) -> Array:
        """Return the elastic volume strain [-] of each column since the start of the pass."""
        mean = y[ode.COLUMN_STATE :: 2]
        if isinstance(self.law, TableConstants):
            densest = np.maximum(self.density_ratios(y), self.stack.max_density_ratio)
            return mean / moduli(self.law, densest)[0] - self.stack.initial_strain
        return (mean - self.stack.mean_stress) / self.law.K

    def heights(self, y: Array) -> Array:
        """Return the height [m] of each column for a state vector."""
        strain = y[ode.COLUMN_STATE + 1 :: 2] + self.elastic_strains(y)
        return self.stack.height * (np.exp(-strain) if self.strain_measure == ode.LOGARITHMIC else 1 - strain)

    def integrate(self, u: float, y: Array, control: PathControl) -> tuple[Array, "ColumnLayer", int]:
        """Integrate the columns from a coordinate u [m] and a state vector along a path.

        Returns the rows (u, y) of all steps, the same columns with their largest density ratios at the end, and the
        number of evaluations of the rates.
        """
        n = len(self.stack.height)
        path, counts = np.empty((PATH_ROWS_INITIAL, len(y) + 1)), np.array([0, 0, 0, -1])
        densest = self.stack.max_density_ratio.copy()
        regime = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        state = ode.IntegrationState(densest, *regime, np.empty(n), np.zeros(1), counts)
        path[0, 0], path[0, 1:] = u, y
        problem = self.law, self.stack, self.gap, self.strain_measure
        max_tries, status = max(STEPS_PER_CALL // n, 1), ode.PAUSED
        while status == ode.PAUSED:  # a keyboard interrupt is raised between two calls
            status = ode.integrate_path(problem, control, state, path, max_tries)
            if status == ode.PAUSED and state.counts[ode.ROW] + 1 == len(path):
                path = np.concatenate([path, np.empty_like(path)])
        path = path[: state.counts[ode.ROW] + 1]
        if status != ode.REACHED:
            x, x_end, x_start = self.positions(np.array([path[-1, 0], control.coordinate_end, u])).tolist()
            raise RuntimeError(
                f"the integration of the columns stopped after {state.counts[ode.STEPS_TRIED]} steps at x {x:.6g} m "
                f"between {x_start:.6g} and {x_end:.6g} m, vertical stress {path[-1, 1]:.6g} Pa: {FAILURES[status]}; "
                "reduce the indentation or the `unloading_modulus`"
            )
        after = replace(self, stack=self.stack._replace(max_density_ratio=state.max_density_ratio))
        return path, after, int(state.counts[ode.EVALUATIONS])

    def compute_pass(self, indentation: float, rtol: float, max_step_share: float = np.inf) -> "PassResult":
        """Compute the pass at an indentation [m] with an error of a step and a largest step over the front [-]."""
        layer = self if self.law_at is None else replace(self, law=self.law_at(indentation))
        front = layer.front(indentation)
        control = PathControl(0.0, np.inf, layer.error_scale(indentation, rtol), front * max_step_share)
        loading, pressed, evaluations = layer.integrate(front, layer.initial_state, control)
        return pressed.unload(loading, indentation, control, evaluations)

    def unload(self, loading: Array, indentation: float, control: PathControl, evaluations: int) -> "PassResult":
        """Compute the unloading behind the lowest generatrix at an indentation [m], after the path of loading."""
        rise = REBOUND_SHARE_MAX * indentation
        end = self.front(min(rise, self.gap.radius) if self.gap.circular else rise)
        control = control._replace(coordinate_end=end, stress_end=0.0)
        unloading, after, more = self.integrate(0.0, loading[-1, 1:], control)
        if unloading[-1, 1 + STRESS] > 0:
            x_end = float(self.positions(np.array(end)))
            raise RuntimeError(
                f"the rebound does not end: a vertical stress of {unloading[-1, 1]:.6g} Pa remains "
                f"{x_end:.6g} m behind the lowest generatrix at an indentation of {indentation:.6g} m; "
                "use a stiffer mix or a smaller indentation"
            )
        return PassResult(after, indentation, loading, unloading, evaluations + more)


@dataclass(frozen=True)
class PassResult:
    """Pass of a roller over a `ColumnLayer`.

    Parameters
    ----------
    layer : ColumnLayer
        Columns with their initial heights and their largest density ratios after the pass.
    indentation : float
        Indentation of the lowest generatrix [m].
    loading, unloading : ndarray
        Paths (u, y) from the front edge to the lowest generatrix, and from there to the rear edge.
    evaluations : int
        Number of evaluations of the rates.
    """

    layer: ColumnLayer
    indentation: float
    loading: Array
    unloading: Array
    evaluations: int

    @property
    def load(self) -> float:
        """Load P [N/m]; the integral under the front is negative, where u decreases."""
        return float(self.unloading[-1, 1 + ode.LOAD_INTEGRAL] - 2 * self.loading[-1, 1 + ode.LOAD_INTEGRAL])

    @property
    def resistance(self) -> float:
        """Resistance F [N/m]."""
        return -float(self.unloading[-1, 1 + ode.RESISTANCE_INTEGRAL])

    @property
    def peak_pressure(self) -> float:
        """Vertical stress at the lowest generatrix [Pa]."""
        return float(self.loading[-1, 1 + STRESS])

    @property
    def work(self) -> tuple[float, float]:
        """Plastic work and remaining elastic energy of the columns per unit length of travel [N/m]."""
        return float(self.unloading[-1, 1 + ode.PLASTIC_WORK]), float(self.unloading[-1, 1 + ode.ELASTIC_WORK])

    @property
    def density_ratio(self) -> float:
        """Density ratio after the rebound [-], mean over the height without the lower lift."""
        y, layer = self.unloading[-1, 1:], slice(self.layer.lower_count, None)
        heights = self.layer.heights(y)[layer]
        return float(self.layer.density_ratios(y)[layer] @ heights / heights.sum())

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns after the pass with those of the lower lift, from the base upwards."""
        y, layer = self.unloading[-1, 1:], self.layer
        lateral_stress = 1.5 * y[ode.COLUMN_STATE :: 2]
        rows = (layer.heights(y), layer.density_ratios(y), lateral_stress, layer.stack.max_density_ratio)
        return tuple(Column(*values) for values in np.array(rows).T.tolist())

    @property
    def mass_residual(self) -> float:
        """Relative excess of the height needed by the mass over the height at the lowest generatrix [-]."""
        y, stack = self.loading[-1, 1:], self.layer.stack
        solid = stack.density_ratio * stack.height
        needed = solid / self.layer.density_ratios(y) * np.exp(-self.layer.elastic_strains(y))
        return float(needed.sum() / (self.layer.height - self.indentation) - 1)


def column_layer(
    columns: tuple[Column, ...],
    material: Compaction,
    rate_factor: float,
    gap: GapShape,
    strain_measure: int,
    lower_count: int = 0,
) -> ColumnLayer:
    """Build the `ColumnLayer` of columns at rest.

    Parameters
    ----------
    columns : tuple of Column
        Columns from the base upwards.
    material : Compaction
        Constitutive law.
    rate_factor : float
        Factor of pc [-].
    gap : GapShape
        Gap between roller and layer.
    strain_measure : int
        Measure of the strain, as of `column_ode`.
    lower_count : int
        Number of columns of a lower lift.

    Returns
    -------
    ColumnLayer
    """
    rows = [(each.height, each.density_ratio, each.lateral_stress, each.max_density_ratio) for each in columns]
    height, density_ratio, lateral_stress, max_density_ratio = np.array(rows, dtype=float).T.copy()
    law, mean_stress = kernel_constants(material, rate_factor), lateral_stress / 1.5
    strain = mean_stress / moduli(law, np.maximum(density_ratio, max_density_ratio))[0]
    stack = ColumnStack(height, density_ratio, mean_stress, max_density_ratio, strain)
    return ColumnLayer(law, stack, gap, strain_measure, lower_count)
