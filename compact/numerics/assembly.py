"""Batched element matrices of plane-strain solids, shared by the finite-element engines.

K_e = int B' C B dA of all elements at once;  dof d of component i is unknown 2 d + i
"""

import numpy as np
from scipy.sparse import coo_matrix


def unit_moduli(poisson):
    """Stiffness of unit modulus against (e_xx, e_yy, 2 e_xy, e): 2 mu, 2 mu, mu and lambda, e the change of area."""
    lame = poisson / ((1 + poisson) * (1 - 2 * poisson))
    shear = 1 / (2 * (1 + poisson))
    return np.array([2 * shear, 2 * shear, shear, lame])


def strain_matrix(basis, along=1.0, across=1.0):
    """B of (e_xx, e_yy, 2 e_xy, e) at the Gauss points, shape (elements, points, 4, 18), unknowns as in `dofs`.

    along, across : factors of the derivatives along x and y

    The change of area e is e_xx + e_yy projected in each element on {1, x, y}: quadratic displacements with linear
    pressure do not lock as nu -> 1/2.
    """
    gradient = np.array([basis.basis[j][0].grad for j in range(basis.Nbfun)])  # (9, 2, elements, points)
    gx, gy = gradient.transpose(1, 2, 3, 0)
    gx, gy = along * gx, across * gy
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


def assemble_stiffness(basis, moduli):
    """int B' C B dA, all elements at once; moduli of all, shape (4,), or of each, shape (elements, 4)."""
    B = strain_matrix(basis)
    return assemble_matrix(basis, element_matrices(basis, B, B, moduli))


def element_matrices(basis, left, right, moduli):
    """int left' C right dA of every element, shape (elements, 18, 18)."""
    count, points, parts, width = left.shape
    C_right = (right * moduli[..., None, :, None] * basis.dx[..., None, None]).reshape(count, points * parts, width)
    return np.matmul(left.reshape(C_right.shape).transpose(0, 2, 1), C_right)


def assemble_matrix(basis, blocks):
    """The sparse matrix of blocks of the elements."""
    unknowns = element_unknowns(basis)
    rows = np.broadcast_to(unknowns[:, :, None], blocks.shape)
    columns = np.broadcast_to(unknowns[:, None, :], blocks.shape)
    return coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * basis.N,) * 2).tocsr()
