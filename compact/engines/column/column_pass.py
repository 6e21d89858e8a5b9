"""One pass of a roller over stacked columns: loading under the front, unloading behind, and the prescribed quantity.

    P = int s_v dx,    F = int s_v gap' dx

Both integrals are components of the differential equation in `column_ode`. The pass is integrated from the front edge
to the lowest generatrix and from there to the rear edge, where s_v = 0. On the way to the rear edge the coordinate u
increases from zero; on the way to the lowest generatrix it decreases to zero.

Load, peak pressure and density ratio rise with the indentation, which is searched for. A search for a load starts with
coarse integrations. The peak pressure equals that under a plate, and the density ratio nearly so, which provides the
first guess.
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
from compact.rolling_contact import Roller

SAMPLED_STEP_SHARE = 1 / 32  # [-], largest step over the front of a pass whose pressure is returned at every step
INDENTATION_SHARE_MAX = 1 - 1e-9  # [-], of the limit of the indentation; the last pore cannot be closed
REBOUND_SHARE_MAX = 2.0  # [-], rise of the gap behind the roller over the indentation, in which unloading must end
STIFFNESS_RATIO_MAX = 2e5  # [-], largest `stiffness_ratio` that is integrated; one step covers 6 of it
STRAINS = {"logarithmic": ode.LOGARITHMIC, "small": ode.SMALL, "mass-true": ode.MASS_TRUE}  # measures by name
PLATE = GapShape(0.0, 0.0)
PATH_ROWS_INITIAL = 128  # [-], rows of a path, doubled on demand; room for all steps would cost more than most steps
STEPS_PER_CALL = 20_000  # [-], steps in one compiled call over the number of columns; at most 0.1 s to an interrupt
COARSE_RTOL = 1e-5  # [-], `rtol` of the first passes of a search for a load
FIRST_TOLERANCE = 0.05  # [-], residual accepted at first over `rtol`; it doubles with each pass
LIKELY_TOLERANCE = 1.0  # [-], the same where the first guess is likely to be the solution
TARGET_TOLERANCE = 10.0  # [-], residual accepted in the end over `rtol`
DENSITY_RISE_MIN = 1e-2  # [-], rise of the density ratio to which its residual is relative, at least
SEARCH_PASSES_MAX = 60  # [-]; 6 are usual
MEAN_STRESS_SHARE = 0.8  # [-], mean over peak stress under the front, for the first guess of a load
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
        return float(self.stack.density_ratio * np.exp(self.stack.mean_stress / self.law.K) @ self.stack.height)

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

    @property
    def oedometric_modulus(self) -> float:
        """Elastic modulus in confined compression [Pa]."""
        return float(self.law.K + 4 * self.law.G / 3)

    @property
    def max_elastic_expansion(self) -> float:
        """Upper bound of the elastic volume strain released beyond the initial state, under lateral tension [-]."""
        return float((self.law.pt + max(0.0, float(self.stack.mean_stress.max()))) / self.law.K)

    def stress_estimate(self, depth: float) -> float:
        """Estimate the vertical stress [Pa] at the lowest generatrix for an indentation `depth` [m]."""
        densest = max(max(self.stack.density_ratio.tolist()), self.solid_height / (self.height - depth))
        strength = hardening(self.law, densest)[0] + self.law.pt
        return min(self.oedometric_modulus * -math.log1p(-depth / self.height), strength)

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
        front = layer.gap.front(indentation)
        control = PathControl(0.0, np.inf, layer.error_scale(indentation, rtol), front * max_step_share)
        loading, pressed, evaluations = layer.integrate(front, layer.initial_state, control)
        return pressed.unload(loading, indentation, control, evaluations)

    def unload(self, loading: Array, indentation: float, control: PathControl, evaluations: int) -> "PassResult":
        """Compute the unloading behind the lowest generatrix at an indentation [m], after the path of loading."""
        rise = REBOUND_SHARE_MAX * indentation
        end = self.gap.front(min(rise, self.gap.radius) if self.gap.circular else rise)
        control = control._replace(coordinate_end=end, stress_end=0.0)
        unloading, after, more = self.integrate(0.0, loading[-1, 1:], control)
        if unloading[-1, 1 + STRESS] > 0:
            x_end = float(self.gap.positions(np.array(end)))
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
    law, mean_stress = cap_constants(material, rate_factor), lateral_stress / 1.5
    stack = ColumnStack(height, density_ratio, mean_stress, max_density_ratio)
    return ColumnLayer(law, stack, gap, strain_measure, lower_count)


def find_indentation(  # noqa: PLR0913 - the function, its root, bounds and tolerances
    compute_pass: Callable[[float, float], PassResult],
    residual: Callable[[PassResult], float],
    initial_guess: float,
    bounds: tuple[float, float],
    rtol: float,
    *,
    slope: float = 1.0,
    coarse_rtol: float = 0.0,
    first_tolerance: float = FIRST_TOLERANCE,
    final_tolerance: float = TARGET_TOLERANCE,
) -> tuple[PassResult | None, int]:
    """Find the indentation at which a pass has no residual.

    The root is found by inverse quadratic interpolation over the logarithm of the indentation, between bounds. scipy's
    `brentq` needs up to twice the evaluations: it takes neither a first guess nor passes of two accuracies.

    Parameters
    ----------
    compute_pass : callable(indentation, rtol) -> PassResult
        Pass at an indentation [m] with a relative error of the integration [-].
    residual : callable(PassResult) -> float
        Relative residual [-], rising with the indentation.
    initial_guess : float
        First indentation [m].
    bounds : (float, float)
        Least and largest indentation [m].
    rtol, coarse_rtol : float
        Relative errors of the final and of the first integrations [-]; equal or less for no coarse ones.
    slope : float
        Slope of the residual over the logarithm of the indentation [-].
    first_tolerance, final_tolerance : float
        Residual accepted at first and in the end, over `rtol` [-].

    Returns
    -------
    result : PassResult or None
        None if the residual is negative at the largest indentation.
    evaluations : int
        Evaluations of the rates in all other passes.
    """
    least, limit = math.log(bounds[0]) if bounds[0] else -math.inf, math.log(bounds[1])
    low, high, limit_tried = least, limit, False
    points: list[tuple[float, float]] = []
    x, evaluations = math.log(initial_guess), 0
    accuracy, tolerance = max(coarse_rtol, rtol), first_tolerance * rtol
    for _ in range(SEARCH_PASSES_MAX):
        at_limit, x = x >= limit, min(x, limit)
        result = compute_pass(bounds[1] if at_limit else math.exp(x), accuracy)
        error = residual(result)
        if accuracy == rtol and abs(error) <= tolerance:
            return result, evaluations
        evaluations += result.evaluations
        limit_tried |= at_limit
        if points and points[-1][0] == x:  # by a finer integration, whose change shifts the other points
            points = [(place, other + error - points[-1][1]) for place, other in points]
        else:
            points = [*points[-2:], (x, error)]
        unreachable = at_limit and error < 0
        if accuracy > rtol and (unreachable or abs(error) <= accuracy):
            low, high, limit_tried, accuracy = least, limit, False, rtol
            continue
        if accuracy == rtol:
            if unreachable:
                return None, evaluations
            tolerance = min(2 * tolerance, final_tolerance * rtol)
        low, high = (x, high) if error < 0 else (low, x)
        x = _root_of(points, slope)
        if not (low < x < high or (x >= limit and not limit_tried)):
            halved = (low + high) / 2 if low > -math.inf else high - 1
            x = limit if error <= 0 and not limit_tried else halved
    raise RuntimeError(
        f"no indentation found in {SEARCH_PASSES_MAX} passes, residual {error:.1e} at {result.indentation:.6g} m"
    )


def _root_of(points: list[tuple[float, float]], slope: float) -> float:
    """Root of the inverse polynomial through two or three points (x, residual), or of a line of a slope through one."""
    if len(points) == 1:
        return points[0][0] - points[0][1] / slope
    weights = [math.prod(b / (b - a) for _, b in points if b != a) for _, a in points]
    return sum(weight * place for weight, (place, _) in zip(weights, points, strict=True))


def solve_target(layer: ColumnLayer, roller: Roller, rtol: float) -> tuple[PassResult, int]:
    """Compute the pass with the prescribed indentation, load or peak pressure, and count evaluations."""
    name, value = roller.target
    if name == "load":
        return _solve_load(layer, value, rtol)
    if name == "peak_pressure":
        return _solve_peak_pressure(layer, value, rtol)
    if not value < layer.max_indentation:
        _raise_unreachable(layer, "indentation", value, layer.max_indentation)
    return layer.compute_pass(value, rtol, SAMPLED_STEP_SHARE), 0


def _solve_peak_pressure(layer: ColumnLayer, pressure: float, rtol: float) -> tuple[PassResult, int]:
    """Pass with a peak pressure [Pa]; the first guess is the depth at which a plate reaches this stress."""
    path, spent = _plate_path(layer, pressure, rtol)
    limit = layer.max_indentation

    def residual(result: PassResult) -> float:
        return result.peak_pressure / pressure - 1

    result, evaluations = find_indentation(
        _sampled_pass(layer, rtol), residual, limit - path[-1, 0], (0.0, limit), rtol, first_tolerance=LIKELY_TOLERANCE
    )
    if result is None:
        _raise_unreachable(layer, "peak_pressure", pressure, path[-1, 1 + STRESS])
    return result, spent + evaluations


def _plate_path(layer: ColumnLayer, pressure: float, rtol: float) -> tuple[Array, int]:
    """Path of a plate from the largest indentation outwards to a stress [Pa], and number of evaluations."""
    limit, plate = layer.max_indentation, replace(layer, gap=PLATE)
    control = PathControl(0.0, float(pressure), layer.error_scale(limit, rtol), np.inf)
    path, _, spent = plate.integrate(limit, layer.initial_state, control)
    if path[-1, 1 + STRESS] < pressure:
        _raise_unreachable(layer, "peak_pressure", pressure, path[-1, 1 + STRESS])
    return path, spent


def plate_indentation(layer: ColumnLayer, pressure: float, rtol: float) -> float:
    """Compute the indentation of a plate [m] at which the columns reach a stress [Pa]."""
    return float(layer.max_indentation - _plate_path(layer, pressure, rtol)[0][-1, 0])


def _sampled_pass(layer: ColumnLayer, rtol: float) -> Callable[[float, float], PassResult]:
    """`compute_pass` of a search, with the largest step limited in the final integration."""

    def compute_pass(depth: float, tolerance: float) -> PassResult:
        return layer.compute_pass(depth, tolerance, math.inf if tolerance > rtol else SAMPLED_STEP_SHARE)

    return compute_pass


def _solve_load(layer: ColumnLayer, load: float, rtol: float) -> tuple[PassResult, int]:
    """Pass under a load [N/m]; the first guess is the estimated peak stress over the front."""
    limit = layer.max_indentation

    def estimated_excess(depth: float) -> float:
        return MEAN_STRESS_SHARE * layer.stress_estimate(depth) * layer.gap.edge(depth) - load

    def residual(result: PassResult) -> float:
        return math.log(result.load / load)

    initial_guess = brentq(estimated_excess, 0, limit, rtol=0.1) if estimated_excess(limit) > 0 else limit
    result, evaluations = find_indentation(
        _sampled_pass(layer, rtol), residual, initial_guess, (0.0, limit), rtol, coarse_rtol=COARSE_RTOL
    )
    if result is None:
        _raise_unreachable(layer, "load", load, layer.compute_pass(limit, rtol).load)
    return result, evaluations


def solve_exit_density(layer: ColumnLayer, density_ratio: float, rtol: float) -> tuple[PassResult, int]:
    """Compute the pass after whose rebound the columns have a mean density ratio, and count evaluations."""

    def residual(result: PassResult) -> float:
        return result.density_ratio / density_ratio - 1

    if layer.lower_count:  # columns in series share the vertical stress, so that the peak pressure is that without
        plate, spent = solve_plate_density(layer.without_lower, density_ratio, rtol)
        loaded, evaluations = _solve_peak_pressure(layer, plate.peak_pressure, rtol)
        return loaded, spent + plate.evaluations + evaluations
    plate, spent = solve_plate_density(layer, density_ratio, rtol)
    result, evaluations = find_indentation(
        _sampled_pass(layer, rtol), residual, plate.indentation, (0.0, layer.max_indentation), rtol,
        slope=plate.indentation / layer.height, first_tolerance=LIKELY_TOLERANCE,
    )  # fmt: skip
    return result or plate, spent + plate.evaluations + evaluations


def solve_plate_density(layer: ColumnLayer, density_ratio: float, rtol: float) -> tuple[PassResult, int]:
    """Compute the stroke of a plate after whose rebound the columns have a mean density ratio, and count evaluations.

    Notes
    -----
    Under a plate the loading paths to all depths coincide, so that all trials continue from one state. Its depth is a
    lower bound of the solution: that without rebound, less the elastic expansion under lateral tension.
    """
    limit, plate, loosest = layer.max_indentation, replace(layer, gap=PLATE), layer.solid_height / layer.height
    rise = max(density_ratio - loosest, DENSITY_RISE_MIN)
    nominal = layer.height * (1 - loosest / density_ratio)
    if 0 < nominal < limit:
        expanded = layer.height * (1 - loosest / density_ratio * math.exp(layer.max_elastic_expansion))
        shallowest = max(expanded, 0.0)
        y, pressed, spent = layer.initial_state, plate, 0
        if shallowest:
            control = PathControl(0.0, np.inf, plate.error_scale(shallowest, rtol), np.inf)
            path, pressed, spent = plate.integrate(shallowest, y, control)
            y = path[-1, 1:]

        def compute_pass(depth: float, _: float) -> PassResult:
            control = PathControl(0.0, np.inf, plate.error_scale(depth, rtol), np.inf)
            loading, deeper, evaluations = pressed.integrate(depth - shallowest, y, control)
            return deeper.unload(loading, depth, control, evaluations)

        def residual(result: PassResult) -> float:
            return (result.density_ratio - density_ratio) / rise

        initial_guess = nominal + (layer.height - nominal) * layer.stress_estimate(nominal) / layer.oedometric_modulus
        result, evaluations = find_indentation(
            compute_pass, residual, initial_guess, (shallowest, limit), rtol,
            slope=density_ratio / loosest, final_tolerance=TARGET_TOLERANCE * density_ratio / rise,
        )  # fmt: skip
        if result is not None:
            return result, spent + evaluations
    densest = plate.compute_pass(limit, rtol).density_ratio
    reason = "with the circle buried to its axis" if layer.limited_by_axis else "that closes all pores"
    raise ValueError(
        f"`exit_density_ratio` must lie between {loosest:.6g}, before the pass, and {densest:.6g}, after a pass "
        f"{reason}, got {density_ratio!r}"
    )


def _raise_unreachable(layer: ColumnLayer, name: str, value: float, limit: float) -> NoReturn:
    """Raise ValueError for a target beyond its value at the largest indentation."""
    full = f"grains and water alone fill the remaining {layer.solid_height:.6g} m of {layer.height:.6g} m"
    reason = "the circle is buried to its axis" if layer.limited_by_axis else full
    unit = CONTACT[name].unit
    raise ValueError(f"`{name}` must be less than {limit:.6g} {unit}, where {reason}, got {value:.6g} {unit}")
