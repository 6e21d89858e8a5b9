"""Registry of the validation cases, their evaluation, and the recorded values of `data/recorded.csv`.

A recorded value is what the program computed for a comparison when the case was last examined. A value that moves from
it beyond the tolerance of its comparison is reported, met or not.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from threadpoolctl import threadpool_limits

from compact.numerics.validation import require_known
from compact.validation.cam_clay import CAM_CLAY
from compact.validation.case import VERDICTS, Comparison, Evaluation, ValidationCase, read_rows
from compact.validation.half_plane import PA6
from compact.validation.ironing import IRONING
from compact.validation.plant_case import read_plant_case
from compact.validation.plastic_limits import PRANDTL
from compact.validation.plate_wheel import CMU_WHEEL
from compact.validation.powder import PH102
from compact.validation.roller_compactor import JOHANSON, JOHANSON_ELEMENTS
from compact.validation.sand_oedometers import SAND
from compact.validation.terramechanics import BEKKER, WONG_REECE

RECORDED = "recorded.csv"
RECORDED_HEADER = ("case", "key", "ours", "theirs", "verdict")
CASES: Mapping[str, ValidationCase] = MappingProxyType(
    {
        each.name: each
        for each in (
            CMU_WHEEL,
            SAND,
            PH102,
            PA6,
            BEKKER,
            WONG_REECE,
            JOHANSON,
            JOHANSON_ELEMENTS,
            CAM_CLAY,
            PRANDTL,
            IRONING,
        )
    }
)


@dataclass(frozen=True, eq=False)
class CaseResult:
    """Evaluated case with the recorded values of its comparisons.

    Parameters
    ----------
    case : ValidationCase
        The case.
    evaluation : Evaluation
        Comparisons and curves.
    recorded : dict of str to float, or None
        Recorded values by key; None for a case of the user, which has none.
    """

    case: ValidationCase
    evaluation: Evaluation
    recorded: Mapping[str, float] | None

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Comparisons of the case."""
        return self.evaluation.comparisons

    @property
    def moved(self) -> tuple[Comparison, ...]:
        """Comparisons whose value of ours differs from the recorded one."""
        if self.recorded is None:
            return ()
        return tuple(each for each in self.comparisons if each.moved(self.recorded.get(each.key)))

    @property
    def counts(self) -> dict[str, int]:
        """Number of comparisons by verdict."""
        verdicts = [each.verdict for each in self.comparisons]
        return {verdict: verdicts.count(verdict) for verdict in VERDICTS}


def select_cases(names: Sequence[str]) -> tuple[ValidationCase, ...]:
    """Return the cases of some names in the order of the registry, then those of folders; all without names.

    Parameters
    ----------
    names : sequence of str
        Names of cases, and folders with the case of a plant.
    """
    folders = [name for name in names if name not in CASES and Path(name).is_dir()]
    for name in names:
        if name not in folders:
            require_known("case", name, tuple(CASES))
    listed = tuple(case for case in CASES.values() if not names or case.name in names)
    return (*listed, *(read_plant_case(folder) for folder in folders))


def evaluate_case(case: ValidationCase) -> CaseResult:
    """Evaluate a case on one thread, on which the recorded values were computed."""
    with threadpool_limits(1):
        evaluation = case.evaluate()
    return CaseResult(case, evaluation, recorded_values(case.name) if CASES.get(case.name) is case else None)


def recorded_values(name: str) -> dict[str, float]:
    """Return the recorded values of a case by key of their comparisons."""
    return {row["key"]: float(row["ours"]) for row in read_rows(RECORDED, case=name)}


def recorded_rows(results: Sequence[CaseResult]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield the rows of `data/recorded.csv` of evaluated cases, in the columns of `RECORDED_HEADER`."""
    for result in results:
        for each in result.comparisons:
            yield result.case.name, each.key, f"{each.ours:.12g}", f"{each.theirs:.12g}", each.verdict
