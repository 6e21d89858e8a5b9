"""The machine of a scene as records: its cart, its crank, the laws it is to follow, and the drive that carries each.

Laws made for the machine of a scene: what its table [motion.optimise] asks for, as limits and laws.
"""

import csv
from pathlib import Path

import numpy as np

from compact.machine.cart import Cart, EndSprings
from compact.machine.crankshaft import CRANK_ANGLES
from compact.machine.hydraulic_drive import Hydraulic
from compact.machine.motor_characteristics import Belt, Kloss, LinearTorqueCurve
from compact.machine.motor_drive import Motor
from compact.machine.rigid_drive import Crank, Rigid
from compact.motion.profile import law
from compact.motion.tabulated import from_table
from compact.scene.loader import SceneError


def cart(scene, roller_load, return_load_ratio=1.0):
    """The `Cart` whose rollers are held at their height by a load [N] each, times a ratio on the return stroke."""
    machine, table = scene.machine, scene.drive.end_springs
    return Cart(
        mass=machine.mass,
        weight=machine.weight,
        roller_positions=machine.roller_positions,
        roller_reactions=(roller_load,) * machine.rollers,
        guide_positions=machine.guide_positions,
        pin_position=machine.pin_position,
        pin_height=machine.pin_height,
        roller_radius=machine.roller_radius,
        guide_wheel_diameter=machine.guide_wheel_diameter,
        guide_friction=machine.guide_friction,
        end_springs=table and EndSprings(table.stiffness, table.preload, table.length, scene.motion.stroke),
        return_load_ratio=return_load_ratio,
    )


def crank(scene):
    """The crank of the machine, its radius half the stroke; None where the scene gives no rod."""
    rod = scene.motion.rod_length
    return None if rod is None else Crank(scene.motion.stroke / 2, rod)


def angles(scene):
    """Crank angle of each cart ahead of the first [rad]."""
    return scene.drive.angles or CRANK_ANGLES[scene.drive.carts]


def laws(scene):
    """The laws that the scene names, tables of the user last; one after the other."""
    motion = scene.motion
    for name in scene.law_names:
        yield law(
            name, motion.stroke, motion.duration, motion.run_up, motion.run_down,
            motion.energy_weight, motion.acceleration_weight, motion.rod_length,
        )  # fmt: skip
    yield from map(_tabled, scene.table_paths)


def drive_of(scene, cycle):
    """The drive that carries a law; the law of the crank goes through its rod where the machine has one.

    A law whose velocity jumps stays with the rigid drive, which says that its force is infinite: no motor follows.
    """
    table, rod = scene.drive, crank(scene)
    if table.kind == "elastic":
        from compact.machine.elastic_drive import ElasticDrive  # compiled code, loaded for those who want it

        return ElasticDrive(table.stiffness, table.damping, table.backlash or 0.0, bool(table.include_added_mass))
    if table.kind == "hydraulic":
        return Hydraulic(**table.hydraulics.model_dump())
    through_rod = cycle.forward.name == "crank" and rod is not None and scene.motion.dwell == 0
    linked = rod if through_rod and table.kind in ("crank", "motor") else Rigid()
    if table.kind != "motor" or any(join.order == 1 for join in cycle.discontinuities()):
        return linked
    motor = table.motor
    curve = (
        Kloss(motor.torque, motor.breakdown_slip, motor.speed)
        if motor.curve == "kloss"
        else LinearTorqueCurve(motor.torque, motor.speed)
    )
    belt = motor.belt and Belt(**motor.belt.model_dump())
    return Motor(curve, motor.gear_ratio, motor.inertia, motor.flywheel_inertia, angles(scene), linked, belt)


def _tabled(path):
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.reader(stream) if row and not row[0].lstrip().startswith("#")]
        body = rows[1:] if rows and not _is_number(rows[0][0]) else rows
        time, position = np.array([[float(cell) for cell in row[:2]] for row in body]).T
        return from_table(time, position, name=path.stem)
    except (OSError, ValueError, IndexError) as error:
        raise SceneError([f"{path}: not a table of time [s] and travel [m]: {error}; give two columns"]) from None


def _is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True
