"""Rolling over mix with a shear line: carried pressure, steady state, viscosity, the default law unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from mixes import free_roller
from mixes import shear_line as law

from compact.engines.compaction.engine import roll
from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid
from compact.engines.compaction.reciprocating import simulate_reciprocating
from compact.engines.compaction.rolling import FINAL_DAMPING_RATIO
from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
from compact.material import cap_plasticity
from compact.mesh import RowMesh
from compact.motion.profile import law as profile_law
from compact.rolling_contact import Layer, Roller

DEPTH = 0.003
LENGTH = 1.164  # m, of the roller of the table


def marched(mix, increments, travel, height=None):
    """Roller after incremental rolling of the published lift at a residual of 1e-3."""
    height = 0.06 * 0.98 / mix.fed_density_ratio if height is None else height
    roller = free_roller(DEPTH)
    case = RollingCase(Layer(height), roller, mix, 0.133, None, None, RollingNumerics())
    rolling = case.roller_at_rest(case.create_frame(DEPTH, increments))
    rolling.solver.tolerance = 1e-3
    for share in np.linspace(0, 1, 2 * increments + 1)[1:]:
        rolling.advance(height - share * DEPTH)
    while rolling.steps[-1].travel < travel:
        rolling.advance(height - DEPTH, FINAL_DAMPING_RATIO * 0.02)
    return rolling


@pytest.fixture(scope="module")
def loose():
    """Mix fed at 0.90 after 0.8 m."""
    return marched(law(), 4, 0.8)


@pytest.mark.slow
def test_carried_pressure_is_that_of_the_mix_in_steady_motion(loose):
    """The two-surface law is then satisfied: no point exceeds q = M P."""
    points, mix = loose.state.points, loose.frame.solid.material
    p = -points.stress[:, :3].mean(axis=1)
    deviator = points.stress + p[:, None] * [1, 1, 1, 0]
    q = np.sqrt(1.5 * (deviator**2) @ [1, 1, 1, 2])
    near = np.abs(loose.frame.solid.point_coordinates[:, 0]) < loose.frame.contact_length
    assert np.abs(loose.parts[-1].carried_pressure - p)[near].max() < 100.0  # Pa; the peak pressure is 250 kPa
    excess = (q - mix.friction_slope * (p + mix.tensile_strength))[near]
    assert excess.max() < 100.0
    assert (excess > -100.0).sum() > 30  # mix slides on the line


@pytest.mark.slow
def test_coefficient_of_loose_mix_is_that_of_the_table(loose):
    """Fed at 0.90 the K0 cap and the line have 0.140 on 6 elements; 4 have 0.003 less."""
    step = loose.steps[-1]
    assert step.resistance / step.load == pytest.approx(0.137, abs=0.004)
    assert step.bow_wave < 0.3e-3
    assert abs(step.load / loose.steps[-30].load - 1) < 2e-3


@pytest.mark.slow
def test_steady_state_by_search_is_that_of_marching():
    mix = law()
    found = roll(Layer(0.06 * 0.98 / 0.9), free_roller(DEPTH), mix, 0.133, increments=6)
    step = marched(mix, 6, 0.8).steps[-1]
    assert found.load == pytest.approx(step.load, rel=0.02)
    assert found.resistance == pytest.approx(step.resistance, rel=found.error[1])
    assert found.error[1] < 0.025
    assert found.load * LENGTH == pytest.approx(4483, rel=0.01)
    assert found.resistance * LENGTH == pytest.approx(644, rel=0.01)


def test_direct_and_carried_line_agree_in_a_confined_test():
    """Plane compression of one element: with its own pressure carried the forces are those of the two-surface law."""
    mix = law()
    mesh = RowMesh(np.tile([0.0, 1.0], (2, 1)), np.array([0.0, 1.0]))
    solid = FiniteStrainSolid(mesh, mix, finite=False)
    state = solid.undeformed_state()
    points = cap_plasticity.MaterialPoint(
        np.tile([-40e3, -20e3, -25e3, 0.0], (4, 1)), *(np.full(4, value) for value in (0.9, 0.95, 0.0))
    )
    state = replace(state, points=points)
    x, y = solid.basis.doflocs
    moved = np.column_stack([-4e-4 * x, 2e-4 * y])
    direct = solid.increment(state, moved)
    carried = replace(state, carried_pressure=-direct.after.points.stress[:, :3].mean(axis=1))
    forces = solid.increment(carried, moved).internal_forces
    assert forces == pytest.approx(direct.internal_forces, abs=2e-3 * np.abs(direct.internal_forces).max())


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"cohesion": 20e3}], ids=str)
def test_reciprocating_strokes_balance_their_work(changes):
    """Both surfaces are satisfied in every step; a step without equilibrium iterates the carried pressure."""
    mix = law(**changes)
    cycle = profile_law("quintic", 0.12, 3.0).cycle()
    roller = Roller(0.11, indentation=DEPTH, profile="deformed")
    found = simulate_reciprocating(Layer(0.06 * 0.98 / 0.9), roller, mix, cycle, increments=4, estimate=False)
    assert found.input_work[-1] == pytest.approx(found.stored_work[-1], rel=0.02)
    assert found.resistance.max() > 400.0
    returning = found.position[-1] < 0.2 * found.position.max()
    assert returning
