"""One scene from contact to ranking: what is wanted is computed once, when it is first asked for, and counted.

    study = Study(load_scene("scene.toml"))
    study.rankings["peak_force"]

`report.write` puts the results of a study into a directory; `compact run` is a thin door to it.
"""

import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from compact import contact, drive
from compact.analysis import (
    machine_models,
    resistance_stage,
    stage_costs,
)
from compact.analysis import (
    machine_models as made,
)
from compact.analysis.contact_cases import ContactRecord, contact_record
from compact.analysis.engineering_summary import engineering, numbers, peak_pressure
from compact.analysis.engines import COMPACTING, LAYERED, HeldQuantity, fields, held, passes, speeds
from compact.analysis.ranking_uncertainty import places
from compact.analysis.torque_response import driven
from compact.analysis.worker_pool import Errands, Here
from compact.cams.profile import Cam, FlatFace, Pointed, RollerFollower
from compact.engines.halfplane import galin
from compact.machine import rigid_drive
from compact.machine.cart import MotionResistance
from compact.machine.crankshaft import CRANK_ANGLES, simulate_crankshaft
from compact.machine.rigid_drive import steady_balance
from compact.machine.roller_motors import RollerMotor, pull_range
from compact.material import mix
from compact.motion.profile import InfeasibleError, law, optimal_name
from compact.numerics.validation import require_known
from compact.scene.loader import Scene, SceneError

ADDED = ("resistance", "added mass", "kept", "second pass", "passage", "run-up", "driven")  # counted as they come
BESIDE = "beside"  # directory of the maps of engines beside the scene's
SWING = 2.0  # times the velocity of the law, which an elastic drive may reach after a jump
YIELDING = ("elastic", "motor")  # drives whose cart does not keep to the law
FOLLOWERS = {
    "pointed": lambda table: Pointed(),
    "roller": lambda table: RollerFollower(table.roller_follower_radius),
    "flat": lambda table: FlatFace(),
}


@dataclass(frozen=True)
class EngineComparison:
    """What an engine beside the scene's answers: contacts, the resistance of a cart, and the order of the laws.

    resistance : callable of velocity and acceleration -> N;  error : of it, relative, None where it is not known
    places : lists of `Place` by drive and criterion;  key : under which contacts and map are kept
    """

    scene: Scene
    contacts: list[ContactRecord]
    held: HeldQuantity | None
    second_pass: tuple[float, float] | None
    resistance: Callable
    error: float | None
    roller_load: float
    places: dict
    key: str
    counts: Counter
    warned: tuple[str, ...]


def run_engine_alternative(asked):
    """The `EngineComparison` of (scene, given laws, all laws, directory of an earlier run), to be had in another process."""
    scene, given, cycles, directory = asked
    study = Study(scene, directory=directory)
    study.given_cycles, study.cycles = given, cycles
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # a number that numpy warns of is no result
        places = study.places
        # the second pass of a comparison is required by its own return stroke only
        second_pass = study.second_pass if study.scene.layer.return_stroke == "compacted" else None
    told = tuple(dict.fromkeys(str(warning.message) for warning in warned))
    return EngineComparison(
        scene, study.contacts, study.held, second_pass, study.resistance, study.resistance_error, study.roller_load,
        places, study.key, study.counts, told,
    )  # fmt: skip


class Study:
    """The stages of one scene; each attribute is computed when first asked for, `counts` says how often.

    step : called with the name of each stage that begins;  progress : called with lines of text by "compaction"
    directory : of an earlier run, whose contacts and resistance map are taken where they fit; `kept` counts them
    """

    def __init__(self, scene, step=lambda stage: None, directory=None, progress=None):
        self.scene = scene
        self.counts = Counter()
        self._step = step
        self._directory = directory
        self._progress = progress
        self._answers = None
        self._errands = None
        self._not_made = {}

    @property
    def planned(self):
        """How often each stage of all that the scene wants will be counted, a Counter.

        Stages whose number shows only on the way are there as often as they have been.
        """
        wanted, layered, laws = self.scene.output.items, self.layered, self._laws - len(self._not_made)
        rolled = 0 if self.counts["kept"] or not layered else len(self._speeds)
        drawn = bool({"figures", "report"} & set(wanted))
        fields = "fields" in wanted and rolled > 0
        figures = (3 + len({"cams", "reactions", "crank"} & set(wanted)) + 4 * layered) * drawn + fields
        cams = laws * len(FOLLOWERS) * ("cams" in wanted)
        planned = Counter({
            "contact": 1, "rankings": 1, "laws": self._laws, "runs": laws * (1 + layered), "rolled": rolled,
            "fields": rolled * fields, "figures": figures, "cams": cams, "cams measured": cams,
            "crank": (len(CRANK_ANGLES) + 1) * ("crank" in wanted), "beside": len(self.scene.compared_engines),
            "report": int("report" in wanted),
        })  # fmt: skip
        for stage in ADDED:
            planned[stage] = self.counts[stage]
        return planned

    @property
    def _laws(self):
        """Number of laws, those made for the machine among them."""
        optimised = self.scene.motion.optimise
        return len(self.scene.law_names) + len(self.scene.table_paths) + (len(optimised.objectives) if optimised else 0)

    @property
    def steps(self):
        """How many counts the stages of all that the scene wants will make."""
        return self.planned.total()

    def cost(self, stage):
        """Cost of the run of a stage that was counted last, as in `stage_costs` [s]."""
        first = stage == "rolled" and self.counts[stage] == 1
        return self._usual_cost(stage) + first * stage_costs.FIRST[self.scene.accuracy.engine]

    def _usual_cost(self, stage):
        """Cost of a run of a stage that is not its first [s]."""
        scene, table = self.scene, stage_costs
        if stage == "beside":
            others = [Study(scene.with_engine(name)) for name in scene.compared_engines]
            return table.BY_OTHERS * sum(other.contact_cost for other in others) / len(others)
        engine, crowded = scene.accuracy.engine, bool(scene.compare)
        found = table.cost(stage, engine, scene.drive.kind, self.layered, crowded)
        if stage == "laws" and scene.motion.optimise:
            found += table.OPTIMISED * len(scene.motion.optimise.objectives) / self._laws
        return found

    @property
    def whole_cost(self):
        """Cost of all that the scene wants [s]; of stages whose number shows only on the way, what is usual."""
        return self._summed(self.planned | self._usual)

    @property
    def contact_cost(self):
        """Cost of what an engine beside does: contacts, map, drives [s]."""
        expected = self.planned | self._usual
        return self._summed({stage: expected[stage] for stage in ("rolled", "resistance", "added mass", "runs")})

    def _summed(self, expected):
        """Cost of stages as often as they are expected [s]."""
        first = stage_costs.FIRST[self.scene.accuracy.engine] * bool(expected["rolled"])
        return first + sum(count * self._usual_cost(stage) for stage, count in expected.items() if count)

    @property
    def _usual(self):
        """How often stages are usually run whose number shows only on the way, until it has shown."""
        engine, usual, table = self.scene.accuracy.engine, Counter(), stage_costs
        if not self.layered or self.counts["kept"]:
            return usual
        rolled = len(self._speeds)
        if not self.counts["added mass"] and not self.counts["runs"]:
            usual["resistance"] = table.SPEEDS_ADDED[engine]
        if engine in table.ADDED_MASS and not self.counts["runs"]:
            usual["added mass"] = rolled + max(usual["resistance"], self.counts["resistance"])
        if engine in table.DRIVEN and "cams" in self.scene.output.items and not self.counts["rankings"]:
            usual["driven"] = table.TORQUES * rolled
        return usual

    @property
    def _speeds(self):
        """Speeds [m/s] of all contacts: those of the scene, and the mean speed if a contact there is required."""
        required = self.scene.accuracy.engine in COMPACTING or held(self.scene, self.mix) is None
        return {*speeds(self.scene), *([self.scene.mean_speed] if required else [])}

    def count(self, stage):
        """One more run of a stage."""
        self.counts[stage] += 1
        self._step(stage)
        if self._errands:
            self._errands.turn()

    @cached_property
    def mix(self):
        """The mix of the scene: prior and overrides."""
        given = self.scene.mix.overrides.model_dump(exclude_none=True)
        return mix.prior(self.scene.mix.moisture, self.scene.mix.density_ratio, given)

    @cached_property
    def engineering(self):
        """Eqs 1.1-1.10 at the pressure that is prescribed, or that the density requires."""
        self.count("contact")
        try:
            return engineering(self.scene, self.mix, peak_pressure(self.scene, self.mix))
        except ValueError as error:
            if not (self.layered and self.scene.target):
                raise
            reason, required = error, self.mix.required_pressure
        warnings.warn(
            f"the formulas do not reach the prescribed contact ({reason}); they are shown at {required / 1e3:.4g} kPa, "
            "as the density requires",
            stacklevel=2,
        )
        return engineering(self.scene, self.mix, required)

    @cached_property
    def numbers(self):
        """Headline `Number`s of the formulas and of exact theory, by name."""
        return numbers(self.scene, self.mix, self.engineering, self.exact)

    @cached_property
    def exact(self):
        """Galin's exact contact at the peak pressure of the formulas, with the traction of a driven roller."""
        return galin(
            radius=self.scene.machine.roller_radius,
            youngs_modulus=self.mix.effective_modulus,
            poisson=self.mix.poisson,
            friction=-self.mix.steel_friction,
            peak_pressure=self.engineering.pressure,
        )

    @property
    def layered(self):
        """Whether the scene's engine is one of a layer."""
        return self.scene.accuracy.engine in LAYERED

    @cached_property
    def key(self):
        """Fingerprint of all that decides the contacts and the resistance map."""
        return resistance_stage.key(self.scene, self.mix)

    @cached_property
    def kept(self):
        """Contacts and map of an earlier run in the directory, `mapping.Kept`, or None."""
        found = resistance_stage.kept(self._directory, self.key) if self._directory and self.layered else None
        if found:
            self.count("kept")
        return found

    def standing(self, directory, *names):
        """Files of an earlier run that stand, all that begin with the names; [] where there is none of one name."""
        kept = self.kept.files if self.kept else ()
        if not all(any(file.startswith(name) for file in kept) for name in names):
            return []
        return [directory / file for file in kept if file.startswith(names)]

    def keep(self, directory, files):
        """Leave contacts and map for the next run, with what files there are of them; yields what is written."""
        before = self.kept.files if self.kept else ()
        files = sorted({*before, *(file.relative_to(directory).as_posix() for file in files)})
        yield from resistance_stage.save(
            directory, self.contacts, self.held, self.second_pass, self.resistance_map, self.key, files
        )

    @cached_property
    def contacts(self) -> list[ContactRecord]:
        """Records of the contact of one roller at each speed, by an engine of a layer, else none."""
        if self.kept:
            return self.kept.contacts
        return [contact_record(self.scene.accuracy.engine, *passed) for passed in self.passes]

    @cached_property
    def reference(self):
        """`ContactResult`s of all passes of one roller at the mean speed, where the target of the scene is met."""
        self.count("rolled")
        return passes(self.scene, self.mix, self.scene.mean_speed, progress=self._progress)

    @cached_property
    def held(self):
        """`HeldQuantity` over speed by an engine of a layer, else None."""
        if not self.layered:
            return None
        if self.kept:
            return self.kept.held
        return held(self.scene, self.mix) or held(self.scene, self.mix, reference=self.reference[0])

    @cached_property
    def passes(self):
        """(speed, `ContactResult`s of all passes) of one roller at each speed, by an engine of a layer, else none."""
        passed = []
        for speed in speeds(self.scene) if self.layered else ():
            passed.append((speed, self.passes_at(speed, near=passed[-1][1] if passed else None)))
        return passed

    def passes_at(self, speed, near=None):
        """`ContactResult`s of all passes of one roller at a speed [m/s].

        The target of the scene is met at the mean speed, and at every speed by the formulas; at other speeds what is
        held is kept. `near` are passes at another speed, an initial guess.
        """
        if speed == self.scene.mean_speed:
            return self.reference
        kept, near = self.held, near or self.__dict__.get("reference")
        self.count("rolled")
        return passes(self.scene, self.mix, speed, near=near, held=kept, progress=self._progress)

    @property
    def rolled(self):
        """(speed, `ContactResult`) of the first pass at each speed."""
        return [(speed, first) for speed, (first, *_) in self.passes]

    @cached_property
    def fields(self):
        """(mesh with its fields, contact) at each speed; the engine is one of FIELDED."""
        layers = []
        for _, rolled in self.rolled:
            self.count("fields")
            layers.append((fields(rolled, self.scene.accuracy.engine), rolled))
        return layers

    @cached_property
    def resistance(self):
        """Resistance of the mix to one cart, a callable of velocity and acceleration; by eq 1.8 it knows no speed."""
        if self.layered:
            return self.resistance_map
        return contact.dry_resistance(self.scene.machine.rollers * self.engineering.roller_resistance)

    @property
    def resistance_error(self):
        """Relative error of the resistance, between the speeds and of the engine; None where it is not known."""
        if not self.layered or self.resistance_map.engine_error is None:
            return None
        return self.resistance_map.error + self.resistance_map.engine_error

    @cached_property
    def resistance_map(self):
        """The `ResistanceMap` of one cart up to the fastest that any law moves it, from the contacts of the layer."""
        kept = self.kept.met if self.kept else None
        if kept and resistance_stage.covers(kept, self.fastest):
            return kept
        return self._mapped(kept, self.fastest)

    def _mapped(self, met, fastest):
        """The `ResistanceMap` of one cart up to a speed [m/s], from the contacts and the samples of another or None."""
        near = () if self.kept else self.rolled
        return resistance_stage.mapped(
            self.scene, self.mix, fastest, self.contacts, self.held,
            return_ratio=self.return_ratios[1], near=near, met=met, count=self.count, progress=self._progress,
        )  # fmt: skip

    @cached_property
    def fastest(self):
        """Largest velocity of any law, and of the crank where there is one, with room for drives that swing [m/s]."""
        velocities = [cycle.there.peaks().velocity * self._overshoot(cycle) for cycle in self.given_cycles.values()]
        if self.crank:
            motion = self.scene.motion
            velocities.append(
                law("crank", motion.stroke, motion.duration, rod_length=motion.rod_length).peaks().velocity
            )
        return float(max(velocities)) * self.swing

    def _overshoot(self, cycle):
        """Further factor of the velocity behind a spring: the jump at a reversal is twice the velocity of the law."""
        jumps = self.scene.drive.kind == "elastic" and any(join.order == 1 for join in cycle.joins())
        return SWING if jumps else 1.0

    @property
    def swing(self):
        """Times the velocity of a law that its drive may reach."""
        return SWING if self.scene.drive.kind in YIELDING else 1.0

    @cached_property
    def roller_load(self):
        """What holds one roller at its height [N]: by the scene's engine at the mean speed, or by eq 1.6."""
        if not self.layered:
            return self.engineering.roller_force
        speed, load = np.array([[each.speed, each.load] for each in self.contacts]).T
        mean = self.scene.mean_speed
        return float(self.scene.machine.roller_length * np.interp(np.log(mean), np.log(speed), load))

    @cached_property
    def second_pass(self):
        """(load, resistance) of a pass back over the compacted mix over those of the first, at the mean speed [-].

        None for engines without irreversible compaction: a linear layer recovers, and the formulas state one stroke.
        """
        if self.scene.accuracy.engine not in COMPACTING:
            return None
        if self.kept:
            return self.kept.second_pass
        first = self.reference[0]
        self.count("second pass")
        try:
            back = passes(self.scene, self.mix, self.scene.mean_speed, count=2, first=first, progress=self._progress)[1]
        except RuntimeError as error:
            if self.scene.layer.return_stroke == "compacted":
                raise
            warnings.warn(f"the return stroke over compacted mix is left out: {error}", stacklevel=2)
            return None
        return back.load / first.load, max(-back.resistance / first.resistance, 0.0)

    @property
    def return_ratios(self):
        """(load, resistance) of the return stroke over those of the way out [-], over the mix that the scene states."""
        return self.second_pass if self.scene.layer.return_stroke == "compacted" else (1.0, 1.0)

    @cached_property
    def cart(self):
        """The cart with the reactions of its rollers."""
        return machine_models.cart(self.scene, self.roller_load, self.return_ratios[0])

    @cached_property
    def steady(self):
        """Forces on the cart at constant mean speed, a `Balance` of arrays of shape (1,)."""
        return steady_balance(self.cart, self.scene.mean_speed, self.resistance)

    @cached_property
    def cycle_energies(self):
        """Energy of a cycle [J] by the mix under the return stroke, "fresh" and "compacted"; {} without a second pass.

        The drive is rigid; the law is the first by the first criterion of the scene.
        """
        if self.second_pass is None:
            return {}
        cycle = self.cycles[next(iter(self.rankings.values()))[0].run.name]
        ratios = {"fresh": (1.0, 1.0), "compacted": self.second_pass}
        return {
            over: drive.simulate(
                machine_models.cart(self.scene, self.roller_load, load), drive.Rigid(), cycle,
                replace(self.resistance_map, return_ratio=resistance),
            ).energy
            for over, (load, resistance) in ratios.items()
        }  # fmt: skip

    @cached_property
    def cycles(self):
        """The motion laws there and back, by name; tables of the user, then laws made for the machine last."""
        return self.given_cycles | self.optimal_cycles

    @cached_property
    def optimal_cycles(self):
        """Optimal laws by name, one per objective of [motion.optimise]; rigid drive, no rod.

        A law that no limits allow, or whose search does not converge, is left out with a warning: see `laws_not_made`.
        """
        table, dwell = self.scene.motion.optimise, self.scene.motion.dwell
        if table is None:
            return {}
        _ = self.push  # a resistance that cannot be computed fails the study, not the law
        cycles = {}
        for objective in table.objectives:
            self.count("laws")
            try:
                there = made.optimal_law(self.scene, objective, self)
            except (InfeasibleError, RuntimeError) as error:
                self._not_made[optimal_name([objective])] = str(error)
                warnings.warn(f"{optimal_name([objective])} is not made: {error}", stacklevel=2)
                continue
            cycles[there.name] = there.cycle(dwell, dwell)
        return cycles

    @property
    def laws_not_made(self) -> dict[str, str]:
        """Reason by name of each law of [motion.optimise] that is left out of `cycles`."""
        _ = self.cycles
        return self._not_made

    @property
    def limits(self):
        """`Limits` of [motion.optimise]; no faster than the resistance map reaches, where there is one."""
        return made.limits(self.scene, self.fastest / self.swing if self.layered else np.inf)

    def reach(self, speed):
        """Carry the resistance on to a speed [m/s]; what is known of it stays."""
        self.resistance_map = self._mapped(self.resistance_map, speed * self.swing)
        self.fastest = speed * self.swing
        for stale in ("resistance", "push", "oppositions"):
            self.__dict__.pop(stale, None)

    @cached_property
    def push(self):
        """What a straight push of the cart meets beside its inertia, an `MotionResistance`."""
        return MotionResistance(self.cart, self.resistance)

    @cached_property
    def oppositions(self):
        """What a push meets beside inertia: as computed, then at both ends of each spread of [motion.optimise]."""
        found = [self.push]
        for name in self.scene.motion.optimise.spread:
            known = self.mix.parameter(name)
            for value in (known.low, known.high):
                other = Study(self.scene.replaced(**{"motion.optimise": None, f"mix.overrides.{name}": value}))
                other.fastest = self.fastest
                found.append(other.push)
        return tuple(found)

    @cached_property
    def given_cycles(self):
        """The laws that the scene names there and back, by name; tables of the user last."""
        cycles, dwell = {}, self.scene.motion.dwell
        for there in machine_models.laws(self.scene):
            self.count("laws")
            cycles[there.name] = there.cycle(dwell, dwell)
        return cycles

    @property
    def crank(self):
        """The crank of the machine, None where it has none."""
        return machine_models.crank(self.scene)

    @property
    def angles(self):
        """Crank angle of each cart ahead of the first [rad]."""
        return machine_models.angles(self.scene)

    def means(self, name):
        """The drive that carries a law."""
        return machine_models.means(self.scene, self.cycles[name])

    @cached_property
    def runs(self):
        """A `Run`, `ElasticRun` or `MotorRun` per law, by name."""
        return dict(self._runs(self.resistance, able=nullcontext()))

    @cached_property
    def heavier_runs(self):
        """The same against a resistance greater by its own error, None where that is not known; no run of a law that
        the drive cannot carry then."""
        if self.resistance_error is None:
            return None
        heavier = self.resistance_map.scaled(1 + self.resistance_error)
        return dict(self._runs(heavier, able=suppress(RuntimeError)))

    def _runs(self, resistance, able):
        motion = self.scene.motion
        working = (motion.run_up, 1 - motion.run_down)
        for name, cycle in self.cycles.items():
            self.count("runs")
            with able:
                yield name, drive.simulate(self.cart, self.means(name), cycle, resistance, working=working)

    @cached_property
    def roller_motors(self):
        """A `RollerMotor` per law, by name: the same cart, driven by motors in its rollers and by nothing else."""
        rollers = self.scene.machine.rollers
        demands = {
            name: rigid_drive.InverseDynamics(self.cart, drive.Rigid(), cycle, self.resistance)
            for name, cycle in self.cycles.items()
        }
        asked = np.transpose([pull_range(demand, rollers) for demand in demands.values()])
        near = () if self.kept or not self.layered else self.rolled
        answer = driven(
            self.scene, self.mix, self.roller_load, self.contacts, (asked.min(), asked.max()), near, self.count
        )
        return {name: RollerMotor(demand, answer, rollers) for name, demand in demands.items()}

    @cached_property
    def rankings(self):
        """Lists of `Ranked` by criterion, those the scene names."""
        self.count("rankings")
        return {by: drive.rank(self.runs.values(), by) for by in self.scene.drive.rank_by}

    @cached_property
    def places(self):
        """Lists of `Place` by drive and criterion: the scene's drive, and beside an elastic one a rigid one."""
        told = {self.scene.drive.kind: (self.rankings, self.heavier_runs)}
        if self.scene.drive.kind == "elastic":
            rigid, heavier = (_rigid(runs) for runs in (self.runs, self.heavier_runs))
            told["rigid"] = ({by: drive.rank(rigid.values(), by) for by in self.rankings}, heavier)
        return {
            kind: {by: places(ranked, by, heavier) for by, ranked in rankings.items()}
            for kind, (rankings, heavier) in told.items()
        }

    @contextmanager
    def helped(self, crew):
        """Let a crew of `pool` run the engines beside; this process computes its own part meanwhile."""
        directory = self._directory and self._directory / BESIDE
        with Errands(crew) as errands:
            self._answers = {}
            for name in self.scene.compared_engines:
                asked = self.scene.with_engine(name), self.given_cycles, self.cycles, directory and directory / name
                self._answers[name] = errands.send(name, run_engine_alternative, asked)
            self._errands = errands
            try:
                yield
            finally:
                self._errands = None

    @cached_property
    def beside(self):
        """An `EngineComparison` of each engine beside the scene's, by name."""
        if self._answers is None:
            with self.helped(Here()):
                return self.beside
        found = {}
        for name, answer in self._answers.items():
            self.count("beside")
            found[name] = answer()
            for words in found[name].warned:
                warnings.warn(f"{name}: {words}", stacklevel=2)
        return found

    @cached_property
    def cams(self):
        """Cams of constant breadth by (law, follower)."""
        return {(law, follower): self.cam(law, follower) for law in self.cycles for follower in FOLLOWERS}

    def cam(self, law, follower):
        """The `Cam` of one law for one of FOLLOWERS."""
        table = self.scene.cam
        if table is None:
            raise SceneError(["cam: missing; a cam needs a table [cam] with breadth and roller_follower_radius in m"])
        self.count("cams")
        cycle = self.given_cycles.get(law) or self.cycles.get(law)  # a given one waits for no optimisation
        if law in self._not_made:
            raise RuntimeError(f"no cam: {law} is not made: {self._not_made[law]}")
        if cycle is None:
            require_known("motion law", law, tuple(self.cycles))
        return Cam(cycle, table.breadth, FOLLOWERS[follower](table))

    @cached_property
    def turns(self):
        """A `Turn` of the shaft for 1 to 4 carts at their usual angles, and under "scene" that of the scene."""
        angles = {str(count): usual for count, usual in CRANK_ANGLES.items()}
        angles["scene"] = self.angles
        speed = np.pi / self.scene.motion.duration
        turns = {}
        for key, ahead in angles.items():
            self.count("crank")
            turns[key] = simulate_crankshaft(self.cart, self.crank, speed, self.resistance, ahead)
        return turns


def _rigid(runs):
    """Runs of the drive that imposes each law on the cart itself, of elastic ones; None of none."""
    return runs and {name: run.rigid for name, run in runs.items()}
