"""Verdict of a study: answers of the models, those that may size a drive, their agreement, and the recommended law.

A model is valid for sizing if it has the whole resistance on this scene: the formulas, and engines with irreversible
compaction. A linear layer has the viscoelastic part alone, about a seventh. Columns have no bow wave, which causes more
than half of the resistance of a layer thicker than two contact lengths. Of the forming process, lumped lifts in two
dimensions have the whole, and columns the confined floor. Models whose inputs are fitted to one point count as one
witness of a rank.

A law is a contender for rank 1 by a criterion if any valid model has it first, or within its errors or the build
tolerance of the first law, or has it first at an end of a source of uncertainty. A single contender, or several that
are equal but for rounding, is a resolved rank; otherwise the contenders tie. Of the contenders of the models
themselves the recommended law has the least regret, its largest excess over the least value of any valid model.

    margin = sqrt(sum of (increase_i)^2),   increase_i = change of the peak under source i over the peak

The sources of the margin are the discretisation error, the other valid models, the laws of the mix, its parameters and
its pore air, and the drive where its data are not measured.

The yield surface of loose mix decides the height of the bow wave ahead of the roller, and no publication states it. The
contact at the mean speed is therefore computed again by the other law of `[mix]`. "drucker-prager-cap" has the ends of
the spread of the cohesion of loose mix, too, and the law of the scene those of the saturation limit, which mix below a
roller reaches in two dimensions, but not in columns. All contacts hold the quantity that the scene holds. Ratios to the
law of the scene on the same mesh contain little discretisation error, so that a coarse mesh is sufficient.

A law by which the mix heaps up in front of the roller has no ratio, but the height of the wave and the travel.
"""

import math
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from compact.analysis.contact_cases import HeldQuantity, case_of, process_detail, scene_mix, solve
from compact.analysis.stages.contacts import contact_stage
from compact.analysis.stages.drives import KnownLaws, Place, Places, Stages, build_stages
from compact.analysis.stages.kept_results import KeptResults
from compact.analysis.stages.resistance import force_at
from compact.engines import BUILT_IN, ENGINES
from compact.engines.interface import Case
from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA, ROUNDING_TIE, group_equal
from compact.material.mix import Mix
from compact.rolling_contact import Contact, EquilibriumError, Heaping, HeapingError, UnsteadyError
from compact.scene.loader import Scene

SIZING_PEAKS = ("peak_force", "peak_power")  # criteria of the verdict
PROCESS = "process"  # engine that stands beside a pass over fresh mix
DIRECTORY = "comparison"  # under the results; kept results of the engines of the comparison

# elements per contact length of "compaction" [-], with 7 the ratios change by up to 3 %; tolerance of the steady state
# [-], the waves of loose mix scatter by as much
COARSE: dict[str, Any] = {"numerics": {"increments": 4, "steady_tolerance": 1e-2}, "unlimited": False}
LINE = "drucker-prager-cap"


@dataclass(frozen=True)
class ModelAnswer:
    """Answer of one contact model.

    Parameters
    ----------
    engine : str
        Name of the engine.
    invalid : str
        Reason why the model may not size a drive; empty if it may.
    places : dict
        Places of the laws by duration [s], drive and criterion.
    mean_resistance : dict
        Resistance of one cart at the mean speed by duration of a pass [N].
    error : float or None
        Relative estimate of the discretisation error of the resistance [-]; None where the model has none.
    spread : tuple of float or None
        Least and largest resistance over the laws of the mix, over that of the model [-]; None where not computed.
    resistance : callable or None
        Resistance of one cart [N], a function of velocity and acceleration.
    fitted : tuple of str
        Inputs of the model that `[mix.fitted_at]` lists.
    roller_load : float
        Load of one roller [N].
    prior : tuple of float or None
        Load on a roller and resistance of a cart with nothing fitted, on the layer of the scene [N]; or None.
    steady, turning : optional
        Its part far from a turn, and the shares after a turn over the distance to fresh mix, see `ResistanceStage`.
    return_load_ratio : float
        Load on the return stroke over that on the forward stroke [-].
    kept : KeptResults or None
        Contacts and map of a layered engine for the next run.
    counts : Counter
        Number of runs of each stage in another process.
    warned : tuple of str
        Warnings there.
    """

    engine: str
    invalid: str
    places: dict[float, Places]
    mean_resistance: dict[float, float]
    error: float | None
    spread: tuple[float, float] | None
    resistance: Any = None
    steady: Any = None
    turning: Any = None
    fitted: tuple[str, ...] = ()
    roller_load: float = math.nan
    prior: tuple[float, float] | None = None
    return_load_ratio: float = 1.0
    kept: KeptResults | None = None
    counts: Counter[str] = field(default_factory=Counter)
    warned: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """True if the model may size a drive."""
        return not self.invalid

    @property
    def records(self) -> Sequence[Contact]:
        """Contacts over the speed; empty for the formulas."""
        return self.kept.contacts if self.kept else ()

    def first(self, duration: float, drive: str, by: str) -> list[Place]:
        """Return the places of rank 1; empty if all values are infinite.

        Parameters
        ----------
        duration : float
            Duration of a pass [s].
        drive, by : str
            Kind of drive and criterion.

        Returns
        -------
        list of Place
        """
        return [place for place in self.places[duration][drive][by] if place.rank == 1 and not place.reason]

    def values(self, duration: float, drive: str, by: str) -> dict[str, float]:
        """Return the finite values of the laws.

        Parameters
        ----------
        duration, drive, by
            As of `first`.

        Returns
        -------
        dict of str to float
            Values by law, in the unit of the criterion.
        """
        return {place.law: place.value for place in self.places[duration][drive][by] if not place.reason}


@dataclass(frozen=True)
class Verdict:
    """Verdict of all valid models on one criterion.

    Parameters
    ----------
    by, drive : str
        Criterion and kind of drive.
    duration : float
        Duration of a pass [s].
    law : str
        Recommended law.
    contenders : tuple of str
        Laws that tie for rank 1, the recommended one first; laws that are the same motion are named once.
    value : float
        Peak of the recommended law by the engine of the scene [N] or [W].
    values : dict
        The same by every valid model.
    """

    by: str
    drive: str
    duration: float
    law: str
    contenders: tuple[str, ...]
    value: float
    values: dict[str, float]


def sizing_model(models: Sequence[ModelAnswer]) -> ModelAnswer:
    """Return the first model that is valid for sizing, the first model where there is none."""
    return valid_models(models)[0]


def valid_models(models: Sequence[ModelAnswer]) -> list[ModelAnswer]:
    """Return the models that are valid for sizing, the first model where there is none."""
    return [model for model in models if model.valid] or [models[0]]


def model_answer(
    stages: Stages, spread: tuple[float, float] | None = None, prior: tuple[float, float] | None = None
) -> ModelAnswer:
    """Collect the answer of the engine of a scene.

    Parameters
    ----------
    spread : tuple of float, optional
        Least and largest resistance over the laws of the mix [-].
    prior : tuple of float, optional
        Load on a roller and resistance of a cart with nothing fitted [N].
    """
    contacts, resistance = stages.contacts, stages.resistance
    scene, motion = contacts.scene, contacts.scene.motion
    drives = {motion.duration: stages.drive, **stages.drive.other_durations}
    ratio = kept = None
    if contacts.process is None:
        with warnings.catch_warnings(action="ignore"):  # a thin layer is in the verdict
            length = contacts.at_mean_speed("contact_length")
        ratio = scene.lift_thickness / length if length > 0 else math.inf
    if contacts.held is not None:
        second_pass = contacts.second_pass if scene.layer.return_stroke == "compacted" else None
        lifts = contacts.process.lifts if contacts.process else None
        found = contacts.key, contacts.records, contacts.held, second_pass, resistance.map
        kept = KeptResults(*found, lifts=lifts and lifts.bare, prior=prior)
    engine, fit = ENGINES[scene.accuracy.engine], scene.mix.fitted_at
    is_corrected = any(each.low_fidelity == engine.name for each in BUILT_IN.values())
    foreign = f"fitted by {fit.engine}" if is_corrected and fit and fit.engine not in (None, engine.name) else ""
    return ModelAnswer(
        engine=engine.name,
        invalid=engine.valid(ratio, process_detail(scene)) or foreign,
        places={duration: each.places for duration, each in drives.items()},
        mean_resistance={t: force_at(each.resistance.resistance, motion.stroke / t) for t, each in drives.items()},
        error=resistance.error,
        spread=spread,
        resistance=resistance.resistance,
        steady=resistance.steady_law,
        turning=resistance.turning,
        fitted=fitted_inputs(scene),
        roller_load=contacts.roller_load,
        prior=prior,
        return_load_ratio=contacts.return_ratios[0],
        kept=kept,
    )


class Governing(NamedTuple):
    """Quantity that sizes a machine, and the model by which it is largest.

    Parameters
    ----------
    quantity, unit : str
        Words and unit.
    values : dict
        Value by engine, of the pass over fresh mix and of the forming process.
    engine : str
        Engine of the largest one.
    """

    quantity: str
    unit: str
    values: dict[str, float]
    engine: str


def governing_pair(models: Sequence[ModelAnswer]) -> tuple[ModelAnswer, ...]:
    """Return the first pass over fresh mix and the forming process; empty unless both are valid for sizing.

    Parameters
    ----------
    models : sequence of ModelAnswer
        Answers, that of the engine of the scene first.
    """
    passes = [each for each in models if each.engine != PROCESS and each.valid]
    processes = [each for each in models if each.engine == PROCESS and each.valid]
    return (passes[0], processes[0]) if passes and processes else ()


def larger(quantity: str, unit: str, values: dict[str, float]) -> Governing:
    """Return the values of a quantity by engine with the engine of the larger one."""
    return Governing(quantity, unit, values, max(values, key=values.__getitem__))


def governing(pair: Sequence[ModelAnswer], verdicts: Iterable[Verdict], duration: float) -> list[Governing]:
    """Compare a pass over fresh mix with the forming process next to it, quantity by quantity.

    Parameters
    ----------
    pair : sequence of ModelAnswer
        Both answers, or none.
    verdicts : iterable of Verdict
        Recommended laws, whose peaks are compared.
    duration : float
        Duration of a pass [s].

    Returns
    -------
    list of Governing
    """
    if not pair:
        return []
    found = [
        larger("load on a roller", "N", {each.engine: each.roller_load for each in pair}),
        larger("resistance of a cart", "N", {each.engine: each.mean_resistance[duration] for each in pair}),
    ]
    for each in verdicts:
        values = {model.engine: each.values.get(model.engine, math.nan) for model in pair}
        found.append(larger(f"{CRITERIA[each.by].quantity.term} of {each.law}", CRITERIA[each.by].unit, values))
    return found


Answer = ModelAnswer | HeapingError | UnsteadyError | EquilibriumError


def answer_of(lead: Scene, scene: Scene, laws: KnownLaws, directory: Path | None) -> Answer:
    """Compute the answer of the engine of a scene, in another process, with kept results of a directory.

    Parameters
    ----------
    lead : Scene
        Scene to which it is compared.

    Returns
    -------
    ModelAnswer or an error
        The error where the mix heaps up in front of the roller, the motion does not become steady or a step has no
        equilibrium, which are answers too.
    """
    counts = Counter[str]()
    if directory and scene.process is not None and scene.process.detail == "columns":  # two dimensions that are kept
        deep = scene.replaced(**{"process.detail": "deep"})
        scene = deep if build_stages(deep, directory=directory).contacts.kept else scene
    stages = build_stages(scene, count=lambda stage: counts.update([stage]), directory=directory, known_laws=laws)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # an invalid operation of numpy yields no valid result
        try:
            kept = stages.contacts.kept
            found = model_answer(stages, prior=kept.prior if kept else prior_forces(lead, scene))
        except (HeapingError, UnsteadyError, EquilibriumError) as error:
            return error
    return replace(found, counts=counts, warned=tuple(dict.fromkeys(str(each.message) for each in warned)))


def fitted_inputs(scene: Scene) -> tuple[str, ...]:
    """Return the inputs of the engine of a scene that `[mix.fitted_at]` lists.

    Returns
    -------
    tuple of str
        Keys of the scene.
    """
    engine = ENGINES[scene.accuracy.engine]
    keys = [f"mix.overrides.{name}" for name in engine.parameters_of(scene.mix.law)]
    keys += engine.fitted_keys
    fitted = scene.mix.fitted_at.parameters if scene.mix.fitted_at else ()
    return tuple(key for key in keys if key.rpartition(".")[2] in fitted and scene.is_set(key))


def regrets(models: Sequence[ModelAnswer], case: tuple[float, str], criteria: Iterable[str]) -> dict[str, float]:
    """Return the largest excess of a law over the least value by a model and criterion [-]; of laws with all values.

    Parameters
    ----------
    case : tuple
        Duration of a pass [s] and kind of drive.
    """
    tables = [(CRITERIA[by], each.values(*case, by)) for by in criteria for each in models]
    laws = [law for law in tables[0][1] if all(law in values for _, values in tables)]
    if not laws:
        return {}
    least = [min(values.values()) for _, values in tables]

    def excess(law: str) -> float:
        return max((values[law] - low) / by.scale(low) for (by, values), low in zip(tables, least, strict=True))

    return {law: excess(law) for law in laws}


def verdict(
    models: Sequence[ModelAnswer], duration: float, drive: str, by: str, firsts: Iterable[str] = ()
) -> Verdict | None:
    """Judge rank 1 by a criterion over all models that are valid for sizing.

    Parameters
    ----------
    models : sequence of ModelAnswer
        Answers, that of the engine of the scene first. Without a valid one, all are used.
    firsts : iterable of str
        First laws at the ends of the sources of uncertainty.

    Returns
    -------
    Verdict or None
        None if no law has a finite value.
    """
    valid = [each for each in models if each.valid] or list(models)
    excess = regrets(valid, (duration, drive), [by])
    if not excess:
        return None
    found: set[str] = set()  # laws that are first by a model, or within its errors or the build tolerance of the first
    for each in valid:
        finite = [place for place in each.places[duration][drive][by] if not place.reason]
        first = finite[0]
        limit = first.value + max(BUILD_TOLERANCE * CRITERIA[by].scale(first.value), first.error or 0.0)
        found |= {place.law for place in finite if place.value - (place.error or 0.0) <= limit or place.rank == 1}
    ends, values = set(firsts), {each.engine: each.values(duration, drive, by) for each in valid}

    def same(law: str, other: str) -> bool:
        return all(math.isclose(each[law], each[other], rel_tol=ROUNDING_TIE) for each in values.values())

    distinct: list[str] = []  # laws with the same values in every model are named once, unless they differ at an end
    for names in (found, ends - found):
        close = [law for law in excess if law in names]
        for i in (i for group in group_equal([excess[law] for law in close], floor=1.0) for i in group):
            if close[i] in ends or not any(same(close[i], known) for known in distinct):
                distinct.append(close[i])
    law, lead = distinct[0], values.get(models[0].engine, values[valid[0].engine])
    peaks = {engine: each[law] for engine, each in values.items()}
    return Verdict(by, drive, duration, law, tuple(distinct), lead[law], peaks)


@dataclass(frozen=True)
class LawVariant:
    """Contact of one roller by one law of the mix.

    Parameters
    ----------
    law : {"ellipse", "drucker-prager-cap"}
        Yield surface.
    cohesion_loose : float or None
        Cohesion of loose mix [Pa]; None for the ellipse, whose subcritical side follows from the cap.
    saturation_limit : float
        Density ratio that mix at rest does not exceed [-].
    load, resistance : float or None
        Ratios to the law of the scene [-]; None without a steady state.
    heaping : Heaping or None
        Numbers of a bow wave without a steady state.
    reason : str
        Reason without a steady state, in words.
    """

    law: str
    cohesion_loose: float | None
    saturation_limit: float
    load: float | None = None
    resistance: float | None = None
    heaping: Heaping | None = None
    reason: str = ""


class ModelSpread(NamedTuple):
    """Contacts by other laws of the mix.

    Parameters
    ----------
    load, resistance : tuple of float
        Least and largest value over that of the scene [-].
    variants : tuple of LawVariant
        Other laws and cohesions.
    """

    load: tuple[float, float]
    resistance: tuple[float, float]
    variants: tuple[LawVariant, ...]


def scenes_of_laws(scene: Scene, mix: Mix) -> tuple[Scene, ...]:
    """Return the scene, and its changes to the other laws of the mix.

    Parameters
    ----------
    scene : Scene
        Scene with a compacting engine.
    mix : Mix
        Its mix, whose cohesion of loose mix has a value and a spread.

    Returns
    -------
    tuple of Scene
        The scene first; the shear line at the low end, the value and the high end of the cohesion; the ends of the
        saturation limit.
    """
    spread, limit, own = mix.parameter("cohesion_loose"), mix.parameter("saturation_limit"), scene.mix.law == LINE
    changes: list[dict[str, Any]] = [{"mix.law": "ellipse"}] if own else []
    changes += [
        {"mix.law": LINE, "mix.overrides.cohesion_loose": cohesion}
        for cohesion in dict.fromkeys((spread.low, spread.value, spread.high))
        if not own or cohesion != spread.value
    ]
    changes += [{"mix.overrides.saturation_limit": end} for end in (limit.low, limit.high) if end != limit.value]
    return scene, *(scene.replaced(**keys) for keys in changes)


def contact_by_law(held: HeldQuantity, scene: Scene) -> LawVariant:
    """Compute the contact by the law of a scene at the mean speed, on a coarse mesh of its own engine.

    Parameters
    ----------
    held : HeldQuantity
        Quantity that the contact holds.
    scene : Scene
        Scene with the law.

    Returns
    -------
    LawVariant
        With load and resistance of one roller in N/m.
    """
    stage = contact_stage(scene)
    stage.held = held
    cohesion = stage.mix.cohesion_loose if scene.mix.law == LINE else None
    variant = LawVariant(scene.mix.law, cohesion, stage.mix.saturation_limit)
    try:
        case = stage.case(scene.mean_speed)
        rolled = stage.engine.contact(replace(case, **COARSE) if isinstance(case, Case) else case)
    except (ValueError, RuntimeError) as error:
        return replace(variant, heaping=getattr(error, "heaping", None), reason=str(error))
    return replace(variant, load=rolled.load, resistance=rolled.resistance)


def spread_of(contacts: Sequence[Any]) -> ModelSpread:
    """Divide load and resistance of contacts by those of the first, by the law of the scene.

    Parameters
    ----------
    contacts : sequence of LawVariant
        Contacts of `contact_by_law` in the order of `scenes_of_laws`.

    Returns
    -------
    ModelSpread

    Raises
    ------
    RuntimeError
        If the first has no steady state.
    """
    own, *others = contacts
    if own.load is None:
        raise RuntimeError(own.reason)
    variants = [
        replace(each, load=each.load / own.load, resistance=each.resistance / own.resistance) if each.load else each
        for each in others
    ]
    loads, resistances = zip((1.0, 1.0), *((each.load, each.resistance) for each in variants if each.load), strict=True)
    return ModelSpread((min(loads), max(loads)), (min(resistances), max(resistances)), tuple(variants))


def prior_forces(lead: Scene, scene: Scene) -> tuple[float, float] | None:
    """Return the load on a roller and the resistance of a cart [N] at the mean speed with the prior, on a coarse mesh.

    The prior replaces the fitted mix of a scene, on the layer of the leading one. Friction of the roller and density as
    fed, which have none, remain those of the scenes.

    Returns
    -------
    tuple of float or None
        None where no fitted value is set, for strokes of a forming process, and without a steady state.
    """
    engine, fitted = ENGINES[scene.accuracy.engine], scene.mix.fitted_at.parameters if scene.mix.fitted_at else ()
    keys = [key for key in (f"mix.overrides.{name}" for name in fitted) if scene.is_set(key)]
    if not keys or engine.reads("process"):
        return None
    layer = {f"layer.{name}": getattr(lead.layer, name) for name in ("lift_thickness", "fed_density_ratio")}
    try:
        with warnings.catch_warnings(action="ignore"):  # of the range of a prior that nobody asked for
            scene = scene.replaced(**{"compare": None, "mix.fitted_at": None, **layer, **dict.fromkeys(keys)})
            case = case_of(scene, scene_mix(scene), scene.mean_speed)
            found = solve(engine, scene, case if engine.affordable else replace(case, **COARSE))
    except (ValueError, RuntimeError):
        return None
    length = scene.machine.roller_length
    return found.load * length, found.resistance * length * scene.machine.rollers
