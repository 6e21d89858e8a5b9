"""The steady balance found at once: its sweep against increments of the solid, its derivative, two ways to it."""

from dataclasses import replace

import numpy as np
import pytest

from compact.engines.compaction import streamline_integration as flows
from compact.engines.compaction.engine import roll
from compact.engines.compaction.finite_strain_solid import Solid
from compact.engines.compaction.incremental_rolling import March
from compact.engines.compaction.newton import NotBalancedError
from compact.engines.compaction.roller_frame import Frame, rolling_mesh
from compact.engines.compaction.steady_newton_krylov import Steady, stiffened
from compact.engines.compaction.streamline_integration import StreamlineIntegrator, changes
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller

MIX = Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)
LENGTH = np.sqrt(2 * 0.11 * 0.002)


def layer(finite=True, count=4):
    return Frame(rolling_mesh(0.1, LENGTH, LENGTH / count), MIX, "bonded", LENGTH, finite=finite)


def waved(frame, seed=1):
    """A smooth displacement that presses and shears, none in front and at the base."""
    x, y = frame.nodes.T
    rng = np.random.default_rng(seed)
    shape = (1 - np.tanh((x - 0.02) / 0.02)) / 2 * y / frame.mesh.height
    return np.stack([1e-3 * shape * np.cos(30 * x + rng.uniform()), -2e-3 * shape], axis=-1)


def streamed(frame, gradients):
    stream = StreamlineIntegrator(MIX, frame.fed.state, 1.0, frame.solid.finite, 4)
    return stream, stream.along(np.ascontiguousarray(gradients))


# (a) the sweep is the solid's increment, point after point


@pytest.mark.parametrize("finite", [True, False])
def test_sweep_takes_the_increments_of_the_solid(finite):
    frame = layer(finite)
    gradient = frame.solid.gradient(waved(frame))
    _, flow = streamed(frame, frame.rows(gradient))
    kinematics = Solid(frame.mesh, MIX, finite=finite).kinematics
    state, before = frame.fed.state, np.zeros((len(frame.row_y), 4))
    for j in range(len(frame.row_x) - 1, -1, -1):
        after = frame.rows(gradient)[:, j]
        change = kinematics.between(before, after)
        state, _ = frame.solid._followed(state, change.strain)
        state = replace(state, stress=change.turned(state.stress))
        before = after
        assert flow.numbers[:, j, :4] == pytest.approx(state.stress, abs=1e-4)
        assert flow.numbers[:, j, 4] == pytest.approx(state.density_ratio, rel=1e-12)
    assert flow.plastic_work[:, 0] == pytest.approx(state.plastic_work, rel=1e-9)


def test_derivative_along_rows_meets_differences():
    frame = layer()
    gradients, way = (frame.rows(frame.solid.gradient(waved(frame, seed))) for seed in (1, 2))
    stream, flow = streamed(frame, gradients)
    change = changes(stream.derivatives(gradients, flow), way)
    step = 1e-6
    there, back = (streamed(frame, gradients + sign * step * way)[1].numbers for sign in (1, -1))
    error = np.linalg.norm(((there - back) / (2 * step) - change)[..., :4]) / np.linalg.norm(change[..., :4])
    assert error < 2e-3  # points at the edge of yielding have two derivatives


def test_sweep_in_slices_is_the_same(monkeypatch):
    """An interrupt gets in between two slices."""
    frame = layer()
    gradients = np.ascontiguousarray(frame.rows(frame.solid.gradient(waved(frame))))
    stream, whole = streamed(frame, gradients)
    slopes = stream.derivatives(gradients, whole)
    change = changes(slopes, gradients)
    monkeypatch.setattr(flows, "SLICE", 1)
    assert len(flows._slices(len(gradients), gradients.shape[1])) == len(gradients)
    _, sliced = streamed(frame, gradients)
    assert np.array_equal(sliced.numbers, whole.numbers)
    assert np.array_equal(sliced.work, whole.work)
    assert np.array_equal(stream.derivatives(gradients, sliced), slopes)
    assert np.array_equal(changes(slopes, gradients), change)


def test_mix_that_is_not_moved_stays_as_fed():
    frame = layer()
    _, flow = streamed(frame, np.zeros((*frame.rows(frame.solid.area).shape, 4)))
    assert np.all(flow.numbers[..., :4] == 0)
    assert np.all(flow.numbers[..., 4] == MIX.fed_density_ratio)
    assert np.all(flow.work == 0)


def test_layer_that_folds_over_is_refused():
    frame = layer()
    gradients = np.zeros((*frame.rows(frame.solid.area).shape, 4))
    gradients[3, 5, 0] = -1.5
    with pytest.raises(RuntimeError, match="at point 5 of row 3 of points: the layer folds over"):
        streamed(frame, gradients)


# (b) the balance


@pytest.fixture(scope="module")
def solved():
    return roll(Layer(0.1), Roller(0.11, 0.002, profile="deformed"), MIX, 0.2, increments=4)


def test_steady_balance_is_found_at_once(solved):
    assert solved.march.at_once
    assert solved.equilibrium_residual < 1e-6
    assert solved.yield_residual < 1e-9


@pytest.mark.slow
def test_two_ways_of_coming_there_end_in_one_balance(solved):
    """From 5 % deeper and back again."""
    shallow = Roller(0.11, 0.002, profile="deformed")
    deeper = roll(Layer(0.1), replace(shallow, indentation=0.0021), MIX, 0.2, start=solved)
    back = roll(Layer(0.1), shallow, MIX, 0.2, start=deeper)
    assert back.load == pytest.approx(solved.load, rel=1e-3)
    assert back.resistance == pytest.approx(solved.resistance, rel=1e-3)


def test_nothing_stands_in_the_roller_where_it_touches(solved):
    march = solved.march
    touching = march.push.pressure > 0
    assert np.abs(march.push.gap[touching]).max() < 1e-6 * solved.indentation
    assert march.push.gap.min() > -1e-6 * solved.indentation


def test_mix_behind_the_roller_hardly_changes(solved):
    march = solved.march
    rows = march.frame.rows(march.condition.state.density_ratio)
    behind = march.frame.row_x < -2 * march.frame.length
    assert np.ptp(rows[:, behind], axis=1).max() < 1e-4


def test_far_from_a_balance_it_says_what_it_reached(monkeypatch):
    monkeypatch.setattr("compact.engines.compaction.steady_newton_krylov.ITERATIONS", 5)
    frame = layer()
    face = March(frame, 0.11).face.at(0.09)
    with pytest.raises(NotBalancedError, match=r"no steady balance: after \d+ iterations \S+ of the forces stay"):
        Steady(frame, face).balanced(np.zeros_like(frame.nodes))


@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 0.25)], ids=["folded over", "above the axle"])
def test_layer_far_out_of_place_is_refused_in_words(way):
    frame = layer()
    moved = waved(frame)
    moved[frame.surface[::2]] = way
    with pytest.raises(NotBalancedError, match="no steady balance: elements of the layer fold over"):
        Steady(frame, March(frame, 0.11).face.at(0.098)).balanced(moved)


# (c) from soft mix


def soft_march(share):
    mix = replace(MIX, unloading_modulus=share * MIX.unloading_modulus)
    return March(Frame(rolling_mesh(0.1, LENGTH, LENGTH / 4), mix, "bonded", LENGTH), 0.11)


def test_softest_mix_that_is_not_found_from_rest_is_told(monkeypatch):
    monkeypatch.setattr("compact.engines.compaction.steady_newton_krylov.ITERATIONS", 1)
    with pytest.raises(RuntimeError, match=r"not found even with 0\.\d+ of the unloading modulus: no steady balance"):
        stiffened(soft_march, 0.098)


def test_stiffening_that_stops_tells_how_far_it_came(monkeypatch):
    monkeypatch.setattr("compact.engines.compaction.steady_newton_krylov.ITERATIONS", 12)
    monkeypatch.setattr("compact.engines.compaction.steady_newton_krylov.FIRST", 1e4)
    monkeypatch.setattr("compact.engines.compaction.steady_newton_krylov.SHORTEST", 20.0)
    with pytest.raises(RuntimeError, match=r"found up to 0\.0\d+ of the unloading modulus, then: no steady balance"):
        stiffened(soft_march, 0.098)
