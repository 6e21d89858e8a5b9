"""Fields inside a linear layer under given forces on its surface: displacement, stress, dissipation.

The stress is that of the elastic layer of relaxed modulus under the same forces, with its strain e. Branch k of the
creep function dissipates, per length rolled and unit volume,

    W' = E sum_k J_k (e - z_k) : c : (e - z_k)/l_k,    l_k = |v| theta_k,

where z_k is the retarded strain. Retardation of the elastic displacement along each line of nodes gives that of the
viscoelastic layer.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from compact.engines.fem import compliance
from compact.engines.spectral.galerkin_system import creep_function
from compact.mesh import RowMesh
from compact.numerics import Array
from compact.numerics.assembly import element_unknowns, strain_matrix
from compact.rolling_contact import Contact

if TYPE_CHECKING:
    import meshio

GAUSS_WEIGHTS = np.array([5, 8, 5]) / 18  # [-], of the three streamlines in a row of elements


@dataclass(frozen=True, kw_only=True)
class FemContactResult(Contact):
    """A `Contact` with the data that its fields require.

    Its `history` lists (trailing, leading, step over length) of every iteration, along x [m]. The sign of its speed
    selects the end at which a slipping layer is held.

    Parameters
    ----------
    mesh : RowMesh
        Mesh of the layer.
    forces : ndarray
        Forces on the surface nodes over the relaxed modulus [m], shape (2, n).
    """

    mesh: RowMesh
    forces: Array

    @property
    def stiffness(self) -> compliance.LayerStiffness:
        """Factorised stiffness of the layer, shared by all contacts on the same mesh."""
        behind = compliance.end_behind(self.layer, self.speed)
        return compliance.layer_stiffness(self.mesh, self.material.poisson, self.layer, behind)

    @property
    def moduli(self) -> Array:
        """Relaxed moduli of the elements [Pa], shape (elements, 4)."""
        return self.material.youngs_modulus * compliance.element_moduli(self.mesh, self.material.poisson, self.layer)

    def elastic_displacement(self) -> Array:
        """Displacement of the layer of relaxed modulus under the same forces [m], shape (nodes, 2).

        On a frictionless base the displacements along x count from that of the base below the roller.
        """
        stiffness = self.stiffness
        forces = np.zeros((stiffness.basis.N, 2))
        forces[stiffness.surface] = self.forces.T
        u, base = stiffness.displacement(forces[:, :, None])[:, :, 0], stiffness.lines[0]
        u[:, 0] -= u[base[np.argmin(np.abs(stiffness.basis.doflocs[0][base]))], 0]
        return u

    def elastic_strain(self) -> Array:
        """Strain (e_xx, e_yy, 2 e_xy, e) of that layer at the Gauss points [-], shape (elements, points, 4)."""
        basis = self.stiffness.basis
        displacement = self.elastic_displacement().ravel()[element_unknowns(basis)]
        return np.einsum("eqsb,eb->eqs", strain_matrix(basis), displacement, optimize=True)


def field_mesh(result: FemContactResult) -> "meshio.Mesh":
    """Compute the fields inside the layer under a roller in steady motion.

    Returns
    -------
    meshio.Mesh
        Quadrilaterals of 9 nodes. Point data: displacement [m], 3 components. Cell data, means over the elements:
        stress (xx, yy, zz, xy, yz, xz) [Pa], tension positive; pressure, the mean normal stress [Pa], compression
        positive; dissipation [W/m3].
    """
    import meshio

    basis, elastic, strain = result.stiffness.basis, result.elastic_displacement(), result.elastic_strain()
    x, u = basis.doflocs[0], np.empty_like(elastic)
    for line in result.stiffness.lines:
        u[line] = compliance.steady_creep_operator(x[line], result.material, result.speed) @ elastic[line]
    parts = result.moduli[:, None] * strain
    stress = np.zeros((*parts.shape[:2], 6))
    stress[..., :3] = parts[..., 3:]
    stress[..., :2] += parts[..., :2]
    stress[..., 3] = parts[..., 2]
    area = basis.dx.sum(axis=1)
    stress = np.einsum("eq,eqs->es", basis.dx / area[:, None], stress)
    dissipation = abs(result.speed) * _dissipation(result, strain)[0] / area
    return meshio.Mesh(
        np.pad(basis.doflocs.T, ((0, 0), (0, 1))),
        [("quad9", basis.element_dofs.T)],
        point_data={"displacement": np.pad(u, ((0, 0), (0, 1)))},
        cell_data={"stress": [stress], "pressure": [-stress[:, :3].mean(axis=1)], "dissipation": [dissipation]},
    )


def dissipated_work(result: FemContactResult) -> float:
    """Work dissipated in the layer per length rolled [J/m2].

    Downstream of the mesh the strain is constant; there the branches dissipate E J_k (e - z_k) : c : (e - z_k)/2 more.
    """
    inside, remaining = _dissipation(result, result.elastic_strain())
    return float(np.sum(inside) + remaining)


def _dissipation(result: FemContactResult, strain: Array) -> tuple[Array, float]:
    """Dissipation of the elements per length rolled [J/m per m], shape (elements,), and that downstream [J/m2]."""
    (rows, columns), basis, (_, *branches) = result.mesh.shape, result.stiffness.basis, creep_function(result.material)
    stiff = np.repeat(result.moduli[::columns], len(GAUSS_WEIGHTS), axis=0)[:, None]
    heights = (np.diff(result.mesh.y)[:, None] * GAUSS_WEIGHTS).ravel()
    e, x, areas = (
        _streamlines(result, values)
        for values in (strain, np.asarray(basis.global_coordinates())[0][..., None], basis.dx[..., None])
    )
    inside, remaining, outlet = np.zeros(areas.shape[:2]), 0.0, 0 if result.speed > 0 else -1
    for share, time in zip(*branches, strict=True):
        length = time * result.speed
        energy = share * np.sum(stiff * (e - compliance.retarded_along_rows(e, x[..., 0], length)) ** 2, axis=-1)
        inside += energy / abs(length)
        remaining += float(heights @ energy[:, outlet] / 2)
    return (areas[..., 0] * inside).reshape(rows, 3, columns, 3).sum(axis=(1, 3)).ravel(), remaining


def _streamlines(result: FemContactResult, values: Array) -> Array:
    """Values of the Gauss points, shape (elements, 9, n), as rows along x of shape (3 rows, 3 columns, n)."""
    (rows, columns), (x, y) = result.mesh.shape, result.stiffness.basis.X
    blocks = values[:, np.lexsort((x, y))].reshape(rows, columns, 3, 3, -1)
    return blocks.transpose(0, 2, 1, 3, 4).reshape(3 * rows, 3 * columns, -1)
