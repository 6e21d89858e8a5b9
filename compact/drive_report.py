"""What is said of drives with a life of their own: tables of ringing, of motors, of cylinders and throttles."""

import warnings

import numpy as np

from compact.drive import Demand, Rigid
from compact.pieces import EPSILON
from compact.results import write_csv


def tables(study, directory):
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
        rigid.nonuniformity, run.standing, run.energy_residual, run.work.arcs,
    )  # fmt: skip


MOTOR_HEADER = (
    "law", "period_s", "least_speed_rad/s", "largest_speed_rad/s", "fluctuation", "peak_motor_torque_Nm",
    "peak_motor_power_W", "work_of_a_cycle_J", "nonuniformity", "energy_residual",
)  # fmt: skip


def _motor_row(run):
    torque = float(np.abs(run.motor_torque).max()) / run.load.motor.gear_ratio
    work = float(np.sum(run.weights * run.motor_torque * run.speed))
    return (
        run.name, run.period, float(run.speed.min()), float(run.speed.max()), run.fluctuation, torque,
        run.peak_motor_power, work, run.nonuniformity, run.energy_residual,
    )  # fmt: skip


def _run_up(study, directory):
    """The start from rest under the best law; a motor that does not start says so."""
    from compact.runup import runup

    best = next((place.run for place in next(iter(study.rankings.values())) if hasattr(place.run, "load")), None)
    if best is None:
        return
    study.count("run-up")
    try:
        start = runup(best.load.cart, best.load.motor, best.load.cycle, best.load.resistance)
    except RuntimeError as error:
        warnings.warn(f"no start from rest under '{best.name}': {error}", stacklevel=2)
        return
    table = np.column_stack([start.time, start.angle, start.speed]).tolist()
    yield write_csv(directory / f"run-up-{best.name}.csv", ("time_s", "angle_rad", "speed_rad/s"), table)


def roller_motor(study, cycle, turned):
    """Torque [N m], power [W] and traction of the motor inside each roller, at the times of a `cam.Stepper`.

        T = H R/n,  traction = T/(R P): what friction of mix on steel must at least be

    H is the force of a rigid drive. That a torque takes T/R off the resistance holds at first order in the slope of the
    contact, within 3 % by the engine "fem"; creep is left out, a driven roller by that engine tells it.
    """
    demand = Demand(study.cart, Rigid(), cycle, study.resistance)
    force = np.zeros(turned.time.shape)  # a cart that dwells asks for none
    for leg in cycle.legs():
        phase = (turned.time - leg.start) / leg.duration
        moves = (phase >= 0) & (phase <= 1)
        force[moves] = demand.at(leg, np.clip(phase[moves], EPSILON, 1 - EPSILON)).forces.drive_force
    radius, rollers = study.scene.machine.roller_radius, study.scene.machine.rollers
    torque = force * radius / rollers
    return torque, torque * turned.angular_velocity, torque / radius / study.roller_load


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
        columns = (run.time, *run.state[:2], *vars(run.throttled).values())
        table = np.column_stack(columns).tolist()
        yield write_csv(directory / "throttles" / f"{run.name}.csv", THROTTLE_HEADER, table)
    best = next((place.run for place in next(iter(study.rankings.values())) if not place.run.lack), None)
    if best is not None:
        study.count("passage")
        made = best.forward()
        law = best.demand.cycle.there.position(made.time)
        columns = (made.time, made.position, made.velocity, law, made.inlet_pressure, made.outlet_pressure)
        yield write_csv(directory / f"passage-{best.name}.csv", PASSAGE_HEADER, np.column_stack(columns).tolist())


def _hydraulic_row(run):
    made = run.throttled
    return (
        run.name, run.lack, float(made.inlet_pressure.max()), float(made.outlet_pressure.max()), run.peak_flow,
        float(made.inlet_area.max()), float(made.outlet_area.min()), run.pump_work, run.energy, run.throttle_heat,
        run.relief_heat, run.energy_residual,
    )  # fmt: skip
