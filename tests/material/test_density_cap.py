"""Cap with tables over the density: the ellipse of constant tables, convergence of the steps, limits, refusals."""

import dataclasses

import numpy as np
import pytest

from compact.material.density_cap import DensityCap, heckel_slope

DENSITY = np.linspace(0.5, 0.9, 9)


def cap(modulus=5e9, **changes):
    """A cap with constant R and beta, whose pb follows Heckel's law with 0.0125/MPa."""
    pressure = np.log(0.6 / (1 - DENSITY)) / 0.0125e-6
    n = len(DENSITY)
    given = DensityCap(
        tuple(DENSITY), tuple(pressure), (1e6,) * n, (65.0,) * n, (0.7,) * n, (0.4, 0.9), (modulus, modulus), (0.2, 0.2)
    )
    return dataclasses.replace(given, **changes)


def test_a_rigid_die_has_normal_flow_without_radial_strain():
    path = cap().rigid_die(DENSITY)
    for k, p, q in zip(DENSITY, path.mean_pressure, path.von_mises_stress, strict=True):
        pa, R, d, tangent = cap().cap(k)
        assert np.hypot(p - pa, R * q) == pytest.approx(R * (d + pa * tangent), rel=1e-12)
        assert q == pytest.approx(2 * (p - pa) / (3 * R**2), rel=1e-12)
        assert p + 2 / 3 * q == pytest.approx(path.axial_stress[list(DENSITY).index(k)])


def test_the_elastic_die_approaches_the_rigid_one():
    rigid, at = cap().rigid_die(DENSITY[2:-1]), DENSITY[2:-1]
    for modulus, tolerance in ((5e9, 0.1), (5e11, 2e-3)):
        path = cap(modulus).die(0.5, 0.9)
        assert path.at(at) == pytest.approx(rigid.axial_stress, rel=tolerance)


def test_steps_converge_with_first_order():
    ends = [float(cap().die(0.5, 0.85, steps).at(0.8, "radial_stress")) for steps in (100, 200, 400)]
    assert abs(ends[2] - ends[1]) < 0.7 * abs(ends[1] - ends[0])
    assert ends[2] == pytest.approx(ends[1], rel=1e-3)


def test_isotropic_compression_follows_the_hydrostatic_yield():
    path = cap().isotropic(0.5, 0.88)
    assert heckel_slope(path.density_ratio[5:], path.mean_pressure[5:]) == pytest.approx(0.0125e-6, rel=0.01)
    assert np.abs(path.von_mises_stress).max() == 0
    assert (np.diff(path.mean_pressure) > 0).all()


def test_columns_take_the_stress_of_the_die():
    law, path = cap().column_law(0.5, 0.85), cap().die(0.5, 0.85)
    loaded = path.density_ratio * np.exp(path.elastic_strain)
    place = len(loaded) // 2
    height = 0.1
    pressure = law.pressure(height * (1 - 0.5 / loaded[place]), height)
    assert float(pressure) == pytest.approx(path.axial_stress[place], rel=1e-3)


@pytest.mark.parametrize(
    ("act", "match"),
    [
        (lambda: cap().die(0.4, 0.8), "0.5 <= start < end <= 0.9"),
        (lambda: cap().die(0.8, 0.7), "start < end"),
        (lambda: cap(poisson=(0.2, 0.5)), "`poisson` must be below 0.5"),
        (lambda: cap(density_ratio=tuple(DENSITY[::-1])), "must ascend"),
        (lambda: cap(cohesion=(1e6,)), "the same length"),
        (lambda: cap(eccentricity=(0.0,) * len(DENSITY)), "positive"),
    ],
)
def test_foreign_tables_are_refused(act, match):
    with pytest.raises(ValueError, match=match):
        act()
