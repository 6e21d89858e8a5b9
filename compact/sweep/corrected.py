"""Sweep by an engine of high fidelity at chosen points, which correct an engine of low fidelity at all points.

    grid = "mix.moisture=0.08:0.12:10", "mix.density_ratio=0.95:0.98:10"
    sweep = create_sweep(scene, [read_design(text) for text in grid])
    table = sweep.run("out/sweep", executor=ProcessExecutor(2))  # 18 of 100 points by finite elements

The engine "compaction" takes seconds for a point, "column" milliseconds. Their ratio is smooth over the parameters: a
response surface of its logarithm interpolates it, with a leave-one-out error that is added to that of the engine. Its
coordinates are the parameters, scaled to 0 ... 1 over the sweep. The chosen points fill the space evenly. Those that
the engine refuses are replaced by others once and are not part of the surface; points beyond those that it solved have
no result.

Keys with words, such as layer.base, divide the sweep into parts with one surface each. The chosen points are divided
into connected parts, each a task, in which a point starts from the nearest contact. This division does not depend on
the number of workers.

References
----------
M. C. Kennedy, A. O'Hagan, Predicting the output from a complex computer code when fast approximations are available,
Biometrika 87, 2000. T. F. Gonzalez, Clustering to minimize the maximum intercluster distance, Theor. Comput. Sci. 38,
1985, of the farthest-point design.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.optimize import nnls
from scipy.spatial.distance import cdist

from compact.analysis.stages.ensemble import Share
from compact.engines import ENGINES
from compact.numerics import Array, BoolArray
from compact.quantities import SWEEP_CORRECTION
from compact.scene.loader import Scene
from compact.sweep.design import Axis, Sampled
from compact.sweep.run import Evaluate, Results, Sweep, described, in_parts

ALL = "all"
ROUNDS = 2  # [-], of chosen points; the second replaces points without a result
FORCES = ("load", "resistance")  # with an error estimate
CORRECTED = (*FORCES, "capture_angle", "contact_length", "peak_pressure", "exit_density_ratio")
ORIGIN = "two_dimensions"
ORIGIN_MEANING = "solved or refused by the engine at this point; empty for columns that a response surface corrects"
POINTS_PER_COEFFICIENT = 3  # [-], default number of chosen points over the coefficients of a quadratic polynomial
PART_SIZE = 6  # [-], largest number of points in one part
DECIMALS = 9  # [-], of distances; nearer points are equal
TOLERANCE = 1e-8  # [-], of coordinates
COVERAGE = 2.0  # [-], error estimate over the rms of the leave-one-out errors; about 95 % of normal errors


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
        Number of points that the engine computes itself; by default thrice the coefficients of a quadratic polynomial.

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
        words = "--rank needs a resistance over speed, which a correction does not have"
        raise ValueError(f"{words}; give --direct all, or --engine {corrected.low_fidelity}")
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

    def _places_and_groups(self) -> tuple[Array, list[list[int]]]:
        """Return the coordinates of all points, 0 to 1 over the sweep [-], and the points with the same words."""
        changes = self.design.changes
        words, columns = [], [np.zeros((self.size, 0))]
        for key, first in changes[0].keys.items():
            values = [change.keys[key] for change in changes]
            if any(isinstance(value, str | bool) for value in values):
                words.append(values)
            elif isinstance(first, Share):
                columns.append(np.array(values))
            elif np.ptp(values) > 0:
                columns.append((np.array(values)[:, None] - min(values)) / np.ptp(values))
        places, groups = np.hstack(columns), dict[Any, list[int]]()
        for number, group in enumerate(zip(*words, strict=True) if words else [()] * self.size):
            groups.setdefault(group, []).append(number)
        return places if places.size else np.zeros((self.size, 1)), list(groups.values())

    def _results(self, evaluated: Evaluate) -> dict[int, Results]:
        """Return the results of all points: columns, chosen points, and the correction."""
        changes = self.design.changes
        coarse = [change._replace(keys={**change.keys, **self._accepted(change.keys)}) for change in changes]
        groups = in_parts(range(self.size), ENGINES[self.low_fidelity].points_per_task)
        columns = evaluated(coarse, groups=groups, step=lambda *_: None)
        exact: dict[int, Results] = {}
        for _ in range(ROUNDS):
            chosen = [self._further(group, columns, exact) for group in self.groups]
            parts = [part for numbers in chosen for part in connected_parts(self.places, numbers)]
            exact |= evaluated(changes, groups=parts, places=self.places)
        found, notes = zip(*(self._corrected(group, columns, exact) for group in self.groups), strict=True)
        self.notes = notes
        return {number: result for each in found for number, result in each.items()}

    def _further(self, group: list[int], columns: Mapping[int, Results], exact: Mapping[int, Results]) -> list[int]:
        """Return the next chosen points of a group; none where the engine refused all of the first round."""
        able = [number for number in group if not columns[number].get("reason")]
        taken = [i for i, number in enumerate(able) if number in exact]
        solved = sum(not exact[able[i]].get("reason") for i in taken)
        if taken and not solved:
            return []
        return [able[i] for i in choose_points(self.places[able], self.direct - solved, taken)]

    def _corrected(
        self, group: list[int], columns: Mapping[int, Results], exact: Mapping[int, Results]
    ) -> tuple[dict[int, Results], str]:
        """Return the results of all points of a group by their number, and words about the correction."""
        able = [number for number in group if not columns[number].get("reason")]
        chosen, rest = [n for n in able if n in exact], [n for n in able if n not in exact]
        found = {number: columns[number] for number in group}
        ratios: dict[int, list[float]] = {}  # of CORRECTED, at solved points
        for number in chosen:
            found[number] = exact[number] | {ORIGIN: "refused" if exact[number].get("reason") else "solved"}
            pairs = ((exact[number].get(name, np.nan), columns[number].get(name, np.nan)) for name in CORRECTED)
            factors = [fine / coarse if fine * coarse > 0 else np.nan for fine, coarse in pairs]
            if np.isfinite(factors[: len(FORCES)]).all():
                ratios[number] = factors
                for name, factor in zip(FORCES, factors, strict=False):
                    found[number] |= {f"{name}_factor": factor, f"{name}_surface_error": 0.0}

        note = f"{len(ratios)} of {len(chosen)} chosen points have a result in two dimensions"
        solved, places = self.places[list(ratios)], self.places[rest]
        table = np.array(list(ratios.values()))
        surface = fit_surface(solved, np.log(table))
        if surface is None:
            note += ", too few for a response surface; take a larger --direct, or all"
            return found | {number: {"reason": note} for number in rest}, note
        for name, low, high, error in zip(FORCES, table.min(axis=0), table.max(axis=0), surface.errors, strict=False):
            note += f"; {name} {low:.3g} to {high:.3g} of columns, error of interpolation {error:.2%}"
        inside = (inside_ellipsoid if self.design.names else inside_hull)(places, solved)
        nearest = [exact[list(ratios)[i]] for i in distances(places, solved).argmin(axis=1)]
        interpolated = np.exp(surface.values(places)).tolist()
        for number, is_inside, near, factors in zip(rest, inside, nearest, interpolated, strict=True):
            if not is_inside:
                words = f"beyond the hull of the {len(ratios)} points with a result in two dimensions"
                found[number] = {"reason": f"{words}, of {len(chosen)} chosen; --direct all computes this point"}
                continue
            column, factor = columns[number], dict(zip(CORRECTED, factors, strict=True))
            result = column | {name: column[name] * factor[name] for name in CORRECTED if name in column}
            result["resistance_coefficient"] = column["resistance_coefficient"] * factor["resistance"] / factor["load"]
            result["power"] = column["power"] * factor["resistance"]
            for name, error in zip(FORCES, surface.errors.tolist(), strict=False):
                result |= {f"{name}_factor": factor[name], f"{name}_surface_error": error}
                result[f"{name}_error"] = near[f"{name}_error"] + error
            unknown = {"work_residual": np.nan, "mass_residual": np.nan, "replaced": near.get("replaced", "")}
            found[number] = result | unknown
        return found, note

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


# choice of points


def distances(places: Array, others: Array) -> Array:
    """Return the distances between places, rounded so that equal ones are equal [-], shape (places, others)."""
    return cdist(places, others).round(DECIMALS)


def default_count(parameters: int) -> int:
    """Return the default number of chosen points for a number of parameters.

    Examples
    --------
    >>> default_count(1), default_count(2), default_count(3)
    (9, 18, 30)
    """
    return POINTS_PER_COEFFICIENT * (parameters + 1) * (parameters + 2) // 2


def choose_points(places: Array, count: int, taken: Sequence[int] = ()) -> list[int]:
    """Choose points that fill the space: from the first one on, always the point farthest from all chosen ones.

    Parameters
    ----------
    places : Array, shape (points, parameters)
        Coordinates of the candidates and of the points taken [-].
    count : int
        Number of further points.
    taken : sequence of int
        Numbers of the points that are chosen already.

    Returns
    -------
    list of int
        Numbers of the chosen points; fewer if there are no more.
    """
    chosen: list[int] = []
    distance = distances(places, places[list(taken)]).min(axis=1, initial=np.inf)
    while len(chosen) < count and distance.any():
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, distances(places, places[chosen[-1:]])[:, 0])
    return chosen


def connected_parts(places: Array, numbers: Sequence[int], size: int = PART_SIZE) -> list[list[int]]:
    """Divide points into connected parts: bisect them along their longest extent, and order a part from its middle out.

    Parameters
    ----------
    places : Array, shape (points, parameters)
        Coordinates of all points [-].
    numbers : sequence of int
        Points to be divided.
    size : int
        Largest number of points of a part.
    """
    if not numbers:
        return []
    inside = places[list(numbers)]
    if len(numbers) <= size:
        outwards = distances(inside, inside.mean(axis=0, keepdims=True))[:, 0].argsort(kind="stable")
        return [[numbers[i] for i in outwards]]
    axis = int(np.argmax(np.ptp(inside, axis=0)))
    order = [numbers[i] for i in np.lexsort((np.array(numbers), inside[:, axis]))]
    half = (len(order) + 1) // 2
    return [part for side in (order[:half], order[half:]) for part in connected_parts(places, side, size=size)]


# response surfaces


class Surface(NamedTuple):
    """Thin-plate spline over a polynomial, of one or several quantities.

    Parameters
    ----------
    values : callable
        Values [-], shape (points, quantities), at coordinates of shape (points, parameters).
    errors : Array
        Estimated errors: COVERAGE times the rms of the leave-one-out errors [-].
    """

    values: RBFInterpolator
    errors: Array


def fit_surface(places: Array, values: Array) -> Surface | None:
    """Fit response surfaces to values [-], shape (points, quantities), at coordinates of shape (points, parameters).

    Returns
    -------
    Surface or None
        None if the points are too few, or on a line. A quantity with a value that is nan has none elsewhere.
    """
    if len(places) < places.shape[1] + 3:
        return None  # a surface without one point would not be overdetermined
    coefficients = default_count(places.shape[1]) // POINTS_PER_COEFFICIENT
    degree = 2 if len(places) >= 2 * coefficients else 1  # of the polynomial below the spline
    try:
        surface = RBFInterpolator(places, values, degree=degree)
        others = ~np.eye(len(places), dtype=bool)
        left = np.vstack([RBFInterpolator(places[rest], values[rest], degree=degree)(places[~rest]) for rest in others])
    except np.linalg.LinAlgError:
        return None
    return Surface(surface, COVERAGE * np.sqrt(np.mean((values - left) ** 2, axis=0)))


def inside_hull(places: Array, solved: Array) -> BoolArray:
    """Return which places are in the convex hull of the solved points: means of these, with weights of at least 0."""
    corners = np.column_stack([solved, np.ones(len(solved))]).T
    return np.array([nnls(corners, [*place, 1.0])[1] <= TOLERANCE for place in places])


def inside_ellipsoid(places: Array, solved: Array) -> BoolArray:
    """Return which places have at most the Mahalanobis distance of the outermost solved point from the mean of all.

    For samples, most of which are outside the convex hull of a few of them.
    """
    centre, inverse = solved.mean(axis=0, keepdims=True), np.linalg.pinv(np.atleast_2d(np.cov(solved.T)))
    far, known = (cdist(each, centre, "mahalanobis", VI=inverse)[:, 0] for each in (places, solved))
    return far <= known.max() + TOLERANCE
