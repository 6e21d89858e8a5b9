"""One roller of a pair against columns, a linear layer, a whole layer between two rollers, and balances."""

from dataclasses import replace

import numpy as np
import pytest

from compact import fem
from compact.engines.column import engine as column
from compact.engines.compaction.engine import roll
from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid
from compact.engines.compaction.incremental_rolling import IncrementalRolling
from compact.engines.compaction.newton import IncrementSolver
from compact.engines.compaction.results import build_result
from compact.engines.compaction.roller_contact import PairSurface
from compact.engines.compaction.roller_frame import RollerFrame, rolling_mesh
from compact.material.laws import Compaction, Elastic
from compact.mesh import RowMesh
from compact.rolling_contact import Layer, LowerLift, Roller

# powder from a density ratio of 0.5 in half a gap of 1.25 mm, contact of 7 layer heights
POWDER = Compaction(1e9, 0.2, 11.5e-9, 0.38, 1.2, 1e6, 0.5)
LAYER = Layer(0.002, base="slip")
ROLLER = Roller(0.125, 0.00075, 0.35, "pair", "deformed")
PROFILES = ["deformed", "circle", "parabola"]


@pytest.fixture(scope="module")
def rolled():
    return roll(LAYER, ROLLER, POWDER, 0.2)


# (a) the law at the nodes


def surface_and_displacement(profile):
    """Nodes inside and outside a contact after one step of 5 mm."""
    rng, x, height = np.random.default_rng(3), np.linspace(-0.02, 0.02, 9), 0.1
    geometry = np.stack([x, np.full(9, height)], axis=-1), np.full(9, 0.005), 0.11, height, 1e9, np.full(9, 1e5)
    surface = PairSurface(*geometry, profile, friction=0.3, multiplier_shear=2e4 * rng.normal(size=9))
    surface = surface.moved_to(height, -0.005).begin_increment(1e-5 * rng.normal(size=(9, 2)))
    displacement = np.stack([np.zeros(9), np.where(np.abs(x) < 0.018, x**2 / 0.22, 0) - 0.0019], axis=-1)
    return surface.moved_to(height - 0.0019), displacement + rng.normal(size=(9, 2)) * [1e-4, 1e-5]


@pytest.mark.parametrize("profile", PROFILES)
def test_stiffness_is_the_derivative_of_forces_without_sum_along_x(profile):
    surface, displacement = surface_and_displacement(profile)
    contact, step = surface.contact_forces(displacement), 1e-9
    assert abs(surface.feed_force(contact)) < 1e-9 * surface.weights @ contact.pressure
    stiffness = np.outer(*(part.ravel() for part in contact.creep_coupling))
    for node, block in enumerate(contact.stiffness):
        stiffness[2 * node : 2 * node + 2, 2 * node : 2 * node + 2] += block
    change = [
        surface.contact_forces(displacement - d).forces - surface.contact_forces(displacement + d).forces
        for d in step * np.eye(18).reshape(18, 9, 2)
    ]
    differences = np.array(change).reshape(18, 18).T / (2 * step)
    assert differences == pytest.approx(stiffness, abs=1e-6 * np.abs(stiffness).max())


# (b) limits


@pytest.mark.parametrize("height", [0.01, pytest.param(0.1, marks=pytest.mark.slow)])
def test_mix_that_does_not_yield_equals_the_linear_layer_under_the_same_torque(height):
    radius, depth, friction, count = 0.11, 5e-4, 0.3, 8
    stiff = replace(POWDER, unloading_modulus=60e6, heckel_slope=1e-12, tensile_strength=1e12, fed_density_ratio=0.94)
    length, layer = np.sqrt(2 * radius * depth), Layer(height, base="slip")
    frame = RollerFrame(rolling_mesh(height, length, length / count), stiff, "slip", length, finite=False)
    rolling = IncrementalRolling(frame, radius, friction=friction, pair=True)
    for bottom_height in height - depth * np.minimum(np.arange(1, 6 * count) / count, 1):
        rolling.advance(bottom_height, damping=0.0)
    pair = Roller(radius, depth, friction, "pair", "deformed")
    found = build_result(rolling, layer, pair, stiff, 0.2)
    driven, elastic = replace(pair, rolling="driven"), Elastic(60e6, 0.2)
    linear = fem.roll(layer, driven, elastic, 0.2, torque=found.torque, estimate=False)
    assert found.load == pytest.approx(linear.load, rel=3e-3)
    assert abs(linear.resistance) < 2e-4 * linear.load  # no force along x, as of the pair
    assert abs(found.resistance) < 2e-4 * found.load  # no work
    assert abs(found.creep - linear.creep) < 0.05 * friction * length / radius


@pytest.mark.slow
def test_thin_layer_tends_to_columns():
    """Contact of 40 and 160 layer heights on rollers to which the mix sticks."""
    mix = Compaction(60e6, 0.3, 13e-6, 0.72, 2.0, 14e3, 0.93)
    distance = []
    for ratio in (40, 160):
        height = 2 * 0.03 * 0.11 / ratio**2
        layer, roller = Layer(height, base="slip"), Roller(0.11, 0.03 * height, 10.0, "pair", "deformed")
        found = roll(layer, roller, mix, 0.2, increments=24)
        columns = column.roll(layer, replace(roller, profile="circle"), mix, 0.2)
        work = found.torque * (1 + found.creep) / roller.radius
        assert found.resistance == pytest.approx(work, rel=1e-9)
        distance.append((found.load / columns.load - 1, found.resistance / columns.resistance - 1))
    (first_load, first_resistance), (load, resistance) = distance
    assert abs(load) < 1e-3
    assert abs(resistance) < 3e-3
    assert first_load < -5e-3 < load
    assert first_resistance < -5e-3 < resistance


# (c) the mid-plane


class GearedRollers:
    """Two rollers at the same speed below and above a whole layer; the lower one is the mirror image."""

    def __init__(self, surface, below):
        self.surface, self.sign = surface, np.where(below[:, None], [1.0, -1.0], 1.0)

    def moved_to(self, *place):
        return GearedRollers(self.surface.moved_to(*place), self.sign[:, 1] < 0)

    def begin_increment(self, displacement):
        return GearedRollers(self.surface.begin_increment(displacement * self.sign), self.sign[:, 1] < 0)

    def with_multipliers(self, contact):
        return GearedRollers(self.surface.with_multipliers(contact), self.sign[:, 1] < 0)

    def contact_forces(self, displacement):
        sign, contact = self.sign, self.surface.contact_forces(displacement * self.sign)
        coupling = contact.creep_coupling and tuple(part * sign for part in contact.creep_coupling)
        stiffness = contact.stiffness * sign[:, :, None] * sign[:, None, :]
        return replace(contact, forces=contact.forces * sign, stiffness=stiffness, creep_coupling=coupling)


def roll_steps(frame, surface, nodes, heights):
    """Roll without damping; return displacement and contact."""
    solver, state, contact = IncrementSolver(frame.solid, nodes, 1e-9), frame.initial_state(), None
    for bottom_height in heights:
        state = frame.convect(state)
        back = surface.moved_to(bottom_height, -frame.step).begin_increment(state.displacement[nodes])
        found = solver.solve(state, back.moved_to(bottom_height), state.displacement)
        state, contact = found.state, found.contact
        surface = surface.with_multipliers(contact)
    return state.displacement, contact


@pytest.mark.slow
def test_half_the_layer_is_the_layer_between_two_rollers():
    height, radius, length = LAYER.height, ROLLER.radius, 0.0137
    half_mesh = rolling_mesh(height, length, length / 3)
    half = RollerFrame(half_mesh, POWDER, "slip", length)
    y = np.concatenate([height - half_mesh.y[::-1], height + half_mesh.y[1:]])
    mesh = RowMesh(np.tile(half_mesh.x[0], (len(y), 1)), y)
    whole = RollerFrame(mesh, POWDER, "slip", length)
    x, level = whole.nodes.T
    front = x > x.max() - 1e-9
    held = np.flatnonzero(front & (np.abs(level - height) < 1e-9))  # the rollers hold the rest
    fixed = np.concatenate([2 * np.flatnonzero(front), 2 * held + 1])
    whole.solid = FiniteStrainSolid(mesh, POWDER, fixed_dofs=fixed, travel=whole.step)
    above = whole.surface_nodes
    bottom = np.flatnonzero(level < 1e-9)
    nodes = np.concatenate([above, bottom[np.argsort(x[bottom])]])
    below = np.arange(len(nodes)) >= len(above)

    def pair(frame, places, weights, top):
        geometry = places, weights, radius, top, 0.15 * 1e9 / (height / 20), np.zeros(len(places))
        return PairSurface(*geometry, friction=ROLLER.friction)

    steps = 1 - 0.2 * np.minimum(np.arange(1, 7) / 4, 1)
    moved, contact = roll_steps(
        half,
        pair(half, half.nodes[half.surface_nodes], half.surface_weights, height),
        half.surface_nodes,
        height * steps,
    )
    places = np.where(below[:, None], whole.nodes[nodes] * [1, -1] + [0, 2 * height], whole.nodes[nodes])
    rollers = GearedRollers(pair(whole, places, np.tile(whole.surface_weights, 2), 2 * height), below)
    whole_moved, whole_contact = roll_steps(whole, rollers, nodes, height + height * steps)

    count, scale = len(above), np.abs(moved).max()
    assert whole_moved[above] == pytest.approx(moved[half.surface_nodes], abs=1e-6 * scale)
    assert whole_moved[nodes[count:]] == pytest.approx(moved[half.surface_nodes] * [1, -1], abs=1e-6 * scale)
    largest = contact.pressure.max()
    assert whole_contact.pressure[:count] == pytest.approx(contact.pressure, abs=1e-6 * largest)
    assert whole_contact.shear[count:] == pytest.approx(contact.shear, abs=1e-6 * largest)
    assert whole_contact.creepage == pytest.approx(contact.creepage, rel=1e-6)


# (d) balances, slip and targets


def test_mass_work_and_forces_along_x_balance(rolled):
    surface, contact = rolled.solution.surface, rolled.solution.contact
    assert rolled.mass_residual < 1e-5
    assert rolled.work_residual < 5e-3  # the default mesh; halves with the elements
    assert abs(surface.feed_force(contact)) < 1e-9 * rolled.load
    assert rolled.resistance == pytest.approx(rolled.torque * (1 + rolled.creep) / 0.125, rel=1e-9)


@pytest.mark.slow
def test_work_balance_and_nip_converge_with_the_mesh(rolled):
    fine = roll(LAYER, ROLLER, POWDER, 0.2, increments=42)
    assert fine.work_residual < 2e-3
    assert fine.mass_residual < 1e-5
    assert fine.nip_angle == pytest.approx(rolled.nip_angle, abs=0.5 * 0.0137 / 14 / 0.125 + 0.01)
    assert abs(fine.resistance / rolled.resistance - 1) < 0.02


def test_strip_leaves_faster_than_the_rims(rolled):
    solution = rolled.solution
    frame, column_index = solution.frame, solution.frame.exit_column
    along = frame.to_rows(frame.solid.displacement_gradient(solution.state.displacement)[:, 0])[:, column_index]
    fed = POWDER.fed_density_ratio * LAYER.height
    speed = fed / (rolled.exit_density_ratio * rolled.exit_height)  # of the strip over the feed, by its mass
    elongation = frame.row_heights @ along / LAYER.height
    assert 1 + elongation == pytest.approx(speed, rel=1e-2)  # at the exit column, before it is quite at rest
    assert speed > 1 + rolled.creep > 1
    assert 0 < rolled.neutral_angle < rolled.nip_angle < rolled.leading / ROLLER.radius


@pytest.mark.parametrize(
    ("name", "value"),
    [("load", 6e5), ("peak_pressure", 5e7), ("exit_density_ratio", 0.65)],
)
def test_targets_are_reached(name, value):
    target = {"indentation": 0.0007} if name == "exit_density_ratio" else {name: value}
    roller = replace(ROLLER, **{"indentation": None} | target)
    options = {name: value} if name == "exit_density_ratio" else {}
    found = roll(LAYER, roller, POWDER, 0.2, increments=5, **options)
    assert getattr(found, name) == pytest.approx(value, rel=1e-3)


@pytest.mark.slow
def test_less_friction_draws_less_mix_in(rolled):
    smooth = roll(LAYER, replace(ROLLER, friction=0.2), POWDER, 0.2, increments=7)
    assert smooth.nip_angle < rolled.nip_angle
    assert smooth.load < 0.8 * rolled.load
    with pytest.raises(RuntimeError, match="the rollers slip over the whole contact and do not draw the mix in"):
        roll(LAYER, replace(ROLLER, friction=0.02), POWDER, 0.2, increments=5)


@pytest.mark.parametrize(
    ("layer", "roller", "words"),
    [
        (Layer(0.002), ROLLER, "`rolling` 'pair' needs the `base` 'slip', the mid-plane .* got 'bonded'"),
        (LAYER, replace(ROLLER, friction=0.0), "`rolling` 'pair' needs `friction`"),
        (replace(LAYER, lower_lift=LowerLift(0.01, 0.8)), ROLLER, "`rolling` 'pair' takes no `lower_lift`"),
    ],
)
def test_a_pair_without_mid_plane_or_friction_is_refused(layer, roller, words):
    for engine in (roll, column.roll):
        with pytest.raises(ValueError, match=words):
            engine(layer, roller, POWDER, 0.2)


def test_linear_engines_refuse_a_pair():
    with pytest.raises(ValueError, match="`rolling` 'pair' needs mix that compacts"):
        fem.roll(LAYER, ROLLER, Elastic(1e9, 0.2), 0.2)
