"""Contact stage of a study: the formulas, and one roller at every speed by the engine of the scene.

`contact_stage` returns the stage of a single pass, or of the strokes of a forming process.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from compact.analysis import contact_cases as cases
from compact.analysis import pore_air
from compact.analysis.contact_cases import HeldQuantity, PassEnd, Passes, Progress
from compact.analysis.engineering_summary import Engineering, Number, engineering, numbers, peak_pressure
from compact.analysis.pore_air import AirCurve
from compact.analysis.stages.kept_results import KeptResults, contacts_key, read_results
from compact.analysis.worker_pool import Job, SerialExecutor
from compact.engines import ENGINES
from compact.engines.halfplane import LineContact, galin
from compact.engines.pore_air import NO_FORCES, AirForces
from compact.material.pore_air import PoreAir
from compact.numerics.validation import require_known
from compact.rolling_contact import Contact, compaction_rate
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from compact.analysis.process import ProcessStudy

SECOND_PASS_INCREMENTS = 4  # [-], elements per contact length; load and resistance of its second pass within 3 % of 10

Count = Callable[[str], None]  # of the runs of a stage, by its name


def no_count(stage: str) -> None:
    """Ignore the run of a stage."""


class ContactStage:
    """Contacts of one roller of a scene; each attribute is computed when first used.

    Parameters
    ----------
    directory : Path, optional
        Results of an earlier run, which are used if they have the same key.
    progress : callable, optional
        Called with lines of text by slow engines.

    Attributes
    ----------
    speeds : tuple of float
        Speeds of the contacts [m/s]; empty for the formulas, which have no speed.
    compacts : bool
        True if the mix compacts irreversibly.
    submit : callable
        Starts the second pass, a function and its argument, where it is to run.
    """

    def __init__(
        self, scene: Scene, count: Count = no_count, directory: Path | None = None, progress: Progress | None = None
    ) -> None:
        self.scene, self.count, self._directory, self.progress = scene, count, directory, progress
        self.mix = cases.scene_mix(scene)
        self.engine = ENGINES[scene.accuracy.engine]
        self.speeds = cases.contact_speeds(scene) if self.engine.reads("contact.speeds") else ()
        self.compacts = self.engine.reads(self.engine.fed_key)
        self.submit: Callable[[Callable[[Any], Any], Any], Job] = SerialExecutor().submit

    # the formulas

    @cached_property
    def engineering(self) -> Engineering:
        """Eqs 1.1-1.10 at the prescribed pressure, or at the pressure that the density requires."""
        self.count("contact")
        try:
            return engineering(self.scene, self.mix, peak_pressure(self.scene, self.mix))
        except ValueError as error:
            if not (self.speeds and self.scene.target):
                raise
            required = self.mix.required_pressure
            shown = f"they are shown at {required / 1e3:.4g} kPa, as the density requires"
            warnings.warn(f"the formulas do not reach the prescribed contact ({error}); {shown}", stacklevel=2)
            return engineering(self.scene, self.mix, required)

    @cached_property
    def exact(self) -> LineContact:
        """Galin's exact contact at the peak pressure of the formulas, with the traction of a driven roller."""
        return galin(
            radius=self.scene.machine.roller_radius, youngs_modulus=self.mix.effective_modulus,
            poisson=self.mix.poisson, friction=-self.mix.steel_friction, peak_pressure=self.engineering.pressure,
        )  # fmt: skip

    @cached_property
    def numbers(self) -> dict[str, Number]:
        """Results of the formulas and of the exact theory by name."""
        return numbers(self.scene, self.mix, self.engineering, self.exact)

    # the contacts

    @cached_property
    def process(self) -> "ProcessStudy | None":
        """Forming process; None for an engine of single passes."""
        return None

    @cached_property
    def key(self) -> str:
        """Hash of all inputs of the contacts and the resistance map."""
        return contacts_key(self.scene, self.mix)

    @cached_property
    def kept(self) -> KeptResults | None:
        """Results of an earlier run in the directory."""
        found = read_results(self._directory, self.key) if self._directory and self.speeds else None
        if found:
            self.count("kept")
        return found

    def case(self, speed: float) -> Any:
        """Return the case at a speed [m/s], under the quantity that is constant over speed."""
        return cases.case_of(self.scene, self.mix, speed, None, self.held, self.progress)

    def first_pass(self, speed: float, initial_guess: Contact | None = None) -> Contact:
        """Compute the first pass at a speed [m/s], under the quantity that is constant over speed."""
        return cases.solve(self.engine, self.scene, self.case(speed), initial_guess)

    def roll(self, speed: float, start: Passes | None = None, held: HeldQuantity | None = None) -> Passes:
        """Compute all passes, forward and back over the same mix, at a speed [m/s] from others as initial guess.

        The first pass has the target of the scene by default. Later ones hold the load or peak pressure that the scene
        prescribes or holds, else the height of the first.
        """
        self.count("rolled")
        engine, case = self.engine, cases.case_of(self.scene, self.mix, speed, None, held, self.progress)
        if self.scene.layer.passes == 1:
            return (cases.solve(engine, self.scene, case, start[0] if start else None),)
        if start and engine.equal(case, start[0]):
            known: Any = start
            return tuple(replace(each, speed=float(np.copysign(speed, each.speed))) for each in known)
        name, value = engine.target(case)
        forward, *later = cases.there_and_back(self.scene.layer.passes)
        forward = replace(forward, exit_density_ratio=value if name == "exit_density_ratio" else None)
        with cases.named_errors(self.scene, engine.name, speed):
            return cases.roll_stages(case, (forward, *later), engine)

    def over(self, duration: float) -> "ContactStage":
        """Return the stage of another duration of a pass [s]; itself, as the contact depends on the speed alone."""
        return self

    @cached_property
    def reference(self) -> Passes:
        """All passes at the mean speed, where the contact reaches the target of the scene."""
        return self.roll(self.scene.mean_speed)

    @cached_property
    def held(self) -> HeldQuantity | None:
        """Quantity that is constant over speed; None for the formulas.

        It is `contact.held` if the scene sets it, else a prescribed load or peak pressure, else the height.
        """
        if not self.speeds:
            return None
        if self.kept:
            return self.kept.held
        scene, mean = self.scene, self.scene.mean_speed
        prescribed = next((name for name in ("load", "peak_pressure") if name in scene.target), "height")
        name = (scene.contact and scene.contact.held) or prescribed
        target, value = self.engine.target(cases.case_of(scene, self.mix, mean))
        if target != cases.TARGETS[name]:
            value = float(getattr(self.reference[0], cases.TARGETS[name]))
        return HeldQuantity(name, value, mean)

    @cached_property
    def passes(self) -> list[tuple[float, Passes]]:
        """Speed [m/s] and results of all passes at each speed of the scene; empty for the formulas."""
        found: list[tuple[float, Passes]] = []
        for speed in self.speeds:
            found.append((speed, self.passes_at(speed, found[-1][1] if found else None)))
        return found

    def passes_at(self, speed: float, initial_guess: Passes | None = None) -> Passes:
        """Compute all passes at a speed [m/s], from the passes at another one as initial guess."""
        if speed == self.scene.mean_speed:
            return self.reference
        held = self.held  # which may compute the reference
        return self.roll(speed, initial_guess or self.__dict__.get("reference"), held)

    def record(self, speed: float, passes: Passes) -> Contact:
        """Return the numbers of passes at a speed [m/s], with the pore air at the deformation of the first."""
        return cases.contact_record(self.engine.name, speed, passes, self.air_forces_of(passes[0], speed))

    @property
    def first_passes(self) -> list[tuple[float, Contact]]:
        """Speed [m/s] and result of the first pass at each speed."""
        return [(speed, first) for speed, (first, *_) in self.passes]

    @cached_property
    def typical(self) -> tuple[float, Contact]:
        """Speed [m/s] and contact at the mean speed, of a layered engine at the nearest speed of the scene."""
        if not self.speeds:
            return self.scene.mean_speed, self.first_pass(self.scene.mean_speed)
        return self.first_passes[cases.nearest_speed(self.speeds, self.scene.mean_speed)]

    @cached_property
    def records(self) -> list[Contact]:
        """Scalar results at each speed; empty for the formulas."""
        if self.kept:
            return self.kept.contacts
        return [cases.contact_record(self.engine.name, *each, self.air_forces(each[0])) for each in self.passes]

    @cached_property
    def mean_record(self) -> Contact:
        """Scalar results at the speed of the scene that is nearest to the mean speed."""
        if not self.records:
            return self.typical[1]
        return self.records[cases.nearest_speed((each.speed for each in self.records), self.scene.mean_speed)]

    def at_mean_speed(self, name: str) -> float:
        """Interpolate a number of the contacts over the logarithm of the speed."""
        if not self.records:
            return float(getattr(self.typical[1], name))
        speeds, values = np.array([[each.speed, getattr(each, name)] for each in self.records]).T
        return float(np.interp(np.log(self.scene.mean_speed), np.log(speeds), values))

    @cached_property
    def roller_load(self) -> float:
        """Load of one roller [N]: of the engine at the mean speed, or by eq 1.6."""
        if not self.speeds:
            return self.engineering.roller_force
        return self.scene.machine.roller_length * self.at_mean_speed("load")

    def field_mesh(self, result: Contact) -> Any:
        """Return the mesh with fields of a contact, with the excess pressure of its pore air where the scene has it."""
        self.require_fields()
        self.count("fields")
        mesh = self.engine.fields(result)
        if pore_air.has_air(self.scene):
            pore_air.add_air_field(mesh, result, pore_air.pore_air_of(self.mix, self.scene.layer.fed_density_ratio))
        return mesh

    def require_fields(self) -> None:
        """Require an engine with fields inside the layer."""
        require_known(
            "engine with fields", self.engine.name, [each.name for each in ENGINES.values() if each.has_fields]
        )

    # what the resistance requires

    def added_mass(self, speed: float) -> tuple[float, float]:
        """Compute the added mass of one roller, see `Engine.expand`.

        Parameters
        ----------
        speed : float
            Speed of the roller [m/s].

        Returns
        -------
        tuple of float
            Added mass per unit length [kg/m] and relaxation time [s]; 0 where the engine has no memory in time: the
            state of compacting mix depends on the path, and its yield pressure on the present rate.

        Notes
        -----
        The added mass of a roller with stick and slip is that without friction; they differ by about a tenth.
        """
        if self.compacts:
            return 0.0, 0.0
        self.count("added mass")
        with cases.named_errors(self.scene, self.engine.name, speed):
            found = self.engine.expand(self.case(speed))
        return (0.0, 0.0) if found is None else (found.added_mass, found.relaxation_time)

    def rate_factor(self) -> Callable[[float], float]:
        """Return the factor of the yield pressure over the speed [m/s] at the depth at the mean speed.

        Under a constant load or pressure the depth changes with the speed; the factor there is a smooth function of it.
        """
        case = self.case(self.scene.mean_speed)
        depth = case.roller.indentation or self.mean_record.indentation
        rate = compaction_rate(1.0, case.roller.radius, case.layer.height, float(depth or 0.0))
        return lambda speed: case.material.rate_factor(rate * abs(speed))

    @property
    def sleeve_drag(self) -> float:
        """Drag of feed sleeves and smoothing plate, a part of the resistance to a cart [N]."""
        return 0.0

    @cached_property
    def second_job(self) -> Job | None:
        """Second pass by `submit`; None where it is kept, or the engine rolls over no compacted mix."""
        if self.kept or not self.engine.rolls_over:
            return None
        self.count("second pass")
        first = self.reference[0]
        coarse = self.scene.layer.return_stroke == "fresh" and self.engine.as_start(first) is not None
        numerics: dict[str, Any] = {"increments": SECOND_PASS_INCREMENTS} if coarse else {}
        return self.submit(partial(cases.roll_back, self.scene, self.mix, numerics), PassEnd.of(first))

    @cached_property
    def second_pass(self) -> tuple[float, float] | None:
        """Load and resistance of a second pass over those of the first, at the mean speed [-].

        None where the engine rolls over no compacted mix, or does not converge there.
        """
        if self.second_job is None:
            return self.kept.second_pass if self.kept else None
        try:
            load, resistance = self.second_job.result()
        except RuntimeError as error:
            if self.scene.layer.return_stroke == "compacted":
                raise
            warnings.warn(f"the return stroke over compacted mix is left out: {error}", stacklevel=2)
            return None
        first, air = self.reference[0], self.air_forces(self.scene.mean_speed) or NO_FORCES
        return load / (first.load + air.load), max(-resistance / (first.resistance + air.resistance), 0.0)

    @property
    def return_ratios(self) -> tuple[float, float]:
        """Load and resistance of the return stroke over those of the forward stroke [-]."""
        compacted = self.scene.layer.return_stroke == "compacted"
        return self.second_pass if compacted and self.second_pass else (1.0, 1.0)

    # pore air

    @property
    def has_air(self) -> bool:
        """True if load and resistance contain the pore air."""
        return pore_air.has_air(self.scene)

    @property
    def _fed_air(self) -> PoreAir | None:
        """Pore air of the fed mix; None of drained mix that is occluded as fed."""
        try:
            return pore_air.pore_air_of(self.mix, self.scene.layer.fed_density_ratio)
        except ValueError:
            if pore_air.has_air(self.scene):
                raise
            return None

    @cached_property
    def air_curve(self) -> AirCurve | None:
        """Forces of the pore air at the contact near the mean speed; None for occluded mix and a linear layer.

        Raises
        ------
        ValueError
            If the scene has pore air and its mix is occluded as fed.
        """
        if not self.compacts or self.kept:
            return self.kept.air_curve if self.kept else None
        speed, contact = self.typical
        if (air := self._fed_air) is None:
            return None
        case = self.case(speed)
        under = pore_air.air_under(contact, case.layer, case.roller, air)
        curve = pore_air.air_curve(under, air.permeability, contact)
        if pore_air.is_coupled(self.scene):
            curve = replace(
                curve, coupled=tuple(pore_air.coupled_samples(contact, air, curve, self.speeds, self.count))
            )
        return curve

    def air_forces(self, speed: float) -> AirForces | None:
        """Return the changes of a contact by its pore air at a speed [m/s]; None for a scene without pressure of it."""
        if not pore_air.has_air(self.scene) or self.air_curve is None:
            return None
        return self.air_curve.at(speed, self.mix.air_permeability)

    def air_forces_of(self, contact: Contact, speed: float) -> AirForces | None:
        """Compute the changes of a first pass by its pore air; None for a scene without pressure of the air."""
        return self.air_band_of(contact, speed)[0] if pore_air.has_air(self.scene) else None

    def air_band_of(self, contact: Contact, speed: float) -> tuple[AirForces, AirForces] | tuple[None, None]:
        """Compute the changes of a first pass by its pore air at a speed [m/s] and without drainage.

        They are those at the deformation without air. Both are None for a layer that does not compact, and for drained
        mix that is occluded as fed.
        """
        if not self.engine.reads("mix.pore_air") or (air := self._fed_air) is None:
            return None, None
        case = cases.case_of(self.scene, self.mix, speed)
        under = pore_air.air_under(contact, case.layer, case.roller, air)
        pressure = under.pressure(speed)
        return under.forces(pressure), under.forces(under.pressure(pore_air.UNDRAINED * air.permeability, pressure))


class ProcessCase(NamedTuple):
    """Strokes of a forming process at one speed of the cart [m/s]."""

    process: "ProcessStudy"
    speed: float


class ProcessStage(ContactStage):
    """Strokes of the forming process under one roller: each contact is their mean at one speed of the cart."""

    @cached_property
    def air_curve(self) -> AirCurve | None:
        """None: the lifts have their own pore air."""
        return None

    @cached_property
    def process(self) -> "ProcessStudy":
        """Forming process of the scene."""
        from compact.analysis.process import ProcessStudy  # finite elements are imported where strokes are computed

        detail, known = cases.process_detail(self.scene), self.kept.lifts if self.kept else None
        return ProcessStudy(self.scene, detail, self.progress or (lambda _: None), known)

    def case(self, speed: float) -> Any:
        """Return the strokes at a speed of the cart [m/s]."""
        return ProcessCase(self.process, speed)

    def roll(self, speed: float, start: Passes | None = None, held: HeldQuantity | None = None) -> Passes:
        """Compute all passes at a speed [m/s] from others as initial guess, to the target of the scene by default."""
        self.count("rolled")
        return (self.first_pass(speed),)

    def over(self, duration: float) -> ContactStage:
        """Return the stage of another duration of a pass [s], in which the mould brings another amount of mix.

        Its lumped lifts are those of this one.
        """
        if duration == self.scene.motion.duration:
            return self
        scene = self.scene.replaced(**{"motion.duration": duration, "motion.other_durations": None})
        other = ProcessStage(scene, self.count, None, self.progress)
        other.process = replace(self.process, scene=scene, known=self.process.lifts)
        return other

    @cached_property
    def held(self) -> HeldQuantity:
        """Mean bite of the strokes at the mean speed, the feed of which is constant over speed."""
        if self.kept:
            return self.kept.held
        return HeldQuantity("height", cast(Any, self.reference[0]).indentation, self.scene.mean_speed)

    @property
    def has_air(self) -> bool:
        """True if load and resistance contain the pore air."""
        return self.process.counts_air

    def air_forces(self, speed: float) -> AirForces | None:
        """Return the changes of the strokes by their pore air at a speed [m/s]; None of drained mix."""
        return self.process.air_forces(speed)

    @property
    def return_ratios(self) -> tuple[float, float]:
        """Load and resistance of a return stroke over those of a forward stroke [-]."""
        return self.process.row.return_ratios

    @property
    def sleeve_drag(self) -> float:
        """Drag of feed sleeves and smoothing plate, a part of the resistance to a cart [N]."""
        return self.process.standing_drag

    def rate_factor(self) -> Callable[[float], float]:
        """Return the factor of the yield pressure over the speed [m/s]."""
        return self.process.rate_factor_at


def contact_stage(
    scene: Scene, count: Count = no_count, directory: Path | None = None, progress: Progress | None = None
) -> ContactStage:
    """Return the contact stage of a scene; nothing is computed yet."""
    stage = ProcessStage if ENGINES[scene.accuracy.engine].reads("process") else ContactStage
    return stage(scene, count, directory, progress)
