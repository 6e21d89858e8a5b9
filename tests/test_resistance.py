"""The resistance map: closed forms, order, what it tells of itself, shape of the data, files, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compact import spectral
from compact.material import Viscoelastic
from compact.records import Layer, Roller
from compact.resistance import MOST, ResistanceMap, load, sampled


def relaxing(speed):
    """Of a layer that relaxes: rises with the speed, then falls."""
    return 800 * speed / (0.04 + speed**2), None


def mapped(resistance=relaxing, slowest=0.01, fastest=1.0, tolerance=1e-3, known=()):
    return sampled(resistance, slowest, fastest, tolerance, known)


def true_error(resistance_map, resistance=relaxing, slowest=1e-5):
    speed = np.geomspace(slowest, resistance_map.speeds[-1], 2001)
    force = np.array([resistance(v)[0] for v in speed])
    return np.abs(resistance_map(speed) - force).max() / np.abs(force).max()


# (a) closed forms


@pytest.mark.parametrize("exponent", [0.0, 0.02, 1.0])
def test_power_law_is_kept_below_the_slowest_sample(exponent):
    law = mapped(lambda speed: (300 * speed**exponent, None), tolerance=1e-5)
    speed = np.array([1e-9, 1e-4, 0.01, 0.3, 1.0])
    assert law(speed) == pytest.approx(300 * speed**exponent, rel=1e-3)
    assert law(1e-9) == pytest.approx(300 * 1e-9**exponent, rel=2e-3)
    assert law.exponent == pytest.approx(exponent, abs=2e-5)


def test_resistance_without_speed_takes_five_samples_and_holds_at_rest():
    asked = []
    dry = mapped(lambda speed: (asked.append(speed) or 300.0, 0.01))
    assert len(asked) == len(dry.speeds) == 5
    assert (dry.error, dry.engine_error, dry.limit) == (0.0, 0.01, 300.0)
    assert dry(np.array([-1.0, 0.0, 1e-15])).tolist() == [-300.0, 0.0, 300.0]


def test_resistance_that_vanishes_with_speed_holds_nothing_at_rest():
    assert mapped().limit == 0.0


# (b) order, and what the map tells of itself


def test_error_falls_with_the_fourth_power_of_the_distance_between_samples():
    errors = []
    for count in (17, 33, 65):
        speeds = np.geomspace(1e-3, 1.0, count)
        errors.append(true_error(ResistanceMap(speeds, np.array([relaxing(v)[0] for v in speeds]), 0.0), slowest=1e-3))
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 3.5


@pytest.mark.parametrize("tolerance", [0.05, 0.01, 1e-3, 1e-4])
def test_tolerance_is_met_and_the_error_told_is_no_less_than_the_true_one(tolerance):
    law = mapped(tolerance=tolerance)
    assert true_error(law) <= law.error <= tolerance


def test_map_of_the_spectral_engine_tells_its_error():
    layer, roller, mix = Layer(0.22), Roller(0.11, 0.003), Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))

    def resistance(speed):
        rolled = spectral.roll(layer, roller, mix, speed)
        return rolled.resistance, rolled.error[1]

    law = mapped(resistance, tolerance=0.01)
    speed = np.geomspace(1e-4, 1, 15)
    force = np.array([resistance(v)[0] for v in speed])
    assert np.abs(law(speed) - force).max() < law.error * force.max()
    assert law.engine_error < 1e-3


# (c) the shape of the data


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0, 1e4), min_size=4, max_size=12))
def test_map_is_monotone_where_the_samples_are(rises):
    speeds = np.geomspace(0.01, 1, len(rises))
    law = ResistanceMap(speeds, 1.0 + np.cumsum(rises), 0.0)
    force = law(np.geomspace(0.01, 1, 3001))
    assert np.diff(force).min() >= -1e-9 * force.max()


def test_resistance_is_odd_and_takes_arrays_of_any_shape():
    law, velocity = mapped(), np.linspace(-1, 1, 24).reshape(2, 3, 4)
    assert np.array_equal(law(-velocity, 0.0), -law(velocity, 0.0))
    assert law(velocity, np.zeros((5, 1, 1, 1))).shape == (5, 2, 3, 4)
    assert law(0.3) == law(np.array([0.3]))[0]
    assert law(np.array([])).shape == (0,)


def test_force_that_helps_at_low_speed_changes_its_sign_in_between():
    law = mapped(lambda speed: (300 * np.log(speed / 0.1), None))
    assert law(0.1) == pytest.approx(0, abs=1.0)
    assert law(0.02) < 0 < law(0.5)


# (d) cost


def test_known_samples_are_not_computed_again():
    known, asked = [(v, *relaxing(v)) for v in np.geomspace(1e-4, 1, 60).tolist()], []
    mapped(lambda speed: asked.append(speed) or relaxing(speed), known=known)
    assert asked in ([], [1.0])  # the last of a geomspace may miss 1 by rounding


# (e) files


def test_map_is_read_as_it_was_written(tmp_path):
    law = mapped(lambda speed: (*relaxing(speed)[:1], 0.013))
    law.save(tmp_path / "map.nc", "abc")
    read = load(tmp_path / "map.nc", "abc")
    assert np.array_equal([law.speeds, law.forces], [read.speeds, read.forces])
    assert (read.error, read.engine_error) == (law.error, law.engine_error)
    assert [path.name for path in tmp_path.iterdir()] == ["map.nc"]


def test_error_that_is_not_known_stays_unknown_in_the_file(tmp_path):
    mapped().save(tmp_path / "map.nc")
    assert load(tmp_path / "map.nc").engine_error is None


def test_map_of_another_scene_is_refused(tmp_path):
    mapped().save(tmp_path / "map.nc", "abc")
    with pytest.raises(ValueError, match=r"map\.nc: made of scene abc by compact .*, wanted def .*; compute it again"):
        load(tmp_path / "map.nc", "def")


# (f) refusals


def test_speed_beyond_the_samples_is_refused():
    with pytest.raises(ValueError, match=r"computed up to 1 m/s, got 1\.2 m/s; sample it over the speeds"):
        mapped()(np.array([0.1, -1.2]))


def test_scatter_that_no_samples_resolve_is_told():
    draw = np.random.default_rng(1)
    with pytest.raises(RuntimeError, match=r"predict each other to 0\.\d+ of the largest force only, 0\.001 was asked"):
        mapped(lambda speed: (300 + draw.normal(), None))
    assert MOST < 100


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tolerance": 0.0}, "`tolerance` must be positive"),
        ({"fastest": np.inf}, "`fastest` must be positive and finite"),
        ({"resistance": lambda speed: (np.nan, None)}, "`resistance` must be finite, got nan"),
    ],
)
def test_refusals(changes, words):
    with pytest.raises(ValueError, match=words):
        mapped(**changes)
