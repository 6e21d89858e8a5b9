"""Prescribed depth, load, peak pressure or exit density of a roller, and the secant method for the depth.

The first depth follows from the yield pressure of a column. A secant in the logarithms of depth and quantity corrects
it, for the quantity extrapolated to the steady state.
"""

from dataclasses import dataclass, field
from typing import cast

import numpy as np

from compact.engines.compaction.incremental_rolling import IncrementalRolling, RollingStep
from compact.engines.compaction.results import CompactionContactResult
from compact.engines.compaction.roller_frame import LayerState
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller, require_on_target

TARGET_TOLERANCE = 1e-3  # [-], of a prescribed load or peak pressure
DENSITY_TOLERANCE = 1e-4  # [-], of a prescribed exit density ratio; columns of points scatter by as much
MIN_TARGET_RATIO = 1e-3  # [-], least extrapolated load or pressure over the target
MIN_DENSITY_INCREASE = 1e-6  # [-], least extrapolated increase of the density ratio
STRAIN_DEPTH = 1.5  # [-], depth of the strained mix over the contact length, for the first depth
PEAK_FACTOR = 1.15  # [-], peak pressure over the yield pressure of the exit density, for the first depth
MEAN_FACTOR = 0.7  # [-], load over peak pressure and contact length ahead, for the first depth; about Hertz's 2/3
MAX_DEPTH_FACTOR = 1.4  # [-], largest ratio of successive depths
MAX_DEPTH_SHARE = 0.98  # [-], largest depth over that of full density at the exit
MAX_ELONGATED_SHARE = 0.7  # [-], largest depth over the layer height on a frictionless base
EXPONENTS = {  # [-], first, least and largest exponent of a quantity over the depth
    "load": (1.2, 0.3, 3.0), "peak_pressure": (1.0, 0.3, 3.0), "exit_density_ratio": (1.0, 0.7, 1.4),
}  # fmt: skip
CROSSING_SHARE = 0.5  # [-], of a correction after one that was too large
MIN_SECANT = 0.04  # [-], least difference of logarithms of depths for a secant; values of closer ones scatter
UNITS = {"load": " N/m", "peak_pressure": " Pa"}


class DepthTarget:
    """Prescribed quantity of a roller and its first depth.

    Parameters
    ----------
    layer, roller, material : Layer, Roller, Compaction
        Case; the target of the roller is prescribed by default.
    exit_density_ratio : float or None
        Mean exit density ratio that is prescribed instead [-].
    fed_layer : LayerState or None
        Layer of an earlier pass.
    lower : LayerState, optional
        Lower lift before the pass.
    """

    def __init__(
        self,
        layer: Layer,
        roller: Roller,
        material: Compaction,
        exit_density_ratio: float | None,
        fed_layer: LayerState | None,
        lower: LayerState | None = None,
    ) -> None:
        self.height, self.roller, self.material = layer.height, roller, material
        self.fed_ratio = material.fed_density_ratio if fed_layer is None else fed_layer.density_ratio
        self.max_depth = MAX_DEPTH_SHARE * layer.height * (1 - self.fed_ratio)
        if lower is not None:
            self.max_depth += MAX_DEPTH_SHARE * lower.height * max(1 - lower.density_ratio, 0.0)
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

    def depth_from(self, start: CompactionContactResult) -> float:
        """Return the first depth from a neighbouring result [m]."""
        if self.quantity == "indentation":
            return self.value
        exponent = EXPONENTS[self.quantity][0]
        factor = float(np.exp(-self.log_miss(getattr(start, self.quantity)) / exponent))
        return min(start.indentation * factor, self.max_depth)

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
        surface = solution.surface
        if solution.contact.creepage is not None:
            torques = torque or 0.0, float(-surface.radius * (surface.weights @ solution.contact.shear))
        density = self.value if self.quantity == "exit_density_ratio" else None
        tolerance = TARGET_TOLERANCE
        if density is not None and not solution.frame.solid.finite:
            tolerance += 0.5 * (1 - self.fed_ratio / density) ** 2
        require_on_target(rolled, self.roller, tolerance, exit_density_ratio=density, torque=torques)

    def log_miss(self, value: float) -> float:
        """Return the logarithm of a quantity over the target; of a density, of its increase over the fed layer."""
        if self.quantity == "exit_density_ratio":  # proportional to the depth above the fed density
            return float(np.log(max(value - self.fed_ratio, MIN_DENSITY_INCREASE) / (self.value - self.fed_ratio)))
        return float(np.log(max(value / self.value, MIN_TARGET_RATIO)))  # an extrapolated value may be negative

    def log_miss_of(self, step: RollingStep) -> float:
        """Return `log_miss` of a step; 0 of a prescribed depth."""
        return 0.0 if self.quantity == "indentation" else self.log_miss(getattr(step, self.quantity))

    @property
    def tolerance(self) -> float:
        """Tolerance of `log_miss` [-]."""
        if self.quantity == "exit_density_ratio":
            return DENSITY_TOLERANCE / (self.value - self.fed_ratio)
        return TARGET_TOLERANCE


@dataclass
class DepthSecant:
    """Secant method for the depth that satisfies a target.

    Parameters
    ----------
    target : DepthTarget
        Prescribed quantity.
    slope : float, optional
        Exponent of the quantity over the depth [-], from another mesh; replaced by the secant of distant depths.
    """

    target: DepthTarget
    slope: float | None = None
    _logs: list[float] = field(default_factory=list, init=False)
    _misses: list[float] = field(default_factory=list, init=False)

    @property
    def is_started(self) -> bool:
        """True if a depth has been recorded."""
        return bool(self._misses)

    @property
    def last_miss(self) -> float:
        """Last logarithm of the quantity over the target [-]; 0 for a prescribed depth."""
        return self._misses[-1] if self._misses else 0.0

    def next_depth(self, depth: float, value: float) -> float:
        """Return the next depth [m] from the quantity at a depth.

        Raises
        ------
        RuntimeError
            If the largest depth does not suffice.
        """
        target = self.target
        if target.quantity == "indentation":
            return target.value
        self._logs.append(float(np.log(depth)))
        self._misses.append(target.log_miss(value))
        if depth == target.max_depth and self.last_miss < 0:
            raise RuntimeError(self.failure())
        crossed = len(self._misses) > 1 and self._misses[-1] * self._misses[-2] < 0
        share = CROSSING_SHARE if crossed else 1.0  # the quantity scatters with the elements
        self._update_slope()
        factor = float(np.exp(-share * self.last_miss / cast(float, self.slope)))
        return min(depth * float(np.clip(factor, 1 / MAX_DEPTH_FACTOR, MAX_DEPTH_FACTOR)), target.max_depth)

    def _update_slope(self) -> None:
        """Take the secant to the last depth that is distant enough, within bounds."""
        first, low, high = EXPONENTS[self.target.quantity]
        self.slope = first if self.slope is None else self.slope
        distant = np.flatnonzero(np.abs(np.array(self._logs) - self._logs[-1]) > MIN_SECANT)
        if len(distant):
            other = distant[-1]
            secant = (self._misses[-1] - self._misses[other]) / (self._logs[-1] - self._logs[other])
            self.slope = float(np.clip(secant, low, high))

    def failure(self) -> str:
        """Return the message for a target that no depth satisfies."""
        target, misses = self.target, self._misses
        nearest, unit = int(np.argmin(np.abs(misses))), UNITS.get(target.quantity, "")
        found = target.value * np.exp(misses[nearest])
        if target.quantity == "exit_density_ratio":
            found = target.fed_ratio + np.exp(misses[nearest]) * (target.value - target.fed_ratio)
        deepest = 1e3 * np.exp(max(self._logs))
        limit = " down to full density" if deepest >= 1e3 * target.max_depth * (1 - 1e-9) else ""
        return (
            f"`{target.quantity}` {target.value:g}{unit} not reached{limit} after {len(self._logs)} depths from "
            f"{1e3 * np.exp(min(self._logs)):.4g} to {deepest:.4g} mm; the nearest was {found:.5g}{unit} at "
            f"{1e3 * np.exp(self._logs[nearest]):.4g} mm"
        )
