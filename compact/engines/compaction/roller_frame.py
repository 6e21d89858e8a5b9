"""The layer as the roller sees it: a mesh that stands still under the roller while the mix streams through it.

The mesh is fine and uniform near the roller and grows outwards; the mix moves towards -x. Displacements and states are
functions of the place on the fed layer, so that one step of travel, the length of a fine element, is

    value(x, y) <- value(x + step, y)

exact where elements are uniform, interpolated elsewhere. In front of the roller what is interpolated is the stress
without its elastic part, which follows from the displacement, so that the roller's reach is not smeared; behind it the
displacement of rough mix would make stress of its own, and the stress itself is carried. Beyond the front enters the
fed mix, and at the rear end the mix leaves with the displacement it has.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse import csr_matrix

from compact.engines.compaction.finite_strain_solid import STATE, SUBSTEPS, TO_STRAIN, Condition, Solid
from compact.material import cap_plasticity
from compact.mesh import RowMesh
from compact.numerics.assembly import unit_moduli

GROWTH = 1.2  # ratio of neighbouring elements outside the uniform zone and downwards
COARSEST = 0.4  # of the layer height
ROWS = 6  # the top one is no higher than this part of the layer
REACH = 2.5  # layer heights beyond the uniform zone
AHEAD, BEHIND = 2.0, 1.2  # uniform zone over the length sqrt(2 R depth)
EXIT = 0.3  # layer heights behind the uniform zone, where the mix is read that leaves


def rolling_mesh(height, length, step):
    """The `RowMesh` of a layer under a roller at x = 0 whose contact is about `length` long, uniform near it."""
    return _uniform_between(height, -int(np.ceil(BEHIND * length / step)), int(np.ceil(AHEAD * length / step)), step)


def stroke_mesh(height, length, step, count):
    """The same for a roller that travels from x = 0 by `count` steps and back, uniform all along its way."""
    ahead = int(np.ceil(AHEAD * length / step))
    return _uniform_between(height, -ahead, count + ahead, step)


def _uniform_between(height, first, last, step):
    """The `RowMesh` of elements as long as a step from `first` to `last` of them, growing outwards and downwards."""
    outward = _growing(REACH * height, step, height)
    x = np.concatenate([first * step - outward[::-1], np.arange(first, last + 1) * step, last * step + outward])
    depth = _growing(height, min(step, height / ROWS), height, exact=True)
    y = np.concatenate([height - depth[::-1], [height]])
    y[0] = 0.0
    return RowMesh(np.tile(x, (len(y), 1)), y)


def _growing(length, first, height, exact=False):
    """Distances that grow from `first` until `length` is passed; stretched to end there if `exact`."""
    sizes = [first]
    while sum(sizes) < length:
        sizes.append(min(sizes[-1] * GROWTH, max(COARSEST * height, first)))
    distances = np.cumsum(sizes)
    return distances * (length / distances[-1]) if exact else distances


@dataclass(frozen=True, eq=False)
class LayerState:
    """The mix in front of the roller, at rest and the same all along x, by rows from the base up.

    heights : of the rows [m], shape (n,);  state : their means, a `MaterialPoint` without stress on horizontal planes

    A layer at rest under a free surface bears no shear on horizontal planes (d s_xy/dy = 0), and the cap remembers no
    direction: rolled over one way or the other the mix is the same.
    """

    heights: np.ndarray
    state: cap_plasticity.MaterialPoint

    @property
    def height(self):
        """Of the layer [m]."""
        return float(self.heights.sum())

    @property
    def y(self):
        """Heights of the middles of the rows above the base [m]."""
        return np.cumsum(self.heights) - self.heights / 2

    @property
    def density_ratio(self):
        """Mean over the height."""
        return float(self.heights @ self.state.density_ratio / self.height)

    def solid(self, law):
        """Height that grains and water fill [m]: what rests under pressure is denser than its k by the elastic part."""
        bulk = law.unloading_modulus / (3 - 6 * law.poisson)
        squeezed = np.exp(-self.state.stress[:, :3].mean(axis=1) / bulk)
        return float(self.heights @ (self.state.density_ratio * squeezed))

    def under(self, lift, law):
        """The layer with a lift [m] of fresh mix spread on it."""
        above = cap_plasticity.initial_state(law, 1)
        both = (np.concatenate([getattr(self.state, name), getattr(above, name)]) for name in STATE)
        return LayerState(np.append(self.heights, lift), cap_plasticity.MaterialPoint(*both))

    def on_rows(self, heights):
        """The same layer by rows of other heights; what each holds is kept in sum."""
        stress, k, hardened, work = (_means(getattr(self.state, name), self.heights, heights) for name in STATE)
        return LayerState(
            heights, cap_plasticity.MaterialPoint(stress, k, np.maximum(hardened, k), work)
        )  # what pc remembers is k at least


def fresh(law, heights):
    """Mix as it is fed, a `LayerState` of rows of some heights [m]."""
    return LayerState(heights, cap_plasticity.initial_state(law, len(heights)))


def _means(values, old, new):
    """Means over rows of new heights of values that are linear within the old rows, which keep their means.

    A slope is the smaller one towards the two neighbours, none at an extreme or an end: nothing overshoots where fresh
    mix lies on old.
    """
    shape = (-1,) + (1,) * (values.ndim - 1)
    edges = np.concatenate([[0.0], np.cumsum(old)])
    slopes = np.diff(values, axis=0) / np.diff((edges[1:] + edges[:-1]) / 2).reshape(shape)
    down, up = slopes[:-1], slopes[1:]
    slope = np.zeros_like(values)
    slope[1:-1] = np.where(down * up > 0, np.sign(up) * np.minimum(abs(down), abs(up)), 0.0)
    below = np.concatenate([0 * values[:1], np.cumsum(values * old.reshape(shape), axis=0)])

    ends = np.concatenate([[0.0], np.cumsum(new)]) * (edges[-1] / np.sum(new))
    row = np.clip(np.searchsorted(edges, ends, side="right") - 1, 0, len(old) - 1)
    into = (ends - edges[row]).reshape(shape)
    sums = below[row] + values[row] * into + slope[row] * into * (into - old[row].reshape(shape)) / 2
    return np.diff(sums, axis=0) / np.diff(ends).reshape(shape)


class Frame:
    """The mesh under the roller with what feeds it, and the operators that carry mix through it by one step."""

    def __init__(self, mesh, law, base, length, *, fed=None, finite=True, rate_factor=1.0, substeps=SUBSTEPS):
        self.mesh, self.length, self.step = mesh, length, _finest(mesh)
        plain = Solid(mesh, law)
        nodes = plain.basis.doflocs.T
        x, y = nodes.T
        self.slips = base == "slip"
        self.held = _held(x, y, base)
        self.solid = Solid(mesh, law, held=self.held, finite=finite, rate_factor=rate_factor, substeps=substeps)
        self.nodes = nodes
        surface = np.flatnonzero(y > mesh.height * (1 - 1e-9))
        self.surface = surface[np.argsort(x[surface])]
        self._carry_nodes = self._node_operator()
        self._rows_to_points, self.row_x, self.row_y = self._rows()
        self.given = fed
        self.fed = fresh(law, self.row_heights) if fed is None else fed.on_rows(self.row_heights)

    @property
    def weights(self):
        """Of the surface nodes, Simpson's rule on the reference [m]."""
        sizes = np.diff(self.mesh.x[-1])
        weights = np.zeros(len(self.surface))
        for place, share in ((0, 1), (1, 4), (2, 1)):
            weights[place : place + 2 * len(sizes) - 1 : 2] += share * sizes / 6
        return weights

    def at_rest(self):
        """The `Condition` of the fed mix before the roller comes."""
        state = cap_plasticity.MaterialPoint(*(self._spread(getattr(self.fed.state, name)) for name in STATE))
        return Condition(np.zeros_like(self.nodes), state, np.zeros(len(self.solid.area)))

    def carried(self, condition):
        """The `Condition` when all mix has moved one step towards -x."""
        displacement = self._carry_nodes @ condition.displacement
        fed = self.fed.state
        stress = self._carried_points(condition.state.stress, fed.stress)
        smeared = self._carried_points(self._elastic_stress(condition.displacement), 0.0)
        stress += self._ahead * (self._elastic_stress(displacement) - smeared)
        numbers = (self._carried_points(getattr(condition.state, name), getattr(fed, name)) for name in STATE[1:])
        return Condition(
            displacement, cap_plasticity.MaterialPoint(stress, *numbers), self._carried_points(condition.work, 0.0)
        )

    def from_upstream(self, nodes):
        """Displacements with which the mix comes to some nodes, by those of all nodes, shape (n, N)."""
        return self._carry_nodes[nodes]

    def rows(self, values):
        """Values of the points by rows from the base up, each along x: shape (2 rows, 2 columns, ...)."""
        return values[self._rows_to_points]

    def points(self, rows):
        """What `rows` took apart, back in the order of the points."""
        values = np.empty((self._rows_to_points.size, *rows.shape[2:]))
        values[self._rows_to_points] = rows
        return values

    def passed(self, displacement):
        """The displacement with that of the held rear end as in steady motion, when what leaves keeps its own."""
        rear, weights = self._rear
        passed = displacement.copy()
        passed[rear, 0] = weights @ displacement[:, 0]
        return passed

    def flat_behind(self, displacement):
        """The displacement, behind the uniform zone that at its end: a march makes rough waves there."""
        x, y = self.nodes.T
        behind = np.flatnonzero(x < -BEHIND * self.length)
        place = np.array([np.full(behind.size, -BEHIND * self.length), y[behind]])
        flat = displacement.copy()
        flat[behind] = self.solid.basis.probes(place) @ displacement
        return flat

    @cached_property
    def _rear(self):
        """Nodes at the rear end that are held along x, and their displacement by that of all nodes."""
        x = self.nodes[:, 0]
        held = np.isin(2 * np.arange(len(x)), self.held) & (x < x.min() + 1e-9 * self.mesh.height)
        rear = np.flatnonzero(held)
        carry = self._carry_nodes[rear].toarray()
        among = np.eye(rear.size) - carry[:, rear]
        carry[:, rear] = 0.0
        return rear, np.linalg.solve(among, carry)

    @property
    def exit(self):
        """Index of the column of points that is read as it leaves."""
        return int(np.searchsorted(self.row_x, -self.way_out))

    @property
    def way_out(self):
        """From the lowest generatrix to where the mix is read that leaves [m]."""
        return BEHIND * self.length + EXIT * self.mesh.height

    @property
    def row_heights(self):
        """Heights of the fed layer that the rows of points stand for [m]."""
        return np.repeat(np.diff(self.mesh.y) / 2, 2)

    def exit_mean(self, density_ratio):
        """Mean over the height that it leaves with of the density ratio of the mix: fed mass over fed mass/k."""
        mass = self.row_heights * self.fed.state.density_ratio
        return float(mass.sum() / np.sum(mass / self.rows(density_ratio)[:, self.exit]))

    def _spread(self, profile):
        """Values of the points, the same all along each row."""
        values = np.empty((self._rows_to_points.size, *profile.shape[1:]))
        values[self._rows_to_points] = profile[:, None]
        return values

    def _carried_points(self, values, fed):
        rows = self.rows(values)
        fed = np.broadcast_to(fed, (len(rows), *rows.shape[2:]))
        padded = np.concatenate([rows, fed[:, None]], axis=1)
        k, share = self._upstream
        share = share.reshape((1, -1) + (1,) * (rows.ndim - 2))
        carried = np.empty_like(values)
        carried[self._rows_to_points] = (1 - share) * padded[:, k] + share * padded[:, k + 1]
        return carried

    @property
    def _ahead(self):
        return (self.solid.points[:, :1] > 0).astype(float)

    @property
    def _upstream(self):
        """Where the mix of each point of a row comes from: index of the point before, share of the one after."""
        x = np.append(self.row_x, self.row_x[-1] + 2 * self.step)
        source = np.minimum(self.row_x + self.step, x[-1])
        k = np.clip(np.searchsorted(x, source * (1 - 1e-12)) - 1, 0, len(x) - 2)
        share = np.clip((source - x[k]) / (x[k + 1] - x[k]), 0.0, 1.0)
        share[np.abs(share - np.round(share)) < 1e-9] = np.round(share[np.abs(share - np.round(share)) < 1e-9])
        return k, share

    def _elastic_stress(self, displacement):
        """Linear elastic stress (xx, yy, zz, xy) of a displacement, shape (n, 4)."""
        exx, eyy, gamma = (self.solid.gradient(displacement) @ TO_STRAIN.T).T
        law = self.solid.law
        two_shear, _, shear, lame = law.unloading_modulus * unit_moduli(law.poisson)
        area = lame * (exx + eyy)
        return np.array([two_shear * exx + area, two_shear * eyy + area, area, shear * gamma]).T

    def _rows(self):
        rows, columns = self.mesh.shape
        basis = self.solid.basis
        order = np.lexsort(basis.X)
        index = np.arange(rows * columns * 4).reshape(rows, columns, 4)[:, :, order].reshape(rows, columns, 2, 2)
        index = index.transpose(0, 2, 1, 3).reshape(2 * rows, 2 * columns)
        points = self.solid.points[index]
        return index, points[0, :, 0], points[:, 0, 1]

    def _node_operator(self):
        """Displacements of the nodes from those one step upstream, zero beyond the front."""
        x, y = self.nodes.T
        inside = np.flatnonzero(x + self.step < x.max() + 1e-9 * self.step)
        source = np.array([np.minimum(x[inside] + self.step, x.max()), y[inside]])
        probes = self.solid.basis.probes(source).tocoo()
        return csr_matrix((probes.data, (inside[probes.row], probes.col)), shape=(len(x),) * 2)


def transferred(condition, old, new):
    """The `Condition` of one `Frame` on the mesh of another, linear between points."""
    x, y = new.nodes.T
    low, high = old.mesh.x[0, [0, -1]]
    displacement = old.solid.basis.probes(np.array([np.clip(x, low, high), y])) @ condition.displacement
    displacement[x > high] = 0.0
    displacement.ravel()[new.held[new.held % 2 == 1]] = 0.0

    def at(values):
        rows = RegularGridInterpolator((old.row_y, old.row_x), old.rows(values))
        place = np.clip(new.solid.points, [old.row_x[0], old.row_y[0]], [old.row_x[-1], old.row_y[-1]])
        return rows(place[:, ::-1])

    state = cap_plasticity.MaterialPoint(*(at(getattr(condition.state, name)) for name in STATE))
    return Condition(displacement, state, at(condition.work))


def _held(x, y, base):
    """Unknowns held by the base, by the fed mix in front, and behind by the bonded mix; a slipping layer ends there."""
    near = 1e-9 * np.ptp(y)
    bottom, front, rear = y < near, x > x.max() - near, x < x.min() + near
    along = front | ((rear | bottom) & (base == "bonded"))
    return np.concatenate([2 * np.flatnonzero(along), 2 * np.flatnonzero(bottom) + 1])


def _finest(mesh):
    return float(np.diff(mesh.x[-1]).min())
