"""Results of one point of a sweep, with errors and balance residuals, or the reason of a failure.

    results, contact = headline(scene)
    results["resistance"], results["resistance_error"]

A point that fails has the results of its mix only, and the reason. The contact is that at the mean speed.
"""

import warnings
from contextlib import suppress
from typing import Any

import numpy as np

from compact.analysis.contact_cases import Passes, air_forces_of, contact_record, roll_passes
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
SHAPE = ("capture_angle", "contact_length")
RECORDED = ("contact_length", "peak_pressure", "load_error", "resistance_error", "work_residual", "mass_residual")
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
    """Return the results of the first pass at the mean speed, and its contact; None for eqs 1.4-1.8.

    The contact starts from the initial guess if that converges, else from scratch.
    """
    scene, mix, machine, speed = study.scene, study.mix, study.scene.machine, study.scene.mean_speed
    if not study.stages.contacts.speeds:
        formulas = study.stages.contacts.engineering
        return {name: getattr(formulas, name) for name in ("resistance_coefficient", *SHAPE)} | {
            "load": formulas.roller_force,
            "resistance": machine.rollers * formulas.roller_resistance,
            "peak_pressure": formulas.pressure,
        }, None
    passes: Passes = ()
    if initial_guess is not None and scene.layer.passes == 1:
        with suppress(RuntimeError):
            passes = roll_passes(scene, mix, speed, (initial_guess,))
    passes = passes or roll_passes(scene, mix, speed)
    first = passes[0]
    if is_coupled(scene):
        air: AirForces | None = coupled_forces(first, pore_air_of(mix, scene.layer.fed_density_ratio), speed)
    else:
        air = air_forces_of(scene, mix, first, speed)
    record = contact_record(scene.accuracy.engine, speed, passes, air)
    known = {name: getattr(record, name) for name in RECORDED} | {
        "load": machine.roller_length * record.load,
        "resistance": machine.rollers * machine.roller_length * record.resistance,
        "resistance_coefficient": record.coefficient,
        "capture_angle": np.arcsin(first.leading / machine.roller_radius),
        "exit_density_ratio": passes[-1].exit_density_ratio,
    }
    return {name: np.nan if value is None else value for name, value in known.items()}, first
