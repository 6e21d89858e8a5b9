"""One battery over all drives: energy balance, limit to the rigid drive, both strokes alike."""

import math
from dataclasses import replace

import numpy as np
import pytest
from published import CART_OF_C

from compact.drive import Crank, Rigid, simulate
from compact.machine.cart import EndSprings
from compact.machine.elastic_drive import ElasticDrive
from compact.machine.hydraulic_drive import Hydraulic
from compact.machine.motor_drive import Motor
from compact.machine.shaft import Kloss
from compact.motion.profile import law

SIZE, MASS = 3486.0, CART_OF_C.mass
CARTS = {
    "bare": replace(CART_OF_C, guide_friction=0.0),
    "end springs": replace(CART_OF_C, guide_friction=0.0, end_springs=EndSprings(4e3, 0.0, 0.08, stroke=0.4)),
}
KLOSS = Kloss(40.0, 0.15, 157.0)
HYDRAULIC = Hydraulic(1e-3, 8e6, 5e-4, 2e-5, 0.62, 870.0, 1e3, 1.4e9, 1e-4)
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


def dry(velocity, acceleration):
    return SIZE * np.sign(velocity)


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
