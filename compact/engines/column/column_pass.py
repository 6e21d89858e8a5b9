"""One pass of a roller over stacked columns: loading under the front, unloading behind, and the prescribed quantity.

    P = int s_v dx,    F = int s_v gap' dx

Both integrals are components of the differential equation in `column_ode`. The pass is integrated from the front edge
to the lowest generatrix and from there to the rear edge, where s_v = 0. On the way to the rear edge the coordinate u
increases from zero; on the way to the lowest generatrix it decreases to zero.

Load, peak pressure and density ratio rise with the indentation. Brent's method finds the indentation of a prescribed
one over the logarithms of both, in which they are nearly proportional.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NoReturn

import numpy as np
from scipy.optimize import brentq

from compact.engines.column import column_ode as ode
from compact.engines.column.column_ode import STRESS, ColumnStack, GapShape, PathControl
from compact.material.elliptic_cap import CapConstants, cap_constants, hardening
from compact.material.laws import Compaction
from compact.numerics import Array
from compact.numerics.validation import require_fields
from compact.quantities import CONTACT

SAMPLED_STEP_SHARE = 1 / 32  # [-], largest step over the front of a pass whose pressure is returned at every step
INDENTATION_SHARE_MAX = 1 - 1e-9  # [-], of the limit of the indentation; the last pore cannot be closed
REBOUND_SHARE_MAX = 2.0  # [-], rise of the gap behind the roller over the indentation, in which unloading must end
STIFFNESS_RATIO_MAX = 2e5  # [-], largest `stiffness_ratio` that is integrated; one step covers 6 of it
STRAINS = {"logarithmic": ode.LOGARITHMIC, "small": ode.SMALL, "mass-true": ode.MASS_TRUE}  # measures by name
PLATE = GapShape(0.0, 0.0)
PATH_ROWS_INITIAL = 128  # [-], rows of a path, doubled on demand; room for all steps would cost more than most steps
STEPS_PER_CALL = 20_000  # [-], steps in one compiled call over the number of columns; at most 0.1 s to an interrupt
TARGET_TOLERANCE = 10.0  # [-], residual of a prescribed quantity that is guaranteed, over `rtol`
SEARCH_TOLERANCE = 0.02  # [-], relative error of the indentation that is sought, over `rtol`
MEAN_STRESS_SHARE = 0.8  # [-], mean over peak stress under the front, for the first guess of a load
OVERSHOOT = 1.2  # [-], of the first step from that guess, so that it brackets the indentation
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
    law : CapConstants
        Material constants; with `law_at` those at the largest indentation.
    strain_measure : int
        One of the values of STRAINS.
    lower_count : int
        Number of columns of the lower lift, from the base upwards; 0 on the rigid base.
    law_at : callable, optional
        Material constants at an indentation [m], for mix whose yield pressure depends on the rate of compaction.
    """

    law: CapConstants
    stack: ColumnStack
    gap: GapShape
    strain_measure: int
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
        return max(ode.stiffness_ratio(self.law, k) for k in self.stack.density_ratio.tolist())

    def stress_estimate(self, depth: float) -> float:
        """Estimate the vertical stress [Pa] at the lowest generatrix for an indentation `depth` [m]."""
        densest = max(max(self.stack.density_ratio.tolist()), self.solid_height / (self.height - depth))
        strength = hardening(self.law, densest)[0] + self.law.pt
        return min(float(self.law.K + 4 * self.law.G / 3) * -math.log1p(-depth / self.height), strength)

    def estimate(self, name: str, depth: float) -> float:
        """Estimate a load [N/m], peak pressure [Pa] or exit density ratio [-] for an indentation `depth` [m]."""
        if name == "exit_density_ratio":
            return self.loosest / (1 - depth / self.height)
        stress = self.stress_estimate(depth)
        return stress if name == "peak_pressure" else MEAN_STRESS_SHARE * stress * self.gap.edge(depth)

    @property
    def loosest(self) -> float:
        """Density ratio before the pass [-], mean over the height without the lower lift."""
        heights, ratios = (values[self.lower_count :] for values in (self.stack.height, self.stack.density_ratio))
        return float(ratios @ heights / heights.sum())

    def error_scale(self, depth: float, rtol: float) -> Array:
        """Return the error of each component of y allowed in one step, relative to its size at a depth [m]."""
        stress = self.stress_estimate(depth)
        of_columns = [stress, -math.log1p(-depth / self.height)] * len(self.stack.height)
        return rtol * np.array([stress, stress * self.gap.edge(depth), *[stress * depth] * 3, *of_columns])

    def density_ratios(self, y: Array) -> Array:
        """Return the density ratio [-] of each column for a state vector."""
        V, k0 = y[ode.COLUMN_STATE + 1 :: 2], self.stack.density_ratio
        return k0 / (1 - V) if self.strain_measure == ode.MASS_TRUE else k0 * np.exp(V)

    def elastic_strains(self, y: Array) -> Array:
        """Return the elastic volume strain [-] of each column since the start of the pass."""
        mean = y[ode.COLUMN_STATE :: 2]
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
            x, x_end, x_start = self.gap.positions(np.array([path[-1, 0], control.coordinate_end, u])).tolist()
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
    def exit_density_ratio(self) -> float:
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
    strain_measure: int = ode.LOGARITHMIC,
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
    law, mean_stress = cap_constants(material, rate_factor), lateral_stress / 1.5
    stack = ColumnStack(height, density_ratio, mean_stress, max_density_ratio)
    return ColumnLayer(law, stack, gap, strain_measure, lower_count)


def solve_target(layer: ColumnLayer, name: str, value: float, rtol: float) -> tuple[PassResult, int]:
    """Compute the pass with a prescribed quantity.

    Parameters
    ----------
    layer : ColumnLayer
        Columns under a roller or a plate.
    name : {"indentation", "load", "peak_pressure", "exit_density_ratio"}
        Prescribed quantity.
    value : float
        Its value in its unit.
    rtol : float
        Error of a step over the size of the whole pass [-].

    Returns
    -------
    result : PassResult
    evaluations : int
        Evaluations of the rates in all other passes.

    Raises
    ------
    ValueError
        If no indentation has the value.
    """
    limit = layer.max_indentation
    if name == "indentation":
        if not value < limit:
            _raise_unreachable(layer, name, value, limit)
        return layer.compute_pass(value, rtol, SAMPLED_STEP_SHARE), 0
    if name == "exit_density_ratio" and not layer.loosest < value < 1:
        _raise_unreachable(layer, name, value, layer.compute_pass(limit, rtol).exit_density_ratio)
    tried: dict[float, PassResult] = {}

    def residual(log_depth: float) -> float:
        tried[log_depth] = passed = layer.compute_pass(min(math.exp(log_depth), limit), rtol, SAMPLED_STEP_SHARE)
        return math.log(getattr(passed, name) / value)

    guess = limit
    if layer.estimate(name, limit) > value:
        guess = brentq(lambda depth: layer.estimate(name, depth) - value, 0, limit, rtol=1e-3)
    low = high = math.log(guess)
    error = last = residual(low)
    step = -OVERSHOOT * error / (guess / layer.height if name == "exit_density_ratio" else 1.0)
    while error * last > 0:
        if last < 0 and high >= math.log(limit):
            _raise_unreachable(layer, name, value, getattr(tried[high], name))
        low, high = high, min(high + step, math.log(limit))
        last, step = residual(high), 2 * step
    root = brentq(residual, low, high, xtol=SEARCH_TOLERANCE * rtol, rtol=1e-15) if low != high else low
    return tried[root], sum(passed.evaluations for log_depth, passed in tried.items() if log_depth != root)


def plate_indentation(layer: ColumnLayer, pressure: float, rtol: float) -> float:
    """Compute the indentation of a plate [m] at which the columns reach a stress [Pa], by one path to that stress."""
    limit, plate = layer.max_indentation, replace(layer, gap=PLATE)
    control = PathControl(0.0, float(pressure), layer.error_scale(limit, rtol), np.inf)
    path, _, _ = plate.integrate(limit, layer.initial_state, control)
    if path[-1, 1 + STRESS] < pressure:
        _raise_unreachable(layer, "peak_pressure", pressure, path[-1, 1 + STRESS])
    return float(limit - path[-1, 0])


def _raise_unreachable(layer: ColumnLayer, name: str, value: float, limit: float) -> NoReturn:
    """Raise ValueError for a target beyond its value at the largest indentation."""
    if name == "exit_density_ratio":
        reason = "with the circle buried to its axis" if layer.limited_by_axis else "that closes all pores"
        raise ValueError(
            f"`exit_density_ratio` must lie between {layer.loosest:.6g}, before the pass, and {limit:.6g}, after a "
            f"pass {reason}, got {value!r}"
        )
    full = f"grains and water alone fill the remaining {layer.solid_height:.6g} m of {layer.height:.6g} m"
    reason, unit = "the circle is buried to its axis" if layer.limited_by_axis else full, CONTACT[name].unit
    raise ValueError(f"`{name}` must be less than {limit:.6g} {unit}, where {reason}, got {value:.6g} {unit}")
