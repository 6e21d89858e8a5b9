"""Slow relaxation of the bow wave: measurement of its drift, and jumps of the whole state along its mode.

After a contact length of travel a rolled layer differs from its steady state by one mode, a bow wave that is too high
or too low. With the area A of the wave ahead of the roller and the travel s,

    dA/ds = (A_steady - A)/relaxation length,    load and resistance linear in A

The relaxation length is about ten contact lengths, far more than it is worth rolling. The slope dA/ds of a few steps
gives the distance to the steady state instead, and the layer jumps there along the difference of two settled states:

    state <- state + (A_steady - A)/(A_2 - A_1) (state_2 - state_1)

The next steps restore equilibrium and yield, and remove what is not part of the mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Self

import numpy as np

from compact.engines.compaction.finite_strain_solid import FloatArray, SolidState
from compact.engines.compaction.layer_state import LayerState
from compact.engines.compaction.roller_contact import ContactTractions
from compact.engines.compaction.roller_frame import transfer_state
from compact.engines.compaction.rolling import IncrementalRolling, RollingStep
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller

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
GROWTH, MAX_GROWTHS = 0.3, 7  # [-], required jump over the area, and number of successive ones with a steady state
MAX_UNSLOWED, SLOWING = 2, 0.8  # [-], such jumps if the growth per travel remains above that share of the first one
MIN_RESISTANCE = 3e-2  # [-], least scale of the resistance over the load; that of a driven roller may vanish
QUANTITIES = ("load", "resistance", "exit_density_ratio", "peak_pressure")  # of a `RollingStep`
MIN_SLOPE_ERROR = 0.02  # [-], least error of a slope of the wave over the largest one in a fit
MIN_CROSSING_CHANGE = 0.01  # [-], least change of the wave between states that bracket the steady one
LENGTH_EXPONENT = 2.0  # [-], of the relaxation length over the depth, roughly
CROSSING_STATES = 3  # [-], successive settled states that show an oscillation
PAIRS = 3  # [-], last settled states from which the relaxation length follows


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
    _values: list[float] = field(default_factory=list, init=False)

    @property
    def is_started(self) -> bool:
        """True if a depth has been recorded."""
        return bool(self._misses)

    @property
    def last_miss(self) -> float:
        """Last logarithm of the quantity over the target [-]; 0 for a prescribed depth."""
        return self._misses[-1] if self._misses else 0.0

    def next_depth(self, depth: float, value: float) -> float:
        """Return the next depth [m] from the quantity at a depth."""
        target = self.target
        if target.quantity == "indentation":
            return target.value
        self._logs.append(float(np.log(depth)))
        self._values.append(value)
        self._misses.append(target.log_miss(value))
        crossed = len(self._misses) > 1 and self._misses[-1] * self._misses[-2] < 0
        share = CROSSING_SHARE if crossed else 1.0  # the quantity scatters with the elements
        first, low, high = EXPONENTS[target.quantity]
        self.slope = first if self.slope is None else self.slope
        distant = np.flatnonzero(np.abs(np.array(self._logs) - self._logs[-1]) > MIN_SECANT)
        if len(distant):  # the secant to the last depth that is distant enough
            other = distant[-1]
            secant = (self._misses[-1] - self._misses[other]) / (self._logs[-1] - self._logs[other])
            self.slope = float(np.clip(secant, low, high))
        factor = float(np.exp(-share * self.last_miss / self.slope))
        return min(depth * float(np.clip(factor, 1 / MAX_DEPTH_FACTOR, MAX_DEPTH_FACTOR)), target.max_depth)

    def failure(self) -> str:
        """Return the message for a target that no depth satisfies."""
        depths, nearest = 1e3 * np.exp(self._logs), int(np.argmin(np.abs(self._misses)))
        return (
            f"`{self.target.quantity}` {self.target.value:g} not reached after {len(depths)} depths from "
            f"{depths.min():.4g} to {depths.max():.4g} mm, at most {1e3 * self.target.max_depth:.4g} mm; the nearest "
            f"was {self._values[nearest]:.5g} at {depths[nearest]:.4g} mm"
        )


@dataclass(frozen=True, eq=False)
class BowWaveMode:
    """Difference of two settled states of one mesh.

    Parameters
    ----------
    state : SolidState
        Difference of the states of the layer.
    pressure : ndarray, shape (n,)
        Difference of the pressures of the surface nodes [Pa].
    wave_area : float
        Difference of the areas of the wave [m2].
    slopes : ndarray, shape (4,)
        Change of `QUANTITIES` with the area of the wave per area of the wave.
    """

    state: SolidState
    pressure: FloatArray
    wave_area: float
    slopes: FloatArray

    @classmethod
    def between(cls, first: IncrementalRolling, second: IncrementalRolling, slopes: FloatArray) -> Self:
        """Return the mode from one settled state to another on the same mesh."""
        a, b = first.state, second.state
        difference = SolidState(
            b.displacement - a.displacement,
            b.points.map(np.subtract, a.points),
            b.work - a.work,
        )
        area = second.steps[-1].wave_area - first.steps[-1].wave_area
        return cls(difference, second.contact.pressure - first.contact.pressure, area, slopes)

    def on_mesh(self, old: IncrementalRolling, new: IncrementalRolling) -> Self:
        """Return the mode interpolated from the mesh of one roller to that of another."""
        state = transfer_state(self.state, old.frame, new.frame)
        return replace(self, state=state, pressure=np.interp(new.frame.surface_x, old.frame.surface_x, self.pressure))

    def add_to(self, rolling: IncrementalRolling, wave_area: float) -> None:
        """Change the state of a roller along the mode.

        Parameters
        ----------
        rolling : IncrementalRolling
            Roller on the mesh of the mode.
        wave_area : float
            Change of the area of the wave [m2].
        """
        factor, state = wave_area / self.wave_area, rolling.state
        points = state.points.map(lambda values, mode: values + factor * mode, self.state.points)
        points = replace(points, max_density_ratio=np.maximum(points.max_density_ratio, points.density_ratio))
        change = factor * self.state.displacement
        moved = SolidState(state.displacement + change, points, state.work + factor * self.state.work)
        pressure = np.maximum(rolling.contact.pressure + factor * self.pressure, 0.0)
        rolling.restart(moved, ContactTractions(pressure, rolling.contact.shear, rolling.contact.creepage), change)


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Slow relaxation of the bow wave.

    Parameters
    ----------
    length : float or None
        Relaxation length [m], None if unknown.
    mode : BowWaveMode or None
        Slow mode on the present mesh, None if unknown.
    first_length : float or None
        Relaxation length on the first mesh [m]; a finer mesh may shorten `length` where its wave oscillates.
    """

    length: float | None = None
    mode: BowWaveMode | None = None
    first_length: float | None = None

    def at_depth(self, ratio: float) -> Self:
        """Return the relaxation at a depth that differs by a ratio [-]."""
        factor = ratio**LENGTH_EXPONENT
        lengths = (None if length is None else length * factor for length in (self.length, self.first_length))
        return replace(self, **dict(zip(("length", "first_length"), lengths, strict=True)))


@dataclass(frozen=True, eq=False)
class WaveDrift:
    """Wave, load, resistance and exit density at the end of some steps, and their slopes over the travel.

    Parameters
    ----------
    travel : float
        Travel of the steps [m].
    wave_area, wave_slope, wave_error : float
        Area of the wave [m2], its slope and the standard error of the slope [m].
    values, slopes : ndarray, shape (4,)
        `QUANTITIES` [N/m, N/m, -, Pa] and their slopes over the travel [1/m].
    """

    travel: float
    wave_area: float
    wave_slope: float
    wave_error: float
    values: FloatArray
    slopes: FloatArray

    @classmethod
    def of_steps(cls, steps: Sequence[RollingStep]) -> Self:
        """Fit straight lines to some steps."""
        table = np.array([[getattr(step, name) for name in ("wave_area", *QUANTITIES)] for step in steps])
        travel = np.array([step.travel for step in steps]) - steps[-1].travel
        lines = np.stack([np.ones_like(travel), travel], axis=1)
        ends, slopes = np.linalg.lstsq(lines, table, rcond=None)[0]
        scatter = np.sum((table[:, 0] - lines @ [ends[0], slopes[0]]) ** 2) / max(len(steps) - 2, 1)
        error = np.sqrt(scatter / np.sum((travel - travel.mean()) ** 2))
        return cls(-float(travel[0]), float(ends[0]), float(slopes[0]), float(error), ends[1:], slopes[1:])


@dataclass(frozen=True, eq=False)
class SteadyErrors:
    """Estimated distance of a state from the steady state, in the units of `QUANTITIES`.

    Parameters
    ----------
    drift : ndarray, shape (4,)
        Distance along the slow mode.
    start : ndarray, shape (4,)
        Scatter of the drift, and the transient of the start.
    scale : ndarray, shape (4,)
        `QUANTITIES` of the state.
    """

    drift: FloatArray
    start: FloatArray
    scale: FloatArray

    @property
    def total(self) -> float:
        """Largest sum of both, of load and resistance over their own, the latter not too small, and of the density."""
        load, resistance = np.abs(self.scale[:2])
        return float(((self.drift + self.start)[:3] / [load, max(resistance, MIN_RESISTANCE * load), 1.0]).max())


@dataclass
class WaveGrowth:
    """Successive jumps by which a wave should grow by more than `GROWTH`.

    Attributes
    ----------
    slopes : list of float
        Growth of the wave over the travel before each of these jumps [m].
    """

    slopes: list[float] = field(default_factory=list)

    def record(self, drift: WaveDrift, jump: float) -> None:
        """Record the drift of a cycle and the jump to the steady wave [m2]."""
        self.slopes = [*self.slopes, drift.wave_slope] if jump > GROWTH * drift.wave_area else []

    @property
    def is_unslowed(self) -> bool:
        """True if the wave grows as fast as before the first jump, although it is much larger."""
        return len(self.slopes) > 1 and self.slopes[-1] > SLOWING * self.slopes[0]

    @property
    def is_endless(self) -> bool:
        """True if the wave has no steady state."""
        return len(self.slopes) > MAX_GROWTHS or (len(self.slopes) > MAX_UNSLOWED and self.is_unslowed)


@dataclass(frozen=True)
class ErrorParts:
    """Estimated relative errors of load and resistance [-], pairs.

    Parameters
    ----------
    mesh : tuple of float, or None
        Error of the finite elements; None for a single mesh.
    drift : tuple of float
        Distance to the steady state.
    start : tuple of float
        Scatter and transient.
    """

    mesh: tuple[float, float] | None = None
    drift: tuple[float, float] = (0.0, 0.0)
    start: tuple[float, float] = (0.0, 0.0)

    @property
    def total(self) -> tuple[float, float] | None:
        """Sums of the parts for load and resistance [-]; None without an estimate of the mesh."""
        if self.mesh is None:
            return None
        load, resistance = np.sum([self.mesh, self.drift, self.start], axis=0)
        return float(load), float(resistance)


def relaxation_length(drifts: Sequence[WaveDrift]) -> float | None:
    """Return the relaxation length of the wave [m] from settled states of one mesh, None if they give none.

    Parameters
    ----------
    drifts : sequence of WaveDrift
        Drifts at successive settled states.
    """
    if len(drifts) < 2:
        return None
    area, slope, error = np.array([(d.wave_area, d.wave_slope, d.wave_error) for d in drifts[-PAIRS:]]).T
    weights = 1 / (error**2 + (MIN_SLOPE_ERROR * np.abs(slope).max()) ** 2)
    from_mean = area - np.average(area, weights=weights)
    spread = np.sum(weights * from_mean**2)
    decay = -np.sum(weights * from_mean * slope) / spread if spread > 0 else 0.0
    return float(1 / decay) if decay > 0 else None


def crossing_length(drifts: Sequence[WaveDrift]) -> float | None:
    """Return the relaxation length [m] from the last of three waves that oscillate about the steady one, else None.

    The first drift on a mesh contains the transient of the transfer; one change of sign is no oscillation.

    Parameters
    ----------
    drifts : sequence of WaveDrift
        Drifts at successive settled states.
    """
    if len(drifts) < CROSSING_STATES:
        return None
    slopes = [drift.wave_slope for drift in drifts[-CROSSING_STATES:]]
    if any(a * b >= 0 for a, b in pairwise(slopes)):
        return None
    before, last = drifts[-2:]
    if abs(last.wave_area - before.wave_area) < MIN_CROSSING_CHANGE * last.wave_area:
        return None
    secant = (last.wave_area - before.wave_area) / (before.wave_slope - last.wave_slope)
    return secant if secant > 0 else None
