"""Case and numerical options of steady rolling: frames and rollers at rest for them, or stretched from a neighbour."""

from dataclasses import dataclass, replace
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
        return RollerFrame(
            mesh,
            self.material,
            self.layer.base,
            float(np.sqrt(2 * self.roller.radius * depth)),
            fed_layer=self.fed_layer,
            lower=self.lower,
            finite=finite,
            rate_factor=self.rate_factor(depth),
        )

    def roller_at_rest(self, frame: RollerFrame, parts: int = PARTS) -> IncrementalRolling:
        """Create the roller above the fed layer of a frame, with a number of parts of a step."""
        limit = np.inf if self.heaping is None else self.heaping.contact_height
        torque, progress = self.torque or 0.0, self.numerics.progress
        return IncrementalRolling(frame, self.roller, torque, max_wave_height=limit, parts=parts, progress=progress)

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
        pressure, old_pressure = (
            solid.material.yield_pressure(densest) * solid.rate_factor
            for solid, densest in (
                (rolling.frame.solid, ratios["max_density_ratio"]),
                (frame.solid, points.max_density_ratio),
            )
        )
        stress = np.asarray(pressure / old_pressure)
        moved = cap_plasticity.MaterialPoint(
            points.stress * stress[:, None], **ratios, plastic_work=points.plastic_work * stress * strain
        )
        displacement = state.displacement * strain * across
        rolling.initialise_from(old, SolidState(displacement, moved, state.work * stress * strain), depth)
        return rolling
