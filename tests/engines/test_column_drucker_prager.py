"""Columns of mix with a shear line: return mapping of the same law, Heckel's curve, passes."""

import numpy as np
import pytest
from column_cases import stepped

from compact.engines.column.engine import roll, simulate_oedometer
from compact.material.laws import drucker_prager_cap
from compact.rolling_contact import Layer, Roller

HECKEL_SLOPE = 14e-6


def law(friction_angle=35.0, **other):
    others = {
        "friction_angle": friction_angle,
        "cohesion": 10e3,
        "earth_pressure_coefficient": 1 - np.sin(np.radians(friction_angle)),
        "pressure": 200e3,
        "unloading_modulus": 120e6,
        "poisson": 0.3,
        "heckel_slope": HECKEL_SLOPE,
        "loose_density_ratio": 0.72,
        "fed_density_ratio": 0.9,
    }
    return drucker_prager_cap(**others | other)


@pytest.mark.parametrize("changes", [{}, {"friction_angle": 25.0, "poisson": 0.2}, {"dilatancy_angle": 10.0}], ids=str)
def test_oedometer_is_that_of_the_return_mapping(changes):
    """With a Poisson's ratio of 0.2 mix slides on the line before it reaches the cap."""
    mix = law(**changes)
    test = simulate_oedometer(mix, [60e3, 120e3, 180e3])
    logarithmic = -np.log1p(-test.strain)
    coarse, fine = (stepped(mix, logarithmic, steps) for steps in (400, 800))
    got = 2 * fine - coarse
    assert test.pressure == pytest.approx(got[:, 0], rel=2e-5)
    assert test.lateral_stress == pytest.approx(got[:, 1], rel=2e-5)
    assert test.density_ratio == pytest.approx(got[:, 2], rel=1e-6)


@pytest.mark.parametrize("share", np.linspace(0.999, 1.001, 12))
def test_transition_from_line_to_cap_is_located(share):
    """The rates are discontinuous there; a step that used both sides converged to no stress for 3 of 4 mixes."""
    test = simulate_oedometer(law(25.0, poisson=0.2, heckel_slope=share * HECKEL_SLOPE), [50e3, 100e3, 150e3, 0.0])
    heckel = np.log(0.28 / (1 - test.density_ratio[1:3])) / (share * HECKEL_SLOPE)
    assert test.pressure[1:3] == pytest.approx(heckel, rel=1e-6)


@pytest.mark.parametrize("friction_angle", [28.0, 35.0, 38.0])
def test_oedometer_follows_heckel_and_the_earth_pressure(friction_angle):
    test = simulate_oedometer(law(friction_angle), [100e3, 150e3, 200e3])
    heckel = np.log(0.28 / (1 - test.density_ratio)) / HECKEL_SLOPE
    assert test.pressure == pytest.approx(heckel, rel=1e-7)
    assert test.lateral_stress[2] / 200e3 == pytest.approx(1 - np.sin(np.radians(friction_angle)), abs=0.005)


def test_release_slides_on_the_passive_line():
    """Behind the roller the lateral stress falls along the line; what remains follows from s_v = 0."""
    mix = law(28.0, poisson=0.2, cohesion=1e3)
    M, pt = mix.friction_slope, mix.tensile_strength
    contact = roll(Layer(0.06), Roller(0.11, indentation=0.0035, profile="circle"), mix, 0.1)
    (column,) = contact.exit.layer
    assert column.lateral_stress == pytest.approx(M * pt / (1 - 2 * M / 3), rel=1e-7)
    assert contact.work_residual < 1e-9
    loaded, released = stepped(mix, [-np.log1p(-0.0035 / 0.06), -np.log(contact.exit_height / 0.06)], 4000)
    assert released[0] == pytest.approx(0, abs=2e-4 * loaded[0])
    assert released[1] == pytest.approx(column.lateral_stress, abs=2e-4 * loaded[0])
    assert released[2] == pytest.approx(contact.exit_density_ratio, rel=1e-7)
