"""Contact stage of a study: the formulas, and one roller at every speed by the engine of the scene.

`roll_scene`, `roll_passes` and `added_mass` compute single contacts of a scene by one of the engines. `ContactStage`
holds all contacts of a study; each is computed when first used.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from compact.analysis import contact_cases
from compact.analysis.contact_cases import ContactRecord, HeldQuantity, contact_inputs, nearest_speed
from compact.analysis.engineering_summary import Engineering, Number, engineering, numbers, peak_pressure
from compact.analysis.engines import ENGINES, Engine, expand_resistance
from compact.analysis.failures import is_refusal
from compact.analysis.pore_air import (
    AirCurve,
    AirForces,
    add_air_field,
    air_curve,
    air_under,
    coupled_samples,
    has_air,
    is_coupled,
    pore_air_of,
)
from compact.analysis.stages.kept_results import KeptResults, contacts_key, read_results
from compact.analysis.stages.model_spread import ModelSpread, model_spread
from compact.engines.halfplane import LineContact, galin
from compact.material.laws import Compaction
from compact.material.mix import Mix
from compact.numerics.validation import NotFiniteError
from compact.rolling_contact import (
    ContactResult,
    EquilibriumError,
    HeapingError,
    Layer,
    LayerContactResult,
    Roller,
    UnsteadyError,
)
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from compact.analysis.process import ProcessStudy

SECOND_PASS_INCREMENTS = 7  # [-], elements per contact length of "compaction"; its resistance, 3 % of the first, +-4 %
SAME_LAYER = 5e-5  # [-], of the height before the pass; its change with speed, by the elastic recovery, is smaller

Count = Callable[[str], None]  # of the runs of a stage, by its name
Progress = Callable[[str], None]  # of lines of text
Passes = tuple[ContactResult, ...]


def no_count(stage: str) -> None:
    """Ignore the run of a stage."""


def roll_scene(
    scene: Scene,
    mix: Mix,
    speed: float,
    engine: str | None = None,
    initial_guess: ContactResult | None = None,
    held: HeldQuantity | None = None,
    progress: Progress | None = None,
) -> ContactResult:
    """Compute the contact of one roller of a scene in its first pass.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    engine : str, optional
        Name of the engine; that of the scene by default.
    initial_guess : ContactResult, optional
        Contact at another speed in the same direction, of another mix or depth. Engines with continuation use it on the
        same base. If only the speed differs and the mix has no rate sensitivity, it is the result.
    progress : callable, optional
        Called with lines of text by engines with continuation.

    Raises
    ------
    ValueError
        If the engine does not cover the scene.
    RuntimeError
        If the engine does not converge, or the roller would reach the base.
    """
    used = ENGINES[engine or scene.accuracy.engine]
    if used.forming:
        from compact.analysis.process_contact import process_contact, process_study

        with _named_errors(scene, used.name, speed):
            return process_contact(process_study(scene, progress), speed)
    layer, roller, material = contact_inputs(scene, mix, used.name, speed, held)
    options = _engine_options(scene, used, held, progress)
    if guess := _continuable(used, initial_guess, layer, speed):
        options["start"] = guess
        if _has_same_height(guess, layer):
            if _differs_in_speed_only(roller, material, guess, speed):
                return _at_speed(guess, speed)
            layer = guess.layer
    with _named_errors(scene, used.name, speed):
        result = used.roll(layer, roller, material, speed, **options)
        _require_above_base(result, layer)
    return result


def roll_passes(
    scene: Scene,
    mix: Mix,
    speed: float,
    initial_guess: Sequence[ContactResult] | None = None,
    held: HeldQuantity | None = None,
    count: int | None = None,
    first: ContactResult | None = None,
    progress: Progress | None = None,
    **numerics: Any,
) -> Passes:
    """Compute the contacts of all passes of a scene, forward and back over the same mix.

    The first pass is that of `roll_scene`. Later ones hold the load or peak pressure that the scene prescribes or
    holds, else the height of the first.

    Parameters
    ----------
    speed : float
        Speed of the first pass [m/s].
    count : int, optional
        Number of passes; that of the scene by default.
    progress : callable, optional
        Called with lines of text by engines with continuation.
    **numerics
        Keyword arguments of `roll` of the engine for all passes that are computed.

    Returns
    -------
    tuple of ContactResult
        One result for a linear layer, which recovers between passes.
    """
    used, count = ENGINES[scene.accuracy.engine], count or scene.layer.passes
    if not used.compacting or count == 1:
        guess = initial_guess[0] if initial_guess else None
        return (roll_scene(scene, mix, speed, None, guess, held, progress),)
    from compact.analysis.multipass import passes, there_and_back

    layer, roller, material = contact_inputs(scene, mix, used.name, speed, held)
    known = _continuable(used, initial_guess[0] if initial_guess else None, layer, speed)
    same_layer = known is not None and _has_same_height(known, layer)
    if initial_guess and known and same_layer and _differs_in_speed_only(roller, material, known, speed):
        return tuple(_at_speed(each, float(np.copysign(speed, cast(Any, each).speed))) for each in initial_guess)
    forward, *later = there_and_back(count)
    options = _engine_options(scene, used, held, progress)
    numerics |= {key: options.pop(key) for key in ("torque", "progress", "max_contact_angle") if key in options}
    stages = (replace(forward, **options), *later)
    assert isinstance(material, Compaction)  # of a compacting engine
    with _named_errors(scene, used.name, speed):
        return passes(layer, roller, material, speed, stages, engine=used.name, first=first, **numerics)


def air_forces_of(scene: Scene, mix: Mix, contact: ContactResult, speed: float) -> AirForces | None:
    """Compute the changes of one contact by its pore air, at its deformation without air.

    Parameters
    ----------
    contact : ContactResult
        First pass without air.
    speed : float
        Speed of the roller [m/s].

    Returns
    -------
    AirForces or None
        None for a scene without pressure of the air.
    """
    if not has_air(scene):
        return None
    layer, roller, _ = contact_inputs(scene, mix, scene.accuracy.engine, speed)
    under = air_under(contact, layer, roller, pore_air_of(mix, scene.layer.fed_density_ratio))
    pressure = under.pressure(speed)
    return AirForces(*under.forces(pressure), under.largest_excess_behind(pressure))


def added_mass(
    scene: Scene, mix: Mix, speed: float, held: HeldQuantity | None, count: Count = no_count
) -> tuple[float, float]:
    """Compute the added mass of one roller, see `engines.expand_resistance`.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    count : callable
        Called with "added mass" if an engine solves for it.

    Returns
    -------
    tuple of float
        Added mass per unit length [kg/m] and relaxation time [s].

    Notes
    -----
    A compacting layer has no added mass: its state depends on the path, and its yield pressure on the present rate of
    compaction. The added mass of a roller with stick and slip is that without friction; they differ by about a tenth.
    """
    used = ENGINES[scene.accuracy.engine]
    if used.compacting:
        return 0.0, 0.0
    layer, roller, material = contact_inputs(scene, mix, used.name, speed, held)
    assert not isinstance(material, Compaction)  # of a linear layer
    if used.torque and roller.rolling in ("free", "driven"):
        roller = replace(roller, rolling="frictionless")
    count("added mass")
    options = used.tolerance(scene.accuracy.tolerance, estimate=False)
    with _named_errors(scene, used.name, speed):
        found = expand_resistance(layer, roller, material, speed, engine=used.name, **options)
    return found.added_mass, found.relaxation_time


def _at_speed(result: Any, speed: float) -> ContactResult:
    """Return the result of an engine with continuation under another speed, on which it does not depend."""
    return replace(result, speed=speed)


def _continuable(engine: Engine, guess: ContactResult | None, layer: Layer, speed: float) -> LayerContactResult | None:
    """Return a contact in the same direction on the same base, over a layer of any height; else None."""
    if guess is None or not engine.continuation:
        return None
    known = cast(LayerContactResult, guess)
    same = replace(known.layer, height=layer.height) == layer
    return known if known.speed * speed > 0 and same else None


def _has_same_height(guess: LayerContactResult, layer: Layer) -> bool:
    """Return True if a layer is as high as that of the guess, but for the elastic recovery."""
    return abs(guess.layer.height / layer.height - 1) < SAME_LAYER


def _differs_in_speed_only(roller: Roller, material: Any, guess: LayerContactResult, speed: float) -> bool:
    """Return True if the contact differs from the guess by its speed only, and the mix has no rate sensitivity."""
    if speed == guess.speed or material != guess.material:
        return False
    as_found = replace(guess.roller, indentation=guess.indentation, load=None, peak_pressure=None)
    return not material.rate_sensitivity and roller in (guess.roller, as_found)


@contextmanager
def _named_errors(scene: Scene, engine: str, speed: float) -> Iterator[None]:
    """Name scene, engine and speed in errors of an engine."""
    case = f"{scene.title or 'untitled scene'}, {engine} at {speed:g} m/s"
    try:
        yield
    except NotFiniteError as error:  # a quantity of the iteration, as the inputs are finite
        words = "the iteration diverged, a stress or strain is no longer finite; press less, or feed denser mix"
        raise RuntimeError(f"{case}: {words}") from error
    except ValueError as error:
        if "load" not in scene.target or not str(error).startswith("`load`"):
            raise
        load, length = scene.target["load"], scene.machine.roller_length
        raise ValueError(f"{error} (contact.load = {load:g} N over roller_length = {length:g} m)") from error
    except HeapingError as error:
        hint = f'; unusual = ["{_target_key(scene)}"] computes it all the same'
        raise HeapingError(f"{case}: {error}{hint}", error.heaping) from error
    except UnsteadyError as error:
        raise UnsteadyError(f"{case}: {error}", error.unsteady) from error
    except EquilibriumError as error:
        raise EquilibriumError(f"{case}: {error}") from error
    except RuntimeError as error:
        if not is_refusal(error):
            raise
        raise RuntimeError(f"{case}: {error}") from error


def _engine_options(
    scene: Scene, engine: Engine, held: HeldQuantity | None, progress: Progress | None
) -> dict[str, Any]:
    """Return the keyword arguments of `roll` for a scene."""
    options, machine = engine.tolerance(scene.accuracy.tolerance), scene.machine
    if not engine.layered:  # factors of eqs 1.6 and 1.8
        options["rolling_friction"] = machine.roller_friction + machine.bearing_friction
        options |= {"nonuniformity": machine.pressure_nonuniformity, "one_sided": machine.one_sided}
    if engine.torque and machine.roller_torque is not None:
        options["torque"] = machine.roller_torque / machine.roller_length
    if engine.continuation and progress is not None:
        options["progress"] = progress
    if engine.continuation and _target_key(scene) in scene.unusual:
        options["max_contact_angle"] = None  # without the estimate of heaping
    if held is None and contact_cases.has_density_target(scene, engine.name):
        options["exit_density_ratio"] = scene.mix.density_ratio
    return options


def _target_key(scene: Scene) -> str:
    """Return the scene key of the target of the contact."""
    return next((f"contact.{name}" for name in scene.target), "mix.density_ratio")


def _require_above_base(result: ContactResult, layer: Layer) -> None:
    """Raise RuntimeError if the indentation exceeds the layer, which small strains do not prevent."""
    indentation = getattr(result, "indentation", 0.0)  # none on a half-plane
    if indentation >= layer.height:
        raise RuntimeError(
            f"the indentation of {indentation:.3g} m reaches the base of a layer {layer.height:g} m high; press less"
        )


class ContactStage:
    """Contacts of one roller of a scene; each attribute is computed when first used.

    Parameters
    ----------
    directory : Path, optional
        Results of an earlier run, which are used if they have the same key.
    progress : callable, optional
        Called with lines of text by engines with continuation.
    """

    def __init__(
        self,
        scene: Scene,
        mix: Mix,
        count: Count = no_count,
        directory: Path | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.scene, self.mix, self.count, self._directory, self.progress = scene, mix, count, directory, progress
        self.engine = ENGINES[scene.accuracy.engine]

    @cached_property
    def engineering(self) -> Engineering:
        """Eqs 1.1-1.10 at the prescribed pressure, or at the pressure that the density requires."""
        self.count("contact")
        try:
            return engineering(self.scene, self.mix, peak_pressure(self.scene, self.mix))
        except ValueError as error:
            if not (self.engine.layered and self.scene.target):
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

    @cached_property
    def key(self) -> str:
        """Hash of all inputs of the contacts and the resistance map."""
        return contacts_key(self.scene, self.mix)

    @cached_property
    def kept(self) -> KeptResults | None:
        """Results of an earlier run in the directory."""
        found = read_results(self._directory, self.key) if self._directory and self.engine.layered else None
        if found:
            self.count("kept")
        return found

    @cached_property
    def process(self) -> "ProcessStudy | None":
        """Forming process of the scene; None for an engine of single passes."""
        if not self.engine.forming:
            return None
        from compact.analysis.process_contact import process_study

        found = process_study(self.scene, self.progress)
        return replace(found, known=self.kept.lifts) if self.kept else found

    def first_pass(self, speed: float, initial_guess: ContactResult | None = None) -> ContactResult:
        """Compute the first pass at a speed [m/s], under the quantity that is constant over speed."""
        if self.process is not None:
            from compact.analysis.process_contact import process_contact

            with _named_errors(self.scene, self.engine.name, speed):
                return process_contact(self.process, speed)
        return roll_scene(self.scene, self.mix, speed, None, initial_guess, self.held, self.progress)

    def over(self, duration: float) -> "ContactStage":
        """Return the stage of another duration of a pass [s], with the lumped lifts of this one."""
        scene = self.scene.replaced(**{"motion.duration": duration, "motion.other_durations": None})
        other = ContactStage(scene, self.mix, self.count, None, self.progress)
        if self.process is not None:
            other.process = replace(self.process, scene=scene, known=self.process.lifts)
        return other

    @cached_property
    def reference(self) -> Passes:
        """All passes at the mean speed, where the contact reaches the target of the scene."""
        self.count("rolled")
        if self.process is not None:
            return (self.first_pass(self.scene.mean_speed),)
        return roll_passes(self.scene, self.mix, self.scene.mean_speed, progress=self.progress)

    @cached_property
    def held(self) -> HeldQuantity | None:
        """Quantity that is constant over speed; None for the formulas."""
        if not self.engine.layered:
            return None
        if self.kept:
            return self.kept.held
        if self.process is not None:
            depth = cast(LayerContactResult, self.reference[0]).indentation
            return HeldQuantity("height", depth, self.scene.mean_speed)
        return contact_cases.hold_quantity(self.scene, self.mix) or contact_cases.hold_quantity(
            self.scene, self.mix, self.reference[0]
        )

    @cached_property
    def passes(self) -> list[tuple[float, Passes]]:
        """Speed [m/s] and results of all passes at each speed of the scene; empty for the formulas."""
        found: list[tuple[float, Passes]] = []
        for speed in contact_cases.contact_speeds(self.scene) if self.engine.layered else ():
            found.append((speed, self.passes_at(speed, found[-1][1] if found else None)))
        return found

    def passes_at(self, speed: float, initial_guess: Passes | None = None) -> Passes:
        """Compute all passes at a speed [m/s], from the passes at another one as initial guess."""
        if speed == self.scene.mean_speed:
            return self.reference
        held, guess = self.held, initial_guess or self.__dict__.get("reference")
        self.count("rolled")
        if self.process is not None:
            return (self.first_pass(speed),)
        return roll_passes(self.scene, self.mix, speed, guess, held, progress=self.progress)

    @property
    def first_passes(self) -> list[tuple[float, ContactResult]]:
        """Speed [m/s] and result of the first pass at each speed."""
        return [(speed, first) for speed, (first, *_) in self.passes]

    @cached_property
    def typical(self) -> tuple[float, ContactResult]:
        """Speed [m/s] and contact at the mean speed, of a layered engine at the nearest speed of the scene."""
        mean = self.scene.mean_speed
        if not self.engine.layered:
            return mean, roll_scene(self.scene, self.mix, mean)
        return self.first_passes[nearest_speed((speed for speed, _ in self.first_passes), mean)]

    @cached_property
    def records(self) -> list[ContactRecord]:
        """Scalar results at each speed; empty for the formulas."""
        if self.kept:
            return self.kept.contacts
        name = self.engine.name
        return [contact_cases.contact_record(name, *each, self.air_forces(each[0])) for each in self.passes]

    @cached_property
    def air_curve(self) -> AirCurve | None:
        """Forces of the pore air at the contact near the mean speed; None for a linear layer and occluded mix.

        Raises
        ------
        ValueError
            If the scene has pore air and its mix is occluded as fed.
        """
        if not self.engine.compacting or self.engine.forming:
            return None
        if self.kept:
            return self.kept.air_curve
        speed, contact = self.typical
        layer, roller, _ = contact_inputs(self.scene, self.mix, self.engine.name, speed, self.held)
        try:
            air = pore_air_of(self.mix, self.scene.layer.fed_density_ratio)
        except ValueError:
            if has_air(self.scene):
                raise
            return None
        curve = air_curve(air_under(contact, layer, roller, air), air.permeability, contact)
        if is_coupled(self.scene):
            speeds = contact_cases.contact_speeds(self.scene)
            curve = curve.with_coupled(coupled_samples(contact, air, curve, speeds, self.count))
        return curve

    @property
    def has_air(self) -> bool:
        """True if load and resistance contain the pore air."""
        return has_air(self.scene) if self.process is None else self.process.counts_air

    @property
    def requires_model_spread(self) -> bool:
        """True for a scene of a compacting engine with the output "model_spread"."""
        return "model_spread" in self.scene.output.items and self.engine.compacting

    @cached_property
    def model_spread(self) -> ModelSpread | None:
        """Contacts by the other laws of the mix; None for a scene without the output "model_spread"."""
        if not self.requires_model_spread:
            return None
        if self.kept and self.kept.model_spread:
            return self.kept.model_spread
        assert self.held is not None  # of a compacting engine
        self.count("model spread")
        return model_spread(self.scene, self.mix, self.held)

    def air_forces_of(self, contact: ContactResult, speed: float) -> AirForces | None:
        """Return the changes of a first pass by its pore air; see `air_forces_of`."""
        return air_forces_of(self.scene, self.mix, contact, speed)

    def air_forces(self, speed: float) -> AirForces | None:
        """Return the changes of a contact by its pore air at a speed [m/s]; None for a scene without pressure of it."""
        if self.process is not None:
            from compact.analysis.process_contact import process_air

            return process_air(self.process, speed)
        if not has_air(self.scene) or self.air_curve is None:
            return None
        return self.air_curve.at(speed, self.mix.air_permeability)

    @cached_property
    def fields(self) -> list[tuple[Any, ContactResult]]:
        """Mesh with fields, and result, at each speed, by an engine with fields."""
        found = []
        for _, result in self.first_passes:
            self.count("fields")
            found.append((self.field_mesh(result), result))
        return found

    def field_mesh(self, result: ContactResult) -> Any:
        """Return the mesh with fields of a contact, with the excess pressure of its pore air where the scene has it."""
        mesh = self.engine.fields(result)
        if has_air(self.scene) and self.engine.name == "compaction":
            add_air_field(mesh, result, pore_air_of(self.mix, self.scene.layer.fed_density_ratio))
        return mesh

    @cached_property
    def roller_load(self) -> float:
        """Load of one roller [N]: of the engine at the mean speed, or by eq 1.6."""
        if not self.engine.layered:
            return self.engineering.roller_force
        speed, load = np.array([[each.speed, each.load] for each in self.records]).T
        mean = self.scene.mean_speed
        return float(self.scene.machine.roller_length * np.interp(np.log(mean), np.log(speed), load))

    @cached_property
    def second_pass(self) -> tuple[float, float] | None:
        """Load and resistance of a second pass over those of the first, at the mean speed [-].

        None for a linear layer, which recovers, for the formulas, which state one stroke, for the strokes of a process,
        which are passes over the same mix, and for an engine of another package.
        """
        if not self.engine.multipass:
            return None
        if self.kept:
            return self.kept.second_pass
        scene, first = self.scene, self.reference[0]
        self.count("second pass")
        try:
            back = self._second_pass(first)
        except RuntimeError as error:
            if scene.layer.return_stroke == "compacted":
                raise
            warnings.warn(f"the return stroke over compacted mix is left out: {error}", stacklevel=2)
            return None
        air = self.air_forces(scene.mean_speed) or AirForces(0.0, 0.0, 0.0)
        load, resistance = first.load + air.load, first.resistance + air.resistance
        return back.load / load, max(-back.resistance / resistance, 0.0)

    def _second_pass(self, first: ContactResult) -> ContactResult:
        """Compute a second pass, on a coarse mesh where the drive returns over fresh mix."""
        coarse = self.engine.continuation and self.scene.layer.return_stroke == "fresh"
        numerics: dict[str, Any] = {"increments": SECOND_PASS_INCREMENTS} if coarse else {}
        speed = self.scene.mean_speed
        return roll_passes(
            self.scene, self.mix, speed, count=2, first=first, progress=self.progress, **numerics
        )[1]  # fmt: skip

    @property
    def return_ratios(self) -> tuple[float, float]:
        """Load and resistance of the return stroke over those of the forward stroke [-]."""
        if self.process is not None:
            return self.process.forces_at(self.scene.mean_speed).return_ratios
        compacted = self.scene.layer.return_stroke == "compacted"
        return self.second_pass if compacted and self.second_pass else (1.0, 1.0)
