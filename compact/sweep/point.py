"""Results of one point of a sweep, with errors and balance residuals, or the reason of a failure.

    results, contact = headline(scene)
    results["resistance"], results["resistance_error"]

A point that fails has the results of its mix only, and the reason. The contact is that at the mean speed.
"""

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from compact import quantities
from compact.analysis.engines import ENGINES
from compact.analysis.failures import internal_sentence, is_numeric, is_refusal, memory_sentence, numeric_sentence
from compact.analysis.pore_air import AirForces, coupled_forces, is_coupled, pore_air_of
from compact.analysis.stages.contacts import Passes, air_forces_of, roll_passes
from compact.analysis.study import Study
from compact.material.mix import Mix
from compact.quantities import Quantity
from compact.rolling_contact import ContactResult
from compact.scene.engine_capabilities import adapt
from compact.scene.loader import Scene, SceneError

Results = dict[str, Any]  # value by name

WORDS = {
    "not_reachable": "reason why rolling does not achieve the density; empty if it does",
    "warnings": "warnings of the computation",
    "replaced": "keys with a default that the engine replaced by the nearest value it accepts",
    "reason": "reason of a failure; empty for a point with results",
}
MAX_TEXT_LENGTH = 400  # characters of a reason


def ranking_variables(criteria: Sequence[str]) -> tuple[dict[str, Quantity], dict[str, str]]:
    """Return the further variables of a sweep with rankings."""
    numbers = {by: quantities.CRITERIA[by] for by in criteria}
    return numbers, {f"best_law_by_{by}": f"law of the least {numbers[by].term}" for by in criteria}


def headline(
    scene: Scene, rank: bool = False, initial_guess: ContactResult | None = None
) -> tuple[Results, ContactResult | None]:
    """Compute the results of one point; an error is also a result.

    Parameters
    ----------
    initial_guess : ContactResult, optional
        Contact of a neighbour, for engines with continuation over the same layer.

    Returns
    -------
    results : dict
        Values of `quantities.SWEEP_POINT` and WORDS, with `rank` also those of `ranking_variables`.
    contact : ContactResult or None
        Initial guess of the next point; None for engines without continuation.
    """
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # an invalid operation of numpy yields no valid result
        found: Results = {}
        contact = initial_guess
        try:
            study = Study(scene)
            found["required_pressure"] = float(study.mix.required_pressure)
            found["saturation"] = float(study.mix.saturation)
            found["not_reachable"] = study.mix.density_achievable.reason
            numbers, contact = _computed(study, rank, initial_guess)
            found |= numbers
        except Exception as error:  # a failed point does not stop a sweep
            found["reason"] = reason(error)
    found["replaced"] = "; ".join(filter(None, (*adapt(scene, scene.accuracy.engine)[1], scene.mix.fit_remark)))
    found["warnings"] = "; ".join(dict.fromkeys(str(warning.message) for warning in warned))[:MAX_TEXT_LENGTH]
    return found, contact if ENGINES[scene.accuracy.engine].continuation else None


def reason(error: Exception) -> str:
    """Describe an error; unexpected errors are marked as internal.

    Returns
    -------
    str
        At most MAX_TEXT_LENGTH characters.
    """
    message = "; ".join(error.mistakes) if isinstance(error, SceneError) else str(error)
    if isinstance(error, MemoryError):
        message = memory_sentence(error)
    elif is_numeric(error):
        message = numeric_sentence(error)
    elif not is_refusal(error):
        message = internal_sentence(error)
    return message[:MAX_TEXT_LENGTH]


def _computed(study: Study, rank: bool, initial_guess: ContactResult | None) -> tuple[Results, ContactResult | None]:
    """Return the results of the contact at the mean speed, and the contact; None for the formulas."""
    scene, speed = study.scene, study.scene.mean_speed
    if not study.stages.contacts.engine.layered:
        contact, found = None, _of_formulas(study)
    else:
        contact, *later = _passes(scene, study.mix, speed, initial_guess)
        last = later[-1] if later else contact
        found = _of_contact(scene, _with_air(scene, study.mix, contact), last)
    found["power"] = found["resistance"] * speed
    if rank:
        for by, (best, *_) in study.rankings.items():
            found |= {by: best.value, f"best_law_by_{by}": best.run.name}
    return {name: value if isinstance(value, str) else float(value) for name, value in found.items()}, contact


def _with_air(scene: Scene, mix: Mix, contact: ContactResult) -> ContactResult:
    """Return a contact at the mean speed with load and resistance of its pore air; itself for drained mix."""
    air: AirForces | None
    if is_coupled(scene):
        air = coupled_forces(contact, pore_air_of(mix, scene.layer.fed_density_ratio), scene.mean_speed)
    else:
        air = air_forces_of(scene, mix, contact, scene.mean_speed)
    if air is None:
        return contact
    return replace(contact, load=contact.load + air.load, resistance=contact.resistance + air.resistance)


def _passes(scene: Scene, mix: Mix, speed: float, initial_guess: ContactResult | None) -> Passes:
    """Compute all passes, from the initial guess if that converges, else from scratch."""
    if initial_guess is not None and scene.layer.passes == 1 and ENGINES[scene.accuracy.engine].continuation:
        with suppress(RuntimeError):
            return roll_passes(scene, mix, speed, (initial_guess,))
    return roll_passes(scene, mix, speed)


def _of_formulas(study: Study) -> Results:
    """Return eqs 1.4-1.8 at the pressure of the scene."""
    formulas = study.stages.contacts.engineering
    return {
        "load": formulas.roller_force,
        "resistance": study.scene.machine.rollers * formulas.roller_resistance,
        "resistance_coefficient": formulas.resistance_coefficient,
        "capture_angle": formulas.capture_angle,
        "contact_length": formulas.contact_length,
        "peak_pressure": formulas.pressure,
    }


def _of_contact(scene: Scene, first: ContactResult, last: ContactResult) -> Results:
    """Return the results of the first pass, and the exit density ratio of the last."""
    machine = scene.machine
    load_error, resistance_error = first.error or (np.nan, np.nan)
    balances = {"work_residual": first.work_residual, "mass_residual": getattr(first, "mass_residual", None)}
    return {
        "load": machine.roller_length * first.load,
        "resistance": machine.rollers * machine.roller_length * first.resistance,
        "resistance_coefficient": first.resistance / first.load,
        "capture_angle": np.arcsin(first.leading / machine.roller_radius),
        "contact_length": first.leading - first.trailing,
        "peak_pressure": first.peak_pressure,
        "exit_density_ratio": getattr(last, "exit_density_ratio", np.nan),
        "load_error": load_error,
        "resistance_error": resistance_error,
    } | {name: np.nan if value is None else value for name, value in balances.items()}
