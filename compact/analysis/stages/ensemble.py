"""Ensemble: a scene under changes of its keys, with the results of each changed scene or the reason why it has none.

    found = ensemble(scene, [Change("thin", {"layer.lift_thickness": 0.05}), Change("thick", ...)], run)
    found[0]["peak_force"]["cycloidal"], found[1].get("reason")

A change is an end of a spread, another drive, another law of the mix, a duration, an engine, a point of a sweep. `run`
is any function that a worker can import (`functools.partial` binds its other arguments) and that returns named values
of a changed scene, such as `drive_peaks`, which keeps the contacts where the drive or the resistance changes alone.

A `Store` keeps results in a directory, each under the hash of all its inputs (`files.results_key`). A file contains
results by key after their checksum. A damaged or partial file is deleted, and its results are computed again. One
command at a time writes to a directory, also on a disk that several machines share.
"""

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from math import dist
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from filelock import SoftFileLock, Timeout
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from compact.analysis.contact_cases import scene_mix
from compact.analysis.failures import reason_of
from compact.analysis.stages.drives import simulate_laws
from compact.analysis.stages.resistance import ResistanceLaw
from compact.analysis.worker_pool import Executor, SerialExecutor, WorkerError, run_tasks
from compact.files import ResultsError, checksum, read_checked, versions, write_checked
from compact.machine.cart import Cart
from compact.machine.drives import DRIVES
from compact.machine.ranking import first_of, value_of
from compact.motion.profile import Cycle
from compact.rolling_contact import Contact
from compact.scene.loader import FILE_KEYS, Scene

Values = Mapping[str, Any]  # results by name; "reason" says why there are none
Peaks = Mapping[str, Mapping[str, float]]  # by criterion and law
Step = Callable[[int, int], None]  # called with numbers of new results and of reasons among them

NO_KEYS: Mapping[str, Any] = {}
UNFOLLOWED = RuntimeError, ValueError  # of a law: no periodic cycle, or a cart faster than its resistance is known
START = "contact"  # result that is not kept: contact from which a neighbour may start
SUFFIX = ".points"  # of a file of results, whose name begins with the hash of what they have in common
LOCK = "sweep.lock"  # file next to the directory of the results, while a command writes to it
KEY_LENGTH = 32  # characters of the key of a result
_ONE_AT_A_TIME = threading.RLock()  # in threads of a cluster, as BLAS threads and warnings are global to a process


class Share(NamedTuple):
    """Value of a key mix.overrides.NAME by its place in the spread of that parameter, in a mix with all other changes.

    Parameters
    ----------
    share : float
        0 at the low and 1 at the high end [-].
    """

    share: float


class Change(NamedTuple):
    """Change of a scene.

    Parameters
    ----------
    label : str
        Name of the change, its own in a table.
    keys : mapping
        New values by scene key.
    resistance : callable, optional
        Resistance of one cart in place of that of the scene [N].
    start : Contact, optional
        Contact of a neighbour, from which that of the changed scene may start.
    """

    label: str
    keys: Mapping[str, Any] = NO_KEYS
    resistance: ResistanceLaw | None = None
    start: Contact | None = None

    def of(self, scene: Scene) -> Scene:
        """Return the changed scene."""
        shares = {key: value.share for key, value in self.keys.items() if isinstance(value, Share)}
        changed = scene.replaced(**{key: value for key, value in self.keys.items() if key not in shares})
        if not shares:
            return changed
        mix = scene_mix(changed)
        return changed.replaced(**{key: mix.parameter(key.rpartition(".")[2]).at(at) for key, at in shares.items()})


Run = Callable[[Scene, Change], Values]  # of a changed scene


Task = tuple[Sequence[Change], Iterable[tuple[float, ...]]]  # changes and their places [-], or none


def compute(scene: Scene, run: Run, required: Mapping[str, str], task: Task) -> list[dict[str, Any]]:
    """Evaluate changes of a scene in order, with one thread of linear algebra.

    With places each starts from the nearest contact before it.

    Raises
    ------
    RuntimeError
        If this worker has other versions than the required ones.
    """
    here, contacts, found = versions(), list[tuple[tuple[float, ...], Contact]](), list[dict[str, Any]]()
    if differing := [f"{name} {here.get(name)} for {v}" for name, v in required.items() if here.get(name) != v]:
        raise RuntimeError(f"a worker has other versions: {', '.join(differing)}; install the same on both")
    with _ONE_AT_A_TIME, threadpool_limits(1):
        for change, place in zip_longest(*task):
            guess = min(contacts, key=lambda each: round(dist(each[0], place), 9))[1] if contacts else change.start
            try:
                values = dict(run(change.of(scene), change._replace(start=guess)))
            except (ValueError, RuntimeError) as error:
                values = {"reason": reason_of(error)}
            contact = values.pop(START, None)
            if place is not None and contact is not None and contact is not guess:
                contacts.append((place, contact))
            found.append(values)
    return found


# results that a directory keeps for the next command


class Store:
    """Results by key, of earlier commands and of this one.

    Parameters
    ----------
    directory : Path, optional
        Directory of the files; without one the results are not kept.
    base : str
        Hash of all inputs that the results have in common.

    Attributes
    ----------
    known : dict
        Results of earlier commands by key.
    own : int
        Number of them with this base.
    broken : list of str
        Names of the files that were damaged.
    used : set of str
        Keys of the results that this command has required.
    computed : int
        Number of results that this command has computed.
    """

    def __init__(self, directory: Path | None = None, base: str = "") -> None:
        self.directory, self.base = directory, base
        self.known: dict[str, Any] = {}
        self.own = 0
        self.broken: list[str] = []
        self.used: set[str] = set()
        self.computed = 0
        for path in sorted(directory.glob(f"*{SUFFIX}")) if directory else ():
            try:
                self.known |= (results := read_checked(path))
                self.own += len(results) if path.name.startswith(base) else 0
            except OSError as error:
                raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
            except (ValueError, TypeError):
                self.broken.append(path.name)
                path.unlink()
        for unfinished in directory.glob(".*.part") if directory else ():  # of commands that were killed
            with suppress(OSError):
                unfinished.unlink()

    def write(self, results: Mapping[str, Any]) -> None:
        """Write results by key into one file."""
        if self.directory:
            name = self.base + checksum("".join(results).encode())[:16]
            write_checked(self.directory / f"{name}{SUFFIX}", results)


@contextmanager
def open_store(directory: Path, base: str = "", resume: bool = False, force: bool = False) -> Iterator[Store]:
    """Lock a directory and read its results; the lock of a process of this machine that has ended is taken over.

    Parameters
    ----------
    base : str
        As of `Store`.
    resume, force : bool
        Whether existing results are used, or deleted.

    Raises
    ------
    ResultsError
        If another command holds the lock, or there are results with this base, and neither `resume` nor `force` is set.
    """
    path = directory.parent / LOCK
    lock = SoftFileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ResultsError(f"{path}: another command writes to this directory; wait for it, or change --out") from None
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
    try:
        store = Store(directory, base)
        if force:
            for each in directory.glob(f"*{SUFFIX}"):
                each.unlink()
            store.known, store.own = {}, 0
        if store.own and not resume:
            raise ResultsError(
                f"{directory.parent}: holds {store.own} points of this scene; --resume uses them, --force "
                "computes all again"
            )
        yield store
    finally:
        lock.release()


def ensemble(
    scene: Scene,
    changes: Iterable[Change],
    run: Run,
    executor: Executor | None = None,
    *,
    groups: Sequence[Sequence[int]] | None = None,
    places: NDArray[np.float64] | None = None,
    store: Store | None = None,
    step: Step = lambda *_: None,
) -> dict[int, dict[str, Any]]:
    """Evaluate a scene under changes of its keys.

    The results do not depend on the executor. A reason replaces the values where the changed scene is invalid, where
    `run` raises a ValueError or RuntimeError, and where no worker survives; any other error is raised.

    Parameters
    ----------
    run : callable
        Returns values of a changed scene by name. If these include a `contact`, the changes of its group that follow
        start from it: each gets that of the nearest place as `Change.start`.
    executor : Executor, optional
        Open executor, to which scene, changes and run can be sent; this process by default.
    groups : sequence of sequence of int, optional
        Numbers of the changes to be evaluated, those of a group by one worker; by default each by itself.
    places : NDArray, shape (changes, parameters), optional
        Coordinates of all changes [-], where contacts are starts; such a group is kept or computed as a whole.
    store : Store, optional
        Results of earlier commands by the hash of its `base`, the change, the files it names, and its start.
    step : callable
        Called with the numbers of new results and of reasons among them.

    Returns
    -------
    dict
        Values by number of the change.
    """
    changes, kept, found, tasks = list(changes), store or Store(), dict[int, dict[str, Any]](), list[Task]()
    pending: list[dict[int, str]] = []  # of each task: key by number of the change
    for group in [[number] for number in range(len(changes))] if groups is None else groups:
        keys: dict[int, str] = {}
        for number in group:
            before = None if places is None else [[*keys.values()][-1:], places[number].tolist()]
            keys[number] = f"{number}" if store is None else _key(scene, store.base, before, changes[number].keys)
        missing = [number for number in group if keys[number] not in kept.known]
        found |= {number: kept.known[keys[number]] for number in group if number not in missing}
        chain = group if missing and places is not None else missing
        if missing:
            at = () if places is None else tuple(map(tuple, places[list(chain)].tolist()))
            tasks.append(([changes[number] for number in chain], at))
            pending.append({number: keys[number] for number in chain})
        kept.used.update(keys.values())
    step(len(found), sum(bool(each.get("reason")) for each in found.values()))
    work = partial(compute, scene, run, versions())
    for task, job in run_tasks(work, tasks, executor or SerialExecutor()):
        keys = pending[task]
        try:
            values = job.result()
            kept.write(dict(zip(keys.values(), values, strict=True)))
        except WorkerError as error:  # not kept: another command tries again
            values = [{"reason": str(error)} for _ in keys]
        kept.computed += len(values)
        fresh = {number: each for number, each in zip(keys, values, strict=True) if number not in found}
        found |= zip(keys, values, strict=True)
        step(len(fresh), sum(bool(each.get("reason")) for each in fresh.values()))
    return found


def _key(scene: Scene, base: str, before: Any, keys: Mapping[str, Any]) -> str:
    """Hash all inputs of a result, with the contents of the files that its change names."""
    tables = [scene.checksum_of(str(keys[key])) for key in FILE_KEYS if key in keys]
    return checksum(json.dumps([base, before, keys, tables]).encode())[:KEY_LENGTH]


def drive_peaks(
    cart: Cart,
    cycles: Mapping[str, Mapping[str, Cycle]],
    resistance: ResistanceLaw,
    criteria: Iterable[str],
    scene: Scene,
    change: Change,
) -> Peaks:
    """Return the values of laws under the drive of a changed scene, against a resistance that is known.

    Parameters
    ----------
    cycles : mapping
        Laws by label of a change; those of "" for other labels.
    resistance : callable
        Resistance of one cart [N], where the change has none.

    Returns
    -------
    mapping
        Values by criterion and law; absent for a law that the drive does not follow.
    """
    cart = replace(cart, mass=scene.machine.mass, weight=scene.machine.weight)
    laws = cycles.get(change.label, cycles[""])
    drive = DRIVES[scene.drive.kind]
    met = change.resistance or resistance
    runs = dict(simulate_laws(scene, cart, laws, met, UNFOLLOWED, make=drive.make_for_peaks))
    if drive.realises and change.keys:
        made = {name: drive.realised_peaks(run) for name, run in runs.items()}
        return {by: {name: peaks[by] for name, peaks in made.items() if by in peaks} for by in criteria}
    return {by: {name: value_of(run, by) for name, run in runs.items()} for by in criteria}


def first_law(values: Mapping[str, float]) -> str:
    """Name the law of the least value, the first of equals; empty without a finite value."""
    finite = {law: value for law, value in values.items() if np.isfinite(value)}
    return list(finite)[first_of(list(finite.values()))] if finite else ""
