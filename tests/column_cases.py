"""Mixes, rollers and random scenes for tests of the engine "column"."""

from dataclasses import replace

import numpy as np
from mixes import STIFF as MIX

from compact.engines.column.engine import roll
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.material.mix import prior
from compact.rolling_contact import Layer, Roller

R, HEIGHT, FED = 0.11, 0.22, 0.94
FED_HEIGHT = 0.98 * HEIGHT / FED
DEPTH = FED_HEIGHT - HEIGHT
SPEED = 0.2


def mix(**changes):
    """The mix of the reference solutions with changes."""
    return replace(MIX, **changes)


def circle(depth=DEPTH, **other):
    """A circular roller with an indentation."""
    return Roller(R, indentation=depth, profile="circle", **other)


def rolled(material=MIX, height=FED_HEIGHT, roller=None, **options):
    """One pass over a fresh layer."""
    return roll(Layer(height), roller or circle(), material, SPEED, **options)


def stepped(material, strains, steps):
    """(s_v, s_h, k, largest k) of confined compression at each strain, by equal implicit steps of `cap_plasticity`."""
    state, before, rows = cap_plasticity.initial_state(material, 1), 0.0, []
    for strain in strains:
        increment = np.array([[0.0, (before - strain) / steps, 0.0]])
        for _ in range(steps):
            state, _ = cap_plasticity.integrate_points(material, state, increment, tangent=False)
        rows.append([*-state.stress[0, [1, 0]], state.density_ratio[0], state.max_density_ratio[0]])
        before = strain
    return np.array(rows)


def mix_of(moisture, density_ratio, fed, dry_side="flat"):
    """`Compaction` of the prior of a mix."""
    known = prior(moisture, density_ratio, {"rate_sensitivity": 0.0})
    angle = np.radians(known.friction_angle)
    slope = np.sqrt(3) * np.sin(angle)
    return Compaction(
        unloading_modulus=known.unloading_modulus,
        poisson=known.poisson,
        heckel_slope=known.heckel_slope * (1 + np.sqrt(1 + 4 * slope**2 / 9)) / 2,
        loose_density_ratio=0.72,
        critical_slope=slope,
        tensile_strength=known.cohesion / np.tan(angle),
        fed_density_ratio=fed,
        dry_side=dry_side,
    )


def scene(moisture, density_ratio, radius, reduction, dry_side="flat"):
    """Layer, roller and mix for a product of 0.22 m with about the density ratio."""
    material = mix_of(moisture, density_ratio, density_ratio / (1 + reduction), dry_side)
    return Layer(HEIGHT * (1 + reduction)), Roller(radius, indentation=HEIGHT * reduction, profile="circle"), material


def random_scenes(count, seed):
    """Yield layers, free rollers with friction and mixes of products between 8 and 12 % moisture."""
    rng = np.random.default_rng(seed)
    draws = (rng.uniform(*bounds, count) for bounds in ((0.08, 0.12), (0.92, 0.985), (0.08, 0.2), (0.01, 0.06)))
    for *numbers, friction in zip(*draws, rng.uniform(0, 0.45, count), strict=True):
        layer, roller, material = scene(*numbers)
        yield layer, replace(roller, friction=friction, rolling="free"), material
