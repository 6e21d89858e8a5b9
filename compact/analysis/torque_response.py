"""How a torque drives the rollers of a scene: `roller_motors.DrivenRoller`, sampled from the engine of the scene.

At each speed the roller keeps the height of the scene's own contact while its motor turns harder or brakes, in equal
steps of `roller_motors.carter_parameter` so far as the laws ask. Mix that stays pressed is asked at one speed: it hardly knows of
any, and costs much.
"""

import warnings
from dataclasses import replace

import numpy as np

from compact.analysis.engines import COMPACTING, TOLERANCE, inputs, solver
from compact.machine.roller_motors import FULL_SLIP_SHARE, CreepFreeRoller, DrivenRoller, carter_parameter
from compact.scene.engine_capabilities import TURNED

STEP = 0.3  # of `carter_parameter`, at most: creep is straight in it on a half-plane, and nearly so on layers
ROOM = 1.15  # times the traction asked, so far samples reach: T/(R pull) is 1.03 by "fem", 0.87 by "compaction"
LEAST = 0.1  # share of friction, so far samples reach at least: near none they would tell their rounding


def driven(scene, mix, load, found, asked, near=(), count=lambda stage: None):
    """How a roller of the scene answers its motor: `DrivenRoller`, or `CreepFreeRoller` where the engine does not tell.

    load : of the mix on one roller [N];  found : numbers of the scene's contacts;  asked : least and largest pull [N]
    near : (speed, first `ContactResult`), from which "compaction" goes on;  count : called with the stage of each solution

    Where the engine does not converge a warning says so, and creep is left out.
    """
    radius, friction = scene.machine.roller_radius, mix.steel_friction
    plain = CreepFreeRoller(radius, load, friction)
    if scene.accuracy.engine not in TURNED or friction == 0:
        return plain
    least = scene.machine.roller_length * min(contact.load for contact in found)
    shares = [ROOM * pull / (friction * least) for pull in asked]
    sides = [_steps(min(shares[0], -LEAST) if shares[0] < 0 else 0.0), _steps(max(shares[1], LEAST))]
    if scene.accuracy.engine in COMPACTING:
        mean = scene.mean_speed
        found = [min(found, key=lambda contact: abs(np.log(contact.speed / mean)))]
    try:
        curves = [_curve(scene, mix, contact, sides, dict(near), count) for contact in found]
    except RuntimeError as error:
        warnings.warn(f"creep of the driven rollers is left out: {error}", stacklevel=2)
        return plain
    speeds = np.array([contact.speed for contact in found])
    return DrivenRoller(radius, friction, speeds, *np.moveaxis(np.array(curves), -1, 0))


def _steps(share):
    """Shares of friction from near 0 to one, but no more than is held, in equal steps of `carter_parameter`."""
    end = carter_parameter(np.clip(share, -FULL_SLIP_SHARE, FULL_SLIP_SHARE))
    w = np.linspace(0, end, int(np.ceil(abs(end) / STEP)) + 1)[1:]
    return np.sign(w) * (1 - (1 - np.abs(w)) ** 2)


def _curve(scene, mix, contact, sides, near, count):
    """Rows (torque, pull, creep, load) of one roller at the speed of a contact, torques rising."""
    speed, resistance = contact.speed, contact.resistance
    length, radius = scene.machine.roller_length, scene.machine.roller_radius
    rolled = _roller(scene, mix, speed, contact.indentation, count)

    def row(torque, at):
        return torque * length, (resistance - at.resistance) * length, at.creep, at.load * length

    free = rolled(0.0, near.get(speed))
    rows = [row(0.0, free)]
    for side in sides:
        before, last = free, free
        for share in side:
            load = 2 * last.load - before.load  # as it goes on; friction must hold the torque
            torque = share * mix.steel_friction * radius * load
            before, last = last, rolled(torque, last)
            rows.append(row(torque, last))
    return sorted(rows)


def _roller(scene, mix, speed, indentation, count):
    """rolled(torque per length [N], near): the driven roller of a scene at a speed and a height, by its engine."""
    engine = scene.accuracy.engine
    layer, roller, material = inputs(scene, mix, engine, scene.mean_speed)
    roller = replace(roller, rolling="driven", indentation=indentation, load=None, peak_pressure=None)
    roll = solver(engine)

    def rolled(torque, near):
        count("driven")
        if engine in COMPACTING:
            return roll(layer, roller, material, speed, torque=torque, start=near)
        asked = {TOLERANCE[engine]: scene.accuracy.tolerance, "estimate": False}
        return roll(layer, roller, material, speed, torque=torque, **asked)

    return rolled
