"""Comparison of engines: the scene by another engine, in another process, and the agreement of the rankings."""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from compact.analysis.contact_cases import HeldQuantity
from compact.analysis.ranking_uncertainty import Agreement, Place, agreement
from compact.analysis.stages.drives import KnownLaws, Stages, build_stages
from compact.rolling_contact import Contact, EquilibriumError, HeapingError, UnsteadyError
from compact.scene.loader import Scene

DIRECTORY = "comparison"  # under the results; kept results of the engines of the comparison

NAMED_LAWS = 3  # [-], largest number of laws of one rank that are named

Places = dict[str, dict[str, list[Place]]]  # by drive and criterion


@dataclass(frozen=True)
class EngineComparison:
    """Results of one engine of the comparison.

    Parameters
    ----------
    second_pass : tuple of float or None
        Load and resistance of a second pass over those of the first [-].
    resistance : callable
        Resistance of one cart [N], a function of velocity and acceleration.
    error : float or None
        Relative error estimate of the resistance [-].
    roller_load : float
        Load of one roller [N].
    places_over, resistance_over : dict
        Places and resistance by each other duration of a pass [s].
    """

    records: list[Contact]
    held: HeldQuantity | None
    second_pass: tuple[float, float] | None
    resistance: Callable
    error: float | None
    roller_load: float
    places: Places
    places_over: dict[float, Places]
    resistance_over: dict[float, Callable]
    key: str
    counts: Counter[str] = field(default_factory=Counter)
    warned: tuple[str, ...] = ()


ComparisonAnswer = EngineComparison | HeapingError | UnsteadyError | EquilibriumError


def engine_answer(stages: Stages) -> EngineComparison:
    """Collect contacts, resistance and places of the engine of a scene."""
    contacts, resistance, drive = stages.contacts, stages.resistance, stages.drive
    places, over = drive.places, {duration: stage.places for duration, stage in drive.other_durations.items()}
    # the second pass of a comparison is required by its own return stroke only
    second_pass = contacts.second_pass if stages.contacts.scene.layer.return_stroke == "compacted" else None
    return EngineComparison(
        contacts.records, contacts.held, second_pass, resistance.resistance, resistance.error, contacts.roller_load,
        places, over, {duration: resistance.over(duration).resistance for duration in over}, contacts.key,
    )  # fmt: skip


def run_engine_alternative(scene: Scene, laws: KnownLaws, directory: Path | None) -> ComparisonAnswer:
    """Compute contacts, resistance and places of a scene with the engine of the comparison.

    Returns
    -------
    EngineComparison or an error
        The error where the mix heaps up in front of the roller, the motion does not become steady or a step has no
        equilibrium, which are answers too.
    """
    counts = Counter[str]()
    stages = build_stages(scene, count=lambda stage: counts.update([stage]), directory=directory, known_laws=laws)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # an invalid operation of numpy yields no valid result
        try:
            found = engine_answer(stages)
        except (HeapingError, UnsteadyError, EquilibriumError) as error:
            return error
    words = tuple(dict.fromkeys(str(each.message) for each in warned))
    return replace(found, counts=counts, warned=words)


def resistances_without_wave(scene: Scene) -> dict[str, float]:
    """Compute the resistance of a cart at the mean speed [N] by formula and by columns, which have no bow wave.

    Columns are absent where they do not cover the scene.
    """
    formula = build_stages(scene.with_engine("formula")).contacts.engineering.roller_resistance
    found = {"formula": scene.machine.rollers * float(formula)}
    with suppress(ValueError, RuntimeError):
        rolled = build_stages(scene.with_engine("column")).contacts.reference[0]
        found["column"] = scene.machine.rollers * scene.machine.roller_length * float(rolled.resistance)
    return found


@dataclass(frozen=True)
class RankingAgreement:
    """Agreement of two rankings by one criterion.

    Parameters
    ----------
    first, other_first : str
        First law of either ranking; several laws, their number or "none" where there is not one.
    """

    engine: str
    drive: str
    other_engine: str
    other_drive: str
    by: str
    agreement: Agreement
    first: str
    other_first: str


def ranking_agreements(places: Mapping[str, Places]) -> list[RankingAgreement]:
    """Compare the first ranking with those of every other engine, and with those of its other drives.

    Parameters
    ----------
    places : mapping of str to Places
        Places by engine, drive and criterion; engine and drive of the scene first.
    """
    engine, *other_engines = places
    drive, *other_drives = places[engine]
    cases = [(kind, name, kind) for name in other_engines for kind in places[engine]]
    cases += [(drive, engine, other) for other in other_drives]
    return [
        RankingAgreement(
            engine, kind, name, other_kind, by, agreement(order, other, by), *map(_first_laws, (order, other))
        )
        for kind, name, other_kind in cases
        for by, order in places[engine][kind].items()
        for other in (places[name][other_kind][by],)
    ]


def _first_laws(order: list[Place]) -> str:
    """Name the laws of rank 1, or their number where they are many; "none" where all values are infinite."""
    laws = [place.law for place in order if place.rank == 1 and not place.reason]
    if not laws:
        return "none"
    return "/".join(sorted(laws)) if len(laws) <= NAMED_LAWS else f"{len(laws)} laws alike"
