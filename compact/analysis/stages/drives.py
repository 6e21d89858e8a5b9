"""Drive stage of a study: every law under the drive of the scene, their ranking with its error, roller motors, crank.

`Stages` are all stages of a scene, up to this one; each uses those before it only.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from compact import drive
from compact.analysis.contact_cases import Progress, case_of
from compact.analysis.stages.contacts import ContactStage, Count, contact_stage, no_count
from compact.analysis.stages.laws import LawStage
from compact.analysis.stages.resistance import ResistanceLaw, ResistanceStage
from compact.machine import roller_motors as motors
from compact.machine.cart import Cart
from compact.machine.crankshaft import CRANK_ANGLES, CrankshaftRevolution, simulate_crankshaft
from compact.machine.drives import DRIVES, Table, angles_of, crank_of
from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, Ranked, is_tie, value_of
from compact.machine.rigid_drive import InverseDynamics
from compact.motion.profile import Cycle, MotionProfile
from compact.numerics import Array
from compact.rolling_contact import Contact
from compact.scene.loader import Scene

STEP = 0.3  # [-], largest step of `carter_parameter`; creepage is linear in it on a half-plane, and nearly so on layers
TRACTION_MARGIN = 1.15  # [-], sampled over required traction; T/(R pull) is 1.03 by "fem", 0.87 by "compaction"
LEAST_SHARE = 0.1  # [-], of friction, sampled at least; smaller samples are dominated by rounding errors

SAMPLES = 65  # [-], times over a cycle at which motions are compared
SAME_TRAVEL = 1e-9  # [-], of the stroke; closer motions are the same but for rounding

Row = tuple[float, float, float, float]  # torque [N m], pull [N], creepage [-], load [N]
Runs = dict[str, Any]  # name of a law -> `Run`, `ElasticRun`, `HydraulicRun` or `MotorRun`
KnownLaws = tuple[Mapping[str, Cycle], Mapping[str, Cycle]]  # prescribed laws, and all laws


class Place(NamedTuple):
    """Place of a law in a ranking by one criterion.

    Parameters
    ----------
    rank : int
        From 1; values that are equal but for rounding share a rank, infinite values share the last.
    margin : float
        Relative distance to the next worse value, over `Criterion.scale` [-].
    error : float or None
        Error of the value, in its unit; None without error estimate of the resistance.
    resolved : bool or None
        True if the rank is resolved: no law behind it is better if each value changes by its error. None if the errors
        are unknown. Infinite values are not resolved, nor laws of different rank within the build tolerance.
    reason : str
        Reason why the value is infinite; empty if it is finite.
    """

    rank: int
    law: str
    value: float
    margin: float
    error: float | None
    resolved: bool | None
    reason: str

    @property
    def tie(self) -> bool:
        """True if the next worse value is within the build tolerance."""
        return is_tie(self.margin)


Places = dict[str, dict[str, list[Place]]]  # by drive and criterion


class DriveStage:
    """Runs of all laws of a scene; each attribute is computed when first used.

    Parameters
    ----------
    laws : callable
        Returns the forward and return strokes by name of the law.
    """

    def __init__(self, resistance: ResistanceStage, laws: Callable[[], dict[str, Cycle]]) -> None:
        self.resistance, self.contacts, self._laws = resistance, resistance.contacts, laws
        self.scene, self.count = self.contacts.scene, self.contacts.count
        self.model = DRIVES[self.scene.drive.kind]

    @cached_property
    def cycles(self) -> dict[str, Cycle]:
        """Forward and return strokes by name of the law."""
        return self._laws()

    @cached_property
    def runs(self) -> Runs:
        """A `Run`, `ElasticRun`, `HydraulicRun` or `MotorRun` by name of the law."""
        return self._runs(self.resistance.resistance)

    @cached_property
    def heavier_runs(self) -> Runs | None:
        """Runs under the resistance plus its error; None without error estimate.

        A law that the drive cannot follow under this resistance has no run.
        """
        if self.resistance.error is None:
            return None
        heavier = self.resistance.map.scaled(1 + self.resistance.error)
        return self._runs(self.resistance.along_stroke(heavier), RuntimeError)

    def _runs(self, resistance: ResistanceLaw, tolerated: type[Exception] | tuple[type[Exception], ...] = ()) -> Runs:
        cart, begin = self.resistance.cart, partial(self.count, "runs")
        return dict(simulate_laws(self.scene, cart, self.cycles, resistance, tolerated, begin))

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
        """Places of the laws by drive and criterion: that of the scene, and a rigid one where that has a spring."""
        runs = {self.scene.drive.kind: (self.rankings, self.heavier_runs)}
        if self.model.driven_end:
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
        """Return the drive stage of all laws over another duration of a pass [s]; each keeps its shape.

        Raises
        ------
        ValueError
            When a law is faster than the resistance is known; `largest_speed` covers the durations of the scene.
        """
        cycles = {
            name: replace(cycle.forward, duration=duration).cycle(cycle.far_dwell, cycle.near_dwell)
            for name, cycle in self.cycles.items()
        }
        return DriveStage(self.resistance.over(duration), lambda: cycles)

    def tables(self) -> Iterator[Table]:
        """Yield the further tables of the drive, such as the start of a motor from rest under the first law."""
        yield from self.model.tables(self._ranked_runs, self.count)

    @property
    def _ranked_runs(self) -> list[Any]:
        """Runs in order, by the first criterion of the scene."""
        return [each.run for each in next(iter(self.rankings.values()))]

    @cached_property
    def roller_motors(self) -> dict[str, motors.RollerMotor]:
        """Motors in the rollers by name of the law: the same cart without any other drive."""
        rollers, cart, resistance = self.scene.machine.rollers, self.resistance.cart, self.resistance.resistance
        required = {
            name: InverseDynamics(cart, drive.Rigid(), cycle, resistance) for name, cycle in self.cycles.items()
        }
        least, largest = np.transpose([motors.pull_range(each, rollers) for each in required.values()])
        response = torque_response(self.contacts, (float(least.min()), float(largest.max())))
        return {name: motors.RollerMotor(each, response, rollers) for name, each in required.items()}

    @cached_property
    def turns(self) -> dict[str, CrankshaftRevolution]:
        """One turn of the crankshaft with 1 to 4 carts at their usual angles, and under "scene" that of the scene."""
        angles = {str(count): usual for count, usual in CRANK_ANGLES.items()} | {"scene": angles_of(self.scene)}
        crank, cart, resistance = crank_of(self.scene), self.resistance.cart, self.resistance.resistance
        assert crank is not None  # rule of the scene: the output "crank" requires a rod
        speed, turns = np.pi / self.scene.motion.duration, {}
        for key, ahead in angles.items():
            self.count("crank")
            turns[key] = simulate_crankshaft(cart, crank, speed, resistance, ahead)
        return turns


def places(ranked: Sequence[Ranked], by: str, heavier: Mapping[str, Any] | None) -> list[Place]:
    """Add error and resolution to the ranking of laws by a criterion.

        error = |value under the resistance plus its error - value|

    Parameters
    ----------
    heavier : mapping or None
        Run of each law under the resistance plus its error; a law without such a run has an infinite error. None
        without error estimate.
    """
    tied = ties(ranked, by)
    errors = [None if heavier is None else error(place.run, heavier.get(place.run.name), by) for place in ranked]
    placed = []
    for place, own, ambiguous in zip(ranked, errors, tied, strict=True):
        behind = [
            other.value - change
            for other, change in zip(ranked, errors, strict=True)
            if change is not None and other.rank > place.rank
        ]
        resolved = None if own is None else place.value + own <= min(behind, default=math.inf)
        resolved = False if ambiguous or place.reason else resolved
        placed.append(Place(place.rank, place.run.name, place.value, place.margin, own, resolved, place.reason))
    return placed


def ties(order: Sequence[Place | Ranked], by: str) -> list[bool]:
    """Find the places that have another place, of another rank, within the build tolerance."""
    values, ranks = ([getattr(place, name) for place in order] for name in ("value", "rank"))
    size, finite = np.abs(values), np.isfinite(values)
    scale = np.maximum(np.minimum.outer(size, size), CRITERIA[by].floor)
    with np.errstate(invalid="ignore"):  # of infinite values, which are not compared
        apart = np.abs(np.subtract.outer(values, values)) >= BUILD_TOLERANCE * scale
    tied = np.asarray(~apart & finite & finite[:, None] & np.not_equal.outer(ranks, ranks))
    return [bool(row.any()) for row in tied]


def error(run: Any, heavier: Any, by: str) -> float:
    """Compute the change of a criterion under a greater resistance.

    Parameters
    ----------
    run, heavier : Run
        Runs of one law under both resistances; `heavier` may be None.

    Returns
    -------
    float
        In the unit of the criterion; infinite without `heavier`.
    """
    if heavier is None:
        return math.inf
    value, heavier_value = value_of(run, by), value_of(heavier, by)
    return 0.0 if value == heavier_value else abs(heavier_value - value)


def simulate_laws(
    scene: Scene,
    cart: Cart,
    cycles: Mapping[str, Cycle],
    resistance: ResistanceLaw,
    tolerated: type[Exception] | tuple[type[Exception], ...] = (),
    begin: Callable[[], object] = lambda: None,
    make: Callable[[Scene, Cycle], Any] | None = None,
) -> Iterator[tuple[str, Any]]:
    """Simulate laws with the drive of a scene; laws of one motion behind a spring once.

    Parameters
    ----------
    resistance : callable
        Resistance of one cart [N], a function of velocity and acceleration.
    tolerated : type, optional
        Error for which a law has no run.
    begin : callable
        Called before each law.
    make : callable, optional
        Builds the drive of a law; that of the scene by default.

    Yields
    ------
    tuple
        Name of a law and its run.
    """
    model, made = DRIVES[scene.drive.kind], dict[str, Any]()
    make = make or model.make
    same = same_motions(cycles) if model.driven_end else {}
    working = scene.motion.run_up, 1 - scene.motion.run_down
    for name, cycle in cycles.items():
        begin()
        if twin := made.get(same.get(name, "")):
            yield name, replace(twin, cycle=cycle)
            continue
        try:
            run = drive.simulate(cart, make(scene, cycle), cycle, resistance, working=working)
        except tolerated:
            continue
        if model.driven_end:
            made[name] = run
        yield name, run


def same_motions(cycles: Mapping[str, Cycle]) -> dict[str, str]:
    """Return the first law of the same motion by law; that of a motion of its own is itself."""
    known: dict[str, np.ndarray] = {}
    found = {}
    for law, cycle in cycles.items():
        times = np.linspace(0.0, cycle.period, SAMPLES)
        travel = np.asarray(cycle.position(times))
        near = SAME_TRAVEL * max(np.ptp(travel), np.finfo(float).tiny)
        found[law] = next((name for name, other in known.items() if np.abs(travel - other).max() <= near), law)
        known.setdefault(found[law], travel)
    return found


def torque_response(contacts: ContactStage, pulls: tuple[float, float]) -> motors.DrivenRoller | motors.CreepFreeRoller:
    """Sample the response of one roller to its motor: pull, creepage and load.

    At each speed the roller keeps the height of the contact of the scene while its motor drives or brakes, in equal
    steps of `carter_parameter` up to the largest pull of the laws. A compacting mix, which depends weakly on the speed
    and is expensive, is sampled at one speed.

    Parameters
    ----------
    pulls : tuple of float
        Least and largest pull of one roller [N].

    Returns
    -------
    motors.DrivenRoller or motors.CreepFreeRoller
        `CreepFreeRoller`, without creepage, if the engine has no torque, the roller no friction, or the engine does not
        converge, the latter with a warning; also on compacting mix unless the scene has the output "roller_motors",
        because each driven contact takes seconds to minutes.
    """
    scene, records, friction = contacts.scene, contacts.records, contacts.mix.steel_friction
    radius = scene.machine.roller_radius
    without_creep = motors.CreepFreeRoller(radius, contacts.roller_load, friction)
    expensive = contacts.compacts and "roller_motors" not in scene.output.items
    if not contacts.engine.reads("machine.roller_torque") or friction == 0 or expensive:
        return without_creep
    least_load = scene.machine.roller_length * min(record.load for record in records)
    low, high = (TRACTION_MARGIN * pull / (friction * least_load) for pull in pulls)
    sides = [_friction_shares(min(low, -LEAST_SHARE) if low < 0 else 0.0), _friction_shares(max(high, LEAST_SHARE))]
    if contacts.compacts:
        records = [contacts.mean_record]
    try:
        curves = [_curve(contacts, record, sides) for record in records]
    except RuntimeError as error:
        warnings.warn(f"creep of the driven rollers is left out: {error}", stacklevel=2)
        return without_creep
    speeds = np.array([record.speed for record in records])
    return motors.DrivenRoller(radius, friction, speeds, *np.moveaxis(np.array(curves), -1, 0))


def _friction_shares(share: float) -> Array:
    """Return shares of friction up to a share, limited to FULL_SLIP_SHARE, in equal steps of `carter_parameter`."""
    end = motors.carter_parameter(np.clip(share, -motors.FULL_SLIP_SHARE, motors.FULL_SLIP_SHARE))
    w = np.linspace(0, end, int(np.ceil(abs(end) / STEP)) + 1)[1:]
    return np.sign(w) * (1 - (1 - np.abs(w)) ** 2)


def _curve(contacts: ContactStage, record: Contact, sides: list[Array]) -> list[Row]:
    """Return the response of the driven roller at the height and speed of a contact, torques ascending."""
    scene, machine, rows = contacts.scene, contacts.scene.machine, list[Row]()
    case = case_of(scene, contacts.mix, scene.mean_speed)
    roller = replace(case.roller, rolling="driven", indentation=record.indentation, load=None, peak_pressure=None)
    case = replace(case, roller=roller, speed=record.speed, estimate=False, exit_density_ratio=None, unlimited=False)

    def roll(torque: float, initial_guess: Contact | None) -> Contact:
        """Roll under a torque per length [N] and add its row."""
        contacts.count("driven")
        result = contacts.engine.contact(replace(case, torque=torque), initial_guess)
        assert result.creep is not None  # the roller is driven
        forces = torque, record.resistance - result.resistance, result.load
        torque, pull, load = (machine.roller_length * force for force in forces)
        rows.append((torque, pull, result.creep, load))
        return result

    free = roll(0.0, None if contacts.kept else dict(contacts.first_passes).get(record.speed))
    for side in sides:
        before, last = free, free
        for share in side:
            load = 2 * last.load - before.load  # extrapolated; friction must hold the torque
            before, last = last, roll(share * contacts.mix.steel_friction * machine.roller_radius * load, last)
    return sorted(rows)


class Stages(NamedTuple):
    """Stages of one scene; the attributes of each are computed when first used."""

    contacts: ContactStage
    resistance: ResistanceStage
    laws: LawStage
    drive: DriveStage


def build_stages(
    scene: Scene,
    count: Count = no_count,
    directory: Path | None = None,
    progress: Progress | None = None,
    known_laws: KnownLaws | None = None,
    shortest: float | None = None,
    own_laws: Sequence[MotionProfile] = (),
    own_resistance: ResistanceLaw | None = None,
) -> Stages:
    """Build the stages of a scene; nothing is computed yet.

    Parameters
    ----------
    progress : callable, optional
        Called with lines of text by engines with continuation.
    shortest : float, optional
        Shortest duration of a pass for which the resistance is required [s]; that of the scene by default.
    own_laws : sequence of MotionProfile
        Motion laws in addition to those of the scene.
    own_resistance : callable, optional
        Resistance of the mix to one cart [N], a function of velocity [m/s] and acceleration [m/s2]; that of the engine
        by default.
    """
    laws = LawStage(scene, count, shortest, own_laws)
    contacts = contact_stage(scene, count, directory, progress)
    laws.resistance = ResistanceStage(contacts, laws.largest_speed, own_resistance)
    if known_laws:
        laws.prescribed, laws.cycles = map(dict, known_laws)
    return Stages(contacts, laws.resistance, laws, DriveStage(laws.resistance, lambda: laws.cycles))
