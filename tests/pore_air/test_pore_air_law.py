"""Pore air of a mix: saturation, permeability with occlusion, bounded voids, refusals."""

import numpy as np
import pytest

from compact.material.mix import saturation
from compact.material.pore_air import PoreAir, water_volume

FED = 0.936


def pore_air(occlusion=0.90, permeability=1e-13, moisture=0.10, fed=FED):
    return PoreAir(
        permeability=permeability, water=water_volume(moisture), fed_density_ratio=fed, occlusion_saturation=occlusion
    )


@pytest.mark.parametrize("moisture", [0.08, 0.10, 0.12])
def test_saturation_is_that_of_the_mix(moisture):
    k = np.linspace(0.90, 0.99, 7)
    np.testing.assert_allclose(pore_air(None, moisture=moisture).saturation(1 / k - 1), saturation(moisture, k))


def test_permeability_is_that_given_at_the_fed_density_and_vanishes_at_occlusion():
    air = pore_air()
    assert air.permeability_at(1 / FED - 1) == pytest.approx(1e-13, rel=1e-12)
    occluded = air.water * (1 / 0.90 - 1)
    assert air.permeability_at([occluded, 0.01, 0.0]).max() < 1e-21
    voids = np.linspace(occluded, 0.1, 50)
    assert np.all(np.diff(air.permeability_at(voids)) > 0)


@pytest.mark.parametrize("occlusion", [None, 0.85, 0.90])
def test_voids_are_bounded_with_a_continuous_slope(occlusion):
    air = pore_air(occlusion)
    voids = np.linspace(-0.05, 0.08, 26001)
    bounded, least = air.bounded(voids), air.min_void_ratio
    assert bounded.min() == least
    np.testing.assert_array_equal(bounded[voids > 1.2501 * least], voids[voids > 1.2501 * least])
    slopes = np.diff(bounded) / np.diff(voids)
    assert np.abs(np.diff(slopes)).max() < 2e-3
    assert slopes.min() >= -1e-9


@pytest.mark.parametrize(("changes", "message"), [
    ({"permeability": 0.0}, "`permeability`"),
    ({"occlusion": 1.2}, "`occlusion_saturation`"),
    ({"occlusion": 0.75}, "exceed the saturation of the fed mix"),
    ({"fed": 0.985}, "exceed the saturation of the fed mix"),
])  # fmt: skip
def test_values_out_of_range_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        pore_air(**changes)
