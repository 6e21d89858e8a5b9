"""Free, driven and braked rollers over compacting mix, against the linear layer of "fem", limits and balances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact import fem
from compact.engines.compaction.engine import roll
from compact.engines.compaction.incremental_rolling import March
from compact.engines.compaction.results import build_result
from compact.engines.compaction.roller_contact import RollingSurface
from compact.engines.compaction.roller_frame import Frame, rolling_mesh
from compact.material.laws import Compaction, Elastic
from compact.rolling_contact import Layer, Roller

R, H = 0.11, 0.1
LAYER = Layer(H)
MIX = Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)
UNYIELDING = replace(MIX, heckel_slope=1e-12, tensile_strength=1e12)
SHALLOW, GRIP = 5e-4, 0.3  # indentation and friction over mix that does not yield
FREE = Roller(R, 0.002, GRIP, "free", "deformed")


def over_small(roller=FREE, speed=0.2, **numerics):
    return roll(LAYER, roller, MIX, speed, **{"increments": 6} | numerics)


@pytest.fixture(scope="module")
def free():
    return over_small()


def slip(rolled):
    """Of the mix along the roller over the speed at the nodes that touch, and the share of f p that each bears."""
    march = rolled.march
    surface, touching = march.frame.surface, march.push.pressure > 0
    moved = march.change[surface] / march.frame.step - [1, 0]
    along = np.sum(march.face.tangent(march.condition.displacement[surface]) * moved, axis=1)
    bound = max(rolled.roller.friction, 1e-9) * march.push.pressure[touching]
    return (1 + rolled.creep + along)[touching], march.push.shear[touching] / bound


# (a) the law at the nodes


def face_and_displacement(profile, seed, share=0.2):
    """Nodes on and off a roller that has gone one step of 5 mm, pulled by a share of what they can hold."""
    rng, x = np.random.default_rng(seed), np.linspace(-0.02, 0.02, 9)
    given = np.stack([x, np.full(9, H)], axis=-1), np.full(9, 0.005), R, H, 1e9, np.full(9, 1e5), profile
    face = RollingSurface(*given, grip=GRIP, pull=share * GRIP * 7 * 500, sheared=2e4 * rng.normal(size=9))
    face = face.at(H, -0.005).starting(1e-5 * rng.normal(size=(9, 2))).at(H - 0.0019)
    displacement = np.stack([np.zeros(9), np.where(np.abs(x) < 0.018, x**2 / (2 * R), 0) - 0.0019], axis=-1)
    return face, displacement + rng.normal(size=(9, 2)) * [1e-4, 1e-5]


@pytest.mark.parametrize("profile", ["deformed", "circle", "parabola"])
def test_stiffness_is_the_derivative_of_the_forces(profile):
    face, displacement = face_and_displacement(profile, 0)
    push, step = face.push(displacement), 1e-9
    stiffness = np.outer(*(part.ravel() for part in push.coupling))
    for node, block in enumerate(push.stiffness):
        stiffness[2 * node : 2 * node + 2, 2 * node : 2 * node + 2] += block
    nearby = step * np.eye(18).reshape(18, 9, 2)
    change = [face.push(displacement - d).forces - face.push(displacement + d).forces for d in nearby]
    differences = np.array(change).reshape(18, 18).T / (2 * step)
    assert differences == pytest.approx(stiffness, abs=1e-6 * np.abs(stiffness).max())


@pytest.mark.parametrize("profile", ["deformed", "circle", "parabola"])
def test_friction_at_once_meets_the_pull_and_has_its_derivative(profile):
    """Changes of pressure, displacement and displacement before, the creep among them, against central differences."""
    face, here = face_and_displacement(profile, 3)
    face, rng = replace(face, sticking=0.05), np.random.default_rng(3)
    before, pressure = here + 1e-4 * rng.normal(size=(9, 2)), 1e5 * rng.uniform(0.5, 1, 9)
    ways = 1e4 * rng.normal(size=9), *(1e-4 * rng.normal(size=(2, 9, 2)))
    gripping, slip = face.at_once(here, before, pressure)
    assert face.weight @ (pressure * gripping.friction) == pytest.approx(face.pull, abs=1e-6)

    def friction(step):
        moved, came = here + step * ways[1], before + step * ways[2]
        return face.at_once(moved, came, pressure + step * ways[0])[0].friction

    step = 1e-4
    differences = (friction(step) - friction(-step)) / (2 * step)
    change = slip.change(gripping, pressure, *ways)
    assert np.abs(change).max() > 1e-3
    assert change == pytest.approx(differences, abs=1e-5 * np.abs(change).max())


@given(st.sampled_from(["deformed", "circle", "parabola"]), st.integers(0, 10_000), st.floats(-0.9, 0.9))
def test_one_creep_meets_the_pull_within_coulombs_bounds(profile, seed, share):
    face, displacement = face_and_displacement(profile, seed, share)
    push = face.push(displacement)
    bound = GRIP * push.pressure
    assert np.all(np.abs(push.shear) <= bound)
    if abs(face.pull) < face.weight @ bound:
        assert face.weight @ push.shear == pytest.approx(face.pull, abs=1e-9 * (face.weight @ bound))
    else:
        assert np.abs(push.shear) == pytest.approx(bound)


# (b) mix that does not yield is the linear layer


def unyielding(profile, torque, count):
    """A roller marched over `count` elements per length sqrt(2 R depth)."""
    length = np.sqrt(2 * R * SHALLOW)
    frame = Frame(rolling_mesh(H, length, length / count), UNYIELDING, "bonded", length, finite=False, substeps=1)
    march = March(frame, R, profile=profile, friction=GRIP, torque=torque)
    for lowest in H - SHALLOW * np.minimum(np.arange(1, 6 * count) / count, 1):
        march.advance(lowest, drag=0.0)
    return build_result(march, LAYER, Roller(R, SHALLOW, GRIP, "driven", profile), UNYIELDING, 0.2)


def both(profile, share, count):
    """The same beside "fem", under a torque that is a share of what friction can hold."""
    roller, mix = Roller(R, SHALLOW, GRIP, "driven", profile), Elastic(MIX.unloading_modulus, MIX.poisson)
    plain = fem.roll(LAYER, replace(roller, rolling="frictionless"), mix, 0.2, estimate=False)
    torque = share * GRIP * R * plain.load
    return unyielding(profile, torque, count), fem.roll(LAYER, roller, mix, 0.2, torque=torque, estimate=False)


def creep_miss(rolled, linear):
    """Over f a/R, the scale of creep."""
    return (rolled.creep - linear.creep) / (GRIP * (linear.leading - linear.trailing) / 2 / R)


@pytest.mark.parametrize(
    ("profile", "share"),
    [("deformed", 0.0), ("deformed", 0.5), ("parabola", -0.5)],
    ids=["free", "driven", "braked"],
)
def test_mix_that_does_not_yield_is_the_linear_layer(profile, share):
    rolled, linear = both(profile, share, 8)
    limit = GRIP * linear.peak_pressure
    x = np.linspace(0.8 * linear.trailing, 0.8 * linear.leading, 41)
    traction, other = np.interp(x, rolled.x, rolled.shear_traction), np.interp(x, linear.x, linear.shear_traction)
    assert rolled.load == pytest.approx(linear.load, rel=2e-3)
    assert rolled.resistance == pytest.approx(linear.resistance, abs=2e-3 * GRIP * linear.load)
    assert creep_miss(rolled, linear) == pytest.approx(0, abs=0.05)
    assert np.abs(traction - other).mean() < 0.04 * limit


@pytest.mark.slow
def test_creep_tends_to_that_of_the_linear_layer():
    misses = [abs(creep_miss(*both("deformed", 0.5, count))) for count in (6, 12, 24)]
    assert misses[0] > misses[1] > misses[2]
    assert misses[2] < 0.015


# (c) limits


@pytest.mark.slow
def test_without_friction_to_speak_of_the_creep_is_the_middle_slip(free):
    """As much of the load slips ahead as back on a roller without friction."""
    hardly = over_small(replace(FREE, friction=1e-3), start=free)
    plain = over_small(replace(FREE, rolling="frictionless", friction=0.0), start=hardly)
    assert plain.creep is None
    assert hardly.load == pytest.approx(plain.load, rel=2e-3)
    assert hardly.resistance == pytest.approx(plain.resistance, rel=2e-3)
    rates, _ = slip(replace(plain, creep=0.0))
    weight = (plain.march.face.weight * plain.march.push.pressure)[plain.march.push.pressure > 0]
    order = np.argsort(rates)
    middle = rates[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)]
    assert hardly.creep == pytest.approx(-middle, abs=1e-3)


@pytest.mark.slow
def test_with_much_friction_all_but_the_ends_sticks():
    rates, _ = slip(over_small(replace(FREE, friction=3.0)))
    assert np.abs(rates[3:-2]).max() < 5e-4
    assert np.abs(rates).max() > 5e-3


@pytest.mark.slow
def test_roller_braked_to_its_limit_slides():
    """The limit is what friction holds normal to the roller, 2.6 % more here than its coefficient times the load.

    On 4 increments both are found at once; on 12 the braked one is marched, for 0.5 % more load.
    """
    sliding = over_small(Roller(R, 0.002, 0.15, "sliding", "deformed"), increments=4)
    held = sliding.march.face.weight @ sliding.march.push.shear
    braked = over_small(replace(FREE, friction=0.15, rolling="driven"), torque=-0.99 * R * held, increments=4)
    assert braked.load == pytest.approx(sliding.load, rel=5e-3)
    assert braked.resistance == pytest.approx(sliding.resistance, rel=0.02)
    assert braked.exit_density_ratio == pytest.approx(sliding.exit_density_ratio, abs=3e-4)


# (d) what the free roller does


@pytest.mark.slow
def test_coulomb_holds_at_every_node(free):
    rates, shares = slip(free)
    slips = np.abs(shares) > 1 - 1e-9
    assert np.abs(rates[~slips]).max() < 0.05 * np.abs(rates).max()
    assert np.all(rates[slips] * shares[slips] < 0)
    assert 0.2 < slips.mean() < 0.8


@pytest.mark.slow
def test_free_roller_is_not_pulled_by_its_shear(free):
    march = free.march
    assert abs(march.face.weight @ march.push.shear) < 1e-9 * free.load
    assert np.abs(free.shear_traction).max() > 0.1 * GRIP * free.peak_pressure


@pytest.mark.slow
def test_torque_is_what_the_resistance_lacks(free):
    torque = 0.5 * GRIP * R * free.load
    driven = over_small(replace(FREE, rolling="driven"), torque=torque, start=free)
    assert driven.creep > free.creep
    assert driven.march.face.weight @ driven.march.push.shear == pytest.approx(-torque / R)
    assert driven.resistance - free.resistance == pytest.approx(-torque / R, rel=0.15)  # first order in the slope
    assert driven.work_residual < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.5, -0.5], ids=["free", "driven", "braked"])
def test_work_of_roller_and_torque_is_kept_or_rubbed_away(share):
    rolled = over_small(replace(FREE, rolling="driven"), torque=share * GRIP * R * 7860, increments=12)
    assert rolled.work_residual < 0.02
    assert rolled.mass_residual < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.05, 0.45])
def test_deep_free_rollers_get_steady(friction):
    rolled = over_small(replace(FREE, indentation=0.004, friction=friction))
    assert rolled.work_residual < 0.02
    assert rolled.equilibrium_residual < 1e-3


@pytest.mark.slow
def test_both_ways_mirror_each_other():
    roller = Roller(2.0, 0.002, GRIP, "driven", "circle")
    numerics = {"torque": 500.0, "strain": "small", "increments": 6}
    there, back = (roll(LAYER, roller, MIX, way * 0.2, **numerics) for way in (1, -1))
    assert (back.load, -back.resistance, back.creep) == (there.load, there.resistance, there.creep)
    assert back.shear_traction == pytest.approx(-there.shear_traction[::-1])
    assert there.march.face.weight @ there.march.push.shear == pytest.approx(-500.0 / 2.0)


# (e) refusals


def test_roller_driven_too_hard_skids():
    with pytest.raises(RuntimeError, match=r"the roller skids: 1\.\d* times the friction limit asked"):
        unyielding("parabola", 700.0, 4)


@pytest.mark.parametrize(
    ("changes", "torque", "message"),
    [
        ({"rolling": "driven"}, None, "`torque` must be given for a 'driven' roller, got None"),
        ({"friction": 0.0}, 3.0, "`torque` needs a roller .* got 3.0 for 'free' with 0.0"),
        ({"rolling": "sliding"}, 3.0, "`torque` needs a roller .* got 3.0 for 'sliding' with 0.3"),
        ({}, np.nan, "`torque` must be finite, got nan"),
        ({"rolling": "skidding"}, None, "no rolling 'skidding'"),
    ],
)
def test_refusals(changes, torque, message):
    with pytest.raises(ValueError, match=message):
        roll(LAYER, replace(FREE, **changes), MIX, 0.2, torque=torque)
