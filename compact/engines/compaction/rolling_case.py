"""Case of steady rolling: options, frames and rollers at rest or stretched from a neighbour, depth of a target."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from compact.engines.compaction.finite_strain_solid import SolidState
from compact.engines.compaction.heaping import MAX_CONTACT_ANGLE, HeapingEstimate
from compact.engines.compaction.layer_state import LayerState, compacted_lift, rate_factor_at
from compact.engines.compaction.roller_frame import RollerFrame, rolling_mesh
from compact.engines.compaction.rolling import PARTS, IncrementalRolling, Progress
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics.validation import require_between, require_known, require_positive
from compact.rolling_contact import Layer, Roller

TARGET_TOLERANCE = 1e-3  # [-], of a prescribed load or peak pressure
DENSITY_TOLERANCE = 4e-4  # [-], of a prescribed exit density ratio, over elements per contact length, as it scatters
COARSE_LEEWAY = 10.0  # [-], tolerance of a target with fewer parts of a step over that of the result
MIN_TARGET_RATIO = 1e-3  # [-], least extrapolated load or pressure over the target
MIN_DENSITY_INCREASE = 1e-6  # [-], least extrapolated increase of the density ratio
STRAIN_DEPTH = 1.5  # [-], depth of the strained mix over the contact length, for the first depth
PEAK_FACTOR = 1.15  # [-], peak pressure over the yield pressure of the exit density, for the first depth
MEAN_FACTOR = 0.7  # [-], load over peak pressure and contact length ahead, for the first depth; about Hertz's 2/3
MAX_DEPTH_FACTOR = 1.4  # [-], largest ratio of successive depths
MAX_DEPTH_SHARE = 0.98  # [-], largest depth over that of full density at the exit
EXPONENTS = {  # [-], first, least and largest exponent of a quantity over the depth
    "load": (1.2, 0.3, 3.0), "peak_pressure": (1.0, 0.3, 3.0), "exit_density_ratio": (1.0, 0.7, 1.4),
}  # fmt: skip
CROSSING_SHARE = 0.5  # [-], of a correction after one that was too large
MIN_SECANT = 0.04  # [-], least difference of logarithms of depths for a secant; values of closer ones scatter
INCREMENTS = 7  # [-], elements per contact length sqrt(2 R depth)
STEADY_TOLERANCE = 1e-3  # [-], estimated distance of load, resistance and exit density from the steady state


@dataclass(frozen=True, kw_only=True)
class RollingNumerics:
    """Numerical options of `roll`.

    Parameters
    ----------
    strain : {"finite", "small"}
        Strain measure; small strain is fair up to contact angles of 12 to 15 degrees, and its density ratio is low by
        half a squared strain.
    increments : int
        Elements per contact length, each rolled over in `rolling.PARTS` parts.
    steady_tolerance : float
        Relative tolerance of the steady state: estimated remaining change of load, resistance and exit density [-].
    max_contact_angle : float or None
        Contact angle at which a bow wave counts as unbounded [rad], up to pi/2. Depths and loads in fresh mix that
        require more are refused, and incremental rolling ends there. None omits both.
    progress : callable, optional
        Called with a line of text after each step.

    Raises
    ------
    ValueError
        If an option is out of its range.
    """

    strain: Literal["finite", "small"] = "finite"
    increments: int = INCREMENTS
    steady_tolerance: float = STEADY_TOLERANCE
    max_contact_angle: float | None = MAX_CONTACT_ANGLE
    progress: Progress | None = None

    def __post_init__(self) -> None:
        require_known("strain", self.strain, ("finite", "small"))
        require_positive(increments=self.increments, steady_tolerance=self.steady_tolerance)
        if self.max_contact_angle is not None:
            require_positive(max_contact_angle=self.max_contact_angle)
            require_between(0.0, np.pi / 2, max_contact_angle=self.max_contact_angle)


@dataclass(frozen=True, eq=False)
class RollingCase:
    """Arguments of `roll`, from which frames and rollers at rest are created.

    Parameters
    ----------
    layer, roller, material, speed, torque, fed_layer
        As of `roll`.
    numerics : RollingNumerics
        Numerical options.
    """

    layer: Layer
    roller: Roller
    material: Compaction
    speed: float
    torque: float | None
    fed_layer: LayerState | None
    numerics: RollingNumerics

    @cached_property
    def lower(self) -> LayerState | None:
        """Lower lift before the pass, all mix below the fed layer; None on the rigid base."""
        if self.fed_layer is not None:
            return None if self.fed_layer.lower is None else self.fed_layer.lower.stacked
        lift = self.layer.lower_lift
        if lift is None:
            return None
        rate = lift.compaction_rate(self.speed, self.roller.radius, self.material.fed_density_ratio)
        return compacted_lift(lift, self.material, self.material.rate_factor(rate))

    @cached_property
    def heaping(self) -> HeapingEstimate | None:
        """Estimate of the largest depth; None if it does not apply. It regards a lower lift as rigid.

        It is fitted to the elliptic cap: with a shear line only its contact angle limits the wave.
        Small strain causes no bow wave, and mix on a frictionless base may elongate instead of being compacted.
        """
        angle = self.numerics.max_contact_angle
        if angle is None or self.numerics.strain == "small" or self.layer.base == "slip":
            return None
        sliding = self.roller.friction if self.roller.rolling == "sliding" else 0.0
        radius = self.roller.radius
        estimate = HeapingEstimate(self.layer.height, radius, self.material, angle, sliding_friction=sliding)
        deepest = min(estimate.contact_height, self.layer.height * (1 - self.material.fed_density_ratio))
        return replace(estimate, rate_factor=self.rate_factor(deepest))

    def rate_factor(self, depth: float) -> float:
        """Return the factor of the yield pressure [-] by the rate of compaction at a depth [m]."""
        return rate_factor_at(self.material, self.roller.radius, self.layer.height, depth, self.speed, self.fed_layer)

    def create_frame(self, depth: float, increments: int) -> RollerFrame:
        """Create the frame for a depth [m] with a number of elements per contact length."""
        length = np.sqrt(2 * self.roller.radius * depth)
        lower_height = 0.0 if self.lower is None else self.lower.height
        mesh = rolling_mesh(self.layer.height, length, length / increments, lower_height)
        return self._frame_on(mesh, depth, self.numerics.strain == "finite")

    def _frame_on(self, mesh: RowMesh, depth: float, finite: bool) -> RollerFrame:
        length, fed = float(np.sqrt(2 * self.roller.radius * depth)), self.fed_layer
        frame = RollerFrame(
            mesh, self.material, self.layer.base, length, fed_layer=fed, lower=self.lower, finite=finite
        )
        frame.solid.rate_factor = self.rate_factor(depth)
        return frame

    def roller_at_rest(self, frame: RollerFrame, parts: int = PARTS) -> IncrementalRolling:
        """Create the roller above the fed layer of a frame, with a number of parts of a step."""
        rolling = IncrementalRolling(frame, self.roller, self.torque or 0.0, parts)
        rolling.max_wave_height = np.inf if self.heaping is None else self.heaping.contact_height
        rolling.progress = self.numerics.progress
        return rolling

    def stretched(self, old: IncrementalRolling, depth: float) -> IncrementalRolling:
        """Return the roller of this case at the state of another one stretched to a depth.

        The mesh is stretched with contact length and layer height. Strains change in proportion to depth over height,
        stresses to the yield pressure. The roller remains in place; the next steps move it and restore equilibrium.

        Parameters
        ----------
        old : IncrementalRolling
            Roller in a state with a similar fed layer.
        depth : float
            Depth [m].
        """
        frame, state, points = old.frame, old.state, old.state.points
        # each lift is stretched by itself
        along = float(np.sqrt(2 * self.roller.radius * depth)) / frame.contact_length
        across = self.layer.height / (frame.mesh.height - frame.lower_height)
        y = across * (frame.mesh.y - frame.lower_height)
        if self.lower is not None and self.lower.height:
            below = np.minimum(frame.mesh.y, frame.lower_height)
            y = np.maximum(y, 0.0) + below * (self.lower.height / frame.lower_height)
        mesh = RowMesh(along * frame.mesh.x, y)
        rolling = self.roller_at_rest(self._frame_on(mesh, depth, frame.solid.finite), len(old.parts))
        strain = depth / old.depth / across
        fed, old_fed = rolling.frame.initial_state().points, frame.initial_state().points
        ratios = {
            name: getattr(fed, name) * (getattr(points, name) / getattr(old_fed, name)) ** strain
            for name in ("density_ratio", "max_density_ratio")
        }
        after, before = ratios["max_density_ratio"], points.max_density_ratio
        strengths = rolling.frame.solid.yield_pressure(after), frame.solid.yield_pressure(before)
        stress = np.asarray(strengths[0] / strengths[1])
        moved = cap_plasticity.MaterialPoint(
            points.stress * stress[:, None], **ratios, plastic_work=points.plastic_work * stress * strain
        )
        displacement = state.displacement * strain * across
        rolling.initialise_from(old, SolidState(displacement, moved, state.work * stress * strain), depth)
        return rolling


class DepthTarget:
    """Prescribed quantity of a roller and its first depth.

    Parameters
    ----------
    case : RollingCase
        Case; the target of the roller is prescribed by default.
    exit_density_ratio : float, optional
        Mean exit density ratio that is prescribed instead [-].
    """

    def __init__(self, case: RollingCase, exit_density_ratio: float | None = None) -> None:
        self.case, self.height, fed, lower = case, case.layer.height, case.fed_layer, case.lower
        self.fed_ratio = case.material.fed_density_ratio if fed is None else fed.density_ratio
        self.max_depth = MAX_DEPTH_SHARE * self.height * (1 - self.fed_ratio)
        if lower is not None:
            self.max_depth += MAX_DEPTH_SHARE * lower.height * max(1 - lower.density_ratio, 0.0)
        self.densest = self.fed_ratio if fed is None else float(fed.points.density_ratio.max())
        self.quantity, self.value = case.roller.target
        if exit_density_ratio is not None:
            self.quantity, self.value = "exit_density_ratio", exit_density_ratio
            if not self.fed_ratio < exit_density_ratio < 1:
                fed_mix = f"that of the fed mix {self.fed_ratio:.6g}"
                raise ValueError(f"`exit_density_ratio` must lie between {fed_mix} and 1, got {exit_density_ratio!r}")

    @property
    def required_depth(self) -> float | None:
        """Depth that the target requires [m], None for a load or a pressure."""
        if self.quantity == "indentation":
            return self.value
        return self.height * (1 - self.fed_ratio / self.value) if self.quantity == "exit_density_ratio" else None

    def initial_depth(self) -> float:
        """Return the prescribed indentation or an estimate of the depth [m]."""
        material, radius = self.case.material, self.case.roller.radius
        if self.case.roller.indentation is not None:
            return self.case.roller.indentation
        deepest = min(0.2 * self.height, 0.9 * self.max_depth, 0.9 * radius)
        depths = np.geomspace(min(1e-5 * self.height, 1e-3 * deepest), deepest, 100)
        length = np.sqrt(2 * radius * depths)
        strain = depths / np.minimum(self.height, STRAIN_DEPTH * length)
        peak = PEAK_FACTOR * material.yield_pressure(self.densest / (1 - strain))
        if self.quantity == "peak_pressure":
            return float(np.interp(self.value, peak, depths))
        elastic = material.unloading_modulus / (1 - material.poisson**2) / 4  # of a layer already compacted
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

    def tolerance(self, elements: float, parts: int) -> float:
        """Return the tolerance of `log_miss` for elements per contact length and parts of a step [-]."""
        leeway = 1.0 if parts == PARTS else COARSE_LEEWAY
        if self.quantity == "exit_density_ratio":
            return leeway * DENSITY_TOLERANCE / elements / (self.value - self.fed_ratio)
        return leeway * TARGET_TOLERANCE


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
    _rows: list[tuple[float, float, float, float]] = field(default_factory=list, init=False)  # as of `next_depth`

    @property
    def last_miss(self) -> float:
        """Last logarithm of the quantity over the target [-]; 0 for a prescribed depth."""
        return self._rows[-1][2] if self._rows else 0.0

    def next_depth(self, depth: float, value: float, factor: float = 1.0, measured: bool = False) -> float:
        """Return the next depth [m] from the quantity at a depth on the mesh, and the reported one over it [-].

        The exponent is that on the mesh: the factor compares two meshes, and depends on the exponent itself. The first
        measured quantity of a steady state ends the predictions.
        """
        if measured and not self.is_measured:
            self._rows, self.is_measured = [], True
        target = self.target
        if target.quantity == "indentation":
            return target.value
        reported = value * factor
        row = float(np.log(depth)), target.log_miss(value), target.log_miss(reported), reported
        share = CROSSING_SHARE if self.last_miss * row[2] < 0 else 1.0  # the quantity scatters with the elements
        self._rows.append(row)
        logs, misses, *_ = np.array(self._rows).T
        first, low, high = EXPONENTS[target.quantity]
        self.slope = first if self.slope is None else self.slope
        distant = np.flatnonzero(np.abs(logs - logs[-1]) > MIN_SECANT)
        if len(distant):  # the secant to the last depth that is distant enough
            secant = (misses[-1] - misses[distant[-1]]) / (logs[-1] - logs[distant[-1]])
            self.slope = float(np.clip(secant, low, high))
        factor = float(np.exp(-share * self.last_miss / self.slope))
        return min(depth * float(np.clip(factor, 1 / MAX_DEPTH_FACTOR, MAX_DEPTH_FACTOR)), target.max_depth)

    def failure(self) -> str:
        """Return the message for a target that no depth satisfies."""
        logs, _, misses, values = np.array(self._rows).T
        depths, nearest = 1e3 * np.exp(logs), int(np.argmin(np.abs(misses)))
        return (
            f"`{self.target.quantity}` {self.target.value:g} not reached after {len(depths)} depths from "
            f"{depths.min():.4g} to {depths.max():.4g} mm, at most {1e3 * self.target.max_depth:.4g} mm; the nearest "
            f"was {values[nearest]:.5g} at {depths[nearest]:.4g} mm"
        )
