"""Machine of a scene as records: cart, motion laws, and the motors of a catalogue.

Without a file the motors are three-phase cage induction motors at 50 Hz by standard, without data of a maker. Rated
powers with their frame sizes are those of EN 50347, for totally enclosed motors with a fan, on feet; frames and powers
are of IEC 60072-1. A motor carries 1.6 times its rated torque for 15 s without stalling (IEC 60034-1, 9.4), its peak
torque here; most have more. The standards state neither slip nor inertia, which are estimates:

    slip = min(0.06 (P/1 kW)^-0.3, 0.1),    J = 0.0027 kg m2 (T/T0)^1.37

T/T0 is the torque over that of 1 kW at 1500 revolutions per minute. They are fitted by eye to common motors, the
inertia to a factor of about 1.6. A motor is to be checked with the data of its maker.
"""

import csv
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from compact.files import read_table
from compact.machine.cart import Cart, EndSprings
from compact.machine.component_sizing import CatalogueMotor
from compact.motion.profile import MotionProfile, law
from compact.motion.tabulated import from_table
from compact.scene.loader import Scene, SceneError

RPM = 2 * np.pi / 60  # [rad/s], one revolution per minute, the unit of speed in catalogues
CATALOGUE_COLUMNS = ("name", "rated_torque_Nm", "peak_torque_Nm", "speed_rpm", "inertia_kgm2")
SHAPE = {"stroke", "duration", "run_up", "run_down", "energy_weight", "acceleration_weight", "rod_length"}  # of laws

LINE_FREQUENCY = 50.0  # [Hz]
EXCESS_TORQUE = 1.6  # [-], over the rated torque, for 15 s
SLIP, SLIP_EXPONENT, LARGEST_SLIP = 0.06, -0.3, 0.10  # [-], estimate
INERTIA, INERTIA_EXPONENT, REFERENCE_POLES = 2.7e-3, 1.37, 4  # [kg m2], of 1 kW with these poles; estimate
POLES = (4, 6, 2, 8)  # in the order in which motors of one power are tried: 4 poles are the common ones

# frame; rated powers in kW with 2, 4, 6 and 8 poles
FRAMES = """
56M;.09 .12;.06 .09;;            63M;.18 .25;.12 .18;;           71M;.37 .55;.25 .37;;
80M;.75 1.1;.55 .75;.37 .55;     90S;1.5;1.1;.75;.37             90L;2.2;1.5;1.1;.55
100L;3;2.2 3;1.5;.75 1.1         112M;4;4;2.2;1.5                132S;5.5 7.5;5.5;3;2.2
132M;;7.5;4 5.5;3                160M;11 15;11;7.5;4 5.5         160L;18.5;15;11;7.5
180M;22;18.5;;                   180L;;22;15;11                  200L;30 37;30;18.5 22;15
225S;;37;;18.5                   225M;45;45;30;22                250M;55;55;37;30
280S;75;75;45;37                 280M;90;90;55;45                315S;110;110;75;55
315M;132;132;90;75
"""


def cart(scene: Scene, roller_load: float, return_load_ratio: float = 1.0) -> Cart:
    """Build the cart of a scene.

    Parameters
    ----------
    roller_load : float
        Load of each roller [N].
    return_load_ratio : float
        Load on the return stroke over that on the forward stroke [-].
    """
    machine, table = scene.machine, scene.drive.end_springs
    springs = None if table is None else EndSprings(**table.model_dump(), stroke=scene.motion.stroke)
    stated: dict[str, Any] = {
        each.name: getattr(machine, each.name) for each in fields(Cart) if hasattr(machine, each.name)
    }
    reactions = (roller_load,) * machine.rollers
    return Cart(roller_reactions=reactions, end_springs=springs, return_load_ratio=return_load_ratio, **stated)


def laws(scene: Scene) -> Iterator[MotionProfile]:
    """Build the motion laws that the scene names, tables of the user last."""
    shape = scene.motion.model_dump(include=SHAPE)
    yield from (law(name, **shape) for name in scene.law_names)
    yield from map(_tabulated_law, scene.table_paths)


def catalogue(scene: Scene) -> tuple[CatalogueMotor, ...]:
    """Read the motors of `[drive.catalogue]`, those by standard without a file; none without the table.

    Raises
    ------
    SceneError
        If the file is no catalogue; the message lists all mistakes.
    """
    path, motors, mistakes = scene.catalogue_path, dict[str, CatalogueMotor](), []
    if path is None:
        return () if scene.drive.catalogue is None else standard_motors()
    try:
        rows = read_table(path, CATALOGUE_COLUMNS)
    except ValueError as error:
        required = ", ".join(CATALOGUE_COLUMNS)
        raise SceneError([f"{error}; give a catalogue of motors with {required} and, if known, price"]) from None
    for number, row in rows:
        try:
            rated, peak, turns, inertia = (float(row[name]) for name in CATALOGUE_COLUMNS[1:])
            price = float(row["price"]) if row.get("price") else None
            motor = CatalogueMotor(row["name"], rated, peak, turns * RPM, inertia, price)
            if motors.setdefault(motor.name, motor) is not motor:
                mistakes.append(f"{path}:{number}: repeats the name {motor.name}; give each motor once")
        except ValueError as error:
            mistakes.append(f"{path}:{number}: {error}; give numbers in the units of the columns")
    if not rows:
        mistakes.append(f"{path}: has no motors; give one line each")
    if mistakes:
        raise SceneError(mistakes)
    return tuple(motors.values())


def standard_motors() -> tuple[CatalogueMotor, ...]:
    """Return the motors, with a name of power, poles and frame.

    Examples
    --------
    >>> motors = {motor.name: motor for motor in standard_motors()}
    >>> f"{motors['1.5 kW, 4 poles, frame 90L'].rated_torque:.1f} N m"
    '10.1 N m'
    """
    rows = [cell.strip().split(";") for line in FRAMES.split("\n") for cell in line.split("  ") if cell.strip()]
    found = []
    for poles, (frame, *powers) in product(POLES, rows):
        for power in map(float, powers[poles // 2 - 1].split()):  # [kW]
            slip = min(SLIP * power**SLIP_EXPONENT, LARGEST_SLIP)
            speed = 4 * np.pi * LINE_FREQUENCY / poles * (1 - slip)
            torque = 1e3 * power / speed
            inertia = INERTIA * (power * poles / REFERENCE_POLES) ** INERTIA_EXPONENT
            name = f"{power:g} kW, {poles} poles, frame {frame}"
            found.append(CatalogueMotor(name, torque, EXCESS_TORQUE * torque, speed, inertia))
    return tuple(found)


def _tabulated_law(path: str | Path) -> MotionProfile:
    """Read the law of a table of time [s] and position [m], with or without a header."""
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.reader(stream) if row and not row[0].lstrip().startswith("#")]
        with suppress(ValueError):  # a first row of words is a header
            float(rows[0][0])
            rows.insert(0, [])
        time, position = np.array([[float(cell) for cell in row[:2]] for row in rows[1:]]).T
        return from_table(time, position, name=Path(path).stem)
    except (OSError, ValueError, IndexError) as error:
        raise SceneError([f"{path}: not a table of time [s] and position [m] ({error}); give two columns"]) from None
