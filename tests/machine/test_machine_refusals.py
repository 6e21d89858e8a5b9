"""Refusals of the machine: carts, drives, motors, belts, rollers, bearings, rankings."""

import math
from dataclasses import replace

import numpy as np
import pytest
from machine_cases import CART, HYDRAULIC, KLOSS, dry, free, published_law
from published import CART_OF_C

from compact.drive import Crank, Rigid, rank, simulate
from compact.machine.cart import EndSprings, balance
from compact.machine.component_sizing import Bearing, CatalogueMotor
from compact.machine.crankshaft import simulate_crankshaft
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.machine.hydraulic_drive import Circuit, Hydraulic
from compact.machine.motor_drive import Motor, simulate_acceleration_phase, simulate_motor
from compact.machine.rigid_drive import InverseDynamics
from compact.machine.roller_motors import DrivenRoller, pull_range
from compact.machine.shaft import Belt, Kloss, LinearTorqueCurve
from compact.numerics.piecewise import PiecewisePolynomial
from compact.resistance import ResistanceMap

BELT = Belt(pulley_radius=0.1, stiffness=50e3, preload=500.0, friction=0.4, wrap=3.0)
CRANK = Crank(0.2, 0.8)
MOTOR = CatalogueMotor("small", 5.0, 15.0, 150.0, 0.001, 300.0)
DRIVES = {
    "rigid": Rigid(),
    "elastic": ElasticDrive(1e6, 3e3),
    "motor": Motor(LinearTorqueCurve(60.0, 20.0), 15.0, 0.01, 10.0),
    "hydraulic": Hydraulic(2e-3, 6.3e6, 1.2e-3, 8e-5, 0.62, 870.0, 2e4, 1.4e9, 4e-4),
}
DAMPED = ElasticDrive(1e6, 0.2 * math.sqrt(1e6 * CART.mass))


def elastic(drive=DAMPED, resistance=dry, name="cubic", cart=CART, dwell=0.0, **keys):
    return simulate_elastic(cart, drive, published_law(name).cycle(dwell, dwell), resistance, **keys)


def on_motor(*numbers, name="cubic", cart=CART, angles=(0.0,), simulate=simulate_motor, **keys):
    return simulate(cart, Motor(*numbers, angles, **keys), published_law(name), dry)


def accelerate(*arguments):
    return simulate_acceleration_phase(simulate_motor(*arguments))


def stroke(resistance):
    areas = (PiecewisePolynomial(np.array([0.0, 2.0]), np.array([[area]])) for area in (1e-6, 2e-5))
    return Circuit(CART, HYDRAULIC, 0.4, tuple(areas), resistance).simulate()


def driven_roller(**changes):
    w = np.linspace(-0.95, 0.95, 9)
    rows = {"torques": w, "pulls": 10 * w, "creeps": 0.09 * w, "loads": np.full(9, 9740.0)} | changes
    return DrivenRoller(0.11, 0.35, np.array([0.01, 0.3]), **{name: np.tile(row, (2, 1)) for name, row in rows.items()})


def crankshaft(angular_speed=10.5, angles=(0.0,), crank=CRANK, cart=CART, resistance=dry):
    return simulate_crankshaft(cart, crank, angular_speed, resistance, angles)


def rigid(resistance=dry, motion=None, **keys):
    return simulate(CART, Rigid(), motion or published_law("cubic"), resistance, **keys)


def on_crank(motion):
    return simulate(CART, CRANK, motion, dry)


def jumping(velocity, acceleration):
    return np.sign(velocity) * np.where(np.abs(velocity) > 0.1, 9.0, 5.0)


def bad(value):
    return lambda velocity, acceleration: np.where(velocity > 0.15, value, dry(velocity))


VALUES = [
    (lambda: replace(CART, mass=-1.0), "`mass` must be zero or positive, and finite, got -1.0"),
    (lambda: replace(CART, roller_positions=(0.0,)), "`roller_reactions` must be one per roller, got 2 for 1 positi"),
    (lambda: replace(CART, guide_positions=(0.1, 0.1)), r"`guide_positions` must be \(front, rear\) with front > rear"),
    (lambda: replace(BELT, stiffness=5e3), r"`stiffness` 5000 N is too low for .* creep by 0.11 before"),
    (lambda: EndSprings(1.0, 0.0, 0.3, stroke=0.4), r"`length` must be at most half the stroke, 0\.2 m, got 0\.3"),
    (lambda: Crank(0.2, 0.2), r"`rod_length` must exceed the crank radius 0\.2 m, got 0\.2"),
    (lambda: elastic(cart=replace(CART, mass=0.0)), "`mass` must be positive"),
    (lambda: elastic(regime="rset"), r"no regime 'rset'; did you mean 'rest'\? choose from periodic, rest"),
    (lambda: Motor(KLOSS, 1.0, 1.0, 1.0, ()), "`angles` must hold one angle per cart, got none"),
    (lambda: replace(HYDRAULIC, piston_area=0.0), "`piston_area` must be positive"),
    (lambda: replace(MOTOR, peak_torque=1.0), "`peak_torque` must be at least `rated_torque` 5.0 N m, got 1.0"),
    (lambda: Bearing(1e3, "ball", 1.5), "`count` must be a whole number >= 1"),
    (lambda: driven_roller(creeps=np.zeros(9)), "`creeps` must increase with the torque at every speed"),
    (lambda: rigid(working=(0.5, 0.5)), "`working` must be two fractions, 0 <= first < second <= 1, got"),
    (lambda: rank([], "peak_forse"), "no criterion 'peak_forse'; did you mean 'peak_force'[?] choose from peak_forc"),
    # laws and drives
    (lambda: on_crank(published_law("cubic")), r"a crank imposes its own law only, got 'cubic', .*use Rigid\(\), .*="),
    (lambda: on_crank(published_law("crank").cycle(far_dwell=0.1)), r"a crank cannot dwell, got dwells of 0\.1 s in"),
    (lambda: on_motor(KLOSS, 150.0, 0.0, 1.0, name="gear-sector"), "'gear-sector' jumps, which requires an infinite"),
    (
        lambda: balance(replace(CART_OF_C, guide_friction=0.5), 0.0, 1.0, 1.0, rod_tangent=np.array([0.0, 2.0])),
        r"the rod is too steep: `guide_friction` 0\.5 locks the cart",
    ),
    # resistances
    (lambda: rigid(bad(math.nan)), r"`resistance` must be finite, got nan at velocity 0\.15\d* m/s and acceleration"),
    (lambda: rigid(lambda v, a: 3500.0 + 0 * v), r"got 3500 N at velocity -0\.133333 m/s: .*`compact.dry_resistance\("),
    (lambda: rigid(lambda v, a: 2e4 * np.abs(v)), r"must oppose the motion, got 2666\.67 N at velocity -0\.133333 m/s"),
    *(
        (
            lambda made=made: simulate(CART, made, published_law("quintic"), lambda v, a: 3500.0),
            "must oppose the motion",
        )
        for made in DRIVES.values()
    ),
    (lambda: crankshaft(resistance=lambda v, a: 3500.0), "must oppose the motion"),
    (lambda: elastic(resistance=jumping), r"`resistance` over speed \[m/s\] has a jump of .* at 0\.1\d*; .*without"),
    (
        lambda: elastic(resistance=ResistanceMap(np.array([0.1, 0.3, 0.9]), np.full(3, -10.0), 1e-3)),
        r"`resistance` must not drive a cart at rest, got -10 N at speed \+0",
    ),
    (lambda: elastic(ElasticDrive(1e15, 0.0), name="gear-sector"), r"`stiffness` 1e\+15 N/m with `damping` 0 N s/m:"),
]
FAILURES = [
    (  # the fifth harmonic of the cycle, which the cubic law excites
        lambda: elastic(ElasticDrive(CART.mass * (5 * np.pi / 3.0) ** 2, 0.0), free),
        r"no periodic regime found in .* possibly by resonance of the spring",
    ),
    (
        lambda: on_motor(Kloss(4.0, 0.15, 157.0), 100.0, 0.0, 10.0),
        r"the motor stalls: the mean load torque is .* N m at .* the motor delivers",
    ),
    (  # the torque suffices on the mean, but the cart stops in the middle of the stroke
        lambda: on_motor(KLOSS, 13.0, 0.0, 0.01, name="septic", cart=replace(CART, mass=0.0)),
        r"the speed of the shaft did not converge in .* use a stronger motor or more inertia",
    ),
    (  # the torque suffices on the mean with the flywheel, but not from rest
        lambda: on_motor(KLOSS, 35.0, 0.0, 300.0, simulate=accelerate),
        r"it falls to .* rad/s at .* rad; use a stronger motor",
    ),
    (
        lambda: on_motor(
            Kloss(20.0, 0.02, 157.0), 150.0, 0.0, 1e3,
            cart=CART_OF_C, angles=(np.pi / 2,), simulate=accelerate,
        ),
        r"the motor does not start: it delivers .* N m on the shaft at rest",
    ),
    (  # 80 N m at rest, slip limit 54 N m
        lambda: on_motor(
            LinearTorqueCurve(80.0, 157.0), 150.0, 0.001, 50.0,
            name="quintic", simulate=accelerate, belt=BELT,
        ),
        "the belt slips",
    ),
    (lambda: stroke(lambda v, a: dry(v) - 2e3 * a + 1e6 * a**3), "no acceleration balances"),
    (
        lambda: pull_range(
            InverseDynamics(
                replace(CART_OF_C, guide_friction=0.999, guide_positions=(0.1, -0.1)),
                Rigid(), published_law("quintic").cycle(), dry,
            ),
            2,
        ),
        "the guide wheels lock the cart under 'quintic'",
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("error", "attempt", "message"),
    [*((ValueError, *row) for row in VALUES), *((RuntimeError, *row) for row in FAILURES)],
)
def test_refusal_names_the_quantity_and_the_remedy(error, attempt, message):
    with pytest.raises(error, match=message):
        attempt()
