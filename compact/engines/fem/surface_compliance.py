"""The elastic layer of unit modulus, factorised once and condensed to its surface.

    K u = f,   K = int B' c C B dA,   plane strain, E = 1, c(y) the stiffness of the plies, quadratic quadrilaterals

Columns of K^-1 for unit nodal forces under the possible contact, read along the whole surface, are all that a contact
needs; every modulus, relaxation spectrum, speed and roller shares them.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad2, MeshQuad
from threadpoolctl import threadpool_limits

from compact.engines.fem.contact_patch import Surface
from compact.numerics.assembly import assemble_matrix, assemble_stiffness, element_matrices, strain_matrix, unit_moduli

GAUSS_ORDER = 4  # 3 x 3 points: exact stiffness of rectangles, three streamlines in each row
EVEN = 1e-9  # of the window, by which rounding may leave one of two mirrored nodes out
AT_ONCE = 128  # forces whose displacements are solved for together
RESIDUAL = 1e-9  # above it the weakened pivoting is not trusted and the matrix is factorised again


@dataclass(frozen=True, eq=False)
class Stiffness:
    """Factorised stiffness of a layer of unit modulus, and what reads strains from its displacements.

    basis : scalar scikit-fem basis; dof d of component i is unknown 2 d + i
    surface : scalar dofs along the surface, ascending x
    solve : displacements of all unknowns under forces on them
    ends : a unit force along x on the lower and on the upper end in x, shape (dofs, 2, 2)
    """

    basis: Basis
    surface: np.ndarray
    solve: object
    ends: np.ndarray

    def displacement(self, forces):
        """Nodal displacements, shape (dofs, 2, k), under forces of shape (dofs, 2, k)."""
        with threadpool_limits(1):  # two threads are 3-6 times slower in the triangular solves
            return self.solve(forces.reshape(len(forces) * 2, -1)).reshape(forces.shape)


def element_moduli(mesh, poisson, layer):
    """`moduli` times the stiffness of the ply that each element lies in, shape (elements, 4)."""
    stiffness = layer.stiffness((mesh.y[1:] + mesh.y[:-1]) / 2)
    return np.repeat(stiffness, mesh.shape[1])[:, None] * unit_moduli(poisson)


@lru_cache(maxsize=2)  # a mesh and its refined one, 0.1 GB; every speed, modulus and spectrum on a mesh shares them
def stiffness(mesh, poisson, layer):
    """The factorised `Stiffness` of a RowMesh that has a line of nodes at every interface of the layer's plies."""
    quads = MeshQuad(np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.quads.T))
    basis = Basis(quads, ElementQuad2(), intorder=GAUSS_ORDER)
    K = assemble_stiffness(basis, element_moduli(mesh, poisson, layer))
    held = _held(basis, layer.base)
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    factor = _factorised(K[free][:, free].tocsc())

    def solve(forces):
        displacement = np.zeros_like(forces)
        displacement[free] = factor(forces[free])
        return displacement

    x, y = basis.doflocs
    surface = np.flatnonzero(y > mesh.height * (1 - 1e-9))
    return Stiffness(basis, surface[np.argsort(x[surface])], solve, _end_pull(mesh, layer, basis))


@lru_cache(maxsize=8)
def condensed(mesh, poisson, layer, window, sheared, behind):
    """The `Surface` of a layer for loads on |x - mesh.centre| <= window: pressures, and shear tractions if `sheared`.

    A layer on a slipping base is held against these at one end, `behind` the roller: 0 the lower in x, 1 the upper.
    The layer ahead is as it was fed: displacements along x count from its end. Half of the loads will do where the mesh
    mirrors itself.
    """
    body = stiffness(mesh, poisson, layer)
    return _condensed(body, mesh, layer, window, sheared, behind, body.displacement)


@lru_cache(maxsize=4)
def stretched(mesh, poisson, layer, window, sheared, behind):
    """The `Surface` whose response is the derivative of that of `condensed` as every x grows in proportion.

    du/d ln s = -K^-1 (dK/d ln s) K^-1 f,   s the stretch along x, f and y held
    """
    body = stiffness(mesh, poisson, layer)
    change = _stretching(body.basis, element_moduli(mesh, poisson, layer))

    def respond(forces):
        displacement = body.displacement(forces)
        resisted = change @ displacement.reshape(len(displacement) * 2, -1)
        return -body.displacement(resisted.reshape(displacement.shape))

    return _condensed(body, mesh, layer, window, sheared, behind, respond)


def _condensed(body, mesh, layer, window, sheared, behind, respond):
    """The `Surface` by the displacements of all nodes, shape (dofs, 2, k), that `respond` gives to forces on them."""
    x = body.basis.doflocs[0][body.surface]
    inside = np.flatnonzero(np.abs(x[::2] - mesh.centre) <= window * (1 + EVEN))
    first, last = 2 * inside[0], 2 * inside[-1] + 1
    count = last - first
    left = count // 2 if mesh.mirrored else 0
    loaded = body.surface[first + left : last]
    response = np.zeros((2, len(x), 2, count))
    for k in range(0 if sheared else 1, 2):
        for start in range(0, count - left, AT_ONCE):
            some = loaded[start : start + AT_ONCE]
            forces = np.zeros((body.basis.N, 2, len(some)))
            forces[some, k, np.arange(len(some))] = 1
            if k == 0 and layer.base == "slip":
                forces -= body.ends.mean(axis=2, keepdims=True)
            columns = slice(left + start, left + start + len(some))
            response[:, :, k, columns] = respond(forces)[body.surface].transpose(1, 0, 2)
    turned = np.array([[1, -1], [-1, 1]])[:, None, :, None]  # a force and a displacement along x turn round, y does not
    response[..., :left] = (turned * response[:, ::-1, :, ::-1])[..., :left]
    if sheared and layer.base == "slip":  # held half at either end so far
        stretch = (body.ends @ [[-0.5], [0.5]]) * (1 - 2 * behind)
        response[:, :, 0] += respond(stretch)[body.surface].transpose(1, 0, 2)
        response[0] -= response[0, behind - 1]  # counted from the end ahead, which has not moved yet
    return Surface(x, first, last, response)


def _stretching(basis, moduli):
    """dK/d ln s of `assembled` as every x grows by s: strains along x fall by it and areas grow."""
    B = strain_matrix(basis)
    mixed = element_matrices(basis, B, strain_matrix(basis, -1.0, 0.0), moduli)
    return assemble_matrix(basis, mixed + mixed.transpose(0, 2, 1) + element_matrices(basis, B, B, moduli))


def _held(basis, base):
    """Unknowns held by the rigid base; a slipping layer is kept in place by its middle, without reaction."""
    x, y = basis.doflocs
    bottom = np.flatnonzero(y < 1e-9 * y.max())
    if base == "bonded":
        return np.concatenate([2 * bottom, 2 * bottom + 1])
    return np.append(2 * bottom + 1, 2 * bottom[np.argmin(np.abs(x[bottom]))])


def _end_pull(mesh, layer, basis):
    """Nodal forces of unit sum along x on either end, which stretch all plies alike, shape (dofs, 2, 2)."""
    x, y = basis.doflocs
    lines = np.lexsort((x, np.round(y / mesh.height, 12))).reshape(2 * mesh.shape[0] + 1, -1)
    rows = np.diff(mesh.y) * layer.stiffness((mesh.y[1:] + mesh.y[:-1]) / 2)
    share = np.zeros(len(lines))
    share[1::2] = 4 * rows  # as of a uniform stress on quadratic sides: anything else would disturb the strains
    share[:-2:2] += rows
    share[2::2] += rows
    forces = np.zeros((basis.N, 2, 2))
    forces[lines[:, 0], 0, 0] = forces[lines[:, -1], 0, 1] = share / share.sum()
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
