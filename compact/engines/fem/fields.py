"""Inside the layer under a steady roller: displacement, stress and dissipation from the forces on its surface.

The elastic layer of unit modulus gives the stresses at once, since they are those of its strains e. What branch k of
the creep function dissipates at a point, per length rolled, is the work against its retardation,

    W' = E sum_k J_k (e - z_k) : c : (e - z_k)/l_k,    z_k the retarded strain, l_k = |v| theta_k.

Inside the layer while a roller moves over it: the fields of chosen instants of a path.

All nodes of the mesh keep their memory as those of the surface do, each line of nodes along itself, and are followed
from the forces on the surface alone, once the motion is known. The stress at an instant is that of the elastic layer
under the forces then; what has to be remembered is the displacement.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from compact.engines.fem.convected_memory import creep, fading_over, memory, retained_by, retarded, steadily_retained
from compact.engines.fem.surface_compliance import element_moduli, stiffness
from compact.files import write_pvd_collection, write_vtu
from compact.material.laws import Elastic
from compact.mesh import RowMesh
from compact.numerics.assembly import element_unknowns, strain_matrix
from compact.rolling_contact import Layer

GAUSS_WEIGHTS = np.array([5, 8, 5]) / 18  # of the three streamlines in a row


def fields(rolled):
    """Displacement, stress, pressure and dissipation of a `FemContactResult`, a meshio mesh of 9-node quadrilaterals.

    point data : displacement [m], 3 components
    cell data, means of the elements : stress (xx, yy, zz, xy, yz, xz) [Pa], tension positive; pressure, of all
    directions [Pa], compression positive; dissipation [W/m3]
    """
    strain = _strain(rolled)
    weight = _shares(rolled)
    dissipation = abs(rolled.speed) * np.sum(weight * _dissipation(rolled, strain), axis=1)
    return pictured(rolled, _displacement(rolled), dissipation=dissipation)


def pictured(rolled, displacement, **cells):
    """The meshio mesh of a layer under `forces` with a displacement of its nodes, shape (dofs, 2), and data of cells.

    rolled : anything with `mesh`, `layer`, `material`, `speed` and `forces` as of a `FemContactResult`
    """
    import meshio

    basis = _basis(rolled)
    stress = np.einsum("eq,eqs->es", _shares(rolled), _stress(rolled, _strain(rolled)))
    cells = {"stress": stress, "pressure": -stress[:, :3].mean(axis=1)} | cells
    return meshio.Mesh(
        np.pad(basis.doflocs.T, ((0, 0), (0, 1))),
        [("quad9", basis.element_dofs.T)],
        point_data={"displacement": np.pad(displacement, ((0, 0), (0, 1)))},
        cell_data={name: [values] for name, values in cells.items()},
    )


def _shares(rolled):
    """Weights of the Gauss points in the means of the elements."""
    basis = _basis(rolled)
    return basis.dx / basis.dx.sum(axis=1, keepdims=True)


def write_series(layers, directory):
    """Write contacts, pairs of `fields` and `FemContactResult`, as fields/speed=V.vtu and as fields.pvd, their series over V.

    The series comes last, whole or not at all, so that all it names is there. Yields the paths.
    """
    members = []
    for layer, rolled in layers:
        path = Path(directory) / "fields" / f"speed={rolled.speed!r}.vtu"
        write_vtu(layer, path)
        members.append((rolled.speed, path))
        yield path
    series = Path(directory) / "fields.pvd"
    write_pvd_collection(series, members)
    yield series


def work_left(rolled):
    """Work that the layer keeps per length rolled [J/m2].

    Downstream of the mesh the strain changes no more; branches still lose E J_k (e - z_k) : c : (e - z_k)/2 there.
    """
    basis, strain = _basis(rolled), _strain(rolled)
    inside = np.sum(basis.dx * _dissipation(rolled, strain))
    heights = (np.diff(rolled.mesh.y)[:, None] * GAUSS_WEIGHTS).ravel()
    outlet = 0 if rolled.speed > 0 else -1
    lags = _lags(rolled, strain)
    carried = (share * np.sum(stiff * lag**2, axis=-1)[:, outlet] for share, _, stiff, lag in lags)
    return float(inside + sum(heights @ energy / 2 for energy in carried))


def _moduli(rolled):
    """Relaxed moduli of the elements, shape (elements, 4) [Pa]."""
    return rolled.material.youngs_modulus * element_moduli(rolled.mesh, rolled.material.poisson, rolled.layer)


def _basis(rolled):
    return stiffness(rolled.mesh, rolled.material.poisson, rolled.layer).basis


def relaxed(rolled):
    """Displacements of the elastic layer of the relaxed modulus, shape (dofs, 2)."""
    layer = stiffness(rolled.mesh, rolled.material.poisson, rolled.layer)
    forces = np.zeros((layer.basis.N, 2))
    forces[layer.surface] = rolled.forces.T
    if rolled.layer.base == "slip":
        behind = 0 if rolled.speed > 0 else 1
        forces -= layer.ends[..., behind] * rolled.forces[0].sum()
    return layer.displacement(forces[:, :, None])[:, :, 0]


def _strain(rolled):
    """(e_xx, e_yy, 2 e_xy, e) of the elastic layer at the Gauss points, shape (elements, points, 4)."""
    basis = _basis(rolled)
    unknowns = element_unknowns(basis)
    return np.einsum("eqsb,eb->eqs", strain_matrix(basis), relaxed(rolled).ravel()[unknowns], optimize=True)


def _stress(rolled, strain):
    """(xx, yy, zz, xy, yz, xz) at the Gauss points [Pa]."""
    parts = _moduli(rolled)[:, None] * strain
    stress = np.zeros((*strain.shape[:2], 6))
    stress[..., :3] = parts[..., 3:]
    stress[..., :2] += parts[..., :2]
    stress[..., 3] = parts[..., 2]
    return stress


def _lags(rolled, strain):
    """For each branch J_k, v theta_k, moduli of the rows, and e - z_k on the streamlines, (rows, columns, 4)."""
    law, along = creep(rolled.material), _Streamlines(rolled)
    stiff = np.repeat(_moduli(rolled)[:: rolled.mesh.shape[1]], len(GAUSS_WEIGHTS), axis=0)[:, None]
    e, x = along.rows(strain), along.rows(np.asarray(_basis(rolled).global_coordinates())[0][..., None])[..., 0]
    for share, time in zip(law.shares, law.times, strict=True):
        length = time * rolled.speed
        yield share, length, stiff, e - retarded(e, x, length)


def _dissipation(rolled, strain):
    """Work left at the Gauss points per length rolled [J/m3 per m], shape (elements, points)."""
    left = np.zeros(strain.shape[:2])
    for share, length, stiff, lag in _lags(rolled, strain):
        left += _Streamlines(rolled).points(share / abs(length) * np.sum(stiff * lag**2, axis=-1))
    return left


def _displacement(rolled):
    """Displacements of all nodes, each line of nodes retarded along itself, shape (dofs, 2)."""
    law, basis, elastic = creep(rolled.material), _basis(rolled), relaxed(rolled)
    x, u = basis.doflocs[0], law.instant * elastic
    for share, time in zip(law.shares, law.times, strict=True):
        for line in lines_of(basis, rolled.mesh):
            u[line] += share * memory(x[line], time * rolled.speed) @ elastic[line]
    return u


def lines_of(basis, mesh):
    """Nodes line by line from the base up, each along x, shape (lines, n)."""
    x, y = basis.doflocs
    return np.lexsort((x, np.round(y / mesh.height, 12))).reshape(-1, 2 * mesh.shape[1] + 1)


class _Streamlines:
    """Gauss points of the elements, three by three, as rows along x: shape (3 rows, 3 columns, ...)."""

    def __init__(self, rolled):
        self.shape = rolled.mesh.shape
        x, y = _basis(rolled).X
        self.order = np.lexsort((x, y))

    def rows(self, values):
        rows, columns = self.shape
        blocks = values[:, self.order].reshape(rows, columns, 3, 3, -1)
        return blocks.transpose(0, 2, 1, 3, 4).reshape(3 * rows, 3 * columns, -1)

    def points(self, values):
        rows, columns = self.shape
        blocks = values.reshape(rows, 3, columns, 3).transpose(0, 2, 1, 3).reshape(rows * columns, 9)
        return blocks[:, np.argsort(self.order)]


@dataclass(frozen=True, eq=False)
class _Pushed:
    """A layer on a mesh under forces on the surface nodes, over the relaxed modulus [m], shape (2, n)."""

    mesh: RowMesh
    layer: Layer
    material: Elastic
    forces: np.ndarray
    speed: float = 1.0  # no force along x sums up on a layer that is held behind


def filmed(layer, material, mesh, path, way, velocity, times):
    """(time, meshio mesh) of the times, which are instants of the path.

    path : instants with `time`, `position`, `places` and `contact.forces`, the first in motion at `velocity` for ever
    way : positions of the roller at even instants from one time to another
    mesh : with its lines of nodes one above the other; ValueError otherwise

    The nodes move with the roller; `position` of the roller, a number of every cell, tells where on the layer they are.
    """
    if np.ptp(mesh.x, axis=0).max() > 1e-9 * mesh.height:
        raise ValueError("a film needs a `mesh` whose nodes stand one above the other; leave the mesh to `tolerance`")
    law = creep(material)
    basis = stiffness(mesh, material.poisson, layer).basis
    lines = lines_of(basis, mesh)
    x, places, taken = basis.doflocs[0][lines[0]], path[0].places, []

    def moved(instant):
        pushed = _Pushed(mesh, layer, material, instant.contact.forces)
        return pushed, relaxed(pushed)[lines].transpose(2, 0, 1)  # (2, lines, n)

    def taking(instant, pushed, w, z):
        u = np.empty((basis.N, 2))
        u[lines] = (law.instant * w + retained_by(law.shares, places, z, x + instant.position)).transpose(1, 2, 0)
        position = np.full(basis.nelems, instant.position)
        taken.append((instant.time, pictured(pushed, u, position=position)))

    pushed, w = moved(path[0])
    z = steadily_retained(law, x, w, velocity, places - path[0].position)
    if path[0].time in times:
        taking(path[0], pushed, w, z)
    for before, now in pairwise(instant for instant in path if instant.time <= max(times)):
        old, (pushed, w) = w, moved(now)
        step = fading_over(law, way(before.time, now.time), now.time - before.time)
        z = step.retained(x, places, z, old, w)
        if now.time in times:
            taking(now, pushed, w, z)
    return tuple(taken)
