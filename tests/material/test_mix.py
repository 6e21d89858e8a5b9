"""Mix prior: phase relations, interpolation of the table, the published point, overrides, errors."""

import csv
import re
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact.material import mix

with (files("compact") / "data" / "mix.csv").open() as file:
    TABLE = [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(file)]
KEYS = ("moisture", "density_ratio")
PHASES = ("bulk_density", "saturation")
COLUMNS = [name for name in TABLE[0] if name not in KEYS + PHASES]

moistures = st.floats(0.08, 0.12)
ratios = st.floats(0.90, 0.99)


# closed form


@given(moistures, ratios)
def test_phase_volumes_add_up(moisture, density_ratio):
    dry = mix.bulk_density(moisture, density_ratio) / (1 + moisture)
    pores = 1 - dry / 2650
    assert mix.saturation(moisture, density_ratio) == pytest.approx(moisture * dry / 1000 / pores, rel=1e-12)


@given(moistures, ratios)
def test_heckel_slope_gives_the_required_pressure(moisture, density_ratio):
    for overrides in ({"rate_sensitivity": 0.0}, {}, {"rate_sensitivity": 0.03, "reference_rate": 1e-2}):
        m = mix.prior(moisture, density_ratio, overrides)
        factor = 1 + m.rate_sensitivity * np.log(1 + mix.OPERATING_RATE / m.reference_rate)
        pressure = factor * np.log(0.28 / (1 - density_ratio)) / m.heckel_slope
        assert pressure == pytest.approx(m.required_pressure, rel=8e-3)


@given(moistures, ratios)
def test_pore_air_modulus_follows_from_one_atmosphere(moisture, density_ratio):
    assert mix.prior(moisture, density_ratio).pore_air_modulus == pytest.approx(101325 / (1 - density_ratio), rel=4e-3)


# published numbers


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row['moisture']}-{row['density_ratio']}")
def test_nodes_of_the_table_are_reproduced(row):
    m = mix.prior(row["moisture"], row["density_ratio"])
    assert [getattr(m, name) for name in COLUMNS] == pytest.approx([row[name] for name in COLUMNS], rel=1e-14)
    assert m.bulk_density == pytest.approx(row["bulk_density"], abs=0.5)
    assert m.saturation == pytest.approx(row["saturation"], abs=5e-4)
    assert m.effective_modulus == m.relaxed_modulus


def test_published_operating_point():
    m = mix.prior(0.10, 0.98)
    q = m.parameter("required_pressure")
    assert (q.value, q.low, q.high) == pytest.approx((0.203e6, 0.203e6 / 1.5, 0.203e6 * 1.5))
    assert (q.unit, q.flag) == ("Pa", "calibrated")
    assert (m.relaxed_modulus, m.poisson) == pytest.approx((0.75e6, 0.30))


@pytest.mark.parametrize(
    ("name", "low", "high", "flag"),
    [
        ("bulk_density", 2258.26 / 1.02, 2258.26 * 1.02, "derived"),
        ("unloading_modulus", 60e6, 240e6, "analogous"),
        ("poisson", 0.23, 0.37, "analogous"),
        ("heckel_slope", 14.3788593e-6 / 1.5, 14.3788593e-6 * 1.5, "calibrated"),  # 13/MPa at the rate of the machine
        ("saturation_limit", 0.995, 0.999, "assumed"),
        ("rate_sensitivity", 0.01, 0.03, "analogous"),
        ("effective_modulus", 0.5e6, 1.125e6, "calibrated"),
    ],
)
def test_every_parameter_has_a_spread_and_a_flag(name, low, high, flag):
    parameter = mix.prior(0.10, 0.98).parameter(name)
    assert (parameter.low, parameter.high) == pytest.approx((low, high), rel=1e-5)
    assert parameter.flag == flag
    assert parameter.origin


def test_spread_about_another_value_is_in_proportion_and_that_of_the_limit_in_air_voids():
    slope, limit = (mix.prior(0.10, 0.98).parameter(name) for name in ("heckel_slope", "saturation_limit"))
    assert slope.spread_about(20e-6) == pytest.approx((20e-6 / 1.5, 30e-6))
    assert slope.spread_about(20e-6, 0.1) == pytest.approx((18e-6, 22e-6))
    assert limit.spread_about(limit.value) == pytest.approx((0.995, 0.999))
    assert limit.spread_about(0.9999) == pytest.approx((0.99975, 0.99995))
    assert limit.spread_about(0.99, 0.1) == pytest.approx((0.989, 0.991))


# hard cases


# properties


@pytest.fixture(scope="module")
def grid():
    return [[mix.prior(w, k) for k in np.linspace(0.90, 0.99, 37)] for w in np.linspace(0.08, 0.12, 17)]


@pytest.mark.parametrize("name", [*COLUMNS, *PHASES])
def test_values_are_monotone_between_nodes(grid, name):
    values = np.array([[getattr(m, name) for m in row] for row in grid])
    along_k, along_w = np.diff(values, axis=1), np.diff(values, axis=0)
    slack = 1e-12 * np.abs(values).max()
    assert np.all(along_k >= -slack)  # every column rises or stays with density
    if name != "cohesion":  # which is highest at moisture 0.09
        assert np.all(along_w >= -slack) or np.all(along_w <= slack)


@pytest.mark.parametrize(
    ("moisture", "density_ratio", "overrides", "reason"),
    [
        (0.10, 0.98, {}, "^$"),
        (0.08, 0.99, {}, "^$"),
        (0.09, 0.99, {}, "^density ratio 0.99 at moisture 0.09 is not achievable by rolling: .* saturation of 0.9502"),
        (0.12, 0.98, {"required_pressure": 0.6e6}, "pressure of 0.60 MPa exceeds the 0.5 MPa of rolling; add water"),
        (0.12, 0.99, {"required_pressure": 0.6e6}, "the required pressure of 0.60 MPa.*; the saturation of 0.9598"),
    ],
)
def test_density_beyond_rolling_has_a_reason(moisture, density_ratio, overrides, reason):
    assert re.search(reason, mix.prior(moisture, density_ratio, overrides).not_achievable)


# errors

PRIOR, STATE = mix.prior, (0.10, 0.98)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: PRIOR(0.13, 0.98), "`moisture` must be between 0.08 and 0.12, got 0.13"),
        (lambda: PRIOR(*STATE, {"poison": 0.3}), "no mix parameter 'poison'; did you mean 'poisson'.*bulk_density"),
        (lambda: PRIOR(*STATE, {"poisson": 0.5}), r"`poisson` must lie in \[0, 0.5\), got 0.5"),
        (lambda: PRIOR(*STATE).parameter("modulus"), "no mix parameter 'modulus'.*choose from bulk_density"),
    ],
)
def test_states_outside_the_prior_raise_an_error(call, message):
    with pytest.raises(ValueError, match=message):
        call()
