"""One scene from contact to ranking: what is wanted is computed once, when it is first asked for, and counted.

    study = Study(load_scene("scene.toml"))
    study.rankings["peak_force"]

`report.write` puts the results of a study into a directory; `compact run` is a thin door to it.
"""

import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact import contact, contacts, drive, machine, made, mapping, mix
from compact.cam import Cam, FlatFace, Pointed, RollerFollower
from compact.cart import Opposition
from compact.crank import USUAL_ANGLES, turn
from compact.driven import driven
from compact.engine import LAYERED, fields, passes, speeds
from compact.engineering import engineering, numbers
from compact.halfplane import galin
from compact.motion import InfeasibleError, law, optimal_name
from compact.ordering import places
from compact.pool import Errands, Here
from compact.refuse import refuse_unknown
from compact.roller_motor import RollerMotor, pulls
from compact.scene import Scene, SceneError

BESIDE = "beside"  # directory of the maps of engines beside the scene's
SWING = 2.0  # times the velocity of the law, which an elastic drive may reach after a jump
FOLLOWERS = {
    "pointed": lambda table: Pointed(),
    "roller": lambda table: RollerFollower(table.roller_follower_radius),
    "flat": lambda table: FlatFace(),
}


@dataclass(frozen=True)
class Aside:
    """What an engine beside the scene's answers: contacts, the resistance of a cart, and the order of the laws.

    resistance : callable of velocity and acceleration -> N;  error : of it, relative, None where it is not known
    places : lists of `Place` by drive and criterion;  key : under which contacts and map are kept
    """

    scene: Scene
    contacts: list
    resistance: Callable
    error: float | None
    roller_load: float
    places: dict
    key: str
    counts: Counter
    warned: tuple[str, ...]


def answered(asked):
    """The `Aside` of (scene, given laws, all laws, directory of an earlier run), to be had in another process."""
    scene, given, cycles, directory = asked
    study = Study(scene, directory=directory)
    study.given_cycles, study.cycles = given, cycles
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        places = study.places
    told = tuple(dict.fromkeys(str(warning.message) for warning in warned))
    return Aside(
        scene, study.contacts, study.resistance, study.resistance_error, study.roller_load, places, study.key,
        study.counts, told,
    )  # fmt: skip


class Study:
    """The stages of one scene; each attribute is computed when first asked for, `counts` says how often.

    directory : of an earlier run, whose contacts and resistance map are taken where they fit; `kept` counts them
    """

    def __init__(self, scene, step=lambda stage: None, directory=None):
        self.scene = scene
        self.counts = Counter()
        self._step = step
        self._directory = directory
        self._answers = None
        self._errands = None
        self._not_made = {}

    @property
    def steps(self):
        """How many counts the stages of all that the scene wants will make."""
        wanted, optimised = self.scene.output.wanted, self.scene.motion.optimise
        made = len(optimised.objectives) - len(self._not_made) if optimised else 0
        laws = len(self.scene.law_names) + len(self.scene.table_paths) + made
        rolled = 0 if self.counts["kept"] or not self.layered else len(speeds(self.scene))
        figures = 3 + len({"cams", "reactions", "crank"} & set(wanted)) + 4 * self.layered
        figures = figures if {"figures", "report"} & set(wanted) else 0
        cams = 2 * laws * len(FOLLOWERS) if "cams" in wanted else 0  # made and measured
        crank = len(USUAL_ANGLES) + 1 if "crank" in wanted else 0
        fields = (rolled + 1) * ("fields" in wanted and rolled > 0)
        beside = len(self.scene.beside_engines)
        added = sum(self.counts[stage] for stage in ("resistance", "added mass", "kept", "passage", "run-up", "driven"))
        counted = 2 + 2 * laws + laws * self.layered + cams + crank + figures + beside + rolled + fields + added
        return counted + len(self._not_made) + ("report" in wanted)

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
        """Eqs 1.1-1.10 at the pressure that the density needs."""
        self.count("contact")
        return engineering(self.scene, self.mix, self.mix.required_pressure)

    @cached_property
    def numbers(self):
        """Headline `Number`s of the formulas and of exact theory, by name."""
        return numbers(self.scene, self.mix, self.engineering, self.exact)

    @cached_property
    def exact(self):
        """Galin's exact contact at the same peak pressure, with the friction of a driven roller as in 1.5-1.8."""
        return galin(
            radius=self.scene.machine.roller_radius,
            youngs_modulus=self.mix.effective_modulus,
            poisson=self.mix.poisson,
            friction=-self.mix.steel_friction,
            peak_pressure=self.mix.required_pressure,
        )

    @property
    def layered(self):
        """Whether the scene's engine is one of a layer."""
        return self.scene.accuracy.engine in LAYERED

    @cached_property
    def key(self):
        """Fingerprint of all that decides the contacts and the resistance map."""
        return mapping.key(self.scene, self.mix)

    @cached_property
    def kept(self):
        """Contacts and map of an earlier run in the directory, `mapping.Kept`, or None."""
        found = mapping.kept(self._directory, self.key) if self._directory and self.layered else None
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
        yield from mapping.save(directory, self.contacts, self.resistance_map, self.key, files)

    @cached_property
    def contacts(self):
        """Numbers of the contact of one roller at each speed, by an engine of a layer, else none."""
        if self.kept:
            return self.kept.contacts
        return [contacts.numbers(self.scene.accuracy.engine, *passed) for passed in self.passes]

    @cached_property
    def passes(self):
        """(speed, `Rolled`s of all passes) of one roller at each speed, by an engine of a layer, else none."""
        passed = []
        if self.layered:
            for speed in speeds(self.scene):
                self.count("rolled")
                near = passed[-1][1] if passed else None
                passed.append((speed, passes(self.scene, self.mix, speed, near=near)))
        return passed

    @property
    def rolled(self):
        """(speed, `Rolled`) of the first pass at each speed."""
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
        if kept and mapping.covers(kept, self.fastest):
            return kept
        near = () if kept else self.rolled
        return mapping.mapped(self.scene, self.mix, self.fastest, self.contacts, near=near, met=kept, count=self.count)

    @cached_property
    def fastest(self):
        """Largest velocity of any law, and of the crank where there is one, with room for drives that swing [m/s]."""
        velocities = [cycle.there.peaks().velocity for cycle in self.given_cycles.values()]
        if self.crank:
            motion = self.scene.motion
            velocities.append(
                law("crank", motion.stroke, motion.duration, rod_length=motion.rod_length).peaks().velocity
            )
        return float(max(velocities)) * self.swing

    @property
    def swing(self):
        """Times the velocity of a law that its drive may reach."""
        return SWING if self.scene.drive.kind in ("elastic", "motor") else 1.0

    @cached_property
    def roller_load(self):
        """What holds one roller at its height [N]: by the scene's engine at the mean speed, or by eq 1.6."""
        if not self.layered:
            return self.engineering.roller_force
        speed, load = np.array(
            [[contacts.value(each, name)[0] for name in ("speed", "load")] for each in self.contacts]
        ).T
        mean = self.scene.motion.stroke / self.scene.motion.duration
        return float(self.scene.machine.roller_length * np.interp(np.log(mean), np.log(speed), load))

    @cached_property
    def cart(self):
        """The cart with the reactions of its rollers."""
        return machine.cart(self.scene, self.roller_load)

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
                there = made.law(self.scene, objective, self)
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
        met, near = self.resistance_map, () if self.kept else self.rolled
        self.resistance_map = mapping.mapped(
            self.scene, self.mix, speed * self.swing, self.contacts, near=near, met=met, count=self.count
        )
        self.fastest = speed * self.swing
        for stale in ("resistance", "push", "oppositions"):
            self.__dict__.pop(stale, None)

    @cached_property
    def push(self):
        """What a straight push of the cart meets beside its inertia, an `Opposition`."""
        return Opposition(self.cart, self.resistance)

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
        for there in machine.laws(self.scene):
            self.count("laws")
            cycles[there.name] = there.cycle(dwell, dwell)
        return cycles

    @property
    def crank(self):
        """The crank of the machine, None where it has none."""
        return machine.crank(self.scene)

    @property
    def angles(self):
        """Crank angle of each cart ahead of the first [rad]."""
        return machine.angles(self.scene)

    def means(self, name):
        """The drive that carries a law."""
        return machine.means(self.scene, self.cycles[name])

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
            name: drive.Demand(self.cart, drive.Rigid(), cycle, self.resistance) for name, cycle in self.cycles.items()
        }
        asked = np.transpose([pulls(demand, rollers) for demand in demands.values()])
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
        """Let a crew of `pool` answer by the engines beside, and run what `Errands` it is given, which these are.

        This process goes its own way meanwhile.
        """
        directory = self._directory and self._directory / BESIDE
        with Errands(crew) as errands:
            self._answers = {}
            for name in self.scene.beside_engines:
                asked = self.scene.by(name), self.given_cycles, self.cycles, directory and directory / name
                self._answers[name] = errands.send(name, answered, asked)
            self._errands = errands
            try:
                yield errands
            finally:
                self._errands = None

    @cached_property
    def beside(self):
        """An `Aside` of each engine beside the scene's, by name."""
        if self._answers is None:
            with self.helped(Here()):
                return self.beside
        found = {}
        for name, answer in self._answers.items():
            found[name] = answer()
            self.count("beside")
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
            refuse_unknown("motion law", law, tuple(self.cycles))
        return Cam(cycle, table.breadth, FOLLOWERS[follower](table))

    @cached_property
    def turns(self):
        """A `Turn` of the shaft for 1 to 4 carts at their usual angles, and under "scene" that of the scene."""
        angles = {str(count): usual for count, usual in USUAL_ANGLES.items()}
        angles["scene"] = self.angles
        speed = np.pi / self.scene.motion.duration
        turns = {}
        for key, ahead in angles.items():
            self.count("crank")
            turns[key] = turn(self.cart, self.crank, speed, self.resistance, ahead)
        return turns


def _rigid(runs):
    """Runs of the drive that imposes each law on the cart itself, of elastic ones; None of none."""
    return runs and {name: run.rigid for name, run in runs.items()}
