"""What a sweep varies: grids and lists over keys of the scene, and samples over the spread of the mix.

    KEY=low:high:n     n values from low to high, evenly
    KEY=a,b,c          the values themselves, numbers or words
    KEY=~n             n Sobol points over the spread of mix.overrides.NAME, or with mix.overrides of all that count

Grids and lists are axes of the sweep, all against all; every sampled key shares one more axis, `sample`. What a sampled
parameter is worth depends on moisture and density ratio, so a sample holds shares s of the spread, 0 to 1:

    value = low (high/low)^s    where the spread is a factor,    low + s (high - low)    else

each independent of the others, as no source tells how they go together.
"""

import tomllib
from dataclasses import dataclass, field
from math import prod

import numpy as np

from compact.analysis.engines import ENGINES
from compact.material import mix
from compact.numerics.validation import require_known
from compact.scene.former_names import current_path
from compact.scene.loader import SceneError

OVERRIDES = "mix.overrides"
MOST_POINTS = 1_000_000  # [-], of a sweep: about 2 GB with all that is kept of each; more go into several sweeps
SEED = 2015  # of the scrambling of Sobol points: the same sample in every run


@dataclass(frozen=True)
class Axis:
    """A key of the scene and the values it takes, numbers or words."""

    key: str
    values: tuple

    def __post_init__(self):
        if len(set(self.values)) < len(self.values):
            raise ValueError(f"--vary {self.key}: values must differ from one another, got {list(self.values)}")


@dataclass(frozen=True)
class Sampled:
    """Keys of which a sample of so many Sobol points is taken: one of mix.overrides, or mix.overrides for all."""

    key: str
    count: int

    def __post_init__(self):
        if self.count < 2 or self.count & (self.count - 1):
            near = 2 ** max(1, round(np.log2(max(self.count, 1))))
            raise ValueError(f"--vary {self.key}: Sobol points come in powers of 2, got {self.count}; give ~{near}")
        _require_few(self.key, self.count)


def read_design(text):
    """The `Axis` or `Sampled` of KEY=VALUES."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (key and equals and values):
        raise ValueError(
            f"--vary takes KEY=LOW:HIGH:N, KEY=A,B,C or KEY=~N, such as mix.moisture=0.08:0.12:5, got {text!r}"
        )
    key = current_path(key)
    if values.startswith("~"):
        return Sampled(key, _whole(key, values[1:]))
    if values.count(":") == 2:
        return Axis(key, _grid(key, *values.split(":")))
    return Axis(key, tuple(_value(key, part.strip()) for part in values.split(",")))


def _grid(key, low, high, count):
    low, high, count = _value(key, low), _value(key, high), _whole(key, count)
    if not all(isinstance(end, int | float) for end in (low, high)) or count < 2 or not low < high:
        raise ValueError(
            f"--vary {key}: a grid runs from LOW up to HIGH in N >= 2 values, got {low}:{high}:{count}; "
            "give one value as it is"
        )
    _require_few(key, count)
    values = np.linspace(low, high, count).round(12).tolist()  # 0.1, not 0.1 + 1e-17
    whole = isinstance(low, int) and isinstance(high, int) and all(value.is_integer() for value in values)
    return tuple(map(int, values)) if whole else tuple(values)


def _require_few(key, count):
    if count > MOST_POINTS:
        raise ValueError(
            f"--vary {key}: a sweep has at most {MOST_POINTS} points, got {count}; take a coarser grid, or a sample of "
            "the spread of the mix, KEY=~N"
        )


def _value(key, text):
    """A value as a scene would read it, or a bare word."""
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text
    if not isinstance(value, int | float | str) or value == "" or value != value:
        raise ValueError(f"--vary {key}: takes numbers, words, true and false, got {text!r}")
    return value


def _whole(key, text):
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"--vary {key}: takes a whole number of values, got {text!r}") from None


@dataclass(frozen=True, eq=False)
class Design:
    """The points of a sweep: all values of the `axes` against each other, and against the sample if there is one.

    names : parameters of the mix that are sampled;  shares : of their spreads, shape (rows, names)
    parts : of each row of the sample, "A" and "B" at random, or the name that is B's in a row that is else A's: from
        these the indices of `sobol` are made
    """

    axes: tuple[Axis, ...]
    names: tuple[str, ...] = ()
    shares: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    parts: tuple[str, ...] = ()

    @property
    def shape(self):
        """Number of values along each axis, the sample last."""
        return (*(len(axis.values) for axis in self.axes), *((len(self.shares),) if self.names else ()))

    def point(self, index):
        """(key -> value, parameter -> share) of the point of that number, the last axis running fastest."""
        place = np.unravel_index(index, self.shape)
        changes = {axis.key: axis.values[i] for axis, i in zip(self.axes, place, strict=False)}
        shares = self.shares[place[-1]].tolist() if self.names else ()
        return changes, dict(zip(self.names, shares, strict=True))


def design(scene, varied, indices=False):
    """The `Design` over a scene of what `read_design` gave; `indices` adds the rows that Sobol indices need.

    Raises SceneError or ValueError for keys and values that no scene of this kind may have, before anything is
    computed. What only the rules between keys refuse is left to the points.
    """
    axes = tuple(part for part in varied if isinstance(part, Axis))
    samples = tuple(part for part in varied if isinstance(part, Sampled))
    _refuse_keys([part.key for part in varied])
    for axis in axes:
        for value in axis.values:
            scene.require_fields(**{axis.key: value})
    rows = [sample.count * (2 + len(mix.PARAMETER_NAMES) if indices else 1) for sample in samples[:1]]
    _require_few(" --vary ".join(part.key for part in varied), prod([len(axis.values) for axis in axes] + rows))
    if not samples:
        if indices:
            raise ValueError("Sobol indices need a sample; give --vary mix.overrides=~256 or of single parameters")
        return Design(axes)
    if len({sample.count for sample in samples}) > 1:
        raise ValueError(f"all samples share their points, got {[sample.count for sample in samples]}; give one number")
    names = _sampled_names(scene, axes, samples)
    return Design(axes, names, *_rows(names, samples[0].count, indices))


def _refuse_keys(keys):
    if not keys:
        raise ValueError("nothing to vary; give --vary KEY=LOW:HIGH:N, such as mix.moisture=0.08:0.12:5")
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(f"--vary {key}: given twice; put its values into one list")
        if key.split(".")[0] in ("title", "unusual", "output"):
            raise ValueError(f"--vary {key}: decides no number; vary another key")


def _sampled_names(scene, axes, samples):
    """Parameters of the mix to be sampled, in the order of the table."""
    engines = next((axis.values for axis in axes if axis.key == "accuracy.engine"), (scene.accuracy.engine,))
    counted = {name for engine in engines for name in ENGINES[engine].mix_parameters}
    if scene.mix.reference_speed and any(ENGINES[engine].compacting for engine in engines):
        counted.add("rate_exponent")
    given = set(scene.mix.overrides.model_dump(exclude_none=True)) | {axis.key.split(".")[-1] for axis in axes}
    names = set()
    for sample in samples:
        table, _, name = sample.key.rpartition(".")
        if sample.key == OVERRIDES:
            names |= counted - given
        elif table == OVERRIDES:
            require_known("mix parameter", name, mix.PARAMETER_NAMES)
            scene.require_fields(**{sample.key: None})
            if name in given:
                raise SceneError([f"{sample.key}: is given, so it has no spread to sample; take the value out"])
            names.add(name)
        else:
            raise SceneError(
                [f"{sample.key}: only mix.overrides and what is in it have a spread to sample; give a grid or a list"]
            )
    return tuple(name for name in mix.PARAMETER_NAMES if name in names)


def _rows(names, count, indices):
    """Shares and parts of the sample; A and B are the halves of one Sobol sequence of twice as many dimensions."""
    from scipy.stats import qmc

    if not indices:
        return qmc.Sobol(len(names), seed=SEED).random(count), ("A",) * count
    both = qmc.Sobol(2 * len(names), seed=SEED).random(count)
    first, second = both[:, : len(names)], both[:, len(names) :]
    mixed = []
    for i in range(len(names)):
        mixed.append(first.copy())
        mixed[-1][:, i] = second[:, i]
    parts = [part for part in ("A", "B", *names) for _ in range(count)]
    return np.concatenate([first, second, *mixed]), tuple(parts)


def scene_at(scene, changes, shares):
    """The scene of a point, and its sampled parameters by name; SceneError where the rules refuse it."""
    there = scene.replaced(**changes)
    if not shares:
        return there, {}
    given = there.mix.overrides.model_dump(exclude_none=True)
    blend = mix.prior(there.mix.moisture, there.mix.density_ratio, given)
    values = {name: blend.parameter(name).at(share) for name, share in shares.items()}
    return there.replaced(**{f"{OVERRIDES}.{name}": value for name, value in values.items()}), values
