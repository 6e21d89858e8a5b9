"""Law stage of a study: the motion laws of the scene, the optimal laws of [motion.optimise], and their cams."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from compact.analysis import machine_models
from compact.analysis.mix_laws import scene_mix
from compact.analysis.stages.contacts import Count, contact_stage
from compact.analysis.stages.resistance import ResistanceStage
from compact.cams.profile import Cam, FlatFace, Follower, LeastBreadth, Pointed, RollerFollower
from compact.machine.cart import MotionResistance
from compact.motion.limits import CamLimits, InfeasibleError, Limits
from compact.motion.optimal_motion import OptimalMotion, optimal_law_name, optimise
from compact.motion.profile import Cycle, MotionProfile, law
from compact.numerics.validation import require_known
from compact.scene.loader import Scene, SceneError
from compact.scene.schema import Optimise

COMPLIANT_DRIVES = ("elastic", "motor")  # kinds of drive whose cart deviates from the law
OVERSHOOT = 2.0  # [-], largest speed of a compliant drive over that of its law
EXTENSIONS = 8  # largest number of extensions of the resistance map for one optimal law
EXTENSION_FACTOR = 1.3  # [-], new over old largest speed
BOUND_SHARE = 1 - 1e-6  # [-], of the velocity limit; a faster law is restricted by it
FOLLOWERS = ("pointed", "roller", "flat")


class PrescribedLaws:
    """Motion laws that the scene names, tables of the user last.

    Parameters
    ----------
    shortest : float, optional
        Shortest duration of a pass for which the resistance is required [s]; that of the scene by default.
    added : sequence of MotionProfile
        Laws in addition to those of the scene.
    """

    def __init__(
        self, scene: Scene, count: Count, shortest: float | None = None, added: Sequence[MotionProfile] = ()
    ) -> None:
        self.scene, self.count, self._added = scene, count, tuple(added)
        duration = scene.motion.duration
        self.speed_ratio = duration / min(duration, shortest or duration, *scene.motion.other_durations)

    @cached_property
    def cycles(self) -> dict[str, Cycle]:
        """Forward and return strokes by name of the law."""
        cycles, dwell = {}, self.scene.motion.dwell
        for forward in (*machine_models.laws(self.scene), *self._added):
            self.count("laws")
            cycles[forward.name] = forward.cycle(dwell, dwell)
        return cycles

    @property
    def overshoot(self) -> float:
        """Largest speed of the cart over that of its law [-]."""
        return OVERSHOOT if self.scene.drive.kind in COMPLIANT_DRIVES else 1.0

    def largest_speed(self) -> float:
        """Return the largest speed of the cart under any law, the crank and each duration of a pass [m/s]."""
        motion = self.scene.motion
        speeds = [cycle.forward.peaks().velocity * self._jump_factor(cycle) for cycle in self.cycles.values()]
        if machine_models.crank(self.scene):
            crank_law = law("crank", motion.stroke, motion.duration, rod_length=motion.rod_length)
            speeds.append(crank_law.peaks().velocity)
        return float(max(speeds)) * self.overshoot * self.speed_ratio

    def _jump_factor(self, cycle: Cycle) -> float:
        """Return the factor of the speed behind a spring: a velocity jump at a reversal is twice the velocity."""
        jumps = self.scene.drive.kind == "elastic" and any(join.order == 1 for join in cycle.discontinuities())
        return OVERSHOOT if jumps else 1.0


class LawStage:
    """All motion laws of a scene, and their cams.

    Parameters
    ----------
    resistance : ResistanceStage
        Resistance for which laws are optimised; it is extended to faster laws.
    """

    def __init__(
        self, prescribed: PrescribedLaws, resistance: ResistanceStage, cycles: Mapping[str, Cycle] | None = None
    ) -> None:
        self.scene, self.count = prescribed.scene, prescribed.count
        self.prescribed, self.resistance = prescribed, resistance
        self.left_out: dict[str, str] = {}
        self._spread: dict[tuple[str, float], tuple[float, MotionResistance]] = {}
        if cycles is not None:
            self.cycles = dict(cycles)

    @cached_property
    def cycles(self) -> dict[str, Cycle]:
        """Forward and return strokes by name of the law; optimal laws last."""
        return self.prescribed.cycles | self.optimal_cycles

    @cached_property
    def optimal_cycles(self) -> dict[str, Cycle]:
        """Optimal laws by name, one per objective of [motion.optimise], for a rigid drive without rod.

        A law that no limits allow, or whose search does not converge, is left out with a warning; see `not_made`.
        """
        table, dwell = self.scene.motion.optimise, self.scene.motion.dwell
        if table is None:
            return {}
        _ = self.resistance.motion_resistance  # an error of the resistance is no error of a law
        cycles = {}
        for objective in table.objectives:
            self.count("laws")
            name = optimal_law_name([objective])
            try:
                forward = self._optimal_law(objective)
            except (InfeasibleError, RuntimeError) as error:
                self.left_out[name] = str(error)
                warnings.warn(f"{name} is not made: {error}", stacklevel=2)
                continue
            cycles[forward.name] = forward.cycle(dwell, dwell)
        return cycles

    def cycles_over(self, duration: float) -> dict[str, Cycle]:
        """Return all laws over another duration of a pass [s]; each keeps its shape."""
        return {
            name: replace(cycle.forward, duration=duration).cycle(cycle.far_dwell, cycle.near_dwell)
            for name, cycle in self.cycles.items()
        }

    @property
    def not_made(self) -> dict[str, str]:
        """Reason by name of each optimal law that is left out of `cycles`."""
        _ = self.cycles
        return self.left_out

    @property
    def limits(self) -> Limits:
        """Limits of [motion.optimise]; the velocity is limited to the range of the resistance map."""
        table, motion = self._table, self.scene.motion
        has_map = bool(self.resistance.contacts.speeds)
        known = self.resistance.largest_speed / self.prescribed.overshoot if has_map else np.inf
        velocity = min(known, table.velocity or np.inf)
        phases = Limits if table.steady_tolerance is None else motion
        return Limits(
            velocity=velocity if np.isfinite(velocity) else None,
            end_condition="dwell" if motion.dwell else "reversal",
            steady_tolerance=table.steady_tolerance or 0.0,
            cam=_cam_limits(self.scene, table),
            **table.model_dump(include={"acceleration", "jerk", "snap", "smoothness"}),
            **{phase: getattr(phases, phase) for phase in ("run_up", "run_down")},
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
        found = [self.resistance.motion_resistance]
        for name in self._table.spread:
            known = self.resistance.mix.parameter(name)
            found += [self._resistance_with(name, value) for value in (known.low, known.high)]
        return tuple(found)

    def _resistance_with(self, name: str, value: float) -> MotionResistance:
        """Return the resistance to the motion for another value of a parameter of the mix."""
        key, speed = (name, value), self.resistance.largest_speed
        if self._spread.get(key, (None,))[0] != speed:
            scene = self.scene.replaced(**{"motion.optimise": None, f"mix.overrides.{name}": value})
            other = ResistanceStage(contact_stage(scene, scene_mix(scene)), lambda: speed)
            self._spread[key] = speed, other.motion_resistance
        return self._spread[key][1]

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
            self.resistance.extend(EXTENSION_FACTOR * fastest * self.prescribed.overshoot)
        raise RuntimeError(
            f"the law of least {objective.replace('_', ' ')} reaches the largest velocity of the resistance map, "
            f"{limits.velocity:.3g} m/s, after {EXTENSIONS} extensions; bound its `velocity` or `acceleration` in "
            "[motion.optimise]"
        )

    @cached_property
    def cams(self) -> dict[tuple[str, str], Cam]:
        """Cams of constant breadth by law and follower."""
        return {(name, follower): self.cam(name, follower) for name in self.cycles for follower in FOLLOWERS}

    @cached_property
    def least_breadths(self) -> dict[tuple[str, str], LeastBreadth]:
        """Least breadths of the cams by law and follower."""
        found = {}
        for key, cam in self.cams.items():
            self.count("cams measured")
            found[key] = cam.least_breadth()
        return found

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
        optimised = self.scene.motion.optimise
        optimal = [optimal_law_name([objective]) for objective in optimised.objectives] if optimised else []
        require_known("motion law", name, (*self.prescribed.cycles, *optimal))
        cycle = self.prescribed.cycles.get(name) or self.cycles.get(name)
        if cycle is None:
            raise RuntimeError(f"no cam: {name} is not made: {self.left_out[name]}")
        rolling = RollerFollower(table.roller_follower_radius)
        followers: dict[str, Follower] = {"pointed": Pointed(), "roller": rolling, "flat": FlatFace()}
        return Cam(cycle, table.breadth, followers[follower])


def _cam_limits(scene: Scene, table: Optimise) -> CamLimits | None:
    """Return the limits of the cam in [motion.optimise], None without one."""
    angle, flat, profile = table.pressure_angle, table.radius_of_curvature, table.profile_radius
    if (angle, flat, profile) == (None, None, None):
        return None
    assert scene.cam is not None  # rule of the scene
    return CamLimits(scene.cam.breadth, angle, flat, scene.motion.dwell, profile, scene.cam.roller_follower_radius)
