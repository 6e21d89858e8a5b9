"""Slip-line theory of the validation: limits of the chord, integrals over the arc, strength of the mix."""

import numpy as np
import pytest

from compact.validation.ironing import arc_forces, chord_forces
from compact.validation.plastic_limits import MIX, shear_strength


def test_a_vanishing_heap_has_prandtls_pressure():
    heap = np.array([1e-8])
    vertical, horizontal = chord_forces(heap)
    length = 2 * np.sin(np.arccos(1 - heap) / 2)
    assert vertical / length == pytest.approx(2 + np.pi, rel=1e-3)
    assert horizontal / vertical == pytest.approx(np.sqrt(heap / 2), rel=1e-3)


def test_forces_of_the_arc_are_the_integrals_of_its_pressure():
    for heap in (0.01, 0.05, 0.2):
        slope = np.linspace(0, np.arccos(1 - heap), 20001)
        pressure = 2 + np.pi - slope[-1] - 2 * slope
        vertical, horizontal = arc_forces(np.array(heap))
        assert float(vertical) == pytest.approx(np.trapezoid(pressure * np.cos(slope), slope), rel=1e-8)
        assert float(horizontal) == pytest.approx(np.trapezoid(pressure * np.sin(slope), slope), rel=1e-8)


def test_the_arc_has_the_load_of_its_chord_and_a_steeper_force():
    heap = np.linspace(0.01, 0.06, 6)
    chord, arc = chord_forces(heap), arc_forces(heap)
    assert arc[0] == pytest.approx(chord[0], rel=2e-3)
    assert (arc[1] / arc[0] < chord[1] / chord[0]).all()


def test_the_mix_stays_on_its_flat_side_under_the_indenter():
    """(1 + pi) k lies below half of the preconsolidation pressure, so that nothing compacts."""
    assert (1 + np.pi) * shear_strength(MIX) < float(MIX.yield_pressure(MIX.fed_density_ratio)) / 2
    assert MIX.unloading_modulus / shear_strength(MIX) > 1000
