"""Resistance map: closed forms, order of convergence, error estimate, monotonicity, files, errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampling import examples

from compact.engines.spectral import engine as spectral
from compact.material.laws import Viscoelastic
from compact.resistance import (
    UNSTEADINESS_LIMIT,
    ResistanceMap,
    load_resistance_map,
    sample_resistance,
    tabulated_resistance,
)
from compact.rolling_contact import Layer, Roller


def relaxing(speed):
    """Resistance of a relaxing layer: a maximum over the speed."""
    return 800 * speed / (0.04 + speed**2), None


def mapped(resistance=relaxing, slowest=0.01, fastest=1.0, tolerance=1e-3, known=()):
    return sample_resistance(resistance, slowest, fastest, tolerance, known)


def true_error(resistance_map, resistance=relaxing, slowest=1e-5):
    speed = np.geomspace(slowest, resistance_map.speeds[-1], 2001)
    force = np.array([resistance(v)[0] for v in speed])
    return np.abs(resistance_map(speed) - force).max() / np.abs(force).max()


# (a) closed forms


@pytest.mark.parametrize("exponent", [0.0, 0.02, 1.0])
def test_power_law_applies_below_the_slowest_sample(exponent):
    law = mapped(lambda speed: (300 * speed**exponent, None), tolerance=1e-5)
    speed = np.array([1e-9, 1e-4, 0.01, 0.3, 1.0])
    assert law(speed) == pytest.approx(300 * speed**exponent, rel=1e-3)
    assert law(1e-9) == pytest.approx(300 * 1e-9**exponent, rel=2e-3)
    assert law.exponent == pytest.approx(exponent, abs=2e-5)


def test_dry_friction_needs_five_samples():
    asked = []
    dry = mapped(lambda speed: (asked.append(speed) or 300.0, 0.01))
    assert len(asked) == len(dry.speeds) == 5
    assert (dry.error, dry.engine_error) == (0.0, 0.01)
    assert dry(np.array([-1.0, 0.0, 1e-15])).tolist() == [-300.0, 0.0, 300.0]


# contact.md e: the SLS Winkler foundation, kr = R = b = tau = 1, m = 1: v, F, M; the first two between table values
WINKLER = np.array([
    [0.03, 0.01868985, -0.551640], [0.1, 0.05309453, -0.323041], [0.3, 0.10107269, 0.004042],
    [0.5, 0.11235094, 0.051034], [1.0, 0.10445711, 0.030866], [3.0, 0.06130111, 0.003842],
])  # fmt: skip


def foundation():
    speeds, forces, masses = WINKLER.T
    return ResistanceMap(speeds, forces, 0.0, added_masses=masses, relaxation_time=1.0)


@pytest.mark.parametrize(
    ("velocity", "acceleration", "force", "most"),
    [(1.0, -0.03, 0.10355338, 3e-4), (1.0, 0.03, 0.10540707, 3e-4), (0.1, -0.03, 0.06090090, 0.08)],
)
def test_constant_acceleration_on_a_winkler_foundation(velocity, acceleration, force, most):
    """The error is of second order within the limit; beyond it is smaller than without M."""
    law = foundation()
    assert law(velocity, acceleration) == pytest.approx(force, rel=most)
    assert abs(law(velocity, acceleration) - force) < abs(law(velocity) - force) * (0.7 if most > 0.01 else 0.1)


def test_resistance_is_odd_in_velocity_and_acceleration():
    law, draw = foundation(), np.random.default_rng(2)
    velocity, acceleration = draw.uniform(-3, 3, 500), draw.uniform(-1, 1, 500)
    assert np.array_equal(law(-velocity, -acceleration), -law(velocity, acceleration))


def test_acceleration_is_limited():
    law, velocity = foundation(), np.geomspace(1e-3, 3, 50)
    within = law(velocity, 0.5 * UNSTEADINESS_LIMIT * velocity) - law(velocity)
    at_limit = law(velocity, UNSTEADINESS_LIMIT * velocity) - law(velocity)
    assert at_limit == pytest.approx(2 * within, rel=1e-9, abs=1e-15)
    assert np.array_equal(law(velocity, 50.0 * velocity), law(velocity, UNSTEADINESS_LIMIT * velocity))
    assert law(0.0, 5.0) == 0
    assert abs(law(1e-9, 5.0)) < 1e-8
    assert law.is_unsteady(velocity, UNSTEADINESS_LIMIT * velocity * (1 + 1e-9)).all()
    assert not law.is_unsteady(velocity, UNSTEADINESS_LIMIT * velocity * (1 - 1e-9)).any()
    assert law.is_unsteady([0.0, 0.0, -2.0], [0.0, 1.0, -1.0]).tolist() == [False, True, True]


# (b) order of convergence and error estimate


def test_error_is_of_fourth_order_in_the_distance_of_samples():
    errors = []
    for count in (17, 33, 65):
        speeds = np.geomspace(1e-3, 1.0, count)
        errors.append(true_error(ResistanceMap(speeds, np.array([relaxing(v)[0] for v in speeds]), 0.0), slowest=1e-3))
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 3.5


@pytest.mark.parametrize("tolerance", [0.05, 0.01, 1e-3, 1e-4])
def test_error_estimate_bounds_the_true_error(tolerance):
    law = mapped(tolerance=tolerance)
    assert true_error(law) <= law.error <= tolerance


def test_map_of_the_spectral_engine_estimates_its_error():
    layer = Layer(0.22)
    roller = Roller(0.11, indentation=0.003)
    mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))

    def resistance(speed):
        rolled = spectral.roll(layer, roller, mix, speed)
        return rolled.resistance, rolled.error[1]

    law = mapped(resistance, tolerance=0.01)
    speed = np.geomspace(1e-4, 1, 15)
    force = np.array([resistance(v)[0] for v in speed])
    assert np.abs(law(speed) - force).max() < law.error * force.max()
    assert law.engine_error < 1e-3


# (c) monotonicity and signs


@examples(30, slow=60)
@given(st.lists(st.floats(0, 1e4), min_size=4, max_size=12))
def test_map_is_monotone_where_its_samples_are(rises):
    speeds = np.geomspace(0.01, 1, len(rises))
    law = ResistanceMap(speeds, 1.0 + np.cumsum(rises), 0.0)
    force = law(np.geomspace(0.01, 1, 3001))
    assert np.diff(force).min() >= -1e-9 * force.max()


def test_force_with_a_change_of_sign_is_interpolated():
    law = mapped(lambda speed: (300 * np.log(speed / 0.1), None))
    assert law(0.1) == pytest.approx(0, abs=1.0)
    assert law(0.02) < 0 < law(0.5)


# (e) files


def test_map_is_read_as_written(tmp_path):
    law = mapped(lambda speed: (*relaxing(speed)[:1], 0.013))
    law = replace(law, added_masses=np.cos(law.speeds), relaxation_time=0.3)
    law.save(tmp_path / "map.nc")
    read = load_resistance_map(tmp_path / "map.nc")
    assert np.array_equal([law.speeds, law.forces, law.added_masses], [read.speeds, read.forces, read.added_masses])
    assert (read.error, read.engine_error, read.relaxation_time) == (law.error, law.engine_error, 0.3)
    assert [path.name for path in tmp_path.iterdir()] == ["map.nc"]
    mapped().save(tmp_path / "map.nc")
    read = load_resistance_map(tmp_path / "map.nc")
    assert (read.engine_error, read.added_masses) == (None, None)  # unknown


# (f) errors


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: mapped(lambda speed: (np.nan, None)), "`resistance` must be finite, got nan"),
        (lambda: mapped()(np.array([0.1, -1.2])), r"computed up to 1 m/s, got 1\.2 m/s; sample it over the speeds"),
        (lambda: tabulated_resistance((0.1, 0.2), (1.0,)), "must be columns of one length >= 2, got shapes"),
        (lambda: tabulated_resistance((0.2, 0.1), (1.0, 2.0)), "`speeds` must ascend from a value above 0, got"),
    ],
)
def test_invalid_values_are_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
