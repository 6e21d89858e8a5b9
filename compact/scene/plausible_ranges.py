"""Plausible ranges of the numbers of a scene; a value far outside is usually a value in other units.

A value outside its range causes advice. A value more than `REFUSED` times outside is refused, unless the top-level key
`unusual` of the scene names its key. Zero is not compared: where the schema allows it, it means "none". Of a signed
quantity the magnitude counts.

Ranges of [mix.overrides] follow from the prior (`mix`): from the lowest low to the highest high of a parameter over the
whole table of moisture and density ratio, widened by `WIDENED` both ways for mixes outside that table.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, partial
from importlib.resources import files
from itertools import product

from compact.material.mix import prior, table_nodes
from compact.scene.constraints import Rule
from compact.scene.errors import Mistake, SceneError
from compact.scene.schema import Overrides

REFUSED = 10.0  # [-], factor outside the range beyond which a value is refused
WIDENED = 3.0  # [-], factor by which the spread of the prior is widened; mixes of other grading than the table's
SMALLEST = 1e-3  # [-], least plausible value over the largest where none is plausible too


@dataclass(frozen=True)
class Range:
    """Plausible range of one key.

    Parameters
    ----------
    low, high : float
        Bounds in `unit`.
    reason : str
        Origin of the range, for messages.
    """

    low: float
    high: float
    unit: str
    reason: str


OTHER_UNITS = {  # unit of the scene -> (other unit, its size in that of the scene), the likeliest first
    "m": (("mm", 1e-3), ("cm", 1e-2), ("um", 1e-6)),
    "s": (("ms", 1e-3), ("min", 60.0)),
    "kg": (("t", 1e3), ("g", 1e-3)),
    "N": (("kN", 1e3), ("MN", 1e6), ("kgf", 9.80665)),
    "Pa": (("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9), ("mPa", 1e-3)),
    "1/Pa": (("1/MPa", 1e-6), ("1/kPa", 1e-3), ("1/GPa", 1e-9)),
    "N/m": (("kN/m", 1e3), ("N/mm", 1e3), ("MN/m", 1e6)),
    "N s/m": (("kN s/m", 1e3), ("N s/mm", 1e3)),
    "N m": (("kN m", 1e3), ("N mm", 1e-3)),
    "m/s": (("mm/s", 1e-3), ("m/min", 1 / 60), ("km/h", 1 / 3.6)),
    "m/s2": (("mm/s2", 1e-3),),
    "m/s3": (("mm/s3", 1e-3),),
    "m/s4": (("mm/s4", 1e-3),),
    "rad": (("deg", 0.017453292519943295),),
    "deg": (("rad", 57.29577951308232),),
    "rad/s": (("rpm", 0.10471975511965977),),
    "kg m2": (("g m2", 1e-3), ("kg cm2", 1e-4), ("kg mm2", 1e-6)),
    "m2": (("mm2", 1e-6), ("cm2", 1e-4)),
    "m3": (("L", 1e-3), ("mL", 1e-6), ("mm3", 1e-9)),
    "m3/s": (("L/min", 1e-3 / 60), ("L/s", 1e-3)),
    "kg/m3": (("g/cm3", 1e3), ("kg/L", 1e3)),
}


def _read_ranges() -> dict[str, Range]:
    text = (files("compact") / "data" / "plausible_ranges.csv").read_text("utf-8")
    lines = csv.DictReader(text.splitlines())
    return {each["key"]: Range(float(each["low"]), float(each["high"]), each["unit"], each["reason"]) for each in lines}


RANGES = _read_ranges()
PLIES = {  # of one ply in layer.plies
    "thickness": Range(1e-3, 2.0, "m", "precast products"),
    "relative_modulus": Range(1e-3, 1e3, "1", "moduli over those of the mix"),
}
MEAN_SPEED = Range(1e-3, 5.0, "m/s", "mean speeds of forming machines, motion.stroke over motion.duration")


@cache
def of_mix(name: str) -> Range:
    """Return the range of a parameter of [mix.overrides]: spread of the prior over its whole table, widened."""
    known = [prior(*node).parameter(name) for node in product(*table_nodes())]
    low, high = min(each.low for each in known), max(each.high for each in known)
    unit = {"-": "1"}.get(known[0].unit, known[0].unit)
    low = low or SMALLEST * high  # a spread from none
    return Range(low / WIDENED, high * WIDENED, unit, "the prior over all moistures and densities, threefold wider")


def range_of(key: str) -> Range:
    """Return the range of a key."""
    return RANGES[key] if key in RANGES else of_mix(key.removeprefix("mix.overrides."))


def compared_keys() -> tuple[str, ...]:
    """Return the keys that have a range."""
    return (*RANGES, "layer.plies", *(f"mix.overrides.{name}" for name in Overrides.model_fields))


def is_outside(value: float, found: Range, times: float = 1.0) -> bool:
    """Return True for a nonzero magnitude outside a range by more than a factor `times`."""
    size = abs(value)
    return size != 0 and not found.low / times <= size <= found.high * times


def refusal(key: str, value: float, found: Range) -> str | None:
    """Return the message for a value outside a range by more than the factor `REFUSED`, else None."""
    if not is_outside(value, found, REFUSED):
        return None
    guess = _guess(value, found)
    word = "a plain number" if found.unit == "1" else f"the value in {found.unit}"
    return (
        f"{_quantity(value, found.unit)} is far outside the plausible {_span(found)} ({found.reason})"
        f"{f'{guess} Give' if guess else '; give'} {word}; a value that is meant as it is needs "
        f'unusual = ["{key}"] at the top of the scene'
    )


def advice(_key: str, value: float, found: Range) -> str | None:
    """Return a sentence on a value outside a range that is not refused, else None."""
    if not is_outside(value, found) or is_outside(value, found, REFUSED):
        return None
    return (
        f"{_quantity(value, found.unit)} is outside the plausible {_span(found)} ({found.reason})"
        f"{_guess(value, found) or '; is it in other units?'}"
    )


def _quantity(value, unit):
    return f"{value:g}" if unit == "1" else f"{value:g} {unit}"


def _span(found):
    return f"{found.low:.3g} to {_quantity(float(f'{found.high:.3g}'), found.unit)}"


def _guess(value, found):
    """Return a question for another unit in which the value is plausible; empty if there is none."""
    for unit, size in OTHER_UNITS.get(found.unit, ()):
        if not is_outside(value * size, found):
            return f"; was {value:g} {unit} = {_quantity(float(f'{value * size:.6g}'), found.unit)} meant?"
    return ""


def _of_values(say, key, found, value, unusual):
    """Return the sentence of `say` on a value, or on the first entry of a list that has one."""
    if value is None or key in (unusual or ()):
        return None
    said = (say(key, each, found) for each in (value if isinstance(value, tuple) else (value,)))
    return next(filter(None, said), None)


def _of_key(say, key, value, unusual):
    return None if value is None else _of_values(say, key, range_of(key), value, unusual)


def _of_plies(say, plies, unusual):
    remarks = (
        (name, _of_values(say, "layer.plies", found, ply[name], unusual))
        for ply in plies or ()
        for name, found in PLIES.items()
    )
    return next((f"{name} {sentence}" for name, sentence in remarks if sentence), None)


def _of_mean_speed(say, duration, stroke, unusual):
    if "motion.stroke" in (unusual or ()):
        return None
    return _of_values(say, "motion.duration", MEAN_SPEED, stroke / duration, unusual)


def _unusual_names_keys(unusual):
    known = (*compared_keys(), "mix.density_ratio")  # which "compaction" estimates
    if unknown := [key for key in unusual or () if key not in known]:
        near = get_close_matches(unknown[0], known, n=1)
        remedy = f"did you mean '{near[0]}'?" if near else "give key paths such as mix.overrides.heckel_slope"
        return f"holds '{unknown[0]}', which is no key with a plausible range; {remedy}"


def _rules(say) -> Iterator[Rule]:
    for key in compared_keys():
        if key != "layer.plies":
            yield Rule((key, "unusual"), partial(_of_key, say, key))
    yield Rule(("layer.plies", "unusual"), partial(_of_plies, say))
    yield Rule(("motion.duration", "motion.stroke", "unusual"), partial(_of_mean_speed, say))


REFUSALS: tuple[Rule, ...] = (*_rules(refusal), Rule(("unusual",), _unusual_names_keys))
ADVICE: tuple[Rule, ...] = tuple(_rules(advice))


def check_speed(speed: float, unusual: tuple[str, ...]) -> None:
    """Validate a speed given on the command line like an entry of `contact.speeds`.

    Parameters
    ----------
    speed : float
        Speed of the cart [m/s].
    unusual : tuple of str
        Keys whose implausible values are intended.

    Raises
    ------
    SceneError
        If the speed is not a number or implausible.
    """
    key = "contact.speeds"
    sentence = _of_key(refusal, key, float(speed), unusual)
    if sentence or speed != speed:
        raise SceneError([str(Mistake(("--speed",), sentence or "must be a number in m/s, got nan"))])
