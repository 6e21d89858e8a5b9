"""Pore air under a roller and on confined columns: limits, balances, hard cases, and the coupled coarse."""

from dataclasses import replace

import numpy as np
import pytest
from column_cases import mix

from compact.engines.column import engine as column
from compact.engines.compaction.engine import roll
from compact.engines.pore_air.coupled_rolling import COUPLED_TOLERANCE, roll_coupled
from compact.engines.pore_air.steady_flow import ColumnAir, RollerAir
from compact.material.pore_air import PoreAir, water_volume
from compact.rolling_contact import Layer, LowerLift, Roller

WATER = water_volume(0.10)


@pytest.fixture(scope="session")
def wide():
    """Contact eight heights long over a thin layer, where columns do not move sideways, on 12 increments."""
    material = mix(unloading_modulus=20e6, fed_density_ratio=0.94, dry_side="flat")
    roller = Roller((8 * 0.05) ** 2 / (2 * 0.0015), indentation=0.0015, profile="deformed")
    return roll(Layer(0.05), roller, material, 0.2, increments=12)


def pore_air(permeability, occlusion=None, fed=0.94):
    return PoreAir(permeability=permeability, water=WATER, fed_density_ratio=fed, occlusion_saturation=occlusion)


def test_without_drainage_boyles_law_holds_at_every_point(coarse):
    under = RollerAir(coarse.solution, pore_air(1e-25))
    excess = under.at_points(under.pressure(1.0))
    volume = under.flow.air_volume[1:-1, 1:-1]
    initial = under.flow.air_volume[-1, 1:-1]
    boyle = under.air.ambient_pressure * (initial / volume - 1)
    np.testing.assert_allclose(excess, coarse.solution.frame.to_points(boyle.T), atol=1e-6 * 101325)
    assert excess.max() > 101325


@pytest.mark.parametrize("occlusion", [None, 0.90])
def test_with_full_drainage_there_is_no_air(coarse, occlusion):
    under = RollerAir(coarse.solution, pore_air(1e-3, occlusion))
    found = under.pressure(1e-3)
    load, resistance, _ = under.forces(found)
    assert np.abs(found.excess[:, -1]).max() < 1e-6 * 101325
    assert np.abs(found.excess).max() < 1e-6 * 101325
    assert abs(load) < 1e-6 * coarse.load
    assert abs(resistance) < 1e-6 * coarse.resistance
    if occlusion is None:  # occluded air keeps a share of the permeability
        assert abs(load) < 1e-9 * coarse.load
        assert abs(resistance) < 1e-9 * coarse.resistance


@pytest.mark.parametrize("occlusion", [None, 0.95, 0.90, 0.85, 0.76])
def test_hard_cases_converge_with_their_mass(coarse, occlusion):
    """Permeability over eight decades, speeds from 1e-4 to 10 m/s, saturation through occlusion."""
    air = 0.10  # moisture, whose fed saturation is 0.767
    fed = 0.94 if occlusion != 0.76 else 0.935
    for permeability in (1e-17, 1e-13, 1e-9):
        under = RollerAir(
            coarse.solution,
            PoreAir(
                permeability=permeability,
                water=water_volume(air),
                fed_density_ratio=fed,
                occlusion_saturation=occlusion,
            ),
        )
        for speed in (1e-4, 1e-2, 10.0):
            found = under.pressure(speed)
            assert abs(found.mass_residual) < 1e-6
            assert found.pressure.min() > 0.3 * 101325
            assert found.pressure.max() < 8 * 101325
            assert found.iterations < 15


def test_coupled_contact_without_air_is_the_contact(coarse):
    coupled = roll_coupled(coarse, pore_air(1e-6), 0.01)
    assert abs(coupled.changes.load) < 4e-3 * coarse.load
    assert abs(coupled.changes.resistance) < 4e-3 * coarse.resistance
    under = RollerAir(coupled.rolling, pore_air(1e-6))
    assert abs(under.forces(coupled.pressure).load) < 1e-5 * coarse.load


def work_residual(rolling, excess=0.0):
    """Work of the roller less that of skeleton and air, over the former."""
    frame, after = rolling.frame, rolling.state.displacement
    skeleton = frame.row_heights @ frame.to_rows(rolling.state.work)[:, frame.exit_column]
    ratios = []
    for displacement in (after, frame.convect_displacement(after)):
        xx, xy, yx, yy = (frame.solid.displacement_gradient(displacement) + np.array([1.0, 0, 0, 1.0])).T
        ratios.append(xx * yy - xy * yx)
    air = -np.sum(excess * (ratios[0] - ratios[1]) * frame.solid.point_areas) / frame.step
    resistance = rolling.steps[-1].resistance
    return 1 - (skeleton + air) / resistance, air / resistance


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["deformed", "circle", "parabola"])
def test_air_below_a_lower_lift_and_every_profile_in_either_direction(coarse, profile):
    """Boyle's law in the rows of both lifts, and forces of either direction alike."""
    roller = replace(coarse.roller, profile=profile)
    layer = Layer(0.06, lower_lift=LowerLift(thickness=0.05, density_ratio=0.97))
    forces = []
    for speed in (0.2, -0.2) if profile == "circle" else (0.2,):
        found = roll(layer, roller, coarse.material, speed, increments=4)
        under = RollerAir(found.solution, pore_air(1e-13))
        forces.append(under.forces(under.pressure(speed)))
        undrained = RollerAir(found.solution, pore_air(1e-25))
        pressure = undrained.pressure(speed)
        boyle = pressure.flow.air_volume[-1] / pressure.flow.air_volume * 101325
        np.testing.assert_allclose(pressure.pressure[:, :-1], boyle[:, :-1], rtol=1e-6)
    assert pressure.flow.air_volume[-1].min() < 0.04 < 0.05 < pressure.flow.air_volume[-1].max()
    np.testing.assert_allclose(forces[0], forces[-1], rtol=1e-9)
    assert forces[0][0] > 0.01 * found.load


@pytest.mark.slow
def test_work_of_the_coupled_contact_is_that_of_skeleton_and_air(coarse):
    fine = roll(coarse.layer, coarse.roller, coarse.material, 0.2, increments=8)
    coupled = roll_coupled(fine, pore_air(1e-13), 0.2)
    residual, share = work_residual(coupled.rolling, coupled.rolling.excess)
    assert share > 0.02
    assert abs(residual) < 0.02


@pytest.mark.slow
def test_one_way_and_coupled_agree_over_a_wide_thin_layer(wide):
    """Columns do not move sideways, and without a bow wave the skeleton hardly changes."""
    air = pore_air(1e-12)
    under = RollerAir(wide.solution, air)
    load, resistance, _ = under.forces(under.pressure(0.2))
    coupled = roll_coupled(wide, air, 0.2)
    assert load > 0.03 * wide.load
    assert coupled.changes.load == pytest.approx(load, rel=0.1)
    assert coupled.changes.resistance == pytest.approx(resistance, abs=COUPLED_TOLERANCE * wide.resistance)


# ---- Pore air on confined columns: limits, elements, and finite elements over a wide thin layer


MIX = mix(unloading_modulus=20e6, fed_density_ratio=0.94, dry_side="flat")
LAYER = Layer(0.05)
ROLLER = Roller((8 * 0.05) ** 2 / 0.003, indentation=0.0015, profile="circle")


def columns(permeability, occlusion=None, roller=ROLLER):
    found = column.roll(LAYER, roller, MIX, 0.2)
    air = PoreAir(
        permeability=permeability, water=water_volume(0.10), fed_density_ratio=0.94, occlusion_saturation=occlusion
    )
    under = ColumnAir(air, LAYER, roller, found)
    return under, found


def test_without_drainage_load_and_resistance_are_those_of_boyles_law():
    under, _ = columns(1e-22)
    load, resistance, _ = under.forces(under.pressure(0.2))
    x, heights = under.surface[:, under.on_roller]
    initial = 1 / 0.94 - 1
    excess = under.air.ambient_pressure * (initial / (heights / LAYER.height / 0.94 - 1) - 1)
    assert load == pytest.approx(np.trapezoid(excess, x), rel=2e-4)
    assert resistance == pytest.approx(np.trapezoid(excess, heights), rel=2e-3)


def test_with_full_drainage_there_is_no_air_under_columns():
    under, found = columns(1e-2)
    load, resistance, _ = under.forces(under.pressure(1e-3))
    assert abs(load) < 1e-9 * found.load
    assert abs(resistance) < 1e-9 * found.resistance


@pytest.mark.slow
def test_columns_and_finite_elements_agree_over_a_wide_thin_layer(wide):
    for permeability, tolerance in ((1e-12, 0.2), (1e-13, 0.15), (1e-15, 0.04)):
        under, _ = columns(permeability)
        by_elements = RollerAir(wide.solution, under.air)
        load, *_ = under.forces(under.pressure(0.2))
        assert by_elements.forces(by_elements.pressure(0.2))[0] == pytest.approx(load, rel=tolerance)


@pytest.mark.parametrize("occlusion", [None, 0.90])
def test_without_drainage_boyles_law_holds_at_the_surface_under_the_roller(coarse, occlusion):
    """The air under the roller is that of the last drained node ahead; outside the contact the surface has none."""
    under = RollerAir(coarse.solution, pore_air(1e-25, occlusion))
    found, volume = under.pressure(1.0), under.flow.air_volume[:, -1]
    (touched,) = np.nonzero(~under.flow.drained[:, -1])
    boyle = under.air.ambient_pressure * volume[touched[-1] + 1] / volume[touched]
    np.testing.assert_allclose(found.pressure[touched, -1], boyle, rtol=1e-6)
    assert not found.excess[under.flow.drained].any()
    assert boyle.max() > 2 * 101325
