"""Files and numbers of the sizing: shaft torque and motor of every law, motors of the catalogue, loads of wheels."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from compact.analysis.sizing.machine_sizing import LawSizing, MachineSizing
from compact.files import write_csv
from compact.machine.motor_sizing import MotorFit
from compact.report.tables import json_number

LAW_HEADER = (
    "law", "shaft_speed_rad/s", "mean_torque_Nm", "rms_torque_Nm", "peak_torque_Nm", "peak_braking_torque_Nm",
    "driving_share", "braking_share", "largest_inertia_kgm2", "excess_energy_J", "required_power_W", "motor",
)  # fmt: skip
CATALOGUE_HEADER = (
    "motor", "price", "rated_power_W", "gear_ratio", "rms_torque_Nm", "rated_torque_Nm", "peak_torque_needed_Nm",
    "peak_torque_Nm", "inertia_ratio", "fluctuation", "holds", "reason",
)  # fmt: skip
WHEEL_HEADER = ("load", "range_N", "mean_N", "count_per_cycle", "count_per_hour")
BEARING_HEADER = ("bearing", "equivalent_load_N", "life_million_revolutions", "life_hours", "valid")


def write_sizing(sizing: MachineSizing, directory: Path) -> Iterator[Path]:
    """Write motor-sizing.csv, motor-catalogue.csv, wheel-loads.csv and bearing-lives.csv, as far as they exist.

    Parameters
    ----------
    sizing : MachineSizing
        Motor, guides and bearings.
    directory : Path
        Existing directory.

    Yields
    ------
    Path
        File written.
    """
    if sizing.laws:
        rows = [_law_row(each) for each in sizing.laws.values()]
        yield write_csv(directory / "motor-sizing.csv", LAW_HEADER, rows)
    first = sizing.first
    if first is not None and first.choice is not None:
        yield write_csv(directory / "motor-catalogue.csv", CATALOGUE_HEADER, map(_fit_row, first.choice.fits))
    yield write_csv(directory / "wheel-loads.csv", WHEEL_HEADER, [
        (wheel.name, each.range, each.mean, each.count, sizing.per_hour(each.count))
        for wheel in sizing.wheels
        for each in wheel.cycles
    ])  # fmt: skip
    if sizing.lives:
        yield write_csv(directory / "bearing-lives.csv", BEARING_HEADER, [
            (name, life.equivalent_load, life.million_revolutions, life.hours, life.valid)
            for name, life in sizing.lives.items()
        ])  # fmt: skip


def _law_row(each: LawSizing) -> tuple[Any, ...]:
    found = each.requirement
    if found is None:
        return (each.law, *("" for _ in LAW_HEADER[1:-2]), each.required_power, "")
    motor = each.choice.chosen.motor.name if each.choice and each.choice.chosen else ""
    return (
        each.law, found.speed, found.mean_torque, found.rms_torque, found.peak_torque, found.peak_braking,
        found.driving_share, found.braking_share, found.largest_inertia, found.excess_energy, each.required_power,
        motor,
    )  # fmt: skip


def _fit_row(fit: MotorFit) -> tuple[Any, ...]:
    motor = fit.motor
    return (
        motor.name, "" if motor.price is None else motor.price, motor.rated_power, fit.gear_ratio, fit.rms_torque,
        motor.rated_torque, fit.peak_torque, motor.peak_torque, fit.inertia_ratio, fit.fluctuation, fit.holds,
        "; ".join(fit.failures),
    )  # fmt: skip


def sizing_numbers(sizing: MachineSizing) -> dict[str, Any]:
    """Convert motor, loads and lives of the first law to the content of summary.json."""
    return {
        "law": sizing.first_law,
        "margin": sizing.rule.margin,
        "efficiency": sizing.rule.efficiency,
        "shaft": _shaft(sizing.first),
        "motor": _choice(sizing.first),
        "wheels": {
            wheel.name: {
                "least": json_number(wheel.least, "N"),
                "largest": json_number(wheel.largest, "N"),
                "cycles": [{"range": each.range, "mean": each.mean, "count": each.count} for each in wheel.cycles],
            }
            for wheel in sizing.wheels
        },
        "bearings": {
            name: {
                "equivalent_load": json_number(life.equivalent_load, "N"),
                "life": json_number(life.million_revolutions * 1e6, "1"),
                "hours": json_number(life.hours, "h"),
                "valid": life.valid,
            }
            for name, life in sizing.lives.items()
        },
    }


def _shaft(first: LawSizing | None) -> dict[str, Any] | None:
    """Convert the requirement of a law; None without one."""
    if first is None or first.requirement is None:
        return None
    found = first.requirement
    return {
        "speed": json_number(found.speed, "rad/s"),
        "mean_torque": json_number(found.mean_torque, "Nm"),
        "rms_torque": json_number(found.rms_torque, "Nm"),
        "peak_torque": json_number(found.peak_torque, "Nm"),
        "driving_share": json_number(found.driving_share, "1"),
        "braking_share": json_number(found.braking_share, "1"),
        "largest_inertia": json_number(found.largest_inertia, "kg m2"),
        "required_power": json_number(first.required_power, "W"),
    }


def _choice(first: LawSizing | None) -> dict[str, Any] | None:
    """Convert the choice of a motor; None without a catalogue."""
    if first is None or first.choice is None:
        return None
    choice = first.choice
    chosen, smaller = choice.chosen, choice.next_smaller
    return {
        "by": choice.by,
        "chosen": None if chosen is None else chosen.motor.name,
        "gear_ratio": None if chosen is None else chosen.gear_ratio,
        "inertia_ratio": None if chosen is None else chosen.inertia_ratio,
        "next_smaller": None if smaller is None else smaller.motor.name,
        "next_smaller_fails": [] if smaller is None else list(smaller.failures),
    }
