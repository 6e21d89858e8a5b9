"""Steady search: drift, one answer whatever the start, errors; density fields, heaping, mix with a shear line."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from mixes import LIFT, LIFT_MIX, STIFF, free_roller
from mixes import shear_line as law

from compact import fem
from compact.engines.column.engine import required_feed
from compact.engines.compaction.engine import HeapingError, roll
from compact.engines.compaction.heaping import HeapingEstimate, bearing_factor
from compact.engines.compaction.rolling import RollingStep
from compact.engines.compaction.rolling_case import STEADY_TOLERANCE, RollingCase, RollingNumerics
from compact.engines.compaction.steady_state import QUANTITIES, WaveDrift
from compact.material.laws import earth_pressure_bounds, matched_slopes
from compact.material.mix import LOOSE_DENSITY_RATIO, prior
from compact.rolling_contact import Layer, Roller

PUBLISHED = LIFT, free_roller(), LIFT_MIX
# load and resistance of the published lift on the mesh, N/m, after 96 contact lengths from bow waves 10 % below and
# above the steady one, on 7 elements per contact length
BELOW, ABOVE = (9190.8, 1909.7), (9194.0, 1911.7)


def step(travel, wave_area, **values):
    fields = dict.fromkeys(RollingStep.__dataclass_fields__, 0.0)
    return RollingStep(**fields | {"travel": travel, "wave_area": wave_area} | values)


def decay(start, length=0.24, limit=1e-4, count=12):
    """Steps of a wave that relaxes exponentially; the load follows its area."""
    travel = start + 0.001 * np.arange(count)
    areas = limit * (1 - np.exp(-travel / length))
    return [step(s, area, load=5e3 + 2e7 * area) for s, area in zip(travel, areas, strict=True)]


def test_drift_is_the_slope_of_wave_and_load():
    drift = WaveDrift.of_steps(decay(0.1))
    assert drift.wave_slope == pytest.approx(1e-4 / 0.24 * np.exp(-0.1055 / 0.24), rel=1e-3)
    assert drift.slopes[QUANTITIES.index("load")] == pytest.approx(2e7 * drift.wave_slope, rel=1e-9)
    assert drift.wave_error < 1e-2 * drift.wave_slope


def test_rolled_state_is_steady(coarse):
    """The next step repeats the last one, part by part: forces within 0.2 %, displacements within 2 %.

    Marks of the start far behind the roller are left out, behind 1.2 contact lengths.
    """
    solution = coarse.solution
    frame = solution.frame
    again = copy(solution)
    step = again.advance(solution.steps[-1].bottom_height, 0.0)
    last = solution.steps[-1]
    assert (step.load, step.resistance) == pytest.approx((last.load, last.resistance), rel=2e-3)
    near = frame.nodes[:, 0] > -1.2 * frame.contact_length
    for part, before in zip(again.parts, solution.parts, strict=True):
        change = part.displacement_change - before.displacement_change
        assert np.linalg.norm(change[near]) < 0.02 * np.linalg.norm(before.displacement_change[near])


def test_two_percent_deeper_and_back_gives_the_first_solution(coarse, layer, roller, mix):
    deeper = roll(layer, replace(roller, indentation=0.00204), mix, 0.2, start=coarse)
    back = roll(layer, roller, mix, 0.2, start=deeper)
    assert back.load == pytest.approx(coarse.load, rel=3e-3)
    assert back.resistance == pytest.approx(coarse.resistance, rel=3e-3)


@pytest.mark.slow
def test_published_lift_is_that_of_two_starts():
    rolled = roll(*PUBLISHED, 0.13, increments=7)
    found = np.array([rolled.load / rolled.load_factor, rolled.resistance])  # on the mesh
    told = np.add(rolled.error_parts.drift, rolled.error_parts.start)
    assert np.all(np.abs(found / np.mean([BELOW, ABOVE], axis=0) - 1) < STEADY_TOLERANCE + told)
    assert np.all(told < 2e-3)
    assert rolled.error[0] < 0.03
    assert rolled.overdense_work == pytest.approx(0.4, abs=0.1)


@pytest.mark.slow
def test_answer_does_not_depend_on_the_path():
    """Deeper by 3 % and back, and up and down in friction; deeper by 15 % at once is no neighbour any more."""
    layer, roller, mix = PUBLISHED
    first = roll(*PUBLISHED, 0.13)

    def changed(start, **changes):
        return roll(layer, replace(roller, **changes), mix, 0.13, start=start)

    for path in ([{"indentation": 0.00308}, {}], [{"friction": 0.45}, {}]):
        found = first
        for changes in path:
            found = changed(found, **changes)
        assert (found.load, found.resistance) == pytest.approx((first.load, first.resistance), rel=3e-3)
    deeper = replace(roller, indentation=0.00345)
    scratch = roll(layer, deeper, mix, 0.13)
    neighbour = roll(layer, deeper, mix, 0.13, start=first)
    assert (neighbour.load, neighbour.resistance) == pytest.approx((scratch.load, scratch.resistance), rel=3e-3)


# ---- Density of the published lift, at rest and under load: fields for other programs, and numbers of the contact


FIELDS = {"density_ratio", "density_under_load", "pressure", "saturation_pressure", "stress", "plastic_work"}


@pytest.fixture(scope="module")
def rolled():
    """The lift before its wave is steady, to which the density, pressure and mass of a state are indifferent."""
    return roll(LIFT, free_roller(), LIFT_MIX, 0.13, increments=3, steady_tolerance=1e-2)


def read(rolled, path):
    """The fields as another program reads them from a file."""
    pyvista = pytest.importorskip("pyvista")
    fem.write_fields(rolled, path)
    return pyvista.read(path)


@pytest.fixture
def grid(rolled, tmp_path):
    return read(rolled, tmp_path / "lift.vtu")


def test_a_file_has_the_fields_and_the_density_under_load_is_that_at_rest_times_the_elastic_compression(grid):
    assert set(grid.cell_data) == FIELDS
    shapes = {name: grid.cell_data[name].shape for name in FIELDS}
    assert shapes == {name: (grid.n_cells, 6) if name == "stress" else (grid.n_cells,) for name in FIELDS}
    cells = grid.cell_data
    assert np.asarray(cells["pressure"]) == pytest.approx(-np.asarray(cells["stress"])[:, :3].mean(axis=1), abs=1e-6)
    loaded = cells["density_ratio"] * np.exp(cells["pressure"] / LIFT_MIX.bulk_modulus)
    assert np.asarray(cells["density_under_load"]) == pytest.approx(loaded, rel=1e-5)  # means of the elements
    assert cells["saturation_pressure"].min() == 0


def test_saturation_reaction_is_that_of_the_densest_state(rolled, grid):
    densest = rolled.solution.state.points.max_density_ratio
    reaction = LIFT_MIX.saturation_modulus * np.log(np.maximum(densest / LIFT_MIX.saturation_limit, 1))
    assert np.asarray(grid.cell_data["saturation_pressure"]) == pytest.approx(reaction.reshape(-1, 4).mean(axis=1))


def test_mix_at_rest_is_no_denser_than_the_limit_and_under_load_by_its_elastic_compression(rolled):
    assert LIFT_MIX.saturation_limit < rolled.peak_density_ratio < LIFT_MIX.saturation_limit + 1e-3
    pressure = -rolled.solution.state.points.stress[:, :3].mean(axis=1)
    highest = np.exp(pressure.max() / LIFT_MIX.bulk_modulus)
    assert 1 < rolled.peak_loaded_density_ratio / rolled.peak_density_ratio < highest


@pytest.mark.slow
def test_share_beyond_full_density_is_that_of_the_elements_between_the_edges(tmp_path):
    """An element counts by its mean density, the share by the points: 10 elements are needed."""
    rolled = roll(LIFT, free_roller(), LIFT_MIX, 0.13, increments=10)
    grid = read(rolled, tmp_path / "lift.vtu")
    grid.points += grid.point_data["displacement"]
    middle, area = grid.cell_centers().points[:, 0], grid.compute_cell_sizes()["Area"]
    between = (middle > rolled.trailing) & (middle < rolled.leading)
    full = between & (grid.cell_data["density_under_load"] > 1)
    assert rolled.overfull_share == pytest.approx(area[full].sum() / area[between].sum(), abs=0.02)
    assert 0 < rolled.overfull_share < 0.1


def test_mass_is_conserved_everywhere_and_the_density_is_reset_little(rolled):
    frame, state = rolled.solution.frame, rolled.solution.state
    interpolated, moved = frame.interpolated(state), frame.convect(state)
    ratio = moved.points.density_ratio / interpolated.points.density_ratio
    assert rolled.density_reset == pytest.approx(np.abs(np.log(ratio)).max(), rel=1e-9)
    assert rolled.density_reset < 1e-3
    assert rolled.mass_residual < 1e-9


# ---- Estimate of the largest depth in fresh mix: confined compression, scaling, and remedies that satisfy it


# of the default scene
MIX = replace(STIFF, heckel_slope=14.75e-6, critical_slope=0.99345, tensile_strength=14281.0, dry_side="flat")
WEAK = replace(MIX, critical_slope=0.3)
PRODUCT = HeapingEstimate(0.2294, 0.11, MIX)


# (a) closed forms


def test_contact_of_three_heights_compresses_the_layer_as_an_oedometer():
    """The whole height has the bearing pressure: k = 1 - (1 - k0) exp{-K_H [(p + pt)/A - pt]}."""
    estimate = HeapingEstimate(0.1, 0.3 / 1.07 / np.sin(np.pi / 4), WEAK)
    vertical = (1 + np.sqrt(1 + 4 * 0.3**2 / 9)) / 2
    k = 1 - 0.28 * np.exp(-14.75e-6 * ((estimate.bearing_pressure + 14281.0) / vertical - 14281.0))
    assert estimate.contact_length == pytest.approx(0.3)
    assert estimate.max_depth == pytest.approx(0.1 * (1 - 0.94 / k), rel=1e-5)


def test_bearing_pressure_on_a_deep_layer_is_prandtls():
    pc = np.log(0.28 / 0.06) / 14.75e-6
    shear_strength = 0.99345 * (pc + 14281) / 2 / np.sqrt(3)
    pressure = HeapingEstimate(1e6, 0.11, MIX).bearing_pressure
    assert pressure == pytest.approx(1.3 * (2 + np.pi) * shear_strength, rel=1e-6)


@pytest.mark.parametrize(
    ("friction", "factor"), [(0.0, 2 + np.pi), (0.35, 2.833), (1 / (1 + np.pi / 2), 1 + np.pi / 2), (0.5, 2)]
)
def test_bearing_factor_of_a_sliding_roller_is_greens(friction, factor):
    assert bearing_factor(friction) == pytest.approx(factor, rel=2e-4)
    assert bearing_factor(friction) == pytest.approx(bearing_factor(friction * (1 + 1e-9)), rel=1e-4)


def test_friction_of_a_sliding_roller_alone_reduces_the_depth():
    layer, free = Layer(0.06), Roller(0.11, indentation=0.003, friction=0.3, rolling="free", profile="deformed")
    sliding = replace(free, rolling="sliding")
    cases = [RollingCase(layer, each, MIX, 0.13, None, None, RollingNumerics()).heaping for each in (free, sliding)]
    assert cases[0].bearing_pressure / cases[1].bearing_pressure == pytest.approx((2 + np.pi) / bearing_factor(0.3))
    assert cases[1].max_depth < cases[0].max_depth


# (b) scaling


def test_depth_scales_with_lengths_and_load_with_stresses():
    stiff = replace(MIX, heckel_slope=MIX.heckel_slope / 7, tensile_strength=7 * MIX.tensile_strength)
    assert HeapingEstimate(3 * 0.2294, 3 * 0.11, MIX).max_depth == pytest.approx(3 * PRODUCT.max_depth, rel=1e-12)
    assert replace(PRODUCT, material=stiff).max_depth == pytest.approx(PRODUCT.max_depth, rel=1e-9)
    assert replace(PRODUCT, material=stiff).max_load == pytest.approx(7 * PRODUCT.max_load, rel=1e-9)


# (c) refusals before any solution


FED = required_feed(0.22, 0.98, MIX, 0.13)
LOOSER = replace(MIX, fed_density_ratio=0.9)


@pytest.mark.parametrize(
    ("layer", "roller", "mix", "options", "message"),
    [
        (FED.height, {"indentation": FED.indentation}, MIX, {}, r"`indentation` requires .* about 6.3\d mm: .* heaps"),
        (FED.height, {"indentation": 0.001}, MIX, {"exit_density_ratio": 0.98}, r"`exit_density_ratio` 0.98 requires"),
        (0.2294, {"load": 1e6}, MIX, {}, r"`load` must be at most about 4\d{4} N/m, .* got 1000000 N/m; reduce"),
        (0.3, {"radius": 0.02, "indentation": 0.0081}, LOOSER, {}, r"angle exceeds 45 degrees .* stay below 5.86 mm"),
    ],
    ids=["depth", "density", "load", "angle"],
)
def test_case_that_heaps_up_is_refused(layer, roller, mix, options, message):
    with pytest.raises(HeapingError, match=message):
        roll(Layer(layer), Roller(**{"radius": 0.11} | roller), mix, 0.13, **options)


# ---- Search for the steady state of mix with a shear line: a loose lift, targets, random lifts


DEPTH = 0.003


def lift(fed):
    return Layer(0.06 * 0.98 / fed), free_roller(DEPTH), law(fed, shear_viscosity=600.0)


@pytest.mark.slow
def test_loose_lift_is_steady_on_two_meshes():
    """Fed at 0.90, on 7 elements; one part an element has 4077 and 529.6 N/m."""
    found = roll(*lift(0.9), 0.13, increments=7)
    assert found.load == pytest.approx(3804, rel=0.01)
    assert found.resistance == pytest.approx(555.1, rel=0.01)
    assert sum(found.error_parts.drift) + sum(found.error_parts.start) < 0.01
    assert found.equilibrium_residual < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("target", [{"load": 4200.0}, {"exit_density_ratio": 0.945}], ids=str)
def test_targets_are_met(target):
    layer, roller, mix = lift(0.9)
    name, value = next(iter(target.items()))
    options = target if name == "exit_density_ratio" else {}
    found = roll(layer, roller if options else free_roller(None, **target), mix, 0.13, increments=7, **options)
    assert getattr(found, name) == pytest.approx(value, rel=1e-3)


def random_lift(seed):
    """Layer, roller, mix and options of a random lift with a shear line."""
    draw = np.random.default_rng([17, seed])
    depth = height = 0.0
    while not 0.01 * height <= depth <= 0.06 * height or not height:
        moisture, k, radius = draw.uniform(0.08, 0.12), draw.uniform(0.92, 0.985), draw.uniform(0.05, 0.3)
        height, angle = draw.uniform(0.04, 0.10), np.radians(draw.uniform(3, 20))
        depth = radius * (1 - np.cos(angle))
    friction, rolling = draw.uniform(0, 0.6), ("free", "driven", "sliding")[draw.integers(3)]
    cohesion, friction_angle = np.exp(draw.uniform(np.log(2.5e3), np.log(50e3))), draw.uniform(28, 40)
    mix = prior(moisture, k)
    strength = cohesion / np.tan(np.radians(friction_angle))
    low, high = earth_pressure_bounds(matched_slopes(friction_angle)[0], 200e3, strength)
    material = law(
        k / (1 + depth / height), friction_angle=friction_angle, cohesion=cohesion, shear_viscosity=600.0,
        earth_pressure_coefficient=float(np.clip(1 - np.sin(np.radians(friction_angle)), low + 0.01, high - 0.01)),
        unloading_modulus=mix.unloading_modulus, poisson=mix.poisson, heckel_slope=mix.heckel_slope,
        loose_density_ratio=LOOSE_DENSITY_RATIO,
    )  # fmt: skip
    torque = {"torque": float(draw.uniform(-0.3, 0.5) * friction * radius * 3000)} if rolling == "driven" else {}
    return (
        Layer(height + depth),
        Roller(radius, indentation=depth, friction=friction, rolling=rolling, profile="deformed"),
        material,
    ), torque


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 32, 44])
def test_random_lifts_are_steady(seed):
    scene, torque = random_lift(seed)
    found = roll(*scene, 0.13, **torque)
    assert found.mass_residual < 1e-3
    assert found.equilibrium_residual < 1e-4
    assert 0.005 < found.error[0] < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "words", "depths"),
    [(18, r"takes up [234567]\.?\d* % of the feed", 2), (26, "without slowing down, and takes up", 5)],
)
def test_random_lift_heaps_up(seed, words, depths):
    """A wave takes up a twentieth of the feed until a step fails, or grows."""
    scene, torque = random_lift(seed)
    with pytest.raises(HeapingError, match=words) as raised:
        roll(*scene, 0.13, **torque)
    assert raised.value.heaping.wave_height > depths * scene[1].indentation


@pytest.mark.slow
def test_random_lift_with_a_high_wave_is_steady():
    scene, torque = random_lift(25)
    rolled = roll(*scene, 0.13, **torque)
    assert rolled.bow_wave > 10 * scene[1].indentation
    assert max(rolled.error) < 0.08  # with that by the elements
