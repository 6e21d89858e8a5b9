"""Roller-fixed mesh through which the mix is convected, with its inflow, and the states of a layer by rows.

The mesh is fine and uniform near the roller and grows outwards; the mix moves towards -x. Displacement and material
state are functions of the position in the fed layer. One step of travel, the length of a fine element, is

    value(x, y) <- value(x + step, y)

It is exact in the uniform zone and interpolated elsewhere. Ahead of the roller the inelastic part of the stress is
interpolated, and the elastic part follows from the displacement; the elastic field of the roller is thus not smeared.
Behind it the stress itself is interpolated, since interpolated displacements of irreversibly deformed mix would cause
spurious stresses. The fed mix enters at the front end, and the mix leaves at the rear end with its displacement.

Interpolated density would lose mass. The density ratio at rest therefore follows from the volume,

    k J exp(p/K) = k_in exp(p_in/K),

where J is the volume ratio of the deformation; increments conserve the left side. The densest state is scaled likewise,
but that of mix that was fed loosened, a strength and no volume, is interpolated. A layer that has loosened behind the
roller has that of the uniform zone.
"""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse import csr_matrix

from compact.engines.compaction.finite_strain_solid import STRAIN_FROM_GRADIENT, FiniteStrainSolid, SolidState
from compact.engines.compaction.layer_state import LayerState, fresh_layer, relax_rows
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics import Array
from compact.numerics.assembly import unit_moduli
from compact.rolling_contact import BaseCondition

if TYPE_CHECKING:
    import meshio

GROWTH = 1.2  # [-], ratio of neighbouring elements outside the uniform zone and downwards
LARGEST_ELEMENT = 0.4  # [-], over the layer height
TOP_ROWS = 6  # [-], layer height over the largest thickness of the top row
OUTER_LENGTH = 2.5  # [-], length of the mesh beyond the uniform zone over the layer height
UNIFORM_AHEAD, UNIFORM_BEHIND = 2.0, 1.2  # [-], uniform zone over the contact length sqrt(2 R depth)
EXIT_DISTANCE = 0.3  # [-], distance of the exit column behind the uniform zone over the layer height
UNIFORM_REAR = 1.0  # [-], distance behind the exit column over the layer height from which mix may be made uniform
REPOSE_SLOPE = 0.7  # [-], of laid mix towards the track, tan 35 degrees
LOOSENED = 1e-3  # [-], densest state over the density ratio less 1 of loosened mix; as large as resets of the density
SAME_PLACE = 1e-9  # [-], over a length of the mesh; closer coordinates are equal
SAME_SOURCE = 1e-12  # [-], over x; closer source points are equal


def rolling_mesh(
    height: float, contact_length: float, step: float, lower_height: float = 0.0, stroke: int | None = None
) -> RowMesh:
    """Mesh a layer under a roller at x = 0, uniform near it; elements grow outwards and downwards.

    Parameters
    ----------
    height : float
        Layer height [m].
    contact_length : float
        Estimated contact length [m].
    step : float
        Length of the elements in the uniform zone [m].
    lower_height : float
        Height of the lower lift [m]; the layer lies on it.
    stroke : int, optional
        Length of a stroke from x = 0 in steps, along which the mesh is uniform in both directions.

    Returns
    -------
    RowMesh
    """
    behind = UNIFORM_BEHIND if stroke is None else UNIFORM_AHEAD
    first = -int(np.ceil(behind * contact_length / step))
    last = (stroke or 0) + int(np.ceil(UNIFORM_AHEAD * contact_length / step))
    outward = _growing_distances(OUTER_LENGTH * (height + lower_height), step, height)
    x = np.concatenate([first * step - outward[::-1], np.arange(first, last + 1) * step, last * step + outward])
    depth = _growing_distances(height, min(step, height / TOP_ROWS), height)
    depth *= height / depth[-1]
    y = np.concatenate([height - depth[::-1], [height]])
    y[0] = 0.0
    if lower_height:
        below = _growing_distances(lower_height, min(GROWTH * (y[1] - y[0]), lower_height), lower_height)
        lower = lower_height * (1 - below[::-1] / below[-1])
        y = np.concatenate([lower, lower_height + y])
    return RowMesh(np.tile(x, (len(y), 1)), y)


def _growing_distances(length: float, first: float, height: float) -> Array:
    """Distances with geometrically growing differences up to at least `length`."""
    sizes = [first]
    while sum(sizes) < length:
        sizes.append(min(sizes[-1] * GROWTH, max(LARGEST_ELEMENT * height, first)))
    return np.cumsum(sizes)


class RollerFrame:
    """Mesh under the roller with its inflow and the operators that convect mix through it by one step.

    Parameters
    ----------
    mesh : RowMesh
        Mesh of the fed layer.
    material : Compaction
        Constitutive law.
    base : {"bonded", "slip"}
        Boundary condition at the base.
    contact_length : float
        Estimated contact length [m].
    fed_layer : LayerState, optional
        Layer of an earlier pass with its lower lift; fresh mix by default.
    lower : LayerState, optional
        Lower lift under fresh mix; none by default.
    finite : bool
        True for finite strain, False for small strain.

    Attributes
    ----------
    surface_nodes, surface_x, surface_weights : ndarray, shape (n,)
        Nodes of the surface, their x and integration weights [m].
    row_x, row_y, row_heights : ndarray
        x and height of columns and rows of Gauss points, and heights of the fed mix that the rows represent [m].
    exit_distance, exit_column : float, int
        Distance from the lowest generatrix at which the mix leaves [m], and the column of Gauss points there.
    """

    def __init__(
        self,
        mesh: RowMesh,
        material: Compaction,
        base: BaseCondition,
        contact_length: float,
        *,
        fed_layer: LayerState | None = None,
        lower: LayerState | None = None,
        finite: bool = True,
    ) -> None:
        self.mesh, self.contact_length = mesh, contact_length
        self.step = float(np.diff(mesh.x[-1]).min())
        self.has_frictionless_base = base == "slip"
        self.solid = FiniteStrainSolid(mesh, material, finite=finite)
        self.nodes = self.solid.basis.doflocs.T
        x, y = self.nodes.T
        # fixed by the base and the fed mix ahead, and behind the roller by bonded mix
        near = SAME_PLACE * np.ptp(y)
        bottom, front, rear = y < near, x > x.max() - near, x < x.min() + near
        along = front | ((rear | bottom) & (base == "bonded"))
        self.solid.fixed_dofs = np.unique(np.concatenate([2 * np.flatnonzero(along), 2 * np.flatnonzero(bottom) + 1]))
        self.solid.travel = self.step
        surface = np.flatnonzero(y > mesh.height * (1 - SAME_PLACE))
        self.surface_nodes = surface[np.argsort(x[surface])]
        self.surface_x = x[self.surface_nodes]
        sizes, self.surface_weights = np.diff(mesh.x[-1]) / 6, np.zeros(len(surface))  # by Simpson's rule
        for first, share in ((0, 1), (1, 4), (2, 1)):
            self.surface_weights[first : first + 2 * len(sizes) - 1 : 2] += share * sizes
        # from nodal displacements to those one step upstream, 0 beyond the front
        inside = np.flatnonzero(x + self.step < x.max() + SAME_PLACE * self.step)
        source = np.array([np.minimum(x[inside] + self.step, x.max()), y[inside]])
        upstream = self.interpolation_matrix(source).tocoo()
        self._node_convection = csr_matrix((upstream.data, (inside[upstream.row], upstream.col)), shape=(len(x),) * 2)
        # Gauss points by rows
        rows, columns = mesh.shape
        order = np.lexsort(self.solid.basis.X)
        index = np.arange(rows * columns * 4).reshape(rows, columns, 4)[:, :, order].reshape(rows, columns, 2, 2)
        self._row_layout = index.transpose(0, 2, 1, 3).reshape(2 * rows, 2 * columns)
        coordinates = self.solid.point_coordinates[self._row_layout]
        self.row_x, self.row_y = coordinates[0, :, 0], coordinates[:, 0, 1]
        self.row_heights = np.repeat(np.diff(mesh.y) / 2, 2)
        self.exit_distance = UNIFORM_BEHIND * contact_length + EXIT_DISTANCE * mesh.height
        self.exit_column = int(np.searchsorted(self.row_x, -self.exit_distance))
        self._first_uniform = int(np.searchsorted(self.row_x, -self.exit_distance - UNIFORM_REAR * mesh.height))
        self.inflow = fed_layer
        lower = lower if fed_layer is None else fed_layer.lower
        lower = None if lower is None else lower.stacked
        self.lower_height = 0.0 if lower is None else lower.height
        self.lower_rows = int(np.sum(self.row_y < self.lower_height))
        heights = self.row_heights[self.lower_rows :]
        layer = fresh_layer(material, heights) if fed_layer is None else fed_layer.resampled(heights, material)
        if lower is not None:
            layer = replace(layer, lower=lower.resampled(self.row_heights[: self.lower_rows], material))
        self.fed_layer = layer
        self._fed_points = layer.stacked.points

    def initial_state(self) -> SolidState:
        """Return the state of the fed layer before the roller arrives."""
        columns = self._row_layout.shape[1]
        points = self._fed_points.map(lambda rows: self.to_points(np.repeat(rows[:, None], columns, axis=1)))
        return SolidState(np.zeros_like(self.nodes), points, np.zeros(len(self.solid.point_areas)))

    def convect(self, state: SolidState) -> SolidState:
        """Return the state after all mix has moved by one step towards -x, with the mass of the fed mix."""
        state = self.interpolated(state)
        points, factor = state.points, 1 / (1 + self.mass_residuals(state))
        ratio, densest = points.density_ratio * factor, points.max_density_ratio
        kept = _loosened(points) * _loosened(self.initial_state().points)
        densest = np.maximum(densest * (factor + kept * (1 - factor)), ratio)
        return replace(state, points=replace(points, density_ratio=ratio, max_density_ratio=densest))

    def density_reset(self, state: SolidState) -> float:
        """Return the largest |ln| of density ratios by volume over interpolated ones in one step of a state [-]."""
        return float(np.abs(np.log1p(self.mass_residuals(self.interpolated(state)))).max())

    def interpolated(self, state: SolidState) -> SolidState:
        """Return the state after one step towards -x, with interpolated density ratios."""
        displacement = self.convect_displacement(state.displacement)
        points = state.points.map(self._convect_points, self._fed_points)
        smeared = self._convect_points(self._elastic_stress(state.displacement), 0.0)
        ahead = (self.solid.point_coordinates[:, :1] > 0).astype(float)
        points = replace(points, stress=points.stress + ahead * (self._elastic_stress(displacement) - smeared))
        return SolidState(displacement, points, self._convect_points(state.work, 0.0))

    def mass_residuals(self, state: SolidState) -> Array:
        """Return k J exp(p/K) over that of the fed mix, less 1, at the Gauss points [-], shape (n,)."""
        before, after = (each.points.density_under_load(self.solid.material) for each in (self.initial_state(), state))
        volume = self.solid.volume_ratio(state.displacement)
        if not self.solid.finite:  # whose strains add up
            volume = np.exp(volume - 1)
        return np.asarray(after / before * volume - 1)

    def convect_displacement(self, displacement: Array) -> Array:
        """Return the displacement [m], shape (N, 2), after all mix has moved by one step towards -x."""
        return np.asarray(self._node_convection @ displacement)

    def interpolation_matrix(self, points: Array) -> csr_matrix:
        """Return the matrix from values at the nodes to those at points, shape (n, N).

        Parameters
        ----------
        points : ndarray, shape (2, n)
            Points inside the mesh in the reference configuration [m].
        """
        basis, elements = self.solid.basis, self.mesh.elements_at(points)  # faster than a search on any mesh
        local = basis.mapping.invF(points[:, :, None], tind=elements)[:, :, 0]
        shapes = np.array([basis.elem.lbasis(local, k)[0] for k in range(basis.Nbfun)])
        places = np.tile(np.arange(len(elements)), len(shapes)), basis.element_dofs[:, elements].ravel()
        return csr_matrix((shapes.ravel(), places), shape=(len(elements), basis.N))

    def to_rows(self, values: Array) -> Array:
        """Return values of the Gauss points by rows from the base up, shape (2 rows, 2 columns, ...)."""
        return values[self._row_layout]

    def to_points(self, rows: Array) -> Array:
        """Return values by rows in the order of the Gauss points; the inverse of `to_rows`."""
        values = np.empty((self._row_layout.size, *rows.shape[2:]))
        values[self._row_layout] = rows
        return values

    def with_uniform_rear(self, state: SolidState) -> SolidState:
        """Return the state with the mix far behind the exit column as in one column, without marks of the start.

        Parameters
        ----------
        state : SolidState
            State of the layer.
        """
        column = self._first_uniform

        def uniform(values: Array) -> Array:
            rows = self.to_rows(values)
            rows[:, :column] = rows[:, column : column + 1]
            return self.to_points(rows)

        points = state.points.map(uniform)
        points.stress[self._row_layout[:, :column].ravel()] *= [1.0, 0.0, 1.0, 0.0]  # equilibrium of a uniform layer
        return SolidState(self.with_uniform_rear_nodes(state.displacement), points, uniform(state.work))

    def with_uniform_rear_nodes(self, values: Array) -> Array:
        """Return values of the nodes with those far behind the exit column as in one column, linear in elongated mix.

        Parameters
        ----------
        values : ndarray, shape (N, 2)
            Values at the nodes.
        """
        behind, matrix = self._rear_nodes
        uniform = values.copy()
        uniform[behind] = matrix @ values
        if self.has_frictionless_base:
            along = self.to_rows(self.solid.displacement_gradient(values)[:, 0])[:, self._first_uniform]
            ahead = self.nodes[behind, 0] - self.row_x[self._first_uniform]
            uniform[behind, 0] += self.row_heights @ along / self.mesh.height * ahead
        return uniform

    @cached_property
    def _rear_nodes(self):
        """Nodes behind the column from which mix may be made uniform, and the matrix of its values at their heights."""
        x, y = self.nodes.T
        end = self.row_x[self._first_uniform]
        behind = np.flatnonzero(x < end)
        return behind, self.interpolation_matrix(np.array([np.full(behind.size, end), y[behind]]))

    def exit_density_ratio(self, density_ratio: Array) -> float:
        """Return the mean density ratio over the height of the fed layer at the exit column [-].

        It is the fed mass over the sum of fed mass/k; the lower lift does not count.

        Parameters
        ----------
        density_ratio : ndarray, shape (n,)
            Density ratio of the Gauss points [-].
        """
        mass = self.fed_layer.heights * self.fed_layer.points.density_ratio
        exit_ratios = self.to_rows(density_ratio)[self.lower_rows :, self.exit_column]
        return float(mass.sum() / np.sum(mass / exit_ratios))

    def stored_area(self, displacement: Array) -> float:
        """Return the area of fed mix that is pushed ahead of the exit column [m2].

        Mix at X of the fed layer is at X + u. Per row, u more of it than without a roller is ahead of the column; the
        area is constant in steady motion, in which as much mix leaves as enters.

        Parameters
        ----------
        displacement : ndarray, shape (N, 2)
            Displacement of the nodes [m].
        """
        return float(self._exit_weights @ displacement[:, 0])

    @cached_property
    def _exit_weights(self):
        """Weights of the nodal values in the integral over the height of the exit column [m]."""
        column = np.array([np.full(len(self.row_y), self.row_x[self.exit_column]), self.row_y])
        return self.interpolation_matrix(column).T @ self.row_heights

    def exit_layer(self, state: SolidState, column: int | None = None) -> tuple[LayerState, float]:
        """Return the mix of a column of Gauss points as the layer of the next pass.

        Far behind the roller the layer is uniform along x: horizontal planes have no stress, and a bonded layer has its
        fed length. A layer on a frictionless base keeps its force along x, which is 0.

        Parameters
        ----------
        state : SolidState
            State of the layer.
        column : int, optional
            Index of the column; the exit column by default.

        Returns
        -------
        layer : LayerState
            Layer at rest, with its lower lift.
        length_ratio : float
            Its length over that as fed [-].

        Raises
        ------
        RuntimeError
            If elements of the column invert, or it has no equilibrium at rest.
        """
        column = self.exit_column if column is None else column
        points = state.points.map(lambda values: self.to_rows(values)[:, column])
        uniform = max(column, int(np.searchsorted(self.row_x, -UNIFORM_BEHIND * self.contact_length)))
        change = self.to_rows(state.points.max_density_ratio)[:, uniform] - points.max_density_ratio
        densest = np.maximum(points.max_density_ratio + _loosened(points) * change, points.density_ratio)
        points = replace(points, max_density_ratio=densest)
        along = self.to_rows(self.solid.displacement_gradient(state.displacement)[:, 0])[:, column]
        if along.min() <= -1:
            raise RuntimeError("elements of the exit column invert along the travel; reduce the depth")
        stretch = np.log1p(along)
        area = self.row_heights * self.to_rows(self.solid.volume_ratio(state.displacement))[:, column]
        mean = area @ stretch / area.sum() if self.has_frictionless_base else 0.0
        rest, volume = relax_rows(self.solid, points, mean - stretch)
        return LayerState(area * volume * np.exp(-mean), rest).split(self.lower_rows), float(np.exp(mean))

    def field_mesh(self, state: SolidState, direction: float = 1.0) -> "meshio.Mesh":
        """Return the fields inside the layer on 8-node quadrilaterals of the fed layer.

        Parameters
        ----------
        state : SolidState
            State of the layer.
        direction : float
            1, or -1 for a mesh mirrored about x = 0.

        Returns
        -------
        meshio.Mesh
            Point data: displacement [m], 3 components. Cell data, means of the elements: stress (xx, yy, zz, xy, yz,
            xz) [Pa], tension positive; mean pressure [Pa], compression positive; saturation_pressure [Pa], the reaction
            that keeps the density ratio at its limit, not a pressure of water, and remains after unloading;
            density_ratio at rest and density_under_load, k exp(p/K) [-]; plastic_work [J/m3].
        """
        import meshio

        mirror, points, count = np.array([direction, 1.0]), state.points, self.solid.basis.nelems
        fields = {
            "stress": np.pad(points.stress * [1, 1, 1, direction], ((0, 0), (0, 2))),
            "pressure": points.pressure,
            "saturation_pressure": self.solid.material.saturation_pressure(points.max_density_ratio),
            "density_ratio": points.density_ratio,
            "density_under_load": points.density_under_load(self.solid.material),
            "plastic_work": points.plastic_work,
        }
        means = {name: [each.reshape(count, -1, *each.shape[1:]).mean(axis=1)] for name, each in fields.items()}
        nodes, displacement = (np.pad(each * mirror, ((0, 0), (0, 1))) for each in (self.nodes, state.displacement))
        cells = [("quad8", self.solid.basis.element_dofs.T)]
        return meshio.Mesh(nodes, cells, {"displacement": displacement}, means)

    def _convect_points(self, values, fed):
        """Values of the Gauss points one step upstream, linear between points, `fed` beyond the front."""
        rows = self.to_rows(values)
        fed = np.broadcast_to(fed, (len(rows), *rows.shape[2:]))
        padded = np.concatenate([rows, fed[:, None]], axis=1)
        k, share = self._upstream_points
        share = share.reshape((1, -1) + (1,) * (rows.ndim - 2))
        return self.to_points((1 - share) * padded[:, k] + share * padded[:, k + 1])

    @cached_property
    def _upstream_points(self):
        """Index of the point before the upstream position of each point of a row, and the share of the one after."""
        x = np.append(self.row_x, self.row_x[-1] + 2 * self.step)
        source = np.minimum(self.row_x + self.step, x[-1])
        k = np.clip(np.searchsorted(x, source * (1 - SAME_SOURCE)) - 1, 0, len(x) - 2)
        share = np.clip((source - x[k]) / (x[k + 1] - x[k]), 0.0, 1.0)
        whole = np.abs(share - np.round(share)) < SAME_PLACE
        share[whole] = np.round(share[whole])
        return k, share

    def _elastic_stress(self, displacement):
        """Linear elastic stress (xx, yy, zz, xy) of a displacement [Pa], shape (n, 4)."""
        exx, eyy, gamma = (self.solid.displacement_gradient(displacement) @ STRAIN_FROM_GRADIENT.T).T
        material = self.solid.material
        two_shear, _, shear, lame = material.unloading_modulus * unit_moduli(material.poisson)
        volumetric = lame * (exx + eyy)
        return np.array([two_shear * exx + volumetric, two_shear * eyy + volumetric, volumetric, shear * gamma]).T


def _loosened(points):
    """Share of the strength that no longer follows the density ratio: 0 of mix in its densest state, 1 of loose mix."""
    return np.clip((points.max_density_ratio / points.density_ratio - 1) / LOOSENED, 0.0, 1.0)


def laid_state(state: SolidState, frame: RollerFrame, edge: float, side: float) -> SolidState:
    """Lay mix in the fed state, up to the fed height, where the surface beyond an edge is lower.

    Parameters
    ----------
    state : SolidState
        State of a layer with a track.
    frame : RollerFrame
        Its frame.
    edge : float
        x of the edge [m], up to which the mix has the fed height; from there it slopes to the track.
    side : float
        Sign of x in which the laid mix lies from the edge [-].

    Returns
    -------
    SolidState
        State with stress-free mix beyond the edge, a mean of both on the slope, and the track as it was.
    """
    along, settlement = state.displacement[frame.surface_nodes].T * [[1.0], [-1.0]]
    distance = side * (edge - frame.surface_x - along)  # from the edge towards the roller
    share = np.where(settlement > 0, np.clip(distance * REPOSE_SLOPE / settlement.max(), 0.0, 1.0), 1.0)
    remains = np.interp(frame.solid.point_coordinates[:, 0], frame.surface_x, share)

    def laid(old: Array, new: Array) -> Array:
        return new + remains.reshape(-1, *(1,) * (old.ndim - 1)) * (old - new)

    fed = frame.initial_state()
    # the track has moved along x, and the laid mix with it: elements between them would be stretched otherwise
    displacement = state.displacement.copy()
    displacement[:, 1] *= np.interp(frame.nodes[:, 0], frame.surface_x, share)
    return SolidState(displacement, state.points.map(laid, fed.points), laid(state.work, fed.work))


def transfer_state(state: SolidState, old: RollerFrame, new: RollerFrame, shift: float = 0.0) -> SolidState:
    """Interpolate a state from the mesh of one frame to that of another, linearly between Gauss points.

    Parameters
    ----------
    state : SolidState
        State on the old mesh.
    old, new : RollerFrame
        Frames of the same fed layer and lower lift.
    shift : float
        x on the new mesh of x = 0 on the old one [m].

    Returns
    -------
    SolidState
        State on the new mesh; undisplaced beyond the front end of the old one.
    """
    x, y = new.nodes.T - [[shift], [0.0]]
    low, high = old.mesh.x[0, [0, -1]]
    displacement = old.interpolation_matrix(np.array([np.clip(x, low, high), y])) @ state.displacement
    displacement[x > high] = 0.0
    fixed = new.solid.fixed_dofs
    displacement.ravel()[fixed[fixed % 2 == 1]] = 0.0
    position = new.solid.point_coordinates - [shift, 0.0]
    is_lower = position[:, 1] < new.lower_height

    def interpolate(values: NDArray[np.float64]) -> NDArray[np.float64]:
        rows, found = old.to_rows(values), np.empty((len(position), *values.shape[1:]))
        for part, inside in ((slice(old.lower_rows, None), ~is_lower), (slice(old.lower_rows), is_lower)):
            if inside.any():  # each lift from its own rows, since the density jumps in between
                y = old.row_y[part]
                clipped = np.clip(position[inside], [old.row_x[0], y[0]], [old.row_x[-1], y[-1]])
                found[inside] = RegularGridInterpolator((y, old.row_x), rows[part])(clipped[:, ::-1])
        return found

    return SolidState(displacement, state.points.map(interpolate), interpolate(state.work))
