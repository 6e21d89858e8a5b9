"""Motors inside the rollers: rolling without creepage, Carter's cylinder, the finite-element engine, balances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampling import sampled
from scipy.integrate import quad

from compact import fem
from compact.analysis import contact_cases
from compact.analysis.contact_cases import case_of
from compact.analysis.study import Study
from compact.contact import dry_resistance
from compact.drive import Rigid, simulate
from compact.machine.cart import Cart, EndSprings, balance
from compact.machine.rigid_drive import InverseDynamics
from compact.machine.roller_motors import (
    FULL_SLIP_SHARE,
    CreepFreeRoller,
    DrivenRoller,
    RollerMotor,
    carter_parameter,
    pull_range,
    roller_rotation,
)
from compact.material.laws import Elastic
from compact.motion.profile import law
from compact.resistance import ResistanceMap
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene

R, LOAD, FRICTION, ROLLERS = 0.11, 9740.0, 0.35, 2
FREE_CREEP, CREEP_SLOPE = -0.02, 0.09  # creepage of a free roller, and its slope over `carter_parameter`
RESISTANCE = dry_resistance(3486.0)


def cart(**changes):
    parameters = {
        "mass": 1000.0, "weight": 1e4, "roller_positions": (-0.27, 0.27), "roller_reactions": (LOAD, LOAD),
        "guide_positions": (0.37, -0.37), "pin_position": 0.65, "pin_height": 0.1, "roller_radius": R,
        "guide_wheel_diameter": 0.046, "guide_friction": 0.0,
    }  # fmt: skip
    return Cart(**parameters | changes)


def carter(free=FREE_CREEP, slope=CREEP_SLOPE, friction=FRICTION):
    """Roller with T = R pull and a creepage that is linear in `carter_parameter`."""
    w = np.linspace(-0.95, 0.95, 9)
    torques = np.sign(w) * (1 - (1 - np.abs(w)) ** 2) * friction * R * LOAD
    rows = torques, torques / R, free + slope * w, np.full(9, LOAD)
    return DrivenRoller(R, friction, np.array([0.01, 0.3]), *(np.tile(row, (2, 1)) for row in rows))


CREEP_FREE = CreepFreeRoller(R, LOAD, FRICTION)


def motor(name="quintic", roller=CREEP_FREE, dwell=0.0, **changes):
    cycle = law(name, 0.4, 3.0).cycle(dwell, dwell)
    return RollerMotor(InverseDynamics(cart(**changes), Rigid(), cycle, RESISTANCE), roller, ROLLERS)


def run_of(motor):
    return simulate(motor.dynamics.cart, Rigid(), motor.dynamics.cycle, RESISTANCE)


# without creep


def test_motors_without_creep_and_guide_friction_deliver_the_drive_force():
    motors = motor()
    run = run_of(motors)
    _, result = motors.traction_over(run.time)
    assert ROLLERS * result.torque == pytest.approx(R * run.drive_force, abs=1e-9 * R * run.peak_force)
    assert result.traction == pytest.approx(run.drive_force / ROLLERS / LOAD, abs=1e-9)
    assert ROLLERS * motors.power(run.time) == pytest.approx(run.drive_power, abs=1e-9 * run.peak_power)
    assert motors.angle(np.linspace(0, 6, 9)) == pytest.approx(
        motors.dynamics.cycle.derivative(np.linspace(0, 6, 9), 0) / R, abs=1e-13
    )
    assert (motors.peak_torque, motors.peak_power) == pytest.approx(
        (R * run.peak_force / 2, run.peak_power / 2), rel=1e-9
    )
    assert math.isnan(motors.peak_creep)


def test_pin_force_is_zero():
    springs = EndSprings(5e3, 200.0, 0.1, 0.4)
    motors = motor(guide_friction=0.1, weight=19.4e3, end_springs=springs)
    for leg in motors.dynamics.cycle.legs():
        phase = np.linspace(0.01, 0.99, 50)
        state, (_, result) = (
            motors.dynamics.state_at(leg, phase),
            motors.traction_at(leg, motors.dynamics.state_at(leg, phase)),
        )
        zones = springs.zones(lambda z, leg=leg: leg.at_phase(z, 0), leg.breakpoints())
        end_force = springs.force(state.position, zones.side_at(phase))
        left = state.resistance - ROLLERS * result.torque / R
        pin = balance(motors.dynamics.cart, state.acceleration, left, leg.direction, 0.0, end_force).drive_force
        assert np.abs(pin).max() < 1e-8
        # without a pin force the guide friction differs from that of a rigid drive
        assert np.abs(ROLLERS * result.torque / R - state.forces.drive_force).max() > 1


# with creep


@pytest.mark.parametrize("time", [0.4, 2.9, 5.9])
def test_angle_is_the_integral_of_travel_and_creep(time):
    motors, steps = motor(roller=carter(), dwell=0.25), np.linspace(0, time, 400)
    cycle = motors.dynamics.cycle

    def rotation_speed(at):
        velocity, acceleration = (float(cycle.derivative(at, order)) for order in (1, 2))
        force = 1000 * acceleration * np.sign(velocity) + RESISTANCE.force
        return (1 + FREE_CREEP + CREEP_SLOPE * carter_parameter(force / ROLLERS / LOAD / FRICTION)) * velocity / R

    exact = quad(rotation_speed, 0, time, points=[3.0, 3.25], limit=400, epsabs=1e-9)[0]
    assert motors.angle(steps)[-1] == pytest.approx(exact, abs=3e-5)
    assert motors.angular_velocity(np.array([time])) == pytest.approx(rotation_speed(time), rel=1e-9, abs=1e-12)
    _, at_rest = motors.traction_over(np.array([3.1]))
    assert not np.any(at_rest)


def test_power_of_the_motors_is_that_of_the_cart_and_of_creep():
    motors = motor(roller=carter())
    run = run_of(motors)
    _, result = motors.traction_over(run.time)
    creep_loss = np.sum(run.weights * ROLLERS * result.torque * result.creep * run.state.velocity / R)
    parameters = np.sum(run.weights * ROLLERS * motors.power(run.time))
    assert parameters == pytest.approx(run.energy + creep_loss, rel=1e-12)
    assert 0.005 < creep_loss / run.energy < 0.01


@given(st.floats(-0.9, 0.9), st.floats(0.0, 1.0))
def test_creep_rises_with_the_pull_and_knows_no_speed_where_samples_know_none(share, speed):
    roller = carter()
    less, more = roller(np.array([speed]), FRICTION * LOAD * np.array([[share], [share + 0.01]]))._asdict()["creep"]
    assert less < more
    assert less == pytest.approx(FREE_CREEP + CREEP_SLOPE * carter_parameter(share), abs=1e-12)


@pytest.mark.slow
def test_driven_roller_on_a_thick_layer_agrees_with_carter():
    """Incompressible layer: pressure and shear are uncoupled, even terms in the torque are of second order in a/R."""
    radius, friction, half_width = 1.0, 0.3, 0.02
    parameters = (
        Layer(1.0),
        Roller(radius, indentation=half_width**2 / 2, friction=friction, rolling="driven", profile="deformed"),
        Elastic(youngs_modulus=1e7, poisson=0.49),
        1.0,
    )
    free = fem.roll(*parameters, torque=0.0, estimate=False)
    shares = np.array([-0.99, -0.84, -0.51, 0, 0.51, 0.84, 0.99])
    samples = [fem.roll(*parameters, torque=s * friction * radius * free.load, estimate=False) for s in shares]
    torques = shares * friction * radius * free.load
    rows = np.array(
        [[t, free.resistance - s.resistance, s.creep, s.load] for t, s in zip(torques, samples, strict=True)]
    )
    roller = DrivenRoller(radius, friction, np.array([1.0]), *rows.T[:, None])
    shares = np.array([0.3, 0.7, 0.95])
    forth, back = (roller(np.ones(3), way * shares * friction * free.load) for way in (1, -1))
    a = (free.leading - free.trailing) / 2
    exact = friction * a / radius * (1 - np.sqrt(1 - shares))
    assert (forth.creep - back.creep) / 2 == pytest.approx(exact, rel=0.01)
    assert forth.torque == pytest.approx(radius * shares * friction * free.load, rel=5e-4)
    assert np.abs(forth.creep + back.creep).max() / 2 < (a / radius) ** 2
    assert forth.share == pytest.approx(shares, rel=1e-3)


# finite-element engine


SPEEDS = (0.1, 0.2, 0.3)


@pytest.fixture(scope="module")
def by_fem():
    """Study of a heavy cart whose contacts are the samples of its resistance map."""
    changes = {"accuracy.engine": "fem", "motion.laws": ["septic"], "machine.gap_geometry": "circle"}
    study = Study(load_scene("loveikin-2015", **changes, **{"machine.mass": 4e3, "machine.weight": 39240.0}))
    cases = [case_of(study.scene, study.stages.contacts.mix, speed) for speed in SPEEDS]
    rolled = [fem.roll(each.layer, each.roller, each.material, each.speed, estimate=False) for each in cases]
    study.stages.contacts.records = [
        contact_cases.contact_record("fem", *each) for each in zip(SPEEDS, [(one,) for one in rolled], strict=True)
    ]
    whole = ROLLERS * study.scene.machine.roller_length
    study.stages.resistance.resistance = ResistanceMap(
        np.array(SPEEDS), whole * np.array([each.resistance for each in rolled]), 0.0
    )
    study.stages.contacts.kept = None
    return study


@pytest.mark.slow
@pytest.mark.parametrize("time", sampled([0.8, 5.1], [5.1]))
def test_engine_reproduces_the_interpolated_traction(by_fem, time):
    motors, scene = by_fem.stages.drive.roller_motors["septic"], by_fem.scene
    (velocity,), result = motors.traction_over(np.array([time]))
    speed, way, length = abs(velocity), np.sign(velocity), scene.machine.roller_length
    case = case_of(scene, by_fem.stages.contacts.mix, speed)
    layer, roller, material = case.layer, case.roller, case.material
    own = fem.roll(layer, roller, material, speed, estimate=False)
    held = Roller(
        R,
        indentation=own.indentation,
        friction=by_fem.stages.contacts.mix.steel_friction,
        rolling="driven",
        profile=scene.machine.gap_geometry,
    )
    torque = way * result.torque[0] / length
    rolled = fem.roll(layer, held, material, speed, torque=torque, estimate=False)
    assert result.creep[0] == pytest.approx(rolled.creep, abs=0.02 * np.ptp(motors.roller.creeps))
    (leg,) = (leg for leg in motors.dynamics.cycle.legs() if leg.start <= time <= leg.start + leg.duration)
    state = motors.dynamics.state_at(leg, np.array([(time - leg.start) / leg.duration]))
    pull = way * state.forces.drive_force[0] / ROLLERS / length  # both guide wheels on the upper rail
    assert own.resistance - rolled.resistance == pytest.approx(pull, rel=0.01, abs=2e-4 * own.load)
    least, largest = pull_range(motors.dynamics, ROLLERS)
    assert np.all(motors.roller.pulls[:, 0] < least)
    assert np.all(motors.roller.pulls[:, -1] > largest)
    # power of the motor less that on the cart is dissipated in layer and slip
    kept = rolled.resistance + torque / R * (1 + rolled.creep)
    assert rolled.work_residual * max(abs(rolled.resistance), 1e-3 * rolled.load) < 5e-4 * own.load
    assert kept > 0
    assert own.resistance - pull + torque / R * (1 + result.creep[0]) == pytest.approx(kept, abs=1e-3 * own.load)


# beyond the Coulomb limit


def test_pull_beyond_friction_is_reported_with_its_share():
    motors = motor("septic", roller=carter(friction=0.1))
    run = run_of(motors)
    share = run.peak_force / ROLLERS / LOAD / 0.1
    assert motors.share == pytest.approx(share, rel=1e-9)
    assert share > FULL_SLIP_SHARE
    assert motors.lack == f"friction: {share:.3g} of the Coulomb limit"
    assert motors.peak_torque == motors.peak_power == motors.peak_creep == math.inf
    _, result = motors.traction_over(run.time)
    slides = np.abs(result.share) > FULL_SLIP_SHARE
    assert np.array_equal(np.isnan(result.creep), slides)
    assert slides.any()
    angle = motors.angle(np.linspace(0, 6, 400))
    first = np.argmax(np.isnan(angle))
    assert first > 0
    assert np.isnan(angle[first:]).all()


def test_rotation_is_the_travel_over_the_radius():
    """Paper B, constant speed: 48 dx/(43 T R), errata B-8; each derivative is that of the one before."""
    cycle, time, h = law("reversal-4-free-both", 0.4, 3.0).cycle(), np.linspace(0.05, 5.95, 40), 1e-5
    rotation = roller_rotation(cycle, R, time)
    assert roller_rotation(cycle, R, 1.5)[1] == pytest.approx(48 * 0.4 / (43 * 3.0 * R), rel=1e-13)
    assert rotation[0] == pytest.approx(cycle.derivative(time, 0) / R, rel=1e-15)
    after, before = (np.array(roller_rotation(cycle, R, time + step)) for step in (h, -h))
    assert (after - before)[:-1] / (2 * h) == pytest.approx(np.array(rotation[1:]), abs=1e-4)
