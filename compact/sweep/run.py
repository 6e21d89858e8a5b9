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
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import zip_longest
from math import dist
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from filelock import SoftFileLock, Timeout
from threadpoolctl import threadpool_limits

from compact import files, quantities
from compact.analysis.worker_pool import Executor, WorkerError, run_tasks
from compact.engines import ENGINES
from compact.material import mix
from compact.numerics import Array
from compact.quantities import SWEEP_POINT, Quantity
from compact.rolling_contact import Contact
from compact.scene.loader import FILE_KEYS, Scene
from compact.scene.schema import declared_keys
from compact.sweep.design import Axis, Sampled, design, scene_at, varied_engines
from compact.sweep.point import WORDS, Results, headline, reason

if TYPE_CHECKING:
    import xarray

LINE = 8  # neighbours of an engine with continuation from one computation from scratch to the next
POINTS_PER_RANKING = 100  # [-], points without a ranking in the time of one ranking
_ONE_AT_A_TIME = threading.Lock()  # in threads of a cluster, as BLAS threads and warnings are global to a process
POINTS = "points"  # directory of the checkpoints, in that of the results
SUFFIX = ".points"  # of a checkpoint
LOCK = "sweep.lock"  # file next to the directory of the checkpoints, while a command writes to it
KEY_LENGTH = 32  # characters of the key of a checkpoint

Points = Mapping[str, Results]  # results by key
Step = Callable[[int, int], None]  # called with numbers of new points and of failures among them


class KeyedPoint(NamedTuple):
    """Point of a sweep: the hash of all its inputs, values by scene key, and shares of the spreads of the mix [-]."""

    key: str
    changes: dict[str, Any]
    shares: dict[str, float]


class Store:
    """Checkpoints in a directory: one file a task, with the results of its points by key.

    A file with a wrong checksum is deleted, and its points are computed again. One command at a time writes to a
    directory, also on a disk that several machines share.

    Attributes
    ----------
    broken : list of str
        Names of the files with a wrong checksum.
    """

    def __init__(self, directory: Path | str) -> None:
        self.directory = Path(directory)
        self.broken: list[str] = []

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the directory inside the block; the lock of a process of this machine that has ended is taken over.

        Raises
        ------
        ResultsError
            If another command holds the lock.
        """
        path = self.directory.parent / LOCK
        lock = SoftFileLock(path, timeout=0)
        try:
            lock.acquire()
        except Timeout:
            raise files.ResultsError(
                f"{path}: another command writes to this directory; wait for it, give another --out, or delete the "
                "file if its process has ended"
            ) from None
        except OSError as error:
            raise files.ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
        try:
            yield
        finally:
            lock.release()

    def read(self) -> dict[str, Results]:
        """Read all points by key; delete broken files and partial files of killed runs."""
        points: dict[str, Results] = {}
        for path in sorted(self.directory.glob(f"*{SUFFIX}")):
            try:
                points |= files.read_checked(path)
            except OSError as error:
                raise files.ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
            except (ValueError, TypeError):
                self.broken.append(path.name)
                path.unlink()
        for partial in self.directory.glob(".*.part"):
            with suppress(OSError):
                partial.unlink()
        return points

    def write(self, points: Points) -> None:
        """Write the points of one task by key."""
        name = files.checksum("".join(points).encode())[:24]
        files.write_checked(self.directory / f"{name}{SUFFIX}", points)


@dataclass(frozen=True)
class Task:
    """Points that one worker computes in order.

    Parameters
    ----------
    places : tuple
        Coordinates of the points [-], of which each starts from the contact of the nearest one before; empty where no
        contact is a start.
    """

    scene: Scene
    points: tuple[KeyedPoint, ...]
    rank: bool
    versions: dict[str, str]
    places: tuple[tuple[float, ...], ...] = ()


def compute(task: Task) -> dict[str, Results]:
    """Compute the points of a task.

    Raises
    ------
    RuntimeError
        If this worker has other versions than the command.
    """
    here = files.versions()
    if differing := [f"{name} {here.get(name)} for {v}" for name, v in task.versions.items() if here.get(name) != v]:
        raise RuntimeError(
            f"a worker has other versions than the command: {', '.join(differing)}; the results would not be the "
            "same, install the same on both"
        )
    found: dict[str, Results] = {}
    contacts: list[tuple[tuple[float, ...], Contact]] = []
    with _ONE_AT_A_TIME, threadpool_limits(1):
        for point, place in zip_longest(task.points, task.places):
            guess = min(contacts, key=lambda each: round(dist(each[0], place), 9))[1] if contacts else None
            try:
                scene, values = scene_at(task.scene, point.changes, point.shares)
            except ValueError as error:  # rules of scenes, or of the mix
                found[point.key] = {"reason": reason(error)}
                continue
            numbers, contact = headline(scene, task.rank, guess)
            found[point.key] = values | numbers
            if place is not None and contact is not None and contact is not guess:
                contacts.append((place, contact))
    return found


@dataclass
class Computed:
    """Results of points: those that are known, and those of tasks, which are kept."""

    store: Store
    known: Points
    executor: Executor
    step: Step
    count: int = 0
    used: set[str] = field(default_factory=set)

    def __call__(self, tasks: Sequence[Task], keys: Sequence[str], silent: bool = False) -> dict[str, Results]:
        """Compute tasks, and return the results of points by key."""
        points: dict[str, Results] = {}

        def add(found: Points) -> None:
            fresh = [each for key, each in found.items() if key not in points]
            points.update(found)
            self.used.update(found)
            if not silent:
                self.step(len(fresh), sum(bool(each.get("reason")) for each in fresh))

        add({key: self.known[key] for key in keys if key in self.known})
        with closing(run_tasks(compute, tasks, self.executor)) as coming:
            for number, job in coming:
                try:
                    found = job.result()
                    self.store.write(found)
                except WorkerError as error:  # no checkpoint: another run tries again
                    found = {point.key: {"reason": str(error)} for point in tasks[number].points}
                self.count += len(found)
                add(found)
        return points


class Sweep:
    """Sweep of a scene.

    Parameters
    ----------
    rank : bool
        Whether the motion laws are ranked at every point, by the criteria of the scene.
    """

    def __init__(
        self, scene: Scene, varied: Sequence[Axis | Sampled], *, rank: bool = False, indices: bool = False
    ) -> None:
        self.scene, self.rank = scene, rank
        self.design = design(scene, varied, indices)
        self.engines = varied_engines(scene, self.design.axes)
        self.size = int(np.prod(self.design.shape))  # number of points
        self.computed = self.needed = 0  # points computed, and all points with those that were kept
        self.unused = 0  # points that were kept, under keys of another sweep, other files or other sources
        self.broken: tuple[str, ...] = ()

    @property
    def steps(self) -> int:
        """Number of points that `run` announces to `step`."""
        return self.size

    def run(
        self,
        directory: Path | str,
        *,
        executor: Executor,
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
        with files.claimed_directory(directory, self.scene.hash, force) as place, Store(place / POINTS).locked():
            store = Store(place / POINTS)
            known = store.read()
            self.broken = tuple(store.broken)
            if force:
                for path in store.directory.glob(f"*{SUFFIX}"):
                    path.unlink()
                known = {}
            if known and not resume:
                raise files.ResultsError(
                    f"{place}: holds {len(known)} points of this scene; --resume uses them, --force computes all again"
                )
            computed = Computed(store, known, executor, step)
            try:
                table = self._table(self._results(computed))
            finally:
                self.computed = computed.count
            self.needed, self.unused = len(computed.used), len(known.keys() - computed.used)
            files.write_netcdf(place / "sweep.nc", table, files.NETCDF_HDF5)
        return table

    def _results(self, computed: Computed) -> list[Results]:
        """Return the results of all points, in the order of the design; neighbours of an engine with continuation."""
        size, row = min(ENGINES[engine].points_per_task for engine in self.engines), self.design.shape[-1]
        if self.rank:
            size = max(1, size // POINTS_PER_RANKING)
        if self.design.names or all(ENGINES[engine].line == 1 for engine in self.engines):
            found = self._solved(computed, in_parts(range(self.size), size))
        else:
            lines = [line for whole in in_parts(range(self.size), row) for line in in_parts(whole, LINE)]
            found = self._solved(computed, lines, np.arange(float(self.size))[:, None] % row)
        return [found[number] for number in range(self.size)]

    def _solved(
        self,
        computed: Computed,
        groups: Sequence[Sequence[int]],
        places: Array | None = None,
        more: Callable[[dict[str, Any]], dict[str, Any]] = lambda _: {},
        silent: bool = False,
    ) -> dict[int, Results]:
        """Return the results of groups of points by number; a group whose points start from others is one task.

        Parameters
        ----------
        places : Array, shape (size, parameters), optional
            Coordinates of all points [-], where contacts are starts of others.
        more : callable
            Further changes of the scene for those of a point.
        """
        keys: dict[int, str] = {}
        tasks: list[Task] = []
        names = [each for name in self.engines for each in (name, ENGINES[name].low_fidelity) if each]
        base = files.results_key(self.scene.hash, [ENGINES[name].source for name in names], self.rank)
        for group in groups:
            points: list[KeyedPoint] = []
            for number in group:
                changes, shares = self.design.point(number)
                before = None if places is None else [points[-1].key if points else "", places[number].tolist()]
                points.append(self._keyed(base, before, changes | more(changes), shares))
            keys |= {number: point.key for number, point in zip(group, points, strict=True)}
            missing = [point for point in points if point.key not in computed.known]
            if missing:
                chain = () if places is None else tuple(map(tuple, places[list(group)].tolist()))
                solved = tuple(points if chain else missing)
                tasks.append(Task(self.scene, solved, self.rank, files.versions(), chain))
        found = computed(tasks, list(keys.values()), silent)
        return {number: found[key] for number, key in keys.items()}

    def _keyed(self, base: str, before: Any, changes: dict[str, Any], shares: dict[str, float]) -> KeyedPoint:
        """Return a point with the hash of all its inputs, with the contents of the files that it names."""
        tables = [self.scene.checksum_of(str(changes[key])) for key in FILE_KEYS if key in changes]
        key = files.checksum(json.dumps([base, before, changes, shares, tables]).encode())[:KEY_LENGTH]
        return KeyedPoint(key, changes, shares)

    def _table(self, points: list[Results]) -> "xarray.Dataset":
        """Return the table of all points, in the order of the design."""
        import xarray

        axes, sampled = self.design.axes, self.design.names
        last = [axis.key.rpartition(".")[2] for axis in axes]  # the name of an axis, but for an ambiguous one
        ambiguous = {name for name in last if last.count(name) > 1} | {*SWEEP_POINT, "sample"}
        names = [
            axis.key.replace(".", "_") if name in ambiguous else name for name, axis in zip(last, axes, strict=True)
        ]
        dimensions = (*names, "sample") if sampled else tuple(names)
        numbers, texts = self._variables()
        found: dict[str, Any] = {}
        for name, quantity in numbers.items():
            column = np.array([point.get(name, np.nan) for point in points]).reshape(self.design.shape)
            found[name] = (dimensions, column, {"units": quantity.unit, "long_name": quantity.long_name})
        for name, meaning in texts.items():
            column = np.array([point.get(name, "") for point in points], dtype=object).reshape(self.design.shape)
            found[name] = (dimensions, column, {"long_name": meaning})
        coordinates: dict[str, Any] = {}
        for name, axis in zip(names, axes, strict=True):
            plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in axis.values)
            values, declared = np.array(axis.values, dtype=None if plain else object), declared_keys().get(axis.key)
            meaning = (declared and declared.description) or axis.key
            coordinates[name] = (name, values, {"key": axis.key, "long_name": meaning})
        if sampled:
            coordinates["part"] = ("sample", np.array(self.design.parts, dtype=object))
        for name, shares in zip(sampled, self.design.shares.T, strict=True):
            words = {"units": "1", "long_name": f"share of the spread of {name}"}
            coordinates[f"share_{name}"] = ("sample", shares, words)
        return xarray.Dataset(found, coordinates, self._attributes())

    def _variables(self) -> tuple[dict[str, Quantity], dict[str, str]]:
        """Return the numbers and the meanings of the words of a point, by name."""
        numbers, words = dict(SWEEP_POINT), dict(WORDS)
        for by in self.scene.drive.rank_by if self.rank else ():
            numbers[by] = quantities.CRITERIA[by]
            words[f"best_law_by_{by}"] = f"law of the least {numbers[by].term}"
        for name in self.design.names:
            unit, _, words_of_source, _ = mix.PARAMETERS[name]
            numbers[name] = Quantity(name.replace("_", " "), unit, definition=f"sampled: {words_of_source}")
        return numbers, words

    def _attributes(self) -> dict[str, str]:
        return {
            "title": self.scene.title,
            "engine": ", ".join(self.engines),
            "scene": self.scene.model_dump_json(exclude_none=True),
            "scene_hash": self.scene.hash,
            "versions": json.dumps(files.versions()),
        }


def in_parts(numbers: Sequence[int], size: int) -> list[Sequence[int]]:
    """Return successive parts of a size, the last one shorter."""
    return [numbers[start : start + size] for start in range(0, len(numbers), size)]


def read_sweep(path: Path | str) -> "xarray.Dataset":
    """Read the table of a sweep.nc."""
    return files.read_netcdf(path, files.NETCDF_HDF5)
