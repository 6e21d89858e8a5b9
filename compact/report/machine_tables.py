"""Files of the motion laws and the machine: laws, cycles, guide-wheel reactions, cams and crankshaft."""

from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from compact.analysis.study import Study
from compact.files import write_columns, write_csv
from compact.machine.roller_motors import roller_rotation
from compact.motion.profile import Cycle, EndCondition
from compact.report import drive_tables

CAM_POINTS = 721  # [-], rows of the table of a cam, each half degree
FORMULA_HEADER = ("quantity", "value", "unit", "low", "high", "known_by")
MIX_HEADER = ("parameter", "value", "unit", "low", "high", "flag", "origin")
JOIN_HEADER = ("law", "time_s", "quantity", "before_SI", "after_SI")
LAW_HEADER = (
    "law", "peak_velocity_m/s", "peak_acceleration_m/s2", "peak_jerk_m/s3", "peak_snap_m/s4", "continuity",
    "J1_m2/s", "J2_m2/s3", "J3_m2/s5", "J4_m2/s7",
)  # fmt: skip
CYCLE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "acceleration_m/s2", "jerk_m/s3", "resistance_N", "drive_force_N",
    "drive_power_W", "front_reaction_N", "rear_reaction_N",
)  # fmt: skip
REACTION_HEADER = ("law", "front_least_N", "front_largest_N", "rear_least_N", "rear_largest_N", "lifted_off_share")
CAM_HEADER = (
    "law", "follower", "breadth_m", "least_breadth_m", "rule", "undercut", "least_radius_of_curvature_m",
    "largest_pressure_angle_rad", "largest_contact_offset_m", "breadth_error_m",
)  # fmt: skip
STEPPER_HEADER = (
    "time_s", "angle_rad", "angular_velocity_rad/s", "angular_acceleration_rad/s2", "angular_jerk_rad/s3",
)  # fmt: skip
CRANK_HEADER = ("carts", "mean_power_W", "peak_power_W", "peak_over_mean", "peak_torque_Nm")


def write_law_tables(study: Study, directory: Path) -> Iterator[Path]:
    """Write formulas, mix, laws with their joins, and the cycle of every law."""
    formulas = [(name, n.value, n.unit, n.low, n.high, n.known_by) for name, n in study.stages.contacts.numbers.items()]
    yield write_csv(directory / "engineering.csv", FORMULA_HEADER, formulas)
    mix = [(p.name, p.value, p.unit, p.low, p.high, p.flag, p.origin) for p in study.mix.parameters]
    yield write_csv(directory / "mix.csv", MIX_HEADER, mix)
    yield write_csv(directory / "laws.csv", LAW_HEADER, [_law_row(cycle) for cycle in study.cycles.values()])
    yield write_csv(directory / "joins.csv", JOIN_HEADER, [
        (name, join.time, join.quantity, join.before, join.after)
        for name, cycle in study.cycles.items() for join in cycle.discontinuities()
    ])  # fmt: skip
    for name, run in study.runs.items():
        reactions = run.state.forces.front_reaction, run.state.forces.rear_reaction
        columns = (run.time, *run.state[:5], run.drive_force, run.drive_power, *reactions)
        yield write_columns(directory / "cycles" / f"{name}.csv", CYCLE_HEADER, columns)


def _law_row(cycle: Cycle) -> tuple[Any, ...]:
    forward, peaks = cycle.forward, cycle.forward.peaks()
    turn: EndCondition = "dwell" if cycle.far_dwell > 0 else "reversal"
    criteria = [forward.criterion(order, turn) for order in range(1, 5)]
    continuity = f"C{forward.smoothness(turn)}"
    return (forward.name, peaks.velocity, peaks.acceleration, peaks.jerk, peaks.snap, continuity, *criteria)


def write_reactions(study: Study, directory: Path) -> Iterator[Path]:
    """Write reactions.csv, the extremes of the guide-wheel reactions."""
    rows = []
    for name, run in study.runs.items():
        front, rear = run.state.forces.front_reaction, run.state.forces.rear_reaction
        lifted = float(np.sum(run.weights * ((front < 0) | (rear < 0))) / run.period)
        rows.append((name, *(float(v) for v in (front.min(), front.max(), rear.min(), rear.max())), lifted))
    yield write_csv(directory / "reactions.csv", REACTION_HEADER, rows)


def write_cams(study: Study, directory: Path) -> Iterator[Path]:
    """Write cams.csv, the profiles of all cams, the rotation of the rollers and the requirements on their motors."""
    rows = []
    for (law, follower), cam in study.stages.laws.cams.items():
        least = study.stages.laws.least_breadths[law, follower]
        rows.append((
            law, follower, cam.breadth, least.breadth, least.rule, cam.undercut, cam.least_radius_of_curvature,
            cam.largest_pressure_angle, cam.largest_contact_offset, cam.breadth_error,
        ))  # fmt: skip
        table = cam.table(CAM_POINTS)
        yield write_csv(directory / "cams" / f"{law}-{follower}.csv", table.header, table.rows())
    yield write_csv(directory / "cams.csv", CAM_HEADER, rows)
    for law, cycle in study.cycles.items():
        turned = roller_rotation(cycle, study.scene.machine.roller_radius, np.linspace(0, cycle.period, CAM_POINTS))
        header, columns = drive_tables.roller_motor_columns(study.stages.drive.roller_motors[law], turned.time)
        path = directory / "cams" / f"{law}-stepper.csv"
        yield write_columns(path, STEPPER_HEADER + header, (*astuple(turned), *columns))
    yield from drive_tables.write_roller_motors(study, directory)


def write_crank(study: Study, directory: Path) -> Iterator[Path]:
    """Write crank.csv for 1 to 4 carts, and crank-turn.csv, one turn of the shaft of the scene."""
    rows = []
    for key, turn in study.stages.drive.turns.items():
        mean, peak = turn.mean(turn.power), turn.peak_power
        rows.append((key, mean, peak, peak / mean, turn.peak_torque))
    yield write_csv(directory / "crank.csv", CRANK_HEADER, rows)
    turn = study.stages.drive.turns["scene"]
    names = [f"{name}_{i}" for i in range(1, len(turn.carts) + 1) for name in ("rod_force_N", "torque_Nm", "power_W")]
    columns = [column for cart in turn.carts for column in (cart.rod_force, cart.torque, cart.power)]
    columns = [turn.angle, turn.torque, turn.power, *columns]
    yield write_columns(directory / "crank-turn.csv", ("angle_rad", "torque_Nm", "power_W", *names), columns)
