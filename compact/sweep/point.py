"""The headline of one scene: what a sweep keeps of every point, with its errors and checks, or why there is none.

    numbers, contact = headline(scene)
    numbers["resistance"], numbers["resistance_error"]

A scene that fails has the numbers of its mix alone, and the reason in words. The contact is that of the mean speed.
"""

import platform
import warnings
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np

import compact
from compact import quantities
from compact.analysis.contact_stage import roll_passes
from compact.analysis.engines import ENGINES
from compact.analysis.numerical_failures import is_numeric, memory_sentence, numeric_sentence
from compact.analysis.study import Study
from compact.scene.engine_capabilities import adapt
from compact.scene.loader import SceneError

WORDS = {
    "not_reachable": "why rolling does not reach the density; empty where it does",
    "warnings": "what was warned of on the way",
    "replaced": "keys that the scene leaves open and the engine replaced by the nearest it takes",
    "reason": "why there are no numbers; empty where there are",
}
VERSIONED = ("compact", "numpy", "scipy", "numba", "scikit-fem")
LONGEST = 400  # characters of a reason


def ranked(criteria):
    """name -> `Quantity` of the numbers, and name -> meaning of the words, that ranking the laws adds."""
    numbers = {by: quantities.CRITERIA[by] for by in criteria}
    return numbers, {f"best_law_by_{by}": f"law of the least {numbers[by].term}" for by in criteria}


def headline(scene, rank=False, near=None):
    """(name -> value, contact): `quantities.SWEEP_POINT` and WORDS of a scene, with `rank` those of `ranked` besides.

    near : contact of a neighbour, from which the engine "compaction" goes on where the fed layer is the same. The
        contact that is returned is the next point's; None by other engines, which need no start
    """
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        warnings.simplefilter("error", RuntimeWarning)  # a number that numpy warns of is no result
        found, contact = {}, near
        try:
            study = Study(scene)
            found |= _of_mix(study.mix)
            numbers, contact = _computed(study, rank, near)
            found |= numbers
        except Exception as error:  # a point never stops a sweep
            found["reason"] = reason(error)
    found["replaced"] = "; ".join(adapt(scene, scene.accuracy.engine)[1])
    found["warnings"] = "; ".join(dict.fromkeys(str(warning.message) for warning in warned))[:LONGEST]
    return found, contact if ENGINES[scene.accuracy.engine].continuation else None


def reason(error):
    """Why a scene has no numbers, in words; what is none of our refusals is named as such."""
    if isinstance(error, MemoryError):
        return memory_sentence(error)[:LONGEST]
    if is_numeric(error):
        return numeric_sentence(error)[:LONGEST]
    told = "; ".join(error.mistakes) if isinstance(error, SceneError) else str(error)
    known = isinstance(error, ValueError | RuntimeError) and told
    return (told if known else f"internal error, please report it: {type(error).__name__}: {told}")[:LONGEST]


def _of_mix(blend):
    return {
        "required_pressure": float(blend.required_pressure),
        "saturation": float(blend.saturation),
        "not_reachable": blend.density_achievable.reason,
    }


def _computed(study, rank, near):
    """Numbers and words of the contact at the mean speed, and the contact, by formula None."""
    scene = study.scene
    speed = scene.mean_speed
    if not study.layered:
        contact, found = None, _of_formulas(study)
    else:
        contact, *later = _rolled(scene, study.mix, speed, near)
        found = _of_contact(scene, contact, later[-1] if later else contact)
    found["power"] = found["resistance"] * speed
    if rank:
        for by, (best, *_) in study.rankings.items():
            found |= {by: best.value, f"best_law_by_{by}": best.run.name}
    return {name: value if isinstance(value, str) else float(value) for name, value in found.items()}, contact


def _rolled(scene, blend, speed, near):
    """The contact of each pass, from a neighbour where that helps, and else from nothing."""
    if near is not None and scene.layer.passes == 1 and ENGINES[scene.accuracy.engine].continuation:
        with suppress(RuntimeError):
            return roll_passes(scene, blend, speed, (near,))
    return roll_passes(scene, blend, speed)


def _of_formulas(study):
    """Eqs 1.4-1.8 at the pressure that the mix needs."""
    said = study.engineering
    return {
        "load": said.roller_force,
        "resistance": study.scene.machine.rollers * said.roller_resistance,
        "resistance_coefficient": said.resistance_coefficient,
        "capture_angle": said.capture_angle,
        "contact_length": said.contact_length,
        "peak_pressure": said.pressure,
    }


def _of_contact(scene, first, last):
    """The contact of the first pass, and the density that the last one leaves."""
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


@cache
def versions():
    """name -> version of all that decides a number: packages, and the text of our own modules."""
    source = sha256()
    for path in sorted(Path(compact.__file__).parent.rglob("*")):
        if path.suffix in (".py", ".csv"):
            source.update(path.read_bytes())
    packages = {name: version(name) for name in VERSIONED}
    return {"python": platform.python_version()} | packages | {"source": source.hexdigest()[:12]}
