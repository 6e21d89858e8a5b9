"""Files of the drives: dynamic amplification of elastic ones, motors, hydraulics, and motors in the rollers."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compact.analysis.study import Study
from compact.files import write_columns, write_csv
from compact.machine.roller_motors import RollerMotor
from compact.quantities import ROLLER_MOTOR, column_names

ELASTIC_HEADER = (
    "law", "peak_force_N", "rigid_peak_force_N", "dynamic_amplification", "peak_power_W", "rigid_peak_power_W",
    "nonuniformity", "rigid_nonuniformity", "stick_time_s", "energy_residual", "intervals",
)  # fmt: skip
MOTOR_HEADER = (
    "law", "period_s", "least_speed_rad/s", "largest_speed_rad/s", "fluctuation", "peak_motor_torque_Nm",
    "peak_motor_power_W", "work_of_a_cycle_J", "nonuniformity", "energy_residual", "belt_creep", "belt_loss_J",
)  # fmt: skip
HYDRAULIC_HEADER = (
    "law", "lack", "peak_inlet_pressure_Pa", "peak_outlet_pressure_Pa", "peak_flow_m3/s", "largest_inlet_area_m2",
    "least_outlet_area_m2", "pump_work_J", "work_on_the_cart_J", "throttle_heat_J", "relief_heat_J", "energy_residual",
)  # fmt: skip
THROTTLE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "flow_m3/s", "inlet_pressure_Pa", "outlet_pressure_Pa", "inlet_area_m2",
    "outlet_area_m2",
)  # fmt: skip
STROKE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "law_position_m", "inlet_pressure_Pa", "outlet_pressure_Pa",
)  # fmt: skip
ROLLER_MOTOR_FIELDS = (*ROLLER_MOTOR, "lack")
ROTATION_HEADER = ("torque_Nm", "power_W", "traction")
CREEPAGE_HEADER = ("creep", "angle_with_creep_rad", "angular_velocity_with_creep_rad/s")
DRIVEN_ROLLER_HEADER = ("speed_m/s", "torque_Nm", "pull_N", "creep", "load_N")


def write_drive_tables(study: Study, directory: Path) -> Iterator[Path]:
    """Write the tables of the kind of drive of the scene."""
    runs, kind = study.runs.values(), study.scene.drive.kind
    if kind == "elastic":
        yield write_csv(directory / "dynamic-amplification.csv", ELASTIC_HEADER, [_elastic_row(run) for run in runs])
    if kind == "motor":
        rows = [_motor_row(run) for run in runs if hasattr(run, "motor_torque")]
        yield write_csv(directory / "motor.csv", MOTOR_HEADER, rows)
        if study.stages.drive.motor_start is not None:
            law, start = study.stages.drive.motor_start
            header, columns = ("time_s", "angle_rad", "speed_rad/s"), (start.time, start.angle, start.speed)
            yield write_columns(directory / f"run-up-{law}.csv", header, columns)
    if kind == "hydraulic":
        yield from _write_hydraulics(study, directory)


def _elastic_row(run: Any) -> tuple[Any, ...]:
    rigid = run.rigid
    return (
        run.name, run.peak_force, rigid.peak_force, run.dynamic_amplification, run.peak_power, rigid.peak_power,
        run.nonuniformity, rigid.nonuniformity, run.stick_time, run.energy_residual, run.cost.intervals,
    )  # fmt: skip


def _motor_row(run: Any) -> tuple[Any, ...]:
    work = float(np.sum(run.weights * run.motor_power))
    return (
        run.name, run.period, run.least_speed, run.largest_speed, run.fluctuation, run.peak_motor_torque,
        run.peak_motor_power, work, run.nonuniformity, run.energy_residual, run.belt_creep, run.belt_loss,
    )  # fmt: skip


def roller_motor_columns(motor: RollerMotor, time: NDArray[np.float64]) -> tuple[tuple[str, ...], tuple[Any, ...]]:
    """Return the columns of a motor in a roller over a cycle.

    Parameters
    ----------
    time : ndarray
        Times [s], shape (n,).

    Returns
    -------
    tuple
        Names of the columns and the columns; with the creepage where the contact model has one.
    """
    _, state = motor.traction_over(time)
    columns = state.torque, motor.power(time), state.traction
    if not motor.roller.has_creep:
        return ROTATION_HEADER, columns
    return ROTATION_HEADER + CREEPAGE_HEADER, (*columns, state.creep, motor.angle(time), motor.angular_velocity(time))


def roller_motor_numbers(study: Study) -> dict[str, dict[str, Any]]:
    """Collect the requirements of each law on the motors in the rollers.

    Returns
    -------
    dict of str to dict
        Numbers by law and name, in the units of `quantities.ROLLER_MOTOR`.
    """
    motors = study.stages.drive.roller_motors.items()
    return {law: {name: getattr(motor, name) for name in ROLLER_MOTOR_FIELDS} for law, motor in motors}


def write_roller_motors(study: Study, directory: Path) -> Iterator[Path]:
    """Write roller-motors.csv and, where the contact model has a creepage, the response of a driven roller."""
    header = ("law", *column_names(ROLLER_MOTOR), "lack")
    rows = [(law, *numbers.values()) for law, numbers in roller_motor_numbers(study).items()]
    yield write_csv(directory / "roller-motors.csv", header, rows)
    roller: Any = next(iter(study.stages.drive.roller_motors.values())).roller
    if roller.has_creep:
        sampled = np.broadcast_arrays(roller.speeds[:, None], roller.torques, roller.pulls, roller.creeps, roller.loads)
        columns = [column.ravel() for column in sampled]
        yield write_columns(directory / "driven-roller.csv", DRIVEN_ROLLER_HEADER, columns)


def _write_hydraulics(study: Study, directory: Path) -> Iterator[Path]:
    """Write the throttle areas of all laws, and the stroke with compressible oil of the first feasible law."""
    runs = study.runs.values()
    yield write_csv(directory / "hydraulic.csv", HYDRAULIC_HEADER, [_hydraulic_row(run) for run in runs])
    for run in runs:
        columns = (run.time, *run.state[:2], *vars(run.valve_flow).values())
        yield write_columns(directory / "throttles" / f"{run.name}.csv", THROTTLE_HEADER, columns)
    if study.stages.drive.hydraulic_stroke is not None:
        run, stroke = study.stages.drive.hydraulic_stroke
        law = run.inverse_dynamics.cycle.forward.position(stroke.time)
        columns = (stroke.time, stroke.position, stroke.velocity, law, stroke.inlet_pressure, stroke.outlet_pressure)
        yield write_columns(directory / f"passage-{run.name}.csv", STROKE_HEADER, columns)


def _hydraulic_row(run: Any) -> tuple[Any, ...]:
    throttled = run.valve_flow
    return (
        run.name, run.lack, float(throttled.inlet_pressure.max()), float(throttled.outlet_pressure.max()),
        run.peak_flow, float(throttled.inlet_area.max()), float(throttled.outlet_area.min()), run.pump_work,
        run.energy, run.throttle_heat, run.relief_heat, run.energy_residual,
    )  # fmt: skip
