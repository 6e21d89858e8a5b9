"""Results of a study in a directory: the files that the scene requires, and summary.json last."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from compact import files, quantities
from compact.analysis import contact_cases
from compact.analysis.sizing.durations import DurationStudy
from compact.analysis.sizing.machine_sizing import MachineSizing
from compact.analysis.stages import drives, kept_results, uncertainty, verdict
from compact.analysis.stages.resistance import force_at
from compact.analysis.study import Study
from compact.analysis.worker_pool import Executor, SerialExecutor
from compact.machine.ranking import CRITERIA, value_of
from compact.report import contact_figures, figures, process, results
from compact.report.page import write_page
from compact.report.tables import TableSpec, json_number, json_numbers, json_values
from compact.rolling_contact import Contact, EquilibriumError, HeapingError, UnsteadyError
from compact.scene.loader import Scene

SCHEMA = 4  # of summary.json; raised when a key in it changes its meaning
MOTOR = (
    "by chosen=chosen.motor.name gear_ratio=chosen.gear_ratio inertia_ratio=chosen.inertia_ratio "
    "next_smaller=next_smaller.motor.name next_smaller_fails=next_smaller.failures"
)
FAILURES: dict[str, tuple[type[Exception], str]] = {  # by kind: error, and its numbers
    "heaping": (HeapingError, "depth_m wave_height_m travel_m contact_angle_rad"),
    "unsteady": (UnsteadyError, "depth_m wave_height_m travel_m distance load_N/m resistance_N/m"),
    "no_equilibrium": (EquilibriumError, ""),
}
HELD = {"height": "indentation_m", "load": "load_N/m", "peak_pressure": "peak_pressure_Pa"}


def write_study(
    study: Study, directory: Path | str, force: bool = False, executor: Executor | None = None
) -> dict[str, Any]:
    """Write the results of a study into a directory.

    Parameters
    ----------
    directory : Path or str
        Directory of the results; it is created where it is missing.
    force : bool
        Whether results of another scene are overwritten.
    executor : Executor, optional
        Executor of `analysis.worker_pool` for engines of the comparison and figures; this process by default.

    Raises
    ------
    ResultsError
        If a file cannot be written or the directory holds results of another scene.
    """
    items = study.scene.output.items
    claimed = files.claimed_directory(directory, study.scene.owner, force)
    with claimed as place, study.helped(executor or SerialExecutor()):
        contacts, written = study.stages.contacts, list[Path]()
        if contacts.speeds:
            written.append(results.contact_table(study).write(place / "contact.csv"))
        if contacts.compacts:
            standing = study.standing(place, "passes.csv", "density.csv")
            written += standing or results.write_tables(place, results.pass_tables(contacts.passes))
        study.begin_contacts()
        for item in (each for each in ("reactions", "cams", "crank") if each in items):
            written += results.write_tables(place, results.ITEMS[item](study))
        if "fields" in items and (standing := study.standing(place, "fields.pvd", "fields/", "fields.png")):
            written += standing
        elif "fields" in items:
            written += _write_layers(place, [(contacts.field_mesh(first), first) for _, first in contacts.first_passes])
            study.count("figures")
        kept = list(study.keep(place, written))  # after what needs no second pass
        drawn = {}
        for name, draw in (study_figures(study) if {"figures", "report"} & set(items) else {}).items():
            study.count("figures")
            drawn[name] = study.submit(_png, draw)
        if "tables" in items:
            written += results.write_tables(place, results.ITEMS["tables"](study))
        if study.over_durations is not None:
            written += results.write_tables(place, results.duration_tables(study.over_durations))
        pictures = {name: job.result() for name, job in drawn.items()}
        if "report" in items:
            written += _write_report(study, place, pictures)
        if "figures" in items:
            written += [files.write_bytes(place / f"{name}.png", picture) for name, picture in pictures.items()]
        list(study.keep(place, written))
        written += kept
        for name, other in study.comparison.items():
            if other.kept:  # contacts and map of a compared engine, for the next run
                written += kept_results.write_results(place / "comparison" / name, other.kept)
        summary = study_summary(study, [str(Path(file).relative_to(place)) for file in written])
        files.write_json(place / "summary.json", summary)
    return summary


def _png(draw: Callable[[], Figure]) -> bytes:
    """Draw a figure as the content of a PNG file."""
    return files.render_png(draw())


def write_contact(directory: Path, study: Study, speed: float, passes: Sequence[Contact]) -> None:
    """Write one contact: tractions, scalar results, figures, fields, and all passes of a compacting layer.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    passes : sequence of Contact
        Results of the passes in order; the tractions are those of the first.
    """
    first, stage, engine = passes[0], study.stages.contacts, study.scene.accuracy.engine
    values = first.x, first.pressure, first.shear_traction
    TableSpec.of_arrays("pressure", "x_m pressure_Pa shear_traction_Pa", values).write(directory / "pressure.csv")
    content = stage.record(speed, tuple(passes)).to_json()
    files.write_json(directory / "contact.json", content | {"replaced": list(study.scene.replacements[engine])})
    files.write_figure(directory / "pressure.png", contact_figures.draw_pressure(first, stage.exact, speed))
    if stage.compacts:
        results.write_tables(directory, results.pass_tables([(speed, passes)]))
    if stage.engine.has_fields:
        list(_write_layers(directory, [(stage.field_mesh(first), first)]))


def _write_layers(directory: Path, layers: list[tuple[Any, Any]]) -> Iterator[Path]:
    """Write the fields of contacts, pairs of mesh and result, as VTU files and as a figure."""
    frames = ((contact.speed, mesh) for mesh, contact in layers)
    yield from files.write_vtu_series(directory / "fields.pvd", "fields", "speed", frames)
    yield files.write_figure(directory / "fields.png", contact_figures.draw_fields(layers))


def _write_report(study: Study, directory: Path, pictures: Mapping[str, bytes]) -> Iterator[Path]:
    """Write the pressure along the contact, or the section of a process, and the page."""
    study.count("report")
    stage = study.stages.contacts
    if standing := study.standing(directory, "pressure.png"):
        pressure = standing[0]
    elif stage.process is not None:
        pressure = files.write_figure(directory / "section.png", process.draw_section(stage.process))
    else:
        speed, contact = stage.typical
        pressure = files.write_figure(
            directory / "pressure.png", contact_figures.draw_pressure(contact, stage.exact, speed)
        )
    found = {pressure.stem: pressure.read_bytes(), **pictures}
    if "fields" in study.scene.output.items:
        found["fields"] = (directory / "fields.png").read_bytes()
    yield pressure
    yield write_page(directory / "report.html", study, found)


def study_figures(study: Study) -> dict[str, Callable[[], Figure]]:
    """List the figures of a study by name."""
    drive, cycles = study.stages.drive, study.stages.laws.cycles
    places, first = drive.places[study.scene.drive.kind], study.machine_sizing.first
    force = study.stages.resistance
    found: dict[str, Callable[[], Figure]] = {}
    if study.stages.contacts.speeds:
        peak = float(np.median([cycle.forward.peaks().acceleration for cycle in cycles.values()]))
        found["resistance"] = partial(contact_figures.draw_resistance, force.map, peak)
    along = force.over_cycle(cycles[drive.best_law].forward)
    found["stroke"] = partial(figures.draw_stroke, *along, drive.best_law)
    if first is not None and first.requirement is not None:
        found["shaft"] = partial(figures.draw_shaft_torque, first, study.machine_sizing.rule)
    if study.over_durations is not None:
        found["duration"] = partial(figures.draw_durations, study.over_durations, study.scene.motion.duration)
    if study.verdicts:
        speeds = {law: cycles[law].forward.peaks().velocity for law in study.best_laws}
        found["models"] = partial(contact_figures.draw_models, study.models, speeds)
        found["best_cycles"] = partial(figures.draw_best_cycles, {law: drive.runs[law] for law in study.best_laws})
    return found | {"ranking": partial(figures.draw_rankings, places)}


def study_summary(study: Study, written: list[str]) -> dict[str, Any]:
    """Build the content of summary.json.

    Parameters
    ----------
    written : list of str
        Paths of its files, relative to the directory of the results.
    """
    scene, stages, sizing, known = study.scene, study.stages, study.machine_sizing, study.uncertainty
    contacts, steady, durations = stages.contacts, stages.resistance.steady, study.over_durations
    force, guides = float(steady.drive_force[0]), float(steady.guide_friction[0])
    forces = {"drive_force": force, "resistance": force - guides, "guide_friction": guides}
    resistance = {"by": scene.accuracy.engine if contacts.speeds else "eq 1.8"}
    if contacts.speeds:
        names = "speeds error_between_speeds=error engine_error added_masses relaxation_time"
        resistance |= json_values(stages.resistance.map, names) | {"kept": contacts.kept is not None}
    ratios = json_numbers(contacts.second_pass, "second_pass_load=0 second_pass_resistance=1")
    spread = study.model_spread
    return {
        "schema": SCHEMA,
        "title": scene.title,
        "scene_hash": scene.hash,
        "versions": files.versions(),
        "engine": scene.accuracy.engine,
        "drive_resistance": resistance,
        "held": _held(contacts.held),
        "return_stroke": {"over": scene.layer.return_stroke} | ratios,
        "pore_air": _pore_air(study),
        "model_spread": None if spread is None else _model_spread(spread),
        "steady_forces": {name: json_number(value, "N") for name, value in forces.items()},
        "over_durations": None if durations is None else _over_durations(durations),
        "machine_sizing": sizing_numbers(sizing),
        "work_balance": {"law": study.work_balance.law} | json_numbers(study.work_balance, results.WORK_BALANCE),
        "verdict": None if known is None else _verdict(study, known),
        "robust_laws": {name: _robust_law(scene, found) for name, found in stages.laws.robust.items()} or None,
        "decision": results.decision_numbers(study),
        "inputs": results.input_numbers(scene),
        "advice": list(scene.advice),
        "replaced": {engine: list(sentences) for engine, sentences in scene.replacements.items() if sentences},
        "reachable": {"density_achievable": not contacts.mix.not_achievable, "reason": contacts.mix.not_achievable},
        "numbers": {name: asdict(number) for name, number in contacts.numbers.items()},
        "contacts": [contact.to_json() for contact in contacts.records],
        "laws": {name: _run_numbers(study, run) for name, run in stages.drive.runs.items()},
        "laws_not_made": stages.laws.not_made,
        "rankings": _rankings(stages.drive.places[scene.drive.kind]),
        "rigid_rankings": _rankings(stages.drive.places.get("rigid", {})),
        "comparison": {
            name: {
                "contacts": [contact.to_json() for contact in other.records],
                "held": _held(other.kept.held if other.kept else None),
                "resistance_error": other.error,
                "roller_load": json_number(other.roller_load, "N"),
                "rankings": {kind: _rankings(order) for kind, order in study.places_by_engine[name].items()},
                "evaluation_counts": dict(other.counts),
            }
            for name, other in study.comparison.items()
        },
        **{kind: _failures(study, kind) for kind in FAILURES},
        "units": {name: quantity.unit for name, quantity in (quantities.CRITERIA | quantities.RUN).items()},
        "evaluation_counts": dict(study.counts),
        "files": written,
    }


def _failures(study: Study, kind: str) -> dict[str, dict[str, Any]]:
    """Convert the engines of the comparison without a steady state of one kind, by name."""
    error_type, names = FAILURES[kind]
    found = {}
    for name, error in study.failures.items():
        if isinstance(error, error_type):
            numbers: Any = getattr(error, kind, None)
            estimated = {"is_estimate": numbers.travel is None} if isinstance(error, HeapingError) else {}
            found[name] = json_numbers(numbers, names) | estimated | {"reason": str(error)}
    return found


def _held(held: contact_cases.HeldQuantity | None) -> dict[str, Any] | None:
    """Convert the quantity that is held constant over speed."""
    if held is None:
        return None
    return {"quantity": held.name} | json_numbers(held, f"{HELD[held.name]}=value found_at_m/s=speed")


def _pore_air(study: Study) -> dict[str, Any] | None:
    """Convert the numbers on the pore air; None where the layer has none."""
    air, curve = study.pore_air, study.stages.contacts.air_curve
    if air is None or curve is None:
        return None
    ends = "value=permeability.value low=permeability.low high=permeability.high"
    speeds = "value=deaeration_speeds.0 low=deaeration_speeds.1 high=deaeration_speeds.2"
    return {
        "model": study.scene.mix.pore_air,
        "air_permeability": json_values(air, ends) | {"unit": "m2"},
        "deaeration_speed": json_values(air, speeds) | {"unit": "m/s"},
        **json_numbers(
            air, "load_share=shares.0 resistance_share=shares.1 undrained_load_share=undrained_shares.0 "
            "undrained_resistance_share=undrained_shares.1 excess_behind_Pa=at_mean_speed.excess_behind "
            "tensile_strength_Pa",
        ),
        "coupled": [asdict(each) for each in curve.coupled],
    }  # fmt: skip


def _model_spread(spread: verdict.ModelSpread) -> dict[str, Any]:
    """Convert the contacts by the other laws of the mix."""
    own = "load resistance cohesion_loose_Pa saturation_limit"
    bands = {"load": spread.load, "resistance": spread.resistance}
    found: dict[str, Any] = {name: {"low": low, "high": high, "unit": "1"} for name, (low, high) in bands.items()}
    return found | {"variants": [asdict(each) | json_numbers(each, own) for each in spread.variants]}


def _verdict(study: Study, known: uncertainty.RankingUncertainty) -> dict[str, Any]:
    """Convert models, verdicts and their uncertainty."""
    models = []
    for each in study.models:
        forces = {f"{time:g}": json_number(force, "N") for time, force in each.mean_resistance.items()}
        models.append(json_values(each, "engine sizing=valid resistance_error=error law_spread=spread"))
        models[-1]["mean_resistance"] = forces
    verdicts = study.verdicts.values()
    return {
        "models": models,
        "verdicts": [asdict(each) | {"value": json_number(each.value, CRITERIA[each.by].unit)} for each in verdicts],
        "governing": [each._asdict() for each in study.governing],
        "margins": {by: known.margin(by) for by in known.laws},
        "sources": [asdict(each) for each in known.sources],
        "mix": known.mix and asdict(known.mix),
    }


def _robust_law(scene: Scene, found: Any) -> dict[str, Any]:
    """Convert a robust law: its worst peak and that of the best published law, each with its drive, and the range."""
    plants, unit = found.plants, CRITERIA[found.objective.removeprefix("robust_")].unit
    resistances = (*plants.resistances, *plants.inner)

    def worst(drive: Any) -> dict[str, Any]:
        resistance = resistances[drive.resistance]
        sides = [getattr(resistance, side, None) for side in ("forward", "backward")]
        return {
            "peak": json_number(drive.peak, unit),
            **json_numbers(drive, "stiffness_N/m damping_ratio"),
            "force_at_mean_speed": json_number(force_at(resistance, scene.mean_speed), "N"),
            "own_tracks": json_number([each.distance for each in sides if each is not None], "m"),
        }

    return {
        "objective": found.objective, "worst": worst(found.worst), "mean": json_number(found.mean, unit),
        "range": {
            "stiffness": json_number(list(plants.stiffness), "N/m"),
            "damping_ratio": json_number(list(plants.damping_ratio), "1"), "resistances": len(resistances),
        },
        "gap": found.gap, "drives": found.drives, "gains": found.gains,
        "best_published": {"law": found.published} | worst(found.published_worst),
    }  # fmt: skip


def _over_durations(found: DurationStudy) -> dict[str, Any]:
    """Convert the first laws over the duration, and where they change."""
    return {
        by: {
            "unit": CRITERIA[by].unit,
            "first": [
                {"duration": duration} | json_values(order[0], "law=run.name value margin")
                for duration, order in zip(found.durations, orders, strict=True)
            ],
            "crossovers": [
                json_values(each, "duration shorter longer value") for each in found.crossovers if each.by == by
            ],
        }
        for by, orders in found.orders.items()
    }


def sizing_numbers(sizing: MachineSizing) -> dict[str, Any]:
    """Convert shaft, motor, wheel loads and lives of bearings of the first law to the content of summary.json."""
    first, motor = sizing.first, None
    if first is not None and first.choice is not None:
        motor = json_values(first.choice, MOTOR)
        motor["next_smaller_fails"] = list(motor["next_smaller_fails"] or ())
    return {
        "law": sizing.first_law,
        "margin": sizing.rule.margin,
        "efficiency": sizing.rule.efficiency,
        "shaft": json_numbers(first, results.SHAFT) if first is not None and first.requirement is not None else None,
        "motor": motor,
        "wheels": {
            wheel.name: json_numbers(wheel, "least_N largest_N") | ({"engine": wheel.engine} if sizing.compared else {})
            for wheel in sizing.wheels
        },
        "bearings": {
            name: json_numbers(life, "equivalent_load_N hours_h")
            | {"life": json_number(life.million_revolutions * 1e6, "1"), "valid": life.valid}
            for name, life in sizing.lives.items()
        },
    }


def _run_numbers(study: Study, run: Any) -> dict[str, Any]:
    """Convert the criteria of a run, their errors and the quantities of its kind of drive."""
    own = [name for name in quantities.RUN if name != "unsteady_share" and hasattr(run, name)]
    content = {by: value_of(run, by) for by in CRITERIA} | {name: getattr(run, name) for name in own}
    if study.stages.contacts.speeds:
        content["unsteady_share"] = run.time_fraction(study.stages.resistance.map.is_unsteady)
    heavier = study.stages.drive.heavier_runs  # None where the error of the resistance is unknown
    heavy = heavier and heavier.get(run.name)
    errors = {by: None if heavier is None else drives.error(run, heavy, by) for by in CRITERIA}
    return content | {"errors": errors}


def _rankings(orders: Mapping[str, Iterable[drives.Place]]) -> dict[str, list[dict[str, Any]]]:
    """Convert the places by criterion; `reason` is of infinite values only."""
    names = "rank law value margin error resolved tie"
    return {
        by: [json_values(each, names) | ({"reason": each.reason} if each.reason else {}) for each in found]
        for by, found in orders.items()
    }
