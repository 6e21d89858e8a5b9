"""One-at-a-time sensitivity of the least peaks of force and power to the inputs, with a rigid drive.

Inputs of the mix vary over the spread of the prior. Inputs without spread, and those of the machine, vary by a tenth;
the density ratio before the pass varies by a tenth of its change. At each end the scene is ranked again:

    column, spectral     by the engine, with new contacts at the speeds of the scene
    fem, compaction      by the resistance map if the input does not change the layer, else by formula, as a new
                         map would cost as much as the study itself
    formula              by formula

New contacts are steady: they have no added mass. Peaks are those of the samples of a cycle, accurate to 1e-3.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from compact import drive
from compact.analysis import machine_models
from compact.analysis.contact_cases import contact_speeds
from compact.analysis.engines import ENGINES
from compact.analysis.pore_air import AirForces, has_air
from compact.analysis.stages.contacts import roll_scene
from compact.analysis.stages.drives import Stages, build_stages
from compact.analysis.stages.resistance import ResistanceLaw
from compact.machine.cart import Cart
from compact.machine.ranking import BUILD_TOLERANCE, first_of
from compact.material.mix import Parameter
from compact.motion.profile import Cycle
from compact.quantities import INPUT
from compact.resistance import ResistanceMap

VARIATION = 0.1  # [-], relative variation of an input without spread
SPEED_MARGIN = 1.2  # [-], range of new contacts over the largest speed; a duration shorter by a tenth is within it
MIX_INPUTS = {  # engine -> parameters of the mix that it depends on
    "formula": ("required_pressure", "effective_modulus", "poisson", "steel_friction"),
    "spectral": (
        "required_pressure", "effective_modulus", "poisson", "steel_friction", "instant_over_relaxed",
        "relaxation_time",
    ),
    "column": (
        "heckel_slope", "friction_angle", "cohesion", "unloading_modulus", "poisson", "steel_friction",
        "rate_sensitivity",
    ),
}  # fmt: skip
AIR_INPUTS = ("air_permeability", "occlusion_saturation")  # of a compacting engine with pore air
MACHINE_INPUTS = (  # inputs of the machine and the motion
    "machine.roller_length", "machine.roller_friction", "machine.bearing_friction", "machine.guide_friction",
    "machine.mass", "motion.duration",
)  # fmt: skip
FORMULA_INPUTS = ("machine.roller_friction", "machine.bearing_friction")  # of eqs 1.8 and 1.9 only
CART_INPUTS = ("machine.guide_friction", "machine.mass", "motion.duration")  # on which no layer depends
DENSITY_INPUT = "layer.fed_density_ratio"
PEAKS = {"peak_force": "drive_force", "peak_power": "drive_power"}
PRIOR, SHARE, PRESSED = "spread of the prior", "a tenth less, more", "a tenth of what is pressed"

Range = tuple[float, float, str, str]  # low, high, kind of variation, unit


@dataclass(frozen=True)
class End:
    """Least peaks over all laws at one value of an input.

    Parameters
    ----------
    least : dict
        Least peak by quantity of PEAKS [N], [W].
    law : dict
        Law with the least peak by quantity.
    ties : dict
        Laws within the build tolerance of the least peak by quantity, that law among them.
    """

    least: dict[str, float]
    law: dict[str, str]
    ties: dict[str, frozenset[str]]


@dataclass(frozen=True)
class Shift:
    """Sensitivity to one input.

    Parameters
    ----------
    how : {PRIOR, SHARE, PRESSED}
        Kind of variation.
    base : End
        Result of the scene itself by the same engine.
    low, high : End or None
        Results at the ends; None where the engine has no solution.
    """

    name: str
    ends: tuple[float, float]
    unit: str
    how: str
    by: str
    base: End
    low: End | None
    high: End | None

    def changed_ends(self, by: str) -> list[End]:
        """Return the ends at which the first law of the scene by a quantity of PEAKS is not first."""
        return [end for end in (self.low, self.high) if end is not None and self.base.law[by] not in end.ties[by]]


def sensitivities(stages: Stages) -> list[Shift]:
    """Compute the sensitivity to each input of the mix and the machine that the engine or the formulas depend on."""
    variation = _Variation(stages)
    found = []
    for key, (low, high, how, unit) in _ranges(stages).items():
        if high > low:
            by = variation.engine_for(key)
            ends = (variation.reached(by, {key: float(value)}) for value in (low, high))
            found.append(Shift(key, (low, high), unit, how, by, variation.base(by), *ends))
    return found


def _ranges(stages: Stages) -> dict[str, Range]:
    """Return the range of each input by its scene key."""
    scene, mix, engine = stages.contacts.scene, stages.contacts.mix, stages.contacts.engine
    own_inputs = MIX_INPUTS.get(engine.name, engine.mix_parameters)  # the latter of an engine of another package
    names = list(own_inputs if engine.cheap else MIX_INPUTS["formula"])
    new_layer = engine.cheap and engine.compacting
    if scene.mix.law == "drucker-prager-cap":
        names = ["cohesion_loose" if name == "cohesion" else name for name in names]
    if new_layer and has_air(scene):
        names += AIR_INPUTS
    ranges = {f"mix.overrides.{name}": (*_spread(mix.parameter(name)), mix.parameter(name).unit) for name in names}
    if new_layer:
        before = scene.layer.fed_density_ratio
        step = VARIATION * (scene.mix.density_ratio - before)
        ranges[DENSITY_INPUT] = (before - step, before + step, PRESSED, INPUT[DENSITY_INPUT].unit)
    by_formula = not (engine.cheap and engine.layered)
    keys = [key for key in MACHINE_INPUTS if by_formula or key not in FORMULA_INPUTS]
    return ranges | {key: (*_tenth(attrgetter(key)(scene)), INPUT[key].unit) for key in keys}


def _spread(parameter: Parameter) -> tuple[float, float, str]:
    if parameter.low < parameter.high:
        return parameter.low, parameter.high, PRIOR
    return _tenth(parameter.value)


def _tenth(value: float) -> tuple[float, float, str]:
    return value * (1 - VARIATION), value * (1 + VARIATION), SHARE


class _Variation:
    """Results of scenes that differ in one input, by formula or by the engine of the study."""

    def __init__(self, stages: Stages) -> None:
        self.stages, self.scene, self.engine = stages, stages.contacts.scene, stages.contacts.engine
        self.bases: dict[str, End] = {}
        self.own_layer: tuple[float, ResistanceMap] | None = None

    @property
    def largest_speed(self) -> float:
        """Largest speed of new contacts [m/s]."""
        return SPEED_MARGIN * self.stages.resistance.largest_speed

    def engine_for(self, key: str) -> str:
        """Return the engine of the scene if it can vary an input, else "formula"."""
        if self.engine.cheap:
            return self.engine.name
        covered = self.largest_speed <= self.stages.resistance.map.speeds[-1]
        return self.engine.name if key in CART_INPUTS and (covered or key != "motion.duration") else "formula"

    def base(self, by: str) -> End:
        """Return the result of the scene itself."""
        if by not in self.bases:
            self.bases[by] = self.end(by, {})
        return self.bases[by]

    def reached(self, by: str, changes: dict[str, float]) -> End | None:
        """Return the result of a changed scene, None where the engine or the formulas have no solution."""
        try:
            return self.end(by, changes)
        except (ValueError, RuntimeError):
            return None

    def end(self, by: str, changes: dict[str, float]) -> End:
        """Return the result of a changed scene."""
        changed = build_stages(self.scene.with_engine(by).replaced(**changes))
        cycles = self._stretched_laws(changed) if "motion.duration" in changes else self.stages.laws.cycles
        if not ENGINES[by].layered:
            return _least_peaks(changed.resistance.cart, changed.resistance.resistance, cycles)
        load, resistance = self._layer(changed, changes)
        over = self.stages.resistance.over(changed.contacts.scene.motion.duration)
        contacts = changed.contacts if self.engine.cheap else over.contacts  # whose passes are not computed again
        cart = machine_models.cart(changed.contacts.scene, load, contacts.return_ratios[0])
        return _least_peaks(cart, resistance, cycles)

    def _stretched_laws(self, changed: Stages) -> dict[str, Cycle]:
        """Return the laws over the duration of a changed scene; optimal laws keep their shape."""
        motion = changed.contacts.scene.motion
        optimal = {
            name: replace(cycle.forward, duration=motion.duration).cycle(motion.dwell, motion.dwell)
            for name, cycle in self.stages.laws.optimal_cycles.items()
        }
        return changed.prescribed.cycles | optimal

    def _layer(self, changed: Stages, changes: dict[str, float]) -> tuple[float, ResistanceMap]:
        """Return load on a roller [N] and resistance by the engine, from new contacts if the layer changes."""
        if not self.engine.cheap:
            stage = self.stages.resistance.over(changed.contacts.scene.motion.duration)
            return stage.contacts.roller_load, stage.map
        if changes and not changes.keys() & set(CART_INPUTS):
            return _new_contacts(changed, self.largest_speed)
        if self.own_layer is None:
            self.own_layer = _new_contacts(self.stages, self.largest_speed)
        return self.own_layer


def _new_contacts(stages: Stages, largest_speed: float) -> tuple[float, ResistanceMap]:
    """Return load on a roller at the mean speed [N], and resistance over speed, from new contacts."""
    contacts, scene = stages.contacts, stages.contacts.scene
    speeds = [speed for speed in contact_speeds(scene) if speed < largest_speed] + [largest_speed]
    rolled = [roll_scene(scene, contacts.mix, speed, held=contacts.held) for speed in speeds]
    air = [contacts.air_forces(speed) or AirForces(0.0, 0.0, 0.0) for speed in speeds]
    length = scene.machine.roller_length
    loads = [each.load + more.load for each, more in zip(rolled, air, strict=True)]
    load = length * np.interp(np.log(scene.mean_speed), np.log(speeds), loads)
    resistances = [each.resistance + more.resistance for each, more in zip(rolled, air, strict=True)]
    forces = scene.machine.rollers * length * np.array(resistances)
    return float(load), ResistanceMap(np.array(speeds), forces, error=np.nan, return_ratio=contacts.return_ratios[1])


def _least_peaks(cart: Cart, resistance: ResistanceLaw, cycles: Mapping[str, Cycle]) -> End:
    """Return the least peaks over all laws with a rigid drive."""
    peaks: dict[str, dict[str, float]] = {peak: {} for peak in PEAKS}
    for name, cycle in cycles.items():
        run = drive.simulate(cart, drive.Rigid(), cycle, resistance)
        for peak, quantity in PEAKS.items():
            peaks[peak][name] = np.inf if run.impulses else float(np.abs(getattr(run, quantity)).max())
    least = {peak: min(found.values()) for peak, found in peaks.items()}
    law = {
        peak: list(found)[first_of(list(found.values()))] if np.isfinite(least[peak]) else ""
        for peak, found in peaks.items()
    }
    ties = {
        peak: frozenset(name for name, value in found.items() if value < least[peak] * (1 + BUILD_TOLERANCE))
        for peak, found in peaks.items()
    }
    return End(least, law, ties)
