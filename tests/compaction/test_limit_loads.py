"""Limit loads of the finite elements with the associated shear line: strip footing and passive wall in plane strain.

Weightless mix with the associated Drucker-Prager line of a friction angle, and a cap that no stress reaches.
"""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid, SolidState
from compact.material.laws import DruckerPragerCap, matched_slopes
from compact.mesh import RowMesh
from compact.validation.compaction import solve_increment

COHESION, MODULUS = 10e3, 100e6  # [Pa]
DENSE = 0.985  # [-], density ratio that determines the cap


def mix(friction_angle, dilatancy_angle=None, cohesion=COHESION):
    """The line of a friction angle; associated by default."""
    dilatancy_angle = friction_angle if dilatancy_angle is None else dilatancy_angle
    M, N = matched_slopes(friction_angle, dilatancy_angle)
    return DruckerPragerCap(
        unloading_modulus=MODULUS,
        poisson=0.3,
        heckel_slope=1e-9,
        loose_density_ratio=0.72,
        critical_slope=2.0,
        tensile_strength=float(cohesion / np.tan(np.radians(friction_angle))),
        fed_density_ratio=0.9,
        friction_slope=M,
        dilatancy_slope=N,
    )


def graded(start, end, first, growth):
    """Coordinates from `start` to `end` with growing intervals."""
    sizes = [first]
    while sum(sizes) < abs(end - start):
        sizes.append(sizes[-1] * growth)
    return start + np.sign(end - start) * np.cumsum(sizes) * abs(end - start) / sum(sizes)


def footing_pressure(
    friction_angle, elements, steps=24, settlement=0.06, surcharge=0.0, cohesion=COHESION, report=None
):
    """Mean pressures under a smooth rigid strip of width 1 over its settlements, by elements over half of its width."""
    material = mix(friction_angle, cohesion=cohesion)
    size = 0.5 / elements
    reach = 2.0 + np.tan(np.radians(45 + friction_angle / 2)) * np.exp(np.pi / 2 * np.tan(np.radians(friction_angle)))
    inner = np.linspace(0, 0.75, round(0.75 / size) + 1)
    x = np.concatenate([inner, graded(0.75, 0.75 + reach, size, 1.15)])
    y = -graded(0, 0.75 + 0.6 * reach, size, 1.15)[::-1]
    y = np.concatenate([y, [0.0]]) - y[0]
    return _pressures(material, x, y, steps, settlement, surcharge, report)


def wall_pressure(friction_angle, elements, *, steps=24, travel=0.03, surcharge=0.0, cohesion=COHESION, report=None):
    """Mean pressures on a smooth wall of height 1 pushed into a layer under a surcharge on a rough base."""
    size = 1.0 / elements
    length = 1.5 * np.tan(np.radians(45 + friction_angle / 2))
    x = np.concatenate([np.arange(0, length, size), graded(length, length + 2.0, size, 1.15)])
    y = np.concatenate([[0.0], graded(0, 1, size / 16, 1.3)])  # thin elements at the base, on which the wedge slides
    return _pressures(mix(friction_angle, cohesion=cohesion), x, y, steps, travel, surcharge, report, wall=True)


def _pressures(material, x, y, steps, travel, surcharge, report, wall=False):
    """Mean pressures on a rigid strip at the top left, or on the wall at the left, over its travel."""
    mesh = RowMesh(np.tile(x, (len(y), 1)), y)
    nodes = FiniteStrainSolid(mesh, material).basis.doflocs.T
    near = 1e-9
    bottom, left, right = nodes[:, 1] < near, nodes[:, 0] < near, nodes[:, 0] > x[-1] - near
    strip = left if wall else (nodes[:, 1] > y[-1] - near) & (nodes[:, 0] < 0.5 + near)
    moving = 2 * np.flatnonzero(strip) + (0 if wall else 1)
    still = [2 * np.flatnonzero(left | right | bottom), 2 * np.flatnonzero(bottom) + 1]
    solid = FiniteStrainSolid(mesh, material, fixed_dofs=np.concatenate([*still, moving]), finite=False, substeps=1)
    state = solid.undeformed_state()
    stress = -surcharge * np.tile([1.0, 1, 1, 0], (len(state.work), 1))
    points = replace(state.points, stress=stress, max_density_ratio=np.full(len(state.work), DENSE))
    state = SolidState(state.displacement, points, state.work)
    applied = solid.increment(state, state.displacement).internal_forces  # of the surcharge, everywhere
    change, found, sign = np.zeros_like(state.displacement), [], 1.0 if wall else -1.0
    for step in travel * np.diff(np.linspace(0, 1, steps + 1) ** 2):
        moved, before = state.displacement + change, state.displacement
        moved.ravel()[moving] = before.ravel()[moving] + sign * step
        state, forces = solve_increment(solid, state, moved, applied)
        change = (state.displacement - before) * 1.05
        found.append(sign * forces.ravel()[moving].sum() / (1.0 if wall else 0.5))
        if report:
            report(f"{abs(state.displacement.ravel()[moving[0]]):.4f} {found[-1] / 1e3:.2f}")
    return np.array(found)


def exact_factors(friction_angle):
    """N_c and N_q of Prandtl and Reissner."""
    angle = np.radians(friction_angle)
    N_q = np.exp(np.pi * np.tan(angle)) * np.tan(np.pi / 4 + angle / 2) ** 2
    return (N_q - 1) / np.tan(angle), N_q


# ---- Limit loads of the finite elements with the associated shear line: strip footing and passive wall in plane strain


pytestmark = pytest.mark.slow
CASES = [(20.0, 6, 0.02), (30.0, 8, 0.05), (35.0, 8, 0.08)]  # friction angle, elements over half the strip, settlement


def is_limit(pressure):
    """Return whether the last tenth of a path is a plateau."""
    return pressure[-1] == pytest.approx(pressure[-len(pressure) // 10], rel=1e-3)


@pytest.mark.parametrize(("friction_angle", "elements", "settlement"), CASES)
def test_bearing_capacity_of_cohesion_is_prandtls(friction_angle, elements, settlement):
    """N_c with 2.6, 1.9 and 1.8 %; twice as many elements halve the error (1.4 % at 20 degrees)."""
    with threadpool_limits(1):
        pressure = footing_pressure(friction_angle, elements, steps=50, settlement=settlement)
    assert is_limit(pressure)
    assert pressure[-1] / COHESION == pytest.approx(exact_factors(friction_angle)[0], rel=0.03)


@pytest.mark.parametrize(("friction_angle", "elements", "settlement"), CASES)
def test_bearing_capacity_of_a_surcharge_is_reissners(friction_angle, elements, settlement):
    surcharge, cohesion = 10e3, 100.0
    with threadpool_limits(1):
        pressure = footing_pressure(
            friction_angle, elements, steps=40, settlement=settlement / 2, surcharge=surcharge, cohesion=cohesion
        )
    N_c, N_q = exact_factors(friction_angle)
    assert is_limit(pressure)
    assert (pressure[-1] - cohesion * N_c) / surcharge == pytest.approx(N_q, rel=0.03)


@pytest.mark.parametrize("friction_angle", [20.0, 30.0, 35.0])
def test_passive_pressure_is_rankines(friction_angle):
    """s_h = K_p q + 2 c sqrt(K_p) on a smooth wall, with the wedge of Rankine above a rough base."""
    surcharge, cohesion = 10e3, 5e3
    with threadpool_limits(1):
        pressure = wall_pressure(friction_angle, 12, travel=0.02, surcharge=surcharge, cohesion=cohesion)
    K = np.tan(np.pi / 4 + np.radians(friction_angle) / 2) ** 2
    assert is_limit(pressure)
    assert pressure[-1] == pytest.approx(K * surcharge + 2 * cohesion * np.sqrt(K), rel=0.02)
