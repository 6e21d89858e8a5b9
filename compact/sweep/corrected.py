"""Sweep by an engine of high fidelity at chosen points, which correct an engine of low fidelity at all points.

    grid = "mix.moisture=0.08:0.12:10", "mix.density_ratio=0.95:0.98:10"
    sweep = create_sweep(scene, [read_design(text) for text in grid])
    table = sweep.run("out/sweep", executor=ProcessExecutor(2))  # 18 of 100 points by finite elements

The engine "compaction" takes seconds for a point, "column" milliseconds. Their ratio is smooth over the parameters: a
response surface of its logarithm interpolates it, with a leave-one-out error that is added to that of the engine. Its
coordinates are the parameters, scaled to 0 ... 1 over the sweep. Chosen points that the engine refuses are replaced by
others and are not part of the surface; points beyond the hull of those that it solved have no result.

Keys with words, such as layer.base, divide the sweep into parts with one surface each. The chosen points are divided
into connected parts, each a task, in which a point starts from the nearest contact. This division does not depend on
the number of workers.

References
----------
M. C. Kennedy, A. O'Hagan, Predicting the output from a complex computer code when fast approximations are available,
Biometrika 87, 2000. T. F. Gonzalez, Clustering to minimize the maximum intercluster distance, Theor. Comput. Sci. 38,
1985, of the farthest-point design. R. D. Cook, Influential observations in linear regression, J. Am. Stat. Assoc. 74,
1979, of the hull by leverage.
"""

from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.spatial.distance import cdist

from compact.analysis.stages.ensemble import Share, polynomial_terms
from compact.engines import ENGINES
from compact.numerics import Array, BoolArray
from compact.quantities import SWEEP_CORRECTION
from compact.scene.loader import Scene
from compact.sweep.design import Axis, Sampled
from compact.sweep.run import Evaluate, Results, Sweep, described, in_parts

ALL = "all"
ROUNDS = 3  # [-], of chosen points; the second refines the surface, and later ones replace points without a result
FIRST_SHARE = 2 / 3  # [-], of the chosen points that fill the space evenly
FORCES = ("load", "resistance")  # with an error estimate
CORRECTED = (*FORCES, "capture_angle", "contact_length", "peak_pressure", "exit_density_ratio")
ORIGIN = "two_dimensions"
ORIGIN_MEANING = "solved or refused by the engine at this point; empty for columns that a response surface corrects"
POINTS_PER_COEFFICIENT = 3  # [-], default number of chosen points over the coefficients of a quadratic surface
PART_SIZE = 6  # [-], largest number of points in one part
MIN_WEIGHT = 0.1  # [-], least weight over the largest
MAX_CONVEX = 4  # [-], parameters up to which a convex hull of the chosen points is computed
DECIMALS = 9  # [-], of distances; nearer points are equal
ROUNDING = 10.0**-DECIMALS  # [-], of coordinates
COVERAGE = 2.0  # [-], error estimate over the rms of the leave-one-out errors; about 95 % of normal errors
DEGREES = {"linear": 1, "quadratic": 2}  # of the polynomial below a spline


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
        return [Correction(self, group, columns, exact) for group in self.groups]

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
    group : list of int
        Numbers of the points.
    columns : mapping
        Results of the engine of low fidelity at all points by their number.
    exact : mapping
        Results at the chosen points by their number.
    """

    def __init__(
        self, sweep: CorrectedSweep, group: list[int], columns: Mapping[int, Results], exact: Mapping[int, Results]
    ) -> None:
        self.places, self.convex, self.group = sweep.places, not sweep.design.names, group
        self.columns, self.exact = columns, exact
        self.able = [number for number in group if not columns[number].get("reason")]
        self.chosen = [number for number in self.able if number in exact]
        fine, coarse = (
            np.array([[results[number].get(name, np.nan) for number in self.chosen] for name in CORRECTED])
            for results in (exact, columns)
        )
        ratios = np.divide(fine, coarse, out=np.full(fine.shape, np.nan), where=fine * coarse > 0)
        has_forces = np.isfinite(ratios[: len(FORCES)]).all(axis=0)
        self.solved = [number for number, is_solved in zip(self.chosen, has_forces, strict=True) if is_solved]
        self.factors = dict(zip(CORRECTED, ratios[:, has_forces], strict=True))
        self.surfaces: dict[str, Surface] = {}
        for name, column in self.factors.items():
            if np.isfinite(column).all() and (surface := fit_surface(self.places[self.solved], np.log(column))):
                self.surfaces[name] = surface

    @property
    def note(self) -> str:
        """Numbers of points, and range, kind and error of the surfaces of the forces."""
        counts = f"{len(self.solved)} of {len(self.chosen)} chosen points have a result in two dimensions"
        if not set(FORCES) <= set(self.surfaces):
            return f"{counts}, too few for a response surface; take a larger --direct, or all"
        for name in FORCES:
            surface, column = self.surfaces[name], self.factors[name]
            span = f"{column.min():.3g} to {column.max():.3g} of columns"
            error = f"error of interpolation {surface.error:.2%}, over a {surface.kind} polynomial"
            counts += f"; {name} {span}, {error}"
        return counts

    def further(self, count: int) -> list[int]:
        """Return the next chosen points, of a number in all: first evenly, then by the error."""
        if self.chosen and not self.solved:
            return []
        places, taken = self.places[self.able], [i for i, number in enumerate(self.able) if number in self.exact]
        weights: Any = 1.0
        if "resistance" in self.surfaces:  # the leave-one-out error at the nearest solved point, within a factor of ten
            sizes = np.abs(self.surfaces["resistance"].residuals)
            sizes = np.maximum(sizes, max(MIN_WEIGHT * sizes.max(), ROUNDING))
            weights = sizes[distances(places, self.places[self.solved]).argmin(axis=1)]
        wanted = count - len(self.solved) if taken else ceil(FIRST_SHARE * count)
        return [self.able[i] for i in choose_points(places, wanted, taken, weights)]

    def results(self) -> dict[int, Results]:
        """Return the results of all points of the group by their number."""
        found = {number: self.columns[number] for number in self.group}
        for number in self.chosen:
            result = self.exact[number]
            found[number] = result | {ORIGIN: "refused" if result.get("reason") else "solved"}
        for name in FORCES:
            for number, factor in zip(self.solved, self.factors[name].tolist(), strict=True):
                found[number] |= {f"{name}_factor": factor, f"{name}_surface_error": 0.0}
        rest = [number for number in self.able if number not in self.exact]
        if not rest or not set(FORCES) <= set(self.surfaces):
            return found | {number: {"reason": self.note} for number in rest}
        reason = (
            f"beyond the hull of the {len(self.solved)} points with a result in two dimensions, of "
            f"{len(self.chosen)} chosen; --direct all computes this point"
        )
        places, solved = self.places[rest], self.places[self.solved]
        inside, nearest = inside_hull(places, solved, self.convex), distances(places, solved).argmin(axis=1)
        factors = {name: np.exp(surface(places)).tolist() for name, surface in self.surfaces.items()}
        for i, number in enumerate(rest):
            factor = dict.fromkeys(CORRECTED, np.nan) | {name: values[i] for name, values in factors.items()}
            corrected = self._corrected(self.columns[number], factor, self.exact[self.solved[nearest[i]]])
            found[number] = corrected if inside[i] else {"reason": reason}
        return found

    def _corrected(self, column: Results, factor: Mapping[str, float], nearest: Results) -> Results:
        """Return the corrected results of columns, with the engine error of the nearest solved point."""
        found = column | {name: column[name] * factor[name] for name in CORRECTED if name in column}
        found["resistance_coefficient"] = column["resistance_coefficient"] * factor["resistance"] / factor["load"]
        found["power"] = column["power"] * factor["resistance"]
        for name in FORCES:
            error = self.surfaces[name].error
            found |= {f"{name}_factor": factor[name], f"{name}_surface_error": error}
            found[f"{name}_error"] = nearest[f"{name}_error"] + error
        return found | {"work_residual": np.nan, "mass_residual": np.nan, "replaced": nearest.get("replaced", "")}


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


def choose_points(places: Array, count: int, taken: Sequence[int] = (), weights: Array | float = 1.0) -> list[int]:
    """Choose points that fill the space: from the first one on, always the point farthest from all chosen ones.

    Parameters
    ----------
    places : Array, shape (points, parameters)
        Coordinates of the candidates and of the points taken [-].
    count : int
        Number of further points.
    taken : sequence of int
        Numbers of the points that are chosen already.
    weights : Array, shape (points,), optional
        Factors of the distances, larger where more points are required [-].

    Returns
    -------
    list of int
        Numbers of the chosen points; fewer if there are no more.
    """
    chosen: list[int] = []
    distance = distances(places, places[list(taken)]).min(axis=1, initial=np.inf)
    while len(chosen) < count and distance.any():
        chosen.append(int(np.argmax(distance * weights)))
        distance = np.minimum(distance, distances(places, places[chosen[-1:]])[:, 0])
    return chosen


def connected_parts(places: Array, numbers: Sequence[int], size: int = PART_SIZE) -> list[list[int]]:
    """Divide points into connected parts, each in an order of neighbours.

    The points are bisected along their longest extent. A part begins next to its middle; each further point is the one
    nearest to those before.

    Parameters
    ----------
    places : Array, shape (points, parameters)
        Coordinates of all points [-].
    numbers : sequence of int
        Points to be divided.
    size : int
        Largest number of points of a part.
    """
    inside = places[list(numbers)]
    if len(numbers) > size:
        axis = int(np.argmax(np.ptp(inside, axis=0)))
        order = [numbers[i] for i in np.lexsort((np.array(numbers), inside[:, axis]))]
        half = (len(order) + 1) // 2
        return [part for side in (order[:half], order[half:]) for part in connected_parts(places, side, size=size)]
    left, ordered = sorted(numbers), list[int]()
    while left:
        before = places[ordered] if ordered else inside.mean(axis=0, keepdims=True)
        ordered.append(left.pop(int(distances(places[left], before).min(axis=1).argmin())))
    return [ordered] if ordered else []


# response surfaces


class Surface(NamedTuple):
    """Response surface with its leave-one-out errors.

    Parameters
    ----------
    kind : str
        Name of the model.
    residuals : Array
        Error at each point of the surface that is fitted to all others [-].
    model : callable
        Values [-], shape (points,), at coordinates of shape (points, parameters).
    """

    kind: str
    residuals: Array
    model: Callable[[Array], Array]

    @property
    def error(self) -> float:
        """Estimated error: COVERAGE times the rms of the leave-one-out errors [-]."""
        return COVERAGE * float(np.sqrt(np.mean(self.residuals**2)))

    def __call__(self, places: Array) -> Array:
        """Return the values at coordinates [-], shape (points,)."""
        return self.model(places)


def fit_surface(places: Array, values: Array) -> Surface | None:
    """Fit a thin-plate spline over the polynomial with the least leave-one-out error.

    Parameters
    ----------
    places : Array, shape (points, parameters)
        Coordinates [-].
    values : Array, shape (points,)
        Values [-].

    Returns
    -------
    Surface or None
        None if the points are too few for any surface.
    """
    found: list[Surface] = []
    others = ~np.eye(len(places), dtype=bool)
    for kind, degree in DEGREES.items():
        if len(places) < polynomial_terms(places, degree).shape[1] + 2:
            continue  # a surface without one point would not be overdetermined
        try:
            without = [RBFInterpolator(places[rest], values[rest], degree=degree) for rest in others]
            left = np.array([each(places[i : i + 1])[0] for i, each in enumerate(without)])
            found.append(Surface(kind, values - left, RBFInterpolator(places, values, degree=degree)))
        except np.linalg.LinAlgError:  # points on a line, without one of them
            continue
    return min(found, key=lambda surface: surface.error, default=None)


def inside_hull(places: Array, solved: Array, convex: bool) -> BoolArray:
    """Return which places a surface through solved points interpolates.

    Parameters
    ----------
    places, solved : Array, shape (points, parameters)
        Coordinates [-].
    convex : bool
        True for the convex hull. False for the hull by leverage: the ellipsoid of the linear regression through the
        outermost solved point, for samples, most of which are outside the convex hull of a few of them.
    """
    from scipy.spatial import Delaunay, QhullError

    parameters = solved.shape[1]
    if not convex or parameters > MAX_CONVEX:
        terms = polynomial_terms(solved, 1)
        inverse = np.linalg.pinv(terms.T @ terms)
        leverage = [np.einsum("ij,jk,ik->i", rows, inverse, rows) for rows in (polynomial_terms(places, 1), terms)]
        return leverage[0] <= leverage[1].max() + ROUNDING
    if parameters == 1:
        return (places[:, 0] >= solved.min() - ROUNDING) & (places[:, 0] <= solved.max() + ROUNDING)
    try:
        return Delaunay(solved).find_simplex(places, tol=ROUNDING) >= 0
    except (QhullError, ValueError):  # solved points on a line
        return np.zeros(len(places), dtype=bool)
