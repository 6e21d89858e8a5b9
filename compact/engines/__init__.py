"""Registry of the contact engines by name: those of this package, then those of other packages.

Only this module has a table of engines. An engine of another package is loaded when first used.
"""

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points

from compact.engines.column import COLUMN
from compact.engines.compaction import COMPACTION
from compact.engines.fem import FEM
from compact.engines.formula import FORMULA
from compact.engines.interface import Engine
from compact.engines.process import PROCESS
from compact.engines.spectral import SPECTRAL

ENTRY_POINTS = "compact.engines"  # group of entry points by which other packages add engines
BUILT_IN: dict[str, Engine] = {each.name: each for each in (FORMULA, COLUMN, SPECTRAL, FEM, COMPACTION, PROCESS)}


class _Registry(Mapping[str, Engine]):
    def __getitem__(self, name: str) -> Engine:
        return BUILT_IN.get(name) or _load_engine(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*BUILT_IN, *(name for name in installed_engines() if name not in BUILT_IN)))

    def __len__(self) -> int:
        return len(list(iter(self)))


def installed_engines() -> tuple[str, ...]:
    """Return the names of the engines of other packages: entry points of the group `ENTRY_POINTS`."""
    return tuple(entry_points(group=ENTRY_POINTS).names)


def _load_engine(name: str) -> Engine:
    for entry in entry_points(group=ENTRY_POINTS, name=name):
        engine = entry.load()
        if not isinstance(engine, Engine) or engine.name != name:
            raise ValueError(
                f"the entry point {name} of the group {ENTRY_POINTS} must be an Engine called {name!r}, got {engine!r}"
            )
        return engine
    raise KeyError(name)


ENGINES: Mapping[str, Engine] = _Registry()
