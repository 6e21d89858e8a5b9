"""Tables of a finished study, by the names of their files; the page and summary.json select from the same tables."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from compact.analysis.sizing import durations, machine_sizing
from compact.analysis.stages.resistance import sampled_shares
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.machine.roller_motors import roller_rotation
from compact.motion.profile import EndCondition
from compact.report import text
from compact.report.tables import Getter, TableSpec, json_number, json_values
from compact.scene.loader import Scene

CAM_POINTS = 721  # [-], rows of the table of a cam, each half degree
ROOT_SHARE = 1e-9  # [-], of the largest reaction; a smaller one is zero but for rounding
CONTACT = (
    "speed_m/s load_N/m resistance_N/m coefficient leading_m trailing_m peak_pressure_Pa load_error resistance_error "
    "work_residual iterations"
)
PASS = (
    "speed_m/s=0 pass=1 load_N/m=2.load resistance_N/m=2.resistance coefficient=3 indentation_m=2.indentation "
    "exit_height_m=2.exit_height exit_density_ratio=2.exit_density_ratio load_error=2.error.0 "
    "resistance_error=2.error.1 work_residual=2.work_residual mass_residual=2.mass_residual"
)
LAW = (
    "law=0.name peak_velocity_m/s=1.velocity peak_acceleration_m/s2=1.acceleration peak_jerk_m/s3=1.jerk "
    "peak_snap_m/s4=1.snap continuity=2 J1_m2/s=3 J2_m2/s3=4 J3_m2/s5=5 J4_m2/s7=6"
)
CYCLE = (
    "time_s position_m velocity_m/s acceleration_m/s2 jerk_m/s3 resistance_N drive_force_N drive_power_W "
    "front_reaction_N rear_reaction_N"
)
CAM = (
    "law=0 follower=1 breadth_m=2.breadth least_breadth_m=3.breadth rule=3.rule undercut=2.undercut "
    "least_radius_of_curvature_m=2.least_radius_of_curvature largest_pressure_angle_rad=2.largest_pressure_angle "
    "largest_contact_offset_m=2.largest_contact_offset breadth_error_m=2.breadth_error"
)
STEPPER = "time_s angle_rad angular_velocity_rad/s angular_acceleration_rad/s2 angular_jerk_rad/s3"
SHAFT = (
    "speed_rad/s=requirement.speed mean_torque_Nm=requirement.mean_torque rms_torque_Nm=requirement.rms_torque "
    "peak_torque_Nm=requirement.peak_torque driving_share=requirement.driving_share "
    "braking_share=requirement.braking_share largest_inertia_kgm2=requirement.largest_inertia required_power_W"
)
SIZING = (
    f"law {SHAFT} peak_braking_torque_Nm=requirement.peak_braking excess_energy_J=requirement.excess_energy "
    "motor=choice.chosen.motor.name engine"
)
WORK_BALANCE = (
    "pass_work_J/m3 confined_work_J/m3 work_ratio loose_work_J/m3 cycle_work_J pressed_volume_m3 carried_volume_m3 "
    "feed_ratio strokes_on_section throughput_work_J/m3 explained_share"
)
CATALOGUE = (
    "motor=motor.name price=motor.price rated_power_W=motor.rated_power gear_ratio rms_torque_Nm "
    "rated_torque_Nm=motor.rated_torque peak_torque_needed_Nm=peak_torque peak_torque_Nm=motor.peak_torque "
    "inertia_ratio fluctuation holds"
)
RANKING = "rank=0.rank law=2 value=0.value unit=1 margin=0.margin tie=0.tie"


def contact_table(study: Study) -> TableSpec:
    """Tabulate the contacts over the speed, with the formulas and the exact half-plane."""
    stage, length = study.stages.contacts, study.scene.machine.roller_length
    beside: dict[str, Getter] = {
        "formula_load_N/m": lambda _: stage.engineering.roller_force / length,
        "formula_coefficient": lambda _: stage.engineering.resistance_coefficient,
        "exact_load_N/m": lambda _: float(stage.exact.load),
    }
    return TableSpec.of("contact", study.stages.contacts.records, CONTACT, **beside)


def pass_tables(passes: Sequence[tuple[float, Sequence[Any]]]) -> Iterator[TableSpec]:
    """Tabulate forces and compaction of each pass, and the density over the height; even passes have negative speed."""
    from compact.analysis.contact_cases import density

    cases: list[tuple[Any, ...]] = [
        (speed if number % 2 else -speed, number, contact, contact.resistance / contact.load)
        for speed, contacts in passes for number, contact in enumerate(contacts, start=1)
    ]  # fmt: skip
    rows = [(speed, number, *row) for speed, number, contact, _ in cases for row in density(contact).tolist()]
    yield TableSpec.of("passes", cases, PASS)
    yield TableSpec.of("density", rows, "speed_m/s=0 pass=1 bottom_m=2 top_m=3 density_ratio=4")


def formula_table(study: Study) -> TableSpec:
    """Tabulate the formulas and the exact half-plane, with the range over the spread of the mix."""
    names = "quantity=0 value=1.value unit=1.unit low=1.low high=1.high known_by=1.known_by"
    return TableSpec.of("engineering", study.stages.contacts.numbers.items(), names)


def mix_table(study: Study) -> TableSpec:
    """Tabulate the parameters of the mix."""
    return TableSpec.of("mix", study.stages.contacts.mix.parameters, "parameter=name value unit low high flag origin")


def study_tables(study: Study) -> Iterator[TableSpec]:
    """Tabulate formulas, mix, laws, cycles, drive, rankings and sizing: the output item "tables"."""
    cycles, scene, stage = study.stages.laws.cycles, study.scene, study.stages.resistance
    turn: EndCondition = "dwell" if scene.motion.dwell > 0 else "reversal"
    laws = [
        (each.forward, each.forward.peaks(), f"C{each.forward.smoothness(turn)}", *map(each.criterion, range(1, 5)))
        for each in cycles.values()
    ]
    joins = [(name, join) for name, cycle in cycles.items() for join in cycle.discontinuities()]
    forces = {scene.accuracy.engine: stage.resistance}
    forces |= {name: other.resistance for name, other in study.comparison.items()}
    shares = [
        (engine, side, *row)
        for engine, force in forces.items()
        for side, *columns in sampled_shares(force, stage.cart, scene.motion)
        for row in zip(*columns, strict=True)
    ]
    yield from (formula_table(study), mix_table(study), TableSpec.of("laws", laws, LAW))
    yield TableSpec.of("joins", joins, "law=0 time_s=1.time quantity=1.quantity before_SI=1.before after_SI=1.after")
    yield TableSpec.of("resistance-along-stroke", shares, "engine=0 side=1 travel_m=2 force_share=3 load_share=4")
    for name, run in study.stages.drive.runs.items():
        forces = run.state.forces
        values = run.time, *run.state[:5], run.drive_force, run.drive_power, forces.front_reaction, forces.rear_reaction
        yield TableSpec.of_arrays(f"cycles/{name}", CYCLE, values)
    drive, model = study.stages.drive, study.stages.drive.model
    if model.table:
        title, names = model.table
        yield TableSpec.of(title, model.own_runs(list(drive.runs.values())), names, **model.computed)
    yield from (TableSpec.of_arrays(*table) for table in drive.tables())
    ranked = [
        (each, CRITERIA[by].unit, each.law, by, engine, moved_by)
        for engine, orders in study.places_by_engine.items() for moved_by, order in orders.items()
        for by, found in order.items() for each in found
    ]  # fmt: skip
    names = f"engine=4 drive=5 criterion=3 {RANKING} error=0.error resolved=0.resolved reason=0.reason"
    yield TableSpec.of("ranking", ranked, names)
    for name, other in study.comparison.items():
        if other.records:
            yield TableSpec.of(f"comparison/{name}/contact", other.records, CONTACT)
    yield from sizing_tables(study.machine_sizing)


def reaction_tables(study: Study) -> Iterator[TableSpec]:
    """Tabulate the extremes of the guide-wheel reactions."""
    rows = []
    for name, run in study.stages.drive.runs.items():
        front, rear = run.state.forces.front_reaction, run.state.forces.rear_reaction
        slight = -ROOT_SHARE * max(np.abs(front).max(), np.abs(rear).max())
        lifted = float(np.sum(run.weights * ((front < slight) | (rear < slight))) / run.period)
        rows.append((name, *(float(value) for each in (front, rear) for value in (each.min(), each.max())), lifted))
    names = "law=0 front_least_N=1 front_largest_N=2 rear_least_N=3 rear_largest_N=4 lifted_off_share=5"
    yield TableSpec.of("reactions", rows, names)


def cam_tables(study: Study) -> Iterator[TableSpec]:
    """Tabulate all cams, the rotation of the rollers, and the requirements on motors in them."""
    laws, motors = study.stages.laws, study.stages.drive.roller_motors
    for (law, follower), cam in laws.cams.items():
        points = cam.table(CAM_POINTS)
        yield TableSpec.of_arrays(f"cams/{law}-{follower}", " ".join(points), list(points.values()))
    yield TableSpec.of("cams", [(*key, cam, cam.least_breadth()) for key, cam in laws.cams.items()], CAM)
    for law, cycle in study.stages.laws.cycles.items():
        time = np.linspace(0, cycle.period, CAM_POINTS)
        turned = roller_rotation(cycle, study.scene.machine.roller_radius, time)
        motor, names = motors[law], f"{STEPPER} torque_Nm power_W traction"
        _, state = motor.traction_over(time)
        values = [time, *turned, state.torque, motor.power(time), state.traction]
        if motor.roller.has_creep:
            names += " creep angle_with_creep_rad angular_velocity_with_creep_rad/s"
            values += [state.creep, motor.angle(time), motor.angular_velocity(time)]
        yield TableSpec.of_arrays(f"cams/{law}-stepper", names, values)
    names = "law=0 peak_torque_Nm=1.peak_torque peak_power_W=1.peak_power peak_creep=1.peak_creep share=1.share"
    yield TableSpec.of("roller-motors", motors.items(), f"{names} lack=1.lack")
    roller: Any = next(iter(motors.values())).roller
    if roller.has_creep:
        sampled = np.broadcast_arrays(roller.speeds[:, None], roller.torques, roller.pulls, roller.creeps, roller.loads)
        names = "speed_m/s torque_Nm pull_N creep load_N"
        yield TableSpec.of_arrays("driven-roller", names, [column.ravel() for column in sampled])


def crank_tables(study: Study) -> Iterator[TableSpec]:
    """Tabulate the shaft with 1 to 4 carts, and one turn of the shaft of the scene."""
    turns = study.stages.drive.turns
    means = {key: turn.mean(turn.power) for key, turn in turns.items()}
    rows = [(key, mean, turns[key], turns[key].peak_power / mean) for key, mean in means.items()]
    names = "carts=0 mean_power_W=1 peak_power_W=2.peak_power peak_over_mean=3 peak_torque_Nm=2.peak_torque"
    yield TableSpec.of("crank", rows, names)
    turn, names = turns["scene"], "angle_rad torque_Nm power_W"
    values = [turn.angle, turn.torque, turn.power]
    for number, cart in enumerate(turn.carts, start=1):
        names += f" rod_force_N_{number} torque_Nm_{number} power_W_{number}"
        values += [cart.rod_force, cart.drive_power / turn.speed, cart.drive_power]
    yield TableSpec.of_arrays("crank-turn", names, values)


def sizing_tables(sizing: machine_sizing.MachineSizing) -> Iterator[TableSpec]:
    """Tabulate shaft and motor of every law, the catalogue, and loads of wheels, as far as they exist."""
    if sizing.laws:
        yield TableSpec.of("motor-sizing", sizing.laws.values(), SIZING)
    first = sizing.first
    if first is not None and first.choice is not None:
        reason = {"reason": lambda fit: "; ".join(fit.failures)}
        yield TableSpec.of("motor-catalogue", first.choice.fits, CATALOGUE, **reason)
    cycles = [(wheel, each, sizing.per_hour(each.count)) for wheel in sizing.wheels for each in wheel.cycles]
    names = "load=0.name range_N=1.range mean_N=1.mean count_per_cycle=1.count count_per_hour=2 engine=0.engine"
    yield TableSpec.of("wheel-loads", cycles, names)


def duration_tables(found: durations.DurationStudy) -> Iterator[TableSpec]:
    """Tabulate the laws at every duration, and the durations at which the first law changes."""
    ranked = [
        (each, CRITERIA[by].unit, each.run.name, by, duration)
        for by, orders in found.orders.items()
        for duration, order in zip(found.durations, orders, strict=True)
        for each in order
    ]
    yield TableSpec.of("duration", ranked, f"duration_s=4 criterion=3 {RANKING} reason=0.reason")
    unit = {"unit": lambda each: CRITERIA[each.by].unit}
    yield TableSpec.of("duration-crossovers", found.crossovers, "criterion=by duration_s shorter longer value", **unit)


ITEMS: Mapping[str, Callable[[Study], Iterator[TableSpec]]] = {  # files by the output items of a scene
    "reactions": reaction_tables, "cams": cam_tables, "crank": crank_tables, "tables": study_tables,
}  # fmt: skip


def write_tables(place: Path, tables: Iterable[TableSpec]) -> list[Path]:
    """Write tables into a directory as CSV."""
    return [table.write(place / f"{table.title}.csv") for table in tables]


# what `compact explain` reads


def decision_numbers(study: Study) -> dict[str, Any] | None:
    """Convert the decision; None where no law has finite peaks."""
    found, duration = study.decision, study.scene.motion.duration
    if found is None:
        return None
    sizes, other = (
        {key: json_values(each, "value unit low high margin shares") for key, each in table.items()}
        for table in (found.sizes, found.other_sizes)
    )
    forces = {each.engine: json_number(each.mean_resistance[duration], "N") for each in study.models}
    priors = {each.engine: json_number(each.prior[1], "N") for each in study.models if each.prior}
    return {
        **json_values(found, "law alternative engine invalid motor cam candidates excess"),
        "sizes": sizes, "alternative_sizes": other, "above_first_law": found.regrets,
        "drive": {by: {"ends_with_another_first": count, "ends": number, "excess": excess}
                  for by, (count, number, excess) in found.drive.items()},
        "fitted": text.fitted_inputs(study), "fitted_resistance": forces, "prior_resistance": priors,
        "not_for_sizing": {each.engine: each.invalid for each in study.models if each.invalid},
        "measurements": found.measurements,
    }  # fmt: skip


def input_numbers(scene: Scene) -> dict[str, dict[str, Any]]:
    """Convert the inputs of the scene by table and key, each with the comment on its origin."""
    tables = {name: table for name in type(scene).model_fields if hasattr(table := getattr(scene, name), "model_dump")}
    tables["mix.overrides"] = scene.mix.overrides
    return {
        name: {
            key: {"value": value, "origin": scene.remark(f"{name}.{key}")}
            for key, value in table.model_dump(mode="json", exclude_none=True).items()
            if not isinstance(value, dict)
        }
        for name, table in tables.items()
    }
