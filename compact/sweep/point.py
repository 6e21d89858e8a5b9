"""Results of one point of a sweep, with errors and balance residuals, or the reason of a failure.

    results, contact = headline(scene)
    results["resistance"], results["resistance_error"]

A point that fails has the results of its mix only, and the reason. The contact is that at the mean speed.
"""

import warnings
from contextlib import suppress
from typing import Any

import numpy as np

from compact.analysis.contact_cases import Passes, air_forces_of, roll_passes
from compact.analysis.failures import internal_sentence, is_numeric, is_refusal, memory_sentence, numeric_sentence
from compact.analysis.pore_air import AirForces, coupled_forces, is_coupled, pore_air_of
from compact.analysis.study import Study
from compact.engines import ENGINES
from compact.rolling_contact import Contact
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


def headline(scene: Scene, rank: bool = False, initial_guess: Contact | None = None) -> tuple[Results, Contact | None]:
    """Compute the results of one point; an error is also a result.

    Parameters
    ----------
    initial_guess : Contact, optional
        Contact of a neighbour, for engines with continuation over the same layer.

    Returns
    -------
    results : dict
        Values of `quantities.SWEEP_POINT` and WORDS, with `rank` also value and first law by each criterion.
    contact : Contact or None
        Initial guess of the next point; None for engines without continuation.
    """
    found: Results = {}
    contact = initial_guess
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # an invalid operation of numpy yields no valid result
        try:
            study = Study(scene)
            found["required_pressure"] = float(study.mix.required_pressure)
            found["saturation"] = float(study.mix.saturation)
            found["not_reachable"] = study.mix.not_achievable
            numbers, contact = _computed(study, initial_guess)
            numbers["power"] = numbers["resistance"] * scene.mean_speed
            for by, (best, *_) in study.rankings.items() if rank else ():
                numbers |= {by: best.value, f"best_law_by_{by}": best.run.name}
            found |= {name: each if isinstance(each, str) else float(each) for name, each in numbers.items()}
        except Exception as error:  # a failed point does not stop a sweep
            found["reason"] = reason(error)
    found["replaced"] = "; ".join(filter(None, (*adapt(scene, scene.accuracy.engine)[1], scene.mix.fit_remark)))
    found["warnings"] = "; ".join(dict.fromkeys(str(warning.message) for warning in warned))[:MAX_TEXT_LENGTH]
    return found, ENGINES[scene.accuracy.engine].as_start(contact)


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


def _computed(study: Study, initial_guess: Contact | None) -> tuple[Results, Contact | None]:
    """Return the results of the first pass at the mean speed, and its contact; None for eqs 1.4-1.8."""
    scene, mix, machine = study.scene, study.mix, study.scene.machine
    if not study.stages.contacts.speeds:
        formulas = study.stages.contacts.engineering
        same = ("resistance_coefficient", "capture_angle", "contact_length")
        return {name: getattr(formulas, name) for name in same} | {
            "load": formulas.roller_force,
            "resistance": machine.rollers * formulas.roller_resistance,
            "peak_pressure": formulas.pressure,
        }, None
    first, last = _first_and_last(study, initial_guess)
    air: AirForces | None
    if is_coupled(scene):
        air = coupled_forces(first, pore_air_of(mix, scene.layer.fed_density_ratio), scene.mean_speed)
    else:
        air = air_forces_of(scene, mix, first, scene.mean_speed)
    load, resistance = first.load, first.resistance
    if air is not None:
        load, resistance = load + air.load, resistance + air.resistance
    load_error, resistance_error = first.error or (np.nan, np.nan)
    known = {
        "load": machine.roller_length * load,
        "resistance": machine.rollers * machine.roller_length * resistance,
        "resistance_coefficient": resistance / load,
        "capture_angle": np.arcsin(first.leading / machine.roller_radius),
        "contact_length": first.leading - first.trailing,
        "peak_pressure": first.peak_pressure,
        "exit_density_ratio": getattr(last, "exit_density_ratio", None),
        "load_error": load_error,
        "resistance_error": resistance_error,
        "work_residual": first.work_residual,
        "mass_residual": getattr(first, "mass_residual", None),
    }
    return {name: np.nan if value is None else value for name, value in known.items()}, first


def _first_and_last(study: Study, initial_guess: Contact | None) -> Passes:
    """Compute all passes, from the initial guess if that converges, else from scratch; return first and last."""
    scene, speed = study.scene, study.scene.mean_speed
    if initial_guess is not None and scene.layer.passes == 1:
        with suppress(RuntimeError):
            return 2 * roll_passes(scene, study.mix, speed, (initial_guess,))
    passes = roll_passes(scene, study.mix, speed)
    return passes[0], passes[-1]
