"""Laws of minimum criterion against closed forms in 50 digits, a Ritz minimisation, and the sources D, A and B."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial, legendre
from published import BEST_TRAVEL_AT_FIXED_STROKE, LONE_TRAVEL, LONE_TURNING_JERK, LOSS_OF_HALF
from sampling import examples

from compact.motion.laws import ComplexLaw, minimiser

PHASES = np.concatenate(
    [[0.0, 1e-9, 1e-6, 1e-4, 1e-3], np.linspace(0.01, 0.99, 15), 1 - 2.0 ** np.array([-10, -20, -40]), [1.0]]
)
REST, STEADY = {0: 0, 1: 0, 2: 0, 3: 0}, {1: 1, 2: 0, 3: 0}


def first(conditions, count, **replaced):
    return {k: conditions[k] for k in list(conditions)[:count]} | replaced


def action(polynomial, order):
    """int_0^1 (x^(order))^2 dz."""
    return (polynomial.deriv(order) ** 2).integ()(1.0)


# ---- the naive twin: sinh of the roots in 50 digits ------------------------------------------------------------------


def twin(d1, d2, order, phases):
    """Derivative of the complex law from its characteristic roots, solved in 50 digits."""
    with mpmath.workdps(50):
        modes = [lambda u, n: u if n == 0 else mpmath.mpf(n == 1), *_twin_modes(mpmath.mpf(d1), mpmath.mpf(d2))]
        half = mpmath.mpf(1) / 2
        matrix = mpmath.matrix([[mode(half, k) for mode in modes] for k in range(len(modes))])
        weights = mpmath.lu_solve(matrix, mpmath.matrix([half] + [0] * (len(modes) - 1)))
        places = [mpmath.mpf(float(z)) - half for z in phases]
        values = [sum(w * mode(u, order) for w, mode in zip(weights, modes, strict=True)) for u in places]
        return np.array([float(mpmath.re(value + (half if order == 0 else 0))) for value in values])


def _twin_modes(d1, d2):
    d3 = 1 - d1 - d2
    if d3 == 0:
        return [_odd(mpmath.sqrt(12 * d1 / d2), 3)] if d2 > 0 else []
    n1, n2 = 60 * d2 / d3, 720 * d1 / d3
    root = mpmath.sqrt(mpmath.mpc(n1 * n1 - 4 * n2))
    if root == 0 and n1 > 0:
        p = mpmath.sqrt(n1 / 2)
        return [
            _odd(p, 3),
            lambda u, n: mpmath.diff(lambda q: _odd(q, 3)(u, n) * mpmath.cosh(q / 2), p) / mpmath.cosh(p / 2),
        ]
    pair = [mpmath.sqrt((n1 + root) / 2), mpmath.sqrt((n1 - root) / 2)]
    return [_odd(pair[0], 3), _odd(pair[1], 3 if pair[0] != 0 else 5)]


def _odd(p, power):
    """sinh(p u) scaled to its end, or the power it turns into at p = 0."""
    if p == 0:
        return lambda u, n: mpmath.ff(power, n) * u ** (power - n) if n <= power else mpmath.mpf(0)
    even_odd = (mpmath.sinh, mpmath.cosh)
    return lambda u, n: p**n * even_odd[n % 2](p * u) / mpmath.cosh(mpmath.re(p) / 2)


def exact_weights(d3, d2):
    """(d1, d2) as multiples of 2^-52 with 1 - d1 - d2 exact, so that the twin solves the same problem."""
    d2, d3 = (round(d * 2**52) / 2**52 for d in (d2, d3))
    return 1.0 - d3 - d2, d2


def double_root(d3, off=0.0):
    """Weights with n1^2 = 4 n2 (1 + off)^2, that is d2^2 = 0.8 d1 d3."""
    d2 = (math.sqrt(0.64 * d3**2 + 3.2 * d3 * (1 - d3)) - 0.8 * d3) / 2
    return exact_weights(d3, d2 * (1 + off))


WEIGHTS = {
    "jerk alone": (0.0, 0.0),
    "acceleration alone": (0.0, 1.0),
    "energy alone": (1.0, 0.0),
    "as in D 2.5": exact_weights(0.2, 0.3),
    "double root": (0.625, 0.25),  # d1 : d2 : d3 = 5 : 2 : 1, exact in binary
    "double root + 1e-9": double_root(0.125, 1e-9),
    "double root - 1e-9": double_root(0.125, -1e-9),
    "double root + 1e-9, layers": double_root(1e-3, 1e-9),
    "double root - 1e-9, layers": double_root(1e-3, -1e-9),
    "double root + 1e-9, jerk rules": double_root(0.9, 1e-9),
    "double root, thin layers": double_root(1e-6),
    "complex roots": exact_weights(0.5, 0.01),
    "complex roots, layers": exact_weights(1e-4, 1e-4),
    "imaginary part alone": exact_weights(0.3, 0.0),
    "real roots": exact_weights(0.05, 0.7),
    "one layer": exact_weights(1e-4, 0.7),
    "d1 -> 0": exact_weights(0.4, 0.6 - 1e-12),
    "d1 = 0": exact_weights(0.4, 0.6),
    "d1 -> 1": exact_weights(1e-7, 1e-7),
    "d2 -> 1": exact_weights(1e-7, 1 - 2e-7),
    "d3 -> 0": exact_weights(2.0**-30, 0.3),
    "d3 -> 0, d1 -> 0": exact_weights(2.0**-30, 1 - 2.0**-29),
    # d3 = 1 - d1 - d2 of the weights as they are, not after rounding 1 - d1
    "small d3": (0.033, 0.967 - 1.4e-6),
    "small d1, d3": (2.7e-6, 1 - 2.9e-6),
    "smaller d3": (0.013, 0.987 - 3e-10),
    "d3 = 0": (0.5, 0.5),
    "d3 = 0, layer": (1 - 2.0**-20, 2.0**-20),
}


# ---- (a) closed form -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "start", "end", "coefficients"),
    [
        (1, {0: 0}, {0: 1}, [0, 1]),
        (2, first(REST, 2), first(REST, 2) | {0: 1}, [0, 0, 3, -2]),
        (3, first(REST, 3), first(REST, 3) | {0: 1}, [0, 0, 0, 10, -15, 6]),
        (4, REST, REST | {0: 1}, [0, 0, 0, 0, 35, -84, 70, -20]),
        (2, {0: 0, 1: 0}, {1: 1, 2: 0}, [0, 0, 1, -1 / 3]),  # 2.6: velocity 2 tau - tau^2
        (3, first(REST, 3), STEADY, [0, 0, 0, 2, -2, 3 / 5]),  # 2.7: 6 tau^2 - 8 tau^3 + 3 tau^4
        (4, REST, STEADY | {4: 0}, [0, 0, 0, 0, 5, -9, 6, -10 / 7]),  # 2.8
        (2, {0: 0, 1: 0}, {1: 1}, [0, 0, 1 / 2]),  # 3.1: velocity tau
        (3, first(REST, 3), {1: 1, 2: 0}, [0, 0, 0, 1, -1 / 2]),  # 3.2: 3 tau^2 - 2 tau^3
        (4, REST, STEADY, [0, 0, 0, 0, 5 / 2, -3, 1]),  # 3.3: 10 tau^3 - 15 tau^4 + 6 tau^5
        (3, {0: 0, 1: 0}, {1: 1, 2: 0}, [0, 0, 3 / 4, 0, -1 / 8]),  # 4.1: (3 tau - tau^3)/2
        (4, {0: 0, 1: 0, 3: 0}, STEADY, [0, 0, 15 / 16, 0, -5 / 16, 0, 1 / 16]),  # 4.2
    ],
    ids=["2.1", "2.2", "2.3", "2.4", "2.6", "2.7", "2.8", "3.1", "3.2", "3.3", "4.1", "4.2"],
)
def test_minimiser_is_the_polynomial_of_the_monograph(order, start, end, coefficients):
    expected = coefficients + [0] * (2 * order - len(coefficients))
    assert minimiser(order, start, end).coef == pytest.approx(expected, rel=1e-14, abs=1e-14)


@pytest.mark.parametrize(("order", "free"), [(n, k) for n in (1, 2, 3, 4) for k in range(n) if (n, k) != (1, 0)])
def test_free_end_value_adds_its_natural_condition(order, free):
    end = {k: 1.0 for k in range(order) if k != free}
    x, natural = minimiser(order, first(REST, order), end), 2 * order - 1 - free
    assert abs(x.deriv(natural)(1.0)) < 1e-11 * np.abs(x.deriv(natural - 1)(np.linspace(0, 1, 9))).max()
    x = minimiser(order, end, first(REST, order))  # at the start
    assert abs(x.deriv(natural)(0.0)) < 1e-11 * np.abs(x.deriv(natural - 1)(np.linspace(0, 1, 9))).max()


@pytest.mark.parametrize(
    ("order", "start", "end"), [(3, {2: 0}, {1: 1, 2: 0}), (4, {2: 0, 3: 0}, STEADY)], ids=["4.1", "4.2 and 4.4"]
)
def test_free_acceleration_at_the_reversal_equals_minimisation_over_the_whole_reversal(order, start, end):
    # brake and start as one phase from velocity -1 to 1; its second half is the run-up
    steady_end = {k: float(k == 1) for k in range(1, order)}
    whole = minimiser(order, steady_end | {1: -1.0}, steady_end | {0: 0.0})
    turn = {0: 0, 1: 0} | ({3: 0} if order == 4 else {})
    run_up = minimiser(order, turn, end)
    tau = np.linspace(0, 1, 21)
    assert 2 * (whole(0.5 + tau / 2) - whole(0.5)) == pytest.approx(run_up(tau), abs=1e-13)


def test_single_phase_reverses_with_jerk():
    x = minimiser(4, {0: 0, 1: 0, 2: 0}, STEADY)  # D-12
    assert (x.deriv(3)(0.0), x(1.0)) == pytest.approx((float(LONE_TURNING_JERK), float(LONE_TRAVEL)), rel=1e-13)


@pytest.mark.parametrize("jerk", [-7.0, -1.0, 1e-2, 1.0, 20 / 3])
def test_deceleration_and_acceleration_together_reverse_without_jerk(jerk):
    # D 4.3: the start has b, the brake run backwards in time has -b
    cost = {b: action(minimiser(4, REST | {3: b}, STEADY), 4) for b in (jerk, -jerk, 0.0)}
    assert cost[jerk] + cost[-jerk] > 2 * cost[0.0]


def test_optimal_travel_at_fixed_stroke():
    # run-up of unit time over x1 to speed v, minimise over (x1, v) with 2 x1 + 4 v = stroke
    bases = [minimiser(4, REST, {0: x, 1: v, 2: 0, 3: 0}) for x, v in ((1, 0), (0, 1))]
    form = np.array([[(a.deriv(4) * b.deriv(4)).integ()(1.0) for b in bases] for a in bases])
    closure = np.array([2.0, 4.0])
    best = np.linalg.solve(form, closure)
    best, half = best / (closure @ best), np.array([0.5, 1.0]) / (closure @ [0.5, 1.0])
    assert best[0] / best[1] == pytest.approx(float(BEST_TRAVEL_AT_FIXED_STROKE), rel=1e-12)
    assert half @ form @ half / (best @ form @ best) - 1 == pytest.approx(LOSS_OF_HALF, abs=5e-6)


@pytest.mark.parametrize("weights", WEIGHTS.values(), ids=WEIGHTS)
def test_complex_law_is_its_closed_form(weights):
    for order in range(5):
        exact, got = twin(*weights, order, PHASES), ComplexLaw(*weights)(PHASES, nu=order)
        assert got == pytest.approx(exact, rel=0, abs=1e-12 * np.abs(exact).max() + 1e-300)


@pytest.mark.parametrize(
    ("weights", "order"), [((0.0, 0.0), 3), ((0.0, 1.0), 2), ((1.0, 0.0), 1)], ids=["jerk", "acceleration", "energy"]
)
def test_complex_law_of_one_weight_is_the_polynomial_law(weights, order):
    x = minimiser(order, first(REST, order), first(REST, order) | {0: 1})
    assert ComplexLaw(*weights)(PHASES) == pytest.approx(x(PHASES), abs=1e-14)


NODES, GAUSS = legendre.leggauss(128)
NEAR = np.concatenate([[0], 2.0 ** -np.arange(30, 0, -1)])
EDGES = np.concatenate([NEAR, 1 - NEAR[-2::-1]])  # of intervals that halve towards both ends, where layers are


@pytest.mark.parametrize(
    ("d3", "d2"),
    [(0.2, 0.3), (0.9, 0.05), (0.05, 0.9), (0.125, 0.25), (0.3, 0.7), (0.01, double_root(0.01)[1]), (0.01, 0.0),
     (1e-4, 0.3), (1e-5, 0.6), (1e-6, 0.3), (1e-6, 1e-3)],
)  # fmt: skip
def test_complex_law_minimises_its_criterion_directly(d3, d2):
    """No variation z^3 (1 - z)^3 P_k, which rests at both ends, changes the convex I at first order."""
    d1, d2 = exact_weights(d3, d2)
    law, half = ComplexLaw(d1, d2), np.diff(EDGES) / 2
    z = EDGES[:-1, None] + half[:, None] * (1 + NODES)
    parts = [half[:, None] * GAUSS * w * law(z, nu=n) for n, w in ((1, d1), (2, d2 / 12), (3, (1 - d1 - d2) / 720))]
    for degree in (*range(12), 20, 60, 140, 200, 420):
        variation = Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3
        series = legendre.legmul(legendre.poly2leg(variation(Polynomial([0.5, 0.5])).coef), [0] * degree + [1])
        changes = [
            part * legendre.legval(2 * z - 1, 2.0**n * legendre.legder(series, n)) for n, part in enumerate(parts, 1)
        ]
        assert abs(np.sum(changes)) < 1e-9 * np.abs(changes).sum()


# ---- (d) hard cases --------------------------------------------------------------------------------------------------

INSIDE, LINE = np.linspace(0.05, 0.95, 19), Polynomial([0, 1])
CUBIC, QUINTIC = Polynomial([0, 0, 3, -2]), Polynomial([0, 0, 0, 10, -15, 6])


@pytest.mark.parametrize(
    ("limit", "weights", "order", "within"),
    [
        *((QUINTIC, (d1, d2), 3, 1e-10) for d1, d2 in [(1e-300, 0.0), (0.0, 1e-300), (5e-324, 5e-324), (1e-17, 1e-17)]),
        *((LINE, (d1, d2), k, 1e-3) for k in range(4)
          for d1, d2 in [(1.0, 1e-300), (1.0, 5e-324), (1 - 1e-16, 0.0), (1.0, 1e-16), (1 - 1e-9, 1e-9)]),
        *((CUBIC, (d1, d2), 1, 1e-5) for d1, d2 in [(0.0, 1 - 1e-16), (1e-300, 1 - 1e-16), (1e-300, 1.0)]),
    ],
)  # fmt: skip
def test_extreme_weights_give_the_law_of_one_weight(limit, weights, order, within):
    assert ComplexLaw(*weights)(INSIDE, nu=order) == pytest.approx(limit.deriv(order)(INSIDE), abs=within)


# ---- (e) properties --------------------------------------------------------------------------------------------------

conditions = st.floats(-10, 10)


@examples(30, slow=60)
@given(st.integers(1, 4), st.lists(conditions, min_size=8, max_size=8), st.integers(0, 3))
def test_minimiser_is_stationary_for_variations_at_rest(order, values, degree):
    x = minimiser(order, dict(enumerate(values[:order])), dict(enumerate(values[4 : 4 + order])))
    variation = Polynomial([0, 1]) ** order * Polynomial([1, -1]) ** order * Polynomial.basis(degree)
    change = (x.deriv(order) * variation.deriv(order)).integ()(1.0)
    assert abs(change) <= 1e-9 * math.sqrt(action(x, order) * action(variation, order)) + 1e-12


# ---- (g) refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: minimiser(2, {0: 0, 4: 0}, {0: 1, 1: 0}),
            r"2 conditions on derivatives of order 0 to 3, got \[0, 4\]",
        ),
        (lambda: minimiser(2, {1: 0}, {1: 1}), r"`start` \{1: 0\} and `end` \{1: 1\} leave x undetermined; add"),
        (lambda: ComplexLaw(0.9, 0.2), "`energy_weight` and `acceleration_weight` .* got 0.9 and 0.2"),
    ],
)
def test_conditions_and_weights_that_fit_no_law_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
