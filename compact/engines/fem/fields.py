"""Fields inside a linear layer under given forces on its surface: displacement, stress, dissipation.

The stress is that of the elastic layer of relaxed modulus under the same forces, with its strain e. Branch k of the
creep function dissipates, per length rolled and unit volume,

    W' = E sum_k J_k (e - z_k) : c : (e - z_k)/l_k,    l_k = |v| theta_k,

where z_k is the retarded strain. Retardation of the elastic displacement along each line of nodes gives that of the
viscoelastic layer.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from skfem import Basis

from compact.engines.fem.compliance import LayerStiffness, element_moduli, layer_stiffness
from compact.engines.fem.convected_memory import creep_function, retardation_operator, retarded_along_rows
from compact.material.laws import Elastic
from compact.mesh import RowMesh
from compact.numerics import Array
from compact.numerics.assembly import element_unknowns, strain_matrix
from compact.rolling_contact import Layer

if TYPE_CHECKING:
    import meshio

GAUSS_WEIGHTS = np.array([5, 8, 5]) / 18  # [-], of the three streamlines in a row of elements


@dataclass(frozen=True, eq=False)
class LoadedLayer:
    """Layer on a mesh under forces on its surface.

    Parameters
    ----------
    forces : ndarray
        Forces on the surface nodes over the relaxed modulus [m], shape (2, n).
    speed : float
        Speed of the roller along x [m/s]; its sign selects the end at which a slipping layer is held.
    """

    mesh: RowMesh
    layer: Layer
    material: Elastic
    forces: Array
    speed: float = 1.0

    @property
    def stiffness(self) -> LayerStiffness:
        """Factorised stiffness, shared by all layers of the same mesh."""
        return layer_stiffness(self.mesh, self.material.poisson, self.layer)

    @property
    def basis(self) -> Basis:
        """Basis of the elements."""
        return self.stiffness.basis

    @property
    def moduli(self) -> Array:
        """Relaxed moduli of the elements [Pa], shape (elements, 4)."""
        return self.material.youngs_modulus * element_moduli(self.mesh, self.material.poisson, self.layer)

    @property
    def averaging(self) -> Array:
        """Weights of the Gauss points in the mean of their element, shape (elements, points)."""
        return self.basis.dx / self.basis.dx.sum(axis=1, keepdims=True)

    def elastic_displacement(self) -> Array:
        """Displacement of the layer of relaxed modulus [m], shape (nodes, 2)."""
        stiffness = self.stiffness
        forces = np.zeros((stiffness.basis.N, 2))
        forces[stiffness.surface] = self.forces.T
        if self.layer.base == "slip":
            behind = 0 if self.speed > 0 else 1
            forces -= stiffness.end_tension[..., behind] * self.forces[0].sum()
        return stiffness.displacement(forces[:, :, None])[:, :, 0]

    def elastic_strain(self) -> Array:
        """Strain (e_xx, e_yy, 2 e_xy, e) of that layer at the Gauss points [-], shape (elements, points, 4)."""
        unknowns = element_unknowns(self.basis)
        displacement = self.elastic_displacement().ravel()[unknowns]
        return np.einsum("eqsb,eb->eqs", strain_matrix(self.basis), displacement, optimize=True)


class LayerContact(Protocol):
    """Contact that knows the layer under its forces."""

    @property
    def loaded_layer(self) -> LoadedLayer:
        """Layer under the forces on its surface."""


def field_mesh(result: LayerContact) -> "meshio.Mesh":
    """Compute the fields inside the layer under a roller in steady motion.

    Returns
    -------
    meshio.Mesh
        Quadrilaterals of 9 nodes. Point data: displacement [m], 3 components. Cell data, means over the elements:
        stress (xx, yy, zz, xy, yz, xz) [Pa], tension positive; pressure, the mean normal stress [Pa], compression
        positive; dissipation [W/m3].
    """
    loaded = result.loaded_layer
    dissipation = abs(loaded.speed) * np.sum(loaded.averaging * _dissipation(loaded, loaded.elastic_strain()), axis=1)
    return _mesh_with_data(loaded, _steady_displacement(loaded), dissipation=dissipation)


def dissipated_work(loaded: LoadedLayer) -> float:
    """Work dissipated in the layer per length rolled [J/m2].

    Downstream of the mesh the strain is constant; there the branches dissipate E J_k (e - z_k) : c : (e - z_k)/2 more.
    """
    strain = loaded.elastic_strain()
    inside = np.sum(loaded.basis.dx * _dissipation(loaded, strain))
    heights = (np.diff(loaded.mesh.y)[:, None] * GAUSS_WEIGHTS).ravel()
    outlet = 0 if loaded.speed > 0 else -1
    lags = _strain_lags(loaded, strain)
    remaining = (share * np.sum(stiff * lag**2, axis=-1)[:, outlet] for share, _, stiff, lag in lags)
    return float(inside + sum(heights @ energy / 2 for energy in remaining))


def _mesh_with_data(loaded: LoadedLayer, displacement: Array, **cells: Array) -> "meshio.Mesh":
    """Mesh with a displacement of the nodes, shape (nodes, 2), the stress and further cell data."""
    import meshio

    basis = loaded.basis
    stress = np.einsum("eq,eqs->es", loaded.averaging, _stress(loaded))
    cells = {"stress": stress, "pressure": -stress[:, :3].mean(axis=1)} | cells
    return meshio.Mesh(
        np.pad(basis.doflocs.T, ((0, 0), (0, 1))),
        [("quad9", basis.element_dofs.T)],
        point_data={"displacement": np.pad(displacement, ((0, 0), (0, 1)))},
        cell_data={name: [values] for name, values in cells.items()},
    )


def _stress(loaded: LoadedLayer) -> Array:
    """Stress (xx, yy, zz, xy, yz, xz) at the Gauss points [Pa]."""
    parts = loaded.moduli[:, None] * loaded.elastic_strain()
    stress = np.zeros((*parts.shape[:2], 6))
    stress[..., :3] = parts[..., 3:]
    stress[..., :2] += parts[..., :2]
    stress[..., 3] = parts[..., 2]
    return stress


def _strain_lags(loaded: LoadedLayer, strain: Array) -> Iterator[tuple[float, float, Array, Array]]:
    """For each branch J_k, v theta_k, moduli of the streamlines, and e - z_k on them, shape (rows, columns, 4)."""
    creep, streamlines = creep_function(loaded.material), _Streamlines(loaded)
    stiff = np.repeat(loaded.moduli[:: loaded.mesh.shape[1]], len(GAUSS_WEIGHTS), axis=0)[:, None]
    x = streamlines.rows(np.asarray(loaded.basis.global_coordinates())[0][..., None])[..., 0]
    e = streamlines.rows(strain)
    for share, time in zip(creep.shares, creep.times, strict=True):
        length = time * loaded.speed
        yield share, length, stiff, e - retarded_along_rows(e, x, length)


def _dissipation(loaded: LoadedLayer, strain: Array) -> Array:
    """Dissipation at the Gauss points per length rolled [J/m3 per m], shape (elements, points)."""
    dissipation = np.zeros(strain.shape[:2])
    for share, length, stiff, lag in _strain_lags(loaded, strain):
        dissipation += _Streamlines(loaded).points(share / abs(length) * np.sum(stiff * lag**2, axis=-1))
    return dissipation


def _steady_displacement(loaded: LoadedLayer) -> Array:
    """Displacement of the nodes in steady motion [m], shape (nodes, 2)."""
    creep, stiffness, elastic = creep_function(loaded.material), loaded.stiffness, loaded.elastic_displacement()
    x, u = stiffness.basis.doflocs[0], creep.instant * elastic
    for share, time in zip(creep.shares, creep.times, strict=True):
        for line in stiffness.lines:
            u[line] += share * retardation_operator(x[line], time * loaded.speed) @ elastic[line]
    return u


class _Streamlines:
    """Gauss points of the elements, 3 x 3 each, as rows along x of shape (3 rows, 3 columns, ...)."""

    def __init__(self, loaded: LoadedLayer) -> None:
        self.shape = loaded.mesh.shape
        x, y = loaded.basis.X
        self.order = np.lexsort((x, y))

    def rows(self, values: Array) -> Array:
        """Values of the points, shape (elements, points, ...), along the rows."""
        rows, columns = self.shape
        blocks = values[:, self.order].reshape(rows, columns, 3, 3, -1)
        return blocks.transpose(0, 2, 1, 3, 4).reshape(3 * rows, 3 * columns, -1)

    def points(self, values: Array) -> Array:
        """Values along the rows, back at the points, shape (elements, points)."""
        rows, columns = self.shape
        blocks = values.reshape(rows, 3, columns, 3).transpose(0, 2, 1, 3).reshape(rows * columns, 9)
        return blocks[:, np.argsort(self.order)]
