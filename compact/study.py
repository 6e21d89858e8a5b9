"""One scene from contact to ranking: what is wanted is computed once, when it is first asked for, and counted.

    study = Study(load_scene("scene.toml"))
    study.rankings["peak_force"]

`report.write` puts the results of a study into a directory; `compact run` is a thin door to it.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact import contact, contacts, drive, machine, made, mapping, mix
from compact.cam import Cam, FlatFace, Pointed, RollerFollower
from compact.cart import Opposition
from compact.crank import USUAL_ANGLES, turn
from compact.engine import LAYERED, fields, passes, speeds
from compact.engineering import KNOWN_BY, engineering
from compact.halfplane import galin
from compact.motion import law
from compact.scene import SceneError

SWING = 2.0  # times the velocity of the law, which an elastic drive may reach after a jump
FOLLOWERS = {
    "pointed": lambda table: Pointed(),
    "roller": lambda table: RollerFollower(table.roller_follower_radius),
    "flat": lambda table: FlatFace(),
}


@dataclass(frozen=True)
class Number:
    """A headline number: value, unit, how it is known, and its spread from `low` to `high` where that is known."""

    value: float
    unit: str
    known_by: str
    low: float | None = None
    high: float | None = None


class Study:
    """The stages of one scene; each attribute is computed when first asked for, `counts` says how often.

    directory : of an earlier run, whose contacts and resistance map are taken where they fit; `kept` counts them
    """

    def __init__(self, scene, step=lambda stage: None, directory=None):
        self.scene = scene
        self.counts = Counter()
        self._step = step
        self._directory = directory

    @property
    def steps(self):
        """How many counts the stages of all that the scene wants will make."""
        wanted, optimised = self.scene.output.wanted, self.scene.motion.optimise
        laws = len(self.scene.law_names) + len(self.scene.table_paths) + (len(optimised.objectives) if optimised else 0)
        rolled = 0 if self.counts["kept"] or not self.layered else len(speeds(self.scene))
        figures = 3 + len({"cams", "reactions", "crank"} & set(wanted)) + 2 * self.layered
        figures = figures if {"figures", "report"} & set(wanted) else 0
        cams = 2 * laws * len(FOLLOWERS) if "cams" in wanted else 0  # made and measured
        crank = len(USUAL_ANGLES) + 1 if "crank" in wanted else 0
        beside = laws + 1 if self.layered else 0  # runs and rankings by formula
        fields = (rolled + 1) * ("fields" in wanted and rolled > 0)
        added = sum(self.counts[stage] for stage in ("resistance", "added mass", "kept", "passage", "run-up"))
        return 2 + 2 * laws + cams + crank + figures + beside + rolled + fields + added + ("report" in wanted)

    def count(self, stage):
        """One more run of a stage."""
        self.counts[stage] += 1
        self._step(stage)

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
        """Headline `Number`s by name; the spread is that of the required pressure, where the formulas still hold."""
        needed = self.mix.parameter("required_pressure")
        ends = [self._engineering_at(pressure) for pressure in (needed.low, needed.high)]
        numbers = {}
        for name, (unit, known_by) in KNOWN_BY.items():
            low, high = (None if end is None else getattr(end, name) for end in ends)
            value = getattr(self.engineering, name)
            spread = {} if low == value == high else {"low": low, "high": high}
            numbers[name] = Number(value, unit, known_by, **spread)
        return numbers | self._exact_numbers

    def _engineering_at(self, pressure):
        try:
            return engineering(self.scene, self.mix, pressure)
        except ValueError:  # beyond the formulas: no such angle
            return None

    @property
    def _exact_numbers(self):
        """What exact theory says beside eqs 1.5-1.7 at the same peak pressure."""
        length, known_by = self.scene.machine.roller_length, "Galin, exact for a half-plane"
        return {
            "exact_capture_angle": Number(float(np.arcsin(self.exact.leading / self.exact.radius)), "rad", known_by),
            "exact_roller_force": Number(float(self.exact.load * length), "N", known_by),
            "exact_contact_length": Number(float(self.exact.contact_length), "m", known_by),
        }

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
        """Resistance of the mix to one cart, by the scene's engine, as a callable of velocity and acceleration."""
        return self.resistance_map if self.layered else self.formula_resistance

    @cached_property
    def formula_resistance(self):
        """The same by eq 1.8, which knows no speed."""
        return contact.dry_resistance(self.scene.machine.rollers * self.engineering.roller_resistance)

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
    def formula_cart(self):
        """The cart with the reactions of its rollers by eq 1.6."""
        return machine.cart(self.scene, self.engineering.roller_force)

    @cached_property
    def cycles(self):
        """The motion laws there and back, by name; tables of the user, then laws made for the machine last."""
        return self.given_cycles | self.optimal_cycles

    @cached_property
    def optimal_cycles(self):
        """Laws that ask least of the drive, by name, one per objective of [motion.optimise]; rigid drive, no rod."""
        table, dwell = self.scene.motion.optimise, self.scene.motion.dwell
        cycles = {}
        for objective in table.objectives if table else ():
            self.count("laws")
            there = made.law(self.scene, objective, self)
            cycles[there.name] = there.cycle(dwell, dwell)
        return cycles

    @property
    def limits(self):
        """`Limits` of [motion.optimise]; no faster than the resistance map reaches, where there is one."""
        return made.limits(self.scene, self.fastest / self.swing if self.layered else np.inf)

    def reach(self, speed):
        """Carry the resistance on to a speed [m/s]; what is known of it stays."""
        self.fastest, met = speed * self.swing, self.resistance_map
        near = () if self.kept else self.rolled
        self.resistance_map = mapping.mapped(
            self.scene, self.mix, self.fastest, self.contacts, near=near, met=met, count=self.count
        )
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
        return self._runs(self.cart, self.resistance)

    @cached_property
    def rankings(self):
        """Lists of `Ranked` by criterion, those the scene names."""
        return self._rankings(self.runs)

    @cached_property
    def formula_runs(self):
        """The same runs by formula, where the scene's engine is another one."""
        return self._runs(self.formula_cart, self.formula_resistance) if self.layered else {}

    @cached_property
    def formula_rankings(self):
        """The same rankings by formula, where the scene's engine is another one."""
        return self._rankings(self.formula_runs) if self.layered else {}

    def _runs(self, cart, resistance):
        motion = self.scene.motion
        working = (motion.run_up, 1 - motion.run_down)
        runs = {}
        for name, cycle in self.cycles.items():
            self.count("runs")
            runs[name] = drive.simulate(cart, self.means(name), cycle, resistance, working=working)
        return runs

    def _rankings(self, runs):
        self.count("rankings")
        return {by: drive.rank(runs.values(), by) for by in self.scene.drive.rank_by}

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
        cycle = self.given_cycles.get(law) or self.cycles[law]  # a given one waits for no optimisation
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
