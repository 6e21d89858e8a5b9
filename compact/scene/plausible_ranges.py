"""Plausible values of a scene: advice on a value outside the range of its key, refusal of one far outside.

A value outside its range is usually a value in other units. One more than `REFUSED` times outside is refused, unless
the top-level key `unusual` of the scene names its key. Zero is not compared: where the schema allows it, it means
"none". Of a signed quantity the magnitude counts.

Ranges are declared with the keys in `schema`. Those of [mix.overrides] follow from the prior (`mix`): from the lowest
low to the highest high of a parameter over the whole table of moisture and density ratio, widened by `WIDENED` both
ways for mixes outside that table.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, partial
from itertools import product
from typing import Any

from compact.material.mix import prior, table_nodes
from compact.scene.constraints import Rule
from compact.scene.schema import declared_keys, extra_of

REFUSED = 10.0  # [-], factor outside the range beyond which a value is refused
WIDENED = 3.0  # [-], factor by which the spread of the prior is widened; mixes of other grading than the table's
SMALLEST = 1e-3  # [-], least plausible value over the largest where none is plausible too
OF_MIX = "mix.overrides."  # keys with a range from the prior

OTHER_UNITS = {  # unit of the scene -> (other unit, its size in that of the scene), the likeliest first
    "m": (("mm", 1e-3), ("cm", 1e-2), ("um", 1e-6)),
    "s": (("ms", 1e-3), ("min", 60.0)),
    "kg": (("t", 1e3), ("g", 1e-3)),
    "N": (("kN", 1e3), ("MN", 1e6), ("kgf", 9.80665)),
    "Pa": (("kPa", 1e3), ("MPa", 1e6), ("GPa", 1e9), ("mPa", 1e-3)),
    "1/Pa": (("1/MPa", 1e-6), ("1/kPa", 1e-3), ("1/GPa", 1e-9)),
    "N/m": (("kN/m", 1e3), ("N/mm", 1e3), ("MN/m", 1e6)),
    "N m": (("kN m", 1e3), ("N mm", 1e-3)),
    "m/s": (("mm/s", 1e-3), ("m/min", 1 / 60), ("km/h", 1 / 3.6)),
    "m/s2": (("mm/s2", 1e-3),),
    "rad": (("deg", 0.017453292519943295),),
    "deg": (("rad", 57.29577951308232),),
    "rad/s": (("rpm", 0.10471975511965977),),
    "kg m2": (("g m2", 1e-3), ("kg cm2", 1e-4), ("kg mm2", 1e-6)),
    "m2": (("mm2", 1e-6), ("cm2", 1e-4)),
    "m3/s": (("L/min", 1e-3 / 60), ("L/s", 1e-3)),
}


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

    def excludes(self, value: float, times: float = 1.0) -> bool:
        """Return True for a nonzero magnitude outside the range by more than a factor `times`."""
        size = abs(value)
        return size != 0 and not self.low / times <= size <= self.high * times

    def refusal(self, key: str, value: float) -> str | None:
        """Return the message for a value outside by more than the factor `REFUSED`, else None."""
        if not self.excludes(value, REFUSED):
            return None
        guess, word = self._guess(value), "a plain number" if self.unit == "1" else f"the value in {self.unit}"
        return (
            f"{self._quantity(value)} is far outside {self._span}{f'{guess} Give' if guess else '; give'} {word}; a "
            f'value that is meant as it is needs unusual = ["{key}"] at the top of the scene'
        )

    def advice(self, _key: str, value: float) -> str | None:
        """Return a sentence on a value outside that is not refused, else None."""
        if not self.excludes(value) or self.excludes(value, REFUSED):
            return None
        return f"{self._quantity(value)} is outside {self._span}{self._guess(value) or '; is it in other units?'}"

    def _quantity(self, value: float) -> str:
        return f"{value:g}" if self.unit == "1" else f"{value:g} {self.unit}"

    @property
    def _span(self) -> str:
        return f"the plausible {self.low:.3g} to {self._quantity(float(f'{self.high:.3g}'))} ({self.reason})"

    def _guess(self, value: float) -> str:
        """Return a question for another unit in which the value is plausible; empty if there is none."""
        for unit, size in OTHER_UNITS.get(self.unit, ()):
            if not self.excludes(value * size):
                return f"; was {value:g} {unit} = {self._quantity(float(f'{value * size:.6g}'))} meant?"
        return ""


MEAN_SPEED = Range(1e-3, 2.5, "m/s", "mean speeds of forming machines, motion.stroke over motion.duration")
SWAPPED = "a stroke of {0:g} m in {1:g} s; are motion.stroke and motion.duration swapped? Give {1:g} m and {0:g} s"
COMPARED_KEYS = tuple(key for key in declared_keys() if "plausible" in extra_of(key) or key.startswith(OF_MIX))


@cache
def range_of(key: str) -> Range:
    """Return the range of one of `COMPARED_KEYS`."""
    if not key.startswith(OF_MIX):
        (low, high), unit, why = (extra_of(key)[name] for name in ("plausible", "unit", "why"))
        return Range(low, high, unit, why)
    known = [prior(*node).parameter(key.removeprefix(OF_MIX)) for node in product(*table_nodes())]
    low, high = min(each.low for each in known), max(each.high for each in known)
    low = low or SMALLEST * high  # a spread from none
    reason = "the prior over all moistures and densities, threefold wider"
    return Range(low / WIDENED, high * WIDENED, extra_of(key).get("unit", "1"), reason)


Say = Callable[[Range, str, float], str | None]


def _of_key(say: Say, key: str, value: Any, unusual: Any) -> str | None:
    """Return the sentence of `say` on a value, or on the first entry of a list that has one."""
    if value is None or key in (unusual or ()):
        return None
    said = (say(range_of(key), key, each) for each in (value if isinstance(value, tuple) else (value,)))
    return next(filter(None, said), None)


def _of_mean_speed(say: Say, stroke: float, duration: float, unusual: Any) -> str | None:
    if {"motion.duration", "motion.stroke"} & {*(unusual or ())}:
        return None
    given = {"motion.stroke": stroke, "motion.duration": duration}
    if any(range_of(key).excludes(value, REFUSED) for key, value in given.items()):
        return None  # said there
    if MEAN_SPEED.excludes(stroke / duration) and stroke > duration and not MEAN_SPEED.excludes(duration / stroke):
        words = f'{SWAPPED.format(stroke, duration)}, or unusual = ["motion.duration"] at the top of the scene'
        return words if say is Range.refusal else None
    return say(MEAN_SPEED, "motion.duration", stroke / duration)


def _unusual_names_keys(unusual: Any) -> str | None:
    known = (*COMPARED_KEYS, "mix.density_ratio")  # which "compaction" estimates
    if unknown := [key for key in unusual or () if key not in known]:
        near = get_close_matches(unknown[0], known, n=1)
        remedy = f"did you mean '{near[0]}'?" if near else "give key paths such as mix.overrides.heckel_slope"
        return f"holds '{unknown[0]}', which is no key with a plausible range; {remedy}"
    return None


def _rules(say: Say) -> Iterator[Rule]:
    for key in COMPARED_KEYS:
        yield Rule((key, "unusual"), partial(_of_key, say, key))
    yield Rule(("motion.stroke", "motion.duration", "unusual"), partial(_of_mean_speed, say))


REFUSALS: tuple[Rule, ...] = (*_rules(Range.refusal), Rule(("unusual",), _unusual_names_keys))
ADVICE: tuple[Rule, ...] = tuple(_rules(Range.advice))
