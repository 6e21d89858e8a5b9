"""One battery over all drives: energy balance, limit to rigid, both strokes alike, period, refinement, peaks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, HYDRAULIC, KLOSS, MASS, SIZE, dry, friction, stribeck
from published import CART_OF_C

from compact.drive import Crank, Rigid, simulate
from compact.machine.cart import EndSprings
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.machine.motor_drive import Motor, simulate_motor
from compact.motion.profile import law

CARTS = {"bare": CART, "end springs": replace(CART, end_springs=EndSprings(4e3, 0.0, 0.08, stroke=0.4))}
DRIVES = {
    "rigid": Rigid(),
    "crank": Crank(0.2, 0.8),
    "elastic": ElasticDrive(1e6, 0.1 * math.sqrt(1e6 * MASS)),
    "backlash": ElasticDrive(1e6, 0.1 * math.sqrt(1e6 * MASS), 1e-3),
    "motor": Motor(KLOSS, 150.0, 1e-3, 20.0),
    "hydraulic": HYDRAULIC,
}
# drives that impose their law, and the tolerance of it
IMPOSING = {
    "elastic": (ElasticDrive(1e9, 1.4 * math.sqrt(1e9 * MASS)), "septic", 1e-3),
    "motor": (Motor(KLOSS, 150.0, 0.0, 1e9), "cubic", 1e-6),
    "hydraulic": (HYDRAULIC, "septic", 1e-12),
}


def law_of(drive, name, duration=3.0):
    return law("crank" if drive == "crank" else name, stroke=0.4, duration=duration, rod_length=0.8)


@pytest.mark.parametrize("cart", CARTS)
@pytest.mark.parametrize("name", ["cubic", "septic"])
@pytest.mark.parametrize("drive", DRIVES)
def test_work_of_the_drive_is_that_of_the_resistance_and_of_its_damper(drive, name, cart):
    run = simulate(CARTS[cart], DRIVES[drive], law_of(drive, name), dry)
    lost = 0.0
    if drive in ("elastic", "backlash"):
        lost = DRIVES[drive].damping * np.sum(run.weights * run.motion.elongation_rate**2)
    work = np.sum(run.weights * run.state.resistance * run.state.velocity)
    assert run.energy == pytest.approx(work + lost, rel=1e-6)
    if not lost:
        assert work == pytest.approx(0.8 * SIZE, rel=1e-6)
    assert getattr(run, "energy_residual", 0.0) < 1e-6


@pytest.mark.parametrize("cart", CARTS)
@pytest.mark.parametrize("drive", IMPOSING)
def test_drive_that_imposes_the_law_agrees_with_the_rigid_drive(drive, cart):
    made, name, tolerance = IMPOSING[drive]
    run = simulate(CARTS[cart], made, law_of(drive, name), lambda v, a: 1e3 * v)
    rigid = simulate(CARTS[cart], Rigid(), law_of(drive, name, run.period / 2), lambda v, a: 1e3 * v)
    assert (run.peak_force, run.peak_power) == pytest.approx((rigid.peak_force, rigid.peak_power), rel=tolerance)
    assert run.rms_power == pytest.approx(rigid.rms_power, rel=tolerance)


@pytest.mark.parametrize("name", ["cubic", "reversal-4"])
@pytest.mark.parametrize("drive", ["rigid", "elastic", "backlash", "hydraulic"])
def test_both_strokes_require_the_same_of_a_symmetric_machine(drive, name):
    """The return stroke mirrors the forward one: the force changes its sign half a cycle later."""
    run = simulate(CARTS["end springs"], DRIVES[drive], law_of(drive, name), dry)
    late = run.time > run.period / 2
    forward, back = run.drive_force[~late], run.drive_force[late]
    assert forward.max() == pytest.approx(-back.min(), rel=1e-3)
    assert forward.min() == pytest.approx(-back.max(), rel=1e-3, abs=1e-3 * SIZE)
    halves = [np.sum((run.weights * run.drive_power)[side]) for side in (late, ~late)]
    assert halves[0] == pytest.approx(halves[1], rel=1e-3)


@pytest.mark.sampled(24)
@pytest.mark.parametrize("name", ["quintic", "parabolic", "reversal-4", "constant-velocity"])
@pytest.mark.parametrize(
    ("stiffness", "backlash"), [(1e5, 0.0), (1e9, 0.0), (1e6, 1e-3), (1e6, 1e-4), (1e6, 2e-3)], ids=str
)
@pytest.mark.parametrize("regime", ["periodic", "rest"])
@pytest.mark.parametrize(
    ("springs", "resistance"), [(EndSprings(2e4, 300.0, 0.08, stroke=0.4), stribeck), (None, friction(1500.0))]
)
def test_energy_balance_of_any_spring(regime, stiffness, backlash, name, springs, resistance):
    drive = ElasticDrive(stiffness, 0.1 * math.sqrt(stiffness * MASS), backlash)
    cart = replace(CART_OF_C if springs else CART, end_springs=springs)
    run = simulate_elastic(cart, drive, law_of("elastic", name).cycle(0.5, 0.2), resistance, regime=regime)
    assert run.energy_residual < 1e-9
    assert run.shocks  # the acceleration jumps at each stop by friction
    assert {-1, 0, 1} & set(run.trajectory.zone.tolist())
    assert set(run.trajectory.flank.tolist()) - {1} == ({-1, 0} if backlash else set())


@pytest.mark.parametrize("cart", CARTS)
@pytest.mark.parametrize("drive", ["elastic", "backlash", "motor"])
def test_periodic_regime_ends_where_it_starts_and_does_not_hang_on_the_tolerance(drive, cart):
    make = {"motor": simulate_motor}.get(drive, simulate_elastic)
    runs = [make(CARTS[cart], DRIVES[drive], law_of(drive, "cubic"), stribeck, tolerance=t) for t in (1e-8, 1e-10)]
    for run in runs:
        ends = (
            (run.speed[[0, -1]],)
            if drive == "motor"
            else zip(run.trajectory.start[:2], run.trajectory.end[:2], strict=True)
        )
        assert all(one == pytest.approx(other, rel=1e-8, abs=1e-12) for one, other in ends)
    names = ("peak_force", "peak_power", "rms_force", "drawn_energy")
    assert [getattr(runs[0], name) for name in names] == pytest.approx([getattr(runs[1], name) for name in names], 2e-7)


@pytest.mark.parametrize("drive", DRIVES)
def test_statistics_of_a_run_are_consistent(drive):
    run = simulate(CARTS["end springs"], DRIVES[drive], law_of(drive, "quintic"), dry)
    assert np.abs(run.drive_force).max() <= run.peak_force * (1 + 1e-9)
    assert run.peak_force == pytest.approx(np.abs(run.drive_force).max(), rel=1e-2)
    assert np.abs(run.drive_power).max() <= run.peak_power * (1 + 1e-9)
    assert run.mean_force <= run.rms_force <= run.peak_force
    assert run.energy <= run.drawn_energy * (1 + 1e-9)
    assert run.mean_power * run.period == pytest.approx(run.energy, rel=1e-12)
    assert run.weights.sum() == pytest.approx(run.period, rel=1e-12)


def test_drawn_energy_and_mean_force_of_an_oscillation_are_exact():
    """Steps end where the drive force changes its sign."""
    run = simulate(CARTS["bare"], ElasticDrive(1e6, 2e3), law_of("elastic", "parabolic", 0.889), dry)
    time = np.linspace(0, run.period, 200_001)
    motion = run.trajectory.at(time)
    power = motion.drive_force * motion.driven_velocity
    assert run.drawn_energy == pytest.approx(np.trapezoid(np.maximum(power, 0), time), rel=1e-6)
    assert run.mean_force == pytest.approx(np.trapezoid(np.abs(motion.drive_force), time) / run.period, rel=1e-6)
