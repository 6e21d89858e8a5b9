"""What is said of drives with a life of their own: tables of ringing, of motors, of cylinders and throttles."""

import warnings

import numpy as np

from compact.files import write_columns, write_csv
from compact.quantities import ROLLER_MOTOR, column_names


def write_drive_tables(study, directory):
    """The tables of the scene's kind of drive; yields their paths."""
    runs = study.runs.values()
    if study.scene.drive.kind == "elastic":
        yield write_csv(directory / "ringing.csv", RINGING_HEADER, [_ringing_row(run) for run in runs])
    if study.scene.drive.kind == "motor":
        turned = [run for run in runs if hasattr(run, "motor_torque")]
        yield write_csv(directory / "motor.csv", MOTOR_HEADER, [_motor_row(run) for run in turned])
        yield from _run_up(study, directory)
    if study.scene.drive.kind == "hydraulic":
        yield from _hydraulics(study, directory)


RINGING_HEADER = (
    "law", "peak_force_N", "rigid_peak_force_N", "ringing", "peak_power_W", "rigid_peak_power_W", "nonuniformity",
    "rigid_nonuniformity", "standing_s", "energy_residual", "arcs",
)  # fmt: skip


def _ringing_row(run):
    rigid = run.rigid
    return (
        run.name, run.peak_force, rigid.peak_force, run.ringing, run.peak_power, rigid.peak_power, run.nonuniformity,
        rigid.nonuniformity, run.stick_time, run.energy_residual, run.cost.intervals,
    )  # fmt: skip


MOTOR_HEADER = (
    "law", "period_s", "least_speed_rad/s", "largest_speed_rad/s", "fluctuation", "peak_motor_torque_Nm",
    "peak_motor_power_W", "work_of_a_cycle_J", "nonuniformity", "energy_residual", "belt_creep", "belt_loss_J",
)  # fmt: skip


def _motor_row(run):
    work = float(np.sum(run.weights * run.motor_power))
    return (
        run.name, run.period, run.least_speed, run.largest_speed, run.fluctuation, run.peak_motor_torque,
        run.peak_motor_power, work, run.nonuniformity, run.energy_residual, run.belt_creep, run.belt_loss,
    )  # fmt: skip


def _run_up(study, directory):
    """The start from rest under the best law; a motor that does not start says so."""
    from compact.machine.motor_acceleration import simulate_acceleration_phase

    best = next((place.run for place in next(iter(study.rankings.values())) if hasattr(place.run, "load")), None)
    if best is None:
        return
    study.count("run-up")
    try:
        start = simulate_acceleration_phase(best.load.cart, best.load.motor, best.load.cycle, best.load.resistance)
    except RuntimeError as error:
        warnings.warn(f"no start from rest under '{best.name}': {error}", stacklevel=2)
        return
    table = np.column_stack([start.time, start.angle, start.speed]).tolist()
    yield write_csv(directory / f"run-up-{best.name}.csv", ("time_s", "angle_rad", "speed_rad/s"), table)


TURN_HEADER = ("torque_Nm", "power_W", "traction")
CREEP_HEADER = ("creep", "angle_with_creep_rad", "angular_velocity_with_creep_rad/s")
MOTOR_NUMBERS = (*ROLLER_MOTOR, "lack")
DRIVEN_HEADER = ("speed_m/s", "torque_Nm", "pull_N", "creep", "load_N")


def roller_motor(motor, time):
    """Header and columns that a `RollerMotor` adds to the turn of a roller at times [s]; creep where it is told."""
    _, answer = motor.traction_over(time)
    columns = answer.torque, motor.power(time), answer.traction
    if not motor.roller.has_creep:
        return TURN_HEADER, columns
    return TURN_HEADER + CREEP_HEADER, (*columns, answer.creep, motor.angle(time), motor.angular_velocity(time))


def roller_motor_numbers(study):
    """What each law asks of the motors in the rollers, by its name and that of the number."""
    return {law: {name: getattr(motor, name) for name in MOTOR_NUMBERS} for law, motor in study.roller_motors.items()}


def roller_motors(study, directory):
    """Tables of what all laws ask of the motors in the rollers, and of how a roller answers; yields their paths."""
    header = ("law", *column_names(ROLLER_MOTOR), "lack")
    rows = [(law, *numbers.values()) for law, numbers in roller_motor_numbers(study).items()]
    yield write_csv(directory / "roller-motors.csv", header, rows)
    roller = next(iter(study.roller_motors.values())).roller
    if roller.has_creep:
        sampled = np.broadcast_arrays(roller.speeds[:, None], roller.torques, roller.pulls, roller.creeps, roller.loads)
        yield write_columns(directory / "driven-roller.csv", DRIVEN_HEADER, [column.ravel() for column in sampled])


HYDRAULIC_HEADER = (
    "law", "lack", "peak_inlet_pressure_Pa", "peak_outlet_pressure_Pa", "peak_flow_m3/s", "largest_inlet_area_m2",
    "least_outlet_area_m2", "pump_work_J", "work_on_the_cart_J", "throttle_heat_J", "relief_heat_J", "energy_residual",
)  # fmt: skip
THROTTLE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "flow_m3/s", "inlet_pressure_Pa", "outlet_pressure_Pa", "inlet_area_m2",
    "outlet_area_m2",
)  # fmt: skip
PASSAGE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "law_position_m", "inlet_pressure_Pa", "outlet_pressure_Pa",
)  # fmt: skip


def _hydraulics(study, directory):
    """Of all laws what throttles must do; of the best law that they can make, what oil that yields makes of it."""
    runs = study.runs.values()
    yield write_csv(directory / "hydraulic.csv", HYDRAULIC_HEADER, [_hydraulic_row(run) for run in runs])
    for run in runs:
        columns = (run.time, *run.state[:2], *vars(run.valve_flow).values())
        table = np.column_stack(columns).tolist()
        yield write_csv(directory / "throttles" / f"{run.name}.csv", THROTTLE_HEADER, table)
    best = next((place.run for place in next(iter(study.rankings.values())) if not place.run.lack), None)
    if best is not None:
        study.count("passage")
        made = best.simulate_stroke()
        law = best.inverse_dynamics.cycle.there.position(made.time)
        columns = (made.time, made.position, made.velocity, law, made.inlet_pressure, made.outlet_pressure)
        yield write_csv(directory / f"passage-{best.name}.csv", PASSAGE_HEADER, np.column_stack(columns).tolist())


def _hydraulic_row(run):
    made = run.valve_flow
    return (
        run.name, run.lack, float(made.inlet_pressure.max()), float(made.outlet_pressure.max()), run.peak_flow,
        float(made.inlet_area.max()), float(made.outlet_area.min()), run.pump_work, run.energy, run.throttle_heat,
        run.relief_heat, run.energy_residual,
    )  # fmt: skip
