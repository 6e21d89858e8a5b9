"""Ranking under uncertainty: every source of error of the answer, its effect on the peaks and on the first law.

Sources are the discretisation (mesh and resistance map), the parameters of the mix, the laws of the mix, the other
valid models, the quantity held over speed, the mix under the return stroke, and the duration of a pass. Each source
scales or replaces the resistance; the laws are simulated again at both of its ends with the drive of the scene.

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

from compact import contact
from compact.analysis.contact_cases import HeldQuantity, scene_mix
from compact.analysis.engines import ENGINES
from compact.analysis.stages.contacts import roll_scene
from compact.analysis.stages.drives import Stages
from compact.analysis.stages.verdict import ModelAnswer, Verdict
from compact.machine.ranking import value_of
from compact.material.mix import Parameter, prior
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
MEASURED = "measured"  # first word of the clause of a remark on a measured value
FED = "fed_density_ratio"
LEAST_EFFECT = 1e-3  # [-], a smaller change of the resistance is not simulated


@dataclass(frozen=True)
class SourceEnd:
    """Answer at one end of a source of uncertainty.

    Parameters
    ----------
    change : dict
        Relative change of the peak of the recommended law by criterion [-].
    first : dict
        First law by criterion.
    """

    change: dict[str, float]
    first: dict[str, str]


@dataclass(frozen=True)
class Source:
    """Source of uncertainty.

    Parameters
    ----------
    name, variation : str
        Source and its variation in words.
    low, high : SourceEnd
        Answers at the ends with the least and the largest effect on the peak force.
    """

    name: str
    variation: str
    low: SourceEnd
    high: SourceEnd

    def increase(self, by: str) -> float:
        """Return the largest relative increase of the peak of the recommended law [-], 0 for none."""
        return max(0.0, self.low.change[by], self.high.change[by])


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
    """

    sources: tuple[Source, ...]
    mix: MixSpread | None
    peaks: dict[str, tuple[tuple[float, ...], tuple[float, ...]]]

    def source(self, name: str) -> Source | None:
        """Return a source by its name."""
        return next((each for each in self.sources if each.name == name), None)

    def first_laws(self, by: str) -> set[str]:
        """Return the laws that are first by a criterion at an end of a source of the margin."""
        return {end.first[by] for each in self.sources if each.name in MARGIN_SOURCES for end in (each.low, each.high)}

    def margin(self, by: str, leave_out: Sequence[str] = ()) -> float:
        """Return the margin of a motor over the peak of the recommended law [-], see `verdict`.

        Parameters
        ----------
        leave_out : sequence of str
            Names of sources that are not included.
        """
        increases = [
            each.increase(by) for each in self.sources if each.name in MARGIN_SOURCES and each.name not in leave_out
        ]
        return math.sqrt(sum(increase**2 for increase in increases))

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
HELD, RETURN, DURATION = "held quantity", "return stroke", "duration of a pass"
MARGIN_SOURCES = (MESH, MAP, MIX, LAW, MODELS)  # sources of the margin; the others are choices of the designer


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
    laws = {by: each.law for by, each in verdicts.items()}
    variation = _Variation(stages, laws)
    mix = mix_spread(stages.contacts.scene, stages.contacts.process)
    sources = [each for each in _scaled_sources(variation, stages, mix, spread) if each is not None]
    sources += _other_models(models, verdicts)
    if compacted := variation.over_compacted_mix():
        sources.append(Source(RETURN, "over fresh or compacted mix", *compacted))
    sources += _durations(models[0], verdicts)
    ratios = [1.0, *((mix.low, mix.high) if mix else ()), *(spread or ())]
    scales = np.linspace(SCALE_ENDS[0] * min(ratios), SCALE_ENDS[1] * max(ratios), SCALES)
    peaks = {by: _finite(scales, [variation.peak(by, scale) for scale in scales]) for by in laws}
    if mix is not None:
        mix = replace(mix, shares={by: _shares(mix, *peaks[by]) for by in laws})
    return RankingUncertainty(tuple(sources), mix, peaks)


def _finite(scales: NDArray[np.float64], peaks: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the scales with a finite peak, and the peaks."""
    found = [(float(scale), peak) for scale, peak in zip(scales, peaks, strict=True) if math.isfinite(peak)]
    return tuple(scale for scale, _ in found), tuple(peak for _, peak in found)


class _Variation:
    """Answers of the engine of the scene under a changed resistance, with the drive of the scene."""

    def __init__(self, stages: Stages, laws: Mapping[str, str]) -> None:
        self.stages, self.laws = stages, dict(laws)
        places = stages.drive.places[stages.contacts.scene.drive.kind]
        self.base = {by: {place.law: place.value for place in places[by]} for by in laws}
        near = {
            law
            for by, values in self.base.items()
            for law, value in values.items()
            if value <= CONTENDER_SHARE * min(values.values()) or law in self.laws.values()
        }
        self.cycles = {law: cycle for law, cycle in stages.laws.cycles.items() if law in near}

    def _resistance(self, scale: float) -> Any:
        if self.stages.contacts.engine.layered:
            return self.stages.resistance.map.scaled(scale)
        one = self.stages.contacts.engineering.roller_resistance
        return contact.dry_resistance(scale * self.stages.contacts.scene.machine.rollers * one)

    def end(self, scale: float) -> SourceEnd:
        """Return the answer under a scaled resistance."""
        runs = dict(self.stages.drive.simulated(self.cycles, self._resistance(scale), suppress(RuntimeError)))
        return self._end({by: {name: value_of(run, by) for name, run in runs.items()} for by in self.laws})

    def peak(self, by: str, scale: float) -> float:
        """Return the peak of the recommended law under a scaled resistance [N] or [W], infinite if the drive stalls."""
        law = self.laws[by]
        cycles = {law: self.stages.laws.cycles[law]}
        runs = dict(self.stages.drive.simulated(cycles, self._resistance(scale), suppress(RuntimeError)))
        return float(value_of(runs[law], by)) if runs else math.inf

    def over_compacted_mix(self) -> tuple[SourceEnd, SourceEnd] | None:
        """Return the answers with the other and the own mix under the return stroke; None without a second pass."""
        contacts, drive = self.stages.contacts, self.stages.drive
        if contacts.second_pass is None or contacts.scene.layer.return_stroke == "compacted":
            return None
        resistance = replace(self.stages.resistance.map, return_ratio=contacts.second_pass[1])
        runs = dict(drive.simulated(self.cycles, resistance, suppress(RuntimeError)))
        other = self._end({by: {name: value_of(run, by) for name, run in runs.items()} for by in self.laws})
        return other, self._end(self.base)

    def _end(self, values: Mapping[str, Mapping[str, float]]) -> SourceEnd:
        change = {by: values[by].get(law, math.inf) / self.base[by][law] - 1 for by, law in self.laws.items()}
        return SourceEnd(change, {by: _first(found, self.laws[by]) for by, found in values.items()})


def _first(values: Mapping[str, float], recommended: str) -> str:
    """Name the law with the least value; the recommended one if it is as good but for rounding."""
    least = min(values.values(), default=math.inf)
    if not values or values.get(recommended, math.inf) <= least * (1 + LEAST_EFFECT):
        return recommended
    return min(values, key=lambda law: values[law])


def _scaled_sources(
    variation: _Variation, stages: Stages, mix: MixSpread | None, spread: tuple[float, float] | None
) -> Iterator[Source | None]:
    """Yield the sources that multiply the resistance."""
    layered = stages.contacts.engine.layered
    mesh = stages.resistance.map.engine_error if layered else None
    between = stages.resistance.map.error if layered else None
    for name, error in ((MESH, mesh), (MAP, between)):
        yield _scaled(variation, name, None if error is None else (1 - error, 1 + error))
    yield _scaled(variation, MIX, (mix.low, mix.high) if mix else None)
    yield _scaled(variation, LAW, spread)
    yield _scaled(variation, HELD, _held_ratios(stages))


def _scaled(variation: _Variation, name: str, ratios: tuple[float, float] | None) -> Source | None:
    if ratios is None or max(abs(ratio - 1) for ratio in ratios) < LEAST_EFFECT:
        return None
    words = f"{ratios[0]:.2f} to {ratios[1]:.2f} times the resistance"
    return Source(name, words, variation.end(ratios[0]), variation.end(ratios[1]))


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


def _other_models(models: Sequence[ModelAnswer], verdicts: Mapping[str, Verdict]) -> list[Source]:
    """Return the spread over the valid models, where there are others."""
    if len([each for each in models if each.valid]) < 2 or not models[0].valid:
        return []
    drive, duration = next((each.drive, each.duration) for each in verdicts.values())
    ends = []
    for pick in (min, max):
        change = {by: pick(each.values.values()) / each.value - 1 for by, each in verdicts.items()}
        first = {}
        for by, each in verdicts.items():
            engine = pick(each.values, key=each.values.__getitem__)
            answer = next(model for model in models if model.engine == engine)
            first[by] = _first(answer.values(duration, drive, by), each.law)
        ends.append(SourceEnd(change, first))
    names = ", ".join(each.engine for each in models[1:] if each.valid)
    return [Source(MODELS, names, *ends)]


def _durations(model: ModelAnswer, verdicts: Mapping[str, Verdict]) -> Iterator[Source]:
    """Yield the other durations of a pass of the scene."""
    for duration, places in model.places.items():
        own = next(iter(verdicts.values()))
        if duration == own.duration:
            continue
        values = {by: {p.law: p.value for p in places[own.drive][by] if not p.reason} for by in verdicts}
        change = {by: values[by][each.law] / each.value - 1 for by, each in verdicts.items()}
        end = SourceEnd(change, {by: _first(values[by], each.law) for by, each in verdicts.items()})
        yield Source(DURATION, f"{duration:.3g} s", end, end)


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
        clauses = described.remark("mix.overrides", name).split(";")
        measured = any(clause.strip().startswith(MEASURED) for clause in clauses)
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
