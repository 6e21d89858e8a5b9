"""Machine of a scene as records: cart, motion laws, and the motors of a catalogue."""

import csv
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields
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
    """Read the motors of `[drive.catalogue]`; none without the table.

    Raises
    ------
    SceneError
        If the file is no catalogue; the message lists all mistakes.
    """
    path, motors, mistakes = scene.catalogue_path, dict[str, CatalogueMotor](), []
    if path is None:
        return ()
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
