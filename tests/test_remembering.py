"""Resistance that remembers behind drives that make their own motion: limits, order, independent solutions, cost."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from published import CART_OF_C
from scipy.integrate import solve_ivp

from compact import memory as memories
from compact import shaft_memory, sprung_memory
from compact.drive import Rigid, simulate
from compact.elastic import ElasticDrive, travel
from compact.hydraulic import Hydraulic, passage
from compact.imprint import rolled
from compact.memory import Columns, Memory, _shape
from compact.motion import law
from compact.motor import Motor, revolve
from compact.polynomials import Pieces
from compact.resistance import ResistanceMap
from compact.resisted import MIX
from compact.runup import runup
from compact.torque import Straight

SMOOTH = replace(CART_OF_C, guide_friction=0.0)
MASS = SMOOTH.mass
RADIUS, HALF_LENGTH, STROKE = 0.11, 0.02, 0.1
BRANCHES = ((1.0, 0.1),)
LARGEST = 3000.0  # N, of k m_ss
OIL = Hydraulic(2e-3, 10e6, 1e-3, 1e-4, 0.7, 870.0, 1e5, 1.4e9, 1e-4)


def columns():
    return Columns(RADIUS, HALF_LENGTH, BRANCHES)


@pytest.fixture(scope="module")
def memory():
    """Columns, and a map of steady speeds that is theirs but for a tenth that grows with the speed."""
    shape = _shape(BRANCHES, 1.0 / HALF_LENGTH)
    speeds, forces = shape.speeds * HALF_LENGTH, shape.forces * HALF_LENGTH**4 / RADIUS**2
    stiffness = LARGEST / forces.max()
    steady = ResistanceMap(speeds, stiffness * forces * (1 + 0.1 * np.tanh(speeds / 0.1)), 0.0)
    return Memory(steady, stiffness, columns(), shape)


def spring(stiffness, ratio):
    return ElasticDrive(stiffness, 2 * ratio * math.sqrt(stiffness * MASS))


def motor(flywheel=500.0, angles=(0.0,), times=1.0):
    return Motor(Straight(60.0 * times, 150.0), 50.0, 0.05 * times, flywheel * times, angles=angles)


def cycle(name="quintic", duration=1.0):
    return law(name, STROKE, duration).cycle()


def plain(memory, spacing):
    """(z at rest, force(x, v, z), dz/dt(x, z)) of columns written out, all of them differential equations in time."""
    place = np.arange(-2.5 * HALF_LENGTH, STROKE + 2.5 * HALF_LENGTH, spacing)
    shares, times = np.array(BRANCHES).T[:, :, None]

    def print_of(x, z):
        free = (shares * z).sum(0) / (1 + shares.sum())
        return np.maximum((HALF_LENGTH**2 - (place - x) ** 2) / (2 * RADIUS), free)

    def force(x, v, z):
        w = print_of(x, z)
        m = (w + (shares * (w - z)).sum(0)) @ (place - x) * spacing / RADIUS
        return float(memory.steady(v) + memory.stiffness * memory.lacking(m, v))

    def relaxing(x, z):
        return (print_of(x, z) - z) / times

    rest = np.maximum((HALF_LENGTH**2 - place**2) / (2 * RADIUS), 0.0)
    return np.tile(rest, (len(BRANCHES), 1)), force, relaxing


# an independent solution: cart, shaft and columns as one system of differential equations


@pytest.fixture(scope="module")
def sprung(memory):
    """x(t), x'(t) of a cart behind a soft spring, on its way there from rest, by a general solver."""
    (rest, force, relaxing), there, drive = plain(memory, HALF_LENGTH / 40), cycle(), spring(1e5, 0.1)

    def rates(time, state):
        x, v, z = state[0], state[1], state[2:].reshape(rest.shape)
        pull = drive.stiffness * (there.position(time) - x) + drive.damping * (there.velocity(time) - v)
        return np.concatenate([[v, (pull - force(x, v, z)) / MASS], relaxing(x, z).ravel()])

    start = np.concatenate([[0.0, 0.0], rest.ravel()])
    return solve_ivp(rates, (0, 1.0), start, "DOP853", rtol=1e-6, atol=1e-9, max_step=5e-3, dense_output=True).sol


def missed(memory, sprung):
    run = travel(SMOOTH, spring(1e5, 0.1), cycle(), memory, regime="rest")
    there = run.time <= 1.0
    return np.abs(run.state.position - sprung(run.time)[0])[there].max()


def test_elastic_drive_meets_the_coupled_equations_with_the_square_of_the_window(memory, sprung, monkeypatch):
    fine = missed(memory, sprung)
    monkeypatch.setattr(memories, "COLUMNS", memories.COLUMNS // 2)
    monkeypatch.setattr(memories, "INSTANTS", memories.INSTANTS // 2)
    coarse = missed(memory, sprung)
    assert fine < 3e-4 * STROKE
    assert math.log2(coarse / fine) == pytest.approx(2, abs=0.3)


def test_motor_drive_meets_the_coupled_equations(memory):
    (rest, force, relaxing), turn, drive = plain(memory, HALF_LENGTH / 20), cycle(), motor(5.0)
    run = revolve(SMOOTH, drive, turn, memory)
    rate = turn.period / (2 * np.pi)

    def travelled(angle):
        return [float(turn.derivative(angle % (2 * np.pi) * rate, k)) * rate**k for k in range(3)]

    def rates(time, state):
        angle, speed, z = state[0], state[1], state[2:].reshape(rest.shape)
        x, slope, bend = travelled(angle)
        taken = slope * (MASS * bend * speed**2 + force(x, slope * speed, z))
        pace = (drive.torque(speed) - taken) / (drive.inertia + MASS * slope**2)
        return np.concatenate([[speed, pace], relaxing(x, z).ravel()])

    start = np.concatenate([[0.0, run.speed[0]], rest.ravel()])
    done = solve_ivp(rates, (0, 1.6 * run.period), start, "DOP853", rtol=1e-6, max_step=0.02, dense_output=True)
    angle, speed = done.sol(np.linspace(0, done.t[-1], 20_001))[:2]
    part, forgetful = run.angle <= 1.1 * np.pi, revolve(SMOOTH, drive, turn, memory.steady)
    found = np.interp(2 * np.pi + run.angle[part], angle, speed)
    assert found == pytest.approx(run.speed[part], rel=1e-4)
    assert np.abs(np.interp(run.angle[part], forgetful.angle, forgetful.speed) / found - 1).max() > 2e-3


# limits


@pytest.mark.parametrize("regime", ["rest", "periodic"])
def test_elastic_drive_without_stiffness_of_the_columns_is_as_without_memory(memory, regime):
    forgetful = replace(memory, stiffness=0.0)
    runs = [travel(CART_OF_C, spring(1e6, 0.05), cycle(), met, regime=regime) for met in (forgetful, memory.steady)]
    assert runs[0].peak_force == pytest.approx(runs[1].peak_force, rel=1e-7)
    assert runs[0].energy == pytest.approx(runs[1].energy, rel=1e-7)
    assert runs[0].standing == pytest.approx(runs[1].standing, abs=1e-7)


def test_motor_drive_without_stiffness_of_the_columns_is_as_without_memory(memory):
    runs = [revolve(CART_OF_C, motor(), cycle(), met) for met in (replace(memory, stiffness=0.0), memory.steady)]
    assert runs[0].peak_force == pytest.approx(runs[1].peak_force, rel=1e-7)
    assert runs[0].period == pytest.approx(runs[1].period, rel=1e-9)


def test_stiff_spring_is_the_rigid_drive(memory):
    turn, misses = cycle("septic"), []
    rigid = simulate(SMOOTH, Rigid(), turn, memory)
    for stiffness in (1e7, 1e8):
        run = travel(SMOOTH, spring(stiffness, 0.7), turn, memory)
        force = np.interp(run.time, rigid.time, rigid.state.resistance)
        misses.append(np.abs(run.state.resistance - force).max() / rigid.peak_force)
    assert misses[0] < 0.03
    assert misses[1] < misses[0] / 6  # with 1/k, down to the columns' own 1e-3
    assert np.abs(turn.position(run.time) - run.state.position).max() < 1e-3 * STROKE


def test_even_shaft_is_the_rigid_drive(memory):
    heavy = revolve(CART_OF_C, motor(flywheel=1e6), cycle(), memory)
    turn = cycle(duration=heavy.period / 2)
    rigid = simulate(CART_OF_C, Rigid(), turn, memory)
    force = np.interp(heavy.time, rigid.time, rigid.state.resistance)
    assert heavy.state.resistance == pytest.approx(force, abs=3e-3 * rigid.peak_force)


def test_slow_motion_is_quasi_steady(memory):
    misses = []
    for duration in (1.0, 6.0):
        run = travel(SMOOTH, spring(1e6, 0.7), cycle("septic", duration), memory)
        misses.append(np.abs(run.state.resistance - memory.steady(run.state.velocity)).max() / LARGEST)
    assert misses[0] > 0.3
    assert misses[1] < 0.06


# balances and the periodic regime


@pytest.mark.parametrize("regime", ["rest", "periodic"])
@pytest.mark.parametrize("stiffness", [1e5, 1e9])
def test_energy_of_the_elastic_drive_closes(memory, stiffness, regime):
    run = travel(CART_OF_C, spring(stiffness, 0.05), cycle("parabolic"), memory, regime=regime)
    assert run.energy_residual < 1e-9
    state = run.state
    balance = run.drive_force - MASS * state.acceleration - state.resistance - state.forces.guide_friction
    assert np.abs(balance).max() < 1e-6 * run.peak_force


def test_energy_of_the_motor_drive_closes(memory):
    assert revolve(CART_OF_C, motor(), cycle("parabolic"), memory).energy_residual < 1e-8


def test_periodic_regime_remembers_its_own_cycles(memory):
    run = travel(CART_OF_C, spring(1e6, 0.05), cycle(), memory)
    starts, arcs = np.unique(run.course.arcs.start, return_index=True)
    windows = np.diff(run.course.arcs.given[arcs, MIX, 1], prepend=np.nan) != 0  # within one, D is straight
    starts, arcs = starts[windows], arcs[windows]
    position = run.course.motion(arcs, 0.0 * arcs)[0]
    time = np.concatenate([starts + turn * run.period for turn in range(4)])
    beyond = 100 * memory.columns.spacing  # columns at the same places
    whole = memory.columns.imprint(-beyond, STROKE + beyond, position[0])
    m = rolled(whole, time, np.tile(position, 4))[-len(starts) :]
    assert memory.stiffness * m == pytest.approx(run.course.given(arcs, 0.0 * arcs), abs=5e-4 * LARGEST)


def test_backlash_and_end_springs_go_with_a_memory(memory):
    from compact.springs import EndSprings

    cart = replace(CART_OF_C, end_springs=EndSprings(2e4, 100.0, 0.02, STROKE))
    run = travel(cart, replace(spring(1e6, 0.1), backlash=2e-4), cycle(), memory)
    assert {0, 1, -1} == set(run.course.arcs.side)
    assert run.energy_residual < 1e-9


def test_guides_that_a_force_of_the_mix_loads_take_their_friction(memory):
    light = replace(CART_OF_C, weight=19480.0, guide_friction=0.05)  # all of the guides' load is from the mix
    run = travel(light, spring(1e6, 0.1), cycle(), memory)
    moves = np.abs(run.state.velocity) > 0.01
    share = 0.05 * 2 * 0.21 / 0.74
    wanted = share * np.abs(run.state.resistance) * np.sign(run.state.velocity)
    assert run.state.forces.guide_friction[moves] == pytest.approx(wanted[moves], abs=2e-2 * share * LARGEST)


def test_two_carts_abreast_are_one_on_half_the_shaft(memory):
    one, two = motor(), motor(angles=(0.0, 0.0), times=2.0)
    runs = [revolve(CART_OF_C, drive, cycle(), memory) for drive in (one, two)]
    assert runs[1].peak_force == pytest.approx(runs[0].peak_force, rel=1e-7)
    assert runs[1].period == pytest.approx(runs[0].period, rel=1e-9)


def test_hydraulic_drive_follows_the_law_against_a_memory(memory):
    run = simulate(CART_OF_C, OIL, cycle(), memory)
    rigid = simulate(CART_OF_C, Rigid(), cycle(), memory)
    assert run.peak_force == rigid.peak_force
    assert run.energy_residual < 1e-9


# cost


def test_two_or_three_trials_meet_a_window(memory):
    run = travel(CART_OF_C, spring(1e6, 0.05), cycle(), memory)
    assert run.work.trials < 3.2 * run.work.arcs
    assert len(run.work.seams) <= 4
    assert run.work.seams[1] < 1e-3 * run.work.seams[0]


@pytest.mark.parametrize("flywheel", [5.0, 5000.0])
def test_rounds_of_shaft_and_memory_converge_geometrically(memory, flywheel):
    changes = revolve(CART_OF_C, motor(flywheel), cycle(), memory).load.recalled.changes
    assert len(changes) <= 8
    assert max(after / before for before, after in pairwise(changes)) < 0.15


# refusals


@pytest.mark.parametrize(
    ("setting", "few", "words"),
    [
        ("SEAMS", 1, "no periodic regime of what the mix remembers found in 1 rounds: the last ones changed the force"),
        ("TRIALS", 1, "trials do not meet the force of the mix"),
    ],
)
def test_elastic_drive_that_is_not_met_is_told(memory, monkeypatch, setting, few, words):
    monkeypatch.setattr(sprung_memory, setting, few)
    with pytest.raises(RuntimeError, match=words):
        travel(CART_OF_C, spring(1e6, 0.05), cycle(), memory)


def test_cart_that_leaves_the_columns_is_told(memory, monkeypatch):
    monkeypatch.setattr(sprung_memory, "ROOM", 1e-3)
    with pytest.raises(RuntimeError, match="it swings much farther than its largest force stretches the spring"):
        travel(SMOOTH, spring(1.3e4, 0.0), cycle("harmonic"), memory.scaled(0.02), regime="rest")


def test_motor_drive_that_is_not_met_is_told(memory, monkeypatch):
    monkeypatch.setattr(shaft_memory, "ROUNDS", 2)
    with pytest.raises(RuntimeError, match="shaft and memory do not meet in 2 rounds: the last changed the force by"):
        revolve(CART_OF_C, motor(), cycle(), memory)


def test_what_a_memory_does_not_go_with_is_refused(memory):
    with pytest.raises(ValueError, match="`resistance` with a memory is for periodic turns, got a `start_speed`"):
        revolve(CART_OF_C, motor(), cycle(), memory, start_speed=3.0)
    with pytest.raises(ValueError, match="`resistance` with a memory has no run-up"):
        runup(CART_OF_C, motor(), cycle(), memory)
    wide = Pieces(np.array([0.0, 1.0]), np.array([[1e-4]]))
    for remembering in (memory, memory.along(cycle())):
        with pytest.raises(ValueError, match="`resistance` with a memory needs a motion that is imposed"):
            passage(CART_OF_C, OIL, STROKE, (wide, wide), remembering)
