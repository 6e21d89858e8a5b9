"""Checkpoints of a sweep: the results of finished points on disk, by key.

A file holds the points of one task, one line of JSON each, after the SHA-256 checksum of all of them. Files are written
atomically. A file with a wrong checksum is deleted, and its points are computed again.

One command at a time writes to a directory, also on a disk that several machines share: it holds a lock file, which is
created exclusively and names its host and process.
"""

import json
import os
import platform
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from compact.files import ResultsError, atomic_file, checksum

SUFFIX = ".points"
LOCK = "sweep.lock"  # file next to the directory of the checkpoints, while a command writes to it

Points = dict[str, Any]  # results of one point by name


class Store:
    """Checkpoints in a directory.

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
        """Lock the directory inside the block.

        Raises
        ------
        ResultsError
            If another command holds the lock. The lock of a process of this machine that has ended is taken over.
        """
        path = self.directory.parent / LOCK
        owner = f"process {os.getpid()} on {platform.node()}"
        while True:
            try:
                with path.open("x", encoding="utf-8") as stream:
                    stream.write(owner)
                break
            except FileExistsError:
                _require_ended(path)
            except OSError as error:
                raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
        try:
            yield
        finally:
            with suppress(OSError):
                path.unlink()

    def read(self) -> dict[str, Points]:
        """Read all points by key; delete broken files and partial files of killed runs."""
        points: dict[str, Points] = {}
        for path in sorted(self.directory.glob(f"*{SUFFIX}")):
            try:
                points |= _checked(path.read_bytes())
            except (ValueError, TypeError):
                self.broken.append(path.name)
                path.unlink()
            except OSError as error:
                raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
        for partial in self.directory.glob(".*.part"):
            with suppress(OSError):
                partial.unlink()
        return points

    def write(self, points: Mapping[str, Points]) -> None:
        """Write the points of one task by key."""
        body = "".join(json.dumps(entry) + "\n" for entry in points.items()).encode()
        name = checksum("".join(points).encode())[:24]
        with atomic_file(self.directory / f"{name}{SUFFIX}", "wb") as stream:
            stream.write(checksum(body).encode() + b"\n" + body)

    def clear(self) -> None:
        """Delete all points."""
        for path in self.directory.glob(f"*{SUFFIX}"):
            path.unlink()


def _require_ended(path: Path) -> None:
    """Delete the lock of a process of this machine that has ended; raise ResultsError for any other lock."""
    try:
        owner = path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:  # released meanwhile
        return
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
    known = re.fullmatch(r"process ([0-9]{1,10}) on (.+)", owner)
    if known and known[2] == platform.node() and not _is_alive(int(known[1])):
        path.unlink(missing_ok=True)
        return
    raise ResultsError(
        f"{path}: {owner if known else 'another command'} writes to this directory; wait for it, give another --out, "
        "or delete the file if that process has ended"
    )


def _is_alive(process: int) -> bool:
    """Return True unless a process of this machine has ended; always on Windows, which has no such signal."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):  # no process has a number beyond that of the system
        return False
    except PermissionError:  # of another user
        return True
    return True


def _checked(content: bytes) -> dict[str, Points]:
    recorded, _, body = content.partition(b"\n")
    if recorded != checksum(body).encode():
        raise ValueError("wrong checksum")
    return dict(json.loads(line) for line in body.splitlines())
