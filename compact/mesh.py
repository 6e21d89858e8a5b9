"""Layers meshed in straight rows of quadrilaterals, fine under the contact and growing outwards and downwards.

Every row lies between two heights, so that material flowing along x stays in its row and the Gauss points of a row
share their heights: one streamline each. x along the travel, y up, base at y = 0. All lengths in m.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from compact.numerics.validation import require_positive

DEFAULT_ERROR = 2e-3  # of the resistance, on ten elements per half-width: a point of studies/speed_against_error.py
GROWTH = 1.4  # ratio of neighbouring elements, its root inside the contact: 3e-5 of the load, 6e-6 once refined
EDGE_REFINEMENT = (
    4  # times smaller at the edges: resistance in the limits of slow and fast within 0.2 %, without it 1 %
)
REACH = 20.0  # layer heights beyond the contact; 14 leave 3e-5 in the load where v tau is 500 heights
COARSEST = 2.0  # layer heights: so far out that even half of it changes nothing
SAME_PLACE = 1e-13  # of the length: nodes closer than this to the mirror image of others mirror them
SAME_ROW = 1e-9  # of the height: corners closer than this share a height


@dataclass(frozen=True, eq=False)
class RowMesh:
    """Quadrilaterals in straight rows, a value: two meshes of the same nodes are equal.

    x : of the nodes, one line per height from the base up, shape (rows + 1, columns + 1), increasing along each line
    y : heights of the lines, shape (rows + 1,), from 0 to the height of the layer
    """

    x: np.ndarray
    y: np.ndarray

    def __post_init__(self):
        for name in ("x", "y"):
            array = np.array(getattr(self, name), dtype=float)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        _refuse_unless_rows(self.x, self.y)

    def __eq__(self, other):
        if not isinstance(other, RowMesh):
            return NotImplemented
        return np.array_equal(self.x, other.x) and np.array_equal(self.y, other.y)

    def __hash__(self):
        return hash((self.x.tobytes(), self.y.tobytes()))

    @property
    def height(self):
        """Height of the layer [m]."""
        return self.y[-1]

    @property
    def shape(self):
        """Rows and columns of elements."""
        return len(self.y) - 1, self.x.shape[1] - 1

    @property
    def mirrored(self):
        """Whether the left half mirrors the right one about `centre`."""
        x = self.x - self.centre
        return bool(np.abs(x + x[:, ::-1]).max() <= SAME_PLACE * np.ptp(self.x))

    @property
    def centre(self):
        """x about which the halves mirror each other [m], 0 where they do not."""
        middle = (self.x[:, 0] + self.x[:, -1]).mean() / 2
        uneven = self.x + self.x[:, ::-1] - 2 * middle
        return float(middle) if np.abs(uneven).max() <= SAME_PLACE * np.ptp(self.x) else 0.0

    @property
    def dofs(self):
        """Displacements of quadratic elements on this mesh."""
        rows, columns = self.shape
        return 2 * (2 * rows + 1) * (2 * columns + 1)

    @property
    def mesh_size(self):
        """Longest edge [m]."""
        return max(np.diff(self.x, axis=1).max(), np.hypot(np.diff(self.x, axis=0), np.diff(self.y)[:, None]).max())

    @property
    def points(self):
        """Nodes line by line, shape (n, 2)."""
        return np.column_stack([self.x.ravel(), np.repeat(self.y, self.x.shape[1])])

    @property
    def quads(self):
        """Corners of the elements row by row from the base, anticlockwise from the lower left, shape (m, 4)."""
        rows, columns = self.shape
        lower_left = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
        return lower_left[:, None] + np.array([0, 1, columns + 2, columns + 1])

    def refined(self):
        """The mesh with every element cut in four."""
        return RowMesh(_with_middles(_with_middles(self.x.T).T), _with_middles(self.y))


def graded_mesh(
    height, half_width, elements, *, centre=0.0, interfaces=(), edge=EDGE_REFINEMENT, growth=GROWTH, reach=REACH
):
    """A layer meshed for a contact of about a given half-width around x = centre, a `RowMesh`.

    Elements of a/n lie inside the contact and shrink towards its edges, where pressure rises like a root; over a thin
    ply, H thick, they are 10 H/n at most, and 2 H/n over `edge` at the edges. From there they grow geometrically:
    outwards over `reach` heights, and down, where stress varies over the depth; inwards by the root of that ratio, for
    contacts that end a little short of a. Every interface is a line of nodes, with two rows at least between two of
    them.

    Parameters
    ----------
    height, half_width : H, a [m], > 0
    elements : n per half-width, > 0
    centre : of the contact [m]
    interfaces : heights of the interfaces of plies [m], ascending, between 0 and H
    edge : elements at the edges are so many times smaller, >= 1
    growth : ratio of neighbouring elements outside the contact, >= 1
    reach : free length beyond the contact over the height, > 0

    >>> mesh = graded_mesh(height=0.22, half_width=0.02, elements=10)
    >>> mesh.shape, mesh.dofs
    ((16, 86), 11418)
    """
    require_positive(height=height, half_width=half_width, elements=elements, reach=reach)
    for name, value in (("edge", edge), ("growth", growth)):
        if not 1 <= value < np.inf:
            raise ValueError(f"`{name}` must be at least 1 and finite, got {value!r}")
    levels = np.array([0.0, *interfaces, height])
    if np.any(np.diff(levels) <= 0):
        raise ValueError(f"`interfaces` must ascend between 0 and the height, {height!r} m, got {list(interfaces)}")
    top = height - levels[-2]
    inside = min(half_width, 10 * top) / elements
    first = min(half_width, 2 * top) / elements / edge
    inward = _growing(half_width, first, np.sqrt(growth), inside)
    outward = _growing(reach * height, first, growth, COARSEST * height)
    right = np.concatenate([half_width - inward[::-1], [half_width], half_width + outward])
    right[0] = 0.0
    y = _heights(levels, first, growth)
    return RowMesh(np.tile(centre + np.concatenate([-right[:0:-1], right]), (len(y), 1)), y)


def mesh_for_error(height, half_width, error, interfaces=()):
    """The graded `RowMesh` that holds load and resistance within a relative `error` of the exact ones [-], > 0.

    The error of the resistance falls as n^-1.5 and passes 0.2 % at n = 10 per half-width; the load is better.
    """
    return graded_mesh(height, half_width, elements_for(error), interfaces=interfaces)


def elements_for(error):
    """Elements per half-width of the mesh of `for_error`."""
    require_positive(error=error)
    return int(np.clip(np.round(10 * (DEFAULT_ERROR / error) ** (1 / 1.5)), 4, 80))


def row_mesh(points, quads):
    """A `RowMesh` from any quadrilaterals, if their rows are straight; ValueError with the reason otherwise.

    Parameters
    ----------
    points : of the nodes [m], shape (n, 2) or (n, 3), z ignored
    quads : corners of the elements, indices, shape (m, 4); order and numbering are free
    """
    points, quads = np.asarray(points, dtype=float), np.asarray(quads, dtype=int)
    if quads.ndim != 2 or quads.shape[1] != 4 or len(quads) == 0:
        raise ValueError(f"`quads` must be quadrilaterals of 4 corners, got shape {quads.shape}")
    used, corners = np.unique(quads, return_inverse=True)
    x, y = points[used, :2].T
    level, heights = _levels(y)
    corners = corners.reshape(quads.shape)
    _refuse_crooked(level[corners], y[corners])
    lines = [np.flatnonzero(level == k) for k in range(len(heights))]
    lines = [line[np.argsort(x[line])] for line in lines]
    if len({len(line) for line in lines}) > 1:
        counts = ", ".join(str(len(line)) for line in lines)
        raise ValueError(f"every line of nodes must hold as many nodes, got {counts} from the base up")
    mesh = RowMesh(x[np.array(lines)], heights)
    _refuse_unless_neighbours(corners, np.concatenate(lines), mesh)
    return mesh


def write_row_mesh(mesh, path):
    """Write the mesh in the format that the suffix of `path` names: .vtu, .msh, ... ."""
    _meshio().Mesh(np.pad(mesh.points, ((0, 0), (0, 1))), [("quad", mesh.quads)]).write(path)


def read_mesh(path):
    """The `RowMesh` in a file of any format that meshio reads; ValueError if it is not in straight rows."""
    content = _meshio().read(path)
    kinds = {block.type for block in content.cells} - {"vertex", "line"}
    if kinds != {"quad"}:
        raise ValueError(f"{path}: a layer is meshed by 4-cornered quadrilaterals, got {', '.join(sorted(kinds))}")
    return row_mesh(content.points, content.cells_dict["quad"])


def _meshio():
    import meshio

    return meshio


def _heights(levels, first, growth):
    """Heights of lines that lie farther apart the deeper they are, every level among them."""
    lines, size = [levels[-1]], first
    for high, low in pairwise(levels[::-1]):
        depth = _growing(high - low, min(size, (high - low) / 2), growth, COARSEST * levels[-1])
        lines += (high - depth).tolist()
        lines[-1] = low
        size = growth * (lines[-2] - low)
    return np.array(lines[::-1])


def _growing(length, first, growth, largest):
    """Distances of nodes that grow from `first` to `largest` and end at `length` exactly."""
    count = int(np.ceil(length / first))
    if growth > 1:
        ramp = int(np.ceil(np.log(max(largest / first, 1)) / np.log(growth)))
        count = min(count, ramp + int(np.ceil(length / largest)) + 1)
    sizes = np.minimum(first * growth ** np.arange(count, dtype=float), largest)
    ends = np.cumsum(sizes)
    ends = ends[: np.searchsorted(ends, length * (1 - SAME_ROW)) + 1]
    return ends * (length / ends[-1])


def _with_middles(values):
    """Along the first axis, the values and the means of neighbours between them."""
    both = np.empty((2 * len(values) - 1, *values.shape[1:]))
    both[::2] = values
    both[1::2] = (values[:-1] + values[1:]) / 2
    return both


def _levels(y):
    """For each node the number of its height from below, and the heights."""
    order = np.argsort(y)
    steps = np.diff(y[order]) > SAME_ROW * np.ptp(y)
    level = np.empty(len(y), dtype=int)
    level[order] = np.concatenate([[0], np.cumsum(steps)])
    return level, y[order][np.concatenate([[True], steps])]


def _refuse_crooked(level, y):
    """Each element must stand between two neighbouring heights, two corners on each."""
    ordered = np.sort(level, axis=1)
    lower, upper = ordered[:, 0], ordered[:, 3]
    crooked = (ordered[:, 1] != lower) | (ordered[:, 2] != upper) | (upper != lower + 1)
    if crooked.any():
        k = int(np.argmax(crooked))
        raise ValueError(
            f"rows must be straight: the corners of element {k} lie at the heights {np.sort(y[k]).tolist()}, "
            f"not two by two on neighbouring lines"
        )


def _refuse_unless_neighbours(corners, numbering, mesh):
    """The elements must be exactly those between neighbouring nodes of neighbouring lines."""
    place = np.empty(len(numbering), dtype=int)
    place[numbering] = np.arange(len(numbering))
    found = {tuple(sorted(quad)) for quad in place[corners].tolist()}
    expected = {tuple(sorted(quad)) for quad in mesh.quads.tolist()}
    if found != expected or len(corners) != len(expected):
        raise ValueError(
            f"elements must fill every row without gap or overlap: {len(expected)} expected between neighbouring "
            f"nodes, {len(corners)} got, {len(found & expected)} of them in place"
        )


def _refuse_unless_rows(x, y):
    if y.ndim != 1 or x.ndim != 2 or len(x) != len(y) or min(x.shape) < 2:
        raise ValueError(f"`x` must have one line of at least two nodes for each of `y`, got {x.shape} and {y.shape}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("`x` and `y` must be finite")
    if abs(y[0]) > SAME_ROW * abs(y[-1] - y[0]):
        raise ValueError(f"the base must lie at `y` = 0, got {y[0].item()!r}")
    if np.any(np.diff(y) <= 0):
        raise ValueError("`y` must increase from the base up")
    if np.any(np.diff(x, axis=1) <= 0):
        row = int(np.argmax((np.diff(x, axis=1) <= 0).any(axis=1)))
        raise ValueError(f"`x` must increase along every line, line {row} does not")
