"""Drives under a resistance along the stroke: work, limits, mirror, memory of the turns, hard cases."""

import itertools
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from machine_cases import CART, HYDRAULIC, KLOSS, MASS, SIZE, published_law
from published import CART_OF_C

from compact import turning
from compact.drive import Crank, Rigid, simulate
from compact.machine import elastic_motion
from compact.machine.crankshaft import simulate_crankshaft
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.machine.elastic_motion import CartMotion
from compact.machine.motor_drive import Motor
from compact.motion.laws import LAWS
from compact.numerics.piecewise import PiecewisePolynomial
from compact.resistance import dry_resistance, tabulated_resistance
from compact.turning import StrokeResistance, table_share

LENGTH, DEPTH, RELEASE = 0.0215, 2.1e-3, 0.17e-3  # of the contact [m]
SLOW_RELEASE = 0.014 * LENGTH  # [m], of an imprint, with which one drive has no periodic regime
STROKE, DURATION = 0.4, 0.889
DRY = dry_resistance(SIZE)
MAP = tabulated_resistance((0.01, 0.1, 0.4, 2.0), (2.2e3, 3.0e3, 3.3e3, 3.4e3), (-30.0, -10.0, -5.0, -1.0), 0.05)


def wave(edge, bow_wave=1.21 * DEPTH):
    return turning.wave_shares(LENGTH, DEPTH, bow_wave, RELEASE, edge)


def imprint(edge, exponent=0.7):
    return turning.imprint_shares(LENGTH, exponent, SLOW_RELEASE, edge)


def table(*rows):
    return (table_share(*zip(*rows, strict=True)),) * 2


def along(forward, backward=None, resistance=DRY):
    (force, load), (back, back_load) = forward, backward or forward
    return StrokeResistance(resistance, force, back, load, back_load)


def elastic(stiffness=1e6, ratio=0.05, **options):
    return ElasticDrive(stiffness, 2 * ratio * math.sqrt(stiffness * MASS), **options)


def periodic(resistance, name="complex", drive=None, cart=CART_OF_C):
    return simulate_elastic(cart, drive or elastic(), published_law(name, DURATION), resistance)


CASES = {
    "wave": (along(wave(0.110)), {}),
    "both sides differ": (along(wave(0.110), imprint(0.154)), {}),
    "imprint": (along(imprint(0.110)), {}),
    "table": (along(table((0.0, 0.0), (0.05, 1.0))), {}),
    "bow wave longer than the stroke": (along(wave(0.110, 5 * DEPTH)), {}),
    "own track longer than the stroke": (along(wave(0.6)), {}),
    "open to the roller": (along(wave(0.0)), {}),
    "imprint below the roller": (along(imprint(0.3 * LENGTH)), {}),
    "soft spring": (along(wave(0.110)), {"stiffness": 1.2e4, "ratio": 0.3}),
    "sticks": (along(table((0.0, 0.6), (0.05, 1.0))), {"stiffness": 1.5e4, "ratio": 0.3}),
    "backlash": (along(wave(0.110)), {"ratio": 0.2, "backlash": 1e-3}),
    "map": (along(wave(0.110), resistance=MAP), {}),
    "return over compacted mix": (along(wave(0.110), resistance=replace(MAP, return_ratio=0.4)), {}),
}


# closed form


def test_lift_of_the_rollers_on_the_own_track_is_a_quarter():
    run = periodic(along(wave(0.6)), cart=replace(CART_OF_C, guide_friction=0.0))
    reactions = run.state.forces.front_reaction + run.state.forces.rear_reaction
    lift = sum(CART_OF_C.roller_reactions)
    assert reactions == pytest.approx(np.full(len(reactions), 0.25 * lift - CART_OF_C.weight), abs=1e-6 * lift)


@pytest.mark.parametrize("name", ["wave", "imprint", "own track longer than the stroke", "table"])
def test_rigid_drive_does_the_work_of_the_share_over_the_travel(name):
    """Without guides int H dx = F int g ds over both strokes; the kinetic energy comes back."""
    resistance, _ = CASES[name]
    run = simulate(CART, Rigid(), published_law("complex", DURATION), resistance)
    travel = np.union1d(np.linspace(0, STROKE, 200_001), np.linspace(0, 0.01, 100_001))
    work = SIZE * sum(np.trapezoid(shares.force_share(travel), travel) for shares in resistance.over(STROKE))
    assert run.energy == pytest.approx(work, rel=1e-6)
    assert np.sum(run.weights * run.state.resistance * run.state.velocity) == pytest.approx(work, rel=1e-6)


DRIVES = {
    "rigid": Rigid(),
    "elastic": elastic(ratio=0.2),
    "motor": Motor(KLOSS, 145.0, 0.1, 0.0),
    "hydraulic": HYDRAULIC,
}
every_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES.keys())


@every_drive
def test_share_of_one_is_the_step_for_every_drive(drive):
    law = published_law("quintic")
    one, step = (simulate(CART_OF_C, drive, law, each) for each in (along(table((0.0, 1.0))), DRY))
    assert one.peak_force == pytest.approx(step.peak_force, rel=1e-7)
    assert one.peak_power == pytest.approx(step.peak_power, rel=1e-7)
    assert one.energy == pytest.approx(step.energy, rel=1e-7)


@pytest.mark.sampled(6)
@every_drive
@pytest.mark.parametrize("name", ["wave", "both sides differ", "table", "bow wave longer than the stroke"])
def test_every_drive_does_the_work_against_mix_and_guides(drive, name):
    run = simulate(CART_OF_C, drive, published_law("quintic"), CASES[name][0])
    state = run.state
    losses = np.sum(run.weights * (state.resistance + state.forces.guide_friction) * state.velocity)
    damped = run.drive.damping * run.motion.elongation_rate**2 * run.weights if hasattr(run, "motion") else 0.0
    assert losses + np.sum(damped) == pytest.approx(run.energy, rel=1e-6)
    assert getattr(run, "energy_residual", 0.0) < 1e-6


@pytest.mark.parametrize("name", ["wave", "both sides differ", "imprint", "table"])
def test_stiff_drive_has_the_forces_of_a_rigid_one(name):
    law, (resistance, _) = published_law("septic", DURATION), CASES[name]
    rigid = simulate(CART, Rigid(), law, resistance)
    run = simulate_elastic(CART, elastic(1e14, 1.0), law, resistance)
    assert run.peak_force == pytest.approx(rigid.peak_force, rel=1e-4)
    assert run.peak_power == pytest.approx(rigid.peak_power, rel=1e-4)
    assert run.energy == pytest.approx(rigid.energy, rel=1e-6)


def test_rigid_drive_holds_the_mix_in_a_dwell():
    resistance, _ = CASES["wave"]
    run = simulate(CART, Rigid(), published_law("quintic").cycle(far_dwell=1.0), resistance)
    dwell, last = run.direction == 0, resistance.over(STROKE)[0]
    assert run.drive_force[dwell] == pytest.approx(np.full(dwell.sum(), SIZE * float(last.force_share(STROKE))))
    reactions = (run.state.forces.front_reaction + run.state.forces.rear_reaction)[dwell]
    lift = float(last.load_share(STROKE)) * sum(CART.roller_reactions) - CART.weight
    assert reactions == pytest.approx(np.full(dwell.sum(), lift))


def test_crankshaft_has_the_resistance_of_its_carts():
    resistance, _ = CASES["wave"]
    crank = Crank(0.2, 0.8)
    shaft = simulate_crankshaft(CART_OF_C, crank, 3.5, resistance, (0.0, math.pi / 2))
    alone = simulate(CART_OF_C, crank, published_law("crank", math.pi / 3.5), resistance)
    assert shaft.carts[0].forces.drive_force.max() == pytest.approx(alone.drive_force.max(), rel=1e-5)
    assert np.sum(shaft.weights * shaft.torque) == pytest.approx(2 * alone.energy, rel=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["wave", "table"])
def test_hydraulic_stroke_follows_the_law(name):
    run = simulate(CART_OF_C, HYDRAULIC, published_law("quintic"), CASES[name][0])
    stroke = run.simulate_stroke()
    assert np.abs(stroke.position - published_law("quintic").position(stroke.time)).max() < 2e-3 * STROKE
    assert stroke.energy_residual < 1e-6


# independent solutions


class NaiveMemory:
    """Share of the force along a path, by the definitions of `compact.turning`, one small move at a time."""

    def __init__(self, share, stroke):
        self.share, self.front, self.origin = share, {1: share.distance, -1: 0.0}, {1: 0.0, -1: -stroke}
        self.heading, self.turn, self.released, self.value = -1, 0.0, 0.0, float(share(stroke))

    def first(self, heading, place):
        share, front, origin = self.share, self.front[heading], self.origin[heading]
        if place >= front:
            return float(share(place - origin))
        rise = float(share(front - origin)) - share.track
        return share.track + rise * math.exp(-(front - place) / share.release)

    def move(self, before, after):
        heading = 1 if after > before else -1
        if heading != self.heading:
            place = heading * before
            self.released = self.value + self.first(heading, place)
            self.heading, self.turn = heading, place
        place = heading * after
        self.value = self.first(heading, place)
        self.value -= self.released * math.exp(-(place - self.turn) / self.share.release)
        self.front[heading] = max(self.front[heading], place)
        if self.front[-heading] + place > self.share.distance:
            self.front[-heading], self.origin[-heading] = self.share.distance - place, -place
        return self.value


@pytest.mark.parametrize("share", [wave(0.110), imprint(0.110), wave(0.0)], ids=["wave", "imprint", "open"])
def test_turns_in_mid_stroke_meet_the_old_front_again(share):
    """Reversals by less and by more than the own track, on a drive so stiff that it imposes the motion."""
    places = [0.0, 0.3, 0.27, 0.2999, 0.2998, 0.35, 0.2, 0.24, 0.23, 0.4, 0.0, 0.1]
    time = np.arange(len(places), dtype=float)
    rows = [[start, 0, 0, *(np.array([10, -15, 6]) * (end - start))] for start, end in pairwise(places)]
    driven_end = PiecewisePolynomial(time, np.pad(np.array(rows), ((0, 0), (0, 5))))
    problem = CartMotion(CART, elastic(1e10, 1.0), published_law("quintic", 3.0).cycle(), along(share), 1e-8)
    motion = problem.integrate(driven_end, problem.rest_state).samples
    memory, shares, last = NaiveMemory(share[0], STROKE), [], 0.0
    for place in motion.position:
        if abs(place - last) > 1e-11:  # less is rounding where two steps join
            memory.move(last, place)
            last = place
        shares.append(memory.value)
    begun = (motion.position > 1e-6) & (np.abs(motion.velocity) > 1e-5)
    assert motion.force_share[begun] == pytest.approx(np.array(shares)[begun], abs=2e-3)
    steady = SIZE * np.sign(motion.velocity[begun])
    assert motion.resistance[begun] == pytest.approx(steady * motion.force_share[begun], abs=1e-4 * SIZE)


@pytest.mark.slow
@pytest.mark.parametrize("share", [wave(0.110), imprint(0.110)], ids=["wave", "imprint"])
def test_periodic_regime_agrees_with_many_small_steps(share):
    law, drive, count = published_law("complex", DURATION), elastic(1e6, 0.2), 20_000
    run, cycle = periodic(along(share), "complex", drive, CART), law.cycle()
    time = (np.arange(count) + 0.5) / count * cycle.period
    place, pace = (cycle.derivative(time, order).tolist() for order in (0, 1))
    memory, x, v, step, forces = NaiveMemory(share[0], STROKE), 0.0, 0.0, cycle.period / count, []
    for i in range(6 * count):
        k = i % count
        forces.append(drive.stiffness * (place[k] - x) + drive.damping * (pace[k] - v))
        v += step * (forces[-1] - memory.heading * SIZE * memory.value) / MASS
        memory.move(x, x + step * v)
        x += step * v
    last = np.array(forces[-count:])
    assert np.abs(last).max() == pytest.approx(run.peak_force, rel=3e-3)
    assert np.mean(last * pace) == pytest.approx(run.mean_power, rel=3e-3)


# properties


@pytest.mark.parametrize("case", CASES)
def test_periodic_regime_balances_its_work_and_closes(case):
    """The share at each place of a full stroke follows from the travel alone once the old force has gone."""
    resistance, options = CASES[case]
    run = periodic(resistance, drive=elastic(**options))
    state, motion, trajectory = run.state, run.motion, run.trajectory
    losses = (state.resistance + state.forces.guide_friction) * state.velocity
    losses = losses + run.drive.damping * motion.elongation_rate**2
    assert np.sum(run.weights * losses) == pytest.approx(run.energy, rel=1e-6)
    assert run.energy_residual < 1e-6
    # the mix pushes by its share of the steady force
    moving = np.abs(state.velocity) > 1e-3
    steady = resistance.resistance(state.velocity[moving], np.zeros(np.count_nonzero(moving)))
    assert state.resistance[moving] == pytest.approx(steady * motion.force_share[moving], rel=1e-9, abs=1e-6)
    friction = state.forces.guide_friction[moving]
    reactions = np.abs(state.forces.front_reaction) + np.abs(state.forces.rear_reaction)
    expected = np.sign(state.velocity[moving]) * CART_OF_C.guide_friction * reactions[moving]
    assert friction == pytest.approx(expected, abs=1e-4 * SIZE)
    start, end = (trajectory.samples.force_share[i] for i in (0, -1))
    assert end == pytest.approx(start, abs=1e-6)
    first, last = (trajectory.at(np.array([time])).resistance for time in (0.0, 2 * DURATION * (1 - 1e-12)))
    assert first == pytest.approx(last, abs=1e-3 * SIZE)


@pytest.mark.sampled(4)
@every_drive
@pytest.mark.parametrize("name", ["both sides differ", "imprint"])
def test_mirror_of_the_stroke_exchanges_the_sides(drive, name):
    resistance, _ = CASES[name]
    mirrored = along((resistance.backward, resistance.backward_load), (resistance.forward, resistance.forward_load))
    run, other = (simulate(CART, drive, published_law("quintic"), each) for each in (resistance, mirrored))
    assert other.peak_force == pytest.approx(run.peak_force, rel=1e-6)
    assert other.peak_power == pytest.approx(run.peak_power, rel=1e-6)
    assert other.energy == pytest.approx(run.energy, rel=1e-6)


# hard cases


@pytest.mark.parametrize("harmonic", [1, 3, 5, 7])
def test_undamped_drive_at_a_resonance_is_held_by_the_mix(harmonic):
    """The law excites odd harmonics of its cycle; mix and guides take what they supply."""
    drive = ElasticDrive(MASS * (harmonic * np.pi / DURATION) ** 2, 0.0)
    run = periodic(along(wave(0.110)), "cubic", drive=drive)
    assert run.energy_residual < 1e-6
    assert run.peak_force < 5 * SIZE


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rounding", [0.0, 1e-12, -3e-12, 1e-9])
def test_drive_without_a_periodic_regime_is_told(rounding):
    """Its cycles do not settle, whatever the rounding."""
    with pytest.raises(RuntimeError, match=r"no periodic regime found in \d+ cycles"):
        periodic(along(imprint(0.110)), "cycloidal", drive=elastic(3e5 * (1 + rounding), 0.01))


@pytest.mark.parametrize("name", ["wave", "imprint", "both sides differ", "return over compacted mix", "map"])
def test_mix_with_a_release_neither_jumps_nor_holds_the_cart(name):
    resistance, options = CASES[name]
    run = periodic(resistance, drive=elastic(**options), cart=CART)
    assert run.stick_time == 0
    assert run.shocks == ()
    assert np.abs(np.diff(run.motion.resistance)).max() < 0.5 * SIZE


def test_cart_that_sticks_for_most_of_the_cycle():
    """A table restarts with a jump, which holds the cart; without one the guides alone do."""
    held, _ = CASES["sticks"]
    law = published_law("complex")
    run, free = (simulate_elastic(CART_OF_C, elastic(1.5e4, 0.3), law, each) for each in (held, CASES["wave"][0]))
    assert 0.6 < run.stick_time / run.period < 0.9
    assert free.stick_time < 0.1 * run.stick_time
    assert run.energy_residual < 1e-6


def test_regime_that_is_reached_slowly_is_found(monkeypatch):
    """By plain cycles, as long as they settle; a limit of cycles is told as such."""
    case = along(wave(0.110)), "quintic"
    expected = periodic(*case, drive=elastic(3e5, 0.02)).peak_force
    monkeypatch.setattr(elastic_motion, "DECIDING_CYCLES", 1)  # no acceleration
    assert periodic(*case, drive=elastic(3e5, 0.02)).peak_force == pytest.approx(expected, rel=1e-6)
    monkeypatch.setattr(elastic_motion, "MAX_CYCLES", 5)
    with pytest.raises(RuntimeError, match="a periodic regime is not decided in 5 cycles"):
        periodic(*case, drive=elastic(3e5, 0.02))


def test_share_costs_few_evaluations():
    run = periodic(along(wave(0.110)))
    assert run.cost.intervals < 3000
    assert len(run.trajectory.rows) < 200


@pytest.mark.slow
@pytest.mark.parametrize("share", [wave(0.110), imprint(0.110)], ids=["wave", "imprint"])
def test_all_laws_behind_twelve_drives_cost_few_evaluations(share):
    """7 s of one processor; a soft drive without a periodic regime is told."""
    intervals, told = 0, 0
    for stiffness, ratio, name in itertools.product((3e5, 1e6, 3e6, 1e7), (0.02, 0.05, 0.2), LAWS):
        try:
            intervals += periodic(along(share), name, drive=elastic(stiffness, ratio)).cost.intervals
        except RuntimeError as error:
            told += "no periodic regime" in str(error)
    assert intervals < 24000
    assert told <= 4


@pytest.mark.parametrize(("name", "duration"), [("harmonic", 3.0), ("harmonic", 8.0), ("cubic", 8.0)])
def test_creep_at_a_knot_of_the_resistance_takes_few_steps(name, duration):
    """The speed of a slow cart is known to the tolerance only; by a band of rounding it passed a knot 20 000 times."""

    def rate_law(velocity, acceleration):
        return 3486.0 * np.sign(velocity) * np.abs(velocity / 0.45) ** 0.02

    resistance = replace(CASES["wave"][0], resistance=rate_law)
    law = published_law(name, duration)
    fine, coarse = (
        simulate_elastic(CART, replace(elastic(1e6, 0.05), tolerance=at), law, resistance) for at in (1e-8, 1e-4)
    )
    assert coarse.cost.intervals < 1000
    assert [coarse.peak_force, coarse.peak_power] == pytest.approx([fine.peak_force, fine.peak_power], rel=1e-4)
