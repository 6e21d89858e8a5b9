"""Sections of the page, `report.html`: sentences, figures and tables of each, declared in `SECTIONS`."""

import re
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from compact.analysis.ranking_uncertainty import Place, ties
from compact.analysis.stages.sensitivity import PRIOR
from compact.analysis.study import Study
from compact.cams.profile import FOLLOWERS
from compact.files import versions
from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, group_equal
from compact.quantities import PASS, column_names
from compact.report import results, text
from compact.report.tables import (
    ZERO_SHARE,
    Mark,
    TableSpec,
    format_column,
    format_number,
    format_percent,
    format_quantity,
    json_numbers,
)

WIDE_PICTURE = 880  # [px], width above which a picture scrolls sideways on a narrow screen
PNG_WIDTH = slice(16, 20)  # bytes of the header of a PNG file
NUMERIC = re.compile(
    r"[−+<]? ?\d.{,24}$|–|infinite|tie$|constant|closed form|no |not |heaps|out of|$"
)  # or in their place
SHOWN_CYCLES, SHOWN_MOTORS = 6, 12  # [-], cycles of a wheel, the largest, and motors next to the chosen one
SVG = "image/svg+xml"
KNOWN_FLAGS = ("measured", "given", "derived")  # of parameters of the mix; all others are assumed
CONTACT = (
    "speed_m/s load_N/m resistance_N/m coefficient trailing_m leading_m peak_pressure_Pa indentation_m "
    "error_of_the_load=load_error:% error_of_the_resistance=resistance_error:%"
)
RUN = (
    "law=name peak_force_N rms_force_N peak_power_W rms_power_W mean_power_W energy_J drawn_energy_J dynamic_factor "
    "nonuniformity:%"
)
SHAFT = ("law", "mean_torque", "rms_torque", "peak_torque", "driving_share", "braking_share", "required_power")
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


@dataclass(frozen=True)
class Picture:
    """Embedded picture.

    Parameters
    ----------
    description : str
        Text for readers who cannot see the picture.
    media_type : str
        "image/png" or "image/svg+xml".
    """

    data: bytes
    description: str
    caption: str = ""
    media_type: str = "image/png"

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
    found = text.figures().get(section, {})
    return [Picture(pictures[name], *texts) for name, texts in found.items() if name in pictures]


def term_of(by: str) -> str:
    """Return the standard term of a criterion."""
    return CRITERIA[by].quantity.term


def as_sentence(line: str) -> str:
    """Capitalise a line of text and end it with a full stop."""
    return f"{line[0].upper()}{line[1:]}{'' if line.endswith('.') else '.'}"


def sections(study: Study, pictures: Mapping[str, bytes]) -> list[Section]:
    """Return the sections of a study, without those that do not apply."""
    absent = {"duration": study.over_durations is None, "cams": study.first_cam is None}
    return [section(name, study, pictures) for name in SECTIONS if not absent.get(name)]


def section(name: str, study: Study, pictures: Mapping[str, bytes] | None = None) -> Section:
    """Return one section: its sentences, then its figures and tables."""
    title, sentences, tables = SECTIONS[name]
    words = [as_sentence(each) for macro in sentences for each in text.sentences(macro, study)]
    lead = text.say(f"lead_{name}", study)
    return Section(name, title, as_sentence(lead), [*words, *figures_of(name, pictures or {}), *tables(study)])


def _table(caption: str, records: Iterable[Any], names: str, **getters: Any) -> Table:
    """Tabulate records in the columns of `TableSpec.of`."""
    return Table(caption, TableSpec.of(caption, records, names, **getters).cells())


# tables of the sections


def _rankings(study: Study) -> Iterator[Table]:
    """Tabulate the agreement of the rankings, and the rankings by each drive and criterion."""
    if study.agreements:
        caption = "Agreement of the rankings; resolved pairs differ beyond the errors"
        yield _table(caption, study.agreements, results.AGREEMENT, criterion=lambda each: term_of(each.by))
    for kind, orders in study.stages.drive.places.items():
        for by, order in orders.items():
            yield _ranking(kind, by, order, results.comparison_places(study, kind, by))


def _ranking(kind: str, by: str, order: list[Place], others: Mapping[str, Mapping[str, Place]]) -> Table:
    """Tabulate a ranking, with values and ranks by the engines of the comparison."""
    unit = CRITERIA[by].unit
    cells: dict[str, Sequence[Cell]] = {
        "rank": [str(place.rank) for place in order],
        "law": [place.law for place in order],
        term_of(by): format_column([place.value for place in order], unit),
        "margin": ["tie" if place.tie else format_percent(place.margin) for place in order],
    }
    if order[0].error is not None:
        cells["error"] = format_column([place.error for place in order], unit, 2)
        ranks = Counter(place.rank for place in order)
        tied = [tie or ranks[place.rank] > 1 for place, tie in zip(order, ties(order, by), strict=True)]
        cells["place"] = [
            "–" if place.reason else "tie" if tie else "resolved" if place.resolved else "not resolved"
            for place, tie in zip(order, tied, strict=True)
        ]
    for engine, compared in others.items():
        found = [compared.get(place.law) for place in order]
        values = format_column([other and other.value for other in found], unit)
        cells[f"by {engine}"] = [
            f"{value} ({other.rank})" if other else value for value, other in zip(values, found, strict=True)
        ]
    return Table(f"Laws by {term_of(by)}, {kind} drive, least first", cells | {"note": [each.reason for each in order]})


def _numbers(caption: str, table: TableSpec, *words: str) -> Table:
    """Tabulate numbers of several units with their ranges; further columns are words."""
    first = next(iter(table.quantities))
    cells: dict[str, Sequence[Cell]] = {first: [name.replace("_", " ") for name in table[first]]}
    for name in ("value", "low", "high"):
        cells[name] = [format_quantity(*each) for each in zip(table[name], table["unit"], strict=True)]
    return Table(caption, cells | {name.replace("_", " "): table[name] for name in words})


def _contacts(study: Study) -> Iterator[Table]:
    """Tabulate the formulas, the contacts over speed, and the passes over a compacting layer."""
    stage = study.stages.contacts
    caption = "By formulas 1.1–1.10 and exact theory; low and high over the spread of the mix"
    yield _numbers(caption, results.formula_table(study), "known_by")
    if stage.speeds:
        caption = f"One roller by the engine {stage.engine.name}, per metre of its length, with its error estimates"
        yield _table(caption, study.contacts, CONTACT)
    if stage.compacts:
        cases = [(c.speed, number, each) for c in study.contacts for number, each in enumerate(c.passes, start=1)]
        fields = [f"{head}=2.{name}" for name, head in zip(PASS, column_names(PASS), strict=True)]
        yield _table("Forces and compaction of each pass", cases, f"speed_m/s=0 pass=1 {' '.join(fields)}")


def _laws(study: Study) -> Iterator[Table]:
    order = ("velocity", "acceleration", "jerk", "snap")
    jumps = [{join.quantity for join in each.discontinuities()} for each in study.cycles.values()]
    cells = results.law_table(study).cells("law", "peak_velocity", "peak_acceleration", "peak_jerk", "continuity")
    cells["discontinuities"] = [", ".join(sorted(each, key=order.index)) or "none" for each in jumps]
    yield Table("Exact peaks inside the pieces, and discontinuities at their joins", cells)


def _runs(study: Study) -> Iterator[Table]:
    kind, model = study.scene.drive.kind, study.stages.drive.model
    declared = RUN + " dynamic_amplification" * model.driven_end
    yield _table(f"One cart, {kind} drive, over a cycle", study.runs.values(), declared)


def _durations(study: Study) -> Iterator[Table]:
    """Tabulate the first law at each duration, and the crossovers."""
    found = study.over_durations
    assert found is not None
    for by, orders in found.orders.items():
        cells: dict[str, list[str]] = {"duration": [f"{duration:.3g} s" for duration in found.durations]}
        cells["first law"] = [first.run.name for first, *_ in orders]
        cells[term_of(by)] = [format_quantity(first.value, CRITERIA[by].unit) for first, *_ in orders]
        cells["margin"] = ["tie" if first.tie else format_percent(first.margin) for first, *_ in orders]
        cells["ties with it"] = [
            ", ".join(each.run.name for each in rest if each.value < first.value * (1 + BUILD_TOLERANCE))
            for first, *rest in orders
        ]
        yield Table(f"First law by {term_of(by)}", cells)
    if found.crossovers:
        yield _table(
            "Crossovers of the first laws", found.crossovers,
            "criterion duration first_for_shorter_passes=shorter first_for_longer_passes=longer peak_of_both",
            criterion=lambda each: term_of(each.by), duration=lambda each: f"{each.duration:.3g} s",
            peak_of_both=lambda each: format_quantity(each.value, CRITERIA[each.by].unit),
        )  # fmt: skip


def _motor(study: Study) -> Iterator[Table]:
    """Tabulate the motors next to the chosen one, the shaft of every law, load cycles of the wheels, and lives."""
    sizing = study.machine_sizing
    laws, tables = list(sizing.laws.values()), {table.title: table for table in results.sizing_tables(sizing)}
    if sizing.first is not None and (choice := sizing.first.choice) is not None:
        place = len(choice.fits) - 1 if choice.chosen is None else choice.fits.index(choice.chosen)
        start = max(0, min(place - SHOWN_MOTORS // 2, len(choice.fits) - SHOWN_MOTORS))
        table = tables["motor-catalogue"]
        near = replace(table, rows=table.rows[start : start + SHOWN_MOTORS])
        words = {True: Mark("good", "holds"), False: Mark("bad", "fails")}
        cells = near.cells() | {"holds": [words[holds] for holds in near["holds"]]}
        if choice.chosen is not None:
            cells["holds"][place - start] = Mark("good", "chosen")
        caption = f"Motors of the catalogue by {choice.by}; each must hold with the margin of {sizing.rule.margin:g}"
        yield Table(caption, cells)
    if laws:
        ordered = [laws[i] for group in group_equal([each.required_power for each in laws]) for i in group]
        shown = [each for each in ordered if each.requirement is not None]
        caption = "Shaft and required rated power of every law, least first"
        caption += "; a velocity jump has no finite torque" * (len(shown) < len(laws))
        motor = ["motor"] * any(each.choice for each in laws)
        yield Table(caption, TableSpec.of("", shown, results.SIZING).cells(*SHAFT, *motor))
    loads = [(wheel, each) for wheel in sizing.wheels for each in wheel.cycles[:SHOWN_CYCLES] or (None,)]
    yield _table(
        "Load cycles of one guide axle and one roller, by rainflow counting", loads,
        "load=0.name from_N=0.least to_N=0.largest range mean_N=1.mean cycles_in_a_cycle=1.count:3 in_an_hour:3",
        range=lambda row: format_quantity(row[1].range, "N") if row[1] else "constant",
        in_an_hour=lambda row: row[1] and sizing.per_hour(row[1].count),
    )  # fmt: skip
    if lives := tables.get("bearing-lives"):
        yield Table("Basic life of the bearings, ISO 281", lives.cells())


def _work(study: Study) -> Iterator[Table]:
    """Tabulate the balances of work and mix of the first law, with a warning for those that do not fit."""
    cells = {}
    for name, number in json_numbers(study.work_balance, results.WORK_BALANCE).items():
        value, unit = number["value"], number["unit"]
        if value is not None:
            is_share = unit == "1" and value < 1
            cells[BALANCE[name]] = format_percent(value) if is_share else format_quantity(value, unit, 3)
    if warnings := text.sentences("balances", study):
        marks = [Mark("bad", "warning")] * len(warnings)
        yield Table("Balances that do not fit", {"": marks, "reason": warnings})
    shown = {"quantity": list(cells), "value": list(cells.values())}
    yield Table(f"Work and mix of one cart, with the law {study.work_balance.law}", shown)


def _cams(study: Study) -> Iterator[Block]:
    """Show the cam of the first law, and tabulate those of all laws and the motors in the rollers."""
    laws, first = study.stages.laws, study.first_cam
    assert first is not None
    if first.drawing is not None:
        caption = f"{first.law}, true to scale in the file; `compact cam` writes it as CSV, SVG and DXF."
        yield Picture(first.drawing.svg().encode(), first.drawing.description, caption, SVG)
    cells: dict[str, list[Cell]] = {"law": [*study.cycles]}
    for follower in FOLLOWERS:
        breadths = [format_quantity(laws.cams[law, follower].least_breadth().breadth, "m") for law in study.cycles]
        cells[f"least breadth, {follower}"] = [
            Mark("bad", f"{breadth}: undercut") if laws.cams[law, follower].undercut else breadth
            for law, breadth in zip(study.cycles, breadths, strict=True)
        ]
    rollers, flats = ([laws.cams[law, follower] for law in study.cycles] for follower in ("roller", "flat"))
    cells["least radius, roller"] = [format_quantity(cam.least_radius_of_curvature, "m") for cam in rollers]
    cells["pressure angle, roller"] = [f"{np.degrees(cam.largest_pressure_angle):.1f}°" for cam in rollers]
    cells["half-width, flat"] = [format_quantity(cam.largest_contact_offset, "m") for cam in flats]
    yield Table(f"Cams with a breadth of {format_quantity(rollers[0].breadth, 'm')}; marked where too small", cells)
    motors = results.roller_motor_table(study)
    own = [name for name in ("peak_creep", "lack") if any(motors[name])]
    caption = "Drive without a cam: peaks of the motor in each roller, and the required share of the friction limit"
    yield Table(caption, motors.cells("law", "peak_torque", "peak_power", "share", *own))


def _sensitivities(study: Study) -> Iterator[Table]:
    """Tabulate the sensitivities of the least peaks and of the first law."""
    shifts = study.sensitivities
    cells: dict[str, list[Cell]] = {"input": [each.name.split(".")[-1].replace("_", " ") for each in shifts]}
    cells["ends"] = [" to ".join(format_quantity(end, each.unit, 3) for end in each.ends) for each in shifts]
    cells["range"] = [Mark("assumed", each.how) if each.how == PRIOR else each.how for each in shifts]
    cells["by"] = [each.by for each in shifts]
    for peak in shifts[0].base.least:
        for end in ("low", "high"):
            column = cells.setdefault(f"{peak.removeprefix('peak_')}, {end} end", [])
            for shift in shifts:
                moved = getattr(shift, end)
                change = None if moved is None else moved.least[peak] / shift.base.least[peak] - 1
                sign = "+" if change is not None and change > ZERO_SHARE else ""
                column.append("out of range" if change is None else f"{sign}{format_percent(change)}")
    others = [{end.law[by] for by in each.base.law for end in each.changed_ends(by)} for each in shifts]
    yield Table(
        "Sensitivity of the result", cells | {"first law": [", ".join(sorted(e)) or "the same" for e in others]}
    )


def _scene(study: Study) -> Iterator[Table]:
    """List every input of the scene with its meaning; assumed inputs are marked."""
    scene = study.scene
    for name in type(scene).model_fields:
        part = getattr(scene, name)
        if name not in text.NOT_INPUTS and part is not None:
            fields = {key: each for key, each in type(part).model_fields.items() if getattr(part, key) is not None}
            yield Table(f"[{name}]", {
                "key": [f"`{key}`" for key in fields], "value": [_input_value(getattr(part, key)) for key in fields],
                "meaning": [each.description or "" for each in fields.values()],
                "remark in the file": [text.remark(scene, name, key) for key in fields],
            })  # fmt: skip


def _input_value(value: Any) -> str:
    if hasattr(value, "model_dump"):
        given = value.model_dump(exclude_none=True)
        return ", ".join(f"{key} = {item}" for key, item in given.items()) or "none"
    if isinstance(value, tuple):
        return ", ".join(_input_value(item) for item in value)
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _mix(study: Study) -> Iterator[Table]:
    table = results.mix_table(study)
    marks = [Mark("known" if flag in KNOWN_FLAGS else "assumed", flag) for flag in table["flag"]]
    found = _numbers("Parameters of the mix", table)
    yield Table(found.caption, {**found.columns, "flag": marks, "origin": table["origin"]})


def _checks(study: Study) -> Iterator[Table]:
    yield Table("Checks", {
        "check": [check.name for check in study.checks],
        "residual": [format_number(check.residual, 2) for check in study.checks],
        "limit": [format_number(check.limit, 2) for check in study.checks],
        "": [Mark("good", "passes") if check.passed else Mark("bad", "fails") for check in study.checks],
    })  # fmt: skip


def _versions(study: Study) -> Iterator[Table]:
    rows = versions() | {"scene": f"`{study.scene.hash}`"}
    rows |= {f"computed: {stage}": str(count) for stage, count in study.counts.items()}
    caption = "Versions, fingerprint of the scene, and number of computations of each stage"
    yield Table(caption, {"of": list(rows), "value": list(rows.values())})


SECTIONS: Mapping[str, tuple[str, tuple[str, ...], Callable[[Study], Iterable[Block]]]] = {  # title, sentences, tables
    "ranking": ("Ranking", ("heaping",), _rankings),
    "contact": ("Contact and resistance", ("valid_formulas", "held", "no_speed"), _contacts),
    "laws": ("Motion laws", ("compliant",), _laws),
    "forces": ("Forces and power", (), _runs),
    "duration": ("Duration of a pass", ("durations",), _durations),
    "motor": ("Motor, guides and bearings", ("motor", "motor_margin", "bearings"), _motor),
    "work": ("Work and throughput", ("work",), _work),
    "cams": ("Cams", ("no_cam",), _cams),
    "sensitivity": ("Sensitivity", ("ends",), _sensitivities),
    "scene": ("Scene", ("inputs",), _scene),
    "mix": ("Mix", (), _mix),
    "checks": ("Built-in checks", (), _checks),
    "versions": ("Versions and files", ("tables",), _versions),
}
