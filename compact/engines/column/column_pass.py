"""One pass of a roller over stacked columns: loading under the front, unloading behind, and the prescribed quantity.

    P = int s_v dx,    F = int s_v gap' dx

Both integrals are components of the differential equation in `column_ode`. The pass is integrated from the front edge
to the lowest generatrix and from there to the rear edge, where s_v = 0. On the way to the rear edge the coordinate u
increases from zero; on the way to the lowest generatrix it decreases to zero.

Load, peak pressure and density ratio rise with the indentation. Brent's method finds the indentation of a prescribed
one over the logarithms of both, in which they are nearly proportional.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple, NoReturn

import numpy as np
from scipy.optimize import brentq

from compact.engines.column import column_ode as ode
from compact.engines.column.column_ode import STRESS, ColumnStack, GapShape, PathControl
from compact.material.elliptic_cap import CapConstants, cap_constants, hardening, reaction
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.validation import require_finite, require_nonnegative, require_positive, require_that
from compact.quantities import CONTACT
from compact.rolling_contact import Contact, resistance_scale

SAMPLED_STEP_SHARE = 1 / 32  # [-], largest step over the front of a pass whose pressure is returned at every step
INDENTATION_SHARE_MAX = 1 - 1e-9  # [-], of the limit of the indentation; the last pore cannot be closed
REBOUND_SHARE_MAX = 2.0  # [-], rise of the gap behind the roller over the indentation, in which unloading must end
PLATE = GapShape(0.0, 0.0)
PATH_ROWS = 256  # [-], rows by which a path grows on demand, hence of one compiled call; 50 are usual
TARGET_TOLERANCE = 10.0  # [-], residual of a prescribed quantity that is guaranteed, over `rtol`
SEARCH_TOLERANCE = 0.02  # [-], relative error of the indentation that is sought, over `rtol`
ESTIMATE_TOLERANCE = 1e-3  # [-], relative error of the stress for an error scale and a first guess
MEAN_STRESS_SHARE = 0.8  # [-], mean over peak stress under the front, for the first guess of a load
OVERSHOOT = 1.2  # [-], of the first step from that guess, so that it brackets the indentation
FAILURES = {
    ode.STEPS_EXHAUSTED: "more steps are needed, as for nearly rigid mix",
    ode.STEP_UNDERFLOW: "shorter steps do not change x",
    ode.EVENT_NOT_LOCATED: "the stress at which a column yields was not located",
}


class Column(NamedTuple):
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


def grain_height(column: Column, bulk_modulus: float) -> float:
    """Return the mass of grains of a column at rest as a height [m]."""
    return column.density_ratio * column.height * float(np.exp(column.lateral_stress / 1.5 / bulk_modulus))


class Columns(NamedTuple):
    """Columns behind a pass, from the base upwards: of the layer, and of its lower lift."""

    layer: tuple[Column, ...]
    lower: tuple[Column, ...] = ()

    def with_lift(self, thickness: float, material: Compaction) -> "Columns":
        """Return the columns under fresh mix of a thickness [m]."""
        return self._replace(layer=(*self.layer, Column(thickness, material.fed_density_ratio)))

    @property
    def density_rows(self) -> Array:
        """Heights [m] and density ratios [-], shape (2, n)."""
        return np.array((*self.lower, *self.layer)).T[:2]


@dataclass(frozen=True)
class ColumnLayer:
    """Columns in front of a roller, with the material law and the gap.

    Parameters
    ----------
    law : CapConstants
        Material constants; with `law_at` those at the largest indentation.
    logarithmic : bool
        True for logarithmic strains, False for small ones.
    lower_count : int
        Number of columns of the lower lift, from the base upwards; 0 on the rigid base.
    law_at : callable, optional
        Material constants at an indentation [m], for mix whose yield pressure depends on the rate of compaction.
    """

    law: CapConstants
    stack: ColumnStack
    gap: GapShape
    logarithmic: bool = True
    lower_count: int = 0
    law_at: Callable[[float], CapConstants] | None = None

    @cached_property
    def height(self) -> float:
        """Height of the layer with the lower lift [m]."""
        return float(self.stack.height.sum())

    @cached_property
    def solid_height(self) -> float:
        """Height that grains and water fill [m]."""
        return float(self.stack.density_ratio @ self.stack.height)

    @property
    def max_indentation(self) -> float:
        """Indentation [m] just short of full density, or of the axis of the circle."""
        pores = self.height - self.solid_height
        return INDENTATION_SHARE_MAX * (min(self.gap.radius, pores) if self.gap.circular else pores)

    @property
    def limit(self) -> str:
        """Reason why no indentation is larger."""
        if self.gap.circular and self.gap.radius < self.height - self.solid_height:
            return "the circle is buried to its axis"
        return f"grains and water alone fill the remaining {self.solid_height:.6g} m of {self.height:.6g} m"

    @property
    def loosest(self) -> float:
        """Density ratio before the pass [-], mean over the height without the lower lift."""
        heights, ratios = (values[self.lower_count :] for values in (self.stack.height, self.stack.density_ratio))
        return float(ratios @ heights / heights.sum())

    @property
    def initial_state(self) -> Array:
        """State vector y before the pass."""
        y = np.zeros(ode.COLUMN_STATE + 2 * len(self.stack.height))
        y[ode.COLUMN_STATE :: 2] = self.stack.mean_stress
        return y

    def stress_estimate(self, depth: float) -> float:
        """Estimate the vertical stress [Pa] at the lowest generatrix for an indentation [m].

        It is the strength at the density ratio that the elastic strain leaves.
        """
        densest = max(max(self.stack.density_ratio.tolist()), self.solid_height / (self.height - depth))
        stiffness = float(self.law.K + 4 * self.law.G / 3)

        def rest(stress: float) -> float:
            k = densest * math.exp(-stress / stiffness)
            return hardening(self.law, k)[0] + reaction(self.law, k)[0] + self.law.pt - stress

        elastic = stiffness * -math.log1p(-depth / self.height)
        return elastic if rest(elastic) >= 0 else float(brentq(rest, 0.0, elastic, rtol=ESTIMATE_TOLERANCE))

    def estimate(self, name: str, depth: float) -> float:
        """Estimate a load [N/m], peak pressure [Pa] or exit density ratio [-] for an indentation [m]."""
        if name == "exit_density_ratio":
            return self.loosest / (1 - depth / self.height)
        stress = self.stress_estimate(depth)
        return stress if name == "peak_pressure" else MEAN_STRESS_SHARE * stress * self.gap.edge(depth)

    def error_scale(self, depth: float, rtol: float) -> Array:
        """Return the error of each component of y allowed in one step, relative to its size at a depth [m]."""
        stress = self.stress_estimate(depth)
        of_columns = [stress, -math.log1p(-depth / self.height)] * len(self.stack.height)
        return rtol * np.array([stress, stress * self.gap.edge(depth), *[stress * depth] * 3, *of_columns])

    def elastic_strains(self, y: Array) -> Array:
        """Return the elastic volume strain [-] of each column since the start of the pass."""
        return (y[ode.COLUMN_STATE :: 2] - self.stack.mean_stress) / self.law.K

    def density_ratios(self, y: Array) -> Array:
        """Return the density ratio [-] of each column for a state vector."""
        return self.stack.density_ratio * np.exp(y[ode.COLUMN_STATE + 1 :: 2])

    def heights(self, y: Array) -> Array:
        """Return the height [m] of each column for a state vector."""
        strain = y[ode.COLUMN_STATE + 1 :: 2] + self.elastic_strains(y)
        return self.stack.height * (np.exp(-strain) if self.logarithmic else 1 - strain)

    def integrate(self, u: float, y: Array, control: PathControl) -> tuple[Array, "ColumnLayer", int]:
        """Integrate the columns from a coordinate u [m] and a state vector along a path.

        Returns the rows (u, y) of all steps, the same columns with their largest density ratios at the end, and the
        number of evaluations of the rates.
        """
        n = len(self.stack.height)
        path, counts = np.empty((PATH_ROWS, len(y) + 1)), np.zeros(3, np.int64)
        largest = np.maximum(self.stack.max_density_ratio, self.stack.density_ratio if self.law.flat else 0.0)
        state = ode.IntegrationState(largest, np.zeros(n, np.int64), np.empty(n), np.zeros(1), counts)
        path[0, 0], path[0, 1:] = u, y
        problem = self.law, self.stack, self.gap, self.logarithmic
        while (status := ode.integrate_path(problem, control, state, path)) == ode.PAUSED:
            path = np.concatenate([path, np.empty_like(path[:PATH_ROWS])])  # where a keyboard interrupt is raised
        path = path[: counts[ode.ROW] + 1]
        if status != ode.REACHED:
            x, x_end, x_start = self.gap.positions(np.array([path[-1, 0], control.coordinate_end, u])).tolist()
            raise RuntimeError(
                f"the integration of the columns stopped after {counts[ode.STEPS_TRIED]} steps at x {x:.6g} m "
                f"between {x_start:.6g} and {x_end:.6g} m, vertical stress {path[-1, 1]:.6g} Pa: {FAILURES[status]}; "
                "reduce the indentation or the `unloading_modulus`"
            )
        after = replace(self, stack=self.stack._replace(max_density_ratio=state.max_density_ratio))
        return path, after, int(counts[ode.EVALUATIONS])

    def compute_pass(self, indentation: float, rtol: float, max_step_share: float = np.inf) -> Contact:
        """Compute the contact along +x at an indentation [m], without an error estimate.

        Parameters
        ----------
        rtol : float
            Error of a step over the size of the whole pass [-].
        max_step_share : float
            Largest step over the front [-].
        """
        layer = self if self.law_at is None else replace(self, law=self.law_at(indentation))
        gap, rise = layer.gap, REBOUND_SHARE_MAX * indentation
        front, rear = gap.front(indentation), gap.front(min(rise, gap.radius) if gap.circular else rise)
        control = PathControl(0.0, np.inf, layer.error_scale(indentation, rtol), front * max_step_share)
        loading, pressed, evaluations = layer.integrate(front, layer.initial_state, control)
        control = control._replace(coordinate_end=rear, stress_end=0.0)
        unloading, after, more = pressed.integrate(0.0, loading[-1, 1:], control)
        if unloading[-1, 1 + STRESS] > 0:
            raise RuntimeError(
                f"the rebound does not end: a vertical stress of {unloading[-1, 1]:.6g} Pa remains "
                f"{float(gap.positions(np.array(rear))):.6g} m behind the lowest generatrix at an indentation of "
                f"{indentation:.6g} m; use a stiffer mix or a smaller indentation"
            )
        lowest, y, evaluations = loading[-1, 1:], unloading[-1, 1:], evaluations + more
        unloading[:, 0] *= -1
        path = np.concatenate([unloading[::-1], loading[-2::-1]])  # from the rear to the front edge
        x, heights, ratios = gap.positions(path[:, 0]), layer.heights(y), layer.density_ratios(y)
        # the integral under the front is negative, where u decreases
        load = float(y[ode.LOAD_INTEGRAL] - 2 * lowest[ode.LOAD_INTEGRAL])
        resistance = -float(y[ode.RESISTANCE_INTEGRAL])
        plastic, elastic = y[[ode.PLASTIC_WORK, ode.ELASTIC_WORK]].tolist()
        columns = np.array([heights, ratios, 1.5 * y[ode.COLUMN_STATE :: 2], after.stack.max_density_ratio]).T.tolist()
        below, fresh = slice(layer.lower_count), slice(layer.lower_count, None)
        lower_height = float(heights[below].sum()) or None
        solid = self.stack.density_ratio * self.stack.height / layer.density_ratios(lowest)
        needed = float((solid * np.exp(-layer.elastic_strains(lowest))).sum())
        return Contact(
            load=load, resistance=resistance, leading=float(x[-1]), trailing=float(x[0]), x=x,
            pressure=path[:, 1 + STRESS], shear_traction=np.zeros_like(x), peak_pressure=float(lowest[STRESS]),
            indentation=float(indentation), exit_height=float(heights[fresh].sum()),
            exit_density_ratio=float(ratios[fresh] @ heights[fresh] / heights[fresh].sum()),
            work_residual=abs(resistance - plastic - elastic) / resistance_scale(resistance, load),
            mass_residual=needed / (layer.height - indentation) - 1,
            exit=Columns(*(tuple(Column(*each) for each in columns[part]) for part in (fresh, below))),
            own={"plastic_work": plastic, "elastic_work": elastic, "evaluations": evaluations},
            effort=f"evaluations: {evaluations}", lower_height=lower_height,
            lower_density_ratio=lower_height and ratios[below] @ heights[below] / lower_height,
        )  # fmt: skip


def column_layer(columns: Sequence[Column], material: Compaction, rate_factor: float, gap: GapShape) -> ColumnLayer:
    """Build the `ColumnLayer` of columns at rest.

    Parameters
    ----------
    columns : sequence of Column
        Columns from the base upwards.
    material : Compaction
        Constitutive law.
    rate_factor : float
        Factor of pc [-].
    gap : GapShape
        Gap between roller and layer.

    Returns
    -------
    ColumnLayer

    Raises
    ------
    ValueError
        If a column is out of its range.
    """
    height, density_ratio, lateral_stress, max_density_ratio = np.array(columns, dtype=float).T.copy()
    require_positive(height=height, density_ratio=density_ratio)
    require_nonnegative(max_density_ratio=max_density_ratio)
    require_finite(lateral_stress=lateral_stress)
    require_that(density_ratio < 1, density_ratio, "`density_ratio` must be below 1, got")
    stack = ColumnStack(height, density_ratio, lateral_stress / 1.5, max_density_ratio)
    return ColumnLayer(cap_constants(material, rate_factor), stack, gap)


def solve_target(layer: Any, compute: Callable[[float], Contact], name: str, value: float, tolerance: float) -> Contact:
    """Compute the pass with a prescribed quantity.

    Parameters
    ----------
    layer : ColumnLayer
        Layer under a roller or a plate, or another with its limits and estimate.
    compute : callable
        Computes the pass at an indentation [m].
    name : {"indentation", "load", "peak_pressure", "exit_density_ratio"}
        Prescribed quantity.
    value : float
        Its value in its unit.
    tolerance : float
        Relative error of the indentation [-].

    Raises
    ------
    ValueError
        If no indentation has the value.
    """
    deepest = math.log(layer.max_indentation)
    if name == "indentation":
        if not value < layer.max_indentation:
            raise_unreachable(layer, name, value, layer.max_indentation)
        return compute(value)

    @cache
    def passed(log_depth: float) -> Contact:
        return compute(min(math.exp(log_depth), layer.max_indentation))

    def residual(log_depth: float) -> float:
        return math.log(getattr(passed(log_depth), name) / value)

    if name == "exit_density_ratio" and not layer.loosest < value < 1:
        raise_unreachable(layer, name, value, passed(deepest).exit_density_ratio)
    guess = layer.max_indentation
    if layer.estimate(name, guess) > value:
        guess = brentq(lambda depth: layer.estimate(name, depth) - value, 0, guess, rtol=ESTIMATE_TOLERANCE)
    low = high = math.log(guess)
    first = last = residual(low)
    step = -OVERSHOOT * first / (guess / layer.height if name == "exit_density_ratio" else 1.0)
    while first * last > 0:
        if last < 0 and high >= deepest:
            raise_unreachable(layer, name, value, getattr(passed(high), name))
        low, high = high, min(high + step, deepest)
        last, step = residual(high), 2 * step
    return passed(brentq(residual, low, high, xtol=tolerance, rtol=1e-15) if low != high else low)


def plate_indentation(layer: ColumnLayer, pressure: float, rtol: float) -> float:
    """Compute the indentation of a plate, the gap of a layer, at which it reaches a stress [Pa], by one path [m]."""
    limit = layer.max_indentation
    control = PathControl(0.0, float(pressure), layer.error_scale(limit, rtol), np.inf)
    path, _, _ = layer.integrate(limit, layer.initial_state, control)
    if path[-1, 1 + STRESS] < pressure:
        raise_unreachable(layer, "peak_pressure", pressure, path[-1, 1 + STRESS])
    return float(limit - path[-1, 0])


def raise_unreachable(layer: Any, name: str, value: float, largest: float) -> NoReturn:
    """Raise ValueError for a target beyond its value at the largest indentation, or an initial density ratio."""
    bounds, unit = "be less than", f" {CONTACT[name].unit}"
    if name == "exit_density_ratio":
        bounds, unit = f"lie between {layer.loosest:.6g}, before the pass, and", ""
    raise ValueError(f"`{name}` must {bounds} {largest:.6g}{unit}, where {layer.limit}, got {value:.9g}{unit}")
