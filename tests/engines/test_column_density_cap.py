"""Columns of mix with tables over the density: the die, passes, lower lifts, and the cap with constant slopes."""

from pathlib import Path

import numpy as np
import pytest

from compact.engines.column import engine as column
from compact.material.density_cap import density_dependent_cap
from compact.material.earth_pressure import drucker_prager_cap
from compact.rolling_contact import Layer, LowerLift, Roller
from compact.scene.cap_tables import read_cap_tables
from compact.validation.powder import ph102

pytestmark = pytest.mark.slow  # kernels of their own, compiled for some ten seconds
SCENES = Path(__file__).parents[2] / "studies" / "scenes"
LAW = density_dependent_cap(ph102(), 0.4)


def rolled(law, indentation, height=0.02, **layer):
    return column.roll(Layer(height, **layer), Roller(0.11, indentation=indentation, profile="circle"), law, 0.1)


def test_oedometer_is_the_die_of_the_tables():
    """The die has backward Euler steps of first order; two numbers of steps extrapolate."""
    place = np.array([0.45, 0.55, 0.65, 0.75, 0.85])
    paths = [ph102().die(0.4, 0.9, steps) for steps in (1000, 2000)]
    axial, radial = (
        2 * paths[1].at(place, name) - paths[0].at(place, name) for name in ("axial_stress", "radial_stress")
    )
    test = column.simulate_oedometer(LAW, axial)
    assert test.density_ratio == pytest.approx(place, rel=2e-5)
    assert test.lateral_stress == pytest.approx(radial, rel=1e-3)


def test_pass_and_second_pass_close_their_balances():
    first = rolled(LAW, 0.006)
    assert first.exit_density_ratio == pytest.approx(0.5476, abs=1e-4)
    assert (first.work_residual, abs(first.mass_residual)) < (1e-12, 1e-7)
    assert max(first.error) < 1e-5
    again = Roller(0.11, indentation=first.exit_height - 0.014, profile="circle")
    second = column.roll_over(first.columns, again, LAW, 0.1)
    assert second.resistance < 0.01 * first.resistance
    assert second.exit_density_ratio == pytest.approx(first.exit_density_ratio, abs=1e-4)
    assert abs(second.mass_residual) < 1e-7


def test_feed_for_a_product_and_a_lower_lift():
    feed = column.required_feed(0.01, 0.7, LAW, 0.1)
    found = rolled(LAW, feed.indentation, feed.height)
    assert found.exit_density_ratio == pytest.approx(0.7, abs=1e-7)
    assert found.exit_height == pytest.approx(0.01, rel=1e-7)
    above = rolled(LAW, 0.005, lower_lift=LowerLift(0.02, 0.6))
    assert above.lower_density_ratio == pytest.approx(0.6, abs=2e-3)
    assert abs(above.mass_residual) < 1e-7


def test_tables_of_the_prior_are_near_the_cap_with_constant_slopes():
    """Both have the same die, line and moduli, but another cap near its corner."""
    tables = density_dependent_cap(read_cap_tables(SCENES / "concrete-cap.csv"), 0.9)
    constant = drucker_prager_cap(
        friction_angle=35.0, cohesion=20e3, earth_pressure_coefficient=0.4264, pressure=203e3, dilatancy_angle=0.0,
        unloading_modulus=120e6, poisson=0.3, heckel_slope=1.4379e-5, loose_density_ratio=0.72, fed_density_ratio=0.9,
    )  # fmt: skip
    one, other = (rolled(law, 0.0054, 0.0653) for law in (tables, constant))
    assert one.load == pytest.approx(other.load, rel=2e-3)
    assert one.resistance == pytest.approx(other.resistance, rel=2e-3)
