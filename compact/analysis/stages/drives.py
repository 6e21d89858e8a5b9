"""Drive stage of a study: every law under the drive of the scene, their ranking, and roller motors and crankshaft.

`Stages` are all stages of a scene, up to this one; each uses those before it only.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from compact import drive
from compact.analysis import machine_models
from compact.analysis.contact_cases import Progress
from compact.analysis.mix_laws import scene_mix
from compact.analysis.ranking_uncertainty import Place, places
from compact.analysis.stages.contacts import ContactStage, Count, contact_stage, no_count
from compact.analysis.stages.laws import LawStage, PrescribedLaws
from compact.analysis.stages.resistance import ResistanceLaw, ResistanceStage
from compact.analysis.stages.torque_response import torque_response
from compact.machine.cart import Cart
from compact.machine.crankshaft import CRANK_ANGLES, CrankshaftRevolution, simulate_crankshaft
from compact.machine.ranking import Ranked
from compact.machine.rigid_drive import InverseDynamics
from compact.machine.roller_motors import RollerMotor, pull_range
from compact.material.mix import Mix
from compact.motion.profile import Cycle, MotionProfile
from compact.scene.loader import Scene

Runs = dict[str, Any]  # name of a law -> `Run`, `ElasticRun`, `HydraulicRun` or `MotorRun`
KnownLaws = tuple[Mapping[str, Cycle], Mapping[str, Cycle]]  # prescribed laws, and all laws


class DriveStage:
    """Runs of all laws of a scene; each attribute is computed when first used."""

    def __init__(self, contacts: ContactStage, resistance: ResistanceStage, laws: LawStage) -> None:
        self.scene, self.count = contacts.scene, contacts.count
        self.contacts, self.resistance, self.laws = contacts, resistance, laws

    @cached_property
    def runs(self) -> Runs:
        """A `Run`, `ElasticRun`, `HydraulicRun` or `MotorRun` by name of the law."""
        return dict(self._runs(self.resistance.resistance, nullcontext()))

    @cached_property
    def heavier_runs(self) -> Runs | None:
        """Runs under the resistance plus its error; None without error estimate.

        A law that the drive cannot follow under this resistance has no run.
        """
        if self.resistance.error is None:
            return None
        return dict(self._runs(self.resistance.map.scaled(1 + self.resistance.error), suppress(RuntimeError)))

    def _runs(self, resistance: Any, tolerated: AbstractContextManager[Any]) -> Iterator[tuple[str, Any]]:
        return self.simulated(self.laws.cycles, resistance, tolerated, begin=partial(self.count, "runs"))

    def simulated(
        self,
        cycles: Mapping[str, Cycle],
        resistance: Any,
        tolerated: AbstractContextManager[Any],
        scene: Scene | None = None,
        begin: Callable[[], object] = lambda: None,
    ) -> Iterator[tuple[str, Any]]:
        """Simulate laws with the cart of the study as `simulate_laws`, by default with its drive."""
        return simulate_laws(scene or self.scene, self.resistance.cart, cycles, resistance, tolerated, begin)

    @cached_property
    def rankings(self) -> dict[str, list[Ranked]]:
        """Laws in order, by each criterion of the scene."""
        self.count("rankings")
        return {by: drive.rank(self.runs.values(), by) for by in self.scene.drive.rank_by}

    @property
    def best_law(self) -> str:
        """Name of the first law by the first criterion of the scene."""
        return self._ranked_runs[0].name

    @cached_property
    def places(self) -> dict[str, dict[str, list[Place]]]:
        """Places of the laws by drive and criterion: the drive of the scene, and a rigid one if that is elastic."""
        runs = {self.scene.drive.kind: (self.rankings, self.heavier_runs)}
        if self.scene.drive.kind == "elastic":
            rigid = {name: run.rigid for name, run in self.runs.items()}
            heavier = self.heavier_runs and {name: run.rigid for name, run in self.heavier_runs.items()}
            runs["rigid"] = ({by: drive.rank(rigid.values(), by) for by in self.rankings}, heavier)
        return {
            kind: {by: places(ranked, by, heavier) for by, ranked in rankings.items()}
            for kind, (rankings, heavier) in runs.items()
        }

    @cached_property
    def other_durations(self) -> dict[float, "DriveStage"]:
        """Drive stage by each other duration of a pass [s]; contacts and cart of a single pass are the same."""
        return {duration: self.over(duration) for duration in self.scene.motion.other_durations}

    def over(self, duration: float) -> "DriveStage":
        """Return the drive stage of all laws over another duration of a pass [s].

        Raises
        ------
        ValueError
            When a law is faster than the resistance is known; `largest_speed` covers the durations of the scene.
        """
        resistance = self.resistance.over(duration)
        laws = LawStage(self.laws.prescribed, resistance, self.laws.cycles_over(duration))
        return DriveStage(resistance.contacts, resistance, laws)

    @cached_property
    def cycle_energies(self) -> dict[str, float]:
        """Energy of a cycle [J] over "fresh" and "compacted" mix on the return stroke; empty without a second pass.

        The drive is rigid, the law is `best_law`.
        """
        if self.contacts.second_pass is None:
            return {}
        cycle = self.laws.cycles[self.best_law]
        ratios = {"fresh": (1.0, 1.0), "compacted": self.contacts.second_pass}
        return {
            over: drive.simulate(
                machine_models.cart(self.scene, self.contacts.roller_load, load), drive.Rigid(), cycle,
                replace(self.resistance.map, return_ratio=resistance),
            ).energy
            for over, (load, resistance) in ratios.items()
        }  # fmt: skip

    @cached_property
    def motor_start(self) -> tuple[str, Any] | None:
        """First law that the motor drives, and the start from rest with it; None where the motor does not start."""
        from compact.machine.motor_drive import simulate_acceleration_phase

        first = next((run for run in self._ranked_runs if hasattr(run, "load")), None)
        if first is None:
            return None
        self.count("run-up")
        try:
            load = first.load
            return first.name, simulate_acceleration_phase(load.cart, load.motor, load.cycle, load.resistance)
        except RuntimeError as error:
            warnings.warn(f"no start from rest under '{first.name}': {error}", stacklevel=2)
            return None

    @cached_property
    def hydraulic_stroke(self) -> tuple[Any, Any] | None:
        """Run of the first law that the throttles realise, and its stroke with compressible oil; None without one."""
        first = next((run for run in self._ranked_runs if not run.lack), None)
        if first is None:
            return None
        self.count("passage")
        return first, first.simulate_stroke()

    @property
    def _ranked_runs(self) -> list[Any]:
        """Runs in order, by the first criterion of the scene."""
        return [each.run for each in next(iter(self.rankings.values()))]

    @cached_property
    def roller_motors(self) -> dict[str, RollerMotor]:
        """Motors in the rollers by name of the law: the same cart without any other drive."""
        rollers = self.scene.machine.rollers
        required = {
            name: InverseDynamics(self.resistance.cart, drive.Rigid(), cycle, self.resistance.resistance)
            for name, cycle in self.laws.cycles.items()
        }
        range_of_pulls = np.transpose([pull_range(each, rollers) for each in required.values()])
        response = torque_response(self.contacts, (float(range_of_pulls.min()), float(range_of_pulls.max())))
        return {name: RollerMotor(each, response, rollers) for name, each in required.items()}

    @cached_property
    def turns(self) -> dict[str, CrankshaftRevolution]:
        """One turn of the crankshaft with 1 to 4 carts at their usual angles, and under "scene" that of the scene."""
        angles = {str(count): usual for count, usual in CRANK_ANGLES.items()}
        angles["scene"] = machine_models.angles(self.scene)
        speed = np.pi / self.scene.motion.duration
        turns = {}
        for key, ahead in angles.items():
            self.count("crank")
            crank = machine_models.crank(self.scene)
            assert crank is not None  # rule of the scene: the output "crank" requires a rod
            turns[key] = simulate_crankshaft(self.resistance.cart, crank, speed, self.resistance.resistance, ahead)
        return turns


def simulate_laws(
    scene: Scene,
    cart: Cart,
    cycles: Mapping[str, Cycle],
    resistance: ResistanceLaw,
    tolerated: AbstractContextManager[Any],
    begin: Callable[[], object] = lambda: None,
) -> Iterator[tuple[str, Any]]:
    """Simulate laws with the drive of a scene; laws of one motion behind a spring once.

    Parameters
    ----------
    resistance : callable
        Resistance of one cart [N], a function of velocity and acceleration.
    tolerated : context manager
        Context of each simulation; a law whose error it suppresses has no run.
    begin : callable
        Called before each law.

    Yields
    ------
    tuple
        Name of a law and its run.
    """
    working, alike = (scene.motion.run_up, 1 - scene.motion.run_down), dict[Any, Any]()
    for name, cycle in cycles.items():
        begin()
        if twin := alike.get(_motion_of(cycle)):
            yield name, replace(twin, cycle=cycle)
            continue
        with tolerated:
            run = drive.simulate(cart, machine_models.drive_of(scene, cycle), cycle, resistance, working=working)
            if scene.drive.kind == "elastic":
                alike[_motion_of(cycle)] = run
            yield name, run


def _motion_of(cycle: Cycle) -> Any:
    """Return what laws of the same motion share, such as two reversal laws whose free parameter has the same value."""
    forward, curve = cycle.forward, cycle.forward.curve
    same = (curve.x.tobytes(), curve.c.tobytes()) if isinstance(curve, PPoly) else forward.name
    return same, forward.stroke, forward.duration, forward.retraces, cycle.far_dwell, cycle.near_dwell


@dataclass(frozen=True)
class OwnInputs:
    """Inputs of a study that no scene file states.

    Parameters
    ----------
    laws : tuple of MotionProfile
        Motion laws in addition to those of the scene.
    resistance : callable, optional
        Resistance of the mix to one cart [N], a function of velocity [m/s] and acceleration [m/s2]; that of the engine
        by default.
    """

    laws: tuple[MotionProfile, ...] = ()
    resistance: ResistanceLaw | None = None


@dataclass(frozen=True)
class Stages:
    """Stages of one scene; the attributes of each are computed when first used."""

    prescribed: PrescribedLaws
    contacts: ContactStage
    resistance: ResistanceStage
    laws: LawStage
    drive: DriveStage


def build_stages(
    scene: Scene,
    mix: Mix | None = None,
    count: Count = no_count,
    directory: Path | None = None,
    progress: Progress | None = None,
    known_laws: KnownLaws | None = None,
    shortest: float | None = None,
    own: OwnInputs = OwnInputs(),
) -> Stages:
    """Build the stages of a scene; nothing is computed yet.

    Parameters
    ----------
    own : OwnInputs
        Laws and resistance of the caller.
    shortest : float, optional
        Shortest duration of a pass for which the resistance is required [s]; that of the scene by default.
    progress : callable, optional
        Called with lines of text by engines with continuation.
    """
    prescribed = PrescribedLaws(scene, count, shortest, own.laws)
    if known_laws:
        prescribed.cycles = dict(known_laws[0])
    contacts = contact_stage(scene, mix or scene_mix(scene), count, directory, progress)
    resistance = ResistanceStage(contacts, prescribed.largest_speed, own.resistance)
    laws = LawStage(prescribed, resistance, known_laws and known_laws[1])
    return Stages(prescribed, contacts, resistance, laws, DriveStage(contacts, resistance, laws))
