"""Search for the steady state of mix with a shear line: a loose lift, targets, random lifts."""

import numpy as np
import pytest
from mixes import free_roller
from mixes import shear_line as law

from compact.engines.compaction.engine import roll
from compact.material.laws import earth_pressure_bounds, matched_slopes
from compact.material.mix import LOOSE_DENSITY_RATIO, prior
from compact.rolling_contact import HeapingError, Layer, Roller

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
def test_random_lift_heaps_up():
    """Its wave takes up a twentieth of the feed until a step fails."""
    scene, torque = random_lift(18)
    with pytest.raises(HeapingError, match=r"takes up [234567]\.?\d* % of the feed") as raised:
        roll(*scene, 0.13, **torque)
    assert raised.value.heaping.wave_height > 2 * scene[1].indentation


@pytest.mark.slow
def test_random_lift_with_a_high_wave_heaps_up():
    scene, torque = random_lift(26)
    with pytest.raises(HeapingError, match="without slowing down, and takes up") as raised:
        roll(*scene, 0.13, **torque)
    assert raised.value.heaping.wave_height > 5 * scene[1].indentation


@pytest.mark.slow
def test_random_lift_with_a_high_wave_is_steady():
    scene, torque = random_lift(25)
    rolled = roll(*scene, 0.13, **torque)
    assert rolled.bow_wave > 10 * scene[1].indentation
    assert max(rolled.error) < 0.08  # with that by the elements
