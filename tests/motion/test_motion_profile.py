"""Motion laws and tables: published peaks, closed forms, discontinuities, cycles, limiting cases, refusals."""

import math
from dataclasses import astuple

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import legendre
from published import CHAPTER_5, COMPLEX_LAW, CRITERIA, LAWS_OF_D, RUN_UP_TRAVEL, VDI_2143
from sampling import examples

from compact.motion.laws import CrankCurve
from compact.motion.profile import LAWS, law
from compact.motion.tabulated import from_table

NAMES, SHAPED = list(LAWS), list(RUN_UP_TRAVEL)
# Derivatives that vanish at rest, and at the start of the constant velocity (D 2.6-4.4): conditions given and natural
RUN_UP_ENDS = {
    "combined-2": ((1,), (2,)),
    "combined-3": ((1, 2), (2, 3)),
    "combined-4": ((1, 2, 3), (2, 3, 4)),
    "reversal-2": ((1,), (3,)),
    "reversal-3": ((1, 2), (2, 5)),
    "reversal-4": ((1, 2, 3), (2, 3, 7)),
    "reversal-3-free-acceleration": ((1, 3), (2, 5)),
    "reversal-4-free-acceleration": ((1, 3, 5), (2, 3, 7)),
    "reversal-4-free-jerk": ((1, 2, 3), (2, 3, 7)),
    "reversal-4-free-both": ((1, 3, 5), (2, 3, 7)),
}
# Other laws: derivatives that vanish at both ends, smoothness at a reversal and at a dwell
OTHERS = {
    "complex": ((1, 2), COMPLEX_LAW[2:]),
    "crank": ((1, 3), (4, 1)),
    "harmonic": ((1, 3), (4, 1)),
    "parabolic": ((1,), (1, 1)),
    "cycloidal": ((1, 2), (2, 2)),
    "modified-trapezoid": ((1, 2), (2, 2)),
    "gear-sector": ((), (0, 0)),
}
RESTING = {"cubic": (1,), "quintic": (1, 2), "septic": (1, 2, 3)}
RESTING |= {name: orders for name, (orders, _) in (RUN_UP_ENDS | OTHERS).items()}
SMOOTHNESS = {name: law[2:] for name, law in LAWS_OF_D.items()} | {name: smooth for name, (_, smooth) in OTHERS.items()}
RUNS = [(1 / 6, 1 / 6), (0.05, 0.3), (0.5, 0.5)]


def unit(name, **shape):
    """The law over a unit stroke in unit time; the crank with a rod of five radii."""
    return law(name, 1.0, 1.0, rod_length=2.5, **shape)


def inner_sides(motion, order):
    """Largest |s^(order)| over the pieces."""
    breaks = motion.curve.x
    z = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0, 1 - 1e-9, 129)
    return np.abs(motion.curve(z, nu=order)).max()


# ---- (a) closed forms, (c) published numbers -------------------------------------------------------------------------

C = 8 * np.pi / (2 + np.pi)  # of the modified trapezoid
PEAKS = {name: ([float(peak) for peak in peaks], 1e-12) for name, (_, peaks, *_) in LAWS_OF_D.items()} | {
    "complex": (COMPLEX_LAW[1], 1e-10),
    "modified-trapezoid": ((2, C, 4 * np.pi * C, 16 * np.pi**2 * C), 1e-12),
}


@pytest.mark.parametrize("name", PEAKS)
def test_peaks_of_the_monograph_are_exact(name):
    peaks, within = PEAKS[name]
    assert astuple(unit(name).peaks()) == pytest.approx(peaks, rel=within, abs=0)


@pytest.mark.parametrize("name", VDI_2143)
def test_published_peaks_of_vdi_2143(name):
    peaks = unit(name).peaks()
    assert (peaks.velocity, peaks.acceleration, peaks.jerk) == pytest.approx(VDI_2143[name], rel=1e-5, abs=1e-12)


@pytest.mark.parametrize("name", CHAPTER_5)
def test_printed_peaks_of_chapter_5_are_those_without_an_erratum(name):
    printed, erratum = CHAPTER_5[name]
    peaks = law(name, 0.4, 3.0).peaks()
    pairs = zip((peaks.acceleration, peaks.jerk), printed, strict=True)
    off = [abs(value - number) for value, number in pairs if number]
    assert (max(off) > 2e-3) if erratum else (max(off) < 5e-4)


@pytest.mark.parametrize("name", NAMES)
def test_published_smoothness(name):
    assert (unit(name).smoothness(), unit(name).smoothness("dwell")) == SMOOTHNESS[name]


@pytest.mark.parametrize(("name", "order", "value"), CRITERIA.values(), ids=CRITERIA)
def test_published_criteria(name, order, value):
    exact = {11043: 5e-5, 7465: 1e-4, 26.13e6: 2e-4, 16.12e6: 4e-4}.get(value, 1e-13)  # to the digits printed
    assert unit(name).criterion(order) == pytest.approx(float(value), rel=exact)


EXACT = {  # criteria by their order, infinite with an impulse
    "constant-velocity": {1: 1.0, 2: np.inf},
    "gear-sector": {2: np.inf},
    "cubic": {0: 13 / 35, 2: 12.0, 3: 144.0},
    "quintic": {3: 720.0, 4: np.inf},
    "septic": {4: 100800.0},
    "reversal-2": {3: np.inf},
    "parabolic": {2: 16.0, 3: np.inf},
    "harmonic": {1: math.pi**2 / 8, 2: math.pi**4 / 8, 3: math.pi**6 / 8},
    "cycloidal": {1: 3 / 2, 2: 2 * math.pi**2, 3: 8 * math.pi**4},
}
IMPULSE_AT_A_DWELL = {"cubic": 3, "harmonic": 3}


@pytest.mark.parametrize("turn", ["reversal", "dwell"])
@pytest.mark.parametrize(("name", "order"), [(name, order) for name, orders in EXACT.items() for order in orders])
def test_criterion_is_its_closed_form(name, order, turn):
    exact = np.inf if turn == "dwell" and IMPULSE_AT_A_DWELL.get(name) == order else EXACT[name][order]
    scaled = 0.4**2 / 3.0 ** (2 * order - 1) * exact
    assert law(name, 0.4, 3.0).criterion(order, turn) == pytest.approx(scaled, rel=1e-13)
    assert unit("reversal-3-free-acceleration").criterion(3, "dwell") == np.inf


@pytest.mark.parametrize(("run_up", "run_down"), [*RUNS, (0.0, 0.0), (0.0, 0.25), (0.4, 0.0)])
@pytest.mark.parametrize("name", SHAPED)
def test_phases_of_laws_with_constant_velocity(name, run_up, run_down):
    """Speed by the stroke; the deceleration is the scaled mirror image of the acceleration; nothing in between."""
    motion, share = unit(name, run_up=run_up, run_down=run_down), float(RUN_UP_TRAVEL[name])
    tau = np.linspace(0.01, 0.99, 23)
    speed = 1 / (share * (run_up + run_down) + 1 - run_up - run_down)
    assert motion.velocity(run_up) == pytest.approx(speed, rel=1e-13)
    if run_up and run_down:
        up, down = run_up * tau, 1 - run_down * tau
        assert motion.velocity(down) == pytest.approx(motion.velocity(up), rel=1e-12)
        assert motion.acceleration(down) * run_down == pytest.approx(-motion.acceleration(up) * run_up, abs=1e-12)
    if run_up + run_down < 1:
        z = np.linspace(run_up + 1e-9, 1 - run_down - 1e-9, 33)
        assert motion.velocity(z) == pytest.approx(np.full(33, speed), rel=1e-13)
        assert np.abs([motion.derivative(z, k) for k in (2, 3, 4)]).max() == 0


@pytest.mark.parametrize("name", RESTING)
def test_derivatives_vanish_at_the_ends(name):
    for run_up, run_down in RUNS:
        motion = unit(name, run_up=run_up, run_down=run_down)
        ends = [motion.curve(np.array([0.0, 1.0]), nu=k) / inner_sides(motion, k) for k in RESTING[name]]
        assert np.array(ends) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", RUN_UP_ENDS)
def test_derivatives_vanish_at_the_start_of_the_constant_velocity(name):
    motion = unit(name, run_up=0.05, run_down=0.3)
    sides = np.array([motion.curve.x[1] - 1e-15, motion.curve.x[2]])
    for order in RUN_UP_ENDS[name][1]:
        size = max(inner_sides(motion, order), 1.0) + 1e-3 * inner_sides(motion, order + 1)
        assert motion.curve(sides, nu=order) == pytest.approx([0, 0], abs=1e-11 * size)


@pytest.mark.parametrize("ratio", [0.0, 1e-9, 0.1, 0.5, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("order", range(5))
def test_crank_law_is_the_slider_crank_mechanism(ratio, order):
    k = mpmath.mpf(ratio)

    def travel(z):  # (r + l - r cos psi - l cos beta)/(2 r), from the outer dead centre
        psi = mpmath.pi * z
        root = mpmath.sqrt(1 - (k * mpmath.sin(psi)) ** 2)
        return (1 - mpmath.cos(psi)) / 2 + k * mpmath.sin(psi) ** 2 / (2 * (1 + root))

    z = np.array([0.0, 2.0**-30, 0.01, 0.125, 0.3, 0.45, 0.5, 0.55, 0.7, 0.9, 1.0])
    with mpmath.workdps(40):
        exact = [float(mpmath.taylor(travel, mpmath.mpf(float(p)), order)[order] * mpmath.factorial(order)) for p in z]
    assert CrankCurve(ratio)(z, nu=order) == pytest.approx(
        exact, rel=0, abs=1e-12 * np.abs(exact).max() / (1 - ratio**2)
    )


# ---- joins and cycles ------------------------------------------------------------------------------------------------

K = 6480 / 13  # jerk of combined-3 at its ends


@pytest.mark.parametrize(
    ("name", "turn", "expected"),
    [
        ("constant-velocity", "reversal", [(0, 1, -1, 1), (1, 1, 1, -1)]),
        ("constant-velocity", "dwell", [(0, 1, 0, 1), (1, 1, 1, 0)]),
        ("cubic", "reversal", [(0, 3, 12, -12), (1, 3, -12, 12)]),  # D-10: twice the end value
        ("cubic", "dwell", [(0, 2, 0, 6), (0, 3, 0, -12), (1, 2, -6, 0), (1, 3, -12, 0)]),
        ("quintic", "reversal", [(0, 3, -60, 60), (1, 3, 60, -60)]),
        ("septic", "reversal", []),
        ("septic", "dwell", [(0, 4, 0, 840), (1, 4, -840, 0)]),
        ("reversal-2", "reversal", [(1 / 6, 2, 7.2, 0), (5 / 6, 2, 0, -7.2)]),
        ("reversal-2", "dwell", [(0, 2, 0, 7.2), (1 / 6, 2, 7.2, 0), (5 / 6, 2, 0, -7.2), (1, 2, -7.2, 0)]),
        ("combined-3", "reversal", [(0, 3, -K, K), (1 / 6, 4, 12 * K, 0), (5 / 6, 4, 0, -12 * K), (1, 3, K, -K)]),
        ("parabolic", "reversal", [(0.5, 2, 4, -4)]),
        ("harmonic", "reversal", []),
        ("crank", "reversal", []),
    ],
)
def test_discontinuities_state_both_limits(name, turn, expected):
    joins = [astuple(join) for join in unit(name).discontinuities(turn)]
    assert np.reshape(joins, (-1, 4)) == pytest.approx(np.reshape(expected, (-1, 4)), rel=1e-10, abs=1e-10)


def test_asymmetric_law_jumps_in_acceleration_at_a_reversal():
    # run-up .05 T and run-down .3 T turn with different free accelerations
    motion = unit("reversal-4-free-both", run_up=0.05, run_down=0.3)
    jump = motion.discontinuities()[0]
    assert (jump.time, jump.order, jump.before / jump.after) == pytest.approx((0.0, 2, 0.05 / 0.3), rel=1e-12)
    assert motion.smoothness() == 1


CYCLES = [
    *((name, *dwells) for name in NAMES for dwells in [(0.0, 0.0), (0.5, 0.25)]),
    *(pytest.param(name, *dwells, marks=pytest.mark.slow) for name in NAMES for dwells in [(0.5, 0.0), (0.0, 0.25)]),
]


def cycle_of(name, far=0.5, near=0.25):
    return law(name, 0.4, 3.0, run_up=0.05, run_down=0.3, rod_length=0.5).cycle(far, near)


def sizes_of(cycle):
    return {k: np.abs(cycle.derivative(np.linspace(0, cycle.period, 999), k)).max() for k in range(1, 5)}


@pytest.mark.parametrize("name", NAMES)
def test_return_stroke_is_the_mirror_image_and_that_of_a_crank_is_reversed_in_time(name):
    cycle, t = cycle_of(name), np.linspace(0.013, 2.987, 41)
    for order in range(5):
        standing = 0.4 * (order == 0)
        expected = standing - cycle.derivative(t, order)
        if name == "crank":
            expected = (-1) ** order * cycle.derivative(3.0 - t, order)
        assert cycle.derivative(3.5 + t, order) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
        assert cycle.derivative([3.25, 6.6], order) == pytest.approx([standing, 0.0], abs=0)


@pytest.mark.parametrize(("name", "far", "near"), CYCLES)
def test_discontinuities_of_the_cycle_are_its_one_sided_limits(name, far, near):
    cycle = cycle_of(name, far, near)
    joins, sizes = cycle.discontinuities(), sizes_of(cycle)
    got = [cycle.derivative(join.time + np.array([-1e-7, 1e-7]), join.order) / sizes[join.order] for join in joins]
    expected = [np.array([join.before, join.after]) / sizes[join.order] for join in joins]
    assert np.reshape(got, (-1, 2)) == pytest.approx(np.reshape(expected, (-1, 2)), abs=1e-4)
    # and it is continuous elsewhere
    parts = np.array([0, 0.05, 0.5, 0.7, 1 / 8, 3 / 8, 5 / 8, 7 / 8])
    phases = np.unique(np.concatenate([leg.start + leg.duration * parts for leg in cycle.legs()]))
    for k, size in sizes.items():
        jumps = np.abs(cycle.derivative(phases + 1e-8, k) - cycle.derivative(phases - 1e-8, k)) > 1e-4 * size + 1e-12
        found = {round(float(t % cycle.period), 6) for t in phases[jumps]}
        assert found == {round(join.time, 6) for join in joins if join.order == k}


# ---- (e) properties --------------------------------------------------------------------------------------------------


@st.composite
def motions(draw, names=tuple(NAMES)):
    name = draw(st.sampled_from(names))
    up = draw(st.one_of(st.just(0.0), st.floats(0.01, 0.5)))
    down = draw(st.one_of(st.just(0.0), st.floats(0.01, 0.5)))
    d3, split = draw(st.floats(1e-3, 1.0)), draw(st.floats(0, 1))
    weights = {"energy_weight": (1 - d3) * split, "acceleration_weight": (1 - d3) * (1 - split)}
    sizes = draw(st.floats(0.01, 10)), draw(st.floats(0.01, 100))
    return law(name, *sizes, run_up=up, run_down=down, **weights, rod_length=20.0 / draw(st.floats(0.5, 3.0)))


NODES, WEIGHTS = legendre.leggauss(64)


@pytest.mark.sampled(28)
@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("name", NAMES)
@examples(4, slow=20)
@given(data=st.data())
def test_each_derivative_integrates_to_the_previous_one(name, order, data):
    motion = data.draw(motions((name,)))
    breaks = motion.curve.x
    piece = data.draw(st.integers(0, len(breaks) - 2))
    low, high = sorted(data.draw(st.tuples(st.floats(0, 0.999), st.floats(0, 0.999))))
    low, high = (breaks[piece] + share * (breaks[piece + 1] - breaks[piece]) for share in (low, high))
    z = (low + high) / 2 + (high - low) / 2 * NODES
    values = motion.curve(z, nu=order + 1)
    integral = (high - low) / 2 * (WEIGHTS @ values)
    ends = motion.curve(np.array([low, high]), nu=order)
    size = np.abs(ends).max() + (high - low) * np.abs(values).max() + 1e-3 * inner_sides(motion, order)
    assert abs(ends[1] - ends[0] - integral) <= 1e-11 * size


@examples(40, slow=150)
@given(motions())
def test_every_law_travels_the_full_stroke_without_jumps(motion):
    ends = motion.position(np.array([0.0, motion.duration])) / motion.stroke
    assert ends == pytest.approx([0.0, 1.0], abs=1e-13)
    z = motion.curve.x[1:-1]
    before, after = motion.curve(np.nextafter(z, -1), nu=0), motion.curve(np.nextafter(z, 2), nu=0)
    assert before == pytest.approx(after, abs=1e-13)


@examples(25, slow=100)
@given(motions())
def test_peaks_are_the_largest_values(motion):
    breaks = motion.curve.x
    z = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(1e-12, 1 - 1e-12, 2001)).ravel()
    sampled = [np.abs(motion.at_phase(z, k)).max() for k in range(1, 5)]
    peaks = astuple(motion.peaks())
    assert all(sample <= peak * (1 + 1e-9) for sample, peak in zip(sampled, peaks, strict=True))
    assert peaks[:3] == pytest.approx(sampled[:3], rel=1e-2, abs=1e-12 * max(peaks))


# ---- (d) hard cases --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHAPED)
@pytest.mark.parametrize("run", [1e-3, 1e-6, 1e-9])
def test_short_acceleration_phase(name, run):
    """From rest, with the smoothness of its law; the acceleration over a run of T/6 grows as 1/run at steady speed."""
    speed = [1 / (1 - 2 * share * (1 - float(RUN_UP_TRAVEL[name]))) for share in (run, 1 / 6)]
    expected = float(LAWS_OF_D[name][1][1]) * speed[0] / speed[1] / (6 * run)
    motion = unit(name, run_up=run, run_down=run)
    assert motion.peaks().velocity == pytest.approx(speed[0], rel=1e-9)
    # a phase near 1 is known to 1.1e-16, and so is the width of the run-down
    assert motion.peaks().acceleration == pytest.approx(expected, rel=1e-9 + 1.2e-16 / run)
    assert motion.smoothness("dwell") == LAWS_OF_D[name][3]
    assert motion.curve(np.array([0.0, 1.0]), nu=1) == pytest.approx([0.0, 0.0], abs=1e-12)
    gone = unit(name, run_up=run * 1e-291, run_down=0.0)
    assert (gone.peaks().velocity, float(gone.position(0.5))) == pytest.approx((1.0, 0.5), rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("stroke", "duration"),
    [(1e-6, 1e6), (1e6, 1e-6), *(pytest.param(1.0, time, marks=pytest.mark.slow) for time in (1e-6, 1e6))],
)
def test_extreme_strokes_and_durations_only_scale(name, stroke, duration):
    motion = law(name, stroke, duration, rod_length=2.5 * stroke)
    exact = [peak * stroke / duration**k for k, peak in enumerate(astuple(unit(name).peaks()), start=1)]
    assert astuple(motion.peaks()) == pytest.approx(exact, rel=1e-11, abs=0)
    assert (motion.smoothness(), motion.smoothness("dwell")) == SMOOTHNESS[name]
    assert motion.position(duration) == pytest.approx(stroke, rel=1e-14)


# ---- (g) refusals ----------------------------------------------------------------------------------------------------

MOTION = law("quintic", 0.4, 3.0)


def made(**changes):
    return law(**({"name": "reversal-3", "stroke": 0.4, "duration": 3.0} | changes))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: made(name="sinus"), "no motion law 'sinus'; choose from constant-velocity, cubic, quintic, "),
        (lambda: made(name="crank"), "the law 'crank' requires `rod_length`, got None; set the length"),
        (lambda: made(run_up=0.6, run_down=0.5), r"`run_up` \+ `run_down` must not exceed 1, got 0.6 \+ 0.5"),
        (lambda: MOTION.position([1.0, 3.1]), r"`time` must lie in \[0, 3\] s, got 1 to 3.1"),
    ],
)
def test_values_out_of_range_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# ---- Motion from a table: polynomial laws, interpolated end rows, scatter, refusals


STROKE, DURATION, NOISE = 0.4, 3.0, 1e-5
INSIDE = np.linspace(0.05, 0.95, 19) * DURATION
ENDS = np.array([0.0, DURATION])


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


@pytest.mark.parametrize("run", [0.5 - 4e-13, 0.5 - 1e-15, 0.5 + 1e-13])
def test_acceleration_and_deceleration_that_fill_the_time_leave_no_constant_velocity(run):
    motion = unit("reversal-3", run_up=run, run_down=run)
    assert motion.peaks().velocity == pytest.approx(2.0, rel=1e-11)
    assert motion.smoothness() == 2
