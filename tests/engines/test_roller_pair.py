"""Two rolls: nip of equal gradients, pressure of columns and of Johanson, force factor, refusals."""

import dataclasses

import numpy as np
import pytest

from compact.engines.column.roller_pair import RollerPair

PAIR = RollerPair(0.1, 0.004, 5.0, 40.0, 20.0)


def test_both_gradients_are_equal_at_the_nip():
    nip = PAIR.nip_angle
    assert float(PAIR.slip_gradient(nip)) == pytest.approx(float(PAIR.stick_gradient(nip)), rel=1e-12)
    assert np.degrees(nip) == pytest.approx(10.95, abs=0.005)


def test_columns_keep_the_mass_between_vertical_sections():
    nip = PAIR.nip_angle
    found = PAIR.columns(1e6, nip)
    height = PAIR.gap / 2 + PAIR.radius * (1 - np.cos(np.arcsin(found.x / PAIR.radius)))
    assert found.pressure == pytest.approx(1e6 * (height[-1] / height) ** 5, rel=1e-12)
    assert found.leading == pytest.approx(PAIR.radius * np.sin(nip))
    assert found.exit_height == pytest.approx(PAIR.gap / 2)


def test_the_force_factor_is_the_integral_of_the_pressure():
    angle = np.linspace(0, PAIR.nip_angle, 20001)
    assert PAIR.force_factor(PAIR.nip_angle) == pytest.approx(
        np.trapezoid(PAIR.relative_pressure(angle) * np.cos(angle), angle), rel=1e-8
    )


def test_rough_rolls_draw_powder_in_earlier():
    rougher = dataclasses.replace(PAIR, wall_friction_angle=25.0)
    stiffer = dataclasses.replace(PAIR, compressibility=20.0)
    assert stiffer.nip_angle < PAIR.nip_angle < rougher.nip_angle


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"gap": 0.0}, "`gap` must be positive"),
        ({"wall_friction_angle": 45.0}, "`wall_friction_angle` must be below 40.0"),
        (
            {"compressibility": 0.5, "effective_friction_angle": 60.0, "wall_friction_angle": 59.0},
            "larger compressibility",
        ),
    ],
)
def test_foreign_pairs_are_refused(changes, match):
    with pytest.raises(ValueError, match=match):
        _ = dataclasses.replace(PAIR, **changes).nip_angle
