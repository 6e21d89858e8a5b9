"""End springs: closed forms, work, all drives, errors."""

from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, SIZE, dry, published_law

from compact.drive import simulate
from compact.machine.cart import EndSprings
from compact.machine.crankshaft import CRANK_ANGLES
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.machine.motor_drive import Motor
from compact.machine.shaft import Kloss


def cart_with_springs(stiffness=4e3, preload=300.0, length=0.08, cart=CART):
    return replace(cart, end_springs=EndSprings(stiffness, preload, length, stroke=0.4))


def test_energy_balance_of_four_carts_with_springs_on_a_motor():
    motor = Motor(Kloss(40.0, 0.15, 157.0), 150.0, 1e-3, 20.0, CRANK_ANGLES[4])
    bare, run = (simulate(cart, motor, published_law("cubic"), dry) for cart in (CART, cart_with_springs()))
    assert run.energy_residual < 1e-8
    assert run.energy == pytest.approx(0.8 * SIZE, rel=1e-6)
    near = run.state.position < 0.08
    assert run.state.forces.drive_force[near].min() < bare.state.forces.drive_force[bare.state.position < 0.08].min()


@pytest.mark.parametrize("stiffness", [1e5, 1e9])
def test_tuned_springs_require_no_force_of_an_elastic_drive(stiffness):
    tuned = CART.mass * (np.pi / 3.0) ** 2
    drive = ElasticDrive(stiffness, 0.1 * np.sqrt(stiffness * CART.mass))
    run = simulate_elastic(cart_with_springs(tuned, 0.0, 0.2), drive, published_law("harmonic"), lambda v, a: 0.0 * v)
    assert run.peak_force < 1e-7 * CART.mass * 0.2 * (np.pi / 3) ** 2
