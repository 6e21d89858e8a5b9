"""Depth of a roller under which a prescribed load, peak pressure or exit density is satisfied."""

from dataclasses import dataclass, field

import numpy as np

from compact.engines.compaction.layer_state import LayerState
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller

TARGET_TOLERANCE = 1e-3  # [-], of a prescribed load or peak pressure
DENSITY_TOLERANCE = 4e-4  # [-], of a prescribed exit density ratio, over elements per contact length, as it scatters
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

    def depth_from(self, value: float, depth: float) -> float:
        """Return the first depth [m] from the prescribed quantity of a neighbouring result and its depth [m]."""
        if self.quantity == "indentation":
            return self.value
        factor = float(np.exp(-self.log_miss(value) / EXPONENTS[self.quantity][0]))
        return min(depth * factor, self.max_depth)

    def log_miss(self, value: float) -> float:
        """Return the logarithm of a quantity over the target; of a density, of its increase over the fed layer."""
        if self.quantity == "exit_density_ratio":  # proportional to the depth above the fed density
            return float(np.log(max(value - self.fed_ratio, MIN_DENSITY_INCREASE) / (self.value - self.fed_ratio)))
        return float(np.log(max(value / self.value, MIN_TARGET_RATIO)))  # an extrapolated value may be negative

    def tolerance(self, elements: float) -> float:
        """Return the tolerance of `log_miss` on a mesh of some elements per contact length [-]."""
        if self.quantity == "exit_density_ratio":
            return DENSITY_TOLERANCE / elements / (self.value - self.fed_ratio)
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

    Attributes
    ----------
    is_measured : bool
        True once measured quantities have taken the place of predicted ones.
    """

    target: DepthTarget
    slope: float | None = None
    is_measured: bool = field(default=False, init=False)
    _logs: list[float] = field(default_factory=list, init=False)
    _misses: list[float] = field(default_factory=list, init=False)
    _mesh_misses: list[float] = field(default_factory=list, init=False)
    _values: list[float] = field(default_factory=list, init=False)

    @property
    def last_miss(self) -> float:
        """Last logarithm of the quantity over the target [-]; 0 for a prescribed depth."""
        return self._misses[-1] if self._misses else 0.0

    def next_depth(self, depth: float, value: float, factor: float = 1.0) -> float:
        """Return the next depth [m] from the quantity at a depth on the mesh, and the reported one over it [-].

        The exponent is that on the mesh: the factor compares two meshes, and depends on the exponent itself.
        """
        target = self.target
        if target.quantity == "indentation":
            return target.value
        self._logs.append(float(np.log(depth)))
        self._values.append(value * factor)
        self._misses.append(target.log_miss(value * factor))
        self._mesh_misses.append(target.log_miss(value))
        crossed = len(self._misses) > 1 and self._misses[-1] * self._misses[-2] < 0
        share = CROSSING_SHARE if crossed else 1.0  # the quantity scatters with the elements
        first, low, high = EXPONENTS[target.quantity]
        self.slope = first if self.slope is None else self.slope
        distant = np.flatnonzero(np.abs(np.array(self._logs) - self._logs[-1]) > MIN_SECANT)
        if len(distant):  # the secant to the last depth that is distant enough
            other = distant[-1]
            secant = (self._mesh_misses[-1] - self._mesh_misses[other]) / (self._logs[-1] - self._logs[other])
            self.slope = float(np.clip(secant, low, high))
        factor = float(np.exp(-share * self.last_miss / self.slope))
        return min(depth * float(np.clip(factor, 1 / MAX_DEPTH_FACTOR, MAX_DEPTH_FACTOR)), target.max_depth)

    def measured_depth(self, depth: float, value: float, factor: float = 1.0) -> float:
        """Return `next_depth` from the measured quantity of the steady state at a depth; predictions end."""
        if not self.is_measured:
            self._logs, self._misses, self._mesh_misses, self._values, self.is_measured = [], [], [], [], True
        return self.next_depth(depth, value, factor)

    def failure(self) -> str:
        """Return the message for a target that no depth satisfies."""
        depths, nearest = 1e3 * np.exp(self._logs), int(np.argmin(np.abs(self._misses)))
        return (
            f"`{self.target.quantity}` {self.target.value:g} not reached after {len(depths)} depths from "
            f"{depths.min():.4g} to {depths.max():.4g} mm, at most {1e3 * self.target.max_depth:.4g} mm; the nearest "
            f"was {self._values[nearest]:.5g} at {depths[nearest]:.4g} mm"
        )
