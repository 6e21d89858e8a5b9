"""Sections of the page on the machine: rankings, laws, forces, cams, sensitivity, scene and checks."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from compact.analysis.ranking_uncertainty import Place, ties
from compact.analysis.stages.cam_drawing import CamDrawing
from compact.analysis.stages.comparison import RankingAgreement
from compact.analysis.stages.laws import COMPLIANT_DRIVES, FOLLOWERS
from compact.analysis.stages.sensitivity import PRIOR, End, Shift
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA
from compact.machine.roller_motors import RollerMotor
from compact.motion.profile import EndCondition
from compact.report.page.answer import methods, term_of
from compact.report.page.blocks import Block, Cell, Mark, Paragraph, Picture, Section, Table, as_sentence, embed_figures
from compact.report.ranking_tables import comparison_places
from compact.report.tables import ZERO_SHARE, format_column, format_number, format_percent, format_quantity
from compact.report.text import heaping_sentences
from compact.scene.loader import Scene

ASSUMED_SIGNS = ("assumed", "guess", "changed by the caller")  # first words of a clause of a remark
KNOWN_SIGNS = ("published", "measured", "calibrated")
RANKING_FIGURES = {  # name -> (description, caption)
    "ranking": (
        "Bars of the ranked laws, a panel for each criterion, first law on top",
        "Bars: engine and drive of the scene, with the error from that of the resistance. Marks: other engines; their "
        "heights within a row only separate them.",
    ),
    "engines": (
        "Excess of each law over the first one, by every engine and drive",
        "Excess over the first law of each engine, with its error. Rows: the first laws by any engine; the heights "
        "within a row only separate the marks.",
    ),
}
FORCE_FIGURES = {
    "drive": (
        "Drive force and power of every law over a cycle",
        "Drive force and power of each law over a cycle. A peak beyond the scale is named in its panel.",
    ),
    "reactions": ("Reactions of the guide wheels over a cycle", "Below zero a wheel runs on the other rail."),
    "crank": ("Torque and power of the shaft over a turn for one to four carts", "Dashed: means over a turn."),
}
RUN_CRITERIA = (
    "peak_force", "rms_force", "peak_power", "rms_power", "mean_power", "energy", "drawn_energy", "dynamic_factor",
)  # fmt: skip
AGREEMENT_HEADER = (
    "criterion", "ranking by", "comparison with", "first law", "first law of the comparison", "discordant pairs",
    "discordant beyond the errors", "Kendall's tau",
)  # fmt: skip


def ranking_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Tabulate the rankings by each criterion and drive, and their agreement."""
    blocks: list[Block] = [*embed_figures(pictures, RANKING_FIGURES)]
    if study.agreements:
        blocks.append(_agreement_table(study.agreements))
    blocks += [Paragraph(as_sentence(sentence)) for sentence in heaping_sentences(study)]
    for kind, orders in study.stages.drive.places.items():
        blocks += [_ranking_table(kind, by, order, comparison_places(study, kind, by)) for by, order in orders.items()]
    lead = f"{len(study.cycles)} laws by {', '.join(term_of(by) for by in study.rankings)}."
    return Section("ranking", "Ranking", lead, blocks)


def _ranking_table(kind: str, by: str, order: list[Place], others: Mapping[str, Mapping[str, Place]]) -> Table:
    """Tabulate a ranking, with values and ranks by the engines of the comparison."""
    unit = CRITERIA[by].unit
    columns: dict[str, Sequence[Cell]] = {
        "rank": [str(place.rank) for place in order],
        "law": [place.law for place in order],
        term_of(by): format_column([place.value for place in order], unit),
        "margin": ["tie" if place.tie else format_percent(place.margin) for place in order],
    }
    if order[0].error is not None:
        columns["error"] = format_column([place.error for place in order], unit, 2)
        ranks, tied = Counter(place.rank for place in order), zip(order, ties(order, by), strict=True)
        columns["place"] = [_resolution(place, tie or ranks[place.rank] > 1) for place, tie in tied]
    for engine, compared in others.items():
        found = [compared.get(place.law) for place in order]
        values = format_column([other and other.value for other in found], unit)
        columns[f"by {engine}"] = [
            f"{value} ({other.rank})" if other else value for value, other in zip(values, found, strict=True)
        ]
    columns["note"] = [place.reason for place in order]
    return Table.from_columns(f"Laws by {term_of(by)}, {kind} drive, least first", columns, ("law", "place", "note"))


def _resolution(place: Place, tied: bool) -> str:
    """State whether a rank is a tie within the build tolerance, resolved beyond the errors, or not resolved."""
    if place.reason:
        return "–"
    return "tie" if tied else "resolved" if place.resolved else "not resolved"


def _agreement_table(agreements: Sequence[RankingAgreement]) -> Table:
    rows = [
        (
            term_of(a.by), f"{a.engine}, {a.drive}", f"{a.other_engine}, {a.other_drive}", a.first,
            a.other_first, f"{a.agreement.discordant_pairs} of {a.agreement.pairs}",
            str(a.agreement.resolved_discordant_pairs), format_number(a.agreement.tau, 3),
        )
        for a in agreements
    ]  # fmt: skip
    return Table("Agreement of the rankings", AGREEMENT_HEADER, rows, (5, 6, 7))


def laws_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Describe the motion laws: kinematics, peaks, continuity."""
    cycles, order = study.cycles.values(), ("velocity", "acceleration", "jerk", "snap")
    turn: EndCondition = "dwell" if study.scene.motion.dwell > 0 else "reversal"
    peaks = [cycle.forward.peaks() for cycle in cycles]
    jumps = [sorted({join.quantity for join in cycle.discontinuities()}, key=order.index) for cycle in cycles]
    columns = {
        "law": list(study.cycles),
        "peak velocity": format_column([peak.velocity for peak in peaks], "m/s"),
        "peak acceleration": format_column([peak.acceleration for peak in peaks], "m/s2"),
        "peak jerk": format_column([peak.jerk for peak in peaks], "m/s^3"),
        "continuity": [f"C{cycle.forward.smoothness(turn)}" for cycle in cycles],
        "discontinuities": [", ".join(names) or "none" for names in jumps],
    }
    caption = "Every law over the forward stroke. The return stroke mirrors it; that of a crank retraces it."
    if study.scene.drive.kind in COMPLIANT_DRIVES:
        caption += " The drive is compliant: the motion of the cart is in the files cycles/LAW.csv."
    description = "Velocity, acceleration and jerk of every law over the forward stroke, a row for each family of laws"
    title = "Exact peaks inside the pieces, and discontinuities at their joins"
    picture = Picture(pictures["kinematics"], description, caption)
    table = Table.from_columns(title, columns, ("law", "continuity", "discontinuities"))
    return Section("laws", "Motion laws", "Kinematics, exact peaks, discontinuities.", [picture, table])


def forces_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Tabulate forces, power and energy of every law."""
    runs = study.runs.values()
    columns = {"law": list(study.runs)}
    for by in RUN_CRITERIA:
        columns[term_of(by)] = format_column([getattr(run, by) for run in runs], CRITERIA[by].unit)
    columns[term_of("nonuniformity")] = [format_percent(run.nonuniformity) for run in runs]
    if study.scene.drive.kind == "elastic":
        columns[term_of("dynamic_amplification")] = format_column([run.dynamic_amplification for run in runs], "1")
    table = Table.from_columns(f"One cart, {study.scene.drive.kind} drive, over a cycle", columns)
    lead = "Of one cart over a cycle; guide wheels; shaft."
    return Section("forces", "Forces and power", lead, [*embed_figures(pictures, FORCE_FIGURES), table])


def cams_section(study: Study, pictures: Mapping[str, bytes], first_cam: CamDrawing) -> Section:
    """Describe the cams of all laws and the motors in the rollers."""
    rows = [_cam_row(study, law) for law in study.cycles]
    breadths = [f"least breadth, {follower}" for follower in FOLLOWERS]
    header = ("law", *breadths, "least radius, roller", "pressure angle, roller", "half-width, flat")
    profiles = Picture(
        pictures["cams"],
        "Profiles of the cams for roller followers, a panel for each law, undercut ones shaded",
        "Dashed: path of the centre of the roller follower. Shaded: undercut, so that the cam cannot be cut.",
    )
    breadth = next(iter(study.stages.laws.cams.values())).breadth
    caption = f"Cams with a breadth of {format_quantity(breadth, 'm')}; marked where it is too small"
    table = Table(caption, header, rows, range(1, len(header)))
    lead = f"{len(study.cycles)} laws for {len(FOLLOWERS)} followers; workshop drawing of one."
    blocks = [*_cam_blocks(first_cam), profiles, table, _roller_motor_table(study.stages.drive.roller_motors)]
    return Section("cams", "Cams", lead, blocks)


def _cam_blocks(cam: CamDrawing) -> list[Block]:
    """Show the cam of the first law and its animation; the reason where it cannot be cut."""
    if cam.reason:
        return [Paragraph(f"The cam of {cam.law}, the first law, cannot be cut: {cam.reason}.")]
    svg, caption = (
        "image/svg+xml",
        f"{cam.law}, true to scale in the file; `compact cam` writes it as CSV, SVG and DXF.",
    )
    turn, summary = "One turn is a whole cycle.", "Show the cam and the cart in motion"
    return [
        Picture(cam.drawing.encode(), cam.description, caption, svg),
        Picture(cam.animation.encode(), cam.animation_description, turn, svg, summary),
    ]


def _cam_row(study: Study, law: str) -> list[Cell]:
    """List least breadths for each follower, and the load on a roller and on a flat face."""
    breadths: list[Cell] = []
    for follower in FOLLOWERS:
        breadth = format_quantity(study.stages.laws.least_breadths[law, follower].breadth, "m")
        undercut = study.stages.laws.cams[law, follower].undercut
        breadths.append(Mark("bad", f"{breadth}: undercut") if undercut else breadth)
    roller, flat = study.stages.laws.cams[law, "roller"], study.stages.laws.cams[law, "flat"]
    angle = f"{np.degrees(roller.largest_pressure_angle):.1f}°"
    radius, width = format_quantity(roller.least_radius_of_curvature, "m"), flat.largest_contact_offset
    return [law, *breadths, radius, angle, format_quantity(width, "m")]


def _roller_motor_table(motors: Mapping[str, RollerMotor]) -> Table:
    """Tabulate the requirements of each law on motors in the rollers in place of a cam."""
    found = list(motors.values())
    columns = {
        "law": list(motors),
        "torque": format_column([motor.peak_torque for motor in found], "Nm"),
        "power": format_column([motor.peak_power for motor in found], "W"),
        "share of friction": [format_percent(motor.share) for motor in found],
    }
    if any(motor.roller.has_creep for motor in found):
        columns["creepage"] = [format_percent(motor.peak_creep) for motor in found]
    if any(motor.lack for motor in found):
        columns["limit"] = [motor.lack for motor in found]
    caption = "Drive without a cam: peaks of the motor in each roller, and the required share of the friction limit"
    return Table.from_columns(caption, columns, ("law", "limit"))


def sensitivity_section(shifts: Sequence[Shift]) -> Section:
    """Tabulate the sensitivities of the least peaks and of the first law."""
    peaks = list(shifts[0].base.least)
    rows = [
        (
            shift.name.split(".")[-1].replace("_", " "),
            " to ".join(format_quantity(end, shift.unit, 3) for end in shift.ends),
            Mark("assumed", shift.how) if shift.how == PRIOR else shift.how,
            shift.by,
            *(_peak_change(end, shift.base, peak) for peak in peaks for end in (shift.low, shift.high)),
            _other_first_laws(shift),
        )
        for shift in shifts
    ]
    ends = [f"{by.removeprefix('peak_')}, {end} end" for by in peaks for end in ("low", "high")]
    header = ("input", "ends", "range", "by", *ends, "first law")
    base = "; ".join(f"by {by}, {_least_peaks(base)}" for by, base in {each.by: each.base for each in shifts}.items())
    words = (
        f"Each input is moved to its low and its high end, with a rigid drive. {_method_remark(shifts)} The numbers "
        f"are the changes of the least peak over all laws from that of the scene: {base}."
    )
    lead = f"Change of the least peaks, one input at a time. {methods(shifts)}."
    table = Table("Sensitivity of the result", header, rows, (1, 4, 5, 6, 7))
    return Section("sensitivity", "Sensitivity", lead, [Paragraph(words), table])


def _method_remark(shifts: Sequence[Shift]) -> str:
    """State by what the ends were computed, and the limits of that."""
    by = {shift.by for shift in shifts}
    if by == {"formula"}:
        return "All ends are by formula, without an effect of the speed."
    if "formula" in by:
        own = "Inputs that do not change the layer are by the resistance map of the engine"
        return f"{own}; the others are by formula, as the engine is too expensive."
    return f"All ends are by the engine {by.pop()}, computed for each end at steady speed."


def _least_peaks(base: End) -> str:
    peaks = ((by, format_quantity(value, CRITERIA[by].unit)) for by, value in base.least.items())
    return ", ".join(f"{term_of(by)} {peak} ({base.law[by]})" for by, peak in peaks)


def _peak_change(end: End | None, base: End, peak: str) -> str:
    if end is None:
        return "out of range"
    change = end.least[peak] / base.least[peak] - 1
    return f"{'+' if change > ZERO_SHARE else ''}{format_percent(change)}"


def _other_first_laws(shift: Shift) -> str:
    """Name the laws that are first at an end and not first in the scene."""
    found = {end.law[by] for by in shift.base.law for end in shift.changed_ends(by)}
    return ", ".join(sorted(found)) or "the same"


def scene_section(scene: Scene) -> Section:
    """List every input of the scene with its meaning; assumed inputs are marked."""
    names = [name for name in type(scene).model_fields if name not in ("title", "unusual", "output")]
    tables = [_scene_table(scene, name) for name in names if getattr(scene, name) is not None]
    cells = (cell for table in tables for row in table.rows for cell in row)
    assumed = sum(isinstance(cell, Mark) and cell.kind == "assumed" for cell in cells)
    words = f"Read from {scene.file}, in SI units. Marked are inputs whose comments state an assumption or a change."
    return Section("scene", "Scene", f"Every input, {assumed} of them assumed.", [Paragraph(words), *tables])


def _scene_table(scene: Scene, name: str) -> Table:
    part = getattr(scene, name)
    rows = [
        (f"`{key}`", _input_value(getattr(part, key)), field.description or "", _remark(scene, name, key))
        for key, field in type(part).model_fields.items()
        if getattr(part, key) is not None
    ]
    return Table(f"[{name}]", ("key", "value", "meaning", "remark in the file"), rows)


def _input_value(value: Any) -> str:
    if hasattr(value, "model_dump"):
        given = value.model_dump(exclude_none=True)
        return ", ".join(f"{key} = {item}" for key, item in given.items()) or "none"
    if isinstance(value, tuple):
        return ", ".join(_input_value(item) for item in value)
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _remark(scene: Scene, table: str, key: str) -> Cell:
    """Mark the clause of a comment that states the origin of a value."""
    clauses = [clause.strip() for clause in scene.remark(table, key).split(";")]
    for kind, signs in (("assumed", ASSUMED_SIGNS), ("known", KNOWN_SIGNS)):
        for sign in signs:
            origin = next((clause for clause in clauses if clause.startswith(sign)), None)
            if origin is not None:
                rest = [origin.removeprefix(sign).strip(" :,"), *(clause for clause in clauses if clause != origin)]
                return Mark(kind, sign, "; ".join(filter(None, rest)))
    return "; ".join(clauses)
