"""Finite elements of compacting mix: uniform paths equal those of a material point on any mesh."""

from itertools import pairwise

import numpy as np
import pytest
from mixes import STIFF as MIX
from scipy.linalg import logm, polar
from skfem import MeshQuad

from compact.engines.compaction.finite_strain_kernels import strain_derivatives, strain_increment
from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid
from compact.engines.compaction.increment_solver import IncrementSolver
from compact.engines.compaction.roller_contact import ContactForces
from compact.material import cap_plasticity

SQUARE = MeshQuad.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 1, 3))
PATHS = {  # strain (xx, yy, 2 xy), with the published stresses of `test_cap`
    "widening": (0.009, -0.03, 0.0),
    "narrowing": (-0.0045, -0.015, 0.0),
    "sheared": (0.0, -0.015, -0.015),
    "oedometer": (0.0, -0.03, 0.0),
}


def skewed(mesh, amount=0.06):
    """Move all corners at random; edges stay straight."""
    return MeshQuad(mesh.p + amount * np.random.default_rng(7).normal(size=mesh.p.shape), mesh.t)


def point_path(strain, steps):
    """Stress (xx, yy, zz, xy) and density ratio of a material point strained in equal steps."""
    points = cap_plasticity.initial_state(MIX, 1)
    for _ in range(steps):
        points, _ = cap_plasticity.integrate_points(MIX, points, np.array([strain]) / steps, tangent=False)
    return points.stress[0], points.density_ratio[0]


class NoRoller:
    """Surface without contact."""

    def contact_forces(self, displacement):
        n = len(displacement)
        return ContactForces(
            pressure=np.zeros(n), shear=np.zeros(n), gap=np.full(n, np.inf), forces=np.zeros((n, 2)),
            stiffness=np.zeros((n, 2, 2)),
        )  # fmt: skip


# (a) closed forms


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("mesh", [MeshQuad(), skewed(SQUARE)], ids=["one element", "six skewed"])
def test_uniform_path_equals_that_of_a_material_point(path, mesh):
    strain = np.array(PATHS[path])
    solid = FiniteStrainSolid(mesh, MIX, finite=False, substeps=2)
    gradient = np.array([[strain[0], strain[2] / 2], [strain[2] / 2, strain[1]]])
    state = solid.undeformed_state()
    for k in range(1, 11):
        state = solid.increment(state, solid.basis.doflocs.T @ gradient * k / 10, tangent=False).after
    stress, density_ratio = point_path(strain, 20)
    scale = np.abs(stress).max()
    assert state.points.stress == pytest.approx(np.tile(stress, (solid.point_areas.size, 1)), abs=1e-9 * scale)
    assert state.points.density_ratio == pytest.approx(density_ratio, rel=1e-9)


@pytest.mark.parametrize("finite", [False, True], ids=["small", "finite"])
def test_plate_on_a_confined_slab_is_the_oedometer(finite):
    """Smooth walls, smooth rigid plate, frictionless base: every point follows the path of a material point."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 0.4, 5), np.linspace(0, 0.2, 4))
    corners = mesh.p.copy()
    inner = (corners[0] > 1e-9) & (corners[0] < 0.4 - 1e-9) & (corners[1] > 1e-9) & (corners[1] < 0.2 - 1e-9)
    corners[:, inner] += 0.01 * np.random.default_rng(7).normal(size=(2, inner.sum()))
    mesh = MeshQuad(corners, mesh.t)
    x, y = FiniteStrainSolid(mesh, MIX).basis.doflocs
    walls, plate = (x < 1e-9) | (x > 0.4 - 1e-9), y > 0.2 - 1e-9
    fixed = np.concatenate([2 * np.flatnonzero(walls), 2 * np.flatnonzero((y < 1e-9) | plate) + 1])
    solid = FiniteStrainSolid(mesh, MIX, fixed_dofs=fixed, finite=finite, substeps=1)
    solver = IncrementSolver(solid, np.flatnonzero(plate), tolerance=1e-12)
    state = solid.undeformed_state()
    for k in range(1, 11):
        prediction = state.displacement.copy()
        prediction[plate, 1] = -0.2 * (1 - np.exp(-0.003 * k) if finite else 0.003 * k)
        state = solver.solve(state, NoRoller(), prediction).state
    stress, density_ratio = point_path((0, -0.03, 0), 10)
    assert state.points.stress == pytest.approx(np.tile(stress, (solid.point_areas.size, 1)), abs=1e-9 * abs(stress[1]))
    assert state.points.density_ratio == pytest.approx(density_ratio, rel=1e-9)


def test_work_of_deformation_is_that_of_the_boundary_forces():
    solid = FiniteStrainSolid(skewed(SQUARE), MIX)
    X = solid.basis.doflocs.T
    state, work = solid.undeformed_state(), 0.0
    before = np.zeros_like(X)
    for k in range(1, 201):
        increment = solid.increment(state, X * [0.0, -0.03 * k / 200], tangent=False)
        displaced = increment.after.displacement - state.displacement
        work += np.sum((before + increment.internal_forces) * displaced) / 2
        state, before = increment.after, increment.internal_forces
    assert np.sum(solid.point_areas * state.work) == pytest.approx(work, rel=1e-4)


# (b) finite kinematics


def pressed_and_sheared(solid):
    """A yielding state, and the displacement of an increment from it that yields in places."""
    X = solid.basis.doflocs.T
    before = solid.increment(solid.undeformed_state(), X @ np.array([[0.01, 0.03], [-0.05, -0.02]])).after
    return before, before.displacement + 0.002 * np.sin(3 * X)


def random_gradients(count, size):
    """Pairs of displacement gradients before and after an increment."""
    for before, after in size * np.random.default_rng(7).normal(size=(count, 2, 4)):
        yield tuple(before), tuple(after)


def test_logarithmic_strain_equals_the_matrix_logarithm():
    for before, after in random_gradients(5, 0.2):
        valid, strain, volume, *rotation = strain_increment(before, after, True)
        F, F_before = (np.eye(2) + np.reshape(gradient, (2, 2)) for gradient in (after, before))
        R, U = polar(F @ np.linalg.inv(F_before))
        E = logm(U)
        assert valid
        assert strain == pytest.approx([E[0, 0], E[1, 1], 2 * E[0, 1]], abs=1e-12)
        assert rotation == pytest.approx(R[:, 0], abs=1e-12)
        assert volume == pytest.approx(np.sqrt(np.linalg.det(F) * np.linalg.det(F_before)), rel=1e-12)


@pytest.mark.parametrize("finite", [False, True], ids=["small", "finite"])
@pytest.mark.parametrize("size", [0.2, 1e-5])
def test_strain_derivatives_equal_differences(finite, size):
    """The relative gradient is near 1 for the small size, where series replace the closed form."""

    def strain_and_angle(before, after):
        _, strain, _, cosine, sine = strain_increment(before, tuple(after), finite)
        return np.array([*strain, np.arctan2(sine, cosine)])

    for before, after in random_gradients(10, size):
        derivatives, step = np.empty((4, 4)), 1e-6
        strain_derivatives(before, after, finite, derivatives)
        for k, unit in enumerate(np.eye(4)):
            ahead, behind = (strain_and_angle(before, after + sign * step * unit) for sign in (1, -1))
            assert derivatives[:, k] == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)


def test_rigid_rotation_rotates_the_stress_and_changes_nothing_else():
    solid = FiniteStrainSolid(skewed(SQUARE), MIX)
    X = solid.basis.doflocs.T
    pressed = solid.increment(solid.undeformed_state(), X @ np.array([[0.01, 0.02], [0.0, -0.05]]))
    c, s = np.cos(0.7), np.sin(0.7)
    rotation = np.array([[c, s], [-s, c]])
    rotated = solid.increment(pressed.after, (X + pressed.after.displacement) @ rotation - X)
    scale = np.abs(pressed.internal_forces).max()
    assert rotated.internal_forces == pytest.approx(pressed.internal_forces @ rotation, abs=1e-9 * scale)
    assert rotated.after.points.density_ratio == pytest.approx(pressed.after.points.density_ratio, rel=1e-12)


@pytest.mark.parametrize("finite", [False, True], ids=["small", "finite"])
@pytest.mark.parametrize("substeps", [1, 3])
def test_stiffness_is_the_derivative_of_the_forces(finite, substeps):
    solid = FiniteStrainSolid(skewed(SQUARE), MIX, finite=finite, substeps=substeps)
    before, u = pressed_and_sheared(solid)
    direction, size = np.random.default_rng(7).normal(size=u.shape), 1e-8
    product = np.zeros(u.size)
    for dofs, block in zip(solid.element_dofs, solid.increment(before, u).element_stiffness, strict=True):
        product[dofs] += block @ direction.ravel()[dofs]
    ahead, behind = (solid.increment(before, u + sign * size * direction).internal_forces for sign in (1, -1))
    expected = ((ahead - behind) / (2 * size)).ravel()
    assert product == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_newtons_method_converges_quadratically():
    """Plain steps between two fixed ends, from a prediction with a residual of half the forces."""
    x, y = FiniteStrainSolid(SQUARE, MIX).basis.doflocs
    ends = np.flatnonzero((y == 0) | (y == 1))
    solid = FiniteStrainSolid(SQUARE, MIX, fixed_dofs=np.concatenate([2 * ends, 2 * ends + 1]))
    start, displacement, residuals = solid.undeformed_state(), np.stack([0.003 * x * y, -0.01 * y**2], axis=-1), []
    for _ in range(8):
        increment = solid.increment(start, displacement)
        residual = -increment.internal_forces.ravel()[solid.ordered_dofs]
        residuals.append(np.linalg.norm(residual) / np.linalg.norm(increment.internal_forces))
        solve = solid.factorise(increment.element_stiffness, [20], np.zeros((1, 2, 2)))
        displacement = displacement.copy()
        displacement.ravel()[solid.ordered_dofs] += solve(residual)
    orders = [np.log(after) / np.log(before) for before, after in pairwise(residuals) if 1e-6 < before < 1e-2]
    assert residuals[-1] < 1e-13
    assert len(orders) == 2
    assert min(orders) > 1.7


def test_small_displacements_give_the_strain_of_small_kinematics():
    for before, after in random_gradients(20, 1e-5):
        small, finite = (strain_increment(before, after, finite)[1] for finite in (False, True))
        assert finite == pytest.approx(small, abs=1e-8)
