"""Entry point of the finite-element engines: selection by the material."""

import pytest

from compact import fem
from compact.material.laws import Compaction
from compact.mesh import graded_mesh
from compact.rolling_contact import Layer, Roller


def test_mesh_of_a_compacting_layer_raises_an_error():
    mix = Compaction(
        unloading_modulus=120e6,
        poisson=0.3,
        heckel_slope=13e-6,
        loose_density_ratio=0.72,
        critical_slope=1.2,
        tensile_strength=10e3,
        fed_density_ratio=0.94,
    )
    with pytest.raises(
        ValueError, match=r"`mesh` must be None for a compacting layer, .* got one of \(\d+, \d+\) elem"
    ):
        fem.roll(Layer(0.22), Roller(0.11, indentation=0.003), mix, 0.2, mesh=graded_mesh(0.22, 0.02, 4))
