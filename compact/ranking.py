"""The ranking of laws: runs in order of what they ask of their drive, with the margin to the next."""

import math
from dataclasses import dataclass
from types import MappingProxyType

from compact.refuse import refuse_unknown

TIE = 1e-9  # two values closer than this share a rank


@dataclass(frozen=True)
class Criterion:
    """What laws may be ranked by: name, unit, and why it may be infinite."""

    unit: str
    infinite_because: str = ""


_JUMP = "the velocity jumps: an infinite force for no time"
CRITERIA = MappingProxyType(
    {
        "peak_force": Criterion("N", _JUMP),
        "peak_power": Criterion("W", _JUMP),
        "rms_force": Criterion("N", _JUMP),
        "rms_power": Criterion("W", _JUMP),
        "mean_force": Criterion("N", _JUMP),
        "mean_power": Criterion("W"),
        "energy": Criterion("J"),
        "drawn_energy": Criterion("J"),
        "peak_jerk": Criterion("m/s^3", "the acceleration jumps"),
        "dynamic_factor": Criterion("1", _JUMP),
        "nonuniformity": Criterion("1"),
        "ringing": Criterion("1", "a drive that imposes a jump of the velocity has no peak to compare with"),
    }
)


@dataclass(frozen=True)
class Ranked:
    """A run's place: `rank` from 1, shared by ties; `margin` to the next worse value, relative; why it is infinite."""

    rank: int
    run: object
    value: float
    margin: float
    reason: str


def rank(runs, by="peak_force"):
    """Runs in order of a criterion, least first, as a list of `Ranked`; ties share a rank, infinite values come last,
    and after them what is no number.

    The margin of the last finite value is infinite where worse ones follow, nan where none does.
    """
    refuse_unknown("criterion", by, tuple(CRITERIA))
    ordered = sorted(((getattr(run, by), run) for run in runs), key=lambda pair: (math.isnan(pair[0]), pair[0]))
    places = []
    for i, (value, run) in enumerate(ordered):
        tied = bool(places) and _tie(value, places[-1].value)
        worse = [other for other, _ in ordered[i:] if not _tie(value, other)]
        margin = (worse[0] - value) / value if worse and 0 < value < math.inf else math.nan
        place = places[-1].rank if tied else i + 1
        reason = "" if math.isfinite(value) else _why_infinite(by, run)
        places.append(Ranked(place, run, value, margin, reason))
    return places


def _why_infinite(by, run):
    return CRITERIA[by].infinite_because if run.shocks else "no force keeps the mean speed"


def _tie(a, b):
    return a == b or (math.isfinite(a - b) and abs(a - b) <= TIE * max(abs(a), abs(b)))
