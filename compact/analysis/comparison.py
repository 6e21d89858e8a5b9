"""Comparison of engines: the scene by another engine, in another process, and the agreement of the rankings."""

import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from compact.analysis.contact_cases import ContactRecord, HeldQuantity
from compact.analysis.pipeline import Cycles, build_stages
from compact.analysis.ranking_uncertainty import Place
from compact.scene.loader import Scene

DIRECTORY = "beside"  # under the results; kept results of the engines of the comparison

Places = dict[str, dict[str, list[Place]]]  # by drive and criterion


@dataclass(frozen=True)
class ComparisonRequest:
    """Input of `run_engine_alternative`.

    Parameters
    ----------
    scene : Scene
        The scene with the engine of the comparison.
    prescribed_cycles, cycles : mapping of str to Cycle
        Prescribed laws and all laws of the study.
    directory : Path or None
        Kept results of this engine.
    """

    scene: Scene
    prescribed_cycles: Cycles
    cycles: Cycles
    directory: Path | None


@dataclass(frozen=True)
class EngineComparison:
    """Results of one engine of the comparison.

    Parameters
    ----------
    scene : Scene
        The scene with this engine.
    contacts : list of ContactRecord
    held : HeldQuantity or None
        Quantity that is constant over speed.
    second_pass : tuple of float or None
        Load and resistance of a second pass over those of the first [-].
    resistance : callable
        Resistance of one cart [N], a function of velocity and acceleration.
    error : float or None
        Relative error estimate of the resistance [-].
    roller_load : float
        Load of one roller [N].
    places : dict
        Places of the laws by drive and criterion.
    key : str
        Of the kept results.
    counts : Counter
        Number of runs of each stage.
    warned : tuple of str
        Texts of the warnings.
    """

    scene: Scene
    contacts: list[ContactRecord]
    held: HeldQuantity | None
    second_pass: tuple[float, float] | None
    resistance: Callable
    error: float | None
    roller_load: float
    places: Places
    key: str
    counts: Counter[str]
    warned: tuple[str, ...]


def run_engine_alternative(request: ComparisonRequest) -> EngineComparison:
    """Compute contacts, resistance and places of a scene by another engine.

    Parameters
    ----------
    request : ComparisonRequest

    Returns
    -------
    EngineComparison
    """
    scene, counts = request.scene, Counter[str]()
    stages = build_stages(
        scene,
        count=lambda stage: counts.update([stage]),
        directory=request.directory,
        known_laws=(request.prescribed_cycles, request.cycles),
    )
    contacts, resistance = stages.contacts, stages.resistance
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # an invalid operation of numpy yields no valid result
        places = stages.drive.places
        # the second pass of a comparison is required by its own return stroke only
        second_pass = contacts.second_pass if scene.layer.return_stroke == "compacted" else None
    return EngineComparison(
        scene, contacts.records, contacts.held, second_pass, resistance.resistance, resistance.error,
        contacts.roller_load, places, contacts.key, counts, tuple(dict.fromkeys(str(each.message) for each in warned)),
    )  # fmt: skip
