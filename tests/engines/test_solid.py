"""Compacting mix in finite elements: uniform paths are those of the material point, however the mesh leans."""

import numpy as np
import pytest
from skfem import MeshQuad

from compact.engines.compaction.finite_strain_solid import Finite, Small, Solid
from compact.engines.compaction.newton import Balancer, NotBalancedError
from compact.engines.compaction.roller_contact import ContactForces
from compact.material import cap_plasticity
from compact.material.laws import Compaction

MIX = Compaction(120e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94, dry_side="ellipse")
SQUARE = MeshQuad.init_tensor(np.linspace(0, 1, 4), np.linspace(0, 1, 3))
RANDOM = np.random.default_rng(7)


def skewed(mesh, amount=0.06):
    """The mesh with its inner and outer corners moved at random; edges stay straight."""
    return MeshQuad(mesh.p + amount * RANDOM.normal(size=mesh.p.shape), mesh.t)


def point_path(strain, steps, law=MIX):
    """Stress (xx, yy, zz, xy) and density ratio of one material point strained in equal steps."""
    state = cap_plasticity.initial_state(law, 1)
    for _ in range(steps):
        state, _ = cap_plasticity.integrate_points(law, state, np.array([strain]) / steps, tangent=False)
    return state.stress[0], state.density_ratio[0]


class Nothing:
    """A roller that is far away."""

    def push(self, displacement):
        n = len(displacement)
        return ContactForces(np.full(n, np.inf), np.zeros(n), np.zeros(n), np.zeros((n, 2)), np.zeros((n, 2, 2)))


# reference/compaction.md 6, -e_y: e_x = -.3 e_y and .3 e_y, gamma = e_y, oedometer: (e_xx, e_yy, 2 e_xy)
PATHS = {
    "widening": ((0.009, -0.03, 0.0), (-79.3042, -165.3647, -99.1644, 0.0, 0.95884915)),
    "narrowing": ((-0.0045, -0.015, 0.0), (-127.7755, -163.9442, -112.2746, 0.0, 0.95721998)),
    "sheared": ((0.0, -0.015, -0.015), (-96.8506, -146.9643, -96.8506, -25.0568, 0.95312334)),
    "oedometer": ((0.0, -0.03, 0.0), (-122.5914, -190.1193, -122.5914, 0.0, 0.96722280)),
}


# (a) closed forms


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("mesh", [MeshQuad(), skewed(SQUARE)], ids=["one element", "six skewed"])
def test_uniform_path_is_that_of_the_material_point(path, mesh):
    strain = np.array(PATHS[path][0])
    solid = Solid(mesh, MIX, finite=False, substeps=2)
    stretch = np.array([[strain[0], strain[2] / 2], [strain[2] / 2, strain[1]]])
    condition = solid.at_rest()
    for k in range(1, 11):
        motion = solid.moved(condition, solid.basis.doflocs.T @ stretch * k / 10)
        condition = motion.after
    stress, density_ratio = point_path(strain, 20)
    scale = np.abs(stress).max()
    assert condition.state.stress == pytest.approx(np.tile(stress, (solid.area.size, 1)), abs=1e-9 * scale)
    assert condition.state.density_ratio == pytest.approx(density_ratio, rel=1e-9)


@pytest.mark.parametrize("path", PATHS)
def test_uniform_path_meets_the_published_digits(path):
    """First order in the step, so that two runs extrapolate."""
    strain, exact = PATHS[path]
    coarse, fine = (np.append(*point_path(np.array(strain), n)) for n in (2000, 4000))
    found = (2 * fine - coarse) / np.array([1e3, 1e3, 1e3, 1e3, 1])
    assert found[:4] == pytest.approx(exact[:4], abs=2e-4)
    assert found[4] == pytest.approx(exact[4], abs=2e-8)


@pytest.mark.parametrize("finite", [False, True])
def test_plate_on_a_slab_between_walls_is_the_oedometer(finite):
    """Smooth walls, smooth rigid plate, slipping base: every point goes the way of the material point."""
    mesh = skewed(MeshQuad.init_tensor(np.linspace(0, 0.4, 5), np.linspace(0, 0.2, 4)), 0.0)
    inner = (mesh.p[0] > 1e-9) & (mesh.p[0] < 0.4 - 1e-9) & (mesh.p[1] > 1e-9) & (mesh.p[1] < 0.2 - 1e-9)
    mesh.p[:, inner] += 0.01 * RANDOM.normal(size=(2, inner.sum()))
    mesh = MeshQuad(mesh.p, mesh.t)
    x, y = Solid(mesh, MIX).basis.doflocs
    walls, plate = (x < 1e-9) | (x > 0.4 - 1e-9), y > 0.2 - 1e-9
    held = np.concatenate([2 * np.flatnonzero(walls), 2 * np.flatnonzero((y < 1e-9) | plate) + 1])
    solid = Solid(mesh, MIX, held=held, finite=finite, substeps=1)
    balancer = Balancer(solid, np.flatnonzero(plate), residual=1e-12)
    condition, sunk = solid.at_rest(), 1 - np.exp(-0.03) if finite else 0.03
    for k in range(1, 11):
        settled = 0.2 * (1 - np.exp(-0.003 * k) if finite else 0.003 * k)
        guess = condition.displacement.copy()
        guess[plate, 1] = -settled
        condition = balancer.balanced(condition, Nothing(), guess).after
    stress, density_ratio = point_path((0, -0.03, 0), 10)
    assert settled == pytest.approx(0.2 * sunk)
    assert condition.state.stress == pytest.approx(np.tile(stress, (solid.area.size, 1)), abs=1e-9 * abs(stress[1]))
    assert condition.state.density_ratio == pytest.approx(density_ratio, rel=1e-9)


def test_work_taken_up_is_that_of_the_plate():
    solid = Solid(skewed(SQUARE), MIX, finite=True)
    X = solid.basis.doflocs.T
    condition, given = solid.at_rest(), 0.0
    before = np.zeros_like(X)
    for k in range(1, 201):
        motion = solid.moved(condition, X * [0.0, -0.03 * k / 200], tangent=False)
        moved = motion.after.displacement - condition.displacement
        given += np.sum((before + motion.forces) * moved) / 2
        condition, before = motion.after, motion.forces
    assert np.sum(solid.area * condition.work) == pytest.approx(given, rel=1e-4)


def test_drag_holds_what_leaves_the_motion_foreseen_and_nothing_else():
    """At the balance itself it is none; away from it the mix lags, and what it holds is told as residual."""
    x, y = Solid(SQUARE, MIX).basis.doflocs
    ends = np.flatnonzero((y == 0) | (y == 1))
    solid = Solid(SQUARE, MIX, held=np.concatenate([2 * ends, 2 * ends + 1]))
    start, foreseen = solid.at_rest(), np.stack([0 * x, -0.01 * y**2], axis=-1)
    balancer = Balancer(solid, np.array([20]), residual=1e-9)
    free = balancer.balanced(start, Nothing(), foreseen)
    again = balancer.balanced(start, Nothing(), free.after.displacement, drag=0.5)
    held = balancer.balanced(start, Nothing(), foreseen, drag=0.5)
    assert again.after.displacement == pytest.approx(free.after.displacement, abs=1e-9)
    lagged, moved = (np.abs(balance.after.displacement - foreseen).max() for balance in (held, free))
    assert lagged < 0.95 * moved
    assert free.residual < 1e-9 < held.residual


# finite kinematics


def test_logarithmic_strain_is_that_of_the_matrix_logarithm():
    from scipy.linalg import logm, polar

    before, after = 0.2 * RANDOM.normal(size=(2, 20, 4))
    change = Finite.between(before, after)
    for k in range(20):
        dF = (np.eye(2) + after[k].reshape(2, 2)) @ np.linalg.inv(np.eye(2) + before[k].reshape(2, 2))
        R, U = polar(dF)
        E = logm(U)
        assert change.strain[k] == pytest.approx([E[0, 0], E[1, 1], 2 * E[0, 1]], abs=1e-12)
        assert [change.cosine[k], change.sine[k]] == pytest.approx(R[:, 0], abs=1e-12)


def test_turning_the_mix_turns_its_stress_and_nothing_else():
    solid = Solid(skewed(SQUARE), MIX)
    X = solid.basis.doflocs.T
    pressed = solid.moved(solid.at_rest(), X @ np.array([[0.01, 0.02], [0.0, -0.05]]))
    c, s = np.cos(0.7), np.sin(0.7)
    turned = solid.moved(pressed.after, (X + pressed.after.displacement) @ np.array([[c, s], [-s, c]]) - X)
    scale = np.abs(pressed.forces).max()
    assert turned.forces == pytest.approx(pressed.forces @ np.array([[c, s], [-s, c]]), abs=1e-9 * scale)
    assert turned.after.state.density_ratio == pytest.approx(pressed.after.state.density_ratio, rel=1e-12)


def test_small_increments_of_small_displacements_agree_with_linear_kinematics():
    before, after = 1e-5 * RANDOM.normal(size=(2, 20, 4))
    assert Finite.between(before, after).strain == pytest.approx(Small.between(before, after).strain, abs=1e-8)


@pytest.mark.parametrize("finite", [False, True])
@pytest.mark.parametrize("substeps", [1, 3])
def test_stiffness_is_the_derivative_of_the_forces(finite, substeps):
    solid = Solid(skewed(SQUARE), MIX, finite=finite, substeps=substeps)
    X = solid.basis.doflocs.T
    before = solid.moved(solid.at_rest(), X @ np.array([[0.01, 0.03], [-0.05, -0.02]])).after
    u = before.displacement + 0.002 * np.sin(3 * X)
    direction, size = RANDOM.normal(size=u.shape), 1e-8
    motion = solid.moved(before, u)
    product = np.zeros(u.size)
    for unknowns, block in zip(solid.unknowns, motion.blocks, strict=True):
        product[unknowns] += block @ direction.ravel()[unknowns]
    ahead, behind = (solid.moved(before, u + sign * size * direction).forces for sign in (1, -1))
    expected = ((ahead - behind) / (2 * size)).ravel()
    assert product == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


# refusals


def test_what_finds_no_balance_says_how_far_it_got():
    solid = Solid(SQUARE, MIX, held=np.arange(8))
    guess = solid.at_rest().displacement
    guess[:, 1] = -0.4 * solid.basis.doflocs[1] ** 2
    balancer = Balancer(solid, np.array([20]), residual=1e-30)
    with pytest.raises(NotBalancedError, match=r"no balance: after \d+ iterations \S+ of the forces stay unbalanced"):
        balancer.balanced(solid.at_rest(), Nothing(), guess)


def test_fold_in_the_foreseen_displacement_is_no_start():
    """The start is then the displacement before the increment, from which the balance is found."""
    solid = Solid(SQUARE, MIX, held=np.arange(8))
    folded = solid.at_rest().displacement
    folded[20] = [2.0, 0.0]  # beyond the far side of the mesh
    with np.errstate(all="ignore"), pytest.raises(ValueError, match="`strain` must be finite"):
        solid.moved(solid.at_rest(), folded)
    balance = Balancer(solid, np.array([20])).balanced(solid.at_rest(), Nothing(), folded)
    assert np.abs(balance.after.displacement).max() == 0


def test_held_nodes_that_fold_the_layer_over_are_refused_in_words():
    solid = Solid(SQUARE, MIX, held=[40, 41])
    folded = solid.at_rest().displacement
    folded[20] = [2.0, 0.0]
    with pytest.raises(NotBalancedError, match="elements of the layer fold over before the first iteration"):
        Balancer(solid, np.array([19])).balanced(solid.at_rest(), Nothing(), folded)
