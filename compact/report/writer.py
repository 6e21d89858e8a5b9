"""What `compact run` leaves behind: tables, figures and summary.json of a study; only what the scene wants."""

from dataclasses import astuple
from functools import cache
from pathlib import Path
from textwrap import wrap

import numpy as np

from compact.analysis.engineering_summary import coverage
from compact.analysis.study import YIELDING
from compact.analysis.worker_pool import Here
from compact.cams.profile import stepper
from compact.files import claimed_directory, render_png, write_bytes, write_columns, write_csv, write_figure, write_json
from compact.machine.ranking import CRITERIA
from compact.report import contact_tables, drive_tables, ranking_tables
from compact.report.contact_tables import guide_sentence, held_sentence, return_sentence
from compact.report.summary import study_summary, versions

CAM_POINTS = 721


def write_study(study, directory, force=False, crew=None):
    """Write the results of a study into a directory; returns the content of summary.json, which comes last.

    crew : of `pool`, that runs the engines beside meanwhile; without it this process does

    Raises ResultsError where a file cannot be written or another scene's results stand.
    """
    wanted = study.scene.output.items
    with claimed_directory(directory, study.scene.hash, force) as directory, study.helped(crew or Here()):
        files = list(contact_tables.write_contact_tables(study, directory)) if study.layered else []
        kept = list(study.keep(directory, files)) if study.layered else []
        for writer in [FIRST[part] for part in FIRST if part in wanted]:
            files += writer(study, directory)
        pictures = _pictures(study) if {"figures", "report"} & set(wanted) else {}
        for writer in [LAST[part] for part in LAST if part in wanted]:
            files += writer(study, directory, pictures)
        if study.layered:
            list(study.keep(directory, files))
        files += [*kept, *ranking_tables.keep(study, directory)]
        summary = study_summary(study, [str(Path(file).relative_to(directory)) for file in files])
        write_json(directory / "summary.json", summary)
    return summary


def _tables(study, directory, _):
    yield write_csv(directory / "engineering.csv", ("quantity", "value", "unit", "low", "high", "known_by"), [
        (name, n.value, n.unit, n.low, n.high, n.known_by) for name, n in study.numbers.items()
    ])  # fmt: skip
    yield write_csv(directory / "mix.csv", ("parameter", "value", "unit", "low", "high", "flag", "origin"), [
        (p.name, p.value, p.unit, p.low, p.high, p.flag, p.origin) for p in study.mix.parameters
    ])  # fmt: skip
    yield write_csv(directory / "laws.csv", LAW_HEADER, [_law_row(cycle) for cycle in study.cycles.values()])
    yield write_csv(directory / "joins.csv", ("law", "time_s", "quantity", "before_SI", "after_SI"), [
        (name, join.time, join.quantity, join.before, join.after)
        for name, cycle in study.cycles.items() for join in cycle.joins()
    ])  # fmt: skip
    for name, run in study.runs.items():
        yield write_columns(directory / "cycles" / f"{name}.csv", CYCLE_HEADER, _cycle_columns(run))
    yield from drive_tables.write_drive_tables(study, directory)
    yield from ranking_tables.write_ranking_tables(study, directory)


STEPPER_HEADER = (
    "time_s", "angle_rad", "angular_velocity_rad/s", "angular_acceleration_rad/s2", "angular_jerk_rad/s3",
)  # fmt: skip
LAW_HEADER = (
    "law", "peak_velocity_m/s", "peak_acceleration_m/s2", "peak_jerk_m/s3", "peak_snap_m/s4", "continuity",
    "J1_m2/s", "J2_m2/s3", "J3_m2/s5", "J4_m2/s7",
)  # fmt: skip
CYCLE_HEADER = (
    "time_s", "position_m", "velocity_m/s", "acceleration_m/s2", "jerk_m/s3", "resistance_N", "drive_force_N",
    "drive_power_W", "front_reaction_N", "rear_reaction_N",
)  # fmt: skip


def _law_row(cycle):
    peaks = cycle.there.peaks()
    turn = "dwell" if cycle.far_dwell > 0 else "reversal"
    criteria = [cycle.there.criterion(order, turn) for order in range(1, 5)]
    continuity = f"C{cycle.there.smoothness(turn)}"
    return (cycle.there.name, peaks.velocity, peaks.acceleration, peaks.jerk, peaks.snap, continuity, *criteria)


def _cycle_columns(run):
    return (
        run.time, *run.state[:5], run.drive_force, run.drive_power,
        run.state.forces.front_reaction, run.state.forces.rear_reaction,
    )  # fmt: skip


def _reactions(study, directory):
    header = ("law", "front_least_N", "front_largest_N", "rear_least_N", "rear_largest_N", "lifted_off_share")
    rows = []
    for name, run in study.runs.items():
        front, rear = run.state.forces.front_reaction, run.state.forces.rear_reaction
        lifted = float(np.sum(run.weights * ((front < 0) | (rear < 0))) / run.period)
        rows.append((name, *(float(v) for v in (front.min(), front.max(), rear.min(), rear.max())), lifted))
    yield write_csv(directory / "reactions.csv", header, rows)


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
    yield write_csv(directory / "cams.csv", header, rows)
    for law, cycle in study.cycles.items():
        turned = stepper(cycle, study.scene.machine.roller_radius, np.linspace(0, cycle.period, CAM_POINTS))
        header, columns = drive_tables.roller_motor(study.roller_motors[law], turned.time)
        path = directory / "cams" / f"{law}-stepper.csv"
        yield write_columns(path, STEPPER_HEADER + header, (*astuple(turned), *columns))
    yield from drive_tables.roller_motors(study, directory)


def write_cam(path, cam):
    """Write the profile of one cam as CSV."""
    table = cam.table(CAM_POINTS)
    return write_csv(path, table.header, table.rows())


def _crank(study, directory):
    header = ("carts", "mean_power_W", "peak_power_W", "peak_over_mean", "peak_torque_Nm")
    rows = []
    for key, turn in study.turns.items():
        mean, peak = turn.mean(turn.power), turn.peak_power
        rows.append((key, mean, peak, peak / mean, turn.peak_torque))
    yield write_csv(directory / "crank.csv", header, rows)
    turn = study.turns["scene"]
    names = [f"{name}_{i}" for i in range(1, len(turn.carts) + 1) for name in ("rod_force_N", "torque_Nm", "power_W")]
    columns = [column for cart in turn.carts for column in (cart.rod_force, cart.torque, cart.power)]
    table = np.column_stack([turn.angle, turn.torque, turn.power, *columns]).tolist()
    yield write_csv(directory / "crank-turn.csv", ("angle_rad", "torque_Nm", "power_W", *names), table)


def _fields(study, directory):
    from compact.engines.fem.fields import write_series

    standing = study.standing(directory, "fields.pvd", "fields/", "fields.png")
    yield from standing
    if not standing:
        from compact.report import figures

        yield from write_series(study.fields, directory)
        study.count("figures")
        yield write_figure(directory / "fields.png", figures.fields(study.fields))


def _pictures(study):
    """A function for each figure by its name, which draws it once as bytes of PNG."""
    from compact.report import figures, ranking_figures

    wanted, places, pictures = study.scene.output.items, study.places[study.scene.drive.kind], {}

    def draw(name, figure, *of):
        @cache
        def picture():
            study.count("figures")
            return render_png(figure(*of))

        pictures[name] = picture

    draw("kinematics", figures.kinematics, study.cycles)
    draw("drive", figures.drive, study.runs)
    if "reactions" in wanted:
        best = next(iter(study.rankings.values()))[0].run.name
        names = dict.fromkeys([best, *(name for name, run in study.runs.items() if run.state.rod_tangent.any())])
        draw("reactions", figures.reactions, study.runs, list(names))
    if "cams" in wanted:
        draw("cams", figures.cams, study.cams, list(study.cycles), "roller")
    if "crank" in wanted:
        draw("crank", figures.crank, study.turns)
    if study.layered:
        draw("contact", figures.speeds, study.contacts)
        draw("resistance", figures.resistance, study.resistance_map, _usual_acceleration(study))
        draw("resistances", ranking_figures.resistance, ranking_tables.resistances(study))
        draw("engines", ranking_figures.engines, ranking_tables.places(study))
    beside = {by: ranking_tables.beside(study, study.scene.drive.kind, by) for by in places}
    draw("ranking", ranking_figures.ranking, places, beside)
    return pictures


def _usual_acceleration(study):
    """Median of the peaks of all laws [m/s2]."""
    return float(np.median([cycle.there.peaks().acceleration for cycle in study.cycles.values()]))


def _page(study, directory, pictures):
    """The page; its pictures are those of the figures."""
    from compact.report import html as html_report

    study.count("report")
    pressure = contact_tables.pressure(study, directory)
    pictures = {"pressure": pressure.read_bytes, **pictures}
    if "fields" in study.scene.output.items:
        pictures["fields"] = (directory / "fields.png").read_bytes
    yield pressure
    yield html_report.write_page(directory / "report.html", study, pictures, versions())


def _figures(study, directory, pictures):
    for name, picture in pictures.items():
        yield write_bytes(directory / f"{name}.png", picture())


FIRST = {"reactions": _reactions, "cams": _cams, "crank": _crank, "fields": _fields}
LAST = {"tables": _tables, "report": _page, "figures": _figures}  # which wait for the engines beside, and for figures


def study_digest(study):
    """The answer of a study in a screen of text: the contact, then the laws by the first criterion."""
    numbers = study.numbers
    lines = [study.scene.title or "untitled scene", ""]
    lines += [_number_line(name, numbers[name]) for name in DIGEST]
    if short := coverage(study.scene, study.engineering):
        lines += [f"  {line}" for line in wrap(short, WIDTH)]
    facts = (held_sentence(study), return_sentence(study), guide_sentence(study))
    lines += ["", *(f"  {line}" for fact in facts for line in wrap(fact, WIDTH))]
    if not study.mix.density_achievable:
        lines.append(f"  {study.mix.density_achievable.reason}")
    replaced = [sentence for sentences in study.scene.replacements.values() for sentence in sentences]
    lines += [f"  {line}" for sentence in replaced for line in wrap(sentence, WIDTH)]
    engine = study.scene.accuracy.engine
    for kind, orders in study.places.items():
        for by, order in list(orders.items())[:TOLD]:
            beside = ranking_tables.beside(study, kind, by)
            lines += ["", f"laws by {CRITERIA[by].quantity.term} [{CRITERIA[by].unit}], {engine}, {kind} drive"]
            lines += [f"{'':>66}{''.join(f'{name:>18}' for name in beside)}".rstrip()] * bool(beside)
            runs = study.runs if kind == study.scene.drive.kind and kind in YIELDING else {}
            lines += [_place_line(place, runs.get(place.law), beside) for place in order]
    if study.laws_not_made:
        lines += ["", *(f"not made: {name}: {reason}" for name, reason in study.laws_not_made.items())]
    lines += ["", *ranking_tables.lines(study, list(study.rankings)[:TOLD])]
    return "\n".join(lines)


WIDTH = 116  # characters of a line of text
TOLD = 2  # criteria in the digest, those that the scene names first
DIGEST = ("capture_angle", "contact_length", "roller_force", "resistance_coefficient")


def _number_line(name, number):
    spread = "" if number.low is None else f"   {number.low:.4g} to {number.high:.4g} over the mix's spread"
    return f"  {name.replace('_', ' '):<24}{number.value:>10.4g} {number.unit:<4}{spread}"


def _place_line(place, run, beside):
    """A law's place, "tie" where the next is within the build tolerance, "?" where the error may move it, how its run
    rings, and in brackets the places by engines."""
    if place.reason:
        return f"  {place.rank:>2}  {place.law:<30}  infinite: {place.reason}"
    margin = f"+{place.margin:.2%} to the next" if np.isfinite(place.margin) else ""
    margin = "tie with the next" if place.tie else margin
    doubt = "" if place.sure in (True, None) or place.tie else " ?"
    others = [order.get(place.law) for order in beside.values()]
    ringing = getattr(run, "ringing", np.nan)
    ringing = f"rings {ringing:.3f}   " if np.isfinite(ringing) else ""
    told = "".join(f"{other.value:>13.1f} ({other.rank:>2})" if other else f"{'':>18}" for other in others)
    return f"  {place.rank:>2}  {place.law:<30}{place.value:>10.1f}   {ringing}{margin + doubt:<22}{told}".rstrip()


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
