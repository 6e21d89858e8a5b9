"""The start of a motor drive: from rest through as many turns of the shaft as it takes to reach its periodic regime.

    J w' = g T(g w) - sum over carts of H x'(phi),  phi' = w

The angle is the variable, turn by turn as in the periodic regime (`shaft`), on elements that are graded towards the
start, where w is the root of it. What stands is held by its friction: a motor too weak for carts that do not begin at a
dead centre does not start.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.motor import MotorRun, revolve
from compact.refuse import refuse_nonpositive
from compact.shaft import turning

NEAR = 1e-3  # relative distance from the periodic speed at the start of a turn, at which it is reached
MOST = 2000  # turns
FIRST = 1e-10  # of the first piece of a turn, over which the torque at rest acts
GRADE = 4.0  # times longer is each element after the start
LEAST = 1e-30  # of the square of the speed without load: rest
TOLERANCE = 1e-9  # of w^2, relative


@dataclass(frozen=True)
class RunUp:
    """A start; arrays of shape (n,): time [s], angle of the shaft from the start [rad], its speed [rad/s].

    turns : whole ones until the periodic regime, `periodic`, is reached
    motor_work, taken : of the motor on the shaft and by the carts [J];  residual : of their balance, over the former
    """

    time: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    turns: int
    motor_work: float
    taken: float
    residual: float
    periodic: MotorRun


def runup(cart, motor, motion, resistance, *, near=NEAR):
    """The `RunUp` of carts alike on a shaft that stands, until its speed is within `near` of the periodic one.

    cart, motor, motion, resistance : as of `motor.revolve`

    Raises RuntimeError where the motor does not start, stalls or slips its belt on its way, or takes more than 2000
    turns.
    """
    refuse_nonpositive(near=near)
    periodic = revolve(cart, motor, motion, resistance)
    wanted = periodic.speed[0]
    load, breaks = periodic.load, periodic.load.breaks()
    done, works = [tuple(np.array([value]) for value in _first(load))], np.zeros(2)
    for turn in range(MOST):
        for stretch in [breaks] if turn else _graded(done[0][1][0], breaks):
            turned = turning(load.residual, stretch, done[-1][2][-1], TOLERANCE, periodic=False)
            run = MotorRun(load, turned, periodic.working)
            run.refuse_slip()
            power = run.speed * np.array([run.motor_torque, run.shaft_torque])
            works = works + power @ run.weights
            done.append((done[-1][0][-1] + run.time, 2 * np.pi * turn + run.angle, run.speed))
        if abs(run.speed[-1] - wanted) <= near * wanted:
            break
    else:
        reached = f"{run.speed[-1]:g} of {wanted:g} rad/s after {MOST} turns"
        raise RuntimeError(f"the shaft turns at {reached}; give more torque or less flywheel")
    done.insert(0, (np.zeros(1),) * 3)
    time, angle, speed = (np.concatenate(column) for column in zip(*done, strict=True))
    gain = motor.inertia * speed[-1] ** 2 / 2
    residual = abs(works[0] - works[1] - gain) / works[0]
    return RunUp(time, angle, speed, turn + 1, *works.tolist(), float(residual), periodic)


def _graded(first, breaks):
    """Breaks of the first turn in stretches that are solved one by one, since the energy grows by decades."""
    edges = first * GRADE ** np.arange(math.floor(math.log(breaks[1] / first, GRADE)))
    return [*map(np.array, pairwise([*edges, breaks[1]])), breaks[1:]]


def _first(load):
    """(time, angle, speed) a moment after the start: w^2 = 2 w' phi under the torque at rest."""
    angle, rest = FIRST * load.breaks()[1], np.zeros((1, 1))
    place, least = np.full((1, 1), angle), np.full((1, 1), LEAST * load.motor.curve.no_load_speed**2)
    here, beyond = (load.residual(place, least, rest + step) for step in (0.0, 1.0))
    acceleration = float((-here / (beyond - here))[0, 0])
    if not acceleration > 0:
        raise RuntimeError(
            f"the motor does not start: it gives {load.motor.torque(0.0):g} N m on the shaft at rest, less than what "
            "holds the carts; give more torque or gear, or start at a dead centre"
        )
    speed = float(np.sqrt(2 * acceleration * angle))
    return speed / acceleration, angle, speed
