"""Indentation of a column layer for a prescribed load, peak pressure or exit density ratio.

Load, peak pressure and density ratio rise with the indentation. The root is found by inverse quadratic interpolation
over the logarithm of the indentation, between bounds. A search for a load starts with coarse integrations. The peak
pressure equals that under a plate, and the density ratio nearly so, which provides the first guess.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np
from scipy.optimize import brentq

from compact.engines.column.column_ode import STRESS, PathControl
from compact.engines.column.column_pass import PLATE, SAMPLED_STEP_SHARE, ColumnLayer, PassResult
from compact.numerics import Array
from compact.quantities import CONTACT
from compact.rolling_contact import Roller

COARSE_RTOL = 1e-5  # [-], `rtol` of the first passes of a search for a load
FIRST_TOLERANCE = 0.05  # [-], residual accepted at first over `rtol`; it doubles with each pass
LIKELY_TOLERANCE = 1.0  # [-], the same where the first guess is likely to be the solution
TARGET_TOLERANCE = 10.0  # [-], residual accepted in the end over `rtol`
DENSITY_RISE_MIN = 1e-2  # [-], rise of the density ratio to which its residual is relative, at least
SEARCH_PASSES_MAX = 60  # [-]; 6 are usual
MEAN_STRESS_SHARE = 0.8  # [-], mean over peak stress under the front, for the first guess of a load


@dataclass
class _Bracket:
    """Bounds of the logarithm of the indentation, and the last points (x, residual) of a search."""

    low: float
    high: float
    limit: float
    points: list[tuple[float, float]]
    limit_tried: bool = False

    def add(self, x: float, residual: float) -> None:
        """Add a point; at the place of the last one, shift all by its change from a finer integration."""
        if self.points and self.points[-1][0] == x:
            change = residual - self.points[-1][1]
            self.points = [(place, other + change) for place, other in self.points]
        else:
            self.points = [*self.points[-2:], (x, residual)]

    def next_point(self, x: float, residual: float, slope: float) -> float:
        """Narrow the bounds by the last point and return the next: interpolated, bisected or the limit."""
        self.low, self.high = (x, self.high) if residual < 0 else (self.low, x)
        guess = x - residual / slope
        if len(self.points) > 1:  # root of the inverse polynomial through two or three points
            weights = [math.prod(b / (b - a) for _, b in self.points if b != a) for _, a in self.points]
            guess = sum(weight * place for weight, (place, _) in zip(weights, self.points, strict=True))
        if self.low < guess < self.high or (guess >= self.limit and not self.limit_tried):
            return guess
        if not (self.limit_tried or residual > 0):
            return self.limit
        return (self.low + self.high) / 2 if self.low > -math.inf else self.high - 1


@dataclass(frozen=True)
class IndentationSearch:
    """Search for the indentation at which a pass has no residual.

    Parameters
    ----------
    compute_pass : callable(indentation, rtol) -> PassResult
        Pass at an indentation [m] with a relative error of the integration [-].
    residual : callable(PassResult) -> float
        Relative residual [-], rising with the indentation.
    max_indentation, min_indentation : float
        Bounds [m].
    rtol, coarse_rtol : float
        Relative errors of the final and of the first integrations [-]; equal or less for no coarse ones.
    first_tolerance, final_tolerance : float
        Residual accepted at first and in the end, over `rtol` [-].
    """

    compute_pass: Callable[[float, float], PassResult]
    residual: Callable[[PassResult], float]
    max_indentation: float
    rtol: float
    min_indentation: float = 0.0
    coarse_rtol: float = 0.0
    first_tolerance: float = FIRST_TOLERANCE
    final_tolerance: float = TARGET_TOLERANCE

    def solve(self, initial_guess: float, slope: float = 1.0) -> tuple[PassResult | None, int]:
        """Find the indentation from a first guess [m] and the slope of the residual over its logarithm [-].

        Returns None if the residual is negative at the largest indentation, and the evaluations in all other passes.
        """
        bracket, x, evaluations = self._bracket([]), math.log(initial_guess), 0
        rtol, tolerance = max(self.coarse_rtol, self.rtol), self.first_tolerance * self.rtol
        for _ in range(SEARCH_PASSES_MAX):
            at_limit, x = x >= bracket.limit, min(x, bracket.limit)
            result = self.compute_pass(self.max_indentation if at_limit else math.exp(x), rtol)
            residual = self.residual(result)
            if rtol == self.rtol and abs(residual) <= tolerance:
                return result, evaluations
            evaluations += result.evaluations
            bracket.limit_tried |= at_limit
            bracket.add(x, residual)
            unreachable = at_limit and residual < 0
            if rtol > self.rtol:
                if unreachable or abs(residual) <= rtol:
                    bracket, rtol = self._bracket(bracket.points), self.rtol
                    continue
            elif unreachable:
                return None, evaluations
            else:
                tolerance = min(2 * tolerance, self.final_tolerance * self.rtol)
            x = bracket.next_point(x, residual, slope)
        raise RuntimeError(
            f"no indentation found in {SEARCH_PASSES_MAX} passes, residual {residual:.1e} at {result.indentation:.6g} m"
        )

    def _bracket(self, points: list[tuple[float, float]]) -> _Bracket:
        low = math.log(self.min_indentation) if self.min_indentation else -math.inf
        limit = math.log(self.max_indentation)
        return _Bracket(low, limit, limit, points)


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

    search = IndentationSearch(_sampled_pass(layer, rtol), residual, limit, rtol, first_tolerance=LIKELY_TOLERANCE)
    result, evaluations = search.solve(limit - path[-1, 0])
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
        return MEAN_STRESS_SHARE * layer.stress_estimate(depth) * layer.edge(depth) - load

    def residual(result: PassResult) -> float:
        return math.log(result.load / load)

    initial_guess = brentq(estimated_excess, 0, limit, rtol=0.1) if estimated_excess(limit) > 0 else limit
    search = IndentationSearch(_sampled_pass(layer, rtol), residual, limit, rtol, coarse_rtol=COARSE_RTOL)
    result, evaluations = search.solve(initial_guess)
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
    search = IndentationSearch(
        _sampled_pass(layer, rtol), residual, layer.max_indentation, rtol, first_tolerance=LIKELY_TOLERANCE
    )
    result, evaluations = search.solve(plate.indentation, plate.indentation / layer.height)
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

        final_tolerance = TARGET_TOLERANCE * density_ratio / rise
        search = IndentationSearch(compute_pass, residual, limit, rtol, shallowest, final_tolerance=final_tolerance)
        initial_guess = nominal + (layer.height - nominal) * layer.stress_estimate(nominal) / layer.oedometric_modulus
        result, evaluations = search.solve(initial_guess, density_ratio / loosest)
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
