"""Results that a directory keeps for the next command, each under the hash of all its inputs (`files.results_key`).

A file contains results by key after their checksum. A damaged or partial file is deleted, and its results are computed
again. One command at a time writes to a directory, also on a disk that several machines share.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import SoftFileLock, Timeout

from compact.files import ResultsError, checksum, read_checked, write_checked

SUFFIX = ".points"  # of a file of results
LOCK = "sweep.lock"  # file next to the directory of the results, while a command writes to it


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
        self.broken: list[str] = []
        self.used: set[str] = set()
        self.computed = 0
        for path in sorted(directory.glob(f"*{SUFFIX}")) if directory else ():
            try:
                self.known |= read_checked(path)
            except OSError as error:
                raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
            except (ValueError, TypeError):
                self.broken.append(path.name)
                path.unlink()
        for partial in directory.glob(".*.part") if directory else ():  # of commands that were killed
            with suppress(OSError):
                partial.unlink()

    def write(self, results: Mapping[str, Any]) -> None:
        """Write results by key into one file."""
        if self.directory:
            name = checksum("".join(results).encode())[:24]
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
        If another command holds the lock, or there are results, and neither `resume` nor `force` is set.
    """
    path = directory.parent / LOCK
    lock = SoftFileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise ResultsError(
            f"{path}: another command writes to this directory; wait for it, give another --out, or delete the file "
            "if its process has ended"
        ) from None
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
    try:
        store = Store(directory, base)
        if force:
            for each in directory.glob(f"*{SUFFIX}"):
                each.unlink()
            store.known = {}
        if store.known and not resume:
            raise ResultsError(
                f"{directory.parent}: holds {len(store.known)} points of this scene; --resume uses them, --force "
                "computes all again"
            )
        yield store
    finally:
        lock.release()
