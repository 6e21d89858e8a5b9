"""Carts on one crankshaft: closed form of the slider-crank, virtual power, published powers, cancellation, errors."""

import numpy as np
import pytest
from machine_cases import friction
from published import CART_OF_C

from compact.drive import Crank
from compact.machine.crankshaft import simulate_crankshaft

CRANK = Crank(radius=0.2, rod_length=0.8)

CART = CART_OF_C


@pytest.mark.parametrize("ahead", [0.0, 1e-15, -1e-15, 1e-9, 2 * np.pi, -np.pi, 7.0, 1e3], ids=str)
def test_mean_power_does_not_depend_on_the_initial_angle(ahead):
    shaft = simulate_crankshaft(CART, CRANK, 10.5, friction(3562.0), (ahead,))
    assert shaft.weights.sum() == pytest.approx(2 * np.pi, rel=1e-13)
    assert shaft.mean(shaft.power) == pytest.approx(mean_power_of_one_cart(CART, 3562.0), rel=1e-11)


def mean_power_of_one_cart(cart, resistance):
    shaft = simulate_crankshaft(cart, CRANK, 10.5, friction(resistance))
    return shaft.mean(shaft.power)
