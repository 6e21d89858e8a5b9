"""Acceleration phase of a motor drive: from rest to the periodic regime.

    J w' = g T(g w) - sum over carts of H x'(phi),   phi' = w

The revolutions are solved one by one over the shaft angle, as in the periodic regime (`motor_drive`). Near rest w is
the square root of the angle, and the elements are graded towards the start. At rest friction holds the carts: a motor
that is too weak for carts away from a dead centre does not start.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.machine.cart import Cart, Resistance
from compact.machine.motor_drive import Motor, MotorRun, ShaftLoad, simulate_motor
from compact.machine.shaft_speed import solve_shaft_speed
from compact.motion.profile import Cycle, MotionProfile
from compact.numerics import Array
from compact.numerics.validation import require_positive

PERIODIC_TOLERANCE = 1e-3  # [-], of the initial speed of the periodic regime; end of the acceleration phase
MAX_REVOLUTIONS = 2000  # [-]
FIRST_ANGLE = 1e-10  # [-], of the first piece of a revolution; the torque at rest acts over it
GRADING = 4.0  # [-], ratio of the lengths of successive elements after the start
REST_ENERGY = 1e-30  # [-], of the square of the no-load speed; stands for rest
ENERGY_TOLERANCE = 1e-9  # [-], of w^2


@dataclass(frozen=True)
class AccelerationPhase:
    """Acceleration phase of a motor drive; arrays of shape (n,).

    Parameters
    ----------
    time, angle, speed : ndarray
        Time [s] and angle of the shaft [rad] since the start, and its speed [rad/s].
    revolutions : int
        Whole revolutions up to the periodic regime.
    motor_work, load_work : float
        Work of the motor on the shaft and of the shaft on the carts [J].
    energy_residual : float
        Energy-balance residual over the work of the motor [-].
    """

    time: Array
    angle: Array
    speed: Array
    revolutions: int
    motor_work: float
    load_work: float
    energy_residual: float
    periodic: MotorRun


def simulate_acceleration_phase(
    cart: Cart,
    motor: Motor,
    motion: MotionProfile | Cycle,
    resistance: Resistance,
    *,
    tolerance: float = PERIODIC_TOLERANCE,
) -> AccelerationPhase:
    """Simulate the acceleration phase of identical carts on a shaft at rest.

    Parameters
    ----------
    cart, motor, motion, resistance
        As in `motor_drive.simulate_motor`.
    tolerance : float
        Relative difference from the initial speed of the periodic regime at the end [-].

    Raises
    ------
    RuntimeError
        If the motor does not start or stalls, the belt slips, or `MAX_REVOLUTIONS` do not suffice.
    """
    require_positive(tolerance=tolerance)
    periodic = simulate_motor(cart, motor, motion, resistance)
    target, load, breaks = periodic.speed[0], periodic.load, periodic.load.breaks()
    first = _first_instant(load)
    parts = [(np.zeros(1),) * 3, tuple(np.array([value]) for value in first)]
    works = np.zeros(2)
    for revolution in range(MAX_REVOLUTIONS):
        for section in [breaks] if revolution else _graded_sections(first[1], breaks):
            solution = solve_shaft_speed(load.residual, section, parts[-1][2][-1], ENERGY_TOLERANCE, periodic=False)
            run = MotorRun(load, solution, periodic.working)
            run.require_no_slip()
            works = works + run.speed * np.array([run.motor_torque, run.shaft_torque]) @ run.weights
            parts.append((parts[-1][0][-1] + run.time, 2 * np.pi * revolution + run.angle, run.speed))
        if abs(run.speed[-1] - target) <= tolerance * target:
            break
    else:
        raise RuntimeError(
            f"the shaft turns at {run.speed[-1]:g} of {target:g} rad/s after {MAX_REVOLUTIONS} revolutions; use more "
            "torque or a smaller flywheel"
        )
    time, angle, speed = (np.concatenate(column) for column in zip(*parts, strict=True))
    gain = motor.inertia * speed[-1] ** 2 / 2
    motor_work, load_work = works.tolist()
    residual = float(abs(motor_work - load_work - gain) / motor_work)
    return AccelerationPhase(time, angle, speed, revolution + 1, motor_work, load_work, residual, periodic)


def _graded_sections(first: float, breaks: Array) -> Iterator[Array]:
    """Split the breaks of the first revolution into sections, since the energy grows by decades."""
    edges = first * GRADING ** np.arange(math.floor(math.log(breaks[1] / first, GRADING)))
    yield from map(np.array, pairwise([*edges, breaks[1]]))
    yield breaks[1:]


def _first_instant(load: ShaftLoad) -> tuple[float, float, float]:
    """Time [s], angle [rad] and speed [rad/s] an instant after the start: w^2 = 2 w' phi under the torque at rest."""
    angle, rest = FIRST_ANGLE * load.breaks()[1], np.zeros((1, 1))
    place, energy = np.full((1, 1), angle), np.full((1, 1), REST_ENERGY * load.motor.curve.no_load_speed**2)
    static, unit = (load.residual(place, energy, rest + step) for step in (0.0, 1.0))
    acceleration = float((-static / (unit - static))[0, 0])
    if not acceleration > 0:
        torque = float(load.motor.torque(np.zeros(())))
        raise RuntimeError(
            f"the motor does not start: it delivers {torque:g} N m on the shaft at rest, less than friction holds; "
            "use more torque or a larger `gear_ratio`, or start at a dead centre"
        )
    speed = float(np.sqrt(2 * acceleration * angle))
    return speed / acceleration, angle, speed
