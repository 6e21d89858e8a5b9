"""Motion from a table: polynomial laws, interpolated end rows, scatter, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from compact.motion.profile import law
from compact.motion.tabulated import from_table

STROKE, DURATION, NOISE = 0.4, 3.0, 1e-5
INSIDE = np.linspace(0.05, 0.95, 19) * DURATION
QUINTIC, ENDS = law("quintic", STROKE, DURATION), np.array([0.0, DURATION])


def table_of(name, rows=61):
    time = np.linspace(0, DURATION, rows)
    return time, law(name, STROKE, DURATION).position(time)


def noisy_quintic(seed, rows=61):
    """Table of the quintic law with normal noise of NOISE m on all but the end rows."""
    time, position = table_of("quintic", rows)
    noise = NOISE * np.random.default_rng(seed).standard_normal(rows)
    return from_table(time, position + noise * (time > 0) * (time < DURATION))


# ---- (a) closed form, (b) order --------------------------------------------------------------------------------------


@pytest.mark.parametrize("rows", [12, 13, 30, 61, 400])
@pytest.mark.parametrize("name", ["cubic", "quintic"])
def test_table_without_noise_reproduces_its_polynomial(name, rows):
    time, exact, got = np.linspace(0, DURATION, 301), law(name, STROKE, DURATION), from_table(*table_of(name, rows))
    for order, digits in enumerate([1e-11, 1e-10, 1e-8, 1e-6]):
        expected = exact.derivative(time, order)
        assert got.derivative(time, order) == pytest.approx(expected, rel=0, abs=digits * np.abs(expected).max())
    peaks, known = got.peaks(), exact.peaks()
    assert (peaks.velocity, peaks.acceleration, peaks.jerk) == pytest.approx(
        (known.velocity, known.acceleration, known.jerk), rel=1e-5
    )


def test_error_without_noise_has_the_order_of_the_quintic_spline():
    rows, exact = np.array([31, 61, 121]), law("cycloidal", STROKE, DURATION).position(INSIDE)
    error = [np.abs(from_table(*table_of("cycloidal", n)).position(INSIDE) - exact).max() for n in rows]
    assert -np.polyfit(np.log(rows), np.log(error), 1)[0] > 5.5


def test_scatter_is_the_noise():
    assert np.mean([noisy_quintic(seed).scatter for seed in range(80)]) == pytest.approx(NOISE, rel=0.1)


# ---- (d) hard cases --------------------------------------------------------------------------------------------------


# ---- (e) properties --------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.integers(12, 80), st.floats(0, 0.05), st.integers(0, 2**31))
def test_end_rows_are_interpolated_at_rest(rows, noise, seed):
    time, position = table_of("septic", rows)
    position = position + noise * STROKE * np.random.default_rng(seed).standard_normal(rows)
    motion = from_table(time, position)
    size = np.abs(motion.velocity(np.linspace(0, DURATION, 50))).max()
    travel = [0.0, position[-1] - position[0]]
    assert motion.position(ENDS) == pytest.approx(travel, rel=1e-12, abs=1e-12 * size * DURATION)
    assert motion.velocity(ENDS) == pytest.approx([0.0, 0.0], abs=1e-10 * size)


# ---- (g) refusals ----------------------------------------------------------------------------------------------------

RISE = np.arange(13.0)


@pytest.mark.parametrize(
    ("time", "position", "message"),
    [
        (np.arange(11.0), np.arange(11.0), r"columns of one length >= 12, got shapes \(11,\) and \(11,\)"),
        (RISE, np.arange(12.0), r"columns of one length >= 12, got shapes \(13,\) and \(12,\)"),
        (RISE, np.r_[np.nan, np.arange(12.0)], r"`position` must be finite, got .*nan.* at index 0"),
        (np.r_[0.0, 2.0, 1.5, np.arange(3.0, 13.0)], RISE, "`time` must increase, got 1.5 at index 1"),
        (RISE, np.full(13, 2.0), "`position` must end above its start, got 2"),
    ],
)
def test_invalid_table_is_refused(time, position, message):
    with pytest.raises(ValueError, match=message):
        from_table(time, position)
