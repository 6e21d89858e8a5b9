"""Ranking under uncertainty: every source of error of the answer, its effect on the peaks and on the first law.

Sources are the discretisation (mesh and resistance map), the parameters of the mix, the laws of the mix, its pore air,
the other valid models, the drive where its data are not measured, the quantity held over speed, the mix under the
return stroke, and the duration of a pass. Each source scales or replaces the resistance of the model that sizes the
machine, or the drive; the laws are simulated again at all of its ends.

The mix is sampled with columns, which take milliseconds, or with the confined floor of a forming process: the
logarithm of the resistance over the prior is fitted by a quadratic polynomial in the parameters. Sobol indices
(`scipy.stats.sobol_indices`) of the peak force of the recommended law then give the share of each parameter in the
variance; the parameter with the largest share should be measured first.

References
----------
Saltelli A. et al. (2010): Variance based sensitivity analysis of model output. Comput. Phys. Commun. 181, 259-270.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc, sobol_indices, uniform

from compact.analysis.contact_cases import HeldQuantity, scene_mix
from compact.analysis.engines import ENGINES
from compact.analysis.pore_air import RATIOS
from compact.analysis.stages.contacts import roll_scene
from compact.analysis.stages.drive_variants import drive_variants, peaks_with_oil
from compact.analysis.stages.drives import Stages
from compact.analysis.stages.verdict import ModelAnswer, Verdict, sizing_model
from compact.machine.ranking import first_of, value_of
from compact.material.mix import Parameter, prior
from compact.motion.profile import Cycle
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from compact.analysis.process import ProcessStudy

SAMPLES = 128  # [-], of the mix by columns; three times the coefficients of a quadratic in seven parameters
SOBOL_SAMPLES = 1024  # [-], of the fit; its indices then scatter by less than 0.01
SEED = 2015  # of both samples
BAND = (0.05, 0.95)  # [-], quantiles of the resistance over the mix
GIVEN_SPREAD = 0.1  # [-], relative half-width of a parameter that the scene states as measured
DENSITY_STEP = 0.1  # [-], of the increase of the density ratio; half-width of the initial density ratio
SCALES = 7  # [-], of the resistance, at which the peaks of the recommended law are sampled
SCALE_ENDS = (0.8, 1.2)  # [-], first and last of them over the least and largest resistance of the sources
CONTENDER_SHARE = 1.5  # [-], of the least peak; laws beyond it are not first where the resistance changes
OIL_SHARE = 1.05  # [-], of the least peak; laws whose strokes with compressible oil are computed
FED = "fed_density_ratio"
LEAST_EFFECT = 1e-3  # [-], a smaller change of the resistance is not simulated


@dataclass(frozen=True)
class SourceEnd:
    """Answer at one end of a source of uncertainty.

    Parameters
    ----------
    words : str
        The end in words.
    change : dict
        Relative change of the peaks of each recommended law [-], by law and criterion.
    first : dict
        First law by criterion.
    """

    words: str
    change: dict[str, dict[str, float]]
    first: dict[str, str]


@dataclass(frozen=True)
class Source:
    """Source of uncertainty.

    Parameters
    ----------
    name, variation : str
        Source and its variation in words.
    ends : tuple of SourceEnd
        Answers at the ends.
    """

    name: str
    variation: str
    ends: tuple[SourceEnd, ...]

    def changes(self, law: str, by: str) -> tuple[float, float]:
        """Return the least and the largest relative change of a peak of a recommended law [-]."""
        found = [end.change[law][by] for end in self.ends]
        return min(found), max(found)

    def other_firsts(self, by: str, law: str) -> dict[str, str]:
        """Return the first law by a criterion at each end where it is not the given one, by the end in words."""
        return {end.words: end.first[by] for end in self.ends if end.first[by] != law}


@dataclass(frozen=True)
class MixSpread:
    """Spread of the resistance over the parameters of the mix, by columns.

    Parameters
    ----------
    low, high : float
        Quantiles of the resistance over that of the scene [-].
    fit : float
        Coefficient of determination of the quadratic fit [-].
    names : tuple of str
        Parameters.
    ranges : dict
        Low and high value of each parameter, in its unit.
    alone : dict
        Resistance at both ends of each parameter alone, over that of the scene [-].
    shares : dict
        Total Sobol index of each parameter in the peak, by criterion [-].
    twice_as_stiff : float
        Resistance of a mix with half the Heckel slope over that of the scene [-].
    coefficients : tuple of float
        Quadratic fit of the logarithm of the resistance over the positions in the ranges, from -1 to 1.
    """

    low: float
    high: float
    fit: float
    names: tuple[str, ...]
    ranges: dict[str, tuple[float, float]]
    alone: dict[str, tuple[float, float]]
    shares: dict[str, dict[str, float]]
    twice_as_stiff: float
    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class RankingUncertainty:
    """Uncertainty of the answer from all sources.

    Parameters
    ----------
    mix : MixSpread or None
        None where columns do not cover the scene.
    peaks : dict
        Peaks of the recommended laws by criterion over the scale of the resistance: (scales, values).
    laws : dict
        Recommended law by criterion.
    """

    sources: tuple[Source, ...]
    mix: MixSpread | None
    peaks: dict[str, tuple[tuple[float, ...], tuple[float, ...]]]
    laws: dict[str, str]

    def source(self, name: str) -> Source | None:
        """Return a source by its name."""
        return next((each for each in self.sources if each.name == name), None)

    def first_laws(self, by: str) -> set[str]:
        """Return the laws that are first by a criterion at an end of a source of the margin."""
        return {end.first[by] for each in self.sources if each.name in MARGIN_SOURCES for end in each.ends}

    def margin(self, by: str, leave_out: Sequence[str] = (), law: str | None = None) -> float:
        """Return the margin of a motor over the peak of a recommended law [-], see `verdict`.

        Parameters
        ----------
        by : str
            Criterion.
        leave_out : sequence of str
            Names of sources that are not included.
        law : str, optional
            A recommended law; that of the criterion by default.
        """
        law = law or self.laws[by]
        counted = [each for each in self.sources if each.name in MARGIN_SOURCES and each.name not in leave_out]
        return math.sqrt(sum(max(0.0, each.changes(law, by)[1]) ** 2 for each in counted))

    def peak_change(self, by: str, scale: float) -> float:
        """Return the change of the peak of the recommended law under a scaled resistance [-].

        Parameters
        ----------
        by : str
            Criterion.
        scale : float
            Resistance over that of the scene [-].

        Returns
        -------
        float
            Relative change [-].
        """
        scales, values = self.peaks[by]
        return float(np.interp(scale, scales, values) / np.interp(1.0, scales, values) - 1)


MESH, MAP, MIX, LAW, MODELS = "mesh", "resistance map", "parameters of the mix", "law of the mix", "other valid models"
AIR, DRIVE = "pore air", "drive, not measured"
HELD, RETURN, DURATION = "held quantity", "return stroke", "duration of a pass"
MARGIN_SOURCES = (MESH, MAP, MIX, LAW, AIR, MODELS, DRIVE)  # of the margin; the others are the designer's choice


def ranking_uncertainty(
    stages: Stages, models: Sequence[ModelAnswer], verdicts: Mapping[str, Verdict], spread: tuple[float, float] | None
) -> RankingUncertainty:
    """Vary every source of uncertainty of the answer.

    Parameters
    ----------
    models : sequence of ModelAnswer
        Answers of all models, that of the engine of the scene first.
    verdicts : mapping of str to Verdict
        Verdicts without the spread of the mix, by criterion.
    spread : tuple of float or None
        Least and largest resistance over the laws of the mix [-].

    Returns
    -------
    RankingUncertainty
    """
    laws, leads = {by: each.law for by, each in verdicts.items()}, models[0].valid
    variation = _Variation(stages, sizing_model(models), laws)
    mix = mix_spread(stages.contacts.scene, stages.contacts.process)
    sources = [each for each in _scaled_sources(variation, stages, mix, spread if leads else None) if each is not None]
    sources += _other_models(variation, models)
    sources += variation.over_other_drives()
    sources += variation.over_compacted_mix() if leads else ()
    sources += variation.over_other_durations()
    ratios = [1.0, *((mix.low, mix.high) if mix else ()), *(spread or ())]
    scales = np.linspace(SCALE_ENDS[0] * min(ratios), SCALE_ENDS[1] * max(ratios), SCALES)
    peaks = {by: _finite(scales, [variation.peak(by, scale) for scale in scales]) for by in laws}
    if mix is not None:
        mix = replace(mix, shares={by: _shares(mix, *peaks[by]) for by in laws})
    return RankingUncertainty(tuple(sources), mix, peaks, laws)


def _finite(scales: NDArray[np.float64], peaks: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the scales with a finite peak, and the peaks."""
    found = [(float(scale), peak) for scale, peak in zip(scales, peaks, strict=True) if math.isfinite(peak)]
    return tuple(scale for scale, _ in found), tuple(peak for _, peak in found)


class _Variation:
    """Answers of the model that sizes the machine under a changed resistance or with another drive."""

    def __init__(self, stages: Stages, model: ModelAnswer, laws: Mapping[str, str]) -> None:
        self.stages, self.model, self.laws = stages, model, dict(laws)
        self.motion, self.drive = stages.contacts.scene.motion, stages.contacts.scene.drive.kind
        self.base = {by: model.values(self.motion.duration, self.drive, by) for by in laws}
        near = {law for law in stages.laws.cycles if self._is_near(law, CONTENDER_SHARE)}
        self.cycles = {law: cycle for law, cycle in stages.laws.cycles.items() if law in near}

    def _is_near(self, law: str, share: float) -> bool:
        """Return True for a recommended law, and within a share of the least peak by any criterion."""
        values = [(each[law], min(each.values())) for each in self.base.values() if law in each]
        return law in self.laws.values() or any(value <= share * least for value, least in values)

    def _peaks(
        self, cycles: Mapping[str, Cycle], resistance: Any, scene: Scene | None = None
    ) -> dict[str, dict[str, float]]:
        """Return the peaks by criterion and law; absent for a law that the drive does not follow."""
        runs = dict(self.stages.drive.simulated(cycles, resistance, suppress(RuntimeError), scene))
        return {by: {name: value_of(run, by) for name, run in runs.items()} for by in self.laws}

    def end(self, scale: float) -> SourceEnd:
        """Return the answer under a scaled resistance."""
        return self.at(f"{scale:.2f} times", self._peaks(self.cycles, self.model.resistance.scaled(scale)))

    def peak(self, by: str, scale: float) -> float:
        """Return the peak of the recommended law under a scaled resistance [N] or [W], infinite if the drive stalls."""
        law = self.laws[by]
        found = self._peaks({law: self.stages.laws.cycles[law]}, self.model.resistance.scaled(scale))
        return found[by].get(law, math.inf)

    def over_other_drives(self) -> list[Source]:
        """Return the source of the drive data that are not measured; none for a drive without such data."""
        variants = drive_variants(self.stages.contacts.scene)
        peaks_of = self._peaks_with_oil if self.drive == "hydraulic" else self._peaks_with_drive
        ends = [self.at(words, peaks_of(scene)) for words, scene in variants.items()]
        return [Source(DRIVE, ", ".join(variants), tuple(ends))] if ends else []

    def _peaks_with_drive(self, scene: Scene) -> dict[str, dict[str, float]]:
        return self._peaks(self.stages.laws.cycles, self.model.resistance, scene)

    def _peaks_with_oil(self, scene: Scene) -> dict[str, dict[str, float]]:
        """Return the peaks with compressible oil, of laws near the least alone: each takes about a second."""
        table = scene.drive.hydraulics
        assert table is not None  # rule of the scene
        found: dict[str, dict[str, float]] = {by: {} for by in self.laws}
        near = {law: cycle for law, cycle in self.stages.laws.cycles.items() if self._is_near(law, OIL_SHARE)}
        for law, run in self.stages.drive.simulated(near, self.model.resistance, suppress(RuntimeError)):
            with suppress(RuntimeError):
                peaks = peaks_with_oil(run, table.bulk_modulus) if not run.lack else {}
                for by in peaks.keys() & found.keys():
                    found[by][law] = peaks[by]
        return found

    def over_compacted_mix(self) -> list[Source]:
        """Return the source of the mix under the return stroke; none without a second pass."""
        contacts = self.stages.contacts
        if contacts.second_pass is None or contacts.scene.layer.return_stroke == "compacted":
            return []
        resistance = replace(self.stages.resistance.map, return_ratio=contacts.second_pass[1])
        ends = self.at("compacted", self._peaks(self.cycles, resistance)), self.at("fresh", self.base)
        return [Source(RETURN, "over fresh or compacted mix", ends)]

    def over_other_durations(self) -> Iterator[Source]:
        """Yield the other durations of a pass of the scene."""
        for duration in self.model.places:
            if duration != self.motion.duration:
                words = f"{duration:.3g} s"
                values = {by: self.model.values(duration, self.drive, by) for by in self.laws}
                yield Source(DURATION, words, (self.at(words, values),))

    def at(self, words: str, values: Mapping[str, Mapping[str, float]]) -> SourceEnd:
        """Return the answer with the given peaks by criterion and law."""
        change = {
            law: {
                by: values[by].get(law, math.inf) / self.base[by][law] - 1 for by in self.laws if law in self.base[by]
            }
            for law in self.laws.values()
        }
        return SourceEnd(words, change, {by: _first(found, self.laws[by]) for by, found in values.items()})


def _first(values: Mapping[str, float], recommended: str) -> str:
    """Name the law with the least value; the recommended one if it is as good but for rounding."""
    least = min(values.values(), default=math.inf)
    if not values or values.get(recommended, math.inf) <= least * (1 + LEAST_EFFECT):
        return recommended
    return list(values)[first_of(list(values.values()))]


def _scaled_sources(
    variation: _Variation, stages: Stages, mix: MixSpread | None, spread: tuple[float, float] | None
) -> Iterator[Source | None]:
    """Yield the sources that multiply the resistance."""
    resistance = variation.model.resistance
    for name, error in ((MESH, "engine_error"), (MAP, "error")):
        found = getattr(resistance, error, None)
        yield _scaled(variation, name, None if found is None else (1 - found, 1 + found))
    yield _scaled(variation, MIX, (mix.low, mix.high) if mix else None)
    yield _scaled(variation, LAW, spread)
    if variation.model.engine == stages.contacts.scene.accuracy.engine:
        yield _scaled(variation, AIR, _air_ratios(stages), "one-way to undrained, ")
        yield _scaled(variation, HELD, _held_ratios(stages))


def _scaled(variation: _Variation, name: str, ratios: tuple[float, float] | None, words: str = "") -> Source | None:
    if ratios is None or max(abs(ratio - 1) for ratio in ratios) < LEAST_EFFECT:
        return None
    words += f"{ratios[0]:.2f} to {ratios[1]:.2f} times the resistance"
    return Source(name, words, tuple(variation.end(ratio) for ratio in ratios))


def _air_ratios(stages: Stages) -> tuple[float, float] | None:
    """Return the resistance with the air of a drained answer, one-way and undrained, over that of the answer.

    Both are at the deformation without air; mix that yields to its air resists more where a bow wave exists.
    """
    contacts = stages.contacts
    curve, speed, model = contacts.air_curve, contacts.scene.mean_speed, contacts.scene.mix.pore_air
    if curve is None or model == "coupled":
        return None
    permeability = contacts.mix.parameter("air_permeability").value
    one_way, undrained = (
        1 + curve.at(speed, each).resistance / curve.skeleton_resistance for each in (permeability, speed / RATIOS[-1])
    )
    return (one_way, undrained) if model == "drained" else (1.0, undrained / one_way)


def _held_ratios(stages: Stages) -> tuple[float, float] | None:
    """Return the least and largest resistance at the largest speed of the laws under another held quantity, by columns.

    The contacts agree at the mean speed.
    """
    scene = stages.contacts.scene
    engine = stages.contacts.engine
    if not engine.compacting or engine.forming or scene.contact is not None:
        return None
    with suppress(ValueError, RuntimeError):
        columns = scene.with_engine("column")
        mix = scene_mix(columns)
        fastest = max(cycle.forward.peaks().velocity for cycle in stages.laws.cycles.values())
        base = roll_scene(columns, mix, scene.mean_speed)
        held = {name: HeldQuantity(name, float(getattr(base, key)), scene.mean_speed) for name, key in HELD_FIELDS}
        found = [roll_scene(columns, mix, fastest, held=each).resistance for each in held.values()]
        ratios = [each / found[0] for each in found]
        return min(ratios), max(ratios)
    return None


HELD_FIELDS = (("height", "indentation"), ("load", "load"), ("peak_pressure", "peak_pressure"))


def _other_models(variation: _Variation, models: Sequence[ModelAnswer]) -> list[Source]:
    """Return the other models that are valid for sizing as a source, where there are some."""
    duration = variation.motion.duration
    others = [each for each in models if each.valid and each is not variation.model and variation.model.valid]
    ends = [
        variation.at(each.engine, {by: each.values(duration, variation.drive, by) for by in variation.laws})
        for each in others
    ]
    return [Source(MODELS, ", ".join(each.engine for each in others), tuple(ends))] if ends else []


# mix


def mix_spread(scene: Scene, process: "ProcessStudy | None" = None) -> MixSpread | None:
    """Sample the resistance at the mean speed over the parameters of the mix, by columns.

    Parameters
    ----------
    scene : Scene
        Scene.
    process : ProcessStudy, optional
        Forming process, whose confined floor replaces the pass of columns.

    Returns
    -------
    MixSpread or None
        None where columns do not cover the scene.
    """
    try:
        columns = scene.with_engine("column") if process is None else scene
    except ValueError:
        return None
    base = _resistance_with(columns, {}, process)
    if not base > 0:
        return None
    ranges = parameter_ranges(columns, scene)
    names, count = tuple(ranges), len(ranges)
    resistance = partial(_resistance_at, columns, ranges, process)
    shares = qmc.Sobol(count, rng=SEED).random(SAMPLES)
    found = np.array([resistance(share) for share in shares]) / base
    known = found > 0  # nan without a solution
    terms = _terms(shares[known])
    if known.sum() <= terms.shape[1]:
        return None
    logs = np.log(found[known])
    coefficients = np.linalg.lstsq(terms, logs, rcond=None)[0]
    fit = 1 - float(np.var(logs - terms @ coefficients) / np.var(logs))
    low, high = np.quantile(found[known], BAND)
    centre = np.array([_share_of(columns, name, *ranges[name]) for name in names])
    alone: dict[str, tuple[float, float]] = {}
    for index, name in enumerate(names):
        ends = np.array([centre, centre])
        ends[:, index] = 0.0, 1.0
        alone[name] = resistance(ends[0]) / base, resistance(ends[1]) / base
    stiffer = {"mix.overrides.heckel_slope": scene_mix(columns).heckel_slope / 2}
    twice = _resistance_with(columns, stiffer, process) / base
    return MixSpread(
        float(low), float(high), fit, names, ranges, alone, {}, float(twice), tuple(coefficients.tolist())
    )  # fmt: skip


def parameter_ranges(scene: Scene, described: Scene) -> dict[str, tuple[float, float]]:
    """Return the ranges of the parameters of the mix that columns depend on, and of the initial density ratio.

    A value that is stated as measured has a range of a tenth; any other one has the relative range of the prior.

    Parameters
    ----------
    described : Scene
        Scene whose remarks state the origin of the values.
    """
    mix, typical = scene_mix(scene), prior(scene.mix.moisture, scene.mix.density_ratio)
    ranges = {}
    for name in ENGINES["column"].parameters_of(scene.mix.law):
        measured = described.is_marked(f"mix.overrides.{name}", "measured")
        low, high = _relative_range(typical.parameter(name), measured)
        value = mix.parameter(name).value
        if low * value < high * value:
            ranges[name] = (low * value, high * value)
    before = _fed(scene)[1]
    step = DENSITY_STEP * (scene.mix.density_ratio - before)
    return ranges | {FED: (before - step, before + step)}


def _relative_range(parameter: Parameter, measured: bool) -> tuple[float, float]:
    if measured or not parameter.value:
        return (1 - GIVEN_SPREAD, 1 + GIVEN_SPREAD) if parameter.value else (0.0, 0.0)
    return parameter.low / parameter.value, parameter.high / parameter.value


def _share_of(scene: Scene, name: str, low: float, high: float) -> float:
    """Return the position of the value of the scene in a range, 0 at its low and 1 at its high end [-]."""
    value = _fed(scene)[1] if name == FED else scene_mix(scene).parameter(name).value
    return math.log(value / low) / math.log(high / low) if low > 0 else (value - low) / (high - low)


def _value_at(share: float, low: float, high: float) -> float:
    """Interpolate a range, geometrically above zero."""
    return low * (high / low) ** share if low > 0 else low + share * (high - low)


def _fed(scene: Scene) -> tuple[str, float]:
    """Return key and value of the initial density ratio: of the feed of a process, or of the layer before a pass."""
    if scene.process is not None and ENGINES[scene.accuracy.engine].forming:
        return "process.feed_density_ratio", scene.process.feed_density_ratio
    return f"layer.{FED}", scene.layer.fed_density_ratio


def _resistance_at(
    scene: Scene, ranges: Mapping[str, tuple[float, float]], process: "ProcessStudy | None", shares: Sequence[float]
) -> float:
    """Return the resistance at positions in the ranges; nan without a solution."""
    keys = (_fed(scene)[0] if name == FED else f"mix.overrides.{name}" for name in ranges)
    values = (_value_at(float(share), *ends) for share, ends in zip(shares, ranges.values(), strict=True))
    return _resistance_with(scene, dict(zip(keys, values, strict=True)), process)


def _resistance_with(scene: Scene, changes: Mapping[str, float], process: "ProcessStudy | None") -> float:
    """Return the resistance of a roller [N/m], of a process of a cart [N], for changed keys; nan without solution."""
    try:
        changed = scene.replaced(**changes)
        if process is not None:
            return process.resistance_with(changed)
        return float(roll_scene(changed, scene_mix(changed), changed.mean_speed).resistance)
    except (ValueError, RuntimeError):
        return math.nan


def _terms(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the terms of a quadratic polynomial, shape (points, terms)."""
    x = 2 * shares - 1
    pairs = combinations_with_replacement(range(x.shape[1]), 2)
    return np.column_stack([np.ones(len(x)), x, *(x[:, i] * x[:, j] for i, j in pairs)])


def _shares(mix: MixSpread, scales: Sequence[float], peaks: Sequence[float]) -> dict[str, float]:
    """Return the total Sobol index of each parameter in a peak [-], by the fit of the resistance."""
    coefficients = np.array(mix.coefficients)

    def peak(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(np.exp(_terms(shares.T) @ coefficients), scales, peaks)

    found = sobol_indices(func=peak, n=SOBOL_SAMPLES, dists=[uniform()] * len(mix.names), rng=SEED)
    return dict(zip(mix.names, map(float, found.total_order), strict=True))
