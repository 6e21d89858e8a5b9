"""The content of summary.json: the results of a finished study as dictionaries with values, units and errors.

Numbers become dictionaries here and in `contact_to_json`, and nowhere else.
"""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from compact import quantities
from compact.analysis.contact_cases import HeldQuantity, contact_to_json
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.sizing.work_balance import WorkBalance
from compact.analysis.stages.model_spread import ModelSpread
from compact.analysis.study import Study
from compact.machine.ranking import CRITERIA, value_of
from compact.report import drive_tables, ranking_tables
from compact.report.sizing.duration_tables import duration_numbers
from compact.report.sizing.machine_tables import sizing_numbers
from compact.report.tables import json_number
from compact.rolling_contact import HeapingError, UnsteadyError

SCHEMA = 3  # of summary.json; raised when a key in it changes its meaning
PACKAGES = ("compact", "numpy", "scipy")  # whose versions are recorded
WORK_BALANCE_UNITS = {
    "pass_work": "J/m3", "confined_work": "J/m3", "work_ratio": "1", "loose_work": "J/m3", "cycle_work": "J",
    "pressed_volume": "m3", "carried_volume": "m3", "feed_ratio": "1", "strokes_on_section": "1",
    "throughput_work": "J/m3", "explained_share": "1",
}  # fmt: skip
HELD_KEYS = {"height": ("indentation", "m"), "load": ("load", "N/m"), "peak_pressure": ("peak_pressure", "Pa")}


def study_summary(study: Study, files: list[str]) -> dict[str, Any]:
    """Build the content of summary.json.

    Parameters
    ----------
    files : list of str
        Paths of its files, relative to the directory of the results.
    """
    scene = study.scene
    reach = study.mix.density_achievable
    return {
        "schema": SCHEMA,
        "title": scene.title,
        "scene_hash": scene.hash,
        "versions": versions(),
        "engine": scene.accuracy.engine,
        "drive_resistance": _drive_resistance(study),
        "held": _held(study.stages.contacts.held),
        "return_stroke": _return_stroke(study),
        "pore_air": _pore_air(study),
        "model_spread": _model_spread(study.model_spread),
        "steady_forces": _steady_forces(study),
        "over_durations": duration_numbers(study.over_durations),
        "machine_sizing": sizing_numbers(study.machine_sizing),
        "work_balance": _work_balance(study.work_balance),
        "verdict": _verdict(study),
        "advice": list(scene.advice),
        "replaced": {engine: list(sentences) for engine, sentences in scene.replacements.items() if sentences},
        "reachable": {"density_achievable": reach.possible, "reason": reach.reason},
        "numbers": {name: asdict(number) for name, number in study.stages.contacts.numbers.items()},
        "contacts": [contact_to_json(contact) for contact in study.contacts],
        "laws": {name: _run_numbers(study, run) for name, run in study.runs.items()},
        "laws_not_made": study.stages.laws.not_made,
        "rankings": _rankings(study.stages.drive.places[scene.drive.kind]),
        "rigid_rankings": _rankings(study.stages.drive.places.get("rigid", {})),
        "roller_motors": drive_tables.roller_motor_numbers(study) if "cams" in scene.output.items else {},
        "comparison": _comparison(study),
        "heaping": {name: _heaping(error) for name, error in study.heaping.items()},
        "unsteady": {name: _unsteady(error) for name, error in study.unsteady.items()},
        "no_equilibrium": {name: {"reason": str(error)} for name, error in study.without_equilibrium.items()},
        "units": {name: quantity.unit for name, quantity in (quantities.CRITERIA | quantities.RUN).items()},
        "evaluation_counts": dict(study.counts),
        "files": files,
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of PACKAGES by name."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def _held(held: HeldQuantity | None) -> dict[str, Any] | None:
    """Convert the quantity that is held constant over speed."""
    if held is None:
        return None
    key, unit = HELD_KEYS[held.name]
    return {"quantity": held.name, key: json_number(held.value, unit), "found_at": json_number(held.speed, "m/s")}


def _drive_resistance(study: Study) -> dict[str, Any]:
    """Convert the resistance to the cart and its error estimates."""
    if not study.stages.contacts.engine.layered:
        return {"by": "eq 1.8"}
    resistance_map = study.stages.resistance.map
    return {
        "by": study.scene.accuracy.engine,
        "speeds": resistance_map.speeds,
        "error_between_speeds": resistance_map.error,
        "engine_error": resistance_map.engine_error,
        "added_masses": resistance_map.added_masses,
        "relaxation_time": resistance_map.relaxation_time,
        "kept": study.stages.contacts.kept is not None,
    }


def _return_stroke(study: Study) -> dict[str, Any]:
    """Convert the state of the mix under the return stroke, the ratios of a second pass and the energy of a cycle."""
    load, resistance = study.stages.contacts.second_pass or (None, None)
    return {
        "over": study.scene.layer.return_stroke,
        "second_pass_load": json_number(load, "1"),
        "second_pass_resistance": json_number(resistance, "1"),
        "energy": {over: json_number(energy, "J") for over, energy in study.stages.drive.cycle_energies.items()},
    }


def _pore_air(study: Study) -> dict[str, Any] | None:
    """Convert the numbers on the pore air; None where the layer has none."""
    air = study.pore_air
    if air is None:
        return None
    permeability, (value, low, high) = air.permeability, air.deaeration_speeds
    load, resistance = air.shares
    curve = study.stages.contacts.air_curve
    return {
        "model": study.scene.mix.pore_air,
        "air_permeability": json_number(permeability.value, "m2")
        | {"low": permeability.low, "high": permeability.high},
        "deaeration_speed": json_number(value, "m/s") | {"low": low, "high": high},
        "load_share": json_number(load, "1"),
        "resistance_share": json_number(resistance, "1"),
        "excess_behind": json_number(air.at_mean_speed.excess_behind, "Pa"),
        "tensile_strength": json_number(air.tensile_strength, "Pa"),
        "coupled": [asdict(each) for each in curve.coupled] if curve else [],
    }


def _model_spread(spread: ModelSpread | None) -> dict[str, Any] | None:
    """Convert the contacts by the other laws of the mix; None where they are not required."""
    if spread is None:
        return None
    bands = {"load": spread.load, "resistance": spread.resistance}
    return {
        **{name: {"low": low, "high": high, "unit": "1"} for name, (low, high) in bands.items()},
        "variants": [
            asdict(each)
            | {name: json_number(getattr(each, name), "1") for name in bands}
            | {"cohesion_loose": json_number(each.cohesion_loose, "Pa")}
            for each in spread.variants
        ],
    }


def _verdict(study: Study) -> dict[str, Any] | None:
    """Convert models, verdicts and their uncertainty; None for a scene without the output "report"."""
    known = study.uncertainty
    if known is None:
        return None
    models = [
        {
            "engine": each.engine,
            "sizing": each.valid,
            "mean_resistance": {
                f"{duration:g}": json_number(force, "N") for duration, force in each.mean_resistance.items()
            },
            "resistance_error": each.error,
            "law_spread": each.spread,
        }
        for each in study.models
    ]
    verdicts = [
        {key: value for key, value in asdict(each).items() if key != "value"}
        | {"value": json_number(each.value, CRITERIA[each.by].unit)}
        for each in study.verdicts.values()
    ]
    sources = [asdict(each) for each in known.sources]
    margins = {by: known.margin(by) for by in known.peaks}
    mix = None if known.mix is None else asdict(known.mix)
    return {"models": models, "verdicts": verdicts, "margins": margins, "sources": sources, "mix": mix}


def _steady_forces(study: Study) -> dict[str, Any]:
    """Convert the forces on one cart at constant mean speed."""
    force, guides = (
        float(each[0])
        for each in (study.stages.resistance.steady.drive_force, study.stages.resistance.steady.guide_friction)
    )
    forces = {"drive_force": force, "resistance": force - guides, "guide_friction": guides}
    return {name: json_number(value, "N") for name, value in forces.items()}


def _work_balance(balance: WorkBalance) -> dict[str, Any]:
    """Convert the balances of work and mix; those of the throughput are None without the speed of the mould."""
    return {"law": balance.law} | {
        name: json_number(getattr(balance, name), unit) for name, unit in WORK_BALANCE_UNITS.items()
    }


def _run_numbers(study: Study, run: Any) -> dict[str, Any]:
    """Convert the criteria of a run, their errors and the quantities of its kind of drive."""
    own = [name for name in quantities.RUN if name != "unsteady_share" and hasattr(run, name)]
    unsteady = (
        {"unsteady_share": run.time_fraction(study.stages.resistance.map.is_unsteady)}
        if study.stages.contacts.engine.layered
        else {}
    )
    errors = {"errors": {by: ranking_tables.criterion_error(study, run, by) for by in CRITERIA}}
    criteria = {by: value_of(run, by) for by in CRITERIA}
    return criteria | {name: getattr(run, name) for name in own} | unsteady | errors


def _comparison(study: Study) -> dict[str, Any]:
    """Convert the results of each engine of the comparison."""
    agreed = study.agreements if study.comparison else []
    return {
        name: {
            "contacts": [contact_to_json(contact) for contact in other.records],
            "held": _held(other.held),
            "resistance_error": other.error,
            "roller_load": json_number(other.roller_load, "N"),
            "rankings": {kind: _rankings(order) for kind, order in other.places.items()},
            "agreement": [
                {"drive": each.drive, "criterion": each.by, **each.agreement._asdict()}
                | {"first": each.first, "other_first": each.other_first}
                for each in agreed
                if each.other_engine == name
            ],
            "evaluation_counts": dict(other.counts),
        }
        for name, other in study.comparison.items()
    }


def _heaping(error: HeapingError) -> dict[str, Any]:
    """Convert an engine by which the mix has no steady state."""
    found = error.heaping
    return {
        "depth": json_number(found.depth, "m"),
        "wave_height": json_number(found.wave_height, "m"),
        "travel": json_number(found.travel, "m"),
        "contact_angle": json_number(found.contact_angle, "rad"),
        "is_estimate": found.travel is None,
        "reason": str(error),
    }


def _unsteady(error: UnsteadyError) -> dict[str, Any]:
    """Convert an engine by which the motion does not become steady."""
    found = error.unsteady
    return {
        "depth": json_number(found.depth, "m"),
        "wave_height": json_number(found.wave_height, "m"),
        "travel": json_number(found.travel, "m"),
        "distance": json_number(found.distance, "1"),
        "load": json_number(found.load, "N/m"),
        "resistance": json_number(found.resistance, "N/m"),
        "reason": str(error),
    }


def _rankings(order: Mapping[str, Iterable[Place]]) -> dict[str, list[dict[str, Any]]]:
    """Convert the places by criterion."""
    return {by: [_place(place) for place in found] for by, found in order.items()}


def _place(place: Place) -> dict[str, Any]:
    """Convert a place; `reason` is for infinite values only."""
    content = place._asdict() | {"tie": place.tie}
    if not place.reason:
        del content["reason"]
    return content
