"""Free, driven and braked rollers over compacting mix, against the linear layer of "fem", limits and balances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mixes import MIX

from compact import fem
from compact.engines.compaction.engine import build_result, roll
from compact.engines.compaction.roller_contact import ContactTractions, RollerSurface
from compact.engines.compaction.roller_frame import RollerFrame, rolling_mesh
from compact.engines.compaction.rolling import IncrementalRolling
from compact.material.laws import Elastic
from compact.rolling_contact import Layer, Roller

R, H = 0.11, 0.1
LAYER = Layer(H)
UNYIELDING = replace(MIX, heckel_slope=1e-12, tensile_strength=1e12)
SHALLOW, FRICTION = 5e-4, 0.3  # indentation [m] and friction [-] on mix that does not yield
FREE = Roller(R, indentation=0.002, friction=FRICTION, rolling="free", profile="deformed")
PROFILES = ["deformed", "circle", "parabola"]


def roll_high_layer(roller=FREE, speed=0.2, **options):
    return roll(LAYER, roller, MIX, speed, **{"increments": 6} | options)


@pytest.fixture(scope="module")
def free():
    return roll_high_layer()


def slip_and_shear(rolled):
    """Slip over speed of the nodes in contact, and their shear over the friction limit."""
    solution = rolled.solution
    nodes, touching = solution.frame.surface_nodes, solution.contact.pressure > 0
    last, travel = solution.parts[-1], solution.frame.step / len(solution.parts)
    velocity = last.displacement_change[nodes] / travel - [1, 0]
    along = np.sum(solution.surface.tangents(solution.state.displacement[nodes]) * velocity, axis=1)
    bound = max(rolled.roller.friction, 1e-9) * solution.contact.pressure[touching]
    return (1 + (last.contact.creepage or 0.0) + along)[touching], solution.contact.shear[touching] / bound


def total_shear(rolled):
    return rolled.solution.surface.weights @ rolled.solution.contact.shear


# (a) the law at the nodes


def surface_and_displacement(profile, seed, share=0.2):
    """Nodes inside and outside a contact after one step of 5 mm, with a share of the friction limit as torque."""
    rng, x = np.random.default_rng(seed), np.linspace(-0.02, 0.02, 9)
    multipliers = ContactTractions(np.full(9, 1e5), 2e4 * rng.normal(size=9))
    surface = RollerSurface(
        np.stack([x, np.full(9, H)], axis=-1), np.full(9, 0.005), R, H, 1e9, profile, FRICTION,
        share * FRICTION * 7 * 500, multipliers,
    )  # fmt: skip
    surface = surface.moved_to(H, -0.005).begin_increment(1e-5 * rng.normal(size=(9, 2))).moved_to(H - 0.0019)
    displacement = np.stack([np.zeros(9), np.where(np.abs(x) < 0.018, x**2 / (2 * R), 0) - 0.0019], axis=-1)
    return surface, displacement + rng.normal(size=(9, 2)) * [1e-4, 1e-5]


@pytest.mark.parametrize("profile", PROFILES)
def test_stiffness_is_the_derivative_of_the_forces(profile):
    surface, displacement = surface_and_displacement(profile, 0)
    contact, step = surface.contact_forces(displacement), 1e-9
    stiffness = np.outer(*(part.ravel() for part in contact.creep_coupling))
    for node, block in enumerate(contact.stiffness):
        stiffness[2 * node : 2 * node + 2, 2 * node : 2 * node + 2] += block
    perturbations = step * np.eye(18).reshape(18, 9, 2)
    change = [
        surface.contact_forces(displacement - d).forces - surface.contact_forces(displacement + d).forces
        for d in perturbations
    ]
    differences = np.array(change).reshape(18, 18).T / (2 * step)
    assert differences == pytest.approx(stiffness, abs=1e-6 * np.abs(stiffness).max())


@settings(max_examples=25)
@given(st.sampled_from(PROFILES), st.integers(0, 10_000), st.floats(-0.9, 0.9))
def test_one_creepage_satisfies_the_torque_within_coulombs_bounds(profile, seed, share):
    surface, displacement = surface_and_displacement(profile, seed, share)
    contact = surface.contact_forces(displacement)
    bound = FRICTION * contact.pressure
    assert np.all(np.abs(contact.shear) <= bound)
    if abs(surface.tangential_force) < surface.weights @ bound:
        total = surface.weights @ contact.shear
        assert total == pytest.approx(surface.tangential_force, abs=1e-9 * (surface.weights @ bound))
    else:
        assert np.abs(contact.shear) == pytest.approx(bound)


# (b) mix that does not yield equals the linear layer


def roll_unyielding(profile, torque, count):
    """Incremental rolling over `count` elements per length sqrt(2 R depth)."""
    length = np.sqrt(2 * R * SHALLOW)
    mesh = rolling_mesh(H, length, length / count)
    frame = RollerFrame(mesh, UNYIELDING, "bonded", length, finite=False)
    roller = Roller(R, indentation=SHALLOW, friction=FRICTION, rolling="driven", profile=profile)
    rolling = IncrementalRolling(frame, roller, torque)
    for bottom_height in H - SHALLOW * np.minimum(np.arange(1, 6 * count) / count, 1):
        rolling.advance(bottom_height, damping=0.0)
    return build_result(rolling, LAYER, roller, UNYIELDING, 0.2)


def roll_both(profile, share, count):
    """Results of both engines under a torque that is a share of the friction limit."""
    roller = Roller(R, indentation=SHALLOW, friction=FRICTION, rolling="driven", profile=profile)
    mix = Elastic(youngs_modulus=MIX.unloading_modulus, poisson=MIX.poisson)
    frictionless = fem.roll(LAYER, replace(roller, rolling="frictionless"), mix, 0.2, estimate=False)
    torque = share * FRICTION * R * frictionless.load
    linear = fem.roll(LAYER, roller, mix, 0.2, torque=torque, estimate=False)
    return roll_unyielding(profile, torque, count), linear


def creepage_difference(rolled, linear):
    """Difference of the creepages over their scale f a/R."""
    return (rolled.creep - linear.creep) / (FRICTION * (linear.leading - linear.trailing) / 2 / R)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("profile", "share"), [("deformed", 0.0), ("deformed", 0.5), ("parabola", -0.5)], ids=["free", "driven", "braked"]
)
def test_mix_that_does_not_yield_equals_the_linear_layer(profile, share):
    rolled, linear = roll_both(profile, share, 12)
    x = np.linspace(0.8 * linear.trailing, 0.8 * linear.leading, 41)
    traction, expected = (np.interp(x, result.x, result.shear_traction) for result in (rolled, linear))
    assert rolled.load == pytest.approx(linear.load, rel=2e-3)
    assert rolled.resistance == pytest.approx(linear.resistance, abs=2e-3 * FRICTION * linear.load)
    assert creepage_difference(rolled, linear) == pytest.approx(0, abs=0.05)
    assert np.abs(traction - expected).mean() < 0.04 * FRICTION * linear.peak_pressure


# (c) limits


@pytest.mark.slow
def test_roller_braked_to_its_limit_slides():
    """The limit is that of the tractions normal to the roller, 2.6 % more here than friction times load."""
    sliding = roll_high_layer(
        Roller(R, indentation=0.002, friction=0.15, rolling="sliding", profile="deformed"), increments=4
    )
    torque = -0.99 * R * total_shear(sliding)
    braked = roll_high_layer(replace(FREE, friction=0.15, rolling="driven"), torque=torque, increments=4)
    assert braked.load == pytest.approx(sliding.load, rel=5e-3)
    assert braked.resistance == pytest.approx(sliding.resistance, rel=0.02)
    assert braked.exit_density_ratio == pytest.approx(sliding.exit_density_ratio, abs=3e-4)


# (d) the free roller


@pytest.mark.slow
def test_coulombs_law_holds_at_every_node_of_a_free_roller(free):
    rates, shares = slip_and_shear(free)
    slipping = np.abs(shares) > 1 - 1e-9
    assert np.abs(rates[~slipping]).max() < 0.05 * np.abs(rates).max()
    assert np.all(rates[slipping] * shares[slipping] < 0)
    assert 0.2 < slipping.mean() < 0.8
    assert abs(total_shear(free)) < 1e-9 * free.load
    assert np.abs(free.shear_traction).max() > 0.1 * FRICTION * free.peak_pressure


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "options"),
    [
        *(
            ({"rolling": "driven"}, {"torque": share * FRICTION * R * 7860, "increments": 14})
            for share in (0, 0.5, -0.5)
        ),
        *(({"indentation": 0.004, "friction": friction}, {}) for friction in (0.05, 0.45)),
    ],
    ids=["free", "driven", "braked", "deep and smooth", "deep and rough"],
)
def test_work_of_roller_and_torque_balances(changes, options):
    rolled = roll_high_layer(replace(FREE, **changes), **options)
    assert rolled.work_residual < 0.02
    assert rolled.mass_residual < 2e-3
    assert rolled.equilibrium_residual < 1e-3


# (e) refusals


@pytest.mark.slow
def test_creepage_converges_to_that_of_the_linear_layer():
    differences = [abs(creepage_difference(*roll_both("deformed", 0.5, count))) for count in (6, 12, 24)]
    assert differences[0] > differences[1] > differences[2]
    assert differences[2] < 0.015


@pytest.mark.slow
def test_creepage_tends_to_the_median_slip_without_friction(free):
    """Half of the load of a frictionless roller slips ahead and half behind."""
    slight = roll_high_layer(replace(FREE, friction=1e-3), start=free)
    frictionless = roll_high_layer(replace(FREE, rolling="frictionless", friction=0.0), start=slight)
    assert frictionless.creep is None
    assert slight.load == pytest.approx(frictionless.load, rel=2e-3)
    assert slight.resistance == pytest.approx(frictionless.resistance, rel=2e-3)
    rates, _ = slip_and_shear(replace(frictionless, creep=0.0))
    solution = frictionless.solution
    weights = (solution.surface.weights * solution.contact.pressure)[solution.contact.pressure > 0]
    order = np.argsort(rates)
    median = rates[order][np.searchsorted(np.cumsum(weights[order]), weights.sum() / 2)]
    assert slight.creep == pytest.approx(-median, abs=1e-3)


@pytest.mark.slow
def test_high_friction_sticks():
    rates, _ = slip_and_shear(roll_high_layer(replace(FREE, friction=3.0)))
    assert np.abs(rates[3:-2]).max() < 5e-4


@pytest.mark.slow
def test_opposite_directions_are_mirror_images():
    roller = Roller(2.0, indentation=0.002, friction=FRICTION, rolling="driven", profile="circle")
    options = {"torque": 500.0, "strain": "small", "increments": 6}
    there, back = (roll(LAYER, roller, MIX, sign * 0.2, **options) for sign in (1, -1))
    assert (back.load, -back.resistance, back.creep) == (there.load, there.resistance, there.creep)
    assert back.shear_traction == pytest.approx(-there.shear_traction[::-1])
    assert total_shear(there) == pytest.approx(-500.0 / 2.0)


@pytest.mark.slow
def test_torque_reduces_the_resistance():
    """The work balances to 0.6 % on 12 increments and to 3.4 % on 6."""
    free = roll_high_layer(increments=12)
    torque = 0.5 * FRICTION * R * free.load
    driven = roll_high_layer(replace(FREE, rolling="driven"), torque=torque, start=free, increments=12)
    assert driven.creep > free.creep
    assert total_shear(driven) == pytest.approx(-torque / R)
    assert driven.resistance - free.resistance == pytest.approx(-torque / R, rel=0.15)  # of first order in the slope
    assert driven.work_residual < 0.03
