"""A sweep: one scene with some of its keys varied, every point computed, kept, and put into one labelled table.

    sweep = Sweep(load_scene("scene.toml"), [vary.read("mix.moisture=0.08:0.12:5")])
    table = sweep.run("out/sweep", executor=ProcessExecutor(2))
    table["resistance"]

`table` is an xarray Dataset over the varied keys, also written as sweep.nc. A point that fails has nan and its reason.
Points are computed in tasks, whose composition the number of workers does not change, so that neither do the results:
the same bits by one process, by several, and by a cluster. What is kept is found again by a key, the hash of the scene,
the changes and the versions of all that computes; a change of any of them computes the point anew.

The engine "compaction" goes from neighbour to neighbour along the last axis, LINE points from each cold start. Such a
line is one task, and one that was interrupted is computed from its start.
"""

import json
import threading
from contextlib import closing
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from threadpoolctl import threadpool_limits

from compact.analysis.engines import ENGINES
from compact.analysis.worker_pool import WorkerDied, run_tasks
from compact.files import NETCDF_BACKENDS, NETCDF_HDF5, ResultsError, claimed_directory, read_netcdf, write_netcdf
from compact.material import mix
from compact.quantities import SWEEP_POINT, Quantity
from compact.scene.errors import table_of
from compact.scene.loader import Scene
from compact.sweep import design as vary
from compact.sweep.checkpoints import Store
from compact.sweep.point import WORDS, headline, ranked, reason, versions

LINE = 8  # neighbours of an engine with continuation from one computation from scratch to the next
FAST_POINTS = 100  # points per task of an engine whose contacts cost less than a ranking
_ONE_AT_A_TIME = threading.Lock()  # in threads of a cluster: BLAS threads and warnings belong to the whole process
POINTS = "points"  # where the points are kept, under the directory of the results


@dataclass(frozen=True)
class Task:
    """Points computed one after another by one worker: (key, changes, shares) each; `chained` from one to the next."""

    scene: Scene
    points: tuple
    rank: bool
    chained: bool
    versions: dict


def compute(task):
    """key -> headline of the points of a task. RuntimeError where this worker is not of the versions that asked."""
    _refuse_other_versions(task.versions, versions())
    found, near = {}, None
    with _ONE_AT_A_TIME, threadpool_limits(1):
        for key, changes, shares in task.points:
            found[key], contact = _point(task, changes, shares, near)
            near = contact if task.chained else None
    return found


def _point(task, changes, shares, near):
    try:
        scene, values = vary.scene_at(task.scene, changes, shares)
    except ValueError as error:  # rules of scenes, or of the mix
        return {"reason": reason(error)}, near
    numbers, contact = headline(scene, task.rank, near)
    return values | numbers, contact


def _refuse_other_versions(wanted, here):
    differing = [f"{name} {here.get(name)} for {wanted[name]}" for name in wanted if here.get(name) != wanted[name]]
    if differing:
        raise RuntimeError(
            f"a worker has other versions than the command: {', '.join(differing)}; the results would not be the "
            "same, install the same on both"
        )


class Sweep:
    """A scene, what of it is varied (`vary.read`), and what is wanted of every point.

    rank : also rank the motion laws at every point, by the criteria of the scene
    indices : take the sample so that Sobol indices can be told
    """

    def __init__(self, scene, varied, *, rank=False, indices=False):
        self.scene, self.rank = scene, rank
        self.design = vary.design(scene, varied, indices)
        engines = [axis.values for axis in self.design.axes if axis.key == "accuracy.engine"]
        self.engines = engines[0] if engines else (scene.accuracy.engine,)
        self.computed = 0  # points, by this run
        self.broken = ()  # files that did not meet their sum

    @property
    def size(self):
        """Number of points."""
        return int(np.prod(self.design.shape))

    @property
    def chained(self):
        """Whether neighbours start from one another."""
        return not self.design.names and any(ENGINES[engine].continuation for engine in self.engines)

    def run(self, directory, *, executor, resume=False, force=False, step=lambda points, failed: None):
        """Compute what is missing, keep it, and write sweep.nc; the table.

        Raises ResultsError where points of this scene stand already and are neither to be gone on with nor forgotten.
        """
        keyed = self._keyed()
        with claimed_directory(directory, self.scene.hash, force) as place:
            store = Store(place / POINTS)
            known = self._known(store, resume, force)
            points = {key: known[key] for key, *_ in keyed if key in known}
            step(len(points), _failures(points))
            tasks = self._tasks(keyed, points)
            with closing(run_tasks(compute, tasks, executor, meanwhile=_bring_netcdf)) as coming:
                for number, outcome in coming:
                    points |= self._kept(store, tasks[number], outcome, points, step)
            table = self._table([points[key] for key, *_ in keyed])
            write_netcdf(place / "sweep.nc", table, NETCDF_HDF5)
        return table

    def _known(self, store, resume, force):
        known = store.read()
        self.broken = tuple(store.broken)
        if force:
            store.clear()
        elif known and not resume:
            raise ResultsError(
                f"{store.directory.parent}: holds {len(known)} points of this scene; --resume goes on with them, "
                "--force computes all anew"
            )
        return {} if force else known

    def _kept(self, store, task, outcome, points, step):
        if isinstance(outcome, WorkerDied):  # not kept: another run tries again
            outcome = {key: {"reason": outcome.reason} for key, *_ in task.points}
        else:
            store.write(outcome)
        self.computed += len(outcome)
        fresh = {key: found for key, found in outcome.items() if key not in points}
        step(len(fresh), _failures(fresh))
        return outcome

    def _keyed(self):
        """(key, changes, shares) of every point; of a chain the key holds those of the points before."""
        base = json.dumps([self.scene.hash, versions(), self.rank, self.chained])
        keyed, last = [], self.design.shape[-1]
        for index in range(self.size):
            changes, shares = self.design.point(index)
            before = keyed[-1][0] if self.chained and index % last % LINE else ""
            key = sha256(json.dumps([base, before, changes, shares]).encode()).hexdigest()[:32]
            keyed.append((key, changes, shares))
        return keyed

    def _tasks(self, keyed, known):
        """Tasks of what is missing; a line of neighbours is whole or missing."""
        if self.chained:
            last = self.design.shape[-1]
            rows = [keyed[start : start + last] for start in range(0, len(keyed), last)]
            groups = [row[start : start + LINE] for row in rows for start in range(0, last, LINE)]
            groups = [group for group in groups if any(key not in known for key, *_ in group)]
        else:
            missing = [point for point in keyed if point[0] not in known]
            size = min(ENGINES[engine].points_per_task for engine in self.engines)
            size = 1 if self.rank and size < FAST_POINTS else size
            size = max(1, size // 100) if self.rank else size
            groups = [missing[start : start + size] for start in range(0, len(missing), size)]
        return [Task(self.scene, tuple(group), self.rank, self.chained, versions()) for group in groups]

    def _table(self, points):
        """The Dataset of all points, in the order of the design."""
        import xarray

        shape, names = self.design.shape, self._dimensions()
        numbers, words = (dict(part) for part in (SWEEP_POINT, WORDS))
        if self.rank:
            more_numbers, more_words = ranked(self.scene.drive.rank_by)
            numbers, words = numbers | more_numbers, words | more_words
        for name in self.design.names:
            origin = mix.PARAMETER_SOURCES[name]
            numbers[name] = Quantity(name.replace("_", " "), origin.unit, definition=f"sampled: {origin.words}")
        found = {}
        for name, quantity in numbers.items():
            column = np.array([point.get(name, np.nan) for point in points]).reshape(shape)
            found[name] = (names, column, {"units": quantity.unit, "long_name": quantity.long_name})
        for name, meaning in words.items():
            column = np.array([point.get(name, "") for point in points], dtype=object).reshape(shape)
            found[name] = (names, column, {"long_name": meaning})
        return xarray.Dataset(found, self._coordinates(names), self._attributes())

    def _dimensions(self):
        """A name for every axis: the last part of its key, the whole of it where two would be the same."""
        last = [axis.key.rpartition(".")[2] for axis in self.design.axes]
        names = [
            name
            if last.count(name) == 1 and name not in SWEEP_POINT and name != "sample"
            else axis.key.replace(".", "_")
            for name, axis in zip(last, self.design.axes, strict=True)
        ]
        return (*names, "sample") if self.design.names else tuple(names)

    def _coordinates(self, names):
        coordinates = {}
        for name, axis in zip(names, self.design.axes, strict=False):
            values = np.array(axis.values, dtype=None if _are_numbers(axis.values) else object)
            coordinates[name] = (name, values, {"key": axis.key, "long_name": _meaning(axis.key)})
        if self.design.names:
            coordinates["part"] = ("sample", np.array(self.design.parts, dtype=object))
            for name, shares in zip(self.design.names, self.design.shares.T, strict=True):
                meaning = {"units": "1", "long_name": f"share of the spread of {name}"}
                coordinates[f"share_{name}"] = ("sample", shares, meaning)
        return coordinates

    def _attributes(self):
        return {
            "title": self.scene.title,
            "engine": ", ".join(self.engines),
            "scene": self.scene.model_dump_json(exclude_none=True),
            "scene_hash": self.scene.hash,
            "versions": json.dumps(versions()),
        }


def _failures(points):
    return sum(bool(found.get("reason")) for found in points.values())


def _are_numbers(values):
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _meaning(key):
    """What the scene says of a key."""
    table, info = Scene, None
    for part in key.split("."):
        info = table.model_fields[part]
        table = table_of(info)
    return info.description or key


def _bring_netcdf():
    """Import all that `write_netcdf` needs, a second or two, while the workers start and import what they need."""
    import xarray

    xarray.Dataset().to_netcdf(format=NETCDF_HDF5, engine=NETCDF_BACKENDS[NETCDF_HDF5])


def read_sweep(path):
    """The table of a sweep.nc."""
    return read_netcdf(path, NETCDF_HDF5)
