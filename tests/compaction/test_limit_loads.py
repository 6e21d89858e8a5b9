"""Limit loads of the finite elements with the associated shear line: strip footing and passive wall in plane strain."""

import numpy as np
import pytest
from limit_loads import COHESION, exact_factors, footing_pressure, wall_pressure
from threadpoolctl import threadpool_limits

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
