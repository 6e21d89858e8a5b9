"""Compacting mixes, their confined compression and the published lift, shared by the tests of material and engines."""

from dataclasses import replace

import numpy as np

from compact.material import cap_plasticity
from compact.material.laws import Compaction, drucker_prager_cap
from compact.rolling_contact import Layer, Roller

MIX = Compaction(
    unloading_modulus=60e6,
    poisson=0.3,
    heckel_slope=13e-6,
    loose_density_ratio=0.72,
    critical_slope=1.2,
    tensile_strength=14e3,
    fed_density_ratio=0.94,
)
STIFF = replace(MIX, unloading_modulus=120e6, dry_side="ellipse")
THIN = replace(MIX, unloading_modulus=20e6, dry_side="ellipse")  # of layers that are thin compared with the contact

SLOPE = float(np.sqrt(3) * np.sin(np.radians(35)))


def calibrated(heckel_slope, fed):
    """Mix of a published scene, fitted by the slope of confined compression."""
    return replace(
        MIX,
        unloading_modulus=120e6,
        heckel_slope=heckel_slope * (1 + np.sqrt(1 + 4 * SLOPE**2 / 9)) / 2,
        critical_slope=SLOPE,
        tensile_strength=10e3 / np.tan(np.radians(35)),
        fed_density_ratio=fed,
    )


def free_roller(depth=0.003, **changes):
    """Roller of the published machine."""
    options = {"friction": 0.35, "rolling": "free", "profile": "deformed"} | changes
    return Roller(0.11, indentation=depth, **options)


LIFT_MIX = calibrated(14.96e-6, 0.93576)
LIFT = Layer(0.06 * 0.98 / 0.93576)


def shear_line(fed=0.9, friction_angle=35.0, coefficient=None, **other):
    """Law with the shear line of a friction angle, and Jaky's coefficient at 200 kPa."""
    others = {
        "friction_angle": friction_angle,
        "cohesion": 10e3,
        "earth_pressure_coefficient": 1 - np.sin(np.radians(friction_angle)) if coefficient is None else coefficient,
        "pressure": 200e3,
        "unloading_modulus": 120e6,
        "poisson": 0.3,
        "heckel_slope": 14.96e-6,
        "loose_density_ratio": 0.72,
        "fed_density_ratio": fed,
    }
    return drucker_prager_cap(**others | other)


def oedometer(mix, stress, increment=1e-4 / 3):
    """Vertical stress, K0 and density ratio of confined compression that passes a stress."""
    state, rows = cap_plasticity.initial_state(mix, 1), []
    while not rows or rows[-1][0] < stress:
        state, _ = cap_plasticity.integrate_points(mix, state, np.array([[0, -increment, 0]]), tangent=False)
        rows.append((-state.stress[0, 1], state.stress[0, 0] / state.stress[0, 1], state.density_ratio[0]))
    return np.array(rows)
