"""Material: the prior of the mix, hardening curves of the laws, confined compression, refusals."""

import csv
import re
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mixes import STIFF, oedometer, shear_line
from scipy.integrate import solve_ivp

from compact.material import cap_plasticity, mix
from compact.material.confined_compression import stress_angle
from compact.material.elliptic_cap import reaction
from compact.material.laws import HECKEL_MIN_PRESSURE, SATURATION_LIMIT, Compaction

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


# ---- Material laws: closed forms of the hardening curve, and invalid parameters


MIX = replace(STIFF, dry_side="flat")
LOOSEST = 1 - 0.28 * np.exp(-HECKEL_MIN_PRESSURE)  # where pc leaves the curve near k0


# closed form


@pytest.mark.parametrize("k", [LOOSEST, 0.75, 0.94, 0.98, SATURATION_LIMIT])
def test_yield_pressure_follows_heckels_curve(k):
    assert MIX.yield_pressure(k) == pytest.approx(np.log(0.28 / (1 - k)) / 13e-6, rel=1e-13)


def test_curve_is_heckels_up_to_the_saturation_limit_and_constant_beyond():
    k = np.array([0.995, 0.9979, 0.998, 1.0, 1.07])
    expected = np.log(0.28 / (1 - np.minimum(k, 0.998))) / 13e-6
    assert MIX.yield_pressure(k) == pytest.approx(expected, rel=1e-14)
    assert MIX.saturation_pressure(k) == pytest.approx([0, 0, 0, *(0.8e9 * np.log(k[3:] / 0.998))], rel=1e-13)


def test_loose_mix_has_half_of_the_minimum_pressure():
    assert MIX.yield_pressure(np.array([0.5, 1e-9])) == pytest.approx(HECKEL_MIN_PRESSURE / 2 / 13e-6, rel=1e-12)


@pytest.mark.parametrize(
    "mix", [MIX, *(replace(MIX, heckel_test="confined", unloading_modulus=E) for E in (3e6, 60e6))]
)
def test_compiled_hardening_equals_that_of_the_law(mix):
    k = np.concatenate((np.linspace(0.01, 1.5, 600), [LOOSEST, SATURATION_LIMIT]))
    constants = cap_plasticity.cap_constants(mix, 1.0)
    u = [reaction(constants, value)[0] for value in k]
    assert u == pytest.approx(mix.saturation_pressure(k), rel=1e-13)
    pc, modulus = np.array([cap_plasticity.hardening(constants, value) for value in k]).T
    assert pc == pytest.approx(mix.yield_pressure(k), rel=1e-13)
    h = 1e-6
    smooth = np.minimum(abs(k - LOOSEST), abs(k - SATURATION_LIMIT)) > 2 * h  # not across a joint
    central = (mix.yield_pressure(k * np.exp(h)) - mix.yield_pressure(k * np.exp(-h))) / (2 * h)
    assert modulus[smooth] == pytest.approx(central[smooth], rel=1e-6, abs=1e-3)


# errors

POSITIVE = ("unloading_modulus", "heckel_slope", "loose_density_ratio", "critical_slope", "reference_rate")
RULES = {
    "must be positive and finite, got": [(name, value) for name in POSITIVE for value in (0.0, -1.0, np.nan, np.inf)],
    "must be zero or positive, and finite, got -1": [("tensile_strength", -1.0), ("rate_sensitivity", -1.0)],
    r"must lie in \[0, 0.5\), got": [("poisson", value) for value in (-0.1, 0.5, np.nan)],
    "must be above 0.72 and below 0.998, got": [("fed_density_ratio", value) for value in (0.72, 0.5, 0.998, np.nan)],
}


@pytest.mark.parametrize(("rule", "name", "value"), [(rule, *each) for rule, cases in RULES.items() for each in cases])
def test_parameters_out_of_range_are_refused(rule, name, value):
    with pytest.raises(ValueError, match=f"`{name}` {rule}"):
        replace(MIX, **{name: value})


# ---- Stress path of confined compression: equation of flow, rigid limit, order, Heckel's curve by return mapping


HECKEL_SLOPE = 14.96e-6


def ellipse(friction_angle, modulus=120e6, **other):
    angle = np.radians(friction_angle)
    return Compaction(
        unloading_modulus=modulus, poisson=0.3, heckel_slope=HECKEL_SLOPE, loose_density_ratio=0.72,
        critical_slope=float(np.sqrt(3) * np.sin(angle)), tensile_strength=float(10e3 / np.tan(angle)),
        fed_density_ratio=0.9, heckel_test="confined", **other,
    )  # fmt: skip


def angle_by_time_steps(law):
    """Angle at k .97 by an implicit Runge-Kutta method, from the rigid-plastic state at k .8."""
    K, G, M, pt = law.bulk_modulus, law.shear_modulus, law.critical_slope, law.tensile_strength
    slope, k0 = law.heckel_slope, law.loose_density_ratio
    S, rigid = np.sqrt(1 + 4 * M * M / 9), np.arctan(2 * M / 3)

    def rate(V, d):
        k, t, ratio = np.exp(V), rigid + d, 1 + S * np.cos(d)
        a = (np.log((1 - k0) / (1 - k)) / slope + pt) / ratio
        a_V, a_t = k / (1 - k) / slope / ratio, a * S * np.sin(d) / ratio
        by_V = 2 / 3 * a_V * (1 + np.cos(t)) / K - M * a_V * np.sin(t) / (3 * G)
        by_t = 2 / 3 * (a_t * (1 + np.cos(t)) - a * np.sin(t)) / K - M * (a_t * np.sin(t) + a * np.cos(t)) / (3 * G)
        return ((np.tan(t) - 2 * M / 3) / M - by_V) / by_t

    path = solve_ivp(rate, np.log([0.8, 0.97]), [0.0], method="Radau", rtol=1e-9, atol=1e-12)
    return float(path.y[0, -1])


@pytest.mark.parametrize("modulus", [20e6, 120e6])
def test_angle_is_that_of_a_time_integration(modulus):
    law = ellipse(35, modulus)
    x, angle = stress_angle(law, 0.99)
    at = np.polynomial.Polynomial.fit(np.log1p(x), angle, len(x) - 1)(-np.log1p(-0.97))
    assert at == pytest.approx(angle_by_time_steps(law), rel=1e-6)


def test_factor_is_of_second_order_in_the_elastic_strain():
    """The first coefficient, of small x, is that of the expansion (1 - cos d) S/(1 + S) with d proportional to x/E."""
    law = ellipse(35, 1e10)
    M, S, t = law.critical_slope, np.sqrt(1 + 4 * law.critical_slope**2 / 9), np.arctan(2 * law.critical_slope / 3)
    change = 2 / 3 * (1 + np.cos(t)) / law.bulk_modulus - M * np.sin(t) / (3 * law.shear_modulus)
    d = M * np.cos(t) ** 2 * change / (1 + S) / HECKEL_SLOPE
    assert law.elastic_polynomial[0] == pytest.approx(S / (1 + S) * d * d / 2, rel=2e-3)


@pytest.mark.parametrize("modulus", [60e6, 120e6])
@pytest.mark.parametrize("friction_angle", [28, 35, 38])
@pytest.mark.parametrize(("law", "error"), [("ellipse", 3e-7), ("shear line", 1e-7)])
def test_oedometer_follows_heckel_and_the_earth_pressure(law, error, friction_angle, modulus):
    """Without the factor the stress is 5e-5 too small at 120 MPa and 2e-4 at 60 MPa."""
    if law == "ellipse":
        path = oedometer(ellipse(friction_angle, modulus), 203e3, 2e-5)
    else:
        path = oedometer(shear_line(friction_angle=friction_angle, unloading_modulus=modulus), 200e3)
        assert path[-1, 1] == pytest.approx(1 - np.sin(np.radians(friction_angle)), abs=0.005)
    stress, _, k = path[path[:, 2] > 0.91].T
    assert stress == pytest.approx(np.log(0.28 / (1 - k)) / HECKEL_SLOPE, rel=error)
