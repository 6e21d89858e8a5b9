"""Points of compacting mix: random states, paths and the yield limit from its definition, for the tests of the laws."""

import numpy as np

from compact.material import cap_plasticity
from compact.material.laws import DruckerPragerCap

SHEAR_TWICE = np.array([1.0, 1.0, 1.0, 2.0])  # weights of (xx, yy, zz, xy) in a product of tensors
ONE = np.array([1.0, 1.0, 1.0, 0.0])


def walked(mix, steps, state=None, **options):
    """State of one point after strain increments (xx, yy, 2 xy), compression positive."""
    state = cap_plasticity.initial_state(mix, 1) if state is None else state
    for strain in -np.atleast_2d(np.asarray(steps, dtype=float)):
        state, _ = cap_plasticity.integrate_points(mix, state, strain[None], tangent=False, **options)
    return state


def split(tensor):
    """Mean and deviator of (xx, yy, zz, xy) along the last axis."""
    mean = tensor[..., :3].mean(axis=-1)
    return mean, tensor - mean[..., None] * ONE


def von_mises(stress):
    s = split(stress)[1]
    return np.sqrt(1.5 * (s * s) @ SHEAR_TWICE)


def yielding(mix, stress, hardened, factor=1.0):
    """f, df/dp and df/dq from the definition; p and q compression positive. f is over a (a + u), as its rounding is."""
    M, pt, pc = mix.critical_slope, mix.tensile_strength, mix.yield_pressure(hardened) * factor
    p, q, a, u = -split(stress)[0], von_mises(stress), (pc + pt) / 2, mix.saturation_pressure(hardened)
    c, size = a - pt + u, a * (a + u)
    wet = np.maximum(p - c, 0)
    if isinstance(mix, DruckerPragerCap):
        surfaces = (q**2 / M**2 + wet**2 - a**2) / size, (q - mix.friction_slope * (p + pt)) / (a + u), -(p + pt) / a
        return np.max(surfaces, axis=0), np.nan, np.nan
    if mix.dry_side == "ellipse":
        return (q**2 / M**2 + (p - c) ** 2 - a**2) / size, 2 * (p - c), 2 * q / M**2
    p0, rounding = np.minimum(c, 0), 0.0 if pt > 1 else 1e-12 * a  # p comes from stresses of the size of a
    inward = a / (p0 + pt + rounding)
    dry = inward * np.minimum(p - p0 + rounding, 0)
    return (q**2 / M**2 + wet**2 + dry**2 - a**2) / size, 2 * (wet + dry * inward), 2 * q / M**2


def dissipated(mix, before, after):
    """Plastic work less the energy (K_s/2) ln^2(k/k_s) that saturated mix on the full ellipse stores or gives back."""
    work = after.plastic_work - before.plastic_work
    if mix.dry_side == "flat":
        return work
    excess = (np.log(np.maximum(state.density_ratio / mix.saturation_limit, 1)) for state in (before, after))
    begin, end = (mix.saturation_modulus / 2 * value**2 for value in excess)
    return work - end + begin


def plastic_strain(mix, before, after, strain):
    """Plastic part of strain increments (xx, yy, 2 xy) by Hooke's law, as a tensor (xx, yy, zz, xy), shape (n, 4)."""
    total = np.column_stack((strain[:, 0], strain[:, 1], np.zeros(len(strain)), strain[:, 2] / 2))
    mean, s = split(after.stress - before.stress)
    return total - mean[:, None] / (3 * mix.bulk_modulus) * ONE - s / (2 * mix.shear_modulus)


def scattered(n, largest, seed=0):
    """Random strain increments up to `largest`."""
    random = np.random.default_rng(seed)
    strain = random.normal(size=(n, 3))
    return strain * (largest * random.random(n) / np.linalg.norm(strain, axis=1))[:, None]


def admissible(mix, n, steps=3, largest=0.03, seed=1):
    """Random admissible states, on the yield surface and inside."""
    state = cap_plasticity.initial_state(mix, n)
    for i in range(steps):
        state, _ = cap_plasticity.integrate_points(mix, state, scattered(n, largest, seed + i), tangent=False)
    return cap_plasticity.integrate_points(mix, state, scattered(n, 1e-4, seed + steps), tangent=False)[0]
