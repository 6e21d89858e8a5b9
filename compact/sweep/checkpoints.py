"""Checkpoints of a sweep: the results of finished points on disk, by key.

A file holds the points of one task, one line of JSON each, after the SHA-256 checksum of all of them. Files are written
atomically. A file with a wrong checksum is deleted, and its points are computed again.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from compact.files import ResultsError, atomic_file

SUFFIX = ".points"

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
        name = sha256("".join(points).encode()).hexdigest()[:24]
        with atomic_file(self.directory / f"{name}{SUFFIX}", "wb") as stream:
            stream.write(_checksum(body) + body)

    def clear(self) -> None:
        """Delete all points."""
        for path in self.directory.glob(f"*{SUFFIX}"):
            path.unlink()


def _checksum(body: bytes) -> bytes:
    return sha256(body).hexdigest().encode() + b"\n"


def _checked(content: bytes) -> dict[str, Points]:
    checksum, _, body = content.partition(b"\n")
    if checksum + b"\n" != _checksum(body):
        raise ValueError("wrong checksum")
    return dict(json.loads(line) for line in body.splitlines())
