"""Verdict of a study: the models that may size a drive, their agreement, and the recommended law with its margin.

A model is valid for sizing if it has the whole resistance: the formulas, and the engines with irreversible compaction.
A linear layer has the viscoelastic part alone, about a seventh. Of the forming process, lumped lifts in two dimensions
have the whole, and columns the confined floor.

A law is a contender for rank 1 by a criterion if any valid model has it first, or within its errors or the build
tolerance of the first law, or has it first where the resistance is scaled to an end of the spread of the mix. A single
contender, or several that are equal but for rounding, is a resolved rank; otherwise the contenders tie. Of these the
recommended law has the least regret, its largest excess over the least value of any valid model.

    margin = sqrt(sum of (increase_i)^2),   increase_i = change of the peak under source i over the peak

The sources of the margin are the discretisation error, the other valid models, the laws of the mix and its parameters.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compact.analysis.contact_cases import ContactRecord
from compact.analysis.engines import is_for_sizing
from compact.analysis.ranking_uncertainty import Place
from compact.analysis.stages.comparison import EngineComparison, Places
from compact.analysis.stages.drives import Stages
from compact.machine.ranking import BUILD_TOLERANCE, CRITERIA

SIZING_PEAKS = ("peak_force", "peak_power")  # criteria of the verdict
ROUNDING = 1e-9  # [-], relative; laws whose values are closer in every model are the same motion


@dataclass(frozen=True)
class ModelAnswer:
    """Answer of one contact model.

    Parameters
    ----------
    engine : str
        Name of the engine.
    valid : bool
        True if the model may size a drive.
    places : dict
        Places of the laws by duration [s], drive and criterion.
    mean_resistance : dict
        Resistance of one cart at the mean speed by duration of a pass [N].
    coefficient : dict
        Rolling-resistance coefficient there [-].
    error : float or None
        Relative estimate of the discretisation error of the resistance [-]; None where the model has none.
    spread : tuple of float or None
        Least and largest resistance over the laws of the mix, over that of the model [-]; None where not computed.
    """

    engine: str
    valid: bool
    places: dict[float, Places]
    mean_resistance: dict[float, float]
    coefficient: dict[float, float]
    error: float | None
    spread: tuple[float, float] | None

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
    resolved : bool
        True if the valid models agree on rank 1 beyond their errors and the spread of the mix.
    agree : bool
        True if the first law of every valid model is the recommended one, whatever the errors.
    value : float
        Peak of the recommended law by the engine of the scene [N] or [W].
    values : dict
        The same by every valid model.
    regret : float
        Largest excess of the recommended law over the least value of a valid model [-].
    """

    by: str
    drive: str
    duration: float
    law: str
    contenders: tuple[str, ...]
    resolved: bool
    agree: bool
    value: float
    values: dict[str, float]
    regret: float


def model_answers(
    stages: Stages, comparison: Mapping[str, EngineComparison], spread: tuple[float, float] | None
) -> list[ModelAnswer]:
    """Collect the answers of the engine of the scene, first, and of the engines of the comparison.

    Parameters
    ----------
    spread : tuple of float or None
        Least and largest resistance over the laws of the mix [-], by the engine of the scene.

    Returns
    -------
    list of ModelAnswer
    """
    scene, drive = stages.contacts.scene, stages.drive
    duration = scene.motion.duration
    own = {duration: drive.places} | {each: stage.places for each, stage in drive.other_durations.items()}
    lead = stages.resistance
    own_load = _loads(stages, stages.contacts.records, stages.contacts.roller_load)
    own_force = {each: lead.over(each).resistance for each in own}
    found = [_answer(stages, scene.accuracy.engine, own, own_force, own_load, lead.error, spread)]
    for name, other in comparison.items():
        places = {duration: other.places, **other.places_over}
        load = _loads(stages, other.contacts, other.roller_load)
        force = {duration: other.resistance, **other.resistance_over}
        found.append(_answer(stages, name, places, force, load, other.error, None))
    return found


def _loads(stages: Stages, contacts: Sequence[ContactRecord], load: float) -> Callable[[float], float]:
    """Return the load of one roller over the speed [N], that at the mean speed where there are no contacts."""
    if not contacts:
        return lambda _speed: load
    speeds, loads = np.log([each.speed for each in contacts]), [each.load for each in contacts]
    length = stages.contacts.scene.machine.roller_length
    return lambda speed: float(length * np.interp(np.log(speed), speeds, loads))


def _answer(
    stages: Stages, engine: str, places: dict[float, Places], resistance: Mapping[float, Any],
    load: Callable[[float], float], error: float | None, spread: tuple[float, float] | None,
) -> ModelAnswer:  # fmt: skip
    scene = stages.contacts.scene
    speeds = {duration: scene.motion.stroke / duration for duration in places}
    forces = {each: float(np.ravel(resistance[each](np.array([v]), np.zeros(1)))[0]) for each, v in speeds.items()}
    coefficients = {each: force / (scene.machine.rollers * load(speeds[each])) for each, force in forces.items()}
    valid = is_for_sizing(scene if engine == scene.accuracy.engine else scene.with_engine(engine))
    valid = valid and (engine != "formula" or scene.machine.roller_condition != "pair")  # whose one roller it replaces
    return ModelAnswer(engine, valid, places, forces, coefficients, error, spread)


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
    values = {each.engine: each.values(duration, drive, by) for each in valid}
    laws = [law for law in next(iter(values.values())) if all(law in found for found in values.values())]
    if not laws:
        return None
    rankings = [each.places[duration][drive][by] for each in valid]
    found = {law for order in rankings for law in contenders(order, by)} | set(firsts)
    least = {engine: min(each.values()) for engine, each in values.items()}

    def regret(law: str) -> float:
        return max(_excess(values[engine][law], low, by) for engine, low in least.items())

    ordered = sorted((law for law in laws if law in found), key=regret)
    distinct = _distinct(ordered, values)
    first = distinct[0]
    leaders = [{place.law for place in each.first(duration, drive, by)} for each in valid]
    lead = values.get(models[0].engine) or next(iter(values.values()))
    return Verdict(
        by, drive, duration, first, tuple(distinct), len(distinct) == 1, all(first in each for each in leaders),
        lead[first], {engine: each[first] for engine, each in values.items()}, regret(first),
    )  # fmt: skip


def contenders(order: Sequence[Place], by: str) -> list[str]:
    """Return the laws that are first, or within the errors or the build tolerance of the first law.

    Parameters
    ----------
    order : sequence of Place
        Places of one model, in order.
    by : str
        Criterion.

    Returns
    -------
    list of str
        Names of laws.
    """
    finite = [place for place in order if not place.reason]
    if not finite:
        return []
    first = finite[0]
    limit = first.value + max(BUILD_TOLERANCE * CRITERIA[by].scale(first.value), first.error or 0.0)
    return [place.law for place in finite if place.value - (place.error or 0.0) <= limit or place.rank == 1]


def _excess(value: float, least: float, by: str) -> float:
    scale = CRITERIA[by].scale(least)
    return (value - least) / scale if scale else 0.0


def _distinct(laws: Sequence[str], values: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Name laws with the same values in every model once."""
    found: list[str] = []
    for law in laws:
        if not any(all(math.isclose(v[law], v[known], rel_tol=ROUNDING) for v in values.values()) for known in found):
            found.append(law)
    return found
