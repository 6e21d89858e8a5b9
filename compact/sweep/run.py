"""Sweep of a scene over some of its keys, with checkpoints, in one labelled table.

    sweep = Sweep(load_scene("scene.toml"), [read_design("mix.moisture=0.08:0.12:5")])
    table = sweep.run("out/sweep", executor=ProcessExecutor(2))
    table["resistance"]

`table` is an xarray Dataset over the varied keys, also written as sweep.nc. A point that fails has nan and a reason.
The division of the points into tasks does not depend on the number of workers; therefore one process, several processes
and a cluster produce the same bits. The key of a checkpoint is the hash of scene, changes, files that these name,
versions and sources; if any of them changes, the point is computed again.

An engine with continuation uses each point as initial guess of its neighbour along the last axis, LINE points from each
computation from scratch. Such a line is one task, which is computed again if it was interrupted.
"""

import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from compact import files, quantities
from compact.analysis import contact_cases, failures, operating_window, pore_air, worker_pool
from compact.analysis.stages.ensemble import START, Change, Share, Step, Store, ensemble, open_store
from compact.analysis.study import Study
from compact.engines import ENGINES
from compact.material import mix
from compact.quantities import SWEEP_POINT, Quantity
from compact.rolling_contact import Contact
from compact.scene import constraints, loader, schema
from compact.sweep.design import Axis, Sampled, design, varied_engines

if TYPE_CHECKING:
    import xarray

LINE = 8  # neighbours of an engine with continuation from one computation from scratch to the next
POINTS_PER_RANKING = 100  # [-], points without a ranking in the time of one ranking
POINTS = "points"  # directory of the checkpoints, in that of the results
WORDS = {
    "not_reachable": "reason why rolling does not achieve the density; empty if it does",
    "warnings": "warnings of the computation",
    "replaced": "keys with a default that the engine replaced by the nearest value it accepts",
    "reason": "reason of a failure; empty for a point with results",
}
SHAPE = ("capture_angle", "contact_length")
RECORDED = ("contact_length", "peak_pressure", "load_error", "resistance_error", "work_residual", "mass_residual")

Results = dict[str, Any]  # of a point by name
Evaluate = Callable[..., dict[int, Results]]  # `ensemble` of the scene and run of a sweep


def headline(rank: bool, scene: loader.Scene, change: Change, lifts: Any = None) -> Results:
    """Compute the results of one point, with errors and balance residuals; an error is also a result.

    Parameters
    ----------
    rank : bool
        Whether the motion laws are ranked.
    scene : Scene
        Scene of the point; its contact is that at the mean speed.
    change : Change
        Sampled keys, and the contact of a neighbour for engines with continuation over the same layer.
    lifts : KnownLifts, optional
        Lumped lifts of a forming process for all points of its operating window.

    Returns
    -------
    dict
        Values of `quantities.SWEEP_POINT` and WORDS, sampled parameters, with `rank` value and first law by each
        criterion, and the contact for the next point. A point that fails has those of its mix only, and the reason.
    """
    sampled = [key.rpartition(".")[2] for key, value in change.keys.items() if isinstance(value, Share)]
    found: Results = {name: getattr(scene.mix.overrides, name) for name in sampled}
    contact = change.start
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # an invalid operation of numpy yields no valid result
        try:
            study = Study(scene)
            contacts = study.stages.contacts
            if lifts is not None and contacts.process is not None:
                contacts.process = replace(contacts.process, known=lifts)
            found["required_pressure"] = float(contacts.mix.required_pressure)
            found["saturation"] = float(contacts.mix.saturation)
            found["not_reachable"] = contacts.mix.not_achievable
            numbers, contact = _computed(study, change.start)
            if contacts.process is not None:
                numbers["limit"] = operating_window.limits_met(contacts.process)
            numbers["power"] = numbers["resistance"] * scene.mean_speed
            for by, (best, *_) in study.stages.drive.rankings.items() if rank else ():
                numbers |= {by: best.value, f"best_law_by_{by}": best.run.name}
            found |= {name: each if isinstance(each, str) else float(each) for name, each in numbers.items()}
        except Exception as error:  # a failed point does not stop a sweep
            found["reason"] = failures.reason_of(error)
    replaced = *constraints.adapt(scene, scene.accuracy.engine)[1], scene.mix.fit_remark
    found["replaced"] = "; ".join(filter(None, replaced))
    found["warnings"] = "; ".join(dict.fromkeys(str(warning.message) for warning in warned))[: failures.MAX_REASON]
    return found | {START: ENGINES[scene.accuracy.engine].as_start(contact)}


def _computed(study: Study, initial_guess: Contact | None) -> tuple[Results, Contact | None]:
    """Return the results of the first pass at the mean speed, and its contact; None for eqs 1.4-1.8.

    The contact starts from the initial guess if that converges, else from scratch.
    """
    contacts, scene, machine, speed = study.stages.contacts, study.scene, study.scene.machine, study.scene.mean_speed
    if not contacts.speeds:
        formulas = contacts.engineering
        return {name: getattr(formulas, name) for name in ("resistance_coefficient", *SHAPE)} | {
            "load": formulas.roller_force,
            "resistance": machine.rollers * formulas.roller_resistance,
            "peak_pressure": formulas.pressure,
        }, None
    passes: contact_cases.Passes = ()
    if initial_guess is not None and scene.layer.passes == 1:
        with suppress(RuntimeError):
            passes = contacts.roll(speed, (initial_guess,))
    passes = passes or contacts.roll(speed)
    first = passes[0]
    if pore_air.is_coupled(scene):
        fed = pore_air.pore_air_of(contacts.mix, scene.layer.fed_density_ratio)
        air: Any = pore_air.coupled_contact(first, fed, speed).changes
    else:
        air = contacts.air_forces_of(first, speed)
    record = contact_cases.contact_record(scene.accuracy.engine, speed, passes, air)
    known = {name: getattr(record, name) for name in RECORDED} | {
        "load": machine.roller_length * record.load,
        "resistance": machine.rollers * machine.roller_length * record.resistance + contacts.sleeve_drag,
        "resistance_coefficient": record.coefficient,
        "capture_angle": np.arcsin(first.leading / machine.roller_radius),
        "exit_density_ratio": passes[-1].exit_density_ratio,
    }
    return {name: np.nan if value is None else value for name, value in known.items()}, first


class Sweep:
    """Sweep of a scene.

    Parameters
    ----------
    rank : bool
        Whether the motion laws are ranked at every point, by the criteria of the scene.

    Attributes
    ----------
    size, steps : int
        Number of points, and of those that `run` announces to `step`.
    store : Store
        Checkpoints of the last `run`.
    """

    def __init__(
        self, scene: loader.Scene, varied: Sequence[Axis | Sampled], *, rank: bool = False, indices: bool = False
    ) -> None:
        self.scene, self.rank = scene, rank
        self.design = design(scene, varied, indices)
        self.engines = varied_engines(scene, self.design.axes)
        self.size = self.steps = int(np.prod(self.design.shape))
        self.store = Store()

    def run(
        self,
        directory: Path | str,
        *,
        executor: worker_pool.Executor,
        resume: bool = False,
        force: bool = False,
        step: Step = lambda *_: None,
    ) -> "xarray.Dataset":
        """Compute the missing points, and write checkpoints and sweep.nc.

        Parameters
        ----------
        resume : bool
            Whether existing checkpoints are used.
        force : bool
            Whether existing checkpoints are deleted.
        step : callable
            Called with the numbers of new points and of failures among them.

        Raises
        ------
        ResultsError
            If the directory has checkpoints, and neither `resume` nor `force` is set.
        """
        names = [each for name in self.engines for each in (name, ENGINES[name].low_fidelity) if each]
        base = files.results_key(self.scene.hash, [ENGINES[name].source for name in names], self.rank)
        with (
            files.claimed_directory(directory, self.scene.owner, force) as place,
            open_store(place / POINTS, base, resume, force) as self.store,
            executor,
        ):
            run = partial(headline, self.rank)
            if not self.design.names and all(ENGINES[engine].reads("process") for engine in self.engines):
                lifts = operating_window.shared_lifts(self.scene, [axis.key for axis in self.design.axes])
                run = partial(run, lifts=lifts)  # of an operating window, which its points share
            given: dict[str, Any] = {"run": run, "executor": executor, "store": self.store, "step": step}
            found = self._results(partial(ensemble, self.scene, **given))
            table = self._table([found[number] for number in range(self.size)])
            files.write_netcdf(place / "sweep.nc", table, files.NETCDF_HDF5)
        return table

    def _results(self, evaluated: Evaluate) -> dict[int, Results]:
        """Return the results of all points by number; neighbours of an engine with continuation are a task."""
        size, row = min(ENGINES[engine].points_per_task for engine in self.engines), self.design.shape[-1]
        if self.rank:
            size = max(1, size // POINTS_PER_RANKING)
        if self.design.names or all(ENGINES[engine].line == 1 for engine in self.engines):
            return evaluated(self.design.changes, groups=in_parts(range(self.size), size))
        lines = [line for whole in in_parts(range(self.size), row) for line in in_parts(whole, LINE)]
        return evaluated(self.design.changes, groups=lines, places=np.arange(float(self.size))[:, None] % row)

    def _table(self, points: Sequence[Mapping[str, Any]]) -> "xarray.Dataset":
        """Return the table of all points, in the order of the design."""
        import xarray

        axes, sampled = self.design.axes, self.design.names
        last = [axis.key.rpartition(".")[2] for axis in axes]  # the name of an axis, but for an ambiguous one
        ambiguous = {name for name in last if last.count(name) > 1} | {*SWEEP_POINT, "sample"}
        names = [
            axis.key.replace(".", "_") if name in ambiguous else name for name, axis in zip(last, axes, strict=True)
        ]
        dimensions = (*names, "sample") if sampled else tuple(names)
        numbers, words = self._variables()
        columns: dict[str, Any] = {}
        for name, meaning in (numbers | words).items():
            empty, kind = ("", object) if name in words else (np.nan, None)
            column = np.array([point.get(name, empty) for point in points], dtype=kind).reshape(self.design.shape)
            columns[name] = (dimensions, column, meaning)
        for name, axis in zip(names, axes, strict=True):
            plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in axis.values)
            values = np.array(axis.values, dtype=None if plain else object)
            declared = schema.declared_keys().get(axis.key)
            meaning = (declared and declared.description) or axis.key
            columns[name] = (name, values, {"key": axis.key, "long_name": meaning})
        for name, shares in zip(sampled, self.design.shares.T, strict=True):
            meaning = {"units": "1", "long_name": f"share of the spread of {name}"}
            columns[f"share_{name}"] = ("sample", shares, meaning)
        if sampled:
            columns["part"] = ("sample", np.array(self.design.parts, dtype=object))
        labels = [name for name in columns if name not in numbers and name not in words]
        return xarray.Dataset(columns, attrs=self._attributes()).set_coords(labels)

    def _variables(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the attributes of the numbers and of the words of a point, by name."""
        numbers, words = dict(SWEEP_POINT), dict(WORDS)
        if any(ENGINES[engine].reads("process") for engine in self.engines):
            words["limit"] = "limits of the machine that the strokes meet; empty within its operating window"
        for by in self.scene.drive.rank_by if self.rank else ():
            numbers[by] = quantities.CRITERIA[by]
            words[f"best_law_by_{by}"] = f"law of the least {numbers[by].term}"
        for name in self.design.names:
            unit, _, words_of_source, _ = mix.PARAMETERS[name]
            numbers[name] = Quantity(name.replace("_", " "), unit, definition=f"sampled: {words_of_source}")
        return described(numbers), {name: {"long_name": meaning} for name, meaning in words.items()}

    def _attributes(self) -> dict[str, str]:
        return {
            "title": self.scene.title,
            "engine": ", ".join(self.engines),
            "scene": self.scene.model_dump_json(exclude_none=True),
            "scene_hash": self.scene.hash,
            "versions": json.dumps(files.versions()),
        }


def described(table: Mapping[str, Quantity]) -> dict[str, Any]:
    """Return the attributes of quantities by name."""
    return {name: {"units": each.unit, "long_name": each.long_name} for name, each in table.items()}


def in_parts(numbers: Sequence[int], size: int) -> list[Sequence[int]]:
    """Return successive parts of a size, the last one shorter."""
    return [numbers[start : start + size] for start in range(0, len(numbers), size)]


def read_sweep(path: Path | str) -> "xarray.Dataset":
    """Read the table of a sweep.nc."""
    return files.read_netcdf(path, files.NETCDF_HDF5)
