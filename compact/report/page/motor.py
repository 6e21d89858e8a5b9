"""Section of the page on the motor: torque of the shaft, catalogue, loads of guide wheels and rollers, bearings."""

from collections.abc import Mapping

from compact.analysis.sizing.machine_sizing import LawSizing, MachineSizing
from compact.analysis.study import Study
from compact.machine.motor_sizing import MotorChoice, MotorFit
from compact.machine.ranking import group_equal
from compact.report.page.blocks import Block, Cell, Mark, Paragraph, Picture, Section, Table, as_sentence
from compact.report.sizing.sentences import bearing_sentence, margin_sentence, motor_sentence
from compact.report.tables import format_column, format_number, format_percent, format_quantity

SHOWN_CYCLES = 6  # [-], load cycles of a wheel on the page, the largest; wheel-loads.csv has all
SHOWN_MOTORS = 12  # [-], motors on the page, those next to the chosen one; motor-catalogue.csv has all


def motor_section(study: Study, pictures: Mapping[str, bytes]) -> Section:
    """Show motor, guide wheels and bearings under the recommended law.

    Parameters
    ----------
    study : Study
        A finished study.
    pictures : mapping
        Figures by name, "shaft" among them for a drive with a shaft.
    """
    sizing = study.machine_sizing
    sentences = [motor_sentence(sizing), margin_sentence(study), bearing_sentence(sizing)]
    blocks: list[Block] = [Paragraph(as_sentence(sentence)) for sentence in sentences if sentence]
    if "shaft" in pictures:
        caption = "Uniform shaft, one revolution a cycle. Limits of the motor are at the shaft, divided by the margin."
        blocks.append(Picture(pictures["shaft"], f"Torque of the shaft with {sizing.first_law}", caption))
    first = sizing.first
    if first is not None and first.choice is not None:
        blocks.append(_catalogue_table(first.choice, sizing.rule.margin))
    if sizing.laws:
        blocks.append(_law_table(list(sizing.laws.values())))
    blocks.append(_wheel_table(sizing))
    if sizing.lives:
        blocks.append(_bearing_table(sizing))
    lead = f"Torque of the shaft, load cycles of the wheels, lives of bearings with {sizing.first_law}."
    return Section("motor", "Motor, guides and bearings", lead, blocks)


def _catalogue_table(choice: MotorChoice, margin: float) -> Table:
    """Tabulate the motors next to the chosen one."""
    chosen = choice.chosen
    place = len(choice.fits) - 1 if chosen is None else choice.fits.index(chosen)
    start = max(0, min(place - SHOWN_MOTORS // 2, len(choice.fits) - SHOWN_MOTORS))
    fits = choice.fits[start : start + SHOWN_MOTORS]
    columns: dict[str, list[Cell]] = {
        "motor": [each.motor.name for each in fits],
        "holds": [_verdict(each, chosen) for each in fits],
        "price": ["–" if each.motor.price is None else format_number(each.motor.price) for each in fits],
        "rated power": [format_quantity(each.motor.rated_power, "W", 3) for each in fits],
        "gear ratio": [format_number(each.gear_ratio, 3) for each in fits],
        "rated torque: has, needs": [_pair(each.motor.rated_torque, margin * each.rms_torque) for each in fits],
        "peak torque: has, needs": [_pair(each.motor.peak_torque, margin * each.peak_torque) for each in fits],
        "inertia ratio": [format_number(each.inertia_ratio, 3) for each in fits],
    }
    caption = (
        f"Motors of the catalogue by {choice.by}; needs include the margin of {margin:g}; motor-catalogue.csv has the "
        "reasons"
    )
    return Table.from_columns(caption, columns, ("motor", "holds"))


def _pair(has: float, needs: float) -> str:
    return f"{format_number(has, 3)}, {format_number(needs, 3)} N m"


def _verdict(fit: MotorFit, chosen: MotorFit | None) -> Cell:
    if fit.holds:
        return Mark("good", "chosen" if fit is chosen else "holds")
    return Mark("bad", "fails")


def _law_table(laws: list[LawSizing]) -> Table:
    """Tabulate shaft torque and required power of all laws with finite torque, least power first."""
    ordered = [laws[i] for group in group_equal([each.required_power for each in laws]) for i in group]
    shown = [(each, each.requirement) for each in ordered if each.requirement is not None]
    columns: dict[str, list[Cell]] = {
        "law": [each.law for each, _ in shown],
        "mean torque": [*format_column([found.mean_torque for _, found in shown], "Nm")],
        "rms torque": [*format_column([found.rms_torque for _, found in shown], "Nm")],
        "peak torque": [*format_column([found.peak_torque for _, found in shown], "Nm")],
        "drives": [format_percent(found.driving_share) for _, found in shown],
        "brakes": [format_percent(found.braking_share) for _, found in shown],
        "required power": [*format_column([each.required_power for each, _ in shown], "W", 3)],
    }
    if any(each.choice for each in laws):
        columns["motor"] = [
            each.choice.chosen.motor.name if each.choice and each.choice.chosen else "none" for each, _ in shown
        ]
    caption = "Shaft and required rated power of every law, least first"
    if len(shown) < len(laws):
        caption += "; a velocity jump has no finite torque"
    return Table.from_columns(caption, columns, ("law", "motor"))


def _wheel_table(sizing: MachineSizing) -> Table:
    """Tabulate the largest load cycles of each wheel."""
    rows: list[tuple[Cell, ...]] = []
    for wheel in sizing.wheels:
        extremes = f"{format_quantity(wheel.least, 'N')} to {format_quantity(wheel.largest, 'N')}"
        for place, each in enumerate(wheel.cycles[:SHOWN_CYCLES]):
            hourly = sizing.per_hour(each.count)
            wheel_cells = ("", "") if place else (wheel.name, extremes)
            ranges = (format_quantity(each.range, "N"), format_quantity(each.mean, "N"))
            rows.append((*wheel_cells, *ranges, format_number(each.count), format_number(hourly)))
        if not wheel.cycles:
            rows.append((wheel.name, extremes, "constant", "–", "–", "–"))
    header = ("load", "from, to", "range", "mean", "cycles in a cycle", "in an hour")
    return Table("Load cycles of one guide axle and one roller, by rainflow counting", header, rows, (1, 2, 3, 4, 5))


def _bearing_table(sizing: MachineSizing) -> Table:
    """Tabulate the lives of the bearings."""
    rows: list[tuple[Cell, ...]] = [
        (
            name, format_quantity(life.equivalent_load, "N"), f"{format_number(life.million_revolutions, 3)} million",
            _rounded(life.hours), "" if life.valid else "load beyond half of the rating",
        )
        for name, life in sizing.lives.items()
    ]  # fmt: skip
    header = ("bearings", "equivalent load of one", "L10, revolutions", "L10, running", "remark")
    return Table("Basic life of the bearings, ISO 281", header, rows, (1, 2, 3))


def _rounded(hours: float) -> str:
    """Format a life with three digits."""
    return f"{format_number(float(f'{hours:.3g}'))} h"
