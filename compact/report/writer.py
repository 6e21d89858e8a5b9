"""Results of a study in a directory: the files that the scene requires, and summary.json last."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from compact.analysis.study import Study
from compact.analysis.worker_pool import Executor, SerialExecutor
from compact.files import claimed_directory, render_png, write_bytes, write_json
from compact.report import contact_tables, drive_tables, machine_tables, ranking_tables
from compact.report.sizing import duration_tables
from compact.report.sizing import machine_tables as sizing_tables
from compact.report.summary import study_summary, versions


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
        Executor of `analysis.worker_pool` for the engines of the comparison; this process by default.

    Raises
    ------
    ResultsError
        If a file cannot be written or the directory holds results of another scene.
    """
    items = study.scene.output.items
    with claimed_directory(directory, study.scene.hash, force) as place, study.helped(executor or SerialExecutor()):
        files = list(contact_tables.write_contact_tables(study, place)) if study.stages.contacts.engine.layered else []
        study.begin_model_spread()
        kept = list(study.keep(place, files)) if study.stages.contacts.engine.layered else []
        for item, write in WRITERS.items():
            if item in items:
                files += write(study, place)
        pictures = _draw(study) if {"figures", "report"} & set(items) else {}
        if "tables" in items:
            files += machine_tables.write_law_tables(study, place)
            files += drive_tables.write_drive_tables(study, place)
            files += ranking_tables.write_ranking_tables(study, place)
            files += sizing_tables.write_sizing(study.machine_sizing, place)
        if study.over_durations is not None:
            files += duration_tables.write_durations(study.over_durations, place)
        if "report" in items:
            files += _write_report(study, place, pictures)
        if "figures" in items:
            files += [write_bytes(place / f"{name}.png", picture) for name, picture in pictures.items()]
        if study.stages.contacts.engine.layered:
            list(study.keep(place, files))
        files += [*kept, *ranking_tables.save_comparisons(study, place)]
        summary = study_summary(study, [str(Path(file).relative_to(place)) for file in files])
        write_json(place / "summary.json", summary)
    return summary


def _write_fields(study: Study, directory: Path) -> Iterator[Path]:
    if standing := study.standing(directory, "fields.pvd", "fields/", "fields.png"):
        yield from standing
    else:
        yield from contact_tables.write_fields(directory, study.stages.contacts.fields)
        study.count("figures")


WRITERS: dict[str, Callable[[Study, Path], Iterator[Path]]] = {  # of items that need no engine of the comparison
    "reactions": machine_tables.write_reactions,
    "cams": machine_tables.write_cams,
    "crank": machine_tables.write_crank,
    "fields": _write_fields,
}


def _write_report(study: Study, directory: Path, pictures: Mapping[str, bytes]) -> Iterator[Path]:
    from compact.report.page.writer import write_page

    study.count("report")
    items = study.scene.output.items
    pressure = contact_tables.write_pressure_figure(study, directory)
    found = {pressure.stem: pressure.read_bytes(), **pictures}
    if "fields" in items:
        found["fields"] = (directory / "fields.png").read_bytes()
    yield pressure
    yield write_page(directory / "report.html", study, found, versions())


def _draw(study: Study) -> dict[str, bytes]:
    """Draw the figures of a study, PNG files by name."""
    pictures = {}
    for name, (figure, *results) in _figures(study).items():
        study.count("figures")
        pictures[name] = render_png(figure(*results))
    return pictures


def _figures(study: Study) -> dict[str, tuple[Any, ...]]:
    """List the figures of a study: function and results by name."""
    from compact.report.figures import answer, contact, motion, ranking, sizing

    items, places = study.scene.output.items, study.stages.drive.places[study.scene.drive.kind]
    found: dict[str, tuple[Any, ...]] = {
        "kinematics": (motion.draw_kinematics, study.cycles),
        "drive": (motion.draw_drive, study.runs),
    }
    if "reactions" in items:
        by_rod = (name for name, run in study.runs.items() if run.state.rod_tangent.any())
        names = list(dict.fromkeys([study.stages.drive.best_law, *by_rod]))
        found["reactions"] = (motion.draw_reactions, study.runs, names)
    if "cams" in items:
        found["cams"] = (motion.draw_cams, study.stages.laws.cams, list(study.cycles), "roller")
    if "crank" in items:
        found["crank"] = (motion.draw_crank_turns, study.stages.drive.turns)
    if study.stages.contacts.engine.layered:
        peaks = [cycle.forward.peaks().acceleration for cycle in study.cycles.values()]
        resistances: dict[str, Any] = {study.scene.accuracy.engine: study.resistance}
        resistances |= {name: other.resistance for name, other in study.comparison.items()}
        found["contact"] = (contact.draw_loads, study.contacts)
        found["resistance"] = (contact.draw_resistance, study.stages.resistance.map, float(np.median(peaks)))
        found["resistances"] = (ranking.draw_resistances, resistances)
        found["engines"] = (ranking.draw_engines, study.places_by_engine)
    first = study.machine_sizing.first
    if first is not None and first.requirement is not None:
        found["shaft"] = (sizing.draw_shaft_torque, first, study.machine_sizing.rule)
    if study.over_durations is not None:
        found["duration"] = (sizing.draw_durations, study.over_durations, study.scene.motion.duration)
    if "report" in items and study.verdicts:
        best = study.best_laws
        speeds = {law: study.cycles[law].forward.peaks().velocity for law in best}
        forces: dict[str, Any] = {study.scene.accuracy.engine: study.resistance}
        forces |= {name: other.resistance for name, other in study.comparison.items()}
        found["models"] = (answer.draw_models, study.models, forces, speeds)
        found["best_cycles"] = (answer.draw_best_cycles, {law: study.runs[law] for law in best})
    comparisons = {by: ranking_tables.comparison_places(study, study.scene.drive.kind, by) for by in places}
    found["ranking"] = (ranking.draw_rankings, places, comparisons)
    return found
