"""The motor inside each roller: against rolling without slip, Carter's cylinder, the engine itself, and balances."""

import math
from copy import copy
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from compact import fem
from compact.analysis import contact_cases
from compact.analysis.contact_cases import contact_inputs
from compact.analysis.study import Study
from compact.analysis.torque_response import torque_response
from compact.contact import dry_resistance
from compact.drive import Rigid, simulate
from compact.engines.compaction import engine as compaction
from compact.engines.fem import engine as fem_engine
from compact.machine.cart import Cart, EndSprings, balance
from compact.machine.rigid_drive import InverseDynamics
from compact.machine.roller_motors import HELD, Driven, FirstOrder, RollerMotor, pulls, roller_rotation, spent
from compact.material.laws import Elastic
from compact.motion.profile import law
from compact.resistance import ResistanceMap
from compact.rolling_contact import Layer, Roller
from compact.scene.loader import load_scene

R, LOAD, GRIP, ROLLERS = 0.11, 9740.0, 0.35, 2
CREPT, STEEP = -0.02, 0.09  # creep of a free roller, and its slope over `spent`
RESISTANCE = dry_resistance(3486.0)
SCENES = Path(__file__).parents[2] / "studies" / "scenes"


def cart(**changes):
    given = {
        "mass": 1000.0, "weight": 1e4, "roller_positions": (-0.27, 0.27), "roller_reactions": (LOAD, LOAD),
        "guide_positions": (0.37, -0.37), "pin_position": 0.65, "pin_height": 0.1, "roller_radius": R,
        "guide_wheel_diameter": 0.046, "guide_friction": 0.0,
    }  # fmt: skip
    return Cart(**given | changes)


def carter(free=CREPT, slope=STEEP, friction=GRIP):
    """A roller with T = R pull, whose creep is a straight line over `spent`."""
    w = np.linspace(-0.95, 0.95, 9)
    torques = np.sign(w) * (1 - (1 - np.abs(w)) ** 2) * friction * R * LOAD
    rows = torques, torques / R, free + slope * w, np.full(9, LOAD)
    return Driven(R, friction, np.array([0.01, 0.3]), *(np.tile(row, (2, 1)) for row in rows))


FIRST = FirstOrder(R, LOAD, GRIP)


def motor(name="quintic", roller=FIRST, dwell=0.0, **changes):
    cycle = law(name, 0.4, 3.0).cycle(dwell, dwell)
    return RollerMotor(InverseDynamics(cart(**changes), Rigid(), cycle, RESISTANCE), roller, ROLLERS)


def run_of(motor):
    return simulate(motor.demand.cart, Rigid(), motor.demand.cycle, RESISTANCE)


# without creep


def test_without_creep_and_guide_friction_the_motors_give_the_force_of_the_drive():
    motors = motor()
    run = run_of(motors)
    _, answer = motors.over(run.time)
    assert ROLLERS * answer.torque == pytest.approx(R * run.drive_force, abs=1e-9 * R * run.peak_force)
    assert answer.traction == pytest.approx(run.drive_force / ROLLERS / LOAD, abs=1e-9)
    assert ROLLERS * motors.power(run.time) == pytest.approx(run.drive_power, abs=1e-9 * run.peak_power)
    assert motors.angle(np.linspace(0, 6, 9)) == pytest.approx(
        motors.demand.cycle.derivative(np.linspace(0, 6, 9), 0) / R, abs=1e-13
    )
    assert (motors.peak_torque, motors.peak_power) == pytest.approx(
        (R * run.peak_force / 2, run.peak_power / 2), rel=1e-9
    )
    assert math.isnan(motors.peak_creep)


@pytest.mark.parametrize("springs", [None, EndSprings(5e3, 200.0, 0.1, 0.4)], ids=["bare", "springs"])
def test_nothing_pulls_at_the_pin(springs):
    motors = motor(guide_friction=0.1, weight=19.4e3, end_springs=springs)
    for leg in motors.demand.cycle.legs():
        phase = np.linspace(0.01, 0.99, 50)
        state = motors.demand.at(leg, phase)
        _, answer = motors.at(leg, phase)
        push = (
            0.0
            if springs is None
            else springs.push(
                state.position, springs.zones(lambda z, leg=leg: leg.at_phase(z, 0), leg.breakpoints()).at(phase)
            )
        )
        left = state.resistance - ROLLERS * answer.torque / R
        pin = balance(motors.demand.cart, state.acceleration, left, leg.direction, 0.0, push).drive_force
        assert np.abs(pin).max() < 1e-8
        # guide wheels that carry the rollers' pull, and not that of a pin, rub as much more or less
        assert np.abs(ROLLERS * answer.torque / R - state.forces.drive_force).max() > 1


def test_pulls_are_the_least_and_the_largest_of_the_cycle():
    motors = motor("septic")
    run = run_of(motors)
    along = run.direction * run.drive_force / ROLLERS
    assert pulls(motors.demand, ROLLERS) == pytest.approx((along.min(), along.max()), rel=1e-3)


# with creep


@pytest.mark.parametrize("time", [0.4, 1.5, 2.9, 4.0, 5.9])
def test_angle_is_what_travel_and_creep_turn(time):
    motors, steps = motor(roller=carter(), dwell=0.25), np.linspace(0, time, 400)

    def turning(at):
        velocity, force = (f(at) for f in (_velocity(motors), _force(motors)))
        w = spent(np.sign(velocity) * force / ROLLERS / LOAD / GRIP) if velocity else 0.0
        return (1 + CREPT + STEEP * w) * velocity / R

    exact = quad(turning, 0, time, points=[3.0, 3.25], limit=400, epsabs=1e-9)[0]
    assert motors.angle(steps)[-1] == pytest.approx(exact, abs=3e-5)
    assert motors.angular_velocity(np.array([time])) == pytest.approx(turning(time), rel=1e-9, abs=1e-12)


def _velocity(motors):
    return lambda at: float(motors.demand.cycle.derivative(at, 1))


def _force(motors):
    def force(at):
        velocity, acceleration = (motors.demand.cycle.derivative(at, order) for order in (1, 2))
        return float(1000 * acceleration + np.sign(velocity) * RESISTANCE.force)

    return force


def test_power_of_the_motors_is_that_of_the_cart_and_of_creep():
    motors = motor(roller=carter())
    run = run_of(motors)
    _, answer = motors.over(run.time)
    crept = np.sum(run.weights * ROLLERS * answer.torque * answer.creep * run.state.velocity / R)
    given = np.sum(run.weights * ROLLERS * motors.power(run.time))
    assert given == pytest.approx(run.energy + crept, rel=1e-12)
    assert 0.005 < crept / run.energy < 0.01


@given(st.floats(-0.9, 0.9), st.floats(0.0, 1.0))
def test_creep_rises_with_the_pull_and_knows_no_speed_where_samples_know_none(share, speed):
    roller = carter()
    less, more = roller(np.array([speed]), GRIP * LOAD * np.array([[share], [share + 0.01]]))._asdict()["creep"]
    assert less < more
    assert less == pytest.approx(CREPT + STEEP * spent(share), abs=1e-12)


def test_carter_rolls_on_a_thick_layer():
    """Incompressible, so that pressure and shear do not mix; what is even in the torque is of second order in a/R."""
    radius, friction, half_width = 1.0, 0.3, 0.02
    given = Layer(1.0), Roller(radius, half_width**2 / 2, friction, "driven", "deformed"), Elastic(1e7, 0.49), 1.0
    free = fem.roll(*given, torque=0.0, estimate=False)
    shares = np.array([-0.99, -0.84, -0.51, 0, 0.51, 0.84, 0.99])
    samples = [fem.roll(*given, torque=s * friction * radius * free.load, estimate=False) for s in shares]
    torques = shares * friction * radius * free.load
    rows = np.array(
        [[t, free.resistance - s.resistance, s.creep, s.load] for t, s in zip(torques, samples, strict=True)]
    )
    roller = Driven(radius, friction, np.array([1.0]), *rows.T[:, None])
    asked = np.array([0.3, 0.7, 0.95])
    forth, back = (roller(np.ones(3), way * asked * friction * free.load) for way in (1, -1))
    a = (free.leading - free.trailing) / 2
    exact = friction * a / radius * (1 - np.sqrt(1 - asked))
    assert (forth.creep - back.creep) / 2 == pytest.approx(exact, rel=0.01)
    assert forth.torque == pytest.approx(radius * asked * friction * free.load, rel=5e-4)
    assert np.abs(forth.creep + back.creep).max() / 2 < (a / radius) ** 2
    assert forth.share == pytest.approx(asked, rel=1e-3)


# by the engine of a scene


SPEEDS = (0.1, 0.2, 0.3)


@pytest.fixture(scope="module")
def by_fem():
    """A study whose contacts are its map; a heavy cart pulls and brakes hard."""
    changes = {"accuracy.engine": "fem", "motion.laws": ["septic"], "machine.gap_geometry": "circle"}
    study = Study(load_scene(SCENES / "loveikin-2015.toml", **changes, **{"machine.mass": 4e3}))
    rolled = [fem.roll(*contact_inputs(study.scene, study.mix, "fem", speed), speed, estimate=False) for speed in SPEEDS]
    study.contact_stage.records = [
        contact_cases.contact_record("fem", *each) for each in zip(SPEEDS, [(one,) for one in rolled], strict=True)
    ]
    whole = ROLLERS * study.scene.machine.roller_length
    study.resistance_stage.resistance = ResistanceMap(np.array(SPEEDS), whole * np.array([each.resistance for each in rolled]), 0.0)
    study.contact_stage.kept = None
    return study


@pytest.mark.parametrize("time", [0.8, 5.1])
def test_engine_rolls_as_the_motors_were_told(by_fem, time):
    motors, scene = by_fem.roller_motors["septic"], by_fem.scene
    (velocity,), answer = motors.over(np.array([time]))
    speed, way, length = abs(velocity), np.sign(velocity), scene.machine.roller_length
    layer, roller, material = contact_inputs(scene, by_fem.mix, "fem", speed)
    own = fem.roll(layer, roller, material, speed, estimate=False)
    held = Roller(R, own.indentation, by_fem.mix.steel_friction, "driven", scene.machine.gap_geometry)
    torque = way * answer.torque[0] / length
    rolled = fem.roll(layer, held, material, speed, torque=torque, estimate=False)
    assert answer.creep[0] == pytest.approx(rolled.creep, abs=0.02 * np.ptp(motors.roller.creeps))
    (leg,) = (leg for leg in motors.demand.cycle.legs() if leg.start <= time <= leg.start + leg.duration)
    state = motors.demand.at(leg, np.array([(time - leg.start) / leg.duration]))
    pull = way * state.forces.drive_force[0] / ROLLERS / length  # both guide wheels run above: they rub as ever
    assert own.resistance - rolled.resistance == pytest.approx(pull, rel=0.01, abs=2e-4 * own.load)
    # the layer keeps, and slip rubs away, what the motor gives less what the cart is given
    kept = rolled.resistance + torque / R * (1 + rolled.creep)
    assert rolled.work_residual * max(abs(rolled.resistance), 1e-3 * rolled.load) < 5e-4 * own.load
    assert kept > 0
    assert own.resistance - pull + torque / R * (1 + answer.creep[0]) == pytest.approx(kept, abs=1e-3 * own.load)


def test_a_roller_is_sampled_as_far_as_laws_ask(by_fem):
    motors = by_fem.roller_motors["septic"]
    roller = motors.roller
    assert by_fem.counts["driven"] == roller.torques.size
    assert roller.torques.shape[0] == len(SPEEDS)
    least, largest = pulls(motors.demand, ROLLERS)
    assert np.all(roller.pulls[:, 0] < least)
    assert np.all(roller.pulls[:, -1] > largest)
    assert least < 0 < largest
    assert motors.lack == ""
    assert 0.2 < motors.share < 0.9


def test_samples_end_where_friction_does(by_fem):
    contacts = copy(by_fem.contact_stage)
    contacts.records = by_fem.contacts[:1]
    roller = torque_response(contacts, (-1e9, 1e9))
    shares = roller.torques[0] / (by_fem.mix.steel_friction * R * roller.loads[0])
    assert shares[[0, -1]] == pytest.approx([-HELD, HELD], abs=5e-3)
    assert np.diff(spent(shares)) == pytest.approx(0.3, abs=0.02)
    beyond = roller(np.array([0.1]), np.array([1.2 * roller.pulls[0, -1]]))
    assert np.isnan(beyond.creep).all()
    assert beyond.share == pytest.approx(1.2 * HELD, rel=0.01)


def test_what_the_engine_does_not_solve_is_warned_of_and_left_out(by_fem, monkeypatch):
    def skids(*given, **asked):
        raise RuntimeError("the roller skids")

    monkeypatch.setattr(fem_engine, "roll", skids)
    with pytest.warns(UserWarning, match="creep of the driven rollers is left out: the roller skids"):
        answer = torque_response(by_fem.contact_stage, (-100.0, 900.0))
    assert answer == FirstOrder(R, by_fem.roller_load, by_fem.mix.steel_friction)


def test_engines_without_torque_tell_no_creep():
    study = Study(load_scene(SCENES / "small.toml"))
    assert {motors.roller for motors in study.roller_motors.values()} == {
        FirstOrder(R, study.roller_load, study.mix.steel_friction)
    }
    assert study.counts["driven"] == 0


@pytest.mark.slow
def test_compaction_tells_the_creep_of_its_rollers():
    """The free roller of the scene is that without torque, from which the others go on."""
    changes = {"accuracy.engine": "compaction", "contact.indentation": 0.002, "product.height": 0.1}
    scene = load_scene(SCENES / "small.toml", **changes, **{"mix.density_ratio": 0.95})
    study, speed = Study(scene), scene.motion.stroke / scene.motion.duration
    free = compaction.roll(*contact_inputs(scene, study.mix, "compaction", speed), speed, increments=6)
    contacts = study.contact_stage
    contacts.records = [contact_cases.contact_record("compaction", each, (free,)) for each in (speed, 2 * speed)]
    contacts.passes = [(speed, (free,))]
    load = scene.machine.roller_length * free.load
    roller = torque_response(contacts, (0.0, 0.2 * load))
    assert roller.speeds == pytest.approx([speed])
    assert roller.pulls[0, 0] == pytest.approx(0, abs=1e-4 * load)
    assert roller.creeps[0, 0] == pytest.approx(free.creep, rel=1e-3)
    assert roller.pulls[0, -1] > 0.2 * load
    assert roller.pulls[0] * R == pytest.approx(roller.torques[0], rel=0.2, abs=1e-4 * load)


# beyond friction


def test_a_pull_beyond_friction_is_told_with_its_share():
    motors = motor("septic", roller=carter(friction=0.1))
    run = run_of(motors)
    share = run.peak_force / ROLLERS / LOAD / 0.1
    assert motors.share == pytest.approx(share, rel=1e-9)
    assert share > HELD
    assert motors.lack == f"friction: {share:.3g} of what it holds"
    assert motors.peak_torque == motors.peak_power == motors.peak_creep == math.inf
    _, answer = motors.over(run.time)
    skids = np.abs(answer.share) > HELD
    assert np.array_equal(np.isnan(answer.creep), skids)
    assert skids.any()
    angle = motors.angle(np.linspace(0, 6, 400))
    first = np.argmax(np.isnan(angle))
    assert first > 0
    assert np.isnan(angle[first:]).all()


def test_without_creep_too_friction_must_hold():
    assert motor(roller=FirstOrder(R, LOAD, 0.18)).lack == "friction: 1.07 of what it holds"
    smooth = motor(roller=FirstOrder(R, LOAD, 0.0))
    assert smooth.lack == "friction: inf of what it holds"
    assert smooth.peak_torque == math.inf


def test_no_motor_follows_a_jump_of_velocity():
    motors = motor("gear-sector")
    assert motors.lack == "force: the velocity jumps"
    assert motors.peak_torque == math.inf


def test_standing_asks_nothing():
    motors = motor(roller=carter(), dwell=1.0)
    _, answer = motors.over(np.array([3.5, 7.5]))
    assert not np.any(answer)


def test_guide_wheels_that_lock_are_told():
    with pytest.raises(RuntimeError, match="the guide wheels lock the cart under 'quintic'"):
        pulls(motor(guide_friction=0.999, guide_positions=(0.1, -0.1)).demand, ROLLERS)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FirstOrder(R, 0.0, GRIP), "`load` must be positive and finite, got 0.0"),
        (lambda: FirstOrder(R, LOAD, -0.1), "`friction` must be zero or positive"),
        (lambda: carter(friction=0.0), "`friction` must be positive and finite, got 0.0"),
        (lambda: carter(slope=-0.1), "`creeps` must rise with the torque at every speed"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_rotation_is_the_travel_over_the_radius():
    """Paper B, constant speed: 48 dx/(43 T R), errata B-8; each derivative is that of the one before."""
    cycle, time, h = law("reversal-4-free-both", 0.4, 3.0).cycle(), np.linspace(0.05, 5.95, 40), 1e-5
    rotation = roller_rotation(cycle, R, time)
    assert roller_rotation(cycle, R, 1.5).angular_velocity == pytest.approx(48 * 0.4 / (43 * 3.0 * R), rel=1e-13)
    assert rotation.angle == pytest.approx(cycle.derivative(time, 0) / R, rel=1e-15)
    after, before = roller_rotation(cycle, R, time + h), roller_rotation(cycle, R, time - h)
    names = ("angle", "angular_velocity", "angular_acceleration", "angular_jerk")
    slopes = [(getattr(after, name) - getattr(before, name)) / (2 * h) for name in names[:-1]]
    assert np.array(slopes) == pytest.approx(np.array([getattr(rotation, name) for name in names[1:]]), abs=1e-4)


@pytest.mark.parametrize(
    ("radius", "time", "message"),
    [
        (-1.0, 0.0, "`roller_radius` must be positive and finite, got -1.0"),
        (0.1, np.nan, "`time` must be finite, got nan"),
    ],
)
def test_rotation_rejects_invalid_input(radius, time, message):
    with pytest.raises(ValueError, match=message):
        roller_rotation(law("quintic", 0.4, 3.0).cycle(), radius, time)
