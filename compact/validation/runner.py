"""Registry and evaluation of the validation cases. A value that moves from the recorded one is reported, met or not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import get_args

from threadpoolctl import threadpool_limits

from compact.numerics.validation import require_known
from compact.validation import half_plane, ironing, plasticity, sand_oedometers
from compact.validation.case import Comparison, Panel, ValidationCase, Verdict, recorded_case
from compact.validation.plant_case import read_plant_case

VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
COMPUTED = {
    "karlsruhe-sand": sand_oedometers.sand_tests,
    "avicel-ph102": plasticity.powder,
    "contact-pa6": half_plane.relaxing_half_plane,
    "cam-clay": plasticity.earth_pressures,
    "prandtl-indenter": plasticity.indenter,
    "ironing-roller": ironing.pushed_heap,
}
CASES: Mapping[str, ValidationCase] = MappingProxyType(
    {name: recorded_case(name, compute) for name, compute in COMPUTED.items()}
)


@dataclass(frozen=True, eq=False)
class CaseResult:
    """Evaluated case: its comparisons and the panels of its figure."""

    case: ValidationCase
    comparisons: tuple[Comparison, ...]
    panels: tuple[Panel, ...] = ()

    @property
    def counts(self) -> dict[Verdict, int]:
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
    """Compute the rows of a case on one thread, on which the recorded values were computed.

    Raises
    ------
    KeyError
        If a value has no row, or a row no value.
    """
    rows = case.rows
    with threadpool_limits(1):
        values, panels = case.compute(rows)
    if set(values) != set(rows):
        raise KeyError(f"{case.name}: rows and values differ in {', '.join(set(values) ^ set(rows))}")
    return CaseResult(case, tuple(replace(row, ours=float(values[key])) for key, row in rows.items()), tuple(panels))
