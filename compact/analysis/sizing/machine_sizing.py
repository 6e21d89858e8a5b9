"""Motor, guide wheels and bearings of a scene: shaft torque of every law, choice of a motor, load cycles and lives.

The shaft turns uniformly, one revolution a cycle. The carts follow the law; behind the spring of an elastic drive its
driven end does. `[drive.catalogue]` has the motors and the rule by which one holds. Wheels and rollers carry the loads
of the first law under the drive of the scene:

    guide wheel   |N1| or |N2|, of its axle
    roller        sqrt(R^2 + (W/n)^2), lift and its share of the resistance

A guide wheel of diameter D and a roller of radius r turn by 2 s/(pi D) and s/(pi r) in a cycle of the stroke s.

Where a pass over fresh mix and the forming process are both valid for sizing, the drive runs with the resistance and
load of each. The motor of a law, a wheel and a bearing are those of the model that requires more of them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from compact.analysis.machine_models import cart, catalogue
from compact.analysis.stages.drives import Stages, simulate_laws
from compact.analysis.stages.verdict import Governing, ModelAnswer, larger
from compact.machine import component_sizing as sizing
from compact.machine.drives import angles_of
from compact.machine.shaft import CartsOnShaft


class LawSizing(NamedTuple):
    """Motor that a law requires.

    Parameters
    ----------
    requirement : ShaftRequirement or None
        Torque of the shaft; None for a law with a velocity jump.
    required_power : float
        Rated power with the margin [W]; infinite for such a law.
    choice : MotorChoice or None
        Motors of the catalogue; None without a catalogue or a requirement.
    engine : str
        Engine whose resistance requires it.
    """

    law: str
    requirement: sizing.ShaftRequirement | None
    required_power: float
    choice: sizing.MotorChoice | None
    engine: str


class WheelLoads(NamedTuple):
    """Loads of a guide wheel or of a roller over a cycle.

    Parameters
    ----------
    name : str
        Wheel and direction of the load.
    least, largest : float
        Extremes of the load [N].
    cycles : tuple of LoadCycle
        Load cycles in one cycle of the machine, largest range first.
    engine : str
        Engine whose load and resistance cause them.
    """

    name: str
    least: float
    largest: float
    cycles: tuple[sizing.LoadCycle, ...]
    engine: str


@dataclass(frozen=True)
class MachineSizing:
    """Motor, guides and bearings.

    Parameters
    ----------
    first_law : str
        Law whose motor is recommended and whose loads are counted.
    rule : SizingRule
        Rule by which a motor holds.
    laws : dict
        Motor required by each law; empty for a hydraulic drive, which has no shaft.
    wheels : tuple of WheelLoads
        Loads of guide wheels and rollers under the first law.
    lives : dict
        Life of the bearings by wheel; those with a rating in the scene.
    period : float
        Time of a cycle [s].
    compared : dict
        Requirement of the motor under "motor", and of bearings by wheel, by a pass over fresh mix and by the forming
        process; empty with one of them.
    """

    first_law: str
    rule: sizing.SizingRule
    laws: dict[str, LawSizing]
    wheels: tuple[WheelLoads, ...]
    lives: dict[str, sizing.BearingLife]
    period: float
    compared: dict[str, Governing] = field(default_factory=dict)

    @property
    def first(self) -> LawSizing | None:
        """Motor required by the first law; None for a hydraulic drive."""
        return self.laws.get(self.first_law)

    def per_hour(self, count: float) -> float:
        """Convert a number of load cycles in a cycle of the machine to that in an hour [1/h]."""
        return count * sizing.SECONDS_PER_HOUR / self.period


def machine_sizing(stages: Stages, law: str | None = None, models: Sequence[ModelAnswer] = ()) -> MachineSizing:
    """Size motor, guides and bearings of a scene.

    Parameters
    ----------
    law : str, optional
        Law whose loads are counted; the first law by the first criterion by default.
    models : sequence of ModelAnswer
        Models the larger of which sizes the machine; the engine of the scene alone by default.

    Raises
    ------
    SceneError
        If the catalogue cannot be read.
    """
    found = [_sized(stages, law or stages.drive.best_law, model) for model in models or (None,)]
    return found[0] if len(found) == 1 else _largest(dict(zip((each.engine for each in models), found, strict=True)))


def _sized(stages: Stages, law: str, model: ModelAnswer | None) -> MachineSizing:
    """Size motor, guides and bearings by the runs under the load and resistance of a model, of the scene by default."""
    scene, resistance, runs = stages.drive.scene, stages.resistance.resistance, stages.drive.runs
    engine, machine, table = scene.accuracy.engine, scene.machine, scene.drive.catalogue
    if model is not None and model.engine != engine:
        engine, resistance = model.engine, model.resistance
        loaded = cart(scene, model.roller_load, model.return_load_ratio)
        runs = dict(simulate_laws(scene, loaded, stages.drive.cycles, resistance))
    rule = sizing.SizingRule() if table is None else sizing.SizingRule(**table.model_dump(exclude={"file"}))
    run, kind, motors, angles = runs[law], stages.drive.model, catalogue(scene), angles_of(scene)
    laws, lives = {}, {}
    for name, cycle in stages.drive.cycles.items() if kind.has_shaft else ():
        needed = None
        if kind.driven_end:
            needed = sizing.requirement_of_run(runs[name], angles)
        elif not any(join.order == 1 for join in cycle.discontinuities()):
            needed = sizing.shaft_requirement(
                CartsOnShaft(run.cart, cycle, resistance, angles, kind.linkage(scene, cycle))
            )
        power = math.inf if needed is None else rule.required_power(needed)
        choice = sizing.choose_motor(motors, needed, rule) if motors and needed else None
        laws[name] = LawSizing(name, needed, power, choice, engine)
    forces, velocity, reactions = run.state.forces, run.state.velocity, run.cart.roller_reactions
    direction = np.where(velocity < 0, run.cart.return_load_ratio, 1.0)
    loads = {
        "front guide wheel": forces.front_reaction,
        "rear guide wheel": forces.rear_reaction,
        "roller, lift": max(reactions) * run.state.load_share * direction,
        "roller, along the travel": run.state.resistance / len(reactions),
    }
    wheels = [
        WheelLoads(name, float(f.min()), float(f.max()), tuple(sizing.count_cycles(f)), engine)
        for name, f in loads.items()
    ]
    radial, guide = np.hypot(loads["roller, lift"], loads["roller, along the travel"]), machine.guide_wheel_diameter / 2
    turning = {name: (loads[name], machine.guide_bearing, guide) for name in ("front guide wheel", "rear guide wheel")}
    turning["roller"] = radial, machine.roller_bearing, machine.roller_radius
    travelled = run.weights * np.abs(velocity)
    for name, (load, rated, radius) in turning.items():
        if rated is not None:
            bearing = sizing.Bearing(**rated.model_dump())
            lives[name] = sizing.bearing_life(bearing, load, travelled, radius, run.period)
    return MachineSizing(law, rule, laws, tuple(wheels), lives, float(run.period))


def _largest(found: Mapping[str, MachineSizing]) -> MachineSizing:
    """Return motors, wheels and bearings of the engine that requires more of each, and the requirements compared."""
    every, compared = [*found.values()], {}
    first, law = every[0], every[0].first_law
    laws = {name: max((each.laws[name] for each in every), key=lambda one: one.required_power) for name in first.laws}
    same = zip(*(each.wheels for each in every), strict=True)
    wheels = tuple(max(each, key=lambda one: max(abs(one.least), abs(one.largest))) for each in same)
    if laws:
        powers = {engine: each.laws[law].required_power for engine, each in found.items()}
        compared["motor"] = larger(f"rated power of a motor with {law}", "W", powers)
    for name in first.lives:
        loads = {engine: each.lives[name].equivalent_load for engine, each in found.items()}
        compared[name] = larger(f"load on a bearing of a {name}", "N", loads)
    lives = {name: found[compared[name].engine].lives[name] for name in first.lives}
    return replace(first, laws=laws, wheels=wheels, lives=lives, compared=compared)
