"""Motion from a table: polynomial laws, interpolated end rows, calibrated error estimate, errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compact.motion.profile import law
from compact.motion.tabulated import from_table

STROKE, DURATION, NOISE = 0.4, 3.0, 1e-5
INSIDE = np.linspace(0.05, 0.95, 19) * DURATION


def table_of(name, rows=61, **shape):
    time = np.linspace(0, DURATION, rows)
    return time, law(name, STROKE, DURATION, **shape).position(time)


def noisy_quintic(seed, rows, ends):
    """Table of the quintic law with normal noise of NOISE m on every row, or on all but the end rows."""
    time, position = table_of("quintic", rows)
    noise = NOISE * np.random.default_rng(seed).standard_normal(rows)
    if ends == "exact ends":
        noise[[0, -1]] = 0
    return from_table(time, position + noise)


# ---- (a) closed form -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "digits"), [(0, 1e-11), (1, 1e-10), (2, 1e-8), (3, 1e-6)])
@pytest.mark.parametrize("rows", [12, 13, 30, 61, 400])
@pytest.mark.parametrize("name", ["cubic", "quintic"])
def test_table_without_noise_reproduces_its_polynomial(name, rows, order, digits):
    time, exact = np.linspace(0, DURATION, 301), law(name, STROKE, DURATION)
    got = from_table(*table_of(name, rows)).derivative(time, order)
    size = np.abs(exact.derivative(time, order)).max()
    assert got == pytest.approx(exact.derivative(time, order), rel=0, abs=digits * size)


def test_peaks_are_those_of_the_curve():
    peaks, exact = from_table(*table_of("quintic", 30)).peaks(), law("quintic", STROKE, DURATION).peaks()
    assert (peaks.velocity, peaks.acceleration, peaks.jerk) == pytest.approx(
        (exact.velocity, exact.acceleration, exact.jerk), rel=1e-6
    )


@pytest.mark.parametrize("name", ["septic", "cycloidal"])
@pytest.mark.parametrize(("rows", "tolerance"), [(31, 1e-2), (61, 1e-3), (200, 1e-4)])
def test_table_without_noise_reproduces_the_jerk_of_a_smooth_law(name, rows, tolerance):
    exact = law(name, STROKE, DURATION)
    assert from_table(*table_of(name, rows)).jerk(INSIDE) == pytest.approx(
        exact.jerk(INSIDE), abs=tolerance * exact.peaks().jerk
    )


def test_jerk_is_continuous():
    motion = noisy_quintic(0, 61, "exact ends")
    assert {join.time for join in motion.discontinuities() if join.order <= 3} <= {0.0, DURATION}


# ---- (b) order -------------------------------------------------------------------------------------------------------


def test_error_without_noise_has_the_order_of_the_quintic_spline():
    rows = np.array([31, 61, 121])
    exact = law("cycloidal", STROKE, DURATION)
    error = [
        np.abs(from_table(*table_of("cycloidal", n)).position(INSIDE) - exact.position(INSIDE)).max() for n in rows
    ]
    assert -np.polyfit(np.log(rows), np.log(error), 1)[0] > 5.5


# ---- error estimate --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=["exact ends", "noisy ends"])
def trials(request):
    """Errors and reported standard errors over 80 tables, by order of derivative, at the phases INSIDE."""
    exact = law("quintic", STROKE, DURATION)
    motions = [noisy_quintic(seed, 61, request.param) for seed in range(80)]
    errors = [[m.derivative(INSIDE, k) - exact.derivative(INSIDE, k) for k in range(4)] for m in motions]
    reported = [[m.standard_error(INSIDE, k) for k in range(4)] for m in motions]
    return np.array(errors), np.array(reported), np.array([m.scatter for m in motions])


@pytest.mark.parametrize("order", range(4))
def test_standard_error_is_the_error(trials, order):
    errors, reported, _ = trials
    ratio = np.sqrt(np.mean(errors[:, order] ** 2) / np.mean(reported[:, order] ** 2))
    assert 0.7 < ratio < 2


@pytest.mark.parametrize("order", range(1, 4))
def test_standard_error_is_the_error_at_every_phase(trials, order):
    errors, reported, _ = trials
    ratio = np.sqrt(np.mean(errors[:, order] ** 2, axis=0) / np.mean(reported[:, order] ** 2, axis=0))
    assert ratio.min() > 0.6
    assert ratio.max() < 2.2


@pytest.mark.parametrize("order", range(1, 4))
def test_two_standard_errors_cover_most_errors(trials, order):
    errors, reported, _ = trials
    assert np.mean(np.abs(errors[:, order]) < 2 * reported[:, order]) > 0.85


def test_scatter_is_the_noise(trials):
    assert np.mean(trials[2]) == pytest.approx(NOISE, rel=0.1)


def test_standard_error_is_zero_at_the_fixed_ends():
    motion = noisy_quintic(0, 61, "exact ends")
    assert motion.standard_error(np.array([0.0, DURATION]), 0) == pytest.approx([0, 0], abs=0)
    assert motion.standard_error(np.array([0.0, DURATION]), 1) == pytest.approx([0, 0], abs=0)
    assert (motion.standard_error(np.array([0.0, DURATION]), 3) > 0).all()


# ---- (d) hard cases --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(), (0,), (5,), (2, 3)])
def test_standard_error_has_the_shape_of_time(shape):
    error = noisy_quintic(0, 61, "exact ends").standard_error(np.full(shape, 0.7), 2)
    assert np.shape(error) == shape


def test_uneven_rows_reproduce_the_law():
    z = np.sort(np.random.default_rng(0).uniform(0, 1, 60))
    z[[0, -1]] = 0, 1
    exact = law("quintic", STROKE, DURATION)
    assert from_table(DURATION * z, exact.position(DURATION * z)).jerk(INSIDE) == pytest.approx(
        exact.jerk(INSIDE), abs=1e-6
    )


def test_gap_in_the_rows_increases_the_error_estimate():
    z = np.concatenate([np.linspace(0, 0.3, 20), np.linspace(0.7, 1, 20)])
    noise = NOISE * np.random.default_rng(0).standard_normal(40) * (z > 0) * (z < 1)
    exact = law("quintic", STROKE, DURATION)
    motion = from_table(DURATION * z, exact.position(DURATION * z) + noise)
    middle, elsewhere = motion.standard_error(DURATION * np.array([0.5, 0.2]), 0)
    assert middle > 3 * elsewhere
    assert abs(motion.position(DURATION / 2) - STROKE / 2) < 4 * middle


def test_table_may_start_anywhere():
    time, position = table_of("quintic")
    moved = from_table(1e3 + time, 5.0 + position)
    assert (moved.stroke, moved.duration) == pytest.approx((STROKE, DURATION), rel=1e-12)
    assert moved.jerk(INSIDE) == pytest.approx(law("quintic", STROKE, DURATION).jerk(INSIDE), abs=1e-5)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_table_of_any_scale(scale):
    time, position = table_of("quintic")
    got = from_table(scale * time, position / scale).jerk(scale * INSIDE)
    assert got * scale**4 == pytest.approx(from_table(time, position).jerk(INSIDE), abs=1e-6)


def test_rounded_table_reproduces_its_velocity():
    time, position = table_of("quintic", 301)
    motion = from_table(time, position.round(4))
    assert motion.scatter == pytest.approx(1e-4 / np.sqrt(12), rel=0.2)
    assert motion.peaks().velocity == pytest.approx(0.25, rel=2e-3)


# ---- (e) properties --------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.integers(12, 80), st.floats(0, 0.05), st.integers(0, 2**31))
def test_end_rows_are_interpolated_at_rest(rows, noise, seed):
    time, position = table_of("septic", rows)
    position = position + noise * STROKE * np.random.default_rng(seed).standard_normal(rows)
    motion = from_table(time, position)
    ends = np.array([0.0, motion.duration])
    size = np.abs(motion.velocity(np.linspace(0, motion.duration, 50))).max()
    assert motion.position(ends) == pytest.approx(
        [0.0, position[-1] - position[0]], rel=1e-12, abs=1e-12 * abs(size) * DURATION
    )
    assert motion.velocity(ends) == pytest.approx([0.0, 0.0], abs=1e-10 * size)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-3, 1e3))
def test_curve_scales_with_the_table(seed, scale):
    time, position = table_of("quintic", 31)
    position = position + NOISE * np.random.default_rng(seed).standard_normal(31)
    one, other = from_table(time, position), from_table(time, scale * position)
    assert other.velocity(INSIDE) / scale == pytest.approx(one.velocity(INSIDE), rel=1e-6, abs=1e-8)
    assert other.scatter / scale == pytest.approx(one.scatter, rel=1e-6)


# ---- (g) refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time", "position", "message"),
    [
        (
            np.arange(11.0),
            np.arange(11.0),
            r"`time` and `position` must be columns of one length >= 12, got shapes \(11,\) and \(11,\)",
        ),
        (np.arange(13.0), np.arange(12.0), r"columns of one length >= 12, got shapes \(13,\) and \(12,\)"),
        (np.zeros((13, 2)), np.zeros((13, 2)), r"columns of one length >= 12, got shapes \(13, 2\) and \(13, 2\)"),
        (np.arange(13.0), np.r_[np.nan, np.arange(12.0)], r"`position` must be finite, got .*nan.* at index 0"),
        (np.r_[np.arange(12.0), np.inf], np.arange(13.0), r"`time` must be finite, got .*inf.* at index 12"),
        (np.r_[0.0, 1.0, 1.0, np.arange(2.0, 12.0)], np.arange(13.0), "`time` must increase, got 1 after 1 in row 3"),
        (np.r_[0.0, 2.0, 1.5, np.arange(3.0, 13.0)], np.arange(13.0), "`time` must increase, got 1.5 after 2 in row 3"),
        (np.arange(13.0), 5 - np.arange(13.0), "`position` must end above its start, got 5 to -7"),
        (np.arange(13.0), np.full(13, 2.0), "`position` must end above its start, got 2 to 2"),
    ],
    ids=["few", "unequal", "two columns", "nan", "inf", "twice", "backwards in time", "backwards", "standing"],
)
def test_invalid_table_is_rejected(time, position, message):
    with pytest.raises(ValueError, match=message):
        from_table(time, position)


def test_time_outside_the_table_is_rejected():
    with pytest.raises(ValueError, match=r"`time` must lie in \[0, 3\] s, got 3.1 to 3.1"):
        from_table(*table_of("quintic")).jerk(3.1)
