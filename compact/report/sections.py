"""Sections of the page, `report.html`, and their blocks: paragraphs, tables and pictures."""

import re
from base64 import b64encode
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from compact.analysis.engineering_summary import coverage
from compact.analysis.ranking_uncertainty import Place, ties
from compact.analysis.sizing.durations import DurationStudy
from compact.analysis.sizing.machine_sizing import MachineSizing
from compact.analysis.stages.balance_checks import BalanceCheck
from compact.analysis.stages.laws import COMPLIANT_DRIVES, FOLLOWERS, CamDrawing
from compact.analysis.stages.sensitivity import PRIOR, Shift
from compact.analysis.study import Study
from compact.machine.component_sizing import MotorChoice
from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, group_equal
from compact.quantities import PASS, column_names
from compact.report import results, text
from compact.report.tables import (
    ZERO_SHARE,
    TableSpec,
    columns,
    format_column,
    format_number,
    format_percent,
    format_quantity,
    json_numbers,
)
from compact.scene.loader import Scene

WIDE_PICTURE = 880  # [px], width above which a picture scrolls sideways on a narrow screen
PNG_WIDTH = slice(16, 20)  # bytes of the header of a PNG file
NUMERIC = re.compile(
    r"[−+<]? ?\d.{,24}$|–|infinite|tie$|constant|closed form|no |not |heaps|out of|$"
)  # or in their place
SHOWN_CYCLES, SHOWN_MOTORS = 6, 12  # [-], cycles of a wheel, the largest, and motors next to the chosen one
SVG = "image/svg+xml"
KNOWN_FLAGS = ("measured", "given", "derived")  # of parameters of the mix; all others are assumed
SIGNS = (  # kind of mark and first words of a clause of a remark
    ("assumed", ("assumed", "guess", "changed by the caller")), ("known", ("published", "measured", "calibrated")),
)  # fmt: skip
RUN_CRITERIA = (
    "peak_force", "rms_force", "peak_power", "rms_power", "mean_power", "energy", "drawn_energy", "dynamic_factor",
)  # fmt: skip
BALANCE = {  # words of the fields of `WorkBalance`
    "pass_work": "work of a pass over fresh mix, over the product",
    "confined_work": "work of confined compression, of the same mix",
    "work_ratio": "work of a pass over that of confined compression",
    "loose_work": "work of confined compression from the loose state",
    "cycle_work": "work of the resistance in a cycle",
    "pressed_volume": "product pressed from fresh mix in a stroke",
    "carried_volume": "product carried away by the mould in a stroke",
    "feed_ratio": "mix pressed over mix carried away, in a cycle",
    "strokes_on_section": "strokes over a section of the product",
    "throughput_work": "work of the resistance at this throughput",
    "explained_share": "share of confined compression from the loose state",
}
NO_SPEED = (
    "The engine is the formulas: the resistance is dry friction, the same at every speed and acceleration, "
    "F(v, a) = F sign(v)."
)
FILES_REMARK = "The tables and `summary.json` in the same directory hold every number with twelve digits."


@dataclass(frozen=True)
class Mark:
    """Text with a label in front.

    Parameters
    ----------
    kind : str
        Style of the label: "assumed", "known", "good" or "bad".
    """

    kind: str
    label: str
    text: str = ""


Cell = str | Mark


@dataclass(frozen=True)
class Table:
    """Table with a caption; columns of numbers are right-aligned.

    Parameters
    ----------
    columns : mapping
        Cells of each column by its head.
    """

    caption: str
    columns: Mapping[str, Sequence[Cell]]

    @property
    def rows(self) -> list[tuple[Cell, ...]]:
        """Rows of cells."""
        return list(zip(*self.columns.values(), strict=True))

    @property
    def numeric(self) -> list[bool]:
        """True for each column of numbers, or of words in their place."""
        return [
            all(isinstance(cell, str) and NUMERIC.match(cell) for cell in cells) and any(cells)
            for cells in self.columns.values()
        ]

    @classmethod
    def of_rows(cls, caption: str, header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> "Table":
        """Make a table of rows."""
        return cls(caption, {name: [row[place] for row in rows] for place, name in enumerate(header)})


@dataclass(frozen=True)
class Picture:
    """Embedded picture.

    Parameters
    ----------
    description : str
        Text for readers who cannot see the picture.
    media_type : str
        "image/png" or "image/svg+xml".
    summary : str
        Line under which the picture is hidden until it is opened; empty for a visible picture.
    """

    data: bytes
    description: str
    caption: str = ""
    media_type: str = "image/png"
    summary: str = ""

    @property
    def source(self) -> str:
        """Data URL of the picture."""
        return f"data:{self.media_type};base64,{b64encode(self.data).decode('ascii')}"

    @property
    def wide(self) -> bool:
        """True if the picture scrolls sideways on a narrow screen."""
        return self.media_type != "image/png" or int.from_bytes(self.data[PNG_WIDTH], "big") > WIDE_PICTURE


Block = str | Table | Picture


@dataclass(frozen=True)
class Section:
    """Section of the page, closed until it is opened; a block that is a text is a paragraph."""

    name: str
    title: str
    lead: str
    blocks: Sequence[Block] = field(default_factory=list)


def figures_of(section: str, pictures: Mapping[str, bytes]) -> list[Picture]:
    """Return the pictures of a section that exist."""
    return [Picture(pictures[name], *texts) for name, texts in text.figures()[section].items() if name in pictures]


def term_of(by: str) -> str:
    """Return the standard term of a criterion."""
    return CRITERIA[by].quantity.term


def as_sentence(line: str) -> str:
    """Capitalise a line of text and end it with a full stop."""
    return f"{line[0].upper()}{line[1:]}{'' if line.endswith('.') else '.'}"


def methods(shifts: Sequence[Shift]) -> str:
    """Name the means by which the ends of the inputs were computed."""
    found = dict.fromkeys("formula" if shift.by == "formula" else f"the engine {shift.by}" for shift in shifts)
    return f"By {' or '.join(found) or 'formula'}"


def ranking_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Tabulate the rankings by each criterion and drive, and their agreement."""
    blocks: list[Block] = [*figures_of("ranking", pictures)]
    if study.agreements:
        found = results.agreement_table(study)
        cells: dict[str, Sequence[Cell]] = {"criterion": [term_of(by) for by in found["criterion"]]}
        cells |= found.shown("engine", "drive", "other_engine", "other_drive", "first", "other_first", "pairs")
        cells |= found.shown("discordant_pairs", "resolved_discordant_pairs", "kendall_tau", digits=3)
        blocks.append(Table("Agreement of the rankings; resolved pairs differ beyond the errors", cells))
    blocks += _sentences(*text.heaping_sentences(study))
    for kind, orders in study.stages.drive.places.items():
        for by, order in orders.items():
            blocks.append(_ranking_table(kind, by, order, results.comparison_places(study, kind, by)))
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
        ranks = Counter(place.rank for place in order)
        tied = [tie or ranks[place.rank] > 1 for place, tie in zip(order, ties(order, by), strict=True)]
        columns["place"] = [
            "–" if place.reason else "tie" if tie else "resolved" if place.resolved else "not resolved"
            for place, tie in zip(order, tied, strict=True)
        ]
    for engine, compared in others.items():
        found = [compared.get(place.law) for place in order]
        values = format_column([other and other.value for other in found], unit)
        columns[f"by {engine}"] = [
            f"{value} ({other.rank})" if other else value for value, other in zip(values, found, strict=True)
        ]
    columns["note"] = [place.reason for place in order]
    return Table(f"Laws by {term_of(by)}, {kind} drive, least first", columns)


def contact_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Describe the contact of one roller and the resistance of a cart."""
    stage, numbers = study.stages.contacts, study.stages.contacts.numbers
    caption = "By formulas 1.1–1.10 and exact theory; low and high over the spread of the mix"
    formulas = results.formula_table(study)
    blocks: list[Block] = [Table(caption, _with_spread(formulas) | {"known by": formulas["known_by"]})]
    blocks += _sentences(coverage(study.scene, stage.engineering), text.held_sentence(study))
    load, formula = (format_quantity(each, "N", 3) for each in (stage.roller_load, numbers["roller_force"].value))
    if not stage.speeds:
        blocks += [NO_SPEED, *figures_of("contact", pictures)]
        return Section("contact", "Contact and resistance", f"{load} on a roller, by formula.", blocks)
    found = results.contact_table(study)
    shown = found.shown("speed", "load", "resistance", "coefficient", "trailing", "leading", "peak_pressure")
    shown["indentation"] = format_column([each.indentation for each in study.contacts], "m")
    shown |= {f"error of the {name}": found.percent(f"{name}_error") for name in ("load", "resistance")}
    caption = f"One roller by the engine {stage.engine.name}, per metre of its length, with its error estimates"
    blocks.append(Table(caption, shown))
    if stage.compacts:
        cases = [(c.speed, number, each) for c in study.contacts for number, each in enumerate(c.passes, start=1)]
        fields = [f"{head}=2.{name}" for name, head in zip(PASS, column_names(PASS), strict=True)]
        passes = TableSpec.of("passes", cases, columns("speed_m/s=0 pass=1", *fields))
        blocks.append(Table("Forces and compaction of each pass", passes.shown(*passes.quantities)))
    lead = f"{load} on a roller; {formula} by formula."
    return Section("contact", "Contact and resistance", lead, [*blocks, *figures_of("contact", pictures)])


def _sentences(*lines: str) -> list[str]:
    return [as_sentence(line) for line in lines if line]


def _with_spread(table: TableSpec) -> dict[str, list[str]]:
    """Return name, value and range of numbers, each with its own unit."""
    first = next(iter(table.quantities))
    found = {first: [name.replace("_", " ") for name in table[first]]}
    return found | {name: _with_units(table, name) for name in ("value", "low", "high")}


def _with_units(table: TableSpec, name: str) -> list[str]:
    """Return a column of numbers, each with the unit of its row."""
    return [format_quantity(*each) for each in zip(table[name], table["unit"], strict=True)]


def laws_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Describe the motion laws: kinematics, peaks, continuity."""
    shown, order = results.law_table(study), ("velocity", "acceleration", "jerk", "snap")
    cells = shown.shown("law", "peak_velocity", "peak_acceleration", "peak_jerk", "continuity")
    jumps = [{join.quantity for join in each.discontinuities()} for each in study.cycles.values()]
    cells["discontinuities"] = [", ".join(sorted(each, key=order.index)) or "none" for each in jumps]
    blocks: list[Block] = [*figures_of("laws", pictures)]
    if study.scene.drive.kind in COMPLIANT_DRIVES:
        blocks.append("The drive is compliant: the motion of the cart is in the files cycles/LAW.csv.")
    blocks.append(Table("Exact peaks inside the pieces, and discontinuities at their joins", cells))
    return Section("laws", "Motion laws", "Kinematics, exact peaks, discontinuities.", blocks)


def forces_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Tabulate forces, power and energy of every law."""
    runs, kind = study.runs.values(), study.scene.drive.kind
    columns = {"law": list(study.runs)}
    for by in (*RUN_CRITERIA, *(["dynamic_amplification"] if kind == "elastic" else [])):
        columns[term_of(by)] = format_column([getattr(run, by) for run in runs], CRITERIA[by].unit)
    columns[term_of("nonuniformity")] = [format_percent(run.nonuniformity) for run in runs]
    table = Table(f"One cart, {kind} drive, over a cycle", columns)
    lead = "Of one cart over a cycle; guide wheels; shaft."
    return Section("forces", "Forces and power", lead, [*figures_of("forces", pictures), table])


def duration_section(found: DurationStudy, pictures: Mapping[str, bytes]) -> Section:
    """Show the first laws over the duration, their peaks and crossovers."""
    blocks: list[Block] = [as_sentence(text.duration_sentence(found)), *figures_of("duration", pictures)]
    for by, orders in found.orders.items():
        rows = []
        for duration, (first, *rest) in zip(found.durations, orders, strict=True):
            tied = [each.run.name for each in rest if each.value < first.value * (1 + BUILD_TOLERANCE)]
            margin = "tie" if first.tie else format_percent(first.margin)
            value = format_quantity(first.value, CRITERIA[by].unit)
            rows.append((f"{duration:.3g} s", first.run.name, value, margin, ", ".join(tied)))
        header = ("duration", "first law", term_of(by), "margin", "ties with it")
        blocks.append(Table.of_rows(f"First law by {term_of(by)}", header, rows))
    if found.crossovers:
        crossed = list(results.duration_tables(found))[1]
        blocks.append(Table("Crossovers of the first laws", {
            "criterion": [term_of(by) for by in crossed["criterion"]],
            "duration": [f"{duration:.3g} s" for duration in crossed["duration"]],
            "first for shorter passes": crossed["shorter"], "first for longer passes": crossed["longer"],
            "peak of both": _with_units(crossed, "value"),
        }))  # fmt: skip
    lead = f"First laws from {found.durations[0]:.3g} to {found.durations[-1]:.3g} s a pass, with crossovers."
    return Section("duration", "Duration of a pass", lead, blocks)


def motor_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Show motor, guide wheels and bearings under the recommended law."""
    sizing = study.machine_sizing
    tables = {table.title: table for table in results.sizing_tables(sizing)}
    blocks: list[Block] = [*_sentences(
        text.motor_sentence(sizing), text.margin_sentence(study), text.bearing_sentence(sizing)
    ), *figures_of("motor", pictures)]  # fmt: skip
    if "motor-catalogue" in tables and sizing.first and sizing.first.choice:
        blocks.append(_catalogue_table(tables["motor-catalogue"], sizing.first.choice, sizing.rule.margin))
    if "motor-sizing" in tables:
        blocks.append(_sizing_table(sizing))
    rows: list[tuple[str, ...]] = []
    for wheel in sizing.wheels:
        own = wheel.name, f"{format_quantity(wheel.least, 'N')} to {format_quantity(wheel.largest, 'N')}"
        for each in wheel.cycles[:SHOWN_CYCLES]:
            counts = format_number(each.count), format_number(sizing.per_hour(each.count))
            rows.append((*own, format_quantity(each.range, "N"), format_quantity(each.mean, "N"), *counts))
            own = "", ""
        rows += [(*own, "constant", "–", "–", "–")] * (not wheel.cycles)
    header = ("load", "from, to", "range", "mean", "cycles in a cycle", "in an hour")
    blocks.append(Table.of_rows("Load cycles of one guide axle and one roller, by rainflow counting", header, rows))
    if lives := tables.get("bearing-lives"):
        blocks.append(Table("Basic life of the bearings, ISO 281", {
            "bearings": lives["bearing"], "equivalent load of one": lives.text("equivalent_load"),
            "L10, revolutions": [f"{format_number(each, 3)} million" for each in lives["life_million_revolutions"]],
            "L10, running": [f"{format_number(float(f'{each:.3g}'))} h" for each in lives["life_hours"]],
            "remark": ["" if valid else "load beyond half of the rating" for valid in lives["valid"]],
        }))  # fmt: skip
    lead = f"Torque of the shaft, load cycles of the wheels, lives of bearings with {sizing.first_law}."
    return Section("motor", "Motor, guides and bearings", lead, blocks)


def _catalogue_table(table: TableSpec, choice: MotorChoice, margin: float) -> Table:
    """Tabulate the motors next to the chosen one; motor-catalogue.csv has all."""
    place = len(choice.fits) - 1 if choice.chosen is None else choice.fits.index(choice.chosen)
    start = max(0, min(place - SHOWN_MOTORS // 2, len(choice.fits) - SHOWN_MOTORS))
    chosen = None if choice.chosen is None else choice.chosen.motor.name
    found = replace(table, rows=table.rows[start : start + SHOWN_MOTORS])
    cells: dict[str, Sequence[Cell]] = {"motor": found["motor"], "holds": [
        Mark("good", "chosen" if name == chosen else "holds") if holds else Mark("bad", "fails")
        for name, holds in zip(found["motor"], found["holds"], strict=True)
    ]}  # fmt: skip
    cells["price"] = [format_number(price) for price in found["price"]]
    cells |= found.shown("rated_power", "gear_ratio", digits=3)
    for words, has, needs in (("rated", "rated_torque", "rms_torque"), ("peak", "peak_torque", "peak_torque_needed")):
        cells[f"{words} torque: has, needs"] = [
            f"{format_number(one, 3)}, {format_number(margin * other, 3)} N m"
            for one, other in zip(found[has], found[needs], strict=True)
        ]
    cells |= found.shown("inertia_ratio", digits=3)
    caption = f"Motors of the catalogue by {choice.by}; needs include the margin of {margin:g}"
    return Table(f"{caption}; motor-catalogue.csv has the reasons", cells)


def _sizing_table(sizing: MachineSizing) -> Table:
    """Tabulate shaft torque and required power of all laws with finite torque, least power first."""
    laws = list(sizing.laws.values())
    ordered = [laws[i] for group in group_equal([each.required_power for each in laws]) for i in group]
    shown = [each for each in ordered if each.requirement is not None]
    found = TableSpec.of("", shown, columns(results.SIZING))
    cells = found.shown("law", "mean_torque", "rms_torque", "peak_torque")
    cells |= {"drives": found.percent("driving_share"), "brakes": found.percent("braking_share")}
    cells |= found.shown("required_power", digits=3)
    if any(each.choice for each in laws):
        cells["motor"] = [name or "none" for name in found["motor"]]
    caption = "Shaft and required rated power of every law, least first"
    return Table(caption + "; a velocity jump has no finite torque" * (len(shown) < len(laws)), cells)


def work_section(study: Study) -> Section:
    """Tabulate the balances of work and mix of the first law, with a warning for those that do not fit."""
    balance, cells = study.work_balance, {}
    for name, number in json_numbers(balance, results.WORK_BALANCE).items():
        value, unit = number["value"], number["unit"]
        if value is not None:
            is_share = unit == "1" and value < 1
            cells[BALANCE[name]] = format_percent(value) if is_share else format_quantity(value, unit, 3)
    warnings = text.work_warnings(balance)
    blocks: list[Block] = [as_sentence(text.work_sentence(study))]
    if warnings:
        marks = [Mark("bad", "warning")] * len(warnings)
        blocks.append(Table("Balances that do not fit", {"": marks, "reason": warnings}))
    shown = {"quantity": list(cells), "value": list(cells.values())}
    blocks.append(Table(f"Work and mix of one cart, with the law {balance.law}", shown))
    fit = {0: "all balances fit", 1: "one balance does not fit"}.get(len(warnings))
    lead = f"Specific work, mix fed and mix carried away: {fit or f'{len(warnings)} balances do not fit'}."
    return Section("work", "Work and throughput", lead, blocks)


def cams_section(study: Study, pictures: Mapping[str, bytes], first_cam: CamDrawing) -> Section:
    """Describe the cams of all laws, that of the first law in full, and the motors in the rollers."""
    laws, found = study.stages.laws, results.roller_motor_table(study)
    blocks: list[Block] = []
    if first_cam.reason:
        blocks.append(f"The cam of {first_cam.law}, the first law, cannot be cut: {first_cam.reason}.")
    else:
        caption = f"{first_cam.law}, true to scale in the file; `compact cam` writes it as CSV, SVG and DXF."
        turn = "One turn is a whole cycle.", SVG, "Show the cam and the cart in motion"
        blocks.append(Picture(first_cam.drawing.encode(), first_cam.description, caption, SVG))
        blocks.append(Picture(first_cam.animation.encode(), first_cam.animation_description, *turn))
    cells: dict[str, list[Cell]] = {"law": [*study.cycles]}
    for follower in FOLLOWERS:
        breadths = [(format_quantity(laws.least_breadths[law, follower].breadth, "m"), law) for law in study.cycles]
        cells[f"least breadth, {follower}"] = [
            Mark("bad", f"{breadth}: undercut") if laws.cams[law, follower].undercut else breadth
            for breadth, law in breadths
        ]
    rollers, flats = ([laws.cams[law, follower] for law in study.cycles] for follower in ("roller", "flat"))
    cells["least radius, roller"] = [format_quantity(cam.least_radius_of_curvature, "m") for cam in rollers]
    cells["pressure angle, roller"] = [f"{np.degrees(cam.largest_pressure_angle):.1f}°" for cam in rollers]
    cells["half-width, flat"] = [format_quantity(cam.largest_contact_offset, "m") for cam in flats]
    breadth = format_quantity(rollers[0].breadth, "m")
    blocks += [*figures_of("cams", pictures), Table(f"Cams with a breadth of {breadth}; marked where too small", cells)]
    motors = found.shown("law", "peak_torque", "peak_power") | {"share of friction": found.percent("share")}
    if any(found["peak_creep"]):
        motors["creepage"] = found.percent("peak_creep")
    if any(found["lack"]):
        motors["limit"] = found["lack"]
    caption = "Drive without a cam: peaks of the motor in each roller, and the required share of the friction limit"
    lead = f"{len(study.cycles)} laws for {len(FOLLOWERS)} followers; workshop drawing of one."
    return Section("cams", "Cams", lead, [*blocks, Table(caption, motors)])


def sensitivity_section(shifts: Sequence[Shift]) -> Section:
    """Tabulate the sensitivities of the least peaks and of the first law."""
    peaks, rows = list(shifts[0].base.least), list[list[Cell]]()
    for shift in shifts:
        cells: list[Cell] = [shift.name.split(".")[-1].replace("_", " ")]
        cells.append(" to ".join(format_quantity(end, shift.unit, 3) for end in shift.ends))
        cells += [Mark("assumed", shift.how) if shift.how == PRIOR else shift.how, shift.by]
        for peak in peaks:
            for end in (shift.low, shift.high):
                change = None if end is None else end.least[peak] / shift.base.least[peak] - 1
                sign = "+" if change is not None and change > ZERO_SHARE else ""
                cells.append("out of range" if change is None else f"{sign}{format_percent(change)}")
        others = {end.law[by] for by in shift.base.law for end in shift.changed_ends(by)}
        rows.append([*cells, ", ".join(sorted(others)) or "the same"])
    ends = [f"{by.removeprefix('peak_')}, {end} end" for by in peaks for end in ("low", "high")]
    bases = []
    for by, base in {each.by: each.base for each in shifts}.items():
        values = [f"{term_of(key)} {format_quantity(value, CRITERIA[key].unit)} ({base.law[key]})"
                  for key, value in base.least.items()]  # fmt: skip
        bases.append(f"by {by}, {', '.join(values)}")
    means = {shift.by for shift in shifts}
    if means == {"formula"}:
        remark = "All ends are by formula, without an effect of the speed."
    elif "formula" in means:
        remark = (
            "Inputs that do not change the layer are by the resistance map of the engine; the others are by formula, "
            "as the engine is too expensive."
        )
    else:
        remark = f"All ends are by the engine {means.pop()}, computed for each end at steady speed."
    words = (
        f"Each input is moved to its low and its high end, with a rigid drive. {remark} The numbers are the changes of "
        f"the least peak over all laws from that of the scene: {'; '.join(bases)}."
    )
    table = Table.of_rows("Sensitivity of the result", ("input", "ends", "range", "by", *ends, "first law"), rows)
    lead = f"Change of the least peaks, one input at a time. {methods(shifts)}."
    return Section("sensitivity", "Sensitivity", lead, [words, table])


def scene_section(scene: Scene) -> Section:
    """List every input of the scene with its meaning; assumed inputs are marked."""
    tables, assumed = list[Table](), 0
    for name in type(scene).model_fields:
        part = getattr(scene, name)
        if name in ("title", "unusual", "output") or part is None:
            continue
        fields = {key: each for key, each in type(part).model_fields.items() if getattr(part, key) is not None}
        remarks = [_remark(scene, name, key) for key in fields]
        assumed += sum(isinstance(cell, Mark) and cell.kind == "assumed" for cell in remarks)
        tables.append(Table(f"[{name}]", {
            "key": [f"`{key}`" for key in fields], "value": [_input_value(getattr(part, key)) for key in fields],
            "meaning": [each.description or "" for each in fields.values()], "remark in the file": remarks,
        }))  # fmt: skip
    words = f"Read from {scene.file}, in SI units. Marked are inputs whose comments state an assumption or a change."
    return Section("scene", "Scene", f"Every input, {assumed} of them assumed.", [words, *tables])


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
    for kind, signs in SIGNS:
        for sign in signs:
            origin = next((clause for clause in clauses if clause.startswith(sign)), None)
            if origin is not None:
                rest = [origin.removeprefix(sign).strip(" :,"), *(clause for clause in clauses if clause != origin)]
                return Mark(kind, sign, "; ".join(filter(None, rest)))
    return "; ".join(clauses)


def mix_section(study: Study) -> Section:
    """List the parameters of the mix with spread and origin."""
    mix, table = study.scene.mix, results.mix_table(study)
    marks = [Mark("known" if flag in KNOWN_FLAGS else "assumed", flag) for flag in table["flag"]]
    cells = _with_spread(table) | {"flag": marks, "origin": table["origin"]}
    lead = f"{100 * mix.moisture:g} % moisture content, density ratio {mix.density_ratio:g}; origin of each parameter."
    return Section("mix", "Mix", lead, [Table("Parameters of the mix", cells)])


def checks_section(checks: Sequence[BalanceCheck]) -> Section:
    """Tabulate the built-in checks."""
    columns: dict[str, list[Cell]] = {
        "check": [check.name for check in checks],
        "residual": [format_number(check.residual, 2) for check in checks],
        "limit": [format_number(check.limit, 2) for check in checks],
        "": [Mark("good", "passes") if check.passed else Mark("bad", "fails") for check in checks],
    }
    failed = sum(not check.passed for check in checks)
    lead = f"{len(checks)} balances and counts; {failed or 'none'} of them fail{'s' if failed == 1 else ''}."
    return Section("checks", "Built-in checks", lead, [Table("Checks", columns)])


def versions_section(study: Study, versions: Mapping[str, str]) -> Section:
    """List packages, fingerprint of the scene and number of computations."""
    rows = [*versions.items(), ("scene", f"`{study.scene.hash}`")]
    rows += [(f"computed: {stage}", str(count)) for stage, count in study.counts.items()]
    table = Table.of_rows(
        "Versions, fingerprint of the scene, and number of computations of each stage", ("of", "value"), rows
    )
    return Section("versions", "Versions and files", "Packages, scene and stages of this page.", [FILES_REMARK, table])
