"""Sweep by an engine of high fidelity at chosen points, which correct an engine of low fidelity at all points.

    grid = "mix.moisture=0.08:0.12:10", "mix.density_ratio=0.95:0.98:10"
    sweep = create_sweep(scene, [read_design(text) for text in grid])
    table = sweep.run("out/sweep", executor=ProcessExecutor(2))  # 18 of 100 points by finite elements

The engine "compaction" takes seconds for a point, "column" milliseconds. Their ratio is smooth over the parameters: a
response surface of its logarithm (`surfaces`) interpolates it, with a leave-one-out error that is added to that of the
engine. Chosen points that the engine refuses are replaced by others and are not part of the surface; points beyond the
hull of those that it solved have no result.

Keys with words, such as layer.base, divide the sweep into parts with one surface each. The chosen points are divided
into connected parts, each a task, in which a point starts from the nearest contact. This division does not depend on
the number of workers.
"""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any, Literal

import numpy as np

from compact.engines import ENGINES
from compact.quantities import SWEEP_CORRECTION
from compact.scene.loader import Scene
from compact.sweep.design import Axis, Sampled
from compact.sweep.run import Evaluate, Results, Sweep, described, in_parts
from compact.sweep.surfaces import (
    FloatArray,
    Surface,
    choose_points,
    connected_parts,
    default_count,
    distances,
    fit_surface,
    inside_hull,
    refinement_weights,
)

ALL = "all"
ROUNDS = 3  # [-], of chosen points; the second refines the surface, and later ones replace points without a result
FIRST_SHARE = 2 / 3  # [-], of the chosen points that fill the space evenly
FORCES = ("load", "resistance")  # with an error estimate
CORRECTED = (*FORCES, "capture_angle", "contact_length", "peak_pressure", "exit_density_ratio")
ORIGIN = "two_dimensions"
ORIGIN_MEANING = "solved or refused by the engine at this point; empty for columns that a response surface corrects"


def create_sweep(
    scene: Scene,
    varied: Sequence[Axis | Sampled],
    *,
    rank: bool = False,
    indices: bool = False,
    direct: int | Literal["all"] | None = None,
) -> Sweep:
    """Create the sweep of a scene, with a correction where its engine has one of low fidelity.

    Parameters
    ----------
    direct : int or "all", optional
        Number of points that the engine computes itself; by default as many as a quadratic surface requires thrice.

    Raises
    ------
    ValueError
        If the engine has none of low fidelity, or laws are ranked with a correction.
    """
    whole = Sweep(scene, varied, rank=rank, indices=indices)
    able = len(whole.engines) == 1 and ENGINES[whole.engines[0]].low_fidelity is not None
    if direct is not None and not able:
        names = [name for name, engine in ENGINES.items() if engine.low_fidelity]
        raise ValueError(f"--direct is for sweeps by {' or '.join(names)} alone, got {', '.join(whole.engines)}")
    if not able or direct == ALL:
        return whole
    if direct is not None and (isinstance(direct, str) or direct < 1):
        raise ValueError(f"--direct must be at least 1, or all, got {direct}")
    corrected = CorrectedSweep(scene, varied, indices=indices, direct=direct)
    if corrected.steps >= corrected.size:
        return whole
    if rank:
        raise ValueError(
            f"--rank needs a resistance over speed, which the correction of {corrected.low_fidelity} by "
            f"{corrected.engines[0]} does not have; give --direct all, or --engine {corrected.low_fidelity}"
        )
    return corrected


class CorrectedSweep(Sweep):
    """Sweep with results of an engine of low fidelity, corrected at chosen points.

    Parameters
    ----------
    direct : int, optional
        Number of chosen points in each group of words.
    """

    def __init__(
        self, scene: Scene, varied: Sequence[Axis | Sampled], *, indices: bool = False, direct: int | None = None
    ) -> None:
        super().__init__(scene, varied, indices=indices)
        self.low_fidelity = str(ENGINES[self.engines[0]].low_fidelity)
        self.places, self.groups = self._places_and_groups()
        self.direct = direct or default_count(self.places.shape[1])
        self.steps = sum(min(self.direct, len(group)) for group in self.groups)
        self.notes: tuple[str, ...] = ()

    def _places_and_groups(self) -> tuple[FloatArray, list[list[int]]]:
        """Return the coordinates of all points, 0 to 1 over the sweep [-], and the points with the same words."""
        grid = np.indices(self.design.shape).reshape(len(self.design.shape), -1)
        columns, words = [], [np.zeros(self.size, int)]
        for axis, index in zip(self.design.axes, grid, strict=False):
            if any(isinstance(value, str | bool) for value in axis.values):
                words.append(index)
            elif len(axis.values) > 1:
                values = np.array(axis.values, dtype=float)
                columns.append(((values - values.min()) / np.ptp(values))[index])
        columns += list(self.design.shares[grid[-1]].T) if self.design.names else []
        places = np.column_stack(columns) if columns else np.zeros((self.size, 1))
        _, group = np.unique(np.column_stack(words), axis=0, return_inverse=True)
        return places, [np.flatnonzero(group == number).tolist() for number in range(group.max() + 1)]

    def _results(self, evaluated: Evaluate) -> dict[int, Results]:
        """Return the results of all points: columns, chosen points, and the correction.

        Chosen points without a result are replaced by others.
        """
        changes = self.design.changes
        coarse = [change._replace(keys={**change.keys, **self._accepted(change.keys)}) for change in changes]
        groups = in_parts(range(self.size), ENGINES[self.low_fidelity].points_per_task)
        columns = evaluated(coarse, groups=groups, step=lambda *_: None)
        exact: dict[int, Results] = {}
        for _ in range(ROUNDS):
            chosen = [each.further(self.direct) for each in self._corrections(columns, exact)]
            parts = [part for numbers in chosen for part in connected_parts(self.places, numbers)]
            exact |= evaluated(changes, groups=parts, places=self.places)
        corrections = self._corrections(columns, exact)
        self.notes = tuple(each.note for each in corrections)
        return {number: result for each in corrections for number, result in each.results().items()}

    def _corrections(self, columns: Mapping[int, Results], exact: Mapping[int, Results]) -> list["Correction"]:
        return [Correction(self.places, group, columns, exact, not self.design.names) for group in self.groups]

    def _accepted(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the keys that turn a scene into one that the engine of low fidelity accepts."""
        accepted: dict[str, Any] = {"accuracy.engine": self.low_fidelity}
        for limit in ENGINES[self.low_fidelity].limits:
            value = changes.get(limit.key, limit.value_in(self.scene))
            if (limit.key in changes or self.scene.is_set(limit.key)) and not limit.takes(value, None):
                accepted[limit.key] = limit.taken[0]
        if self.scene.machine.roller_torque is not None:
            accepted["machine.roller_torque"] = None
        return accepted

    def _variables(self) -> tuple[dict[str, Any], dict[str, Any]]:
        numbers, words = super()._variables()
        return numbers | described(SWEEP_CORRECTION), words | {ORIGIN: {"long_name": ORIGIN_MEANING}}

    def _attributes(self) -> dict[str, str]:
        return super()._attributes() | {"correction": "\n".join(self.notes)}


class Correction:
    """Correction of the columns of a group of points by those with a result in two dimensions.

    Parameters
    ----------
    places : FloatArray, shape (size, parameters)
        Coordinates of all points of the sweep [-].
    group : list of int
        Numbers of the points.
    columns : mapping
        Results of the engine of low fidelity at all points by their number.
    exact : mapping
        Results at the chosen points by their number.
    convex : bool
        As of `inside_hull`.
    """

    def __init__(
        self,
        places: FloatArray,
        group: list[int],
        columns: Mapping[int, Results],
        exact: Mapping[int, Results],
        convex: bool,
    ) -> None:
        self.places, self.columns, self.exact, self.convex = places, columns, exact, convex
        self.failed = [number for number in group if columns[number].get("reason")]
        self.able = [number for number in group if number not in self.failed]
        self.chosen = [number for number in self.able if number in exact]
        fine, coarse = (
            np.array([[results[number].get(name, np.nan) for name in CORRECTED] for number in self.chosen], float)
            for results in (exact, columns)
        )
        ratios = np.full((len(self.chosen), len(CORRECTED)), np.nan)  # nan where they have no logarithm
        if self.chosen:
            np.divide(fine, coarse, out=ratios, where=fine * coarse > 0)
        has_forces = np.isfinite(ratios[:, : len(FORCES)]).all(axis=1)
        self.solved = [number for number, is_solved in zip(self.chosen, has_forces, strict=True) if is_solved]
        self.factors = ratios[has_forces]
        self.surfaces: dict[str, Surface] = {}
        for name, column in zip(CORRECTED, self.factors.T, strict=True):
            if np.isfinite(column).all() and (surface := fit_surface(places[self.solved], np.log(column))):
                self.surfaces[name] = surface

    @property
    def note(self) -> str:
        """Numbers of points, and range, kind and error of the surfaces of the forces."""
        counts = f"{len(self.solved)} of {len(self.chosen)} chosen points have a result in two dimensions"
        if not set(FORCES) <= set(self.surfaces):
            return f"{counts}, too few for a response surface; take a larger --direct, or all"
        for name, column in zip(FORCES, self.factors.T, strict=False):
            surface, span = self.surfaces[name], f"{column.min():.3g} to {column.max():.3g} of columns"
            counts += f"; {name} {span}, error of interpolation {surface.error:.2%} ({surface.kind} surface)"
        return counts

    def further(self, count: int) -> list[int]:
        """Return the next chosen points, of a number in all: first evenly, then by the error."""
        places, taken = self.places[self.able], [i for i, number in enumerate(self.able) if number in self.exact]
        if not taken:
            found = choose_points(places, ceil(FIRST_SHARE * count))
        elif not self.solved:
            return []
        else:
            surface, weights = self.surfaces.get("resistance"), None
            if surface is not None:
                weights = refinement_weights(places, self.places[self.solved], surface.residuals)
            found = choose_points(places, count - len(self.solved), taken, weights)
        return [self.able[i] for i in found]

    def results(self) -> dict[int, Results]:
        """Return the results of all points of the group by their number."""
        results = {number: self.columns[number] for number in self.failed}
        for number in self.chosen:
            result = self.exact[number]
            results[number] = result | {ORIGIN: "refused" if result.get("reason") else "solved"}
        for number, row in zip(self.solved, self.factors, strict=True):
            for name, factor in zip(FORCES, row.tolist(), strict=False):
                results[number] |= {f"{name}_factor": factor, f"{name}_surface_error": 0.0}
        rest = [number for number in self.able if number not in self.exact]
        if not rest or not set(FORCES) <= set(self.surfaces):
            return results | {number: {"reason": self.note} for number in rest}
        reason = (
            f"beyond the hull of the {len(self.solved)} points with a result in two dimensions, of "
            f"{len(self.chosen)} chosen; --direct all computes this point"
        )
        inside = inside_hull(self.places[rest], self.places[self.solved], self.convex)
        factors = {name: np.exp(surface(self.places[rest])) for name, surface in self.surfaces.items()}
        for i, number in enumerate(rest):
            factor = {name: float(values[i]) for name, values in factors.items()}
            results[number] = self._corrected(number, factor) if inside[i] else {"reason": reason}
        return results

    def _corrected(self, number: int, factor: Mapping[str, float]) -> Results:
        """Return the corrected results of columns, with the engine error of the nearest solved point."""
        column = self.columns[number]
        nearest = self.exact[self.solved[np.argmin(distances(self.places[self.solved], self.places[number]))]]
        found = column | {name: column[name] * factor.get(name, np.nan) for name in CORRECTED if name in column}
        found["resistance_coefficient"] = column["resistance_coefficient"] * factor["resistance"] / factor["load"]
        found["power"] = column["power"] * factor["resistance"]
        for name in FORCES:
            error = self.surfaces[name].error
            found |= {f"{name}_factor": factor[name], f"{name}_surface_error": error}
            found[f"{name}_error"] = nearest[f"{name}_error"] + error
        return found | {"work_residual": np.nan, "mass_residual": np.nan, "replaced": nearest.get("replaced", "")}
