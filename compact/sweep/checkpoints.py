"""Points of a sweep on disk: whole files or none, each checked by its sum, found again by key.

A file holds the points of one task, a line of JSON each, under the SHA-256 of all of them. A file that was cut short or
changed does not meet its sum: it is taken away, its points count as not computed.
"""

import json
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from compact.files import ResultsError, atomic_file

SUFFIX = ".points"


class Store:
    """The points under a directory; `broken` names the files that did not meet their sum."""

    def __init__(self, directory):
        self.directory = Path(directory)
        self.broken = []

    def read(self):
        """key -> headline of every whole point; broken files and what killed runs had set aside are taken away."""
        points = {}
        for path in sorted(self.directory.glob(f"*{SUFFIX}")):
            try:
                points |= _checked(path.read_bytes())
            except (ValueError, TypeError):
                self.broken.append(path.name)
                path.unlink()
            except OSError as error:
                raise ResultsError(f"{path}: {error.strerror or error}; give another --out") from error
        for aside in self.directory.glob(".*.part"):
            with suppress(OSError):
                aside.unlink()
        return points

    def write(self, points):
        """Keep the points of one task, key -> headline."""
        body = "".join(json.dumps(entry) + "\n" for entry in points.items()).encode()
        name = sha256("".join(points).encode()).hexdigest()[:24]
        with atomic_file(self.directory / f"{name}{SUFFIX}", "wb") as stream:
            stream.write(_sum(body) + body)

    def clear(self):
        """Forget all points."""
        for path in self.directory.glob(f"*{SUFFIX}"):
            path.unlink()


def _sum(body):
    return sha256(body).hexdigest().encode() + b"\n"


def _checked(content):
    told, _, body = content.partition(b"\n")
    if told + b"\n" != _sum(body):
        raise ValueError("does not meet its sum")
    return dict(json.loads(line) for line in body.splitlines())
