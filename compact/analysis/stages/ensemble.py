"""Ensemble: a scene under changes of its keys, with the peaks of every law, or the reason why there are none.

    found = ensemble(scene, [Change("thin", {"layer.lift_thickness": 0.05}), Change("thick", ...)])
    found["value"].sel(change="thin", criterion="peak_force")

A change is an end of a spread, another drive, another law of the mix, a point of a sample. By default every scene has
contacts of its own; `drive_peaks` keeps the contacts where the drive or the resistance changes alone.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from compact.analysis.stages.drives import build_stages, simulate_laws
from compact.analysis.stages.resistance import ResistanceLaw
from compact.analysis.worker_pool import Executor, SerialExecutor
from compact.machine.cart import Cart
from compact.machine.ranking import first_of, value_of
from compact.motion.profile import Cycle
from compact.scene.loader import Scene

if TYPE_CHECKING:
    import xarray

Peaks = Mapping[str, Mapping[str, float]]  # by criterion and law


NO_KEYS: Mapping[str, Any] = {}


class Change(NamedTuple):
    """Change of a scene.

    Parameters
    ----------
    label : str
        Name of the change, its own in an ensemble.
    keys : mapping
        New values by scene key.
    resistance : callable, optional
        Resistance of one cart in place of that of the scene [N].
    """

    label: str
    keys: Mapping[str, Any] = NO_KEYS
    resistance: ResistanceLaw | None = None


Run = Callable[[Scene, Change], Peaks]  # of a changed scene


def peaks_of(scene: Scene, change: Change) -> Peaks:
    """Return the values of all laws by each criterion of a scene, with contacts of its own."""
    ranked = build_stages(scene, own_resistance=change.resistance).drive.rankings
    return {by: {place.run.name: place.value for place in order} for by, order in ranked.items()}


def drive_peaks(
    cart: Cart,
    cycles: Mapping[str, Cycle],
    resistance: ResistanceLaw,
    criteria: Iterable[str],
    scene: Scene,
    change: Change,
) -> Peaks:
    """Return the values of laws under the drive of a changed scene, against a resistance that is known.

    Parameters
    ----------
    resistance : callable
        Resistance of one cart [N], where the change has none.

    Returns
    -------
    mapping
        Values by criterion and law; absent for a law that the drive does not follow.
    """
    runs = dict(simulate_laws(scene, cart, cycles, change.resistance or resistance, RuntimeError))
    return {by: {name: value_of(run, by) for name, run in runs.items()} for by in criteria}


def ensemble(
    scene: Scene, changes: Iterable[Change], run: Run = peaks_of, executor: Executor | None = None
) -> "xarray.Dataset":
    """Evaluate a scene under changes of its keys; NaN and a reason where there is no solution.

    Parameters
    ----------
    run : callable
        Returns the values of a changed scene by criterion and law; a ValueError or RuntimeError is a reason.
    executor : Executor, optional
        Executor of the changes, to which scene, changes and run can be sent; this process by default.

    Returns
    -------
    Dataset
        `value` over change, criterion and law, in the unit of the criterion; `first`, the law of the least value over
        change and criterion, empty without a finite one; `reason` over change.
    """
    import xarray

    changes = list(changes)
    jobs = [(executor or SerialExecutor()).submit(_evaluate, (scene, change, run)) for change in changes]
    found = [job.result() for job in jobs]
    rows, reasons = [row for row, _ in found], [reason for _, reason in found]
    criteria = list(dict.fromkeys(by for row in rows for by in row))
    laws = list(dict.fromkeys(law for row in rows for values in row.values() for law in values))
    value = [[[row.get(by, {}).get(law, np.nan) for law in laws] for by in criteria] for row in rows]
    first = [[first_law(row.get(by, {})) for by in criteria] for row in rows]
    axes = ("change", "criterion", "law")
    return xarray.Dataset(
        {
            "value": (axes, np.array(value, float).reshape(len(rows), len(criteria), len(laws))),
            "first": (axes[:2], np.array(first, object).reshape(len(rows), len(criteria))),
            "reason": (axes[:1], np.array(reasons, object)),
        },
        dict(zip(axes, ([change.label for change in changes], criteria, laws), strict=True)),
    )


def _evaluate(task: tuple[Scene, Change, Run]) -> tuple[Peaks, str]:
    """Return the values of a changed scene, or the reason why there are none."""
    scene, change, run = task
    try:
        return run(scene.replaced(**change.keys), change), ""
    except (ValueError, RuntimeError) as error:
        return {}, str(error)


def first_law(values: Mapping[str, float]) -> str:
    """Name the law of the least value, the first of equals; empty without a finite value."""
    finite = {law: value for law, value in values.items() if np.isfinite(value)}
    return list(finite)[first_of(list(finite.values()))] if finite else ""


def peaks_at(table: "xarray.Dataset", change: int) -> dict[str, dict[str, float]]:
    """Return the values at one change of an ensemble by criterion and law, without those that are NaN."""
    rows = zip(table.criterion.values.tolist(), table.value.values[change].tolist(), strict=True)
    laws = table.law.values.tolist()
    return {by: {law: each for law, each in zip(laws, row, strict=True) if each == each} for by, row in rows}


def polynomial_terms(points: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    """Return the products of up to `degree` coordinates: the terms of a response surface, shape (points, terms)."""
    factors = np.column_stack([np.ones(len(points)), points])
    columns: Sequence[Any] = list(combinations_with_replacement(range(factors.shape[1]), degree))
    return np.column_stack([np.prod(factors[:, list(each)], axis=1) for each in columns])
