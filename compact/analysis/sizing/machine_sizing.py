"""Motor, guide wheels and bearings of a scene: shaft torque of every law, choice of a motor, load cycles and lives.

The shaft turns uniformly, one revolution a cycle. The carts follow the law; behind the spring of an elastic drive its
driven end does. `[drive.catalogue]` has the motors and the rule by which one holds. Wheels and rollers carry the loads
of the first law under the drive of the scene:

    guide wheel   |N1| or |N2|, of its axle
    roller        sqrt(R^2 + (W/n)^2), lift and its share of the resistance

A guide wheel of diameter D and a roller of radius r turn by 2 s/(pi D) and s/(pi r) in a cycle of the stroke s.
"""

import math
from dataclasses import dataclass

import numpy as np

from compact.analysis.machine_models import catalogue
from compact.analysis.stages.drives import Stages
from compact.machine.component_sizing import (
    SECONDS_PER_HOUR,
    Bearing,
    BearingLife,
    LoadCycle,
    MotorChoice,
    ShaftRequirement,
    SizingRule,
    bearing_life,
    choose_motor,
    count_cycles,
    requirement_of_run,
    shaft_requirement,
)
from compact.machine.drives import angles_of
from compact.machine.shaft import CartsOnShaft


@dataclass(frozen=True)
class LawSizing:
    """Motor that a law requires.

    Parameters
    ----------
    requirement : ShaftRequirement or None
        Torque of the shaft; None for a law with a velocity jump.
    required_power : float
        Rated power with the margin [W]; infinite for such a law.
    choice : MotorChoice or None
        Motors of the catalogue; None without a catalogue or a requirement.
    """

    law: str
    requirement: ShaftRequirement | None
    required_power: float
    choice: MotorChoice | None


@dataclass(frozen=True)
class WheelLoads:
    """Loads of a guide wheel or of a roller over a cycle.

    Parameters
    ----------
    name : str
        Wheel and direction of the load.
    least, largest : float
        Extremes of the load [N].
    cycles : tuple of LoadCycle
        Load cycles in one cycle of the machine, largest range first.
    """

    name: str
    least: float
    largest: float
    cycles: tuple[LoadCycle, ...]


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
    """

    first_law: str
    rule: SizingRule
    laws: dict[str, LawSizing]
    wheels: tuple[WheelLoads, ...]
    lives: dict[str, BearingLife]
    period: float

    @property
    def first(self) -> LawSizing | None:
        """Motor required by the first law; None for a hydraulic drive."""
        return self.laws.get(self.first_law)

    def per_hour(self, count: float) -> float:
        """Convert a number of load cycles in a cycle of the machine to that in an hour [1/h]."""
        return count * SECONDS_PER_HOUR / self.period


def machine_sizing(stages: Stages, law: str | None = None) -> MachineSizing:
    """Size motor, guides and bearings of a scene.

    Parameters
    ----------
    law : str, optional
        Law whose loads are counted; the first law by the first criterion by default.

    Raises
    ------
    SceneError
        If the catalogue cannot be read.
    """
    scene, first_law = stages.drive.scene, law or stages.drive.best_law
    machine, run, table = scene.machine, stages.drive.runs[first_law], scene.drive.catalogue
    rule = SizingRule() if table is None else SizingRule(**table.model_dump(exclude={"file"}))
    laws = _law_sizings(stages, rule) if stages.drive.model.has_shaft else {}
    forces, cart, velocity, share = run.state.forces, run.cart, run.state.velocity, run.state.load_share
    loads = {
        "front guide wheel": forces.front_reaction,
        "rear guide wheel": forces.rear_reaction,
        "roller, lift": max(cart.roller_reactions) * share * np.where(velocity < 0, cart.return_load_ratio, 1.0),
        "roller, along the travel": run.state.resistance / len(cart.roller_reactions),
    }
    wheels = (WheelLoads(name, float(f.min()), float(f.max()), tuple(count_cycles(f))) for name, f in loads.items())
    radial = {name: loads[name] for name in ("front guide wheel", "rear guide wheel")}
    radial["roller"] = np.hypot(loads["roller, lift"], loads["roller, along the travel"])
    lives = {}
    for name, load in radial.items():
        bearing, radius = machine.guide_bearing, machine.guide_wheel_diameter / 2
        if name == "roller":
            bearing, radius = machine.roller_bearing, machine.roller_radius
        if bearing is not None:
            travelled = run.weights * np.abs(velocity)
            lives[name] = bearing_life(Bearing(**bearing.model_dump()), load, travelled, radius, run.period)
    return MachineSizing(first_law, rule, laws, tuple(wheels), lives, float(run.period))


def _law_sizings(stages: Stages, rule: SizingRule) -> dict[str, LawSizing]:
    """Compute the torque of the shaft under every law and choose its motor."""
    scene, cart, resistance = stages.drive.scene, stages.resistance.cart, stages.resistance.resistance
    model, motors, angles, found = stages.drive.model, catalogue(scene), angles_of(scene), {}
    for name, cycle in stages.drive.cycles.items():
        needed = None
        if model.driven_end:
            needed = requirement_of_run(stages.drive.runs[name], angles)
        elif not any(join.order == 1 for join in cycle.discontinuities()):
            needed = shaft_requirement(CartsOnShaft(cart, cycle, resistance, angles, model.linkage(scene, cycle)))
        power = math.inf if needed is None else rule.required_power(needed)
        choice = choose_motor(motors, needed, rule) if motors and needed else None
        found[name] = LawSizing(name, needed, power, choice)
    return found
