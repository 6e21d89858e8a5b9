"""What `compact run` leaves behind: tables, figures and summary.json of a study; only what the scene wants."""

import platform
from dataclasses import asdict, astuple
from importlib.metadata import version
from pathlib import Path

import numpy as np

from compact.cam import stepper
from compact.drive import CRITERIA
from compact.engine import COMPACTING, FIELDED, fields
from compact.results import claimed, whole_file, write_csv, write_json

SCHEMA = 1  # of summary.json; raised when a name in it changes its meaning
FIGURE_DPI = 110
CAM_POINTS = 721
VERSIONED = ("compact", "numpy", "scipy")


def write(study, directory, force=False):
    """Write the results of a study into a directory; returns the content of summary.json, which comes last.

    Raises ResultsError where a file cannot be written or another scene's results stand.
    """
    wanted = study.scene.output.wanted
    with claimed(directory, study.scene.hash, force) as directory:
        files = list(_rolled(study, directory)) if study.rolled else []
        for part, writer in WRITERS.items():
            if part in wanted:
                files += writer(study, directory)
        summary = _summary(study, [str(Path(file).relative_to(directory)) for file in files])
        write_json(directory / "summary.json", summary)
    return summary


CONTACT_HEADER = (
    "speed_m/s", "load_N/m", "resistance_N/m", "coefficient", "leading_m", "trailing_m", "peak_pressure_Pa",
    "load_error", "resistance_error", "work_residual", "iterations", "formula_load_N/m", "formula_coefficient",
    "exact_load_N/m",
)  # fmt: skip


def _rolled(study, directory):
    """The contact at each speed by the scene's engine; at the end of each row what the formulas and Galin say."""
    length = study.scene.machine.roller_length
    beside = (
        study.engineering.roller_force / length,
        study.engineering.resistance_coefficient,
        float(study.exact.load),
    )
    yield _csv(directory / "contact.csv", CONTACT_HEADER, [
        (
            speed, rolled.load, rolled.resistance, rolled.resistance / rolled.load, rolled.leading, rolled.trailing,
            rolled.peak_pressure, *(rolled.error or ("", "")), rolled.work_residual, len(rolled.history), *beside,
        )
        for speed, rolled in study.rolled
    ])  # fmt: skip
    study.resistance_map.save(directory / "resistance.nc", study.scene.hash)
    yield directory / "resistance.nc"
    if study.scene.accuracy.engine in COMPACTING:
        yield from _passes(study.passes, directory)


PASSES_HEADER = (
    "speed_m/s", "pass", "load_N/m", "resistance_N/m", "coefficient", "indentation_m", "exit_height_m",
    "exit_density_ratio", "load_error", "resistance_error", "work_residual", "mass_residual",
)  # fmt: skip


def _passes(passed, directory):
    """What each pass takes and leaves, and the density over the height behind it; even ones go back, so does speed."""
    from compact.passes import density

    rows = [
        (speed if number % 2 else -speed, number, rolled)
        for speed, passes in passed
        for number, rolled in enumerate(passes, start=1)
    ]
    yield _csv(directory / "passes.csv", PASSES_HEADER, [
        (
            speed, number, r.load, r.resistance, r.resistance / r.load, r.indentation, r.exit_height,
            r.exit_density_ratio, *(r.error or ("", "")), r.work_residual, r.mass_residual,
        )
        for speed, number, r in rows
    ])  # fmt: skip
    yield _csv(directory / "density.csv", ("speed_m/s", "pass", "bottom_m", "top_m", "density_ratio"), [
        (speed, number, *row) for speed, number, r in rows for row in density(r).tolist()
    ])  # fmt: skip


def write_contact(directory, study, speed, passes):
    """Write one contact, the first of its passes: pressure along it, its numbers, a picture beside Galin, its fields
    where it has any, and what all passes take and leave where they leave a mark."""
    from compact import figures

    rolled = passes[0]
    columns = np.column_stack([rolled.x, rolled.pressure, rolled.shear_traction]).tolist()
    _csv(directory / "pressure.csv", ("x_m", "pressure_Pa", "shear_traction_Pa"), columns)
    write_json(directory / "contact.json", contact_numbers(study, speed, passes))
    _drawn(directory / "pressure.png", figures.contact(rolled, study.exact, speed))
    if study.scene.accuracy.engine in COMPACTING:
        list(_passes([(speed, passes)], directory))
        _drawn(directory / "density.png", figures.density(passes))
    if study.scene.accuracy.engine in FIELDED:
        from compact.fields import write_series

        layers = [(fields(rolled, study.scene.accuracy.engine), rolled)]
        list(write_series(layers, directory))
        _drawn(directory / "fields.png", figures.fields(layers))


def contact_numbers(study, speed, passes):
    """Headline numbers of one contact: value and unit, with the engine's own relative error where it has one; where mix
    stays pressed, what all passes take and leave besides."""
    rolled = passes[0]
    load_error, resistance_error = rolled.error or (None, None)
    return (
        {
            "engine": study.scene.accuracy.engine,
            "speed": {"value": speed, "unit": "m/s"},
            "load": {"value": rolled.load, "unit": "N/m", "error": load_error},
            "resistance": {"value": rolled.resistance, "unit": "N/m", "error": resistance_error},
            "coefficient": {"value": rolled.resistance / rolled.load, "unit": "1"},
            "leading": {"value": rolled.leading, "unit": "m"},
            "trailing": {"value": rolled.trailing, "unit": "m"},
            "peak_pressure": {"value": rolled.peak_pressure, "unit": "Pa"},
            "indentation": {"value": getattr(rolled, "indentation", None), "unit": "m"},  # none on a half-plane
            "creep": {"value": getattr(rolled, "creep", None), "unit": "1"},  # of a roller that sticks and slips
            "work_residual": {"value": rolled.work_residual, "unit": "1"},
            "iterations": len(rolled.history),
        }
        | {
            name: {"value": getattr(rolled, name), "unit": unit}
            for name, unit in COMPACTED.items()
            if hasattr(rolled, name)
        }
        | ({"passes": [_pass_numbers(passed) for passed in passes]} if hasattr(rolled, "exit_height") else {})
    )


def _pass_numbers(passed):
    return {name: {"value": getattr(passed, name), "unit": unit} for name, unit in PASSED.items()}


PASSED = {
    "load": "N/m",
    "resistance": "N/m",
    "indentation": "m",
    "exit_height": "m",
    "exit_density_ratio": "1",
    "work_residual": "1",
    "mass_residual": "1",
}
COMPACTED = {  # what engines of a layer that stays pressed know besides
    "exit_density_ratio": "1",
    "exit_height": "m",
    "peak_density_ratio": "1",
    "mass_residual": "1",
    "yield_residual": "1",
    "equilibrium_residual": "1",
}


def contact_digest(study, speed, passes):
    """One contact in a few lines of text, the formulas and exact theory beside it, and its passes if they are many."""
    rolled = passes[0]
    formulas, exact, length = study.engineering, study.exact, study.scene.machine.roller_length
    rows = [
        ("load [N/m]", rolled.load, formulas.roller_force / length, exact.load),
        ("resistance/load", rolled.resistance / rolled.load, formulas.resistance_coefficient, np.nan),
        ("contact length [m]", rolled.leading - rolled.trailing, formulas.contact_length, exact.contact_length),
        (
            "leading edge [m]",
            rolled.leading,
            study.scene.machine.roller_radius * np.sin(formulas.capture_angle),
            exact.leading,
        ),
        ("peak pressure [Pa]", rolled.peak_pressure, formulas.pressure, exact.peak_pressure),
    ]
    lines = [
        f"{'at ' + format(speed, 'g') + ' m/s':<20}{study.scene.accuracy.engine:>12}{'eqs 1.5-1.8':>14}{'Galin':>12}"
    ]
    lines += [f"{name:<20}{ours:>12.5g}{formula:>14.5g}{galin:>12.5g}" for name, ours, formula, galin in rows]
    if rolled.error:
        lines.append(f"error of the load {rolled.error[0]:.1e}, of the resistance {rolled.error[1]:.1e}")
        if hasattr(rolled, "exit_density_ratio"):
            k, height = rolled.exit_density_ratio, rolled.exit_height
            lines.append(
                f"density ratio {k:.4f} behind the roller, {height * 1e3:.2f} mm high; mass closes to "
                f"{abs(rolled.mass_residual):.1e}"
            )
        lines.append(f"energy balance closes to {rolled.work_residual:.1e}; iterations: {len(rolled.history)}")
    if len(passes) > 1:
        lines += ["", "pass   load [N/m]   resistance [N/m]   height behind [mm]   density ratio"]
        lines += [_pass_line(number, passed) for number, passed in enumerate(passes, start=1)]
    return "\n".join(lines)


def _pass_line(number, passed):
    """A pass in a line; its resistance is against its travel, there or back."""
    against = passed.resistance if number % 2 else -passed.resistance
    return (
        f"{number:>4}{passed.load:>13.5g}{against:>19.4g}{passed.exit_height * 1e3:>21.2f}"
        f"{passed.exit_density_ratio:>16.4f}"
    )


def _tables(study, directory):
    yield _csv(directory / "engineering.csv", ("quantity", "value", "unit", "low", "high", "known_by"), [
        (name, n.value, n.unit, n.low, n.high, n.known_by) for name, n in study.numbers.items()
    ])  # fmt: skip
    yield _csv(directory / "mix.csv", ("parameter", "value", "unit", "low", "high", "flag", "origin"), [
        (p.name, p.value, p.unit, p.low, p.high, p.flag, p.origin) for p in study.mix.parameters
    ])  # fmt: skip
    yield _csv(directory / "laws.csv", LAW_HEADER, [_law_row(cycle) for cycle in study.cycles.values()])
    yield _csv(directory / "joins.csv", ("law", "time_s", "quantity", "before_SI", "after_SI"), [
        (name, join.time, join.quantity, join.before, join.after)
        for name, cycle in study.cycles.items() for join in cycle.joins()
    ])  # fmt: skip
    yield _csv(directory / "ranking.csv", RANKING_HEADER, [
        (engine, by, p.rank, p.run.name, p.value, CRITERIA[by].unit, p.margin, p.reason)
        for engine, rankings in _rankings(study).items() for by, places in rankings.items() for p in places
    ])  # fmt: skip
    for name, run in study.runs.items():
        yield _csv(directory / "cycles" / f"{name}.csv", CYCLE_HEADER, _cycle_rows(run))
    if study.scene.drive.kind == "elastic":
        yield _csv(directory / "ringing.csv", RINGING_HEADER, [_ringing_row(run) for run in study.runs.values()])
    if study.scene.drive.kind == "motor":
        turned = [run for run in study.runs.values() if hasattr(run, "motor_torque")]
        yield _csv(directory / "motor.csv", MOTOR_HEADER, [_motor_row(run) for run in turned])


def _rankings(study):
    """Rankings by engine, the scene's first."""
    beside = {"formula": study.formula_rankings} if study.rolled else {}
    return {study.scene.accuracy.engine: study.rankings} | beside


RANKING_HEADER = ("engine", "criterion", "rank", "law", "value", "unit", "margin", "reason")
STEPPER_HEADER = ("time_s", "angle_rad", "angular_velocity_rad/s", "angular_acceleration_rad/s2", "angular_jerk_rad/s3")
LAW_HEADER = (
    "law", "peak_velocity_m/s", "peak_acceleration_m/s2", "peak_jerk_m/s3", "peak_snap_m/s4", "continuity",
    "J1_m2/s", "J2_m2/s3", "J3_m2/s5", "J4_m2/s7",
)  # fmt: skip
CYCLE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "acceleration_m/s2", "jerk_m/s3", "resistance_N", "drive_force_N",
    "drive_power_W", "front_reaction_N", "rear_reaction_N",
)  # fmt: skip

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


def _law_row(cycle):
    peaks = cycle.there.peaks()
    turn = "dwell" if cycle.far_dwell > 0 else "reversal"
    criteria = [cycle.there.criterion(order, turn) for order in range(1, 5)]
    continuity = f"C{cycle.there.smoothness(turn)}"
    return (cycle.there.name, peaks.velocity, peaks.acceleration, peaks.jerk, peaks.snap, continuity, *criteria)


def _cycle_rows(run):
    columns = (
        run.time, *run.state[:5], run.drive_force, run.drive_power,
        run.state.forces.front_reaction, run.state.forces.rear_reaction,
    )  # fmt: skip
    return np.column_stack(columns).tolist()


def _reactions(study, directory):
    header = ("law", "front_least_N", "front_largest_N", "rear_least_N", "rear_largest_N", "lifted_off_share")
    rows = []
    for name, run in study.runs.items():
        front, rear = run.state.forces.front_reaction, run.state.forces.rear_reaction
        lifted = float(np.sum(run.weights * ((front < 0) | (rear < 0))) / run.period)
        rows.append((name, *(float(v) for v in (front.min(), front.max(), rear.min(), rear.max())), lifted))
    yield _csv(directory / "reactions.csv", header, rows)


def _cams(study, directory):
    header = (
        "law", "follower", "breadth_m", "least_breadth_m", "rule", "undercut", "least_radius_of_curvature_m",
        "largest_pressure_angle_rad", "largest_contact_offset_m", "breadth_error_m",
    )  # fmt: skip
    rows = []
    for (law, follower), cam in study.cams.items():
        study.count("cams measured")
        least = cam.least_breadth()
        rows.append((
            law, follower, cam.breadth, least.breadth, least.rule, cam.undercut, cam.least_radius_of_curvature,
            cam.largest_pressure_angle, cam.largest_contact_offset, cam.breadth_error,
        ))  # fmt: skip
        yield write_cam(directory / "cams" / f"{law}-{follower}.csv", cam)
    yield _csv(directory / "cams.csv", header, rows)
    for law, cycle in study.cycles.items():
        motor = stepper(cycle, study.scene.machine.roller_radius, np.linspace(0, cycle.period, CAM_POINTS))
        yield _csv(directory / "cams" / f"{law}-stepper.csv", STEPPER_HEADER, np.column_stack(astuple(motor)).tolist())


def write_cam(path, cam):
    """Write the profile of one cam as CSV."""
    table = cam.table(CAM_POINTS)
    return _csv(path, table.header, table.rows())


def _crank(study, directory):
    header = ("carts", "mean_power_W", "peak_power_W", "peak_over_mean", "peak_torque_Nm")
    rows = []
    for key, turn in study.turns.items():
        mean, peak = turn.mean(turn.power), turn.peak_power
        rows.append((key, mean, peak, peak / mean, turn.peak_torque))
    yield _csv(directory / "crank.csv", header, rows)
    turn = study.turns["scene"]
    names = [f"{name}_{i}" for i in range(1, len(turn.carts) + 1) for name in ("rod_force_N", "torque_Nm", "power_W")]
    columns = [column for cart in turn.carts for column in (cart.rod_force, cart.torque, cart.power)]
    table = np.column_stack([turn.angle, turn.torque, turn.power, *columns]).tolist()
    yield _csv(directory / "crank-turn.csv", ("angle_rad", "torque_Nm", "power_W", *names), table)


def _fields(study, directory):
    from compact.fields import write_series

    yield from write_series(study.fields, directory)


def _figures(study, directory):
    from compact import figures

    wanted = study.scene.output.wanted
    drawn = {
        "kinematics": lambda: figures.kinematics(study.runs),
        "drive": lambda: figures.drive(study.runs),
        "ranking": lambda: figures.ranking(study.rankings, study.formula_rankings),
    }
    if "reactions" in wanted:
        best = next(iter(study.rankings.values()))[0].run.name
        names = dict.fromkeys([best, *(name for name, run in study.runs.items() if run.state.rod_tangent.any())])
        drawn["reactions"] = lambda: figures.reactions(study.runs, list(names))
    if "cams" in wanted:
        drawn["cams"] = lambda: figures.cams(study.cams, list(study.cycles), "roller")
    if "crank" in wanted:
        drawn["crank"] = lambda: figures.crank(study.turns)
    if study.rolled:
        drawn["contact"] = lambda: figures.speeds(study.rolled)
        drawn["resistance"] = lambda: figures.resistance(study.resistance_map, study.formula_resistance)
    if "fields" in wanted:
        drawn["fields"] = lambda: figures.fields(study.fields)
    for name, draw in drawn.items():
        study.count("figures")
        yield _drawn(directory / f"{name}.png", draw())


WRITERS = {
    "tables": _tables, "reactions": _reactions, "cams": _cams, "crank": _crank, "fields": _fields, "figures": _figures,
}  # fmt: skip


def _drawn(path, figure):
    with whole_file(path, "wb") as stream:
        figure.savefig(stream, format="png", dpi=FIGURE_DPI)
    return path


def _csv(path, header, rows):
    write_csv(path, header, rows)
    return path


def _summary(study, files):
    scene = study.scene
    reach = study.mix.reachable
    return {
        "schema": SCHEMA,
        "title": scene.title,
        "scene_hash": scene.hash,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in VERSIONED},
        "engine": scene.accuracy.engine,
        "drive_resistance": _drive_resistance(study),
        "advice": list(scene.advice),
        "reachable": {"by_rolling": reach.possible, "reason": reach.reason},
        "numbers": {name: asdict(number) for name, number in study.numbers.items()},
        "contacts": [contact_numbers(study, *contact) for contact in study.passes],
        "laws": {name: _run_numbers(run) for name, run in study.runs.items()},
        "rankings": _places(study.rankings),
        "formula_rankings": _places(study.formula_rankings),
        "units": {name: criterion.unit for name, criterion in CRITERIA.items()} | OWN,
        "stages": dict(study.counts),
        "files": files,
    }


def _drive_resistance(study):
    """What the drives meet, and how sure that is."""
    if not study.rolled:
        return {"by": "eq 1.8"}
    met = study.resistance_map
    return {
        "by": study.scene.accuracy.engine,
        "speeds": met.speeds,
        "error_between_speeds": met.error,
        "error_of_the_engine": met.engine_error,
    }


def _places(rankings):
    return {by: [_place(place) for place in places] for by, places in rankings.items()}


def _place(place):
    names = {"rank": place.rank, "law": place.run.name, "value": place.value, "margin": place.margin}
    return names | ({"reason": place.reason} if place.reason else {})


def _run_numbers(run):
    own = [name for name in OWN if hasattr(run, name)]
    return {name: getattr(run, name) for name in (*CRITERIA, *own)}


OWN = {  # what runs of elastic and motor drives know besides
    "ringing": "1",
    "standing": "s",
    "fluctuation": "1",
    "peak_motor_power": "W",
    "energy_residual": "1",
}


def digest(study):
    """The answer of a study in a screen of text: the contact, then the laws by the first criterion."""
    numbers = study.numbers
    lines = [study.scene.title or "untitled scene", ""]
    lines += [_number_line(name, numbers[name]) for name in DIGEST]
    if not study.mix.reachable:
        lines.append(f"  {study.mix.reachable.reason}")
    for by, places in study.rankings.items():
        beside = {place.run.name: place for place in study.formula_rankings.get(by, ())}
        lines += ["", f"laws by {by.replace('_', ' ')} [{CRITERIA[by].unit}]" + ("; by formula" if beside else "")]
        lines += [_place_line(place, beside.get(place.run.name)) for place in places]
    return "\n".join(lines)


DIGEST = ("capture_angle", "contact_length", "roller_force", "resistance_coefficient", "cart_resistance", "cart_power")


def _number_line(name, number):
    spread = "" if number.low is None else f"   {number.low:.4g} to {number.high:.4g} over the mix's spread"
    return f"  {name.replace('_', ' '):<24}{number.value:>10.4g} {number.unit:<4}{spread}"


def _place_line(place, beside=None):
    """A law's place, and in brackets that by formula."""
    if place.reason:
        return f"  {place.rank:>2}  {place.run.name:<30}  infinite: {place.reason}"
    margin = f"+{place.margin:.2%} to the next" if np.isfinite(place.margin) else ""
    formula = f"{beside.value:>10.1f} ({beside.rank})" if beside else ""
    ringing = getattr(place.run, "ringing", np.nan)
    ringing = f"rings {ringing:.3f}   " if np.isfinite(ringing) else ""
    return f"  {place.rank:>2}  {place.run.name:<30}{place.value:>10.1f}   {ringing}{margin:<22}{formula}".rstrip()


def cam_digest(law, cam):
    """The sizes of one cam in a few lines of text."""
    least = cam.least_breadth()
    lines = [
        f"cam for {law}, {type(cam.follower).__name__}, breadth {cam.breadth:g} m{' UNDERCUT' * cam.undercut}",
        f"  least breadth                 {least.breadth:.6g} m: {least.rule}",
        f"  least radius of curvature     {cam.least_radius_of_curvature:.6g} m",
        f"  largest pressure angle        {np.degrees(cam.largest_pressure_angle):.2f} deg",
        f"  largest offset of the contact {cam.largest_contact_offset:.6g} m",
    ]
    return "\n".join(lines)
