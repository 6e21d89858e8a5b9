"""Design of a sweep: grids and lists of scene keys, and samples over the spread of the mix.

    KEY=low:high:n     n values from low to high, evenly
    KEY=a,b,c          the values themselves, numbers or words
    KEY=~n             n Sobol points over the spread of mix.overrides.NAME, or mix.overrides for all that matter

Grids and lists are axes of the sweep, in full factorial combination; all sampled keys share one more axis, `sample`.
The spread of a parameter depends on moisture and density ratio, so a sample holds shares s of the spread, 0 to 1:

    value = low (high/low)^s    where the spread is a factor,    low + s (high - low)    else

independent of one another, as no source states their correlation.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod
from typing import Any

import numpy as np

from compact.analysis.stages.ensemble import Change, Share
from compact.engines import ENGINES
from compact.material import mix
from compact.numerics import Array
from compact.numerics.validation import require_known
from compact.scene.loader import Scene, SceneError, read_value

OVERRIDES = "mix.overrides"
MAX_POINTS = 1_000_000  # of a sweep; about 2 GB with all results, divide larger ones into several sweeps
SEED = 2015  # of the scrambling of Sobol points; the same sample in every run


@dataclass(frozen=True)
class Axis:
    """Values of one scene key."""

    key: str
    values: tuple[Any, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.key, str):
            raise ValueError(f"--vary takes key paths such as mix.moisture, got {self.key!r}")
        if not self.values or not all(isinstance(value, Hashable) for value in self.values):
            raise ValueError(f"--vary {self.key}: takes one or more numbers or words, got {list(self.values)}")
        if len(set(self.values)) < len(self.values):
            raise ValueError(f"--vary {self.key}: values must differ from one another, got {list(self.values)}")


@dataclass(frozen=True)
class Sampled:
    """Sample of Sobol points.

    Parameters
    ----------
    key : str
        A key of mix.overrides, or mix.overrides for all parameters.
    count : int
        Number of points, a power of 2.
    """

    key: str
    count: int

    def __post_init__(self) -> None:
        if self.count < 2 or self.count & (self.count - 1):
            near = 2 ** max(1, round(np.log2(max(self.count, 1))))
            raise ValueError(f"--vary {self.key}: Sobol points come in powers of 2, got {self.count}; give ~{near}")


def read_design(text: str) -> Axis | Sampled:
    """Parse KEY=VALUES."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (key and equals and values) or values.count(":") == 1:
        forms = "KEY=LOW:HIGH:N, KEY=A,B,C or KEY=~N, such as mix.moisture=0.08:0.12:5"
        raise ValueError(f"--vary takes {forms}, got {text!r}")

    def whole(word: str) -> int:
        if not word.isdecimal():
            raise ValueError(f"--vary {key}: takes a whole number of values, got {word!r}")
        return int(word)

    def value(word: str) -> Any:
        """Return a value as in a scene file, or a bare word."""
        found = read_value(word)
        if not isinstance(found, int | float | str) or found == "" or found != found:
            raise ValueError(f"--vary {key}: takes numbers, words, true and false, got {word!r}")
        return found

    if values.startswith("~"):
        return Sampled(key, whole(values[1:]))
    if values.count(":") != 2:
        return Axis(key, tuple(value(part.strip()) for part in values.split(",")))
    low, high, count = (read(part) for read, part in zip((value, value, whole), values.split(":"), strict=True))
    if not all(isinstance(end, int | float) for end in (low, high)) or count < 2 or not low < high:
        raise ValueError(f"--vary {key}: a grid runs from LOW up to HIGH in N >= 2 values, got {low}:{high}:{count}")
    _require_few(key, count)
    grid = np.linspace(low, high, count).round(12).tolist()  # 0.1, not 0.1 + 1e-17
    is_whole = isinstance(low, int) and isinstance(high, int) and all(each.is_integer() for each in grid)
    return Axis(key, tuple(map(int, grid)) if is_whole else tuple(grid))


def _require_few(key: str, count: int) -> None:
    if count > MAX_POINTS:
        raise ValueError(f"--vary {key}: a sweep has at most {MAX_POINTS} points, got {count}; sample by KEY=~N")


@dataclass(frozen=True, eq=False)
class Design:
    """Points of a sweep: full factorial combination of the axes and, if there is one, the sample.

    Parameters
    ----------
    shares : Array, shape (rows, names)
        Shares of their spreads [-].
    parts : tuple of str
        Sobol matrix of each row: "A", "B", or the name of the parameter that is from B in a row that is else from A.
    """

    axes: tuple[Axis, ...]
    names: tuple[str, ...] = ()
    shares: Array = field(default_factory=lambda: np.empty((0, 0)))
    parts: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis, the sample last."""
        return (*(len(axis.values) for axis in self.axes), *((len(self.shares),) if self.names else ()))

    @property
    def changes(self) -> list[Change]:
        """Changes of the scene at all points; the last axis is the fastest."""
        varied = [[{axis.key: value} for value in axis.values] for axis in self.axes]
        if self.names:
            keys = [f"{OVERRIDES}.{name}" for name in self.names]
            varied.append([dict(zip(keys, map(Share, row), strict=True)) for row in self.shares.tolist()])
        return [Change("", {key: value for each in parts for key, value in each.items()}) for parts in product(*varied)]


def design(scene: Scene, varied: Sequence[Axis | Sampled], indices: bool = False) -> Design:
    """Build the design of a sweep.

    Raises
    ------
    SceneError, ValueError
        If a key or value is invalid by itself. Rules between keys are checked at each point.
    """
    axes = tuple(part for part in varied if isinstance(part, Axis))
    samples = tuple(part for part in varied if isinstance(part, Sampled))
    keys = [part.key for part in varied]
    if not keys:
        raise ValueError("nothing to vary; give --vary KEY=LOW:HIGH:N, such as mix.moisture=0.08:0.12:5")
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(f"--vary {key}: given twice; put its values into one list")
        if key.split(".")[0] in ("title", "unusual", "output"):
            raise ValueError(f"--vary {key}: decides no number; vary another key")
    for axis in axes:
        for value in axis.values:
            scene.require_fields(**{axis.key: value})
    rows = [sample.count * (2 + len(mix.PARAMETER_NAMES) if indices else 1) for sample in samples[:1]]
    _require_few(" --vary ".join(keys), prod([len(axis.values) for axis in axes] + rows))
    if not samples:
        if indices:
            raise ValueError("Sobol indices need a sample; give --vary mix.overrides=~256 or of single parameters")
        return Design(axes)
    if len({sample.count for sample in samples}) > 1:
        raise ValueError(f"all samples share their points, got {[sample.count for sample in samples]}; give one number")
    names = _sampled_names(scene, axes, samples)
    return Design(axes, names, *_rows(names, samples[0].count, indices))


def varied_engines(scene: Scene, axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return the engines of a sweep: those of an axis, else that of the scene."""
    return next((axis.values for axis in axes if axis.key == "accuracy.engine"), (scene.accuracy.engine,))


def _sampled_names(scene: Scene, axes: Sequence[Axis], samples: Sequence[Sampled]) -> tuple[str, ...]:
    """Return the parameters of the mix to be sampled, in the order of the table."""
    engines = varied_engines(scene, axes)
    law, air = scene.mix.law, scene.mix.pore_air != "drained"
    counted = {name for engine in engines for name in ENGINES[engine].parameters_of(law, air)}
    given = set(scene.mix.overrides.model_dump(exclude_none=True)) | {axis.key.split(".")[-1] for axis in axes}
    names = set()
    for key in (sample.key for sample in samples):
        table, _, name = key.rpartition(".")
        if key == OVERRIDES:
            names |= counted - given
            continue
        if table != OVERRIDES:
            words = "only mix.overrides and its keys have a spread to sample; give a grid or a list"
            raise SceneError([f"{key}: {words}"])
        require_known("mix parameter", name, mix.PARAMETER_NAMES)
        if name in given:
            raise SceneError([f"{key}: is given, so it has no spread to sample; delete the value"])
        names.add(name)
    return tuple(name for name in mix.PARAMETER_NAMES if name in names)


def _rows(names: tuple[str, ...], count: int, indices: bool) -> tuple[Array, tuple[str, ...]]:
    """Return shares and parts; A and B are the halves of one Sobol sequence of twice as many dimensions."""
    from scipy.stats import qmc

    if not indices:
        return qmc.Sobol(len(names), seed=SEED).random(count), ("A",) * count
    first, second = np.split(qmc.Sobol(2 * len(names), seed=SEED).random(count), 2, axis=1)
    mixed = [np.where(np.arange(len(names)) == i, second, first) for i in range(len(names))]
    return np.concatenate([first, second, *mixed]), tuple(np.repeat(["A", "B", *names], count).tolist())
