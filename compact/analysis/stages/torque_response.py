"""Response of the rollers of a scene to a torque: pull, creepage and load, sampled from the engine of the scene.

At each speed the roller keeps the height of the contact of the scene while its motor drives or brakes, in equal steps
of `roller_motors.carter_parameter` up to the largest pull of the laws. A compacting mix, which depends weakly on the
speed and is expensive, is sampled at one speed.
"""

import warnings
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from compact.analysis.contact_cases import case_of, nearest_speed
from compact.analysis.stages.contacts import ContactStage
from compact.machine.roller_motors import FULL_SLIP_SHARE, CreepFreeRoller, DrivenRoller, carter_parameter
from compact.rolling_contact import Contact

STEP = 0.3  # [-], largest step of `carter_parameter`; creepage is linear in it on a half-plane, and nearly so on layers
TRACTION_MARGIN = 1.15  # [-], sampled over required traction; T/(R pull) is 1.03 by "fem", 0.87 by "compaction"
LEAST_SHARE = 0.1  # [-], of friction, sampled at least; smaller samples are dominated by rounding errors

Row = tuple[float, float, float, float]  # torque [N m], pull [N], creepage [-], load [N]


def torque_response(contacts: ContactStage, pull_range: tuple[float, float]) -> DrivenRoller | CreepFreeRoller:
    """Sample the response of one roller to its motor.

    Parameters
    ----------
    pull_range : tuple of float
        Least and largest pull of one roller [N].

    Returns
    -------
    DrivenRoller or CreepFreeRoller
        `CreepFreeRoller`, without creepage, if the engine has no torque, the roller no friction, or the engine does not
        converge, the latter with a warning; also on compacting mix unless the scene has the output "roller_motors",
        because each driven contact takes seconds to minutes.
    """
    scene, records, friction = contacts.scene, contacts.records, contacts.mix.steel_friction
    radius = scene.machine.roller_radius
    without_creep = CreepFreeRoller(radius, contacts.roller_load, friction)
    expensive = contacts.compacts and "roller_motors" not in scene.output.items
    if not contacts.engine.reads("machine.roller_torque") or friction == 0 or expensive:
        return without_creep
    least_load = scene.machine.roller_length * min(record.load for record in records)
    low, high = (TRACTION_MARGIN * pull / (friction * least_load) for pull in pull_range)
    sides = [_friction_shares(min(low, -LEAST_SHARE) if low < 0 else 0.0), _friction_shares(max(high, LEAST_SHARE))]
    if contacts.compacts:
        records = [records[nearest_speed((record.speed for record in records), scene.mean_speed)]]
    try:
        curves = [_curve(contacts, record, sides) for record in records]
    except RuntimeError as error:
        warnings.warn(f"creep of the driven rollers is left out: {error}", stacklevel=2)
        return without_creep
    speeds = np.array([record.speed for record in records])
    return DrivenRoller(radius, friction, speeds, *np.moveaxis(np.array(curves), -1, 0))


def _friction_shares(share: float) -> NDArray[np.float64]:
    """Return shares of friction up to a share, limited to FULL_SLIP_SHARE, in equal steps of `carter_parameter`."""
    end = carter_parameter(np.clip(share, -FULL_SLIP_SHARE, FULL_SLIP_SHARE))
    w = np.linspace(0, end, int(np.ceil(abs(end) / STEP)) + 1)[1:]
    return np.sign(w) * (1 - (1 - np.abs(w)) ** 2)


def _curve(contacts: ContactStage, record: Contact, sides: list[NDArray[np.float64]]) -> list[Row]:
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
