"""The elastic layer of unit modulus, factorised once and condensed to its surface.

    K u = f,   K = int B' C B dA,   plane strain, E = 1, quadratic quadrilaterals

Columns of K^-1 for unit nodal forces under the possible contact, read along the whole surface, are all that a contact
needs; every modulus, relaxation spectrum, speed and roller shares them.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad2, MeshQuad
from threadpoolctl import threadpool_limits

from compact.patch import Surface

GAUSS_ORDER = 4  # 3 x 3 points: exact stiffness of rectangles, three streamlines in each row
RESIDUAL = 1e-9  # above it the weakened pivoting is not trusted and the matrix is factorised again


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Factorised stiffness of a layer of unit modulus, and what reads strains from its displacements.

    basis : scalar scikit-fem basis; dof d of component i is unknown 2 d + i
    surface : scalar dofs along the surface, ascending x
    solve : displacements of all unknowns under forces on them;  ends : a unit pull along x, half at either end
    """

    basis: Basis
    surface: np.ndarray
    solve: object
    ends: np.ndarray

    def displacement(self, forces):
        """Nodal displacements, shape (dofs, 2, k), under forces of shape (dofs, 2, k)."""
        with threadpool_limits(1):  # two threads are 3-6 times slower in the triangular solves
            return self.solve(forces.reshape(len(forces) * 2, -1)).reshape(forces.shape)


def moduli(poisson):
    """Stiffness of unit modulus against (e_xx, e_yy, 2 e_xy, e): 2 mu, 2 mu, mu and lambda, e the change of area."""
    lame = poisson / ((1 + poisson) * (1 - 2 * poisson))
    shear = 1 / (2 * (1 + poisson))
    return np.array([2 * shear, 2 * shear, shear, lame])


@lru_cache(maxsize=4)  # a few meshes of some ten MB; every speed, modulus and spectrum on a mesh shares one
def stiffness(mesh, poisson, base):
    """The factorised `Stiffness` of a RowMesh, bonded or slipping at its base."""
    quads = MeshQuad(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.quads.T))
    basis = Basis(quads, ElementQuad2(), intorder=GAUSS_ORDER)
    K = assembled(basis, moduli(poisson))
    held = _held(basis, base)
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    factor = _factorised(K[free][:, free].tocsc())

    def solve(forces):
        displacement = np.zeros_like(forces)
        displacement[free] = factor(forces[free])
        return displacement

    x, y = basis.doflocs
    surface = np.flatnonzero(y > mesh.height * (1 - 1e-9))
    return Stiffness(basis, surface[np.argsort(x[surface])], solve, _end_pull(mesh, basis))


@lru_cache(maxsize=8)
def condensed(mesh, poisson, base, window, sheared):
    """The `Surface` of a layer for loads within |x| <= window: pressures, and shear tractions too if `sheared`."""
    layer = stiffness(mesh, poisson, base)
    x = layer.basis.doflocs[0][layer.surface]
    inside = np.flatnonzero(np.abs(x[::2]) <= window)
    first, last = 2 * inside[0], 2 * inside[-1] + 1
    loaded = layer.surface[first:last]
    response = np.zeros((2, len(x), 2, len(loaded)))
    for k in range(0 if sheared else 1, 2):
        forces = np.zeros((layer.basis.N, 2, len(loaded)))
        forces[loaded, k, np.arange(len(loaded))] = 1
        if k == 0 and base == "slip":  # nothing else holds the layer along x; half of a shear force leaves at each end
            forces -= layer.ends[:, :, None]
        response[:, :, k] = layer.displacement(forces)[layer.surface].transpose(1, 0, 2)
    return Surface(x, first, last, response)


def strain_matrix(basis):
    """B of (e_xx, e_yy, 2 e_xy, e) at the Gauss points, shape (elements, points, 4, 18), unknowns as in `dofs`.

    The change of area e is e_xx + e_yy projected in each element on {1, x, y}: quadratic displacements with linear
    pressure do not lock as nu -> 1/2.
    """
    gradient = np.array([basis.basis[j][0].grad for j in range(basis.Nbfun)])  # (9, 2, elements, points)
    gx, gy = gradient.transpose(1, 2, 3, 0)
    B = np.zeros((*gx.shape[:2], 4, 2 * basis.Nbfun))
    B[..., 0, 0::2], B[..., 1, 1::2] = gx, gy
    B[..., 2, 0::2], B[..., 2, 1::2] = gy, gx
    B[..., 3, :] = _linear_part(basis, B[..., 0, :] + B[..., 1, :])
    return B


def _linear_part(basis, values):
    """Projection of Gauss-point values, shape (elements, points, k), on {1, x, y} in each element."""
    x, y = np.asarray(basis.global_coordinates())
    linear = np.stack([np.ones_like(x), x - x.mean(1, keepdims=True), y - y.mean(1, keepdims=True)], axis=-1)
    linear /= np.abs(linear).max(axis=1, keepdims=True)
    weighted = (linear * basis.dx[..., None]).transpose(0, 2, 1)
    return linear @ np.linalg.solve(weighted @ linear, weighted @ values)


def element_unknowns(basis):
    """Unknowns of each element, shape (elements, 18)."""
    dofs = basis.element_dofs.T
    return np.stack([2 * dofs, 2 * dofs + 1], axis=-1).reshape(len(dofs), -1)


def assembled(basis, moduli):
    """int B' C B dA, all elements at once."""
    B = strain_matrix(basis)
    count, points, parts, width = B.shape
    CB = (B * moduli[:, None] * basis.dx[..., None, None]).reshape(count, points * parts, width)
    blocks = np.matmul(B.reshape(CB.shape).transpose(0, 2, 1), CB)
    unknowns = element_unknowns(basis)
    rows = np.broadcast_to(unknowns[:, :, None], blocks.shape)
    columns = np.broadcast_to(unknowns[:, None, :], blocks.shape)
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * basis.N,) * 2).tocsr()


def _held(basis, base):
    """Unknowns held by the rigid base; a slipping layer is kept in place by its middle, without reaction."""
    x, y = basis.doflocs
    bottom = np.flatnonzero(y < 1e-9 * y.max())
    if base == "bonded":
        return np.concatenate([2 * bottom, 2 * bottom + 1])
    return np.append(2 * bottom + 1, 2 * bottom[np.argmin(np.abs(x[bottom]))])


def _end_pull(mesh, basis):
    """Nodal forces of a unit pull along x, half of it spread over the height of either end, shape (dofs, 2)."""
    share = np.zeros(len(mesh.y))
    share[:-1] += np.diff(mesh.y) / (4 * mesh.height)
    share[1:] += np.diff(mesh.y) / (4 * mesh.height)
    corners = basis.nodal_dofs[0].reshape(mesh.x.shape)
    forces = np.zeros((basis.N, 2))
    forces[corners[:, 0], 0] = forces[corners[:, -1], 0] = share
    return forces


def _factorised(K):
    """A solver of K x = b that has passed a test of its residual."""
    tuned = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 1e-3, "options": {"SymmetricMode": True}}
    probe = np.ones(K.shape[0])
    for options in (tuned, {}):
        solve = splu(K, **options).solve
        answer = solve(probe)
        if np.abs(K @ answer - probe).max() < RESIDUAL * np.abs(answer).max():  # entries of K are of order one
            return solve
    raise RuntimeError("the stiffness of the layer is singular to working precision")
