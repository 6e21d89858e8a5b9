"""Random scenes of rolling over a compacting layer: those that are refused, and the balances of the others.

Moisture 8 to 12 %, exit density ratio 0.92 to 0.985, fed density ratio k/(1 + depth/height), roller radius 0.08 to
0.2 m, depth 1 to 6 % of the compacted height, free roller with friction 0 to 0.45, and the prior's mix. Products of
0.16 to 0.28 m are much higher than the contact is long; most have no steady state. Lifts of 0.04 to 0.08 m have one.
"""

from dataclasses import replace

import numpy as np
import pytest
from column_cases import mix_of
from mixes import STIFF, calibrated, free_roller

from compact.engines.compaction.engine import HeapingError, roll
from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
from compact.material.laws import Compaction
from compact.rolling_contact import Layer, Roller, UnsteadyError

PRODUCT, LIFT = (0.16, 0.28), (0.04, 0.08)  # [m], heights of compacted layers


def random_scene(seed, heights=PRODUCT):
    """Layer, roller and material of a product or a lift."""
    draw = np.random.default_rng(seed)
    moisture, k, radius = draw.uniform(0.08, 0.12), draw.uniform(0.92, 0.985), draw.uniform(0.08, 0.2)
    height = draw.uniform(*heights)
    depth, friction = height * draw.uniform(0.01, 0.06), draw.uniform(0, 0.45)
    roller = Roller(radius, indentation=depth, friction=friction, rolling="free", profile="deformed")
    return Layer(height + depth), roller, mix_of(moisture, k, k / (1 + depth / height))


def calibrated_scene(height, depth, heckel_slope, fed):
    """A published scene with the mix fitted to it."""
    return Layer(height * 0.98 / fed), free_roller(depth), calibrated(heckel_slope, fed)


SOLVED = {
    **{f"lift {seed}": random_scene(seed, LIFT) for seed in range(40)},
    **{f"product {seed}": random_scene(seed) for seed in (2, 3, 25)},
    "steep": (
        Layer(0.23),
        Roller(0.11, indentation=0.009),
        replace(STIFF, heckel_slope=28e-6, fed_density_ratio=0.935, dry_side="flat"),
    ),
    "published lift": calibrated_scene(0.06, 0.003, 14.96e-6, 0.93576),
    "published lift of 40 mm": calibrated_scene(0.04, 0.0033, 11.7e-6, 0.905),
    "published product": calibrated_scene(0.22, 0.00275, 24.95e-6, 0.9687),
}
# products that the estimate refuses, of those without a solution within minutes
UNSOLVED = (0, 1, 6, 8, 9, 16, 20, 22, 23, 26, 27, 30, 34, 37, 39)


@pytest.mark.parametrize("scene", SOLVED)
def test_estimate_accepts_scenes_with_a_computed_steady_state(scene, no_solution):
    with pytest.raises(no_solution):
        roll(*SOLVED[scene], 0.13)


@pytest.mark.parametrize("seed", UNSOLVED)
def test_estimate_refuses_products_that_heap_up(seed, no_solution):
    message = r"the rest heaps up in front of the roller \(an estimate\); "
    with pytest.raises(HeapingError, match=message):
        roll(*random_scene(seed), 0.13)


def assert_balanced(rolled, work=0.02):
    solution = rolled.solution
    assert rolled.mass_residual < 2e-3
    assert rolled.equilibrium_residual < 1e-4
    assert rolled.yield_residual < 1e-9
    assert abs(solution.surface.weights @ solution.contact.shear) < 1e-9 * rolled.load
    assert rolled.work_residual < work


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 25])
def test_some_products_of_the_prior_become_steady(seed):
    """Contact angles of 16, 11 and 11 degrees; of the first 40 products the others have no solution within minutes."""
    assert_balanced(roll(*random_scene(seed), 0.13, increments=4), work=0.07)


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=pytest.mark.slow if seed % 2 else pytest.mark.nightly) for seed in range(40)]
)
def test_lifts_become_steady_with_default_options(seed):
    rolled = roll(*random_scene(seed, LIFT), 0.13)
    assert_balanced(rolled)
    assert 0 < rolled.error[0] < 0.06


SLIDING = (
    Layer(0.0732),
    Roller(0.119, indentation=0.00152, friction=0.31, rolling="sliding", profile="deformed"),
    Compaction(
        unloading_modulus=107e6,
        poisson=0.308,
        heckel_slope=15.1e-6,
        loose_density_ratio=0.72,
        critical_slope=0.972,
        tensile_strength=13.2e3,
        fed_density_ratio=0.957,
    ),
)


def growth_without_jumps(friction, steps=60):
    """Growth of the bow wave per travel [m] in successive sixths of incremental rolling from rest."""
    layer, roller, material = SLIDING
    case = RollingCase(
        layer, replace(roller, friction=friction), material, 0.13, None, None, RollingNumerics(max_contact_angle=None)
    )
    rolling = case.roller_at_rest(case.create_frame(roller.indentation, 4))
    rolling.solver.tolerance = 1e-2
    for k in range(steps):
        rolling.advance(layer.height - roller.indentation * min(1.0, (k + 1) / 12))
    travel, area = np.array([(step.travel, step.wave_area) for step in rolling.steps[9::10]]).T
    return np.diff(area) / np.diff(travel)


@pytest.mark.slow
def test_wave_of_a_roller_sliding_with_high_friction_grows_without_slowing_down():
    """With friction 0.10 the growth slows down from 0.38 to 0.12 mm2 per millimetre; with 0.31 it does not."""
    steady, endless = growth_without_jumps(0.10, 80), growth_without_jumps(0.31)
    assert np.all(np.diff(steady) < 0)
    assert steady[-1] < 0.4 * steady[0]
    assert endless.min() > 0.85 * endless[0]
    with pytest.raises((HeapingError, UnsteadyError)):  # a step fails before the mass decides
        roll(*SLIDING, 0.13, increments=4)


@pytest.mark.slow
def test_sliding_roller_on_a_thin_layer_is_steady_up_to_the_strength_of_the_mix():
    """The traction f p on every plane is at most sin 35 degrees times p + pt; a half-plane slides from 0.39 on."""
    height, depth, angle = 0.02, 0.6e-3, np.radians(35)
    mix = replace(
        SLIDING[2], critical_slope=float(np.sqrt(3) * np.sin(angle)), tensile_strength=1e3, fed_density_ratio=0.92,
        heckel_slope=16e-6, unloading_modulus=120e6, poisson=0.3,
    )  # fmt: skip

    def rolled(friction):
        roller = replace(SLIDING[1], radius=(4 * height) ** 2 / (2 * depth), indentation=depth, friction=friction)
        return roll(Layer(height), roller, mix, 0.13, increments=10)

    assert rolled(0.5).error[1] < 0.02
    with pytest.raises((UnsteadyError, HeapingError)):
        rolled(0.7)
