"""Layers meshed in straight rows of quadrilaterals, fine under the contact and graded outwards and downwards.

Every row lies between two heights, so that material flowing along x stays in its row. The Gauss points of a row share
their heights, and each height is one streamline. x is along the travel, y upwards, the base at y = 0.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from compact.numerics import Array, IntArray
from compact.numerics.validation import require_finite, require_positive, require_that

DEFAULT_ERROR = 2e-3  # [-], relative error of the resistance with DEFAULT_ELEMENTS; studies/speed_against_error.py
DEFAULT_ELEMENTS = 10  # [-], elements per half-width
ERROR_ORDER = 1.5  # [-], order of convergence of the resistance in the elements per half-width
MIN_ELEMENTS, MAX_ELEMENTS = 4, 80  # [-], elements per half-width
GROWTH = 1.4  # [-], ratio of neighbouring elements, its root inside the contact; error 3e-5 of the load, refined 6e-6
EDGE_REFINEMENT = 4  # [-], refinement at the contact edges; resistance within 0.2 % in the limits, 1 % without
REACH = 20.0  # [-], free length beyond the contact over the height; 14 leave 3e-5 in the load at v tau = 500 heights
MAX_SIZE = 2.0  # [-], largest element over the height; halving it changes nothing
INSIDE_PLY_RATIO, EDGE_PLY_RATIO = 10, 2  # [-], contact length over ply thickness that limits the element size
MIRROR_TOLERANCE = 1e-13  # [-], of the length; nodes closer than this to a mirror image are its mirror image
HEIGHT_TOLERANCE = 1e-9  # [-], of the height; corners closer than this have one height


@dataclass(frozen=True, eq=False)
class RowMesh:
    """Quadrilaterals in straight rows; meshes with equal nodes are equal.

    Parameters
    ----------
    x : ndarray, shape (rows + 1, columns + 1)
        Positions of the nodes [m], one line per height from the base upwards, ascending along each line.
    y : ndarray, shape (rows + 1,)
        Heights of the lines [m], from 0 to the height of the layer.

    Raises
    ------
    ValueError
        If the rows are not straight and ascending.
    """

    x: Array
    y: Array

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            array = np.array(getattr(self, name), float)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        x, y = self.x, self.y
        if y.ndim != 1 or x.ndim != 2 or len(x) != len(y) or min(x.shape) < 2:
            raise ValueError(
                f"`x` must have one line of at least two nodes for each of `y`, got {x.shape} and {y.shape}"
            )
        require_finite(x=x, y=y)
        off, climbs = abs(y[0]) > HEIGHT_TOLERANCE * abs(y[-1] - y[0]), np.diff(x, axis=1) > 0
        require_that(not off, y[0], "the base must lie at `y` = 0, got")
        require_that(np.diff(y) > 0, y[1:], "`y` must increase from the base upwards, got")
        require_that(climbs, x[:, 1:], "`x` must increase along every line, got")

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RowMesh):
            return NotImplemented
        return np.array_equal(self.x, other.x) and np.array_equal(self.y, other.y)

    def __hash__(self) -> int:
        return hash((self.x.tobytes(), self.y.tobytes()))

    @property
    def height(self) -> float:
        """Height of the layer [m]."""
        return self.y[-1]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of elements."""
        return len(self.y) - 1, self.x.shape[1] - 1

    @property
    def mirrored(self) -> bool:
        """True if the mesh is symmetric about `centre`: each node is the mirror image of another."""
        sums = self.x + self.x[:, ::-1]
        return bool(np.abs(sums - sums[:, 0].mean()).max() <= MIRROR_TOLERANCE * np.ptp(self.x))

    @property
    def centre(self) -> float:
        """Position of the axis of symmetry [m]; 0 for an unsymmetric mesh."""
        return float((self.x[:, 0] + self.x[:, -1]).mean() / 2) if self.mirrored else 0.0

    @property
    def dofs(self) -> int:
        """Number of displacements of quadratic elements on this mesh."""
        rows, columns = self.shape
        return 2 * (2 * rows + 1) * (2 * columns + 1)

    @property
    def points(self) -> Array:
        """Nodes line by line [m], shape (n, 2)."""
        return np.column_stack([self.x.ravel(), np.repeat(self.y, self.x.shape[1])])

    @property
    def quads(self) -> IntArray:
        """Corners of the elements row by row from the base, anticlockwise from the lower left, shape (m, 4)."""
        rows, columns = self.shape
        lower_left = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
        return lower_left[:, None] + np.array([0, 1, columns + 2, columns + 1])

    def elements_at(self, points: Array) -> IntArray:
        """Return the elements of a mesh of straight columns that contain points, shape (n,).

        Parameters
        ----------
        points : ndarray, shape (2, n)
            Coordinates x and y [m]; points outside belong to the nearest column and row.
        """
        (x, y), (rows, columns) = points, self.shape
        column = np.clip(np.searchsorted(self.x[0], x, side="right") - 1, 0, columns - 1)
        return np.clip(np.searchsorted(self.y, y, side="right") - 1, 0, rows - 1) * columns + column

    def refined(self) -> "RowMesh":
        """Return the mesh with every element divided into four."""
        return RowMesh(_with_midpoints(_with_midpoints(self.x.T).T), _with_midpoints(self.y))


def graded_mesh(
    height: float,
    half_width: float,
    elements: float,
    *,
    centre: float = 0.0,
    interfaces: tuple[float, ...] = (),
    edge: float = EDGE_REFINEMENT,
    growth: float = GROWTH,
    reach: float = REACH,
) -> RowMesh:
    """Build a mesh for a contact of a given half-width.

    Elements of size a/n lie inside the contact and shrink towards its edges, where the pressure has a root singularity.
    Above a thin ply of thickness H they are at most 10 H/n, and 2 H/n over `edge` at the edges. They grow geometrically
    outwards over `reach` heights and downwards; inwards by the root of that ratio, for contacts slightly shorter than
    a. Every interface is a line of nodes, with at least two rows between two of them.

    Parameters
    ----------
    height, half_width : float
        Layer height H and half-width a [m], > 0.
    elements : float
        Elements n per half-width [-], > 0.
    centre : float
        Centre of the contact [m].
    interfaces : tuple of float
        Heights of the interfaces of plies [m], ascending, between 0 and H.
    edge : float
        Refinement at the contact edges [-], >= 1.
    growth : float
        Ratio of neighbouring elements outside the contact [-], >= 1.
    reach : float
        Free length beyond the contact over the height [-], > 0.

    Examples
    --------
    >>> mesh = graded_mesh(height=0.22, half_width=0.02, elements=10)
    >>> mesh.shape, mesh.dofs
    ((16, 86), 11418)
    """
    require_positive(height=height, half_width=half_width, elements=elements, reach=reach)
    for name, value in (("edge", edge), ("growth", growth)):
        require_that(1 <= value < np.inf, value, f"`{name}` must be at least 1 and finite, got")
    levels = np.array([0.0, *interfaces, height])
    if np.any(np.diff(levels) <= 0):
        raise ValueError(f"`interfaces` must ascend between 0 and the height, {height!r} m, got {list(interfaces)}")
    top = height - levels[-2]
    inside = min(half_width, INSIDE_PLY_RATIO * top) / elements
    first = min(half_width, EDGE_PLY_RATIO * top) / elements / edge
    inward = geometric(half_width, first, np.sqrt(growth), inside)
    outward = geometric(reach * height, first, growth, MAX_SIZE * height)
    right = np.concatenate([half_width - inward[::-1], [half_width], half_width + outward])
    right[0] = 0.0
    lines, size = [height], first
    for high, low in pairwise(levels[::-1]):
        depth = geometric(high - low, min(size, (high - low) / 2), growth, MAX_SIZE * height)
        lines += (high - depth).tolist()
        lines[-1] = low
        size = growth * (lines[-2] - low)
    return RowMesh(np.tile(centre + np.concatenate([-right[:0:-1], right]), (len(lines), 1)), np.array(lines[::-1]))


def elements_for(error: float) -> int:
    """Return the elements per half-width for a relative error of the resistance [-], > 0."""
    require_positive(error=error)
    elements = np.round(DEFAULT_ELEMENTS * (DEFAULT_ERROR / error) ** (1 / ERROR_ORDER))
    return int(np.clip(elements, MIN_ELEMENTS, MAX_ELEMENTS))


def write_row_mesh(mesh: RowMesh, path: str | Path) -> None:
    """Write a mesh in the format of the suffix of `path`: .vtu, .msh, ..."""
    import meshio

    meshio.Mesh(np.pad(mesh.points, ((0, 0), (0, 1))), [("quad", mesh.quads)]).write(path)


def read_mesh(path: str | Path) -> RowMesh:
    """Read a mesh of any format of meshio, its nodes and elements in any order.

    Raises
    ------
    ValueError
        If the elements are no quadrilaterals, or do not fill straight rows.
    """
    import meshio

    content = meshio.read(path)
    if kinds := {block.type for block in content.cells} - {"vertex", "line", "quad"}:
        raise ValueError(f"{path}: the elements must be quadrilaterals of 4 corners, got {', '.join(sorted(kinds))}")
    used, corners = np.unique(content.cells_dict["quad"], return_inverse=True)
    x, y = content.points[used, :2].T
    upwards = np.argsort(y)
    steps = np.diff(y[upwards], prepend=-np.inf) > HEIGHT_TOLERANCE * np.ptp(y)
    level, heights = (np.cumsum(steps) - 1)[np.argsort(upwards)], y[upwards][steps]
    order = np.lexsort((x, level))  # line by line
    if not np.ptp(np.bincount(level)):
        mesh = RowMesh(x[order].reshape(len(heights), -1), heights)
        found, expected = (np.sort(each, axis=1) for each in (np.argsort(order)[corners.reshape(-1, 4)], mesh.quads))
        if np.array_equal(found[np.lexsort(found.T)], expected[np.lexsort(expected.T)]):
            return mesh
    raise ValueError(f"{path}: the elements must fill straight rows without gap or overlap")


def geometric(length: float, first: float, growth: float, largest: float) -> Array:
    """Return positions of nodes whose distances grow from `first` to `largest`, the last at `length` exactly."""
    count = int(np.ceil(length / first))
    if growth > 1:
        ramp = int(np.ceil(np.log(max(largest / first, 1)) / np.log(growth)))
        count = min(count, ramp + int(np.ceil(length / largest)) + 1)
    sizes = np.minimum(first * growth ** np.arange(count, dtype=float), largest)
    ends = np.cumsum(sizes)
    ends = ends[: np.searchsorted(ends, length * (1 - HEIGHT_TOLERANCE)) + 1]
    return ends * (length / ends[-1])


def _with_midpoints(values: Array) -> Array:
    """Values along the first axis with the means of neighbours between them."""
    both = np.empty((2 * len(values) - 1, *values.shape[1:]))
    both[::2] = values
    both[1::2] = (values[:-1] + values[1:]) / 2
    return both
