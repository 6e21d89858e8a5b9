"""Machine of a scene as records: cart, crank, motion laws, and the drive of each law."""

import csv
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.files import read_table
from compact.machine.cart import Cart, EndSprings
from compact.machine.component_sizing import CatalogueMotor
from compact.machine.crankshaft import CRANK_ANGLES
from compact.machine.hydraulic_drive import Hydraulic
from compact.machine.motor_drive import Motor
from compact.machine.rigid_drive import Crank, Rigid
from compact.machine.shaft import Belt, Kloss, LinearTorqueCurve
from compact.motion.profile import Cycle, MotionProfile, law
from compact.motion.tabulated import from_table
from compact.scene.loader import Scene, SceneError

if TYPE_CHECKING:
    from compact.machine.elastic_drive import ElasticDrive

RPM = 2 * np.pi / 60  # [rad/s], one revolution per minute, the unit of speed in catalogues
CATALOGUE_COLUMNS = ("name", "rated_torque_Nm", "peak_torque_Nm", "speed_rpm", "inertia_kgm2")
SHAPE = {"stroke", "duration", "run_up", "run_down", "energy_weight", "acceleration_weight", "rod_length"}  # of laws
SPRING = {"stiffness", "damping", "backlash", "include_added_mass"}  # fields of `ElasticDrive`


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


def crank(scene: Scene) -> Crank | None:
    """Build the crank of a scene, its radius half the stroke; None without a rod."""
    rod = scene.motion.rod_length
    return None if rod is None else Crank(scene.motion.stroke / 2, rod)


def angles(scene: Scene) -> tuple[float, ...]:
    """Return the crank angle of each cart relative to the first [rad]."""
    return scene.drive.angles or CRANK_ANGLES[scene.drive.carts]


def laws(scene: Scene) -> Iterator[MotionProfile]:
    """Build the motion laws that the scene names, tables of the user last."""
    shape = scene.motion.model_dump(include=SHAPE)
    yield from (law(name, **shape) for name in scene.law_names)
    yield from map(_tabulated_law, scene.table_paths)


def linkage(scene: Scene, cycle: Cycle) -> Rigid | Crank:
    """Return the link between shaft and cart: the rod for the law of a crank without dwells, else a cam."""
    rod = crank(scene)
    through_rod = cycle.forward.name == "crank" and scene.motion.dwell == 0 and scene.drive.kind in ("crank", "motor")
    return rod if through_rod and rod is not None else Rigid()


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


def drive_of(scene: Scene, cycle: Cycle) -> "Rigid | Crank | Hydraulic | Motor | ElasticDrive":
    """Build the drive of a law.

    The crank drives its own law through the rod, if the machine has one. A law with a velocity jump has a rigid drive
    in place of a motor: its force is impulsive.
    """
    table = scene.drive
    if table.kind == "elastic":
        from compact.machine.elastic_drive import ElasticDrive  # compiled code, imported when required

        return ElasticDrive(**table.model_dump(include=SPRING, exclude_none=True))
    if table.kind == "hydraulic":
        assert table.hydraulics is not None  # rule of the scene
        return Hydraulic(**table.hydraulics.model_dump())
    linked = linkage(scene, cycle)
    if table.kind != "motor" or any(join.order == 1 for join in cycle.discontinuities()):
        return linked
    motor = table.motor
    assert motor is not None  # rule of the scene
    curve: Kloss | LinearTorqueCurve = LinearTorqueCurve(motor.torque, motor.speed)
    if motor.curve == "kloss":
        assert motor.breakdown_slip is not None  # rule of the scene
        curve = Kloss(motor.torque, motor.breakdown_slip, motor.speed)
    belt = None if motor.belt is None else Belt(**motor.belt.model_dump())
    return Motor(curve, motor.gear_ratio, motor.inertia, motor.flywheel_inertia, angles(scene), linked, belt)


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
