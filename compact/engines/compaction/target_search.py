"""Steady solution at a height, and the depth that satisfies a prescribed load, peak pressure or exit density.

The steady state is found by the direct steady solve from a neighbour, by continuation in stiffness from scratch, or by
incremental rolling. A secant method in the logarithms of depth and target finds the depth.
"""

from collections.abc import Callable

import numpy as np

from compact.engines.compaction.incremental_rolling import IncrementalRolling, roll_until_steady
from compact.engines.compaction.results import CompactionContactResult
from compact.engines.compaction.roller_frame import LayerState, RollerFrame
from compact.engines.compaction.steady_newton_krylov import SteadySolver
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller, require_on_target

COARSE_TOLERANCE = 2e-2  # [-], remaining change on the coarse mesh and at the first depths of a search
TARGET_TOLERANCE = 1e-3  # [-], of a prescribed load, peak pressure or exit density
DENSITY_TOLERANCE = 1e-4  # [-], of a density ratio by incremental rolling; columns of points scatter by as much
MAX_DEPTHS = 12  # [-], depths of one search
MIN_TARGET_RATIO = 1e-3  # [-], least extrapolated load or pressure over the target
MIN_DENSITY_INCREASE = 1e-6  # [-], least extrapolated increase of the density ratio
STRAIN_DEPTH = 1.5  # [-], depth of the strained mix over the contact length, for the first depth
PEAK_FACTOR = 1.15  # [-], peak pressure over the yield pressure of the exit density, for the first depth
MEAN_FACTOR = 0.7  # [-], load over peak pressure and contact length ahead, for the first depth; about Hertz's 2/3
MAX_DEPTH_FACTOR = 1.4  # [-], largest ratio of successive depths
MAX_DEPTH_SHARE = 0.98  # [-], largest depth over that of full density at the exit
INITIAL_ELASTIC_SHARE = 0.03  # [-], of the direct solve from a neighbour; 0.01 and 0.1 fail at 5 % more depth
UNITS = {"load": " N/m", "peak_pressure": " Pa"}

ContinuationStart = Callable[[RollerFrame, float], IncrementalRolling]


def solve_steady(
    rolling: IncrementalRolling,
    bottom_height: float,
    tolerance: float,
    continuation_start: ContinuationStart | None = None,
) -> IncrementalRolling:
    """Find the steady state at a height.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller at rest or in any steady state.
    bottom_height : float
        Height of the lowest generatrix [m].
    tolerance : float
        Relative remaining change of load, resistance and exit density [-].
    continuation_start : callable, optional
        Function of frame and height that solves from scratch by continuation.

    Returns
    -------
    IncrementalRolling
        Steady solution on the same frame.

    Raises
    ------
    RuntimeError
        If no steady state is found.
    """
    if rolling.is_direct and solve_directly(rolling, bottom_height):
        return rolling
    if continuation_start and (rolling.is_direct or not rolling.steps):
        try:
            return continuation_start(rolling.frame, bottom_height)
        except RuntimeError:  # continuation fails; incremental rolling follows
            pass
    roll_until_steady(rolling, bottom_height, max(tolerance, COARSE_TOLERANCE))
    if not solve_directly(rolling, bottom_height) and tolerance < COARSE_TOLERANCE:
        roll_until_steady(rolling, bottom_height, tolerance)
    return rolling


def solve_directly(rolling: IncrementalRolling, bottom_height: float) -> bool:
    """Try the direct steady solve from the present state, at most once for a height.

    Parameters
    ----------
    rolling : IncrementalRolling
        Roller in a nearly steady state; a solution becomes its last step.
    bottom_height : float
        Height of the lowest generatrix [m].

    Returns
    -------
    bool
        True if it converges.
    """
    if rolling.failed_height == bottom_height:
        return False
    frame, displacement = rolling.frame, rolling.state.displacement
    try:
        solver = SteadySolver(frame, rolling.surface.moved_to(bottom_height), rolling.progress)
        if rolling.is_direct:
            equilibrium = solver.solve(displacement, INITIAL_ELASTIC_SHARE)
        else:
            equilibrium = solver.solve(frame.with_uniform_rear(displacement))
        rolling.accept_steady(equilibrium, bottom_height)
    except RuntimeError:  # no convergence, or inverted elements
        rolling.failed_height = bottom_height
        return False
    return True


class DepthTarget:
    """Prescribed quantity and the search for the depth that satisfies it.

    Parameters
    ----------
    layer, roller, material : Layer, Roller, Compaction
        Case; the target of the roller is prescribed by default.
    exit_density_ratio : float or None
        Mean exit density ratio that is prescribed instead [-].
    fed_layer : LayerState or None
        Layer of an earlier pass.
    """

    def __init__(
        self,
        layer: Layer,
        roller: Roller,
        material: Compaction,
        exit_density_ratio: float | None,
        fed_layer: LayerState | None,
    ) -> None:
        self.height, self.roller, self.material = layer.height, roller, material
        self.fed_ratio = material.fed_density_ratio if fed_layer is None else fed_layer.density_ratio
        self.max_depth = MAX_DEPTH_SHARE * layer.height * (1 - self.fed_ratio)
        self.densest = self.fed_ratio if fed_layer is None else float(fed_layer.points.density_ratio.max())
        self.quantity, self.value = roller.target
        if exit_density_ratio is not None:
            self.quantity, self.value = "exit_density_ratio", exit_density_ratio

    @property
    def required_depth(self) -> float | None:
        """Depth that the target requires [m], None for a load or a pressure."""
        if self.quantity == "indentation":
            return self.value
        return self.height * (1 - self.fed_ratio / self.value) if self.quantity == "exit_density_ratio" else None

    def initial_depth(self) -> float:
        """Return the prescribed indentation or an estimate of the depth [m]."""
        if self.roller.indentation is not None:
            return self.roller.indentation
        deepest = min(0.2 * self.height, 0.9 * self.max_depth, 0.9 * self.roller.radius)
        depths = np.geomspace(min(1e-5 * self.height, 1e-3 * deepest), deepest, 100)
        length = np.sqrt(2 * self.roller.radius * depths)
        strain = depths / np.minimum(self.height, STRAIN_DEPTH * length)
        peak = PEAK_FACTOR * self.material.yield_pressure(self.densest / (1 - strain))
        if self.quantity == "peak_pressure":
            return float(np.interp(self.value, peak, depths))
        elastic = self.material.unloading_modulus / (1 - self.material.poisson**2) / 4  # of a layer already compacted
        return float(np.interp(self.value, np.minimum(MEAN_FACTOR * peak * length, elastic * depths), depths))

    def reach(
        self,
        rolling: IncrementalRolling,
        tolerance: float,
        depth: float | None = None,
        continuation_start: ContinuationStart | None = None,
    ) -> IncrementalRolling:
        """Find the steady state that satisfies the target.

        Parameters
        ----------
        rolling : IncrementalRolling
            Roller at rest or in any steady state.
        tolerance : float
            Relative remaining change of load, resistance and exit density [-].
        depth : float, optional
            First depth [m]; that of the roller by default.
        continuation_start : callable, optional
            As of `solve_steady`.

        Returns
        -------
        IncrementalRolling
            Steady solution on the same frame.

        Raises
        ------
        RuntimeError
            If no steady state is found, or no depth satisfies the target.
        """
        if self.quantity == "indentation":
            return solve_steady(rolling, self.height - self.value, tolerance, continuation_start)
        depth = rolling.depth if depth is None else depth
        logs: list[float] = []
        misses: list[float] = []
        for _ in range(MAX_DEPTHS):
            is_first_approach = not misses or abs(misses[-1]) > 10 * TARGET_TOLERANCE
            remaining = self._steady_tolerance(tolerance, is_first_approach)
            rolling = solve_steady(rolling, self.height - depth, remaining, continuation_start)
            logs.append(np.log(depth))
            misses.append(self.log_miss(rolling))
            if self._is_reached(rolling, misses[-1], is_first_approach):
                return rolling
            if depth == self.max_depth and misses[-1] < 0:
                break
            factor = float(np.exp(-misses[-1] / self._slope(logs, misses)))
            depth = min(depth * float(np.clip(factor, 1 / MAX_DEPTH_FACTOR, MAX_DEPTH_FACTOR)), self.max_depth)
        raise RuntimeError(self._failure(depth, logs, misses))

    def require_reached(
        self, rolled: CompactionContactResult, solution: IncrementalRolling, torque: float | None
    ) -> None:
        """Require the prescribed quantity and torque of a result.

        Small strain determines the density ratio to half a squared strain.

        Parameters
        ----------
        rolled : CompactionContactResult
            Result.
        solution : IncrementalRolling
            Its solution.
        torque : float or None
            Prescribed torque of a rotating roller [N].

        Raises
        ------
        RuntimeError
            If either is not satisfied.
        """
        torques = None
        if solution.contact.creepage is not None:
            surface = solution.surface
            torques = torque or 0.0, float(-surface.radius * (surface.weights @ solution.contact.shear))
        density = self.value if self.quantity == "exit_density_ratio" else None
        tolerance = TARGET_TOLERANCE
        if density is not None and not solution.frame.solid.finite:
            tolerance += 0.5 * (1 - self.fed_ratio / density) ** 2
        require_on_target(rolled, self.roller, tolerance, exit_density_ratio=density, torque=torques)

    def log_miss(self, rolling: IncrementalRolling) -> float:
        """Return the logarithm of the quantity over the target; of a density, of its increase over the fed layer."""
        limit, remaining = rolling.extrapolate(self.quantity)
        last = getattr(rolling.steps[-1], self.quantity)
        limit = limit if remaining > TARGET_TOLERANCE * last else last
        if self.quantity == "exit_density_ratio":  # proportional to the depth above the fed density
            return float(np.log(max(limit - self.fed_ratio, MIN_DENSITY_INCREASE) / (self.value - self.fed_ratio)))
        return float(np.log(max(limit / self.value, MIN_TARGET_RATIO)))  # an extrapolated value may be negative

    def _steady_tolerance(self, tolerance: float, is_first_approach: bool) -> float:
        if self.quantity == "exit_density_ratio":
            return tolerance
        return max(tolerance, COARSE_TOLERANCE) if is_first_approach else min(tolerance, TARGET_TOLERANCE / 2)

    def _is_reached(self, rolling: IncrementalRolling, miss: float, is_first_approach: bool) -> bool:
        if self.quantity == "exit_density_ratio" and not rolling.is_direct:
            return abs(np.expm1(miss)) * (self.value - self.fed_ratio) < DENSITY_TOLERANCE
        return abs(miss) < TARGET_TOLERANCE and not is_first_approach

    def _slope(self, logs: list[float], misses: list[float]) -> float:
        """Return the secant slope of the misses over the logarithm of the depth, within bounds."""
        if len(logs) == 1 or logs[-1] == logs[-2]:
            return 1.0
        low, high = (0.8, 1.25) if self.quantity == "exit_density_ratio" else (0.3, 3.0)
        return float(np.clip((misses[-1] - misses[-2]) / (logs[-1] - logs[-2]), low, high))

    def _failure(self, depth: float, logs: list[float], misses: list[float]) -> str:
        """Return the message for a target that no depth satisfies."""
        nearest, unit = int(np.argmin(np.abs(misses))), UNITS.get(self.quantity, "")
        found = self.value * np.exp(misses[nearest])
        if self.quantity == "exit_density_ratio":
            found = self.fed_ratio + np.exp(misses[nearest]) * (self.value - self.fed_ratio)
        limit = f" down to {1e3 * self.max_depth:.4g} mm, close to full density" if depth == self.max_depth else ""
        return (
            f"`{self.quantity}` {self.value:g}{unit} not reached{limit} after {len(logs)} depths from "
            f"{1e3 * np.exp(min(logs)):.4g} to {1e3 * np.exp(max(logs)):.4g} mm; the nearest was "
            f"{found:.5g}{unit} at {1e3 * np.exp(logs[nearest]):.4g} mm"
        )
