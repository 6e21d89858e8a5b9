"""Ranking under uncertainty: every source of error of the answer, its effect on the peaks and on the first law.

Sources are the discretisation (mesh and resistance map), the parameters of the mix, the laws of the mix, its pore air,
the other valid models, and the drive where its data are not measured; held quantity, return stroke and duration are
choices of the designer. Each source scales or replaces the resistance of the model that sizes the machine, or the
drive; the laws are simulated again at all of its ends. Measured forces to which the mix is fitted have their own error,
in place of mesh, parameters and laws of the mix, and other models.

Stiffness and damping of the drive, alone and together, and the mass of the cart vary against the known resistance,
milliseconds a law. A value that the scene states as measured, given or published varies by the ± of its comment, an
assumed one by the factors of `machine.drives`.

The mix is sampled with columns, which take milliseconds, or with the confined floor of a forming process: the
logarithm of the resistance over the prior is fitted by a quadratic polynomial in the parameters. Sobol indices
(`scipy.stats.sobol_indices`) of the peak force of the recommended law then give the share of each parameter in the
variance; the parameter with the largest share should be measured first.

References
----------
Saltelli A. et al. (2010): Variance based sensitivity analysis of model output. Comput. Phys. Commun. 181, 259-270.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from compact.analysis.contact_cases import roll_scene, scene_mix
from compact.analysis.pore_air import RATIOS
from compact.analysis.stages.drives import Stages
from compact.analysis.stages.ensemble import Change, Peaks, drive_peaks, ensemble, first_law
from compact.analysis.stages.resistance import along_stroke
from compact.analysis.stages.robust_range import SLEEVE, sleeve_ends
from compact.analysis.stages.verdict import sizing_model
from compact.analysis.worker_pool import Executor
from compact.engines import ENGINES
from compact.machine.drives import DRIVES, EDGE, MASS, Variant, both_ways
from compact.material.mix import prior
from compact.motion.profile import Cycle
from compact.scene.loader import MEASURED_SPREAD, Scene

if TYPE_CHECKING:
    from compact.analysis.process import ProcessStudy
    from compact.analysis.study import Study

SAMPLES = 128  # [-], of the mix by columns; nearly three times the coefficients of a quadratic in eight parameters
SOBOL_SAMPLES = 1024  # [-], of the fit; its indices then scatter by less than 0.01
SEED = 2015  # of both samples
BAND = (0.05, 0.95)  # [-], quantiles of the resistance over the mix
MASS_FACTOR = 1.1  # [-], of the mass of a cart that is assumed, in either direction; a drawing is rarely farther off
DENSITY_STEP = 0.1  # [-], of the increase of the density ratio; half-width of the initial density ratio
SCALES = 7  # [-], of the resistance, at which the peaks of the recommended law are sampled
SCALE_ENDS = (0.8, 1.2)  # [-], first and last of them over the least and largest resistance of the sources
CONTENDER_SHARE = 1.5  # [-], of the least peak; laws beyond it are not first where the resistance changes
FAR_SHARE = 3.0  # [-], of the least peak; laws beyond it are not first with another drive
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
    least : dict
        Relative change of the least peak over the laws [-], by criterion.
    of : tuple of str
        Quantities of drive and cart that are others there.
    """

    words: str
    change: dict[str, dict[str, float]]
    first: dict[str, str]
    least: dict[str, float]
    of: tuple[str, ...] = ()


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

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantities of drive and cart that vary, in the order of the ends."""
        return tuple(dict.fromkeys(name for end in self.ends for name in end.of))

    def changes(self, law: str, by: str, known: str = "") -> tuple[float, float]:
        """Return the least and the largest relative change of a peak of a recommended law [-], 0 without an end.

        Ends `without_cycle` are left out.

        Parameters
        ----------
        known : str
            A quantity that does not vary.
        """
        lost = self.without_cycle(law, by)
        found = [end.change[law][by] for end in self.ends if known not in end.of and end.words not in lost]
        return min(found, default=0.0), max(found, default=0.0)

    def without_cycle(self, law: str, by: str) -> list[str]:
        """Return the ends in words of drive and cart behind which a recommended law has no periodic cycle."""
        return [end.words for end in self.ends if end.of and math.isinf(end.change[law][by])]


@dataclass(frozen=True)
class MixSpread:
    """Spread of the resistance over the parameters of the mix, by columns.

    Parameters
    ----------
    low, high : float
        Quantiles of the resistance over that of the scene [-].
    fit : float
        Coefficient of determination of the quadratic fit [-].
    ranges : dict
        Low and high value of each parameter, in its unit.
    shares : dict
        Total Sobol index of each parameter in the peak, by criterion [-].
    coefficients : tuple of float
        Quadratic fit of the logarithm of the resistance over the positions in the ranges, from -1 to 1.
    measured : dict
        Range of each parameter once it is measured, as shares of its range [-].
    load : tuple of float or None
        Quantiles of the load over that of the scene [-]; None for a forming process.
    """

    low: float
    high: float
    fit: float
    ranges: dict[str, tuple[float, float]]
    shares: dict[str, dict[str, float]]
    coefficients: tuple[float, ...]
    measured: dict[str, tuple[float, float]]
    load: tuple[float, float] | None = None

    def high_with(self, measured: str = "") -> float:
        """Return the upper quantile of the resistance over that of the scene [-] by the fit, with a value measured."""
        from scipy.stats import qmc

        shares = qmc.Sobol(len(self.ranges), rng=SEED).random(SOBOL_SAMPLES)
        if measured:
            column, (low, high) = list(self.ranges).index(measured), self.measured[measured]
            shares[:, column] = low + (high - low) * shares[:, column]
        return float(np.quantile(np.exp(quadratic_terms(shares) @ self.coefficients), BAND[1]))


@dataclass(frozen=True)
class RankingUncertainty:
    """Uncertainty of the answer from all sources.

    Parameters
    ----------
    mix : MixSpread or None
        None where columns do not cover the scene.
    laws : dict
        Recommended law by criterion.
    """

    sources: tuple[Source, ...]
    mix: MixSpread | None
    laws: dict[str, str]

    def source(self, name: str) -> Source | None:
        """Return a source by its name."""
        return next((each for each in self.sources if each.name == name), None)

    def first_laws(self, by: str) -> set[str]:
        """Return the laws that are first by a criterion at an end of a source of the margin."""
        return {end.first[by] for each in self.sources for end in each.ends}

    def margin(self, by: str, leave_out: Sequence[str] = (), law: str | None = None, known: str = "") -> float:
        """Return the margin of a motor over the peak of a recommended law [-], see `verdict`.

        Parameters
        ----------
        by : str
            Criterion.
        leave_out : sequence of str
            Names of sources that are not included.
        law : str, optional
            A recommended law; that of the criterion by default.
        known : str, optional
            Quantity of drive and cart that does not vary.
        """
        law, counted = law or self.laws[by], [each for each in self.sources if each.name not in leave_out]
        return margin_of(each.changes(law, by, known) for each in counted)


def margin_of(changes: Iterable[tuple[float, float]]) -> float:
    """Return the root of the sum of squares of the increases, of least and largest relative changes by source [-]."""
    return math.hypot(*(max(0.0, high) for _, high in changes))


Uncertainties = dict[str, RankingUncertainty]  # by the key of a scene
MESH, MAP, MIX, LAW, MODELS = "mesh", "resistance map", "parameters of the mix", "law of the mix", "other valid models"
FORCES = "measured forces"
AIR, DRIVE, SHARES = "pore air", "drive and cart", "shares after a turn"


def ranking_uncertainty(study: "Study") -> RankingUncertainty:
    """Vary every source of uncertainty of the answer of a study with a law that is first by each criterion.

    The peaks of the candidates are followed through every source.
    """
    stages, scene, models, contacts = study.stages, study.scene, study.models, study.stages.contacts
    model, case, cycles = sizing_model(models), study.case, stages.laws.cycles
    met, spread = model.resistance, models[0].spread
    laws = {by: each.law for by, each in study.nominal_verdicts.items()}
    followed_laws = dict.fromkeys((*laws.values(), *study.candidates))
    base = {by: model.values(*case, by) for by in laws}
    mix = mix_spread(scene, contacts.process, study.executor)
    sources: list[tuple[str, str, Mapping[str, Change | Peaks]]] = []  # name, variation, changes or known peaks

    forces = scene.measured_forces if model.engine == scene.accuracy.engine else None  # replace all that they determine
    errors = {MESH: getattr(model.steady, "engine_error", None), MAP: getattr(model.steady, "error", None)}
    errors[FORCES] = forces
    ratios = {name: None if error is None else (1 - error, 1 + error) for name, error in errors.items()}
    ratios |= {MIX: (mix.low, mix.high) if mix else None, LAW: spread if models[0].valid else None}
    if forces is not None:
        ratios |= dict.fromkeys((MESH, MIX, LAW))
    if model.engine == scene.accuracy.engine:
        ratios[AIR] = air_ratios(stages)
    for name, pair in ratios.items():
        if pair and max(abs(ratio - 1) for ratio in pair) >= LEAST_EFFECT:
            words = f"{pair[0]:.2f} to {pair[1]:.2f} times the resistance"
            ends = {f"{each:.2f} times": Change(f"{each:.2f} times", resistance=met.scaled(each)) for each in pair}
            sources.append((name, f"one-way to undrained, {words}" if name == AIR else words, ends))
    others = [each for each in models if each.valid and each is not model and model.valid and forces is None]
    by_model = {each.engine: {by: each.values(*case, by) for by in laws} for each in others}
    edges = model.turning is not None and isinstance(scene.drive.turn, str | None)
    variants = {each.label: each for each in drive_variants(scene, edges)}
    by_drive = {}
    for label, each in variants.items():
        moved = along_stroke(model.steady, model.turning, each.keys[SLEEVE]) if SLEEVE in each.keys else None
        by_drive[label] = Change(label, each.keys, moved)
    error = ENGINES[model.engine].turning_error if edges else None
    if error and DRIVES[scene.drive.kind].driven_end:
        scaled_peaks = {
            f"peaks {sign} {100 * error:.0f} %": {
                by: {law: (1 + way * error) * peak for law, peak in peaks.items()} for by, peaks in base.items()
            }
            for sign, way in (("−", -1), ("+", 1))
        }
        sources.append((SHARES, "against finite elements that follow the turn", scaled_peaks))
    alone = ", ".join(label for label, each in variants.items() if len(each.of) == 1)
    sources += [(MODELS, ", ".join(by_model), by_model), (DRIVE, alone, by_drive)]

    def near(share: float) -> dict[str, Cycle]:
        """Return the recommended laws, and those within a share of the least peak by any criterion."""
        close = {law for each in base.values() for law, value in each.items() if value <= share * min(each.values())}
        return {law: cycle for law, cycle in cycles.items() if law in {*close, *followed_laws}}

    extremes = [1.0, *((mix.low, mix.high) if mix else ()), *(spread or ())]
    scales = np.linspace(SCALE_ENDS[0] * min(extremes), SCALE_ENDS[1] * max(extremes), SCALES).tolist()
    changes = [each for *_, ends in sources for each in ends.values() if isinstance(each, Change)]
    followed = {"": near(CONTENDER_SHARE)} | {str(scale): near(0.0) for scale in scales}
    followed |= dict.fromkeys(by_drive, near(OIL_SHARE if DRIVES[case[1]].realises else FAR_SHARE))
    changes += [Change(str(scale), resistance=met.scaled(scale)) for scale in scales]
    run = partial(drive_peaks, stages.resistance.cart, followed, met, tuple(laws))
    solved = ensemble(scene, changes, run, study.executor)
    answers = (solved[number] for number in range(len(changes)))

    def end(words: str, values: Peaks) -> SourceEnd:
        """Return the answer with the given peaks; a recommended law that is as good but for rounding stays first."""
        found = {by: values.get(by, {}) for by in laws}
        change = {
            law: {by: found[by].get(law, math.inf) / base[by][law] - 1 for by in laws if law in base[by]}
            for law in followed_laws
        }
        least = {by: min(each.values(), default=math.inf) for by, each in found.items()}
        first = {}
        for by, law in laws.items():
            stays = found[by].get(law, math.inf) <= least[by] * (1 + LEAST_EFFECT)
            first[by] = law if stays else first_law(found[by])
        of = variants[words].of if words in variants else ()
        return SourceEnd(words, change, first, {by: least[by] / min(base[by].values()) - 1 for by in laws}, of)

    known = []
    for name, words, table in sources:
        reached = {label: next(answers) if isinstance(each, Change) else each for label, each in table.items()}
        known.append(Source(name, words, tuple(end(*each) for each in reached.items())))
    scaled = list(answers)
    peaks = {by: [each.get(by, {}).get(law, math.inf) for each in scaled] for by, law in laws.items()}
    if mix is not None:
        mix = replace(mix, shares={by: _shares(mix, np.array([scales, each])) for by, each in peaks.items()})
    return RankingUncertainty(tuple(each for each in known if each.ends), mix, laws)


def air_ratios(stages: Stages, of: str = "resistance") -> tuple[float, float] | None:
    """Return the resistance or the load with the air of a drained answer, one-way and undrained, over the answer's.

    Both are at the deformation without air; mix that yields to its air resists more where a bow wave exists.
    """
    contacts = stages.contacts
    curve, speed, model = contacts.air_curve, contacts.scene.mean_speed, contacts.scene.mix.pore_air
    if curve is None or model == "coupled":
        return None
    permeability = contacts.mix.parameter("air_permeability").value
    one_way, undrained = (
        1 + getattr(curve.at(speed, each), of) / getattr(curve, f"skeleton_{of}")
        for each in (permeability, speed / RATIOS[-1])
    )
    return (one_way, undrained) if model == "drained" else (1.0, undrained / one_way)


# the drive


def drive_variants(scene: Scene, edges: bool = False) -> list[Variant]:
    """Return the changes of drive and cart within what is known of them.

        elastic      stiffness times and over 3, and its root, at the same damping ratio; damping ratio .02 and .2; both
        hydraulic    bulk modulus of the oil times and over 3, in strokes with compressible oil
        motor        inertia of rotor and flywheel times and over 1.5
        cart         mass and weight 10 % more and less
        sleeve       edge of fresh mix near the contact (open) to midway between two rollers, with each of the drive

    The factors are judgements: a spring between cam and cart is rarely known within a factor of three before it has
    been loaded, and its damping within one of three before it has been struck. They hold for assumed values; those that
    the scene states as measured, given or published vary by the ± of their comment, if any.

    Parameters
    ----------
    edges : bool
        True if the resistance depends on the distance to fresh mix.
    """
    mass = {key: attrgetter(key)(scene) for key in ("machine.mass", "machine.weight")}
    cart = both_ways(scene, "mass", MASS_FACTOR, mass, MASS)
    found = [*(Variant(*each) for each in DRIVES[scene.drive.kind].variants(scene)), *cart]
    known = sleeve_ends(scene) if edges else {}
    sleeves = [Variant(label, {SLEEVE: ends}, (EDGE,)) for label, ends in known.items()]
    alone = [each for each in found if len(each.of) == 1]
    return [*found, *sleeves, *(sleeve.joined(each) for sleeve in sleeves for each in alone)]


# the mix


def mix_spread(
    scene: Scene, process: "ProcessStudy | None" = None, executor: Executor | None = None
) -> MixSpread | None:
    """Sample the resistance at the mean speed over the parameters of the mix, by columns.

    Parameters
    ----------
    scene : Scene
        Scene.
    process : ProcessStudy, optional
        Forming process, whose confined floor replaces the pass of columns.
    executor : Executor, optional
        Executor of the columns; this process by default.

    Returns
    -------
    MixSpread or None
        None where columns do not cover the scene.
    """
    from scipy.stats import qmc  # half a second, for fresh results only

    try:
        columns = scene.with_engine("column") if process is None else scene
    except ValueError:
        return None
    ranges, fed_key = parameter_ranges(columns, scene), ENGINES[columns.accuracy.engine].fed_key
    keys = {name: fed_key if name == FED else f"mix.overrides.{name}" for name in ranges}
    low, high = np.array([*ranges.values()]).T
    sampled = qmc.Sobol(len(ranges), rng=SEED).random(SAMPLES)
    ratio = np.divide(high, low, out=np.ones(len(low)), where=low > 0)
    values = np.where(low > 0, low * ratio**sampled, low + sampled * (high - low))  # geometric above zero
    later = parameter_ranges(columns, scene, measured=True)
    narrow = np.clip(np.array([later.get(name, ends) for name, ends in ranges.items()]).T, low, high)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(low > 0, np.log(narrow / low) / np.log(ratio), (narrow - low) / (high - low))
    measured = dict(zip(ranges, map(tuple, shares.T.tolist()), strict=True))
    changes = [Change("scene")]
    changes += [Change("point", dict(zip(keys.values(), row, strict=True))) for row in values.tolist()]
    rolled = ensemble(columns, changes, partial(_mix_resistance, process), None if process else executor)
    forces, loads = (
        np.array([rolled[number].get(name, np.nan) for number in range(len(changes))])
        for name in ("resistance", "load")
    )
    if not forces[0] > 0:
        return None
    found = forces[1:] / forces[0]
    known = found > 0  # nan without a solution
    terms, logs = quadratic_terms(sampled[known]), np.log(found[known])
    if known.sum() <= terms.shape[1]:
        return None
    coefficients = np.linalg.lstsq(terms, logs, rcond=None)[0]
    fit = 1 - float(np.var(logs - terms @ coefficients) / np.var(logs))
    (least, largest), band = np.quantile(found[known], BAND).tolist(), None
    if process is None:
        band = tuple(np.nanquantile(loads[1:] / loads[0], BAND).tolist())
    return MixSpread(least, largest, fit, ranges, {}, tuple(coefficients.tolist()), measured, band)


def quadratic_terms(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products of two of 1 and the shares scaled to -1 ... 1, shape (points, terms)."""
    factors = np.column_stack([np.ones(len(shares)), 2 * shares - 1])
    first, second = np.triu_indices(factors.shape[1])
    return factors[:, first] * factors[:, second]


def _mix_resistance(process: "ProcessStudy | None", scene: Scene, _: Change) -> dict[str, float]:
    """Return resistance and load of a roller of a scene [N/m], or the resistance of a cart of a process [N]."""
    if process is not None:
        return {"resistance": process.resistance_with(scene)}
    rolled = roll_scene(scene, scene_mix(scene), scene.mean_speed)
    return {"resistance": float(rolled.resistance), "load": float(rolled.load)}


def parameter_ranges(scene: Scene, described: Scene, measured: bool = False) -> dict[str, tuple[float, float]]:
    """Return the ranges of the parameters of the mix that columns depend on, and of the initial density ratio.

    A value that is stated as measured has the range of its ±; any other one has the relative range of the prior.

    Parameters
    ----------
    described : Scene
        Scene whose remarks state the origin of the values.
    measured : bool
        True for the ranges of values that were all measured, without a ±.
    """
    mix, typical = scene_mix(scene), prior(scene.mix.moisture, scene.mix.density_ratio)
    ranges = {}
    for name in ENGINES["column"].parameters_of(scene.mix.law):
        value, known = mix.parameter(name).value, typical.parameter(name)
        if not known.value:
            continue
        share = described.measured_spread(f"mix.overrides.{name}") or (MEASURED_SPREAD if measured else None)
        lows, highs = zip(known.spread_about(value), known.spread_about(value, share), strict=True)
        low, high = max(lows), min(highs)
        if low < high:
            ranges[name] = (low, high)
    key = ENGINES[scene.accuracy.engine].fed_key
    before, stated = attrgetter(key)(scene), described.stated_spread(key)
    step = stated * before if stated else DENSITY_STEP * (scene.mix.density_ratio - before)
    return ranges | {FED: (before - step, before + step)}


def _shares(mix: MixSpread, peaks: NDArray[np.float64]) -> dict[str, float]:
    """Return the total Sobol index of each parameter in peaks over scales of the resistance [-], by its fit."""
    from scipy.stats import sobol_indices, uniform

    coefficients, finite = np.array(mix.coefficients), peaks[:, np.isfinite(peaks[1])]

    def peak(shares: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(np.exp(quadratic_terms(shares.T) @ coefficients), *finite)

    found = sobol_indices(func=peak, n=SOBOL_SAMPLES, dists=[uniform()] * len(mix.ranges), rng=SEED)
    return dict(zip(mix.ranges, map(float, found.total_order), strict=True))
