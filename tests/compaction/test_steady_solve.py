"""Direct steady solve: streamline integration, its derivative, and the ways to a solution."""

from dataclasses import replace

import numpy as np
import pytest

from compact.engines.compaction import streamline_integration
from compact.engines.compaction.engine import roll
from compact.engines.compaction.finite_strain_kernels import strain_increment
from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.compaction.newton import EquilibriumError
from compact.engines.compaction.roller_frame import RollerFrame, rolling_mesh
from compact.engines.compaction.steady_newton_krylov import SteadySolver, continue_in_stiffness
from compact.engines.compaction.streamline_integration import StreamlineIntegrator, propagate_changes
from compact.material import cap_plasticity
from compact.material.laws import Compaction

MIX = Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)
LENGTH = np.sqrt(2 * 0.11 * 0.002)
SOLVER = "compact.engines.compaction.steady_newton_krylov."


def create_frame(finite=True, material=MIX):
    return RollerFrame(rolling_mesh(0.1, LENGTH, LENGTH / 4), material, "bonded", LENGTH, finite=finite)


def smooth_displacement(frame, seed=1):
    """Smooth displacement with compression and shear, 0 ahead and at the base."""
    x, y = frame.nodes.T
    rng = np.random.default_rng(seed)
    shape = (1 - np.tanh((x - 0.02) / 0.02)) / 2 * y / frame.mesh.height
    return np.stack([1e-3 * shape * np.cos(30 * x + rng.uniform()), -2e-3 * shape], axis=-1)


def smooth_gradients(frame, seed=1):
    return np.ascontiguousarray(frame.to_rows(frame.solid.displacement_gradient(smooth_displacement(frame, seed))))


def rotate(stress, cosine, sine):
    """Rotate stresses (xx, yy, zz, xy)."""
    xx, yy, zz, xy = stress.T
    R = np.array([[cosine, -sine], [sine, cosine]])
    rotated = np.einsum("ijn,jkn,lkn->iln", R, np.array([[xx, xy], [xy, yy]]), R)
    return np.array([rotated[0, 0], rotated[1, 1], zz, rotated[0, 1]]).T


def integrate(frame, gradients):
    integrator = StreamlineIntegrator(MIX, frame.fed_layer.points, 1.0, frame.solid.finite, 4)
    return integrator, integrator.integrate(np.ascontiguousarray(gradients))


# (a) streamline integration


@pytest.mark.parametrize("finite", [True, False], ids=["finite", "small"])
def test_integration_repeats_the_increments_of_the_solid(finite):
    frame = create_frame(finite)
    gradients = smooth_gradients(frame)
    _, streamlines = integrate(frame, gradients)
    points, before = frame.fed_layer.points, np.zeros((len(frame.row_y), 4))
    for j in range(len(frame.row_x) - 1, -1, -1):
        pairs = zip(before, gradients[:, j], strict=True)
        increments = [strain_increment(tuple(start), tuple(end), finite) for start, end in pairs]
        strain = np.array([increment[1] for increment in increments])
        for _ in range(4):
            points, _ = cap_plasticity.integrate_points(MIX, points, strain / 4, tangent=False)
        cosine, sine = np.array([increment[3:] for increment in increments]).T
        points = replace(points, stress=rotate(points.stress, cosine, sine))
        before = gradients[:, j]
        assert streamlines.values[:, j, :4] == pytest.approx(points.stress, abs=1e-4)
        assert streamlines.values[:, j, 4] == pytest.approx(points.density_ratio, rel=1e-12)
    assert streamlines.plastic_work[:, 0] == pytest.approx(points.plastic_work, rel=1e-9)


def test_derivative_along_rows_equals_differences():
    frame = create_frame()
    gradients, direction = (smooth_gradients(frame, seed) for seed in (1, 2))
    integrator, streamlines = integrate(frame, gradients)
    change = propagate_changes(integrator.derivatives(gradients, streamlines), direction)
    step = 1e-6
    ahead, behind = (integrate(frame, gradients + sign * step * direction)[1].values for sign in (1, -1))
    error = np.linalg.norm(((ahead - behind) / (2 * step) - change)[..., :4]) / np.linalg.norm(change[..., :4])
    assert error < 2e-3  # points at the onset of yielding have two derivatives


def test_integration_in_blocks_gives_the_same_result(monkeypatch):
    """An interrupt is possible between two blocks."""
    frame = create_frame()
    gradients = smooth_gradients(frame)
    integrator, whole = integrate(frame, gradients)
    derivatives = integrator.derivatives(gradients, whole)
    change = propagate_changes(derivatives, gradients)
    monkeypatch.setattr(streamline_integration, "MAX_STEPS_PER_CALL", 1)
    assert len(streamline_integration._row_blocks(len(gradients), gradients.shape[1])) == len(gradients)
    _, blocks = integrate(frame, gradients)
    assert np.array_equal(blocks.values, whole.values)
    assert np.array_equal(blocks.work, whole.work)
    assert np.array_equal(integrator.derivatives(gradients, blocks), derivatives)
    assert np.array_equal(propagate_changes(derivatives, gradients), change)


def test_mix_without_displacement_keeps_its_fed_state():
    frame = create_frame()
    _, streamlines = integrate(frame, 0 * smooth_gradients(frame))
    assert np.all(streamlines.values[..., :4] == 0)
    assert np.all(streamlines.values[..., 4] == MIX.fed_density_ratio)
    assert np.all(streamlines.work == 0)


def test_inverted_elements_are_refused():
    frame = create_frame()
    gradients = 0 * smooth_gradients(frame)
    gradients[3, 5, 0] = -1.5
    with pytest.raises(RuntimeError, match="fails at point 5 of row 3: elements of the layer invert"):
        integrate(frame, gradients)


# (b) equilibrium


def test_steady_equilibrium_is_found_directly(coarse):
    assert coarse.solution.is_direct
    assert coarse.equilibrium_residual < 1e-6
    assert coarse.yield_residual < 1e-9


@pytest.mark.slow
def test_two_paths_end_in_one_equilibrium(coarse, layer, roller, mix):
    """The path over 5 % more depth and back gives the first solution."""
    deeper = roll(layer, replace(roller, indentation=0.0021), mix, 0.2, start=coarse)
    back = roll(layer, roller, mix, 0.2, start=deeper)
    assert back.load == pytest.approx(coarse.load, rel=1e-3)
    assert back.resistance == pytest.approx(coarse.resistance, rel=1e-3)


def test_gap_vanishes_in_the_contact(coarse):
    contact = coarse.solution.contact
    assert np.abs(contact.gap[contact.pressure > 0]).max() < 1e-6 * coarse.indentation
    assert contact.gap.min() > -1e-6 * coarse.indentation


def test_state_behind_the_roller_is_uniform(coarse):
    solution = coarse.solution
    rows = solution.frame.to_rows(solution.state.points.density_ratio)
    behind = solution.frame.row_x < -2 * solution.frame.contact_length
    assert np.ptp(rows[:, behind], axis=1).max() < 1e-4


def test_failed_solve_reports_its_residual(monkeypatch):
    monkeypatch.setattr(SOLVER + "MAX_ITERATIONS", 3)
    frame = create_frame()
    surface = IncrementalRolling(frame, 0.11).surface.moved_to(0.09)
    with pytest.raises(EquilibriumError, match=r"no steady equilibrium: residual \S+ of the nodal forces after \d+ it"):
        SteadySolver(frame, surface).solve(np.zeros_like(frame.nodes))


@pytest.mark.parametrize("shift", [(1.0, 0.0), (0.0, 0.25)], ids=["inverted", "above the axle"])
def test_initial_guess_with_inverted_elements_is_refused(shift):
    frame = create_frame()
    displacement = smooth_displacement(frame)
    displacement[frame.surface_nodes[::2]] = shift
    surface = IncrementalRolling(frame, 0.11).surface.moved_to(0.098)
    with pytest.raises(EquilibriumError, match="no steady equilibrium: elements of the layer invert"):
        SteadySolver(frame, surface).solve(displacement)


def test_penetration_from_beyond_the_roller_is_refused(coarse, layer, roller):
    """The equilibrium is shifted by a radius, so that the mix ahead of the roller lies below it."""
    solution = coarse.solution
    solver = SteadySolver(solution.frame, solution.surface.moved_to(layer.height - 0.002))
    trial = solver.evaluate(solution.state.displacement - [roller.radius, 0.0], solver.initial_pressure)
    with pytest.raises(EquilibriumError, match=r"nodes beyond the roller penetrate it by 0\.0\d+ m"):
        solver.to_equilibrium(trial, 1)


# (c) continuation in the stiffness ratio


def soft_rolling(ratio):
    softer = replace(MIX, unloading_modulus=ratio * MIX.unloading_modulus)
    return IncrementalRolling(create_frame(material=softer), 0.11)


def test_continuation_that_does_not_start_reports_its_ratio(monkeypatch):
    monkeypatch.setattr(SOLVER + "MAX_ITERATIONS", 1)
    with pytest.raises(RuntimeError, match=r"does not start at a stiffness ratio of 0\.\d+: no steady equilibrium"):
        continue_in_stiffness(soft_rolling, 0.098)


def test_continuation_that_ends_reports_its_ratio(monkeypatch):
    monkeypatch.setattr(SOLVER + "MAX_ITERATIONS", 12)
    monkeypatch.setattr(SOLVER + "FIRST_RATIO_STEP", 1e4)
    monkeypatch.setattr(SOLVER + "MIN_LOG_STEP", 20.0)
    with pytest.raises(RuntimeError, match=r"ends at a stiffness ratio of 0\.0\d+: no steady equilibrium"):
        continue_in_stiffness(soft_rolling, 0.098)
