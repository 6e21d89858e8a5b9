"""Batched element matrices of plane-strain solids, shared by the finite-element engines.

    K_e = integral of B' C B over the element

All elements are integrated by one batch of matrix products. Degree of freedom d of component i is unknown 2 d + i.
The volumetric strain is projected in each element on linear functions (B-bar method), so that quadratic displacements
do not lock as Poisson's ratio approaches 1/2.

References
----------
T. J. R. Hughes, The Finite Element Method, Dover 2000, section 4.5 (B-bar method).
"""

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from skfem import Basis

from compact.numerics import Array, IntArray


def unit_moduli(poisson: float | Array) -> Array:
    """Compute 2 mu, 2 mu, mu and lambda [-] for E = 1: stiffness against e_xx, e_yy, 2 e_xy and volumetric strain."""
    lame = poisson / ((1 + poisson) * (1 - 2 * poisson))
    shear = 1 / (2 * (1 + poisson))
    return np.array([2 * shear, 2 * shear, shear, lame])


def strain_matrix(basis: Basis, x_scale: float = 1.0, y_scale: float = 1.0) -> Array:
    """Compute B [1/m] of e_xx, e_yy, 2 e_xy and projected volumetric strain, shape (elements, points, 4, 2 Nbfun).

    Derivatives along x and y are multiplied by factors [-]; unknowns are in the order of `element_unknowns`.
    """
    gradient = np.array([basis.basis[j][0].grad for j in range(basis.Nbfun)])  # (Nbfun, 2, elements, points)
    gx, gy = gradient.transpose(1, 2, 3, 0)
    gx, gy = x_scale * gx, y_scale * gy
    B = np.zeros((*gx.shape[:2], 4, 2 * basis.Nbfun))
    B[..., 0, 0::2], B[..., 1, 1::2] = gx, gy
    B[..., 2, 0::2], B[..., 2, 1::2] = gy, gx
    B[..., 3, :] = _linear_projection(basis, B[..., 0, :] + B[..., 1, :])
    return B


def _linear_projection(basis: Basis, values: Array) -> Array:
    """Projection of values at quadrature points, shape (elements, points, k), on {1, x, y} in each element."""
    x, y = np.asarray(basis.global_coordinates())
    linear = np.stack([np.ones_like(x), x - x.mean(1, keepdims=True), y - y.mean(1, keepdims=True)], axis=-1)
    linear /= np.abs(linear).max(axis=1, keepdims=True)
    weighted = (linear * basis.dx[..., None]).transpose(0, 2, 1)
    return linear @ np.linalg.solve(weighted @ linear, weighted @ values)


def element_unknowns(basis: Basis) -> IntArray:
    """Return the unknowns of each element, shape (elements, 2 Nbfun)."""
    dofs = basis.element_dofs.T
    return np.stack([2 * dofs, 2 * dofs + 1], axis=-1).reshape(len(dofs), -1)


def assemble_stiffness(basis: Basis, moduli: Array) -> csr_matrix:
    """Assemble the global stiffness matrix for `unit_moduli` of the body or of each element, shape (2 N, 2 N)."""
    B = strain_matrix(basis)
    return assemble_matrix(basis, element_matrices(basis, B, B, moduli))


def element_matrices(basis: Basis, left: Array, right: Array, moduli: Array) -> Array:
    """Integrate left' C right over every element, C = diag(moduli), shape (elements, n, n)."""
    count, points, parts, width = left.shape
    C_right = (right * moduli[..., None, :, None] * basis.dx[..., None, None]).reshape(count, points * parts, width)
    return np.matmul(left.reshape(C_right.shape).transpose(0, 2, 1), C_right)


def assemble_matrix(basis: Basis, blocks: Array) -> csr_matrix:
    """Assemble element matrices, shape (elements, n, n), into the sparse global matrix."""
    unknowns = element_unknowns(basis)
    rows = np.broadcast_to(unknowns[:, :, None], blocks.shape)
    columns = np.broadcast_to(unknowns[:, None, :], blocks.shape)
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * basis.N,) * 2).tocsr()
