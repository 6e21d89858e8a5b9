"""Batched element matrices: equality with the elasticity form of scikit-fem, projection of the volumetric strain."""

import numpy as np
import pytest
from skfem import Basis, ElementQuad2, ElementVector, MeshQuad
from skfem.models.elasticity import lame_parameters, linear_elasticity

from compact.numerics.assembly import assemble_matrix, assemble_stiffness, element_matrices, strain_matrix, unit_moduli

POISSON = 0.3


@pytest.fixture(scope="module", params=["rectangles", "parallelograms"])
def bases(request):
    """Scalar and vector bases of one mesh."""
    mesh = MeshQuad.init_tensor(np.array([0.0, 0.3, 1.0, 1.2]), np.array([0.0, 0.5, 0.8]))
    if request.param == "parallelograms":
        mesh = MeshQuad(np.array([[1.0, 0.4], [-0.1, 1.0]]) @ mesh.p, mesh.t)
    return Basis(mesh, ElementQuad2(), intorder=4), Basis(mesh, ElementVector(ElementQuad2()), intorder=4)


def test_stiffness_without_projection_is_that_of_scikit_fem(bases):
    scalar, vector = bases
    B = strain_matrix(scalar)
    B[..., 3, :] = B[..., 0, :] + B[..., 1, :]
    K = assemble_matrix(scalar, element_matrices(scalar, B, B, unit_moduli(POISSON)))
    exact = linear_elasticity(*lame_parameters(1.0, POISSON)).assemble(vector)
    assert np.abs(K - exact).max() < 1e-12 * np.abs(exact).max()


def test_projection_keeps_the_energy_of_a_linear_volumetric_strain(bases):
    scalar, vector = bases
    x, y = scalar.doflocs
    displacement = np.column_stack([x**2 - 3 * x * y + y, 2 * y**2 + x * y - 5 * x]).ravel()
    K = assemble_stiffness(scalar, unit_moduli(POISSON))
    exact = linear_elasticity(*lame_parameters(1.0, POISSON)).assemble(vector)
    assert displacement @ K @ displacement == pytest.approx(displacement @ exact @ displacement, rel=1e-12)


def test_rigid_motions_have_no_energy(bases):
    scalar, _ = bases
    x, y = scalar.doflocs
    K = assemble_stiffness(scalar, unit_moduli(POISSON))
    for motion in ([np.ones_like(x), 0 * y], [0 * x, np.ones_like(y)], [-y, x]):
        assert np.abs(K @ np.column_stack(motion).ravel()).max() < 1e-12
