"""Law stage of a study: the motion laws of the scene, the optimal laws of [motion.optimise], and their cams."""

import warnings
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from compact.analysis import machine_models
from compact.analysis.stages.contacts import Count, contact_stage
from compact.analysis.stages.resistance import ResistanceStage
from compact.cams.machining import cut
from compact.cams.profile import FOLLOWERS, Cam
from compact.cams.workshop_drawing import WorkshopDrawing, workshop_drawing
from compact.machine.cart import MotionResistance
from compact.machine.drives import DRIVES, OVERSHOOT
from compact.motion.limits import CamLimits, InfeasibleError, Limits
from compact.motion.optimal_motion import OptimalMotion, optimal_law_name, optimise
from compact.motion.profile import Cycle, MotionProfile, law
from compact.numerics.validation import require_known
from compact.scene.loader import Scene, SceneError
from compact.scene.schema import Optimise

if TYPE_CHECKING:
    from compact.analysis.robust.law import RobustLaw

EXTENSIONS = 8  # largest number of extensions of the resistance map for one optimal law
EXTENSION_FACTOR = 1.3  # [-], new over old largest speed
BOUND_SHARE = 1 - 1e-6  # [-], of the velocity limit; a faster law is restricted by it


class CamDrawing(NamedTuple):
    """Drawing of the cam of one law, or the reason for which the cam cannot be cut."""

    law: str
    drawing: WorkshopDrawing | None
    reason: str = ""


class LawStage:
    """All motion laws of a scene, and their cams; each attribute is computed when first used.

    Parameters
    ----------
    shortest : float, optional
        Shortest duration of a pass for which the resistance is required [s]; that of the scene by default.
    added : sequence of MotionProfile
        Laws in addition to those of the scene.

    Attributes
    ----------
    resistance : ResistanceStage
        Resistance for which laws are optimised, set after construction; it is extended to faster laws.
    robust : dict of str to RobustLaw
        Robust laws by name, with their worst peaks and ranges, once `cycles` is computed.
    """

    resistance: ResistanceStage

    def __init__(
        self, scene: Scene, count: Count, shortest: float | None = None, added: Sequence[MotionProfile] = ()
    ) -> None:
        self.scene, self.count, self._added = scene, count, tuple(added)
        self._left_out: dict[str, str] = {}
        self.robust: dict[str, RobustLaw] = {}
        self._spread: dict[float, list[MotionResistance]] = {}  # by the largest speed
        duration = scene.motion.duration
        self._speed_ratio = duration / min(duration, shortest or duration, *scene.motion.other_durations)

    @cached_property
    def prescribed(self) -> dict[str, Cycle]:
        """Forward and return strokes by name of the laws that the scene names, tables of the user last."""
        cycles, dwell = {}, self.scene.motion.dwell
        for forward in (*machine_models.laws(self.scene), *self._added):
            self.count("laws")
            cycles[forward.name] = forward.cycle(dwell, dwell)
        return cycles

    @property
    def overshoot(self) -> float:
        """Largest speed of the cart over that of its law [-]."""
        return DRIVES[self.scene.drive.kind].overshoot

    def largest_speed(self) -> float:
        """Return the largest speed of the cart under any prescribed law, the crank and each duration of a pass [m/s].

        Behind a spring a velocity jump at a reversal is twice the velocity.
        """
        motion, driven_end, speeds = self.scene.motion, DRIVES[self.scene.drive.kind].driven_end, []
        for cycle in self.prescribed.values():
            jumps = driven_end and any(join.order == 1 for join in cycle.discontinuities())
            speeds.append(cycle.forward.peaks().velocity * (OVERSHOOT if jumps else 1.0))
        if motion.rod_length is not None:
            speeds.append(law("crank", motion.stroke, motion.duration, rod_length=motion.rod_length).peaks().velocity)
        return float(max(speeds)) * self.overshoot * self._speed_ratio

    @cached_property
    def cycles(self) -> dict[str, Cycle]:
        """Forward and return strokes by name of the law; last the optimal laws, one per objective of [motion.optimise].

        Optimal laws are those for a rigid drive without rod, robust ones those for the elastic drives of `plant_range`.
        One that no limits allow, or whose search does not converge, is left out with a warning; see `not_made`.
        """
        cycles, dwell = dict(self.prescribed), self.scene.motion.dwell
        if self._optimal_names:
            _ = self.resistance.motion_resistance  # an error of the resistance is no error of a law
        for name, objective in self._optimal_names.items():
            self.count("laws")
            try:
                found = self._robust_law(objective) if objective.startswith("robust_") else self._optimal_law(objective)
                cycles[name] = found.cycle(dwell, dwell)
            except (InfeasibleError, RuntimeError) as error:
                self._left_out[name] = str(error)
                warnings.warn(f"{name} is not made: {error}", stacklevel=2)
        return cycles

    @property
    def _optimal_names(self) -> dict[str, str]:
        """Objectives of [motion.optimise] by name of their law."""
        table = self.scene.motion.optimise
        return {optimal_law_name([objective]): objective for objective in table.objectives} if table else {}

    @property
    def not_made(self) -> dict[str, str]:
        """Reason by name of each optimal law that is left out of `cycles`."""
        _ = self.cycles
        return self._left_out

    @property
    def limits(self) -> Limits:
        """Limits of [motion.optimise]; the velocity is limited to the range of the resistance map."""
        table, motion, cam = self._table, self.scene.motion, self.scene.cam
        known = self.resistance.largest_speed / self.overshoot if self.resistance.contacts.speeds else np.inf
        velocity = min(known, table.velocity or np.inf)
        phases = Limits if table.steady_tolerance is None else motion
        on_cam = table.model_dump(include={"pressure_angle", "radius_of_curvature"}, exclude_none=True)
        if cam and on_cam:
            on_cam |= {"breadth": cam.breadth, "dwell": motion.dwell}
        return Limits(
            velocity=velocity if np.isfinite(velocity) else None,
            run_up=phases.run_up,
            run_down=phases.run_down,
            end_condition="dwell" if motion.dwell else "reversal",
            steady_tolerance=table.steady_tolerance or 0.0,
            cam=CamLimits(**on_cam) if cam and on_cam else None,
            **table.model_dump(include={"acceleration", "jerk", "snap", "smoothness"}),
        )

    @property
    def _table(self) -> Optimise:
        """Table [motion.optimise], of a scene that has one."""
        table = self.scene.motion.optimise
        assert table is not None  # without it no law is optimised
        return table

    @property
    def motion_resistances(self) -> tuple[MotionResistance, ...]:
        """Resistance to the motion, first as computed, then at both ends of each spread of [motion.optimise]."""
        mix, speed = self.resistance.mix, self.resistance.largest_speed
        if speed not in self._spread:
            ends = [(name, getattr(mix.parameter(name), end)) for name in self._table.spread for end in ("low", "high")]
            changed = ({"motion.optimise": None, f"mix.overrides.{name}": value} for name, value in ends)
            others = (ResistanceStage(contact_stage(self.scene.replaced(**keys)), lambda: speed) for keys in changed)
            self._spread[speed] = [each.motion_resistance for each in others]
        return (self.resistance.motion_resistance, *self._spread[speed])

    def _robust_law(self, objective: str) -> MotionProfile:
        """Return the law with the least worst peak over the drives and resistances of the scene."""
        from compact.analysis.robust.law import robust_law  # compiled code, imported when required
        from compact.analysis.stages.robust_range import plant_range

        motion, stage = self.scene.motion, self.resistance
        plants = plant_range(self.scene, stage, [each.resistance for each in self.motion_resistances])
        found = robust_law(stage.cart, plants, motion.stroke, motion.duration, self.limits, objective=objective)
        self.robust[found.motion.name] = found
        return found.motion

    def _optimal_law(self, objective: str) -> OptimalMotion:
        """Return the law that minimises an objective; over a spread of the mix that of least regret.

        The resistance is extended as long as the velocity limit of its range is active and the scene has no lower one.
        Raises RuntimeError if it is active each time, InfeasibleError if no law satisfies the limits.
        """
        motion = self.scene.motion
        for _ in range(EXTENSIONS):
            limits, resistances = self.limits, self.motion_resistances
            task = objective, motion.stroke, motion.duration, self.resistance.cart.mass, resistances, limits
            bounded = limits.velocity in (None, self._table.velocity)
            fastest = limits.velocity or np.inf
            try:
                found = optimise(*task, regret=len(resistances) > 1)
            except InfeasibleError as error:
                if bounded or "velocity" not in {conflict.name for conflict in error.conflicts}:
                    raise
            else:
                if bounded or found.peaks().velocity < BOUND_SHARE * fastest:
                    return found
            self.resistance.extend(EXTENSION_FACTOR * fastest * self.overshoot)
        raise RuntimeError(
            f"the law of least {objective.replace('_', ' ')} reaches the largest velocity of the resistance map, "
            f"{limits.velocity:.3g} m/s, after {EXTENSIONS} extensions; bound its `velocity` or `acceleration` in "
            "[motion.optimise]"
        )

    @cached_property
    def cams(self) -> dict[tuple[str, str], Cam]:
        """Cams of constant breadth by law and follower."""
        return {(name, follower): self.cam(name, follower) for name in self.cycles for follower in FOLLOWERS}

    def cam(self, name: str, follower: str) -> Cam:
        """Return the cam of constant breadth of one law.

        Parameters
        ----------
        name : str
            Name of the law. A prescribed law requires no optimisation.
        follower : str
            One of FOLLOWERS.

        Raises
        ------
        SceneError
            If the scene has no table [cam].
        RuntimeError
            If the law is not made.
        """
        table = self.scene.cam
        if table is None:
            raise SceneError(["cam: missing; a cam needs a table [cam] with breadth and roller_follower_radius in m"])
        self.count("cams")
        require_known("motion law", name, (*self.prescribed, *self._optimal_names))
        cycle = self.prescribed.get(name) or self.cycles.get(name)
        if cycle is None:
            raise RuntimeError(f"no cam: {name} is not made: {self._left_out[name]}")
        return Cam(cycle, table.breadth, FOLLOWERS[follower](table.roller_follower_radius))

    def drawing(self, name: str) -> CamDrawing:
        """Draw the cam of a law for a roller follower, cut with the default tolerance."""
        try:
            outline = cut(self.cams[name, "roller"])
            return CamDrawing(name, workshop_drawing(outline, self.scene.cam.bore if self.scene.cam else None))
        except ValueError as error:  # undercut, corners, or a bore that is too large
            return CamDrawing(name, None, str(error))
