"""Response surfaces that correct a cheap engine by an exact one: choice of points, their order, and the fit.

The cheap engine computes all points of a sweep, the exact one some of them. The logarithm of the ratio of the two is
smooth over the parameters; a response surface interpolates it to the other points. Coordinates are those of the
parameters, scaled to 0 ... 1 over the sweep.

    numbers = choose_points(places, 18)             # farthest-point design
    parts = connected_parts(places[numbers])        # one worker each, ordered by neighbours
    surface = fit_surface(places[numbers], np.log(exact / cheap))
    surface(places), surface.error

References
----------
M. C. Kennedy, A. O'Hagan, Predicting the output from a complex computer code when fast approximations are available,
Biometrika 87, 2000. T. F. Gonzalez, Clustering to minimize the maximum intercluster distance, Theor. Comput. Sci. 38,
1985, of the farthest-point design. R. D. Cook, Influential observations in linear regression, J. Am. Stat. Assoc. 74,
1979, of the hull by leverage.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from compact.analysis.stages.ensemble import polynomial_terms

FloatArray = NDArray[np.float64]
Model = Callable[[FloatArray], FloatArray]

POINTS_PER_COEFFICIENT = 3  # [-], default number of chosen points over the coefficients of a quadratic surface
PART_SIZE = 6  # [-], largest number of points in one part
MIN_WEIGHT = 0.1  # [-], least weight over the largest
MAX_CONVEX = 4  # [-], parameters up to which a convex hull of the chosen points is computed
DECIMALS = 9  # [-], of distances; nearer points are equal
ROUNDING = 10.0**-DECIMALS  # [-], of coordinates
COVERAGE = 2.0  # [-], error estimate over the rms of the leave-one-out errors; about 95 % of normal errors


def default_count(parameters: int) -> int:
    """Return the default number of chosen points for a number of parameters.

    Examples
    --------
    >>> default_count(1), default_count(2), default_count(3)
    (9, 18, 30)
    """
    return POINTS_PER_COEFFICIENT * (parameters + 1) * (parameters + 2) // 2


def choose_points(
    places: FloatArray, count: int, taken: Sequence[int] = (), weights: FloatArray | None = None
) -> list[int]:
    """Choose points that fill the space: corners first, then always the point farthest from all chosen ones.

    Parameters
    ----------
    places : FloatArray, shape (points, parameters)
        Coordinates of the candidates and of the points taken [-].
    count : int
        Number of further points.
    taken : sequence of int
        Numbers of the points that are chosen already.
    weights : FloatArray, shape (points,), optional
        Factors of the distances, larger where more points are required [-].

    Returns
    -------
    list of int
        Numbers of the chosen points; fewer if there are no more.
    """
    chosen: list[int] = []
    if not taken and 2 ** places.shape[1] <= count:
        corners = product((0.0, 1.0), repeat=places.shape[1])
        chosen = list(dict.fromkeys(int(np.argmin(distances(places, np.array(corner)))) for corner in corners))
    distance = np.full(len(places), np.inf)
    for number in (*taken, *chosen):
        distance = np.minimum(distance, distances(places, places[number]))
    while len(chosen) < count:
        number = int(np.argmax(distance if weights is None else distance * weights))
        if distance[number] == 0:
            break
        chosen.append(number)
        distance = np.minimum(distance, distances(places, places[number]))
    return chosen


def distances(places: FloatArray, place: FloatArray) -> FloatArray:
    """Return the distances of places from one place, rounded so that equal ones are equal [-]."""
    return np.sqrt(np.sum((places - place) ** 2, axis=1)).round(DECIMALS)


def refinement_weights(places: FloatArray, solved: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return weights for `choose_points`: the leave-one-out error at the nearest solved point, within a factor of ten.

    Parameters
    ----------
    places : FloatArray, shape (points, parameters)
        Coordinates of the candidates [-].
    solved : FloatArray, shape (solved, parameters)
        Coordinates of the points of a surface [-].
    residuals : FloatArray, shape (solved,)
        Leave-one-out errors there [-].
    """
    size = np.abs(residuals)
    nearest = [int(np.argmin(distances(solved, place))) for place in places]
    return np.maximum(size, max(MIN_WEIGHT * float(size.max()), ROUNDING))[nearest]


def connected_parts(places: FloatArray, numbers: Sequence[int], size: int = PART_SIZE) -> list[list[int]]:
    """Divide points into connected parts, each in an order of neighbours.

    The points are bisected along their longest extent. A part begins next to its middle; each further point is the one
    nearest to those before.

    Parameters
    ----------
    places : FloatArray, shape (points, parameters)
        Coordinates of all points [-].
    numbers : sequence of int
        Points to be divided.
    size : int
        Largest number of points of a part.
    """
    if len(numbers) > size:
        inside = places[list(numbers)]
        axis = int(np.argmax(np.ptp(inside, axis=0)))
        order = [numbers[i] for i in np.lexsort((np.array(numbers), inside[:, axis]))]
        half = (len(order) + 1) // 2
        return [part for side in (order[:half], order[half:]) for part in connected_parts(places, side, size)]
    left, ordered = sorted(numbers), list[int]()
    while left:
        before = places[ordered] if ordered else places[list(numbers)].mean(axis=0, keepdims=True)
        near = [distances(before, places[number]).min() for number in left]
        ordered.append(left.pop(int(np.argmin(near))))
    return [ordered] if ordered else []


@dataclass(frozen=True, eq=False)
class Surface:
    """Response surface with its leave-one-out errors.

    Parameters
    ----------
    kind : str
        Name of the model.
    residuals : FloatArray
        Error at each point of the surface that is fitted to all others [-].
    model : callable
        Values at coordinates of shape (points, parameters).
    """

    kind: str
    residuals: FloatArray
    model: Model

    @property
    def error(self) -> float:
        """Estimated error: COVERAGE times the rms of the leave-one-out errors [-]."""
        return COVERAGE * float(np.sqrt(np.mean(self.residuals**2)))

    def __call__(self, places: FloatArray) -> FloatArray:
        """Return the values at coordinates [-], shape (points,)."""
        return self.model(places)


def fit_surface(places: FloatArray, values: FloatArray) -> Surface | None:
    """Fit the surface with the least leave-one-out error: linear, quadratic, or radial basis functions.

    Parameters
    ----------
    places : FloatArray, shape (points, parameters)
        Coordinates [-].
    values : FloatArray, shape (points,)
        Values [-].

    Returns
    -------
    Surface or None
        None if the points are too few for any surface.
    """
    from scipy.interpolate import RBFInterpolator

    count, parameters = places.shape

    def polynomial(degree: int, x: FloatArray, y: FloatArray) -> Model:
        coefficients = np.linalg.lstsq(polynomial_terms(x, degree), y, rcond=None)[0]
        return lambda there: polynomial_terms(there, degree) @ coefficients

    def spline(kernel: str, x: FloatArray, y: FloatArray) -> Model:
        return RBFInterpolator(x, y, kernel=kernel, degree=1)

    linear, quadratic = 1 + parameters, (parameters + 1) * (parameters + 2) // 2
    kinds = {  # fit and number of polynomial coefficients
        "linear": (partial(polynomial, 1), linear),
        "quadratic": (partial(polynomial, 2), quadratic),
        "thin-plate spline": (partial(spline, "thin_plate_spline"), linear),
        "cubic spline": (partial(spline, "cubic"), linear),
    }
    found: list[Surface] = []
    others = [np.arange(count) != i for i in range(count)]
    for kind, (fit, terms) in kinds.items():
        if count < terms + 2:  # so that a surface without one point is overdetermined
            continue
        try:
            predicted = [fit(places[others[i]], values[others[i]])(places[i : i + 1])[0] for i in range(count)]
            found.append(Surface(kind, values - np.array(predicted), fit(places, values)))
        except np.linalg.LinAlgError:  # points on a line, without one of them
            continue
    return min(found, key=lambda surface: surface.error, default=None)


def inside_hull(places: FloatArray, solved: FloatArray, convex: bool) -> NDArray[np.bool_]:
    """Return which places a surface through solved points interpolates.

    Parameters
    ----------
    places, solved : FloatArray, shape (points, parameters)
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
