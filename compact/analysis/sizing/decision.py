"""Decision of a study: one law with the sizes of its machine, and one alternative.

Candidates are the distinct motions of least regret over the valid models by force and power, the recommended law of
each criterion, and robust laws. Of them the decided law is the one whose force and power with their margins exceed the
least ones of the candidates least; the alternative is the next.

    size for = value (1 + margin),   margin = sqrt(sum of (increase_i)^2) over the sources of the margin

Shaft and motor take the changes of the peak power, as the shaft turns uniformly. The load on a roller changes with
mesh, mix, laws of the mix, pore air and model.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from compact.analysis.machine_models import catalogue
from compact.analysis.stages import uncertainty as sources
from compact.analysis.stages.drives import SAME_TRAVEL, same_motions
from compact.analysis.stages.uncertainty import (
    AIR,
    DRIVE,
    FORCES,
    LAW,
    MESH,
    MIX,
    MODELS,
    RankingUncertainty,
    air_ratios,
)
from compact.analysis.stages.verdict import ModelAnswer, regrets, sizing_model, valid_models
from compact.machine.component_sizing import choose_motor
from compact.machine.ranking import CRITERIA
from compact.motion.profile import Cycle
from compact.scene import loader, plant_data, schema

if TYPE_CHECKING:
    from compact.analysis.study import Study

CANDIDATES = 4  # [-], laws of least regret that are followed through every source, besides those of the verdicts
WORTH = 0.01  # [-], of the margins that a measurement must be worth to be named
FORCE_SOURCES = MESH, MIX, LAW, MODELS, FORCES  # of the margin, in place of which the ± of a measured force stands
CAM_FOLLOWER, CAM_ITEMS = "roller", {"cams", "report"}  # outputs that state whether the cam can be cut

Changes = dict[str, tuple[float, float]]
Case = tuple[float, str]


@dataclass(frozen=True)
class Size:
    """Quantity that sizes a machine.

    Parameters
    ----------
    term, unit : str
        Words and SI unit.
    value : float
        Value by the model that sizes.
    changes : dict
        Least and largest relative change [-] by source of the margin.
    """

    term: str
    unit: str
    value: float
    changes: Changes = field(default_factory=dict)

    @property
    def margin(self) -> float | None:
        """Root of the sum of squares of the increases [-]; None where no source was varied."""
        return sources.margin_of(self.changes.values()) if self.changes else None

    @property
    def low(self) -> float | None:
        """Lower end of the range, by the decreases."""
        fall = math.hypot(*(min(0.0, low) for low, _ in self.changes.values()))
        return self.value * max(0.0, 1 - fall) if self.changes else None

    @property
    def high(self) -> float:
        """Value to size for, the upper end of the range."""
        return self.value * (1 + (self.margin or 0.0))

    @property
    def shares(self) -> dict[str, float]:
        """Share of each source in the square of the margin [-], the largest first."""
        squares = {name: max(0.0, high) ** 2 for name, (_, high) in self.changes.items()}
        total = sum(squares.values())
        found = {name: each / total for name, each in squares.items() if each > 0} if 0 < total < math.inf else {}
        return dict(sorted(found.items(), key=lambda each: -each[1]))


@dataclass(frozen=True)
class Choice:
    """Choice of a law.

    Parameters
    ----------
    law : str
        Decided law.
    alternative : str or None
        The next law; None with one law alone.
    candidates : tuple of str
        Laws among which it was decided.
    excess : float
        Of the peaks of the law with their margins over the least ones of the candidates, at most [-].
    """

    law: str
    alternative: str | None
    candidates: tuple[str, ...]
    excess: float


@dataclass(frozen=True)
class Decision(Choice):
    """One law, the sizes of its machine, and one alternative.

    Parameters
    ----------
    engine, invalid : str
        Model that sizes, and the reason why it may not; empty if it may.
    sizes, other_sizes : dict of str to Size
        Sizes by key of the decided law and of the alternative: peak_force, peak_power, shaft_torque, motor_rating,
        roller_load, peak_jerk, pressure_angle; those of the alternative are peaks and shaft alone.
    motor : str or None
        Smallest motor of the catalogue that holds with the margin, empty if none does; None without a catalogue.
    cam : str
        Reason why the cam cannot be cut; empty if it can, or without a table [cam].
    regrets : dict
        Excess of the law over the first one [-] by valid model and criterion.
    drive : dict
        By criterion: ends of the drive at which another law is first, their number, and the largest excess there [-].
    measurements : list of dict
        What to measure, see `measurements`.
    """

    engine: str
    invalid: str
    sizes: dict[str, Size]
    other_sizes: dict[str, Size]
    motor: str | None
    cam: str
    regrets: dict[str, dict[str, float]]
    drive: dict[str, tuple[int, int, float]]
    measurements: list[dict[str, Any]]


def candidates(
    models: Sequence[ModelAnswer], case: Case, criteria: Iterable[str], cycles: Mapping[str, Cycle],
    named: Iterable[str] = (),
) -> tuple[str, ...]:  # fmt: skip
    """Return the laws that are followed through every source of uncertainty.

    Parameters
    ----------
    case : tuple
        Duration of a pass [s] and kind of drive.
    named : iterable of str
        Laws that are candidates in any case.

    Returns
    -------
    tuple of str
        Distinct motions; the named laws first, then those of least regret.
    """
    regret = regrets(valid_models(models), case, criteria)
    same = same_motions({law: cycles[law] for law in cycles if law in regret})
    ordered = sorted((law for law in same if same[law] == law), key=lambda law: round(regret[law], 9))
    return tuple(dict.fromkeys([*(same.get(law, law) for law in named if law in same), *ordered[:CANDIDATES]]))


def choose(
    models: Sequence[ModelAnswer], case: Case, laws: Sequence[str], criteria: Iterable[str],
    known: RankingUncertainty | None,
) -> Choice | None:  # fmt: skip
    """Choose the law whose peaks with their margins exceed the least ones of the candidates least.

    Returns
    -------
    Choice or None
        None without a candidate.
    """
    model, criteria = sizing_model(models), tuple(criteria)
    sizes = {law: [_peak(model, case, by, law, known) for by in criteria] for law in laws}

    def excess_of(law: str, measure: str) -> float:
        pairs = [(getattr(own, measure), min(getattr(each[i], measure) for each in sizes.values()))
                 for i, own in enumerate(sizes[law])]  # fmt: skip
        return max((one / least - 1 if math.isfinite(least) else 0.0 for one, least in pairs), default=0.0)

    excess = {law: excess_of(law, "high") for law in laws}
    if not excess:
        return None
    first, *others = sorted(laws, key=lambda law: (round(excess[law], 9), round(excess_of(law, "value"), 9)))
    return Choice(first, next(iter(others), None), tuple(laws), excess[first])


def decide(study: "Study") -> Decision | None:
    """Collect the sizes of the decided law and of the alternative; None where no law has finite peaks."""
    choice, stages, scene, model = study.choice, study.stages, study.scene, sizing_model(study.models)
    if choice is None:
        return None
    law, sizing, known = choice.law, study.machine_sizing, study.uncertainty
    own, other = (_sizes(study, each) for each in (law, choice.alternative))
    own["roller_load"] = Size("load on a roller", "N", model.roller_load, _load_changes(study, model))
    own["peak_jerk"] = Size("peak jerk", "m/s3", stages.laws.cycles[law].forward.peaks().jerk)
    cam, motor, drive = "", None, {}
    if scene.cam is not None and CAM_ITEMS & {*scene.output.items}:
        try:
            made = stages.laws.cam(law, CAM_FOLLOWER)
            own["pressure_angle"] = Size("pressure angle", "rad", made.largest_pressure_angle)
            cam = "undercut" if made.undercut else ""
        except ValueError as error:
            cam = str(error)
    motors, shaft, power = catalogue(scene), sizing.laws.get(law), own.get("peak_power")
    if motors and shaft and shaft.requirement:
        margin = max(sizing.rule.margin, 1 + (power.margin or 0.0) if power else 0.0)
        chosen = choose_motor(motors, shaft.requirement, replace(sizing.rule, margin=margin)).chosen
        motor = chosen.motor.name if chosen else ""
    regrets: dict[str, dict[str, float]] = {}
    for each in valid_models(study.models):
        values = {by: each.values(*study.case, by) for by in study.sizing_peaks}
        regrets[each.engine] = {by: v.get(law, math.inf) / min(v.values()) - 1 for by, v in values.items()}
    source = known.source(DRIVE) if known else None
    drives = source.ends if source else ()
    for by in known.laws if known and drives else ():
        peaks = model.values(*study.case, by)
        ratio = peaks[law] / min(peaks.values())
        ends = [end for end in drives if math.isfinite(end.change[law][by])]  # those with a periodic cycle
        excess = [ratio * (1 + end.change[law][by]) / (1 + end.least[by]) - 1 for end in ends]
        drive[by] = sum(each > SAME_TRAVEL for each in excess), len(excess), max(excess, default=0.0)
    return Decision(
        **vars(choice), engine=model.engine, invalid=model.invalid, sizes=own, other_sizes=other, motor=motor, cam=cam,
        regrets=regrets, drive=drive, measurements=measurements(study),
    )  # fmt: skip


def measurements(study: "Study") -> list[dict[str, Any]]:
    """Return what may be measured, the largest gain first.

    A quantity of the mix then varies by a tenth; the forces of a slow pass, within a tenth, replace mesh, mix, its laws
    and the other models, but not the pore air of a fast one; a quantity of the drive no longer varies.

    Returns
    -------
    list of dict
        what, how (the instrument), procedure, expected (of any machine) and cost in words; range, low to high, of what
        is known of the quantity today; margins before and after by criterion [-].
    """
    found: list[dict[str, Any]] = []
    known, choice, table = study.uncertainty, study.choice, plant_data.instruments()
    if known is None or choice is None:
        return []
    margins = {by: known.margin(by, law=choice.law) for by in known.laws}

    def tell(name: str, what: str, ends: Iterable[float], unit: str, after: dict[str, float]) -> None:
        low, high = (float(f"{end:.3g}") for end in (min(ends), max(ends)))
        now = {"range": {"low": low, "high": high, "unit": unit}, "before": margins, "after": after}
        found.append({"what": what, **table.get(name, table["other"]), **now})

    drive, mix = known.source(DRIVE), known.source(MIX)
    for name in drive.quantities if drive else ():
        after = {by: known.margin(by, law=choice.law, known=name) for by in known.laws}
        tell(name, name, *_ends_of(study.scene, name), after)
    forces = [each.mean_resistance[study.case[0]] for each in valid_models(study.models)]
    forces += [forces[0] * ratio for ratio in (known.mix.low, known.mix.high)] if known.mix else []
    after = {by: math.hypot(known.margin(by, FORCE_SOURCES, choice.law), loader.MEASURED_SPREAD) for by in known.laws}
    tell("force on the cart", "force on the cart", forces, "N", after)
    rises = {by: max(0.0, mix.changes(choice.law, by)[1]) for by in known.laws} if mix else {}
    if known.mix and mix:
        today = known.mix.high_with() - 1
        for name, ends in known.mix.ranges.items():
            left = min(1.0, max(0.0, known.mix.high_with(name) - 1) / today) if today > 0 else 1.0
            after = {by: math.sqrt(max(0.0, margins[by] ** 2 - (1 - left**2) * rise**2)) for by, rise in rises.items()}
            key = f"mix.overrides.{name}" if name != sources.FED else f"layer.{name}"
            words = schema.declared_keys()[key].description or name
            what, unit = words.rsplit(" in ", 1)[0].removeprefix("the "), schema.extra_of(key).get("unit", "1")
            tell(name, what, ends, unit, after)

    def gain(each: dict[str, Any]) -> float:
        return sum(margins[by] - each["after"][by] for by in margins if margins[by] < math.inf)

    return sorted((each for each in found if gain(each) > WORTH), key=gain, reverse=True)


def _ends_of(scene: loader.Scene, name: str) -> tuple[list[float], str]:
    """Return the values of a quantity of drive or cart over what is known of it, and its unit."""
    ends = [
        (key, end) for each in sources.drive_variants(scene, edges=True) if each.of == (name,)
        for key, value in each.keys.items() if value != attrgetter(key)(scene) for end in np.ravel(value).tolist()
    ]  # fmt: skip
    return [end for key, end in ends if key == ends[0][0]], schema.extra_of(ends[0][0]).get("unit", "1")


def _peak(model: ModelAnswer, case: Case, by: str, law: str, known: RankingUncertainty | None) -> Size:
    """Return a peak of a law by the model that sizes, with its changes by the sources of the margin."""
    changes = {each.name: each.changes(law, by) for each in known.sources} if known else {}
    quantity = CRITERIA[by].quantity
    return Size(quantity.term, quantity.unit, model.values(*case, by).get(law, math.inf), changes)


def _sizes(study: "Study", law: str | None) -> dict[str, Size]:
    """Return the peaks of a law, and torque of the shaft and rated power of a motor at the peak power by the model."""
    if law is None:
        return {}
    model, sizing = sizing_model(study.models), study.machine_sizing
    found = {by: _peak(model, study.case, by, law, study.uncertainty) for by in study.sizing_peaks}
    shaft, power = sizing.laws.get(law), found.get("peak_power")
    if shaft is None or shaft.requirement is None:
        return found
    leads = shaft.engine == study.scene.accuracy.engine  # else of the larger model, as it is
    factor = power.value / study.stages.drive.runs[law].peak_power if power and leads else 1.0
    changes = power.changes if power else {}
    return found | {
        "shaft_torque": Size("shaft torque", "Nm", factor * shaft.requirement.peak_torque, changes),
        "motor_rating": Size("motor rating", "W", factor * shaft.required_power / sizing.rule.margin, changes),
    }


def _load_changes(study: "Study", model: ModelAnswer) -> Changes:
    """Return the relative changes of the load on a roller by source."""
    known, spread, found = study.uncertainty, study.model_spread, Changes()
    if known is None:
        return found
    error = max((each.load_error or 0.0 for each in model.records), default=0.0)
    if error:
        found[MESH] = -error, error
    if known.mix and known.mix.load:
        found[MIX] = known.mix.load[0] - 1, known.mix.load[1] - 1
    for name, ratios in ((LAW, spread and spread.load), (AIR, air_ratios(study.stages, "load"))):
        if ratios and model is study.models[0]:
            found[name] = ratios[0] - 1, ratios[1] - 1
    if known.source(FORCES):
        error = study.scene.measured_forces or 0.0
        return {FORCES: (-error, error)} | {name: found[name] for name in (AIR,) if name in found}
    others = [each.roller_load / model.roller_load - 1 for each in study.models if each.valid and each is not model]
    if others:
        found[MODELS] = min(0.0, *others), max(0.0, *others)
    return found
