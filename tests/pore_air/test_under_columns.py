"""Pore air on confined columns: limits, elements, and finite elements over a wide thin layer."""

import numpy as np
import pytest
from column_cases import mix

from compact.engines.column import engine as column
from compact.engines.pore_air.steady_flow import ColumnAir, RollerAir
from compact.material.pore_air import PoreAir, water_volume
from compact.rolling_contact import Layer, Roller

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


def test_with_full_drainage_there_is_no_air():
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
